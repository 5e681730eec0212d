"""How much of the wire is written down: each kind has its own room, which fills as time goes by."""

from __future__ import annotations

import pytest

from tgl_soar.onboard.flightlog.allowance import Allowance, WireAllowance

KINDS = ("ours", "autopilot", "stations", "refused")
SECOND_US = 1_000_000


def taken_bytes(room: Allowance, time_us: int, size: int = 10) -> int:
    """All that finds room at a time."""
    before = room.taken
    while room.takes(size, time_us):
        pass
    return (room.taken - before) * size


@pytest.mark.parametrize(
    ("kind", "bytes_per_s"),
    [("ours", 60_000), ("autopilot", 100_000), ("stations", 20_000), ("refused", 1_000)],
)
def test_each_kind_has_ten_seconds_of_its_rate_at_once_and_earns_it_again(
    kind: str, bytes_per_s: int
) -> None:
    room = getattr(WireAllowance(10**12), kind)
    assert taken_bytes(room, 0) == 10 * bytes_per_s
    assert taken_bytes(room, SECOND_US) == bytes_per_s
    assert taken_bytes(room, SECOND_US + SECOND_US // 2) == bytes_per_s // 2
    assert taken_bytes(room, 20 * SECOND_US) == 10 * bytes_per_s  # no more than that is saved up


def test_what_one_kind_takes_costs_the_others_nothing() -> None:
    wire = WireAllowance(10**12)
    for kind in KINDS:
        assert taken_bytes(getattr(wire, kind), 0) > 0
    assert wire.left_out == len(KINDS)  # one each: that which found no room


@pytest.mark.parametrize("bytes_per_s", [37, 60_000])
def test_over_an_hour_each_byte_is_earned_once(bytes_per_s: int) -> None:
    """However time goes by: against what was earned in all, to a frame."""
    room, size = Allowance(bytes_per_s), 11
    times_us = [(i * 7919) % 9_000 + i * 400_000 for i in range(9_000)]
    found = sum(room.takes(size, time_us) for time_us in times_us for _ in range(3))
    earned = bytes_per_s * (10.0 + times_us[-1] / SECOND_US)
    offered = 3.0 * size * len(times_us)
    assert found * size == pytest.approx(min(earned, offered), abs=size)
    assert room.taken == found
    assert room.left_out == 3 * len(times_us) - found


def test_a_clock_that_goes_back_earns_nothing_and_counts_on_from_there() -> None:
    room = Allowance(100)
    assert taken_bytes(room, 50 * SECOND_US) == 1000
    assert taken_bytes(room, 10 * SECOND_US) == 0
    assert taken_bytes(room, 12 * SECOND_US) == 200


def test_what_may_be_taken_in_all_is_taken_to_the_last_byte() -> None:
    room = Allowance(10**6, most_bytes=25)
    assert [room.takes(10, 0) for _ in range(3)] == [True, True, False]
    assert room.takes(5, 0)
    assert not room.takes(1, 9 * SECOND_US)
    assert (room.taken, room.left_out) == (3, 2)
    assert not Allowance(10**6, most_bytes=0).takes(1, 0)
    assert Allowance(10**6).takes(10**6, 0)


def test_refused_frames_take_a_hundredth_of_all_logs_and_the_others_have_no_end() -> None:
    wire = WireAllowance(50_000)
    assert taken_bytes(wire.refused, 0) == 500
    assert taken_bytes(wire.refused, 9 * SECOND_US) == 0
    assert taken_bytes(wire.stations, 0) == 200_000
    assert taken_bytes(wire.stations, 10 * SECOND_US) == 200_000


def test_what_was_left_out_is_reported_of_all_and_of_strangers() -> None:
    wire = WireAllowance(50_000)
    for kind, frames in (("ours", 1), ("autopilot", 2), ("stations", 4), ("refused", 8)):
        for _ in range(frames):
            getattr(wire, kind).takes(10**9, 0)
    wire.refused.takes(10, 0)
    assert wire.left_out == 15
    assert wire.strangers == "8 of them refused or of strangers; of these 1 are"
    assert wire.summary == (
        "flight log: 15 frames of a flood are not in the .tlog, 8 of them refused or of strangers"
    )
