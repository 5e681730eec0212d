"""What comes over another link than the autopilot's costs a tick so much and no more: counted."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import cycle, repeat
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_module import STEP_S, Flight, setup

from tgl_soar.control.supervisor import CAPTURING, SOARING
from tgl_soar.link.decoder import FALSE_TRIES_MAX, MESSAGE_TRIES
from tgl_soar.link.routing import READ_TRIES, TRIES
from tgl_soar.link.transports.base import LinkCounters
from tgl_soar.onboard.loop import Links
from tgl_soar.onboard.watchdog import ProcessHeartbeat

GOOD = bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 9, 9)))
CRAFTED = {
    "unknown frames that a good one refutes": (b"\xfe\xfe\xfe\xfe\xfe\x03" * 43 + GOOD) * 7,
    "markers": b"\xfd" * 2000,
    "short frames": b"\xfd\x00\x00" * 600,
    "nothing": b"",
}


class Peer:
    """The far end of a link, without a socket."""

    is_stream = False
    generation = 0
    counters = LinkCounters()

    def __init__(self, datagrams: Iterable[bytes] = ()) -> None:
        self.name = "test"
        self.coming: Iterator[bytes] = iter(datagrams)
        self.reads = 0
        self.sent: list[bytes] = []
        self.held_s: list[float] = []

    def fileno(self) -> int:
        return id(self) & 0xFFFF

    def receive(self, now_s: float, most: int = 64) -> list[bytes]:  # noqa: ARG002
        self.reads += 1
        return [data for _, data in zip(range(most), self.coming, strict=False)]

    def hold(self, now_s: float) -> None:
        self.held_s.append(now_s)

    def send(self, data: bytes) -> bool:
        self.sent.append(data)
        return True

    def send_command(self, data: bytes) -> bool:
        return self.send(data)

    def clear_for_release(self) -> bool:
        return False

    def close(self) -> None:
        pass


class Linked(Flight):
    """The module and its vehicle, and a second link, read as the loop reads it."""

    def __init__(self, other: Peer, **named: Any) -> None:
        super().__init__(**named)
        self.onboard.add_link(other.send)
        self.links = Links(self.onboard, [Peer(), other], lambda: self.now_s)
        self.most_tries = 0

    def run(self, seconds: float) -> None:
        route = self.onboard.outbox.routes[1]
        for _ in range(round(seconds / STEP_S)):
            super().run(STEP_S)
            ready = [fd for fd in self.links.filenos() if fd >= 0]
            before = route.tries_left
            self.links.read_others(ready, self.now_s)
            self.most_tries = max(self.most_tries, before - route.tries_left)


@pytest.mark.parametrize("crafted", CRAFTED.values(), ids=CRAFTED)
def test_crafted_bytes_without_end_change_no_frame_to_the_autopilot(crafted: bytes) -> None:
    quiet, flooded = Linked(Peer()), Linked(Peer(repeat(crafted)))
    for flight in (quiet, flooded):
        flight.engaged().run(2.0)
        assert flight.mode_now in (CAPTURING, SOARING)
    assert flooded.frames == quiet.frames
    assert flooded.most_tries <= TRIES + READ_TRIES + MESSAGE_TRIES + FALSE_TRIES_MAX


def test_a_link_that_has_had_its_share_wakes_nobody_until_the_next_tick() -> None:
    other = Peer(repeat(b"\xfd" * 2000))
    flight = Linked(other)
    flight.run(0.1)
    fractions = [fd for fd in flight.links.filenos() if fd >= 0]
    flight.links.read_others(fractions, flight.now_s)
    waited_on, reads = flight.links.filenos(), other.reads
    assert waited_on[0] >= 0
    assert waited_on[1] == -1
    flight.links.read_others(waited_on, flight.now_s)
    assert other.reads == reads
    flight.onboard.periodic(flight.now_s)
    flight.links.read_others(waited_on, flight.now_s)
    assert other.reads > reads


def sets(count: int) -> list[bytes]:
    station = mavlink.MAVLink(None, 255, 190)
    message = mavlink.MAVLink_param_set_message
    return [
        bytes(message(1, 191, b"TGL_CAPTURE", 0.05 + i * 1e-4, 9).pack(station))
        for i in range(count)
    ]


@pytest.mark.parametrize("together", [False, True], ids=["a datagram each", "in few datagrams"])
def test_a_burst_of_an_honest_station_is_answered_whole_and_one_after_the_other(
    together: bool,
) -> None:
    burst = sets(100)
    joined = [b"".join(burst[i : i + 50]) for i in (0, 50)]
    other = Peer()
    flight = Linked(other)
    flight.engaged()
    other.sent.clear()
    changed = flight.onboard.counters.laws_changed
    other.coming = iter(joined if together else burst)
    flight.run(0.2)
    answers = [
        m
        for frame in other.sent
        if (m := mavlink.MAVLink(None).decode(bytearray(frame))).get_type() == "PARAM_VALUE"
    ]
    assert [m.param_value for m in answers if m.param_id == "TGL_CAPTURE"] == [
        pytest.approx(0.05 + i * 1e-4) for i in range(100)
    ]
    assert 5 < flight.onboard.counters.laws_changed - changed < 25  # so many ticks it took


def test_sets_without_end_cost_a_tick_a_few_and_one_change_of_the_laws() -> None:
    flight = Linked(Peer(cycle(sets(100))))
    flight.engaged()
    changed, sets_before = flight.onboard.counters.laws_changed, flight.onboard.parameters.counters
    before, ticks = sets_before.sets, flight.onboard.counters.ticks
    flight.run(1.0)
    ticked = flight.onboard.counters.ticks - ticks
    assert flight.onboard.counters.laws_changed - changed <= ticked + 1
    a_read = READ_TRIES + 1 + MESSAGE_TRIES
    assert flight.onboard.parameters.counters.sets - before <= ticked * (TRIES / a_read + 1)
    assert flight.mode_now in (CAPTURING, SOARING)


def test_a_tick_that_is_due_is_not_kept_waiting() -> None:
    other = Peer(repeat(GOOD))
    flight = Linked(other)
    Flight.run(flight, 0.5)
    flight.now_s += 1.0
    flight.links.read_others([other.fileno()], flight.now_s)
    assert other.reads == 0


def test_in_lockstep_other_links_are_read_in_every_round() -> None:
    """Before the vehicle has come there is no tick, and yet operators' messages are read."""
    other = Peer(sets(100))
    flight = Linked(other, lockstep=True)
    for _ in range(30):
        flight.onboard.idle(flight.now_s)
        flight.links.read_others([other.fileno()], flight.now_s)
    assert flight.onboard.parameters.counters.sets == 100


def test_only_what_was_accepted_holds_the_place_of_a_peer() -> None:
    other = Peer([b"!", GOOD[:-1], GOOD])
    flight = Linked(other)
    flight.run(0.01)
    assert len(other.held_s) == 1


def test_the_sign_of_life_is_shown_in_the_middle_of_a_flood() -> None:
    """One round, in which as many datagrams come from the autopilot's link as one read brings."""
    flight, heartbeat = Flight(flown=setup()), ProcessHeartbeat()
    flight.engaged()
    rounds = heartbeat.read().rounds
    first = Peer(repeat(GOOD))

    def clock() -> float:
        flight.now_s += 0.001
        return flight.now_s

    Links(flight.onboard, [first], clock, heartbeat=heartbeat).read_autopilot(
        [first.fileno()], flight.now_s
    )
    assert first.reads == 1
    assert heartbeat.read().rounds - rounds > 5
