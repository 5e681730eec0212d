"""The score of a leg, on paths whose score is known."""

from __future__ import annotations

from math import inf, isnan, pi, radians

import numpy as np
import pytest

from tgl_soar.sim.score import TAIL_S, score_leg

TIME = np.arange(0.0, 20.0, 0.01)
VERTICAL = (0.0, 1.0, 0.5 * pi)


def test_a_decaying_approach_settles_when_it_enters_the_band_for_good() -> None:
    """e = 0.5 exp(-t) is within 5 cm from t = ln 10 on."""
    x = -0.5 * np.exp(-TIME)  # upstream of a vertical line
    score = score_leg("a", VERTICAL, (0.0, 1.0), TIME, x, np.ones_like(TIME))
    assert score.settling_s == pytest.approx(np.log(10.0), abs=0.011)
    assert score.settled
    assert score.peak_e_rho_m == pytest.approx(0.05, abs=0.001)
    assert score.crossing_m == pytest.approx(0.0, abs=1e-4)


def test_leaving_the_band_at_the_end_is_not_settled() -> None:
    x = np.where(TIME > 19.9, 0.06, 0.0)
    score = score_leg("a", VERTICAL, None, TIME, x, np.ones_like(TIME))
    assert score.settling_s == inf
    assert not score.settled
    assert isnan(score.crossing_m)


def test_a_position_that_is_not_a_number_is_not_settled() -> None:
    x = np.where(TIME > 19.9, np.nan, 0.0)
    assert not score_leg("a", VERTICAL, None, TIME, x, np.ones_like(TIME)).settled


def test_e_rho_and_wander_are_scored_apart() -> None:
    """A swing along a leaning line has no e_rho; its spread is amplitude / √2."""
    eta = radians(105.0)
    along = 0.3 * np.sin(2.0 * pi * TIME / 2.0)  # whole periods in the tail
    x, z = along * np.cos(eta), 1.0 + along * np.sin(eta)
    score = score_leg("a", (0.0, 1.0, eta), (0.0, 1.0), TIME, x, z)
    assert score.rms_e_rho_m == pytest.approx(0.0, abs=1e-12)
    assert score.wander_m == pytest.approx(0.3 / np.sqrt(2.0), rel=0.01)
    assert TAIL_S % 2.0 == 0.0
