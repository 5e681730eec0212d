"""UDP on this machine: which peer a listener has, for how long, and what a call costs."""

import select
import socket
from collections.abc import Iterator

import pytest
from free_ports import free_port

from tgl_soar.link.open_link import open_link
from tgl_soar.link.transports.base import MAX_DATAGRAMS, LinkNotReadyError, Transport
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


def test_a_port_in_use_says_so(listener: UdpListener) -> None:
    with pytest.raises(LinkNotReadyError, match="is in use; stop the other program"):
        open_link(listener.name, is_frame)
