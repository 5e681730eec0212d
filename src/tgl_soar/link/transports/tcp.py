"""A TCP connection to a listener.

The kernel takes megabytes for a peer that does not, and hands them over later, each command older
than the last.  So while something waits there, a command is omitted, as on a serial line, and so
is all else beyond `OTHERS_BYTES`.  What is on its way already, or waits where it has arrived,
cannot be counted or taken back from here: behind a listener that reads slowly, such as a server
before a serial line, commands are late all the same.
"""

from __future__ import annotations

import errno
import fcntl
import socket
import sys
from typing import Final

from tgl_soar.link.transports.addresses import resolved
from tgl_soar.link.transports.base import LinkNotReadyError
from tgl_soar.link.transports.byte_stream import MAX_UNSENT_BYTES, RETRY_S, ByteStream

CONNECT_TIMEOUT_S: Final = 3.0
OTHERS_BYTES: Final = MAX_UNSENT_BYTES
_SIOCOUTQNSD: Final = 0x894B  # linux/sockios.h: bytes that were not sent yet


class TcpLink(ByteStream):
    """A connection that we make."""

    def __init__(self, text: str, host: str, port: int, now_s: float) -> None:
        super().__init__(text)
        self._family, self._address = resolved(text, host, port, socket.SOCK_STREAM)
        self._pending: socket.socket | None = None
        self._socket = socket.socket(self._family, socket.SOCK_STREAM)
        self._socket.settimeout(CONNECT_TIMEOUT_S)
        try:
            self._socket.connect(self._address)
        except OSError as error:
            self._socket.close()
            raise LinkNotReadyError(
                f"link {text!r}: no connection: {error.strerror or error};"
                " is something listening there?"
            ) from None
        self._take(self._socket)
        self._retry_s = now_s + RETRY_S

    def send(self, data: bytes) -> bool:
        if self.backlog_bytes() > OTHERS_BYTES:
            self.counters.dropped_out += 1
            return False
        return super().send(data)

    def send_command(self, data: bytes) -> bool:
        if self.backlog_bytes() > 0:
            self.counters.dropped_out += 1
            self.counters.left_out += 1
            return False
        return super().send(data)

    def backlog_bytes(self) -> int:
        """Bytes that were written and did not leave this computer yet."""
        if self._fd < 0:
            return 0
        queued = bytearray(4)
        try:
            fcntl.ioctl(self._fd, _SIOCOUTQNSD, queued)
        except OSError:
            return len(self._unsent)
        return len(self._unsent) + int.from_bytes(queued, sys.byteorder)

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
