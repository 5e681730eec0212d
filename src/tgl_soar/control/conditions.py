"""What holds in a tick, as the bits that the supervisor's table is about.

Whatever is NaN does not hold: each comparison is written so that NaN fails it.
"""

from __future__ import annotations

from math import pi, sin
from typing import Final

from tgl_soar.control.envelope import Margins, is_air_safe, is_clear, outside
from tgl_soar.control.laws import Laws, SupervisorLimits
from tgl_soar.control.supervisor import (
    AIR_SAFE,
    AIRSPEED_SANE,
    ATTITUDE_AGREES,
    ATTITUDE_FRESH,
    AUTOPILOT_ALIVE,
    CLEAR,
    ENGAGE,
    HIGH_ENOUGH,
    INSIDE_FENCE,
    LINE_MOVING,
    LINE_VALID,
    NEAR_LINE,
    NO_FAILSAFE,
    ON_LINE,
    POSITION_FRESH,
    POSITION_KEPT,
    POSITION_SANE,
    STREAMS_SEEN,
    SURFACES_ANSWER,
    SURFACES_OBEY,
    UPRIGHT,
    UPWIND,
)
from tgl_soar.estimation.health import AIRSPEED, DISAGREES, INFINITE, INSANE
from tgl_soar.estimation.motion_state import FUTURE_S
from tgl_soar.types import Health, Inputs, VehicleState

HEADING_MAX_RAD: Final = 0.5 * pi  # from upwind, to be engaged at all
LINE_UPRIGHT: Final = 0.1  # sine of a line's inclination, below which it has no upstream side


def stream_conditions(
    guards: SupervisorLimits, inputs: Inputs, health: Health, confident_s: float
) -> int:
    """What holds of the operator, the streams and the autopilot.

    confident_s: when the last fix was true that made the position confident; NaN: none did.
    """
    found = 0
    if inputs.engage:
        found |= ENGAGE
    age = health.position_age_s
    if age < INFINITE and health.attitude_age_s < INFINITE and health.heartbeat_age_s < INFINITE:
        found |= STREAMS_SEEN
    if health.position_ok:
        found |= POSITION_FRESH
    # Fixes that leave the position uncertain, or come too seldom, do not keep it.
    uncertain_s, uncertain_max_s = inputs.time_s - confident_s, guards.position_age_max_s
    if age <= uncertain_max_s and -FUTURE_S <= uncertain_s <= uncertain_max_s:  # false for NaN
        found |= POSITION_KEPT
    if not health.faults & INSANE:
        found |= POSITION_SANE
    if health.attitude_ok:
        found |= ATTITUDE_FRESH
    if not health.faults & DISAGREES:
        found |= ATTITUDE_AGREES
    if not health.faults & AIRSPEED:
        found |= AIRSPEED_SANE
    if health.autopilot_ok:
        found |= AUTOPILOT_ALIVE
    if not inputs.autopilot.failsafe:
        found |= NO_FAILSAFE
    if inputs.autopilot.accepts_surfaces:
        found |= SURFACES_OBEY
    if health.surfaces_answer != 0:
        found |= SURFACES_ANSWER
    return found


def flight_conditions(laws: Laws, vehicle: VehicleState, margins: Margins) -> int:
    """What holds of the aircraft in the air: how it is turned, and its margins."""
    found = 0
    tilt_max = laws.guards.tilt_max_rad
    if abs(vehicle.roll_rad) <= tilt_max and abs(vehicle.pitch_rad) <= tilt_max:
        found |= UPRIGHT
    if abs(vehicle.heading_rad) <= HEADING_MAX_RAD:
        found |= UPWIND
    if not margins.outside:
        found |= INSIDE_FENCE
    limits, stall, climb = laws.envelope, margins.stall_rad, vehicle.climb_mps
    if is_air_safe(limits, stall, climb):
        found |= AIR_SAFE
    if margins.clearance_m >= limits.clearance_min_m:
        found |= HIGH_ENOUGH
    if is_clear(limits, stall, climb, margins.clearance_m):
        found |= CLEAR
    return found


def line_conditions(
    guards: SupervisorLimits, distance_m: float, on_line: bool, moving: bool
) -> int:
    """What holds of the line that is flown, and of the aircraft's distance from it."""
    found = 0
    if moving:
        found |= LINE_MOVING
    if abs(distance_m) <= guards.e_rho_max_m:
        found |= NEAR_LINE
    if on_line:
        found |= ON_LINE
    return found


def target_conditions(laws: Laws) -> int:
    """What holds of the target line."""
    return LINE_VALID if line_valid(laws) else 0


def line_valid(laws: Laws) -> bool:
    """Whether the target line can be flown: it has an upstream side, and its point lies inside
    the fence."""
    target = laws.target
    return sin(target.eta_rad) >= LINE_UPRIGHT and not outside(
        laws.fence, target.x_m, 0.0, target.z_m
    )
