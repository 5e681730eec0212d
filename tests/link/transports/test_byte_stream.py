"""What every stream of bytes does with what it could not send, by pairs of sockets."""

from __future__ import annotations

import socket
from contextlib import closing

import pytest

from tgl_soar.link.transports.byte_stream import RETRY_S, ByteStream

pytestmark = pytest.mark.interpreted  # it stands in for parts of what flies


class Pairs(ByteStream):
    """A line whose far end is at hand; each reopening makes another."""

    def __init__(self) -> None:
        super().__init__("pair")
        assert self._reopen(0.0)

    def _reopen(self, _now_s: float) -> bool:
        near, self.far = socket.socketpair()
        near.setblocking(False)
        near.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)  # the least that there is
        self.near, self._fd = near, near.fileno()
        return True

    def _release(self) -> None:
        self.near.close()


def test_what_waited_for_a_line_that_is_lost_is_not_sent_over_the_next() -> None:
    """The far end hangs up and has not read all: the next would take a frame's rest for its
    beginning, and commands of then for those of now."""
    with closing(Pairs()) as link:
        first = link.far
        while link.send(bytes(250)):
            pass
        assert link.counters.dropped_out == 1  # as so much waits already
        first.shutdown(socket.SHUT_WR)
        assert link.receive(5.0) == []
        assert link.fileno() == -1
        first.close()
        assert link.receive(5.0 + RETRY_S) == []
        assert (link.fileno() >= 0, link.generation) == (True, 1)
        assert link.send(b"frame")
        link.far.settimeout(2.0)
        assert link.far.recv(100) == b"frame"
        link.far.close()
