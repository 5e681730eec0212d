"""White numbers of unit variance: all that is random in a simulated flight.

Each sensor and the turbulence draw from a stream of their own, which follows from the flight's
seed.  Numbers come in rows, one for each sample or step: plain flights draw a row when they come
to it, compiled flights have all rows drawn before.  They are the same numbers.
"""

from __future__ import annotations

import random
import threading
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from hashlib import sha512
from math import exp, expm1, sqrt
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import FloatArray
from tgl_soar.air.gusts import (
    DrydenParams,
    DrydenState,
    RollGustParams,
    dryden_start,
    roll_gust_start,
)
from tgl_soar.sim.box_muller import box_muller
from tgl_soar.sim.kernel_cache import kept

Row = Any  # a tuple of floats, or a row of an array

BLOCK: Final = 1024  # steps of turbulence drawn at once: one draw costs as much as hundreds


class Rows(Protocol):
    """Row k is that of sample or step k."""

    def __getitem__(self, k: int, /) -> Row: ...


NO_ROWS: Final[FloatArray] = np.zeros((1, 3))


class White(Protocol):
    """The numbers of one sensor in one flight."""

    def __call__(
        self, name: str, period_steps: int, once: int, columns: int
    ) -> tuple[tuple[float, ...], Rows]:
        """`once` numbers for the whole flight, and rows of so many columns for the samples."""


class RowsAsNeeded:
    """Rows that are drawn one by one."""

    def __init__(self, name: str, draw: Callable[[], float], columns: int) -> None:
        self._name, self._draw, self._columns = name, draw, columns
        self._next = 0

    def __getitem__(self, k: int) -> tuple[float, ...]:
        """Row k.  Errors: ValueError for any but the next."""
        if k != self._next:
            raise ValueError(
                f"{self._name} was asked for sample {k + 1} where {self._next + 1} is next: what"
                " misses steps does not run at its rate"
            )
        self._next = k + 1
        draw = self._draw
        return tuple([draw() for _ in range(self._columns)])


class DriftingRows:
    """Rows as needed whose first numbers drift: see `with_drift`."""

    def __init__(
        self,
        rows: Rows,
        steps: Rows,
        start: Sequence[float],
        sizes: Sequence[float],
        fraction: float,
    ) -> None:
        self._rows, self._steps, self._sizes = rows, steps, sizes
        self._drift = list(start)
        self._keeps, self._adds = _gauss_markov(fraction)

    def __getitem__(self, k: int) -> tuple[float, ...]:
        """Row k.  Errors: ValueError for any but the next."""
        row, step = self._rows[k], self._steps[k]
        moved = [
            self._keeps * drift + self._adds * white
            for drift, white in zip(self._drift, step, strict=True)
        ]
        if k > 0:
            self._drift = moved
        drifting = len(self._drift)
        added = [
            white + size * drift
            for white, size, drift in zip(row, self._sizes, self._drift, strict=False)
        ]
        return (*added, *row[drifting:])


def with_drift(
    rows: Rows, steps: Rows, start: Sequence[float], sizes: Sequence[float], fraction: float
) -> Rows:
    """Rows with a Gauss-Markov process added to each of their first numbers.

    d[0] = start,  d[k] = e^(−fraction) d[k−1] + √(1 − e^(−2 fraction)) steps[k],  row + sizes · d:
    of unit variance from the beginning, where start and steps are white.  fraction: of the time
    constant that lies between two rows.
    """
    if not isinstance(rows, np.ndarray):
        return DriftingRows(rows, steps, start, sizes, fraction)
    assert isinstance(steps, np.ndarray)
    one_by_one = DriftingRows(rows.tolist(), steps.tolist(), start, sizes, fraction)
    return np.array([one_by_one[k] for k in range(len(rows))])


def _gauss_markov(fraction: float) -> tuple[float, float]:
    return exp(-fraction), sqrt(-expm1(-2.0 * fraction))


def drawn_as_needed(seed: int) -> White:
    """The numbers of a plain flight."""

    def white(
        name: str,
        period_steps: int,  # noqa: ARG001
        once: int,
        columns: int,
    ) -> tuple[tuple[float, ...], Rows]:
        gauss = random.Random(f"{seed}/{name}").gauss
        draw: Callable[[], float] = lambda: gauss(0.0, 1.0)  # noqa: E731
        return tuple(draw() for _ in range(once)), RowsAsNeeded(name, draw, columns)

    return white


def drawn_before(seed: int, steps: int) -> White:
    """The numbers of a compiled flight of so many steps."""

    def white(
        name: str, period_steps: int, once: int, columns: int
    ) -> tuple[tuple[float, ...], Rows]:
        count = once + columns * (steps // period_steps + 1)
        numbers = white_gauss(f"{seed}/{name}", count)
        return tuple(numbers[:once].tolist()), numbers[once:].reshape(-1, columns)

    return white


# The streams of a flight's seed: turbulence 0, roll gusts 1.  Whatever else numpy draws for it is
# to end its seed with another number, and not to be without one: seed draws what [seed, 0] does.


def turbulence_as_needed(params: DrydenParams, seed: int) -> tuple[DrydenState, Rows]:
    """The turbulence's state before step 0, and rows of three numbers for all steps."""
    rng = np.random.default_rng([seed, 0])
    start = dryden_start(params, rng)

    def numbers() -> Iterator[float]:
        while True:
            yield from rng.standard_normal(3 * BLOCK).tolist()

    return start, RowsAsNeeded("the turbulence", numbers().__next__, 3)


def turbulence_before(params: DrydenParams, seed: int, steps: int) -> tuple[DrydenState, Rows]:
    """The same for a compiled flight of so many steps."""
    rng = np.random.default_rng([seed, 0])
    start = dryden_start(params, rng)
    return start, rng.standard_normal(3 * (steps + 1)).reshape(-1, 3)


def roll_gusts_as_needed(params: RollGustParams, seed: int) -> tuple[float, Rows]:
    """The roll gust [rad/s] at step 0, and rows of one number for all steps after it."""
    rng = np.random.default_rng([seed, 1])
    start = roll_gust_start(params, float(rng.standard_normal()))

    def numbers() -> Iterator[float]:
        while True:
            yield from rng.standard_normal(BLOCK).tolist()

    return start, RowsAsNeeded("the roll gust", numbers().__next__, 1)


def roll_gusts_before(params: RollGustParams, seed: int, steps: int) -> tuple[float, Rows]:
    """The same for a compiled flight of so many steps."""
    rng = np.random.default_rng([seed, 1])
    start = roll_gust_start(params, float(rng.standard_normal()))
    return start, rng.standard_normal(steps + 1).reshape(-1, 1)


class _Twister(threading.local):
    """One Mersenne twister for each thread: to make another takes as long as to draw thousands."""

    def __init__(self) -> None:
        self.state = np.random.RandomState()


_TWISTER: Final = _Twister()


def _words_of(seed: str) -> NDArray[np.uint32]:
    """What `random.Random(seed)` begins with: the string and its digest as one number, in words of
    which the lowest is first."""
    text = seed.encode()
    number = int.from_bytes(text + sha512(text).digest(), "big")
    words = (number.bit_length() + 31) // 32
    return np.frombuffer(number.to_bytes(4 * words, "little"), dtype="<u4")


def white_gauss(seed: str, count: int) -> FloatArray:
    """The first `count` numbers of `random.Random(seed).gauss(0, 1)`, shape (count,), to the bit.

    The standard library draws pairs by Box and Muller's method from a Mersenne twister, which
    numpy has too, and which both begin in the same way from 32-bit words.  To have Python begin it
    and hand over its state takes three times as long.
    """
    twister = _TWISTER.state
    twister.seed(_words_of(seed))
    uniform = twister.random_sample((-(-count // 2), 2))
    numbers = np.empty(uniform.size)
    _box_muller()(uniform, numbers)
    return numbers[:count]


@cache
def _box_muller() -> Any:
    """Compiled, or without numba slowly: the numbers are the same."""
    try:
        return kept(box_muller, (box_muller.__module__,))
    except ImportError:
        return box_muller
