"""Turbulence, gusts and slow changes."""

from __future__ import annotations

from math import exp, inf, pi, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tgl_soar.air.field import FloatArray
from tgl_soar.air.gusts import (
    DRYDEN_STILL,
    BlendedField,
    DrydenParams,
    DrydenState,
    Gust,
    GustyField,
    ScaledField,
    Schedule,
    dryden_params,
    dryden_start,
    dryden_step,
    gust_fraction,
    roll_gust_params,
    roll_gust_start,
    roll_gust_step,
)
from tgl_soar.air.hill import HillField


def _covariances(params: DrydenParams, lags: int) -> FloatArray:
    """Exact covariances of (u, v, w) at lags 0 …: Lyapunov's equation of the step itself."""
    from scipy.linalg import solve_discrete_lyapunov

    zero3 = (0.0, 0.0, 0.0)
    states = [DrydenState._make(row) for row in np.eye(5)]
    move = np.array([dryden_step(params, state, *zero3)[0] for state in states]).T
    out = np.array([dryden_step(params, state, *zero3)[1] for state in states]).T
    noise = np.array([dryden_step(params, DRYDEN_STILL, *row)[0] for row in np.eye(3)]).T
    direct = np.array([dryden_step(params, DRYDEN_STILL, *row)[1] for row in np.eye(3)]).T
    stationary = solve_discrete_lyapunov(move, noise @ noise.T)
    result = [np.diag(out @ stationary @ out.T + direct @ direct.T)]
    carried = move @ stationary @ out.T + noise @ direct.T
    for _ in range(lags):
        result.append(np.diag(out @ carried))
        carried = move @ carried
    return np.array(result)


@pytest.mark.parametrize("dt_s", [0.0005, 0.004, 0.05, 0.5])
def test_covariances_are_drydens_at_any_step(dt_s: float) -> None:
    wind, scale, intensity = 9.0, 1.5, 0.03
    params = dryden_params(intensity, wind, scale, dt_s)
    h = dt_s * wind / scale
    variance = (intensity * wind) ** 2
    for lag, (u, v, w) in enumerate(_covariances(params, 6)):
        along = variance * exp(-lag * h)
        across = along * (1.0 - 0.5 * lag * h)
        # Rounding, made larger by a double root near 1 for small steps.
        assert u == pytest.approx(along, abs=1e-6 * variance)
        assert v == pytest.approx(across, abs=1e-6 * variance)
        assert w == pytest.approx(across, abs=1e-6 * variance)


def test_a_long_record_has_the_intensity_and_the_scale() -> None:
    wind, scale, dt = 9.0, 1.5, 0.02
    params, rng = dryden_params(0.05, wind, scale, dt), np.random.default_rng(3)
    state, turbulence = dryden_start(params, rng), []
    for white in rng.standard_normal((60_000, 3)).tolist():
        state, gust = dryden_step(params, state, *white)
        turbulence.append(gust)
    record = np.array(turbulence)
    # 1200 s of a correlation time of 1/6 s: 3600 independent pieces, 2 σ of a deviation: 2.4 %.
    assert record.std(axis=0) == pytest.approx(0.45, rel=0.03)
    u = record[:, 0]
    lag = round(scale / wind / dt)
    correlation = float(np.mean(u[lag:] * u[:-lag]) / u.var())
    assert correlation == pytest.approx(exp(-lag * dt * wind / scale), abs=0.04)
    between = np.corrcoef(record.T) - np.eye(3)
    assert np.abs(between).max() < 0.05  # 3 σ of the correlation of independent records


def test_the_first_second_is_like_any_other() -> None:
    params = dryden_params(0.03, 9.0, 1.5, 0.004)
    rng = np.random.default_rng(5)
    first = np.array(
        [
            dryden_step(params, dryden_start(params, rng), *rng.standard_normal(3))[1]
            for _ in range(4000)
        ]
    )
    assert first.std(axis=0) == pytest.approx(0.27, rel=0.035)  # 3 σ of 4000 draws


def test_no_intensity_is_no_turbulence() -> None:
    params, rng = dryden_params(0.0, 9.0, 1.5, 0.004), np.random.default_rng(1)
    state = dryden_start(params, rng)
    assert state == DRYDEN_STILL
    assert dryden_step(params, state, 1.0, -2.0, 3.0)[1] == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("intensity", "wind", "scale", "dt"),
    [(3.0, 9.0, 1.5, 0.01), (0.03, 0.0, 1.5, 0.01), (0.03, 9.0, -1.0, 0.01), (0.03, 9.0, 1.5, 0)],
)
def test_refuses_impossible_turbulence(
    intensity: float, wind: float, scale: float, dt: float
) -> None:
    with pytest.raises(ValueError, match="turbulence"):
        dryden_params(intensity, wind, scale, dt)


@settings(max_examples=60)
@given(st.floats(1e-4, 3.0), st.floats(0.001, 0.5))
def test_step_coefficients_are_stable_and_invertible(h: float, intensity: float) -> None:
    params = dryden_params(intensity, 9.0, 1.5, h * 1.5 / 9.0)
    assert 0.0 < params.a < 1.0
    assert abs(params.moving_trans) <= params.gain_trans
    assert params.gain_trans <= sqrt(1.5) * intensity * 9.0  # γ0 <= 1.5 σ²


def test_gust_begins_ends_and_peaks_in_time() -> None:
    gust = Gust(start_s=10.0, duration_s=2.0, u_mps=1.0, w_mps=-0.5)
    assert [gust_fraction(gust, t) for t in (9.0, 10.0, 12.0, 13.0)] == [0.0] * 4
    assert gust_fraction(gust, 11.0) == pytest.approx(1.0)
    assert gust_fraction(gust, 10.5) == pytest.approx(0.5)
    field = GustyField(HillField(9.0, 20.0), [gust, gust])
    calm = HillField(9.0, 20.0).wind_at(-25.0, 0.0, 10.0, 0.0)
    blown = field.wind_at(-25.0, 0.0, 10.0, 11.0)
    assert np.subtract(blown, calm) == pytest.approx((2.0, 0.0, -1.0))
    arrays = field.wind([-25.0], 0.0, [10.0], 11.0)
    assert [part[0] for part in arrays] == pytest.approx(blown)
    with pytest.raises(ValueError, match="duration"):
        GustyField(HillField(9.0, 20.0), [Gust(start_s=0.0, duration_s=0.0)])


def test_schedule_holds_before_and_after_and_is_linear_between() -> None:
    ramp = Schedule([10.0, 20.0, 30.0], [1.0, 2.0, 0.0])
    assert [ramp.at(t) for t in (0.0, 10.0, 15.0, 20.0, 25.0, 30.0, 99.0)] == pytest.approx(
        [1.0, 1.0, 1.5, 2.0, 1.0, 0.0, 0.0]
    )


@pytest.mark.parametrize(
    ("times", "values"), [([], []), ([1.0], [1.0, 2.0]), ([1.0, 1.0], [1, 2]), ([0.0], [np.nan])]
)
def test_refuses_a_schedule_that_is_none(times: list[float], values: list[float]) -> None:
    with pytest.raises(ValueError, match="schedule"):
        Schedule(times, values)


def test_scaling_and_blending_follow_time() -> None:
    slow, fast = HillField(8.0, 20.0), HillField(10.0, 20.0)
    place = (-25.0, 0.0, 10.0)
    rise = Schedule([0.0, 10.0], [1.0, 1.25])
    scaled, blended = (
        ScaledField(slow, rise),
        BlendedField(slow, fast, Schedule([0.0, 10.0], [0.0, 1.0])),
    )
    for time in (0.0, 4.0, 10.0):
        wind = 8.0 + 0.2 * time
        expected = HillField(wind, 20.0).wind_at(*place, time)
        assert scaled.wind_at(*place, time) == pytest.approx(expected)
        assert blended.wind_at(*place, time) == pytest.approx(expected)
        assert [float(p) for p in scaled.wind(*place, time)] == pytest.approx(expected)
        assert [float(p) for p in blended.wind(*place, time)] == pytest.approx(expected)
    assert scaled.reference_wind_mps == blended.reference_wind_mps == 8.0
    assert not blended.inside(0.0, 0.0, 10.0)
    assert scaled.inside(*place)


def test_refuses_negative_wind_and_weights_beyond_one() -> None:
    hill = HillField(8.0, 20.0)
    with pytest.raises(ValueError, match="negative"):
        ScaledField(hill, -1.0)
    with pytest.raises(ValueError, match="from 0 to 1"):
        BlendedField(hill, hill, Schedule([0.0], [1.2]))


# --- roll gusts ----------------------------------------------------------------------------------


def test_the_roll_gust_has_the_spectrum_of_the_specification() -> None:
    """MIL-F-8785C, 3.7.1.2, one-sided over the spatial frequency: its integral, and its corner."""
    from scipy.integrate import quad

    intensity, wind, scale, span, dt = 0.03, 8.5, 1.5, 1.1, 0.005

    def spectrum(omega: float) -> float:
        rolled = 0.8 * (pi * scale / (4.0 * span)) ** (1.0 / 3.0)
        level = float((intensity * wind) ** 2 / scale * rolled)
        return level / (1.0 + (4.0 * span * omega / pi) ** 2)

    variance = quad(spectrum, 0.0, inf)[0]
    params = roll_gust_params(intensity, wind, scale, span, dt)
    assert params.gain_radps**2 / (1.0 - params.a**2) == pytest.approx(variance, rel=1e-6)
    corner_radps = pi / (4.0 * span) * wind  # where the spectrum has fallen to a half
    assert spectrum(corner_radps / wind) == pytest.approx(0.5 * spectrum(0.0))
    assert params.a == pytest.approx(exp(-corner_radps * dt))
    assert roll_gust_step(params, 2.0, 0.0) == 2.0 * params.a


def test_a_long_record_of_roll_gusts_has_their_size_from_the_start() -> None:
    params = roll_gust_params(0.03, 8.5, 1.5, 1.1, 0.02)
    rng = np.random.default_rng(3)
    radps = [roll_gust_start(params, float(rng.standard_normal()))]
    for white in rng.standard_normal(60_000).tolist():
        radps.append(roll_gust_step(params, radps[-1], white))
    sigma = params.gain_radps / sqrt(1.0 - params.a**2)
    # 1200 s of a correlation time of 0.165 s: 3600 independent pairs, 2 sigma of a deviation 2.4 %.
    assert np.std(radps) == pytest.approx(sigma, rel=0.03)
    first = [roll_gust_start(params, white) for white in rng.standard_normal(2000).tolist()]
    assert np.std(first) == pytest.approx(sigma, rel=0.05)


@pytest.mark.parametrize("span", [0.0, -1.0, inf])
def test_a_roll_gust_needs_a_span(span: float) -> None:
    with pytest.raises(ValueError, match="span"):
        roll_gust_params(0.03, 8.5, 1.5, span, 0.005)
