"""Who flies: workers of a dask cluster, on as many machines as there are (extra `cluster`).

A scheduler and workers are started by hand, by a batch system or in a container, each with this
package in the very same version:

    dask scheduler
    dask worker tcp://scheduler:8786 --nworkers -1 --nthreads 1

A worker that dies is dask's affair: it gives the shard to another.  A scheduler that restarts has
forgotten all: what had not come back is handed in again, as soon as one answers.
"""

from __future__ import annotations

import ctypes
import queue
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import lru_cache
from typing import Any, Final

from tgl_soar.sim.campaign.executors import AHEAD, Fly, Results, ShardQueue
from tgl_soar.sim.campaign.first_flight import compiling_alone
from tgl_soar.sim.campaign.flight_list import Shard
from tgl_soar.sim.campaign.provenance import libraries, source_digest

PATIENCE_S: Final = 300.0  # for a scheduler that is gone: a machine's restart
ANSWER_S: Final = 10.0  # of one that should be there
LOOK_S: Final = 1.0  # between two looks at whether it is still there
# glibc's malloc.h.  The values are above a flight's arrays (3 MB), and below what a machine lacks.
M_TRIM_THRESHOLD: Final = -1
M_MMAP_THRESHOLD: Final = -3
KEPT_BYTES: Final = 1 << 28  # of what has been released, before the system has it back
LARGE_BYTES: Final = 1 << 25  # the most that glibc itself would come to
SCHEDULER: Final = re.compile(r"((tcp|tls|ucx|wss?)://)?[^/\s]+:\d{1,5}/?")
MISSING: Final = "--scheduler needs dask: pip install 'tgl_soar[cluster]'"


class ClusterError(RuntimeError):
    """A cluster that cannot be reached, or that runs another program."""


class DaskCluster:
    """The workers of one scheduler."""

    shares_memory = False

    def __init__(self, scheduler: str, *, patience_s: float = PATIENCE_S) -> None:
        """scheduler: tcp://host:port.  Errors: ImportError without dask; `ClusterError` where
        nobody answers or no worker is there."""
        if not SCHEDULER.fullmatch(scheduler):
            raise ClusterError(
                f"{scheduler}: a scheduler is tcp://HOST:PORT, or tls://HOST:PORT; nothing has been"
                " flown"
            )
        self._scheduler = scheduler
        self._patience_s = patience_s
        client = self._client(ANSWER_S, "nothing has been flown; start one with `dask scheduler`")
        try:
            self.workers = sum(client.nthreads().values())
        finally:
            client.close()
        if not self.workers:
            raise ClusterError(f"{scheduler}: no worker is there: dask worker {scheduler}")
        self.description = f"dask at {scheduler}, {self.workers} workers"

    def fly(self, fly: Fly, shards: Iterable[Shard]) -> Results:
        """Of `Executor`."""
        shard_queue = ShardQueue(shards, AHEAD * self.workers)
        while shard_queue.left:
            client = self._client(self._patience_s, "what was flown is kept")
            try:
                yield from self._until_it_is_gone(client, fly, shard_queue)
            finally:
                client.close()

    def _until_it_is_gone(self, client: Any, fly: Fly, shards: ShardQueue) -> Results:
        """All that is left, or what comes back before the scheduler is gone."""
        from distributed import KilledWorker

        done: queue.SimpleQueue[Any] = queue.SimpleQueue()
        flying: dict[str, tuple[Any, Shard]] = {}
        ours = source_digest(), libraries()
        try:
            while True:
                for shard in shards.take():
                    future = client.submit(_fly_there, fly, shard.jobs, *ours, pure=False)
                    flying[future.key] = future, shard
                    future.add_done_callback(done.put)
                if not flying:
                    return
                future = _next(done)
                if future is None:
                    if client.status != "running":
                        shards.lost()
                        return
                    continue
                if future.status in ("cancelled", "lost"):  # of a scheduler that is gone
                    shards.lost()
                    return
                _, shard = flying.pop(future.key)
                try:
                    results = future.result()
                except KilledWorker:
                    shards.died_with(shard)
                    continue
                shards.finished(shard)
                yield shard, results
        finally:
            if client.status == "running":
                client.cancel([future for future, _ in flying.values()])

    def _client(self, patience_s: float, so_far: str) -> Any:
        try:
            from distributed import Client
        except ImportError as error:
            raise ImportError(MISSING) from error
        try:
            return Client(self._scheduler, timeout=patience_s, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise ClusterError(
                f"{self._scheduler}: no scheduler answers: {str(error) or 'in vain'}; {so_far}"
            ) from None


def _next(done: queue.SimpleQueue[Any]) -> Any:
    try:
        return done.get(timeout=LOOK_S)
    except queue.Empty:
        return None


def _fly_there(
    fly: Callable[[Any], Any], jobs: Sequence[Any], source: str, theirs: dict[str, str]
) -> list[Any]:
    """In a worker: nothing that would round otherwise than who asks; of the workers of a computer
    one compiles."""
    keep_memory()
    if source_digest() != source:
        raise ClusterError(
            f"a worker has another source ({source_digest()}) than who asks ({source}): install the"
            " same version on all machines"
        )
    here = libraries()
    other = [
        f"{name} {here.get(name) or 'none'} and not {version or 'none'}"
        for name, version in theirs.items()
        if here.get(name) != version
    ]
    if other:
        raise ClusterError(
            f"a worker flies with {', '.join(other)}, whose rounding is in every flight: install"
            " the same versions on all machines, and let their processors be of one kind"
        )
    with not_profiled():
        with compiling_alone():
            results = [fly(job) for job in jobs[:1]]
        return results + [fly(job) for job in jobs[1:]]


@contextmanager
def not_profiled() -> Iterator[None]:
    """While flights are flown dask does not look at what this worker's threads do: it would a
    hundred times a second, for some hundredths of a core.  (Elsewhere than in a worker: nothing.)
    """
    try:
        from distributed import get_worker

        worker: Any = get_worker()
    except (ImportError, ValueError):
        worker = None
    looks = worker and worker.periodic_callbacks.get("profile")  # None: it is configured away
    if looks is None:
        yield
        return
    worker.loop.add_callback(looks.stop)  # another thread's: it is asked to
    try:
        yield
    finally:
        # Another task of this worker may have begun it again.
        worker.loop.add_callback(lambda: None if looks.is_running() else looks.start())


@lru_cache(maxsize=1)
def keep_memory() -> bool:
    """Whether this process now keeps the memory of one flight for the next.

    dask's nanny starts workers with MALLOC_TRIM_THRESHOLD_=65536; any such setting also keeps
    glibc from learning which sizes come again, so that each flight's arrays are asked of the
    system again, a page fault for every 4 KiB: a fifth of a worker's time.  False where the C
    library has no such setting."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):  # another C library, another system
        return False
    return bool(mallopt(M_MMAP_THRESHOLD, LARGE_BYTES) and mallopt(M_TRIM_THRESHOLD, KEPT_BYTES))
