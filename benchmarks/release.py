"""From a reason to disengage to the last frame that commands a surface.

In the module, tick by tick, for everything that it can know by itself; and for the whole process,
by the clock, when it is told to end and when it is killed.  The reference is two ticks.
"""

from __future__ import annotations

import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from os import kill
from pathlib import Path
from statistics import median

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import shipped

from .module_flight import TICK_S, ModuleFlight
from .result import Result

ALLOWED_S = 2.0 * TICK_S
PATIENCE_TICKS = 1000
REPEATS = 5
ENGAGED_TICKS = 200
ASK_AGAIN_S = 2.0  # a busy machine may have let the attitude grow old meanwhile


# --- known inside the module ------------------------------------------------------------------


def _operator(flight: ModuleFlight) -> None:
    message = mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 0.0, 9)
    flight.onboard.event(flight.ask(message), flight.now_s)


def _abort(flight: ModuleFlight) -> None:
    message = mavlink.MAVLink_command_long_message(1, 191, 31012, 0, 0, 0, 0, 0, 0, 0, 0)
    flight.onboard.event(flight.ask(message), flight.now_s)


def _pilot(flight: ModuleFlight) -> None:
    flight.custom_mode = 5
    flight.receive(flight.heartbeat())


def _upset(flight: ModuleFlight) -> None:
    flight.quaternion = (0.0, 1.0, 0.0, 0.0)


def _lost_attitude(flight: ModuleFlight) -> None:
    """Known when it is AGE_ATT_MAX old."""
    flight.sends_attitude = False
    sample = flight.onboard.session.attitude.time_s
    while flight.now_s + TICK_S <= sample + flight.onboard.parameters.values["AGE_ATT_MAX"]:
        flight.tick()


def _lost_autopilot(flight: ModuleFlight) -> None:
    """Known when its heartbeat is AGE_AP_MAX old."""
    flight.sends_heartbeat = False
    received = flight.onboard.session.status.time_s
    while flight.now_s + TICK_S <= received + flight.onboard.parameters.values["AGE_AP_MAX"]:
        flight.tick()


CAUSES: tuple[tuple[str, Callable[[ModuleFlight], None]], ...] = (
    ("operator disengages", _operator),
    ("operator aborts", _abort),
    ("pilot takes another mode", _pilot),
    ("aircraft on its back", _upset),
    ("attitude too old", _lost_attitude),
    ("autopilot silent", _lost_autopilot),
)


def _pulses(frames: list[bytes]) -> list[int]:
    """The elevator's pulse in every override among frames; 0 gives it back."""
    decoder = mavlink.MAVLink(None)
    messages = [decoder.decode(bytearray(frame)) for frame in frames]
    return [m.chan2_raw for m in messages if m.get_type() == "RC_CHANNELS_OVERRIDE"]


def _last_command_s(cause: Callable[[ModuleFlight], None]) -> float:
    """Flight time from the cause to the last frame that moves a surface."""
    flight = ModuleFlight().engaged()
    cause(flight)
    flight.frames.clear()
    begun, last = flight.now_s, flight.now_s
    for _ in range(PATIENCE_TICKS):
        flight.tick()
        pulses = _pulses(flight.frames)
        flight.frames.clear()
        if 0 in pulses:
            return last - begun
        if pulses:
            last = flight.now_s
    raise AssertionError("it did not disengage")


def known_inside() -> Iterator[Result]:
    """One line for each cause."""
    for what, cause in CAUSES:
        yield Result(
            what=f"last surface command after: {what}",
            value=_last_command_s(cause) * 1e3,
            reference=ALLOWED_S * 1e3,
            unit="ms",
            reference_what="two ticks",
        )


# --- the process ------------------------------------------------------------------------------


class _Process:
    """`tgl-soar run`, and the vehicle's end of its link."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self.running = subprocess.Popen(
            [
                *(sys.executable, "-m", "tgl_soar.cli", "run", "--state", "none"),
                *("--airframe", str(shipped("airframes/eclipson_c.toml"))),
                *("--site", str(shipped("sites/tunnel.toml"))),
                *("--link", f"udpout:127.0.0.1:{self._socket.getsockname()[1]}"),
            ],
            stderr=subprocess.DEVNULL,
        )
        _, self._address = self._socket.recvfrom(2048)
        self._vehicle = mavlink.MAVLink(None, 1, 1)
        self._station = mavlink.MAVLink(None, 255, 190)
        self._begun = time.monotonic()
        self._beat_s = self._feed_s = 0.0
        self.pulses: list[tuple[float, int]] = []

    @property
    def child(self) -> int:
        """The process that flies."""
        pid = self.running.pid
        return int(Path(f"/proc/{pid}/task/{pid}/children").read_text().split()[0])

    def pump(self) -> None:
        """Feed it, and take in what has come."""
        now = time.monotonic() - self._begun
        if now >= self._feed_s:
            self._feed_s = now + TICK_S
            stamp = round(now * 1e3)
            noise = 1e-6 * (stamp % 7)  # nothing that is measured repeats itself
            self._say(mavlink.MAVLink_attitude_quaternion_message(stamp, 1, noise, 0, 0, 0, 0, 0))
            self._say(
                mavlink.MAVLink_local_position_ned_message(stamp, 0.2, 0, -1.15 + noise, 0, 0, 0)
            )
        if now >= self._beat_s:
            self._beat_s = now + 1.0
            self._say(mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3))
        if select.select([self._socket], [], [], 0.001)[0]:
            data = self._socket.recv(2048)
            came = time.monotonic()
            self.pulses += [(came, pulse) for pulse in _pulses([data])]

    def engage(self) -> None:
        """Until it has had the surfaces for a while."""
        asked_s = time.monotonic() + 0.5
        while len(self.pulses) < ENGAGED_TICKS:
            self.pump()
            if time.monotonic() >= asked_s:
                asked_s += ASK_AGAIN_S
                message = mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 1.0, 9)
                self._socket.sendto(bytes(message.pack(self._station)), self._address)

    def _say(self, message: mavlink.MAVLink_message) -> None:
        self._socket.sendto(bytes(message.pack(self._vehicle)), self._address)

    def close(self) -> None:
        """End it."""
        self.running.terminate()
        self.running.wait()
        self._socket.close()


def _released_s(end: Callable[[_Process], None]) -> float:
    """By the clock, from a signal to the first frame that releases the surfaces."""
    process = _Process()
    try:
        process.engage()
        begun = time.monotonic()
        end(process)
        while process.pulses[-1][1] != 0:
            process.pump()
        return next(when for when, pulse in process.pulses if pulse == 0) - begun
    finally:
        process.close()


ENDS: tuple[tuple[str, Callable[[_Process], None]], ...] = (
    ("SIGTERM", lambda process: process.running.send_signal(signal.SIGTERM)),
    ("kill -9 of the flying process", lambda process: kill(process.child, signal.SIGKILL)),
    ("kill -9 of the watchdog", lambda process: process.running.kill()),
)


def whole_process() -> Iterator[Result]:
    """The median of a few, as the machine's scheduling is in it."""
    for what, end in ENDS:
        yield Result(
            what=f"surfaces released after: {what}",
            value=median(_released_s(end) for _ in range(REPEATS)) * 1e3,
            reference=ALLOWED_S * 1e3,
            unit="ms",
            reference_what="two ticks",
        )


BENCHMARKS = (known_inside, whole_process)
