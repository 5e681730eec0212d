"""Every message that is read: its frame, made by pymavlink, comes out as the tuple of its name."""

from __future__ import annotations

from typing import Any, get_args

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link import messages
from tgl_soar.link.decoder import Decoder

# Whose tuple is not named as MAVLink names the message: there are three of the first.
NAMES = {"HomeMessage": "HOME_POSITION"}
KINDS: tuple[type[Any], ...] = get_args(messages.Inbound)


def name_of(kind: type[Any]) -> str:
    """CamelCase to the name in MAVLink."""
    camel = kind.__name__
    upper = "".join(f"_{c}" if c.isupper() else c for c in camel).strip("_").upper()
    return NAMES.get(camel, upper)


def a_frame(name: str) -> bytes:
    """A message with a number of its own in every field, from (7, 8)."""
    kind = next(k for k in mavlink.mavlink_map.values() if k.msgname == name)
    values: list[Any] = []
    for field, width in zip(kind.ordered_fieldnames, kind.array_lengths, strict=True):
        number = 1 + len(values)
        text = kind.fieldtypes[kind.fieldnames.index(field)] == "char"
        values.append(b"A" * number if text else [number] * width if width else number)
    given = dict(zip(kind.ordered_fieldnames, values, strict=True))
    message = kind(**{f: given[f] for f in kind.fieldnames})
    return bytes(message.pack(mavlink.MAVLink(None, 7, 8)))


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_a_message_is_read_as_the_tuple_of_its_name(kind: type[Any]) -> None:
    (received,) = Decoder(stream=False).feed(a_frame(name_of(kind)), 10)
    assert type(received.message) is kind
    assert received.source == messages.Source(7, 8)
