"""When a sample was taken, from a stamp that counts whole milliseconds.

A sensor ticks evenly, t_k = a + k p, but its stamp is floor(t_k) in units of q = 1 ms: at
200 Hz a difference of two stamps errs by up to 20 %.  The line through many stamps does not:
a filter of growing memory (least squares of the last n periods, to N at most),

    r = s + q/2 - (t + k p)                by the middle of the stamp's millisecond
    t += 2 (2n - 1) / (n (n + 1)) r        k: whole periods since the sample before,
    p += 6 / (n (n + 1)) r                    more than one after a loss

is within 0.05 ms rms after a second.  A stamp is never wrong by more than its own millisecond:
the answer is kept inside [s, s + q], so that a stream which does not tick evenly loses nothing.
A line begins with a few steps that are alike; several samples in a row that do not fit it begin
a new one: another rate, or a pause.

What cannot be measured: where inside the millisecond an even number of milliseconds between samples
falls (a constant part of the delay, as any other).
"""

from __future__ import annotations

from typing import Final

QUANTUM_S: Final = 1e-3
MEMORY: Final = 400  # periods
MISFIT_S: Final = 1.5 * QUANTUM_S
MISFITS: Final = 3  # in a row: it ticks otherwise now
FIRST: Final = 5  # steps alike, within the stamps' grain, that begin a line
YOUNG: Final = 20  # periods: a line so short is given up at the first misfit
PAUSE_S: Final = 2.0
LATER_S: Final = 1e-6  # time goes on, if only just


class SensorClock:
    """Of one stream."""

    __slots__ = (
        "_alike",
        "_answer_s",
        "_memory",
        "_misfits",
        "_period_s",
        "_stamp_s",
        "_step_s",
        "_time_s",
    )

    def __init__(self) -> None:
        self._memory = 0  # periods in the line; 0: there is none yet
        self._time_s = 0.0
        self._period_s = 0.0
        self._stamp_s = float("-inf")
        self._alike = 0  # steps, of which the first was
        self._step_s = 0.0
        self._misfits = 0
        self._answer_s = float("-inf")

    @property
    def period_s(self) -> float:
        """Between two samples; 0: not known yet."""
        return self._period_s if self._memory else 0.0

    def recover(self, stamp_s: float) -> float:
        """When the sample of this stamp was taken; stamps must grow."""
        middle_s = stamp_s + 0.5 * QUANTUM_S
        step_s = stamp_s - self._stamp_s
        self._stamp_s = stamp_s
        if step_s > PAUSE_S:
            self._memory = self._alike = 0
        elif self._memory:
            self._follow(middle_s, step_s)
        else:
            self._begin(middle_s, step_s)
        reported_s = self._time_s if self._memory else middle_s
        answer_s = min(max(reported_s, stamp_s), stamp_s + QUANTUM_S)
        self._answer_s = max(answer_s, self._answer_s + LATER_S)
        return self._answer_s

    def _begin(self, middle_s: float, step_s: float) -> None:
        if self._alike == 0 or abs(step_s - self._step_s) > MISFIT_S:
            self._alike, self._step_s, self._time_s = 1, step_s, middle_s - step_s
        else:
            self._alike += 1
        if self._alike == FIRST:
            self._memory, self._misfits = FIRST, 0
            self._period_s = (middle_s - self._time_s) / FIRST
            self._time_s = middle_s

    def _follow(self, middle_s: float, step_s: float) -> None:
        periods = max(1, round((middle_s - self._time_s) / self._period_s))
        expected_s = self._time_s + periods * self._period_s
        misfit_s = middle_s - expected_s
        if abs(misfit_s) > MISFIT_S:
            self._misfits += 1
            self._time_s = expected_s  # one that was sent late does not measure the clock
            if self._memory < YOUNG or self._misfits >= MISFITS:
                self._memory = self._alike = 0
                self._begin(middle_s, step_s)
            return
        self._misfits = 0
        n = self._memory = min(self._memory + periods, MEMORY)
        self._time_s = expected_s + 2.0 * (2 * n - 1) / (n * (n + 1)) * misfit_s
        self._period_s += 6.0 / (n * (n + 1)) * misfit_s
