"""The table of what really happened, on a disk that has become full."""

from __future__ import annotations

from pathlib import Path

import pytest

from tgl_soar.sim.truth_log import TruthLog, TruthLogError

FULL = Path("/dev/full")  # takes a file's beginning, and nothing that is written to it
REFUSED = "/dev/full: cannot be written: No space left on device"


def test_a_full_disk_is_reported_once_and_what_is_closed_then_stays_so() -> None:
    log = TruthLog(FULL, ["time_s", "x_m"])

    def fill() -> None:
        for i in range(10_000):
            log.add((0.005 * i, 1.0 / 3.0))

    with pytest.raises(TruthLogError, match=REFUSED):
        fill()
    log.close()


def test_a_full_disk_that_only_the_end_finds_is_reported_there() -> None:
    log = TruthLog(FULL, ["time_s"])
    log.add((0.0,))
    with pytest.raises(TruthLogError, match=REFUSED):
        log.close()
    log.close()
