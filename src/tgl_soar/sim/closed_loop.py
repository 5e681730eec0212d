"""The module's own tick and the simulated world in one process, without sockets.

For batches, tests and experiments: the law is `autopilot.step` and the world is `sim.world`,
as in the processes of `tgl-soar sitl`; only the wire is left out.  One tick is one step of the
world.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgl_soar.autopilot import (
    AutopilotState,
    Output,
    initial_state,
    reason_text,
    step,
)
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.laws import laws_from
from tgl_soar.control.supervisor import FAILED, RELEASED
from tgl_soar.sim.flight import Row, inputs_at, row_of
from tgl_soar.sim.injection import DirectLink, Injection
from tgl_soar.sim.sensor_sampling import Samples
from tgl_soar.sim.world import World
from tgl_soar.types import Inputs, SurfaceCommand


class Change(NamedTuple):
    """Parameters set at a time, as an operator would."""

    time_s: float
    parameters: dict[str, float]


@dataclass(frozen=True)
class Trajectory:
    """A flight as columns of shape (n,), and how it ended."""

    columns: dict[str, NDArray[np.float64]]
    ended: str  # why it ended early; "" if it flew to the end
    ticks: int

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        return self.columns[name]


class ClosedLoop:
    """A world with the module in it, tick by tick."""

    def __init__(
        self, world: World, values: ParameterSet, injection: Injection | None = None
    ) -> None:
        """injection: what goes wrong between the two; its `field` is the world's already."""
        self.world = world
        self.values = values
        self.state: AutopilotState = initial_state()
        self.output: Output | None = None
        self.engage = True
        self._laws = laws_from(values, world.frame, world.aerodynamics, world.ground)
        self._command = SurfaceCommand(world.trim.elevator, 0.0, 0.0)
        self._link = DirectLink(injection, self._command) if injection is not None else None
        self._injection = injection
        self._dt_s = 1.0 / world.step_hz
        world.held = True

    def change(self, parameters: dict[str, float]) -> None:
        """Set parameters between two ticks.  Errors: `ParameterError`."""
        self.values = self.values.changed(parameters, flying=True)
        self._laws = laws_from(
            self.values, self.world.frame, self.world.aerodynamics, self.world.ground
        )

    def tick(self) -> Output:
        """One tick of the module and one step of the world, in the order of `flight.acted_on`."""
        world = self.world
        now = world.time_s
        samples = Samples(
            position=world.position,
            attitude=world.attitude,
            imu=world.imu,
            airspeed=world.airspeed,
            surfaces=world.surfaces,
            rangefinder=world.rangefinder,
        )
        inputs = inputs_at(now, samples, self.engage)
        if self._link is not None:
            inputs = self._link.inputs(inputs)
        output = self._decide(inputs)
        self.output = output
        if output.active:
            self._command = output.command
            world.held = False
        acting, throttle = self._command, output.throttle.fraction
        if self._link is not None and self._injection is not None:
            sent = output.command if output.active else None
            acting = self._link.surfaces(now, sent, throttle)
            throttle = self._link.throttle
            acting = self._injection.surfaces(now, acting, self._dt_s)
        world.throttle = throttle
        world.step(acting)
        return output

    def _decide(self, inputs: Inputs) -> Output:
        """The module's tick."""
        self.state, output = step(self._laws, self.state, inputs)
        return output


def fly(
    world: World,
    values: ParameterSet,
    changes: Sequence[Change],
    duration_s: float,
    injection: Injection | None = None,
) -> Trajectory:
    """Fly from the start for duration_s seconds, unless the module hands over or it crashes."""
    loop = ClosedLoop(world, values, injection)
    pending = sorted(changes, key=lambda change: change.time_s)
    done = 0
    ended = ""
    rows: list[Row] = []
    for _ in range(round(duration_s * world.step_hz)):
        while done < len(pending) and pending[done].time_s <= world.time_s:
            loop.change(pending[done].parameters)
            done += 1
        now, aircraft, wind = world.time_s, world.state, world.wind
        output = loop.tick()
        rows.append(row_of(now, aircraft, wind, output, done))
        if world.crashed:
            ended = world.crashed
            break
        if output.mode in (RELEASED, FAILED):
            ended = f"disengaged: {reason_text(output.reason)}"
            break
    table = np.array(rows)
    columns = {name: table[:, i] for i, name in enumerate(Row._fields)}
    return Trajectory(columns, ended, len(rows))
