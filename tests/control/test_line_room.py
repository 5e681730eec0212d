"""How far a line goes on within the fence, whichever way it leans (`test_forecast.py`: and clear of
the ground)."""

from __future__ import annotations

from math import cos, radians, sin

import pytest

from tgl_soar.control.envelope import Fence
from tgl_soar.control.line_room import LineRoom, line_room
from tgl_soar.types import NO_GROUND

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
