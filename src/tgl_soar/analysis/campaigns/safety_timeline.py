"""The figure of docs/safety.md: one drop-out of the position, one override by the pilot."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tgl_soar.analysis.campaigns.drawn_faults import POSE_ALONE, FaultJob, place, world_of
from tgl_soar.analysis.report.timeline_figure import Timeline, draw_timelines
from tgl_soar.autopilot import mode_name
from tgl_soar.control.target_line import e_rho
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.faults import parse_fault
from tgl_soar.sim.injection import Injection
from tgl_soar.types import NAN

BEGIN_S, END_S = 10.0, 18.0
SHOWN = (
    ("position lost for 1 s", "position.dropout start=12 for=1"),
    ("the pilot takes the aircraft", "pilot.takes start=14 for=5"),
)


def fly_timeline(title: str, text: str) -> Timeline:
    """One flight with one fault, from BEGIN_S to END_S."""
    fault = parse_fault(text)
    job = FaultJob(row=title, seed=1, turbulence=0.01, faults=(fault,), aboard=POSE_ALONE)
    injection = Injection(job.faults, job.seed)
    world = world_of(job, injection, END_S)
    loop = ClosedLoop(world, place().values, injection)
    modes: list[str] = []
    rows: list[tuple[float, float, float, float, float]] = []
    for _ in range(round(END_S * world.step_hz)):
        truth = world.truth
        output = loop.tick()
        if truth.time_s < BEGIN_S:
            continue
        line = (output.line.x_m, output.line.z_m, output.line.eta_rad)
        command = output.command.elevator if output.active else NAN
        distance = e_rho(*line, truth.x_m, truth.z_m) if output.active else NAN
        age = output.health.position_age_s
        rows.append((truth.time_s, distance, age, command, truth.elevator))
        modes.append(mode_name(output.mode))
    time, distance, age, command, surface = np.array(rows).T
    end = min(fault.end_s, END_S)
    return Timeline(
        title=title,
        fault=(fault.start_s, end),
        time_s=time,
        mode=modes,
        e_rho_m=distance,
        age_s=age,
        commanded=command,
        surface=surface,
    )


def draw_safety_timeline(path: Path) -> None:
    """Fly both and draw them.  Errors: ImportError without matplotlib."""
    draw_timelines(path, [fly_timeline(title, fault) for title, fault in SHOWN])
