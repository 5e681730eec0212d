"""Descriptors 0, 1 and 2 are open before anything else is.

Started with one of them closed (`tgl-soar run … 2>&-`, some supervisors, some cron jobs), a process
would be given its number for the next thing that it opens: the serial line to the autopilot, and
into that would go whatever is meant for the console.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import Final

LAST: Final = 2  # standard error


def reserve() -> None:
    """Open /dev/null for those that are closed.  To be called before anything is opened."""
    while True:
        fd = os.open(os.devnull, os.O_RDWR)
        if fd > LAST:
            os.close(fd)
            break
        os.set_inheritable(fd, True)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:  # as Python has found it closed
            setattr(sys, name, Path(os.devnull).open(mode, encoding="utf-8"))  # noqa: SIM115
