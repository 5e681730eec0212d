"""What UDP links count, how long a peer keeps its place, how often the kernel is asked."""

from __future__ import annotations

import errno
import select
import socket
from collections.abc import Iterator
from typing import Any

import pytest
from free_ports import free_port

from tgl_soar.link.transports.udp import UdpListener, UdpSpeaker, _why_not_bound

LOCAL = "127.0.0.1"


@pytest.fixture
def peer() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as made:
        made.bind((LOCAL, 0))
        made.settimeout(2.0)
        yield made


@pytest.fixture
def listener() -> Iterator[UdpListener]:
    port = free_port()
    link = UdpListener(f"udp:{LOCAL}:{port}", LOCAL, port, lambda data: data[:1] == b"f")
    yield link
    link.close()


def at(link: UdpListener) -> tuple[str, int]:
    return LOCAL, int(link.name.rpartition(":")[2])


def wait_for(link: UdpListener | UdpSpeaker) -> None:
    assert select.select([link.fileno()], [], [], 2.0)[0]


class Counted:
    """A socket, and how often it was read."""

    def __init__(self, inner: socket.socket) -> None:
        self.inner = inner
        self.reads = 0

    def __getattr__(self, name: str) -> Any:
        if name in ("recv", "recvfrom"):
            self.reads += 1
        return getattr(self.inner, name)


def test_a_read_that_must_fail_is_not_tried(listener: UdpListener, peer: socket.socket) -> None:
    """To fail takes much longer than to ask whether something waits."""
    counted: Any = Counted(listener._socket)
    listener._socket = counted
    peer.sendto(b"f1", at(listener))
    peer.sendto(b"f2", at(listener))
    wait_for(listener)
    assert listener.receive(0.0) == [b"f1", b"f2"]
    assert counted.reads == 2


def test_neither_of_a_speaker(peer: socket.socket) -> None:
    speaker = UdpSpeaker("udpout:x", *peer.getsockname())
    try:
        counted: Any = Counted(speaker._socket)
        speaker._socket = counted
        assert speaker.send(b"hello")
        _, address = peer.recvfrom(10)
        peer.sendto(b"one", address)
        peer.sendto(b"three", address)
        wait_for(speaker)
        assert speaker.receive(0.0) == [b"one", b"three"]
        assert counted.reads == 2
        assert (speaker.counters.bytes_in, speaker.counters.bytes_out) == (8, 5)
        assert speaker.generation == 0
        assert not speaker.is_stream
        assert not speaker.clear_for_release()
    finally:
        speaker.close()


def test_a_speaker_reads_no_more_than_it_is_asked_for(peer: socket.socket) -> None:
    speaker = UdpSpeaker("udpout:x", *peer.getsockname())
    try:
        assert speaker.send_command(b"hello")
        _, address = peer.recvfrom(10)
        for data in (b"1", b"2", b"3"):
            peer.sendto(data, address)
        wait_for(speaker)
        assert [speaker.receive(0.0, 2), speaker.receive(0.0, 2)] == [[b"1", b"2"], [b"3"]]
    finally:
        speaker.close()


def test_bytes_of_the_peer_are_counted_both_ways_and_strangers_one_by_one(
    listener: UdpListener, peer: socket.socket
) -> None:
    assert not listener.is_stream
    assert not listener.clear_for_release()
    assert not listener.send(b"nobody is there")
    peer.sendto(b"f123456789", at(listener))
    wait_for(listener)
    assert listener.receive(0.0) == [b"f123456789"]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.sendto(b"f1", at(listener))
        other.sendto(b"f2", at(listener))
        wait_for(listener)
        assert listener.receive(0.0) == []
    assert listener.send(b"1234")
    assert listener.send_command(b"56")
    counters = listener.counters
    assert (counters.bytes_in, counters.bytes_out, counters.strangers) == (10, 6, 2)
    assert counters.dropped_out == 0
    assert listener.generation == 1
    assert listener.peer == peer.getsockname()


def test_a_listener_that_is_closed_frees_its_port(listener: UdpListener) -> None:
    listener.close()
    assert listener.fileno() == -1
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(at(listener))


@pytest.mark.parametrize(("silent_s", "is_taken"), [(2.9, False), (3.1, True)])
def test_another_follows_where_nothing_was_accepted_for_three_seconds(
    listener: UdpListener, peer: socket.socket, silent_s: float, is_taken: bool
) -> None:
    peer.sendto(b"f", at(listener))
    wait_for(listener)
    listener.receive(100.0)
    listener.hold(105.0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.sendto(b"f", at(listener))
        wait_for(listener)
        assert (listener.receive(105.0 + silent_s) == [b"f"]) is is_taken
    assert listener.generation == 1 + is_taken


def test_the_largest_frame_of_all_comes_whole(listener: UdpListener, peer: socket.socket) -> None:
    """Several in one datagram, up to two kibibytes; what is longer is cut there."""
    for size in (2048, 2049):
        peer.sendto(b"f" * size, at(listener))
        wait_for(listener)
        assert [len(data) for data in listener.receive(0.0)] == [2048]


def test_what_the_kernel_does_not_send_is_counted(
    listener: UdpListener, peer: socket.socket
) -> None:
    peer.sendto(b"f", at(listener))
    wait_for(listener)
    listener.receive(0.0)
    assert not listener.send(bytes(70_000))  # no datagram is so long
    assert (listener.counters.dropped_out, listener.counters.bytes_out) == (1, 0)
    speaker = UdpSpeaker("udpout:x", *peer.getsockname())
    assert not speaker.send(bytes(70_000))
    assert (speaker.counters.dropped_out, speaker.counters.bytes_out) == (1, 0)
    speaker.close()


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (
            errno.EADDRINUSE,
            "port 80 is in use; stop the other program"
            " (another tgl-soar, MAVProxy, mavlink-router?) or give another port",
        ),
        (
            errno.EADDRNOTAVAIL,
            "here is no address of this computer;"
            " listen on 127.0.0.1 or 0.0.0.0, or use udpout: to send first",
        ),
        (errno.EACCES, "port 80 needs privileges; give one above 1023"),
        (errno.EINVAL, "cannot listen: words"),
    ],
)
def test_why_a_port_cannot_be_listened_on_and_what_to_do(number: int, words: str) -> None:
    error = OSError(number, "words")
    assert _why_not_bound("udp:here:80", "here", 80, error) == f"link 'udp:here:80': {words}"
