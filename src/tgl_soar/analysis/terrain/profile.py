"""The few points of a ground that lie nowhere below it.

A site file takes `GROUND_POINTS` points of its ground.  Of all choices among the samples of a
profile the one whose chords leave the profile least is found exactly, by dynamic programming over
the last point and the number of points; then all points are raised by what the chords lie below the
samples.  So the result is nowhere below a sample, and above it by a height that is known.
"""

from __future__ import annotations

from math import ceil
from typing import NamedTuple

import numpy as np

from tgl_soar.air.field import FloatArray
from tgl_soar.types import GROUND_POINTS

ENOUGH_M = 0.1  # closer than any elevation model: no more points than this needs


class ReducedProfile(NamedTuple):
    """Points (x, z) [m], and how far at most they lie above the samples."""

    points: list[tuple[float, float]]
    above_m: float


def reduced(x_m: FloatArray, z_m: FloatArray, most: int = GROUND_POINTS) -> ReducedProfile:
    """Few points for many, x growing.  Errors: ValueError for fewer than two samples."""
    count = len(x_m)
    if count < 2 or most < 2:
        raise ValueError(f"{count} samples to {most} points: two or more of each")
    off = _chord_errors(x_m, z_m)
    worst = off[0].copy()  # of the best way from the first sample to each, by one chord
    before: list[FloatArray] = []
    while worst[-1] > ENOUGH_M and len(before) + 2 < most:
        ways = np.maximum(worst[:, None], off)
        before.append(np.argmin(ways, axis=0))
        worst = np.min(ways, axis=0)
    chosen = [count - 1]
    for step in reversed(before):
        chosen.append(int(step[chosen[-1]]))
    chosen = sorted({0, *chosen})
    x, z = x_m[chosen], z_m[chosen]
    raised_m = max(0.0, float((z_m - np.interp(x_m, x, z)).max()))
    # Rounded up to centimetres, and x to millimetres: the samples' own places are no better.
    points = [(round(float(a), 3), ceil((float(b) + raised_m) * 100.0) / 100.0)
              for a, b in zip(x, z, strict=True)]  # fmt: skip
    above = np.interp(x_m, [a for a, _ in points], [b for _, b in points]) - z_m
    return ReducedProfile(points, float(above.max()))


def _chord_errors(x: FloatArray, z: FloatArray) -> FloatArray:
    """How far [m] the samples between i and j lie from the chord i to j at most; inf for j < i."""
    count = len(x)
    off = np.full((count, count), np.inf)
    np.fill_diagonal(off, 0.0)
    for i in range(count - 1):
        off[i, i + 1] = 0.0
        for j in range(i + 2, count):
            chord = z[i] + (z[j] - z[i]) * ((x[i + 1 : j] - x[i]) / (x[j] - x[i]))
            off[i, j] = np.abs(z[i + 1 : j] - chord).max()
    return off
