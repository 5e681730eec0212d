"""The score of a leg, on paths whose score is known."""

from __future__ import annotations

from math import inf, isnan, pi, radians, sqrt

import numpy as np
import pytest
from scipy.signal import lfilter

from tgl_soar.sim.score import SETTLE_S, TAIL_S, score_leg

TIME = np.arange(0.0, 20.0, 0.01)
VERTICAL = (0.0, 1.0, 0.5 * pi)


def test_a_decaying_approach_settles_when_it_enters_the_band_for_good() -> None:
    """e = 0.5 exp(-t) is within 5 cm from t = ln 10 on."""
    x = -0.5 * np.exp(-TIME)  # upstream of a vertical line
    score = score_leg("a", VERTICAL, (0.0, 1.0), TIME, x, np.ones_like(TIME))
    assert score.settling_s == pytest.approx(np.log(10.0), abs=0.011)
    assert score.settled
    # The capture is not scored: 3 s after the stop 0.5 exp(-3) is left.
    assert score.peak_e_rho_m == pytest.approx(0.5 * np.exp(-3.0), rel=0.01)
    assert score.crossing_m == pytest.approx(0.0, abs=1e-4)


def test_a_peak_later_on_is_a_peak_and_not_settling() -> None:
    x = np.where((TIME > 10.0) & (TIME < 10.2), 0.08, 0.0)
    score = score_leg("a", VERTICAL, None, TIME, x, np.ones_like(TIME))
    assert score.settling_s == 0.0
    assert score.settled
    assert score.peak_e_rho_m == pytest.approx(0.08)
    assert isnan(score.crossing_m)


def test_a_swing_that_never_rests_in_the_band_is_not_settled() -> None:
    """Through the line and out of the band again every second."""
    x = 0.12 * np.sin(2.0 * pi * TIME / 2.0)
    score = score_leg("a", VERTICAL, None, TIME, x, np.ones_like(TIME))
    assert score.settling_s == inf
    assert not score.settled


def test_a_leg_that_loses_the_line_after_two_good_seconds_is_not_settled() -> None:
    x = np.where(TIME > 4.0, 0.2, 0.0)
    score = score_leg("a", VERTICAL, None, TIME, x, np.ones_like(TIME))
    assert score.settling_s == 0.0
    assert not score.settled


def test_a_position_that_is_not_a_number_is_not_settled() -> None:
    x = np.where(TIME > 19.9, np.nan, 0.0)
    assert not score_leg("a", VERTICAL, None, TIME, x, np.ones_like(TIME)).settled


def test_e_rho_and_dispersion_are_scored_apart() -> None:
    """A swing along a leaning line has no e_rho; its spread is amplitude / √2."""
    eta = radians(105.0)
    along = 0.3 * np.sin(2.0 * pi * TIME / 2.0)  # whole periods in the tail
    x, z = along * np.cos(eta), 1.0 + along * np.sin(eta)
    score = score_leg("a", (0.0, 1.0, eta), (0.0, 1.0), TIME, x, z)
    assert score.rms_e_rho_m == pytest.approx(0.0, abs=1e-12)
    assert score.dispersion_m == pytest.approx(0.3 / np.sqrt(2.0), rel=0.01)
    assert TAIL_S % 2.0 == 0.0


def test_where_a_leg_ended_up_is_known_to_less_than_the_place_is_judged_by() -> None:
    """At 1 % of turbulence the aircraft disperses by 3 cm along its line, decorrelating at the rate
    of its slide, 0.8 1/s; places are judged to 3 cm, so the mean of a tail must be known to 2."""
    random = np.random.default_rng(3)
    sigma, rate, step = 0.03, 0.8, 0.05
    time = np.arange(0.0, 20.0, step)
    keep = np.exp(-rate * step)
    errors = []
    for _ in range(400):
        noise = random.standard_normal(len(time)) * sigma * sqrt(1.0 - keep**2)
        along = lfilter([1.0], [1.0, -keep], noise, zi=[keep * sigma * random.standard_normal()])[0]
        score = score_leg("a", VERTICAL, (0.0, 1.0), time, np.zeros_like(time), 1.0 + along)
        errors.append(score.mean_z_m - 1.0)
    assert np.std(errors) < 0.02
    # And the slide from where the leg began, five time constants of it, is no part of the tail.
    slide = 1.0 + 0.5 * np.exp(-rate * time)
    begun = score_leg("a", VERTICAL, (0.0, 1.0), time, np.zeros_like(time), slide)
    assert begun.crossing_m < 0.001


def test_sideways_is_scored_when_e_rho_is_and_only_where_it_is_known() -> None:
    x, one = np.zeros_like(TIME), np.ones_like(TIME)
    y = np.where(TIME[0] + SETTLE_S <= TIME, 0.25, 9.0)
    score = score_leg("a", VERTICAL, None, TIME, x, one, y, -0.5 * one)
    assert score.rms_y_m == 0.25
    assert score.rms_bank_rad == 0.5
    assert np.isnan(score_leg("a", VERTICAL, None, TIME, x, one).rms_y_m)
