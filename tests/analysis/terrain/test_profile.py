"""A ground reduced to few points: nowhere below, and above by no more than it says."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from tgl_soar.analysis.terrain.profile import ENOUGH_M, reduced
from tgl_soar.types import GROUND_POINTS


def at(points: list[tuple[float, float]], x: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.interp(x, [p[0] for p in points], [p[1] for p in points]))


@given(st.lists(st.floats(-50.0, 50.0), min_size=2, max_size=40))
def test_nowhere_below_and_above_by_what_it_says(heights: list[float]) -> None:
    x, z = np.arange(float(len(heights))) * 7.0, np.array(heights)
    found = reduced(x, z)
    assert 2 <= len(found.points) <= GROUND_POINTS
    assert found.points[0][0] == x[0]
    assert found.points[-1][0] == x[-1]
    above = at(found.points, x) - z
    assert above.min() >= -1e-9
    assert above.max() == pytest.approx(found.above_m)


def test_a_ground_of_few_points_is_found_again() -> None:
    corners = [(-60.0, 0.0), (-20.0, 2.0), (0.0, 20.0), (40.0, 15.0)]
    x = np.linspace(-60.0, 40.0, 51)
    found = reduced(x, at(corners, x))
    assert [p[0] for p in found.points] == [-60.0, -20.0, 0.0, 40.0]
    assert found.above_m <= 0.011  # the heights are rounded up to centimetres


def test_level_ground_needs_two_points() -> None:
    x = np.linspace(0.0, 100.0, 30)
    assert len(reduced(x, np.full(30, 4.0)).points) == 2


def test_no_other_choice_of_points_is_better() -> None:
    """Against all of them, on a ground small enough to try."""
    x = np.arange(10.0)
    z = np.array([0.0, 3.0, 1.0, 8.0, 7.5, 2.0, 6.0, 6.5, -3.0, 0.0])
    found = reduced(x, z, most=5)
    # As the chords lie before they are raised.
    lowered = {float(p[0]): float(z[int(p[0])]) for p in found.points}
    own = float(np.abs(np.interp(x, list(lowered), list(lowered.values())) - z).max())
    best = min(
        float(np.abs(np.interp(x, x[list(c)], z[list(c)]) - z).max())
        for n in range(4)
        for c in ((0, *inner, 9) for inner in itertools.combinations(range(1, 9), n))
    )
    assert own == pytest.approx(best)
    assert best > ENOUGH_M


def test_one_sample_is_no_ground() -> None:
    with pytest.raises(ValueError, match="two or more"):
        reduced(np.array([0.0]), np.array([1.0]))
