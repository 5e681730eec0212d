"""Flying what is missing of a campaign, whoever flies it and wherever its flights are kept."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import closing
from typing import Any, NamedTuple, TypeVar

from tgl_soar.sim.campaign.executors import Executor
from tgl_soar.sim.campaign.flight_list import shard_size, shards
from tgl_soar.sim.campaign.journal import FlightsKept, InMemory

Job = TypeVar("Job")
Flown = TypeVar("Flown")


class Progress(NamedTuple):
    """How far it is."""

    flown: int
    of: int
    per_s: float  # flights a second, since this run began; 0: none yet
    left_s: float  # at that rate; inf: not known yet


OnProgress = Callable[[Progress], None]


def silent(_progress: Progress) -> None:
    """Nobody looks on."""


def run(
    fly: Callable[[Any], Any],
    jobs: Sequence[Any],
    executor: Executor,
    kept: FlightsKept,
    *,
    on_progress: OnProgress = silent,
    size: int | None = None,
    first_here: bool = False,
    clock: Callable[[], float] = time.monotonic,
) -> None:
    """Fly what `kept` has not yet.

    size: flights in a shard; None: by their number.  first_here: the first of them in this
    process, so that those which are split off from it find what it has compiled and loaded.
    Errors: what a flight raises, `WorkerLost`, `JournalError`; all that was flown before is kept.
    """
    began, before = clock(), kept.flown

    def tell() -> None:
        new, took = kept.flown - before, clock() - began
        rate = new / took if took > 0.0 else 0.0
        left = (len(jobs) - kept.flown) / rate if rate else float("inf")
        on_progress(Progress(kept.flown, len(jobs), rate, left))

    tell()
    missing = kept.missing()
    if first_here and missing and executor.shares_memory:
        first = missing[0].start
        kept.put(first, [fly(jobs[first])])
        tell()
        missing = kept.missing()
    if not missing:
        return
    size = size or shard_size(sum(map(len, missing)), executor.workers)
    with closing(executor.fly(fly, shards(jobs, missing, size))) as flown:
        for shard, results in flown:
            kept.put(shard.first, results)
            tell()


def fly_all(
    fly: Callable[[Job], Flown],
    jobs: Sequence[Job],
    executor: Executor,
    *,
    on_progress: OnProgress = silent,
    first_here: bool = False,
) -> list[Flown]:
    """All flights in memory, in the order of their jobs.  Errors: those of `run`."""
    kept = InMemory(len(jobs))
    run(fly, jobs, executor, kept, on_progress=on_progress, first_here=first_here)
    return kept.results()
