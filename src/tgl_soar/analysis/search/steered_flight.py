"""The module's own closed loop in simulation, and what moves its line.

Between two looks (`LOOK_S`) the module's tick and the world fly compiled, and so does the tick that
a look takes.  It sees what the module has aboard, and nothing else: its position, its estimate of
the air, its line.
"""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, Final

import numpy as np

from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.laws import laws_from
from tgl_soar.control.search.glimpse import LOOK_S, Glimpse, task_of
from tgl_soar.control.search.lift_search import Sighting, guards_of, sighting_of
from tgl_soar.control.throttle import can_hold
from tgl_soar.sim.closed_loop import Trajectory
from tgl_soar.sim.compiled import cell, compiled
from tgl_soar.sim.compiled_flight import begun, prepare, why_it_stands_so
from tgl_soar.sim.flight import FLIES, Row
from tgl_soar.sim.watched_flight import Looked, fly_to_look_in_cells
from tgl_soar.sim.world import World
from tgl_soar.types import GlidePolar

COLUMN: Final = {name: n for n, name in enumerate(Row._fields)}
_THROTTLE: Final = COLUMN["throttle"]


class SteeredFlight:
    """A flight that is looked at every `LOOK_S`, and may be given other parameters then."""

    def __init__(
        self,
        world: World,
        values: ParameterSet,
        polar: GlidePolar,
        duration_s: float,
        seed: int,
        *,
        plain: bool = False,
    ) -> None:
        """polar: as the module is given it; seed: of gusts and sensors; plain: no function
        compiled, a hundred times as long; the sensors' delay lines are numba's lists even so.

        Errors: ValueError for a world that has already been stepped; ImportError without numba.
        """
        self.world, self.values = world, values
        self.pitot = world.sensors.airspeed is not None
        laws = laws_from(values, world.frame, world.aerodynamics, world.ground)
        self.guards = guards_of(task_of(laws)._replace(polar=polar))
        parts, flight = begun(prepare(world, duration_s), seed)
        self._cell: Callable[[object], Any] = _plain_cell if plain else cell
        self._fly = fly_to_look_in_cells if plain else compiled(fly_to_look_in_cells)
        self._parts, self._laws = self._cell(parts), self._cell(laws)
        self._throttle = laws.throttle
        self.used_s = 0.0  # of full throttle
        self._flight = self._cell(flight)
        self.rows = np.empty((round(duration_s * world.step_hz), len(Row._fields)))
        self._changes = 0
        self.now: Looked | None = None  # the last look; None: there was none
        self._before: Looked | None = None  # the one before it, in control

    @property
    def time_s(self) -> float:
        """Since the start."""
        return 0.0 if self.now is None else self.now.steps / self.world.step_hz

    @property
    def flies(self) -> bool:
        """Whether it goes on."""
        now = self.now
        return now is None or (now.steps < len(self.rows) and now.standing == FLIES)

    def look(self) -> Sighting | None:
        """Fly on to the next look; None: the search sees nothing in it."""
        begin = 0 if self.now is None else self.now.steps
        until = min(begin + round(LOOK_S * self.world.step_hz), len(self.rows))
        now = self._fly(self._parts, self._laws, self._flight, until, self._changes, self.rows)
        self.now, before = now, self._before
        self._before = now
        self.used_s += float(self.rows[begin : now.steps, _THROTTLE].sum()) / self.world.step_hz
        if before is None or not now.active or not before.active:
            return None
        since = self.rows[begin : now.steps]
        wind_mps = float(np.mean(since[:, COLUMN["air_wind_mps"]]))
        glimpse = Glimpse(
            before=before.vehicle,
            now=now.vehicle,
            line=now.line,
            wind_mps=wind_mps,
            updraft_mps=float(np.mean(since[:, COLUMN["air_updraft_mps"]])),
            pitot=self.pitot,
            seeks=True,
            refused=None,
            pushed_mps=0.5 * (before.pushed_mps + now.pushed_mps),
            carried=can_hold(
                self._throttle,
                self.used_s,
                min(0.0, now.vehicle.climb_mps),
                wind_mps - now.vehicle.velocity_x_mps,
            ),
        )
        return sighting_of(self.guards, glimpse)

    def set(self, wanted: dict[str, float]) -> None:
        """Set parameters between two ticks.  Errors: `ParameterError`."""
        if any(self.values[key] != value for key, value in wanted.items()):
            world = self.world
            self.values = self.values.changed(wanted, flying=True)
            laws = laws_from(self.values, world.frame, world.aerodynamics, world.ground)
            self._laws = self._cell(laws)  # only compiled functions write to one
            self._changes += 1

    def trajectory(self, every: int = 1) -> Trajectory:
        """What was flown, a row every so many ticks, and how it ended."""
        now = self.now
        assert now is not None
        rows = self.rows[: now.steps : every]
        ended = why_it_stands_so(self.world, now.standing, now.reason, now.aircraft)
        return Trajectory({name: rows[:, n] for name, n in COLUMN.items()}, ended, now.steps)


def _plain_cell(value: object) -> SimpleNamespace:
    """A cell of plain Python."""
    return SimpleNamespace(value=value)
