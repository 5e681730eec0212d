"""How far turbulence disperses an aircraft along a still line.

Held on the line, the aircraft slides along it by (air/zeuc.py, s up along the line)

    ṡ (sin η − S′ cos η) = E(s) + w′ − S′ u′       E(s) ≈ (∇E · t) s

u′, w′  m/s  turbulence            S′  −  d sink / d u            E  m/s  excess updraft
so s is turbulence through a first-order low-pass of rate λ = −∇E · t / (sin η − S′ cos η),
and its variance is (1 / λ) ∫ R(t) e^(−λt) dt over t from 0, R the autocovariance of what comes
in, over (sin η − S′ cos η)².  With R = σ² exp(−t / τ) the integral is σ² τ / (1 + λ τ):

    σ_s (sin η − S′ cos η) = √[ σ_w² τ_w / (λ (1 + λ τ_w)) + (S′ σ_u)² τ_u / (λ (1 + λ τ_u)) ]

`dispersion` is that line; τ an integral time.  In Dryden turbulence u′ has that R with τ = L / V;
w′ has R = σ² exp(−t/τ) (1 − t / 2τ), integral time τ / 2, for which the integral is
σ² τ (1 + 2 λ τ) / (2 (1 + λ τ)²): `dryden_dispersion`.  The variances of the two differ by λτ/2 of
themselves at most, some 8 % in the tunnel.

No law that keeps the line still can make this smaller: a line has one degree of freedom.
"""

from __future__ import annotations

from math import cos, sin, sqrt
from typing import NamedTuple


class Slide(NamedTuple):
    """An equilibrium on a line."""

    rate_per_s: float  # λ > 0
    polar_slope: float  # S′
    eta_rad: float


def leverage(slide: Slide) -> float:
    """sin η − S′ cos η: climb along the line for each m/s of excess updraft, inverted."""
    return sin(slide.eta_rad) - slide.polar_slope * cos(slide.eta_rad)


def dispersion(
    slide: Slide, sigma_w_mps: float, tau_w_s: float, sigma_u_mps: float, tau_u_s: float
) -> float:
    """Standard deviation along the line [m] in exponentially correlated turbulence.

    sigma: standard deviations [m/s]; tau: integral times [s].  Errors: ValueError for a place
    that is not stable (λ <= 0).
    """
    rate = _stable(slide)
    updraft = sigma_w_mps**2 * tau_w_s / (rate * (1.0 + rate * tau_w_s))
    gust = (slide.polar_slope * sigma_u_mps) ** 2 * tau_u_s / (rate * (1.0 + rate * tau_u_s))
    return sqrt(updraft + gust) / abs(leverage(slide))


def dryden_dispersion(slide: Slide, sigma_mps: float, tau_s: float) -> float:
    """Standard deviation along the line [m] in Dryden turbulence of σ [m/s] and τ = L / V [s].

    Errors: ValueError for a place that is not stable (λ <= 0).
    """
    rate = _stable(slide)
    h = rate * tau_s
    updraft = sigma_mps**2 * tau_s * (1.0 + 2.0 * h) / (2.0 * rate * (1.0 + h) ** 2)
    gust = (slide.polar_slope * sigma_mps) ** 2 * tau_s / (rate * (1.0 + h))
    return sqrt(updraft + gust) / abs(leverage(slide))


def _stable(slide: Slide) -> float:
    if not slide.rate_per_s > 0.0:
        raise ValueError(
            f"no stable place: λ = {slide.rate_per_s:g} 1/s; an aircraft does not stay there"
        )
    return slide.rate_per_s
