"""What of a NatNet stream is used: the `[mocap]` table of a site file."""

from __future__ import annotations

from typing import NamedTuple

from tgl_soar.geometry import HallFrame


class OptitrackSettings(NamedTuple):
    """One server, one rigid body, and the limits of what is used."""

    server: str  # its address; "": whichever answers first
    body: str | int  # name or streaming id
    unicast: bool
    hall: HallFrame
    noise_m: float
    max_error_m: float
    max_speed_mps: float
    max_age_s: float
    max_rate_hz: float
