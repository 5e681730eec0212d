"""Wind grids from files: each name of a layout, each unit, each sign and each bound of a number."""

from __future__ import annotations

from math import inf, nan
from pathlib import Path

import numpy as np
import pytest

from tgl_soar.air.field import FloatArray
from tgl_soar.air.grid import GridError, GridField, GridTable3D
from tgl_soar.air.grid_files import (
    _LENGTH_UNITS,
    _SPEED_UNITS,
    Layout,
    _axis_of,
    _check_units,
    _distinct,
    read_grid,
    write_npz,
)

# A plane and a block whose air has no sources: du/dx + dv/dy + dw/dz = 1 + 2 - 3.
X, Y, Z = np.array([-4.0, -2.0, 0.0]), np.array([-1.0, 0.0, 1.0, 2.0]), np.array([1.0, 1.5])
XX, YY, ZZ = np.meshgrid(X, Y, Z, indexing="ij")
U, V, W = 9.0 + XX, 2.0 * YY + 0.5, -3.0 * ZZ


def csv(path: Path, header: str, *columns: FloatArray) -> Path:
    table = np.column_stack([column.ravel() for column in columns])
    lines = [",".join(f"{number:.9g}" for number in row) for row in table]
    path.write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return path


def block(path: Path) -> Path:
    return csv(path, "x,y,z,u,v,w", XX, YY, ZZ, U, V, W)


BLOCK = Layout(y="y", v="v")


def nodes(field: GridField) -> FloatArray:
    """(u, v, w) of all nodes of a block."""
    return np.asarray(field.table.values, dtype=np.float64).reshape(3, 4, 2, 3)


# --- a layout -----------------------------------------------------------------------------------


def test_a_layout_is_of_metres_and_metres_a_second_downstream_unless_it_is_said() -> None:
    usual = Layout()
    assert (usual.x, usual.z, usual.u, usual.w, usual.y, usual.v) == (*"xzuw", None, None)
    assert (usual.x_sign, usual.u_sign, usual.y_sign, usual.v_sign) == (1, 1, 1, 1)
    assert (usual.origin_x_m, usual.origin_y_m, usual.origin_z_m) == (0.0, 0.0, 0.0)
    assert (usual.metres_per_length, usual.mps_per_speed) == (1.0, 1.0)


def test_every_axis_and_part_of_a_block_has_its_own_place(tmp_path: Path) -> None:
    field = read_grid(block(tmp_path / "block.csv"), BLOCK)
    assert field.table[:9] == (-4.0, 2.0, 3, -1.0, 1.0, 4, 1.0, 0.5, 2)
    assert nodes(field) == pytest.approx(np.stack([U, V, W], axis=-1))
    assert field.reference_wind_mps == pytest.approx(7.0)  # the mean of u
    assert field.name.endswith("block.csv")
    assert field.outside == "nan"
    assert not field.solid.any()
    assert read_grid(tmp_path / "block.csv", BLOCK, reference_wind_mps=3.0).reference_wind_mps == 3
    assert read_grid(tmp_path / "block.csv", BLOCK, outside="still").outside == "still"


@pytest.mark.parametrize(
    ("change", "axes", "parts"),
    [
        # x = sign · (X · scale − origin): turned axes begin at their other end.
        ({"origin_x_m": 10.0}, (-14.0, -1.0, 1.0), (1, 1, 1)),
        ({"origin_y_m": 10.0}, (-4.0, -11.0, 1.0), (1, 1, 1)),
        ({"origin_z_m": 10.0}, (-4.0, -1.0, -9.0), (1, 1, 1)),
        ({"y_sign": -1}, (-4.0, -2.0, 1.0), (1, 1, 1)),
        ({"y_sign": -1, "origin_y_m": 10.0}, (-4.0, 8.0, 1.0), (1, 1, 1)),
        ({"x_sign": -1, "origin_x_m": 10.0}, (10.0, -1.0, 1.0), (1, 1, 1)),
        ({"v_sign": -1}, (-4.0, -1.0, 1.0), (1, -1, 1)),
        ({"mps_per_speed": 0.5}, (-4.0, -1.0, 1.0), (0.5, 0.5, 0.5)),
        ({"metres_per_length": 10.0, "origin_x_m": 1.0}, (-41.0, -10.0, 10.0), (1, 1, 1)),
    ],
)
def test_signs_origins_and_scales_act_on_their_own(
    tmp_path: Path,
    change: dict[str, float],
    axes: tuple[float, float, float],
    parts: tuple[float, float, float],
) -> None:
    layout = BLOCK._replace(**change)  # type: ignore[arg-type]
    field = read_grid(block(tmp_path / "block.csv"), layout, check_mass_balance=False)
    assert isinstance(field.table, GridTable3D)
    assert (field.table[0], field.table[3], field.table[6]) == pytest.approx(axes)
    step = 10.0 if "metres_per_length" in change else 1.0
    assert (field.table[1], field.table[4], field.table[7]) == pytest.approx(
        (2.0 * step, step, 0.5 * step)
    )
    expected = np.stack([U, V, W], axis=-1) * parts
    if layout.y_sign < 0:
        expected = expected[:, ::-1]
    if layout.x_sign < 0:
        expected = expected[::-1]
    assert nodes(field) == pytest.approx(expected)


def test_a_wind_that_counts_upstream_is_turned(tmp_path: Path) -> None:
    path = csv(tmp_path / "up.csv", "x,y,z,u,v,w", XX, YY, ZZ, -U, V, W)
    field = read_grid(path, BLOCK._replace(u_sign=-1), check_mass_balance=False)
    assert nodes(field)[..., 0] == pytest.approx(U)


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        *((name, value, "must be 1 or -1") for name in ("x_sign", "u_sign", "y_sign", "v_sign")
          for value in (0, 2, -2)),
        *((name, value, "must be positive") for name in ("metres_per_length", "mps_per_speed")
          for value in (0.0, -1.0, inf, nan)),
        *((name, value, "must be finite") for name in ("origin_x_m", "origin_y_m", "origin_z_m")
          for value in (inf, nan)),
    ],
)  # fmt: skip
def test_each_number_of_a_layout_is_held_to_its_bounds(
    tmp_path: Path, name: str, value: float, says: str
) -> None:
    path = block(tmp_path / "block.csv")
    with pytest.raises(GridError, match=rf"block\.csv: layout {name} = {value}; {says}"):
        read_grid(path, BLOCK._replace(**{name: value}))  # type: ignore[arg-type]


def test_small_scales_are_taken(tmp_path: Path) -> None:
    path = csv(tmp_path / "cm.csv", "x,y,z,u,v,w", XX, YY, ZZ, 100 * U, 100 * V, 100 * W)
    field = read_grid(path, BLOCK._replace(mps_per_speed=0.01, metres_per_length=0.01))
    assert field.table[0] == pytest.approx(-0.04)
    assert nodes(field)[..., 2] == pytest.approx(W)


# --- a CSV file ---------------------------------------------------------------------------------


def plane(path: Path, header: str = "x,z,u,w") -> Path:
    x, z = np.meshgrid(X, Z, indexing="ij")
    return csv(path, header, x, z, 9.0 + x, -1.0 * z)


def test_a_header_may_have_blanks_and_a_byte_order_mark(tmp_path: Path) -> None:
    path = plane(tmp_path / "plane.csv", " x , z,u ,w")
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    field = read_grid(str(path))
    assert field.table[:6] == (-4.0, 2.0, 3, 1.0, 0.5, 2)
    assert field.wind_at(-2.0, 5.0, 1.5, 0.0) == pytest.approx((7.0, 0.0, -1.5))
    assert not field.three_dimensional


def test_a_cross_wind_of_a_plane_is_read_where_it_is_named(tmp_path: Path) -> None:
    x, z = np.meshgrid(X, Z, indexing="ij")
    path = csv(tmp_path / "cross.csv", "x,z,u,v,w", x, z, 9.0 + x, 0.25 * x, -1.0 * z)
    for layout, v in ((Layout(v="v"), -0.5), (Layout(v="v", v_sign=-1), 0.5), (Layout(), 0.0)):
        assert read_grid(path, layout).wind_at(-2.0, 0.0, 1.0, 0.0) == pytest.approx((7.0, v, -1.0))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x,z,u\n1,2,3,4\n", "1 rows of 4 numbers under 3 names"),
        ("x,z,u,w\n1,2,3,4\n", "column 'x' has one value only"),
        ("x,z,u,w\n0,0,1,1\n0,1,1,1\n1,0,nan,1\n1,1,1,1\n", r"'u' is .* at 1 of 4 .* at line 4;"),
        ("x,z,u,w\n0,0,1,1\n0,1,1,1\n1,0,1,1\n1,inf,1,1\n", r"'z' is .* at 1 of 4 .* at line 5;"),
        ("x,z,u,w\n0,0,1,1\n0,1,1,1\n0,2,1,1\n", "column 'x' has one value only; an axis needs"),
        ("x,z,u,w\n0,3,1,1\n1,3,1,1\n2,3,1,1\n", "column 'z' has one value only"),
        ("x,z,u,w\n0,0,1,1\n0,1,1,1\n1,0,1,1\n1,1,1,1\n0,1,2,1\n1,1,2,1\n",
         "2 places occur more than once, e.g. in line 5: x = 1, z = 1; keep one row a place"),
        ("x,z,u,w\n0,0,1,1\n0,1,1,1\n1,0,1,1\n2,0,1,1\n2,1,1,1\n",
         "1 of 6 places of the grid 3 × 2 have no row, first x = 1, z = 1; fill the holes"),
        ("x,z,u,w\n0,0,1,1\n1,zero,1,1\n", "not a table of numbers: line 3: z = 'zero'$"),
        ("x,z,u,w\n\n# so\n0,0,1,1\n1,1,1,\n", "not a table of numbers: line 5: w = ''$"),
        ("x,z,u,w\n0,0,1,1\n1,1,1\n", "numbers: line 3 has 3 values under 4 names$"),
        ("x,z,u,w\n\n0,0,1,1\n0,1,1,1\n#\n1,0,nan,1\n1,1,1,1\n", "at 1 of 4 .* at line 6;"),
        ("x,z,u,w\n\n0,0,1,1 # so\n0,1,1,1\n1,0,1,1\n1,1,1,1\n\n0,1,2,1\n", "e.g. in line 8: "),
    ],
)  # fmt: skip
def test_a_bad_csv_is_refused_with_line_and_place(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(GridError, match=rf"bad\.csv: .*{says}"):
        read_grid(path)


def test_what_is_no_text_is_reported(tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_bytes(b"\xff\xfe\x00x")
    with pytest.raises(GridError, match="not UTF-8 text; is it a CSV file"):
        read_grid(tmp_path / "bad.csv")


def test_places_that_differ_by_rounding_are_one() -> None:
    """By a millionth of the whole: of ten metres 10 micrometres."""
    near = np.array([10.0, 0.0, 9e-6, 5.0, 5.0 - 9e-6, 10.0 + 9e-6])
    axis, index = _distinct(near)
    assert axis == pytest.approx([4.5e-6, 5.0 - 4.5e-6, 10.0 + 4.5e-6], abs=1e-12)
    assert index.tolist() == [2, 0, 0, 1, 1, 2]
    axis, index = _distinct(np.array([10.0, 0.0, 12e-6]))
    assert axis.tolist() == [0.0, 12e-6, 10.0]
    assert index.tolist() == [2, 0, 1]
    axis, index = _distinct(np.array([3.0, 3.0]))
    assert (axis.tolist(), index.tolist()) == ([3.0], [0, 0])


# --- axes of other files ------------------------------------------------------------------------


@pytest.mark.parametrize("values", [[0.0, 1.0, 5.0], [5.0, 1.0, 0.0], [1.0, 2.0]])
def test_an_axis_grows_or_falls(values: list[float]) -> None:
    assert _axis_of(Path("a.npz"), "x", np.array(values)).tolist() == values


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ([1.0], r"axis 'x' has shape \(1,\); it must be a row of two at least"),
        ([[1.0, 2.0]], r"axis 'x' has shape \(1, 2\)"),
        ([1.0, nan, 3.0], r"axis 'x' is missing or not finite at 1 of 3 places, first at index 1"),
        ([1.0, 2.0, 2.0, 3.0], r"axis 'x' repeats 2\.0 at index 1 and 2"),
        (
            [1.0, 2.0, 3.0, 2.5],
            r"axis 'x' is not sorted: 3\.0 at index 2 is followed by 2\.5; sort it",
        ),
        ([3.0, 2.0, 2.5, 1.0], r"axis 'x' is not sorted: 2\.0 at index 1 is followed by 2\.5"),
    ],
)
def test_an_axis_that_is_none_is_refused_with_its_places(values: object, says: str) -> None:
    with pytest.raises(GridError, match=rf"^a\.npz: {says}"):
        _axis_of(Path("a.npz"), "x", np.array(values))


LENGTHS = {"m": 1.0, "metre": 1.0, "meter": 1.0, "metres": 1.0, "meters": 1.0, "km": 1000.0,
           "mm": 0.001, "cm": 0.01, "ft": 0.3048}  # fmt: skip
# Of a mile of 1609.344 m and a nautical one of 1852 m in an hour.
SPEEDS = {"m/s": 1.0, "m s-1": 1.0, "m.s-1": 1.0, "m s**-1": 1.0, "m s^-1": 1.0,
          "km/h": 1000 / 3600, "km h-1": 1000 / 3600, "cm/s": 0.01, "cm s-1": 0.01,
          "mph": 1609.344 / 3600, "knots": 1852 / 3600, "kt": 1852 / 3600}  # fmt: skip


@pytest.mark.parametrize(
    ("known", "table", "option"),
    [(_LENGTH_UNITS, LENGTHS, "metres_per_length"), (_SPEED_UNITS, SPEEDS, "mps_per_speed")],
)
def test_units_are_these_to_a_thousandth_of_their_scale(
    known: dict[str, float], table: dict[str, float], option: str
) -> None:
    assert set(known) == set(table)
    path = Path("a.nc")
    for unit, scale in table.items():
        for factor in (1.0, 1.0009, 0.9991):
            _check_units(path, "x", f" {unit} ", known, scale * factor)
        for factor in (1.0011, 0.9989, 2.0, 0.1):
            with pytest.raises(GridError, match=rf"'x' is in .*, which needs {option} = "):
                _check_units(path, "x", unit, known, scale * factor)
    _check_units(path, "x", " ", known, 7.0)  # a file that says nothing
    with pytest.raises(GridError, match=r"'x' is in 'furlongs'; known are .*\(a map in degrees"):
        _check_units(path, "x", "furlongs", known, 1.0)


# --- archives -----------------------------------------------------------------------------------


def test_what_is_written_are_places_and_parts_by_their_names(tmp_path: Path) -> None:
    field = read_grid(block(tmp_path / "block.csv"), BLOCK)
    write_npz(tmp_path / "block.npz", field)
    with np.load(tmp_path / "block.npz") as file:
        found = {name: file[name] for name in file.files}
    assert sorted(found) == sorted("xyzuvw")
    for name, expected in zip("xyzuvw", (X, Y, Z, U, V, W), strict=True):
        assert found[name] == pytest.approx(expected), name
    flat = read_grid(plane(tmp_path / "plane.csv"))
    write_npz(tmp_path / "plane.npz", flat)
    with np.load(tmp_path / "plane.npz") as file:
        found = {name: file[name] for name in file.files}
    assert sorted(found) == sorted("xzuw")
    assert (found["x"].tolist(), found["z"].tolist()) == (X.tolist(), Z.tolist())
    assert found["u"] == pytest.approx(np.array([[9.0 + x] * 2 for x in X]))
    assert found["w"] == pytest.approx(np.array([[-1.0, -1.5]] * 3))


def test_both_falling_axes_are_turned_with_their_nodes(tmp_path: Path) -> None:
    path = tmp_path / "down.npz"
    np.savez(path, x=X[::-1], y=Y[::-1], z=Z, u=U[::-1, ::-1], v=V[::-1, ::-1], w=W[::-1, ::-1])
    field = read_grid(path, BLOCK)
    assert field.table[:9] == (-4.0, 2.0, 3, -1.0, 1.0, 4, 1.0, 0.5, 2)
    assert nodes(field) == pytest.approx(np.stack([U, V, W], axis=-1))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"v": V[:2]}, r"array 'v' is \(2, 4, 2\), the axes \(3, 4, 2\)$"),
        ({"w": W.T}, r"array 'w' is \(2, 4, 3\), the axes \(3, 4, 2\); its axes are swapped"),
        ({"v": np.where(YY > 1.5, nan, V)}, r"array 'v' is .* at 6 of 24 places, first at index"),
        ({"y": Y[:1]}, r"axis 'y' has shape \(1,\)"),
    ],
)
def test_a_block_that_does_not_fit_is_refused(
    tmp_path: Path, change: dict[str, FloatArray], says: str
) -> None:
    arrays = {"x": X, "y": Y, "z": Z, "u": U, "v": V, "w": W, **change}
    np.savez(tmp_path / "bad.npz", **arrays)
    with pytest.raises(GridError, match=says):
        read_grid(tmp_path / "bad.npz", BLOCK)


def test_words_are_no_numbers(tmp_path: Path) -> None:
    np.savez(tmp_path / "bad.npz", x=np.array(["a", "b"]))
    with pytest.raises(GridError, match=r"not an \.npz file of numbers"):
        read_grid(tmp_path / "bad.npz")


# --- what is no air -----------------------------------------------------------------------------


def with_zeros(path: Path, *parts: FloatArray) -> Path:
    u, v, w = (np.where((XX < -3.0) & (ZZ < 1.2), 0.0, part) for part in (U, V, W))
    for mine, given in zip((u, v, w), parts, strict=False):
        mine[:] = given
    return csv(path, "x,y,z,u,v,w", XX, YY, ZZ, u, v, w)


def test_places_without_any_wind_are_counted_and_the_first_is_named(tmp_path: Path) -> None:
    path = with_zeros(tmp_path / "zeros.csv")
    with pytest.raises(
        GridError, match=r"zero at 4 of 24 places, first at x = -4, y = -1, z = 1 m"
    ):
        read_grid(path, BLOCK)
    solid = read_grid(path, BLOCK, zero_cells="solid")
    assert solid.solid.sum() == 4
    assert solid.solid[0, :, 0].all()
    air = read_grid(path, BLOCK, zero_cells="air")
    assert not air.solid.any()
    # Twenty places of air have the sum of 24 less four of 5 m/s.
    assert solid.reference_wind_mps == pytest.approx((24 * 7.0 - 4 * 5.0) / 20)
    assert air.reference_wind_mps == pytest.approx((24 * 7.0 - 4 * 5.0) / 24)


@pytest.mark.parametrize("part", [0, 1, 2])
def test_a_wind_along_one_axis_alone_is_a_wind(tmp_path: Path, part: int) -> None:
    """Where two parts are zero, the third is not."""
    winds = [np.where(XX < -3.0, 0.0, each) for each in (U, V, W)]
    winds[part] = np.where(XX < -3.0, 2.0, (U, V, W)[part])
    path = csv(tmp_path / "one.csv", "x,y,z,u,v,w", XX, YY, ZZ, *winds)
    assert not read_grid(path, BLOCK, zero_cells="solid").solid.any()


def test_nothing_but_solid_is_no_field(tmp_path: Path) -> None:
    path = csv(tmp_path / "rock.csv", "x,y,z,u,v,w", XX, YY, ZZ, 0 * U, 0 * V, 0 * W)
    with pytest.raises(GridError, match=r"rock\.csv: no place of the grid is air"):
        read_grid(path, BLOCK, zero_cells="solid")


def test_mass_of_a_block_is_judged_with_its_cross_wind(tmp_path: Path) -> None:
    x, y, z = np.arange(0.0, 6.0), np.arange(0.0, 5.0), np.arange(0.0, 7.0)
    xx, yy, zz = np.meshgrid(x, y, z, indexing="ij")
    path = tmp_path / "mass.csv"

    def made(v: FloatArray) -> Path:
        return csv(path, "x,y,z,u,v,w", xx, yy, zz, 9.0 + 0.2 * xx, v, 0.8 * zz)

    assert read_grid(made(-1.0 * yy), BLOCK).three_dimensional
    with pytest.raises(GridError, match=r"but would be with y turned round \(set y_sign"):
        read_grid(made(1.0 * yy), BLOCK)
    assert read_grid(path, BLOCK, check_mass_balance=False).three_dimensional


@pytest.mark.parametrize("step", [None, 0.0, -1.0, inf, nan])
def test_a_mesh_needs_a_spacing(tmp_path: Path, step: float | None) -> None:
    (tmp_path / "mesh.vtu").write_text("")
    with pytest.raises(GridError, match=r"mesh\.vtu: give step_m"):
        read_grid(tmp_path / "mesh.vtu", step_m=step)


def test_every_format_is_named_where_one_is_not_known(tmp_path: Path) -> None:
    known = r"\.csv \.foam \.nc \.npz \.vti \.vtk \.vtr \.vts \.vtu"
    with pytest.raises(GridError, match=rf"format '\.xls' is not known; one of {known}$"):
        read_grid(tmp_path / "grid.xls")
    with pytest.raises(GridError, match=r"format '\(none\)' is not known"):
        read_grid(tmp_path / "grid")
    with pytest.raises(GridError, match="no such file"):
        read_grid(tmp_path / "grid.CSV")
