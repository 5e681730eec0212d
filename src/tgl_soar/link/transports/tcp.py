"""A TCP connection to a listener."""

from __future__ import annotations

import errno
import socket
from typing import Final

from tgl_soar.link.transports.addresses import resolved
from tgl_soar.link.transports.base import LinkError
from tgl_soar.link.transports.byte_stream import RETRY_S, ByteStream

CONNECT_TIMEOUT_S: Final = 3.0


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
