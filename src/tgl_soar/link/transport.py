"""Links: how bytes come and go.  Nothing here blocks, and nothing knows what the bytes mean.

    udp:HOST:PORT          listen there; whoever speaks MAVLink to us first is the peer
    udpout:HOST:PORT       speak first
    tcp:HOST:PORT          connect
    serial:/dev/ttyX:BAUD  a serial line (serial:/dev/ttyX alone: 921600)

A UDP listener takes its peer from a datagram only if that begins with a frame that would be
accepted: checksum right, and with a key signed, and later than all that was heard before.  The
peer holds its place by accepted frames alone (`hold`); bytes, refused frames and frames recorded
earlier hold nothing.  Another may follow when nothing was accepted for `PEER_SILENCE_S`.  A serial
line or a connection that is lost is tried again once a second.

A command of the surfaces is worth sending now or not at all.  On a serial line that is slower than
what is sent, commands would queue up in the kernel, each later than the last, and the release
behind them.  So one that would begin more than `COMMAND_LATE_S` late is left out: the next one is
newer, and a line that is always full carries the newest as often as it can.  To throw away what
waits and send the new one instead would cut the frame that is on the wire, at each tick anew, and
none would arrive.  `clear_for_release` does so once.
"""

from __future__ import annotations

import errno
import fcntl
import ipaddress
import os
import socket
import sys
import termios
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

PEER_SILENCE_S: Final = 3.0
RETRY_S: Final = 1.0
CONNECT_TIMEOUT_S: Final = 3.0
MAX_DATAGRAMS: Final = 64  # in one call: the tick must not wait for a flood
STRANGERS: Final = 16  # datagrams looked at for one that is the peer's
MAX_DATAGRAM_BYTES: Final = 2048
MAX_READ_BYTES: Final = 16384
MAX_UNSENT_BYTES: Final = 1024  # of a stream that does not drain: beyond it, dropped, not late
BITS_PER_BYTE: Final = 10  # on a serial line: a start and a stop bit
# A tick at 200 Hz: what begins later than that comes after a newer command could have.
COMMAND_LATE_S: Final = 0.005
# While commands go out, all else that would begin later is dropped, so that it leaves no longer
# gap between two commands: a tenth of the 0.5 s after which an autopilot acts without them.
OTHERS_LATE_S: Final = 0.05
DEFAULT_BAUD: Final = 921_600

_NOTHING: Final = bytes(4)

FORMS: Final = "udp:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT or serial:/dev/ttyX:BAUD"


class LinkError(Exception):
    """A link that cannot be opened; the message names it and the way out."""


@dataclass(slots=True)
class LinkCounters:
    """What a link carried."""

    bytes_in: int = 0
    bytes_out: int = 0
    dropped_out: int = 0  # frames that could not be sent
    left_out: int = 0  # of these, commands that would have come too late
    strangers: int = 0  # datagrams of somebody who is not the peer
    reconnects: int = 0


class Transport(Protocol):
    """A link."""

    name: str
    is_stream: bool  # frames may be cut anywhere
    counters: LinkCounters
    generation: int  # grows when another peer is at the far end, or the same one anew

    def fileno(self) -> int:
        """To wait on; -1 while there is nothing to wait on."""
        ...

    def receive(self, now_s: float, most: int = MAX_DATAGRAMS) -> list[bytes]:
        """What has come: at most so many whole datagrams, or one whole read of a stream."""
        ...

    def hold(self, now_s: float) -> None:
        """A frame of what came was accepted: the far end is who it should be."""
        ...

    def send(self, data: bytes) -> bool:
        """Send one frame; False if it went nowhere."""
        ...

    def send_command(self, data: bytes) -> bool:
        """Send one frame if it goes at once; False if it does not."""
        ...

    def clear_for_release(self) -> bool:
        """Throw away what would hold up a release; whether a frame may have been cut."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


def open_link(text: str, is_frame: Callable[[bytes], bool], now_s: float = 0.0) -> Transport:
    """Open the link that a string names.

    `is_frame` tells a datagram that begins with a MAVLink frame.  Errors: `LinkError`.
    """
    kind, _, rest = text.partition(":")
    if kind in ("udp", "udpin"):
        return UdpListener(text, *_host_and_port(text, rest), is_frame)
    if kind == "udpout":
        return UdpSpeaker(text, *_host_and_port(text, rest))
    if kind == "tcp":
        return TcpLink(text, *_host_and_port(text, rest), now_s)
    if kind == "serial":
        return SerialLink(text, *_device_and_baud(text, rest), now_s)
    raise LinkError(f"link {text!r}: unknown kind {kind!r}; give {FORMS}")


def check_link(text: str) -> None:
    """Whether a string has the form of a link; nothing is opened.  Errors: `LinkError`."""
    kind, _, rest = text.partition(":")
    if kind == "serial":
        _device_and_baud(text, rest)
    elif kind in ("udp", "udpin", "udpout", "tcp"):
        _host_and_port(text, rest)
    else:
        raise LinkError(f"link {text!r}: unknown kind {kind!r}; give {FORMS}")


def is_open(text: str) -> bool:
    """Whether others than this computer can reach a link of this form."""
    kind, _, rest = text.partition(":")
    if kind == "serial":
        return False
    host = rest.rpartition(":")[0].removeprefix("[").removesuffix("]")
    try:
        found = {str(entry[4][0]) for entry in socket.getaddrinfo(host, None)}
    except OSError:
        return True
    return not all(ipaddress.ip_address(a.partition("%")[0]).is_loopback for a in found)


def baud_of(text: str) -> int | None:
    """The rate of a serial line of this form; None of another link.  Errors: `LinkError`."""
    kind, _, rest = text.partition(":")
    return _device_and_baud(text, rest)[1] if kind == "serial" else None


def _host_and_port(text: str, rest: str) -> tuple[str, int]:
    host, separator, port = rest.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not separator or not host or not port.isascii() or not port.isdigit():
        raise LinkError(f"link {text!r}: needs a host and a port, as in udp:127.0.0.1:14540")
    if not 1 <= int(port) <= 65535:
        raise LinkError(f"link {text!r}: port {port} is not in 1 to 65535")
    return host, int(port)


def _device_and_baud(text: str, rest: str) -> tuple[str, int]:
    device, separator, baud = rest.rpartition(":")
    if not separator:
        device, baud = rest, str(DEFAULT_BAUD)
    if not device:
        raise LinkError(f"link {text!r}: needs a device, as in serial:/dev/ttyAMA0:921600")
    if not baud.isascii() or not baud.isdigit() or not 1200 <= int(baud) <= 4_000_000:
        raise LinkError(f"link {text!r}: baud rate {baud!r} is not in 1200 to 4000000")
    return device, int(baud)


def _resolve(text: str, host: str, port: int, kind: int) -> tuple[int, tuple[str, int]]:
    """(address family, address) of a host's name."""
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=kind)[0]
    except OSError as error:
        raise LinkError(f"link {text!r}: host {host!r} is not known: {error.strerror}") from None
    return family, (str(address[0]), port)


class _Udp:
    """What both ways round share: never raises, never blocks."""

    is_stream = False

    def __init__(self, text: str, family: int) -> None:
        self.name = text
        self.counters = LinkCounters()
        self.generation = 0
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._waiting = bytearray(4)  # bytes of the next datagram, as the kernel writes them

    def fileno(self) -> int:
        return self._socket.fileno()

    def hold(self, now_s: float) -> None:
        pass

    def close(self) -> None:
        self._socket.close()

    def clear_for_release(self) -> bool:
        return False

    def _has_more(self) -> bool:
        """Whether another datagram waits; to fail to read it would take much longer.

        An empty one is not seen: it is the first one of the next time.
        """
        fcntl.ioctl(self._socket, termios.FIONREAD, self._waiting)
        return self._waiting != _NOTHING

    def _send_to(self, data: bytes, address: tuple[str, int]) -> bool:
        try:
            self._socket.sendto(data, address)
        except OSError:
            self.counters.dropped_out += 1
            return False
        self.counters.bytes_out += len(data)
        return True


class UdpListener(_Udp):
    """Listens; the peer is who speaks to us."""

    def __init__(self, text: str, host: str, port: int, is_frame: Callable[[bytes], bool]) -> None:
        family, address = _resolve(text, host, port, socket.SOCK_DGRAM)
        super().__init__(text, family)
        self.peer: tuple[str, int] | None = None
        self._accepted_s = 0.0  # when a frame of the peer was accepted last
        self._is_frame = is_frame
        try:
            self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            raise LinkError(_why_not_bound(text, host, port, error)) from None

    def receive(self, now_s: float, most: int = MAX_DATAGRAMS) -> list[bytes]:
        received: list[bytes] = []
        for _ in range(min(MAX_DATAGRAMS, STRANGERS * most)):
            datagram = self._next()
            if datagram is None:
                break
            data, sender = datagram
            if sender == self.peer or self._becomes_peer(data, sender, now_s):
                self.counters.bytes_in += len(data)
                received.append(data)
            else:
                self.counters.strangers += 1
            if len(received) == most or not self._has_more():
                break
        return received

    def _becomes_peer(self, data: bytes, sender: tuple[str, int], now_s: float) -> bool:
        """Whether the place is free, and this is a frame that would be accepted."""
        is_free = self.peer is None or now_s - self._accepted_s > PEER_SILENCE_S
        if not is_free or not self._is_frame(data):
            return False
        self.peer = sender
        self.generation += 1
        self._accepted_s = now_s
        return True

    def hold(self, now_s: float) -> None:
        self._accepted_s = now_s

    def _next(self) -> tuple[bytes, tuple[str, int]] | None:
        """The next datagram and its sender."""
        while True:
            try:
                data, address = self._socket.recvfrom(MAX_DATAGRAM_BYTES)
            except ConnectionRefusedError:
                continue  # the answer to something sent before the peer was there
            except OSError:
                return None
            return data, (address[0], address[1])

    def send(self, data: bytes) -> bool:
        return self.peer is not None and self._send_to(data, self.peer)

    def send_command(self, data: bytes) -> bool:
        return self.send(data)


def _why_not_bound(text: str, host: str, port: int, error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return (
            f"link {text!r}: port {port} is in use; stop the other program"
            " (another tgl-soar, MAVProxy, mavlink-router?) or give another port"
        )
    if error.errno == errno.EADDRNOTAVAIL:
        return (
            f"link {text!r}: {host} is no address of this computer;"
            " listen on 127.0.0.1 or 0.0.0.0, or use udpout: to speak first"
        )
    if error.errno == errno.EACCES:
        return f"link {text!r}: port {port} needs privileges; give one above 1023"
    return f"link {text!r}: cannot listen: {error.strerror}"


class UdpSpeaker(_Udp):
    """Speaks first; hears only whom it speaks to."""

    def __init__(self, text: str, host: str, port: int) -> None:
        family, self._address = _resolve(text, host, port, socket.SOCK_DGRAM)
        super().__init__(text, family)
        try:
            self._socket.connect(self._address)
        except OSError as error:
            self._socket.close()
            raise LinkError(f"link {text!r}: no way to {host}: {error.strerror}") from None

    def receive(
        self,
        now_s: float,  # noqa: ARG002 - a Transport is given the time
        most: int = MAX_DATAGRAMS,
    ) -> list[bytes]:
        received: list[bytes] = []
        for _ in range(MAX_DATAGRAMS):
            try:
                data = self._socket.recv(MAX_DATAGRAM_BYTES)
            except ConnectionRefusedError:
                continue  # the answer to something sent before the peer was there
            except OSError:
                break
            self.counters.bytes_in += len(data)
            received.append(data)
            if len(received) == most or not self._has_more():
                break
        return received

    def send(self, data: bytes) -> bool:
        try:
            self._socket.send(data)
        except OSError:
            self.counters.dropped_out += 1
            return False
        self.counters.bytes_out += len(data)
        return True

    def send_command(self, data: bytes) -> bool:
        return self.send(data)


class _Stream:
    """A line that may be lost and come back: serial or TCP."""

    is_stream = True

    def __init__(self, text: str) -> None:
        self.name = text
        self.counters = LinkCounters()
        self.generation = 0
        self._fd = -1
        self._unsent = bytearray()
        self._retry_s = 0.0

    def _reopen(self, now_s: float) -> bool:
        """Try once, without blocking; sets `_fd`."""
        raise NotImplementedError

    def _release(self) -> None:
        """Close whatever holds `_fd`."""
        raise NotImplementedError

    def fileno(self) -> int:
        return self._fd

    def close(self) -> None:
        if self._fd >= 0:
            self._fd = -1
            self._release()
        self._unsent.clear()

    def hold(self, now_s: float) -> None:
        pass

    def receive(self, now_s: float, most: int = MAX_DATAGRAMS) -> list[bytes]:  # noqa: ARG002
        if self._fd < 0 and not self._retried(now_s):
            return []
        self._drain(b"")
        try:
            data = os.read(self._fd, MAX_READ_BYTES)
        except BlockingIOError:
            return []
        except OSError:
            self._lost(now_s)
            return []
        if not data:  # end of file: hung up
            self._lost(now_s)
            return []
        self.counters.bytes_in += len(data)
        return [data]

    def send(self, data: bytes) -> bool:
        if self._fd < 0 or len(self._unsent) + len(data) > MAX_UNSENT_BYTES:
            self.counters.dropped_out += 1
            return False
        return self._drain(data)

    def send_command(self, data: bytes) -> bool:
        return self.send(data)

    def clear_for_release(self) -> bool:
        return False

    def _drain(self, data: bytes) -> bool:
        """Write what waits and what is new; the rest waits, so that no frame is cut."""
        self._unsent += data
        if self._unsent:
            try:
                written = os.write(self._fd, self._unsent)
            except BlockingIOError:
                written = 0
            except OSError:
                self._unsent.clear()  # the next read finds the line lost
                self.counters.dropped_out += 1
                return False
            self.counters.bytes_out += written
            del self._unsent[:written]
        return True

    def _lost(self, now_s: float) -> None:
        self.close()
        self._retry_s = now_s + RETRY_S

    def _retried(self, now_s: float) -> bool:
        if now_s < self._retry_s:
            return False
        self._retry_s = now_s + RETRY_S
        if not self._reopen(now_s):
            return False
        self.counters.reconnects += 1
        self.generation += 1
        return True


class SerialLink(_Stream):
    """A serial line."""

    def __init__(self, text: str, device: str, baud: int, now_s: float) -> None:
        super().__init__(text)
        self._device = device
        self._baud = baud
        self._commands = False  # commands go out
        try:
            self._open()
        except LinkError:
            raise
        except (OSError, ValueError, termios.error) as error:
            raise LinkError(_why_no_serial(text, device, error)) from None
        self._retry_s = now_s + RETRY_S

    def _open(self) -> None:
        import serial  # only who has a serial line waits for this import

        try:
            self._port = serial.Serial(
                self._device, self._baud, timeout=0, write_timeout=0, exclusive=True
            )
        except serial.SerialException as error:
            raise LinkError(_why_no_serial(self.name, self._device, error)) from None
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
        """What was sent and is not yet on the wire, as the driver counts it."""
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
            return  # the device is gone, and with it what there was to close


def _why_no_serial(text: str, device: str, error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number == errno.ENOENT or not Path(device).exists():
        return (
            f"link {text!r}: there is no {device}; `ls /dev/tty*` lists the lines,"
            " and on a Raspberry Pi the serial port must be enabled"
        )
    if number == errno.EACCES:
        return (
            f"link {text!r}: {device} may not be opened;"
            " add the user to its group (dialout) and log in again"
        )
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in str(error):
        return f"link {text!r}: {device} is in use by another program; stop that first"
    return f"link {text!r}: {device} cannot be opened as a serial line: {error}"


class TcpLink(_Stream):
    """A connection that we make."""

    def __init__(self, text: str, host: str, port: int, now_s: float) -> None:
        super().__init__(text)
        self._family, self._address = _resolve(text, host, port, socket.SOCK_STREAM)
        self._pending: socket.socket | None = None
        self._socket = socket.socket(self._family, socket.SOCK_STREAM)
        self._socket.settimeout(CONNECT_TIMEOUT_S)
        try:
            self._socket.connect(self._address)
        except OSError as error:
            self._socket.close()
            raise LinkError(
                f"link {text!r}: no connection: {error.strerror or error};"
                " is something listening there?"
            ) from None
        self._take(self._socket)
        self._retry_s = now_s + RETRY_S

    def _take(self, connected: socket.socket) -> None:
        connected.setblocking(False)
        connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket = connected
        self._fd = connected.fileno()

    def _reopen(self, now_s: float) -> bool:  # noqa: ARG002
        """A connection begun at one try is looked at in the next."""
        if self._pending is None:
            self._pending = socket.socket(self._family, socket.SOCK_STREAM)
            self._pending.setblocking(False)
        state = self._pending.connect_ex(self._address)
        if state in (0, errno.EISCONN):
            self._take(self._pending)
            self._pending = None
            return True
        if state not in (errno.EINPROGRESS, errno.EALREADY):
            self._pending.close()
            self._pending = None
        return False

    def _release(self) -> None:
        self._socket.close()
