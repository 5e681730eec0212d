"""Surveys of a contour that is known, and their logs."""

from __future__ import annotations

from math import cos, exp, radians, sin, sqrt

import numpy as np

from tgl_soar.analysis.logs.flight_data import Event, FlightData, Floats, series
from tgl_soar.analysis.survey.contour_fit import SurveyPath
from tgl_soar.control.survey import DOWNSTREAM, HOMEWARD, UPSTREAM
from tgl_soar.control.target_line import eta_from_lean

ETA = eta_from_lean(radians(15.0))
STEP_S, SPEED_MPS = 0.1, 0.06


def place(q: Floats) -> Floats:
    """s of q: steeper upstream, as over a board."""
    return -0.6 * q - 0.25 * q * q


def flown(
    return_per_s: float = 0.8, drift_m: float = 0.0, seed: int = 1, reach_m: float = 1.0
) -> SurveyPath:
    """There, back past the start, and home, with a rest at each turn."""
    legs = [(-1.0, reach_m, DOWNSTREAM), (1.0, 2.0 * reach_m, UPSTREAM), (-1.0, reach_m, HOMEWARD)]
    q, standing = [0.0], [float(DOWNSTREAM)]
    for sign, way, mode in legs:
        for n in range(round((5.0 + way / SPEED_MPS) / STEP_S)):
            q.append(q[-1] + (sign * SPEED_MPS * STEP_S if n * STEP_S >= 5.0 else 0.0))
            standing.append(float(mode))
    line_q = np.array(q)
    rng = np.random.default_rng(seed)
    kept = exp(-return_per_s * STEP_S)
    s = place(line_q).copy()
    for n in range(1, len(s)):
        gust = drift_m * sqrt(1.0 - kept * kept) * rng.normal()
        s[n] = place(line_q[n : n + 1])[0] + kept * (s[n - 1] - place(line_q[n - 1 : n])[0]) + gust
        s[n] -= kept * (place(line_q[n : n + 1])[0] - place(line_q[n - 1 : n])[0])
    c, t = cos(ETA), sin(ETA)
    return SurveyPath(
        time_s=STEP_S * np.arange(len(s), dtype=np.float64),
        x_m=c * s - t * line_q,
        z_m=t * s + c * line_q,
        line_x_m=-t * line_q,
        line_z_m=c * line_q,
        standing=np.array(standing),
        eta_rad=ETA,
    )


def true_points() -> list[Floats]:
    q = np.linspace(-1.5, 1.5, 400)
    s = place(q)
    points = np.stack([cos(ETA) * s - sin(ETA) * q, sin(ETA) * s + cos(ETA) * q], axis=1)
    return [points]


def logged(path: SurveyPath, *, ended: bool = True) -> FlightData:
    """As a log has it, 3 s into the flight, the second survey of it a part of the first."""
    turns = np.flatnonzero(np.diff(path.standing)) + 1
    events = [
        Event(3.0, "parameter", "SRV_START 0 → 1"),
        Event(3.0, "message", "survey: downstream at 0.06 m/s"),
    ]
    for n in turns:
        text = f"SRV_START {path.standing[n - 1]:g} → {path.standing[n]:g}"
        events.append(Event(3.0 + path.time_s[n], "parameter", text))
    if ended:
        events.append(Event(3.0 + path.time_s[-1], "parameter", "SRV_START 3 → 0"))
    times = path.time_s + 3.0
    nothing = np.zeros(len(times))
    return FlightData(
        "log",
        "a log",
        path=series(times, "tick", x_m=path.x_m, y_m=nothing, z_m=path.z_m),
        line=series(
            times,
            "tick",
            x_m=path.line_x_m,
            z_m=path.line_z_m,
            eta_rad=nothing + path.eta_rad,
            moving=nothing,
        ),
        events=tuple(events),
    )
