"""The sensor's clock out of stamps of whole milliseconds, and the ends of the counters."""

from __future__ import annotations

import itertools
from math import floor, inf, sqrt
from random import Random

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tgl_soar.link.clock import (
    MICROSECONDS_WRAP_S,
    MILLISECONDS_WRAP_S,
    StampedStreams,
)
from tgl_soar.link.sensor_clock import QUANTUM_S, SensorClock


def stamped(
    period_s: float, seconds: float, *, seed: int, jitter_s: float = 0.0, loss: float = 0.0
) -> list[tuple[float, float]]:
    """(when it was taken, its stamp) of an even sensor; the phase is random."""
    random = Random(seed)
    first_s = random.uniform(10.0, 11.0)
    samples = []
    for k in range(round(seconds / period_s)):
        true_s = first_s + k * period_s + random.gauss(0.0, jitter_s)
        if random.random() >= loss:
            samples.append((true_s, floor(true_s * 1e3) * 1e-3))
    return samples


def error_rms(samples: list[tuple[float, float]], clock: SensorClock, after_s: float) -> float:
    """Of the recovered times, those later than `after_s` from the first."""
    errors = []
    for true_s, stamp_s in samples:
        recovered_s = clock.recover(stamp_s)
        if true_s > samples[0][0] + after_s:
            errors.append(recovered_s - true_s)
    return sqrt(sum(e * e for e in errors) / len(errors))


@settings(max_examples=60, deadline=None)
@given(st.floats(0.0022, 0.0105), st.integers(0, 2**32))
@example(period_s=0.01000057429260724, seed=744)
def test_any_period_is_recovered_within_a_tenth_of_a_millisecond(
    period_s: float, seed: int
) -> None:
    """Where a few periods are nearly a whole number of milliseconds, the stamps look the same for
    longer than the filter's window: there it errs by no more than a stamp can, a whole quantum.

    It was 0.51 of one, the worst of stamps that are all alike; where one step of them is another
    (10.0006 ms, seed 744), the line begins with the wrong end of the millisecond: 0.67.
    """
    near = min(abs(period_s * 1e3 * m - round(period_s * 1e3 * m)) / m for m in range(1, 7))
    samples = stamped(period_s, 4.0, seed=seed)
    error_s = error_rms(samples, SensorClock(), 1.0)
    assert error_s < (0.1e-3 if near > 0.01 else QUANTUM_S)


@pytest.mark.parametrize("seed", range(20))
def test_the_scheduler_s_jitter_and_one_frame_in_five_lost(seed: int) -> None:
    period_s = Random(seed).uniform(0.0045, 0.0049)
    samples = stamped(period_s, 4.0, seed=seed, jitter_s=50e-6, loss=0.2)
    assert error_rms(samples, SensorClock(), 1.0) < 0.1e-3


def test_the_steps_of_a_200_hz_stream_are_even() -> None:
    """4.95 ms: the stamps' own steps are 4 or 5 ms."""
    clock = SensorClock()
    times = [clock.recover(stamp_s) for _, stamp_s in stamped(0.00495, 5.0, seed=3)][300:]
    steps = [b - a for a, b in itertools.pairwise(times)]
    assert max(abs(step - 0.00495) for step in steps) < 0.02e-3
    assert clock.period_s == pytest.approx(0.00495, abs=2e-6)


def test_another_rate_and_a_pause_begin_a_new_line() -> None:
    clock = SensorClock()
    fast, slow = stamped(0.0047, 3.0, seed=1), stamped(0.0113, 6.0, seed=2)
    for _, stamp_s in fast:
        clock.recover(stamp_s)
    later = [(true_s + 10.0, stamp_s + 10.0) for true_s, stamp_s in slow]
    assert error_rms(later, clock, 1.0) < 0.1e-3
    soon = [(true_s - 2.5, stamp_s - 2.5) for true_s, stamp_s in stamped(0.0061, 4.0, seed=5)]
    shift = later[-1][1] + 0.02 - soon[0][1]
    whole = floor(shift * 1e3) * 1e-3
    assert error_rms([(t + whole, s + whole) for t, s in soon], clock, 1.0) < 0.1e-3


def test_one_frame_that_was_stamped_late_moves_no_line() -> None:
    samples, clock = stamped(0.0047, 2.0, seed=3), SensorClock()
    for _, stamp_s in samples[:-3]:
        clock.recover(stamp_s)
    period_s = clock.period_s
    clock.recover(samples[-3][1] + 0.002)
    assert clock.period_s == period_s
    clock.recover(samples[-2][1])  # not earlier than the late one
    true_s, stamp_s = samples[-1]
    assert clock.recover(stamp_s) == pytest.approx(true_s, abs=0.15e-3)


def test_three_in_a_row_do() -> None:
    samples, clock = stamped(0.0047, 2.0, seed=3), SensorClock()
    for _, stamp_s in samples[:-3]:
        clock.recover(stamp_s)
    for _, stamp_s in samples[-3:]:
        assert clock.period_s > 0.0
        clock.recover(stamp_s + 0.002)
    assert clock.period_s == 0.0


@given(st.lists(st.integers(1, 400), min_size=1, max_size=200), st.integers(0, 2**32))
def test_whatever_comes_times_grow_and_lie_in_their_millisecond(
    steps_ms: list[int], first_ms: int
) -> None:
    clock, stamp_ms, before_s = SensorClock(), first_ms, -inf
    for step_ms in steps_ms:
        stamp_ms += step_ms
        time_s = clock.recover(stamp_ms * 1e-3)
        assert time_s > before_s
        assert -1e-9 <= time_s - stamp_ms * 1e-3 <= QUANTUM_S + 3e-6
        before_s = time_s


# --- the ends of the counters -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("wrap_s", "unit_s", "quantised"),
    [(MILLISECONDS_WRAP_S, 1e-3, True), (MICROSECONDS_WRAP_S, 1e-6, False)],
)
def test_a_counter_that_begins_again_is_no_reboot(
    wrap_s: float, unit_s: float, quantised: bool
) -> None:
    streams = StampedStreams(lockstep=False)
    times = []
    for i in range(2000):
        true_s = wrap_s - 5.0 + i * 0.005
        stamp_s = floor(true_s / unit_s + 1e-3) % 2**32 * unit_s
        now_s = 100.0 + i * 0.005
        placed = streams.time_of("a", stamp_s, now_s, wrap_s=wrap_s, quantised=quantised)
        assert placed is not None
        times.append(placed[0] - now_s)
    assert streams.reboots == 0
    assert max(times) - min(times) < 1e-3


def test_a_late_frame_of_before_the_wrap_is_stale() -> None:
    streams = StampedStreams(lockstep=False)
    for stamp_s in (MILLISECONDS_WRAP_S - 0.02, MILLISECONDS_WRAP_S - 0.01, 0.001, 0.006):
        assert streams.time_of("a", stamp_s, 1.0) is not None
    assert streams.time_of("a", MILLISECONDS_WRAP_S - 0.005, 1.0) is None
    placed = streams.time_of("a", 0.011, 1.01)
    assert placed is not None
    assert streams.reboots == 0


def test_a_stamp_of_no_clock_is_passed_over() -> None:
    """Of a damaged or hostile frame: the next true one is neither stale nor a reboot."""
    streams = StampedStreams(lockstep=False)
    assert streams.time_of("a", 5.0, 1.0, wrap_s=inf) == (1.0, 5.0)
    for stamp_s in ((2**64 - 1) * 1e-6, 2**63 * 1e-6, 2e10):
        assert streams.time_of("a", stamp_s, 1.001, wrap_s=inf) is None
    assert streams.time_of("a", 5.005, 1.005, wrap_s=inf) is not None
    assert streams.reboots == 0


def test_a_reboot_of_a_month_old_autopilot_is_a_reboot() -> None:
    streams = StampedStreams(lockstep=False)
    for i in range(10):
        streams.time_of("a", 30 * 86400.0 + i * 0.005, i * 0.005)
        streams.time_of("b", 30 * 86400.0 + i * 0.005, i * 0.005, wrap_s=inf)
    for i in range(5):
        streams.time_of("a", 1.0 + i * 0.005, 3.0 + i * 0.005)
    assert streams.reboots == 1
    assert streams.time_of("b", 1.030, 3.030, wrap_s=inf) is not None
    assert streams.reboots == 1


def test_a_foreign_clock_neither_shares_nor_reboots_the_autopilot_s() -> None:
    streams = StampedStreams(lockstep=False)
    for i in range(100):
        streams.time_of("a", 50.0 + i * 0.01, 100.0 + i * 0.01 + 0.02)
        placed = streams.time_of("v", 50.1 + i * 0.01, 100.0 + i * 0.01, foreign=True)
        assert placed is not None
        assert placed[0] == pytest.approx(100.0 + i * 0.01, abs=1e-4)
    own = streams.time_of("a", 51.0, 101.02)
    assert own is not None
    assert own[0] == pytest.approx(101.02, abs=1e-3)
    for i in range(5):
        streams.time_of("v", 1.0 + i * 0.01, 102.0, foreign=True)
    assert streams.reboots == 0
