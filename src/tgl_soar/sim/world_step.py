"""One step of the world: servos, turbulence, propeller, aircraft, tether, ground, then sensors.

Plain Python runs these functions as they are (`sim.world`), numba compiles them
(`sim.compiled_flight`): a flight is the same to the last bits of sines and logarithms.  Three
things come in as parts of the world:

    the aircraft   any that has a `FlownAircraft`'s methods
    the air        any wind field (`FieldAir`); compiled, the kinds that are data (`KnownAir`)
    randomness     rows of white noise (`sim.white_noise`), drawn when needed; compiled, beforehand

At step n (time n dt) the sensors measure the aircraft as it is at that instant, and the command
of a step acts from step n to n + 1.  An aircraft that touches ground or board, or leaves the air
that the field describes, has crashed: it rests where it is.
"""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

from tgl_soar.air.field import WindField
from tgl_soar.air.gusts import (
    DrydenParams,
    DrydenState,
    RollGustParams,
    dryden_step,
    roll_gust_step,
)
from tgl_soar.geometry import SoaringFrame
from tgl_soar.sim.aircraft import AircraftState, Wind, place_ahead
from tgl_soar.sim.flown_aircraft import FlownAircraft
from tgl_soar.sim.sensor_sampling import FlownSensors, Samples, sense
from tgl_soar.sim.servos import ServoParams, ServoState, servo_step
from tgl_soar.sim.tether import NO_PULL, TetherParams, pulled, tether_pull
from tgl_soar.sim.white_noise import Rows
from tgl_soar.types import SurfaceCommand


class FlownAir(Protocol):
    """The air of one flight, turbulence apart."""

    def wind_at(self, n: int, x_m: float, y_m: float, z_m: float) -> Wind:
        """Wind (u, v, w) [m/s] at a place at step n."""

    def flyable(self, n: int, x_m: float, y_m: float, z_m: float) -> bool:
        """Whether a place lies in the world, and in the air that the field describes."""


class FieldAir:
    """Any wind field as the air of a flight."""

    def __init__(self, field: WindField, dt_s: float, half_width_m: float) -> None:
        self._field, self._dt_s, self._half_width_m = field, dt_s, half_width_m

    def wind_at(self, n: int, x_m: float, y_m: float, z_m: float) -> Wind:
        """Wind (u, v, w) [m/s] at a place at step n."""
        return self._field.wind_at(x_m, y_m, z_m, n * self._dt_s)

    def flyable(self, n: int, x_m: float, y_m: float, z_m: float) -> bool:  # noqa: ARG002
        """Whether a place lies in the world, and in the air that the field describes."""
        return self._field.inside(x_m, y_m, z_m) and not abs(y_m) > self._half_width_m


class FlownTurbulence(NamedTuple):
    """The turbulence of one flight."""

    blows: bool
    params: DrydenParams
    white: Rows  # of every step: three numbers
    rolls: RollGustParams
    rolling: Rows  # of every step after the first: one number


class Parts(NamedTuple):
    """All that one flight happens in."""

    step_hz: int
    model: FlownAircraft
    servo: ServoParams
    frame: SoaringFrame
    air: FlownAir
    turbulence: FlownTurbulence
    sensors: FlownSensors  # their delay lines are written to at every step
    tether: TetherParams


class WorldNow(NamedTuple):
    """The world at one step."""

    aircraft: AircraftState
    elevator: ServoState
    aileron: ServoState
    rudder: ServoState
    brake: ServoState
    throttle: float  # that a propeller is commanded, 0 … 1
    turbulence: DrydenState
    gust_mps: Wind  # the turbulence's own
    roll_gust_radps: float
    wind: Wind  # at the aircraft
    crashed: bool
    samples: Samples  # the newest that have arrived


class Cell(Protocol):
    """Something that keeps a value of one type between calls, as `compiled.cell`."""

    value: Any


def local_wind(parts: Parts, gust_mps: Wind, n: int, x_m: float, y_m: float, z_m: float) -> Wind:
    """Wind (u, v, w) [m/s] at a place at step n, turbulence [m/s] included."""
    u, v, w = parts.air.wind_at(n, x_m, y_m, z_m)
    return u + gust_mps[0], v + gust_mps[1], w + gust_mps[2]


def world_begun(parts: Parts, now: WorldNow, command: SurfaceCommand) -> WorldNow:
    """The world at step 0: its first turbulence and samples, of an aircraft that is set."""
    turbulence, gust = now.turbulence, (0.0, 0.0, 0.0)
    if parts.turbulence.blows:
        white = parts.turbulence.white[0]
        turbulence, gust = dryden_step(
            parts.turbulence.params, turbulence, white[0], white[1], white[2]
        )
    aircraft = now.aircraft
    wind = local_wind(parts, gust, 0, aircraft.x_m, aircraft.y_m, aircraft.z_m)
    pull = tether_pull(parts.tether, aircraft)
    samples = sense(
        parts.sensors,
        parts.frame,
        parts.model,
        aircraft,
        wind=wind,
        command=command,
        rests=False,
        step=0,
        pull_mps2=pull,
    )
    return now._replace(turbulence=turbulence, gust_mps=gust, wind=wind, samples=samples)


def world_step(
    parts: Parts, now: WorldNow, n: int, command: SurfaceCommand, held: bool
) -> WorldNow:
    """The world at step n, from the one before and the command since.

    held: something keeps the aircraft where it is.
    """
    dt, servo = 1.0 / parts.step_hz, parts.servo
    elevator = servo_step(servo, now.elevator, command.elevator, dt)
    aileron = servo_step(servo, now.aileron, command.aileron, dt)
    rudder = servo_step(servo, now.rudder, command.rudder, dt)
    brake = servo_step(servo, now.brake, command.brake, dt)
    surfaces = SurfaceCommand(
        elevator.deflection, aileron.deflection, rudder.deflection, brake.deflection
    )
    turbulence, gust = now.turbulence, (0.0, 0.0, 0.0)
    roll_gust = now.roll_gust_radps
    if parts.turbulence.blows:
        white = parts.turbulence.white[n]
        turbulence, gust = dryden_step(
            parts.turbulence.params, turbulence, white[0], white[1], white[2]
        )
        rolled = parts.turbulence.rolling[n - 1]
        roll_gust = roll_gust_step(parts.turbulence.rolls, roll_gust, rolled[0])
    aircraft, crashed, pull = now.aircraft, now.crashed, NO_PULL
    if held or crashed:
        aircraft = aircraft._replace(
            elevator=surfaces.elevator,
            aileron=surfaces.aileron,
            rudder=surfaces.rudder,
            brake=surfaces.brake,
        )
    else:
        turns = parts.model.spun(aircraft.throttle, now.throttle, dt)
        aircraft = aircraft._replace(throttle=turns)
        x, y, z = place_ahead(aircraft, dt)
        ahead = local_wind(parts, gust, n, x, y, z)
        aircraft = parts.model.step(
            aircraft, surfaces, now.wind, ahead, now.roll_gust_radps, roll_gust, dt
        )
        if parts.tether.is_there:
            pull = tether_pull(parts.tether, aircraft)
            aircraft = pulled(aircraft, pull, dt)
        if not parts.air.flyable(n, aircraft.x_m, aircraft.y_m, aircraft.z_m):
            crashed = True
            aircraft = at_rest(aircraft)
    wind = local_wind(parts, gust, n, aircraft.x_m, aircraft.y_m, aircraft.z_m)
    samples = sense(
        parts.sensors,
        parts.frame,
        parts.model,
        aircraft,
        wind=wind,
        command=command,
        rests=held or crashed,
        step=n,
        pull_mps2=pull,
    )
    return WorldNow(
        aircraft=aircraft,
        elevator=elevator,
        aileron=aileron,
        rudder=rudder,
        brake=brake,
        throttle=now.throttle,
        turbulence=turbulence,
        gust_mps=gust,
        roll_gust_radps=roll_gust,
        wind=wind,
        crashed=crashed,
        samples=samples,
    )


def world_step_in_cells(
    parts_cell: Cell, now_cell: Cell, n: int, command: SurfaceCommand, held: bool
) -> WorldNow:
    """`world_step`, compiled, for a caller in plain Python: what is in a cell is not converted."""
    parts: Parts = parts_cell.value
    now: WorldNow = now_cell.value
    now = world_step(parts, now, n, command, held)
    now_cell.value = now
    return now


def at_rest(state: AircraftState) -> AircraftState:
    """The aircraft where it is, without any motion."""
    return state._replace(
        velocity_x_mps=0.0,
        velocity_y_mps=0.0,
        velocity_z_mps=0.0,
        roll_rate_frd_radps=0.0,
        pitch_rate_frd_radps=0.0,
        yaw_rate_frd_radps=0.0,
    )
