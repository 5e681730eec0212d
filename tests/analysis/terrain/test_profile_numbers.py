"""A ground of few points in numbers: how close is enough, how far it is raised, and rounding."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tgl_soar.analysis.terrain.profile import ReducedProfile, reduced
from tgl_soar.types import GROUND_POINTS


def of(*samples: tuple[float, float], **options: Any) -> ReducedProfile:
    x, z = np.array(samples, dtype=float).T
    return reduced(x, z, **options)


def test_a_top_within_a_tenth_of_a_metre_needs_no_point_of_its_own() -> None:
    """The two that are left are raised to it."""
    found = of((0.0, 0.0), (1.0, 0.09), (2.0, 0.0))
    assert found.points == [(0.0, 0.09), (2.0, 0.09)]
    assert found.above_m == pytest.approx(0.09)
    found = of((0.0, 0.0), (1.0, 0.11), (2.0, 0.0))
    assert found.points == [(0.0, 0.0), (1.0, 0.11), (2.0, 0.0)]
    assert found.above_m == pytest.approx(0.0)


def test_over_a_hollow_of_as_much_nothing_is_raised() -> None:
    found = of((0.0, 5.0), (1.0, 4.92), (2.0, 5.0))
    assert found.points == [(0.0, 5.0), (2.0, 5.0)]
    assert found.above_m == pytest.approx(0.08)
    assert len(of((0.0, 5.0), (1.0, 4.88), (2.0, 5.0)).points) == 3


def test_a_chord_between_uneven_samples_is_straight_in_x() -> None:
    """A quarter of the way along, a quarter of the way up."""
    found = of((0.0, 0.0), (1.0, 10.0), (4.0, 40.0))
    assert found.points == [(0.0, 0.0), (4.0, 40.0)]
    assert len(of((0.0, 0.0), (2.0, 10.0), (4.0, 40.0)).points) == 3


@pytest.mark.parametrize("most", [2, 3, 4, 5])
def test_no_more_points_than_are_asked_for_and_raised_by_what_is_cut_off(most: int) -> None:
    """A staircase of two steps: with five points it is whole; a fourth one alone is no help."""
    samples = ((0.0, 0.0), (10.0, 0.0), (11.0, 6.0), (20.0, 6.0), (21.0, 12.0))
    found = of(*samples, most=most)
    assert len(found.points) == {4: 3}.get(most, most)
    x = [point[0] for point in found.points]
    assert x == sorted(set(x))
    assert (x[0], x[-1]) == (0.0, 21.0)
    over = np.interp([s[0] for s in samples], *np.array(found.points).T)
    above = over - np.array([s[1] for s in samples])
    assert above.min() >= -1e-9
    assert above.min() < 0.01  # and no higher than it must
    assert found.above_m == pytest.approx(above.max())
    assert (found.above_m < 0.01) == (most == 5)


def test_as_many_points_as_a_site_file_takes_by_default() -> None:
    x = np.arange(3.0 * GROUND_POINTS)
    saw = np.where(np.arange(len(x)) % 2 == 0, 0.0, 10.0)
    assert len(reduced(x, saw).points) == GROUND_POINTS


def test_heights_are_rounded_up_to_centimetres_and_places_to_millimetres() -> None:
    found = of((0.12345, 1.001), (7.0, -2.009))
    assert found.points == [(0.123, 1.01), (7.0, -2.0)]
    assert found.above_m == pytest.approx(0.009, abs=1e-4)
    assert of((0.0, 1.01), (7.0, 2.0)).points == [(0.0, 1.01), (7.0, 2.0)]


@pytest.mark.parametrize(
    ("count", "most", "words"),
    [(1, 5, "1 samples to 5 points"), (3, 1, "3 samples to 1 points: two or more of each")],
)
def test_less_than_two_is_no_ground(count: int, most: int, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        reduced(np.arange(float(count)), np.zeros(count), most=most)
    assert len(reduced(np.arange(2.0), np.zeros(2), most=2).points) == 2
