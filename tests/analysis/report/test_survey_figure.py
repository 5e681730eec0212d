"""The report's figure of a survey, and its caption."""

from __future__ import annotations

from collections.abc import Iterator
from math import cos, pi, sin
from typing import Any

import numpy as np
import pytest

pytest.importorskip("matplotlib")

import matplotlib.pyplot as plt

from tgl_soar.analysis.logs.flight_data import FlightData
from tgl_soar.analysis.report import survey_figure as module
from tgl_soar.analysis.report.flight_report_figures import BLUE, INK, RED
from tgl_soar.analysis.report.survey_figure import survey_figure, survey_words
from tgl_soar.analysis.survey.contour_fit import DrawnContour, SurveyError, SurveyPath
from tgl_soar.control.survey import DOWNSTREAM, HOMEWARD, UPSTREAM

ETA = 0.5 * pi + 0.25
FLIGHT = FlightData("log", "a log")
PATH = SurveyPath(
    time_s=np.arange(5.0),
    x_m=np.array([0.0, 1.0, 2.0, 3.0, 4.0]),
    z_m=np.array([5.0, 6.0, 7.0, 8.0, 9.0]),
    line_x_m=np.zeros(5),
    line_z_m=np.zeros(5),
    standing=np.array([DOWNSTREAM, DOWNSTREAM, UPSTREAM, UPSTREAM, HOMEWARD], dtype=float),
    eta_rad=ETA,
)
CONTOUR = DrawnContour(
    x_m=np.array([0.0, 3.0, 3.0]),
    z_m=np.array([0.0, 4.0, 6.0]),
    sigma_m=np.array([0.01, 0.02, 0.09]),
    return_per_s=0.425,
    late_m=0.0567,
    drift_m=0.0321,
)


@pytest.fixture(autouse=True)
def _drawn(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Two surveys, of which the last counts."""
    monkeypatch.setattr(module, "surveys_of", lambda _flight: ["another", PATH])
    monkeypatch.setattr(module, "drawn_contour", lambda path: CONTOUR if path is PATH else None)
    yield
    plt.close("all")


def none(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    def refuse(_given: Any) -> Any:
        raise SurveyError("too short")

    monkeypatch.setattr(module, name, refuse)


def test_the_caption_says_how_long_the_contour_is_and_how_well_it_is_known() -> None:
    words = survey_words(FLIGHT)
    assert words.endswith(
        " 7.00 m of it, ± 2.0 cm; the aircraft was 5.7 cm late, returned to its place at"
        " 0.42 1/s, and drifted by 3.2 cm rms."
    )
    assert "downstream and home in blue, upstream in grey" in words


@pytest.mark.parametrize("name", ["surveys_of", "drawn_contour"])
def test_without_a_survey_there_is_neither_figure_nor_number(
    monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    none(monkeypatch, name)
    assert survey_figure(plt, FLIGHT) is None
    assert survey_words(FLIGHT).endswith("`tgl-soar survey` writes it into a site file.")


def test_ways_are_marked_by_colour_and_two_deviations_along_the_line_by_dots() -> None:
    (axes,) = survey_figure(plt, FLIGHT).axes
    down, up, below, above, contour = axes.lines
    assert [down.get_color(), up.get_color()] == [BLUE, "0.6"]
    for line, shown in ((down, [0.0, 1.0, None, None, 4.0]), (up, [None, None, 2.0, 3.0, None])):
        x = [None if np.isnan(v) else v for v in line.get_xdata().tolist()]
        assert x == shown
        assert line.get_ydata().tolist() == PATH.z_m.tolist()
    for line, sign in ((below, -1.0), (above, 1.0)):
        assert line.get_xdata() == pytest.approx(
            CONTOUR.x_m + sign * 2.0 * CONTOUR.sigma_m * cos(ETA)
        )
        assert line.get_ydata() == pytest.approx(
            CONTOUR.z_m + sign * 2.0 * CONTOUR.sigma_m * sin(ETA)
        )
        assert (line.get_color(), line.get_linestyle()) == (RED, ":")
    assert contour.get_xydata().tolist() == [[0.0, 0.0], [3.0, 4.0], [3.0, 6.0]]
    assert contour.get_color() == INK
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_aspect()) == ("x [m]", "z [m]", 1.0)
