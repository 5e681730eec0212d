"""The module's links: their destinations, which peers are greeted, and how much the first loses."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_module import setup

from tgl_soar.link.messages import Source
from tgl_soar.link.presence import Presence
from tgl_soar.link.routing import TRIES, Route
from tgl_soar.link.signing import Signing
from tgl_soar.link.telemetry import Telemetry
from tgl_soar.onboard.counters import Counters
from tgl_soar.onboard.flightlog.recorder import LinkReport, Recorder
from tgl_soar.onboard.links import ModuleLinks
from tgl_soar.onboard.outbox import Outbox
from tgl_soar.onboard.pacing import TickCounters

# Session and recorder only answer and record, which native code refuses.
pytestmark = pytest.mark.interpreted

KEY = bytes(range(32))
AUTOPILOT = Source(1, 1)
T_S = 30.0


class Remembering(Recorder):
    """What is logged."""

    def __init__(self) -> None:
        self.reports: list[LinkReport] = []
        self.came: list[tuple[int, bool]] = []

    def link(self, report: LinkReport) -> None:
        self.reports.append(report)

    def inbound(self, link: int, _frame: bytes, wanted: bool) -> None:
        self.came.append((link, wanted))

    def outbound(self, frame: bytes) -> None:
        pass


class Scene:
    """Links without anything behind them."""

    def __init__(self, *, key: bytes | None = None, unsigned_autopilot: bool = False) -> None:
        self.recorder = Remembering()
        self.sent: list[tuple[int, bytes]] = []
        self.heartbeat_is_due = False
        presence = Presence(7)
        session: Any = SimpleNamespace(
            autopilot=AUTOPILOT,
            round_trip_s=0.004,
            heartbeat=presence.heartbeat,
            heartbeat_if_due=lambda _now_s: [presence.heartbeat()] if self.heartbeat_is_due else [],
        )
        self.counters, self.ticks = Counters(), TickCounters()
        self.outbox = Outbox(self.counters, self.recorder, Telemetry(()), None)
        self.links = ModuleLinks(
            setup(),
            session,
            Signing(key, 1.5e9, 0.0),
            self.outbox,
            self.recorder,
            unsigned_autopilot=unsigned_autopilot,
        )
        self.takes = [True, True]
        self.vehicle = mavlink.MAVLink(None, 1, 1)

    def add(self, *, stream: bool = False) -> Route:
        number = len(self.outbox.routes)

        def send(frame: bytes) -> bool:
            self.sent.append((number, frame))
            return self.takes[number]

        return self.links.add(send, stream=stream)

    def measure(self, now_s: float) -> float:
        self.links.measure_loss(now_s, self.ticks, self.counters)
        return self.links.loss

    def receive(self, count: int, *, lost: int = 0) -> None:
        """Frames of the autopilot, of which some before the last do not come."""
        for k in range(count + lost):
            message = mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3)
            frame = bytes(message.pack(self.vehicle))
            self.vehicle.seq = (self.vehicle.seq + 1) % 256
            if not count - 1 <= k < count + lost - 1:
                self.outbox.autopilot.take(frame)


# --- adding and greeting --------------------------------------------------------------------------


def test_links_are_numbered_as_they_come_and_the_log_is_shown_what_comes_on_them() -> None:
    scene = Scene()
    first, other = scene.add(), scene.add(stream=True)
    assert [first.number, other.number] == [0, 1]
    assert scene.outbox.routes == [first, other]
    for route in (first, other):
        route.take(beat(1))
        route.take(beat(77))  # a system that is none of ours
    assert scene.recorder.came == [(0, True), (0, False), (1, True), (1, False)]


def beat(system: int) -> bytes:
    message = mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3)
    return bytes(message.pack(mavlink.MAVLink(None, system, 1)))


@pytest.mark.parametrize("unsigned_autopilot", [True, False])
def test_the_autopilot_may_be_excused_from_signing_on_its_own_link_alone(
    unsigned_autopilot: bool,
) -> None:
    scene = Scene(key=KEY, unsigned_autopilot=unsigned_autopilot)
    first, other = scene.add(), scene.add()
    assert bool(first.take(beat(1))) is unsigned_autopilot
    assert not first.take(beat(255))  # an operator has to sign
    assert not other.take(beat(1))


def kinds(scene: Scene) -> list[tuple[int, str]]:
    reader = mavlink.MAVLink(None)
    found = [(n, reader.decode(bytearray(frame)).get_type()) for n, frame in scene.sent]
    scene.sent.clear()
    return found


def test_each_link_is_greeted_until_it_takes_it_and_then_once_a_second() -> None:
    scene = Scene()
    scene.add()
    scene.add()
    scene.takes[1] = False  # no peer is there yet
    for expected in ([0, 1], [1]):
        scene.links.show_presence(T_S)
        assert kinds(scene) == [(n, "HEARTBEAT") for n in expected]
    scene.takes[1] = True
    scene.links.show_presence(T_S)
    assert kinds(scene) == [(1, "HEARTBEAT")]
    scene.links.show_presence(T_S)
    assert kinds(scene) == []
    scene.heartbeat_is_due = True
    scene.links.show_presence(T_S)
    assert kinds(scene) == [(0, "HEARTBEAT"), (1, "HEARTBEAT")]


# --- how far a link is read -----------------------------------------------------------------------


def test_another_link_is_read_as_long_as_it_has_tries_and_has_them_again_after_a_tick() -> None:
    scene = Scene()
    scene.add()
    other = scene.add()
    reads = 0
    while scene.links.may_read(1):
        assert reads < TRIES
        reads += 1
    assert reads > 1
    assert not scene.links.has_more_tries(1)
    scene.links.refill()
    assert scene.links.has_more_tries(1)
    other.tries_left = 0
    assert not scene.links.has_more_tries(1)
    other.tries_left = 1
    assert scene.links.has_more_tries(1)


def test_what_could_not_be_decoded_in_time_waits() -> None:
    scene = Scene()
    scene.add()
    other = scene.add()
    assert not scene.links.is_waiting(1)
    other.tries_left = 1
    other.take(b"".join(beat(1) for _ in range(50)))
    assert scene.links.is_waiting(1)


def test_with_another_clock_our_frames_are_counted_from_zero() -> None:
    """As a module that was started then would count them: a replay depends on it."""
    scene = Scene()
    route = scene.add()
    scene.links.show_presence(T_S)
    scene.heartbeat_is_due = True
    scene.links.show_presence(T_S)
    scene.outbox.hand_over(setup().flavour.release())
    scene.outbox.hand_over(setup().flavour.release())
    assert [frame[4] for _, frame in scene.sent] == [0, 1, 0, 1]  # two senders
    scene.sent.clear()
    scene.links.restart(T_S)
    scene.outbox.say(route_heartbeat(), route)
    scene.outbox.hand_over(setup().flavour.release())
    assert [frame[4] for _, frame in scene.sent] == [0, 0]


def route_heartbeat() -> Any:
    return Presence(7).heartbeat()


# --- loss -----------------------------------------------------------------------------------------


def test_the_fraction_that_was_lost_of_the_autopilots_frames_is_that_of_the_last_two_seconds() -> (
    None
):
    scene = Scene()
    scene.add().decoder.watch(AUTOPILOT)
    assert scene.links.loss == 0.0
    assert scene.measure(T_S) == 0.0  # nothing came, nothing was lost
    scene.receive(2)
    scene.receive(8, lost=2)
    assert scene.measure(T_S + 1.9) == 0.0  # not yet
    assert scene.measure(T_S + 2.1) == pytest.approx(2 / 12)
    scene.receive(20)
    assert scene.measure(T_S + 4.0) == pytest.approx(2 / 12)
    assert scene.measure(T_S + 4.2) == 0.0
    scene.receive(5, lost=5)
    assert scene.measure(T_S + 6.3) == pytest.approx(0.5)


def test_a_frame_that_was_counted_as_lost_and_comes_late_is_no_negative_loss() -> None:
    scene = Scene()
    decoded = scene.add().decoder.counters
    decoded.watched, decoded.lost = 100, 10
    scene.measure(T_S)
    decoded.watched, decoded.lost = 110, 9
    assert scene.measure(T_S + 3.0) == 0.0


def test_the_log_has_it_with_all_that_tells_how_link_and_loop_did() -> None:
    scene = Scene()
    decoded = scene.add().decoder.counters
    decoded.watched, decoded.lost, decoded.frames, decoded.bad_checksums = 3, 1, 50, 2
    scene.counters.unsent = 4
    ticks = scene.ticks
    ticks.late, ticks.skipped, ticks.over_run, ticks.worst_late_s = 5, 6, 7, 0.008
    scene.measure(T_S)
    assert scene.recorder.reports == [
        LinkReport(
            loss=0.25,
            round_trip_s=0.004,
            frames=50,
            bad_checksums=2,
            unsent=4,
            late=5,
            skipped=6,
            over_run=7,
            worst_late_s=0.008,
        )
    ]
    scene.measure(T_S + 1.0)
    assert len(scene.recorder.reports) == 1


def test_with_another_clock_the_two_seconds_begin_again() -> None:
    scene = Scene()
    scene.add()
    scene.measure(4000.0)
    scene.links.restart(1.0)
    scene.measure(1.0)
    assert len(scene.recorder.reports) == 2
