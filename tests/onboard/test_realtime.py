"""What is asked of the system, with the right to it and without, and how the loop sleeps."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import time
from math import inf

import pytest

from tgl_soar.onboard import native
from tgl_soar.onboard.pacing import Waiter
from tgl_soar.onboard.realtime import PRIORITY, clock_ns, clock_s, processors


def fifo_is_permitted() -> bool:
    code = "import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(61))"
    return subprocess.run([sys.executable, "-c", code], capture_output=True).returncode == 0


needs_fifo = pytest.mark.skipif(not fifo_is_permitted(), reason="SCHED_FIFO is not permitted here")


def printed(code: str) -> str:
    """By a process of its own: what is asked for changes the whole of it."""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_without_the_right_to_it_is_reported_once_and_the_flight_goes_on() -> None:
    words = printed(
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


def test_a_processor_that_is_not_there_is_reported_too() -> None:
    words = printed(
        "from tgl_soar.onboard import realtime\n"
        "print(*realtime.prepare(realtime.RealtimeOptions(processor=4000)), sep='\\n')"
    )
    assert words.startswith("processor 4000 cannot be had: running on any\n")


def test_in_simulation_nothing_is_asked_for() -> None:
    words = printed(
        "import os\n"
        "from tgl_soar.onboard import realtime\n"
        "print(realtime.prepare(real_time=False), os.sched_getscheduler(0) == os.SCHED_OTHER)"
    )
    assert words == "[] True\n"


@needs_fifo
def test_the_loop_comes_first_and_its_threads_right_after_it_wherever_there_is_room() -> None:
    one = min(processors())
    words = printed(
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
    words = printed(
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
