"""The errors of the angle of attack, by the true one."""

from __future__ import annotations

import numpy as np
import pytest

from tgl_soar.analysis.experiments.estimates.incidence import (
    ATTACHED_DEG,
    DEEP_DEG,
    FEWEST,
    WINGS,
    _claims,
    angles,
    bands,
)
from tgl_soar.analysis.experiments.flights import FlownScenario
from tgl_soar.analysis.experiments.scenario import load_scenario, prepare
from tgl_soar.config.files import shipped

LIMIT_DEG = 12.6


def test_errors_are_reported_for_each_range_of_the_true_angle() -> None:
    """A long glide at 6 degrees, a short stall at 17 that is read as 10, or in a quarter not."""
    true = np.array([6.0] * 3 * FEWEST + [17.0] * FEWEST)
    read = np.concatenate([np.full(3 * FEWEST, 6.5), np.full(FEWEST, 10.0)])
    read[-FEWEST::4] = np.nan
    low, deep = bands(true, read, LIMIT_DEG)
    assert (low.low_deg, low.high_deg, low.fraction) == (4.0, 8.0, 0.75)
    assert (low.mean_deg, low.deviation_deg, low.beyond) == pytest.approx((0.5, 0.0, 0.0))
    assert (deep.low_deg, deep.high_deg, deep.fraction) == (16.0, 18.0, 0.25)
    assert deep.mean_deg == pytest.approx(-7.0)
    assert deep.unknown == pytest.approx(0.26, abs=0.01)


def test_what_is_hardly_ever_flown_is_not_reported() -> None:
    true = np.array([6.0] * FEWEST + [17.0] * (FEWEST - 1))
    assert [band.low_deg for band in bands(true, true, LIMIT_DEG)] == [4.0]


def claims_of(true: list[float], read: list[float]) -> list[bool]:
    return [c.holds for c in _claims({"a wing": (np.array(true), np.array(read))}, LIMIT_DEG)]


def test_a_stall_has_to_be_seen_and_none_invented() -> None:
    deep, attached = sum(DEEP_DEG) / 2.0, ATTACHED_DEG - 1.0
    assert claims_of([deep] * 10 + [attached] * 200, [14.0] * 8 + [9.0] * 202) == [True, True]
    assert claims_of([deep] * 10 + [attached] * 200, [14.0] * 7 + [9.0] * 203) == [False, True]
    invented = [14.0] * 13 + [9.0] * 197
    assert claims_of([deep] * 10 + [attached] * 200, invented) == [True, False]
    unknown = [float("nan")] * 210
    assert claims_of([deep] * 10 + [attached] * 200, unknown) == [False, True]


def test_what_is_flown_before_the_air_is_known_does_not_count() -> None:
    path = {
        "time_s": np.array([0.5, 1.9, 2.1]),
        "alpha_rad": np.radians([1.0, 2.0, 3.0]),
        "air_alpha_rad": np.radians([4.0, 5.0, 6.0]),
    }
    true, read = angles(
        [FlownScenario(seed=1, ended="hit the board", duration_s=2.1, legs=(), path=path)]
    )
    assert (true.tolist(), read.tolist()) == (pytest.approx([3.0]), pytest.approx([6.0]))


def test_the_wings_and_the_limit_are_those_of_the_file() -> None:
    prepared = prepare(load_scenario(shipped("scenarios/incidence.toml")))
    assert prepared.values["ALPHA_MAX"] == pytest.approx(LIMIT_DEG, abs=0.05)
    assert DEEP_DEG[0] > prepared.values["ALPHA_MAX"] > ATTACHED_DEG
    for factors in WINGS.values():
        assert set(factors) <= set(prepared.airframe.model)
