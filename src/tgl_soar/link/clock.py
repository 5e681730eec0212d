"""The vehicle's clock against ours.

A sample is stamped by the vehicle when it was true and arrives d later:

    arrival = stamp + offset + d,    d >= 0

The smallest arrival - stamp seen is the offset plus the smallest delay; the jitter of all other
samples is gone.  It is forgotten at `FORGET` per second, so that two quartzes that run apart
are followed; a constant part of the delay cannot be seen (EST_DELAY is for that).

A vehicle that restarts counts from zero again.  Heard again late, its stamps may be above the
last one all the same, and then are late by a constant: after a skip in its stamps, that is a new
clock too, unless another of its streams still comes in time.  One whose stamps go on without a
skip is late itself, as after a stall of ours or on a link with a queue.  (For a clock that is not
the autopilot's, whose other streams nobody hears, it always is.)

A stamp that counts milliseconds in 32 bits begins again at zero after 49.7 days, one that counts
microseconds after 71.6 minutes; and one of whole milliseconds is made finer by `sensor_clock`.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import Final

from .sensor_clock import SensorClock

FORGET: Final = 1e-4  # s/s: more than two quartzes drift apart
REBOOT_S: Final = 1.0  # further back than this, it may have begun anew
REBOOT_STAMPS: Final = 3  # so many in a row that count on from there: it has
LATE_S: Final = 1.0  # later at once than before, and so much that nothing can be done with it
SKIP_S: Final = 0.25  # between two stamps: what is only late has none
STEADY_LATE_S: Final = 0.5  # late by the same for so long
SAME_S: Final = 0.2
MILLISECONDS_WRAP_S: Final = 2**32 * 1e-3
MICROSECONDS_WRAP_S: Final = 2**32 * 1e-6
NEAR_WRAP_S: Final = 300.0  # further from it a clock that has gone back began anew
STAMP_MAX_S: Final = 1e10  # 317 years: no clock says so, and a double is finer than 2 us up to here
SHARED_S: Final = 0.5  # streams whose offsets are no further apart have one clock

NAN: Final = float("nan")


class ClockMap:
    """Maps one stream's stamps to our clock."""

    __slots__ = ("_arrival_s", "offset_s")

    def __init__(self) -> None:
        self.offset_s = NAN
        self._arrival_s = NAN

    def reset(self) -> None:
        """Nothing is known."""
        self.offset_s = NAN
        self._arrival_s = NAN

    def observe(self, stamp_s: float, arrival_s: float) -> float:
        """Take in one sample; its time on our clock, never later than its arrival."""
        seen = arrival_s - stamp_s
        kept = self.offset_s + FORGET * max(0.0, arrival_s - self._arrival_s)
        self.offset_s = kept if kept <= seen else seen  # NaN: the first sample
        self._arrival_s = arrival_s
        return stamp_s + self.offset_s


class Lateness:
    """Tells a clock that began anew, above the last stamp heard, from samples that are late."""

    __slots__ = (
        "_count", "_late_s", "_since_s", "_stamp_s", "_suspected_s", "begun_s", "timely_s"
    )  # fmt: skip

    def __init__(self) -> None:
        self.begun_s = NAN
        self.timely_s = NAN  # when the last sample came that was in time
        self._stamp_s = NAN
        self._late_s = 0.0
        self._suspected_s = NAN  # since when it may be a new clock
        self._since_s = NAN  # since when it has been late by the same
        self._count = 0

    def judge(self, stamp_s: float, late_s: float, arrival_s: float) -> float:
        """Since when it has been a new clock; NaN: it is not.  late_s: against its map."""
        skipped_s, self._stamp_s = stamp_s - self._stamp_s, stamp_s
        if late_s != late_s:
            self.begun_s = arrival_s
        if not late_s > LATE_S:  # NaN: the first one
            self.timely_s, self._late_s, self._suspected_s = arrival_s, late_s, NAN
            return NAN
        if skipped_s > SKIP_S and late_s - self._late_s > LATE_S:
            self._suspected_s = arrival_s
        if self._suspected_s != self._suspected_s:
            self._late_s = late_s
            return NAN
        if abs(late_s - self._late_s) > SAME_S:
            self._late_s, self._since_s, self._count = late_s, arrival_s, 0
        self._count += 1
        lasts = arrival_s - self._since_s >= STEADY_LATE_S and self._count >= REBOOT_STAMPS
        return self._suspected_s if lasts else NAN


class StampOrder:
    """Tells new stamps of one stream from repeated, late and rebooted ones.

    One old stamp is a frame that was long under way; only several that count on from each other
    are a vehicle that began anew.
    """

    NEW: Final = 0
    STALE: Final = 1
    REBOOT: Final = 2

    __slots__ = ("_behind", "_behind_s", "newest_s")

    def __init__(self) -> None:
        self.newest_s = NAN
        self._behind = 0
        self._behind_s = NAN

    def judge(self, stamp_s: float) -> int:
        """What a stamp says, and remember it if it is new."""
        if not stamp_s <= self.newest_s:  # NaN: the first one
            self.newest_s = stamp_s
            self._behind = 0
            return self.NEW
        if stamp_s >= self.newest_s - REBOOT_S:
            return self.STALE
        self._behind = self._behind + 1 if self._behind and stamp_s > self._behind_s else 1
        self._behind_s = stamp_s
        if self._behind < REBOOT_STAMPS:
            return self.STALE
        self.newest_s = stamp_s
        self._behind = 0
        return self.REBOOT


class Stream:
    """What is known of the stamps of one stream."""

    __slots__ = (
        "_ahead_s",
        "_newest_s",
        "_wrap_s",
        "foreign",
        "lateness",
        "map",
        "order",
        "sensor",
    )

    def __init__(self, wrap_s: float, *, quantised: bool, foreign: bool) -> None:
        self.order = StampOrder()
        self.map = ClockMap()
        self.lateness = Lateness()
        self.sensor = SensorClock() if quantised else None
        self.foreign = foreign  # of another clock than the autopilot's
        self._wrap_s = wrap_s
        self._newest_s = NAN
        self._ahead_s = 0.0  # what the stamps have lost by beginning again at zero

    def unwrapped(self, stamp_s: float) -> float:
        """The stamp as if its counter had no end."""
        gone_back_s = self._newest_s - stamp_s  # NaN: the first one
        if gone_back_s > self._wrap_s - NEAR_WRAP_S:
            self._ahead_s += self._wrap_s
        elif -gone_back_s > self._wrap_s - NEAR_WRAP_S:  # of before, and long under way
            return stamp_s + self._ahead_s - self._wrap_s
        self._newest_s = stamp_s
        return stamp_s + self._ahead_s

    def restart(self) -> None:
        """The clock of this stream began anew: only the order of its stamps is left."""
        self.map.reset()
        self.lateness = Lateness()
        if self.sensor is not None:
            self.sensor = SensorClock()

    def forget(self) -> None:
        """Whatever comes next is the first."""
        self.restart()
        self.order = StampOrder()
        self._newest_s, self._ahead_s = NAN, 0.0


class StampedStreams:
    """The stamps of all streams, on one clock: ours."""

    def __init__(self, *, lockstep: bool) -> None:
        """`lockstep`: the loop's clock is the vehicle's, and nothing is mapped."""
        self.reboots = 0
        self._lockstep = lockstep
        self._streams: dict[Hashable, Stream] = {}

    def time_of(
        self,
        key: Hashable,
        stamp_s: float,
        now_s: float,
        *,
        wrap_s: float = MILLISECONDS_WRAP_S,
        quantised: bool = False,
        foreign: bool = False,
    ) -> tuple[float, float] | None:
        """(when it was true on the loop's clock, on the sender's); None: it is not new.

        `quantised`: the stamp counts whole milliseconds.  `wrap_s`: where it begins again at
        zero; inf: nowhere.  `foreign`: of another clock than the autopilot's.
        """
        if stamp_s > STAMP_MAX_S:
            return None
        stream = self._streams.get(key)
        if stream is None:
            stream = self._streams[key] = Stream(wrap_s, quantised=quantised, foreign=foreign)
        stamp_s = stream.unwrapped(stamp_s)
        verdict = stream.order.judge(stamp_s)
        if verdict == StampOrder.STALE:
            return None
        if verdict == StampOrder.REBOOT:
            stream.restart()
            if not foreign:
                self._rebooted(stream)
        if self._lockstep:
            return stamp_s, stamp_s
        if not foreign and self._is_new_clock(stream, stamp_s, now_s):
            stream.restart()
            self._rebooted(stream)
        if stream.sensor is not None:
            stamp_s = stream.sensor.recover(stamp_s)
        time_s = stream.map.observe(stamp_s, now_s)
        if not foreign:
            # Streams stamped by one clock share what the fastest of them has learnt of it.
            mine_s = stream.map.offset_s
            for other in self._streams.values():
                if not other.foreign and mine_s - SHARED_S < other.map.offset_s < mine_s:
                    time_s = min(time_s, stamp_s + other.map.offset_s)
        return time_s, stamp_s

    def _is_new_clock(self, which: Stream, stamp_s: float, now_s: float) -> bool:
        late_s = now_s - stamp_s - which.map.offset_s
        since_s = which.lateness.judge(stamp_s, late_s, now_s)
        return since_s == since_s and not any(
            stream.lateness.begun_s < since_s <= stream.lateness.timely_s
            for stream in self._streams.values()
            if not stream.foreign
        )

    def _rebooted(self, which: Stream) -> None:
        self.reboots += 1
        for stream in self._streams.values():
            if stream is not which and not stream.foreign:
                stream.forget()
