"""How long an aircraft stays in its well, by theory: beside what splitting counts.

Along a still line the aircraft slides as experiments/spread_along_line.py has it,

    c ṡ = E(s) + turbulence        c = sin η − S′ cos η

an overdamped motion in a potential V(s) = −∫ E / c ds, with the diffusion D that the turbulence's
integral times make of it.  Out of a well that ends in a smooth rim it falls at Kramers' rate, and
where the rim is cut off (ground, fence, the end of the polar) at the rate of first passage over a
cliff:

    smooth   r = √(λ λ_rim) / 2π · exp(−ΔV / D)
    cliff    r = λ √(ΔV / (π D)) · exp(−ΔV / D)

λ the well's own rate, λ_rim that of the rim, ΔV its height.  Sources: H. A. Kramers, Physica 7
(1940); P. Hänggi, P. Talkner, M. Borkovec, Reviews of Modern Physics 62 (1990), sections IV and
VII.  Both hold for ΔV ≫ D and noise that is short against 1/λ.  There is no stall and no pitch in
it: what else an aircraft is lost by is not in these rates.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, exp, pi, sin, sqrt
from typing import Final, NamedTuple

import numpy as np

from tgl_soar.air.field import WindField
from tgl_soar.types import GlidePolar, polar_sink

STEP_M: Final = 0.01  # along the line
SLOPE_MPS: Final = 0.05


class WellExit(NamedTuple):
    """One end of the well."""

    s_m: float  # along the line from the aircraft's place, up positive
    barrier: float  # ΔV [m²/s]
    rate_per_s: float
    smooth: bool  # a rim of the air's own; else cut off by ground, fence or the end of the polar


def smooth_rate(rate_per_s: float, rim_per_s: float, barrier: float, diffusion: float) -> float:
    """Kramers' rate [1/s] out of a well with a smooth rim."""
    return sqrt(rate_per_s * rim_per_s) / (2.0 * pi) * exp(-barrier / diffusion)


def cliff_rate(rate_per_s: float, barrier: float, diffusion: float) -> float:
    """The rate [1/s] at which a well is left over an edge."""
    return rate_per_s * sqrt(barrier / (pi * diffusion)) * exp(-barrier / diffusion)


def diffusion_of(polar_slope: float, eta_rad: float, sigma_mps: float, tau_s: float) -> float:
    """D [m²/s] of Dryden turbulence of σ [m/s] and τ = L / V [s]: ∫ of its autocovariance, half of
    τ for the vertical part, over c²."""
    c = sin(eta_rad) - polar_slope * cos(eta_rad)
    return sigma_mps**2 * (0.5 * tau_s + polar_slope**2 * tau_s) / c**2


def well_exits(
    field: WindField,
    polar: GlidePolar,
    place: tuple[float, float],
    eta_rad: float,
    turbulence: tuple[float, float],
    allowed: Callable[[float, float], bool],
) -> tuple[WellExit, WellExit]:
    """The lower and the upper end of the well about a stable place (x, z) [m].

    turbulence: σ [m/s], τ [s]; allowed(x, z): whether the aircraft may be there.
    """
    (x0, z0), (sigma_mps, tau_s) = place, turbulence

    def excess(s: float) -> float:
        u, _, w = field.wind_at(x0 + s * cos(eta_rad), 0.0, z0 + s * sin(eta_rad), 0.0)
        return w - polar_sink(polar, u)

    u = field.wind_at(x0, 0.0, z0, 0.0)[0]
    rise = polar_sink(polar, u + SLOPE_MPS) - polar_sink(polar, u - SLOPE_MPS)
    polar_slope = rise / (2.0 * SLOPE_MPS)
    c = sin(eta_rad) - polar_slope * cos(eta_rad)
    rate = -(excess(STEP_M) - excess(-STEP_M)) / (2.0 * STEP_M * c)
    diffusion = diffusion_of(polar_slope, eta_rad, sigma_mps, tau_s)

    def end(side: float) -> WellExit:
        barrier, s = 0.0, 0.0
        while True:
            s += side * STEP_M
            x, z = x0 + s * cos(eta_rad), z0 + s * sin(eta_rad)
            if not allowed(x, z) or not field.inside(x, 0.0, z):
                return WellExit(s, barrier, cliff_rate(rate, barrier, diffusion), smooth=False)
            pull = excess(s) / c  # back to the place: against the side
            if not np.isfinite(pull):  # wind slower or faster than the polar knows
                return WellExit(s, barrier, cliff_rate(rate, barrier, diffusion), smooth=False)
            if side * pull > 0.0:
                rim = abs(excess(s + STEP_M) - excess(s - STEP_M)) / (2.0 * STEP_M * abs(c))
                if not np.isfinite(rim):
                    return WellExit(s, barrier, cliff_rate(rate, barrier, diffusion), smooth=False)
                found = smooth_rate(rate, rim, barrier, diffusion)
                return WellExit(s, barrier, found, smooth=True)
            barrier += abs(pull) * STEP_M

    return end(-1.0), end(1.0)
