"""Where flights come from: which source flew them, and on what computer."""

from __future__ import annotations

import os
import platform
import subprocess
from collections.abc import Iterable, Iterator
from functools import cache
from hashlib import file_digest, sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

import tgl_soar

_PACKAGE: Final = Path(tgl_soar.__file__).parent
_CHANGES_FLIGHTS: Final = ("numpy", "scipy", "numba", "llvmlite")  # where rounding comes from


@cache
def source_digest() -> str:
    """Of the package's whole source and of the files that it ships: flights of one digest may
    stand side by side."""
    found = sha256()
    for path in sorted(_files()):
        found.update(path.read_bytes())
    return found.hexdigest()[:16]


def _files() -> Iterator[Path]:
    yield from _PACKAGE.rglob("*.py")
    for folder in (_PACKAGE / "_config", _PACKAGE.parents[1] / "config"):
        yield from (path for path in folder.rglob("*") if path.is_file())


def sha256_of(path: Path) -> str:
    """Of one file, as `sha256sum` prints it; "": it cannot be read."""
    try:
        with path.open("rb") as file:
            return file_digest(file, sha256).hexdigest()
    except OSError:
        return ""


def files_digest(paths: Iterable[Path]) -> str:
    """Of files that jobs name and do not hold; one that cannot be read counts as empty: whoever
    reads it says what is wrong with it."""
    return sha256("".join(map(sha256_of, paths)).encode()).hexdigest()[:16]


@cache
def commit() -> str:
    """Of the working copy that the package lies in, `+` where something in it is changed; ""."""
    try:
        words = ["git", "-C", str(_PACKAGE), "describe", "--always", "--abbrev=40", "--dirty=+"]
        found = subprocess.run(words, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return ""
    return found.stdout.strip()


def provenance() -> dict[str, Any]:
    """Of a result that is computed from flights: by what, and not when or where, so that it is the
    same whether they were stopped in between or not."""
    return {
        "version": tgl_soar.__version__,
        "commit": commit(),
        "source": source_digest(),
        "libraries": libraries(),
    }


def host_metadata() -> dict[str, Any]:
    """The computer, and what rounds there."""
    return {
        "host": platform.node(),
        "system": platform.platform(),
        "machine": platform.machine(),
        "processors": os.cpu_count() or 1,
        "python": platform.python_version(),
        **libraries(),
    }


def libraries() -> dict[str, str]:
    """Versions of those whose rounding is in every flight, and the processor that LLVM compiles
    for; "": not installed, and then flights are plain where they would be compiled."""
    versions = {name: installed_version(name) for name in _CHANGES_FLIGHTS}
    return {**versions, "processor": compiled_for()}


@cache
def compiled_for() -> str:
    """The kind of processor, and a digest of what it can do: one that multiplies and adds at once
    rounds otherwise than one that does not.  "": nothing is compiled."""
    try:
        from llvmlite import binding
    except ImportError:
        return ""
    features = binding.get_host_cpu_features().flatten()
    return f"{binding.get_host_cpu_name()} {sha256(features.encode()).hexdigest()[:8]}"


@cache
def installed_version(name: str) -> str:
    """Of a package; "": not installed."""
    try:
        return version(name)
    except PackageNotFoundError:
        return ""
