"""The page of the log's fields is printed by a command, and is the one that is there."""

from __future__ import annotations

from pathlib import Path

from tgl_soar.analysis.logs.meanings import page

PAGE = Path(__file__).parents[2] / "docs/logs.md"


def test_the_page_is_not_stale() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "stale: tgl-soar log fields > docs/logs.md"
