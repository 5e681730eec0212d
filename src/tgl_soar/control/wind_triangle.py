"""The wind triangle: over the ground along a bearing, in a wind along both axes.

Bearings from straight upwind of the soaring frame, positive to the right.
"""

from __future__ import annotations

from math import cos, hypot, sin, sqrt

from tgl_soar.types import NAN, AirEstimate


def ground_speed(
    speed_mps: float, wind_mps: float, cross_wind_mps: float, bearing_rad: float
) -> float:
    """v(V) [m/s] along a bearing; NaN where the wind blows the aircraft off it."""
    side = wind_mps * sin(bearing_rad) + cross_wind_mps * cos(bearing_rad)
    head = wind_mps * cos(bearing_rad) - cross_wind_mps * sin(bearing_rad)
    square = speed_mps * speed_mps - side * side
    return sqrt(square) - head if square > 0.0 else NAN


def cross_wind(air: AirEstimate) -> float:
    """c [m/s], to the right; 0 where it is not known."""
    return air.cross_wind_mps if air.cross_wind_mps == air.cross_wind_mps else 0.0


def wind_speed(air: AirEstimate) -> float:
    """Horizontal, of both axes where both are known [m/s]; NaN: not known."""
    return hypot(air.wind_mps, cross_wind(air))


def slower(air: AirEstimate, wind_mps: float) -> AirEstimate:
    """The same air in a wind of the same direction with another speed, above zero before.

    The velocity over the ground stays: against the wind the airspeed loses what the wind does.
    """
    before_mps = wind_speed(air)
    factor = wind_mps / before_mps
    return air._replace(
        wind_mps=factor * air.wind_mps,
        cross_wind_mps=factor * air.cross_wind_mps,
        airspeed_mps=max(0.0, air.airspeed_mps + wind_mps - before_mps),
    )
