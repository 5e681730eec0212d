"""Where logs are kept: their names, and how much of them.

    FOLDER/2026-11-21/14_03_55_flight007.ulg          by date and time (UTC) and flight
    FOLDER/2026-11-21/14_03_55_flight007.tlog         the wire of the same
    FOLDER/2026-11-21/14_03_55_flight007_part2.ulg    each part can be read by itself
    FOLDER/undated/flight008.ulg                      the computer's clock was not set

Flights are counted through.  What is oldest goes when all of it together is too much; nothing
that is not named so is ever touched.
"""

from __future__ import annotations

import os
import re
import time
from pathlib import Path
from typing import Final, NamedTuple

UNSET_CLOCK: Final = 2025  # an earlier year is that of a computer that does not know the time
_FOLDER: Final = re.compile(r"\d{4}-\d\d-\d\d|undated")
_FILE: Final = re.compile(r"(?:\d\d_\d\d_\d\d_)?flight(\d{3,})(?:_part(\d+))?\.(?:ulg|tlog)")
_KEPT_FREE: Final = 0.1  # of what the disk has left


class Kept(NamedTuple):
    """A file of a log."""

    flight: int
    part: int
    size: int
    path: Path


def kept_in(folder: Path) -> list[Kept]:
    """All files of logs, oldest first."""
    found = []
    for day in _listed(folder):
        if _FOLDER.fullmatch(day.name) and day.is_dir():
            for path in _listed(day):
                if match := _FILE.fullmatch(path.name):
                    try:
                        size = path.stat().st_size
                    except OSError:
                        continue  # somebody has just taken it away
                    found.append(Kept(int(match[1]), int(match[2] or 1), size, path))
    return sorted(found)


def _listed(folder: Path) -> list[Path]:
    try:
        return list(folder.iterdir())
    except OSError:
        return []


def flight_name(folder: Path, flight: int, unix_s: float) -> Path:
    """The path of a flight's files without an ending."""
    utc = time.gmtime(unix_s)
    if utc.tm_year < UNSET_CLOCK:
        return folder / "undated" / f"flight{flight:03d}"
    day, hour = time.strftime("%Y-%m-%d", utc), time.strftime("%H_%M_%S", utc)
    return folder / day / f"{hour}_flight{flight:03d}"


def part_name(stem: Path, part: int, ending: str) -> Path:
    """The path of one file of a flight."""
    number = f"_part{part}" if part > 1 else ""
    return stem.with_name(f"{stem.name}{number}.{ending}")


def make_room(folder: Path, largest_bytes: int, coming_bytes: int) -> None:
    """Delete the oldest files until so much more fits.  Errors: OSError where one cannot be."""
    kept = kept_in(folder)
    used = sum(file.size for file in kept)
    disk = os.statvfs(folder)
    free = disk.f_bavail * disk.f_frsize
    allowed = min(largest_bytes, used + int(free * (1.0 - _KEPT_FREE)))
    for file in kept:
        if used + coming_bytes <= allowed:
            return
        file.path.unlink(missing_ok=True)
        used -= file.size
