"""MAVLink frames: where one begins, how long it is, whether its checksum is right.

    MAVLink 1   marker length sequence system component number(1) payload checksum(2)
    MAVLink 2   marker length flags flags sequence system component number(3) payload checksum(2)
                and, if signed, a signature of 13 bytes

A checksum ends with one more byte, which stands for the layout of the message (CRC_EXTRA): a frame
can be checked only if the dialect knows its message.
"""

from __future__ import annotations

from typing import Any, Final

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as dialect

# A constant of this module, and so found at once in native code.
checksum: Final = mcrf4xx

MARKER_V1: Final = 0xFE
MARKER_V2: Final = 0xFD
HEADER_V1: Final = 6
HEADER_V2: Final = 10
CHECKSUM: Final = 2
SHORTEST_V2: Final = HEADER_V2 + CHECKSUM
SIGNED: Final = 0x01
SIGNATURE: Final = 13  # link id, timestamp, and six bytes of the hash
LARGEST_V1: Final = 255  # MAVLink 1 has no larger message numbers

CHECKSUM_OF_BYTE: Final = tuple(checksum(bytes((byte,)), 0) for byte in range(256))


# Of messages that MAVLink has and pymavlink's dialect has not: COMPONENT_METADATA.
LATER_EXTRAS: Final = {397: 182}


def _crc_extras() -> dict[bytes, int]:
    """By the number as it stands in a frame of either version."""
    messages: dict[int, Any] = dialect.mavlink_map
    extras = {number.to_bytes(3, "little"): int(m.crc_extra) for number, m in messages.items()}
    for number, message in messages.items():
        if number <= LARGEST_V1:
            extras[bytes((number,))] = int(message.crc_extra)
    for number, extra in LATER_EXTRAS.items():
        extras.setdefault(number.to_bytes(3, "little"), extra)
    return extras


CRC_EXTRAS: Final = _crc_extras()


def with_crc_extra(crc: int, crc_extra: int) -> int:
    """A frame's checksum: that of its bytes and of the byte for the message's layout."""
    return crc >> 8 ^ CHECKSUM_OF_BYTE[(crc ^ crc_extra) & 0xFF]


def first_frame(data: bytes) -> bytes:
    """The whole frame of a known message that a datagram begins with; empty if it does not."""
    return good_frame(data, 0)


def good_frame(data: bytes, at: int) -> bytes:
    """The whole frame of a known message, checksum right, that begins here; empty if none does."""
    length = frame_length(data, at) if at < len(data) else 0
    if length == 0 or at + length > len(data):
        return b""
    frame = data[at : at + length]
    crc_extra = CRC_EXTRAS.get(number_in_frame(frame))
    to = length - CHECKSUM - (SIGNATURE if frame[0] == MARKER_V2 and frame[2] else 0)
    good = crc_extra is not None and (
        with_crc_extra(checksum(frame[1:to]), crc_extra) == frame[to] | frame[to + 1] << 8
    )
    return frame if good else b""


def frame_length(data: bytes, at: int) -> int:
    """Length of the frame that begins here, 0 if none does.

    If the header is not whole the length is that of the shortest header: more than there is.
    """
    marker = data[at]
    left = len(data) - at
    if marker == MARKER_V2:
        if left < 3:
            return HEADER_V2 + CHECKSUM
        flags = data[at + 2]
        if flags & ~SIGNED:
            return 0  # an unknown incompatibility flag: must not be read
        return HEADER_V2 + data[at + 1] + CHECKSUM + (SIGNATURE if flags & SIGNED else 0)
    if marker == MARKER_V1:
        if left < 2:
            return HEADER_V1 + CHECKSUM
        return HEADER_V1 + data[at + 1] + CHECKSUM
    return 0


def number_in_frame(frame: bytes) -> bytes:
    """The message's number, as it stands in the frame."""
    return frame[5:6] if frame[0] == MARKER_V1 else frame[7:10]
