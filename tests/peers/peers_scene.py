"""A flight between processes that others can join: bridge, module, and a pilot who watches.

Bridge, module and pilot fly in lockstep, so that a machine that is busy slows the flight down
and does not disturb it; the pilot holds time back to `SPEED` times its natural pace, because the
stations that join live by the clock on the wall.

Every address is on the loopback interface, every port is free.
"""

from __future__ import annotations

import os
import random
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections import deque
from pathlib import Path
from typing import Any

from free_ports import free_port
from pymavlink.dialects.v20 import ardupilotmega as mavlink

ROOT = Path(__file__).parents[2]
AIRFRAME = ROOT / "config/airframes/eclipson_c.toml"
SITE = ROOT / "config/sites/tunnel.toml"
LOCAL = "127.0.0.1"
SPEED = 2.0
FLYING = (3.0, 4.0)  # capturing, soaring


class Mangler:
    """What a bad radio does to datagrams: some are lost, some are overtaken by later ones."""

    def __init__(self, seed: int, loss: float, late: float) -> None:
        self._chance = random.Random(seed)
        self._loss, self._late = loss, late
        self._held: deque[tuple[bytes, int]] = deque()  # and how many may still overtake
        self.passed = self.lost = self.overtaken = 0

    def push(self, data: bytes) -> list[bytes]:
        """What comes out when a datagram goes in."""
        out = []
        self._held = deque((held, left - 1) for held, left in self._held)
        if self._chance.random() < self._loss:
            self.lost += 1
        elif self._chance.random() < self._late:
            self.overtaken += 1
            self._held.append((data, self._chance.randint(1, 3)))
        else:
            out.append(data)
        while self._held and self._held[0][1] <= 0:
            out.append(self._held.popleft()[0])
        self.passed += len(out)
        return out

    def flush(self) -> list[bytes]:
        """Nothing more has come for a while."""
        out = [data for data, _ in self._held]
        self._held.clear()
        self.passed += len(out)
        return out


class BadRadio:
    """Stands between the bridge and a ground station, on two ports."""

    def __init__(self, bridge_port: int, *, seed: int, loss: float = 0.2, late: float = 0.2):
        self._bridge_side, self._station_side = self._socket(), self._socket()
        self.port = int(self._station_side.getsockname()[1])
        self.down, self.up = Mangler(seed, loss, late), Mangler(seed + 1, loss, late)
        self._bridge = (LOCAL, bridge_port)
        self._station: tuple[str, int] | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._carry, daemon=True)
        self._thread.start()

    @staticmethod
    def _socket() -> socket.socket:
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.bind((LOCAL, 0))
        made.setblocking(False)
        return made

    def _carry(self) -> None:
        while not self._ended.is_set():
            ready, _, _ = select.select([self._bridge_side, self._station_side], [], [], 0.03)
            if not ready:
                self._to_station(self.down.flush())
                self._to_bridge(self.up.flush())
            for side in ready:
                try:
                    data, sender = side.recvfrom(65535)
                except OSError:
                    continue
                if side is self._bridge_side:
                    self._to_station(self.down.push(data))
                else:
                    self._station = sender
                    self._to_bridge(self.up.push(data))

    def _to_station(self, datagrams: list[bytes]) -> None:
        if self._station is not None:
            for data in datagrams:
                self._send(self._station_side, data, self._station)

    def _to_bridge(self, datagrams: list[bytes]) -> None:
        for data in datagrams:
            self._send(self._bridge_side, data, self._bridge)

    @staticmethod
    def _send(side: socket.socket, data: bytes, to: tuple[str, int]) -> None:
        try:
            side.sendto(data, to)
        except OSError:
            return  # no socket listens there any more

    def close(self) -> None:
        self._ended.set()
        self._thread.join(2.0)
        self._bridge_side.close()
        self._station_side.close()


class Pilot:
    """A ground station of our own on a good link: engages by command and watches the flight."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((LOCAL, 0))
        self._socket.settimeout(0.05)
        self.port = int(self._socket.getsockname()[1])
        self._codec = mavlink.MAVLink(None, 254, 190)
        self._codec.robust_parsing = True
        self._bridge: tuple[str, int] | None = None
        self.values: dict[str, float] = {}
        self.parameters: dict[str, float] = {}
        self.texts: list[str] = []
        self.acks: list[tuple[int, int]] = []
        self._ahead_s = float("nan")  # wall clock less simulated time
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        beat = 0.0
        while not self._ended.is_set():
            if time.monotonic() - beat > 1.0 and self._bridge is not None:
                beat = time.monotonic()
                self.send(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
            try:
                data, self._bridge = self._socket.recvfrom(65535)
            except OSError:
                continue
            for message in self._codec.parse_buffer(bytearray(data)) or ():
                self._take(message)

    def _take(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "TIMESYNC":
            if message.tc1 == 0:
                self._hold_back(message.ts1 * 1e-9)
                self.send(mavlink.MAVLink_timesync_message(message.ts1, message.ts1))
        elif kind == "NAMED_VALUE_FLOAT":
            self.values[message.name] = message.value
        elif message.get_srcComponent() != 191:
            return
        elif kind == "PARAM_VALUE":
            self.parameters[message.param_id] = message.param_value
        elif kind == "STATUSTEXT":
            self.texts.append(message.text)
        elif kind == "COMMAND_ACK" and message.target_system == 254:
            self.acks.append((message.command, message.result))

    def _hold_back(self, simulated_s: float) -> None:
        """The bridge waits for us: let time go on no sooner than it should."""
        now = time.monotonic()
        early_s = simulated_s / SPEED + self._ahead_s - now
        if not 0.0 <= early_s <= 1.0:  # NaN, or it is behind: nothing is hurried after
            self._ahead_s = now - simulated_s / SPEED
        else:
            time.sleep(early_s)

    def send(self, message: Any) -> None:
        if self._bridge is not None:
            self._socket.sendto(message.pack(self._codec), self._bridge)
            self._codec.seq = (self._codec.seq + 1) % 256

    def command(self, number: int) -> None:
        self.send(
            mavlink.MAVLink_command_long_message(1, 191, number, 0, 0, 0, 0, 0, 0, 0, 0),
        )

    def wait(self, what: str, is_so: Any, seconds: float = 15.0) -> None:
        """Until it is so.  Errors: AssertionError with the texts so far."""
        until = time.monotonic() + seconds
        while not is_so():
            assert time.monotonic() < until, f"not within {seconds:g} s: {what}; {self.texts}"
            time.sleep(0.02)

    def engage(self, *, settle: bool = False) -> None:
        """Until the module is in control, or until the aircraft is on its line."""
        engage = mavlink.MAV_CMD_USER_1
        self.wait("a position", lambda: self.values.get("soar_x", 0.0) > 0.1, 60.0)
        time.sleep(0.5)
        self.command(engage)
        self.wait("IN_PROGRESS", lambda: (engage, mavlink.MAV_RESULT_IN_PROGRESS) in self.acks)
        self.wait("flying", lambda: self.values["soar_mode"] in FLYING)
        if settle:
            self.wait("soaring", lambda: (engage, mavlink.MAV_RESULT_ACCEPTED) in self.acks)

    def close(self) -> None:
        self._ended.set()
        self._thread.join(2.0)
        self._socket.close()


class Scene:
    """Bridge and module as processes; ground stations on ports of their own."""

    def __init__(self, folder: Path, *, own_link: bool = False) -> None:
        """own_link: stations reach the module at `module_port`, too, with no Pixhawk between."""
        self.folder = folder
        self.pilot = Pilot()
        self.port = free_port()  # where stations send to
        companion = f"{LOCAL}:{free_port()}"
        files = ["--airframe", str(AIRFRAME), "--site", str(SITE)]
        self.module_port = free_port()
        links = [companion, *([f"{LOCAL}:{self.module_port}"] if own_link else [])]
        self._processes = [
            self._start(
                "bridge",
                [
                    *("tgl_soar.sim.bridge", *files, "--speed", "lockstep", "--lockstep-gcs"),
                    *("--gcs", f"{LOCAL}:{self.pilot.port}", "--gcs-local", f"{LOCAL}:{self.port}"),
                    *("--companion", companion, "--companion-local", f"{LOCAL}:0"),
                    *("--autopilot-parameter", "RC_OVERRIDE_TIME=0.5", "--patience", "60"),
                ],
            ),
            self._start(
                "module",
                [
                    *("tgl_soar.cli", "run", *files, "--lockstep"),
                    *(word for link in links for word in ("--link", f"udp:{link}")),
                ],
            ),
        ]

    def _start(self, name: str, words: list[str]) -> subprocess.Popen[bytes]:
        with (self.folder / f"{name}.log").open("wb") as log:
            return subprocess.Popen(
                [sys.executable, "-m", *words],
                env={**os.environ, "XDG_STATE_HOME": str(self.folder)},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
            )

    def log(self, name: str) -> str:
        """What a process has printed."""
        return (self.folder / f"{name}.log").read_text()

    def assert_flies(self) -> None:
        """The module has not disengaged, whatever the stations did."""
        assert "released" not in self.log("module"), self.log("module")
        assert "lost" not in self.log("bridge"), self.log("bridge")
        self.pilot.wait("flying", lambda: self.pilot.values["soar_mode"] in FLYING, 3.0)

    def close(self) -> None:
        for process in reversed(self._processes):
            if process.poll() is None:
                process.send_signal(signal.SIGTERM)
                try:
                    process.wait(5.0)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
        self.pilot.close()
