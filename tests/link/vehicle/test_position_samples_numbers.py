"""Positions of each message: its units and frames, what is no position, what is known of it."""

from __future__ import annotations

from math import inf, isnan, nan, pi
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_sensor_samples import BRIDGE, HOME, receive, session

from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.link.messages import (
    AttitudeQuaternion,
    EkfStatusReport,
    GlobalPositionInt,
    LocalPositionNed,
    Odometry,
    VisionPositionEstimate,
)
from tgl_soar.link.session import Session
from tgl_soar.link.sources import (
    GLOBAL_POSITION,
    LOCAL_POSITION,
    ODOMETRY,
    VISION,
    PositionSources,
)

LOCAL_NED, LOCAL_FRD = mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_FRD
BODY_FRD, BODY_NED = mavlink.MAV_FRAME_BODY_FRD, mavlink.MAV_FRAME_BODY_NED
PLACE = LocalPositionNed(time_boot_ms=1000, x=1.0, y=2.0, z=-3.0, vx=4.0, vy=5.0, vz=-6.0)
SEEN = VisionPositionEstimate(usec=1_000_000, x=1.0, y=2.0, z=-3.0, roll=0.0, pitch=0.0, yaw=0.0)
COVARIANCE = (0.04, *(0.0,) * 5, 0.01, *(0.0,) * 4, 0.01, *(0.0,) * 9)
EAST = quaternion_from_euler(0.0, 0.0, 0.5 * pi)  # the nose
ODOMETRY_EAST = Odometry(
    time_usec=1_000_000, frame_id=LOCAL_NED, child_frame_id=BODY_FRD,
    x=1.0, y=2.0, z=-3.0, q=EAST, vx=10.0, vy=1.0, vz=-2.0,
    rollspeed=0.0, pitchspeed=0.0, yawspeed=0.0, pose_covariance=COVARIANCE,
)  # fmt: skip


def of(source: int, **options: Any) -> Session:
    return session(sources=PositionSources((source,)), home=HOME, vision_from=(BRIDGE,), **options)


def found(talk: Session) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Place and velocity."""
    fix = talk.position
    place = fix.north_m, fix.east_m, fix.down_m
    return place, (fix.velocity_north_mps, fix.velocity_east_mps, fix.velocity_down_mps)


def test_a_local_position_is_in_metres_already_and_its_accuracy_is_not_known() -> None:
    talk = of(LOCAL_POSITION)
    receive(talk, PLACE, 5.0)
    assert found(talk) == ((1.0, 2.0, -3.0), (4.0, 5.0, -6.0))
    assert talk.position.source == LOCAL_POSITION
    assert isnan(talk.position.sigma_m)
    assert not talk.position.reckoned
    assert talk.counters.positions == 1


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("broken", [nan, inf])
@pytest.mark.parametrize("source", [LOCAL_POSITION, VISION, ODOMETRY])
def test_a_place_that_is_no_number_on_any_axis_is_counted(
    source: int, axis: str, broken: float
) -> None:
    talk = of(source)
    change: dict[str, Any] = {axis: broken}
    if source == LOCAL_POSITION:
        receive(talk, PLACE._replace(**change), 5.0)
    elif source == VISION:
        receive(talk, SEEN._replace(**change), 5.0, BRIDGE)
    else:
        receive(talk, ODOMETRY_EAST._replace(**change), 5.0)
    assert talk.counters.not_finite == 1
    assert (talk.position.sequence, talk.counters.positions) == (0, 0)


def test_a_global_one_has_ten_millionths_of_degrees_millimetres_and_centimetres() -> None:
    """At 51.99 degrees 1e-7 degrees are 11.13 mm to the north, 6.87 mm to the east (WGS 84)."""
    talk = of(GLOBAL_POSITION)
    place = GlobalPositionInt(
        time_boot_ms=1000,
        lat=round(HOME.latitude_deg * 1e7) + 10_000,
        lon=round(HOME.longitude_deg * 1e7) - 10_000,
        alt=round(HOME.altitude_m * 1e3) + 12_000,
        vx=400,
        vy=-50,
        vz=6,
    )
    receive(talk, place, 5.0)
    (north_m, east_m, down_m), velocity = found(talk)
    assert (north_m, east_m) == pytest.approx((111.3, -68.7), abs=0.1)
    assert down_m == pytest.approx(-12.0, abs=0.01)
    assert velocity == pytest.approx((4.0, -0.5, 0.06))


@pytest.mark.parametrize(
    ("north", "east", "alt_m", "is_far"),
    [
        (0.89, 0.0, 0.0, False),  # 99 km
        (0.91, 0.0, 0.0, True),  # 101 km
        (0.0, 1.44, 0.0, False),
        (0.0, 1.48, 0.0, True),
        (0.0, 0.0, 99_000.0, False),
        (0.0, 0.0, 101_000.0, True),
        (0.0, 0.0, -101_000.0, True),
    ],
)
def test_a_hundred_kilometres_from_home_is_no_place_of_this_flight(
    north: float, east: float, alt_m: float, is_far: bool
) -> None:
    talk = of(GLOBAL_POSITION)
    place = GlobalPositionInt(
        time_boot_ms=1000,
        lat=round((HOME.latitude_deg + north) * 1e7),
        lon=round((HOME.longitude_deg + east) * 1e7),
        alt=round((HOME.altitude_m + alt_m) * 1e3),
        vx=0,
        vy=0,
        vz=0,
    )
    receive(talk, place, 5.0)
    assert talk.counters.far == is_far
    assert talk.position.sequence == (not is_far)
    where = f"{HOME.latitude_deg + north:.4f}, {HOME.longitude_deg + east:.4f}"
    words = f"GLOBAL_POSITION_INT at {where}: no fix, or not near position.home"
    reported = [text for _, text in talk.notices if "GLOBAL_POSITION_INT at" in text]
    assert reported == ([words] if is_far else [])


def test_without_a_home_a_global_one_is_nowhere() -> None:
    talk = session(sources=PositionSources((GLOBAL_POSITION,)))
    receive(talk, GlobalPositionInt(time_boot_ms=1000, lat=0, lon=0, alt=0, vx=0, vy=0, vz=0), 5.0)
    assert (talk.position.sequence, talk.counters.far) == (0, 0)


@pytest.mark.parametrize(
    ("frame", "child", "velocity"),
    [
        (LOCAL_NED, BODY_FRD, (-1.0, 10.0, -2.0)),  # with the nose to the east
        (LOCAL_FRD, BODY_FRD, (-1.0, 10.0, -2.0)),
        (LOCAL_NED, BODY_NED, (-1.0, 10.0, -2.0)),
        (LOCAL_NED, LOCAL_NED, (10.0, 1.0, -2.0)),
        (LOCAL_FRD, LOCAL_FRD, (10.0, 1.0, -2.0)),
    ],
)
def test_odometry_s_velocity_is_in_the_frame_that_it_says(
    frame: int, child: int, velocity: tuple[float, float, float]
) -> None:
    talk = of(ODOMETRY)
    receive(talk, ODOMETRY_EAST._replace(frame_id=frame, child_frame_id=child), 5.0)
    place, speed = found(talk)
    assert place == (1.0, 2.0, -3.0)
    assert speed == pytest.approx(velocity)
    assert talk.position.sigma_m == pytest.approx(0.2)
    assert talk.counters.wrong_frame == 0
    assert talk.attitude.sequence == 1  # its attitude is used with it


@pytest.mark.parametrize(
    ("frame", "child"), [(BODY_FRD, BODY_FRD), (LOCAL_NED, mavlink.MAV_FRAME_GLOBAL)]
)
def test_other_frames_are_counted_and_reported_once(frame: int, child: int) -> None:
    talk = of(ODOMETRY)
    for i in range(2):
        message = ODOMETRY_EAST._replace(time_usec=1_000_000 + 20_000 * i)
        receive(talk, message._replace(frame_id=frame, child_frame_id=child), 5.0 + 0.02 * i)
    assert talk.counters.wrong_frame == 2
    assert talk.position.sequence == 0
    reported = [text for _, text in talk.notices if "ODOMETRY in frames" in text]
    assert reported == [
        f"ODOMETRY in frames {frame}, {child}: send LOCAL_NED or LOCAL_FRD with BODY_FRD"
    ]


def test_without_a_rotation_the_place_is_known_and_the_velocity_is_not() -> None:
    talk = of(ODOMETRY)
    receive(talk, ODOMETRY_EAST._replace(q=(nan, 0.0, 0.0, 0.0)), 5.0)
    place, speed = found(talk)
    assert place == (1.0, 2.0, -3.0)
    assert all(map(isnan, speed))
    assert talk.attitude.sequence == 0


def test_a_bridge_s_velocity_is_not_known() -> None:
    talk = of(VISION)
    receive(talk, SEEN._replace(covariance=COVARIANCE), 5.0, BRIDGE)
    place, speed = found(talk)
    assert place == (1.0, 2.0, -3.0)
    assert all(map(isnan, speed))
    assert talk.position.sigma_m == pytest.approx(0.2)


@pytest.mark.parametrize(("source", "reckoned"), [(LOCAL_POSITION, True), (VISION, False)])
def test_what_the_autopilot_reckons_is_its_own_position_alone(source: int, reckoned: bool) -> None:
    talk = of(source)
    receive(talk, EkfStatusReport(0), 4.9)
    if source == LOCAL_POSITION:
        receive(talk, PLACE, 5.0)
    else:
        receive(talk, SEEN, 5.0, BRIDGE)
    assert talk.position.reckoned is reckoned


def test_in_lockstep_the_vehicle_s_newest_stamp_is_the_time() -> None:
    """Whatever our own clock shows."""
    talk = of(LOCAL_POSITION, lockstep=True)
    receive(talk, PLACE, 5000.0)
    assert (talk.position.sequence, talk.position.time_s) == (1, 1.0)
    attitude = AttitudeQuaternion(
        time_boot_ms=2950, q1=1, q2=0, q3=0, q4=0, rollspeed=0, pitchspeed=0, yawspeed=0
    )
    receive(talk, attitude, 5000.0)
    receive(talk, PLACE._replace(time_boot_ms=1900), 5000.0)  # of more than a second before
    assert talk.position.sequence == 1
    assert talk.sources.health[LOCAL_POSITION].late == 1
    receive(talk, PLACE._replace(time_boot_ms=2000), 5000.0)
    assert (talk.position.sequence, talk.position.time_s) == (2, 2.0)
