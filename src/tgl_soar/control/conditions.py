"""What holds in a tick, as the bits that the supervisor's table is about.

Whatever is NaN does not hold: each comparison is written so that NaN fails it.
"""

from __future__ import annotations

from math import pi, sin
from typing import Final

from tgl_soar.control.envelope import MARGIN_FULL, Margins, is_air_safe, is_clear, outside
from tgl_soar.control.excitation import (
    BANKED,
    FAULTY,
    GAINS_CHANGE,
    IDLE,
    LIMITED,
    LINE_MOVES,
    NEAR_STALL,
    NOT_SOARING,
    OFF_LINE,
    TOO_LOW,
)
from tgl_soar.control.forecast import (
    DISENGAGE,
    DISENGAGE_EARLY,
    SEARCH_FIRST,
    Forecast,
    ForecastState,
    forecast_step,
    initial_forecast,
    is_the_last_moment,
    nowhere,
)
from tgl_soar.control.laws import (
    SEARCH_GIVEN_UP,
    SEARCH_NONE,
    SEARCH_OFF,
    SEARCH_SOARS,
    Laws,
    SupervisorLimits,
)
from tgl_soar.control.soaring import SoaringState
from tgl_soar.control.supervisor import (
    AIR_SAFE,
    AIRSPEED_SANE,
    ATTITUDE_AGREES,
    ATTITUDE_FRESH,
    AUTOPILOT_ALIVE,
    CAPTURING,
    CLEAR,
    ENGAGE,
    HIGH_ENOUGH,
    INSIDE_FENCE,
    LINE_MOVING,
    LINE_VALID,
    MINIMUM_S,
    NEAR_LINE,
    NO_FAILSAFE,
    ON_LINE,
    PLACE_FOUND,
    POSITION_FRESH,
    POSITION_KEPT,
    POSITION_SANE,
    RECOVERING,
    SEARCH,
    SEARCHING,
    SETTLES,
    SOARING,
    STREAMS_ARRIVED,
    SURFACES_ANSWER,
    SURFACES_OBEY,
    UPRIGHT,
    UPWIND,
    SupervisorState,
)
from tgl_soar.control.target_line import LineState, LineTracking, e_rho
from tgl_soar.estimation.health import AIRSPEED, DISAGREES, FROZEN, INSANE
from tgl_soar.estimation.motion_state import FUTURE_S
from tgl_soar.estimation.position_fixes import takes_repetitions
from tgl_soar.types import INFINITE, AirEstimate, Health, Inputs, MotionQuality, VehicleState

UNCERTAINTY_MAX: Final = 3.0  # times EST_SD_MAX: more uncertain than this no fix is young enough
HEADING_MAX_RAD: Final = 0.5 * pi  # from upwind, to be engaged at all
# A multisine begins on the line, wings level.  It moves e_rho by A g / w² or less, 3 cm at its
# slowest tone and 1 deg, and may go on within three times what counts as captured.  At 20 degrees
# of bank the lift's vertical part, and with it the loop's gain, has lost 6 % = 0.5 dB.
EXCITED_FARTHEST: Final = 3.0  # times TGL_CAPTURE
EXCITED_BANK_RAD: Final = 0.35
BEGIN_BANK_RAD: Final = 0.175
# It begins where the envelope leaves setpoint and elevator alone. A gust may take some of that, as
# long as nothing is cut and half of the elevator's travel is left: 1.4 degrees or 0.5 m/s.
EXCITED_STALL_RAD: Final = 0.5 * MARGIN_FULL
LINE_UPRIGHT: Final = 0.1  # sine of a line's inclination, below which it has no upstream side


def is_place_known(
    guards: SupervisorLimits, health: Health, quality: MotionQuality, flying: bool
) -> bool:
    """Whether the position may be flown with, for all that the estimator knows.

    health: of which `position_ok` says how old the last fix is, and no more.  flying: the module is
    in control.

    With accelerations the position is flown with until it is too uncertain; where it has jumped
    it is not, so that the line is reset to the aircraft and no law sees the step.  A fix that
    says little is young and helps no one: then the position is as uncertain as before.
    """
    young = (
        health.position_ok
        and quality.position_sigma_m <= UNCERTAINTY_MAX * guards.position_sd_max_m
    )
    carried = (
        quality.inertial
        and quality.position_sigma_m <= guards.position_sd_max_m  # false for NaN
        and health.position_age_s <= guards.position_age_max_s
        # Of what is frozen and taken in all the same the estimator knows no better.
        and not (health.faults & FROZEN and takes_repetitions(quality.source, flying))
    )
    return (young or carried) and not quality.jumped


def with_uncertainty(
    guards: SupervisorLimits, health: Health, quality: MotionQuality, flying: bool
) -> Health:
    """Health as the estimator's uncertainty has it, and the autopilot's own of what it reckons."""
    known = is_place_known(guards, health, quality, flying)
    known = known and (quality.reckoned_s == 0.0 or quality.reckoned_s <= guards.reckoned_max_s)
    return health if known == health.position_ok else health._replace(position_ok=known)


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
        found |= STREAMS_ARRIVED
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


def blind_glide_s(supervisor: SupervisorState, health: Health, time_s: float) -> float:
    """For how long the aircraft has glided down, recovering, since the last fix; 0 where it does
    not, or where its position is confident."""
    if supervisor.mode != RECOVERING or health.position_ok:
        return 0.0
    return max(0.0, min(health.position_age_s, time_s - supervisor.since_s))


def blind_sink_m(laws: Laws, vehicle: VehicleState, blind_s: float) -> float:
    """By how much the aircraft may be lower than estimated after such a glide.

    The estimate goes on with the climb that it knew last, or with none.  A glide sinks by speed /
    glide ratio in still air, and nobody knows of any lift there: what of that the estimate does not
    have counts as lost.  0 where the airframe's glide is not known.
    """
    sink_mps = 2.0 * laws.schedule.drag * laws.schedule.best_glide_mps
    more_mps = sink_mps + vehicle.climb_mps
    return more_mps * blind_s if more_mps > 0.0 else 0.0  # false for NaN


def flight_conditions(
    laws: Laws, vehicle: VehicleState, margins: Margins, blind_s: float = 0.0
) -> int:
    """What holds of the aircraft in the air: how it is turned, and its margins.

    blind_s: as `blind_glide_s` has it.
    """
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
    clearance_m = margins.clearance_m - blind_sink_m(laws, vehicle, blind_s)
    if clearance_m >= limits.clearance_min_m:
        found |= HIGH_ENOUGH
    if is_clear(limits, stall, climb, clearance_m):
        found |= CLEAR
    return found


def line_conditions(
    guards: SupervisorLimits, distance_m: float, on_line: bool, moving: bool
) -> int:
    """What holds of the line that is flown, and of the aircraft's distance from it.

    moving: on its way to where it was sent.  In a survey it is on none: it slides so slowly that
    the aircraft soars all along.
    """
    found = 0
    if moving:
        found |= LINE_MOVING
    if abs(distance_m) <= guards.e_rho_max_m:
        found |= NEAR_LINE
    if on_line:
        found |= ON_LINE
    return found


def jumps_unsettled(
    guards: SupervisorLimits,
    supervisor: SupervisorState,
    line: LineState,
    vehicle: VehicleState,
    jump_s: float,
) -> bool:
    """Whether the position jumps now, near its line, in a mode that is too young to be left for
    holding.  jump_s: when it last did; NaN: never."""
    mode = supervisor.mode
    if mode != CAPTURING and mode != SOARING and mode != SEARCHING:
        return False
    if not (jump_s == vehicle.time_s and vehicle.time_s - supervisor.since_s < MINIMUM_S):
        return False
    off_m = e_rho(line.x_m, line.z_m, line.eta_rad, vehicle.x_m, vehicle.z_m)
    return abs(off_m) <= guards.e_rho_max_m


def forecast_of(
    laws: Laws,
    mode: int,
    state: ForecastState,
    line: LineState,
    vehicle: VehicleState,
    air: AirEstimate,
    quality: MotionQuality,
) -> ForecastState:
    """Where the aircraft will stop on the line that is flown; in other modes nothing is foreseen,
    and what was is of another flight."""
    if mode != CAPTURING and mode != SOARING and mode != SEARCHING:
        return initial_forecast()
    return forecast_step(
        laws.forecast,
        laws.fence,
        laws.ground,
        state,
        vehicle=vehicle,
        air=air,
        velocity_sigma_mps=quality.velocity_sigma_mps,
        eta_rad=line.eta_rad,
        moving=line.moving,
    )


def forecast_conditions(laws: Laws, mode: int, forecast: Forecast) -> int:
    """Whether a place to settle is foreseen; what is only to be reported ends nothing.

    A search knows where else there may be lift: as long as its line can be slid there in the time
    that is left it goes on, until it gives up itself.  Where none can begin nobody looks elsewhere.
    """
    if mode == SEARCHING and laws.search == SEARCH_GIVEN_UP:
        return 0
    act = laws.forecast.act
    if act == SEARCH_FIRST and laws.search == SEARCH_NONE:
        act = DISENGAGE
    if act < DISENGAGE or not nowhere(forecast):
        return SETTLES
    at_once = act == DISENGAGE_EARLY or (mode == CAPTURING and act != SEARCH_FIRST)
    at_once = at_once and mode != SEARCHING
    return 0 if at_once or is_the_last_moment(laws.forecast, forecast) else SETTLES


def search_conditions(laws: Laws, moving: bool) -> int:
    """What holds of the search for lift; moving: the line is on its way."""
    found = 0
    if laws.search != SEARCH_OFF and laws.search != SEARCH_NONE:
        found |= SEARCH
    if laws.search == SEARCH_SOARS and not moving:
        found |= PLACE_FOUND
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


def excitation_hindrance(
    laws: Laws,
    begun: bool,
    mode: int,
    tracking: LineTracking,
    on_line: bool,
    vehicle: VehicleState,
    margins: Margins,
    faults: int,
    imu_weight: float,
    soaring: SoaringState,
    elevator_blocked: int,
) -> int:
    """Why no multisine may begin, or one that has begun may not go on; IDLE: nothing is against it.

    elevator_blocked: whether the last command was less than the law wanted.  The first hindrance
    that is found is reported.
    """
    limits, added = laws.envelope, laws.excitation.amplitude_rad
    farthest_m = laws.guards.capture_distance_m
    bank_max_rad, stall_min_rad = BEGIN_BANK_RAD, MARGIN_FULL + added
    if begun:
        farthest_m, bank_max_rad = EXCITED_FARTHEST * farthest_m, EXCITED_BANK_RAD
        stall_min_rad = EXCITED_STALL_RAD
    highest_rad, pitch = soaring.pitch_setpoint_rad + added, laws.soaring.pid
    has_room = pitch.output_min + 2.0 * added <= highest_rad <= pitch.output_max
    if margins.stall_rad < MARGIN_FULL:  # the envelope's own limit of the setpoint
        has_room = has_room and highest_rad <= vehicle.pitch_rad + margins.stall_rad
    if mode != SOARING:
        return NOT_SOARING
    if tracking.moving:
        return LINE_MOVES
    if not (on_line or begun) or not abs(tracking.e_rho_m) <= farthest_m:
        return OFF_LINE
    if not abs(vehicle.roll_rad) <= bank_max_rad:
        return BANKED
    if faults != 0:
        return FAULTY
    if not margins.stall_rad >= stall_min_rad:
        return NEAR_STALL
    is_high = margins.clearance_m >= 2.0 * limits.clearance_min_m
    if not (is_high and vehicle.climb_mps >= -0.5 * limits.sink_max_mps):
        return TOO_LOW
    if 0.0 < imu_weight < 1.0:
        return GAINS_CHANGE
    if elevator_blocked != 0 or soaring.slewing != 0 or not has_room:
        return LIMITED
    return IDLE
