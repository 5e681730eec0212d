"""What the OptiTrack client counts and says of an outage: in words, and not too often."""

from __future__ import annotations

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


def test_the_end_of_an_outage_is_said_with_its_length() -> None:
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


def test_what_is_counted_is_said_in_words() -> None:
    counters = OptitrackCounters(frames=3, out_of_order=2)
    assert counters.summary() == "3 frames, 2 out of order"
    assert OptitrackCounters().summary() == ""
