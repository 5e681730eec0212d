"""Stamps of one vehicle: when a sample was true, and what is reported of clocks that do not fit.

Time is an argument; nothing here waits.
"""

from __future__ import annotations

import pytest

from tgl_soar.link.clock import MICROSECONDS_WRAP_S
from tgl_soar.link.messages import (
    ID_ATTITUDE_QUATERNION,
    ID_LOCAL_POSITION_NED,
    SEVERITY_ERROR,
    SEVERITY_INFO,
    SEVERITY_WARNING,
    Source,
)
from tgl_soar.link.stream_requests import StreamRequests
from tgl_soar.link.vehicle.diagnostics import Ledger, SessionCounters
from tgl_soar.link.vehicle.sample_times import SampleTimes

ATTITUDE, POSITION = ID_ATTITUDE_QUATERNION, ID_LOCAL_POSITION_NED
ODOMETRY_KEY, POSE_KEY = "odometry", "pose"
DELAY_S = 0.004  # on the way
STEP_S = 0.01
QUEUE_S = 0.3


class Vehicle:
    """Attitudes at 100 Hz and positions at 20 Hz of one clock; how they are timed, and the reports
    on them."""

    def __init__(self, uptime_s: float = 50.0, *, lockstep: bool = False) -> None:
        self.now_s = 1000.0
        self.ahead_s = uptime_s - self.now_s  # the vehicle's clock less ours
        self.counters = SessionCounters()
        self.notices: list[tuple[int, str]] = []
        self.restarts_s: list[float] = []
        ledger = Ledger(self.counters, self.notices, StreamRequests(1))
        self.times = SampleTimes(Source(1, 1), ledger, self.restarts_s.append, lockstep=lockstep)

    def stamp_ms(self, ahead_s: float = 0.0) -> int:
        """What comes now was true a little earlier."""
        return round(1e3 * (self.now_s - DELAY_S + self.ahead_s + ahead_s)) % 2**32

    def receive(self, message: int = ATTITUDE, ahead_s: float = 0.0) -> float | None:
        """The age of a sample that comes now; None: it is not taken."""
        times = self.times.of_milliseconds(message, self.stamp_ms(ahead_s), self.now_s)
        return None if times is None else self.now_s - times[0]

    def run(self, for_s: float, *, also_ahead_s: float | None = None) -> float | None:
        """`also_ahead_s`: a second autopilot sends under the same name, by a clock so far ahead."""
        age_s = None
        for count in range(round(for_s / STEP_S)):
            self.now_s += STEP_S
            if count % 5 == 0:
                self.receive(POSITION)
            age_s = self.receive()
            if also_ahead_s is not None:
                self.receive(ahead_s=also_ahead_s)
            self.times.poll(self.now_s)
        return age_s

    def reported(self, words: str) -> list[tuple[int, str]]:
        return [notice for notice in self.notices if words in notice[1]]


# --- when a sample was true ----------------------------------------------------------------------


def test_the_first_sample_was_true_when_it_came_and_bears_its_own_stamp_too() -> None:
    """A stamp of whole milliseconds says when to the millisecond."""
    vehicle = Vehicle()
    ms = vehicle.times.of_milliseconds(ATTITUDE, 49_996, 1000.0)
    assert ms == pytest.approx((1000.0, 49.9965), abs=0.0006)
    us = vehicle.times.of_microseconds(ODOMETRY_KEY, 50_000_250, 1000.0)
    assert us == pytest.approx((1000.0, 50.00025))


def test_a_sample_that_was_longer_on_its_way_is_as_old_as_that() -> None:
    vehicle = Vehicle()
    vehicle.run(3.0)
    vehicle.now_s += STEP_S + 0.15
    assert vehicle.receive(ahead_s=-0.15) == pytest.approx(0.15, abs=0.001)
    assert vehicle.counters == SessionCounters()
    assert vehicle.notices == []


def test_milliseconds_go_on_behind_the_end_of_their_32_bits() -> None:
    vehicle = Vehicle(uptime_s=2**32 * 1e-3 - 1.0)
    vehicle.run(3.0)
    times = vehicle.times.of_milliseconds(ATTITUDE, vehicle.stamp_ms() + 1, vehicle.now_s)
    assert times is not None
    assert times[1] == pytest.approx(2**32 * 1e-3 + 2.0 - DELAY_S, abs=0.003)
    assert vehicle.now_s - times[0] < 0.003
    assert vehicle.restarts_s == []
    assert vehicle.counters.stale == 0


def test_a_rangefinder_s_milliseconds_go_on_likewise() -> None:
    vehicle, end_ms = Vehicle(), 2**32
    for count in range(100):
        now_s = 1000.0 + 0.05 * count
        stamp_ms = (end_ms - 2500 + 50 * count) % end_ms
        times = vehicle.times.of_distance(1, stamp_ms, now_s)
        assert times is not None
        assert times == pytest.approx((now_s, 1e-3 * (end_ms - 2500 + 50 * count)), abs=0.002)


@pytest.mark.parametrize(("wrap_s", "taken"), [(MICROSECONDS_WRAP_S, True), (float("inf"), False)])
def test_microseconds_begin_again_only_where_it_is_reported_that_they_do(
    wrap_s: float, taken: bool
) -> None:
    vehicle = Vehicle()
    begun_us = 2**32 - 1_000_000
    for count in range(200):
        now_s = 1000.0 + STEP_S * count
        stamp_us = (begun_us + 10_000 * count) % 2**32
        times = vehicle.times.of_microseconds(ODOMETRY_KEY, stamp_us, now_s, wrap_s=wrap_s)
        if count == 100:  # the first behind the end
            assert (times is not None) == taken
    assert vehicle.restarts_s == ([] if taken else [pytest.approx(1001.0, abs=0.6)])


def test_without_a_word_microseconds_never_begin_again() -> None:
    vehicle = Vehicle()
    for count in range(101):
        now_s, stamp_us = 1000.0 + STEP_S * count, (2**32 - 1_000_000 + 10_000 * count) % 2**32
        times = vehicle.times.of_microseconds(ODOMETRY_KEY, stamp_us, now_s)
    assert times is None


def test_of_several_rangefinders_each_has_stamps_of_its_own() -> None:
    vehicle = Vehicle()
    for count in range(10):
        now_s, stamp_ms = 1000.0 + 0.05 * count, 50_000 + 50 * count
        assert vehicle.times.of_distance(0, stamp_ms, now_s) is not None
        assert vehicle.times.of_distance(1, stamp_ms - 40, now_s) is not None
    assert vehicle.times.of_distance(1, stamp_ms - 40, now_s) is None
    assert vehicle.counters.stale == 1


def spread_of(ages_s: list[float]) -> float:
    return max(ages_s) - min(ages_s)


def test_whole_milliseconds_are_made_finer_and_microseconds_are_left_as_they_are() -> None:
    """An inertial sensor of 400 Hz: every other stamp is cut by half a millisecond."""
    vehicle = Vehicle()
    by_kind: dict[str, list[float]] = {"attitude": [], "range": [], "odometry": []}
    for count in range(2000):
        true_s, now_s = 50.0 + 0.0025 * count, 1000.0 + 0.0025 * count
        cut_ms = int(1e3 * true_s + 1e-6)
        found = {
            "attitude": vehicle.times.of_milliseconds(ATTITUDE, cut_ms, now_s),
            "range": vehicle.times.of_distance(0, cut_ms, now_s),
            "odometry": vehicle.times.of_microseconds(ODOMETRY_KEY, 1000 * cut_ms, now_s),
        }
        for kind, times in found.items():
            assert times is not None
            if count >= 1000:
                by_kind[kind].append(times[1] - true_s)
    assert spread_of(by_kind["attitude"]) < 0.0002
    assert spread_of(by_kind["range"]) < 0.0002
    assert spread_of(by_kind["odometry"]) == pytest.approx(0.0005, abs=1e-6)


def test_in_lockstep_stamps_are_the_time() -> None:
    vehicle = Vehicle(lockstep=True)
    assert vehicle.times.lockstep
    assert not Vehicle().times.lockstep
    times = vehicle.times.of_milliseconds(ATTITUDE, 49_000, 1000.0)
    assert times == pytest.approx((49.0, 49.0))
    assert vehicle.times.of_microseconds(ODOMETRY_KEY, 49_500_000, 1000.0) == pytest.approx(
        (49.5, 49.5)
    )


# --- what is refused -----------------------------------------------------------------------------


def test_a_sample_that_comes_twice_is_stale() -> None:
    vehicle = Vehicle()
    vehicle.run(1.0)
    assert vehicle.receive() is None
    assert (vehicle.counters.stale, vehicle.counters.other_clock) == (1, 0)


def test_a_stamp_that_is_ahead_is_of_another_clock_and_not_stale() -> None:
    vehicle = Vehicle()
    vehicle.run(1.0)
    assert vehicle.receive(ahead_s=5.0) is None
    assert (vehicle.counters.stale, vehicle.counters.other_clock) == (0, 1)
    assert vehicle.notices == []  # one alone is an error of the line


@pytest.mark.parametrize(
    ("ahead_s", "words"),
    [(7.5, "7.5 s ahead of the autopilot's"), (-30.0, "30.0 s behind the autopilot's")],
)
def test_several_stamps_of_another_clock_are_reported_with_its_distance(
    ahead_s: float, words: str
) -> None:
    vehicle = Vehicle()
    vehicle.run(1.0)
    vehicle.run(0.2, also_ahead_s=ahead_s)
    assert vehicle.notices == [(SEVERITY_WARNING, f"stamps of another clock, {words}: refused")]
    assert vehicle.counters.other_clock == 20


def test_another_clock_is_reported_every_ten_seconds() -> None:
    vehicle = Vehicle()
    vehicle.run(1.0)
    for _ in range(11):  # every 2.1 s it stops and begins again, which counts again
        vehicle.run(0.1, also_ahead_s=7.5)
        vehicle.run(2.0)
    assert len(vehicle.reported("stamps of another clock")) == 3  # after 0, 10.5 and 21 s


# --- a clock that is another one -----------------------------------------------------------------


def test_an_autopilot_that_has_restarted_is_reported_and_its_streams_are_asked_for_again() -> None:
    vehicle = Vehicle()
    vehicle.run(5.0)
    vehicle.now_s += 3.0
    vehicle.ahead_s = 1.0 - vehicle.now_s  # up for a second
    begun_s = vehicle.now_s
    age_s = vehicle.run(2.0)
    assert age_s is not None
    assert age_s < 0.005
    (at_s,) = vehicle.restarts_s
    assert at_s == pytest.approx(begun_s + 3 * STEP_S, abs=0.2)
    assert vehicle.counters.reboots == 1
    words = "autopilot restarted: asking for its streams again"
    assert vehicle.notices == [(SEVERITY_INFO, words)]  # and none of another clock


@pytest.mark.parametrize(("leap_s", "words"), [(400.0, "400.0 s"), (0.6, "0.6 s")])
def test_a_clock_that_leaps_ahead_was_no_restart_and_is_said_to_be_another(
    leap_s: float, words: str
) -> None:
    vehicle = Vehicle()
    vehicle.run(5.0)
    vehicle.ahead_s += leap_s
    vehicle.run(2.0)
    assert vehicle.counters.reboots == 1
    text = f"the autopilot's clock is another one, {words} ahead of the last"
    assert vehicle.reported("another one") == [
        (SEVERITY_INFO, f"{text}: asking for its streams again")
    ]
    assert vehicle.reported("restarted") == []


def test_another_s_clock_that_restarts_is_no_restart_of_the_vehicle() -> None:
    """As of the tracker whose poses the autopilot passes on."""
    vehicle = Vehicle()
    vehicle.run(1.0)
    taken = []
    for count in range(400):
        vehicle.run(STEP_S)
        stamp_us = 10_000 * (count % 200) + 1_000_000
        times = vehicle.times.of_microseconds(POSE_KEY, stamp_us, vehicle.now_s, foreign=True)
        taken.append(times is not None)
    assert taken[199]
    assert not taken[200]  # it has gone back
    assert taken[399]  # and is its clock now
    assert vehicle.restarts_s == []
    assert vehicle.counters.reboots == 0


def test_two_autopilots_under_one_name_are_reported_and_neither_is_flown_with() -> None:
    vehicle = Vehicle()
    vehicle.run(2.0)
    vehicle.run(2.0, also_ahead_s=-20.0)
    assert vehicle.receive() is None
    words = "two autopilots are 1:1, one 20.0 s behind the other: neither is flown with"
    assert vehicle.reported("two autopilots") == [(SEVERITY_ERROR, words)]
    assert vehicle.reported("only one") == []
    age_s = vehicle.run(4.0)
    assert age_s is not None
    assert age_s < 0.005
    assert vehicle.reported("two autopilots") == [(SEVERITY_ERROR, words)]
    alone = (SEVERITY_INFO, "only one autopilot sends as 1:1 again")
    assert vehicle.reported("only one") == [alone]
    vehicle.run(2.0, also_ahead_s=-20.0)
    assert len(vehicle.reported("two autopilots")) == 2


# --- a queue on the link -------------------------------------------------------------------------


def test_a_queue_makes_every_sample_of_the_vehicle_s_own_clock_older() -> None:
    vehicle = Vehicle()
    before_s = vehicle.run(2.0)
    vehicle.times.take_queue(QUEUE_S, vehicle.now_s)
    after_s = vehicle.run(1.0)
    assert before_s is not None
    assert after_s is not None
    assert after_s - before_s == pytest.approx(QUEUE_S, abs=0.002)
    own = vehicle.times.of_milliseconds(ATTITUDE, vehicle.stamp_ms() + 1, vehicle.now_s)
    assert own is not None
    assert own[1] == pytest.approx(1e-3 * (vehicle.stamp_ms() + 1), abs=0.002)  # its own stays
    assert vehicle.times.of_microseconds(POSE_KEY, 5_000_000, vehicle.now_s, foreign=True) == (
        pytest.approx((vehicle.now_s, 5.0))
    )
    vehicle.times.take_queue(0.0, vehicle.now_s)
    assert vehicle.run(1.0) == pytest.approx(before_s, abs=0.002)


def test_what_is_not_taken_stays_so_while_there_is_a_queue() -> None:
    vehicle = Vehicle()
    vehicle.run(1.0)
    vehicle.times.take_queue(QUEUE_S, vehicle.now_s)
    assert vehicle.receive() is None
    assert vehicle.counters.stale == 1


def test_a_queue_is_reported_with_how_much_later_the_answers_come() -> None:
    """A round trip may be 0.05 s slower by chance: so much less counts as a queue."""
    vehicle = Vehicle()
    vehicle.times.take_queue(0.0, 0.0)
    assert vehicle.notices == []
    vehicle.times.take_queue(QUEUE_S, 0.0)
    text = "the autopilot answers 0.35 s later than before: is its link too slow?"
    assert vehicle.notices == [(SEVERITY_WARNING, text)]
    vehicle.times.take_queue(QUEUE_S, 9.9)
    assert len(vehicle.notices) == 1
    vehicle.times.take_queue(QUEUE_S, 10.1)
    assert vehicle.notices == [(SEVERITY_WARNING, text)] * 2


def test_a_queue_of_which_no_answer_tells_any_more_counts_still_and_that_is_reported() -> None:
    """Six seconds: a question a second, and a window of five seconds for the answers."""
    vehicle = Vehicle()
    vehicle.times.take_queue(QUEUE_S, 0.0)
    vehicle.notices.clear()
    vehicle.times.poll(9.0)
    assert vehicle.notices == []  # there was a notice of the queue a moment ago
    vehicle.times.poll(11.0)
    text = "no answer to TIMESYNC for 11 s: samples count as 0.30 s late still"
    assert vehicle.notices == [(SEVERITY_WARNING, text)]
    vehicle.times.poll(20.0)
    assert len(vehicle.notices) == 1
    vehicle.times.poll(21.5)
    assert len(vehicle.notices) == 2


@pytest.mark.parametrize(("silent_s", "reported"), [(5.8, False), (6.2, True)])
def test_answers_are_missed_after_six_seconds(silent_s: float, reported: bool) -> None:
    vehicle = Vehicle()
    vehicle.times.take_queue(QUEUE_S, 0.0)
    vehicle.times.take_queue(QUEUE_S, 9.0)  # no second notice yet
    vehicle.notices.clear()
    vehicle.times.poll(9.0 + silent_s)
    assert (len(vehicle.notices) == 1) == reported


def test_without_a_queue_answers_that_do_not_come_are_no_matter() -> None:
    vehicle = Vehicle()
    vehicle.times.take_queue(0.0, 0.0)
    vehicle.times.poll(100.0)
    assert vehicle.notices == []
