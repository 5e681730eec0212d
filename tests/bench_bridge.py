"""A simulated Pixhawk in a process of its own, for the commands that talk with one."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from free_ports import free_port

from tgl_soar.config.files import shipped

AIRFRAME = shipped("airframes/eclipson_c.toml")
PATIENCE_S = 120.0  # for what takes some seconds, were the machine not busy with other things


@contextmanager
def bridge(log: Path, *parameters: str, launch: str = "bench") -> Iterator[str]:
    """The link to it.  `parameters`: NAME=NUMBER, of the autopilot."""
    companion = f"127.0.0.1:{free_port()}"
    command = [
        *(sys.executable, "-m", "tgl_soar.sim.bridge", "--launch", launch),
        *("--airframe", str(AIRFRAME), "--site", str(shipped("sites/tunnel.toml"))),
        *("--companion", companion, "--companion-local", "127.0.0.1:0"),
        *("--gcs", f"127.0.0.1:{free_port()}", "--gcs-local", "127.0.0.1:0"),
        *(word for given in parameters for word in ("--autopilot-parameter", given)),
    ]
    with log.open("wb") as file:
        running = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)
    try:
        yield f"udp:{companion}"
    finally:
        running.terminate()
        running.wait(PATIENCE_S)
