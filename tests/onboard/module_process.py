"""`tgl-soar run` as a process, and a vehicle's end of its link, for the tests of this folder."""

import select
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.signing import EPOCH_S

PATIENCE_S = 60.0  # for what happens at once, were the machine not busy with other things
# What this process may stand still for without its module disengaging in the meantime.
PAUSES = {b"AGE_ATT_MAX": 1.0, b"AGE_AP_MAX": 10.0, b"AGE_POS_MAX": 5.0}
ROOT = Path(__file__).parents[2]
AIRFRAME = ROOT / "config/airframes/eclipson_c.toml"
SITE = ROOT / "config/sites/tunnel.toml"


def arguments(link: str, *more: str) -> list[str]:
    files = ["--airframe", str(AIRFRAME), "--site", str(SITE)]
    return [*files, "--link", link, "--state", "none", *more]


class Module:
    """The process, and a vehicle's end of its link."""

    def __init__(self, *more: str, signing_key: bytes | None = None) -> None:
        self.vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.vehicle.bind(("127.0.0.1", 0))
        self.vehicle.settimeout(PATIENCE_S)
        link = f"udpout:127.0.0.1:{self.vehicle.getsockname()[1]}"
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tgl_soar.cli", "run", *arguments(link, *more)],
            stderr=subprocess.PIPE,
            text=True,
        )
        self.address: tuple[str, int] | None = None
        self.overrides: list[tuple[float, int]] = []  # when, elevator's pulse
        self.texts: list[str] = []
        self._begun = self._feed_s = time.monotonic()
        self._beats = 0
        self._mav = mavlink.MAVLink(None, 1, 1)
        self._station = mavlink.MAVLink(None, 255, 190)
        self._reader = mavlink.MAVLink(None)  # refuses what is not signed with the key
        for codec in (self._mav, self._station, self._reader):
            codec.signing.secret_key = signing_key
            codec.signing.sign_outgoing = signing_key is not None
            codec.signing.timestamp = round((time.time() - EPOCH_S) * 1e5)

    def receive(self) -> Any:
        data, self.address = self.vehicle.recvfrom(2048)
        message = self._reader.decode(bytearray(data))
        for codec in (self._mav, self._station):  # a later stamp that is received is continued from
            codec.signing.timestamp = max(codec.signing.timestamp, self._reader.signing.timestamp)
        return message

    def send(self, message: Any) -> None:
        assert self.address is not None
        self.vehicle.sendto(message.pack(self._mav), self.address)

    def command(self, message: Any) -> None:
        """What a ground station says, routed by the vehicle."""
        assert self.address is not None
        self.vehicle.sendto(message.pack(self._station), self.address)

    def engage(self) -> None:
        """Fly it in a still, perfect world until it is in control."""
        self.send(mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3))
        begun = time.monotonic()
        ask_s = begun + 0.3
        while not self.overrides:
            self.pump()
            if time.monotonic() > ask_s:
                ask_s += 2.0
                for name, value in {**PAUSES, b"OP_ENGAGE": 1.0}.items():
                    self.command(mavlink.MAVLink_param_set_message(1, 191, name, value, 9))
            assert time.monotonic() - begun < PATIENCE_S

    def pump(self) -> None:
        """Feed it once, and take in one message if there is one."""
        now = time.monotonic()
        if now >= self._feed_s and self.address is not None:
            self._feed_s = now + 0.004
            stamp = round((now - self._begun) * 1e3)
            noise = 1e-6 * (stamp % 7)  # nothing that is measured repeats itself
            self.send(mavlink.MAVLink_attitude_quaternion_message(stamp, 1, noise, 0, 0, 0, 0, 0))
            self.send(
                mavlink.MAVLink_local_position_ned_message(stamp, -0.6, 0, -1.2 + noise, 0, 0, 0)
            )
            if round(now - self._begun) > self._beats:
                self._beats += 1
                self.send(mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3))
        if not select.select([self.vehicle], [], [], 0.004)[0]:
            return
        message = self.receive()
        if message.get_type() == "RC_CHANNELS_OVERRIDE":
            self.overrides.append((time.monotonic(), message.chan2_raw))
        elif message.get_type() == "STATUSTEXT":
            self.texts.append(message.text)

    def close(self) -> None:
        self.vehicle.close()
        if self.process.poll() is None:
            self.words()

    def words(self) -> str:
        """What it has printed on the console; ends it."""
        self.process.kill()
        return self.process.communicate()[1]
