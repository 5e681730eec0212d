"""Sensors: exact rates, exact delays, honest noise, right frames."""

from __future__ import annotations

from math import cos, exp, isnan, nan, radians, sin, sqrt
from statistics import fmean, stdev

import pytest
from msgspec.structs import asdict

from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.geometry import (
    SoaringFrame,
    euler_from_quaternion,
    ned_from_soaring,
    quaternion_from_euler,
)
from tgl_soar.sim.aircraft import (
    AircraftState,
    aircraft_model,
    glide_at,
    gliding_state,
    specific_force_frd,
)
from tgl_soar.sim.sensor_sampling import (
    FlownSensors,
    delivered,
    flown_sensors,
    line_length,
    sense_airspeed,
    sense_attitude,
    sense_imu,
    sense_position,
    sense_range,
)
from tgl_soar.sim.sensors import (
    AUTOPILOT_ATTITUDE,
    AUTOPILOT_POSITION,
    DRIFTING_POSITION,
    LASER_RANGE,
    MEMS_IMU,
    MOTION_CAPTURE,
    PITOT,
    AttitudeParams,
    PositionParams,
    RangeParams,
    Sensors,
    measure_airspeed,
    measure_attitude,
    measure_imu,
    measure_position,
    samples_delivered,
    samples_taken,
    sensor_timing,
)
from tgl_soar.sim.white_noise import drawn_as_needed, drawn_before
from tgl_soar.types import NO_FIX, NO_GROUND, NO_RANGE, Ground

_AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))
MODEL = aircraft_model(asdict(_AIRFRAME.airframe), _AIRFRAME.model)
GLIDE = glide_at(MODEL, 8.55)
WIND = (8.55, 0.0, 1.35)
STATE = gliding_state(GLIDE, WIND, 1.0, 2.0, 3.0)
FRAME = SoaringFrame(10.0, 20.0, -30.0, radians(120.0))
EXACT_POSITION = PositionParams(
    rate_hz=100.0, delay_s=0.0, noise_m=0.0, bias_m=0.0, velocity_noise_mps=0.0, gives_velocity=True
)
EXACT_ATTITUDE = AttitudeParams(
    rate_hz=200.0,
    delay_s=0.0,
    noise_rad=0.0,
    bias_rad=0.0,
    rate_noise_radps=0.0,
    rate_bias_radps=0.0,
)


def flown(sensors: Sensors, seed: int = 1, step_rate_hz: float = 200.0) -> FlownSensors:
    """Sensors in a plain flight."""
    return flown_sensors(sensors, step_rate_hz, drawn_as_needed(seed))


# --- when -----------------------------------------------------------------------------------


@pytest.mark.parametrize("delay_s", [0.0, 0.005, 0.015, 0.04, 0.06])
@pytest.mark.parametrize(
    ("rate_hz", "step_rate_hz"),
    [(200, 200), (100, 200), (50, 200), (40, 200), (100, 500), (30, 600), (1, 200), (240, 960)],
)
def test_a_sensor_fires_at_exactly_its_rate_and_arrives_after_its_delay(
    rate_hz: float, step_rate_hz: float, delay_s: float
) -> None:
    params = EXACT_POSITION._replace(rate_hz=rate_hz, delay_s=delay_s)
    attitude = EXACT_ATTITUDE._replace(rate_hz=step_rate_hz)
    sensor = flown(Sensors(position=params, attitude=attitude), 1, step_rate_hz).position
    seconds = 3
    arrivals: list[tuple[int, float]] = []  # (step of arrival, time stamp)
    last = 0
    for step in range(int(seconds * step_rate_hz)):
        fix = sense_position(sensor, FRAME, STATE, step)
        assert fix.sequence in (last, last + 1)  # none is lost, none overtakes
        if fix.sequence > last:
            arrivals.append((step, fix.time_s))
        last = fix.sequence
    # those that are still under way at the end have been taken
    under_way = samples_taken(sensor.timing, step) - samples_delivered(sensor.timing, step)
    assert len(arrivals) + under_way == seconds * rate_hz
    steps_late = round(delay_s * step_rate_hz + 0.4999)  # up to the next step
    for n, (step, time_s) in enumerate(arrivals):
        assert time_s == pytest.approx(n / rate_hz, abs=1e-12)
        assert step == n * step_rate_hz / rate_hz + steps_late


@pytest.mark.parametrize(
    ("rate_hz", "step_rate_hz"), [(30, 200), (60, 200), (150, 200), (99.9, 200), (120, 500)]
)
def test_a_rate_that_does_not_divide_the_step_rate_is_refused(
    rate_hz: float, step_rate_hz: float
) -> None:
    with pytest.raises(ValueError, match="does not divide"):
        sensor_timing("position", rate_hz, 0.0, step_rate_hz)


@pytest.mark.parametrize(
    ("rate_hz", "delay_s", "step_rate_hz", "named"),
    [
        (0.0, 0.0, 200.0, "position rate"),
        (nan, 0.0, 200.0, "position rate"),
        (400.0, 0.0, 200.0, "position rate"),
        (100.0, -0.01, 200.0, "position delay"),
        (100.0, nan, 200.0, "position delay"),
        (100.0, 0.0, nan, "step rate"),
        (100.0, 0.0, 0.0, "step rate"),
    ],
)
def test_bad_timing_is_named(
    rate_hz: float, delay_s: float, step_rate_hz: float, named: str
) -> None:
    with pytest.raises(ValueError, match=named):
        sensor_timing("position", rate_hz, delay_s, step_rate_hz)


def test_a_skipped_sample_is_refused() -> None:
    # a sensor that is asked at every other of its steps would silently run at half its rate
    sensor = flown(Sensors(position=MOTION_CAPTURE), 1).position
    sense_position(sensor, FRAME, STATE, 0)
    with pytest.raises(ValueError, match="misses steps"):
        sense_position(sensor, FRAME, STATE, 4)


def test_nothing_arrives_before_the_delay() -> None:
    timing = sensor_timing("position", 100.0, 0.04, 200.0)
    line = [NO_FIX] * line_length(timing)
    for step in range(8):
        if step % timing.period_steps == 0:
            line[step // 2 % len(line)] = NO_FIX._replace(sequence=step // 2 + 1)
        assert delivered(timing, line, step).sequence == 0
    line[4 % len(line)] = NO_FIX._replace(sequence=5)
    assert delivered(timing, line, 8).sequence == 1


def test_a_sample_shows_the_past() -> None:
    level = SoaringFrame(0.0, 0.0, 0.0, 0.0)
    sensor = flown(Sensors(position=EXACT_POSITION._replace(delay_s=0.03)), 1).position
    for step in range(100):
        fix = sense_position(sensor, level, STATE._replace(x_m=0.01 * step), step)
        if fix.sequence:
            assert fix.north_m == pytest.approx(-2.0 * fix.time_s)  # 0.01 m in 5 ms
            assert step / 200.0 - fix.time_s in (pytest.approx(0.03), pytest.approx(0.035))


# --- what -----------------------------------------------------------------------------------


def test_position_is_in_local_ned() -> None:
    fix = sense_position(flown(Sensors(position=EXACT_POSITION), 1).position, FRAME, STATE, 0)
    # wind from 120°: downstream is towards 300°, right of an upwind-facing aircraft is 210°
    c, s = cos(radians(300.0)), sin(radians(300.0))
    assert fix.north_m == pytest.approx(10.0 + 1.0 * c + 2.0 * cos(radians(210.0)))
    assert fix.east_m == pytest.approx(20.0 + 1.0 * s + 2.0 * sin(radians(210.0)))
    assert fix.down_m == pytest.approx(-30.0 - 3.0)
    moving = STATE._replace(velocity_x_mps=2.0, velocity_y_mps=0.0, velocity_z_mps=0.5)
    fix = sense_position(flown(Sensors(position=EXACT_POSITION), 1).position, FRAME, moving, 0)
    assert fix.velocity_north_mps == pytest.approx(2.0 * c)
    assert fix.velocity_east_mps == pytest.approx(2.0 * s)
    assert fix.velocity_down_mps == pytest.approx(-0.5)


def test_attitude_is_from_frd_to_local_ned() -> None:
    q = quaternion_from_euler(0.1, -0.2, 0.3)
    state = STATE._replace(qw=q[0], qx=q[1], qy=q[2], qz=q[3])
    sample = sense_attitude(flown(Sensors(attitude=EXACT_ATTITUDE), 1).attitude, FRAME, state, 0)
    roll, pitch, yaw = euler_from_quaternion(sample.qw, sample.qx, sample.qy, sample.qz)
    assert roll == pytest.approx(0.1)
    assert pitch == pytest.approx(-0.2)
    assert yaw == pytest.approx(radians(120.0) + 0.3)  # heading is counted from upwind


def test_a_source_without_velocity_says_so() -> None:
    fix = sense_position(flown(Sensors(position=MOTION_CAPTURE), 1).position, FRAME, STATE, 0)
    assert isnan(fix.velocity_north_mps)
    assert isnan(fix.velocity_down_mps)


def test_errors_add_to_the_truth_axis_by_axis() -> None:
    none, error, other = (0.0, 0.0, 0.0), (0.01, -0.02, 0.03), (0.1, 0.2, -0.3)
    exact = measure_position(FRAME, STATE, 1, 0.0, none, none)
    fix = measure_position(FRAME, STATE, 1, 0.0, error, other)
    added = [b - a for a, b in zip(exact[2:8], fix[2:8], strict=True)]
    assert added == pytest.approx([*error, *other])

    force = measure_imu(MODEL, STATE, WIND, False, 1, 0.0, none, none)
    imu = measure_imu(MODEL, STATE, WIND, False, 1, 0.0, error, other)
    added = [b - a for a, b in zip(force[2:], imu[2:], strict=True)]
    assert added == pytest.approx([*error, *other])

    # small turns about body axes: from level they are roll, pitch and heading
    level = STATE._replace(qw=1.0, qx=0.0, qy=0.0, qz=0.0)
    sample = measure_attitude(SoaringFrame(0.0, 0.0, 0.0, 0.0), level, 1, 0.0, error, other)
    angles = euler_from_quaternion(sample.qw, sample.qx, sample.qy, sample.qz)
    assert angles == pytest.approx(error, abs=1e-3)
    assert sample[6:9] == pytest.approx(other)


DRIFTS = DRIFTING_POSITION._replace(rate_hz=50.0, delay_s=0.0, noise_m=1e-6, drift_s=4.0)


def drift(sensors: FlownSensors, steps: int) -> list[tuple[float, float, float]]:
    """How far the fixes of a still aircraft are from it [m], NED, four steps apart."""
    here = ned_from_soaring(FRAME, STATE.x_m, STATE.y_m, STATE.z_m)
    fixes = [sense_position(sensors.position, FRAME, STATE, k) for k in range(0, steps, 4)]
    return [(f.north_m - here[0], f.east_m - here[1], f.down_m - here[2]) for f in fixes]


def test_a_receiver_s_slow_error_is_a_gauss_markov_process() -> None:
    """50 flights of 20 time constants: the deviation is known to some 3 %, 20 ms apart 0.995 are
    left of it, a time constant apart 1 / e."""
    flights = [drift(flown(Sensors(position=DRIFTS), seed), 16_000) for seed in range(1, 51)]
    for axis, size in ((0, 1.0), (1, 1.0), (2, 2.0)):
        values = [[place[axis] for place in places] for places in flights]
        square = fmean(v * v for each in values for v in each)
        assert square == pytest.approx(size * size, rel=0.15)
        for apart, left in ((1, exp(-0.02 / 4.0)), (200, exp(-1.0))):
            products = [a * b for each in values for a, b in zip(each, each[apart:], strict=False)]
            assert fmean(products) / square == pytest.approx(left, abs=0.1 if apart > 1 else 1e-3)
    starts = [places[0] for places in flights]
    assert stdev(s[2] for s in starts) == pytest.approx(2.0, rel=0.3)  # from the first fix on


def test_compiled_flights_drift_as_plain_ones() -> None:
    plain = flown(Sensors(position=DRIFTS), 7)
    before = flown_sensors(Sensors(position=DRIFTS), 200.0, drawn_before(7, 400))
    assert drift(plain, 400) == drift(before, 400)


def test_a_drift_leaves_noise_and_other_sensors_as_they_were() -> None:
    still = flown(Sensors(position=DRIFTS._replace(drift_m=0.0, drift_up_m=0.0)), 3)
    moves = flown(Sensors(position=DRIFTS), 3)
    a, b = (sense_position(s.position, FRAME, STATE, 0) for s in (still, moves))
    assert a.velocity_north_mps == b.velocity_north_mps
    assert abs(a.down_m - b.down_m) > 1e-3
    assert sense_attitude(still.attitude, FRAME, STATE, 0) == sense_attitude(
        moves.attitude, FRAME, STATE, 0
    )


def test_a_drift_without_noise_is_refused() -> None:
    with pytest.raises(ValueError, match="noise_m"):
        flown(Sensors(position=DRIFTS._replace(noise_m=0.0)), 1)


def test_noise_has_the_size_that_it_claims() -> None:
    # 4,000 numbers: their standard deviation is known to 1.1 %; four times that is allowed
    params = PositionParams(
        rate_hz=200.0,
        delay_s=0.0,
        noise_m=0.002,
        bias_m=0.0,
        velocity_noise_mps=0.03,
        gives_velocity=True,
    )
    sensor = flown(Sensors(position=params), 5).position
    fixes = [sense_position(sensor, FRAME, STATE, k) for k in range(4000)]
    for axis, deviation in (("north_m", 0.002), ("down_m", 0.002), ("velocity_east_mps", 0.03)):
        values = [getattr(f, axis) for f in fixes]
        assert stdev(values) == pytest.approx(deviation, rel=0.045)

    turns = flown(
        Sensors(attitude=AUTOPILOT_ATTITUDE._replace(bias_rad=0.0, delay_s=0.0)), 5
    ).attitude
    samples = [sense_attitude(turns, FRAME, STATE, k) for k in range(4000)]
    angles = [euler_from_quaternion(s.qw, s.qx, s.qy, s.qz) for s in samples]
    for axis_number in (0, 1, 2):
        assert stdev(a[axis_number] for a in angles) == pytest.approx(
            AUTOPILOT_ATTITUDE.noise_rad, rel=0.045
        )
    for s in samples[:50]:
        assert sqrt(s.qw**2 + s.qx**2 + s.qy**2 + s.qz**2) == pytest.approx(1.0, abs=1e-14)


def test_bias_stays_for_a_flight_and_differs_between_flights() -> None:
    params = EXACT_POSITION._replace(bias_m=0.5, rate_hz=200.0)
    exact = sense_position(
        flown(Sensors(position=EXACT_POSITION), 1).position, FRAME, STATE, 0
    ).north_m
    offsets = []
    for seed in range(200):
        sensor = flown(Sensors(position=params), seed).position
        values = {sense_position(sensor, FRAME, STATE, k).north_m for k in range(3)}
        assert len(values) == 1
        offsets.append(values.pop() - exact)
    # 200 flights: the standard deviation is known to 5 %
    assert stdev(offsets) == pytest.approx(0.5, rel=0.2)
    assert abs(fmean(offsets)) < 0.5 * 4.0 / sqrt(200.0)


def test_a_mems_imu_is_as_wrong_as_such_sensors_stay_after_calibration() -> None:
    """5 to 20 mg of each axis, by temperature and the board's stress, and 0.05 to 0.5 deg/s."""
    exact = MEMS_IMU._replace(force_noise_mps2=0.0, rate_noise_radps=0.0)
    truth = specific_force_frd(MODEL, STATE, WIND)
    forces, rates = [], []
    for seed in range(200):
        imu = flown(Sensors(imu=exact), seed).imu
        first, later = (sense_imu(imu, MODEL, STATE, WIND, False, k) for k in (0, 1))
        assert first[2:8] == later[2:8]
        forces += [a - b for a, b in zip(first[2:5], truth, strict=True)]
        rates += list(first[5:8])
    assert 0.005 * 9.81 < stdev(forces) < 0.02 * 9.81
    assert radians(0.05) < stdev(rates) < radians(0.5)


def test_the_same_seed_is_the_same_flight_and_sensors_do_not_share_noise() -> None:
    def flight(seed: int) -> list[object]:
        a = flown(Sensors(position=AUTOPILOT_POSITION), seed).position
        b = flown(Sensors(attitude=AUTOPILOT_ATTITUDE), seed).attitude
        return [
            (sense_position(a, FRAME, STATE, k), sense_attitude(b, FRAME, STATE, k))
            for k in range(40)
        ]

    assert repr(flight(3)) == repr(flight(3))
    assert repr(flight(3)) != repr(flight(4))

    alone = flown(Sensors(position=AUTOPILOT_POSITION), 3).position
    together = flown(Sensors(position=AUTOPILOT_POSITION), 3).position
    imu = flown(Sensors(imu=MEMS_IMU), 3).imu
    for k in range(40):
        sense_imu(imu, MODEL, STATE, WIND, False, k)
        assert repr(sense_position(alone, FRAME, STATE, k)) == repr(
            sense_position(together, FRAME, STATE, k)
        )


def test_the_imu_feels_what_the_air_does() -> None:
    exact = MEMS_IMU._replace(
        force_noise_mps2=0.0, force_bias_mps2=0.0, rate_noise_radps=0.0, rate_bias_radps=0.0
    )
    turning = STATE._replace(roll_rate_frd_radps=0.1, yaw_rate_frd_radps=-0.2)
    sample = sense_imu(flown(Sensors(imu=exact), 1).imu, MODEL, turning, WIND, False, 0)
    assert sample[2:5] == specific_force_frd(MODEL, turning, WIND)
    assert sample[5:8] == (0.1, 0.0, -0.2)


def test_the_pitot_reads_the_air_along_the_nose() -> None:
    exact = PITOT._replace(pressure_noise_pa=0.0, pressure_bias_pa=0.0, delay_s=0.0)
    sample = sense_airspeed(flown(Sensors(airspeed=exact), 1).airspeed, MODEL, STATE, WIND, 0)
    assert sample.airspeed_mps == pytest.approx(GLIDE.airspeed_mps * cos(GLIDE.alpha_rad))
    backwards = (-20.0, 0.0, 0.0)
    assert (
        sense_airspeed(
            flown(Sensors(airspeed=exact), 1).airspeed, MODEL, STATE, backwards, 0
        ).airspeed_mps
        == 0.0
    )
    # 5 Pa too much is 5 / (rho V) = 0.48 m/s too much, to first order
    read = measure_airspeed(MODEL, STATE, WIND, 1, 0.0, 5.0).airspeed_mps
    assert read - sample.airspeed_mps == pytest.approx(
        5.0 / (1.225 * sample.airspeed_mps), rel=0.04
    )
    # noise of 1.4 Pa is 1.4 / (rho V) = 0.13 m/s there; 2,000 samples know it to 1.6 %
    noisy = flown(
        Sensors(airspeed=exact._replace(pressure_noise_pa=1.4, rate_hz=200.0)), 1
    ).airspeed
    values = [sense_airspeed(noisy, MODEL, STATE, WIND, k).airspeed_mps for k in range(2000)]
    assert stdev(values) == pytest.approx(1.4 / (1.225 * sample.airspeed_mps), rel=0.07)


def test_the_default_sensors_run_at_200_steps_a_second() -> None:
    assert flown(Sensors(position=MOTION_CAPTURE), 1).position.timing.period_steps == 2
    assert flown(Sensors(position=AUTOPILOT_POSITION), 1).position.timing.delay_steps == 8
    assert flown(Sensors(attitude=AUTOPILOT_ATTITUDE), 1).attitude.timing.period_steps == 1
    assert flown(Sensors(imu=MEMS_IMU), 1).imu.timing.period_steps == 1
    assert flown(Sensors(airspeed=PITOT), 1).airspeed.timing.period_steps == 4


def test_samples_are_plain() -> None:
    fix = sense_position(flown(Sensors(position=AUTOPILOT_POSITION), 1).position, FRAME, STATE, 0)
    assert all(type(v) is float for v in fix[1:8])
    assert isinstance(STATE, AircraftState)


# --- a rangefinder ----------------------------------------------------------------------------

EXACT_RANGE = LASER_RANGE._replace(noise_m=0.0, delay_s=0.0, lost=0.0)
PLAIN = Ground(2, (-100.0, 100.0, *(100.0,) * 6), (-3.0, -3.0, *(-3.0,) * 6))
RISING = Ground(2, (-100.0, 100.0, *(100.0,) * 6), (-103.0, 97.0, *(97.0,) * 6))


def looking(ground: Ground, params: RangeParams = EXACT_RANGE, seed: int = 1) -> FlownSensors:
    sensors = Sensors(rangefinder=params)
    return flown_sensors(sensors, 200.0, drawn_as_needed(seed), ground=ground)


@pytest.mark.parametrize("ground", [PLAIN, RISING])
@pytest.mark.parametrize("pitch_deg", [-20.0, 0.0, 15.0])
@pytest.mark.parametrize("roll_deg", [-15.0, 0.0, 20.0])
def test_the_beam_ends_on_the_ground(ground: Ground, pitch_deg: float, roll_deg: float) -> None:
    """Against the quaternion's own axis: the end of the beam lies on the profile."""
    roll, pitch, heading = radians(roll_deg), radians(pitch_deg), radians(30.0)
    qw, qx, qy, qz = quaternion_from_euler(roll, pitch, heading)
    state = STATE._replace(qw=qw, qx=qx, qy=qy, qz=qz, x_m=1.0, z_m=9.0)
    sample = sense_range(looking(ground).rangefinder, state, 0)
    upwind, down = 2.0 * (qx * qz + qw * qy), 1.0 - 2.0 * (qx * qx + qy * qy)
    x, z = 1.0 - sample.range_m * upwind, 9.0 - sample.range_m * down
    assert z == pytest.approx(-3.0 if ground is PLAIN else x - 3.0, abs=0.02 * sample.range_m)
    if ground is PLAIN:
        assert sample.range_m == pytest.approx(12.0 / down)


def test_what_is_out_of_reach_is_no_number() -> None:
    for away_m in (0.1, 41.0):
        state = STATE._replace(z_m=away_m - 3.0)
        assert isnan(sense_range(looking(PLAIN).rangefinder, state, 0).range_m)
    upside_down = STATE._replace(qw=0.0, qx=1.0, qy=0.0, qz=0.0)
    assert isnan(sense_range(looking(PLAIN).rangefinder, upside_down, 0).range_m)


def test_so_many_distances_are_lost_and_the_others_have_so_much_noise() -> None:
    noisy = looking(PLAIN, LASER_RANGE._replace(lost=0.1, noise_m=0.05, delay_s=0.0)).rangefinder
    state = STATE._replace(qw=1.0, qx=0.0, qy=0.0, qz=0.0, z_m=9.0)
    every = [sense_range(noisy, state, 10 * k).range_m for k in range(4000)]
    numbers = [value for value in every if not isnan(value)]
    assert len(numbers) == pytest.approx(3600, abs=4 * sqrt(360))
    assert fmean(numbers) == pytest.approx(12.0, abs=0.004)
    assert stdev(numbers) == pytest.approx(0.05, rel=0.05)


def test_where_the_ground_is_not_known_there_is_nothing_to_look_at() -> None:
    assert sense_range(looking(NO_GROUND).rangefinder, STATE, 0) == NO_RANGE
    assert sense_range(flown(Sensors(), 1).rangefinder, STATE, 0) == NO_RANGE
