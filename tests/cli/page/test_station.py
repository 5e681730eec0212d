"""What the page's ground station makes of telemetry, good and bad."""

from __future__ import annotations

from math import inf, nan
from random import Random
from socket import AF_INET, SOCK_DGRAM, socket
from time import time
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from free_ports import free_port
from page_flight import AIRFRAME, SITE, Flown
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.cli.page.browser_requests import Look
from tgl_soar.cli.page.command import live_desk
from tgl_soar.cli.page.desk import Desk
from tgl_soar.cli.page.scene import place_of
from tgl_soar.cli.page.station import ROW, Station, number, without_others
from tgl_soar.config.files import load_airframe, load_parameters, load_site
from tgl_soar.config.parameters import PARAMETERS
from tgl_soar.link.messages import PARAM_TYPE_REAL32
from tgl_soar.link.open_link import LinkCounters
from tgl_soar.onboard.telemetry_values import ARRAY, ARRAY_NAME, FAST, SLOW

KEY = bytes(range(32))


def station(key: bytes | None = None) -> Station:
    return Station(1, 191, 253, key, 1.8e9)


def module(key: bytes | None = None, component: int = 191) -> Any:
    codec: Any = mavlink.MAVLink(None, 1, component)
    if key is not None:
        codec.signing.secret_key, codec.signing.sign_outgoing = key, True
        codec.signing.timestamp = int((1.8e9 - 1_420_070_400.0) * 1e5)
    return codec


def receive(listener: Station, sender: Any, *messages: Any, now_s: float = 10.0) -> None:
    for message in messages:
        listener.receive(bytes(message.pack(sender)), now_s, 1.8e9)
        sender.seq = (sender.seq + 1) % 256


def named(name: str, value: float) -> Any:
    return mavlink.MAVLink_named_value_float_message(0, name.encode(), value)


def beat(start: int, mode: int) -> Any:
    return mavlink.MAVLink_heartbeat_message(18, 8, 0, start << 8 | mode, 4, 3)


def test_it_learns_all_that_the_module_tells_and_every_parameter() -> None:
    listener, flown = station(), Flown()
    for slice_ in range(60):
        for data in flown.run(0.1):
            listener.receive(without_others(data), slice_ * 0.1, 1.8e9)
        listener.step(slice_ * 0.1)
        for frame in listener.take_datagrams():
            flown.receive(frame)
    assert set(listener.now) >= {*FAST, *SLOW, *set(ROW[1:]), "roll", "armed"}
    assert listener.missing == []
    assert listener.parameters["TGL_Z"] == flown.value("TGL_Z")
    assert len(listener.now) < len(ARRAY) + len(FAST) + len(SLOW)
    assert any(text.text.startswith("ready") for text in listener.texts)
    assert listener.rows[-1][ROW.index("soar_mode")] == 2.0


def test_a_lost_parameter_is_asked_for_again() -> None:
    listener, flown = station(), Flown()
    lost = "CLEAR_MIN"

    def without_it(data: bytes) -> bytes:
        return b"" if lost.encode() in data else data

    flown.altered = without_it
    for slice_ in range(100):
        for data in flown.run(0.1):
            listener.receive(data, slice_ * 0.1, 1.8e9)
        listener.step(slice_ * 0.1)
        for frame in listener.take_datagrams():
            flown.receive(frame)
        if slice_ == 40:
            assert listener.missing == [lost]
            flown.altered = bytes
    assert listener.missing == []


def test_a_text_in_pieces_is_one_text_and_markup_is_text() -> None:
    listener, sender = station(), module()
    text = "<img src=x onerror=alert(1)>" + "x" * 40
    pieces = [text[:50], text[50:]]
    receive(
        listener,
        sender,
        *(mavlink.MAVLink_statustext_message(4, p.encode(), 7, i) for i, p in enumerate(pieces)),
    )
    (shown,) = listener.texts
    assert shown.text == text
    assert (shown.severity, shown.source, shown.first) == (4, "module", 1)


def test_a_piece_whose_text_has_lost_one_is_put_behind_no_other() -> None:
    listener, sender = station(), module()

    def text(words: bytes, number: int = 0, piece: int = 0) -> Any:
        return mavlink.MAVLink_statustext_message(4, words, number, piece)

    receive(listener, sender, text(b"ready: can be engaged"), text(b" is outside the fence", 9, 1))
    receive(listener, sender, text(b"one ", 10), text(b"three", 10, 2), text(b" four", 10, 3))
    receive(listener, sender, text(b"other ", 11), text(b"no part of it", 12, 1))
    shown = [each.text for each in listener.texts]
    assert shown[:2] == ["ready: can be engaged", " is outside the fence"]
    assert shown[2:] == ["one ", "three four", "other ", "no part of it"]


def test_control_characters_and_endless_texts_are_cut() -> None:
    listener, sender = station(), module()
    receive(listener, sender, mavlink.MAVLink_statustext_message(4, b"a\x1b[31m\nb", 0, 0))
    assert listener.texts[-1].text == "a?[31m?b"
    for i in range(100):
        receive(listener, sender, mavlink.MAVLink_statustext_message(4, b"y" * 50, 3, i))
    assert len(listener.texts[-1].text) == 250
    assert len(listener.texts) == 2


def test_numbers_that_are_none_are_not_known() -> None:
    listener, sender = station(), module()
    receive(
        listener, sender, named("e_rho", nan), named("soar_x", float("inf")), named("climb", 1.5)
    )
    assert number(listener.now["e_rho"]) is None
    assert number(listener.now["soar_x"]) is None
    assert number(listener.now["climb"]) == 1.5
    listener.step(10.0)
    row = dict(zip(ROW, listener.rows[-1], strict=True))
    assert (row["e_rho"], row["climb"]) == (None, 1.5)


def test_other_names_components_and_systems_are_not_shown() -> None:
    listener = station()
    receive(listener, module(), named("no_such", 1.0))
    receive(listener, module(component=1), named("e_rho", 1.0))
    receive(listener, mavlink.MAVLink(None, 2, 191), named("e_rho", 1.0))
    assert listener.now == {}


def test_a_module_that_was_started_again_is_asked_for_everything_again() -> None:
    listener, sender = station(), module()
    receive(listener, sender, beat(5, 4), named("e_rho", 1.0))
    value = mavlink.MAVLink_param_value_message(b"TGL_Z", 1.5, PARAM_TYPE_REAL32, 91, 0)
    receive(listener, sender, value)
    listener.take_datagrams()
    receive(listener, sender, beat(6, 1))
    assert listener.starts == 1
    assert listener.parameters == {}
    assert "e_rho" not in listener.now
    (asked,) = listener.take_datagrams()
    assert mavlink.MAVLink(None).decode(bytearray(asked)).get_type() == "PARAM_REQUEST_LIST"


def test_a_silent_module_leaves_gaps_in_the_strips() -> None:
    listener, sender = station(), module()
    receive(listener, sender, named("e_rho", 1.0), now_s=10.0)
    listener.step(10.1)
    listener.step(13.0)
    at = ROW.index("e_rho")
    assert [row[at] for row in listener.rows] == [1.0, None]
    assert not listener.is_alive(13.0)


def test_with_a_key_it_signs_and_takes_only_what_is_signed() -> None:
    listener = station(KEY)
    receive(listener, module(), named("e_rho", 1.0))
    receive(listener, module(bytes(32)), named("e_rho", 2.0))
    assert listener.now == {}
    receive(listener, module(KEY), named("e_rho", 3.0))
    assert listener.now["e_rho"] == 3.0
    listener.command(mavlink.MAV_CMD_USER_1, 0)
    (frame,) = listener.take_datagrams()
    assert frame[2] & 1  # signed


def signed_beat(sender: Any) -> bytes:
    sender.seq = (sender.seq + 1) % 256
    return bytes(beat(5, 4).pack(sender))


def test_with_a_key_only_who_signs_is_answered_and_no_record_of_it() -> None:
    listener = station(KEY)
    frames = [signed_beat(module()), signed_beat(module(bytes(31) + b"x")), b"", b"\xfd" * 30]
    assert not any(map(listener.vouches, frames))
    sender = module(KEY)
    first, second = signed_beat(sender), signed_beat(sender)
    assert listener.vouches(first)
    assert listener.vouches(first)  # to ask changes nothing
    listener.receive(first, 10.0, 1.8e9)
    assert not listener.vouches(first)
    assert listener.vouches(second)
    behind = module(KEY)  # its clock was never set
    behind.signing.timestamp = 1
    assert station(KEY).vouches(signed_beat(behind))
    assert station().vouches(frames[0])
    assert not station().vouches(b"no frame")


def test_a_stranger_without_the_key_takes_no_link_of_the_page() -> None:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    port = free_port()
    link = f"udp:127.0.0.1:{port}"
    desk = live_desk(airframe, AIRFRAME, site, SITE, link, KEY, 253, maps=False)
    with socket(AF_INET, SOCK_DGRAM) as stranger, socket(AF_INET, SOCK_DGRAM) as friend:
        for sender in (stranger, friend):
            sender.bind(("127.0.0.1", 0))
        stranger.sendto(signed_beat(module()), ("127.0.0.1", port))
        desk.turn(10.0)
        opened: Any = desk.link
        assert opened.peer is None
        now = module(KEY)
        now.signing.timestamp = int((time() - 1_420_070_400.0) * 1e5)
        friend.sendto(signed_beat(now), ("127.0.0.1", port))
        desk.turn(10.1)
        assert opened.peer == friend.getsockname()
        assert desk.station is not None
        assert desk.station.now["soar_mode"] == 4.0
    desk.close()


def test_frames_that_no_page_shows_are_left_out_and_garbage_is_not_lost() -> None:
    sender = module()
    shown = bytes(named("e_rho", 1.0).pack(sender))
    other = bytes(mavlink.MAVLink_raw_imu_message(0, 1, 2, 3, 4, 5, 6, 7, 8, 9).pack(sender))
    assert without_others(other + shown + other) == shown
    assert without_others(other + b"\x01\x02" + shown) == b"\x01\x02" + shown
    assert without_others(shown[:5]) == shown[:5]
    assert without_others(b"") == b""


# --- a hostile link ---------------------------------------------------------------------------


class Wire:
    """A link that gives what was put on it, and loses what is sent."""

    name, is_stream, generation = "hostile", False, 0

    def __init__(self) -> None:
        self.counters = LinkCounters()
        self.waiting: list[bytes] = []

    def fileno(self) -> int:
        return -1

    def receive(self, _now_s: float, _most: int = 0) -> list[bytes]:
        received, self.waiting = self.waiting, []
        return received

    def send(self, _data: bytes) -> bool:
        return True

    send_command = send

    def hold(self, now_s: float) -> None: ...

    def clear_for_release(self) -> bool:
        return False

    def close(self) -> None: ...


NAMES = [p.name.encode() for p in PARAMETERS]
NUMBERS = (nan, inf, -inf, 0.0, 1e38, -1e38, 1e-42, 4.0, 3.0, 1.3)


def hostile_frame(random: Random) -> bytes:
    """What the page reads, with arbitrary numbers and letters; sometimes broken."""
    several = [random.choice(NUMBERS) for _ in range(58)]
    letters = random.randbytes(16)
    name = random.choice([*FAST, *SLOW]).encode()
    message: Any = random.choice(
        [
            mavlink.MAVLink_named_value_float_message(0, name, several[0]),
            mavlink.MAVLink_named_value_float_message(0, letters[:10], several[0]),
            mavlink.MAVLink_debug_float_array_message(
                random.getrandbits(64), ARRAY_NAME.encode(), 191, several
            ),
            mavlink.MAVLink_heartbeat_message(18, 8, 0, random.choice([0x104, 0x2FF, 3]), 4, 3),
            mavlink.MAVLink_param_value_message(random.choice(NAMES), several[0], 9, 99, 0),
            mavlink.MAVLink_param_value_message(letters, several[0], 9, 99, 0),
            mavlink.MAVLink_statustext_message(letters[0], letters, letters[1] % 3, letters[2]),
            mavlink.MAVLink_command_ack_message(31010 + letters[0] % 3, letters[1], 0, 0, 253, 0),
            mavlink.MAVLink_attitude_message(0, *several[:6]),
            mavlink.MAVLink_sys_status_message(0, 0, 0, 0, letters[0] << 8, 0, -1, *[0] * 6),
        ]
    )
    frame = bytearray(message.pack(module(component=random.choice([191, 191, 1, 7]))))
    if random.random() < 0.2:
        frame[random.randrange(len(frame))] ^= 1 << random.randrange(8)
    return bytes(frame) if random.random() < 0.9 else random.randbytes(random.randrange(300))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("seed", range(3))
def test_whatever_comes_by_the_link_the_page_is_reported_in_json(seed: int) -> None:
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    place = place_of(airframe, site, load_parameters(airframe, AIRFRAME, site, SITE), SITE.parent)
    wire, random = Wire(), Random(seed)
    desk = Desk(place, station(), wire, None)
    viewer: Any = SimpleNamespace(number=1, name="<b>Anna")
    for i in range(400):
        now_s = 100.0 + 0.05 * i
        wire.waiting = [hostile_frame(random) for _ in range(6)]
        desk.turn(now_s)
        if i % 20 == 0:
            desk.take(viewer, Look(token="", x=0.6, z=1.6, lean=15.0), now_s)
        desk.show(now_s)
        frame = msgspec.json.decode(msgspec.json.encode(desk._whole_of(now_s)()))
        numbers = frame["now"].values()
        assert all(value is None or isinstance(value, int | float) for value in numbers)
        assert all(text["text"].isprintable() for text in frame["texts"])
    assert len(frame["now"]) <= len({*FAST, *SLOW, *ARRAY}) + 5
    assert set(frame["parameters"]) <= {p.name for p in PARAMETERS}
