"""Many flights of one plan, each with its own seed, and a score for each.

One seed is one flight, however it is flown:

    plain      `closed_loop.fly`
    compiled   `fly_compiled`; the first flight compiles for all processes

The second needs numba (the extra `fast`) and agrees with the first to 1e-6.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import radians
from typing import NamedTuple

import numpy as np

from tgl_soar.air.field import WindField
from tgl_soar.air.zeuc import stable_crossing
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Site
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.sim.campaign.executors import InLine, LocalProcesses
from tgl_soar.sim.campaign.run import fly_all
from tgl_soar.sim.closed_loop import Change, Trajectory, fly
from tgl_soar.sim.compiled_flight import Prepared, fly_compiled, prepare
from tgl_soar.sim.score import LegScore, score_leg
from tgl_soar.sim.sensors import USUAL_SENSORS, Sensors
from tgl_soar.sim.world import World, make_world


@dataclass(frozen=True)
class Plan:
    """What every flight of a batch has in common."""

    airframe: Airframe
    site: Site
    values: ParameterSet
    changes: Sequence[Change] = ()  # by the operator; each begins a leg
    duration_s: float = 30.0
    turbulence: float | None = None  # intensity; None: the site's
    step_hz: int = 200
    field: WindField | None = None  # None: the site's
    sensors: Sensors = USUAL_SENSORS

    def world(self, seed: int) -> World:
        """A new world.  Errors: `ConfigError`."""
        return make_world(
            self.airframe,
            self.site,
            seed=seed,
            turbulence=self.turbulence,
            step_hz=self.step_hz,
            field=self.field,
            sensors=self.sensors,
        )


class FlightScore(NamedTuple):
    """One flight of a batch."""

    seed: int
    ended: str  # why it ended early; "" if it flew to the end
    flown_s: float
    legs: tuple[LegScore, ...]  # named by the changes before them; those whose line stood still


class _Leg(NamedTuple):
    line: tuple[float, float, float]  # x0, z0 [m], eta [rad]
    crossing: tuple[float, float] | None  # of line and contour, where the aircraft should be


def fly_batch(
    plan: Plan,
    seeds: Sequence[int],
    *,
    workers: int | None = None,
    compile: bool = False,
) -> list[FlightScore]:
    """Fly the plan once with each seed; scores in the order of the seeds.

    workers: processes; 1: this one; None: one a core.  Neither their number nor the
    other seeds change a score.
    Errors: `ConfigError`, `ParameterError`; ImportError without numba and `UnknownFieldError`
    where flights are to be compiled.
    """
    count = workers if workers is not None else os.cpu_count() or 1
    if count < 1:
        raise ValueError(f"workers {count}: at least 1")
    if not seeds:
        return []
    world = plan.world(seeds[0])
    plan = replace(plan, field=world.field)  # built once
    legs = _legs(plan, world.field)
    prepared = prepare(world, plan.duration_s) if compile else None
    fly_one = partial(_fly_one, plan, legs, prepared)
    executor = InLine() if count == 1 else LocalProcesses(count)
    return fly_all(fly_one, seeds, executor, first_here=compile)


def _fly_one(plan: Plan, legs: Sequence[_Leg], prepared: Prepared | None, seed: int) -> FlightScore:
    if prepared is not None:
        return _score(seed, legs, fly_compiled(prepared, seed, plan.values, plan.changes))
    return _score(seed, legs, fly(plan.world(seed), plan.values, plan.changes, plan.duration_s))


def _legs(plan: Plan, field: WindField) -> list[_Leg]:
    """The line before any change, and after each."""
    values = plan.values
    legs = [_leg(plan, values, field)]
    for change in sorted(plan.changes, key=lambda change: change.time_s):
        values = values.changed(change.parameters, flying=True)
        legs.append(_leg(plan, values, field))
    return legs


def _leg(plan: Plan, values: ParameterSet, field: WindField) -> _Leg:
    line = (values["TGL_X"], values["TGL_Z"], eta_from_lean(radians(values["TGL_LEAN"])))
    place = stable_crossing(field, plan.airframe.polar.as_polar(), line)
    return _Leg(line, None if place is None else (place.x_m, place.z_m))


def _score(seed: int, legs: Sequence[_Leg], flight: Trajectory) -> FlightScore:
    time_s, x_m, z_m = (flight[name] for name in ("time_s", "x_m", "z_m"))
    still = flight["line_moving"] == 0.0
    changes = flight["target_changes"]
    scores = []
    for i, leg in enumerate(legs):
        rows = still & (changes == i)
        if np.count_nonzero(rows) >= 2:
            scores.append(
                score_leg(
                    str(i),
                    leg.line,
                    leg.crossing,
                    *(time_s[rows], x_m[rows], z_m[rows]),
                    flight["y_m"][rows],
                    flight["roll_rad"][rows],
                )
            )
    flown_s = float(time_s[-1]) if flight.ticks else 0.0
    return FlightScore(seed, flight.ended, flown_s, tuple(scores))
