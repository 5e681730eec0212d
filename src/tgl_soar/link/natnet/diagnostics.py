"""What all parts of an OptiTrack client write to: counters, and notices of outages.

Each kind of outage is reported once, and again only after poses have been used in between, which
is reported too.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final, NamedTuple

from tgl_soar.link.messages import SEVERITY_INFO
from tgl_soar.types import NAN, isfinite

REARM_S: Final = 10.0  # between two notices of a kind: what flickers must not fill the radio

# While one of these lasts no pose is used: when one is again, that is reported.
OUTAGES: Final = frozenset(
    ("silent", "nobody", "frameless", "odd", "stale", "absent", "untracked", "finite", "frozen",
     "jump", "poor", "body", "version")
)  # fmt: skip
# Caused by single datagrams, while poses may go on: over as soon as a pose is used.
SINGLE: Final = frozenset(("malformed", "truncated", "oversized"))


@dataclass(slots=True)
class OptitrackCounters:
    """What came, and what of it was no measurement."""

    frames: int = 0
    fixes: int = 0
    foreign: int = 0
    truncated: int = 0
    oversized: int = 0
    malformed: int = 0
    unready: int = 0
    odd: int = 0
    out_of_order: int = 0
    stale: int = 0
    absent: int = 0
    untracked: int = 0
    not_finite: int = 0
    frozen: int = 0
    poor: int = 0
    jumps: int = 0
    settling: int = 0
    thinned: int = 0
    wrong_version: int = 0
    unknown: int = 0  # messages of a number that is not used
    restarts: int = 0  # of the server

    def summary(self) -> str:
        """All that is not zero, in words."""
        counted = ((f.name.replace("_", " "), getattr(self, f.name)) for f in fields(self))
        return ", ".join(f"{count} {name}" for name, count in counted if count)


class OutageNotices:
    """Notices for the operator; time is an argument, or was one of the last poll or datagram."""

    def __init__(self) -> None:
        self.texts: list[tuple[int, str]] = []  # (severity, text)
        self.now_s = 0.0
        self._reported_s: dict[str, float] = {}  # when each kind was reported last
        self._out = False  # reported that no pose is used, and none was since
        self._back_s = float("-inf")  # when poses were used again
        self._used_s = NAN  # when a pose was used last

    def rebase(self) -> None:
        """The loop's clock is another one from here on."""
        self._reported_s.clear()
        self._back_s, self._used_s = float("-inf"), NAN

    def add(self, severity: int, text: str) -> None:
        """A notice of what happens once."""
        self.texts.append((severity, f"OptiTrack: {text}"))

    def report(self, kind: str, severity: int, text: str) -> None:
        """A notice of a kind, once in an outage."""
        last_s = self._reported_s.get(kind)
        over_s = self._used_s if kind in SINGLE else self._back_s  # NaN: none was used
        if last_s is not None and not (over_s > last_s and self.now_s - last_s >= REARM_S):
            return
        self._reported_s[kind] = self.now_s
        self._out = self._out or kind in OUTAGES
        self.add(severity, text)

    def pose_used(self, now_s: float) -> None:
        """A pose is used: an outage, if there was one, has ended."""
        if self._out:
            gap_s = self.now_s - self._used_s
            words = f"stream is back after {gap_s:.1f} s" if isfinite(gap_s) else "stream is there"
            self._out, self._back_s = False, self.now_s
            self.add(SEVERITY_INFO, words)
        self._used_s = now_s


class OptitrackLedger(NamedTuple):
    """Shared by all parts of one client."""

    counters: OptitrackCounters
    notices: OutageNotices
