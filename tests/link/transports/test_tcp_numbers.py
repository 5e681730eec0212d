"""What waits in the kernel for a TCP peer, what is sent meanwhile, and how a connection comes back.

The kernel's answers are made up where a real one would take its time.
"""

from __future__ import annotations

import errno
import fcntl
import socket
import sys
from collections.abc import Iterator
from typing import Any

import pytest

from tgl_soar.link.transports.base import LinkNotReadyError
from tgl_soar.link.transports.tcp import TcpLink

# The kernel's part is put in the place of the real one.
pytestmark = pytest.mark.interpreted

LOCAL = "127.0.0.1"
SIOCOUTQNSD = 0x894B  # linux/sockios.h


class Made:
    """A connection, its far end, and what the kernel says of it."""

    def __init__(self, link: TcpLink, far: socket.socket, monkeypatch: pytest.MonkeyPatch) -> None:
        self.link, self.far = link, far
        self.queued = 0  # bytes; below 0: it cannot say
        far.settimeout(2.0)
        monkeypatch.setattr(fcntl, "ioctl", self._ioctl)

    def _ioctl(self, fd: int, request: int, answer: bytearray) -> int:
        assert fd == self.link.fileno()
        assert request == SIOCOUTQNSD
        if self.queued < 0:
            raise OSError
        answer[:] = self.queued.to_bytes(4, sys.byteorder)
        return 0


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Iterator[Made]:
    with socket.create_server((LOCAL, 0)) as server:
        port = server.getsockname()[1]
        link = TcpLink(f"tcp:{LOCAL}:{port}", LOCAL, port, 100.0)
        with server.accept()[0] as far:
            yield Made(link, far, monkeypatch)
        link.close()


def test_frames_leave_at_once_and_no_read_waits(made: Made) -> None:
    link = made.link
    assert link._socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) != 0
    assert not link._socket.getblocking()
    assert link.is_stream
    assert link.send(b"one")
    assert link.send_command(b"two")
    data = b""
    while len(data) < 6:
        data += made.far.recv(100)
    assert data == b"onetwo"
    assert link.counters.bytes_out == 6
    assert (link.counters.dropped_out, link.counters.left_out) == (0, 0)


@pytest.mark.parametrize(("queued", "is_sent"), [(0, True), (1, False), (70_000, False)])
def test_a_command_is_left_out_while_anything_waits(made: Made, queued: int, is_sent: bool) -> None:
    made.queued = queued
    assert made.link.send_command(b"command") is is_sent
    counters = made.link.counters
    assert counters.dropped_out == counters.left_out == (not is_sent)


@pytest.mark.parametrize(("queued", "is_sent"), [(1024, True), (1025, False)])
def test_all_else_is_dropped_where_more_than_a_kibibyte_waits(
    made: Made, queued: int, is_sent: bool
) -> None:
    made.queued = queued
    assert made.link.send(b"words") is is_sent
    counters = made.link.counters
    assert (counters.dropped_out, counters.left_out) == (not is_sent, 0)


def test_what_waits_here_and_in_the_kernel_is_one_backlog(made: Made) -> None:
    made.link._unsent += bytes(7)
    made.queued = 0x0102
    assert made.link.backlog_bytes() == 7 + 0x0102
    made.queued = -1
    assert made.link.backlog_bytes() == 7
    made.link.close()
    assert made.link.backlog_bytes() == 0


def test_a_peer_that_is_not_there_is_named_with_the_way_out() -> None:
    with socket.create_server((LOCAL, 0)) as server:
        port = server.getsockname()[1]
    with pytest.raises(LinkNotReadyError) as caught:
        TcpLink(f"tcp:{LOCAL}:{port}", LOCAL, port, 0.0)
    assert str(caught.value) == (
        f"link 'tcp:{LOCAL}:{port}': no connection: Connection refused;"
        " is something listening there?"
    )


class Trying:
    """A socket whose attempts to connect end as scripted."""

    answers: list[int]
    made: list[Trying]

    def __init__(self, family: int, kind: int) -> None:
        assert (family, kind) == (socket.AF_INET, socket.SOCK_STREAM)
        self.is_blocking = True
        self.options: list[tuple[int, ...]] = []
        self.closed = 0
        Trying.made.append(self)

    def setblocking(self, blocking: bool) -> None:
        self.is_blocking = blocking

    def setsockopt(self, *option: int) -> None:
        self.options.append(option)

    def connect_ex(self, address: tuple[str, int]) -> int:
        assert not self.is_blocking
        assert address[0] == LOCAL
        return Trying.answers.pop(0)

    def fileno(self) -> int:
        return 77

    def close(self) -> None:
        self.closed += 1


@pytest.mark.parametrize("connected", [0, errno.EISCONN])
def test_a_connection_is_begun_at_one_try_and_looked_at_in_the_next(
    made: Made, monkeypatch: pytest.MonkeyPatch, connected: int
) -> None:
    Trying.made = []
    Trying.answers = [errno.EINPROGRESS, errno.EALREADY, errno.ECONNREFUSED]
    Trying.answers += [errno.EINPROGRESS, connected]
    link: Any = made.link
    link.close()
    monkeypatch.setattr(socket, "socket", Trying)
    tried = [link._reopen(200.0 + i) for i in range(5)]
    assert tried == [False] * 4 + [True]
    first, second = Trying.made  # one that was refused is given up, and another tried
    assert (first.closed, second.closed) == (1, 0)
    assert link.fileno() == 77
    assert second.options == [(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)]
    link.close()
    assert second.closed == 1
    Trying.answers = [errno.EINPROGRESS]
    assert not link._reopen(300.0)
    assert len(Trying.made) == 3  # the next begins again


def test_after_a_loss_it_is_tried_after_a_second(made: Made) -> None:
    tried: list[float] = []
    link: Any = made.link

    def fail(now_s: float) -> bool:
        tried.append(now_s)
        return False

    link._reopen = fail
    made.far.close()
    while link.fileno() >= 0:
        link.receive(200.0)
    for tenth in range(21):
        link.receive(200.0 + tenth / 10)
    assert tried == pytest.approx([201.0, 202.0])
