"""Positions from elsewhere than the autopilot: taken in, asked for, forwarded; each part alone."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
from samples import attitude_sample
from test_module import setup

from tgl_soar.config.site import Forward, PositionSettings, Sender
from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING, Source
from tgl_soar.link.natnet.server import MulticastStream
from tgl_soar.link.sources import MOCAP, VISION
from tgl_soar.onboard.external_positions import OutsidePositions
from tgl_soar.types import NO_ATTITUDE, NO_FIX

# The parts around it only record calls, which native code refuses.
pytestmark = pytest.mark.interpreted

T_S, VEHICLE_S = 20.0, 3.0
SERVER = ("10.0.0.2", 1511)
BRIDGE, STRANGER = Source(1, 197), Source(1, 198)
LEVEL = (1.0, 0.0, 0.0, 0.0)
REPORTED = attitude_sample(4, T_S, (0.6, 0.8, 0.0, 0.0), (0.1, 0.2, 0.3))  # by the autopilot


class Tracker:
    """A client of a motion-capture server."""

    def __init__(self) -> None:
        self.fix: Any = NO_FIX._replace(sequence=5, time_s=T_S - 0.01, north_m=1.0)
        self.attitude: Any = LEVEL
        self.stream: Any = None
        self.notices: list[tuple[int, str]] = []
        self.taken: list[Any] = []
        self.rebased = 0

    def take(self, *given: Any) -> Any:
        self.taken.append(given)
        return self.fix

    def poll(self, now_s: float) -> list[bytes]:
        return [b"ask %g" % now_s, b"more"]

    def rebase(self) -> None:
        self.rebased += 1


class Scene:
    """Positions of a tracker, and where they go."""

    def __init__(
        self, *, tracked: bool = False, forward: Forward | None = None, mocap: bool = True
    ) -> None:
        tracker: Any = Tracker()
        self.tracker = tracker
        self.asked: list[Any] = []
        self.sources: list[Any] = []
        self.outbound: list[Any] = []
        self.texts: list[tuple[int, str]] = []
        self.chosen: Any = SimpleNamespace(
            take=lambda *given: self.sources.append(given),
            position=NO_FIX._replace(sequence=1, time_s=T_S),
            attitude=LEVEL,
            chosen=MOCAP,
        )
        session: Any = SimpleNamespace(sources=self.chosen, attitude=NO_ATTITUDE)
        clocking: Any = SimpleNamespace(by_vehicle=False, lockstep=False, now_s=lambda now_s: now_s)
        self.session, self.clocking = session, clocking
        outbox: Any = SimpleNamespace(
            autopilot="autopilot",
            say=lambda *given: self.outbound.append(given),
            tell_all=self._tell_all,
        )
        flown = setup()._replace(
            tracked_attitude=tracked,
            forward=forward,
            position=PositionSettings(vision_from=[Sender(*BRIDGE)]),
        )
        self.positions = OutsidePositions(flown, session, clocking, outbox)
        if mocap:
            link: Any = SimpleNamespace(send=self.asked.append, follow=self.asked.append)
            self.positions.add_mocap(tracker, link)

    def _tell_all(self, notices: list[tuple[int, str]]) -> None:
        self.texts += notices
        notices.clear()

    def pose(self) -> None:
        self.positions.pose(b"pose", SERVER, T_S)


# --- taken in -------------------------------------------------------------------------------------


def test_a_pose_goes_to_the_tracker_and_its_fix_with_its_attitude_to_the_sources() -> None:
    scene = Scene()
    scene.pose()
    assert scene.tracker.taken == [(b"pose", SERVER, T_S)]
    assert scene.sources == [(MOCAP, scene.tracker.fix, T_S, LEVEL)]


def test_a_datagram_that_is_no_pose_and_one_without_a_tracker_are_no_fix() -> None:
    scene = Scene()
    scene.tracker.fix = None
    scene.pose()
    assert scene.sources == []
    without = Scene(mocap=False)
    without.pose()
    assert without.tracker.taken == []


@pytest.mark.parametrize(
    ("lockstep", "by_vehicle", "counts"),
    [(False, False, True), (True, True, True), (True, False, False)],
)
def test_in_lockstep_no_position_counts_before_the_vehicle_s_clock_does(
    lockstep: bool, by_vehicle: bool, counts: bool
) -> None:
    """Its time would be that of another clock."""
    scene = Scene()
    scene.clocking.lockstep, scene.clocking.by_vehicle = lockstep, by_vehicle
    scene.clocking.now_s = lambda now_s: VEHICLE_S if by_vehicle else now_s
    scene.pose()
    now_s = VEHICLE_S if by_vehicle else T_S
    assert scene.tracker.taken[0][2] == now_s
    assert [given[2] for given in scene.sources] == ([now_s] if counts else [])


# --- the tracker's attitude -----------------------------------------------------------------------


def test_an_attitude_of_the_tracker_is_flown_with_where_the_site_asks_for_it() -> None:
    scene = Scene(tracked=True)
    scene.pose()
    given = scene.positions.attitude(T_S)
    assert (given.time_s, given.qw) == (scene.tracker.fix.time_s, 1.0)
    scene.positions.forward(T_S)
    assert scene.texts == [(SEVERITY_INFO, "attitude: the tracker's")]


@pytest.mark.parametrize("tracked", [True, False])
def test_without_an_attitude_of_the_tracker_the_autopilots_is_flown_with(tracked: bool) -> None:
    scene = Scene(tracked=tracked)
    if tracked:
        scene.tracker.attitude = None
    scene.pose()
    scene.session.attitude = REPORTED
    assert scene.positions.attitude(T_S)._replace(sequence=REPORTED.sequence) == REPORTED


def test_with_another_clock_the_tracker_s_attitude_is_forgotten() -> None:
    scene = Scene(tracked=True)
    scene.pose()
    assert scene.positions.attitude(T_S).qw == LEVEL[0]
    scene.session.attitude = REPORTED
    scene.positions.restart()
    assert scene.positions.attitude(T_S).qw == REPORTED.qw
    assert scene.tracker.rebased == 1


# --- asked for ------------------------------------------------------------------------------------


def test_what_the_tracker_asks_is_sent_and_its_words_are_reported() -> None:
    scene = Scene()
    scene.tracker.notices = [(SEVERITY_WARNING, "no Motive")]
    scene.positions.ask(T_S)
    assert scene.asked == [b"ask 20", b"more"]
    assert scene.texts == [(SEVERITY_WARNING, "no Motive")]


def test_a_server_that_streams_elsewhere_is_followed() -> None:
    scene = Scene()
    scene.tracker.stream = MulticastStream("239.255.42.99", 1511)
    scene.positions.ask(T_S)
    assert scene.asked[-1] is scene.tracker.stream


def test_without_a_tracker_nobody_is_asked() -> None:
    scene = Scene(mocap=False)
    scene.positions.ask(T_S)
    scene.positions.restart()
    assert (scene.asked, scene.texts, scene.tracker.rebased) == ([], [], 0)


# --- forwarded ------------------------------------------------------------------------------------


def test_the_pose_goes_to_the_autopilot_alone_and_once() -> None:
    scene = Scene(forward=Forward())
    for _ in range(2):
        scene.positions.forward(T_S + 0.01)
    ((message, route),) = scene.outbound
    assert (message.usec, route) == (round(T_S * 1e6), "autopilot")


def test_nothing_is_forwarded_where_the_site_does_not_ask_for_it() -> None:
    scene = Scene()
    scene.positions.vision(BRIDGE)
    scene.positions.forward(T_S + 0.01)
    scene.positions.restart()
    assert (scene.outbound, scene.texts) == ([], [])


def test_why_nothing_is_forwarded_is_reported() -> None:
    scene = Scene(forward=Forward())
    scene.chosen.attitude = None
    scene.positions.forward(T_S + 0.01)
    ((severity, text),) = scene.texts
    assert severity == SEVERITY_WARNING
    assert text.endswith("is not forwarded: it has no attitude")
    assert scene.outbound == []


@pytest.mark.parametrize(("sender", "forwards"), [(BRIDGE, False), (STRANGER, True)])
def test_a_bridge_that_speaks_to_the_autopilot_itself_is_not_repeated(
    sender: Source, forwards: bool
) -> None:
    scene = Scene(forward=Forward())
    scene.chosen.chosen = VISION
    scene.positions.vision(sender)
    scene.positions.forward(T_S + 0.01)
    assert bool(scene.outbound) is forwards


def test_with_another_clock_a_pose_is_due_at_once() -> None:
    scene = Scene(forward=Forward())
    scene.positions.forward(T_S)
    scene.positions.restart()
    scene.chosen.position = NO_FIX._replace(sequence=2, time_s=VEHICLE_S)
    scene.positions.forward(VEHICLE_S)
    assert [message.usec for message, _ in scene.outbound] == [
        round(T_S * 1e6),
        round(VEHICLE_S * 1e6),
    ]
