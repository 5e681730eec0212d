"""Compiled kernels on disk: what takes minutes to compile is compiled once for each source.

They are kept in `$XDG_CACHE_HOME/tgl_soar/kernels` (or ~/.cache), in a folder whose name changes
with the source of any module below them: nothing stale is ever flown, and a process finds what
another has compiled.  numba itself looks at the processor and at the arguments' types.
"""

from __future__ import annotations

import ast
import os
import shutil
import sys
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

_ROOT: Final = Path(__file__).parents[2]  # where the package lies
# Whichever is less.  A source's kernels take 5 to 30 MB: several checkouts may run side by side.
KEPT: Final = 16  # sources
KEPT_BYTES: Final = 1 << 30


def kept(kernel: Callable[..., Any], modules: Sequence[str]) -> Any:
    """A kernel that numba compiles when it is called first and no process has done so before.

    `modules`: of whose source it is made.  Where nothing can be kept it lives in memory alone.
    """
    import numba
    from numba.core import config

    # numba reads where to keep code once, when it wraps the function.
    settings = vars(config)
    before = settings["CACHE_DIR"]
    try:
        settings["CACHE_DIR"] = str(folder(tuple(modules)))
        return numba.njit(nogil=True, forceinline=True, cache=True)(kernel)
    except (OSError, RuntimeError):  # no home, or nothing can be written there
        return numba.njit(nogil=True, forceinline=True)(kernel)
    finally:
        settings["CACHE_DIR"] = before


@cache
def folder(modules: tuple[str, ...]) -> Path:
    """Where the kernels of just these modules' source are kept; those of old sources are deleted.

    Errors: RuntimeError without a home folder; OSError where it cannot be made.
    """
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "tgl_soar/kernels"
    found = base / source_key(modules)
    found.mkdir(parents=True, exist_ok=True)
    os.utime(found)
    _delete_old(base)
    return found


def source_key(modules: Iterable[str]) -> str:
    """A name that changes with the source of any of the modules, or of what these import of the
    package, and with Python's and numba's version."""
    key = sha256(f"{sys.version} {version('numba')}".encode())
    for _, text in sorted(_sources(modules).items()):
        key.update(text)
    return key.hexdigest()[:16]


def _sources(modules: Iterable[str]) -> dict[str, bytes]:
    """The source of modules and of what they import of the package, by the modules' names."""
    found: dict[str, bytes] = {}
    waiting = list(modules)
    while waiting:
        name = waiting.pop()
        path = _ROOT.joinpath(*name.split("."))
        path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        if name in found or not path.is_file():  # not a module: what is imported from one
            continue
        found[name] = path.read_bytes()
        for node in ast.walk(ast.parse(found[name])):
            if isinstance(node, ast.ImportFrom) and node.module and not node.level:
                waiting += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            elif isinstance(node, ast.Import):
                waiting += [alias.name for alias in node.names]
    return found


def _delete_old(base: Path) -> None:
    """Keep what was used last.  A process that still uses another compiles it once more."""
    with suppress(OSError):  # another process deletes them, too
        by_age = sorted(base.iterdir(), key=lambda path: path.stat().st_mtime, reverse=True)
        size = 0
        for place, path in enumerate(by_age):
            size += sum(file.stat().st_size for file in path.rglob("*"))
            if place > 0 and (place >= KEPT or size > KEPT_BYTES):  # the newest is used now
                shutil.rmtree(path, ignore_errors=True)
