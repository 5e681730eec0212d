"""How far a line goes on within the fence and clear of the ground, whichever way it leans."""

from __future__ import annotations

from math import cos, radians, sin

import pytest

from tgl_soar.control.envelope import Fence
from tgl_soar.control.line_room import LineRoom, line_room
from tgl_soar.types import NO_GROUND, Ground

FENCE = Fence(x_min_m=-4.0, x_max_m=3.0, y_max_m=5.0, z_min_m=0.5, z_max_m=40.0)
X_M, Z_M = 0.5, 20.0


def room(lean_deg: float, fence: Fence = FENCE) -> LineRoom:
    """lean_deg: upstream, up the line."""
    return line_room(0.3, fence, NO_GROUND, X_M, Z_M, radians(90.0 + lean_deg))


@pytest.mark.parametrize(
    ("lean_deg", "up_to_m", "down_to_m"), [(40.0, -4.0, 3.0), (-40.0, 3.0, -4.0)]
)
def test_a_line_that_leans_ends_at_the_sides(
    lean_deg: float, up_to_m: float, down_to_m: float
) -> None:
    along_x = cos(radians(90.0 + lean_deg))
    found = room(lean_deg)
    assert X_M + found.up_m * along_x == pytest.approx(up_to_m)
    assert X_M - found.down_m * along_x == pytest.approx(down_to_m)
    assert found.down_is_fence


@pytest.mark.parametrize("lean_deg", [-5.0, 0.0, 5.0])
def test_a_steep_one_at_bottom_and_top(lean_deg: float) -> None:
    along_z = sin(radians(90.0 + lean_deg))
    found = room(lean_deg, FENCE._replace(x_min_m=-40.0, x_max_m=40.0))
    assert Z_M + found.up_m * along_z == pytest.approx(40.0)
    assert Z_M - found.down_m * along_z == pytest.approx(0.5)


def test_beyond_the_fence_there_is_none() -> None:
    outside = line_room(0.3, FENCE, NO_GROUND, 3.5, Z_M, radians(130.0))
    assert outside.down_m == 0.0
    assert outside.up_m > 0.0


# --- over a ground ------------------------------------------------------------------------------

WIDE = Fence(x_min_m=-10.0, x_max_m=100.0, y_max_m=5.0, z_min_m=-100.0, z_max_m=200.0)


def ground(*points: tuple[float, float]) -> Ground:
    x, z = zip(*points, *[points[-1]] * (8 - len(points)), strict=True)
    return Ground(len(points), x, z)


LEVEL = ground((0.0, 0.0))


def over(
    profile: Ground, z_m: float, lean_deg: float = 0.0, x_m: float = 6.0, least_m: float = 0.5,
    fence: Fence = WIDE,
) -> LineRoom:  # fmt: skip
    return line_room(least_m, fence, profile, x_m, z_m, radians(90.0 + lean_deg))


@pytest.mark.parametrize("lean_deg", [0.0, 20.0, -20.0])
def test_down_to_level_ground_it_keeps_its_clearance(lean_deg: float) -> None:
    """To 3 mm; as deep as the clearance more is the air."""
    found = over(LEVEL, 20.0, lean_deg)
    assert found.down_m == pytest.approx(19.5 / cos(radians(lean_deg)), abs=0.004)
    assert not found.down_is_fence
    assert found.depth_m == pytest.approx(found.down_m + 0.5)


def test_over_a_slope_clearance_is_along_its_normal() -> None:
    steep = ground((-50.0, -50.0), (50.0, 50.0))
    assert over(steep, 20.0).down_m == pytest.approx(14.0 - 0.5 * 2.0**0.5, abs=0.004)


def test_ground_that_is_farther_than_fifty_metres_is_not_looked_for() -> None:
    far = over(LEVEL, 50.6)
    assert far.down_m == pytest.approx(150.6)
    assert (far.down_is_fence, far.depth_m) == (True, 50.0)
    near = over(LEVEL, 50.4)
    assert near.down_m == pytest.approx(49.9, abs=0.004)
    assert not near.down_is_fence


def test_no_air_is_less_deep_than_three_tenths_of_a_metre() -> None:
    low = WIDE._replace(z_min_m=19.9)
    assert over(NO_GROUND, 20.0, least_m=0.1, fence=low).depth_m == pytest.approx(0.3)
    assert over(NO_GROUND, 20.0, least_m=0.3, fence=low).depth_m == pytest.approx(0.4)


def test_who_is_too_near_already_has_nowhere_to_go() -> None:
    assert over(LEVEL, 0.4).down_m == pytest.approx(0.0, abs=0.004)


RIDGE = ground((-10.0, 0.0), (0.0, 10.0), (10.0, 0.0))


@pytest.mark.parametrize(("z_m", "barred"), [(14.0, True), (14.1, True), (14.3, False)])
def test_a_ridge_that_a_line_comes_too_near_to_bars_it(z_m: float, barred: bool) -> None:
    """Though it comes out again beyond: 30 degrees down, over a ridge of 45 degrees to both sides.

    On this side the clearance is (z + x - 10 - (sin 30 + cos 30) w) / √2 after a way w.
    """
    found = over(RIDGE, z_m, -60.0)
    if barred:
        way_m = (z_m - 4.0 - 0.5 * 2.0**0.5) / (0.5 + 0.75**0.5)
        assert found.down_m == pytest.approx(way_m, abs=0.004)
        assert not found.down_is_fence
    else:
        assert found.down_m == pytest.approx(16.0 / 0.75**0.5)
        assert found.down_is_fence


def test_a_ridge_behind_or_below_an_upright_line_bars_nothing() -> None:
    beside = over(RIDGE, 14.0, x_m=12.0)  # level beyond the ridge's foot
    assert beside.down_m == pytest.approx(13.5, abs=0.004)
    away = over(RIDGE, 14.0, 60.0)  # down it goes downstream, away from the ridge
    assert away.down_m == pytest.approx(27.0, abs=0.01)
