"""docs/logs.md, "In pandas": its commands and snippets, on a simulated flight of ten seconds."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tgl_soar.analysis.logs.meanings import page
from tgl_soar.cli.app import app

SECTION = page().partition("## In pandas\n")[2].partition("\n## ")[0]
BESIDE = {"parameters", "words"}  # tables that are no topics


def run(*words: str) -> str:
    ran = CliRunner().invoke(app, words)
    assert ran.exit_code == 0, ran.output
    return ran.output


def test_an_exported_flight_is_read_as_the_page_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pandas = pytest.importorskip("pandas")
    monkeypatch.chdir(tmp_path)
    run("sitl", "--legs", "a", "--stay", "5", "--out", "out/sitl")
    (command,) = re.findall(r"(?m)^    tgl-soar (.+)$", SECTION)
    run(*shlex.split(command))
    snippets = re.findall(r"(?ms)^```python\n(.*?)^```$", SECTION)
    assert len(snippets) == 2
    made: dict[str, object] = {}
    for snippet in snippets:
        exec(snippet, made)
    printed = capsys.readouterr().out
    assert float(printed.splitlines()[-1]) < 0.05  # the estimate beside the truth [m]

    tick, truth = made["tick"], made["truth"]
    assert isinstance(tick, pandas.DataFrame)
    assert isinstance(truth, pandas.DataFrame)
    table = SECTION.partition("| columns of `truth.csv`")[2]
    named = re.findall(r"`(\w+)`", "".join(re.findall(r"(?m)^\| (`.*?) \|", table)))
    assert named == list(truth.columns)
    both = made["both"]
    assert isinstance(both, pandas.DataFrame)
    assert len(both) == len(tick)
    known = both.dropna(subset=["time_s_fix"])
    assert (known["time_s_fix"] <= known["time_s"]).all()
    changes = pandas.read_csv("out/csv/parameters.csv")
    assert set(changes.columns) == {"after_tick", "time_s", "name", "value"}
    assert (changes["after_tick"] == 0).sum() > 100
    numbered = pandas.read_csv("out/csv/parameter.csv")
    assert changes[changes["after_tick"] > 0]["after_tick"].tolist() == numbered["tick"].tolist()
    assert {"time_s", "text"} <= set(pandas.read_csv("out/csv/words.csv").columns)
