"""A serial line that is slower than what is sent: a pseudo-terminal, drained at 57600 baud.

What a UART's driver holds back is, of a pseudo-terminal, what its far end has not read yet: that is
counted and thrown away here, as TIOCOUTQ and TCOFLUSH do it of a UART and not of these.
"""

from __future__ import annotations

import fcntl
import os
import pty
import sys
import termios
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_module import STEP_S, Flight, setup, texts

from tgl_soar.control.supervisor import CAPTURING, SOARING
from tgl_soar.link.open_link import open_link
from tgl_soar.link.transports.serial_line import COMMAND_LATE_S, OTHERS_LATE_S, SerialLink
from tgl_soar.onboard.module import ModuleOptions, Onboard
from tgl_soar.onboard.surface_control import LONGEST_FRAME, RELEASE_FRAMES

pytestmark = pytest.mark.interpreted  # the driver's counts are put in its place
FRAME = 30  # bytes of an override
RC_CHANNELS_OVERRIDE = (70).to_bytes(3, "little")


class Wire:
    """The far end, which takes what its rate carries and no more."""

    def __init__(self, folder: Path, baud: int) -> None:
        self.far, near = pty.openpty()
        tty.setraw(near)
        tty.setraw(self.far)
        device = folder / "ttyTEST"
        device.symlink_to(os.ttyname(near))
        os.close(near)
        self.bytes_per_s = baud / 10
        self.came = b""
        self.taken = self.thrown_away = 0
        self._owed = 0.0
        link = open_link(f"serial:{device}:{baud}", lambda _: True)
        assert isinstance(link, SerialLink)
        self.link = link

    def waiting(self) -> int:
        return self.link.counters.bytes_out - self.taken

    def take(self, size: int) -> bytes:
        """So many bytes, however long the system takes to hand them over."""
        data = b""
        while len(data) < size:
            data += os.read(self.far, size - len(data))
        self.taken += size
        return data

    def ioctl(self, fd: int, request: int, into: bytearray) -> None:
        assert (fd, request) == (self.link.fileno(), termios.TIOCOUTQ)
        into[:] = self.waiting().to_bytes(4, sys.byteorder)

    def tcflush(self, fd: int, which: int) -> None:
        assert (fd, which) == (self.link.fileno(), termios.TCOFLUSH)
        self.thrown_away += len(self.take(self.waiting()))

    def pass_on(self, seconds: float) -> None:
        """Time passes on the wire."""
        self._owed = min(self._owed + seconds * self.bytes_per_s, self.bytes_per_s)
        size = min(int(self._owed), self.waiting())
        if size:
            self.came += self.take(size)
        self._owed = self._owed - size if self.waiting() else 0.0

    def frames(self) -> list[mavlink.MAVLink_message]:
        """What has come, as a receiver reads it: garbage and what it swallows are left out."""
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        return [m for m in parser.parse_buffer(self.came) or [] if m.get_type() != "BAD_DATA"]


@pytest.fixture
def wire(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Wire]:
    made = Wire(tmp_path, 57600)
    monkeypatch.setattr(fcntl, "ioctl", made.ioctl)
    monkeypatch.setattr(termios, "tcflush", made.tcflush)
    yield made
    monkeypatch.undo()
    made.link.close()
    os.close(made.far)


class SlowFlight(Flight):
    """What it says goes over the wire, in the wire's own time."""

    def __init__(self, wire: Wire) -> None:
        super().__init__()
        self.wire = wire
        link = wire.link
        self.onboard = Onboard(
            setup(),
            link.send,
            self.now_s,
            ModuleOptions(
                stream=True,
                send_command=link.send_command,
                clear_for_release=link.clear_for_release,
            ),
        )

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            super().run(STEP_S)
            self.wire.pass_on(STEP_S)

    def seconds_until_released(self) -> float:
        """Until a whole frame that releases the elevator's channel has left the wire."""
        began_s = self.now_s
        self.wire.came = b""
        while not any(
            m.get_type() == "RC_CHANNELS_OVERRIDE" and m.chan2_raw == 0 for m in self.wire.frames()
        ):
            self.run(0.005)
            assert self.now_s < began_s + 3.0
        return self.now_s - began_s


def test_a_line_that_is_too_slow_carries_new_commands_and_the_release_at_once(wire: Wire) -> None:
    flight = SlowFlight(wire)
    flight.run(1.0)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.5)  # what was sent before the first command
    for _ in range(30):
        flight.run(0.1)
        assert wire.waiting() <= OTHERS_LATE_S * wire.bytes_per_s + 300
    assert flight.mode_now in (CAPTURING, SOARING)
    sent = [m for m in wire.frames() if m.get_type() == "RC_CHANNELS_OVERRIDE"]
    assert len(sent) > 3.0 / COMMAND_LATE_S / 4  # more than a quarter of the ticks' all the same
    assert flight.onboard.counters.left_out > 50
    flight.mode = 10  # the pilot takes it
    flight.receive(mavlink.MAVLink_heartbeat_message(1, 3, 81, 10, 4, 3))
    # A frame that was cut swallows as much as the longest one is long: 293 bytes, then a release
    # of FRAME bytes that may itself be swallowed in part, and one whole, and the tick: 66 ms.
    wait_s = (LONGEST_FRAME + 2 * FRAME) / wire.bytes_per_s + STEP_S
    assert flight.seconds_until_released() <= wait_s  # and not seconds


def test_it_is_reported_in_words(wire: Wire) -> None:
    flight = SlowFlight(wire)
    flight.run(1.0)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(4.0)
    reported = "".join(texts(wire.frames()))
    assert "link too slow" in reported
    assert "raise its baud rate" in reported
    assert reported.count("link too slow") == 1


def test_the_last_words_of_a_process_begin_with_the_release(wire: Wire) -> None:
    flight = SlowFlight(wire)
    flight.run(1.0)
    flight.set("OP_ENGAGE", 1.0)
    flight.run(2.0)
    for _ in range(6):
        assert wire.link._drain(bytes(50))  # as a driver may hold back that counts late
    flight.onboard.stop()
    assert wire.thrown_away > 0
    assert flight.seconds_until_released() < 0.05


def test_a_command_is_left_out_rather_than_queued(wire: Wire) -> None:
    link = wire.link
    assert all(link.send_command(bytes(FRAME)) for _ in range(2))  # one waits behind the first
    assert not link.send_command(bytes(FRAME))
    assert link.counters.left_out == 1
    wire.pass_on(0.006)
    assert link.send_command(bytes(FRAME))


def test_words_hold_up_no_command_for_long_and_only_where_there_are_commands(wire: Wire) -> None:
    link = wire.link
    assert all(link.send(bytes(60)) for _ in range(20))  # to a ground station: all of a list
    wire.pass_on(0.5)
    assert wire.waiting() == 0
    link.send_command(bytes(FRAME))
    taken = sum(link.send(bytes(60)) for _ in range(20))
    assert 1 <= taken <= OTHERS_LATE_S * wire.bytes_per_s / 60 + 1
    link.clear_for_release()
    assert all(link.send(bytes(60)) for _ in range(20))


def test_a_line_that_keeps_up_is_not_cut(wire: Wire) -> None:
    link = wire.link
    link.send_command(bytes(20))
    assert not link.clear_for_release()
    assert wire.thrown_away == 0


def test_after_a_frame_that_was_cut_the_release_goes_out_often_enough_to_be_read() -> None:
    flight = Flight()
    flight.engaged()
    route = flight.onboard.outbox.autopilot
    route.clear_for_release = lambda: True
    before = len(flight.frames)
    flight.mode = 10
    flight.receive(mavlink.MAVLink_heartbeat_message(1, 3, 81, 10, 4, 3))
    flight.run(0.01)
    frames = [frame for frame in flight.frames[before:] if frame[7:10] == RC_CHANNELS_OVERRIDE]
    assert sum(len(frame) for frame in frames[:-2]) >= LONGEST_FRAME  # all of it may be swallowed
    assert len(frames) < RELEASE_FRAMES + LONGEST_FRAME / min(len(frame) for frame in frames)
