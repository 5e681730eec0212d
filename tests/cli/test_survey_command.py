"""`tgl-soar survey`: a log's survey becomes the [contour] of a site file, and no more of it."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import numpy as np
import pytest
from slid_contour import flown, logged
from typer.testing import CliRunner

from tgl_soar.analysis.logs import open_log
from tgl_soar.analysis.logs.flight_data import FlightData
from tgl_soar.analysis.survey import contour_fit, surveys_from_log
from tgl_soar.analysis.survey.contour_fit import DrawnContour
from tgl_soar.cli.app import app
from tgl_soar.cli.contour_file import with_contour, write_contour
from tgl_soar.config.files import ConfigError, load_site, shipped

AIRFRAME = shipped("airframes/eclipson_c.toml").read_text(encoding="utf-8")
TABLE = """\
# drawn
[contour]
airframe = "Eclipson Model C"
parts = [
  [
    [1.0, 2.0], [0.0, 1.0],
  ],
]
"""


def run(monkeypatch: pytest.MonkeyPatch, flight: FlightData, *words: str) -> tuple[int, str]:
    monkeypatch.setattr(open_log, "read_flight", lambda _path: flight)
    result = CliRunner().invoke(app, ["survey", "flight.ulg", *words])
    return result.exit_code, re.sub(r"\s+", " ", result.output)


def surveyed() -> FlightData:
    return FlightData(**{**vars(logged(flown())), "files": {"airframe": AIRFRAME}})


def test_it_prints_the_table(monkeypatch: pytest.MonkeyPatch) -> None:
    code, text = run(monkeypatch, surveyed())
    assert code == 0
    assert '[contour] airframe = "Eclipson Model C" parts = [ [ [' in text
    assert "m of contour, ±" in text


@pytest.mark.parametrize("name", ["tunnel", "hill"])
def test_it_becomes_the_contour_of_a_site_file_and_all_else_stays(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str
) -> None:
    site = tmp_path / "site.toml"
    text = shipped(f"sites/{name}.toml").read_text(encoding="utf-8")
    site.write_text(text, encoding="utf-8")
    before = load_site(site)
    code, _ = run(monkeypatch, surveyed(), "--into", str(site))
    assert code == 0
    after = load_site(site)
    assert after.contour != before.contour
    assert after.contour is not None
    assert after.contour_for("Eclipson Model C")[0][0][0] > after.contour.parts[0][-1][0]
    assert msgspec.structs.replace(after, contour=before.contour) == before
    assert site.read_text(encoding="utf-8").startswith(text.partition("# Where excess")[0].rstrip())
    again = site.read_text(encoding="utf-8")
    run(monkeypatch, surveyed(), "--into", str(site))
    assert site.read_text(encoding="utf-8") == again
    assert [path.name for path in tmp_path.iterdir()] == ["site.toml"]


def test_through_a_link_the_file_behind_it_is_written(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    there = tmp_path / "there" / "site.toml"
    there.parent.mkdir()
    there.write_text(shipped("sites/tunnel.toml").read_text(encoding="utf-8"), encoding="utf-8")
    there.chmod(0o640)
    link = tmp_path / "site.toml"
    link.symlink_to(there)
    synced: list[int] = []
    monkeypatch.setattr("tgl_soar.config.parameter_store.os.fsync", synced.append)
    code, _ = run(monkeypatch, surveyed(), "--into", str(link))
    assert code == 0
    assert link.is_symlink()
    assert "as a survey has drawn it" in there.read_text(encoding="utf-8")
    assert there.stat().st_mode & 0o777 == 0o640
    assert len(synced) == 2  # the file, and its name in the folder
    assert [path.name for path in there.parent.iterdir()] == ["site.toml"]


def test_what_stands_after_the_table_keeps_its_comment() -> None:
    text = "a = 1\n\n# old\n[contour]\nparts = []\n\n# of the start\n[start]\nx_m = 1\n"
    changed = with_contour(text, TABLE)
    assert changed == f"a = 1\n\n{TABLE}\n# of the start\n[start]\nx_m = 1\n"
    assert with_contour("a = 1\n", TABLE) == f"a = 1\n\n{TABLE}"


def test_a_file_in_which_more_would_change_is_left_alone(tmp_path: Path) -> None:
    site = tmp_path / "site.toml"
    text = shipped("sites/tunnel.toml").read_text(encoding="utf-8")
    site.write_text(text, encoding="utf-8")
    more = TABLE + "\n[position]\nsilence_s = 0.2\n"
    with pytest.raises(ConfigError, match="by hand"):
        write_contour(site, more)
    assert site.read_text(encoding="utf-8") == text


def slanted(metres: float, sigmas_m: list[float]) -> DrawnContour:
    """A straight piece of a 3-4-5 slope, with standard deviations of its own at its points."""
    along = np.linspace(0.0, metres, len(sigmas_m))
    return DrawnContour(
        x_m=-0.6 * along,
        z_m=0.8 * along,
        sigma_m=np.array(sigmas_m),
        return_per_s=0.8,
        late_m=0.0,
        drift_m=0.0,
    )


@pytest.mark.parametrize(
    ("words", "which"),
    [((), 2), (("--number", "0"), 2), (("--number", "1"), 0), (("--number", "3"), 2)],
)
def test_the_survey_of_a_number_is_drawn_and_usually_the_last(
    words: tuple[str, ...], which: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its length, its median error, and the larger one of its ends are reported."""
    monkeypatch.setattr(surveys_from_log, "surveys_of", lambda _flight: [0, 1, 2])
    drawn: list[int] = []

    def draw(survey: int) -> DrawnContour:
        drawn.append(survey)
        return slanted(1.25, [0.031, 0.004, 0.013, 0.012, 0.042])

    monkeypatch.setattr(contour_fit, "drawn_contour", draw)
    code, text = run(monkeypatch, surveyed(), *words)
    assert (code, drawn) == (0, [which])
    assert "1.25 m of contour, ± 1.3 cm along the line, at its ends ± 4.2 cm" in text
    assert "(`tgl-soar survey flight.ulg`)" in text


@pytest.mark.parametrize("words", [("--number", "4"), ("--number", "17")])
def test_a_survey_that_was_not_flown_is_refused(
    words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(surveys_from_log, "surveys_of", lambda _flight: [0, 1, 2])
    code, text = run(monkeypatch, surveyed(), *words)
    assert code == 2
    assert f"flight.ulg: --number {words[1]}: the flight has surveys 1 to 3" in text


def test_a_table_takes_the_place_of_the_old_one_with_its_comments_wherever_it_stands() -> None:
    first = "# one\n# two\n[contour]\nparts = []\n"
    assert with_contour(first, TABLE) == TABLE
    kept = "# of the file\n\n# old\n[contour]\nparts = []\n\n\n[[lines]]\nname = 'a'\n"
    assert with_contour(kept, TABLE) == f"# of the file\n\n{TABLE}\n[[lines]]\nname = 'a'\n"
    # What only looks like a table, within a row, is none.
    rows = "[contour]\nparts = [\n  [[0.0, 1.0]],\n]\n[start]\nx_m = 1\n"
    assert with_contour(rows, TABLE) == f"{TABLE}\n[start]\nx_m = 1\n"
    # A comment behind the last row belongs to what follows, though that is the end.
    ended = "[contour]\nparts = []\n# the end\n"
    assert with_contour(ended, TABLE) == f"{TABLE}\n# the end"
    twice = with_contour(with_contour(kept, TABLE), TABLE)
    assert twice == with_contour(kept, TABLE)


def test_without_a_survey_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    bare = FlightData("log", "a log", files={"airframe": AIRFRAME})
    code, text = run(monkeypatch, bare)
    assert code == 2
    assert "holds no survey: set SRV_START to 1" in text
    code, text = run(monkeypatch, logged(flown()))
    assert code == 2
    assert "--airframe" in text
    code, text = run(monkeypatch, surveyed(), "--number", "3")
    assert code == 2
    assert "surveys 1 to 1" in text
