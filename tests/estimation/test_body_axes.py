"""The body's axes and its motion along them, against rotation matrices of scipy.

Upwind NED has north straight upwind: of a velocity in the soaring frame (x downstream, y to the
right, z up) it is (-x, y, -z).
"""

from __future__ import annotations

from itertools import product
from math import inf, isnan, nan

import numpy as np
import pytest
from numpy.typing import NDArray
from samples import STILL
from scipy.spatial.transform import Rotation

from tgl_soar.estimation.body_axes import body_axes, body_motion, through_air
from tgl_soar.types import VehicleState

Vector = NDArray[np.float64]
ATTITUDES = list(product((-0.7, 0.5), (-0.3, 0.4), (-1.1, 0.6)))  # roll, pitch, heading
VELOCITY = (1.3, -0.8, 0.45)  # soaring frame
RATES = (0.9, -0.6, 0.35)  # of the angles
WIND_MPS, UPDRAFT_MPS = 8.6, 1.2


def vehicle(
    angles: tuple[float, float, float], rates: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> VehicleState:
    (roll, pitch, heading), (x, y, climb) = angles, VELOCITY
    return STILL._replace(
        velocity_x_mps=x,
        velocity_y_mps=y,
        climb_mps=climb,
        roll_rad=roll,
        pitch_rad=pitch,
        heading_rad=heading,
        roll_rate_radps=rates[0],
        pitch_rate_radps=rates[1],
        heading_rate_radps=rates[2],
    )


def rotation(roll: float, pitch: float, heading: float) -> Vector:
    """From FRD to upwind NED."""
    return np.asarray(Rotation.from_euler("ZYX", [heading, pitch, roll]).as_matrix())


def upwind_ned(x: float, y: float, up: float) -> Vector:
    return np.array([-x, y, -up])


@pytest.mark.parametrize("angles", ATTITUDES)
def test_the_axes_are_columns_of_the_rotation(angles: tuple[float, float, float]) -> None:
    axes = body_axes(vehicle(angles))
    matrix = rotation(*angles)
    np.testing.assert_allclose([axes.x_n, axes.x_e, axes.x_d], matrix[:, 0], atol=1e-12)
    np.testing.assert_allclose([axes.z_n, axes.z_e, axes.z_d], matrix[:, 2], atol=1e-12)
    assert (axes.velocity_x_mps, axes.velocity_y_mps, axes.climb_mps) == VELOCITY


@pytest.mark.parametrize("unknown", [nan, inf, -inf])
@pytest.mark.parametrize("at", [0, 1, 2])
def test_an_attitude_that_is_not_known_has_no_axes(at: int, unknown: float) -> None:
    angles = [0.1, 0.2, 0.3]
    angles[at] = unknown
    axes = body_axes(vehicle((angles[0], angles[1], angles[2])))
    assert all(isnan(number) for number in axes)
    assert all(isnan(number) for number in through_air(axes, WIND_MPS, UPDRAFT_MPS))


@pytest.mark.parametrize("angles", ATTITUDES)
def test_through_the_air_it_moves_by_its_velocity_less_the_air_s(
    angles: tuple[float, float, float],
) -> None:
    x, y, climb = VELOCITY
    relative = rotation(*angles).T @ upwind_ned(x - WIND_MPS, y, climb - UPDRAFT_MPS)
    found = through_air(body_axes(vehicle(angles)), WIND_MPS, UPDRAFT_MPS)
    np.testing.assert_allclose(found, relative[[0, 2]], atol=1e-12)


def test_who_stands_in_the_wind_feels_it_on_the_nose() -> None:
    forward, down = through_air(body_axes(STILL), WIND_MPS, UPDRAFT_MPS)
    assert (forward, down) == (WIND_MPS, UPDRAFT_MPS)  # an updraft comes from below


@pytest.mark.parametrize("angles", ATTITUDES)
def test_its_motion_is_that_over_the_ground_and_what_turning_adds(
    angles: tuple[float, float, float],
) -> None:
    """The body rates by Rᵀ dR/dt, of two rotations a moment apart."""
    moment_s = 1e-6
    earlier, later = (
        rotation(*(a + sign * moment_s * rate for a, rate in zip(angles, RATES, strict=True)))
        for sign in (-0.5, 0.5)
    )
    matrix = rotation(*angles)
    turning = matrix.T @ (later - earlier) / moment_s
    omega = np.array([turning[2, 1], turning[0, 2], turning[1, 0]])
    along = matrix.T @ upwind_ned(*VELOCITY)
    carried = np.cross(omega, along)
    of = vehicle(angles, RATES)
    found = body_motion(body_axes(of), of)
    np.testing.assert_allclose((found.forward_mps, found.down_mps), along[[0, 2]], atol=1e-12)
    np.testing.assert_allclose(
        (found.turning_x_mps2, found.turning_z_mps2), carried[[0, 2]], atol=1e-8
    )


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_each_rate_alone_turns_the_velocity(axis: int) -> None:
    """From level flight upwind at 10 m/s, all is plain: r of 1 rad/s is a side acceleration."""
    of = STILL._replace(velocity_x_mps=-10.0, climb_mps=-1.0, velocity_y_mps=2.0)
    p, q, r = (1.0 if axis == i else 0.0 for i in range(3))
    turns = of._replace(roll_rate_radps=p, pitch_rate_radps=q, heading_rate_radps=r)
    found = body_motion(body_axes(turns), turns)
    carried = np.cross([p, q, r], [10.0, 2.0, 1.0])
    assert (found.forward_mps, found.down_mps) == (10.0, 1.0)
    assert (found.turning_x_mps2, found.turning_z_mps2) == pytest.approx(tuple(carried[[0, 2]]))


@pytest.mark.parametrize("unknown", [nan, inf])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rates_that_are_not_known_are_taken_for_none(axis: int, unknown: float) -> None:
    rates = [0.9, -0.6, 0.35]
    rates[axis] = unknown
    of = vehicle(ATTITUDES[0], (rates[0], rates[1], rates[2]))
    found = body_motion(body_axes(of), of)
    assert (found.turning_x_mps2, found.turning_z_mps2) == (0.0, 0.0)
    still = vehicle(ATTITUDES[0])
    expected = body_motion(body_axes(still), still)
    assert (found.forward_mps, found.down_mps) == (expected.forward_mps, expected.down_mps)


def test_without_axes_nothing_of_its_motion_is_known_but_that_it_does_not_turn() -> None:
    of = STILL._replace(heading_rad=nan, pitch_rate_radps=1.0)
    found = body_motion(body_axes(of), of)
    assert isnan(found.forward_mps)
    assert isnan(found.down_mps)
    assert (found.turning_x_mps2, found.turning_z_mps2) == (0.0, 0.0)
