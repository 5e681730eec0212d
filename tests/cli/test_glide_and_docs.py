"""`tgl-soar glide` and `tgl-soar docs`, quickly: what the glide is asked for and what its log
tells of it, what is refused; the manual's pages listed and printed."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from tgl_soar.analysis.logs.ulog_reader import read_log
from tgl_soar.cli.app import app
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_airframe, manual, shipped
from tgl_soar.sim import glide_test
from tgl_soar.sim.glide_test import GlideTick

SHIPPED = shipped("airframes/eclipson_c.toml")
BRAKED = shipped("airframes/eclipson_c_spoilers.toml")


def run(*words: object) -> tuple[int, str]:
    done = CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": "200"})
    return done.exit_code, done.output


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, dict[str, Any]]]:
    """What glides were flown with: their first five ticks."""
    found: list[tuple[str, dict[str, Any]]] = []
    whole = glide_test.fly

    def begin(plane: Airframe, **given: Any) -> Iterator[GlideTick]:
        found.append((plane.airframe.name, given))
        return islice(whole(plane, **given), 5)

    monkeypatch.setattr(glide_test, "fly", begin)
    return found


def test_a_glide_is_of_the_shipped_airframe_in_calm_air_without_pitot_or_brake(
    asked: list[Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    code, output = run("glide")
    assert code == 0, output
    plane = load_airframe(SHIPPED)
    assert asked == [
        (plane.airframe.name, {"seed": 1, "turbulence": 0.0, "pitot": False, "brakes": (0.0,)})
    ]
    assert output.splitlines()[-1] == (
        f"the wind was {glide_test.wind_of(plane):g} m/s from north, the same everywhere"
    )
    (log,) = tmp_path.glob("out/glide/**/*.ulg")
    assert str(log.name) in output


def test_each_option_is_what_is_flown_by_and_the_log_has_the_airframe_and_the_seed(
    asked: list[Any], tmp_path: Path
) -> None:
    code, output = run(
        *("glide", "--airframe", BRAKED, "--seed", 7, "--turbulence", 0.05, "--pitot"),
        *("--brake", 0.5, "--brake", 1, "--out", tmp_path),
    )
    assert code == 0, output
    ((name, given),) = asked
    assert name == load_airframe(BRAKED).airframe.name
    assert given == {"seed": 7, "turbulence": 0.05, "pitot": True, "brakes": (0.5, 1.0)}
    (path,) = tmp_path.rglob("*.ulg")
    log = read_log(path)
    assert log.info["sys_name"] == "tgl_soar"
    assert log.info["flight"] == "simulated glide, seed 7"
    assert int(log.info["ver_log"]) > 0
    assert log.info["airframe_file"] == str(BRAKED)
    assert log.texts["airframe"] == BRAKED.read_text(encoding="utf-8")
    assert log.parameters


@pytest.mark.parametrize(
    ("words", "reported"),
    [
        (("--brake", "-0.01"), "--brake -0.01: each must be from 0 to 1"),
        (("--brake", "0.5", "--brake", "1.01"), "--brake 0.5 1.01: each must be from 0 to 1"),
        (("--brake", "0.01"), "has no brake: [surfaces] flap, spoiler, or two ailerons"),
        (("--turbulence", "0.21"), "Invalid value for '--turbulence'"),
        (("--turbulence", "-0.01"), "Invalid value for '--turbulence'"),
        (("--seed", "-1"), "Invalid value for '--seed'"),
    ],
)
def test_what_cannot_be_glided_is_refused_and_leaves_no_log(
    words: tuple[str, ...], reported: str, asked: list[Any], tmp_path: Path
) -> None:
    code, output = run("glide", *words, "--out", tmp_path / "out")
    assert (code, reported in output) == (2, True), output
    assert asked == []
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("brake", ["0", "1"])
def test_a_brake_goes_from_none_to_all(brake: str, asked: list[Any], tmp_path: Path) -> None:
    assert run("glide", "--airframe", BRAKED, "--brake", brake, "--out", tmp_path)[0] == 0
    assert asked[0][1]["brakes"] == (float(brake),)


def test_a_folder_that_is_none_is_an_error(asked: list[Any], tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.touch()
    code, output = run("glide", "--out", blocked)
    assert (code, len(asked)) == (2, 1)
    assert f"error: --out {blocked}: no log could be written" in output


# --- the manual ---------------------------------------------------------------------------------


def test_all_pages_are_listed_by_name_with_their_paths_and_titles() -> None:
    code, output = run("docs")
    assert code == 0
    rows = [line.split("  ", 1) for line in output.splitlines()]
    assert [path for path, _ in rows] == [str(path) for path in sorted(manual().glob("*.md"))]
    titles = {Path(path).stem: title for path, title in rows}
    assert titles["mutants"] == "Mutants"
    assert all(title and not title.startswith("#") for title in titles.values())


@pytest.mark.parametrize("name", ["mutants", "mutants.md"])
def test_a_page_is_printed_as_it_is(name: str) -> None:
    """Brackets are no markup, long lines are not broken."""
    code, output = run("docs", name)
    assert (code, output) == (0, (manual() / "mutants.md").read_text(encoding="utf-8"))


def test_a_page_that_is_none_is_named_beside_those_that_are() -> None:
    code, output = run("docs", "mutant")
    assert code == 2
    names = ", ".join(path.stem for path in sorted(manual().glob("*.md")))
    assert f"error: no page mutant: there are {names}" in output
