"""How flights are handed to a cluster's scheduler and come back, whatever becomes of it and of its
workers: a scheduler in this process, which flies what it is handed when it is asked for it."""

from __future__ import annotations

import queue
import sys
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from cheap_flights import CheapJob, cheap_jobs, fly_cheaply

from tgl_soar.sim.campaign import cluster
from tgl_soar.sim.campaign.cluster import MISSING, SCHEDULER, ClusterError, DaskCluster
from tgl_soar.sim.campaign.executors import WorkerLost
from tgl_soar.sim.campaign.flight_list import Shard
from tgl_soar.sim.campaign.provenance import libraries, source_digest

ADDRESS = "tcp://there:8786"


class KilledWorker(Exception):
    """As dask says that workers die of something."""


class Handed:
    """A task of a scheduler."""

    def __init__(self, key: str, task: Callable[[], Any]) -> None:
        self.key, self.task = key, task
        self.status = "pending"
        self.first = 0
        self.tell: Callable[[Handed], None] = lambda _: None

    def add_done_callback(self, tell: Callable[[Handed], None]) -> None:
        self.tell = tell

    def result(self) -> Any:
        return self.task()


class Scheduler:
    """One that may be restarted: each connection is of one life."""

    def __init__(self) -> None:
        self.threads = {"one": 1, "two": 2}
        self.asked: list[dict[str, Any]] = []  # how it was connected to
        self.connections: list[SimpleNamespace] = []
        self.handed: list[Handed] = []
        self.cancelled: list[str] = []
        self.given: list[tuple[Any, ...]] = []  # with each task
        self.error: Exception | None = None
        self.events: list[Callable[[Handed], None]] = []  # what becomes of the next tasks

    def connect(self, address: str, **how: Any) -> SimpleNamespace:
        self.asked.append({"address": address, **how})
        if self.error is not None:
            raise self.error
        connection = SimpleNamespace(status="running", closed=0)
        connection.nthreads = lambda: self.threads
        connection.submit = self.submit
        connection.cancel = lambda tasks: self.cancelled.extend(task.key for task in tasks)
        connection.close = lambda: setattr(connection, "closed", connection.closed + 1)
        self.connections.append(connection)
        return connection

    def submit(self, call: Any, *arguments: Any, pure: bool) -> Handed:
        assert not pure
        task = Handed(f"task{len(self.given)}", lambda: call(*arguments))
        self.given.append(arguments)
        self.handed.append(task)
        return task

    def work(self) -> None:
        """One task that was handed in is flown; or the next event becomes of it."""
        if not self.handed:
            return
        task = self.handed.pop(0)
        if self.events:
            self.events.pop(0)(task)
        else:
            task.status = "finished"
            task.tell(task)


@pytest.fixture
def scheduler(monkeypatch: pytest.MonkeyPatch) -> Scheduler:
    made = Scheduler()
    module = SimpleNamespace(Client=made.connect, KilledWorker=KilledWorker)
    monkeypatch.setitem(sys.modules, "distributed", module)

    def waited(done: queue.SimpleQueue[Any]) -> Any:
        if done.empty():
            made.work()
        return None if done.empty() else done.get()

    monkeypatch.setattr(cluster, "_next", waited)
    return made


def shards(count: int) -> Iterator[Shard]:
    for i in range(count):
        yield Shard(2 * i, cheap_jobs(2 * i + 2)[2 * i :])


def flown(executor: DaskCluster, count: int) -> dict[int, list[Any]]:
    return {shard.first: results for shard, results in executor.fly(fly_cheaply, shards(count))}


def expected(count: int) -> dict[int, list[Any]]:
    return {s.first: [fly_cheaply(job) for job in s.jobs] for s in shards(count)}


# --- a connection ---------------------------------------------------------------------------------


def test_workers_are_counted_by_their_threads(scheduler: Scheduler) -> None:
    executor = DaskCluster(ADDRESS)
    assert executor.workers == 3
    assert executor.description == "dask at tcp://there:8786, 3 workers"
    assert scheduler.asked == [{"address": ADDRESS, "timeout": 10.0, "set_as_default": False}]
    assert [connection.closed for connection in scheduler.connections] == [1]


def test_without_a_worker_it_is_reported_how_to_start_one(scheduler: Scheduler) -> None:
    scheduler.threads = {}
    with pytest.raises(ClusterError, match=f"{ADDRESS}: no worker is there: dask worker {ADDRESS}"):
        DaskCluster(ADDRESS)
    assert scheduler.connections[0].closed == 1


@pytest.mark.parametrize(
    ("error", "why"),
    [
        (OSError("refused"), "refused"),
        (TimeoutError("late"), "late"),
        (TimeoutError(), "in vain"),
        (ValueError("bad address"), "bad address"),
    ],
)
def test_who_does_not_answer_is_named_with_what_to_do(
    scheduler: Scheduler, error: Exception, why: str
) -> None:
    scheduler.error = error
    refusal = f"{ADDRESS}: no scheduler answers: {why}; nothing has"
    with pytest.raises(
        ClusterError, match=f"{refusal} been flown; start one with `dask scheduler`"
    ):
        DaskCluster(ADDRESS)


@pytest.mark.parametrize("address", ["nonsense", "127.0.0.1", "http://there:8786", "tcp://there"])
def test_an_address_that_is_none_is_reported_at_once(address: str) -> None:
    with pytest.raises(ClusterError, match=f"{address}: a scheduler is tcp://HOST:PORT"):
        DaskCluster(address)


@pytest.mark.parametrize(
    "address", ["127.0.0.1:8786", "tcp://[::1]:8786", "tls://there:8786", "wss://there:443/"]
)
def test_what_dask_takes_is_an_address(address: str) -> None:
    assert SCHEDULER.fullmatch(address)


def test_without_dask_it_is_reported_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert MISSING == "--scheduler needs dask: pip install 'tgl_soar[cluster]'"
    with pytest.raises(ImportError, match="--scheduler needs dask: pip install"):
        DaskCluster(ADDRESS)


# --- flights --------------------------------------------------------------------------------------


def test_every_shard_comes_back_once_with_its_results(scheduler: Scheduler) -> None:
    executor = DaskCluster(ADDRESS, patience_s=50.0)
    assert flown(executor, 10) == expected(10)
    assert scheduler.asked[-1] == {"address": ADDRESS, "timeout": 50.0, "set_as_default": False}
    assert [connection.closed for connection in scheduler.connections] == [1, 1]
    assert all(given[2:] == (source_digest(), libraries()) for given in scheduler.given)
    assert len(scheduler.given) == 10
    assert scheduler.cancelled == []


def test_two_shards_are_handed_in_for_each_worker(scheduler: Scheduler) -> None:
    executor = DaskCluster(ADDRESS)
    flights = executor.fly(fly_cheaply, shards(20))
    next(flights)
    assert len(scheduler.given) == 6
    next(flights)
    assert len(scheduler.given) == 7


def test_who_stops_early_has_the_rest_given_up(scheduler: Scheduler) -> None:
    flights = DaskCluster(ADDRESS).fly(fly_cheaply, shards(20))
    next(flights)
    flights.close()
    assert scheduler.cancelled == [f"task{i}" for i in range(1, 6)]
    assert scheduler.connections[-1].closed == 1


def test_of_a_scheduler_that_is_gone_all_is_handed_in_again(scheduler: Scheduler) -> None:
    """It has lost what had not come back, and nothing is asked of it at the end."""

    def goes(_task: Handed) -> None:
        scheduler.handed.clear()
        scheduler.connections[-1].status = "closed"

    executor = DaskCluster(ADDRESS)
    scheduler.events = [lambda task: task.tell(task), goes]
    assert flown(executor, 8) == expected(8)
    assert [connection.closed for connection in scheduler.connections] == [1, 1, 1]
    assert scheduler.cancelled == []
    assert len(scheduler.given) == 7 + 7  # of the first life: six, and one for the first that came


@pytest.mark.parametrize("status", ["cancelled", "lost"])
def test_a_task_that_its_scheduler_forgot_is_handed_in_again(
    scheduler: Scheduler, status: str
) -> None:
    def forgets(task: Handed) -> None:
        scheduler.handed.clear()
        task.status = status
        task.tell(task)

    executor = DaskCluster(ADDRESS)
    scheduler.events = [forgets]
    assert flown(executor, 3) == expected(3)
    assert len(scheduler.given) == 6
    assert len(scheduler.connections) == 3


def test_one_of_which_nothing_is_received_yet_is_waited_for(scheduler: Scheduler) -> None:
    def later(task: Handed) -> None:
        scheduler.handed.append(task)

    executor = DaskCluster(ADDRESS)
    scheduler.events = [later, later]
    assert flown(executor, 2) == expected(2)
    assert len(scheduler.given) == 2


def test_what_kills_workers_is_flown_again_and_given_up_at_last(scheduler: Scheduler) -> None:
    def dies(task: Handed) -> None:
        def killed() -> None:
            raise KilledWorker

        task.task = killed
        task.tell(task)

    executor = DaskCluster(ADDRESS)
    scheduler.events = [dies]
    assert flown(executor, 3) == expected(3)
    scheduler.events = [dies] * 9
    with pytest.raises(WorkerLost, match="worker after worker dies of it"):
        flown(executor, 1)


def test_what_a_flight_raises_is_raised(scheduler: Scheduler) -> None:
    executor = DaskCluster(ADDRESS)
    with pytest.raises(ArithmeticError, match="seed 5"):
        list(executor.fly(fly_cheaply, [Shard(5, [CheapJob(5, raises=True)])]))
    assert scheduler.connections[-1].closed == 1


# --- one look -------------------------------------------------------------------------------------


def test_a_look_finds_what_is_there_or_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cluster, "LOOK_S", 0.0)
    done: queue.SimpleQueue[Any] = queue.SimpleQueue()
    assert cluster._next(done) is None
    done.put("task")
    assert cluster._next(done) == "task"
    assert cluster._next(done) is None
