"""Messages to bytes.

The payloads of every tick are written by `hot_frames`, all others by pymavlink's dialect.
"""

from __future__ import annotations

from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from tgl_soar.link.frames import CRC_EXTRAS, LARGEST_V1, SIGNED, checksum, with_crc_extra
from tgl_soar.link.hot_frames import WRITERS, override_body
from tgl_soar.link.messages import Outbound, RcChannelsOverride, Source
from tgl_soar.link.outbound_messages import OUTBOUND
from tgl_soar.link.signing import Signing, signed

# Number, CRC_EXTRA and writer of a message.
_WRITTEN: Final = {
    kind: (number, CRC_EXTRAS[number.to_bytes(3, "little")], write)
    for kind, (number, write) in WRITERS.items()
}
_OVERRIDE_EXTRA: Final = _WRITTEN[RcChannelsOverride][1]


class Encoder:
    """Frames of one sender; each sender counts its own sequence."""

    def __init__(self, source: Source, signing: Signing | None = None, link_id: int = 0) -> None:
        """`signing`: what all links share; frames are signed while it has a key."""
        self.source = source
        self._signing = signing
        self._link_id = link_id
        self.version1 = False  # send MAVLink 1
        self._sequence = 0
        self._dialect: Any = dialect.MAVLink(None, source.system, source.component)

    def encode(self, message: Outbound) -> bytes:
        """One frame; empty if MAVLink 1 was asked for and has no such message.

        Errors: `struct.error` for a field that does not fit its place: a mistake of ours.
        """
        signing = self._signing
        key = signing.key if signing is not None and not self.version1 else None
        timestamp = signing.next_timestamp() if signing is not None and key is not None else 0
        message_type = type(message)
        if isinstance(message, RcChannelsOverride):
            frame = self._override(message, key, timestamp)
        elif message_type in _WRITTEN:
            frame = self._framed(message_type, message, key, timestamp)
        else:
            frame = self._packed(message, key, timestamp)
        if frame:
            self._sequence = (self._sequence + 1) & 0xFF
        return frame

    def _override(self, message: RcChannelsOverride, key: bytes | None, timestamp: int) -> bytes:
        """The frame that every tick sends."""
        body, source = b"", self.source
        if not self.version1:
            flags = 0 if key is None else SIGNED
            body = override_body(message, flags, self._sequence, source[0], source[1])
        if not body:
            return self._framed(RcChannelsOverride, message, key, timestamp)
        frame = (
            b"\xfd" + body + with_crc_extra(checksum(body), _OVERRIDE_EXTRA).to_bytes(2, "little")
        )
        return frame if key is None else signed(frame, key, self._link_id, timestamp)

    def _framed(
        self, message_type: type[Outbound], message: Outbound, key: bytes | None, timestamp: int
    ) -> bytes:
        """A frame around a payload that `hot_frames` writes."""
        number, crc_extra, write = _WRITTEN[message_type]
        if self.version1 and number > LARGEST_V1:
            return b""
        payload = write(message)
        system, component = self.source
        if self.version1:
            body = bytes((len(payload), self._sequence, system, component, number)) + payload
            return b"\xfe" + body + with_crc_extra(checksum(body), crc_extra).to_bytes(2, "little")
        payload = payload.rstrip(b"\0") or b"\0"
        flags = 0 if key is None else SIGNED
        head = bytes((len(payload), flags, 0, self._sequence, system, component))
        body = head + number.to_bytes(3, "little") + payload
        frame = b"\xfd" + body + with_crc_extra(checksum(body), crc_extra).to_bytes(2, "little")
        return frame if key is None else signed(frame, key, self._link_id, timestamp)

    def _packed(self, message: Outbound, key: bytes | None, timestamp: int) -> bytes:
        """A frame that pymavlink writes."""
        packable = OUTBOUND[type(message)](message)
        if self.version1 and packable.id > LARGEST_V1:
            return b""
        mav = self._dialect
        mav.seq = self._sequence
        state = mav.signing
        state.secret_key = key
        state.sign_outgoing = key is not None
        state.link_id = self._link_id
        state.timestamp = timestamp
        return bytes(packable.pack(mav, force_mavlink1=self.version1))

    def restart(self) -> None:
        """Count from zero again."""
        self._sequence = 0
