"""Spectra of what was logged: noise and tones of known power, and which stretches count."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np
import pytest

from tgl_soar.analysis.logs.flight_data import Series
from tgl_soar.analysis.report.spectra import spectrum_of

DT_S = 0.05
SEGMENT_S = 8.0
ALL = [(0.0, 1e6)]


def series(seconds: float = 40.0, tone_hz: float = 1.0, amplitude: float = 3.0) -> Series:
    time_s = DT_S * np.arange(float(round(seconds / DT_S) + 1))
    return Series(time_s, {"v": 7.0 + amplitude * np.sin(2.0 * pi * tone_hz * time_s)}, "made")


@pytest.mark.parametrize("tone_hz", [0.5, 1.0, 3.25])
def test_a_tone_is_found_with_its_power(tone_hz: float) -> None:
    """Its rms is the amplitude over the square root of 2; the mean is no part of it."""
    found = spectrum_of(series(tone_hz=tone_hz), "v", ALL)
    assert found is not None
    assert found.peak_hz == pytest.approx(tone_hz)
    assert found.rms == pytest.approx(3.0 / sqrt(2.0), rel=0.01)
    assert found.seconds == pytest.approx(40.0, abs=2.0 * DT_S)


def test_frequencies_go_from_one_over_a_segment_to_half_the_sampling_rate() -> None:
    found = spectrum_of(series(), "v", ALL)
    assert found is not None
    assert found.frequency_hz[0] == pytest.approx(1.0 / SEGMENT_S)
    assert np.diff(found.frequency_hz) == pytest.approx(
        np.full(len(found.frequency_hz) - 1, 1.0 / SEGMENT_S)
    )
    assert found.frequency_hz[-1] == pytest.approx(0.5 / DT_S)
    assert found.density.shape == found.frequency_hz.shape


def test_white_noise_has_the_same_density_everywhere() -> None:
    """Of variance 4 over 10 Hz: 0.4 each Hz."""
    noise = 2.0 * np.random.default_rng(1).standard_normal(40001)
    time_s = DT_S * np.arange(float(len(noise)))
    found = spectrum_of(Series(time_s, {"v": noise}, "made"), "v", ALL)
    assert found is not None
    assert found.rms == pytest.approx(2.0, rel=0.03)
    for half in np.split(found.density, [40]):
        assert np.mean(half) == pytest.approx(0.4, rel=0.05)


def test_the_peak_is_that_of_power_per_octave() -> None:
    """A slow tone of as much power as a fast one has less of it in each octave."""
    slow, fast = series(80.0, 0.5), series(80.0, 4.0)
    both = Series(slow.time_s, {"v": 1.2 * slow["v"] + fast["v"]}, "made")
    found = spectrum_of(both, "v", ALL)
    assert found is not None
    assert found.peak_hz == pytest.approx(4.0)


def test_stretches_weigh_by_their_length() -> None:
    """Thirty seconds of amplitude 1 and ten of amplitude 3: (30 · 1 + 10 · 9) / 40 / 2."""
    quiet, loud = series(30.0, amplitude=1.0), series(10.0, amplitude=3.0)
    time_s = np.concatenate([quiet.time_s, 100.0 + loud.time_s])
    both = Series(time_s, {"v": np.concatenate([quiet["v"], 50.0 + loud["v"]])}, "made")
    for spans in (ALL, [(0.0, 50.0), (50.0, 200.0)]):
        found = spectrum_of(both, "v", spans)
        assert found is not None
        assert found.rms == pytest.approx(sqrt(120.0 / 40.0 / 2.0), rel=0.02)
        assert found.seconds == pytest.approx(40.0, abs=0.2)


def test_only_what_lies_in_the_spans_counts() -> None:
    quiet, loud = series(20.0, amplitude=1.0), series(20.0, amplitude=3.0)
    both = Series(
        np.concatenate([quiet.time_s, 20.0 + DT_S + loud.time_s]),
        {"v": np.concatenate([quiet["v"], loud["v"]])},
        "made",
    )
    for span, amplitude in (((0.0, 19.0), 1.0), ((21.0, 40.0), 3.0)):
        found = spectrum_of(both, "v", [span])
        assert found is not None
        assert found.rms == pytest.approx(amplitude / sqrt(2.0), rel=0.02)


@pytest.mark.parametrize(("seconds", "counts"), [(7.9, False), (8.1, True)])
def test_a_stretch_shorter_than_a_segment_is_left_out(seconds: float, counts: bool) -> None:
    assert (spectrum_of(series(seconds), "v", ALL) is not None) == counts
    assert (spectrum_of(series(), "v", [(10.0, 10.0 + seconds)]) is not None) == counts


def test_a_gap_of_more_than_five_steps_ends_a_stretch() -> None:
    """Twelve seconds with a gap of six steps are two of six; one of four is bridged."""
    whole = series(12.0)
    for missing, counts in ((3, True), (5, False)):
        kept = (np.arange(len(whole)) < 120) | (np.arange(len(whole)) >= 120 + missing)
        cut = Series(whole.time_s[kept], {"v": whole["v"][kept]}, "made")
        assert (spectrum_of(cut, "v", ALL) is not None) == counts, missing


def test_samples_that_are_not_known_are_no_samples() -> None:
    broken = series(12.0)
    values = broken["v"].copy()
    values[120:140] = np.nan
    assert spectrum_of(Series(broken.time_s, {"v": values}, "made"), "v", ALL) is None
    nothing = Series(broken.time_s, {"v": np.full(len(broken), np.nan)}, "made")
    assert spectrum_of(nothing, "v", ALL) is None


def test_nothing_few_samples_and_a_clock_that_stands_have_no_spectrum() -> None:
    assert spectrum_of(None, "v", ALL) is None
    assert spectrum_of(series(), "v", []) is None
    still = Series(np.zeros(100), {"v": np.arange(100.0)}, "made")
    assert spectrum_of(still, "v", ALL) is None
    sparse = Series(np.arange(20.0), {"v": np.arange(20.0)}, "made")  # eight in a segment
    assert spectrum_of(sparse, "v", ALL) is None
    for samples, counts in ((15, False), (17, True)):  # sixteen in a segment and more
        time_s = 0.5 * np.arange(float(samples))
        few = Series(time_s, {"v": np.sin(time_s)}, "made")
        assert (spectrum_of(few, "v", ALL) is not None) == counts
