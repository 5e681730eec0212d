"""The first flight of a process, which may compile for minutes, beside others of its computer."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from fcntl import LOCK_EX, LOCK_NB, LOCK_SH, flock
from pathlib import Path

_has_flown = False  # this process


@contextmanager
def compiling_alone() -> Iterator[None]:
    """Of processes that begin at once one compiles; the others wait, and then load what it has
    compiled, all at the same time."""
    global _has_flown
    if _has_flown:
        yield
        return
    with ExitStack() as held:
        with suppress(OSError, RuntimeError):  # no home, or nothing can be kept: each for itself
            folder = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "tgl_soar"
            folder.mkdir(parents=True, exist_ok=True)
            lock = held.enter_context((folder / "compiling").open("ab"))
            try:
                flock(lock, LOCK_EX | LOCK_NB)
            except BlockingIOError:
                flock(lock, LOCK_SH)
        yield
    _has_flown = True
