"""How a slower link is judged: each lean and each place alone."""

from __future__ import annotations

from math import inf

import pytest

from tgl_soar.analysis.experiments.loop.latency import (
    LATENCIES_S,
    LatencyCase,
    LatencyScore,
    _jobs,
    _variants,
    latency_claims,
)
from tgl_soar.analysis.experiments.scenario import load_scenario
from tgl_soar.config.files import shipped

EARLY_S, LATE_S = LATENCIES_S


def up(survived: int = 8, rms_m: float = 0.01) -> LatencyScore:
    return LatencyScore(
        flights=8,
        survived=survived,
        rms_e_rho_m=rms_m if survived == 8 else inf,
        rms_y_m=0.1,
        rms_bank_rad=0.05,
    )


def scores(late: LatencyScore, lean: str = "45") -> dict[LatencyCase, LatencyScore]:
    """One lean and one place, everything well but for this lean by the slower link."""
    return {
        LatencyCase("lean", lean, "with", EARLY_S): up(),
        LatencyCase("lean", lean, "with", LATE_S): late,
        LatencyCase("lean", "15", "with", EARLY_S): up(),
        LatencyCase("lean", "15", "with", LATE_S): up(),
        LatencyCase("speed", "a", "with", EARLY_S): up(),
        LatencyCase("speed", "a", "with", LATE_S): up(),
    }


def test_a_flight_that_only_the_slower_link_loses_is_reported() -> None:
    lasts, dearer, *speed = latency_claims(scores(up(7)))
    assert not lasts.holds
    assert lasts.measured == "45: 7 and 8 of 8"
    assert dearer.holds  # of the other lean
    assert all(claim.holds for claim in speed)
    assert all(claim.holds for claim in latency_claims(scores(up())))


def test_twice_e_rho_is_the_price_and_more_is_too_much() -> None:
    for rms_m, holds in ((0.0199, True), (0.0201, False)):
        lasts, dearer, *_ = latency_claims(scores(up(rms_m=rms_m)))
        assert lasts.holds
        assert dearer.holds == holds
        assert dearer.measured.endswith("times at most, at 45")


def test_a_lean_that_is_not_accepted_decides_nothing() -> None:
    for lean in ("60", "-10"):
        assert all(claim.holds for claim in latency_claims(scores(up(0), lean)))


@pytest.mark.parametrize("of", ["lean", "speed"])
def test_the_module_knows_how_late_its_commands_are(of: str) -> None:
    scenarios = {
        name: load_scenario(shipped(f"scenarios/{name}.toml")) for name in ("lean", "speed")
    }
    (key, scenario) = next(item for item in _variants(scenarios, True).items() if item[0][0] == of)
    early, late = (_jobs(scenario, LatencyCase(*key, "with", each)) for each in LATENCIES_S)
    assert early[0].aircraft == ()
    ((name, delay_s),) = late[0].aircraft
    assert name == "model.servo_delay_s"
    assert delay_s == pytest.approx(LATE_S - EARLY_S, abs=1e-6)
    assert late[0].scenario.parameters["CMD_DELAY"] == LATE_S
    assert early[0].scenario.parameters["CMD_DELAY"] == EARLY_S
    assert late[0].scenario.parameters.get("RHO_SPEED", 8.5) == 8.5
    assert len(late) == len(early) == 8
