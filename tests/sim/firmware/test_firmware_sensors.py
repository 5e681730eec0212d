"""The sensors that a real firmware reads agree with each other and with the world's truth."""

from __future__ import annotations

from math import atan2, degrees, hypot, isclose, radians, sqrt
from pathlib import Path

import pytest

from tgl_soar.config.files import load_airframe, load_site
from tgl_soar.config.site import HomePosition
from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.sim.aircraft import gliding_state
from tgl_soar.sim.firmware.sensors import (
    PRESSURE_NOISE_PA,
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

CONFIG = Path(__file__).parents[3] / "config"
STEP_HZ = 250
HILL = HomePosition(latitude_deg=-33.0, longitude_deg=151.0, altitude_m=420.0)


def a_world(site: str = "tunnel", turbulence: float = 0.0) -> World:
    return make_world(
        load_airframe(CONFIG / "airframes/eclipson_c.toml"),
        load_site(CONFIG / f"sites/{site}.toml"),
        step_hz=STEP_HZ,
        turbulence=turbulence,
        sensors=firmware_sensors(STEP_HZ),
    )


def flown(
    world: World, home: HomePosition | None, seconds: float, *, seed: int = 1
) -> list[Readings]:
    sensors = FirmwareSensors(world, home, seed)
    readings = [sensors.read()]
    held = SurfaceCommand(world.trim.elevator, 0.0, 0.0)
    for _ in range(round(seconds * STEP_HZ)):
        world.step(held)
        readings.append(sensors.read())
    return readings


def mean(values: list[float]) -> float:
    return sum(values) / len(values)


def test_held_still_it_feels_gravity_alone() -> None:
    world = a_world()
    world.held = True
    readings = flown(world, None, 1.0)
    force = [mean([r.force_frd_mps2[i] for r in readings]) for i in range(3)]
    assert hypot(*force) == pytest.approx(9.80665, abs=0.3)  # bias of 0.1 m/s² on each axis
    assert degrees(atan2(force[0], -force[2])) == pytest.approx(
        degrees(world.trim_pitch_rad), abs=1.5
    )


def test_in_a_steady_glide_the_air_carries_the_weight() -> None:
    """No acceleration, so the specific force is gravity's reaction: along −D, of size g."""
    world = a_world()
    start = world.start
    world.state = gliding_state(world.trim, world.wind, start.x_m, start.y_m, start.z_m)
    force = flown(world, None, 0.02)[-1].force_frd_mps2
    assert hypot(*force) == pytest.approx(9.80665, abs=0.4)  # noise and bias of 0.1 m/s² each
    assert degrees(atan2(force[0], -force[2])) == pytest.approx(
        degrees(world.trim.pitch_rad), abs=1.5
    )


def test_each_sensor_has_its_own_rate() -> None:
    readings = flown(a_world(), None, 2.0)
    assert len(readings) == 2 * STEP_HZ + 1
    assert sum(r.magnetic_frd_gauss is not None for r in readings) == 101
    assert sum(r.pressure_pa is not None for r in readings) == 101
    assert sum(r.differential_pressure_pa is not None for r in readings) in (100, 101)
    fixes = [r.time_s for r in readings if r.gps is not None]
    assert fixes[0] == pytest.approx(0.1)  # the receiver is late
    assert fixes[-1] - fixes[0] == pytest.approx(0.1 * (len(fixes) - 1))


def test_the_pressure_falls_as_the_aircraft_rises() -> None:
    assert pressure_pa(0.0) == 101325.0
    assert pressure_pa(1000.0) == pytest.approx(89874.6, rel=1e-5)  # ISO 2533, table 5
    for height_m in (-100.0, 0.0, 420.0, 3000.0):
        assert height_of_pressure_m(pressure_pa(height_m)) == pytest.approx(height_m, abs=1e-6)
    world = a_world("hill")
    readings = flown(world, HILL, 1.0)
    last = next(r for r in reversed(readings) if r.pressure_pa is not None)
    assert last.height_m == pytest.approx(420.0 + world.state.z_m, abs=0.6)  # 5 sigma and a step
    assert last.pressure_pa == pytest.approx(
        pressure_pa(420.0 + world.state.z_m), abs=6.0 * PRESSURE_NOISE_PA
    )


def test_pitot_pressure_and_temperature_tell_the_airspeed() -> None:
    """As a firmware does it: ρ of pressure and temperature, then V = √(2 Δp / ρ)."""
    world = a_world("hill")
    world.held = True
    readings = flown(world, HILL, 1.0)
    static = mean([r.pressure_pa for r in readings if r.pressure_pa is not None])
    read = [r.differential_pressure_pa for r in readings]
    dynamic = mean([pressure for pressure in read if pressure is not None])
    density = static / (287.05287 * (readings[-1].temperature_c + 273.15))
    assert sqrt(2.0 * dynamic / density) == pytest.approx(world.airspeed_mps, abs=0.5)


def test_the_field_is_that_of_the_place() -> None:
    """Against published values of the World Magnetic Model, 2026: Delft and Sydney."""
    north, east, down = earth_field_ned_gauss(SOMEWHERE)
    assert degrees(atan2(east, north)) == pytest.approx(2.6, abs=0.4)
    assert degrees(atan2(down, hypot(north, east))) == pytest.approx(67.2, abs=0.4)
    assert hypot(north, east, down) == pytest.approx(0.495, abs=0.004)
    north, east, down = earth_field_ned_gauss(HILL)
    assert degrees(atan2(east, north)) == pytest.approx(12.7, abs=0.5)
    assert down < 0.0  # of the southern hemisphere


@pytest.mark.parametrize("heading_deg", [0.0, 75.0, 180.0, -100.0])
def test_the_field_turns_with_the_aircraft(heading_deg: float) -> None:
    """A level compass of the readings shows the heading, less the declination."""
    world = a_world("hill")  # its wind comes from the west
    world.held = True
    turned = quaternion_from_euler(0.0, 0.0, radians(heading_deg - 270.0))
    world.state = world.state._replace(qw=turned[0], qx=turned[1], qy=turned[2], qz=turned[3])
    readings = flown(world, None, 1.0)
    fields = [r.magnetic_frd_gauss for r in readings if r.magnetic_frd_gauss is not None]
    x, y, z = (mean([field[i] for field in fields]) for i in range(3))
    north, east, down = earth_field_ned_gauss(SOMEWHERE)
    shown = degrees(atan2(-y, x)) + degrees(atan2(east, north))
    assert (shown - heading_deg + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.5)
    assert z == pytest.approx(down, abs=0.002)


def test_gps_velocity_is_the_derivative_of_gps_position() -> None:
    world = a_world("hill", turbulence=0.03)
    sensors = FirmwareSensors(world, HILL, 1)
    fixes = []
    for _ in range(5 * STEP_HZ):
        world.step(SurfaceCommand(world.trim.elevator - 0.1, 0.02, 0.0))
        reading = sensors.read()
        if reading.gps is not None:
            fixes.append(reading.gps)
    seconds = 0.1 * (len(fixes) - 1)
    first, last = fixes[0], fixes[-1]
    moved_north = radians(last.latitude_deg - first.latitude_deg) * 6_355_000.0
    velocities = [fix.velocity_ned_mps for fix in fixes]
    assert abs(moved_north) > 0.0
    assert moved_north / seconds == pytest.approx(mean([v[0] for v in velocities]), abs=0.1)
    climbed = (last.altitude_m - first.altitude_m) / seconds
    assert climbed == pytest.approx(-mean([v[2] for v in velocities]), abs=0.1)
    assert abs(climbed) > 0.2  # it did move


def test_gps_and_barometer_tell_the_same_height() -> None:
    world = a_world("hill")
    world.held = True
    readings = flown(world, HILL, 3.0)
    gps = mean([r.gps.altitude_m for r in readings if r.gps is not None])
    baro = mean([r.height_m for r in readings if r.pressure_pa is not None])
    assert gps == pytest.approx(baro, abs=1.0)  # the receiver is off by decimetres all flight
    assert isclose(baro, 420.0 + world.state.z_m, abs_tol=0.05)


def test_a_hall_has_no_satellites() -> None:
    world = a_world()
    sensors = FirmwareSensors(world, None, 1, gps=False)
    for _ in range(STEP_HZ // 2):
        world.step(SurfaceCommand(0.0, 0.0, 0.0))
        assert sensors.read().gps is None


def test_the_same_seed_reads_the_same() -> None:
    first, again = flown(a_world(), None, 0.5), flown(a_world(), None, 0.5)
    other = flown(a_world(), None, 0.5, seed=2)
    assert first == again
    assert first != other


def test_a_step_rate_that_the_slow_sensors_do_not_divide_is_refused() -> None:
    world = make_world(
        load_airframe(CONFIG / "airframes/eclipson_c.toml"),
        load_site(CONFIG / "sites/tunnel.toml"),
        step_hz=330,
        sensors=firmware_sensors(330)._replace(airspeed=None),
    )
    with pytest.raises(ValueError, match="magnetometer rate 50 Hz does not divide"):
        FirmwareSensors(world, None, 1)
