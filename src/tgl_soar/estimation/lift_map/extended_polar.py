"""The glide polar for arrays, and beyond its ends.

Within its range the polar is `polar_sink`.  Beyond it is a parabola on from the end's tangent,
curved upwards: no cubic is trusted outside its fit, and no air far from the polar's own is ever to
look as if one could soar there.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from tgl_soar.estimation.lift_map.basis import Floats
from tgl_soar.types import GlidePolar

BEYOND_PER_MPS: Final = 0.25  # m/s of sink more at 1 m/s beyond an end: three times the polar's own


def sink_at(polar: GlidePolar, speed: Any) -> Any:
    """Sink [m/s, positive down] at horizontal airspeeds [m/s]: an array, or one number."""
    within = np.minimum(np.maximum(speed, polar.speed_min_mps), polar.speed_max_mps)
    beyond = speed - within
    sinks = polar.c0 + within * (polar.c1 + within * (polar.c2 + within * polar.c3))
    slope = polar.c1 + within * (2.0 * polar.c2 + within * (3.0 * polar.c3))
    return sinks + beyond * (slope + BEYOND_PER_MPS * beyond)


def sink(polar: GlidePolar, speed_mps: ArrayLike) -> Floats:
    """Sink [m/s, positive down] at horizontal airspeeds [m/s]."""
    result: Floats = sink_at(polar, np.asarray(speed_mps, dtype=np.float64))
    return result


def sink_slope(polar: GlidePolar, speed_mps: ArrayLike) -> Floats:
    """d sink / d speed [-] at horizontal airspeeds [m/s]."""
    speed = np.asarray(speed_mps, dtype=np.float64)
    within = np.minimum(np.maximum(speed, polar.speed_min_mps), polar.speed_max_mps)
    slope = polar.c1 + within * (2.0 * polar.c2 + within * (3.0 * polar.c3))
    result: Floats = slope + 2.0 * BEYOND_PER_MPS * (speed - within)
    return result
