"""The sensors in one flight: when each measures, with which noise, and when that arrives.

A sensor is its figures (`sim.sensors`), the numbers that are random in one flight
(`sim.white_noise`; one stream for each sensor, so that a flight with one sensor more is otherwise
the same flight) and its delay line, the only thing that changes.  Plain Python and numba take the
same functions.
"""

from __future__ import annotations

from collections.abc import Callable
from math import erf, sqrt
from typing import Any, NamedTuple, Protocol, TypeVar

from tgl_soar.geometry import SoaringFrame
from tgl_soar.sim.aircraft import AircraftState, Wind
from tgl_soar.sim.flown_aircraft import FlownAircraft
from tgl_soar.sim.sensors import (
    AirspeedParams,
    AttitudeParams,
    ImuParams,
    PositionParams,
    RangeParams,
    Sensors,
    SensorTiming,
    Triple,
    measure_airspeed,
    measure_attitude,
    measure_imu,
    measure_position,
    measure_range,
    samples_delivered,
    sensor_timing,
)
from tgl_soar.sim.tether import NO_PULL
from tgl_soar.sim.white_noise import Row, Rows, White, with_drift
from tgl_soar.types import (
    NAN,
    NO_AIRSPEED,
    NO_ATTITUDE,
    NO_FIX,
    NO_GROUND,
    NO_IMU,
    NO_RANGE,
    NO_SURFACES,
    AirspeedSample,
    AttitudeSample,
    Ground,
    ImuSample,
    PositionFix,
    RangeSample,
    SurfaceCommand,
    SurfacesSample,
)

Sample = TypeVar(
    "Sample",
    PositionFix,
    AttitudeSample,
    ImuSample,
    AirspeedSample,
    SurfacesSample,
    RangeSample,
)


class DelayLine(Protocol[Sample]):
    """A delay line: sample k lies at place k % its length."""

    def __len__(self) -> int: ...
    def __getitem__(self, place: int, /) -> Sample: ...
    def __setitem__(self, place: int, sample: Sample, /) -> None: ...


def line_length(timing: SensorTiming) -> int:
    """As many samples as can be under way, and one."""
    return -(-timing.delay_steps // timing.period_steps) + 1


def keep_sample(line: DelayLine[Sample], k: int, sample: Sample) -> None:
    """Put sample k (0, 1, 2 …) under way."""
    line[k % len(line)] = sample


def delivered(timing: SensorTiming, line: DelayLine[Sample], step: int) -> Sample:
    """The newest sample that has arrived by this step; `line` has been given all taken ones.

    Before the first one it is what lay in the line's last place from the beginning.
    """
    return line[(samples_delivered(timing, step) - 1) % len(line)]


class PositionSensor(NamedTuple):
    """A source of position fixes, local NED."""

    params: PositionParams
    timing: SensorTiming
    bias_m: Triple
    white: Rows  # of every sample: place, velocity
    line: DelayLine[PositionFix]


class AttitudeSensor(NamedTuple):
    """A source of attitude and body rates."""

    params: AttitudeParams
    timing: SensorTiming
    bias_rad: Triple
    rate_bias_radps: Triple
    white: Rows  # of every sample: rotation, rates
    line: DelayLine[AttitudeSample]


class ImuSensor(NamedTuple):
    """Accelerometers and gyros."""

    fitted: bool
    params: ImuParams
    timing: SensorTiming
    force_bias_mps2: Triple
    rate_bias_radps: Triple
    white: Rows  # of every sample: force, rates
    line: DelayLine[ImuSample]


class AirspeedSensor(NamedTuple):
    """A pitot tube."""

    fitted: bool
    params: AirspeedParams
    timing: SensorTiming
    pressure_bias_pa: float
    white: Rows  # of every sample: pressure
    line: DelayLine[AirspeedSample]


class SurfacesSensor(NamedTuple):
    """The surfaces as the autopilot puts them out."""

    fitted: bool
    timing: SensorTiming
    line: DelayLine[SurfacesSample]


class RangeSensor(NamedTuple):
    """A rangefinder that looks down at the site's own profile of the ground."""

    fitted: bool
    params: RangeParams
    timing: SensorTiming
    ground: Ground
    white: Rows  # of every sample: distance, and whether anything comes back
    line: DelayLine[RangeSample]


class FlownSensors(NamedTuple):
    """All sensors in one flight."""

    position: PositionSensor
    attitude: AttitudeSensor
    imu: ImuSensor
    airspeed: AirspeedSensor
    surfaces: SurfacesSensor
    rangefinder: RangeSensor


class Samples(NamedTuple):
    """The newest samples that have arrived."""

    position: PositionFix
    attitude: AttitudeSample
    imu: ImuSample
    airspeed: AirspeedSample
    surfaces: SurfacesSample
    rangefinder: RangeSample


NO_SAMPLES = Samples(
    position=NO_FIX,
    attitude=NO_ATTITUDE,
    imu=NO_IMU,
    airspeed=NO_AIRSPEED,
    surfaces=NO_SURFACES,
    rangefinder=NO_RANGE,
)
# One that is not fitted needs figures, too: numba wants every field.
_NO_IMU = ImuParams(
    rate_hz=1.0,
    delay_s=0.0,
    force_noise_mps2=0.0,
    force_bias_mps2=0.0,
    rate_noise_radps=0.0,
    rate_bias_radps=0.0,
)
_NO_PITOT = AirspeedParams(1.0, 0.0, 0.0, 0.0)
_NO_RANGEFINDER = RangeParams(rate_hz=1.0, delay_s=0.0, noise_m=0.0, min_m=0.0, max_m=0.0, lost=0.0)
_NEVER = 1_000_000_000  # steps


def flown_sensors(
    sensors: Sensors,
    step_rate_hz: float,
    white: White,
    line: Callable[[Any, int], Any] = lambda nothing, length: [nothing] * length,
    ground: Ground = NO_GROUND,
) -> FlownSensors:
    """The sensors of one flight: `white` is its randomness, `line` makes the delay lines.

    ground: what a rangefinder looks at.

    Errors: ValueError for a rate that does not divide the step rate.
    """

    def timing(name: str, params: Any) -> SensorTiming:
        if params is None:
            return SensorTiming(step_rate_hz, _NEVER, 0)
        return sensor_timing(name, params.rate_hz, params.delay_s, step_rate_hz)

    def under_way(timing: SensorTiming, nothing: Any) -> Any:
        return line(nothing, line_length(timing))

    position, attitude = sensors.position, sensors.attitude
    imu, pitot = sensors.imu or _NO_IMU, sensors.airspeed or _NO_PITOT
    when = timing("position", position)
    place, fixes = white("position", when.period_steps, 3, 6 if position.gives_velocity else 3)
    a_position = PositionSensor(
        params=position,
        timing=when,
        bias_m=scaled(place, 0, position.bias_m),
        white=_drifting(position, when, fixes, white),
        line=under_way(when, NO_FIX),
    )
    when = timing("attitude", attitude)
    turn, attitudes = white("attitude", when.period_steps, 6, 6)
    an_attitude = AttitudeSensor(
        params=attitude,
        timing=when,
        bias_rad=scaled(turn, 0, attitude.bias_rad),
        rate_bias_radps=scaled(turn, 3, attitude.rate_bias_radps),
        white=attitudes,
        line=under_way(when, NO_ATTITUDE),
    )
    when = timing("imu", sensors.imu)
    force, forces = white("imu", when.period_steps, 6, 6)
    an_imu = ImuSensor(
        fitted=sensors.imu is not None,
        params=imu,
        timing=when,
        force_bias_mps2=scaled(force, 0, imu.force_bias_mps2),
        rate_bias_radps=scaled(force, 3, imu.rate_bias_radps),
        white=forces,
        line=under_way(when, NO_IMU),
    )
    when = timing("airspeed", sensors.airspeed)
    pressure, pressures = white("airspeed", when.period_steps, 1, 1)
    an_airspeed = AirspeedSensor(
        fitted=sensors.airspeed is not None,
        params=pitot,
        timing=when,
        pressure_bias_pa=pressure[0] * pitot.pressure_bias_pa,
        white=pressures,
        line=under_way(when, NO_AIRSPEED),
    )
    when = timing("surfaces", sensors.surfaces)
    surfaces = SurfacesSensor(sensors.surfaces is not None, when, under_way(when, NO_SURFACES))
    return FlownSensors(
        position=a_position,
        attitude=an_attitude,
        imu=an_imu,
        airspeed=an_airspeed,
        surfaces=surfaces,
        rangefinder=_rangefinder(
            sensors.rangefinder, timing("rangefinder", sensors.rangefinder), ground, white, line
        ),
    )


def _rangefinder(
    params: RangeParams | None,
    timing: SensorTiming,
    ground: Ground,
    white: White,
    line: Callable[[Any, int], Any],
) -> RangeSensor:
    _, ranges = white("rangefinder", timing.period_steps, 0, 2)
    return RangeSensor(
        fitted=params is not None and ground.points > 0,
        params=params or _NO_RANGEFINDER,
        timing=timing,
        ground=ground,
        white=ranges,
        line=line(NO_RANGE, line_length(timing)),
    )


def _drifting(params: PositionParams, timing: SensorTiming, fixes: Rows, white: White) -> Rows:
    """The numbers of position fixes with the receiver's slow errors in them."""
    if params.drift_m == 0.0 and params.drift_up_m == 0.0:
        return fixes
    if not params.noise_m > 0.0:
        raise ValueError("position: drift_m, drift_up_m: a drift needs noise_m above 0")
    period_s = timing.period_steps / timing.step_rate_hz
    start, steps = white("position drift", timing.period_steps, 3, 3)
    horizontal, up = params.drift_m / params.noise_m, params.drift_up_m / params.noise_m
    sizes = (horizontal, horizontal, up)
    return with_drift(fixes, steps, start, sizes, period_s / params.drift_s)


def scaled(white: Row, first: int, deviation: float) -> Triple:
    """Three of a row's white numbers, with a standard deviation."""
    return white[first] * deviation, white[first + 1] * deviation, white[first + 2] * deviation


def biased(bias: Triple, error: Triple) -> Triple:
    """Their sum."""
    return bias[0] + error[0], bias[1] + error[1], bias[2] + error[2]


def sense_position(
    sensor: PositionSensor, frame: SoaringFrame, state: AircraftState, step: int
) -> PositionFix:
    """The newest fix that has arrived by this step (0, 1, 2 …); sequence 0: none yet."""
    timing, params = sensor.timing, sensor.params
    if step % timing.period_steps == 0:
        k = step // timing.period_steps
        white = sensor.white[k]
        velocity_error = (NAN, NAN, NAN)
        if params.gives_velocity:
            velocity_error = scaled(white, 3, params.velocity_noise_mps)
        sample = measure_position(
            frame,
            state,
            k + 1,
            step / timing.step_rate_hz,
            biased(sensor.bias_m, scaled(white, 0, params.noise_m)),
            velocity_error,
        )
        keep_sample(sensor.line, k, sample)
    return delivered(timing, sensor.line, step)


def sense_attitude(
    sensor: AttitudeSensor, frame: SoaringFrame, state: AircraftState, step: int
) -> AttitudeSample:
    """The newest attitude that has arrived by this step (0, 1, 2 …); sequence 0: none yet."""
    timing, params = sensor.timing, sensor.params
    if step % timing.period_steps == 0:
        k = step // timing.period_steps
        white = sensor.white[k]
        sample = measure_attitude(
            frame,
            state,
            k + 1,
            step / timing.step_rate_hz,
            biased(sensor.bias_rad, scaled(white, 0, params.noise_rad)),
            biased(sensor.rate_bias_radps, scaled(white, 3, params.rate_noise_radps)),
        )
        keep_sample(sensor.line, k, sample)
    return delivered(timing, sensor.line, step)


def sense_imu(
    sensor: ImuSensor,
    aircraft: FlownAircraft,
    state: AircraftState,
    wind: Wind,
    rests: bool,
    step: int,
    pull_mps2: Triple = NO_PULL,
) -> ImuSample:
    """The newest accelerations that have arrived by this step (0, 1, 2 …); sequence 0: none yet."""
    timing, params = sensor.timing, sensor.params
    if not sensor.fitted:
        return NO_IMU
    if step % timing.period_steps == 0:
        k = step // timing.period_steps
        white = sensor.white[k]
        sample = measure_imu(
            aircraft,
            state,
            wind,
            rests,
            sequence=k + 1,
            time_s=step / timing.step_rate_hz,
            force_error_mps2=biased(
                sensor.force_bias_mps2, scaled(white, 0, params.force_noise_mps2)
            ),
            rate_error_radps=biased(
                sensor.rate_bias_radps, scaled(white, 3, params.rate_noise_radps)
            ),
            pull_mps2=pull_mps2,
        )
        keep_sample(sensor.line, k, sample)
    return delivered(timing, sensor.line, step)


def sense_airspeed(
    sensor: AirspeedSensor, aircraft: FlownAircraft, state: AircraftState, wind: Wind, step: int
) -> AirspeedSample:
    """The newest airspeed that has arrived by this step (0, 1, 2 …); sequence 0: none yet."""
    timing = sensor.timing
    if not sensor.fitted:
        return NO_AIRSPEED
    if step % timing.period_steps == 0:
        k = step // timing.period_steps
        error_pa = sensor.pressure_bias_pa + sensor.white[k][0] * sensor.params.pressure_noise_pa
        sample = measure_airspeed(
            aircraft, state, wind, k + 1, step / timing.step_rate_hz, error_pa
        )
        keep_sample(sensor.line, k, sample)
    return delivered(timing, sensor.line, step)


def sense_surfaces(sensor: SurfacesSensor, command: SurfaceCommand, step: int) -> SurfacesSample:
    """The newest surfaces that were read back by this step (0, 1, 2 …); sequence 0: none yet."""
    timing = sensor.timing
    if not sensor.fitted:
        return NO_SURFACES
    if step % timing.period_steps == 0:
        k = step // timing.period_steps
        sample = SurfacesSample(
            sequence=k + 1,
            time_s=step / timing.step_rate_hz,
            elevator=command.elevator,
            aileron=command.aileron,
            rudder=command.rudder,
            brake=command.brake,
        )
        keep_sample(sensor.line, k, sample)
    return delivered(timing, sensor.line, step)


def sense_range(sensor: RangeSensor, state: AircraftState, step: int) -> RangeSample:
    """The newest distance that has arrived by this step (0, 1, 2 …); sequence 0: none yet.

    What is out of reach, or does not come back, is a sample without a number.
    """
    timing, params = sensor.timing, sensor.params
    if not sensor.fitted:
        return NO_RANGE
    if step % timing.period_steps == 0:
        k = step // timing.period_steps
        white = sensor.white[k]
        time_s, error_m = step / timing.step_rate_hz, white[0] * params.noise_m
        sample = measure_range(sensor.ground, state, k + 1, time_s, error_m)
        # Of a white number, the fraction of its distribution that lies below it.
        lost = 0.5 * (1.0 + erf(white[1] / sqrt(2.0))) < params.lost
        if lost or not params.min_m <= sample.range_m <= params.max_m:
            sample = sample._replace(range_m=NAN)
        keep_sample(sensor.line, k, sample)
    return delivered(timing, sensor.line, step)


def sense(
    sensors: FlownSensors,
    frame: SoaringFrame,
    aircraft: FlownAircraft,
    state: AircraftState,
    wind: Wind,
    command: SurfaceCommand,
    rests: bool,
    step: int,
    pull_mps2: Triple = NO_PULL,
) -> Samples:
    """Take the samples that are due at a step; the newest that have arrived.

    `pull_mps2`: what a tether accelerates the aircraft by, soaring frame.
    """
    return Samples(
        position=sense_position(sensors.position, frame, state, step),
        attitude=sense_attitude(sensors.attitude, frame, state, step),
        imu=sense_imu(sensors.imu, aircraft, state, wind, rests, step, pull_mps2),
        airspeed=sense_airspeed(sensors.airspeed, aircraft, state, wind, step),
        surfaces=sense_surfaces(sensors.surfaces, command, step),
        rangefinder=sense_range(sensors.rangefinder, state, step),
    )
