"""Processes that are measured: how they begin and end, and what the kernel tells of them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tgl_soar.onboard import native

from .page import read_json
from .result import Result


def start_module(folder: Path, port: int, *, stderr: int) -> subprocess.Popen[bytes]:
    """`tgl-soar run` as it flies: guard, log and stored parameters, to a vehicle on a port."""
    from tgl_soar.config.files import shipped

    return subprocess.Popen(
        [
            *(sys.executable, "-m", "tgl_soar.cli", "run", "--state", str(folder)),
            *("--airframe", str(shipped("airframes/eclipson_c.toml"))),
            *("--site", str(shipped("sites/tunnel.toml"))),
            *("--link", f"udpout:127.0.0.1:{port}"),
        ],
        stderr=stderr,
    )


def is_native() -> bool:
    """Whether this process has taken native code of what flies."""
    return native.words().startswith("native")


def by_the_source(group: str) -> list[Result]:
    """A group of benchmarks in a process that takes no native code."""
    with TemporaryDirectory(prefix="tgl_soar_bench_") as folder:
        kept = Path(folder) / "results.json"
        command = [sys.executable, "-m", "benchmarks", "--interpreted", "--only", group]
        subprocess.run([*command, "--json", str(kept)], check=True, stdout=subprocess.DEVNULL)
        return read_json(kept)


def child_of(guard: int) -> int:
    """The process that flies, under its guard."""
    (child,) = Path(f"/proc/{guard}/task/{guard}/children").read_text().split()
    return int(child)


def cpu_s(pid: int) -> float:
    """Seconds of a processor so far, user's and system's, of all threads."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_mb(pid: int) -> float:
    """Memory that is really there."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    (line,) = (line for line in lines if line.startswith("VmRSS:"))
    return int(line.split()[1]) / 1024.0


def end(process: subprocess.Popen[Any], number: signal.Signals = signal.SIGTERM) -> None:
    """Ask it to end, and wait until it has."""
    if process.poll() is None:
        process.send_signal(number)
    process.wait()
