"""The vehicle's clock against ours.

A sample is stamped by the vehicle when it was true and arrives d later:

    arrival = stamp + offset + d,    d >= 0

The smallest arrival - stamp seen is the offset plus the smallest delay; the jitter of all other
samples is gone.  It is forgotten at `FORGET` per second, so that two quartzes that run apart
are followed; a constant part of the delay cannot be seen (EST_DELAY is for that).
"""

from __future__ import annotations

from typing import Final

FORGET: Final = 1e-4  # s/s: more than two quartzes drift apart
REBOOT_S: Final = 1.0  # further back than this, it may have begun anew
REBOOT_STAMPS: Final = 3  # so many in a row that count on from there: it has

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
