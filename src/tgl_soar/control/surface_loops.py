"""From the setpoints to surface deflections within the envelope.

Where the firmware's own loops hold pitch and bank, ours rest, and what is known of the surfaces
that it moves is what it reports of them.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar.control.attitude import attitude_step, followed_rate
from tgl_soar.control.envelope import Limited, elevator_limit, limit_surfaces
from tgl_soar.control.gain_blend import pid_between, soaring_between
from tgl_soar.control.heading import HeadingGains, heading_step, leading_speed, sideways_step
from tgl_soar.control.lateral_schedule import (
    heading_gains,
    lateral_bandwidth,
    roll_gains,
    sideways_gains,
)
from tgl_soar.control.laws import Laws
from tgl_soar.control.pid import PidGains, PidState, PidTerms
from tgl_soar.control.pitch_schedule import (
    ScheduledGains,
    pitch_gains,
    schedule_at_age,
    soaring_gains,
    speed_within,
)
from tgl_soar.control.point_hold import BrakeEffect
from tgl_soar.control.soaring import SoaringGains
from tgl_soar.types import (
    NAN,
    OURS,
    THEIRS,
    Setpoints,
    SurfaceCommand,
    SurfacesSample,
    VehicleState,
)

TRAVEL_END: Final = 0.98  # of travel: a surface read back from here on can go no further
NO_TERMS: Final = PidTerms(output=NAN, p=NAN, i=NAN, d=NAN, feedforward=NAN, saturated=0)


class LoopsState(NamedTuple):
    """What the loops of the surfaces remember, and the last command."""

    pitch: PidState
    roll: PidState
    heading: PidState
    limited: Limited
    pitch_setpoint_rad: float = NAN  # NaN: none was followed


def loops_begun(limited: Limited, vehicle: VehicleState) -> LoopsState:
    """The loops with nothing learnt; a derivative that begins at the present rate makes no step."""
    return LoopsState(
        pitch=PidState(0.0, -vehicle.pitch_rate_radps),
        roll=PidState(0.0, -vehicle.roll_rate_radps),
        heading=PidState(0.0, -vehicle.heading_rate_radps),
        limited=limited,
        pitch_setpoint_rad=NAN,
    )


class SurfaceGains(NamedTuple):
    """The gains that the loops fly with, as they are scheduled."""

    pitch: PidGains
    roll: PidGains
    heading: HeadingGains
    setpoint_weight: float  # of the pitch setpoint's rate in the derivative


class SurfaceTerms(NamedTuple):
    """What each surface's deflection is made of."""

    elevator: PidTerms
    aileron: PidTerms
    rudder: PidTerms


def line_gains(
    laws: Laws, imu_weight: float, airspeed_mps: float, age_s: float, eta_rad: float
) -> SoaringGains:
    """Of the soaring law, on a line at eta_rad, likewise."""
    return soaring_gains(
        soaring_between(laws.soaring, laws.soaring_imu, imu_weight),
        schedule_at_age(laws.schedule, age_s),
        imu_weight,
        airspeed_mps,
        eta_rad,
    )


def surface_gains(laws: Laws, imu_weight: float, airspeed_mps: float, age_s: float) -> SurfaceGains:
    """At an airspeed, with attitudes that old on average.  imu_weight: of the gains with
    accelerations, 0 … 1."""
    lateral = laws.lateral_schedule
    bandwidth = lateral_bandwidth(lateral, age_s)
    return SurfaceGains(
        pitch_gains(
            pid_between(laws.pitch, laws.pitch_imu, imu_weight),
            schedule_at_age(laws.schedule, age_s),
            airspeed_mps,
        ),
        roll_gains(laws.roll, lateral, bandwidth, airspeed_mps),
        heading_gains(laws.heading, lateral, bandwidth, airspeed_mps),
        imu_weight * laws.setpoint_weight,
    )


def scheduled_gains(
    laws: Laws, airspeed_mps: float, line: PidGains, surfaces: SurfaceGains
) -> ScheduledGains:
    """The gains of all loops, to be shown and logged."""
    return ScheduledGains(
        airspeed_mps=speed_within(laws.schedule, airspeed_mps),
        rho_p=line.kp,
        rho_i=line.ki,
        rho_d=line.kd,
        ele_p=surfaces.pitch.kp,
        ele_i=surfaces.pitch.ki,
        ele_d=surfaces.pitch.kd,
        ail_p=surfaces.roll.kp,
        ail_d=surfaces.roll.kd,
        rud_d=surfaces.heading.pid.kd,
    )


def bank_step(
    laws: Laws,
    state: PidState,
    vehicle: VehicleState,
    course_rad: float,
    airspeed_mps: float,
    age_s: float,
    blocked: int,
    dt_s: float,
) -> tuple[PidState, PidTerms]:
    """The bank that leads the aircraft to the middle.

    course_rad: the heading setpoint, from the wind.  age_s: of attitudes, on average.
    """
    bandwidth = lateral_bandwidth(laws.lateral_schedule, age_s)
    gains = sideways_gains(laws.sideways, laws.lateral_schedule, bandwidth)
    airspeed = speed_within(laws.schedule, airspeed_mps)
    return sideways_step(
        gains,
        state,
        course_rad,
        leading_speed(laws.heading, gains.kd, vehicle.x_m, airspeed),
        vehicle.velocity_y_mps,
        dt_s,
        blocked,
    )


def surfaces_step(
    laws: Laws,
    gains: SurfaceGains,
    state: LoopsState,
    vehicle: VehicleState,
    setpoints: Setpoints,
    brake: float,
    brake_max: float,
    braked: BrakeEffect,
    stall_rad: float,
    surfaces: SurfacesSample,
    flies: bool,
    dt_s: float,
) -> tuple[LoopsState, SurfaceTerms]:
    """One step.

    brake, brake_max: wanted, and the furthest it may go; braked: what the brake changes now; flies:
    the mode is in control; stall_rad: the stall's margin; surfaces: as they are read back.
    """
    trim = laws.trim
    if braked.elevator != 0.0:
        trim = trim._replace(elevator=trim.elevator + braked.elevator)
    pitch, roll, followed_rad = state.pitch, state.roll, NAN
    elevator_terms = aileron_terms = NO_TERMS
    if laws.loops == OURS:
        followed_rad, slew_radps = setpoints.pitch_rad, laws.soaring.slew_radps
        weight, before_rad = gains.setpoint_weight, state.pitch_setpoint_rad
        rate_radps = followed_rate(weight, followed_rad, before_rad, slew_radps, dt_s)
        pitch, elevator_terms = attitude_step(
            gains.pitch,
            state.pitch,
            setpoints.pitch_rad,
            vehicle.pitch_rad,
            vehicle.pitch_rate_radps,
            trim.elevator,
            dt_s,
            state.limited.elevator_blocked,
            setpoint_rate_radps=rate_radps,
        )
        roll, aileron_terms = attitude_step(
            gains.roll,
            state.roll,
            setpoints.roll_rad,
            vehicle.roll_rad,
            vehicle.roll_rate_radps,
            trim.aileron,
            dt_s,
            state.limited.aileron_blocked,
        )
    heading, rudder_terms = heading_step(
        gains.heading,
        state.heading,
        setpoints.heading_rad,
        vehicle.heading_rad,
        vehicle.heading_rate_radps,
        trim.rudder,
        dt_s,
    )
    wanted = SurfaceCommand(elevator_terms.output, aileron_terms.output, rudder_terms.output, brake)
    if laws.loops != OURS:
        wanted = SurfaceCommand(trim.elevator, trim.aileron, rudder_terms.output, 0.0)
    limited = limit_surfaces(
        laws.envelope,
        state.limited.command,
        wanted,
        elevator_limit(laws.envelope, trim.elevator, stall_rad, vehicle.pitch_rate_radps),
        brake_max,
        flies,
        dt_s,
    )
    if laws.loops != OURS:
        limited = _left_to_firmware(limited, laws.loops, surfaces)
    loops = LoopsState(
        pitch=pitch,
        roll=roll,
        heading=heading,
        limited=limited,
        pitch_setpoint_rad=followed_rad,
    )
    return loops, SurfaceTerms(elevator_terms, aileron_terms, rudder_terms)


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
        command=SurfaceCommand(NAN, NAN, rudder, 0.0),
        elevator_blocked=blocked,
        aileron_blocked=0,
        brake_blocked=0,
        brake_max=1.0,
        finite=limited.finite,
        cut=limited.cut,
    )
