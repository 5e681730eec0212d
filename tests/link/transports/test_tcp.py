"""A TCP link on this machine: a peer that does not read, and one that comes back."""

import select
import socket

from tgl_soar.link.open_link import open_link
from tgl_soar.link.transports.base import Transport
from tgl_soar.link.transports.tcp import OTHERS_BYTES, TcpLink

LOCAL = "127.0.0.1"


def is_frame(data: bytes) -> bool:
    return data.startswith(b"frame")


def received(link: Transport, now_s: float = 0.0) -> list[bytes]:
    select.select([link.fileno()], [], [], 2.0)
    return link.receive(now_s)


def test_tcp_queues_no_commands_for_a_peer_that_does_not_read() -> None:
    with socket.create_server((LOCAL, 0)) as server:
        server.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1)  # the least that there is
        link = open_link(f"tcp:{LOCAL}:{server.getsockname()[1]}", is_frame)
        assert isinstance(link, TcpLink)
        with server.accept()[0] as peer:
            commands = [b"command %05d;" % number for number in range(10_000)]
            sent = [command for command in commands if link.send_command(command)]
            assert len(sent) < len(commands) // 2  # its buffer is full
            assert link.counters.left_out == len(commands) - len(sent)
            assert 0 < link.backlog_bytes() <= 2 * len(commands[0])
            words = [link.send(bytes(100)) for _ in range(100)]
            assert False in words
            assert link.backlog_bytes() <= OTHERS_BYTES + len(bytes(100))
            peer.settimeout(0.5)
            read = b""
            while link.backlog_bytes() > 0 or not read.endswith(bytes(1)):
                read += peer.recv(100_000)
                link.receive(0.0)
            assert link.send_command(b"the newest")  # as soon as it reads again
        link.close()


def test_tcp_connects_and_comes_back() -> None:
    with socket.create_server((LOCAL, 0)) as server:
        port = server.getsockname()[1]
        link = open_link(f"tcp:{LOCAL}:{port}", is_frame)
        assert isinstance(link, TcpLink)
        there, _ = server.accept()
        there.sendall(b"one")
        assert received(link) == [b"one"]
        there.close()
        assert received(link, 5.0) == []  # hung up
        assert link.fileno() == -1
        assert not link.send(b"lost")
        assert link.receive(5.5) == []  # too early to try again
        assert link.fileno() == -1
        link.receive(6.1)
        there, _ = server.accept()
        link.receive(7.2)
        assert link.fileno() >= 0
        assert link.counters.reconnects == 1
        assert link.send(b"again")
        assert there.recv(100) == b"again"
        there.close()
        link.close()
