"""The formula of dispersion against the linear model that it solves, stepped."""

from __future__ import annotations

from math import exp, radians, sqrt

import numpy as np
import pytest

from tgl_soar.air.gusts import dryden_params, dryden_start, dryden_step
from tgl_soar.analysis.experiments.spread_along_line import (
    Slide,
    dispersion,
    dryden_dispersion,
    leverage,
)

SLIDE = Slide(rate_per_s=0.9, polar_slope=0.12, eta_rad=radians(110.0))


def slid(slide: Slide, u: np.ndarray, w: np.ndarray, dt: float) -> float:
    """Standard deviation along the line of the linear model under given turbulence."""
    pull, gain = exp(-slide.rate_per_s * dt), dt / leverage(slide)
    s, track = 0.0, np.empty(len(u))
    for k, push in enumerate((gain * (w - slide.polar_slope * u)).tolist()):
        s = pull * s + push
        track[k] = s
    return float(np.std(track[int(10.0 / dt) :]))


def exponential(sigma: float, tau: float, dt: float, count: int, seed: int) -> np.ndarray:
    a = exp(-dt / tau)
    noise = sigma * sqrt(1.0 - a * a) * np.random.default_rng(seed).standard_normal(count)
    out, value = np.empty(count), 0.0
    for k, step in enumerate(noise.tolist()):
        value = a * value + step
        out[k] = value
    return out


def summed(slide: Slide, correlation: np.ndarray, t: np.ndarray) -> float:
    """(1 / λ) ∫ R(t) e^(−λt) dt, added up, over the square of the lever."""
    lever = 1.0 * np.sin(slide.eta_rad) - slide.polar_slope * np.cos(slide.eta_rad)
    whole = float(np.trapezoid(correlation * np.exp(-slide.rate_per_s * t), t))
    return whole / slide.rate_per_s / float(lever) ** 2


# A gentle line, and one whose polar is steep where it is flown, and that leans far.
LINES = (SLIDE, Slide(rate_per_s=0.4, polar_slope=-0.7, eta_rad=radians(130.0)))


@pytest.mark.parametrize("slide", LINES)
@pytest.mark.parametrize(("sigma_w", "sigma_u"), [(0.2, 0.0), (0.0, 0.3), (0.2, 0.3)])
def test_each_part_of_exponential_turbulence_is_its_integral(
    slide: Slide, sigma_w: float, sigma_u: float
) -> None:
    t = np.linspace(0.0, 60.0, 600_001)
    updraft = summed(slide, sigma_w**2 * np.exp(-t / 1.7), t)
    gust = summed(slide, (slide.polar_slope * sigma_u) ** 2 * np.exp(-t / 0.6), t)
    found = dispersion(slide, sigma_w, 1.7, sigma_u, 0.6)
    assert found == pytest.approx(sqrt(updraft + gust), rel=1e-6)


@pytest.mark.parametrize("slide", LINES)
@pytest.mark.parametrize("tau", [0.2, 1.7])
def test_dryden_turbulence_is_the_integral_of_both_its_correlations(
    slide: Slide, tau: float
) -> None:
    t = np.linspace(0.0, 60.0, 600_001)
    updraft = summed(slide, 0.3**2 * np.exp(-t / tau) * (1.0 - t / (2.0 * tau)), t)
    gust = summed(slide, (slide.polar_slope * 0.3) ** 2 * np.exp(-t / tau), t)
    assert dryden_dispersion(slide, 0.3, tau) == pytest.approx(sqrt(updraft + gust), rel=1e-6)


def test_a_line_that_leans_the_other_way_has_a_lever_too() -> None:
    """Beyond level it is negative: the spread is as large as its mirror image's."""
    over = SLIDE._replace(eta_rad=SLIDE.eta_rad + radians(180.0))
    assert leverage(over) == pytest.approx(-leverage(SLIDE))
    assert dispersion(over, 0.2, 0.4, 0.3, 0.2) == pytest.approx(
        dispersion(SLIDE, 0.2, 0.4, 0.3, 0.2)
    )
    assert dryden_dispersion(over, 0.2, 0.3) == pytest.approx(dryden_dispersion(SLIDE, 0.2, 0.3))


def test_exponential_turbulence_makes_the_dispersion_of_the_formula() -> None:
    dt, count = 0.02, 150_000  # 3,000 s: 1,350 independent values, 2 % of standard error
    u = exponential(0.3, 0.2, dt, count, 1)
    w = exponential(0.2, 0.4, dt, count, 2)
    assert slid(SLIDE, u, w, dt) == pytest.approx(dispersion(SLIDE, 0.2, 0.4, 0.3, 0.2), rel=0.06)


def test_dryden_turbulence_makes_the_dispersion_of_its_own_formula() -> None:
    dt, count, reference, length = 0.02, 150_000, 8.5, 1.5
    params, rng = dryden_params(0.02, reference, length, dt), np.random.default_rng(3)
    state, met = dryden_start(params, rng), []
    for white in rng.standard_normal((count, 3)).tolist():
        state, gust = dryden_step(params, state, *white)
        met.append(gust)
    gusts = np.array(met)
    expected = dryden_dispersion(SLIDE, 0.02 * reference, length / reference)
    assert slid(SLIDE, gusts[:, 0], gusts[:, 2], dt) == pytest.approx(expected, rel=0.06)


def test_both_formulas_meet_where_turbulence_is_short() -> None:
    """As λτ goes to zero a Dryden updraft is an exponential one of half its τ."""
    tau = 1e-5
    assert dryden_dispersion(SLIDE, 0.2, tau) == pytest.approx(
        dispersion(SLIDE, 0.2, 0.5 * tau, 0.2, tau), rel=1e-5
    )


def test_a_steeper_slope_of_excess_and_less_turbulence_disperse_less() -> None:
    steeper = SLIDE._replace(rate_per_s=2.0 * SLIDE.rate_per_s)
    assert dryden_dispersion(steeper, 0.2, 0.2) < dryden_dispersion(SLIDE, 0.2, 0.2)
    assert dryden_dispersion(SLIDE, 0.4, 0.2) == pytest.approx(
        2.0 * dryden_dispersion(SLIDE, 0.2, 0.2)
    )


@pytest.mark.parametrize("rate", [-0.1, 0.0, float("nan")])
def test_a_place_that_is_not_stable_is_refused(rate: float) -> None:
    loose = SLIDE._replace(rate_per_s=rate)
    with pytest.raises(ValueError, match=f"no stable place: λ = {rate:g} 1/s"):
        dispersion(loose, 0.2, 0.2, 0.2, 0.2)
    with pytest.raises(ValueError, match="no stable place"):
        dryden_dispersion(loose, 0.2, 0.2)
