"""What the OptiTrack client counts and says of an outage: in words, and not too often."""

from __future__ import annotations

from dataclasses import fields

import pytest

from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.link.natnet.diagnostics import OptitrackCounters, OutageNotices


@pytest.mark.parametrize(("after_s", "again"), [(9.9, False), (10.1, True)])
@pytest.mark.parametrize("used", [False, True])
def test_a_kind_is_reported_again_after_poses_and_ten_seconds(
    after_s: float, again: bool, used: bool
) -> None:
    notices = OutageNotices()
    notices.now_s = 100.0
    notices.report("silent", SEVERITY_WARNING, "silent")
    notices.report("silent", SEVERITY_WARNING, "silent")
    if used:
        notices.now_s = 101.0
        notices.pose_used(101.0)
    notices.texts.clear()
    notices.now_s = 100.0 + after_s
    notices.report("silent", SEVERITY_WARNING, "silent")
    assert len(notices.texts) == int(again and used)
    notices.rebase()
    notices.report("silent", SEVERITY_WARNING, "silent")
    assert notices.texts[-1] == (SEVERITY_WARNING, "OptiTrack: silent")


@pytest.mark.parametrize("kind", ["body", "version", "malformed", "truncated", "oversized"])
def test_what_happens_again_an_hour_later_is_reported_again(kind: str) -> None:
    notices = OutageNotices()
    for now_s, count in ((0.0, 1), (1.0, 1), (3600.0, 2), (3605.0, 2)):
        notices.now_s = now_s
        notices.report(kind, SEVERITY_WARNING, "out")
        notices.now_s = now_s + 0.01
        notices.pose_used(now_s + 0.01)
        assert sum(text == "OptiTrack: out" for _, text in notices.texts) == count


def test_single_datagrams_without_a_pose_between_them_are_reported_once() -> None:
    notices = OutageNotices()
    for now_s in (0.0, 20.0, 40.0):
        notices.now_s = now_s
        notices.report("malformed", SEVERITY_WARNING, "out")
    assert len(notices.texts) == 1


def test_the_end_of_an_outage_is_reported_with_its_length() -> None:
    notices = OutageNotices()
    notices.report("order", SEVERITY_INFO, "no outage")
    notices.pose_used(0.0)
    assert len(notices.texts) == 1
    for kind in ("stale", "poor", "jump", "frozen", "finite", "untracked", "absent", "odd"):
        notices = OutageNotices()
        notices.report(kind, SEVERITY_WARNING, "out")
        notices.now_s = 5.0
        notices.pose_used(5.0)
        assert notices.texts[-1] == (SEVERITY_INFO, "OptiTrack: stream is there")
        notices.now_s = 20.0
        notices.report("silent", SEVERITY_WARNING, "out")
        notices.report("nobody", SEVERITY_WARNING, "out")
        notices.now_s = 27.34
        notices.pose_used(27.34)
        notices.pose_used(27.4)
        assert notices.texts[-1] == (SEVERITY_INFO, "OptiTrack: stream is back after 22.3 s")


def test_what_is_counted_is_reported_in_words() -> None:
    counters = OptitrackCounters(frames=3, out_of_order=2)
    assert counters.summary() == "3 frames, 2 out of order"
    assert OptitrackCounters().summary() == ""


@pytest.mark.parametrize("name", [field.name for field in fields(OptitrackCounters)])
def test_everything_is_counted_from_zero_and_said_by_its_name(name: str) -> None:
    assert getattr(OptitrackCounters(), name) == 0
    counted = OptitrackCounters(**{name: 2})
    assert counted.summary() == f"2 {name.replace('_', ' ')}"


@pytest.mark.parametrize(
    ("kind", "is_outage"),
    [
        *((kind, True) for kind in ("silent", "nobody", "frameless", "odd", "stale", "absent")),
        *((kind, True) for kind in ("untracked", "finite", "frozen", "jump", "poor")),
        *((kind, True) for kind in ("version", "body")),
        *((kind, False) for kind in ("mode", "restart", "malformed", "truncated", "oversized")),
    ],
)
def test_that_poses_are_back_is_reported_after_what_kept_them_away(
    kind: str, is_outage: bool
) -> None:
    notices = OutageNotices()
    notices.now_s = 1.0
    notices.pose_used(1.0)
    notices.now_s = 2.0
    notices.report(kind, SEVERITY_WARNING, "out")
    notices.now_s = 4.5
    notices.pose_used(4.5)
    back = [(SEVERITY_INFO, "OptiTrack: stream is back after 3.5 s")]
    assert notices.texts[1:] == (back if is_outage else [])


def test_each_kind_is_reported_for_itself_and_what_happens_once_is_always_reported() -> None:
    notices = OutageNotices()
    notices.report("silent", SEVERITY_WARNING, "one")
    notices.report("jump", SEVERITY_WARNING, "two")
    notices.add(SEVERITY_INFO, "three")
    notices.add(SEVERITY_INFO, "three")
    words = ["one", "two", "three", "three"]
    assert [text for _, text in notices.texts] == [f"OptiTrack: {word}" for word in words]


def test_with_another_clock_nothing_is_known_of_when_poses_were_used() -> None:
    notices = OutageNotices()
    notices.now_s = 1000.0
    notices.pose_used(1000.0)
    notices.report("silent", SEVERITY_WARNING, "silent")
    notices.rebase()
    notices.now_s = 1.0
    notices.pose_used(1.0)
    assert notices.texts[-1] == (SEVERITY_INFO, "OptiTrack: stream is there")
