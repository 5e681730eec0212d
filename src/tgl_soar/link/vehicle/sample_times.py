"""When a sample was true, on the loop's clock, and what is wrong with the vehicle's clock.

Stamps are mapped by `clock`, less what `timesync` finds of a queue there.  In lockstep the loop's
clock is the vehicle's and nothing is mapped.
A restart of the autopilot, stamps of another clock, and two autopilots with one identity are
noticed here, by the stamps alone.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from math import inf
from typing import Final

from tgl_soar.link.clock import MILLISECONDS_WRAP_S, StampedStreams
from tgl_soar.link.messages import (
    ID_DISTANCE_SENSOR,
    SEVERITY_ERROR,
    SEVERITY_INFO,
    SEVERITY_WARNING,
    Source,
)
from tgl_soar.link.timesync import RECENT_S, SLACK_S
from tgl_soar.link.vehicle.diagnostics import Ledger

CLOCK_NOTICE_S: Final = 10.0  # between two notices of another clock
QUEUE_NOTICE_S: Final = 10.0  # between two notices of a queue


class SampleTimes:
    """The stamps of all messages of one vehicle."""

    def __init__(
        self,
        autopilot: Source,
        ledger: Ledger,
        restarted: Callable[[float], None],
        *,
        lockstep: bool,
    ) -> None:
        """`restarted`: called with the time when the vehicle's clock is another one."""
        self.lockstep = lockstep
        self._name = f"{autopilot.system}:{autopilot.component}"
        self._counters, self._notices = ledger.counters, ledger.notices
        self._restarted = restarted
        self._stamps = StampedStreams(lockstep=lockstep)
        self._noticed_s = -inf  # when another clock was reported last
        self._contested = False
        self._queue_s = 0.0  # by which samples are older than their arrivals say
        self._queue_taken_s = -inf  # when it was measured last
        self._queue_noticed_s = -inf

    def take_queue(self, queue_s: float, now_s: float) -> None:
        """How long the queue on the link is that no arrival shows; 0: there is none."""
        self._queue_s, self._queue_taken_s = queue_s, now_s
        if queue_s > 0.0:
            slower_s = queue_s + SLACK_S
            text = f"the autopilot answers {slower_s:.2f} s later than before"
            self._report_queue(f"{text}: is its link too slow?", now_s)

    def _report_queue(self, text: str, now_s: float) -> None:
        if now_s - self._queue_noticed_s >= QUEUE_NOTICE_S:
            self._queue_noticed_s = now_s
            self._notices.append((SEVERITY_WARNING, text))

    def of_milliseconds(
        self, message_id: int, stamp_ms: int, now_s: float
    ) -> tuple[float, float] | None:
        """When a sample was true, on our clock and on the vehicle's; None: it is not taken."""
        return self._time_of(
            message_id, stamp_ms * 1e-3, now_s, wrap_s=MILLISECONDS_WRAP_S, quantised=True
        )

    def of_distance(self, sensor: int, stamp_ms: int, now_s: float) -> tuple[float, float] | None:
        """The same of one of several rangefinders, each with a stamp of its own."""
        key = ID_DISTANCE_SENSOR, sensor
        return self._time_of(
            key, stamp_ms * 1e-3, now_s, wrap_s=MILLISECONDS_WRAP_S, quantised=True
        )

    def of_microseconds(
        self,
        key: Hashable,
        stamp_us: int,
        now_s: float,
        *,
        wrap_s: float = inf,
        foreign: bool = False,
    ) -> tuple[float, float] | None:
        """The same of a stamp in microseconds.  `foreign`: of another clock."""
        return self._time_of(key, stamp_us * 1e-6, now_s, wrap_s=wrap_s, foreign=foreign)

    def _time_of(
        self,
        key: Hashable,
        stamp_s: float,
        now_s: float,
        *,
        wrap_s: float,
        quantised: bool = False,
        foreign: bool = False,
    ) -> tuple[float, float] | None:
        stamps = self._stamps
        reboots, suspected, refused = stamps.reboots, stamps.suspected, stamps.refused
        times = stamps.time_of(
            key, stamp_s, now_s, wrap_s=wrap_s, quantised=quantised, foreign=foreign
        )
        if stamps.reboots != reboots:
            self._report_restart(now_s)
        if stamps.suspected != suspected:
            self._report_other_clock(now_s)
        if stamps.refused != refused:
            self._counters.other_clock += 1
        elif times is None:
            self._counters.stale += 1
        if times is None or foreign or self._queue_s == 0.0:
            return times
        return times[0] - self._queue_s, times[1]

    def poll(self, now_s: float) -> None:
        """Report that two clocks stamp as one autopilot, or that one of them has ended, and that
        a queue's end is not known: its age is counted until an answer says otherwise."""
        silent_s = now_s - self._queue_taken_s
        if self._queue_s > 0.0 and silent_s >= RECENT_S:
            text = f"no answer to TIMESYNC for {silent_s:.0f} s: samples count as"
            self._report_queue(f"{text} {self._queue_s:.2f} s late still", now_s)
        contested = self._stamps.is_contested(now_s)
        if contested == self._contested:
            return
        self._contested = contested
        if contested:
            apart = _apart(self._stamps.suspect_ahead_s)
            text = f"two autopilots are {self._name}, one {apart} the other: neither is flown with"
            self._notices.append((SEVERITY_ERROR, text))
        else:
            text = f"only one autopilot sends as {self._name} again"
            self._notices.append((SEVERITY_INFO, text))

    def _report_other_clock(self, now_s: float) -> None:
        """Frames of another clock have consecutive stamps."""
        if now_s - self._noticed_s >= CLOCK_NOTICE_S:
            self._noticed_s = now_s
            apart = _apart(self._stamps.suspect_ahead_s)
            text = f"stamps of another clock, {apart} the autopilot's: refused"
            self._notices.append((SEVERITY_WARNING, text))

    def _report_restart(self, now_s: float) -> None:
        self._counters.reboots += 1
        self._restarted(now_s)
        what, leap_s = "autopilot restarted", self._stamps.leap_s
        if leap_s > 0.0:
            what = f"the autopilot's clock is another one, {_apart(leap_s)} the last"
        self._notices.append((SEVERITY_INFO, f"{what}: asking for its streams again"))


def _apart(ahead_s: float) -> str:
    """How one clock stands to another, in words."""
    return f"{abs(ahead_s):.1f} s {'ahead of' if ahead_s > 0.0 else 'behind'}"
