"""A machine that cannot keep up with real time: how much is given up, and when to report it."""

from __future__ import annotations

from typing import Final

TOO_SLOW: Final = "this machine is too slow for real time"
HICCUP_S: Final = 0.15  # without a step: an attitude older than AGE_ATT_MAX (0.2 s) ends a flight
SLOW_FRACTION: Final = 0.05  # of the time, given up: the aircraft is flown in another time's air
SLOW_EVERY_S: Final = 10.0  # between two reports


class Slowness:
    """What of real time is given up, and when that is worth a report."""

    def __init__(self, now_s: float) -> None:
        self.given_up_s = 0.0
        self._since_s = now_s
        self._lost_s = self._worst_s = 0.0  # since then

    def lose(self, lost_s: float) -> None:
        """So much is not caught up with."""
        self.given_up_s += lost_s
        self._lost_s += lost_s
        self._worst_s = max(self._worst_s, lost_s)

    def report(self, now_s: float) -> str:
        """What to report now; "" if nothing.  A hiccup at once, the rest once in a while."""
        over_s = now_s - self._since_s
        if over_s < SLOW_EVERY_S and (self._worst_s < HICCUP_S or over_s < 1.0):
            return ""
        lost_s, worst_s = self._lost_s, self._worst_s
        self._since_s, self._lost_s, self._worst_s = now_s, 0.0, 0.0
        if worst_s < HICCUP_S and lost_s < SLOW_FRACTION * over_s:
            return ""
        return (
            f"{TOO_SLOW}: {lost_s:.2f} s of the last {over_s:.1f} s were given up,"
            f" {worst_s:.2f} s at once; close other programs, or fly in lockstep"
        )
