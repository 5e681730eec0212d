"""The simulated Pixhawk's UDP ports: which peers are known, become a link by sending first, or are
dropped of too many, and the error of a port that cannot be had."""

from __future__ import annotations

import select
import socket
from collections.abc import Iterator
from typing import Any

import pytest

from tgl_soar.sim.ports import MAX_STRANGERS, Port, PortError, Ports, open_ports, resolved

ANYWHERE = ("127.0.0.1", 0)


def end() -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind(ANYWHERE)
    made.settimeout(5.0)
    return made


@pytest.fixture
def ports() -> Iterator[Ports]:
    made = open_ports(ANYWHERE, [("127.0.0.1", 14550)], ANYWHERE, ("127.0.0.1", 14540))
    yield made
    made.close()


def test_the_companion_and_the_stations_are_known_from_the_first(ports: Ports) -> None:
    companion, station = ports.peers.values()
    assert (companion.port, station.port) == (ports.companion, ports.ground)
    assert (companion.link, station.link) == (1, 2)
    assert companion.configured
    assert station.configured
    assert (companion.datagrams, ports.strangers) == (0, 0)
    assert ports.ground.ground
    assert not ports.companion.ground


def test_one_address_is_one_link_at_each_port(ports: Ports) -> None:
    address = ("127.0.0.1", 7)
    stranger = ports.add(ports.ground, address, configured=False)
    assert (stranger.link, stranger.configured) == (3, False)
    assert ports.strangers == 1
    assert ports.add(ports.companion, address, configured=False).link == 4
    assert ports.add(ports.ground, address, configured=False) is stranger
    assert not stranger.configured
    ports.add(ports.ground, address, configured=True)
    assert stranger.configured
    ports.add(ports.ground, address, configured=False)
    assert stranger.configured  # it stays so
    assert len(ports.peers) == 4
    assert ports.strangers == 2


def test_who_speaks_first_is_new_once_and_counted(ports: Ports) -> None:
    with end() as stranger:
        for n, new in ((1, True), (2, False), (3, False)):
            stranger.sendto(bytes([n]), ports.companion.local)
            assert ports.wait(5.0, ports.companion)
            received = ports.receive(ports.companion)
            assert received is not None
            peer, data, is_new = received
            assert (data, is_new, peer.datagrams) == (bytes([n]), new, n)
            assert peer.address == stranger.getsockname()
        ports.send(peer.link, b"back")
        assert stranger.recv(10) == b"back"
    assert ports.receive(ports.companion) is None
    ports.send(99, b"to nobody")


def test_it_waits_as_long_as_requested_and_never_backwards(
    ports: Ports, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []

    def nothing(*arguments: Any) -> tuple[list[Any], list[Any], list[Any]]:
        asked.append(arguments)
        return [], [], []

    monkeypatch.setattr(select, "select", nothing)
    both = [ports.ground.socket, ports.companion.socket]
    for seconds, waits in ((0.25, 0.25), (0.0, 0.0), (-1.0, 0.0), (3.0, 3.0)):
        assert not ports.wait(seconds, ports.ground, ports.companion)
        assert asked.pop() == (both, [], [], waits)


def test_a_datagram_is_looked_at_to_4096_bytes(ports: Ports) -> None:
    with end() as stranger:
        stranger.sendto(b"x" * 5000, ports.ground.local)
        received = ports.receive(ports.ground)
    assert received is not None
    assert len(received[1]) == 4096


def test_what_cannot_be_sent_is_lost(ports: Ports) -> None:
    ports.peers[1].address = ("127.0.0.1", 9)
    ports.send(1, b"x" * 70_000)  # larger than any datagram


def test_of_seventeen_strangers_the_one_that_sent_least_is_forgotten(ports: Ports) -> None:
    strangers = [
        ports.add(ports.ground, ("127.0.0.1", 100 + i), configured=False)
        for i in range(MAX_STRANGERS)
    ]
    for i, stranger in enumerate(strangers):
        stranger.datagrams = 5 if i in (3, 7) else 9
    assert ports.surplus() is None
    assert len(ports.peers) == 2 + 16
    newest = ports.add(ports.ground, ("127.0.0.1", 99), configured=False)
    newest.datagrams = 6
    assert ports.surplus() is strangers[3]  # the older of two
    assert strangers[3].link not in ports.peers
    assert ports.surplus() is None
    again = ports.add(ports.ground, strangers[3].address, configured=False)
    assert again.link == newest.link + 1  # as a new peer
    assert ports.strangers == 18


def test_who_was_configured_is_never_forgotten(ports: Ports) -> None:
    for i in range(MAX_STRANGERS + 1):
        ports.add(ports.ground, ("127.0.0.1", 100 + i), configured=False).datagrams = 3
    surplus = ports.surplus()
    assert surplus is not None
    assert not surplus.configured
    assert {1, 2} <= set(ports.peers)


def test_a_port_in_use_says_which_option_changes_it() -> None:
    with end() as taken:
        number = taken.getsockname()[1]
        with pytest.raises(PortError) as raised:
            Port("ground", "--gcs-local", ("127.0.0.1", number), ground=True)
    assert str(raised.value) == (
        f"--gcs-local 127.0.0.1:{number}: the port is in use: end the other process, or choose"
        " another port with --gcs-local"
    )


def test_a_port_that_no_computer_has_is_refused() -> None:
    with pytest.raises(PortError, match=r"--x 127\.0\.0\.1:70000: .* with --x"):
        Port("ground", "--x", ("127.0.0.1", 70000), ground=True)


def test_an_address_that_is_not_ours_is_refused_in_the_systems_words() -> None:
    with pytest.raises(PortError, match=r"--x 192\.0\.2\.1:0: .*assign.* with --x"):
        Port("ground", "--x", ("192.0.2.1", 0), ground=True)


def test_a_second_port_that_cannot_be_had_leaves_the_first_free() -> None:
    with end() as taken, end() as probe:
        free = probe.getsockname()
        probe.close()
        with pytest.raises(PortError, match="--companion-local"):
            open_ports(free, [], taken.getsockname(), ("127.0.0.1", 14540))
        Port("ground", "--gcs-local", free, ground=True).socket.close()


def test_a_name_that_is_no_host_is_reported_and_leaves_both_ports_free(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def unknown(_host: str) -> str:
        raise socket.gaierror(-2, "Name or service not known")

    with end() as first, end() as second:
        free = first.getsockname(), second.getsockname()
    with monkeypatch.context() as patched:
        patched.setattr(socket, "gethostbyname", unknown)
        with pytest.raises(PortError, match="--companion nowhere:5: Name or service not known"):
            open_ports(free[0], [], free[1], ("nowhere", 5))
    for local in free:
        Port("any", "--any", local, ground=True).socket.close()


def test_a_name_is_resolved() -> None:
    assert resolved("--gcs", ("127.0.0.1", 5)) == ("127.0.0.1", 5)
    assert resolved("--gcs", ("localhost", 5)) == ("127.0.0.1", 5)


@pytest.mark.parametrize("which", ["--gcs", "--companion"])
def test_another_machine_is_refused_by_a_port_of_this_one_alone(which: str) -> None:
    far: Any = ("192.0.2.7", 14550)
    near: Any = ("127.0.0.1", 14540)
    ground, companion = ([far], near) if which == "--gcs" else ([near], far)
    with pytest.raises(PortError) as raised:
        open_ports(ANYWHERE, ground, ANYWHERE, companion)
    text = str(raised.value)
    assert text.startswith(f"{which} 192.0.2.7:14550 is another machine, and {which}-local 127.0.")
    assert "serves this one only: add" in text
    open_ports(("0.0.0.0", 0), [far], ("0.0.0.0", 0), far).close()


def test_waiting_ends_when_any_of_the_ports_has_something(ports: Ports) -> None:
    assert not ports.wait(-1.0, ports.ground, ports.companion)
    with end() as stranger:
        stranger.sendto(b"x", ports.ground.local)
        assert ports.wait(5.0, ports.companion, ports.ground)
        assert not ports.wait(0.0, ports.companion)
