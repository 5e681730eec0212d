"""The functions that the map's wind is a sum of, and what is known of their weights beforehand.

In the vertical plane f = u − i w is analytic in ζ = x + i z where the air is a potential flow.
With poles p_k under the ground

    f = u0 − i w0 + s (z − zc)  [u only]  +  Σ_k (a_k + i b_k) N / (ζ − p_k)  +  bumps

u, w  m/s  wind downstream and up            x, z  m  place, soaring frame
s     1/s  shear, which is no potential flow  N    m  (m/s) of a pole of weight 1

and the ground is a streamline, n · (u, w) = 0.  Two more weights belong to no place: the error of
the polar's sink as a fraction of it, and the bias of the measured updraft.

N = σ √(spacing h / π): poles of unit variance on a line at the spacing make at the height h above
it a wind whose variance is N² Σ 1/|ζ − p|² = N² π / (h spacing) = σ².

The lengths are fractions of H, the height of the box that the aircraft may be in, so that the same
figures serve a tunnel of 3 m and a hill of 40 m.
"""

from __future__ import annotations

from itertools import pairwise
from math import hypot, isfinite, pi, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tgl_soar.types import Ground

Floats = NDArray[np.float64]

POLE_DEPTH: Final = 0.10  # of H, under the ground along its normal
POLE_SPACING: Final = 0.7  # of that depth: closer than they are deep, they make no ripples
BEYOND: Final = 0.3  # of H, how far poles go on upstream and downstream of the box
BUMP_WIDTH: Final = 0.4  # of H
STREAMLINE_SPACING: Final = 0.5  # of the depth
STREAMLINE_HEIGHT: Final = 0.02  # of H, above the ground
POLES_MAX: Final = 45  # of a long box: farther apart and deeper, so that a reading stays cheap

# Standard deviations beforehand, in a wind of 9 m/s; all winds scale together.
WIND_MPS: Final = 9.0
POLES_MPS: Final = 2.4  # of the wind that the poles make at half of H
FAR_WIND_MPS: Final = 3.0  # u0 about the first reading: a hill speeds the wind up by as much
FIRST_WIND_MPS: Final = 0.7  # the wind where the first reading is taken is that, give or take
UPDRAFT_MPS: Final = 0.3  # w0
SHEAR_MPS: Final = 0.5  # of u over H
BUMPS_MPS: Final = 0.2
SINK_SCALE: Final = 0.10  # of the polar
BIAS_PITOT_MPS: Final = 0.06  # of the measured updraft
BIAS_MPS: Final = 0.18  # the same without a pitot


class Box(NamedTuple):
    """Where the aircraft may be, soaring frame; finite."""

    x_min_m: float
    x_max_m: float
    z_min_m: float
    z_max_m: float

    @property
    def height_m(self) -> float:
        """H."""
        return self.z_max_m - self.z_min_m


class Prior(NamedTuple):
    """What is known of the weights before any flight."""

    mean: Floats  # (n,)
    covariance: Floats  # (n, n)


class Streamline(NamedTuple):
    """Places just above the ground, and the ground's normal there."""

    x_m: Floats  # (m,)
    z_m: Floats
    normal_x: Floats
    normal_z: Floats


NO_STREAMLINE: Final = Streamline(np.zeros(0), np.zeros(0), np.zeros(0), np.zeros(0))


class FlowBasis:
    """All functions of the map over one ground and one box.

    Errors: ValueError for a box that is not finite or empty.
    """

    def __init__(self, ground: Ground, box: Box) -> None:
        if not all(map(isfinite, box)) or not (
            box.x_min_m < box.x_max_m and box.z_min_m < box.z_max_m
        ):
            raise ValueError(
                f"box {tuple(box)}: a map needs a finite fence, FENCE_X_MIN < FENCE_X_MAX and"
                " FENCE_Z_MIN < FENCE_Z_MAX"
            )
        self.box = box
        height = box.height_m
        profile = _profile(ground, box)
        length = sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(profile))
        self.spacing_m = max(POLE_SPACING * POLE_DEPTH * height, length / (POLES_MAX - 1))
        depth = self.spacing_m / POLE_SPACING
        foot = _along(profile, self.spacing_m)
        self._pole_x = foot.x_m - depth * foot.normal_x
        self._pole_z = foot.z_m - depth * foot.normal_z
        self.poles = len(self._pole_x)
        self._pole_m2ps = POLES_MPS * sqrt(self.spacing_m * 0.5 * height / pi)
        self._middle_z = 0.5 * (box.z_min_m + box.z_max_m)
        step = BUMP_WIDTH * height
        across = max(2, round((box.x_max_m - box.x_min_m) / step) + 1)
        columns = np.linspace(box.x_min_m, box.x_max_m, min(across, 6))
        rows = np.linspace(box.z_min_m, box.z_max_m, 3)
        bump_x, bump_z = np.meshgrid(columns, rows, indexing="ij")
        self._bump_x, self._bump_z = bump_x.ravel(), bump_z.ravel()
        self._bump_width = max(step, float(columns[1] - columns[0]))
        self.bumps = self._bump_x.size
        self.streamline = (
            _streamline(profile, STREAMLINE_SPACING * depth, height)
            if ground.points > 0
            else NO_STREAMLINE
        )

    @property
    def flow(self) -> int:
        """How many weights make the wind; two nuisances follow them."""
        return 3 + 2 * self.poles + 2 * self.bumps

    @property
    def sink_scale(self) -> int:
        """Which weight is the error of the polar's sink, as a fraction of it."""
        return self.flow

    @property
    def updraft_bias(self) -> int:
        """Which weight is the bias of the measured updraft [m/s]."""
        return self.flow + 1

    @property
    def count(self) -> int:
        """How many weights there are."""
        return self.flow + 2

    def features(self, x_m: ArrayLike, z_m: ArrayLike) -> tuple[Floats, Floats]:
        """What a unit of each weight makes of u and of w [m/s] at m places: (m, n) each."""
        x, z = np.atleast_1d(np.asarray(x_m, float)), np.atleast_1d(np.asarray(z_m, float))
        k, b = self.poles, self.bumps
        u, w = np.zeros((x.size, self.count)), np.zeros((x.size, self.count))
        u[:, 0] = 1.0
        w[:, 1] = 1.0
        u[:, 2] = z - self._middle_z
        dx, dz = x[:, None] - self._pole_x, z[:, None] - self._pole_z
        scale = self._pole_m2ps / np.maximum(dx * dx + dz * dz, 1e-12)
        real, imaginary = dx * scale, -dz * scale  # of N / (ζ − p)
        u[:, 3 : 3 + k] = real
        u[:, 3 + k : 3 + 2 * k] = -imaginary
        w[:, 3 : 3 + k] = -imaginary  # f = u − i w
        w[:, 3 + k : 3 + 2 * k] = -real
        first = 3 + 2 * k
        squares = (x[:, None] - self._bump_x) ** 2 + (z[:, None] - self._bump_z) ** 2
        bump = np.exp(squares * (-0.5 / self._bump_width**2))
        u[:, first : first + b] = bump
        w[:, first + b : first + 2 * b] = bump
        return u, w

    def prior(
        self, x_m: float, z_m: float, wind_mps: float, pitot: bool, streamline_mps: float
    ) -> Prior:
        """What is known before the flight, but for the wind [m/s] at the first place.

        streamline_mps: standard deviation of the flow through the ground in a wind of 9 m/s.
        """
        scale = wind_mps / WIND_MPS
        sd = np.empty(self.count)
        sd[0], sd[1] = FAR_WIND_MPS * scale, UPDRAFT_MPS * scale
        sd[2] = SHEAR_MPS * scale / self.box.height_m
        sd[3 : 3 + 2 * self.poles] = scale
        sd[3 + 2 * self.poles : self.flow] = BUMPS_MPS * scale
        sd[self.sink_scale] = SINK_SCALE
        sd[self.updraft_bias] = BIAS_PITOT_MPS if pitot else BIAS_MPS
        mean, covariance = np.zeros(self.count), np.diag(sd * sd)
        mean[0] = wind_mps
        line = self.streamline
        if line.x_m.size:
            u, w = self.features(line.x_m, line.z_m)
            through = line.normal_x[:, None] * u + line.normal_z[:, None] * w
            noise = np.full(line.x_m.size, (streamline_mps * scale) ** 2)
            mean, covariance = conditioned(mean, covariance, through, -through @ mean, noise)
        here, _ = self.features(x_m, z_m)
        noise = np.array([(FIRST_WIND_MPS * scale) ** 2])
        return Prior(*conditioned(mean, covariance, here, wind_mps - here @ mean, noise))


def conditioned(
    mean: Floats, covariance: Floats, rows: Floats, innovation: Floats, noise: Floats
) -> tuple[Floats, Floats]:
    """Mean (n,) and covariance (n, n) after m measurements: rows (m, n), variances (m,)."""
    crossed = covariance @ rows.T
    spread = rows @ crossed + np.diag(noise)
    gain = np.linalg.solve(spread, crossed.T).T
    after = covariance - gain @ crossed.T
    return mean + gain @ innovation, 0.5 * (after + after.T)


def _profile(ground: Ground, box: Box) -> list[tuple[float, float]]:
    """The ground under the box and a little beyond; level where nothing is known of it."""
    margin = BEYOND * box.height_m
    low, high = box.x_min_m - margin, box.x_max_m + margin
    points = list(zip(ground.x_m[: ground.points], ground.z_m[: ground.points], strict=True))
    if not points:
        return [(low, box.z_min_m), (high, box.z_min_m)]
    x = [point[0] for point in points]
    z = [point[1] for point in points]
    ends = [(at, float(np.interp(at, x, z))) for at in (low, high)]
    return [ends[0], *(point for point in points if low < point[0] < high), ends[1]]


def _along(profile: list[tuple[float, float]], spacing_m: float) -> Streamline:
    """Places along the profile at a spacing, and the normal there, upwards."""
    corners = np.array(profile)
    parts = np.diff(corners, axis=0)
    lengths = np.hypot(parts[:, 0], parts[:, 1])
    path = np.concatenate([[0.0], np.cumsum(lengths)])
    at = np.arange(0.5 * spacing_m, path[-1], spacing_m)
    part = np.clip(np.searchsorted(path, at, side="right") - 1, 0, len(parts) - 1)
    tangent = parts[part] / lengths[part, None]
    place = corners[part] + (at - path[part])[:, None] * tangent
    return Streamline(
        x_m=place[:, 0], z_m=place[:, 1], normal_x=-tangent[:, 1], normal_z=tangent[:, 0]
    )


def _rounded(places: Streamline) -> Streamline:
    """The same with its corners rounded over twice the poles' depth: what lies above the poles
    cannot follow them, and those of a hill are the polygon's, not the hill's."""
    half = round(1.0 / STREAMLINE_SPACING)
    weights = np.ones(2 * half + 1) / (2 * half + 1)
    x, z, nx, nz = (
        np.convolve(np.pad(column, half, mode="reflect", reflect_type="odd"), weights, "valid")
        for column in places
    )
    length = np.hypot(nx, nz)
    return Streamline(x_m=x, z_m=z, normal_x=nx / length, normal_z=nz / length)


def _streamline(
    profile: list[tuple[float, float]], spacing_m: float, height_m: float
) -> Streamline:
    """From the upstream end to the crest; behind it the flow may separate: nothing is known."""
    places = _rounded(_along(profile, spacing_m))
    crest_x = max(profile, key=lambda point: (point[1], -point[0]))[0]
    level = max(z for _, z in profile) == min(z for _, z in profile)
    upstream = np.full(places.x_m.size, True) if level else places.x_m <= crest_x
    above = STREAMLINE_HEIGHT * height_m
    return Streamline(
        x_m=(places.x_m + above * places.normal_x)[upstream],
        z_m=(places.z_m + above * places.normal_z)[upstream],
        normal_x=places.normal_x[upstream],
        normal_z=places.normal_z[upstream],
    )
