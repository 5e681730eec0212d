"""Poses for the autopilot's filter, read by pymavlink and taken by the simulated Pixhawk."""

from __future__ import annotations

from math import cos, inf, isnan, nan, pi, radians, sin, sqrt
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.link.encoder import Encoder
from tgl_soar.link.messages import Odometry, Outbound, Source, VisionPositionEstimate
from tgl_soar.link.pose_forwarding import (
    ODOMETRY,
    STALE_S,
    VISION_POSITION_ESTIMATE,
    PoseForwarding,
    normalised,
)
from tgl_soar.link.sources import LOCAL_POSITION, MOCAP, VISION, PositionSources, Quaternion
from tgl_soar.sim.vehicle.external_pose import ExternalPose
from tgl_soar.types import PositionFix

EAST_NOSE_UP = quaternion_from_euler(0.1, 0.2, pi / 2)


def fix(time_s: float, *, sigma_m: float = nan, velocity: float = nan) -> PositionFix:
    return PositionFix(
        sequence=0,
        time_s=time_s,
        north_m=1.0,
        east_m=2.0,
        down_m=-3.0,
        velocity_north_mps=0.0,
        velocity_east_mps=velocity,
        velocity_down_mps=0.0,
        source=0,
        sigma_m=sigma_m,
    )


def parsed(message: Outbound) -> Any:
    (back,) = mavlink.MAVLink(None).parse_buffer(Encoder(Source(1, 191)).encode(message))
    return back


def forwarded(
    forwarding: PoseForwarding,
    seconds: float,
    *,
    source: int = MOCAP,
    rate_hz: float = 100.0,
    delay_s: float = 0.015,
    turned: Quaternion | None = EAST_NOSE_UP,
    sources: PositionSources | None = None,
) -> list[tuple[float, Outbound]]:
    """What goes out of a module that ticks at 200 Hz and a tracker of a rate and a delay."""
    sources = sources or PositionSources((source,))
    poses = []
    steps = round(200.0 / rate_hz)
    for i in range(round(seconds * 200.0)):
        now = 1.0 + i / 200.0
        if i % steps == 0:
            sources.take(source, fix(now - delay_s), now, turned)
        pose = forwarding.poll(sources, now)
        if pose is not None:
            poses.append((now, pose))
    return poses


@pytest.mark.parametrize(("rate_hz", "source_hz"), [(40.0, 100.0), (50.0, 100.0), (30.0, 40.0)])
def test_the_rate_is_what_was_asked_for_and_no_pose_goes_out_twice(
    rate_hz: float, source_hz: float
) -> None:
    poses = forwarded(PoseForwarding(ODOMETRY, rate_hz), 10.0, rate_hz=source_hz)
    assert len(poses) == pytest.approx(10.0 * rate_hz, rel=0.03)
    stamps = [pose.time_usec for _, pose in poses if isinstance(pose, Odometry)]
    assert len(set(stamps)) == len(stamps) == len(poses)


def test_a_slow_source_is_forwarded_as_it_comes() -> None:
    poses = forwarded(PoseForwarding(VISION_POSITION_ESTIMATE, 50.0), 10.0, rate_hz=20.0)
    assert len(poses) == 200


def test_it_stops_with_the_source() -> None:
    forwarding, sources = PoseForwarding(ODOMETRY, 50.0), PositionSources((MOCAP,))
    forwarded(forwarding, 1.0, sources=sources)
    sources.take(MOCAP, fix(1.999), 2.0, EAST_NOSE_UP)
    assert forwarding.poll(sources, 1.999 + STALE_S + 0.001) is None
    assert [forwarding.poll(sources, 3.0 + i * 0.005) for i in range(100)] == [None] * 100


def test_the_autopilot_s_own_position_never_goes_back_to_it() -> None:
    assert forwarded(PoseForwarding(ODOMETRY, 50.0), 2.0, source=LOCAL_POSITION) == []
    sources, forwarding = PositionSources((MOCAP, LOCAL_POSITION)), PoseForwarding(ODOMETRY, 50.0)
    forwarded(forwarding, 1.0, sources=sources)
    for i in range(200):  # the tracker falls silent, the fall-back takes over
        now = 2.0 + i * 0.005
        sources.take(LOCAL_POSITION, fix(now - 0.01), now)
        pose = forwarding.poll(sources, now)
        assert pose is None or now < 2.0 + STALE_S
    assert sources.chosen == LOCAL_POSITION


def test_a_bridge_that_the_autopilot_receives_itself_is_not_repeated() -> None:
    forwarding = PoseForwarding(ODOMETRY, 50.0)
    assert forwarded(forwarding, 1.0, source=VISION)
    forwarding.known.add(VISION)
    assert forwarded(forwarding, 1.0, source=VISION) == []


@pytest.mark.parametrize(
    "turned", [None, (nan, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0)]
)
def test_without_an_attitude_nothing_is_forwarded_and_that_is_reported_once(
    turned: Quaternion | None,
) -> None:
    forwarding = PoseForwarding(VISION_POSITION_ESTIMATE, 50.0)
    assert forwarded(forwarding, 1.0, turned=turned) == []
    assert [text for _, text in forwarding.notices] == [
        "mocap is not forwarded: it has no attitude"
    ]


def test_the_pose_as_pymavlink_reads_it() -> None:
    forwarding = PoseForwarding(VISION_POSITION_ESTIMATE, 50.0, sigma_rad=radians(2.0))
    sources = PositionSources((MOCAP,))
    sources.take(MOCAP, fix(7.25, sigma_m=0.01), 7.26, EAST_NOSE_UP)
    pose = forwarding.poll(sources, 7.265)
    assert pose is not None
    back = parsed(pose)
    assert back.get_type() == "VISION_POSITION_ESTIMATE"
    assert back.usec == 7_250_000
    assert (back.x, back.y, back.z) == (1.0, 2.0, -3.0)
    assert (back.roll, back.pitch, back.yaw) == pytest.approx((0.1, 0.2, pi / 2))
    diagonal = [back.covariance[i] for i in (0, 6, 11, 15, 18, 20)]
    assert diagonal == pytest.approx([1e-4] * 3 + [radians(2.0) ** 2] * 3)
    assert sum(back.covariance) == pytest.approx(sum(diagonal))


def test_odometry_has_the_velocity_in_body_axes_and_says_what_it_does_not_know() -> None:
    forwarding = PoseForwarding(ODOMETRY, 50.0)
    sources = PositionSources((MOCAP,))
    sources.take(MOCAP, fix(7.25, velocity=10.0), 7.26, quaternion_from_euler(0.0, 0.2, pi / 2))
    pose = forwarding.poll(sources, 7.265)
    assert pose is not None
    back = parsed(pose)
    assert (back.frame_id, back.child_frame_id) == (20, 12)  # LOCAL_FRD, BODY_FRD
    assert (back.vx, back.vy, back.vz) == pytest.approx((10 * cos(0.2), 0.0, 10 * sin(0.2)))
    assert isnan(back.rollspeed)
    assert isnan(back.pose_covariance[0])
    assert isnan(back.velocity_covariance[0])
    assert back.estimator_type == mavlink.MAV_ESTIMATOR_TYPE_VISION


parts = st.floats(-1.0, 1.0)


@given(st.tuples(parts, parts, parts, parts), st.floats(0.985, 1.015))
def test_quaternions_are_units_on_the_wire(raw: Quaternion, scale: float) -> None:
    """As EKF2 asks for: within 1e-5, in 32-bit floats; and the simulated Pixhawk as well."""
    norm = sqrt(sum(q * q for q in raw))
    if norm < 0.1:
        return
    turned = tuple(scale * q / norm for q in raw)
    forwarding, sources = PoseForwarding(ODOMETRY, 50.0), PositionSources((MOCAP,))
    sources.take(MOCAP, fix(1.0), 1.0, (turned[0], turned[1], turned[2], turned[3]))
    pose = forwarding.poll(sources, 1.0)
    assert isinstance(pose, Odometry)
    back = parsed(pose)
    assert abs(sqrt(sum(q * q for q in back.q)) - 1.0) < 1e-5
    external = ExternalPose()
    external.take(back, 0.0)
    assert external.accepted == 1


@given(st.lists(st.floats(), min_size=4, max_size=4), st.floats(), st.floats())
def test_whatever_a_tracker_says_nothing_that_is_no_rotation_goes_out(
    q: list[float], sigma_m: float, time_s: float
) -> None:
    turned = (q[0], q[1], q[2], q[3])
    sources = PositionSources((MOCAP,))
    for message in (ODOMETRY, VISION_POSITION_ESTIMATE):
        forwarding = PoseForwarding(message, 50.0)
        sources.take(MOCAP, fix(time_s, sigma_m=sigma_m), 1.0, turned)
        pose = forwarding.poll(sources, 1.0)
        if pose is None:
            continue
        assert normalised(turned) is not None
        back = parsed(pose)
        if isinstance(pose, VisionPositionEstimate):
            assert not any(isnan(angle) for angle in (back.roll, back.pitch, back.yaw))
            assert isnan(back.covariance[0]) or 0.0 < back.covariance[0] < inf
