"""One round of the loop after the other, on a clock of our own: what is done, and in what order."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import inf
from types import SimpleNamespace
from typing import Any

import pytest

from tgl_soar.link.messages import Source
from tgl_soar.link.natnet.sockets import MAX_DATAGRAMS as MAX_POSES
from tgl_soar.link.transports.base import LinkCounters
from tgl_soar.link.transports.udp import UdpListener
from tgl_soar.onboard import loop, pacing, realtime
from tgl_soar.onboard.loop import COMPLAIN_S, POSES_S, Links, take_poses

# A module of a few functions stands for the whole one, which native code refuses.
pytestmark = pytest.mark.interpreted

BEGAN_S = 100.0
POSE_FD, FIRST_FD, OTHER_FD = 30, 10, 11


class Recorded:
    """The module as the loop calls it; every call leaves a word in `done`."""

    def __init__(self, done: list[Any]) -> None:
        self.done = done
        self.warm_up_s = inf
        self.lockstep = False
        self.due_from_s = inf
        self.overdue_from_s = inf
        self.wakes_s: list[float] = []
        self.clocking: Any = SimpleNamespace(
            wake_s=self._wake_s,
            due=lambda now_s: now_s >= self.due_from_s,
            overdue=lambda now_s: now_s >= self.overdue_from_s,
            lockstep=False,
        )
        self.pacer = SimpleNamespace(
            begin=lambda now_s: done.append(("begin", now_s)),
            warmed_up=lambda at_s, now_s: done.append(("warmed up", at_s, now_s)),
            done=lambda began_s, now_s: done.append(("done", began_s, now_s)),
            expected_s=BEGAN_S + 0.005,
        )
        self.session = SimpleNamespace(
            counters=SimpleNamespace(heartbeats=0),
            has_heartbeat=False,
            senders=set(),
            autopilot=Source(7, 1),
        )
        self.decoder = SimpleNamespace(only_v1=False, counters=SimpleNamespace(frames=0))
        self.signing = SimpleNamespace(timestamp=0, key=None)
        self.has_surfaces = False
        self.positions = SimpleNamespace(pose=lambda *given: done.append(("pose", *given)))
        self.may_read = [True, True]
        self.more_tries = [False, True]
        self.waiting = [False, False]
        self.links = SimpleNamespace(
            may_read=lambda link: self.may_read[link],
            has_more_tries=lambda link: self.more_tries[link],
            is_waiting=lambda link: self.waiting[link],
        )
        self.accepts = True

    def _wake_s(self, now_s: float) -> float:
        self.wakes_s.append(now_s)
        return now_s + 0.0025

    def warm_up(self) -> None:
        self.done.append("warm up")

    def periodic(self, now_s: float) -> None:
        self.due_from_s = self.overdue_from_s = inf
        self.done.append(("tick", now_s))

    def idle(self, now_s: float) -> None:
        self.done.append(("idle", now_s))

    def event(self, data: bytes, now_s: float, link: int = 0) -> bool:
        self.done.append(("event", data, now_s, link))
        self.waiting[link] = False
        return self.accepts

    def relinked(self, link: int = 0) -> None:
        self.done.append(("relinked", link))


class Link:
    """A transport that has some datagrams."""

    def __init__(
        self, done: list[Any], fd: int, coming: Iterable[bytes] = (), *, is_stream: bool = False
    ) -> None:
        self.name = f"link {fd}"
        self.is_stream = is_stream
        self.counters = LinkCounters()
        self.generation = 3
        self.coming = list(coming)
        self.reads: list[int] = []
        self._done, self._fd = done, fd

    def fileno(self) -> int:
        return self._fd

    def receive(self, _now_s: float, most: int) -> list[bytes]:
        self.reads.append(most)
        given, self.coming = self.coming[:most], self.coming[most:]
        return given

    def hold(self, now_s: float) -> None:
        self._done.append(("hold", self._fd, now_s))


class Tracker:
    """A feed that has so many poses."""

    def __init__(self, poses: int = 0) -> None:
        self.left = poses
        self.most: list[int] = []

    def filenos(self) -> list[int]:
        return [POSE_FD]

    def receive(self, most: int) -> list[tuple[bytes, tuple[str, int]]]:
        self.most.append(most)
        count = min(most, self.left)
        self.left -= count
        return [(b"pose", ("10.0.0.2", 1511))] * count


class Scene:
    """Rounds that are given: when each begins, and what can be read in it."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.done: list[Any] = []
        self.onboard: Any = Recorded(self.done)
        self.first = Link(self.done, FIRST_FD)
        self.waits: list[tuple[list[int], float, float]] = []
        self.awake_s: list[float | None] = []
        self.words: list[str] = []
        self.now_s = BEGAN_S
        self.rounds: list[tuple[float, list[int]]] = []
        scene = self

        class Waiter:
            def __init__(self, _clock: Callable[[], float], awake_s: float | None) -> None:
                scene.awake_s.append(awake_s)

            def wait(
                self, fds: Sequence[int], until_s: float, expected_s: float
            ) -> tuple[float, list[int]]:
                scene.waits.append((list(fds), until_s, expected_s))
                scene.now_s, ready = scene.rounds.pop(0)
                return scene.now_s, ready

        monkeypatch.setattr(pacing, "Waiter", Waiter)
        monkeypatch.setattr(realtime, "clock_s", lambda: self.now_s)

    def run(self, rounds: Iterable[tuple[float, list[int]]], *others: Link, **named: Any) -> bool:
        self.rounds = list(rounds)
        transports: Any = [self.first, *others]
        stop = lambda: not self.rounds  # noqa: E731
        return loop.run(self.onboard, transports, stop, self.words.append, **named)


@pytest.fixture
def scene(monkeypatch: pytest.MonkeyPatch) -> Scene:
    return Scene(monkeypatch)


class Shown:
    """What the process shows of itself."""

    def __init__(self) -> None:
        self.rounds: list[tuple[bool, dict[str, Any]]] = []

    def show(self, has_surfaces: bool, **named: Any) -> None:
        self.rounds.append((has_surfaces, named))


# --- a round --------------------------------------------------------------------------------------


def test_time_before_the_loop_is_no_delay_and_once_stopped_it_goes_round_no_more(
    scene: Scene,
) -> None:
    assert scene.run([], spin_s=0.0007)
    assert scene.done == [("begin", BEGAN_S)]
    assert scene.awake_s == [0.0007]
    assert not scene.waits


def test_by_default_the_waiter_learns_how_long_to_stay_awake(scene: Scene) -> None:
    scene.run([])
    assert scene.awake_s == [None]


def test_poses_and_links_are_waited_for_until_the_tick(scene: Scene) -> None:
    other = Link(scene.done, OTHER_FD)
    at_s = BEGAN_S + 0.001
    scene.run([(at_s, []), (at_s, [])], other, mocap=Tracker())
    expected_s = BEGAN_S + 0.005
    fds = [POSE_FD, FIRST_FD, OTHER_FD]
    assert scene.waits == [
        (fds, BEGAN_S + 0.0025, expected_s),
        (fds, at_s + 0.0025, expected_s),
    ]
    assert scene.onboard.wakes_s == [BEGAN_S, at_s]


def test_what_comes_from_the_autopilot_goes_before_the_tick_and_others_after_it(
    scene: Scene,
) -> None:
    at_s = BEGAN_S + 0.005
    scene.first.coming = [b"attitude"]
    scene.onboard.due_from_s = at_s
    scene.run([(at_s, [FIRST_FD, OTHER_FD])], Link(scene.done, OTHER_FD, [b"station"]))
    assert scene.done[1:] == [
        ("event", b"attitude", at_s, 0),
        ("hold", FIRST_FD, at_s),
        ("tick", at_s),
        ("done", at_s, at_s),
        ("event", b"station", at_s, 1),
        ("hold", OTHER_FD, at_s),
    ]


def test_where_no_tick_is_due_the_module_idles(scene: Scene) -> None:
    at_s = BEGAN_S + 0.005
    scene.onboard.due_from_s = at_s + 0.001
    scene.run([(at_s, [])])
    assert scene.done[1:] == [("idle", at_s)]


def test_the_process_shows_itself_once_a_round(scene: Scene) -> None:
    heartbeat = Shown()
    scene.run([(BEGAN_S, []), (BEGAN_S, [])], heartbeat=heartbeat)
    assert len(heartbeat.rounds) == 2


# --- warm-ups -------------------------------------------------------------------------------------


def test_the_loop_wakes_for_a_warm_up_and_reads_nothing_in_that_round(scene: Scene) -> None:
    warm_up_s = scene.onboard.warm_up_s = BEGAN_S + 0.002
    scene.first.coming = [b"later"]
    heartbeat = Shown()
    scene.run([(warm_up_s + 1e-4, [])], heartbeat=heartbeat)
    assert scene.waits[0][1] == warm_up_s  # before the tick at 2.5 ms
    assert scene.done[1:] == ["warm up", ("warmed up", warm_up_s, warm_up_s + 1e-4)]
    assert not heartbeat.rounds


def test_a_warm_up_waits_for_its_time(scene: Scene) -> None:
    scene.onboard.warm_up_s = BEGAN_S + 0.002
    scene.run([(BEGAN_S + 0.0019, [])])
    assert "warm up" not in scene.done


def test_a_power_saving_loop_sleeps_until_the_tick(scene: Scene) -> None:
    scene.onboard.warm_up_s = BEGAN_S + 0.002
    scene.run([(BEGAN_S + 0.002, [])], power_saving=True)
    assert scene.waits[0][1] == BEGAN_S + 0.0025
    assert "warm up" not in scene.done


# --- poses ----------------------------------------------------------------------------------------


def poses(done: list[Any]) -> int:
    return sum(each[0] == "pose" for each in done)


def test_poses_are_taken_one_by_one_before_the_tick(scene: Scene) -> None:
    at_s = BEGAN_S + 0.001
    tracker = Tracker(3)
    scene.run([(at_s, [POSE_FD])], mocap=tracker)
    pose = ("pose", b"pose", ("10.0.0.2", 1511), at_s)
    assert scene.done[1:] == [pose, pose, pose, ("idle", at_s)]
    assert set(tracker.most) == {1}


def test_no_more_poses_are_taken_at_once_than_a_read_of_the_tracker_brings(scene: Scene) -> None:
    tracker: Any = Tracker(100)
    take_poses(scene.onboard, tracker, BEGAN_S, lambda: BEGAN_S)
    assert poses(scene.done) == MAX_POSES


@pytest.mark.parametrize(("lockstep", "taken"), [(False, 5), (True, MAX_POSES)])
def test_slow_poses_end_with_their_time_but_in_a_simulation(
    scene: Scene, lockstep: bool, taken: int
) -> None:
    """Each costs a quarter of what there is; in lockstep no tick waits for them."""
    scene.onboard.clocking.lockstep = lockstep
    looks = iter(range(100))
    tracker: Any = Tracker(100)
    take_poses(scene.onboard, tracker, BEGAN_S, lambda: 1.0 + next(looks) * POSES_S * 0.24)
    assert poses(scene.done) == taken
    assert POSES_S < 0.5 * 0.005  # of a period of 200 Hz: the tick is not held up by poses


# --- the autopilot's link -------------------------------------------------------------------------


def links(scene: Scene, *others: Link, **named: Any) -> Links:
    transports: Any = [scene.first, *others]
    return Links(scene.onboard, transports, lambda: scene.now_s, **named)


@pytest.mark.parametrize(
    ("fd", "ready", "is_stream", "reads"),
    [
        (FIRST_FD, [FIRST_FD], False, 1),
        (FIRST_FD, [OTHER_FD], False, 0),
        (0, [], False, 0),  # a file of number 0 is waited for like any other
        (-1, [], False, 1),  # nothing to wait on
        (FIRST_FD, [], True, 1),  # what waits to be written is written by a read
    ],
)
def test_a_link_is_read_where_something_may_have_come(
    scene: Scene, fd: int, ready: list[int], is_stream: bool, reads: int
) -> None:
    scene.first = Link(scene.done, fd, is_stream=is_stream)
    links(scene).read_autopilot(ready, BEGAN_S)
    assert len(scene.first.reads) == reads


def test_the_autopilot_is_read_until_nothing_waits_and_holds_its_place_by_what_is_accepted(
    scene: Scene,
) -> None:
    scene.first.coming = [b"bad"] * 2
    scene.onboard.accepts = False
    links(scene).read_autopilot([FIRST_FD], BEGAN_S)
    assert scene.done == [("event", b"bad", BEGAN_S, 0)] * 2
    assert scene.first.reads == [64]


def test_a_flood_does_not_hold_up_the_tick(scene: Scene) -> None:
    scene.first.coming = [b"a", b"b"]
    scene.onboard.accepts = False
    scene.onboard.overdue_from_s = BEGAN_S
    heartbeat: Any = Shown()
    links(scene, heartbeat=heartbeat).read_autopilot([FIRST_FD], BEGAN_S - 1.0)
    assert scene.done == [
        ("event", b"a", BEGAN_S - 1.0, 0),
        ("tick", BEGAN_S),
        ("event", b"b", BEGAN_S - 1.0, 0),
    ]
    assert len(heartbeat.rounds) == 1


def test_in_lockstep_a_pose_of_the_step_goes_before_its_attitude(scene: Scene) -> None:
    scene.first.coming = [b"attitude"]
    tracker: Any = Tracker(1)
    links(scene, mocap=tracker).read_autopilot([FIRST_FD], BEGAN_S)
    assert [each[0] for each in scene.done] == ["pose", "event", "hold"]


def test_the_module_is_notified_once_of_another_peer(scene: Scene) -> None:
    other = Link(scene.done, OTHER_FD)
    reading = links(scene, other)
    other.generation += 1
    for _ in range(2):
        reading.read_others([OTHER_FD], BEGAN_S)
    assert scene.done == [("relinked", 1)]


# --- other links ----------------------------------------------------------------------------------


def test_what_has_had_its_share_is_not_waited_for_but_the_autopilot_always_is(
    scene: Scene,
) -> None:
    reading = links(scene, Link(scene.done, OTHER_FD))
    assert reading.filenos() == [FIRST_FD, OTHER_FD]
    scene.onboard.more_tries = [False, False]
    assert reading.filenos() == [FIRST_FD, -1]


def test_other_links_are_read_a_datagram_at_a_time_until_nothing_comes(scene: Scene) -> None:
    other = Link(scene.done, OTHER_FD, [b"a", b"b"])
    links(scene, other).read_others([OTHER_FD], BEGAN_S)
    assert [each[1] for each in scene.done if each[0] == "event"] == [b"a", b"b"]
    assert other.reads == [1, 1, 1]
    assert not scene.first.reads


def test_what_waits_from_before_is_decoded_before_more_is_read(scene: Scene) -> None:
    other = Link(scene.done, OTHER_FD)
    scene.onboard.waiting = [False, True]
    links(scene, other).read_others([], BEGAN_S)
    assert scene.done[0] == ("event", b"", BEGAN_S, 1)
    assert other.reads == [1]  # after it


@pytest.mark.parametrize("what", ["nothing can be read", "its share is used up", "a tick is due"])
def test_another_link_is_left_alone_where(scene: Scene, what: str) -> None:
    other = Link(scene.done, OTHER_FD, [b"a"])
    if what == "its share is used up":
        scene.onboard.may_read = [True, False]
    if what == "a tick is due":
        scene.onboard.overdue_from_s = BEGAN_S
    ready = [] if what == "nothing can be read" else [OTHER_FD]
    links(scene, other).read_others(ready, BEGAN_S)
    assert not other.reads


# --- what the watchdog is shown -------------------------------------------------------------------


def test_the_watchdog_is_shown_all_that_it_releases_with(scene: Scene) -> None:
    onboard, heartbeat = scene.onboard, Shown()
    onboard.has_surfaces = onboard.decoder.only_v1 = True
    onboard.signing.timestamp, onboard.signing.key = 77, bytes(range(32))
    shown: Any = heartbeat
    links(scene, heartbeat=shown).show_heartbeat()
    named = {"version1": True, "peer": None, "timestamp": 77, "key": bytes(range(32))}
    assert heartbeat.rounds == [(True, named)]


def test_of_a_link_that_listens_the_watchdog_is_shown_the_peer(scene: Scene) -> None:
    listener: Any = UdpListener("udp:127.0.0.1:0", "127.0.0.1", 0, lambda _data: True)
    listener.peer = ("127.0.0.1", 14550)
    scene.first = listener
    shown: Any = Shown()
    links(scene, heartbeat=shown).show_heartbeat()
    listener.close()
    assert shown.rounds[0][1]["peer"] == ("127.0.0.1", 14550)


# --- an autopilot that is not there ---------------------------------------------------------------


def at(*after_s: float) -> list[tuple[float, list[int]]]:
    """Rounds so long after the beginning."""
    return [(BEGAN_S + each, []) for each in after_s]


def test_silence_is_complained_of_every_few_seconds(scene: Scene) -> None:
    just = 0.01
    scene.run(at(COMPLAIN_S - just, COMPLAIN_S + just, 2 * COMPLAIN_S, 2 * COMPLAIN_S + 2 * just))
    assert len(scene.words) == 2
    assert 2.0 < COMPLAIN_S < 10.0  # heartbeats come once a second; a person waits at the console


def test_each_heartbeat_buys_silence_from_complaints(scene: Scene) -> None:
    """From the round on in which it is noticed."""
    scene.rounds = at(4.0)
    beats = iter((1, 1, 1))

    class Counters:
        @property
        def heartbeats(self) -> int:
            return next(beats)

    scene.onboard.session.counters = Counters()
    scene.run(at(4.0, 8.9, 9.1))
    assert len(scene.words) == 1


@pytest.mark.parametrize(
    ("timeout_s", "is_received", "after_s", "in_order"),
    [
        (3.0, False, 2.9, True),
        (3.0, False, 3.1, False),
        (3.0, True, 3.1, True),
        (None, False, 4.9, True),
    ],
)
def test_given_a_timeout_the_loop_gives_up_waiting_for_an_autopilot(
    scene: Scene, timeout_s: float | None, is_received: bool, after_s: float, in_order: bool
) -> None:
    scene.onboard.session.has_heartbeat = is_received
    rounds = at(after_s, after_s)
    assert scene.run(rounds, timeout_s=timeout_s) is in_order
    assert scene.words == (
        [] if in_order else [f"no autopilot on link {FIRST_FD} within 3 s: giving up"]
    )


def complaint(scene: Scene) -> str:
    scene.words.clear()
    scene.now_s = BEGAN_S
    scene.run(at(COMPLAIN_S + 0.1))
    (words,) = scene.words
    assert words.startswith(f"no heartbeat of system 7, component 1 on link {FIRST_FD}")
    return words


def test_a_complaint_says_what_to_look_at(scene: Scene) -> None:
    session, carried = scene.onboard.session, scene.first.counters
    assert complaint(scene).endswith(
        ": nothing came. Is the autopilot on, and does it send to this port or line?"
    )
    carried.strangers = 1
    assert complaint(scene).endswith(": what came there was not MAVLink, or not of one peer")
    carried.bytes_in = 1
    assert "1 bytes came, none of them MAVLink: check the baud rate" in complaint(scene)
    assert "SERIALn_PROTOCOL = 2" in complaint(scene)
    scene.onboard.decoder.counters.frames = 1  # MAVLink after all, of an unknown sender
    assert "not of one peer" in complaint(scene)
    session.senders = {Source(9, 190), Source(1, 1)}
    assert complaint(scene).endswith(
        ", only of 1:1, 9:190: check autopilot.system_id in the airframe file"
    )
    session.has_heartbeat = True
    assert complaint(scene).endswith(" for 5 s: it has stopped, or the link is cut")
