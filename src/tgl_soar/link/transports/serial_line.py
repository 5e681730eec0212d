"""A serial line.

A surface command is worth sending now or not at all.  On a serial line that is slower than
what is sent, commands would queue up in the kernel, each later than the last, and the release
behind them.  So a command that would begin more than `COMMAND_LATE_S` late is omitted: the next one
is newer, and a line that is always full carries the newest as often as it can.  To discard the
queue and send the new command instead would cut the frame on the wire at every tick, and none
would arrive.  `clear_for_release` does so once.
"""

from __future__ import annotations

import errno
import fcntl
import os
import sys
import termios
from pathlib import Path
from typing import Final

from tgl_soar.link.transports.base import LinkError, LinkNotReadyError
from tgl_soar.link.transports.byte_stream import RETRY_S, ByteStream

BITS_PER_BYTE: Final = 10  # on a serial line: a start and a stop bit
# A tick at 200 Hz: what begins later than that comes after a newer command could have.
COMMAND_LATE_S: Final = 0.005
# While commands are sent, all else that would begin later is dropped, so that it leaves no longer
# gap between two commands: a tenth of the 0.5 s after which an autopilot acts without them.
OTHERS_LATE_S: Final = 0.05
DEFAULT_BAUD: Final = 921_600
# Of a device that is being plugged in or out.
_PASSING: Final = (errno.EIO, errno.ENXIO, errno.ENODEV)


def device_and_baud(text: str, rest: str) -> tuple[str, int]:
    device, separator, baud = rest.rpartition(":")
    if not separator:
        device, baud = rest, str(DEFAULT_BAUD)
    if not device:
        raise LinkError(f"link {text!r}: needs a device, as in serial:/dev/ttyAMA0:921600")
    if not baud.isascii() or not baud.isdigit() or not 1200 <= int(baud) <= 4_000_000:
        raise LinkError(f"link {text!r}: baud rate {baud!r} is not in 1200 to 4000000")
    return device, int(baud)


class SerialLink(ByteStream):
    """A serial line."""

    def __init__(self, text: str, device: str, baud: int, now_s: float) -> None:
        super().__init__(text)
        self._device = device
        self._baud = baud
        self._commands = False  # commands are being sent
        try:
            self._open()
        except LinkError:
            raise
        except (OSError, ValueError, termios.error) as error:
            raise _no_serial(text, device, error) from None
        self._retry_s = now_s + RETRY_S

    def _open(self) -> None:
        import serial  # imported only where there is a serial line

        try:
            self._port = serial.Serial(
                self._device, self._baud, timeout=0, write_timeout=0, exclusive=True
            )
        except serial.SerialException as error:
            raise _no_serial(self.name, self._device, error) from None
        fd = int(self._port.fileno())
        os.set_blocking(fd, False)
        # pyserial lets a read end with nothing; here nothing at all is to mean: hung up.
        settings = termios.tcgetattr(fd)
        settings[6][termios.VMIN] = 1
        termios.tcsetattr(fd, termios.TCSANOW, settings)
        self._fd = fd

    def send(self, data: bytes) -> bool:
        if self._commands and self.backlog_bytes() > self._bytes_in(OTHERS_LATE_S):
            self.counters.dropped_out += 1
            return False
        return super().send(data)

    def send_command(self, data: bytes) -> bool:
        self._commands = True
        if self.backlog_bytes() > max(len(data), self._bytes_in(COMMAND_LATE_S)):
            self.counters.dropped_out += 1
            self.counters.left_out += 1
            return False
        return super().send(data)

    def clear_for_release(self) -> bool:
        self._commands = False
        if self._fd < 0 or self.backlog_bytes() <= self._bytes_in(COMMAND_LATE_S):
            return False
        self._unsent.clear()
        try:
            termios.tcflush(self._fd, termios.TCOFLUSH)
        except termios.error:
            return False  # the next read finds the line lost
        return True

    def backlog_bytes(self) -> int:
        """Bytes sent that are not yet on the wire, as the driver counts them."""
        if self._fd < 0:
            return 0
        queued = bytearray(4)
        try:
            fcntl.ioctl(self._fd, termios.TIOCOUTQ, queued)
        except OSError:
            return len(self._unsent)
        return len(self._unsent) + int.from_bytes(queued, sys.byteorder)

    def _bytes_in(self, time_s: float) -> float:
        """What the line carries in a time."""
        return time_s * self._baud / BITS_PER_BYTE

    def _reopen(self, now_s: float) -> bool:  # noqa: ARG002
        if not Path(self._device).exists():
            return False
        try:
            self._open()
        except (LinkError, OSError, ValueError, termios.error):
            return False
        return True

    def _release(self) -> None:
        try:
            self._port.close()
        except OSError:
            return  # the device is gone: nothing is left to close


def _no_serial(text: str, device: str, error: Exception) -> LinkError:
    """What is said of a device that cannot be opened; at boot it may appear later, its group, which
    may open it, later still."""
    number = getattr(error, "errno", None)
    if number == errno.ENOENT or not Path(device).exists():
        return LinkNotReadyError(
            f"link {text!r}: there is no {device}; `ls /dev/tty*` lists the lines,"
            " and on a Raspberry Pi the serial port must be enabled"
        )
    if number == errno.EACCES:
        return LinkNotReadyError(
            f"link {text!r}: {device} may not be opened;"
            " add the user to its group (dialout) and log in again"
        )
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(error):
        return LinkNotReadyError(
            f"link {text!r}: {device} is in use by another program; stop that first"
        )
    reason = f"link {text!r}: {device} cannot be opened as a serial line: {error}"
    return LinkNotReadyError(reason) if number in _PASSING else LinkError(reason)
