"""How much of the wire is written down: so many bytes a second of each kind, whatever comes.

A log holds what was flown with, and old flights go for new ones.  So what anybody may send must
not decide how quickly.  Each kind of frame earns room at its own rate, up to `AT_ONCE_S` of it,
and what finds none is counted and left out.
"""

from __future__ import annotations

from typing import Final

AT_ONCE_S: Final = 10.0  # of what is earned in a second: a list of parameters, a burst after a gap

# In bytes a second, frames and their stamps in the .tlog.
# What we say: overrides at 400 Hz take 26 kB, a pose forwarded at 50 Hz 13 kB, telemetry the rest.
OURS: Final = 60_000
# From the autopilot's link: what a serial line at 921600 baud carries is 92 kB.
AUTOPILOT: Final = 100_000
# From all other links: two telemetry radios at 57600 baud, or a tracker's poses at 100 Hz.
STATIONS: Final = 20_000
# Refused, of strangers, or of a number that nobody here knows: a sample of three to twenty frames
# a second, a hundredth of what a flight takes.
REFUSED: Final = 1_000

REFUSED_PART: Final = 100  # one part in so many of all logs is the most that refused frames take

_PER_BYTE: Final = 1_000_000


class Allowance:
    """Room for one kind of frame; time is an argument, and may begin again."""

    def __init__(self, bytes_per_s: int, most_bytes: int = -1) -> None:
        """`most_bytes`: in all; -1: as much as it earns."""
        self.left_out = 0  # frames
        self.taken = 0
        self._bytes_per_s = bytes_per_s
        self._at_once = bytes_per_s * AT_ONCE_S * _PER_BYTE
        self._left = self._at_once  # in millionths of a byte: a byte a second earns one in 1 us
        self._most_bytes = most_bytes
        self._time_us = 0

    def takes(self, size: int, time_us: int) -> bool:
        """Whether there is room for a frame now; it is counted."""
        if time_us != self._time_us:
            earned = max(0, time_us - self._time_us) * self._bytes_per_s
            self._left = min(self._at_once, self._left + earned)
            self._time_us = time_us
        if size * _PER_BYTE > self._left or 0 <= self._most_bytes < size:
            self.left_out += 1
            return False
        self._left -= size * _PER_BYTE
        if self._most_bytes >= 0:
            self._most_bytes -= size
        self.taken += 1
        return True


class WireAllowance:
    """The room of every kind of frame."""

    def __init__(self, largest_bytes: int) -> None:
        """`largest_bytes`: of all logs together."""
        self.ours = Allowance(OURS)
        self.autopilot = Allowance(AUTOPILOT)
        self.stations = Allowance(STATIONS)
        self.refused = Allowance(REFUSED, largest_bytes // REFUSED_PART)

    @property
    def left_out(self) -> int:
        """Frames that were not written down, for there were too many of their kind."""
        kinds = self.ours, self.autopilot, self.stations, self.refused
        return sum(kind.left_out for kind in kinds)

    @property
    def strangers(self) -> str:
        """How many of those left out were refused ones, in words for the log."""
        return (
            f"{self.refused.left_out} of them refused or of strangers; of these"
            f" {self.refused.taken} are"
        )

    @property
    def summary(self) -> str:
        """Words for the console at the end of a flight."""
        return (
            f"flight log: {self.left_out} frames of a flood are not in the .tlog,"
            f" {self.refused.left_out} of them refused or of strangers"
        )
