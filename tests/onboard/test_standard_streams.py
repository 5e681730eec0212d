"""A process that is started with closed descriptors writes nothing into its links."""

from __future__ import annotations

import os
import pty
import shlex
import subprocess
import sys
import tty
from pathlib import Path

import pytest

from tgl_soar.link.decoder import Decoder

ROOT = Path(__file__).parents[2]
FILES = ["--airframe", ROOT / "config/airframes/eclipson_c.toml"]
FILES += ["--site", ROOT / "config/sites/tunnel.toml"]


@pytest.mark.parametrize("closed", ["2>&-", "<&- >&- 2>&-"])
@pytest.mark.parametrize("watched", [True, False])
def test_no_words_for_the_console_go_into_the_serial_line(
    closed: str, watched: bool, tmp_path: Path
) -> None:
    far, near = pty.openpty()
    tty.setraw(near)
    device = tmp_path / "ttyTEST"
    device.symlink_to(os.ttyname(near))
    os.set_blocking(far, False)
    flight = [sys.executable, "-m", "tgl_soar.cli", "run", *map(str, FILES), "--state", "none"]
    flight += ["--link", f"serial:{device}", "--timeout", "0.3"]
    flight += [] if watched else ["--no-watchdog"]
    line = f"{shlex.join(flight)} {closed}"
    ended = subprocess.run(["/bin/sh", "-c", line], timeout=60.0, check=False)
    try:
        came = os.read(far, 1 << 16)
    except BlockingIOError:
        came = b""
    os.close(near)
    os.close(far)
    assert ended.returncode == 3  # no autopilot: it has come as far as that
    decoder = Decoder(stream=True)
    decoder.feed(came)
    assert decoder.counters.frames > 0
    assert decoder.counters.skipped_bytes == 0  # every byte belongs to a frame
    assert b"tgl_soar: " not in came


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a disk that is full, as Linux has it")
def test_a_full_disk_is_reported_in_a_line() -> None:
    with Path("/dev/full").open("wb") as full:
        words = [sys.executable, "-m", "tgl_soar.cli", "polar", "show"]
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, timeout=60, check=False)
    assert done.returncode == 2
    lines = done.stderr.decode().splitlines()
    assert lines == ["error: No space left on device: what was being written is not whole"]
