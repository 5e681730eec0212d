"""Frames and rotations against scipy's, and signs against what an aircraft does."""

from __future__ import annotations

from math import cos, pi, radians, remainder, sin, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tgl_soar.geometry import (
    HallFrame,
    SoaringFrame,
    euler_from_quaternion,
    euler_rates,
    ned_attitude_from_hall,
    ned_from_soaring,
    ned_vector_from_soaring,
    quaternion_from_euler,
    quaternion_product,
    rotated,
    soaring_from_ned,
    soaring_vector_from_ned,
    wrap_angle,
)

metres = st.floats(-1e3, 1e3)
angles = st.floats(-pi, pi)
pitches = st.floats(-1.5, 1.5)  # short of straight up, where roll and yaw are one
frames = st.builds(SoaringFrame, metres, metres, metres, st.floats(-7.0, 7.0))


def scipy_rotation(q: tuple[float, float, float, float]) -> Rotation:
    w, x, y, z = q
    return Rotation.from_quat([x, y, z, w])


# --- angles ---------------------------------------------------------------------------------


@given(angle=st.floats(-1e4, 1e4))
def test_a_wrapped_angle_is_the_same_angle(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -pi <= wrapped <= pi
    assert remainder(wrapped - angle, 2.0 * pi) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("angle", "wrapped"), [(pi, -pi), (-pi, -pi), (0.0, 0.0), (4.0, 4.0 - 2 * pi)]
)
def test_the_edge_of_an_angle_belongs_to_the_left(angle: float, wrapped: float) -> None:
    assert wrap_angle(angle) == pytest.approx(wrapped, abs=1e-12)


# --- the soaring frame ----------------------------------------------------------------------


def test_with_wind_from_the_north_downstream_is_south() -> None:
    frame = SoaringFrame(0.0, 0.0, 0.0, 0.0)
    # 3 m north, 2 m east, 1 m down: 3 m upwind, 2 m right of an aircraft that faces north.
    assert soaring_from_ned(frame, 3.0, 2.0, 1.0) == pytest.approx((-3.0, 2.0, -1.0))


def test_with_wind_from_the_west_the_right_hand_is_north() -> None:
    # Facing west, north is on the right; upwind is west.
    frame = SoaringFrame(10.0, 20.0, -30.0, radians(270.0))
    assert soaring_from_ned(frame, 11.0, 15.0, -32.0) == pytest.approx((-5.0, 1.0, 2.0))


@given(frame=frames, north=metres, east=metres, down=metres)
def test_there_and_back(frame: SoaringFrame, north: float, east: float, down: float) -> None:
    there = soaring_from_ned(frame, north, east, down)
    assert ned_from_soaring(frame, *there) == pytest.approx((north, east, down), abs=1e-9)
    vector = soaring_vector_from_ned(frame, north, east, down)
    assert ned_vector_from_soaring(frame, *vector) == pytest.approx((north, east, down), abs=1e-9)


@given(frame=frames, north=metres, east=metres, down=metres)
def test_it_is_a_turn_about_the_vertical_and_a_half_turn(
    frame: SoaringFrame, north: float, east: float, down: float
) -> None:
    # Turned by the wind's direction, then x = -N', z = -D': half a turn about y.
    turn = Rotation.from_euler("y", pi) * Rotation.from_euler("z", -frame.wind_from_rad)
    expected = turn.apply([north, east, down])
    got = soaring_vector_from_ned(frame, north, east, down)
    assert got == pytest.approx(tuple(expected), abs=1e-9)


# --- rotations ------------------------------------------------------------------------------


@given(roll=angles, pitch=pitches, yaw=angles)
def test_quaternions_are_scipys(roll: float, pitch: float, yaw: float) -> None:
    ours = scipy_rotation(quaternion_from_euler(roll, pitch, yaw))
    theirs = Rotation.from_euler("ZYX", [yaw, pitch, roll])
    assert (ours.inv() * theirs).magnitude() < 1e-7  # acos near 1 is no better


@given(roll=angles, pitch=pitches, yaw=angles)
def test_euler_angles_there_and_back(roll: float, pitch: float, yaw: float) -> None:
    back = euler_from_quaternion(*quaternion_from_euler(roll, pitch, yaw))
    for a, b in zip(back, (roll, pitch, yaw), strict=True):
        assert remainder(a - b, 2.0 * pi) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("pitch", [-0.5 * pi, 0.5 * pi])
def test_straight_up_and_down_are_numbers(pitch: float) -> None:
    roll, got, yaw = euler_from_quaternion(*quaternion_from_euler(0.2, pitch, 0.3))
    assert got == pytest.approx(pitch, abs=1e-6)
    assert all(-pi <= a <= pi for a in (roll, yaw))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_rounding_beyond_straight_up_is_straight_up(sign: float) -> None:
    # A quaternion longer than one by a few units in the last place has a sine above one.
    w = 0.5**0.5 * (1.0 + 1e-15)
    _, pitch, _ = euler_from_quaternion(w, 0.0, sign * w, 0.0)
    assert pitch == pytest.approx(sign * 0.5 * pi, abs=1e-12)


def test_nose_up_right_wing_down_nose_right_are_positive() -> None:
    # Body axes forward, right, down, seen in NED.
    forward, right, _ = scipy_rotation(quaternion_from_euler(0.0, 0.1, 0.0)).as_matrix().T
    assert forward[2] < 0.0  # nose up: forward points up
    forward, right, _ = scipy_rotation(quaternion_from_euler(0.1, 0.0, 0.0)).as_matrix().T
    assert right[2] > 0.0  # roll right: the right wing points down
    forward, right, _ = scipy_rotation(quaternion_from_euler(0.0, 0.0, 0.1)).as_matrix().T
    assert forward[1] > 0.0  # facing north, the nose goes east


@given(a=st.tuples(angles, pitches, angles), b=st.tuples(angles, pitches, angles))
def test_a_product_turns_by_the_second_first(
    a: tuple[float, float, float], b: tuple[float, float, float]
) -> None:
    qa, qb = quaternion_from_euler(*a), quaternion_from_euler(*b)
    ours = scipy_rotation(quaternion_product(*qa, *qb))
    theirs = scipy_rotation(qa) * scipy_rotation(qb)
    assert (ours.inv() * theirs).magnitude() < 1e-7


@given(
    roll=st.floats(-1.2, 1.2),
    pitch=st.floats(-1.2, 1.2),
    yaw=angles,
    rates=st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3, 3)),
)
def test_euler_rates_are_what_a_turning_body_shows(
    roll: float, pitch: float, yaw: float, rates: tuple[float, float, float]
) -> None:
    # Half a step back and half a step on, about the body's own axes.
    dt = 1e-4
    attitude = scipy_rotation(quaternion_from_euler(roll, pitch, yaw))
    after, before = (
        (attitude * Rotation.from_rotvec(s * 0.5 * dt * np.array(rates))).as_euler("ZYX")
        for s in (1.0, -1.0)
    )
    for got, a, b in zip(euler_rates(roll, pitch, *rates), after[::-1], before[::-1], strict=True):
        # A central difference errs by dt² times third derivatives, with 1/cos³(1.2) in them.
        assert got == pytest.approx(remainder(a - b, 2.0 * pi) / dt, abs=1e-3)


def test_euler_rates_stay_numbers_straight_up() -> None:
    roll_rate, pitch_rate, yaw_rate = euler_rates(0.3, 0.5 * pi, 1.0, 2.0, 3.0)
    # The divisor is never less than a twentieth of that of a horizontal turn.
    assert abs(yaw_rate) <= 20.0 * (2.0 * sin(0.3) + 3.0 * cos(0.3)) + 1e-9
    assert abs(roll_rate) <= 1.0 + abs(yaw_rate)
    assert pitch_rate == pytest.approx(2.0 * cos(0.3) - 3.0 * sin(0.3))


def test_a_tracked_body_s_attitude_in_a_hall_that_points_south() -> None:
    """y up, x to the south, so z to the west: a turn to the right is about -y, nose up about -z."""
    hall = HallFrame(
        z_up=False, yaw_rad=pi, origin_north_m=5.0, origin_east_m=6.0, origin_down_m=7.0
    )
    half = sqrt(0.5)
    turned = ned_attitude_from_hall(hall, half, 0.0, -half, 0.0)
    assert euler_from_quaternion(*turned) == pytest.approx((0.0, 0.0, pi / 2), abs=1e-12)
    nose_up = ned_attitude_from_hall(hall, cos(0.1), 0.0, 0.0, -sin(0.1))
    assert euler_from_quaternion(*nose_up) == pytest.approx((0.0, 0.2, 0.0), abs=1e-12)


@given(angles, pitches, angles, metres, metres, metres)
def test_a_vector_is_turned_by_a_quaternion_as_by_its_product(
    roll: float, pitch: float, yaw: float, x: float, y: float, z: float
) -> None:
    q = quaternion_from_euler(roll, pitch, yaw)
    back = (q[0], -q[1], -q[2], -q[3])
    product = quaternion_product(*quaternion_product(*q, 0.0, x, y, z), *back)
    turned = rotated(q, (x, y, z))
    assert turned == pytest.approx(product[1:], abs=1e-9)
    assert rotated(back, turned) == pytest.approx((x, y, z), abs=1e-9)
