"""`tgl-soar preflight`, asked of a simulated Pixhawk in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from bench_bridge import AIRFRAME, bridge
from free_ports import free_port

from tgl_soar.config.files import shipped

SITE = shipped("sites/tunnel.toml")


def preflight(link: str, *words: str) -> tuple[int, str]:
    """The command's exit code, and what it printed; of the shipped files where none is named."""
    for option, path in (("--airframe", AIRFRAME), ("--site", SITE)):
        words = words if option in words else (*words, option, str(path))
    ended = subprocess.run(
        [sys.executable, "-m", "tgl_soar.cli", "preflight", "--link", link, *words],
        capture_output=True,
        text=True,
        timeout=60.0,
        check=False,
        env={"COLUMNS": "160", "PYTHONPATH": ":".join(sys.path)},
    )
    return ended.returncode, ended.stdout + ended.stderr


def test_a_well_set_up_vehicle_is_ready(tmp_path: Path) -> None:
    with bridge(tmp_path / "log", "RC_OVERRIDE_TIME=0.5") as link:
        code, text = preflight(link, "--all", "--timeout", "30")
    assert code == 0, text
    assert "ready" in text
    assert "RC2_TRIM" in text


def test_of_a_badly_set_up_vehicle_it_is_reported_what_to_change(tmp_path: Path) -> None:
    wrong_ones = ("RC_OVERRIDE_TIME=3", "SYSID_MYGCS=250", "SERVO2_TRIM=1520")
    with bridge(tmp_path / "log", *wrong_ones, "SCHED_LOOP_RATE=50") as link:
        code, text = preflight(link, "--timeout", "30")
    assert code == 1, text
    for words in (
        "set RC_OVERRIDE_TIME to at most 0.5",
        "set SERVO2_TRIM to 1500",
        "set SCHED_LOOP_RATE to at least 250",
        "its SYSID_MYGCS is 250",
        "not ready",
    ):
        assert words in text
    assert "RC2_TRIM" not in text  # right, and so not shown


def test_nobody_there() -> None:
    code, text = preflight(f"udp:127.0.0.1:{free_port()}", "--timeout", "1")
    assert code == 2
    assert "no heartbeat of autopilot 1 within 1 s" in text
