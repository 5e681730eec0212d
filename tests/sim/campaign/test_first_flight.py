"""The first flights of processes that begin at once."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from subprocess import PIPE

import pytest

from tgl_soar.sim.campaign import first_flight

# One of them is slow: the others find what it has left.
FIRST = """
import sys, time
from pathlib import Path
from tgl_soar.sim.campaign.first_flight import compiling_alone
kept = Path(sys.argv[1])
print("there", flush=True)
sys.stdin.readline()
with compiling_alone():
    found = kept.exists()
    if not found:
        time.sleep(0.3)
        kept.touch()
with compiling_alone():  # once more: nothing is waited for
    pass
print(found)
"""


def test_of_processes_that_begin_at_once_one_compiles(tmp_path: Path) -> None:
    words = [sys.executable, "-c", FIRST, str(tmp_path / "kept")]
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
    with ExitStack() as running:
        each = [
            running.enter_context(
                subprocess.Popen(
                    words, env=environment, stdin=PIPE, stdout=PIPE, text=True, bufsize=1
                )
            )
            for _ in range(3)
        ]
        for process in each:
            assert process.stdout is not None
            assert process.stdout.readline() == "there\n"
        for process in each:
            assert process.stdin is not None
            process.stdin.write("\n")
            process.stdin.flush()
        found = [process.communicate(timeout=60.0)[0].split()[-1] for process in each]
    assert sorted(found) == ["False", "True", "True"]


def test_where_nothing_can_be_kept_each_compiles_for_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(first_flight, "_has_flown", False)
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))  # no folder can be made there
    with first_flight.compiling_alone():
        assert not first_flight._has_flown
    assert first_flight._has_flown


def test_without_a_home_each_compiles_for_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    def nobody() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(first_flight, "_has_flown", False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", nobody)
    with first_flight.compiling_alone():
        assert not first_flight._has_flown
    assert first_flight._has_flown
