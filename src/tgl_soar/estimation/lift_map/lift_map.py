"""The lift map: a Kalman filter on the weights of `basis`, and what it says of any place.

A reading every 0.2 s or so holds, at the aircraft's place, of what is known of

    u            m/s  wind                                    = u(x, z)
    w            m/s  updraft                                 = w(x, z) + b
    e            m/s  total energy, ż − (V/g) v̇x             = w(x, z) − (1 + p) S(V)

v̇x is the acceleration over the ground, downstream, V the horizontal airspeed, S the polar's sink,
p its error and b the updraft's bias.  At rest on a line V = u and e = 0: w = S, whatever b is, so
that hovering calibrates the updraft.  Readings of turbulence are no readings of the field: their
noise follows the gusts that are met, and is that of few independent samples (R_…).

Two maps run side by side, alike but for how much air may cross the ground: nearly none, or so much
that the profile says nothing.  Each has the weight of how well it foresaw the readings (Bayes), so
where the ground is wrong, or the flow leaves it, the streamline is given up: that is the watch on
its innovation.  What is predicted is their mixture.

Slow change: all winds scale together (q² dt θ θᵀ), and in FORGET_S anything may have become what it
might have been at first.  Beside that random walk the wind has a trend r, the same everywhere:

    θ̇ = r θ,   ṙ = −r / T + noise                         a Gauss–Markov process of deviation σ

Its covariance c with the weights and its variance follow the same Kalman filter, so that readings
give r as far as gusts let them; after t the wind is foreseen to be e^(r T (1 − e^(−t/T))) of now.
"""

from __future__ import annotations

from math import exp, isfinite, log, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tgl_soar.estimation.lift_map.basis import Box, Floats, FlowBasis
from tgl_soar.estimation.lift_map.extended_polar import sink, sink_slope
from tgl_soar.types import GlidePolar, Ground

STREAMLINE_MPS: Final = 0.8  # through the ground, in a wind of 9 m/s
LOOSE_MPS: Final = 4.0  # the same where the profile is wrong: as much as all poles make
LOOSE_FIRST: Final = 0.05  # how likely that is beforehand
WEIGHT_LEAST: Final = 1e-3  # so that neither map is ever out of reach

SAMPLES_U: Final = 3.0  # readings of 0.2 s for one that is independent, with the field's own misfit
SAMPLES_W: Final = 4.5
SD_U_MPS: Final = 0.10  # of a reading in calm air
SD_W_MPS: Final = 0.08
SD_E_MPS: Final = 0.05
GUSTS_S: Final = 3.0  # in which the gusts that are met are averaged
GUSTS_FIRST: Final = 0.03  # of the wind, until they are
GATE: Final = 5.0  # standard deviations: what is farther off is pulled in to this

SCALE_PER_ROOT_S: Final = 0.006  # q: what the trend leaves
FORGET_S: Final = 400.0
# Of the trend: a wind that rises or falls by 7.5 % in ten seconds is one standard deviation, and
# after TREND_S a third of a trend is left.
TREND_PER_S: Final = 0.010
TREND_S: Final = 5.0
JITTER: Final = 1e-12  # of the largest variance, added to all of them: what rounding may have taken
JITTERS: Final = 5  # each a hundred times the last; then the weights are drawn without correlation
BETWEEN_M: Final = 0.01  # of H: between the places of a gradient's differences


class Reading(NamedTuple):
    """What the aircraft knows of the air where it is; NaN: not known."""

    x_m: float
    z_m: float
    wind_mps: float  # u
    updraft_mps: float  # w as it is measured
    airspeed_mps: float  # V, horizontal
    energy_mps: float  # e
    since_s: float  # for so long it is the mean


class Predicted(NamedTuple):
    """What the map says of some places, arrays of one shape; standard deviations beside it."""

    wind_mps: Floats
    updraft_mps: Floats
    excess_mps: Floats  # w − (1 + p) S(u)
    wind_sd_mps: Floats
    updraft_sd_mps: Floats
    excess_sd_mps: Floats


class Weights(NamedTuple):
    """The map's weights as a normal distribution."""

    mean: Floats  # (n,)
    covariance: Floats  # (n, n)


class Trend(NamedTuple):
    """How all winds change together."""

    rate_per_s: float  # r, as a share of them
    variance: float  # of it
    shared: Floats  # (n,) its covariance with the weights


def _updated(
    mean: Floats,
    covariance: Floats,
    trend: Trend,
    rows: Floats,
    measured: Floats,
    noise: Floats,
) -> tuple[Weights, Trend, float]:
    """After m measurements (m,) with rows (m, n) and variances (m,); and how well they were
    foreseen, as the logarithm of their likelihood."""
    crossed = rows @ covariance
    spread = crossed @ rows.T + np.diag(noise)
    root = np.linalg.cholesky(spread)
    white = np.linalg.inv(root)
    innovation = measured - rows @ mean
    foreseen = white @ innovation
    likelihood = -0.5 * float(foreseen @ foreseen) - float(np.log(np.diag(root)).sum())
    most = GATE * np.sqrt(np.diag(spread))
    learned = white @ crossed
    news = white @ np.clip(innovation, -most, most)
    weights = Weights(mean + news @ learned, covariance - learned.T @ learned)
    of_trend = white @ (rows @ trend.shared)
    changed = Trend(
        rate_per_s=trend.rate_per_s + float(of_trend @ news),
        variance=max(0.0, trend.variance - float(of_trend @ of_trend)),
        shared=trend.shared - of_trend @ learned,
    )
    return weights, changed, likelihood


def root_of(covariance: Floats) -> Floats:
    """A root (n, n) of a covariance that rounding may have left a little indefinite."""
    jitter = JITTER * float(np.diag(covariance).max())
    for _ in range(JITTERS):
        try:
            root = np.linalg.cholesky(covariance + jitter * np.eye(len(covariance)))
        except np.linalg.LinAlgError:
            jitter *= 100.0
        else:
            return np.asarray(root, dtype=np.float64)
    return np.diag(np.sqrt(np.diag(covariance).clip(0.0)))


def lasting_s(time_s: float) -> float:
    """For how long a trend of now goes on within a time [s], in the mean."""
    return TREND_S * (1.0 - exp(-time_s / TREND_S))


class LiftMap:
    """The map of one flight.  It begins with the first reading of the wind."""

    def __init__(
        self, ground: Ground, box: Box, polar: GlidePolar, first: Reading, *, pitot: bool
    ) -> None:
        """first: where the wind is read first; it is to be taken too.

        Errors: ValueError for a box that is not finite, or a wind that is not positive.
        """
        x, z, wind_mps = first.x_m, first.z_m, first.wind_mps
        if not (isfinite(x) and isfinite(z) and isfinite(wind_mps) and wind_mps > 0.0):
            raise ValueError(
                f"first reading: wind {wind_mps} m/s at x {x}, z {z} m: the map needs a positive"
                " wind at a known place"
            )
        self.basis = FlowBasis(ground, box)
        self.polar = polar
        priors = [self.basis.prior(x, z, wind_mps, pitot, sd) for sd in (STREAMLINE_MPS, LOOSE_MPS)]
        self.maps = [Weights(prior.mean, prior.covariance) for prior in priors]
        self._forgotten = [prior.covariance / FORGET_S for prior in priors]
        steady = Trend(0.0, TREND_PER_S**2, np.zeros(self.basis.count))
        self.trends = [steady, steady]
        self.gusts_mps2 = (GUSTS_FIRST * wind_mps) ** 2  # their variance
        self.readings = 0
        self._log_odds = log(LOOSE_FIRST / (1.0 - LOOSE_FIRST))

    @property
    def loose(self) -> float:
        """How likely the ground's profile says nothing about the flow, 0 … 1."""
        return 1.0 / (1.0 + exp(-self._log_odds))

    def take(self, reading: Reading, gap_s: float = 0.0) -> None:
        """Update by one reading; what is not finite in it is left out.

        gap_s: between the reading before and the beginning of this one.
        """
        if not (isfinite(reading.x_m) and isfinite(reading.z_m)):
            return
        u, w = self.basis.features(reading.x_m, reading.z_m)
        rows, values, noise = self._measured(reading, u[0], w[0])
        if not rows:
            return
        matrix, measured, variance = np.array(rows), np.array(values), np.array(noise)
        likelihood = [0.0, 0.0]
        for k in range(2):
            changed, trend = self._changed(k, gap_s + reading.since_s)
            self.maps[k], self.trends[k], likelihood[k] = _updated(
                *changed, trend, matrix, measured, variance
            )
        limit = log(1.0 / WEIGHT_LEAST)
        moved = self._log_odds + likelihood[1] - likelihood[0]
        self._log_odds = max(-limit, min(limit, moved))
        self._watch_gusts(reading, u[0], w[0])
        self.readings += 1

    def _measured(
        self, reading: Reading, u: Floats, w: Floats
    ) -> tuple[list[Floats], list[float], list[float]]:
        """Rows, values and variances of what is known in a reading."""
        basis, gusts = self.basis, self.gusts_mps2
        rows: list[Floats] = []
        values: list[float] = []
        noise: list[float] = []
        if isfinite(reading.wind_mps):
            rows.append(u)
            values.append(reading.wind_mps)
            noise.append(SAMPLES_U * (gusts + SD_U_MPS**2))
        if isfinite(reading.updraft_mps):
            biased = w.copy()
            biased[basis.updraft_bias] = 1.0
            rows.append(biased)
            values.append(reading.updraft_mps)
            noise.append(SAMPLES_W * (gusts + SD_W_MPS**2))
        if isfinite(reading.energy_mps) and isfinite(reading.airspeed_mps):
            falls = float(sink(self.polar, reading.airspeed_mps))
            scaled = w.copy()
            scaled[basis.sink_scale] = -falls
            rows.append(scaled)
            values.append(reading.energy_mps + falls)
            noise.append(SAMPLES_W * (gusts + SD_E_MPS**2))
        return rows, values, noise

    def _changed(self, k: int, since_s: float) -> tuple[Weights, Trend]:
        """Weights and trend after some time without a reading."""
        mean, covariance = self.maps[k]
        rate_per_s, variance, shared = self.trends[k]
        dt = max(0.0, since_s) if isfinite(since_s) else 0.0
        kept = exp(-dt / TREND_S)
        for_s = TREND_S * (1.0 - kept)
        flow = mean.copy()
        flow[self.basis.flow :] = 0.0  # a polar and a sensor do not change with the wind
        grown: Floats = dt * self._forgotten[k]
        grown += covariance
        # (for_s c + ½ v θ) θᵀ and its transpose: one outer product of the two that are the same.
        scaled = for_s**2 * variance + SCALE_PER_ROOT_S**2 * dt
        half = np.outer(for_s * shared + (0.5 * scaled) * flow, flow)
        grown += half
        grown += half.T
        trend = Trend(
            rate_per_s=kept * rate_per_s,
            variance=kept * kept * variance + (1.0 - kept * kept) * TREND_PER_S**2,
            shared=kept * (shared + for_s * variance * flow),
        )
        return Weights(mean + for_s * rate_per_s * flow, grown), trend

    def _watch_gusts(self, reading: Reading, u: Floats, w: Floats) -> None:
        """Follow the variance of what the field does not explain."""
        mean = self.maps[int(self._log_odds > 0.0)].mean
        off = [reading.wind_mps - float(u @ mean)]
        off.append(reading.updraft_mps - float(w @ mean) - float(mean[self.basis.updraft_bias]))
        squares = [value * value for value in off if isfinite(value)]
        if squares:
            gain = min(1.0, max(0.0, reading.since_s) / GUSTS_S)
            self.gusts_mps2 += gain * (sum(squares) / len(squares) - self.gusts_mps2)

    def at(self, x_m: ArrayLike, z_m: ArrayLike) -> Predicted:
        """The air at m places: arrays of shape (m,)."""
        u, w = self.basis.features(x_m, z_m)
        chances = (1.0 - self.loose, self.loose)
        moments = [self._moments(weights, u, w) for weights in self.maps]
        means = [sum(c * m[0][i] for c, m in zip(chances, moments, strict=True)) for i in range(3)]
        spread = [
            np.sqrt(
                sum(
                    c * (m[1][i] + (m[0][i] - means[i]) ** 2)
                    for c, m in zip(chances, moments, strict=True)
                )
            )
            for i in range(3)
        ]
        return Predicted(
            wind_mps=np.asarray(means[0]),
            updraft_mps=np.asarray(means[1]),
            excess_mps=np.asarray(means[2]),
            wind_sd_mps=spread[0],
            updraft_sd_mps=spread[1],
            excess_sd_mps=spread[2],
        )

    def _moments(
        self, weights: Weights, u: Floats, w: Floats
    ) -> tuple[tuple[Floats, ...], tuple[Floats, ...]]:
        """Means and variances of u, w and E at some places, by one of the two maps."""
        mean, covariance = weights
        wind, updraft = u @ mean, w @ mean
        scale = 1.0 + mean[self.basis.sink_scale]
        falls = sink(self.polar, wind)
        rows = w - (scale * sink_slope(self.polar, wind))[:, None] * u
        rows[:, self.basis.sink_scale] -= falls
        variances = tuple(
            np.einsum("ij,ij->i", row @ covariance, row).clip(0.0) for row in (u, w, rows)
        )
        return (wind, updraft, updraft - scale * falls), variances

    def excess_gradient(self, x_m: float, z_m: float) -> tuple[float, float]:
        """(dE/dx, dE/dz) [1/s] of the mean at one place."""
        h = BETWEEN_M * self.basis.box.height_m
        x = np.array([x_m + h, x_m - h, x_m, x_m])
        z = np.array([z_m, z_m, z_m + h, z_m - h])
        excess = self.at(x, z).excess_mps
        return (
            float(excess[0] - excess[1]) / (2.0 * h),
            float(excess[2] - excess[3]) / (2.0 * h),
        )

    def mean(self) -> Floats:
        """The weights (n,) that are most likely."""
        return self.maps[int(self._log_odds > 0.0)].mean

    @property
    def trend(self) -> tuple[float, float]:
        """How fast all winds change [1/s, a share of them], and its standard deviation."""
        chosen = self.trends[int(self._log_odds > 0.0)]
        return chosen.rate_per_s, sqrt(chosen.variance)

    def ahead(self, time_s: float) -> float:
        """The wind that is foreseen after a time [s], as a multiple of what it is now."""
        return exp(self.trend[0] * lasting_s(time_s))

    def draws_ahead(self, normals: Floats, others: Floats, time_s: float) -> Floats:
        """The same (m,) of the rows of `draws`, each with a trend drawn with it: others, m normal
        numbers."""
        rates = np.empty(len(normals))
        for k, chosen in enumerate(self._fractions(len(normals))):
            if chosen.any():
                rate_per_s, variance, shared = self.trends[k]
                known = np.linalg.solve(root_of(self.maps[k].covariance), shared)
                left = sqrt(max(0.0, variance - float(known @ known)))
                rates[chosen] = rate_per_s + normals[chosen] @ known + left * others[chosen]
        result: Floats = np.exp(rates * lasting_s(time_s))
        return result

    def _fractions(self, rows: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Which rows of a sample are of which of the two maps: as many as its weight says."""
        loose = (np.arange(rows) + 0.5) / rows < self.loose
        return ~loose, loose

    def draws(self, normals: Floats, spread: float = 1.0) -> Floats:
        """Weights (m, n) drawn from the posterior, of m rows of normal numbers (m, n).

        Each map has as many rows as its weight says; spread widens them about its mean.
        """
        drawn = np.empty_like(normals)
        for k, chosen in enumerate(self._fractions(len(normals))):
            if chosen.any():
                mean, covariance = self.maps[k]
                drawn[chosen] = mean + spread * normals[chosen] @ root_of(covariance).T
        return drawn
