"""The alignment of a hall: exact where the points are, refused where they could mislead."""

from __future__ import annotations

import random
from math import pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.analysis.alignment import AlignmentError, Pair, Point, fit_alignment
from tgl_soar.geometry import HallFrame, hall_from_ned, ned_from_hall, wrap_angle

SITE = [(0.0, 0.0, 0.0), (2.0, 0.0, -0.5), (2.0, 1.5, -1.0), (0.5, 1.0, -2.0)]


def pairs(hall: HallFrame, points: list[Point] = SITE) -> list[Pair]:
    return [Pair(hall_from_ned(hall, *point), point) for point in points]


angles = st.floats(-pi, pi)
metres = st.floats(-20.0, 20.0)


@given(st.booleans(), angles, metres, metres, metres)
def test_exact_points_give_the_exact_alignment(
    z_up: bool, yaw: float, north: float, east: float, down: float
) -> None:
    hall = HallFrame(
        z_up=z_up, yaw_rad=yaw, origin_north_m=north, origin_east_m=east, origin_down_m=down
    )
    found = fit_alignment(pairs(hall), z_up=z_up)
    assert abs(wrap_angle(found.hall.yaw_rad - yaw)) < 1e-9
    assert found.hall[2:] == pytest.approx(hall[2:], abs=1e-8)
    assert found.rms_m < 1e-9
    for point in SITE:
        assert ned_from_hall(found.hall, *hall_from_ned(hall, *point)) == pytest.approx(
            point, abs=1e-8
        )


def test_noise_gives_the_uncertainty_that_is_reported() -> None:
    """Of many alignments from points with 2 mm of noise, the yaw scatters as is reported."""
    gauss = random.Random(3).gauss
    hall = HallFrame(
        z_up=False, yaw_rad=0.4, origin_north_m=1.0, origin_east_m=2.0, origin_down_m=0.1
    )
    errors, reported = [], []
    for _ in range(400):
        noisy = [
            Pair((h[0] + gauss(0, 0.002), h[1] + gauss(0, 0.002), h[2] + gauss(0, 0.002)), s)
            for h, s in pairs(hall)
        ]
        found = fit_alignment(noisy, z_up=False)
        errors.append((found.hall.yaw_rad - 0.4) ** 2)
        reported.append(found.yaw_sigma_rad**2)
    assert sum(errors) / sum(reported) == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (SITE[:2], "2 points: give 3 or more"),
        ([(0.0, 0.0, 0.0), (0.3, 0.0, 0.0), (0.0, 0.3, -2.0)], "within 0.42 m in the site"),
        ([(0.0, 0.0, 0.0), (1.0, 1.0, 0.0), (3.0, 3.0, -1.0)], "on one line in the site"),
        ([(1.0, 2.0, -1.0)] * 4, "within 0.00 m"),
    ],
)
def test_points_that_tell_too_little_are_refused(points: list[Point], words: str) -> None:
    with pytest.raises(AlignmentError, match=words):
        fit_alignment(
            pairs(
                HallFrame(
                    z_up=False,
                    yaw_rad=0.1,
                    origin_north_m=0.0,
                    origin_east_m=0.0,
                    origin_down_m=0.0,
                ),
                points,
            ),
            z_up=False,
        )


HALL = HallFrame(z_up=False, yaw_rad=0.7, origin_north_m=1.0, origin_east_m=-1.0, origin_down_m=0.0)


@pytest.mark.parametrize(
    ("mistaken", "words"),
    [
        ([Pair(h, (s[0], -s[1], s[2])) for h, s in pairs(HALL)], "mirrored"),
        ([Pair(h, (s[0], s[1], -s[2])) for h, s in pairs(HALL)], "upside down"),
        ([Pair((h[0], h[1], -h[2]), s) for h, s in pairs(HALL)], "mirrored"),
        ([Pair((1e3 * h[0], 1e3 * h[1], 1e3 * h[2]), s) for h, s in pairs(HALL)], "both metres"),
        (pairs(HALL._replace(z_up=True)), "other up axis, try z"),
        ([*pairs(HALL), Pair((3.0, 1.0, 3.0), (0.0, 3.0, 0.0))], "the worst is point 5"),
    ],
)
def test_a_mistake_is_named(mistaken: list[Pair], words: str) -> None:
    with pytest.raises(AlignmentError, match="miss each other") as error:
        fit_alignment(mistaken, z_up=False)
    assert words in str(error.value)
