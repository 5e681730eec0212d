"""Many logs replayed, one after the other on each processor, and a line about each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from tgl_soar.analysis.logs.reader import LogError, read_log
from tgl_soar.analysis.replay.logged import ReplayError, replay
from tgl_soar.config.files import ConfigError
from tgl_soar.config.parameters import ParameterError
from tgl_soar.sim.campaign.executors import Executor
from tgl_soar.sim.campaign.run import Progress, fly_all, silent


class ReplayJob(NamedTuple):
    """One log, and with what it is replayed."""

    path: Path
    changes: tuple[tuple[str, float], ...] = ()  # of parameters
    airframe: Path | None = None


class ReplayedLog(NamedTuple):
    """What came of it."""

    path: Path
    ticks: int
    duration_s: float  # of the ticks
    differing: tuple[str, ...]  # fields, the largest difference first; (): the same in every bit
    left_out: int  # ticks whose state before is not in the log
    losses: int  # of the log
    error: str  # why it could not be replayed; ""


def replay_one(job: ReplayJob) -> ReplayedLog:
    """A log that cannot be replayed is a result too."""
    try:
        log = read_log(job.path)
        found = replay(log, changes=dict(job.changes), airframe=job.airframe, workers=1)
    except (LogError, ReplayError, ConfigError, ParameterError) as error:
        return ReplayedLog(
            path=job.path,
            ticks=0,
            duration_s=0.0,
            differing=(),
            left_out=0,
            losses=0,
            error=str(error),
        )
    return ReplayedLog(
        path=job.path,
        ticks=len(found.time_s),
        duration_s=found.speed * found.took_s,
        differing=tuple(difference.name for difference in found.differences),
        left_out=found.left_out,
        losses=len(log.losses),
        error="",
    )


def replay_many(
    jobs: Sequence[ReplayJob],
    executor: Executor,
    on_progress: Callable[[Progress], None] = silent,
) -> list[ReplayedLog]:
    """In the order of the jobs."""
    return fly_all(replay_one, jobs, executor, on_progress=on_progress)
