"""What a serial line and a TCP connection share: bytes in order, and a line that may be lost.

A line that is lost is tried again once a second.
"""

from __future__ import annotations

import os
from typing import Final

from tgl_soar.link.transports.base import MAX_DATAGRAMS, LinkCounters

RETRY_S: Final = 1.0
MAX_READ_BYTES: Final = 16384
MAX_UNSENT_BYTES: Final = 1024  # of a stream that does not drain: beyond it, dropped, not late


class ByteStream:
    """A line that may be lost and come back."""

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
