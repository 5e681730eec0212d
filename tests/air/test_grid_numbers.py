"""Grids of any numbers against another program's interpolation, their edges, and their bounds."""

from __future__ import annotations

from math import inf, isnan, nan

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from tgl_soar.air.field import FloatArray
from tgl_soar.air.grid import (
    GridError,
    GridField,
    GridTable,
    GridTable3D,
    Outside,
    bake,
    grid_wind,
    grid_wind_3d,
    grid_wind_3d_many,
    grid_wind_many,
    numpy_table,
    numpy_table_3d,
)

RANDOM = np.random.default_rng(5)
# Axes of their own start, step and count.
X, Y, Z = 1.0 + 2.0 * np.arange(4), -3.0 + 0.5 * np.arange(5), 10.0 + 4.0 * np.arange(3)
PLANE, CROSS = RANDOM.normal(size=(4, 3, 2)), RANDOM.normal(size=(4, 3))
BLOCK = RANDOM.normal(size=(4, 5, 3, 3))
FLAT = GridTable(x0_m=1.0, dx_m=2.0, nx=4, z0_m=10.0, dz_m=4.0, nz=3, values=PLANE.ravel().tolist())
DEEP = GridTable3D(
    x0_m=1.0, dx_m=2.0, nx=4, y0_m=-3.0, dy_m=0.5, ny=5, z0_m=10.0, dz_m=4.0, nz=3,
    values=BLOCK.ravel().tolist(),
)  # fmt: skip
HERE = (3.5, -2.1, 15.0)


def plane(outside: Outside = "nan") -> GridField:
    return GridField(
        X, None, Z, PLANE[..., 0], CROSS, PLANE[..., 1], reference_wind_mps=2.0, outside=outside
    )


def block(outside: Outside = "nan") -> GridField:
    return GridField(X, Y, Z, *np.moveaxis(BLOCK, -1, 0), reference_wind_mps=2.0, outside=outside)


def places(n: int) -> FloatArray:
    """Within the grid, its corners and nodes among them."""
    low, high = np.array([1.0, -3.0, 10.0]), np.array([7.0, -1.0, 18.0])
    inner = low + (high - low) * RANDOM.random((n, 3))
    return np.vstack([inner, low, high, (7.0, -3.0, 14.0), (3.0, -2.5, 18.0), (1.0, -1.0, 10.0)])


def test_in_a_plane_the_wind_is_as_scipy_interpolates_it() -> None:
    at = places(60)[:, [0, 2]]
    expected = RegularGridInterpolator((X, Z), PLANE)(at)
    found = np.array([grid_wind(FLAT, x, z) for x, z in at.tolist()])
    assert found == pytest.approx(expected, abs=1e-12)
    many = np.column_stack(grid_wind_many(FLAT, at[:, 0], at[:, 1]))
    assert many == pytest.approx(expected, abs=1e-12)


def test_in_a_block_the_wind_is_as_scipy_interpolates_it() -> None:
    at = places(60)
    expected = RegularGridInterpolator((X, Y, Z), BLOCK)(at)
    found = np.array([grid_wind_3d(DEEP, *place) for place in at.tolist()])
    assert found == pytest.approx(expected, abs=1e-12)
    many = np.column_stack(grid_wind_3d_many(DEEP, *at.T))
    assert many == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("away", [-1000.0, -0.3, 0.3, 1000.0])
def test_beyond_each_edge_the_wind_is_that_of_the_edge(axis: int, away: float) -> None:
    low, high = (1.0, -3.0, 10.0), (7.0, -1.0, 18.0)
    edge, beyond = list(HERE), list(HERE)
    edge[axis] = low[axis] if away < 0.0 else high[axis]
    beyond[axis] = edge[axis] + away
    x, y, z = beyond
    expected = RegularGridInterpolator((X, Y, Z), BLOCK)(edge)[0]
    assert grid_wind_3d(DEEP, x, y, z) == pytest.approx(expected)
    assert block("edge").wind_at(x, y, z, 0.0) == pytest.approx(expected)
    assert np.ravel(block("edge").wind(x, y, z)) == pytest.approx(expected)
    u, w = RegularGridInterpolator((X, Z), PLANE)((edge[0], edge[2]))
    assert grid_wind(FLAT, x, z) == pytest.approx((u, w))
    v = RegularGridInterpolator((X, Z), CROSS)((edge[0], edge[2]))
    assert plane("edge").wind_at(x, y, z, 0.0) == pytest.approx((u, float(v), w))
    assert np.ravel(plane("edge").wind(x, y, z)) == pytest.approx([u, float(v), w])


def test_no_number_for_a_place_is_its_first_edge() -> None:
    x, y, z = HERE
    assert grid_wind(FLAT, nan, z) == grid_wind(FLAT, 1.0, z)
    assert grid_wind(FLAT, x, nan) == grid_wind(FLAT, x, 10.0)
    assert grid_wind_3d(DEEP, nan, y, z) == grid_wind_3d(DEEP, 1.0, y, z)
    assert grid_wind_3d(DEEP, x, nan, z) == grid_wind_3d(DEEP, x, -3.0, z)
    assert grid_wind_3d(DEEP, x, y, nan) == grid_wind_3d(DEEP, x, y, 10.0)


def test_a_baked_table_is_the_nodes_at_one_step() -> None:
    table = bake(1.0, 10.0, 0.25, PLANE[..., 0], PLANE[..., 1])
    assert table[:6] == (1.0, 0.25, 4, 10.0, 0.25, 3)
    assert isinstance(table.values, list)
    assert grid_wind(table, 1.5, 10.25) == pytest.approx(tuple(PLANE[2, 1]))


def test_a_table_for_kernels_is_the_same_with_an_array() -> None:
    flat, deep = numpy_table(FLAT), numpy_table_3d(DEEP)
    assert isinstance(flat.values, np.ndarray)
    assert isinstance(deep.values, np.ndarray)
    assert (flat[:6], deep[:9]) == (FLAT[:6], DEEP[:9])
    assert flat.values.tolist() == FLAT.values
    assert deep.values.tolist() == DEEP.values


# --- a field ----------------------------------------------------------------------------------


def test_a_field_has_its_axes_and_nodes_as_they_were_given() -> None:
    assert plane().table == FLAT
    assert block().table == DEEP
    assert (plane().three_dimensional, block().three_dimensional) == (False, True)
    assert plane().reference_wind_mps == 2.0


@pytest.mark.parametrize("field", [plane, block])
def test_the_edges_themselves_belong_to_the_grid(field: object) -> None:
    made = plane() if field is plane else block()
    axes = (0, 2) if field is plane else (0, 1, 2)
    for axis in axes:
        for edge, beyond in (
            ((1.0, -3.0, 10.0)[axis], -1e-6), ((7.0, -1.0, 18.0)[axis], 1e-6),
        ):  # fmt: skip
            at = list(HERE)
            at[axis] = edge
            assert made.inside(*at)
            assert not isnan(made.wind_at(at[0], at[1], at[2], 0.0)[0])
            assert np.isfinite(np.ravel(made.wind(*at))).all()
            at[axis] += beyond
            assert not made.inside(*at)
            assert all(isnan(part) for part in made.wind_at(at[0], at[1], at[2], 0.0))
            assert np.isnan(np.ravel(made.wind(*at))).all()


def test_beyond_the_grid_the_air_is_still_where_that_is_asked() -> None:
    for field in (plane("still"), block("still")):
        assert field.wind_at(7.1, -2.0, 15.0, 0.0) == (0.0, 0.0, 0.0)
        assert np.ravel(field.wind(7.1, -2.0, 15.0)).tolist() == [0.0, 0.0, 0.0]
        assert field.wind_at(*HERE, 0.0)[0] != 0.0
        assert np.ravel(field.wind(*HERE)) == pytest.approx(field.wind_at(*HERE, 0.0))


def test_every_cell_that_touches_a_solid_node_is_not_air() -> None:
    for node in ((0, 0, 0), (3, 4, 2), (1, 2, 1)):
        solid = np.zeros((4, 5, 3), dtype=bool)
        solid[node] = True
        field = GridField(X, Y, Z, *np.moveaxis(BLOCK, -1, 0), reference_wind_mps=2.0, solid=solid)
        assert field.wind_at(X[node[0]], Y[node[1]], Z[node[2]], 0.0) == (0.0, 0.0, 0.0)
        for cell in np.ndindex(3, 4, 2):
            touches = all(n - 1 <= c <= n for c, n in zip(cell, node, strict=True))
            i, j, k = cell
            middle = (float(X[i]) + 1.0, float(Y[j]) + 0.25, float(Z[k]) + 2.0)
            assert field.inside(*middle) is not touches


def test_nodes_of_solid_in_a_plane_take_its_cross_wind_too() -> None:
    solid = np.zeros((4, 3), dtype=bool)
    solid[2, 1] = True
    field = GridField(
        X, None, Z, PLANE[..., 0], CROSS, PLANE[..., 1], reference_wind_mps=2.0, solid=solid
    )
    assert field.wind_at(5.0, 0.0, 14.0, 0.0) == (0.0, 0.0, 0.0)


# --- what is refused --------------------------------------------------------------------------


def test_places_off_by_less_than_a_thousandth_of_a_step_are_even() -> None:
    u, w = PLANE[..., 0], PLANE[..., 1]
    for off, refused in ((0.9e-3, False), (-0.9e-3, False), (1.1e-3, True), (-1.1e-3, True)):
        x = X.copy()
        x[2] += 2.0 * off
        if refused:
            with pytest.raises(
                GridError, match=r"axis x is not evenly.*place 2 is .* puts it at 5"
            ):
                GridField(x, None, Z, u, None, w, reference_wind_mps=2.0)
        else:
            GridField(x, None, Z, u, None, w, reference_wind_mps=2.0)


@pytest.mark.parametrize(
    ("x", "words"),
    [
        ([1.0, 1.0, 1.0, 1.0], r"axis x \(1.0 … 1.0 m\) must increase"),
        ([4.0, 3.0, 2.0, 1.0], r"axis x \(4.0 … 1.0 m\) must increase"),
        ([1.0, 2.0, 3.0, nan], "must increase"),
        ([1.0, 2.0, 3.0, inf], "must increase"),
        ([1.0, nan, 3.0, 4.0], "place 1 is nan m, even spacing puts it at 2 m"),
        ([1.0, 2.0, 3.7, 4.0], "place 2 is 3.7 m, even spacing puts it at 3 m"),
        ([[1.0, 2.0]], r"axis x of shape \(1, 2\) needs two places"),
        ([1.0], r"axis x of shape \(1,\) needs two places"),
    ],
)
def test_an_axis_that_is_none_is_refused(x: object, words: str) -> None:
    with pytest.raises(GridError, match=f"^mine: .*{words}"):
        GridField(
            x, None, Z, PLANE[..., 0], None, PLANE[..., 1],  # type: ignore[arg-type]
            reference_wind_mps=2.0, name="mine",
        )  # fmt: skip


def test_each_axis_and_part_is_named_where_it_does_not_fit() -> None:
    u, v, w = np.moveaxis(BLOCK, -1, 0)
    for axes, words in (
        ((X, Y[::-1], Z), "axis y"), ((X, Y, Z[::-1]), "axis z"), ((X[::-1], Y, Z), "axis x"),
    ):  # fmt: skip
        with pytest.raises(GridError, match=f"^grid: {words} .* must increase"):
            GridField(*axes, u, v, w, reference_wind_mps=2.0)
    for parts, name in (((u[:3], v, w), "u"), ((u, v[:3], w), "v"), ((u, v, w[:3]), "w")):
        words = rf"{name} has shape \(3, 5, 3\), the axes \(4, 5, 3\)$"
        with pytest.raises(GridError, match=words):
            GridField(X, Y, Z, *parts, reference_wind_mps=2.0)
    with pytest.raises(GridError, match=r"v has shape \(3, 5, 4\).*; its axes are swapped"):
        GridField(X, Y, Z, u, v.T, w, reference_wind_mps=2.0)
    with pytest.raises(GridError, match=r"solid has shape \(2,\), the grid \(4, 5, 3\)"):
        GridField(X, Y, Z, u, v, w, reference_wind_mps=2.0, solid=np.array([True, False]))


@pytest.mark.parametrize("wind", [0.0, -3.0, inf, nan])
def test_a_reference_wind_that_does_not_blow_is_refused(wind: float) -> None:
    with pytest.raises(GridError, match=f"^grid: reference wind {wind} m/s must be positive"):
        GridField(X, None, Z, PLANE[..., 0], None, PLANE[..., 1], reference_wind_mps=wind)


def test_an_unknown_answer_for_outside_is_refused() -> None:
    with pytest.raises(GridError, match="outside = 'zero'; one of 'nan', 'edge', 'still'"):
        plane("zero")  # type: ignore[arg-type]


def test_a_light_wind_and_the_least_grid_are_taken() -> None:
    ones = np.ones((2, 2))
    field = GridField([0.0, 0.5], None, [0.0, 0.5], ones, None, ones, reference_wind_mps=0.5)
    assert field.wind_at(0.1, 0.0, 0.4, 0.0) == pytest.approx((1.0, 0.0, 1.0))
    assert all(isnan(part) for part in field.wind_at(0.6, 0.0, 0.4, 0.0))
