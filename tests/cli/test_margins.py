"""`tgl-soar margins`: its table, its worst case, its exit code."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tgl_soar.analysis import margins as found
from tgl_soar.cli.app import app
from tgl_soar.cli.console import console
from tgl_soar.config.files import shipped

AIRFRAME = shipped("airframes/eclipson_c.toml")
FEW = ["--speed", "8.5", "--lean", "15", "--delay", "7.5"]


def test_the_shipped_airframe_has_margins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console, "width", 80)
    result = CliRunner().invoke(app, ["margins", *FEW])
    assert result.exit_code == 0, result.output
    found = re.search(r"worst: (\S+) at 8.5 m/s, lean 15 deg, 7.5 ms", result.output)
    assert found
    rows = [line for line in result.output.splitlines() if re.match(r"(imu|fixes) +7\.5 ", line)]
    assert [row.split()[0] for row in rows] == ["imu", "fixes"]
    alphas = [word for row in rows for word in re.findall(r" (\d\.\d\d) ", row)[:2]]
    assert found[1] == min(alphas)
    assert float(found[1]) >= 0.5


def test_below_the_floor_the_exit_code_says_so_and_names_the_worst() -> None:
    result = CliRunner().invoke(app, ["margins", *FEW, "--floor", "0.9"])
    assert result.exit_code == 1
    assert "worst: " in result.output
    assert "below 0.9" in result.output


def test_a_figure_shows_them(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="figures need matplotlib")
    out = tmp_path / "margins.svg"
    result = CliRunner().invoke(app, ["margins", *FEW, "--out", str(out)])
    assert result.exit_code == 0, result.output
    text = out.read_text(encoding="utf-8")
    assert text.count('id="axes_') == 2  # with accelerometers, and without
    assert f"figure in {out}" in "".join(result.output.split("\n"))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("folder", "name a file that ends in .png or .svg"),
        ("figure", "name a file that ends in .png or .svg"),
        ("folder.svg", "name a file that ends in .png or .svg"),
        ("file/x.png", "cannot be written: "),
    ],
)
def test_a_figure_that_cannot_be_written_is_refused_before_anything_is_computed(
    name: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(found, "case_margins", lambda *_: pytest.fail("computed"))
    for folder in ("folder", "folder.svg"):
        (tmp_path / folder).mkdir()
    (tmp_path / "file").write_text("")
    result = CliRunner().invoke(app, ["margins", *FEW, "--out", str(tmp_path / name)])
    assert result.exit_code == 2
    assert f"--out {tmp_path / name}: {words}" in " ".join(result.output.split())


def test_without_matplotlib_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    result = CliRunner().invoke(app, ["margins", *FEW, "--out", str(tmp_path / "margins.svg")])
    assert result.exit_code == 2
    assert "tgl_soar[figures]" in result.output


def test_a_lean_that_no_line_may_have_is_an_error() -> None:
    result = CliRunner().invoke(app, ["margins", "--speed", "8.5", "--lean", "70"])
    assert result.exit_code == 2
    assert "TGL_LEAN" in result.output


def test_accelerometers_that_are_not_used_have_no_row(tmp_path: Path) -> None:
    plane = tmp_path / "plane.toml"
    text = AIRFRAME.read_text(encoding="utf-8")
    plane.write_text(text.replace("[parameters]", "[parameters]\nEST_IMU = 0"), encoding="utf-8")
    result = CliRunner().invoke(app, ["margins", *FEW, "--airframe", str(plane)])
    assert result.exit_code == 0, result.output
    assert re.search(r"^fixes ", result.output, re.MULTILINE)
    assert not re.search(r"^imu ", result.output, re.MULTILINE)
    assert "without accelerometers" in result.output


@pytest.mark.parametrize(
    ("firmware", "is_reported"), [('"px4"\nroute = "attitude"', True), ('"ardupilot"', False)]
)
def test_loops_that_rest_on_a_route_are_reported(
    firmware: str, is_reported: bool, tmp_path: Path
) -> None:
    plane = tmp_path / "plane.toml"
    text = AIRFRAME.read_text(encoding="utf-8")
    assert 'firmware = "bridge"' in text
    plane.write_text(
        text.replace('firmware = "bridge"', f"firmware = {firmware}"), encoding="utf-8"
    )
    result = CliRunner().invoke(app, ["margins", *FEW, "--airframe", str(plane)])
    assert result.exit_code == 0, result.output
    assert ("the firmware's hold the attitude" in result.output) == is_reported
