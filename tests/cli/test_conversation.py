"""A command's messages with the autopilot over a scripted link: what goes out when and by
which identity, which messages are accepted, and that the link is closed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from tgl_soar.cli import conversation as module
from tgl_soar.cli.conversation import Conversation
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.link.decoder import Decoder
from tgl_soar.link.encoder import Encoder
from tgl_soar.link.messages import Heartbeat, Outbound, Received, Source
from tgl_soar.onboard.setup import flavour_of

AIRFRAME = load_airframe(shipped("airframes/eclipson_c.toml"))
SYSTEM = AIRFRAME.autopilot.system_id
MODULE = Source(SYSTEM, AIRFRAME.autopilot.component_id)
AUTOPILOT = Source(SYSTEM, 1)
ALIVE = Heartbeat(type=1, autopilot=3, base_mode=0, custom_mode=0, system_status=4)
OTHER = ALIVE._replace(custom_mode=7)


class Line:
    """A link on which a test sends and receives."""

    name, is_stream = "line", False

    def __init__(self) -> None:
        self.coming: list[bytes] = []
        self.sent: list[bytes] = []
        self.held_s: list[float] = []
        self.open = True

    def fileno(self) -> int:
        return -1

    def receive(self, _now_s: float) -> list[bytes]:
        came, self.coming = self.coming, []
        return came

    def hold(self, now_s: float) -> None:
        self.held_s.append(now_s)

    def send(self, data: bytes) -> bool:
        self.sent.append(data)
        return True

    def close(self) -> None:
        self.open = False

    def messages(self) -> list[Received]:
        """What has been sent since the last time."""
        decoder = Decoder(stream=True)
        sent, self.sent = self.sent, []
        return [received for data in sent for received in decoder.feed(data)]


class Clock:
    """Stands until it is put on; there is no real waiting."""

    def __init__(self, now_s: float) -> None:
        self.now_s = now_s

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def line(monkeypatch: pytest.MonkeyPatch) -> Line:
    made = Line()
    asked: list[str] = []

    def opened(name: str, _is_peer: Any, _now_s: float) -> Line:
        asked.append(name)
        return made

    monkeypatch.setattr(module, "open_link", opened)
    assert module.LOOK_S == 0.02
    monkeypatch.setattr(module, "LOOK_S", 0.0)
    return made


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    made = Clock(100.0)
    monkeypatch.setattr(module, "time", made)
    return made


def talk(airframe: Airframe = AIRFRAME, key: Path | None = None) -> Conversation:
    return Conversation("udp:somewhere", airframe, flavour_of(airframe), key)


@pytest.fixture
def talking(line: Line, clock: Clock) -> Iterator[Conversation]:
    assert line.open
    assert clock.now_s == 100.0
    with talk() as talking:
        yield talking


def kinds(messages: list[Received]) -> list[tuple[Source, str]]:
    return [(received.source, type(received.message).__name__) for received in messages]


def test_a_heartbeat_goes_out_at_once_and_once_a_second_and_what_belongs_to_it(
    talking: Conversation, line: Line, clock: Clock
) -> None:
    beside: tuple[Outbound, ...] = (OTHER,)
    for now_s, count in ((100.0, 2), (100.5, 0), (100.99, 0), (101.0, 2), (101.5, 0), (103.0, 2)):
        clock.now_s = now_s
        assert talking.turn(beside) == []
        messages = line.messages()
        assert kinds(messages) == [(MODULE, "Heartbeat")] * count, now_s
    talking.turn()
    assert line.messages() == []
    clock.now_s = 104.0
    talking.turn()
    ((_, beat),) = line.messages()
    # An onboard controller, no autopilot, active: of MAVLink's own numbers.
    assert beat == Heartbeat(type=18, autopilot=8, base_mode=0, custom_mode=0, system_status=4)


def test_the_autopilot_is_received_and_nobody_else(talking: Conversation, line: Line) -> None:
    assert talking.autopilot == AUTOPILOT
    others = (Source(SYSTEM, 2), Source(SYSTEM + 1, 1), MODULE, Source(255, 190))
    line.coming = [Encoder(source).encode(OTHER) for source in others]
    line.coming.insert(2, Encoder(AUTOPILOT).encode(ALIVE))
    (message,) = talking.turn()
    assert isinstance(message, Heartbeat)
    assert (message.autopilot, message.custom_mode) == (3, 0)
    assert talking.turn() == []


def test_whoever_is_understood_keeps_the_peers_place(
    talking: Conversation, line: Line, clock: Clock
) -> None:
    line.coming = [b"nothing", Encoder(AUTOPILOT).encode(ALIVE)]
    clock.now_s = 100.25
    talking.turn()
    assert line.held_s == [100.25]


@pytest.mark.parametrize(("version1", "magic"), [(True, 0xFE), (False, 0xFD)])
def test_the_autopilot_is_answered_in_its_own_version(
    version1: bool, magic: int, talking: Conversation, line: Line
) -> None:
    speaker = Encoder(AUTOPILOT)
    speaker.version1 = version1
    line.coming = [speaker.encode(ALIVE)]
    talking.turn()
    line.sent.clear()
    talking.say(ALIVE)
    talking.command(ALIVE)
    assert [frame[0] for frame in line.sent] == [magic] * 2


@pytest.mark.parametrize(("route", "commands_as"), [("override", 252), ("attitude", 7)])
def test_it_speaks_as_the_module_and_commands_as_whom_the_route_obeys(
    route: str, commands_as: int, line: Line
) -> None:
    """An ArduPlane whose channels are overridden obeys its operator's identity alone."""
    link = replace(
        AIRFRAME.autopilot,
        firmware="ardupilot",
        route=route,
        system_id=7,
        component_id=99,
        override_system_id=252,
    )
    with talk(replace(AIRFRAME, autopilot=link)) as talking:
        talking.say(ALIVE)
        talking.command(OTHER)
        assert line.open
    assert not line.open
    beat, commanded = line.messages()
    assert beat.source == Source(7, 99)
    assert commanded.source == Source(commands_as, 99)
    assert [received.message.custom_mode for received in (beat, commanded)] == [0, 7]


def test_with_a_key_what_goes_out_is_signed(line: Line, tmp_path: Path) -> None:
    key = tmp_path / "key"
    key.write_bytes(bytes(range(32)))
    key.chmod(0o600)
    for path, flag in ((None, 0), (key, 1)):
        with talk(key=path) as talking:
            talking.say(ALIVE)
        (frame,) = line.sent
        assert (frame[0], frame[2] & 1) == (0xFD, flag)
        assert frame[-13] == 0 or path is None  # the link's number, in the signature
        line.sent.clear()


def test_what_is_waited_on_is_the_links_own_file_where_it_has_one(
    line: Line, clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    waited: list[tuple[list[int], float]] = []

    def select(reading: list[int], _w: list[int], _x: list[int], seconds: float) -> None:
        waited.append((reading, seconds))

    monkeypatch.setattr("tgl_soar.cli.conversation.select.select", select)
    assert clock.now_s == 100.0
    with talk() as talking:
        for number in (-1, 0, 5):
            monkeypatch.setattr(line, "fileno", lambda number=number: number)
            talking.turn()
    assert waited == [([], 0.0), ([0], 0.0), ([5], 0.0)]
