"""The contour from a survey's path.

With q across the line, positive upstream, and s up along it, the contour is s = f(q).  An aircraft
that is carried along it returns to its place at the rate lambda, and is late, by e:

    s(t) = f(q(t)) + e(t) + drift in gusts         e' = -lambda e - f'(q) q'

f is a broken line of KNOTS points, found by least squares with the penalty mu on its third
differences: a parabola costs nothing.  mu and lambda are those with which parts of the flight that
are left out are predicted best: gusts differ from one pass to the next, the contour does not.  f'
is that of the f before, first of the one without e: passes both ways leave little of e in it.

How certain f is follows from what is left: noise of the residuals' spectrum at zero frequency,
that is their variance times the time over which they are alike.  Two things belong to it that the
residuals do not show.  f has followed the noise with as many of its freedoms as the penalty leaves
it, so that of n / alike independent residuals that many are missing; and what the penalty has
smoothed away is missing in f.  The penalty is the prior of f, and f's posterior
covariance, s² (H'H + mu P)^-1, has both (Wahba, J. R. Stat. Soc. B 45, 1983).
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, exp, sin
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.logs.flight_data import Floats
from tgl_soar.control.survey import UPSTREAM

KNOTS: Final = 41
TIMES: Final = 3  # f is found, each time with f' of the time before
# Over how many knots f is smoothed; mu is its sixth power, times the samples at a knot.  What a
# gust does lasts for 1 / lambda, in which the line passes two knots: over less than three of those
# it would be taken for the contour's shape.
WIDTHS: Final = (6.0, 8.0, 12.0, 16.0, 24.0, 48.0)
# lambda: 0.15 over a small hill, 2 in a tunnel at its strongest.
RETURNS_PER_S: Final = tuple(0.1 * 2.0 ** (0.5 * power) for power in range(11))
# Of the time, each left out once: a part is longer than a gust's effect lasts, which is a few
# 1 / lambda, and shorter than a way, so that the other pass of the same place is kept.
PARTS: Final = 10
FREE_LEAST: Final = 0.1  # of the independent residuals that f has not followed: fewer say nothing
LEAST_S: Final = 10.0  # of survey on each way: less draws nothing
LEAST_M: Final = 0.1


class SurveyError(ValueError):
    """Why there is no contour to be drawn."""


class SurveyPath(NamedTuple):
    """What was flown, sample by sample."""

    time_s: Floats
    x_m: Floats
    z_m: Floats
    line_x_m: Floats  # a point of the line that was flown
    line_z_m: Floats
    standing: Floats  # DOWNSTREAM, UPSTREAM or HOMEWARD
    eta_rad: float  # of the line


class DrawnContour(NamedTuple):
    """A piece of contour, from downstream to upstream: rising air is on its left."""

    x_m: Floats
    z_m: Floats
    sigma_m: Floats  # standard deviation along the line
    return_per_s: float  # lambda
    late_m: float  # rms of e
    drift_m: float  # rms of what is left, along the line

    @property
    def length_m(self) -> float:
        """Along it."""
        return float(np.hypot(np.diff(self.x_m), np.diff(self.z_m)).sum())


def drawn_contour(path: SurveyPath) -> DrawnContour:
    """The contour of a survey.  Errors: `SurveyError` for one that is too short to draw by."""
    good = np.isfinite(path.time_s + path.x_m + path.z_m + path.line_x_m + path.line_z_m)
    path = path._replace(
        time_s=path.time_s[good],
        x_m=path.x_m[good],
        z_m=path.z_m[good],
        line_x_m=path.line_x_m[good],
        line_z_m=path.line_z_m[good],
        standing=path.standing[good],
    )
    c, s = cos(path.eta_rad), sin(path.eta_rad)
    q, along = c * path.z_m - s * path.x_m, c * path.x_m + s * path.z_m
    upstream = path.standing == UPSTREAM
    low, high = _covered(path.time_s, q, upstream)
    inside = (q >= low) & (q <= high)
    knots = np.linspace(low, high, KNOTS)
    moved = np.diff(c * path.line_z_m - s * path.line_x_m, prepend=np.nan)
    moved[0] = 0.0
    flown = _Slid(time_s=path.time_s, q=q, along=along, moved=moved, inside=inside)
    found = _fitted(flown, knots, np.zeros(len(q)), WIDTHS)
    rate, late = np.inf, np.zeros(len(q))
    for _ in range(TIMES):
        slope = np.gradient(found.f, knots)
        lates = {each: _late(flown, knots, slope, each) for each in RETURNS_PER_S}
        fits = {each: _fitted(flown, knots, late, (found.width,)) for each, late in lates.items()}
        rate = min(fits, key=lambda each: fits[each].prediction_error)
        late = lates[rate]
        found = _fitted(flown, knots, late, WIDTHS)
    return DrawnContour(
        x_m=c * found.f - s * knots,
        z_m=s * found.f + c * knots,
        sigma_m=found.sigma,
        return_per_s=rate,
        late_m=float(np.sqrt(np.mean(late[inside] ** 2))),
        drift_m=found.left,
    )


class _Slid(NamedTuple):
    """The samples in the line's own axes."""

    time_s: Floats
    q: Floats
    along: Floats
    moved: Floats  # by which q of the line has grown since the sample before
    inside: NDArray[np.bool_]  # where the way was passed both ways


class _Drawn(NamedTuple):
    """f at the knots."""

    f: Floats
    sigma: Floats
    left: float  # rms of what it leaves
    width: float  # of `WIDTHS`
    prediction_error: float  # mean square by which parts that are left out differ


def _late(flown: _Slid, knots: Floats, slope: Floats, rate_per_s: float) -> Floats:
    """e at every sample."""
    driven = -np.interp(flown.q, knots, slope) * flown.moved
    steps = np.diff(flown.time_s, prepend=flown.time_s[0])
    late = np.zeros(len(driven))
    for n in range(1, len(driven)):
        late[n] = exp(-rate_per_s * steps[n]) * late[n - 1] + driven[n]
    return late


def _fitted(flown: _Slid, knots: Floats, late: Floats, widths: Sequence[float]) -> _Drawn:
    """The best f of these widths."""
    inside = flown.inside
    hats, y = _hats(flown.q[inside], knots), (flown.along - late)[inside]
    bend = np.diff(np.eye(len(knots)), 3, axis=0)
    penalty = bend.T @ bend
    time_s = flown.time_s[inside]
    penalties = [len(y) / KNOTS * width**6 for width in widths]
    errors = [_prediction_error(hats, y, time_s, mu * penalty) for mu in penalties]
    best = int(np.argmin(errors))
    mu = penalties[best]
    normal = hats.T @ hats
    inverse = np.linalg.inv(normal + mu * penalty)
    f = inverse @ hats.T @ y
    left = y - hats @ f
    alike = _alike(left)
    free = 1.0 - float(np.trace(normal @ inverse)) * alike / len(y)
    variance = float(np.mean(left**2)) * alike / max(free, FREE_LEAST)
    return _Drawn(
        f=f,
        sigma=np.sqrt(variance * np.diag(inverse)),
        left=float(np.sqrt(np.mean(left**2))),
        width=widths[best],
        prediction_error=min(errors),
    )


def _covered(time_s: Floats, q: Floats, upstream: NDArray[np.bool_]) -> tuple[float, float]:
    """From where to where it was passed both ways.  Errors: `SurveyError`."""
    ends = []
    for name, here in (("downstream", ~upstream), ("upstream", upstream)):
        lasted = float(np.sum(np.diff(time_s)[here[1:]])) if here.any() else 0.0
        if lasted < LEAST_S:
            raise SurveyError(
                f"{lasted:.0f} s of survey on the way {name}: {LEAST_S:.0f} s and more are needed"
                " each way, for the aircraft is late on both"
            )
        ends.append((float(q[here].min()), float(q[here].max())))
    low, high = max(end[0] for end in ends), min(end[1] for end in ends)
    if not high - low >= LEAST_M:
        raise SurveyError(
            f"{max(0.0, high - low):.2f} m of the way were passed both ways: {LEAST_M:g} m and more"
            " are needed"
        )
    return low, high


def _hats(q: Floats, knots: Floats) -> Floats:
    """A row a sample: how much each knot counts there."""
    step = knots[1] - knots[0]
    hats: Floats = np.clip(1.0 - np.abs(q[:, None] - knots[None, :]) / step, 0.0, 1.0)
    return hats


def _prediction_error(hats: Floats, y: Floats, time_s: Floats, penalty: Floats) -> float:
    """Mean square by which parts of the flight differ from what the others say of them."""
    edges = np.linspace(time_s[0], time_s[-1], PARTS + 1)
    part = np.clip(np.searchsorted(edges, time_s, side="right") - 1, 0, PARTS - 1)
    total = 0.0
    for n in range(PARTS):
        out = part == n
        kept = hats[~out]
        # A hair of a ridge: a knot may be seen in this part alone.
        normal = kept.T @ kept + penalty + 1e-9 * np.eye(hats.shape[1])
        weights = np.linalg.solve(normal, kept.T @ y[~out])
        total += float(np.sum((y[out] - hats[out] @ weights) ** 2))
    return total / len(y)


def _alike(left: Floats) -> float:
    """1 + 2 (sum of the residuals' correlations, up to the first that is none)."""
    total, zero = 1.0, float(np.dot(left, left))
    for k in range(1, len(left) // 4):
        correlation = float(np.dot(left[:-k], left[k:])) / zero
        if correlation <= 0.0:
            break
        total += 2.0 * correlation
    return total
