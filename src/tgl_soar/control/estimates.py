"""What a tick knows before it decides: all estimators, in the order of their needs."""

from __future__ import annotations

from typing import NamedTuple

from tgl_soar.control.conditions import with_uncertainty
from tgl_soar.control.envelope import Limited, Margins
from tgl_soar.control.envelope_margins import margins_of
from tgl_soar.control.gain_blend import weight_step
from tgl_soar.control.laws import Laws
from tgl_soar.control.pitch_schedule import age_step, speed_step
from tgl_soar.control.point import wind_with_brake
from tgl_soar.control.soaring import TrimState, trim_step
from tgl_soar.estimation.aerodynamics import glide_pitch
from tgl_soar.estimation.body_axes import body_axes
from tgl_soar.estimation.cross_wind import across_air, cross_wind_step, veer, veer_step
from tgl_soar.estimation.ground_range import (
    NO_RANGE_STATE,
    GroundRange,
    RangeState,
    range_step,
)
from tgl_soar.estimation.health import AIRSPEED as AIRSPEED_FAULT
from tgl_soar.estimation.health import RANGE as RANGE_FAULT
from tgl_soar.estimation.health import STALE_S, HealthState, health_step, initial_health
from tgl_soar.estimation.motion import (
    IMU_SILENT_S,
    is_imu_valid,
    motion_quality,
    motion_step,
    unshifted,
)
from tgl_soar.estimation.motion_state import MotionState, initial_motion
from tgl_soar.estimation.pitot_watch import NO_PITOT_WATCH, PitotWatch, pitot_step
from tgl_soar.estimation.wind import WindState, initial_wind, wind_step
from tgl_soar.types import (
    NAN,
    NO_AIRSPEED,
    OURS,
    AirEstimate,
    Health,
    Inputs,
    MotionQuality,
    SurfaceCommand,
    SurfacesSample,
    VehicleState,
    isfinite,
)


class EstimatorMemory(NamedTuple):
    """What the estimators remember from one tick to the next."""

    motion: MotionState
    wind: WindState
    pitot: PitotWatch
    cross_wind_mps: float  # along the soaring frame's y
    veer_rad: float  # by which the heading setpoint follows it
    health: HealthState
    pitch_trim: TrimState
    gust_pitch_rad: float  # by which the setpoint meets a gust
    imu_weight: float  # of the gains with accelerations in those flown, 0 … 1
    gain_speed_mps: float  # averaged airspeed that the gains are for; NaN: not known yet
    gain_age_s: float  # averaged age of attitudes, likewise
    confident_s: float  # of when the last fix is that made the position confident; NaN: none
    rangefinder: RangeState


class Estimates(NamedTuple):
    """What the estimators make of one tick, and what they remember of it."""

    vehicle: VehicleState
    quality: MotionQuality
    health: Health
    air: AirEstimate
    margins: Margins
    ground_range: GroundRange
    veer_rad: float  # where the wind comes from: zero along the frame, positive to the right
    memory: EstimatorMemory


def initial_memory() -> EstimatorMemory:
    """Before the first tick."""
    return EstimatorMemory(
        motion=initial_motion(),
        wind=initial_wind(),
        pitot=NO_PITOT_WATCH,
        cross_wind_mps=0.0,
        veer_rad=0.0,
        health=initial_health(),
        pitch_trim=TrimState(NAN, NAN),
        gust_pitch_rad=0.0,
        imu_weight=0.0,
        gain_speed_mps=NAN,
        gain_age_s=0.0,
        confident_s=NAN,
        rangefinder=NO_RANGE_STATE,
    )


def fresh(inputs: Inputs) -> Inputs:
    """The same, where what was read back of the surfaces is too old to say where they are: then
    that is not known."""
    read = inputs.surfaces
    if not inputs.time_s - read.time_s > STALE_S:  # true for NaN: none was read
        return inputs
    return inputs._replace(
        surfaces=SurfacesSample(
            sequence=read.sequence,
            time_s=read.time_s,
            elevator=NAN,
            aileron=NAN,
            rudder=NAN,
            brake=NAN,
        )
    )


def estimate(
    laws: Laws,
    before: EstimatorMemory,
    inputs: Inputs,
    flying: bool,
    limited: Limited,
    dt_s: float,
) -> Estimates:
    """Where the aircraft is, how it moves, in which air, and how certain that is.

    flying: the tick begins in control, and `limited` is what it commanded last.
    """
    known = before.motion
    if not flying:  # there is no line to be kept
        known = unshifted(known, inputs.time_s)
    motion, vehicle = motion_step(laws.motion, laws.frame, known, inputs, flying)
    quality = motion_quality(laws.motion, before.motion, motion, inputs.time_s)
    watched, health = health_step(
        laws.health,
        before.health,
        motion,
        inputs,
        flying,
        flying and laws.loops == OURS,  # else nothing is known of where surfaces should be
        limited.command,
        dt_s,
    )
    health = with_uncertainty(laws.guards, health, quality, flying)
    rangefinder, ground_range, health = _over_ground(
        laws, before.rangefinder, inputs, vehicle, health, quality.jumped, flying
    )
    pitot, wind, air, inputs, health = _air_read(
        laws, before, vehicle, motion, inputs, health=health, limited=limited,
        quality=quality, flying=flying, dt_s=dt_s,
    )  # fmt: skip
    veers = laws.cross_wind.veer_max_rad > 0.0
    cross_wind = before.cross_wind_mps if flying and veers else 0.0
    if veers:
        if health.position_ok and flying:
            cross_wind = cross_wind_step(laws.cross_wind, cross_wind, vehicle, air, dt_s)
        air = air._replace(cross_wind_mps=cross_wind)
    wanted = veer(laws.cross_wind, cross_wind, air.wind_mps)
    veered = veer_step(before.veer_rad, wanted, dt_s) if flying else 0.0
    glide = NAN
    if laws.pitch_trim.fraction > 0.0:
        glide = glide_pitch(laws.wind.aerodynamics, air.wind_mps - vehicle.velocity_x_mps)
    trim, gust = trim_step(
        laws.pitch_trim, before.pitch_trim, glide, air.updraft_mps, air.airspeed_mps, dt_s
    )
    margins = margins_of(laws, inputs, vehicle, health, air, motion.shift, ground_range, flying)
    age_s, oldest_s = health.attitude_age_s, laws.health.attitude_age_max_s
    if ground_range.correction_m != 0.0:
        vehicle = vehicle._replace(z_m=vehicle.z_m + ground_range.correction_m)
    return Estimates(
        vehicle=vehicle,
        quality=quality,
        health=health,
        air=air,
        margins=margins,
        ground_range=ground_range,
        veer_rad=veered,
        memory=EstimatorMemory(
            motion=motion,
            wind=wind,
            pitot=pitot,
            cross_wind_mps=cross_wind,
            veer_rad=veered,
            health=watched,
            pitch_trim=trim,
            gust_pitch_rad=gust,
            imu_weight=weight_step(before.imu_weight, quality.inertial, dt_s),
            gain_speed_mps=speed_step(before.gain_speed_mps, air.airspeed_mps, dt_s),
            gain_age_s=age_step(before.gain_age_s, age_s, oldest_s, flying, dt_s),
            confident_s=motion.fix.time_s if health.position_ok else before.confident_s,
            rangefinder=rangefinder,
        ),
    )


def _over_ground(
    laws: Laws,
    before: RangeState,
    inputs: Inputs,
    vehicle: VehicleState,
    health: Health,
    jumped: bool,
    flying: bool,
) -> tuple[RangeState, GroundRange, Health]:
    """What a rangefinder says of the height, and health with what is wrong with it."""
    sample, certain = inputs.rangefinder, health.position_ok
    after, found = range_step(
        laws.rangefinder, laws.ground, before, sample, vehicle, certain, jumped, flying
    )
    if found.refused:
        health = health._replace(faults=health.faults | RANGE_FAULT)
    return after, found, health


def _air_read(
    laws: Laws,
    before: EstimatorMemory,
    vehicle: VehicleState,
    motion: MotionState,
    inputs: Inputs,
    health: Health,
    limited: Limited,
    quality: MotionQuality,
    flying: bool,
    dt_s: float,
) -> tuple[PitotWatch, WindState, AirEstimate, Inputs, Health]:
    """The watch of the pitot tube and the air; where the tube lies, inputs without it, and health
    with that fault."""
    params = wind_with_brake(laws, limited, flying, inputs.surfaces)
    elevator = _elevator(inputs, flying, limited.command)
    # In a hand the wing carries nothing: of a tube nothing is learnt there, and nothing forgotten.
    pitot, wind = NO_PITOT_WATCH._replace(lies=before.pitot.lies), before.wind
    if flying and inputs.airspeed.sequence > 0:
        pitot = pitot_step(
            params.aerodynamics,
            params.push_mps2,
            before.pitot,
            vehicle,
            inputs,
            force_mps2=_force(params.aerodynamics.gravity_mps2, vehicle, motion, inputs),
            elevator=elevator,
            dt_s=dt_s,
        )
    if pitot.lies:
        if not before.pitot.lies:  # it has had its part in what was known of the wind
            wind = initial_wind()
        inputs = inputs._replace(airspeed=NO_AIRSPEED)
        if flying:  # only there it can be believed again: engaging would be refused for ever
            health = health._replace(faults=health.faults | AIRSPEED_FAULT)
    wind, air = wind_step(
        params,
        wind,
        across_air(vehicle, before.cross_wind_mps),
        inputs,
        quality.velocity_sigma_mps,
        elevator,
        is_imu_valid(before.motion, motion, inputs.time_s),
    )
    return pitot, wind, air, inputs, health


def _force(
    gravity_mps2: float, vehicle: VehicleState, motion: MotionState, inputs: Inputs
) -> tuple[float, float]:
    """Specific force, x and z: the last that was accepted, NaN after one that was not, and that of
    steady flight where none come."""
    if not inputs.time_s - motion.imu.time_s <= IMU_SILENT_S:  # true for NaN
        frame = body_axes(vehicle)
        return -gravity_mps2 * frame.x_d, -gravity_mps2 * frame.z_d
    imu = inputs.imu
    if imu.time_s != motion.imu.time_s:
        return NAN, NAN
    return imu.force_x_frd_mps2, imu.force_z_frd_mps2


def _elevator(inputs: Inputs, flying: bool, commanded: SurfaceCommand) -> float:
    """The elevator's deflection as it is read back, else as we command it, else NaN."""
    if isfinite(inputs.surfaces.elevator):
        return inputs.surfaces.elevator
    return commanded.elevator if flying else NAN
