"""Jets on disk: the air of a nozzle and its board is worked out once for each shape and source.

That takes a second and half of scipy, at the start of each process that flies in the tunnel.  They
are kept in `$XDG_CACHE_HOME/tgl_soar/jets` (or ~/.cache), under names that change with the shape,
the source of this folder and the versions of the libraries: none is ever read for another.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Final

import numpy as np

from tgl_soar.air.grid import GridTable

_SOURCE: Final = Path(__file__).parent
KEPT: Final = 16  # of a megabyte each: the lines and slopes of an afternoon


def kept(shape: tuple[float, ...], make: Callable[[], GridTable]) -> GridTable:
    """The table of a shape from disk, or made and put there; made where nothing can be kept."""
    try:
        path = _folder() / f"{_key(shape, _SOURCE)}.npy"
    except (OSError, RuntimeError):  # no home, or nothing can be written there
        return make()
    try:
        x0_m, dx_m, nx, z0_m, dz_m, nz, *values = np.load(path).tolist()
        os.utime(path)
    except (OSError, ValueError, EOFError):  # not there yet, or not whole
        table = make()
        with suppress(OSError):
            _write(path, table)
        return table
    return GridTable(
        x0_m=x0_m, dx_m=dx_m, nx=int(nx), z0_m=z0_m, dz_m=dz_m, nz=int(nz), values=values
    )


def _folder() -> Path:
    base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    found = base / "tgl_soar/jets"
    found.mkdir(parents=True, exist_ok=True)
    return found


@cache
def _key(shape: tuple[float, ...], source: Path) -> str:
    key = sha256(f"{tuple(shape)} {version('numpy')} {version('scipy')}".encode())
    for path in sorted(source.glob("*.py")):
        key.update(path.read_bytes())
    return key.hexdigest()[:16]


def _write(path: Path, table: GridTable) -> None:
    """Whole or not at all, whoever else writes the same; those not used for longest go."""
    with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
        np.save(file, np.array([*table[:-1], *table.values]))
    Path(file.name).replace(path)
    by_age = sorted(path.parent.iterdir(), key=lambda each: each.stat().st_mtime, reverse=True)
    for old in by_age[KEPT:]:
        old.unlink()
