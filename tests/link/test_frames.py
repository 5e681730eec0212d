"""Frames of MAVLink 1 and 2, against those that pymavlink makes."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.encoder import Encoder
from tgl_soar.link.frames import (
    CRC_EXTRAS,
    first_frame,
    frame_length,
    good_frame,
    number_in_frame,
    with_crc_extra,
)
from tgl_soar.link.messages import ComponentMetadata, Source

KEY = bytes(range(1, 33))
V1, V2 = 0xFE, 0xFD
MESSAGES = [
    mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3),
    mavlink.MAVLink_attitude_message(123456, 0.1, -0.2, 3.0, 0.0, 0.0, 0.25),
    mavlink.MAVLink_gps2_raw_message(*(0,) * 12),  # of a number above 100
    mavlink.MAVLink_mission_clear_all_message(0, 0),  # all zeros: one byte is left
]
KINDS = ["v1", "v2", "signed"]


def codec(kind: str = "v2") -> Any:
    made = mavlink.MAVLink(None, 7, 190)
    if kind == "signed":
        made.signing.secret_key = KEY
        made.signing.sign_outgoing = True
        made.signing.timestamp = 10**13
    return made


def packed(message: Any, kind: str) -> bytes:
    return bytes(message.pack(codec(kind), force_mavlink1=kind == "v1"))


FRAMES = [packed(message, kind) for message in MESSAGES for kind in KINDS]
HEARTBEAT = {kind: packed(MESSAGES[0], kind) for kind in KINDS}


def test_the_three_kinds_differ_by_what_the_specification_says() -> None:
    lengths = {kind: len(frame) for kind, frame in HEARTBEAT.items()}
    assert lengths == {"v1": 6 + 9 + 2, "v2": 10 + 9 + 2, "signed": 10 + 9 + 2 + 13}
    assert {kind: frame[0] for kind, frame in HEARTBEAT.items()} == {
        **dict.fromkeys(("v2", "signed"), V2),
        "v1": V1,
    }


@pytest.mark.parametrize("frame", FRAMES)
def test_a_frame_is_as_long_as_it_was_made_and_good_wherever_it_stands(frame: bytes) -> None:
    for before, after in ((b"", b""), (b"xy", b""), (b"", b"\xfd\xfe"), (b"\xfd", frame)):
        data = before + frame + after
        assert frame_length(data, len(before)) == len(frame)
        assert good_frame(data, len(before)) == frame
    assert first_frame(frame + b"more") == frame


@pytest.mark.parametrize("frame", FRAMES)
def test_a_frame_that_is_cut_or_behind_something_else_is_none_there(frame: bytes) -> None:
    assert first_frame(frame[:-1]) == b""
    assert first_frame(b"x" + frame) == b""
    assert first_frame(b"") == b""
    assert good_frame(frame, len(frame)) == b""
    assert good_frame(frame, 1) == b""


@pytest.mark.parametrize("kind", KINDS)
def test_one_wrong_bit_anywhere_before_the_signature_is_no_frame(kind: str) -> None:
    """The checksum ends before the signature, which has a proof of its own."""
    frame = HEARTBEAT[kind]
    covered = len(frame) - (13 if kind == "signed" else 0)
    for at in range(len(frame)):
        for bit in range(8):
            wrong = frame[:at] + bytes((frame[at] ^ 1 << bit,)) + frame[at + 1 :]
            assert (good_frame(wrong, 0) == wrong) == (at >= covered), (at, bit)


@pytest.mark.parametrize(
    ("data", "length"),
    [
        # A header that is not whole: as long as the shortest frame with it, more than there is.
        (bytes((V2,)), 12),
        (bytes((V2, 200)), 12),
        (bytes((V1,)), 8),
        # Whole as far as the length: that of the payload, header and checksum.
        (bytes((V2, 200, 0)), 212),
        (bytes((V2, 200, 1)), 225),  # signed
        (bytes((V2, 0, 0)), 12),
        (bytes((V1, 200)), 208),
        # Flags that are not known: the frame must not be read.
        (bytes((V2, 200, 2)), 0),
        (bytes((V2, 200, 3)), 0),
        (bytes((V2, 200, 0x80)), 0),
        # Whatever else begins none.
        (bytes((0xFC, 1, 2, 3)), 0),
        (bytes((0xFF, 1, 2, 3)), 0),
        (bytes((0x55,)), 0),
    ],
)
def test_the_length_is_known_from_the_header_alone(data: bytes, length: int) -> None:
    assert frame_length(data, 0) == length
    assert frame_length(b"??" + data, 2) == length


@pytest.mark.parametrize("number", [0, 30, 255, 268, 9000, 11000])
def test_a_number_stands_where_its_version_has_it(number: int) -> None:
    v2 = bytes((V2, 0, 0, 0, 1, 7, 190)) + number.to_bytes(3, "little") + b"\0\0"
    assert int.from_bytes(number_in_frame(v2), "little") == number
    if number < 256:
        v1 = bytes((V1, 0, 1, 7, 190, number)) + b"\0\0"
        assert number_in_frame(v1) == bytes((number,))


def test_every_message_of_the_dialect_is_known_by_the_number_of_either_version() -> None:
    for number, message in mavlink.mavlink_map.items():
        assert CRC_EXTRAS[number.to_bytes(3, "little")] == message.crc_extra
        assert (bytes((number & 0xFF,)) in CRC_EXTRAS) or number > 255
    short = {key[0]: extra for key, extra in CRC_EXTRAS.items() if len(key) == 1}
    assert short == {n: m.crc_extra for n, m in mavlink.mavlink_map.items() if n < 256}
    later = {key for key in CRC_EXTRAS if int.from_bytes(key, "little") not in mavlink.mavlink_map}
    assert {int.from_bytes(key, "little") for key in later} <= {397}
    assert {len(key) for key in CRC_EXTRAS} == {1, 3}


def crc_extra(name: str, fields: list[tuple[str, str, int]]) -> int:
    """CRC_EXTRA by the serialisation guide: of a message's name and of its fields in wire order
    (type, name, and of an array its length), by the CRC of X.25, folded to a byte."""
    crc = 0xFFFF

    def take(data: bytes) -> None:
        nonlocal crc
        for byte in data:
            low = byte ^ (crc & 0xFF)
            low ^= (low << 4) & 0xFF
            crc = crc >> 8 ^ low << 8 ^ low << 3 ^ low >> 4

    take(f"{name} ".encode())
    for kind, field, length in fields:
        take(f"{kind} {field} ".encode())
        if length:
            take(bytes((length,)))
    return (crc & 0xFF) ^ (crc >> 8)


def test_the_message_that_the_dialect_lacks_has_the_crc_extra_of_its_definition() -> None:
    """common.xml: COMPONENT_METADATA is time_boot_ms, file_crc, and a uri of 100 characters."""
    heartbeat = [("uint32_t", "custom_mode", 0)]
    heartbeat += [("uint8_t", each, 0) for each in ("type", "autopilot", "base_mode")]
    heartbeat += [("uint8_t", each, 0) for each in ("system_status", "mavlink_version")]
    assert crc_extra("HEARTBEAT", heartbeat) == mavlink.mavlink_map[0].crc_extra
    metadata = [("uint32_t", "time_boot_ms", 0), ("uint32_t", "file_crc", 0), ("char", "uri", 100)]
    number = (397).to_bytes(3, "little")
    assert CRC_EXTRAS[number] == crc_extra("COMPONENT_METADATA", metadata)
    frame = Encoder(Source(1, 191)).encode(ComponentMetadata(5, 7, "mftp://x"))
    assert number_in_frame(frame) == number
    assert first_frame(frame) == frame


def test_a_checksum_goes_on_with_the_layout_s_byte_as_pymavlink_s_does() -> None:
    for begun in (0x0000, 0x1234, 0xBEEF, 0xFFFF):
        for extra in (0, 1, 50, 255):
            theirs = mavlink.x25crc()
            theirs.crc = begun
            theirs.accumulate(bytes((extra,)))
            assert with_crc_extra(begun, extra) == theirs.crc


def test_a_message_that_nobody_knows_cannot_be_checked_and_is_no_good_frame() -> None:
    body = bytes((1, 0, 0, 5, 7, 190)) + (60_000).to_bytes(3, "little") + b"x"
    assert (60_000).to_bytes(3, "little") not in CRC_EXTRAS
    for extra in range(256):
        crc = mavlink.x25crc(body)
        crc.accumulate(bytes((extra,)))
        frame = bytes((V2,)) + body + crc.crc.to_bytes(2, "little")
        assert first_frame(frame) == b""
