"""Beating along the ridge in numbers: how fast it goes back into the plane, where it turns, how
long a wind has to last, and each limit from both sides."""

from __future__ import annotations

from math import acos, cos, exp, hypot, nan, radians, sin
from typing import Any

import pytest
from test_landing import PARAMS, POLAR, SLOWEST, air, at

from tgl_soar.control.airspeed_hold import NO_GLIDE, GlidePitches, GlideState
from tgl_soar.control.ridge_beat import (
    NO_BEAT,
    BeatParams,
    BeatState,
    beat_bank,
    beat_setpoints,
    beat_step,
    beat_watch,
    is_back,
    is_oblique,
    is_wanted_back,
    off_plane,
)
from tgl_soar.control.target_line import TargetLine
from tgl_soar.types import AirEstimate

BEAT = BeatParams(
    asked=False, auto=True, aside=True, half_width_m=40.0, top_z_m=90.0, veer_max_rad=0.7
)
UPRIGHT = TargetLine(-20.0, 40.0, radians(90.0))
PITCHES = GlidePitches(wanted_rad=-0.05, slowest_rad=-0.03, fastest_rad=-0.15, most_alpha_rad=nan)
DT = 0.05
FLOWN = NO_GLIDE._replace(speed_mps=SLOWEST)


def step(
    state: GlideState = FLOWN,
    *,
    off_m: float = 0.0,
    wind_mps: float = 6.0,
    cross_mps: float = 0.0,
    returns: bool = False,
    measured: bool = True,
    dt_s: float = DT,
    **vehicle: Any,
) -> GlideState:
    feels = air(
        airspeed_mps=state.speed_mps, wind_mps=wind_mps, cross_wind_mps=cross_mps, measured=measured
    )
    where = {"x_m": -20.0 + off_m, "y_m": 0.0, "z_m": 40.0, **vehicle}
    return beat_step(
        BEAT, PARAMS, UPRIGHT, state, returns, True, at(5.0, **where), feels, False, dt_s
    )[0]


def settled(**given: Any) -> GlideState:
    """The nose and the speed as they would stay at that place."""
    state = FLOWN
    for _ in range(400):
        state = step(state, **given)
    return state


def test_what_the_elevator_holds_lowers_its_nose() -> None:
    """Where no airspeed is measured."""
    met = air(airspeed_mps=9.2, alpha_rad=0.17, trim_alpha_rad=0.17, measured=False)
    vehicle = at(5.0, x_m=-20.0, y_m=0.0, z_m=40.0)
    state, _ = beat_step(BEAT, PARAMS, UPRIGHT, FLOWN, False, True, vehicle, met, False, DT)
    assert state.trim_alpha_rad == 0.17
    pitches = PITCHES._replace(most_alpha_rad=0.15)
    plain = beat_setpoints(PARAMS, state, True, PITCHES, met).pitch_rad
    assert beat_setpoints(PARAMS, state, True, pitches, met).pitch_rad == pytest.approx(
        plain - 0.02
    )


# --- its nose -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("off_m", "advance_mps"),
    [(0.0, 6.0), (1.5, 6.5), (-3.0, 5.0), (5.9, 6.0 + 5.9 / 3.0), (50.0, 8.0), (-50.0, 4.0)],
)
def test_it_goes_back_into_the_plane_in_three_seconds_and_by_2_mps_at_most(
    off_m: float, advance_mps: float
) -> None:
    state = settled(off_m=off_m)
    assert state.speed_mps * cos(state.weave_rad) == pytest.approx(advance_mps)


def test_it_looks_no_further_aside_than_80_degrees() -> None:
    """1.4 rad: in next to no wind, and where it is to fall back faster than the wind blows."""
    assert settled(wind_mps=1.0).weave_rad == pytest.approx(1.4)
    assert settled(wind_mps=1.5, off_m=-50.0).weave_rad == pytest.approx(1.4)
    there = settled(wind_mps=1.5)
    assert there.weave_rad == pytest.approx(acos(1.5 / there.speed_mps))
    assert there.weave_rad < 1.399


def test_it_turns_by_four_tenths_of_a_radian_a_second() -> None:
    assert step().weave_rad == pytest.approx(0.02)
    assert step(FLOWN._replace(weave_rad=0.5), wind_mps=nan).weave_rad == pytest.approx(0.48)


@pytest.mark.parametrize("right", [True, False])
@pytest.mark.parametrize(("beyond_m", "goes_on"), [(-0.5, True), (0.5, False)])
def test_it_turns_so_that_it_is_at_the_end_of_its_width_when_it_has(
    right: bool, beyond_m: float, goes_on: bool
) -> None:
    """What a turn of 0.4 rad/s takes to the side, and 1.4 s of its way there."""
    side = 1.0 if right else -1.0
    nose = 0.7
    takes = SLOWEST * (1.0 - cos(nose)) / 0.4 + 1.4 * SLOWEST * sin(nose)
    state = FLOWN._replace(weave_rad=side * nose, goes_right=right)
    found = step(state, y_m=side * (40.0 - takes + beyond_m))
    assert found.goes_right is (right if goes_on else not right)
    # Straight into the wind nothing is taken.
    straight = step(FLOWN._replace(goes_right=right), y_m=side * (40.0 + beyond_m))
    assert straight.goes_right is (right if goes_on else not right)


def test_on_its_way_back_it_goes_to_the_middle_and_within_five_metres_into_the_wind() -> None:
    for y_m, goes_right in ((-20.0, True), (20.0, False)):
        state = step(FLOWN._replace(goes_right=not goes_right), y_m=y_m, returns=True)
        assert state.goes_right is goes_right
        assert state.weave_rad == pytest.approx(0.02 if goes_right else -0.02)
    for y_m, straight in ((4.9, True), (-4.9, True), (5.1, False), (-5.1, False)):
        assert (step(y_m=y_m, returns=True).weave_rad == 0.0) is straight
        assert step(y_m=y_m).weave_rad != 0.0


# --- its speed ----------------------------------------------------------------------------------


def test_it_makes_2_mps_along_the_ridge_at_least() -> None:
    assert settled(wind_mps=8.3).speed_mps == pytest.approx(hypot(8.3, 2.0))
    against = settled(wind_mps=6.0, cross_mps=-4.0)
    assert against.speed_mps == pytest.approx(hypot(6.0, 6.0))
    assert settled(wind_mps=6.0, cross_mps=4.0).speed_mps == pytest.approx(SLOWEST)
    behind = settled(wind_mps=8.3, off_m=3.0)
    assert behind.speed_mps == pytest.approx(hypot(9.3, 2.0))


@pytest.mark.parametrize(
    ("below_m", "fraction"), [(10.5, 0.0), (10.0, 0.0), (7.5, 0.25), (0.0, 1.0)]
)
def test_from_ten_metres_below_the_fences_top_it_flies_faster(
    below_m: float, fraction: float
) -> None:
    fast = POLAR.speed_max_mps
    assert settled(z_m=90.0 - below_m).speed_mps == pytest.approx(
        SLOWEST + fraction * (fast - SLOWEST)
    )
    assert settled(z_m=95.0).speed_mps == pytest.approx(fast)


def test_an_airspeed_that_nobody_measures_is_that_of_the_best_glide() -> None:
    state = FLOWN._replace(speed_mps=PARAMS.best_glide_mps)
    assert step(state, measured=False).speed_mps == pytest.approx(PARAMS.best_glide_mps)
    assert step(state).speed_mps < PARAMS.best_glide_mps
    stalled = state._replace(stalled=True)
    assert step(stalled).speed_mps == pytest.approx(PARAMS.best_glide_mps)


def test_the_plane_leans_with_the_line() -> None:
    lean = TargetLine(-20.0, 40.0, radians(120.0))
    # Ten metres further up the line is 10 / tan 60° further upstream.
    assert off_plane(lean, at(x_m=-20.0, z_m=50.0)) == pytest.approx(10.0 / 3.0**0.5)
    assert off_plane(lean, at(x_m=-23.0, z_m=40.0)) == pytest.approx(-3.0)


# --- its setpoints ------------------------------------------------------------------------------


@pytest.mark.parametrize(("airspeed", "used"), [(9.0, 9.0), (1.01, 1.01), (0.9, 9.2), (nan, 9.2)])
def test_it_goes_sideways_by_its_nose_and_the_wind(airspeed: float, used: float) -> None:
    state = FLOWN._replace(weave_rad=0.4)
    feels = air(airspeed_mps=airspeed, wind_mps=6.0, cross_wind_mps=1.5)
    found = beat_setpoints(PARAMS, state, True, PITCHES, feels)
    assert found.sideways_mps == pytest.approx(used * sin(0.4) + 1.5)
    assert (found.heading_rad, found.steeper) == (0.4, 0.0)
    blind = beat_setpoints(PARAMS, state, False, PITCHES, feels)
    assert blind == (found.pitch_rad, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("bank_deg", "tilt_deg", "found_deg"),
    [(10.0, 60.0, 18.0), (10.0, 36.0, 18.0), (10.0, 30.0, 15.0), (20.0, 60.0, 20.0)],
)
def test_it_banks_by_18_degrees_and_half_of_the_tilt_at_most(
    bank_deg: float, tilt_deg: float, found_deg: float
) -> None:
    assert beat_bank(radians(bank_deg), radians(tilt_deg)) == pytest.approx(radians(found_deg))


# --- when ---------------------------------------------------------------------------------------


def watch(
    state: BeatState, wind_mps: float, cross_mps: float = 0.0, dt_s: float = 0.1,
    params: BeatParams = BEAT,
) -> BeatState:  # fmt: skip
    feels: AirEstimate = air(wind_mps=wind_mps, cross_wind_mps=cross_mps)
    return beat_watch(params, PARAMS, state, feels, dt_s)


def test_the_wind_is_averaged_over_three_seconds() -> None:
    first = watch(NO_BEAT, 7.0, 1.0)
    assert (first.wind_mps, first.cross_wind_mps) == (7.0, 1.0)
    found = watch(first, 9.0, -1.0, dt_s=0.6)
    blend = 1.0 - exp(-0.2)
    assert found.wind_mps == pytest.approx(7.0 + 2.0 * blend)
    assert found.cross_wind_mps == pytest.approx(1.0 - 2.0 * blend)


@pytest.mark.parametrize(
    ("wind_mps", "cross_mps", "stands"),
    [
        (8.11, 0.0, True), (8.09, 0.0, False),  # half a metre a second beyond the polar's slow end
        (7.0, 4.1, True), (7.0, 4.0, False), (7.0, -4.1, True),
    ],
)  # fmt: skip
def test_a_wind_in_which_it_can_stand(wind_mps: float, cross_mps: float, stands: bool) -> None:
    assert POLAR.speed_min_mps == 7.6
    found = watch(NO_BEAT._replace(stands_s=3.0), wind_mps, cross_mps)
    assert found.stands_s == pytest.approx(3.1 if stands else 0.0)


@pytest.mark.parametrize(("angle_rad", "oblique"), [(0.78, False), (0.80, True), (-0.80, True),
                                                    (-0.78, False)])  # fmt: skip
def test_a_wind_from_more_than_five_degrees_beyond_the_veer_is_oblique(
    angle_rad: float, oblique: bool
) -> None:
    wind, cross = 12.0 * cos(angle_rad), 12.0 * sin(angle_rad)
    assert is_oblique(BEAT, wind, cross) is oblique
    found = watch(NO_BEAT._replace(oblique_s=3.0, stands_s=3.0), wind, cross)
    assert found.oblique_s == pytest.approx(3.1 if oblique else 0.0)
    assert found.stands_s == pytest.approx(0.0 if oblique else 3.1)
    for never in (BEAT._replace(aside=False), BEAT._replace(veer_max_rad=0.0)):
        assert not is_oblique(never, wind, cross)


def test_both_times_have_an_end() -> None:
    long = NO_BEAT._replace(oblique_s=9.95, stands_s=19.95)
    assert watch(long, 9.0).stands_s == 20.0
    assert watch(long, 1.0, 9.0).oblique_s == 10.0


@pytest.mark.parametrize(("stands_s", "back"), [(9.9, False), (10.1, True)])
def test_ten_seconds_of_it_lead_back(stands_s: float, back: bool) -> None:
    state = NO_BEAT._replace(stands_s=stands_s)
    assert is_wanted_back(BEAT, state) is back
    assert is_wanted_back(BEAT._replace(auto=False), state)
    assert not is_wanted_back(BEAT._replace(asked=True), state)


@pytest.mark.parametrize(
    ("y_m", "near"), [(14.9, True), (15.1, False), (-14.9, True), (-15.1, False)]
)
def test_it_is_back_within_fifteen_metres_of_the_middle(y_m: float, near: bool) -> None:
    assert is_back(at(y_m=y_m, heading_rad=0.0), air(wind_mps=8.0)) is near


@pytest.mark.parametrize(("nose_rad", "points"), [(0.19, True), (0.21, False), (-0.19, True),
                                                  (-0.21, False)])  # fmt: skip
def test_it_is_back_with_its_nose_within_a_fifth_of_a_radian_of_the_wind(
    nose_rad: float, points: bool
) -> None:
    assert is_back(at(y_m=0.0, heading_rad=nose_rad), air(wind_mps=8.0)) is points
    # A wind of nothing, or from behind, has no direction that counts: straight off the ridge.
    for wind_mps in (0.0, -3.0):
        feels = air(wind_mps=wind_mps, cross_wind_mps=5.0)
        assert is_back(at(y_m=0.0, heading_rad=nose_rad), feels) is points
