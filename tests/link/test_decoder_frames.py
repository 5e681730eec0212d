"""What a decoder shows besides messages: whole frames for the log, and the version."""

from __future__ import annotations

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.decoder import Decoder

HEARTBEAT = mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3)
TIME = mavlink.MAVLink_system_time_message(1, 2)  # it is not read here


def packed(message: mavlink.MAVLink_message, *, v1: bool = False) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, 1, 1), force_mavlink1=v1))


def unknown(number: int = 60000) -> bytes:
    """A frame of a number that no dialect has; its checksum cannot be checked."""
    return bytes((0xFD, 3, 0, 0, 0, 1, 1)) + number.to_bytes(3, "little") + b"abc\x12\x34"


def test_every_whole_frame_is_shown_with_whether_it_was_accepted() -> None:
    shown: list[tuple[bytes, bool]] = []
    frames = [packed(HEARTBEAT), packed(TIME), unknown(), packed(HEARTBEAT, v1=True)]
    decoder = Decoder(
        stream=False,
        accept=lambda frame: frame[0] == 0xFD,
        tap=lambda frame, accepted: shown.append((frame, accepted)),
    )
    received = decoder.feed(b"".join(frames))
    assert shown == [(frames[0], True), (frames[1], True), (frames[2], False), (frames[3], False)]
    assert len(received) == 1
    counters = decoder.counters
    assert (counters.frames, counters.messages, counters.refused, counters.unknown) == (3, 1, 1, 1)


def test_frames_of_mavlink_1_alone_are_noticed_and_one_of_mavlink_2_ends_that() -> None:
    decoder = Decoder(stream=True)
    assert decoder.only_v1 is False  # nothing has come
    decoder.feed(packed(HEARTBEAT, v1=True))
    assert decoder.only_v1 is True
    decoder.feed(packed(HEARTBEAT))
    assert decoder.only_v1 is False
    decoder.feed(packed(HEARTBEAT, v1=True))
    assert decoder.only_v1 is False
    decoder.reset()
    decoder.feed(packed(HEARTBEAT, v1=True))
    assert decoder.only_v1 is True


def test_gaps_are_counted_and_a_frame_that_was_overtaken_is_none() -> None:
    codec, frames = mavlink.MAVLink(None, 1, 1), []
    for k in range(300):
        codec.seq = k & 0xFF
        frames.append(bytes(HEARTBEAT.pack(codec)))
    decoder = Decoder(stream=False)
    decoder.feed(frames[0])
    decoder.watch(source := decoder.feed(frames[1])[0].source)
    assert (source.system, source.component) == (1, 1)
    for k in (2, 3, 7, 8):
        decoder.feed(frames[k])
    assert (decoder.counters.watched, decoder.counters.lost) == (4, 3)
    decoder.feed(frames[5])  # late: it was counted as lost
    assert decoder.counters.lost == 2
    decoder.feed(frames[9])
    assert decoder.counters.lost == 2
    for k in (200, 299):  # 190 and 98 of them, over the end of the sequence's byte
        decoder.feed(frames[k])
    assert decoder.counters.lost == 2 + 190 + 98
    decoder.feed(frames[299 - 1])
    assert decoder.counters.lost == 2 + 190 + 97
