"""What a flight on a line was worth.

e_rho is scored apart from the wander along the line: the law controls the first; the second
follows from the turbulence and the slope of excess updraft, and no still line changes it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

SETTLED_M = 0.05  # |e_rho| within this, for good, is settled
TAIL_S = 8.0  # the last so many seconds of a leg tell where it ended up

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LegScore:
    """One leg: from when the line stood still to the end of the leg."""

    name: str
    settling_s: float  # from the line's stop to the last time outside 5 cm; inf: never settled
    rms_e_rho_m: float  # after settling
    peak_e_rho_m: float  # after settling
    mean_x_m: float  # over the last TAIL_S seconds
    mean_z_m: float
    wander_m: float  # standard deviation along the line, over the last TAIL_S seconds
    crossing_m: float  # distance of the mean position from TGL ∩ ZEUC; NaN: none predicted

    @property
    def settled(self) -> bool:
        """Whether the leg came to the line and stayed."""
        return bool(np.isfinite(self.settling_s))


def score_leg(
    name: str,
    line: tuple[float, float, float],
    crossing: tuple[float, float] | None,
    time_s: Floats,
    x_m: Floats,
    z_m: Floats,
    settled_m: float = SETTLED_M,
) -> LegScore:
    """Score a leg from the true path.

    line: (x0 [m], z0 [m], eta [rad]); crossing: the predicted TGL ∩ ZEUC (x, z) [m] or None;
    time_s, x_m, z_m: shape (n,), from the moment when the line stood still, n >= 2.
    """
    x0, z0, eta = line
    e = cos(eta) * (z_m - z0) - sin(eta) * (x_m - x0)
    along = cos(eta) * (x_m - x0) + sin(eta) * (z_m - z0)
    outside = np.flatnonzero(~(np.abs(e) <= settled_m))
    if outside.size == 0:
        first, settling = 0, 0.0
    elif outside[-1] + 1 < len(e):
        first = int(outside[-1]) + 1
        settling = float(time_s[first] - time_s[0])
    else:
        first, settling = 0, float("inf")
    tail = time_s >= time_s[-1] - TAIL_S
    mean_x, mean_z = float(np.mean(x_m[tail])), float(np.mean(z_m[tail]))
    distance = float("nan")
    if crossing is not None:
        distance = float(np.hypot(mean_x - crossing[0], mean_z - crossing[1]))
    return LegScore(
        name,
        settling,
        float(np.sqrt(np.mean(e[first:] ** 2))),
        float(np.max(np.abs(e[first:]))),
        mean_x,
        mean_z,
        float(np.std(along[tail])),
        distance,
    )
