"""Programs that must not outlive whoever started them."""

from __future__ import annotations

import signal
import sys


def with_parent(command: list[str], ended_by: int = signal.SIGTERM) -> list[str]:
    """A command that the kernel ends when its parent dies, however that dies."""
    bound = f"import ctypes, os, sys; ctypes.CDLL(None).prctl(1, {int(ended_by)});"
    return [sys.executable, "-P", "-c", bound + " os.execv(sys.argv[1], sys.argv[1:])", *command]
