"""Where a log has a survey begin, which is reported by a value and by words."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from slid_contour import flown, logged

from tgl_soar.analysis.logs.flight_data import Event, FlightData, Series
from tgl_soar.analysis.survey.contour_fit import SurveyError
from tgl_soar.analysis.survey.surveys_from_log import SAME_S, surveys_of
from tgl_soar.control.survey import BEGINS


def with_words(after_s: float) -> FlightData:
    """The words come so long after the value, as over a radio that is busy."""
    whole = logged(flown())
    begun, words, *more = whole.events
    assert words.text.startswith(BEGINS)
    later = Event(begun.time_s + after_s, "message", words.text)
    return FlightData(**{**vars(whole), "events": (begun, later, *more)})


@pytest.mark.parametrize("after_s", [0.1, 0.9 * SAME_S])
def test_words_that_come_behind_the_value_begin_no_second_survey(after_s: float) -> None:
    (alone,) = surveys_of(logged(flown()))
    (found,) = surveys_of(with_words(after_s))
    assert np.array_equal(found.time_s, alone.time_s)
    assert np.array_equal(found.standing, alone.standing)


def test_words_long_after_it_do() -> None:
    """They are not reported twice: the log lacks the end of the one before."""
    first, second = surveys_of(with_words(1.1 * SAME_S))
    assert second.time_s[0] == pytest.approx(first.time_s[0] + 1.1 * SAME_S)


# --- the log of a line that goes by a metre a second, downstream and back ---------------------


def noted(*standings: tuple[float, str], until_s: float = 20.0, **line: Any) -> FlightData:
    """SRV_START as it was shown, in a flight whose path and line say their time."""
    time = np.arange(0.0, until_s + 0.01, 0.05)
    zero = 0.0 * time
    events = tuple(Event(t, "parameter", f"SRV_START {words}") for t, words in standings)
    path = Series(time, {"x_m": time, "y_m": zero, "z_m": 2.0 * time}, "test")
    columns = {"x_m": 3.0 * time, "z_m": 4.0 * time, "eta_rad": zero + 1.8, "moving": zero, **line}
    return FlightData("log", "a log", path=path, line=Series(time, columns, "test"), events=events)


WHOLE = ((2.0, "0 → 1"), (5.0, "1 → 2"), (9.0, "2 → 3"), (12.0, "3 → 0"))


def test_a_survey_is_sampled_ten_times_a_second_from_its_beginning_to_its_end() -> None:
    (found,) = surveys_of(noted(*WHOLE))
    assert found.time_s == pytest.approx(2.0 + 0.1 * np.arange(100))
    assert found.x_m == pytest.approx(found.time_s)
    assert found.z_m == pytest.approx(2.0 * found.time_s)
    # The line's are the last that were logged, which are those of a twentieth ago at most.
    assert (np.abs(found.line_x_m - 3.0 * found.time_s) <= 0.15 + 1e-9).all()
    assert (np.abs(found.line_z_m - 4.0 * found.time_s) <= 0.2 + 1e-9).all()
    assert found.eta_rad == pytest.approx(1.8)
    ways = [float(found.standing[np.searchsorted(found.time_s, t)]) for t in (2.0, 4.85, 5.05)]
    assert ways == [1.0, 1.0, 2.0]
    assert set(found.standing[found.time_s > 9.01].tolist()) == {3.0}


def test_a_survey_that_the_log_does_not_see_the_end_of_ends_with_it() -> None:
    (found,) = surveys_of(noted(*WHOLE[:2], until_s=7.0))
    assert found.time_s[-1] == pytest.approx(6.9)
    assert set(found.standing.tolist()) == {1.0, 2.0}


def test_events_are_taken_in_the_order_of_their_times() -> None:
    (found,) = surveys_of(noted(*WHOLE))
    (other,) = surveys_of(noted(*reversed(WHOLE)))
    assert np.array_equal(found.time_s, other.time_s)
    assert np.array_equal(found.standing, other.standing)


def test_a_second_beginning_is_a_second_survey_and_what_is_shown_again_is_none() -> None:
    again = ((6.0, "2"), (7.0, "2"), (14.0, "0"), (15.0, "0 → 1"), (16.0, "1"), (18.0, "1 → 0"))
    first, second = surveys_of(noted(*WHOLE, *again))
    assert (first.time_s[0], first.time_s[-1]) == pytest.approx((2.0, 11.9))
    assert (second.time_s[0], second.time_s[-1]) == pytest.approx((15.0, 17.9))
    assert set(second.standing.tolist()) == {1.0}


def test_a_log_that_begins_within_a_survey_has_the_rest_of_it() -> None:
    (found,) = surveys_of(noted((3.0, "2"), (8.0, "2 → 0")))
    assert (found.time_s[0], found.time_s[-1]) == pytest.approx((3.0, 7.9))
    assert set(found.standing.tolist()) == {2.0}


@pytest.mark.parametrize(
    ("events", "found"),
    [
        ((), 0),
        ((Event(2.0, "message", "SRV_START 1"),), 0),
        ((Event(2.0, "parameter", "SRV_STARTS 1"), Event(3.0, "parameter", "TGL_X 1")), 0),
        ((Event(2.0, "parameter", "SRV_START 0"),), 0),
        ((Event(2.0, "parameter", "SRV_START 1"),), 1),
        ((Event(2.0, "message", f"{BEGINS} at 0.06 m/s"),), 1),
        ((Event(2.0, "parameter", f"{BEGINS} at 0.06 m/s"),), 0),
    ],
)
def test_a_beginning_is_a_value_or_the_modules_words(events: tuple[Event, ...], found: int) -> None:
    flight = replace(noted(), events=events)
    if found:
        assert len(surveys_of(flight)) == found
    else:
        with pytest.raises(SurveyError, match=r"holds no survey: set SRV_START to 1 while it"):
            surveys_of(flight)


@pytest.mark.parametrize(
    ("part", "says"),
    [
        ("path", "the log holds no path in the soaring frame, from which a contour is drawn"),
        ("line", "the log holds no target gradient line, from which a contour is drawn"),
    ],
)
def test_what_a_contour_is_drawn_from_is_named_where_it_is_missing(part: str, says: str) -> None:
    without = cast("dict[str, Any]", {part: None})
    with pytest.raises(SurveyError, match=says):
        surveys_of(replace(noted(*WHOLE), **without))


@pytest.mark.parametrize(("by_rad", "is_turned"), [(0.004, False), (-0.004, False), (0.006, True),
                                                   (-0.006, True)])  # fmt: skip
def test_a_line_that_turns_in_the_survey_draws_no_contour(by_rad: float, is_turned: bool) -> None:
    """By five thousandths of a radian from what it mostly was; what turns before does not count."""
    time = np.arange(0.0, 20.01, 0.05)
    early = np.where(time < 1.5, 0.5, 0.0)
    eta = 1.8 + early + np.where((time > 6.0) & (time < 7.0), by_rad, 0.0)
    eta[(time > 10.0) & (time < 11.0)] = np.nan  # not known: of these nothing is held against it
    flight = noted(*WHOLE, eta_rad=eta)
    if is_turned:
        with pytest.raises(SurveyError, match="the line has turned in the survey"):
            surveys_of(flight)
    else:
        (found,) = surveys_of(flight)
        assert found.eta_rad == pytest.approx(1.8)
    (unknown,) = surveys_of(noted(*WHOLE, eta_rad=np.nan * time))
    assert np.isnan(unknown.eta_rad)
