"""What a wind field is: the wind (u, v, w) at a place and a time, in the soaring frame.

u   m/s  along x, downstream: a head wind on an aircraft that faces upwind is positive u
v   m/s  along y, to the right of an aircraft that faces upwind
w   m/s  along z, up: the updraft

A field answers everywhere.  Outside the region that it describes its answer is defined by its
own docstring, and `inside` says that the place lies outside; no field extrapolates.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


class WindField(Protocol):
    """A wind field in the soaring frame; lengths in metres, speeds in m/s, time in seconds."""

    @property
    def reference_wind_mps(self) -> float:
        """The wind that names the field: turbulence intensity is a fraction of it [m/s]."""
        ...

    def wind_at(
        self, x_m: float, y_m: float, z_m: float, time_s: float
    ) -> tuple[float, float, float]:
        """Wind (u, v, w) [m/s] at one place and time, plain floats."""
        ...

    def wind(
        self, x_m: ArrayLike, y_m: ArrayLike, z_m: ArrayLike, time_s: float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Wind u, v, w [m/s] at many places, each of the broadcast shape of x, y and z."""
        ...

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:
        """Whether the field describes the air at this place."""
        ...


def broadcast(
    x_m: ArrayLike, y_m: ArrayLike, z_m: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Three arrays of 64-bit floats of one shape, read-only."""
    x, y, z = np.broadcast_arrays(
        np.asarray(x_m, dtype=np.float64),
        np.asarray(y_m, dtype=np.float64),
        np.asarray(z_m, dtype=np.float64),
    )
    return x, y, z
