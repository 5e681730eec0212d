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

A wind that grows with height far upstream, U (1 + g (z/R − 1)), has the vorticity g U / R
everywhere, and the exact flow over the half cylinder is (ours, not the paper's)

    u − i w = (1 − g) (u − i w)_potential + g U (z/R − B/π)
    B       = (1 − ζ⁴) artanh(ζ)/ζ − (1 − ζ²),     ζ = R / (x + i z)

as the stream function g U z²/(2 R) of the shear, which on the hill is g U R sin²θ / 2, is taken
back there by the harmonic g U R/2 · (8/π) Σ (R/r)ⁿ sin nθ / (n (n² − 4)), n odd, in closed form.
"""

from __future__ import annotations

from cmath import log
from math import pi
from typing import Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tgl_soar.air.field import FloatArray, broadcast

# Beside ζ and 1 ± ζ: at the very foot of the hill one of the logarithms is of zero, and B is zero;
# where a place is infinite, ζ is.
_TINY: Final = 1e-300

ComplexArray = NDArray[np.complex128]
_Zeta = TypeVar("_Zeta", complex, ComplexArray)


class Hill(NamedTuple):
    """A half cylinder in a wind."""

    wind_mps: float  # U, at the height R
    radius_m: float  # R
    growth: float = 0.0  # g: of the wind far upstream with height, d ln U / d ln z at the height R
    ground_radius_m: float = 0.0  # of the hill that may be hit: `HillField` gives it, usually R


def hill_wind(hill: Hill, x_m: float, z_m: float) -> tuple[float, float]:
    """Wind (u, w) [m/s] at one place; (0, 0) inside the hill and below the ground."""
    r2 = x_m * x_m + z_m * z_m
    radius2 = hill.radius_m * hill.radius_m
    if z_m < 0.0 or r2 < radius2:
        return 0.0, 0.0
    k = hill.wind_mps * radius2 / (r2 * r2)
    u, w = hill.wind_mps - k * (x_m * x_m - z_m * z_m), -2.0 * k * x_m * z_m
    if hill.growth == 0.0:
        return u, w
    zeta = hill.radius_m / complex(x_m, z_m) + _TINY
    artanh = 0.5 * (log(1.0 + zeta + _TINY) - log(1.0 - zeta + _TINY))
    back = _taken_back(zeta, artanh)
    sheared, rest = hill.growth * hill.wind_mps, 1.0 - hill.growth
    return (
        rest * u + sheared * (z_m / hill.radius_m - back.real / pi),
        rest * w + sheared * back.imag / pi,
    )


def _taken_back(zeta: _Zeta, artanh: _Zeta) -> _Zeta:
    """B of a place ζ, inside the unit circle or on it."""
    square = zeta * zeta
    return (1.0 - square) * ((1.0 + square) * artanh / zeta - 1.0)


class HillField:
    """The wind over a half cylinder, the same at every y and at all times.

    Inside the hill and below the ground the wind is zero and `inside` is false.
    growth, ground_radius_m: as of `Hill`.  Between the ground and a flow of a larger radius the air
    is still.
    Errors: ValueError for a radius that is not positive, a wind that is not finite, or one that
    blows the other way on the ground far upstream.
    """

    def __init__(
        self,
        wind_mps: float,
        radius_m: float,
        growth: float = 0.0,
        ground_radius_m: float | None = None,
    ) -> None:
        if not 0.0 < radius_m < 1e6:
            raise ValueError(f"hill radius {radius_m} m: must be positive and below 1e6 m")
        if not 0.0 < wind_mps < 1e3:
            raise ValueError(f"hill wind {wind_mps} m/s: must be positive and below 1000 m/s")
        if not -1.0 <= growth <= 1.0:
            raise ValueError(f"hill: growth of the wind with height {growth}: must be -1 ... 1")
        ground_m = radius_m if ground_radius_m is None else ground_radius_m
        if not 0.0 < ground_m < 1e6:
            raise ValueError(
                f"hill of {ground_m} m in the ground: must be positive and below 1e6 m"
            )
        self.hill = Hill(float(wind_mps), float(radius_m), float(growth), float(ground_m))

    @property
    def reference_wind_mps(self) -> float:
        """The wind far upstream [m/s], at the height of the hill."""
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
        wind, growth, radius2 = self.hill.wind_mps, self.hill.growth, self.hill.radius_m**2
        r2 = x * x + z * z
        air = (z >= 0.0) & (r2 >= radius2)
        k = wind * radius2 / np.where(air, r2, 1.0) ** 2
        u, w = wind - k * (x * x - z * z), -2.0 * k * x * z
        if growth != 0.0:
            place = np.empty(np.shape(x), dtype=np.complex128)
            place.real, place.imag = np.where(air, x, self.hill.radius_m), np.where(air, z, 0.0)
            one, tiny = complex(1.0), complex(_TINY)
            zeta = complex(self.hill.radius_m) / place + tiny
            artanh = complex(0.5) * (np.log(one + zeta + tiny) - np.log(one - zeta + tiny))
            back = _taken_back(zeta, artanh)
            u = (1.0 - growth) * u + growth * wind * (z / self.hill.radius_m - back.real / pi)
            w = (1.0 - growth) * w + growth * wind * back.imag / pi
        u, w = np.where(air, u, 0.0), np.where(air, w, 0.0)
        return u, np.zeros_like(u), w

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:  # noqa: ARG002
        """Above the ground and outside the hill."""
        return z_m >= 0.0 and x_m * x_m + z_m * z_m >= self.hill.ground_radius_m**2
