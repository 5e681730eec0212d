"""How finely a draft looks at its ground: steps of the crest's search, of the slope and of the
profile, each by the model's posts or by the reach."""

from __future__ import annotations

from math import atan, degrees
from typing import Any

import numpy as np
import pytest
from test_draft import POLAR, REQUEST, Ground, bank, place, tent

from tgl_soar.analysis.terrain.draft import _crest, draft

REACH_M = 200.0  # of which a quarter to either side is looked at for the crest


def posts(spacing_m: float, height: Any) -> Any:
    """Ground of a model with posts so far apart."""
    made = Ground(height)
    made.elevation.spacing_m = spacing_m
    return made


@pytest.mark.parametrize(
    ("spacing_m", "top_m", "found_m"),
    [
        (2.0, 13.0, 13.0),  # each metre: half of the posts
        (2.0, 13.4, 13.0),
        (2.0, -49.0, -49.0),
        (100.0, 7.5, 7.5),  # each 2.5 m: a twentieth of what is looked at
        (100.0, 8.5, 7.5),
        (100.0, 9.0, 10.0),
        (6.0, 48.0, 47.5),  # a twentieth is less than half a post
        (4.8, 48.0, 50.0 - 50.0 / 21.0),  # 21 steps of a little less than half a post
    ],
)
def test_the_crest_is_looked_for_in_steps_of_half_a_post(
    spacing_m: float, top_m: float, found_m: float
) -> None:
    frame, _ = _crest(posts(spacing_m, tent(top_m)), place(), REACH_M, POLAR)
    assert frame.origin_east_m == pytest.approx(found_m)
    assert frame.origin_north_m == pytest.approx(0.0, abs=1e-9)
    assert frame.origin_down_m == pytest.approx(0.4 * abs(frame.origin_east_m - top_m))


@pytest.mark.parametrize(("spacing_m", "over_m"), [(10.0, 20.0), (20.0, 40.0)])
def test_the_slope_is_that_over_two_posts(spacing_m: float, over_m: float) -> None:
    """A rise of eight metres within ten, the rest is level."""
    frame, steepest = _crest(
        posts(spacing_m, lambda s: 0.8 * np.clip(s + 60.0, -10.0, 0.0)), place(), REACH_M, POLAR
    )
    assert steepest == pytest.approx(degrees(atan(8.0 / over_m)))
    assert frame.origin_down_m == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("spacing_m", "step_m"),
    [
        (1.0, 2.0),  # two hundred samples at most
        (80.0, 20.0),  # ten to either side at least
    ],
)
def test_the_profile_has_two_hundred_samples_at_most_and_twenty_at_least(
    spacing_m: float, step_m: float
) -> None:
    found = draft(posts(spacing_m, bank), REQUEST, POLAR)
    count = round(2.0 * REACH_M / step_m) + 1
    assert found.x_m == pytest.approx(np.linspace(-REACH_M, REACH_M, count))
    # The ground goes on upwind by half a post, and downwind by a quarter of the fence.
    apart_m = max(0.5 * spacing_m, 2.0)
    x_min, x_max, _, _ = found.bounds
    points = found.ground.points
    assert x_min - apart_m <= points[0][0] <= x_min
    assert x_max - 0.25 * x_min - step_m < points[-1][0] <= x_max - 0.25 * x_min


def test_the_ground_is_the_highest_of_nine_strips_across_the_fence() -> None:
    """A rib of ten metres, a quarter of the half width to one side of the middle, is detected."""

    class Ribbed(Ground):
        def up_m(self, north_m: Any, east_m: Any) -> Any:
            rib = np.abs(np.asarray(north_m) - 10.0) < 1.0
            return super().up_m(north_m, east_m) + 10.0 * rib

    ribbed: Any = Ribbed(bank)
    found = draft(ribbed, REQUEST._replace(wind_from_deg=270.0), POLAR)
    raised = np.interp(-60.0, *np.array(found.ground.points).T)
    assert raised - np.interp(-60.0, found.x_m, found.z_m) == pytest.approx(10.0, abs=0.5)
