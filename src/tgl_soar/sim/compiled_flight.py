"""Flights in a world that numba compiles: the same step (`sim.world_step`), the same tick.

The world's field is taken apart into data (`sim.compiled_air`), and its randomness is drawn before
the flight from the very streams that a plain flight draws from, for any seed.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import floor, inf
from typing import Any, NamedTuple, cast

import numpy as np

from tgl_soar.air.field import FloatArray
from tgl_soar.air.gusts import DRYDEN_STILL
from tgl_soar.autopilot import Output, initial_state, reason_text
from tgl_soar.autopilot import step as autopilot_step
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.sim.aircraft import AircraftState
from tgl_soar.sim.closed_loop import Change, ClosedLoop, Trajectory
from tgl_soar.sim.compiled import cell, compiled
from tgl_soar.sim.compiled_air import KnownAir, known_air
from tgl_soar.sim.flight import (
    CRASHED,
    FLIES,
    HANDED_OVER,
    Flight,
    Row,
    decide_in_cells,
    fly_ticks,
)
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.sensor_sampling import FlownSensors, flown_sensors
from tgl_soar.sim.white_noise import (
    NO_ROWS,
    Rows,
    drawn_before,
    roll_gusts_before,
    turbulence_before,
)
from tgl_soar.sim.world import World
from tgl_soar.sim.world_step import Parts, WorldNow, world_begun, world_step_in_cells
from tgl_soar.types import Inputs, SurfaceCommand


class Prepared(NamedTuple):
    """A world ready for compiled flights of up to some duration, with any seed."""

    world: World  # as it was made; its own seed plays no part
    air: KnownAir
    ticks: int
    kernel: list[Any]  # that flies in it, found once: numba takes 1 ms to look at all types


def prepare(world: World, duration_s: float) -> Prepared:
    """Take a newly made world apart for flights of `duration_s` [s].

    Errors: `UnknownFieldError`; ValueError for a world that has already been stepped.
    """
    if world.steps:
        raise ValueError(f"world at step {world.steps}: a flight starts from a new one")
    ticks = round(duration_s * world.step_hz)
    times: FloatArray = np.arange(ticks + 1, dtype=np.float64) * (1.0 / world.step_hz)
    half_width_m = inf if world.bounds is None else world.bounds.half_width_m
    return Prepared(world, known_air(world.field, times, half_width_m), ticks, [])


def fly_compiled(
    prepared: Prepared, seed: int, values: ParameterSet, changes: Sequence[Change]
) -> Trajectory:
    """The flight that `closed_loop.fly` would make in a world of this seed, compiled."""
    world, ticks = prepared.world, prepared.ticks
    parts, flight = begun(prepared, seed)
    rows = np.empty((ticks, len(Row._fields)))
    pending = sorted(changes, key=lambda change: change.time_s)
    dt = 1.0 / world.step_hz
    until_steps = [_first_step(change.time_s, dt) for change in pending]
    for done, until in enumerate([*until_steps, ticks]):
        if flight.standing != FLIES or flight.steps >= ticks:
            break
        if done > 0:
            values = values.changed(pending[done - 1].parameters, flying=True)
        if until > flight.steps:
            laws = laws_from(values, world.frame, world.aerodynamics, world.ground)
            arguments = parts, laws, flight, min(until, ticks), done, rows
            if not prepared.kernel:
                prepared.kernel.append(_kernel_for(arguments))
            flight = prepared.kernel[0](*arguments)
    ended = why_ended(world, flight)
    flown = rows[: flight.steps]
    columns = {name: flown[:, i] for i, name in enumerate(Row._fields)}
    return Trajectory(columns, ended, flight.steps)


def _kernel_for(arguments: tuple[Any, ...]) -> Any:
    """The kernel of `fly_ticks` for arguments of just these types."""
    from numba import typeof

    fly, kind_of = cast(Any, compiled(fly_ticks)), cast(Any, typeof)
    return fly.compile(tuple(kind_of(argument) for argument in arguments))


def begun(prepared: Prepared, seed: int) -> tuple[Parts, Flight]:
    """A flight of this seed before its first tick, and what it happens in, for `fly_on`."""
    parts, start = _draw(prepared, seed)
    flight = Flight(
        steps=0,
        standing=FLIES,
        reason=0,
        world=start,
        command=SurfaceCommand(prepared.world.trim.elevator, 0.0, 0.0),
        held=True,
        autopilot=initial_state(),
    )
    return parts, flight


def fly_on(
    parts: Parts, laws: Laws, flight: Flight, until_step: int, changes: int, rows: FloatArray
) -> Flight:
    """Fly on to a step with these laws; rows, (ticks, columns of `Row`), are filled."""
    return compiled(fly_ticks)(parts, laws, flight, until_step, changes, rows)


def lines_of(parts: Parts) -> tuple[tuple[Any, ...], ...]:
    """What lies in the delay lines of a flight's sensors: beside `Flight`, all that goes on."""
    sensors: tuple[Any, ...] = parts.sensors  # of six types
    return tuple(tuple(sensor.line) for sensor in sensors)


def continued(
    prepared: Prepared, seed: int, lines: tuple[tuple[Any, ...], ...], noise_seed: int
) -> Parts:
    """What a flight of `seed` happens in from some tick on, with the noise of another seed.

    The sensors keep their biases; turbulence goes on from where it is.  With its own seed as that
    of the noise the flight goes on as if nothing had been.  lines: of `lines_of`, at that tick.
    """
    own, _ = _draw(prepared, seed)
    noise, _ = _draw(prepared, noise_seed) if noise_seed != seed else (own, None)
    biased: tuple[Any, ...] = own.sensors  # of six types
    noisy: tuple[Any, ...] = noise.sensors
    sensors = []
    for sensor, other, line in zip(biased, noisy, lines, strict=True):
        for place, sample in enumerate(line):
            sensor.line[place] = sample
        white = {"white": other.white} if "white" in other._fields else {}
        sensors.append(sensor._replace(**white))
    return own._replace(turbulence=noise.turbulence, sensors=FlownSensors._make(sensors))


def why_ended(world: World, flight: Flight) -> str:
    """Why a flight ended early; "" where it has not."""
    return why_it_stands_so(world, flight.standing, flight.reason, flight.world.aircraft)


def why_it_stands_so(world: World, standing: int, reason: int, aircraft: AircraftState) -> str:
    """The same of one that is known by its standing, the last tick's reason and its place."""
    if standing == CRASHED:
        return world.why_lost(aircraft)
    if standing == HANDED_OVER:
        return f"disengaged: {reason_text(reason)}"
    return ""


def _first_step(time_s: float, dt_s: float) -> int:
    """The first step that is not before a time, as `closed_loop.fly` compares them."""
    n = max(0, floor(time_s / dt_s) - 1)
    while n * dt_s < time_s:
        n += 1
    return n


class CompiledWorld(World):
    """A world whose steps are compiled, for laws in plain Python: the world of `prepare`.

    It lasts as long as it was prepared for.
    """

    def __init__(self, prepared: Prepared, seed: int) -> None:
        vars(self).update(vars(prepared.world))  # in place of `World`'s own: it is made already
        self.parts, start = _draw(prepared, seed)
        self._ticks = prepared.ticks
        self._parts_cell, self._now_cell = cell(self.parts), cell(start)
        self._advance = compiled(world_step_in_cells)
        self._take(start)

    def _stepped(self, command: SurfaceCommand) -> WorldNow:
        if self.steps > self._ticks:
            raise ValueError(f"this world was prepared for {self._ticks} steps and no more")
        return self._advance(self._parts_cell, self._now_cell, self.steps, command, self.held)

    def _set(self, now: WorldNow) -> None:
        super()._set(now)
        self._now_cell = cell(now)  # only compiled functions write to one


class CompiledLoop(ClosedLoop):
    """A closed loop whose laws are compiled too, for faults in plain Python between the two.

    Its outputs hold mode, reason, command, whether it is sent, how the point on the line stands and
    what a rangefinder says; all else is that of the first tick.
    """

    def __init__(
        self, world: World, values: ParameterSet, injection: Injection | None = None
    ) -> None:
        super().__init__(world, values, injection)
        self._laws_cell, self._state_cell = cell(self._laws), cell(self.state)
        self._step = compiled(decide_in_cells)
        self._first: Output | None = None

    def change(self, parameters: dict[str, float]) -> None:
        """Set parameters between two ticks.  Errors: `ParameterError`."""
        super().change(parameters)
        self._laws_cell = cell(self._laws)  # only compiled functions write to one

    def _decide(self, inputs: Inputs) -> Output:
        if self._first is None:
            _, self._first = autopilot_step(self._laws, self.state, inputs)
        decision = self._step(self._laws_cell, self._state_cell, inputs)
        return self._first._replace(time_s=inputs.time_s, **decision._asdict())


def _draw(prepared: Prepared, seed: int) -> tuple[Parts, WorldNow]:
    """All that is random in a flight, and the world at its start in that air."""
    world, air, ticks, _ = prepared
    plain = world.parts
    eddies = DRYDEN_STILL
    white: Rows = NO_ROWS
    roll_gust, rolling = 0.0, white
    if plain.turbulence.blows:
        eddies, white = turbulence_before(plain.turbulence.params, seed, ticks)
        roll_gust, rolling = roll_gusts_before(plain.turbulence.rolls, seed, ticks)
    parts = plain._replace(
        air=air,
        turbulence=plain.turbulence._replace(white=white, rolling=rolling),
        sensors=flown_sensors(
            world.sensors, world.step_hz, drawn_before(seed, ticks), _line, world.ground
        ),
    )
    start = world.now._replace(turbulence=eddies, roll_gust_radps=roll_gust)
    command = SurfaceCommand(world.trim.elevator, 0.0, 0.0)
    # Not compiled: to hand over and take back a whole world costs ten times its first samples.
    return parts, world_begun(parts, start, command)


@lru_cache(typed=True)
def _new_line(nothing: Any, length: int) -> Any:
    from numba import typed, typeof

    line = typed.List.empty_list(typeof(nothing))  # type: ignore[no-untyped-call]
    for _ in range(length):
        line.append(nothing)
    return line


def _line(nothing: Any, length: int) -> Any:
    """A delay line that compiled functions write to: a copy, which is quicker than to fill one."""
    return _new_line(nothing, length).copy()
