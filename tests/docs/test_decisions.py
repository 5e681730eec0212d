"""docs/decisions/: each page has its form and its row, and names what is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from benchmarks.shown import number

from tgl_soar.config.parameters import INDEX

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs" / "decisions"
PAGES = sorted(set(FOLDER.glob("*.md")) - {FOLDER / "index.md"})
PERFORMANCE = (ROOT / "docs" / "performance.md").read_text(encoding="utf-8")


def text_of(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def test_the_index_has_every_page_by_its_title() -> None:
    rows = re.findall(r"(?m)^\| \[(.+?)\]\((.+?)\) \| (.+) \|$", text_of(FOLDER / "index.md"))
    assert sorted(file for _, file, _ in rows) == [page.name for page in PAGES]
    for title, file, _ in rows:
        assert text_of(FOLDER / file).partition("\n")[0].removeprefix("# ").startswith(title)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_decision_is_short_and_has_its_three_parts(page: Path) -> None:
    text = text_of(page)
    assert re.findall(r"(?m)^## (.+)$", text) == ["Context", "Decision", "Consequences"]
    assert len(text.split()) < 400


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_what_a_decision_names_is_there(page: Path) -> None:
    text = text_of(page)
    files = re.findall(r"`((?:\w+/)+(?:\w+\.\w+)?)`", text)
    missing = [
        f for f in files if not ((ROOT / f).exists() or (ROOT / "src/tgl_soar" / f).exists())
    ]
    assert not missing
    parameters = set(re.findall(r"`(TGL_\w+)`", text))
    assert parameters <= set(INDEX)


@pytest.mark.parametrize(
    "page", [p for p in PAGES if "performance.md" in text_of(p)], ids=lambda page: page.stem
)
def test_the_rows_of_measurements_that_it_quotes_are_there(page: Path) -> None:
    """Figures move with the computer; the rows that a reader is sent to must not."""
    quoted = re.findall(r'"([^"]+)"', re.sub(r"\s+", " ", text_of(page)))
    assert [row for row in quoted if row.rstrip("… ") not in PERFORMANCE] == []


# What a decision says, and the row and column of docs/performance.md that it is, within what
# another run on another day may give.
QUOTED = (
    ("compiled-replay", r'one process" takes ([\d.]+) µs', "replay of a tick, one process", 1),
    ("compiled-replay", r'compiled before" ([\d.]+) µs', "replay of a tick, laws compiled", 1),
    ("compiled-replay", r"native tick takes some ([\d.]+) µs", "a tick, all of it, p50", 1),
    ("compilers", r"a tick takes some ([\d.]+) µs \(", "a tick, all of it, p50", 2),
    ("compilers", r"With mypyc a tick takes some ([\d.]+) µs", "a tick, all of it, p50", 1),
    ("compilers", r"runs at some ([\d.]+) × real time \(", "closed loop, nothing compiled", 1),
    ("compilers", r"runs at some ([\d,]+) × real time", "closed loop, all compiled", 1),
    ("pymavlink", r"takes some ([\d.]+) µs against", "reading ATTITUDE_QUATERNION", 1),
    ("pymavlink", r"against pymavlink's ([\d.]+);", "reading ATTITUDE_QUATERNION", 2),
    ("pymavlink", r'p50" some ([\d.]+) µs', "sensor to surface, UDP, p50", 1),
    ("two-processes", r"released ([\d.]+) ms", "surfaces released after: kill -9 of the fly", 1),
    ("two-processes", r"and ([\d.]+) ms", "surfaces released after: kill -9 of the watch", 1),
    ("ulog", r"is some ([\d.]+) µs", "what the flight log adds to a tick", 1),
    ("natnet", r"takes some ([\d.]+) µs", "a NatNet 3.1 frame, 50 bodies, 500 markers", 1),
)


@pytest.mark.parametrize(("page", "words", "row", "column"), QUOTED)
def test_a_figure_that_a_decision_quotes_is_that_of_its_row(
    page: str, words: str, row: str, column: int
) -> None:
    text = re.sub(r"\s+", " ", text_of(FOLDER / f"{page}.md"))
    interpreted = "the same, interpreted" if column == 2 and row.startswith("a tick") else ""
    cells = next(
        line.split("|")[1:]
        for line in PERFORMANCE.splitlines()
        if line.startswith(f"| {row}") and interpreted in line
    )
    quoted = re.search(words, text)
    assert quoted
    assert number(quoted[1]) == pytest.approx(number(cells[column].split()[0]), rel=0.25)
