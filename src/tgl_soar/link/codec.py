"""Bytes to messages and back.

Framing is ours: a stream or a datagram is cut into MAVLink 1 and 2 frames whose checksum is
right; after anything else the search goes on at the very next byte, so that garbage, a cut
frame or a marker inside a payload costs no good frame behind it.  The payloads of every tick
are read and written by `hot_frames`, all others by pymavlink's dialect, and only those of
messages that somebody here listens to.

The work is linear in the bytes, whoever made them: a place is tried as the beginning of a frame
twice at most, and a try looks at no more than the longest frame.  `feed` can be told how much
work a call may do; the rest waits.

Nothing that arrives raises.  Nothing untyped leaves this file.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tgl_soar.link.hot_frames import READERS, WRITERS, Reader, chars, float32, override_body
from tgl_soar.link.messages import (
    AutopilotVersion,
    CommandAck,
    CommandInt,
    CommandLong,
    FileTransferProtocol,
    Heartbeat,
    Inbound,
    ManualControl,
    MessageInterval,
    NavControllerOutput,
    Odometry,
    Outbound,
    ParamError,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    RcChannels,
    RcChannelsOverride,
    Received,
    SetActuatorControlTarget,
    SetupSigning,
    Source,
    StatusText,
    SysStatus,
    VfrHud,
    VisionPositionEstimate,
    WindCov,
)
from tgl_soar.link.signing import Signing, signed

# Constants of this module, and so found at once in native code.
checksum: Final = mcrf4xx
_new: Final[Any] = tuple.__new__  # a named tuple of all its fields in a tuple

_MARKER_V1: Final = 0xFE
_MARKER_V2: Final = 0xFD
_HEADER_V1: Final = 6
_HEADER_V2: Final = 10
_CHECKSUM: Final = 2
_SHORTEST_V2: Final = _HEADER_V2 + _CHECKSUM
_SIGNED: Final = 0x01
_SIGNATURE: Final = 13

_MOST_LOST: Final = 200  # in a row: a larger gap is a frame that was overtaken
_LARGEST_V1: Final = 255  # MAVLink 1 has no larger message numbers
_MOST_KEPT: Final = 256  # of what is known of a message and its sender
_ZEROS: Final = bytes(255)  # what was cut off a payload
_next_marker: Final = re.compile(rb"[\xfd\xfe]").search

# What a call of `feed` may do, in tries: to take a piece of bytes as a frame is one.  A message
# that somebody listens to is decoded, checked for its signature and acted on besides.
UNLIMITED: Final = 1 << 60
MESSAGE_TRIES: Final = 8
# Two bytes of 256 begin a frame: 2 kB of a line's noise hold 16 +- 4 of them.  A datagram with
# four times as many false ones is no noise: the rest of it is not looked at.
FALSE_TRIES_MAX: Final = 64

_ONE_BYTE: Final = tuple(checksum(bytes((byte,)), 0) for byte in range(256))  # its checksum


@dataclass(slots=True)
class DecoderCounters:
    """What a link brought."""

    frames: int = 0  # with a right checksum
    watched: int = 0  # of these, of the sender whose sequence is watched
    lost: int = 0  # of that sender's, by the gaps of its sequence
    messages: int = 0  # of these, understood
    skipped_bytes: int = 0  # belonged to no good frame
    bad_checksums: int = 0
    unknown: int = 0  # of messages that the dialect lacks: cannot be checked
    refused: int = 0  # not signed as they must be
    undecodable: int = 0  # right checksum, and yet no message
    given_up: int = 0  # datagrams of which the rest was not looked at


@dataclass(slots=True)
class _Known:
    """What a message's number and its sender tell of a frame."""

    source: Source
    is_watched: bool  # its sender's sequence is
    crc_extra: int
    # Of a hot frame: so many bytes are read, into this, by that.
    needed: int
    kind: type[Inbound] | None
    fields: Callable[[bytes, int], tuple[Any, ...]] | None
    all_fields: Callable[[bytes, int], tuple[Any, ...]] | None
    # Of another one that somebody listens to.
    heard: Callable[[Any], Inbound] | None
    is_kept: bool = False


class Decoder:
    """Cuts what arrives on one link into messages."""

    def __init__(
        self,
        *,
        stream: bool,
        accept: Callable[[bytes], bool] | None = None,
        tap: Callable[[bytes, bool], None] | None = None,
    ) -> None:
        """`stream`: a frame may go on in the next piece, as on a serial line.

        `accept`: whether a whole, good frame may be believed.  `tap`: is shown every whole frame,
        also of messages that nobody listens to, and whether it was accepted.
        """
        self.counters = DecoderCounters()
        self._tap = tap
        self._stream = stream
        self._accept = accept
        self._rest = b""
        self._waiting = b""  # for the next call: there was too much to do
        self._false_tries = 0  # of the datagram that waits
        self.tries = 0  # of the last call
        self._looked_to = 0  # in this call's bytes: no good frame begins between `at` and here,
        self._frame_at = -1  # but for the one that begins here
        self._dialect: Any = dialect.MAVLink(None)
        self.only_v1 = False  # frames came, and all of MAVLink 1
        self._heard_v2 = False
        self._known: dict[bytes, _Known] = {}  # by sender and number, as they stand in a frame
        self._sources: dict[bytes, Source] = {}  # of these
        self._watched: Source | None = None
        self._sequence = -1

    def watch(self, source: Source) -> None:
        """Count what is lost of one sender's frames."""
        self._watched = source
        self._known.clear()

    def feed(self, data: bytes, most_tries: int = UNLIMITED) -> list[Received]:
        """The messages that end in this piece, in order.

        `most_tries`: when so much has been done, and some of the piece is left, that waits for
        the next call; until nothing waits `data` must be empty.
        """
        if self._waiting:
            data, self._waiting = self._waiting + data, b""
        else:
            self._false_tries = 0
            if self._rest:
                data, self._rest = self._rest + data, b""
        self._looked_to, self._frame_at = 0, -1
        received: list[Received] = []
        at, end = 0, len(data)
        self.tries = 0
        while at < end:
            if self.tries >= most_tries:
                self._waiting = data[at:]
                break
            if data[at] == _MARKER_V2 and end - at >= _SHORTEST_V2 and data[at + 2] == 0:
                length = _SHORTEST_V2 + data[at + 1]  # nearly always
            else:
                length = _frame_length(data, at)
            if at + length > end and self._stream:
                self._rest = data[at:]
                break
            self.tries += 1
            if 0 < length <= end - at and (
                self._take(data, at, length, received) or self._is_unknown(data, at, length)
            ):
                at += length
            elif most_tries < UNLIMITED and self._is_given_up():
                self.counters.skipped_bytes += end - at
                at = end
            else:
                at = self._skip_to_marker(data, at)
        return received

    @property
    def is_waiting(self) -> bool:
        """Whether something of what came is still to be looked at."""
        return self._waiting != b""

    def _is_given_up(self) -> bool:
        """One more place of a datagram was no frame: whether to leave the rest unread."""
        self._false_tries += 1
        if self._stream or self._false_tries <= FALSE_TRIES_MAX:
            return False
        self.counters.given_up += 1
        return True

    def reset(self) -> None:
        """Forget a frame begun: the line was cut."""
        self._rest = self._waiting = b""
        self._sequence = -1
        self.only_v1 = self._heard_v2 = False

    def _take(self, data: bytes, at: int, length: int, received: list[Received]) -> bool:
        """What has the length of a frame; whether it is one, of a message that is known."""
        version1 = data[at] == _MARKER_V1
        if version1:
            sequence, about, payload_at = data[at + 2], data[at + 3 : at + 6], at + _HEADER_V1
        else:
            sequence, about, payload_at = data[at + 4], data[at + 5 : at + 10], at + _HEADER_V2
        known = self._known.get(about)
        if known is None:
            known = self._looked_up(about)
            if known is None:
                return False
        size = data[at + 1]
        to = payload_at + size
        crc = checksum(data[at + 1 : to])
        if crc >> 8 ^ _ONE_BYTE[(crc ^ known.crc_extra) & 0xFF] != data[to] | data[to + 1] << 8:
            self.counters.bad_checksums += 1
            return False
        counters = self.counters
        counters.frames += 1
        frame = data if length == len(data) else data[at : at + length]
        is_accepted = self._accept is None or self._accept(frame)
        if self._tap is not None:
            self._tap(frame, is_accepted)
        if version1:
            self.only_v1 = not self._heard_v2
        elif not self._heard_v2:
            self._heard_v2, self.only_v1 = True, False
        if not known.is_kept:
            self._keep(about, known)
        if known.is_watched:
            self._count(sequence)
        if not is_accepted:
            counters.refused += 1
            return True
        fields = known.fields
        if fields is None and known.heard is None:
            return True
        if fields is None:
            message: Inbound | None = self._decoded(frame, known.heard)
            if message is None:
                return True
        elif size > known.needed and known.all_fields is not None:
            message = _new(known.kind, known.all_fields(data[payload_at:to] + _ZEROS, 0))
        elif size >= known.needed:
            message = _new(known.kind, fields(data, payload_at))
        else:
            message = _new(known.kind, fields(data[payload_at:to] + _ZEROS, 0))
        counters.messages += 1
        received.append(Received(known.source, message))
        self.tries += MESSAGE_TRIES
        return True

    def _is_unknown(self, data: bytes, at: int, length: int) -> bool:
        """Whether it is a frame of a number that the dialect lacks.

        Its checksum cannot be told: it may be garbage that hides good frames.
        """
        frame = data[at : at + length]
        if _number(frame) in _KINDS or not self._may_be_unknown(data, at, at + length):
            return False
        self.counters.unknown += 1
        if self._tap is not None:
            self._tap(frame, False)
        return True

    def _may_be_unknown(self, data: bytes, at: int, to: int) -> bool:
        """Whether what stands behind a frame of an unknown number speaks for it.

        It ends where the data end or the next frame begins, and no good frame begins inside it.
        """
        if to < len(data) and data[to] not in (_MARKER_V1, _MARKER_V2):
            return False
        return not self._begins_between(data, at + 1, to)

    def _begins_between(self, data: bytes, at: int, to: int) -> bool:
        """Whether a good frame begins from `at` to before `to`; no place is tried twice.

        `at` never goes back within a call of `feed`, so what was looked through before counts.
        Where there are too many places, one is taken to be good: nothing is lost by that.
        """
        if self._frame_at >= at:
            return self._frame_at < to
        place, enough = max(at, self._looked_to), self.tries + FALSE_TRIES_MAX
        while place < to and self.tries < enough:
            found = _next_marker(data, place, to)
            if found is None:
                self._looked_to = to
                return False
            place = found.start() + 1
            self._looked_to = place
            self.tries += 1
            if _good_frame(data, place - 1):
                self._frame_at = place - 1
                return True
        return place < to

    def _count(self, sequence: int) -> None:
        """A frame of the sender that is watched, and the gap before it."""
        counters = self.counters
        counters.watched += 1
        if self._sequence >= 0:
            gap = (sequence - self._sequence - 1) & 0xFF
            if gap > _MOST_LOST:  # it comes late: one that was counted as lost
                counters.lost = max(0, counters.lost - 1)
                return
            counters.lost += gap
        self._sequence = sequence

    def _looked_up(self, about: bytes) -> _Known | None:
        """What the dialect says of a message; None: it lacks it."""
        kind = _KINDS.get(about[2:])
        if kind is None:
            return None
        crc_extra, reader, heard = kind
        source = self._sources.get(about[:2]) or Source(about[0], about[1])
        is_watched = source == self._watched
        if reader is None:
            return _Known(source, is_watched, crc_extra, 0, None, None, None, heard)
        return _Known(source, is_watched, crc_extra, *reader, None)

    def _keep(self, about: bytes, known: _Known) -> None:
        """Of a good frame, so that it need not be looked up with every one."""
        if len(self._known) >= _MOST_KEPT:
            self._known.clear()
            self._sources.clear()
        known.is_kept = True
        self._known[about] = known
        self._sources[about[:2]] = known.source

    def _decoded(self, frame: bytes, heard: Callable[[Any], Inbound] | None) -> Inbound | None:
        """What pymavlink makes of it."""
        assert heard is not None
        try:
            return heard(self._dialect.decode(bytearray(frame)))
        except Exception:  # whatever pymavlink thinks of these bytes, it must not end a flight
            self.counters.undecodable += 1
            return None

    def _skip_to_marker(self, data: bytes, at: int) -> int:
        """The next place after `at` where a frame may begin."""
        found = _next_marker(data, at + 1)
        to = len(data) if found is None else found.start()
        self.counters.skipped_bytes += to - at
        return to


def _ended(crc: int, crc_extra: int) -> int:
    """A frame's checksum: that of its bytes, and one more that tells the message's layout."""
    return crc >> 8 ^ _ONE_BYTE[(crc ^ crc_extra) & 0xFF]


def starts_with_frame(data: bytes) -> bool:
    """Whether a datagram begins with a whole frame of a known message, checksum right."""
    return first_frame(data) != b""


def first_frame(data: bytes) -> bytes:
    """The whole frame of a known message that a datagram begins with; empty if it does not."""
    return _good_frame(data, 0)


def _good_frame(data: bytes, at: int) -> bytes:
    """The whole frame of a known message, checksum right, that begins here; empty if none does."""
    length = _frame_length(data, at) if at < len(data) else 0
    if length == 0 or at + length > len(data):
        return b""
    frame = data[at : at + length]
    kind = _KINDS.get(_number(frame))
    to = length - _CHECKSUM - (_SIGNATURE if frame[0] == _MARKER_V2 and frame[2] else 0)
    good = kind is not None and (
        _ended(checksum(frame[1:to]), kind[0]) == frame[to] | frame[to + 1] << 8
    )
    return frame if good else b""


def _frame_length(data: bytes, at: int) -> int:
    """Length of the frame that begins here, 0 if none does.

    If the header is not whole the length is that of the shortest header: more than there is.
    """
    marker = data[at]
    left = len(data) - at
    if marker == _MARKER_V2:
        if left < 3:
            return _HEADER_V2 + _CHECKSUM
        flags = data[at + 2]
        if flags & ~_SIGNED:
            return 0  # made in a way that we do not know: must not be read
        return _HEADER_V2 + data[at + 1] + _CHECKSUM + (_SIGNATURE if flags & _SIGNED else 0)
    if marker == _MARKER_V1:
        if left < 2:
            return _HEADER_V1 + _CHECKSUM
        return _HEADER_V1 + data[at + 1] + _CHECKSUM
    return 0


def _number(frame: bytes) -> bytes:
    """Of its message, as it stands in the frame."""
    return frame[5:6] if frame[0] == _MARKER_V1 else frame[7:10]


def _text(value: Any) -> str:
    """A char field, whichever way pymavlink hands it over."""
    return (
        value if isinstance(value, str) else bytes(value).split(b"\0")[0].decode("ascii", "replace")
    )


def _heartbeat(m: Any) -> Inbound:
    return Heartbeat(
        type=m.type,
        autopilot=m.autopilot,
        base_mode=m.base_mode,
        custom_mode=m.custom_mode,
        system_status=m.system_status,
    )


def _vision_position_estimate(m: Any) -> Inbound:
    pose = m.x, m.y, m.z, m.roll, m.pitch, m.yaw
    return VisionPositionEstimate(m.usec, *pose, tuple(m.covariance))


def _vfr_hud(m: Any) -> Inbound:
    return VfrHud(m.airspeed, m.alt)


def _sys_status(m: Any) -> Inbound:
    return SysStatus(m.onboard_control_sensors_present, m.onboard_control_sensors_health)


def _command_long(m: Any) -> Inbound:
    return CommandLong(
        target_system=m.target_system,
        target_component=m.target_component,
        command=m.command,
        confirmation=m.confirmation,
        params=(m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7),
    )


def _command_int(m: Any) -> Inbound:
    return CommandInt(
        m.target_system, m.target_component, m.command, (m.param1, m.param2, m.param3, m.param4)
    )


def _rc_channels(m: Any) -> Inbound:
    channels = tuple(int(getattr(m, f"chan{i}_raw")) for i in range(1, 19))
    return RcChannels(m.chancount, channels)


def _command_ack(m: Any) -> Inbound:
    return CommandAck(
        command=m.command,
        result=m.result,
        target_system=m.target_system,
        target_component=m.target_component,
    )


def _param_request_list(m: Any) -> Inbound:
    return ParamRequestList(m.target_system, m.target_component)


def _param_request_read(m: Any) -> Inbound:
    return ParamRequestRead(m.target_system, m.target_component, _text(m.param_id), m.param_index)


def _param_set(m: Any) -> Inbound:
    return ParamSet(
        target_system=m.target_system,
        target_component=m.target_component,
        param_id=_text(m.param_id),
        param_value=m.param_value,
        param_type=m.param_type,
    )


def _param_value(m: Any) -> Inbound:
    return ParamValue(
        param_id=_text(m.param_id),
        param_value=m.param_value,
        param_type=m.param_type,
        param_count=m.param_count,
        param_index=m.param_index,
    )


def _setup_signing(m: Any) -> Inbound:
    return SetupSigning(
        m.target_system, m.target_component, bytes(m.secret_key), m.initial_timestamp
    )


def _file_transfer_protocol(m: Any) -> Inbound:
    return FileTransferProtocol(m.target_system, m.target_component, bytes(m.payload))


_INBOUND: Final[dict[int, Callable[[Any], Inbound]]] = {
    dialect.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    dialect.MAVLINK_MSG_ID_VISION_POSITION_ESTIMATE: _vision_position_estimate,
    dialect.MAVLINK_MSG_ID_VFR_HUD: _vfr_hud,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    dialect.MAVLINK_MSG_ID_COMMAND_LONG: _command_long,
    dialect.MAVLINK_MSG_ID_COMMAND_INT: _command_int,
    dialect.MAVLINK_MSG_ID_COMMAND_ACK: _command_ack,
    dialect.MAVLINK_MSG_ID_RC_CHANNELS: _rc_channels,
    dialect.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: _param_request_list,
    dialect.MAVLINK_MSG_ID_PARAM_REQUEST_READ: _param_request_read,
    dialect.MAVLINK_MSG_ID_PARAM_SET: _param_set,
    dialect.MAVLINK_MSG_ID_PARAM_VALUE: _param_value,
    dialect.MAVLINK_MSG_ID_SETUP_SIGNING: _setup_signing,
    dialect.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL: _file_transfer_protocol,
}


# What is known of a message: what its checksum ends with, and who reads it, if anybody.
_Kind: TypeAlias = tuple[int, Reader | None, Callable[[Any], Inbound] | None]


def _kinds() -> dict[bytes, _Kind]:
    """By the number as it stands in a frame of either version."""
    kinds: dict[bytes, _Kind] = {}
    for number, message in dialect.mavlink_map.items():
        kind = message.crc_extra, READERS.get(number), _INBOUND.get(number)
        kinds[number.to_bytes(3, "little")] = kind
        if number <= _LARGEST_V1:
            kinds[bytes((number,))] = kind
    return kinds


_KINDS: Final = _kinds()
_WRITTEN: Final = {
    kind: (number, _KINDS[number.to_bytes(3, "little")][0], write)
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
        self.version1 = False  # speak MAVLink 1
        self._sequence = 0
        self._dialect: Any = dialect.MAVLink(None, source.system, source.component)

    def encode(self, message: Outbound) -> bytes:
        """One frame; empty if MAVLink 1 was asked for and has no such message.

        Errors: `struct.error` for a field that does not fit its place: a mistake of ours.
        """
        signing = self._signing
        key = signing.key if signing is not None and not self.version1 else None
        timestamp = signing.next_timestamp() if signing is not None and key is not None else 0
        kind = type(message)
        if isinstance(message, RcChannelsOverride):
            frame = self._override(message, key, timestamp)
        elif kind in _WRITTEN:
            frame = self._framed(kind, message, key, timestamp)
        else:
            frame = self._packed(message, key, timestamp)
        if frame:
            self._sequence = (self._sequence + 1) & 0xFF
        return frame

    def _override(self, message: RcChannelsOverride, key: bytes | None, timestamp: int) -> bytes:
        """What every tick says."""
        body, source = b"", self.source
        if not self.version1:
            flags = 0 if key is None else _SIGNED
            body = override_body(message, flags, self._sequence, source[0], source[1])
        if not body:
            return self._framed(RcChannelsOverride, message, key, timestamp)
        frame = b"\xfd" + body + _ended(checksum(body), _OVERRIDE_EXTRA).to_bytes(2, "little")
        return frame if key is None else signed(frame, key, self._link_id, timestamp)

    def _framed(
        self, kind: type[Outbound], message: Outbound, key: bytes | None, timestamp: int
    ) -> bytes:
        """Around a payload of ours."""
        number, crc_extra, write = _WRITTEN[kind]
        if self.version1 and number > _LARGEST_V1:
            return b""
        payload = write(message)
        system, component = self.source
        if self.version1:
            body = bytes((len(payload), self._sequence, system, component, number)) + payload
            return b"\xfe" + body + _ended(checksum(body), crc_extra).to_bytes(2, "little")
        payload = payload.rstrip(b"\0") or b"\0"
        flags = 0 if key is None else _SIGNED
        head = bytes((len(payload), flags, 0, self._sequence, system, component))
        body = head + number.to_bytes(3, "little") + payload
        frame = b"\xfd" + body + _ended(checksum(body), crc_extra).to_bytes(2, "little")
        return frame if key is None else signed(frame, key, self._link_id, timestamp)

    def _packed(self, message: Outbound, key: bytes | None, timestamp: int) -> bytes:
        """By pymavlink."""
        packable = _OUTBOUND[type(message)](message)
        if self.version1 and packable.id > _LARGEST_V1:
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


def _pack_heartbeat(m: Any) -> Any:
    return dialect.MAVLink_heartbeat_message(
        m.type, m.autopilot, m.base_mode, m.custom_mode, m.system_status, 3
    )


def _pack_command_long(m: Any) -> Any:
    return dialect.MAVLink_command_long_message(
        m.target_system, m.target_component, m.command, m.confirmation, *m.params
    )


def _pack_command_ack(m: Any) -> Any:
    return dialect.MAVLink_command_ack_message(
        m.command, m.result, m.progress, 0, m.target_system, m.target_component
    )


def _pack_param_request_read(m: Any) -> Any:
    return dialect.MAVLink_param_request_read_message(
        m.target_system, m.target_component, chars(m.param_id, 16), m.param_index
    )


def _pack_param_error(m: Any) -> Any:
    return dialect.MAVLink_param_error_message(
        m.target_system,
        m.target_component,
        chars(m.param_id, 16),
        m.param_index,
        m.error,
    )


def _pack_param_value(m: Any) -> Any:
    return dialect.MAVLink_param_value_message(
        chars(m.param_id, 16),
        float32(m.param_value),
        m.param_type,
        m.param_count,
        m.param_index,
    )


def _pack_file_transfer_protocol(m: Any) -> Any:
    return dialect.MAVLink_file_transfer_protocol_message(
        0, m.target_system, m.target_component, list(m.payload)
    )


def _pack_status_text(m: Any) -> Any:
    return dialect.MAVLink_statustext_message(m.severity, chars(m.text, 50), m.id, m.chunk_seq)


def _pack_manual_control(m: Any) -> Any:
    return dialect.MAVLink_manual_control_message(m.target, m.x, m.y, m.z, m.r, 0)


def _pack_set_actuator_control_target(m: Any) -> Any:
    return dialect.MAVLink_set_actuator_control_target_message(
        m.time_usec,
        m.group,
        m.target_system,
        m.target_component,
        list(map(float32, m.controls)),
    )


def _pack_autopilot_version(m: Any) -> Any:
    nothing = [0] * 8
    return dialect.MAVLink_autopilot_version_message(
        m.capabilities, m.flight_sw_version, 0, 0, 0, nothing, nothing, nothing, 0, 0, 0
    )


def _pack_message_interval(m: Any) -> Any:
    return dialect.MAVLink_message_interval_message(m.message_id, m.interval_us)


def _pack_nav_controller_output(m: Any) -> Any:
    return dialect.MAVLink_nav_controller_output_message(
        m.nav_roll,
        m.nav_pitch,
        m.nav_bearing,
        m.target_bearing,
        m.wp_dist,
        m.alt_error,
        m.aspd_error,
        m.xtrack_error,
    )


def _pack_wind_cov(m: Any) -> Any:
    unknown = float("nan")
    return dialect.MAVLink_wind_cov_message(
        m.time_usec,
        *(m.wind_x, m.wind_y, m.wind_z),
        *(unknown, unknown, unknown),  # variability in a second, altitude above the sea
        m.horiz_accuracy,
        m.vert_accuracy,
    )


def _pack_odometry(m: Any) -> Any:
    return dialect.MAVLink_odometry_message(
        m.time_usec,
        m.frame_id,
        m.child_frame_id,
        *map(float32, (m.x, m.y, m.z)),
        list(m.q),
        *map(float32, (m.vx, m.vy, m.vz, m.rollspeed, m.pitchspeed, m.yawspeed)),
        list(map(float32, m.pose_covariance)),
        list(map(float32, m.velocity_covariance)),
        0,
        m.estimator_type,
    )


def _pack_vision_position_estimate(m: Any) -> Any:
    pose = map(float32, (m.x, m.y, m.z, m.roll, m.pitch, m.yaw))
    covariance = list(map(float32, m.covariance))
    return dialect.MAVLink_vision_position_estimate_message(m.usec, *pose, covariance)


_OUTBOUND: Final[dict[type[Outbound], Callable[[Any], Any]]] = {
    Heartbeat: _pack_heartbeat,
    CommandLong: _pack_command_long,
    CommandAck: _pack_command_ack,
    ParamRequestRead: _pack_param_request_read,
    ParamError: _pack_param_error,
    ParamValue: _pack_param_value,
    FileTransferProtocol: _pack_file_transfer_protocol,
    StatusText: _pack_status_text,
    ManualControl: _pack_manual_control,
    SetActuatorControlTarget: _pack_set_actuator_control_target,
    AutopilotVersion: _pack_autopilot_version,
    MessageInterval: _pack_message_interval,
    NavControllerOutput: _pack_nav_controller_output,
    WindCov: _pack_wind_cov,
    Odometry: _pack_odometry,
    VisionPositionEstimate: _pack_vision_position_estimate,
}
