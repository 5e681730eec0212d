"""Wind grids from files: what is read, and how each kind of bad file is turned away."""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tgl_soar.air.field import FloatArray
from tgl_soar.air.grid import GridError, GridField
from tgl_soar.air.grid_files import Layout, read_grid, write_npz
from tgl_soar.air.hill import HillField

HILL = HillField(9.0, 20.0)
X, Y, Z = np.arange(-60.0, -21.0, 2.0), np.arange(-6.0, 7.0, 2.0), np.arange(2.0, 41.0, 2.0)
PLACES = [(-45.0, 0.0, 11.0), (-30.0, 0.0, 20.0), (-25.0, 0.0, 33.0)]


def _nodes() -> tuple[FloatArray, FloatArray, FloatArray]:
    return HILL.wind(X[:, None], 0.0, Z[None, :])


def _nodes_3d() -> tuple[FloatArray, FloatArray, FloatArray]:
    return HILL.wind(X[:, None, None], Y[None, :, None], Z[None, None, :])


def _csv(path: Path, change: Callable[[list[list[str]]], Any] = lambda _rows: None) -> Path:
    u, _, w = _nodes()
    rows = [["x", "z", "u", "w"]]
    for i, x in enumerate(X):
        rows += [[f"{n:.9g}" for n in (x, z, u[i, k], w[i, k])] for k, z in enumerate(Z)]
    change(rows)
    path.write_text("\n".join(",".join(row) for row in rows) + "\n", encoding="utf-8")
    return path


def _is_the_hill(field: GridField) -> None:
    for place in PLACES:
        # 2 m cells over a hill of 20 m: h²/8 · 12 U R² / r⁴ is 0.06 m/s at the nearest place.
        assert field.wind_at(*place, 0.0) == pytest.approx(HILL.wind_at(*place, 0.0), abs=0.06)
        assert field.inside(*place)


def test_csv_in_any_order_of_rows(tmp_path: Path) -> None:
    def shuffle(rows: list[list[str]]) -> None:
        body = rows[1:]
        np.random.default_rng(1).shuffle(body)
        rows[1:] = body

    field = read_grid(_csv(tmp_path / "hill.csv", shuffle))
    _is_the_hill(field)
    assert field.reference_wind_mps == pytest.approx(float(_nodes()[0].mean()), rel=1e-6)


def test_axes_that_count_upstream_feet_and_knots(tmp_path: Path) -> None:
    """As the public plane of a wind tunnel has it: x grows upstream, u positive downstream."""

    def turn(rows: list[list[str]]) -> None:
        rows[0] = ["X", "H", "V_X", "V_H"]
        for row in rows[1:]:
            x, z, u, w = (float(number) for number in row)
            row[:] = [repr((100.0 - x) / 0.3048), repr((z + 3.0) / 0.3048), repr(u / 0.514444),
                      repr(w / 0.514444)]  # fmt: skip

    layout = Layout(
        x="X", z="H", u="V_X", w="V_H", x_sign=-1, origin_x_m=100.0, origin_z_m=3.0,
        metres_per_length=0.3048, mps_per_speed=0.514444,
    )  # fmt: skip
    path = _csv(tmp_path / "turned.csv", turn)
    _is_the_hill(read_grid(path, layout, reference_wind_mps=9.0))
    with pytest.raises(GridError, match=r"x turned round \(set x_sign"):
        read_grid(path, layout._replace(x_sign=1, origin_x_m=0.0))
    read_grid(path, layout._replace(x_sign=1, origin_x_m=0.0), check_mass_balance=False)


def test_three_dimensional_csv(tmp_path: Path) -> None:
    u, _, w = _nodes_3d()
    x, y, z = np.meshgrid(X, Y, Z, indexing="ij")
    table = np.column_stack([part.ravel() for part in (x, y, z, u, 0.0 * u + 0.5, w)])
    path = tmp_path / "hill3.csv"
    np.savetxt(path, table, delimiter=",", header="x,y,z,u,v,w", comments="")
    field = read_grid(path, Layout(y="y", v="v"))
    assert field.three_dimensional
    for place in PLACES:
        u_, v_, w_ = field.wind_at(*place, 0.0)
        assert (u_, 0.0, w_) == pytest.approx(HILL.wind_at(*place, 0.0), abs=0.06)
        assert v_ == pytest.approx(0.5)
    with pytest.raises(GridError, match="occur more than once"):
        read_grid(path)  # without y, every place of the plane comes seven times


def _drop(rows: list[list[str]]) -> None:
    del rows[25]


def _repeat(rows: list[list[str]]) -> None:
    rows.append(list(rows[7]))


def _set(line: int, column: int, text: str) -> Callable[[list[list[str]]], None]:
    def change(rows: list[list[str]]) -> None:
        rows[line - 1][column] = text

    return change


def _columns(*order: int) -> Callable[[list[list[str]]], None]:
    def change(rows: list[list[str]]) -> None:
        for row in rows[1:]:
            row[:] = [row[n] for n in order]

    return change


def _scale(factor: float) -> Callable[[list[list[str]]], None]:
    def change(rows: list[list[str]]) -> None:
        for row in rows[1:]:
            row[2:] = [repr(float(number) * factor) for number in row[2:]]

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (_drop, r"1 of 400 places of the grid 20 × 20 have no row, first x = -58, z = 10"),
        (_repeat, "1 places occur more than once, e.g. in line"),
        (_set(9, 2, "nan"), "column 'u' is missing or not finite at 1 of 400 places.* line 9"),
        (_set(9, 0, "inf"), "column 'x' is missing or not finite"),
        (_set(9, 2, ""), "not a table of numbers"),
        (_set(1, 2, "v_x"), "no column 'u'; there are 'x', 'z', 'v_x', 'w'"),
        (_set(9, 0, "-59.5"), "places of the grid 21 × 20 have no row"),
        (_scale(100.0), "another unit.*mps_per_speed"),
        (_scale(0.01), "below 0.2: another unit"),
        (_scale(-1.0), "against .x.*set u_sign"),
        (_columns(0, 1, 3, 2), "are u and w swapped"),
        (lambda rows: rows.__delitem__(slice(1, None)), "0 rows"),
        (lambda rows: rows.__delitem__(slice(21, None)), "column 'x' has one value only"),
    ],
)
def test_bad_csv_is_refused_with_the_place_and_a_way_out(
    tmp_path: Path, change: Callable[[list[list[str]]], Any], message: str
) -> None:
    path = _csv(tmp_path / "bad.csv", change)
    with (
        pytest.warns() if message == "0 rows" else _nothing(),
        pytest.raises(GridError, match=message) as reported,
    ):
        read_grid(path)
    assert "bad.csv" in str(reported.value)


class _nothing:
    def __enter__(self) -> None: ...

    def __exit__(self, *_: object) -> None: ...


def test_exact_zeros_must_be_explained(tmp_path: Path) -> None:
    def still(rows: list[list[str]]) -> None:
        for row in rows[1:6]:  # x = -60, z = 2 … 10
            row[2:] = ["0", "-0.0"]

    path = _csv(tmp_path / "zeros.csv", still)
    with pytest.raises(
        GridError, match=r"exactly zero at 5 of 400 places, first at x = -60, z = 2"
    ):
        read_grid(path)
    solid = read_grid(path, zero_cells="solid")
    assert not solid.inside(-59.0, 0.0, 5.0)
    assert solid.inside(-57.0, 0.0, 5.0)
    still_air = read_grid(path, zero_cells="air")
    assert still_air.inside(-59.0, 0.0, 5.0)
    assert solid.reference_wind_mps > still_air.reference_wind_mps  # the mean over air alone


@pytest.mark.parametrize("kept", [0.0, 0.01, 0.5, 0.99])
def test_a_part_of_an_npz_file_is_refused_by_name(tmp_path: Path, kept: float) -> None:
    u, _, w = _nodes()
    path = tmp_path / "part.npz"
    np.savez_compressed(path, x=X, z=Z, u=u, w=w)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(kept * len(whole))])
    with pytest.raises(GridError, match=r"part\.npz: not an \.npz file of numbers"):
        read_grid(path)


def test_an_npz_file_with_wrong_bytes_and_a_single_array_are_refused(tmp_path: Path) -> None:
    u, _, w = _nodes()
    path = tmp_path / "odd.npz"
    np.savez_compressed(path, x=X, z=Z, u=u, w=w)
    odd = bytearray(path.read_bytes())
    for at in range(len(odd) // 3, len(odd) // 2, 7):
        odd[at] ^= 0xFF
    path.write_bytes(odd)
    with pytest.raises(GridError, match=r"odd\.npz: not an \.npz file of numbers"):
        read_grid(path)
    with path.open("wb") as file:
        np.save(file, u)
    with pytest.raises(GridError, match=r"odd\.npz: not an \.npz file of numbers"):
        read_grid(path)


def test_npz_round_trip_in_two_and_three_dimensions(tmp_path: Path) -> None:
    u, v, w = _nodes()
    plane = GridField(X, None, Z, u, None, w, reference_wind_mps=9.0)
    write_npz(tmp_path / "plane.npz", plane)
    back = read_grid(tmp_path / "plane.npz", reference_wind_mps=9.0)
    assert back.table == plane.table
    u, v, w = _nodes_3d()
    block = GridField(X, Y, Z, u, v + 0.3, w, reference_wind_mps=9.0)
    write_npz(tmp_path / "block.npz", block)
    back = read_grid(tmp_path / "block.npz", Layout(y="y", v="v"), reference_wind_mps=9.0)
    assert back.table == block.table


def test_uneven_axis_is_resampled_between_its_places(tmp_path: Path) -> None:
    z = np.array([2.0, 3.0, 5.0, 9.0, 17.0, 33.0, 41.0])
    u, _, w = HILL.wind(X[:, None], 0.0, z[None, :])
    np.savez(tmp_path / "stretched.npz", x=X, z=z, u=u, w=w)
    field = read_grid(tmp_path / "stretched.npz")
    assert field.wind_at(-44.0, 0.0, 9.0, 0.0) == pytest.approx(HILL.wind_at(-44.0, 0.0, 9.0, 0.0))
    middle = 0.5 * (np.array(HILL.wind_at(-44, 0, 17, 0)) + np.array(HILL.wind_at(-44, 0, 33, 0)))
    assert field.wind_at(-44.0, 0.0, 25.0, 0.0) == pytest.approx(tuple(middle))
    z[-1] = 1e8
    np.savez(tmp_path / "wild.npz", x=X, z=z, u=u, w=w)
    with pytest.raises(GridError, match=r"axis z is uneven .* resample it before"):
        read_grid(tmp_path / "wild.npz")


def test_air_above_the_ground_stays_air_where_an_uneven_axis_is_resampled(tmp_path: Path) -> None:
    """The places of the axis come again, as 0.09999999999999999: of no solid below or beside."""
    z = np.array([0.0, 0.1, 0.2, 0.4, 0.6])
    u, w = np.full((len(X), 5), 8.0), np.full((len(X), 5), 1.0)
    u[:, 0] = w[:, 0] = 0.0  # the ground
    np.savez(tmp_path / "ground.npz", x=X, z=z, u=u, w=w)
    field = read_grid(tmp_path / "ground.npz", zero_cells="solid")
    assert not field.inside(-44.0, 0.0, 0.05)
    assert field.inside(-44.0, 0.0, 0.15)


def test_decreasing_axis_is_turned_with_its_nodes(tmp_path: Path) -> None:
    u, _, w = _nodes()
    np.savez(tmp_path / "down.npz", x=X, z=Z[::-1], u=u[:, ::-1], w=w[:, ::-1])
    _is_the_hill(read_grid(tmp_path / "down.npz"))


def _bad_npz() -> list[tuple[dict[str, FloatArray], str]]:
    u, _, w = _nodes()
    z21 = np.append(Z, 42.0)
    u21, _, w21 = HILL.wind(X[:, None], 0.0, z21[None, :])
    unsorted, repeated, gone = X.copy(), X.copy(), u.copy()
    unsorted[[4, 5]] = unsorted[[5, 4]]
    repeated[5] = repeated[4]
    gone[3, 4] = np.nan
    return [
        ({"x": unsorted, "z": Z, "u": u, "w": w}, "axis 'x' is not sorted.*index 4"),
        ({"x": repeated, "z": Z, "u": u, "w": w}, "axis 'x' repeats -52.0 at index 4 and 5"),
        ({"x": X, "z": Z, "u": gone, "w": w}, r"array 'u' is missing.*index \(3, 4\)"),
        ({"x": X, "z": z21, "u": u21.T, "w": w21}, "its axes are swapped"),
        ({"x": X, "z": Z, "u": u.T, "w": w.T}, "axes x and z of the nodes swapped"),
        ({"x": X, "z": Z, "u": u[:-1], "w": w}, r"array 'u' is \(19, 20\), the axes \(20, 20\)"),
        ({"x": X, "z": Z, "u": u}, "no array 'w'"),
        ({"x": X[:1], "z": Z, "u": u, "w": w}, "axis 'x' has shape"),
        ({"x": X, "z": Z, "u": 0.0 * u, "w": 0.0 * w}, "exactly zero at 400 of 400"),
    ]


@pytest.mark.parametrize(
    ("arrays", "message"), _bad_npz(), ids=lambda v: v if isinstance(v, str) else ""
)
def test_bad_npz_is_refused(tmp_path: Path, arrays: dict[str, FloatArray], message: str) -> None:
    np.savez(tmp_path / "bad.npz", **arrays)  # type: ignore[arg-type]
    with pytest.raises(GridError, match=message):
        read_grid(tmp_path / "bad.npz")


def _write_netcdf(
    path: Path,
    units: str = "m s-1",
    order: str = "zx",
    records: int = 1,
    lengths: str = "m",
    mps: float = 1.0,
    metres: float = 1.0,
) -> Path:
    """mps, metres: what its units are."""
    from scipy.io import netcdf_file

    u, _, w = _nodes()
    with netcdf_file(str(path), "w") as file:
        file.createDimension("time", records)
        for name, axis in (("x", X), ("z", Z)):
            file.createDimension(name, len(axis))
            variable = file.createVariable(name, "d", (name,))
            variable[:] = axis / metres
            variable.units = lengths  # type: ignore[attr-defined]
        for name, nodes in (("u", u), ("w", w)):
            variable = file.createVariable(name, "d", ("time", *order))
            for record in range(records):
                variable[record] = (nodes.T if order == "zx" else nodes) / mps
            variable.units = units  # type: ignore[attr-defined]
    return path


@pytest.mark.parametrize("order", ["zx", "xz"])
def test_classic_netcdf_in_either_order_of_dimensions(tmp_path: Path, order: str) -> None:
    _is_the_hill(read_grid(_write_netcdf(tmp_path / "hill.nc", order=order)))


@pytest.mark.parametrize(
    ("units", "mps"),
    [("m/s", 1.0), ("m.s-1", 1.0), ("m s**-1", 1.0), ("m s^-1", 1.0), ("km/h", 1000.0 / 3600.0),
     ("km h-1", 1000.0 / 3600.0), ("cm/s", 0.01), ("cm s-1", 0.01), ("mph", 1609.344 / 3600.0),
     ("knots", 1852.0 / 3600.0), ("kt", 1852.0 / 3600.0)],
)  # fmt: skip
def test_every_unit_of_speed_has_its_scale(tmp_path: Path, units: str, mps: float) -> None:
    path = _write_netcdf(tmp_path / "wind.nc", units=units, mps=mps)
    _is_the_hill(read_grid(path, Layout(mps_per_speed=mps)))
    for wrong in (1.01 * mps, 0.5 * mps, 2.0 * mps):
        with pytest.raises(GridError, match="which needs mps_per_speed = "):
            read_grid(path, Layout(mps_per_speed=wrong))


@pytest.mark.parametrize(
    ("units", "metres"),
    [("m", 1.0), ("metres", 1.0), ("km", 1000.0), ("mm", 1e-3), ("cm", 0.01), ("ft", 0.3048)],
)
def test_every_unit_of_length_has_its_scale(tmp_path: Path, units: str, metres: float) -> None:
    path = _write_netcdf(tmp_path / "wind.nc", lengths=units, metres=metres)
    _is_the_hill(read_grid(path, Layout(metres_per_length=metres)))
    with pytest.raises(GridError, match="which needs metres_per_length = "):
        read_grid(path, Layout(metres_per_length=2.0 * metres))


def test_netcdf_is_held_to_its_units_and_to_one_time(tmp_path: Path) -> None:
    path = _write_netcdf(tmp_path / "knots.nc", units="knots")
    with pytest.raises(GridError, match=r"'knots', which needs mps_per_speed = 0\.514"):
        read_grid(path)
    read_grid(path, Layout(mps_per_speed=0.514444))
    with pytest.raises(GridError, match="'degrees_east'; known are"):
        read_grid(_write_netcdf(tmp_path / "map.nc", units="degrees_east"))
    with pytest.raises(GridError, match=r"3 places along 'time'.*cut one out"):
        read_grid(_write_netcdf(tmp_path / "times.nc", records=3))
    (tmp_path / "no.nc").write_bytes(b"PK\x03\x04")
    with pytest.raises(GridError, match="neither classic NetCDF nor NetCDF-4"):
        read_grid(tmp_path / "no.nc")


def test_netcdf_4(tmp_path: Path) -> None:
    xarray = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    u, _, w = _nodes()
    data = xarray.Dataset({"u": (("z", "x"), u.T), "w": (("z", "x"), w.T)}, coords={"x": X, "z": Z})
    data.to_netcdf(tmp_path / "hill.nc", engine="h5netcdf")
    _is_the_hill(read_grid(tmp_path / "hill.nc"))


@pytest.mark.parametrize(
    ("module", "name", "extra"),
    [
        ("xarray", "field.nc", r"tgl_soar\[netcdf\]"),
        ("pyvista", "field.vti", r"tgl_soar\[meshes\]"),
    ],
)
def test_a_missing_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, module: str, name: str, extra: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    (tmp_path / name).write_bytes(b"\x89HDF....")
    with pytest.raises(ImportError, match=extra):
        read_grid(tmp_path / name, step_m=1.0)


@pytest.mark.skipif(not importlib.util.find_spec("pyvista"), reason="needs the extra 'meshes'")
def test_mesh_is_sampled_in_any_orientation_with_holes(tmp_path: Path) -> None:
    import pyvista

    # A plane computed in mesh x and y (y up), one cell thick in z, with its low corner cut off.
    places = np.stack(np.meshgrid(X, Z, [0.0, 1.0], indexing="ij"), axis=-1)
    grid = pyvista.StructuredGrid(*(places[..., n] for n in range(3)))
    u, _, w = HILL.wind(places[..., 0], 0.0, places[..., 1])
    velocity = np.stack([u, w, 0.0 * u], axis=-1)
    grid["U"] = velocity.reshape(-1, 3, order="F")
    mesh = grid.extract_cells(np.flatnonzero(grid.cell_centers().points[:, 0] > -58.0))
    mesh.save(tmp_path / "hill.vtu")
    layout = Layout(x="x", z="y", u="U")
    field = read_grid(tmp_path / "hill.vtu", layout, step_m=1.0)
    _is_the_hill(field)
    with pytest.raises(GridError, match="give step_m"):
        read_grid(tmp_path / "hill.vtu", layout)
    with pytest.raises(GridError, match="no vector 'velocity'; there are"):
        read_grid(tmp_path / "hill.vtu", layout._replace(u="velocity"), step_m=1.0)
    with pytest.raises(GridError, match="name its axes"):
        read_grid(tmp_path / "hill.vtu", layout._replace(z="height"), step_m=1.0)


def _foam_list(kind: str, name: str, where: str, items: list[str]) -> str:
    head = (
        f"FoamFile {{ version 2.0; format ascii; class {kind}; location {where}; object {name}; }}"
    )
    return f"{head}\n{len(items)}\n(\n" + "\n".join(items) + "\n)\n"


def _write_foam(case: Path, x: FloatArray, y: FloatArray, z: FloatArray) -> Path:
    """A box of hexahedra with the hill's wind at their centres; mesh y is up, as often in 2-D."""
    nx, ny, nz = len(x) - 1, len(y) - 1, len(z) - 1
    point = np.arange((nx + 1) * (ny + 1) * (nz + 1)).reshape(nx + 1, ny + 1, nz + 1)
    cell = np.arange(nx * ny * nz).reshape(nx, ny, nz)
    inner: list[tuple[int, int, list[int]]] = []
    outer: list[tuple[int, list[int]]] = []
    for i, j, k in np.ndindex(nx, ny, nz):
        for axis, (n, here) in enumerate(((nx, i), (ny, j), (nz, k))):
            for side in (0, 1):
                low = [i, j, k]
                low[axis] += side
                one, two = [0, 0, 0], [0, 0, 0]
                one[(axis + 1) % 3], two[(axis + 2) % 3] = 1, 1
                ring = [np.array(low) + a * np.array(one) + b * np.array(two)
                        for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))]  # fmt: skip
                face = [int(point[tuple(corner)]) for corner in ring]
                if side and here + 1 < n:
                    other = [i, j, k]
                    other[axis] += 1
                    inner.append((int(cell[i, j, k]), int(cell[tuple(other)]), face))
                elif (side and here + 1 == n) or (not side and here == 0):
                    outer.append((int(cell[i, j, k]), face if side else face[::-1]))
    inner.sort(key=lambda entry: entry[:2])
    faces = [face for _, _, face in inner] + [face for _, face in outer]
    mesh = case / "constant" / "polyMesh"
    mesh.mkdir(parents=True)
    points = [f"({a:g} {b:g} {c:g})" for a in x for b in y for c in z]
    where = "polyMesh"
    lists = {
        "points": ("vectorField", points),
        "faces": ("faceList", [f"4({' '.join(map(str, face))})" for face in faces]),
        "owner": ("labelList", [str(n) for n, _, _ in inner] + [str(n) for n, _ in outer]),
        "neighbour": ("labelList", [str(n) for _, n, _ in inner]),
        "boundary": (
            "polyBoundaryMesh",
            [f"walls {{ type wall; nFaces {len(outer)}; startFace {len(inner)}; }}"],
        ),
    }
    for name, (kind, items) in lists.items():
        (mesh / name).write_text(_foam_list(kind, name, where, items))
    middle = [0.5 * (axis[1:] + axis[:-1]) for axis in (x, y, z)]
    for time, fraction in (("0", 0.0), ("100", 1.0)):
        winds = []
        for a, b, _ in ((a, b, c) for a in middle[0] for b in middle[1] for c in middle[2]):
            u, _, w = HILL.wind_at(a, 0.0, b, 0.0)
            winds.append(f"({fraction * u:.9g} {fraction * w:.9g} 0)")
        (case / time).mkdir()
        body = _foam_list("volVectorField", "U", time, winds)
        head, _, rest = body.partition("\n")
        (case / time / "U").write_text(
            f"{head}\ndimensions [0 1 -1 0 0 0 0];\n"
            f"internalField nonuniform List<vector>\n{rest};\n"
            "boundaryField { walls { type zeroGradient; } }\n"
        )
    (case / "system").mkdir()
    (case / "system" / "controlDict").write_text(
        "FoamFile { version 2.0; format ascii; class dictionary; object controlDict; }\n"
        "startFrom latestTime; endTime 100; deltaT 1; writeControl timeStep; writeInterval 100;\n"
    )
    (case / "hill.foam").write_text("")
    return case / "hill.foam"


@pytest.mark.skipif(not importlib.util.find_spec("pyvista"), reason="needs the extra 'meshes'")
def test_openfoam_case_is_read_at_its_last_time(tmp_path: Path) -> None:
    x, y = np.arange(-61.0, -20.0, 2.0), np.arange(1.0, 42.0, 2.0)
    foam = _write_foam(tmp_path / "case", x, y, np.array([0.0, 1.0]))
    field = read_grid(foam, Layout(x="x", z="y", u="U"), step_m=1.0, zero_cells="refuse")
    for place in PLACES:
        # Cells to points and points to grid: twice the error of one interpolation.
        assert field.wind_at(*place, 0.0) == pytest.approx(HILL.wind_at(*place, 0.0), abs=0.12)


def test_unknown_formats_and_missing_files(tmp_path: Path) -> None:
    with pytest.raises(GridError, match=r"'\.txt' is not known; one of \.csv"):
        read_grid(tmp_path / "field.txt")
    with pytest.raises(GridError, match="no such file"):
        read_grid(tmp_path / "field.csv")
    (tmp_path / "field.npz").write_text("no archive")
    with pytest.raises(GridError, match=r"not an \.npz file"):
        read_grid(tmp_path / "field.npz")
    with pytest.raises(GridError, match="x_sign = 2"):
        read_grid(tmp_path / "field.csv", Layout(x_sign=2))
