"""The server's clock, stamp by stamp: its interval, and each limit on both sides."""

from __future__ import annotations

from math import inf, isnan

import pytest

from tgl_soar.link.natnet.clock import ServerClock

APART_S = 40.0  # ours less the server's
AHEAD_S = 0.1  # nothing is sent before it is exposed: more is another clock
EARLY_S = 0.002
T = 100.0  # when it begins, on our clock


def stamped(clock: ServerClock, at_s: float, late_s: float) -> bool:
    """A frame that is late by so much against the offset; negative: ahead."""
    return clock.stamped(at_s - APART_S - late_s, at_s)


def known(late_s: float = 0.0) -> ServerClock:
    clock = ServerClock()
    assert stamped(clock, T, late_s)
    return clock


def echoed(at_s: float, before_s: float, after_s: float) -> ServerClock:
    """The server had our question so long after we asked, and so long before the answer came."""
    clock = ServerClock()
    assert clock.echoed(at_s - APART_S, at_s - before_s, at_s + after_s)
    return clock


# --- what is known -------------------------------------------------------------------------------


def test_before_anything_has_come_nothing_is_known() -> None:
    clock = ServerClock()
    assert not clock.is_known
    assert isnan(clock.offset_s)
    assert clock.uncertainty_s == inf
    assert clock.restarts == 0


def test_a_frame_bounds_the_offset_from_above_alone() -> None:
    clock = known(0.004)
    assert clock.is_known
    assert clock.offset_s == pytest.approx(APART_S + 0.004)
    assert clock.uncertainty_s == inf


def test_an_echo_bounds_it_from_both_sides_and_the_offset_is_the_middle() -> None:
    clock = echoed(T, 0.003, 0.005)
    assert clock.offset_s == pytest.approx(APART_S + 0.5 * (0.005 - 0.003))
    assert clock.uncertainty_s == pytest.approx(0.5 * (0.003 + 0.005))


def test_a_later_echo_narrows_the_interval_and_one_that_took_longer_does_not() -> None:
    clock = echoed(T, 0.003, 0.005)
    assert clock.echoed(T + 1.0 - APART_S, T + 1.0 - 0.001, T + 1.0 + 0.004)
    assert clock.uncertainty_s == pytest.approx(0.5 * (0.001 + 0.004))
    assert clock.echoed(T + 1.1 - APART_S, T + 1.1 - 0.010, T + 1.1 + 0.010)
    assert clock.uncertainty_s == pytest.approx(0.5 * (0.001 + 0.004), rel=0.01)


def test_an_answer_that_came_before_it_was_asked_for_is_none() -> None:
    clock = ServerClock()
    assert not clock.echoed(T - APART_S, T, T - 1e-6)
    assert not clock.is_known
    assert clock.echoed(T - APART_S, T, T)  # at once: a server on the same computer


def test_bounds_go_apart_by_a_ten_thousandth_of_the_time_and_only_as_it_goes_on() -> None:
    clock = echoed(T, 0.003, 0.0)
    for step in range(1, 11):
        assert stamped(clock, T + step, 0.0)
    assert clock.uncertainty_s == pytest.approx(0.5 * (0.003 + 10.0 * 1e-4))
    assert stamped(clock, T + 5.0, 0.0)  # one that was overtaken
    assert clock.uncertainty_s == pytest.approx(0.5 * (0.003 + 10.0 * 1e-4))
    assert stamped(clock, T + 10.0, 0.0)
    assert clock.uncertainty_s == pytest.approx(0.5 * (0.003 + 10.0 * 1e-4))


def test_where_two_bounds_contradict_each_other_a_little_they_touch() -> None:
    clock = echoed(T, 0.0, 0.001)
    assert stamped(clock, T + 0.01, -0.0015)
    assert clock.uncertainty_s == pytest.approx(0.0, abs=1e-9)
    assert clock.offset_s == pytest.approx(APART_S - 0.0015)


def test_reset_nothing_is_known() -> None:
    clock = echoed(T, 0.003, 0.005)
    clock.reset()
    assert not clock.is_known
    assert isnan(clock.offset_s)
    assert clock.uncertainty_s == inf
    assert stamped(clock, T, -30.0)  # and whatever comes is the first
    assert clock.restarts == 0


# --- what is odd ---------------------------------------------------------------------------------


@pytest.mark.parametrize(("late_s", "fits"), [(0.0, True), (0.999, True), (1.001, False)])
@pytest.mark.parametrize("with_echo", [False, True])
def test_a_frame_may_be_under_way_for_a_second(late_s: float, fits: bool, with_echo: bool) -> None:
    clock = echoed(T, 0.0, 0.0) if with_echo else known()
    assert stamped(clock, T + 0.01, late_s) == fits
    assert clock.offset_s == pytest.approx(APART_S, abs=1e-5)


@pytest.mark.parametrize(
    ("ahead_s", "fits"), [(AHEAD_S + EARLY_S - 0.0001, True), (AHEAD_S + EARLY_S + 0.0001, False)]
)
def test_without_an_echo_a_frame_may_have_been_faster_by_a_tenth_of_a_second(
    ahead_s: float, fits: bool
) -> None:
    assert stamped(known(), T + 0.01, -ahead_s) == fits


@pytest.mark.parametrize(("ahead_s", "fits"), [(0.0019, True), (0.0021, False)])
def test_with_an_echo_it_may_be_ahead_of_the_lower_bound_by_two_milliseconds(
    ahead_s: float, fits: bool
) -> None:
    clock = echoed(T, 0.01, 0.0)
    assert stamped(clock, T, -(0.01 + ahead_s)) == fits


@pytest.mark.parametrize(("over_s", "fits"), [(0.0019, True), (0.0021, False)])
def test_an_echo_s_lower_bound_may_be_above_the_upper_one_by_two_milliseconds(
    over_s: float, fits: bool
) -> None:
    """The server's stamp says that it had the question before we asked."""
    clock = known()
    assert clock.echoed(T - APART_S - over_s, T, T + 0.02) == fits


# --- a clock that is another one -----------------------------------------------------------------

FAR_S = 30.0


def frames(clock: ServerClock, *at_s: float, moving_s: float = 0.0) -> list[bool]:
    """Frames of a clock that is far from the known one, each odd by a little more or less."""
    return [
        stamped(clock, T + at, FAR_S + moving_s * count) for count, at in enumerate(at_s, start=1)
    ]


def test_three_odd_frames_over_a_tenth_of_a_second_are_a_restart() -> None:
    clock = known()
    assert frames(clock, 1.0, 1.06, 1.11) == [False, False, True]
    assert clock.restarts == 1
    assert clock.offset_s == pytest.approx(APART_S + FAR_S)
    assert clock.uncertainty_s == inf
    assert stamped(clock, T + 1.2, FAR_S)


def test_two_are_none_however_far_apart() -> None:
    clock = known()
    assert frames(clock, 1.0, 1.5) == [False, False]
    assert clock.restarts == 0


def test_a_burst_is_none_however_many() -> None:
    clock = known()
    assert frames(clock, *(1.0 + 0.009 * i for i in range(11))) == [False] * 11
    assert frames(clock, 1.101) == [True]


def test_a_frame_that_fits_begins_the_count_again() -> None:
    clock = known()
    assert frames(clock, 1.0, 1.06) == [False, False]
    assert stamped(clock, T + 1.08, 0.0)
    assert frames(clock, 1.11, 1.17) == [False, False]
    assert frames(clock, 1.22) == [True]
    assert clock.restarts == 1


@pytest.mark.parametrize(
    ("moving_s", "restarts"), [(0.019, 1), (-0.019, 1), (0.021, 0), (-0.021, 0)]
)
def test_odd_frames_of_one_clock_are_within_twenty_milliseconds_of_the_first(
    moving_s: float, restarts: int
) -> None:
    clock = known()
    for at_s, step in ((1.0, 0), (1.06, 1), (1.11, 1)):
        stamped(clock, T + at_s, FAR_S + moving_s * step)
    assert clock.restarts == restarts


def test_after_a_restart_the_bounds_go_apart_from_then_on() -> None:
    """Not from the last frame of the clock before."""
    clock = echoed(T, 0.003, 0.0)
    assert frames(clock, 1000.0, 1000.06) == [False, False]
    at_s = T + 1000.11
    assert clock.echoed(at_s - APART_S - FAR_S, at_s - 0.001, at_s)
    assert clock.restarts == 1
    assert stamped(clock, at_s + 1.0, FAR_S)
    assert clock.uncertainty_s == pytest.approx(0.5 * (0.001 + 1e-4))
