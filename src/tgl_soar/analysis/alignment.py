"""How a motion-capture hall's axes lie in local NED, from points that are known in both.

    site_i = R(ψ) hall_i + offset,    R: a turn by ψ about the vertical

with hall_i levelled (`geometry.levelled`).  The sum of squared distances is least for

    ψ = atan2(Σ h_n s_e - h_e s_n, Σ h_n s_n + h_e s_e),    offset = mean(site) - R mean(hall)

where h and s are taken from their means (Umeyama 1991, in a plane and without scale).

An alignment that is wrong flies the aircraft into the board, so whatever cannot be told, or does
not fit, is refused: too few points or all on one line, where mirrored axes could not be told
from right ones; points too close together; distances that differ between the two, as with other
units; mirrored axes and the other up axis, which are tried and named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import atan2, hypot, sqrt
from typing import Final, NamedTuple

from tgl_soar.geometry import HallFrame, levelled, ned_from_hall

Point = tuple[float, float, float]

MIN_POINTS: Final = 3
MIN_SPREAD_M: Final = 0.5  # between two of the points, horizontally
MIN_WIDTH_M: Final = 0.2  # of all, across the line that they lie along
SCALE: Final = 0.05  # how far distances may differ, as a fraction
TOLERANCE_M: Final = 0.02  # of the residuals, root mean square


class AlignmentError(ValueError):
    """Points that no alignment can be taken from; the message says why and what to do."""


class Pair(NamedTuple):
    """One point in the hall's axes and in local NED [m]."""

    hall: Point
    site: Point


class Alignment(NamedTuple):
    """The hall in local NED, and how well it fits."""

    hall: HallFrame
    residuals_m: tuple[Point, ...]  # of each pair: NED as aligned less NED as given
    rms_m: float  # of their lengths
    yaw_sigma_rad: float  # from the residuals and how far apart the points are


def fit_alignment(
    pairs: Sequence[Pair], *, z_up: bool, tolerance_m: float = TOLERANCE_M
) -> Alignment:
    """The alignment that fits best.  Errors: `AlignmentError`."""
    if len(pairs) < MIN_POINTS:
        raise AlignmentError(
            f"{len(pairs)} points: give {MIN_POINTS} or more, not on one line, or mirrored axes"
            " cannot be told from right ones"
        )
    _check_spread("in the site", [pair.site for pair in pairs])
    found = _fit(pairs, z_up)
    if found.rms_m <= tolerance_m:
        return found
    worst = max(range(len(pairs)), key=lambda i: _length(found.residuals_m[i]))
    raise AlignmentError(
        f"the points miss each other by {found.rms_m:.3f} m rms, {tolerance_m:g} m is allowed:"
        f" {_why(pairs, z_up, found, tolerance_m)}; the worst is point {worst + 1},"
        f" {_length(found.residuals_m[worst]):.3f} m off"
    )


def _fit(pairs: Sequence[Pair], z_up: bool) -> Alignment:
    hall = [levelled(*pair.hall, z_up=z_up) for pair in pairs]
    site = [pair.site for pair in pairs]
    hall_mean, site_mean = _mean(hall), _mean(site)
    along = across = spread = 0.0
    for h, s in zip(hall, site, strict=True):
        hn, he = h[0] - hall_mean[0], h[1] - hall_mean[1]
        sn, se = s[0] - site_mean[0], s[1] - site_mean[1]
        along += hn * sn + he * se
        across += hn * se - he * sn
        spread += hn * hn + he * he
    yaw = atan2(across, along)
    turned = ned_from_hall(
        HallFrame(z_up=z_up, yaw_rad=yaw, origin_north_m=0.0, origin_east_m=0.0, origin_down_m=0.0),
        *_raw(hall_mean, z_up),
    )
    north, east, down = _less(site_mean, turned)
    frame = HallFrame(
        z_up=z_up, yaw_rad=yaw, origin_north_m=north, origin_east_m=east, origin_down_m=down
    )
    residuals = tuple(_less(ned_from_hall(frame, *pair.hall), pair.site) for pair in pairs)
    squares = sum(_length(r) ** 2 for r in residuals)
    # Four numbers were fitted to three of each point; two axes of three turn the hall.
    noise = sqrt(squares / (3 * len(pairs) - 4))
    yaw_sigma = noise / sqrt(spread) if spread > 0.0 else float("inf")
    return Alignment(frame, residuals, sqrt(squares / len(pairs)), yaw_sigma)


def _why(pairs: Sequence[Pair], z_up: bool, found: Alignment, tolerance_m: float) -> str:
    """The mistake that would explain it."""
    hall, site = [pair.hall for pair in pairs], [pair.site for pair in pairs]
    ratio = _scatter(hall) / _scatter(site)
    if abs(ratio - 1.0) > SCALE:
        return f"distances in the hall are {ratio:.3g} times those in the site, are both metres?"
    limit_m = max(tolerance_m, 0.5 * found.rms_m)
    if _fit(pairs, not z_up).rms_m < limit_m:
        return f"they fit with the other up axis, try {'y' if z_up else 'z'}"
    tries: list[tuple[str, Callable[[Point], Point]]] = [
        ("the sides of the site are mirrored: is east positive to the right of north?", _flip_east),
        ("heights of the site are upside down: down is positive downward", _flip_down),
    ]
    for words, flip in tries:
        flipped = [Pair(pair.hall, flip(pair.site)) for pair in pairs]
        if _fit(flipped, z_up).rms_m < limit_m:
            return words
    return "a point was measured wrongly, or the hall is not level"


def _check_spread(where: str, points: Sequence[Point]) -> None:
    widest = max(hypot(a[0] - b[0], a[1] - b[1]) for a in points for b in points)
    if widest < MIN_SPREAD_M:
        raise AlignmentError(
            f"the points lie within {widest:.2f} m {where}: some must be {MIN_SPREAD_M:g} m apart"
            " horizontally, or more, as a millimetre then turns the hall by 0.1 degrees"
        )
    mean = _mean(points)
    nn = sum((p[0] - mean[0]) ** 2 for p in points)
    ee = sum((p[1] - mean[1]) ** 2 for p in points)
    ne = sum((p[0] - mean[0]) * (p[1] - mean[1]) for p in points)
    least = max(0.0, 0.5 * (nn + ee) - sqrt(0.25 * (nn - ee) ** 2 + ne * ne))
    width = 2.0 * sqrt(least / len(points))
    if width < MIN_WIDTH_M:
        raise AlignmentError(
            f"the points lie on one line {where}, give or take {width:.2f} m: mirrored axes could"
            f" not be told; put one aside by {MIN_SPREAD_M:g} m or more"
        )


def _flip_east(point: Point) -> Point:
    return point[0], -point[1], point[2]


def _flip_down(point: Point) -> Point:
    return point[0], point[1], -point[2]


def _raw(level: Point, z_up: bool) -> Point:
    """Back from levelled axes to the hall's."""
    return (level[0], -level[1], -level[2]) if z_up else (level[0], -level[2], level[1])


def _mean(points: Sequence[Point]) -> Point:
    n = len(points)
    return (
        sum(p[0] for p in points) / n,
        sum(p[1] for p in points) / n,
        sum(p[2] for p in points) / n,
    )


def _scatter(points: Sequence[Point]) -> float:
    """How far points are from their mean, root mean square; never zero."""
    mean = _mean(points)
    return sqrt(sum(_length(_less(p, mean)) ** 2 for p in points) / len(points)) or 1e-12


def _less(one: Point, other: Point) -> Point:
    return one[0] - other[0], one[1] - other[1], one[2] - other[2]


def _length(v: Point) -> float:
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
