"""The page of performance is of the benchmarks that there are, and says itself what it misses."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import NamedTuple

import pytest
from benchmarks.__main__ import GROUPS
from benchmarks.closed_loop import LOOP_TIMES, POINT_MASS_TIMES
from benchmarks.page import (
    BEGIN,
    END,
    HEADLINES,
    MISSED,
    MISSED_BEGIN,
    MISSED_END,
    PACKAGES,
    Group,
    markdown,
    missed,
)
from benchmarks.result import Result
from benchmarks.shown import number, shown

import tgl_soar

ROOT = Path(__file__).parents[2]
LATE = Result(what="a wake-up", value=30.0, reference=20.0, unit="µs", reference_what="C", aim=1.3)
MAKE = 'make bench ARGS="--page docs/performance.md --readme README.md"'


class Row(NamedTuple):
    """One row of a table, as printed."""

    what: str
    ratio: float
    aim: str

    @property
    def is_honest(self) -> bool:
        """Whether a missed aim says so, and a met one does not."""
        if not self.aim:
            return True
        aim = number(self.aim.removeprefix("≤ ").removesuffix(MISSED))
        # Three digits are printed of either: what lies within a digit may be on either side.
        if abs(self.ratio - aim) <= 0.005 * aim:
            return True
        return (self.ratio > aim) == self.aim.endswith(MISSED)


def rows_of(text: str) -> list[Row]:
    rows = [line.split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return [
        Row(cells[0].removeprefix("| "), number(cells[4]), cells[5].removesuffix("|").strip())
        for cells in rows
        if len(cells) == 6 and cells[1] != "measured"
    ]


@pytest.fixture(scope="module")
def results() -> str:
    text = (ROOT / "docs/performance.md").read_text(encoding="utf-8")
    return text.partition(BEGIN)[2].partition(END)[0]


def test_every_group_of_benchmarks_is_on_the_page_in_order(results: str) -> None:
    titles = re.findall(r"^### (.+)$", results, flags=re.MULTILINE)
    text = (ROOT / "docs/performance.md").read_text(encoding="utf-8")
    unmeasured = re.findall(r"^Not measured here yet: (.+)\.$", text, flags=re.MULTILINE)
    there = [title for title, _ in GROUPS.values()]
    assert titles == [title for title in there if title not in unmeasured], f"stale: {MAKE}"
    assert set(unmeasured) <= set(there)


# Of the ten minutes that `--long` adds, which the page does not show.
NOT_SHOWN = "long_run"


def pattern_of(node: ast.AST) -> str:
    """What a string of the source may be; empty for what is none, or says next to nothing."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return re.escape(node.value) if len(node.value) >= 4 else ""
    if not isinstance(node, ast.JoinedStr):
        return ""
    return "".join(
        re.escape(str(part.value)) if isinstance(part, ast.Constant) else ".+"
        for part in node.values
    )


def measured_by(text: str) -> tuple[set[str], set[str]]:
    """Of a benchmark's source: the rows that it names itself, and where others are named
    elsewhere in it, all that they may be."""
    tree = ast.parse(text)
    calls = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "Result"
    ]
    whats = [
        [*call.args, *(k.value for k in call.keywords if k.arg == "what")][0] for call in calls
    ]
    own = {pattern_of(what) for what in whats}
    others = {pattern_of(node) for node in ast.walk(tree)} if "" in own else set()
    return own - {""}, others - {""}


def test_every_figure_that_is_measured_has_its_row_and_every_row_its_benchmark(
    results: str,
) -> None:
    rows = {row.what for row in rows_of(results)}
    found = {
        file.stem: measured_by(file.read_text(encoding="utf-8"))
        for file in (ROOT / "benchmarks").glob("*.py")
    }
    own = {each for name, (named, _) in found.items() if name != NOT_SHOWN for each in named}
    every = {each for both in found.values() for patterns in both for each in patterns}
    assert len(own) > 40
    assert [p for p in own if not any(re.fullmatch(p, row) for row in rows)] == [], f"stale: {MAKE}"
    assert [row for row in rows if not any(re.fullmatch(p, row) for p in every)] == []


def test_what_a_benchmark_measures_is_read_from_its_source() -> None:
    direct = 'Result("one tick", 1.0), Result(what=f"a {kind} tick, p99", value=2.0)'
    assert measured_by(direct) == ({"one\\ tick", "a\\ .+\\ tick,\\ p99"}, set())
    own, others = measured_by('ROWS = ("the other",)\nResult(what, 1.0)')
    assert (own, others) == (set(), {"the\\ other"})


def test_it_was_measured_with_what_is_pinned(results: str) -> None:
    pinned = dict(
        line.split("==")
        for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").split()
        if "==" in line
    )
    pinned["tgl_soar"] = tgl_soar.__version__
    for name in PACKAGES:
        (version,) = re.findall(rf" {name} ([^,;]+?)[,.]?(?:,|\.\n|$)", results.split("###")[0])
        assert version == pinned[name], f"{name}; stale: {MAKE}"


def test_an_aim_that_is_missed_says_so_on_the_page(results: str) -> None:
    rows = rows_of(results)
    assert len(rows) > 80
    assert [row for row in rows if not row.is_honest] == []


# What the prose takes from the tables: a row, what it stands beside, and how figures are written.
QUOTED = (
    ("a tick after 5 ms of sleep, p50", "one right after the other", "{ratio:.1f} times as long"),
    ("the flying process, UDP", "what is allowed", "take {value} % of a core in the table"),
    ("sensor to surface, UDP, p50", "a minimal responder with mavutil", "answer of {beside} µs"),
    (
        "sensor to surface, UDP, --power-saving, p50",
        "a minimal responder in C that sleeps",
        "answers in {ratio} × the time of C",
    ),
    ("writing RC_CHANNELS_OVERRIDE", "MAVLink's C library", "takes {value} µs, {ratio:.0f} times"),
    ("a set, to its confirmation", "pymavlink parses the PARAM_SET", "takes {value} µs to its"),
)


@pytest.mark.parametrize(("what", "beside_what", "words"), QUOTED)
def test_prose_has_the_figures_of_the_tables(
    results: str, what: str, beside_what: str, words: str
) -> None:
    text = (ROOT / "docs/performance.md").read_text(encoding="utf-8")
    prose = " ".join((text.partition(BEGIN)[0] + text.partition(END)[2]).split())
    rows = [line.strip("| ").split(" | ") for line in results.splitlines()]
    ((value, beside, ratio),) = {
        (row[1].split()[0], row[2].split()[0], number(row[4].strip(" |")))
        for row in rows
        if (row[0], row[3:4]) == (what, [beside_what])
    }
    assert words.format(value=value, beside=beside, ratio=ratio) in prose


def test_prose_says_what_power_saving_takes_and_what_is_asked_of_simulations(results: str) -> None:
    text = " ".join((ROOT / "docs/performance.md").read_text(encoding="utf-8").split())
    took = [
        float(re.findall(rf"the flying process, {kind} \| ([0-9.]+) %", results)[0])
        for kind in ("UDP", "UDP, --power-saving")
    ]
    assert f"takes {100 * (1 - took[1] / took[0]):.0f} % less" in text
    read, wrote = (
        float(re.findall(rf"of a tick: {part} \| ([0-9.]+) µs", results)[0])
        for part in ("decode", "encode")
    )
    assert f"frames of a tick take {read + wrote:.2f} µs together" in text
    asked = [f"{times:,.0f} ×" for times in (LOOP_TIMES, POINT_MASS_TIMES)]
    assert f"where {asked[0]} are asked of the whole loop and {asked[1]} of the point mass" in text
    for what in ("the closed loop, all compiled", "the point mass, 200 steps a second"):
        assert f"| a second of {what} |" in results


def test_a_row_is_read_as_it_is_written() -> None:
    """A page edited by hand, or an aim changed in it, is found out."""
    missed = LATE
    met = missed._replace(value=20.0)
    written = markdown((Group("On time", [missed, met]),))
    assert [row.is_honest for row in rows_of(written)] == [True, True]
    assert [row.is_honest for row in rows_of(written.replace(MISSED, ""))] == [False, True]
    assert [row.is_honest for row in rows_of(written.replace("≤ 1.3 |", "≤ 0.9 |"))] == [
        True,
        False,
    ]


def test_the_readme_lists_the_missed_aims_of_the_page() -> None:
    page = (ROOT / "docs/performance.md").read_text(encoding="utf-8")
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    listed = readme.partition(MISSED_BEGIN)[2].partition(MISSED_END)[0].strip()
    assert listed == missed(page), f"stale: {MAKE}"
    rows = listed.partition("| missed or met |")[2].splitlines()[2:]
    assert [row.split(" | ")[0].removeprefix("| ") for row in rows] == [w for w, _ in HEADLINES]


def test_missed_aims_are_counted_by_part_with_the_worst() -> None:
    late = LATE
    met, aimless = late._replace(value=20.0), late._replace(aim=float("inf"))
    # 1.4 of what is wanted is worse than 1.5 / 1.3 of it, though its ratio is smaller.
    worst = late._replace(what="a frame", value=14.0, reference=10.0, aim=1.0)
    groups = (Group("On time", [late, met, aimless, worst]), Group("The laws", [met]))
    text = missed(markdown(groups))
    assert text.startswith("2 of the 4 aims of ")
    rows = text.splitlines()[-1:]
    assert rows == ["| On time | 2 of 3 | a frame: 1.4 × C (≤ 1) |"]
    assert "The laws" not in text
    assert missed(markdown((Group("On time", [met]),))).endswith("are missed.")


def test_what_counts_most_is_reported_whether_missed_or_met() -> None:
    what, beside = HEADLINES[0]
    first = LATE._replace(what=what, reference_what=beside)
    other = first._replace(what=HEADLINES[1][0], value=20.0)
    text = missed(markdown((Group("On time", [first, other, LATE]),)))
    assert text.splitlines()[-2:] == [
        f"| {what} | 30 µs | 1.5 × {beside} | ≤ 1.3{MISSED} |",
        f"| {HEADLINES[1][0]} | 20 µs | 1 × {beside} | ≤ 1.3 |",
    ]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (1089.6, "1,090"),
        (19_600.0, "19,600"),
        (999.9, "1,000"),
        (999.4, "999"),
        (0.003764, "0.00376"),
        (1.0, "1"),
        (20.0, "20"),
        (-1234.0, "-1,230"),
    ],
)
def test_a_figure_has_three_digits_and_no_exponent(value: float, text: str) -> None:
    assert shown(value) == text
    assert number(text) == pytest.approx(value, rel=5e-3)


def test_no_table_has_an_exponent() -> None:
    for page in ("README.md", "docs/performance.md"):
        assert not re.search(r"\d[eE]\+?\d", (ROOT / page).read_text(encoding="utf-8")), page
