"""ArduPilot's DataFlash log (.bin) as a flight.

Read column by column: the records are indexed by their lengths and each kind is taken by numpy
at once.  What the letters of a format mean is pymavlink's table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from math import radians
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pymavlink import mavutil
from pymavlink.DFReader import FORMAT_TO_STRUCT

from tgl_soar.analysis.logs.clocks import Straightened
from tgl_soar.analysis.logs.flight_data import (
    Event,
    FlightData,
    LoggedMode,
    Series,
    changes_of,
    parameter_events,
    series,
    with_missing,
)
from tgl_soar.analysis.logs.pitot import true_airspeeds
from tgl_soar.analysis.logs.ulog_reader import LogError

Floats = NDArray[np.float64]

MAGIC: Final = b"\xa3\x95"
_FORMAT: Final = 0x80  # the record that describes a kind of record
_FORMAT_LENGTH: Final = 89
_IMU: Final = {
    "force_x_frd_mps2": "AccX",
    "force_y_frd_mps2": "AccY",
    "force_z_frd_mps2": "AccZ",
    "roll_rate_frd_radps": "GyrX",
    "pitch_rate_frd_radps": "GyrY",
    "yaw_rate_frd_radps": "GyrZ",
}
_EVENTS: Final = {10: "armed", 11: "disarmed"}
_TEXTS: Final = frozenset({"Name", "Message"})  # of what is read here, all else numbers


class _Kind(NamedTuple):
    name: str
    length: int  # of a record, with its header
    letters: str
    columns: tuple[str, ...]


_NO_KIND: Final[tuple[_Kind, list[int]]] = (_Kind("", 0, "", ()), [])


class Dataflash:
    """The records of a log by kind.  Errors: `LogError` where there is not one."""

    def __init__(self, path: Path, data: bytes) -> None:
        self._data = np.frombuffer(data, dtype=np.uint8)
        self._kinds: dict[str, tuple[_Kind, NDArray[np.intp]]] = {}
        self.lost: list[str] = []
        found, skipped = _index(data)
        for kind, places in sorted(found, key=lambda each: len(each[1])):  # of two, the one in use
            if places:
                self._kinds[kind.name] = (kind, np.array(places))
        if not self._kinds:
            raise LogError(f"{path}: begins like a DataFlash log and holds not one whole record")
        if skipped:
            self.lost.append(
                f"{skipped} of {len(data)} bytes belong to no whole record: the file is cut off"
                " or damaged there"
            )

    def __contains__(self, name: str) -> bool:
        return name in self._kinds

    def columns(self, name: str) -> dict[str, NDArray[Any]]:
        """All records of a kind: numbers scaled to their units, texts as bytes."""
        kind, places = self._kinds[name]
        layout = _layout(kind)
        rows = self._data[places[:, None] + np.arange(3, kind.length)].view(layout)[:, 0]
        found: dict[str, NDArray[Any]] = {}
        for column, letter in zip(kind.columns, kind.letters, strict=True):
            scale = FORMAT_TO_STRUCT[letter][1]
            found[column] = rows[column] if scale is None else rows[column] * scale
        return found

    def timed(self) -> dict[str, dict[str, NDArray[Any]]]:
        """The kinds that carry a time.

        Of their columns those that are what they are read as: a description that is damaged may
        call a text a number.
        """
        every = {name: self.columns(name) for name in self._kinds}
        fitting = {
            name: {key: v for key, v in columns.items() if (v.dtype.kind == "S") == (key in _TEXTS)}
            for name, columns in every.items()
        }
        return {name: columns for name, columns in fitting.items() if "TimeUS" in columns}


def _index(data: bytes) -> tuple[list[tuple[_Kind, list[int]]], int]:
    """The kinds, where the records of each are, and how many bytes belong to none.

    A number that is described again stands for another kind from there on.
    """
    own = _Kind("FMT", _FORMAT_LENGTH, "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))
    kinds: dict[int, tuple[_Kind, list[int]]] = {_FORMAT: (own, [])}
    found = []
    at = skipped = 0
    end = len(data)
    while at + 3 <= end:
        kind, places = kinds.get(data[at + 2], _NO_KIND)
        if data[at : at + 2] != MAGIC or not kind.length or at + kind.length > end:
            following = data.find(MAGIC, at + 1)
            following = end if following < 0 else following
            skipped += following - at
            at = following
            continue
        places.append(at)
        if kind is own:
            number = data[at + 3]
            described = _described(data[at + 3 : at + _FORMAT_LENGTH])
            if described is not None and described != kinds.get(number, _NO_KIND)[0]:
                kinds[number] = (described, [])
                found.append(kinds[number])
        at += kind.length
    return found, skipped + (end - at)


def _described(body: bytes) -> _Kind | None:
    """What a FMT record says of a kind; None where it makes no sense."""
    name, letters, columns = (
        part.split(b"\0")[0].decode("ascii", "replace")
        for part in (body[2:6], body[6:22], body[22:86])
    )
    if body[0] == _FORMAT or any(letter not in FORMAT_TO_STRUCT for letter in letters):
        return None
    names = tuple(columns.split(","))
    kind = _Kind(name, body[1], letters, names)
    fits = len(names) == len(letters) == len(set(names)) and all(names)
    return kind if fits and _layout(kind).itemsize == kind.length - 3 else None


def _layout(kind: _Kind) -> np.dtype[Any]:
    """The body of a record as numpy has it."""
    types = []
    for column, letter in zip(kind.columns, kind.letters, strict=True):
        code = FORMAT_TO_STRUCT[letter][0]
        types.append((column, f"S{code[:-1]}" if code.endswith("s") else f"<{code}"))
    return np.dtype(types)


def _words(column: NDArray[Any]) -> Iterator[str]:
    return (value.decode("utf-8", "replace").strip("\0 ") for value in column.tolist())


def read_dataflash(name: str, log: Dataflash) -> FlightData:
    """A flight that ArduPilot logged."""
    kinds = log.timed()
    clocks = Straightened({key: rows["TimeUS"] * 1e-6 for key, rows in kinds.items()})
    kinds = {
        key: {k: values[clocks.rows[key]] for k, values in rows.items()}
        for key, rows in kinds.items()
    }

    def take(kind: str, columns: dict[str, str], scale: float = 1.0) -> Series | None:
        """Columns of a kind, of its first instance alone."""
        rows = kinds.get(kind)
        if rows is None or not set(columns.values()) <= rows.keys():
            return None
        first = next((rows[c] for c in ("C", "I") if c in rows), None)
        own = slice(None) if first is None else first == first.min()
        return series(
            clocks.time_s[kind][own], kind, **{k: scale * rows[v][own] for k, v in columns.items()}
        )

    estimate = next((kind for kind in ("XKF1", "NKF1", "EKF1") if kind in kinds), "XKF1")
    setpoints = take("ATT", {"pitch_rad": "DesPitch", "roll_rad": "DesRoll"}, radians(1.0))
    if setpoints is not None:
        unknown = np.full(len(setpoints), np.nan)
        setpoints = replace(setpoints, columns={**setpoints.columns, "heading_rad": unknown})
    flight = FlightData(
        name=name,
        kind="ArduPilot DataFlash log",
        position=take(estimate, {"north_m": "PN", "east_m": "PE", "down_m": "PD"}),
        velocity=take(estimate, {"north_mps": "VN", "east_mps": "VE", "down_mps": "VD"}),
        attitude=_wrapped(
            take("ATT", {"roll_rad": "Roll", "pitch_rad": "Pitch", "yaw_rad": "Yaw"}, radians(1.0))
        ),
        airspeed=_airspeed(take),
        imu=take("IMU", _IMU),
        outputs=take(
            "RCOU",
            {c[1:]: c for c in kinds.get("RCOU", {}) if c.startswith("C") and c[1:].isdigit()},
        ),
        setpoints=setpoints,
        autopilot_modes=_modes(kinds, clocks),
        streams=clocks.time_s,
    )
    first, changes = _parameters(kinds, clocks)
    events = [*_messages(kinds, clocks), *parameter_events(first, changes)]
    wanted = ("position", "attitude", "airspeed", "setpoints", "tracking", "line", "air")
    flight = replace(
        flight,
        events=tuple(sorted(events)),
        parameters=first,
        metadata=_metadata(events),
        lost=(*log.lost, *_dropped(kinds), *clocks.lost),
    )
    return with_missing(flight, wanted)


_Kinds = dict[str, dict[str, NDArray[Any]]]


def _airspeed(take: Callable[[str, dict[str, str]], Series | None]) -> Series | None:
    """True airspeed: ARSP has the equivalent one.  NaN where ARSP calls the sensor unhealthy; None
    where it always does."""
    shown = take("ARSP", {"shown": "Airspeed", "healthy": "H"}) or take(
        "ARSP", {"shown": "Airspeed"}
    )
    if shown is None:
        return None
    equivalent = shown["shown"]
    if "healthy" in shown.columns:
        equivalent = np.where(shown["healthy"] != 0.0, equivalent, np.nan)
        if not np.isfinite(equivalent).any():
            return None
    altitude = np.full(len(shown), np.nan)
    for kind in ("POS", "AHR2", "GPS"):
        above_sea = take(kind, {"alt": "Alt"})
        if above_sea is not None:
            altitude = np.interp(shown.time_s, above_sea.time_s, above_sea["alt"])
            break
    true_mps = true_airspeeds(equivalent, altitude)
    return Series(shown.time_s, {"airspeed_mps": true_mps}, shown.source)


def _wrapped(attitude: Series | None) -> Series | None:
    """Yaw in ±pi, as everywhere: ArduPilot logs it from 0 to 360°."""
    if attitude is None:
        return None
    yaw = (attitude["yaw_rad"] + np.pi) % (2.0 * np.pi) - np.pi
    return replace(attitude, columns={**attitude.columns, "yaw_rad": yaw})


def _modes(kinds: _Kinds, clocks: Straightened) -> tuple[LoggedMode, ...]:
    rows = kinds.get("MODE", {})
    numbers = rows.get("ModeNum", rows.get("Mode"))
    if numbers is None or numbers.dtype.kind not in "iuf":  # damage may have renamed it
        return ()
    names = mavutil.mode_mapping_bynumber(mavutil.mavlink.MAV_TYPE_FIXED_WING) or {}
    words = [names.get(int(number), f"mode {int(number)}") for number in numbers]
    return changes_of(clocks.time_s["MODE"], words)


def _messages(kinds: _Kinds, clocks: Straightened) -> list[Event]:
    events = []
    if "MSG" in kinds and "Message" in kinds["MSG"]:
        texts = _words(kinds["MSG"]["Message"])
        events += [
            Event(t, "message", text)
            for t, text in zip(clocks.time_s["MSG"].tolist(), texts, strict=True)
        ]
    if "EV" in kinds and "Id" in kinds["EV"]:
        numbers = kinds["EV"]["Id"].tolist()
        for t, number in zip(clocks.time_s["EV"].tolist(), numbers, strict=True):
            events.append(Event(t, "message", _EVENTS.get(number, f"event {number}")))
    if "ERR" in kinds and {"Subsys", "ECode"} <= kinds["ERR"].keys():
        rows = kinds["ERR"]
        codes = zip(rows["Subsys"].tolist(), rows["ECode"].tolist(), strict=True)
        for t, (subsystem, code) in zip(clocks.time_s["ERR"].tolist(), codes, strict=True):
            events.append(Event(t, "message", f"error {code} of subsystem {subsystem}"))
    return events


def _parameters(
    kinds: _Kinds, clocks: Straightened
) -> tuple[dict[str, float], list[tuple[float, str, float]]]:
    rows = kinds.get("PARM")
    if rows is None or not {"Name", "Value"} <= rows.keys():
        return {}, []
    first: dict[str, float] = {}
    changes = []
    values = zip(clocks.time_s["PARM"].tolist(), _words(rows["Name"]), rows["Value"], strict=True)
    for t, name, value in values:
        if name in first:
            changes.append((t, name, float(value)))
        else:
            first[name] = float(value)
    return first, changes


def _metadata(events: list[Event]) -> dict[str, str]:
    """The firmware names itself in its first messages."""
    for event in events:
        if event.kind == "message" and event.text.startswith(("Ardu", "APM:")):
            return {"firmware": event.text}
    return {}


def _dropped(kinds: _Kinds) -> list[str]:
    if "DSF" not in kinds or "Dp" not in kinds["DSF"]:
        return []
    count = int(np.max(kinds["DSF"]["Dp"]))
    return [f"the writer dropped {count} records"] if count else []
