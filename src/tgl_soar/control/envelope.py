"""The envelope: the last limiter before the surfaces, independent of the laws.

    |u| <= deflection_max,   |u - u_last| <= rate_max dt

A command that is not finite never passes: the caller is told and lets go.
"""

from __future__ import annotations

from math import isfinite
from typing import NamedTuple

from tgl_soar.types import SurfaceCommand


class EnvelopeLimits(NamedTuple):
    """What a surface may be told."""

    deflection_max: float  # of full travel
    rate_max_per_s: float  # full travels a second


class Limited(NamedTuple):
    """The command that may be sent, and what was cut."""

    command: SurfaceCommand
    elevator_blocked: int  # +1: can deflect no further up, -1: no further down, else 0
    aileron_blocked: int
    finite: bool


def limit_surfaces(
    limits: EnvelopeLimits, last: SurfaceCommand, wanted: SurfaceCommand, dt_s: float
) -> Limited:
    """The wanted command within travel and rate; the last one, within travel, where it is not
    finite.  A dt_s that is negative or NaN counts as zero."""
    finite = isfinite(wanted.elevator) and isfinite(wanted.aileron) and isfinite(wanted.rudder)
    if not finite:
        wanted = last
    most = max(0.0, limits.rate_max_per_s * dt_s)  # in this order: 0 for NaN
    elevator = limit_one(limits.deflection_max, most, last.elevator, wanted.elevator)
    aileron = limit_one(limits.deflection_max, most, last.aileron, wanted.aileron)
    rudder = limit_one(limits.deflection_max, most, last.rudder, wanted.rudder)
    return Limited(
        SurfaceCommand(elevator, aileron, rudder),
        blocked_side(limits.deflection_max, elevator, wanted.elevator),
        blocked_side(limits.deflection_max, aileron, wanted.aileron),
        finite,
    )


def limit_one(deflection_max: float, change_max: float, last: float, wanted: float) -> float:
    """One deflection within its travel and, where travel allows, its change from the last."""
    # NaN would pass the limits below, as full deflection or full rate.
    if last != last:
        last = 0.0
    if wanted != wanted:
        wanted = last
    within_rate = max(last - change_max, min(last + change_max, wanted))
    return max(-deflection_max, min(deflection_max, within_rate))


def blocked_side(deflection_max: float, given: float, wanted: float) -> int:
    """+1 or -1 where a surface can go no further that way, or not as fast as asked; else 0."""
    if given >= deflection_max or given < wanted:
        return 1
    if given <= -deflection_max or given > wanted:
        return -1
    return 0
