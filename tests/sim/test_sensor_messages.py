"""What the simulated firmware's sensor messages hold: units, limits, the standard atmosphere."""

from __future__ import annotations

from math import cos, inf, isnan, nan, pi, radians, sin, sqrt

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from samples import imu_sample, position_fix

from tgl_soar.air.field import FloatArray
from tgl_soar.config.site import HomePosition
from tgl_soar.sim.sensor_messages import (
    ShownAirspeed,
    density_ratio,
    distance_sensor,
    geodetic,
    global_position,
    gps_raw_int,
    highres_imu,
    raw_imu,
    scaled_imu,
    thousandths,
)
from tgl_soar.sim.sensors import RangeParams
from tgl_soar.types import AirspeedSample, RangeSample

G = 9.80665
HOME = HomePosition(latitude_deg=51.99, longitude_deg=4.375, altitude_m=20.0)
SAMPLE = imu_sample(3, 1.5, (0.5 * G, -2.0 * G, 0.25 * G), (0.1239, -0.0567, 2.0))
PITOT = AirspeedSample(7, 1.5, 10.0)
# Heights [m] with the pressure [hPa] and the density ratio of the tables of the standard atmosphere
# (ISO 2533).
STANDARD = [(0.0, 1013.25, 1.0), (1000.0, 898.75, 0.9075), (2000.0, 794.95, 0.8217)]


@pytest.mark.parametrize(
    ("value", "shown"),
    [(0.0129, 12), (-0.0129, -12), (40.0, 32767), (-40.0, -32767), (nan, 0), (inf, 32767)],
)
def test_thousandths_are_cut_off_toward_zero_and_end_at_sixteen_bits(
    value: float, shown: int
) -> None:
    assert thousandths((value, 1.0)) == [shown, 1000]
    assert thousandths((2.0 * value,), 2.0) == [shown]


def test_inertial_messages_are_in_milli_g_and_milliradians() -> None:
    raw, scaled = raw_imu(SAMPLE, 1_500_001), scaled_imu(SAMPLE, 1500)
    assert (raw.time_usec, scaled.time_boot_ms) == (1_500_001, 1500)
    for message in (raw, scaled):
        force = message.xacc, message.yacc, message.zacc
        assert force == pytest.approx((500, -2000, 250), abs=1)  # the last bit may be cut off
        assert (message.xgyro, message.ygyro, message.zgyro) == (123, -56, 2000)
        assert (message.xmag, message.ymag, message.zmag) == (0, 0, 0)
        assert message.temperature == 2500  # hundredths of a degree: a warm board's
    assert raw.id == 0


@pytest.mark.parametrize(("height_m", "pressure_hpa", "density"), STANDARD)
def test_pressure_and_density_are_those_of_the_standard_atmosphere(
    height_m: float, pressure_hpa: float, density: float
) -> None:
    message = highres_imu(SAMPLE, 5, height_m, PITOT, px4=False, new=False)
    assert message.abs_pressure == pytest.approx(pressure_hpa, rel=2e-4)
    assert message.pressure_alt == height_m
    assert message.temperature == 15.0
    assert density_ratio(height_m) == pytest.approx(density, rel=2e-4)
    # ArduPlane's is the barometer's, less that at the ground.
    assert message.diff_pressure == pytest.approx(message.abs_pressure - 1013.25)


def test_the_high_resolution_message_has_the_sample_as_it_is() -> None:
    message = highres_imu(SAMPLE, 1_500_000, 25.0, PITOT, px4=True, new=True)
    assert message.time_usec == 1_500_000
    assert (message.xacc, message.yacc, message.zacc) == SAMPLE[2:5]
    assert (message.xgyro, message.ygyro, message.zgyro) == SAMPLE[5:8]
    assert (message.xmag, message.ymag, message.zmag) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("px4", "new", "marked"), [(True, True, True), (True, False, False), (False, False, True)]
)
def test_fields_that_are_new_are_marked(px4: bool, new: bool, marked: bool) -> None:
    message = highres_imu(SAMPLE, 5, 25.0, PITOT, px4=px4, new=new)
    names = ["ABS_PRESSURE", "PRESSURE_ALT", "TEMPERATURE", *["DIFF_PRESSURE"] * marked]
    names += [f"{axis}{sensor}" for axis in "XYZ" for sensor in ("ACC", "GYRO")]
    bits = [getattr(mavlink, f"HIGHRES_IMU_UPDATED_{name}") for name in names]
    assert message.fields_updated == sum(bits)


def test_px4_reports_the_pressure_of_the_pitot_tube() -> None:
    """½ ρ V² with the density of dry air at 15 °C: 0.5 · 1.225 · 100 Pa at sea level."""
    message = highres_imu(SAMPLE, 5, 0.0, PITOT, px4=True, new=True)
    assert message.diff_pressure == pytest.approx(0.6125, rel=1e-3)
    twice = highres_imu(SAMPLE, 5, 0.0, PITOT._replace(airspeed_mps=20.0), px4=True, new=True)
    assert twice.diff_pressure == pytest.approx(4.0 * message.diff_pressure)
    none = highres_imu(SAMPLE, 5, 0.0, AirspeedSample(0, nan, nan), px4=True, new=False)
    assert none.diff_pressure == 0.0
    low = highres_imu(SAMPLE, 5, 1000.0, PITOT, px4=True, new=True)
    assert low.diff_pressure == pytest.approx(0.6125 * 898.75 / 1013.25, rel=1e-3)


def test_the_airspeed_shown_is_read_ten_times_a_second_and_that_of_sea_level() -> None:
    shown = ShownAirspeed()
    assert shown.equivalent_mps == 0.0
    shown.step(0.0, AirspeedSample(0, nan, nan), 1000.0)
    assert shown.equivalent_mps == 0.0  # there is none yet
    shown.step(0.05, PITOT, 1000.0)
    # The same pressure in denser air is a lower speed: by the root of 0.9075.
    assert shown.equivalent_mps == pytest.approx(10.0 * sqrt(0.9075), rel=1e-4)
    later = PITOT._replace(airspeed_mps=20.0)
    shown.step(0.145, later, 1000.0)
    assert shown.equivalent_mps == pytest.approx(10.0 * sqrt(0.9075), rel=1e-4)
    shown.step(0.15, later, 0.0)
    assert shown.equivalent_mps == pytest.approx(20.0)


# --- distances -----------------------------------------------------------------------------------


def test_a_distance_is_in_whole_centimetres_with_its_limits_of_a_laser_looking_down() -> None:
    laser = RangeParams(rate_hz=20.0, delay_s=0.0, noise_m=0.0, min_m=0.3, max_m=50.0, lost=0.0)
    message = distance_sensor(RangeSample(1, 0.5, 12.346), laser, 500)
    assert message.time_boot_ms == 500
    assert (message.min_distance, message.max_distance) == (30, 5000)
    assert message.current_distance == 1235
    assert message.type == mavlink.MAV_DISTANCE_SENSOR_LASER
    assert message.orientation == mavlink.MAV_SENSOR_ROTATION_PITCH_270
    assert (message.id, message.covariance) == (0, 255)  # of the only one; unknown
    assert message.signal_quality == 100
    lost = distance_sensor(RangeSample(1, 0.5, nan), laser, 500)
    assert lost.current_distance > lost.max_distance
    assert lost.signal_quality == 1
    far = distance_sensor(RangeSample(1, 0.5, 9000.0), laser, 500)
    assert 65_000 < far.current_distance < 2**16  # what the message can hold


# --- places --------------------------------------------------------------------------------------


def cartesian(latitude_deg: float, longitude_deg: float, height_m: float) -> FloatArray:
    """Earth-centred, of WGS 84: a = 6378137 m, 1/f = 298.257223563."""
    flat = 1.0 / 298.257223563
    squared = flat * (2.0 - flat)
    lat, lon = radians(latitude_deg), radians(longitude_deg)
    normal = 6378137.0 / sqrt(1.0 - squared * sin(lat) ** 2)
    return np.array([
        (normal + height_m) * cos(lat) * cos(lon),
        (normal + height_m) * cos(lat) * sin(lon),
        (normal * (1.0 - squared) + height_m) * sin(lat),
    ])  # fmt: skip


@pytest.mark.parametrize("latitude_deg", [-70.0, 0.0, 51.99])
@pytest.mark.parametrize("altitude_m", [0.0, 3000.0])
def test_a_place_near_home_is_so_far_north_east_and_down_of_it(
    latitude_deg: float, altitude_m: float
) -> None:
    home = HomePosition(latitude_deg=latitude_deg, longitude_deg=4.375, altitude_m=altitude_m)
    place = geodetic(home, 30.0, -40.0, -5.0)
    assert place[2] == altitude_m + 5.0
    lat, lon = radians(latitude_deg), radians(4.375)
    north = np.array([-sin(lat) * cos(lon), -sin(lat) * sin(lon), cos(lat)])
    east = np.array([-sin(lon), cos(lon), 0.0])
    apart = cartesian(*place) - cartesian(latitude_deg, 4.375, altitude_m)
    # To a millimetre: over 40 m the earth bends by 0.1 mm, and meridians meet by less.
    assert float(apart @ north) == pytest.approx(30.0, abs=1e-3)
    assert float(apart @ east) == pytest.approx(-40.0, abs=1e-3)


FIX = position_fix(4, 2.0, (30.0, -40.0, -5.0), (1.5, -2.25, 0.126))


def test_a_global_position_is_in_its_messages_units() -> None:
    message = global_position(FIX, HOME, 2000, radians(-90.0))
    latitude, longitude, _ = geodetic(HOME, 30.0, -40.0, -5.0)
    assert message.time_boot_ms == 2000
    assert message.lat == round(latitude * 1e7)
    assert message.lon == round(longitude * 1e7)
    assert (message.alt, message.relative_alt) == (25_000, 5_000)
    assert (message.vx, message.vy, message.vz) == (150, -225, 13)
    assert message.hdg == 27_000
    nowhere = global_position(FIX, None, 2000, 0.0)
    assert (nowhere.lat, nowhere.lon, nowhere.alt, nowhere.relative_alt) == (0, 0, 0, 5_000)
    assert (nowhere.time_boot_ms, nowhere.vx, nowhere.vy, nowhere.vz) == (2000, 150, -225, 13)


@pytest.mark.parametrize(("yaw", "shown"), [(0.0, 0), (1.0, 5730), (-1e-6, 0), (2.0 * pi, 0)])
def test_a_heading_is_within_one_turn(yaw: float, shown: int) -> None:
    assert global_position(FIX, HOME, 0, yaw).hdg == shown
    assert global_position(FIX, None, 0, yaw).hdg == shown


def test_what_is_not_a_number_is_shown_as_not_known() -> None:
    """A filter that has diverged still fills its messages."""
    assert global_position(FIX, HOME, 0, nan).hdg == 65_535
    for wrong in ((nan, nan, nan), (nan, 0.0, -5.0), (0.0, nan, -5.0), (0.0, inf, -5.0)):
        fix = position_fix(1, 0.0, wrong, (nan, nan, nan))
        for home in (HOME, None):
            lost = global_position(fix, home, 0, 0.0)
            assert (lost.lat, lost.lon, lost.alt) == (0, 0, 0)
            assert lost.relative_alt == (0 if wrong[2] != wrong[2] else 5_000)
        assert gps_raw_int(fix, HOME, 0, (0.8, 1.2)).fix_type == mavlink.GPS_FIX_TYPE_NO_FIX


def test_above_the_standard_atmosphere_there_is_no_air() -> None:
    assert density_ratio(44_000.0) > 0.0
    for height_m in (44_400.0, 100_000.0):
        assert density_ratio(height_m) == 0.0
    assert isnan(density_ratio(nan))


def test_speeds_end_where_the_message_does() -> None:
    wild = position_fix(1, 0.0, (0.0, 0.0, 0.0), (400.0, -400.0, nan))
    message = global_position(wild, HOME, 0, 0.0)
    assert (message.vx, message.vy, message.vz) == (32_700, -32_700, 0)


def test_a_receivers_position_has_its_accuracy_and_no_dilution() -> None:
    message = gps_raw_int(FIX, HOME, 2_000_000, (0.8, 1.2))
    latitude, longitude, _ = geodetic(HOME, 30.0, -40.0, -5.0)
    assert (message.time_usec, message.fix_type) == (2_000_000, mavlink.GPS_FIX_TYPE_3D_FIX)
    assert (message.lat, message.lon) == (round(latitude * 1e7), round(longitude * 1e7))
    assert message.alt == 25_000
    assert (message.h_acc, message.v_acc) == (800, 1200)
    unknown = 2**16 - 1
    assert (message.eph, message.epv, message.vel, message.cog) == (unknown,) * 4
    assert message.satellites_visible == 14


@pytest.mark.parametrize("case", ["no home", "no number"])
def test_without_a_place_a_receiver_has_no_fix(case: str) -> None:
    home = None if case == "no home" else HOME
    fix = FIX if case == "no home" else FIX._replace(down_m=nan)
    message = gps_raw_int(fix, home, 2_000_000, (0.8, 1.2))
    assert (message.time_usec, message.fix_type) == (2_000_000, mavlink.GPS_FIX_TYPE_NO_FIX)
    assert (message.lat, message.lon, message.alt) == (0, 0, 0)
    unknown = 2**16 - 1
    assert (message.eph, message.epv, message.vel, message.cog) == (unknown,) * 4
    assert message.satellites_visible == 255  # unknown
