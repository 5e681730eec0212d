"""Lockstep's questions: which peers are asked and when, waited for and how long, and the reports on
those who are missing.  Peers exist in name only, and the clock is ours."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from tgl_soar.sim.bridge import lockstep as module
from tgl_soar.sim.bridge.lockstep import BridgeError, Lockstep
from tgl_soar.sim.bridge.options import Pace
from tgl_soar.sim.ports import Peer

MODULE, OTHER, STATION, SECOND = 1, 2, 3, 4


class World:
    """Ports, traffic and Pixhawk at once, and a clock that goes on while something is waited for.

    `answers`: whose answers come, and after how many waits.
    """

    def __init__(
        self, patched: pytest.MonkeyPatch, *links: int, ground: bool = False, **pace: Any
    ) -> None:
        self.now_s, self.waits = 100.0, 0
        patched.setattr(module, "time", SimpleNamespace(monotonic=lambda: self.now_s))
        self.companion: Any = SimpleNamespace(ground=False)
        self.ground: Any = SimpleNamespace(ground=True)
        self.peers: dict[int, Peer] = {}
        for link in links:
            self.join(link, configured=True)
        self.beats: dict[int, int] = {}
        self.answers: dict[int, int] = {}
        self.asked: list[tuple[int, int]] = []  # link, stamp
        self.flushed: list[tuple[Any, bool]] = []
        self.paced: list[int] = []
        self.announced: list[float] = []
        self.reports: list[str] = []
        self.waited: list[tuple[float, tuple[Any, ...]]] = []
        self.mail = 0  # datagrams that wait to be taken
        self.chatter = False  # something else comes all the time
        self.stopping = False
        self.motive: Any = None
        self.is_disturbed = False
        self.when_forgotten: Any = None
        self.simulation = SimpleNamespace(pixhawk=self, time_s=2.5)
        usual: dict[str, Any] = {"lockstep": True, "lockstep_ground": ground}
        self.lockstep = Lockstep(
            self,  # type: ignore[arg-type]
            Pace(**{**usual, "patience_s": 5.0, "start_timeout_s": 30.0, **pace}),
            lambda: self.stopping,
        )

    @property
    def ports(self) -> World:
        return self

    def join(self, link: int, *, configured: bool) -> None:
        port = self.ground if link in (STATION, SECOND) else self.companion
        self.peers[link] = Peer(
            link=link, port=port, address=("127.0.0.1", 10 * link), configured=configured
        )

    # What the ports do.

    def wait(self, seconds: float, *ports: Any) -> bool:
        self.waited.append((seconds, ports))
        self.now_s += seconds
        self.waits += 1
        return self.chatter

    # What the traffic does.

    def is_companion(self, link: int) -> bool:
        return link not in (STATION, SECOND)

    def take_one(self, _port: Any) -> bool:
        if self.chatter:
            self.now_s += 0.01
            return True
        self.mail -= 1
        return self.mail >= 0

    def report(self, text: str) -> None:
        self.reports.append(text)

    def serve(self) -> None:
        pass

    def flush(self, links: Any = None, *, corrupted: bool = True) -> None:
        self.flushed.append((links, corrupted))

    # What the Pixhawk does.

    def announce(self) -> None:
        self.announced.append(self.now_s)

    def heartbeats(self, link: int) -> int:
        return self.beats.get(link, 0)

    def set_pace(self, link: int) -> None:
        self.paced.append(link)

    def send(self, link: int, message: Any) -> None:
        assert message.get_type() == "TIMESYNC"
        assert message.tc1 == 0  # a question
        self.asked.append((link, message.ts1))

    def timesync_answer_ns(self, link: int) -> int:
        after = self.answers.get(link, 0)
        return self.asked[-1][1] if self.waits >= after else -1


def gathered(patched: pytest.MonkeyPatch, *links: int, ground: bool = False, **pace: Any) -> World:
    """Everybody has greeted and answers at once."""
    world = World(patched, *links, ground=ground, **pace)
    world.beats = dict.fromkeys(links, 1)
    world.lockstep.gather()
    for noted in (world.asked, world.flushed, world.paced, world.announced, world.reports):
        noted.clear()
    return world


# --- the barrier ----------------------------------------------------------------------------------


def test_the_stamp_is_simulated_time_and_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """In nanoseconds, and never zero."""
    world = gathered(monkeypatch, MODULE)
    world.lockstep.meet_companions()
    assert world.asked == [(MODULE, 3_500_000_000)]
    world.simulation.time_s = 0.0
    world.lockstep.meet_companions()
    assert world.asked[1:] == [(MODULE, 1_000_000_000)]


def test_companions_and_stations_are_asked_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    world = gathered(monkeypatch, MODULE, OTHER, STATION, ground=True)
    world.lockstep.meet_companions()
    assert [link for link, _ in world.asked] == [MODULE, OTHER]
    assert world.flushed == [([MODULE, OTHER], False)]  # past all faults, to its side alone
    world.asked.clear()
    world.flushed.clear()
    world.lockstep.meet_stations()
    assert [link for link, _ in world.asked] == [STATION]
    assert world.flushed == [([STATION], False)]


def test_all_of_a_side_get_their_mail_though_not_all_are_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = gathered(monkeypatch, MODULE)
    world.join(OTHER, configured=False)
    world.lockstep.meet_companions()
    assert [link for link, _ in world.asked] == [MODULE]
    assert world.flushed == [([MODULE, OTHER], False)]


def test_where_faults_act_other_mail_goes_before_the_question(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = gathered(monkeypatch, MODULE)
    world.is_disturbed = True
    world.lockstep.meet_companions()
    assert world.flushed == [(None, True), ([MODULE], False)]


def test_without_participants_nobody_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    world = gathered(monkeypatch, MODULE)
    world.lockstep.meet_stations()
    assert (world.asked, world.flushed, world.waited) == ([], [], [])


def test_mail_that_waits_is_taken_before_anything_is_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = gathered(monkeypatch, MODULE)
    world.answers, world.mail = {MODULE: world.waits + 1}, 3
    world.lockstep.meet_companions()
    assert world.mail == -1
    assert world.waited == [(0.1, (world.companion,))]


def test_a_question_is_repeated_once_a_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """Should a datagram have been lost; 3.45 s are waited in steps of 0.1 s."""
    world = gathered(monkeypatch, MODULE)
    world.answers = {MODULE: world.waits + 35}
    world.lockstep.meet_companions()
    assert world.asked == [(MODULE, 3_500_000_000)] * 4
    assert world.flushed == [([MODULE], False)] * 4
    assert world.reports == []


def test_who_is_silent_for_longer_than_the_patience_is_given_up_and_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = gathered(monkeypatch, MODULE, patience_s=0.35)
    world.answers = {MODULE: 1000}
    world.lockstep.meet_companions()
    assert len(world.waited) == 4
    assert world.lockstep.is_peer_missing
    assert world.reports == [
        "the companion at 127.0.0.1:10 has not answered for 0.35 s:"
        " going on at natural pace without it"
    ]
    world.asked.clear()
    world.lockstep.meet_companions()  # none is asked any more
    assert world.asked == []


def test_who_talks_and_does_not_answer_is_asked_again_and_given_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Another program at its port, that beats faster than the bridge waits."""
    world = gathered(monkeypatch, MODULE, patience_s=2.5)
    world.answers, world.chatter = {MODULE: 1000}, True
    world.lockstep.meet_companions()
    assert world.asked == [(MODULE, 3_500_000_000)] * 3
    assert world.lockstep.is_peer_missing
    assert world.now_s < 103.0


def test_who_answers_within_the_patience_is_not_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    world = gathered(monkeypatch, MODULE, patience_s=0.35)
    world.answers = {MODULE: world.waits + 3}
    world.lockstep.meet_companions()
    assert not world.lockstep.is_peer_missing


def test_one_that_is_silent_does_not_keep_others_from_being_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = gathered(monkeypatch, MODULE, OTHER, patience_s=0.35)
    world.answers = {MODULE: 1000, OTHER: 6}
    world.lockstep.meet_companions()
    assert len(world.reports) == 1
    assert world.waits >= 6


def test_who_stops_the_bridge_waits_for_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    world = gathered(monkeypatch, MODULE)
    world.answers, world.stopping = {MODULE: 1000}, True
    world.lockstep.meet_companions()
    assert world.waited == []
    assert not world.lockstep.is_peer_missing


def test_who_is_forgotten_is_neither_asked_nor_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    world = gathered(monkeypatch, MODULE, OTHER, patience_s=0.35)
    world.when_forgotten(OTHER)
    world.lockstep.meet_companions()
    assert [link for link, _ in world.asked] == [MODULE]
    world.answers = {MODULE: 1000}
    world.lockstep.meet_companions()
    assert world.lockstep.is_peer_missing
    world.when_forgotten(MODULE)
    assert not world.lockstep.is_peer_missing
    world.when_forgotten(SECOND)  # no peer


# --- before the first step ------------------------------------------------------------------------


def test_all_that_have_greeted_take_part_and_companions_set_the_pace(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World(monkeypatch, MODULE, STATION, ground=True)
    world.join(OTHER, configured=False)
    world.beats = {MODULE: 1, STATION: 2}
    world.lockstep.gather()
    assert world.paced == [MODULE]
    assert [link for link, _ in world.asked] == [MODULE, STATION]
    assert world.announced == [100.0]


def test_stations_do_not_take_part_unless_they_are_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World(monkeypatch, MODULE, STATION)
    world.beats = {MODULE: 1, STATION: 1}
    world.lockstep.gather()
    assert [link for link, _ in world.asked] == [MODULE]


def test_the_vehicle_is_shown_five_times_a_second_until_all_are_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The clock goes on by 0.05 s at a time, so that 0.2 s are over at the fifth."""
    world = World(monkeypatch, MODULE, start_timeout_s=0.9)
    with pytest.raises(BridgeError):
        world.lockstep.gather()
    assert world.announced == pytest.approx([100.0, 100.25, 100.5, 100.75], abs=0.06)
    assert len(world.announced) == 4
    assert {seconds for seconds, _ in world.waited} == {0.05}
    assert all(ports == (world.ground, world.companion) for _, ports in world.waited)
    assert world.flushed == [(None, True)] * (len(world.waited) + 1)


def test_who_does_not_come_in_time_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(monkeypatch, MODULE, STATION, ground=True, start_timeout_s=1.5)
    with pytest.raises(
        BridgeError,
        match=r"no heartbeat from the companion at 127\.0\.0\.1:10 or the ground station at"
        r" 127\.0\.0\.1:30 within 1\.5 s: start it, or use --speed realtime",
    ):
        world.lockstep.gather()
    assert world.now_s == pytest.approx(101.5, abs=0.1)


def test_after_two_seconds_it_is_reported_once_who_is_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World(monkeypatch, MODULE, STATION, ground=True)
    with pytest.raises(BridgeError, match="within 30 s"):
        world.lockstep.gather()
    assert world.reports == [
        "waiting for the first heartbeat of the companion at 127.0.0.1:10"
        " and of the ground station at 127.0.0.1:30"
    ]
    short = World(monkeypatch, MODULE, start_timeout_s=1.9)
    with pytest.raises(BridgeError):
        short.lockstep.gather()
    assert short.reports == []


def test_any_companion_will_do(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(monkeypatch, MODULE)
    world.join(OTHER, configured=False)
    world.beats = {OTHER: 1}
    world.lockstep.gather()
    assert [link for link, _ in world.asked] == [OTHER]


def test_where_no_companion_is_configured_any_is_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World(monkeypatch, start_timeout_s=0.1)
    with pytest.raises(BridgeError, match=r"no heartbeat from a companion within 0\.1 s"):
        world.lockstep.gather()


def test_a_stranger_among_the_stations_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(monkeypatch, MODULE, STATION, ground=True)
    world.join(SECOND, configured=False)
    world.beats = {MODULE: 1, STATION: 1}
    world.lockstep.gather()
    assert [link for link, _ in world.asked] == [MODULE, STATION]


def test_a_hall_is_waited_for_until_a_client_follows_it(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(monkeypatch, MODULE, start_timeout_s=0.1)
    world.beats = {MODULE: 1}
    world.motive = SimpleNamespace(motive=SimpleNamespace(is_followed=False))
    with pytest.raises(BridgeError, match="no heartbeat from a NatNet client within"):
        world.lockstep.gather()
    world.motive.motive.is_followed = True
    world.lockstep.gather()


def test_who_stops_the_bridge_is_not_kept_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(monkeypatch, MODULE)
    world.stopping = True
    world.lockstep.gather()
    assert (world.waited, world.asked, world.announced) == ([], [], [])


# --- peers that come back -------------------------------------------------------------------------


def missing(patched: pytest.MonkeyPatch, *links: int, lost: int) -> World:
    """One of them was given up after seven datagrams."""
    world = gathered(patched, *links, ground=True, patience_s=0.05)
    world.peers[lost].datagrams = 7
    world.answers = {lost: 10_000}
    world.lockstep.meet_companions()
    world.lockstep.meet_stations()
    for noted in (world.asked, world.reports, world.flushed):
        noted.clear()
    assert world.lockstep.is_peer_missing
    return world


def test_one_that_sends_again_is_asked_and_waited_for_once_it_answers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = missing(monkeypatch, MODULE, STATION, lost=STATION)
    world.lockstep.readmit()
    assert world.lockstep.is_peer_missing
    assert world.asked == []  # it is silent
    world.peers[STATION].datagrams = 8
    for _ in range(2):
        world.lockstep.readmit()
        assert world.asked == [(STATION, 3_500_000_000)]  # once a second
        assert world.flushed == [([STATION], False)]
    assert world.lockstep.is_peer_missing
    world.now_s += 1.01
    world.lockstep.readmit()
    assert len(world.asked) == 1  # nothing has come since
    world.peers[STATION].datagrams = 9
    world.lockstep.readmit()
    assert len(world.asked) == 2
    assert world.reports == []
    world.answers = {}
    world.lockstep.readmit()
    assert world.reports == ["the ground station at 127.0.0.1:30 is back"]
    world.asked.clear()
    world.lockstep.meet_stations()
    assert [link for link, _ in world.asked] == [STATION]
    world.lockstep.readmit()
    assert len(world.reports) == 1


def test_a_successor_frees_from_waiting_for_a_companion_but_not_for_a_station(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = missing(monkeypatch, MODULE, STATION, lost=STATION)
    world.join(OTHER, configured=False)
    world.lockstep.readmit()
    assert world.paced == []  # it has not greeted
    world.beats[OTHER] = 1
    world.lockstep.readmit()
    assert world.reports == ["the companion at 127.0.0.1:20 takes part"]
    assert world.paced == [OTHER]
    assert world.lockstep.is_peer_missing  # the station
    world.lockstep.meet_companions()
    assert [link for link, _ in world.asked] == [MODULE, OTHER]


def test_a_station_that_is_new_is_not_asked_to_take_part(monkeypatch: pytest.MonkeyPatch) -> None:
    world = missing(monkeypatch, MODULE, lost=MODULE)
    world.join(SECOND, configured=False)
    world.beats[SECOND] = 3
    world.lockstep.readmit()
    assert world.reports == []
