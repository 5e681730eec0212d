"""The search for lift: a reading into the map, and a plan, in processor time of one core."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import radians
from statistics import median
from time import process_time

import numpy as np

from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.control.search.plan import DRAWS, SPREAD, likely_fields, plan_in
from tgl_soar.control.search.rollout import Grid, Guards, Moving
from tgl_soar.control.target_line import LineLimits, LineState, TargetLine, eta_from_lean
from tgl_soar.estimation.lift_map.basis import Box
from tgl_soar.estimation.lift_map.lift_map import LiftMap, Reading

from .result import ALLOWED, Result

READING_MS, PLAN_MS = 0.2, 20.0  # what is allowed
READINGS, PLANS = 300, 40


def search() -> Iterator[Result]:
    """Both, in the tunnel."""
    polar = load_airframe(shipped("airframes/eclipson_c.toml")).polar.as_polar()
    ground = load_site(shipped("sites/tunnel.toml")).known_ground()
    box = Box(x_min_m=-0.5, x_max_m=2.25, z_min_m=0.15, z_max_m=2.85)
    reading = Reading(
        x_m=0.6,
        z_m=1.4,
        wind_mps=8.6,
        updraft_mps=1.4,
        airspeed_mps=8.6,
        energy_mps=0.0,
        since_s=0.2,
    )
    lift = LiftMap(ground, box, polar, reading, pitot=True)
    yield Result(
        what="a reading into the lift map",
        value=_median_ms(lambda: lift.take(reading), READINGS),
        reference=READING_MS,
        unit="ms",
        reference_what=ALLOWED,
        aim=1.0,
    )
    grid = Grid(lift.basis, ground)
    eta = eta_from_lean(radians(15.0))
    guards = Guards(
        box=box,
        ground=ground,
        clearance_m=0.3,
        landing_m=0.45,
        speed_min_mps=7.3,
        speed_max_mps=13.0,
        line=LineLimits(0.3, 0.5, radians(5.0)),
    )
    line = LineState(x_m=0.6, z_m=1.4, eta_rad=eta, speed_mps=0.0, moving=False)
    now = Moving(x_m=0.6, z_m=1.4, climb_mps=0.0, line=line)
    normals = np.random.default_rng(0).normal(size=(DRAWS, lift.basis.count))

    def plan() -> None:
        fields = likely_fields(grid, lift.mean(), lift.draws(normals, SPREAD))
        plan_in(grid, fields, polar, guards, now, TargetLine(0.6, 1.4, eta), 0.005)

    yield Result(
        what="a plan: all lines in all fields",
        value=_median_ms(plan, PLANS),
        reference=PLAN_MS,
        unit="ms",
        reference_what=ALLOWED,
        aim=1.0,
    )


def _median_ms(timed: Callable[[], object], times: int) -> float:
    """Processor time of a call."""
    taken = []
    for _ in range(times):
        begun = process_time()
        timed()
        taken.append(1e3 * (process_time() - begun))
    return median(taken)


BENCHMARKS = (search,)
