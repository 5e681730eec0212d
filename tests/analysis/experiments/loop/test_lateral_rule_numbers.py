"""The rule for roll and heading beside the linear model: what is drawn, and each count and claim at
its very bound."""

from __future__ import annotations

from math import radians
from typing import Any

import numpy as np
import pytest
from by_hand import signs

from tgl_soar.analysis.experiments.loop import lateral_rule
from tgl_soar.analysis.experiments.loop.lateral_rule import (
    COEFFICIENTS,
    GAINS,
    LINKS_S,
    OF_EACH,
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
from tgl_soar.config.parameters import INDEX, PARAMETERS
from tgl_soar.control.loop_margin import FLOOR, RINGS

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME = load_airframe(AIRFRAME_PATH)


# --- what is drawn ------------------------------------------------------------------------------


def test_links_aircraft_and_gains_are_those_of_the_page() -> None:
    assert LINKS_S == (0.005, 0.020, 0.040)
    assert OF_EACH == 60
    assert set(GAINS) == {"AIL_P", "AIL_I", "AIL_D", "RUD_P", "RUD_D", "SIDE_P", "SIDE_I"}
    # Every coefficient of side force, roll and yaw that the airframe file has.
    sideways = {name for name in AIRFRAME.model if name[:3] in ("CY_", "Cl_", "Cn_")}
    assert set(COEFFICIENTS) == sideways


def test_each_figure_is_drawn_evenly_within_thirty_per_cent_and_by_itself() -> None:
    draw = np.random.default_rng(1)
    drawn = [drawn_sideways(AIRFRAME, draw) for _ in range(300)]
    columns = [[each.model[name] / AIRFRAME.model[name] for each in drawn] for name in COEFFICIENTS]
    bench = AIRFRAME.airframe
    columns.append([each.airframe.ixx_kgm2 / bench.ixx_kgm2 for each in drawn])
    columns.append([each.airframe.izz_kgm2 / bench.izz_kgm2 for each in drawn])
    for factors in columns:
        assert 0.7 <= min(factors) < 0.72
        assert 1.28 < max(factors) <= 1.3
        assert np.std(factors) == pytest.approx(0.6 / 12**0.5, rel=0.1)
    assert np.max(np.abs(np.corrcoef(columns) - np.eye(len(columns)))) < 0.25
    servo_s = [1.0 / each.model["servo_lag_radps"] for each in drawn]
    assert 0.015 <= min(servo_s) < 0.017
    assert 0.078 < max(servo_s) <= 0.080
    # Nothing else is another's.
    changed = {*COEFFICIENTS, "servo_lag_radps"}
    assert {k: v for k, v in drawn[0].model.items() if k not in changed} == {
        k: v for k, v in AIRFRAME.model.items() if k not in changed
    }
    assert drawn[0].airframe.iyy_kgm2 == bench.iyy_kgm2


def test_any_of_the_gains_is_changed_by_up_to_ten_either_way() -> None:
    values = load_parameters(AIRFRAME, AIRFRAME_PATH, load_site(SITE_PATH), SITE_PATH)
    draw = np.random.default_rng(2)
    factors: dict[str, list[float]] = {}
    for _ in range(700):
        changed = one_gain_changed(values, draw)
        for name in GAINS:
            if changed[name] != values[name]:
                factors.setdefault(name, []).append(changed[name] / values[name])
    assert set(factors) == set(GAINS)
    for name, several in factors.items():
        most = PARAMETERS[INDEX[name]].maximum / values[name]
        assert min(several) < 0.13
        assert min(several) >= 0.0999
        assert max(several) == pytest.approx(min(10.0, most), rel=0.25)
        assert max(several) <= min(10.0, most) * 1.0001
        # As many are lowered as raised: the logarithm is even.
        assert 0.3 < np.mean(np.array(several) < 1.0) < 0.7


def test_both_are_asked_of_the_same_aircraft_by_each_sensor_and_speed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    conditions: list[Any] = []
    stated: list[float] = []

    class Loops:
        """What the rule finds of two loops."""

        def __init__(self, alpha: float) -> None:
            self.alpha = alpha

    def lateral_margins(values: Any, _: Any) -> list[Loops]:
        stated.append(values["CMD_DELAY"])
        return [Loops(0.7), Loops(0.6)]

    def lateral_loop(_: Any, condition: Any) -> Any:
        conditions.append(condition)
        return condition

    def disk_margin(condition: Any) -> Any:
        return condition.speed_mps / 10.0 + (0.5 if condition.sensors.imu else 0.0)

    monkeypatch.setattr(lateral_rule, "lateral_margins", lateral_margins)
    monkeypatch.setattr(lateral_rule, "lateral_loop", lateral_loop)
    monkeypatch.setattr(lateral_rule, "disk_margin", disk_margin)
    found = both_answers(RuleJob((4, 2, 1), 0.020, changed=False))
    assert stated == [pytest.approx(0.020)]
    assert found.rule == 0.6
    assert len(conditions) == 6
    speeds = sorted({each.speed_mps for each in conditions})
    assert np.array(speeds) / speeds[1] == pytest.approx([0.92, 1.0, 1.15])
    assert found.model == pytest.approx(speeds[0] / 10.0)
    assert {each.sensors.imu is None for each in conditions} == {True, False}
    assert {each.command_delay_s for each in conditions} == {0.020}
    (lean_rad,) = {each.lean_rad for each in conditions}
    assert radians(5.0) <= lean_rad <= radians(45.0)


def test_aircraft_are_drawn_by_seeds_of_their_own() -> None:
    jobs = rule_jobs(2027, 3)
    assert [(job.seed, job.link_s, job.changed) for job in jobs] == [
        ((2027, 2, number), link_s, changed)
        for changed in (False, True)
        for link_s in LINKS_S
        for number in range(3)
    ]


# --- what is counted ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("rule", "model", "counts"),
    [
        # aircraft, bad, refused and accepted wrongly, little, warned and unwarned wrongly
        (RINGS, RINGS, (1, 0, 0, 0, 1, 0, 0)),
        (FLOOR, FLOOR, (1, 0, 0, 0, 0, 0, 0)),
        (0.2, RINGS, (1, 0, 1, 0, 1, 0, 0)),
        (RINGS, 0.2, (1, 1, 0, 1, 1, 0, 0)),
        (0.4, FLOOR, (1, 0, 0, 0, 0, 1, 0)),
        (FLOOR, 0.4, (1, 0, 0, 0, 1, 0, 1)),
        (0.1, 0.9, (1, 0, 1, 0, 0, 1, 0)),
        (0.9, 0.1, (1, 1, 0, 1, 1, 0, 1)),
    ],
)
def test_a_bound_belongs_to_those_who_have_a_margin(
    rule: float, model: float, counts: tuple[int, ...]
) -> None:
    assert (RINGS, FLOOR) == (0.25, 0.5)
    assert counted([RuleFound(rule, model)])[:7] == counts
    both = counted([RuleFound(rule, model), RuleFound(0.9, 0.9), RuleFound(rule, model)])
    assert both[:7] == (3, *(2 * n for n in counts[1:]))


def test_differences_count_from_the_floor_down() -> None:
    assert counted([RuleFound(0.5, 0.9)]).below == 0.0
    assert counted([RuleFound(0.49, 0.9)]).below == pytest.approx(0.41)
    assert counted([RuleFound(0.9, 0.49)]).above == pytest.approx(0.41)
    agree = counted([RuleFound(0.3, 0.3)])
    assert (agree.below, agree.above) == (0.0, 0.0)
    nothing = counted([])
    assert (nothing.aircraft, nothing.below, nothing.above) == (0, 0.0, 0.0)


JOBS = [RuleJob((1,), 0.005, changed=changed) for changed in (False, True)]
WELL = RuleFound(0.8, 0.8)


@pytest.mark.parametrize(
    ("own", "changed", "held"),
    [
        (WELL, WELL, "✓✓✓"),
        (WELL, RuleFound(0.0, 0.1), "✓✓✓"),  # a tenth apart
        (WELL, RuleFound(0.0, 0.11), "✓✓✗"),
        (WELL, RuleFound(0.11, 0.0), "✓✓✗"),
        (WELL, RuleFound(RINGS, 0.0), "✓✗✗"),  # unstable, and accepted
        (WELL, RuleFound(0.24, 0.0), "✓✓✗"),
        (WELL, RuleFound(RINGS, 0.2), "✓✓✓"),  # not unstable
        (RuleFound(0.45, FLOOR), WELL, "✗✓✓"),
        (RuleFound(0.24, RINGS), WELL, "✗✓✓"),
        (RuleFound(0.45, 0.49), WELL, "✓✓✓"),
        (RuleFound(0.2, FLOOR), WELL, "✗✓✗"),  # refused and warned of
    ],
)
def test_each_claim_is_of_its_own_aircraft(own: RuleFound, changed: RuleFound, held: str) -> None:
    assert signs(rule_claims(JOBS, [own, changed])) == held


def test_claims_tell_how_many_of_how_many() -> None:
    jobs = [*JOBS, *JOBS]
    found = [RuleFound(0.2, 0.3), RuleFound(0.3, 0.0), WELL, RuleFound(0.2, 0.26)]
    first, second, third = rule_claims(jobs, found)
    assert first.measured == "refused 1, warned of 0 of 2"
    assert second.measured == (
        "1 of 2 have less than 0.25, 1 of them are unstable; accepted wrongly 1, refused wrongly 1"
    )
    assert third.measured == "the rule is below the linear model by 0.10 at most, above by 0.30"


def test_the_table_has_a_row_for_each_link_and_kind() -> None:
    jobs = rule_jobs(1, 2)
    found = [RuleFound(0.2, 0.3) if job.link_s == 0.020 and job.changed else WELL for job in jobs]
    rows = {row[0]: row[1:] for row in rule_table(jobs, found).rows}
    assert list(rows) == [
        *(f"the gains of its file, {ms} ms" for ms in (5, 20, 40)),
        *(f"one gain changed, {ms} ms" for ms in (5, 20, 40)),
    ]
    assert rows["one gain changed, 20 ms"] == ("2", "0", "2", "0", "2", "0", "0")
    assert rows["the gains of its file, 20 ms"] == ("2", "0", "0", "0", "0", "0", "0")
    assert len(rule_table(jobs, found).columns) == 8
