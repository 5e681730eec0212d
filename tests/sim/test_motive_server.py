"""The stand-in for Motive on its ports, on this computer and in simulated time: what is answered
at once, what is streamed to which address and from where, and what is counted as lost."""

from __future__ import annotations

import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tgl_soar.geometry import HallFrame
from tgl_soar.sim.motive import HallFault, Motive, MotiveOptions, MotiveServer
from tgl_soar.sim.ports import PortError

CONNECT, SERVER_INFO, FRAME = 0, 1, 7
ECHO_REQUEST, ECHO_RESPONSE = 12, 13
LEVEL = HallFrame(z_up=False, yaw_rad=0.0, origin_north_m=0.0, origin_east_m=0.0, origin_down_m=0.0)
PLACE, STILL = (3.0, 1.0, -1.5), (1.0, 0.0, 0.0, 0.0)
HERE = ("127.0.0.1", 0)


def request(number: int, payload: bytes = b"") -> bytes:
    return struct.pack("<HH", number, len(payload)) + payload


@contextmanager
def serving(*faults: HallFault, **keys: object) -> Iterator[MotiveServer]:
    """A server whose clock stands at seven seconds, in a simulation of 200 steps a second."""
    options = MotiveOptions(**{"noise_m": 0.0, "faults": faults, **keys})  # type: ignore[arg-type]
    server = MotiveServer(Motive(options, LEVEL, "kite"), HERE, lambda: 7.0, step_hz=200)
    try:
        yield server
    finally:
        server.close()


@contextmanager
def listening() -> Iterator[socket.socket]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(HERE)
        client.setblocking(False)
        yield client


def received(client: socket.socket) -> list[tuple[int, bytes, tuple[str, int]]]:
    """(number, all bytes, sender) of what has come."""
    found: list[tuple[int, bytes, tuple[str, int]]] = []
    while True:
        try:
            data, sender = client.recvfrom(65536)
        except BlockingIOError:
            return found
        found.append((struct.unpack_from("<H", data)[0], data, sender))


def test_what_is_asked_is_answered_from_the_same_port() -> None:
    with serving() as server, listening() as client:
        client.sendto(request(CONNECT), server.port.local)
        client.sendto(request(ECHO_REQUEST, b"12345678"), server.port.local)
        server.serve(0.0)
        info, echo = received(client)
        assert (info[0], info[2]) == (SERVER_INFO, server.port.local)
        assert (echo[0], echo[1][4:12]) == (ECHO_RESPONSE, b"12345678")
        assert struct.unpack("<Q", echo[1][12:]) == (70_000_000,)  # seven seconds of the clock
        server.serve(0.0)
        assert received(client) == []


def test_thirty_two_requests_are_answered_before_time_goes_on() -> None:
    with serving() as server, listening() as client:
        for _ in range(40):
            client.sendto(request(CONNECT), server.port.local)
        server.serve(0.0)
        assert len(received(client)) == 32
        server.serve(0.0)
        assert len(received(client)) == 8


def test_a_client_is_streamed_what_was_exposed_after_the_latency() -> None:
    with serving(latency_s=0.01, rate_hz=100) as server, listening() as client:
        client.sendto(request(CONNECT), server.port.local)
        server.serve(0.0)
        received(client)
        counts = []
        for step in range(7):  # of 5 ms; every other exposes, and is received two steps later
            server.step(step, 0.005 * step, PLACE, STILL)
            counts.append(len(received(client)))
        assert counts == [0, 0, 1, 0, 1, 0, 1]
        server.step(8, 0.04, PLACE, STILL)
        ((number, data, sender),) = received(client)
        assert (number, sender) == (FRAME, server.port.local)
        assert struct.unpack_from("<i", data, 4) == (4,)
        assert server.motive.counts["lost"] == 0


def test_a_multicast_server_streams_to_its_group_and_port_by_its_own_address() -> None:
    """Here the group is this computer: to a real one the system must have a way."""
    with listening() as client:
        number = client.getsockname()[1]
        keys = {"multicast": True, "group": "127.0.0.1", "data_port": number, "latency_s": 0.0}
        with serving(**keys) as server:
            server.step(0, 0.0, PLACE, STILL)
            ((kind, _, sender),) = received(client)
            assert (kind, sender) == (FRAME, server.port.local)
            own = server.port.socket
            by = own.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, 4)
            assert socket.inet_ntoa(by) == "127.0.0.1"
            # It stays in the hall: no router sends it on.
            assert own.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 1


def test_another_server_streams_from_the_second_address_and_is_closed_with_ours() -> None:
    with listening() as client:
        with serving(HallFault("second", 0.0, 1.0), latency_s=0.0) as server:
            client.sendto(request(CONNECT), server.port.local)
            server.serve(0.0)
            received(client)
            for step in (0, 2):
                server.step(step, 0.005 * step, PLACE, STILL)
            frames = received(client)
            assert [sender[0] for _, _, sender in frames] == ["127.0.0.2", "127.0.0.1"] * 2
            assert frames[0][2] == frames[2][2]  # one server, from one port
            assert frames[1][2] == server.port.local
            second = server._second
            assert second is not None
            by = second.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, 4)
            assert socket.inet_ntoa(by) == "127.0.0.1"
        assert (second.fileno(), server.port.socket.fileno()) == (-1, -1)


def test_what_the_network_does_not_take_is_lost() -> None:
    with serving() as server:
        for lost in (1, 2):
            server.motive.receive(request(CONNECT), ("127.0.0.1", 0), 7.0, 0.0)  # no such port
            server.serve(0.0)
            assert server.motive.counts["lost"] == lost


def test_a_port_that_is_taken_names_the_option_that_changes_it() -> None:
    with serving() as server:
        assert (server.port.name, server.port.ground) == ("mocap", False)
        motive = Motive(MotiveOptions(), LEVEL, "kite")
        with pytest.raises(PortError, match=r"--mocap-local 127\.0\.0\.1:\d+: the port is in use"):
            MotiveServer(motive, server.port.local, lambda: 0.0, step_hz=200)


def test_a_usual_server_is_of_a_hall_with_three_bodies_of_four_markers() -> None:
    usual = MotiveOptions()
    assert (usual.version, usual.rate_hz, usual.seed) == ((4, 1), 100, 1)
    assert (usual.bodies, usual.markers, usual.noise_m) == (3, 4, 0.0005)
    assert (usual.loss, usual.untracked, usual.jitter_s) == (0.0, 0.0, 0.0)
    assert (usual.precise_4_0, usual.restarted_clock, usual.faults) == (True, True, ())
    assert usual.latency_s == 0.01


@pytest.mark.parametrize(("body", "name", "number"), [("kite", b"kite", 1), (9, b"aircraft", 9)])
def test_the_aircraft_is_known_by_what_it_is_asked_for_by(
    body: str | int, name: bytes, number: int
) -> None:
    motive = Motive(MotiveOptions(noise_m=0.0), LEVEL, body)
    (aircraft, *others) = motive._named()
    assert (aircraft.name.encode(), aircraft.id) == (name, number)
    assert [(each.name, each.id) for each in others] == [
        ("other 1", number + 1), ("other 2", number + 2),
    ]  # fmt: skip
