"""The bridge as a process: its lockstep and its clock, over real sockets."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_bridge import Companion, bridge_command


class UdpPeer(threading.Thread):
    """A companion or a ground station on a real socket, in a thread of its own."""

    def __init__(self, script: Companion) -> None:
        super().__init__(daemon=True)
        self.script = script
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(0.2)
        self.address = f"127.0.0.1:{self.socket.getsockname()[1]}"
        self.running = True
        self.deaf = False
        self.start()

    def run(self) -> None:
        while self.running:
            try:
                data, address = self.socket.recvfrom(4096)
            except TimeoutError:
                continue
            except OSError:
                return
            if not self.deaf:
                for answer in self.script.take(data):
                    self.socket.sendto(answer, address)

    def close(self) -> None:
        self.running = False
        self.join()
        self.socket.close()


@pytest.fixture
def companion() -> Iterator[UdpPeer]:
    peer = UdpPeer(Companion())
    yield peer
    peer.close()


@pytest.fixture
def station() -> Iterator[UdpPeer]:
    peer = UdpPeer(Companion())
    peer.script.flies = False
    peer.script.own = mavlink.MAVLink(None, 254, 190)
    peer.script._asked = True
    yield peer
    peer.close()


def run_bridge(*command: str, timeout: float = 20.0) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout, check=False)


def test_lockstep_over_sockets_is_the_same_flight_twice(tmp_path: Path) -> None:
    logs = []
    for name in ("one.csv", "two.csv"):
        companion, station = UdpPeer(Companion()), UdpPeer(Companion())
        station.script.flies = False
        station.script.own = mavlink.MAVLink(None, 254, 190)
        station.script._asked = True
        try:
            done = run_bridge(
                *bridge_command(companion.address, station.address),
                *("--speed", "lockstep", "--lockstep-gcs", "--duration", "3", "--seed", "9"),
                *("--turbulence", "0.02", "--log", str(tmp_path / name)),
            )
        finally:
            companion.close()
            station.close()
        assert done.returncode == 0, done.stderr
        assert "600 steps, 3.000 s simulated" in done.stdout
        # Asked for before time began; one sample is always still under way.
        assert len(companion.script.attitudes) == 600
        assert "600 accepted, 0 refused, 0 timed out" in done.stdout
        logs.append((tmp_path / name).read_bytes())
    assert logs[0] == logs[1]


def test_a_companion_that_dies_does_not_hang_the_bridge_and_may_return(
    companion: UdpPeer, station: UdpPeer
) -> None:
    command = bridge_command(
        *(companion.address, station.address, "--speed", "lockstep", "--patience", "0.3"),
        *("--autopilot-parameter", "RC_OVERRIDE_TIME=0.5"),
    )
    with Console(command) as console:
        wait_for(lambda: len(companion.script.attitudes) > 20)
        companion.deaf = True
        console.wait_for("has not answered for 0.3 s")
        console.wait_for("overrides timed out after 0.5 s")
        companion.deaf = False
        console.wait_for("is back")
        count = len(companion.script.attitudes)
        wait_for(lambda: len(companion.script.attitudes) > count + 400)
    assert console.process.returncode == 0  # ended by SIGTERM, with its summary
    assert "x real time" in console.text()


def test_a_log_for_which_there_is_no_room_ends_it_in_words(
    companion: UdpPeer, station: UdpPeer
) -> None:
    done = run_bridge(
        *bridge_command(companion.address, station.address),
        *("--speed", "lockstep", "--lockstep-gcs", "--duration", "3", "--log", "/dev/full"),
    )
    assert done.returncode == 2
    refused = "sitl_bridge: --log /dev/full: cannot be written: No space left on device"
    assert done.stderr.splitlines() == [refused]


class Console:
    """A process whose output is read as it comes; asked to end at the end of the block."""

    def __init__(self, command: list[str]) -> None:
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self._lines: list[str] = []
        self._reader = threading.Thread(target=self._read, daemon=True)

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self._lines.append(line)

    def text(self) -> str:
        return "".join(self._lines)

    def wait_for(self, words: str) -> None:
        try:
            wait_for(lambda: words in self.text())
        except AssertionError:
            raise AssertionError(f"never said {words!r}:\n{self.text()}") from None

    def __enter__(self) -> Console:
        self._reader.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.process.send_signal(signal.SIGTERM)
        try:
            self.process.wait(timeout=10.0)
        finally:
            self.process.kill()
            self._reader.join()


def wait_for(condition: Callable[[], bool], seconds: float = 30.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "waited in vain"
        time.sleep(0.01)


def test_real_time_keeps_time_and_answers_strangers(
    companion: UdpPeer, station: UdpPeer, tmp_path: Path
) -> None:
    begun = time.monotonic()
    done = run_bridge(
        *bridge_command(companion.address, station.address, "--duration", "1.5"),
        *("--log", str(tmp_path / "truth.npz")),
    )
    assert done.returncode == 0, done.stderr
    assert time.monotonic() - begun >= 1.5
    assert "300 steps, 1.500 s simulated" in done.stdout
    assert len(companion.script.attitudes) > 250
    with np.load(tmp_path / "truth.npz") as arrays:
        assert arrays["time_s"][-1] == 1.5


def test_who_is_missing_is_named(tmp_path: Path) -> None:
    done = run_bridge(
        *bridge_command("127.0.0.1:9", "127.0.0.1:10", "--speed", "lockstep", "--lockstep-gcs"),
        *("--start-timeout", "2.3", "--log", str(tmp_path / "log.csv")),
    )
    assert done.returncode == 3
    assert "waiting for the first heartbeat of the companion at 127.0.0.1:9" in done.stdout
    assert "no heartbeat from the companion at 127.0.0.1:9 or the ground" in done.stderr
    assert "Traceback" not in done.stderr


def test_the_tool_is_the_same_program() -> None:
    tool = Path(__file__).parents[3] / "tools" / "sitl_bridge.py"
    if not tool.exists():
        pytest.skip("tools/ is not part of an installed package")
    done = run_bridge(sys.executable, os.fspath(tool), "--help")
    assert done.returncode == 0
    assert "--companion" in done.stdout
