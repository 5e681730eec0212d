"""A log in the place of a flight: the strips' columns over the whole of it, for a time slider."""

from __future__ import annotations

from dataclasses import replace
from math import pi
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.logs.flight_data import FlightData, Series, on_line, placed
from tgl_soar.cli.page.measured_air import AirSample, MeasuredAir
from tgl_soar.cli.page.station import ROW, number
from tgl_soar.config.site import Site
from tgl_soar.control.supervisor import is_flying
from tgl_soar.control.supervisor_texts import MODE_NAMES
from tgl_soar.onboard.telemetry_values import ARRAY_S

ROWS_PER_S: Final = 10.0
MOST_ROWS: Final = 20_000  # 33 minutes at that rate; a longer flight in wider steps
_DEGREES: Final = 180.0 / pi
# The columns by the series, their column and a factor.
_SOURCES: Final[dict[str, tuple[str, str, float]]] = {
    "soar_x": ("path", "x_m", 1.0),
    "soar_z": ("path", "z_m", 1.0),
    "e_rho": ("tracking", "e_rho_m", 1.0),
    "pitch": ("attitude", "pitch_rad", _DEGREES),
    "roll": ("attitude", "roll_rad", _DEGREES),
    "pitch_sp": ("setpoints", "pitch_rad", _DEGREES),
    "elevator": ("surfaces", "elevator", 1.0),
    "updraft": ("air", "updraft_mps", 1.0),
    "wind": ("air", "wind_mps", 1.0),
    "airspeed": ("airspeed", "airspeed_mps", 1.0),
    "climb": ("motion", "climb_mps", 1.0),
    "velocity_x": ("motion", "velocity_x_mps", 1.0),
    "pushed": ("throttle", "climb_mps", 1.0),
    "line_x": ("line", "x_m", 1.0),
    "line_z": ("line", "z_m", 1.0),
    "line_lean": ("line", "eta_rad", _DEGREES),
    "age_pos": ("ages", "position_age_s", 1.0),
    "age_att": ("ages", "attitude_age_s", 1.0),
    "age_ap": ("ages", "heartbeat_age_s", 1.0),
    "clearance": ("margins", "clearance_m", 1.0),
    "stall": ("margins", "stall_rad", _DEGREES),
    "fc_state": ("forecast", "standing", 1.0),
    "fc_chance": ("forecast", "chance", 1.0),
    "fc_time": ("forecast", "ahead_s", 1.0),
    "fc_z": ("forecast", "z_m", 1.0),
}
# As they stood, not in between.
_STEPS: Final = frozenset(
    {"line_x", "line_z", "line_lean", "fc_state", "fc_chance", "fc_time", "fc_z"}
)


def recording_of(flight: FlightData, site: Site, air: MeasuredAir | None = None) -> dict[str, Any]:
    """As JSON: rows with the columns of `ROW`, texts, parameters, and what the log lacks.

    air: to measure with; it holds the whole flight then.
    """
    reported, position = flight.path, flight.position
    if reported is not None and position is not None and len(position) < len(reported):
        flight = replace(flight, position=None)  # the path as the module reported it has more
    flight = on_line(placed(flight, site.frame()))
    duration_s = flight.duration_s
    count = int(min(MOST_ROWS, max(2.0, duration_s * ROWS_PER_S)))
    times = np.linspace(0.0, duration_s, count)
    columns = [_column(flight, name, times) for name in ROW[1:]]
    rows = np.column_stack([times, *columns]).tolist()
    if air is not None:
        _measure(flight, air, duration_s)
    return {
        "measured": None if air is None else air.drawing,
        "rows": [[number(value) for value in row] for row in rows],
        "duration_s": duration_s,
        "name": flight.name,
        "kind": flight.kind,
        "texts": [
            {"time": round(e.time_s, 2), "kind": e.kind, "text": e.text} for e in flight.events
        ],
        "parameters": {name: number(value) for name, value in flight.parameters.items()},
        "missing": list(flight.missing),
        "lost": list(flight.lost),
    }


def _measure(flight: FlightData, air: MeasuredAir, duration_s: float) -> None:
    """All samples of the air, as far apart as telemetry's."""
    times = np.arange(0.0, duration_s, ARRAY_S)
    names = ("soar_x", "soar_z", "velocity_x", "wind", "updraft", "pushed")
    columns = [_value(flight, _SOURCES[name], times) for name in names]
    columns[-1] = np.nan_to_num(columns[-1])  # a log without a propeller has none
    modes = _modes(flight, times)
    air.bound(flight.parameters)
    for row, mode in zip(np.column_stack([times, *columns]).tolist(), modes.tolist(), strict=True):
        air.take(AirSample._make(row), flying=mode == mode and is_flying(int(mode)))
    air.draw_whole()


def _column(flight: FlightData, name: str, times: NDArray[np.float64]) -> NDArray[np.float64]:
    if name == "soar_mode":
        return _modes(flight, times)
    if name == "excess":
        return _value(flight, ("motion", "climb_mps", 1.0), times)  # in steady flight
    if name not in _SOURCES:
        return np.full(times.shape, np.nan)
    values = _value(flight, _SOURCES[name], times, held=name in _STEPS)
    return values - 90.0 if name == "line_lean" else values


def _value(
    flight: FlightData,
    source: tuple[str, str, float],
    times: NDArray[np.float64],
    *,
    held: bool = False,
) -> NDArray[np.float64]:
    of, column, factor = source
    series: Series | None = getattr(flight, of)
    if series is None or column not in series.columns:
        return np.full(times.shape, np.nan)
    values = series.last_at(column, times) if held else series.at(column, times)
    return np.asarray(values * factor, dtype=float)


def _modes(flight: FlightData, times: NDArray[np.float64]) -> NDArray[np.float64]:
    found = np.full(times.shape, np.nan)
    numbers = {name: float(i) for i, name in enumerate(MODE_NAMES)}
    for change in flight.modes:
        found[times >= change.time_s] = numbers.get(change.name, np.nan)
    return found
