"""How flights on late links are judged."""

from __future__ import annotations

from math import nan

import pytest

from tgl_soar.analysis.experiments.flights import FlownScenario
from tgl_soar.analysis.experiments.loop.command_delay import PlaceScore, score_place, survival_claim


def test_places_are_judged_one_by_one() -> None:
    """A pooled fraction of 0.95 would pass."""
    good, poor = (
        PlaceScore(
            place=place,
            flights=20,
            survived=survived,
            rms_e_rho_m=0.01,
            rms_y_m=0.1,
            rms_bank_rad=0.02,
        )
        for place, survived in (("a", 20), ("b", 18))
    )
    assert survival_claim("they last", [good, poor], 0.9).holds
    assert not survival_claim("they last", [good, poor], 0.95).holds
    assert not survival_claim("they last", [], 0.9).holds


def test_a_lost_flight_counts_at_its_place() -> None:
    found = score_place(
        [
            FlownScenario(seed=1, ended="", duration_s=20.0, legs=(), path={}),
            FlownScenario(seed=2, ended="hit the board", duration_s=3.0, legs=(), path={}),
        ],
        "a",
    )
    assert (found.flights, found.survived) == (2, 1)
    assert found.rms_e_rho_m == pytest.approx(nan, nan_ok=True)
