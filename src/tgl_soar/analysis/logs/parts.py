"""A flight whose log was cut into parts, put together again."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tgl_soar.analysis.logs.flight_data import FlightData, LoggedMode, Series


def later_parts(path: Path) -> list[Path]:
    """The parts that follow the first part of a log: NAME_part2.ulg, NAME_part3.ulg …

    Empty where the path names a later part itself: then that part alone is meant.
    """
    if re.search(r"_part\d+$", path.stem):
        return []
    found: list[Path] = []
    while (part := path.with_name(f"{path.stem}_part{len(found) + 2}{path.suffix}")).is_file():
        found.append(part)
    return found


def joined(parts: Sequence[FlightData]) -> FlightData:
    """One flight from its parts, in their order, on the first one's time."""
    first = parts[0]
    shifts, end = [], 0.0
    for part in parts:
        shift = part.start_s - first.start_s
        # A clock that was reset between two parts tells nothing of the time between them.
        shifts.append(max(shift, end))
        end = shifts[-1] + part.duration_s
    timed = list(zip(parts, shifts, strict=True))
    names = {name for part in parts for name in part.series()}
    series: dict[str, Any] = {name: _series(name, timed) for name in names}
    streams = {
        name: np.concatenate([p.streams[name] + s for p, s in timed if name in p.streams])
        for name in {name for part in parts for name in part.streams}
    }
    return replace(
        first,
        name=f"{first.name} and {len(parts) - 1} more" if len(parts) > 1 else first.name,
        modes=_modes(timed),
        events=tuple(e._replace(time_s=e.time_s + s) for p, s in timed for e in p.events),
        streams=streams,
        missing=tuple(text for text in first.missing if all(text in p.missing for p in parts)),
        lost=tuple(dict.fromkeys(text for part in parts for text in part.lost)),
        **series,
    )


def _series(name: str, timed: Sequence[tuple[FlightData, float]]) -> Series:
    found = [(p.series()[name], shift) for p, shift in timed if name in p.series()]
    first = found[0][0]
    columns = {c: np.concatenate([s[c] for s, _ in found]) for c in first.columns}
    time_s = np.concatenate([s.time_s + shift for s, shift in found])
    return Series(np.maximum.accumulate(time_s), columns, first.source)


def _modes(timed: Sequence[tuple[FlightData, float]]) -> tuple[LoggedMode, ...]:
    every = [mode._replace(time_s=mode.time_s + s) for p, s in timed for mode in p.modes]
    return tuple(mode for i, mode in enumerate(every) if i == 0 or every[i - 1].name != mode.name)
