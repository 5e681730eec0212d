"""The figures of the simulated sensors, one by one with where they come from, and their messages'
limits and bits."""

from __future__ import annotations

from math import inf, isnan, nan

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import load_site, shipped
from tgl_soar.config.site import HomePosition
from tgl_soar.sim import sensor_messages as messages
from tgl_soar.sim import sensor_sampling as sampling
from tgl_soar.sim.aircraft import AircraftState
from tgl_soar.sim.sensor_sampling import (
    biased,
    delivered,
    flown_sensors,
    keep_sample,
    line_length,
    scaled,
    sense_range,
    sense_surfaces,
)
from tgl_soar.sim.sensors import (
    AUTOPILOT_ATTITUDE,
    AUTOPILOT_POSITION,
    BEAM_DROP_MIN,
    DRIFTING_POSITION,
    LASER_RANGE,
    MEMS_IMU,
    MOTION_CAPTURE,
    PITOT,
    READ_BACK,
    RECEIVERS,
    RTK_POSITION,
    USUAL_SENSORS,
    AirspeedParams,
    AttitudeParams,
    ImuParams,
    PositionParams,
    RangeParams,
    Sensors,
    SurfacesParams,
    samples_delivered,
    samples_taken,
    sensor_timing,
)
from tgl_soar.sim.white_noise import drawn_as_needed
from tgl_soar.types import (
    NO_FIX,
    AirspeedSample,
    Ground,
    ImuSample,
    PositionFix,
    RangeSample,
    SurfaceCommand,
)


def test_motion_capture_is_exact_to_half_a_millimetre_and_early() -> None:
    assert (
        PositionParams(
            rate_hz=100.0,
            delay_s=0.015,
            noise_m=0.0005,
            bias_m=0.0,
            velocity_noise_mps=0.0,
            gives_velocity=False,
            drift_m=0.0,
            drift_up_m=0.0,
            drift_s=300.0,
        )
        == MOTION_CAPTURE
    )


def test_an_autopilots_position_is_smoother_slower_and_later() -> None:
    assert (
        PositionParams(
            rate_hz=50.0,
            delay_s=0.040,
            noise_m=0.002,
            bias_m=0.0,
            velocity_noise_mps=0.03,
            gives_velocity=True,
        )
        == AUTOPILOT_POSITION
    )


def test_satellites_drift_by_a_metre_and_by_two_in_height_unless_corrected() -> None:
    assert (
        PositionParams(
            rate_hz=50.0,
            delay_s=0.100,
            noise_m=0.02,
            bias_m=0.0,
            velocity_noise_mps=0.05,
            gives_velocity=True,
            drift_m=1.0,
            drift_up_m=2.0,
            drift_s=300.0,
        )
        == DRIFTING_POSITION
    )
    corrected = DRIFTING_POSITION._replace(noise_m=0.01, drift_m=0.01, drift_up_m=0.02)
    assert corrected == RTK_POSITION
    assert RECEIVERS == {
        "local": AUTOPILOT_POSITION,
        "satellites": DRIFTING_POSITION,
        "rtk": RTK_POSITION,
    }


def test_an_autopilots_attitude_jitters_by_a_tenth_of_a_degree() -> None:
    assert (
        AttitudeParams(
            rate_hz=200.0,
            delay_s=0.005,
            noise_rad=0.0017,
            bias_rad=0.005,
            rate_noise_radps=0.01,
            rate_bias_radps=0.002,
        )
        == AUTOPILOT_ATTITUDE
    )


def test_other_sensors_have_the_figures_of_their_data_sheets() -> None:
    assert (
        ImuParams(
            rate_hz=200.0,
            delay_s=0.0,
            force_noise_mps2=0.10,
            force_bias_mps2=0.10,
            rate_noise_radps=0.01,
            rate_bias_radps=0.002,
        )
        == MEMS_IMU
    )
    assert AirspeedParams(50.0, 0.010, 1.4, 1.0) == PITOT
    assert (
        RangeParams(rate_hz=20.0, delay_s=0.030, noise_m=0.03, min_m=0.2, max_m=40.0, lost=0.02)
        == LASER_RANGE
    )
    assert SurfacesParams(50.0, 0.010) == READ_BACK
    assert BEAM_DROP_MIN == 0.2


def test_usually_there_is_the_autopilots_position_and_attitude_and_nothing_else() -> None:
    assert (
        Sensors(
            position=AUTOPILOT_POSITION,
            attitude=AUTOPILOT_ATTITUDE,
            imu=None,
            airspeed=None,
            surfaces=None,
            rangefinder=None,
        )
        == USUAL_SENSORS
    )


# --- when -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rate_hz", "delay_s", "period", "delay"),
    [
        (200.0, 0.0, 1, 0),
        (50.0, 0.010, 4, 2),
        (50.0, 0.0101, 4, 3),  # the first step that is not earlier
        (1.0, 59.9999, 200, 12000),
        (200.0, 1e-12, 1, 0),  # rounding is no step
    ],
)
def test_rate_and_delay_are_counted_in_steps(
    rate_hz: float, delay_s: float, period: int, delay: int
) -> None:
    assert sensor_timing("x", rate_hz, delay_s, 200.0)[1:] == (period, delay)


@pytest.mark.parametrize("rate_hz", [0.0, -1.0, 200.5, nan])
def test_a_rate_is_above_0_and_not_above_the_steps(rate_hz: float) -> None:
    with pytest.raises(ValueError, match=r"x rate .* Hz: must be above 0, up to 200 Hz"):
        sensor_timing("x", rate_hz, 0.0, 200.0)


@pytest.mark.parametrize("delay_s", [-0.001, 60.0, nan, inf])
def test_a_delay_is_from_0_to_a_minute(delay_s: float) -> None:
    with pytest.raises(ValueError, match=r"x delay .* s: must be from 0 to 60 s"):
        sensor_timing("x", 50.0, delay_s, 200.0)


@pytest.mark.parametrize("step_hz", [0.0, -200.0, inf, nan])
def test_steps_have_a_rate(step_hz: float) -> None:
    with pytest.raises(ValueError, match=r"simulation step rate .* Hz: must be positive"):
        sensor_timing("x", 50.0, 0.0, step_hz)


def test_a_rate_that_does_not_divide_is_refused_with_those_near_it() -> None:
    with pytest.raises(ValueError, match=r"x rate 60 Hz does not divide the simulation's 200 Hz: "):
        sensor_timing("x", 60.0, 0.0, 200.0)
    with pytest.raises(ValueError, match=r"near it are 50, 66\.6667 and 100 Hz, or change"):
        sensor_timing("x", 60.0, 0.0, 200.0)
    with pytest.raises(ValueError, match="near it are 100, 200 and 200 Hz"):
        sensor_timing("x", 180.0, 0.0, 200.0)


def test_samples_are_taken_every_period_and_delivered_a_delay_later() -> None:
    """Every fourth step, six steps late."""
    timing = sensor_timing("x", 50.0, 0.03, 200.0)
    assert [samples_taken(timing, step) for step in (0, 3, 4, 7, 8)] == [1, 1, 2, 2, 3]
    assert [samples_delivered(timing, step) for step in (0, 5, 6, 9, 10)] == [0, 0, 1, 1, 2]


@pytest.mark.parametrize(
    ("delay_s", "length"), [(0.0, 1), (0.005, 2), (0.02, 2), (0.021, 3), (0.04, 3), (0.041, 4)]
)
def test_a_line_holds_what_is_under_way_and_one_more(delay_s: float, length: int) -> None:
    timing = sensor_timing("x", 50.0, delay_s, 200.0)
    assert line_length(timing) == length
    line = [NO_FIX] * length
    for step in range(60):
        if step % 4 == 0:
            keep_sample(line, step // 4, NO_FIX._replace(sequence=step // 4 + 1))
        due = samples_delivered(timing, step)
        assert delivered(timing, line, step).sequence == due


def test_white_numbers_are_scaled_three_at_a_time() -> None:
    row = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    assert scaled(row, 0, 0.5) == (0.5, 1.0, 1.5)
    assert scaled(row, 3, 2.0) == (8.0, 10.0, 12.0)
    assert biased((1.0, 2.0, 3.0), (10.0, 20.0, 30.0)) == (11.0, 22.0, 33.0)


# --- what is not there, and what looks down -------------------------------------------------------

STATE = AircraftState(
    x_m=0.0, y_m=0.0, z_m=10.0, velocity_x_mps=0.0, velocity_y_mps=0.0, velocity_z_mps=0.0,
    qw=1.0, qx=0.0, qy=0.0, qz=0.0, roll_rate_frd_radps=0.0, pitch_rate_frd_radps=0.0,
    yaw_rate_frd_radps=0.0, elevator=0.0, aileron=0.0, rudder=0.0,
)  # fmt: skip


def flat_ground() -> Ground:
    return load_site(shipped("sites/tunnel.toml")).known_ground()


def test_sensors_that_are_not_fitted_take_nothing() -> None:
    flown = flown_sensors(USUAL_SENSORS, 200.0, drawn_as_needed(1))
    fitted = [each.fitted for each in (flown.imu, flown.airspeed, flown.surfaces)]
    assert fitted == [False, False, False]
    assert not flown.rangefinder.fitted
    for sensor in (flown.imu, flown.airspeed, flown.surfaces, flown.rangefinder):
        assert sensor.timing.period_steps == 1_000_000_000
        assert sensor.timing.delay_steps == 0
    assert sense_surfaces(flown.surfaces, SurfaceCommand(1.0, 0.0, 0.0), 0).sequence == 0
    assert sense_range(flown.rangefinder, STATE, 0).sequence == 0


def test_a_rangefinder_needs_a_ground_that_is_known() -> None:
    sensors = Sensors(rangefinder=LASER_RANGE)
    assert not flown_sensors(sensors, 200.0, drawn_as_needed(1)).rangefinder.fitted
    ground = flat_ground()
    assert flown_sensors(sensors, 200.0, drawn_as_needed(1), ground=ground).rangefinder.fitted


@pytest.mark.parametrize(
    ("height_m", "reads"), [(0.19, nan), (0.21, 0.21), (9.99, 9.99), (10.01, nan)]
)
def test_what_is_nearer_or_farther_than_it_measures_is_no_number(
    height_m: float, reads: float
) -> None:
    params = RangeParams(rate_hz=200.0, delay_s=0.0, noise_m=0.0, min_m=0.2, max_m=10.0, lost=0.0)
    flown = flown_sensors(
        Sensors(rangefinder=params), 200.0, drawn_as_needed(1), ground=flat_ground()
    )
    found = sense_range(flown.rangefinder, STATE._replace(x_m=-1.0, z_m=height_m), 0)
    assert found.sequence == 1
    assert isnan(found.range_m) if isnan(reads) else found.range_m == pytest.approx(reads)


def test_surfaces_are_read_back_with_their_time() -> None:
    flown = flown_sensors(Sensors(surfaces=SurfacesParams(100.0, 0.0)), 200.0, drawn_as_needed(1))
    command = SurfaceCommand(0.1, 0.2, 0.3, 0.4)
    for step, sequence, time_s in ((0, 1, 0.0), (1, 1, 0.0), (2, 2, 0.01)):
        found = sense_surfaces(flown.surfaces, command, step)
        assert found == (sequence, time_s, 0.1, 0.2, 0.3, 0.4)


def test_what_samples_are_before_anything_has_come() -> None:
    assert [sample.sequence for sample in sampling.NO_SAMPLES] == [0] * 6


def test_a_drift_is_in_height_alone_too_and_needs_noise() -> None:
    silent = AUTOPILOT_POSITION._replace(noise_m=0.0)
    for position in (silent._replace(drift_m=1.0), silent._replace(drift_up_m=1.0)):
        with pytest.raises(ValueError, match="drift_m, drift_up_m: a drift needs noise_m"):
            flown_sensors(Sensors(position=position), 200.0, drawn_as_needed(1))
    flown_sensors(Sensors(position=silent), 200.0, drawn_as_needed(1))


# --- messages -------------------------------------------------------------------------------------

IMU = ImuSample(
    sequence=1,
    time_s=0.0,
    force_x_frd_mps2=9.80665,
    force_y_frd_mps2=-4.903325,
    force_z_frd_mps2=400.0,
    roll_rate_frd_radps=0.5,
    pitch_rate_frd_radps=-0.25,
    yaw_rate_frd_radps=40.0,
)


def test_inertial_messages_are_whole_thousandths_of_g_and_radians() -> None:
    for sent in (messages.raw_imu(IMU, 7), messages.scaled_imu(IMU, 7)):
        assert (sent.xacc, sent.yacc, sent.zacc) == (1000, -500, 32767)
        assert (sent.xgyro, sent.ygyro, sent.zgyro) == (500, -250, 32767)
        assert (sent.xmag, sent.ymag, sent.zmag) == (0, 0, 0)
        assert sent.temperature == 2500  # hundredths of a degree
    assert messages.raw_imu(IMU, 7).id == 0
    assert messages.raw_imu(IMU, 7).time_usec == 7
    assert messages.scaled_imu(IMU, 7).time_boot_ms == 7


def test_thousandths_end_at_sixteen_bits_on_both_sides() -> None:
    assert messages.thousandths((-40.0, 40.0, nan, 0.0019, -0.0019)) == [-32767, 32767, 0, 1, -1]


@pytest.mark.parametrize("px4", [False, True])
@pytest.mark.parametrize("new", [False, True])
def test_the_bits_of_what_is_new_are_those_of_the_message(px4: bool, new: bool) -> None:
    sent = messages.highres_imu(IMU, 7, 100.0, AirspeedSample(3, 0.0, 10.0), px4=px4, new=new)
    inertial = {0, 1, 2, 3, 4, 5}
    barometer = {9, 11, 12}
    differential = {10} if new or not px4 else set()
    bits = {i for i in range(16) if sent.fields_updated >> i & 1}
    assert bits == inertial | barometer | differential
    assert (sent.xmag, sent.ymag, sent.zmag) == (0.0, 0.0, 0.0)
    assert (sent.temperature, sent.pressure_alt, sent.time_usec) == (15.0, 100.0, 7)
    assert sent.abs_pressure == pytest.approx(1001.29, abs=0.1)  # of the standard, at 100 m
    if px4:  # half of ρ V², in hPa: ρ of the pressure and 15 °C
        density = 100129.0 / (287.05 * 288.15)
        assert sent.diff_pressure == pytest.approx(0.5 * density * 100.0 / 100.0, rel=1e-3)
    else:
        assert sent.diff_pressure == pytest.approx(1001.29 - 1013.25, abs=0.1)


def test_without_a_pitot_px4_reports_no_difference() -> None:
    sent = messages.highres_imu(IMU, 7, 0.0, AirspeedSample(0, 0.0, 10.0), px4=True, new=True)
    assert sent.diff_pressure == 0.0


@pytest.mark.parametrize(
    ("range_m", "shown_cm", "quality"),
    [(0.304, 30, 100), (39.996, 4000, 100), (700.0, 65500, 100), (nan, 4100, 1), (inf, 4100, 1)],
)
def test_a_distance_that_does_not_come_back_is_shown_beyond_the_largest(
    range_m: float, shown_cm: int, quality: int
) -> None:
    sent = messages.distance_sensor(RangeSample(1, 0.0, range_m), LASER_RANGE, 9)
    assert (sent.current_distance, sent.signal_quality) == (shown_cm, quality)
    assert (sent.min_distance, sent.max_distance, sent.time_boot_ms) == (20, 4000, 9)
    assert (sent.type, sent.id, sent.orientation, sent.covariance) == (0, 0, 25, 255)


HOME = HomePosition(latitude_deg=-33.0, longitude_deg=151.0, altitude_m=420.0)
FIX = PositionFix(
    sequence=1,
    time_s=0.0,
    north_m=100.0,
    east_m=200.0,
    down_m=-5.0,
    velocity_north_mps=1.5,
    velocity_east_mps=-400.0,
    velocity_down_mps=nan,
)


def test_a_receiver_reports_its_place_accuracy_and_satellites() -> None:
    sent = messages.gps_raw_int(FIX, HOME, 9, (0.8, 1.2))
    assert (sent.time_usec, sent.fix_type, sent.satellites_visible) == (9, 3, 14)
    assert (sent.h_acc, sent.v_acc, sent.alt) == (800, 1200, 425_000)
    assert sent.lat == pytest.approx(-33.0e7 + 100.0e7 / 110_909.0, abs=20)
    assert sent.lon == pytest.approx(151.0e7 + 200.0e7 / 93_453.0, abs=40)
    assert (sent.eph, sent.epv, sent.vel, sent.cog) == (65535, 65535, 65535, 65535)


@pytest.mark.parametrize("lacks", ["home", "height"])
def test_without_a_home_or_a_height_there_is_no_fix(lacks: str) -> None:
    home = None if lacks == "home" else HOME
    fix = FIX._replace(down_m=nan) if lacks == "height" else FIX
    sent = messages.gps_raw_int(fix, home, 9, (0.8, 1.2))
    assert (sent.time_usec, sent.fix_type, sent.satellites_visible) == (9, 1, 255)
    assert (sent.lat, sent.lon, sent.alt) == (0, 0, 0)
    assert (sent.eph, sent.epv, sent.vel, sent.cog) == (65535, 65535, 65535, 65535)


@pytest.mark.parametrize("home", [HOME, None])
def test_a_global_position_has_its_velocity_within_the_field_and_its_height(
    home: HomePosition | None,
) -> None:
    sent = messages.global_position(FIX, home, 9, -np.pi / 2)
    assert (sent.time_boot_ms, sent.vx, sent.vy, sent.vz) == (9, 150, -32700, 0)
    assert (sent.relative_alt, sent.hdg) == (5000, 27000)
    if home is None:
        assert (sent.lat, sent.lon, sent.alt) == (0, 0, 0)
    else:
        assert sent.alt == 425_000
        assert sent.lat == messages.gps_raw_int(FIX, HOME, 9, (1.0, 1.0)).lat


@pytest.mark.parametrize(("yaw", "shown"), [(0.0, 0), (-1e-9, 0), (np.pi, 18000)])
def test_a_heading_is_from_0_to_below_36000(yaw: float, shown: int) -> None:
    assert messages.global_position(FIX, HOME, 9, yaw).hdg == shown


def test_the_shown_airspeed_is_read_every_tenth_of_a_second() -> None:
    """And is the equivalent one: at 1000 m 0.952 of the true one."""
    shown = messages.ShownAirspeed()
    assert shown.equivalent_mps == 0.0
    shown.step(0.0, AirspeedSample(0, 0.0, 10.0), 0.0)  # no sample yet
    assert shown.equivalent_mps == 0.0
    shown.step(0.05, AirspeedSample(1, 0.0, 10.0), 1000.0)
    assert shown.equivalent_mps == pytest.approx(9.53, abs=0.01)
    shown.step(0.149, AirspeedSample(2, 0.0, 20.0), 0.0)
    assert shown.equivalent_mps == pytest.approx(9.53, abs=0.01)
    shown.step(0.15, AirspeedSample(2, 0.0, 20.0), 0.0)
    assert shown.equivalent_mps == 20.0


def test_the_updated_bits_are_of_the_dialect() -> None:
    assert messages.INERTIAL == 0b111111
    assert messages.BAROMETER == mavlink.HIGHRES_IMU_UPDATED_ABS_PRESSURE | 1 << 11 | 1 << 12
