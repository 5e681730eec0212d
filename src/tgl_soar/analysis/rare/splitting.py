"""Multilevel splitting with fixed effort: the probability of what plain flights never show.

A margin m says how far a state is from loss (m ≤ 0: lost).  Between levels m₁ > m₂ > … > m_K = 0 a
loss comes about in steps that are each not rare.  At rung k as many trajectories are begun as at
any other, each at a state, drawn evenly, in which one of the rung before first came to its level,
and with noise of its own from there on.  Of N_k trajectories S_k come to the next level before time
is over, and

    p̂ = Π_k S_k / N_k

is unbiased for whatever levels were set beforehand, however they were found.  (P. Glasserman,
P. Heidelberger, P. Shahabuddin, T. Zajic, Multilevel splitting for estimating rare event
probabilities, Operations Research 47 (1999); P. L'Ecuyer, V. Demers, B. Tuffin, Rare events,
splitting, and quasi-Monte Carlo, ACM TOMACS 17 (2007), for fixed effort.)  Levels come from pilot
trajectories, so that one in five passes each, near the e⁻² that costs least.

Trajectories of a ladder share ancestors: its rungs say little of its own variance.  So several
ladders are climbed with seeds of their own, and the scatter of their estimates gives the interval.
A loss stands for its ladder's estimate, divided among the losses of that ladder: where causes are
pooled, a ladder that hardly ever comes down has no more of a say than its estimate.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from functools import partial
from math import exp, inf, sqrt
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from tgl_soar.air.field import FloatArray
from tgl_soar.sim.campaign.executors import Executor
from tgl_soar.sim.campaign.run import fly_all

FRACTION: Final = 0.2  # of trajectories that pass a level of the pilot
RUNGS_MOST: Final = 40  # 0.2⁴⁰: rarer than anything that is asked for
LOST: Final = 0.0
_PILOT: Final = 1  # streams of a seed
_CLIMB: Final = 2
_PLAIN: Final = 3


class Passage(NamedTuple):
    """One trajectory, until it came to a level or time was over."""

    lowest: float  # margin
    state: Any  # the first at or below the level; None: it never came there
    cause: str  # of a loss; ""


class Process(Protocol):
    """What may be lost: it stands in states, and goes on from any with new noise."""

    def begun(self, seed: int) -> Any:
        """A state at the beginning."""
        ...

    def passage(self, state: Any, seed: int, level: float) -> Passage:
        """From a state on with the noise of a seed until its margin is at or below a level."""
        ...

    def shown(self, state: Any) -> FloatArray:
        """The last seconds before a state, (n, columns)."""
        ...


class Rung(NamedTuple):
    """One level of a ladder."""

    level: float
    tried: int
    passed: int


class Loss(NamedTuple):
    """One trajectory that came to the end of a ladder."""

    cause: str
    last: FloatArray  # what `Process.shown` shows of it


class Ladder(NamedTuple):
    """One estimate."""

    rungs: tuple[Rung, ...]
    losses: tuple[Loss, ...]

    @property
    def probability(self) -> float:
        """Of a loss before time is over."""
        product = 1.0
        for rung in self.rungs:
            product *= rung.passed / rung.tried
        return product

    @property
    def weight(self) -> float:
        """Of each of its losses: the probability that it stands for; 0: it has none."""
        return self.probability / len(self.losses) if self.losses else 0.0


class Cause(NamedTuple):
    """What some of the losses are lost by."""

    text: str
    losses: int
    fraction: float  # of the probability of a loss


class RareEstimate(NamedTuple):
    """Of several ladders."""

    probability: float
    low: float  # in which it lies, at 95 %
    high: float
    trajectories: int


class _Climb(NamedTuple):
    state: Any
    seed: int
    level: float


def pilot_levels(process: Process, effort: int, seed: int, executor: Executor) -> tuple[float, ...]:
    """Levels, the last of them 0, that about one trajectory in five passes each.

    effort: trajectories a level.  Errors: ValueError where the margin does not go down.
    """
    levels: list[float] = []
    draw = _stream(seed, _PILOT)
    states = _begun(effort, draw)
    while len(levels) < RUNGS_MOST:
        flown = _fly(process, states, -inf, draw, executor, effort)
        before = levels[-1] if levels else inf
        lower = sorted(each.lowest for each in flown if each.lowest < before)
        if not lower:
            raise ValueError(f"no trajectory comes below a margin of {before:g}: fly more of them")
        # One in five, or where fewer go on downwards, all of these.
        level = max(LOST, lower[min(len(lower), max(1, round(FRACTION * effort))) - 1])
        levels.append(level)
        if level <= LOST:
            return tuple(levels)
        passed = _fly(process, states, level, draw, executor, effort)
        states = [each.state for each in passed if each.state is not None] or states
    raise ValueError(f"after {RUNGS_MOST} levels a margin of {levels[-1]:g} is left")


def climb(
    process: Process,
    levels: Sequence[float],
    effort: int,
    seed: int,
    executor: Executor,
    *,
    ladder: int = 0,
) -> Ladder:
    """One ladder of so many trajectories a rung.

    ladder: its number; ladders of one seed share no random number, nor do those of two seeds.
    """
    draw = _stream(seed, _CLIMB, ladder)
    states = _begun(effort, draw)
    rungs: list[Rung] = []
    passed: list[Passage] = []
    for level in levels:
        flown = _fly(process, states, level, draw, executor, effort)
        passed = [each for each in flown if each.state is not None]
        rungs.append(Rung(level, effort, len(passed)))
        if not passed:
            break
        states = [each.state for each in passed]
    lost = passed if len(rungs) == len(levels) else []
    losses = tuple(Loss(each.cause, process.shown(each.state)) for each in lost)
    return Ladder(tuple(rungs), losses)


def estimated(ladders: Sequence[Ladder]) -> RareEstimate:
    """Their mean, and where it lies: the interval of a mean on a logarithmic scale, for the
    estimates scatter by a factor.

    Asked for 95 %, it holds the truth in 94 % where the ladders' logarithms have a standard
    deviation of 0.5, in 89 % at 1 and in 70 % at 2, by five ladders; what it misses lies above.

    Errors: ValueError for fewer than two ladders.
    """
    if len(ladders) < 2:
        raise ValueError(f"{len(ladders)} ladders: an interval needs two or more")
    from scipy.stats import t  # of the ground alone, and slow to import

    found = np.array([ladder.probability for ladder in ladders])
    trajectories = sum(rung.tried for ladder in ladders for rung in ladder.rungs)
    mean = float(found.mean())
    if mean == 0.0:
        return RareEstimate(0.0, 0.0, _never(ladders), trajectories)
    error = float(found.std(ddof=1)) / sqrt(len(found)) / mean
    factor = exp(float(t.ppf(0.975, len(found) - 1)) * error)
    return RareEstimate(mean, mean / factor, min(1.0, mean * factor), trajectories)


def pooled_causes(ladders: Sequence[Ladder]) -> list[Cause]:
    """What they are lost by, the most probable first; each loss by its ladder's own estimate."""
    counts: defaultdict[str, int] = defaultdict(int)
    weights: defaultdict[str, float] = defaultdict(float)
    for ladder in ladders:
        for loss in ladder.losses:
            counts[loss.cause] += 1
            weights[loss.cause] += ladder.weight
    whole = sum(ladder.probability for ladder in ladders)
    found = [Cause(text, counts[text], weight / whole) for text, weight in weights.items()]
    return sorted(found, key=lambda cause: cause.fraction, reverse=True)


def plain_seeds(flights: int, seed: int) -> range:
    """Of plain flights; two runs' begin so far apart that they share none.

    2⁶² places to begin at: of two runs of 10⁸ flights, one pair in 2 · 10¹⁰ overlaps.
    """
    first = int(_stream(seed, _PLAIN).integers(2**62))
    return range(first, first + flights)


def _stream(seed: int, *key: int) -> np.random.Generator:
    """Random numbers of one part of a run: hashed, so that neighbouring seeds share no part."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))


def _never(ladders: Sequence[Ladder]) -> float:
    """Where no ladder came to its end: had three trajectories more passed where it broke off."""
    found = 0.0
    for ladder in ladders:
        product = 1.0
        for rung in ladder.rungs:
            product *= (rung.passed or 3) / rung.tried
        found = max(found, product)
    return found


def _begun(effort: int, draw: np.random.Generator) -> list[Any]:
    """States at the beginning, as seeds: each is begun where it is flown."""
    return [_Begin(int(seed)) for seed in draw.integers(2**31, size=effort)]


class _Begin(NamedTuple):
    seed: int


def _fly(
    process: Process,
    states: Sequence[Any],
    level: float,
    draw: np.random.Generator,
    executor: Executor,
    effort: int,
) -> list[Passage]:
    """So many trajectories from states drawn evenly; at the beginning from each once."""
    at_start = isinstance(states[0], _Begin)
    picks = range(effort) if at_start else draw.integers(len(states), size=effort).tolist()
    seeds = draw.integers(2**31, size=effort).tolist()
    jobs = [_Climb(states[pick], seed, level) for pick, seed in zip(picks, seeds, strict=True)]
    return fly_all(partial(_pass, process), jobs, executor, first_here=True)


def _pass(process: Process, job: _Climb) -> Passage:
    state = process.begun(job.state.seed) if isinstance(job.state, _Begin) else job.state
    return process.passage(state, job.seed, job.level)
