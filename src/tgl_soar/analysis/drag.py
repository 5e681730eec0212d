"""Drag from steady glides: the parabola C_D = C_D0 + k C_L² + C_Db b.

Steady, along and across the path: m g sin γ = Q S C_D, m g cos γ = Q S C_L, so every glide is one
pair (C_L, C_D), and least squares over them gives the three (C_Db only of glides at several b).
Above `ATTACHED` of the largest C_L that was glided at, with the brake as it stood, the flow may
begin to separate, which costs drag that no parabola has: those glides are left out where enough
remain.

For the ground only: imports numpy when called.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, hypot, sin
from typing import Final, NamedTuple

from tgl_soar.analysis.identification import KnownAircraft
from tgl_soar.estimation.polar import BRAKE_SLACK, BRAKE_SPAN, GlideStretch, student_t
from tgl_soar.types import GRAVITY_MPS2

# The stall of a wing begins some 2 to 3 degrees before its largest lift: with a slope of 4 to 6
# that is a fifth of a C_L of about one.
ATTACHED: Final = 0.8
FEWEST: Final = 5  # glides


class Drag(NamedTuple):
    """A coefficient with half of its band of 95 %."""

    name: str
    value: float
    half_band: float


def drag_of(glides: Sequence[GlideStretch], body: KnownAircraft) -> tuple[Drag, ...]:
    """CD0, CD_lift and, where the brake was moved, CD_brake.  Errors: ValueError for too few."""
    import numpy as np

    rows = []
    for glide in glides:
        speed = hypot(glide.speed_mps, glide.sink_mps)
        angle = atan2(glide.sink_mps, glide.speed_mps)
        weight = body.mass_kg * GRAVITY_MPS2
        weight /= 0.5 * body.air_density_kgpm3 * speed * speed * body.wing_area_m2
        rows.append((weight * cos(angle), weight * sin(angle), glide.brake))
    lift, drag, brake = np.array(rows).reshape(-1, 3).T
    beside = np.abs(brake[:, None] - brake[None, :]) <= BRAKE_SLACK
    attached = lift <= ATTACHED * np.where(beside, lift[None, :], 0.0).max(axis=1, initial=0.0)
    if attached.sum() >= FEWEST:
        lift, drag, brake = lift[attached], drag[attached], brake[attached]
    names = ["CD0", "CD_lift"]
    columns = [np.ones_like(lift), lift**2]
    if len(brake) and np.ptp(brake) >= BRAKE_SPAN:
        names.append("CD_brake")
        columns.append(brake)
    if len(lift) < max(FEWEST, len(names) + 2):
        raise ValueError(f"{len(glides)} steady glides: too few for a drag; {FEWEST} at least")
    known = np.column_stack(columns)
    found, *_ = np.linalg.lstsq(known, drag, rcond=None)
    left = drag - known @ found
    freedom = len(drag) - len(names)
    covariance = float(left @ left) / freedom * np.linalg.inv(known.T @ known)
    t = student_t(0.95, freedom)
    return tuple(
        Drag(name, float(value), t * float(np.sqrt(variance)))
        for name, value, variance in zip(names, found, np.diag(covariance), strict=True)
    )
