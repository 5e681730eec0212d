"""Where a log has a survey begin, which is told by a value and by words."""

from __future__ import annotations

import numpy as np
import pytest
from slid_contour import flown, logged

from tgl_soar.analysis.logs.flight_data import Event, FlightData
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
    """Nobody says them twice: the log lacks the end of the one before."""
    first, second = surveys_of(with_words(1.1 * SAME_S))
    assert second.time_s[0] == pytest.approx(first.time_s[0] + 1.1 * SAME_S)
