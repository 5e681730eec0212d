"""`hour`: what its flights say, and how they are counted."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from math import inf, nan
from pathlib import Path

import pytest

from tgl_soar.air.gusts import Schedule
from tgl_soar.air.wind_record import WindRecord
from tgl_soar.analysis.experiments.outdoors import hour, hour_walk
from tgl_soar.analysis.experiments.outdoors.hour import (
    FlownHour,
    HourCase,
    HourJob,
    fly_hour,
    path_of,
)
from tgl_soar.control.supervisor import BREAKING_OFF

GOOD = FlownHour(
    case=HourCase(30.0), seed=1, duration_s=3600.0, possible_s=3600.0, soarable=1.0,
    soared_s=3600.0, ended="", left_m=nan, broke_at_m=nan, wind_mps=6.0, veer_deg=20.0,
    along_m=0.0, across_m=0.0, sink_mps=0.0, landing=False,
)  # fmt: skip
HOME = replace(
    GOOD, soared_s=600.0, ended="hit the ground", left_m=12.0, broke_at_m=40.0, landing=True
)
POWERED = replace(GOOD, case=HourCase(30.0, 7.0, 0, hour.POWERED), soared_s=900.0, throttle_s=20.0)
WALKED = replace(POWERED, case=HourCase(30.0, 7.0, 0, hour.WALK))


@pytest.fixture(scope="module", autouse=True)
def plainly() -> Iterator[None]:
    """A few landings take less than the kernel's compiling, which takes minutes."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (hour, hour_walk):
            patch.setattr(module, "available", lambda: False)
        yield


@pytest.fixture(scope="module")
def flown() -> FlownHour:
    return fly_hour(HourJob(HourCase(8.0), 4, 60.0))


def test_a_flight_is_that_of_its_seed(flown: FlownHour) -> None:
    first, again, other = (fly_hour(HourJob(HourCase(8.0), seed, 12.0)) for seed in (1, 1, 2))
    assert first == again
    assert first.across_m != other.across_m
    assert 0.0 < flown.soared_s < flown.duration_s < 60.0
    assert flown.landing


def test_from_the_large_hill_it_lands_softly_although_the_wind_has_died() -> None:
    """Some 20 m too high, in 6 m/s: what half a minute and more of a glide must not advance by.

    With turns within 6 m to either side it came down 40 m beyond the place, and at 8.4 m/s on it;
    at the best glide's speed, as the airspeed is not measured, 12 of 30 end 10 to 39 m beyond.
    """
    falls = WindRecord(Schedule([0.0, 12.0, 20.0], [7.2, 7.2, 6.0]), Schedule([0.0], [0.0]))
    flown, values = path_of(HourJob(HourCase(30.0), 2, 300.0), falls)
    x, y, z = (flown[name] for name in ("x_m", "y_m", "z_m"))
    sink = (z[-2] - z[-1]) / (flown["time_s"][-1] - flown["time_s"][-2])
    assert "ground" in flown.ended
    assert z.max() > 40.0
    assert sink <= 1.5
    assert -10.0 <= values["LND_X"] - x[-1] <= 40.0
    assert abs(y[-1] - values["LND_Y"]) <= 15.0


def test_what_counts_as_lost_and_as_landed() -> None:
    assert not GOOD.lost
    assert not HOME.lost
    assert HOME.landed
    assert replace(HOME, landing=False).lost
    for sink in (1.6, nan):
        assert replace(HOME, sink_mps=sink).lost
    assert not replace(HOME, along_m=30.0, sink_mps=1.4).lost
    assert not replace(GOOD, ended="disengaged: too low").lost
    for bad in (
        replace(HOME, along_m=10.1),
        replace(HOME, across_m=-5.1),
        replace(HOME, sink_mps=1.6),
        replace(HOME, along_m=nan),
        replace(HOME, across_m=inf),
    ):
        assert not bad.landed


@pytest.mark.parametrize(
    ("bad", "claim"),
    [
        (replace(HOME, landing=False, left_m=nan), 0),
        (replace(HOME, sink_mps=1.6, left_m=nan), 0),
        (replace(GOOD, ended="disengaged: too low"), 1),
        (replace(HOME, across_m=5.1), 2),
        (replace(HOME, landing=False, left_m=nan, case=HourCase(30.0, 9.0, 2)), 3),
    ],
)
def test_each_claim_can_fail(bad: FlownHour, claim: int) -> None:
    good = [GOOD, HOME, POWERED, WALKED]
    assert all(found.holds for found in hour._claims(good))
    found = hour._claims([*good, bad])
    also = (0,) if claim == 3 else ()
    assert [each.holds for each in found] == [i not in (claim, *also) for i in range(5)]


@pytest.mark.parametrize(
    ("walked", "holds"),
    [
        (replace(WALKED, soared_s=899.0, throttle_s=21.0), True),
        (replace(WALKED, soared_s=901.0), False),
        (replace(WALKED, throttle_s=19.0), False),
    ],
)
def test_the_line_is_held_against_the_walk(walked: FlownHour, *, holds: bool) -> None:
    assert hour._beside_the_walk([POWERED, walked]).holds == holds
    hit = replace(POWERED, ended="hit the hill")
    assert not hour._beside_the_walk([POWERED, hit, walked, walked]).holds
    assert not hour._beside_the_walk([GOOD]).holds  # without such flights nothing is shown
    waits = replace(POWERED, case=POWERED.case._replace(auto=2), throttle_s=100.0)
    assert hour._beside_the_walk([POWERED, waits, walked]).holds == holds


def test_without_a_walk_nothing_is_reported_of_one() -> None:
    assert len(hour._claims([GOOD, HOME])) == 4


def test_what_others_lose_is_not_the_lines() -> None:
    hit = replace(WALKED, ended="hit the hill")
    claims = hour._claims([GOOD, HOME, POWERED, WALKED, hit])
    assert [each.holds for each in claims] == [True] * 5


def test_what_is_lost_by_waiting_is_held_against_the_same_wind() -> None:
    lost = replace(HOME, landing=False, case=HourCase(30.0, 9.0))
    for at_once, waited, holds in ((1, 1, True), (2, 1, True), (0, 1, False)):
        flown = [lost] * at_once + [replace(lost, case=HourCase(30.0, 9.0, 2))] * waited
        assert hour._claims(flown)[3].holds == holds
    assert (
        hour._claims(
            [replace(lost, case=HourCase(30.0)), replace(lost, case=HourCase(30.0, 9.0, 2))]
        )[3].holds
        is False
    )


def test_the_table_and_the_figure(flown: FlownHour, tmp_path: Path) -> None:
    table = hour._table({flown.case: [flown, HOME], GOOD.case: [GOOD]})
    assert all(len(row) == len(table.columns) for row in table.rows)
    assert hour.drawn_seed([GOOD, replace(HOME, seed=7)]) == 7
    rows = hour._table({each.case: [each] for each in (POWERED, GOOD)}).rows
    assert [row[table.columns.index("throttle [s]")] for row in rows] == ["20, 20, 20", "–"]
    hour.draw_hour(tmp_path / "hour.png", HourJob(HourCase(8.0), 4, 60.0))
    assert (tmp_path / "hour.png").stat().st_size > 10_000


def test_the_walk_moves_the_line_and_a_propeller_is_counted() -> None:
    """Where the wind falls to one in which no line holds the aircraft up, power is spent."""
    falls = WindRecord(Schedule([0.0, 3.0, 5.0], [6.6, 6.6, 4.8]), Schedule([0.0], [0.0]))
    case = HourCase(8.0, 6.6, 0)
    paths = {
        who: path_of(HourJob(case._replace(who=who), 3, 12.0), falls)[0]
        for who in (hour.LINE, hour.POWERED, hour.WALK)
    }
    moves = {who: path["target_changes"][-1] for who, path in paths.items()}
    assert moves[hour.WALK] > 2.0
    assert moves[hour.LINE] == moves[hour.POWERED] == 0.0
    used = {who: float(path["throttle"].sum()) for who, path in paths.items()}
    assert used[hour.LINE] == 0.0
    assert used[hour.POWERED] > 0.0


def test_the_walk_leaves_the_way_home_alone() -> None:
    falls = WindRecord(Schedule([0.0, 3.0, 5.0], [6.6, 6.6, 4.8]), Schedule([0.0], [0.0]))
    path, _ = path_of(HourJob(HourCase(8.0, 6.6, 1, hour.WALK), 3, 12.0), falls)
    home = path["mode"] >= BREAKING_OFF
    assert home.any()
    assert not home.all()
    assert len(set(path["target_changes"][home].tolist())) == 1
