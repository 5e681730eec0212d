"""Sensor messages in SI units: each field's place and unit, and what is no measurement."""

from __future__ import annotations

from math import inf, isnan, nan, sqrt
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.messages import DistanceSensor, HighresImu, RawImu, ScaledImu, VfrHud
from tgl_soar.link.sensor_units import (
    airspeed_of_hud,
    airspeed_of_pressure,
    imu_of,
    range_of,
    sigma_of,
)

G_MPS2 = 9.80665  # standard gravity
ACCELERATIONS = (
    mavlink.HIGHRES_IMU_UPDATED_XACC
    | mavlink.HIGHRES_IMU_UPDATED_YACC
    | mavlink.HIGHRES_IMU_UPDATED_ZACC
)
GYROS = (
    mavlink.HIGHRES_IMU_UPDATED_XGYRO
    | mavlink.HIGHRES_IMU_UPDATED_YGYRO
    | mavlink.HIGHRES_IMU_UPDATED_ZGYRO
)
DIFFERENTIAL = mavlink.HIGHRES_IMU_UPDATED_DIFF_PRESSURE
SEA_LEVEL_HPA, SEA_LEVEL_DEGC = 1013.25, 15.0
AT_REST = HighresImu(
    time_usec=1,
    xacc=0.5,
    yacc=-0.25,
    zacc=-9.75,
    xgyro=0.125,
    ygyro=-0.5,
    zgyro=0.75,
    abs_pressure=SEA_LEVEL_HPA,
    diff_pressure=1.0,
    temperature=SEA_LEVEL_DEGC,
    fields_updated=ACCELERATIONS | GYROS | DIFFERENTIAL,
)


def other(**fields: Any) -> HighresImu:
    """The same with some fields changed."""
    return AT_REST._replace(**fields)


AXES = ("xacc", "yacc", "zacc")
TURNS = ("xgyro", "ygyro", "zgyro")


# --- accelerations and rates ---------------------------------------------------------------------


def test_highres_imu_is_in_si_units_already() -> None:
    assert imu_of(AT_REST) == ((0.5, -0.25, -9.75), (0.125, -0.5, 0.75))


@pytest.mark.parametrize("kind", ["scaled", "raw"])
def test_milli_g_and_milliradians_are_metres_and_radians_of_single_precision(kind: str) -> None:
    """The log keeps 32 bits of them, and a flight that is replayed must see the same."""
    message = (
        ScaledImu(
            message_id=26, time_boot_ms=1, xacc=1000, yacc=-2000, zacc=-500,
            xgyro=1500, ygyro=-250, zgyro=1,
        )
        if kind == "scaled"
        else RawImu(
            time_usec=1, xacc=1000, yacc=-2000, zacc=-500, xgyro=1500, ygyro=-250, zgyro=1
        )
    )  # fmt: skip
    found = imu_of(message)
    assert found is not None
    force, rates = found
    assert force == tuple(float(np.float32(g * G_MPS2)) for g in (1.0, -2.0, -0.5))
    assert rates == tuple(float(np.float32(turn)) for turn in (1.5, -0.25, 0.001))


@pytest.mark.parametrize("missing", [1, 2, 4])
def test_accelerations_that_were_not_measured_are_none(missing: int) -> None:
    assert imu_of(AT_REST._replace(fields_updated=AT_REST.fields_updated & ~missing)) is None


@pytest.mark.parametrize("missing", [8, 16, 32])
def test_rates_that_were_not_measured_cost_no_acceleration(missing: int) -> None:
    found = imu_of(AT_REST._replace(fields_updated=AT_REST.fields_updated & ~missing))
    assert found is not None
    assert found[0] == (0.5, -0.25, -9.75)
    assert all(isnan(rate) for rate in found[1])


def test_nothing_but_the_six_that_are_used_must_be_there() -> None:
    found = imu_of(AT_REST._replace(fields_updated=ACCELERATIONS | GYROS))
    assert found == imu_of(AT_REST)


@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize(
    ("value", "fits"),
    [(399.0, True), (-399.0, True), (401.0, False), (-401.0, False), (nan, False), (inf, False)],
)
def test_more_than_forty_g_on_any_axis_is_no_measurement(
    axis: str, value: float, fits: bool
) -> None:
    assert (imu_of(other(**{axis: value})) is not None) == fits


@pytest.mark.parametrize("turn", TURNS)
@pytest.mark.parametrize(
    ("value", "fits"),
    [(79.0, True), (-79.0, True), (81.0, False), (-81.0, False), (nan, False), (-inf, False)],
)
def test_rates_beyond_eighty_radians_a_second_are_dropped_and_accelerations_are_kept(
    turn: str, value: float, fits: bool
) -> None:
    """No gyroscope that is made measures them: 80 rad/s are 4600 degrees a second."""
    found = imu_of(other(**{turn: value}))
    assert found is not None
    assert found[0] == (0.5, -0.25, -9.75)
    assert [isnan(rate) for rate in found[1]] == [not fits] * 3


def test_a_sensor_whose_three_axes_are_exactly_zero_is_not_there() -> None:
    nothing = dict.fromkeys(AXES, 0.0)
    assert imu_of(other(**nothing)) is None
    for axis in AXES:  # one that is not is enough
        assert imu_of(other(**{**nothing, axis: 0.01})) is not None
    assert imu_of(RawImu(time_usec=1, xacc=0, yacc=0, zacc=0, xgyro=5, ygyro=5, zgyro=5)) is None


# --- airspeed ------------------------------------------------------------------------------------


def air_density(height_m: float) -> float:
    """kg/m³ of the standard atmosphere's troposphere, from its own constants (ISO 2533)."""
    kelvin = 288.15 - 0.0065 * height_m
    pressure: float = 101_325.0 * (kelvin / 288.15) ** (G_MPS2 / (287.05287 * 0.0065))
    return pressure / (287.05287 * kelvin)


@pytest.mark.parametrize("height_m", [-500.0, 0.0, 300.0, 1000.0, 4000.0, 9000.0])
@pytest.mark.parametrize("airspeed", [0.0, 8.0, 30.0])
def test_an_equivalent_airspeed_is_made_true_by_the_standard_atmosphere(
    height_m: float, airspeed: float
) -> None:
    true = airspeed * sqrt(air_density(0.0) / air_density(height_m))
    assert airspeed_of_hud(VfrHud(airspeed, height_m)) == pytest.approx(true, rel=1e-4)


@pytest.mark.parametrize(
    ("height_m", "taken_m"),
    [(-5000.0, -500.0), (30_000.0, 9000.0), (nan, 0.0), (inf, 0.0), (-inf, 0.0)],
)
def test_a_height_at_which_nobody_soars_is_limited_and_none_is_sea_level(
    height_m: float, taken_m: float
) -> None:
    found = airspeed_of_hud(VfrHud(10.0, height_m))
    assert found == airspeed_of_hud(VfrHud(10.0, taken_m))
    assert found is not None


@pytest.mark.parametrize("speed", [-0.1, 151.0, nan, inf])
def test_an_airspeed_that_no_glider_has_is_no_measurement(speed: float) -> None:
    assert airspeed_of_hud(VfrHud(speed, 0.0)) is None


def test_one_that_it_can_have_is_taken_up_to_150_metres_a_second() -> None:
    assert airspeed_of_hud(VfrHud(149.0, 0.0)) == pytest.approx(149.0)
    assert airspeed_of_hud(VfrHud(0.0, 0.0)) == 0.0
    assert airspeed_of_hud(VfrHud(149.0, 1000.0)) is None  # it is the true one that counts


@pytest.mark.parametrize(
    ("hpa", "celsius", "difference_hpa"),
    [(SEA_LEVEL_HPA, SEA_LEVEL_DEGC, 0.6), (850.0, -5.0, 1.2), (1030.0, 40.0, 0.05)],
)
def test_a_pitot_s_pressure_is_the_airspeed_by_bernoulli(
    hpa: float, celsius: float, difference_hpa: float
) -> None:
    found = airspeed_of_pressure(
        AT_REST._replace(abs_pressure=hpa, temperature=celsius, diff_pressure=difference_hpa)
    )
    assert found is not None
    density = 100.0 * hpa / (287.05287 * (celsius + 273.15))
    assert 0.5 * density * found**2 == pytest.approx(100.0 * difference_hpa, rel=1e-4)


def test_a_pitot_that_sucks_shows_no_airspeed() -> None:
    assert airspeed_of_pressure(AT_REST._replace(diff_pressure=-0.3)) == 0.0


def test_without_a_new_pressure_there_is_no_new_airspeed() -> None:
    old = AT_REST._replace(fields_updated=AT_REST.fields_updated & ~DIFFERENTIAL)
    assert airspeed_of_pressure(old) is None
    only = AT_REST._replace(fields_updated=DIFFERENTIAL)
    assert airspeed_of_pressure(only) == airspeed_of_pressure(AT_REST) is not None


def thin(density: float) -> HighresImu:
    """Air of a density [kg/m³] at 15 °C."""
    return AT_REST._replace(abs_pressure=density * 287.05287 * 288.15 / 100.0)


@pytest.mark.parametrize(
    ("density", "is_air"), [(0.29, False), (0.31, True), (1.79, True), (1.81, False)]
)
def test_air_as_thin_as_at_twelve_kilometres_or_denser_than_any_is_none(
    density: float, is_air: bool
) -> None:
    assert (airspeed_of_pressure(thin(density)) is not None) == is_air


@pytest.mark.parametrize(
    "broken",
    [
        {"temperature": -273.15},
        {"temperature": -300.0, "abs_pressure": -SEA_LEVEL_HPA},  # two wrong make no right
        {"temperature": nan},
        {"abs_pressure": nan},
        {"abs_pressure": 0.0},
        {"diff_pressure": nan},
        {"diff_pressure": inf},
        {"diff_pressure": 200.0},  # 180 m/s
    ],
)
def test_what_is_no_air_gives_no_airspeed(broken: dict[str, float]) -> None:
    assert airspeed_of_pressure(other(**broken)) is None


# --- a rangefinder -------------------------------------------------------------------------------

DOWN = mavlink.MAV_SENSOR_ROTATION_PITCH_270
BELOW = DistanceSensor(
    time_boot_ms=1, min_distance=20, max_distance=4000, current_distance=315, id=0,
    orientation=DOWN, signal_quality=0,
)  # fmt: skip


def test_centimetres_are_metres() -> None:
    assert range_of(BELOW) == pytest.approx(3.15)


@pytest.mark.parametrize(
    ("here", "is_one"), [(19, False), (20, False), (21, True), (3999, True), (4000, False)]
)
def test_both_ends_of_its_reach_count_as_beyond(here: int, is_one: bool) -> None:
    assert (range_of(BELOW._replace(current_distance=here)) is not None) == is_one


@pytest.mark.parametrize(("here", "is_one"), [(0, False), (1, True)])
def test_a_sensor_without_a_smallest_distance_shows_zero_for_nothing(
    here: int, is_one: bool
) -> None:
    message = BELOW._replace(min_distance=-1, current_distance=here)
    assert (range_of(message) is not None) == is_one


@pytest.mark.parametrize(("quality", "is_one"), [(0, True), (1, False), (2, True), (100, True)])
def test_a_signal_that_is_known_to_be_invalid_is_no_measurement(quality: int, is_one: bool) -> None:
    """0: not known, 1: invalid, 100: perfect."""
    assert (range_of(BELOW._replace(signal_quality=quality)) is not None) == is_one


@pytest.mark.parametrize("orientation", [0, DOWN - 1, DOWN + 1])
def test_one_that_does_not_look_down_measures_no_height(orientation: int) -> None:
    assert range_of(BELOW._replace(orientation=orientation)) is None


# --- a pose's covariance -------------------------------------------------------------------------


def triangle(variances: tuple[float, float, float]) -> tuple[float, ...]:
    """The upper triangle of a 6 x 6 matrix, row by row, with much of everything else."""
    matrix = np.full((6, 6), 25.0)
    matrix[np.diag_indices(3)] = variances
    return tuple(matrix[np.triu_indices(6)].tolist())


@pytest.mark.parametrize("worst", range(3))
def test_the_worst_of_three_axes_tells_how_good_a_pose_is(worst: int) -> None:
    variances = [0.01, 0.01, 0.01]
    variances[worst] = 0.04
    assert sigma_of(triangle((variances[0], variances[1], variances[2]))) == pytest.approx(0.2)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("broken", [nan, inf, -inf])
def test_a_variance_that_is_no_number_is_not_known(axis: int, broken: float) -> None:
    variances = [0.01, 0.01, 0.01]
    variances[axis] = broken
    assert isnan(sigma_of(triangle((variances[0], variances[1], variances[2]))))


def test_a_pose_without_variance_is_not_known_to_be_good() -> None:
    assert isnan(sigma_of(triangle((0.0, 0.0, 0.0))))
    assert isnan(sigma_of(triangle((-1.0, -1.0, -1.0))))
    assert sigma_of(triangle((0.0, 0.0, 0.04))) == pytest.approx(0.2)
    assert isnan(sigma_of(()))
    assert isnan(sigma_of((0.01,) * 11))
    assert sigma_of((0.01,) * 12) == pytest.approx(0.1)
