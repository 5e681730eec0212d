"""Latitude, longitude and height in local NED: the plane that touches the ellipsoid at a home.

    ECEF      X = (N + h) cos φ cos λ    Y = (N + h) cos φ sin λ    Z = (N (1 - e²) + h) sin φ
    N = a / sqrt(1 - e² sin² φ)          WGS 84: a = 6378137 m, 1/f = 298.257223563, e² = f (2 - f)

    north  = -sin φ0 cos λ0 dX - sin φ0 sin λ0 dY + cos φ0 dZ
    east   = -sin λ0 dX + cos λ0 dY
    down   = -cos φ0 cos λ0 dX - cos φ0 sin λ0 dY - sin φ0 dZ

A double carries ECEF coordinates to some 1e-9 m, so all of an int32 in 1e-7 degrees (11 mm) is
kept.  Heights above mean sea level may stand for those above the ellipsoid if home and aircraft
both do: the geoid between them is as good as flat.
"""

from __future__ import annotations

from math import cos, radians, sin, sqrt
from typing import Final, NamedTuple

EQUATOR_M: Final = 6_378_137.0
_F: Final = 1.0 / 298.257223563
ECCENTRICITY2: Final = _F * (2.0 - _F)

Triple = tuple[float, float, float]


class Home(NamedTuple):
    """Where the origin of local NED lies."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float  # above mean sea level


class TangentPlane:
    """Local NED about a home."""

    def __init__(self, home: Home) -> None:
        latitude, longitude = radians(home.latitude_deg), radians(home.longitude_deg)
        self._origin = _ecef(latitude, longitude, home.altitude_m)
        self._sin_lat, self._cos_lat = sin(latitude), cos(latitude)
        self._sin_lon, self._cos_lon = sin(longitude), cos(longitude)

    def ned_m(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Triple:
        """A place in local NED."""
        x, y, z = _ecef(radians(latitude_deg), radians(longitude_deg), altitude_m)
        dx, dy, dz = x - self._origin[0], y - self._origin[1], z - self._origin[2]
        outward = self._cos_lon * dx + self._sin_lon * dy  # from the earth's axis
        return (
            self._cos_lat * dz - self._sin_lat * outward,
            self._cos_lon * dy - self._sin_lon * dx,
            -self._cos_lat * outward - self._sin_lat * dz,
        )


def _ecef(latitude_rad: float, longitude_rad: float, altitude_m: float) -> Triple:
    s, c = sin(latitude_rad), cos(latitude_rad)
    normal_m = EQUATOR_M / sqrt(1.0 - ECCENTRICITY2 * s * s)
    from_axis_m = (normal_m + altitude_m) * c
    return (
        from_axis_m * cos(longitude_rad),
        from_axis_m * sin(longitude_rad),
        (normal_m * (1.0 - ECCENTRICITY2) + altitude_m) * s,
    )
