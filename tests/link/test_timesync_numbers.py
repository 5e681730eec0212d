"""The round trip in numbers: when it asks, which answers count, what a queue is measured by."""

from __future__ import annotations

from math import isnan

import pytest

from tgl_soar.link.messages import Timesync
from tgl_soar.link.timesync import RoundTrip


def asked(trip: RoundTrip, now_s: float) -> Timesync:
    question = trip.poll(now_s)
    assert question is not None
    return question


def answer(trip: RoundTrip, now_s: float, way_s: float, there_s: float = 0.0) -> None:
    """A question now, whose answer comes so much later and says that it was `there_s`."""
    trip.take(Timesync(round(there_s * 1e9), asked(trip, now_s).ts1), now_s + way_s)


def asked_at(trip: RoundTrip, from_s: float) -> list[float]:
    """When it asks, of two seconds, looked at thirty-two times a second."""
    return [i / 32 for i in range(64) if trip.poll(from_s + i / 32) is not None]


def test_before_the_first_answer_nothing_is_known() -> None:
    trip = RoundTrip()
    assert (trip.asked, trip.answered, trip.queue_s) == (0, 0, 0.0)
    assert isnan(trip.round_trip_s)
    assert isnan(trip.offset_s)


def test_a_question_is_our_time_in_nanoseconds_and_never_the_zero_of_an_answer() -> None:
    """TIMESYNC: tc1 is 0 in a question; ts1 is when it was asked."""
    assert asked(RoundTrip(), 12.5) == Timesync(0, 12_500_000_000)
    assert asked(RoundTrip(), 0.0) == Timesync(0, 1)
    assert asked(RoundTrip(), -3.0) == Timesync(0, 1)


def test_it_asks_once_a_second_and_five_times_while_there_is_a_queue() -> None:
    trip = RoundTrip()
    assert asked_at(trip, 100.0) == [0.0, 1.0]
    for second in range(3):
        answer(trip, 200.0 + second, 0.01)
    for second in range(3, 14):
        answer(trip, 200.0 + second, 0.5)
    assert trip.queue_s > 0.0
    trip.poll(214.0)
    look_s = 7 / 32  # the first look after 0.2 s
    assert asked_at(trip, 300.0) == [i * look_s for i in range(10)]


def test_an_answer_says_how_long_the_way_is_and_how_far_the_clock_is_ahead() -> None:
    trip = RoundTrip()
    answer(trip, 100.0, 0.5, there_s=1100.25)
    assert trip.round_trip_s == pytest.approx(0.5)
    assert trip.offset_s == pytest.approx(1000.0)
    assert (trip.asked, trip.answered) == (1, 1)
    answer(trip, 101.0, 0.7, there_s=1500.0)
    assert trip.round_trip_s == pytest.approx(0.7)  # of the newest
    assert trip.offset_s == pytest.approx(1000.0)  # by the quickest


@pytest.mark.parametrize(("others", "is_kept"), [(7, True), (8, False)])
def test_the_quickest_is_looked_for_among_eight_answers(others: int, is_kept: bool) -> None:
    trip = RoundTrip()
    answer(trip, 100.0, 0.1, there_s=200.05)
    for i in range(1, others + 1):
        answer(trip, 100.0 + i, 0.2, there_s=300.1 + i)
    assert (trip.offset_s == pytest.approx(100.0)) is is_kept
    assert (trip.offset_s == pytest.approx(200.0)) is not is_kept


@pytest.mark.parametrize(("later", "counts"), [(15, True), (16, False)])
def test_sixteen_questions_wait_for_their_answers(later: int, counts: bool) -> None:
    trip = RoundTrip()
    first = asked(trip, 100.0)
    for i in range(1, later + 1):
        asked(trip, 100.0 + i)
    trip.take(Timesync(1, first.ts1), 120.0)
    assert trip.answered == counts


def test_an_answer_of_before_its_question_took_no_time() -> None:
    trip = RoundTrip()
    answer(trip, 100.0, -0.5)
    assert trip.round_trip_s == 0.0


@pytest.mark.parametrize(("slower_s", "queue_s"), [(0.049, 0.0), (0.06, 0.01), (0.5, 0.45)])
def test_a_queue_is_what_the_quickest_takes_longer_than_ever_but_for_fifty_milliseconds(
    slower_s: float, queue_s: float
) -> None:
    trip = RoundTrip()
    for i in range(5):
        answer(trip, 100.0 + i, 0.02)
    for i in range(8):
        answer(trip, 105.0 + i, 0.02 + slower_s + 0.1 * (i % 2))
    assert trip.queue_s == pytest.approx(queue_s, abs=1e-6)


@pytest.mark.parametrize(("after_s", "is_queue"), [(5.9, False), (6.1, True)])
def test_an_answer_counts_for_six_seconds(after_s: float, is_queue: bool) -> None:
    trip = RoundTrip()
    answer(trip, 100.0, 0.0)
    for i in range(1, 4):
        answer(trip, 101.0 + i, 0.5)
    answer(trip, 100.0 + after_s - 0.5, 0.5)
    assert (trip.queue_s > 0.0) is is_queue


def test_however_long_ago_three_answers_count() -> None:
    trip = RoundTrip()
    answer(trip, 100.0, 0.0)
    answer(trip, 200.0, 0.5)
    answer(trip, 300.0, 0.5)
    assert trip.queue_s == 0.0
    answer(trip, 400.0, 0.5)
    assert trip.queue_s == pytest.approx(0.45)


def test_after_a_restart_nothing_is_known_and_it_asks_at_once() -> None:
    trip = RoundTrip()
    answer(trip, 1000.0, 0.0, there_s=5000.0)
    waiting = asked(trip, 1001.0)
    trip.restart()
    assert isnan(trip.round_trip_s)
    assert isnan(trip.offset_s)
    trip.take(Timesync(1, waiting.ts1), 1001.5)  # of before
    assert trip.answered == 1
    answer(trip, 5.0, 0.5, there_s=105.25)
    assert trip.offset_s == pytest.approx(100.0)
    for i in range(5):
        answer(trip, 6.0 + i, 0.5)
    assert trip.queue_s == 0.0  # the quickest of before has expired
