"""The server's clock against ours, with a bound on how wrong that can be.

    ours = server's + offset

Whatever has come from the server was stamped before it came, so a frame bounds the offset from
above; an echo was stamped after we asked, so it bounds it from below as well:

    asked - stamp <= offset <= arrival - stamp

Together they are an interval.  The upper bound is the smallest of a window of frames (`ClockMap`),
so that one wrong stamp is dropped with the window; the lower one is the largest of all, less
`DRIFT` for every second since, as two quartzes run apart.  The offset is the middle of it and half
its width is how wrong it can be.  Where nothing is echoed there is no lower bound: the offset is
the upper one, which is wrong by the smallest delay on the way, and how much that is is not known.

A stamp that does not fit the interval is odd and is rejected.  Several in a row that fit
each other, over more than a moment of our own time, are a server that has restarted with
another clock: then the estimate is reset.
"""

from __future__ import annotations

from typing import Final

from tgl_soar.link.clock import AHEAD_S, ClockMap
from tgl_soar.types import INFINITE, NAN

DRIFT: Final = 1e-4  # s/s: more than two quartzes drift apart
LATE_S: Final = 1.0  # a frame that was under way for longer is odd
EARLY_S: Final = 0.002  # how far two bounds may contradict each other
RESET_STAMPS: Final = 3
RESET_S: Final = 0.1  # a burst that was held up does not last so long
RESET_APART_S: Final = 0.02


class ServerClock:
    """Maps a server's seconds to ours; times are arguments."""

    __slots__ = (
        "_low_s",
        "_odd",
        "_odd_from_s",
        "_odd_s",
        "_updated_s",
        "_upper",
        "restarts",
    )

    def __init__(self) -> None:
        self.restarts = 0
        self._upper = ClockMap()
        self._low_s = -INFINITE
        self._updated_s = NAN
        self._odd = 0  # stamps that fit each other and nothing else
        self._odd_s = self._odd_from_s = NAN

    def reset(self) -> None:
        """Nothing is known."""
        self._upper.reset()
        self._low_s = -INFINITE
        self._updated_s = NAN
        self._reset_odd()

    @property
    def _high_s(self) -> float:
        return self._upper.offset_s if self.is_known else INFINITE

    @property
    def is_known(self) -> bool:
        """Whether anything has come."""
        return self._upper.offset_s == self._upper.offset_s

    @property
    def offset_s(self) -> float:
        """Ours less the server's; NaN: not known."""
        if self._low_s > -INFINITE:
            return 0.5 * (self._low_s + self._high_s)
        return self._high_s if self.is_known else NAN

    @property
    def uncertainty_s(self) -> float:
        """How wrong the offset can be; infinite: that is not known."""
        return 0.5 * (self._high_s - self._low_s)

    def stamped(self, stamp_s: float, arrival_s: float) -> bool:
        """A frame was sent at `stamp_s` and has come; whether its stamp is accepted."""
        return self._take(stamp_s, -INFINITE, arrival_s)

    def echoed(self, stamp_s: float, asked_s: float, arrival_s: float) -> bool:
        """The server had our question at `stamp_s`; whether that is accepted."""
        return arrival_s >= asked_s and self._take(stamp_s, asked_s - stamp_s, arrival_s)

    def _take(self, stamp_s: float, low_s: float, arrival_s: float) -> bool:
        self._open(arrival_s)
        high_s = arrival_s - stamp_s
        if self.is_known and not self._fits(low_s, high_s):
            if not self._is_reset(high_s, arrival_s):
                return False
            self.reset()
            self.restarts += 1
            self._updated_s = arrival_s
        self._reset_odd()
        self._upper.observe(stamp_s, arrival_s)
        # The two may contradict each other by EARLY_S: then they touch.
        self._low_s = min(max(self._low_s, low_s), self._high_s)
        return True

    def _open(self, now_s: float) -> None:
        elapsed_s = now_s - self._updated_s
        if elapsed_s > 0.0:
            self._low_s -= DRIFT * elapsed_s
        if not elapsed_s <= 0.0:  # NaN: the first time
            self._updated_s = now_s

    def _fits(self, low_s: float, high_s: float) -> bool:
        oldest_s = self._low_s if self._low_s > -INFINITE else self._high_s - AHEAD_S
        return oldest_s - EARLY_S <= high_s <= self._high_s + LATE_S and (
            low_s <= self._high_s + EARLY_S
        )

    def _is_reset(self, observed_s: float, arrival_s: float) -> bool:
        if not (self._odd and abs(observed_s - self._odd_s) <= RESET_APART_S):
            self._odd, self._odd_s, self._odd_from_s = 1, observed_s, arrival_s
            return False
        self._odd += 1
        return self._odd >= RESET_STAMPS and arrival_s - self._odd_from_s >= RESET_S

    def _reset_odd(self) -> None:
        self._odd = 0
        self._odd_s = self._odd_from_s = NAN
