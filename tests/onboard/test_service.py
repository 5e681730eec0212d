"""The systemd unit: what systemd itself says of it, and whether it starts what is there."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from tgl_soar.config import parameter_store
from tgl_soar.config.files import shipped
from tgl_soar.config.flown_gains import SEEKS_S
from tgl_soar.link import signing_keys
from tgl_soar.onboard import search_process
from tgl_soar.onboard.flightlog import spool
from tgl_soar.onboard.process import EXIT_CANNOT_START, EXIT_LINK_NOT_READY, main
from tgl_soar.onboard.realtime import PRIORITY
from tgl_soar.onboard.surface_control import RELEASE_FRAMES
from tgl_soar.onboard.watchdog import ENDING_S, HANGS_S, LOOK_S, PATIENCE_S
from tgl_soar.onboard.watchdog_release import GIVE_BACK_INTERVAL_S

UNIT = shipped("systemd/tgl-soar.service")
TEXT = UNIT.read_text(encoding="utf-8")
ANALYZE = shutil.which("systemd-analyze") or ""
EXPOSURE_MAX = 2.5  # of 10, as systemd counts it; 4 and more it calls medium


def setting(name: str) -> str:
    (value,) = re.findall(rf"^{name}=(.*)$", TEXT, re.MULTILINE)
    return str(value)


@pytest.fixture
def unit(tmp_path: Path) -> Path:
    """As installed, with a program that is there."""
    path = tmp_path / UNIT.name
    path.write_text(TEXT.replace("/opt/tgl_soar/bin/tgl-soar", "/bin/true"), encoding="utf-8")
    return path


@pytest.mark.skipif(not ANALYZE, reason="no systemd-analyze here")
def test_systemd_finds_nothing_wrong(unit: Path) -> None:
    found = subprocess.run([ANALYZE, "verify", str(unit)], capture_output=True, text=True)
    assert (found.returncode, found.stderr) == (0, "")


@pytest.mark.skipif(not ANALYZE, reason="no systemd-analyze here")
def test_the_service_may_do_little(unit: Path) -> None:
    command = [ANALYZE, "security", "--offline=yes", "--no-pager", str(unit)]
    found = subprocess.run(command, capture_output=True, text=True)
    if "unrecognized option" in found.stderr:
        pytest.skip("this systemd-analyze knows no --offline")
    (exposure,) = re.findall(r"exposure level for .*: ([\d.]+)", found.stdout)
    assert float(exposure) <= EXPOSURE_MAX


def test_it_starts_a_command_that_there_is(capsys: pytest.CaptureFixture[str]) -> None:
    (example,) = re.findall(r'^# FLIGHT="(.*)"$', TEXT, re.MULTILINE)
    program, run, *options = shlex.split(setting("ExecStart").replace("$FLIGHT", example))
    assert (program, run) == ("/opt/tgl_soar/bin/tgl-soar", "run")
    assert main([*options, "--no-watchdog"]) == EXIT_CANNOT_START  # and not: unknown option
    assert "/etc/tgl_soar/my_airframe.toml" in capsys.readouterr().err


def test_a_device_that_is_not_there_yet_does_not_end_the_service_for_good(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A USB line that is enumerated later than the service is started."""
    missing = tmp_path / "ttyUSB0"
    given = ["--airframe", "eclipson_c", "--site", "hill", "--state", "none", "--no-watchdog"]
    assert main([*given, "--link", f"serial:{missing}:921600"]) == EXIT_LINK_NOT_READY
    assert f"there is no {missing}" in capsys.readouterr().err
    assert setting("Restart") == "always"
    assert str(EXIT_LINK_NOT_READY) not in setting("RestartPreventExitStatus").split()
    # As often as it takes, with a start in each half second and what it takes itself.
    assert (setting("StartLimitIntervalSec"), setting("RestartSec")) == ("0", "0.5")
    assert main([*given, "--link", f"serial:{missing}:fast"]) == EXIT_CANNOT_START


def test_its_numbers_are_those_of_the_program() -> None:
    assert int(setting("RestartPreventExitStatus")) == EXIT_CANNOT_START
    assert int(setting("LimitRTPRIO")) == PRIORITY + 1  # the watchdog's
    assert float(setting("WatchdogSec")) > HANGS_S  # a slow start is judged by the watchdog
    assert setting("KillSignal") == setting("WatchdogSignal") == "SIGTERM"


def test_a_start_has_the_time_that_seeking_gains_may_take() -> None:
    assert float(setting("TimeoutStartSec")) >= SEEKS_S + 30.0  # all else that a start does


def test_an_end_in_order_has_the_time_that_its_parts_may_take() -> None:
    """Each has its own limit; the surfaces are back before the first of them."""
    parts_s = 2 * parameter_store.STOP_S + spool.STOP_S + signing_keys.STOP_S + search_process.END_S
    assert parts_s < ENDING_S < min(HANGS_S, float(setting("WatchdogSec")))


def test_whoever_is_to_give_the_surfaces_back_lives_long_enough() -> None:
    """Neither process is killed before both had their time; see systemd.kill(5)."""
    assert setting("KillMode") == "control-group"
    releasing_s = RELEASE_FRAMES * GIVE_BACK_INTERVAL_S
    for limit_s in (PATIENCE_S, ENDING_S):
        assert float(setting("TimeoutStopSec")) >= limit_s + 2 * (LOOK_S + releasing_s)
    assert float(setting("TimeoutStopSec")) >= 2 * (PATIENCE_S + LOOK_S + releasing_s)
    assert setting("OOMPolicy") == "continue"
