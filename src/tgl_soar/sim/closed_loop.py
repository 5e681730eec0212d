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
from tgl_soar.control.target_line import e_rho
from tgl_soar.sim.injection import DirectLink, Injection
from tgl_soar.sim.world import World
from tgl_soar.types import AutopilotStatus, Inputs, SurfaceCommand

HELD_S = 0.2  # the aircraft is held until the sensors have spoken and the module has it


class Change(NamedTuple):
    """Parameters set at a time, as an operator would."""

    time_s: float
    parameters: dict[str, float]


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
        """One tick of the module and one step of the world."""
        world = self.world
        now = world.time_s
        engage = self.engage and now >= HELD_S
        inputs = Inputs(
            time_s=now,
            position=world.position,
            attitude=world.attitude,
            autopilot=AutopilotStatus(time_s=now, accepts_surfaces=True, armed=True),
            engage=engage,
            imu=world.imu,
            airspeed=world.airspeed,
            surfaces=world.surfaces,
        )
        if self._link is not None:
            inputs = self._link.inputs(inputs)
        output = self._decide(inputs)
        self.output = output
        if output.active:
            self._command = output.command
            world.held = False
        told = self._command
        if self._link is not None and self._injection is not None:
            told = self._link.surfaces(now, output.command if output.active else None)
            told = self._injection.surfaces(now, told, self._dt_s)
        world.step(told)
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
    """Fly from the start for duration_s seconds, or until the module lets go or crashes."""
    loop = ClosedLoop(world, values, injection)
    pending = sorted(changes, key=lambda change: change.time_s)
    done = 0
    ended = ""
    rows: list[Row] = []
    for _ in range(round(duration_s * world.step_hz)):
        while done < len(pending) and pending[done].time_s <= world.time_s:
            loop.change(pending[done].parameters)
            done += 1
        truth = world.truth
        output = loop.tick()
        rows.append(
            Row(
                truth.time_s,
                truth.x_m,
                truth.y_m,
                truth.z_m,
                e_rho(output.line.x_m, output.line.z_m, output.line.eta_rad, truth.x_m, truth.z_m),
                float(output.line.moving or not output.active),
                float(done),
                truth.pitch_rad,
                output.setpoints.pitch_rad,
                truth.roll_rad,
                truth.heading_rad,
                output.command.elevator,
                truth.airspeed_mps,
                truth.alpha_rad,
                truth.wind_x_mps,
                truth.updraft_mps,
                *output.air[:7],
            )
        )
        if world.crashed:
            ended = world.crashed
            break
        if output.mode in (RELEASED, FAILED):
            ended = f"let go: {reason_text(output.reason)}"
            break
    table = np.array(rows)
    columns = {name: table[:, i] for i, name in enumerate(Row._fields)}
    return Trajectory(columns, ended, len(rows))
