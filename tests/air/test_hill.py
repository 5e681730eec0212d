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


def sources_and_vorticity(hill: Hill, x: float, z: float) -> tuple[float, float]:
    """du/dx + dw/dz and du/dz − dw/dx [1/s].  By second differences of a field that bends over
    20 m they are off by h² / R² of a gradient of U / R."""
    h = 1e-3
    (ue, we), (uw, ww) = hill_wind(hill, x + h, z), hill_wind(hill, x - h, z)
    (uu, wu), (ud, wd) = hill_wind(hill, x, z + h), hill_wind(hill, x, z - h)
    return ((ue - uw) + (wu - wd)) / (2 * h), ((uu - ud) - (we - ww)) / (2 * h)


@given(st.floats(-100.0, -15.0), st.floats(15.0, 100.0))
def test_no_sources_and_no_vorticity(x: float, z: float) -> None:
    assert sources_and_vorticity(HILL, x, z) == pytest.approx((0.0, 0.0), abs=1e-8)


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
    assert field.hill == Hill(wind_mps=wind, radius_m=radius, ground_radius_m=radius)
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


SHEARED = HILL._replace(growth=0.14)


@given(st.floats(0.0, pi), st.floats(-1.0, 1.0))
def test_no_flow_through_the_hill_in_a_sheared_wind(theta: float, growth: float) -> None:
    x, z = 20.0 * (1 + 1e-12) * cos(theta), 20.0 * (1 + 1e-12) * sin(theta)
    u, w = hill_wind(HILL._replace(growth=growth), x, z)
    assert abs(u * cos(theta) + w * sin(theta)) < 1e-9  # rounding of numbers near 10


@given(st.floats(-100.0, -15.0), st.floats(15.0, 100.0))
def test_the_vorticity_of_a_sheared_wind_is_the_same_everywhere(x: float, z: float) -> None:
    there = 0.0, 0.14 * 9.0 / 20.0
    assert sources_and_vorticity(SHEARED, x, z) == pytest.approx(there, abs=1e-8)


@pytest.mark.parametrize("z", [0.0, 20.0, 50.0])
def test_far_upstream_a_sheared_wind_grows_with_height(z: float) -> None:
    # 4/3 of (R / x)² are left of what the hill does.
    assert hill_wind(SHEARED, -1e5, z) == pytest.approx(
        (9.0 * (1.0 + 0.14 * (z / 20.0 - 1.0)), 0.0), abs=1e-5
    )


def test_a_sheared_wind_at_the_top_the_foot_and_on_level_ground() -> None:
    # On the hill ζ is on the unit circle: at the top it is −i, artanh(−i) is −i π/4, and B −2.
    top = 0.86 * 18.0 + 0.14 * 9.0 * (1.0 + 2.0 / pi)
    assert hill_wind(SHEARED, 0.0, 20.0) == pytest.approx((top, 0.0))
    for x in (-20.0, 20.0):
        assert hill_wind(SHEARED, x, 0.0) == (0.0, 0.0)
    # Two radii before the axis: ζ is −1/2, and artanh(1/2) ln(3) / 2.
    taken_back = 15.0 / 16.0 * float(np.log(3.0)) - 3.0 / 4.0
    level = 0.86 * 9.0 * 0.75 - 0.14 * 9.0 / pi * taken_back
    assert hill_wind(SHEARED, -40.0, 0.0) == pytest.approx((level, 0.0))


@pytest.mark.parametrize("growth", [-1.0, -0.1, 0.14, 1.0])
def test_arrays_of_a_sheared_wind_equal_single_queries(growth: float) -> None:
    field = HillField(9.0, 20.0, growth)
    x, z = np.meshgrid(np.linspace(-50, 50, 21), np.linspace(-5, 60, 14), indexing="ij")
    u, v, w = field.wind(x, 0.0, z)
    assert np.isfinite(u).all()
    for i in range(21):
        for k in range(14):
            one = field.wind_at(float(x[i, k]), 0.0, float(z[i, k]), 0.0)
            assert (u[i, k], v[i, k], w[i, k]) == pytest.approx(one, abs=1e-12)
    assert (float(u[10, 0]), float(w[10, 0])) == (0.0, 0.0)  # in the ground


@pytest.mark.parametrize("flow_m", [19.5, 20.5])
def test_the_ground_may_be_of_another_radius_than_the_flow(flow_m: float) -> None:
    field = HillField(9.0, flow_m, 0.1, ground_radius_m=20.0)
    assert not field.inside(-12.0, 0.0, 15.9)
    assert field.inside(-12.0, 0.0, 16.1)
    assert field.wind_at(-30.0, 0.0, 20.0, 0.0) == HillField(9.0, flow_m, 0.1).wind_at(
        -30.0, 0.0, 20.0, 0.0
    )
    assert (field.wind_at(-12.0, 0.0, 16.1, 0.0)[0] == 0.0) == (flow_m > 20.0)


@pytest.mark.parametrize("ground_m", [0.0, -1.0, 1e6, float("nan")])
def test_a_ground_that_no_hill_has_is_named(ground_m: float) -> None:
    with pytest.raises(ValueError, match="in the ground: must be positive"):
        HillField(9.0, 20.0, 0.0, ground_m)


def test_a_place_without_end_is_no_error() -> None:
    u, w = hill_wind(SHEARED, -float("inf"), 3.0)
    assert np.isnan(u)
    assert np.isnan(w)


@pytest.mark.parametrize("growth", [-1.01, 1.01, float("nan")])
def test_a_growth_that_no_wind_has_is_named(growth: float) -> None:
    with pytest.raises(ValueError, match=r"growth of the wind with height .* must be -1 \.\.\. 1"):
        HillField(9.0, 20.0, growth)
