"""The uses of the air that is read, in small: one of them beside none, in one air."""

from __future__ import annotations

import json

import pytest

from tgl_soar.analysis.experiments import wind_use
from tgl_soar.analysis.experiments.catalogue import run
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.result import as_json


def test_each_use_is_held_against_flights_without_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The feed-forward moves the elevator more, and is worth nothing."""
    used = "`WIND_FF` 0.7"
    monkeypatch.setattr(wind_use, "TURBULENCES", (0.03,))
    monkeypatch.setattr(
        wind_use, "USES", {name: wind_use.USES[name] for name in (wind_use.NEITHER, used)}
    )
    reported = run("wind_use", Context(flyer=Flyer(), quick=True))
    (table,) = reported.tables
    neither, with_it = table.rows
    assert neither[-2:] == ("1.00", "1.00")
    assert float(with_it[-2]) > 1.1
    assert float(with_it[-1]) > 1.3
    (claim,) = reported.claims
    assert claim.holds
    assert claim.measured.startswith("the best is 1.00")
    assert json.dumps(as_json(reported))
