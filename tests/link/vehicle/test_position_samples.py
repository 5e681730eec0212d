"""Positions of every source: from messages to fixes."""

from __future__ import annotations

from math import asin, atan2, cos, degrees, nan, radians, sin, sqrt
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from test_sensor_samples import AUTOPILOT, BRIDGE, HOME, OWN, STRANGER, hear, session

from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.link.messages import (
    CommandLong,
    GlobalPositionInt,
    LocalPositionNed,
    VisionPositionEstimate,
)
from tgl_soar.link.session import Session
from tgl_soar.link.sources import GLOBAL_POSITION, LOCAL_POSITION, VISION, PositionSources
from tgl_soar.link.tangent_plane import Home, TangentPlane


def geodetic(home: Home, north_m: float, east_m: float, down_m: float) -> tuple[float, ...]:
    """Latitude, longitude [deg] and height of a place in local NED, by way of ECEF (Bowring)."""
    a, f = 6_378_137.0, 1 / 298.257223563
    b, e2 = a * (1 - f), f * (2 - f)
    lat, lon = radians(home.latitude_deg), radians(home.longitude_deg)
    n = a / sqrt(1 - e2 * sin(lat) ** 2)
    x0 = (n + home.altitude_m) * cos(lat) * cos(lon)
    y0 = (n + home.altitude_m) * cos(lat) * sin(lon)
    z0 = (n * (1 - e2) + home.altitude_m) * sin(lat)
    up = -down_m
    x = x0 - sin(lon) * east_m - sin(lat) * cos(lon) * north_m + cos(lat) * cos(lon) * up
    y = y0 + cos(lon) * east_m - sin(lat) * sin(lon) * north_m + cos(lat) * sin(lon) * up
    z = z0 + cos(lat) * north_m + sin(lat) * up
    p = sqrt(x * x + y * y)
    t = atan2(z * a, p * b)
    for _ in range(3):
        phi = atan2(z + e2 / (1 - e2) * b * sin(t) ** 3, p - e2 * a * cos(t) ** 3)
        t = atan2(b * sin(phi), a * cos(phi))
    height = p * cos(phi) + z * sin(phi) - a * sqrt(1 - e2 * sin(phi) ** 2)
    return degrees(phi), degrees(atan2(y, x)), height


@given(
    st.floats(-80, 80),
    st.floats(-180, 180),
    st.floats(-100, 3000),
    st.tuples(*[st.floats(-5000, 5000)] * 3),
)
def test_the_tangent_plane_and_back(
    lat: float, lon: float, height: float, ned: tuple[float, float, float]
) -> None:
    home = Home(lat, lon, height)
    back = TangentPlane(home).ned_m(*geodetic(home, *ned))
    assert back == pytest.approx(ned, abs=1e-5)


def test_a_degree_is_as_long_as_it_is() -> None:
    """At 45 degrees: 1 arc second of latitude is 30.87 m, of longitude 21.90 m."""
    plane = TangentPlane(Home(45.0, 7.0, 0.0))
    assert plane.ned_m(45.0 + 1 / 3600, 7.0, 0.0)[0] == pytest.approx(30.87, abs=0.01)
    assert plane.ned_m(45.0, 7.0 + 1 / 3600, 0.0)[1] == pytest.approx(21.90, abs=0.01)
    assert plane.ned_m(45.0, 7.0, 12.0)[2] == pytest.approx(-12.0)


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
    hear(talk, place, 5.0)
    assert talk.position.source == GLOBAL_POSITION
    assert talk.position[2:5] == pytest.approx((120.0, -34.0, -5.0), abs=0.006)
    assert talk.position[5:8] == pytest.approx((1.5, -0.2, 0.05))
    hear(talk, place._replace(time_boot_ms=1020, lat=place.lat + 1), 5.02)
    assert talk.position.north_m == pytest.approx(120.0 + 0.0111, abs=0.006)


def test_a_place_that_is_not_near_home_is_counted_and_reported_once() -> None:
    talk = hill()
    for i, (lat, lon) in enumerate(((0, 0), (2**31 - 1, -(2**31)), (530_000_000, 4_375_000))):
        hear(
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
    seen = VisionPositionEstimate(
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
        hear(talk, seen, 5.0, stranger)
    assert talk.position.sequence == 0
    assert talk.counters.foreign == 3
    hear(talk, seen, 5.0, BRIDGE)
    assert talk.position[:5] == pytest.approx((1, 5.0, 1.0, 2.0, -3.0))
    assert talk.position.source == VISION
    assert talk.position.sigma_m == pytest.approx(0.03)
    assert talk.sources.attitude is not None
    assert euler_from_quaternion(*talk.sources.attitude) == pytest.approx((0.1, 0.2, 0.3))
    hear(talk, seen._replace(usec=77_000_010_000, x=nan), 5.01, BRIDGE)
    hear(talk, seen._replace(usec=77_000_020_000, yaw=nan), 5.02, BRIDGE)
    assert talk.position.sequence == 2
    assert talk.sources.attitude is None


def test_its_clock_is_not_the_autopilot_s() -> None:
    talk = vision_session()
    seen = VisionPositionEstimate(usec=0, x=1.0, y=2.0, z=-3.0, roll=0.0, pitch=0.0, yaw=0.0)
    for i in range(200):
        now = 10.0 + i * 0.01
        hear(
            talk,
            LocalPositionNed(
                time_boot_ms=5000 + i * 10, x=1.0, y=2.0, z=-3.0, vx=0.0, vy=0.0, vz=0.0
            ),
            now + 0.002,
        )
        hear(talk, seen._replace(usec=(5_200 + i * 10) * 1000), now, BRIDGE)
        assert talk.sources.health[VISION].newest_s == pytest.approx(now, abs=1e-3)
    for i in range(5):
        hear(talk, seen._replace(usec=i * 10_000), 13.0 + i * 0.01, BRIDGE)
    assert talk.counters.reboots == 0


def test_the_nose_of_a_level_aircraft_is_where_its_yaw_says() -> None:
    """A vision bridge with a pitch of 30 degrees: the quaternion's own sine."""
    talk = vision_session()
    seen = VisionPositionEstimate(
        usec=1_000_000, x=0.0, y=0.0, z=0.0, roll=0.0, pitch=radians(30.0), yaw=0.0
    )
    hear(talk, seen, 1.0, BRIDGE)
    assert talk.sources.attitude is not None
    w, x, y, z = talk.sources.attitude
    assert degrees(asin(2.0 * (w * y - z * x))) == pytest.approx(30.0)
