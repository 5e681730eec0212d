"""When the pose of a frame was true, on the loop's clock: the middle of its exposure.

In lockstep the server's clock is the vehicle's and nothing is mapped.
"""

from __future__ import annotations

from typing import Final

from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING
from tgl_soar.link.natnet.clock import ServerClock
from tgl_soar.link.natnet.diagnostics import OptitrackLedger
from tgl_soar.link.natnet.layout import MocapFrame

ODD_S: Final = 1.0  # no frame is sent so long after its exposure, no echo answered so late


class FrameTimes:
    """The stamps of one server."""

    def __init__(self, ledger: OptitrackLedger, *, lockstep: bool) -> None:
        self.clock = ServerClock()
        self._counters, self._notices = ledger
        self._lockstep = lockstep
        self._clock_hz = 0
        self._first_ticks: int | None = None
        self._newest_ticks = -1

    @property
    def uncertainty_s(self) -> float:
        """How wrong the times of fixes can be; infinite: not known."""
        return 0.0 if self._lockstep else self.clock.uncertainty_s

    def set_clock_rate(self, clock_hz: int) -> None:
        """Of the server's ticks; another rate is another clock."""
        if clock_hz != self._clock_hz:
            self._clock_hz, self._first_ticks = clock_hz, None
            self.clock.reset()

    def reset(self) -> None:
        """The next frame is the first."""
        self._newest_ticks = -1

    def has_restarted(self) -> bool:
        """Whether the server's clock has become another one since the last call."""
        if self.clock.restarts == 0:
            return False
        self.clock.restarts = 0
        return True

    def on_echo(self, stamp_ns: int, ticks: int, now_s: float) -> None:
        """The server's time, and when we asked for it."""
        requested_s = stamp_ns * 1e-9
        if self._lockstep or not now_s - ODD_S <= requested_s <= now_s:
            self._counters.odd += 1
            return
        restarts = self.clock.restarts
        self.clock.echoed(self._seconds(ticks), requested_s, now_s)
        if self.clock.restarts != restarts:
            self.reset()

    def time_of(self, frame: MocapFrame, now_s: float) -> float | None:
        """On the loop's clock; None: the frame is not used."""
        counters = self._counters
        sent = frame.sent_ticks or frame.exposed_ticks
        exposed = frame.exposed_ticks or sent
        if not frame.exposed_ticks:
            text = "frames have no mid-exposure time: they are taken for as old as the network is"
            self._notices.report("untimed", SEVERITY_WARNING, text)
        sent_s, exposed_s = self._seconds(sent), self._seconds(exposed)
        if not 0.0 <= sent_s - exposed_s <= ODD_S:
            counters.odd += 1
            text = "a frame was sent before it was exposed, or long after"
            self._notices.report("odd", SEVERITY_WARNING, text)
            return None
        restarts = self.clock.restarts
        if not self._is_of_the_clock(sent_s, now_s):
            counters.odd += 1
            text = "the server's clock is another one: waiting until it is known"
            self._notices.report("odd", SEVERITY_WARNING, text)
            return None
        if self.clock.restarts != restarts:
            self.reset()
        if exposed <= self._newest_ticks:
            counters.out_of_order += 1
            self._notices.report("order", SEVERITY_INFO, "frames come out of order or twice")
            return None
        self._newest_ticks = exposed
        return exposed_s if self._lockstep else min(now_s, exposed_s + self.clock.offset_s)

    def _is_of_the_clock(self, sent_s: float, now_s: float) -> bool:
        if self._lockstep:
            return abs(now_s - sent_s) <= ODD_S
        return self.clock.stamped(sent_s, now_s)

    def _seconds(self, ticks: int) -> float:
        """Of the server's clock, counted from the first stamp: so they are exact."""
        if self._first_ticks is None:
            self._first_ticks = 0 if self._lockstep else ticks
        return (ticks - self._first_ticks) / self._clock_hz
