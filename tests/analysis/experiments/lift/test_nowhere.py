"""Starts on lines without a place to settle: how they are drawn, and what counts as too late."""

from __future__ import annotations

from math import inf, radians

import numpy as np
import pytest

from tgl_soar.analysis.experiments.lift import nowhere as e
from tgl_soar.analysis.experiments.lift.forecast import LEANS_DEG, REPORTED_S, SlideStart, stops
from tgl_soar.analysis.search.places import KINDS, LAUNCH_WIND_MPS, Kind, place
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.control.envelope import clearance
from tgl_soar.control.forecast import SEARCH_FIRST
from tgl_soar.control.target_line import eta_from_lean

POLAR = load_airframe(shipped(e.AIRFRAME)).polar.as_polar()
FLOWN = e.LineFlown(
    found=True,
    warned_s=inf,
    low_s=inf,
    floor_s=inf,
    floor_reported=False,
    ended="",
    given_up="",
    flown_s=8.0,
)


@pytest.mark.parametrize("settles", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_a_drawn_line_has_a_place_or_has_none(kind: Kind, settles: bool) -> None:
    drawn = 0
    for seed in range(20_001, 20_005):
        there = place(kind, seed)
        found = e.line_place(there, POLAR, settles, np.random.default_rng(seed))
        if found is None:
            continue
        drawn += 1
        start, given = found.site.start, found.site.parameters
        assert start is not None
        assert (given["TGL_X"], given["TGL_Z"]) == (start.x_m, start.z_m)
        assert given["TGL_LEAN"] in LEANS_DEG
        assert clearance(there.ground, start.x_m, start.z_m) > given["CLEAR_MIN"]
        wind = there.field.wind_at(start.x_m, 0.0, start.z_m, 0.0)[0]
        assert LAUNCH_WIND_MPS[0] <= wind <= LAUNCH_WIND_MPS[1]
        line = SlideStart(
            x_m=start.x_m,
            z_m=start.z_m,
            eta_rad=eta_from_lean(radians(given["TGL_LEAN"])),
            wind=1.0,
            change=1.0,
            gusts=0.0,
            sink=there.sink_factor,
        )
        for change in (1.0, there.change):
            assert (stops(e._slide_place(there), POLAR, line, change) != []) is settles
        if settles:
            nearest = min(map(abs, stops(e._slide_place(there), POLAR, line, 1.0)))
            assert nearest <= e.AWAY_M + 2.0 * e.STEP_M[kind]
    assert drawn >= 2


def test_late_is_who_is_in_the_floor_while_the_module_reports_soaring() -> None:
    over = e.KNOWN_S + REPORTED_S
    assert not FLOWN.is_late
    sunk = FLOWN._replace(floor_s=over + 0.1, floor_reported=True)
    assert sunk.is_late
    assert not sunk._replace(floor_s=over - 0.1).is_late
    assert not sunk._replace(floor_reported=False).is_late
    assert FLOWN._replace(low_s=over + 0.1).is_low_late
    assert not FLOWN._replace(low_s=over - 0.1).is_low_late
    assert not FLOWN.is_low_late


def test_the_claims_count_floors_and_false_warnings() -> None:
    sunk = FLOWN._replace(floor_s=9.0, floor_reported=True)
    warned = FLOWN._replace(warned_s=2.0)

    def of(kind: Kind, act: int, settles: bool) -> list[e.LineFlown]:
        if act == SEARCH_FIRST:
            return [FLOWN] * 200 if settles else [warned] * 4
        return [FLOWN, warned] if settles else [warned, sunk if kind == "hill" else warned]

    late, false, none_late, none_false = e._claims(of)
    assert not late.holds
    assert late.measured.startswith("1 of 4")
    assert not false.holds
    assert false.measured.startswith("2 of 4")
    assert none_late.holds
    assert none_false.holds
    assert e._without(of).rows[0][3] == "2"
    assert e._having(of).rows[0][2].startswith("1 of 2")
