"""One flight as a pure function: the module's tick and the world's step, from tick to tick.

What `sim.closed_loop` does with a world that others may take a hand in is done here with named
tuples alone, so that numba compiles it: the same tick, the same step, in the same order.
tests/sim/test_compiled.py compares the one with the other.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar.air.field import FloatArray
from tgl_soar.autopilot import AutopilotState, Output
from tgl_soar.autopilot import step as autopilot_step
from tgl_soar.control.laws import Laws
from tgl_soar.control.point_hold import PointReport
from tgl_soar.control.supervisor import FAILED, RELEASED
from tgl_soar.control.target_line import e_rho
from tgl_soar.control.throttle import ThrottleReport
from tgl_soar.estimation.ground_range import GroundRange
from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.sim.aircraft import AircraftState, Wind, air_data
from tgl_soar.sim.sensor_sampling import Samples
from tgl_soar.sim.world_step import Cell, Parts, WorldNow, world_step
from tgl_soar.types import AutopilotStatus, Inputs, SurfaceCommand

HELD_S: Final = 0.2  # the aircraft is held until the sensors have spoken and the module has it

FLIES: Final = 0  # how a flight stands
CRASHED: Final = 1
HANDED_OVER: Final = 2


class Row(NamedTuple):
    """One tick of a flight: the truth, and what the module made of it."""

    time_s: float
    x_m: float
    y_m: float
    z_m: float
    e_rho_m: float  # true distance from the line that is flown
    line_moving: float  # 1 or 0
    target_changes: float  # how many changes of parameters so far
    pitch_rad: float
    pitch_setpoint_rad: float
    roll_rad: float
    heading_rad: float
    elevator: float  # commanded
    airspeed_mps: float
    alpha_rad: float
    wind_mps: float
    updraft_mps: float
    air_airspeed_mps: float  # from here on what the module takes them to be: types.AirEstimate
    air_alpha_rad: float
    air_wind_mps: float
    air_updraft_mps: float
    air_excess_mps: float
    air_wind_sigma_mps: float
    air_updraft_sigma_mps: float
    injected_rad: float  # into the pitch setpoint, which has it in it
    mode: float
    reason: float  # of a change of mode in this tick, else REASON_NONE
    forecast: float  # how it stands, as control.forecast numbers it
    forecast_x_m: float
    forecast_z_m: float
    forecast_sigma_m: float
    forecast_ahead_s: float
    forecast_chance: float
    forecast_excess_mps: float
    forecast_slope_per_s: float
    brake: float  # commanded, 0 … 1
    point: float  # how it stands, as control.point_hold numbers it
    point_off_m: float  # along the line, as the law sees it; NaN: no point is held
    height_left_m: float  # that the glide to the landing place would leave; NaN: not known
    throttle: float  # that a propeller is commanded, 0 … 1


class Flight(NamedTuple):
    """Where a flight stands between two ticks."""

    steps: int
    standing: int  # FLIES, CRASHED or HANDED_OVER
    reason: int  # of the last tick
    world: WorldNow
    command: SurfaceCommand
    held: bool
    autopilot: AutopilotState


class LoopDecision(NamedTuple):
    """What the closed loop needs of an `Output`."""

    mode: int
    reason: int
    active: bool
    command: SurfaceCommand
    point: PointReport
    throttle: ThrottleReport
    ground_range: GroundRange


def inputs_at(now_s: float, samples: Samples, engage: bool) -> Inputs:
    """The module's inputs beside an autopilot that obeys."""
    return Inputs(
        time_s=now_s,
        position=samples.position,
        attitude=samples.attitude,
        autopilot=AutopilotStatus(
            time_s=now_s, accepts_surfaces=True, armed=True, failsafe=False, boots=0
        ),
        engage=engage and now_s >= HELD_S,
        imu=samples.imu,
        airspeed=samples.airspeed,
        surfaces=samples.surfaces,
        rangefinder=samples.rangefinder,
    )


def row_of(
    now_s: float, aircraft: AircraftState, wind: Wind, output: Output, target_changes: int
) -> Row:
    """The row of a tick: the truth before it, and what came of it."""
    roll, pitch, heading = euler_from_quaternion(aircraft.qw, aircraft.qx, aircraft.qy, aircraft.qz)
    met, estimated = air_data(aircraft, wind), output.air
    foreseen = output.forecast
    # Apart, as numba takes no choice within a call of many keywords.
    line_moving = 1.0 if output.line.moving or not output.active else 0.0
    return Row(
        time_s=now_s,
        x_m=aircraft.x_m,
        y_m=aircraft.y_m,
        z_m=aircraft.z_m,
        e_rho_m=e_rho(
            output.line.x_m, output.line.z_m, output.line.eta_rad, aircraft.x_m, aircraft.z_m
        ),
        line_moving=line_moving,
        target_changes=float(target_changes),
        pitch_rad=pitch,
        pitch_setpoint_rad=output.setpoints.pitch_rad,
        roll_rad=roll,
        heading_rad=heading,
        elevator=output.command.elevator,
        airspeed_mps=met.airspeed_mps,
        alpha_rad=met.alpha_rad,
        wind_mps=wind[0],
        updraft_mps=wind[2],
        air_airspeed_mps=estimated.airspeed_mps,
        air_alpha_rad=estimated.alpha_rad,
        air_wind_mps=estimated.wind_mps,
        air_updraft_mps=estimated.updraft_mps,
        air_excess_mps=estimated.excess_mps,
        air_wind_sigma_mps=estimated.wind_sigma_mps,
        air_updraft_sigma_mps=estimated.updraft_sigma_mps,
        injected_rad=output.excitation.pitch_rad,
        mode=float(output.mode),
        reason=float(output.reason),
        forecast=float(foreseen.standing),
        forecast_x_m=foreseen.x_m,
        forecast_z_m=foreseen.z_m,
        forecast_sigma_m=foreseen.sigma_m,
        forecast_ahead_s=foreseen.ahead_s,
        forecast_chance=foreseen.chance,
        forecast_excess_mps=foreseen.excess_mps,
        forecast_slope_per_s=foreseen.slope_per_s,
        brake=output.command.brake,
        point=float(output.point.standing),
        point_off_m=output.point.off_m,
        height_left_m=output.launch_landing.height_left_m,
        throttle=output.throttle.fraction,
    )


def acted_on(
    parts: Parts,
    world: WorldNow,
    n: int,
    command: SurfaceCommand,
    held: bool,
    output: Output,
) -> tuple[WorldNow, SurfaceCommand, bool, int]:
    """What follows a tick: the world at step n, the command and whether something holds the
    aircraft still, both as they were before, and how the flight stands then.

    Every compiled flight goes on so.  `closed_loop.ClosedLoop.tick` has this order once more, as
    faults in plain Python come between the command and the world there; tests/sim/test_compiled.py
    holds the two to each other.
    """
    if output.active:
        command = output.command
        held = False
    world = world._replace(throttle=output.throttle.fraction)
    world = world_step(parts, world, n, command, held)
    standing = FLIES
    if world.crashed:
        standing = CRASHED
    elif output.mode in (RELEASED, FAILED):
        standing = HANDED_OVER
    return world, command, held, standing


def fly_ticks(
    parts: Parts,
    laws: Laws,
    flight: Flight,
    until_step: int,
    target_changes: int,
    rows: FloatArray,
) -> Flight:
    """Fly on to a step, or until the module hands over or the aircraft crashes.

    As `sim.closed_loop.fly`; `rows[n]`, a `Row`, is filled for the tick at step n.
    """
    n, standing, reason = flight.steps, flight.standing, flight.reason
    world, autopilot = flight.world, flight.autopilot
    command, held = flight.command, flight.held
    dt = 1.0 / parts.step_hz
    while n < until_step and standing == FLIES:
        now = n * dt
        autopilot, output = autopilot_step(laws, autopilot, inputs_at(now, world.samples, True))
        reason = output.reason
        rows[n] = row_of(now, world.aircraft, world.wind, output, target_changes)
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


def fly_to_look(
    parts: Parts,
    laws: Laws,
    flight: Flight,
    until_step: int,
    target_changes: int,
    rows: FloatArray,
) -> tuple[Flight, Output]:
    """`fly_ticks`, and what the module would report in the tick that is due then: a tick is pure,
    and this one is forgotten."""
    flight = fly_ticks(parts, laws, flight, until_step, target_changes, rows)
    now = flight.steps * (1.0 / parts.step_hz)
    inputs = inputs_at(now, flight.world.samples, True)
    _, output = autopilot_step(laws, flight.autopilot, inputs)
    return flight, output


def decide_in_cells(laws_cell: Cell, state_cell: Cell, inputs: Inputs) -> LoopDecision:
    """The module's tick, compiled, for a caller in plain Python."""
    state: AutopilotState = state_cell.value
    laws: Laws = laws_cell.value
    state, output = autopilot_step(laws, state, inputs)
    state_cell.value = state
    return LoopDecision(
        mode=output.mode,
        reason=output.reason,
        active=output.active,
        command=output.command,
        point=output.point,
        throttle=output.throttle,
        ground_range=output.ground_range,
    )
