"""`satellites`: what its flights say, and how they are counted."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan
from typing import Any

import pytest

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.outdoors import satellites as sat
from tgl_soar.analysis.experiments.outdoors.satellites import (
    SatelliteFlight,
    SatelliteJob,
    fly_satellites,
)

FLIES_COMPILED = pytest.mark.long  # a kernel of its own, and minutes of flight


@pytest.fixture(scope="module")
def flown() -> dict[str, SatelliteFlight]:
    return {kind: fly_satellites(SatelliteJob(kind, 1)) for kind in sat.KINDS}


@FLIES_COMPILED
def test_a_reset_moves_the_frame_and_nothing_else(flown: dict[str, SatelliteFlight]) -> None:
    """As far as the fixes are off the aircraft is not; the claim is that of the experiment."""
    for kind in (sat.RESET, sat.TURNED):
        assert flown[kind].ended == ""
        assert flown[kind].apart_m < sat.APART_M
    assert flown[sat.RESET].fix_off_m > 0.2
    assert flown[sat.TURNED].fix_off_m < 0.1


@FLIES_COMPILED
def test_dead_reckoning_ends_at_home_where_it_may(flown: dict[str, SatelliteFlight]) -> None:
    assert flown[sat.HOME].landing
    assert not flown[sat.HOME].lost
    assert flown[sat.UNREPORTED].fix_off_m > 0.2


@FLIES_COMPILED
def test_a_drifting_receiver_begins_where_the_operator_has_put_the_line(
    flown: dict[str, SatelliteFlight],
) -> None:
    drifted = flown[sat.RECEIVER]
    assert drifted.off_m > 0.1
    # The two maxima are not of the same instant: what a step leaves behind counts.
    assert drifted.beside_m > max(0.0, drifted.off_m - drifted.fix_off_m)
    assert (drifted.beside_m > sat.BESIDE_M) == (drifted.beside_share > 0.0)
    assert len(drifted.faults) == 5
    exact = flown[sat.RTK]
    assert exact.fix_off_m < drifted.fix_off_m
    assert exact.off_m < drifted.off_m
    assert 0.5 < exact.within <= 1.0


@FLIES_COMPILED
def test_the_same_seed_is_the_same_flight(flown: dict[str, SatelliteFlight]) -> None:
    again = fly_satellites(SatelliteJob(sat.RESET, 1))
    assert (again.apart_m, again.off_m) == (flown[sat.RESET].apart_m, flown[sat.RESET].off_m)
    assert (
        again.faults == flown[sat.RESET].faults != fly_satellites(SatelliteJob(sat.RESET, 2)).faults
    )


@FLIES_COMPILED
def test_what_counts_as_lost_and_as_landed(flown: dict[str, SatelliteFlight]) -> None:
    plain = replace(flown[sat.RESET], ended="", landing=False)
    assert not plain.lost
    assert not replace(plain, ended="disengaged: position lost").lost
    assert replace(plain, ended="hit the ground").lost
    home = replace(plain, ended="hit the ground", landing=True, along_m=9, across_m=-4, sink_mps=1)
    assert home.landed
    assert not home.lost
    wrong: tuple[dict[str, Any], ...] = ({"along_m": -10.1}, {"across_m": 5.1}, {"sink_mps": 1.6})
    for bad in wrong:
        assert not replace(home, **bad).landed


@pytest.mark.parametrize(
    ("kind", "changes", "claims"),
    [
        (sat.RESET, {"apart_m": 0.051}, {0}),
        (sat.TURNED, {"apart_m": inf}, {0}),
        (sat.TURNED, {"captures": 1}, {0}),
        (sat.RESET, {"ended": "hit the ground"}, {1}),
        (sat.HOME, {"ended": "disengaged: outside the fence"}, {1}),
        (sat.HELD, {"ended": "hit the ground"}, {2, 5}),  # and none soars on
        (sat.HELD, {"ended": "disengaged: too low", "clearance_m": 0.9}, {2, 5}),
        (sat.RECEIVER, {"beside_m": 0.31}, {3}),
        (sat.RTK, {"off_m": 0.31}, {4}),
        (sat.RTK, {"ended": "disengaged: outside the fence"}, {1, 4}),  # early is not near
        (sat.HELD, {"last_off_m": 0.31}, {5}),
    ],
)
def test_each_claim_can_fail(kind: str, changes: dict[str, Any], claims: set[int]) -> None:
    good = SatelliteFlight(
        kind="", seed=1, faults=(), duration_s=1.0, ended="", captures=0, off_m=0.1, last_off_m=0.1,
        fix_off_m=0.0, beside_m=0.1, beside_share=0.0, within=1.0, clearance_m=nan,
        apart_m=0.01, along_m=nan,
        across_m=nan, sink_mps=nan, landing=False,
    )  # fmt: skip
    by_kind = {each: [replace(good, kind=each)] for each in sat.KINDS}
    assert all(found.holds for found in sat._claims(by_kind))
    by_kind[kind] = [replace(by_kind[kind][0], **changes)]
    assert [found.holds for found in sat._claims(by_kind)] == [i not in claims for i in range(6)]


def test_who_is_disengaged_high_and_without_leave_fails_only_what_it_does_not_soar_on_for() -> None:
    high = SatelliteFlight(
        kind=sat.HELD, seed=1, faults=(), duration_s=1.0, ended="disengaged: position lost",
        captures=0,
        off_m=0.1, last_off_m=0.1, fix_off_m=0.0, beside_m=0.1, beside_share=0.0,
        within=1.0, clearance_m=4.0,
        apart_m=nan, along_m=nan, across_m=nan, sink_mps=nan, landing=False,
    )  # fmt: skip
    by_kind = {each: [replace(high, kind=each, ended="", apart_m=0.0)] for each in sat.KINDS}
    by_kind[sat.HELD].append(high)
    assert all(found.holds for found in sat._claims(by_kind))


@FLIES_COMPILED
def test_the_table_has_a_row_for_each_kind() -> None:
    result = sat.run(Context(Flyer(), figures=None, episodes=1))
    (table,) = result.tables
    assert [row[0] for row in table.rows] == list(sat.KINDS)
    assert all(len(row) == len(table.columns) for row in table.rows)
    assert len(result.numbers["flights"]) == len(sat.KINDS)
