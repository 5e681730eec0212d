"""One step of a line that is flown ahead, and what it reads of a grid on the way.

Each function takes arrays of fields and lines, as `rollout` flies them, or one number of each:
nothing in it is about arrays, so that the simulation compiles the same source (`sim.lines_ahead`)
for the thousands of plans of an experiment.  No sine and no logarithm is in it, so that both give
the same numbers to the last bit.  The equations are those of `rollout`.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np

from tgl_soar.estimation.lift_map.basis import Floats
from tgl_soar.estimation.lift_map.extended_polar import sink_at
from tgl_soar.types import GRAVITY_MPS2, GlidePolar

Numbers = Any  # an array, or where it is compiled one number

LAG_LEAST_S: Final = 0.02  # of an upright line, which has none
SLOWEST_MPS: Final = 1.0
EDGE: Final = 1.000001  # nodes from the last one: so near it there is still a cell


class Floor(NamedTuple):
    """The ground's profile in stretches from corner to corner, level before and beyond: of n
    corners n + 1."""

    corner_x_m: Floats  # (n,) growing
    height_m: Floats  # (n + 1,) of each stretch, carried on to x = 0
    slope: Floats  # (n + 1,)
    steepness: Floats  # (n + 1,) cosine of its slope


class Mesh(NamedTuple):
    """The nodes of a grid, and the ground below them."""

    x_min_m: float
    z_min_m: float
    x_per_m: float  # nodes in a metre
    z_per_m: float
    nx: int
    nz: int
    floor: Floor


class Within(NamedTuple):
    """What a rollout keeps within, and how its line may be moved."""

    x_min_m: float
    x_max_m: float
    z_min_m: float
    z_max_m: float
    clearance_m: float
    speed_min_mps: float
    speed_max_mps: float
    slide_mps: float
    acceleration_mps2: float


class LineWay(NamedTuple):
    """Where a line is to go, and how it is inclined now."""

    x_m: Numbers
    z_m: Numbers
    sine: Numbers  # of the target's inclination
    cosine: Numbers
    sine_now: Numbers
    cosine_now: Numbers


class Ahead(NamedTuple):
    """The aircraft and its line after a step."""

    x_m: Numbers
    z_m: Numbers
    climb_mps: Numbers
    speed_mps: Numbers  # of the line across itself
    margin_m: Numbers  # least distance to ground, ceiling and fence, beyond the guards
    aside_mps: Numbers  # to the nearer end of the airspeeds


def air_at(
    mesh: Mesh, wind: Floats, updraft: Floats, first: Numbers, x_m: Numbers, z_m: Numbers
) -> tuple[Numbers, Numbers]:
    """u and w [m/s] of fields (m · nx · nz,), bilinear; beyond the grid its edge's.

    first: where in them the field of each place begins.
    """
    nz = mesh.nz
    across = (x_m - mesh.x_min_m) * mesh.x_per_m
    up = (z_m - mesh.z_min_m) * mesh.z_per_m
    across = np.minimum(np.maximum(across, 0.0), mesh.nx - EDGE)
    up = np.minimum(np.maximum(up, 0.0), nz - EDGE)
    i, k = np.intp(across), np.intp(up)
    a, b = across - i, up - k
    node = first + i * nz + k
    low_left, low_right = (1.0 - a) * (1.0 - b), a * (1.0 - b)
    up_left, up_right = (1.0 - a) * b, a * b
    u = (
        low_left * wind[node]
        + up_left * wind[node + 1]
        + low_right * wind[node + nz]
        + up_right * wind[node + nz + 1]
    )
    w = (
        low_left * updraft[node]
        + up_left * updraft[node + 1]
        + low_right * updraft[node + nz]
        + up_right * updraft[node + nz + 1]
    )
    return u, w


def clearance_at(floor: Floor, x_m: Numbers, z_m: Numbers) -> Numbers:
    """Distance to the ground [m], by its slope below: that of `envelope.clearance`.

    The stretch itself is looked up, and no nodes of a grid: a crest between two of them would be
    cut off, and it is where an aircraft comes nearest.
    """
    i = np.searchsorted(floor.corner_x_m, x_m)
    return (z_m - floor.height_m[i] - floor.slope[i] * x_m) * floor.steepness[i]


def line_speed(
    within: Within, slide: LineWay, x_m: Numbers, z_m: Numbers, speed_mps: Numbers, dt_s: float
) -> Numbers:
    """The line's speed across itself, as `target_line.line_step` moves it."""
    to_go = slide.sine * (x_m - slide.x_m) - slide.cosine * (z_m - slide.z_m)  # positive: upstream
    away = np.abs(to_go)
    most = np.minimum(within.slide_mps, np.sqrt(2.0 * within.acceleration_mps2 * away))
    wanted = np.copysign(np.minimum(most, away / dt_s), to_go)
    change = within.acceleration_mps2 * dt_s
    return speed_mps + np.minimum(np.maximum(wanted - speed_mps, -change), change)


def ahead_step(
    mesh: Mesh,
    wind: Floats,
    updraft: Floats,
    first: Numbers,
    polar: GlidePolar,
    scale: Numbers,
    within: Within,
    slide: LineWay,
    now: Ahead,
    change: Numbers,
    dt_s: float,
) -> Ahead:
    """Go on by dt_s; scale: of the polar's sink; wind, updraft, first: as `air_at` has them, times
    change by now."""
    sine, cosine = slide.sine_now, slide.cosine_now
    x, z, climb = now.x_m, now.z_m, now.climb_mps
    speed = line_speed(within, slide, x, z, now.speed_mps, dt_s)
    u, w = air_at(mesh, wind, updraft, first, x, z)
    u, w = change * u, change * w
    vx = (climb * cosine - speed) / sine
    airspeed = np.maximum(u - vx, SLOWEST_MPS)
    lag = np.maximum(airspeed * (-cosine / sine / GRAVITY_MPS2), LAG_LEAST_S)
    pull = airspeed * (speed - now.speed_mps) / (sine * (GRAVITY_MPS2 * dt_s))
    goal = w - scale * sink_at(polar, airspeed) - pull
    gain = dt_s / lag
    climb = (climb + gain * goal) / (1.0 + gain)
    x = x + dt_s * (climb * cosine - speed) / sine
    z = z + dt_s * climb
    clear = clearance_at(mesh.floor, x, z) - within.clearance_m
    inside = np.minimum(
        np.minimum(x - within.x_min_m, within.x_max_m - x),
        np.minimum(z - within.z_min_m, within.z_max_m - z),
    )
    aside = np.minimum(airspeed - within.speed_min_mps, within.speed_max_mps - airspeed)
    return Ahead(
        x_m=x,
        z_m=z,
        climb_mps=climb,
        speed_mps=speed,
        margin_m=np.minimum(clear, inside),
        aside_mps=aside,
    )
