"""The family of polars S(u, b): what glides at several positions of a brake give."""

from __future__ import annotations

from random import Random

import pytest

from tgl_soar.estimation.polar import PolarFamilyFit, fit_polar, fit_polar_family

SPEEDS = (7.2, 7.6, 8.1, 8.7, 9.4, 10.1, 11.0, 12.0)
BRAKES = (0.0, 0.5, 1.0)
K = 0.34 / 9.0**3  # all of the brake adds 0.34 m/s at 9 m/s


def sink(u: float, b: float) -> float:
    return 1.3 + 0.12 * (u - 8.6) ** 2 - 0.006 * (u - 8.6) ** 3 + K * b * u**3


def family(noise_mps: float = 0.0, seed: int = 1) -> PolarFamilyFit:
    draw = Random(seed)
    glides = [(u, b) for b in BRAKES for u in SPEEDS]
    sinks = [sink(u, b) + draw.gauss(0.0, noise_mps) for u, b in glides]
    return fit_polar_family([u for u, _ in glides], sinks, [b for _, b in glides])


def test_the_cubic_and_the_brake_are_recovered_from_one_table() -> None:
    found = family()
    clean = fit_polar(SPEEDS, [sink(u, 0.0) for u in SPEEDS])
    assert list(found.fit.polar) == pytest.approx(list(clean.polar), rel=1e-8)
    assert found.brake_sink == pytest.approx(K, rel=1e-9)


def test_noise_is_as_large_in_the_result_as_it_is_said_to_be() -> None:
    errors = [(f.brake_sink - K) / f.brake_sink_error for f in map(family, [0.02] * 60, range(60))]
    rms = (sum(e * e for e in errors) / len(errors)) ** 0.5
    assert 0.7 < rms < 1.4  # of 60 draws: 1 ± 0.09 by three times, and 19 degrees of freedom


@pytest.mark.parametrize(
    ("brakes", "words"),
    [
        ((0.0, 0.1, 0.2), "stays within 0.00 and 0.20"),
        ((0.0, 0.5, 1.2), "brake 1.2: must be from 0 to 1"),
        ((1.0, 0.5, 0.0), "sinks less"),
    ],
)
def test_what_is_no_family_is_refused(brakes: tuple[float, ...], words: str) -> None:
    glides = [(u, b, sink(u, true)) for b, true in zip(brakes, BRAKES, strict=True) for u in SPEEDS]
    with pytest.raises(ValueError, match=words):
        fit_polar_family(*([g[i] for g in glides] for i in (0, 2, 1)))
    with pytest.raises(ValueError, match="one each"):
        fit_polar_family(SPEEDS, [sink(u, 0.0) for u in SPEEDS], [0.0])


def test_glides_at_one_speed_are_refused_for_want_of_others() -> None:
    with pytest.raises(ValueError, match=r"polar: 1 distinct speeds .* from 6 glides; a cubic"):
        fit_polar_family([9.0] * 6, [1.0, 1.1, 1.2, 1.3, 1.4, 1.5], [0.0, 0.2, 0.4, 0.6, 0.8, 1.0])
