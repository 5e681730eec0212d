"""What goes out on which link, what is counted, and what it costs of the telemetry's bytes."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.messages import (
    ID_DEBUG_FLOAT_ARRAY,
    SEVERITY_INFO,
    SEVERITY_WARNING,
    DebugFloatArray,
    NamedValueFloat,
    Outbound,
    RcChannelsOverride,
    Source,
    StatusText,
)
from tgl_soar.link.routing import Route
from tgl_soar.link.signing import Signing
from tgl_soar.link.telemetry import Flow, Telemetry
from tgl_soar.onboard.counters import Counters
from tgl_soar.onboard.flightlog.recorder import Recorder
from tgl_soar.onboard.outbox import Outbox, frame_of

pytestmark = pytest.mark.interpreted  # it stands in for parts of what flies

OWN, OVERRIDE, AUTOPILOT, STATION = (
    Source(1, 191), Source(255, 191), Source(1, 1), Source(255, 190),
)  # fmt: skip
WORDS = StatusText(SEVERITY_INFO, "word")
OVERRIDES = RcChannelsOverride(1, 1, (1500,) * 18)
UNSENDABLE = RcChannelsOverride(1, 1, (-1,) * 18)  # no pulse has such a width
T_S = 10.0


class Kept(Recorder):
    """A log."""

    def __init__(self) -> None:
        self.frames: list[bytes] = []
        self.words: list[tuple[int, str]] = []

    def outbound(self, frame: bytes) -> None:
        self.frames.append(frame)

    def text(self, severity: int, text: str) -> None:
        self.words.append((severity, text))


class Scene:
    """An outbox with some links, all of them greeted."""

    def __init__(self, links: int = 2, *, flows: tuple[Flow, ...] = ()) -> None:
        self.sent: list[tuple[int, bytes]] = []
        self.commands: list[bytes] = []
        self.takes = True
        self.console: list[str] = []
        self.log, self.counters, self.telemetry = Kept(), Counters(), Telemetry(flows)
        self.outbox = Outbox(self.counters, self.log, self.telemetry, self.console.append)
        self.outbox.telemetry_bytes_per_s = 1000.0
        for number in range(links):
            self.outbox.routes.append(self._route(number))

    def _route(self, number: int) -> Route:
        def send(frame: bytes) -> bool:
            self.sent.append((number, frame))
            return self.takes

        def send_command(frame: bytes) -> bool:
            self.commands.append(frame)
            return self.takes

        signing = Signing(None, 0.0, 0.0)
        route = Route(number, OWN, OVERRIDE, send, signing, stream=False, send_command=send_command)
        route.greeted = True
        return route

    def spent(self) -> int:
        return self.telemetry.budget.spent_bytes

    def messages(self) -> list[tuple[int, Any]]:
        """What was sent since the last call, with the number of its link."""
        sent, self.sent[:] = self.sent[:], []
        reader = mavlink.MAVLink(None)
        return [(number, reader.decode(bytearray(frame))) for number, frame in sent]


# --- messages -------------------------------------------------------------------------------------


def test_a_message_goes_out_on_all_links_in_our_name_or_on_the_one_it_is_for() -> None:
    scene = Scene()
    size = scene.outbox.say(WORDS)
    assert [number for number, _ in scene.sent] == [0, 1]
    assert {(m.get_srcSystem(), m.get_srcComponent()) for _, m in scene.messages()} == {OWN}
    assert size == len(scene.log.frames[0])
    scene.outbox.say(WORDS, scene.outbox.routes[1])
    assert [number for number, _ in scene.sent] == [1]
    assert scene.outbox.autopilot is scene.outbox.routes[0]


def test_what_it_takes_is_what_the_link_with_most_of_it_carries() -> None:
    """MAVLink 1 has a shorter header, and no extensions."""
    scene = Scene()
    for first, other in ((True, False), (False, True)):
        scene.outbox.routes[0].own.version1 = first
        scene.outbox.routes[1].own.version1 = other
        size = scene.outbox.say(WORDS)
        sizes = [len(frame) for _, frame in scene.sent[-2:]]
        assert size == max(sizes) > min(sizes)


def test_several_messages_keep_their_order() -> None:
    scene = Scene(1)
    texts = [StatusText(SEVERITY_INFO, text) for text in ("a", "b", "c")]
    scene.outbox.say_all(texts)
    assert [m.text for _, m in scene.messages()] == ["a", "b", "c"]


def test_an_answer_goes_where_its_requester_was_received() -> None:
    scene = Scene(3)
    for number in (1, 2):
        scene.outbox.routes[number].received(STATION)
    scene.outbox.routes[0].received(AUTOPILOT)
    scene.outbox.say_to(STATION, WORDS)
    assert [number for number, _ in scene.messages()] == [1, 2]


def test_before_our_heartbeat_nothing_is_reported_on_a_link() -> None:
    scene = Scene()
    scene.outbox.routes[0].greeted = False
    assert scene.outbox.say(WORDS, scene.outbox.routes[0]) == 0
    scene.outbox.say(WORDS)
    assert [number for number, _ in scene.messages()] == [1]
    scene.outbox.command((OVERRIDES,))
    assert scene.outbox.hand_over((OVERRIDES,)) == 0
    assert (scene.commands, scene.sent) == ([], [])
    assert (scene.counters.unsent, scene.counters.unsendable) == (0, 0)


def test_what_a_link_does_not_take_is_counted_and_in_the_log() -> None:
    scene = Scene()
    scene.takes = False
    size = scene.outbox.say(WORDS)
    assert size > 0
    assert (scene.counters.unsent, scene.counters.left_out) == (2, 0)
    assert len(scene.log.frames) == 2


def test_a_message_that_cannot_be_packed_is_counted_and_costs_nothing_else() -> None:
    scene = Scene()
    assert scene.outbox.say(UNSENDABLE, scene.outbox.routes[0]) == 0
    assert scene.counters.unsendable == 1
    scene.outbox.command((UNSENDABLE, OVERRIDES))
    assert scene.counters.unsendable == 2
    assert len(scene.commands) == 1
    assert frame_of(UNSENDABLE, scene.outbox.routes[0].own) is None
    assert scene.counters.unsent == 0


def test_what_mavlink_1_has_no_message_for_is_not_sent_and_no_mistake() -> None:
    scene = Scene(1)
    route = scene.outbox.autopilot
    route.own.version1 = route.override.version1 = True
    wide = mavlink_2_only()
    assert scene.outbox.say(wide) == 0
    assert (scene.sent, scene.log.frames) == ([], [])
    assert (scene.counters.unsent, scene.counters.unsendable) == (0, 0)
    scene.outbox.command((wide,))
    assert (scene.commands, scene.counters.unsent) == ([], 0)


def mavlink_2_only() -> Outbound:
    """Its number is beyond the one byte that MAVLink 1 has for it."""
    assert ID_DEBUG_FLOAT_ARRAY > 255
    return DebugFloatArray(0, "name", 1, (0.0,) * 58)


# --- words ----------------------------------------------------------------------------------------


def test_words_are_reported_on_all_links_on_the_console_and_in_the_log() -> None:
    scene = Scene()
    scene.outbox.tell(SEVERITY_WARNING, "no place to settle")
    assert scene.console == ["no place to settle"]
    assert scene.log.words == [(SEVERITY_WARNING, "no place to settle")]
    sent = [(number, m.severity, m.text) for number, m in scene.messages()]
    assert sent == [(n, SEVERITY_WARNING, "no place to settle") for n in (0, 1)]


def test_words_that_a_part_has_left_are_reported_once() -> None:
    scene = Scene(1)
    notices = [(SEVERITY_INFO, "one"), (SEVERITY_WARNING, "two")]
    scene.outbox.tell_all(notices)
    assert scene.console == ["one", "two"]
    assert notices == []


def test_words_over_the_link_alone_are_neither_on_the_console_nor_among_the_logs_words() -> None:
    scene = Scene()
    scene.outbox.say_words(SEVERITY_INFO, "w" * 60, scene.outbox.routes[1])
    assert (scene.console, scene.log.words) == ([], [])
    pieces = scene.messages()
    assert "".join(m.text for _, m in pieces) == "w" * 60  # 50 characters go into a message
    assert {number for number, _ in pieces} == {1}


def test_who_asked_for_no_words_gets_none() -> None:
    outbox = Outbox(Counters(), Kept(), Telemetry(()), None)
    outbox.tell(SEVERITY_INFO, "word")


def test_words_and_metered_messages_are_paid_for_by_the_telemetry_and_others_are_not() -> None:
    scene = Scene()
    scene.outbox.say(WORDS)
    assert scene.spent() == 0
    scene.outbox.say_words(SEVERITY_INFO, "word")
    assert scene.spent() == len(scene.sent[-1][1])
    before = scene.spent()
    size = scene.outbox.say_metered(WORDS, scene.outbox.routes[0])
    assert size == len(scene.sent[-1][1])
    assert scene.spent() - before == size


# --- telemetry ------------------------------------------------------------------------------------


def numbers() -> tuple[Flow, ...]:
    build = lambda _turn: NamedValueFloat(1, "climb", 0.5)  # noqa: E731
    return (Flow(mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT, 1, 0.1, build),)


def send(scene: Scene, *, sheds: bool) -> int:
    """Telemetry of one second at 200 Hz; how many messages that were."""
    before = len(scene.sent)
    for k in range(200):
        scene.outbox.send_telemetry(T_S + 0.005 * k, sheds=sheds)
    return len(scene.sent) - before


def test_numbers_go_out_when_they_are_due_and_are_paid_for() -> None:
    scene = Scene(1, flows=numbers())
    sent = send(scene, sheds=False)
    assert sent == pytest.approx(10, abs=1)
    assert scene.spent() == sum(len(frame) for _, frame in scene.sent)
    assert scene.counters.telemetry_shed == 0


def test_numbers_that_are_due_while_there_is_no_time_are_counted_and_not_sent() -> None:
    scene = Scene(1, flows=numbers())
    assert send(scene, sheds=True) == 0
    assert scene.counters.telemetry_shed == pytest.approx(10, abs=1)
    assert scene.spent() == 0


def test_an_outbox_has_no_bytes_for_numbers_before_it_is_set_how_many() -> None:
    scene = Scene(1, flows=numbers())
    assert Outbox(Counters(), Kept(), Telemetry(()), None).telemetry_bytes_per_s == 0.0
    scene.outbox.telemetry_bytes_per_s = 0.0
    assert send(scene, sheds=False) == 0


# --- surfaces -------------------------------------------------------------------------------------


def test_commands_go_to_the_autopilot_at_once_in_the_name_that_it_obeys() -> None:
    scene = Scene()
    scene.outbox.command((OVERRIDES, OVERRIDES))
    assert scene.sent == []
    reader = mavlink.MAVLink(None)
    found = [reader.decode(bytearray(frame)) for frame in scene.commands]
    assert [(m.get_srcSystem(), m.get_seq()) for m in found] == [(255, 0), (255, 1)]
    assert scene.log.frames == scene.commands
    assert scene.counters.unsent == 0


def test_a_command_that_does_not_go_at_once_is_left_out_and_counted_and_in_no_log() -> None:
    scene = Scene()
    scene.takes = False
    scene.outbox.command((OVERRIDES,))
    assert (scene.counters.unsent, scene.counters.left_out) == (1, 1)
    assert scene.log.frames == []


def test_a_release_is_never_left_out() -> None:
    scene = Scene()
    size = scene.outbox.hand_over((OVERRIDES, OVERRIDES))
    assert scene.commands == []
    assert [number for number, _ in scene.sent] == [0, 0]
    assert size == sum(len(frame) for _, frame in scene.sent)
    assert {m.get_srcSystem() for _, m in scene.messages()} == {OVERRIDE.system}
    assert scene.outbox.hand_over(()) == 0
