"""When a line through stamps begins, what it follows, and when it is given up."""

from __future__ import annotations

import pytest

from tgl_soar.link.sensor_clock import SensorClock

MS = 1e-3
HALF_MS = 0.5e-3


def after(*stamps_ms: int) -> SensorClock:
    clock = SensorClock()
    for stamp_ms in stamps_ms:
        clock.recover(stamp_ms * MS)
    return clock


def steady(count: int, period_ms: int = 5) -> list[int]:
    """Stamps of an even stream, one more than its periods."""
    return [1000 + period_ms * i for i in range(count + 1)]


def test_before_there_is_a_line_a_sample_is_of_the_middle_of_its_millisecond() -> None:
    clock = SensorClock()
    for stamp_ms in (1000, 1005, 1017, 1018):
        assert clock.recover(stamp_ms * MS) == pytest.approx(stamp_ms * MS + HALF_MS, abs=1e-9)
        assert clock.period_s == 0.0


@pytest.mark.parametrize(("steps", "period_s"), [(4, 0.0), (5, 0.005)])
def test_five_steps_alike_begin_a_line(steps: int, period_s: float) -> None:
    assert after(*steady(steps)).period_s == pytest.approx(period_s, abs=1e-9)


def test_its_first_period_is_the_mean_of_the_five() -> None:
    """Steps of 4, 5, 5, 4 and 5 ms."""
    assert after(1000, 1004, 1009, 1014, 1018, 1023).period_s == pytest.approx(0.0046)


@pytest.mark.parametrize(("step_ms", "begins"), [(5, True), (6, True), (4, True), (7, False)])
def test_steps_are_alike_within_the_stamps_grain(step_ms: int, begins: bool) -> None:
    """One of another rate begins a row of its own."""
    stamps = [1000, 1005, 1010, 1015, 1020, 1020 + step_ms]
    assert (after(*stamps).period_s > 0.0) is begins
    last = stamps[-1]
    more = [last + step_ms * i for i in range(1, 5)]
    assert after(*stamps, *more[:3]).period_s == pytest.approx(
        0.0 if not begins else 0.005, abs=1e-3
    )
    assert after(*stamps, *more).period_s > 0.0


@pytest.mark.parametrize(("pause_ms", "is_kept"), [(1995, True), (2005, False)])
def test_after_a_pause_of_two_seconds_nothing_is_known(pause_ms: int, is_kept: bool) -> None:
    stamps = steady(100)
    assert (after(*stamps, stamps[-1] + pause_ms).period_s > 0.0) is is_kept


def test_lost_samples_are_whole_periods() -> None:
    stamps = [stamp for i, stamp in enumerate(steady(60)) if i < 6 or i % 7 == 0]
    assert after(*stamps).period_s == pytest.approx(0.005, abs=1e-9)


@pytest.mark.parametrize(("periods", "is_kept"), [(18, False), (19, False), (20, True), (30, True)])
def test_a_young_line_is_given_up_at_its_first_misfit(periods: int, is_kept: bool) -> None:
    stamps = steady(periods)
    late = after(*stamps, stamps[-1] + 7)  # by 2 ms
    assert (late.period_s > 0.0) is is_kept


@pytest.mark.parametrize(("misfits", "is_kept"), [(1, True), (2, True), (3, False)])
def test_an_old_one_at_the_third_in_a_row(misfits: int, is_kept: bool) -> None:
    stamps = steady(50)
    late = [stamps[-1] + 5 * i + 2 for i in range(1, misfits + 1)]
    clock = after(*stamps, *late)
    assert (clock.period_s > 0.0) is is_kept
    if is_kept:  # and one that fits ends the row
        more = [stamps[-1] + 5 * i for i in range(misfits + 1, misfits + 3)]
        again = [more[-1] + 5 * i + 2 for i in (1, 2)]
        assert after(*stamps, *late, *more, *again).period_s == pytest.approx(0.005, abs=1e-9)


def test_what_does_not_fit_does_not_measure_and_is_of_its_own_millisecond() -> None:
    clock = after(*steady(50))
    assert clock.recover(1.257) == pytest.approx(1.257)  # the line says 1.2555: its begin is next
    assert clock.period_s == pytest.approx(0.005, abs=1e-9)
    assert clock.recover(1.260) == pytest.approx(1.2605, abs=1e-9)


@pytest.mark.parametrize(("early_ms", "follows"), [(1, True), (2, False)])
def test_a_millisecond_is_followed_and_two_are_not(early_ms: int, follows: bool) -> None:
    """By 2 (2n - 1) / (n (n + 1)) of it in time, 6 / (n (n + 1)) in the period."""
    n = 51
    clock = after(*steady(n - 1))
    clock.recover((1000 + 5 * n - early_ms) * MS)
    gained_s = -early_ms * MS * 6.0 / (n * (n + 1)) if follows else 0.0
    assert clock.period_s == pytest.approx(0.005 + gained_s, abs=1e-10)
    at_s = 1.0 + 0.005 * (n + 1) + HALF_MS
    moved_s = -early_ms * MS * (2.0 * (2 * n - 1) + 6.0) / (n * (n + 1)) if follows else 0.0
    assert clock.recover(1.0 + 0.005 * (n + 1)) == pytest.approx(
        # The next one pulls it back a little by itself.
        at_s + moved_s * (1.0 - 2.0 * (2 * n + 1) / ((n + 1) * (n + 2))),
        abs=1e-9,
    )


@pytest.mark.parametrize("periods", [450, 800])
def test_it_remembers_four_hundred_periods_and_no_more(periods: int) -> None:
    clock = after(*steady(periods - 1))
    clock.recover((1000 + 5 * periods - 1) * MS)
    assert clock.period_s - 0.005 == pytest.approx(-MS * 6.0 / (400 * 401), rel=1e-3)


def test_times_grow_though_stamps_stand_still() -> None:
    clock = SensorClock()
    first, second, third = (clock.recover(stamp_s) for stamp_s in (1.0, 1.0, 0.9))
    assert second - first == pytest.approx(1e-6, rel=1e-3)
    assert third - second == pytest.approx(1e-6, rel=1e-3)
