"""`outdoors`: what its flights say, and how they are counted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.outdoors import outdoors
from tgl_soar.analysis.experiments.outdoors.outdoors import FlownPassage, PassageJob, fly_passage


@pytest.fixture(scope="module", autouse=True)
def plainly() -> Iterator[None]:
    """Half a dozen landings take less than the kernel's compiling: some seconds each."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(outdoors, "available", lambda: False)
        yield


@pytest.fixture(scope="module")
def landed() -> FlownPassage:
    return fly_passage(PassageJob(outdoors.LAND, 1))


def test_a_break_off_ends_on_the_ground(landed: FlownPassage) -> None:
    assert [mode for _, mode, _ in landed.modes[-2:]] == ["breaking off", "landing"]
    assert "ground" in landed.ended
    assert landed.broke_off
    assert landed.path[-1][2] < 0.5
    again = fly_passage(PassageJob(outdoors.LAND, 1))
    assert (again.along_m, again.sink_mps) == (landed.along_m, landed.sink_mps)


def test_what_counts_as_landed(landed: FlownPassage) -> None:
    good = replace(landed, along_m=9.9, across_m=-4.9, sink_mps=1.4)
    assert good.landed
    for bad in (
        {"along_m": -10.1}, {"across_m": 5.1}, {"sink_mps": 1.6}, {"ended": "flew out at the side"}
    ):  # fmt: skip
        assert not replace(good, **bad).landed


def test_who_hits_the_ground_while_soaring_does_not_soar(landed: FlownPassage) -> None:
    soared = (*landed.modes[:-2], (5.0, "soaring", "on the line"))
    assert replace(landed, modes=soared, ended="").soars
    assert not replace(landed, modes=soared).soars


def test_a_launch_that_is_given_up_must_land_to_count(landed: FlownPassage) -> None:
    good = replace(landed, along_m=0.0, across_m=0.0, sink_mps=0.5, left_m=1.0)
    for across_m, held in ((0.0, True), (6.4, False)):
        given_up = replace(good, kind=outdoors.LAUNCH, across_m=across_m)
        others = {kind: [good] for kind in (outdoors.LAND, outdoors.WITH_IMU, outdoors.LULLED)}
        claims = outdoors._claims({outdoors.LAUNCH: [given_up]} | others)
        assert [claim.undecided for claim in claims] == [held, True, True]  # of one flight each
        assert not any(claim.holds for claim in claims)


@pytest.mark.parametrize(
    ("count", "of", "least", "held"),
    [
        (99, 100, 0.99, None),  # 95 to 100 %
        (368, 368, 0.99, True),
        (367, 367, 0.99, None),
        (98, 100, 0.99, False),
        (0, 0, 0.95, False),
    ],
)
def test_a_fraction_is_shown_by_its_interval_and_not_by_its_count(
    count: int, of: int, least: float, held: bool | None
) -> None:
    assert outdoors.shown(count, of, least) is held


@pytest.mark.parametrize("least", [outdoors.CAPTURED, outdoors.LANDED])
def test_flights_that_all_end_well_show_it_and_one_less_would_not(least: float) -> None:
    enough = outdoors.flights_to_show(least)
    assert outdoors.shown(enough, enough, least) is True
    assert outdoors.shown(enough - 1, enough - 1, least) is None


def test_as_many_are_flown_as_can_decide_each_claim() -> None:
    assert outdoors.flights_to_show(outdoors.CAPTURED) <= outdoors.FLIGHTS
    lulls = outdoors.FLIGHTS // outdoors.LULLS
    assert outdoors.flights_to_show(outdoors.LANDED) <= lulls
    # Of 200 break-offs by command 58 had height left, whatever law flew them home.
    assert outdoors.flights_to_show(outdoors.LANDED) <= 0.29 * 2 * outdoors.FLIGHTS


def test_every_flight_that_does_not_end_well_is_reported_by_itself(landed: FlownPassage) -> None:
    good = replace(landed, along_m=0.0, across_m=0.0, sink_mps=0.5)
    far = replace(good, seed=77, along_m=12.3)
    hard = replace(good, seed=78, sink_mps=2.0)
    reported = outdoors._badly([good, far, hard])
    assert len(reported) == 2
    assert reported[0].startswith("landing 77 (")
    assert "along 12.3 m" in reported[0]
    assert "sink 2.00 m/s" in reported[1]


def test_the_tables_the_claims_and_the_figure(tmp_path: Path) -> None:
    context = Context(Flyer(), figures=tmp_path, episodes=1)
    result = outdoors.run(context)
    assert len(result.claims) == 3
    assert (tmp_path / "outdoors.png").stat().st_size > 10_000
    assert [len(table.rows) for table in result.tables] == [3, 6]
    assert len(result.numbers["flights"]) == 4
