"""A campaign's report, one number after the other: quantiles, groups at most, which columns are
looked at by default, and how a value is called."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from math import inf, isnan, nan, sqrt
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from tgl_soar.analysis.campaigns.report import (
    FlightGroup,
    Report,
    ReportError,
    beside,
    report,
    rows_file,
)
from tgl_soar.sim.campaign.folder import ROWS
from tgl_soar.sim.campaign.rows import write_rows

pytest.importorskip("pyarrow")


class Job(NamedTuple):
    """A job without a description."""

    seed: int


def table(folder: Path, came: Sequence[NamedTuple]) -> Path:
    """A campaign's folder with these flights."""
    folder.mkdir(exist_ok=True)
    pairs = ((Job(n), flight) for n, flight in enumerate(came))
    write_rows(folder / ROWS, Job, type(came[0]), pairs, {})
    return folder


# --- numbers of a group ---------------------------------------------------------------------------


def test_a_spread_is_of_what_is_known() -> None:
    """0 to 100: of these 5, 50 and 95 are the quantiles; what is not finite is counted alone."""
    known = [float(n) for n in range(101)]
    group = FlightGroup("g", numbers=[nan, *known, inf, -inf])
    spread = group.spread()
    assert (group.flights, spread.flights, spread.unknown) == (104, 104, 3)
    assert spread.mean == pytest.approx(50.0)
    assert spread.deviation == pytest.approx(sqrt((101.0**2 - 1.0) / 12.0))
    assert spread.quantiles == pytest.approx((5.0, 50.0, 95.0))


def test_a_group_without_a_number_has_no_spread() -> None:
    spread = FlightGroup("g", numbers=[nan, nan]).spread()
    assert (spread.flights, spread.unknown) == (2, 2)
    assert all(isnan(each) for each in (spread.mean, spread.deviation, *spread.quantiles))
    assert FlightGroup("g", classes=Counter(a=2, b=1)).flights == 3


def test_classes_stand_by_how_often_they_are_in_all_groups() -> None:
    groups = [
        FlightGroup("one", classes=Counter(rare=2, often=1)),
        FlightGroup("two", classes=Counter(often=4)),
    ]
    found = Report("by", "of", groups)
    assert found.is_counted
    assert found.classes == ["often", "rare"]
    assert Report("by", "of", [FlightGroup("n", numbers=[1.0]), groups[0]]).is_counted
    assert not Report("by", "of", [FlightGroup("n", numbers=[1.0])]).is_counted


# --- which columns --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("gone", "by", "of"),
    [
        (0, "row", "result"),
        (1, "kind", "ended"),
        (2, "place", "up"),
        (3, "scenario_title", "rms_e_rho_m"),
        (4, "", "alpha"),
    ],
)
def test_the_first_of_the_usual_columns_is_looked_at(
    tmp_path: Path, gone: int, by: str, of: str
) -> None:
    """However many of them a table has not; they stand in it the other way round."""
    by_columns: list[tuple[str, Any, Any]] = [
        (name, str, "x") for name in ("row", "kind", "place", "scenario_title")
    ]
    of_columns: list[tuple[str, Any, Any]] = [
        ("result", str, "x"), ("ended", str, "x"), ("up", bool, True), ("rms_e_rho_m", float, 1.0),
        ("alpha", float, 1.0),
    ]  # fmt: skip
    columns = [*by_columns[gone:], *of_columns[gone:]][::-1]
    make: Any = NamedTuple
    kind = make("kind", [(name, type_) for name, type_, _ in columns])
    found = report(table(tmp_path / "t", [kind(**{name: value for name, _, value in columns})]))
    assert (found.by, found.of) == (by, of)
    (group,) = found.groups
    assert group.name == ("x" if by else "all")


class Odd(NamedTuple):
    """None of the usual columns."""

    first: int
    text: str


def test_without_a_usual_column_all_are_one_group_of_the_first_number_or_text(
    tmp_path: Path,
) -> None:
    found = report(table(tmp_path, [Odd(3, "a"), Odd(5, "a")]))
    assert found.by == ""
    assert found.of != "flight"  # which flight it was is no result
    with pytest.raises(ReportError, match="--by flight: no column of"):
        report(tmp_path, "flight")
    first = report(tmp_path, of="first")
    (group,) = first.groups
    assert (group.name, group.numbers) == ("all", [3.0, 5.0])


def test_by_the_column_that_is_looked_at_there_is_one_group(tmp_path: Path) -> None:
    table(tmp_path, [Odd(3, "a"), Odd(5, "b")])
    found = report(tmp_path, "text", "text")
    assert found.by == ""
    assert [(group.name, dict(group.classes)) for group in found.groups] == [
        ("all", {"a": 1, "b": 1})
    ]


class Maybe(NamedTuple):
    """Values that may be missing."""

    well: bool
    text: str
    number: float | None


def test_a_value_is_called_by_a_word_and_a_missing_one_by_a_dash(tmp_path: Path) -> None:
    table(tmp_path, [Maybe(True, "", 1.0), Maybe(False, "a", None), Maybe(True, "a", 3.0)])
    assert [group.name for group in report(tmp_path, "well", "text").groups] == ["yes", "no"]
    assert [group.name for group in report(tmp_path, "text", "well").groups] == ["–", "a"]
    assert [group.name for group in report(tmp_path, "number", "well").groups] == [
        "1.0",
        "–",
        "3.0",
    ]
    missing, whole = (report(tmp_path, "text", "number").groups[n] for n in (1, 0))
    assert missing.spread()[:3] == (2, 1, 3.0)
    assert whole.spread()[:3] == (1, 0, 1.0)


@pytest.mark.parametrize(("count", "many"), [(200, False), (201, True)])
def test_more_than_two_hundred_groups_are_none(tmp_path: Path, count: int, many: bool) -> None:
    table(tmp_path, [Odd(n, f"{n % 2}") for n in range(count)])
    if many:
        with pytest.raises(ReportError, match=r"^--by first: more than 200 groups$"):
            report(tmp_path, "first", "text")
    else:
        assert len(report(tmp_path, "first", "text").groups) == 200


# --- files ----------------------------------------------------------------------------------------


def test_a_folder_or_the_file_itself_may_be_named(tmp_path: Path) -> None:
    table(tmp_path / "there", [Odd(1, "a")])
    file = tmp_path / "there" / ROWS
    assert rows_file(tmp_path / "there") == rows_file(file) == file
    with pytest.raises(ReportError, match=rf"^{tmp_path}: no {ROWS} is there: name a campaign's"):
        rows_file(tmp_path)
    with pytest.raises(ReportError, match=rf"{ROWS} is there"):
        rows_file(tmp_path / "gone.parquet")


# --- two campaigns --------------------------------------------------------------------------------


def counted(*groups: tuple[str, dict[str, int]]) -> Report:
    return Report("row", "result", [FlightGroup(name, Counter(found)) for name, found in groups])


def test_of_two_campaigns_the_firsts_most_frequent_class_is_counted() -> None:
    """In groups that both have, in the first's order; a class that one never has counts 0 there."""
    one = counted(("b", {"up": 3, "lost": 1}), ("a", {"up": 2}), ("own", {"lost": 1}))
    other = counted(("a", {"lost": 5}), ("b", {"lost": 1, "up": 1}), ("else", {"up": 1}))
    two = beside(one, other)
    assert two.counted == "up"
    assert [(row.name, *row.fractions) for row in two.rows] == [
        ("b", (3, 4), (1, 2)), ("a", (2, 2), (0, 5)),
    ]  # fmt: skip
    assert two.alone == (["own"], ["else"])
    assert beside(other, one).counted == "lost"


def test_a_class_of_the_second_alone_may_be_asked_for() -> None:
    two = beside(counted(("a", {"up": 2})), counted(("a", {"burnt": 1, "up": 1})), "burnt")
    assert [row.fractions for row in two.rows] == [((0, 2), (1, 2))]


def test_two_campaigns_without_a_group_in_common_are_refused() -> None:
    one, other = counted(("a", {"up": 2})), counted(("b", {"up": 2}))
    with pytest.raises(ReportError, match=r"^--by row: the two campaigns have no group in common$"):
        beside(one, other)
    numbers = Report("row", "result", [FlightGroup("a", numbers=[1.0])])
    for first, second in ((one, numbers), (numbers, one)):
        with pytest.raises(ReportError, match=r"^--of result: numbers, and two campaigns"):
            beside(first, second)
