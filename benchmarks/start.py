"""How soon the flying process speaks, and what it takes of memory."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from .processes import child_of, end, resident_mb, start_module
from .result import ALLOWED, Result

STARTS = 7
SETTLE_S = 0.5
START_ALLOWED_S = 0.6
RESIDENT_ALLOWED_MB = 60.0


def start() -> Iterator[Result]:
    """From the command line to the first heartbeat, beside an interpreter that does nothing."""
    starts, bare, resident = [], [], []
    for _ in range(STARTS):
        with TemporaryDirectory(prefix="tgl_soar_bench_") as folder:
            took_s, mb = _start(Path(folder))
        starts.append(took_s)
        resident.append(mb)
        begun = time.perf_counter()
        subprocess.run([sys.executable, "-c", "pass"], check=True)
        bare.append(time.perf_counter() - begun)
    yield Result(
        what="start to first heartbeat",
        value=median(starts),
        reference=START_ALLOWED_S,
        unit="s",
        reference_what=ALLOWED,
        aim=1.0,
    )
    yield Result(
        what="start to first heartbeat",
        value=median(starts),
        reference=median(bare),
        unit="s",
        reference_what="python -c pass",
    )
    yield Result(
        what="resident memory of the flying process, all locked",
        value=max(resident),
        reference=RESIDENT_ALLOWED_MB,
        unit="MB",
        reference_what=ALLOWED,
        aim=1.0,
    )


BENCHMARKS = (start,)


def _start(folder: Path) -> tuple[float, float]:
    """(seconds to the first heartbeat, MB of the flying process with a log)."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
        station.bind(("127.0.0.1", 0))
        station.settimeout(30.0)
        begun = time.perf_counter()
        port = station.getsockname()[1]
        process = start_module(folder, port, stderr=subprocess.DEVNULL)
        try:
            station.recv(2048)
            took_s = time.perf_counter() - begun
            time.sleep(SETTLE_S)
            return took_s, resident_mb(child_of(process.pid))
        finally:
            end(process)
