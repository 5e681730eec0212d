"""Scores of a search at each limit, from both sides, of flights that are made up."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, isnan

import numpy as np
import pytest
from numpy.typing import NDArray

from tgl_soar.analysis.search.episode import Episode
from tgl_soar.analysis.search.places import place
from tgl_soar.analysis.search.scoring import (
    Score,
    fraction_text,
    interval,
    mean_climb,
    score,
    settling_s,
)
from tgl_soar.control.supervisor import REASON_NOT_FOUND
from tgl_soar.control.supervisor_texts import REASON_TEXTS

HILL = place("hill", 3)
DURATION_S = 90.0
STEP_S = 0.1
LANDING_M = 1.5

Floats = NDArray[np.float64]


def level(time_s: Floats) -> Floats:
    return np.full_like(time_s, 20.0)


def scored(
    height: Callable[[Floats], Floats] = level,
    *,
    x_m: float = -5.0,
    flown_s: float = DURATION_S,
    ended: str = "",
    given_up: str = "",
    claims: list[tuple[float, bool]] | None = None,
    height_left_m: float = 5.0,
) -> Score:
    time = STEP_S * np.arange(float(round(flown_s / STEP_S)))
    return score(
        Episode(
            place=HILL,
            searcher="somebody",
            ended=ended,
            given_up=given_up,
            flown_s=flown_s,
            path={"time_s": time, "x_m": np.full_like(time, x_m), "z_m": height(time)},
            claims=claims or [],
            height_left_m=height_left_m,
            landing_m=LANDING_M,
        )
    )


def test_what_a_place_is_stands_in_its_score() -> None:
    found = scored()
    assert (found.kind, found.seed, found.words) == ("hill", 3, HILL.words)
    assert (found.change, found.searcher, found.ended) == (HILL.change, "somebody", "")
    assert found.begins == pytest.approx(20.0 / HILL.box.z_max_m)
    assert found.duration_s == found.flown_s == DURATION_S


# --- soaring and settling -----------------------------------------------------------------------


@pytest.mark.parametrize(("climb_mps", "soared"), [(-0.059, True), (-0.061, False), (0.5, True)])
def test_it_soared_whose_last_quarter_sinks_by_less_than_six_centimetres_a_second(
    climb_mps: float, soared: bool
) -> None:
    """Of the ninety seconds that were planned, from 67.5 s on, whatever was before."""
    last = DURATION_S - STEP_S - 22.5

    def height(t: Floats) -> Floats:
        return 60.0 - 0.4 * np.minimum(t, last) + climb_mps * np.maximum(0.0, t - last)

    assert scored(height).soared == soared


def test_the_mean_climb_is_that_of_the_last_seconds() -> None:
    time = STEP_S * np.arange(101.0)
    z = np.where(time < 6.0, 0.0, 2.0 * (time - 6.0))
    assert mean_climb(time, z, 4.05) == pytest.approx(2.0, rel=0.03)
    assert mean_climb(time, z, 8.05) == pytest.approx(1.0, rel=0.03)
    assert mean_climb(time, z, 0.15) == pytest.approx(2.0)
    assert mean_climb(time, z, 0.05) == -inf
    assert mean_climb(time[:1], z[:1], 9.0) == -inf


@pytest.mark.parametrize(("sink_mps", "since"), [(0.099, 0.0), (0.101, inf), (-0.101, inf)])
def test_settled_is_a_tenth_of_a_metre_a_second_up_or_down(sink_mps: float, since: float) -> None:
    time = STEP_S * np.arange(200.0)
    assert settling_s(time, 20.0 - sink_mps * time) == since


@pytest.mark.parametrize(("calm_s", "settles"), [(4.7, False), (5.3, True)])
def test_settled_is_calm_for_five_seconds(calm_s: float, settles: bool) -> None:
    """By means over two seconds: a fall of 20 m/s ends the calm within a hundredth of one."""
    time = STEP_S * np.arange(300.0)
    z = 20.0 * np.abs(np.minimum(0.0, time - 8.0)) + 20.0 * np.maximum(0.0, time - 8.0 - calm_s)
    found = settling_s(time, z)
    assert (found == pytest.approx(8.0, abs=0.11)) if settles else found == inf


def test_it_settles_when_its_two_seconds_mean_is_small() -> None:
    """Sinking by 0.4 m/s until 10 s: over two seconds 0.2 m are left from 9.5 s on."""
    time = STEP_S * np.arange(300.0)
    z = 20.0 - 0.4 * np.minimum(time, 10.0)
    assert settling_s(time, z) == pytest.approx(9.55, abs=0.06)
    assert scored(lambda t: 20.0 - 0.4 * np.minimum(t, 10.0)).settled_s == settling_s(time, z)
    assert scored(lambda t: 20.0 - 0.2 * t).settled_s == inf
    assert settling_s(time[:1], z[:1]) == inf
    coarse = 2.5 * np.arange(10.0)  # a mean over one step is the least
    assert settling_s(coarse, np.full(10, 3.0)) == 0.0


# --- claims -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("withdrawn_s", "false"), [(26.9, False), (27.1, True), (30.0, True)])
def test_a_claim_withdrawn_in_the_last_three_seconds_was_false(
    withdrawn_s: float, false: bool
) -> None:
    claims = [(10.0, True), (withdrawn_s, False)]
    found = scored(flown_s=30.0, ended="hit the ground", claims=claims)
    assert found.false_claim == false
    assert found.claimed_s == 10.0
    assert found.found_s == inf


def test_found_is_since_the_last_claim_that_stands_to_the_end() -> None:
    again = [(5.0, True), (9.0, False), (12.0, True)]
    assert scored(claims=again).found_s == 12.0
    assert scored(claims=again).claimed_s == 5.0
    assert scored(claims=again[:2]).found_s == inf
    assert scored(claims=again[:2]).claimed_s == 5.0
    assert scored().claimed_s == inf
    assert scored(lambda t: 60.0 - 0.2 * t, claims=again).found_s == inf


# --- how it ended -------------------------------------------------------------------------------


def test_the_ticks_own_forecast_gives_up_too() -> None:
    nowhere = REASON_TEXTS[REASON_NOT_FOUND]
    found = scored(flown_s=30.0, ended=f"disengaged: {nowhere}")
    assert (found.given_up, found.ended, found.in_time) == (nowhere, "", True)
    other = scored(flown_s=30.0, ended="disengaged: upset")
    assert (other.given_up, other.ended, other.in_time) == ("", "disengaged: upset", False)


@pytest.mark.parametrize(("left_m", "above"), [(LANDING_M, True), (LANDING_M - 0.01, False)])
def test_in_time_and_aloft_are_at_the_height_that_landing_needs_or_above(
    left_m: float, above: bool
) -> None:
    gave = scored(flown_s=30.0, given_up="too low", height_left_m=left_m)
    assert (gave.in_time, gave.aloft, gave.given_up) == (above, False, "too low")
    flew = scored(height_left_m=left_m)
    assert (flew.in_time, flew.aloft) == (False, above)
    assert not scored(flown_s=30.0, ended="hit the ground", height_left_m=left_m).aloft


def test_the_height_lost_is_down_to_the_lowest_place() -> None:
    found = scored(lambda t: 20.0 - 6.0 * np.exp(-(((t - 30.0) / 5.0) ** 2)))
    assert found.height_lost_m == pytest.approx(6.0)
    assert scored(lambda t: 20.0 + 0.1 * t).height_lost_m == 0.0


def test_the_room_is_the_least_of_ground_and_fence_at_the_end() -> None:
    box = HILL.box
    roomy = {"height_left_m": 1e3}
    assert scored(height_left_m=0.25).room_m == 0.25
    assert scored(x_m=box.x_min_m + 0.5, **roomy).room_m == pytest.approx(0.5)  # type: ignore[arg-type]
    assert scored(x_m=box.x_max_m - 0.75, **roomy).room_m == pytest.approx(0.75)  # type: ignore[arg-type]
    top = scored(lambda t: np.full_like(t, box.z_max_m - 0.3), **roomy)  # type: ignore[arg-type]
    assert top.room_m == pytest.approx(0.3)
    assert isnan(scored(flown_s=30.0, ended="hit the ground").room_m)


# --- fractions ----------------------------------------------------------------------------------


def test_an_interval_of_another_confidence_is_that_of_its_tails() -> None:
    """0 of 10 at 90 %: 1 − 0.05^(1/10)."""
    assert interval(0, 10, 0.9) == pytest.approx((0.0, 1.0 - 0.05**0.1))
    assert interval(10, 10, 0.9) == pytest.approx((0.05**0.1, 1.0))
    low, high = interval(3, 10)
    assert (1.0 - high, 1.0 - low) == pytest.approx(interval(7, 10))


def test_a_fraction_is_reported_in_per_cent() -> None:
    assert fraction_text(20, 20) == "20 of 20 (83–100 %)"
    assert fraction_text(0, 20) == "0 of 20 (0–17 %)"
