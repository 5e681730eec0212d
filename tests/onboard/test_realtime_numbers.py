"""What is asked of the system, number by number, of a system that is made up.

`test_realtime.py` asks the real one, in processes of their own.
"""

from __future__ import annotations

import ctypes
import gc
import os
import sys
from typing import Any

import pytest

from tgl_soar.onboard import realtime
from tgl_soar.onboard.realtime import RealtimeOptions

# The system is put in the place of the real one.
pytestmark = pytest.mark.interpreted

MLOCKALL_CURRENT_AND_FUTURE = 1 | 2  # sys/mman.h
PR_SET_TIMERSLACK = 29  # linux/prctl.h
ORDINARY = (os.SCHED_OTHER, 0)


class System:
    """A thread's schedule and the calls that were made, in their order."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.calls: list[Any] = []
        self.schedule = ORDINARY
        self.affinity = {0, 1, 2, 3}
        self.may_have_priority = True
        self.libc_answers = 0
        for name in ("collect", "freeze", "disable"):
            monkeypatch.setattr(gc, name, lambda *_, name=name: self.calls.append(name))
        monkeypatch.setattr(sys, "setswitchinterval", lambda s: self.calls.append(("switch", s)))
        monkeypatch.setattr(os, "sched_setscheduler", self._schedule)
        monkeypatch.setattr(os, "sched_getscheduler", lambda _pid: self.schedule[0])
        monkeypatch.setattr(os, "sched_getparam", lambda _pid: os.sched_param(self.schedule[1]))
        monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: set(self.affinity))
        monkeypatch.setattr(os, "sched_setaffinity", self._place)
        monkeypatch.setattr(os, "cpu_count", lambda: 4)
        monkeypatch.setattr(ctypes, "CDLL", lambda _name: self)

    def _schedule(self, pid: int, policy: int, parameter: os.sched_param) -> None:
        assert pid == 0
        if not self.may_have_priority:
            raise PermissionError
        self.schedule = (policy, parameter.sched_priority)

    def _place(self, pid: int, processors: Any) -> None:
        assert pid == 0
        if not set(processors) <= {0, 1, 2, 3}:
            raise OSError
        self.affinity = set(processors)

    def prctl(self, *arguments: int) -> int:
        self.calls.append(("prctl", *arguments))
        return self.libc_answers

    def mlockall(self, *arguments: int) -> int:
        self.calls.append(("mlockall", *arguments))
        return self.libc_answers


@pytest.fixture
def system(monkeypatch: pytest.MonkeyPatch) -> System:
    return System(monkeypatch)


def test_with_the_right_to_all_of_it_nothing_is_reported(system: System) -> None:
    assert realtime.prepare() == []
    assert system.schedule == (os.SCHED_FIFO, 60)
    assert system.affinity == {0, 1, 2, 3}  # no processor was asked for
    assert system.calls == [
        "collect",
        "freeze",
        "disable",
        ("switch", 50e-6),
        ("mlockall", MLOCKALL_CURRENT_AND_FUTURE),
    ]


def test_in_a_simulation_only_garbage_is_left_alone(system: System) -> None:
    assert realtime.prepare(RealtimeOptions(2), real_time=False) == []
    assert system.calls == ["collect", "freeze", "disable"]
    assert (system.schedule, system.affinity) == (ORDINARY, {0, 1, 2, 3})


@pytest.mark.parametrize(
    ("may_have_priority", "answer", "lacking"),
    [
        (False, 0, "no real-time priority:"),
        (True, -1, "no locked memory:"),
        (False, -1, "no real-time priority and no locked memory:"),
    ],
)
def test_what_could_not_be_had_is_reported_with_the_way_to_it(
    system: System, may_have_priority: bool, answer: int, lacking: str
) -> None:
    system.may_have_priority, system.libc_answers = may_have_priority, answer
    assert realtime.prepare() == [
        f"{lacking} ticks may be late when the computer is busy"
        " (give the service LimitRTPRIO=61 and LimitMEMLOCK=infinity)"
    ]
    # Without the priority the kernel's sleeps are made as exact as they can be: 1 ns.
    slack = ("prctl", PR_SET_TIMERSLACK, 1, 0, 0, 0)
    assert (slack in system.calls) is not may_have_priority


@pytest.mark.parametrize(("processor", "count"), [(3, 0), (0, 0), (4, 1)])
def test_the_loop_runs_on_the_processor_that_is_asked_for(
    system: System, processor: int, count: int
) -> None:
    words = realtime.prepare(RealtimeOptions(processor))
    assert words == ["processor 4 cannot be had: running on any"] * count
    assert system.affinity == ({0, 1, 2, 3} if count else {processor})


def test_a_system_without_such_calls_is_flown_on_too(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("sched_setscheduler", "sched_getscheduler", "sched_setaffinity"):
        monkeypatch.delattr(os, name)
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(ctypes, "CDLL", lambda _name: object())
    first, second = realtime.prepare(RealtimeOptions(1))
    assert first == "processor 1 cannot be had: running on any"
    assert second.startswith("no real-time priority and no locked memory:")
    with realtime.lower_priority(RealtimeOptions(1)):
        pass
    assert realtime.processors() == {0, 1, 2, 3}
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert realtime.processors() == {0}
    assert system.schedule == ORDINARY


def test_the_watchdog_comes_before_the_loop_and_a_simulated_world_after_it(system: System) -> None:
    realtime.raise_priority()
    assert system.schedule == (os.SCHED_FIFO, 61)
    assert system.calls == []
    assert realtime.accompany()
    assert system.schedule == (os.SCHED_FIFO, 59)
    assert system.calls == ["collect", "freeze"]
    system.may_have_priority = False
    assert not realtime.accompany()


def test_threads_start_right_after_the_loop_wherever_there_is_room_and_the_loop_goes_back(
    system: System,
) -> None:
    options = RealtimeOptions(2)
    realtime.prepare(options)
    within: list[Any] = []

    def start() -> None:
        with realtime.lower_priority(options):
            within.extend((system.schedule, system.affinity))
            raise ZeroDivisionError  # whatever happens

    with pytest.raises(ZeroDivisionError):
        start()
    assert within == [(os.SCHED_FIFO, 59), {0, 1, 2, 3}]
    assert system.schedule == (os.SCHED_FIFO, 60)
    assert system.affinity == {2}


def test_where_no_processor_was_asked_for_threads_stay_where_the_process_may_run(
    system: System,
) -> None:
    system.affinity = {1, 3}
    with realtime.lower_priority(RealtimeOptions()):
        assert system.affinity == {1, 3}
        assert system.schedule == (os.SCHED_FIFO, 59)
    assert system.affinity == {1, 3}
    assert system.schedule == ORDINARY


def test_without_the_right_to_it_nothing_is_to_be_taken_back(system: System) -> None:
    system.may_have_priority = False
    with realtime.lower_priority(RealtimeOptions(2)):
        assert system.affinity == {0, 1, 2, 3}
    assert system.schedule == ORDINARY


def test_who_asks_for_nothing_gets_any_processor_sleeps_as_it_takes_and_is_warmed_up() -> None:
    assert RealtimeOptions() == (None, None, False)
    assert realtime.SPIN_MAX_S == 0.002
    assert realtime.PRIORITY == 60
