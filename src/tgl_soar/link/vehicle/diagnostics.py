"""What all parts of a session write to: counters, notices, and which messages have come."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from tgl_soar.link.stream_requests import StreamRequests


@dataclass(slots=True)
class SessionCounters:
    """What was received and what was refused."""

    heartbeats: int = 0
    attitudes: int = 0  # taken
    positions: int = 0  # taken
    stale: int = 0  # repeated or out of order
    other_clock: int = 0  # stamped by another clock than the autopilot's, or while two are used
    not_finite: int = 0
    ranges: int = 0  # taken
    no_range: int = 0  # of a rangefinder: out of its reach, no valid signal, or not looking down
    no_measurement: int = 0  # of accelerations or airspeed that cannot be
    far: int = 0  # GLOBAL_POSITION_INT that is nowhere near the home
    wrong_frame: int = 0  # ODOMETRY in a frame that is not understood
    foreign: int = 0  # measurements of another system or component
    reboots: int = 0


class Ledger(NamedTuple):
    """Shared by all parts of one session."""

    counters: SessionCounters
    notices: list[tuple[int, str]]  # (severity, text), for the operator
    streams: StreamRequests
