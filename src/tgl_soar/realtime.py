"""When the loop ticks, and how the process asks the system to be on time.

The only file that touches scheduling, memory locking, garbage collection and deadlines.
"""

from __future__ import annotations

import ctypes
import gc
import os
import select
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

LATE_S: Final = 0.002  # a tick that much after it was due is counted as late
GRACE: Final = 0.5  # of a period: so long a tick waits for its sample
EARLY: Final = 0.5  # of a period: a sample that much early has its tick at once
LOCK_AT: Final = 20  # samples in step before the loop follows them
_STREAK_MAX: Final = 40
_STREAK_LOSS: Final = 2  # what a sample out of step costs: a fifth may be lost
_IN_STEP: Final = 0.05  # how far the samples' mean interval may be from the period
_SMOOTH: Final = 0.05

STRAIN_TICKS: Final = 40
_STRAIN_TELEMETRY: Final = 0.02  # one late tick is 0.025
_STRAIN_LOG: Final = 0.3

_MCL_CURRENT: Final = 1
_MCL_FUTURE: Final = 2
PRIORITY: Final = 60  # of SCHED_FIFO: above ordinary interrupts' threads, below the timer's


@dataclass(slots=True)
class TickCounters:
    """How the loop kept its time."""

    ticks: int = 0
    on_sample: int = 0  # of these, begun by an attitude sample
    late: int = 0
    skipped: int = 0  # periods without a tick: the process was held up
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
        self._deadline_s = now_s + self.period_s
        self._time_s = float("-inf")
        self._stamp_s = float("nan")
        self._interval_s = self.period_s
        self._streak = 0
        self._sample_s = float("nan")  # arrival of a sample that no tick has seen; NaN: none
        self._sample_time_s = float("nan")

    def set_rate(self, rate_hz: float) -> None:
        """Another rate, from the next tick on."""
        self._deadline_s += 1.0 / rate_hz - self.period_s
        self.period_s = 1.0 / rate_hz
        self._interval_s = self.period_s
        self._streak = 0

    @property
    def locked(self) -> bool:
        """Whether the loop follows the attitude stream."""
        in_step = abs(self._interval_s - self.period_s) <= _IN_STEP * self.period_s
        return self._streak >= LOCK_AT and in_step

    @property
    def wake_s(self) -> float:
        """When to look again if nothing arrives."""
        return self._deadline_s + (GRACE * self.period_s if self.locked else 0.0)

    def sample(self, arrival_s: float, stamp_s: float, time_s: float) -> None:
        """An attitude sample: when it came, the vehicle's stamp, its time on our clock."""
        steps = (stamp_s - self._stamp_s) / self.period_s
        if 0.5 <= steps < 1.5:
            self._interval_s += _SMOOTH * (stamp_s - self._stamp_s - self._interval_s)
            self._streak = min(_STREAK_MAX, self._streak + 1)
        else:  # NaN: the first one
            self._streak = max(0, self._streak - _STREAK_LOSS)
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
        due_s = self.wake_s
        missed = int((now_s - due_s) / self.period_s) if now_s > due_s else 0
        if self._is_sample_due():
            counters.on_sample += 1
            due_s = self._sample_s
            time_s = self._sample_time_s
            if not now_s - self.period_s <= time_s:
                time_s = now_s  # an old sample: the tick must know how old
            self._deadline_s = self._sample_s + self.period_s
        else:
            time_s = self._time_s + self.period_s if self.locked else self._deadline_s
            if missed > 0:
                time_s = now_s
            self._deadline_s += (1 + missed) * self.period_s
        counters.skipped += missed
        late_s = now_s - due_s
        if late_s > LATE_S:
            counters.late += 1
        counters.worst_late_s = max(counters.worst_late_s, late_s)
        self._sample_s = float("nan")
        self._time_s = max(self._time_s, min(now_s, time_s))
        return self._time_s

    def _is_sample_due(self) -> bool:
        return self.locked and self._sample_s >= self._deadline_s - EARLY * self.period_s


class Strain:
    """How hard the loop finds it to be on time, and so what it does without.

    A tick that was late or came after skipped ones counts 1, another 0; the strain is their
    mean over the last `STRAIN_TICKS` or so.  One late tick costs a moment's telemetry; a computer
    that is late all the time loses its log too.  The tick itself is never left out.
    """

    def __init__(self) -> None:
        self.value = 0.0

    def tick(self, counters: TickCounters, late_before: int, skipped_before: int) -> None:
        """After a tick: the counters, and what they were before it."""
        hit = counters.late != late_before or counters.skipped != skipped_before
        self.value += (float(hit) - self.value) / STRAIN_TICKS

    @property
    def no_telemetry(self) -> bool:
        """Nothing is told that was not asked for."""
        return self.value > _STRAIN_TELEMETRY

    @property
    def no_log(self) -> bool:
        """Nothing is written down either."""
        return self.value > _STRAIN_LOG


def wait(fds: Iterable[int], until_s: float, now_s: float) -> None:
    """Sleep until one of some can be read (those below zero are none), or until a time."""
    timeout_s = max(0.0, until_s - now_s)
    select.select([fd for fd in fds if fd >= 0], [], [], timeout_s)


def prepare(*, real_time: bool = True) -> list[str]:
    """Make the process ready to be on time; what could not be had is said in words."""
    gc.collect()
    gc.freeze()
    gc.disable()
    warnings: list[str] = []
    if not real_time:
        return warnings
    lacking: list[str] = []
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
    except (AttributeError, OSError):
        lacking.append("real-time priority")
    if not _lock_memory():
        lacking.append("locked memory")
    if lacking:
        warnings.append(
            f"no {' and no '.join(lacking)}: ticks may be late when the computer is busy"
            " (give the service LimitRTPRIO=61 and LimitMEMLOCK=infinity)"
        )
    return warnings


def go_first() -> None:
    """For the process that watches the flying one: it must be able to stop it if that spins."""
    with suppress(AttributeError, OSError):  # without the right to: `prepare` tells it
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY + 1))


def _lock_memory() -> bool:
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        return bool(libc.mlockall(_MCL_CURRENT | _MCL_FUTURE) == 0)
    except (OSError, AttributeError):
        return False
