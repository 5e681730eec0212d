"""Beating along the ridge: to and fro in the line's plane, and turned into the wind at each end."""

from __future__ import annotations

from math import atan2, cos, hypot, inf, isfinite, nan, pi, radians, sin, tan
from statistics import fmean
from typing import Any, NamedTuple

import pytest
from test_landing import DT, PARAMS, POLAR, SLOWEST, air, at

from tgl_soar.control import ridge_beat
from tgl_soar.control.airspeed_hold import (
    NO_GLIDE,
    RECOVER_S,
    STALL_S,
    GlidePitches,
    GlideState,
)
from tgl_soar.control.ridge_beat import (
    BACK_BY_MPS,
    BACK_MPS,
    BACK_S,
    BANK_RAD,
    LEG_MPS,
    MIDDLE_M,
    MOST_RAD,
    NO_BEAT,
    OUT_MPS,
    RETURN_S,
    STRAIGHT_RAD,
    TOP_M,
    TURN_RADPS,
    VEER_BY_RAD,
    VEER_S,
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
from tgl_soar.control.target_line import TargetLine, e_rho
from tgl_soar.types import AirEstimate

BEAT = BeatParams(
    asked=False,
    auto=True,
    aside=True,
    half_width_m=40.0,
    top_z_m=90.0,
    veer_max_rad=radians(45.0),
)
TARGET = TargetLine(-20.0, 40.0, radians(105.0))
PITCHES = GlidePitches(wanted_rad=-0.05, slowest_rad=-0.03, fastest_rad=-0.15, most_alpha_rad=nan)


class Way(NamedTuple):
    """Where it flew, with its nose where; sampled at each tick."""

    off_m: list[float]
    y_m: list[float]
    nose_rad: list[float]
    state: GlideState


def beaten(
    wind_mps: float,
    cross_mps: float = 0.0,
    seconds: float = 120.0,
    *,
    lag_s: float = 1.0,
    returns_after_s: float = inf,
    params: BeatParams = BEAT,
    off_m: float = 0.0,
) -> Way:
    """A point that flies at the airspeed asked for; its nose follows by lag_s."""
    state, x, y, nose = NO_GLIDE, TARGET.x_m + off_m, 0.0, 0.0
    found: tuple[list[float], list[float], list[float]] = ([], [], [])
    dt = 0.02
    for k in range(round(seconds / dt)):
        speed = state.speed_mps if isfinite(state.speed_mps) else SLOWEST
        feels = air(airspeed_mps=speed, wind_mps=wind_mps, cross_wind_mps=cross_mps)
        vehicle = at(k * dt, x_m=x, y_m=y, z_m=TARGET.z_m, heading_rad=nose)
        returns = k * dt >= returns_after_s
        state, trims = beat_step(
            params, PARAMS, TARGET, state, returns, True, vehicle, feels, False, dt
        )
        assert trims == state.speed_mps
        wanted = beat_setpoints(PARAMS, state, True, PITCHES, feels)
        nose += (wanted.heading_rad - nose) * dt / lag_s
        x -= (speed * cos(nose) - wind_mps) * dt
        y += (speed * sin(nose) + cross_mps) * dt
        for row, value in zip(found, (x - TARGET.x_m, y, nose), strict=True):
            row.append(value)
    return Way(*found, state)


@pytest.mark.parametrize(
    ("wind_mps", "width_m"), [(3.5, 120.0), (5.0, 40.0), (6.5, 40.0), (7.5, 40.0)]
)
@pytest.mark.parametrize("cross_mps", [0.0, 2.5, -2.5])
def test_it_flies_to_and_fro_in_the_plane(
    wind_mps: float, width_m: float, cross_mps: float
) -> None:
    way = beaten(wind_mps, cross_mps, 240.0, params=BEAT._replace(half_width_m=width_m))
    late = slice(len(way.y_m) // 4, None)
    assert width_m - 14.0 < max(way.y_m[late]) < width_m + 8.0
    assert -width_m - 8.0 < min(way.y_m[late]) < 14.0 - width_m
    assert max(way.off_m[late]) < 0.5  # towards the slope
    assert min(way.off_m[late]) > -20.0  # in a turn
    assert -14.0 < fmean(way.off_m[late]) < 0.0  # the less wind, the farther a turn takes it
    ways = sum(a * b < 0.0 for a, b in zip(way.y_m, way.y_m[1:], strict=False))
    assert ways >= 6
    # It turns into the wind, and never looks at the slope.
    assert max(map(abs, way.nose_rad)) <= MOST_RAD + 1e-9
    crossings = [k for k in range(1, len(way.y_m)) if way.nose_rad[k - 1] * way.nose_rad[k] < 0.0]
    assert crossings
    assert all(abs(way.y_m[k]) > width_m - 15.0 for k in crossings[1:])


def test_in_too_little_wind_for_its_width_it_drifts_away_from_the_slope() -> None:
    way = beaten(3.0, seconds=240.0)
    assert way.off_m[-1] < -20.0
    assert max(way.off_m) < 1.0


@pytest.mark.parametrize("off_m", [-15.0, 6.0])
def test_it_comes_back_into_the_plane(off_m: float) -> None:
    way = beaten(6.0, seconds=12.0, off_m=off_m, params=BEAT._replace(half_width_m=500.0))
    assert abs(way.off_m[-1]) < 0.3 * abs(off_m)
    speeds = [(b - a) / 0.02 for a, b in zip(way.off_m, way.off_m[1:], strict=False)]
    assert max(speeds) <= BACK_MPS + 0.3
    settled = beaten(6.0, seconds=40.0, off_m=off_m, params=BEAT._replace(half_width_m=500.0))
    assert abs(settled.off_m[-1]) < 0.1


def test_the_plane_leans_as_the_line_does() -> None:
    for z in (30.0, 40.0, 55.0):
        x = TARGET.x_m + (z - TARGET.z_m) / tan(TARGET.eta_rad)
        assert e_rho(*TARGET, x, z) == pytest.approx(0.0, abs=1e-12)
        assert off_plane(TARGET, at(x_m=x, z_m=z)) == pytest.approx(0.0, abs=1e-12)
        assert off_plane(TARGET, at(x_m=x + 3.0, z_m=z)) == pytest.approx(3.0)


def one(
    vehicle: dict[str, Any] | None = None,
    air_now: dict[str, Any] | None = None,
    state: GlideState = NO_GLIDE,
    *,
    ticks: int = 1,
    **options: Any,
) -> GlideState:
    usual: dict[str, Any] = {"returns": False, "position_ok": True, "nose_held": False}
    now = usual | options
    for k in range(ticks):
        state, _ = beat_step(
            BEAT,
            PARAMS,
            TARGET,
            state,
            now["returns"],
            now["position_ok"],
            at(k * DT, **({"x_m": -20.0, "z_m": 40.0} | (vehicle or {}))),
            air(**({"airspeed_mps": SLOWEST, "wind_mps": 6.0} | (air_now or {}))),
            now["nose_held"],
            DT,
        )
    return state


LONG = round(6.0 / DT)


def test_what_of_the_airspeed_is_left_upwind_is_the_winds() -> None:
    state = one(ticks=LONG)
    assert SLOWEST * cos(state.weave_rad) == pytest.approx(6.0)
    behind = one({"x_m": -20.0 + 0.5 * RETURN_S}, ticks=LONG)
    assert SLOWEST * cos(behind.weave_rad) == pytest.approx(6.5)
    before = one({"x_m": -20.0 - 100.0}, ticks=LONG)
    assert SLOWEST * cos(before.weave_rad) == pytest.approx(6.0 - BACK_MPS)
    far = one({"x_m": -20.0 + 100.0}, {"wind_mps": 5.0}, ticks=LONG)
    assert SLOWEST * cos(far.weave_rad) == pytest.approx(5.0 + OUT_MPS)
    # In next to no wind it does not look along the ridge, nor at the slope.
    assert one(None, {"wind_mps": 1.0}, ticks=LONG).weave_rad == MOST_RAD


def test_it_turns_no_faster_than_it_can() -> None:
    assert one().weave_rad == pytest.approx(TURN_RADPS * DT)
    assert one(ticks=10).weave_rad == pytest.approx(10 * TURN_RADPS * DT)


def test_against_the_wind_along_the_ridge_it_flies_faster() -> None:
    slow = one(None, {"wind_mps": 8.3}, ticks=LONG)
    assert slow.speed_mps == pytest.approx(hypot(8.3, LEG_MPS), abs=0.01)
    with_it = one(None, {"wind_mps": 6.0, "cross_wind_mps": 4.0}, ticks=LONG)
    assert with_it.speed_mps == pytest.approx(SLOWEST)
    against = one(None, {"wind_mps": 6.0, "cross_wind_mps": -4.0}, ticks=LONG)
    assert against.speed_mps == pytest.approx(hypot(6.0, LEG_MPS + 4.0), abs=0.01)
    assert one(None, {"wind_mps": 20.0}, ticks=LONG).speed_mps == POLAR.speed_max_mps
    assert one(None, {"wind_mps": 20.0}, ticks=LONG).weave_rad == 0.0


def test_its_turns_are_steeper_within_the_tilt_that_hands_over() -> None:
    usual = radians(10.0)
    assert beat_bank(usual, radians(60.0)) == pytest.approx(BANK_RAD)
    assert beat_bank(usual, radians(30.0)) == pytest.approx(radians(15.0))
    assert beat_bank(usual, radians(10.0)) == usual
    assert beat_bank(radians(40.0), radians(60.0)) == pytest.approx(radians(40.0))


def test_towards_the_fences_top_it_flies_as_fast_as_it_may() -> None:
    plane = (BEAT.top_z_m - 0.5 * TOP_M - TARGET.z_m) / tan(TARGET.eta_rad)
    half = one({"z_m": BEAT.top_z_m - 0.5 * TOP_M, "x_m": -20.0 + plane}, ticks=LONG)
    assert half.speed_mps == pytest.approx(0.5 * (SLOWEST + POLAR.speed_max_mps))
    assert one({"z_m": BEAT.top_z_m}, ticks=LONG).speed_mps == POLAR.speed_max_mps


@pytest.mark.parametrize(
    ("vehicle", "air_now", "options"),
    [
        ({}, {"wind_mps": nan}, {}),
        ({}, {}, {"position_ok": False}),
        ({"x_m": nan}, {}, {}),
        ({"x_m": inf}, {}, {}),
        ({"y_m": nan}, {"wind_mps": nan}, {}),
    ],
)
def test_what_is_not_known_is_flown_straight_upwind(
    vehicle: dict[str, Any], air_now: dict[str, Any], options: dict[str, Any]
) -> None:
    state = one(vehicle, air_now, one(ticks=LONG), ticks=LONG, **options)
    assert state.weave_rad == 0.0
    assert isfinite(state.speed_mps)
    setpoints = beat_setpoints(PARAMS, state, False, PITCHES, air(**air_now))
    assert (setpoints.heading_rad, setpoints.sideways_mps) == (0.0, 0.0)


def test_a_stall_that_came_all_the_same_is_flown_out_of() -> None:
    falls = {"climb_mps": -4.0}
    state = one(falls, ticks=round(STALL_S / DT) + 1, nose_held=True)
    assert state.stalled
    assert RECOVER_S - 0.1 < state.recovers_s <= RECOVER_S
    setpoints = beat_setpoints(PARAMS, state, True, PITCHES, air())
    assert setpoints.pitch_rad <= PITCHES.fastest_rad
    assert one(falls, state=state, ticks=LONG).speed_mps == pytest.approx(PARAMS.best_glide_mps)


def test_the_setpoints_lead_along_the_ridge_with_the_wind_that_blows_there() -> None:
    state = one(ticks=LONG)
    air_now = air(airspeed_mps=SLOWEST, wind_mps=6.0, cross_wind_mps=-1.5)
    setpoints = beat_setpoints(PARAMS, state, True, PITCHES, air_now)
    assert setpoints.heading_rad == state.weave_rad
    assert setpoints.sideways_mps == pytest.approx(SLOWEST * sin(state.weave_rad) - 1.5)
    assert setpoints.pitch_rad == pytest.approx(PITCHES.wanted_rad + state.integral_rad, abs=0.01)


def test_it_returns_to_the_middle_and_into_the_wind() -> None:
    way = beaten(6.0, seconds=90.0, returns_after_s=60.0)
    assert way.nose_rad[-1] == pytest.approx(0.0, abs=0.01)
    straight = next(k for k in range(3000, 4500) if abs(way.nose_rad[k]) < STRAIGHT_RAD)
    while abs(way.nose_rad[straight]) >= STRAIGHT_RAD or abs(way.y_m[straight]) > MIDDLE_M:
        straight += 1
    assert straight < 4000  # within twenty seconds


@pytest.mark.parametrize(
    "y_m", [0.0, MIDDLE_M - 0.1, -MIDDLE_M + 0.1, MIDDLE_M + 0.1, -MIDDLE_M - 0.1]
)
@pytest.mark.parametrize("cross_mps", [0.0, 3.0])
def test_it_is_back_where_a_line_can_be_captured(y_m: float, cross_mps: float) -> None:
    air_now = air(wind_mps=8.0, cross_wind_mps=cross_mps)
    upwind = atan2(-cross_mps, 8.0)
    for nose, points in ((0.0, True), (STRAIGHT_RAD + 0.01, False), (-STRAIGHT_RAD - 0.01, False)):
        vehicle = at(y_m=y_m, heading_rad=upwind + nose)
        assert is_back(vehicle, air_now) == (points and abs(y_m) < MIDDLE_M)
    assert not is_back(at(heading_rad=nan), air_now)
    assert not is_back(at(y_m=nan), air_now)


# --- when -----------------------------------------------------------------------------------


def watched(air_now: AirEstimate, seconds: float, state: BeatState = NO_BEAT) -> BeatState:
    for _ in range(round(seconds / 0.05)):
        state = beat_watch(BEAT, PARAMS, state, air_now, 0.05)
    return state


STRONG = POLAR.speed_min_mps + BACK_BY_MPS + 0.01


@pytest.mark.parametrize(
    ("air_now", "stands"),
    [
        ({"wind_mps": STRONG}, True),
        ({"wind_mps": STRONG - 0.02}, False),
        ({"wind_mps": 6.0, "cross_wind_mps": 5.8}, True),  # the nose goes into it
        ({"wind_mps": nan}, False),
        ({"wind_mps": 8.0, "cross_wind_mps": 12.0}, False),  # too far aside
    ],
)
def test_it_stands_again_in_a_wind_that_lasts(air_now: dict[str, float], stands: bool) -> None:
    for seconds, long in ((BACK_S - 0.2, False), (BACK_S + 0.2, True)):
        state = watched(air(**air_now), seconds)
        assert is_wanted_back(BEAT, state) == (stands and long)
        assert not is_wanted_back(BEAT._replace(asked=True), state)
        assert is_wanted_back(BEAT._replace(auto=False), state)
    # A gust is no lull; a lull counts from the beginning.
    lasting = watched(air(wind_mps=8.8), BACK_S + 1.0)
    assert is_wanted_back(BEAT, watched(air(wind_mps=5.0), 0.3, lasting))
    lull = watched(air(wind_mps=5.0), 2.0, lasting)
    assert lull.stands_s == 0.0
    assert not is_wanted_back(BEAT, watched(air(wind_mps=8.8), BACK_S - 1.0, lull))


@pytest.mark.parametrize("angle_deg", [59.0, 61.0, 90.0, 135.0, 180.0, -61.0])
def test_it_does_not_stand_again_in_a_wind_along_the_ridge_or_from_behind_it(
    angle_deg: float,
) -> None:
    """Nor where nothing else asks how far aside it is."""
    params = BEAT._replace(aside=False)
    angle, state = radians(angle_deg), NO_BEAT
    air_now = air(wind_mps=12.0 * cos(angle), cross_wind_mps=12.0 * sin(angle))
    for _ in range(240):
        state = beat_watch(params, PARAMS, state, air_now, 0.05)
    assert is_wanted_back(params, state) == (abs(angle_deg) < 60.0)


def test_a_wind_from_too_far_aside_is_one_beyond_what_the_nose_follows() -> None:
    most = BEAT.veer_max_rad + VEER_BY_RAD
    for side in (1.0, -1.0):
        for angle, oblique in ((most + 0.01, True), (most - 0.01, False)):
            air_now = air(wind_mps=8.0 * cos(angle), cross_wind_mps=side * 8.0 * sin(angle))
            assert is_oblique(BEAT, air_now.wind_mps, air_now.cross_wind_mps) == oblique
            assert (watched(air_now, 1.0).oblique_s > 0.9) == oblique
    assert not is_oblique(BEAT._replace(veer_max_rad=0.0), 1.0, 9.0)
    assert not is_oblique(BEAT._replace(aside=False), 1.0, 9.0)
    assert watched(air(wind_mps=nan, cross_wind_mps=9.0), 1.0) == NO_BEAT
    still = watched(air(wind_mps=8.0), 4.0)
    gust = watched(air(wind_mps=8.0, cross_wind_mps=12.0), 2.0, still)
    assert gust.oblique_s == 0.0  # not on average yet
    assert watched(air(wind_mps=8.0, cross_wind_mps=12.0), 8.0, gust).oblique_s >= VEER_S


def test_its_numbers_are_argued() -> None:
    # Twice the lag of the nose: a second order with this damping.
    assert 0.6 < 0.5 * (RETURN_S / ridge_beat.LAG_S) ** 0.5 < 0.8
    assert pi / 2.0 - 0.35 < MOST_RAD < pi / 2.0
    # As long as a lull takes to come or to go is half too late, and a gust's five seconds too soon.
    assert 8.0 <= BACK_S <= 15.0
    # In lift of 2 m/s, the most that a slow wind makes, five seconds to gain 4 m/s of airspeed.
    assert 8.0 <= TOP_M <= 15.0
    # Within the bank that follows the sideways speed, and what the waypoint takes up.
    assert radians(15.0) >= STRAIGHT_RAD
    assert ridge_beat.NEAR_M < MIDDLE_M <= 20.0
    # As much bank as a turn of this rate needs at the best glide's speed.
    assert atan2(TURN_RADPS * PARAMS.best_glide_mps, 9.81) == pytest.approx(BANK_RAD, abs=0.05)
