"""Where a log of gliding flight tells something of the aircraft: manoeuvres in steady flight.

A doublet of the elevator, a brake that goes out or in, and, where neither says what a brake does,
steady glides with the brake at another place.  For the ground only: takes arrays, imports numpy
when called.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from tgl_soar.estimation.polar import BRAKE_SLACK, BRAKE_SPAN

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

STEP_S: Final = 0.01  # of the model and of the grid that the log is put on
BEFORE_S: Final = 0.1  # of a manoeuvre, before the surface moves
AFTER_S: Final = 1.2  # and after it has come back
LEAST_STEP: Final = 0.08  # of the elevator, from one side to the other
QUIET_S: Final = 0.3  # the surface stands still for so long before a manoeuvre
QUIET: Final = 0.02
LONGEST_S: Final = 1.5
SHORTEST_S: Final = 0.1
ROLL_MAX_RAD: Final = 0.35
ALPHA_MAX_RAD: Final = 0.35
# Of glides with the brake at another place: as long as a manoeuvre, and no more of them than that
# the doublets still weigh most.
GLIDE_S: Final = 2.0
GLIDES_MOST: Final = 8


@dataclass(frozen=True)
class LongitudinalLog:
    """A log on one grid of `STEP_S`, each column of shape (n,), NaN where nothing is known."""

    time_s: Floats
    elevator: Floats  # commanded, −1 … 1
    pitch_rad: Floats
    pitch_rate_radps: Floats
    roll_rad: Floats
    airspeed_mps: Floats  # true
    path_angle_rad: Floats  # of the velocity through the air, positive up
    lift_force_mps2: Floats | None = None  # specific force across the path, up; None: unknown
    elevator_step_s: float = STEP_S  # between two samples of the elevator as it was logged
    brake: Floats | None = None  # commanded, 0 … 1; None: the aircraft has none


def manoeuvres(log: LongitudinalLog) -> list[slice]:
    """Where the elevator is moved to both sides out of rest, wings level, all of it measured."""
    return _moves(log, log.elevator, 0.25 * LEAST_STEP, _is_doublet)


def brakings(log: LongitudinalLog, doublets: Sequence[slice]) -> list[slice]:
    """What tells of the brake beside the doublets: where it leaves its rest by `BRAKE_SPAN`; where
    it never does, steady glides with it so far from where it stands in the doublets, if any."""
    if log.brake is None or not doublets:
        return []
    found: list[slice] = []
    for rows in _moves(log, log.brake, 0.25 * BRAKE_SPAN, _is_braking):
        last = found[-1].stop if found else 0
        if rows.start >= last and not any(_overlap(rows, each) for each in doublets):
            found.append(rows)
    return found or _glides_beside(log, log.brake, doublets)


def _glides_beside(log: LongitudinalLog, brake: Floats, doublets: Sequence[slice]) -> list[slice]:
    import numpy as np

    stands = [float(brake[rows].mean()) for rows in doublets]
    n = round(GLIDE_S / STEP_S)
    found = [
        rows
        for rows in (slice(k, k + n) for k in range(0, len(brake) - n, n))
        if np.ptp(brake[rows]) <= BRAKE_SLACK  # false for NaN
        and min(abs(float(brake[rows].mean()) - b) for b in stands) >= BRAKE_SPAN
        and not any(_overlap(rows, each) for each in doublets)
        and _is_measured(log, rows)
    ]
    return found[:: max(1, -(-len(found) // GLIDES_MOST))]


def _overlap(one: slice, other: slice) -> bool:
    return bool(one.start < other.stop and other.start < one.stop)


def _moves(
    log: LongitudinalLog, command: Floats, leaves_by: float, is_one: Callable[[Floats], bool]
) -> list[slice]:
    """Where one surface leaves its rest by more than that, and the move is one that is wanted."""
    import numpy as np

    n = len(command)
    quiet, before, after = (round(s / STEP_S) for s in (QUIET_S, BEFORE_S, AFTER_S))
    found: list[slice] = []
    if n <= quiet + after:
        return found
    rests = np.lib.stride_tricks.sliding_window_view(command, quiet)[:-1]  # before sample quiet …
    bases = rests.mean(axis=1)
    leaves = (np.ptp(rests, axis=1) <= QUIET) & (np.abs(command[quiet:] - bases) > leaves_by)
    k = 0
    for start in (np.flatnonzero(leaves) + quiet).tolist():
        if start < k or start >= n - after:
            continue
        k, base = start, float(bases[start - quiet])
        away = np.flatnonzero(np.abs(command[k : k + round(LONGEST_S / STEP_S)] - base) > leaves_by)
        end = k + int(away[-1]) + 1
        rows = slice(max(0, k - before), min(n, end + after))
        swing = command[k:end] - base
        if len(swing) * STEP_S >= SHORTEST_S and is_one(swing) and _is_measured(log, rows):
            found.append(rows)
        k = end + 1
    return found


def _is_doublet(swing: Floats) -> bool:
    return bool(swing.max() >= 0.5 * LEAST_STEP and swing.min() <= -0.5 * LEAST_STEP)


def _is_braking(swing: Floats) -> bool:
    return bool(abs(swing).max() >= BRAKE_SPAN)


def _is_measured(log: LongitudinalLog, rows: slice) -> bool:
    """Wings level, not stalled, nothing missing."""
    import numpy as np

    columns = [log.elevator, log.pitch_rad, log.pitch_rate_radps, log.airspeed_mps]
    if log.brake is not None:
        columns.append(log.brake)
    return bool(
        all(np.all(np.isfinite(column[rows])) for column in columns)
        and np.all(np.isfinite(log.path_angle_rad[rows]))
        and np.all(log.airspeed_mps[rows] > 1.0)
        and np.max(np.abs(log.roll_rad[rows])) <= ROLL_MAX_RAD
        and np.max(np.abs(log.pitch_rad[rows] - log.path_angle_rad[rows])) <= ALPHA_MAX_RAD
    )
