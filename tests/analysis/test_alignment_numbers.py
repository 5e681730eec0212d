"""The hall's alignment in numbers: the fit and its uncertainty by matrices, each limit from both
sides, and which mistake is named."""

from __future__ import annotations

import random
from math import atan2, cos, inf, pi, radians, sin, sqrt
from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.alignment import AlignmentError, Pair, Point, fit_alignment
from tgl_soar.geometry import HallFrame, hall_from_ned

SITE: list[Point] = [(0.0, 0.0, 0.0), (2.0, 0.0, -0.5), (2.0, 1.5, -1.0), (0.5, 1.0, -2.0)]
HALL = HallFrame(z_up=False, yaw_rad=0.7, origin_north_m=1.0, origin_east_m=-1.0, origin_down_m=0.2)


def pairs(points: list[Point], hall: HallFrame = HALL) -> list[Pair]:
    """Points of the site as this hall has them."""
    return [Pair(hall_from_ned(hall, *point), point) for point in points]


def moved(point: Point, north: float = 0.0, east: float = 0.0, down: float = 0.0) -> Point:
    return point[0] + north, point[1] + east, point[2] + down


def noisy(sigma_m: float, points: list[Point], hall: HallFrame = HALL) -> list[Pair]:
    gauss = random.Random(5).gauss
    return [
        Pair(moved(h, *(gauss(0.0, sigma_m) for _ in range(3))), s) for h, s in pairs(points, hall)
    ]


def level(pair: Pair, z_up: bool) -> Any:
    """North and east of a hall that is not turned, and down, by the axes' words."""
    x, y, z = pair.hall
    return np.array([x, -y, -z] if z_up else [x, z, -y])


def why(given: list[Pair], *, z_up: bool = False, **options: float) -> str:
    with pytest.raises(AlignmentError, match="the points miss each other by") as error:
        fit_alignment(given, z_up=z_up, **options)
    return str(error.value)


@pytest.mark.parametrize("z_up", [False, True])
def test_the_fit_is_that_of_a_singular_value_decomposition(z_up: bool) -> None:
    given = noisy(0.01, SITE, HALL._replace(z_up=z_up))
    found = fit_alignment(given, z_up=z_up, tolerance_m=1.0)
    h = np.array([level(pair, z_up) for pair in given])
    s = np.array([pair.site for pair in given])
    u, _, vt = np.linalg.svd((h - h.mean(axis=0))[:, :2].T @ (s - s.mean(axis=0))[:, :2])
    turn = np.eye(3)
    turn[:2, :2] = vt.T @ np.diag([1.0, np.linalg.det(vt.T @ u.T)]) @ u.T
    offset = s.mean(axis=0) - turn @ h.mean(axis=0)
    assert found.hall.yaw_rad == pytest.approx(atan2(turn[1, 0], turn[0, 0]))
    assert found.hall[2:] == pytest.approx(tuple(offset))
    assert found.hall.z_up is z_up
    off = h @ turn.T + offset - s
    assert np.array(found.residuals_m) == pytest.approx(off)
    assert found.rms_m == pytest.approx(sqrt((off**2).sum() / 4))


def test_the_uncertainty_of_the_yaw_is_that_of_least_squares() -> None:
    """From the derivatives of twelve residuals by four unknowns."""
    given = noisy(0.01, SITE)
    found = fit_alignment(given, z_up=False, tolerance_m=1.0)
    c, s = cos(found.hall.yaw_rad), sin(found.hall.yaw_rad)
    rows = []
    for pair in given:
        north, east, _ = level(pair, z_up=False)
        rows += [[-s * north - c * east, 1, 0, 0], [c * north - s * east, 0, 1, 0], [0, 0, 0, 1]]
    jacobian = np.array(rows)
    variance = (np.array(found.residuals_m) ** 2).sum() / (12 - 4)
    covariance = variance * np.linalg.inv(jacobian.T @ jacobian)
    assert found.yaw_sigma_rad == pytest.approx(sqrt(covariance[0, 0]))


def test_points_that_are_all_one_in_the_hall_tell_no_yaw() -> None:
    same = [Pair((1.0, 2.0, 3.0), point) for point in SITE]
    found = fit_alignment(same, z_up=False, tolerance_m=9.0)
    assert found.yaw_sigma_rad == inf
    assert "are both metres?" in why(same)


# --- what is refused ----------------------------------------------------------------------------


def test_three_points_are_enough() -> None:
    assert fit_alignment(pairs(SITE[:3]), z_up=False).rms_m < 1e-9
    with pytest.raises(AlignmentError, match="2 points: give 3 or more, not on one line"):
        fit_alignment(pairs(SITE[:2]), z_up=False)


@pytest.mark.parametrize(("widest_m", "enough"), [(0.49, False), (0.51, True)])
def test_some_points_are_half_a_metre_apart_horizontally(widest_m: float, enough: bool) -> None:
    """An upright triangle of that base; height does not count."""
    tall: list[Point] = [(1.0, 1.0, 0.0), (1.0 + 0.6 * widest_m, 1.0 + 0.8 * widest_m, -3.0)]
    tall.append((1.0 + 0.3 * widest_m - 0.24, 1.0 + 0.4 * widest_m + 0.18, -1.0))
    apart_m = max(np.hypot(a[0] - b[0], a[1] - b[1]) for a in tall for b in tall)
    assert apart_m == pytest.approx(widest_m)
    if enough:
        found = fit_alignment(pairs(tall), z_up=False)
        assert max(found.rms_m, found.yaw_sigma_rad) < 1e-9
    else:
        words = r"lie within 0\.49 m in the site: some must be 0\.5 m apart"
        with pytest.raises(AlignmentError, match=words):
            fit_alignment(pairs(tall), z_up=False)


@pytest.mark.parametrize("turn_deg", [0.0, 30.0, 90.0, -45.0])
@pytest.mark.parametrize(("half_m", "enough"), [(0.099, False), (0.101, True)])
def test_points_lie_a_fifth_of_a_metre_across_their_line(
    turn_deg: float, half_m: float, enough: bool
) -> None:
    """The corners of a rectangle: across its long side they scatter by half its width."""
    c, s = cos(radians(turn_deg)), sin(radians(turn_deg))
    corners = [(a, b) for a in (-1.0, 1.0) for b in (-half_m, half_m)]
    narrow: list[Point] = [(3.0 + c * a - s * b, -2.0 + s * a + c * b, a) for a, b in corners]
    if enough:
        assert fit_alignment(pairs(narrow), z_up=False).rms_m < 1e-9
    else:
        words = r"on one line in the site, give or take 0\.20 m: mirrored axes could not be told"
        with pytest.raises(AlignmentError, match=words):
            fit_alignment(pairs(narrow), z_up=False)


SQUARE: list[Point] = [(a, b, -1.0) for a in (-1.0, 1.0) for b in (-1.0, 1.0)]


def saddle(off_m: float) -> list[Pair]:
    """Two corners too high and two too low by so much: no turn and no shift can mend that."""
    given = pairs(SQUARE)
    return [Pair(pair.hall, moved(pair.site, down=off_m * pair.site[0] * pair.site[1]))
            for pair in given]  # fmt: skip


def test_points_miss_each_other_by_two_centimetres_at_most() -> None:
    assert fit_alignment(saddle(0.0199), z_up=False).rms_m == pytest.approx(0.0199)
    assert "miss each other by 0.020 m rms, 0.02 m is allowed" in why(saddle(0.0201))


def test_another_tolerance_is_allowed() -> None:
    assert fit_alignment(saddle(0.049), z_up=False, tolerance_m=0.05).rms_m > 0.04
    assert "0.051 m rms, 0.05 m is allowed" in why(saddle(0.051), tolerance_m=0.05)


def test_the_worst_point_is_reported_by_its_number_and_how_far_it_is_off() -> None:
    """Of four corners one 0.4 m too far down: three quarters of it stay with it, level."""
    for worst in range(4):
        given = pairs(SQUARE)
        given[worst] = Pair(given[worst].hall, moved(given[worst].site, down=0.4))
        found = why(given)
        assert found.endswith(f"the worst is point {worst + 1}, 0.300 m off")
        assert "rms, 0.02 m is allowed: a point was measured wrongly, or the hall is not" in found


# --- which mistake ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("factor", "named"), [(0.94, True), (0.96, False), (1.04, False), (1.06, True), (3.281, True)]
)
def test_other_units_are_named_where_distances_differ_by_a_twentieth(
    factor: float, named: bool
) -> None:
    given = [Pair((factor * h[0], factor * h[1], factor * h[2]), s) for h, s in pairs(SITE)]
    words = f"distances in the hall are {factor:.3g} times those in the site, are both metres?"
    assert (words in why(given)) == named


@pytest.mark.parametrize(("z_up", "other"), [(False, "z"), (True, "y")])
def test_the_other_up_axis_is_named(z_up: bool, other: str) -> None:
    given = pairs(SITE, HALL._replace(z_up=not z_up))
    assert f"they fit with the other up axis, try {other};" in why(given, z_up=z_up)
    # With points that are measured badly as well.
    given = noisy(0.05, SITE, HALL._replace(z_up=not z_up))
    assert f"they fit with the other up axis, try {other};" in why(given, z_up=z_up)


def test_mirrored_sides_and_heights_are_named_though_points_are_measured_badly() -> None:
    given = noisy(0.05, SITE)
    mirrored = [Pair(h, (s[0], -s[1], s[2])) for h, s in given]
    words = "the sides of the site are mirrored: is east positive to the right of north?"
    assert words in why(mirrored)
    inverted = [Pair(h, (s[0], s[1], -s[2])) for h, s in given]
    assert "heights of the site are upside down: down is positive downward" in why(inverted)


@pytest.mark.parametrize(("fraction", "named"), [(0.25, False), (0.4, True)])
def test_a_mistake_is_named_where_without_it_less_than_half_is_left(
    fraction: float, named: bool
) -> None:
    """Heights upside down, flattened to a fraction f: 1 + f is missed, and 1 - f without.

    They are small beside the sides, so that the distances are still alike.
    """
    wide: list[Point] = [(2.0 * a, 2.0 * b, 0.3 * a * b) for a in (-1, 1) for b in (-1, 1)]
    given = [Pair(h, (s[0], s[1], -fraction * s[2])) for h, s in pairs(wide)]
    assert ("upside down" in why(given)) == named
    assert f"by {0.3 * (1.0 + fraction):.3f} m rms" in why(given)


def test_a_mistake_is_named_where_without_it_the_points_are_good_enough() -> None:
    """A tolerance of two thirds of what is missed: less than that is left, more than half."""
    wide: list[Point] = [(2.0 * a, 2.0 * b, 0.3 * a * b) for a in (-1, 1) for b in (-1, 1)]
    given = [Pair(h, (s[0], s[1], -0.25 * s[2])) for h, s in pairs(wide)]
    assert "upside down" in why(given, tolerance_m=0.24)
    assert "upside down" not in why(given, tolerance_m=0.22)


def test_a_hall_is_turned_by_any_angle() -> None:
    for yaw in (-0.9 * pi, -0.5 * pi, 0.0, 0.5 * pi, 0.99 * pi):
        found = fit_alignment(pairs(SITE, HALL._replace(yaw_rad=yaw)), z_up=False)
        assert found.hall.yaw_rad == pytest.approx(yaw)
