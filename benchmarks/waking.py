"""How late the loop wakes, beside C loops that wake in between.

All wait for absolute deadlines 5 ms apart, each a third of a period after the other, at the same
time, under the same policy and with locked memory: whatever the machine does meets all of them.
One C loop is `clock_nanosleep`, as in cyclictest; the other sleeps until 200 µs before and waits
awake for the rest, which is the longest that ours, `pacing.Waiter` on a socket as it flies, may.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import time
from array import array
from collections.abc import Iterator
from contextlib import contextmanager

from . import c_reference
from .c_reference import PRIORITY, NoCompilerError
from .lengths import length, may_be_reported
from .processes import is_native
from .result import Result, percentile

PERIOD_NS = 5_000_000
SECONDS = 150  # 30,000 wake-ups
AWAKE_NS = 200_000  # `pacing.AWAKE_MAX_S`
ASLEEP, AWAKE = "a C loop that sleeps", "a C loop that waits awake"
BUSY_CORES = 2
STARTING_S = 1.5
FRACTIONS = (("p50", 0.5, 1.3), ("p99", 0.99, 1.3), ("p99.9", 0.999, 1.5))


def wake_ups() -> Iterator[Result]:
    """Idle, then with two busy cores."""
    try:
        c_reference.program("wake")
    except NoCompilerError as error:
        print(error)
        return
    seconds = length(SECONDS)
    for load, cores in (("idle", 0), (f"{BUSY_CORES} busy cores", BUSY_CORES)):
        with busy(cores):
            ours, asleep, awake = beside_c(seconds)
            for whose, in_c in ((AWAKE, awake), (ASLEEP, asleep)):
                for name, fraction, aim in FRACTIONS:
                    if may_be_reported(fraction, len(ours)):
                        yield Result(
                            what=f"wake-up lateness, {load}, {name}",
                            value=percentile(ours, fraction) / 1e3,
                            reference=percentile(in_c, fraction) / 1e3,
                            unit="µs",
                            reference_what=whose,
                            aim=aim,
                        )
            yield from _cyclictest(seconds, load, ours)


BENCHMARKS = (wake_ups,)


def beside_c(seconds: int) -> list[list[int]]:
    """Lateness [ns] of every wake-up: of ours, of C's that sleeps, and of C's that waits awake."""
    count = seconds * 1_000_000_000 // PERIOD_NS
    begin = time.monotonic_ns() + int(STARTING_S * 1e9)
    arguments = [str(count), str(PERIOD_NS)]
    ours = [sys.executable, "-m", "benchmarks.wake_loop", *arguments, str(begin)]
    if is_native():
        ours.append("native")
    commands = [ours]
    for third, awake_ns in ((1, 0), (2, AWAKE_NS)):
        at = begin + third * PERIOD_NS // 3
        commands.append(
            [c_reference.program("wake"), *arguments, str(at), str(PRIORITY), str(awake_ns)]
        )
    running = [subprocess.Popen(command, stdout=subprocess.PIPE) for command in commands]
    lateness = []
    for process in running:
        data = process.communicate()[0]
        if process.returncode != 0:
            raise RuntimeError(f"a loop has failed: {process.args!r}")
        lateness.append(array("q", data).tolist())
    return lateness


def may_come_first() -> bool:
    """Whether the real-time policy is permitted here."""
    try_it = f"import os; os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param({PRIORITY}))"
    command = [sys.executable, "-c", try_it]
    return subprocess.run(command, stderr=subprocess.DEVNULL).returncode == 0


@contextmanager
def busy(cores: int) -> Iterator[None]:
    """So many processes of ordinary priority that never rest."""
    spin = [sys.executable, "-c", "while True: pass"]
    running = [subprocess.Popen(spin) for _ in range(cores)]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait()


def _cyclictest(seconds: int, load: str, ours: list[int]) -> Iterator[Result]:
    """The usual tool, where it is installed."""
    tool = shutil.which("cyclictest")
    if tool is None:
        return
    loops = seconds * 1_000_000_000 // PERIOD_NS
    command = [tool, "-q", "-m", f"-p{PRIORITY}", "-i5000", f"-l{loops}", "-h10000"]
    run = subprocess.run(command, capture_output=True, text=True)
    if run.returncode == 0:
        yield Result(
            what=f"wake-up lateness, {load}, p99",
            value=percentile(ours, 0.99) / 1e3,
            reference=percentile(histogram(run.stdout), 0.99),
            unit="µs",
            reference_what="cyclictest, right after",
        )


def histogram(text: str) -> list[int]:
    """Every wake-up [µs] of a histogram of cyclictest's."""
    rows = re.findall(r"^(\d{6}) (\d{6,})$", text, re.MULTILINE)
    return [int(us) for us, count in rows for _ in range(int(count))]
