"""What `tgl-soar sitl` leaves of a flight: the figure, the map of a search, the report, the log."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer
from rich.console import Console

from tgl_soar.analysis.logs.ulog_reader import LogError
from tgl_soar.cli import sitl
from tgl_soar.cli.console import AIRFRAME, SITE
from tgl_soar.cli.report import Named
from tgl_soar.config.files import shipped
from tgl_soar.sim.sitl_options import SitlOptions

FLIGHT: Any = SimpleNamespace()


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, Path]]:
    """What is drawn and written, and where: the drawing itself is left out."""
    made: list[tuple[str, Path]] = []
    monkeypatch.setattr(sitl, "console", Console(width=200))
    monkeypatch.setattr(sitl, "_draw", lambda _o, _f, path: made.append(("figure", path)))
    monkeypatch.setattr(sitl, "_draw_map", lambda _o, _log, path: made.append(("map", path)))
    monkeypatch.setattr(sitl, "write", lambda _log, page, *_more: made.append(("report", page)))
    monkeypatch.setattr(sitl, "newest_log", lambda folder: folder / "a.ulg")
    return made


def options(out: Path, *, search: bool = False) -> SitlOptions:
    return SitlOptions(airframe=Path("a"), site=SITE, out=out, search=search)


@pytest.mark.parametrize("search", [False, True])
@pytest.mark.parametrize("report", [False, True])
@pytest.mark.parametrize("has_log", [False, True])
def test_each_page_is_written_where_there_is_a_log_and_it_is_wanted(
    search: bool,
    report: bool,
    has_log: bool,
    drawn: list[tuple[str, Path]],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = Path("here")
    if not has_log:
        monkeypatch.setattr(sitl, "newest_log", lambda _folder: None)
    sitl._write_pages(options(out, search=search), FLIGHT, report=report)
    expected = [("figure", out / "flight.png")]
    expected += [("map", out / "search.png")] * (search and has_log)
    expected += [("report", out / "report.html")] * (report and has_log)
    assert drawn == expected
    output = capsys.readouterr().out
    assert ("its report: here/report.html" in output) == (report and has_log)
    assert ("its report: tgl-soar report here/logs/a.ulg" in output) == (has_log and not report)


@pytest.mark.parametrize("report", [False, True])
def test_a_site_whose_wind_is_in_a_file_is_named_to_the_report(
    report: bool,
    drawn: list[tuple[str, Path]],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """No log holds that file: without --site the report would have no wind, or fail."""
    site = tmp_path / "my hill" / "site.toml"
    site.parent.mkdir()
    text = shipped("sites/hill.toml").read_text(encoding="utf-8")
    site.write_text(text.replace("radius_m = 8.0", 'radius_m = 8.0\nrecord = "hour.csv"'))
    named: list[Named] = []
    monkeypatch.setattr(sitl, "write", lambda _log, _page, given, _step: named.append(given))
    chosen = SitlOptions(airframe=Path("a"), site=site, out=Path("here"))
    sitl._write_pages(chosen, FLIGHT, report=report)
    command = f"its report: tgl-soar report here/logs/a.ulg --site '{site}'\n"
    assert (command in capsys.readouterr().out) != report
    assert [each.site for each in named] == [site] * report
    assert drawn


@pytest.mark.parametrize("survey", [False, True])
def test_who_has_surveyed_is_told_what_draws_the_contour(
    survey: bool, drawn: list[tuple[str, Path]], capsys: pytest.CaptureFixture[str]
) -> None:
    chosen = SitlOptions(airframe=Path("a"), site=SITE, out=Path("here"), survey=survey)
    sitl._write_pages(chosen, FLIGHT, report=False)
    assert [path.name for _, path in drawn] == ["flight.png"]
    told = "its contour: tgl-soar survey here/logs/a.ulg" in capsys.readouterr().out
    assert told == survey


@pytest.mark.parametrize("error", [ImportError("no matplotlib"), LogError("cut off")])
def test_without_a_figure_the_flight_is_none_the_worse(
    error: Exception,
    drawn: list[tuple[str, Path]],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fails(*_given: Any) -> None:
        raise error

    monkeypatch.setattr(sitl, "_draw", fails)
    sitl._write_pages(options(Path("here")), FLIGHT, report=True)
    assert drawn == []
    assert f"no figure: {error}" in capsys.readouterr().err


def test_a_full_disk_is_reported_with_the_file(
    drawn: list[tuple[str, Path]],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def fails(*_given: Any) -> None:
        raise OSError(28, "No space left on device", "flight.png")

    monkeypatch.setattr(sitl, "_draw", fails)
    with pytest.raises(typer.Exit) as ended:
        sitl._write_pages(options(Path("here")), FLIGHT, report=False)
    assert (ended.value.exit_code, drawn) == (2, [])
    words = "--out here: flight.png cannot be written: No space left on device"
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("words", ["", "a misfit"])
def test_how_far_the_aircraft_is_from_its_polar_is_reported_where_it_is(
    words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The tunnel's air is a jet, which is fitted to nothing."""
    monkeypatch.setattr("tgl_soar.sim.world.polar_misfit_text", lambda _plane: words)
    monkeypatch.setattr("tgl_soar.sim.world.wind_misfit_text", lambda _field: "of the wind")
    sitl._say_what_flies(SitlOptions(airframe=AIRFRAME, site=SITE, out=Path("here")))
    assert capsys.readouterr().out == (f"{words}\n" if words else "")
