"""The way home against the equations of its page, number by number: the height that is left, the
speed, the weave, what the pitch is asked for, and how a stall is detected."""

from __future__ import annotations

from math import asin, cos, exp, inf, log, nan, pi, radians, sin, sqrt
from typing import Any

import numpy as np
import pytest
from samples import STILL
from scipy.optimize import brentq

from tgl_soar.control import airspeed_hold, landing
from tgl_soar.control.airspeed_error import NO_AIRSPEED_ERROR
from tgl_soar.control.airspeed_hold import NO_GLIDE, GlidePitches, GlideState
from tgl_soar.control.landing import (
    LandingParams,
    LandingPlace,
    across,
    along,
    approach_speed,
    escape_height,
    float_length,
    glide_setpoints,
    glide_step,
    half_width,
    height_left,
    slowest,
    slowest_known,
    steeper_bank,
    to_abeam,
    weave,
)
from tgl_soar.control.weaving import mean_cosine
from tgl_soar.control.wind_triangle import ground_speed
from tgl_soar.types import NO_AIR, AirEstimate, GlidePolar, VehicleState, polar_sink

DT, G = 0.005, 9.80665
POLAR = GlidePolar(
    c0=9.0401556,
    c1=-2.2628690,
    c2=0.20598552,
    c3=-0.0054332196,
    speed_min_mps=7.6,
    speed_max_mps=12.0,
)
B = radians(15.0)
PLACE = LandingPlace(x_m=-27.0, y_m=2.0, z_m=1.0, bearing_rad=B, length_m=20.0)
BEST = 9.2
PARAMS = LandingParams(
    place=PLACE,
    escape_rad=radians(-10.0),
    away_x_m=-12.0,
    spare_m=1.5,
    asked=landing.STAY,
    auto=True,
    waits=False,
    clearance_m=3.0,
    polar=POLAR,
    best_glide_mps=BEST,
    stall_mps=7.0,  # less than the best glide over 1.3
    speed_min_mps=6.0,
    heading_max_rad=radians(25.0),
    sigmas=2.0,
    wind_fraction=0.9,
    glide_pitch_rad=radians(-4.0),
    side_max_m=60.0,
    tilt_max_rad=radians(60.0),
)
SLOW = 8.4  # 0.8 m/s above the polar's slow end, which is more than 1 m/s above 6


def at(**changes: Any) -> VehicleState:
    usual = STILL._replace(time_s=5.0, x_m=-4.0, y_m=5.0, z_m=14.0, climb_mps=-0.5, pitch_rad=-0.02)
    return usual._replace(**changes)


def air(**changes: Any) -> AirEstimate:
    usual = NO_AIR._replace(
        airspeed_mps=8.8, wind_mps=6.0, wind_sigma_mps=0.2, cross_wind_mps=0.7, measured=True
    )
    return usual._replace(**changes)


def left(
    distance_m: float, height_m: float, airspeed: float, speed: float, wind: float, cross: float
) -> float:
    """z + V0² / 2g − max(V² / 2g, Vf² / 2g + D S(V) / v(V))"""
    side = wind * sin(B) + cross * cos(B)
    v = sqrt(speed**2 - side**2) - (wind * cos(B) - cross * sin(B))
    needs = max(speed**2, BEST**2 + 2.0 * G * max(0.0, distance_m) * polar_sink(POLAR, speed) / v)
    return height_m + (airspeed**2 - needs) / (2.0 * G)


@pytest.mark.parametrize("distance_m", [3.0, 12.0, 40.0])
@pytest.mark.parametrize("speed", [8.4, 9.7, 11.5])
@pytest.mark.parametrize("cross", [-1.5, 0.0, 1.0])
def test_the_height_left(distance_m: float, speed: float, cross: float) -> None:
    found = height_left(PARAMS, distance_m, 9.0, 10.5, speed, 5.0, cross)
    assert found == pytest.approx(left(distance_m, 9.0, 10.5, speed, 5.0, cross))


def test_over_the_place_only_the_flare_s_speed_is_needed() -> None:
    found = height_left(PARAMS, -2.0, 3.0, 8.0, 11.0, 5.0, 0.0)
    assert found == pytest.approx(3.0 + (8.0**2 - BEST**2) / (2.0 * G))
    assert height_left(PARAMS, 5.0, 3.0, 8.0, 8.4, 9.0, 0.0) == -inf  # it goes backwards
    assert height_left(PARAMS, 5.0, 3.0, 8.0, 8.4, 8.0, 0.0) == -inf  # by less than half a metre


def test_the_escape_condition_is_the_best_speed_s() -> None:
    vehicle, air_now = at(), air(wind_mps=4.5)
    wind, cross = 0.9 * 4.5 + 2.0 * 0.2, 0.9 * 0.7
    distance, height = along(PLACE, vehicle.x_m, vehicle.y_m), 13.0
    speeds = np.linspace(SLOW, 12.0, 400)
    most = max(left(distance, height, 8.8, v, wind, cross) for v in speeds)
    assert escape_height(PARAMS, vehicle, air_now) == pytest.approx(most - 1.5, abs=0.05)
    deep = PARAMS._replace(spare_m=500.0)
    assert escape_height(deep, vehicle, air_now) == -50.0
    assert escape_height(PARAMS, at(x_m=nan), air_now) != escape_height(
        PARAMS, at(x_m=nan), air_now
    )


def test_a_flare_covers_more_than_a_glide() -> None:
    """(1 + KF) / KF ln(1 + KF) seconds where a glide takes one, KF 3, at the best glide's speed."""
    beyond_s = 4.0 / 3.0 * log(4.0) - 1.0
    v = ground_speed(BEST, 5.0, 0.0, B)
    assert float_length(PARAMS, 5.0) == pytest.approx(beyond_s * v)
    assert float_length(PARAMS, 12.0) == 0.0
    assert float_length(PARAMS, nan) == 0.0


@pytest.mark.parametrize(("x_m", "z_m", "wind"), [(5.0, 9.5, 4.5), (0.0, 9.0, 5.0)])
def test_the_approach_is_flown_at_the_slowest_speed_that_gets_there(
    x_m: float, z_m: float, wind: float
) -> None:
    """Between nine speeds, 0.45 m/s apart, what is left goes nearly straight."""
    vehicle, air_now = at(x_m=x_m, z_m=z_m), air(wind_mps=wind)
    distance = along(PLACE, x_m, vehicle.y_m) - float_length(PARAMS, wind)

    def over(v: float) -> float:
        return left(distance, z_m - 1.0, 8.8, v, wind, 0.0)

    assert over(SLOW) < 0.0 < over(11.0)
    root = brentq(over, SLOW, 11.0)
    assert approach_speed(PARAMS, SLOW, vehicle, air_now) == pytest.approx(root, abs=0.03)


def test_with_height_to_spare_it_is_flown_as_slowly_as_it_may_be() -> None:
    assert slowest(PARAMS) == pytest.approx(SLOW)
    assert slowest(PARAMS._replace(speed_min_mps=7.9)) == pytest.approx(8.9)
    assert slowest_known(PARAMS, measured=True) == pytest.approx(SLOW)
    assert slowest_known(PARAMS, measured=False) == BEST
    assert approach_speed(PARAMS, SLOW, at(z_m=40.0), air()) == SLOW
    # Nothing reaches it: the speed that comes nearest; nothing is known: the best glide.
    low = approach_speed(PARAMS, SLOW, at(x_m=60.0, z_m=4.0), air(wind_mps=5.0))
    distance = along(PLACE, 60.0, 5.0) - float_length(PARAMS, 5.0)
    speeds = [SLOW + 0.45 * k for k in range(9)]
    best = max(speeds, key=lambda v: left(distance, 3.0, 8.8, v, 5.0, 0.0))
    assert low == pytest.approx(best)
    assert approach_speed(PARAMS, SLOW, at(), air(wind_mps=nan)) == BEST
    assert (
        approach_speed(PARAMS._replace(place=PLACE._replace(length_m=0.0)), SLOW, at(), air())
        == BEST
    )


def advance(vehicle: VehicleState, air_now: AirEstimate, sinks: float) -> float:
    """v_d = D' s / h', to where the straight rest begins."""
    height = vehicle.z_m - 1.0 - 4.5
    final = ground_speed(BEST, air_now.wind_mps, 0.0, B)
    distance = along(PLACE, vehicle.x_m, vehicle.y_m) - float_length(PARAMS, air_now.wind_mps)
    distance -= 4.5 * final / polar_sink(POLAR, BEST)
    return distance * sinks / height


@pytest.mark.parametrize("goes_right", [True, False])
@pytest.mark.parametrize("sinks", [nan, 1.0, 0.6])
def test_the_weave_keeps_of_the_speed_what_it_may(goes_right: bool, sinks: float) -> None:
    vehicle, air_now = at(x_m=2.0, z_m=18.0), air(wind_mps=4.0, cross_wind_mps=0.0)
    chi = weave(PARAMS, goes_right, SLOW, sinks, vehicle, air_now, fast=False)
    sink = polar_sink(POLAR, SLOW)
    s = sink if sinks != sinks else min(sink, sinks)
    wide = min(30.0, 60.0, 2.3 * 12.5)
    kept = SLOW * mean_cosine(abs(chi), wide, SLOW)
    assert (chi > 0.0) == goes_right
    assert 0.3 < abs(chi) < 1.4
    assert kept == pytest.approx(4.0 + advance(vehicle, air_now, s), abs=0.06)


def test_what_the_air_carries_goes_on_upstream_and_what_is_beyond_comes_back_slowly() -> None:
    """By 1 m/s at least of one that hardly sinks, and by 2 m/s downwind at the most."""
    air_now, wide = air(wind_mps=5.0, cross_wind_mps=0.0), 28.75
    near = at(x_m=-17.0, z_m=18.0)
    assert advance(near, air_now, 0.25 * polar_sink(POLAR, SLOW)) < 1.0
    carried = weave(PARAMS, True, SLOW, 0.1, near, air_now, fast=False)
    assert SLOW * mean_cosine(carried, wide, SLOW) == pytest.approx(5.0 + 1.0, abs=0.06)
    far = at(x_m=-150.0, z_m=18.0)
    beyond = weave(PARAMS, True, SLOW, nan, far, air(wind_mps=6.5, cross_wind_mps=0.0), fast=False)
    assert SLOW * mean_cosine(beyond, wide, SLOW) == pytest.approx(6.5 - 2.0, abs=0.06)


def test_no_weave_where_there_is_no_height_for_one_or_it_is_not_known() -> None:
    assert weave(PARAMS, True, SLOW, nan, at(z_m=5.4), air(), fast=False) == 0.0
    assert weave(PARAMS, True, SLOW, nan, at(x_m=nan), air(), fast=False) == 0.0
    unknown = PARAMS._replace(polar=POLAR._replace(c0=nan))
    assert weave(unknown, True, SLOW, nan, at(), air(), fast=False) == 0.0
    # A polar that sinks nowhere at this speed tells no time in which the height is used up.
    floats = GlidePolar(c0=-SLOW, c1=1.0, c2=0.0, c3=0.0, speed_min_mps=7.6, speed_max_mps=12.0)
    assert polar_sink(floats, SLOW) == 0.0 < polar_sink(floats, BEST)
    lifted = PARAMS._replace(polar=floats)
    assert weave(lifted, True, SLOW, nan, at(), air(), fast=False) == 0.0
    # A metre and a half over the straight rest there are not two seconds to look upwind again in.
    low = weave(PARAMS, True, SLOW, nan, at(x_m=-26.0, z_m=6.0), air(wind_mps=3.0), fast=False)
    assert abs(low) <= (0.5 + 1.0) / polar_sink(POLAR, SLOW) + 1e-9


@pytest.mark.parametrize(
    ("over_m", "fast", "wide_m"),
    [
        (2.0, False, 4.6),
        (10.0, False, 23.0),
        (20.0, False, 30.0),
        (2.0, True, 7.0),
        (5.0, True, 14.0),  # not farther from low
        (10.0, True, 23.0),
        (-1.0, True, 0.0),
    ],
)
def test_how_wide_a_weave_is(over_m: float, fast: bool, wide_m: float) -> None:
    assert half_width(PARAMS, over_m, fast) == pytest.approx(wide_m)
    assert half_width(PARAMS._replace(side_max_m=3.0), over_m, fast) == pytest.approx(
        min(3.0, wide_m)
    )


def test_no_nose_is_turned_farther_than_abeam_of_the_approach() -> None:
    """Of 15 degrees to the right it is 105 to the right of the wind, 75 to the left; a wind that
    comes from the right takes that much of the right."""
    still = air(cross_wind_mps=0.0)
    assert to_abeam(PLACE, True, still) == pytest.approx(pi / 2.0 + B)
    assert to_abeam(PLACE, False, still) == pytest.approx(pi / 2.0 - B)
    from_right = air(wind_mps=6.0, cross_wind_mps=-6.0)
    assert to_abeam(PLACE, True, from_right) == pytest.approx(pi / 2.0 + B - pi / 4.0)
    assert to_abeam(PLACE, False, from_right) == pytest.approx(pi / 2.0 - B)
    assert to_abeam(PLACE, True, air(wind_mps=-1.0)) == pytest.approx(pi / 2.0 + B)


# --- the glide, tick by tick ------------------------------------------------------------------

GLIDING = NO_GLIDE._replace(speed_mps=9.0, sink_mps=1.2)


def step(
    state: GlideState = GLIDING,
    vehicle: VehicleState | None = None,
    air_now: AirEstimate | None = None,
    *,
    outward: bool = False,
    position_ok: bool = True,
    clearance_m: float = inf,
    nose_held: bool = False,
) -> tuple[GlideState, float]:
    return glide_step(
        PARAMS,
        state,
        outward,
        position_ok,
        at() if vehicle is None else vehicle,
        air() if air_now is None else air_now,
        clearance_m,
        nose_held,
        DT,
    )


def test_the_speed_s_setpoint_begins_at_the_airspeed_and_moves_by_no_more_than_it_may() -> None:
    """1.5 m/s each second, within what is flown at all."""
    begun, speed = step(NO_GLIDE, air_now=air(airspeed_mps=10.0))
    assert speed == begun.speed_mps == pytest.approx(10.0, abs=1.5 * DT + 1e-12)
    slow, _ = step(NO_GLIDE, air_now=air(airspeed_mps=5.0))
    assert slow.speed_mps == pytest.approx(SLOW, abs=1.5 * DT + 1e-12)
    fast, _ = step(NO_GLIDE, air_now=air(airspeed_mps=15.0))
    assert fast.speed_mps == pytest.approx(12.0 - 1.5 * DT)
    # Much too high: as slowly as it may be.
    high, _ = step(vehicle=at(z_m=40.0))
    assert high.speed_mps == pytest.approx(9.0 - 1.5 * DT)
    # Low: the flare lives on the best glide's speed.
    low, _ = step(vehicle=at(x_m=-26.0, z_m=5.0))
    assert low.speed_mps == pytest.approx(9.0 + 1.5 * DT)
    # Away from the slope it must gain on the wind by 2 m/s.
    out, _ = step(air_now=air(wind_mps=9.5), vehicle=at(z_m=60.0), outward=True)
    assert out.speed_mps == pytest.approx(9.0 + 1.5 * DT)


def test_what_the_speed_is_off_is_learnt_while_it_glides() -> None:
    state, _ = step(vehicle=at(z_m=40.0))
    error = 8.8 - state.speed_mps
    assert state.integral_rad == pytest.approx(0.015 * error * DT)
    full, _ = step(GLIDING._replace(integral_rad=-0.1))
    assert full.integral_rad == pytest.approx(-0.1)
    flaring, speed = step(vehicle=at(z_m=1.45))
    assert (flaring.flares, flaring.integral_rad, speed) == (True, 0.0, 8.8)
    recovering, _ = step(GLIDING._replace(recovers_s=1.0))
    assert recovering.integral_rad == 0.0


@pytest.mark.parametrize(
    ("climb", "clearance_m", "flares"),
    [(-0.1, 0.6, False), (-0.1, 0.45, True), (-1.5, 1.6, False), (-1.5, 1.4, True)],
)
def test_it_flares_a_second_of_its_sink_above_the_ground_or_half_a_metre(
    climb: float, clearance_m: float, flares: bool
) -> None:
    state, _ = step(vehicle=at(climb_mps=climb), clearance_m=clearance_m)
    assert state.flares == flares
    lost, _ = step(vehicle=at(climb_mps=climb), clearance_m=clearance_m, position_ok=False)
    assert not lost.flares


def test_its_sink_is_averaged_over_three_seconds() -> None:
    state, _ = step(vehicle=at(climb_mps=-2.0))
    assert state.sink_mps == pytest.approx(1.2 + (1.0 - exp(-DT / 3.0)) * 0.8)
    first, _ = step(NO_GLIDE, vehicle=at(climb_mps=-2.0))
    assert first.sink_mps == 2.0


def test_a_stall_lasts_half_a_second_and_the_nose_stays_down_for_one_and_a_half() -> None:
    sinks = polar_sink(POLAR, SLOW)
    falling = at(climb_mps=-(sinks + 0.6))
    state, ticks = GLIDING, 0
    while not state.stalled:
        state, _ = step(state, falling, nose_held=True)
        ticks += 1
    assert ticks * DT == pytest.approx(0.5, abs=1.5 * DT)
    assert (state.recovers_s, state.stalling_s) == (1.5, 0.0)
    down = 0
    while state.recovers_s > 0.0:
        state, _ = step(state, falling, nose_held=True)
        down += 1
    assert down * DT == pytest.approx(1.5, abs=1.5 * DT)
    # A gust: as much time without takes it back, and a sink of any glide is none.
    held, _ = step(GLIDING, falling, nose_held=True)
    assert held.stalling_s == pytest.approx(DT)
    assert step(held, falling)[0].stalling_s == 0.0
    gliding = at(climb_mps=-(sinks + 0.4))
    assert step(GLIDING, gliding, nose_held=True)[0].stalling_s == 0.0
    assert step(GLIDING, gliding, nose_held=True, position_ok=False)[0].stalling_s == DT


def test_after_a_stall_it_flies_no_slower_than_the_best_glide_and_does_not_turn() -> None:
    state, _ = step(GLIDING._replace(stalled=True, weave_rad=0.3), vehicle=at(z_m=40.0))
    assert state.speed_mps == pytest.approx(9.0 + 1.5 * DT)
    assert state.weave_rad == pytest.approx(0.3 - DT)  # back by a radian each second


def test_with_height_left_over_the_nose_turns_by_a_radian_each_second() -> None:
    slow = GLIDING._replace(speed_mps=SLOW)
    high = at(x_m=-10.0, z_m=30.0)
    state, _ = step(slow, high, air(wind_mps=4.0, cross_wind_mps=0.0))
    assert state.weave_rad == pytest.approx(DT)
    left_, _ = step(slow._replace(goes_right=False), high, air(wind_mps=4.0, cross_wind_mps=0.0))
    assert left_.weave_rad == pytest.approx(-DT)
    # One that is slower than that by more than 0.6 m/s does not turn.
    lame, _ = step(slow, high, air(airspeed_mps=SLOW - 0.7, wind_mps=4.0, cross_wind_mps=0.0))
    assert lame.weave_rad == 0.0
    near, _ = step(slow, high, air(airspeed_mps=SLOW - 0.5, wind_mps=4.0, cross_wind_mps=0.0))
    assert near.weave_rad > 0.0


@pytest.mark.parametrize("goes_right", [True, False])
def test_it_turns_back_where_the_turn_would_end_beyond_its_width(goes_right: bool) -> None:
    """V (1 − cos psi) / omega in the turn, and 1.4 s of V sin psi before it has begun."""
    side, psi = (1.0 if goes_right else -1.0), 0.8
    state = GLIDING._replace(goes_right=goes_right, weave_rad=side * psi)
    goes_on_m = 9.0 * (1.0 - cos(psi)) + 1.4 * 9.0 * sin(psi)
    wide_m = 2.3 * (14.0 - 1.0 - 4.5)
    for off_m, stays in ((-0.3, True), (0.3, False)):
        want = side * (wide_m - goes_on_m + off_m)
        # A point that lies so far to the right of the approach.
        vehicle = at(x_m=-27.0 + want * sin(B), y_m=2.0 + want * cos(B))
        assert across(PLACE, vehicle.x_m, vehicle.y_m) == pytest.approx(want)
        found, _ = step(state, vehicle)
        assert (found.goes_right == goes_right) == stays


PITCHES = GlidePitches(wanted_rad=-0.05, slowest_rad=-0.03, fastest_rad=-0.15, most_alpha_rad=nan)


def setpoints(
    state: GlideState, air_now: AirEstimate, **changes: Any
) -> airspeed_hold.GlideSetpoints:
    options: dict[str, Any] = {"outward": False, "position_ok": True, "clearance_m": inf}
    options |= {"vehicle": at(), "pitches": PITCHES} | changes
    return glide_setpoints(
        PARAMS,
        state,
        options["outward"],
        options["position_ok"],
        options["pitches"],
        options["vehicle"],
        air_now,
        options["clearance_m"],
    )


def test_the_pitch_is_the_glide_s_and_what_the_speed_is_off() -> None:
    state = GLIDING._replace(integral_rad=0.01)
    assert setpoints(state, air()).pitch_rad == pytest.approx(-0.05 + 0.01 + 0.05 * (8.8 - 9.0))
    assert setpoints(state, air(airspeed_mps=nan)).pitch_rad == pytest.approx(-0.04)
    unknown = PITCHES._replace(wanted_rad=nan)
    assert setpoints(state, air(), pitches=unknown).pitch_rad == pytest.approx(
        radians(-4.0) + 0.01 + 0.05 * (8.8 - 9.0)
    )
    # An airspeed that is not measured may lower the nose and raise it no further than the slowest.
    quick = air(airspeed_mps=9.8, measured=False)
    assert setpoints(state, quick).pitch_rad == -0.03
    assert setpoints(state, quick._replace(measured=True)).pitch_rad == pytest.approx(0.0)
    down = GLIDING._replace(recovers_s=0.5)
    assert setpoints(down, air()).pitch_rad == -0.15
    lost = PITCHES._replace(fastest_rad=nan)
    assert setpoints(down, air(), pitches=lost).pitch_rad == pytest.approx(radians(-4.0))


@pytest.mark.parametrize(("height_m", "sink_sp"), [(0.9, 0.9), (0.2, 0.4)])
def test_the_flare_holds_a_sink_that_dies_out_with_the_height(
    height_m: float, sink_sp: float
) -> None:
    state = GLIDING._replace(flares=True)
    found = setpoints(state, air(), clearance_m=height_m, vehicle=at(climb_mps=-1.1))
    assert found.pitch_rad == pytest.approx(-0.05 + 3.0 * (1.1 - sink_sp) / 8.8)
    over_place = setpoints(state, air(), vehicle=at(climb_mps=-1.1, z_m=1.0 + height_m))
    assert over_place.pitch_rad == pytest.approx(found.pitch_rad)


def test_sideways_it_returns_to_the_approach_in_two_seconds_and_no_faster_than_3_mps() -> None:
    for right_m, back in ((2.0, -1.0), (20.0, -3.0), (-4.0, 2.0)):
        vehicle = at(
            x_m=-27.0 + 7.0 * cos(B) + right_m * sin(B), y_m=2.0 - 7.0 * sin(B) + right_m * cos(B)
        )
        found = setpoints(GLIDING, air(), vehicle=vehicle)
        forward = ground_speed(8.8, 6.0, 0.0, B)
        wanted = forward * sin(B) + back * cos(B)
        assert found.sideways_mps == pytest.approx(wanted)
        assert found.heading_rad == pytest.approx(
            max(-radians(25.0), min(radians(25.0), asin((wanted - 0.7) / 8.8)))
        )
        assert found.steeper == 0.0


def test_on_the_way_out_it_flies_along_the_way_out_and_weaving_along_its_nose() -> None:
    out = setpoints(GLIDING, air(), outward=True)
    assert out.sideways_mps == pytest.approx(
        ground_speed(8.8, 6.0, 0.0, radians(-10.0)) * sin(radians(-10.0))
    )
    weaving = setpoints(GLIDING._replace(weave_rad=-0.6), air())
    assert weaving.heading_rad == -0.6
    assert weaving.sideways_mps == pytest.approx(-8.8 * sin(0.6))
    blind = setpoints(GLIDING, air(), position_ok=False)
    assert blind[1:] == (0.0, 0.0, 0.0)
    # Against a wind that it hardly beats it is taken to advance by half a metre each second.
    against = setpoints(GLIDING, air(wind_mps=8.6), outward=True)
    assert against.sideways_mps == pytest.approx(0.5 * sin(radians(-10.0)))


def test_a_weave_may_bank_steeper_the_higher_it_is() -> None:
    """By half as much from 7.5 m over the place on, where turns have shown the speed."""
    shown = NO_AIRSPEED_ERROR._replace(weight=1e4, by_nose2=1e4)
    state = GLIDING._replace(weave_rad=0.5, airspeed_error=shown)
    blind = air(measured=False)
    for over_m, steeper in ((7.5, 0.5), (6.5, 0.25), (5.5, 0.0), (20.0, 0.5)):
        found = setpoints(state, blind, vehicle=at(z_m=1.0 + over_m))
        assert found.steeper == pytest.approx(steeper), over_m
    assert setpoints(state, air()).steeper == 0.0
    assert setpoints(state._replace(airspeed_error=NO_AIRSPEED_ERROR), blind).steeper == 0.0
    assert steeper_bank(PARAMS, radians(10.0), 0.5) == pytest.approx(radians(15.0))
    assert steeper_bank(PARAMS, radians(16.0), 0.5) == pytest.approx(radians(20.0))
    assert steeper_bank(PARAMS._replace(tilt_max_rad=radians(24.0)), radians(10.0), 0.5) == (
        pytest.approx(radians(12.0))
    )
    assert steeper_bank(PARAMS, radians(30.0), 0.5) == pytest.approx(radians(30.0))
