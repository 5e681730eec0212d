"""What goes out for a process that is dead, on a link and a clock of the test's own."""

from __future__ import annotations

import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_module import CHANNELS, setup

from tgl_soar.link.autopilots import flavour
from tgl_soar.link.messages import Source
from tgl_soar.link.mode_change import PATIENCE_S
from tgl_soar.link.signing import TICKS_PER_S, YEAR_TICKS
from tgl_soar.link.signing_keys import Secret
from tgl_soar.link.transports.base import LinkError
from tgl_soar.link.transports.udp import UdpListener
from tgl_soar.onboard import realtime, watchdog_release
from tgl_soar.onboard.command_line import RunOptions
from tgl_soar.onboard.setup import ModuleSetup
from tgl_soar.onboard.surface_control import RELEASE_FRAMES
from tgl_soar.onboard.watchdog import ENDING_S, Sign
from tgl_soar.onboard.watchdog_release import hand_over, open_for

# Clock, sleep and link are put in the place of the real ones.
pytestmark = pytest.mark.interpreted

FBWA, GUIDED = 5, 15  # ArduPlane's custom modes
KEY = bytes(range(1, 33))
SIGN = Sign(rounds=9, timestamp=0, has_surfaces=True, version1=False, host="", port=0)
OPTIONS = RunOptions(airframe="airframe", site="site", links=("tcp:first:1", "tcp:other:2"))
FAR_AHEAD = 20 * YEAR_TICKS  # no stamp of today's is later
WHOLE_FRAME = 280  # bytes of a MAVLink 2 frame with a full payload, signed


class Link:
    """The link to the autopilot, and the autopilot."""

    is_stream = False

    def __init__(self) -> None:
        self.frames: list[bytes] = []
        self.done: list[str] = []
        self.sent_s: list[float] = []
        self.now_s = 1000.0
        self.vehicle = mavlink.MAVLink(None, 1, 1)
        self.kind = (mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
        self.mode: int | None = None  # None: it sends no heartbeat
        self.leaves = True
        self._beat_s = self.now_s
        self.fails = False

    def send(self, frame: bytes) -> bool:
        if self.fails:
            raise ZeroDivisionError
        self.frames.append(frame)
        self.sent_s.append(self.now_s)
        if self.leaves and frame[7:10] == bytes((76, 0, 0)):  # COMMAND_LONG
            self.mode = int(self.outbound()[-1].param2)
        return True

    def receive(self, now_s: float) -> list[bytes]:
        assert now_s == self.now_s
        self.done.append("received")
        if self.mode is None or now_s < self._beat_s:
            return []
        self._beat_s += 1.0
        beat = mavlink.MAVLink_heartbeat_message(*self.kind, 81, self.mode, 4, 3)
        return [bytes(beat.pack(self.vehicle))]

    def clear_for_release(self) -> bool:
        assert not self.frames
        self.done.append("cleared")
        return False

    def close(self) -> None:
        self.done.append("closed")

    def outbound(self, kind: str = "") -> list[Any]:
        reader = mavlink.MAVLink(None)
        messages = [reader.decode(bytearray(frame)) for frame in self.frames]
        return [m for m in messages if not kind or m.get_type() == kind]


class Scene:
    """A hand-over, and what it was made with."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.link: Any = Link()
        self.opened: list[tuple[str, Callable[[bytes], bool], float]] = []
        self.words: list[str] = []
        monkeypatch.setattr(realtime, "clock_s", lambda: self.link.now_s)
        monkeypatch.setattr(watchdog_release, "time", SimpleNamespace(
            time=time.time, sleep=self._sleep
        ))  # fmt: skip
        monkeypatch.setattr(watchdog_release, "open_link", self._open)
        monkeypatch.setattr(watchdog_release, "say", self.words.append)

    def _sleep(self, seconds: float) -> None:
        self.link.now_s += seconds

    def _open(self, link: str, is_frame: Callable[[bytes], bool], now_s: float) -> Any:
        self.opened.append((link, is_frame, now_s))
        return self.link

    def hand_over(
        self,
        sign: Sign = SIGN,
        options: RunOptions = OPTIONS,
        flown: ModuleSetup | None = None,
    ) -> None:
        hand_over(flown or setup(), options, sign, "was killed")


@pytest.fixture
def scene(monkeypatch: pytest.MonkeyPatch) -> Scene:
    return Scene(monkeypatch)


def guided() -> ModuleSetup:
    return setup()._replace(
        flavour=flavour("ardupilot", "attitude", CHANNELS, 1), override=Source(1, 191)
    )


# --- the release ----------------------------------------------------------------------------------


def test_the_channels_are_released_a_few_times_and_then_it_is_reported(scene: Scene) -> None:
    scene.hand_over()
    *releases, words = scene.link.outbound()
    assert len(releases) == RELEASE_FRAMES
    for message in releases:
        assert (message.chan1_raw, message.chan2_raw, message.chan4_raw) == (0, 0, 0)
        assert (message.get_srcSystem(), message.get_srcComponent()) == (255, 191)
    assert (words.severity, words.text) == (
        mavlink.MAV_SEVERITY_CRITICAL,
        "surfaces released: module was killed",
    )
    assert (words.get_srcSystem(), words.get_srcComponent()) == (1, 191)
    assert scene.link.done == ["cleared", "received", "closed"]
    assert [each[0] for each in scene.opened] == ["tcp:first:1"]


def test_releases_are_apart_so_that_one_gap_of_the_link_does_not_take_them_all(
    scene: Scene,
) -> None:
    began_s = scene.link.now_s
    scene.hand_over()
    *releases_s, words_s = [at_s - began_s for at_s in scene.link.sent_s]
    assert releases_s == pytest.approx([0.0, 0.02, 0.04, 0.06, 0.08])
    assert words_s == pytest.approx(0.1)
    # The fastest of the autopilots' own loops takes up an override every 20 ms; none acts alone
    # before 0.5 s have passed, half of which a watchdog needs to notice.
    assert words_s < 0.25


def test_a_stream_is_released_until_a_cut_frame_has_ended_at_once(scene: Scene) -> None:
    scene.link.is_stream = True
    scene.hand_over()
    at_once = [
        len(frame)
        for frame, at_s in zip(scene.link.frames, scene.link.sent_s, strict=True)
        if at_s == scene.link.sent_s[0]
    ]
    assert sum(at_once[:-2]) >= WHOLE_FRAME  # one for certain behind it, and one of the row
    assert sum(at_once) < 2 * WHOLE_FRAME


def test_a_link_that_cannot_be_opened_is_reported_and_nothing_else(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise LinkError("there is no ttyUSB0")

    monkeypatch.setattr(watchdog_release, "open_link", refuse)
    scene.hand_over()
    assert scene.words == ["the watchdog cannot release the surfaces: there is no ttyUSB0"]
    assert not scene.link.frames


def test_whatever_happens_the_link_is_closed_for_the_next_process(scene: Scene) -> None:
    scene.link.fails = True
    with pytest.raises(ZeroDivisionError):
        scene.hand_over()
    assert scene.link.done[-1] == "closed"


def test_a_peer_of_mavlink_1_is_answered_in_it(scene: Scene) -> None:
    for version1, marker in ((False, 0xFD), (True, 0xFE)):
        scene.link.frames.clear()
        scene.link.done.clear()
        scene.hand_over(SIGN._replace(version1=version1))
        assert {frame[0] for frame in scene.link.frames} == {marker}


@pytest.mark.parametrize("host", ["127.0.0.1", ""])
def test_the_peer_of_a_link_that_listens_is_the_one_that_the_dead_process_had(
    scene: Scene, host: str
) -> None:
    listener: Any = UdpListener("udp:127.0.0.1:0", "127.0.0.1", 0, lambda _: True)
    now_s = scene.link.now_s
    scene.link, sent = listener, []
    listener.now_s = now_s
    listener.send = lambda data: sent.append((data, listener.peer))
    scene.hand_over(SIGN._replace(host=host, port=14550))
    assert {peer for _, peer in sent} == {(host, 14550) if host else None}


# --- signatures -----------------------------------------------------------------------------------


def stamps(link: Link) -> list[int]:
    return [int.from_bytes(frame[-12:-6], "little") for frame in link.frames]


def test_frames_are_signed_with_the_key_of_the_dead_process_a_second_after_its_last(
    scene: Scene,
) -> None:
    """It may have signed on for half a second after it showed its stamp, and its successor begins
    two seconds beyond."""
    scene.hand_over(SIGN._replace(key=KEY, timestamp=FAR_AHEAD))
    reader = mavlink.MAVLink(None)
    reader.signing.secret_key = KEY
    for frame in scene.link.frames:
        assert reader.decode(bytearray(frame)).get_signed()
    found = stamps(scene.link)
    assert len(set(found)) == len(found) > RELEASE_FRAMES  # none is accepted twice
    assert {frame[-13] for frame in scene.link.frames} == {0}  # the same stream of the first link
    assert 0.9 < (found[0] - FAR_AHEAD) / TICKS_PER_S < 1.1


def test_where_no_stamp_was_shown_they_are_signed_by_the_time_of_day(scene: Scene) -> None:
    scene.hand_over(SIGN._replace(key=KEY))
    seconds_2015 = 1420070400
    assert min(stamps(scene.link)) / TICKS_PER_S == pytest.approx(
        time.time() - seconds_2015, abs=60.0
    )


def beat(system: int) -> bytes:
    message = mavlink.MAVLink_heartbeat_message(1, 3, 81, FBWA, 4, 3)
    return bytes(message.pack(mavlink.MAVLink(None, system, 1)))


@pytest.mark.parametrize(
    ("link", "unsigned_autopilot", "system", "is_peer"),
    [
        ("tcp:first:1", True, 1, True),
        ("tcp:first:1", False, 1, False),
        ("tcp:first:1", True, 2, False),
        ("tcp:other:2", True, 1, False),
    ],
)
def test_only_the_autopilot_on_the_first_link_may_be_excused_from_signing(
    scene: Scene, link: str, unsigned_autopilot: bool, system: int, is_peer: bool
) -> None:
    signing: Any = SimpleNamespace(vouches=lambda _: False)
    options = OPTIONS._replace(secret=Secret(None, unsigned_autopilot))
    open_for(setup(), options, link, signing)
    ((name, is_frame, now_s),) = scene.opened
    assert (name, now_s) == (link, scene.link.now_s)
    assert is_frame(beat(system)) is is_peer


# --- the mode that the dead process has entered ---------------------------------------------------


def test_its_mode_is_left_after_the_surfaces_were_released(scene: Scene) -> None:
    scene.link.mode = GUIDED
    scene.hand_over(flown=guided())
    kinds = [m.get_type() for m in scene.link.outbound()]
    assert kinds[-2:] == ["HEARTBEAT", "COMMAND_LONG"]  # sent first, for a peer may be a new one
    (asked,) = scene.link.outbound("COMMAND_LONG")
    route = guided().flavour.route
    assert (asked.command, asked.param2) == (mavlink.MAV_CMD_DO_SET_MODE, route.mode_to_leave)
    assert scene.link.mode == route.mode_to_leave


def test_a_mode_that_the_pilot_has_chosen_stays(scene: Scene) -> None:
    scene.link.mode = FBWA
    scene.hand_over(flown=guided())
    assert not scene.link.outbound("COMMAND_LONG")


def test_a_route_without_a_mode_of_its_own_asks_and_waits_for_none(scene: Scene) -> None:
    scene.link.mode = GUIDED
    scene.hand_over()
    assert {m.get_type() for m in scene.link.outbound()} == {"RC_CHANNELS_OVERRIDE", "STATUSTEXT"}


def test_a_mode_that_is_not_left_is_reported(scene: Scene) -> None:
    scene.link.mode, scene.link.leaves = GUIDED, False
    scene.hand_over(flown=guided())
    words = scene.link.outbound("STATUSTEXT")
    assert "".join(m.text for m in words[1:]).startswith("the autopilot does not leave GUIDED")
    assert {m.severity for m in words} == {mavlink.MAV_SEVERITY_CRITICAL}


def test_an_autopilot_that_is_silent_is_waited_for_so_long_as_the_watchdog_may(
    scene: Scene,
) -> None:
    began_s = scene.link.now_s
    scene.hand_over(flown=guided())
    assert not scene.link.outbound("COMMAND_LONG")
    assert scene.link.now_s - began_s == pytest.approx(PATIENCE_S + 0.1, abs=0.05)
    assert PATIENCE_S < ENDING_S


@pytest.mark.parametrize("what", ["another system", "another component", "another firmware"])
def test_a_heartbeat_of_another_asks_for_nothing(scene: Scene, what: str) -> None:
    scene.link.mode, scene.link.leaves = GUIDED, False
    if what == "another system":
        scene.link.vehicle = mavlink.MAVLink(None, 2, 1)
    if what == "another component":
        scene.link.vehicle = mavlink.MAVLink(None, 1, 2)
    if what == "another firmware":
        scene.link.kind = (mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_PX4)
    scene.hand_over(flown=guided())
    assert not scene.link.outbound("COMMAND_LONG")


@pytest.mark.parametrize("excused", [True, False])
def test_with_a_key_an_unsigned_autopilot_counts_if_that_was_asked_for(
    scene: Scene, excused: bool
) -> None:
    scene.link.mode = GUIDED
    options = OPTIONS._replace(secret=Secret(None, excused))
    scene.hand_over(SIGN._replace(key=KEY), options, guided())
    assert bool(scene.link.outbound("COMMAND_LONG")) is excused
