"""What each sensor makes of the numbers that it is handed: truth, bias and noise, column by column,
with every number known."""

from __future__ import annotations

from math import cos, isnan, nan, sin, sqrt
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from tgl_soar.config.files import load_site, shipped
from tgl_soar.geometry import SoaringFrame
from tgl_soar.sim.aircraft import AircraftState
from tgl_soar.sim.sensor_sampling import (
    FlownSensors,
    Samples,
    flown_sensors,
    sense,
    sense_airspeed,
    sense_attitude,
    sense_imu,
    sense_position,
    sense_range,
)
from tgl_soar.sim.sensors import (
    AirspeedParams,
    AttitudeParams,
    ImuParams,
    PositionParams,
    RangeParams,
    Sensors,
    SurfacesParams,
    resting_force_frd,
)
from tgl_soar.types import SurfaceCommand

HZ = 200.0
PLACE = PositionParams(
    rate_hz=50.0,
    delay_s=0.0,
    noise_m=0.5,
    bias_m=10.0,
    velocity_noise_mps=0.25,
    gives_velocity=True,
)
TURN = AttitudeParams(
    rate_hz=100.0, delay_s=0.0, noise_rad=0.01, bias_rad=0.02, rate_noise_radps=0.5,
    rate_bias_radps=3.0,
)  # fmt: skip
FORCE = ImuParams(
    rate_hz=200.0, delay_s=0.0, force_noise_mps2=0.5, force_bias_mps2=10.0, rate_noise_radps=0.25,
    rate_bias_radps=2.0,
)  # fmt: skip
TUBE = AirspeedParams(rate_hz=50.0, delay_s=0.0, pressure_noise_pa=2.0, pressure_bias_pa=3.0)
LASER = RangeParams(rate_hz=20.0, delay_s=0.0, noise_m=0.5, min_m=0.0, max_m=99.0, lost=0.25)
ALL = Sensors(
    position=PLACE, attitude=TURN, imu=FORCE, airspeed=TUBE, surfaces=SurfacesParams(50.0, 0.0),
    rangefinder=LASER,
)  # fmt: skip
# Upwind is north, and the middle is local NED's origin.
NORTH = SoaringFrame(wind_from_rad=0.0, origin_north_m=0.0, origin_east_m=0.0, origin_down_m=0.0)
Q = Rotation.from_rotvec((0.3, -0.2, 0.5))
STATE = AircraftState(
    x_m=1.0, y_m=2.0, z_m=3.0, velocity_x_mps=-4.0, velocity_y_mps=5.0, velocity_z_mps=6.0,
    qw=float(Q.as_quat()[3]), qx=float(Q.as_quat()[0]), qy=float(Q.as_quat()[1]),
    qz=float(Q.as_quat()[2]), roll_rate_frd_radps=0.1, pitch_rate_frd_radps=0.2,
    yaw_rate_frd_radps=0.3, elevator=0.0, aileron=0.0, rudder=0.0,
)  # fmt: skip
AIRCRAFT: Any = SimpleNamespace(
    specific_force_frd=lambda _state, _wind: (1.0, 2.0, 3.0),
    gravity_mps2=9.8,
    air_density_kgpm3=1.25,
)
GROUND = load_site(shipped("sites/tunnel.toml")).known_ground()


class Handed:
    """Row k is k + 0.1, k + 0.2 and so on."""

    def __init__(self, columns: int) -> None:
        self.columns = columns

    def __getitem__(self, k: int) -> tuple[float, ...]:
        return tuple(k + 0.1 * (i + 1) for i in range(self.columns))


class Asked:
    """Hands out 1, 2, 3 … once, and keeps what it was asked for."""

    def __init__(self) -> None:
        self.calls: dict[str, tuple[int, int, int]] = {}

    def __call__(
        self, name: str, period_steps: int, once: int, columns: int
    ) -> tuple[tuple[float, ...], Any]:
        self.calls[name] = period_steps, once, columns
        return tuple(1.0 + i for i in range(once)), Handed(columns)


def flown(sensors: Sensors = ALL) -> FlownSensors:
    return flown_sensors(sensors, HZ, Asked(), ground=GROUND)


def test_each_sensor_asks_for_as_many_numbers_as_it_uses() -> None:
    asked = Asked()
    flown_sensors(ALL, HZ, asked, ground=GROUND)
    assert asked.calls == {
        "position": (4, 3, 6), "attitude": (2, 6, 6), "imu": (1, 6, 6), "airspeed": (4, 1, 1),
        "rangefinder": (10, 0, 2),
    }  # fmt: skip
    silent = PLACE._replace(gives_velocity=False, drift_m=1.0)
    flown_sensors(ALL._replace(position=silent), HZ, asked, ground=GROUND)
    assert asked.calls["position"] == (4, 3, 3)
    assert asked.calls["position drift"] == (4, 3, 3)


@pytest.mark.parametrize("k", [0, 1, 3])
def test_a_fix_is_the_truth_with_bias_and_noise_of_each_axis(k: int) -> None:
    sensor = flown().position
    for step in range(4 * k + 1):
        fix = sense_position(sensor, NORTH, STATE, step)
    assert (fix.sequence, fix.time_s) == (k + 1, 4 * k / HZ)
    # x is downstream and so south, y to the right when facing north, z up.
    errors = [10.0 * (i + 1) + 0.5 * (k + 0.1 * (i + 1)) for i in range(3)]
    truth = (-1.0, 2.0, -3.0)
    assert (fix.north_m, fix.east_m, fix.down_m) == pytest.approx(np.add(truth, errors))
    errors = [0.25 * (k + 0.1 * (i + 1)) for i in range(3, 6)]
    velocity = fix.velocity_north_mps, fix.velocity_east_mps, fix.velocity_down_mps
    assert velocity == pytest.approx(np.add((4.0, 5.0, -6.0), errors))
    assert (fix.source, fix.reckoned, isnan(fix.sigma_m)) == (0, False, True)


def test_a_fix_without_velocity_has_no_number_for_it() -> None:
    sensor = flown(ALL._replace(position=PLACE._replace(gives_velocity=False))).position
    fix = sense_position(sensor, NORTH, STATE, 0)
    assert all(isnan(value) for value in fix[5:8])
    assert fix.north_m == pytest.approx(-1.0 + 10.0 + 0.05)


def test_a_slow_error_is_of_the_receivers_own_size_and_time() -> None:
    """The first sample has the start, the next one what is left of it, and a new number."""
    drifting = PLACE._replace(bias_m=0.0, drift_m=2.0, drift_up_m=7.0, drift_s=0.08)
    sensor = flown(ALL._replace(position=drifting)).position
    kept = float(np.exp(-0.02 / 0.08))  # 20 ms between two samples
    start, new = np.array([1.0, 2.0, 3.0]), sqrt(1.0 - kept**2) * np.array([1.1, 1.2, 1.3])
    for k, drift in ((0, start), (1, kept * start + new)):
        fix = sense_position(sensor, NORTH, STATE, 4 * k)
        noise = 0.5 * (k + np.array([0.1, 0.2, 0.3]))
        expected = np.array([-1.0, 2.0, -3.0]) + noise + np.array([2.0, 2.0, 7.0]) * drift
        assert (fix.north_m, fix.east_m, fix.down_m) == pytest.approx(expected)


@pytest.mark.parametrize("wind_from_deg", [0.0, 50.0])
def test_an_attitude_is_turned_by_bias_and_noise_about_its_own_axes(wind_from_deg: float) -> None:
    sensor, k = flown().attitude, 2
    frame = NORTH._replace(wind_from_rad=np.radians(wind_from_deg))
    for step in range(5):
        found = sense_attitude(sensor, frame, STATE, step)
    assert (found.sequence, found.time_s) == (3, 0.02)
    small = [0.02 * (i + 1) + 0.01 * (k + 0.1 * (i + 1)) for i in range(3)]
    by = Rotation.from_quat([*(0.5 * np.array(small)), 1.0])
    upwind = Rotation.from_rotvec((0.0, 0.0, frame.wind_from_rad))
    expected = (upwind * Q * by).as_quat()
    quaternion = np.array([found.qx, found.qy, found.qz, found.qw])
    assert abs(float(quaternion @ expected)) == pytest.approx(1.0, abs=1e-12)
    assert float(quaternion @ quaternion) == pytest.approx(1.0)
    rates = [3.0 * (i + 1) + 0.5 * (k + 0.1 * (i + 1)) for i in range(3, 6)]
    assert found[6:9] == pytest.approx(np.add((0.1, 0.2, 0.3), rates))


def test_forces_and_rates_have_bias_and_noise_of_each_axis() -> None:
    sensor = flown().imu
    wind = (0.0, 0.0, 0.0)
    for step in range(3):
        found = sense_imu(sensor, AIRCRAFT, STATE, wind, False, step)
    assert (found.sequence, found.time_s) == (3, 0.01)
    forces = [10.0 * (i + 1) + 0.5 * (2 + 0.1 * (i + 1)) for i in range(3)]
    assert found[2:5] == pytest.approx(np.add((1.0, 2.0, 3.0), forces))
    rates = [2.0 * (i + 1) + 0.25 * (2 + 0.1 * (i + 1)) for i in range(3, 6)]
    assert found[5:8] == pytest.approx(np.add((0.1, 0.2, 0.3), rates))


def test_a_tether_is_measured_and_at_rest_the_weight_alone() -> None:
    exact = FORCE._replace(force_noise_mps2=0.0, force_bias_mps2=0.0)
    wind, pull = (0.0, 0.0, 0.0), (0.5, -0.25, 2.0)
    # Soaring axes against north, east, down: x is south, z is up; then into the body's own.
    body = Q.inv().apply((-0.5, -0.25, -2.0))
    pulled = sense_imu(flown(ALL._replace(imu=exact)).imu, AIRCRAFT, STATE, wind, False, 0, pull)
    assert pulled[2:5] == pytest.approx(np.add((1.0, 2.0, 3.0), body))
    for pull_mps2 in (pull, (0.0, 0.0, 0.0)):
        sensor = flown(ALL._replace(imu=exact)).imu
        resting = sense_imu(sensor, AIRCRAFT, STATE, wind, True, 0, pull_mps2)
        expected = Q.inv().apply((0.0, 0.0, -9.8))
        assert resting[2:5] == pytest.approx(expected)
        assert resting_force_frd(9.8, STATE) == pytest.approx(tuple(expected))


def test_a_pitot_tube_errs_in_pressure() -> None:
    """Half of ρ V², with the air's speed along the nose: here 12 m/s of head wind, level."""
    level = STATE._replace(
        qw=1.0, qx=0.0, qy=0.0, qz=0.0, velocity_x_mps=-4.0, velocity_y_mps=0.0, velocity_z_mps=0.0
    )
    sensor = flown().airspeed
    for step in range(9):
        found = sense_airspeed(sensor, AIRCRAFT, level, (8.0, 3.0, 1.0), step)
    pressure = 0.5 * 1.25 * 12.0**2 + 3.0 * 1.0 + 2.0 * (2 + 0.1)
    assert found == pytest.approx((3, 0.04, sqrt(pressure / (0.5 * 1.25))))
    # From behind it reads what its errors are, and nothing below zero.
    behind = sense_airspeed(flown().airspeed, AIRCRAFT, level, (-30.0, 0.0, 0.0), 0)
    assert behind.airspeed_mps == pytest.approx(sqrt((3.0 + 0.2) / (0.5 * 1.25)))
    below = ALL._replace(airspeed=TUBE._replace(pressure_bias_pa=-9.0))
    none = sense_airspeed(flown(below).airspeed, AIRCRAFT, level, (-30.0, 0.0, 0.0), 0)
    assert none.airspeed_mps == 0.0


@pytest.mark.parametrize(("lost", "is_lost"), [(0.57, False), (0.58, True), (0.0, False)])
def test_a_distance_is_lost_by_the_fraction_of_numbers_below_its_own(
    lost: float, is_lost: bool
) -> None:
    """The second number is 0.2; 57.9 % of all are less."""
    assert norm.cdf(0.2) == pytest.approx(0.579, abs=1e-3)
    level = STATE._replace(qw=1.0, qx=0.0, qy=0.0, qz=0.0, x_m=-2.0)
    sensor = flown(ALL._replace(rangefinder=LASER._replace(lost=lost))).rangefinder
    found = sense_range(sensor, level, 0)
    assert (found.sequence, found.time_s) == (1, 0.0)
    expected = nan if is_lost else 3.0 + 0.5 * 0.1
    assert found.range_m == pytest.approx(expected, nan_ok=True)
    assert sense_range(sensor, level, 10)[:2] == (2, 0.05)


def test_a_beam_that_leans_is_longer_by_its_cosine() -> None:
    exact = flown(ALL._replace(rangefinder=LASER._replace(lost=0.0, noise_m=0.0))).rangefinder
    half = 0.5 * 0.3
    rolled = STATE._replace(qw=cos(half), qx=sin(half), qy=0.0, qz=0.0, x_m=-9.0)
    assert sense_range(exact, rolled, 0).range_m == pytest.approx(3.0 / cos(0.3))


def test_all_are_sensed_at_once_as_one_by_one() -> None:
    command = SurfaceCommand(0.1, 0.2, 0.3, 0.4)
    wind, pull = (8.0, 0.0, 0.0), (0.5, 0.0, 0.0)
    found = sense(flown(), NORTH, AIRCRAFT, STATE, wind, command, False, 0, pull)
    apart = flown()
    assert found == Samples(
        position=sense_position(apart.position, NORTH, STATE, 0),
        attitude=sense_attitude(apart.attitude, NORTH, STATE, 0),
        imu=sense_imu(apart.imu, AIRCRAFT, STATE, wind, False, 0, pull),
        airspeed=sense_airspeed(apart.airspeed, AIRCRAFT, STATE, wind, 0),
        surfaces=found.surfaces,
        rangefinder=sense_range(apart.rangefinder, STATE, 0),
    )  # fmt: skip
    assert found.surfaces[:6] == (1, 0.0, 0.1, 0.2, 0.3, 0.4)
