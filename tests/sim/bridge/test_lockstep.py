"""Which peers take part in lockstep, with peers that exist in name only."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from tgl_soar.sim.bridge.lockstep import Lockstep
from tgl_soar.sim.bridge.options import Pace
from tgl_soar.sim.ports import Peer


class Ports:
    """Companions, of which none sends anything unless a test makes it."""

    def __init__(self, count: int) -> None:
        port: Any = SimpleNamespace(ground=False)
        self.ground = self.companion = port
        self.peers = {
            link: Peer(link=link, port=port, address=("127.0.0.1", link), configured=link == 0)
            for link in range(count)
        }

    def wait(self, _seconds: float, *_ports: object) -> bool:
        return False


class Bridge:
    """What lockstep uses of the rest: ports, traffic and the simulated Pixhawk."""

    def __init__(self, companions: int) -> None:
        self.ports = Ports(companions)
        self.beats = dict.fromkeys(self.ports.peers, 0)  # heartbeats received of each
        self.answer = -1  # of everybody
        self.reports: list[str] = []
        self.motive = None
        self.is_disturbed = False
        self.when_forgotten: Any = None
        self.simulation = SimpleNamespace(pixhawk=self, time_s=0.0)
        self.lockstep = Lockstep(
            self,  # type: ignore[arg-type]
            Pace(lockstep=True, patience_s=0.0, start_timeout_s=1.0),
            lambda: False,
        )

    def heartbeats(self, link: int) -> int:
        return self.beats[link]

    def is_companion(self, link: int) -> bool:
        return not self.ports.peers[link].port.ground

    def timesync_answer_ns(self, _link: int) -> int:
        return self.answer

    def take_one(self, _port: object) -> bool:
        return False

    def report(self, text: str) -> None:
        self.reports.append(text)

    def nothing(self, *_: object, **__: object) -> None:
        pass

    announce = flush = send = serve = set_pace = nothing


@pytest.fixture
def bridge() -> Bridge:
    """Two companions; the first has greeted, and was given up at the first question."""
    made = Bridge(2)
    made.beats[0] = 1
    made.ports.peers[0].datagrams = 7
    made.lockstep.gather()
    assert made.lockstep.is_peer_missing
    return made


def test_who_answers_again_is_waited_for_again(bridge: Bridge) -> None:
    bridge.lockstep.readmit()
    assert bridge.lockstep.is_peer_missing  # nothing has come since
    bridge.ports.peers[0].datagrams = 8
    bridge.lockstep.readmit()
    assert bridge.lockstep.is_peer_missing  # it may be another peer at its port
    bridge.answer = 1
    bridge.lockstep.readmit()
    assert not bridge.lockstep.is_peer_missing
    assert bridge.reports[-1] == "the companion at 127.0.0.1:0 is back"


def test_a_successor_takes_the_place_of_the_companion_that_is_gone(bridge: Bridge) -> None:
    """A module that was started again sends from another port: its first process never comes back,
    and as long as a peer is missing time goes on by the clock on the wall."""
    bridge.beats[1] = 1
    bridge.lockstep.readmit()
    assert bridge.reports[-1] == "the companion at 127.0.0.1:1 takes part"
    assert not bridge.lockstep.is_peer_missing
