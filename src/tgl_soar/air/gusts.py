"""Air that changes: winds that rise and fall, discrete gusts, and Dryden turbulence.

Slow changes multiply a field by a factor of time, or blend two fields (two slopes of one
board) by a weight of time; both are piecewise linear in time.

Discrete gust (the 1 − cos of the airworthiness codes), for 0 <= t − t0 <= T:

    g(t) = (g_max / 2) (1 − cos(2 π (t − t0) / T))

Dryden turbulence (MIL-F-8785C), for an aircraft that meets frozen turbulence of length scale L
at speed V, τ = L / V, each component of standard deviation σ = intensity · reference wind:

    longitudinal (u)      R(t) = σ² exp(−t/τ)                     integral time τ
    transverse   (v, w)   R(t) = σ² exp(−t/τ) (1 − t / (2 τ))     integral time τ / 2

The steps below are exact at the sampling instants for any dt.  With a = exp(−dt/τ), e white
of unit variance, h = dt/τ:

    u_n = a u_{n−1} + σ √(1 − a²) e_n
    w_n = 2 a w_{n−1} − a² w_{n−2} + g (e_n + c e_{n−1})

Inserting R at lags 0 … 3 dt, the moving average has covariances
    γ0 = 1 − a⁴ + 2 h a²,    γ1 = −a ((1 − a²) + (h/2) (1 + a²)),    γ2 = γ3 = 0   (in σ²)
so g² (1 + c²) = γ0 and g² c = γ1 with |c| < 1: one white number per component and step is
enough.  The noise is drawn outside, in blocks.

Over a span b the updraft differs from wing to wing, which rolls the aircraft as a rotation of the
air with the rate p_g would (MIL-F-8785C, 3.7.1.2; Ω in rad/m, one-sided, L_w = L):

    Φ_p(Ω) = σ_w² / L · 0.8 (π L / 4b)^(1/3) / (1 + (4bΩ / π)²)

a first-order process with the variance and the time that follow from it,

    σ_p² = ∫ Φ_p dΩ = 0.8 (π L / 4b)^(1/3) π² σ_w² / (8 b L)        τ_p = 4b / (π V)

independent of u, v and w, and of a random stream of its own.  Its q_g and r_g are the gradients of
w and v along the path; there are none here: the aircraft meets a gust as a whole, at its centre of
gravity, as it does the mean wind's gradients.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise
from math import cos, exp, expm1, inf, isfinite, pi, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tgl_soar.air.field import FloatArray, WindField

# --- Dryden turbulence -------------------------------------------------------------------


class DrydenParams(NamedTuple):
    """Coefficients of the turbulence at one time step; made by `dryden_params`."""

    a: float  # exp(−dt/τ)
    gain_long: float  # σ √(1 − a²)
    gain_trans: float  # g
    moving_trans: float  # g c


class DrydenState(NamedTuple):
    """Memory of the turbulence: u itself, and two numbers for each transverse component.

    `v1 + g e` is the next v; `v2` is what the last v and e add to the one after it.
    """

    u: float
    v1: float
    v2: float
    w1: float
    w2: float


DRYDEN_STILL = DrydenState(u=0.0, v1=0.0, v2=0.0, w1=0.0, w2=0.0)


def dryden_params(
    intensity: float, reference_wind_mps: float, length_scale_m: float, dt_s: float
) -> DrydenParams:
    """Coefficients for σ = intensity · reference wind and τ = length scale / reference wind.

    Errors: ValueError for an intensity outside 0 … 1, or a wind, scale or step that is not
    positive.
    """
    if not 0.0 <= intensity <= 1.0:
        raise ValueError(f"turbulence intensity {intensity}: a fraction from 0 to 1 (0.03 = 3 %)")
    for name, value in (
        ("reference wind [m/s]", reference_wind_mps),
        ("length scale [m]", length_scale_m),
        ("time step [s]", dt_s),
    ):
        if not (isfinite(value) and value > 0.0):
            raise ValueError(f"turbulence {name} {value}: must be positive")
    sigma = intensity * reference_wind_mps
    h = dt_s * reference_wind_mps / length_scale_m
    a = exp(-h)
    a2 = a * a
    gamma0 = -expm1(-4.0 * h) + 2.0 * h * a2
    gamma1 = -a * (-expm1(-2.0 * h) + 0.5 * h * (1.0 + a2))
    # g² c = γ1 and g² (1 + c²) = γ0: g² is the larger root of g⁴ − γ0 g² + γ1² = 0.
    root = sqrt(max(0.0, (gamma0 - 2.0 * abs(gamma1)) * (gamma0 + 2.0 * abs(gamma1))))
    g = sqrt(0.5 * (gamma0 + root))
    return DrydenParams(a, sigma * sqrt(-expm1(-2.0 * h)), sigma * g, sigma * gamma1 / g)


def dryden_step(
    params: DrydenParams, state: DrydenState, white1: float, white2: float, white3: float
) -> tuple[DrydenState, tuple[float, float, float]]:
    """The next turbulence (u, v, w) [m/s] from three independent numbers of unit variance."""
    a, two_a, a2 = params.a, 2.0 * params.a, params.a * params.a
    u = a * state.u + params.gain_long * white1
    v = state.v1 + params.gain_trans * white2
    w = state.w1 + params.gain_trans * white3
    v1 = two_a * v + state.v2 + params.moving_trans * white2
    w1 = two_a * w + state.w2 + params.moving_trans * white3
    return DrydenState(u=u, v1=v1, v2=-a2 * v, w1=w1, w2=-a2 * w), (u, v, w)


def dryden_start(params: DrydenParams, rng: np.random.Generator) -> DrydenState:
    """A state drawn from the stationary process, so that the first second is like any other."""
    one_minus_a2 = 1.0 - params.a * params.a
    if params.gain_long == 0.0:
        return DRYDEN_STILL
    sigma2 = params.gain_long**2 / one_minus_a2
    sigma_u = sqrt(sigma2)
    # Joint covariance of (w_{n−1}, w_{n−2}, e_{n−1}): R(0), R(dt), and w_{n−1} holds g e_{n−1}.
    h = -np.log(params.a)
    r1 = sigma2 * params.a * (1.0 - 0.5 * h)
    g = params.gain_trans
    joint = np.array([[sigma2, r1, g], [r1, sigma2, 0.0], [g, 0.0, 1.0]])
    # The matrix tends to a singular one as dt → 0; eigenvalues are clipped at rounding level.
    values, vectors = np.linalg.eigh(joint)
    factor = vectors * np.sqrt(np.clip(values, 0.0, None))
    (v1, v0, ev), (w1, w0, ew) = (factor @ rng.standard_normal(3) for _ in range(2))
    two_a, a2, m = 2.0 * params.a, params.a**2, params.moving_trans
    return DrydenState(
        u=float(sigma_u * rng.standard_normal()),
        v1=float(two_a * v1 - a2 * v0 + m * ev),
        v2=float(-a2 * v1),
        w1=float(two_a * w1 - a2 * w0 + m * ew),
        w2=float(-a2 * w1),
    )


class RollGustParams(NamedTuple):
    """Coefficients of the roll gust at one time step; made by `roll_gust_params`."""

    a: float  # exp(−dt/τ_p)
    gain_radps: float  # σ_p √(1 − a²)


NO_ROLL_GUST = RollGustParams(0.0, 0.0)


def roll_gust_params(
    intensity: float, reference_wind_mps: float, length_scale_m: float, span_m: float, dt_s: float
) -> RollGustParams:
    """Coefficients for a wing of this span in the turbulence that `dryden_params` describes.

    Errors: ValueError for a span that is not positive, and those of `dryden_params`.
    """
    dryden_params(intensity, reference_wind_mps, length_scale_m, dt_s)  # the same bounds
    if not (isfinite(span_m) and span_m > 0.0):
        raise ValueError(f"turbulence over a span [m] of {span_m}: must be positive")
    sigma_w = intensity * reference_wind_mps
    shape = 0.8 * (pi * length_scale_m / (4.0 * span_m)) ** (1.0 / 3.0)
    sigma = sigma_w * pi * sqrt(shape / (8.0 * span_m * length_scale_m))
    h = dt_s * pi * reference_wind_mps / (4.0 * span_m)
    return RollGustParams(exp(-h), sigma * sqrt(-expm1(-2.0 * h)))


def roll_gust_step(params: RollGustParams, roll_gust_radps: float, white: float) -> float:
    """The next roll gust [rad/s] from one number of unit variance."""
    return params.a * roll_gust_radps + params.gain_radps * white


def roll_gust_start(params: RollGustParams, white: float) -> float:
    """A roll gust [rad/s] drawn from the stationary process with one number of unit variance."""
    return params.gain_radps / sqrt(1.0 - params.a * params.a) * white


# --- Discrete gusts ----------------------------------------------------------------------


class Gust(NamedTuple):
    """A 1 − cos gust that fills the whole field at once."""

    start_s: float
    duration_s: float
    u_mps: float = 0.0  # greatest change of u, at half the duration
    v_mps: float = 0.0
    w_mps: float = 0.0


def gust_fraction(gust: Gust, time_s: float) -> float:
    """The share 0 … 1 of its greatest change that the gust has at a time."""
    phase = (time_s - gust.start_s) / gust.duration_s
    if not 0.0 < phase < 1.0:
        return 0.0
    return 0.5 * (1.0 - cos(2.0 * pi * phase))


# --- Slow changes ------------------------------------------------------------------------


class Schedule:
    """A value that changes piecewise linearly in time, constant before and after.

    Errors: ValueError where times do not increase, lengths differ, or a number is not finite.
    """

    def __init__(self, times_s: Sequence[float], values: Sequence[float]) -> None:
        if len(times_s) != len(values) or not times_s:
            raise ValueError(
                f"schedule: {len(times_s)} times and {len(values)} values; give one value a time"
            )
        if not all(isfinite(number) for number in (*times_s, *values)):
            raise ValueError(f"schedule: times {times_s}, values {values}: all must be finite")
        if any(b <= a for a, b in pairwise(times_s)):
            raise ValueError(f"schedule: times {times_s} must increase")
        self.times_s = tuple(float(t) for t in times_s)
        self.values = tuple(float(v) for v in values)

    def at(self, time_s: float) -> float:
        """The value at a time."""
        times, values = self.times_s, self.values
        k = bisect_right(times, time_s)
        if k == 0:
            return values[0]
        if k == len(times):
            return values[-1]
        fraction = (time_s - times[k - 1]) / (times[k] - times[k - 1])
        return values[k - 1] + fraction * (values[k] - values[k - 1])


class ScaledField:
    """A field whose wind, all components alike, is multiplied by a factor of time.

    That is how the air around a fixed shape answers to another wind: no inviscid or fully
    turbulent field changes its shape.  Outside the field: the scaled answer of the field.
    """

    def __init__(self, field: WindField, factor: float | Schedule) -> None:
        self.field = field
        self.factor = factor if isinstance(factor, Schedule) else Schedule([0.0], [factor])
        if min(self.factor.values) < 0.0:
            raise ValueError(f"wind factors {self.factor.values}: must not be negative")

    @property
    def reference_wind_mps(self) -> float:
        """The scaled field's reference wind at the start of the schedule [m/s]."""
        return self.field.reference_wind_mps * self.factor.values[0]

    def wind_at(
        self, x_m: float, y_m: float, z_m: float, time_s: float
    ) -> tuple[float, float, float]:
        """Wind (u, v, w) [m/s] at one place and time."""
        u, v, w = self.field.wind_at(x_m, y_m, z_m, time_s)
        f = self.factor.at(time_s)
        return f * u, f * v, f * w

    def wind(
        self, x_m: ArrayLike, y_m: ArrayLike, z_m: ArrayLike, time_s: float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Wind u, v, w [m/s], arrays of the broadcast shape."""
        u, v, w = self.field.wind(x_m, y_m, z_m, time_s)
        f = self.factor.at(time_s)
        return f * u, f * v, f * w

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:
        """Inside the field that is scaled."""
        return self.field.inside(x_m, y_m, z_m)


class BlendedField:
    """Two fields of one site, and a weight of time: 0 is all `first`, 1 all `second`.

    For a board that is tilted slowly, blend the fields of its two slopes: the air follows
    within the time it needs to pass the board, a fraction of a second.
    Errors: ValueError for a weight outside 0 … 1.
    """

    def __init__(self, first: WindField, second: WindField, weight: Schedule) -> None:
        if not all(0.0 <= value <= 1.0 for value in weight.values):
            raise ValueError(f"blend weights {weight.values}: each must be from 0 to 1")
        self.first, self.second, self.weight = first, second, weight

    @property
    def reference_wind_mps(self) -> float:
        """The blend of both reference winds at the start of the schedule [m/s]."""
        fraction = self.weight.values[0]
        a, b = self.first.reference_wind_mps, self.second.reference_wind_mps
        return a + fraction * (b - a)

    def wind_at(
        self, x_m: float, y_m: float, z_m: float, time_s: float
    ) -> tuple[float, float, float]:
        """Wind (u, v, w) [m/s] at one place and time."""
        fraction = self.weight.at(time_s)
        if fraction == 0.0:
            return self.first.wind_at(x_m, y_m, z_m, time_s)
        if fraction == 1.0:
            return self.second.wind_at(x_m, y_m, z_m, time_s)
        u1, v1, w1 = self.first.wind_at(x_m, y_m, z_m, time_s)
        u2, v2, w2 = self.second.wind_at(x_m, y_m, z_m, time_s)
        return u1 + fraction * (u2 - u1), v1 + fraction * (v2 - v1), w1 + fraction * (w2 - w1)

    def wind(
        self, x_m: ArrayLike, y_m: ArrayLike, z_m: ArrayLike, time_s: float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Wind u, v, w [m/s], arrays of the broadcast shape."""
        fraction = self.weight.at(time_s)
        u1, v1, w1 = self.first.wind(x_m, y_m, z_m, time_s)
        u2, v2, w2 = self.second.wind(x_m, y_m, z_m, time_s)
        return u1 + fraction * (u2 - u1), v1 + fraction * (v2 - v1), w1 + fraction * (w2 - w1)

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:
        """Inside both fields."""
        return self.first.inside(x_m, y_m, z_m) and self.second.inside(x_m, y_m, z_m)


class GustyField:
    """A field with discrete gusts added everywhere; outside, the field's answer plus the gust."""

    def __init__(self, field: WindField, gusts: Sequence[Gust]) -> None:
        for gust in gusts:
            if not (all(isfinite(number) for number in gust) and 0.0 < gust.duration_s < inf):
                raise ValueError(f"{gust}: numbers must be finite and the duration positive")
        self.field, self.gusts = field, tuple(gusts)

    @property
    def reference_wind_mps(self) -> float:
        """The field's own reference wind [m/s]."""
        return self.field.reference_wind_mps

    def gust_at(self, time_s: float) -> tuple[float, float, float]:
        """Sum of all gusts (u, v, w) [m/s] at a time."""
        u = v = w = 0.0
        for gust in self.gusts:
            fraction = gust_fraction(gust, time_s)
            u += fraction * gust.u_mps
            v += fraction * gust.v_mps
            w += fraction * gust.w_mps
        return u, v, w

    def wind_at(
        self, x_m: float, y_m: float, z_m: float, time_s: float
    ) -> tuple[float, float, float]:
        """Wind (u, v, w) [m/s] at one place and time."""
        u, v, w = self.field.wind_at(x_m, y_m, z_m, time_s)
        gu, gv, gw = self.gust_at(time_s)
        return u + gu, v + gv, w + gw

    def wind(
        self, x_m: ArrayLike, y_m: ArrayLike, z_m: ArrayLike, time_s: float = 0.0
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Wind u, v, w [m/s], arrays of the broadcast shape."""
        u, v, w = self.field.wind(x_m, y_m, z_m, time_s)
        gu, gv, gw = self.gust_at(time_s)
        return u + gu, v + gv, w + gw

    def inside(self, x_m: float, y_m: float, z_m: float) -> bool:
        """Inside the field that the gusts blow over."""
        return self.field.inside(x_m, y_m, z_m)
