"""Messages of a ULog, read back by the file format's own words."""

from __future__ import annotations

import struct
from typing import NamedTuple

import pytest

from tgl_soar.config.parameters import INDEX, PARAMETERS
from tgl_soar.onboard.flightlog.topics import TOPICS
from tgl_soar.onboard.flightlog.ulog_messages import (
    MAGIC,
    SUBSCRIPTIONS,
    LogMetadata,
    message,
    parameter_message,
    preamble_of,
)


class Message(NamedTuple):
    kind: str
    body: bytes


def read(data: bytes) -> list[Message]:
    """Size of the body, 16 bits, little end first; a letter; the body."""
    found = []
    while data:
        size = int.from_bytes(data[:2], "little")
        found.append(Message(chr(data[2]), data[3 : 3 + size]))
        assert len(found[-1].body) == size
        data = data[3 + size :]
    return found


def keyed(body: bytes) -> tuple[str, bytes]:
    """A key behind its length, and what follows it."""
    return body[1 : 1 + body[0]].decode(), body[1 + body[0] :]


def test_a_file_begins_with_the_format_s_seven_bytes_and_version_one() -> None:
    assert (MAGIC[:4], [*MAGIC[4:]]) == (b"ULog", [0x01, 0x12, 0x35, 1])


def test_a_message_is_its_size_its_letter_and_its_body() -> None:
    assert message("L", b"words") == b"\x05\x00Lwords"
    assert message("D", bytes(0x0102))[:3] == b"\x02\x01D"


def test_a_part_begins_with_flags_that_claim_nothing_and_the_format_of_every_topic() -> None:
    flags, *formats = read(preamble_of(LogMetadata({}, {})))
    assert flags == ("B", bytes(40))  # compatible, incompatible, appended: none
    assert [each.kind for each in formats] == ["F"] * len(TOPICS)
    assert [each.body.decode() for each in formats] == [each.format for each in TOPICS.values()]


def test_words_have_keys_with_their_lengths() -> None:
    *_, one, other = read(preamble_of(LogMetadata({"sys_name": "tgl_soar", "odd": "é"}, {})))
    assert one.kind == other.kind == "I"
    assert keyed(one.body) == ("char[8] sys_name", b"tgl_soar")
    assert keyed(other.body) == ("char[2] odd", "é".encode())


def test_a_word_is_cut_where_a_message_ends_and_what_is_no_utf_8_is_asked_for() -> None:
    *_, long, odd = read(preamble_of(LogMetadata({"a": "x" * 70_000, "b": "\udcff"}, {})))
    assert keyed(long.body) == ("char[32768] a", b"x" * 32768)
    assert keyed(odd.body) == ("char[1] b", b"?")


@pytest.mark.parametrize(
    ("length", "pieces"),
    [(0, [0]), (1, [1]), (8000, [8000]), (8001, [8000, 1]), (16001, [8000, 8000, 1])],
)
def test_a_file_s_text_is_cut_into_pieces_of_which_all_but_the_first_continue(
    length: int, pieces: list[int]
) -> None:
    text = ("0123456789" * 1601)[:length]
    found = [
        each for each in read(preamble_of(LogMetadata({}, {"site": text}))) if each.kind == "M"
    ]
    assert [each.body[0] for each in found] == [0] + [1] * (len(pieces) - 1)
    keys, values = zip(*(keyed(each.body[1:]) for each in found), strict=True)
    assert list(keys) == [f"char[{size}] site" for size in pieces]
    assert b"".join(values).decode() == text


def test_every_topic_is_subscribed_to_once_by_its_number() -> None:
    found = read(SUBSCRIPTIONS)
    assert {each.kind for each in found} == {"A"}
    subscribed = [(each.body[0], *struct.unpack("<H", each.body[1:3])) for each in found]
    assert subscribed == [(0, topic.number) for topic in TOPICS.values()]
    assert [each.body[3:].decode() for each in found] == list(TOPICS)


@pytest.mark.parametrize("name", [PARAMETERS[0].name, "TGL_X", PARAMETERS[-1].name])
def test_a_parameter_is_a_float_by_its_name(name: str) -> None:
    (found,) = read(parameter_message(INDEX[name], -12.5))
    assert found.kind == "P"
    assert keyed(found.body) == (f"float {name}", struct.pack("<f", -12.5))
