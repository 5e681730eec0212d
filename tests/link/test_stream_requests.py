"""Requests for streams: one at a time, again where too little comes, lower where it is denied."""

from __future__ import annotations

from itertools import pairwise

import pytest

from tgl_soar.link.messages import (
    COMMAND_SET_MESSAGE_INTERVAL,
    COMPONENT_AUTOPILOT,
    RESULT_ACCEPTED,
    RESULT_CANCELLED,
    RESULT_DENIED,
    RESULT_FAILED,
    RESULT_IN_PROGRESS,
    RESULT_TEMPORARILY_REJECTED,
    RESULT_UNSUPPORTED,
)
from tgl_soar.link.stream_requests import LOWER_RATES_HZ, RequestedStream, StreamRequests


def asked(requests: StreamRequests, now_s: float) -> tuple[float, float] | None:
    """(message, interval [us]) of the request that is due."""
    commands = requests.poll(now_s)
    if not commands:
        return None
    (command,) = commands
    assert command.command == COMMAND_SET_MESSAGE_INTERVAL
    assert (command.target_system, command.target_component) == (7, COMPONENT_AUTOPILOT)
    assert (command.confirmation, command.params[2:]) == (0, (0.0,) * 5)
    return command.params[0], command.params[1]


def wanting(*rates: float) -> StreamRequests:
    requests = StreamRequests(7)
    for number, rate_hz in enumerate(rates, 30):
        requests.want(number, f"S{number}", rate_hz)
    return requests


def flow(requests: StreamRequests, number: int, count: int) -> None:
    for _ in range(count):
        requests.received(number)


def test_a_stream_begins_with_nothing() -> None:
    stream = RequestedStream(1, "X", 5.0, 5.0)
    assert (stream.count, stream.measured_hz, stream.wait_s) == (0, 0.0, 2.0)
    assert (stream.given_up, stream.reported, stream.refused_once) == (False, False, False)


def test_one_is_asked_for_at_a_time_and_the_next_once_it_is_answered_or_half_a_second_is_over() -> (
    None
):
    requests = wanting(200.0, 50.0, 3.0)
    assert asked(requests, 10.0) == (30.0, 5000.0)
    assert asked(requests, 10.4) is None
    requests.acknowledged(RESULT_ACCEPTED, 10.4)
    assert asked(requests, 10.4) == (31.0, 20000.0)
    assert asked(requests, 10.89) is None
    assert asked(requests, 10.91) == (32.0, 333333.0)
    assert requests.requests == 3
    requests.acknowledged(RESULT_ACCEPTED, 10.92)
    assert asked(requests, 11.9) is None


def test_an_urgent_one_comes_before_all_others_and_another_rate_is_asked_for_again() -> None:
    requests = wanting(200.0, 50.0)
    requests.want(99, "NOW", 10.0, urgent=True)
    assert asked(requests, 10.0) == (99.0, 100000.0)
    requests.acknowledged(RESULT_ACCEPTED, 10.0)
    assert [each.message_id for each in requests.all_wanted()] == [99, 30, 31]
    requests.want(99, "NOW", 10.0)  # the same once more changes nothing
    stream = requests.wanted(99)
    assert stream is not None
    requests.want(99, "NOW", 20.0)
    again = requests.wanted(99)
    assert again is not stream
    assert again is not None
    assert again.rate_hz == 20.0


@pytest.mark.parametrize(("count", "enough"), [(15, True), (13, False)])
def test_seven_tenths_of_the_rate_are_enough_measured_over_two_seconds(
    count: int, enough: bool
) -> None:
    requests = wanting(10.0)
    assert asked(requests, 10.0) is not None
    requests.acknowledged(RESULT_ACCEPTED, 10.0)
    flow(requests, 30, count)
    assert asked(requests, 11.9) is None
    assert (asked(requests, 12.0) is None) == enough
    stream = requests.wanted(30)
    assert stream is not None
    assert stream.measured_hz == pytest.approx(count / 2.0)
    assert stream.count == 0


def test_what_does_not_come_is_asked_for_ever_less_often_until_every_sixteen_seconds() -> None:
    requests, times, now_s = wanting(10.0), [], 0.0
    while now_s < 120.0:
        if asked(requests, now_s) is not None:
            times.append(now_s)
            requests.acknowledged(RESULT_ACCEPTED, now_s)
        now_s += 0.01
    steps = [later - before for before, later in pairwise(times)]
    wanted = [2.0, 3.0, 4.5, 6.75, 10.125, 15.1875, 16.0, 16.0]
    assert steps[:8] == pytest.approx(wanted, abs=0.03)
    # What comes again begins with two seconds.
    flow(requests, 30, 10_000)
    while requests.wanted(30).measured_hz < 7.0:  # type: ignore[union-attr]
        assert asked(requests, now_s) is None
        now_s += 0.01
    assert requests.wanted(30).wait_s == 2.0  # type: ignore[union-attr]


@pytest.mark.parametrize(
    "result", [RESULT_ACCEPTED, RESULT_IN_PROGRESS, RESULT_TEMPORARILY_REJECTED]
)
def test_what_is_no_refusal_gives_nothing_up(result: int) -> None:
    requests = wanting(200.0)
    asked(requests, 10.0)
    requests.acknowledged(result, 10.1)
    stream = requests.wanted(30)
    assert stream is not None
    assert (stream.rate_hz, stream.given_up, requests.notices) == (200.0, False, [])
    requests.acknowledged(RESULT_DENIED, 10.2)  # this one is not waited for
    assert (stream.rate_hz, requests.notices) == (200.0, [])


def test_a_rate_that_is_denied_is_asked_for_lower_at_once_and_reported_once() -> None:
    requests = wanting(200.0)
    asked(requests, 10.0)
    requests.acknowledged(RESULT_DENIED, 10.1)
    ((stream, word, refused_hz),) = requests.notices
    assert (word, refused_hz, stream.rate_hz) == ("denied", 200.0, 160.0)
    assert asked(requests, 10.1) == (30.0, 6250.0)
    requests.acknowledged(RESULT_DENIED, 10.2)
    assert stream.rate_hz == 125.0
    assert len(requests.notices) == 1


@pytest.mark.parametrize(
    ("result", "word"),
    [
        (RESULT_UNSUPPORTED, "unsupported"),
        (RESULT_FAILED, "failed"),
        (RESULT_CANCELLED, "answered with result 6"),
    ],
)
def test_what_is_refused_otherwise_or_at_any_rate_is_given_up(result: int, word: str) -> None:
    requests = wanting(200.0)
    asked(requests, 10.0)
    requests.acknowledged(result, 10.1)
    ((stream, given, refused_hz),) = requests.notices
    assert (given, refused_hz, stream.given_up) == (word, 200.0, True)
    assert requests.all_wanted() == []
    assert asked(requests, 60.0) is None
    slow = wanting(1.0)
    asked(slow, 10.0)
    slow.acknowledged(RESULT_DENIED, 10.1)
    assert slow.wanted(30).given_up  # type: ignore[union-attr]


@pytest.mark.parametrize(("late_s", "accepted"), [(1.9, False), (2.1, True)])
def test_a_refusal_soon_after_an_answer_that_did_not_come_may_be_of_the_one_before(
    late_s: float, accepted: bool
) -> None:
    requests = wanting(200.0, 50.0)
    asked(requests, 10.0)
    assert asked(requests, 10.5) == (31.0, 20000.0)  # the first is given up
    requests.acknowledged(RESULT_UNSUPPORTED, 10.5 + late_s)
    stream = requests.wanted(31)
    assert stream is not None
    assert stream.given_up == accepted
    assert stream.refused_once != accepted
    if not accepted:  # asked for again, a second refusal is one
        requests._waiting = stream
        requests.acknowledged(RESULT_UNSUPPORTED, 10.5 + late_s)
        assert stream.given_up


def test_a_rate_that_was_denied_is_asked_for_again_after_a_restart_and_reported_again() -> None:
    """The way out of what is denied takes a restart of the autopilot."""
    requests, denied = wanting(100.0), [100.0, 80.0, 50.0]
    for times in (1, 2):
        for rate_hz in denied:
            assert asked(requests, 10.0) == (30.0, 1e6 / rate_hz)
            requests.acknowledged(RESULT_DENIED, 10.0)
        assert [rate_hz for _, _, rate_hz in requests.notices] == [100.0] * times
        requests.want(30, "S30", 100.0)  # the same as before: it stays at what is allowed
        assert asked(requests, 10.0) == (30.0, 25000.0)
        requests.restart()


def test_an_autopilot_that_has_restarted_is_asked_for_all_of_it_again() -> None:
    requests = wanting(200.0, 50.0)
    asked(requests, 10.0)
    requests.acknowledged(RESULT_UNSUPPORTED, 10.1)
    asked(requests, 10.1)
    requests.restart()
    assert asked(requests, 10.2) == (30.0, 5000.0)
    requests.acknowledged(RESULT_ACCEPTED, 10.2)
    assert asked(requests, 10.2) == (31.0, 20000.0)
    assert len(requests.all_wanted()) == 2


def test_the_next_lower_rate_is_no_less_than_two_fifths() -> None:
    """An autopilot that would give 10 Hz of 20 is not left with 5."""
    assert all(0.4 <= lower / higher < 1.0 for higher, lower in pairwise(LOWER_RATES_HZ))
    assert (LOWER_RATES_HZ[0], LOWER_RATES_HZ[-1]) == (160.0, 1.0)
