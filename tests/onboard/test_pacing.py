"""When the loop ticks, in simulated time: every rate is exactly the one that it claims."""

import itertools
import random
from collections.abc import Callable

import pytest

from tgl_soar.onboard.pacing import Pacer

STEP_S = 0.0001  # how finely the simulated process can wake


def fly(
    pacer: Pacer,
    seconds: float,
    samples: list[tuple[float, float]],
    awake: Callable[[float], bool] = lambda _: True,
) -> list[tuple[float, float]]:
    """(real time, tick's time) of every tick; samples are (arrival, stamp)."""
    ticks: list[tuple[float, float]] = []
    waiting = sorted(samples)
    for i in range(round(seconds / STEP_S)):
        now = i * STEP_S
        if not awake(now):
            continue
        while waiting and waiting[0][0] <= now:
            _, stamp = waiting.pop(0)
            pacer.sample(now, stamp, stamp)
        if pacer.due(now):
            ticks.append((now, pacer.tick(now)))
    return ticks


def stream(
    rate_hz: float,
    seconds: float,
    *,
    jitter_s: float = 0.0,
    loss: float = 0.0,
    phase_s: float = 0.0,
) -> list[tuple[float, float]]:
    """Samples that arrive 1 ms after their stamp, and up to jitter_s later; seeded."""
    noise = random.Random(1)
    samples = []
    for i in range(round(seconds * rate_hz)):
        stamp = phase_s + i / rate_hz
        delay = 0.001 + noise.uniform(0.0, jitter_s)
        if noise.random() >= loss:
            samples.append((stamp + delay, stamp))
    return samples


@pytest.mark.parametrize("rate_hz", [100.0, 125.0, 200.0, 250.0])
def test_alone_it_ticks_at_exactly_its_rate(rate_hz: float) -> None:
    pacer = Pacer(rate_hz, 0.0)
    ticks = fly(pacer, 10.0, [])
    assert len(ticks) == pytest.approx(10 * rate_hz, abs=1)
    assert pacer.counters.ticks == len(ticks)
    times = [t for _, t in ticks]
    assert all(b - a == pytest.approx(1 / rate_hz, abs=1e-9) for a, b in itertools.pairwise(times))
    assert pacer.counters.late == pacer.counters.skipped == pacer.counters.on_sample == 0


@pytest.mark.parametrize("phase_s", [0.0, 0.001, 0.002, 0.003, 0.004])
@pytest.mark.parametrize("jitter_s", [0.0, 0.002])
def test_it_follows_an_attitude_stream_of_its_own_rate(phase_s: float, jitter_s: float) -> None:
    """Whatever the phase at the start, each sample soon has its tick as it arrives."""
    pacer = Pacer(200.0, 0.0)
    samples = stream(200.0, 10.0, jitter_s=jitter_s, phase_s=phase_s)
    ticks = fly(pacer, 10.0, samples)
    assert len(ticks) == pytest.approx(2000, abs=2)
    assert pacer.locked
    assert pacer.counters.on_sample >= 2000 - 40
    late = [now - time for now, time in ticks[100:]]
    assert max(late) <= 0.001 + jitter_s + 2 * STEP_S
    assert pacer.counters.skipped == 0


def test_a_first_tick_after_a_backlog_has_a_time_although_no_sample_begins_it() -> None:
    """What came while the module started is read at once: in step, but older than the grid."""
    pacer = Pacer(200.0, 100.0)
    pacer.begin(100.0)
    for k in range(34):
        pacer.sample(100.0001, 50.0 + 0.005 * k, 99.84 + 0.005 * k)
    assert pacer.locked
    first = pacer.tick(100.009)
    assert 100.0 <= first <= 100.009
    assert pacer.counters.on_sample == 0
    assert pacer.tick(100.014) == pytest.approx(first + 0.005, abs=1e-9)


def test_the_tick_s_time_is_the_sample_s_own() -> None:
    pacer = Pacer(200.0, 0.0)
    ticks = fly(pacer, 10.0, stream(200.0, 10.0, jitter_s=0.002))
    times = [t for _, t in ticks[100:]]
    steps = [b - a for a, b in itertools.pairwise(times)]
    assert all(step == pytest.approx(0.005, abs=1e-9) for step in steps)


def test_samples_in_steps_of_half_a_period_each_have_their_tick_at_once() -> None:
    """As an autopilot sends whose main loop has twice the rate, over a link that adds 0.1 ms."""
    noise = random.Random(3)
    samples = [
        (i / 200 + 0.001 + noise.choice((0.0, 0.0025)) + noise.uniform(0.0, 1e-4), i / 200)
        for i in range(2000)
    ]
    ticks = [when for when, _ in fly(Pacer(200.0, 0.0), 10.0, samples)]
    assert len(ticks) == pytest.approx(2000, abs=5)
    waited = [
        next(when for when in ticks[max(0, i - 20) :] if when >= arrival) - arrival
        for i, (arrival, _) in enumerate(samples[200:1950], 200)
    ]
    assert max(waited) < 2 * STEP_S


@pytest.mark.parametrize("loss", [0.05, 0.2])
def test_lost_samples_cost_no_tick(loss: float) -> None:
    pacer = Pacer(200.0, 0.0)
    ticks = fly(pacer, 10.0, stream(200.0, 10.0, jitter_s=0.001, loss=loss))
    assert len(ticks) == pytest.approx(2000, abs=4)
    times = [t for _, t in ticks]
    assert times == sorted(times)
    assert all(time <= now for now, time in ticks)


@pytest.mark.parametrize("stream_hz", [10.0, 50.0, 100.0, 133.0, 160.0, 333.0, 400.0])
def test_a_stream_of_another_rate_does_not_set_the_pace(stream_hz: float) -> None:
    pacer = Pacer(200.0, 0.0)
    ticks = fly(pacer, 10.0, stream(stream_hz, 10.0, jitter_s=0.001))
    assert len(ticks) == pytest.approx(2000, abs=1)
    assert not pacer.locked
    assert pacer.counters.on_sample == 0


def test_a_stream_of_nearly_its_rate_is_followed() -> None:
    """Two quartzes: the loop then runs at the vehicle's 200 Hz, not at its own."""
    pacer = Pacer(200.0, 0.0)
    ticks = fly(pacer, 10.0, stream(199.0, 10.0))
    assert len(ticks) == pytest.approx(1990, abs=3)


def test_a_stream_that_stops_leaves_the_rate_as_it_was() -> None:
    pacer = Pacer(200.0, 0.0)
    ticks = fly(pacer, 10.0, stream(200.0, 5.0))
    after = [now for now, _ in ticks if now >= 5.1]
    assert len(after) == pytest.approx(980, abs=1)
    times = [t for _, t in ticks]
    assert times == sorted(times)


def test_periods_slept_through_are_skipped_and_counted() -> None:
    pacer = Pacer(200.0, 0.0)
    ticks = fly(pacer, 2.0, [], awake=lambda now: not 1.0 < now < 1.1)
    assert len(ticks) == pytest.approx(400 - 20, abs=2)
    assert pacer.counters.skipped == pytest.approx(19, abs=1)
    assert pacer.counters.late == 1
    assert pacer.counters.worst_late_s == pytest.approx(0.1, abs=0.006)
    gaps = [b - a for (a, _), (b, _) in itertools.pairwise(ticks)]
    assert sum(gap < 0.0049 for gap in gaps) <= 1  # no burst: one step back onto the grid


def test_an_old_sample_does_not_pass_for_a_new_one() -> None:
    """A backlog after a stall: the tick's time must show how old its sample is."""
    pacer = Pacer(200.0, 0.0)
    fly(pacer, 1.0, stream(200.0, 1.0))
    pacer.sample(3.0, 1.0, 1.0)
    assert pacer.tick(3.0) == 3.0


def test_a_new_rate_holds_from_the_next_tick_on() -> None:
    pacer = Pacer(200.0, 0.0)
    fly(pacer, 1.0, [])
    pacer.set_rate(100.0)
    count = 0
    for i in range(10_000):
        now = 1.0 + i * STEP_S
        if pacer.due(now):
            pacer.tick(now)
            count += 1
    assert count == pytest.approx(100, abs=1)


def warming_up(
    took_s: Callable[[], float],
    *,
    interval_s: float = 0.005,
    jitter_s: float = 0.0,
    drift: float = 0.0,
    loss: float = 0.0,
) -> tuple[Pacer, list[float], list[float]]:
    """A pacer that has followed samples, each read once its warm-up was over; and of the last
    thousand, how long each one waited to be read, and how long after it was expected it came.

    `drift`: how much slower the vehicle's clock is than ours.
    """
    pacer, noise = Pacer(1.0 / 0.005, 0.0), random.Random(2)
    waited, after = [], []
    for i in range(3000):
        comes_s = i * interval_s * (1.0 + drift) + noise.uniform(0.0, jitter_s)
        if noise.random() < loss:
            if pacer.due(comes_s + 0.6 * interval_s):
                pacer.tick(comes_s + 0.6 * interval_s)
            continue
        free_s = -float("inf")
        if pacer.warm_up_s < comes_s:
            begins_s = pacer.warm_up_s
            free_s = begins_s + took_s()
            pacer.warmed_up(begins_s, free_s)
            assert pacer.warm_up_s == float("inf")  # not twice
        now_s = max(comes_s, free_s)
        waited.append(now_s - comes_s)
        after.append(comes_s - pacer.expected_s)
        pacer.sample(now_s, i * interval_s, i * interval_s)
        assert not pacer.locked or pacer.due(now_s)
        if pacer.due(now_s):
            pacer.tick(now_s)
    assert pacer.locked
    return pacer, waited[-1000:], after[-1000:]


@pytest.mark.parametrize("interval_s", [0.005, 0.00505, 0.0049])
def test_a_warm_up_ends_as_its_sample_comes(interval_s: float) -> None:
    assert Pacer(200.0, 0.0).warm_up_s == float("inf")  # nothing is expected yet
    pacer, waited, after = warming_up(lambda: 0.0002, interval_s=interval_s)
    assert pacer.expected_s - pacer.warm_up_s == pytest.approx(0.0002, abs=5e-6)
    assert max(waited) < 10e-6
    assert max(map(abs, after)) < 10e-6


@pytest.mark.parametrize("drift", [-0.01, -0.001, 0.0005, 0.01])
def test_the_vehicles_clock_may_go_otherwise_than_ours(drift: float) -> None:
    _, waited, after = warming_up(lambda: 0.0002, drift=drift)
    assert max(waited) < 20e-6
    assert max(map(abs, after)) < 20e-6


def test_a_sample_that_is_lost_does_not_move_where_the_next_is_expected() -> None:
    noise = random.Random(4)
    _, waited, after = warming_up(lambda: noise.uniform(0.0001, 0.0002), loss=0.15)
    assert len(waited) == 1000
    assert max(map(abs, after)) < 50e-6


def test_most_warm_ups_are_done_in_time_however_long_each_takes() -> None:
    noise = random.Random(3)
    _, waited, after = warming_up(lambda: noise.uniform(0.0001, 0.0003))
    assert 0.1 < sum(w > 0.0 for w in waited) / len(waited) < 0.45
    assert max(map(abs, after)) < 50e-6  # it is not later and later itself


def test_where_samples_jitter_the_first_of_them_are_waited_for() -> None:
    _, waited, after = warming_up(lambda: 0.0001, jitter_s=0.0005)
    assert 0.6 < sum(a > 0.0 for a in after) / len(after) < 0.98
    assert sum(w > 0.0 for w in waited) / len(waited) < 0.4


def test_warm_ups_that_do_not_fit_are_left_out_for_some_seconds() -> None:
    pacer, _, _ = warming_up(lambda: 0.0002)
    warm_ups = []
    for i in range(3000, 3000 + 2200):
        if pacer.warm_up_s < float("inf"):
            assert pacer.expected_s - pacer.warm_up_s <= 0.4 * pacer.period_s + 1e-9
            warm_ups.append(i)
            pacer.warmed_up(pacer.warm_up_s, pacer.warm_up_s + 0.0021)
        pacer.sample(i * 0.005, i * 0.005, i * 0.005)
        pacer.tick(i * 0.005)
    assert [i - 3000 for i in warm_ups] == [0, 1, 2, 1002, 1003, 1004, 2004, 2005, 2006]


def test_after_a_gap_or_another_rate_the_next_sample_is_expected_again() -> None:
    pacer, _, _ = warming_up(lambda: 0.0002)
    sample_s = pacer.expected_s + 0.9 * pacer.period_s
    pacer.sample(sample_s, 3000 * 0.005, 3000 * 0.005)
    pacer.tick(sample_s)
    assert pacer.expected_s == pytest.approx(sample_s + pacer.period_s, abs=1e-4)
    pacer.set_rate(100.0)
    assert pacer.expected_s == pytest.approx(sample_s + 0.01, abs=1e-3)
    assert pacer.warm_up_s == float("inf")


def test_a_tick_that_takes_longer_than_its_period_is_counted() -> None:
    pacer = Pacer(200.0, 0.0)
    pacer.done(1.0, 1.0049)
    assert pacer.counters.over_run == 0
    pacer.done(2.0, 2.0051)
    assert pacer.counters.over_run == 1
