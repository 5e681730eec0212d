"""The sums of a brake's shake: blocks by complex numbers, their judgement by least squares, and
each of its limits from both sides."""

from __future__ import annotations

from cmath import exp as cexp
from cmath import phase
from math import cos, pi, sin, sqrt
from random import Random
from typing import Any

import pytest

from tgl_soar.control.brake_shake import (
    NOT_SHAKEN,
    ShakeState,
    _block_taken,
    _judged,
    shake_step,
)
from tgl_soar.control.brake_watch import ACTS, DOES_NOT, NOTHING

DT_S = 0.0078125  # 128 steps a second, without rounding
LIFTS_MPS2 = -2.0
GAIN = 0.88
ON: ShakeState = NOT_SHAKEN._replace(on=True, pressed=1.0, climb_mps=0.0)


def step(state: ShakeState, **changed: Any) -> ShakeState:
    given = {"saturated": 1, "asked": 0.5, "brake": 0.5, "climb_mps": 0.0}
    given |= {"lifts_mps2": LIFTS_MPS2, "dt_s": DT_S}
    return shake_step(state, **{**given, **changed})


# --- when it is shaken --------------------------------------------------------------------------


def test_it_begins_after_three_and_a_half_seconds_at_an_end() -> None:
    """A fraction that comes up by 1 - exp(-t / 10 s): three tenths after 3.57 s."""
    state, time_s = NOT_SHAKEN, 0.0
    while not state.on:
        state, time_s = step(state), time_s + DT_S
        assert time_s < 5.0
        assert state.pressed == pytest.approx(1.0 - float(cexp(-time_s / 10.0).real), abs=1e-3)
    assert time_s == pytest.approx(3.57, abs=0.02)
    assert (state.climb_mps, state.shaken) == (0.0, 0.0)


def test_either_end_presses_and_the_middle_does_not_shaken_or_not() -> None:
    for state in (NOT_SHAKEN, ON._replace(pressed=0.0)):
        for end in (-1, 1):
            assert step(state, saturated=end).pressed == pytest.approx(DT_S / (10.0 + DT_S))
        let = step(state._replace(pressed=0.2), saturated=0).pressed
        assert let == pytest.approx(0.2 * 10.0 / (10.0 + DT_S))


def test_while_it_rests_it_is_not_shaken_and_what_was_found_stands() -> None:
    state = NOT_SHAKEN._replace(pressed=1.0, rest_s=2.5 * DT_S, found=ACTS)
    for left in (1.5, 0.5):
        state = step(state, climb_mps=left)
        assert (state.on, state.found, state.climb_mps) == (False, ACTS, left)
        assert state.rest_s == pytest.approx(left * DT_S)
    state = step(state)
    assert (state.on, state.found, state.rest_s) == (True, NOTHING, 0.0)
    idle = step(NOT_SHAKEN._replace(found=ACTS))
    assert (idle.on, idle.found) == (False, ACTS)


# --- a block ------------------------------------------------------------------------------------


def test_a_shake_is_a_fifth_of_the_travel_four_times_a_second() -> None:
    state = ON
    for n in range(128):
        state = step(state)
        assert state.shaken == pytest.approx(0.2 * sin(8.0 * pi * n * DT_S), abs=1e-12)


@pytest.mark.parametrize(("asked", "least", "most"), [(0.9, -0.2, 0.1), (0.05, -0.05, 0.2)])
def test_it_goes_no_further_than_the_brake(asked: float, least: float, most: float) -> None:
    state, shaken = ON, []
    for _ in range(64):
        state = step(state, asked=asked)
        shaken.append(state.shaken)
    assert (min(shaken), max(shaken)) == pytest.approx((least, most))


def test_a_block_is_a_second_of_products_with_sine_and_cosine() -> None:
    """B = 2 <b (sin φ + i cos φ)>, and Y of the accelerations less their mean."""
    random = Random(4)
    state, climb = ON, 0.0
    turns, brakes, rises = [], [], []
    for n in range(128):
        assert state.blocks == 0.0
        brake, rise = random.random(), random.gauss(0.3, 1.0)
        climb += rise * DT_S
        angle = 8.0 * pi * n * DT_S
        turns.append(complex(sin(angle), cos(angle)))
        brakes.append(brake)
        rises.append(rise / (LIFTS_MPS2 * GAIN))
        state = step(state, brake=brake, climb_mps=climb)
    mean = sum(rises) / 128.0
    b = 2.0 * sum(x * turn for x, turn in zip(brakes, turns, strict=True)) / 128.0
    y = 2.0 * sum((x - mean) * turn for x, turn in zip(rises, turns, strict=True)) / 128.0
    assert complex(state.b_re, state.b_im) == pytest.approx(b)
    assert complex(state.y_re, state.y_im) == pytest.approx(y)
    assert state.b_2 == pytest.approx(abs(b) ** 2)
    assert state.y_2 == pytest.approx(abs(y) ** 2)
    assert complex(state.yb_re, state.yb_im) == pytest.approx(y * b.conjugate())
    assert state.blocks == 1.0
    reset = (state.time_s, state.ticks, state.sines, state.cosines, state.rise)
    assert reset == (0.0,) * 5
    assert (state.rise_sin, state.rise_cos, state.brake_sin, state.brake_cos) == (0.0,) * 4


@pytest.mark.parametrize(("ticks", "counts"), [(31.0, False), (32.0, True), (33.0, True)])
def test_a_block_of_less_than_eight_ticks_a_period_does_not_count(
    ticks: float, counts: bool
) -> None:
    filled = ON._replace(
        time_s=1.0, ticks=ticks, sines=1.0, cosines=2.0, rise=3.0, rise_sin=4.0, rise_cos=5.0,
        brake_sin=6.0, brake_cos=7.0, blocks=3.0, b_re=1.0, b_im=2.0, y_re=3.0, y_im=4.0,
        b_2=5.0, y_2=6.0, yb_re=7.0, yb_im=8.0,
    )  # fmt: skip
    taken = _block_taken(filled)
    assert taken.blocks == 3.0 + counts
    assert (taken.time_s, taken.ticks, taken.brake_cos) == (0.0, 0.0, 0.0)
    more = 2.0 / ticks if counts else 0.0
    assert (taken.b_re, taken.b_im) == pytest.approx((1.0 + 6.0 * more, 2.0 + 7.0 * more))
    own = (3.0 + more * (4.0 - 3.0 / ticks), 4.0 + more * (5.0 - 2.0 * 3.0 / ticks))
    assert (taken.y_re, taken.y_im) == pytest.approx(own)
    if not counts:
        assert (taken.b_2, taken.y_2, taken.yb_re, taken.yb_im) == (5.0, 6.0, 7.0, 8.0)


# --- its judgement ------------------------------------------------------------------------------


def summed(pairs: list[tuple[complex, complex]], blocks: float | None = None) -> ShakeState:
    """The sums of some blocks (B, Y)."""
    b = sum((b for b, _ in pairs), 0j)
    y = sum((y for _, y in pairs), 0j)
    both = sum((y * b.conjugate() for b, y in pairs), 0j)
    return ON._replace(
        blocks=float(len(pairs)) if blocks is None else blocks,
        b_re=b.real, b_im=b.imag, y_re=y.real, y_im=y.imag,
        b_2=sum(abs(b) ** 2 for b, _ in pairs), y_2=sum(abs(y) ** 2 for _, y in pairs),
        yb_re=both.real, yb_im=both.imag,
    )  # fmt: skip


def scattered(answer: complex, noise: float, count: int = 16) -> list[tuple[complex, complex]]:
    random = Random(2)
    pairs = []
    for _ in range(count):
        b = complex(0.2 + random.gauss(0.0, 0.02), random.gauss(0.0, 0.02))
        gust = complex(random.gauss(0.0, noise), random.gauss(0.0, noise))
        pairs.append((b, answer * b + gust))
    return pairs


@pytest.mark.parametrize("lag_rad", [0.3, 0.8, 1.2])
@pytest.mark.parametrize("noise", [0.3, 0.5])
def test_an_answer_is_judged_by_its_size_and_what_is_left_by_its_variance(
    lag_rad: float, noise: float
) -> None:
    pairs = scattered(0.7 * cexp(-1j * lag_rad), noise)
    b, y = sum(b for b, _ in pairs), sum(y for _, y in pairs)
    r = y / b
    variance = sum(abs(y - r * b) ** 2 for b, y in pairs) / (2.0 * abs(b) ** 2)
    lag = max(0.2, min(1.3, -phase(r)))
    state = _judged(summed(pairs))
    assert state.q == pytest.approx((r * cexp(1j * lag)).real)
    assert state.sigma == pytest.approx(sqrt(variance))
    assert state.on  # it is not known well enough


@pytest.mark.parametrize(
    ("lag_rad", "q"),
    [(0.5, 1.0), (0.2, 1.0), (1.3, 1.0), (0.0, cos(0.2)), (1.6, cos(0.3)), (-0.6, cos(0.8))],
)
def test_beyond_the_lags_that_may_be_the_rest_of_the_turn_costs(lag_rad: float, q: float) -> None:
    state = _judged(summed([(0.2 + 0.05j, (0.2 + 0.05j) * cexp(-1j * lag_rad))] * 16))
    assert state.q == pytest.approx(q)
    assert (state.sigma, state.found) == (0.02, ACTS)
    assert (state.on, state.rest_s, state.blocks) == (False, 20.0, 0.0)


@pytest.mark.parametrize(
    ("size", "found"), [(0.471, ACTS), (0.469, NOTHING), (0.331, NOTHING), (0.329, DOES_NOT)]
)
def test_what_is_certain_is_known_within_two_hundredths(size: float, found: int) -> None:
    """3.5 deviations beside 0.4."""
    state = _judged(summed([(0.2 + 0j, 0.2 * size * cexp(-0.7j))] * 16))
    assert (state.found, state.on) == (found, found == NOTHING)


@pytest.mark.parametrize(
    ("blocks", "judged", "ended"), [(15.0, False, False), (16.0, True, False),
                                    (149.0, True, False), (150.0, True, True)],
)  # fmt: skip
def test_it_is_judged_from_sixteen_blocks_on_and_ends_with_a_hundred_and_fifty(
    blocks: float, judged: bool, ended: bool
) -> None:
    state = _judged(summed([(0.2 + 0j, 0.08 * cexp(-0.7j))] * 16, blocks))
    assert (state.q == state.q) is judged
    assert state.on is not ended
    assert state.found == NOTHING
    assert state.rest_s == (20.0 if ended else 0.0)


def test_without_any_shake_in_the_brake_nothing_is_judged() -> None:
    unshaken = summed([(0j, 1.0 + 0j)] * 16)
    assert _judged(unshaken) == unshaken
