"""The times of frames and the echoes that give them: each limit from both sides."""

from __future__ import annotations

from math import isnan

import pytest

from tgl_soar.link.messages import SEVERITY_INFO
from tgl_soar.link.natnet.diagnostics import OptitrackCounters, OptitrackLedger, OutageNotices
from tgl_soar.link.natnet.frame_times import FrameTimes
from tgl_soar.link.natnet.layout import MocapFrame


def ledger() -> OptitrackLedger:
    return OptitrackLedger(OptitrackCounters(), OutageNotices())


def frame(exposed: int, sent: int) -> MocapFrame:
    return MocapFrame(
        number=1, body=None, bodies=0, timecode=0, timecode_sub=0, time_s=0.0,
        exposed_ticks=exposed, received_ticks=0, sent_ticks=sent,
        precision_s=0, precision_fraction=0, flags=0,
    )  # fmt: skip


def clocked(*, lockstep: bool = True) -> tuple[FrameTimes, OptitrackLedger]:
    kept = ledger()
    times = FrameTimes(kept, lockstep=lockstep)
    times.set_clock_rate(1000)
    return times, kept


@pytest.mark.parametrize(
    ("exposed", "sent", "time_s"),
    [
        (5000, 5020, 5.0),
        (5000, 5999, 5.0),
        (4000, 5001, None),  # more than a second later
        (5001, 5000, None),  # before it was exposed
        (5000, 5000, 5.0),
        (0, 5000, 5.0),  # the one stands for the other
        (5000, 0, 5.0),
    ],
)
def test_a_frame_is_sent_within_a_second_of_its_exposure(
    exposed: int, sent: int, time_s: float | None
) -> None:
    times, kept = clocked()
    assert times.time_of(frame(exposed, sent), 5.02) == time_s
    assert kept.counters.odd == int(time_s is None)
    untimed = [text for _, text in kept.notices.texts if "mid-exposure" in text]
    assert bool(untimed) == (exposed == 0)


@pytest.mark.parametrize(
    ("now_s", "used"), [(5.99, True), (6.01, False), (4.01, True), (3.99, False)]
)
def test_in_lockstep_a_clock_is_off_by_a_second_at_most(now_s: float, used: bool) -> None:
    times, kept = clocked()
    assert (times.time_of(frame(5000, 5000), now_s) is not None) == used
    assert kept.counters.odd == int(not used)
    assert times.uncertainty_s == 0.0


def test_frames_come_in_order_and_once() -> None:
    times, kept = clocked()
    assert [times.time_of(frame(n, n), 5.0) for n in (5000, 5000, 4990, 5001)] == [
        5.0, None, None, 5.001
    ]  # fmt: skip
    assert kept.counters.out_of_order == 2
    assert kept.notices.texts == [(SEVERITY_INFO, "OptiTrack: frames come out of order or twice")]
    times.reset()
    assert times.time_of(frame(4990, 4990), 5.0) == pytest.approx(4.99)


@pytest.mark.parametrize(("ago_s", "odd"), [(0.99, 0), (1.01, 1), (-0.01, 1)])
def test_an_echo_is_answered_within_a_second(ago_s: float, odd: int) -> None:
    times, kept = clocked(lockstep=False)
    times.on_echo(round((20.0 - ago_s) * 1e9), 5000, 20.0)
    assert kept.counters.odd == odd
    assert times.clock.is_known == (odd == 0)


def test_another_rate_is_another_clock_and_the_same_is_not() -> None:
    times, _ = clocked(lockstep=False)
    assert times.time_of(frame(5000, 5010), 20.01) == pytest.approx(20.0)
    times.set_clock_rate(1000)
    assert times.clock.is_known
    times.set_clock_rate(2000)
    assert not times.clock.is_known
    assert not times.has_restarted()
    times.clock.restarts = 2
    assert times.has_restarted()
    assert not times.has_restarted()
    assert isnan(times.clock.offset_s)


def test_frames_of_another_clock_are_numbered_by_it_from_the_first() -> None:
    """Its ticks may be smaller than those of the clock before: they are no older frames."""
    times, kept = clocked(lockstep=False)
    assert times.time_of(frame(900_000, 900_000), 20.0) == pytest.approx(20.0)
    found = [times.time_of(frame(5000 + 50 * i, 5000 + 50 * i), 20.1 + 0.05 * i) for i in range(5)]
    assert found[:2] == [None, None]
    assert found[3:] == pytest.approx([20.25, 20.3])
    assert kept.counters.out_of_order == 0
    assert times.has_restarted()
    # And of one clock they stay in order.
    assert times.time_of(frame(5100, 5100), 20.31) is None
    assert kept.counters.out_of_order == 1
