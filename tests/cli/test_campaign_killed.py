"""The campaign of faults itself, compiled, killed at random moments and gone on with."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tgl_soar.sim.campaign.folder import JOURNAL, ROWS

FLIGHTS, KILLS = 500, 10
COMMAND = ("campaign", "faults", "--flights", str(FLIGHTS), "--dropouts", "0", "--workers", "2")


def started(out: Path, *options: str) -> subprocess.Popen[bytes]:
    """In a group of processes of its own."""
    words = [sys.executable, "-m", "tgl_soar.cli", *COMMAND, "--out", str(out), *options]
    return subprocess.Popen(
        words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )


@pytest.mark.long
def test_killed_ten_times_its_rows_are_those_of_one_that_never_was(tmp_path: Path) -> None:
    duckdb = pytest.importorskip("duckdb")
    pytest.importorskip("numba")
    never, killed = tmp_path / "never", tmp_path / "killed"
    assert started(never, "--dispersion").wait(1200) == 0
    draw, kills, options = random.Random(10), 0, ["--dispersion"]
    while True:
        process = started(killed, *options)
        try:
            # Beginning takes some seconds, the flights some more: at any moment of either.
            code = process.wait(draw.uniform(1.0, 10.0) if kills < KILLS else 1200)
        except subprocess.TimeoutExpired:
            # All at once, as when the computer's power fails; or the parent alone.
            if draw.random() < 0.5:
                os.killpg(process.pid, signal.SIGKILL)
            process.kill()
            process.wait()
            kills += 1
            if (killed / JOURNAL).exists() and "--resume" not in options:
                options.append("--resume")
            continue
        assert code == 0, f"after {kills} kills"
        break
    assert kills == KILLS
    tables = [duckdb.sql(f"select * from '{path / ROWS}'").fetchall() for path in (never, killed)]
    assert len(tables[0]) == FLIGHTS
    assert tables[0] == tables[1]
