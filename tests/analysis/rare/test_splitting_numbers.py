"""Multilevel splitting with a script for trajectories: which levels are found, from where each
trajectory goes on, and what is made of the counts."""

from __future__ import annotations

from math import exp, inf, sqrt
from typing import Any

import numpy as np
import pytest
from scipy.stats import t as student

from tgl_soar.analysis.rare.splitting import (
    RUNGS_MOST,
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
from tgl_soar.sim.campaign.executors import InLine

HERE = InLine()
NOTHING = np.zeros((0, 1))


class Scripted:
    """Each rung's trajectories come down to what is written, one after the other."""

    def __init__(self, *rungs: list[float]) -> None:
        self.left = [lowest for rung in rungs for lowest in rung]
        self.asked: list[tuple[Any, float]] = []
        self.begun_with: list[int] = []
        self.seeds: list[int] = []

    def begun(self, seed: int) -> Any:
        self.begun_with.append(seed)
        return "begin"

    def passage(self, state: Any, seed: int, level: float) -> Passage:
        self.asked.append((state, level))
        self.seeds.append(seed)
        lowest = self.left.pop(0)
        reached = lowest <= level
        return Passage(lowest, f"at {lowest}" if reached else None, "ground" if lowest <= 0 else "")

    def shown(self, state: Any) -> Any:
        return np.array([[float(str(state).split()[-1])]])


# --- levels ---------------------------------------------------------------------------------------

HIGH = [5.0, 9.0, 4.0, 8.0, 7.0, 6.0, 3.5, 7.5, 8.5, 9.5]


def test_a_level_is_where_one_of_five_passes_and_the_last_is_a_loss() -> None:
    """Of ten the second lowest; both are flown again to it, and others go on from there."""
    process = Scripted(HIGH, HIGH, [-1.0, 2.0, 0.0, *[6.0] * 7])
    assert pilot_levels(process, 10, 1, HERE) == (4.0, 0.0)
    assert [level for _, level in process.asked] == [-inf] * 10 + [4.0] * 10 + [-inf] * 10
    assert {state for state, _ in process.asked[:20]} == {"begin"}
    assert {state for state, _ in process.asked[20:]} <= {"at 4.0", "at 3.5"}
    # The beginnings of the pilot are each flown once.
    assert len({*process.begun_with[:10]}) == 10
    assert process.begun_with[:10] == process.begun_with[10:20]
    assert len({*process.seeds}) == 30


def test_where_fewer_go_on_downwards_the_last_of_these_is_the_level() -> None:
    """Beside levels that are passed already they do not count: one of ten comes below 4."""
    rung = [3.0, *[4.0] * 9]
    process = Scripted(HIGH, HIGH, rung, rung, [-1.0] * 10)
    assert pilot_levels(process, 10, 1, HERE) == (4.0, 3.0, 0.0)


def test_a_margin_that_does_not_go_down_has_no_levels() -> None:
    with pytest.raises(ValueError, match=r"no trajectory comes below a margin of 4: fly more"):
        pilot_levels(Scripted(HIGH, HIGH, [4.0] * 10), 10, 1, HERE)
    with pytest.raises(ValueError, match="no trajectory comes below a margin of inf"):
        pilot_levels(Scripted([inf] * 10), 10, 1, HERE)


def test_after_forty_levels_it_is_given_up() -> None:
    rungs = [[100.0 - n] * 5 for n in range(RUNGS_MOST) for _ in range(2)]
    with pytest.raises(ValueError, match="after 40 levels a margin of 61 is left"):
        pilot_levels(Scripted(*rungs), 5, 1, HERE)


def test_one_trajectory_is_enough_for_a_level() -> None:
    """A fifth of two is less than one."""
    process = Scripted([3.0, 2.0], [3.0, 2.0], [-1.0, 1.0])
    assert pilot_levels(process, 2, 1, HERE) == (2.0, 0.0)


# --- ladders --------------------------------------------------------------------------------------


def test_a_ladder_counts_at_each_level_and_shows_its_losses() -> None:
    process = Scripted([5.0, 2.0, 1.0, 6.0], [3.0, -1.0, 0.0, 7.0])
    found = climb(process, (2.0, 0.0), 4, 1, HERE)
    assert found.rungs == (Rung(2.0, 4, 2), Rung(0.0, 4, 2))
    assert [(loss.cause, loss.last.tolist()) for loss in found.losses] == [
        ("ground", [[-1.0]]),
        ("ground", [[0.0]]),
    ]
    assert {state for state, _ in process.asked[4:]} <= {"at 2.0", "at 1.0"}
    assert [level for _, level in process.asked] == [2.0] * 4 + [0.0] * 4
    assert found.probability == 0.25
    assert found.weight == 0.125


def test_a_ladder_that_breaks_off_has_no_losses() -> None:
    found = climb(Scripted([5.0, 2.0], [3.0, 4.0]), (2.0, 1.0, 0.0), 2, 1, HERE)
    assert found.rungs == (Rung(2.0, 2, 1), Rung(1.0, 2, 0))
    assert found.losses == ()
    assert found.probability == found.weight == 0.0
    # Short of its end by one rung, what passed is no loss.
    short = climb(Scripted([1.0, 2.0]), (2.0,), 2, 1, HERE)
    assert len(short.losses) == 2


def test_ladders_of_one_seed_share_no_number_and_are_the_same_again() -> None:
    def seeds(seed: int, ladder: int) -> list[int]:
        process = Scripted([1.0] * 6)
        climb(process, (2.0,), 6, seed, HERE, ladder=ladder)
        return [*process.begun_with, *process.seeds]

    assert seeds(1, 0) == seeds(1, 0)
    whole = [*seeds(1, 0), *seeds(1, 1), *seeds(2, 0)]
    assert len({*whole}) == len(whole)


def test_plain_flights_have_seeds_in_a_row_from_a_place_of_their_own() -> None:
    one, other = plain_seeds(1000, 1), plain_seeds(1000, 2)
    assert (len(one), one.step) == (1000, 1)
    assert plain_seeds(10, 1) == one[:10]
    assert abs(one.start - other.start) > 1000
    assert 0 <= one.start < 2**62


# --- estimates ------------------------------------------------------------------------------------


def ladder(passed: int, *losses: str, tried: int = 10) -> Ladder:
    """A tenth passes the first rung."""
    rungs = (Rung(1.0, 10, 1), Rung(0.0, tried, passed))
    return Ladder(rungs, tuple(Loss(cause, NOTHING) for cause in losses))


def test_the_interval_is_students_on_a_logarithmic_scale() -> None:
    found = estimated([ladder(1), ladder(2), ladder(6)])
    values = np.array([0.01, 0.02, 0.06])
    mean = values.mean()
    error = sqrt(((values - mean) ** 2).sum() / 2.0 / 3.0) / mean
    factor = exp(student.ppf(0.975, 2) * error)
    assert found.probability == pytest.approx(0.03)
    assert (found.low, found.high) == pytest.approx((0.03 / factor, 0.03 * factor))
    assert found.trajectories == 60
    assert estimated([ladder(1), ladder(20)]).high == 1.0  # nothing is likelier


def test_without_a_loss_it_is_below_what_three_more_would_have_made_of_it() -> None:
    """Three where it broke off; of several ladders the greatest."""
    broken = Ladder((Rung(1.0, 10, 5), Rung(0.0, 10, 0)), ())
    first = Ladder((Rung(1.0, 100, 0),), ())
    found = estimated([broken, first])
    assert (found.probability, found.low) == (0.0, 0.0)
    assert found.high == pytest.approx(0.5 * 0.3)
    assert estimated([first, first]).high == pytest.approx(0.03)
    assert found.trajectories == 120


def test_one_ladder_has_no_interval() -> None:
    with pytest.raises(ValueError, match="1 ladders: an interval needs two or more"):
        estimated([ladder(1)])
    assert estimated([ladder(1), ladder(1)]).high == pytest.approx(0.01)


def test_a_cause_counts_by_its_ladders_estimate() -> None:
    """0.02 in two losses, and 0.06 in three."""
    found = pooled_causes([ladder(2, "ground", "fence"), ladder(6, "fence", "fence", "stall")])
    assert [cause[:2] for cause in found] == [("fence", 3), ("stall", 1), ("ground", 1)]
    fractions = [cause.fraction for cause in found]
    assert fractions == pytest.approx([0.05 / 0.08, 0.02 / 0.08, 0.01 / 0.08])
    assert pooled_causes([ladder(0)]) == []
