"""A line on the console: whole, as bytes, and none without a reader."""

from __future__ import annotations

import os
import select
from typing import Any

import pytest

from tgl_soar.onboard.console import say

# The descriptor of standard error is put in the place of the real one.
pytestmark = pytest.mark.interpreted


class Console:
    """Standard error."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.lines: list[bytes] = []
        self.is_ready = True
        self.is_gone = False
        self.waits: list[float] = []
        monkeypatch.setattr(select, "select", self._select)
        monkeypatch.setattr(os, "write", self._write)

    def _select(self, reads: Any, writes: list[int], errors: Any, wait_s: float) -> Any:
        assert (reads, writes, errors) == ([], [2], [])
        self.waits.append(wait_s)
        return [], writes if self.is_ready else [], []

    def _write(self, fd: int, data: bytes) -> int:
        assert fd == 2
        if self.is_gone:
            raise BrokenPipeError
        self.lines.append(data)
        return len(data)


@pytest.fixture
def console(monkeypatch: pytest.MonkeyPatch) -> Console:
    return Console(monkeypatch)


def test_a_line_says_whose_it_is_and_waits_for_nobody(console: Console) -> None:
    say("up")
    assert console.lines == [b"tgl_soar: up\n"]
    assert console.waits == [0.0]


def test_where_nobody_reads_it_there_is_none(console: Console) -> None:
    console.is_ready = False
    say("up")
    assert console.lines == []


def test_a_console_that_has_gone_stops_nothing(console: Console) -> None:
    console.is_gone = True
    say("up")
    assert console.lines == []


def test_a_line_that_a_pipe_would_not_take_at_once_is_cut_and_odd_names_are_replaced(
    console: Console,
) -> None:
    say("x" * 10_000)
    say("\udcff.toml")
    assert len(console.lines[0]) == select.PIPE_BUF
    assert console.lines[1] == b"tgl_soar: ?.toml\n"
