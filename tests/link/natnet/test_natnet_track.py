"""Where a rigid body may have come to, and what is frozen: each limit from both sides."""

from __future__ import annotations

from typing import Any

import pytest

from tgl_soar.link.natnet import track
from tgl_soar.link.natnet.layout import RigidBody
from tgl_soar.link.natnet.track import PoseTrack

AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.0, -0.8))


def body(x: float = 0.0, y: float = 0.0, z: float = 0.0, **changes: Any) -> RigidBody:
    plain = RigidBody(
        id=7, x_m=x, y_m=y, z_m=z, qx=0.0, qy=0.0, qz=0.0, qw=1.0, error_m=0.0004, flags=1
    )
    return plain._replace(**changes)


@pytest.mark.parametrize("axis", AXES)
def test_a_pose_may_be_5_cm_and_a_flight_away_from_the_last(axis: tuple[float, ...]) -> None:
    for size, verdict in ((0.349, track.GOOD), (0.351, track.JUMPED)):
        for sign in (-1.0, 1.0):
            poses = PoseTrack(10.0)
            assert poses.judge(body(1.0, 2.0, 3.0), 5.0) == track.GOOD
            x, y, z = (sign * size * part for part in axis)
            assert poses.judge(body(1.0 + x, 2.0 + y, 3.0 + z), 5.03) == verdict
            if verdict == track.JUMPED:
                assert poses.jump_m == pytest.approx(size)


def test_a_new_place_is_taken_once_it_has_held_for_a_second() -> None:
    poses = PoseTrack(10.0)
    poses.judge(body(), 5.0)
    assert poses.judge(body(9.0), 5.01) == track.JUMPED
    for i in range(1, 100):
        assert poses.judge(body(9.0 + 1e-4 * (i % 3)), 5.01 + 0.01 * i) == track.SETTLING
    assert poses.judge(body(9.01), 6.011) == track.GOOD
    assert poses.judge(body(9.02), 6.02) == track.GOOD


@pytest.mark.parametrize(("away_m", "back"), [(0.34, True), (0.36, False)])
@pytest.mark.parametrize("after_s", [0.03, 0.5])
def test_back_near_the_last_good_place_it_is_good_at_once(
    away_m: float, back: bool, after_s: float
) -> None:
    """As far as a flight leads since then, but no farther than one of 0.2 s."""
    away_m += 10.0 * (min(0.2, after_s) - 0.03)
    poses = PoseTrack(10.0)
    poses.judge(body(), 5.0)
    poses.judge(body(30.0), 5.01)
    found = poses.judge(body(away_m), 5.0 + after_s)
    assert found == (track.GOOD if back else track.JUMPED)
    if not back:  # it has to hold from here on
        assert poses.judge(body(away_m + 0.001), 5.9 + after_s) == track.SETTLING
        assert poses.judge(body(away_m + 0.002), 6.01 + after_s) == track.GOOD


@pytest.mark.parametrize("field", ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"])
def test_bit_for_bit_the_last_pose_is_frozen(field: str) -> None:
    poses = PoseTrack(10.0)
    first = body(1.0, 2.0, 3.0)
    poses.judge(first, 5.0)
    assert poses.judge(first._replace(error_m=0.1, flags=3), 5.01) == track.FROZEN
    moved: dict[str, Any] = {field: getattr(first, field) + 1e-6}
    assert poses.judge(first._replace(**moved), 5.02) == track.GOOD


def test_reset_it_begins_with_the_next_pose() -> None:
    poses = PoseTrack(10.0)
    poses.judge(body(), 5.0)
    poses.judge(body(30.0), 5.01)
    poses.reset()
    assert poses.judge(body(60.0), 5.02) == track.GOOD
    assert poses.judge(body(60.001), 5.03) == track.GOOD


def test_the_four_verdicts_are_told_apart_and_good_is_none_of_the_others() -> None:
    """A counter is chosen by them, and only a good pose is used."""
    poses = PoseTrack(10.0)
    found = [
        poses.judge(body(x), time_s)
        for x, time_s in ((0.0, 5.0), (0.0, 5.01), (9.0, 5.02), (9.001, 5.03))
    ]
    assert found == [track.GOOD, track.FROZEN, track.JUMPED, track.SETTLING]
    assert len(set(found)) == 4
