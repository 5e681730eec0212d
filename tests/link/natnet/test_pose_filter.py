"""Which poses of a rigid body become fixes: each limit from both sides."""

from __future__ import annotations

from math import inf, nan
from typing import Any

import pytest

from tgl_soar.geometry import HallFrame
from tgl_soar.link.messages import SEVERITY_WARNING
from tgl_soar.link.natnet.diagnostics import OptitrackCounters, OptitrackLedger, OutageNotices
from tgl_soar.link.natnet.layout import RigidBody
from tgl_soar.link.natnet.pose_filter import PoseFilter
from tgl_soar.link.natnet.settings import OptitrackSettings

SETTINGS = OptitrackSettings(
    server="",
    body="glider",
    unicast=True,
    hall=HallFrame(
        z_up=True, yaw_rad=0.0, origin_north_m=0.0, origin_east_m=0.0, origin_down_m=0.0
    ),
    noise_m=0.001,
    max_error_m=0.02,
    max_speed_mps=10.0,
    max_age_s=0.3,
    max_rate_hz=100.0,
)


def ledger() -> OptitrackLedger:
    return OptitrackLedger(OptitrackCounters(), OutageNotices())


def body(x: float = 0.0, y: float = 0.0, z: float = 0.0, **changes: Any) -> RigidBody:
    plain = RigidBody(
        id=7, x_m=x, y_m=y, z_m=z, qx=0.0, qy=0.0, qz=0.0, qw=1.0, error_m=0.0004, flags=1
    )
    return plain._replace(**changes)


def filter_of(**changes: Any) -> tuple[PoseFilter, OptitrackLedger]:
    kept = ledger()
    return PoseFilter(SETTINGS._replace(**changes), kept), kept


@pytest.mark.parametrize(("error_m", "sigma_m"), [(0.0004, 0.001), (0.019, 0.019), (0.021, None)])
def test_the_markers_error_is_a_fix_s_uncertainty_up_to_a_limit(
    error_m: float, sigma_m: float | None
) -> None:
    poses, kept = filter_of()
    fix = poses.fix_of(body(error_m=error_m), 5.0, 5.02)
    assert (fix.sigma_m if fix else None) == sigma_m
    assert kept.counters.poor == int(fix is None)
    if fix is None:
        assert kept.notices.texts == [
            (SEVERITY_WARNING, "OptiTrack: mean marker error 21 mm: not used")
        ]


@pytest.mark.parametrize(("after_s", "used"), [(0.0074, False), (0.0076, True)])
def test_a_pose_that_is_early_by_a_quarter_of_the_interval_is_not_thinned(
    after_s: float, used: bool
) -> None:
    poses, kept = filter_of()
    poses.fix_of(body(), 5.0, 5.02)
    fix = poses.fix_of(body(0.01), 5.0 + after_s, 5.02)
    assert (fix is not None) == used
    assert (kept.counters.thinned, kept.counters.fixes) == ((0, 2) if used else (1, 1))
    poses.reset()
    assert poses.fix_of(body(0.02), 5.0 + after_s, 5.03) is not None


@pytest.mark.parametrize("field", ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw", "error_m"])
@pytest.mark.parametrize("value", [nan, inf])
def test_a_pose_of_no_numbers_is_none(field: str, value: float) -> None:
    poses, kept = filter_of()
    changes: dict[str, Any] = {field: value}
    assert poses.fix_of(body(**changes), 5.0, 5.0) is None
    assert kept.counters.not_finite == 1
    assert poses.pose is None


@pytest.mark.parametrize(("flags", "tracked"), [(1, True), (3, True), (2, False), (0, False)])
def test_a_pose_that_the_server_does_not_vouch_for_is_not_used(flags: int, tracked: bool) -> None:
    poses, kept = filter_of()
    assert (poses.fix_of(body(flags=flags), 5.0, 5.0) is not None) == tracked
    assert kept.counters.untracked == int(not tracked)


def test_what_a_track_finds_is_counted_and_reported() -> None:
    poses, kept = filter_of()
    poses.fix_of(body(), 5.0, 5.02)
    assert poses.latency_s == pytest.approx(0.02)
    assert poses.pose == body()
    assert poses.fix_of(body(), 5.01, 5.02) is None
    assert poses.fix_of(body(3.0), 5.02, 5.03) is None
    assert poses.fix_of(body(3.001), 5.03, 5.04) is None
    counters = kept.counters
    assert (counters.frozen, counters.jumps, counters.settling) == (1, 1, 1)
    assert [text for _, text in kept.notices.texts] == [
        "OptiTrack: the pose of 'glider' is frozen: bit for bit the last one",
        "OptiTrack: 'glider' has jumped by 3.00 m: not used until it holds",
    ]
    assert poses.pose == body()
