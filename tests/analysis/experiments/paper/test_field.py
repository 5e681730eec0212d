"""The map of a hill: its three places."""

from __future__ import annotations

from math import radians

import pytest

from tgl_soar.air.hill import HillField
from tgl_soar.air.zeuc import stable_crossing
from tgl_soar.analysis.experiments.paper.field import (
    POLAR,
    RADIUS_M,
    WIND_MPS,
    claims_of,
    positions,
    why,
)
from tgl_soar.control.target_line import TargetLine, eta_from_lean
from tgl_soar.types import polar_sink


def test_the_hill_has_its_three_places() -> None:
    """By construction of the parabola: 1.5 + 0.2 · 1² = 1.7 m/s at 8 and at 10 m/s."""
    places = positions()
    assert polar_sink(POLAR, 8.0) == pytest.approx(1.7)
    assert polar_sink(POLAR, 10.0) == pytest.approx(1.7)
    assert [round(p.updraft_mps, 2) for p in places] == [1.7, 1.53, 1.7]
    assert all(claim.holds for claim in claims_of(places))
    a, b, c = places
    assert not claims_of([a._replace(updraft_mps=1.8), b, c])[0].holds
    assert not claims_of([c, b, a])[2].holds
    for place in (b, c):  # their perpendiculars lean downwind; lines that lean upwind do as well
        assert place.lean_rad < 0.0
        upwind = TargetLine(place.x_m, place.z_m, eta_from_lean(radians(20.0)))
        assert stable_crossing(HillField(WIND_MPS, RADIUS_M), POLAR, upwind) is not None


def test_what_is_reported_of_the_places_follows_from_their_numbers() -> None:
    places = positions()
    a, b, c = places
    words = why(places)
    assert f"more wind move it by {b.shift_m:+.2f} m, as past best glide" in words
    assert "The perpendicular at [b] and [c] leans downwind" in words
    rises = why([a, b._replace(shift_m=0.1, lean_rad=0.3), c])
    assert "move it by +0.10 m. The perpendicular at [c] leans" in rises
    upwind = why([p._replace(lean_rad=0.3) for p in places])
    assert upwind.endswith("The module takes each of these lines.")
