"""Files over MAVLink: there are none here, and every request is answered so at once.

A station may look for a list of parameters among our files before it asks for the parameters
themselves, and repeats a request that nobody answers: MAVProxy for ten seconds.  So every request
is answered by a NAK, "unknown command".

    payload   sequence (16 bits), session, opcode, size, opcode asked for, burst, padding,
              offset (32 bits), data; little-endian
"""

from __future__ import annotations

from struct import Struct
from typing import Final

from tgl_soar.link.messages import FileTransferProtocol, Source

NAK: Final = 129
FIRST_ANSWER: Final = 128  # this opcode and all above are answers: two servers must not converse
UNKNOWN_COMMAND: Final = 7
PAYLOAD: Final = 251
_HEAD: Final = Struct("<HBBBBBxI")


def refused(source: Source, message: FileTransferProtocol) -> FileTransferProtocol | None:
    """The answer to a request; None if it is none."""
    if len(message.payload) < _HEAD.size:
        return None
    sequence, session, opcode, _, _, _, offset = _HEAD.unpack_from(message.payload)
    if opcode >= FIRST_ANSWER:
        return None
    head = _HEAD.pack((sequence + 1) % 2**16, session, NAK, 1, opcode, 0, offset)
    payload = (head + bytes((UNKNOWN_COMMAND,))).ljust(PAYLOAD, b"\0")
    return FileTransferProtocol(source.system, source.component, payload)
