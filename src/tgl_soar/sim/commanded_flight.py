"""A flight in which somebody else commands, as a pure function: what `tgl_soar.gym` steps.

The module's tick runs as ever: it estimates, guards the aircraft, and hands over where it would.
A given command takes the place of its own at one of three points of the cascade:

    LINE       the target line: the module slides the line there and holds the aircraft on it
    PITCH      the pitch setpoint, within the parameters' range and what the stall and the ground
               leave of it; the module's own attitude loops fly it, wings level, upwind
    SURFACES   the deflections of elevator, aileron and rudder, within travel and rate

The limiter before the servos is the module's own in each case, and what it lets through is what the
estimators and the next tick take as commanded.  A brake stays retracted under PITCH and SURFACES.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar.air.field import FloatArray
from tgl_soar.autopilot import Output
from tgl_soar.autopilot import step as autopilot_step
from tgl_soar.control.envelope import limit_surfaces, pitch_within
from tgl_soar.control.estimates import EstimatorMemory
from tgl_soar.control.laws import Laws
from tgl_soar.control.point_hold import BrakeEffect
from tgl_soar.control.surface_loops import LoopsState, surface_gains, surfaces_step
from tgl_soar.control.target_line import TargetLine
from tgl_soar.sim.flight import FLIES, Flight, acted_on, inputs_at, row_of
from tgl_soar.sim.world_step import Cell, Parts
from tgl_soar.types import NO_SETPOINTS, Inputs, Setpoints, SurfaceCommand

LINE: Final = 0
PITCH: Final = 1
SURFACES: Final = 2


class OutsideCommand(NamedTuple):
    """What is commanded from outside until the next command."""

    kind: int  # LINE, PITCH or SURFACES
    target: TargetLine  # of LINE to be flown; of the others what e_rho is measured from
    pitch_rad: float
    surfaces: SurfaceCommand


class KnownAboard(NamedTuple):
    """What is known aboard at a tick: estimates in the soaring frame; NaN: not known."""

    x_m: float
    y_m: float
    z_m: float
    velocity_x_mps: float
    velocity_y_mps: float
    climb_mps: float
    roll_rad: float
    pitch_rad: float
    heading_rad: float
    roll_rate_radps: float
    pitch_rate_radps: float
    heading_rate_radps: float
    e_rho_m: float
    e_rho_rate_mps: float
    eta_rad: float  # of the line that is flown
    airspeed_mps: float
    alpha_rad: float
    wind_mps: float
    updraft_mps: float
    excess_mps: float
    stall_rad: float  # margins; inf: not known
    clearance_m: float
    elevator: float  # commanded, as the limiter let it through
    aileron: float
    rudder: float
    mode: float


class Standing(NamedTuple):
    """How a flight stands after some ticks."""

    steps: int
    standing: int  # FLIES, CRASHED or HANDED_OVER
    reason: int  # of the last tick
    held: bool  # nobody flies it yet


def known_at(output: Output) -> KnownAboard:
    """After a tick."""
    vehicle, line, air, margins = output.vehicle, output.line, output.air, output.margins
    command = output.command
    return KnownAboard(
        x_m=vehicle.x_m,
        y_m=vehicle.y_m,
        z_m=vehicle.z_m,
        velocity_x_mps=vehicle.velocity_x_mps,
        velocity_y_mps=vehicle.velocity_y_mps,
        climb_mps=vehicle.climb_mps,
        roll_rad=vehicle.roll_rad,
        pitch_rad=vehicle.pitch_rad,
        heading_rad=vehicle.heading_rad,
        roll_rate_radps=vehicle.roll_rate_radps,
        pitch_rate_radps=vehicle.pitch_rate_radps,
        heading_rate_radps=vehicle.heading_rate_radps,
        e_rho_m=line.e_rho_m,
        e_rho_rate_mps=line.e_rho_rate_mps,
        eta_rad=line.eta_rad,
        airspeed_mps=air.airspeed_mps,
        alpha_rad=air.alpha_rad,
        wind_mps=air.wind_mps,
        updraft_mps=air.updraft_mps,
        excess_mps=air.excess_mps,
        stall_rad=margins.stall_rad,
        clearance_m=margins.clearance_m,
        elevator=command.elevator,
        aileron=command.aileron,
        rudder=command.rudder,
        mode=float(output.mode),
    )


def given_pitch(laws: Laws, output: Output, theta_0_rad: float, pitch_rad: float) -> float:
    """A pitch setpoint within range and envelope; theta_0_rad: of the undisturbed glide."""
    limits, margins = laws.soaring.pid, output.margins
    return pitch_within(
        laws.envelope,
        max(limits.output_min, min(limits.output_max, pitch_rad)),
        output.vehicle.pitch_rad,
        margins.stall_rad,
        output.vehicle.climb_mps,
        margins.clearance_m,
        theta_0_rad,
        0.0,
    )


def given_loops(
    laws: Laws,
    given: OutsideCommand,
    before: LoopsState,
    memory: EstimatorMemory,
    inputs: Inputs,
    output: Output,
    dt_s: float,
) -> tuple[LoopsState, Setpoints]:
    """The loops after a tick in which the given command took the place of the module's, and what
    they followed.

    before: as the tick found them; memory, output: as it left them.
    """
    if given.kind == SURFACES:
        wanted, travel = given.surfaces, laws.envelope.deflection_max
        limited = limit_surfaces(
            laws.envelope, before.limited.command, wanted, travel, 1.0, True, dt_s
        )
        return before._replace(limited=limited), NO_SETPOINTS
    pitch = given_pitch(laws, output, memory.pitch_trim.pitch_rad, given.pitch_rad)
    setpoints = output.setpoints._replace(pitch_rad=pitch)
    loops, _ = surfaces_step(
        laws,
        surface_gains(laws, memory.imu_weight, memory.gain_speed_mps, memory.gain_age_s),
        before,
        output.vehicle,
        setpoints=setpoints,
        brake=0.0,
        brake_max=1.0,
        braked=BrakeEffect(0.0, 0.0),
        stall_rad=output.margins.stall_rad,
        surfaces=inputs.surfaces,
        flies=True,
        dt_s=dt_s,
    )
    return loops, setpoints


def fly_given(
    parts: Parts,
    laws: Laws,
    flight: Flight,
    given: OutsideCommand,
    until_step: int,
    rows: FloatArray,
    known: FloatArray,
) -> Flight:
    """Fly on to a step under a given command, or until the module hands over or the aircraft
    crashes; a flight that nobody flies yet ends as soon as the module does.

    `rows[n]`, a `Row`, is filled for the tick at step n, and `known[0]`, a `KnownAboard`, at each.
    """
    n, standing, reason = flight.steps, flight.standing, flight.reason
    world, autopilot = flight.world, flight.autopilot
    command, held = flight.command, flight.held
    begins_held = held
    dt = 1.0 / parts.step_hz
    laws = laws._replace(target=given.target)
    while n < until_step and standing == FLIES and held == begins_held:
        now = n * dt
        inputs, before = inputs_at(now, world.samples, True), autopilot.loops
        autopilot, output = autopilot_step(laws, autopilot, inputs)
        reason = output.reason
        # The tick in which the module engages sets its loops up: it is the module's own.
        if output.active and given.kind != LINE and not held:
            loops, setpoints = given_loops(
                laws, given, before, autopilot.memory, inputs, output, dt
            )
            autopilot = autopilot._replace(loops=loops)
            output = output._replace(command=loops.limited.command, setpoints=setpoints)
        rows[n] = row_of(now, world.aircraft, world.wind, output, 0)
        known[0] = known_at(output)
        n += 1
        world, command, held, standing = acted_on(parts, world, n, command, held, output)
    return Flight(
        steps=n,
        standing=standing,
        reason=reason,
        world=world,
        command=command,
        held=held,
        autopilot=autopilot,
    )


def fly_given_in_cells(
    parts_cell: Cell,
    laws_cell: Cell,
    flight_cell: Cell,
    given: OutsideCommand,
    until_step: int,
    rows: FloatArray,
    known: FloatArray,
) -> Standing:
    """`fly_given`, compiled, for a caller in plain Python."""
    parts: Parts = parts_cell.value
    laws: Laws = laws_cell.value
    flight: Flight = flight_cell.value
    flight = fly_given(parts, laws, flight, given, until_step, rows, known)
    flight_cell.value = flight
    return Standing(flight.steps, flight.standing, flight.reason, flight.held)
