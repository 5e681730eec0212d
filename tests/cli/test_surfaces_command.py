"""`tgl-soar surfaces`, on a simulated Pixhawk in a process of its own."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest
from bench_bridge import AIRFRAME, PATIENCE_S, bridge
from free_ports import free_port
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.checks.surface_check import SIGHTS
from tgl_soar.onboard import watchdog
from tgl_soar.onboard.surface_control import RELEASE_FRAMES


def surfaces(link: str, airframe: Path, *more: str) -> list[str]:
    options = [
        "--link",
        link,
        "--airframe",
        str(airframe),
        "--hold",
        "0.5",
        "--timeout",
        "60",
        *more,
    ]
    return [sys.executable, "-m", "tgl_soar.cli", "surfaces", *options]


def test_on_the_bench(tmp_path: Path) -> None:
    with bridge(tmp_path / "bridge.log") as link:
        good = subprocess.run(
            surfaces(link, AIRFRAME, "--yes"), capture_output=True, text=True, timeout=PATIENCE_S
        )
        assert good.returncode == 0, good.stdout + good.stderr
        assert good.stdout.count("as in the file") == 3
        assert all(sight in good.stdout for sight in SIGHTS.values())

        with subprocess.Popen(
            surfaces(link, AIRFRAME, "--yes", "--hold", "0.5", "--deflection", "0.3"),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            # Tests that run in the background of a shell are set to ignore it.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        ) as stopped:
            assert stopped.stdout is not None
            assert SIGHTS["elevator", 1] in stopped.stdout.readline()  # it is under way
            os.kill(stopped.pid, signal.SIGINT)
            _, words = stopped.communicate(timeout=PATIENCE_S)
        assert stopped.returncode == 130
        assert "the surfaces are released" in words
    log = (tmp_path / "bridge.log").read_text()
    assert "launched" not in log


def test_the_autopilot_turns_a_servo_round_and_a_person_sees_another_go_wrong(
    tmp_path: Path,
) -> None:
    with bridge(tmp_path / "bridge.log", "SERVO4_REVERSED=1") as link:
        answers = "y\n" * 3 + "n\n" + "y\n" * 2
        bad = subprocess.run(
            surfaces(link, AIRFRAME),
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
            input=answers,
        )
    assert bad.returncode == 1
    assert "output 4 moves the other" in bad.stdout
    assert SIGHTS["aileron", -1] in bad.stderr


def test_not_in_the_air(tmp_path: Path) -> None:
    with bridge(tmp_path / "bridge.log", launch="free") as link:
        refused = subprocess.run(
            surfaces(link, AIRFRAME, "--yes"), capture_output=True, text=True, timeout=PATIENCE_S
        )
    assert refused.returncode == 2
    assert "armed and may be flying" in " ".join(refused.stderr.split())


def test_nobody_answers() -> None:
    silent = subprocess.run(
        surfaces(f"udp:127.0.0.1:{free_port()}", AIRFRAME, "--timeout", "1"),
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert silent.returncode == 2
    assert "no heartbeat" in silent.stderr


class Bare:
    """A disarmed autopilot in MANUAL, and the command on its link."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(PATIENCE_S)
        link = f"udpout:127.0.0.1:{self.socket.getsockname()[1]}"
        self.command = subprocess.Popen(
            surfaces(link, AIRFRAME, "--yes", "--hold", "20"),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            # Tests that run in the background of a shell are set to ignore some.
            preexec_fn=lambda: [
                signal.signal(n, signal.SIG_DFL) for n in (*watchdog.ENDS, *watchdog.STOPS)
            ],
        )
        self.elevator_us: list[int] = []  # as it was commanded
        self._codec = mavlink.MAVLink(None, 1, 1)

    def until_commanded(self, least: int) -> None:
        while len(self.elevator_us) < least:
            data, sender = self.socket.recvfrom(2048)
            self._note(data)
            beat = mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 3, 3)
            self.socket.sendto(beat.pack(self._codec), sender)

    def drain(self) -> None:
        self.socket.setblocking(False)
        with suppress(BlockingIOError):
            while True:
                self._note(self.socket.recv(2048))

    def _note(self, data: bytes) -> None:
        message = mavlink.MAVLink(None).decode(bytearray(data))
        if message.get_type() == "RC_CHANNELS_OVERRIDE":
            self.elevator_us.append(message.chan2_raw)


def ignores(pid: int, number: int) -> bool:
    """Asked of the kernel, which does not stop a process of an orphaned group by default."""
    (mask,) = re.findall(r"(?m)^SigIgn:\s*(\w+)$", Path(f"/proc/{pid}/status").read_text())
    return bool(int(mask, 16) >> (number - 1) & 1)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP, signal.SIGQUIT])
def test_whatever_ends_it_the_surfaces_are_released(number: signal.Signals) -> None:
    bare = Bare()
    with bare.socket, bare.command:
        bare.until_commanded(3)
        assert bare.elevator_us[-1] != 0
        for stop in (signal.SIGTSTP, signal.SIGTTIN, signal.SIGTTOU):
            os.kill(bare.command.pid, stop)
            assert ignores(bare.command.pid, stop)
        bare.until_commanded(6)  # it goes on
        os.kill(bare.command.pid, number)
        _, words = bare.command.communicate(timeout=PATIENCE_S)
        bare.drain()
    assert bare.elevator_us[-RELEASE_FRAMES:] == [0] * RELEASE_FRAMES
    assert bare.command.returncode == 128 + number
    assert "the surfaces are released" in words
