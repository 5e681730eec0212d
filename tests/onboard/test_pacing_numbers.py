"""The pacer's arithmetic: when to tick, whose time a tick has, what is learned from samples."""

from __future__ import annotations

from math import inf, nan

import pytest

from tgl_soar.onboard.pacing import (
    SHEDDING_TICKS,
    WARM_UP_S,
    LoadShedding,
    Pacer,
    TickCounters,
    Waiter,
)

P = 0.005


def locked(now_s: float = 10.0, period_s: float = P) -> tuple[Pacer, float]:
    """A pacer in step with a stream of its rate, and when its last sample came."""
    pacer = Pacer(200.0, now_s)
    for k in range(1, 31):
        at = now_s + k * period_s
        pacer.sample(at, 100.0 + k * period_s, at)
        pacer.tick(at)
    return pacer, now_s + 30 * period_s


def test_alone_it_is_due_a_period_after_it_begins_and_on_a_grid() -> None:
    pacer = Pacer(200.0, 10.0)
    assert (pacer.wake_s, pacer.expected_s) == (10.0 + P, 10.0 + P)
    pacer.begin(20.0)
    assert (pacer.wake_s, pacer.expected_s) == (20.0 + P, 20.0 + P)
    assert not pacer.due(20.0 + 0.9 * P)
    assert pacer.due(20.0 + P)
    assert pacer.tick(20.0 + 1.3 * P) == pytest.approx(20.0 + P)  # the grid's, not our waking's
    assert pacer.wake_s == pacer.expected_s == pytest.approx(20.0 + 2.0 * P)
    # Periods slept through are skipped: the tick is of now, the next one on the grid.
    now_s = 20.0 + 5.4 * P
    assert pacer.tick(now_s) == now_s
    assert pacer.counters.skipped == 3
    assert pacer.wake_s == pacer.expected_s == pytest.approx(20.0 + 6.0 * P)


def test_another_rate_moves_the_deadline_and_asks_for_the_stream_again() -> None:
    pacer, last_s = locked()
    assert pacer.locked
    pacer.set_rate(100.0)
    assert not pacer.locked
    assert pacer.wake_s == pacer.expected_s == pytest.approx(last_s + 2.0 * P)
    for k in range(1, 31):
        pacer.sample(last_s + 2 * k * P, 100.15 + 2 * k * P, last_s + 2 * k * P)
        assert pacer.locked == (k >= 20)  # twenty steps in a row
        if pacer.locked:
            break


@pytest.mark.parametrize(("step", "in_step"), [(1.0, True), (1.04, True), (1.07, False)])
def test_a_stream_within_a_twentieth_of_its_rate_is_followed(step: float, in_step: bool) -> None:
    pacer = Pacer(200.0, 10.0)
    for k in range(400):
        at = 10.0 + k * step * P
        pacer.sample(at, at, at)
    assert pacer.locked == in_step


def test_a_sample_out_of_step_costs_two_and_forty_are_remembered() -> None:
    """Of forty in step ten that are not leave twenty: then the pacer unlocks."""
    pacer = Pacer(200.0, 10.0)
    stamp = 10.0
    for _ in range(200):
        stamp += P
        pacer.sample(stamp, stamp, stamp)
    for k in range(1, 12):
        stamp += 3.0 * P
        pacer.sample(stamp, stamp, stamp)
        assert pacer.locked == (k <= 10), k


def test_locked_it_waits_half_a_period_for_a_sample_and_then_ticks_without() -> None:
    pacer, last_s = locked()
    assert pacer.wake_s == pytest.approx(last_s + P + 0.5 * P)
    assert not pacer.due(last_s + 1.49 * P)
    assert pacer.due(last_s + 1.51 * P)
    # Its time is a period after the last one's, and the grid goes on.
    assert pacer.tick(last_s + 1.51 * P) == pytest.approx(last_s + P)
    assert pacer.wake_s == pytest.approx(last_s + 2.5 * P)
    assert pacer.expected_s == pytest.approx(last_s + 2.0 * P)


@pytest.mark.parametrize(("early", "due"), [(0.55, True), (0.65, False)])
def test_a_sample_that_comes_early_by_no_more_than_six_tenths_is_the_next(
    early: float, due: bool
) -> None:
    pacer, last_s = locked()
    at = last_s + (1.0 - early) * P
    pacer.sample(at, 100.0 + 31 * P, at)
    assert pacer.due(at) == due


def test_a_tick_has_its_sample_s_time_unless_that_is_a_period_old() -> None:
    pacer, last_s = locked()
    at = last_s + P
    pacer.sample(at, 100.0 + 31 * P, at - 0.4 * P)
    assert pacer.tick(at + 0.1 * P) == pytest.approx(at - 0.4 * P)
    assert pacer.counters.on_sample == 11  # since it follows, and this one
    assert pacer.wake_s == pytest.approx(at + 1.5 * P)
    old = at + P
    pacer.sample(old, 100.0 + 32 * P, old - 1.5 * P)
    assert pacer.tick(old) == old


@pytest.mark.parametrize(("late_s", "counted"), [(0.0019, 0), (0.0021, 1)])
def test_two_milliseconds_after_it_was_due_a_tick_is_late(late_s: float, counted: int) -> None:
    pacer = Pacer(200.0, 10.0)
    pacer.tick(10.0 + P + late_s)
    assert pacer.counters.late == counted
    assert pacer.counters.worst_late_s == pytest.approx(late_s)
    pacer.done(11.0, 11.0 + 0.99 * P)
    assert pacer.counters.over_run == 0
    pacer.done(11.0, 11.0 + 1.01 * P)
    assert pacer.counters.over_run == 1


@pytest.mark.parametrize(("after", "weight"), [(0.3, 0.02), (-0.3, 0.2)])
def test_where_the_next_is_expected_follows_what_comes_early_more_than_what_comes_late(
    after: float, weight: float
) -> None:
    """A late one may have waited for us: it counts a fiftieth, an early one a fifth."""
    pacer, last_s = locked()
    before_s = pacer.expected_s
    assert before_s == pytest.approx(last_s + P)
    at = before_s + after * P
    pacer.sample(at, 100.0 + 31 * P, at)
    pacer.tick(at)
    arrivals_s = P + 0.02 * after * P
    assert pacer.expected_s == pytest.approx(before_s + weight * after * P + arrivals_s)


def test_far_from_where_it_was_expected_the_next_is_expected_from_there() -> None:
    pacer, last_s = locked()
    at = last_s + 1.7 * P
    pacer.sample(at, 100.0 + 31 * P, at)
    pacer.tick(at)
    assert pacer.expected_s == pytest.approx(at + P)  # 1.7 periods are no interval of arrivals


def test_a_warm_up_begins_before_the_sample_by_as_long_as_it_takes() -> None:
    pacer, _ = locked()
    begin_s = pacer.expected_s - WARM_UP_S
    assert pacer.warm_up_s == pytest.approx(begin_s)
    pacer.warmed_up(begin_s, begin_s + WARM_UP_S + 0.0005)
    assert pacer.warm_up_s == inf  # once for each tick
    pacer.tick(pacer.wake_s)
    ahead_s = WARM_UP_S + 0.2 * 0.0005  # what took longer counts a fifth
    assert pacer.expected_s - pacer.warm_up_s == pytest.approx(ahead_s)
    pacer.warmed_up(pacer.warm_up_s, pacer.warm_up_s + ahead_s - 0.0003)
    pacer.tick(pacer.wake_s)
    ahead_s -= 0.01 * 0.0003  # what was quicker a hundredth
    assert pacer.expected_s - pacer.warm_up_s == pytest.approx(ahead_s)
    assert Pacer(200.0, 0.0).warm_up_s == inf  # alone there is no sample


def test_three_that_do_not_fit_one_after_the_other_end_them_for_a_thousand_ticks() -> None:
    """Two fifths of a period are what there is for one."""
    pacer, _ = locked()
    for took in (0.42, 0.42, 0.38, 0.42, 0.42, 0.42):
        assert pacer.warm_up_s < inf
        pacer.warmed_up(0.0, took * P)
        pacer.tick(pacer.wake_s)
    for _ in range(999):
        assert pacer.warm_up_s == inf
        pacer.tick(pacer.wake_s)
    assert pacer.warm_up_s < inf


def test_one_late_tick_costs_telemetry_for_a_moment_and_a_third_of_them_the_log() -> None:
    load, counters = LoadShedding(), TickCounters()
    assert (load.no_telemetry, load.no_log) == (False, False)
    load.tick(counters, -1, 0)
    assert load.value == pytest.approx(1.0 / 40.0)
    assert load.no_telemetry
    ticks = 0
    while load.no_telemetry:
        load.tick(counters, 0, 0)
        ticks += 1
    assert ticks == 9  # 0.025 (1 − 1/40)^9 < 0.02
    for k in range(200):
        load.tick(counters, 0, -1 if k % 3 == 0 else 0)  # skipped ones count as late ones do
    assert load.value == pytest.approx(1.0 / 3.0, abs=0.02)
    assert load.no_log
    assert SHEDDING_TICKS == 40
    for k in range(400):
        load.tick(counters, 0, -1 if k % 4 == 0 else 0)
    assert not load.no_log


class Clock:
    """Goes on by itself with every look, and sleeps as asked."""

    def __init__(self) -> None:
        self.now_s, self.looks = 0.0, 0

    def __call__(self) -> float:
        self.looks += 1
        self.now_s += 1e-6
        return self.now_s


def test_it_sleeps_until_shortly_before_the_tick_and_waits_awake_for_the_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock, slept = Clock(), []

    def select(_fds: object, _w: object, _x: object, seconds: float) -> tuple[list[int], ...]:
        if seconds > 0.0:
            slept.append(seconds)
            clock.now_s += seconds
        return [], [], []

    monkeypatch.setattr("tgl_soar.onboard.pacing.select.select", select)
    waiter = Waiter(clock, awake_s=0.0001)
    now_s, ready = waiter.wait([-1], 0.006, 0.004)
    assert ready == []
    assert now_s >= 0.006
    assert slept[0] == pytest.approx(0.0039, abs=5e-6)
    # Awake from 0.0039 to 0.0041, and asleep again until the end.
    assert slept[1] == pytest.approx(0.006 - 0.0041, abs=5e-6)
    assert len(slept) == 2


def test_how_early_it_must_wake_is_learnt_from_how_late_it_woke(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = Clock()
    late_s = [0.00005]

    def select(_fds: object, _w: object, _x: object, seconds: float) -> tuple[list[int], ...]:
        if seconds > 0.0:
            clock.now_s += seconds + late_s[0]
        return [], [], []

    monkeypatch.setattr("tgl_soar.onboard.pacing.select.select", select)
    waiter = Waiter(clock)
    assert waiter.awake_s == 0.0
    waiter.wait([], clock.now_s + 0.005)
    assert waiter.awake_s == pytest.approx(0.2 * 0.00005, rel=0.1)
    late_s[0] = 0.01
    before = waiter.awake_s
    waiter.wait([], clock.now_s + 0.005)  # an odd one: 0.2 ms at the most
    assert waiter.awake_s == pytest.approx(before + 0.2 * (0.0002 - before), rel=0.1)
    late_s[0], before = 0.0, waiter.awake_s
    waiter.wait([], clock.now_s + 0.005)
    assert waiter.awake_s == pytest.approx(0.99 * before, rel=0.05)


def test_a_stamp_that_is_no_number_ends_no_loop() -> None:
    pacer, last_s = locked()
    pacer.sample(last_s + P, nan, last_s + P)
    assert pacer.tick(last_s + P) == pytest.approx(last_s + P)
