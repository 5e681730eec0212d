"""A flight from tick to tick, in plain Python: the rows that it fills, where it ends, what a look
ahead leaves as it was, and what follows a tick."""

from __future__ import annotations

from functools import cache
from math import isnan, radians
from types import SimpleNamespace

import numpy as np
import pytest

from tgl_soar.air.field import WindField
from tgl_soar.autopilot import Output, initial_state
from tgl_soar.autopilot import step as autopilot_step
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_flight, shipped
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Site
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.control.supervisor import CAPTURING, FAILED, READY, RELEASED, SOARING
from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.sim.closed_loop import Change, fly
from tgl_soar.sim.flight import (
    CRASHED,
    FLIES,
    HANDED_OVER,
    HELD_S,
    Flight,
    Row,
    acted_on,
    decide_in_cells,
    fly_ticks,
    fly_to_look,
    inputs_at,
    row_of,
)
from tgl_soar.sim.world import World, make_world, site_field
from tgl_soar.sim.world_step import Parts
from tgl_soar.types import SurfaceCommand

UNTOUCHED = -77.0


@cache
def place() -> tuple[Airframe, Site, ParameterSet, WindField]:
    airframe, site, values = load_flight(
        shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
    )
    return airframe, site, values, site_field(site)


def new_world(turbulence: float = 0.03) -> World:
    airframe, site, _, field = place()
    return make_world(airframe, site, seed=4, turbulence=turbulence, field=field)


def laws_of(world: World, **changes: float) -> Laws:
    values = place()[2].changed(changes, flying=True)
    return laws_from(values, world.frame, world.aerodynamics, world.ground)


def start(world: World) -> Flight:
    return Flight(
        steps=0,
        standing=FLIES,
        reason=0,
        world=world.now,
        command=SurfaceCommand(world.trim.elevator, 0.0, 0.0),
        held=True,
        autopilot=initial_state(),
    )


def empty_rows(count: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return np.full((count, len(Row._fields)), UNTOUCHED)


def engaged() -> tuple[Parts, Laws, Flight]:
    """A flight in whose last tick the module had the aircraft; its sensors take each step once."""
    world = new_world()
    laws = laws_of(world)
    flight = fly_ticks(world.parts, laws, start(world), 60, 0, empty_rows(60))
    assert not flight.held
    return world.parts, laws, flight


@cache
def output_of_a_tick() -> Output:
    _, laws, flight = engaged()
    now = flight.steps / 200
    return autopilot_step(laws, flight.autopilot, inputs_at(now, flight.world.samples, True))[1]


# --- ticks ----------------------------------------------------------------------------------------


def test_a_flight_in_two_parts_is_that_of_the_loop_with_a_change_between_them() -> None:
    moved = {"TGL_X": place()[2]["TGL_X"] + 0.1}
    world = new_world()
    one = fly(world, place()[2], [Change(0.5, moved)], 0.75)
    other = new_world()
    rows = empty_rows(160)
    flight = fly_ticks(other.parts, laws_of(other), start(other), 100, 0, rows)
    assert (flight.steps, flight.standing) == (100, FLIES)
    assert np.all(rows[100:] == UNTOUCHED)
    flight = fly_ticks(other.parts, laws_of(other, **moved), flight, 150, 1, rows)
    assert flight.steps == 150
    assert flight.world.aircraft == world.state
    assert np.all(rows[150:] == UNTOUCHED)
    for i, name in enumerate(Row._fields):
        np.testing.assert_array_equal(rows[:150, i], one[name], err_msg=name)
    assert rows[[0, 99, 100, 149], Row._fields.index("target_changes")].tolist() == [0, 0, 1, 1]
    assert rows[:150, 0] == pytest.approx(np.arange(150) / 200)
    line_moving = rows[:150, Row._fields.index("line_moving")]
    assert line_moving[0] == 1.0  # it is not soared on yet
    assert line_moving[110] == 1.0


def test_the_reason_of_a_flight_is_that_of_its_last_tick() -> None:
    world = new_world()
    rows = empty_rows(60)
    laws = laws_of(world)
    flight = start(world)
    reasons = []
    for n in range(1, 61):
        flight = fly_ticks(world.parts, laws, flight, n, 0, rows)
        reasons.append(flight.reason)
    assert reasons == rows[:, Row._fields.index("reason")].tolist()
    assert len(set(reasons)) > 1
    assert fly_ticks(world.parts, laws, flight, 60, 0, rows).reason == reasons[-1]


def test_a_look_ahead_leaves_the_flight_as_it_was() -> None:
    """The tick that is looked at is made again when its time comes, with the same outcome."""
    world, other = new_world(), new_world()
    laws = laws_of(world)
    rows, others = empty_rows(80), empty_rows(80)
    fly_ticks(world.parts, laws, start(world), 80, 0, rows)
    flight, looked = fly_to_look(other.parts, laws, start(other), 60, 0, others)
    assert looked.time_s == pytest.approx(60 / 200)
    assert np.all(others[60:] == UNTOUCHED)
    assert flight.autopilot.time_s == pytest.approx(59 / 200)
    fly_ticks(other.parts, laws, flight, 80, 0, others)
    np.testing.assert_array_equal(others, rows)
    elevator = Row._fields.index("elevator")
    assert looked.command.elevator == rows[60, elevator] != rows[59, elevator]


def diving(flight: Flight) -> Flight:
    """The same below the ground, nose down."""
    qw, qx, qy, qz = quaternion_from_euler(0.0, radians(-80.0), 0.0)
    aircraft = flight.world.aircraft._replace(
        z_m=-0.5, velocity_z_mps=-9.0, qw=qw, qx=qx, qy=qy, qz=qz
    )
    return flight._replace(world=flight.world._replace(aircraft=aircraft))


def test_a_flight_ends_with_the_step_in_which_it_crashes() -> None:
    parts, laws, flight = engaged()
    flight = diving(flight)
    rows = empty_rows(70)
    ended = fly_ticks(parts, laws, flight, 70, 0, rows)
    assert ended.standing == CRASHED
    assert ended.world.crashed
    assert ended.steps == flight.steps + 1
    assert np.all(rows[ended.steps :] == UNTOUCHED)
    again, looked = fly_to_look(parts, laws, ended, 70, 0, rows)
    assert again == ended
    assert looked.time_s == pytest.approx(ended.steps / 200)
    assert np.all(rows[ended.steps :] == UNTOUCHED)


# --- what follows a tick --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "standing"),
    [
        (READY, FLIES),
        (CAPTURING, FLIES),
        (SOARING, FLIES),
        (RELEASED, HANDED_OVER),
        (FAILED, HANDED_OVER),
    ],
)
def test_a_flight_is_handed_over_in_two_modes(mode: int, standing: int) -> None:
    parts, _, flight = engaged()
    output = output_of_a_tick()._replace(mode=mode)
    found = acted_on(parts, flight.world, flight.steps + 1, flight.command, False, output)
    assert found[3] == standing
    crashing = diving(flight).world
    assert acted_on(parts, crashing, 62, flight.command, False, output)[3] == CRASHED


@pytest.mark.parametrize("active", [True, False])
@pytest.mark.parametrize("held", [True, False])
def test_only_an_active_module_moves_surfaces_and_takes_the_aircraft(
    active: bool, held: bool
) -> None:
    parts, _, flight = engaged()
    before = SurfaceCommand(0.1, -0.2, 0.3, 0.0)
    output = output_of_a_tick()
    output = output._replace(
        active=active,
        command=SurfaceCommand(-0.4, 0.5, -0.6, 0.0),
        throttle=output.throttle._replace(fraction=0.25),
    )
    world, command, still_held, standing = acted_on(parts, flight.world, 61, before, held, output)
    assert command == (output.command if active else before)
    assert still_held == (held and not active)
    assert standing == FLIES
    assert world.throttle == 0.25
    stays = (world.aircraft.x_m, world.aircraft.z_m) == (
        flight.world.aircraft.x_m,
        flight.world.aircraft.z_m,
    )
    assert stays == still_held
    # The surfaces move towards what is commanded, of which all three have another sign.
    moved = world.aircraft.rudder - flight.world.aircraft.rudder
    assert (moved < 0.0) == active


def test_the_module_is_asked_to_engage_from_two_tenths_of_a_second_on() -> None:
    samples = new_world().now.samples
    assert HELD_S == 0.2
    for now_s, engage, asked in (
        (0.0, True, False),
        (0.195, True, False),
        (0.2, True, True),
        (9.0, True, True),
        (9.0, False, False),
    ):
        inputs = inputs_at(now_s, samples, engage)
        assert inputs.engage == asked
        assert inputs.time_s == inputs.autopilot.time_s == now_s
    autopilot = inputs.autopilot
    assert (autopilot.accepts_surfaces, autopilot.armed, autopilot.failsafe) == (True, True, False)
    assert autopilot.boots == 0
    assert (inputs.position, inputs.attitude, inputs.imu) == samples[:3]
    assert (inputs.airspeed, inputs.surfaces, inputs.rangefinder) == samples[3:6]


# --- a row ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("moving", "active", "number"),
    [(False, True, 0.0), (True, True, 1.0), (False, False, 1.0), (True, False, 1.0)],
)
def test_a_line_stands_only_where_the_module_flies_on_it(
    moving: bool, active: bool, number: float
) -> None:
    _, _, flight = engaged()
    output = output_of_a_tick()
    output = output._replace(active=active, line=output.line._replace(moving=moving))
    row = row_of(1.0, flight.world.aircraft, (8.0, 1.0, 2.0), output, 3)
    assert row.line_moving == number
    assert (row.time_s, row.target_changes) == (1.0, 3.0)
    assert (row.wind_mps, row.updraft_mps) == (8.0, 2.0)


def test_a_row_has_the_true_attitude_and_distance_beside_what_the_module_takes_them_for() -> None:
    _, _, flight = engaged()
    output = output_of_a_tick()
    line = output.line._replace(x_m=1.0, z_m=2.0, eta_rad=radians(90.0))  # upright: x = 1
    qw, qx, qy, qz = quaternion_from_euler(0.1, 0.2, 0.3)
    aircraft = flight.world.aircraft._replace(x_m=1.25, z_m=5.0, qw=qw, qx=qx, qy=qy, qz=qz)
    row = row_of(1.0, aircraft, (8.0, 0.0, 0.0), output._replace(line=line, mode=SOARING), 0)
    assert abs(row.e_rho_m) == pytest.approx(0.25)
    assert (row.roll_rad, row.pitch_rad, row.heading_rad) == pytest.approx((0.1, 0.2, 0.3))
    assert row.mode == SOARING
    assert row.pitch_setpoint_rad == output.setpoints.pitch_rad


# --- the tick alone -------------------------------------------------------------------------------


def test_a_decision_is_what_the_tick_says_and_its_state_is_kept() -> None:
    _, laws, flight = engaged()
    inputs = inputs_at(0.3, flight.world.samples, True)
    state, output = autopilot_step(laws, flight.autopilot, inputs)
    cell = SimpleNamespace(value=flight.autopilot)
    decision = decide_in_cells(SimpleNamespace(value=laws), cell, inputs)
    for name in decision._fields:
        np.testing.assert_equal(getattr(decision, name), getattr(output, name))
    assert cell.value.time_s == state.time_s == pytest.approx(0.3)
    assert cell.value.loops == state.loops
    assert not isnan(output.command.elevator)
