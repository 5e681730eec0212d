"""`hour` and `beating`: which flights are asked for, what is drawn of them, and how AOSoar's walk
steers through an hour; no flight is flown."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from math import nan, radians
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.outdoors import beating, hour, hour_walk
from tgl_soar.analysis.experiments.outdoors.beating import BeatFlight, BeatJob
from tgl_soar.analysis.experiments.outdoors.hour import (
    BEATS,
    LINE,
    POWERED,
    WALK,
    FlownHour,
    HourCase,
    HourJob,
)
from tgl_soar.analysis.search.steered_flight import COLUMN
from tgl_soar.control.supervisor import BREAKING_OFF, CAPTURING, LANDING, SOARING
from tgl_soar.control.target_line import TargetLine, eta_from_lean

FLOWN = FlownHour(
    case=HourCase(8.0), seed=1, duration_s=3600.0, possible_s=1800.0, soarable=0.75,
    soared_s=600.0, ended="hit the ground", left_m=12.0, broke_at_m=40.0, wind_mps=6.0,
    veer_deg=20.0, along_m=1.0, across_m=2.0, sink_mps=0.5, landing=True,
)  # fmt: skip
BEAT = BeatFlight(
    kind=beating.LULLS, case=HourCase(30.0, 7.0, 2, BEATS), seed=1, duration_s=60.0, aloft_s=50.0,
    beating_s=9.0, turns=1, least_m=9.0, ended="", left_m=nan, along_m=0.0, across_m=0.0,
    sink_mps=0.5, landing=False,
)  # fmt: skip


class AskedFlyer(Flyer):
    """Flies nothing: of each job a flight of its case and seed."""

    def __init__(self) -> None:
        super().__init__()
        self.jobs: list[Any] = []

    def each(self, fly: Callable[[Any], Any], jobs: Iterable[Any], **_: bool) -> list[Any]:
        self.jobs = list(jobs)
        if fly is hour.fly_hour:
            return [replace(FLOWN, case=job.case, seed=job.seed) for job in self.jobs]
        assert fly is beating.fly_beating
        return [replace(BEAT, kind=job.kind, case=job.case, seed=job.seed) for job in self.jobs]


def asked(run: Callable[[Context], Any], **given: Any) -> tuple[list[Any], Any]:
    flyer = AskedFlyer()
    result = run(Context(flyer, **given))
    return flyer.jobs, result


# --- an hour --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "of_the_line", "beside", "lasting_s"),
    [
        ({}, 100, 25, 3600.0),
        ({"quick": True}, 1, 1, 180.0),
        ({"episodes": 30}, 30, 25, 3600.0),
        ({"episodes": 3}, 3, 3, 3600.0),
        ({"dispersion": True}, 50, 0, 3600.0),
    ],
)
def test_so_many_hours_are_flown_of_each_row(
    given: dict[str, Any], of_the_line: int, beside: int, lasting_s: float
) -> None:
    jobs, result = asked(hour.run, **given)
    cases = [
        HourCase(radius, *case)
        for radius in (8.0, 30.0)
        for case in (
            (7.0, 1, LINE), (9.0, 1, LINE), (9.0, 2, LINE),
            *(
                (mean, auto, who)
                for mean in (7.0, 9.0)
                for auto, who in ((0, POWERED), (0, WALK), (2, POWERED))
                if beside
            ),
        )
    ]  # fmt: skip
    assert list(dict.fromkeys(job.case for job in jobs)) == cases
    for case in cases:
        seeds = [job.seed for job in jobs if job.case == case]
        count = of_the_line if case.who == LINE else beside
        assert seeds == list(range(9201, 9201 + count)), case
    assert {job.duration_s for job in jobs} == {lasting_s}
    assert {job.dispersed for job in jobs} == {given.get("dispersion", False)}
    assert result.seeds == tuple(range(9201, 9201 + of_the_line))
    assert len(result.tables[0].rows) == len(cases)
    assert len(result.numbers["flights"]) == len(jobs)
    assert len(result.claims) == (5 if beside else 4)
    assert result.figures == ()


def test_the_longest_that_had_to_break_off_is_drawn(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Any] = []
    monkeypatch.setattr(hour, "draw_hour", lambda *what: drawn.append(what))
    _, result = asked(hour.run, quick=True, figures=tmp_path)
    assert drawn == [(tmp_path / "hour.png", HourJob(HourCase(30.0, 9.0, 2, LINE), 9201, 180.0))]
    assert result.figures == ("hour.png",)
    on = replace(FLOWN, seed=7, soared_s=3600.0, left_m=nan)
    home = [replace(FLOWN, seed=seed, soared_s=s) for seed, s in ((3, 60.0), (4, 90.0), (5, 80.0))]
    assert hour.drawn_seed([on, *home]) == 4
    assert hour.drawn_seed([on, replace(on, seed=8, soared_s=3000.0)]) == 7


def test_a_row_of_an_hour_is_in_minutes_and_per_cent() -> None:
    case = HourCase(30.0, 9.0, 2, LINE)
    on = replace(FLOWN, soared_s=3600.0, left_m=nan, ended="", possible_s=3600.0, soarable=1.0)
    gone = replace(on, ended="disengaged: too low", soared_s=60.0)
    far = replace(FLOWN, along_m=30.0, left_m=2.0)
    ((*row,),) = hour._table({case: [FLOWN, on, gone, far]}).rows
    assert row == [
        "30", "9", "2", LINE, "4", "1", "2", "1", "1", "0",
        "1.0, 10.0, 60.0", "20.2", "45.0", "87.5 %", "–",
        "2.0, 7.0, 12.0", "40.0, 40.0, 40.0", "6.0, 6.0, 6.0", "1.0, 15.5, 30.0",
        "2.0, 2.0, 2.0", "0.50, 0.50, 0.50",
    ]  # fmt: skip
    powered = case._replace(who=POWERED)
    ((*row,),) = hour._table({powered: [replace(FLOWN, throttle_s=12.6)]}).rows
    assert row[14] == "13, 13, 13"


def test_ends_are_reported_with_hill_wind_and_leave_the_most_frequent_first() -> None:
    hit = replace(FLOWN, case=HourCase(30.0, 9.0, 2, LINE), ended="hit the hill", landing=False)
    far = replace(FLOWN, along_m=30.0)
    assert hour._why([FLOWN, far, hit, hit, replace(FLOWN, ended="", landing=False)]) == (
        "30 m, 9 m/s, 2, the line: hit the hill: 2;"
        " 8 m, 7 m/s, 1, the line: hit the ground (landing): 1"
    )


# --- beating --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "count", "shorter"),
    [({}, 100, 1.0), ({"quick": True}, 1, 20.0), ({"dispersion": True}, 25, 1.0),
     ({"episodes": 6}, 6, 1.0)],
)  # fmt: skip
def test_so_many_are_flown_by_who_may_beat_and_who_may_not(
    given: dict[str, Any], count: int, shorter: float
) -> None:
    jobs, result = asked(beating.run, **given)
    assert jobs == [
        BeatJob(
            kind=kind,
            case=case,
            seed=seed,
            duration_s=duration_s / shorter,
            dispersed="dispersion" in given,
        )
        for kind, case, duration_s in beating.cases()
        for seed in range(9401, 9401 + count)
    ]
    assert result.seeds == tuple(range(9401, 9401 + count))
    assert len(result.numbers["flights"]) == 10 * count


# --- a walk through an hour -----------------------------------------------------------------------


class Steered:
    """Ten looks of a flight: the first shows nothing, and it is on its way home from the
    seventh on."""

    made: list[Steered] = []  # noqa: RUF012 - of one test

    def __init__(
        self, world: Any, values: Any, polar: Any, duration_s: float, seed: int, *, plain: bool
    ) -> None:
        self.given = (world, values, polar, duration_s, seed, plain)
        self.rows = np.full((10, len(COLUMN)), float(SOARING))
        self.rows[6:, COLUMN["mode"]] = BREAKING_OFF
        self.rows[8:, COLUMN["mode"]] = LANDING
        self.rows[1, COLUMN["mode"]] = CAPTURING
        self.count = 0
        self.sets: list[dict[str, float]] = []
        Steered.made.append(self)

    @property
    def flies(self) -> bool:
        return self.count < 10

    @property
    def now(self) -> Any:
        return SimpleNamespace(steps=self.count) if self.count else None

    def look(self) -> Any:
        self.count += 1
        return None if self.count == 1 else self.count

    def set(self, wanted: dict[str, float]) -> None:
        self.sets.append(wanted)

    def trajectory(self) -> str:
        return "flown"


class Walked:
    """A walk that goes a metre at each look."""

    made: list[tuple[Any, ...]] = []  # noqa: RUF012 - of one test

    def __init__(self, look: Any, kind: str, seed: int) -> None:
        Walked.made.append((look, kind, seed))
        self.looks: list[Any] = []

    def look(self, look: int) -> Any:
        self.looks.append(look)
        target = TargetLine(float(look), 2.0, eta_from_lean(radians(15.0)))
        return SimpleNamespace(target=target)


@pytest.mark.parametrize("there", [True, False])
def test_a_walk_moves_the_line_until_the_module_goes_home(
    there: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    Steered.made, Walked.made = [], []
    monkeypatch.setattr(hour_walk, "SteeredFlight", Steered)
    monkeypatch.setattr(hour_walk, "Walk", Walked)
    monkeypatch.setattr(hour_walk, "available", lambda: there)
    values: Any = SimpleNamespace(changed=lambda changes: {"as they were": 1.0, **changes})
    world, polar = "a world", "a polar"
    found = hour_walk.walked(world, values, polar, 60.0, 5)  # type: ignore[arg-type]
    assert found == "flown"  # type: ignore[comparison-overlap]
    (flight,) = Steered.made
    searching = {"as they were": 1.0, "TGL_LEAN_MIN": -5.0, "SRCH_START": 1.0}
    assert flight.given == (world, searching, polar, 60.0, 5, not there)
    assert Walked.made == [(2, "hill", 5)]  # of the first look that shows something
    assert [each["TGL_X"] for each in flight.sets] == [2.0, 3.0, 4.0, 5.0, 6.0]
    assert {each["TGL_LEAN"] for each in flight.sets} == {15.0}
