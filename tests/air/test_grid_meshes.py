"""Meshes sampled on a grid: which of their axes becomes which, where they are cut, their holes, and
what is refused.  Their winds are linear in place, so that sampling them is exact."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tgl_soar.air import grid_files
from tgl_soar.air.field import FloatArray
from tgl_soar.air.grid import GridError, GridField
from tgl_soar.air.grid_files import Layout, read_grid

pyvista = pytest.importorskip("pyvista")

# A box of 4, 3 and 2 m from (1, 2, 3) on, in steps of half a metre.
LOW, SIZE = np.array([1.0, 2.0, 3.0]), np.array([4.0, 3.0, 2.0])


def linear(places: FloatArray) -> FloatArray:
    """A wind whose parts are told apart: the more of it, the earlier the axis of the mesh."""
    x, y, z = places.T
    return np.column_stack([9.0 + x - y + z, 5.0 + 0.25 * x + 0.5 * y, 4.0 + 0.5 * y - 0.75 * z])


def box() -> Any:
    made = pyvista.ImageData(
        dimensions=tuple((2 * SIZE + 1).astype(int)), spacing=(0.5,) * 3, origin=tuple(LOW)
    )
    made["U"] = linear(np.asarray(made.points, dtype=np.float64))
    return made


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path: Path = tmp_path_factory.mktemp("mesh") / "box.vti"
    box().save(path)
    return path


def sampled(path: Path, layout: Layout, step_m: float = 0.5, **keys: Any) -> GridField:
    return read_grid(path, layout, step_m=step_m, check_mass_balance=False, **keys)


def wind_in(place: tuple[float, float, float]) -> FloatArray:
    found: FloatArray = linear(np.array([place]))[0]
    return found


@pytest.mark.parametrize("names", ["xyz", "xzy", "yxz"])
def test_each_axis_of_the_mesh_becomes_the_one_that_it_is_named_for(mesh: Path, names: str) -> None:
    field = sampled(mesh, Layout(x=names[0], y=names[1], z=names[2], u="U"))
    order = ["xyz".index(name) for name in names]
    table: Any = field.table
    assert (table.x0_m, table.y0_m, table.z0_m) == pytest.approx(LOW[order])
    assert (table.nx, table.ny, table.nz) == tuple((2 * SIZE[order] + 1).astype(int))
    assert (table.dx_m, table.dy_m, table.dz_m) == pytest.approx((0.5, 0.5, 0.5))
    for place in ((1.0, 2.0, 3.0), (5.0, 5.0, 5.0), (2.3, 4.1, 3.6), (1.0, 4.75, 4.9)):
        expected = wind_in(place)[order]
        at = [place[n] for n in order]
        assert field.wind_at(at[0], at[1], at[2], 0.0) == pytest.approx(tuple(expected), abs=1e-5)


@pytest.mark.parametrize(
    ("x", "z", "cut"), [("x", "y", (2.5, 3.5, 4.0)), ("x", "z", (2.5, 3.5, 4.5))]
)
def test_a_plane_is_cut_through_the_middle_of_the_third_axis(
    mesh: Path, x: str, z: str, cut: tuple[float, float, float]
) -> None:
    field = sampled(mesh, Layout(x=x, z=z, u="U"))
    assert not field.three_dimensional
    third = ({0, 1, 2} - {"xyz".index(x), "xyz".index(z)}).pop()
    place = list(cut)
    place[third] = LOW[third] + 0.5 * SIZE[third]
    wind = wind_in((place[0], place[1], place[2]))
    at_x, at_z = place["xyz".index(x)], place["xyz".index(z)]
    u, v, w = field.wind_at(at_x, 77.0, at_z, 0.0)
    assert (u, v, w) == pytest.approx(
        (wind["xyz".index(x)], wind[third], wind["xyz".index(z)]), abs=1e-5
    )


def test_the_spacing_is_in_metres_whatever_the_mesh_is_in(mesh: Path) -> None:
    """In millimetres: four of its lengths are 4 mm."""
    layout = Layout(x="x", y="y", z="z", u="U", metres_per_length=1e-3)
    table: Any = sampled(mesh, layout, step_m=1e-3).table
    assert (table.nx, table.ny, table.nz) == (5, 4, 3)
    assert (table.x0_m, table.dx_m) == pytest.approx((1e-3, 1e-3))


@pytest.mark.parametrize(
    ("step_m", "counts"),
    [(1.0, (5, 4, 3)), (0.9, (5, 4, 3)), (0.8, (6, 4, 3)), (0.1, (41, 31, 21))],
)
def test_as_many_places_are_taken_as_lie_in_the_mesh(
    mesh: Path, step_m: float, counts: tuple[int, int, int]
) -> None:
    table: Any = sampled(mesh, Layout(x="x", y="y", z="z", u="U"), step_m=step_m).table
    assert (table.nx, table.ny, table.nz) == counts
    assert (table.dx_m, table.dz_m) == pytest.approx((step_m, step_m))


def test_what_the_mesh_leaves_out_is_solid(tmp_path: Path) -> None:
    """Its cells from x = 1 to 2 below y = 3.5 are missing."""
    made = box()
    centres = np.asarray(made.cell_centers().points)
    gone = (centres[:, 0] < 2.0) & (centres[:, 1] < 3.5)
    made.extract_cells(np.flatnonzero(~gone)).save(tmp_path / "hole.vtu")
    field = sampled(tmp_path / "hole.vtu", Layout(x="x", y="y", z="z", u="U"))
    expected = np.zeros(field.solid.shape, dtype=bool)
    expected[:2, :3, :] = True  # at 1.0 and 1.5 m, and 2.0 to 3.0 m
    assert np.array_equal(field.solid, expected)
    plane = sampled(tmp_path / "hole.vtu", Layout(x="x", z="y", u="U"))
    assert np.array_equal(plane.solid, expected[:, :, 0])


def test_winds_of_cells_are_taken_to_their_corners(tmp_path: Path) -> None:
    made = box()
    made.point_data.remove("U")
    made.cell_data["U"] = np.tile([8.0, 2.0, 1.0], (made.n_cells, 1))
    made.save(tmp_path / "cells.vti")
    field = sampled(tmp_path / "cells.vti", Layout(x="x", z="z", u="U"))
    assert field.wind_at(2.0, 0.0, 4.0, 0.0) == pytest.approx((8.0, 2.0, 1.0))


@pytest.mark.parametrize(
    ("layout", "says"),
    [
        (Layout(x="x", z="x", u="U"), r"name its axes 'x', 'y', 'z': \('x', None, 'x'\)"),
        (Layout(x="x", z="height", u="U"), r"name its axes .*: \('x', None, 'height'\)"),
        (Layout(x="x", y="z", z="z", u="U"), r"name its axes .*: \('x', 'z', 'z'\)"),
        (Layout(x="x", z="z", u="V"), r"no vector 'V'; there are \['U'\]: set layout u to"),
    ],
)
def test_a_layout_that_is_none_of_a_mesh_is_refused(mesh: Path, layout: Layout, says: str) -> None:
    with pytest.raises(GridError, match=rf"box\.vti: .*{says}"):
        sampled(mesh, layout)


def test_a_number_is_no_vector(tmp_path: Path) -> None:
    made = box()
    made["p"] = np.ones(made.n_points)
    made.save(tmp_path / "scalar.vti")
    with pytest.raises(GridError, match=r"'p' is no vector of three: shape \(315,\)"):
        sampled(tmp_path / "scalar.vti", Layout(x="x", y="y", z="z", u="p"))


def test_too_many_places_are_refused_with_their_number(
    mesh: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    layout = Layout(x="x", y="y", z="z", u="U")
    monkeypatch.setattr(grid_files, "MOST_NODES", 60)
    assert sampled(mesh, layout, step_m=1.0).three_dimensional  # 5 times 4 times 3
    monkeypatch.setattr(grid_files, "MOST_NODES", 59)
    with pytest.raises(GridError, match=r"step_m 1\.0 gives \(5, 4, 3\) nodes; the most is 59"):
        sampled(mesh, layout, step_m=1.0)


def test_a_step_that_meets_nothing_of_the_mesh_is_reported(tmp_path: Path) -> None:
    """Two cells at either end; a plane through the middle meets none."""
    made = box()
    centres = np.asarray(made.cell_centers().points)
    ends: Callable[[float], Any] = lambda y: np.abs(centres[:, 1] - y) < 0.3  # noqa: E731
    made.extract_cells(np.flatnonzero(ends(2.25) | ends(4.75))).save(tmp_path / "ends.vtu")
    with pytest.raises(GridError, match=r"no sampled place lies in the mesh; is step_m 1\.0 right"):
        sampled(tmp_path / "ends.vtu", Layout(x="x", z="z", u="U"), step_m=1.0)
