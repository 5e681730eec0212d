"""`rangefinder`: what its flights say, and how they are counted."""

from __future__ import annotations

from math import inf, nan
from random import Random

import pytest

from tgl_soar.analysis.experiments.outdoors import rangefinder as ranges
from tgl_soar.analysis.experiments.outdoors.rangefinder import (
    RangeFlight,
    RangeJob,
    fly_range,
)
from tgl_soar.sim.faults import parse_fault

GOOD = RangeFlight(
    kind=ranges.HEIGHT,
    seed=1,
    fault="",
    duration_s=180.0,
    ended="",
    captures=0,
    off_rms_m=0.1,
    off_m=0.2,
    within=1.0,
    height_rms_m=0.1,
    least_m=5.0,
    apart_m=nan,
)


@pytest.fixture
def plainly(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ranges, "available", lambda: False)
    monkeypatch.setattr(ranges, "DRIFT_S", ranges.BEGIN_S + 2.0)
    monkeypatch.setattr(ranges, "WRONG_S", 1.0)
    monkeypatch.setattr(ranges, "AFTER_S", 1.0)


@pytest.mark.usefixtures("plainly")
def test_two_rows_of_a_pair_differ_by_the_rangefinder_alone() -> None:
    """The line begins where the lift is in both; with the rangefinder the height is right."""
    without, ranged = (
        fly_range(RangeJob(kind, 3)) for kind in (ranges.HEIGHT, ranges.HEIGHT_RANGED)
    )
    assert without.ended == ranged.ended == ""
    assert without.duration_s == ranged.duration_s == pytest.approx(18.0, abs=0.01)
    assert without.height_rms_m != ranged.height_rms_m
    assert max(without.off_m, ranged.off_m) < 1.0
    assert 0.0 < without.within <= 1.0


def test_a_wrong_rangefinder_is_drawn_from_its_seed_and_lasts() -> None:
    drawn = [ranges._drawn_fault(Random(f"{ranges.WRONG} {seed}")) for seed in range(40)]
    assert drawn == [ranges._drawn_fault(Random(f"{ranges.WRONG} {seed}")) for seed in range(40)]
    faults = [parse_fault(text) for text in drawn]
    assert {fault.way for fault in faults} == {"freeze", "bias", "noise", "dropout"}
    assert all(fault["for"] == ranges.WRONG_S for fault in faults)


@pytest.mark.parametrize(
    ("kind", "changes", "holds"),
    [
        (ranges.RECEIVER_RANGED, {"off_m": 0.31}, (False, True, True)),
        (ranges.RECEIVER_RANGED, {"ended": "hit the ground"}, (False, True, True)),
        (ranges.HEIGHT_RANGED, {"off_m": 0.31}, (True, False, True)),
        (ranges.HEIGHT, {"off_m": 3.0}, (True, True, True)),  # nothing is claimed of it
        (ranges.WRONG, {"ended": "disengaged: too low", "apart_m": inf}, (True, True, False)),
        (ranges.WRONG, {"captures": 1}, (True, True, False)),
        (ranges.WRONG, {"apart_m": 2.0}, (True, True, True)),
    ],
)
def test_each_claim_is_about_its_own_flights(
    kind: str, changes: dict[str, object], holds: tuple[bool, ...]
) -> None:
    bad = RangeFlight(**{**vars(GOOD), "kind": kind, **changes})
    by_kind = {each: [RangeFlight(**{**vars(GOOD), "kind": each})] for each in ranges.KINDS}
    assert all(claim.holds for claim in ranges._claims(by_kind))
    by_kind[kind].append(bad)
    assert tuple(claim.holds for claim in ranges._claims(by_kind)) == holds
