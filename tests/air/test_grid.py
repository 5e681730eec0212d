"""Gridded fields: interpolation, what lies outside, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from math import isnan

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tgl_soar.air.grid import GridError, GridField, Outside
from tgl_soar.air.hill import HillField

X, Y, Z = np.linspace(-2.0, 3.0, 11), np.linspace(-1.0, 1.0, 5), np.linspace(0.0, 4.0, 9)


def _plane(outside: Outside = "nan", solid: NDArray[np.bool_] | None = None) -> GridField:
    x, z = np.meshgrid(X, Z, indexing="ij")
    return GridField(
        X, None, Z, 9.0 + 0.5 * x - 0.2 * x * z, None, 0.3 * z,
        reference_wind_mps=9.0, outside=outside, solid=solid,
    )  # fmt: skip


def _block() -> GridField:
    x, y, z = np.meshgrid(X, Y, Z, indexing="ij")
    return GridField(X, Y, Z, 9.0 + x * y * z, y - x, 0.1 * x * z, reference_wind_mps=9.0)


@given(st.floats(-2.0, 3.0), st.floats(0.0, 4.0))
def test_bilinear_fields_are_reproduced(x: float, z: float) -> None:
    assert _plane_field.wind_at(x, 0.3, z, 0.0) == pytest.approx(
        (9.0 + 0.5 * x - 0.2 * x * z, 0.0, 0.3 * z), abs=1e-12
    )


@given(st.floats(-2.0, 3.0), st.floats(-1.0, 1.0), st.floats(0.0, 4.0))
def test_trilinear_fields_are_reproduced(x: float, y: float, z: float) -> None:
    assert _block_field.wind_at(x, y, z, 0.0) == pytest.approx(
        (9.0 + x * y * z, y - x, 0.1 * x * z), abs=1e-12
    )


_plane_field, _block_field = _plane(), _block()


@pytest.mark.parametrize("outside", ["nan", "edge", "still"])
def test_arrays_equal_single_queries_inside_and_out(outside: Outside) -> None:
    plane = _plane(outside)
    x, z = np.meshgrid(np.linspace(-3, 4, 15), np.linspace(-1, 5, 13), indexing="ij")
    arrays = np.stack(plane.wind(x, 0.0, z), axis=-1).reshape(-1, 3)
    single = [plane.wind_at(a, 0.0, b, 0.0) for a, b in zip(x.flat, z.flat, strict=True)]
    assert arrays == pytest.approx(np.array(single), nan_ok=True)
    block = _block()
    y = 0.7 * np.sin(x + z) * 2.0
    arrays = np.stack(block.wind(x, y, z), axis=-1).reshape(-1, 3)
    places = zip(x.flat, y.flat, z.flat, strict=True)
    single = [block.wind_at(a, b, c, 0.0) for a, b, c in places]
    assert arrays == pytest.approx(np.array(single), nan_ok=True)


def test_outside_is_what_was_asked_for() -> None:
    assert all(isnan(part) for part in _plane("nan").wind_at(3.1, 0.0, 1.0, 0.0))
    assert _plane("still").wind_at(3.1, 0.0, 1.0, 0.0) == (0.0, 0.0, 0.0)
    edge = _plane("edge")
    assert edge.wind_at(9.0, 0.0, 1.0, 0.0) == edge.wind_at(3.0, 0.0, 1.0, 0.0)
    assert not edge.inside(9.0, 0.0, 1.0)
    assert edge.inside(3.0, 0.0, 1.0)
    assert edge.inside(3.0, 99.0, 4.0)  # two-dimensional: the same at every y
    assert not _block().inside(0.0, 1.1, 1.0)


def test_cells_that_touch_solid_are_not_inside_and_still_at_the_solid() -> None:
    solid = np.zeros((11, 9), dtype=bool)
    solid[4, 0] = True  # x = 0, z = 0
    field = _plane(solid=solid)
    assert field.wind_at(0.0, 0.0, 0.0, 0.0) == (0.0, 0.0, 0.0)
    assert not field.inside(-0.4, 0.0, 0.4)
    assert not field.inside(0.4, 0.0, 0.4)
    assert field.inside(0.6, 0.0, 0.4)
    assert field.inside(0.4, 0.0, 0.6)


@settings(max_examples=30)
@given(st.floats(-60.0, -25.0), st.floats(5.0, 50.0))
def test_a_baked_hill_errs_by_its_curvature(x: float, z: float) -> None:
    """Bilinear error is at most h²/8 (|f_xx| + |f_zz|); over the hill f'' <= 12 U R² / r⁴."""
    u, _, w = _baked_hill.wind_at(x, 0.0, z, 0.0)
    exact_u, _, exact_w = _hill.wind_at(x, 0.0, z, 0.0)
    r = np.hypot(abs(x) - 0.5, max(z - 0.5, 0.0))
    bound = 0.5**2 / 8.0 * 12.0 * 9.0 * 400.0 / r**4
    assert abs(u - exact_u) <= bound
    assert abs(w - exact_w) <= bound


_hill = HillField(9.0, 20.0)
_hill_axes = np.arange(-60.0, -24.0, 0.5), np.arange(4.5, 51.0, 0.5)
_hill_nodes = _hill.wind(_hill_axes[0][:, None], 0.0, _hill_axes[1][None, :])
_baked_hill = GridField(
    _hill_axes[0], None, _hill_axes[1], _hill_nodes[0], None, _hill_nodes[2],
    reference_wind_mps=9.0,
)  # fmt: skip


def test_cross_wind_of_a_plane_is_kept() -> None:
    u = np.full((11, 9), 9.0)
    field = GridField(X, None, Z, u, 0.1 * u, 0.0 * u, reference_wind_mps=9.0)
    assert field.wind_at(0.3, 0.0, 1.1, 0.0) == pytest.approx((9.0, 0.9, 0.0))
    assert [float(part) for part in field.wind(0.3, 0.0, 1.1)] == pytest.approx([9.0, 0.9, 0.0])


def test_refuses_what_is_no_grid() -> None:
    u = np.full((11, 9), 9.0)

    def made(
        x: NDArray[np.float64] = X, u: NDArray[np.float64] = u, wind: float = 9.0
    ) -> GridField:
        return GridField(x, None, Z, u, None, 0.0 * u, reference_wind_mps=wind, name="site.npz")

    made()
    uneven, hole = X.copy(), u.copy()
    uneven[3] += 0.1
    hole[2, 5] = np.nan
    cases: list[tuple[Callable[[], GridField], str]] = [
        (lambda: made(x=X[::-1]), "site.npz: axis x .* must increase"),
        (lambda: made(x=uneven), "axis x is not evenly spaced: place 3"),
        (lambda: made(x=X[:1]), "two places at least"),
        (lambda: made(u=u.T), "swapped: transpose"),
        (lambda: made(u=hole), r"u is not finite at 1 of 99 nodes, first at index \(2, 5\)"),
        (lambda: made(wind=0.0), "reference wind"),
    ]
    for make, message in cases:
        with pytest.raises(GridError, match=message):
            make()
