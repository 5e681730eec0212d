"""What the module itself tells on the wire, NAMED_VALUE_FLOAT in the operator's units, as series.

Each function gives None, or nothing, where the numbers that it takes were never sent.
"""

from __future__ import annotations

from dataclasses import replace
from math import pi, radians
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.logs.flight_data import (
    LoggedMode,
    Series,
    changes_of,
    line_series,
    mode_words,
    series,
)

Floats = NDArray[np.float64]
Reported = dict[str, tuple[Floats, Floats]]


def named_values(time_s: Floats, names: NDArray[Any], values: NDArray[Any]) -> Reported:
    """Times [s] and values by name, of frames in the order of their times, shape (n,) each."""
    found = {}
    for name in np.unique(names).tolist():
        rows = names == name
        found[name.decode("ascii", "replace").strip("\0")] = (
            time_s[rows],
            values[rows].astype(float),
        )
    return found


def reported_series(
    reported: Reported, name: str, column: str, scale: float = 1.0
) -> Series | None:
    """One number; scale: from its unit to that of the column."""
    if name not in reported:
        return None
    times, values = reported[name]
    return series(times, f"NAMED_VALUE_FLOAT {name}", **{column: scale * values})


def together(reported: Reported, names: dict[str, str]) -> Series | None:
    """Numbers that were reported in turn as one series, each as it stood at the time."""
    if not all(name in reported for name in names.values()):
        return None
    parts = {c: Series(reported[n][0], {c: reported[n][1]}, n) for c, n in names.items()}
    times = np.unique(np.concatenate([part.time_s for part in parts.values()]))
    columns = {c: part.last_at(c, times) for c, part in parts.items()}
    return series(times, "NAMED_VALUE_FLOAT", **columns)


def reported_setpoints(reported: Reported) -> Series | None:
    """Of the pitch alone."""
    pitch = reported_series(reported, "pitch_sp", "pitch_rad", radians(1.0))
    if pitch is None:
        return None
    unknown = np.full(len(pitch), np.nan)
    return replace(pitch, columns={**pitch.columns, "roll_rad": unknown, "heading_rad": unknown})


def reported_path(reported: Reported) -> Series | None:
    """x and z alone: the path that the position messages give is better, where a site is known."""
    found = together(reported, {"x_m": "soar_x", "z_m": "soar_z"})
    if found is None:
        return None
    return replace(found, columns={**found.columns, "y_m": np.full(len(found), np.nan)})


def reported_line(reported: Reported) -> Series | None:
    """The line that is flown."""
    parts = {}
    for column, name in (("x_m", "line_x"), ("z_m", "line_z"), ("eta_rad", "line_lean")):
        part = reported_series(reported, name, column)
        if part is not None:
            parts[column] = part
    if "eta_rad" in parts:
        eta = np.radians(parts["eta_rad"]["eta_rad"]) + 0.5 * pi
        parts["eta_rad"] = replace(parts["eta_rad"], columns={"eta_rad": eta})
    return line_series(parts, "NAMED_VALUE_FLOAT")


def reported_air(reported: Reported) -> Series | None:
    """Wind, where it is reported, and updraft, as estimated on board."""
    if "updraft" not in reported:
        return None
    times, updraft = reported["updraft"]
    wind = np.full(len(times), np.nan)
    if "wind" in reported:
        wind = Series(reported["wind"][0], {"wind": reported["wind"][1]}, "").last_at("wind", times)
    return series(times, "NAMED_VALUE_FLOAT updraft", wind_mps=wind, updraft_mps=updraft)


def reported_ages(reported: Reported) -> Series | None:
    """Of the inputs [s]."""
    names = {"position_age_s": "age_pos", "attitude_age_s": "age_att", "heartbeat_age_s": "age_ap"}
    return together(reported, names)


def reported_margins(reported: Reported) -> Series | None:
    """To the ground [m] and of the angle of attack [rad]."""
    found = together(reported, {"clearance_m": "clearance", "stall_rad": "stall"})
    if found is None:
        return None
    return replace(found, columns={**found.columns, "stall_rad": np.radians(found["stall_rad"])})


def reported_forecast(reported: Reported) -> Series | None:
    """Of where it settles."""
    names = {"standing": "fc_state", "chance": "fc_chance", "ahead_s": "fc_time", "z_m": "fc_z"}
    return together(reported, names)


def reported_modes(reported: Reported) -> tuple[LoggedMode, ...]:
    """The modes, where they change."""
    if "soar_mode" not in reported:
        return ()
    times, values = reported["soar_mode"]
    known = np.isfinite(values)
    return changes_of(times[known], mode_words(values[known]))
