"""The clock's parts one by one: each of its times and counts, on both sides.

Frames come at times that a double holds exactly where a count of them is expected.
"""

from __future__ import annotations

from math import inf, isnan, nan

import pytest

from tgl_soar.link.clock import (
    MICROSECONDS_WRAP_S,
    MILLISECONDS_WRAP_S,
    ClockMap,
    Lateness,
    StampedStream,
    StampedStreams,
    Suspect,
)

W = MILLISECONDS_WRAP_S
AHEAD_S = 1000.0  # of the autopilot's clock: ours


def test_counters_end_after_seven_weeks_and_after_seventy_two_minutes() -> None:
    days, minutes = MILLISECONDS_WRAP_S / 86400, MICROSECONDS_WRAP_S / 60
    assert days == pytest.approx(49.7103, abs=1e-4)
    assert minutes == pytest.approx(71.5828, abs=1e-4)


# --- a stream's map -------------------------------------------------------------------------------


def test_the_smallest_difference_of_a_window_is_the_offset() -> None:
    clock = ClockMap()
    assert isnan(clock.offset_s)
    assert clock.observe(1.0, 11.5) == 11.5
    assert clock.observe(2.0, 12.25) == 12.25  # 10.25: less than before
    assert clock.observe(3.0, 13.75) == 13.25  # later than that: true before it came
    assert clock.offset_s == 10.25
    clock.reset()
    assert isnan(clock.offset_s)
    assert clock.observe(3.0, 13.75) == 13.75


@pytest.mark.parametrize(("after_s", "offset_s"), [(2.49, 10.0), (2.51, 10.125)])
def test_each_half_of_the_window_is_two_and_a_half_seconds(after_s: float, offset_s: float) -> None:
    """The first half knew 10.0, all later ones 10.125: known once the second has begun to fill
    for the second time."""
    clock = ClockMap()
    clock.observe(0.0, 10.0)
    clock.observe(2.5, 12.625)  # the half of 10.0 is whole now
    clock.observe(2.5 + after_s, 12.625 + after_s)
    assert clock.offset_s == offset_s


# --- frames that continue each other --------------------------------------------------------------


@pytest.mark.parametrize(
    ("stamp_s", "observed_s", "now_s", "continues"),
    [
        (5.01, 20.0, 25.01, True),
        (5.0, 20.0, 25.01, False),  # the same once more
        (5.01, 20.19, 25.01, True),
        (5.01, 19.81, 25.01, True),
        (5.01, 20.21, 25.01, False),
        (5.01, 19.79, 25.01, False),
        (5.9, 20.0, 25.99, True),
        (5.9, 20.0, 26.01, False),
    ],
)
def test_a_frame_continues_one_of_the_same_clock_within_a_second(
    stamp_s: float, observed_s: float, now_s: float, continues: bool
) -> None:
    suspect = Suspect()
    assert not suspect.continues(5.0, 20.0, 25.0)
    suspect.take(5.0, 20.0, 25.0)
    assert suspect.continues(stamp_s, observed_s, now_s) is continues
    suspect.take(stamp_s, observed_s, now_s)
    assert suspect.count == suspect.row == 1 + continues
    assert suspect.since_s == (25.0 if continues else now_s)
    assert (suspect.stamp_s, suspect.offset_s) == (stamp_s, observed_s)


def test_one_that_fits_between_them_ends_their_row_and_not_their_count() -> None:
    suspect = Suspect()
    for i in range(3):
        suspect.take(5.0 + i / 8, 20.0, 25.0 + i / 8)
    suspect.row = 0
    suspect.take(5.5, 20.0, 25.5)
    assert (suspect.count, suspect.row, suspect.since_s) == (4, 1, 25.0)


# --- late, or another clock -----------------------------------------------------------------------


def judged(*samples: tuple[float, float, float]) -> list[float]:
    """Samples of (stamp, late, arrival), after one that was in time."""
    lateness = Lateness()
    assert isnan(lateness.judge(100.0, nan, 50.0))  # the very first
    assert isnan(lateness.judge(101.0, 0.0, 51.0))
    assert lateness.timely_s == 51.0
    return [lateness.judge(*sample) for sample in samples]


def test_after_a_skip_late_by_the_same_three_times_and_for_half_a_second_is_a_new_clock() -> None:
    found = judged((101.5, 2.0, 60.0), (101.75, 2.0, 60.25), (102.0, 2.0, 60.5))
    assert [*map(isnan, found)] == [True, True, False]
    assert found[2] == 60.0  # since the skip
    found = judged((101.5, 2.0, 60.0), (102.5, 2.0, 61.0), (102.6, 2.0, 61.1))
    assert [*map(isnan, found)] == [True, True, False]  # two are no row
    found = judged((101.5, 2.0, 60.0), (101.6, 2.0, 60.1), (101.99, 2.0, 60.49))
    assert all(map(isnan, found))  # and half a second it must be


@pytest.mark.parametrize(("skip_s", "is_new"), [(0.24, False), (0.26, True)])
def test_a_skip_is_a_quarter_of_a_second(skip_s: float, is_new: bool) -> None:
    stamp_s = 101.0 + skip_s
    found = judged(*((stamp_s + 0.25 * i, 2.0, 60.0 + 0.25 * i) for i in range(4)))
    assert (found[-1] == 60.0) is is_new


@pytest.mark.parametrize(("late_s", "is_new"), [(0.99, False), (1.01, True)])
def test_later_than_a_second_it_is_of_no_use(late_s: float, is_new: bool) -> None:
    found = judged(*((101.5 + 0.25 * i, late_s, 60.0 + 0.25 * i) for i in range(4)))
    assert (found[-1] == 60.0) is is_new


@pytest.mark.parametrize(("late_s", "is_new"), [(1.4, False), (1.6, True)])
def test_it_must_be_a_second_later_than_before(late_s: float, is_new: bool) -> None:
    samples = ((102.0 + 0.25 * i, late_s, 60.0 + 0.25 * i) for i in range(4))
    found = judged((101.1, 0.5, 51.6), *samples)
    assert (found[-1] == 60.0) is is_new


@pytest.mark.parametrize(("late_s", "is_new"), [(3.9, False), (4.1, True)])
def test_and_later_than_what_was_late_without_a_skip(late_s: float, is_new: bool) -> None:
    samples = ((102.0 + 0.25 * i, late_s, 60.0 + 0.25 * i) for i in range(4))
    found = judged((101.1, 3.0, 54.1), *samples)
    assert (found[-1] == 60.0) is is_new


@pytest.mark.parametrize(("change_s", "is_new"), [(0.19, True), (-0.19, True), (0.21, False)])
def test_what_becomes_later_by_a_fifth_of_a_second_is_not_late_by_the_same(
    change_s: float, is_new: bool
) -> None:
    found = judged(
        (101.5, 2.0, 60.0),
        (101.75, 2.0, 60.25),
        (102.0, 2.0 + change_s, 60.5),
        (102.25, 2.0 + change_s, 60.75),
    )
    assert isnan(found[3]) is not is_new


def test_a_new_lateness_is_counted_from_its_own_beginning() -> None:
    found = judged(*((101.5 + i / 4, 2.0 + 0.5 * (i >= 2), 60.0 + i / 4) for i in range(6)))
    assert [*map(isnan, found)] == [True, True, True, True, False, False]
    assert found[4] == 60.0  # the clock is the one since the skip all the same


def test_a_sample_in_time_ends_the_suspicion() -> None:
    found = judged(
        (101.5, 2.0, 60.0), (103.0, 0.5, 60.0), *((103.1 + i / 8, 2.0, 61.0 + i) for i in range(6))
    )
    assert all(map(isnan, found))


# --- one stream -----------------------------------------------------------------------------------


def stream(wrap_s: float = W, *, foreign: bool = False) -> StampedStream:
    return StampedStream(wrap_s, quantised=False, foreign=foreign)


@pytest.mark.parametrize(("apart_s", "is_proven"), [(0.24, False), (0.26, True), (nan, False)])
def test_two_stamps_a_quarter_of_a_second_apart_prove_a_clock(
    apart_s: float, is_proven: bool
) -> None:
    known = stream()
    assert not known.is_proven
    known.begun_s, known.fitted_s = 10.0, 10.0 + apart_s
    assert known.is_proven is is_proven


@pytest.mark.parametrize(
    ("newest_s", "stamp_s", "unwrapped_s"),
    [
        (W - 200.0, 50.0, W + 50.0),  # it has begun again
        (W - 400.0, 50.0, 50.0),  # too far from its end: a restart
        (50.0, W - 200.0, -200.0),  # of before, and long under way
        (50.0, W - 400.0, W - 400.0),
        (nan, W - 1.0, W - 1.0),
        (100.0, 100.5, 100.5),
    ],
)
def test_a_counter_begins_again_within_five_minutes_of_its_end(
    newest_s: float, stamp_s: float, unwrapped_s: float
) -> None:
    known = stream()
    known.newest_s = newest_s
    assert known.unwrapped(stamp_s, 1e6) == pytest.approx(unwrapped_s)


@pytest.mark.parametrize("rounds", [0, 1, 3])
@pytest.mark.parametrize(
    ("late_s", "is_counted"), [(0.9, True), (-0.9, True), (1.1, False), (-1.1, False)]
)
def test_after_a_long_silence_whole_rounds_are_known_by_our_clock(
    rounds: int, late_s: float, is_counted: bool
) -> None:
    known = stream(MICROSECONDS_WRAP_S)
    known.map.observe(2000.0, 3000.0)
    known.newest_s = 2000.0
    now_s = 1000.0 + 2500.0 + rounds * MICROSECONDS_WRAP_S + late_s
    expected_s = 2500.0 + rounds * MICROSECONDS_WRAP_S * is_counted
    assert known.unwrapped(2500.0, now_s) == pytest.approx(expected_s)


def test_a_stamp_that_has_no_end_has_no_rounds() -> None:
    known = stream(inf)
    known.map.observe(2000.0, 3000.0)
    known.newest_s = 2000.0
    assert known.unwrapped(10.0, 1e9) == 10.0
    known.take(1e9)
    assert known.newest_s == 1e9
    assert known.unwrapped(1e9 + 1.0, 1e9) == 1e9 + 1.0


def test_a_counter_that_was_taken_beyond_its_end_counts_on_from_there() -> None:
    known = stream()
    for taken_s, stamp_s in ((W - 1.0, W - 0.5), (W, 0.5), (2.0 * W + 3.0, 3.5)):
        known.take(taken_s)
        assert known.newest_s == taken_s
        assert known.unwrapped(stamp_s, nan) == pytest.approx(taken_s + 0.5)


def test_lateness_is_against_its_own_map_and_of_a_new_stream_against_the_others() -> None:
    known = stream(100.0)
    assert isnan(known.late_s(5.0, 10.0, nan))
    assert known.late_s(5.0, 1010.0, 1003.0) == pytest.approx(2.0)
    assert known.late_s(5.0, 1310.0, 1003.0) == pytest.approx(2.0)  # whole rounds behind
    assert known.late_s(5.0, 1003.0, 1003.0) == pytest.approx(-5.0)
    assert stream(inf).late_s(5.0, 1310.0, 1003.0) == pytest.approx(302.0)
    known.map.observe(0.0, 1000.0)
    assert known.late_s(5.0, 1310.0, 1003.0) == pytest.approx(305.0)


def test_a_restart_forgets_all_of_a_stream() -> None:
    known = StampedStream(W, quantised=True, foreign=False)
    sensor = known.sensor
    known.map.observe(1.0, 2.0)
    known.suspect.take(1.0, 1.0, 2.0)
    known.lateness.judge(1.0, 0.0, 2.0)
    known.begun_s = known.fitted_s = 2.0
    known.take(W + 1.0)
    known.restart()
    assert isnan(known.map.offset_s)
    assert known.suspect.count == 0
    assert all(map(isnan, (known.newest_s, known.begun_s, known.fitted_s)))
    assert isnan(known.lateness.timely_s)
    assert known.sensor is not None
    assert known.sensor is not sensor
    assert known.unwrapped(7.0, 9.0) == 7.0
    assert stream().sensor is None


# --- all streams ----------------------------------------------------------------------------------


class Streams:
    """The autopilot's stamps, which come at once, on a clock that is `AHEAD_S` behind ours."""

    def __init__(self) -> None:
        self.all = StampedStreams(lockstep=False)

    def receive(self, key: str, at_s: float, ahead_s: float = 0.0, **how: bool) -> float | None:
        """One frame; how late it is found to be, None: it is not taken."""
        now_s = AHEAD_S + at_s
        times = self.all.time_of(key, at_s + ahead_s, now_s, **how)
        return None if times is None else now_s - times[0]

    def run(self, key: str, from_s: float, until_s: float, **how: bool) -> None:
        """Sixteen times a second, both ends included."""
        for i in range(round((until_s - from_s) * 16) + 1):
            assert self.receive(key, from_s + i / 16, **how) == 0.0

    def known(self) -> StampedStreams:
        self.run("a", 100.0, 101.0)
        return self.all


@pytest.mark.parametrize(("stamp_s", "is_taken"), [(0.99e10, True), (1.01e10, False)])
def test_no_clock_has_run_for_three_hundred_years(stamp_s: float, is_taken: bool) -> None:
    times = StampedStreams(lockstep=False).time_of("a", stamp_s, 5.0, wrap_s=inf)
    assert (times == (5.0, stamp_s)) is is_taken
    assert (times is None) is not is_taken


@pytest.mark.parametrize(
    ("slower_s", "proven_s", "late_s"),
    [(0.2, 0.3, 0.2), (0.3, 0.3, 0.0), (0.2, 0.2, 0.0)],
)
def test_streams_share_the_offset_of_the_fastest_that_is_proven_and_near(
    slower_s: float, proven_s: float, late_s: float
) -> None:
    streams = Streams()
    streams.receive("fast", 100.0)
    streams.receive("fast", 100.0 + proven_s)
    found = streams.receive("slow", 100.5, -slower_s)
    assert found == pytest.approx(late_s)
    # And the fastest is not moved by it.
    assert streams.receive("fast", 100.6) == pytest.approx(0.0)


def test_a_clock_of_another_sender_has_an_offset_of_its_own() -> None:
    streams = Streams()
    streams.known()
    streams.run("camera", 101.0, 102.0, foreign=True)
    assert streams.receive("other", 102.0, -0.2, foreign=True) == pytest.approx(0.0)
    assert streams.receive("slow", 102.1, -0.2) == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("ahead_s", "is_taken"), [(0.09, True), (0.11, False), (-0.99, True), (-1.01, False)]
)
def test_the_first_stamp_of_a_stream_must_fit_the_others(ahead_s: float, is_taken: bool) -> None:
    streams = Streams()
    streams.known()
    assert (streams.receive("b", 101.1, ahead_s) is not None) is is_taken


@pytest.mark.parametrize(("after_s", "is_taken"), [(0.9, False), (1.1, True)])
def test_where_the_others_are_received_now(after_s: float, is_taken: bool) -> None:
    streams = Streams()
    streams.known()
    assert (streams.receive("b", 101.0 + after_s, 50.0) is not None) is is_taken


@pytest.mark.parametrize(("stamp_s", "is_taken"), [(0.99e9, False), (1.01e9, True)])
def test_the_time_of_day_counts_from_elsewhere(stamp_s: float, is_taken: bool) -> None:
    streams = Streams()
    known = streams.known()
    times = known.time_of("b", stamp_s, AHEAD_S + 101.1, wrap_s=inf)
    assert (times is not None) is is_taken


@pytest.mark.parametrize(
    ("ahead_s", "late_s", "refused"),
    [
        (0.09, 0.0, 0),
        (0.11, None, 0),  # a queue that has gone, perhaps: not counted
        (0.24, None, 0),
        (0.26, None, 1),
    ],
)
def test_nothing_is_sent_before_it_is_true(
    ahead_s: float, late_s: float | None, refused: int
) -> None:
    streams = Streams()
    known = streams.known()
    assert streams.receive("a", 101.0625, ahead_s) == (late_s and pytest.approx(late_s))
    assert known.refused == refused


@pytest.mark.parametrize(("back_s", "refused"), [(0.2, 0), (0.5, 0), (9.9, 0), (10.1, 1)])
def test_a_stamp_that_goes_back_is_refused_and_of_ten_seconds_ago_another_clock_s(
    back_s: float, refused: int
) -> None:
    streams = Streams()
    known = streams.known()
    assert streams.receive("a", 101.01, -back_s) is None
    assert known.refused == refused


@pytest.mark.parametrize(("late_s", "counts"), [(0.24, True), (0.26, False)])
def test_what_is_late_is_taken_with_its_age_and_does_not_count_in_the_minimum(
    late_s: float, counts: bool
) -> None:
    """What fits is when the clock was received last: then a new stream is compared with it."""
    streams = Streams()
    streams.known()
    assert streams.receive("a", 101.9, -late_s) == pytest.approx(late_s)
    assert (streams.receive("b", 102.1, 50.0) is None) is counts


def first_taken(streams: Streams, ahead_s: float, step_s: float) -> int:
    """Which frame of a clock that has jumped is the first that is taken."""
    for count in range(1, 200):
        if streams.receive("a", 101.0 + count * step_s, ahead_s) is not None:
            return count
    return 0


@pytest.mark.parametrize(
    ("ahead_s", "step_s", "count", "reboots"),
    [
        (30.0, 1 / 64, 7, 1),  # the first after 0.1 s without the old clock
        (-30.0, 1 / 64, 7, 1),
        (30.0, 1 / 4, 3, 1),  # three they must be
        (1.1, 1 / 64, 7, 1),
        (0.9, 1 / 16, 9, 1),  # a smaller jump must last for half a second
        (0.3, 1 / 16, 9, 1),
        (0.2, 1 / 64, 7, 0),  # a queue that has gone is no restart
    ],
)
def test_a_clock_that_has_jumped_is_taken_after_so_many_frames(
    ahead_s: float, step_s: float, count: int, reboots: int
) -> None:
    streams = Streams()
    known = streams.known()
    assert first_taken(streams, ahead_s, step_s) == count
    assert known.reboots == reboots
    assert known.leap_s == pytest.approx(ahead_s * reboots, abs=1e-6)


@pytest.mark.parametrize("others", [False, True])
def test_a_first_stamp_that_was_wrong_is_forgotten_after_half_a_second(others: bool) -> None:
    """Whether other streams are received meanwhile or not; and it was no restart."""
    streams = Streams()
    assert streams.receive("a", 100.0, 0.5) == 0.0
    taken = []
    for i in range(1, 13):
        taken.append(streams.receive("a", 100.0 + i / 16))
        if others:
            assert streams.receive("b", 100.0 + i / 16) == 0.0
    assert taken == [None] * 8 + [0.0] * 4
    assert streams.all.reboots == 0


def test_nobody_takes_over_while_another_stream_of_the_old_clock_comes() -> None:
    streams = Streams()
    known = streams.known()
    streams.run("b", 101.0, 101.5)
    for i in range(1, 9):
        assert streams.receive("a", 101.5 + i / 16, 30.0) is None
        assert streams.receive("b", 101.5 + i / 16) == 0.0
    assert known.reboots == 0
    assert known.suspected == 1
    assert known.suspect_ahead_s == pytest.approx(30.0)


def test_of_a_clock_that_is_not_the_autopilot_s_nothing_is_reported_or_reset() -> None:
    streams = Streams()
    known = streams.known()
    streams.run("camera", 101.0, 102.0, foreign=True)
    streams.run("a", 101.0625, 102.0)
    taken = [
        streams.receive("camera", 102.0 + i / 16, 30.0, foreign=True) is not None
        for i in range(1, 9)
    ]
    assert taken == [False, False] + [True] * 6
    assert (known.reboots, known.suspected) == (0, 0)
    assert streams.receive("a", 102.5) == 0.0


def test_a_restart_is_that_of_all_streams_of_the_autopilot_and_of_no_other() -> None:
    streams = Streams()
    known = streams.known()
    streams.run("camera", 100.0, 101.0, foreign=True)
    streams.run("b", 101.0, 101.5)
    for i in range(1, 4):
        streams.receive("b", 101.5 + i / 8, -90.0)
    assert known.reboots == 1
    assert streams.receive("a", 102.0, -90.0) == 0.0  # at once
    assert streams.receive("camera", 102.0, foreign=True) == 0.0
    assert streams.receive("camera", 102.5, -0.3, foreign=True) == pytest.approx(0.3)  # still known


def test_two_clocks_beside_each_other_are_contested_after_a_second_and_for_two() -> None:
    streams = Streams()
    known = streams.known()
    contested = []
    for i in range(1, 33):
        streams.receive("a", 101.0 + i / 16)
        streams.receive("a", 101.0 + (i + 0.5) / 16, 50.0)
        contested.append(known.is_contested(AHEAD_S + 101.0 + (i + 0.75) / 16))
    assert contested.index(True) == 16  # a second after the first of them
    end_s = AHEAD_S + 103.0 + 0.5 / 16 + 2.0
    assert known.is_contested(end_s - 0.01)
    assert not known.is_contested(end_s + 0.01)
    before = known.refused
    assert streams.receive("a", 103.1) is None
    assert known.refused == before + 1


# --- in lockstep ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("leap_s", "taken"),
    [
        (0.0, [False] * 3),
        (-0.99, [False] * 3),
        (0.99, [True] * 3),
        (1.01, [False, False, True]),
        (-1.01, [False, False, True]),
    ],
)
def test_in_lockstep_three_frames_of_a_second_s_leap_are_another_clock(
    leap_s: float, taken: list[bool]
) -> None:
    streams = StampedStreams(lockstep=True)
    assert streams.time_of("a", 100.0, 0.0) == (100.0, 100.0)
    found = [streams.time_of("a", 100.0 + leap_s + i / 1024, 0.0) for i in range(3)]
    if leap_s != 0.0:
        assert [times is not None for times in found] == taken
    else:
        assert found[0] is None
    assert streams.reboots == (leap_s < -1.0)
    assert streams.leap_s == pytest.approx(leap_s + 2 / 1024 if leap_s < -1.0 else 0.0)
    assert streams.refused == (2 if leap_s > 1.0 else 0)


def test_in_lockstep_a_frame_that_fits_ends_the_row_of_another_clock() -> None:
    streams = StampedStreams(lockstep=True)
    stamps = (100.0, 410.0, 410.005, 100.01, 410.01, 410.015, 100.02)
    taken = [streams.time_of("a", stamp_s, 0.0) is not None for stamp_s in stamps]
    assert taken == [True, False, False, True, False, False, True]
    assert streams.time_of("a", 410.02, 0.0) is None
