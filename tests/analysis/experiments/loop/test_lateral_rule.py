"""How the rule on board for roll and heading is counted beside the linear model."""

from __future__ import annotations

import numpy as np
import pytest

from tgl_soar.analysis.experiments.loop.lateral_rule import (
    COEFFICIENTS,
    LINKS_S,
    RuleFound,
    RuleJob,
    both_answers,
    counted,
    drawn_sideways,
    one_gain_changed,
    rule_claims,
    rule_jobs,
    rule_table,
)
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME = load_airframe(AIRFRAME_PATH)
WELL = RuleFound(0.8, 0.9)


def test_each_kind_of_error_is_counted_alone() -> None:
    assert counted([WELL])[:7] == (1, 0, 0, 0, 0, 0, 0)
    assert counted([RuleFound(0.2, 0.3)])[:7] == (1, 0, 1, 0, 1, 0, 0)
    assert counted([RuleFound(0.3, 0.2)])[:7] == (1, 1, 0, 1, 1, 0, 0)
    assert counted([RuleFound(0.45, 0.55)])[:7] == (1, 0, 0, 0, 0, 1, 0)
    assert counted([RuleFound(0.55, 0.45)])[:7] == (1, 0, 0, 0, 1, 0, 1)
    assert counted([RuleFound(0.0, 0.0)])[:7] == (1, 1, 0, 0, 1, 0, 0)


def test_how_far_they_are_apart_counts_where_either_has_little() -> None:
    assert counted([WELL]).below == counted([WELL]).above == 0.0
    found = counted([RuleFound(0.3, 0.6), RuleFound(0.52, 0.4), RuleFound(0.9, 0.6)])
    assert found.below == pytest.approx(0.3)
    assert found.above == pytest.approx(0.12)


def test_what_is_claimed_is_of_those_it_names() -> None:
    jobs = [RuleJob((1,), 0.005, changed=changed) for changed in (False, True)]
    assert all(claim.holds for claim in rule_claims(jobs, [WELL, WELL]))

    def holds(own: RuleFound, changed: RuleFound) -> list[bool]:
        return [claim.holds for claim in rule_claims(jobs, [own, changed])]

    assert holds(RuleFound(0.45, 0.52), WELL) == [False, True, True]
    assert holds(RuleFound(0.2, 0.26), WELL) == [False, True, True]
    assert holds(WELL, RuleFound(0.45, 0.52)) == [True, True, True]
    assert holds(WELL, RuleFound(0.3, 0.0)) == [True, False, False]
    assert holds(WELL, RuleFound(0.3, 0.45)) == [True, True, False]


def test_own_gains_and_changed_ones_are_drawn_for_each_link() -> None:
    jobs = rule_jobs(5, 2)
    assert len(jobs) == len(set(jobs)) == 2 * 2 * len(LINKS_S)
    rows = rule_table(jobs, [WELL] * len(jobs)).rows
    assert [row[0] for row in rows[:3]] == [
        f"the gains of its file, {late:g} ms" for late in (5, 20, 40)
    ]
    assert all(row[1] == "2" for row in rows)


def test_an_aircraft_is_drawn_in_all_that_moves_it_sideways() -> None:
    drawn = drawn_sideways(AIRFRAME, np.random.default_rng(3))
    factors = [drawn.model[name] / AIRFRAME.model[name] for name in COEFFICIENTS]
    factors += [
        drawn.airframe.ixx_kgm2 / AIRFRAME.airframe.ixx_kgm2,
        drawn.airframe.izz_kgm2 / AIRFRAME.airframe.izz_kgm2,
    ]
    assert len({round(factor, 9) for factor in factors}) == len(factors)
    assert min(factors) >= 0.7
    assert max(factors) <= 1.3
    assert 0.015 <= 1.0 / drawn.model["servo_lag_radps"] <= 0.080


def test_one_gain_is_changed_and_no_other() -> None:
    values = load_parameters(AIRFRAME, AIRFRAME_PATH, load_site(SITE_PATH), SITE_PATH)
    for seed in range(20):
        changed = one_gain_changed(values, np.random.default_rng(seed))
        differ = [p.name for p, value in values if changed[p.name] != value]
        assert len(differ) == 1
        assert 0.1 <= changed[differ[0]] / values[differ[0]] <= 10.0


def test_both_answer_for_the_aircraft_that_is_drawn() -> None:
    """With its own gains it has a margin by both; both know of the changed gain."""
    own, changed = (
        both_answers(RuleJob((1104, 3), 0.04, changed=changed)) for changed in (False, True)
    )
    assert min(own[:2]) > 0.5
    assert changed.rule != own.rule
    assert changed.model != own.model
