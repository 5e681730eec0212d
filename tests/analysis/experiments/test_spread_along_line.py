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


def test_a_place_that_is_not_stable_is_refused() -> None:
    with pytest.raises(ValueError, match="no stable place"):
        dispersion(SLIDE._replace(rate_per_s=-0.1), 0.2, 0.2, 0.2, 0.2)
