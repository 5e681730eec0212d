"""MAVSDK clients, one and two at a time, at the parameters of component 191 while it flies."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from peers_scene import BadRadio, Scene

from tgl_soar.config.parameters import PARAMETERS, as_wire_value

CLIENT = Path(__file__).parent / "mavsdk_client.py"

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("mavsdk") is None
    or importlib.util.find_spec("mavsdk.plugins") is None,
    reason="MAVSDK 4 is not installed",
)


def client(port: int, values: dict[str, float]) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, str(CLIENT), str(port), json.dumps(values)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


def report(process: subprocess.Popen[str]) -> dict[str, Any]:
    try:
        words, _ = process.communicate(timeout=50.0)
    except subprocess.TimeoutExpired:
        process.kill()
        words, _ = process.communicate()
        pytest.fail(f"a client did not end:\n{words[-3000:]}")
    assert process.returncode == 0, words[-3000:]
    found: dict[str, Any] = json.loads(words.strip().splitlines()[-1])
    return found


@pytest.mark.parametrize("bad", [False, True], ids=["good-link", "bad-radio"])
def test_two_clients_at_once_read_and_set(tmp_path: Path, bad: bool) -> None:
    scene = Scene(tmp_path)
    radios = [BadRadio(scene.port, seed=20 + i) for i in range(2)] if bad else []
    ports = [radio.port for radio in radios] or [scene.port] * 2
    wanted = [{"TGL_X": 0.3, "RHO_I_MAX": 7.0}, {"TGL_Z": 1.3, "TGL_SLEW": 0.25}]
    try:
        scene.pilot.engage()
        clients = [client(port, values) for port, values in zip(ports, wanted, strict=True)]
        reports = [report(process) for process in clients]
        for values, found in zip(wanted, reports, strict=True):
            assert set(found["all"]) == {p.name for p in PARAMETERS}
            assert found["set"] == {name: as_wire_value(value) for name, value in values.items()}
            assert found["refused"]
            assert found["lean"] == 15.0
        # No silent difference: the good link has received what every client reports as set.
        for found in reports:
            for name, value in found["set"].items():
                assert scene.pilot.parameters[name] == value
        scene.assert_flies()
        for radio in radios:
            assert radio.down.lost > 10
            assert radio.down.overtaken > 10
    finally:
        scene.close()
        for radio in radios:
            radio.close()
