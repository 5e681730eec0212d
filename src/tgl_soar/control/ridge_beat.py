"""Beating along the ridge: a stretch there and back, with a turn into the wind at each end.

An aircraft can stand on its line where the wind is as fast as it flies.  Where it is slower it can
still stay in the lift, as every slope pilot does: with the nose off the wind, so that what is left
of the airspeed upwind is the wind's, and the rest carries it along the ridge.  It flies to and fro
in the line's own plane:

    d     = x − x_line(z)                        downstream of the plane, at its height
    v_n   = d / RETURN_S                         upstream over the ground, BACK_MPS … OUT_MPS
    cos χ = (u + v_n) / V                        the nose from straight upwind, χ <= MOST_RAD
    v_y   = ± V sin χ + c                        along the ridge, to the right

u, c  m/s  wind downstream and to the right (`estimation.wind`, `estimation.cross_wind`)
V     m/s  airspeed: the slowest that is safe, and as much more as the leg needs to advance by
           LEG_MPS against the wind along the ridge; towards the fence's top as fast as it flies

The frame stands across the ridge, and with it the plane and the legs.  Height is whatever the air
gives: in lift the aircraft rises until the lift is as weak as its sink.  At each end it turns
through the wind, never towards the slope: while it does it advances by

    2 V sin χ / omega − 2 u χ / omega

which is the farther, the slower the wind is; on the next leg it falls back into the plane.
"""

from __future__ import annotations

from math import acos, atan2, cos, exp, hypot, radians, sin, tan
from typing import Final, NamedTuple

from tgl_soar.control.airspeed_error import airspeed_error_step, corrected_air
from tgl_soar.control.airspeed_hold import (
    GlidePitches,
    GlideSetpoints,
    GlideState,
    hold_step,
    incidence_step,
    speed_pitch,
    speed_setpoint,
    stall_step,
)
from tgl_soar.control.landing import LandingParams, slowest, slowest_known
from tgl_soar.control.target_line import TargetLine
from tgl_soar.control.wind_triangle import cross_wind
from tgl_soar.types import NAN, AirEstimate, VehicleState, polar_sink

# The nose and the path follow their setpoint by 1.4 s (`control.landing`): with twice that the way
# back to the plane is damped by 0.7.
RETURN_S: Final = 3.0
BACK_MPS: Final = 2.0  # downstream, at most: a turn's way is fallen back within one leg
OUT_MPS: Final = 2.0  # upstream, at most
LEG_MPS: Final = 2.0  # along the ridge over the ground, at least
MOST_RAD: Final = 1.4  # 80 degrees: a gust of 1.5 m/s across turns no nose beyond abeam
# A turn through the wind is to be short. Its acceleration is g tan of the bank, 0.32 g, and 0.4 g
# that lasts is what an attitude looks like that is wrong (`estimation.health`).
BANK_RAD: Final = radians(18.0)
TILT_FRACTION: Final = 0.5  # of TILT_MAX, likewise: gusts and overshoots have the other half
TURN_RADPS: Final = 0.4  # with the rudder's help; this bank alone turns by 0.35 at 9 m/s
LAG_S: Final = 1.4
TOP_M: Final = 10.0  # below the fence's top: from there on it flies faster
# Whether it can stand follows from the wind averaged over AVERAGE_S, as gusts of some seconds end
# nothing. It stands again in one that is faster than the polar's slow end by BACK_BY_MPS, for
# BACK_S: what ended standing was slower than that end by the wind's standard deviation, which is
# 0.3 m/s with a pitot tube and 0.9 without.
AVERAGE_S: Final = 3.0
BACK_S: Final = 10.0
BACK_BY_MPS: Final = 0.5
ASIDE_RATIO: Final = 0.5  # of it along the frame, at least: none stood in more than 60 degrees
STRAIGHT_RAD: Final = 0.2  # from the wind: as near as an engagement that captures at once
NEAR_M: Final = 5.0  # from the middle, where it turns into the wind to stand again
MIDDLE_M: Final = 15.0  # from the middle: half of what the virtual waypoint takes up in 30 s
VEER_BY_RAD: Final = 0.09  # 5 degrees beyond VEER_MAX, where the nose cannot follow
VEER_S: Final = 5.0


class BeatParams(NamedTuple):
    """Parameters of beating along the ridge."""

    asked: bool  # from now on
    auto: bool  # where the wind is too slow to stand in
    aside: bool  # where it comes from too far aside, too
    half_width_m: float  # to either side of the frame's middle; 0: it never does
    top_z_m: float  # of the fence
    veer_max_rad: float  # of standing; 0: the wind's direction is not estimated


class BeatState(NamedTuple):
    """What is remembered of whether it can stand."""

    wind_mps: float  # downstream, averaged; NaN: not known yet
    cross_wind_mps: float  # to the right, averaged
    oblique_s: float  # for so long the wind has come from too far aside
    stands_s: float  # for so long it has been as standing needs it


NO_BEAT: Final = BeatState(wind_mps=NAN, cross_wind_mps=0.0, oblique_s=0.0, stands_s=0.0)


def beat_watch(
    params: BeatParams, home: LandingParams, state: BeatState, air: AirEstimate, dt_s: float
) -> BeatState:
    """One tick of the watch in the air; what is not known is neither."""
    if air.wind_mps != air.wind_mps:
        return NO_BEAT
    wind, cross = state.wind_mps, state.cross_wind_mps
    if wind != wind:
        wind, cross = air.wind_mps, cross_wind(air)
    blend = 1.0 - exp(-dt_s / AVERAGE_S)
    wind += blend * (air.wind_mps - wind)
    cross += blend * (cross_wind(air) - cross)
    oblique = is_oblique(params, wind, cross)
    speed = hypot(wind, cross)
    stands = speed >= home.polar.speed_min_mps + BACK_BY_MPS and wind >= ASIDE_RATIO * speed
    stands = stands and not oblique
    return BeatState(
        wind_mps=wind,
        cross_wind_mps=cross,
        oblique_s=min(2.0 * VEER_S, state.oblique_s + dt_s) if oblique else 0.0,
        stands_s=min(2.0 * BACK_S, state.stands_s + dt_s) if stands else 0.0,
    )


def is_oblique(params: BeatParams, wind_mps: float, cross_wind_mps: float) -> bool:
    """Whether the wind comes from farther aside than the nose may follow, and that counts."""
    if params.veer_max_rad <= 0.0 or not params.aside:
        return False
    return abs(atan2(cross_wind_mps, wind_mps)) > params.veer_max_rad + VEER_BY_RAD


def is_wanted_back(params: BeatParams, state: BeatState) -> bool:
    """Whether it is to return to its line."""
    return not params.asked and (not params.auto or state.stands_s >= BACK_S)


def is_back(vehicle: VehicleState, air: AirEstimate) -> bool:
    """Whether the nose points into the wind, near the middle, so that a line can be captured."""
    veer = atan2(-cross_wind(air), air.wind_mps) if air.wind_mps > 0.0 else 0.0
    near = abs(vehicle.y_m) <= MIDDLE_M
    return near and abs(vehicle.heading_rad - veer) <= STRAIGHT_RAD  # false for NaN


def off_plane(target: TargetLine, vehicle: VehicleState) -> float:
    """d [m]: how far downstream of the line's plane the aircraft is, at its height."""
    leans = (vehicle.z_m - target.z_m) / tan(target.eta_rad)
    return vehicle.x_m - target.x_m - leans


def beat_step(
    params: BeatParams,
    home: LandingParams,
    target: TargetLine,
    state: GlideState,
    returns: bool,
    position_ok: bool,
    vehicle: VehicleState,
    air: AirEstimate,
    nose_held: bool,
    dt_s: float,
) -> tuple[GlideState, float]:
    """One tick; also the airspeed that its trim is for.

    returns: to the middle, and into the wind.  nose_held: as in `landing.glide_step`.
    """
    airspeed_error = state.airspeed_error
    if position_ok and not air.measured:
        airspeed_error = airspeed_error_step(airspeed_error, vehicle, air.airspeed_mps, dt_s)
    air = corrected_air(airspeed_error, air)
    low, high = slowest_known(home, air.measured), home.polar.speed_max_mps
    sink_mps = polar_sink(home.polar, slowest(home))
    state = stall_step(state, sink_mps, position_ok, nose_held, vehicle, dt_s)
    state = incidence_step(state, air, dt_s)
    wanted = max(low, home.best_glide_mps) if state.stalled else low
    speed = speed_setpoint(state, air.airspeed_mps, low, high, wanted)
    turned_m = _turned_off(state, speed, vehicle)
    goes_right, nose = _goes_right(params, state.goes_right, returns, turned_m), 0.0
    off_m = off_plane(target, vehicle)
    if position_ok and air.wind_mps > 0.0 and abs(off_m) < 1e6:  # false for NaN
        advance = air.wind_mps + max(-BACK_MPS, min(OUT_MPS, off_m / RETURN_S))
        side = 1.0 if goes_right else -1.0
        against = max(0.0, -side * cross_wind(air))
        wanted = max(wanted, min(high, hypot(advance, LEG_MPS + against)))
        over = (vehicle.z_m - params.top_z_m + TOP_M) / TOP_M
        wanted = max(wanted, low + (high - low) * max(0.0, min(1.0, over)))
        if not (returns and abs(turned_m) <= NEAR_M):
            nose = side * _nose_off(speed, advance)
    turn = TURN_RADPS * dt_s
    nose = state.weave_rad + max(-turn, min(turn, nose - state.weave_rad))
    state = hold_step(state, speed, wanted, False, air.airspeed_mps, dt_s)
    state = state._replace(weave_rad=nose, goes_right=goes_right, airspeed_error=airspeed_error)
    return state, state.speed_mps


def _nose_off(speed_mps: float, advance_mps: float) -> float:
    """χ [rad]."""
    if advance_mps >= speed_mps:
        return 0.0
    return min(MOST_RAD, acos(max(0.0, advance_mps) / speed_mps))


def _turned_off(state: GlideState, speed_mps: float, vehicle: VehicleState) -> float:
    """y [m] where the aircraft will be once it has turned into the wind."""
    turning_m = speed_mps * (1.0 - cos(state.weave_rad)) / TURN_RADPS
    off = vehicle.y_m + (turning_m if state.weave_rad > 0.0 else -turning_m)
    return off + LAG_S * speed_mps * sin(state.weave_rad)


def _goes_right(params: BeatParams, before: bool, returns: bool, turned_m: float) -> bool:
    """Which way: to the end, and from there to the other; or to the middle."""
    if returns:
        return turned_m < 0.0
    return turned_m < params.half_width_m if before else turned_m < -params.half_width_m


def beat_setpoints(
    home: LandingParams,
    state: GlideState,
    position_ok: bool,
    pitches: GlidePitches,
    air: AirEstimate,
) -> GlideSetpoints:
    """What follows of it."""
    air = corrected_air(state.airspeed_error, air)
    pitch = speed_pitch(state, pitches, home.glide_pitch_rad, air.airspeed_mps, air.measured)
    if not position_ok:
        return GlideSetpoints(pitch, 0.0, 0.0, 0.0)
    speed = air.airspeed_mps if air.airspeed_mps > 1.0 else max(1.0, home.best_glide_mps)
    sideways = speed * sin(state.weave_rad) + cross_wind(air)
    return GlideSetpoints(pitch, state.weave_rad, sideways, 0.0)


def beat_bank(bank_rad: float, tilt_max_rad: float) -> float:
    """The largest bank [rad] of its turns, where it is not more already."""
    return max(bank_rad, min(BANK_RAD, TILT_FRACTION * tilt_max_rad))
