"""One tick of the autopilot: estimate, supervise, guide, control, limit.

`step` is pure.  It knows no clock and no socket: the same function flies the aircraft, the bridge,
batch simulations and replays of logs.  Its time is `Inputs.time_s`, its dt the difference of two.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar.control import launch_landing as way
from tgl_soar.control import supervisor as modes
from tgl_soar.control import supervisor_texts
from tgl_soar.control.conditions import (
    blind_glide_s,
    excitation_hindrance,
    flight_conditions,
    forecast_conditions,
    forecast_of,
    jumps_unsettled,
    line_conditions,
    search_conditions,
    stream_conditions,
    target_conditions,
)
from tgl_soar.control.envelope import CUT_NOSE_UP, Margins, brake_limit, unlimited
from tgl_soar.control.envelope_margins import pitch_kept
from tgl_soar.control.estimates import Estimates, EstimatorMemory, estimate, fresh, initial_memory
from tgl_soar.control.excitation import (
    IDLE,
    NOT_SOARING,
    RUNNING,
    ExcitationState,
    at_rest,
    excitation_step,
)
from tgl_soar.control.forecast import Forecast, ForecastState, initial_forecast
from tgl_soar.control.heading import heading_setpoint, sideways_held
from tgl_soar.control.launch_landing import LaunchLandingReport, LaunchLandingState
from tgl_soar.control.laws import Laws
from tgl_soar.control.pid import PidGains, PidState, PidTerms
from tgl_soar.control.pitch_schedule import NO_GAINS, ScheduledGains
from tgl_soar.control.point import point_step
from tgl_soar.control.point_hold import NO_POINT, BrakeEffect, BrakeState, PointReport, set_aside
from tgl_soar.control.power import power_conditions, power_off, power_step, with_power, with_push
from tgl_soar.control.soaring import (
    SoaringState,
    gliding_step,
    holding_step,
    soaring_reset,
    soaring_step,
)
from tgl_soar.control.supervisor import FINITE, SANE, SupervisorState, initial_supervisor, supervise
from tgl_soar.control.surface_loops import (
    NO_TERMS,
    LoopsState,
    bank_step,
    line_gains,
    loops_begun,
    scheduled_gains,
    surface_gains,
    surfaces_step,
)
from tgl_soar.control.target_line import (
    LineState,
    LineTracking,
    e_rho,
    line_at,
    line_step,
    line_tracking,
)
from tgl_soar.control.throttle import NO_THROTTLE, ThrottleReport, ThrottleState, throttle_report
from tgl_soar.estimation.ground_range import GroundRange
from tgl_soar.estimation.health import STREAM_FAULTS, fault_words
from tgl_soar.types import (
    NAN,
    NO_SETPOINTS,
    THEIRS,
    AirEstimate,
    Health,
    Inputs,
    MotionQuality,
    Setpoints,
    SurfaceCommand,
    VehicleState,
    isfinite,
)

DT_MAX_S: Final = 0.1  # a longer gap between two ticks is not integrated over
ON_LINE_S: Final = 1.0  # so long within capture_distance_m before the line counts as captured


class AutopilotState(NamedTuple):
    """All that one tick leaves to the next."""

    time_s: float  # NaN: no tick yet
    supervisor: SupervisorState
    off_line_s: float  # when the aircraft was last off its line, or the line off its target
    memory: EstimatorMemory
    line: LineState
    soaring: SoaringState
    heading_setpoint_rad: float
    sideways: PidState
    loops: LoopsState
    excitation: ExcitationState
    forecast: ForecastState
    brake: BrakeState
    launch_landing: LaunchLandingState
    throttle: ThrottleState


class Output(NamedTuple):
    """What one tick decided, and why: the command, and one row for the log."""

    time_s: float
    mode: int
    reason: int  # of a change of mode in this tick, else REASON_NONE
    active: bool  # the command is to be sent
    command: SurfaceCommand
    setpoints: Setpoints
    vehicle: VehicleState
    health: Health
    line: LineTracking
    soaring: PidTerms
    elevator: PidTerms
    aileron: PidTerms
    rudder: PidTerms
    sideways: PidTerms  # of the bank
    air: AirEstimate
    quality: MotionQuality
    margins: Margins
    ground_range: GroundRange
    cut: int  # what the envelope cut off the command, bits CUT_…
    imu_weight: float  # of the gains with accelerations in those flown, 0 … 1
    gains: ScheduledGains  # in the modes in control
    excitation: ExcitationState
    forecast: Forecast
    point: PointReport
    launch_landing: LaunchLandingReport
    throttle: ThrottleReport


def mode_name(mode: int) -> str:
    """The word for a mode."""
    return supervisor_texts.MODE_NAMES[mode]


def reason_text(reason: int) -> str:
    """The words for a change of mode."""
    return supervisor_texts.REASON_TEXTS[reason]


def fault_text(faults: int) -> str:
    """The words for what is wrong with the streams; the autopilot's own state has reasons."""
    return fault_words(faults & STREAM_FAULTS)


def entry_lacks(laws: Laws, state: AutopilotState, inputs: Inputs, output: Output) -> int:
    """The conditions of an entry, as bits, that do not hold after a tick; state: after it."""
    held = stream_conditions(laws.guards, inputs, output.health, state.memory.confident_s)
    held |= flight_conditions(laws, output.vehicle, output.margins) | target_conditions(laws)
    held |= way.hand_conditions(laws, output.vehicle, output.health, output.margins)
    return modes.ENTRY & ~held


class _Guidance(NamedTuple):
    """What the line asks of the attitude loops, and what it leaves to the next tick."""

    line: LineState
    tracking: LineTracking
    off_line_s: float
    soaring: SoaringState
    terms: PidTerms
    sideways: PidState
    sideways_terms: PidTerms
    gains: PidGains
    setpoints: Setpoints
    cut: int  # off the pitch setpoint, bits CUT_…
    brake: BrakeState
    braked: BrakeEffect  # of the brake as it is now
    launch_landing: LaunchLandingState


class _Flown(NamedTuple):
    """The part of an output that only the modes in control have."""

    command: SurfaceCommand
    setpoints: Setpoints
    soaring: PidTerms
    elevator: PidTerms
    aileron: PidTerms
    rudder: PidTerms
    sideways: PidTerms
    cut: int
    gains: ScheduledGains


_AT_REST: Final = PidState(0.0, 0.0)
_NEUTRAL: Final = SurfaceCommand(0.0, 0.0, 0.0, 0.0)
_NOT_FLOWN: Final = _Flown(
    command=_NEUTRAL,
    setpoints=NO_SETPOINTS,
    soaring=NO_TERMS,
    elevator=NO_TERMS,
    aileron=NO_TERMS,
    rudder=NO_TERMS,
    sideways=NO_TERMS,
    cut=0,
    gains=NO_GAINS,
)


def initial_state() -> AutopilotState:
    """Before the first tick."""
    return AutopilotState(
        time_s=NAN,
        supervisor=initial_supervisor(),
        off_line_s=NAN,
        memory=initial_memory(),
        line=LineState(x_m=NAN, z_m=NAN, eta_rad=NAN, speed_mps=0.0, moving=False),
        soaring=SoaringState(_AT_REST, 0.0, 0),
        heading_setpoint_rad=0.0,
        sideways=_AT_REST,
        loops=LoopsState(
            pitch=_AT_REST,
            roll=_AT_REST,
            heading=_AT_REST,
            limited=unlimited(_NEUTRAL),
            pitch_setpoint_rad=NAN,
        ),
        excitation=at_rest(IDLE),
        forecast=initial_forecast(),
        brake=NO_POINT,
        launch_landing=way.NO_LAUNCH_LANDING,
        throttle=NO_THROTTLE,
    )


def step(laws: Laws, state: AutopilotState, inputs: Inputs) -> tuple[AutopilotState, Output]:
    """One tick, at inputs.time_s.  Never raises on any numbers that inputs may hold."""
    dt = inputs.time_s - state.time_s
    dt = min(DT_MAX_S, dt) if dt > 0.0 else 0.0  # NaN: the first tick
    flying = modes.is_flying(state.supervisor.mode)
    airborne = flying and not way.is_in_hand(state.launch_landing)
    laws, inputs = with_push(laws, state.throttle), fresh(inputs)
    estimates = estimate(laws, state.memory, inputs, airborne, state.loops.limited, dt)
    if not isfinite(inputs.time_s):  # what has taken that in would never be a number again
        estimates = estimates._replace(memory=initial_memory())
    engaged_because = modes.REASON_NONE
    if not flying:
        state, output = _watch(laws, state, inputs, estimates)
        if not output.active:
            return state, output
        state, dt, engaged_because = _engaged(laws, state, estimates), 0.0, output.reason
    return _fly(laws, state, inputs, estimates, dt, engaged_because)


def _watch(
    laws: Laws, state: AutopilotState, inputs: Inputs, estimates: Estimates
) -> tuple[AutopilotState, Output]:
    """Not in control: look, and say whether it engages, which is asked for and able."""
    vehicle, target = estimates.vehicle, laws.target
    found = _conditions(laws, state, inputs, estimates) | target_conditions(laws) | FINITE | SANE
    found |= line_conditions(laws.guards, 0.0, False, False) | modes.SETTLES
    found |= way.hand_conditions(laws, estimates.vehicle, estimates.health, estimates.margins)
    supervisor, decision = _decide(laws, state, inputs, found)
    state = _idle(laws, state, inputs, estimates, supervisor, state.line, initial_forecast())
    tracking = LineTracking(
        x_m=target.x_m,
        z_m=target.z_m,
        eta_rad=target.eta_rad,
        moving=False,
        e_rho_m=e_rho(target.x_m, target.z_m, target.eta_rad, vehicle.x_m, vehicle.z_m),
        e_rho_rate_mps=NAN,
    )
    mode, reason = decision.mode, decision.reason
    return state, _output(state, inputs, estimates, mode, reason, tracking, _NOT_FLOWN)


def _idle(
    laws: Laws,
    state: AutopilotState,
    inputs: Inputs,
    estimates: Estimates,
    supervisor: SupervisorState,
    line: LineState,
    forecast: ForecastState,
) -> AutopilotState:
    """The state after a tick without control: the laws' part stays as it was."""
    return AutopilotState(
        time_s=inputs.time_s,
        supervisor=supervisor,
        off_line_s=state.off_line_s,
        memory=estimates.memory,
        line=line,
        soaring=state.soaring,
        heading_setpoint_rad=state.heading_setpoint_rad,
        sideways=state.sideways,
        loops=state.loops,
        excitation=excitation_step(
            laws.excitation, state.excitation, inputs.time_s, 0.0, NOT_SOARING
        ),
        forecast=forecast,
        brake=set_aside(laws.brake, state.brake),
        launch_landing=way.NO_LAUNCH_LANDING,
        throttle=power_off(laws, state.throttle, inputs),
    )


def _output(
    state: AutopilotState,
    inputs: Inputs,
    estimates: Estimates,
    mode: int,
    reason: int,
    line: LineTracking,
    flown: _Flown,
) -> Output:
    """The output of any tick."""
    return Output(
        time_s=inputs.time_s,
        mode=mode,
        reason=reason,
        active=modes.is_flying(mode),
        command=flown.command,
        setpoints=flown.setpoints,
        vehicle=estimates.vehicle,
        health=estimates.health,
        line=line,
        soaring=flown.soaring,
        elevator=flown.elevator,
        aileron=flown.aileron,
        rudder=flown.rudder,
        sideways=flown.sideways,
        air=estimates.air,
        quality=estimates.quality,
        margins=estimates.margins,
        ground_range=estimates.ground_range,
        cut=flown.cut,
        imu_weight=estimates.memory.imu_weight,
        gains=flown.gains,
        excitation=state.excitation,
        forecast=state.forecast.foreseen,
        point=PointReport(state.brake.standing, state.brake.off_m),
        launch_landing=way.phase_report(state.launch_landing),
        throttle=throttle_report(state.throttle),
    )


def _engaged(laws: Laws, state: AutopilotState, estimates: Estimates) -> AutopilotState:
    """The state at the moment of engaging.

    The surfaces start at their trims and go from there no faster than the envelope lets them;
    no integral hides an error that the laws must act on at once, such as a bank.
    """
    state = _line_from_aircraft(laws, state, estimates)
    vehicle = estimates.vehicle
    return state._replace(
        heading_setpoint_rad=heading_setpoint(laws.heading, vehicle.x_m, vehicle.y_m),
        sideways=_AT_REST,
        loops=loops_begun(unlimited(laws.trim), vehicle),
    )


def _line_from_aircraft(laws: Laws, state: AutopilotState, estimates: Estimates) -> AutopilotState:
    """The line starts at the aircraft and slides from there; the pitch goes on from its own."""
    vehicle = estimates.vehicle
    line = line_at(laws.target, vehicle.x_m, vehicle.z_m)
    rate = e_rho(0.0, 0.0, line.eta_rad, vehicle.velocity_x_mps, vehicle.climb_mps)
    held_rad = estimates.memory.pitch_trim.pitch_rad + state.throttle.pitch_rad  # as it is added
    return state._replace(
        line=line,
        soaring=soaring_reset(laws.soaring, held_rad, rate, vehicle.pitch_rad),
        off_line_s=vehicle.time_s,
    )


def _fly(
    laws: Laws,
    state: AutopilotState,
    inputs: Inputs,
    estimates: Estimates,
    dt_s: float,
    engaged_because: int,
) -> tuple[AutopilotState, Output]:
    """All modes in control."""
    vehicle, jump_s = estimates.vehicle, estimates.memory.motion.jump_s
    if jumps_unsettled(laws.guards, state.supervisor, state.line, vehicle, jump_s):
        state = _line_from_aircraft(laws, state, estimates)
    line, off_line_s = state.line, state.off_line_s
    if state.supervisor.mode in (modes.CAPTURING, modes.SOARING, modes.SEARCHING):
        line = line_step(laws.line, line, laws.target, vehicle.x_m, vehicle.z_m, dt_s)
    mode = state.supervisor.mode
    phase = way.phase_step(laws, state.launch_landing, mode, inputs, estimates, line, dt_s)
    line = way.launch_line(laws, phase, line, vehicle, dt_s)
    tracking = line_tracking(line, vehicle)
    on_its_way = line.moving and not laws.surveys
    if on_its_way or not abs(tracking.e_rho_m) <= laws.guards.capture_distance_m:
        off_line_s = inputs.time_s
    on_line = inputs.time_s - off_line_s >= ON_LINE_S

    found = _conditions(laws, state, inputs, estimates) | _own_conditions(state, line)
    found |= line_conditions(laws.guards, tracking.e_rho_m, on_line, on_its_way)
    found |= search_conditions(laws, line.moving)
    found |= way.phase_conditions(laws, mode, phase, estimates)
    air, quality = estimates.air, estimates.quality
    forecast = forecast_of(laws, mode, state.forecast, line, vehicle, air, quality)
    found |= forecast_conditions(laws, mode, forecast.foreseen)
    found |= power_conditions(laws, mode, state.throttle, forecast.foreseen, estimates)
    found = way.with_way_home(laws, state.supervisor, phase, estimates, found)
    supervisor, decision = _decide(laws, state, inputs, found)
    mode, reason = decision.mode, decision.reason or engaged_because
    if not modes.is_flying(mode):
        state = _idle(laws, state, inputs, estimates, supervisor, line, forecast)
        return state, _output(state, inputs, estimates, mode, reason, tracking, _NOT_FLOWN)

    hindrance = excitation_hindrance(
        laws,
        state.excitation.standing == RUNNING,
        mode,
        tracking,
        on_line=on_line,
        vehicle=vehicle,
        margins=estimates.margins,
        faults=estimates.health.faults,
        imu_weight=estimates.memory.imu_weight,
        soaring=state.soaring,
        elevator_blocked=state.loops.limited.elevator_blocked,
    )
    excitation = excitation_step(laws.excitation, state.excitation, inputs.time_s, dt_s, hindrance)
    state = state._replace(excitation=excitation, launch_landing=phase)
    guidance = _guide(laws, state, estimates, decision, line, tracking, off_line_s, dt_s)
    foreseen, left = forecast.foreseen, state.throttle
    throttle = power_step(laws, left, mode, foreseen, guidance.launch_landing, estimates, dt_s)
    loops, flown = _control(laws, mode, state.loops, inputs, estimates, guidance, dt_s)
    state = AutopilotState(
        time_s=inputs.time_s,
        supervisor=supervisor,
        off_line_s=guidance.off_line_s,
        memory=estimates.memory,
        line=guidance.line,
        soaring=guidance.soaring,
        heading_setpoint_rad=guidance.setpoints.heading_rad,
        sideways=guidance.sideways,
        loops=loops,
        excitation=excitation,
        forecast=forecast,
        brake=guidance.brake,
        launch_landing=guidance.launch_landing,
        throttle=throttle,
    )
    return state, _output(state, inputs, estimates, mode, reason, guidance.tracking, flown)


def _control(
    laws: Laws,
    mode: int,
    before: LoopsState,
    inputs: Inputs,
    estimates: Estimates,
    guidance: _Guidance,
    dt_s: float,
) -> tuple[LoopsState, _Flown]:
    """From the setpoints to the surfaces, and what a log has of the way."""
    memory, vehicle, margins = estimates.memory, estimates.vehicle, estimates.margins
    if way.is_in_hand(guidance.launch_landing):
        before = way.loops_in_hand(before, vehicle)
    flown_with = surface_gains(laws, memory.imu_weight, memory.gain_speed_mps, memory.gain_age_s)
    most = brake_limit(laws.envelope, margins.stall_rad, vehicle.climb_mps, margins.clearance_m)
    loops, terms = surfaces_step(
        laws,
        flown_with,
        before,
        vehicle,
        setpoints=guidance.setpoints,
        brake=guidance.brake.brake,
        brake_max=most,
        braked=guidance.braked,
        stall_rad=margins.stall_rad,
        surfaces=inputs.surfaces,
        flies=modes.is_flying(mode),
        dt_s=dt_s,
    )
    return loops, _Flown(
        command=loops.limited.command,
        setpoints=guidance.setpoints,
        soaring=guidance.terms,
        elevator=terms.elevator,
        aileron=terms.aileron,
        rudder=terms.rudder,
        sideways=guidance.sideways_terms,
        cut=loops.limited.cut | guidance.cut,
        gains=scheduled_gains(laws, memory.gain_speed_mps, guidance.gains, flown_with),
    )


def _guide(
    laws: Laws,
    state: AutopilotState,
    estimates: Estimates,
    decision: modes.Decision,
    line: LineState,
    tracking: LineTracking,
    off_line_s: float,
    dt_s: float,
) -> _Guidance:
    """From the line, or without it, to the setpoints of the attitude loops."""
    vehicle, memory, soaring = estimates.vehicle, estimates.memory, state.soaring
    theta_0, psi_setpoint = memory.pitch_trim.pitch_rad, state.heading_setpoint_rad
    sideways, sideways_terms = state.sideways, sideways_held(state.sideways)
    gains = line_gains(
        laws, memory.imu_weight, memory.gain_speed_mps, memory.gain_age_s, line.eta_rad
    )
    limited, phase = state.loops.limited, state.launch_landing
    held, effect = point_step(
        laws, state.brake, limited, decision.mode, eta_rad=line.eta_rad, vehicle=vehicle,
        gain_speed_mps=memory.gain_speed_mps, inertial=memory.imu_weight == 1.0,
        faults=estimates.health.faults, dt_s=dt_s,
    )  # fmt: skip
    gains, effect = with_power(gains, effect, state.throttle)
    if way.flies_no_line(decision.mode, phase):
        mode = decision.mode
        phase, soaring, terms, sideways, sideways_terms, psi_setpoint = way.phase_guide(
            laws, phase, mode, estimates, soaring, sideways, limited, dt_s
        )
    elif decision.mode == modes.HOLDING:
        # Without a position: the pitch that held the line, wings level, the heading as it was.
        soaring, terms = holding_step(laws.soaring, soaring, theta_0 + effect.pitch_rad, dt_s)
    elif decision.mode == modes.RECOVERING:
        soaring, terms = gliding_step(laws.soaring, soaring, laws.envelope.glide_pitch_rad, dt_s)
    else:
        if way.starts_line(phase, vehicle):
            pitch = soaring.pitch_setpoint_rad
            soaring = soaring_reset(laws.soaring, theta_0 + effect.pitch_rad, 0.0, pitch)
        if decision.action == modes.NEW_LINE:
            rate = tracking.e_rho_rate_mps + line.speed_mps  # the new line is at rest
            state = _line_from_aircraft(laws, state, estimates)
            line, soaring, off_line_s = state.line, state.soaring, state.off_line_s
            tracking = line_tracking(line, vehicle)._replace(e_rho_m=0.0, e_rho_rate_mps=rate)
        undisturbed = theta_0 + memory.gust_pitch_rad + effect.pitch_rad
        blocked = limited.elevator_blocked
        off_m, rate_mps = tracking.e_rho_m, tracking.e_rho_rate_mps
        soaring, terms = soaring_step(gains, soaring, undisturbed, off_m, rate_mps, dt_s, blocked)
        course = heading_setpoint(laws.heading, vehicle.x_m, vehicle.y_m)
        psi_setpoint = estimates.veer_rad + course
        if laws.loops != THEIRS:  # that turns by banking
            age_s, speed = memory.gain_age_s, estimates.air.airspeed_mps
            blocked = limited.aileron_blocked
            sideways, sideways_terms = bank_step(
                laws, sideways, vehicle, course, speed, age_s, blocked, dt_s
            )

    wanted_rad = soaring.pitch_setpoint_rad + state.excitation.pitch_rad
    held_rad, margins = theta_0 + soaring.pid.integral + effect.pitch_rad, estimates.margins
    behind_m = -tracking.e_rho_m if decision.mode == modes.SOARING else 0.0
    pitch_setpoint, cut = pitch_kept(laws, margins, vehicle, wanted_rad, held_rad, behind_m)
    if cut != 0:  # held back as by its own rate limit: its integral must not wind up either
        soaring = soaring._replace(slewing=1 if cut == CUT_NOSE_UP else -1)
    roll_setpoint = sideways_terms.output
    if laws.loops == THEIRS:
        roll_setpoint = way.their_bank(laws, phase, decision.mode, psi_setpoint, vehicle)
    return _Guidance(
        line=line,
        tracking=tracking,
        off_line_s=off_line_s,
        soaring=soaring,
        terms=terms,
        sideways=sideways,
        sideways_terms=sideways_terms,
        gains=gains.pid,
        setpoints=Setpoints(pitch_setpoint, roll_setpoint, psi_setpoint),
        cut=cut,
        brake=held,
        braked=effect,
        launch_landing=phase,
    )


def _conditions(laws: Laws, state: AutopilotState, inputs: Inputs, now: Estimates) -> int:
    """What holds now, but for the line and the laws' own numbers."""
    found = stream_conditions(laws.guards, inputs, now.health, now.memory.confident_s)
    blind_s = blind_glide_s(state.supervisor, now.health, inputs.time_s)
    return found | flight_conditions(laws, now.vehicle, now.margins, blind_s)


def _own_conditions(state: AutopilotState, line: LineState) -> int:
    """Whether the last command and what the laws carry on from are numbers."""
    found = FINITE if state.loops.limited.finite else 0
    carried = line.x_m + line.z_m + state.soaring.pitch_setpoint_rad + state.heading_setpoint_rad
    carried += state.sideways.integral
    return found | SANE if isfinite(carried) else found


def _decide(
    laws: Laws, state: AutopilotState, inputs: Inputs, found: int
) -> tuple[SupervisorState, modes.Decision]:
    """What the supervisor makes of it."""
    boots, armed = inputs.autopilot.boots, inputs.autopilot.armed
    gap_s, recover_s = laws.guards.position_age_max_s, laws.guards.recover_s
    return supervise(state.supervisor, inputs.time_s, found, boots, armed, gap_s, recover_s)
