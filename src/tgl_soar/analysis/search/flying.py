"""One episode: the module's own closed loop, and somebody who moves its line.

Between two looks (`LOOK_S`) the module's tick and the world fly compiled.  A look sees what the
module has aboard, and nothing else: its position, its estimate of the air, its line.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import degrees, isfinite, pi
from typing import Final, NamedTuple, Protocol

import numpy as np

from tgl_soar.air.field import FloatArray
from tgl_soar.analysis.flown_airframe import flown_airframe
from tgl_soar.analysis.search.places import SearchPlace
from tgl_soar.autopilot import Output
from tgl_soar.autopilot import step as autopilot_step
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_parameters
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.laws import laws_from
from tgl_soar.control.search.rollout import Guards, Moving
from tgl_soar.control.target_line import LineLimits, LineState, TargetLine
from tgl_soar.estimation.lift_map.lift_map import Reading
from tgl_soar.sim.fast_flight import begun, fly_on, prepare, why_ended
from tgl_soar.sim.flight import FLIES, Row, inputs_at
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, READ_BACK, Sensors
from tgl_soar.sim.world import make_world

LOOK_S: Final = 0.2
GRAVITY_MPS2: Final = 9.80665
SPEED_MIN_MARGIN: Final = 0.3  # m/s under the polar's slowest: flown through, not held
SPEED_MAX_MARGIN: Final = 1.0
LANDING: Final = 1.5  # of CLEAR_MIN: half of it is left when recovering would begin
_COLUMN: Final = {name: n for n, name in enumerate(Row._fields)}


class Sighting(NamedTuple):
    """What the module knows at one instant."""

    time_s: float
    dt_s: float  # since the last look
    reading: Reading  # averages since the last look
    moving: Moving
    climb_mps: float
    over_ground_m: float
    guards: Guards
    pitot: bool


class LineWish(NamedTuple):
    """What somebody makes of a look."""

    target: TargetLine
    soaring: bool  # claimed
    given_up: str  # the reason; "" goes on


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


def guards_of(place: SearchPlace, values: ParameterSet, airframe: Airframe) -> Guards:
    """The guards as the parameters have them."""
    polar = airframe.polar.as_polar()
    clear = values["CLEAR_MIN"]
    return Guards(
        box=place.box,
        ground=place.ground,
        clearance_m=clear,
        landing_m=LANDING * clear,
        speed_min_mps=polar.speed_min_mps - SPEED_MIN_MARGIN,
        speed_max_mps=polar.speed_max_mps + SPEED_MAX_MARGIN,
        line=LineLimits(
            values["TGL_SLEW"], values["TGL_ACCEL"], values["TGL_ROT_SLEW"] * pi / 180.0
        ),
    )


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
    values = values.changed({"TGL_LEAN_MIN": -5.0})  # SAOS's upright line
    guards = guards_of(place, values, airframe)
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
        look = _look(place, guards, before, output, rows[begin : flight.steps], pitot)
        before = output
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
        if any(values[key] != value for key, value in wanted.items()):
            values = values.changed(wanted, flying=True)
            changes += 1
    episode.ended = why_ended(world, flight)
    episode.flown_s = flight.steps / world.step_hz
    kept = rows[: flight.steps : world.step_hz // 10]
    episode.path = {column: kept[:, n].copy() for column, n in _COLUMN.items()}
    last = flight.world.aircraft
    episode.height_left_m = last.z_m - _floor(place, last.x_m)
    return episode


def _look(
    place: SearchPlace, guards: Guards, before: Output, now: Output, rows: FloatArray, pitot: bool
) -> Sighting | None:
    """What is known now; None: no position."""
    old, new = before.vehicle, now.vehicle
    dt = now.time_s - before.time_s
    if not (isfinite(new.x_m) and isfinite(old.x_m) and dt > 0.0):
        return None
    wind = float(np.mean(rows[:, _COLUMN["air_wind_mps"]]))
    updraft = float(np.mean(rows[:, _COLUMN["air_updraft_mps"]]))
    airspeed = wind - 0.5 * (old.velocity_x_mps + new.velocity_x_mps)
    climb = (new.z_m - old.z_m) / dt
    change = (new.velocity_x_mps - old.velocity_x_mps) / dt
    reading = Reading(
        x_m=0.5 * (old.x_m + new.x_m),
        z_m=0.5 * (old.z_m + new.z_m),
        wind_mps=wind,
        updraft_mps=updraft,
        airspeed_mps=airspeed,
        energy_mps=climb - airspeed / GRAVITY_MPS2 * change,
        since_s=dt,
    )
    tracking = now.line
    across_mps = -(tracking.e_rho_rate_mps - _across(new.velocity_x_mps, new.climb_mps, tracking))
    line = LineState(
        x_m=tracking.x_m,
        z_m=tracking.z_m,
        eta_rad=tracking.eta_rad,
        speed_mps=across_mps if tracking.moving else 0.0,
        moving=tracking.moving,
    )
    return Sighting(
        time_s=now.time_s,
        dt_s=dt,
        reading=reading,
        moving=Moving(new.x_m, new.z_m, new.climb_mps, line),
        climb_mps=climb,
        over_ground_m=new.z_m - _floor(place, new.x_m),
        guards=guards,
        pitot=pitot,
    )


def _across(velocity_x: float, climb: float, line) -> float:  # type: ignore[no-untyped-def]
    return float(np.cos(line.eta_rad) * climb - np.sin(line.eta_rad) * velocity_x)


def _floor(place: SearchPlace, x_m: float) -> float:
    ground = place.ground
    n = ground.points
    return float(np.interp(x_m, ground.x_m[:n], ground.z_m[:n]))


def _parameters(target: TargetLine) -> dict[str, float]:
    """A target line as parameters, which are 32-bit floats."""
    return {
        "TGL_X": float(np.float32(target.x_m)),
        "TGL_Z": float(np.float32(target.z_m)),
        "TGL_LEAN": float(np.float32(degrees(target.eta_rad - 0.5 * pi))),
    }
