"""Ten minutes of the module itself, beside two busy cores and C loops.  Asked for by `--long`."""

from __future__ import annotations

import re
import socket
import subprocess
import time
from array import array
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from . import c_reference
from .c_reference import PRIORITY, NoCompilerError
from .lengths import length
from .processes import start_module
from .result import Result
from .waking import (
    ASLEEP,
    AWAKE,
    AWAKE_NS,
    BUSY_CORES,
    PERIOD_NS,
    STARTING_S,
    busy,
    may_come_first,
)

SECONDS = 600
LATE_NS = 2_000_000


def long_run() -> Iterator[Result]:
    """The module itself beside two busy cores and C loops, with no vehicle to keep time for it.

    Only where the real-time policy is permitted.
    """
    if not may_come_first():
        print("SCHED_FIFO is not permitted here: no long run")
        return
    try:
        wake = c_reference.program("wake")
    except NoCompilerError as error:
        print(error)
        return
    count = length(SECONDS) * 1_000_000_000 // PERIOD_NS
    with (
        busy(BUSY_CORES),
        TemporaryDirectory(prefix="tgl_soar_bench_") as folder,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as nobody,
    ):
        nobody.bind(("127.0.0.1", 0))
        module = start_module(Path(folder), nobody.getsockname()[1], stderr=subprocess.PIPE)
        begin = time.monotonic_ns() + int(STARTING_S * 1e9)
        loops = [
            subprocess.Popen(
                [wake, str(count), str(PERIOD_NS), str(at), str(PRIORITY), str(awake_ns)],
                stdout=subprocess.PIPE,
            )
            for at, awake_ns in ((begin, 0), (begin + PERIOD_NS // 2, AWAKE_NS))
        ]
        lateness = [array("q", loop.communicate()[0]) for loop in loops]
        module.terminate()
        words = module.communicate()[1].decode()
    found = re.search(r"(\d+) ticks, (\d+) late", words)
    if found is None:
        raise RuntimeError(f"the module did not run: {words}")
    for whose, late in zip((ASLEEP, AWAKE), lateness, strict=True):
        yield Result(
            what=f"ticks later than 2 ms, of {found[1]}, {BUSY_CORES} busy cores",
            value=int(found[2]),
            reference=sum(ns > LATE_NS for ns in late),
            unit="",
            reference_what=f"of {len(late)} wake-ups of {whose}, at the same time",
            aim=1.0,
        )


BENCHMARKS = (long_run,)
