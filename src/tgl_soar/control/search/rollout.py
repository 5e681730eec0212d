"""Lines flown ahead, many at once, in fields on a grid.

The aircraft is held to its line, which slides across itself at v (positive upstream) and turns.
With t = (cos η, sin η) along the line and n = (−sin η, cos η) across it

    n · (ẋ, ż) = v                              →   ẋ = (ż cos η − v) / sin η
    ż = w − (1 + p) S(V) + (V/g) ẍ,   V = u − ẋ     the energy: speed is height

and with ẍ = (z̈ cos η − v̇) / sin η the climb follows with the lag T = −(V/g) cot η,

    T z̈ = w − (1 + p) S(V) − (V/g) v̇ / sin η − ż

0.2 s at a lean of 15°.  The step is implicit in ż, so that a short lag needs no short step.  A
line that moves downstream and stops costs V v / g: that is the term in v̇.

The wind of a field changes on the way, as a trend of it dies away (`lift_map.lasting_s`): from the
present one to a multiple of it at the end.  What a wind a tenth weaker does is so what it does when
it has become weaker, and not what a step of the wind does now.

A rollout ends early where it leaves the guards: too near the ground, beyond the fence, too slow or
too fast for the polar.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from math import pi
from typing import Final, NamedTuple

import numpy as np

from tgl_soar.control.search.ahead import (
    Ahead,
    Floor,
    LineWay,
    Mesh,
    Within,
    ahead_step,
    air_at,
    clearance_at,
)
from tgl_soar.control.target_line import LineLimits, LineState
from tgl_soar.estimation.lift_map.basis import Box, Floats, FlowBasis
from tgl_soar.estimation.lift_map.extended_polar import sink, sink_slope
from tgl_soar.estimation.lift_map.lift_map import lasting_s
from tgl_soar.types import GlidePolar, Ground

NODES_ALONG_H: Final = 24  # of the grid: half a pole's depth apart
NODES_MAX: Final = 60  # along x


class Guards(NamedTuple):
    """What the aircraft keeps within, and how it may be moved."""

    box: Box  # the fence
    ground: Ground
    clearance_m: float  # to the ground
    landing_m: float  # height over the ground that giving up needs
    speed_min_mps: float  # horizontal airspeed: the stall, with its margin
    speed_max_mps: float
    line: LineLimits


class Moving(NamedTuple):
    """The aircraft and its line now."""

    x_m: float
    z_m: float
    climb_mps: float
    line: LineState


class Lines(NamedTuple):
    """Target lines, arrays (n,)."""

    x_m: Floats
    z_m: Floats
    eta_rad: Floats


class Fields(NamedTuple):
    """Wind fields on the nodes of one grid: (m, nx · nz) each, and the sink's scale in each."""

    wind_mps: Floats
    updraft_mps: Floats
    sink_scale: Floats  # (m,) 1 + p
    ends: Floats  # (m,) the wind at the end of a rollout, as a multiple of this


class Rollouts(NamedTuple):
    """How each line ends in each field: arrays (m, n)."""

    failed_s: Floats  # when a guard was left; inf: never
    climb_mps: Floats  # at the end
    x_m: Floats
    z_m: Floats
    margin_m: Floats  # least distance to ground, ceiling and fence, beyond the guards
    speed_margin_mps: Floats  # to the nearer end of the airspeeds, at the end


class Grid:
    """The nodes of a map, and the ground's height above them."""

    def __init__(self, basis: FlowBasis, ground: Ground) -> None:
        box = basis.box
        step = box.height_m / NODES_ALONG_H
        count = min(NODES_MAX, round((box.x_max_m - box.x_min_m) / step) + 1)
        self.x_m = np.linspace(box.x_min_m, box.x_max_m, max(2, count))
        self.z_m = np.linspace(box.z_min_m, box.z_max_m, NODES_ALONG_H + 1)
        self.basis = basis
        x, z = np.meshgrid(self.x_m, self.z_m, indexing="ij")
        self.u, self.w = (part.T.copy() for part in basis.features(x.ravel(), z.ravel()))
        nx, nz = self.x_m.size, self.z_m.size
        self.mesh = Mesh(
            x_min_m=float(self.x_m[0]),
            z_min_m=float(self.z_m[0]),
            x_per_m=float((nx - 1) / (self.x_m[-1] - self.x_m[0])),
            z_per_m=float((nz - 1) / (self.z_m[-1] - self.z_m[0])),
            nx=nx,
            nz=nz,
            floor=floor_of(ground, box.z_min_m),
        )

    def fields(self, weights: Floats, ends: Floats) -> Fields:
        """The fields of m rows of weights, (m, n), each with its wind at the end (m,)."""
        return Fields(
            wind_mps=weights @ self.u,
            updraft_mps=weights @ self.w,
            sink_scale=1.0 + weights[:, self.basis.sink_scale],
            ends=ends,
        )

    def above(self, guards: Guards) -> Grid:
        """The same over ground that is raised: who keeps the clearance to it keeps the height over
        the true one that landing needs, too."""
        floor = self.mesh.floor
        more = np.maximum(guards.landing_m - guards.clearance_m / floor.steepness, 0.0)
        raised = copy(self)
        raised.mesh = self.mesh._replace(floor=floor._replace(height_m=floor.height_m + more))
        return raised

    def at(self, fields: Fields, x_m: Floats, z_m: Floats) -> tuple[Floats, Floats]:
        """u and w [m/s] of field i at places (m, n), bilinear; beyond the grid its edge's."""
        first = np.arange(len(x_m))[:, None] * (self.mesh.nx * self.mesh.nz)
        wind, updraft = fields.wind_mps.ravel(), fields.updraft_mps.ravel()
        u, w = air_at(self.mesh, wind, updraft, first, x_m, z_m)
        return u, w

    def clearance(self, x_m: Floats, z_m: Floats) -> Floats:
        """Distance to the ground [m], by its slope below."""
        result: Floats = clearance_at(self.mesh.floor, x_m, z_m)
        return result


def floor_at(ground: Ground, x_m: Floats | float, unknown_m: float) -> Floats:
    """Height of the ground [m], level beyond its ends; unknown_m where it is not known."""
    n = ground.points
    if n == 0:
        return np.full(np.shape(x_m), unknown_m)
    return np.asarray(np.interp(x_m, ground.x_m[:n], ground.z_m[:n]))


def floor_of(ground: Ground, unknown_m: float) -> Floor:
    """The same in stretches."""
    n = ground.points
    if n == 0:
        level = np.zeros(1)
        return Floor(np.zeros(0), level + unknown_m, level, level + 1.0)
    x, z = np.array(ground.x_m[:n]), np.array(ground.z_m[:n])
    slope = np.concatenate(([0.0], np.diff(z) / np.diff(x), [0.0]))
    begins = np.concatenate(([0], np.arange(n)))  # a corner that each stretch has
    return Floor(
        corner_x_m=x,
        height_m=z[begins] - slope * x[begins],
        slope=slope,
        steepness=1.0 / np.hypot(1.0, slope),
    )


def within_of(guards: Guards) -> Within:
    """The guards as a step needs them."""
    box, line = guards.box, guards.line
    return Within(
        x_min_m=box.x_min_m,
        x_max_m=box.x_max_m,
        z_min_m=box.z_min_m,
        z_max_m=box.z_max_m,
        clearance_m=guards.clearance_m,
        speed_min_mps=guards.speed_min_mps,
        speed_max_mps=guards.speed_max_mps,
        slide_mps=line.speed_mps,
        acceleration_mps2=line.acceleration_mps2,
    )


def turning(now: Moving, lines: Lines, turn_rad: float, steps: int) -> tuple[Floats, Floats]:
    """Sine and cosine of each line's inclination in each step, (steps, n); turn_rad: the most in
    a step."""
    eta = np.full(lines.x_m.shape, now.line.eta_rad)
    turned = np.empty((steps, eta.size))
    for n in range(steps):
        eta = eta + np.minimum(np.maximum(lines.eta_rad - eta, -turn_rad), turn_rad)
        turned[n] = eta
    return np.sin(turned), np.cos(turned)


def grown(horizon_s: float, steps: int) -> Floats:
    """How much of a change of the wind there is in each step, (steps,); 1 in the last."""
    whole = lasting_s(horizon_s)
    return np.array([lasting_s((n + 1) * horizon_s / steps) / whole for n in range(steps)])


# (grid, fields, polar, guards, now, lines, horizon_s, steps): `roll_out`, or the same compiled.
RollOut = Callable[[Grid, Fields, GlidePolar, Guards, Moving, Lines, float, int], Rollouts]


def roll_out(
    grid: Grid,
    fields: Fields,
    polar: GlidePolar,
    guards: Guards,
    now: Moving,
    lines: Lines,
    horizon_s: float,
    steps: int,
) -> Rollouts:
    """Fly every line in every field for a time, in so many steps."""
    shape = (len(fields.sink_scale), len(lines.x_m))
    dt = horizon_s / steps
    mesh, within = grid.mesh, within_of(guards)
    wind, updraft = fields.wind_mps.ravel(), fields.updraft_mps.ravel()
    first = np.arange(shape[0])[:, None] * (mesh.nx * mesh.nz)
    scale, change = fields.sink_scale[:, None], fields.ends[:, None] - 1.0
    there = grown(horizon_s, steps)
    sines, cosines = turning(now, lines, guards.line.turn_rate_radps * dt, steps)
    sine, cosine = np.sin(lines.eta_rad), np.cos(lines.eta_rad)
    at = Ahead(
        x_m=np.full(shape, now.x_m),
        z_m=np.full(shape, now.z_m),
        climb_mps=np.full(shape, now.climb_mps),
        speed_mps=np.full(shape, now.line.speed_mps),
        margin_m=np.full(shape, np.inf),
        aside_mps=np.full(shape, np.inf),
    )
    failed = np.full(shape, np.inf)
    flies = np.ones(shape, dtype=bool)
    for n in range(steps):
        slide = LineWay(
            x_m=lines.x_m,
            z_m=lines.z_m,
            sine=sine,
            cosine=cosine,
            sine_now=sines[n],
            cosine_now=cosines[n],
        )
        new = ahead_step(
            mesh,
            wind,
            updraft,
            first,
            polar=polar,
            scale=scale,
            within=within,
            slide=slide,
            now=at,
            change=1.0 + change * there[n],
            dt_s=dt,
        )
        lost = flies & ((new.margin_m < 0.0) | (new.aside_mps < 0.0))
        at = Ahead(
            x_m=np.where(flies, new.x_m, at.x_m),
            z_m=np.where(flies, new.z_m, at.z_m),
            climb_mps=np.where(flies, new.climb_mps, at.climb_mps),
            speed_mps=new.speed_mps,
            margin_m=np.where(flies, np.minimum(new.margin_m, at.margin_m), at.margin_m),
            aside_mps=np.where(flies, new.aside_mps, at.aside_mps),
        )
        failed[lost] = (n + 1) * dt
        flies &= ~lost
        if not flies.any():
            break
    return Rollouts(
        failed_s=failed,
        climb_mps=at.climb_mps,
        x_m=at.x_m,
        z_m=at.z_m,
        margin_m=at.margin_m,
        speed_margin_mps=at.aside_mps,
    )


class Well(NamedTuple):
    """How firmly a place on a line holds the aircraft in gusts; arrays (n,)."""

    rate_per_s: Floats  # λ, of the way back; negative: it is driven away
    depth_m2ps: Floats  # ΔV, the lower of the two rims
    holds_s: Floats  # mean time until gusts carry it over the rim


def wells(
    grid: Grid,
    fields: Fields,
    polar: GlidePolar,
    guards: Guards,
    lines: Lines,
    x_m: Floats,
    z_m: Floats,
    diffusion_m2ps: float,
) -> Well:
    """The wells of places (n,) on lines in the first of the fields, in its wind at the end.

    Along the line ṡ = E / c, c = sin η − S′ cos η; V(s) = −∫ E / c ds, and white gusts of
    diffusion D = ½ σ_w² τ / c² carry the aircraft over a rim ΔV high in (2π/λ) e^(ΔV/D) (Kramers);
    where that is hardly a rim, in the time L²/2D that gusts alone take for the way L to it.
    A guard is a rim as well: what lies beyond it is lost.  So is the height at which the search
    gives up, with `Grid.above`.
    """
    reach, count = 0.5 * guards.box.height_m, 48
    path = np.linspace(-reach, reach, 2 * count + 1)
    sine, cosine = np.sin(lines.eta_rad), np.cos(lines.eta_rad)
    x = x_m[:, None] + path * cosine[:, None]
    z = z_m[:, None] + path * sine[:, None]
    first = Fields(*(part[:1] for part in fields))
    air = grid.at(first, x.reshape(1, -1), z.reshape(1, -1))
    u, w = (first.ends[0] * part.reshape(x.shape) for part in air)
    scale = first.sink_scale[0]
    leverage = np.maximum(sine[:, None] - scale * sink_slope(polar, u) * cosine[:, None], 0.2)
    drift = (w - scale * sink(polar, u)) / leverage
    box = guards.box
    allowed = (
        (grid.clearance(x, z) > guards.clearance_m)
        & (x > box.x_min_m) & (x < box.x_max_m) & (z > box.z_min_m) & (z < box.z_max_m)
        & (u > guards.speed_min_mps) & (u < guards.speed_max_mps)
    )  # fmt: skip
    step = path[1] - path[0]
    rate = -(drift[:, count + 1] - drift[:, count - 1]) / (2.0 * step)
    rims, ways = [], []
    for side in (1, -1):
        # Going away from the place, the work against the drift, until a guard.
        out = slice(count, None) if side > 0 else slice(count, None, -1)
        work = np.cumsum(-side * drift[:, out] * step, axis=1)
        open_ = np.logical_and.accumulate(allowed[:, out], axis=1)
        heights = np.where(open_, work, -np.inf)
        rims.append(heights.max(axis=1))
        ways.append(heights.argmax(axis=1) * step)
    depth = np.maximum(np.minimum(*rims), 0.0)
    diffusion = diffusion_m2ps / leverage[:, count] ** 2
    with np.errstate(over="ignore", divide="ignore"):
        spread_s = np.minimum(*ways) ** 2 / (2.0 * diffusion)
        there_s = np.minimum(2.0 * pi / np.maximum(rate, 1e-3), spread_s)
        holds = there_s * np.exp(np.minimum(depth / diffusion, 50.0))
    return Well(rate_per_s=rate, depth_m2ps=depth, holds_s=np.where(rate > 0.0, holds, 0.0))
