"""How much may wait on a serial line, by its rate, and the error of a device that is not one.

The driver's count of what waits is made up.
"""

from __future__ import annotations

import errno
import fcntl
import os
import select
import sys
import termios
from collections.abc import Iterator

import pytest

from tgl_soar.link.transports.base import LinkError, LinkNotReadyError
from tgl_soar.link.transports.serial_line import SerialLink, _no_serial, device_and_baud

# The driver's part is put in the place of the real one.
pytestmark = pytest.mark.interpreted

BAUD = 57_600  # 5760 bytes a second: 28.8 in a tick of 5 ms, 288 in 50 ms


class Line:
    """One end of a pseudo terminal, and how many bytes wait there."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.far, near = os.openpty()
        device = os.ttyname(near)
        self.link = SerialLink(f"serial:{device}:{BAUD}", device, BAUD, 100.0)
        os.close(near)
        self.queued = 0  # below 0: the driver cannot say
        self.flushed: list[int] = []
        monkeypatch.setattr(fcntl, "ioctl", self._ioctl)
        monkeypatch.setattr(termios, "tcflush", self._flush)

    def _ioctl(self, fd: int, request: int, answer: bytearray) -> int:
        assert (fd, request) == (self.link.fileno(), termios.TIOCOUTQ)
        if self.queued < 0:
            raise OSError
        answer[:] = self.queued.to_bytes(4, sys.byteorder)
        return 0

    def _flush(self, fd: int, which: int) -> None:
        assert fd == self.link.fileno()
        self.flushed.append(which)


@pytest.fixture
def line(monkeypatch: pytest.MonkeyPatch) -> Iterator[Line]:
    made = Line(monkeypatch)
    yield made
    made.link.close()
    os.close(made.far)


@pytest.mark.parametrize(
    ("size", "queued", "is_sent"),
    [(20, 28, True), (20, 29, False), (40, 40, True), (40, 41, False)],
)
def test_a_command_waits_for_no_more_than_a_tick_s_bytes_or_one_of_its_own_length(
    line: Line, size: int, queued: int, is_sent: bool
) -> None:
    line.queued = queued
    assert line.link.send_command(bytes(size)) is is_sent
    counters = line.link.counters
    assert counters.dropped_out == counters.left_out == (not is_sent)


@pytest.mark.parametrize(("queued", "is_sent"), [(288, True), (289, False)])
def test_all_else_leaves_a_gap_of_fifty_milliseconds_once_commands_are_sent(
    line: Line, queued: int, is_sent: bool
) -> None:
    line.queued = 10_000
    assert line.link.send(b"words")  # none is sent yet
    line.queued = 0
    assert line.link.send_command(b"command")
    line.queued = queued
    assert line.link.send(b"words") is is_sent
    assert (line.link.counters.dropped_out, line.link.counters.left_out) == (not is_sent, 0)


@pytest.mark.parametrize(("queued", "is_cleared"), [(28, False), (29, True)])
def test_a_release_waits_for_no_more_than_a_tick_s_bytes(
    line: Line, queued: int, is_cleared: bool
) -> None:
    line.link.send_command(b"command")
    line.queued = queued
    assert line.link.clear_for_release() is is_cleared
    assert line.flushed == [termios.TCOFLUSH] * is_cleared
    line.queued = 10_000
    assert line.link.send(b"words")  # commands are sent no more


def test_what_waited_here_goes_with_it(line: Line) -> None:
    line.link._unsent += bytes(20)
    line.queued = 10
    assert line.link.backlog_bytes() == 30
    assert line.link.clear_for_release()
    assert not line.link._unsent


def test_a_driver_that_cannot_say_and_a_line_that_is_lost(line: Line) -> None:
    line.link._unsent += bytes(20)
    line.queued = -1
    assert line.link.backlog_bytes() == 20
    line.link.close()
    assert line.link.backlog_bytes() == 0
    assert not line.link.clear_for_release()


def test_a_single_byte_wakes_the_loop(line: Line) -> None:
    os.write(line.far, b"\xfd")
    assert select.select([line.link.fileno()], [], [], 2.0)[0]
    assert line.link.receive(101.0) == [b"\xfd"]
    assert line.link.receive(101.0) == []
    assert line.link.fileno() >= 0  # nothing is not hung up


def test_a_line_that_is_closed_is_free_for_others(line: Line) -> None:
    descriptor = line.link.fileno()
    line.link.close()
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(descriptor)


def test_a_flush_that_fails_is_no_release(line: Line, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise termios.error

    monkeypatch.setattr(termios, "tcflush", fail)
    line.queued = 1000
    assert not line.link.clear_for_release()


@pytest.mark.parametrize(
    ("rest", "device", "baud"),
    [
        ("/dev/ttyAMA0", "/dev/ttyAMA0", 921_600),
        ("/dev/ttyAMA0:57600", "/dev/ttyAMA0", 57_600),
        ("/dev/serial/by-id/a:b:1200", "/dev/serial/by-id/a:b", 1200),
        ("/dev/ttyAMA0:4000000", "/dev/ttyAMA0", 4_000_000),
    ],
)
def test_a_line_is_a_device_and_perhaps_a_rate(rest: str, device: str, baud: int) -> None:
    assert device_and_baud("link", rest) == (device, baud)


@pytest.mark.parametrize(
    ("rest", "words"),
    [
        ("", "needs a device, as in serial:/dev/ttyAMA0:921600"),
        (":57600", "needs a device, as in serial:/dev/ttyAMA0:921600"),
        ("/dev/x:", "baud rate '' is not in 1200 to 4000000"),
        ("/dev/x:1199", "baud rate '1199' is not in 1200 to 4000000"),
        ("/dev/x:4000001", "baud rate '4000001' is not in 1200 to 4000000"),
        ("/dev/x:²", "baud rate '²' is not in 1200 to 4000000"),
        ("/dev/x:-1200", "baud rate '-1200' is not in 1200 to 4000000"),
    ],
)
def test_anything_else_is_refused(rest: str, words: str) -> None:
    with pytest.raises(LinkError) as caught:
        device_and_baud(f"serial:{rest}", rest)
    assert str(caught.value) == f"link {f'serial:{rest}'!r}: {words}"


@pytest.mark.parametrize(
    ("device", "error", "words", "may_pass"),
    [
        ("/dev/null", OSError(errno.ENOENT, "gone"), "there is no /dev/null;", True),
        ("/dev/none", OSError(errno.EINVAL, "odd"), "there is no /dev/none;", True),
        ("/dev/null", OSError(errno.EACCES, "no"), "/dev/null may not be opened;", True),
        ("/dev/null", OSError(errno.EBUSY, "busy"), "/dev/null is in use by another", True),
        ("/dev/null", OSError(errno.EAGAIN, "busy"), "/dev/null is in use by another", True),
        ("/dev/null", ValueError("Could not exclusively lock"), "/dev/null is in use by", True),
        ("/dev/null", OSError(errno.EIO, "odd"), "/dev/null cannot be opened as a", True),
        ("/dev/null", OSError(errno.ENXIO, "odd"), "/dev/null cannot be opened as a", True),
        ("/dev/null", OSError(errno.ENODEV, "odd"), "/dev/null cannot be opened as a", True),
        ("/dev/null", OSError(errno.ENOTTY, "odd"), "/dev/null cannot be opened as a", False),
        ("/dev/null", ValueError("odd"), "/dev/null cannot be opened as a", False),
    ],
)
def test_why_a_device_cannot_be_opened_and_whether_that_may_pass(
    device: str, error: Exception, words: str, may_pass: bool
) -> None:
    made = _no_serial("serial:x", device, error)
    assert str(made).startswith(f"link 'serial:x': {words}")
    assert isinstance(made, LinkNotReadyError) is may_pass
