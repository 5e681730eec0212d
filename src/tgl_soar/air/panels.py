"""Potential flow over any ground profile, by panels that are sources of constant strength.

    V(p) = (U, 0) + Σ_j σ_j K_j(p)          V · n_i = 0 in the middle of each panel i

U    m/s  wind far upstream, along +x       σ  m/s  strength of a panel
n_i  -    its normal, up                    K  -    velocity at p for each unit of strength

In a panel's own axes, t along it from its first end, n up from it, its length L,

    K_t = ln((t² + n²) / ((t − L)² + n²)) / 4π      K_n = (atan2(n, t − L) − atan2(n, t)) / 2π

(J. L. Hess and A. M. O. Smith, Calculation of potential flow about arbitrary bodies, 1967).  A
panel blows by half its strength through either side, so K_n = 1/2 in its own middle.

Beyond the profile the ground goes on level at the height of its ends, for thirty times the
profile's length to either side, by panels that grow with the distance: what is cut off there
changes the flow as the square of a hill's size over that distance.

The air is without friction: only the windward side resembles air over a hill, and nothing here
separates.  Within a panel's length of the ground the flow is that of a polygon with the sources
in steps: do not ask for it there.  A corner that opens to the air by a right angle, as
a cylinder's foot has it, costs 1 % of the wind over the hill with 100 panels; milder ones, less.
"""

from __future__ import annotations

from math import isfinite
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from tgl_soar.air.field import FloatArray, broadcast

LEVEL_LENGTHS: Final = 30.0  # of the profile, to either side
GROWTH: Final = 1.3  # of a panel over its neighbour, beyond the profile
_BLOCK: Final = 4096  # places worked out at once: some tens of megabytes


class PanelField:
    """The wind over a ground profile, the same at every y and at all times.

    x_m, z_m: the profile, x growing; wind_mps: far upstream.  Below the ground the wind is zero.
    `inside`: above the profile, and not beyond its ends.
    Errors: ValueError for a profile that is none, or a wind that is not positive.
    """

    def __init__(self, x_m: ArrayLike, z_m: ArrayLike, wind_mps: float) -> None:
        x, z = np.asarray(x_m, dtype=np.float64), np.asarray(z_m, dtype=np.float64)
        if x.ndim != 1 or x.shape != z.shape or len(x) < 2:
            raise ValueError(f"profile of shapes {x.shape} and {z.shape}: two points or more")
        if not (np.isfinite(x).all() and np.isfinite(z).all() and (np.diff(x) > 0.0).all()):
            raise ValueError("profile: must be finite and grow in x from point to point")
        if not (isfinite(wind_mps) and wind_mps > 0.0):
            raise ValueError(f"wind {wind_mps} m/s: must be positive")
        self.x_m, self.z_m = x, z
        self._wind = float(wind_mps)
        ends_x, ends_z = _with_level_ground(x, z)
        self._x0, self._z0 = ends_x[:-1], ends_z[:-1]
        dx, dz = np.diff(ends_x), np.diff(ends_z)
        self._length: FloatArray = np.hypot(dx, dz).astype(np.float64)
        self._cos: FloatArray = dx / self._length
        self._sin: FloatArray = dz / self._length
        self._strength = self._solved()

    def _solved(self) -> FloatArray:
        middle_x = self._x0 + 0.5 * self._length * self._cos
        middle_z = self._z0 + 0.5 * self._length * self._sin
        along_x, along_z = self._unit_winds(middle_x, middle_z)
        # The middle of a panel lies on it to rounding only, and its own part jumps there.
        own = np.arange(len(self._length))
        along_x[own, own], along_z[own, own] = -0.5 * self._sin, 0.5 * self._cos
        through = -self._sin[:, None] * along_x + self._cos[:, None] * along_z
        solved: FloatArray = np.linalg.solve(through, self._wind * self._sin).astype(np.float64)
        return solved

    def _unit_winds(self, x_m: FloatArray, z_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocity along x and z at each place (rows) by each panel of unit strength (columns)."""
        dx, dz = x_m[:, None] - self._x0, z_m[:, None] - self._z0
        t = dx * self._cos + dz * self._sin
        n = dz * self._cos - dx * self._sin
        beyond = t - self._length
        near = (1e-9 * self._length) ** 2  # at a panel's very end: large instead of infinite
        along = np.log((t * t + n * n + near) / (beyond * beyond + n * n + near)) / (4.0 * np.pi)
        normal = (np.arctan2(n, beyond) - np.arctan2(n, t)) / (2.0 * np.pi)
        return along * self._cos - normal * self._sin, along * self._sin + normal * self._cos

    @property
    def reference_wind_mps(self) -> float:
        """The wind far upstream [m/s]."""
        return self._wind

    def ground_m(self, x_m: ArrayLike) -> FloatArray:
        """Height of the ground [m]; level beyond the profile's ends."""
        places = np.asarray(x_m, dtype=np.float64)
        return np.asarray(np.interp(places, self.x_m, self.z_m), dtype=np.float64)

    def wind_at(
        self, x_m: float, y_m: float, z_m: float, time_s: float
    ) -> tuple[float, float, float]:
        """Wind (u, v, w) [m/s] at one place."""
        u, v, w = self.wind(x_m, y_m, z_m, time_s)
        return float(u), float(v), float(w)

    def wind(
        self,
        x_m: ArrayLike,
        y_m: ArrayLike,
        z_m: ArrayLike,
        time_s: float = 0.0,  # noqa: ARG002 - steady
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Wind u, v, w [m/s], arrays of the broadcast shape."""
        x, _, z = broadcast(x_m, y_m, z_m)
        places_x, places_z = x.ravel(), z.ravel()
        u, w = np.empty(x.size), np.empty(x.size)
        for begin in range(0, x.size, _BLOCK):
            part = slice(begin, begin + _BLOCK)
            along_x, along_z = self._unit_winds(places_x[part], places_z[part])
            u[part] = self._wind + along_x @ self._strength
            w[part] = along_z @ self._strength
        air = z >= self.ground_m(x)
        u, w = np.where(air, u.reshape(x.shape), 0.0), np.where(air, w.reshape(x.shape), 0.0)
        return u, np.zeros_like(u), w

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:  # noqa: ARG002
        """Above the profile."""
        return bool(self.x_m[0] <= x_m <= self.x_m[-1] and z_m >= self.ground_m(x_m))


def _with_level_ground(x: FloatArray, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The profile and level ground at either end."""
    reach = LEVEL_LENGTHS * (x[-1] - x[0])
    before, after = _growing(x[1] - x[0], reach), _growing(x[-1] - x[-2], reach)
    return (
        np.concatenate([x[0] - before[::-1], x, x[-1] + after]),
        np.concatenate([np.full(len(before), z[0]), z, np.full(len(after), z[-1])]),
    )


def _growing(first_m: float, reach_m: float) -> FloatArray:
    """Distances of panels' ends, each panel longer than the last one, as far as that."""
    count = int(np.ceil(np.log1p(reach_m * (GROWTH - 1.0) / first_m) / np.log(GROWTH)))
    lengths = first_m * GROWTH ** np.arange(max(1, count))
    return np.cumsum(lengths)
