"""The module's own flight log as a flight."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.logs.flight_data import (
    COLUMNS,
    RATES,
    Event,
    FlightData,
    Series,
    changes_of,
    euler,
    mode_words,
    series,
    with_missing,
)
from tgl_soar.analysis.logs.ulog import Topics
from tgl_soar.analysis.logs.ulog_reader import FlightLog, LogError
from tgl_soar.control.excitation import RUNNING
from tgl_soar.control.supervisor_texts import MODE_NAMES, REASON_TEXTS

Floats = NDArray[np.float64]

TICK: Final = "tick"
# What of a tick each series is made of: how its columns' names begin there.
_OF_THE_TICK: Final = {
    "path": "vehicle_",
    "motion": "vehicle_",
    "heading": "vehicle_",
    "setpoints": "setpoints_",
    "surfaces": "command_",
    "air": "air_",
    "ages": "health_",
    "margins": "margins_",
    "forecast": "forecast_",
    "throttle": "throttle_",
    "line": "line_",
    "tracking": "",
}
_PARTLY_KNOWN: Final = ("margins", "forecast")  # one column of a row may be, another not
OLDEST_S: Final = 2.0  # of a sample when it is logged: older, its clock is another
COMMANDED: Final = TICK  # the source of surfaces that the module itself has moved
_FLOWN_ONLY: Final = ("surfaces", "setpoints", "tracking")  # of a module that only watches: none
_SPEEDS: Final = {
    "north_mps": "velocity_north_mps",
    "east_mps": "velocity_east_mps",
    "down_mps": "velocity_down_mps",
}
_EXCITATION: Final = {
    "standing": "excitation_standing",
    "injected_rad": "excitation_pitch_rad",
    "setpoint_rad": "setpoints_pitch_rad",
    "pitch_rad": "vehicle_pitch_rad",
    "elevator": "command_elevator",
    "elevator_p": "elevator_p",
    "elevator_i": "elevator_i",
}
_POINT: Final = {"standing": "point_standing", "off_m": "point_off_m", "brake": "command_brake"}
_METADATA: Final = {
    "sys_name": "system",
    "ver_sw": "software version",
    "ver_python": "Python",
    "started_utc": "started",
    "airframe_file": "airframe file",
    "site_file": "site file",
    "links": "links",
}


def read_module_log(log: FlightLog) -> FlightData:
    """A flight that the module logged.  Errors: `LogError` without a tick."""
    topics = Topics(log)
    if not topics.has(TICK, "mode"):
        raise LogError(f"{log.path}: no tick of the module is in it")
    times = topics.time_s[TICK]
    modes = mode_words(topics.column(TICK, "mode"), _names(log, "modes", MODE_NAMES))
    parts: dict[str, Any] = {
        kind: topics.take(TICK, {name: prefix + name for name in COLUMNS[kind]})
        if kind not in _PARTLY_KNOWN
        else topics.rows(TICK, {name: prefix + name for name in COLUMNS[kind]})
        for kind, prefix in _OF_THE_TICK.items()
    }
    active = topics.column(TICK, "active") > 0.0
    for kind in _FLOWN_ONLY:
        part: Series | None = parts[kind]
        if part is not None:
            flown = np.isin(part.time_s, times[active])
            columns = {k: np.where(flown, v, np.nan) for k, v in part.columns.items()}
            parts[kind] = replace(part, columns=columns)
    flight = FlightData(
        name=log.path.name,
        kind="flight log of the module (ULog)",
        position=_measured(topics, "position"),
        velocity=_measured(topics, "position", _SPEEDS),
        attitude=_attitude(topics),
        rates=_measured(topics, "attitude", {name: name for name in RATES}),
        airspeed=_measured(topics, "airspeed"),
        imu=_measured(topics, "imu"),
        modes=changes_of(times, modes),
        events=tuple(sorted([*topics.events(), *_reasons(topics, modes, log)])),
        parameters=topics.parameters(),
        metadata={word: str(log.info[key]) for key, word in _METADATA.items() if key in log.info},
        files=log.texts,
        streams={name: t for name, t in topics.time_s.items() if name != "parameter"},
        start_s=topics.start_s,
        lost=topics.lost,
    )
    excitation = topics.take(TICK, _EXCITATION)
    if excitation is not None and (excitation["standing"] == RUNNING).any():
        parts["excitation"] = excitation
    parts["point"] = topics.rows(TICK, _POINT)
    parts["brake"] = _measured(topics, "surfaces", {"brake": "brake"})
    parts["surfaces"] = _moved(parts["surfaces"], topics)
    flight = replace(flight, **parts)
    return with_missing(flight, ("path", "tracking", "line", "surfaces", "airspeed", "air"))


def _measured(topics: Topics, topic: str, columns: dict[str, str] | None = None) -> Series | None:
    """Samples at the times when they were true; logged they were when a tick had them.

    A sample that claims to be older than the one before, or not of this flight, is left out.
    """
    wanted = columns or {name: name for name in COLUMNS[topic]}
    taken = topics.take(topic, {**wanted, "age_s": "time_s", "logged_s": "timestamp"})
    if taken is None:
        return None
    age = taken["logged_s"] * 1e-6 - taken["age_s"]
    times = taken.time_s - age
    newest = np.maximum.accumulate(np.where(np.isfinite(times), times, -np.inf))
    good = (np.abs(age) <= OLDEST_S) & (times >= newest)
    if not good.any():
        return None
    return Series(times[good], {name: taken[name][good] for name in wanted}, topic)


def _attitude(topics: Topics) -> Series | None:
    found = _measured(topics, "attitude", {q: q for q in ("qw", "qx", "qy", "qz")})
    if found is None:
        return None
    roll, pitch, yaw = euler(*(found[q] for q in ("qw", "qx", "qy", "qz")))
    good = np.isfinite(roll)
    angles = {"roll_rad": roll[good], "pitch_rad": pitch[good], "yaw_rad": yaw[good]}
    return series(found.time_s[good], "attitude", **angles)


def _moved(commanded: Series | None, topics: Topics) -> Series | None:
    """Where the surfaces were put: by the module, or, as read back, by whoever flew."""
    measured = _measured(topics, "surfaces")
    if commanded is None or measured is None:
        return commanded or measured
    flown = np.isfinite(commanded["elevator"])
    if not flown.any():
        return measured
    columns = {
        name: np.where(flown, values, measured.last_at(name, commanded.time_s))
        for name, values in commanded.columns.items()
    }
    return Series(commanded.time_s, columns, commanded.source)


def _reasons(topics: Topics, modes: list[str], log: FlightLog) -> list[Event]:
    """Why the mode changed, at each change that was not reported in words."""
    operator_texts = {words.text.strip() for words in log.words}
    if not topics.has(TICK, "reason"):
        return []
    reasons = topics.column(TICK, "reason").astype(int)
    words = dict(enumerate(_names(log, "reasons", REASON_TEXTS)))
    times = topics.time_s[TICK]
    found = []
    for i in np.flatnonzero(reasons).tolist():
        text = f"{modes[i]}: {words.get(int(reasons[i]), 'reason unknown')}"
        if text not in operator_texts:  # else it was reported to the operator, and the log has that
            found.append(Event(float(times[i]), "mode", text))
    return found


def _names(log: FlightLog, key: str, ours: tuple[str, ...]) -> tuple[str, ...]:
    """As the version that wrote the log numbered them."""
    reported = log.info.get(key)
    return tuple(reported.split(";")) if isinstance(reported, str) and reported else ours
