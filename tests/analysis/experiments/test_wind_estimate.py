"""What is read of the air, held against the air that was there; the experiment in small."""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path

import pytest

from tgl_soar.analysis.experiments.catalogue import run
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.result import as_json
from tgl_soar.analysis.experiments.wind_estimate import (
    CASES,
    WITH_PITOT,
    WITHOUT,
    ObservedFlight,
    WindFlight,
    look_on,
    plain_rms,
    score,
    wrong_wing,
)
from tgl_soar.estimation.wind import DRAG_ERROR, LIFT_ERROR
from tgl_soar.types import NO_AERODYNAMICS


@lru_cache(maxsize=1)
def flights() -> tuple[ObservedFlight, ...]:
    """The slowest place, near the stall, and the fastest; the pitch wrong up and down."""
    return tuple(look_on(WindFlight((p,), s, 9.0, tuple(CASES))) for p in "ac" for s in (1, 2))


def test_the_updraft_is_known_as_well_as_it_is_said_to_be() -> None:
    seen = list(flights())
    plain = plain_rms(seen)
    assert score(seen, WITH_PITOT).updraft_mps <= 0.15
    assert score(seen, WITHOUT).updraft_mps <= 0.7 * plain


@pytest.mark.parametrize("case", CASES)
def test_the_standard_deviations_are_honest(case: str) -> None:
    """Four flights are four draws of what is constant in a flight: a factor of four.

    Downward more where the wing is the one they know: they doubt it all the same.
    """
    found = score(list(flights()), case)
    assert 0.1 < found.wind_normalised < 4.0
    assert 0.1 < found.updraft_normalised < 4.0


def test_airspeed_and_angle_of_attack_can_be_protected_by_without_a_pitot() -> None:
    found = score(list(flights()), WITHOUT)
    assert found.airspeed_mps < 0.5
    assert found.alpha_deg < 1.0


def test_the_wrong_wing_is_as_wrong_as_the_estimator_takes_it_to_be() -> None:
    wing = NO_AERODYNAMICS._replace(CL0=1.0, CL_alpha=1.0, CD0=1.0, CD_lift=1.0)
    wings = [wrong_wing(wing, seed) for seed in range(200)]
    lift = sum((w.CL_alpha - 1.0) ** 2 for w in wings) / 200
    drag = sum((w.CD0 - 1.0) ** 2 for w in wings) / 200
    assert lift**0.5 == pytest.approx(LIFT_ERROR, rel=0.2)
    assert drag**0.5 == pytest.approx(DRAG_ERROR, rel=0.2)


@pytest.mark.long
@pytest.mark.ci
def test_the_experiment_tells_and_draws(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tgl_soar.analysis.experiments.wind_estimate.FLIGHT_S", 7.0)
    monkeypatch.setattr("tgl_soar.analysis.experiments.wind_estimate.TOUR_S", 4.0)
    told = run("wind_estimate", Context(Flyer(), tmp_path, quick=True))
    assert all(len(row) == len(t.columns) for t in told.tables for row in t.rows)
    (figure,) = told.figures
    assert (tmp_path / figure).read_bytes().startswith(b"\x89PNG")
    assert json.dumps(as_json(told))
