"""docs/decisions/: each page has its form and its row, and names what is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

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
