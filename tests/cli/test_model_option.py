"""`--model`: the rigid body or the point mass, wherever something is simulated."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from typer.testing import CliRunner

from tgl_soar.analysis.campaigns import drawn_faults, long_flight
from tgl_soar.analysis.experiments import catalogue, staleness
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.analysis.experiments.result import Claim, Result
from tgl_soar.analysis.experiments.scenario import prepare
from tgl_soar.cli import experiment as experiment_command
from tgl_soar.cli.app import app
from tgl_soar.cli.console import FlightModel
from tgl_soar.config.airframe import MODEL_KINDS, MODEL_OPTIONS
from tgl_soar.config.files import ConfigError
from tgl_soar.sim import sitl as sitl_flight
from tgl_soar.sim.bridge.command_line import parsed
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.sitl_options import SitlError, SitlOptions
from tgl_soar.sim.sitl_processes import bridge_command
from tgl_soar.sim.world import make_world

RUN = CliRunner()
TITLES = list(catalogue.TOGETHER["all"])


def test_the_command_line_s_names_are_the_file_s() -> None:
    assert [model.kind for model in FlightModel] == list(MODEL_KINDS)
    assert [model.value for model in FlightModel] == list(MODEL_OPTIONS)


@pytest.mark.parametrize(
    "command", [["sitl"], ["experiment", "static"], ["campaign", "faults"], ["campaign", "long"]]
)
def test_another_model_is_refused_with_those_that_there_are(command: list[str]) -> None:
    refused = RUN.invoke(app, [*command, "--model", "glider"])
    assert refused.exit_code == 2
    for name in ("rigid-body", "point-mass"):
        assert name in refused.output


def test_sitl_hands_it_to_the_bridge_and_says_what_is_fitted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown: list[SitlOptions] = []

    def fly(options: SitlOptions, _progress: object) -> Any:
        flown.append(options)
        raise SitlError("enough")

    monkeypatch.setattr(sitl_flight, "fly", fly)
    words = [
        *("sitl", "--model", "point-mass", "--site", "tunnel_polynomial", "--receiver", "rtk"),
        *("--out", str(tmp_path)),
    ]
    reported = RUN.invoke(app, words).output
    assert "wind: a polynomial of degree 8, fitted at" in reported
    assert "point mass: its sink is off the airframe's polar by 0.011 m/s rms" in reported
    given = bridge_command(flown[0], tmp_path / "truth.csv", "127.0.0.1:1", "127.0.0.1:2", "")
    assert parsed(given[4:]).simulation.model == "point_mass"
    assert parsed(given[4:]).simulation.receiver == "rtk"

    reported = RUN.invoke(app, ["sitl", "--out", str(tmp_path)]).output
    assert "polynomial" not in reported
    assert "point mass" not in reported
    given = bridge_command(flown[1], tmp_path / "truth.csv", "127.0.0.1:1", "127.0.0.1:2", "")
    assert "--model" not in given


def test_a_scenario_flies_what_it_names() -> None:
    scenario = Context(flyer=Flyer(), model="point_mass").scenario("static")
    assert prepare(scenario).airframe.model_kind == "point_mass"
    assert prepare(Context(flyer=Flyer()).scenario("static")).airframe.model_kind == "rigid_body"
    assert msgspec.structs.replace(scenario, model=None) == Context(flyer=Flyer()).scenario(
        "static"
    )


def test_what_needs_a_rigid_body_is_not_flown_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(ConfigError, match="estimator: flies the rigid body alone"):
        catalogue.run("estimator", Context(flyer=Flyer(), model="point_mass"))
    flown: list[tuple[str, str | None]] = []

    def run(name: str, context: Context) -> Result:
        flown.append((name, context.model))
        return Result(name=name, title="", flown="", claims=(), why="", tables=(), numbers={})

    monkeypatch.setattr(experiment_command, "run_experiment", run)
    words = ["experiment", "all", "--workers", "0", "--out", str(tmp_path)]
    reported = RUN.invoke(app, [*words, "--model", "point-mass"])
    assert reported.exit_code == 0, reported.output
    paper = [name for name in TITLES if name not in catalogue.RIGID_BODY_ALONE]
    assert flown == [(name, "point_mass") for name in paper]
    assert "field" in paper
    assert "lean" in paper
    flown.clear()
    RUN.invoke(app, words)
    assert flown == [(name, None) for name in TITLES]


def test_the_page_of_the_paper_is_flown_by_both_models_and_dispersed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Figures are those of the rigid body that the airframe file describes: nothing else draws."""
    flown: list[tuple[str, str | None, bool, bool]] = []

    def flies(name: str) -> Callable[[Context], Result]:
        def fly(context: Context) -> Result:
            draws = context.figures is not None
            flown.append((name, context.model, context.dispersion, draws))
            holds = context.model == "rigid_body" and not context.dispersion
            held = Claim("it is held", holds, f"by the {context.model}")
            return Result(
                name=name, title=name, flown="", claims=(held,), why="", tables=(), numbers={}
            )

        return fly

    monkeypatch.setattr(experiment_command, "probe_for_page", lambda _: {"tunnel": (0.25, 1.5)})
    monkeypatch.setattr(catalogue, "EXPERIMENTS", {name: flies(name) for name in TITLES})
    words = ["experiment", "all", "--workers", "0", "--out", str(tmp_path / "out")]
    reported = RUN.invoke(app, [*words, "--docs", str(tmp_path)])
    assert reported.exit_code == 0, reported.output
    expected: list[tuple[str, str | None, bool, bool]] = []
    for name in (name for name in TITLES if name not in catalogue.APART):
        expected.append((name, "rigid_body", False, True))
        if name not in catalogue.RIGID_BODY_ALONE and name != "field":
            expected.append((name, "point_mass", False, False))
        if name in catalogue.DISPERSED:
            expected.append((name, "rigid_body", True, False))
    assert flown == expected
    page = (tmp_path / "experiments.md").read_text()
    assert (
        "| [`static`](#static) | static | agrees: 1 of 1 | differs: 0 of 1 | differs: 0 of 1 |"
        in page
    )
    assert (
        "| it is held | ✓ by the rigid_body | ✗ by the point_mass | ✗ by the rigid_body |" in page
    )
    assert "**Dispersion changes:** “it is held” (✓ → ✗)." in page
    assert "| [`field`](#field) | field | agrees: 1 of 1 | – | – |" in page
    assert staleness.marked(page) == {"tunnel": (0.25, 1.5)}
    assert "point_mass" not in (tmp_path / "aims.md").read_text()
    for name, there in (("paper", "experiments.md"), ("aims", "aims.md")):  # one page alone
        (tmp_path / name).mkdir()
        RUN.invoke(app, ["experiment", name, *words[2:], "--docs", str(tmp_path / name)])
        assert [path.name for path in (tmp_path / name).glob("*.md")] == [there]


def test_a_campaign_flies_it(monkeypatch: pytest.MonkeyPatch) -> None:
    (job,) = drawn_faults.FaultJobs(1, 0, 1)
    monkeypatch.setattr(drawn_faults, "available", lambda: False)
    world = drawn_faults.world_of(job._replace(model="point_mass"), Injection((), 1))
    place = drawn_faults.place()
    assert world.model == make_world(place.airframe.flown_as("point_mass"), place.site).model
    assert world.model != drawn_faults.world_of(job, Injection((), 1)).model


def test_the_whole_module_flies_it() -> None:
    flight = long_flight.fly_long(4.0, model="point_mass")
    assert flight.ended == ""
    assert flight.ticks == 800
    # the same seed on the other model is another flight
    other = long_flight.fly_long(4.0)
    assert flight.parts[-1].largest_e_rho_m != other.parts[-1].largest_e_rho_m


def test_a_section_is_flown_by_dispersed_aircraft_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flown: list[tuple[bool, bool]] = []

    def fly(context: Context) -> Result:
        flown.append((context.dispersion, context.figures is not None))
        landed = Claim("they land", not context.dispersion, "all")
        return Result(
            name="outdoors", title="home", flown="", claims=(landed,), why="", tables=(), numbers={}
        )

    monkeypatch.setattr(catalogue, "EXPERIMENTS", {**catalogue.EXPERIMENTS, "outdoors": fly})
    page = tmp_path / "outdoors.md"
    mark = "<!-- outdoors: begin; written by `tgl-soar experiment outdoors --docs docs` -->"
    page.write_text(f"before {mark} <!-- outdoors: end --> after", encoding="utf-8")
    words = ["--workers", "0", "--out", str(tmp_path / "out"), "--docs", str(tmp_path)]
    reported = RUN.invoke(app, ["experiment", "outdoors", *words])
    assert reported.exit_code == 0, reported.output
    assert flown == [(False, True), (True, False)]
    assert "**Dispersion changes:** “they land” (✓ → ✗)." in page.read_text(encoding="utf-8")
