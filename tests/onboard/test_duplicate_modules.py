"""Two modules with one identity, on one simulated network."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_module import Flight, setup, texts

from tgl_soar.control.supervisor import CAPTURING, READY, is_flying
from tgl_soar.link.presence import ALONE_S
from tgl_soar.onboard.module import ModuleOptions, Onboard

ENGAGE, REJECTED, FAILED = 31010, 1, 4


class Network(Flight):
    """One vehicle, a router, and a second module with the identity of the first.

    What one module sends reaches the other over a link of its own (as from another udpout), and
    comes back to itself where the router echoes.
    """

    def __init__(
        self, *, echoes: bool = False, starts: tuple[int, int] = (11, 22), later_s: float = 0.0
    ) -> None:
        """`later_s`: so much later the second one is started, and so are its heartbeats."""
        super().__init__()
        self._second_from_s = self.now_s + later_s
        self.echoes = echoes
        self.connected = True
        self.sent: list[list[bytes]] = [[], []]
        self._queue: list[tuple[int, bytes]] = []
        self.modules = [self._module(0, starts[0]), self._module(1, starts[1])]
        self.links = [m.add_link(lambda _frame: True) for m in self.modules]
        self.onboard = self.modules[0]

    def _module(self, number: int, start: int) -> Onboard:
        def send(frame: bytes) -> bool:
            self.sent[number].append(frame)
            self._queue.append((number, frame))
            return True

        return Onboard(setup(), send, self.now_s, ModuleOptions(start=start))

    def receive(self, message: Any, *, station: bool = False) -> None:
        sender = self._station if station else self._vehicle
        frame = bytes(message.pack(sender))
        sender.seq = (sender.seq + 1) % 256
        for module in self.modules:
            module.event(frame, self.now_s)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.005)):
            super().run(0.005)
            second = self.modules[1]
            if self.now_s >= self._second_from_s and second.clocking.due(self.now_s):
                second.periodic(self.now_s)
            queue, self._queue = self._queue, []
            for sender, frame in queue:
                for receiver in (0, 1):
                    if self.connected if receiver != sender else self.echoes:
                        self.modules[receiver].event(frame, self.now_s, self.links[receiver])

    def order(self, number: int) -> None:
        message = mavlink.MAVLink_command_long_message(1, 191, number, 0, 0, 0, 0, 0, 0, 0, 0)
        self.receive(message, station=True)

    @property
    def modes(self) -> list[int]:
        return [m.output.mode if m.output is not None else -1 for m in self.modules]

    def reported(self, number: int) -> list[Any]:
        frames, self.sent[number] = self.sent[number], []
        return [mavlink.MAVLink(None).decode(bytearray(f)) for f in frames]


def results(messages: list[Any]) -> list[tuple[int, int]]:
    return [(m.command, m.result) for m in messages if m.get_type() == "COMMAND_ACK"]


@pytest.mark.parametrize("echoes", [False, True])
def test_while_a_duplicate_is_received_nobody_engages(echoes: bool) -> None:
    network = Network(echoes=echoes)
    network.run(2.0)
    assert network.modes == [READY, READY]
    network.order(ENGAGE)
    network.set("OP_ENGAGE", 1.0)
    network.run(2.0)
    assert network.modes == [READY, READY]
    for number in (0, 1):
        messages = network.reported(number)
        assert (ENGAGE, REJECTED) in results(messages)
        words = "".join(texts(messages))
        assert "another module is system 1, component 191, too" in words
        assert "stop one" in words
        kinds = {m.get_type() for m in messages}
        assert "RC_CHANNELS_OVERRIDE" not in kinds


def test_what_a_router_sends_back_is_no_duplicate() -> None:
    network = Network(echoes=True)
    network.connected = False
    network.run(2.0)
    network.order(ENGAGE)
    network.run(5.0)
    assert all(is_flying(mode) for mode in network.modes)
    assert not any("another module" in text for text in texts(network.reported(0)))


def test_an_engaged_module_stays_when_another_is_started() -> None:
    network = Network()
    network.connected = False
    network.run(1.0)
    network.set("OP_ENGAGE", 1.0)
    network.modules[1].engage_switch.turn_back(network.now_s)  # it was not there yet
    network.run(1.0)
    assert is_flying(network.modes[0])
    network.reported(0)
    network.connected = True
    network.run(2.0)
    network.order(ENGAGE)
    network.run(2.0)
    assert is_flying(network.modes[0])
    assert network.modes[1] == READY
    words = [text for text in texts(network.reported(0)) if "another module" in text]
    assert len(words) == 1  # not with every heartbeat


@pytest.mark.parametrize("when_s", [1.5, 2.1])
def test_of_two_that_are_both_engaged_both_disengage(when_s: float) -> None:
    network = Network(later_s=0.5)
    network.connected = False
    network.run(when_s)  # then the first or the second is received before the other
    network.order(ENGAGE)
    network.run(0.2)  # and before they are on their line their heartbeats are due
    assert network.modes == [CAPTURING, CAPTURING]
    network.reported(0), network.reported(1)
    network.connected = True
    network.run(1.1)
    assert network.modes == [READY, READY]
    for number in (0, 1):
        messages = network.reported(number)
        assert any("disengaged: another module" in text for text in texts(messages))
        assert results(messages)[-1] == (ENGAGE, FAILED)  # not of an operator's own will
        overrides = [m for m in messages if m.get_type() == "RC_CHANNELS_OVERRIDE"]
        assert [m.chan2_raw for m in overrides][-1] == 0  # released


def test_it_engages_again_when_the_duplicate_is_gone() -> None:
    network = Network()
    network.run(1.5)
    network.connected = False
    network.run(ALONE_S + 1.1)
    network.modules[1].stop()
    network.order(ENGAGE)
    network.run(0.2)
    assert network.modes[0] == CAPTURING
