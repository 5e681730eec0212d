"""The world as a whole: its steps, its randomness, its edges."""

from __future__ import annotations

from math import cos, degrees, isfinite, radians, sin
from pathlib import Path

import msgspec
import numpy as np
import pytest

from tgl_soar.air.hill import HillField
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import ConfigError, load_airframe, shipped
from tgl_soar.config.site import (
    GridAir,
    HillAir,
    JetAir,
    Site,
    SiteOrigin,
    Start,
)
from tgl_soar.geometry import euler_from_quaternion, soaring_from_ned
from tgl_soar.sim.sensors import (
    MEMS_IMU,
    PITOT,
    READ_BACK,
    AttitudeParams,
    ImuParams,
    PositionParams,
    Sensors,
)
from tgl_soar.sim.world import Air, Truth, World, build_field, ground_outline, make_world
from tgl_soar.types import (
    NO_AIRSPEED,
    NO_IMU,
    NO_SURFACES,
    AttitudeSample,
    PositionFix,
    SurfaceCommand,
)

JET = JetAir(wind_mps=8.5, slope_deg=23.0)
PERFECT_POSITION = PositionParams(
    rate_hz=100.0, delay_s=0.0, noise_m=0.0, bias_m=0.0, velocity_noise_mps=0.0, gives_velocity=True
)
PERFECT_ATTITUDE = AttitudeParams(
    rate_hz=200.0,
    delay_s=0.0,
    noise_rad=0.0,
    bias_rad=0.0,
    rate_noise_radps=0.0,
    rate_bias_radps=0.0,
)


@pytest.fixture(scope="module")
def airframe() -> Airframe:
    return load_airframe(shipped("airframes/eclipson_c.toml"))


def site(air: Air | None = JET, *, x_m: float = 1.3, z_m: float = 1.55) -> Site:
    place = SiteOrigin(
        name="test", origin_north_m=10.0, origin_east_m=-5.0, origin_down_m=2.0, wind_from_deg=70.0
    )
    return Site(site=place, air=air, start=Start(x_m=x_m, z_m=z_m))


def trimmed(world: World) -> SurfaceCommand:
    return SurfaceCommand(world.trim.elevator, 0.0, 0.0)


def test_the_steps_are_the_time_and_every_sensor_has_its_rate(airframe: Airframe) -> None:
    world = make_world(airframe, site())
    attitudes: list[AttitudeSample] = []
    fixes: list[PositionFix] = []
    world.held = True
    for _ in range(3 * world.step_hz):
        world.step(trimmed(world))
        attitude, fix = world.poll_attitude(), world.poll_position()
        attitudes += [attitude] if attitude is not None else []
        fixes += [fix] if fix is not None else []
        assert world.poll_attitude() is None
        assert world.poll_position() is None
    assert world.steps == 600
    assert world.time_s == pytest.approx(3.0, abs=1e-12)
    # Delivered after the delay: those taken in the last moments are still under way.
    assert len(attitudes) == 600  # 200 Hz, one step late
    assert len(fixes) == 150 - 2 + 1  # 50 Hz, taken from 0 to 2.96 s
    assert [a.sequence for a in attitudes] == list(range(1, 601))
    assert attitudes[-1].time_s == pytest.approx(3.0 - 0.005)
    assert fixes[-1].time_s == pytest.approx(2.96)


def fly(world: World, seconds: float) -> list[Truth]:
    path = []
    for i in range(round(seconds * world.step_hz)):
        world.step(SurfaceCommand(world.trim.elevator, 0.01 * (i % 7), -0.02 * (i % 5)))
        path.append(world.truth)
    return path


def test_the_same_seed_is_the_same_flight_to_the_last_bit(airframe: Airframe) -> None:
    one, two, other = (
        make_world(airframe, site(), seed=seed, turbulence=0.03) for seed in (5, 5, 6)
    )
    assert fly(one, 2.0) == fly(two, 2.0)
    assert one.position == two.position
    assert one.attitude == two.attitude
    assert fly(other, 2.0) != fly(two, 2.0)


def test_turbulence_is_a_fraction_of_the_reference_wind(airframe: Airframe) -> None:
    """The standard deviation of 2 minutes of the updraft at one place, within 10 %: some 700
    independent numbers lie within that time, so the scatter is 3 %."""
    world = make_world(airframe, site(), turbulence=0.03)
    world.held = True
    updraft = []
    for _ in range(120 * world.step_hz):
        world.step(trimmed(world))
        updraft.append(world.wind[2])
    mean = sum(updraft) / len(updraft)
    deviation = (sum((u - mean) ** 2 for u in updraft) / len(updraft)) ** 0.5
    assert deviation == pytest.approx(0.03 * 8.5, rel=0.1)


def test_roll_gusts_leave_the_rest_of_the_air_as_it_is(airframe: Airframe) -> None:
    """A stream of their own: the same u, v, w at the same place, and the aircraft rolls."""
    rolled, rolls = held_then_free(airframe, roll_gusts=True)
    plain, plain_rolls = held_then_free(airframe, roll_gusts=False)
    assert rolled == plain
    assert max(map(abs, rolls)) > 5.0 * max(map(abs, plain_rolls))


def held_then_free(
    airframe: Airframe, *, roll_gusts: bool
) -> tuple[list[tuple[float, float, float]], list[float]]:
    """The wind while the aircraft is held, and its roll rates in the second after its release."""
    air = msgspec.structs.replace(
        JET, turbulence=msgspec.structs.replace(JET.turbulence, roll_gusts=roll_gusts)
    )
    world = make_world(airframe, site(air), seed=4, turbulence=0.03)
    world.held = True
    winds = []
    for _ in range(400):
        world.step(trimmed(world))
        winds.append(world.wind)
    world.held = False
    rates = []
    for _ in range(30):
        world.step(trimmed(world))
        rates.append(world.state.roll_rate_frd_radps)
    return winds, rates


def test_a_held_aircraft_stays_and_its_sensors_go_on(airframe: Airframe) -> None:
    world = make_world(airframe, site())
    world.held = True
    before = world.truth
    for _ in range(100):
        world.step(SurfaceCommand(1.0, 0.5, -0.5))
    after = world.truth
    assert (after.x_m, after.z_m, after.pitch_rad) == (before.x_m, before.z_m, before.pitch_rad)
    assert after.climb_mps == 0.0
    assert after.airspeed_mps > 8.0  # in the wind
    assert after.elevator == pytest.approx(1.0, abs=1e-3)  # the servos are alive
    assert world.attitude.sequence == 100
    world.held = False
    world.step(trimmed(world))
    assert world.truth.climb_mps != 0.0


def test_the_start_is_at_rest_upwind_and_not_stalled(airframe: Airframe) -> None:
    for height in (1.2, 1.55, 2.5):
        truth = make_world(airframe, site(z_m=height)).truth
        assert (truth.x_m, truth.y_m, truth.z_m) == (1.3, 0.0, height)
        assert truth.velocity_x_mps == truth.velocity_y_mps == truth.climb_mps == 0.0
        assert truth.heading_rad == 0.0
        assert truth.alpha_rad < radians(15.0)


def test_in_calm_air_at_the_right_place_the_start_is_an_equilibrium(airframe: Airframe) -> None:
    """Where updraft equals the trimmed sink nothing accelerates."""
    low, high = 1.55, 3.4
    for _ in range(40):
        middle = 0.5 * (low + high)
        world = make_world(airframe, site(z_m=middle))
        if world.wind[2] > world.trim.sink_mps:
            low = middle
        else:
            high = middle
    world = make_world(airframe, site(z_m=low))
    world.step(trimmed(world))
    truth = world.truth
    acceleration = (truth.velocity_x_mps**2 + truth.climb_mps**2) ** 0.5 * world.step_hz
    assert acceleration < 0.01


def test_samples_are_in_local_ned(airframe: Airframe) -> None:
    """The frame is moved and turned by 70°: the sensors' answers lead back to the truth."""
    where = site()
    sensors = Sensors(position=PERFECT_POSITION, attitude=PERFECT_ATTITUDE)
    world = make_world(airframe, where, sensors=sensors, turbulence=0.03)
    fly(world, 0.5)
    truth, fix, attitude = world.truth, world.position, world.attitude
    assert fix.time_s == attitude.time_s == world.time_s
    place = soaring_from_ned(where.frame(), fix.north_m, fix.east_m, fix.down_m)
    assert place == pytest.approx((truth.x_m, truth.y_m, truth.z_m), abs=1e-9)
    roll, pitch, yaw = euler_from_quaternion(*attitude[2:6])
    assert (roll, pitch) == pytest.approx((truth.roll_rad, truth.pitch_rad), abs=1e-9)
    assert degrees(yaw - truth.heading_rad) == pytest.approx(70.0, abs=1e-6)
    upwind = -cos(radians(70.0)), -sin(radians(70.0))
    along = fix.velocity_north_mps * upwind[0] + fix.velocity_east_mps * upwind[1]
    assert along == pytest.approx(truth.velocity_x_mps, abs=1e-9)


@pytest.mark.parametrize(
    ("command", "x_m", "z_m", "words"),
    [
        (SurfaceCommand(-1.0, 0.0, 0.0), 1.3, 1.2, "hit the board"),
        (SurfaceCommand(-1.0, 0.0, 0.0), -1.0, 0.8, "hit the ground"),
        (SurfaceCommand(0.0, 0.3, 0.3), 1.3, 2.5, "left the air sideways"),
        (SurfaceCommand(0.3, 0.0, 0.0), 0.0, 3.5, "left the air that"),
    ],
)
def test_the_end_of_a_flight_is_named(
    airframe: Airframe, command: SurfaceCommand, x_m: float, z_m: float, words: str
) -> None:
    world = make_world(airframe, site(x_m=x_m, z_m=z_m))
    for _ in range(20 * world.step_hz):
        world.step(command)
        if world.crashed:
            break
    assert words in world.crashed
    lying = world.truth
    world.step(command)
    assert world.truth[1:7] == lying[1:7]
    assert lying.climb_mps == 0.0
    world.relaunch()
    assert not world.crashed
    assert world.truth.x_m == x_m
    world.step(trimmed(world))
    assert all(isfinite(value) for value in world.truth)


def test_the_hill_flies_too(airframe: Airframe) -> None:
    air = HillAir(wind_mps=9.0, radius_m=30.0)
    world = make_world(airframe, site(air, x_m=-20.0, z_m=35.0))
    fly(world, 1.0)
    assert not world.crashed
    for _ in range(60 * world.step_hz):
        world.step(SurfaceCommand(-0.5, 0.0, 0.0))
        if world.crashed:
            break
    assert "hit the" in world.crashed


def test_outlines_bound_the_solid() -> None:
    for air in (JET, HillAir(wind_mps=9.0, radius_m=30.0)):
        outline = ground_outline(air)
        assert outline is not None
        field = build_field(air)
        centre = (
            sum(x for x, _ in outline) / len(outline),
            sum(z for _, z in outline) / len(outline),
        )
        for x, z in outline[1:2]:
            inward = x + 0.02 * (centre[0] - x), z + 0.02 * (centre[1] - z)
            outward = x - 0.02 * (centre[0] - x), z - 0.02 * (centre[1] - z)
            assert not field.inside(inward[0], 0.0, inward[1])
            assert field.inside(outward[0], 0.0, outward[1])


def test_what_cannot_be_flown_in_is_named(airframe: Airframe, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"no \[air\] table"):
        make_world(airframe, site(None))
    with pytest.raises(ConfigError, match=r"no \[start\] table"):
        make_world(airframe, msgspec.structs.replace(site(), start=None))
    with pytest.raises(ConfigError, match=r"start at x 1\.3.*in the ground"):
        make_world(airframe, site(z_m=0.2))
    with pytest.raises(ConfigError, match=r"air\.file: .*wind\.csv: no such file"):
        make_world(airframe, site(GridAir(file="wind.csv", wind_mps=8.5)), folder=tmp_path)
    with pytest.raises(ValueError, match="CL_alpha"):
        msgspec.structs.replace(airframe, model={**airframe.model, "CL_alpha": -1.0})


def test_a_field_from_a_file_is_flown_in(airframe: Airframe, tmp_path: Path) -> None:
    """The hill written to a file and read back: the same flight within the grid's resolution."""
    hill = HillField(7.0, 8.0)
    x, z = np.arange(-14.0, 0.01, 0.25), np.arange(9.0, 20.01, 0.25)
    u, _, w = hill.wind(x[:, None], 0.0, z[None, :])
    np.savez(tmp_path / "hill.npz", x=x, z=z, u=u, w=w)
    air = GridAir(file="hill.npz", wind_mps=7.0)
    worlds = [
        make_world(airframe, site(air, x_m=-5.0, z_m=13.0), folder=tmp_path),
        make_world(airframe, site(HillAir(wind_mps=7.0, radius_m=8.0), x_m=-5.0, z_m=13.0)),
    ]
    for world in worlds:
        for _ in range(100):
            world.step(SurfaceCommand(world.trim.elevator, 0.0, 0.0))
    read, exact = (world.truth for world in worlds)
    # Half a second of free flight: bilinear cells of 0.25 m leave 0.02 m/s, so a centimetre.
    assert read.x_m == pytest.approx(exact.x_m, abs=0.01)
    assert read.z_m == pytest.approx(exact.z_m, abs=0.01)


def test_a_sensor_more_is_otherwise_the_same_flight(airframe: Airframe) -> None:
    """Each draws from a stream of its own; what is absent says nothing."""
    bare = make_world(airframe, site(), turbulence=0.03)
    full = make_world(
        airframe,
        site(),
        turbulence=0.03,
        sensors=Sensors(imu=MEMS_IMU, airspeed=PITOT, surfaces=READ_BACK),
    )
    for _ in range(200):
        bare.step(trimmed(bare))
        full.step(trimmed(full))
        assert (full.position, full.attitude) == (bare.position, bare.attitude)
    assert full.truth == bare.truth
    assert (bare.imu, bare.airspeed, bare.surfaces) == (NO_IMU, NO_AIRSPEED, NO_SURFACES)
    assert (full.imu.sequence, full.airspeed.sequence, full.surfaces.sequence) == (201, 50, 50)
    assert full.airspeed.airspeed_mps == pytest.approx(full.airspeed_mps, abs=1.0)
    assert full.surfaces[2:] == trimmed(full)


def test_an_aircraft_that_is_held_feels_its_weight(airframe: Airframe) -> None:
    exact = ImuParams(
        rate_hz=200.0,
        delay_s=0.0,
        force_noise_mps2=0.0,
        force_bias_mps2=0.0,
        rate_noise_radps=0.0,
        rate_bias_radps=0.0,
    )
    world = make_world(airframe, site(), turbulence=0.03, sensors=Sensors(imu=exact))
    world.held = True
    world.step(trimmed(world))
    pitch, g = world.truth.pitch_rad, 9.80665
    assert world.imu[2:5] == pytest.approx((g * sin(pitch), 0.0, -g * cos(pitch)))
