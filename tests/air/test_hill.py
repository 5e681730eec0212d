"""Potential flow over a half cylinder, against what the theory says of it."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.air.hill import Hill, HillField, hill_wind

HILL = Hill(wind_mps=9.0, radius_m=20.0)


@given(st.floats(0.0, pi))
def test_no_flow_through_the_hill(theta: float) -> None:
    x, z = 20.0 * (1 + 1e-12) * cos(theta), 20.0 * (1 + 1e-12) * sin(theta)
    u, w = hill_wind(HILL, x, z)
    assert abs(u * cos(theta) + w * sin(theta)) < 1e-9  # rounding of numbers near 10


@given(st.floats(-200.0, 200.0), st.floats(0.0, 200.0))
def test_polar_form_of_the_paper(x: float, z: float) -> None:
    r, theta = float(np.hypot(x, z)), float(np.arctan2(z, x))
    if r < 20.0:
        assert hill_wind(HILL, x, z) == (0.0, 0.0)
        return
    radial = 9.0 * (1.0 - 400.0 / r**2) * cos(theta)
    turning = -9.0 * (1.0 + 400.0 / r**2) * sin(theta)
    u = radial * cos(theta) - turning * sin(theta)
    w = radial * sin(theta) + turning * cos(theta)
    assert hill_wind(HILL, x, z) == pytest.approx((u, w), abs=1e-12)


@given(st.floats(-100.0, -15.0), st.floats(15.0, 100.0))
def test_no_sources_and_no_vorticity(x: float, z: float) -> None:
    h = 1e-3
    (ue, we), (uw, ww) = hill_wind(HILL, x + h, z), hill_wind(HILL, x - h, z)
    (uu, wu), (ud, wd) = hill_wind(HILL, x, z + h), hill_wind(HILL, x, z - h)
    # Second differences of a field that bends over 20 m: h² / R² of a gradient of U / R.
    assert abs((ue - uw) + (wu - wd)) / (2 * h) < 1e-8
    assert abs((we - ww) - (uu - ud)) / (2 * h) < 1e-8


def test_top_is_twice_as_fast_and_windward_side_rises() -> None:
    assert hill_wind(HILL, 0.0, 20.0) == pytest.approx((18.0, 0.0))
    assert hill_wind(HILL, -20.0, 10.0)[1] > 0.0
    assert hill_wind(HILL, 20.0, 10.0)[1] < 0.0


def test_arrays_equal_single_queries_and_ground_is_outside() -> None:
    field = HillField(9.0, 20.0)
    x, z = np.meshgrid(np.linspace(-50, 50, 23), np.linspace(-5, 60, 17), indexing="ij")
    u, v, w = field.wind(x, 0.0, z)
    for i in range(23):
        for k in range(17):
            one = field.wind_at(float(x[i, k]), 0.0, float(z[i, k]), 0.0)
            assert (u[i, k], v[i, k], w[i, k]) == pytest.approx(one, abs=1e-12)
    assert not field.inside(0.0, 0.0, 10.0)
    assert not field.inside(-30.0, 0.0, -0.1)
    assert field.inside(-30.0, 0.0, 0.1)


@pytest.mark.parametrize(("wind", "radius"), [(9.0, 0.0), (9.0, float("nan")), (-1.0, 20.0)])
def test_refuses_what_is_no_hill(wind: float, radius: float) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        HillField(wind, radius)


def test_at_the_surface_and_on_the_ground_there_is_air() -> None:
    field = HillField(9.0, 20.0)
    # The top, the foot (where the wind stands still), and level ground before the hill, where
    # u is U (1 - R² / x²).
    for place, wind in (((0.0, 20.0), 18.0), ((-20.0, 0.0), 0.0), ((-30.0, 0.0), 5.0)):
        x, z = place
        assert hill_wind(field.hill, x, z) == pytest.approx((wind, 0.0))
        assert [float(part) for part in field.wind(x, 5.0, z)] == pytest.approx([wind, 0.0, 0.0])
        assert field.inside(x, 5.0, z)


def test_the_hill_is_round() -> None:
    field = HillField(9.0, 20.0)
    assert not field.inside(-11.9, 0.0, 15.9)  # 12, 16 and 20 are a right triangle's sides
    assert field.inside(-12.1, 0.0, 16.1)
    assert not field.inside(-19.0, 0.0, 0.5)
    assert not field.inside(-0.5, 0.0, 19.0)
    assert field.inside(-0.5, 0.0, 20.5)
    assert field.inside(0.5, 0.0, 20.5)


@pytest.mark.parametrize(("wind", "radius"), [(0.1, 0.1), (999.0, 0.99e6)])
def test_small_and_large_hills_are_taken(wind: float, radius: float) -> None:
    field = HillField(wind, radius)
    assert field.hill == Hill(wind_mps=wind, radius_m=radius)
    assert field.reference_wind_mps == wind


@pytest.mark.parametrize("radius", [0.0, -20.0, 1e6, 1.5e6, float("nan")])
def test_a_radius_that_no_hill_has_is_named(radius: float) -> None:
    with pytest.raises(ValueError, match=r"must be positive and below 1e6 m") as error:
        HillField(9.0, radius)
    assert f"hill radius {radius} m" in str(error.value)


@pytest.mark.parametrize("wind", [0.0, -9.0, 1000.0, 1500.0, float("nan")])
def test_a_wind_that_never_blows_is_named(wind: float) -> None:
    with pytest.raises(ValueError, match=r"must be positive and below 1000 m/s") as error:
        HillField(wind, 20.0)
    assert f"hill wind {wind} m/s" in str(error.value)
