"""Positions of every source: from messages to fixes."""

from __future__ import annotations

from math import asin, degrees, nan, radians
from typing import Any

import pytest
from test_sensor_samples import AUTOPILOT, BRIDGE, HOME, OWN, STRANGER, receive, session
from test_tangent_plane import geodetic

from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.link.messages import (
    CommandLong,
    GlobalPositionInt,
    LocalPositionNed,
    VisionPositionEstimate,
)
from tgl_soar.link.session import Session
from tgl_soar.link.sources import GLOBAL_POSITION, LOCAL_POSITION, VISION, PositionSources


def hill(**options: Any) -> Session:
    return session(sources=PositionSources((GLOBAL_POSITION,)), home=HOME, **options)


def test_latitude_and_longitude_become_local_ned_with_all_their_digits() -> None:
    talk = hill()
    lat, lon, height = geodetic(HOME, 120.0, -34.0, -5.0)
    place = GlobalPositionInt(
        time_boot_ms=1000,
        lat=round(lat * 1e7),
        lon=round(lon * 1e7),
        alt=round(height * 1e3),
        vx=150,
        vy=-20,
        vz=5,
    )
    receive(talk, place, 5.0)
    assert talk.position.source == GLOBAL_POSITION
    assert talk.position[2:5] == pytest.approx((120.0, -34.0, -5.0), abs=0.006)
    assert talk.position[5:8] == pytest.approx((1.5, -0.2, 0.05))
    receive(talk, place._replace(time_boot_ms=1020, lat=place.lat + 1), 5.02)
    assert talk.position.north_m == pytest.approx(120.0 + 0.0111, abs=0.006)


def test_a_place_that_is_not_near_home_is_counted_and_reported_once() -> None:
    talk = hill()
    for i, (lat, lon) in enumerate(((0, 0), (2**31 - 1, -(2**31)), (530_000_000, 4_375_000))):
        receive(
            talk,
            GlobalPositionInt(
                time_boot_ms=1000 + 20 * i, lat=lat, lon=lon, alt=0, vx=0, vy=0, vz=0
            ),
            5.0 + 0.02 * i,
        )
    assert talk.position.sequence == 0
    assert talk.counters.far == 3
    assert len([text for _, text in talk.notices if "position.home" in text]) == 1


def test_which_position_streams_are_asked_for() -> None:
    talk, asked = hill(), set()
    for i in range(100):
        asked |= {m.params[0] for m in talk.poll(i * 0.1) if isinstance(m, CommandLong)}
    assert 33.0 in asked
    assert 32.0 not in asked


def vision_session(**options: Any) -> Session:
    sources = PositionSources((VISION, LOCAL_POSITION))
    return session(sources=sources, vision_from=(BRIDGE,), **options)


def test_a_position_overheard_from_a_bridge_that_is_accepted() -> None:
    talk = vision_session()
    covariance = (0.0004, *(0.0,) * 5, 0.0001, *(0.0,) * 4, 0.0009, *(0.0,) * 9)
    pose = VisionPositionEstimate(
        usec=77_000_000_000,
        x=1.0,
        y=2.0,
        z=-3.0,
        roll=0.1,
        pitch=0.2,
        yaw=0.3,
        covariance=covariance,
    )
    for stranger in (STRANGER, AUTOPILOT, OWN):
        receive(talk, pose, 5.0, stranger)
    assert talk.position.sequence == 0
    assert talk.counters.foreign == 3
    receive(talk, pose, 5.0, BRIDGE)
    assert talk.position[:5] == pytest.approx((1, 5.0, 1.0, 2.0, -3.0))
    assert talk.position.source == VISION
    assert talk.position.sigma_m == pytest.approx(0.03)
    assert talk.sources.attitude is not None
    assert euler_from_quaternion(*talk.sources.attitude) == pytest.approx((0.1, 0.2, 0.3))
    receive(talk, pose._replace(usec=77_000_010_000, x=nan), 5.01, BRIDGE)
    receive(talk, pose._replace(usec=77_000_020_000, yaw=nan), 5.02, BRIDGE)
    assert talk.position.sequence == 2
    assert talk.sources.attitude is None


def test_its_clock_is_not_the_autopilot_s() -> None:
    talk = vision_session()
    pose = VisionPositionEstimate(usec=0, x=1.0, y=2.0, z=-3.0, roll=0.0, pitch=0.0, yaw=0.0)
    for i in range(200):
        now = 10.0 + i * 0.01
        receive(
            talk,
            LocalPositionNed(
                time_boot_ms=5000 + i * 10, x=1.0, y=2.0, z=-3.0, vx=0.0, vy=0.0, vz=0.0
            ),
            now + 0.002,
        )
        receive(talk, pose._replace(usec=(5_200 + i * 10) * 1000), now, BRIDGE)
        assert talk.sources.health[VISION].newest_s == pytest.approx(now, abs=1e-3)
    for i in range(5):
        receive(talk, pose._replace(usec=i * 10_000), 13.0 + i * 0.01, BRIDGE)
    assert talk.counters.reboots == 0


def test_the_nose_of_a_level_aircraft_is_where_its_yaw_says() -> None:
    """A vision bridge with a pitch of 30 degrees: the quaternion's own sine."""
    talk = vision_session()
    pose = VisionPositionEstimate(
        usec=1_000_000, x=0.0, y=0.0, z=0.0, roll=0.0, pitch=radians(30.0), yaw=0.0
    )
    receive(talk, pose, 1.0, BRIDGE)
    assert talk.sources.attitude is not None
    w, x, y, z = talk.sources.attitude
    assert degrees(asin(2.0 * (w * y - z * x))) == pytest.approx(30.0)
