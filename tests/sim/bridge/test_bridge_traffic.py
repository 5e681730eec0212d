"""Datagrams between the bridge's ports and what is simulated: which get what, how many at once, and
what the faults of the radio link are given."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.sim import ports as ports_module
from tgl_soar.sim.bridge.traffic import STRANGERS_NAMED, Traffic
from tgl_soar.sim.ports import MAX_STRANGERS, Ports, open_ports

ANYWHERE = ("127.0.0.1", 0)


class Wire:
    """A fault's wire: it keeps what it is given until a time."""

    def __init__(self, until_s: float = 1.0) -> None:
        self.until_s = until_s
        self.given: list[tuple[float, Any]] = []

    def send(self, now_s: float, item: Any) -> None:
        self.given.append((now_s, item))

    def arrived(self, now_s: float) -> list[Any]:
        if now_s < self.until_s:
            return []
        items, self.given = [item for _, item in self.given], []
        return items


class Simulated:
    """What receives and sends, and at what time."""

    def __init__(self, down: Wire | None, up: Wire | None) -> None:
        self.time_s = 0.0
        self.links: dict[int, bool] = {}
        self.received: list[tuple[int, bytes]] = []
        self.out: list[tuple[int, bytes]] = []
        self.asked: list[Any] = []
        self.removed: list[int] = []
        self.injection = SimpleNamespace(wire=lambda way: {"down": down, "up": up}[way])

    def add_link(self, link: int, *, ground: bool) -> None:
        self.links[link] = ground

    def remove_link(self, link: int) -> None:
        self.removed.append(link)

    def receive(self, link: int, data: bytes) -> None:
        self.received.append((link, data))

    def take_datagrams(self, links: Any = None) -> list[tuple[int, bytes]]:
        self.asked.append(links)
        out, self.out = self.out, []
        return out


class Bridge:
    """Real ports with a companion and a station at their other ends."""

    def __init__(self, *, down: Wire | None = None, up: Wire | None = None) -> None:
        self.companion, self.station = self.end(), self.end()
        self.ports: Ports = open_ports(
            ANYWHERE, [self.station.getsockname()], ANYWHERE, self.companion.getsockname()
        )
        self.simulated = Simulated(down, up)
        self.traffic = Traffic(self.simulated, self.ports, None)  # type: ignore[arg-type]
        self.to_companion, self.to_station = list(self.ports.peers)

    @staticmethod
    def end() -> socket.socket:
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.bind(ANYWHERE)
        made.settimeout(5.0)
        return made

    def close(self) -> None:
        self.ports.close()
        self.companion.close()
        self.station.close()


@pytest.fixture
def bridge() -> Iterator[Bridge]:
    made = Bridge()
    yield made
    made.close()


def timesync() -> bytes:
    message = mavlink.MAVLink_timesync_message(1, 5)
    return bytes(message.pack(mavlink.MAVLink(None, 1, 191)))


def test_every_peer_is_a_link_of_its_side(bridge: Bridge) -> None:
    assert bridge.simulated.links == {bridge.to_companion: False, bridge.to_station: True}
    assert bridge.traffic.is_companion(bridge.to_companion)
    assert not bridge.traffic.is_companion(bridge.to_station)


def test_what_goes_out_reaches_whom_it_is_for(bridge: Bridge) -> None:
    bridge.simulated.out = [(bridge.to_companion, b"c"), (bridge.to_station, b"s"), (99, b"?")]
    bridge.traffic.flush()
    assert bridge.companion.recv(10) == b"c"
    assert bridge.station.recv(10) == b"s"
    bridge.traffic.flush([bridge.to_station])
    assert bridge.simulated.asked == [None, [bridge.to_station]]


def test_what_comes_in_is_of_the_link_of_its_sender(
    bridge: Bridge, capsys: pytest.CaptureFixture[str]
) -> None:
    bridge.companion.sendto(b"c", bridge.ports.companion.local)
    bridge.station.sendto(b"s", bridge.ports.ground.local)
    assert bridge.traffic.wait(5.0)
    bridge.traffic.serve()
    assert sorted(bridge.simulated.received) == [
        (bridge.to_companion, b"c"),
        (bridge.to_station, b"s"),
    ]
    assert not bridge.traffic.take_one(bridge.ports.ground)
    assert not bridge.traffic.wait(0.0)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("sends", ["companion", "station"])
def test_either_port_ends_the_wait(bridge: Bridge, sends: str) -> None:
    ports = bridge.ports
    if sends == "companion":
        bridge.companion.sendto(b"x", ports.companion.local)
    else:
        bridge.station.sendto(b"x", ports.ground.local)
    assert bridge.traffic.wait(5.0)
    assert ports.wait(0.0, ports.companion) == (sends == "companion")
    assert ports.wait(-1.0, ports.ground) == (sends == "station")


def test_a_hall_is_waited_for_and_served_as_well(bridge: Bridge) -> None:
    hall = bridge.end()
    served: list[float] = []
    bridge.traffic.motive = SimpleNamespace(  # type: ignore[assignment]
        port=SimpleNamespace(socket=hall), serve=served.append
    )
    assert not bridge.traffic.wait(0.0)
    bridge.companion.sendto(b"x", hall.getsockname())
    assert bridge.traffic.wait(5.0)
    bridge.simulated.time_s = 2.5
    bridge.traffic.serve()
    assert served == [2.5]
    hall.close()


def test_a_flood_is_taken_fifty_datagrams_at_a_time(bridge: Bridge) -> None:
    assert ports_module.BURST == 50
    for i in range(60):
        bridge.companion.sendto(bytes([i]), bridge.ports.companion.local)
    bridge.traffic.drain(bridge.ports.companion)
    assert [data for _, data in bridge.simulated.received] == [bytes([i]) for i in range(50)]
    bridge.traffic.drain(bridge.ports.companion)
    assert len(bridge.simulated.received) == 60


def test_of_those_who_speak_first_twenty_are_named_and_sixteen_kept(
    bridge: Bridge, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (STRANGERS_NAMED, MAX_STRANGERS) == (20, 16)
    bridge.simulated.time_s = 12.3456
    forgotten: list[int] = []
    bridge.traffic.when_forgotten = forgotten.append
    strangers = [bridge.end() for _ in range(22)]  # all at once: a port that is free is given again
    for stranger in strangers:
        stranger.sendto(b"x", bridge.ports.ground.local)
        address = stranger.getsockname()
        assert bridge.traffic.take_one(bridge.ports.ground)
        printed = capsys.readouterr().out
        if len(bridge.simulated.links) <= 2 + 20:
            line = f"[   12.346 s] the ground station at 127.0.0.1:{address[1]} spoke first\n"
            assert printed == line
        else:
            assert printed == ""
    for stranger in strangers:
        stranger.close()
    assert len(forgotten) == 22 - 16
    assert forgotten == bridge.simulated.removed
    assert bridge.simulated.links[max(bridge.simulated.links)]  # of the ground's side
    assert len(bridge.simulated.received) == 22


def test_a_companion_that_speaks_first_is_a_link_of_its_side(
    bridge: Bridge, capsys: pytest.CaptureFixture[str]
) -> None:
    stranger = bridge.end()
    stranger.sendto(b"x", bridge.ports.companion.local)
    bridge.traffic.drain(bridge.ports.companion)
    assert "the companion at 127.0.0.1:" in capsys.readouterr().out
    assert bridge.simulated.links[3] is False
    stranger.close()


# --- faults of the radio link ---------------------------------------------------------------------


def test_without_faults_nothing_is_disturbed(bridge: Bridge) -> None:
    assert not bridge.traffic.is_disturbed
    bridge.traffic.deliver()
    assert bridge.simulated.received == []


def test_what_goes_to_companions_goes_by_way_of_the_faults() -> None:
    down = Wire()
    bridge = Bridge(down=down)
    assert bridge.traffic.is_disturbed
    bridge.simulated.time_s = 0.5
    bridge.simulated.out = [(bridge.to_companion, b"c"), (bridge.to_station, b"s")]
    bridge.traffic.flush()
    assert bridge.station.recv(10) == b"s"
    assert down.given == [(0.5, (bridge.to_companion, b"c"))]
    bridge.simulated.out = [(bridge.to_companion, b"question")]
    bridge.traffic.flush(corrupted=False)  # lockstep's own
    assert bridge.companion.recv(10) == b"question"
    bridge.simulated.time_s = 1.0
    bridge.traffic.flush()
    assert bridge.companion.recv(10) == b"c"
    bridge.close()


def test_what_comes_from_companions_comes_by_way_of_the_faults() -> None:
    up = Wire()
    bridge = Bridge(up=up)
    assert not bridge.traffic.is_disturbed
    bridge.simulated.time_s = 0.5
    bridge.companion.sendto(b"c", bridge.ports.companion.local)
    bridge.companion.sendto(timesync(), bridge.ports.companion.local)
    bridge.station.sendto(b"s", bridge.ports.ground.local)
    bridge.traffic.serve()
    received = [(bridge.to_companion, timesync()), (bridge.to_station, b"s")]
    assert bridge.simulated.received == received
    assert up.given == [(0.5, (bridge.to_companion, b"c"))]
    bridge.simulated.time_s = 1.0
    bridge.traffic.deliver()
    assert bridge.simulated.received == [*received, (bridge.to_companion, b"c")]
    bridge.close()


def test_only_a_timesync_of_version_2_is_lockstep_s() -> None:
    up = Wire()
    bridge = Bridge(up=up)
    old = b"\xfe" + timesync()[1:]
    other = timesync()[:7] + b"\x70" + timesync()[8:]
    for data in (old, other, b"\xfd", b""):
        bridge.companion.sendto(data, bridge.ports.companion.local)
    bridge.traffic.serve()
    assert bridge.simulated.received == []
    assert len(up.given) == 4
    bridge.close()


def test_what_is_due_at_once_arrives_at_once() -> None:
    bridge = Bridge(up=Wire(until_s=0.0))
    bridge.companion.sendto(b"c", bridge.ports.companion.local)
    bridge.traffic.serve()
    assert bridge.simulated.received == [(bridge.to_companion, b"c")]
    bridge.close()
