"""How good examples are changed: byte by byte, or message by message with right lengths and sums.

Bytes put into a log move all that follows, and a reader that checks leaves it out: what is
wrong *in* a whole message is reached by changing its body and sealing it again.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from random import Random
from typing import Final

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as mavlink

Seal = Callable[[bytes], bytes]
_EDGES: Final = (0, 1, 0x7F, 0x80, 0xFF)


def mutated(random: Random, example: bytes) -> bytes:
    """An example with a few bytes turned, cut or put in."""
    data = bytearray(example)
    for _ in range(random.randint(1, 6)):
        at = int(random.random() * (len(data) + 1))
        way = random.getrandbits(2)
        if way == 0 and data:
            data[at % len(data)] = _any_byte(random)
        elif way == 1:
            data[at:at] = random.randbytes(1 + random.getrandbits(3))
        elif way == 2:
            del data[at : at + 1 + random.getrandbits(4)]
        else:
            data[at:at] = data[: int(random.random() * (len(data) + 1))][:64]
    return bytes(data)


def _any_byte(random: Random) -> int:
    kind = random.getrandbits(3)
    return _EDGES[kind] if kind < len(_EDGES) else random.getrandbits(8)


def mutated_parts(random: Random, parts: list[bytes], seal: Seal) -> bytes:
    """A log of parts with a few of them changed, left out, repeated or exchanged.

    The first part, by which the log is known, stays.  seal: puts length and sum of a part right.
    """
    parts = list(parts)
    for _ in range(random.randint(1, 4)):
        at = 1 + int(random.random() * (len(parts) - 1)) if len(parts) > 1 else 0
        other = int(random.random() * len(parts))
        way = random.getrandbits(3)
        if way == 0 and len(parts) > 2:
            del parts[at]
        elif way == 1:
            parts.insert(at + 1, parts[other])
        elif way == 2 and other:
            parts[at], parts[other] = parts[other], parts[at]
        elif way == 3:
            parts[at] = seal(mutated(random, parts[at]))
        elif parts[at]:
            part = bytearray(parts[at])
            for _ in range(random.randint(1, 4)):
                part[int(random.random() * len(part))] = _any_byte(random)
            parts[at] = seal(bytes(part))
    return b"".join(parts)


def ulog_parts(data: bytes) -> list[bytes]:
    """The head of a whole ULog and its messages."""
    parts, at = [data[:16]], 16
    while at < len(data):
        after = at + 3 + int.from_bytes(data[at : at + 2], "little")
        parts.append(data[at:after])
        at = after
    return parts


def sealed_ulog(part: bytes) -> bytes:
    """A message of a ULog with its right length."""
    return struct.pack("<H", max(0, len(part) - 3)) + part[2:].ljust(1, b"D")


def dataflash_parts(data: bytes) -> list[bytes]:
    """The records of a whole DataFlash log whose descriptions stand before all else."""
    lengths, parts, at = {0x80: 89}, [], 0
    while at < len(data):
        number = data[at + 2]
        part = data[at : at + lengths[number]]
        if number == 0x80:
            lengths[part[3]] = part[4]
        parts.append(part)
        at += len(part)
    return parts


def sealed_dataflash(part: bytes) -> bytes:
    """A record with its right beginning; it has neither length nor sum."""
    return b"\xa3\x95" + part[2:]


def tlog_parts(data: bytes) -> list[bytes]:
    """The stamped frames of a whole .tlog of MAVLink 2 without signatures."""
    parts, at = [], 0
    while at < len(data):
        after = at + 8 + 12 + data[at + 9]
        parts.append(data[at:after])
        at = after
    return parts


def sealed_tlog(part: bytes) -> bytes:
    """A stamped frame with its right length and sum, where its message is known."""
    if len(part) < 8 + 12:
        return part
    payload = part[18:-2][:255]
    body = bytes([len(payload), 0]) + part[11:18] + payload
    kind = mavlink.mavlink_map.get(int.from_bytes(part[15:18], "little"))
    extra = 0 if kind is None else kind.crc_extra
    return part[:8] + b"\xfd" + body + struct.pack("<H", mcrf4xx(body + bytes([extra])))


def parts_of(data: bytes) -> tuple[list[bytes], Seal]:
    """The parts of a good log, and what puts one right that was changed."""
    if data.startswith(b"ULog"):
        return ulog_parts(data), sealed_ulog
    if data.startswith(b"\xa3\x95"):
        return dataflash_parts(data), sealed_dataflash
    return tlog_parts(data), sealed_tlog
