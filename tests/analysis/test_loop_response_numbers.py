"""Margins between tones, of loops whose margins are known by hand."""

from __future__ import annotations

from math import atan, degrees, isnan, log10, pi

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.stats import f as fisher

from tgl_soar.analysis.loop_response import (
    AT_SETPOINT,
    TONES_RADPS,
    Bounded,
    FlownMargins,
    LoopResponse,
    margins_between_tones,
    open_loop_discs,
    opened,
)

# L = K / (jω (1 + jωT)²): its phase is −180° at ω = 1 / T, where its size is K T / 2.
MIDDLE_RADPS = float(np.sqrt(TONES_RADPS[0] * TONES_RADPS[-1]))
T_S = 1.0 / MIDDLE_RADPS


def sensitivity(margin: float) -> np.ndarray:
    """Of the loop whose gain may grow by so much."""
    jw = 1j * TONES_RADPS
    loop = 2.0 / (T_S * margin) / (jw * (1.0 + jw * T_S) ** 2)
    return np.asarray(1.0 / (1.0 + loop))


@pytest.mark.parametrize("margin", [1.5, 2.0, 3.0])
def test_gain_and_phase_margin_are_those_of_the_loop(margin: float) -> None:
    gain_db, phase_deg, alpha = margins_between_tones(sensitivity(margin))
    assert gain_db == pytest.approx(20.0 * log10(margin), abs=0.3)
    size = 2.0 / margin  # K T
    x = brentq(lambda x: size / (x * (1.0 + x * x)) - 1.0, 1e-3, 10.0)
    assert phase_deg == pytest.approx(degrees(0.5 * pi - 2.0 * atan(x)), abs=1.5)
    w = np.geomspace(TONES_RADPS[0], TONES_RADPS[-1], 4000) * T_S
    loop = size / (1j * w * (1.0 + 1j * w) ** 2)
    assert alpha == pytest.approx(1.0 / np.max(np.abs(1.0 / (1.0 + loop) - 0.5)), rel=0.03)


def test_what_crosses_beyond_the_tones_has_no_margin_between_them() -> None:
    weak = 1.0 / (1.0 + 0.01 / (1.0 + 1j * TONES_RADPS * T_S))  # never 1, never −180°
    gain_db, phase_deg, alpha = margins_between_tones(np.asarray(weak))
    assert isnan(gain_db)
    assert isnan(phase_deg)
    assert isnan(alpha)  # it is the least at the first tone


def test_a_loop_that_is_unstable_already_has_no_gain_margin_left() -> None:
    assert isnan(margins_between_tones(sensitivity(0.8))[0])


@pytest.mark.parametrize("periods", [2, 5])
def test_the_disc_of_s_becomes_the_disc_of_l(periods: int) -> None:
    """All of its edge lies on the edge of the other: points of it, mapped one by one."""
    s = sensitivity(2.0)
    none = Bounded(1.0, 1.0, 1.0)
    response = LoopResponse(
        at=AT_SETPOINT,
        sensitivity=s,
        variance=np.full(len(s), 1e-3),
        coherence=np.ones(len(s)),
        periods=periods,
        margins=FlownMargins(none, none, none),
    )
    radius = np.sqrt(fisher.ppf(0.95, 2, 2 * (periods - 1)) * 1e-3)
    assert response.radius == pytest.approx(radius)
    assert response.open_loop == pytest.approx(1.0 / s - 1.0)
    centres, radii = open_loop_discs(response)
    holds_zero = np.abs(s) <= radius
    assert np.isnan(radii).tolist() == holds_zero.tolist()
    for turn in np.linspace(0.0, 2.0 * pi, 7):
        edge = opened(np.asarray(s + radius * np.exp(1j * turn)))
        away = np.abs(edge - centres)
        assert away[~holds_zero] == pytest.approx(radii[~holds_zero])
