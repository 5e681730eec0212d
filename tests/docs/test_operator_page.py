"""docs/operator.md: the names and numbers in it are those of the code."""

from __future__ import annotations

import re
from pathlib import Path

from tgl_soar.config.parameters import INDEX
from tgl_soar.control.supervisor import ENTRY
from tgl_soar.control.supervisor_texts import CONDITION_TEXTS, MODE_NAMES
from tgl_soar.estimation.health import DISARMED, FAULT_TEXTS
from tgl_soar.onboard.process import EXIT_CANNOT_START, EXIT_LINK_NOT_READY
from tgl_soar.onboard.telemetry_values import FAST, HELD_BACK, SLOW
from tgl_soar.onboard.watchdog import EXIT_KEEPS_DYING, HANGS_FLYING_S, RESTARTS

PAGE = (Path(__file__).parents[2] / "docs" / "operator.md").read_text(encoding="utf-8")
OF_OTHERS = {"RC_OVERRIDE_TIME", "RC_CHANNELS"}


def test_every_fault_of_a_stream_has_its_row() -> None:
    table = PAGE.partition("| in `faults` | |")[2].partition("\n\n")[0]
    rows = re.findall(r"^\| (\d+) \| (.*) \|$", table, re.MULTILINE)
    assert rows == [(str(1 << i), words) for i, words in enumerate(FAULT_TEXTS)]
    assert f"`faults` is 0, or {DISARMED} as long as it is disarmed" in PAGE
    assert 1 << len(FAULT_TEXTS) <= 1 << 24  # a float of 32 bits holds every sum exactly


def test_every_entry_check_has_its_row() -> None:
    table = PAGE.partition("| in `entry` | what does not hold |")[2].partition("\n\n")[0]
    rows = re.findall(r"^\| (\d+) \| (.*) \|$", table, re.MULTILINE)
    checks = [(1 << i, text) for i, text in enumerate(CONDITION_TEXTS) if ENTRY >> i & 1]
    assert rows[0][0] == str(HELD_BACK)
    assert rows[1:] == [(str(bit), words) for bit, words in checks]
    assert not ENTRY & HELD_BACK
    assert ENTRY < 1 << 24  # a float of 32 bits holds every sum exactly


def test_every_number_that_is_reported_has_its_row() -> None:
    table = PAGE.partition("| `NAMED_VALUE_FLOAT` | unit | |")[2].partition("\n\n")[0]
    first_cells = "".join(row.split("|")[1] for row in table.splitlines() if row)
    assert sorted(re.findall(r"`(\w+)`", first_cells)) == sorted([*FAST, *SLOW])
    assert ", ".join(f"{i} {name}" for i, name in enumerate(MODE_NAMES)) in table


def test_the_session_shows_the_parameters_that_there_are() -> None:
    assert not re.findall(r"\d+ parameters", PAGE)  # a count would be stale with the next one
    session = PAGE.partition("param show TGL_*")[2]
    listed = re.findall(r"^    (TGL_\w+) +-?\d", session, re.MULTILINE)
    of_the_line = sorted(name for name in INDEX if name.startswith("TGL_"))
    assert listed[: len(of_the_line)] == of_the_line


def test_the_parameters_that_it_names_exist() -> None:
    named = set(re.findall(r"`((?:OP|TGL|TEL|CLEAR|FENCE|RC)_[A-Z_]+[A-Z])`", PAGE))
    assert len(named) > 5
    assert {name for name in named if name not in INDEX} <= OF_OTHERS


def test_what_the_guard_does_is_reported_with_its_numbers() -> None:
    service = PAGE.partition("## As a service")[2].partition("\n## ")[0]
    assert RESTARTS == 5
    assert "After five new starts within a minute it gives up" in " ".join(service.split())
    for words in (
        f"stands still for {HANGS_FLYING_S:g} s with the surfaces",
        f"it gives up (exit code {EXIT_KEEPS_DYING})",
        f"exit code {EXIT_CANNOT_START} and is not tried again",
        f"is not up yet (exit code {EXIT_LINK_NOT_READY})",
        "config/systemd/tgl-soar.service",
    ):
        assert words in " ".join(service.split())
