"""Datagrams: a listener, or a link that sends first.

A UDP listener takes its peer from a datagram only if that begins with a frame that would be
accepted: checksum right, and with a key signed, and later than all that was received before.  The
peer keeps its place by accepted frames alone (`hold`); bytes, refused frames and replayed frames
do not keep it.  Another may follow when nothing was accepted for `PEER_SILENCE_S`.
"""

from __future__ import annotations

import errno
import fcntl
import socket
import termios
from collections.abc import Callable
from typing import Final

from tgl_soar.link.transports.addresses import resolved
from tgl_soar.link.transports.base import (
    MAX_DATAGRAMS,
    LinkCounters,
    not_opened,
)

PEER_SILENCE_S: Final = 3.0
STRANGERS: Final = 16  # datagrams looked at for one that is the peer's
MAX_DATAGRAM_BYTES: Final = 2048

_NOTHING: Final = bytes(4)


class _Udp:
    """What both kinds share: never raises, never blocks."""

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

        An empty one is not noticed: the next call reads it first.
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
    """Listens; the peer is the first sender of an accepted frame."""

    def __init__(self, text: str, host: str, port: int, is_frame: Callable[[bytes], bool]) -> None:
        family, address = resolved(text, host, port, socket.SOCK_DGRAM)
        super().__init__(text, family)
        self.peer: tuple[str, int] | None = None
        self._accepted_s = 0.0  # when a frame of the peer was accepted last
        self._is_frame = is_frame
        try:
            self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            raise not_opened(error, _why_not_bound(text, host, port, error)) from None

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
            " listen on 127.0.0.1 or 0.0.0.0, or use udpout: to send first"
        )
    if error.errno == errno.EACCES:
        return f"link {text!r}: port {port} needs privileges; give one above 1023"
    return f"link {text!r}: cannot listen: {error.strerror}"


class UdpSpeaker(_Udp):
    """Sends first; receives only from that address."""

    def __init__(self, text: str, host: str, port: int) -> None:
        family, self._address = resolved(text, host, port, socket.SOCK_DGRAM)
        super().__init__(text, family)
        try:
            self._socket.connect(self._address)
        except OSError as error:
            self._socket.close()
            words = f"link {text!r}: no way to {host}: {error.strerror}"
            raise not_opened(error, words) from None

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
