"""When the loop ticks, how it waits for that, and what it does without where it is late.

Times are arguments and the clock is one too: `realtime` has the only one that flies.
"""

from __future__ import annotations

import select
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import inf, nan
from typing import Final

LATE_S: Final = 0.002  # a tick that much after it was due is counted as late
GRACE: Final = 0.5  # of a period: so long a tick waits for its sample
# Of a period: a sample that much early has its tick at once.  An autopilot that sends in the steps
# of a main loop of twice the rate (ArduPlane at 400 Hz) is half a period early after a late one;
# and a tenth more, for what the link adds.
EARLY: Final = 0.6
LOCK_AT: Final = 20  # samples in step before the loop follows them
_STREAK_MAX: Final = 40
_STREAK_LOSS: Final = 2  # what a sample out of step costs: a fifth may be lost
_IN_STEP: Final = 0.05  # how far the samples' mean interval may be from the period
_SMOOTH: Final = 0.05

WARM_UP_S: Final = 0.0007  # before the sample, until it is known how long one takes
WARM_UP_MAX: Final = 0.4  # of a period; what takes longer does not fit
_LONGER: Final = 0.2  # what one counts that took longer than thought: most do not
_SHORTER: Final = 0.01
_MISFITS_MAX: Final = 3  # one after the other: no warm-ups for
_REST_TICKS: Final = 1000
_BEFORE: Final = 0.2  # what a sample counts that came before it was expected
_AFTER: Final = 0.02  # or after: it may have waited for us

SHEDDING_TICKS: Final = 40
_SHED_TELEMETRY: Final = 0.02  # one late tick is 0.025
_SHED_LOG: Final = 0.3

AWAKE_MAX_S: Final = 0.0002  # where it is learned how long to stay awake
_LATER: Final = 0.2  # what a sleep counts that ended later than thought
_SOONER: Final = 0.01
_IN_VAIN_MAX: Final = 3


@dataclass(slots=True)
class TickCounters:
    """How the loop kept its time."""

    ticks: int = 0
    on_sample: int = 0  # of these, begun by an attitude sample
    late: int = 0
    skipped: int = 0  # periods without a tick: the process was held up
    over_run: int = 0  # ticks that took longer than their period
    worst_late_s: float = 0.0


class Pacer:
    """Decides when to tick: with the attitude stream where it comes at the loop's rate, else alone.

    Times are arguments.  A free loop ticks on an absolute grid: however late one tick is, the
    next is due where it was due anyway.  A locked loop ticks when a sample arrives; a tick
    whose sample does not come is made `GRACE` later, and the grid goes on.  Periods that were
    slept through are skipped and counted, never made up for in a burst.
    """

    def __init__(self, rate_hz: float, now_s: float) -> None:
        self.counters = TickCounters()
        self.period_s = 1.0 / rate_hz
        self._deadline_s = self._expected_s = now_s + self.period_s
        self._time_s = -inf
        self._stamp_s = nan
        self._interval_s = self.period_s  # of the stamps
        self._arrivals_s = self.period_s  # between two samples, on our clock
        self._arrived_s = nan
        self._streak = 0
        self.locked = False  # the loop follows the attitude stream
        self._sample_s = nan  # arrival of a sample that no tick has seen; NaN: none
        self._sample_time_s = nan
        self._warmed_up_s = nan  # the deadline that was warmed up for
        self._ahead_s = WARM_UP_S
        self._misfits = 0
        self._resting = 0  # ticks without a warm-up, as it does not fit

    def begin(self, now_s: float) -> None:
        """The loop starts now: whatever took its time before is no delay."""
        self._deadline_s = self._expected_s = now_s + self.period_s

    def set_rate(self, rate_hz: float) -> None:
        """Another rate, from the next tick on."""
        self._deadline_s += 1.0 / rate_hz - self.period_s
        self._expected_s = self._deadline_s
        self.period_s = 1.0 / rate_hz
        self._interval_s = self._arrivals_s = self.period_s
        self._streak = 0
        self.locked = False

    @property
    def wake_s(self) -> float:
        """When to look again if nothing arrives."""
        return self._deadline_s + (GRACE * self.period_s if self.locked else 0.0)

    @property
    def expected_s(self) -> float:
        """When the next tick, or the sample that begins it, is expected."""
        return self._expected_s

    @property
    def warm_up_s(self) -> float:
        """When to go through the next tick for nothing; inf: not before this one.

        A sleep of 5 ms is enough to lose the tick's code and data from the processor's caches:
        the tick after it takes some three times as long.  Gone through once just before its
        sample is expected, it is quick when the sample is there.  It ends as the sample comes, or
        shortly before: to sleep once more in between would cost more than it saves.
        """
        if not self.locked or self._resting > 0 or self._warmed_up_s == self._deadline_s:
            return inf
        return self._expected_s - self._ahead_s

    def warmed_up(self, to_begin_s: float, now_s: float) -> None:
        """It was gone through: next time as early as is mostly needed to be done in time.

        `to_begin_s`: when it was to begin.
        """
        self._warmed_up_s = self._deadline_s
        took_s, longest_s = now_s - to_begin_s, WARM_UP_MAX * self.period_s
        self._misfits = self._misfits + 1 if took_s > longest_s else 0
        if self._misfits >= _MISFITS_MAX:
            self._misfits, self._resting = 0, _REST_TICKS
        weight = _LONGER if took_s > self._ahead_s else _SHORTER
        self._ahead_s += weight * (min(took_s, longest_s) - self._ahead_s)

    def sample(self, arrival_s: float, stamp_s: float, time_s: float) -> None:
        """An attitude sample: when it came, the vehicle's stamp, its time on our clock."""
        steps = (stamp_s - self._stamp_s) / self.period_s
        if 0.5 <= steps < 1.5:
            self._interval_s += _SMOOTH * (stamp_s - self._stamp_s - self._interval_s)
            self._streak = min(_STREAK_MAX, self._streak + 1)
        else:  # NaN: the first one
            self._streak = max(0, self._streak - _STREAK_LOSS)
        in_step = abs(self._interval_s - self.period_s) <= _IN_STEP * self.period_s
        self.locked = self._streak >= LOCK_AT and in_step
        self._stamp_s = stamp_s
        self._sample_s = arrival_s
        self._sample_time_s = time_s

    def due(self, now_s: float) -> bool:
        """Whether to tick now."""
        return now_s >= self.wake_s or self._is_sample_due()

    def tick(self, now_s: float) -> float:
        """Begin a tick; its time, which never goes back and is never ahead of now.

        It is the sample's own time, or the grid's: neither has the jitter of our waking.
        """
        counters = self.counters
        counters.ticks += 1
        self._resting = max(0, self._resting - 1)
        due_s = self.wake_s
        missed = int((now_s - due_s) / self.period_s) if now_s > due_s else 0
        if self._is_sample_due():
            counters.on_sample += 1
            due_s = self._sample_s
            time_s = self._sample_time_s
            if not now_s - self.period_s <= time_s:
                time_s = now_s  # an old sample: the tick must know how old
            self._deadline_s = self._sample_s + self.period_s
            self._expect()
        else:
            follows = self.locked and self._time_s > -inf  # else no tick yet: the grid's own
            time_s = self._time_s + self.period_s if follows else self._deadline_s
            if missed > 0:
                time_s = now_s
            self._deadline_s += (1 + missed) * self.period_s
            self._expected_s += (1 + missed) * self._arrivals_s
            if not self.locked:
                self._expected_s = self._deadline_s
        counters.skipped += missed
        late_s = now_s - due_s
        if late_s > LATE_S:
            counters.late += 1
        counters.worst_late_s = max(counters.worst_late_s, late_s)
        self._sample_s = nan
        self._time_s = max(self._time_s, min(now_s, time_s))
        return self._time_s

    def _expect(self) -> None:
        """The next sample, one interval after this one was to come.

        This one may have come earlier than it was read: what is late counts little, or the loop
        would be later and later itself.  The interval is that of arrivals: the vehicle's clock
        may go otherwise than ours.
        """
        step_s = self._sample_s - self._arrived_s
        if 0.5 <= step_s / self.period_s < 1.5:
            self._arrivals_s += _AFTER * (step_s - self._arrivals_s)
        self._arrived_s = self._sample_s
        after_s = self._sample_s - self._expected_s
        if abs(after_s) > EARLY * self.period_s:
            self._expected_s = self._sample_s
        else:
            self._expected_s += (_AFTER if after_s > 0.0 else _BEFORE) * after_s
        self._expected_s += self._arrivals_s

    def done(self, began_s: float, now_s: float) -> None:
        """What a tick brought with it is done."""
        if now_s - began_s > self.period_s:
            self.counters.over_run += 1

    def _is_sample_due(self) -> bool:
        return self.locked and self._sample_s >= self._deadline_s - EARLY * self.period_s


class LoadShedding:
    """How hard the loop finds it to be on time, and so what it does without.

    A tick that was late or came after skipped ones counts 1, another 0; the load is their
    mean over the last `SHEDDING_TICKS` or so.  One late tick costs a moment's telemetry; a computer
    that is late all the time loses its log too.  The tick itself is never left out.
    """

    def __init__(self) -> None:
        self.value = 0.0

    def tick(self, counters: TickCounters, late_before: int, skipped_before: int) -> None:
        """After a tick: the counters, and what they were before it."""
        hit = counters.late != late_before or counters.skipped != skipped_before
        self.value += (float(hit) - self.value) / SHEDDING_TICKS

    @property
    def no_telemetry(self) -> bool:
        """Nothing is reported that was not asked for."""
        return self.value > _SHED_TELEMETRY

    @property
    def no_log(self) -> bool:
        """Nothing is written down either."""
        return self.value > _SHED_LOG


class Waiter:
    """Waits for what comes and for the next tick: asleep while it may be, awake when it matters.

    A processor that has gone idle takes its time to wake, some 20 to 100 µs.  So much before a
    tick is expected sleep ends, and what is left is waited for awake, as long again after it at
    most, unless of late nothing has come.  How much that is, is learned from how late sleep ended
    before (nearly the latest of late), unless it is given.
    """

    def __init__(self, clock: Callable[[], float], awake_s: float | None = None) -> None:
        """`awake_s`: before and after a tick is expected; 0: sleep until it is time."""
        self._clock = clock
        self._learns = awake_s is None
        self.awake_s = 0.0 if awake_s is None else awake_s
        self._in_vain = 0  # how often nothing came, one after the other

    def wait(
        self, fds: Sequence[int], until_s: float, expected_s: float = inf
    ) -> tuple[float, list[int]]:
        """Until one of some can be read (those below zero are none), or until a time.

        Returns the time, and those that can be read.  Deadlines are absolute: what is left is
        computed last.  `select`, as `poll` and `epoll` count whole milliseconds.
        """
        clock, look = self._clock, select.select
        waiting = [fd for fd in fds if fd >= 0]
        asleep_until_s = min(until_s, expected_s - self.awake_s)
        left_s = asleep_until_s - clock()
        sleeps = left_s > (self.awake_s if self._learns else 0.0)  # a shorter one ends no sooner
        ready, _, _ = look(waiting, (), (), left_s if sleeps else 0.0)
        now_s = clock()
        if not ready and sleeps and self._learns:
            self._learn(now_s - asleep_until_s)
        patience_s = self.awake_s if self._in_vain < _IN_VAIN_MAX else 0.0
        awake_until_s = min(until_s, expected_s + patience_s)
        while not ready and now_s < awake_until_s:
            ready, _, _ = look(waiting, (), (), 0.0)
            now_s = clock()
        self._in_vain = 0 if ready else min(_IN_VAIN_MAX, self._in_vain + (now_s >= expected_s))
        if not ready and now_s < until_s:
            ready, _, _ = look(waiting, (), (), until_s - now_s)
            now_s = clock()
        return now_s, ready

    def _learn(self, late_s: float) -> None:
        """Sleep ended so much later than it was to."""
        weight = _LATER if late_s > self.awake_s else _SOONER
        self.awake_s += weight * (min(AWAKE_MAX_S, late_s) - self.awake_s)
