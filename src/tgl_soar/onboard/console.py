"""Words of the flying process for whoever looks at its console."""

from __future__ import annotations

import os
import select


def say(text: str) -> None:
    """A line on standard error, or none if nobody reads it: the loop must not wait."""
    line = f"tgl_soar: {text}\n".encode(errors="replace")  # a file's name may be no UTF-8
    try:
        if select.select([], [2], [], 0.0)[1]:
            os.write(2, line[: select.PIPE_BUF])
    except OSError:
        return
