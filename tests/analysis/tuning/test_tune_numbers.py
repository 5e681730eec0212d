"""The way from an airframe file to gains, with margins and flights that are made up: what is asked
in which order, which are chosen, how many are judged, and what is counted of them."""

from __future__ import annotations

from math import sqrt
from pathlib import Path
from typing import Any

import pytest

from tgl_soar.analysis.tuning import flights
from tgl_soar.analysis.tuning import tune as module
from tgl_soar.analysis.tuning.aircraft import Ranges
from tgl_soar.analysis.tuning.demands import FOR_CHOICE, FOR_JUDGING, Given
from tgl_soar.analysis.tuning.flights import DrawnFlight, FlyingPlace
from tgl_soar.analysis.tuning.progress_file import ProgressFile
from tgl_soar.analysis.tuning.search import Candidate
from tgl_soar.analysis.tuning.tune import (
    QUICK,
    Effort,
    Task,
    TuningFlight,
    manifest,
    search_of,
    tune,
)
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.config.parameters import ANCHORS, INDEX, PARAMETERS
from tgl_soar.control.found_gains import INERTIAL, PLAIN, SETS, SHIPPED, SOUGHT, gains_of
from tgl_soar.sim.campaign.executors import InLine

AIRFRAME_PATH, SITE_PATH = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
AIRFRAME, SITE = load_airframe(AIRFRAME_PATH), load_site(SITE_PATH)
VALUES = load_parameters(AIRFRAME, AIRFRAME_PATH, SITE, SITE_PATH)
TASK = Task(airframe=AIRFRAME, site_path=SITE_PATH, values=VALUES, lean_deg=15.0)


class Pool:
    """Evaluates nothing: it returns scripted values, and keeps what it was asked."""

    def __init__(self, give: Any) -> None:
        self.give = give
        self.asked: list[tuple[Any, Any]] = []

    def prepare(self, kind: str) -> None:
        assert kind in SETS

    def map(self, function: Any, jobs: Any) -> list[Any]:
        self.asked += [(function, job) for job in jobs]
        return [self.give(job) for job in jobs]


class Work:
    """What every flight of a task shares, with a pool that is made up."""

    def __init__(self, folder: Path, give: Any, **effort: Any) -> None:
        self.pool = Pool(give)
        self.reported: list[tuple[str, float]] = []
        self.task = TASK._replace(effort=Effort(**effort), seed=7)
        self.progress = ProgressFile(folder / "progress", "task")
        self.field = FlyingPlace(airframe=AIRFRAME, site_path=SITE_PATH, ranges=Ranges())
        self.parts: Any = module._AtWork(
            task=self.task,
            field=self.field,
            pool=self.pool,  # type: ignore[arg-type]
            progress=self.progress,
            report=lambda words, done: self.reported.append((words, done)),
            flights=[],
        )


def test_unless_it_is_to_be_quick_it_takes_hours() -> None:
    assert Effort() == (40, 6, 3, 8, 16, 60, 30.0)
    assert Effort._fields == (
        "generations", "aircraft", "grid", "choosing", "judging", "judging_linear", "flight_s",
    )  # fmt: skip
    assert QUICK == (2, 1, 1, 0, 0, 2, 10.0)
    assert (TASK.seed, TASK.effort, TASK.floor) == (1, Effort(), 0.5)
    assert TASK.ranges == Ranges()
    assert module.TURBULENCES == (0.03, 0.05)
    assert module.CHUNK == 8


def test_gains_are_sought_between_a_thousandth_and_what_their_parameters_allow() -> None:
    task = TASK._replace(effort=QUICK, seed=9, floor=0.6)
    for kind in SETS:
        search = search_of(task, VALUES, kind)
        assert search.start == tuple(gains_of(VALUES, kind))
        assert (search.generations, search.seed, search.floor) == (2, 9, 0.6)
        for name, low, high in zip(SOUGHT[kind], search.low, search.high, strict=True):
            parameter = PARAMETERS[INDEX[name]]
            assert low == max(1e-3, parameter.minimum)
            assert high == parameter.maximum
            assert low > 0.0  # its logarithm is sought


def test_all_that_the_search_changes_and_what_it_is_anchored_to_are_written() -> None:
    written = module._written(VALUES)
    assert set(written) == {*ANCHORS, *SHIPPED}
    assert all(written[name] == VALUES[name] for name in written)
    assert list(written) == [p.name for p in PARAMETERS if p.name in written]


def test_a_manifest_names_all_that_gains_depend_on() -> None:
    found = manifest(TASK._replace(seed=5, effort=QUICK))
    assert (found.name, found.flights, found.seeds) == ("tune", 1, [5, 5])
    assert set(found.parameters) == {
        "airframe", "site", "air", "autopilot", "lean_deg", "seed", "floor", "effort", "ranges",
        "cma",
    }  # fmt: skip
    assert found.parameters["effort"] == QUICK._asdict()
    assert found.parameters["lean_deg"] == 15.0
    assert not found.complete


def test_a_result_says_who_found_it_and_when(tmp_path: Path) -> None:
    progress = ProgressFile(tmp_path / "p", "task")
    progress.begin("one process")
    progress.begin("two processes")
    found = module.concluded(TASK, progress)
    assert found.complete
    assert [run["by"] for run in found.runs] == ["one process", "two processes"]
    assert ["ended" in run for run in found.runs] == [False, True]
    assert "begun" in found.runs[0]


# --- flights --------------------------------------------------------------------------------------


def flight(up: bool = True, rms_m: float = 0.01) -> DrawnFlight:
    return DrawnFlight(up=up, rms_e_rho_m=rms_m, duration_s=1.0, ended="")


AFTER = TuningFlight(gains="after", kind=PLAIN, turbulence=0.03, aircraft=0, judges=True)


def test_aircraft_are_flown_in_batches_each_by_a_seed_of_its_own(tmp_path: Path) -> None:
    work = Work(tmp_path, lambda job: flight(job[1].seed[-1] != 3, 0.1))
    found = module._flown(work.parts, VALUES, AFTER, 10, "judging")
    assert (found.up, found.of) == (9, 10)
    assert found.rms_e_rho_m == pytest.approx(0.1)
    attempts = [flights.Attempt(VALUES, PLAIN, (7, FOR_JUDGING, i), 0.03) for i in range(10)]
    assert work.pool.asked == [(module._flight_of, (work.field, each)) for each in attempts]
    assert work.reported == [("judging", 0.0), ("judging", 0.8)]
    assert [flies for flies, _ in work.parts.flights] == [
        AFTER._replace(aircraft=i) for i in range(10)
    ]
    assert [flown.up for _, flown in work.parts.flights] == [i != 3 for i in range(10)]


def test_a_batch_that_was_flown_is_not_flown_again(tmp_path: Path) -> None:
    first = Work(tmp_path, lambda _: flight())
    module._flown(first.parts, VALUES, AFTER, 8, "judging")
    second = Work(tmp_path, lambda _: flight(up=False))
    found = module._flown(second.parts, VALUES, AFTER, 12, "judging")
    assert [job.seed[-1] for _, (_, job) in second.pool.asked] == [8, 9, 10, 11]
    assert (found.up, found.of) == (8, 12)


def test_before_and_after_are_judged_on_the_same_aircraft(tmp_path: Path) -> None:
    after = VALUES.changed({"RHO_P": 0.9})
    work = Work(tmp_path, lambda job: flight(job[1].values is after), judging=3)
    row = module._judged_in_flight(work.parts, (VALUES, after), INERTIAL, 0.05)
    assert (row.kind, row.turbulence) == (INERTIAL, 0.05)
    assert (row.before.up, row.before.of) == (0, 3)
    assert (row.after.up, row.after.of) == (3, 3)
    attempts = [job for _, (_, job) in work.pool.asked]
    assert [each.seed for each in attempts] == [(7, FOR_JUDGING, i) for i in range(3)] * 2
    assert {each.turbulence for each in attempts} == {0.05}
    assert {each.kind for each in attempts} == {INERTIAL}
    assert [words for words, _ in work.reported] == [
        f"{INERTIAL}: judging before at 5 %", f"{INERTIAL}: judging after at 5 %",
    ]  # fmt: skip
    assert [flies for flies, _ in work.parts.flights] == [
        TuningFlight(gains=gains, kind=INERTIAL, turbulence=0.05, aircraft=i, judges=True)
        for gains in ("before", "after")
        for i in range(3)
    ]


# --- which is chosen ------------------------------------------------------------------------------


def candidate(alpha: float, e_rho_m: float) -> Candidate:
    gains = tuple(gain * (1.0 + alpha) for gain in gains_of(VALUES, PLAIN))
    return Candidate(gains, Given(alpha=alpha, e_rho_m=e_rho_m, elevator=0.1, worst="here"))


# One for each of the three reserves: the best, and those with a tenth and two tenths more.
THREE = [candidate(0.56, 0.010), candidate(0.66, 0.011), candidate(0.76, 0.013)]


def chosen(folder: Path, outcome: Any, **effort: Any) -> tuple[Candidate, Work]:
    """outcome: what becomes of a flight, by the finalist's number and the attempt."""
    numbers = {tuple(round(g, 4) for g in each.gains): n for n, each in enumerate(THREE)}

    def give(job: Any) -> DrawnFlight:
        gains = tuple(round(gain, 4) for gain in gains_of(job[1].values, PLAIN))
        found: DrawnFlight = outcome(numbers[gains], job[1])
        return found

    work = Work(folder, give, **{"choosing": 2, **effort})
    return module._chosen(work.parts, VALUES, PLAIN, THREE), work


def test_the_finalist_that_loses_the_fewest_is_chosen(tmp_path: Path) -> None:
    """In either turbulence, however well the others keep the line."""
    found, work = chosen(
        tmp_path,
        lambda n, at: flight(not (n == 0 and at.turbulence == 0.03) and n != 2, 0.01 + 0.01 * n),
    )
    assert found is THREE[1]
    attempts = [job for _, (_, job) in work.pool.asked]
    assert [each.seed for each in attempts] == [(7, FOR_CHOICE, i) for i in range(2)] * 6
    assert [each.turbulence for each in attempts] == [0.03, 0.03, 0.05, 0.05] * 3
    words = [
        f"{PLAIN}: finalist {n} of 3 at {turbulence} %" for n in (1, 2, 3) for turbulence in (3, 5)
    ]
    assert [each for each, _ in work.reported] == words


def test_of_those_who_lose_as_few_the_nearest_to_the_line_is_chosen(tmp_path: Path) -> None:
    """By the mean square over both turbulences: 5 and 5 is less than 1 and 8, and than 8 and 1."""
    rms = {0: {0.03: 0.01, 0.05: 0.08}, 1: {0.03: 0.05, 0.05: 0.05}, 2: {0.03: 0.08, 0.05: 0.01}}
    found, _ = chosen(tmp_path, lambda n, at: flight(rms_m=rms[n][at.turbulence]))
    assert found is THREE[1]
    assert sqrt(2.0) * 0.05 < 0.08  # by the sum it would be another


def test_squares_count_and_no_higher_power(tmp_path: Path) -> None:
    """5 and 5 cm is more than 1 and 6.9, by whose cubes it would be less."""
    rms = {0: {0.03: 0.05, 0.05: 0.05}, 1: {0.03: 0.01, 0.05: 0.069}, 2: {0.03: 0.09, 0.05: 0.09}}
    found, _ = chosen(tmp_path, lambda n, at: flight(rms_m=rms[n][at.turbulence]))
    assert found is THREE[1]


def test_of_equals_the_first_is_chosen(tmp_path: Path) -> None:
    assert chosen(tmp_path, lambda _n, _at: flight())[0] is THREE[0]


def test_where_none_are_flown_or_there_is_one_alone_the_best_is_taken(tmp_path: Path) -> None:
    found, work = chosen(tmp_path, lambda _n, _at: pytest.fail("flown"), choosing=0)
    assert found is THREE[0]
    assert work.reported == []
    work = Work(tmp_path, lambda _: pytest.fail("flown"), choosing=2)
    assert module._chosen(work.parts, VALUES, PLAIN, THREE[2:]) is THREE[2]
    assert work.reported == []


# --- on the linear model --------------------------------------------------------------------------


def test_of_those_judged_it_counts_who_is_unstable_and_who_is_below_the_floor(
    tmp_path: Path,
) -> None:
    """The floor is 0.5: with it, and 0 for unstable."""
    alphas = [0.9, 0.5, 0.499, 0.2, 0.0, 0.001]
    work = Work(tmp_path, lambda job: alphas[job[2][-1]], judging_linear=6)
    found = module._judged(work.parts, VALUES, INERTIAL)
    assert found == (6, 1, 4, 0.0)
    assert work.pool.asked == [
        (module._alpha_of, (INERTIAL, VALUES, (7, FOR_JUDGING, i))) for i in range(6)
    ]
    assert work.reported == [(f"{INERTIAL}: margins of 6 more aircraft", 0.0)]


def test_other_gains_are_judged_again_and_the_same_are_not(tmp_path: Path) -> None:
    work = Work(tmp_path, lambda _: 0.7, judging_linear=2)
    for values in (VALUES, VALUES, VALUES.changed({"ELE_D": VALUES["ELE_D"] * 1.01})):
        module._judged(work.parts, values, PLAIN)
    assert len(work.pool.asked) == 4
    module._judged(work.parts, VALUES.changed({"ELE_FREQ": VALUES["ELE_FREQ"] + 1.0}), PLAIN)
    assert len(work.pool.asked) == 6  # anchored to something else


def test_what_is_flown_now_is_asked_once(tmp_path: Path) -> None:
    given = Given(alpha=0.6, e_rho_m=0.02, elevator=0.1, worst="here")
    work = Work(tmp_path, lambda _: given)
    for _ in range(2):
        assert module._before(work.parts, PLAIN) == given
    assert work.pool.asked == [(module._given_of, (PLAIN, VALUES))]


# --- all of it ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("choosing", "judging", "asked"),
    [
        (0, 0, []),
        (1, 0, [(4, FOR_CHOICE, 0)]),
        (0, 1, [(4, FOR_JUDGING, 0)]),
        (2, 2, [(4, FOR_CHOICE, 0), (4, FOR_JUDGING, 0)]),
    ],
)
def test_whether_any_aircraft_can_fly_there_is_asked_before_the_search(
    monkeypatch: pytest.MonkeyPatch, choosing: int, judging: int, asked: list[Any]
) -> None:
    tried: list[Any] = []
    monkeypatch.setattr(
        flights, "soaring_aircraft", lambda _field, _start, seed: tried.append(seed)
    )
    task = TASK._replace(seed=4, effort=Effort(choosing=choosing, judging=judging))
    field = FlyingPlace(airframe=AIRFRAME, site_path=SITE_PATH, ranges=Ranges())
    module._check_air(task, field, VALUES)
    assert tried == asked


def test_a_set_is_sought_from_where_it_is_and_each_generation_is_reported(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    pytest.importorskip("cma", reason="tuning needs cma")
    monkeypatch.setattr(module, "_places_of", lambda _kind: None)
    given = Given(alpha=0.625, e_rho_m=0.0234, elevator=0.1, worst="here")
    work = Work(tmp_path, lambda _: given, generations=2)
    found = module._candidates(
        work.task, VALUES, PLAIN, work.parts.pool, work.progress, work.parts.report
    )
    words = f"{PLAIN}: margin 0.62, e_rho 2.34 cm"
    assert work.reported == [(words, 0.0), (words, 0.5), (words, 1.0)]
    assert found[0].gains == pytest.approx(tuple(gains_of(VALUES, PLAIN)))
    assert [function for function, _ in work.pool.asked] == [module._given_of] * len(found)
    for one, (_, (kind, values)) in zip(found, work.pool.asked, strict=True):
        assert kind == PLAIN
        assert gains_of(values, PLAIN) == pytest.approx(one.gains, rel=1e-6)


def test_an_evaluator_is_given_the_demands_and_flies_a_list_in_its_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What the first of each kind compiles and loads is there for all: it is evaluated here."""
    first: list[bool] = []

    def fly_all(function: Any, jobs: Any, _executor: Any, *, first_here: bool) -> Any:
        first.append(first_here)
        return [function(job) for job in jobs]

    monkeypatch.setattr(module, "fly_all", fly_all)
    monkeypatch.setattr(module, "places_of", lambda demands, kind: (demands, kind))
    one: Any = "one"
    two: Any = "two"

    def size(demands: Any, job: int) -> int:
        assert demands == "one"
        return abs(job)

    def length(_demands: Any, job: str) -> int:
        return len(job)

    pool = module._Pool(InLine(), one)
    assert pool.map(size, [-3, 2]) == [3, 2]
    assert pool.map(size, [-4]) == [4]
    assert pool.map(length, ["a"]) == [1]
    assert first == [True, False, True]
    pool.prepare(PLAIN)
    places: Any = module._places_of(one, PLAIN)
    assert places == ("one", PLAIN)
    assert module._places_of(one, PLAIN) is places
    places = module._places_of(two, PLAIN)  # another task: other places
    assert places == ("two", PLAIN)
    module._places.clear()


def test_the_whole_way_changes_both_sets_and_judges_before_and_after(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """With margins that are made up, and one flight each; gains go from set to set."""
    pytest.importorskip("cma", reason="tuning needs cma")
    asked: list[Any] = []

    def given_by(places: Any, values: Any) -> Given:
        """The more of the first gain, the better: up to 1.2 of what is flown."""
        kind = places
        ratio = values[SOUGHT[kind][0]] / VALUES[SOUGHT[kind][0]]
        return Given(alpha=0.9, e_rho_m=0.01 + abs(ratio - 1.2), elevator=0.0, worst=f"{ratio:.3f}")

    def places_of(demands: Any, kind: str) -> Any:
        asked.append(demands)
        return kind

    monkeypatch.setattr(module, "places_of", places_of)
    monkeypatch.setattr(module, "given_by", given_by)
    monkeypatch.setattr(module, "drawn_place", lambda _demands, kind, seed: (kind, seed))
    monkeypatch.setattr(module, "place_margin", lambda _place, values: 0.2 * values["RHO_P"])
    monkeypatch.setattr(flights, "fly_attempt", lambda _field, _attempt: flight())
    monkeypatch.setattr(flights, "soaring_aircraft", lambda *_: None)
    effort = Effort(
        generations=3, aircraft=5, grid=2, choosing=0, judging=1, judging_linear=2, flight_s=4.0
    )
    task = TASK._replace(effort=effort, seed=3)
    found = tune(task, ProgressFile(tmp_path / "p", "task"), lambda *_: None, InLine())
    module._places.clear()
    demands = asked[0]
    assert (demands.aircraft, demands.seed, demands.grid) == (5, 3, 2)
    assert demands.ranges == task.ranges
    for kind in SETS:
        name = SOUGHT[kind][0]
        assert found.after[kind].e_rho_m < found.before[kind].e_rho_m
        assert found.values[name] == found.parameters[name] > VALUES[name]
        assert found.before[kind].worst == "1.000"
        assert len(found.candidates[kind]) > 3
    assert found.judged_before[PLAIN].least_alpha == pytest.approx(0.2 * VALUES["RHO_P"])
    assert found.judged[PLAIN].least_alpha == pytest.approx(0.2 * found.values["RHO_P"])
    assert [(row.kind, row.turbulence) for row in found.flown] == [
        (kind, turbulence) for kind in SETS for turbulence in (0.03, 0.05)
    ]
    assert all(row.after.of == row.before.of == 1 for row in found.flown)
    none = effort._replace(judging=0)
    other = ProgressFile(tmp_path / "q", "t")
    again = tune(task._replace(effort=none), other, lambda *_: None, InLine())
    module._places.clear()
    assert again.flown == []
