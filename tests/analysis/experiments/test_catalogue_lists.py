"""Which experiments there are, what can fly each, on which page it stands, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tgl_soar.analysis.experiments import catalogue
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.pages import ONCE, OWN_PAGES
from tgl_soar.analysis.experiments.result import Claim, Result
from tgl_soar.config.files import ConfigError

DOCS = Path(__file__).parents[3] / "docs"
# In the order in which the paper tells them.
PAPER = (
    *("field", "places", "static", "translate", "back", "rotate"),
    *("slope", "wind", "gust", "lean", "speed"),
)
# On the page of aims; the others of ours have pages of their own.
AIMS = (
    *("identification", "estimator", "wind_estimate", "wind_use", "command_delay"),
    *("incidence", "lift_map", "forecast"),
)
OWN = (
    *("dispersed", "unseen", "leans", "airframes", "margins", "latency", "search", "throttle"),
    *("survey", "nowhere", "point", "outdoors", "satellites", "rangefinder", "hour", "beating"),
)
RESULT = Result(
    name="x", title="", flown="", claims=(Claim("it does", True, ""),), why="", tables=(),
    numbers={},
)  # fmt: skip


def test_every_experiment_stands_on_one_page() -> None:
    assert catalogue.TOGETHER["paper"] == PAPER
    assert catalogue.TOGETHER["aims"] == AIMS
    assert set(catalogue.APART) == set(OWN) == set(OWN_PAGES) - {"places --field SITE"}
    assert set(catalogue.EXPERIMENTS) == {*PAPER, *AIMS, *OWN}
    assert set(catalogue.TOGETHER["all"]) == {*PAPER, *AIMS}
    assert list(catalogue.TOGETHER) == ["all", "paper", "aims"]
    order = list(catalogue.EXPERIMENTS)
    assert list(catalogue.TOGETHER["all"]) == [name for name in order if name not in OWN]
    assert {*AIMS, *OWN} == catalogue.OURS


@pytest.mark.parametrize("name", OWN)
def test_a_page_of_its_own_has_the_marks_of_its_experiments(name: str) -> None:
    text = (DOCS / OWN_PAGES[name]).read_text(encoding="utf-8")
    assert f"<!-- {name}: begin; written by" in text
    assert f"<!-- {name}: end -->" in text


def test_what_was_published_once_is_of_the_paper_and_of_four_aims() -> None:
    assert set(ONCE) == {
        *(set(PAPER) - {"places"}), *("identification", "estimator", "wind_estimate", "wind_use")
    }  # fmt: skip
    held = {name: words.rpartition(": ")[2].split(" of ") for name, words in ONCE.items()}
    for name, (some, of) in held.items():
        verdict = ONCE[name].partition(":")[0]
        assert verdict.endswith("in part") == (int(some) < int(of)), name
        assert verdict.startswith("met") == (name in catalogue.OURS), name


@pytest.mark.parametrize("name", [*AIMS, *OWN])
def test_no_aim_of_ours_flies_the_point_mass(name: str) -> None:
    with pytest.raises(ConfigError, match=f"^{name}: flies the rigid body alone; leave --model"):
        catalogue.run(name, Context(Flyer(), model="point_mass"))


def test_who_is_not_dispersed_and_who_is() -> None:
    """Six fly nothing, or draw by themselves."""
    nothing = {"field", "margins", "dispersed", "airframes", "lift_map", "forecast"}
    assert set(catalogue.NOT_DISPERSED) == nothing
    assert set(catalogue.DISPERSED) == set(catalogue.EXPERIMENTS) - nothing
    assert catalogue.NOT_FLOWN == ("field",)


def given(monkeypatch: pytest.MonkeyPatch, name: str) -> list[Context]:
    """An experiment that answers at once, and the contexts that it was given."""
    asked: list[Context] = []

    def answers(context: Context) -> Result:
        asked.append(context)
        return RESULT

    monkeypatch.setitem(catalogue.EXPERIMENTS, name, answers)
    return asked


def test_a_result_is_of_ours_or_of_the_paper_and_knows_how_long_it_took(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock = iter((100.0, 103.5, 200.0, 201.0))
    monkeypatch.setattr(catalogue, "time", SimpleNamespace(monotonic=clock.__next__))
    for name, own, seconds in (("hour", True, 3.5), ("static", False, 1.0)):
        asked = given(monkeypatch, name)
        found = catalogue.run(name, Context(Flyer()))
        assert (found.own, found.seconds) == (own, seconds)
        assert len(asked) == 1


def test_a_point_mass_flies_the_papers_and_a_rigid_body_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given(monkeypatch, "static")
    given(monkeypatch, "hour")
    context = Context(Flyer(), model="point_mass")
    assert catalogue.run("static", context).verdict == "agrees"
    assert catalogue.run("hour", replace(context, model="rigid_body")).verdict == "met"
    assert catalogue.run("hour", replace(context, model=None, dispersion=True)).own
    with pytest.raises(KeyError):
        catalogue.run("nothing of that name", context)


def test_the_whole_takes_as_long_as_all_its_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(_name: str, context: Context) -> Result:
        took = 100.0 if context.dispersion else 10.0 if context.model == "point_mass" else 1.0
        return replace(RESULT, seconds=took)

    monkeypatch.setattr(catalogue, "run", run)
    context: Any = Context(Flyer(), figures=Path(), quick=True, episodes=3)
    assert catalogue.run_whole("static", context).seconds == 111.0
    assert catalogue.run_whole("hour", context).seconds == 101.0
    assert catalogue.run_whole("forecast", context).seconds == 1.0
    assert catalogue.run_whole("field", context).seconds == 1.0
