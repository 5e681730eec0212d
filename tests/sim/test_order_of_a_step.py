"""One step of the world, part by part: servos first, then the aircraft in the winds of both ends,
its crash, and the sensors of what has become of it."""

from __future__ import annotations

from functools import cache
from math import hypot, nan

import pytest

from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.sim.glide_test import EvenAir
from tgl_soar.sim.sensors import USUAL_SENSORS, SurfacesParams
from tgl_soar.sim.servos import servo_step
from tgl_soar.sim.world import World, make_world
from tgl_soar.sim.world_step import FieldAir, Parts, WorldNow, at_rest, local_wind, world_step
from tgl_soar.types import SurfaceCommand

AIRFRAME, SITE = (
    load_airframe(shipped("airframes/eclipson_c.toml")),
    load_site(shipped("sites/tunnel.toml")),
)
DT_S = 0.005
MOVES = SurfaceCommand(0.02, -0.03, 0.025, 0.5)


class Shear(EvenAir):
    """A wind that grows with the height, to the right and with time; it reaches 3 m up."""

    def wind_at(
        self, x_m: float, y_m: float, z_m: float, time_s: float
    ) -> tuple[float, float, float]:
        return 8.0 + z_m + 10.0 * time_s, 0.25 * y_m, 0.5 * x_m

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:  # noqa: ARG002
        return 0.0 < z_m < 3.0


def begun(turbulence: float = 0.0) -> World:
    return make_world(AIRFRAME, SITE, seed=3, turbulence=turbulence, field=Shear(8.5))


@cache
def still() -> tuple[Parts, WorldNow]:
    """In air without turbulence, in flight, with a sideslip."""
    made = begun()
    aircraft = made.now.aircraft._replace(
        y_m=0.25, velocity_x_mps=0.5, velocity_y_mps=0.75, velocity_z_mps=-0.5
    )
    return made.parts, made.now._replace(aircraft=aircraft)


def stepped(
    now: WorldNow | None = None, command: SurfaceCommand = MOVES, *, held: bool = False
) -> WorldNow:
    """By a world of its own, whose sensors take each step once."""
    parts = begun().parts
    return world_step(parts, still()[1] if now is None else now, 1, command, held)


def test_at_first_the_elevator_is_at_its_trim_and_all_else_in_the_middle() -> None:
    """Where the surfaces stand, and what is read back of their commands."""
    made = make_world(
        AIRFRAME, SITE, turbulence=0.0, field=Shear(8.5), sensors=USUAL_SENSORS._replace(
            surfaces=SurfacesParams(200.0, 0.0)
        ),
    )  # fmt: skip
    trim = made.trim.elevator
    assert made.surfaces.sequence == 1
    assert made.surfaces[2:6] == pytest.approx((trim, 0.0, 0.0, 0.0), abs=1e-12)
    assert made.state[13:] == pytest.approx((trim, 0.0, 0.0, 0.0, 0.0), abs=1e-12)
    assert (made.now.aileron, made.now.rudder, made.now.brake) == (made.now.aileron,) * 3
    assert made.now.aileron.deflection == 0.0
    assert (made.now.gust_mps, made.now.roll_gust_radps) == ((0.0, 0.0, 0.0), 0.0)


def test_each_servo_follows_its_own_command() -> None:
    _, before = still()
    after = stepped()
    servo = begun().parts.servo
    for name in ("elevator", "aileron", "rudder", "brake"):
        wanted = servo_step(servo, getattr(before, name), getattr(MOVES, name), DT_S)
        assert getattr(after, name) == wanted
        assert getattr(after.aircraft, name) == wanted.deflection
    moved = [getattr(after.aircraft, n) - getattr(before.aircraft, n) for n in MOVES._fields]
    assert len(set(moved)) == 4


def test_the_aircraft_meets_the_wind_where_it_was_and_where_it_is_going() -> None:
    parts, before = still()
    after = stepped()
    x, y, z = before.aircraft[:3]
    ahead = (x + 0.5 * DT_S, y + 0.75 * DT_S, z - 0.5 * DT_S)
    wind_ahead = 8.0 + ahead[2] + 10.0 * DT_S, 0.25 * ahead[1], 0.5 * ahead[0]
    surfaces = SurfaceCommand(*(getattr(after, name).deflection for name in MOVES._fields))
    wanted = parts.model.step(before.aircraft, surfaces, before.wind, wind_ahead, 0.0, 0.0, DT_S)
    assert after.aircraft == pytest.approx(wanted, abs=1e-12)
    assert not after.crashed
    at = after.aircraft
    here = 8.0 + at.z_m + 10.0 * DT_S, 0.25 * at.y_m, 0.5 * at.x_m
    assert after.wind == pytest.approx(here)


@pytest.mark.parametrize("crashed", [True, False])
def test_what_is_held_or_has_crashed_stays_and_its_servos_go_on(crashed: bool) -> None:
    _, before = still()
    after = stepped(before._replace(crashed=crashed), held=not crashed)
    assert after.crashed == crashed
    assert after.aircraft[:13] == before.aircraft[:13]
    for name in MOVES._fields:
        assert getattr(after.aircraft, name) == getattr(after, name).deflection
        assert getattr(after, name) != getattr(before, name)
    assert after.samples.position.sequence >= before.samples.position.sequence


@pytest.mark.parametrize(
    ("y_m", "z_m", "crashes"),
    [(0.25, 0.001, True), (0.25, 2.999, False), (0.25, 3.01, True), (9.0, 1.0, True)],
)
def test_who_leaves_the_air_has_crashed_and_rests(y_m: float, z_m: float, crashes: bool) -> None:
    """Sinking 0.5 m/s: 2.5 mm in a step."""
    _, before = still()
    there = before.aircraft._replace(y_m=y_m, z_m=z_m)
    after = stepped(before._replace(aircraft=there))
    assert after.crashed == crashes
    speeds = after.aircraft[3:6] + after.aircraft[10:13]
    assert all(speed == 0.0 for speed in speeds) == crashes
    assert after.aircraft.z_m < z_m


def test_at_rest_is_the_same_place_and_attitude_without_motion() -> None:
    _, before = still()
    moving = before.aircraft._replace(
        roll_rate_frd_radps=1.0, pitch_rate_frd_radps=2.0, yaw_rate_frd_radps=3.0, elevator=0.5
    )
    rests = at_rest(moving)
    assert rests[:3] == moving[:3]
    assert rests[6:10] == moving[6:10]
    assert rests[3:6] + rests[10:13] == (0.0,) * 6
    assert rests[13:] == moving[13:]


def test_the_wind_is_the_fields_at_the_steps_time_with_the_gust() -> None:
    parts, _ = still()
    gust = (0.1, -0.2, 0.3)
    wind = local_wind(parts, gust, 40, 1.0, 2.0, 2.5)
    assert wind == pytest.approx((8.0 + 2.5 + 2.0 + 0.1, 0.5 - 0.2, 0.5 + 0.3))


@pytest.mark.parametrize(
    ("y_m", "z_m", "flyable"),
    [(0.0, 1.0, True), (1.5, 1.0, True), (-1.5, 1.0, True), (1.51, 1.0, False), (-1.51, 1.0, False),
     (0.0, 3.5, False), (nan, 1.0, True)],
)  # fmt: skip
def test_air_is_flyable_where_the_field_reaches_and_the_world_is_wide(
    y_m: float, z_m: float, flyable: bool
) -> None:
    air = FieldAir(Shear(8.5), DT_S, 1.5)
    assert air.flyable(7, 0.5, y_m, z_m) == flyable
    assert air.wind_at(40, 1.0, 2.0, 2.5) == pytest.approx((12.5, 0.5, 0.5))


def test_turbulence_and_roll_gust_go_on_whether_the_aircraft_flies_or_not() -> None:
    gusts = []
    for held in (True, False):
        made = begun(0.05)
        assert made.now.gust_mps != (0.0, 0.0, 0.0)
        made.held = held
        observed = []
        for _ in range(5):
            made.step(SurfaceCommand(made.trim.elevator, 0.0, 0.0))
            observed.append((made.now.gust_mps, made.now.roll_gust_radps))
        gusts.append(observed)
        assert len({gust for gust, _ in observed}) == 5
        assert len({roll for _, roll in observed}) == 5
        at, gust = made.state, made.now.gust_mps
        field = made.field.wind_at(at.x_m, at.y_m, at.z_m, made.time_s)
        assert made.wind == pytest.approx([f + g for f, g in zip(field, gust, strict=True)])
    assert gusts[0] == gusts[1]


def test_put_back_it_begins_as_a_new_one_while_time_and_air_go_on() -> None:
    made, fresh = begun(), begun()
    for _ in range(20):
        made.throttle = 0.5
        made.step(SurfaceCommand(0.5, -0.5, 0.4, 0.3))
    assert hypot(*made.state[3:6]) > 0.0
    made.relaunch()
    assert made.state == fresh.state
    for name in ("elevator", "aileron", "rudder", "brake"):
        assert getattr(made.now, name) == getattr(fresh.now, name)
    assert (made.now.throttle, made.now.crashed, made.crashed) == (0.0, False, "")
    assert made.steps == 20
    start = made.start
    assert made.wind == pytest.approx((8.0 + start.z_m + 10.0 * 0.1, 0.0, 0.5 * start.x_m))
