"""Links on this machine: real sockets on ephemeral ports, a pseudo-terminal for a serial line."""

import os
import pty
import select
import socket
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest
from free_ports import free_port

from tgl_soar.link.transport import is_open, open_link
from tgl_soar.link.transports.base import (
    MAX_DATAGRAMS,
    LinkError,
    LinkNotReadyError,
    Transport,
)
from tgl_soar.link.transports.serial_line import SerialLink
from tgl_soar.link.transports.tcp import OTHERS_BYTES, TcpLink
from tgl_soar.link.transports.udp import PEER_SILENCE_S, STRANGERS, UdpListener, UdpSpeaker

LOCAL = "127.0.0.1"


def is_frame(data: bytes) -> bool:
    return data.startswith(b"frame")


@pytest.fixture
def peer() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind((LOCAL, 0))
        made.settimeout(2.0)
        yield made


@pytest.fixture
def listener() -> Iterator[UdpListener]:
    link = open_link(f"udp:{LOCAL}:{free_port()}", is_frame)
    assert isinstance(link, UdpListener)
    yield link
    link.close()


def received(link: Transport, now_s: float = 0.0) -> list[bytes]:
    select.select([link.fileno()], [], [], 2.0)
    return link.receive(now_s)


def address(link: Transport) -> tuple[str, int]:
    return LOCAL, int(link.name.rpartition(":")[2])


def test_the_listener_answers_who_speaks_to_it(listener: UdpListener, peer: socket.socket) -> None:
    assert not listener.send(b"nobody there")
    assert listener.receive(0.0) == []
    peer.sendto(b"frame 1", address(listener))
    assert received(listener) == [b"frame 1"]
    assert listener.send(b"answer")
    assert peer.recv(100) == b"answer"


def test_what_is_no_mavlink_makes_no_peer(listener: UdpListener, peer: socket.socket) -> None:
    peer.sendto(b"hello?", address(listener))
    assert received(listener) == []
    assert listener.peer is None
    assert listener.counters.strangers == 1


def test_a_stranger_cannot_take_the_place_of_a_live_peer(
    listener: UdpListener, peer: socket.socket
) -> None:
    peer.sendto(b"frame", address(listener))
    received(listener, 10.0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(b"frame of another", address(listener))
        assert received(listener, 10.0 + PEER_SILENCE_S) == []
        assert listener.peer == peer.getsockname()
        stranger.sendto(b"frame of another", address(listener))
        assert received(listener, 10.1 + PEER_SILENCE_S) == [b"frame of another"]
        assert listener.peer is not None
        assert listener.peer[1] == stranger.getsockname()[1]


@pytest.mark.parametrize("kept_up_with", [b"!", b"frame of old"])
def test_bytes_that_nobody_accepts_hold_no_place(
    kept_up_with: bytes, listener: UdpListener, peer: socket.socket
) -> None:
    """As a replay does it: a frame that took the place, then one byte a second."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as replay:
        replay.sendto(b"frame of old", address(listener))
        received(listener, 10.0)
        for second in range(1, 5):
            replay.sendto(kept_up_with, address(listener))
            received(listener, 10.0 + second)
        peer.sendto(b"frame", address(listener))
        assert received(listener, 14.0) == [b"frame"]
    assert listener.peer == peer.getsockname()


def test_accepted_frames_hold_the_place(listener: UdpListener, peer: socket.socket) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for second in range(10):
            peer.sendto(b"frame", address(listener))
            assert received(listener, second) == [b"frame"]
            listener.hold(float(second))
            stranger.sendto(b"frame of another", address(listener))
            assert received(listener, second + 0.5) == []
    assert listener.peer == peer.getsockname()


def test_few_may_be_asked_for_and_strangers_do_not_count(
    listener: UdpListener, peer: socket.socket
) -> None:
    peer.sendto(b"frame 0", address(listener))
    assert received(listener) == [b"frame 0"]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for _ in range(STRANGERS + 1):
            stranger.sendto(b"frame of another", address(listener))
        peer.sendto(b"frame 1", address(listener))
        peer.sendto(b"frame 2", address(listener))
        assert [link.receive(0.0, 1) for link in [listener] * 4] == [
            [],
            [b"frame 1"],
            [b"frame 2"],
            [],
        ]
    assert listener.counters.strangers == STRANGERS + 1


def test_one_call_does_a_bounded_amount_of_work(listener: UdpListener, peer: socket.socket) -> None:
    for i in range(MAX_DATAGRAMS + 10):
        peer.sendto(b"frame %d" % i, address(listener))
    assert len(received(listener)) == MAX_DATAGRAMS
    assert len(received(listener)) == 10


def test_an_empty_datagram_holds_nothing_back(listener: UdpListener, peer: socket.socket) -> None:
    for data in (b"frame 1", b"", b"frame 2", b"frame 3"):
        peer.sendto(data, address(listener))
    came = received(listener)
    while came[-1] != b"frame 3":
        came += received(listener)
    assert came == [b"frame 1", b"", b"frame 2", b"frame 3"]


def test_the_speaker_speaks_first_and_survives_that_nobody_listens(peer: socket.socket) -> None:
    closed = open_link(f"udpout:{LOCAL}:{free_port()}", is_frame)
    for _ in range(3):
        closed.send(b"anyone?")
        assert closed.receive(0.0) == []
    closed.close()
    link = open_link(f"udpout:{LOCAL}:{peer.getsockname()[1]}", is_frame)
    assert isinstance(link, UdpSpeaker)
    assert link.send(b"hello")
    data, back = peer.recvfrom(100)
    assert data == b"hello"
    peer.sendto(b"to you too", back)
    assert received(link) == [b"to you too"]
    link.close()


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


@pytest.fixture
def line(tmp_path: Path) -> Iterator[tuple[int, Path]]:
    """The far end of a serial line, and the name of ours: a link, so that it can be re-plugged."""
    far, near = pty.openpty()
    tty.setraw(near)
    device = tmp_path / "ttyTEST"
    device.symlink_to(os.ttyname(near))
    os.close(near)
    yield far, device
    os.close(far)


def test_a_serial_line_carries_both_ways(line: tuple[int, Path]) -> None:
    far, device = line
    link = open_link(f"serial:{device}:921600", is_frame)
    assert isinstance(link, SerialLink)
    assert link.is_stream
    assert link.receive(0.0) == []
    os.write(far, b"\xfd\x00half a fra")
    assert received(link) == [b"\xfd\x00half a fra"]
    assert link.send(b"\x00\x11\x13\xff")
    assert os.read(far, 100) == b"\x00\x11\x13\xff"
    link.close()
    link.close()


def test_a_serial_line_that_does_not_drain_drops_whole_frames(line: tuple[int, Path]) -> None:
    far, device = line
    link = open_link(f"serial:{device}", is_frame)
    frames = [bytes((i % 251,)) * 100 for i in range(3000)]
    sent = [frame for frame in frames if link.send(frame)]
    assert link.counters.dropped_out == len(frames) - len(sent) > 0
    got = b""
    while len(got) < 100 * len(sent):
        got += os.read(far, 4096)
        link.receive(0.0)
    assert got == b"".join(sent)
    link.close()


def test_a_serial_line_that_hangs_up_is_tried_once_a_second(tmp_path: Path) -> None:
    device = tmp_path / "ttyTEST"

    def plug() -> int:
        far, near = pty.openpty()
        tty.setraw(near)
        device.unlink(missing_ok=True)
        device.symlink_to(os.ttyname(near))
        os.close(near)
        return far

    far = plug()
    link = open_link(f"serial:{device}:115200", is_frame)
    os.close(far)
    assert received(link, 1.0) == []
    assert link.fileno() == -1
    device.unlink()
    assert link.receive(2.5) == []
    assert link.fileno() == -1
    far = plug()
    assert link.receive(2.6) == []
    assert link.fileno() == -1  # not yet: it was tried at 2.5
    link.receive(3.6)
    assert link.fileno() >= 0
    os.write(far, b"back")
    assert received(link, 3.7) == [b"back"]
    os.close(far)
    link.close()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "unknown kind"),
        ("carrier-pigeon:1", "unknown kind 'carrier-pigeon'"),
        ("udp:127.0.0.1", "needs a host and a port"),
        ("udp::14540", "needs a host and a port"),
        ("udp:127.0.0.1:abc", "needs a host and a port"),
        ("udp:127.0.0.1:0", "port 0 is not in 1 to 65535"),
        ("udp:127.0.0.1:99999", "port 99999 is not in 1 to 65535"),
        ("udp:no such host.invalid:14540", "is not known"),
        ("udp:192.0.2.1:14540", "no address of this computer"),
        ("serial:", "needs a device"),
        ("serial:/dev/tty-none:921600", "there is no /dev/tty-none"),
        ("serial:/dev/ttyS0:fast", "baud rate 'fast'"),
        ("serial:/dev/ttyS0:1", "baud rate '1'"),
        ("serial:/dev/null:921600", "cannot be opened as a serial line"),
        (f"tcp:{LOCAL}:1", "is something listening there?"),
    ],
)
def test_a_link_that_cannot_be_opened_is_named_with_the_way_out(text: str, words: str) -> None:
    with pytest.raises(LinkError) as caught:
        open_link(text, is_frame)
    assert words in str(caught.value)
    assert repr(text) in str(caught.value)


@pytest.mark.parametrize(
    ("text", "passes"),
    [
        ("serial:/dev/tty-none:921600", True),  # not enumerated yet
        ("serial:/dev/null:921600", False),
        ("serial:/dev/ttyS0:fast", False),
        ("udp:192.0.2.1:14540", True),  # its interface is not up yet
        ("udp:127.0.0.1:99999", False),
        ("udpout:255.255.255.255:14550", False),  # to all, which nobody may
        (f"tcp:{LOCAL}:1", True),  # its program is not started yet
        ("carrier-pigeon:1", False),
    ],
)
def test_what_may_pass_is_told_from_a_mistake(text: str, passes: bool) -> None:
    with pytest.raises(LinkError) as caught:
        open_link(text, is_frame)
    assert isinstance(caught.value, LinkNotReadyError) is passes


def test_a_port_in_use_says_so(listener: UdpListener) -> None:
    with pytest.raises(LinkNotReadyError, match="is in use; stop the other program"):
        open_link(listener.name, is_frame)


@pytest.mark.parametrize(
    ("link", "opened"),
    [
        ("udp:127.0.0.1:14540", False),
        ("udp:localhost:14540", False),
        ("udpout:127.0.0.7:1", False),
        ("tcp:[::1]:5760", False),
        ("serial:/dev/ttyAMA0:921600", False),
        ("udp:0.0.0.0:14540", True),
        ("udp:[::]:14540", True),
        ("udpout:192.0.2.1:14550", True),
        ("tcp:10.1.2.3:5760", True),
    ],
)
def test_which_links_others_can_reach(link: str, opened: bool) -> None:
    assert is_open(link) == opened
