"""Rollouts compiled: the step of `control.search.ahead`, line by line, for thousands of plans."""

from __future__ import annotations

import numpy as np

from tgl_soar.control.search.ahead import Ahead
from tgl_soar.control.search.rollout import (
    Fields,
    Grid,
    Guards,
    Lines,
    Moving,
    RollOut,
    Rollouts,
    grown,
    roll_out,
    turning,
    within_of,
)
from tgl_soar.sim.compiled import available, compiled
from tgl_soar.sim.lines_ahead import fly_lines
from tgl_soar.types import GlidePolar


def fastest_roll_out() -> RollOut:
    """`roll_out`, compiled where numba is installed: the same numbers to the last bit."""
    return roll_out_compiled if available() else roll_out


def roll_out_compiled(
    grid: Grid,
    fields: Fields,
    polar: GlidePolar,
    guards: Guards,
    now: Moving,
    lines: Lines,
    horizon_s: float,
    steps: int,
) -> Rollouts:
    """As `roll_out`.  Errors: ImportError without numba."""
    dt = horizon_s / steps
    sines, cosines = turning(now, lines, guards.line.turn_rate_radps * dt, steps)
    begin = Ahead(
        x_m=float(now.x_m),
        z_m=float(now.z_m),
        climb_mps=float(now.climb_mps),
        speed_mps=float(now.line.speed_mps),
        margin_m=np.inf,
        aside_mps=np.inf,
    )
    targets = np.stack([lines.x_m, lines.z_m, np.sin(lines.eta_rad), np.cos(lines.eta_rad)])
    flown = np.empty((len(fields.sink_scale), len(lines.x_m), 6))
    compiled(fly_lines)(
        grid.mesh,
        np.ascontiguousarray(fields.wind_mps).reshape(-1),
        np.ascontiguousarray(fields.updraft_mps).reshape(-1),
        np.ascontiguousarray(fields.sink_scale),
        np.ascontiguousarray(fields.ends),
        grown=grown(horizon_s, steps),
        polar=polar,
        within=within_of(guards),
        begin=begin,
        targets=targets,
        sines=sines,
        cosines=cosines,
        dt_s=dt,
        flown=flown,
    )
    return Rollouts._make(flown[:, :, n] for n in range(6))
