"""The autopilot's clock against ours, and whether a stamp is of that clock at all.

A sample is stamped when it was true and arrives d later, on our CLOCK_MONOTONIC_RAW, which
nobody slews:

    arrival = stamp + offset + d,    d >= 0

The smallest arrival - stamp of the last `WINDOW_S` is the offset plus the smallest delay; the
jitter of all other samples is gone.  A constant part of the delay cannot be seen (EST_DELAY is
for that).  The window is between two bounds: two quartzes run apart by 100 ppm at most, 0.5 ms
in it, a tenth of a tick; and a link that is busy for half of it hides no delay.

What does not fit the offset is late, or of another clock:

    late by at most `LAG_S`    weather, or a clock that is slewed: it counts in the minimum
    later                      a queue, a stall: given with its age, but the minimum stays
    ahead by `AHEAD_S`         nothing is sent before it is true: another clock, refused
    stamps that go back        long under way, or another clock: refused

Frames of another clock that continue each other become the clock when nothing has fitted
the one before for `SILENT_S`: at once after a restart, after `LASTS_S` where the jump is small,
always within a second.  Received beside the true one they are a duplicate autopilot.  It cannot
be known which of the two is flown with, so after `CONTEST_S` neither is, until one is alone again.

An autopilot that restarts counts from zero again.  Received again late, its stamps may be above the
last one all the same, and then are late by a constant: after a skip in its stamps, that is a new
clock too, unless another of its streams still comes in time.  One whose stamps continue without a
skip is late itself, as after a stall of ours or on a link with a queue.  (For a clock that is not
the autopilot's, whose other streams are not received, it always is.)

A stamp that counts milliseconds in 32 bits begins again at zero after 49.7 days, one that counts
microseconds after 71.6 minutes, perhaps more than once while its stream is silent; and one of whole
milliseconds is made finer by `sensor_clock`.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import Final

from tgl_soar.link.sensor_clock import SensorClock
from tgl_soar.types import INFINITE, NAN

WINDOW_S: Final = 5.0
LAG_S: Final = 0.25  # more than a clock is slewed in the window: 0.15 s at 3 %
AHEAD_S: Final = 0.1  # from here on a wrong age makes the pitch loop oscillate
SILENT_S: Final = 0.1  # half of AGE_ATT_MAX: a restart is reported before the attitude is lost
ROW: Final = 3  # frames that continue each other, and none of the clock before between them
REBOOT_S: Final = 1.0  # a jump by so much is no link's doing where none of the old frames comes
LASTS_S: Final = 0.5  # a smaller one must last for so long
SAME_S: Final = 0.2  # frames of one clock do not come later or earlier than that at once
GAP_S: Final = 1.0  # after it they do not continue
CONTEST_S: Final = 1.0  # two clocks beside each other for so long: no burst of old frames
CALM_S: Final = 2.0  # one of them silent for so long: the other is alone
HELD_S: Final = 10.0  # no link holds frames for so long and delivers others in time
PROVEN_S: Final = 0.25  # two stamps that fit so far apart: the first was not a wrong one
LATE_S: Final = 1.0  # later at once than before, and so much that nothing can be done with it
SKIP_S: Final = 0.25  # between two stamps: what is only late has none
STEADY_LATE_S: Final = 0.5  # late by the same for so long
MILLISECONDS_WRAP_S: Final = 2**32 * 1e-3
MICROSECONDS_WRAP_S: Final = 2**32 * 1e-6
NEAR_WRAP_S: Final = 300.0  # further from it a clock that has gone back has restarted
STAMP_MAX_S: Final = 1e10  # 317 years: no clock reaches it; a double is finer than 2 us below it
UNIX_S: Final = 1e9  # 2001: later is the time of day, which counts from elsewhere than the boot
SHARED_S: Final = 0.25  # streams whose offsets are no further apart have one clock


class ClockMap:
    """Maps one stream's stamps to our clock: the smallest arrival - stamp of a window.

    Two halves are kept, the last whole one and the one that fills.  They move on with the
    samples: after a silence what was known before is known for another half.
    """

    __slots__ = ("_filling_s", "_since_s", "_whole_s", "offset_s")

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Nothing is known."""
        self.offset_s = NAN
        self._whole_s = self._filling_s = self._since_s = NAN

    def observe(self, stamp_s: float, arrival_s: float) -> float:
        """Take in one sample; its time on our clock, never later than its arrival."""
        observed_s = arrival_s - stamp_s
        if not arrival_s - self._since_s < 0.5 * WINDOW_S:  # NaN: the first sample
            first = self._since_s != self._since_s
            self._whole_s = observed_s if first else self._filling_s
            self._filling_s, self._since_s = observed_s, arrival_s
        elif observed_s < self._filling_s:
            self._filling_s = observed_s
        self.offset_s = min(self._whole_s, self._filling_s)
        return stamp_s + self.offset_s


class Suspect:
    """Frames of one stream that do not fit its clock, and continue each other."""

    __slots__ = ("_received_s", "count", "offset_s", "row", "since_s", "stamp_s")

    def __init__(self) -> None:
        self.count = 0
        self.row = 0  # of these since the last one that fits
        self.offset_s = self.stamp_s = self.since_s = self._received_s = NAN

    def continues(self, stamp_s: float, observed_s: float, now_s: float) -> bool:
        """Whether a frame continues those before."""
        return (
            stamp_s > self.stamp_s  # NaN: there are none
            and abs(observed_s - self.offset_s) <= SAME_S
            and now_s - self._received_s <= GAP_S
        )

    def take(self, stamp_s: float, observed_s: float, now_s: float) -> None:
        """One more; what does not continue starts a new count."""
        if not self.continues(stamp_s, observed_s, now_s):
            self.count, self.row, self.since_s = 0, 0, now_s
        self.count += 1
        self.row += 1
        self.offset_s, self.stamp_s, self._received_s = observed_s, stamp_s, now_s


class Lateness:
    """Distinguishes a restarted clock, above the last stamp received, from late samples."""

    __slots__ = (
        "_count", "_late_s", "_since_s", "_stamp_s", "_suspected_s", "timely_s"
    )  # fmt: skip

    def __init__(self) -> None:
        self.timely_s = NAN  # when the last sample came that was in time
        self._stamp_s = NAN
        self._late_s = 0.0
        self._suspected_s = NAN  # since when it may be a new clock
        self._since_s = NAN  # since when it has been late by the same
        self._count = 0

    def judge(self, stamp_s: float, late_s: float, arrival_s: float) -> float:
        """Since when it has been a new clock; NaN: it is not.  late_s: against its map."""
        skipped_s, self._stamp_s = stamp_s - self._stamp_s, stamp_s
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
        lasts = arrival_s - self._since_s >= STEADY_LATE_S and self._count >= ROW
        return self._suspected_s if lasts else NAN


class StampedStream:
    """What is known of the stamps of one stream."""

    __slots__ = (
        "_ahead_s",
        "_wrap_s",
        "begun_s",
        "contested_s",
        "fitted_s",
        "foreign",
        "lateness",
        "map",
        "newest_s",
        "sensor",
        "suspect",
    )

    def __init__(self, wrap_s: float, *, quantised: bool, foreign: bool) -> None:
        self.map = ClockMap()
        self.lateness = Lateness()
        self.suspect = Suspect()
        self.sensor = SensorClock() if quantised else None
        self.foreign = foreign  # of another clock than the autopilot's
        self.newest_s = NAN  # the last stamp that was taken, unwrapped
        self.begun_s = NAN  # when the first one came of this clock
        self.fitted_s = NAN  # when the last one came that fitted
        self.contested_s = -INFINITE  # until when two clocks are received
        self._wrap_s = wrap_s
        self._ahead_s = 0.0  # what the stamps have lost by beginning again at zero

    @property
    def is_proven(self) -> bool:
        """Whether its clock is more than one stamp that may have been wrong."""
        return self.fitted_s - self.begun_s >= PROVEN_S

    def unwrapped(self, stamp_s: float, now_s: float) -> float:
        """The stamp as if its counter had no end; remembered only once it is taken."""
        stamp_s += self._ahead_s
        gone_back_s = self.newest_s - stamp_s  # NaN: the first one
        if abs(gone_back_s) > GAP_S and self._wrap_s != INFINITE:  # after a long silence
            late_s = now_s - stamp_s - self.map.offset_s
            rounds_s = self._wrap_s * round(late_s / self._wrap_s) if late_s == late_s else 0.0
            if abs(late_s - rounds_s) <= LATE_S:
                return stamp_s + rounds_s
        if gone_back_s > self._wrap_s - NEAR_WRAP_S:
            return stamp_s + self._wrap_s
        if -gone_back_s > self._wrap_s - NEAR_WRAP_S:  # of before, and long under way
            return stamp_s - self._wrap_s
        return stamp_s

    def take(self, stamp_s: float) -> None:
        """The newest stamp, unwrapped."""
        while stamp_s >= self._ahead_s + self._wrap_s:
            self._ahead_s += self._wrap_s
        self.newest_s = stamp_s

    def late_s(self, stamp_s: float, now_s: float, shared_s: float) -> float:
        """Against what is known of its clock; of a new stream, against the others'.

        A counter that ends earlier than theirs is the same clock, whole rounds behind.
        """
        offset_s = self.map.offset_s
        if offset_s == offset_s:
            return now_s - stamp_s - offset_s
        late_s = now_s - stamp_s - shared_s
        if late_s == late_s and self._wrap_s != INFINITE:
            late_s -= self._wrap_s * round(late_s / self._wrap_s)
        return late_s

    def restart(self) -> None:
        """Whatever comes next is the first."""
        self.map.reset()
        self.lateness = Lateness()
        self.suspect = Suspect()
        if self.sensor is not None:
            self.sensor = SensorClock()
        self.newest_s = self.begun_s = self.fitted_s = NAN
        self._ahead_s = 0.0


FITS: Final = 0
LATE: Final = 1  # of the clock, and too late to measure it
REFUSED: Final = 2
ANOTHER: Final = 3  # the first of another clock, from here on


class StampedStreams:
    """The stamps of all streams, on one clock: ours."""

    def __init__(self, *, lockstep: bool) -> None:
        """`lockstep`: the loop's clock is the vehicle's, and nothing is mapped."""
        self.reboots = 0
        self.leap_s = 0.0  # by how much the autopilot's clock was ahead of the one before
        self.suspected = 0  # how often frames of another clock began to continue each other
        self.suspect_ahead_s = 0.0  # by how much the last such clock is ahead of the known one
        self.refused = 0  # frames of another clock, or while two are received
        self._fitted_s = NAN  # when the autopilot's clock was received last
        self._contested_s = -INFINITE
        self._lockstep = lockstep
        self._streams: dict[Hashable, StampedStream] = {}

    def is_contested(self, now_s: float) -> bool:
        """Whether two clocks stamp as the autopilot, so that neither is used."""
        return now_s < self._contested_s

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
        """(when it was true on the loop's clock, on the sender's); None: it is not taken.

        `quantised`: the stamp counts whole milliseconds.  `wrap_s`: where it begins again at
        zero; inf: nowhere.  `foreign`: of another clock than the autopilot's.
        """
        if stamp_s > STAMP_MAX_S:
            return None
        stream = self._streams.get(key)
        if stream is None:
            stream = self._streams[key] = StampedStream(
                wrap_s, quantised=quantised, foreign=foreign
            )
        unwrapped_s = stream.unwrapped(stamp_s, now_s)
        if self._lockstep:
            return self._in_lockstep(stream, stamp_s, unwrapped_s)
        verdict = self._judge(stream, unwrapped_s, now_s)
        if verdict == REFUSED:
            return None
        if verdict == ANOTHER:
            unwrapped_s = stamp_s
        if stream.begun_s != stream.begun_s:
            stream.begun_s = now_s
        stream.take(unwrapped_s)
        if stream.sensor is not None:
            unwrapped_s = stream.sensor.recover(unwrapped_s)
        if verdict != LATE:
            stream.map.observe(unwrapped_s, now_s)
            stream.fitted_s = now_s
            stream.suspect.row = 0
            if not foreign:
                self._fitted_s = now_s
        if now_s < (stream.contested_s if foreign else self._contested_s):
            self.refused += 1
            return None
        return unwrapped_s + self._offset_s(stream), unwrapped_s

    def _offset_s(self, which: StampedStream) -> float:
        """Streams stamped by one clock share the offset of the fastest of them."""
        mine_s = least_s = which.map.offset_s
        if not which.foreign:
            for stream in self._streams.values():
                other_s = stream.map.offset_s
                near = mine_s - SHARED_S < other_s < least_s
                if near and not stream.foreign and stream.is_proven:
                    least_s = other_s
        return least_s

    def _shared_s(self, now_s: float) -> float:
        """The offset of the autopilot's clock, where it is received now; NaN: it is not."""
        least_s = NAN
        for stream in self._streams.values():
            is_received = now_s - stream.fitted_s <= GAP_S and stream.is_proven
            if is_received and not stream.foreign and stream.newest_s < UNIX_S:
                least_s = stream.map.offset_s if least_s != least_s else least_s
                least_s = min(least_s, stream.map.offset_s)
        return least_s

    def _judge(self, stream: StampedStream, stamp_s: float, now_s: float) -> int:
        """What a stamp is: one of the verdicts above."""
        is_new = stream.map.offset_s != stream.map.offset_s
        if is_new and not stream.foreign and stamp_s < UNIX_S:
            apart_s = stream.late_s(stamp_s, now_s, self._shared_s(now_s))
            if apart_s < -AHEAD_S or apart_s > LATE_S:
                return self._suspected(stream, stamp_s, apart_s, now_s)
        late_s = stream.late_s(stamp_s, now_s, NAN)
        if late_s < -AHEAD_S or (stamp_s <= stream.newest_s and late_s > LAG_S):
            return self._suspected(stream, stamp_s, late_s, now_s)
        if stamp_s <= stream.newest_s:
            return REFUSED
        if late_s > LAG_S:
            continues = stream.suspect.continues(stamp_s, now_s - stamp_s, now_s)
            if (continues or not stream.is_proven) and (
                self._suspected(stream, stamp_s, late_s, now_s) == ANOTHER
            ):
                return ANOTHER
        if not stream.foreign and self._is_new_clock(stream, stamp_s, late_s, now_s):
            self._reset(stream, late_s)
            return ANOTHER
        return LATE if late_s > LAG_S else FITS

    def _suspected(self, stream: StampedStream, stamp_s: float, late_s: float, now_s: float) -> int:
        """A frame that does not fit: refused, unless its clock has taken the other's place."""
        suspect = stream.suspect
        suspect.take(stamp_s, now_s - stamp_s, now_s)
        is_apart = late_s < -LAG_S or late_s > HELD_S
        if is_apart:
            self.refused += 1
        is_new = stream.map.offset_s != stream.map.offset_s
        if not is_new and self._takes_over(stream, late_s, now_s):
            return ANOTHER
        if is_apart:
            self._report(stream, -late_s)
        if is_new:
            return REFUSED  # it cannot say that all others are wrong
        lasts = now_s - suspect.since_s >= CONTEST_S and now_s - stream.fitted_s <= GAP_S
        if lasts and is_apart and stream.is_proven:
            stream.contested_s = now_s + CALM_S
            if not stream.foreign:
                self._contested_s = stream.contested_s
        return REFUSED

    def _report(self, stream: StampedStream, ahead_s: float) -> None:
        """Count that frames of another clock continue, once."""
        if stream.suspect.count == ROW and not stream.foreign:
            self.suspected += 1
            self.suspect_ahead_s = ahead_s

    def _takes_over(self, stream: StampedStream, late_s: float, now_s: float) -> bool:
        """Whether a suspect has become the clock."""
        suspect = stream.suspect
        if suspect.row < ROW:
            return False
        fitted_s = stream.fitted_s if stream.foreign else self._fitted_s
        lasts = now_s - suspect.since_s >= LASTS_S
        is_far = abs(late_s) >= REBOOT_S
        if now_s - fitted_s >= SILENT_S:
            if 0.0 < late_s < HELD_S and suspect.since_s <= fitted_s:
                return False  # received before as well: a second, slower way
            if -LAG_S <= late_s < 0.0:  # a queue has gone
                stream.restart()
                return True
            if is_far or (lasts and stream.is_proven):
                self._reset(stream, late_s)
                return True
        if lasts and not stream.is_proven and now_s - stream.fitted_s >= SILENT_S:
            stream.restart()  # its first stamp was wrong, or late
            return True
        return False

    def _is_new_clock(
        self, which: StampedStream, stamp_s: float, late_s: float, now_s: float
    ) -> bool:
        since_s = which.lateness.judge(stamp_s, late_s, now_s)
        return since_s == since_s and not any(
            stream.begun_s < since_s <= stream.lateness.timely_s
            for stream in self._streams.values()
            if not stream.foreign
        )

    def _reset(self, which: StampedStream, late_s: float) -> None:
        """The clock of a stream is another one; the autopilot's other streams have the same."""
        which.restart()
        if not which.foreign:
            self.reboots += 1
            self.leap_s = -late_s
            self._fitted_s, self._contested_s = NAN, -INFINITE
            for stream in self._streams.values():
                if not stream.foreign:
                    stream.restart()

    def _in_lockstep(
        self, stream: StampedStream, stamped_s: float, stamp_s: float
    ) -> tuple[float, float] | None:
        """Stamps are the time, and only their order distinguishes two clocks."""
        leap_s = stamp_s - stream.newest_s  # NaN: the first one
        if leap_s <= 0.0 and leap_s >= -REBOOT_S:
            return None
        if leap_s < 0.0 or leap_s > REBOOT_S:
            suspect = stream.suspect
            suspect.take(stamp_s, 0.0, stamp_s)
            if leap_s > 0.0 and suspect.row < ROW:
                self.refused += 1
                self._report(stream, leap_s)
            if suspect.row < ROW:
                return None
            if leap_s < 0.0:
                self._reset(stream, -leap_s)
                stamp_s = stamped_s
        stream.take(stamp_s)
        stream.suspect.row = 0
        return stamp_s, stamp_s
