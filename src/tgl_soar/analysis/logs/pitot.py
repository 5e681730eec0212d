"""True airspeed from what a pitot tube's readings are logged as."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tgl_soar.link.sensor_units import true_airspeed

Floats = NDArray[np.float64]


def true_airspeeds(equivalent_mps: Floats, altitude_m: Floats) -> Floats:
    """True airspeeds [m/s] of equivalent ones, both and the altitudes above the sea of shape (n,).

    NaN where it is no measurement; an altitude that is NaN counts as sea level, as in flight.
    """
    pairs = zip(equivalent_mps.tolist(), altitude_m.tolist(), strict=True)
    found = (true_airspeed(speed_mps, height_m) for speed_mps, height_m in pairs)
    return np.array([np.nan if v is None else v for v in found], dtype=float)
