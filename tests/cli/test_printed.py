"""Commands print what they printed (`printed.py`)."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from printed import COMMANDS, KEPT, differences, files, printed

FOUND = json.loads(KEPT.read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_prints_what_it_printed(name: str, tmp_path: Path) -> None:
    changed = differences(FOUND[name], printed(COMMANDS[name], files(tmp_path)))
    assert not changed, "meant? python tests/cli/printed.py"


def test_all_are_kept_and_no_others() -> None:
    assert list(FOUND) == list(COMMANDS)


def test_rounding_is_no_difference_and_words_are() -> None:
    assert not differences("a 1.23 m", "a  1.24 m")
    assert differences("a 1.23 m", "a 1.26 m")
    assert differences("a 1.23 m", "a 1.23 s")
    assert differences("a -1.23", "a 1.23")
    assert differences("a 12", "a 13")
    assert differences("a", "a\nb")
