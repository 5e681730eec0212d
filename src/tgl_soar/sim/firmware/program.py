"""A firmware's program, run by us."""

from __future__ import annotations

import os
import signal
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path

from tgl_soar.sim.child_process import with_parent
from tgl_soar.sim.firmware import FirmwareError


def require(binary: Path) -> None:
    """Errors: `FirmwareError` where there is nothing to run."""
    if not (binary.is_file() and os.access(binary, os.X_OK)):
        raise FirmwareError(f"{binary}: there is no program")


def launch(
    binary: Path, options: Sequence[str], log: Path, settings: Mapping[str, str]
) -> subprocess.Popen[bytes]:
    """Run it in its log's folder; it ends with this process at the latest.

    `settings`: environment variables besides our own.
    """
    with log.open("wb") as printed:
        return subprocess.Popen(
            with_parent([str(binary.resolve()), *options], signal.SIGKILL),
            cwd=log.parent,
            env={**os.environ, **settings},
            stdin=subprocess.DEVNULL,
            stdout=printed,
            stderr=subprocess.STDOUT,
        )
