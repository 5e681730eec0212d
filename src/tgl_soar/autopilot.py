"""One tick of the autopilot: estimate, supervise, guide, control, limit.

`step` is pure.  It knows no clock and no socket: the same function flies the aircraft, the
bridge, the batch simulations and the replay of a log.  Its time is `Inputs.time_s`, its dt
the difference of two of these.
"""

from __future__ import annotations

from math import cos, hypot, pi, sin
from typing import Final, NamedTuple

from tgl_soar.control import supervisor as modes
from tgl_soar.control.attitude import attitude_step
from tgl_soar.control.envelope import (
    CUT_NOSE_DOWN,
    CUT_NOSE_UP,
    PITCH_PER_SPEED,
    Limited,
    Margins,
    clearance,
    elevator_limit,
    is_air_safe,
    is_clear,
    limit_surfaces,
    outside,
    pitch_within,
    stall_margin,
)
from tgl_soar.control.heading import (
    bank_setpoint,
    heading_setpoint,
    heading_step,
)
from tgl_soar.control.laws import Laws, SupervisorLimits
from tgl_soar.control.pid import PidState, PidTerms
from tgl_soar.control.scheduling import pid_between, soaring_between, weight_step
from tgl_soar.control.soaring import (
    SoaringState,
    TrimState,
    gliding_step,
    holding_step,
    soaring_reset,
    soaring_step,
    trim_step,
)
from tgl_soar.control.supervisor import (
    AIR_SAFE,
    AIRSPEED_SANE,
    ATTITUDE_AGREES,
    ATTITUDE_FRESH,
    AUTOPILOT_ALIVE,
    CLEAR,
    ENGAGE,
    FINITE,
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
    SANE,
    STREAMS_SEEN,
    SURFACES_ANSWER,
    SURFACES_OBEY,
    UPRIGHT,
    UPWIND,
    SupervisorState,
    initial_supervisor,
    supervise,
)
from tgl_soar.control.target_line import (
    LineState,
    e_rho,
    line_at,
    line_step,
)
from tgl_soar.estimation.health import (
    AIRSPEED,
    DISAGREES,
    FROZEN,
    INFINITE,
    INSANE,
    STREAM_FAULTS,
    HealthState,
    fault_words,
    health_step,
    initial_health,
)
from tgl_soar.estimation.motion import (
    FUTURE_S,
    IMU_SILENT_S,
    MotionState,
    initial_motion,
    motion_quality,
    motion_step,
)
from tgl_soar.estimation.wind import (
    WindState,
    glide_pitch,
    initial_wind,
    wind_step,
)
from tgl_soar.types import (
    NAN,
    NO_SETPOINTS,
    OURS,
    THEIRS,
    AirEstimate,
    Health,
    Inputs,
    MotionQuality,
    Setpoints,
    SurfaceCommand,
    SurfacesSample,
    VehicleState,
    isfinite,
)

DT_MAX_S: Final = 0.1  # a longer gap between two ticks is not integrated over
HEADING_MAX_RAD: Final = 0.5 * pi  # from upwind, to be engaged at all
LINE_UPRIGHT: Final = 0.1  # sine of a line's inclination, below which it has no upstream side
STALL_UNCERTAINTY_MAX_RAD: Final = (
    0.035  # 2 degrees: the margin acts from 3 degrees before the limit on
)
UNCERTAINTY_MAX: Final = 3.0  # times EST_SD_MAX: in more doubt than this no fix is young enough
TRAVEL_END: Final = 0.98  # of travel: a surface read back from here on can go no further
ON_LINE_S: Final = 1.0  # so long within capture_distance_m before the line counts as captured


class AutopilotState(NamedTuple):
    """All that one tick leaves to the next."""

    time_s: float  # NaN: no tick yet
    supervisor: SupervisorState
    off_line_s: float  # when the aircraft was last off its line, or the line off its target
    motion: MotionState
    line: LineState
    soaring: SoaringState
    pitch: PidState
    roll: PidState
    heading: PidState
    heading_setpoint_rad: float
    limited: Limited
    wind: WindState
    health: HealthState
    pitch_trim: TrimState
    gust_pitch_rad: float  # by which the setpoint meets a gust
    imu_weight: float  # of the gains with accelerations in those flown, 0 … 1
    confident_s: float  # of when the last fix is that made the position confident; NaN: none


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
    line_x_m: float
    line_z_m: float
    line_eta_rad: float
    line_moving: bool
    e_rho_m: float  # to the line that is flown
    e_rho_rate_mps: float
    soaring: PidTerms
    elevator: PidTerms
    aileron: PidTerms
    rudder: PidTerms
    air: AirEstimate
    quality: MotionQuality
    margins: Margins
    cut: int  # what the envelope cut off the command, bits CUT_…
    imu_weight: float  # of the gains with accelerations in those flown, 0 … 1


def mode_name(mode: int) -> str:
    """The word for a mode."""
    return modes.MODE_NAMES[mode]


def reason_text(reason: int) -> str:
    """The words for a change of mode."""
    return modes.REASON_TEXTS[reason]


def fault_text(faults: int) -> str:
    """The words for what is wrong with the streams; the autopilot's own state has reasons."""
    return fault_words(faults & STREAM_FAULTS)


_AT_REST: Final = PidState(0.0, 0.0)
_NO_TERMS: Final = PidTerms(output=NAN, p=NAN, i=NAN, d=NAN, feedforward=NAN, saturated=0)
_NEUTRAL: Final = SurfaceCommand(0.0, 0.0, 0.0)


def initial_state() -> AutopilotState:
    """Before the first tick."""
    return AutopilotState(
        time_s=NAN,
        supervisor=initial_supervisor(),
        off_line_s=NAN,
        motion=initial_motion(),
        line=LineState(x_m=NAN, z_m=NAN, eta_rad=NAN, speed_mps=0.0, moving=False),
        soaring=SoaringState(_AT_REST, 0.0, 0),
        pitch=_AT_REST,
        roll=_AT_REST,
        heading=_AT_REST,
        heading_setpoint_rad=0.0,
        limited=Limited(
            command=_NEUTRAL, elevator_blocked=0, aileron_blocked=0, finite=True, cut=0
        ),
        wind=initial_wind(),
        health=initial_health(),
        pitch_trim=TrimState(NAN, NAN),
        gust_pitch_rad=0.0,
        imu_weight=0.0,
        confident_s=NAN,
    )


class _Estimates(NamedTuple):
    """What the estimators make of one tick: what they tell, and what they remember of it."""

    vehicle: VehicleState
    quality: MotionQuality
    health: Health
    air: AirEstimate
    margins: Margins
    gust_pitch_rad: float
    imu_weight: float
    motion: MotionState
    watched: HealthState
    wind: WindState
    pitch_trim: TrimState
    confident_s: float


def step(laws: Laws, state: AutopilotState, inputs: Inputs) -> tuple[AutopilotState, Output]:
    """One tick, at inputs.time_s.  Never raises on any numbers that inputs may hold."""
    dt = inputs.time_s - state.time_s
    dt = min(DT_MAX_S, dt) if dt > 0.0 else 0.0  # NaN: the first tick
    estimates = _estimate(laws, state, inputs, dt)
    if modes.is_flying(state.supervisor.mode):
        return _fly(laws, state, inputs, estimates, dt, modes.REASON_NONE)
    return _watch(laws, state, inputs, estimates)


def _estimate(laws: Laws, state: AutopilotState, inputs: Inputs, dt_s: float) -> _Estimates:
    """Where the aircraft is, how it moves, in which air, and how sure that is."""
    flying = modes.is_flying(state.supervisor.mode)
    motion, vehicle = motion_step(laws.motion, laws.frame, state.motion, inputs)
    quality = motion_quality(laws.motion, state.motion, motion, inputs.time_s)
    watched, health = health_step(
        laws.health,
        state.health,
        motion,
        inputs,
        flying,
        flying and laws.loops == OURS,  # else nothing is known of where surfaces should be
        state.limited.command,
        dt_s,
    )
    health = _with_uncertainty(laws.guards, health, quality)
    wind, air = wind_step(
        laws.wind,
        state.wind,
        vehicle,
        inputs,
        quality.velocity_sigma_mps,
        _elevator(state, inputs),
        _is_imu_valid(state.motion, motion, inputs.time_s),
    )
    glide = NAN
    if laws.pitch_trim.share > 0.0:
        glide = glide_pitch(laws.wind.aerodynamics, air.wind_mps - vehicle.velocity_x_mps)
    trim, gust = trim_step(
        laws.pitch_trim, state.pitch_trim, glide, air.updraft_mps, air.airspeed_mps, dt_s
    )
    return _Estimates(
        vehicle=vehicle,
        quality=quality,
        health=health,
        air=air,
        margins=_margins(laws, inputs, vehicle, health, air, flying),
        gust_pitch_rad=gust,
        imu_weight=weight_step(state.imu_weight, quality.inertial, dt_s),
        motion=motion,
        watched=watched,
        wind=wind,
        pitch_trim=trim,
        confident_s=motion.fix.time_s if health.position_ok else state.confident_s,
    )


def _margins(
    laws: Laws,
    inputs: Inputs,
    vehicle: VehicleState,
    health: Health,
    air: AirEstimate,
    flying: bool,
) -> Margins:
    """How far it is to the stall, the ground and the fence.

    Without a pitot tube alpha and airspeed are worked out from wind, velocity and pitch. They count
    where the estimator is sure of them, as with accelerometers it is, and in flight: what is held
    in a hand feels the hand.  A lost place that nobody can even estimate is not outside: its age
    ends the flight, in its own words.
    """
    alpha, airspeed = NAN, NAN
    sure = flying and stall_uncertainty(air, vehicle.pitch_rad) <= STALL_UNCERTAINTY_MAX_RAD
    if air.measured or sure:
        alpha, airspeed = air.alpha_rad, air.airspeed_mps
    elif not health.faults & AIRSPEED:
        airspeed = inputs.airspeed.airspeed_mps
    unknown = not health.position_ok and not isfinite(vehicle.x_m + vehicle.y_m + vehicle.z_m)
    return Margins(
        stall_margin(laws.envelope, alpha, airspeed),
        clearance(laws.ground, vehicle.x_m, vehicle.z_m),
        0 if unknown else outside(laws.fence, vehicle.x_m, vehicle.y_m, vehicle.z_m),
    )


def stall_uncertainty(air: AirEstimate, pitch_rad: float) -> float:
    """Standard deviation [rad] of the margin to the stall, by that of wind and updraft.

    The flight path through the air climbs by gamma = pitch - alpha, wings level: across it the
    doubt turns alpha, along it it changes the airspeed, which counts as a pitch.  NaN: not known.
    """
    gamma = pitch_rad - air.alpha_rad
    c, s = cos(gamma), sin(gamma)
    across = hypot(c * air.updraft_sigma_mps, s * air.wind_sigma_mps) / air.airspeed_mps
    along = hypot(c * air.wind_sigma_mps, s * air.updraft_sigma_mps) * PITCH_PER_SPEED
    return max(across, along)


def _is_imu_valid(before: MotionState, after: MotionState, time_s: float) -> bool:
    """Whether the estimator has taken new accelerations in this tick, and they are of now."""
    return (
        after.imu.time_s != before.imu.time_s
        and time_s - after.imu.time_s <= IMU_SILENT_S  # false for NaN
    )


def _elevator(state: AutopilotState, inputs: Inputs) -> float:
    """The elevator's deflection as it is read back, else as we command it, else NaN."""
    if isfinite(inputs.surfaces.elevator):
        return inputs.surfaces.elevator
    if modes.is_flying(state.supervisor.mode):
        return state.limited.command.elevator
    return NAN


def _with_uncertainty(guards: SupervisorLimits, health: Health, quality: MotionQuality) -> Health:
    """Health as the estimator's doubt has it, and not the age of the last fix alone.

    With accelerations the position is flown with until it is too uncertain; where it has jumped
    it is not, so that the line starts anew at the aircraft and no law sees the step.  A fix that
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
        and not health.faults & FROZEN  # the estimator knows no better
    )
    sure = (young or carried) and not quality.jumped
    return health if sure == health.position_ok else health._replace(position_ok=sure)


def _watch(
    laws: Laws, state: AutopilotState, inputs: Inputs, estimates: _Estimates
) -> tuple[AutopilotState, Output]:
    """Without the surfaces: look, and engage if asked and able."""
    vehicle, target = estimates.vehicle, laws.target
    found = _found(laws, inputs, estimates, 0.0, False, False, True, True)
    if line_valid(laws):  # to be engaged with; in flight nothing looks at it
        found |= LINE_VALID
    supervisor, decision = _decide(laws, state, inputs, found)
    state = _idle(state, inputs, estimates, supervisor, state.line)
    if modes.is_flying(decision.mode):
        return _fly(laws, _engaged(laws, state, estimates), inputs, estimates, 0.0, decision.reason)
    distance = e_rho(target.x_m, target.z_m, target.eta_rad, vehicle.x_m, vehicle.z_m)
    line = LineState(
        x_m=target.x_m, z_m=target.z_m, eta_rad=target.eta_rad, speed_mps=0.0, moving=False
    )
    return state, _idle_output(
        inputs, estimates, decision.mode, decision.reason, line, distance, NAN
    )


def _idle(
    state: AutopilotState,
    inputs: Inputs,
    estimates: _Estimates,
    supervisor: SupervisorState,
    line: LineState,
) -> AutopilotState:
    """The state after a tick without the surfaces: only what was seen is new."""
    return AutopilotState(
        time_s=inputs.time_s,
        supervisor=supervisor,
        off_line_s=state.off_line_s,
        motion=estimates.motion,
        line=line,
        soaring=state.soaring,
        pitch=state.pitch,
        roll=state.roll,
        heading=state.heading,
        heading_setpoint_rad=state.heading_setpoint_rad,
        limited=state.limited,
        wind=estimates.wind,
        health=estimates.watched,
        pitch_trim=estimates.pitch_trim,
        gust_pitch_rad=estimates.gust_pitch_rad,
        imu_weight=estimates.imu_weight,
        confident_s=estimates.confident_s,
    )


def _idle_output(
    inputs: Inputs,
    estimates: _Estimates,
    mode: int,
    reason: int,
    line: LineState,
    distance_m: float,
    rate_mps: float,
) -> Output:
    """The output of a tick without the surfaces, or in which they are given back."""
    return Output(
        time_s=inputs.time_s,
        mode=mode,
        reason=reason,
        active=False,
        command=_NEUTRAL,
        setpoints=NO_SETPOINTS,
        vehicle=estimates.vehicle,
        health=estimates.health,
        line_x_m=line.x_m,
        line_z_m=line.z_m,
        line_eta_rad=line.eta_rad,
        line_moving=line.moving,
        e_rho_m=distance_m,
        e_rho_rate_mps=rate_mps,
        soaring=_NO_TERMS,
        elevator=_NO_TERMS,
        aileron=_NO_TERMS,
        rudder=_NO_TERMS,
        air=estimates.air,
        quality=estimates.quality,
        margins=estimates.margins,
        cut=0,
        imu_weight=estimates.imu_weight,
    )


def _engaged(laws: Laws, state: AutopilotState, estimates: _Estimates) -> AutopilotState:
    """The state at the moment of taking the surfaces.

    The surfaces start at their trims and go from there no faster than the envelope lets them;
    no integral hides an error that the laws must act on at once, such as a bank.
    """
    state = _line_from_aircraft(laws, state, estimates)
    vehicle, trim = estimates.vehicle, laws.trim
    return state._replace(
        pitch=PidState(0.0, -vehicle.pitch_rate_radps),
        roll=PidState(0.0, -vehicle.roll_rate_radps),
        heading=PidState(0.0, -vehicle.heading_rate_radps),
        heading_setpoint_rad=heading_setpoint(laws.heading, vehicle.x_m, vehicle.y_m),
        limited=Limited(command=trim, elevator_blocked=0, aileron_blocked=0, finite=True, cut=0),
    )


def _line_from_aircraft(laws: Laws, state: AutopilotState, estimates: _Estimates) -> AutopilotState:
    """The line starts at the aircraft and slides from there; the pitch goes on from its own."""
    vehicle = estimates.vehicle
    line = line_at(laws.target, vehicle.x_m, vehicle.z_m)
    rate = e_rho(0.0, 0.0, line.eta_rad, vehicle.velocity_x_mps, vehicle.climb_mps)
    return state._replace(
        line=line,
        soaring=soaring_reset(
            laws.soaring, estimates.pitch_trim.pitch_rad, rate, vehicle.pitch_rad
        ),
        off_line_s=vehicle.time_s,
    )


def _fly(
    laws: Laws,
    state: AutopilotState,
    inputs: Inputs,
    estimates: _Estimates,
    dt_s: float,
    engaged_because: int,
) -> tuple[AutopilotState, Output]:
    """Capturing, soaring, holding and recovering."""
    vehicle, margins, line = estimates.vehicle, estimates.margins, state.line
    before = state.supervisor.mode
    if before in (modes.CAPTURING, modes.SOARING):
        line = line_step(laws.line, line, laws.target, vehicle.x_m, vehicle.z_m, dt_s)
    distance = e_rho(line.x_m, line.z_m, line.eta_rad, vehicle.x_m, vehicle.z_m)
    # The rate is the distance of the velocity vector from a line through the origin.
    rate = e_rho(0.0, 0.0, line.eta_rad, vehicle.velocity_x_mps, vehicle.climb_mps) - line.speed_mps

    off_line_s = state.off_line_s
    if line.moving or not abs(distance) <= laws.guards.capture_distance_m:
        off_line_s = inputs.time_s
    on_line = inputs.time_s - off_line_s >= ON_LINE_S
    sane = isfinite(
        line.x_m + line.z_m + state.soaring.pitch_setpoint_rad + state.heading_setpoint_rad
    )
    found = _found(
        laws, inputs, estimates, distance, on_line, line.moving, state.limited.finite, sane
    )
    supervisor, decision = _decide(laws, state, inputs, found)
    mode, reason = decision.mode, decision.reason or engaged_because
    if not modes.is_flying(mode):
        state = _idle(state, inputs, estimates, supervisor, line)
        return state, _idle_output(inputs, estimates, mode, reason, line, distance, rate)

    theta_0, soaring = estimates.pitch_trim.pitch_rad, state.soaring
    psi_setpoint = state.heading_setpoint_rad
    if mode == modes.HOLDING:
        # Without a position: the pitch that held the line, wings level, the heading as it was.
        soaring, soaring_terms = holding_step(laws.soaring, soaring, theta_0, dt_s)
    elif mode == modes.RECOVERING:
        soaring, soaring_terms = gliding_step(
            laws.soaring, soaring, laws.envelope.glide_pitch_rad, dt_s
        )
    else:
        if decision.action == modes.NEW_LINE:
            state = _line_from_aircraft(laws, state, estimates)
            line, distance, rate = state.line, 0.0, rate + line.speed_mps  # at rest now
            soaring, off_line_s = state.soaring, state.off_line_s
        soaring, soaring_terms = soaring_step(
            soaring_between(laws.soaring, laws.soaring_imu, estimates.imu_weight),
            soaring,
            theta_0 + estimates.gust_pitch_rad,
            distance,
            rate,
            dt_s,
            state.limited.elevator_blocked,
        )
        psi_setpoint = heading_setpoint(laws.heading, vehicle.x_m, vehicle.y_m)

    pitch_setpoint = pitch_within(
        laws.envelope,
        soaring.pitch_setpoint_rad,
        vehicle.pitch_rad,
        margins.stall_rad,
        vehicle.climb_mps,
        margins.clearance_m,
    )
    cut = 0
    if pitch_setpoint < soaring.pitch_setpoint_rad:
        cut = CUT_NOSE_UP
    elif pitch_setpoint > soaring.pitch_setpoint_rad:
        cut = CUT_NOSE_DOWN
    roll_setpoint = 0.0
    if laws.loops == THEIRS:
        roll_setpoint = bank_setpoint(laws.bank, psi_setpoint, vehicle.heading_rad)
    pitch, roll = state.pitch, state.roll
    elevator_terms = aileron_terms = _NO_TERMS
    if laws.loops == OURS:
        pitch, elevator_terms = attitude_step(
            pid_between(laws.pitch, laws.pitch_imu, estimates.imu_weight),
            state.pitch,
            pitch_setpoint,
            vehicle.pitch_rad,
            vehicle.pitch_rate_radps,
            laws.trim.elevator,
            dt_s,
            state.limited.elevator_blocked,
        )
        roll, aileron_terms = attitude_step(
            laws.roll,
            state.roll,
            roll_setpoint,
            vehicle.roll_rad,
            vehicle.roll_rate_radps,
            laws.trim.aileron,
            dt_s,
            state.limited.aileron_blocked,
        )
    heading, rudder_terms = heading_step(
        laws.heading,
        state.heading,
        psi_setpoint,
        vehicle.heading_rad,
        vehicle.heading_rate_radps,
        laws.trim.rudder,
        dt_s,
    )
    wanted = SurfaceCommand(elevator_terms.output, aileron_terms.output, rudder_terms.output)
    if laws.loops != OURS:
        wanted = SurfaceCommand(laws.trim.elevator, laws.trim.aileron, rudder_terms.output)
    limited = limit_surfaces(
        laws.envelope,
        state.limited.command,
        wanted,
        elevator_limit(laws.envelope, laws.trim.elevator, margins.stall_rad),
        True,
        dt_s,
    )
    if laws.loops != OURS:
        limited = _left_to_firmware(limited, laws.loops, inputs.surfaces)
    state = AutopilotState(
        time_s=inputs.time_s,
        supervisor=supervisor,
        off_line_s=off_line_s,
        motion=estimates.motion,
        line=line,
        soaring=soaring,
        pitch=pitch,
        roll=roll,
        heading=heading,
        heading_setpoint_rad=psi_setpoint,
        limited=limited,
        wind=estimates.wind,
        health=estimates.watched,
        pitch_trim=estimates.pitch_trim,
        gust_pitch_rad=estimates.gust_pitch_rad,
        imu_weight=estimates.imu_weight,
        confident_s=estimates.confident_s,
    )
    return state, Output(
        time_s=inputs.time_s,
        mode=mode,
        reason=reason,
        active=True,
        command=limited.command,
        setpoints=Setpoints(pitch_setpoint, roll_setpoint, psi_setpoint),
        vehicle=vehicle,
        health=estimates.health,
        line_x_m=line.x_m,
        line_z_m=line.z_m,
        line_eta_rad=line.eta_rad,
        line_moving=line.moving,
        e_rho_m=distance,
        e_rho_rate_mps=rate,
        soaring=soaring_terms,
        elevator=elevator_terms,
        aileron=aileron_terms,
        rudder=rudder_terms,
        air=estimates.air,
        quality=estimates.quality,
        margins=margins,
        cut=limited.cut | cut,
        imu_weight=estimates.imu_weight,
    )


def _left_to_firmware(limited: Limited, loops: int, surfaces: SurfacesSample) -> Limited:
    """What is known of surfaces that the firmware's own loops move: where it says that they are.

    Without them the pitch is taken to follow its setpoint.
    """
    blocked = 0
    if surfaces.elevator >= TRAVEL_END:  # false for NaN
        blocked = 1
    elif surfaces.elevator <= -TRAVEL_END:
        blocked = -1
    rudder = limited.command.rudder if loops != THEIRS else NAN
    return Limited(
        command=SurfaceCommand(NAN, NAN, rudder),
        elevator_blocked=blocked,
        aileron_blocked=0,
        finite=limited.finite,
        cut=limited.cut,
    )


def _found(
    laws: Laws,
    inputs: Inputs,
    estimates: _Estimates,
    distance_m: float,
    on_line: bool,
    line_moving: bool,
    finite: bool,
    sane: bool,
) -> int:
    """What holds now, as the supervisor's bits."""
    vehicle, health, margins = estimates.vehicle, estimates.health, estimates.margins
    found = 0
    if inputs.engage:
        found |= ENGAGE
    age = health.position_age_s
    if age < INFINITE and health.attitude_age_s < INFINITE and health.heartbeat_age_s < INFINITE:
        found |= STREAMS_SEEN
    if health.position_ok:
        found |= POSITION_FRESH
    # Fixes that leave the position uncertain, or come too seldom, do not keep it.
    unsure_s, unsure_max_s = inputs.time_s - estimates.confident_s, laws.guards.position_age_max_s
    if age <= unsure_max_s and -FUTURE_S <= unsure_s <= unsure_max_s:  # false for NaN
        found |= POSITION_KEPT
    faults = health.faults
    if not faults & INSANE:
        found |= POSITION_SANE
    if health.attitude_ok:
        found |= ATTITUDE_FRESH
    if not faults & DISAGREES:
        found |= ATTITUDE_AGREES
    if not faults & AIRSPEED:
        found |= AIRSPEED_SANE
    if health.autopilot_ok:
        found |= AUTOPILOT_ALIVE
    if not inputs.autopilot.failsafe:
        found |= NO_FAILSAFE
    if inputs.autopilot.accepts_surfaces:
        found |= SURFACES_OBEY
    if health.surfaces_answer != 0:
        found |= SURFACES_ANSWER
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
    if line_moving:
        found |= LINE_MOVING
    if abs(distance_m) <= laws.guards.e_rho_max_m:
        found |= NEAR_LINE
    if on_line:
        found |= ON_LINE
    if finite:
        found |= FINITE
    if sane:
        found |= SANE
    return found


def line_valid(laws: Laws) -> bool:
    """Whether the target line can be flown: it has an upstream side, and its point lies inside
    the fence."""
    target = laws.target
    return sin(target.eta_rad) >= LINE_UPRIGHT and not outside(
        laws.fence, target.x_m, 0.0, target.z_m
    )


def _decide(
    laws: Laws, state: AutopilotState, inputs: Inputs, found: int
) -> tuple[SupervisorState, modes.Decision]:
    """The supervisor's word."""
    status, guards = inputs.autopilot, laws.guards
    return supervise(
        state.supervisor,
        inputs.time_s,
        found,
        status.boots,
        status.armed,
        guards.position_age_max_s,
        guards.recover_s,
    )
