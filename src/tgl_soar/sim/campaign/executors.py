"""Who flies: this process, or processes of this machine.  (Several machines: `cluster`.)

An executor takes shards as it has room for them and gives each back with its results, in whatever
order they are finished.  A worker that dies takes nothing with it: its flights are flown again,
and since a flight depends on its job alone the results are those that it would have given.
"""

from __future__ import annotations

import os
import signal
import threading
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import connection, get_all_start_methods, get_context, parent_process
from multiprocessing.context import BaseContext
from typing import Any, Final, Protocol

from tgl_soar.sim.campaign.flight_list import Shard
from tgl_soar.sim.campaign.interrupts import interrupts_later

AHEAD: Final = 2  # shards handed to each worker: one that is flown and one that waits
# A worker may be killed for reasons of its own (memory, an administrator): its flights are flown
# again among others, then alone, and only who kills worker after worker alone is given up.
ALONE_AFTER: Final = 2
DEATHS_MOST: Final = 5
LOOK_S: Final = 0.2  # between two looks at whether Ctrl-C was pressed

Fly = Callable[[Any], Any]
Results = Generator[tuple[Shard, list[Any]], None, None]


class WorkerLost(RuntimeError):
    """Flights whose workers die again and again."""


class Executor(Protocol):
    """Whoever flies shards."""

    @property
    def workers(self) -> int:
        """How many shards are flown at once."""
        ...

    @property
    def description(self) -> str:
        """For a manifest."""
        ...

    @property
    def shares_memory(self) -> bool:
        """Whether workers hold what this process has compiled and loaded."""
        ...

    def fly(self, fly: Fly, shards: Iterable[Shard]) -> Results:
        """Every shard once with its results, as they are finished.

        Errors: what a flight raises; `WorkerLost`.  When the iterator is closed, flights that are
        under way are given up.
        """
        ...


class InLine:
    """This process."""

    workers = 1
    description = "in line"
    shares_memory = True

    def fly(self, fly: Fly, shards: Iterable[Shard]) -> Results:
        """One after the other."""
        for shard in shards:
            yield shard, [fly(job) for job in shard.jobs]


class LocalProcesses:
    """Processes of this machine, made for each list of flights and gone with it.

    Where the system can fork they hold all that this process has compiled and loaded so far.
    """

    shares_memory = True

    def __init__(self, workers: int) -> None:
        """Errors: ValueError for none."""
        if workers < 1:
            raise ValueError(f"workers {workers}: at least 1")
        self.workers = workers
        self.description = f"{workers} local processes"

    def fly(self, fly: Fly, shards: Iterable[Shard]) -> Results:
        """Of `Executor`."""
        queue = ShardQueue(shards, AHEAD * self.workers)
        while queue.left:
            yield from self._until_one_dies(fly, queue)

    def _until_one_dies(self, fly: Fly, queue: ShardQueue) -> Results:
        """All that is left, or what one set of processes makes of it."""
        context = _context()
        stopping = context.RawValue("b", 0)  # no lock: whoever holds one might be killed
        pool = ProcessPoolExecutor(self.workers, context, _begin, (fly, stopping))
        flying: dict[Future[list[Any]], Shard] = {}
        try:
            while True:
                # The pool shares locks with a thread of its own.  A KeyboardInterrupt between the
                # taking of one and the statement that gives it back leaves it taken, and the
                # shutdown waits for ever.
                with interrupts_later():
                    for shard in queue.take():
                        flying[pool.submit(_fly_shard, shard.jobs)] = shard
                    done, _ = wait(flying, LOOK_S, FIRST_COMPLETED)
                if not flying:
                    return
                for future in done:
                    results = future.result()
                    shard = flying.pop(future)
                    queue.finished(shard)
                    yield shard, results
        except BrokenProcessPool:
            queue.died()
        finally:
            stopping.value = 1
            pool.shutdown(cancel_futures=True)


class ShardQueue:
    """Shards that wait and are flown, and how often their worker died."""

    def __init__(self, shards: Iterable[Shard], most: int) -> None:
        """most: at once."""
        self._shards = iter(shards)
        self._most = most
        self._lost: list[Shard] = []  # to be flown again
        self._flying: dict[int, Shard] = {}
        self._deaths: Counter[int] = Counter()
        self._exhausted = False

    @property
    def left(self) -> bool:
        """Whether anything is to be flown."""
        return bool(self._lost or self._flying) or not self._exhausted

    def take(self) -> Iterator[Shard]:
        """Those for which there is room now."""
        while len(self._flying) < self._most and not self._one_flies_alone():
            shard = self._next()
            if shard is None:
                return
            if self._is_suspect(shard) and self._flying:
                self._lost.insert(0, shard)
                return
            self._flying[shard.first] = shard
            yield shard

    def finished(self, shard: Shard) -> None:
        """One was flown."""
        del self._flying[shard.first]

    def died(self) -> None:
        """A worker, and nobody knows which: all under way are flown again.  Errors: `WorkerLost`
        where it was alone with its shard, and not for the first time."""
        self._deaths.update(list(self._flying))
        for first, shard in self._flying.items():
            if self._deaths[first] >= DEATHS_MOST and len(self._flying) == 1:
                raise WorkerLost(
                    f"{shard.numbers}: {DEATHS_MOST} workers died of it, the last ones with nothing"
                    " else to fly: killed for want of memory, or by native code that crashes?"
                    " Fly it with --workers 0 to see"
                )
        self.lost()

    def died_with(self, shard: Shard) -> None:
        """As many workers as the cluster allows, all of one shard.  Errors: `WorkerLost`."""
        del self._flying[shard.first]
        self._deaths[shard.first] += 1
        if self._deaths[shard.first] > ALONE_AFTER:
            raise WorkerLost(f"{shard.numbers}: worker after worker dies of it")
        self._lost.append(shard)

    def lost(self) -> None:
        """All under way, by no fault of theirs."""
        again = [*self._lost, *self._flying.values()]
        self._lost = sorted(again, key=lambda shard: self._deaths[shard.first])
        self._flying.clear()

    def _next(self) -> Shard | None:
        if self._lost:
            return self._lost.pop(0)
        shard = next(self._shards, None)
        self._exhausted |= shard is None
        return shard

    def _is_suspect(self, shard: Shard) -> bool:
        return self._deaths[shard.first] >= ALONE_AFTER

    def _one_flies_alone(self) -> bool:
        return any(map(self._is_suspect, self._flying.values()))


def local(workers: int) -> Executor:
    """So many processes; 0: this one."""
    return InLine() if workers == 0 else LocalProcesses(workers)


def _context() -> BaseContext:
    return get_context("fork" if "fork" in get_all_start_methods() else None)


# --- in a worker ----------------------------------------------------------------------------------

_work: dict[str, Any] = {}  # of this process


def _begin(fly: Fly, stopping: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's affair
    _work.update(fly=fly, stopping=stopping)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """Nobody is left to take the results of a worker whose parent was killed."""
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def _fly_shard(jobs: Iterable[Any]) -> list[Any]:
    results = []
    for job in jobs:
        if _work["stopping"].value:
            break  # nobody waits for them
        results.append(_work["fly"](job))
    return results
