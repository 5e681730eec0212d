"""Experiments run whole, one seed each, with their figures."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from test_catalogue_lists import AIMS, OWN, PAPER

from tgl_soar.analysis.experiments.catalogue import (
    APART,
    EXPERIMENTS,
    OURS,
    RIGID_BODY_ALONE,
    TITLES,
    run,
)
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.result import as_json


def test_every_experiment_has_a_title() -> None:
    assert list(TITLES) == list(EXPERIMENTS)


def test_the_catalogue_has_the_papers_for_both_models_and_ours_for_the_rigid_body() -> None:
    assert set(RIGID_BODY_ALONE) == {*AIMS, *OWN}
    assert len(RIGID_BODY_ALONE) == len(AIMS) + len(OWN)
    assert set(EXPERIMENTS) - OURS == set(PAPER)
    assert sorted(APART) == sorted(OWN)


LONG = pytest.mark.long


@pytest.mark.parametrize(
    "name",
    ["field", "static", *(pytest.param(name, marks=LONG) for name in ("rotate", "gust"))],
)
def test_an_experiment_tells_and_draws(tmp_path: Path, name: str) -> None:
    """One seed: means of a leg are known to 3 cm or so, hence the claims are judged more mildly."""
    reported = run(name, Context(flyer=Flyer(), figures=tmp_path, quick=True))
    assert reported.name == name
    assert reported.tables
    assert all(len(row) == len(t.columns) for t in reported.tables for row in t.rows)
    (figure,) = reported.figures
    data = (tmp_path / figure).read_bytes()
    assert data.startswith(b"\x89PNG")
    assert 15_000 < len(data) < 150_000
    assert json.dumps(as_json(reported))
    if name in ("field", "static", "rotate"):
        assert reported.verdict == "agrees", reported.claims


def test_without_a_folder_nothing_is_drawn() -> None:
    assert run("field", Context(flyer=Flyer())).figures == ()
