"""Axes of a hall and of a body by hand and by matrices: each turn, each sign, each origin."""

from __future__ import annotations

from math import nan, pi, radians, sqrt

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tgl_soar.geometry import (
    HallFrame,
    euler_from_quaternion,
    hall_from_ned,
    in_body_axes,
    is_rotation,
    levelled,
    ned_attitude_from_hall,
    ned_from_hall,
    quaternion_product,
    rotated,
)

# What a hall's x, y, z are once it is levelled: north, east, down.
LEVELLED = {
    True: np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]]),  # z up
    False: np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]]),  # y up
}
ATTITUDES = [
    (0.0, 0.0, 0.0),
    (0.7, 0.0, 0.0),
    (0.0, -0.4, 0.0),
    (0.0, 0.0, 2.1),
    (0.6, 0.5, -0.9),
    (-1.1, 0.3, 2.8),
]


def hall(z_up: bool, yaw_deg: float = 0.0) -> HallFrame:
    return HallFrame(
        z_up=z_up,
        yaw_rad=radians(yaw_deg),
        origin_north_m=10.0,
        origin_east_m=-20.0,
        origin_down_m=3.0,
    )


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    x, y, z, w = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat().tolist()
    return w, x, y, z


@pytest.mark.parametrize("z_up", [True, False])
def test_both_kinds_of_hall_axes_are_right_handed_when_levelled(z_up: bool) -> None:
    axes = [levelled(*row, z_up=z_up) for row in np.eye(3).tolist()]
    assert np.array(axes).T.tolist() == LEVELLED[z_up].tolist()
    assert np.linalg.det(LEVELLED[z_up]) == pytest.approx(1.0)


def test_what_is_up_in_the_hall_is_up_in_the_site() -> None:
    """A metre above the origin, whichever axis says so."""
    assert ned_from_hall(hall(True, 33.0), 0.0, 0.0, 1.0) == pytest.approx((10.0, -20.0, 2.0))
    assert ned_from_hall(hall(False, 33.0), 0.0, 1.0, 0.0) == pytest.approx((10.0, -20.0, 2.0))


def test_a_hall_whose_x_points_east_has_its_y_to_the_north() -> None:
    """z up, right-handed: y is to the left of x."""
    assert ned_from_hall(hall(True, 90.0), 2.0, 0.0, 0.0) == pytest.approx((10.0, -18.0, 3.0))
    assert ned_from_hall(hall(True, 90.0), 0.0, 2.0, 0.0) == pytest.approx((12.0, -20.0, 3.0))
    assert hall_from_ned(hall(True, 90.0), 12.0, -20.0, 3.0) == pytest.approx((0.0, 2.0, 0.0))
    assert hall_from_ned(hall(True, 90.0), 10.0, -20.0, 1.0) == pytest.approx((0.0, 0.0, 2.0))


@pytest.mark.parametrize("z_up", [True, False])
@pytest.mark.parametrize("yaw_deg", [0.0, 40.0, -110.0, 180.0])
def test_the_hall_is_levelled_turned_and_shifted(z_up: bool, yaw_deg: float) -> None:
    turn = Rotation.from_euler("z", yaw_deg, degrees=True).as_matrix() @ LEVELLED[z_up]
    origin = np.array([10.0, -20.0, 3.0])
    for place in ([1.0, 2.0, 3.0], [-4.0, 0.5, 7.0]):
        there = origin + turn @ place
        assert ned_from_hall(hall(z_up, yaw_deg), *place) == pytest.approx(tuple(there))
        assert hall_from_ned(hall(z_up, yaw_deg), *there) == pytest.approx(tuple(place))


@pytest.mark.parametrize("z_up", [True, False])
def test_an_attitude_in_the_hall_turns_about_the_halls_axes(z_up: bool) -> None:
    """The axis of a turn is turned as a vector is, and the origin says nothing of it."""
    turn = Rotation.from_euler("z", 50.0, degrees=True).as_matrix() @ LEVELLED[z_up]
    axis = np.array([0.2, -0.5, 0.4])
    found = ned_attitude_from_hall(hall(z_up, 50.0), 0.8, *axis.tolist())
    assert found == pytest.approx((0.8, *(turn @ axis)))


@pytest.mark.parametrize("attitude", ATTITUDES)
def test_body_axes_are_the_columns_of_the_rotation(attitude: tuple[float, float, float]) -> None:
    q = quaternion(*attitude)
    roll, pitch, yaw = attitude
    matrix = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    for vector in (*np.eye(3), np.array([3.0, -4.0, 5.0])):
        body = in_body_axes(*q, *vector.tolist())
        assert body == pytest.approx(tuple(matrix.T @ vector), abs=1e-12)
        assert rotated(q, body) == pytest.approx(tuple(vector), abs=1e-12)
        assert rotated(q, tuple(vector.tolist())) == pytest.approx(
            tuple(matrix @ vector), abs=1e-12
        )


def test_what_lies_ahead_of_an_aircraft_that_faces_east_is_east_of_it() -> None:
    east = quaternion(0.0, 0.0, 0.5 * pi)
    assert in_body_axes(*east, 0.0, 1.0, 0.0) == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)
    assert in_body_axes(*east, 1.0, 0.0, 0.0) == pytest.approx((0.0, -1.0, 0.0), abs=1e-12)
    nose_up = quaternion(0.0, 0.5 * pi, 0.0)
    assert in_body_axes(*nose_up, 0.0, 0.0, -1.0) == pytest.approx((1.0, 0.0, 0.0), abs=1e-12)


@pytest.mark.parametrize("attitude", ATTITUDES)
def test_euler_angles_are_those_that_were_applied(attitude: tuple[float, float, float]) -> None:
    assert euler_from_quaternion(*quaternion(*attitude)) == pytest.approx(attitude, abs=1e-12)


def test_a_product_of_quaternions_that_are_no_rotations_is_hamiltons() -> None:
    """(1 + 2i + 3j + 4k) (5 + 6i + 7j + 8k), worked out with ij = k, jk = i, ki = j."""
    assert quaternion_product(1, 2, 3, 4, 5, 6, 7, 8) == (-60, 12, 30, 24)
    assert quaternion_product(5, 6, 7, 8, 1, 2, 3, 4) == (-60, 20, 14, 32)


@pytest.mark.parametrize("at", range(4))
def test_a_rotation_has_a_norm_of_one_within_two_hundredths(at: int) -> None:
    """The norm's square by twice as much: 0.96 to 1.04."""
    for square, is_one in ((0.961, True), (0.959, False), (1.039, True), (1.041, False)):
        q = [0.0] * 4
        q[at] = -sqrt(square)
        assert is_rotation(*q) is is_one
        q[at] = nan
        assert not is_rotation(*q)
    assert is_rotation(0.5, 0.5, -0.5, 0.5)
