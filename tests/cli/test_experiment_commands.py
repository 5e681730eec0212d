"""`tgl-soar zeuc`, `polar` and `experiment`, as typed."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tgl_soar.analysis.experiments.catalogue import RIGID_BODY_ALONE, TOGETHER
from tgl_soar.analysis.experiments.context import COMPILED_FROM, Context
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.cli import experiment as experiment_command
from tgl_soar.cli.app import app
from tgl_soar.config.files import shipped

run = CliRunner(env={"COLUMNS": "120"})
GLIDES = [(7.0 + 0.4 * i, 1.5 + 0.1 * (7.0 + 0.4 * i - 8.2) ** 2) for i in range(11)]


def table(path: Path, header: str = "speed_mps,sink_mps") -> Path:
    path.write_text(header + "\n" + "\n".join(f"{u},{s}" for u, s in GLIDES) + "\n")
    return path


def test_zeuc_writes_a_map_and_its_numbers(tmp_path: Path) -> None:
    out = tmp_path / "map.png"
    done = run.invoke(app, ["zeuc", "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert out.stat().st_size > 20_000
    numbers = json.loads(out.with_suffix(".json").read_text())
    assert len(numbers["contour_m"][0]) > 50
    for line in numbers["lines"].values():
        assert any(c["stable"] for c in line["crossings"])
    assert numbers["core"]["excess_mps"] > 0.0
    assert numbers["versions"]["tgl_soar"]


@pytest.mark.parametrize("words", [["zeuc"], ["experiment", "field", "--quick", "--workers", "0"]])
def test_where_nothing_can_be_written_it_is_reported(words: list[str], tmp_path: Path) -> None:
    there = tmp_path / "file"
    there.touch()
    refused = run.invoke(app, [*words, "--out", str(there / "deeper" / "map.png")])
    assert refused.exit_code == 2, refused.output
    assert (
        f"--out {there / 'deeper' / 'map.png'}: cannot be written: Not a directory"
        in refused.stderr
    )


def test_zeuc_names_the_format_that_it_cannot_draw(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="figures need matplotlib")
    refused = run.invoke(app, ["zeuc", "--out", str(tmp_path / "map.xyz")])
    assert refused.exit_code == 2, refused.output
    assert "no figure: Format 'xyz' is not supported" in refused.stderr
    assert (tmp_path / "map.json").is_file()


def test_zeuc_takes_lines_and_leans(tmp_path: Path) -> None:
    out = tmp_path / "map.svg"
    arguments = ["--line", "0.2,1.2,15", "--line", "0.6,1.7,15", "--lean", "25"]
    done = run.invoke(app, ["zeuc", *arguments, "--out", str(out)])
    assert done.exit_code == 0, done.output
    lines = json.loads(out.with_suffix(".json").read_text())["lines"]
    assert [round(line["lean_deg"]) for line in lines.values()] == [25, 25]
    assert out.read_text().startswith("<?xml")


def test_zeuc_without_a_contour_says_what_would_help(tmp_path: Path) -> None:
    site = tmp_path / "site.toml"
    text = shipped("sites/tunnel.toml").read_text()
    assert "slope_deg = 23.0" in text
    site.write_text(text.replace("slope_deg = 23.0", "slope_deg = 15.0").replace("8.5", "5.0"))
    done = run.invoke(app, ["zeuc", "--site", str(site), "--out", str(tmp_path / "no.png")])
    assert done.exit_code == 2
    assert "no zero excess updraft contour" in done.stderr
    assert "choose a wind" in done.stderr or "steepen" in done.stderr
    assert not (tmp_path / "no.png").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--line", "1,2"], ["--line", "3 numbers"]),
        (["--bounds", "1,2,x,4"], ["--bounds", "4 numbers"]),
        (["--site", "nowhere.toml"], ["nowhere.toml", "cannot be read"]),
        (["--lean", "95"], ["eta"]),
    ],
)
def test_zeuc_refuses_nonsense(tmp_path: Path, arguments: list[str], words: list[str]) -> None:
    done = run.invoke(app, ["zeuc", *arguments, "--out", str(tmp_path / "no.png")])
    assert done.exit_code == 2
    for word in words:
        assert word in done.stderr


def test_polar_fit_prints_toml_to_paste(tmp_path: Path) -> None:
    out = tmp_path / "polar.png"
    done = run.invoke(app, ["polar", "fit", str(table(tmp_path / "g.csv")), "--out", str(out)])
    assert done.exit_code == 0, done.output
    pasted = done.stdout[done.stdout.index("[polar]") :].split("figure in")[0]
    polar = tomllib.loads(pasted)["polar"]
    # The glides lie on a parabola: 1.5 + 0.1 (u − 8.2)²
    assert polar["c2"] == pytest.approx(0.1, rel=1e-3)
    assert abs(polar["c3"]) < 1e-6
    assert (polar["speed_min_mps"], polar["speed_max_mps"]) == (7.0, 11.0)
    assert "least sink 1.500 m/s at 8.2" in done.stdout
    assert out.stat().st_size > 8_000


def test_polar_fit_takes_other_columns(tmp_path: Path) -> None:
    path = table(tmp_path / "g.csv", "V, ws")
    done = run.invoke(app, ["polar", "fit", str(path), "--speed", "V", "--sink", "ws"])
    assert done.exit_code == 0, done.output


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("u,s\n8,1.4\n", ["no column 'speed_mps'", "u, s", "--speed"]),
        ("speed_mps,sink_mps\n8,fast\n", ["line 2", "sink_mps", "'fast'"]),
        ("speed_mps,sink_mps\n8\n", ["line 2", "sink_mps"]),
        ("speed_mps,sink_mps\n8,1.4\n9,1.5\n", ["distinct speeds"]),
        ("speed_mps,sink_mps\n8,-1.4\n", ["positive down"]),
        ("", ["no column"]),
    ],
)
def test_polar_fit_says_what_is_wrong(tmp_path: Path, text: str, words: list[str]) -> None:
    path = tmp_path / "g.csv"
    path.write_text(text)
    done = run.invoke(app, ["polar", "fit", str(path)])
    assert done.exit_code == 2
    assert str(path) in done.stderr.replace("\n", "")
    for word in words:
        assert word in done.stderr


def test_polar_show_tells_best_glide() -> None:
    done = run.invoke(app, ["polar", "show"])
    assert done.exit_code == 0, done.output
    assert "best glide 1 :" in done.stdout
    assert "not beyond" in done.stdout


def test_experiment_lists_runs_and_refuses(tmp_path: Path) -> None:
    assert "translate" in run.invoke(app, ["experiment", "list"]).stdout
    unknown = run.invoke(app, ["experiment", "sideways"])
    assert unknown.exit_code == 2
    assert "field" in unknown.stderr
    half = run.invoke(app, ["experiment", "field", "--docs", str(tmp_path)])
    assert half.exit_code == 2
    done = run.invoke(app, ["experiment", "field", "--workers", "0", "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    assert "verdict: agrees" in done.stdout
    assert "[m/s]" in done.stdout  # not taken for markup
    assert "[c]" in done.stdout
    reported = json.loads((tmp_path / "field.json").read_text())
    assert reported["verdict"] == "agrees"
    assert (tmp_path / "field.png").stat().st_size > 20_000


def test_a_result_is_printed_with_its_marks_and_several_are_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A claim that does not hold must not look like one that does, nor one that is undecided."""
    claims = (
        Claim("it does", True, "1 cm"),
        Claim("it does not", False, "2 cm"),
        Claim("it may", False, "3 cm", undecided=True),
        Claim("it must", True, "0", by_construction=True),
    )
    table = Table("t [m]", ("x [m]", "y"), (("7 [m]", "8"),))
    asked: list[tuple[str, bool, int]] = []

    def fly(name: str, context: Context) -> Result:
        asked.append((name, context.quick, context.compiled_from))
        held = claims[:1] if name == "field" else claims
        return Result(
            name=name,
            title="title",
            flown="flown so.",
            claims=held,
            why="because.",
            tables=(table,),
            numbers={"n": 1.0},
        )

    monkeypatch.setattr(experiment_command, "run_experiment", fly)
    words = ["--workers", "0", "--out", str(tmp_path)]
    one = run.invoke(app, ["experiment", "wind", *words])
    assert one.exit_code == 0, one.output
    lines = [line.strip() for line in one.stdout.splitlines()]
    for line in (
        "flown so.",
        "t [m]",
        "verdict: agrees in part",
        "✓ it does: 1 cm",
        "✗ it does not: 2 cm",
        "? undecided: it may: 3 cm",
        "✓ it must (by construction): 0",
        "because.",
    ):
        assert line in lines
    assert "x [m]" in one.stdout
    assert "experiment │" not in one.stdout.replace("┃", "│")  # one needs no summary
    assert json.loads((tmp_path / "wind.json").read_text())["numbers"] == {"n": 1.0}
    several = run.invoke(app, ["experiment", "paper", *words])
    assert several.exit_code == 0, several.output
    summary = {row.split()[1]: row for row in several.stdout.splitlines() if " of " in row}
    assert "agrees: 1 of 1" in summary["field"]
    assert "agrees in part: 1 of 3, 1 undecided, and 1 by construction" in summary["wind"]
    # Of many, what is compiled for one serves the next; one alone flies few of them plainly.
    assert asked[0] == ("wind", False, COMPILED_FROM)
    assert [name for name, _, _ in asked[1:]] == list(TOGETHER["paper"])
    assert {compiled_from for _, _, compiled_from in asked[1:]} == {2}
    point_mass = run.invoke(app, ["experiment", "all", "--model", "point-mass", *words])
    assert point_mass.exit_code == 0, point_mass.output
    flown = [name for name, _, _ in asked[1 + len(TOGETHER["paper"]) :]]
    assert flown == [name for name in TOGETHER["all"] if name not in RIGID_BODY_ALONE]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (["all", "--docs", "x", "--quick"], "without --quick"),
        (["static", "--docs", "x"], "--docs goes with"),
        (["point", "--docs", "x"], "there is no x/point.md"),
        (["wind", "--field", "s.toml"], "--field goes with `places`"),
        (["paper", "--field", "s.toml", "--docs", "x"], "--field goes with `places`"),
        (["places", "--field", "s.toml", "--docs", "x"], "there is no x/theory.md"),
        (["paper", "--docs", "x", "--model", "point-mass"], "--docs goes without --model"),
        (["paper", "--dispersion"], "--dispersion goes with one experiment"),
        (["static", "--dispersion", "--model", "point-mass"], "--dispersion goes with one"),
        (["static", "--resume"], "no flights of an earlier run"),
    ],
)
def test_what_does_not_go_together_is_refused(
    words: list[str], why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(experiment_command, "run_experiment", lambda *_: pytest.fail("it was run"))
    refused = run.invoke(app, ["experiment", *words, "--workers", "0"])
    assert refused.exit_code == 2
    assert why in " ".join(refused.stderr.split())


def test_a_page_without_marks_is_reported_before_anything_is_flown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(experiment_command, "run_whole", lambda *_: pytest.fail("it flies"))
    page = tmp_path / "margins.md"
    page.write_text("# Margins\n")
    words = ["experiment", "margins", "--docs", str(tmp_path), "--out", str(tmp_path / "out")]
    refused = run.invoke(app, words)
    assert refused.exit_code == 2, refused.output
    assert f"{page}: no marks '<!-- margins: begin" in refused.stderr


def test_a_site_file_gives_its_air_to_the_places(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[Path | None] = []

    def fly(name: str, context: Context) -> Result:
        given.append(context.field)
        return Result(name=name, title="", flown="", claims=(), why="", tables=(), numbers={})

    monkeypatch.setattr(experiment_command, "run_experiment", fly)
    words = ["experiment", "places", "--workers", "0", "--out", str(tmp_path)]
    plane = shipped("sites/tunnel_polynomial.toml")
    assert run.invoke(app, [*words, "--field", str(plane)]).exit_code == 0
    assert run.invoke(app, words).exit_code == 0
    assert given == [plane, None]
    monkeypatch.undo()
    missing = run.invoke(app, [*words, "--field", str(tmp_path / "none.toml")])
    assert missing.exit_code == 2
    assert "none.toml" in missing.stderr.replace("\n", "")
