"""What is asked of the system, with the right to it and without, and how the loop sleeps."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from math import inf

import pytest
from module_process import arguments

from tgl_soar.process import main
from tgl_soar.realtime import PRIORITY, Pacer, processors, wait


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
        "from tgl_soar import realtime\n"
        "for limit in (resource.RLIMIT_RTPRIO, resource.RLIMIT_MEMLOCK):\n"
        "    resource.setrlimit(limit, (0, 0))\n"
        "if os.getuid() == 0:\n"
        "    os.setuid(65534)\n"
        "realtime.go_first()\n"
        "print(*realtime.prepare(), sep='\\n')\n"
        "with realtime.behind(realtime.Wishes()):\n"
        "    print(os.sched_getscheduler(0) == os.SCHED_OTHER, gc.isenabled())"
    ).splitlines()
    assert len(words) == 2
    assert words[0].startswith("no real-time priority and no locked memory: ticks may be late")
    assert words[1] == "True False"


def test_a_processor_that_is_not_there_is_said_too() -> None:
    words = said(
        "from tgl_soar import realtime\n"
        "print(*realtime.prepare(realtime.Wishes(processor=4000)), sep='\\n')"
    )
    assert words.startswith("processor 4000 cannot be had: running on any\n")


def test_in_simulation_nothing_is_asked_for() -> None:
    words = said(
        "import os\n"
        "from tgl_soar import realtime\n"
        "print(realtime.prepare(real_time=False), os.sched_getscheduler(0) == os.SCHED_OTHER)"
    )
    assert words == "[] True\n"


@needs_fifo
def test_the_loop_comes_first_and_its_threads_right_after_it_wherever_there_is_room() -> None:
    one = min(processors())
    words = said(
        "import os, threading\n"
        "from tgl_soar import realtime\n"
        f"wishes = realtime.Wishes({one})\n"
        "realtime.prepare(wishes)\n"
        "def show():\n"
        "    print(os.sched_getscheduler(0) == os.SCHED_FIFO,\n"
        "          os.sched_getparam(0).sched_priority, len(os.sched_getaffinity(0)))\n"
        "with realtime.behind(wishes):\n"
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
        "from tgl_soar import guard, realtime\n"
        f"os.sched_setaffinity(0, {{{min(processors())}}})\n"
        "def spin(life, became):\n"
        "    realtime.prepare()\n"
        "    if became:\n"
        "        return 0\n"
        "    life.show(True)\n"
        "    while True:\n"
        "        pass\n"
        "realtime.go_first()\n"
        "print(guard.watch(spin, lambda sign, became: print(sign.has_surfaces, became[:11]),\n"
        "                  lambda text: None))"
    ).splitlines()
    assert words == ["True stood still", "0"]


# --- sleeping ---------------------------------------------------------------------------------


@pytest.mark.parametrize("spin_s", [-inf, 0.001, 1.0])
def test_it_wakes_at_the_deadline_and_not_before(spin_s: float) -> None:
    until_s = time.monotonic() + 0.01
    now_s, _ = wait([-1], until_s, time.monotonic, until_s - spin_s)
    assert until_s <= now_s <= time.monotonic()


def test_a_deadline_that_is_past_costs_no_sleep() -> None:
    assert wait([], 5.0, lambda: 7.0) == (7.0, [])


@pytest.mark.parametrize("awake_s", [inf, 0.0])
def test_what_arrives_wakes_it(awake_s: float) -> None:
    far, near = os.pipe()
    try:
        os.write(near, b"!")
        _, ready = wait([-1, far], time.monotonic() + 1000.0, time.monotonic, awake_s)
        assert ready == [far]
    finally:
        os.close(far)
        os.close(near)


def test_what_is_left_is_computed_last() -> None:
    """Work since the last look at the clock must not be slept on top."""
    times = iter((100.0, 200.0))
    assert wait([], 99.0, lambda: next(times)) == (200.0, [])


def test_it_stays_awake_before_what_is_expected() -> None:
    """Asked how late it is until the time has come, without a sleep in between."""
    times = iter((1.0, 1.1, 1.2, 2.0))
    assert wait([], 2.0, lambda: next(times), 1.0) == (2.0, [])
    assert next(times, None) is None


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
