"""Where logs are kept: their names, and how much of them.

    FOLDER/2026-11-21/14_03_55_flight007.ulg          by date and time (UTC) and flight
    FOLDER/2026-11-21/14_03_55_flight007.tlog         the wire of the same
    FOLDER/2026-11-21/14_03_55_flight007_part2.ulg    each part can be read by itself
    FOLDER/undated/flight008.ulg                      the computer's clock was not set

Flights are counted through.  What is oldest goes when all of it together is too much, or when
the disk gets full; then the last flight and the one being flown stay whatever comes of it.  Of the
one being flown the first parts, of its first minute, always stay.
Nothing that is not named so is ever touched.
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


def make_room(
    folder: Path, largest_bytes: int, coming_bytes: int, flying: int, first_parts: int = 0
) -> list[Kept]:
    """Delete the oldest files until so much more fits; those that were deleted.

    `largest_bytes`, of all together, may take any file but the first parts, so many, of the
    flight that is flown, by its number.  A disk that is nearly full takes none of
    the flight that is flown, nor of the one before it; where there is not enough
    to be had for all that is coming, half of that is aimed at, so that a small disk keeps the
    other half of its older flights.  Errors: OSError where a file cannot be deleted.
    """
    kept = kept_in(folder)
    disk = os.statvfs(folder)
    free = int(disk.f_bavail * disk.f_frsize * (1.0 - _KEPT_FREE))
    last = max((file.flight for file in kept if file.flight < flying), default=0)
    spare = sum(file.size for file in kept if file.flight < last)
    beyond = sum(file.size for file in kept) + coming_bytes - largest_bytes
    lacking = min(coming_bytes, (free + spare) // 2) - free
    deleted = []
    for file in kept:
        if beyond <= 0 and (lacking <= 0 or file.flight >= last):
            break
        if file.flight == flying and file.part <= first_parts:
            continue
        file.path.unlink(missing_ok=True)
        deleted.append(file)
        beyond -= file.size
        lacking -= file.size
    return deleted
