"""docs/modes.md is the table's own page."""

from __future__ import annotations

from pathlib import Path

from typer.testing import CliRunner

from tgl_soar.cli.app import app
from tgl_soar.cli.modes import MAKE, page
from tgl_soar.control.supervisor import TRANSITIONS
from tgl_soar.control.supervisor_texts import CONDITION_TEXTS, MODE_NAMES, REASON_TEXTS

PAGE = Path(__file__).parents[2] / "docs/modes.md"


def test_the_page_is_not_stale() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), f"stale: {MAKE}"


def test_the_command_prints_it() -> None:
    result = CliRunner().invoke(app, ["modes"])
    assert (result.exit_code, result.stdout) == (0, page())


def test_every_row_condition_and_word_of_the_table_is_there() -> None:
    text = page()
    rows = [line for line in text.splitlines() if line.startswith("| ") and line.count("|") == 6]
    assert len(rows) == len(TRANSITIONS) + sum(
        any(row.source == mode for row in TRANSITIONS) for mode in range(len(MODE_NAMES))
    )  # and a head for every mode that has any
    used = 0
    for row in TRANSITIONS:
        used |= row.all_of | row.none_of
    assert all(words in text for i, words in enumerate(CONDITION_TEXTS) if used >> i & 1)
    assert all(words in text for words in REASON_TEXTS)
