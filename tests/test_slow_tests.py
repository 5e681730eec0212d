"""Which tests `make test`, `make ci` and `make all` run."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from slow_tests import GROUPS, PARTS, chosen, part_of

TESTS = Path(__file__).parent
NAMES = tuple(PARTS)


def test_every_file_is_there_and_of_one_part() -> None:
    files = [file for part in PARTS.values() for file in part]
    assert not [file for file in files if not (TESTS / file).is_file()]
    assert len(files) == len(set(files))
    assert set(GROUPS.values()) <= set(PARTS)


def test_a_file_or_a_group_is_of_a_part_and_all_else_is_quick() -> None:
    assert part_of("control/test_brake_watch.py", "control/test_brake_watch.py") == "laws"
    assert part_of("sim/test_sitl.py", "real time") == "processes"
    assert part_of("control/test_pid.py", "control/test_pid.py") == ""


def test_commits_take_turns() -> None:
    assert chosen("all") == NAMES
    assert chosen("none") == ()
    assert [chosen(f"turn:{n:040x}") for n in range(7)] == [
        (NAMES[n % len(NAMES)],) for n in range(7)
    ]
    assert chosen("turn:") == NAMES[:1]  # no repository
    assert chosen("people,laws") == ("people", "laws")
    with pytest.raises(pytest.UsageError, match=r"laws,pages: pages is none of all, .*, laws, "):
        chosen("laws,pages")


def test_what_is_not_asked_for_is_left_out() -> None:
    """By the very hook of all tests, in a run that only lists them."""
    files = {
        "quick": "tests/control/test_pid.py",
        "laws": "tests/sim/bridge/test_bridge.py",
        "people": "tests/cli/test_help.py",
    }
    command = [sys.executable, "-m", "pytest", "--collect-only", "--later", "laws", *files.values()]
    found = subprocess.run(command, cwd=TESTS.parent, capture_output=True, text=True, check=True)
    listed = {part for part, file in files.items() if file in found.stdout}
    assert listed == {"quick", "laws"}
    assert "the quick tests, and laws (tests/slow_tests.py)" in found.stdout
