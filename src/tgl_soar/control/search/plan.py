"""Which line is best: every candidate flown ahead in every field that may be.

Fields: the map's mean, draws from its posterior (SPREAD wider than it claims), and the mean in a
wind that becomes 0.9 and 1.1 of it; in each the wind becomes what its trend will have made it.
Candidates: stay on the line's target, stop where the line is, and lines at distances from the
aircraft to both sides, at the line's lean and at others.

The worth of a rollout

    soars, climbing more than CLIMB_LEAST at the end     1 + 0.3 tanh(margin / 0.1 H)
                                                           + 0.2 tanh(airspeed's margin / 1 m/s)
        slower than it can be held                       up to 0.5 less
    still flies, and sinks                               0 … 0.5, by the time that is left
    leaves a guard                                       −1 … −0.5, by when

No candidates are leans that the parameters do not allow, and for a while what was refused: at the
line's own lean that place, at another one that lean, which the loop's margin refuses everywhere.

Guards are the fence, the polar's ends, and the ground: not its clearance alone but the height over
it at which the search gives up.  The best mean worth wins, less a small price on moving, where the
present line is not good enough (`Keep`).  A place whose well would let gusts carry the aircraft out
within HOLDS_S is worth less by up to 1.

Rollouts fly through air that is a little slower than the polar's slow end, but no aircraft is held
there: below it sink grows as it slows, and a lull of a second, in which an aircraft at V loses what
it has to lose (V/g), takes it from there to the stall.

Nor do rollouts know the gusts to come, which carry an aircraft up and down about its rollout by
V sigma / g.  One that comes within that of a guard leaves it as likely as the normal distribution
says, and is worth so much less.
"""

from __future__ import annotations

from math import cos, inf, pi, radians, sin
from typing import Final, NamedTuple

import numpy as np

from tgl_soar.control.search.rollout import (
    Fields,
    Grid,
    Guards,
    Lines,
    Moving,
    RollOut,
    Rollouts,
    roll_out,
    wells,
)
from tgl_soar.control.target_line import TargetLine
from tgl_soar.estimation.lift_map.basis import Floats
from tgl_soar.types import GlidePolar

DRAWS: Final = 8
SPREAD: Final = 1.3  # of the posterior: the far field is overconfident
FACTORS: Final = (1.0, 0.9, 1.1)  # of the wind in the mean field
WEAKER: Final = 1  # of these fields, the one in the weaker wind
FORESEEN: Final = (0.8, 1.2)  # the most that a wind is foreseen to change
STEPS: Final = 64  # of a rollout
HORIZON_S: Final = 8.0
SLIDE_MPS: Final = 1.33  # and so long as the box is high at a glide's sink
CLIMB_LEAST_MPS: Final = -0.04  # at the end: slower than this is settling
DISTANCES: Final = (0.03, 0.06, 0.10, 0.16, 0.24, 0.35, 0.50, 0.70)  # of H, to both sides
LEAN_DISTANCES: Final = (0.06, 0.16, 0.35)  # the same with another lean, and none
LEANS_RAD: Final = (radians(10.0), radians(15.0), radians(25.0))
LEAN_APART_RAD: Final = radians(3.0)  # a lean this near the line's is the line's
REFUSED_NEAR: Final = 0.03  # of H: a line this near one that was refused is the same
MOVE_PRICE: Final = 0.05
FAR_PRICE: Final = 0.2  # for each H that the line is moved: what is far is known least
LEAN_PRICE: Final = 0.03  # the gains are for the lean that is set
MARGIN_FRACTION: Final = 0.10  # of H
HOLDS_S: Final = 300.0
FLOWN_THROUGH_MPS: Final = 0.3  # under the polar's slowest
LULL_S: Final = 1.0
LOGISTIC: Final = 1.702  # a logistic of so many standard deviations is the normal distribution's
LEFT_WORTH: Final = -0.5  # of one that leaves a guard at its end
UNHELD: Final = 0.5  # so much less worth is who would settle that much too slow
SURVIVES: Final = 0.5  # the most that a line that does not soar is worth


class LinePlan(NamedTuple):
    """What came of it."""

    target: TargetLine  # the best line
    stays: bool  # it is the one that the line goes to already
    worth: float
    chance: float  # share of the fields in which the best line soars
    stay_chance: float  # that the present one soars, and a lull does not stall it
    stay_weaker: bool  # it does so in the mean in a wind of 0.9
    most_chance: float  # of any candidate
    lasts_s: float  # mean time until the best leaves a guard; the horizon where it does not
    place_x_m: float  # where the best ends in the mean field
    place_z_m: float
    margin_m: float  # least there to ground, ceiling and fence beyond the guards
    holds_s: float  # how long gusts leave the aircraft there


def horizon_of(height_m: float) -> float:
    """How far ahead rollouts look [s] in a box of this height [m]."""
    return HORIZON_S + height_m / SLIDE_MPS


def candidates(now: Moving, target: TargetLine, height_m: float, deceleration_mps2: float) -> Lines:
    """The lines to choose from; the first is the present target, the second stops here."""
    at = now.line
    braking = at.speed_mps * abs(at.speed_mps) / (2.0 * deceleration_mps2)
    beside = [side * distance for distance in DISTANCES for side in (-1.0, 1.0)]
    rows = [
        (target.x_m, target.z_m, target.eta_rad),
        (now.x_m - braking * np.sin(at.eta_rad), now.z_m, at.eta_rad),
        *((now.x_m + aside * height_m, now.z_m, at.eta_rad) for aside in beside),
    ]
    nearer = [0.0, *(side * d for d in LEAN_DISTANCES for side in (-1.0, 1.0))]
    etas = [lean + 0.5 * np.pi for lean in LEANS_RAD]
    rows += [
        (now.x_m + aside * height_m, now.z_m, eta)
        for eta in etas
        if abs(eta - at.eta_rad) >= LEAN_APART_RAD
        for aside in nearer
    ]
    columns = np.array(rows, dtype=np.float64)
    return Lines(columns[:, 0], columns[:, 1], columns[:, 2])


class Leeway(NamedTuple):
    """Which lines are candidates."""

    eta_min_rad: float = 0.0
    eta_max_rad: float = pi
    refused: tuple[TargetLine, ...] = ()  # these are none


ANY_LINE: Final = Leeway()


class Keep(NamedTuple):
    """When the present line is kept, whatever others are worth."""

    worth: float  # from which on
    weaker: bool  # only where it holds the aircraft in a wind of 0.9 as well


NEVER: Final = Keep(worth=inf, weaker=False)


def allowed(lines: Lines, now: Moving, height_m: float, leeway: Leeway) -> Lines:
    """The candidates that may be chosen; the first, the present target, always may."""
    etas = lines.eta_rad
    kept = (etas >= leeway.eta_min_rad - 1e-6) & (etas <= leeway.eta_max_rad + 1e-6)
    for line in leeway.refused:
        same = np.abs(etas - line.eta_rad) < LEAN_APART_RAD
        if abs(line.eta_rad - now.line.eta_rad) < LEAN_APART_RAD:
            c, s = cos(line.eta_rad), sin(line.eta_rad)
            across_m = c * (lines.z_m - line.z_m) - s * (lines.x_m - line.x_m)
            same &= np.abs(across_m) < REFUSED_NEAR * height_m
        kept &= ~same
    kept[0] = True
    return lines if kept.all() else Lines(*(column[kept] for column in lines))


def likely_fields(
    grid: Grid, mean: Floats, draws: Floats, ahead: float = 1.0, draws_ahead: Floats | None = None
) -> Fields:
    """The mean field as it is and in other winds, and the draws (m, n): the mean is first.

    ahead, draws_ahead (m,): the wind that is foreseen at a rollout's end, as a multiple of the
    present one.
    """
    weights = np.vstack([*([mean] * len(FACTORS)), draws])
    drawn = np.ones(len(draws)) if draws_ahead is None else draws_ahead
    # What is foreseen is bounded, not by how much it may be wrong: else a wind that falls as far as
    # that would have no weaker one beside it.
    foreseen = np.clip(np.concatenate([np.full(len(FACTORS), ahead), drawn]), *FORESEEN)
    foreseen[: len(FACTORS)] *= FACTORS
    return grid.fields(weights, foreseen)


def worths(
    out: Rollouts, horizon_s: float, height_m: float, landing_m: float, lull_mps: float
) -> Floats:
    """The worth of each rollout (m, n); landing_m: the height at which a sinking one is over, at
    the latest: the fence's floor; lull_mps: standard deviation of the wind's means over LULL_S."""
    margin = np.tanh(np.maximum(out.margin_m, 0.0) / (MARGIN_FRACTION * height_m))
    aside = np.tanh(np.maximum(out.speed_margin_mps, 0.0))
    slow = (FLOWN_THROUGH_MPS + lull_mps - out.speed_margin_mps) / FLOWN_THROUGH_MPS
    soaring = 1.0 + 0.3 * margin + 0.2 * aside - UNHELD * np.clip(slow, 0.0, 1.0)
    left_s = np.maximum(out.z_m - landing_m, 0.0) / np.maximum(-out.climb_mps, 0.01)
    sinking = SURVIVES * left_s / (left_s + horizon_s)
    # V/g is LULL_S, near enough.
    beyond = np.exp(np.minimum(-LOGISTIC * out.margin_m / max(lull_mps * LULL_S, 1e-6), 50.0))
    leaves = beyond / (1.0 + beyond)
    early = -1.0 + 0.5 * np.minimum(out.failed_s, horizon_s) / horizon_s
    result: Floats = np.where(
        np.isfinite(out.failed_s),
        early,
        (1.0 - leaves) * np.where(out.climb_mps > CLIMB_LEAST_MPS, soaring, sinking)
        + leaves * LEFT_WORTH,
    )
    return result


def plan_in(
    grid: Grid,
    fields: Fields,
    polar: GlidePolar,
    guards: Guards,
    now: Moving,
    target: TargetLine,
    diffusion_m2ps: float,
    keep: Keep = NEVER,
    roll: RollOut = roll_out,
    leeway: Leeway = ANY_LINE,
) -> LinePlan:
    """The best line in fields of which the first is the mean.

    keep: when no other line than the present one is looked for.  roll: `roll_out`, or the same
    compiled.  leeway: which lines are candidates.
    """
    height = guards.box.height_m
    horizon = horizon_of(height)
    lines = candidates(now, target, height, guards.line.acceleration_mps2)
    lines = allowed(lines, now, height, leeway)
    raised = grid.above(guards)
    out = roll(raised, fields, polar, guards, now, lines, horizon, STEPS)
    soars = ~np.isfinite(out.failed_s) & (out.climb_mps > CLIMB_LEAST_MPS)
    well = wells(raised, fields, polar, guards, lines, out.x_m[0], out.z_m[0], diffusion_m2ps)
    shallow = np.where(soars[0], 1.0 - np.minimum(well.holds_s / HOLDS_S, 1.0), 0.0)
    lull = float(np.sqrt(2.0 * diffusion_m2ps / LULL_S))
    held = soars[:, 0] & (out.speed_margin_mps[:, 0] >= FLOWN_THROUGH_MPS + lull)
    worth = worths(out, horizon, height, guards.box.z_min_m, lull).mean(axis=0) - shallow
    price = np.full(len(worth), MOVE_PRICE)
    price += FAR_PRICE * np.abs(lines.x_m - now.x_m) / height
    price[0] = 0.0
    price += np.where(np.abs(lines.eta_rad - target.eta_rad) > 1e-6, LEAN_PRICE, 0.0)
    chances = soars.mean(axis=0)
    kept = worth[0] >= keep.worth and (bool(held[WEAKER]) or not keep.weaker)
    best = 0 if kept else int(np.argmax(worth - price))
    return LinePlan(
        target=TargetLine(
            float(lines.x_m[best]), float(lines.z_m[best]), float(lines.eta_rad[best])
        ),
        stays=best == 0,
        worth=float(worth[best]),
        chance=float(chances[best]),
        stay_chance=float(held.mean()),
        stay_weaker=bool(held[WEAKER]),
        most_chance=float(chances.max()),
        lasts_s=float(np.minimum(out.failed_s[:, best], horizon).mean()),
        place_x_m=float(out.x_m[0, best]),
        place_z_m=float(out.z_m[0, best]),
        margin_m=float(out.margin_m[0, best]),
        holds_s=float(well.holds_s[best]),
    )
