"""Scores of made-up episodes, and exact intervals against published ones."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

from tgl_soar.analysis.search.episode import Episode
from tgl_soar.analysis.search.places import place
from tgl_soar.analysis.search.scoring import Score, fraction_text, interval, score, settling_s

HILL = place("hill", 3)


def episode(
    height_m: float = 20.0,
    climb_mps: float = 0.0,
    *,
    flown_s: float = HILL.duration_s,
    ended: str = "",
    given_up: str = "",
    claims: list[tuple[float, bool]] | None = None,
    height_left_m: float = 5.0,
) -> Episode:
    time = np.arange(0.0, flown_s, 0.1)
    path = {"time_s": time, "x_m": np.full_like(time, -5.0), "z_m": height_m + climb_mps * time}
    return Episode(
        place=HILL,
        searcher="somebody",
        ended=ended,
        given_up=given_up,
        flown_s=flown_s,
        path=path,
        claims=claims or [],
        height_left_m=height_left_m,
        landing_m=1.5,
    )


def scored(**given: object) -> Score:
    return score(episode(**given))  # type: ignore[arg-type]


def test_soared_is_flown_to_the_end_without_sinking() -> None:
    assert scored().soared
    assert not scored(climb_mps=-0.1).soared
    assert not scored(flown_s=40.0, ended="hit the ground").soared
    assert not scored(flown_s=40.0, given_up="too low").soared


def test_a_claim_is_false_where_it_stood_until_the_loss() -> None:
    lost = {"flown_s": 30.0, "ended": "hit the ground"}
    assert scored(**lost, claims=[(10.0, True)]).false_claim
    assert scored(**lost, claims=[(10.0, True), (28.5, False)]).false_claim
    assert not scored(**lost, claims=[(10.0, True), (20.0, False)]).false_claim
    assert not scored(**lost).false_claim
    assert not scored(claims=[(10.0, True)]).false_claim
    assert scored(climb_mps=-0.1, claims=[(10.0, True)]).false_claim
    # withdrawn, made again, and false then
    again = [(5.0, True), (9.0, False), (12.0, True)]
    assert scored(**lost, claims=again).false_claim


def test_in_time_is_above_the_height_for_landing() -> None:
    gave = {"flown_s": 20.0, "given_up": "too low"}
    assert scored(**gave, height_left_m=1.6).in_time
    assert not scored(**gave, height_left_m=1.4).in_time
    assert not scored(flown_s=20.0, ended="hit the ground", height_left_m=3.0).in_time


def test_settling_is_from_when_it_stays_at_a_height() -> None:
    time = np.arange(0.0, 40.0, 0.1)
    z = 10.0 - 4.0 * np.minimum(time, 10.0) / 10.0
    assert settling_s(time, z) == pytest.approx(10.0, abs=2.1)
    assert settling_s(time, 10.0 - 0.4 * time) == inf
    assert settling_s(time, np.full_like(time, 9.0)) == 0.0


def test_intervals_are_clopper_and_pearson_s() -> None:
    """0 of n: 1 − (α/2)^(1/n); 1 of 10: 0.25–44.5 % (Clopper and Pearson 1934)."""
    assert interval(0, 20) == pytest.approx((0.0, 1.0 - 0.025 ** (1.0 / 20.0)))
    assert interval(20, 20) == pytest.approx((0.025 ** (1.0 / 20.0), 1.0))
    assert interval(1, 10) == pytest.approx((0.0025286, 0.4450161), abs=1e-6)
    assert fraction_text(1, 10) == "1 of 10 (0–45 %)"
    assert fraction_text(0, 0) == "–"
