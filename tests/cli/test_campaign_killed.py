"""The campaign of faults itself, compiled, killed at random moments and gone on with."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tgl_soar.sim.campaign.folder import JOURNAL, MANIFEST, ROWS

FLIGHTS, KILLS, BEFORE_ANY = 500, 10, 2
COMMAND = ("campaign", "faults", "--flights", str(FLIGHTS), "--dropouts", "0", "--workers", "2")


def started(out: Path, *options: str) -> subprocess.Popen[bytes]:
    """In a group of processes of its own."""
    words = [sys.executable, "-m", "tgl_soar.cli", *COMMAND, "--out", str(out), *options]
    return subprocess.Popen(
        words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )


def kept(folder: Path) -> int:
    """Bytes of flights that lie there."""
    journal = folder / JOURNAL
    return journal.stat().st_size if journal.exists() else 0


def killed_within(process: subprocess.Popen[bytes], folder: Path, draw: random.Random) -> None:
    """Kill it once it has kept some more flights."""
    before, deadline = kept(folder), time.monotonic() + 600.0
    while kept(folder) <= before:
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)
    time.sleep(draw.uniform(0.0, 0.5))
    kill(process, draw)


def kill(process: subprocess.Popen[bytes], draw: random.Random) -> None:
    """All at once, as when the computer's power fails; or the parent alone."""
    if draw.random() < 0.5:
        os.killpg(process.pid, signal.SIGKILL)
    process.kill()
    process.wait()


@pytest.mark.long
def test_killed_ten_times_its_rows_are_those_of_one_that_never_was(tmp_path: Path) -> None:
    duckdb = pytest.importorskip("duckdb")
    pytest.importorskip("numba")
    never, killed = tmp_path / "never", tmp_path / "killed"
    assert started(never, "--dispersion").wait(1200) == 0
    draw = random.Random(10)
    for i in range(KILLS):
        process = started(killed, "--dispersion", *(["--resume"] if kept(killed) else []))
        if i % (KILLS // BEFORE_ANY) == 1:  # while it begins
            time.sleep(draw.uniform(0.5, 3.0))
            kill(process, draw)
        else:
            killed_within(process, killed, draw)
    assert started(killed, "--dispersion", "--resume").wait(1200) == 0
    runs = json.loads((killed / MANIFEST).read_text(encoding="utf-8"))["runs"]
    begun = [run["from"] for run in runs]
    assert len({each for each in begun if each > 0}) >= KILLS // 2
    tables = [duckdb.sql(f"select * from '{path / ROWS}'").fetchall() for path in (never, killed)]
    assert len(tables[0]) == FLIGHTS
    assert tables[0] == tables[1]
