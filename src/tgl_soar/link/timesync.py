"""How long the way to the autopilot and back is, and how far its clock is from ours.

    we ask with our time t0; it answers with its own time t; the answer comes at t1
    round trip = t1 - t0,    offset = t - (t0 + t1) / 2

The offset is wrong by at most half of what the two ways differ, so the quickest answer of the
last few measures it best.  Both are kept to be looked at: samples are placed in time by their
arrival (`clock`), which needs no answers and is right to the smallest delay.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from tgl_soar.link.messages import Timesync

ASK_S: Final = 1.0
KEPT: Final = 8  # answers among which the quickest is looked for
WAITING: Final = 4  # questions whose answer is still waited for

NAN: Final = float("nan")


class RoundTrip:
    """Asks once a second; time is an argument."""

    def __init__(self) -> None:
        self.asked = 0
        self.answered = 0
        self.round_trip_s = NAN  # of the newest answer
        self.offset_s = NAN  # the autopilot's clock less ours, by the quickest answer
        self._due_s = float("-inf")
        self._waiting: deque[int] = deque(maxlen=WAITING)
        self._kept: deque[tuple[float, float]] = deque(maxlen=KEPT)

    def poll(self, now_s: float) -> Timesync | None:
        """A question, if one is due."""
        if now_s < self._due_s:
            return None
        self._due_s = now_s + ASK_S
        self.asked += 1
        stamp_ns = max(1, round(now_s * 1e9))
        self._waiting.append(stamp_ns)
        return Timesync(0, stamp_ns)

    def take(self, answer: Timesync, now_s: float) -> None:
        """An answer; one to another's question, or a second one, is ignored."""
        if answer.ts1 not in self._waiting:
            return
        self._waiting.remove(answer.ts1)
        asked_s = answer.ts1 * 1e-9
        self.answered += 1
        self.round_trip_s = max(0.0, now_s - asked_s)
        self._kept.append((self.round_trip_s, answer.tc1 * 1e-9 - 0.5 * (asked_s + now_s)))
        self.offset_s = min(self._kept)[1]

    def restart(self) -> None:
        """A clock was restarted: nothing is known."""
        self.round_trip_s = self.offset_s = NAN
        self._due_s = float("-inf")
        self._waiting.clear()
        self._kept.clear()
