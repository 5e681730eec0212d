"""The flights of `nowhere` and `throttle`: where a line begins, what flies it, and what came of it,
of scripted loops."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, inf, isfinite, radians, sin
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.lift import nowhere as e
from tgl_soar.analysis.experiments.lift import throttle as t
from tgl_soar.analysis.experiments.lift.forecast import stops
from tgl_soar.analysis.search.places import KINDS, LAUNCH_WIND_MPS, Kind, SearchPlace, place
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.control.envelope import clearance
from tgl_soar.control.forecast import DISENGAGE, SEARCH_FIRST, SETTLES, TOO_LOW
from tgl_soar.control.supervisor import (
    CAPTURING,
    LANDING,
    REASON_NOT_FOUND,
    REASON_NOWHERE,
    SOARING,
)
from tgl_soar.control.supervisor_texts import REASON_TEXTS
from tgl_soar.control.target_line import TargetLine, eta_from_lean
from tgl_soar.sim.flight import CRASHED, FLIES, HELD_S, Row
from tgl_soar.types import Ground

POLAR = load_airframe(shipped(e.AIRFRAME)).polar.as_polar()

# --- where a line begins --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "duration_s", "step_m"), [("tunnel", 8.0, 0.01), ("hill", 30.0, 0.05)]
)
def test_slides_go_by_the_places_own_fence_and_clearance(
    kind: Kind, duration_s: float, step_m: float
) -> None:
    there = place(kind, 3001)
    at, given = e._slide_place(there), there.site.parameters
    assert (at.name, at.field, at.ground) == (kind, there.field, there.ground)
    assert at.fence.x_min_m == given["FENCE_X_MIN"]
    assert at.fence.x_max_m == given["FENCE_X_MAX"]
    assert at.fence.z_min_m == given["FENCE_Z_MIN"]
    assert at.fence.z_max_m == given["FENCE_Z_MAX"]
    assert at.fence.y_max_m == given["FENCE_Y_MAX"]
    assert at.clearance_min_m == given["CLEAR_MIN"]
    assert (at.duration_s, at.step_m) == (duration_s, step_m)


@pytest.mark.parametrize("settles", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_every_start_is_clear_and_in_a_wind_that_can_be_flown(kind: Kind, settles: bool) -> None:
    there = place(kind, 3002)
    at, rng = e._slide_place(there), np.random.default_rng(7)
    least, box = at.clearance_min_m, there.box
    drawn = [
        start
        for start in (e._drawn(there, at, POLAR, settles, rng) for _ in range(50))
        if start is not None
    ]
    for start in drawn:
        assert (start.wind, start.gusts) == (1.0, 0.0)
        assert (start.change, start.sink) == (there.change, there.sink_factor)
        wind_mps = there.field.wind_at(start.x_m, 0.0, start.z_m, 0.0)[0]
        assert LAUNCH_WIND_MPS[0] <= wind_mps <= LAUNCH_WIND_MPS[1]
        assert clearance(there.ground, start.x_m, start.z_m) >= 1.5 * least * (1.0 - 1e-9)
        for change in (1.0, there.change):
            found = stops(at, POLAR, start, change)
            assert bool(found) is settles
            for s in found[:1]:
                x_m = start.x_m + s * cos(start.eta_rad)
                z_m = start.z_m + s * sin(start.eta_rad)
                room_m = min(
                    x_m - box.x_min_m, box.x_max_m - x_m, box.z_max_m - z_m,
                    clearance(there.ground, x_m, z_m) - least,
                )  # fmt: skip
                assert room_m >= 0.5 * least - 3.0 * at.step_m


def test_a_place_where_no_start_can_be_drawn_is_not_flown(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[object] = []
    monkeypatch.setattr(e, "_drawn", lambda *_, **__: asked.append(None))
    found = e.fly_line(e.LineJob(kind="tunnel", seed=3001, settles=True, act=2))
    assert len(asked) == 400
    assert found == e.LineFlown(
        found=False, warned_s=inf, low_s=inf, floor_s=inf, floor_reported=False, ended="",
        given_up="", flown_s=0.0,
    )  # fmt: skip


# --- what came of a flight ------------------------------------------------------------------------

HZ = 200
FLAT = Ground(2, (-90.0, 90.0, *[90.0] * 6), (0.0,) * 8)


def flight_of(
    z_m: Sequence[float], mode: Sequence[int], standing: int = FLIES
) -> tuple[Any, np.ndarray]:
    rows = np.zeros((len(z_m) + 50, len(Row._fields)))
    rows[: len(z_m), Row._fields.index("z_m")] = z_m
    rows[: len(mode), Row._fields.index("mode")] = mode
    site = SimpleNamespace(parameters={"CLEAR_MIN": 1.0})
    flight = SimpleNamespace(
        now=SimpleNamespace(steps=len(z_m), standing=standing),
        rows=rows,
        place=SimpleNamespace(site=site, ground=FLAT),
        world=SimpleNamespace(step_hz=HZ),
    )
    return flight, rows


def came_of(
    flight: Any, ended: str = "", seeks_s: float = inf, flown_s: float = 3.0
) -> e.LineFlown:
    episode: Any = SimpleNamespace(ended=ended, given_up="no lift", flown_s=flown_s)
    return e.flown_of(flight, episode, seeks_s)


def test_low_is_the_first_tick_under_the_clearance_while_it_reports_to_soar() -> None:
    z_m = [2.0] * 100 + [0.9] * 100 + [2.0] * 100
    flight, _ = flight_of(z_m, [SOARING] * 300)
    assert came_of(flight).low_s == pytest.approx(0.5)
    flight, _ = flight_of(z_m, [LANDING] * 150 + [CAPTURING] * 150)
    assert came_of(flight).low_s == pytest.approx(0.75)
    flight, _ = flight_of(z_m, [LANDING] * 200 + [SOARING] * 100)
    assert came_of(flight).low_s == inf
    flight, _ = flight_of([1.0] * 300, [SOARING] * 300)
    assert came_of(flight).low_s == inf  # at it is not under it
    flight, _ = flight_of([0.9] * 300, [SOARING] * 300)
    assert came_of(flight).low_s == 0.0


def test_the_floor_counts_while_soaring_was_reported_to_the_end() -> None:
    for mode, standing, floor_s, reported in (
        (SOARING, CRASHED, 3.0, True),
        (CAPTURING, CRASHED, 3.0, True),
        (LANDING, CRASHED, 3.0, False),
        (SOARING, FLIES, inf, False),
    ):
        flight, _ = flight_of([2.0] * 300, [SOARING] * 299 + [mode], standing)
        found = came_of(flight)
        assert (found.floor_s, found.floor_reported) == (floor_s, reported)
        assert found.found
        assert (found.given_up, found.flown_s) == ("no lift", 3.0)
        assert found.duration_s == 3.0


def test_who_is_disengaged_for_it_or_begins_to_search_was_warned() -> None:
    flight, _ = flight_of([2.0] * 300, [SOARING] * 300)
    for reason in (REASON_NOWHERE, REASON_NOT_FOUND):
        ended = f"disengaged: {REASON_TEXTS[reason]}"
        assert came_of(flight, ended).warned_s == 3.0
        assert came_of(flight, ended, seeks_s=1.25).warned_s == 1.25
    assert came_of(flight, "hit the board").warned_s == inf
    assert came_of(flight, "hit the board", seeks_s=1.25).warned_s == 1.25


def test_it_could_be_known_when_the_first_window_is_filled() -> None:
    assert e.KNOWN_S == HELD_S + 0.5
    over = e.KNOWN_S + 1.5
    row = e.LineFlown(
        found=True, warned_s=inf, low_s=over, floor_s=over, floor_reported=True, ended="",
        given_up="", flown_s=8.0,
    )  # fmt: skip
    assert not row.is_late
    assert not row.is_low_late
    assert row._replace(floor_s=over + 0.01).is_late
    assert row._replace(low_s=over + 0.01).is_low_late
    assert not row._replace(low_s=inf).is_low_late


# --- what flies it --------------------------------------------------------------------------------


class Flight:
    """A flight of ten looks, the first of which shows nothing; nowhere is foreseen from the fifth
    on."""

    made: list[Flight] = []  # noqa: RUF012 - of one test

    def __init__(self, there: SearchPlace, _airframe: Any, parameters: dict[str, float], **_: Any):
        self.place, self.parameters = there, parameters
        self.looks = 0
        self.sets: list[tuple[float, dict[str, float]]] = []
        self.guards = SimpleNamespace(landing_m=0.7)
        Flight.made.append(self)

    @property
    def flies(self) -> bool:
        return self.looks < 10

    @property
    def time_s(self) -> float:
        return 0.1 * self.looks

    @property
    def now(self) -> Any:
        return SimpleNamespace(forecast=TOO_LOW if self.looks >= 5 else SETTLES)

    def look(self) -> Any:
        self.looks += 1
        return None if self.looks == 1 else self.looks

    def set(self, parameters: dict[str, float]) -> None:
        self.sets.append((self.time_s, parameters))

    def ended(self, episode: Any) -> Any:
        return episode


class Search:
    """A search that receives every look, and gives up at the eighth."""

    made: list[Search] = []  # noqa: RUF012 - of one test

    def __init__(self, _polar: Any) -> None:
        self.received: list[int] = []
        self.asked: list[int] = []
        Search.made.append(self)

    def listen(self, look: int) -> None:
        self.received.append(look)

    def seek(self, look: int) -> Any:
        self.asked.append(look)
        given_up = "nothing there" if look == 8 else ""
        return SimpleNamespace(
            soaring=False, given_up=given_up, target=TargetLine(1.0, 2.0, radians(105.0))
        )


@pytest.mark.parametrize("act", [DISENGAGE, SEARCH_FIRST])
def test_a_search_receives_all_and_seeks_once_nowhere_is_foreseen(
    act: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    Flight.made, Search.made = [], []
    asked: list[tuple[Any, float]] = []
    monkeypatch.setattr(e, "EpisodeFlight", Flight)
    monkeypatch.setattr(e, "MapSearch", Search)
    monkeypatch.setattr(e, "line_place", lambda there, *_: there)
    monkeypatch.setattr(
        e, "flown_of", lambda _flight, episode, seeks_s: asked.append((episode, seeks_s))
    )
    e.fly_line(e.LineJob(kind="tunnel", seed=3001, settles=False, act=act, dispersed=True))
    (flight,) = Flight.made
    assert flight.parameters == {"FC_ACT": float(act)}
    assert flight.place.dispersed
    ((episode, seeks_s),) = asked
    assert (episode.landing_m, episode.place) == (0.7, flight.place)
    if act == DISENGAGE:
        assert Search.made == []
        assert (seeks_s, flight.looks, flight.sets) == (inf, 10, [])
        return
    (search,) = Search.made
    assert search.received == [2, 3, 4, 5, 6, 7, 8]
    assert search.asked == [5, 6, 7, 8]
    assert seeks_s == pytest.approx(0.5)
    assert episode.given_up == "nothing there"
    assert flight.looks == 8
    assert flight.sets[0][1] == {"SRCH_START": 1.0}
    assert [time_s for time_s, _ in flight.sets] == pytest.approx([0.5, 0.5, 0.6, 0.7])
    assert flight.sets[-1][1]["TGL_X"] == 1.0


def test_a_start_is_drawn_by_seed_kind_and_line(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn: list[float] = []

    def line_place(_there: Any, _polar: Any, _settles: bool, rng: Any) -> None:
        drawn.append(float(rng.random()))

    monkeypatch.setattr(e, "line_place", line_place)
    jobs = [
        e.LineJob(kind=kind, seed=seed, settles=settles, act=act)
        for kind in KINDS
        for seed in (3001, 3002)
        for settles in (False, True)
        for act in e.ACTS
    ]
    for job in jobs:
        assert not e.fly_line(job).found
    assert len(set(drawn)) == len(jobs) // 2  # both acts begin at the same place


# --- with a propeller -----------------------------------------------------------------------------


class Powered:
    """A flight of 40 s whose throttle was open at scripted times."""

    opened_s: tuple[float, float] = (0.0, 0.0)
    made: list[Powered] = []  # noqa: RUF012 - of one test

    def __init__(
        self, there: SearchPlace, _airframe: Any, parameters: dict[str, float], *, plain: bool
    ) -> None:
        self.place, self.parameters, self.plain = there, parameters, plain
        self.world = SimpleNamespace(step_hz=HZ)
        time = np.arange(0.0, 45.0, 1.0 / HZ)
        self.rows = np.zeros((len(time), len(Row._fields)))
        begin, end = self.opened_s
        open_ = (time >= begin) & (time < end)
        self.rows[:, Row._fields.index("throttle")] = 0.5 * open_
        self.used_s = 3.5
        Powered.made.append(self)


def powered(
    monkeypatch: pytest.MonkeyPatch,
    opened_s: tuple[float, float],
    called: str = t.WITH,
    flown_s: float = 40.0,
    *,
    soared: bool = True,
) -> tuple[t.PoweredFlown, Powered, Any]:
    made: list[Any] = []
    Powered.made, Powered.opened_s = [], opened_s
    score = SimpleNamespace(
        soared=soared, false_claim=True, ended="x", given_up="y", height_lost_m=1.5, flown_s=flown_s
    )

    def flown_by(flight: Any, name: str, who: Any) -> Any:
        made.append((flight, name, who))

    monkeypatch.setattr(t, "EpisodeFlight", Powered)
    monkeypatch.setattr(t, "flown_by", flown_by)
    monkeypatch.setattr(t, "score", lambda _episode: score)
    there = place("tunnel", 1001)
    assert there.duration_s == 40.0
    found = t.fly_at(there, called, plain=True)
    ((flight, name, who),) = made
    assert name == called
    return found, flight, who


@pytest.mark.parametrize(
    ("opened_s", "flown_s", "soared"),
    [
        ((0.0, 0.0), 40.0, True),
        ((0.0, 29.9), 40.0, True),
        ((0.0, 30.1), 40.0, False),  # a quarter of the 40 s has to be closed
        ((39.9, 40.0), 40.0, False),
        ((40.0, 45.0), 40.0, True),  # of a flight that was over
        ((0.0, 19.9), 30.0, True),
        ((0.0, 20.1), 30.0, False),
        ((0.0, 0.1), 5.0, False),  # shorter than the quarter
    ],
)
def test_soared_is_with_the_throttle_closed_in_the_last_quarter(
    opened_s: tuple[float, float], flown_s: float, soared: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, _, _ = powered(monkeypatch, opened_s, flown_s=flown_s)
    assert found.soared is soared
    assert found.oracle_like
    assert (found.false_claim, found.ended, found.given_up) == (True, "x", "y")
    assert (found.used_s, found.height_lost_m, found.flown_s) == (3.5, 1.5, flown_s)
    assert found.duration_s == flown_s


def test_who_does_not_soar_does_not_without_the_throttle_either(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, _, _ = powered(monkeypatch, (0.0, 0.0), soared=False)
    assert not found.soared
    assert not found.oracle_like


@pytest.mark.parametrize("called", t.FLOWN)
def test_one_of_three_has_a_budget_and_one_knows_the_field(
    called: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, flight, who = powered(monkeypatch, (0.0, 0.0), called)
    assert flight.parameters["THR_BUDGET"] == (25.0 if called == t.WITH else 0.0)
    assert flight.parameters["SRCH_START"] == 1.0
    assert flight.plain
    monkeypatch.setattr(t, "searcher", lambda name, *_: name)
    monkeypatch.setattr(t, "MapSearch", lambda _polar: "a map")
    assert who(cast("Any", None)) == ("oracle" if called == t.ORACLE else "a map")


GOOD = t.PoweredFlown(
    oracle_like=True, soared=True, false_claim=False, ended="", given_up="", used_s=1.0,
    height_lost_m=0.3, flown_s=40.0,
)  # fmt: skip


@pytest.mark.parametrize(("kind", "aim"), [("tunnel", 98), ("hill", 99)])
def test_so_many_of_a_hundred_that_the_oracle_soars_are_asked_for(kind: Kind, aim: int) -> None:
    for soared, holds in ((aim, True), (aim - 1, False)):
        flown = {}
        for seed in range(100):
            flown[t.PoweredJob(kind, seed, t.ORACLE)] = GOOD
            flown[t.PoweredJob(kind, seed, t.WITHOUT)] = GOOD
            flown[t.PoweredJob(kind, seed, t.WITH)] = GOOD._replace(soared=seed < soared)
        claim = t._claim(kind, flown)
        assert claim.holds is holds
        assert claim.text == (
            f"{kind}: with 25 s of throttle soars ≥ {aim} % of what the oracle soars"
        )


def test_the_table_counts_every_flight_but_what_is_soared_of_the_oracles() -> None:
    ours = [
        GOOD, GOOD._replace(soared=False, used_s=3.0), GOOD._replace(false_claim=True, used_s=9.0),
        GOOD._replace(oracle_like=False, soared=False, given_up="x", ended="y", used_s=5.0),
    ]  # fmt: skip
    flown = {}
    for seed, each in enumerate(ours):
        flown[t.PoweredJob("hill", seed, t.ORACLE)] = GOOD._replace(soared=seed < 3)
        flown[t.PoweredJob("hill", seed, t.WITHOUT)] = GOOD
        flown[t.PoweredJob("hill", seed, t.WITH)] = each
    table = t._table("hill", flown)
    assert table.title == "hill: 3 of 4 places are soared by the oracle"
    without, with_it = table.rows
    assert (without[0], with_it[0]) == (t.WITHOUT, t.WITH)
    assert with_it[1].startswith("2 of 3")
    assert with_it[2] == "1"  # held by the throttle alone
    assert with_it[3].startswith("1 of 4")
    assert with_it[4:6] == ("1", "1")
    assert with_it[6] == "4.0, 7.8"  # of 1, 3, 5 and 9 s


def test_warnings_are_timed_from_the_release_on() -> None:
    flown = [
        e.LineFlown(
            found=True,
            warned_s=HELD_S + s,
            low_s=inf,
            floor_s=inf,
            floor_reported=False,
            ended="",
            given_up="",
            flown_s=9.0,
        )
        for s in (1.0, 2.0, 3.0, inf)
    ]
    late = flown[3]._replace(low_s=9.0, floor_s=9.0, floor_reported=True)
    rows = e._without(lambda *_: [*flown, late]).rows
    assert len(rows) == 4
    assert rows[0] == ("tunnel", "2", "5", "3", "2.0, 2.8", "1", "1", "1")
    assert [row[:2] for row in rows] == [
        ("tunnel", "2"), ("tunnel", "4"), ("hill", "2"), ("hill", "4"),
    ]  # fmt: skip
    having = e._having(lambda *_: [*flown, late]).rows
    assert having[0][2].startswith("3 of 5")
    assert having[0][3] == "1"
    assert not isfinite(late.warned_s)
    assert e._without(lambda *_: [late]).rows[0][4] == "–"


def test_fewer_than_one_in_a_hundred_may_be_warned_wrongly() -> None:
    good = e.LineFlown(
        found=True, warned_s=inf, low_s=inf, floor_s=inf, floor_reported=False, ended="",
        given_up="", flown_s=9.0,
    )  # fmt: skip
    warned = good._replace(warned_s=1.0)
    for many, holds in ((50, True), (49, False)):  # of each kind of place: 2 of 200, and of 198
        having = [warned, *[good] * (2 * many)]

        def of(_kind: Kind, _act: int, settles: bool, h: Any = having) -> list[e.LineFlown]:
            return list(h) if settles else [good]

        claims = e._claims(of)
        assert [claim.holds for claim in claims[1::2]] == [holds] * 2
    assert eta_from_lean(0.0) == pytest.approx(radians(90.0))


@pytest.mark.parametrize(("quick", "episodes", "count"), [(True, 9, 4), (False, 3, 3)])
def test_both_kinds_of_lines_are_flown_compiled_with_both_answers(
    quick: bool, episodes: int, count: int
) -> None:
    asked: list[e.LineJob] = []
    nobody = e.LineFlown(
        found=True, warned_s=inf, low_s=inf, floor_s=inf, floor_reported=False, ended="",
        given_up="", flown_s=8.0,
    )  # fmt: skip

    class NotedFlyer(Flyer):
        def each(self, fly: Any, jobs: Any, *, compiled: bool = False) -> Any:
            assert fly is e.fly_line
            assert compiled  # else each would compile for itself, or fly for hours
            asked.extend(jobs)
            return [nobody._replace(found=job.seed != 3002) for job in asked]

    result = e.run(Context(NotedFlyer(), quick=quick, episodes=episodes))
    assert asked == [
        e.LineJob(kind=kind, seed=seed, settles=settles, act=act)
        for kind in KINDS
        for act in (2, 4)
        for settles in (False, True)
        for seed in range(3001, 3001 + count)
    ]
    assert result.seeds == (3001, 3000 + count)
    assert len(result.numbers) == 8 * count
    assert result.numbers["hill 3001 True 4"] == nobody._asdict()
    # Where no start was drawn none was flown: it does not count.
    assert {row[2] for row in result.tables[0].rows} == {str(count - 1)}
    assert {row[2] for row in result.tables[1].rows} == {f"0 of {count - 1} ({words(count - 1)})"}


def words(of: int) -> str:
    """None of so many, by Clopper and Pearson: 1 - 0.025^(1/n)."""
    return f"0–{100.0 * (1.0 - 0.025 ** (1.0 / of)):.0f} %"
