"""Power spectra of what was logged: Welch's method over the stretches that are whole."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.logs.flight_data import Series

Floats = NDArray[np.float64]

SEGMENT_S = 8.0  # the lowest frequency told apart is its inverse
LEAST_SEGMENTS = 1.0
GAPS = 5.0  # times the usual step: a stretch ends there


class Spectrum(NamedTuple):
    """One-sided power spectral density."""

    frequency_hz: Floats  # shape (n,), from 1 / segment to half the sampling rate
    density: Floats  # unit² / Hz
    peak_hz: float  # where most of the power per octave is
    rms: float  # of the whole spectrum
    seconds: float  # of signal it was made from


def spectrum_of(
    series: Series | None, column: str, spans: Sequence[tuple[float, float]]
) -> Spectrum | None:
    """The spectrum of a column over all spans (from, to [s]), each without its mean.

    Stretches shorter than a segment, and gaps in the samples, are left out; None where nothing
    is left.
    """
    from scipy.signal import welch

    if series is None or len(series) < 16:
        return None
    step = float(np.median(np.diff(series.time_s)))
    if step <= 0.0:
        return None
    size = round(SEGMENT_S / step)
    total: Floats | None = None
    frequency = np.array([])
    seconds = 0.0
    for begin, end in spans:
        for time, values in _whole(series.within(begin, end), column, GAPS * step):
            grid = np.arange(time[0], time[-1], step)
            if len(grid) < LEAST_SEGMENTS * size or size < 16:
                continue
            even = np.interp(grid, time, values)
            frequency, density = welch(even, 1.0 / step, nperseg=size, detrend="constant")
            weight = len(grid) * step
            total = density * weight if total is None else total + density * weight
            seconds += weight
    if total is None:
        return None
    density = total[1:] / seconds
    frequency = frequency[1:]
    rms = float(np.sqrt(np.sum(density) * (frequency[1] - frequency[0])))
    return Spectrum(
        frequency_hz=frequency,
        density=density,
        peak_hz=float(frequency[np.argmax(frequency * density)]),
        rms=rms,
        seconds=seconds,
    )


def _whole(series: Series, column: str, gap_s: float) -> list[tuple[Floats, Floats]]:
    """The stretches of a series without a gap."""
    known = np.isfinite(series[column])
    time, values = series.time_s[known], series[column][known]
    if len(time) < 2:
        return []
    cuts = np.flatnonzero(np.diff(time) > gap_s) + 1
    return [
        (t, v)
        for t, v in zip(np.split(time, cuts), np.split(values, cuts), strict=True)
        if len(t) > 1
    ]
