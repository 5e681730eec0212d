"""Bytes to messages.

Framing is ours: a stream or a datagram is cut into MAVLink 1 and 2 frames whose checksum is
right; after anything else the search continues at the very next byte, so that garbage, a cut
frame or a marker inside a payload costs no good frame behind it.  The payloads of every tick
are read by `hot_frames`, all others by pymavlink's dialect, and only those of messages that a
part of this program reads.

The work is linear in the bytes, whoever made them: a place is tried as the beginning of a frame
twice at most, and a try looks at no more than the longest frame.  `feed` takes a limit on the
work of one call; the rest waits for the next.

Nothing that arrives raises.  Nothing untyped leaves this file.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from tgl_soar.link.frames import (
    CHECKSUM_OF_BYTE,
    CRC_EXTRAS,
    HEADER_V1,
    HEADER_V2,
    MARKER_V1,
    MARKER_V2,
    SHORTEST_V2,
    checksum,
    frame_length,
    good_frame,
    number_in_frame,
)
from tgl_soar.link.hot_frames import READERS, Reader
from tgl_soar.link.inbound_messages import INBOUND
from tgl_soar.link.messages import Inbound, Received, Source

_new: Final[Any] = tuple.__new__  # a named tuple of all its fields in a tuple

_MOST_LOST: Final = 200  # in a row: a larger gap is a frame that was overtaken
_MOST_KEPT: Final = 256  # of what is known of a message and its sender
_ZEROS: Final = bytes(255)  # what was cut off a payload
_next_marker: Final = re.compile(rb"[\xfd\xfe]").search

# What a call of `feed` may do, in tries: to take a piece of bytes as a frame is one.  A message
# that is read is decoded, checked for its signature and acted on besides.
UNLIMITED: Final = 1 << 60
MESSAGE_TRIES: Final = 8
# Two bytes of 256 begin a frame: 2 kB of a line's noise hold 16 +- 4 of them.  A datagram with
# four times as many false ones is no noise: the rest of it is not looked at.
FALSE_TRIES_MAX: Final = 64

# What is known of a message: its CRC_EXTRA, and who reads it, if anybody.
_Message: TypeAlias = tuple[int, Reader | None, Callable[[Any], Inbound] | None]


def _messages() -> dict[bytes, _Message]:
    """By the number as it stands in a frame of either version."""
    messages: dict[bytes, _Message] = {}
    for key, crc_extra in CRC_EXTRAS.items():
        number = int.from_bytes(key, "little")
        messages[key] = crc_extra, READERS.get(number), INBOUND.get(number)
    return messages


_MESSAGES: Final = _messages()


@dataclass(slots=True)
class DecoderCounters:
    """What was received on a link."""

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
class _KnownHeader:
    """What is known of frames with one message number and one sender."""

    source: Source
    is_watched: bool  # its sender's sequence is
    crc_extra: int
    # Of a message that `hot_frames` reads: bytes that are read, its type, its readers.
    needed: int
    kind: type[Inbound] | None
    fields: Callable[[bytes, int], tuple[Any, ...]] | None
    all_fields: Callable[[bytes, int], tuple[Any, ...]] | None
    # Of another message that is used: from pymavlink's.
    convert: Callable[[Any], Inbound] | None
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
        """`stream`: a frame may continue in the next piece, as on a serial line.

        `accept`: whether a whole, good frame may be accepted.  `tap`: is shown every whole frame,
        also of messages that are not used, and whether it was accepted.
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
        self._received_v2 = False
        self._known: dict[
            bytes, _KnownHeader
        ] = {}  # by sender and number, as they stand in a frame
        self._sources: dict[bytes, Source] = {}  # of these
        self._watched: Source | None = None
        self._sequence = -1

    def watch(self, source: Source) -> None:
        """Count what is lost of one sender's frames."""
        self._watched = source
        self._known.clear()

    def feed(self, data: bytes, most_tries: int = UNLIMITED) -> list[Received]:
        """The messages that end in this piece, in order.

        `most_tries`: the limit on the work of this call.  What is left of the piece waits for
        the next call; while something waits `data` must be empty.
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
            if data[at] == MARKER_V2 and end - at >= SHORTEST_V2 and data[at + 2] == 0:
                length = SHORTEST_V2 + data[at + 1]  # nearly always
            else:
                length = frame_length(data, at)
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
        """Whether received bytes are still to be decoded."""
        return self._waiting != b""

    def _is_given_up(self) -> bool:
        """Count one more place of a datagram that is no frame; whether to leave the rest unread."""
        self._false_tries += 1
        if self._stream or self._false_tries <= FALSE_TRIES_MAX:
            return False
        self.counters.given_up += 1
        return True

    def reset(self) -> None:
        """Discard a frame that was begun: the line was interrupted."""
        self._rest = self._waiting = b""
        self._sequence = -1
        self.only_v1 = self._received_v2 = False

    def _take(self, data: bytes, at: int, length: int, received: list[Received]) -> bool:
        """Read what has the length of a frame; whether it is one, of a known message."""
        version1 = data[at] == MARKER_V1
        if version1:
            sequence, about, payload_at = data[at + 2], data[at + 3 : at + 6], at + HEADER_V1
        else:
            sequence, about, payload_at = data[at + 4], data[at + 5 : at + 10], at + HEADER_V2
        known = self._known.get(about)
        if known is None:
            known = self._looked_up(about)
            if known is None:
                return False
        size = data[at + 1]
        to = payload_at + size
        crc = checksum(data[at + 1 : to])
        if (
            crc >> 8 ^ CHECKSUM_OF_BYTE[(crc ^ known.crc_extra) & 0xFF]
            != data[to] | data[to + 1] << 8
        ):
            self.counters.bad_checksums += 1
            return False
        counters = self.counters
        counters.frames += 1
        frame = data if length == len(data) else data[at : at + length]
        is_accepted = self._accept is None or self._accept(frame)
        if self._tap is not None:
            self._tap(frame, is_accepted)
        if version1:
            self.only_v1 = not self._received_v2
        elif not self._received_v2:
            self._received_v2, self.only_v1 = True, False
        if not known.is_kept:
            self._keep(about, known)
        if known.is_watched:
            self._count(sequence)
        if not is_accepted:
            counters.refused += 1
            return True
        fields = known.fields
        if fields is None and known.convert is None:
            return True
        if fields is None:
            message: Inbound | None = self._decoded(frame, known.convert)
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

        Its checksum cannot be checked: it may be garbage that hides good frames.
        """
        frame = data[at : at + length]
        if number_in_frame(frame) in _MESSAGES or not self._may_be_unknown(data, at, at + length):
            return False
        self.counters.unknown += 1
        if self._tap is not None:
            self._tap(frame, False)
        return True

    def _may_be_unknown(self, data: bytes, at: int, to: int) -> bool:
        """Whether the bytes around allow that this is a frame of an unknown number.

        It ends where the data end or the next frame begins, and no good frame begins inside it.
        """
        if to < len(data) and data[to] not in (MARKER_V1, MARKER_V2):
            return False
        return not self._begins_between(data, at + 1, to)

    def _begins_between(self, data: bytes, at: int, to: int) -> bool:
        """Whether a good frame begins from `at` to before `to`; no place is tried twice.

        `at` never decreases within a call of `feed`, so what was searched before counts.
        Where there are too many places, one is assumed to be good: nothing is lost by that.
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
            if good_frame(data, place - 1):
                self._frame_at = place - 1
                return True
        return place < to

    def _count(self, sequence: int) -> None:
        """Count a frame of the watched sender, and the gap before it."""
        counters = self.counters
        if sequence == self._sequence:  # the last one again: it was not lost, nor was another
            return
        counters.watched += 1
        if self._sequence >= 0:
            gap = (sequence - self._sequence - 1) & 0xFF
            if gap > _MOST_LOST:  # a late one that was counted as lost
                counters.lost = max(0, counters.lost - 1)
                return
            counters.lost += gap
        self._sequence = sequence

    def _looked_up(self, about: bytes) -> _KnownHeader | None:
        """What is known of a sender's message; None: the dialect lacks it."""
        message = _MESSAGES.get(about[2:])
        if message is None:
            return None
        crc_extra, reader, convert = message
        source = self._sources.get(about[:2]) or Source(about[0], about[1])
        is_watched = source == self._watched
        if reader is None:
            return _KnownHeader(
                source=source,
                is_watched=is_watched,
                crc_extra=crc_extra,
                needed=0,
                kind=None,
                fields=None,
                all_fields=None,
                convert=convert,
            )
        return _KnownHeader(
            source=source,
            is_watched=is_watched,
            crc_extra=crc_extra,
            needed=reader.size,
            kind=reader.kind,
            fields=reader.fields,
            all_fields=reader.all_fields,
            convert=None,
        )

    def _keep(self, about: bytes, known: _KnownHeader) -> None:
        """Keep what is known of a good frame, so that it is looked up once."""
        if len(self._known) >= _MOST_KEPT:
            self._known.clear()
            self._sources.clear()
        known.is_kept = True
        self._known[about] = known
        self._sources[about[:2]] = known.source

    def _decoded(self, frame: bytes, convert: Callable[[Any], Inbound] | None) -> Inbound | None:
        """The message as pymavlink decodes it; None: it cannot."""
        assert convert is not None
        try:
            return convert(self._dialect.decode(bytearray(frame)))
        except Exception:  # no error of pymavlink may end a flight
            self.counters.undecodable += 1
            return None

    def _skip_to_marker(self, data: bytes, at: int) -> int:
        """The next place after `at` where a frame may begin."""
        found = _next_marker(data, at + 1)
        to = len(data) if found is None else found.start()
        self.counters.skipped_bytes += to - at
        return to
