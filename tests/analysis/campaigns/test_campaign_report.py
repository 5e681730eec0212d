"""Tables of any campaign: counted and averaged right, whatever the columns."""

from __future__ import annotations

from math import nan
from pathlib import Path
from typing import NamedTuple

import pytest
from typer.testing import CliRunner

from tgl_soar.analysis.campaigns.report import (
    Proportion,
    Report,
    ReportError,
    TwoProportions,
    beside,
    report,
)
from tgl_soar.analysis.report.campaign_figure import campaign_figure, two_campaigns_figure
from tgl_soar.cli.app import app
from tgl_soar.sim.campaign.folder import ROWS
from tgl_soar.sim.campaign.rows import write_rows

pytest.importorskip("pyarrow")


class Seeded(NamedTuple):
    """A job."""

    seed: int


class Came(NamedTuple):
    """What it came to."""

    row: str
    result: str
    up: bool
    error_m: float


FLIGHTS = [
    Came("wind", "soaring", True, 1.0),
    Came("wind", "lost", False, nan),
    Came("gust", "soaring", True, 3.0),
    Came("wind", "soaring", True, 2.0),
]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    pairs = ((Seeded(n), flight) for n, flight in enumerate(FLIGHTS))
    write_rows(tmp_path / ROWS, Seeded, Came, pairs, {})
    return tmp_path


def counts(found: Report) -> dict[str, dict[str, int]]:
    return {group.name: dict(group.classes) for group in found.groups}


def test_classes_are_counted_by_group(folder: Path) -> None:
    found = report(folder)
    assert (found.by, found.of) == ("row", "result")
    assert counts(found) == {"wind": {"soaring": 2, "lost": 1}, "gust": {"soaring": 1}}
    assert found.classes == ["soaring", "lost"]
    assert counts(report(folder / ROWS, "result", "up")) == {
        "soaring": {"yes": 3},
        "lost": {"no": 1},
    }
    assert counts(report(folder, "", "row")) == {"all": {"wind": 3, "gust": 1}}


def test_numbers_are_averaged_and_those_unknown_are_counted(folder: Path) -> None:
    wind, gust = report(folder, "row", "error_m").groups
    spread = wind.spread()
    assert (spread.flights, spread.unknown, spread.mean, spread.deviation) == (3, 1, 1.5, 0.5)
    assert spread.quantiles[1] == 1.5
    assert gust.spread().quantiles == (3.0, 3.0, 3.0)


def test_what_cannot_be_reported_is_said(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ReportError, match=r"--by wings: no column of .*; it has row, result"):
        report(folder, "wings")
    (tmp_path / "empty").mkdir()
    with pytest.raises(ReportError, match=r"no rows\.parquet is there"):
        report(tmp_path / "empty")


@pytest.mark.parametrize("of", ["result", "error_m"])
def test_it_is_drawn(folder: Path, tmp_path: Path, of: str) -> None:
    pytest.importorskip("matplotlib")
    campaign_figure(tmp_path / "a.png", report(folder, "row", of))
    campaign_figure(tmp_path / "b.png", report(folder, "row", of))
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


@pytest.fixture
def another(tmp_path: Path) -> Path:
    came = [
        *(Came("wind", "lost", False, 1.0) for _ in range(20)),
        Came("gust", "soaring", True, 3.0),
        Came("fault", "soaring", True, 3.0),
    ]
    path = tmp_path / "another"
    path.mkdir()
    pairs = ((Seeded(n), flight) for n, flight in enumerate(came))
    write_rows(path / ROWS, Seeded, Came, pairs, {})
    return path


def test_two_campaigns_stand_beside_one_another(folder: Path, another: Path) -> None:
    two = beside(report(folder), report(another))
    assert (two.by, two.of, two.counted) == ("row", "result", "soaring")
    assert [(row.name, *row.fractions) for row in two.rows] == [
        ("wind", (2, 3), (0, 20)),
        ("gust", (1, 1), (1, 1)),
    ]
    assert [row.is_apart for row in two.rows] == [True, False]
    assert two.alone == ([], ["fault"])
    assert beside(report(another), report(folder)).alone == (["fault"], [])
    with pytest.raises(ReportError, match="two campaigns are compared by classes"):
        beside(report(folder, "row", "error_m"), report(another, "row", "error_m"))


@pytest.mark.parametrize(
    ("fractions", "difference"),
    [  # Newcombe's examples (a) to (h) and the intervals of method 10.
        (((56, 70), (48, 80)), (0.0524, 0.3339)),
        (((9, 10), (3, 10)), (0.1705, 0.8090)),
        (((6, 7), (2, 7)), (0.0582, 0.8062)),
        (((5, 56), (0, 29)), (-0.0381, 0.1926)),
        (((0, 10), (0, 20)), (-0.1611, 0.2775)),
        (((0, 10), (0, 10)), (-0.2775, 0.2775)),
        (((10, 10), (0, 20)), (0.6791, 1.0)),
        (((10, 10), (0, 10)), (0.6075, 1.0)),
    ],
)
def test_a_difference_is_told_apart_by_both_intervals(
    fractions: tuple[tuple[int, int], tuple[int, int]], difference: tuple[float, float]
) -> None:
    one, other = Proportion(*fractions[0]), Proportion(*fractions[1])
    low, high = difference
    forth, back = TwoProportions("", (one, other)), TwoProportions("", (other, one))
    assert forth.difference == pytest.approx((low, high), abs=1e-4)
    assert back.difference == pytest.approx((-high, -low), abs=1e-4)
    assert forth.is_apart is back.is_apart is (low > 0.0)


@pytest.mark.parametrize("first", [True, False])
def test_a_campaign_of_no_flights_is_named(folder: Path, tmp_path: Path, first: bool) -> None:
    """Beside another one, too: it has no classes, and is not one of numbers for that."""
    empty = tmp_path / "none"
    empty.mkdir()
    write_rows(empty / ROWS, Seeded, Came, [], {})
    says = f"{empty}: a campaign of no flights"
    with pytest.raises(ReportError, match=says):
        report(empty)
    one, other = (empty, folder) if first else (folder, empty)
    words = ["campaign", "report", str(one), "--beside", str(other)]
    refused = CliRunner().invoke(app, words)
    assert refused.exit_code == 2
    assert says in refused.stderr


def test_any_class_may_be_asked_for(folder: Path, another: Path) -> None:
    two = beside(report(folder), report(another), "lost")
    assert [(row.name, *row.fractions) for row in two.rows] == [
        ("wind", (1, 3), (20, 20)),
        ("gust", (0, 1), (0, 1)),
    ]
    with pytest.raises(ReportError, match="--class gone: result is one of soaring, lost"):
        beside(report(folder), report(another), "gone")


def test_two_are_drawn(folder: Path, another: Path, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    two = beside(report(folder), report(another))
    two_campaigns_figure(tmp_path / "two.png", two, ("one", "another"))
    assert (tmp_path / "two.png").stat().st_size > 1000


def test_the_command_prints_two(folder: Path, another: Path, tmp_path: Path) -> None:
    words = ["campaign", "report", str(folder), "--beside", str(another)]
    done = CliRunner().invoke(app, [*words, "--figure", str(tmp_path / "two.png")])
    assert done.exit_code == 0, done.output
    assert "result soaring, by row" in done.stdout
    assert "alone: fault" in done.stdout
    assert (tmp_path / "two.png").stat().st_size > 1000
    refused = CliRunner().invoke(app, [*words, "--of", "error_m"])
    assert refused.exit_code == 2


def test_the_command_prints_it(folder: Path, tmp_path: Path) -> None:
    run = CliRunner()
    done = run.invoke(app, ["campaign", "report", str(folder), "--figure", str(tmp_path / "f.png")])
    assert done.exit_code == 0, done.output
    assert "result, by row" in done.stdout
    assert (tmp_path / "f.png").stat().st_size > 1000
    averaged = run.invoke(app, ["campaign", "report", str(folder), "--of", "error_m"])
    assert "1.5" in averaged.stdout
    refused = run.invoke(app, ["campaign", "report", str(folder), "--of", "wings"])
    assert refused.exit_code == 2
    assert "no column" in refused.stderr


def test_a_file_that_is_no_table_is_named(tmp_path: Path) -> None:
    """One that was cut off on its way from a cluster, among many."""
    path = tmp_path / ROWS
    path.write_bytes(b"PAR1 and no more")
    with pytest.raises(ReportError, match=rf"{ROWS}: no table of flights"):
        report(tmp_path)
