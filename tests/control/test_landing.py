"""Home: the height that is needed, the speed and the weave of the approach, the flare."""

from __future__ import annotations

from math import asin, cos, exp, inf, isfinite, isnan, nan, pi, radians, sin, sqrt
from typing import Any

import pytest
from samples import STILL

from tgl_soar.control import airspeed_hold, landing
from tgl_soar.control.airspeed_hold import NO_GLIDE, GlidePitches, GlideState
from tgl_soar.control.landing import (
    LandingParams,
    LandingPlace,
    across,
    along,
    approach_speed,
    escape_height,
    glide_setpoints,
    glide_step,
    half_width,
    height_left,
    weave,
)
from tgl_soar.control.weaving import WEAVE_MIN_RAD, WEAVE_RADPS, mean_cosine
from tgl_soar.types import NO_AIR, NO_POLAR, AirEstimate, GlidePolar, VehicleState, polar_sink

DT = 0.005
G = 9.80665
POLAR = GlidePolar(
    c0=9.0401556,
    c1=-2.2628690,
    c2=0.20598552,
    c3=-0.0054332196,
    speed_min_mps=7.6,
    speed_max_mps=12.0,
)
PLACE = LandingPlace(x_m=-27.0, y_m=0.0, z_m=0.0, bearing_rad=0.0, length_m=20.0)
PARAMS = LandingParams(
    place=PLACE,
    escape_rad=0.0,
    away_x_m=-12.0,
    spare_m=1.0,
    asked=landing.STAY,
    auto=True,
    waits=False,
    clearance_m=3.0,
    polar=POLAR,
    best_glide_mps=9.2,
    stall_mps=7.0,
    speed_min_mps=6.0,
    heading_max_rad=radians(20.0),
    sigmas=2.0,
    wind_fraction=1.0,
    glide_pitch_rad=radians(-4.0),
    side_max_m=60.0,
    tilt_max_rad=radians(60.0),
)
SLOWEST = 7.6 + landing.POLAR_BY_MPS


def pitched(wanted_rad: float, slowest_rad: float = nan, fastest_rad: float = nan) -> GlidePitches:
    return GlidePitches(wanted_rad, slowest_rad, fastest_rad, most_alpha_rad=nan)


def at(time_s: float = 0.0, **changes: Any) -> VehicleState:
    usual = STILL._replace(time_s=time_s, x_m=-6.0, z_m=14.0, climb_mps=-0.5, pitch_rad=-0.02)
    return usual._replace(**changes)


def air(**changes: Any) -> AirEstimate:
    usual = NO_AIR._replace(airspeed_mps=8.5, wind_mps=7.0, wind_sigma_mps=0.2, cross_wind_mps=0.0)
    usual = usual._replace(measured=True)
    return usual._replace(**changes)


@pytest.mark.parametrize("bearing_deg", [0.0, 30.0, -50.0])
def test_along_and_across_are_the_same_place_seen_along_the_bearing(bearing_deg: float) -> None:
    b = radians(bearing_deg)
    place = LandingPlace(x_m=-20.0, y_m=3.0, z_m=0.0, bearing_rad=b, length_m=20.0)
    for ahead, right in ((10.0, 0.0), (-4.0, 2.0), (0.0, -3.0)):
        x = place.x_m + ahead * cos(b) + right * sin(b)
        y = place.y_m - ahead * sin(b) + right * cos(b)
        assert along(place, x, y) == pytest.approx(ahead)
        assert across(place, x, y) == pytest.approx(right)


def test_the_height_left_is_what_a_flown_glide_leaves() -> None:
    """Integrated step by step: first the speed is paid for, at once, then it glides, then slows."""
    speed, wind, distance, height, begins = 11.0, 7.0, 21.0, 14.0, 8.5
    z = height - (speed**2 - begins**2) / (2 * G)
    gone = 0.0
    while gone < distance:
        gone += (speed - wind) * DT
        z -= polar_sink(POLAR, speed) * DT
    z += (speed**2 - PARAMS.best_glide_mps**2) / (2 * G)
    left = height_left(PARAMS, distance, height, begins, speed, wind, 0.0)
    assert left == pytest.approx(z, abs=0.02)


def test_the_dive_must_be_paid_before_it_is_given_back() -> None:
    near = height_left(PARAMS, 0.1, 2.0, 8.5, 12.0, 7.0, 0.0)
    assert near == pytest.approx(2.0 + (8.5**2 - 12.0**2) / (2 * G))


def test_the_escape_condition_is_the_best_speed_against_two_sigma() -> None:
    vehicle, now = at(), air()
    wind = now.wind_mps + 2.0 * now.wind_sigma_mps
    speeds = [SLOWEST + k * (12.0 - SLOWEST) / 400 for k in range(401)]
    best = max(height_left(PARAMS, 21.0, 14.0, 8.5, v, wind, 0.0) for v in speeds)
    found = escape_height(PARAMS, vehicle, now)
    assert found == pytest.approx(best - PARAMS.spare_m, abs=0.1)
    assert found <= best - PARAMS.spare_m
    surer = escape_height(PARAMS, vehicle, air(wind_sigma_mps=0.0))
    assert surer > found + 0.5
    assert escape_height(PARAMS._replace(wind_fraction=0.8), vehicle, now) > found + 1.0


@pytest.mark.parametrize("bearing_deg", [0.0, 30.0])
@pytest.mark.parametrize("veer_deg", [-20.0, 0.0, 20.0, 40.0])
@pytest.mark.parametrize("wind_mps", [7.0, 8.0])
def test_what_it_says_is_left_is_left_in_a_wind_across(
    wind_mps: float, veer_deg: float, bearing_deg: float
) -> None:
    """Flown tick by tick along the approach, as the wind triangle of all the wind has it."""
    veer, bearing = radians(veer_deg), radians(bearing_deg)
    params = PARAMS._replace(place=PLACE._replace(x_m=0.0, bearing_rad=bearing))
    now = air(wind_mps=wind_mps * cos(veer), cross_wind_mps=-wind_mps * sin(veer), wind_sigma_mps=0)
    begin = at(x_m=30.0 * cos(bearing), y_m=-30.0 * sin(bearing), z_m=25.0)
    left_m = escape_height(params, begin, now)
    energy_m, best = begin.z_m + now.airspeed_mps**2 / (2 * G), -inf
    for k in range(41):
        speed = SLOWEST + (12.0 - SLOWEST) * k / 40
        x, y, z = begin.x_m, begin.y_m, energy_m - speed**2 / (2 * G)
        off = veer - bearing
        if speed <= wind_mps * abs(sin(off)):
            continue
        heading = bearing + asin(wind_mps * sin(off) / speed)  # so that it keeps to the bearing
        step = 0.02
        for _ in range(5000):
            if along(params.place, x, y) <= 0.0:
                best = max(best, z + (speed**2 - PARAMS.best_glide_mps**2) / (2 * G))
                break
            x -= (speed * cos(heading) - now.wind_mps) * step
            y += (speed * sin(heading) + now.cross_wind_mps) * step
            z -= polar_sink(POLAR, speed) * step
            assert abs(across(params.place, x, y)) < 0.05
    assert left_m == pytest.approx(best - params.spare_m, abs=0.15)


@pytest.mark.parametrize("turned_deg", [-40.0, 15.0])
def test_all_of_it_turned_about_the_place_leaves_the_same(turned_deg: float) -> None:
    """Place, approach, aircraft and wind, to the side by so much."""
    turned = radians(turned_deg)
    place = LandingPlace(x_m=0.0, y_m=0.0, z_m=0.0, bearing_rad=turned, length_m=20.0)
    params = PARAMS._replace(place=place, sigmas=0.0, wind_fraction=0.9)
    straight = params._replace(place=place._replace(bearing_rad=0.0))
    wind = air(wind_mps=6.5 * cos(turned), cross_wind_mps=-6.5 * sin(turned))
    for away_m, z_m in ((20.0, 14.0), (25.0, 9.0)):
        there = at(x_m=away_m * cos(turned), y_m=-away_m * sin(turned), z_m=z_m)
        ahead = at(x_m=away_m, y_m=0.0, z_m=z_m)
        left_m = escape_height(straight, ahead, air(wind_mps=6.5))
        assert escape_height(params, there, wind) == pytest.approx(left_m)


def test_wind_that_no_speed_beats_leaves_nothing_and_what_is_unknown_is_not_known() -> None:
    assert escape_height(PARAMS, at(), air(wind_mps=12.0)) == -landing.DEEP_M
    assert isnan(escape_height(PARAMS, at(), air(wind_mps=nan)))
    nowhere = PARAMS._replace(place=PLACE._replace(length_m=0.0))
    assert isnan(escape_height(nowhere, at(), air()))
    blind = PARAMS._replace(polar=NO_POLAR)
    assert isnan(escape_height(blind, at(), air()))


@pytest.mark.parametrize("fastest_mps", [14.8, 14.9, 15.0, 15.1])
def test_the_fastest_speed_that_is_tried_is_one_of_the_polar(fastest_mps: float) -> None:
    """5.8 + (14.9 - 5.8) is more than 14.9 by rounding, and sink is not known there."""
    polar = POLAR._replace(speed_min_mps=5.0, speed_max_mps=fastest_mps)
    params = PARAMS._replace(polar=polar, speed_min_mps=4.0)
    far = at(x_m=170.0)  # 197 m ahead, 14 m high
    assert escape_height(params, far, air()) == -landing.DEEP_M
    assert approach_speed(params, landing.slowest(params), far, air()) == fastest_mps


def test_the_approach_is_as_slow_as_still_gets_there() -> None:
    distance = 21.0 - landing.FLOAT_S * (PARAMS.best_glide_mps - 7.0)
    assert approach_speed(PARAMS, SLOWEST, at(z_m=30.0), air()) == SLOWEST
    speed = approach_speed(PARAMS, SLOWEST, at(z_m=12.0), air())
    assert SLOWEST < speed < 12.0
    assert height_left(PARAMS, distance, 12.0, 8.5, speed, 7.0, 0.0) == pytest.approx(0.0, abs=0.1)
    assert height_left(PARAMS, distance, 12.0, 8.5, speed - 0.3, 7.0, 0.0) < 0.0
    assert approach_speed(PARAMS, SLOWEST, at(z_m=nan), air()) == PARAMS.best_glide_mps


def test_height_left_over_is_woven_off() -> None:
    high = at(x_m=-14.0, z_m=14.0)
    angle = weave(PARAMS, True, SLOWEST, nan, high, air(), False)
    assert angle > 0.3
    assert weave(PARAMS, False, SLOWEST, nan, high, air(), False) == -angle
    final_m = (landing.FINAL_M / polar_sink(POLAR, 9.2) + landing.FLOAT_S) * (9.2 - 7.0)
    over = 14.0 - landing.FINAL_M
    wanted = (13.0 - final_m) * polar_sink(POLAR, SLOWEST) / over
    assert wanted > 0.2
    kept = mean_cosine(angle, half_width(PARAMS, over, False), SLOWEST)
    assert SLOWEST * kept - 7.0 == pytest.approx(wanted, abs=0.05)
    assert weave(PARAMS, True, SLOWEST, nan, at(x_m=60.0, z_m=14.0), air(), False) == 0.0
    assert weave(PARAMS, True, SLOWEST, nan, at(x_m=-14.0, z_m=4.0), air(), False) == 0.0


def test_all_of_the_weave_would_stand_still_in_less_wind_than_it_flies_in() -> None:
    kept = mean_cosine(landing.WEAVE_RAD, landing.WEAVE_M, SLOWEST) * SLOWEST
    assert 2.2 < kept < 2.6


def test_the_weave_is_as_wide_as_there_is_height_and_a_fence() -> None:
    assert half_width(PARAMS, 4.0, False) == pytest.approx(4.0 * landing.WEAVE_WIDER)
    assert half_width(PARAMS, 40.0, False) == landing.WEAVE_M
    assert half_width(PARAMS._replace(side_max_m=3.0), 40.0, False) == 3.0
    assert half_width(PARAMS, -1.0, False) == 0.0


@pytest.mark.parametrize("veer_deg", [-60.0, -20.0, 0.0, 20.0, 60.0])
@pytest.mark.parametrize("bearing_deg", [-60.0, 0.0, 30.0, 60.0])
def test_no_nose_is_turned_towards_the_slope(bearing_deg: float, veer_deg: float) -> None:
    """To both sides, in so little wind that it turns as far as it may: not past abeam of the
    approach, nor to where the supervisor releases, wherever the wind comes from."""
    veer, bearing = radians(veer_deg), radians(bearing_deg)
    place = PLACE._replace(bearing_rad=bearing, x_m=-20.0, y_m=0.0)
    params = PARAMS._replace(place=place)
    met = air(wind_mps=2.0 * cos(veer), cross_wind_mps=-2.0 * sin(veer), airspeed_mps=SLOWEST)
    high = at(x_m=-25.0, z_m=40.0)
    for right in (True, False):
        angle = weave(params, right, SLOWEST, nan, high, met, False)
        state = NO_GLIDE._replace(speed_mps=SLOWEST, goes_right=right, weave_rad=angle)
        setpoints = glide_setpoints(params, state, False, True, pitched(0.0), high, met, inf)
        side = 1.0 if right else -1.0
        most = pi / 2.0 + side * bearing
        least = min(landing.WEAVE_RAD, most - max(0.0, side * veer))
        if least > WEAVE_MIN_RAD:
            assert side * setpoints.heading_rad == pytest.approx(least, abs=0.01)
            assert side * setpoints.heading_rad <= most + 1e-9
        else:
            assert angle == 0.0


def touch_down(
    wind_mps: float,
    x_m: float,
    z_m: float,
    falls: float = 0.0,
    *,
    params: LandingParams = PARAMS,
    lag_s: float = 0.0,
    wrong_mps: float = 0.0,
    cross_mps: float = 0.0,
) -> tuple[float, float]:
    """How far beyond the place and to the right of it [m] it touches down, as a point
    that does as commanded; falls: the fraction of the wind gone at the ground, evenly from 14 m on;
    lag_s: of the nose; wrong_mps: by which the wind is taken for more than it is; cross_mps: wind
    to the right."""
    state, speed, y_m, psi = NO_GLIDE, SLOWEST, 0.0, 0.0
    sinks = polar_sink(POLAR, speed)
    for k in range(round(150.0 / DT)):
        u = wind_mps * (1.0 - falls * max(0.0, 1.0 - z_m / 14.0))
        vehicle = at(k * DT, x_m=x_m, y_m=y_m, z_m=z_m, climb_mps=-sinks)
        met = air(airspeed_mps=speed, wind_mps=u + wrong_mps, cross_wind_mps=cross_mps)
        state, _ = glide_step(params, state, False, True, vehicle, met, z_m, False, DT)
        setpoints = glide_setpoints(params, state, False, True, pitched(0.0), vehicle, met, z_m)
        wanted_rad = asin(max(-1.0, min(1.0, (setpoints.sideways_mps - cross_mps) / speed)))
        psi += (wanted_rad - psi) * min(1.0, DT / max(DT, lag_s))
        y_m += (speed * sin(psi) + cross_mps) * DT
        if state.flares:
            wanted = max(landing.SINK_MPS, z_m / landing.FLARE_S)
            sinks = (polar_sink(POLAR, speed) + landing.KF * wanted) / (1.0 + landing.KF)
            speed -= DT * G / speed * (polar_sink(POLAR, speed) - sinks)
        else:
            sinks = polar_sink(POLAR, speed)
            z_m -= (state.speed_mps**2 - speed**2) / (2.0 * G)
            speed = state.speed_mps
        x_m -= (speed * cos(psi) - u) * DT
        z_m -= sinks * DT
        if z_m <= 0.0:
            return params.place.x_m - x_m, y_m - params.place.y_m
    return inf, inf


def touched_down(wind_mps: float, x_m: float, z_m: float, falls: float = 0.0, **more: Any) -> float:
    """How far beyond the place."""
    return touch_down(wind_mps, x_m, z_m, falls, **more)[0]


@pytest.mark.parametrize(
    ("wind_mps", "x_m", "z_m"),
    [(7.0, -14.0, 14.0), (7.4, -20.0, 10.0), (6.5, -9.0, 14.0), (7.0, -9.0, 14.0)],
)  # fmt: skip
def test_it_touches_down_at_the_place(wind_mps: float, x_m: float, z_m: float) -> None:
    """From higher than the slowest glide needs, and from where it must hurry."""
    assert abs(touched_down(wind_mps, x_m, z_m)) < 1.5


HIGH = PARAMS._replace(place=PLACE._replace(x_m=-80.0))


@pytest.mark.parametrize("wind_mps", [5.5, 6.0, 6.5, 7.0, 8.0, 9.0])
def test_from_a_high_hill_it_touches_down_at_the_place_too(wind_mps: float) -> None:
    """From 50 m, two metres upstream of a foot at −38 m: half a minute of glide too many."""
    assert abs(touched_down(wind_mps, -38.0, 50.0, params=HIGH, lag_s=0.7)) < 4.0


@pytest.mark.parametrize("veer_deg", [-30.0, -15.0, 15.0, 30.0])
@pytest.mark.parametrize("wind_mps", [6.5, 7.5, 8.5])
def test_in_a_wind_across_it_touches_down_at_the_place(wind_mps: float, veer_deg: float) -> None:
    """The same, in a wind that comes from one side: as near as a landing is to be."""
    veer = radians(veer_deg)
    cross_mps, params = -wind_mps * sin(veer), HIGH._replace(heading_max_rad=radians(60.0))
    beyond_m, right_m = touch_down(
        wind_mps * cos(veer), -38.0, 50.0, params=params, lag_s=0.7, cross_mps=cross_mps
    )
    assert abs(beyond_m) < 10.0
    assert abs(right_m) < 5.0


@pytest.mark.parametrize(("wrong_mps", "most_m"), [(-1.0, 12.0), (1.0, 12.0), (-2.0, 24.0)])
def test_a_wind_that_is_wrong_carries_it_no_farther_than_it_is_wrong(
    wrong_mps: float, most_m: float
) -> None:
    """Twelve seconds of it: the straight rest and the flare, and the last way from side to side and
    back, which the height over the rest no longer corrects."""
    found = touched_down(6.5, -38.0, 50.0, params=HIGH, lag_s=0.7, wrong_mps=wrong_mps)
    assert abs(found) < most_m


def test_what_is_too_near_or_loses_the_wind_is_flown_over() -> None:
    """The weave has an end, and no brake helps it."""
    assert touched_down(4.0, -20.0, 12.0) > 10.0
    assert touched_down(3.0, -38.0, 50.0, params=HIGH) > 20.0
    assert 2.0 < touched_down(7.0, -14.0, 14.0, 0.2) < 8.0


def advance(chi: float, over_m: float) -> float:
    """What a weave that far off the wind advances by [m/s], at a height over the straight rest."""
    return SLOWEST * mean_cosine(abs(chi), half_width(PARAMS, over_m, False), SLOWEST) - 7.0


def test_what_the_air_slows_has_more_time() -> None:
    """It advances by less for as much as it sinks by less, never by more than in still air."""
    sink, high = polar_sink(POLAR, SLOWEST), at(x_m=-14.0, z_m=14.0)

    def advances(sinks_mps: float) -> float:
        chi = weave(PARAMS, True, SLOWEST, sinks_mps, high, air(), False)
        return advance(chi, 14.0 - landing.FINAL_M)

    still = advances(nan)
    assert 0.2 < still < 1.0
    assert advances(0.5 * sink) == pytest.approx(0.5 * still, abs=0.05)
    assert advances(2.0 * sink) == pytest.approx(still)


def test_a_flare_without_an_airspeed_is_trimmed_for_the_speed_that_is_held() -> None:
    """A speed that is no number would be taken for the fastest: a nose that goes down."""
    held = NO_GLIDE._replace(speed_mps=8.2)
    for airspeed, least, most in ((7.9, 7.9, 7.9), (nan, 8.0, 8.4)):
        met = air(airspeed_mps=airspeed)
        vehicle = at(z_m=0.4, climb_mps=-0.6)
        _, speed = glide_step(PARAMS, held, False, True, vehicle, met, 0.4, False, DT)
        assert least <= speed <= most


def test_it_turns_back_so_that_it_stays_near_the_approach() -> None:
    state, setpoints = NO_GLIDE, airspeed_hold.GlideSetpoints(0.0, 0.0, 0.0, 0.0)
    y = worst = 0.0
    for k in range(round(20.0 / DT)):
        vehicle = at(k * DT, x_m=-14.0, y_m=y, z_m=14.0)
        now = air(airspeed_mps=SLOWEST)
        state, _ = glide_step(PARAMS, state, False, True, vehicle, now, 14.0, False, DT)
        setpoints = glide_setpoints(PARAMS, state, False, True, pitched(-0.02), vehicle, now, 14.0)
        y += setpoints.sideways_mps * DT
        worst = max(worst, abs(y)) if k > 1000 else worst
    assert 3.0 < worst < landing.WEAVE_M + 0.5


def test_near_the_straight_rest_it_stays_near_the_middle() -> None:
    """From as far off as it is high over that, it comes back before it gets there."""
    for height in (landing.FINAL_M + 1.0, landing.FINAL_M + 3.0):
        state = NO_GLIDE._replace(weave_rad=0.3, goes_right=True)
        y = half_width(PARAMS, height - landing.FINAL_M, False)
        vehicle = at(x_m=-14.0, y_m=y, z_m=height)
        state, _ = glide_step(PARAMS, state, False, True, vehicle, air(), height, False, DT)
        assert not state.goes_right
        vehicle = at(x_m=-14.0, y_m=0.0, z_m=14.0)
        state, _ = glide_step(
            PARAMS, state._replace(goes_right=True), False, True, vehicle, air(), 14.0, False, DT
        )
        assert state.goes_right


def test_it_looks_upwind_when_the_straight_rest_begins() -> None:
    """As far off the wind as it can turn back from until a metre below that, and no farther."""
    sink = polar_sink(POLAR, SLOWEST)
    for over in (0.1, 0.5, 8.0):
        near = at(x_m=-26.0, z_m=landing.FINAL_M + over)
        chi = weave(PARAMS, True, SLOWEST, nan, near, air(), False)
        back_s = (over + landing.STRAIGHT_BY_M) / sink
        assert 0.2 < chi <= WEAVE_RADPS * back_s + 1e-9
        assert chi <= landing.WEAVE_RAD


def test_a_flare_covers_as_much_more_as_is_planned() -> None:
    """Integrated step by step at one speed: how much later than a glide it is on the ground."""
    sink = polar_sink(POLAR, PARAMS.best_glide_mps)
    height, gone_s = sink * landing.FLARE_S, 0.0
    while height > 1e-6 and gone_s < 9.0:
        height -= 1e-4 * (sink + landing.KF * height / landing.FLARE_S) / (1.0 + landing.KF)
        gone_s += 1e-4
    assert gone_s - landing.FLARE_S == pytest.approx(landing.FLOAT_S, abs=0.01)
    planned = landing.float_length(PARAMS, 7.0)
    assert planned == pytest.approx(landing.FLOAT_S * (PARAMS.best_glide_mps - 7.0))
    assert landing.float_length(PARAMS, 10.0) == 0.0  # it gets nowhere


def test_a_slow_aircraft_does_not_turn() -> None:
    state = NO_GLIDE._replace(speed_mps=SLOWEST, weave_rad=0.5)
    slow = air(airspeed_mps=SLOWEST - 1.0)
    for k in range(300):
        vehicle = at(k * DT, x_m=-14.0, z_m=14.0)
        state, _ = glide_step(PARAMS, state, False, True, vehicle, slow, 14.0, False, DT)
    assert state.weave_rad == 0.0


def test_what_the_air_carries_is_not_woven_off_there() -> None:
    """It goes on upstream, even where it is beyond the straight rest's beginning."""
    sink = polar_sink(POLAR, SLOWEST)
    for x_m in (-14.0, -30.0):
        high = at(x_m=x_m, z_m=14.0)
        carried = weave(PARAMS, True, SLOWEST, 0.2 * sink, high, air(), False)
        over = 14.0 - landing.FINAL_M
        assert advance(carried, over) == pytest.approx(landing.OUT_MPS, abs=0.05)
        assert weave(PARAMS, True, SLOWEST, 0.6 * sink, high, air(), False) > carried
    state = NO_GLIDE
    for k in range(round(10.0 / DT)):
        vehicle = at(k * DT, x_m=-14.0, z_m=14.0, climb_mps=-1.0 if k * DT < 3.0 else 0.2)
        state, _ = glide_step(PARAMS, state, False, True, vehicle, air(), 14.0, False, DT)
        if k * DT < 3.0:
            assert state.sink_mps == pytest.approx(1.0)
    assert state.sink_mps == pytest.approx(
        -0.2 + 1.2 * exp(-7.0 / airspeed_hold.AVERAGE_S), abs=0.01
    )


@pytest.mark.parametrize("speed_mps", [nan, 7.0, 9.5, 14.0])
def test_an_airspeed_that_is_not_measured_lowers_the_nose_and_does_not_raise_it_beyond_the_slowest(
    speed_mps: float,
) -> None:
    state = NO_GLIDE._replace(speed_mps=8.4, integral_rad=0.05)
    pitches = pitched(-0.04, slowest_rad=-0.01, fastest_rad=-0.13)
    found = [
        glide_setpoints(
            PARAMS, state, False, True, pitches, at(), air(airspeed_mps=speed_mps, measured=it), inf
        ).pitch_rad
        for it in (True, False)
    ]
    free = 0.01 + (airspeed_hold.KP * (speed_mps - 8.4) if isfinite(speed_mps) else 0.0)
    assert found == pytest.approx([free, min(free, -0.01)])


def held(
    seconds: float,
    state: GlideState,
    start_s: float = 0.0,
    *,
    climb_mps: float = -2.5,
    nose_held: bool = True,
    confident: bool = True,
) -> GlideState:
    """Weaving high, tick by tick."""
    for k in range(round(seconds / DT)):
        vehicle = at(start_s + k * DT, x_m=-14.0, z_m=14.0, climb_mps=climb_mps)
        state, _ = glide_step(PARAMS, state, False, confident, vehicle, air(), 14.0, nose_held, DT)
    return state


def test_a_stall_is_recognised_by_the_elevator_and_ends_with_the_nose_down() -> None:
    flown = held(2.0, NO_GLIDE, nose_held=False)
    assert abs(flown.weave_rad) > 0.3
    almost = held(airspeed_hold.STALL_S - 2.0 * DT, flown, 2.0)
    assert not almost.stalled
    stalled = held(airspeed_hold.STALL_S, flown, 2.0)
    assert stalled.stalled
    pitches = pitched(-0.04, slowest_rad=-0.01, fastest_rad=-0.13)
    setpoints = glide_setpoints(PARAMS, stalled, False, True, pitches, at(), air(), 14.0)
    assert setpoints.pitch_rad <= -0.13
    nothing = glide_setpoints(PARAMS, stalled, False, True, pitched(nan), at(), air(), 14.0)
    assert nothing.pitch_rad <= PARAMS.glide_pitch_rad
    after = held(airspeed_hold.RECOVER_S + DT, stalled, 3.0, nose_held=False)
    assert after.recovers_s == 0.0
    setpoints = glide_setpoints(PARAMS, after, False, True, pitches, at(), air(), 14.0)
    assert setpoints.pitch_rad > -0.13
    later = held(3.0, after, 5.0, nose_held=False)
    assert later.weave_rad == 0.0  # not on this way home
    assert later.speed_mps == pytest.approx(PARAMS.best_glide_mps)


def test_what_is_no_stall() -> None:
    sink = polar_sink(POLAR, SLOWEST)
    for climb, nose_held in ((-2.5, False), (-sink - 0.4, True), (1.0, True)):
        assert not held(5.0, NO_GLIDE, climb_mps=climb, nose_held=nose_held).stalled
    assert held(5.0, NO_GLIDE, climb_mps=0.0, confident=False).stalled  # its sink is unknown
    flaring = NO_GLIDE
    for k in range(400):
        vehicle = at(k * DT, z_m=1.5, climb_mps=-2.5)
        flaring, _ = glide_step(PARAMS, flaring, False, True, vehicle, air(), 1.5, True, DT)
        assert flaring.flares
    assert not flaring.stalled
    shaken = NO_GLIDE
    for k in range(20):  # gusts: half of the time
        shaken = held(0.3, shaken, 0.6 * k)
        shaken = held(0.3, shaken, 0.6 * k + 0.3, nose_held=False)
    assert not shaken.stalled


def test_speed_is_held_by_pitch() -> None:
    state = NO_GLIDE._replace(speed_mps=9.0)
    for speed, sign in ((10.0, 1.0), (8.0, -1.0)):
        setpoints = glide_setpoints(
            PARAMS, state, True, True, pitched(-0.03), at(), air(airspeed_mps=speed), inf
        )
        assert setpoints.pitch_rad == pytest.approx(-0.03 + sign * airspeed_hold.KP)
    state, _ = glide_step(PARAMS, state, True, True, at(), air(airspeed_mps=12.0), 10.0, False, 0.1)
    assert state.integral_rad > 0.0


def test_the_flare_holds_a_sink_that_dies_out() -> None:
    falling = at(z_m=1.0, climb_mps=-1.4)
    state, _ = glide_step(PARAMS, NO_GLIDE, False, True, falling, air(), 1.0, False, DT)
    assert state.flares
    setpoints = glide_setpoints(PARAMS, state, False, True, pitched(-0.03), falling, air(), 1.0)
    assert setpoints.pitch_rad == pytest.approx(-0.03 + landing.KF * (1.4 - 1.0) / 8.5)
    state, _ = glide_step(PARAMS, NO_GLIDE, False, True, falling, air(), 1.6, False, DT)
    assert not state.flares
    # Without a known ground the height over the place counts.
    state, _ = glide_step(PARAMS, NO_GLIDE, False, True, falling, air(), inf, False, DT)
    assert state.flares


def test_it_returns_to_the_approach_and_into_the_bearing() -> None:
    state = NO_GLIDE._replace(speed_mps=9.0)
    right = glide_setpoints(PARAMS, state, False, True, pitched(0.0), at(y_m=2.0), air(), inf)
    assert right.sideways_mps == pytest.approx(-2.0 / landing.CROSS_S)
    assert right.heading_rad == pytest.approx(-sin(1.0 / 8.5), abs=0.01)
    b = radians(30.0)
    turned = PARAMS._replace(place=PLACE._replace(y_m=0.0, bearing_rad=b))
    x, y = -27.0 + 20.0 * cos(b), -20.0 * sin(b)
    setpoints = glide_setpoints(
        turned, state, False, True, pitched(0.0), at(x_m=x, y_m=y), air(), inf
    )
    v = sqrt(8.5**2 - (7.0 * sin(b)) ** 2) - 7.0 * cos(b)
    assert setpoints.sideways_mps == pytest.approx(v * sin(b))


def test_without_a_position_it_glides_straight_on() -> None:
    state, speed = glide_step(PARAMS, NO_GLIDE, False, False, at(), air(), inf, False, DT)
    setpoints = glide_setpoints(
        PARAMS, state, False, False, pitched(-0.03), at(y_m=9.0), air(), inf
    )
    assert (setpoints.heading_rad, setpoints.sideways_mps) == (0.0, 0.0)
    assert speed == pytest.approx(8.5, abs=0.1)


@pytest.mark.parametrize("best_mps", [0.0, 5.0, 9.2, 30.0])
def test_the_glide_is_a_number_whatever_the_best_speed_and_the_polar_are(best_mps: float) -> None:
    for polar in (POLAR, NO_POLAR, POLAR._replace(c0=0.0, c1=0.0, c2=0.0, c3=0.0)):
        params = PARAMS._replace(best_glide_mps=best_mps, polar=polar)
        for now in (air(), NO_AIR, air(airspeed_mps=0.0)):
            for height in (0.2, 14.0):
                vehicle = at(x_m=-14.0, z_m=height)
                glide, _ = glide_step(
                    params, NO_GLIDE, False, True, vehicle, now, height, False, DT
                )
                setpoints = glide_setpoints(
                    params, glide, False, True, pitched(nan), vehicle, now, height
                )
                assert isfinite(
                    setpoints.pitch_rad + setpoints.heading_rad + setpoints.sideways_mps
                )
