"""The surveys of a flight, from its log: SRV_START says when which way was flown."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from tgl_soar.analysis.logs.flight_data import Event, FlightData
from tgl_soar.analysis.survey.contour_fit import SurveyError, SurveyPath
from tgl_soar.control.survey import BEGINS, DOWNSTREAM, IDLE

SAMPLE_S: Final = 0.1  # a gust's effect lasts several of them
LEAN_RAD: Final = 0.005  # by which the line may have turned meanwhile: telemetry's last digit
SAME_S: Final = 1.0
_SHOWN: Final = re.compile(r"SRV_START (?:\S+ → )?(\d)")


def surveys_of(flight: FlightData) -> list[SurveyPath]:
    """All of them, in their order; a survey ends where SRV_START is 0 again, or with the log.

    Errors: `SurveyError` where the log holds none, or not what one is drawn from.
    """
    spans: list[list[tuple[float, int]]] = []
    for event in sorted(flight.events):
        standing = _standing(event)
        if standing is None:
            continue
        last_s, last = spans[-1][-1] if spans else (-np.inf, IDLE)
        # A value that is shown again, as when a station asks for all of them, is nothing new; a
        # beginning that is said again later is, where the log lacks the end before it.
        is_repeated = event.kind == "message" and event.time_s - last_s >= SAME_S
        if standing == last and not is_repeated:
            continue
        if standing == DOWNSTREAM or not spans:
            spans.append([])
        spans[-1].append((event.time_s, standing))
    if not spans:
        raise SurveyError(
            "the log holds no survey: set SRV_START to 1 while it soars, and wait until it is 0"
        )
    if flight.path is None or flight.line is None:
        lacking = "path in the soaring frame" if flight.path is None else "target gradient line"
        raise SurveyError(f"the log holds no {lacking}, from which a contour is drawn")
    return [_path(flight, span) for span in spans]


def _standing(event: Event) -> int | None:
    """SRV_START from here on; a telemetry log may have its beginning in words alone."""
    if event.kind == "message" and event.text.startswith(BEGINS):
        return DOWNSTREAM
    shown = _SHOWN.fullmatch(event.text) if event.kind == "parameter" else None
    return None if shown is None else int(shown[1])


def _path(flight: FlightData, span: list[tuple[float, int]]) -> SurveyPath:
    path, line = flight.path, flight.line
    assert path is not None
    assert line is not None
    begin_s, end_s = span[0][0], span[-1][0]
    if span[-1][1] != IDLE:  # the log ends before it
        end_s = float(path.time_s[-1])
    time_s = np.arange(begin_s, end_s, SAMPLE_S)
    turns = np.array([time for time, _ in span])
    standings = np.array([standing for _, standing in span], dtype=float)
    eta = line.last_at("eta_rad", time_s)
    known = eta[np.isfinite(eta)]
    eta_rad = float(np.median(known)) if len(known) else float("nan")
    if len(known) and float(np.abs(known - eta_rad).max()) > LEAN_RAD:
        raise SurveyError("the line has turned in the survey: a contour is drawn by one lean")
    return SurveyPath(
        time_s=time_s,
        x_m=path.at("x_m", time_s),
        z_m=path.at("z_m", time_s),
        line_x_m=line.last_at("x_m", time_s),
        line_z_m=line.last_at("z_m", time_s),
        standing=standings[np.searchsorted(turns, time_s, side="right") - 1],
        eta_rad=eta_rad,
    )
