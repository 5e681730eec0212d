"""A wind field on a regular grid, sampled bilinearly.

    wind = Σ w_ik · node_ik over the four corners of a cell, w the products of the shares
    (1 − s, s) with s = (x − x_i) / dx along each axis

The sampler is one pure function of plain floats and a named tuple: plain Python runs it in
about a microsecond, and numba compiles it as it stands.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .field import FloatArray


class GridTable(NamedTuple):
    """A regular grid in x and z; node (i, k) has its (u, w) at 2 (i nz + k) of `values`."""

    x0_m: float
    dx_m: float
    nx: int
    z0_m: float
    dz_m: float
    nz: int
    values: Sequence[float] | FloatArray  # a list for plain floats, a numpy array for numba


def grid_wind(table: GridTable, x_m: float, z_m: float) -> tuple[float, float]:
    """Wind (u, w) [m/s] at one place; beyond the grid, that of its nearest edge."""
    fx = (x_m - table.x0_m) / table.dx_m
    fz = (z_m - table.z0_m) / table.dz_m
    last_x = table.nx - 1
    last_z = table.nz - 1
    if fx < 0.0:
        fx = 0.0
    elif fx > last_x:
        fx = float(last_x)
    if fz < 0.0:
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


def grid_wind_many(table: GridTable, x_m: FloatArray, z_m: FloatArray) -> tuple[FloatArray, ...]:
    """`grid_wind` at many places: u and w [m/s], each of the shape of x and z."""
    values = np.asarray(table.values, dtype=np.float64).reshape(table.nx, table.nz, 2)
    fx = np.clip((x_m - table.x0_m) / table.dx_m, 0.0, table.nx - 1)
    fz = np.clip((z_m - table.z0_m) / table.dz_m, 0.0, table.nz - 1)
    i = np.minimum(fx.astype(np.intp), table.nx - 2)
    k = np.minimum(fz.astype(np.intp), table.nz - 2)
    sx, sz = (fx - i)[..., None], (fz - k)[..., None]
    wind = (1.0 - sx) * ((1.0 - sz) * values[i, k] + sz * values[i, k + 1]) + sx * (
        (1.0 - sz) * values[i + 1, k] + sz * values[i + 1, k + 1]
    )
    return wind[..., 0], wind[..., 1]


def bake(x0_m: float, z0_m: float, step_m: float, u: FloatArray, w: FloatArray) -> GridTable:
    """A table of plain floats from node values u, w [m/s] of shape (nx, nz)."""
    nx, nz = u.shape
    values = np.stack([u, w], axis=-1).astype(np.float64).ravel().tolist()
    return GridTable(float(x0_m), float(step_m), nx, float(z0_m), float(step_m), nz, values)


def numpy_table(table: GridTable) -> GridTable:
    """The same table with a numpy array, which numba takes."""
    return table._replace(values=np.asarray(table.values, dtype=np.float64))
