"""Faster and slower air: what is claimed of it, of made-up scores."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from by_hand import signs
from test_still_lines import flight

from tgl_soar.analysis.experiments.paper.air_speed import (
    SpeedScore,
    growth,
    rings,
    score_speed,
    speed_claims,
    speed_why,
)


def speed_score(wind_mps: float, rms_m: float, survived: int = 8) -> SpeedScore:
    return SpeedScore(
        line="a",
        wind_mps=wind_mps,
        flights=8,
        survived=survived,
        rms_e_rho_m=rms_m if survived == 8 else inf,
        oscillation_m=rms_m if survived == 8 else inf,
        error=0.05,
        rms_y_m=0.1,
        rms_bank_rad=0.02,
        rms_pitch_rate_radps=0.1,
    )


def test_speed_asks_both_with_margin_and_without() -> None:
    falls, grows, same = (
        [speed_score(8.3, a), speed_score(9.3, b)]
        for a, b in ((0.02, 0.01), (0.02, 0.03), (0.02, 0.022))
    )
    quiet = [score._replace(oscillation_m=0.003) for score in falls]
    biased = [score._replace(rms_e_rho_m=0.02) for score in quiet]  # beside the line, and steady

    def reported(fixed: list[SpeedScore], calm: dict[float, list[SpeedScore]] | None = None) -> str:
        return signs(speed_claims({"without": fixed}, calm or {1.0: quiet}))

    assert reported(falls, {1.0: quiet, 2.5: grows}) == "✗✓"
    assert reported(falls, {1.0: biased, 2.5: grows}) == "✗✓"
    assert reported(grows) == "✓✗"
    assert reported(same) == "?✗"  # within 2.4 standard errors
    assert reported(grows, {2.5: grows, 4.0: falls}) == "✓✗"  # of all gains that ring
    words = speed_claims({}, {2.5: grows, 4.0: falls})[0].measured
    assert "at × 2.5, where it grows" in words
    assert "at × 4, where it falls" in words


def test_a_lost_flight_counts_at_its_place() -> None:
    lost = speed_score(7.6, 0.02, survived=7)
    held = speed_score(9.3, 0.03)
    assert not growth([lost, held]).shown  # the slowest is the worst, and is not left out
    assert growth([held, lost]).shown
    assert not growth([lost, lost]).shown
    assert rings([lost])
    middle = [held, lost, held]
    assert "1 at 7.60 m/s with × 3" in speed_why({"with": middle}, {"with": middle}, {3.0: middle})


def test_scores_of_a_place_are_of_all_its_flights() -> None:
    path = {"time_s": np.arange(0.0, 20.0, 0.02), "pitch_rad": np.zeros(1000)}
    lasted = replace(flight(1), path=path)
    assert score_speed([lasted, lasted], "a", 8.0).rms_e_rho_m == pytest.approx(0.005)
    assert score_speed([lasted], "a", 8.0).oscillation_m == pytest.approx(24e-6**0.5)
    assert score_speed([lasted, replace(lasted, ended="hit")], "a", 8.0).rms_e_rho_m == inf
