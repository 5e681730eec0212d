"""The forecast's experiment in small, and what its starts and its verdicts go by."""

from __future__ import annotations

import json
from math import cos, radians, sin

import numpy as np
import pytest

from tgl_soar.air.hill import HillField
from tgl_soar.air.zeuc import stable_crossing
from tgl_soar.analysis.experiments.catalogue import run
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.lift import forecast as e
from tgl_soar.analysis.experiments.result import as_json
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.control.envelope import Fence
from tgl_soar.control.forecast import NO_FORECAST, TOO_LOW
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.types import Ground

POLAR = load_airframe(shipped("airframes/eclipson_c.toml")).polar.as_polar()
HILL = e.SlidePlace(
    name="hill",
    field=HillField(7.5, 8.0),
    ground=Ground(2, (-8.0, -3.0, *[-3.0] * 6), (0.0, 7.0, *[7.0] * 6)),
    fence=Fence(x_min_m=-24.0, x_max_m=0.0, y_max_m=16.0, z_min_m=0.5, z_max_m=24.0),
    clearance_min_m=1.0,
    scale_m=5.0,
    duration_s=12.0,
    step_m=0.05,
)
START = e.SlideStart(
    x_m=-5.0, z_m=13.0, eta_rad=eta_from_lean(radians(15.0)), wind=1.0, change=1.0, gusts=0.01,
    sink=1.0,
)  # fmt: skip


def test_where_a_line_has_a_place_is_where_it_crosses_the_contour() -> None:
    crossing = stable_crossing(HILL.field, POLAR, (START.x_m, START.z_m, START.eta_rad))
    assert crossing is not None
    (up_m,) = e.stops(HILL, POLAR, START, 1.0)
    assert START.x_m + up_m * cos(START.eta_rad) == pytest.approx(crossing.x_m, abs=0.05)
    assert START.z_m + up_m * sin(START.eta_rad) == pytest.approx(crossing.z_m, abs=0.06)
    assert e.stops(HILL, POLAR, START, 0.6) == []  # of that wind


@pytest.mark.parametrize("settles", [False, True])
def test_a_drawn_line_has_a_place_or_has_none(settles: bool) -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        start = e.drawn(HILL, POLAR, settles, rng)
        assert (e.stops(HILL, POLAR, start, 1.0) != []) is settles


def test_late_is_who_reaches_the_clearance_unreported_and_could_have_been() -> None:
    sunk = e.Slid(start=START, foreseen=None, time_s=2.1, left_m=-0.01, is_outside=False)
    assert e.late(sunk)
    assert not e.late(sunk._replace(time_s=1.9))
    assert not e.late(sunk._replace(left_m=0.5))
    assert not e.late(sunk._replace(is_outside=True))
    assert not e.late(sunk._replace(foreseen=NO_FORECAST._replace(standing=TOO_LOW)))
    missed, wrong = e.claims({"a": [sunk]}, {"a": [sunk]})
    assert not missed.holds
    assert wrong.holds


def test_the_experiment_in_small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(e, "places", lambda: (HILL,))
    reported = run("forecast", Context(Flyer(), quick=True))
    without, having = reported.tables
    assert without.rows[0][0] == having.rows[0][0] == "hill"
    assert reported.claims[0].holds
    assert json.dumps(as_json(reported))
