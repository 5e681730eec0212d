"""How the process asks the system to be on time.

The only file that touches scheduling, memory locking, garbage collection and the clock; `pacing`
says when to tick.

    watchdog         SCHED_FIFO 61: it must be able to stop a flying process that spins
    the loop         SCHED_FIFO 60, memory locked, no garbage collection, on one processor if asked
    log, parameters  SCHED_FIFO 59: never before a tick; and not below ordinary processes, as
                     a thread that waits for a processor with Python's lock holds up the loop
"""

from __future__ import annotations

import ctypes
import gc
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from typing import Final, NamedTuple

# Arrivals are stamped and ticks are paced by the bare quartz.  CLOCK_MONOTONIC is slewed where the
# time of day is set right over a network, by chrony up to 8 %: every age would change with it, and
# the autopilot's clock seem to run away.  The kernel's sleeps and time-outs go by CLOCK_MONOTONIC
# all the same: they are given durations, of a tick at most, and never a time.
_RAW: Final[int] = getattr(time, "CLOCK_MONOTONIC_RAW", time.CLOCK_MONOTONIC)
clock_s: Final[Callable[[], float]] = partial(time.clock_gettime, _RAW)
clock_ns: Final[Callable[[], int]] = partial(time.clock_gettime_ns, _RAW)

_MCL_CURRENT: Final = 1
_MCL_FUTURE: Final = 2
_PR_SET_TIMERSLACK: Final = 29
PRIORITY: Final = 60  # of SCHED_FIFO: above ordinary interrupts' threads, below the timer's
SWITCH_S: Final = 50e-6  # so long another thread keeps Python's lock when the loop wants it
SPIN_MAX_S: Final = 0.002


class RealtimeOptions(NamedTuple):
    """What an operator may ask of the system beyond what is always asked for."""

    processor: int | None = None  # the loop runs on this one only
    spin_s: float | None = None  # so long around a tick it does not sleep; None: as it takes
    power_saving: bool = False  # no tick is warmed up for


def prepare(
    options: RealtimeOptions = RealtimeOptions(),  # noqa: B008 - it is immutable
    *,
    real_time: bool = True,
) -> list[str]:
    """Make the process ready to be on time; what could not be had is said in words.

    To be called by the loop's thread once everything is built: what is there by then is never
    looked through for garbage again.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    if not real_time:
        return []
    sys.setswitchinterval(SWITCH_S)
    warnings: list[str] = []
    if options.processor is not None:
        try:
            os.sched_setaffinity(0, {options.processor})
        except (AttributeError, OSError):
            warnings.append(f"processor {options.processor} cannot be had: running on any")
    lacking: list[str] = []
    if not _set_priority(PRIORITY):
        lacking.append("real-time priority")
        _libc_call("prctl", _PR_SET_TIMERSLACK, 1, 0, 0, 0)  # ns; with the priority there is none
    if not _libc_call("mlockall", _MCL_CURRENT | _MCL_FUTURE):
        lacking.append("locked memory")
    if lacking:
        warnings.append(
            f"no {' and no '.join(lacking)}: ticks may be late when the computer is busy"
            " (give the service LimitRTPRIO=61 and LimitMEMLOCK=infinity)"
        )
    return warnings


def raise_priority() -> None:
    """For the process that watches the flying one: it must be able to stop it if that spins."""
    _set_priority(PRIORITY + 1)  # without the right to: `prepare` tells it


def accompany() -> bool:
    """For a simulated world beside the loop: after it and before all others; whether it may.

    What is there by now is never looked through for garbage again.
    """
    gc.collect()
    gc.freeze()
    return _set_priority(PRIORITY - 1)


@contextmanager
def lower_priority(options: RealtimeOptions) -> Iterator[None]:
    """Threads that are started within come right after the loop, and before all others.

    They run wherever there is room, also where the loop has a processor for itself.
    """
    try:
        policy, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
        mine = os.sched_getaffinity(0)
    except (AttributeError, OSError):
        yield
        return
    has_priority = _set_priority(PRIORITY - 1)
    if options.processor is not None:
        os.sched_setaffinity(0, range(os.cpu_count() or 1))
    try:
        yield
    finally:
        if options.processor is not None:
            os.sched_setaffinity(0, mine)
        if has_priority:
            os.sched_setscheduler(0, policy, parameter)


def processors() -> set[int]:
    """Those that this process may run on."""
    try:
        return os.sched_getaffinity(0)
    except (AttributeError, OSError):
        return set(range(os.cpu_count() or 1))


def _set_priority(priority: int) -> bool:
    """Of this thread, among those that run before all ordinary ones."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (AttributeError, OSError):
        return False
    return True


def _libc_call(name: str, *arguments: int) -> bool:
    with suppress(OSError, AttributeError):
        return bool(getattr(ctypes.CDLL(None), name)(*arguments) == 0)
    return False
