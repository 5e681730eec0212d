"""Datagrams to and from a NatNet server over the loopback interface, one socket or two."""

from __future__ import annotations

import errno
import os
import select
import socket
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from free_ports import free_port

from tgl_soar.link.natnet.sockets import (
    NatNetError,
    NatNetNotReadyError,
    NatNetSockets,
    resolved,
)

LOCAL = "127.0.0.1"
GROUP, OTHER_GROUP = "239.255.71.5", "239.255.71.6"  # for use within one site (RFC 2365)
NOWHERE = "203.0.113.7"  # for documentation (RFC 5737): of no interface
LARGEST_PAYLOAD = 65535 - 20 - 8  # of UDP over IPv4


class Server:
    """The camera computer's end."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((LOCAL, 0))
        self.socket.settimeout(2.0)
        self.socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(LOCAL))

    @property
    def address(self) -> tuple[str, int]:
        name: tuple[str, int] = self.socket.getsockname()
        return name


@pytest.fixture
def server() -> Iterator[Server]:
    made = Server()
    yield made
    made.socket.close()


def unicast(server: Server) -> NatNetSockets:
    return NatNetSockets(LOCAL, server.address[1])


def multicast(server: Server, port: int, group: str = GROUP) -> NatNetSockets:
    return NatNetSockets(LOCAL, server.address[1], interface=LOCAL, group=group, port=port)


def asked_from(feed: NatNetSockets, server: Server) -> tuple[str, int]:
    """Where the server is asked from, and so where it answers to."""
    feed.send(b"who is there?")
    data, sender = server.socket.recvfrom(100)
    assert data == b"who is there?"
    return str(sender[0]), int(sender[1])


def wait(feed: NatNetSockets, which: int = 0) -> None:
    assert select.select([feed.filenos()[which]], [], [], 2.0)[0]


def option(fileno: int, name: int) -> int:
    with closing(socket.socket(fileno=os.dup(fileno))) as same:
        return same.getsockopt(socket.SOL_SOCKET, name)


# --- one socket ----------------------------------------------------------------------------------


def test_a_unicast_server_streams_to_the_port_that_it_is_asked_from(server: Server) -> None:
    with closing(unicast(server)) as feed:
        assert feed.server == LOCAL
        assert len(feed.filenos()) == 1
        server.socket.sendto(b"frame", asked_from(feed, server))
        wait(feed)
        assert feed.receive() == [(b"frame", server.address)]
        assert feed.unsent == 0


def test_nothing_waits_for_a_datagram(server: Server) -> None:
    with closing(unicast(server)) as feed:
        assert feed.receive() == []
        assert not os.get_blocking(feed.filenos()[0])


def test_a_flood_is_read_sixteen_datagrams_at_a_time(server: Server) -> None:
    with closing(unicast(server)) as feed:
        to = asked_from(feed, server)
        for number in range(20):
            server.socket.sendto(bytes((number,)), to)
        numbers = [[data[0] for data, _ in feed.receive()] for _ in range(3)]
        assert numbers == [list(range(16)), list(range(16, 20)), []]
        for number in range(5):
            server.socket.sendto(bytes((number,)), to)
        assert [data[0] for data, _ in feed.receive(2)] == [0, 1]


def test_the_largest_datagram_comes_whole(server: Server) -> None:
    with closing(unicast(server)) as feed:
        server.socket.sendto(bytes(LARGEST_PAYLOAD), asked_from(feed, server))
        wait(feed)
        ((data, _),) = feed.receive()
        assert len(data) == LARGEST_PAYLOAD


def test_a_million_bytes_wait_where_the_computer_allows_as_many(server: Server) -> None:
    """What comes while the loop is held up is not lost: seconds of a stream of 200 kB/s."""
    with closing(unicast(server)) as feed, closing(Server().socket) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024 * 1024)
        allowed = probe.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)
        assert option(feed.filenos()[0], socket.SO_RCVBUF) == allowed


def test_what_cannot_be_sent_is_counted_and_raises_nothing(server: Server) -> None:
    with closing(unicast(server)) as feed:
        for count in (1, 2):
            feed.send(bytes(LARGEST_PAYLOAD + 1))
            assert feed.unsent == count
        asked_from(feed, server)
        assert feed.unsent == 2


class Refused(socket.socket):
    """As Linux answers a datagram to a port without a listener: at the next read."""

    refusals = 0

    def recvfrom(self, *args: int) -> tuple[bytes, tuple[str, int]]:
        if Refused.refusals > 0:
            Refused.refusals -= 1
            raise ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused")
        data, sender = super().recvfrom(*args)
        return data, sender


def test_an_answer_that_nobody_was_there_hides_no_datagram_behind_it(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(socket, "socket", Refused)
    with closing(unicast(server)) as feed:
        server.socket.sendto(b"frame", asked_from(feed, server))
        wait(feed)
        Refused.refusals = 3
        assert [data for data, _ in feed.receive()] == [b"frame"]
        Refused.refusals = 100  # each counts as one that was read
        assert feed.receive() == []
        assert Refused.refusals == 100 - 16
        Refused.refusals = 0


def test_whoever_answers_is_the_server_where_none_is_named() -> None:
    """The limited broadcast, which a socket must be allowed to send to."""
    assert resolved("discover") == "255.255.255.255"
    with closing(NatNetSockets("discover", 1510)) as feed:
        assert feed.server == ""
        assert option(feed.filenos()[0], socket.SO_BROADCAST) != 0


def test_both_sockets_are_given_back(server: Server) -> None:
    feed = multicast(server, free_port())
    numbers = feed.filenos()
    assert len(numbers) == 2
    feed.close()
    for number in numbers:
        with pytest.raises(OSError, match="Bad file descriptor"):
            os.fstat(number)


# --- a second one for a multicast stream ---------------------------------------------------------


def test_a_multicast_server_is_received_on_its_group_and_on_the_port_that_asks(
    server: Server,
) -> None:
    port = free_port()
    with closing(multicast(server, port)) as feed:
        server.socket.sendto(b"frame", (GROUP, port))
        server.socket.sendto(b"answer", asked_from(feed, server))
        wait(feed, 0)
        wait(feed, 1)
        assert feed.receive() == [(b"answer", server.address), (b"frame", server.address)]


def test_each_socket_has_its_own_share_of_a_flood(server: Server) -> None:
    port = free_port()
    with closing(multicast(server, port)) as feed:
        to = asked_from(feed, server)
        for _ in range(20):
            server.socket.sendto(b"answer", to)
            server.socket.sendto(b"frame", (GROUP, port))
        assert [data for data, _ in feed.receive()] == [b"answer"] * 16 + [b"frame"] * 16


def test_what_is_streamed_to_another_group_stays_away(server: Server) -> None:
    port = free_port()
    with (
        closing(multicast(server, port)) as feed,
        closing(multicast(server, port, OTHER_GROUP)) as other,
    ):
        server.socket.sendto(b"theirs", (OTHER_GROUP, port))
        server.socket.sendto(b"ours", (GROUP, port))
        wait(feed, 1)
        wait(other, 1)
        assert [data for data, _ in feed.receive()] == [b"ours"]
        assert [data for data, _ in other.receive()] == [b"theirs"]


def test_several_programs_listen_to_one_stream(server: Server) -> None:
    port = free_port()
    with closing(multicast(server, port)) as one, closing(multicast(server, port)) as two:
        server.socket.sendto(b"frame", (GROUP, port))
        for feed in (one, two):
            wait(feed, 1)
            assert [data for data, _ in feed.receive()] == [b"frame"]


def test_a_multicast_server_is_followed_where_it_says_that_it_streams(server: Server) -> None:
    first, second = free_port(), free_port()
    with closing(multicast(server, first)) as feed:
        feed.follow(OTHER_GROUP, second)
        server.socket.sendto(b"old", (GROUP, first))
        server.socket.sendto(b"new", (OTHER_GROUP, second))
        wait(feed, 1)
        assert [data for data, _ in feed.receive()] == [b"new"]
        assert len(feed.filenos()) == 2


@pytest.mark.parametrize(("group", "port"), [(OTHER_GROUP, 0), (GROUP, 1)])
def test_another_group_and_another_port_are_both_followed(
    server: Server, group: str, port: int
) -> None:
    began = free_port()
    to = (group, free_port() if port else began)
    with closing(multicast(server, began)) as feed:
        feed.follow(*to)
        server.socket.sendto(b"frame", to)
        wait(feed, 1)
        assert [data for data, _ in feed.receive()] == [b"frame"]


def test_what_is_streamed_where_we_listen_changes_nothing(server: Server) -> None:
    port = free_port()
    with closing(multicast(server, port)) as feed:
        before = feed.filenos()
        server.socket.sendto(b"waits", (GROUP, port))
        wait(feed, 1)
        feed.follow(GROUP, port)
        assert feed.filenos() == before
        assert [data for data, _ in feed.receive()] == [b"waits"]


def test_a_client_that_was_to_be_sent_to_follows_nobody(server: Server) -> None:
    with closing(unicast(server)) as feed:
        feed.follow(GROUP, free_port())
        assert len(feed.filenos()) == 1


def test_where_the_new_group_cannot_be_joined_the_old_one_is_kept(server: Server) -> None:
    port = free_port()
    with closing(multicast(server, port)) as feed:
        feed.follow("10.0.0.1", free_port())  # no group
        server.socket.sendto(b"frame", (GROUP, port))
        wait(feed, 1)
        assert [data for data, _ in feed.receive()] == [b"frame"]


# --- what cannot be opened -----------------------------------------------------------------------


def opened() -> set[str]:
    return {each.name for each in Path("/proc/self/fd").iterdir()}


def test_a_port_out_of_range_names_its_keys_and_leaves_nothing_open(server: Server) -> None:
    before = opened()
    with pytest.raises(
        NatNetError,
        match=rf"mocap\.group, mocap\.data_port {GROUP}:70000: cannot listen: .*0-65535",
    ) as caught:
        multicast(server, 70000)
    assert not isinstance(caught.value, NatNetNotReadyError)
    assert opened() == before


class CannotJoin(socket.socket):
    """Of a computer whose interface towards the cameras is not up."""

    number = errno.ENODEV

    def setsockopt(self, level: int, name: int, value: int | bytes) -> None:  # type: ignore[override]
        if (level, name) == (socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP):
            raise OSError(CannotJoin.number, os.strerror(CannotJoin.number))
        super().setsockopt(level, name, value)


@pytest.mark.parametrize(
    ("number", "interface", "where", "may_pass"),
    [
        (errno.ENODEV, "", "any interface: No such device;", True),
        (errno.ENODEV, LOCAL, f"interface {LOCAL}: No such device;", True),
        (errno.EINVAL, LOCAL, f"interface {LOCAL}: Invalid argument;", False),
    ],
)
def test_a_group_that_cannot_be_joined_names_interface_and_way_out(
    server: Server,
    monkeypatch: pytest.MonkeyPatch,
    number: int,
    interface: str,
    where: str,
    may_pass: bool,
) -> None:
    monkeypatch.setattr(CannotJoin, "number", number)
    monkeypatch.setattr(socket, "socket", CannotJoin)
    before = opened()
    with pytest.raises(NatNetError, match=rf"mocap\.group {GROUP} cannot be joined on ") as caught:
        NatNetSockets(LOCAL, server.address[1], interface=interface, group=GROUP, port=free_port())
    text = str(caught.value)
    assert f"on {where}" in text
    assert "give mocap.interface the address" in text
    assert isinstance(caught.value, NatNetNotReadyError) == may_pass
    assert opened() == before


def test_an_interface_that_is_not_there_is_named_and_may_come_up_later(server: Server) -> None:
    before = opened()
    with pytest.raises(
        NatNetNotReadyError, match=rf"mocap\.interface {NOWHERE}:0: cannot listen: "
    ):
        NatNetSockets(LOCAL, server.address[1], interface=NOWHERE)
    assert opened() == before


def test_a_port_that_is_taken_by_an_unshared_socket_names_all_interfaces(
    server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without an interface of one's own it is 0.0.0.0 that cannot be listened on."""

    class Taken(socket.socket):
        def bind(self, _address: object) -> None:
            raise OSError(errno.EADDRINUSE, os.strerror(errno.EADDRINUSE))

    monkeypatch.setattr(socket, "socket", Taken)
    with pytest.raises(NatNetNotReadyError, match=r"mocap\.interface 0\.0\.0\.0:0: cannot listen"):
        unicast(server)


@pytest.mark.parametrize(
    ("number", "may_pass"), [(socket.EAI_AGAIN, True), (socket.EAI_NONAME, False)]
)
def test_a_name_that_nobody_knows_may_be_known_later_if_nobody_could_be_asked(
    monkeypatch: pytest.MonkeyPatch, number: int, may_pass: bool
) -> None:
    def unknown(_name: str) -> str:
        raise socket.gaierror(number, "why not")

    monkeypatch.setattr(socket, "gethostbyname", unknown)
    with pytest.raises(NatNetError, match=r"mocap\.server 'hall' is not known: why not") as caught:
        resolved("hall")
    assert isinstance(caught.value, NatNetNotReadyError) == may_pass


def test_a_name_is_asked_for_once_and_its_address_is_the_server(
    monkeypatch: pytest.MonkeyPatch, server: Server
) -> None:
    monkeypatch.setattr(socket, "gethostbyname", {"hall": LOCAL}.__getitem__)
    with closing(NatNetSockets("hall", server.address[1])) as feed:
        assert feed.server == LOCAL
        asked_from(feed, server)


@pytest.mark.parametrize("name", ["10.0..1", "a" * 64 + ".example"])
def test_a_server_s_name_that_cannot_be_one_is_refused(name: str) -> None:
    with pytest.raises(NatNetError, match="is not known: ") as caught:
        resolved(name)
    assert not isinstance(caught.value, NatNetNotReadyError)
