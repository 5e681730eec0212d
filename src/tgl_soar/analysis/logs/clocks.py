"""Clocks that jump, and stamps that are nonsense, put right as far as they can be."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.logs.ulog_reader import LEAP_S

Floats = NDArray[np.float64]

REST_S = 1.0  # is left of such a leap
OUT_OF_ORDER_S = 0.5  # a step back by less is a sample that came late


class Straightened:
    """Time stamps of streams made into one flight time that never runs backwards.

    rows: for each stream, which of its samples are kept, in which order.
    time_s: their times, from the flight's first sample on.
    lost: what was put right, in words.
    """

    def __init__(self, stamps: Mapping[str, Floats]) -> None:
        self.rows: dict[str, NDArray[np.intp]] = {}
        self.time_s: dict[str, Floats] = {}
        self.lost: list[str] = []
        self._cuts: list[tuple[float, float]] = []  # after what time, how much; the last first
        for name, times in stamps.items():
            self._take(name, np.asarray(times, dtype=float))
        self._undo_steps_back()
        self._cut_leaps()
        begins = [times.min() for times in self.time_s.values() if times.size]
        self.start_s = float(min(begins, default=0.0))  # of the flight, log's clock
        for name, times in self.time_s.items():
            order = np.argsort(times, kind="stable")  # what came late goes to its place
            self.rows[name] = self.rows[name][order]
            self.time_s[name] = times[order] - self.start_s

    def _take(self, name: str, times: Floats) -> None:
        """Leave out stamps that are no time, or stand alone far from both neighbours."""
        good = np.isfinite(times) & (times >= 0.0)
        rows = np.flatnonzero(good)
        kept = times[rows]
        if kept.size > 2:
            before, here, after = kept[:-2], kept[1:-1], kept[2:]
            near = (after >= before) & (after - before <= LEAP_S)
            apart = np.minimum(np.abs(here - before), np.abs(here - after)) > OUT_OF_ORDER_S
            between = (here >= before) & (here <= after)
            alone = np.concatenate([[False], near & apart & ~between, [False]])
            # The first and the last have one neighbour only.
            alone[0] = abs(kept[1] - kept[0]) > LEAP_S and abs(kept[2] - kept[1]) <= LEAP_S
            alone[-1] = abs(kept[-1] - kept[-2]) > LEAP_S and abs(kept[-2] - kept[-3]) <= LEAP_S
            rows, kept = rows[~alone], kept[~alone]
        if len(rows) < len(times):
            count = len(times) - len(rows)
            self.lost.append(f"{name}: {count} of {len(times)} samples with an impossible time")
        self.rows[name], self.time_s[name] = rows, kept

    def _undo_steps_back(self) -> None:
        """Where the clock was set back, time goes on from where it was."""
        reference = max(self.time_s, key=lambda name: len(self.time_s[name]), default=None)
        if reference is None:
            return
        steps = _steps_back(self.time_s[reference])
        for _, by in steps:
            self.lost.append(
                f"the clock ran back by {by:.3g} s: from there on time is continued, and what is"
                " told of the moment itself is not to be trusted"
            )
        for name, times in self.time_s.items():
            own = _steps_back(times)
            if len(own) == len(steps):  # one step for all, so that the streams stay together
                own = [(at, by) for (at, _), (_, by) in zip(own, steps, strict=True)]
            elif name != reference and len(own) > len(steps):
                self.lost.append(f"{name}: its time ran back on its own {len(own)} times")
            for at, by in own:
                times[at:] += by

    def _cut_leaps(self) -> None:
        if not self.time_s:
            return
        every = np.sort(np.concatenate(list(self.time_s.values())))
        gaps = np.diff(every)
        for i in np.flatnonzero(gaps > LEAP_S)[::-1]:
            self.lost.append(
                f"{gaps[i]:.4g} s without a sample: the clock leapt or nothing was recorded;"
                f" {REST_S:g} s of it is left"
            )
            self._cuts.append((float(every[i]), float(gaps[i] - REST_S)))
            for times in self.time_s.values():
                times[times > every[i]] -= gaps[i] - REST_S

    def moved(self, stamp_s: float) -> float:
        """The flight time [s] of something else that the same clock stamped, leaps cut out of it.

        Where the clock was set back nothing tells on which side of that it was: it stays.
        """
        for after_s, cut_s in self._cuts:
            if stamp_s > after_s:
                stamp_s = max(after_s, stamp_s - cut_s)
        return stamp_s - self.start_s


def _steps_back(times: Floats) -> list[tuple[int, float]]:
    """Where time steps back, and by how much it must be moved on to go on at its usual pace."""
    steps = np.diff(times)
    back = np.flatnonzero(steps < -OUT_OF_ORDER_S).tolist()
    if not back:
        return []
    usual = float(np.median(steps))
    return [(i + 1, usual - steps[i]) for i in back]
