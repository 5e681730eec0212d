"""Potential flow over a profile by panels, against the half-cylinder's exact solution."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from tgl_soar.air.hill import HillField
from tgl_soar.air.panels import PanelField

WIND, RADIUS = 9.0, 20.0


def half_cylinder(panels: int) -> PanelField:
    """Of the radius, with level ground of two radii before and behind it."""
    angle = np.linspace(np.pi, 0.0, panels + 1)
    step = np.pi * RADIUS / panels
    flat = np.arange(RADIUS + step, 3.0 * RADIUS, step)
    x = np.concatenate([-flat[::-1], RADIUS * np.cos(angle), flat])
    z = np.concatenate([0.0 * flat, RADIUS * np.sin(angle), 0.0 * flat])
    return PanelField(x, z, WIND)


def worst_error(panels: int, x: NDArray[np.float64], z: NDArray[np.float64]) -> float:
    """Of the wind, as a fraction of that far upstream."""
    found, exact = half_cylinder(panels).wind(x, 0.0, z), HillField(WIND, RADIUS).wind(x, 0.0, z)
    return float(max(np.abs(a - b).max() for a, b in zip(found, exact, strict=True))) / WIND


def around() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Places over the hill, from a panel's length (of 60) to three radii, 27° and more up.

    Where one soars; nearer to the hill's foot, a corner of 90° that no terrain has, a step of the
    sources is as large as they are.
    """
    radius, angle = np.meshgrid(
        np.linspace(RADIUS * (1.0 + np.pi / 60.0), 3.0 * RADIUS, 25), np.linspace(0.46, 2.68, 40)
    )
    return radius * np.cos(angle), radius * np.sin(angle)


def test_over_flat_ground_the_wind_is_undisturbed() -> None:
    field = PanelField(np.linspace(-50.0, 50.0, 21), np.full(21, 3.0), WIND)
    u, v, w = field.wind([-40.0, 0.0, 49.0], 0.0, [3.1, 8.0, 50.0])
    np.testing.assert_allclose(u, WIND, rtol=1e-12)
    np.testing.assert_allclose([v, w], 0.0, atol=1e-12)


def test_the_half_cylinder_has_its_exact_flow() -> None:
    # In the corner at the foot, 270° of ground, the strength grows as the distance to the power
    # -1/3; panels of length L miss some U L (L/R)^(-1/3) of its flux, which at a radius's distance
    # is (L/R)^(2/3) / 2 pi = 2 % of the wind for 60 panels.
    assert worst_error(60, *around()) < 0.02


def test_the_error_falls_with_the_panels_as_the_foot_lets_it() -> None:
    places = around()
    errors = [worst_error(panels, *places) for panels in (15, 30, 60, 120)]
    for coarse, fine in itertools.pairwise(errors):
        assert fine < 0.68 * coarse  # 2^(-2/3) = 0.63


def test_no_air_goes_through_a_ground_of_any_shape() -> None:
    x = np.linspace(-300.0, 300.0, 241)
    z = 40.0 * np.exp(-((x / 60.0) ** 2)) - 15.0 * np.exp(-(((x + 150.0) / 40.0) ** 2))
    z += 10.0 * np.tanh(x / 80.0)  # the ground behind is higher than before
    field = PanelField(x, z, WIND)
    middle = 0.5 * (x[1:] + x[:-1])
    rise = np.diff(z) / np.diff(x)
    # A tenth of a panel above the middles: elsewhere the steps of the strengths show.
    u, _, w = field.wind(middle, 0.0, 0.5 * (z[1:] + z[:-1]) + 0.25)
    through = (w - u * rise) / np.hypot(1.0, rise)
    # Along the streamline a tenth of a panel up the slope differs by that of the curvature there:
    # 40 m / (60 m)² · 2 · 0.25 m is 0.6 % of the wind.
    assert np.abs(through[20:-20]).max() < 0.01 * WIND


def test_continuity_and_no_vorticity_in_the_air() -> None:
    field, h = half_cylinder(30), 1e-3
    x, z = np.array([-30.0, -15.0, -5.0, 12.0]), np.array([10.0, 22.0, 30.0, 25.0])
    ue, _, we = field.wind(x + h, 0.0, z)
    uw, _, ww = field.wind(x - h, 0.0, z)
    uu, _, wu = field.wind(x, 0.0, z + h)
    ud, _, wd = field.wind(x, 0.0, z - h)
    np.testing.assert_allclose((ue - uw + wu - wd) / (2 * h), 0.0, atol=1e-6)
    np.testing.assert_allclose((uu - ud - we + ww) / (2 * h), 0.0, atol=1e-6)


def test_one_place_is_as_many() -> None:
    field = half_cylinder(30)
    one = field.wind_at(-15.0, 4.0, 22.0, 1.0)
    many = field.wind([-15.0], 4.0, [22.0])
    assert one == pytest.approx([float(part[0]) for part in many], abs=1e-12)


def test_under_the_ground_and_beyond_the_profile_there_is_no_air() -> None:
    field = half_cylinder(30)
    assert field.wind_at(0.0, 0.0, 19.0, 0.0) == (0.0, 0.0, 0.0)
    assert not field.inside(0.0, 0.0, 19.0)
    assert field.inside(-30.0, 0.0, 0.1)
    assert not field.inside(-70.0, 0.0, 5.0)


@pytest.mark.parametrize(
    ("x", "z", "wind", "words"),
    [
        ([0.0], [0.0], 8.0, "two points or more"),
        ([0.0, 0.0], [0.0, 1.0], 8.0, "grow in x"),
        ([0.0, 1.0], [0.0, float("nan")], 8.0, "finite"),
        ([0.0, 1.0], [0.0, 0.0], 0.0, "must be positive"),
    ],
)
def test_what_is_no_profile_is_refused(
    x: list[float], z: list[float], wind: float, words: str
) -> None:
    with pytest.raises(ValueError, match=words):
        PanelField(x, z, wind)
