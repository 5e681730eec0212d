"""The topics of a ULog, whoever wrote it, on one flight time."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.logs.clocks import Straightened
from tgl_soar.analysis.logs.flight_data import Event, Series, parameter_events, series
from tgl_soar.analysis.logs.ulog_reader import FlightLog, LogError

Floats = NDArray[np.float64]


class Topics:
    """Rows in the order of their times, seconds from the first.  Errors: `LogError` without any."""

    def __init__(self, log: FlightLog) -> None:
        timed = {
            name: rows
            for name, rows in log.topics.items()
            if "timestamp" in rows and len(rows["timestamp"])
        }
        if not timed:
            raise LogError(f"{log.path}: a ULog without a single sample")
        clocks = Straightened({name: rows["timestamp"] * 1e-6 for name, rows in timed.items()})
        self.time_s = clocks.time_s
        self.start_s = clocks.start_s
        # How the clock ran back or leapt is reported by what straightened it.
        reported = [loss for loss in log.losses if "the clock " not in loss]
        self.lost = (*reported, *clocks.lost)
        self._rows: dict[str, dict[str, NDArray[Any]]] = {
            name: {key: values[clocks.rows[name]] for key, values in rows.items()}
            for name, rows in timed.items()
        }
        self._log = log
        self._clocks = clocks

    def has(self, topic: str, name: str) -> bool:
        """Whether a topic has rows and this column."""
        return name in self._rows.get(topic, {})

    def column(self, topic: str, name: str) -> Floats:
        """A column as floats; NaN throughout where the topic has none of that name."""
        rows = self._rows[topic]
        if name in rows:
            return np.asarray(rows[name], dtype=float)
        return np.full(len(self.time_s[topic]), np.nan)

    def take(self, topic: str, columns: dict[str, str]) -> Series | None:
        """Columns of a topic (our name: the log's), its rows in which the first is a number.

        None where there is no such row.
        """
        first = next(iter(columns.values()))
        if not self.has(topic, first):
            return None
        found = {ours: self.column(topic, theirs) for ours, theirs in columns.items()}
        good = np.isfinite(self.column(topic, first))
        parts = {name: values[good] for name, values in found.items()}
        return series(self.time_s[topic][good], topic, **parts)

    def rows(self, topic: str, columns: dict[str, str]) -> Series | None:
        """Columns of a topic, every row of it; None where it has not all of them."""
        if not all(self.has(topic, name) for name in columns.values()):
            return None
        found = {ours: self.column(topic, theirs) for ours, theirs in columns.items()}
        return series(self.time_s[topic], topic, **found)

    def events(self) -> list[Event]:
        """Texts and changes of parameters."""
        moved = self._clocks.moved
        texts = [Event(moved(w.time_s), "message", w.text.strip()) for w in self._log.words]
        changes = [(moved(c.time_s), c.name, c.value) for c in self._log.changes]
        return [*texts, *parameter_events(self.parameters(), changes)]

    def parameters(self) -> dict[str, float]:
        """At the beginning; what damage has made no number is left out."""
        values: dict[str, object] = dict(self._log.parameters)
        return {k: float(v) for k, v in values.items() if isinstance(v, int | float)}
