"""Ten minutes of the module itself, beside two busy cores and a C loop.  Asked for by `--long`."""

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
from .processes import start_module
from .result import Result
from .waking import BUSY_CORES, PERIOD_NS, STARTING_S, busy, may_come_first

LATE_NS = 2_000_000


def long_run(seconds: int = 600) -> Iterator[Result]:
    """The module itself beside two busy cores and a C loop, with no vehicle to keep time for it.

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
    count = seconds * 1_000_000_000 // PERIOD_NS
    with (
        busy(BUSY_CORES),
        TemporaryDirectory(prefix="tgl_soar_bench_") as folder,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as nobody,
    ):
        nobody.bind(("127.0.0.1", 0))
        module = start_module(Path(folder), nobody.getsockname()[1], stderr=subprocess.PIPE)
        begin = time.monotonic_ns() + int(STARTING_S * 1e9)
        arguments = [str(count), str(PERIOD_NS), str(begin), str(PRIORITY)]
        in_c = subprocess.run([wake, *arguments], stdout=subprocess.PIPE, check=True)
        module.terminate()
        words = module.communicate()[1].decode()
    found = re.search(r"(\d+) ticks, (\d+) late", words)
    if found is None:
        raise RuntimeError(f"the module did not run: {words}")
    yield Result(
        what=f"ticks later than 2 ms, of {found[1]}, {BUSY_CORES} busy cores",
        value=int(found[2]),
        reference=sum(ns > LATE_NS for ns in array("q", in_c.stdout)),
        unit="",
        reference_what=f"of {count} wake-ups of a C loop at the same time",
        aim=1.0,
    )


BENCHMARKS = (long_run,)
