"""Splitting against what is known exactly: a process whose noise decorrelates at a rate."""

from __future__ import annotations

from math import exp, inf, pi, sqrt
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.special import erfc

from tgl_soar.analysis.rare.kramers import cliff_rate, smooth_rate, well_exits
from tgl_soar.analysis.rare.splitting import (
    Ladder,
    Loss,
    Passage,
    Rung,
    climb,
    estimated,
    pilot_levels,
    plain_seeds,
    pooled_causes,
)
from tgl_soar.sim.aircraft import Wind
from tgl_soar.sim.campaign.executors import InLine, LocalProcesses
from tgl_soar.types import GlidePolar, polar_sink

Floats = NDArray[np.float64]
STEPS = 400
KEEPS = 0.95  # x' = KEEPS x + √(1 − KEEPS²) noise: variance 1


class At(NamedTuple):
    """Where it is."""

    step: int
    x: float


class Forgetful:
    """An Ornstein–Uhlenbeck process in steps; lost above an edge, and its margin the way there."""

    def __init__(self, edge: float) -> None:
        self.edge = edge

    def begun(self, seed: int) -> At:
        return At(0, float(np.random.default_rng((seed, 7)).standard_normal()))

    def passage(self, state: At, seed: int, level: float) -> Passage:
        x = self.path(state, seed)
        margin = self.edge - x
        there = np.flatnonzero(margin <= level)
        if not there.size:
            return Passage(float(margin.min()), None, "")
        first = int(there[0])
        lost = margin[first] <= 0.0
        lowest = float(margin[: first + 1].min())
        return Passage(lowest, At(state.step + first, float(x[first])), "over" if lost else "")

    def shown(self, state: At) -> Floats:
        return np.array([[state.x]])

    def path(self, state: At, seed: int) -> Floats:
        noise = np.random.default_rng(seed).standard_normal(STEPS - state.step)
        moved, _ = lfilter(
            [sqrt(1.0 - KEEPS**2)], [1.0, -KEEPS], noise, zi=np.array([KEEPS * state.x])
        )
        return np.concatenate([[state.x], moved])


def exactly(edge: float) -> float:
    """The probability, by the density of those that are not lost, step by step, on a grid."""
    x, dx = np.linspace(-8.0, edge, 1201, retstep=True)
    weight = np.full(len(x), dx)
    weight[[0, -1]] *= 0.5
    scatter = sqrt(1.0 - KEEPS**2)
    mean = KEEPS * x
    kernel = np.exp(-0.5 * ((x[:, None] - mean) / scatter) ** 2) / (scatter * sqrt(2.0 * pi))
    over = 0.5 * erfc((edge - mean) / (scatter * sqrt(2.0)))
    density = np.exp(-0.5 * x**2) / sqrt(2.0 * pi)
    lost = float(0.5 * erfc(edge / sqrt(2.0)))
    for _ in range(STEPS):
        lost += float(np.sum(over * density * weight))
        density = kernel @ (density * weight)
    return lost


def ladders_of(process: Forgetful, effort: int, count: int) -> list[Ladder]:
    levels = pilot_levels(process, effort, 1, InLine())
    return [climb(process, levels, effort, seed, InLine()) for seed in range(2, 2 + count)]


def test_plain_flights_splitting_and_the_exact_value_agree_where_all_three_reach() -> None:
    edge = 4.4
    exact = exactly(edge)
    assert 3e-4 < exact < 3e-3
    process = Forgetful(edge)
    flights = 20_000
    rng = np.random.default_rng(3)
    x = rng.standard_normal(flights)
    lost = x >= edge
    for _ in range(STEPS):
        x = KEEPS * x + sqrt(1.0 - KEEPS**2) * rng.standard_normal(flights)
        lost |= x >= edge
    # Four standard deviations of a count: one test in 15,000 fails by chance; the seed is fixed.
    assert abs(lost.sum() - flights * exact) < 4.0 * sqrt(flights * exact)
    found = estimated(ladders_of(process, 200, 12))
    assert found.low < exact < found.high
    assert found.high / found.low < 3.0


def test_one_in_ten_million_is_found_with_some_thousand_trajectories() -> None:
    edge = 5.9
    exact = exactly(edge)
    assert 1e-8 < exact < 1e-6
    ladders = ladders_of(Forgetful(edge), 200, 12)
    found = estimated(ladders)
    assert found.low < exact < found.high
    assert found.trajectories < 40_000
    assert all(loss.cause == "over" for ladder in ladders for loss in ladder.losses)


def test_theory_stands_beside_it() -> None:
    """First passage over a cliff, for steps that are short: between two of them x may be past the
    edge, which is as an edge 0.5826 of a step's scatter further off (Siegmund)."""
    edge = 5.9
    rate = -np.log(KEEPS)  # per step
    further = edge + 0.5826 * sqrt(2.0 * rate)
    theory = STEPS * cliff_rate(rate, 0.5 * rate * further**2, rate)
    assert theory == pytest.approx(exactly(edge), rel=0.15)
    # The two rates for one barrier: of a parabolic rim, of a cliff.
    assert smooth_rate(2.0, 3.0, 5.0, 1.0) == pytest.approx(sqrt(6.0) / (2.0 * pi) * exp(-5.0))


def test_a_ladder_is_the_same_whoever_climbs_it() -> None:
    process = Forgetful(3.0)
    levels = pilot_levels(process, 40, 1, InLine())
    assert levels == pilot_levels(process, 40, 1, LocalProcesses(2))
    assert climb(process, levels, 40, 5, InLine()) == climb(
        process, levels, 40, 5, LocalProcesses(2)
    )


def test_each_loss_weighs_as_much_as_its_ladder() -> None:
    """Ladders of 0.2 and of 0.001: the hundred losses of the second are of little account."""
    last = np.zeros((1, 1))
    often = Ladder((Rung(0.0, 10, 2),), (Loss("floor", last), Loss("board", last)))
    seldom = Ladder((Rung(1.0, 1000, 2), Rung(0.0, 200, 100)), (Loss("board", last),) * 100)
    assert seldom.probability == pytest.approx(0.001)
    board, floor = pooled_causes([often, seldom])
    assert (board.text, board.losses, floor.text, floor.losses) == ("board", 101, "floor", 1)
    assert board.fraction == pytest.approx(0.101 / 0.201)
    assert floor.fraction == pytest.approx(0.1 / 0.201)
    assert pooled_causes([Ladder((Rung(1.0, 10, 0),), ())]) == []


def test_ladders_and_plain_flights_of_two_seeds_are_strangers() -> None:
    process = Forgetful(3.0)
    levels = pilot_levels(process, 40, 1, InLine())
    climbed = [
        climb(process, levels, 40, seed, InLine(), ladder=n) for seed in (1, 2) for n in range(3)
    ]
    assert all(climbed.count(ladder) == 1 for ladder in climbed)
    ours, theirs = plain_seeds(10**8, 1), plain_seeds(10**8, 2)
    assert len(ours) == 10**8
    assert ours == plain_seeds(10**8, 1)
    assert ours[-1] < theirs[0] or theirs[-1] < ours[0]


def test_what_never_happens_has_an_upper_bound() -> None:
    broken = Ladder((Rung(2.0, 100, 20), Rung(1.0, 100, 0)), ())
    found = estimated([broken, broken])
    assert (found.probability, found.low) == (0.0, 0.0)
    assert found.high == pytest.approx(0.2 * 0.03)
    with pytest.raises(ValueError, match="1 ladders: an interval needs two"):
        estimated([broken])


class Safe:
    """Nothing ever brings it nearer than it is."""

    def begun(self, seed: int) -> float:
        del seed
        return 1.0

    def passage(self, state: float, seed: int, level: float) -> Passage:
        del seed
        return Passage(state, state if state <= level else None, "")

    def shown(self, state: float) -> Floats:
        return np.array([[state]])


def test_a_margin_that_does_not_go_down_is_reported() -> None:
    with pytest.raises(ValueError, match="no trajectory comes below a margin of 1"):
        pilot_levels(Safe(), 10, 1, InLine())
    assert inf > pilot_levels(Forgetful(1.0), 50, 1, InLine())[0] >= 0.0


class FadingAir:
    """Updraft that fades upwards, in wind that is slower below: u = 8.5 + z, w = sink(8.5) − z."""

    def __init__(self, polar: GlidePolar) -> None:
        self.sink_mps = polar_sink(polar, 8.5)

    def wind_at(self, x_m: float, y_m: float, z_m: float, time_s: float) -> Wind:  # noqa: ARG002
        return 8.5 + z_m, 0.0, self.sink_mps - z_m

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:  # noqa: ARG002
        return True


def test_a_well_ends_where_the_polar_does() -> None:
    """0.5 m below, where the wind is 8 m/s: cut off there, and never left at an infinite rate."""
    polar = GlidePolar(c0=1.3, c1=0.0, c2=0.0, c3=0.0, speed_min_mps=8.0, speed_max_mps=12.0)
    upright = 0.5 * pi
    field: Any = FadingAir(polar)
    low, high = well_exits(field, polar, (0.0, 0.0), upright, (0.4, 0.2), lambda _x, z: z < 1.0)
    assert low.s_m == pytest.approx(-0.5, abs=0.02)
    assert not low.smooth
    # E = −s: ΔV = s² / 2, λ = 1, D = σ² τ / 2.
    assert low.barrier == pytest.approx(0.125, rel=0.05)
    assert low.rate_per_s == pytest.approx(cliff_rate(1.0, low.barrier, 0.016), rel=0.01)
    assert high.s_m == pytest.approx(1.0, abs=0.02)
