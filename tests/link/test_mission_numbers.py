"""Reading a mission: its largest size, how often and when it is asked for, what is reset."""

from __future__ import annotations

from itertools import pairwise

import pytest

from tgl_soar.link.messages import (
    CommandLong,
    HomeMessage,
    MissionAck,
    MissionCount,
    MissionCurrent,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    Outbound,
    Source,
)
from tgl_soar.link.mission import MissionReading, landings_of

LAND, LAND_START, WAYPOINT = 21, 189, 16  # MAV_CMD
TRIES, APART_S = 4, 0.8


def item(
    seq: int, command: int = WAYPOINT, x: int = 0, y: int = 0, system: int = 1
) -> MissionItemInt:
    return MissionItemInt(
        target_system=system, target_component=191, seq=seq, command=command, x=x, y=y
    )


@pytest.fixture
def reading() -> MissionReading:
    return MissionReading(Source(1, 191))


def asked_times(reading: MissionReading, from_s: float, kind: type[Outbound]) -> list[float]:
    """When it asks, of ten seconds, looked at sixteen times a second."""
    looks = [i / 16 for i in range(160)]
    requests = [
        any(isinstance(each, kind) for each in reading.poll(from_s + at_s)) for at_s in looks
    ]
    return [at_s for at_s, is_requested in zip(looks, requests, strict=True) if is_requested]


def test_before_it_is_asked_to_nothing_is_known_and_nothing_asked(reading: MissionReading) -> None:
    assert (reading.items, reading.is_known, reading.failed) == ([], False, "")
    assert (reading.current, reading.current_count) == (-1, 0)
    assert (reading.home, reading.restarts) == (None, 0)
    reading.take(MissionCount(1, 191, 0))  # that was not asked for
    assert reading.poll(0.0) == []
    reading.restart()
    assert reading.restarts == 1
    assert reading.poll(0.0) == []


def test_it_is_asked_for_four_times_eight_tenths_of_a_second_apart(reading: MissionReading) -> None:
    reading.begin()
    times = asked_times(reading, 100.0, MissionRequestList)
    assert times == pytest.approx([0.0, 0.8, 1.6, 2.4], abs=3 / 16)
    assert all(b - a >= APART_S for a, b in pairwise(times))
    assert reading.failed == "its mission cannot be read: no answer"


def test_each_item_has_four_tries_of_its_own(reading: MissionReading) -> None:
    reading.begin()
    assert len(asked_times(reading, 0.0, CommandLong)) == TRIES
    reading.begin()
    now_s = 100.0
    for _ in range(TRIES - 1):
        assert reading.poll(now_s)
        now_s += 1.0
    reading.take(MissionCount(1, 191, 2))
    for _ in range(TRIES - 1):
        assert reading.poll(now_s) == [MissionRequestInt(1, 1, 0)]
        now_s += 1.0
    reading.take(item(0))
    assert reading.poll(now_s) == [MissionRequestInt(1, 1, 1)]  # at once
    assert len(asked_times(reading, now_s, MissionRequestInt)) == TRIES - 1
    assert reading.failed


def test_a_mission_of_none_is_known_at_once(reading: MissionReading) -> None:
    reading.begin()
    reading.poll(0.0)
    reading.take(MissionCount(1, 191, 0))
    assert reading.poll(0.0) == [MissionAck(1, 1, 0)]
    assert reading.is_known
    assert reading.failed == ""


@pytest.mark.parametrize(("items", "is_read"), [(1000, True), (1001, False)])
def test_a_thousand_items_are_read(reading: MissionReading, items: int, is_read: bool) -> None:
    reading.begin()
    reading.poll(0.0)
    reading.take(MissionCount(1, 191, items))
    words = "" if is_read else "its mission has 1001 items, at most 1000 are read"
    assert reading.failed == words
    assert bool(reading.poll(0.0)) is is_read


def test_a_second_count_changes_nothing_and_an_item_before_the_first_is_none(
    reading: MissionReading,
) -> None:
    reading.begin()
    reading.poll(0.0)
    reading.take(item(0))
    assert reading.items == []
    reading.take(MissionCount(2, 191, 3))  # of another system
    reading.take(MissionCount(1, 191, 1))
    reading.take(MissionCount(1, 191, 5))
    reading.take(item(0, system=2))
    assert reading.items == []
    reading.take(item(0))
    assert reading.poll(0.0) == [MissionAck(1, 1, 0)]
    assert len(reading.items) == 1


def test_what_is_known_is_asked_for_again_after_a_restart_and_what_failed_too(
    reading: MissionReading,
) -> None:
    reading.begin()
    reading.poll(0.0)
    reading.take(MissionCount(1, 191, 1))
    reading.take(item(0))
    reading.take(MissionCurrent(4))
    reading.take(MissionCurrent(5))
    reading.take(HomeMessage(1, 2, 3))
    assert (reading.current, reading.current_count) == (5, 2)
    reading.poll(0.0)
    assert reading.is_known
    reading.restart()
    assert (reading.items, reading.is_known, reading.home, reading.current) == ([], False, None, -1)
    assert reading.restarts == 1
    assert len(asked_times(reading, 0.0, MissionRequestList)) == TRIES
    assert reading.failed
    reading.restart()
    assert reading.failed == ""
    assert len(reading.poll(10.0)) == 2
    assert reading.restarts == 2


def test_each_landing_ends_with_the_first_touch_down_behind_its_beginning() -> None:
    items = [
        item(0, LAND, x=1, y=1),
        item(1, LAND_START),
        item(2, LAND, x=450_000_000, y=70_000_000),
        item(3, LAND, x=2, y=2),
        item(4, LAND_START),
        item(5, LAND_START),
        item(6),
        item(7, LAND, x=-450_000_000, y=-70_000_000),
    ]
    found = landings_of(items)
    assert [(each.begins, each.touches) for each in found] == [(1, 2), (4, 7), (5, 7)]
    first, second, third = [(each.latitude_deg, each.longitude_deg) for each in found]
    assert first == pytest.approx((45.0, 7.0))
    assert second == third == pytest.approx((-45.0, -7.0))
