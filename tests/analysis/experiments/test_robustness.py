"""Who lasts on late links and on other aircraft: what is drawn, and how it is judged."""

from __future__ import annotations

from math import nan, sqrt
from random import Random

import pytest
from msgspec.structs import asdict

from tgl_soar.analysis.experiments.flights import FlownScenario, flown_airframe
from tgl_soar.analysis.experiments.robustness import (
    DAMPING,
    REFERENCE_MPS,
    SERVO_S,
    SHORT_PERIOD_RADPS,
    WITHIN,
    PlaceScore,
    drawn_figures,
    hovers_at,
    score_place,
    survival_claim,
)
from tgl_soar.analysis.experiments.scenario import PreparedScenario, load_scenario, prepare
from tgl_soar.config.dynamics import MeasuredDynamics, dynamics_parameters
from tgl_soar.config.files import shipped


@pytest.fixture(scope="module")
def prepared() -> PreparedScenario:
    return prepare(load_scenario(shipped("scenarios/dispersed.toml")))


def test_aircraft_are_drawn_as_far_from_the_file_as_is_said(prepared: PreparedScenario) -> None:
    """Their short period as the gains' schedule works it out, which has the textbook's formulas."""
    random = Random(1)
    periods, servos, drags = [], [], []
    for _ in range(200):
        other = flown_airframe(prepared.airframe, drawn_figures(prepared.airframe, random))
        found = dynamics_parameters(
            MeasuredDynamics(speed_mps=REFERENCE_MPS),
            asdict(other.airframe),
            other.model,
            other.polar.as_polar(),
            "bridge",
        )
        assert found["DYN_DAMP"] == pytest.approx(DAMPING, rel=1e-6)
        assert other.model["Cm_q"] < 0.0
        assert other.model["Cm_alpha"] < 0.0
        filed = prepared.airframe.model
        trimmed = other.model["Cm0"] / other.model["Cm_alpha"]
        assert trimmed == pytest.approx(filed["Cm0"] / filed["Cm_alpha"])
        periods.append(found["DYN_FREQ"])
        servos.append(1.0 / other.model["servo_lag_radps"])
        drags.append(other.model["CD0"] / prepared.airframe.model["CD0"] - 1.0)
    for drawn, (least, most) in (
        (periods, SHORT_PERIOD_RADPS),
        (servos, SERVO_S),
        (drags, (-WITHIN, WITHIN)),
    ):
        assert least <= min(drawn) < least + 0.05 * (most - least)
        assert most - 0.05 * (most - least) < max(drawn) <= most
        mean, spread = (least + most) / 2.0, (most - least) / sqrt(12.0 * len(drawn))
        assert abs(sum(drawn) / len(drawn) - mean) < 4.0 * spread


def test_who_cannot_hover_on_a_line_is_not_flown(prepared: PreparedScenario) -> None:
    model = prepared.airframe.model
    at, filed = hovers_at(prepared, (), "a"), prepared.lines["a"].crossing
    assert filed is not None
    assert at == pytest.approx((filed.x_m, filed.z_m), abs=0.02)
    stalled = ("model.CL_alpha", 0.7 * model["CL_alpha"])
    sinks_too_fast = ("model.CD0", 3.0 * model["CD0"])
    assert hovers_at(prepared, (stalled,), "a") is None
    assert hovers_at(prepared, (sinks_too_fast,), "a") is None


def test_places_are_judged_one_by_one() -> None:
    """A pooled share of 0.95 would pass."""
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
        [FlownScenario(1, "", 20.0, (), {}), FlownScenario(2, "hit the board", 3.0, (), {})], "a"
    )
    assert (found.flights, found.survived) == (2, 1)
    assert found.rms_e_rho_m == pytest.approx(nan, nan_ok=True)
