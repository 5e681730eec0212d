"""MAVProxy, as it comes from its makers, at the parameters of component 191 while it flies."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from peers_scene import BadRadio, Scene

from tgl_soar.config.parameters import PARAMETERS

PROGRAM = shutil.which("mavproxy.py") or shutil.which(
    "mavproxy.py", path=Path(sys.executable).parent
)

pytestmark = pytest.mark.skipif(PROGRAM is None, reason="MAVProxy is not installed")


class MavProxy:
    """The program without a screen: commands in, words out."""

    def __init__(self, folder: Path, port: int, modules: str = "param,cmdlong") -> None:
        assert PROGRAM is not None
        self.folder = folder
        self.words = ""
        self._process = subprocess.Popen(
            [
                *(sys.executable, PROGRAM, f"--master=udpout:127.0.0.1:{port}", "--no-state"),
                *(f"--default-modules={modules}", "--target-system=1"),
                "--target-component=191",
            ],
            cwd=folder,
            env={**os.environ, "HOME": str(folder), "PYTHONUNBUFFERED": "1"},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        while piece := self._process.stdout.read(1):
            self.words += piece

    def fetch(self, count: int) -> None:
        """Until it has all parameters.  What is missing from a list it asks for by itself; the
        request for the list it sends once, so that a person types it again."""
        for _ in range(5):
            try:
                self.wait(f"Received {count} parameters", seconds=7.0)
            except AssertionError:
                self.type("param fetch")
            else:
                return
        self.wait(f"Received {count} parameters")

    def type(self, line: str) -> int:
        """Type a line; where in the words its answer begins."""
        assert self._process.stdin is not None
        at = len(self.words)
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        return at

    def wait(self, text: str, since: int = 0, seconds: float = 15.0) -> None:
        until = time.monotonic() + seconds
        while text not in self.words[since:]:
            assert time.monotonic() < until, f"no {text!r} in:\n{self.words[since:]}"
            time.sleep(0.02)

    def shown(self, name: str, seconds: float = 10.0) -> float:
        """The value that it shows."""
        since = self.type(f"param show {name}")
        self.wait(f"{name} ", since, seconds)
        self.wait("\n", self.words.index(f"{name} ", since))
        reported = self.words[self.words.index(f"{name} ", since) + len(name) :]
        number = re.match(r"\s+(-?[\d.]+(?:e[-+]?\d+)?)", reported)  # a prompt may stand behind it
        assert number is not None, reported
        return float(number[1])

    def set(self, name: str, value: float) -> None:
        """Until it shows the value itself.  It repeats a set that is not confirmed a few times;
        after that a person types it again."""
        for _ in range(4):
            self.type(f"param set {name} {value}")
            for _ in range(10):
                if abs(self.shown(name) - value) < 1e-6:
                    return
                time.sleep(0.5)
        raise AssertionError(f"{name} is not {value}:\n{self.words}")

    def saved(self, name: str) -> dict[str, float]:
        since = self.type(f"param save {name}")
        self.wait(f"to {name}", since)
        lines = (self.folder / name).read_text().split("\n")
        rows = [line.split() for line in lines if line and not line.startswith("#")]
        return {row[0]: float(row[1]) for row in rows}

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        self._reader.join(2.0)


# MAVSDK takes the same list over the same bad radio in every run of the tests.
BAD_RADIO = pytest.param(True, id="bad-radio", marks=pytest.mark.long)


@pytest.fixture(params=[pytest.param(False, id="good-link"), BAD_RADIO])
def flight(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Scene, MavProxy]]:
    scene = Scene(tmp_path)
    radio = BadRadio(scene.port, seed=7) if request.param else None
    scene.pilot.engage()
    station = MavProxy(tmp_path, radio.port if radio else scene.port)
    try:
        yield scene, station
        scene.assert_flies()
        if radio is not None:
            assert radio.down.lost > 10
            assert radio.down.overtaken > 10
            assert radio.up.lost + radio.up.overtaken > 0
    finally:
        station.close()
        scene.close()
        if radio is not None:
            radio.close()


def test_mavproxy_lists_shows_sets_saves_and_loads(flight: tuple[Scene, MavProxy]) -> None:
    scene, station = flight
    pilot = scene.pilot
    station.fetch(len(PARAMETERS))
    assert station.shown("TGL_LEAN") == 15.0

    since = len(station.words)
    station.set("TGL_X", 0.4)
    pilot.wait("TGL_X is set", lambda: abs(pilot.parameters.get("TGL_X", 0.0) - 0.4) < 1e-6)
    pilot.wait("the line moves", lambda: pilot.values["line_x"] > 0.21)
    assert "allowed" not in station.words[since:]

    since = station.type("param set TGL_LEAN 80")
    station.wait("allowed", since)
    station.wait("Failed to set TGL_LEAN", since)
    assert station.shown("TGL_LEAN") == 15.0

    saved = station.saved("flown.parm")
    assert set(saved) == {p.name for p in PARAMETERS}
    # What was saved loads back: change one value, load, and it is what it was.
    station.set("TGL_SLEW", 0.2)
    pilot.wait("TGL_SLEW is set", lambda: abs(pilot.parameters.get("TGL_SLEW", 0.0) - 0.2) < 1e-6)
    since = station.type("param load flown.parm")
    station.wait("parameters from flown.parm", since, 30.0)
    slew = saved["TGL_SLEW"]
    pilot.wait("TGL_SLEW is back", lambda: abs(pilot.parameters["TGL_SLEW"] - slew) < 1e-6)
    for _ in range(20):  # an answer may be lost: what is there can be asked for again
        if abs(station.shown("TGL_SLEW") - slew) < 1e-6:
            break
        station.type("param fetch TGL_SLEW")
        time.sleep(0.5)
    assert station.saved("again.parm") == pytest.approx(saved, abs=1e-6)


def test_mavproxy_that_looks_for_files_first_does_not_wait_for_them(tmp_path: Path) -> None:
    scene = Scene(tmp_path)
    scene.pilot.engage()
    station = MavProxy(tmp_path, scene.port, "ftp,param,cmdlong")
    try:
        station.wait(f"Received {len(PARAMETERS)} parameters", seconds=40.0)
        assert "request timed out" not in station.words  # which it says before it gives up
        assert station.shown("TGL_LEAN") == 15.0
        since = station.type("param fetch _HASH_CHECK")
        station.wait("_HASH_CHECK = ", since)
        scene.assert_flies()
    finally:
        station.close()
        scene.close()
