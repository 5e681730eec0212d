"""Stamps that do not fit: one wrong frame, a clock that is slewed, jumps, or is there twice.

Time is an argument; nothing here waits.
"""

from __future__ import annotations

from math import inf

import pytest

from tgl_soar.link.clock import (
    AHEAD_S,
    CALM_S,
    CONTEST_S,
    LASTS_S,
    LATE_S,
    MILLISECONDS_WRAP_S,
    WINDOW_S,
    ClockMap,
    StampedStreams,
)
from tgl_soar.link.messages import Source
from tgl_soar.link.stream_requests import StreamRequests
from tgl_soar.link.vehicle.diagnostics import Ledger, SessionCounters
from tgl_soar.link.vehicle.sample_times import SampleTimes

ATTITUDE, POSITION, UNUSED = "attitude", "position", "unused"
AGE_ATT_MAX_S = 0.2
SOON_S = WINDOW_S + 1.0  # in which everything is as it was
DELAY_S = 0.003


class Autopilot:
    """Attitude at 200 Hz, position at 50 Hz: stamps of whole milliseconds, which arrive now."""

    def __init__(self, uptime_s: float = 50.0) -> None:
        self.streams = StampedStreams(lockstep=False)
        self.now_s = 1000.0
        self.ahead_s = uptime_s - self.now_s  # the autopilot's clock less ours
        self.age_s = inf  # of the newest attitude that was taken
        self.oldest_s = 0.0  # the largest age there was
        self.refused_s = 0.0  # the longest time without an attitude
        self._taken_s = self.now_s
        self._count = 0

    def receive(self, key: str, ahead_s: float = 0.0, late_s: float = 0.0) -> float | None:
        """One frame; when it was true, on our clock."""
        stamp_s = (self.now_s - late_s - DELAY_S + self.ahead_s + ahead_s) % MILLISECONDS_WRAP_S
        stamp_s = round(stamp_s, 3)
        times = self.streams.time_of(key, stamp_s, self.now_s, quantised=True)
        return None if times is None else times[0]

    def run(self, for_s: float, *, drift: float = 0.0, ahead_s: float = 0.0) -> None:
        """drift: seconds by which the autopilot's clock gains on ours in a second."""
        for _ in range(round(for_s * 200)):
            self.now_s += 0.005
            self.ahead_s += 0.005 * drift
            self._count += 1
            if self._count % 4 == 0:
                self.receive(POSITION, ahead_s)
            time_s = self.receive(ATTITUDE, ahead_s)
            if time_s is not None:
                self.age_s = self.now_s - time_s
                self.oldest_s = max(self.oldest_s, self.age_s)
                self._taken_s = self.now_s
            self.refused_s = max(self.refused_s, self.now_s - self._taken_s)

    def begin_to_look(self) -> None:
        self.oldest_s = self.refused_s = 0.0
        self._taken_s = self.now_s


# --- one wrong stamp --------------------------------------------------------------------------


@pytest.mark.parametrize("ahead_s", [0.25, 0.5, 0.99, 400.0, 1e6])
@pytest.mark.parametrize("key", [ATTITUDE, POSITION, UNUSED])
def test_one_stamp_ahead_changes_no_age(key: str, ahead_s: float) -> None:
    received = Autopilot()
    received.run(2.0)
    received.begin_to_look()
    assert received.receive(key, ahead_s) is None
    received.run(3.0)
    assert received.oldest_s < 0.005
    assert received.refused_s < 0.011
    assert received.streams.reboots == 0


@pytest.mark.parametrize("ahead_s", [0.25, 0.5, 0.99, 3.0, 400.0])
@pytest.mark.parametrize("key", [ATTITUDE, POSITION, UNUSED])
def test_not_even_as_the_very_first(key: str, ahead_s: float) -> None:
    received = Autopilot()
    received.receive(key, ahead_s)
    received.run(SOON_S)
    assert received.age_s < 0.005
    received.begin_to_look()
    received.run(2.0)
    assert received.oldest_s < 0.005
    assert received.refused_s < 0.011


def test_a_stamp_that_is_little_ahead_is_out_of_the_window_soon() -> None:
    received = Autopilot()
    received.run(2.0)
    received.receive(ATTITUDE, 0.9 * AHEAD_S)
    received.run(0.1)
    assert received.age_s == pytest.approx(0.9 * AHEAD_S, abs=0.005)
    received.run(WINDOW_S)
    assert received.age_s < 0.005


def test_a_wrong_stamp_across_the_counter_s_end_moves_no_counter() -> None:
    """The true ones are no round further because one of the end was received."""
    received = Autopilot(50.0)
    received.run(1.0)
    assert received.streams.time_of(ATTITUDE, MILLISECONDS_WRAP_S - 0.001, received.now_s) is None
    received.begin_to_look()
    received.run(1.0)
    assert received.refused_s < 0.011
    assert received.streams.reboots == 0


# --- clocks that run apart --------------------------------------------------------------------


@pytest.mark.parametrize("ppm", [-100.0, 100.0])
def test_quartzes_run_apart_by_a_tenth_of_a_tick_in_the_window(ppm: float) -> None:
    received = Autopilot()
    received.run(1.0)
    received.begin_to_look()
    received.run(120.0, drift=ppm * 1e-6)
    # What they run apart in the window, and the stamps' grain.
    assert received.oldest_s <= 100e-6 * WINDOW_S + 1e-3
    assert received.refused_s < 0.011


@pytest.mark.parametrize("over_s", [10.0, 600.0])
@pytest.mark.parametrize("slewed_s", [-0.3, 0.3])
def test_a_slewed_clock_is_followed(slewed_s: float, over_s: float) -> None:
    received = Autopilot()
    received.run(2.0)
    received.begin_to_look()
    received.run(over_s, drift=-slewed_s / over_s)
    assert received.oldest_s < AGE_ATT_MAX_S
    assert received.refused_s < 0.011
    received.run(WINDOW_S)
    assert received.age_s < 0.005
    assert received.streams.reboots == 0


def test_a_spell_in_which_the_link_is_busy_hides_no_delay() -> None:
    """Every frame 0.2 s late for half the window."""
    received = Autopilot()
    received.run(3.0)
    for _ in range(round(0.5 * WINDOW_S * 200)):
        received.now_s += 0.005
        time_s = received.receive(ATTITUDE, late_s=0.2)
        if time_s is not None:
            assert received.now_s - time_s == pytest.approx(0.2, abs=0.005)


def test_the_window_forgets_by_halves_and_a_silence_forgets_nothing() -> None:
    clock = ClockMap()
    clock.observe(0.0, 10.0)
    clock.observe(60.0, 70.1)
    assert clock.offset_s == pytest.approx(10.0)
    clock.observe(62.0, 72.2)
    assert clock.offset_s == pytest.approx(10.0)
    clock.observe(62.6, 72.7)
    assert clock.offset_s == pytest.approx(10.1)


# --- jumps ------------------------------------------------------------------------------------


@pytest.mark.parametrize("jump_s", [-400.0, -30.0, -1.5, -0.5, -0.3, 0.3, 0.5, 0.99, 5.0, 400.0])
def test_a_clock_that_jumps_is_another_one_within_a_second(jump_s: float) -> None:
    """And is another one again when it jumps back, however long after."""
    received = Autopilot(uptime_s=1000.0)
    received.run(3.0)
    for back, for_s in ((0.0, 0.2), (jump_s, 8.0), (0.0, 8.0)):
        received.begin_to_look()
        received.run(for_s, ahead_s=back)
        assert received.age_s < 0.005
        assert received.refused_s < 1.0
        # A refusal that lasts longer than the laws bear is reported.
        assert received.refused_s < AGE_ATT_MAX_S or received.streams.reboots > 0
    assert received.streams.reboots == 2
    received.begin_to_look()
    received.run(20.0)
    assert received.oldest_s < 0.005
    assert received.streams.reboots == 2


@pytest.mark.parametrize("jump_s", [-30.0, -0.5, 0.5, 30.0])
@pytest.mark.parametrize("for_s", [0.05, 0.3, 0.6, 1.0, 3.0])
def test_a_clock_that_jumps_for_a_while_blocks_no_longer(jump_s: float, for_s: float) -> None:
    received = Autopilot(uptime_s=100.0)
    received.run(3.0)
    received.run(for_s, ahead_s=jump_s)
    received.run(1.0)
    received.begin_to_look()
    received.run(5.0)
    assert received.oldest_s < 0.005
    assert received.refused_s < 0.011


def test_a_restart_is_reported_before_the_attitude_is_lost() -> None:
    received = Autopilot(uptime_s=1000.0)
    received.run(3.0)
    received.ahead_s = -received.now_s
    received.run(0.9 * AGE_ATT_MAX_S)
    assert received.streams.reboots == 1
    assert received.age_s < 0.005


# --- two clocks -------------------------------------------------------------------------------


def both(received: Autopilot, for_s: float, ahead_s: float, *, key: str = ATTITUDE) -> int:
    """The true autopilot, and a duplicate; how many of the duplicate's frames were taken."""
    taken = 0
    for _ in range(round(for_s * 200)):
        received.run(0.005)
        taken += received.receive(key, ahead_s) is not None
    return taken


@pytest.mark.parametrize("ahead_s", [-400.0, -20.0, 0.5, 2.0, 400.0, 1e6])
def test_a_duplicate_is_refused_then_neither_is_taken(ahead_s: float) -> None:
    received = Autopilot(uptime_s=1000.0)
    received.run(3.0)
    received.begin_to_look()
    assert both(received, 0.9 * CONTEST_S, ahead_s) == 0
    assert received.refused_s < 0.011
    assert not received.streams.is_contested(received.now_s)
    assert received.streams.suspected == 1
    assert received.streams.suspect_ahead_s == pytest.approx(ahead_s, abs=0.01)
    assert both(received, 2.0, ahead_s) == 0
    assert received.streams.is_contested(received.now_s)
    assert received.refused_s > AGE_ATT_MAX_S
    assert received.streams.reboots == 0
    received.run(CALM_S + 0.1)
    assert not received.streams.is_contested(received.now_s)
    assert received.age_s < 0.005
    received.begin_to_look()
    received.run(5.0)
    assert received.oldest_s < 0.005
    assert received.refused_s < 0.011


def test_a_duplicate_that_was_received_first_is_not_flown_with_either() -> None:
    received = Autopilot(uptime_s=1000.0)
    received.receive(ATTITUDE, 400.0)
    both(received, 3.0, 400.0)
    assert received.streams.is_contested(received.now_s)


def test_a_duplicate_that_is_left_alone_is_another_clock() -> None:
    received = Autopilot(uptime_s=1000.0)
    received.run(3.0)
    both(received, 3.0, 400.0)
    received.run(1.0, ahead_s=400.0)
    assert received.streams.reboots == 1
    assert received.age_s < 0.005
    assert not received.streams.is_contested(received.now_s)


@pytest.mark.parametrize("ahead_s", [-400.0, 400.0])
def test_what_only_a_duplicate_sends_is_not_used(ahead_s: float) -> None:
    """A stream that the true autopilot has not: it cannot be compared with itself."""
    received = Autopilot(uptime_s=1000.0)
    received.run(3.0)
    received.begin_to_look()
    assert both(received, 5.0, ahead_s, key=UNUSED) == 0
    assert received.refused_s < 0.011
    assert received.oldest_s < 0.005
    assert received.streams.reboots == 0


# --- normal weather ---------------------------------------------------------------------------


def test_a_second_way_that_is_slower_is_no_duplicate() -> None:
    """Every frame twice, once half a second late: then the quick way is gone."""
    received = Autopilot()
    received.run(3.0)
    received.begin_to_look()
    for _ in range(1000):
        received.run(0.005)
        assert received.receive(ATTITUDE, late_s=0.5) is None
    assert received.refused_s < 0.011
    assert not received.streams.is_contested(received.now_s)
    ages = []
    for _ in range(1000):
        received.now_s += 0.005
        time_s = received.receive(ATTITUDE, late_s=0.5)
        if time_s is not None:
            ages.append(received.now_s - time_s)
    assert min(ages) == pytest.approx(0.5, abs=0.01)  # and says so
    assert received.streams.reboots == 0


def test_old_frames_between_new_ones_are_no_restart() -> None:
    received = Autopilot()
    received.run(3.0)
    for late_s in (5.0, 4.99, 4.98, 3.0, 2.0):
        received.run(0.005)
        assert received.receive(ATTITUDE, late_s=late_s) is None
    assert received.streams.reboots == 0
    assert received.age_s < 0.005


def test_random_stamps_between_true_ones_contest_nothing() -> None:
    received = Autopilot()
    received.run(1.0)
    received.begin_to_look()
    for i in range(1000):
        received.run(0.005)
        received.receive(ATTITUDE, ahead_s=float(i * 7919 % 100_000))
    assert received.refused_s < 0.011
    assert received.streams.reboots == 0


def test_the_time_of_day_is_a_clock_of_its_own() -> None:
    """ODOMETRY may be stamped with it, and jumps to it are for that stream to judge."""
    received = Autopilot()
    received.run(1.0)
    placed = received.streams.time_of("odometry", 1.7e9, received.now_s, wrap_s=inf)
    assert placed is not None
    assert placed[0] == pytest.approx(received.now_s)


def test_a_shorter_counter_is_the_same_clock_some_rounds_behind() -> None:
    """SERVO_OUTPUT_RAW, two hours after the start."""
    received = Autopilot(uptime_s=7200.0)
    received.run(1.0)
    wrap_s = 2**32 * 1e-6
    stamp_s = (received.now_s + received.ahead_s) % wrap_s
    assert received.streams.time_of("servo", stamp_s, received.now_s, wrap_s=wrap_s) is not None
    assert received.streams.time_of("other", 10.0, received.now_s, wrap_s=wrap_s) is None


# --- in lockstep, where stamps are the time ---------------------------------------------------


def test_in_lockstep_order_alone_tells() -> None:
    streams = StampedStreams(lockstep=True)

    def taken(*stamps_s: float) -> list[bool]:
        return [streams.time_of("a", stamp_s, 0.0) is not None for stamp_s in stamps_s]

    assert taken(10.0, 10.005, 9.5, 10.01) == [True, True, False, True]
    for i in range(20):  # a duplicate beside the true one
        assert taken(410.0 + i * 0.005, 10.015 + i * 0.005) == [False, True]
    assert streams.suspected == 1
    assert streams.suspect_ahead_s == pytest.approx(400.0, abs=0.1)
    assert taken(5.0, 4.0, 3.0, 2.0) == [False] * 4
    assert streams.reboots == 0
    assert taken(15.0, 15.005, 15.01) == [False, False, True]  # a gap
    assert streams.reboots == 0
    assert taken(1.0, 1.005, 1.01, 1.015) == [False, False, True, True]
    assert streams.reboots == 1


def test_the_numbers_stand_in_order() -> None:
    assert AHEAD_S < AGE_ATT_MAX_S < LASTS_S < CONTEST_S <= LATE_S < CALM_S < WINDOW_S


def test_another_clock_is_reported_once_in_ten_seconds_and_counted() -> None:
    ledger = Ledger(SessionCounters(), [], StreamRequests(1))
    times = SampleTimes(Source(1, 1), ledger, lambda _: None, lockstep=False)
    for i in range(round(14.0 * 50)):
        now_s = 1000.0 + 0.02 * i
        assert times.of_milliseconds(30, 50_000 + 20 * i, now_s) is not None
        if i % 100 == 99:  # three frames of another autopilot, every two seconds
            for late in range(3):
                stamp_ms = 450_000 + 20 * (i + late)
                assert times.of_milliseconds(30, stamp_ms, now_s + 0.001 * late) is None
    reported = [text for _, text in ledger.notices if "another clock" in text]
    assert reported == ["stamps of another clock, 400.0 s ahead of the autopilot's: refused"] * 2
    assert ledger.counters.other_clock == 21
    assert ledger.counters.reboots == 0
