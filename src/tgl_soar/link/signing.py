"""MAVLink 2 signing: frames without the key are ignored.

    signature = first 6 bytes of SHA-256(key, frame up to and with link id and timestamp)

Timestamps ("stamps") count 10 µs since 2015 and must grow from frame to frame of one stream (link
id, system, component), so that a frame recorded from the air is worth nothing.  Ours never goes
back: it is the wall clock, or what a peer has signed with, or what was kept in a file before a
restart, whichever is latest (a companion without a battery for its clock starts in the past).  A
timestamp that no working clock shows is never taken over, and commands nothing: at the end of its
48 bits nothing could be signed any more, and far in the future we would hold every station for a
replay.

A restart loses the streams, and must not make old records good again.  One number stands for
all of them: `reserved`, which a file holds and which lies ahead of every stamp taken so far.  The
next start begins behind it, so that

    any frame     must be later than what was kept, and than the newest of its stream; one of a
                  stream not yet known must not be more than 10 s behind us
    a command     must besides be later than our own stamp was at the start of this process, must
                  not have been held back for more than 10 s on its way, and is obeyed only once
                  a stamp beyond its own is on the disk

Honest stations sign by clocks of their own.  One that receives us continues from our stamp, as
MAVLink has it (its C library and pymavlink do), and is later than our start at once.  One that does
not (it signs by its wall clock alone) and is behind us by d commands d later after a start.
Held back is what lags by more than 10 s behind us *and* behind its own stream's pace: a clock that
is merely wrong, or another station's that is far ahead, shuts no operator out in flight.

A disk that does not answer shuts no operator out either: what waits for it is obeyed when it is
late (`DISK_S`), as is everything where the file cannot be written at all, which is reported.

The signature is checked before the timestamp is used: otherwise anybody could shut an
operator out with one forged frame from the far future.
"""

from __future__ import annotations

import hashlib
import hmac
from dataclasses import dataclass
from math import inf
from typing import Final

from tgl_soar.link.frames import HEADER_V2, MARKER_V2, SIGNATURE, SIGNED
from tgl_soar.link.messages import Source

KEY_BYTES: Final = 32
TICKS_PER_S: Final = 100_000
EPOCH_S: Final = 1_420_070_400.0  # 2015-01-01, of the wall clock
LAST_STAMP: Final = 2**48 - 1
NEW_STREAM_TICKS: Final = 10 * TICKS_PER_S
DISK_S: Final = 0.5  # so long a command, perhaps to hand over, waits for the disk
CLOCK_IS_SET_S: Final = 1_767_225_600.0  # 2026-01-01: an earlier wall clock was never set
# So far may another clock be ahead of one that is set: a clock kept in a file over a winter is
# late by months.  Of one that was not set nothing is known but the half of 48 bits, until 2059.
YEAR_TICKS: Final = 366 * 86_400 * TICKS_PER_S
LATEST: Final = 2**47
MAX_STREAMS: Final = 64
# COMMAND_INT, COMMAND_LONG, PARAM_SET, SETUP_SIGNING; and should they ever be used:
# SET_MODE, MANUAL_CONTROL, RC_CHANNELS_OVERRIDE.  Not RC_CHANNELS, which the autopilot streams:
# the pilot's switch must work whatever the disk does, and replaying a stream needs its silence.
COMMANDS: Final = frozenset((75, 76, 23, 256, 11, 69, 70))
_FRACTION: Final = 6  # bytes of the hash that are sent


@dataclass(slots=True)
class SigningCounters:
    """What was let in and what was not."""

    good: int = 0
    unsigned: int = 0  # refused
    wrong: int = 0  # another key, or none at all
    replayed: int = 0  # or overtaken by a later one, or too old
    early: int = 0  # commands that came before their stamp was reserved on the disk
    excused: int = 0  # unsigned, and let in because its sender may


@dataclass(slots=True)
class _Stream:
    """What one sender has signed with on one of its links."""

    newest: int
    received: int  # our clock then, in ticks


class Signing:
    """One key for all links.  Without a key everything is accepted and nothing is signed."""

    def __init__(self, key: bytes | None, wall_s: float, now_s: float, kept: int = 0) -> None:
        """`wall_s`: seconds since 1970 at now_s of our clock; `kept`: a timestamp used before."""
        self.counters = SigningCounters()
        self.key = key
        self._latest = _latest(wall_s)
        self.kept_is_damaged = not 0 <= kept <= self._latest
        kept = 0 if self.kept_is_damaged else kept
        self.timestamp = kept
        self.reserved = LAST_STAMP  # on the disk: the next start begins behind it
        self._wall_less_now_s = wall_s - now_s
        self._clock = 0  # ours in ticks, whatever peers sign with
        self._kept = kept
        self._streams: dict[tuple[int, Source], _Stream] = {}
        self._waits_since_s = inf  # for the disk to reserve what we sign with
        self._disk_is_late = False
        self.advance(now_s)
        self._began = self.timestamp

    @property
    def is_on(self) -> bool:
        """Whether there is a key."""
        return self.key is not None

    def advance(self, now_s: float) -> None:
        """Our clock has moved on."""
        wall_s = now_s + self._wall_less_now_s - EPOCH_S
        self._clock = int(wall_s * TICKS_PER_S)
        self.timestamp = max(self.timestamp, self._clock)
        if self.timestamp <= self.reserved:
            self._waits_since_s = inf
        elif self._waits_since_s == inf:
            self._waits_since_s = now_s
        self._disk_is_late = now_s - self._waits_since_s > DISK_S

    def next_timestamp(self) -> int:
        """For a frame of ours: later than all before."""
        self.timestamp += 1
        return self.timestamp

    def may_begin_with(self, timestamp: int) -> bool:
        """Whether a timestamp can be that of a working clock."""
        return timestamp <= self._latest

    def replace_key(self, key: bytes, timestamp: int) -> None:
        """Another key, and the timestamp to begin with if it is later than ours.

        The same one once more changes nothing: records of a moment ago stay old.
        """
        if key != self.key:
            self._streams.clear()
        self.key = key
        self._follow(timestamp)

    def vouches(self, frame: bytes) -> bool:
        """Whether a whole frame would be accepted; nothing is remembered."""
        return self.key is None or (
            _is_signed(frame) and self._is_fresh(frame) and self._is_ours(frame, self.key)
        )

    def accepts(self, frame: bytes, *, excused: bool = False) -> bool:
        """Whether to accept a whole frame.  `excused`: its sender need not sign."""
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
        if not self._is_fresh(frame):
            counters.replayed += 1
            return False
        stamp = _timestamp(frame)
        self._streams[_stream_of(frame)] = _Stream(stamp, self._clock)
        self._follow(stamp)
        if stamp > self.reserved and not self._disk_is_late and _number(frame) in COMMANDS:
            counters.early += 1
            return False
        counters.good += 1
        return True

    def _follow(self, timestamp: int) -> None:
        if self.may_begin_with(timestamp):
            self.timestamp = max(self.timestamp, timestamp)

    def _is_fresh(self, frame: bytes) -> bool:
        """Whether a signed frame cannot be a record of an earlier one, or held back."""
        stamp, commands = _timestamp(frame), _number(frame) in COMMANDS
        if stamp <= self._kept or (commands and stamp <= self._began):
            return False
        if commands and not self.may_begin_with(stamp):
            return False  # it could not be remembered over a restart
        is_behind = stamp <= self.timestamp - NEW_STREAM_TICKS
        stream = self._streams.get(_stream_of(frame))
        if stream is None:
            return not is_behind and self._has_room()
        lag = (self._clock - stream.received) - (stamp - stream.newest)
        is_held_back = commands and is_behind and lag > NEW_STREAM_TICKS
        return stamp > stream.newest and not is_held_back

    def _has_room(self) -> bool:
        """For one more stream.

        Only streams are dropped all of whose frames would be too old for a new one.
        """
        if len(self._streams) >= MAX_STREAMS:
            oldest = self.timestamp - NEW_STREAM_TICKS
            self._streams = {n: s for n, s in self._streams.items() if s.newest > oldest}
        return len(self._streams) < MAX_STREAMS

    @staticmethod
    def _is_ours(frame: bytes, key: bytes) -> bool:
        return hmac.compare_digest(_signature(frame[:-_FRACTION], key), frame[-_FRACTION:])


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
    at = 5 if frame[0] == MARKER_V2 else 3
    return Source(frame[at], frame[at + 1])


def _stream_of(frame: bytes) -> tuple[int, Source]:
    """Link id and sender of a signed frame."""
    return frame[-SIGNATURE], source_of(frame)


def _signature(frame: bytes, key: bytes) -> bytes:
    """Of all that stands before it."""
    return hashlib.sha256(key + frame).digest()[:_FRACTION]


def _is_signed(frame: bytes) -> bool:
    long_enough = len(frame) >= HEADER_V2 + SIGNATURE
    return long_enough and frame[0] == MARKER_V2 and frame[2] & SIGNED != 0


def _number(frame: bytes) -> int:
    """Of the message in a MAVLink 2 frame."""
    return int.from_bytes(frame[7:10], "little")


def _timestamp(frame: bytes) -> int:
    return int.from_bytes(frame[-SIGNATURE + 1 : -_FRACTION], "little")
