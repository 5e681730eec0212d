"""What `dispersed`, `airframes` and `identification` ask for: the drawn aircraft and their places,
the search for gains, and the figures of one flight."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tgl_soar.analysis.experiments.aircraft import airframes as a
from tgl_soar.analysis.experiments.aircraft import dispersed as d
from tgl_soar.analysis.experiments.aircraft import identification as e
from tgl_soar.analysis.experiments.aircraft.dispersed import DispersedCase, DispersedScore
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.tuning.aircraft import Ranges, ranges_of_one
from tgl_soar.config.files import load_airframe
from tgl_soar.control.found_gains import INERTIAL, PLAIN
from tgl_soar.sim.aircraft import glide_polar
from tgl_soar.sim.campaign.executors import InLine
from tgl_soar.types import GlidePolar


class Keeps(Flyer):
    """Flies nothing: margins that are all the same, and keeps every list."""

    def __init__(self) -> None:
        super().__init__()
        self.lists: list[list[Any]] = []

    def each(self, fly: Any, jobs: Any, *, compiled: bool = False) -> Any:
        self.lists.append(list(jobs))
        if fly is d.margin_of:
            assert not compiled
            return [d.LinearMargin(0.5) for _ in self.lists[-1]]
        assert compiled
        raise StopIteration


@pytest.mark.parametrize(("quick", "looked_at", "each"), [(False, 1000, 100), (True, 6, 2)])
def test_aircraft_are_drawn_for_places_by_their_own_best_glide(
    quick: bool, looked_at: int, each: int
) -> None:
    flyer = Keeps()
    context = Context(flyer, quick=quick)
    with pytest.raises(StopIteration):
        d.dispersed(context)
    scenario = context.scenario("dispersed")
    places = list(scenario.lines)
    first, second, flown = flyer.lists
    assert [job.kind for job in (first[0], second[0])] == [PLAIN, INERTIAL]
    for jobs in (first, second):
        assert [job.seed for job in jobs] == [(2026, 1, i) for i in range(looked_at)]
        for i, job in enumerate(jobs[:6]):
            line = scenario.lines[places[i % len(places)]]
            assert job.field.speed_ratio == line.speed_ratio
            assert job.field.unknown_late_s == 0.0
    field = first[0].field
    assert field.seeks
    assert field.roughest == 0.05  # whatever is flown, a place must be one to soar at then
    assert field.ranges == Ranges()
    assert field.duration_s == scenario.duration_s
    assert str(field.site_path) == scenario.site
    conditions = [(0.03, 0.0), (0.05, 0.0), (0.03, 0.030)][: 1 if quick else 3]
    wanted = [
        (kind, turbulence, later_s, scenario.lines[place].speed_ratio, (2026, i))
        for kind in (INERTIAL, PLAIN)
        for turbulence, later_s in conditions
        for place in places
        for i in range(each)
    ]
    assert [
        (
            job.attempt.kind,
            job.attempt.turbulence,
            job.field.unknown_late_s,
            job.field.speed_ratio,
            job.attempt.seed,
        )
        for job in flown
    ] == wanted


SCORE = DispersedScore(
    flights=100, up=99, rms_e_rho_m=0.0123, rms_y_m=0.456, rms_bank_rad=0.1,
    causes=(("hit the board", 1),),
)  # fmt: skip


@pytest.mark.parametrize(
    ("turbulence", "later_s", "least"), [(0.03, 0.0, 99), (0.05, 0.0, 90), (0.03, 0.030, 99)]
)
def test_so_many_of_a_hundred_must_last_at_each_place(
    turbulence: float, later_s: float, least: int
) -> None:
    for up, holds in ((least, True), (least - 1, False)):
        scores = {
            DispersedCase(INERTIAL, turbulence, later_s, place): SCORE._replace(up=count)
            for place, count in (("a", 100), ("b", up))
        }
        (claim,) = d._claims(scores)
        assert claim.holds is holds
        assert f"{least} % or more last" in claim.text
        assert ("30 ms later than known" in claim.text) == bool(later_s)
        assert claim.measured == f"100 of 100 at a, {up} of 100 at b"


def test_no_drawn_aircraft_may_be_unstable_and_the_worst_in_a_hundred_is_reported() -> None:
    alphas = [0.3 + 0.001 * i for i in range(200)]
    claim = d._unstable(PLAIN, alphas[::-1])
    assert claim.holds
    assert claim.measured == "0 of 200; disk margin of the worst in a hundred 0.30"
    assert not d._unstable(PLAIN, [0.0, *alphas]).holds
    assert d._unstable(PLAIN, [0.0, 0.1, 0.2, *alphas]).measured.startswith("1 of 203")
    assert d._unstable(PLAIN, [0.0, 0.1, 0.2, *alphas]).measured.endswith("0.20")


def test_a_row_of_drawn_aircraft_is_in_the_units_of_its_head() -> None:
    row = d._row(DispersedCase(INERTIAL, 0.03, 0.030, "a"), SCORE)
    assert row == (
        INERTIAL, "3 %", "30", "a", "99 of 100", "95 to 100 %", "1.23", "46", "5.7",
        "hit the board 1",
    )  # fmt: skip
    assert d._row(DispersedCase(PLAIN, 0.05, 0.0, "b"), SCORE._replace(causes=()))[-1] == "–"


# --- airframes ------------------------------------------------------------------------------------


def test_gains_are_sought_for_this_one_aircraft_over_the_hill(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[Any] = []

    def tune(task: Any, progress: Any, _tell: Any, executor: Any) -> Any:
        assert isinstance(executor, InLine)  # it is one of many already
        asked.append((task, progress))
        return SimpleNamespace(parameters={"RHO_P": 1.25})

    monkeypatch.setattr(a, "tune", tune)
    text = a.USUAL.read_text(encoding="utf-8")
    written, _ = a.tuned_for(text, "own.toml", a.QUICK_EFFORT, tmp_path)
    ((task, _),) = asked
    assert task.airframe == load_airframe(a.USUAL)
    assert task.site_path == a.HILL
    assert task.lean_deg == 15.0
    assert task.effort == a.QUICK_EFFORT
    assert task.ranges == ranges_of_one(task.airframe, task.values["CMD_DELAY"])
    (tmp_path / "written.toml").write_text(written, encoding="utf-8")
    assert load_airframe(tmp_path / "written.toml").parameters["RHO_P"] == 1.25


@pytest.mark.parametrize(("quick", "count"), [(False, 20), (True, 2)])
def test_so_many_airframes_are_drawn(quick: bool, count: int) -> None:
    flyer = Keeps()
    with pytest.raises(StopIteration):
        a.airframes(Context(flyer, quick=quick))
    (jobs,) = flyer.lists
    assert [job.seed for job in jobs] == [(2026, i) for i in range(count)]
    assert {job.effort for job in jobs} == {a.QUICK_EFFORT if quick else a.EFFORT}


# --- identification -------------------------------------------------------------------------------


@pytest.mark.parametrize("dispersed", [False, True])
def test_one_flight_is_drawn_as_it_was_flown(
    dispersed: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    asked: list[Any] = []
    drawn: list[tuple[Any, ...]] = []
    fit = SimpleNamespace(
        polar=GlidePolar(c0=1.0, c1=0.0, c2=0.0, c3=0.0, speed_min_mps=8.0, speed_max_mps=11.0)
    )

    def fitted(job: Any) -> Any:
        asked.append(job)
        return fit, ([8.0], [0.6]), "columns", 116.0

    monkeypatch.setattr(e, "fitted", fitted)
    monkeypatch.setattr(e, "identify", lambda columns, body: (columns, body))
    monkeypatch.setattr(e, "identification_figure", lambda *what: drawn.append(what))
    monkeypatch.setattr(e, "polar_figure", lambda *what: drawn.append(what))
    context = Context(Flyer(), figures=tmp_path, dispersion=dispersed)
    names = e._draw(context, e.GlideJob(1))
    assert names == ("identification.png", "identified_polar.png")
    assert asked == [e.GlideJob(1, dispersed)]
    (path, found, _), (polar_path, polar, _, whole, speeds, sinks, true) = drawn
    assert (path, polar_path) == (tmp_path / names[0], tmp_path / names[1])
    assert found == ("columns", e.truth()[1])  # of what is known beforehand
    assert cast("Any", (polar, whole, speeds, sinks)) == (fit.polar, fit, [8.0], [0.6])
    own = glide_polar(e.flies(e.GlideJob(1, dispersed)).model)
    assert true == own
    file = glide_polar(e.truth()[0])
    assert (true == file) is not dispersed
