"""A firmware's sensors by their numbers: the standard atmosphere, rates, noise, what each carries,
and the truth that a firmware's own simulator is given."""

from __future__ import annotations

from math import cos, radians, sin

import numpy as np
import pytest

from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.config.site import HomePosition
from tgl_soar.geometry import ned_from_soaring, quaternion_from_euler
from tgl_soar.sim.firmware import sensors as module
from tgl_soar.sim.firmware.sensors import (
    GNSS,
    SOMEWHERE,
    FirmwareSensors,
    Readings,
    earth_field_ned_gauss,
    firmware_sensors,
    height_of_pressure_m,
    pressure_pa,
)
from tgl_soar.sim.world import World, make_world
from tgl_soar.types import SurfaceCommand

STEP_HZ = 100
HILL = HomePosition(latitude_deg=-33.0, longitude_deg=151.0, altitude_m=420.0)
AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))
SITE = load_site(shipped("sites/hill.toml"))


def held_world() -> World:
    world = make_world(
        AIRFRAME, SITE, step_hz=STEP_HZ, turbulence=0.0, sensors=firmware_sensors(STEP_HZ)
    )
    world.held = True
    return world


def readings_of(world: World, home: HomePosition | None, steps: int) -> list[Readings]:
    sensors = FirmwareSensors(world, home, 1)
    found = [sensors.read()]
    for _ in range(steps):
        world.step(SurfaceCommand(0.0, 0.0, 0.0))
        found.append(sensors.read())
    return found


@pytest.mark.parametrize(
    ("height_m", "pressure"),
    [(0.0, 101325.0), (500.0, 95461.3), (1000.0, 89876.3), (3000.0, 70108.5), (11000.0, 22632.0)],
)
def test_pressure_and_height_are_the_standard_atmospheres(height_m: float, pressure: float) -> None:
    """ISO 2533, whose table is by geopotential height."""
    assert pressure_pa(height_m) == pytest.approx(pressure, rel=5e-5)
    assert height_of_pressure_m(pressure) == pytest.approx(height_m, abs=0.5)


def test_a_metre_at_sea_level_is_12_pascals() -> None:
    """dp/dh = -ρ g."""
    assert pressure_pa(0.5) - pressure_pa(-0.5) == pytest.approx(-1.225 * 9.80665, rel=1e-4)


def test_the_atmospheres_constants_are_those_of_the_standard() -> None:
    assert module.SEA_LEVEL_PA == 101325.0
    assert module.SEA_LEVEL_K == 288.15
    assert module.LAPSE_KPM == 0.0065
    assert pytest.approx(287.05287) == module.GAS_JPKGK
    assert module.GAUSS_PER_NT == 1e-5  # 1 T is 10⁴ gauss


def test_a_site_without_a_place_is_in_delft() -> None:
    assert HomePosition(latitude_deg=51.99, longitude_deg=4.375, altitude_m=0.0) == SOMEWHERE
    world = held_world()
    assert FirmwareSensors(world, None, 1).home == SOMEWHERE
    assert FirmwareSensors(world, HILL, 1).home == HILL


def test_inertial_sensors_read_at_every_step_and_the_receiver_ten_times_a_second() -> None:
    carried = firmware_sensors(400)
    assert carried.imu is not None
    assert carried.imu.rate_hz == carried.attitude.rate_hz == 400.0
    assert carried.attitude[1:] == (0.0, 0.0, 0.0, 0.0, 0.0)  # truth: no delay, no error
    assert carried.position == GNSS
    assert (GNSS.rate_hz, GNSS.delay_s, GNSS.gives_velocity) == (10.0, 0.1, True)
    assert (GNSS.noise_m, GNSS.bias_m, GNSS.velocity_noise_mps) == (0.05, 0.0, 0.05)
    assert (carried.surfaces, carried.rangefinder) == (None, None)


def test_a_pitot_tube_is_carried_by_default() -> None:
    assert firmware_sensors(400).airspeed is not None
    assert firmware_sensors(400).airspeed == firmware_sensors(400, pitot=True).airspeed
    assert firmware_sensors(400, pitot=False).airspeed is None


def test_slow_sensors_read_every_second_step_of_100() -> None:
    readings = readings_of(held_world(), HILL, 10)
    new = [r.pressure_pa is not None for r in readings]
    assert new == [True, False] * 5 + [True]
    assert [r.magnetic_frd_gauss is not None for r in readings] == new
    assert [r.time_s for r in readings] == pytest.approx([i / STEP_HZ for i in range(11)])


def test_where_the_barometer_has_nothing_new_the_height_is_the_true_one() -> None:
    world = held_world()
    readings = readings_of(world, HILL, 10)
    true_m = 420.0 - ned_from_soaring(world.frame, *world.state[:3])[2]
    for reading in readings:
        if reading.pressure_pa is None:
            assert reading.height_m == pytest.approx(true_m, abs=1e-9)
        else:
            assert reading.height_m == pytest.approx(true_m, abs=0.5)
            assert reading.height_m != true_m
            assert pressure_pa(reading.height_m) == pytest.approx(reading.pressure_pa)


def test_noise_is_1_pascal_and_one_and_a_half_milligauss() -> None:
    """Over 1000 readings the deviation is known to 2 %."""
    world = held_world()
    readings = [r for r in readings_of(world, HILL, 2000) if r.pressure_pa is not None]
    pressures = np.array([r.pressure_pa for r in readings])
    assert np.std(pressures) == pytest.approx(1.0, rel=0.1)
    fields = np.array([r.magnetic_frd_gauss for r in readings])
    assert np.std(fields, axis=0) == pytest.approx([0.0015] * 3, rel=0.1)
    noise = np.corrcoef(np.column_stack((pressures, fields)).T)
    assert np.abs(noise[np.triu_indices(4, 1)]).max() < 0.15  # each has its own


def test_the_field_is_turned_into_the_body_as_a_matrix_does_it() -> None:
    """b = Rᵀ B, R by its three turns: heading, pitch, roll."""
    world = held_world()
    roll, pitch, heading = 0.3, -0.2, 0.5
    q = quaternion_from_euler(roll, pitch, heading)
    world.state = world.state._replace(qw=q[0], qx=q[1], qy=q[2], qz=q[3])
    psi = heading + world.frame.wind_from_rad  # attitudes of the state face upwind
    turn = np.array([[cos(psi), -sin(psi), 0], [sin(psi), cos(psi), 0], [0, 0, 1]])
    nod = np.array([[cos(pitch), 0, sin(pitch)], [0, 1, 0], [-sin(pitch), 0, cos(pitch)]])
    lean = np.array([[1, 0, 0], [0, cos(roll), -sin(roll)], [0, sin(roll), cos(roll)]])
    expected = (turn @ nod @ lean).T @ np.array(earth_field_ned_gauss(HILL))
    fields = [r.magnetic_frd_gauss for r in readings_of(world, HILL, 200)]
    mean = np.mean([field for field in fields if field is not None], axis=0)
    assert mean == pytest.approx(expected, abs=6 * 0.0015 / 10)


def test_the_temperature_is_that_of_an_air_as_dense_as_the_one_that_carries() -> None:
    """T = p / (R ρ): 15 °C at sea level for 1.225 kg/m³, and 12.6 K less per 420 m of pressure."""
    world = held_world()
    height_m = 420.0 - ned_from_soaring(world.frame, *world.state[:3])[2]
    reading = readings_of(world, HILL, 0)[0]
    expected = pressure_pa(height_m) / (287.05287 * 1.225) - 273.15
    assert reading.temperature_c == pytest.approx(expected, abs=1e-6)
    world = held_world()
    down = HomePosition(
        latitude_deg=0.0,
        longitude_deg=0.0,
        altitude_m=ned_from_soaring(world.frame, *world.state[:3])[2],
    )
    assert readings_of(world, down, 0)[0].temperature_c == pytest.approx(15.0, abs=0.01)


def test_the_pitots_pressure_is_half_the_density_times_its_speed_squared() -> None:
    world = held_world()
    sensors = FirmwareSensors(world, HILL, 1)
    for _ in range(20):
        before = world.airspeed.sequence
        world.step(SurfaceCommand(0.0, 0.0, 0.0))
        pressure = sensors.read().differential_pressure_pa
        if world.airspeed.sequence == before:
            assert pressure is None
        else:
            assert pressure == pytest.approx(0.5 * 1.225 * world.airspeed.airspeed_mps**2)
    assert world.airspeed.sequence > 5


def test_a_fix_is_at_the_place_of_the_position_sensor_with_its_velocity() -> None:
    """North by a degree's 110.9 km at 33 degrees south, east by 93.5 km."""
    world = held_world()
    sensors = FirmwareSensors(world, HILL, 1)
    fixes = 0
    for _ in range(40):
        world.step(SurfaceCommand(0.0, 0.0, 0.0))
        gps = sensors.read().gps
        if gps is None:
            continue
        fixes += 1
        fix = world.position
        assert gps.latitude_deg == pytest.approx(-33.0 + fix.north_m / 110_909.0, abs=2e-8)
        assert gps.longitude_deg == pytest.approx(151.0 + fix.east_m / 93_453.0, abs=2e-8)
        assert gps.altitude_m == pytest.approx(420.0 - fix.down_m)
        assert gps.velocity_ned_mps == (
            fix.velocity_north_mps,
            fix.velocity_east_mps,
            fix.velocity_down_mps,
        )
    assert fixes == 4


def test_the_truth_is_in_local_ned() -> None:
    """The hill's wind comes from the west, so x of the soaring frame is east."""
    world = held_world()
    q = quaternion_from_euler(0.1, 0.2, 0.3)
    world.state = world.state._replace(
        x_m=-5.0,
        y_m=2.0,
        z_m=13.0,
        velocity_x_mps=1.0,
        velocity_y_mps=0.5,
        velocity_z_mps=-0.25,
        qw=q[0],
        qx=q[1],
        qy=q[2],
        qz=q[3],
    )
    motion = FirmwareSensors(world, HILL, 1).read().motion
    assert world.frame.wind_from_rad == pytest.approx(radians(270.0))
    assert motion.position_ned_m == pytest.approx(ned_from_soaring(world.frame, -5.0, 2.0, 13.0))
    assert motion.velocity_ned_mps[1] == pytest.approx(1.0)
    assert motion.velocity_ned_mps[2] == pytest.approx(0.25)
    assert abs(motion.velocity_ned_mps[0]) == pytest.approx(0.5)
    whole = quaternion_from_euler(0.1, 0.2, 0.3 + radians(270.0))
    sign = 1.0 if motion.attitude[0] * whole[0] >= 0.0 else -1.0
    assert [sign * each for each in motion.attitude] == pytest.approx(list(whole))
    assert motion.airspeed_mps == world.airspeed_mps > 5.0


def test_force_and_rates_are_the_inertial_sensors() -> None:
    world = held_world()
    sensors = FirmwareSensors(world, HILL, 1)
    for _ in range(5):
        world.step(SurfaceCommand(0.0, 0.0, 0.0))
        reading, imu = sensors.read(), world.imu
        assert reading.force_frd_mps2 == (
            imu.force_x_frd_mps2,
            imu.force_y_frd_mps2,
            imu.force_z_frd_mps2,
        )
        assert reading.rate_frd_radps == (
            imu.roll_rate_frd_radps,
            imu.pitch_rate_frd_radps,
            imu.yaw_rate_frd_radps,
        )
        assert reading.force_frd_mps2[2] == pytest.approx(-9.8, abs=1.0)


def test_the_field_is_of_a_fixed_year_and_falls_with_height() -> None:
    """Flights repeat; the dipole's field falls by 3/R, 0.05 % a kilometre."""
    assert (module.FIELD_YEAR, module.FIELD_EPOCH.year) == (2026.0, 2025)
    high = HomePosition(latitude_deg=51.99, longitude_deg=4.375, altitude_m=10_000.0)
    low = np.linalg.norm(earth_field_ned_gauss(SOMEWHERE))
    ratio = np.linalg.norm(earth_field_ned_gauss(high)) / low
    assert ratio == pytest.approx(1.0 - 3.0 * 10.0 / 6371.0, abs=0.001)
