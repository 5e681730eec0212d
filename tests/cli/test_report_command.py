"""`tgl-soar report` as a user calls it."""

from __future__ import annotations

import shutil
from errno import ENOSPC
from pathlib import Path

import flown
import fuzz_logs
import numpy as np
import pytest
from typer.testing import CliRunner

from tgl_soar.cli import report
from tgl_soar.cli.app import app
from tgl_soar.cli.log_argument import newest_log

RUN = CliRunner()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    flown.our_log(folder)
    flown.tlog(folder)
    return folder


def test_our_log_needs_no_other_file(folder: Path, tmp_path: Path) -> None:
    result = RUN.invoke(app, ["report", str(folder / "ours.ulg"), "-o", str(tmp_path)])
    assert result.exit_code == 0, result.output
    text = (tmp_path / "ours.html").read_text(encoding="utf-8")
    assert "Eclipson" in text
    assert "TGL ∩ ZEUC" in text
    assert (tmp_path / "ours-figures" / "plane.png").is_file()


def test_a_tlog_with_site_and_airframe(folder: Path, tmp_path: Path) -> None:
    files = ["--site", str(flown.SITE), "--airframe", str(flown.AIRFRAME)]
    page = tmp_path / "x.html"
    result = RUN.invoke(app, ["report", str(folder / "station.tlog"), *files, "-o", str(page)])
    assert result.exit_code == 0, result.output
    text = page.read_text(encoding="utf-8")
    assert 'id="places"' in text
    assert "elevator" in text


def test_a_grid_is_a_field(folder: Path, tmp_path: Path) -> None:
    x, z = np.linspace(-2.0, 3.0, 41), np.linspace(0.2, 4.0, 41)
    xx, zz = np.meshgrid(x, z, indexing="ij")
    grid = tmp_path / "wind.npz"
    np.savez(grid, x=x, z=z, u=9.0 + 0.0 * xx, w=1.5 + 0.0 * zz)
    arguments = ["report", str(folder / "ours.ulg"), "--field", str(grid), "-o", str(tmp_path)]
    result = RUN.invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert (tmp_path / "ours.html").is_file()


def test_what_was_lost_is_reported_and_the_exit_code_tells_it(tmp_path: Path) -> None:
    cut = tmp_path / "cut.ulg"
    others = [name for name in flown.PX4 if name != "vehicle_attitude"]
    data = flown.px4_log(tmp_path, leave_out=others).read_bytes()
    cut.write_bytes(data[: len(data) // 2 + 7])
    result = RUN.invoke(app, ["report", str(cut), "-o", str(tmp_path)])
    assert result.exit_code == 1
    assert "lost: " in result.output
    assert "cut off" in (tmp_path / "cut.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["none.ulg"], "none.ulg: cannot be read"),
        (["LOG", "--site", "none.toml"], "none.toml: cannot be read"),
        (["LOG", "--airframe", "none.toml"], "none.toml: cannot be read"),
        (["LOG", "--field", "none.npz"], "none.npz: no such file"),
        (["LOG", "--field", "none.toml"], "none.toml: cannot be read"),
        (["LOG", "-o", "file/x.html"], "cannot be written"),
    ],
)
def test_what_cannot_be_is_named(
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("in the way")
    shutil.copy(folder / "ours.ulg", "LOG")
    result = RUN.invoke(app, ["report", *arguments])
    assert result.exit_code == 2, result.output
    assert words in result.output.replace("\n", " ")
    assert "Traceback" not in result.output


def test_a_full_disk_is_named_by_the_page(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_given: object) -> None:
        raise OSError(ENOSPC, "No space left on device")

    monkeypatch.setattr(report, "write", full)
    result = RUN.invoke(app, ["report", "x.ulg", "--out", "y.html"], env={"COLUMNS": "300"})
    assert result.exit_code == 2
    assert "y.html: cannot be written: No space left on device" in result.output


def test_the_flight_of_make_run_ends_with_its_report(tmp_path: Path) -> None:
    arguments = ["sitl", "--legs", "a", "--stay", "5", "--out", str(tmp_path), "--report"]
    result = RUN.invoke(app, arguments)
    assert "its report: " in result.output, result.output
    assert 'id="plane"' in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert (tmp_path / "flight.png").stat().st_size > 10_000


def test_the_newest_log_is_the_first_part_of_the_last_flight(tmp_path: Path) -> None:
    assert newest_log(tmp_path) is None
    day = tmp_path / "2026-11-21"
    day.mkdir()
    for name in ("08_00_00_flight001", "09_00_00_flight002_part2", "09_00_00_flight002"):
        (day / f"{name}.ulg").touch()
        (day / f"{name}.tlog").touch()
    assert newest_log(tmp_path) == day / "09_00_00_flight002.ulg"


FOLLOWED = "degree = 1\nx_m = [0.0, 1.0]\nz_m = [0.0, 1.0]"
OF_A_FILE = {
    "grid": '[air]\nkind = "grid"\nfile = "{file}"\nwind_mps = 5\n',
    "polynomial": f'[air]\nkind = "polynomial"\n{FOLLOWED}\n'
    '[air.of]\nkind = "grid"\nfile = "{file}"\nwind_mps = 5\n',
}


@pytest.mark.parametrize("kind", list(OF_A_FILE))
@pytest.mark.parametrize("name", ["secret.csv", "{folder}/secret.csv", "../secret.csv"])
def test_no_path_that_a_log_names_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, kind: str
) -> None:
    """Else a stranger's log would choose which table of this computer its page shows."""
    secret = tmp_path / "secret.csv"
    secret.write_text("x,z,u,w\n0,0,1,SECRET-CELL\n")
    place = tmp_path / "logs"
    place.mkdir()
    monkeypatch.chdir(tmp_path)
    air = OF_A_FILE[kind].format(file=name.format(folder=tmp_path))
    log = place / "foreign.ulg"
    log.write_bytes(fuzz_logs.own_log(b'[site]\nname = "$x_{"\n' + air.encode()))
    result = RUN.invoke(app, ["report", str(log), "-o", str(tmp_path)])
    text = (tmp_path / "foreign.html").read_text(encoding="utf-8")
    assert "SECRET" not in text + result.output
    assert "not opened at its word: name the site file by --site" in text
    assert "$x_{" in text


def test_names_are_drawn_as_they_are_and_not_as_mathematics(tmp_path: Path) -> None:
    log = tmp_path / "a$b_{$.ulg"
    site = b'site.name = "$x_{"\nlines."$\\\\frac$" = { x_m = 0.2, z_m = 1.15 }\n'
    log.write_bytes(fuzz_logs.own_log(site, rb"$a$;$b_{$;c;d;$\nothing{;boot"))
    result = RUN.invoke(app, ["report", str(log), "-o", str(tmp_path)])
    assert result.exit_code == 1, result.output  # a dropout is in it
    assert (tmp_path / "a$b_{$-figures" / "longitudinal.svg").is_file()
    text = (tmp_path / "a$b_{$.html").read_text(encoding="utf-8")
    assert r"<!-- $\nothing{ -->" in text  # matplotlib's remark beside what it draws
