"""Wind grids from files: CSV, `.npz`, NetCDF, and VTK or OpenFOAM.

A `Layout` says what is what in the file and how it is turned into the soaring frame:

    x = x_sign · (X · metres_per_length − origin_x_m)        u = u_sign · U · mps_per_speed

and so for y, v and z, w (never flipped).  x_sign and u_sign are apart because files are not
always consistent: a plane whose x grows upstream may still count its wind positive downstream.

What is read is checked before it is used, and refused with the file, the place and a way out:
holes, numbers that are not finite, axes that repeat or turn, exact zeros that stand for solid,
speeds that cannot be wind, and axes or signs under which mass is not conserved though it would
be under others.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any, Literal, NamedTuple
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import FloatArray
from tgl_soar.air.grid import GridError, GridField, GridTable3D, Outside
from tgl_soar.air.grid_checks import MOST_NODES, check_mass, check_speeds, even_out

ZeroCells = Literal["refuse", "solid", "air"]


class Layout(NamedTuple):
    """Names in the file, signs, origin and units."""

    x: str = "x"
    z: str = "z"
    u: str = "u"
    w: str = "w"
    y: str | None = None  # None: a two-dimensional field
    v: str | None = None  # None: no cross wind
    x_sign: int = 1
    u_sign: int = 1
    y_sign: int = 1
    v_sign: int = 1
    origin_x_m: float = 0.0  # where the soaring frame's origin lies in the file's axes
    origin_y_m: float = 0.0
    origin_z_m: float = 0.0
    metres_per_length: float = 1.0
    mps_per_speed: float = 1.0


class _Raw(NamedTuple):
    """A grid as read: axes and nodes, axis order x, (y,) z; in the file's own units."""

    axes: tuple[FloatArray, ...]
    u: FloatArray
    v: FloatArray | None
    w: FloatArray
    hole: NDArray[np.bool_]  # nodes that the file itself marks as no air


def read_grid(
    path: str | Path,
    layout: Layout | None = None,
    *,
    reference_wind_mps: float | None = None,
    zero_cells: ZeroCells = "refuse",
    outside: Outside = "nan",
    check_mass_balance: bool = True,
    step_m: float | None = None,
) -> GridField:
    """Read a wind field from .csv, .npz, .nc, or .vtk/.vti/.vtr/.vts/.vtu/.foam.

    reference_wind_mps: the wind that names the field; default the mean of u over its air.
    zero_cells: what nodes with exactly no wind are: "refuse" them, "solid", or still "air".
    step_m: for VTK and OpenFOAM, the spacing at which the mesh is sampled (required); nodes
    off the mesh are solid.  Of an OpenFOAM case (an empty file NAME.foam in its folder) the last
    time is read.  An uneven axis is resampled linearly at its least spacing.
    check_mass_balance: refuse axes or signs that another choice would mend (`grid_checks`).
    Errors: `GridError`; ImportError naming the extra that a format needs.
    """
    path = Path(path)
    layout = layout or Layout()
    _check_layout(path, layout)
    suffix = path.suffix.lower()
    if suffix not in _MESHES and suffix not in _READERS:
        known = " ".join(sorted([*_READERS, *_MESHES]))
        raise GridError(f"{path}: format {suffix or '(none)'!r} is not known; one of {known}")
    if not path.is_file():
        raise GridError(f"{path}: no such file")
    read = _READERS.get(suffix)
    raw = read(path, layout) if read else _read_mesh(path, layout, step_m)
    return _field(path, layout, raw, reference_wind_mps, zero_cells, outside, check_mass_balance)


def write_npz(path: str | Path, field: GridField) -> None:
    """Write a grid field as `.npz` with the names of the default layout (y, v where it is 3-D).

    Solid nodes are written as exact zeros: read them back with zero_cells="solid".
    """
    table = field.table
    nodes = np.asarray(table.values, dtype=np.float64)
    x = table.x0_m + table.dx_m * np.arange(table.nx)
    z = table.z0_m + table.dz_m * np.arange(table.nz)
    if isinstance(table, GridTable3D):
        y = table.y0_m + table.dy_m * np.arange(table.ny)
        nodes = nodes.reshape(len(x), len(y), len(z), 3)
        np.savez_compressed(path, x=x, y=y, z=z, u=nodes[..., 0], v=nodes[..., 1], w=nodes[..., 2])
        return
    nodes = nodes.reshape(len(x), len(z), 2)
    np.savez_compressed(path, x=x, z=z, u=nodes[..., 0], w=nodes[..., 1])


# --- Formats -----------------------------------------------------------------------------


def _read_csv(path: Path, layout: Layout) -> _Raw:
    with path.open(encoding="utf-8-sig") as file:
        try:
            header = [name.strip() for name in file.readline().split(",")]
            table = {n: text for n, line in enumerate(file, 2) if (text := _uncommented(line))}
        except UnicodeDecodeError:
            raise GridError(f"{path}: not UTF-8 text; is it a CSV file?") from None
    lines = list(table)  # as an editor counts them
    try:
        rows = np.loadtxt([*table.values()], delimiter=",", ndmin=2, dtype=np.float64)
    except ValueError as error:
        what = _first_bad(table, header) or str(error)
        raise GridError(f"{path}: not a table of numbers: {what}") from None
    if rows.shape[0] == 0 or rows.shape[1] != len(header):
        raise GridError(
            f"{path}: {rows.shape[0]} rows of {rows.shape[1]} numbers under {len(header)} names"
        )
    columns = {name: rows[:, n] for n, name in enumerate(header)}
    names = [layout.x, *([layout.y] if layout.y else []), layout.z]
    places = [_named(path, columns, name, "column") for name in names]
    for name, place in zip(names, places, strict=True):
        _finite(path, f"column {name!r}", place, "line", lines)
    axes, index = [], []
    for place in places:
        axis, nodes = _distinct(place)
        axes.append(axis)
        index.append(nodes)
    shape = tuple(len(axis) for axis in axes)
    if min(shape) < 2:
        name = names[shape.index(min(shape))]
        raise GridError(f"{path}: column {name!r} has one value only; an axis needs two at least")
    flat = np.ravel_multi_index(index, shape)
    count = np.bincount(flat, minlength=int(np.prod(shape)))
    if (count > 1).any():
        row = int(np.flatnonzero(count[flat] > 1)[1])
        raise GridError(
            f"{path}: {int((count > 1).sum())} places occur more than once, e.g. in line"
            f" {lines[row]}: {_where(names, [place[row] for place in places])}; keep one row a"
            " place"
        )
    if (count == 0).any():
        hole = np.unravel_index(int(np.flatnonzero(count == 0)[0]), shape)
        raise GridError(
            f"{path}: {int((count == 0).sum())} of {count.size} places of the grid"
            f" {' × '.join(map(str, shape))} have no row, first"
            f" {_where(names, [axis[n] for axis, n in zip(axes, hole, strict=True)])}; fill the"
            " holes (0 and zero_cells='solid' where there is no air) or cut the grid"
        )

    def nodes_of(name: str) -> FloatArray:
        values = _named(path, columns, name, "column")
        _finite(path, f"column {name!r}", values, "line", lines)
        result = np.empty(count.size)
        result[flat] = values
        return result.reshape(shape)

    v = nodes_of(layout.v) if layout.v else None
    return _Raw(
        axes=tuple(axes),
        u=nodes_of(layout.u),
        v=v,
        w=nodes_of(layout.w),
        hole=np.zeros(shape, dtype=bool),
    )


def _uncommented(line: str) -> str:
    return line.partition("#")[0].strip()


def _first_bad(table: Mapping[int, str], header: list[str]) -> str:
    """The first line that has no number for each name; "" if all have."""
    for line, text in table.items():
        fields = [field.strip() for field in text.split(",")]
        if len(fields) != len(header):
            return f"line {line} has {len(fields)} values under {len(header)} names"
        for name, field in zip(header, fields, strict=True):
            try:
                float(field)
            except ValueError:
                return f"line {line}: {name} = {field!r}"
    return ""


def _read_npz(path: Path, layout: Layout) -> _Raw:
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name], dtype=np.float64) for name in file.files}
    except (ValueError, OSError, EOFError, TypeError, BadZipFile, zlib.error) as error:
        raise GridError(f"{path}: not an .npz file of numbers: {error}") from None
    axes = tuple(
        _axis_of(path, name, _named(path, arrays, name, "array"))
        for name in (layout.x, *([layout.y] if layout.y else []), layout.z)
    )
    shape = tuple(len(axis) for axis in axes)

    def nodes_of(name: str) -> FloatArray:
        nodes = _named(path, arrays, name, "array")
        if nodes.shape != shape:
            hint = ""
            if sorted(nodes.shape) == sorted(shape):
                hint = "; its axes are swapped: the order is x, (y,) z"
            raise GridError(f"{path}: array {name!r} is {nodes.shape}, the axes {shape}{hint}")
        _finite(path, f"array {name!r}", nodes, "index")
        return np.asarray(nodes, dtype=np.float64)

    v = nodes_of(layout.v) if layout.v else None
    return _Raw(
        axes=axes, u=nodes_of(layout.u), v=v, w=nodes_of(layout.w), hole=np.zeros(shape, dtype=bool)
    )


class _Variable(NamedTuple):
    dimensions: tuple[str, ...]
    values: FloatArray
    units: str


def _read_netcdf(path: Path, layout: Layout) -> _Raw:
    with path.open("rb") as file:
        magic = file.read(4)
    if magic[:3] == b"CDF":
        variables = _netcdf_classic(path)
    elif magic == b"\x89HDF":
        variables = _netcdf_4(path)
    else:
        raise GridError(f"{path}: neither classic NetCDF nor NetCDF-4 (begins with {magic!r})")
    names = (layout.x, *([layout.y] if layout.y else []), layout.z)
    axes, order = [], []
    for name in names:
        variable = _named(path, variables, name, "variable")
        _check_units(path, name, variable.units, _LENGTH_UNITS, layout.metres_per_length)
        axes.append(_axis_of(path, name, variable.values))
        order.append(variable.dimensions[0])

    def nodes_of(name: str) -> FloatArray:
        variable = _named(path, variables, name, "variable")
        _check_units(path, name, variable.units, _SPEED_UNITS, layout.mps_per_speed)
        values, dimensions = variable.values, variable.dimensions
        for extra in [dimension for dimension in dimensions if dimension not in order]:
            n = dimensions.index(extra)
            if values.shape[n] != 1:
                raise GridError(
                    f"{path}: variable {name!r} has {values.shape[n]} places along {extra!r},"
                    f" which is no axis here ({', '.join(order)}); cut one out first, or name y"
                )
            values = values.squeeze(axis=n)
            dimensions = tuple(d for d in dimensions if d != extra)
        if sorted(dimensions) != sorted(order):
            raise GridError(
                f"{path}: variable {name!r} has dimensions {dimensions}, the axes {order}"
            )
        values = values.transpose([dimensions.index(dimension) for dimension in order])
        _finite(path, f"variable {name!r}", values, "index")
        return np.asarray(values, dtype=np.float64)

    v = nodes_of(layout.v) if layout.v else None
    u = nodes_of(layout.u)
    return _Raw(
        axes=tuple(axes), u=u, v=v, w=nodes_of(layout.w), hole=np.zeros(u.shape, dtype=bool)
    )


def _netcdf_classic(path: Path) -> dict[str, _Variable]:
    from scipy.io import netcdf_file

    with netcdf_file(str(path), "r", mmap=False, maskandscale=True) as file:
        return {
            name: _Variable(
                tuple(variable.dimensions),
                np.ma.filled(np.ma.asarray(variable[:], dtype=np.float64), np.nan),
                _text(getattr(variable, "units", "")),
            )
            for name, variable in file.variables.items()
            if variable.typecode() in "bhilfd"
        }


def _netcdf_4(path: Path) -> dict[str, _Variable]:
    try:
        import xarray
    except ImportError:
        raise ImportError(
            f"{path}: NetCDF-4 needs xarray and h5netcdf: pip install 'tgl_soar[netcdf]'"
            " (classic NetCDF does not; `nccopy -k classic` converts)"
        ) from None
    with xarray.open_dataset(path, engine="h5netcdf", decode_times=False) as data:
        return {
            str(name): _Variable(
                tuple(str(d) for d in variable.dims),
                np.asarray(variable.values, dtype=np.float64),
                _text(variable.attrs.get("units", "")),
            )
            for name, variable in data.variables.items()
            if np.issubdtype(variable.dtype, np.number)
        }


_MESHES = (".vtk", ".vti", ".vtr", ".vts", ".vtu", ".foam")


def _read_mesh(path: Path, layout: Layout, step_m: float | None) -> _Raw:
    """Sample the velocity vector `layout.u` (say "U") of a mesh on a regular grid.

    `layout.x`, `.y`, `.z` name the mesh's axes that become x, y, z, e.g. x="x", z="y" for a
    plane computed in x and y; without y, the middle of the third axis is sampled.
    """
    if step_m is None or not (isfinite(step_m) and step_m > 0.0):
        raise GridError(f"{path}: give step_m, the spacing at which the mesh is to be sampled")
    try:
        import pyvista
    except ImportError:
        raise ImportError(
            f"{path}: VTK and OpenFOAM need pyvista: pip install 'tgl_soar[meshes]'"
        ) from None
    names = (layout.x, layout.y, layout.z)
    number = ["xyz".find(name) if name else -1 for name in names]
    given = [n for n, name in zip(number, names, strict=True) if name]
    if min(given) < 0 or len(set(given)) != len(given):
        raise GridError(f"{path}: in a mesh, layout x, y, z name its axes 'x', 'y', 'z': {names}")
    if number[1] < 0:
        number[1] = ({0, 1, 2} - {number[0], number[2]}).pop()
    reader = pyvista.get_reader(path)
    if path.suffix.lower() == ".foam" and reader.time_values:
        reader.set_active_time_value(reader.time_values[-1])  # the converged state
    mesh = reader.read()
    if isinstance(mesh, pyvista.MultiBlock):  # OpenFOAM: the walls are blocks of their own
        mesh = mesh["internalMesh"] if "internalMesh" in mesh.keys() else mesh.combine()  # noqa: SIM118
    if layout.u not in mesh.point_data:
        mesh = mesh.cell_data_to_point_data()
    if layout.u not in mesh.point_data:
        raise GridError(
            f"{path}: no vector {layout.u!r}; there are {sorted(mesh.point_data.keys())}: set"
            " layout u to the velocity's name"
        )
    step = step_m / layout.metres_per_length
    axes: list[FloatArray] = []
    for n in range(3):
        low, high = mesh.bounds[2 * n], mesh.bounds[2 * n + 1]
        if n == number[1] and not layout.y:
            axes.append(np.array([0.5 * (low + high)]))
            continue
        axes.append(low + step * np.arange(int((high - low) / step + 1e-6) + 1))
    shape = tuple(len(axis) for axis in axes)
    if np.prod(shape) > MOST_NODES:
        raise GridError(f"{path}: step_m {step_m} gives {shape} nodes; the most is {MOST_NODES}")
    image = pyvista.ImageData(
        dimensions=shape, spacing=(step, step, step), origin=[float(axis[0]) for axis in axes]
    )
    sampled = image.sample(mesh)
    velocity = np.asarray(sampled.point_data[layout.u], dtype=np.float64)
    if velocity.ndim != 2 or velocity.shape[1] != 3:
        raise GridError(f"{path}: {layout.u!r} is no vector of three: shape {velocity.shape}")
    valid = np.asarray(sampled.point_data["vtkValidPointMask"], dtype=bool)
    parts = velocity.reshape(*shape, 3, order="F").transpose([*number, 3])
    hole = ~valid.reshape(shape, order="F").transpose(number)
    # Velocity components in the order x, y, z of the soaring frame, like the axes.
    u, v, w = (parts[..., n] for n in number)
    if hole.all():
        raise GridError(f"{path}: no sampled place lies in the mesh; is step_m {step_m} right?")
    if layout.y:
        return _Raw(axes=tuple(axes[n] for n in number), u=u, v=v, w=w, hole=hole)
    flat = (axes[number[0]], axes[number[2]])
    return _Raw(axes=flat, u=u[:, 0], v=v[:, 0], w=w[:, 0], hole=hole[:, 0])


_READERS: dict[str, Callable[[Path, Layout], _Raw]] = {
    ".csv": _read_csv,
    ".npz": _read_npz,
    ".nc": _read_netcdf,
}


# --- Units, names, axes ------------------------------------------------------------------

_LENGTH_UNITS = {"m": 1.0, "metre": 1.0, "meter": 1.0, "metres": 1.0, "meters": 1.0, "km": 1e3,
                 "mm": 1e-3, "cm": 1e-2, "ft": 0.3048}  # fmt: skip
_SPEED_UNITS = {"m/s": 1.0, "m s-1": 1.0, "m.s-1": 1.0, "m s**-1": 1.0, "m s^-1": 1.0,
                "km/h": 1 / 3.6, "km h-1": 1 / 3.6, "cm/s": 0.01, "cm s-1": 0.01,
                "mph": 0.44704, "knots": 0.514444, "kt": 0.514444}  # fmt: skip


def _text(value: object) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _check_units(
    path: Path, name: str, units: str, known: Mapping[str, float], scale: float
) -> None:
    """A file that states its units must agree with the layout's scale."""
    units = units.strip()
    if not units:
        return
    wanted = known.get(units)
    option = "metres_per_length" if known is _LENGTH_UNITS else "mps_per_speed"
    if wanted is None:
        raise GridError(
            f"{path}: {name!r} is in {units!r}; known are {', '.join(known)} (a map in degrees"
            " must be projected to metres first)"
        )
    if abs(scale / wanted - 1.0) > 1e-3:
        raise GridError(
            f"{path}: {name!r} is in {units!r}, which needs {option} = {wanted:.6g}, not {scale}"
        )


def _check_layout(path: Path, layout: Layout) -> None:
    for name in ("x_sign", "u_sign", "y_sign", "v_sign"):
        if getattr(layout, name) not in (1, -1):
            raise GridError(f"{path}: layout {name} = {getattr(layout, name)}; must be 1 or -1")
    for name in ("metres_per_length", "mps_per_speed"):
        value = getattr(layout, name)
        if not (isfinite(value) and value > 0.0):
            raise GridError(f"{path}: layout {name} = {value}; must be positive")
    for name in ("origin_x_m", "origin_y_m", "origin_z_m"):
        if not isfinite(getattr(layout, name)):
            raise GridError(f"{path}: layout {name} = {getattr(layout, name)}; must be finite")


def _named(path: Path, table: Mapping[str, Any], name: str, kind: str) -> Any:
    if name not in table:
        raise GridError(
            f"{path}: no {kind} {name!r}; there are {', '.join(map(repr, table))}: set the layout"
        )
    return table[name]


def _where(names: list[str], values: list[float]) -> str:
    return ", ".join(f"{name} = {value:.6g}" for name, value in zip(names, values, strict=True))


def _finite(
    path: Path, what: str, values: FloatArray, place: str, lines: Sequence[int] | None = None
) -> None:
    """Errors: `GridError` naming the first place; lines: of the file, for each value of a row."""
    bad = ~np.isfinite(values)
    if bad.any():
        at = tuple(int(n) for n in np.argwhere(bad)[0])
        where = at if len(at) > 1 else at[0] if lines is None else lines[at[0]]
        raise GridError(
            f"{path}: {what} is missing or not finite at {int(bad.sum())} of {bad.size} places,"
            f" first at {place} {where}; fill them, or write 0 there and pass zero_cells='solid'"
        )


def _distinct(places: FloatArray) -> tuple[FloatArray, NDArray[np.intp]]:
    """Distinct coordinates, those equal but for rounding taken as one, and each row's index."""
    order = np.argsort(places, kind="stable")
    ordered = places[order]
    near = 1e-6 * max(1e-12, float(ordered[-1] - ordered[0]))
    group = np.concatenate([[0], np.cumsum(np.diff(ordered) > near)])
    index = np.empty(len(places), dtype=np.intp)
    index[order] = group
    sums = np.bincount(group, weights=ordered)
    return sums / np.bincount(group), index


def _axis_of(path: Path, name: str, values: FloatArray) -> FloatArray:
    """An axis that only increases or only decreases."""
    if values.ndim != 1 or len(values) < 2:
        raise GridError(
            f"{path}: axis {name!r} has shape {values.shape}; it must be a row of two at least"
        )
    _finite(path, f"axis {name!r}", values, "index")
    steps = np.diff(values)
    if (steps == 0.0).any():
        n = int(np.flatnonzero(steps == 0.0)[0])
        raise GridError(f"{path}: axis {name!r} repeats {values[n]} at index {n} and {n + 1}")
    if not ((steps > 0.0).all() or (steps < 0.0).all()):
        n = int(np.flatnonzero(np.sign(steps) != np.sign(steps[0]))[0])
        raise GridError(
            f"{path}: axis {name!r} is not sorted: {values[n]} at index {n} is followed by"
            f" {values[n + 1]}; sort it and its nodes"
        )
    return values


# --- Into the soaring frame --------------------------------------------------------------


def _field(
    path: Path,
    layout: Layout,
    raw: _Raw,
    reference_wind_mps: float | None,
    zero_cells: ZeroCells,
    outside: Outside,
    check_mass_balance: bool,
) -> GridField:
    flat = len(raw.axes) == 2
    signs, origins = [layout.x_sign, 1], [layout.origin_x_m, layout.origin_z_m]
    if not flat:
        signs.insert(1, layout.y_sign)
        origins.insert(1, layout.origin_y_m)
    axes = [
        sign * (axis * layout.metres_per_length - origin)
        for axis, sign, origin in zip(raw.axes, signs, origins, strict=True)
    ]
    scale = layout.mps_per_speed
    v_raw = np.zeros(raw.u.shape) if raw.v is None else raw.v
    wind = [layout.u_sign * scale * raw.u, layout.v_sign * scale * v_raw, scale * raw.w]
    hole = raw.hole
    for n, axis in enumerate(axes):
        if axis[0] > axis[-1]:
            axes[n] = axis[::-1]
            wind = [np.flip(part, n) for part in wind]
            hole = np.flip(hole, n)
    wind = [np.where(hole, 0.0, part) for part in wind]
    names = ["x", "z"] if flat else ["x", "y", "z"]
    zero = (wind[0] == 0.0) & (wind[1] == 0.0) & (wind[2] == 0.0) & ~hole
    if zero.any() and zero_cells == "refuse":
        first = np.argwhere(zero)[0]
        place = _where(names, [float(axis[n]) for axis, n in zip(axes, first, strict=True)])
        raise GridError(
            f"{path}: the wind is exactly zero at {int(zero.sum())} of {zero.size} places, first"
            f" at {place} m: solid, or outside the computed region?  Pass zero_cells='solid'"
            " (no air there) or 'air' (still air)"
        )
    solid = hole | (zero if zero_cells == "solid" else np.zeros(zero.shape, dtype=bool))
    air = ~solid
    if not air.any():
        raise GridError(f"{path}: no place of the grid is air")
    check_speeds(path, wind, air)
    if check_mass_balance:
        check_mass(path, axes, [wind[0], wind[2]] if flat else wind, air)
    axes, wind, solid = even_out(path, names, axes, wind, solid)
    reference = reference_wind_mps
    if reference is None:
        reference = float(wind[0][~solid].mean())
    return GridField(
        axes[0],
        None if flat else axes[1],
        axes[-1],
        wind[0],
        None if flat and raw.v is None else wind[1],
        wind[2],
        reference_wind_mps=reference,
        solid=solid,
        outside=outside,
        name=str(path),
    )
