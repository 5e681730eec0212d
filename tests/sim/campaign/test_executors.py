"""Which process flies makes no difference, and one that dies loses nothing."""

from __future__ import annotations

import signal
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, wait
from pathlib import Path

import pytest
from cheap_flights import CheapJob, cheap_jobs, fly_cheaply

from tgl_soar.sim.campaign import executors
from tgl_soar.sim.campaign.executors import (
    ALONE_AFTER,
    DEATHS_MOST,
    Executor,
    InLine,
    LocalProcesses,
    ShardQueue,
    WorkerLost,
    local,
)
from tgl_soar.sim.campaign.flight_list import SHARD_MOST, Shard, shard_size, shards
from tgl_soar.sim.campaign.journal import InMemory
from tgl_soar.sim.campaign.run import Progress, fly_all, run


@pytest.mark.parametrize("executor", [InLine(), LocalProcesses(1), LocalProcesses(3)])
@pytest.mark.parametrize("size", [1, 7, 100])
def test_results_are_those_of_the_jobs_in_their_order(executor: Executor, size: int) -> None:
    jobs = cheap_jobs(50)
    kept = InMemory(len(jobs))
    run(fly_cheaply, jobs, executor, kept, size=size)
    assert kept.results() == [fly_cheaply(job) for job in jobs]
    assert kept.flown == 50


@pytest.mark.parametrize("place", ["wait", "submit"])
def test_ctrl_c_waits_for_the_pool(place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whose locks it would leave taken."""
    owner = executors if place == "wait" else ProcessPoolExecutor
    whole = getattr(owner, place)
    ended = []

    def interrupted(*args: object) -> object:
        signal.raise_signal(signal.SIGINT)
        result = whole(*args)
        ended.append(result)
        return result

    monkeypatch.setattr(owner, place, interrupted)
    # A shell that starts a job in the background has it ignore Ctrl-C.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            fly_all(fly_cheaply, cheap_jobs(9), LocalProcesses(2))
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert ended


def test_ctrl_c_is_left_alone_where_it_was_ignored(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*args: object) -> object:
        signal.raise_signal(signal.SIGINT)
        return wait(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(executors, "wait", interrupted)
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        flown = fly_all(fly_cheaply, cheap_jobs(9), LocalProcesses(2))
    finally:
        signal.signal(signal.SIGINT, before)
    assert flown == [fly_cheaply(job) for job in cheap_jobs(9)]


def test_flights_in_another_thread() -> None:
    """Which may set no signal's handler."""
    with ThreadPoolExecutor() as pool:
        flown = pool.submit(fly_all, fly_cheaply, cheap_jobs(9), LocalProcesses(1)).result()
    assert flown == [fly_cheaply(job) for job in cheap_jobs(9)]


def test_nothing_to_fly() -> None:
    assert fly_all(fly_cheaply, [], LocalProcesses(2)) == []
    with pytest.raises(ValueError, match="workers 0: at least 1"):
        LocalProcesses(0)
    assert isinstance(local(0), InLine)


def test_progress_tells_rate_and_time_left() -> None:
    times = iter([0.0, 0.0, 2.0, 4.0])
    reported: list[Progress] = []
    kept = InMemory(8)
    jobs = cheap_jobs(8)
    run(
        *(fly_cheaply, jobs, InLine(), kept),
        size=4,
        on_progress=reported.append,
        clock=lambda: next(times),
    )
    assert reported == [
        Progress(flown=0, of=8, per_s=0.0, left_s=float("inf")),
        Progress(flown=4, of=8, per_s=2.0, left_s=2.0),
        Progress(flown=8, of=8, per_s=2.0, left_s=0.0),
    ]


def test_a_worker_that_is_killed_loses_nothing(tmp_path: Path) -> None:
    """Two of three, one after the other, while others fly."""
    jobs = cheap_jobs(60)
    for at in (7, 31):
        (trap := tmp_path / str(at)).touch()
        jobs[at] = jobs[at]._replace(deadly=str(trap))
    kept = InMemory(len(jobs))
    run(fly_cheaply, jobs, LocalProcesses(3), kept, size=4)
    assert not list(tmp_path.iterdir())
    assert kept.flown == 60
    assert kept.results() == [fly_cheaply(job) for job in cheap_jobs(60)]


def test_flights_that_kill_worker_after_worker_are_named() -> None:
    jobs = cheap_jobs(30)
    jobs[12] = CheapJob(12, deadly="always")
    kept = InMemory(len(jobs))
    with pytest.raises(WorkerLost, match="flights 12 to 14: 5 workers died"):
        run(fly_cheaply, jobs, LocalProcesses(2), kept, size=3)
    assert kept.flown >= 12  # those before it


def test_what_a_flight_raises_is_raised() -> None:
    jobs = [*cheap_jobs(5), CheapJob(5, raises=True)]
    for executor in (InLine(), LocalProcesses(2)):
        with pytest.raises(ArithmeticError, match="seed 5"):
            fly_all(fly_cheaply, jobs, executor)


def test_shards_are_many_a_worker_and_not_too_large() -> None:
    assert shard_size(3, 8) == 1
    assert shard_size(2000, 2) == 62
    assert shard_size(1_000_000, 2) == SHARD_MOST
    found = list(shards(range(20), [range(2, 7), range(9, 10)], 3))
    assert [(s.first, list(s.jobs)) for s in found] == [(2, [2, 3, 4]), (5, [5, 6]), (9, [9])]
    assert [s.numbers for s in found] == ["flights 2 to 4", "flights 5 to 6", "flight 9"]


def queue_of(count: int, most: int) -> ShardQueue:
    return ShardQueue((Shard(i, [i]) for i in range(count)), most)


def test_who_may_have_killed_a_worker_flies_alone_in_the_end() -> None:
    queue = queue_of(4, 2)
    for _ in range(ALONE_AFTER):
        assert [s.first for s in queue.take()] == [0, 1]
        queue.died()
    (alone,) = queue.take()
    assert alone.first == 0
    assert list(queue.take()) == []
    queue.finished(alone)
    (other,) = queue.take()
    for _ in range(DEATHS_MOST - ALONE_AFTER - 1):
        queue.died()
        (other,) = queue.take()
    assert other.first == 1
    with pytest.raises(WorkerLost, match="flight 1"):
        queue.died()


def test_a_queue_that_lost_all_hands_out_all_again() -> None:
    queue = queue_of(3, 2)
    assert [s.first for s in queue.take()] == [0, 1]
    queue.lost()
    taken = list(queue.take())
    assert [s.first for s in taken] == [0, 1]
    for shard in taken:
        queue.finished(shard)
    (last,) = queue.take()
    assert queue.left
    queue.finished(last)
    assert list(queue.take()) == []
    assert not queue.left
