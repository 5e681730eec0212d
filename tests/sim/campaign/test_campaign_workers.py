"""What happens inside a worker: flights while they are wanted, signals that are the parent's
affair, an end with the parent, and memory that is kept."""

from __future__ import annotations

import ctypes
import os
import signal
from collections.abc import Iterator
from multiprocessing import connection
from types import SimpleNamespace
from typing import Any

import pytest
from cheap_flights import cheap_jobs, fly_cheaply

from tgl_soar.sim.campaign import cluster, executors


@pytest.fixture
def work() -> Iterator[dict[str, Any]]:
    before = dict(executors._work)
    yield executors._work
    executors._work.clear()
    executors._work.update(before)


def test_a_shard_is_flown_job_by_job(work: dict[str, Any]) -> None:
    work.update(fly=fly_cheaply, stopping=SimpleNamespace(value=0))
    jobs = cheap_jobs(4)
    assert executors._fly_shard(jobs) == [fly_cheaply(job) for job in jobs]


def test_flights_that_nobody_waits_for_are_not_begun(work: dict[str, Any]) -> None:
    stopping = SimpleNamespace(value=0)

    def fly(job: int) -> int:
        stopping.value = int(job == 2)
        return 10 * job

    work.update(fly=fly, stopping=stopping)
    assert executors._fly_shard([1, 2, 3, 4]) == [10, 20]
    assert executors._fly_shard([1]) == []


def test_a_worker_begins_without_ctrl_c_and_watches_its_parent(
    work: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    begun: list[Any] = []

    class Thread:
        def __init__(self, *, target: Any, daemon: bool) -> None:
            self.given = target, daemon

        def start(self) -> None:
            begun.append(self.given)

    monkeypatch.setattr(executors, "threading", SimpleNamespace(Thread=Thread))
    before = signal.getsignal(signal.SIGINT)
    try:
        executors._begin(fly_cheaply, "flag")
        assert signal.getsignal(signal.SIGINT) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)
    assert work == {"fly": fly_cheaply, "stopping": "flag"}
    assert begun == [(executors._end_with_parent, True)]


def test_a_worker_ends_when_its_parent_has_and_one_without_a_parent_goes_on(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done: list[Any] = []
    monkeypatch.setattr(connection, "wait", lambda given: done.append(("waits", given)))
    monkeypatch.setattr(os, "_exit", lambda code: done.append(("ends", code)))
    monkeypatch.setattr(executors, "parent_process", lambda: None)
    executors._end_with_parent()
    assert done == []
    monkeypatch.setattr(executors, "parent_process", lambda: SimpleNamespace(sentinel=7))
    executors._end_with_parent()
    assert done == [("waits", [7]), ("ends", 1)]


# --- memory ---------------------------------------------------------------------------------------


def kept(monkeypatch: pytest.MonkeyPatch, library: Any) -> bool:
    monkeypatch.setattr(ctypes, "CDLL", library)
    return cluster.keep_memory.__wrapped__()


@pytest.mark.parametrize("refused", [None, -3, -1])
def test_memory_is_kept_where_the_c_library_takes_both_settings(
    monkeypatch: pytest.MonkeyPatch, refused: int | None
) -> None:
    asked: list[tuple[int, int]] = []

    def mallopt(setting: int, value: int) -> int:
        asked.append((setting, value))
        return int(setting != refused)

    assert kept(monkeypatch, lambda _: SimpleNamespace(mallopt=mallopt)) == (refused is None)
    assert asked[0] == (-3, 32 << 20)  # glibc's M_MMAP_THRESHOLD: a flight's arrays are below it
    assert asked[1:] == ([] if refused == -3 else [(-1, 256 << 20)])  # M_TRIM_THRESHOLD


def test_another_c_library_keeps_none(monkeypatch: pytest.MonkeyPatch) -> None:
    def none(_: object) -> None:
        raise OSError("no such library")

    assert not kept(monkeypatch, lambda _: SimpleNamespace())
    assert not kept(monkeypatch, none)
