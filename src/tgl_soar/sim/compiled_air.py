"""The kinds of air that compiled flights know, as data.

    wind(place, n) = factor[n] · (first + weight[n] (second − first))(place) + gust[n]

`known_air` takes a wind field apart into these; plain flights take any field as it is
(`world_step.FieldAir`).
"""

from __future__ import annotations

from math import inf, nan
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import FloatArray, WindField
from tgl_soar.air.grid import (
    GridField,
    GridTable,
    GridTable3D,
    grid_wind_3d,
    numpy_table,
    numpy_table_3d,
)
from tgl_soar.air.gusts import BlendedField, GustyField, ScaledField
from tgl_soar.air.hill import Hill, HillField, hill_wind
from tgl_soar.air.jet import Jet, SlopeJet, jet_wind
from tgl_soar.air.polynomial import (
    Polynomial,
    PolynomialField,
    floor_height_m,
    in_box,
    polynomial_wind,
)
from tgl_soar.air.wind_record import RecordedField
from tgl_soar.sim.aircraft import Wind

BoolArray = NDArray[np.bool_]

HILL: Final = 0  # kinds of air
BOARD: Final = 1
GRID: Final = 2
POLYNOMIAL: Final = 3


class Air(NamedTuple):
    """One steady field: a hill, a board in a jet, a grid, or a polynomial.  Arrays are numpy's."""

    kind: int
    hill: Hill
    jet: Jet
    half_width_m: float  # of the jet
    grid: GridTable3D  # one that is the same at every y has two nodes along y
    solid: BoolArray  # (nx, ny, nz)
    goes_on: bool  # beyond the grid the wind is that of its nearest edge
    lost_mps: float  # if not, it is this
    polynomial: Polynomial
    floor_x_m: FloatArray  # of the polynomial, as `floor_height_m` takes it
    floor_z_m: FloatArray


class KnownAir(NamedTuple):
    """All air of a flight but its turbulence: one or two fields, and what they do at every step."""

    first: Air
    second: Air  # the first again where there is only one
    weight: FloatArray  # (n,) of the second field, 0 … 1; negative: there is none
    factor: FloatArray  # (n,) on both
    gust_mps: FloatArray  # (n, 3) added everywhere
    half_width_m: float  # of the world

    def wind_at(self, n: int, x_m: float, y_m: float, z_m: float) -> Wind:
        """Wind (u, v, w) [m/s] at a place at step n."""
        weight = self.weight[n]
        u, v, w = air_wind(self.first, x_m, y_m, z_m)
        if weight > 0.0:
            u2, v2, w2 = air_wind(self.second, x_m, y_m, z_m)
            u, v, w = u + weight * (u2 - u), v + weight * (v2 - v), w + weight * (w2 - w)
        factor, added = self.factor[n], self.gust_mps
        return factor * u + added[n, 0], factor * v + added[n, 1], factor * w + added[n, 2]

    def flyable(self, n: int, x_m: float, y_m: float, z_m: float) -> bool:
        """Whether a place lies in the world, and in all fields that this air is made of."""
        return (
            air_inside(self.first, x_m, y_m, z_m)
            and (self.weight[n] < 0.0 or air_inside(self.second, x_m, y_m, z_m))
            and not abs(y_m) > self.half_width_m
        )


def air_wind(air: Air, x_m: float, y_m: float, z_m: float) -> Wind:
    """Wind (u, v, w) [m/s] at one place, as the field's own `wind_at`."""
    if air.kind == HILL:
        u, w = hill_wind(air.hill, x_m, z_m)
        return u, 0.0, w
    if air.kind == BOARD:
        u, w = jet_wind(air.jet, x_m, z_m)
        return u, 0.0, w
    if air.kind == POLYNOMIAL:
        u, w = polynomial_wind(air.polynomial, x_m, z_m)
        return u, 0.0, w
    if not air.goes_on and not within_grid(air.grid, x_m, y_m, z_m):
        return air.lost_mps, air.lost_mps, air.lost_mps
    return grid_wind_3d(air.grid, x_m, y_m, z_m)


def air_inside(air: Air, x_m: float, y_m: float, z_m: float) -> bool:
    """Whether the field describes the air at this place, as the field's own `inside`."""
    if air.kind == HILL:
        radius = air.hill.ground_radius_m
        return z_m >= 0.0 and x_m * x_m + z_m * z_m >= radius * radius
    if air.kind == BOARD:
        table = air.jet.table
        floor = x_m * air.jet.rise if 0.0 < x_m <= air.jet.tip_x_m else 0.0
        return (
            table.x0_m <= x_m <= table.x0_m + (table.nx - 1) * table.dx_m
            and floor <= z_m <= table.z0_m + (table.nz - 1) * table.dz_m
            and abs(y_m) <= air.half_width_m
        )
    if air.kind == POLYNOMIAL:
        floor_m = floor_height_m(air.floor_x_m, air.floor_z_m, x_m)
        return in_box(air.polynomial, x_m, z_m) and z_m >= floor_m
    grid = air.grid
    if not within_grid(grid, x_m, y_m, z_m):
        return False
    i = min(int((x_m - grid.x0_m) / grid.dx_m), grid.nx - 2)
    j = min(int((y_m - grid.y0_m) / grid.dy_m), grid.ny - 2)
    k = min(int((z_m - grid.z0_m) / grid.dz_m), grid.nz - 2)
    for corner in range(8):
        if air.solid[i + (corner & 1), j + (corner >> 1 & 1), k + (corner >> 2)]:
            return False
    return True


def within_grid(grid: GridTable3D, x_m: float, y_m: float, z_m: float) -> bool:
    """Whether a place lies among the grid's nodes."""
    return (
        grid.x0_m <= x_m <= grid.x0_m + (grid.nx - 1) * grid.dx_m
        and grid.y0_m <= y_m <= grid.y0_m + (grid.ny - 1) * grid.dy_m
        and grid.z0_m <= z_m <= grid.z0_m + (grid.nz - 1) * grid.dz_m
    )


# --- fields as data ---------------------------------------------------------------------------

_FAR_M = 1e6  # farther than any flight goes
_NO_AIR = Air(
    kind=HILL,
    hill=Hill(0.0, 0.0),
    jet=Jet(
        GridTable(x0_m=0.0, dx_m=1.0, nx=2, z0_m=0.0, dz_m=1.0, nz=2, values=np.zeros(8)), 0.0, 0.0
    ),
    half_width_m=inf,
    grid=GridTable3D(
        x0_m=0.0,
        dx_m=1.0,
        nx=2,
        y0_m=0.0,
        dy_m=1.0,
        ny=2,
        z0_m=0.0,
        dz_m=1.0,
        nz=2,
        values=np.zeros(24),
    ),
    solid=np.zeros((2, 2, 2), dtype=bool),
    goes_on=False,
    lost_mps=nan,
    polynomial=Polynomial(
        centre_x_m=0.0,
        centre_z_m=0.0,
        half_x_m=1.0,
        half_z_m=1.0,
        degree=0,
        u_mps=np.zeros(1),
        w_mps=np.zeros(1),
    ),
    floor_x_m=np.zeros(0),
    floor_z_m=np.zeros(0),
)


class UnknownFieldError(ValueError):
    """A wind field that the compiled flight does not know; plain flights take any."""


def known_air(field: WindField, times_s: FloatArray, half_width_m: float = inf) -> KnownAir:
    """A field at the times [s] of all steps, in a world of a half width [m].

    Errors: `UnknownFieldError`.
    """
    count = len(times_s)
    if isinstance(field, GustyField):
        air = known_air(field.field, times_s, half_width_m)
        gusts = np.array([field.gust_at(t) for t in times_s.tolist()])
        return air._replace(gust_mps=air.gust_mps + gusts)
    if isinstance(field, ScaledField):
        air = known_air(field.field, times_s, half_width_m)
        factor = np.array([field.factor.at(t) for t in times_s.tolist()])
        return air._replace(
            factor=air.factor * factor, gust_mps=air.gust_mps * factor[:, np.newaxis]
        )
    if isinstance(field, RecordedField):
        air = known_air(field.field, times_s, half_width_m)
        answers = np.array([field.answer_at(t) for t in times_s.tolist()])
        factor, along = answers[:, 0], answers[:, 1]
        added = air.gust_mps * factor[:, np.newaxis]
        added[:, 1] += along
        return air._replace(factor=air.factor * factor, gust_mps=added)
    first = second = field
    weight: FloatArray = np.full(count, -1.0)
    if isinstance(field, BlendedField):
        first, second = field.first, field.second
        weight = np.array([field.weight.at(t) for t in times_s.tolist()])
    return KnownAir(
        first=as_air(first),
        second=as_air(second),
        weight=weight,
        factor=np.ones(count),
        gust_mps=np.zeros((count, 3)),
        half_width_m=half_width_m,
    )


def as_air(field: WindField) -> Air:
    """A steady field as data.  Errors: `UnknownFieldError`."""
    if isinstance(field, HillField):
        return _NO_AIR._replace(kind=HILL, hill=field.hill)
    if isinstance(field, SlopeJet):
        return _NO_AIR._replace(
            kind=BOARD,
            jet=field.jet._replace(table=numpy_table(field.jet.table)),
            half_width_m=0.5 * field.shape.jet_width_m,
        )
    if isinstance(field, GridField):
        table, solid = field.table, field.solid
        if isinstance(table, GridTable):
            table, solid = _at_every_y(field, table), np.stack([solid, solid], axis=1)
        return _NO_AIR._replace(
            kind=GRID,
            grid=numpy_table_3d(table),
            solid=solid,
            goes_on=field.outside == "edge",
            lost_mps=0.0 if field.outside == "still" else nan,
        )
    if isinstance(field, PolynomialField):
        p = field.polynomial
        return _NO_AIR._replace(
            kind=POLYNOMIAL,
            polynomial=p._replace(
                u_mps=np.array(p.u_mps, dtype=float), w_mps=np.array(p.w_mps, dtype=float)
            ),
            floor_x_m=np.array([x for x, _ in field.floor], dtype=float),
            floor_z_m=np.array([z for _, z in field.floor], dtype=float),
        )
    raise UnknownFieldError(
        f"{type(field).__name__}: compiled flights know SlopeJet, HillField, GridField,"
        " PolynomialField, and these blended, scaled, recorded or with gusts; fly it plain"
    )


def _at_every_y(field: GridField, table: GridTable) -> GridTable3D:
    """A grid in x and z, twice along y, farther apart than any flight goes."""
    x = table.x0_m + np.arange(table.nx)[:, np.newaxis] * table.dx_m
    z = table.z0_m + np.arange(table.nz) * table.dz_m
    nodes = np.stack(field.wind(x, 0.0, z), axis=-1)
    return GridTable3D(
        x0_m=table.x0_m, dx_m=table.dx_m, nx=table.nx,
        y0_m=-_FAR_M, dy_m=2.0 * _FAR_M, ny=2,
        z0_m=table.z0_m, dz_m=table.dz_m, nz=table.nz,
        values=np.stack([nodes, nodes], axis=1).ravel(),
    )  # fmt: skip
