"""What a flight on a line was worth.

e_rho is scored apart from the dispersion along the line: the law controls the first; the second
follows from the turbulence and the slope of excess updraft, and no still line changes it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, sin

import numpy as np
from numpy.typing import NDArray

SETTLED_M = 0.05  # |e_rho| within this for `SETTLED_FOR_S` is settled
SETTLED_FOR_S = 2.0
SETTLE_S = 3.0  # from the line's stop; what comes later is scored
TAIL_S = 8.0  # the last so many seconds of a leg tell where it ended up

# Of a touchdown that is well: how far from the place it may be, and how hard.
ALONG_M = 10.0
ACROSS_M = 5.0
SINK_MPS = 1.5

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LegScore:
    """One leg: from when the line stood still to the end of the leg."""

    name: str
    settling_s: float  # from the line's stop to the first two seconds within 5 cm; inf: never
    rms_e_rho_m: float  # from SETTLE_S after the line's stop on
    peak_e_rho_m: float  # likewise: later peaks count here, not as settling
    mean_x_m: float  # over the last TAIL_S seconds
    mean_z_m: float
    dispersion_m: float  # standard deviation along the line, over the last TAIL_S seconds
    crossing_m: float  # distance of the mean position from TGL ∩ ZEUC; NaN: none predicted
    rms_y_m: float = float("nan")  # from the middle, when e_rho is scored; NaN: not given
    rms_bank_rad: float = float("nan")  # likewise

    @property
    def settled(self) -> bool:
        """Whether the leg came to the line and was held on it."""
        return bool(np.isfinite(self.settling_s) and self.rms_e_rho_m <= SETTLED_M)


def settling_time(time_s: Floats, e_rho_m: Floats) -> float:
    """From the first time to the first `SETTLED_FOR_S` within `SETTLED_M`; inf: there are none.

    Later peaks in turbulence count as peaks, not as settling.  time_s, e_rho_m: shape (n,).
    """
    outside = ~(np.abs(e_rho_m) <= SETTLED_M)  # what is not a number is outside
    begins = np.concatenate([time_s[:1], time_s[outside]])
    ends = np.concatenate([time_s[outside], time_s[-1:]])
    quiet = np.flatnonzero(ends - begins >= SETTLED_FOR_S)
    return float(begins[quiet[0]] - time_s[0]) if quiet.size else float("inf")


def score_leg(
    name: str,
    line: tuple[float, float, float],
    crossing: tuple[float, float] | None,
    time_s: Floats,
    x_m: Floats,
    z_m: Floats,
    y_m: Floats | None = None,
    bank_rad: Floats | None = None,
) -> LegScore:
    """Score a leg from the true path.

    line: (x0 [m], z0 [m], eta [rad]); crossing: the predicted TGL ∩ ZEUC (x, z) [m] or None;
    time_s, x_m, z_m: shape (n,), from the moment when the line stood still, n >= 2; y_m, bank_rad:
    likewise, where they are known.
    """
    x0, z0, eta = line
    e = cos(eta) * (z_m - z0) - sin(eta) * (x_m - x0)
    along = cos(eta) * (x_m - x0) + sin(eta) * (z_m - z0)
    scored = time_s >= min(time_s[0] + SETTLE_S, time_s[-1])
    tail = time_s >= time_s[-1] - TAIL_S
    mean_x, mean_z = float(np.mean(x_m[tail])), float(np.mean(z_m[tail]))
    distance = float("nan")
    if crossing is not None:
        distance = float(np.hypot(mean_x - crossing[0], mean_z - crossing[1]))
    return LegScore(
        name=name,
        settling_s=settling_time(time_s, e),
        rms_e_rho_m=float(np.sqrt(np.mean(e[scored] ** 2))),
        peak_e_rho_m=float(np.max(np.abs(e[scored]))),
        mean_x_m=mean_x,
        mean_z_m=mean_z,
        dispersion_m=float(np.std(along[tail])),
        crossing_m=distance,
        rms_y_m=_rms(y_m, scored),
        rms_bank_rad=_rms(bank_rad, scored),
    )


def touches_down_well(along_m: float, across_m: float, sink_mps: float) -> bool:
    """Whether a touchdown is near enough to the landing point, and soft enough; false for NaN."""
    return abs(along_m) <= ALONG_M and abs(across_m) <= ACROSS_M and sink_mps <= SINK_MPS


def _rms(values: Floats | None, scored: NDArray[np.bool_]) -> float:
    return float("nan") if values is None else float(np.sqrt(np.mean(values[scored] ** 2)))
