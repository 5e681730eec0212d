"""Potential flow over a half cylinder: the two-dimensional hill of the paper (eqs 11–13).

    Phi   = U (r + R²/r) cos θ
    V_r   = U (1 − R²/r²) cos θ
    V_θ   = −U (1 + R²/r²) sin θ

U  m/s  wind far upstream, along +x        R  m  radius of the hill, its axis at x = z = 0
r  m    distance from the axis             θ  rad  angle from +x (downstream) towards +z (up)

Where the paper's lines can be read in more than one way, these are meant: the potential flow
that vanishes normal to the hill (V_r = 0 at r = R) and tends to U far away.
In Cartesian components, with x = r cos θ and z = r sin θ,

    u = U (1 − R² (x² − z²) / r⁴)        w = −U · 2 R² x z / r⁴

The ground z = 0 is a streamline.  Only the windward side x <= 0 resembles air over a hill: a
real flow separates behind the top.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tgl_soar.air.field import FloatArray, broadcast


class Hill(NamedTuple):
    """A half cylinder in a wind."""

    wind_mps: float  # U
    radius_m: float  # R


def hill_wind(hill: Hill, x_m: float, z_m: float) -> tuple[float, float]:
    """Wind (u, w) [m/s] at one place; (0, 0) inside the hill and below the ground."""
    r2 = x_m * x_m + z_m * z_m
    radius2 = hill.radius_m * hill.radius_m
    if z_m < 0.0 or r2 < radius2:
        return 0.0, 0.0
    k = hill.wind_mps * radius2 / (r2 * r2)
    return hill.wind_mps - k * (x_m * x_m - z_m * z_m), -2.0 * k * x_m * z_m


class HillField:
    """The wind over a half cylinder, the same at every y and at all times.

    Inside the hill and below the ground the wind is zero and `inside` is false.
    Errors: ValueError for a radius that is not positive or a wind that is not finite.
    """

    def __init__(self, wind_mps: float, radius_m: float) -> None:
        if not 0.0 < radius_m < 1e6:
            raise ValueError(f"hill radius {radius_m} m: must be positive and below 1e6 m")
        if not 0.0 < wind_mps < 1e3:
            raise ValueError(f"hill wind {wind_mps} m/s: must be positive and below 1000 m/s")
        self.hill = Hill(float(wind_mps), float(radius_m))

    @property
    def reference_wind_mps(self) -> float:
        """The wind far upstream [m/s]."""
        return self.hill.wind_mps

    def wind_at(
        self,
        x_m: float,
        y_m: float,  # noqa: ARG002 - two-dimensional
        z_m: float,
        time_s: float,  # noqa: ARG002 - steady
    ) -> tuple[float, float, float]:
        """Wind (u, v, w) [m/s] at one place."""
        u, w = hill_wind(self.hill, x_m, z_m)
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
        wind, radius2 = self.hill.wind_mps, self.hill.radius_m**2
        r2 = x * x + z * z
        air = (z >= 0.0) & (r2 >= radius2)
        k = wind * radius2 / np.where(air, r2, 1.0) ** 2
        u = np.where(air, wind - k * (x * x - z * z), 0.0)
        w = np.where(air, -2.0 * k * x * z, 0.0)
        return u, np.zeros_like(u), w

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:  # noqa: ARG002
        """Above the ground and outside the hill."""
        return z_m >= 0.0 and x_m * x_m + z_m * z_m >= self.hill.radius_m**2
