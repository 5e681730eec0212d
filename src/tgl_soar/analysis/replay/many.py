"""Many logs replayed, one after the other on each processor, and a line about each.

As a campaign (`replay_campaign`) they leave a table of these lines, and a manifest with the logs'
names and digests.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from tgl_soar.analysis.logs.ulog_reader import LogError, read_log
from tgl_soar.analysis.replay.logged import ReplayError, replay
from tgl_soar.config.files import ConfigError
from tgl_soar.config.parameters import ParameterError
from tgl_soar.sim.campaign.executors import Executor
from tgl_soar.sim.campaign.flight_list import Campaign
from tgl_soar.sim.campaign.provenance import sha256_of
from tgl_soar.sim.campaign.run import Progress, fly_all, silent


class ReplayJob(NamedTuple):
    """One log, and with what it is replayed."""

    path: Path
    changes: tuple[tuple[str, float], ...] = ()  # of parameters
    airframe: Path | None = None
    sha256: str = ""  # of the log, for the table


class ReplayedLog(NamedTuple):
    """What came of it."""

    log: str  # its path as given
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
            log=str(job.path),
            ticks=0,
            duration_s=0.0,
            differing=(),
            left_out=0,
            losses=0,
            error=str(error),
        )
    return ReplayedLog(
        log=str(job.path),
        ticks=len(found.time_s),
        duration_s=found.duration_s,
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


def replay_campaign(
    paths: Sequence[Path], changes: tuple[tuple[str, float], ...], airframe: Path | None
) -> Campaign[ReplayJob, ReplayedLog]:
    """The replay of these logs, to be kept: a log that has changed since is another one."""
    jobs = [ReplayJob(path, changes, airframe, sha256_of(path)) for path in paths]
    parameters: dict[str, Any] = {
        "logs": [{"log": str(job.path), "sha256": job.sha256} for job in jobs],
        "changes": dict(changes),
        "airframe": "" if airframe is None else str(airframe),
        "airframe_sha256": "" if airframe is None else sha256_of(airframe),
    }
    return Campaign("replay", replay_one, jobs, parameters)
