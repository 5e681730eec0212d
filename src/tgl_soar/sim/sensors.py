"""Sensors: each with its own rate, delay, noise and bias.

    sample j is taken at step j P, of the truth at that instant, and carries that time stamp;
    it is delivered at the first step that is not earlier than its time plus the delay T:
    step j P + D, with P = step rate / sensor rate and D = ceil(T · step rate)

    measured = truth + bias + noise      bias ~ N(0, σ_bias²) once a flight, noise ~ N(0, σ²)

Steps are counted in integers from 0 (the start of the flight): a sensor of 100 Hz gives exactly
100 samples in a second, or is refused.  Attitude noise is a small rotation about body axes,
q ⊗ (1, n/2).  A pitot tube errs in pressure: V = √(max(0, u_b² + 2 n / ρ)), u_b the air's
speed along the nose.

Samples are in local NED and FRD, as an autopilot reports them.  The functions that measure
are pure and take their noise as arguments; `sim.sensor_sampling` gives it to them, and delays
what they measure.
"""

from __future__ import annotations

from math import ceil, cos, inf, isfinite, sin, sqrt
from typing import Final, NamedTuple

from tgl_soar.estimation.ground_range import beam_drop, beam_reach, ground_height
from tgl_soar.geometry import (
    SoaringFrame,
    euler_from_quaternion,
    ned_from_soaring,
    ned_vector_from_soaring,
    quaternion_product,
)
from tgl_soar.sim.aircraft import (
    AircraftState,
    Wind,
    air_velocity_frd,
)
from tgl_soar.sim.flown_aircraft import FlownAircraft
from tgl_soar.sim.tether import NO_PULL, pull_frd
from tgl_soar.types import (
    NAN,
    AirspeedSample,
    AttitudeSample,
    Ground,
    ImuSample,
    PositionFix,
    RangeSample,
)

Triple = tuple[float, float, float]

BEAM_DROP_MIN = 0.2  # a beam that is nearer to the horizontal meets no ground
BEAM_STEPS = 6  # on a slope of 1 at 20 degrees each leaves a third of what it was off by: 0.2 %


# --- when: rates and delays -----------------------------------------------------------------


class SensorTiming(NamedTuple):
    """A sensor's rate and delay, in steps of the simulation."""

    step_rate_hz: float
    period_steps: int  # P
    delay_steps: int  # D


def sensor_timing(name: str, rate_hz: float, delay_s: float, step_rate_hz: float) -> SensorTiming:
    """Timing of a sensor in a simulation that steps at `step_rate_hz`.

    Errors: ValueError for a rate that does not divide the step rate, or a bad delay.
    """
    if not (isfinite(step_rate_hz) and step_rate_hz > 0.0):
        raise ValueError(f"simulation step rate {step_rate_hz} Hz: must be positive")
    if not 0.0 < rate_hz <= step_rate_hz:
        raise ValueError(f"{name} rate {rate_hz} Hz: must be above 0, up to {step_rate_hz:g} Hz")
    period = round(step_rate_hz / rate_hz)
    if abs(period * rate_hz - step_rate_hz) > 1e-9 * step_rate_hz:
        raise ValueError(
            f"{name} rate {rate_hz:g} Hz does not divide the simulation's {step_rate_hz:g} Hz:"
            f" near it are {step_rate_hz / (period + 1):g}, {step_rate_hz / period:g}"
            f" and {step_rate_hz / max(1, period - 1):g} Hz, or change the step rate"
        )
    if not 0.0 <= delay_s < 60.0:
        raise ValueError(f"{name} delay {delay_s} s: must be from 0 to 60 s")
    return SensorTiming(step_rate_hz, period, ceil(delay_s * step_rate_hz - 1e-9))


def samples_taken(timing: SensorTiming, step: int) -> int:
    """Samples taken up to and including this step."""
    return step // timing.period_steps + 1


def samples_delivered(timing: SensorTiming, step: int) -> int:
    """Samples delivered up to and including this step."""
    if step < timing.delay_steps:
        return 0
    return (step - timing.delay_steps) // timing.period_steps + 1


# --- what: pure measurements ----------------------------------------------------------------


class PositionParams(NamedTuple):
    """A source of position: motion capture, or the autopilot's own estimate."""

    rate_hz: float
    delay_s: float
    noise_m: float  # standard deviation, each axis
    bias_m: float
    velocity_noise_mps: float
    gives_velocity: bool
    # Slow errors of a receiver of satellites, each axis a Gauss-Markov process of its own: what
    # orbits, clocks and the air are wrong by.  They are not in the velocity, which is Doppler's.
    drift_m: float = 0.0  # horizontally, standard deviation; needs noise_m, which it is drawn with
    drift_up_m: float = 0.0
    drift_s: float = 300.0  # time constant


class AttitudeParams(NamedTuple):
    """A source of attitude and body rates."""

    rate_hz: float
    delay_s: float
    noise_rad: float  # standard deviation, each body axis
    bias_rad: float
    rate_noise_radps: float
    rate_bias_radps: float


class ImuParams(NamedTuple):
    """Accelerometers and gyros."""

    rate_hz: float
    delay_s: float
    force_noise_mps2: float  # standard deviation, each axis
    force_bias_mps2: float
    rate_noise_radps: float
    rate_bias_radps: float


class AirspeedParams(NamedTuple):
    """A pitot tube."""

    rate_hz: float
    delay_s: float
    pressure_noise_pa: float
    pressure_bias_pa: float


class RangeParams(NamedTuple):
    """A rangefinder that looks down along the body's third axis."""

    rate_hz: float
    delay_s: float
    noise_m: float  # standard deviation
    min_m: float  # it measures nothing nearer
    max_m: float  # nor farther
    lost: float  # fraction of the samples in which nothing comes back


class SurfacesParams(NamedTuple):
    """The autopilot's own word on what it puts out to the servos."""

    rate_hz: float
    delay_s: float


# A motion-capture hall: millimetres, streamed through one network and one computer.
MOTION_CAPTURE = PositionParams(
    rate_hz=100.0,
    delay_s=0.015,
    noise_m=0.0005,
    bias_m=0.0,
    velocity_noise_mps=0.0,
    gives_velocity=False,
)
# An autopilot's local position with motion capture as its aid: smoother, slower, later.
AUTOPILOT_POSITION = PositionParams(
    rate_hz=50.0,
    delay_s=0.040,
    noise_m=0.002,
    bias_m=0.0,
    velocity_noise_mps=0.03,
    gives_velocity=True,
)
# A receiver of satellites without corrections, as an autopilot's filter passes it on: good within a
# minute, off by a metre and two in height over many.
DRIFTING_POSITION = PositionParams(
    rate_hz=50.0,
    delay_s=0.100,
    noise_m=0.02,
    bias_m=0.0,
    velocity_noise_mps=0.05,
    gives_velocity=True,
    drift_m=1.0,
    drift_up_m=2.0,
)
# A receiver with carrier-phase corrections of a base nearby, its ambiguities fixed: data sheets of
# two-frequency ones promise 1 cm and a millionth of the way to the base, for half of the fixes.
RTK_POSITION = DRIFTING_POSITION._replace(noise_m=0.01, drift_m=0.01, drift_up_m=0.02)
# What a simulated autopilot takes its position from, by the bridge's name for it.
RECEIVERS: Final = {
    "local": AUTOPILOT_POSITION,
    "satellites": DRIFTING_POSITION,
    "rtk": RTK_POSITION,
}
# An autopilot's attitude estimate: 0.1 degrees of jitter, aligned to 0.3 degrees.
AUTOPILOT_ATTITUDE = AttitudeParams(
    rate_hz=200.0,
    delay_s=0.005,
    noise_rad=0.0017,
    bias_rad=0.005,
    rate_noise_radps=0.01,
    rate_bias_radps=0.002,
)
# Consumer MEMS behind a 100 Hz filter, on an airframe without an engine.
MEMS_IMU = ImuParams(
    rate_hz=200.0,
    delay_s=0.0,
    force_noise_mps2=0.10,
    force_bias_mps2=0.10,
    rate_noise_radps=0.01,
    rate_bias_radps=0.002,
)
# A differential pressure sensor of 500 Pa: 0.13 m/s of noise at 8.5 m/s.
PITOT = AirspeedParams(50.0, 0.010, 1.4, 1.0)
# A small laser: centimetres, over grass in the sun up to some 40 m; one reading in fifty is lost.
LASER_RANGE = RangeParams(
    rate_hz=20.0, delay_s=0.030, noise_m=0.03, min_m=0.2, max_m=40.0, lost=0.02
)
# An autopilot's output channels, read back over the link.
READ_BACK = SurfacesParams(50.0, 0.010)


class Sensors(NamedTuple):
    """What a simulated aircraft carries; None: that it does not have."""

    position: PositionParams = AUTOPILOT_POSITION
    attitude: AttitudeParams = AUTOPILOT_ATTITUDE
    imu: ImuParams | None = None
    airspeed: AirspeedParams | None = None
    surfaces: SurfacesParams | None = None
    rangefinder: RangeParams | None = None


USUAL_SENSORS = Sensors()  # the autopilot's own position and attitude


def measure_position(
    frame: SoaringFrame,
    state: AircraftState,
    sequence: int,
    time_s: float,
    error_m: Triple,
    velocity_error_mps: Triple,
) -> PositionFix:
    """A fix of the state, local NED; errors are added in NED (NaN: no velocity given)."""
    north, east, down = ned_from_soaring(frame, state.x_m, state.y_m, state.z_m)
    v_north, v_east, v_down = ned_vector_from_soaring(
        frame, state.velocity_x_mps, state.velocity_y_mps, state.velocity_z_mps
    )
    return PositionFix(
        sequence=sequence,
        time_s=time_s,
        north_m=north + error_m[0],
        east_m=east + error_m[1],
        down_m=down + error_m[2],
        velocity_north_mps=v_north + velocity_error_mps[0],
        velocity_east_mps=v_east + velocity_error_mps[1],
        velocity_down_mps=v_down + velocity_error_mps[2],
        source=0,
        sigma_m=NAN,
        reckoned=False,
    )


def measure_attitude(
    frame: SoaringFrame,
    state: AircraftState,
    sequence: int,
    time_s: float,
    error_rad: Triple,
    rate_error_radps: Triple,
) -> AttitudeSample:
    """An attitude of the state, FRD to local NED; errors are small rotations about FRD axes."""
    half = 0.5 * frame.wind_from_rad  # upwind NED is local NED turned to where wind comes from
    aw, ax, ay, az = quaternion_product(
        cos(half), 0.0, 0.0, sin(half), state.qw, state.qx, state.qy, state.qz
    )
    qw, qx, qy, qz = quaternion_product(
        aw, ax, ay, az, 1.0, 0.5 * error_rad[0], 0.5 * error_rad[1], 0.5 * error_rad[2]
    )
    unit = 1.0 / sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
    return AttitudeSample(
        sequence=sequence,
        time_s=time_s,
        qw=qw * unit,
        qx=qx * unit,
        qy=qy * unit,
        qz=qz * unit,
        roll_rate_frd_radps=state.roll_rate_frd_radps + rate_error_radps[0],
        pitch_rate_frd_radps=state.pitch_rate_frd_radps + rate_error_radps[1],
        yaw_rate_frd_radps=state.yaw_rate_frd_radps + rate_error_radps[2],
    )


def resting_force_frd(gravity_mps2: float, state: AircraftState) -> tuple[float, float, float]:
    """What that accelerometer feels while somebody holds the aircraft still [m/s², FRD]."""
    g, qw, qx, qy, qz = gravity_mps2, state.qw, state.qx, state.qy, state.qz
    return (
        -2.0 * g * (qx * qz - qw * qy),
        -2.0 * g * (qy * qz + qw * qx),
        -g * (1.0 - 2.0 * (qx * qx + qy * qy)),
    )


def measure_imu(
    aircraft: FlownAircraft,
    state: AircraftState,
    wind: Wind,
    rests: bool,
    sequence: int,
    time_s: float,
    force_error_mps2: Triple,
    rate_error_radps: Triple,
    pull_mps2: Triple = NO_PULL,
) -> ImuSample:
    """Specific force and body rates of the state in a wind (u, v, w) [m/s], FRD.

    rests: it does not fly, something holds it where it is.  `pull_mps2`: what a tether accelerates
    the aircraft by, soaring frame.
    """
    fx, fy, fz = aircraft.specific_force_frd(state, wind)
    if pull_mps2 != NO_PULL:
        tx, ty, tz = pull_frd(state, pull_mps2)
        fx, fy, fz = fx + tx, fy + ty, fz + tz
    if rests:
        fx, fy, fz = resting_force_frd(aircraft.gravity_mps2, state)
    return ImuSample(
        sequence=sequence,
        time_s=time_s,
        force_x_frd_mps2=fx + force_error_mps2[0],
        force_y_frd_mps2=fy + force_error_mps2[1],
        force_z_frd_mps2=fz + force_error_mps2[2],
        roll_rate_frd_radps=state.roll_rate_frd_radps + rate_error_radps[0],
        pitch_rate_frd_radps=state.pitch_rate_frd_radps + rate_error_radps[1],
        yaw_rate_frd_radps=state.yaw_rate_frd_radps + rate_error_radps[2],
    )


def measure_airspeed(
    aircraft: FlownAircraft,
    state: AircraftState,
    wind: Wind,
    sequence: int,
    time_s: float,
    pressure_error_pa: float,
) -> AirspeedSample:
    """What a pitot tube along the nose reads in a wind (u, v, w) [m/s]."""
    along, _, _ = air_velocity_frd(state, wind)
    squared = max(0.0, along) ** 2 + 2.0 * pressure_error_pa / aircraft.air_density_kgpm3
    return AirspeedSample(sequence, time_s, sqrt(max(0.0, squared)))


def measure_range(
    ground: Ground, state: AircraftState, sequence: int, time_s: float, error_m: float
) -> RangeSample:
    """The distance to a profile of the ground along the body's third axis; inf: it meets none.

    The beam's end and the ground there agree after a few steps, as long as the ground is less
    steep than the beam.
    """
    roll, pitch, heading = euler_from_quaternion(state.qw, state.qx, state.qy, state.qz)
    drop, reach = beam_drop(roll, pitch), beam_reach(roll, pitch, heading)
    if drop < BEAM_DROP_MIN:
        return RangeSample(sequence, time_s, inf)
    range_m = (state.z_m - ground_height(ground, state.x_m)) / drop
    for _ in range(BEAM_STEPS):
        range_m = (state.z_m - ground_height(ground, state.x_m + range_m * reach)) / drop
    return RangeSample(sequence, time_s, range_m + error_m)
