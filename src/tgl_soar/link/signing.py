"""MAVLink 2 signing: who does not know the key is not heard.

    signature = first 6 bytes of SHA-256(key, frame up to and with link id and timestamp)

Timestamps count 10 µs since 2015 and must grow from frame to frame of one stream (link id,
system, component), so that a frame recorded from the air is worth nothing; a stream not yet
known must not be more than a minute behind.  Ours never goes back: it is the wall clock, or
what a peer has signed with, or what was kept in a file before a restart, whichever is latest
(a companion without a battery for its clock starts in the past).  A timestamp that no working
clock shows is never taken over: at the end of its 48 bits nothing could be signed any more, and
far in the future we would hold every station for a replay.

The signature is looked at before the timestamp is believed: otherwise anybody could shut an
operator out with one forged frame from the far future.
"""

from __future__ import annotations

import hashlib
import hmac
from dataclasses import dataclass
from typing import Final

from .messages import Source

KEY_BYTES: Final = 32
TICKS_PER_S: Final = 100_000
EPOCH_S: Final = 1_420_070_400.0  # 2015-01-01, of the wall clock
NEW_STREAM_TICKS: Final = 60 * TICKS_PER_S
CLOCK_IS_SET_S: Final = 1_767_225_600.0  # 2026-01-01: an earlier wall clock was never set
# So far may another clock be ahead of one that is set: a clock kept in a file over a winter is
# late by months.  Of one that was not set nothing is known but the half of 48 bits, until 2059.
YEAR_TICKS: Final = 366 * 86_400 * TICKS_PER_S
LATEST: Final = 2**47
MAX_STREAMS: Final = 64
_MARKER_V2: Final = 0xFD
_SIGNED: Final = 0x01
_HEADER: Final = 10
_SHARE: Final = 6  # bytes of the hash that are sent
_BLOCK: Final = 13  # link id, timestamp, signature


@dataclass(slots=True)
class SigningCounters:
    """What was let in and what was not."""

    good: int = 0
    unsigned: int = 0  # refused
    wrong: int = 0  # another key, or none at all
    replayed: int = 0  # or overtaken by a later one
    excused: int = 0  # unsigned, and let in because its sender may


class Signing:
    """One key for all links.  Without a key everything is let in and nothing is signed."""

    def __init__(self, key: bytes | None, wall_s: float, now_s: float, kept: int = 0) -> None:
        """`wall_s`: seconds since 1970 at now_s of our clock; `kept`: a timestamp used before."""
        self.counters = SigningCounters()
        self.key = key
        self._latest = _latest(wall_s)
        self.kept_is_damaged = not 0 <= kept <= self._latest
        self.timestamp = 0 if self.kept_is_damaged else kept
        self._wall_less_now_s = wall_s - now_s
        self._streams: dict[tuple[int, Source], int] = {}
        self.advance(now_s)

    @property
    def is_on(self) -> bool:
        """Whether there is a key."""
        return self.key is not None

    def advance(self, now_s: float) -> None:
        """Our clock has moved on."""
        wall_s = now_s + self._wall_less_now_s - EPOCH_S
        self.timestamp = max(self.timestamp, int(wall_s * TICKS_PER_S))

    def next_timestamp(self) -> int:
        """For a frame of ours: later than all before."""
        self.timestamp += 1
        return self.timestamp

    def may_begin_with(self, timestamp: int) -> bool:
        """Whether a timestamp can be that of a working clock."""
        return timestamp <= self._latest

    def replace_key(self, key: bytes, timestamp: int) -> None:
        """Another key, and the timestamp to begin with if it is later than ours."""
        self.key = key
        self._follow(timestamp)
        self._streams.clear()

    def vouches(self, frame: bytes) -> bool:
        """Whether a whole frame would be let in; nothing is remembered."""
        return self.key is None or (_is_signed(frame) and self._is_ours(frame, self.key))

    def lets_in(self, frame: bytes, *, excused: bool = False) -> bool:
        """Whether to believe a whole frame.  `excused`: its sender need not sign."""
        if self.key is None:
            return True
        counters = self.counters
        if not _is_signed(frame):
            counters.excused += excused
            counters.unsigned += not excused
            return excused
        if not self._is_ours(frame, self.key):
            counters.wrong += 1
            return False
        stream, timestamp = (frame[-_BLOCK], source_of(frame)), _timestamp(frame)
        newest = self._streams.get(stream, self.timestamp - NEW_STREAM_TICKS)
        if timestamp <= newest or (stream not in self._streams and self._is_full):
            counters.replayed += 1
            return False
        self._streams[stream] = timestamp
        self._follow(timestamp)
        counters.good += 1
        return True

    def _follow(self, timestamp: int) -> None:
        if self.may_begin_with(timestamp):
            self.timestamp = max(self.timestamp, timestamp)

    @property
    def _is_full(self) -> bool:
        return len(self._streams) >= MAX_STREAMS

    @staticmethod
    def _is_ours(frame: bytes, key: bytes) -> bool:
        return hmac.compare_digest(_signature(frame[:-_SHARE], key), frame[-_SHARE:])


def _latest(wall_s: float) -> int:
    """What is later than this was shown by no working clock."""
    if wall_s < CLOCK_IS_SET_S:
        return LATEST
    return int((wall_s - EPOCH_S) * TICKS_PER_S) + YEAR_TICKS


def signed(frame: bytes, key: bytes, link_id: int, timestamp: int) -> bytes:
    """A whole frame, flagged as signed, with its signature."""
    unsigned = frame + bytes((link_id,)) + timestamp.to_bytes(6, "little")
    return unsigned + _signature(unsigned, key)


def source_of(frame: bytes) -> Source:
    """The sender of a frame of either version."""
    at = 5 if frame[0] == _MARKER_V2 else 3
    return Source(frame[at], frame[at + 1])


def _signature(frame: bytes, key: bytes) -> bytes:
    """Of all that stands before it."""
    return hashlib.sha256(key + frame).digest()[:_SHARE]


def _is_signed(frame: bytes) -> bool:
    long_enough = len(frame) >= _HEADER + _BLOCK
    return long_enough and frame[0] == _MARKER_V2 and frame[2] & _SIGNED != 0


def _timestamp(frame: bytes) -> int:
    return int.from_bytes(frame[-_BLOCK + 1 : -_SHARE], "little")
