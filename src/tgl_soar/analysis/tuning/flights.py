"""Drawn aircraft in flight: who stays up, and how near the line.

Each aircraft flies with the parameters that its own file would give and the gains to be judged, on
one line of a site, in turbulence; without accelerometers it carries them and does not use them
(EST_IMU = 0).  An aircraft that has no place to soar on the line is drawn again.  A command reaches
the servo whole ticks later.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from functools import lru_cache
from math import degrees, radians, sqrt
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import asdict

from tgl_soar.air.field import WindField
from tgl_soar.air.zeuc import stable_crossing
from tgl_soar.analysis.tuning.aircraft import TICK_S, Drawn, Ranges, drawn_aircraft
from tgl_soar.analysis.tuning.demands import INERTIAL
from tgl_soar.autopilot import mode_name
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_site
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Site
from tgl_soar.control.target_line import e_rho, eta_from_lean
from tgl_soar.sim.aircraft import aircraft_model, glide_at
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.compiled import available
from tgl_soar.sim.fast_flight import CompiledLoop, CompiledWorld, Prepared, prepare
from tgl_soar.sim.world import World, build_field, make_world
from tgl_soar.types import SurfaceCommand

DURATION_S: Final = 30.0
SETTLE_S: Final = 8.0  # from the start: e_rho is not scored before
REDRAWN_MAX: Final = 50
_OVER: Final = ("released", "failed")


class DrawnFlight(NamedTuple):
    """What became of one flight."""

    up: bool  # to the end
    rms_e_rho_m: float  # from SETTLE_S on; of all, where it did not last so long


class FlyingPlace(NamedTuple):
    """Where all fly."""

    airframe: Airframe
    site_path: Path
    ranges: Ranges
    duration_s: float = DURATION_S


class Attempt(NamedTuple):
    """One flight to be flown."""

    values: ParameterSet  # gains and line
    kind: str  # with accelerometers or without
    seed: tuple[int, ...]  # of the aircraft and of the air
    turbulence: float


class LateWorld(World):
    """A world whose surfaces get every command some ticks later."""

    def __init__(self, world: World, ticks: int) -> None:
        vars(self).update(vars(world))  # in place of `World`'s own: it is made already
        self._waiting = _waiting(world, ticks)

    def step(self, command: SurfaceCommand) -> None:
        """Advance by one step under the command of some ticks ago."""
        self._waiting.append(command)
        super().step(self._waiting.popleft())


class LateCompiledWorld(CompiledWorld):
    """The same, compiled."""

    def __init__(self, prepared: Prepared, seed: int, ticks: int) -> None:
        super().__init__(prepared, seed)
        self._waiting = _waiting(prepared.world, ticks)

    def step(self, command: SurfaceCommand) -> None:
        """Advance by one step under the command of some ticks ago."""
        self._waiting.append(command)
        super().step(self._waiting.popleft())


def _waiting(world: World, ticks: int) -> deque[SurfaceCommand]:
    return deque([SurfaceCommand(world.trim.elevator, 0.0, 0.0)] * ticks)


def fly_attempt(field: FlyingPlace, attempt: Attempt) -> DrawnFlight:
    """One flight.  Errors: `ConfigError`; ValueError where no aircraft finds a place to soar."""
    site, air = _place(field.site_path)
    line = (
        attempt.values["TGL_X"],
        attempt.values["TGL_Z"],
        eta_from_lean(radians(attempt.values["TGL_LEAN"])),
    )
    drawn = soaring_aircraft(field, air, line, attempt.seed)
    seed = int(np.random.default_rng(attempt.seed).integers(2**31))
    world = make_world(
        drawn.known,
        site,
        seed=seed,
        turbulence=max(attempt.turbulence, 1e-6),  # one compiled kind of air for all
        field=air,
        sensors=drawn.sensors,
    )
    world.parts = world.parts._replace(model=drawn.true)
    ticks = round(drawn.latency_s / TICK_S)
    values = values_of(attempt.values, drawn, attempt.kind)
    if available():
        late: World = LateCompiledWorld(prepare(world, field.duration_s), seed, ticks)
        return _flown(CompiledLoop(late, values), line, field.duration_s)
    return _flown(ClosedLoop(LateWorld(world, ticks), values), line, field.duration_s)


def _flown(loop: ClosedLoop, line: tuple[float, float, float], duration_s: float) -> DrawnFlight:
    world = loop.world
    distances: list[float] = []
    up = True
    for _ in range(round(duration_s * world.step_hz)):
        output = loop.tick()
        distances.append(e_rho(line[0], line[1], line[2], world.state.x_m, world.state.z_m))
        if world.crashed or mode_name(output.mode) in _OVER:
            up = False
            break
    settle = round(SETTLE_S * world.step_hz)
    scored = np.array(distances[settle:] or distances)
    return DrawnFlight(up=up, rms_e_rho_m=float(np.sqrt(np.mean(scored**2))))


def soaring_aircraft(
    field: FlyingPlace, air: WindField, line: tuple[float, float, float], seed: tuple[int, ...]
) -> Drawn:
    """The first drawn aircraft of a seed that has a place to soar on the line."""
    for attempt in range(REDRAWN_MAX):
        drawn = drawn_aircraft(field.airframe, field.ranges, (*seed, attempt))
        if stable_crossing(air, drawn.known.polar.as_polar(), line) is not None:
            return drawn
    raise ValueError(
        f"of {REDRAWN_MAX} aircraft like {field.airframe.airframe.name!r} none has a place to soar"
        f" on this line of {field.site_path}: name another --site or --line, or --flights 0"
    )


def values_of(values: ParameterSet, drawn: Drawn, kind: str) -> ParameterSet:
    """The parameters that an aircraft flies with: as its own file has them."""
    own = drawn.known.all_parameters()
    known = {name: value for name, value in own.items() if name.startswith("DYN_")}
    model = aircraft_model(asdict(drawn.known.airframe), drawn.known.model)
    trim = degrees(glide_at(model, max(own["DYN_BEST"], _slowest(drawn))).pitch_rad)
    shift = trim - values["PITCH_TRIM"]
    return values.changed(
        {
            **known,
            "CMD_DELAY": drawn.latency_s,
            "EST_IMU": 1.0 if kind == INERTIAL else 0.0,
            "PITCH_TRIM": trim,
            "PITCH_MIN": values["PITCH_MIN"] + shift,
            "PITCH_MAX": values["PITCH_MAX"] + shift,
        }
    )


def _slowest(drawn: Drawn) -> float:
    return drawn.known.polar.speed_min_mps


@lru_cache(maxsize=2)
def _place(site_path: Path) -> tuple[Site, WindField]:
    """A site and its air.  Errors: `ConfigError`."""
    site = load_site(site_path)
    if site.air is None:
        raise ValueError(f"{site_path}: no [air] to fly in: name another --site, or --flights 0")
    return site, build_field(site.air, site_path.parent)


class Outcomes(NamedTuple):
    """Flights of one kind in one turbulence."""

    up: int
    of: int
    rms_e_rho_m: float  # root of the mean square of all, the lost ones as far as they flew


def survival(flown: Sequence[DrawnFlight]) -> Outcomes:
    """What became of them together."""
    square = sum(flight.rms_e_rho_m**2 for flight in flown) / max(1, len(flown))
    return Outcomes(sum(flight.up for flight in flown), len(flown), sqrt(square))
