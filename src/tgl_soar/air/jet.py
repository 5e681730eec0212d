"""The air of a sloped board in an open wind-tunnel jet.

The jet leaves a nozzle of height H at x = −d, runs along its floor z = 0 to the foot of the
board at x = z = 0, and is turned up by the board (length L, slope β).  Four parts:

1.  The core in two dimensions: the exact free-streamline flow of `freestream`.  Its upper
    surface is free, so the jet deflects, and the board slows it and speeds its edges up.
2.  The width B of the jet: air escapes through its open sides (`relief`).  B = inf leaves the
    two-dimensional flow, which has an almost vertical zero excess updraft contour at the foot;
    B = H, a square nozzle, gives the arch that leans with the board.
3.  The mixing edges: along a free streamline of speed U, at the distance s from where it
    springs and n inwards of it, turbulence spreads the step of speed (Görtler; spreading
    σ = 11 of Liepmann and Laufer, NACA TN 1257) as

        fraction(n) = ½ (1 + erf(σ n / s + m)),      m = 1/√(2π)

    m follows from momentum: ∫ (fraction² − step) dn = 0 with the core undisturbed, since
    ∫ f (1 − f) = 1/√(2π) for f = ½ (1 + erf).
4.  The room: entrainment by that layer, d/ds ∫ (fraction − step) dn · U = (m/σ) U, draws the air
    of the room towards the jet; it has no other motion.

Nothing here knows a scale of Reynolds number, so the answer is proportional to the wind: a
slope is computed once for a nozzle wind of 1 m/s and baked onto a grid of H/114 (25 mm).

What is left out: the boundary layers on floor and board, the swirl behind the board, and a
pressure in its wake other than the room's (`wake_speed_ratio` sets it: the ratio of the speeds
of the lower and the upper free streamline, √(1 − cp) with cp the wake's pressure coefficient;
1 is a vented wake).
"""

from __future__ import annotations

from copy import copy
from functools import lru_cache
from math import cos, inf, isfinite, pi, radians, sin, sqrt, tan
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tgl_soar.air.field import FloatArray, broadcast
from tgl_soar.air.freestream import ComplexArray, FreeJetMap, solve_free_jet
from tgl_soar.air.grid import GridTable, bake, grid_wind, grid_wind_many
from tgl_soar.air.kept_jets import kept
from tgl_soar.air.relief import relieve, relieved_velocity

BoolArray = NDArray[np.bool_]

SPREADING = 11.0  # σ
SHIFT = 1.0 / sqrt(2.0 * pi)  # m


class JetShape(NamedTuple):
    """The geometry of the board in the jet; lengths in metres."""

    slope_rad: float
    board_length_m: float = 2.45
    nozzle_height_m: float = 2.85
    jet_width_m: float = 2.85  # inf: two-dimensional
    lip_ahead_m: float = 0.5  # from the nozzle's lip to the foot of the board
    wake_speed_ratio: float = 1.0  # k


class Jet(NamedTuple):
    """The baked field of one wind and the board in it: all that a query needs."""

    table: GridTable
    tip_x_m: float
    rise: float  # tan β


def jet_wind(jet: Jet, x_m: float, z_m: float) -> tuple[float, float]:
    """Wind (u, w) [m/s] at one place; zero in the board and below the floor."""
    if z_m < 0.0 or (0.0 < x_m <= jet.tip_x_m and z_m < x_m * jet.rise):
        return 0.0, 0.0
    return grid_wind(jet.table, x_m, z_m)


@lru_cache(maxsize=16)
def unit_jet(shape: JetShape) -> GridTable:
    """The field of a nozzle wind of 1 m/s on a grid; nodes in board and nozzle roof are still."""
    return kept(shape, lambda: _unit_jet(shape))


def _unit_jet(shape: JetShape) -> GridTable:
    height, ahead = shape.nozzle_height_m, shape.lip_ahead_m
    jet = solve_free_jet(
        shape.slope_rad, height, shape.board_length_m, ahead, shape.wake_speed_ratio
    )
    tip = shape.board_length_m * complex(cos(shape.slope_rad), sin(shape.slope_rad))
    net = FreeJetMap(
        jet, upstream_m=ahead + 1.6 * height, downstream_m=shape.board_length_m + 1.6 * height
    )
    relief = relieve(net, shape.jet_width_m) if shape.jet_width_m < inf else None
    step = height / 114.0
    x_min = -step * round((ahead + 0.5 * height) / step)
    x = np.arange(round((tip.real + 0.9 * height - x_min) / step) + 1) * step + x_min
    z = np.arange(round(1.9 * height / step) + 1) * step
    xx, zz = np.meshgrid(x, z, indexing="ij")
    u, w = relieved_velocity(net, relief, net.locate(xx, zz))
    core = bake(x_min, 0.0, step, u, w)
    upper = _streamline(core, complex(-ahead, height), float(x[-1]))
    lower = _streamline(core, tip, float(x[-1]))
    for edge, inward in ((upper, -1.0), (lower, 1.0)):
        u, w = _mix(u, w, xx, zz, edge, inward)
    board = (xx > 0.0) & (xx <= tip.real) & (zz < xx * tan(shape.slope_rad) - 1e-9)
    u, w = _slipping(u, board), _slipping(w, board)
    scale = np.where((xx < -ahead) & (zz > height), 0.0, 1.0 / jet.nozzle_speed)
    return bake(x_min, 0.0, step, u * scale, w * scale)


def _slipping(speed: FloatArray, board: BoolArray) -> FloatArray:
    """No wind in the board, but at its surface that of the air: without friction it slips along.

    Nodes within the first cell below the surface take the nearest value above it, so that what is
    interpolated between the two is the flow and no boundary layer as thick as a cell.
    """
    from scipy.ndimage import distance_transform_edt

    depth, nearest = distance_transform_edt(board, return_indices=True)
    first = depth < 2.0  # cells; the diagonal neighbour is 1.4 away
    return np.where(board, np.where(first, speed[tuple(nearest)], 0.0), speed)


def _streamline(core: GridTable, start: complex, x_end_m: float) -> ComplexArray:
    """Places along a streamline in steps of one grid cell (midpoint rule)."""
    places = [start]
    while places[-1].real < x_end_m:
        here = places[-1]
        for fraction in (0.5, 1.0):
            velocity = complex(*grid_wind(core, here.real, here.imag))
            here = places[-1] + fraction * core.dx_m * velocity / abs(velocity)
        places.append(here)
    return np.array(places)


def _mix(
    u: FloatArray,
    w: FloatArray,
    x: FloatArray,
    z: FloatArray,
    edge: ComplexArray,
    inward: float,
) -> tuple[FloatArray, FloatArray]:
    """Spread one free streamline; `inward` is +1 where the jet lies on its left (above)."""
    from scipy.spatial import cKDTree
    from scipy.special import erf

    points = np.column_stack([edge.real, edge.imag])
    path = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(edge)))])
    tangent = np.gradient(edge) / np.abs(np.gradient(edge))
    nearest = cKDTree(points).query(np.column_stack([x.ravel(), z.ravel()]))[1].reshape(x.shape)
    offset = np.conj(tangent[nearest]) * ((x + 1j * z) - edge[nearest])
    inside = inward * offset.imag
    # Level with the springing point or past it; behind the board all is past the tip.
    active = (path[nearest] + offset.real > 0.0) | ((inward > 0.0) & (x > edge[0].real))
    s = np.maximum(path[nearest] + offset.real, 1e-9)
    fraction = np.where(active, 0.5 * (1.0 + erf(SPREADING * inside / s + SHIFT)), 1.0)
    entrained = np.hypot(u, w) * (SHIFT / SPREADING) * (1.0 - fraction)
    towards = inward * 1j * tangent[nearest] * entrained
    return fraction * u + towards.real, fraction * w + towards.imag


class SlopeJet:
    """Wind of a board in an open jet, the same at every y and at all times.

    wind_mps: mean speed in the nozzle, 5 … 15.  slope_rad: 15° … 35° in radians.  Lengths in
    metres; the origin is the foot of the board on the floor of the jet.  The wind is that of
    the plane of symmetry, v = 0.  Outside the grid (half a nozzle height upstream of the lip,
    0.9 downstream of the tip, 1.9 above the floor) the answer is that of the nearest edge of
    the grid; in the board and below the floor it is zero.  `inside` is false there and beyond
    half the jet's width to either side.
    Errors: ValueError for a wind or slope outside its range, and for lengths that have no such
    flow.
    """

    def __init__(
        self,
        wind_mps: float,
        slope_rad: float,
        board_length_m: float = 2.45,
        nozzle_height_m: float = 2.85,
        jet_width_m: float = 2.85,
        lip_ahead_m: float = 0.5,
        wake_speed_ratio: float = 1.0,
    ) -> None:
        shape = JetShape(
            slope_rad=float(slope_rad),
            board_length_m=float(board_length_m),
            nozzle_height_m=float(nozzle_height_m),
            jet_width_m=float(jet_width_m),
            lip_ahead_m=float(lip_ahead_m),
            wake_speed_ratio=float(wake_speed_ratio),
        )
        if not 5.0 <= wind_mps <= 15.0:
            raise ValueError(f"jet wind {wind_mps} m/s: must be from 5 to 15 m/s")
        _check(shape)
        self.wind_mps = float(wind_mps)
        self.shape = shape
        unit = unit_jet(shape)
        self.jet = Jet(
            unit._replace(values=(np.asarray(unit.values) * self.wind_mps).tolist()),
            shape.board_length_m * cos(shape.slope_rad),
            tan(shape.slope_rad),
        )

    def with_unit_wind(self, wind: FloatArray) -> SlopeJet:
        """The same board in another wind: (u, w) in the place of those of `unit_jet` at its nodes,
        of shape (nx, nz, 2), for a nozzle wind of 1 m/s."""
        other = copy(self)
        values = (wind * self.wind_mps).ravel().tolist()
        other.jet = self.jet._replace(table=self.jet.table._replace(values=values))
        return other

    @property
    def reference_wind_mps(self) -> float:
        """The mean speed in the nozzle [m/s]."""
        return self.wind_mps

    def board_height_m(self, x_m: float) -> float:
        """Height of the solid under a place [m]: the board, or the floor beside it."""
        return x_m * self.jet.rise if 0.0 < x_m <= self.jet.tip_x_m else 0.0

    def wind_at(
        self,
        x_m: float,
        y_m: float,  # noqa: ARG002 - the plane of symmetry
        z_m: float,
        time_s: float,  # noqa: ARG002 - steady
    ) -> tuple[float, float, float]:
        """Wind (u, v, w) [m/s] at one place."""
        u, w = jet_wind(self.jet, x_m, z_m)
        return u, 0.0, w

    def wind(
        self,
        x_m: ArrayLike,
        y_m: ArrayLike,
        z_m: ArrayLike,
        time_s: float = 0.0,  # noqa: ARG002 - steady
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Wind u, v, w [m/s], arrays of the broadcast shape."""
        x, _, z = broadcast(x_m, y_m, z_m)
        jet = self.jet
        u, w = grid_wind_many(jet.table, x, z)
        solid = (z < 0.0) | ((x > 0.0) & (x <= jet.tip_x_m) & (z < x * jet.rise))
        return np.where(solid, 0.0, u), np.zeros(x.shape), np.where(solid, 0.0, w)

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:
        """In the air of the grid: above floor and board, within the width of the jet."""
        table = self.jet.table
        return (
            table.x0_m <= x_m <= table.x0_m + (table.nx - 1) * table.dx_m
            and self.board_height_m(x_m) <= z_m <= table.z0_m + (table.nz - 1) * table.dz_m
            and abs(y_m) <= 0.5 * self.shape.jet_width_m
        )


def _check(shape: JetShape) -> None:
    low, high = radians(15.0), radians(35.0)
    if not low - 1e-9 <= shape.slope_rad <= high + 1e-9:
        raise ValueError(
            f"slope {shape.slope_rad} rad: must be from {low:.4f} to {high:.4f} rad"
            " (15 to 35 degrees)"
        )
    for name, value in (
        ("board_length_m", shape.board_length_m),
        ("nozzle_height_m", shape.nozzle_height_m),
        ("lip_ahead_m", shape.lip_ahead_m),
    ):
        if not (isfinite(value) and value > 0.0):
            raise ValueError(f"{name} {value} m: must be positive")
    if not shape.jet_width_m >= 0.5 * shape.nozzle_height_m:
        raise ValueError(
            f"jet_width_m {shape.jet_width_m} m: must be at least half the nozzle height"
            f" ({0.5 * shape.nozzle_height_m} m); inf is a two-dimensional jet"
        )
    if not 1.0 <= shape.wake_speed_ratio <= 1.5:
        raise ValueError(
            f"wake_speed_ratio {shape.wake_speed_ratio}: must be from 1 (vented wake) to 1.5"
        )
