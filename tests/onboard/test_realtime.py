"""What is asked of the system, with the right to it and without, and how the loop sleeps."""

from __future__ import annotations

import ast
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable
from math import inf
from random import Random
from typing import Any

import pytest
from module_process import arguments

from tgl_soar.onboard import native
from tgl_soar.onboard.pacing import AWAKE_MAX_S, Pacer, Waiter
from tgl_soar.onboard.process import main
from tgl_soar.onboard.realtime import PRIORITY, clock_ns, clock_s, processors


def fifo_is_permitted() -> bool:
    code = "import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(61))"
    return subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0


needs_fifo = pytest.mark.skipif(not fifo_is_permitted(), reason="SCHED_FIFO is not permitted here")


def said(code: str) -> str:
    """By a process of its own: what is asked for changes the whole of it."""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_without_the_right_to_it_is_said_once_and_the_flight_goes_on() -> None:
    words = said(
        "import gc, os, resource\n"
        "from tgl_soar.onboard import realtime\n"
        "for limit in (resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK):\n"
        "    resource.setrlimit(limit, (0, 0))\n"
        "if os.getuid() == 0:\n"
        "    os.setuid(65534)\n"
        "realtime.raise_priority()\n"
        "print(*realtime.prepare(), sep='\\n')\n"
        "with realtime.lower_priority(realtime.RealtimeOptions()):\n"
        "    print(os.sched_getscheduler(0) == os.SCHED_OTHER, gc.isenabled())"
    ).splitlines()
    assert len(words) == 2
    assert words[0].startswith("no real-time priority and no locked memory: ticks may be late")
    assert words[1] == "True False"


def test_a_processor_that_is_not_there_is_said_too() -> None:
    words = said(
        "from tgl_soar.onboard import realtime\n"
        "print(*realtime.prepare(realtime.RealtimeOptions(processor=4000)), sep='\\n')"
    )
    assert words.startswith("processor 4000 cannot be had: running on any\n")


def test_in_simulation_nothing_is_asked_for() -> None:
    words = said(
        "import os\n"
        "from tgl_soar.onboard import realtime\n"
        "print(realtime.prepare(real_time=False), os.sched_getscheduler(0) == os.SCHED_OTHER)"
    )
    assert words == "[] True\n"


@needs_fifo
def test_the_loop_comes_first_and_its_threads_right_after_it_wherever_there_is_room() -> None:
    one = min(processors())
    words = said(
        "import os, threading\n"
        "from tgl_soar.onboard import realtime\n"
        f"options = realtime.RealtimeOptions({one})\n"
        "realtime.prepare(options)\n"
        "def show():\n"
        "    print(os.sched_getscheduler(0) == os.SCHED_FIFO,\n"
        "          os.sched_getparam(0).sched_priority, len(os.sched_getaffinity(0)))\n"
        "with realtime.lower_priority(options):\n"
        "    thread = threading.Thread(target=show)\n"
        "    thread.start()\n"
        "thread.join()\n"
        "show()"
    ).splitlines()
    assert words == [f"True {PRIORITY - 1} {len(processors())}", f"True {PRIORITY} 1"]


@needs_fifo
def test_the_guard_stops_a_child_that_spins_on_the_only_processor() -> None:
    words = said(
        "import os\n"
        "from tgl_soar.onboard import realtime, watchdog\n"
        f"os.sched_setaffinity(0, {{{min(processors())}}})\n"
        "def spin(life, became):\n"
        "    realtime.prepare()\n"
        "    if became:\n"
        "        return 0\n"
        "    life.show(True)\n"
        "    while True:\n"
        "        pass\n"
        "realtime.raise_priority()\n"
        "print(watchdog.watch(spin, lambda sign, became: print(sign.has_surfaces, became[:11]),\n"
        "                  lambda text: None))"
    ).splitlines()
    assert words == ["True stood still", "0"]


# --- sleeping ---------------------------------------------------------------------------------


@pytest.mark.parametrize("awake_s", [None, 0.0, 0.001, 1.0])
@pytest.mark.parametrize("ahead_s", [-inf, 0.0, 0.005, inf])
def test_it_wakes_at_the_deadline_and_not_before(awake_s: float | None, ahead_s: float) -> None:
    until_s = time.monotonic() + 0.01
    waiter = Waiter(time.monotonic, awake_s)
    now_s, _ = waiter.wait([-1], until_s, until_s - ahead_s)
    assert until_s <= now_s <= time.monotonic()


def test_a_deadline_that_is_past_costs_no_sleep() -> None:
    assert Waiter(lambda: 7.0).wait([], 5.0, 5.0) == (7.0, [])


@pytest.mark.parametrize("expected_s", [inf, 0.0])
def test_what_arrives_wakes_it(expected_s: float) -> None:
    far, near = os.pipe()
    try:
        os.write(near, b"!")
        waiter = Waiter(time.monotonic)
        _, ready = waiter.wait([-1, far], time.monotonic() + 1000.0, expected_s)
        assert ready == [far]
    finally:
        os.close(far)
        os.close(near)


def test_what_is_left_is_computed_last() -> None:
    """Work since the last look at the clock must not be slept on top."""
    times = iter((100.0, 200.0))
    assert Waiter(lambda: next(times)).wait([], 99.0) == (200.0, [])


class Computer:
    """Whose sleeps end late, as long as its processor takes to wake."""

    LOOK_S = 3e-6

    def __init__(self, late_s: Callable[[], float]) -> None:
        self.now_s, self.asleep_s = 0.0, 0.0
        self._late_s = late_s

    def clock(self) -> float:
        return self.now_s

    def select(self, *given: Any) -> tuple[list[int], list[int], list[int]]:
        timeout_s = given[-1]
        self.asleep_s += timeout_s
        self.now_s += timeout_s + self._late_s() if timeout_s > 0.0 else self.LOOK_S
        return [], [], []


def test_it_wakes_as_much_earlier_as_it_wakes_late(monkeypatch: pytest.MonkeyPatch) -> None:
    random = Random(1)
    computer = Computer(lambda: random.uniform(40e-6, 90e-6))
    monkeypatch.setattr(select, "select", computer.select)
    waiter = Waiter(computer.clock)
    due_s = [0.005 * i for i in range(1, 1001)]
    late_s = sorted([waiter.wait([], due, due)[0] - due for due in due_s][100:])
    assert late_s[0] >= 0.0
    assert late_s[800] <= 2 * computer.LOOK_S  # nearly all are on time
    assert late_s[-1] <= 20e-6
    assert 75e-6 <= waiter.awake_s <= 90e-6
    assert computer.asleep_s >= 0.97 * computer.now_s


def test_however_late_it_does_not_stay_awake_for_long(monkeypatch: pytest.MonkeyPatch) -> None:
    computer = Computer(lambda: 0.004)
    monkeypatch.setattr(select, "select", computer.select)
    waiter = Waiter(computer.clock)
    for _ in range(100):
        until_s = computer.now_s + 0.005
        waiter.wait([], until_s, until_s)
    assert waiter.awake_s <= AWAKE_MAX_S


def test_what_does_not_come_is_not_waited_for_awake(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sample that fails to come has its tick half a period later."""
    computer = Computer(lambda: 0.0)
    monkeypatch.setattr(select, "select", computer.select)
    now_s, ready = Waiter(computer.clock, 100e-6).wait([], 0.0075, 0.005)
    assert now_s == pytest.approx(0.0075)
    assert not ready
    assert computer.asleep_s == pytest.approx(0.0073, abs=10e-6)


def test_where_nothing_comes_any_more_it_sleeps(monkeypatch: pytest.MonkeyPatch) -> None:
    computer = Computer(lambda: 0.0)
    monkeypatch.setattr(select, "select", computer.select)
    waiter, asleep_s = Waiter(computer.clock, 200e-6), []
    for i in range(6):
        before_s = computer.asleep_s
        waiter.wait([], 0.01 * i + 0.0075, 0.01 * i + 0.005)
        computer.now_s = 0.01 * (i + 1)
        asleep_s.append(computer.asleep_s - before_s)
    assert asleep_s[1] == pytest.approx(0.0071, abs=10e-6)
    assert asleep_s[5] == pytest.approx(0.0073, abs=10e-6)  # awake before, not after


def test_told_how_long_it_stays_awake_no_longer_however_often_something_comes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    computer = Computer(lambda: 0.0)
    monkeypatch.setattr(select, "select", computer.select)
    waiter = Waiter(computer.clock, 0.002)
    for until_s in (0.0015, 0.0025, 0.003, 0.005):  # each but the last ends with something else
        waiter.wait([], until_s, 0.005)
    assert computer.asleep_s == pytest.approx(0.003, abs=20e-6)


def test_told_not_to_it_never_stays_awake(monkeypatch: pytest.MonkeyPatch) -> None:
    computer = Computer(lambda: 50e-6)
    monkeypatch.setattr(select, "select", computer.select)
    waiter = Waiter(computer.clock, 0.0)
    for i in range(1, 101):
        assert waiter.wait([], 0.005 * i, 0.005 * i)[0] == pytest.approx(0.005 * i + 50e-6)


def test_a_locked_loop_is_awake_for_its_sample_and_not_for_the_grace_after_it() -> None:
    pacer = Pacer(200.0, 0.0)
    for i in range(60):
        now_s = 0.005 * i
        pacer.sample(now_s, now_s, now_s)
        if pacer.due(now_s):
            pacer.tick(now_s)
    assert pacer.locked
    assert pacer.expected_s == pytest.approx(0.005 * 60)
    assert pacer.wake_s > pacer.expected_s


def test_time_before_the_loop_begins_is_no_delay_and_a_long_tick_is_counted() -> None:
    pacer = Pacer(200.0, 0.0)
    pacer.begin(3.0)
    assert not pacer.due(3.004)
    pacer.tick(3.005)
    pacer.done(3.005, 3.009)
    assert pacer.counters.skipped == pacer.counters.late == pacer.counters.over_run == 0
    pacer.tick(3.010)
    pacer.done(3.010, 3.0151)
    assert pacer.counters.over_run == 1


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("--cpu", "4000", "4000: must be a processor of this computer: "),
        ("--cpu", "first", "first: must be a processor of this computer: "),
        ("--spin", "2001", "2001: must be 0 to 2000 microseconds"),
        ("--spin", "nan", "nan: must be 0 to 2000 microseconds"),
        ("--spin", "a bit", "a bit: must be 0 to 2000 microseconds"),
    ],
)
def test_what_cannot_be_asked_for_is_said(
    option: str, value: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main([*arguments("udp:127.0.0.1:1"), option, value])
    assert words in capsys.readouterr().err


# --- the clock ----------------------------------------------------------------------------------

SLEWED = {"monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns", "CLOCK_MONOTONIC"}


def clocks_in(text: str) -> set[str]:
    """The names of `time` that a file uses."""
    return {
        node.attr
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) == "time"
    } | {
        name.name
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.ImportFrom) and node.module == "time"
        for name in node.names
    }


def test_the_loop_s_clock_is_the_bare_quartz() -> None:
    before_s, before_ns = (
        time.clock_gettime(time.CLOCK_MONOTONIC_RAW),
        time.clock_gettime_ns(time.CLOCK_MONOTONIC_RAW),
    )
    now_s, now_ns = clock_s(), clock_ns()
    assert before_s <= now_s <= time.clock_gettime(time.CLOCK_MONOTONIC_RAW)
    assert before_ns <= now_ns <= time.clock_gettime_ns(time.CLOCK_MONOTONIC_RAW)


def test_nothing_that_flies_looks_at_a_clock_that_is_slewed() -> None:
    files = native.sources()
    assert len(files) > 50
    slewed = {str(file): clocks_in(file.read_text()) & SLEWED for file in files}
    # Where there is no bare quartz it has to do with what there is.
    assert slewed.pop(str(native.SOURCE / "onboard/realtime.py")) == {"CLOCK_MONOTONIC"}
    assert not any(slewed.values()), slewed


def test_a_slewed_clock_would_be_found() -> None:
    assert clocks_in("import time\nnow = time.monotonic()") & SLEWED
    assert clocks_in("from time import perf_counter") & SLEWED


def test_a_wait_is_a_duration_whatever_the_clock_counts_from() -> None:
    """Kernel and loop have different clocks: what is left is asked for, never a time."""
    offset_s = 1e6
    waiter = Waiter(lambda: time.monotonic() - offset_s, 0.0)
    until_s = time.monotonic() - offset_s + 0.005
    now_s, _ = waiter.wait([], until_s)
    assert now_s >= until_s
