"""A contour drawn from slides whose contour is known."""

from __future__ import annotations

import numpy as np
import pytest
from slid_contour import ETA, SPEED_MPS, flown, logged, true_points

from tgl_soar.analysis.experiments.lift.survey import errors_of
from tgl_soar.analysis.logs.flight_data import Event, FlightData
from tgl_soar.analysis.survey.contour_fit import (
    RETURNS_PER_S,
    WIDTHS,
    SurveyError,
    drawn_contour,
)
from tgl_soar.analysis.survey.surveys_from_log import surveys_of
from tgl_soar.control.survey import DOWNSTREAM, HOMEWARD, UPSTREAM


def test_widths_and_rates_of_a_contour_fit_are_those_that_hills_and_tunnels_need() -> None:
    assert WIDTHS == (6.0, 8.0, 12.0, 16.0, 24.0, 48.0)
    assert (RETURNS_PER_S[0], RETURNS_PER_S[-1], len(RETURNS_PER_S)) == (
        0.1, pytest.approx(3.2), 11,
    )  # fmt: skip
    ratios = np.diff(np.log2(RETURNS_PER_S))
    assert ratios == pytest.approx(np.full(10, 0.5))


@pytest.mark.parametrize("return_per_s", [0.4, 0.8, 1.6])
def test_without_gusts_the_lag_is_taken_out(return_per_s: float) -> None:
    path = flown(return_per_s)
    drawn = drawn_contour(path)
    # Behind by q' f' / lambda: 9 cm at the slowest return, of which the drawn contour has nothing.
    assert np.abs(errors_of(drawn, true_points())).max() < 0.01
    assert drawn.return_per_s == pytest.approx(return_per_s, rel=0.5)
    assert drawn.late_m == pytest.approx(0.6 * SPEED_MPS / return_per_s, rel=0.5)


def test_it_runs_upstream_with_rising_air_on_its_left() -> None:
    drawn = drawn_contour(flown())
    assert np.all(np.diff(drawn.x_m) < 0.0)


def test_in_gusts_it_is_as_good_as_it_claims() -> None:
    """Ten times eight centimetres of drift: the mean square of error over claim is about 1."""
    ratios, errors = [], []
    for seed in range(10):
        drawn = drawn_contour(flown(drift_m=0.08, seed=seed))
        error = errors_of(drawn, true_points())[4:-4]
        errors.append(float(np.sqrt(np.mean(error**2))))
        # The claim is along the line, the error is across the contour, which is nearer.
        ratios.append(float(np.mean((error / drawn.sigma_m[4:-4]) ** 2)))
    assert np.mean(errors) < 0.03
    assert 0.3 < np.mean(ratios) < 3.0


def test_what_is_too_short_draws_nothing() -> None:
    path = flown()
    one_way = path._replace(standing=np.full(len(path.time_s), float(DOWNSTREAM)))
    with pytest.raises(SurveyError, match="on the way upstream"):
        drawn_contour(one_way)
    short = flown(reach_m=0.04)
    slow = short._replace(time_s=5.0 * short.time_s)
    with pytest.raises(SurveyError, match="passed both ways"):
        drawn_contour(slow)


@pytest.mark.parametrize("ended", [True, False])
def test_a_log_tells_when_which_way_was_flown(ended: bool) -> None:
    path = flown()
    (found,) = surveys_of(logged(path, ended=ended))
    assert found.eta_rad == pytest.approx(ETA)
    assert abs(len(found.time_s) - len(path.time_s)) < 5
    drawn = drawn_contour(found)
    assert np.abs(errors_of(drawn, true_points())).max() < 0.015
    assert list(dict.fromkeys(found.standing)) == [DOWNSTREAM, UPSTREAM, HOMEWARD]


def test_a_log_without_a_survey_and_a_line_that_turned_are_reported() -> None:
    with pytest.raises(SurveyError, match="holds no survey: set SRV_START"):
        surveys_of(FlightData("log", "a log"))
    flight = logged(flown())
    bare = FlightData("log", "a log", line=flight.line, events=flight.events)
    with pytest.raises(SurveyError, match="no path"):
        surveys_of(bare)
    assert flight.line is not None
    flight.line["eta_rad"][50:] += 0.1
    with pytest.raises(SurveyError, match="turned"):
        surveys_of(flight)


def test_a_telemetry_log_that_has_the_beginning_in_words_alone_draws_the_same() -> None:
    whole = logged(flown())
    late = FlightData(**{**vars(whole), "events": whole.events[1:]})
    assert whole.events[0].text == "SRV_START 0 → 1"
    (first,), (second,) = surveys_of(whole), surveys_of(late)
    assert np.array_equal(first.time_s, second.time_s)
    assert np.array_equal(first.standing, second.standing)


def test_a_value_that_is_shown_again_begins_and_ends_nothing() -> None:
    whole = logged(flown())
    end_s = whole.events[-1].time_s
    shown = [
        Event(1.0, "parameter", "SRV_START 0"),
        *whole.events,
        Event(20.0, "parameter", "SRV_START 1"),
        Event(end_s + 30.0, "parameter", "SRV_START 0"),
    ]
    (found,) = surveys_of(FlightData(**{**vars(whole), "events": shown}))
    (alone,) = surveys_of(whole)
    assert np.array_equal(found.time_s, alone.time_s)
    assert np.array_equal(found.standing, alone.standing)
    nothing = FlightData(**{**vars(whole), "events": shown[:1]})
    with pytest.raises(SurveyError, match="holds no survey"):
        surveys_of(nothing)
