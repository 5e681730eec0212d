"""A flight that is commanded from outside, in plain Python: at which of three points a command
comes in, what is left of it, and where such a flight ends."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isnan, nan, radians
from types import SimpleNamespace

import numpy as np
import pytest
from test_ticks_of_a_flight import UNTOUCHED, diving, empty_rows, laws_of, new_world, start

from tgl_soar.autopilot import Output
from tgl_soar.autopilot import step as autopilot_step
from tgl_soar.control.envelope import MARGIN_FULL
from tgl_soar.control.laws import Laws
from tgl_soar.control.target_line import TargetLine
from tgl_soar.sim.commanded_flight import (
    LINE,
    PITCH,
    SURFACES,
    KnownAboard,
    OutsideCommand,
    fly_given,
    fly_given_in_cells,
    given_loops,
    given_pitch,
    known_at,
)
from tgl_soar.sim.flight import CRASHED, FLIES, Flight, Row, fly_ticks, inputs_at
from tgl_soar.sim.sensor_sampling import Samples
from tgl_soar.sim.world_step import Parts
from tgl_soar.types import AirEstimate, SurfaceCommand, VehicleState

NEUTRAL = SurfaceCommand(0.0, 0.0, 0.0, 0.0)
HZ = 200


@dataclass
class Given:
    """A flight in still air that is commanded from outside."""

    parts: Parts
    laws: Laws
    flight: Flight
    rows: np.ndarray[tuple[int, int], np.dtype[np.float64]]
    known: np.ndarray[tuple[int, int], np.dtype[np.float64]]

    def fly(self, given: OutsideCommand, until: int) -> Flight:
        self.flight = fly_given(
            self.parts, self.laws, self.flight, given, until, self.rows, self.known
        )
        return self.flight

    def column(self, name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
        column: np.ndarray[tuple[int], np.dtype[np.float64]]
        column = self.rows[:, Row._fields.index(name)]
        return column

    def aboard(self) -> KnownAboard:
        return KnownAboard._make(self.known[0].tolist())


def begun(**changes: float) -> Given:
    world = new_world(0.0)
    known = np.full((1, len(KnownAboard._fields)), nan)
    return Given(
        parts=world.parts,
        laws=laws_of(world, **changes),
        flight=start(world),
        rows=empty_rows(200),
        known=known,
    )


def command(
    given: Given, kind: int, pitch: float = 0.0, surfaces: SurfaceCommand = NEUTRAL
) -> OutsideCommand:
    return OutsideCommand(kind, given.laws.target, pitch, surfaces)


def samples(given: Given) -> Samples:
    return given.flight.world.samples


def taken() -> Given:
    """Up to the tick in which the module takes the aircraft, and half a tenth of a second on."""
    given = begun()
    own = command(given, LINE)
    held = given.fly(own, 200)
    given.fly(own, held.steps + 10)
    return given


def tick(given: Given) -> tuple[Output, Flight]:
    """The module's own next tick."""
    inputs = inputs_at(given.flight.steps / HZ, given.flight.world.samples, True)
    state, output = autopilot_step(given.laws, given.flight.autopilot, inputs)
    return output, given.flight._replace(autopilot=state)


# --- by the line ----------------------------------------------------------------------------------


def test_with_its_own_line_it_is_the_modules_own_flight() -> None:
    given, other = begun(), begun()
    own = command(given, LINE)
    held = given.fly(own, 200)
    assert not held.held
    assert 40 <= held.steps < 60  # it is asked to engage at 0.2 s
    assert np.all(given.rows[held.steps :] == UNTOUCHED)
    given.fly(own, 70)
    flight = fly_ticks(other.parts, other.laws, other.flight, 70, 0, other.rows)
    np.testing.assert_array_equal(given.rows, other.rows)
    assert (given.flight.steps, given.flight.standing, given.flight.reason) == (
        flight.steps,
        FLIES,
        flight.reason,
    )
    assert given.flight.command == flight.command
    assert given.flight.world.aircraft == flight.world.aircraft
    assert given.column("time_s")[69] == pytest.approx(69 / HZ)
    assert np.all(given.column("target_changes")[:70] == 0.0)


@pytest.mark.parametrize("kind", [LINE, PITCH, SURFACES])
def test_the_line_that_is_given_is_the_one_that_distances_are_measured_from(kind: int) -> None:
    given = taken()
    own, _ = tick(given)
    there = TargetLine(given.laws.target.x_m + 0.5, 1.0, radians(90.0))
    inputs = inputs_at(own.time_s, samples(given), True)
    laws = given.laws._replace(target=there)
    state, wanted = autopilot_step(laws, given.flight.autopilot, inputs)
    given.fly(OutsideCommand(kind, there, 0.0, NEUTRAL), given.flight.steps + 1)
    aboard = given.aboard()
    assert aboard.eta_rad == wanted.line.eta_rad != own.line.eta_rad
    assert aboard.e_rho_m == wanted.line.e_rho_m
    assert given.flight.autopilot.line == state.line


# --- by the pitch ---------------------------------------------------------------------------------


def unlimited(given: Given) -> Output:
    output, _ = tick(given)
    vehicle = output.vehicle._replace(climb_mps=0.0, pitch_rad=0.05)
    return output._replace(
        vehicle=vehicle,
        margins=output.margins._replace(stall_rad=inf, clearance_m=inf),
    )


def test_a_given_pitch_is_within_the_range_of_the_parameters() -> None:
    given = begun(PITCH_MIN=-20.0, PITCH_MAX=15.0)
    output = unlimited(given)
    for asked_deg, left_deg in ((-21.0, -20.0), (-19.0, -19.0), (14.0, 14.0), (16.0, 15.0)):
        left = given_pitch(given.laws, output, nan, radians(asked_deg))
        assert left == pytest.approx(radians(left_deg))


def test_a_given_pitch_comes_up_no_further_than_the_stall_leaves_it() -> None:
    given = begun(PITCH_MIN=-20.0, PITCH_MAX=15.0)
    laws = given.laws._replace(envelope=given.laws.envelope._replace(glide_pitch_rad=-0.1))
    output = unlimited(given)
    for margin, left in ((0.03, 0.08), (0.04, 0.09), (1.1 * MARGIN_FULL, 0.2)):
        close = output._replace(margins=output.margins._replace(stall_rad=margin))
        assert given_pitch(laws, close, nan, 0.2) == pytest.approx(left)


def test_a_given_pitch_dives_no_deeper_than_the_glide_or_what_holds_the_line() -> None:
    """Sinking faster than is allowed, or near the ground on the way down."""
    given = begun(PITCH_MIN=-20.0, PITCH_MAX=15.0)
    limits = given.laws.envelope._replace(
        glide_pitch_rad=-0.05, sink_max_mps=2.0, clearance_min_m=0.5
    )
    laws = given.laws._replace(envelope=limits)
    output = unlimited(given)
    for climb, clearance, holding, left in (
        (-1.9, inf, 0.0, -0.3),
        (-2.1, inf, 0.0, -0.05),
        (-2.1, inf, -0.12, -0.12),
        (-0.5, 0.9, 0.0, -0.05),  # at the least clearance within a second
        (-0.5, 1.1, 0.0, -0.3),
        (0.1, 0.4, 0.0, -0.3),
    ):
        low = output._replace(
            vehicle=output.vehicle._replace(climb_mps=climb),
            margins=output.margins._replace(clearance_m=clearance),
        )
        assert given_pitch(laws, low, holding, -0.3) == pytest.approx(left)


def test_with_the_pitch_that_the_module_asks_for_the_loops_are_the_modules_own() -> None:
    given = taken()
    for _ in range(3):
        output, after = tick(given)
        asked = output.setpoints.pitch_rad
        memory, inputs = after.autopilot.memory, inputs_at(output.time_s, samples(given), True)
        loops, followed = given_loops(
            given.laws,
            command(given, PITCH, asked),
            given.flight.autopilot.loops,
            memory,
            inputs,
            output,
            1.0 / HZ,
        )
        assert followed == output.setpoints
        own = after.autopilot.loops
        assert loops.limited.command == pytest.approx(output.command, abs=1e-12)
        assert loops.pitch == pytest.approx(own.pitch, abs=1e-12)
        assert loops.roll == pytest.approx(own.roll, abs=1e-12)
        assert loops.heading == pytest.approx(own.heading, abs=1e-12)
        given.fly(command(given, LINE), given.flight.steps + 1)


def test_a_given_pitch_is_flown_and_logged_in_the_place_of_the_modules_own() -> None:
    given = taken()
    begin = given.flight.steps
    given.fly(command(given, PITCH, radians(4.0)), begin + 120)
    asked = given.column("pitch_setpoint_rad")[begin : begin + 120]
    assert asked == pytest.approx(radians(4.0))
    pitch = given.column("pitch_rad")
    off = np.abs(pitch - radians(4.0))
    assert off[begin + 119] < 0.3 * off[begin]
    assert given.column("elevator")[begin + 119] == given.aboard().elevator
    assert np.all(given.column("brake")[begin : begin + 120] == 0.0)


def test_the_loops_go_on_from_a_given_pitch() -> None:
    """What the loops keep of one tick is what the next begins with."""
    given = taken()
    given.fly(command(given, PITCH, radians(6.0)), given.flight.steps + 1)
    loops = given.flight.autopilot.loops
    assert loops.pitch_setpoint_rad == pytest.approx(radians(6.0))
    assert loops.limited.command == given.flight.command


# --- by the surfaces ------------------------------------------------------------------------------


def test_surfaces_go_where_commanded_at_the_rate_that_they_may() -> None:
    given = taken()
    limits = given.laws.envelope
    step = limits.rate_max_per_s / HZ
    before = given.flight.command
    wanted = SurfaceCommand(-0.45, 0.5, -0.55, 1.0)  # the brake stays where it is
    begin, ticks = given.flight.steps, 12
    given.fly(command(given, SURFACES, surfaces=wanted), begin + ticks)
    for n in range(ticks):
        left = max(wanted.elevator, before.elevator - (n + 1) * step)
        assert given.column("elevator")[begin + n] == pytest.approx(left)
    aboard = given.aboard()
    for was, end, now in zip(
        before[:3], wanted[:3], (aboard.elevator, aboard.aileron, aboard.rudder), strict=True
    ):
        moved = np.sign(end - was) * min(abs(end - was), ticks * step)
        assert now == pytest.approx(was + moved)
    assert given.flight.command[:3] == (aboard.elevator, aboard.aileron, aboard.rudder)
    assert np.all(np.isnan(given.column("pitch_setpoint_rad")[begin : begin + ticks]))
    assert given.flight.world.elevator.deflection < before.elevator


def test_surfaces_go_no_further_than_their_travel() -> None:
    given = taken()
    travel = given.laws.envelope.deflection_max
    given.fly(command(given, SURFACES, surfaces=SurfaceCommand(3.0, 0.0, 0.0, 0.0)), 150)
    assert given.aboard().elevator <= travel
    output, after = tick(given)
    for wanted, left in ((1.5, travel), (0.5 * travel, 0.5 * travel), (-1.5, -travel)):
        given.laws = given.laws._replace(envelope=given.laws.envelope._replace(rate_max_per_s=1e4))
        loops, setpoints = given_loops(
            given.laws,
            command(given, SURFACES, surfaces=SurfaceCommand(wanted, 0.0, 0.0, 0.0)),
            given.flight.autopilot.loops,
            after.autopilot.memory,
            inputs_at(output.time_s, samples(given), True),
            output,
            1.0 / HZ,
        )
        assert loops.limited.command.elevator == left
        assert loops.limited.finite
        assert all(map(isnan, setpoints))


def test_the_tick_in_which_the_module_takes_the_aircraft_is_its_own() -> None:
    given = begun()
    away = command(given, SURFACES, surfaces=SurfaceCommand(-0.9, 0.9, 0.9, 0.0))
    held = given.fly(away, 200)
    assert not held.held
    other = begun()
    fly_ticks(other.parts, other.laws, other.flight, held.steps, 0, other.rows)
    np.testing.assert_array_equal(given.rows, other.rows)


# --- where it ends --------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [LINE, PITCH, SURFACES])
def test_it_ends_where_it_is_to_or_where_the_aircraft_crashes(kind: int) -> None:
    given = taken()
    there = given.flight.steps
    assert given.fly(command(given, kind), there) == given.flight
    assert given.flight.steps == there
    given.fly(command(given, kind), there + 2)
    assert given.flight.steps == there + 2
    assert np.all(given.rows[there + 2 :] == UNTOUCHED)
    given.flight = diving(given.flight)
    given.fly(command(given, kind), 200)
    assert (given.flight.steps, given.flight.standing) == (there + 3, CRASHED)
    given.fly(command(given, kind), 200)
    assert given.flight.steps == there + 3


def test_cells_keep_the_flight_and_say_how_it_stands() -> None:
    given, other = begun(), begun()
    cell = SimpleNamespace(value=given.flight)
    standing = fly_given_in_cells(
        SimpleNamespace(value=given.parts),
        SimpleNamespace(value=given.laws),
        cell,
        command(given, LINE),
        30,
        given.rows,
        given.known,
    )
    other.fly(command(other, LINE), 30)
    assert standing == (30, FLIES, other.flight.reason, True)
    assert cell.value.world.aircraft == other.flight.world.aircraft
    np.testing.assert_array_equal(given.rows, other.rows)
    np.testing.assert_array_equal(given.known, other.known)


# --- what is known aboard -------------------------------------------------------------------------


def test_what_is_known_aboard_is_of_the_last_tick_with_the_command_that_was_let_through() -> None:
    given = taken()
    given.fly(command(given, SURFACES, surfaces=SurfaceCommand(0.2, 0.1, -0.1, 0.0)), 80)
    aboard, row = given.aboard(), Row._make(given.rows[79].tolist())
    assert (aboard.elevator, aboard.mode) == (row.elevator, row.mode)
    assert (aboard.airspeed_mps, aboard.wind_mps) == (row.air_airspeed_mps, row.air_wind_mps)
    assert aboard.updraft_mps == row.air_updraft_mps
    assert aboard.x_m == pytest.approx(row.x_m, abs=0.3)
    assert aboard.z_m == pytest.approx(row.z_m, abs=0.3)
    assert aboard.pitch_rad == pytest.approx(row.pitch_rad, abs=0.05)


def test_each_number_that_is_known_aboard_is_the_output_s_of_that_name() -> None:
    output, _ = tick(taken())
    vehicle = VehicleState._make(float(i) for i in range(len(VehicleState._fields)))
    line = output.line._replace(e_rho_m=101.0, e_rho_rate_mps=102.0, eta_rad=103.0)
    air = AirEstimate._make(200.0 + i for i in range(len(AirEstimate._fields)))
    margins = output.margins._replace(stall_rad=301.0, clearance_m=302.0)
    output = output._replace(
        vehicle=vehicle,
        line=line,
        air=air,
        margins=margins,
        command=SurfaceCommand(401.0, 402.0, 403.0, 404.0),
        mode=5,
    )
    known = known_at(output)
    assert (known.e_rho_m, known.e_rho_rate_mps, known.eta_rad) == (101.0, 102.0, 103.0)
    for part in (vehicle, air, margins, output.command):
        for name in set(part._fields) & set(KnownAboard._fields):
            assert getattr(known, name) == getattr(part, name)
    assert known.mode == 5.0
    assert not any(map(isnan, known))
