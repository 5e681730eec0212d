"""`beating`: what its flights say, and how they are counted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import degrees, isnan, nan
from pathlib import Path

import pytest

from tgl_soar.analysis.experiments.outdoors import beating, hour
from tgl_soar.analysis.experiments.outdoors.beating import (
    AUTO,
    LULLS,
    OBLIQUE,
    BeatFlight,
    BeatJob,
    cases,
    fly_beating,
    wind_of,
)
from tgl_soar.analysis.experiments.outdoors.hour import BEATS, LINE, HourCase, HourJob, hour_flown

LARGE = HourCase(30.0, 7.0, AUTO, BEATS)
GOOD = BeatFlight(
    kind=LULLS, case=LARGE, seed=1, duration_s=3600.0, aloft_s=3600.0, beating_s=600.0, turns=40,
    least_m=30.0, ended="", left_m=nan, along_m=0.0, across_m=0.0, sink_mps=0.0, landing=False,
)  # fmt: skip
HOME = replace(GOOD, aloft_s=900.0, ended="hit the ground", left_m=12.0, landing=True, sink_mps=0.7)
ALONE = replace(HOME, case=LARGE._replace(who=LINE), aloft_s=120.0, beating_s=0.0, least_m=nan)
ASIDE = replace(GOOD, kind=OBLIQUE, case=cases()[-1][1], aloft_s=600.0, duration_s=600.0)
FAST = [replace(each, case=each.case._replace(mean_mps=9.0)) for each in (HOME, ALONE)]
ALL = [GOOD, HOME, ALONE, ASIDE, *FAST]


def job_of(kind: str, case: HourCase, seed: int, duration_s: float) -> BeatJob:
    return BeatJob(kind=kind, case=case, seed=seed, duration_s=duration_s)


@pytest.fixture(scope="module", autouse=True)
def plainly() -> Iterator[None]:
    """Two short flights take less than the kernel's compiling, which takes minutes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hour, "available", lambda: False)
        yield


def test_who_may_beat_does_where_the_other_cannot_stand() -> None:
    """A wind that turns by 51 degrees at 18 s, over the larger hill."""
    kind, case, _ = cases()[-1]
    jobs = [job_of(kind, case._replace(who=who), 3, 75.0) for who in (BEATS, LINE)]
    beats, line = map(fly_beating, jobs)
    assert beats.beating_s > 20.0
    assert abs(beats.across_m) > 15.0  # along the ridge
    assert beats.ended == ""
    assert 40.0 < beats.least_m < 60.0
    assert line.beating_s == line.turns == 0
    assert isnan(line.least_m)
    assert fly_beating(jobs[1]._replace(duration_s=12.0)) == fly_beating(
        jobs[1]._replace(duration_s=12.0)
    )


def test_the_two_differ_in_nothing_but_the_leave_to_beat() -> None:
    for case in (LARGE, cases()[-1][1]):
        beats, line = (
            hour_flown(HourJob(case._replace(who=who), 1)).values for who in (BEATS, LINE)
        )
        differs = {each.name for each, value in beats if value != line[each.name]}
        assert differs == {"BEAT_AUTO", "BEAT_WIDTH", "FENCE_Y_MAX"}
        assert beats["FENCE_Y_MAX"] * 0.8 > beats["BEAT_WIDTH"]


def test_a_wind_that_is_too_oblique_turns_by_more_than_the_nose_may_and_stays() -> None:
    kind, case, duration_s = cases()[-1]
    sides = set()
    for seed in range(20):
        record = wind_of(job_of(kind, case, seed, duration_s))
        veer = degrees(record.veer_rad.at(duration_s))
        assert 45.0 <= abs(veer) <= 60.0
        assert abs(veer) > beating.OBLIQUE_MAX_DEG + 15.0
        assert record.veer_rad.at(9.0) == 0.0
        assert degrees(record.veer_rad.at(61.0)) == pytest.approx(veer)
        assert record.wind_mps.at(0.0) == record.wind_mps.at(500.0) == beating.OBLIQUE_MPS
        sides.add(veer > 0.0)
    assert sides == {True, False}
    lulls = job_of(LULLS, LARGE, 9401, 3600.0)
    assert wind_of(lulls).wind_mps.values == hour.record_of(HourJob(LARGE, 9401)).wind_mps.values


@pytest.mark.parametrize(
    ("flight", "changes", "fails"),
    [
        (GOOD, {}, set()),
        (GOOD, {"ended": "hit the hill"}, {0}),
        (HOME, {"sink_mps": 1.6}, {0, 4}),
        (ALONE, {"sink_mps": 1.6}, {0}),
        (GOOD, {"ended": "disengaged: outside the fence"}, {3}),
        (ALONE, {"ended": "disengaged: outside the fence"}, set()),
        (HOME, {"along_m": 11.0}, {4}),
        (ALONE, {"aloft_s": 751.0}, {1}),  # of 3600 and 900 s
        (ASIDE, {"ended": "hit the ground", "left_m": 3.0, "landing": True}, {2}),
        (ASIDE, {"ended": "disengaged: e_rho beyond CAPTURE_MAX"}, {2, 3}),
        (FAST[0], {"aloft_s": 359.0}, {1}),
    ],
)
def test_each_claim_can_fail(
    flight: BeatFlight, changes: dict[str, object], fails: set[int]
) -> None:
    flown = [replace(each, **changes) if each is flight else each for each in ALL]  # type: ignore[arg-type]
    claims = beating._claims(flown)
    assert {k for k, claim in enumerate(claims) if not claim.holds} == fails


def test_only_flights_that_beat_are_counted_as_such() -> None:
    """A flight that may beat and never did was disengaged, or landed badly, for other reasons."""
    never = [replace(each, beating_s=0.0, turns=0, least_m=nan) for each in (GOOD, HOME)]
    gone = replace(never[0], ended="disengaged: outside the fence")
    claims = beating._claims([*ALL, gone, replace(never[1], along_m=11.0)])
    assert [claim.holds for claim in claims[3:]] == [True, True]
    # GOOD, HOME, ASIDE and the one in 9 m/s beat; two of these broke off.
    assert [claim.measured.partition(" (")[0] for claim in claims[3:]] == ["0 of 4", "2 of 2"]
    assert [claim.measured for claim in beating._claims(never)[3:]] == [
        "none beat",
        "none broke off",
    ]


def test_the_table_has_a_row_for_each_case() -> None:
    rows = beating._table(ALL).rows
    assert len(rows) == len(cases()) == 10
    both = [row for row in rows if row[:3] == (LULLS, "30", "7")]
    assert [row[3] for row in both] == [LINE, BEATS]
    assert both[1][4:10] == ("2", "1", "1", "1", "0", "0")
    assert both[1][11] == "37.5"
    assert beating._why([replace(GOOD, ended="hit the hill"), HOME]) == (
        "lulls and veer, 30 m, 7 m/s, the line, or beating: hit the hill: 1"
    )


def test_the_longest_is_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    job = beating.drawn_job([ASIDE, replace(GOOD, seed=7, beating_s=601.0), HOME])
    assert (job.seed, job.kind, job.case) == (7, LULLS, LARGE)
    path = tmp_path / "beating.png"
    kind, case, _ = cases()[-1]
    beating.draw_beating(path, job_of(kind, case, 3, 45.0))
    assert path.stat().st_size > 5000
