"""When to tick, and what time it is: two ways.

On an aircraft the loop's clock is this computer's and `pacing.Pacer` says when to tick.

In lockstep the loop's clock is the vehicle's: each new ATTITUDE_QUATERNION is exactly one tick at
its own time stamp, and as everything is handled in the order in which it came, the answer to a
TIMESYNC tells the simulator that all before it is done.  Before the first attitude, which the
simulator sends unasked, the autopilot gets nothing but heartbeats: whatever was asked of it would
come earlier or later as the machine is fast or slow.  Where attitudes fail the stamps of the
TIMESYNCs keep the clock going: silence must not stop time.
"""

from __future__ import annotations

from math import inf
from typing import Final

from tgl_soar.link.messages import Timesync
from tgl_soar.onboard import pacing
from tgl_soar.types import NAN

MISSED_TICKS: Final = 1.5  # lockstep: so long without an attitude, its tick is missing
IDLE_S: Final = 0.05  # how often to look around while nothing sets the pace

NO_TICK: Final = 0  # what an attitude means in lockstep
TICK: Final = 1
RESTART: Final = 2  # a tick, the first by the vehicle's clock


class Clocking:
    """The loop's time."""

    def __init__(self, rate_hz: float, now_s: float, *, lockstep: bool) -> None:
        self.pacer = pacing.Pacer(rate_hz, now_s)
        self.load_shedding = pacing.LoadShedding()
        self.lockstep = lockstep
        self.by_vehicle = False  # lockstep, and the first attitude has come
        self.stepped_s = -inf  # lockstep: the time of the last tick
        self._attitude_stepped = False  # since the last TIMESYNC
        self._timesync_ahead_s = NAN  # of its stamp, before an attitude's
        self._reboots = 0

    def now_s(self, now_s: float) -> float:
        """The loop's time, at a time of this computer's clock."""
        return self.stepped_s if self.by_vehicle else now_s

    # --- by this computer's clock -------------------------------------------------------------

    def due(self, now_s: float) -> bool:
        """Whether to tick now."""
        return not self.lockstep and self.pacer.due(now_s)

    def overdue(self, now_s: float) -> bool:
        """Whether a tick can wait no longer, not even for what has come but was not read yet."""
        return not self.lockstep and now_s >= self.pacer.wake_s

    def wake_s(self, now_s: float) -> float:
        """When to look again if nothing arrives."""
        return now_s + IDLE_S if self.lockstep else self.pacer.wake_s

    @property
    def warm_up_s(self) -> float:
        """When to go through a tick for nothing; inf: not now."""
        if self.lockstep or self.load_shedding.no_telemetry:
            return inf
        return self.pacer.warm_up_s

    # --- in lockstep --------------------------------------------------------------------------

    def attitude(self, stamp_s: float, reboots: int) -> int:
        """An attitude has come: NO_TICK, TICK or RESTART, at `stepped_s` then.

        `stamp_s`: the vehicle's time; `reboots`: how often it has begun again.
        """
        starts = not self.by_vehicle or reboots != self._reboots
        if not starts and stamp_s <= self.stepped_s:
            return NO_TICK  # it comes late: time is further already
        self.by_vehicle = True
        self._reboots = reboots
        self._attitude_stepped = True
        self.stepped_s = stamp_s
        return RESTART if starts else TICK

    def timesync(self, message: Timesync, rate_hz: float) -> bool:
        """A TIMESYNC ends a step of the vehicle; whether a missing tick is to be made up for, at
        `stepped_s` then."""
        if message.tc1 != 0:
            return False
        stamp_s = message.ts1 * 1e-9
        if self._attitude_stepped:
            self._attitude_stepped = False
            self._timesync_ahead_s = stamp_s - self.stepped_s
            return False
        now_s = stamp_s - self._timesync_ahead_s
        if now_s - self.stepped_s >= MISSED_TICKS / rate_hz:  # not for NaN
            self.stepped_s = now_s
            return True
        return False
