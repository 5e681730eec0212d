"""The zero excess updraft contour (ZEUC) of a wind field and a glide polar.

    E(x, z) = w(x, z) − sink(U(x, z)),        U = √(u² + v²)

u, w  m/s  wind along x (a head wind on the aircraft) and up;  v  along y, of an oblique wind
U     m/s  horizontal wind; zero or less where u is: nobody hovers in a wind from behind
sink  m/s  of the glide polar at the horizontal airspeed U, positive down; undefined (NaN)
           outside the polar's range, and so is E

An aircraft hovers where airspeed equals wind and sink equals updraft: on the contour E = 0.
On a target gradient line (TGL) through (x0, z0), inclined at η = 90° + lean from the
downstream axis, with t = (cos η, sin η) along it and n = (−sin η, cos η) upstream of it, the
aircraft is held to the line and slides along it.  Speed along the line ṡ obeys, with airspeed
u − ẋ = u − ṡ cos η and S′ = d sink / d u,

    ṡ sin η = w − sink(u − ṡ cos η)     →     ṡ (sin η − S′ cos η) = E

so the place is stable where E falls going up the line and sin η > S′ cos η.  In an oblique wind
S′ u / U stands in the place of S′.

When the wind grows by a factor 1 + ε everywhere, at a place of the contour
    dE/dε = w − u S′ = u (sink/u − S′)
and the equilibrium moves along the line by −(dE/dε) / (∇E · t): up where sink/u > S′ (slower
than best glide), not at all at best glide, down beyond.
"""

from __future__ import annotations

from collections.abc import Callable
from math import atan, atan2, copysign, cos, degrees, hypot, isfinite, nan, pi, sin
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from tgl_soar.air.field import FloatArray, WindField, broadcast
from tgl_soar.types import GlidePolar, polar_sink, polar_slope

Bounds = tuple[float, float, float, float]  # x from, x to, z from, z to [m]

GRADIENT_STEP_M = 0.02  # half the span of the central differences of E
PLACE_TOLERANCE_M = 1e-6
REACH_M = 4.0  # to either side of a line's point a crossing is looked for


class ZeucError(ValueError):
    """There is no such contour or crossing; the message says what would make one."""


_Key = tuple[int, int, int]  # of an edge of the cells: its node, and the axis along which it goes


class Crossing(NamedTuple):
    """Where a line meets the contour."""

    x_m: float
    z_m: float
    wind_mps: float  # horizontal
    updraft_mps: float  # w there
    excess_slope_per_s: float  # dE/ds going up the line [m/s per m]
    stable: bool


class Core(NamedTuple):
    """The place of greatest excess updraft."""

    x_m: float
    z_m: float
    wind_mps: float  # horizontal
    updraft_mps: float
    excess_mps: float


class WindSensitivity(NamedTuple):
    """What a stronger wind, everywhere alike, does to an equilibrium."""

    answer: Literal["rise", "stay", "fall"]
    margin: float  # sink/u − d sink/du [-]: positive on the slow side of best glide
    along_m_per_mps: float  # shift up the line per m/s of the field's reference wind


def excess_updraft(
    field: WindField,
    polar: GlidePolar,
    x_m: ArrayLike,
    z_m: ArrayLike,
    y_m: float = 0.0,
    time_s: float = 0.0,
) -> FloatArray:
    """E [m/s] at many places; NaN outside the polar's range and outside the field."""
    x, y, z = broadcast(x_m, y_m, z_m)
    u, v, w = field.wind(x, y, z, time_s)
    speed = _head_wind(u, v)
    sink = polar.c0 + speed * (polar.c1 + speed * (polar.c2 + speed * polar.c3))
    defined = (speed >= polar.speed_min_mps) & (speed <= polar.speed_max_mps)
    places = zip(x.ravel().tolist(), y.ravel().tolist(), z.ravel().tolist(), strict=True)
    air = np.array([field.inside(*place) for place in places], dtype=bool).reshape(x.shape)
    return np.where(defined & air, w - sink, np.nan)


def excess_at(
    field: WindField,
    polar: GlidePolar,
    x_m: float,
    z_m: float,
    y_m: float = 0.0,
    time_s: float = 0.0,
) -> float:
    """E [m/s] at one place; NaN outside the polar's range and outside the field."""
    if not field.inside(x_m, y_m, z_m):
        return float("nan")
    u, v, w = field.wind_at(x_m, y_m, z_m, time_s)
    return w - polar_sink(polar, copysign(hypot(u, v), u))


def _head_wind(u_mps: FloatArray, v_mps: FloatArray) -> FloatArray:
    """U [m/s], negative where the wind comes from behind; `excess_at` has it for one place."""
    speed: FloatArray = np.copysign(np.hypot(u_mps, v_mps), u_mps)
    return speed


def slope_along(polar: GlidePolar, u_mps: float, v_mps: float) -> float:
    """d sink(U) / d u = S′ u / U [-]; NaN outside the polar's range, and in a wind from behind."""
    speed = hypot(u_mps, v_mps)
    return polar_slope(polar, speed) * (u_mps / speed) if u_mps > 0.0 else nan


def excess_gradient(
    field: WindField,
    polar: GlidePolar,
    x_m: float,
    z_m: float,
    y_m: float = 0.0,
    time_s: float = 0.0,
) -> tuple[float, float]:
    """(dE/dx, dE/dz) [1/s] by central differences; NaN where a neighbour is undefined."""
    h = GRADIENT_STEP_M

    def at(x: float, z: float) -> float:
        return excess_at(field, polar, x, z, y_m, time_s)

    return (
        (at(x_m + h, z_m) - at(x_m - h, z_m)) / (2.0 * h),
        (at(x_m, z_m + h) - at(x_m, z_m - h)) / (2.0 * h),
    )


def crossings(
    field: WindField,
    polar: GlidePolar,
    x0_m: float,
    z0_m: float,
    eta_rad: float,
    reach_m: float,
    y_m: float = 0.0,
    time_s: float = 0.0,
) -> list[Crossing]:
    """Where the line meets the contour within reach of (x0, z0), from below to above.

    Empty where it does not.  Errors: ValueError for a line that is not a line upwards
    (0 < eta < pi) or a reach that is not positive.
    """
    if not 0.0 < eta_rad < pi:
        raise ValueError(
            f"eta {eta_rad} rad: must lie between 0 and pi; a horizontal line has no upper end"
        )
    if not (isfinite(reach_m) and reach_m > 0.0):
        raise ValueError(f"reach {reach_m} m: must be positive")
    tx, tz = cos(eta_rad), sin(eta_rad)
    count = max(3, int(2.0 * reach_m / 0.01) + 1)
    path = np.linspace(-reach_m, reach_m, count)
    values = excess_updraft(field, polar, x0_m + path * tx, z0_m + path * tz, y_m, time_s)

    def along(s: float) -> float:
        return excess_at(field, polar, x0_m + s * tx, z0_m + s * tz, y_m, time_s)

    found = []
    for k in range(count - 1):
        s = _zero(along, float(path[k]), float(path[k + 1]), float(values[k]), float(values[k + 1]))
        if s is None:
            continue
        x, z = x0_m + s * tx, z0_m + s * tz
        u, v, w = map(float, field.wind_at(x, y_m, z, time_s))
        gx, gz = excess_gradient(field, polar, x, z, y_m, time_s)
        slope = float(gx * tx + gz * tz)
        slides = tz > slope_along(polar, u, v) * tx
        found.append(
            Crossing(
                x_m=x,
                z_m=z,
                wind_mps=hypot(u, v),
                updraft_mps=w,
                excess_slope_per_s=slope,
                stable=slope < 0.0 and slides,
            )
        )
    return found


def stable_crossing(
    field: WindField,
    polar: GlidePolar,
    line: tuple[float, float, float],
    time_s: float = 0.0,
    reach_m: float = REACH_M,
) -> Crossing | None:
    """Where an aircraft that is held to a line should hover: its stable crossing.

    line: x0 [m], z0 [m], eta [rad].  Of several stable places the one nearest to the line's
    point; None: there is none within reach.
    """
    found = [c for c in crossings(field, polar, *line, reach_m, time_s=time_s) if c.stable]
    return min(found, key=lambda c: hypot(c.x_m - line[0], c.z_m - line[1]), default=None)


def _zero(
    function: Callable[[float], float], low: float, high: float, f_low: float, f_high: float
) -> float | None:
    """Zero of a continuous function between two places; None without one, or at a jump.

    An exact zero at `high` belongs to the next interval.
    """
    if f_low == 0.0:
        return low
    if not f_low * f_high < 0.0:  # also for NaN
        return None
    span = abs(f_low) + abs(f_high)
    while high - low > PLACE_TOLERANCE_M:
        middle = 0.5 * (low + high)
        f_middle = function(middle)
        if f_middle != f_middle:
            return None
        if f_low * f_middle <= 0.0:
            high, f_high = middle, f_middle
        else:
            low, f_low = middle, f_middle
    # A jump of the field keeps its height however small the interval; a zero does not.
    return 0.5 * (low + high) if abs(f_high - f_low) < 0.1 * span else None


def contour(
    field: WindField,
    polar: GlidePolar,
    bounds: Bounds,
    step: float,
    y_m: float = 0.0,
    time_s: float = 0.0,
) -> list[FloatArray]:
    """The contour E = 0 within bounds (x from, x to, z from, z to) as polylines (n, 2) of x, z.

    Vertices lie on the true contour within a micrometre; `step` [m] is the width of the cells
    searched.  A part smaller than a cell is missed.  Longest first.  Errors: `ZeucError` where
    the field holds no contour, with the numbers that tell why.
    """
    x = _axis("x", bounds[0], bounds[1], step)
    z = _axis("z", bounds[2], bounds[3], step)
    xx, zz = np.meshgrid(x, z, indexing="ij")
    values = excess_updraft(field, polar, xx, zz, y_m, time_s)
    # An exact zero on a node would belong to four edges: count it as just above.
    values[values == 0.0] = 1e-300

    points: dict[_Key, tuple[float, float]] = {}

    def vertex(i: int, k: int, axis: int) -> bool:
        key = (i, k, axis)
        if key in points:
            return True
        x1, z1 = float(x[i]), float(z[k])
        e1 = float(values[i, k])
        if axis == 0:
            s = _zero(
                lambda p: excess_at(field, polar, p, z1, y_m, time_s),
                x1,
                float(x[i + 1]),
                e1,
                float(values[i + 1, k]),
            )
            if s is not None:
                points[key] = (s, z1)
        else:
            s = _zero(
                lambda p: excess_at(field, polar, x1, p, y_m, time_s),
                z1,
                float(z[k + 1]),
                e1,
                float(values[i, k + 1]),
            )
            if s is not None:
                points[key] = (x1, s)
        return key in points

    links: dict[_Key, list[_Key]] = {}
    for i, k in _mixed_cells(values):
        edges = [(i, k, 0), (i + 1, k, 1), (i, k + 1, 0), (i, k, 1)]  # below, right, above, left
        cut = [edge for edge in edges if vertex(*edge)]
        pairs = [(0, 1)] if len(cut) == 2 else []
        if len(cut) == 4:
            middle = excess_at(
                field, polar, float(x[i] + x[i + 1]) / 2, float(z[k] + z[k + 1]) / 2, y_m, time_s
            )
            # A saddle: the middle belongs to the corner (i, k) or parts it from its opposite.
            joined = (middle > 0.0) == bool(values[i, k] > 0.0)
            pairs = [(0, 1), (2, 3)] if joined else [(0, 3), (1, 2)]
        for one, other in pairs:
            links.setdefault(cut[one], []).append(cut[other])
            links.setdefault(cut[other], []).append(cut[one])
    if not links:
        raise ZeucError(_why_no_contour(field, polar, xx, zz, values, y_m, time_s))
    lines = [np.array([points[key] for key in chain]) for chain in _chains(links)]
    lines.sort(key=lambda line: -float(np.hypot(*np.diff(line, axis=0).T).sum()))
    return lines


def _mixed_cells(values: FloatArray) -> list[tuple[int, int]]:
    """The cells whose corners are all defined and not all on one side of zero."""
    above, known = values > 0.0, np.isfinite(values)
    corners = (slice(None, -1), slice(1, None))
    whole = known[corners[0], corners[0]].copy()
    mixed = np.zeros(whole.shape, dtype=int)
    for a in corners:
        for b in corners:
            whole &= known[a, b]
            mixed += above[a, b]
    return [(i, k) for i, k in np.argwhere(whole & (mixed > 0) & (mixed < 4)).tolist()]


def _axis(name: str, low: float, high: float, step: float) -> FloatArray:
    if not (isfinite(low) and isfinite(high) and low < high):
        raise ValueError(f"bounds in {name}: {low} … {high} m must increase")
    if not (isfinite(step) and 0.0 < step <= high - low):
        raise ValueError(f"step {step} m: must be positive and at most the span in {name}")
    return np.linspace(low, high, round((high - low) / step) + 1)


def _chains(links: dict[_Key, list[_Key]]) -> list[list[_Key]]:
    """Join links into lines, open ones first from their ends, then closed ones."""
    left = {key: list(ends) for key, ends in links.items()}
    chains = []
    starts = [key for key, ends in links.items() if len(ends) == 1] + list(links)
    for start in starts:
        if not left[start]:
            continue
        chain = [start]
        while left[chain[-1]]:
            here = chain[-1]
            there = left[here].pop()
            left[there].remove(here)
            chain.append(there)
        chains.append(chain)
    return chains


def _why_no_contour(
    field: WindField,
    polar: GlidePolar,
    x: FloatArray,
    z: FloatArray,
    values: FloatArray,
    y_m: float,
    time_s: float,
) -> str:
    u, v, w = field.wind(x, y_m, z, time_s)
    speed = _head_wind(u, v)
    where = f"x {x.min():.2f} … {x.max():.2f} m, z {z.min():.2f} … {z.max():.2f} m"
    speeds = f"{polar.speed_min_mps:.2f} … {polar.speed_max_mps:.2f} m/s"
    if not np.isfinite(values).any():
        return (
            f"no zero excess updraft contour in {where}: the wind ({np.nanmin(speed):.2f} …"
            f" {np.nanmax(speed):.2f} m/s) is nowhere within the glide polar's range ({speeds});"
            " choose a wind within it, other bounds, or a polar measured at these speeds"
        )
    knots = np.linspace(polar.speed_min_mps, polar.speed_max_mps, 400)
    sinks = polar.c0 + knots * (polar.c1 + knots * (polar.c2 + knots * polar.c3))
    known = np.isfinite(values)
    best = float(values[known].max())
    numbers = (
        f"least sink {sinks.min():.2f} m/s (at {knots[sinks.argmin()]:.2f} m/s), greatest updraft"
        f" {w[known].max():.2f} m/s where the wind is within the polar's range ({speeds}),"
        f" excess updraft {values[known].min():.2f} … {best:.2f} m/s"
    )
    if best < 0.0:
        help_ = "steepen the slope, raise the wind, or fly an airframe that sinks less"
    else:
        help_ = "updraft exceeds sink everywhere: widen the bounds, lower the wind or the slope"
    return f"no zero excess updraft contour in {where}: {numbers}; {help_}"


def feasible_leans(
    field: WindField,
    polar: GlidePolar,
    x_m: float,
    z_m: float,
    y_m: float = 0.0,
    time_s: float = 0.0,
) -> tuple[float, float]:
    """The open range of lean [rad] of lines that are stable at a place of the contour.

    Both conditions of stability, and 0 < eta < pi.  On the lower branch of a hill's contour only
    lines far from upright are left.  Flying qualities narrow the range further: a line that
    leans downwind is hard to fly.  Errors: `ZeucError` where no line is stable, or where
    the excess updraft or its gradient is undefined.
    """
    u, v, _ = field.wind_at(x_m, y_m, z_m, time_s)
    gx, gz = excess_gradient(field, polar, x_m, z_m, y_m, time_s)
    slope = slope_along(polar, u, v)
    where = f"at x {x_m:.3f} m, z {z_m:.3f} m (wind {hypot(u, v):.2f} m/s)"
    if not (isfinite(gx) and isfinite(gz) and isfinite(slope)):
        raise ZeucError(f"excess updraft is undefined {where}: choose a place of the contour")
    # E falls along t within 90° of the direction −∇E; sin η > S′ cos η from atan S′ on.
    down = atan2(-gz, -gx)
    if down < -0.5 * pi:
        down += 2.0 * pi
    low = max(down - 0.5 * pi, atan(slope), 0.0)
    high = min(down + 0.5 * pi, atan(slope) + pi, pi)
    if not low < high:
        raise ZeucError(
            f"no line is stable {where}: excess updraft grows upwards there"
            f" ({gz:+.3f} m/s per m); choose the upper branch of the contour"
        )
    return low - 0.5 * pi, high - 0.5 * pi


STAY_M_PER_MPS = 0.01  # a centimetre per m/s of wind: less than any tracker's noise on a line


def wind_sensitivity(
    field: WindField,
    polar: GlidePolar,
    crossing: Crossing,
    eta_rad: float,
    y_m: float = 0.0,
    time_s: float = 0.0,
) -> WindSensitivity:
    """How an equilibrium answers when wind and updraft grow alike, to first order."""
    u = crossing.wind_mps
    sink, slope = polar_sink(polar, u), polar_slope(polar, u)
    gx, gz = excess_gradient(field, polar, crossing.x_m, crossing.z_m, y_m, time_s)
    along_slope = gx * cos(eta_rad) + gz * sin(eta_rad)
    steepness = hypot(gx, gz)
    if not (isfinite(along_slope) and abs(along_slope) > 1e-9 * steepness and isfinite(slope)):
        raise ZeucError(
            f"excess updraft has no slope along the line ({degrees(eta_rad) - 90:.1f}° lean) at"
            f" x {crossing.x_m:.3f} m, z {crossing.z_m:.3f} m: the line runs along the contour"
        )
    margin = sink / u - slope
    growth = u * margin / field.reference_wind_mps  # dE per m/s of the reference wind
    shift = -growth / along_slope
    answer: Literal["rise", "stay", "fall"] = "stay"
    if abs(shift) > STAY_M_PER_MPS:
        answer = "rise" if shift > 0.0 else "fall"
    return WindSensitivity(answer, margin, shift)


def core(
    field: WindField,
    polar: GlidePolar,
    bounds: Bounds,
    step: float,
    y_m: float = 0.0,
    time_s: float = 0.0,
) -> Core:
    """The place of greatest excess updraft within bounds, refined to a millimetre.

    Errors: `ZeucError` where excess updraft is defined nowhere.
    """
    x = _axis("x", bounds[0], bounds[1], step)
    z = _axis("z", bounds[2], bounds[3], step)
    xx, zz = np.meshgrid(x, z, indexing="ij")
    values = excess_updraft(field, polar, xx, zz, y_m, time_s)
    if not np.isfinite(values).any():
        raise ZeucError(_why_no_contour(field, polar, xx, zz, values, y_m, time_s))
    i, k = np.unravel_index(int(np.nanargmax(values)), values.shape)
    best_x, best_z, best = float(x[i]), float(z[k]), float(values[i, k])
    span = step
    while span > 1e-3:
        moved = False
        for dx, dz in ((span, 0.0), (-span, 0.0), (0.0, span), (0.0, -span)):
            px = min(max(best_x + dx, bounds[0]), bounds[1])
            pz = min(max(best_z + dz, bounds[2]), bounds[3])
            value = excess_at(field, polar, px, pz, y_m, time_s)
            if value > best:
                best_x, best_z, best, moved = px, pz, value, True
        if not moved:
            span *= 0.5
    u, v, w = field.wind_at(best_x, y_m, best_z, time_s)
    return Core(x_m=best_x, z_m=best_z, wind_mps=hypot(u, v), updraft_mps=w, excess_mps=best)
