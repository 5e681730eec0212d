"""How regularly each stream of a log came."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tgl_soar.analysis.logs.flight_data import FlightData


class Stream(NamedTuple):
    """One stream of samples."""

    name: str
    samples: int
    rate_hz: float  # samples over time; NaN from fewer than two
    usual_s: float  # median time between two
    late_s: float  # which one of a hundred exceeds
    longest_s: float  # longest gap
    longest_at_s: float  # when it began
    gaps: int  # longer than GAP times the usual, and than GAP_S


GAP = 5.0
GAP_S = 0.1


def streams_of(flight: FlightData) -> list[Stream]:
    """Every stream that is more than a few samples, the fastest first."""
    found = []
    for name, times in flight.streams.items():
        steps = np.diff(times)
        if len(times) < 10 or times[-1] <= times[0]:
            continue
        usual = float(np.median(steps))
        at = int(np.argmax(steps))
        found.append(
            Stream(
                name=name,
                samples=len(times),
                rate_hz=len(steps) / float(times[-1] - times[0]),
                usual_s=usual,
                late_s=float(np.percentile(steps, 99.0)),
                longest_s=float(steps[at]),
                longest_at_s=float(times[at]),
                gaps=int(np.count_nonzero(steps > max(GAP_S, GAP * usual))),
            )
        )
    return sorted(found, key=lambda stream: -stream.rate_hz)
