"""Latitude, longitude and height on the plane through home: against the ellipsoid, and back."""

from __future__ import annotations

from math import atan2, cos, degrees, radians, sin, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

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
