"""One episode: the module's own closed loop, and somebody who moves its line.

Between two looks (`LOOK_S`) the module's tick and the world fly compiled, and so does the tick that
a look takes.  It sees what the module has aboard, and nothing else: its position, its estimate of
the air, its line.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, Final, Protocol

import numpy as np

from tgl_soar.air.field import FloatArray
from tgl_soar.analysis.experiments.mismatch import flown_world
from tgl_soar.analysis.flown_airframe import flown_airframe
from tgl_soar.analysis.search.places import SearchPlace
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_parameters
from tgl_soar.control.laws import SEARCH_LOOKS, SEARCH_SOARS, laws_from
from tgl_soar.control.search.glimpse import LOOK_S, Glimpse, LineRequest, task_of
from tgl_soar.control.search.lift_search import Sighting, guards_of, sighting_of
from tgl_soar.control.search.rollout import floor_at
from tgl_soar.control.throttle import can_hold
from tgl_soar.onboard.line_moves import line_parameters_of
from tgl_soar.sim.compiled import cell, compiled
from tgl_soar.sim.compiled_flight import begun, prepare, why_it_stands_so
from tgl_soar.sim.flight import FLIES, Row
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, READ_BACK, Sensors
from tgl_soar.sim.watched_flight import Looked, fly_to_look_in_cells

_COLUMN: Final = {name: n for n, name in enumerate(Row._fields)}
_THROTTLE: Final = _COLUMN["throttle"]
ALREADY: Final = ("drag", "wind", "slope_rad")  # of a place: drawn with it, and known to no file
# SAOS's upright line; and whoever searches flies in mode searching.
SEARCHING: Final = {"TGL_LEAN_MIN": -5.0, "SRCH_START": float(SEARCH_LOOKS)}


class Searcher(Protocol):
    """Somebody who moves the line."""

    def look(self, look: Sighting) -> LineRequest:
        """Called every `LOOK_S`."""


@dataclass
class Episode:
    """What came of it."""

    place: SearchPlace
    searcher: str
    ended: str  # why it ended early; "" if it flew to the end or was given up
    given_up: str  # the reason; ""
    flown_s: float
    path: dict[str, FloatArray]  # columns of `Row`, 10 a second
    claims: list[tuple[float, bool]] = field(default_factory=list)  # changes of the claim
    height_left_m: float = 0.0  # over the ground at the end
    landing_m: float = 0.0


class EpisodeFlight:
    """The module's closed loop at a place, looked at every `LOOK_S`."""

    def __init__(
        self,
        place: SearchPlace,
        airframe: Airframe,
        parameters: dict[str, float],
        *,
        pitot: bool = True,
        plain: bool = False,
    ) -> None:
        """parameters: beside those of the site; plain: nothing compiled, a hundred times as long.

        Errors: `ConfigError`; ImportError without numba.
        """
        factor = place.sink_factor
        drag = [(f"model.{key}", airframe.model[key] * factor) for key in ("CD0", "CD_lift")]
        self.place, self.pitot = place, pitot
        self.world = world = flown_world(
            airframe,
            place.site,
            place.seed,
            dispersed=place.dispersed,
            flies=flown_airframe(airframe, drag),
            already=ALREADY,
            field=place.field,
            sensors=Sensors(imu=MEMS_IMU, airspeed=PITOT if pitot else None, surfaces=READ_BACK),
        )
        name = place.site.site.name
        self.values = load_parameters(airframe, name, place.site, name).changed(parameters)
        laws = laws_from(self.values, world.frame, world.aerodynamics, world.ground)
        self.guards = guards_of(task_of(laws)._replace(polar=airframe.polar.as_polar()))
        parts, flight = begun(prepare(world, place.duration_s), place.seed)
        self._cell: Callable[[object], Any] = _plain_cell if plain else cell
        self._fly = fly_to_look_in_cells if plain else compiled(fly_to_look_in_cells)
        self._parts, self._laws = self._cell(parts), self._cell(laws)
        self._throttle = laws.throttle
        self.used_s = 0.0  # of full throttle
        self._flight = self._cell(flight)
        self.rows = np.empty((round(place.duration_s * world.step_hz), len(Row._fields)))
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
        wind_mps = float(np.mean(since[:, _COLUMN["air_wind_mps"]]))
        glimpse = Glimpse(
            before=before.vehicle,
            now=now.vehicle,
            line=now.line,
            wind_mps=wind_mps,
            updraft_mps=float(np.mean(since[:, _COLUMN["air_updraft_mps"]])),
            pitot=self.pitot,
            seeks=True,
            refused=False,
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

    def ended(self, episode: Episode) -> Episode:
        """The episode with what the flight came to."""
        now, place, world = self.now, self.place, self.world
        assert now is not None
        episode.ended = why_it_stands_so(world, now.standing, now.reason, now.aircraft)
        episode.flown_s = self.time_s
        kept = self.rows[: now.steps : world.step_hz // 10]
        episode.path = {column: kept[:, n].copy() for column, n in _COLUMN.items()}
        floor_m = float(floor_at(place.ground, now.aircraft.x_m, place.box.z_min_m))
        episode.height_left_m = now.aircraft.z_m - floor_m
        return episode


def fly_episode(
    place: SearchPlace,
    airframe: Airframe,
    name: str,
    searcher: Callable[[Sighting], Searcher],
    *,
    pitot: bool = True,
    plain: bool = False,
) -> Episode:
    """Fly one episode; searcher: as of `flown_by`.

    pitot, plain, errors: as of `EpisodeFlight`.
    """
    flight = EpisodeFlight(place, airframe, SEARCHING, pitot=pitot, plain=plain)
    return flown_by(flight, name, searcher)


def flown_by(flight: EpisodeFlight, name: str, searcher: Callable[[Sighting], Searcher]) -> Episode:
    """Fly an episode to its end; the searcher is made of the first look."""
    episode = Episode(
        place=flight.place,
        searcher=name,
        ended="",
        given_up="",
        flown_s=0.0,
        path={},
        landing_m=flight.guards.landing_m,
    )
    somebody: Searcher | None = None
    while flight.flies:
        look = flight.look()
        if look is None:
            continue
        if somebody is None:
            somebody = searcher(look)
        if not obeyed(flight, episode, somebody.look(look)):
            break
    return flight.ended(episode)


def obeyed(flight: EpisodeFlight, episode: Episode, request: LineRequest) -> bool:
    """Move the line as it is requested; whether the search goes on."""
    claimed = bool(episode.claims) and episode.claims[-1][1]
    if request.soaring != claimed:
        episode.claims.append((flight.time_s, request.soaring))
    if request.given_up:
        episode.given_up = request.given_up
        return False
    standing = SEARCH_SOARS if request.soaring else SEARCH_LOOKS
    flight.set(line_parameters_of(request.target) | {"SRCH_START": float(standing)})
    return True


def _plain_cell(value: object) -> SimpleNamespace:
    """A cell of plain Python."""
    return SimpleNamespace(value=value)
