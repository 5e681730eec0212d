"""How much work any bytes can make: counted, not timed."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link import decoder, frames
from tgl_soar.link.decoder import FALSE_TRIES_MAX, MESSAGE_TRIES, Decoder

LONGEST = 280  # bytes of a frame
GOOD = bytes(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(mavlink.MAVLink(None, 9, 9)))
# Each sixth byte begins a frame of an unknown number, all others one of a known number with a wrong
# checksum; a good frame inside refutes each unknown one only when all places before it were tried.
UNKNOWN = b"\xfe\xfe\xfe\xfe\xfe\x03" * 43 + GOOD
FALSE = {
    "unknown": UNKNOWN,
    "markers": b"\xfd",
    "markers of version 1": b"\xfe",
    "short": b"\xfd\x00\x00",
    "both": b"\xfe\x03\xfd",
    "one marker and no other": b"\xfe" + b"\x00" * 7,
}


def set_frame(i: int) -> bytes:
    message = mavlink.MAVLink_param_set_message(1, 191, b"TGL_X", float(i), 9)
    return bytes(message.pack(mavlink.MAVLink(None, 255, 190)))


@pytest.fixture
def looked_at(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The length of everything whose checksum is counted or that is searched for a marker."""
    lengths: list[int] = []
    count, search = frames.checksum, decoder._next_marker

    def counted(data: bytes, initial: int = 0xFFFF) -> int:
        lengths.append(len(data))
        return count(data, initial)

    def searched(data: bytes, at: int, to: int = 1 << 30) -> object:
        found = search(data, at, to)
        lengths.append((min(to, len(data)) if found is None else found.end()) - at)
        return found

    monkeypatch.setattr(frames, "checksum", counted)
    monkeypatch.setattr(decoder, "checksum", counted)
    monkeypatch.setattr(decoder, "_next_marker", searched)
    return lengths


@pytest.mark.interpreted
@pytest.mark.parametrize("pattern", FALSE.values(), ids=FALSE)
@pytest.mark.parametrize("stream", [False, True])
def test_no_bytes_make_more_work_than_so_much_each(
    pattern: bytes, stream: bool, looked_at: list[int]
) -> None:
    """Twice the longest frame, at each byte: a try by itself and one inside an unknown frame."""
    for size in (1000, 4000, 16000):
        looked_at.clear()
        Decoder(stream=stream).feed((pattern * size)[:size])
        assert len(looked_at) <= 4 * size
        assert sum(looked_at) <= 2 * (LONGEST + 2) * size


@pytest.mark.interpreted
def test_an_unknown_frame_that_a_good_one_refutes_is_looked_through_once(
    looked_at: list[int],
) -> None:
    counts = []
    for size in (1000, 2000, 4000):
        looked_at.clear()
        Decoder(stream=False).feed((UNKNOWN * size)[:size])
        counts.append(len(looked_at))
    assert counts[2] < 2.2 * counts[1] < 2.2 * 2.2 * counts[0]


@pytest.mark.parametrize("pattern", [UNKNOWN, *FALSE.values(), GOOD, set_frame(1)])
@pytest.mark.parametrize("stream", [False, True])
def test_a_call_does_no_more_than_it_may_and_the_rest_waits(pattern: bytes, stream: bool) -> None:
    decoder, most = Decoder(stream=stream), 20
    data, calls = (pattern * 2000)[:2000], 0
    while data or decoder.is_waiting:
        decoder.feed(data, most)
        data = b""
        calls += 1
        assert decoder.tries <= most + MESSAGE_TRIES + FALSE_TRIES_MAX
        assert calls <= 2000
    assert calls > 1


def test_what_waits_is_lost_to_nobody() -> None:
    """In pieces as in one: the same messages, in the same order."""
    frames = [set_frame(i) for i in range(50)]
    data = b"".join(frame + bytes((0xFD, i)) for i, frame in enumerate(frames))
    feeds: tuple[Callable[[Decoder], int], ...] = (lambda _: 1, lambda d: 7 + d.tries)
    whole = Decoder(stream=False).feed(data)
    assert len(whole) == 50
    for most in feeds:
        decoder = Decoder(stream=False)
        found = decoder.feed(data, 1)
        while decoder.is_waiting:
            found += decoder.feed(b"", most(decoder))
        assert found == whole


def test_a_datagram_of_false_beginnings_is_left_and_the_next_one_read() -> None:
    decoder = Decoder(stream=False)
    data, tries = b"\xfd" * 2000 + GOOD, 0
    while data or decoder.is_waiting:
        decoder.feed(data, 10)
        tries += decoder.tries
        data = b""
    assert decoder.counters.given_up == 1
    assert tries <= FALSE_TRIES_MAX + 1
    assert decoder.counters.skipped_bytes == 2000 + len(GOOD)
    assert len(decoder.feed(GOOD, 10)) == 1


def test_of_a_line_nothing_is_left() -> None:
    """Noise before a frame is no reason to lose it: a line has no datagrams to be left."""
    decoder = Decoder(stream=True)
    decoder.feed(b"\xfe\x00" * 500 + GOOD, 10)
    received = 0
    while decoder.is_waiting:
        received += len(decoder.feed(b"", 10))
    assert received == 1


def test_of_messages_and_senders_no_more_is_kept_than_some_hundreds() -> None:
    """Made-up senders fill no memory, and each of their frames is read all the same."""
    decoder = Decoder(stream=False)
    for sender in range(1, 251):
        for message in (
            mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
            mavlink.MAVLink_param_request_list_message(1, 191),
        ):
            frame = bytes(message.pack(mavlink.MAVLink(None, sender, 9)))
            assert len(decoder.feed(frame, 10)) == 1
            assert len(decoder._known) <= 256
            assert len(decoder._sources) <= 256
