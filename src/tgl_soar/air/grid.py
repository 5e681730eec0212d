"""A wind field on a regular grid, in two or three dimensions.

    wind = Σ weight · node over the corners of the cell that holds the place, each weight the
    product over the axes of (1 − s) or s, with s = (x − x_i) / dx along the axis

The samplers are pure functions of plain floats and a named tuple: plain Python runs the
two-dimensional one in about a microsecond, and numba compiles both as they stand
(`numpy_table`).  Files are read by `grid_files`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tgl_soar.air.field import FloatArray, broadcast

Outside = Literal["nan", "edge", "still"]


class GridError(ValueError):
    """A grid that cannot be used; the message names the file, what, where, and what helps."""


Axis = tuple[float, float, int]  # start, step and count


class GridTable(NamedTuple):
    """A regular grid in x and z; node (i, k) has its (u, w) at 2 (i nz + k) of `values`."""

    x0_m: float
    dx_m: float
    nx: int
    z0_m: float
    dz_m: float
    nz: int
    values: Sequence[float] | FloatArray  # a list for plain floats, a numpy array for numba


class GridTable3D(NamedTuple):
    """A regular grid; node (i, j, k) has its (u, v, w) at 3 ((i ny + j) nz + k) of `values`."""

    x0_m: float
    dx_m: float
    nx: int
    y0_m: float
    dy_m: float
    ny: int
    z0_m: float
    dz_m: float
    nz: int
    values: Sequence[float] | FloatArray


def grid_wind(table: GridTable, x_m: float, z_m: float) -> tuple[float, float]:
    """Wind (u, w) [m/s] at one place; beyond the grid, that of its nearest edge."""
    fx = (x_m - table.x0_m) / table.dx_m
    fz = (z_m - table.z0_m) / table.dz_m
    last_x = table.nx - 1
    last_z = table.nz - 1
    if not fx > 0.0:  # also for NaN
        fx = 0.0
    elif fx > last_x:
        fx = float(last_x)
    if not fz > 0.0:
        fz = 0.0
    elif fz > last_z:
        fz = float(last_z)
    i = int(fx)
    k = int(fz)
    if i == last_x:
        i -= 1
    if k == last_z:
        k -= 1
    sx = fx - i
    sz = fz - k
    values = table.values
    p = 2 * (i * table.nz + k)
    q = p + 2 * table.nz
    w00 = (1.0 - sx) * (1.0 - sz)
    w01 = (1.0 - sx) * sz
    w10 = sx * (1.0 - sz)
    w11 = sx * sz
    return (
        w00 * values[p] + w01 * values[p + 2] + w10 * values[q] + w11 * values[q + 2],
        w00 * values[p + 1] + w01 * values[p + 3] + w10 * values[q + 1] + w11 * values[q + 3],
    )


def grid_wind_3d(
    table: GridTable3D, x_m: float, y_m: float, z_m: float
) -> tuple[float, float, float]:
    """Wind (u, v, w) [m/s] at one place; beyond the grid, that of its nearest edge."""
    fx = (x_m - table.x0_m) / table.dx_m
    fy = (y_m - table.y0_m) / table.dy_m
    fz = (z_m - table.z0_m) / table.dz_m
    fx = 0.0 if not fx > 0.0 else min(fx, table.nx - 1.0)
    fy = 0.0 if not fy > 0.0 else min(fy, table.ny - 1.0)
    fz = 0.0 if not fz > 0.0 else min(fz, table.nz - 1.0)
    i = min(int(fx), table.nx - 2)
    j = min(int(fy), table.ny - 2)
    k = min(int(fz), table.nz - 2)
    sx = fx - i
    sy = fy - j
    sz = fz - k
    tz = 1.0 - sz
    a = table.values
    row = 3 * table.nz
    p = 3 * ((i * table.ny + j) * table.nz + k)  # (i, j)
    q = p + row  # (i, j + 1)
    r = p + row * table.ny  # (i + 1, j)
    s = r + row  # (i + 1, j + 1)
    cp = (1.0 - sx) * (1.0 - sy)
    cq = (1.0 - sx) * sy
    cr = sx * (1.0 - sy)
    cs = sx * sy
    return (
        cp * (tz * a[p] + sz * a[p + 3])
        + cq * (tz * a[q] + sz * a[q + 3])
        + cr * (tz * a[r] + sz * a[r + 3])
        + cs * (tz * a[s] + sz * a[s + 3]),
        cp * (tz * a[p + 1] + sz * a[p + 4])
        + cq * (tz * a[q + 1] + sz * a[q + 4])
        + cr * (tz * a[r + 1] + sz * a[r + 4])
        + cs * (tz * a[s + 1] + sz * a[s + 4]),
        cp * (tz * a[p + 2] + sz * a[p + 5])
        + cq * (tz * a[q + 2] + sz * a[q + 5])
        + cr * (tz * a[r + 2] + sz * a[r + 5])
        + cs * (tz * a[s + 2] + sz * a[s + 5]),
    )


def grid_wind_many(table: GridTable, x_m: FloatArray, z_m: FloatArray) -> tuple[FloatArray, ...]:
    """`grid_wind` at many places: u and w [m/s], each of the shape of x and z."""
    nodes = np.asarray(table.values, dtype=np.float64).reshape(table.nx, table.nz, 2)
    fx, i = _cell(x_m, table.x0_m, table.dx_m, table.nx)
    fz, k = _cell(z_m, table.z0_m, table.dz_m, table.nz)
    wind = (1.0 - fx) * ((1.0 - fz) * nodes[i, k] + fz * nodes[i, k + 1]) + fx * (
        (1.0 - fz) * nodes[i + 1, k] + fz * nodes[i + 1, k + 1]
    )
    return wind[..., 0], wind[..., 1]


def grid_wind_3d_many(
    table: GridTable3D, x_m: FloatArray, y_m: FloatArray, z_m: FloatArray
) -> tuple[FloatArray, ...]:
    """`grid_wind_3d` at many places: u, v and w [m/s], each of the shape of x, y and z."""
    nodes = np.asarray(table.values, dtype=np.float64).reshape(table.nx, table.ny, table.nz, 3)
    fx, i = _cell(x_m, table.x0_m, table.dx_m, table.nx)
    fy, j = _cell(y_m, table.y0_m, table.dy_m, table.ny)
    fz, k = _cell(z_m, table.z0_m, table.dz_m, table.nz)
    wind = np.zeros((*np.shape(x_m), 3))
    for a in (0, 1):
        for b in (0, 1):
            for c in (0, 1):
                weight = (fx if a else 1.0 - fx) * (fy if b else 1.0 - fy) * (fz if c else 1.0 - fz)
                wind += weight * nodes[i + a, j + b, k + c]
    return wind[..., 0], wind[..., 1], wind[..., 2]


def _cell(
    place_m: FloatArray, start_m: float, step_m: float, count: int
) -> tuple[FloatArray, NDArray[np.intp]]:
    """Share within the cell (with a last axis of 1) and index of the cell."""
    along = np.clip(np.nan_to_num((place_m - start_m) / step_m), 0.0, count - 1)
    index = np.minimum(along.astype(np.intp), count - 2)
    return (along - index)[..., None], index


def bake(x0_m: float, z0_m: float, step_m: float, u: FloatArray, w: FloatArray) -> GridTable:
    """A table of plain floats from node values u, w [m/s] of shape (nx, nz)."""
    nx, nz = u.shape
    values = np.stack([u, w], axis=-1).astype(np.float64).ravel().tolist()
    return GridTable(
        x0_m=float(x0_m),
        dx_m=float(step_m),
        nx=nx,
        z0_m=float(z0_m),
        dz_m=float(step_m),
        nz=nz,
        values=values,
    )


def numpy_table(table: GridTable) -> GridTable:
    """The same table with a numpy array, which numba takes."""
    return table._replace(values=np.asarray(table.values, dtype=np.float64))


def numpy_table_3d(table: GridTable3D) -> GridTable3D:
    """The same table with a numpy array, which numba takes."""
    return table._replace(values=np.asarray(table.values, dtype=np.float64))


class GridField:
    """A steady wind field on a regular grid.

    x, y, z: node places [m], increasing and evenly spaced; y None for a two-dimensional field,
    which is the same at every y.  u, v, w [m/s]: shape (nx, nz) or (nx, ny, nz); v may be None
    in two dimensions.  solid: nodes that are no air; their wind counts as zero.

    Beyond the grid the answer is as `outside` says: "nan" (not a number, so that nobody flies
    on it unaware), "edge" (that of the nearest edge) or "still" (zero).  Within it, a cell with
    a solid corner is not `inside`; its wind falls towards zero at the solid nodes.

    Errors: `GridError` for axes that are not even, shapes that do not fit, numbers that are not
    finite.
    """

    def __init__(
        self,
        x_m: ArrayLike,
        y_m: ArrayLike | None,
        z_m: ArrayLike,
        u_mps: ArrayLike,
        v_mps: ArrayLike | None,
        w_mps: ArrayLike,
        *,
        reference_wind_mps: float,
        solid: NDArray[np.bool_] | None = None,
        outside: Outside = "nan",
        name: str = "grid",
    ) -> None:
        if not (isfinite(reference_wind_mps) and reference_wind_mps > 0.0):
            raise GridError(f"{name}: reference wind {reference_wind_mps} m/s must be positive")
        if outside not in ("nan", "edge", "still"):
            raise GridError(f"{name}: outside = {outside!r}; one of 'nan', 'edge', 'still'")
        self.name, self.outside = name, outside
        self._reference = float(reference_wind_mps)
        axes = [_even_axis(name, "x", x_m), _even_axis(name, "z", z_m)]
        if y_m is not None:
            axes.insert(1, _even_axis(name, "y", y_m))
        shape = tuple(count for _, _, count in axes)
        zero = np.zeros(shape)
        u, w = _nodes(name, "u", u_mps, shape), _nodes(name, "w", w_mps, shape)
        v = zero if v_mps is None else _nodes(name, "v", v_mps, shape)
        self.solid = np.zeros(shape, dtype=bool) if solid is None else np.asarray(solid, dtype=bool)
        if self.solid.shape != shape:
            raise GridError(f"{name}: solid has shape {self.solid.shape}, the grid {shape}")
        u, v, w = (np.where(self.solid, 0.0, part) for part in (u, v, w))
        self._axes = axes
        self._blocked = _cells_with(self.solid)
        self.table: GridTable | GridTable3D
        if y_m is None:
            flat = np.stack([u, w], axis=-1).ravel().tolist()
            self.table = _table(axes, flat)
            self._cross = (
                None if v_mps is None else _table(axes, np.stack([v, v], axis=-1).ravel().tolist())
            )
        else:
            self._cross = None
            flat = np.stack([u, v, w], axis=-1).ravel().tolist()
            self.table = _table_3d(axes, flat)

    @property
    def reference_wind_mps(self) -> float:
        """The wind that names the field [m/s]."""
        return self._reference

    @property
    def three_dimensional(self) -> bool:
        """Whether the grid has a y axis."""
        return isinstance(self.table, GridTable3D)

    def wind_at(
        self,
        x_m: float,
        y_m: float,
        z_m: float,
        time_s: float,  # noqa: ARG002 - steady
    ) -> tuple[float, float, float]:
        """Wind (u, v, w) [m/s] at one place."""
        table = self.table
        if self.outside != "edge" and not self._within(x_m, y_m, z_m):
            lost = 0.0 if self.outside == "still" else float("nan")
            return lost, lost, lost
        if isinstance(table, GridTable3D):
            return grid_wind_3d(table, x_m, y_m, z_m)
        u, w = grid_wind(table, x_m, z_m)
        v = 0.0 if self._cross is None else grid_wind(self._cross, x_m, z_m)[0]
        return u, v, w

    def wind(
        self,
        x_m: ArrayLike,
        y_m: ArrayLike,
        z_m: ArrayLike,
        time_s: float = 0.0,  # noqa: ARG002 - steady
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Wind u, v, w [m/s], arrays of the broadcast shape."""
        x, y, z = broadcast(x_m, y_m, z_m)
        if isinstance(self.table, GridTable3D):
            u, v, w = grid_wind_3d_many(self.table, x, y, z)
        else:
            u, w = grid_wind_many(self.table, x, z)
            v = np.zeros(x.shape)
            if self._cross is not None:
                v = grid_wind_many(self._cross, x, z)[0]
        if self.outside == "edge":
            return u, v, w
        lost = 0.0 if self.outside == "still" else np.nan
        within = np.ones(x.shape, dtype=bool)
        places = (x, y, z) if self.three_dimensional else (x, z)
        for place, (start, step, count) in zip(places, self._axes, strict=True):
            within &= (place >= start) & (place <= start + (count - 1) * step)
        return np.where(within, u, lost), np.where(within, v, lost), np.where(within, w, lost)

    def _within(self, x_m: float, y_m: float, z_m: float) -> bool:
        places = (x_m, y_m, z_m) if len(self._axes) == 3 else (x_m, z_m)
        return all(
            start <= place <= start + (count - 1) * step
            for place, (start, step, count) in zip(places, self._axes, strict=True)
        )

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:
        """Within the grid, in a cell without solid corners."""
        if not self._within(x_m, y_m, z_m):
            return False
        places = (x_m, y_m, z_m) if len(self._axes) == 3 else (x_m, z_m)
        cell = tuple(
            min(int((place - start) / step), count - 2)
            for place, (start, step, count) in zip(places, self._axes, strict=True)
        )
        return not self._blocked[cell]


def _cells_with(mark: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Cells with a marked corner: one shorter along every axis."""
    result = mark
    for axis in range(mark.ndim):
        low = np.take(result, range(result.shape[axis] - 1), axis=axis)
        high = np.take(result, range(1, result.shape[axis]), axis=axis)
        result = low | high
    return result


def _even_axis(name: str, axis: str, values: ArrayLike) -> Axis:
    """Start, step and count of an evenly spaced axis."""
    places = np.asarray(values, dtype=np.float64)
    if places.ndim != 1 or len(places) < 2:
        raise GridError(f"{name}: axis {axis} of shape {places.shape} needs two places at least")
    step = float(places[-1] - places[0]) / (len(places) - 1)
    if not (isfinite(step) and step > 0.0):
        raise GridError(f"{name}: axis {axis} ({places[0]} … {places[-1]} m) must increase")
    even = places[0] + step * np.arange(len(places))
    off = np.abs(places - even)
    if not np.all(off <= 1e-3 * step):
        worst = int(np.nanargmax(np.where(np.isfinite(off), off, np.inf)))
        raise GridError(
            f"{name}: axis {axis} is not evenly spaced: place {worst} is {places[worst]} m,"
            f" even spacing puts it at {even[worst]:.6g} m"
        )
    return float(places[0]), step, len(places)


def _table(axes: Sequence[Axis], values: list[float]) -> GridTable:
    (x0_m, dx_m, nx), (z0_m, dz_m, nz) = axes
    return GridTable(x0_m=x0_m, dx_m=dx_m, nx=nx, z0_m=z0_m, dz_m=dz_m, nz=nz, values=values)


def _table_3d(axes: Sequence[Axis], values: list[float]) -> GridTable3D:
    (x0_m, dx_m, nx), (y0_m, dy_m, ny), (z0_m, dz_m, nz) = axes
    return GridTable3D(
        x0_m=x0_m,
        dx_m=dx_m,
        nx=nx,
        y0_m=y0_m,
        dy_m=dy_m,
        ny=ny,
        z0_m=z0_m,
        dz_m=dz_m,
        nz=nz,
        values=values,
    )


def _nodes(name: str, part: str, values: ArrayLike, shape: tuple[int, ...]) -> FloatArray:
    nodes = np.asarray(values, dtype=np.float64)
    if nodes.shape != shape:
        hint = "; its axes are swapped: transpose it" if nodes.shape == shape[::-1] else ""
        raise GridError(f"{name}: {part} has shape {nodes.shape}, the axes {shape}{hint}")
    bad = ~np.isfinite(nodes)
    if bad.any():
        first = tuple(int(n) for n in np.argwhere(bad)[0])
        raise GridError(
            f"{name}: {part} is not finite at {int(bad.sum())} of {nodes.size} nodes, first at"
            f" index {first}"
        )
    return nodes
