"""How long the way to the autopilot and back is, and how far its clock is from ours.

    we ask with our time t0; it answers with its own time t; the answer comes at t1
    round trip = t1 - t0,    offset = t - (t0 + t1) / 2

The offset is wrong by at most half of what the two ways differ, so the quickest answer of the
last few measures it best.  It is kept to be looked at: samples are placed in time by their
arrival (`clock`), which needs no answers and is right to the smallest delay of its window.

A queue that lasts longer than that window is taken for the clock there, and one that grows slowly
is never noticed, however long it gets.  The round trip shows both, whatever the clocks do: by

    queue = quickest of the last RECENT_S - quickest ever - SLACK_S

the samples are older than their arrivals say.  RECENT_S is longer than the window of `clock`, so
that no queue counts twice.  A queue on the way to the autopilot counts as well: the loop is closed
that much later all the same.
"""

from __future__ import annotations

from collections import deque
from math import inf
from typing import Final

from tgl_soar.link.clock import WINDOW_S
from tgl_soar.link.messages import Timesync
from tgl_soar.types import NAN

ASK_S: Final = 1.0
ASK_QUEUED_S: Final = 0.2  # so soon after its end a queue is no longer counted
RECENT_S: Final = WINDOW_S + ASK_S
RECENT_LEAST: Final = 3  # answers, however long ago: one that is slow after a silence is no queue
# An autopilot answers in its slow loop, and our question may wait behind a parameter: half of the
# age from which the pitch loop oscillates (`clock.AHEAD_S`) is no queue.
SLACK_S: Final = 0.05
KEPT: Final = 8  # answers among which the quickest is looked for
WAITING: Final = 16  # questions whose answer is still waited for


class RoundTrip:
    """Asks once a second, and more often while there is a queue; time is an argument."""

    def __init__(self) -> None:
        self.asked = 0
        self.answered = 0
        self.round_trip_s = NAN  # of the newest answer
        self.offset_s = NAN  # the autopilot's clock less ours, by the quickest answer
        self.queue_s = 0.0  # by which samples are older than their arrivals say
        self._quickest_s = inf  # of all answers
        self._recent: deque[tuple[float, float]] = deque()  # (when it came, round trip)
        self._due_s = float("-inf")
        self._waiting: deque[int] = deque(maxlen=WAITING)
        self._kept: deque[tuple[float, float]] = deque(maxlen=KEPT)

    def poll(self, now_s: float) -> Timesync | None:
        """A question, if one is due."""
        if now_s < self._due_s:
            return None
        self._due_s = now_s + (ASK_QUEUED_S if self.queue_s > 0.0 else ASK_S)
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
        self._measure_queue(now_s)

    def _measure_queue(self, now_s: float) -> None:
        """From the newest round trip and those before; one slow answer is no queue."""
        recent = self._recent
        self._quickest_s = min(self._quickest_s, self.round_trip_s)
        recent.append((now_s, self.round_trip_s))
        while len(recent) > RECENT_LEAST and recent[0][0] < now_s - RECENT_S:
            recent.popleft()
        quickest_s = min([round_trip_s for _, round_trip_s in recent])
        self.queue_s = max(0.0, quickest_s - self._quickest_s - SLACK_S)

    def restart(self) -> None:
        """A clock was restarted: nothing is known."""
        self.round_trip_s = self.offset_s = NAN
        self.queue_s, self._quickest_s = 0.0, inf
        self._recent.clear()
        self._due_s = float("-inf")
        self._waiting.clear()
        self._kept.clear()
