"""`tgl-soar tune`: what it writes, what it refuses, that it goes on where it was."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tgl_soar.analysis.tuning import flights
from tgl_soar.analysis.tuning import tune as tuning
from tgl_soar.cli.app import app
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.control.found_gains import SETS
from tgl_soar.sim.campaign import rows
from tgl_soar.sim.campaign.manifest import key_of, read_manifest

AIRFRAME = shipped("airframes/eclipson_c.toml")
FEW = ["tune", "--quick", "--workers", "0"]


@pytest.fixture(autouse=True)
def least(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("cma", reason="tuning needs cma")
    effort = tuning.QUICK._replace(generations=1, aircraft=0, judging_linear=1)
    monkeypatch.setattr(tuning, "QUICK", effort)


def test_gains_an_airframe_file_and_a_figure(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="figures need matplotlib")
    out, airframe, figure = tmp_path / "t.toml", tmp_path / "a.toml", tmp_path / "p.svg"
    options = ["--out", str(out), "--airframe-out", str(airframe), "--figure", str(figure)]
    result = CliRunner().invoke(app, [*FEW, *options], env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.output
    table = tomllib.loads(out.read_text(encoding="utf-8"))
    new = load_airframe(airframe)
    assert {n: new.parameters[n] for n in table["parameters"]} == table["parameters"]
    assert figure.exists()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        *("a.toml", "p.svg", "t.toml", "t.toml.manifest.json")
    ]
    assert f"# tuned, task {table['tuned']['task'][:12]}\n" in airframe.read_text(encoding="utf-8")
    assert re.search(r"^ *accelero", result.output, re.M)  # a narrow table cuts the word


def test_every_flight_is_a_row_that_a_report_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    parquet = pytest.importorskip("pyarrow.parquet", reason="rows need pyarrow")
    effort = tuning.QUICK._replace(choosing=1, judging=2, flight_s=1.0)
    monkeypatch.setattr(tuning, "QUICK", effort)
    monkeypatch.setattr(flights, "available", lambda: False)  # a second of plain flight is enough
    out = tmp_path / "t.toml"
    result = CliRunner().invoke(app, [*FEW, "--out", str(out)], env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.output
    table = tmp_path / "t.toml.rows.parquet"
    found = [*rows.read_rows(table)]
    judged = [row for row in found if row["judges"]]
    flown = [(row["kind"], row["turbulence"], row["gains"], row["aircraft"]) for row in judged]
    assert flown == [
        (kind, turbulence, gains, aircraft)
        for kind in SETS
        for turbulence in (0.03, 0.05)
        for gains in ("before", "after")
        for aircraft in (0, 1)
    ]
    assert {row["gains"][:9] for row in found if not row["judges"]} <= {"finalist "}
    assert all(row["duration_s"] == 1.0 for row in found)
    whence = json.loads(parquet.read_schema(table).metadata[b"tgl_soar"])
    manifest = read_manifest(Path(f"{out}.manifest.json"))
    assert manifest is not None
    assert whence["parameters_digest"] == manifest.parameters_digest
    assert (whence["runs"], whence["complete"]) == ([], True)
    counted = CliRunner().invoke(app, ["campaign", "report", str(table), "--by", "gains"])
    assert counted.exit_code == 0, counted.output
    assert "before" in counted.output
    # Other gains, of which none was flown: the table is not theirs.
    result = CliRunner().invoke(app, [*FEW, "--out", str(out), "--flights", "0"])
    assert result.exit_code == 0, result.output
    assert not table.exists()
    table.mkdir()
    result = CliRunner().invoke(app, [*FEW, "--out", str(out)], env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.output
    assert "no table of the flights" in result.output
    assert "before" in result.output


def test_without_pyarrow_there_is_no_table_and_the_gains_are_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    effort = tuning.QUICK._replace(judging=1, flight_s=1.0)
    monkeypatch.setattr(tuning, "QUICK", effort)
    monkeypatch.setattr(flights, "available", lambda: False)
    monkeypatch.setattr(rows, "available", lambda: False)
    out = tmp_path / "t.toml"
    result = CliRunner().invoke(app, [*FEW, "--out", str(out)], env={"COLUMNS": "200"})
    assert result.exit_code == 0, result.output
    told = "no table of the flights: Parquet needs pyarrow"
    assert f"\nthere will be {told}" in result.output
    assert f"\n{told}" in result.output
    assert sorted(path.name for path in tmp_path.iterdir()) == ["t.toml", "t.toml.manifest.json"]


def test_progress_is_gone_on_with_unless_it_is_of_another_task(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "t.toml"

    def killed(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as context:
        context.setattr(tuning, "_judged", killed)
        stopped = CliRunner().invoke(app, [*FEW, "--out", str(out)])
    assert stopped.exit_code == 130
    assert not out.exists()
    progress = tmp_path / "t.toml.progress"
    assert progress.exists()
    other = CliRunner().invoke(app, [*FEW, "--out", str(out), "--seed", "2"])
    assert other.exit_code == 2
    assert f"{progress}: belongs to other files or options" in other.output
    with monkeypatch.context() as context:
        context.setattr(tuning, "given_by", lambda *_: pytest.fail("sought again"))
        again = CliRunner().invoke(app, [*FEW, "--out", str(out)])
    assert again.exit_code == 0, again.output
    assert not progress.exists()
    manifest = read_manifest(tmp_path / "t.toml.manifest.json")
    assert manifest is not None
    assert manifest.complete
    assert (manifest.name, manifest.seeds, manifest.parameters["floor"]) == ("tune", [1, 1], 0.5)
    first, second = manifest.runs
    # Killed where both sets had been sought, a start and a generation each, and judged as they are.
    assert (first["from"], second["from"]) == (0, 6)
    assert first["by"] == second["by"] == "in line"
    assert {"host", "numpy", "numba", "begun", "ended"} <= second.keys()
    assert "ended" not in first
    tuned = tomllib.loads(out.read_text(encoding="utf-8"))["tuned"]
    for name in ("version", "commit", "source"):
        assert tuned[name] == getattr(manifest, name)
    assert tuned["task"] == key_of(manifest)


def test_gains_for_one_aircraft_keep_no_margin_for_others(tmp_path: Path) -> None:
    """And are another task: progress of the one is not gone on with by the other."""
    found = {}
    for name, options in (("own", ["--own"]), ("any", [])):
        out = tmp_path / f"{name}.toml"
        result = CliRunner().invoke(app, [*FEW, *options, "--out", str(out)])
        assert result.exit_code == 0, result.output
        found[name] = tomllib.loads(out.read_text(encoding="utf-8"))["tuned"]
    own, every = found["own"]["ranges"], found["any"]["ranges"]
    assert own["short_period"] == own["lift"] == [1.0, 1.0]
    assert own["unknown_effect"] == [0.9, 1.1]
    assert every["short_period"] != [1.0, 1.0]
    assert found["own"]["task"] != found["any"]["task"]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--line", "zz"], "--line zz: no line of "),
        (["--out", str(AIRFRAME)], "that is the file that is tuned"),
        (["--out", "no/such/folder/t.toml"], "there is no folder"),
        (["--airframe-out", "t.toml", "--out", "t.toml"], "that is --out"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_is_sought(
    options: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, [*FEW, *options])
    assert result.exit_code == 2
    assert words in result.output
    assert not list(tmp_path.iterdir())


def test_a_site_where_nobody_can_fly_is_refused_before_anything_is_sought(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And the way out that is named is one: nothing of another task is in its way."""
    text = shipped("sites/tunnel.toml").read_text(encoding="utf-8")
    for table in ("air", "start"):
        text = re.sub(rf"(?ms)^\[{table}\].*?(?=^\[)", "", text)
    site, out = tmp_path / "site.toml", tmp_path / "t.toml"
    site.write_text(text, encoding="utf-8")
    options = ["--own", "--site", str(site), "--out", str(out)]
    with monkeypatch.context() as context:
        context.setattr(tuning, "given_by", lambda *_: pytest.fail("sought before it was refused"))
        refused = CliRunner().invoke(app, [*FEW, *options, "--flights", "2"])
    assert refused.exit_code == 2
    assert "no [air] to fly in: name another --site, or --flights 0" in refused.output
    again = CliRunner().invoke(app, [*FEW, *options, "--flights", "0"])
    assert again.exit_code == 0, again.output


def test_a_margin_below_the_floor_is_an_exit_code(tmp_path: Path) -> None:
    out = tmp_path / "t.toml"
    result = CliRunner().invoke(app, [*FEW, "--out", str(out), "--floor", "1"])
    assert result.exit_code == 1
    assert "below 1: at " in result.output
    assert out.exists()  # with the margins that were reached


def test_an_airframe_that_is_not_known_is_named(tmp_path: Path) -> None:
    text = AIRFRAME.read_text(encoding="utf-8").replace("Cm_q = ", "#")
    (tmp_path / "a.toml").write_text(text, encoding="utf-8")
    options = ["--airframe", str(tmp_path / "a.toml"), "--out", str(tmp_path / "t.toml")]
    result = CliRunner().invoke(app, [*FEW, *options])
    assert result.exit_code == 2
    assert "a.toml: DYN_FREQ = 0: not known of this airframe" in result.output
