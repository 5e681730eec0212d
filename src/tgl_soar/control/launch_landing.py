"""From the hand to the line, and home, in one tick: launching, breaking off and landing.

What `control.launch` and `control.landing` need of the laws and of the estimates, and what the
supervisor and the attitude loops get from them.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar.control import landing, launch, ridge_beat
from tgl_soar.control import supervisor as modes
from tgl_soar.control.airspeed_hold import (
    NO_GLIDE,
    STALL_RAD,
    GlidePitches,
    GlideSetpoints,
    GlideState,
)
from tgl_soar.control.conditions import is_place_known
from tgl_soar.control.envelope import OUT_DOWNSTREAM, Limited, Margins
from tgl_soar.control.estimates import Estimates
from tgl_soar.control.glide_home import (
    NO_ESCAPE,
    EscapeState,
    EscapeView,
    escape_step,
    is_on_ground,
    is_short,
    time_left,
)
from tgl_soar.control.heading import bank_setpoint, heading_setpoint, sideways_held
from tgl_soar.control.landing import (
    LandingParams,
    glide_setpoints,
    glide_step,
    slowest,
    slowest_known,
    steeper_bank,
)
from tgl_soar.control.lateral_schedule import lateral_bandwidth, sideways_gains
from tgl_soar.control.launch import (
    NO_LAUNCH,
    LaunchState,
    LaunchView,
    is_aloft,
    is_in_no_hand,
    launch_step,
)
from tgl_soar.control.laws import Laws
from tgl_soar.control.pid import PidState, PidTerms, pid_step
from tgl_soar.control.ridge_beat import (
    NO_BEAT,
    BeatState,
    beat_bank,
    beat_setpoints,
    beat_step,
    beat_watch,
    is_back,
    is_wanted_back,
)
from tgl_soar.control.soaring import SoaringState, gliding_step
from tgl_soar.control.surface_loops import LoopsState, loops_begun
from tgl_soar.control.target_line import LineState, e_rho, line_at, line_step
from tgl_soar.control.throttle import LOW_S
from tgl_soar.control.wind_triangle import wind_speed
from tgl_soar.estimation.aerodynamics import glide_alpha, glide_pitch, trim_alpha
from tgl_soar.estimation.motion_state import FUTURE_S
from tgl_soar.types import NAN, THEIRS, Aerodynamics, Health, Inputs, VehicleState

SINKS_S: Final = 2.0  # of a second each to find out and to gain speed
# A gust of some metres' eddy is over in half of it, and its own speed carries an aircraft so long.
SLOW_S: Final = 2.0


class Lull(NamedTuple):
    """For how long the air has not carried, less for how long it has since.

    Each counts to twice what ends a flight, so that air that carries again is accepted as soon as
    air that does not: an hour of light wind with ESC_AUTO 0 must end nothing later.
    """

    slow_s: float  # a wind in which the aircraft cannot stand
    low_s: float  # sinking to the least height


class LaunchLandingState(NamedTuple):
    """What these modes remember."""

    launch: LaunchState
    escape: EscapeState
    glide: GlideState
    lull: Lull
    beat: BeatState


class LaunchLandingReport(NamedTuple):
    """What is shown of them."""

    launch: int  # 0 none, 1 held, 2 thrown, 3 gliding, 4 line reached, 5 … why it was given up
    height_left_m: float  # that the glide to the landing place would leave; NaN: not known
    time_left_s: float  # until it is gone, as it goes now; inf: it does not; NaN: not known


NO_LULL: Final = Lull(0.0, 0.0)
NO_LAUNCH_LANDING: Final = LaunchLandingState(
    launch=NO_LAUNCH, escape=NO_ESCAPE, glide=NO_GLIDE, lull=NO_LULL, beat=NO_BEAT
)


def phase_step(
    laws: Laws,
    state: LaunchLandingState,
    mode: int,
    inputs: Inputs,
    estimates: Estimates,
    line: LineState,
    dt_s: float,
) -> LaunchLandingState:
    """One tick in control.  mode: with which it begins; line: as it is flown."""
    vehicle, target = estimates.vehicle, laws.target
    launching = mode == modes.LAUNCHING
    began = state.launch
    if launching or began.standing != launch.IDLE:
        off = e_rho(line.x_m, line.z_m, line.eta_rad, vehicle.x_m, vehicle.z_m)
        to_go = off - e_rho(target.x_m, target.z_m, target.eta_rad, vehicle.x_m, vehicle.z_m)
        launch_view = LaunchView(
            vehicle=vehicle,
            imu=inputs.imu,
            position_ok=estimates.health.position_ok,
            airspeed_mps=estimates.air.airspeed_mps,
            measured=estimates.air.measured,
            speed_min_mps=laws.envelope.speed_min_mps,
            clearance_m=estimates.margins.clearance_m,
            clearance_min_m=laws.envelope.clearance_min_m,
            to_go_m=to_go,
            off_m=off,
            off_max_m=laws.guards.e_rho_max_m,
            line_rests=not line.moving,
        )
        began = launch_step(laws.launch, began, launching, launch_view, dt_s)
    in_air, goes_home = not launching or is_aloft(began), modes.goes_home(mode)
    known, air = knows_place(laws, estimates), estimates.air
    view = EscapeView(
        flying=in_air,
        goes_home=goes_home,
        soars=(mode == modes.SOARING and not line.moving) or mode == modes.BEATING,
        same_line=not (line.moving or goes_home),
        place_known=known,
    )
    escape = escape_step(laws.landing, state.escape, view, vehicle, air, dt_s)
    glide = state.glide if modes.flies_without_line(mode) else NO_GLIDE
    lull = _lull_step(laws, state.lull, mode, estimates, dt_s)
    beat = beat_watch(laws.beat, laws.landing, state.beat, air, dt_s) if in_air else NO_BEAT
    return LaunchLandingState(launch=began, escape=escape, glide=glide, lull=lull, beat=beat)


def _lull_step(laws: Laws, before: Lull, mode: int, estimates: Estimates, dt_s: float) -> Lull:
    """One tick more of it; the wind is that of both axes, where both are known."""
    if mode == modes.HOLDING:  # of the same line: a gap of one tick is no other wind
        return before
    on_line = mode in (modes.CAPTURING, modes.SOARING, modes.SEARCHING)
    if not on_line and mode != modes.BEATING:
        return NO_LULL
    home, air = laws.landing, estimates.air
    slow = wind_speed(air) + air.wind_sigma_mps < home.polar.speed_min_mps  # false for NaN
    slow = slow and on_line
    sinks_m = SINKS_S * min(0.0, estimates.vehicle.climb_mps)
    low = estimates.margins.clearance_m + sinks_m < home.clearance_m
    # A survey turns there by itself.
    low = low and mode in (modes.SOARING, modes.BEATING) and not laws.surveys
    return Lull(
        slow_s=max(0.0, min(2.0 * SLOW_S, before.slow_s + (dt_s if slow else -dt_s))),
        low_s=max(0.0, min(2.0 * LOW_S, before.low_s + (dt_s if low else -dt_s))),
    )


def hand_conditions(laws: Laws, vehicle: VehicleState, health: Health, margins: Margins) -> int:
    """A launch that is asked for, and what need not hold yet: the hand carries the aircraft.

    What flies already is in no hand, and is engaged as ever.
    """
    flies = is_in_no_hand(vehicle, health.position_ok, margins.clearance_m)
    if not laws.launch.wanted or flies:
        return 0
    return modes.LAUNCH | modes.AIR_SAFE | modes.HIGH_ENOUGH


def phase_conditions(laws: Laws, mode: int, state: LaunchLandingState, estimates: Estimates) -> int:
    """What holds of launch, escape and landing in a tick in control."""
    home, standing, vehicle = laws.landing, state.launch.standing, estimates.vehicle
    found = modes.LAUNCH if laws.launch.wanted else 0
    if is_aloft(state.launch):
        found |= modes.THROWN
    if standing == launch.REACHED:
        found |= modes.LINE_REACHED
    if standing != launch.NO_THROW:
        found |= modes.THROW_AWAITED
    if standing != launch.STEEP:
        found |= modes.THROWN_LEVEL
    if standing != launch.SLOW:
        found |= modes.SPEED_GAINED
    if standing != launch.LOW:
        found |= modes.LAUNCH_HIGH
    if standing != launch.FAR:
        found |= modes.LINE_IN_REACH
    known, clearance_m = knows_place(laws, estimates), estimates.margins.clearance_m
    short = known and is_short(state.escape, vehicle.time_s)
    short = short or (known and _is_reckoned_too_long(laws, state, estimates))
    if home.asked == landing.BREAK or (home.asked == landing.STAY and home.auto and short):
        found |= modes.BREAK_OFF
    if home.asked == landing.SOAR_ON:
        found |= modes.SOAR_ON
    low = landing.flare_height(home, vehicle, clearance_m)
    # With a small CLEAR_MIN or none, where it flares: what has come down so far goes nowhere else.
    near_m = max(2.0 * laws.envelope.clearance_min_m, landing.FLARE_MIN_M)
    if known and (vehicle.x_m <= home.away_x_m or low <= near_m):
        found |= modes.AWAY
    goes_home = modes.goes_home(mode)
    if goes_home and known and is_on_ground(home, state.escape, vehicle, clearance_m):
        found |= modes.ON_GROUND
    if not estimates.margins.outside & OUT_DOWNSTREAM:
        found |= modes.INSIDE_LEE
    beats = mode == modes.BEATING and is_wanted_back(laws.beat, state.beat)
    if beats and is_back(vehicle, estimates.air):
        found |= modes.BEAT_OVER
    if laws.beat.asked and can_beat(laws, estimates):
        found |= modes.BEAT
    # As POSITION_KEPT, and then for as long as recovering may last.
    blind_s = vehicle.time_s - estimates.memory.confident_s
    blind_max_s = laws.guards.position_age_max_s + laws.guards.recover_s
    if estimates.health.position_age_s <= blind_max_s and -FUTURE_S <= blind_s <= blind_max_s:
        found |= modes.NOT_BLIND  # false for NaN
    if known:
        found |= modes.NOT_BLIND
    return found


def with_way_home(
    laws: Laws,
    supervisor: modes.SupervisorState,
    state: LaunchLandingState,
    estimates: Estimates,
    found: int,
) -> int:
    """The conditions of a tick, and to beat along the ridge where it cannot stand, or to break off
    in the place of what would end a flight on the slope.

    Where it may break off by itself and there is height for a landing, a line that is given up is
    left for home, and so is one along which it sinks to ESC_CLEAR within SINKS_S, for LOW_S, and
    one in a wind that is slower than the aircraft flies by more than its standard deviation, for
    SLOW_S; and so is recovering that has lasted for half of its time.  To beat, half of SLOW_S will
    do where the line is given up.
    """
    home, mode = laws.landing, supervisor.mode
    flown = modes.SETTLES | modes.NEAR_LINE
    on_line = mode in (modes.CAPTURING, modes.SOARING, modes.SEARCHING)
    given_up = on_line and found & flown != flown
    low, slow = state.lull.low_s >= LOW_S, state.lull.slow_s >= SLOW_S
    if mode == modes.HOLDING:  # it is of before: nothing is judged by it without a position
        low = slow = False
    # In a wind that dies fast it falls off its line before that.
    cannot_stand = slow or (given_up and state.lull.slow_s >= 0.5 * SLOW_S)
    cannot_stand = cannot_stand or (on_line and state.beat.oblique_s >= ridge_beat.VEER_S)
    if laws.beat.auto and cannot_stand and not low and can_beat(laws, estimates):
        return found | modes.BEAT
    if not (home.auto and home.asked == landing.STAY and state.escape.armed):
        return found
    if not (knows_place(laws, estimates) and state.escape.left_m >= 0.0):  # false for NaN
        return found
    recovering_s = estimates.vehicle.time_s - supervisor.since_s
    falls = mode == modes.RECOVERING and recovering_s >= 0.5 * laws.guards.recover_s
    return found | modes.BREAK_OFF if given_up or low or slow or falls else found


def can_beat(laws: Laws, estimates: Estimates) -> bool:
    """Whether there is room to beat along the ridge: to either side, and over the ground."""
    clearance_m = estimates.margins.clearance_m
    high = clearance_m >= 2.0 * max(laws.envelope.clearance_min_m, laws.landing.clearance_m)
    return high and laws.beat.half_width_m > 0.0 and knows_place(laws, estimates)


def knows_place(laws: Laws, estimates: Estimates) -> bool:
    """Whether the position is good enough to go home by: dead reckoned for however long, too.

    Metres beside the landing place are less than what a glide without any position is off.
    """
    health, quality = estimates.health, estimates.quality
    if health.position_ok or quality.reckoned_s == 0.0:
        return health.position_ok
    young = health.position_age_s <= laws.health.position_age_max_s
    return is_place_known(laws.guards, health._replace(position_ok=young), quality, flying=True)


def _is_reckoned_too_long(laws: Laws, state: LaunchLandingState, estimates: Estimates) -> bool:
    """Whether the line is not to be flown any longer by dead reckoning, and there is a way home."""
    too_long = estimates.quality.reckoned_s > laws.guards.reckoned_max_s
    return too_long and state.escape.armed and state.escape.left_m >= 0.0  # false for NaN


def launch_line(
    laws: Laws, state: LaunchLandingState, line: LineState, vehicle: VehicleState, dt_s: float
) -> LineState:
    """The line of a launch: from the aircraft, with its speed across it, to the target."""
    if launch.starts_line(state.launch, vehicle.time_s):
        begun = line_at(laws.target, vehicle.x_m, vehicle.z_m)
        across = e_rho(0.0, 0.0, begun.eta_rad, vehicle.velocity_x_mps, vehicle.climb_mps)
        return begun._replace(speed_mps=across)
    if state.launch.standing == launch.GLIDING:
        return line_step(laws.launch.line, line, laws.target, vehicle.x_m, vehicle.z_m, dt_s)
    return line


def starts_line(state: LaunchLandingState, vehicle: VehicleState) -> bool:
    """Whether a launch begins to fly its line in this tick."""
    return launch.starts_line(state.launch, vehicle.time_s)


def is_in_hand(state: LaunchLandingState) -> bool:
    """Whether the aircraft waits to be thrown."""
    return launch.is_in_hand(state.launch)


def flies_no_line(mode: int, state: LaunchLandingState) -> bool:
    """Whether a mode in control flies by attitude or speed alone."""
    return modes.flies_without_line(mode) or (
        mode == modes.LAUNCHING
        and state.launch.standing != launch.GLIDING
        and state.launch.standing != launch.REACHED
    )


def phase_guide(
    laws: Laws,
    state: LaunchLandingState,
    mode: int,
    estimates: Estimates,
    soaring: SoaringState,
    sideways: PidState,
    limited: Limited,
    dt_s: float,
) -> tuple[LaunchLandingState, SoaringState, PidTerms, PidState, PidTerms, float]:
    """Pitch, bank and heading of these modes without a line.  limited: the last command."""
    below = estimates.vehicle.pitch_rad < soaring.pitch_setpoint_rad - STALL_RAD
    nose_held = below and limited.elevator_blocked > 0
    state, setpoints = _glide_setpoints(laws, state, mode, estimates, nose_held, dt_s)
    soaring, terms = gliding_step(laws.soaring, soaring, setpoints.pitch_rad, dt_s)
    sideways_terms = sideways_held(sideways)
    if setpoints.sideways_mps == setpoints.sideways_mps and laws.loops != THEIRS:
        age_s = estimates.memory.gain_age_s
        bandwidth = lateral_bandwidth(laws.lateral_schedule, age_s)
        gains = sideways_gains(laws.sideways, laws.lateral_schedule, bandwidth)
        if mode == modes.BEATING:
            bank = beat_bank(gains.output_max, laws.landing.tilt_max_rad)
            gains = gains._replace(output_min=-bank, output_max=bank)
        elif setpoints.steeper > 0.0:
            bank = steeper_bank(laws.landing, gains.output_max, setpoints.steeper)
            gains = gains._replace(output_min=-bank, output_max=bank)
        error = setpoints.sideways_mps - estimates.vehicle.velocity_y_mps
        sideways, sideways_terms = pid_step(
            gains, sideways, error, error, 0.0, dt_s, limited.aileron_blocked
        )
    return state, soaring, terms, sideways, sideways_terms, setpoints.heading_rad


def keeps_level(mode: int, state: LaunchLandingState) -> bool:
    """Whether a firmware that turns by banking is not to turn: the wings are level there."""
    return mode in (modes.HOLDING, modes.RECOVERING) or (
        mode == modes.LAUNCHING and flies_no_line(mode, state)
    )


def their_bank(
    laws: Laws, state: LaunchLandingState, mode: int, setpoint_rad: float, vehicle: VehicleState
) -> float:
    """Bank [rad] that is asked of such a firmware: to turn to its heading, or none."""
    if keeps_level(mode, state):
        return 0.0
    return turning_bank(laws, mode, setpoint_rad, vehicle.heading_rad)


def turning_bank(laws: Laws, mode: int, setpoint_rad: float, heading_rad: float) -> float:
    """Bank [rad] of a firmware that turns by banking; where it beats, bounded as where we bank:
    less turns too late, and BANK_MAX may be more than an attitude is believed."""
    gains = laws.bank
    if mode == modes.BEATING:
        bank = beat_bank(laws.sideways.output_max, laws.landing.tilt_max_rad)
        gains = gains._replace(bank_max_rad=bank)
    return bank_setpoint(gains, setpoint_rad, heading_rad)


def _glide_setpoints(
    laws: Laws,
    state: LaunchLandingState,
    mode: int,
    estimates: Estimates,
    nose_held: bool,
    dt_s: float,
) -> tuple[LaunchLandingState, GlideSetpoints]:
    """Pitch, heading and sideways speed; NaN: wings level."""
    vehicle, air = estimates.vehicle, estimates.air
    if mode == modes.LAUNCHING:
        upwind = heading_setpoint(laws.heading, vehicle.x_m, vehicle.y_m)
        pitch = laws.launch.pitch_rad
        if air.airspeed_mps < laws.landing.best_glide_mps:  # false for NaN
            pitch = min(pitch, laws.envelope.glide_pitch_rad)
        return state, GlideSetpoints(pitch, upwind, NAN, 0.0)
    home, known = laws.landing, knows_place(laws, estimates)
    outward, clearance_m = mode == modes.BREAKING_OFF, estimates.margins.clearance_m
    if mode == modes.BEATING:
        back = is_wanted_back(laws.beat, state.beat)
        glide, speed = beat_step(
            laws.beat,
            home,
            laws.target,
            state.glide,
            returns=back,
            position_ok=known,
            vehicle=vehicle,
            air=air,
            nose_held=nose_held,
            dt_s=dt_s,
        )
    else:
        glide, speed = glide_step(
            home,
            state.glide,
            outward,
            known,
            vehicle=vehicle,
            air=air,
            clearance_m=clearance_m,
            nose_held=nose_held,
            dt_s=dt_s,
        )
    polar, aerodynamics = home.polar, laws.wind.aerodynamics
    trimmed = max(polar.speed_min_mps, min(polar.speed_max_mps, speed))
    pitches = GlidePitches(
        wanted_rad=glide_pitch(aerodynamics, trimmed),
        slowest_rad=glide_pitch(aerodynamics, slowest_known(home, air.measured)),
        fastest_rad=glide_pitch(aerodynamics, polar.speed_max_mps),
        most_alpha_rad=most_trim_alpha(aerodynamics, laws.trim.elevator, home),
    )
    if mode == modes.BEATING:
        setpoints = beat_setpoints(home, glide, known, pitches, air)
    else:
        setpoints = glide_setpoints(home, glide, outward, known, pitches, vehicle, air, clearance_m)
    if not known:
        setpoints = setpoints._replace(sideways_mps=NAN)
    return state._replace(glide=glide), setpoints


def most_trim_alpha(aero: Aerodynamics, trim: float, home: LandingParams) -> float:
    """The angle of attack [rad] beyond which what the elevator holds lowers the nose.

    That of the slowest approach; where the elevator's trim in a glide (ELE_TRIM) shows that the
    moments of the file read too high, more by as much.
    """
    best = glide_alpha(aero, home.best_glide_mps)
    too_high = trim_alpha(aero, trim, 0.0, home.best_glide_mps) - best
    most = glide_alpha(aero, slowest(home))
    return most + too_high if too_high > 0.0 else most  # false for NaN


def loops_in_hand(loops: LoopsState, vehicle: VehicleState) -> LoopsState:
    """The surfaces' loops with nothing learnt: a hand is no disturbance to be trimmed out."""
    return loops_begun(loops.limited, vehicle)


def phase_report(state: LaunchLandingState) -> LaunchLandingReport:
    """What is shown of a tick."""
    return LaunchLandingReport(state.launch.standing, state.escape.left_m, time_left(state.escape))
