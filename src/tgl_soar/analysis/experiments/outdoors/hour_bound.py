"""What anybody could soar of an hour: the wind, the air over the hill and the polar are known.

    at any time    is there a place, inside the fence and CLEAR_MIN over the ground, where the wind
                   is between the polar's ends and its updraft at least the sink there?  No place
                   but the best of that instant is asked for, nor how to get there.
    until when     a path that knows the wind to come and is on no line: at every x the greatest
                   height that can be reached by then, at any airspeed of the polar, over ground
                   moved by whole cells of CELL_M in STEP_S.  It ends where no x is left.

The second knows too much and flies without error; but it does not trade speed for height, and so
is no proof for seconds.  The polar is taken as far as rollouts of the search take it.
"""

from __future__ import annotations

from math import cos
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.hill import HillField
from tgl_soar.air.wind_record import WindRecord
from tgl_soar.control.envelope import Fence
from tgl_soar.control.search.lift_search import SPEED_MAX_MARGIN
from tgl_soar.control.search.plan import FLOWN_THROUGH_MPS
from tgl_soar.types import GlidePolar

STEP_S: Final = 1.0
CELL_M: Final = 0.5
FASTEST_CELLS: Final = 12  # in a step, to either side: 6 m/s over the ground
NODES: Final = 60  # to each side of the box, of the places
WINDS_MPS: Final = 0.05  # between two winds that are tabulated

Floats = NDArray[np.float64]


class SoaredHill(NamedTuple):
    """Where it is soared, and with what."""

    radius_m: float
    fence: Fence
    clearance_m: float
    polar: GlidePolar
    flow_radius: float = 1.0  # of the flow, in those of the hill
    growth: float = 0.0  # of the wind with height, as of `air.hill.Hill`

    @property
    def speeds_mps(self) -> tuple[float, float]:
        """The slowest and the fastest airspeed."""
        polar = self.polar
        return polar.speed_min_mps - FLOWN_THROUGH_MPS, polar.speed_max_mps + SPEED_MAX_MARGIN


def sinks(polar: GlidePolar, speed_mps: Floats) -> Floats:
    """S(V) [m/s]."""
    found: Floats = polar.c0 + speed_mps * (
        polar.c1 + speed_mps * (polar.c2 + speed_mps * polar.c3)
    )
    return found


def _unit_flow(
    hill: SoaredHill, x_m: Floats, z_m: Floats
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """u and w of a wind of 1 m/s, and whether one may be there."""
    u, _, w = HillField(1.0, hill.radius_m * hill.flow_radius, hill.growth).wind(x_m, 0.0, z_m)
    clear = np.hypot(x_m, z_m) >= hill.radius_m + hill.clearance_m
    return u, w, clear & (z_m >= hill.fence.z_min_m) & (z_m <= hill.fence.z_max_m)


def soarable_winds(hill: SoaredHill, most_mps: float) -> tuple[Floats, NDArray[np.bool_]]:
    """Winds far away [m/s], and whether there is a place in each."""
    x = np.linspace(hill.fence.x_min_m, min(0.0, hill.fence.x_max_m), NODES)
    z = np.linspace(hill.fence.z_min_m, hill.fence.z_max_m, 2 * NODES)
    grid_x, grid_z = (each.ravel() for each in np.meshgrid(x, z, indexing="ij"))
    u, w, allowed = _unit_flow(hill, grid_x, grid_z)
    u, w = u[allowed], w[allowed]
    slowest, fastest = hill.speeds_mps
    winds = np.arange(0.0, most_mps + WINDS_MPS, WINDS_MPS)
    speeds = winds[:, None] * u
    flown = (speeds >= slowest) & (speeds <= fastest)
    return winds, np.any(flown & (winds[:, None] * w >= sinks(hill.polar, speeds)), axis=1)


def wind_across(record: WindRecord, duration_s: float) -> Floats:
    """The wind across the ridge [m/s], each STEP_S."""
    times = np.arange(0.0, duration_s, STEP_S)
    return np.array([record.wind_mps.at(t) * cos(record.veer_rad.at(t)) for t in times.tolist()])


def soarable_fraction(hill: SoaredHill, winds_mps: Floats) -> float:
    """The share of the time in which some place could be soared."""
    table, possible = soarable_winds(hill, float(winds_mps.max()))
    nearest = np.minimum(np.rint(winds_mps / WINDS_MPS).astype(int), len(table) - 1)
    return float(np.mean(possible[nearest]))


def longest_s(hill: SoaredHill, winds_mps: Floats, x_m: float, z_m: float) -> float:
    """For how long a path from a place goes on, that knows the winds to come."""
    fence = hill.fence
    x = np.arange(fence.x_min_m, min(0.0, fence.x_max_m) + 1e-9, CELL_M)
    heights = np.full(len(x), -np.inf)
    heights[int(np.argmin(np.abs(x - x_m)))] = z_m
    cells = np.arange(-FASTEST_CELLS, FASTEST_CELLS + 1)
    to = np.arange(len(x))[:, None] + cells
    inside = (to >= 0) & (to < len(x))
    to = np.where(inside, to, 0)
    slowest, fastest = hill.speeds_mps
    for n, wind in enumerate(winds_mps.tolist()):
        known = np.isfinite(heights)
        u, w, _ = _unit_flow(hill, x, np.where(known, heights, fence.z_max_m))
        speeds = (wind * u)[:, None] - cells * CELL_M / STEP_S
        climb = (wind * w)[:, None] - sinks(hill.polar, speeds)
        flown = inside & known[:, None] & (speeds >= slowest) & (speeds <= fastest)
        reached = np.where(flown, heights[:, None] + climb * STEP_S, -np.inf)
        after = np.full(len(x), -np.inf)
        np.maximum.at(after, to.ravel(), reached.ravel())
        after = np.minimum(after, fence.z_max_m)
        _, _, allowed = _unit_flow(hill, x, np.maximum(after, 0.0))
        heights = np.where(allowed & (after >= fence.z_min_m), after, -np.inf)
        if not np.any(np.isfinite(heights)):
            return n * STEP_S
    return len(winds_mps) * STEP_S
