"""The uses of the air that is read, in small: one of them beside none, in one air."""

from __future__ import annotations

import json

import pytest

from tgl_soar.analysis.experiments.catalogue import run
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.estimates import wind_use
from tgl_soar.analysis.experiments.estimates.estimator_flights import Ratios
from tgl_soar.analysis.experiments.estimates.wind_use import Compared, worth_claim
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


def test_a_ratio_without_the_flights_that_were_lost_decides_nothing() -> None:
    """0.83 of the pairs that are left, where the others were lost, is no gain and no proof."""
    none = Compared(Ratios(1.0, 1.0), 0, 0)
    part = Compared(Ratios(0.83, 1.0, left_out=2), 3, 1)
    claim = worth_claim({"neither, 0.05": none, "trim, 0.05": part})
    assert claim.undecided
    assert "the best is 1.00" in claim.measured
    assert "trim, 0.05: 0.83, without 2 pairs not scored, 3 lost against 1" in claim.measured
    for partial in (part._replace(lost=1), part._replace(ratios=Ratios(0.83, 1.0))):
        assert worth_claim({"trim": partial}).undecided
    whole = worth_claim({"trim": Compared(Ratios(0.83, 1.0), 1, 1)})
    assert not whole.holds
    assert not whole.undecided
    assert worth_claim({"trim": Compared(Ratios(0.96, 1.0, left_out=1), 1, 0)}).holds
