"""Every experiment would fly what it flew when its figures were published (`plans.py`)."""

from __future__ import annotations

import json

import pytest
from plans import FAULTS, KEPT, PLANNED, drawn_faults, key, planned

FOUND = json.loads(KEPT.read_text(encoding="utf-8"))


@pytest.mark.parametrize("quick", [False, True])
@pytest.mark.parametrize("name", PLANNED)
def test_an_experiment_flies_what_it_flew(name: str, quick: bool) -> None:
    plan = planned(name, quick=quick)
    assert plan["flights"] > 0
    assert plan == FOUND[key(name, quick=quick)], (
        "meant? python tests/analysis/experiments/plans.py"
    )


def test_all_are_kept_and_no_others() -> None:
    experiments = set(FOUND) - {FAULTS}
    assert experiments == {key(name, quick=quick) for name in PLANNED for quick in (False, True)}


def test_faults_are_drawn_from_where_they_were() -> None:
    assert drawn_faults() == FOUND[FAULTS], "meant? python tests/analysis/experiments/plans.py"
