"""The module and the world in one process, tick by tick: who holds the aircraft, what is commanded
before the module is active, when changes act, and how a flight is reported to have ended."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from tgl_soar.air.field import WindField
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_flight, shipped
from tgl_soar.config.parameters import ParameterError, ParameterSet
from tgl_soar.config.site import Site
from tgl_soar.sim.closed_loop import Change, ClosedLoop, fly
from tgl_soar.sim.faults import parse_fault
from tgl_soar.sim.flight import HELD_S, Row
from tgl_soar.sim.glide_test import EvenAir
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.world import World, make_world, site_field


@cache
def place() -> tuple[Airframe, Site, ParameterSet, WindField]:
    airframe, site, values = load_flight(
        shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
    )
    return airframe, site, values, site_field(site)


def new_world() -> World:
    airframe, site, _, field = place()
    return make_world(airframe, site, seed=5, turbulence=0.0, field=field)


def test_the_aircraft_is_held_at_its_trim_until_the_module_is_active() -> None:
    world = new_world()
    loop = ClosedLoop(world, place()[2])
    assert world.held
    assert loop.output is None
    start, ticks = world.state, 0
    while world.held:
        output = loop.tick()
        assert loop.output is output
        ticks += 1
        assert ticks < 100
        if world.held:
            assert not output.active
            assert world.state[:6] == start[:6]
            assert world.now.elevator.deflection == pytest.approx(world.trim.elevator, abs=1e-9)
    assert output.active
    assert ticks / world.step_hz > HELD_S
    assert world.steps == ticks


def test_who_does_not_engage_holds_the_aircraft() -> None:
    world = new_world()
    loop = ClosedLoop(world, place()[2])
    loop.engage = False
    for _ in range(80):
        assert not loop.tick().active
    assert world.held


def test_a_parameter_acts_from_the_next_tick_on_and_a_wrong_one_is_refused() -> None:
    world = new_world()
    loop = ClosedLoop(world, place()[2])
    loop.tick()
    loop.change({"TGL_X": 1.5})
    assert loop.values["TGL_X"] == 1.5
    assert place()[2]["TGL_X"] != 1.5
    assert loop._laws.target.x_m == 1.5
    with pytest.raises(ParameterError, match="TGL_Y"):
        loop.change({"TGL_Y": 1.0})


def test_changes_act_in_the_order_of_their_times_from_the_first_tick_that_is_not_before() -> None:
    """Two of one time, and one between two ticks; what comes after the end never acts."""
    changes = [
        Change(0.1, {"TGL_X": 0.7}),
        Change(0.0, {"TGL_X": 0.6}),
        Change(0.0725, {"TGL_X": 0.65}),
        Change(0.1, {"TGL_Z": 1.3}),
        Change(9.0, {"TGL_X": 0.9}),
    ]
    flight = fly(new_world(), place()[2], changes, 0.15)
    assert (flight.ticks, flight.ended) == (30, "")
    assert set(flight.columns) == set(Row._fields)
    wanted = [1.0] * 15 + [2.0] * 5 + [4.0] * 10  # 0.0725 s: the tick at 0.075
    assert flight["target_changes"].tolist() == wanted
    assert flight["time_s"] == pytest.approx(np.arange(30) / 200)


def test_a_row_is_of_the_truth_before_its_tick() -> None:
    world = new_world()
    x_m, z_m = world.state.x_m, world.state.z_m
    flight = fly(world, place()[2], [], 0.01)
    assert flight["x_m"].tolist() == [x_m, x_m]
    assert flight["z_m"].tolist() == [z_m, z_m]
    assert flight["wind_mps"][0] == pytest.approx(world.wind[0])


class Shallow(EvenAir):
    """Even air that ends below the start, where an aircraft sinks through it."""

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:  # noqa: ARG002
        return z_m > 1.15


def test_a_crash_ends_a_flight_in_the_worlds_own_words() -> None:
    airframe, site, values, _ = place()
    world = make_world(airframe, site, turbulence=0.0, field=Shallow(8.5))
    flight = fly(world, values, [], 2.0)
    assert flight.ended == world.crashed != ""
    assert flight.ended.startswith("left the air that the field describes at x ")
    assert flight.ticks == world.steps < 400
    assert flight["z_m"][-1] > 1.15 > world.state.z_m


def test_a_disengagement_ends_a_flight_with_its_reason() -> None:
    """The pilot takes the aircraft a tenth of a second after the module has it."""
    fault = parse_fault("pilot.takes start=0.4 for=1")
    injection = Injection((fault,), 1)
    flight = fly(new_world(), place()[2], [], 2.0, injection)
    assert flight.ended.startswith("disengaged: ")
    assert 0.4 <= flight.ticks / 200 < 0.7
    assert flight["time_s"][-1] == pytest.approx((flight.ticks - 1) / 200)


def test_with_nothing_wrong_between_the_two_it_is_the_same_flight_a_beat_later() -> None:
    """The autopilot's beat comes with the first tick, so that nothing is later at all."""
    plain = fly(new_world(), place()[2], [], 0.5)
    injected = fly(new_world(), place()[2], [], 0.5, Injection((), 1))
    assert injected.ended == plain.ended == ""
    np.testing.assert_array_equal(injected["elevator"], plain["elevator"])
    np.testing.assert_array_equal(injected["x_m"], plain["x_m"])


def test_a_surface_that_is_stuck_is_stuck_in_the_world_and_not_in_the_command() -> None:
    fault = parse_fault("elevator.stuck start=0.3 for=9")
    flight = fly(new_world(), place()[2], [], 0.6, Injection((fault,), 1))
    plain = fly(new_world(), place()[2], [], 0.6)
    assert np.ptp(flight["elevator"][61:]) > 0.0
    assert flight["pitch_rad"][-1] != plain["pitch_rad"][-1]
    np.testing.assert_array_equal(flight["pitch_rad"][:61], plain["pitch_rad"][:61])
