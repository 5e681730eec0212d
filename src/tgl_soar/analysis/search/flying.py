"""One episode: the module's own closed loop, and somebody who moves its line.

Between two looks (`LOOK_S`) the module's tick and the world fly compiled.  A look sees what the
module has aboard, and nothing else: its position, its estimate of the air, its line.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import degrees, pi
from typing import Final, Protocol

import numpy as np

from tgl_soar.air.field import FloatArray
from tgl_soar.analysis.flown_airframe import flown_airframe
from tgl_soar.analysis.search.places import SearchPlace
from tgl_soar.autopilot import Output
from tgl_soar.autopilot import step as autopilot_step
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_parameters
from tgl_soar.control.laws import SEARCH_LOOKS, SEARCH_SOARS, laws_from
from tgl_soar.control.search.glimpse import LOOK_S, Glimpse, LineWish, task_of
from tgl_soar.control.search.lift_search import Sighting, floor_at, guards_of, sighting_of
from tgl_soar.control.target_line import TargetLine
from tgl_soar.sim.fast_flight import begun, fly_on, prepare, why_ended
from tgl_soar.sim.flight import FLIES, Row, inputs_at
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, READ_BACK, Sensors
from tgl_soar.sim.world import make_world

_COLUMN: Final = {name: n for n, name in enumerate(Row._fields)}


class Searcher(Protocol):
    """Somebody who moves the line."""

    def look(self, look: Sighting) -> LineWish:
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
    plan_ms: list[float] = field(default_factory=list)
    reading_ms: list[float] = field(default_factory=list)


def fly_episode(
    place: SearchPlace,
    airframe: Airframe,
    name: str,
    searcher: Callable[[Sighting], Searcher],
    *,
    pitot: bool = True,
) -> Episode:
    """Fly one episode; the searcher is made of the first look.  Errors: `ConfigError`."""
    factor = place.sink_factor
    drag = [(f"model.{key}", airframe.model[key] * factor) for key in ("CD0", "CD_lift")]
    world = make_world(
        flown_airframe(airframe, drag),
        place.site,
        seed=place.seed,
        field=place.field,
        sensors=Sensors(imu=MEMS_IMU, airspeed=PITOT if pitot else None, surfaces=READ_BACK),
    )
    world.aerodynamics = airframe.aerodynamics()
    values = load_parameters(airframe, name, place.site, place.site.site.name)
    # SAOS's upright line; and whoever searches flies in mode searching.
    values = values.changed({"TGL_LEAN_MIN": -5.0, "SRCH_START": SEARCH_LOOKS})
    task = task_of(laws_from(values, world.frame, world.aerodynamics, world.ground))
    guards = guards_of(task._replace(polar=airframe.polar.as_polar()))
    parts, flight = begun(prepare(world, place.duration_s), place.seed)
    rows = np.empty((round(place.duration_s * world.step_hz), len(Row._fields)))
    episode = Episode(place, name, "", "", 0.0, {}, landing_m=guards.landing_m)
    every = round(LOOK_S * world.step_hz)
    somebody: Searcher | None = None
    before: Output | None = None
    claimed = False
    changes = 0
    while flight.steps < len(rows) and flight.standing == FLIES:
        laws = laws_from(values, world.frame, world.aerodynamics, world.ground)
        begin = flight.steps
        flight = fly_on(parts, laws, flight, min(begin + every, len(rows)), changes, rows)
        now_s = flight.steps / world.step_hz
        # The tick is pure: what the module would report at this instant.
        inputs = inputs_at(now_s, flight.world.samples, True)
        _, output = autopilot_step(laws, flight.autopilot, inputs)
        if before is None or not output.active or not before.active:
            before = output
            continue
        since = rows[begin : flight.steps]
        glimpse = Glimpse(
            before=before.vehicle,
            now=output.vehicle,
            line=output.line,
            wind_mps=float(np.mean(since[:, _COLUMN["air_wind_mps"]])),
            updraft_mps=float(np.mean(since[:, _COLUMN["air_updraft_mps"]])),
            pitot=pitot,
            seeks=True,
            refused=False,
        )
        before = output
        look = sighting_of(guards, glimpse)
        if look is None:
            continue
        if somebody is None:
            somebody = searcher(look)
        decision = somebody.look(look)
        if decision.soaring != claimed:
            claimed = decision.soaring
            episode.claims.append((now_s, claimed))
        if decision.given_up:
            episode.given_up = decision.given_up
            break
        wanted = _parameters(decision.target)
        wanted["SRCH_START"] = SEARCH_SOARS if decision.soaring else SEARCH_LOOKS
        if any(values[key] != value for key, value in wanted.items()):
            values = values.changed(wanted, flying=True)
            changes += 1
    episode.ended = why_ended(world, flight)
    episode.flown_s = flight.steps / world.step_hz
    kept = rows[: flight.steps : world.step_hz // 10]
    episode.path = {column: kept[:, n].copy() for column, n in _COLUMN.items()}
    last = flight.world.aircraft
    episode.height_left_m = last.z_m - floor_at(place.ground, place.box, last.x_m)
    return episode


def _parameters(target: TargetLine) -> dict[str, float]:
    """A target line as parameters, which are 32-bit floats."""
    return {
        "TGL_X": float(np.float32(target.x_m)),
        "TGL_Z": float(np.float32(target.z_m)),
        "TGL_LEAN": float(np.float32(degrees(target.eta_rad - 0.5 * pi))),
    }
