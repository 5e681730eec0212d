"""The messages of a ULog that are not rows: what a part of a log begins with, parameters, words.

ULog: https://docs.px4.io/main/en/dev_log/ulog_file_format.html
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from typing import Final, NamedTuple

from tgl_soar.config.parameters import PARAMETERS
from tgl_soar.onboard.flightlog.topics import TOPICS

MAGIC: Final = b"\x55\x4c\x6f\x67\x01\x12\x35\x01"
TEXT_CHARS: Final = 8000  # of a file's text in one message
_WORD_BYTES: Final = 32768  # a message holds no more than 65535
_HEAD: Final = struct.Struct("<HB")


class LogMetadata(NamedTuple):
    """What stands in a log before its rows."""

    words: Mapping[str, str]  # versions, names, how it was started
    texts: Mapping[str, str]  # whole files


def message(kind: str, body: bytes) -> bytes:
    """One message of a ULog."""
    return _HEAD.pack(len(body), ord(kind)) + body


def preamble_of(metadata: LogMetadata) -> bytes:
    """What every part begins with, after its header."""
    made = [message("B", bytes(40))]
    made += [message("F", topic.format.encode()) for topic in TOPICS.values()]
    for key, word in metadata.words.items():
        made.append(message("I", _keyed(key, _bytes(word)[:_WORD_BYTES])))
    for key, text in metadata.texts.items():
        for at in range(0, max(1, len(text)), TEXT_CHARS):
            piece = _bytes(text[at : at + TEXT_CHARS])
            made.append(message("M", bytes([at > 0]) + _keyed(key, piece)))
    return b"".join(made)


def _bytes(text: str) -> bytes:
    """As it is written: of what is no UTF-8, as a file's name may be, question marks."""
    return text.encode(errors="replace")


def _keyed(key: str, value: bytes) -> bytes:
    name = f"char[{len(value)}] {key}".encode()
    return bytes([len(name)]) + name + value


SUBSCRIPTIONS: Final = b"".join(
    message("A", struct.pack("<BH", 0, topic.number) + topic.name.encode())
    for topic in TOPICS.values()
)


def parameter_message(index: int, value: float) -> bytes:
    """A parameter's value; `index`: its place in the declaration."""
    return _PARAMETER_HEADS[index] + struct.pack("<f", value)


def _parameter_head(name: str) -> bytes:
    key = f"float {name}".encode()
    return _HEAD.pack(len(key) + 5, ord("P")) + bytes([len(key)]) + key


_PARAMETER_HEADS: Final = tuple(_parameter_head(declared.name) for declared in PARAMETERS)
