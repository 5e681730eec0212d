"""The contour that a survey has drawn, over the path that it was drawn from."""

from __future__ import annotations

from typing import Any

import numpy as np

from tgl_soar.analysis.logs.flight_data import FlightData
from tgl_soar.analysis.report.flight_report_figures import BLUE, INK, RED, WIDTH_IN, thinned
from tgl_soar.analysis.survey.contour_fit import (
    DrawnContour,
    SurveyError,
    SurveyPath,
    drawn_contour,
)
from tgl_soar.analysis.survey.surveys_from_log import surveys_of
from tgl_soar.control.survey import UPSTREAM


def survey_words(flight: FlightData) -> str:
    """The figure's caption."""
    words = (
        "The last survey's path, downstream and home in blue, upstream in grey, and the contour"
        " drawn from both, with two standard deviations along the line to either side; `tgl-soar"
        " survey` writes it into a site file."
    )
    drawn = _drawn(flight)
    if drawn is None:
        return words
    contour = drawn[1]
    sigma_cm, drift_cm = 100.0 * float(np.median(contour.sigma_m)), 100.0 * contour.drift_m
    return (
        f"{words} {contour.length_m:.2f} m of it, ± {sigma_cm:.1f} cm; the aircraft was"
        f" {100.0 * contour.late_m:.1f} cm late, returned to its place at"
        f" {contour.return_per_s:.2g} 1/s, and drifted by {drift_cm:.1f} cm rms."
    )


def survey_figure(plt: Any, flight: FlightData) -> Any:
    """Path and contour; None where there was no survey, or too little of one."""
    drawn = _drawn(flight)
    if drawn is None:
        return None
    path, contour = drawn
    figure, axes = plt.subplots(figsize=(WIDTH_IN, 4.0), layout="constrained")
    upstream = path.standing == UPSTREAM
    for way, colour in ((~upstream, BLUE), (upstream, "0.6")):
        x_m = np.where(way, path.x_m, np.nan)
        axes.plot(*thinned(x_m, path.z_m), color=colour, lw=0.6)
    along = 2.0 * contour.sigma_m
    rise = np.array([np.cos(path.eta_rad), np.sin(path.eta_rad)])
    for sign in (-1.0, 1.0):
        x_m, z_m = contour.x_m + sign * along * rise[0], contour.z_m + sign * along * rise[1]
        axes.plot(x_m, z_m, color=RED, lw=0.6, ls=":")
    axes.plot(contour.x_m, contour.z_m, color=INK, lw=1.4)
    axes.set(xlabel="x [m]", ylabel="z [m]", aspect="equal")
    return figure


def _drawn(flight: FlightData) -> tuple[SurveyPath, DrawnContour] | None:
    try:
        path = surveys_of(flight)[-1]
        return path, drawn_contour(path)
    except SurveyError:
        return None
