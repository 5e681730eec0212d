"""Airspeed, wind and the speed over the ground."""

from __future__ import annotations

from math import cos, hypot, isnan, nan, radians, sin

import pytest
from test_landing import air

from tgl_soar.control.wind_triangle import ground_speed, slower, wind_speed


def test_ground_speed_is_the_wind_triangle() -> None:
    assert ground_speed(9.0, 7.0, 0.0, 0.0) == pytest.approx(2.0)
    b = radians(40.0)
    v = ground_speed(9.0, 7.0, 0.0, b)
    # Along the bearing over the ground, the air brings the rest: its length is the airspeed.
    assert hypot(v * cos(b) + 7.0, v * sin(b)) == pytest.approx(9.0)
    v = ground_speed(9.0, 7.0, -2.0, b)  # a wind from the right
    assert hypot(v * cos(b) + 7.0, v * sin(b) + 2.0) == pytest.approx(9.0)
    assert isnan(ground_speed(5.0, 9.0, 0.0, radians(60.0)))
    assert isnan(ground_speed(5.0, 0.0, 9.0, 0.0))


def test_a_slower_wind_has_the_same_direction() -> None:
    wind = slower(air(wind_mps=8.0, cross_wind_mps=-6.0), 5.0)
    assert (wind.wind_mps, wind.cross_wind_mps) == pytest.approx((4.0, -3.0))
    assert wind_speed(wind) == pytest.approx(5.0)
    assert wind_speed(air(wind_mps=8.0, cross_wind_mps=nan)) == 8.0
    assert wind_speed(air(wind_mps=3.0, cross_wind_mps=4.0)) == hypot(3.0, 4.0)
