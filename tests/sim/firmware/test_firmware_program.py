"""A firmware's program and what is around it, with a shell script in its place."""

from __future__ import annotations

from pathlib import Path

import pytest
from firmware_step import AIRFRAME

from tgl_soar.config.files import load_site, shipped
from tgl_soar.sim.firmware import FirmwareError, program
from tgl_soar.sim.firmware.starts import STARTS

SITE = load_site(shipped("sites/tunnel.toml"))


def script(path: Path, line: str) -> Path:
    path.parent.mkdir(parents=True)
    path.write_text(f"#!/bin/sh\n{line}\n")
    path.chmod(0o755)
    return path


def test_it_runs_beside_its_log_with_its_settings(tmp_path: Path) -> None:
    binary = script(tmp_path / "bin" / "firmware", 'echo "$PWD $1 $SETTING ${HOME:+home}"; cat')
    log = tmp_path / "printed.log"
    assert program.launch(binary, ("first",), log, {"SETTING": "3"}).wait(30.0) == 0
    assert log.read_text() == f"{tmp_path} first 3 home\n"


@pytest.mark.parametrize("firmware", STARTS)
def test_one_that_does_not_come_is_reported_with_its_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, firmware: str
) -> None:
    monkeypatch.setattr(f"tgl_soar.sim.firmware.{firmware}.BOOT_S", 0.05)
    binary = script(tmp_path / "bin" / "firmware", "exec sleep 60")
    script(tmp_path / "etc" / "init.d-posix" / "rcS", ":")  # that PX4 must have
    with pytest.raises(FirmwareError, match=r"does not come: see .*\.log") as reported:
        STARTS[firmware](binary, tmp_path / "run", AIRFRAME, SITE, {})
    assert Path(str(reported.value).rpartition(" ")[2]).is_file()
