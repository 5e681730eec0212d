"""The air of a sloped board in an open wind-tunnel jet.

The jet leaves a nozzle of height H at x = −d, runs along its floor z = 0 to the foot of the
board at x = z = 0, and is turned up by the board (length L, slope β).  Three parts:

1.  The core: the exact free-streamline flow of `freestream`, scaled so that the mean speed in
    the nozzle is the wind that names the field.  Its upper surface is free, so it deflects.
2.  The mixing edges: along a free streamline of speed U, at the distance s from where it
    springs and n inwards of it, turbulence spreads the step of speed (Görtler; spreading
    σ = 11 of Liepmann and Laufer, NACA TN 1257) as

        share(n) = ½ (1 + erf(σ n / s + m)),      m = 1/√(2π)

    m follows from momentum: ∫ (share² − step) dn = 0 with the core undisturbed, since
    ∫ f (1 − f) = 1/√(2π) for f = ½ (1 + erf).
3.  The room: entrainment by that layer, ∂/∂s ∫ (share − step) dn · U = (m / σ) U, draws the
    air of the room towards the jet; it has no other motion.

The answer is proportional to the wind (no scale of Reynolds number enters), so a slope is
computed once for wind 1 and baked onto a regular grid.
"""

from __future__ import annotations

from functools import lru_cache
from math import cos, isfinite, pi, radians, sin, sqrt, tan

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .field import FloatArray, broadcast
from .freestream import FreeJetMap, solve_free_jet
from .grid import GridTable, bake, grid_wind, grid_wind_many

SPREADING = 11.0  # σ
SHIFT = 1.0 / sqrt(2.0 * pi)  # m
X_MIN_M, X_MAX_M, Z_MAX_M, STEP_M = -2.0, 5.0, 5.5, 0.025


@lru_cache(maxsize=8)
def unit_jet(
    slope_rad: float,
    board_length_m: float,
    nozzle_height_m: float,
    lip_ahead_m: float,
    wake_speed_ratio: float,
) -> GridTable:
    """The field of a nozzle wind of 1 m/s on a grid; nodes in the board are still."""
    jet = solve_free_jet(slope_rad, nozzle_height_m, board_length_m, lip_ahead_m, wake_speed_ratio)
    net = FreeJetMap(jet, upstream_m=6.0, downstream_m=9.0)
    x = np.arange(round((X_MAX_M - X_MIN_M) / STEP_M) + 1) * STEP_M + X_MIN_M
    z = np.arange(round(Z_MAX_M / STEP_M) + 1) * STEP_M
    xx, zz = np.meshgrid(x, z, indexing="ij")
    u, w = net.velocity(xx, zz)
    for edge, inward in ((net.upper_edge, -1.0), (net.lower_edge, 1.0)):
        u, w = _mix(u, w, xx, zz, edge, inward)
    tip_x = board_length_m * cos(slope_rad)
    solid = (xx > 0.0) & (xx <= tip_x) & (zz < xx * tan(slope_rad) - 1e-9)
    solid |= (xx < -lip_ahead_m) & (zz > nozzle_height_m)
    scale = np.where(solid, 0.0, 1.0 / jet.nozzle_speed)
    return bake(X_MIN_M, 0.0, STEP_M, u * scale, w * scale)


def _mix(
    u: FloatArray,
    w: FloatArray,
    x: FloatArray,
    z: FloatArray,
    edge: NDArray[np.complex128],
    inward: float,
) -> tuple[FloatArray, FloatArray]:
    """Spread one free streamline; `inward` is +1 where the jet lies on its left (above)."""
    from scipy.spatial import cKDTree
    from scipy.special import erf

    points = np.column_stack([edge.real, edge.imag])
    segment = np.diff(edge)
    path = np.concatenate([[0.0], np.cumsum(np.abs(segment))])
    tangent = np.gradient(edge) / np.abs(np.gradient(edge))
    nearest = cKDTree(points).query(np.column_stack([x.ravel(), z.ravel()]))[1].reshape(x.shape)
    offset = (x + 1j * z) - edge[nearest]
    along = (np.conj(tangent[nearest]) * offset).real
    inside = inward * (np.conj(tangent[nearest]) * offset).imag
    s = np.maximum(path[nearest] + along, 1e-9)
    # Level with the springing point or past it; behind the board all is past the tip.
    active = (path[nearest] + along > 0.0) | ((inward > 0.0) & (x > edge[0].real))
    share = np.where(active, 0.5 * (1.0 + erf(SPREADING * inside / s + SHIFT)), 1.0)
    towards = inward * 1j * tangent[nearest] * (SHIFT / SPREADING) * (1.0 - share)
    return share * u + towards.real, share * w + towards.imag


class SlopeJet:
    """Wind of a board in an open jet, the same at every y and at all times.

    wind_mps: mean speed in the nozzle.  slope_rad: 15° … 35°.  Lengths in metres; the origin is
    the foot of the board on the floor of the jet.  Outside the grid (x −2 … 5 m, z 0 … 5.5 m)
    the answer is that of the nearest edge of the grid, and zero below the floor and in the
    board; `inside` is false there.
    Errors: ValueError for a wind outside 5 … 15 m/s, a slope outside 15 … 35°, or lengths for
    which there is no such flow.
    """

    def __init__(
        self,
        wind_mps: float,
        slope_rad: float,
        board_length_m: float = 2.45,
        nozzle_height_m: float = 2.85,
        lip_ahead_m: float = 0.5,
        wake_speed_ratio: float = 1.0,
    ) -> None:
        if not 5.0 <= wind_mps <= 15.0:
            raise ValueError(f"jet wind {wind_mps} m/s: must be from 5 to 15 m/s")
        if not radians(15.0) - 1e-9 <= slope_rad <= radians(35.0) + 1e-9:
            raise ValueError(
                f"slope {slope_rad} rad: must be from {radians(15.0):.4f} to {radians(35.0):.4f}"
                " rad (15 to 35 degrees)"
            )
        for name, value in (
            ("board length", board_length_m),
            ("nozzle height", nozzle_height_m),
            ("distance from lip to foot", lip_ahead_m),
        ):
            if not (isfinite(value) and value > 0.0):
                raise ValueError(f"{name} {value} m: must be positive")
        self.wind_mps = float(wind_mps)
        self.slope_rad = float(slope_rad)
        self.board_length_m = float(board_length_m)
        self.nozzle_height_m = float(nozzle_height_m)
        unit = unit_jet(
            self.slope_rad,
            self.board_length_m,
            self.nozzle_height_m,
            float(lip_ahead_m),
            float(wake_speed_ratio),
        )
        self.table = unit._replace(values=(np.asarray(unit.values) * self.wind_mps).tolist())
        self._tip_x_m = board_length_m * cos(slope_rad)
        self._tip_z_m = board_length_m * sin(slope_rad)
        self._rise = tan(slope_rad)

    @property
    def reference_wind_mps(self) -> float:
        """The mean speed in the nozzle [m/s]."""
        return self.wind_mps

    def wind_at(
        self,
        x_m: float,
        y_m: float,  # noqa: ARG002 - two-dimensional
        z_m: float,
        time_s: float,  # noqa: ARG002 - steady
    ) -> tuple[float, float, float]:
        """Wind (u, v, w) [m/s] at one place."""
        if z_m < 0.0 or (0.0 < x_m <= self._tip_x_m and z_m < x_m * self._rise):
            return 0.0, 0.0, 0.0
        u, w = grid_wind(self.table, x_m, z_m)
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
        u, w = grid_wind_many(self.table, x, z)
        solid = (z < 0.0) | ((x > 0.0) & (x <= self._tip_x_m) & (z < x * self._rise))
        return np.where(solid, 0.0, u), np.zeros(x.shape), np.where(solid, 0.0, w)

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:  # noqa: ARG002
        """In the air of the grid: above floor and board."""
        board = 0.0 < x_m <= self._tip_x_m and z_m < x_m * self._rise
        return X_MIN_M <= x_m <= X_MAX_M and 0.0 <= z_m <= Z_MAX_M and not board
