"""Two ailerons that brake: what either is given, and what is known of both from where they are."""

from __future__ import annotations

from math import isnan, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.link.autopilots.aileron_brake_mixing import mixed, unmixed

THROW = 0.6


@pytest.mark.parametrize(
    ("aileron", "brake", "throw", "left", "right"),
    [
        (0.0, 0.0, THROW, 0.0, 0.0),
        (0.25, 0.0, THROW, 0.25, 0.25),  # roll: both to the right
        (0.0, 1.0, THROW, -0.6, 0.6),  # the brake: both up
        (0.0, 1.0, -THROW, 0.6, -0.6),  # or both down
        (0.25, 0.5, THROW, -0.05, 0.55),
        (-0.25, 0.5, THROW, -0.55, 0.05),
        (0.75, 1.0, THROW, 0.5, 1.0),  # the brake gives way
        (-0.75, 1.0, THROW, -1.0, -0.5),
        (0.75, 1.0, -THROW, 1.0, 0.5),
        (1.0, 1.0, THROW, 1.0, 1.0),
        (1.5, 0.0, THROW, 1.0, 1.0),
        (-1.5, 1.0, THROW, -1.0, -1.0),
    ],
)
def test_roll_moves_them_apart_the_brake_both_one_way_and_roll_comes_first(
    aileron: float, brake: float, throw: float, left: float, right: float
) -> None:
    """`apart` of deflections, as either servo's positive one rolls right."""
    assert mixed(aileron, brake, throw) == pytest.approx((left, right))


@given(st.floats(-1, 1), st.floats(0, 1), st.floats(0.1, 1))
def test_within_the_travel_both_are_told_apart_again(
    aileron: float, brake: float, throw: float
) -> None:
    left, right = mixed(aileron, brake, throw)
    assert -1.0 <= left <= 1.0
    assert -1.0 <= right <= 1.0
    back, brakes = unmixed(left, right, throw)
    assert back == pytest.approx(aileron, abs=1e-9)  # the brake changes no roll
    assert brakes == pytest.approx(min(brake, (1.0 - abs(aileron)) / throw), abs=1e-9)


@pytest.mark.parametrize("servos", [(nan, 0.5), (0.5, nan)])
def test_of_one_servo_nothing_is_known_of_either(servos: tuple[float, float]) -> None:
    assert all(map(isnan, unmixed(*servos, THROW)))
