"""A propeller in one tick: when it may be used, and what the estimators and the laws know of it."""

from __future__ import annotations

from typing import Final

from tgl_soar.control import supervisor as modes
from tgl_soar.control.envelope import Margins
from tgl_soar.control.estimates import Estimates
from tgl_soar.control.forecast import OUTSIDE, SETTLES, TOO_LOW, UNKNOWN, Forecast
from tgl_soar.control.glide_home import time_left
from tgl_soar.control.launch_landing import LaunchLandingState
from tgl_soar.control.laws import Laws
from tgl_soar.control.point_hold import BrakeEffect
from tgl_soar.control.soaring import SoaringGains
from tgl_soar.control.throttle import (
    ThrottleState,
    ThrottleView,
    can_hold,
    closed,
    throttle_step,
)
from tgl_soar.types import NAN, Inputs, VehicleState

# Of the modes in control those in which the pitch follows line or airspeed, so that power climbs.
# Recovering holds a pitch to gain speed: there it would carry the aircraft upstream, out of the
# fence.
POWERED: Final = (
    modes.CAPTURING,
    modes.SOARING,
    modes.SEARCHING,
    modes.BREAKING_OFF,
)
# Of the excess updraft, a third of a small glider's sink: who sinks by more does not soar, whatever
# is foreseen further down; gusts of 3 % make less of it, averaged as it is.
SOARS_LEAST_MPS: Final = -0.4


def with_push(laws: Laws, state: ThrottleState) -> Laws:
    """What the estimators read the air by: a propeller's pull is no force of the air's."""
    if state.push_mps2 == 0.0:
        return laws
    return laws._replace(
        wind=laws.wind._replace(push_mps2=state.push_mps2),
        forecast=laws.forecast._replace(pushed_mps=state.climb_mps),
    )


def with_power(
    gains: SoaringGains, effect: BrakeEffect, state: ThrottleState
) -> tuple[SoaringGains, BrakeEffect]:
    """The glide is turned up by power, and with it, at the same incidence, the pitch that holds the
    line and the highest that may be asked for."""
    up_rad = state.pitch_rad
    if up_rad == 0.0:
        return gains, effect
    pid = gains.pid._replace(output_max=gains.pid.output_max + up_rad)
    return gains._replace(pid=pid), BrakeEffect(effect.pitch_rad + up_rad, effect.elevator)


def power_conditions(
    laws: Laws, mode: int, state: ThrottleState, forecast: Forecast, estimates: Estimates
) -> int:
    """A place to settle is not needed as long as there is power to stay without."""
    if laws.throttle.budget_s <= 0.0 or not _is_sinking(forecast):
        return 0
    if not is_allowed(laws, mode, estimates):
        return 0
    holds = can_hold(laws.throttle, state.used_s, forecast.excess_mps, estimates.air.airspeed_mps)
    return modes.SETTLES if holds else 0


def power_step(
    laws: Laws,
    state: ThrottleState,
    mode: int,
    forecast: Forecast,
    launch_landing: LaunchLandingState,
    estimates: Estimates,
    dt_s: float,
) -> ThrottleState:
    """The throttle of a tick in control.  mode: as it was decided."""
    if laws.throttle.budget_s <= 0.0:
        return closed(laws.throttle, state, dt_s)
    escape, vehicle, margins = launch_landing.escape, estimates.vehicle, estimates.margins
    soars = forecast.standing == SETTLES and forecast.excess_mps > SOARS_LEAST_MPS
    if forecast.standing == UNKNOWN and mode != modes.BREAKING_OFF:  # then by what it does
        soars = vehicle.climb_mps > SOARS_LEAST_MPS
    goes_home = escape.armed and (mode == modes.BREAKING_OFF or not soars)
    view = ThrottleView(
        allowed=is_allowed(laws, mode, estimates),
        nowhere=_is_sinking(forecast),
        home_m=escape.left_m if goes_home else NAN,
        home_s=time_left(escape) if goes_home else NAN,
        room_m=_room(laws, margins),
        climb_mps=vehicle.climb_mps,
        airspeed_mps=estimates.air.airspeed_mps,
        returns_per_s=max(0.0, -forecast.slope_per_s) if soars else 0.0,
    )
    return throttle_step(laws.throttle, state, view, dt_s)


def power_off(laws: Laws, state: ThrottleState, inputs: Inputs) -> ThrottleState:
    """The throttle of a tick without control; disarmed, the flight is over and its budget new."""
    state = closed(laws.throttle, state, 0.0)
    state = state._replace(turns=0.0, push_mps2=0.0, climb_mps=0.0, pitch_rad=0.0)
    if inputs.autopilot.armed or state.used_s == 0.0:
        return state
    return closed(laws.throttle, state._replace(used_s=0.0), 0.0)


def is_allowed(laws: Laws, mode: int, estimates: Estimates) -> bool:
    """Whether power may be used: in these modes, upright, at a place that is known."""
    if mode not in POWERED:
        return False
    health, tilt_max = estimates.health, laws.guards.tilt_max_rad
    known = health.position_ok and health.attitude_ok and health.autopilot_ok
    return known and _is_upright(estimates.vehicle, tilt_max)


def _is_upright(vehicle: VehicleState, tilt_max_rad: float) -> bool:
    return abs(vehicle.roll_rad) <= tilt_max_rad and abs(vehicle.pitch_rad) <= tilt_max_rad


def _is_sinking(forecast: Forecast) -> bool:
    """Whether no place to settle is foreseen because there is too little lift."""
    return forecast.standing in (TOO_LOW, OUTSIDE) and forecast.excess_mps < 0.0


def _room(laws: Laws, margins: Margins) -> float:
    return margins.clearance_m - laws.envelope.clearance_min_m
