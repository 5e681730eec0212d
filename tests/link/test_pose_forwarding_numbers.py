"""When a pose is due, what makes one stale, and each number that goes out with it."""

from __future__ import annotations

from math import cos, isnan, nan, pi, sin
from typing import Any

import pytest

from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.link.messages import Odometry, VisionPositionEstimate
from tgl_soar.link.pose_forwarding import (
    ODOMETRY,
    VISION_POSITION_ESTIMATE,
    PoseForwarding,
    normalised,
)
from tgl_soar.link.sources import MOCAP, VISION
from tgl_soar.types import NO_FIX, PositionFix

pytestmark = pytest.mark.interpreted  # it stands in for parts of what flies

LEVEL = (1.0, 0.0, 0.0, 0.0)
DIAGONAL = (0, 6, 11, 15, 18, 20)  # of an upper triangle of 6 x 6, row by row


class Tracked:
    """What is flown with."""

    def __init__(self) -> None:
        self.chosen = MOCAP
        self.attitude: Any = LEVEL
        self.position: PositionFix = NO_FIX

    def fix(self, time_s: float, sequence: int | None = None, **fields: float) -> Any:
        number = self.position.sequence + 1 if sequence is None else sequence
        place: Any = {"north_m": 1.0, "east_m": 2.0, "down_m": -3.0, **fields}
        self.position = NO_FIX._replace(sequence=number, time_s=time_s, **place)
        return self


def new() -> Any:
    """As `poll` takes it: chosen, position and attitude are all that it looks at."""
    return Tracked()


def forwarding(message: str = VISION_POSITION_ESTIMATE, **options: Any) -> PoseForwarding:
    return PoseForwarding(message, 40.0, **options)


# --- when -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("age_s", "is_sent"), [(0.0, True), (0.099, True), (0.101, False), (-0.001, False)]
)
def test_a_pose_of_a_tenth_of_a_second_ago_is_none_any_more(age_s: float, is_sent: bool) -> None:
    forward = forwarding()
    assert (forward.poll(Tracked().fix(50.0), 50.0 + age_s) is not None) is is_sent
    assert forward.sent == is_sent


@pytest.mark.parametrize(("after_s", "is_sent"), [(0.018, False), (0.019, True), (0.025, True)])
def test_the_next_is_due_after_an_interval_or_a_quarter_of_one_before(
    after_s: float, is_sent: bool
) -> None:
    """Of 25 ms."""
    forward, tracked = forwarding(), new()
    assert forward.poll(tracked.fix(50.0), 50.0)
    assert (forward.poll(tracked.fix(50.0 + after_s), 50.0 + after_s) is not None) is is_sent


def times(forward: PoseForwarding, *at_s: float) -> list[float]:
    tracked = new()
    return [each for each in at_s if forward.poll(tracked.fix(50.0 + each), 50.0 + each)]


def test_they_go_out_on_the_grid_of_the_first_and_after_a_pause_on_another() -> None:
    assert times(forwarding(), 0.0, 0.02, 0.04, 0.05, 0.06, 0.07) == [0.0, 0.02, 0.05, 0.07]
    # More than an interval late: from there on.
    assert times(forwarding(), 0.0, 0.051, 0.069, 0.071) == [0.0, 0.051, 0.071]
    # Less than that: on the grid of before, 0.025 and then 0.05.
    assert times(forwarding(), 0.0, 0.049, 0.05) == [0.0, 0.049, 0.05]


def test_no_pose_goes_out_twice_and_another_clock_begins_again() -> None:
    forward, tracked = forwarding(), new()
    assert forward.poll(tracked.fix(50.0), 50.0)
    assert forward.poll(tracked, 50.03) is None
    assert forward.poll(tracked.fix(5.0), 5.0) is None
    forward.rebase()
    assert forward.poll(tracked.fix(5.0), 5.0)
    assert forward.sent == 2


@pytest.mark.parametrize("source", [0, 1, 2, 3, VISION])
def test_only_what_the_autopilot_does_not_know_is_reported(source: int) -> None:
    forward, tracked = forwarding(), new()
    tracked.chosen = source
    assert (forward.poll(tracked.fix(50.0), 50.0) is not None) is (source == VISION)
    forward.known.add(VISION)
    assert forward.poll(tracked.fix(51.0), 51.0) is None


# --- what -----------------------------------------------------------------------------------------


def sent(forward: PoseForwarding, tracked: Any, now_s: float = 50.0) -> Any:
    message = forward.poll(tracked, now_s)
    assert message is not None
    return message


def test_an_estimate_has_place_angles_and_time() -> None:
    tracked = Tracked().fix(50.0)
    tracked.attitude = quaternion_from_euler(0.1, -0.2, 0.3)
    message = sent(forwarding(), tracked)
    assert isinstance(message, VisionPositionEstimate)
    assert message.usec == 50_000_000
    assert (message.x, message.y, message.z) == (1.0, 2.0, -3.0)
    assert (message.roll, message.pitch, message.yaw) == pytest.approx((0.1, -0.2, 0.3))


def test_a_time_of_zero_would_be_none() -> None:
    assert sent(forwarding(), Tracked().fix(0.0), 0.0).usec == 1


def test_odometry_turns_the_velocity_into_body_axes() -> None:
    """With the nose to the east and 0.2 rad up; flown to the east at 10 m/s."""
    tracked = Tracked().fix(
        50.0, velocity_north_mps=0.0, velocity_east_mps=10.0, velocity_down_mps=0.0
    )
    tracked.attitude = quaternion_from_euler(0.0, 0.2, 0.5 * pi)
    message = sent(forwarding(ODOMETRY), tracked)
    assert isinstance(message, Odometry)
    speeds = (message.vx, message.vy, message.vz)
    assert speeds == pytest.approx((10.0 * cos(0.2), 0.0, 10.0 * sin(0.2)))
    assert message.q == pytest.approx(tracked.attitude)
    assert (message.time_usec, message.x, message.y, message.z) == (50_000_000, 1.0, 2.0, -3.0)
    assert (message.frame_id, message.child_frame_id, message.estimator_type) == (20, 12, 2)
    assert all(map(isnan, (message.rollspeed, message.pitchspeed, message.yawspeed)))
    assert isnan(message.velocity_covariance[0])


@pytest.mark.parametrize(
    ("reported_m", "given_m", "sigma_m"),
    [(0.1, 0.5, 0.1), (0.0, 0.5, 0.5), (-1.0, 0.5, 0.5), (nan, 0.5, 0.5), (0.1, nan, 0.1)],
)
def test_a_variance_is_the_source_s_own_or_the_one_that_is_given(
    reported_m: float, given_m: float, sigma_m: float
) -> None:
    forward = forwarding(sigma_m=given_m, sigma_rad=0.05)
    covariance = sent(forward, Tracked().fix(50.0, sigma_m=reported_m)).covariance
    assert len(covariance) == 21
    assert [covariance[i] for i in DIAGONAL] == pytest.approx([sigma_m**2] * 3 + [0.05**2] * 3)
    assert all(covariance[i] == 0.0 for i in range(21) if i not in DIAGONAL)


def test_where_none_is_known_the_first_place_says_so() -> None:
    covariance = sent(forwarding(), Tracked().fix(50.0, sigma_m=nan)).covariance
    assert isnan(covariance[0])
    assert not any(map(isnan, covariance[1:]))
    usual = sent(forwarding(sigma_m=0.5), Tracked().fix(50.0, sigma_m=nan)).covariance
    assert usual[15] == pytest.approx(0.02**2)  # of angles, unless another is given


# --- attitudes ------------------------------------------------------------------------------------


def test_without_an_attitude_it_is_reported_once_and_asked_again() -> None:
    forward, tracked = forwarding(), new()
    tracked.attitude = None
    for i in range(3):
        assert forward.poll(tracked.fix(50.0 + 0.1 * i), 50.0 + 0.1 * i) is None
    ((severity, words),) = forward.notices
    assert severity == 4  # MAV_SEVERITY_WARNING
    assert words.endswith("is not forwarded: it has no attitude")
    tracked.attitude = LEVEL
    assert forward.poll(tracked, 50.2)  # the same fix, as soon as there is one


@pytest.mark.parametrize(
    ("norm", "is_rotation"), [(0.981, True), (1.019, True), (0.979, False), (1.021, False)]
)
def test_what_is_nearly_a_unit_is_made_one(norm: float, is_rotation: bool) -> None:
    found = normalised((0.5 * norm, -0.5 * norm, 0.5 * norm, -0.5 * norm))
    assert (found is not None) is is_rotation
    if found is not None:
        assert found == pytest.approx((0.5, -0.5, 0.5, -0.5), rel=1e-12)


@pytest.mark.parametrize("place", range(4))
def test_what_is_no_number_is_no_rotation(place: int) -> None:
    parts = [0.5, 0.5, 0.5, 0.5]
    parts[place] = nan
    assert normalised((parts[0], parts[1], parts[2], parts[3])) is None
    assert normalised(None) is None
