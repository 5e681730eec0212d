"""The round trip, and a queue on the autopilot's link: by arrivals alone it is another clock."""

from collections.abc import Callable
from heapq import heapify, heappop, heappush
from math import inf
from typing import NamedTuple

import pytest

from tgl_soar.link.autopilots.ardupilot import ArduPilot
from tgl_soar.link.autopilots.base import SurfaceChannel, SurfaceChannels
from tgl_soar.link.messages import (
    AttitudeQuaternion,
    Heartbeat,
    Inbound,
    Received,
    Source,
    Timesync,
)
from tgl_soar.link.session import Session, SessionOptions
from tgl_soar.link.timesync import RECENT_S, SLACK_S, RoundTrip

SERVO = SurfaceChannel(channel=1, pwm_min=1100, pwm_trim=1500, pwm_max=1900)
RATE_HZ = 100
QUICK_S = 0.01  # of either way
BEGINS_S = 20.0
UPTIME_S, CLOCK_S = 50.0, 1000.0  # of the autopilot and of ours at the beginning
AGE_MAX_S = 0.2  # AGE_ATT_MAX


class Age(NamedTuple):
    """Of the newest attitude, when it comes."""

    now_s: float
    true_s: float
    shown_s: float


def ages(
    queue_s: Callable[[float], float],
    for_s: float,
    pace: float = 1.0,
    silent_from_s: float = inf,
) -> tuple[list[Age], Session]:
    """Attitudes of an autopilot whose line has a queue, and the answers behind them.

    `pace`: of its clock.  silent_from_s: it answers no more.
    """
    channels = SurfaceChannels(elevator=SERVO, aileron=SERVO, rudder=SERVO)
    own = Source(1, 191)
    session = Session(SessionOptions(own=own, flavour=ArduPilot(channels, 1), loop_rate_hz=RATE_HZ))
    count, found = 0, []
    coming: list[tuple[float, int, float, Inbound]] = []  # (when it comes, number, when sent, what)

    def sent(at_s: float, message: Inbound) -> None:
        nonlocal count
        count += 1
        heappush(coming, (at_s + QUICK_S + queue_s(at_s), count, at_s, message))

    for i in range(round(for_s * RATE_HZ)):
        at_s = i / RATE_HZ
        stamp = round(1e3 * (UPTIME_S + pace * at_s))
        attitude = AttitudeQuaternion(
            time_boot_ms=stamp, q1=1, q2=0, q3=0, q4=0, rollspeed=0, pitchspeed=0, yawspeed=0
        )
        sent(at_s, attitude)
        if i % RATE_HZ == 0:
            sent(
                at_s, Heartbeat(type=1, autopilot=3, base_mode=129, custom_mode=0, system_status=4)
            )
    heapify(coming)
    while coming and coming[0][0] < for_s:
        now_s, _, at_s, message = heappop(coming)
        session.handle(Received(session.autopilot, message), CLOCK_S + now_s)
        for asked in session.poll(CLOCK_S + now_s):
            if isinstance(asked, Timesync) and asked.tc1 == 0 and now_s < silent_from_s:
                there_s = now_s + QUICK_S
                sent(there_s, Timesync(round(1e9 * (UPTIME_S + pace * there_s)), asked.ts1))
        if isinstance(message, AttitudeQuaternion):
            shown_s = CLOCK_S + now_s - session.attitude.time_s
            found.append(Age(now_s, now_s - at_s, shown_s))
    return found, session


def test_a_queue_that_grows_slowly_is_seen_before_data_are_old() -> None:
    found, session = ages(lambda at_s: max(0.0, 0.04 * (at_s - BEGINS_S)), 60.0)
    assert found[-1].true_s > 1.0
    first = next(age for age in found if age.shown_s > AGE_MAX_S)
    assert first.true_s < 0.3 + QUICK_S
    grown_s = 0.04 * RECENT_S + SLACK_S
    assert max(age.true_s - age.shown_s for age in found) < grown_s + 2 * QUICK_S
    assert any("later than before" in text for _, text in session.notices)


def test_a_queue_that_lasts_is_no_clock() -> None:
    """It begins at once; what left the window the round trip shows."""
    found, _ = ages(lambda at_s: 0.15 if at_s > BEGINS_S else 0.0, 60.0)
    late = [age for age in found if age.now_s > BEGINS_S + RECENT_S + 1.0]
    assert min(age.shown_s for age in late) == pytest.approx(0.15 - SLACK_S, abs=QUICK_S)


def test_a_queue_that_has_gone_is_forgotten() -> None:
    found, session = ages(lambda at_s: 0.15 if 20.0 < at_s < 40.0 else 0.0, 60.0)
    assert session.round_trip.queue_s == 0.0
    assert max(age.shown_s for age in found if age.now_s > 41.0) < QUICK_S


def test_of_a_queue_after_which_no_answer_comes_the_end_is_not_known() -> None:
    """Its age counts on, and is reported every ten seconds."""
    found, session = ages(lambda at_s: 0.15 if 20.0 < at_s < 40.0 else 0.0, 70.0, 1.0, 39.0)
    assert found[-1].shown_s == pytest.approx(0.15 - SLACK_S + QUICK_S, abs=QUICK_S)
    reported = [text for _, text in session.notices if "no answer to TIMESYNC" in text]
    assert reported[0].endswith("samples count as 0.10 s late still")
    silent = [int(text.split(" for ")[1].split(" s")[0]) for text in reported]
    assert silent[0] >= RECENT_S
    assert silent == [silent[0], silent[0] + 10, silent[0] + 20]


@pytest.mark.parametrize("pace", [0.98, 1.0, 1.02])
def test_a_clock_of_another_pace_is_no_queue(pace: float) -> None:
    found, session = ages(lambda _: 0.0, 60.0, pace)
    assert session.round_trip.queue_s == 0.0
    assert not session.notices
    assert max(age.shown_s for age in found) < 0.15  # what 2 % are in the window, and a stamp


def test_one_slow_answer_is_no_queue() -> None:
    """Not even after a silence."""
    trip = RoundTrip()

    def answered(now_s: float, after_s: float) -> None:
        asked = trip.poll(now_s)
        assert asked is not None
        trip.take(Timesync(1, asked.ts1), now_s + after_s)

    answered(1.0, 0.01)
    answered(2.0, 0.01)
    answered(3.0, 0.01)
    answered(60.0, 0.4)
    assert trip.queue_s == 0.0
    answered(61.0, 0.4)
    assert trip.queue_s == 0.0
    answered(62.0, 0.4)
    assert trip.queue_s == pytest.approx(0.4 - 0.01 - SLACK_S)
    trip.restart()
    assert trip.queue_s == 0.0


def test_the_round_trip_and_the_offset_are_measured() -> None:
    trip = RoundTrip()
    offset_s = 1234.5
    for i in range(20):
        now_s = 100.0 + i
        question = trip.poll(now_s)
        assert question is not None
        assert trip.poll(now_s + 0.5) is None
        out_s, back_s = (0.010, 0.010) if i == 15 else (0.010, 0.050)
        there_ns = round((now_s + out_s + offset_s) * 1e9)
        trip.take(Timesync(there_ns, question.ts1), now_s + out_s + back_s)
    assert trip.round_trip_s == pytest.approx(0.060, abs=1e-6)
    assert trip.offset_s == pytest.approx(offset_s, abs=1e-6)  # by the quickest answer
    assert (trip.asked, trip.answered) == (20, 20)


def test_answers_to_others_and_answers_twice_say_nothing() -> None:
    trip = RoundTrip()
    question = trip.poll(10.0)
    assert question is not None
    trip.take(Timesync(5, question.ts1 + 1), 10.1)
    assert trip.answered == 0
    trip.take(Timesync(5, question.ts1), 10.1)
    trip.take(Timesync(5, question.ts1), 99.0)
    assert trip.answered == 1
    assert trip.round_trip_s == pytest.approx(0.1)
    trip.restart()
    assert trip.round_trip_s != trip.round_trip_s


def test_after_a_restart_the_way_is_measured_again() -> None:
    """Another autopilot, or another line, may be slower from its first answer on: no queue."""
    trip = RoundTrip()

    def answers(begin: int, count: int, way_s: float) -> None:
        for second in range(begin, begin + count):
            question = trip.poll(float(second))
            assert question is not None
            trip.take(Timesync(1, question.ts1), second + way_s)

    answers(0, 5, 0.01)
    trip.restart()
    answers(10, 5, 0.01 + 2.0 * SLACK_S)
    assert trip.queue_s == 0.0
    answers(20, 12, 0.01 + 4.0 * SLACK_S)
    assert trip.queue_s == pytest.approx(SLACK_S)
