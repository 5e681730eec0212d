"""The filter of the track's errors against matrices: integrated noise, and Kalman's update.

The covariance is carried on here by Van Loan's matrix exponential of the continuous model, and the
update is Joseph's, so that neither the closed forms nor the algebra of the module are used.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from tgl_soar.estimation.fix_filter import (
    Covariance,
    Errors,
    Moments,
    errors_at,
    errors_carried,
    position_taken,
    spread,
    velocity_taken,
)

Matrix = NDArray[np.float64]
# Position, velocity and bias that vary and hang together in any way.
ROOT = np.array([[0.3, 0.0, 0.0], [0.4, 0.9, 0.0], [-0.2, 0.5, 0.7]])
FULL: Matrix = ROOT @ ROOT.T
DENSITY, BIAS_DENSITY = 0.6, 0.09
TIMES_S = (0.005, 0.4, 2.0)


def moments(matrix: Matrix) -> Covariance:
    (pp, pv, pb), (_, vv, vb), (_, _, bb) = matrix.tolist()
    return Covariance(pp=pp, pv=pv, pb=pb, vv=vv, vb=vb, bb=bb)


def matrix_of(covariance: Moments) -> Matrix:
    pp, pv, pb, vv, vb, bb = covariance
    return np.array([[pp, pv, pb], [pv, vv, vb], [pb, vb, bb]])


def model(coupling: float) -> Matrix:
    """d(p)' = d(v), d(v)' = -b: a bias acts where accelerations are measured."""
    return np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -coupling], [0.0, 0.0, 0.0]])


def carried_on(
    before: Matrix, t_s: float, coupling: float, density: float, bias_density: float
) -> Matrix:
    """P after a time, by Van Loan."""
    a, noise = model(coupling), np.diag([0.0, density, coupling * bias_density])
    block = np.block([[-a, noise], [np.zeros((3, 3)), a.T]]) * t_s
    e = expm(block)
    forward: Matrix = e[3:, 3:].T
    return forward @ before @ forward.T + forward @ e[:3, 3:]


STATES = np.array([[0.3, -1.2, 0.4], [2.0, 0.7, -0.6], [-0.5, 0.1, 0.25]])  # by axis: p, v, b


def errors(covariance: Matrix = FULL, states: Matrix = STATES) -> Errors:
    (x, vx, bx), (y, vy, by), (z, vz, bz) = states.tolist()
    return Errors(
        time_s=10.0,
        x_m=x,
        y_m=y,
        z_m=z,
        velocity_x_mps=vx,
        velocity_y_mps=vy,
        climb_mps=vz,
        bias_x_mps2=bx,
        bias_y_mps2=by,
        bias_z_mps2=bz,
        covariance=moments(covariance),
    )


def states_of(found: Errors) -> Matrix:
    return np.array(
        [
            [found.x_m, found.velocity_x_mps, found.bias_x_mps2],
            [found.y_m, found.velocity_y_mps, found.bias_y_mps2],
            [found.z_m, found.climb_mps, found.bias_z_mps2],
        ]
    )


@pytest.mark.parametrize(("t_s", "coupling"), list(product(TIMES_S, (0.0, 1.0))))
def test_the_covariance_grows_as_the_continuous_model_does(t_s: float, coupling: float) -> None:
    found = spread(moments(FULL), t_s, coupling, DENSITY, BIAS_DENSITY)
    expected = carried_on(FULL, t_s, coupling, DENSITY, BIAS_DENSITY)
    np.testing.assert_allclose(matrix_of(found), expected, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("t_s", TIMES_S)
def test_what_is_certain_grows_by_each_noise_alone(t_s: float) -> None:
    """Where nothing else hides it; the bias's is as small as T⁵ in position."""
    nothing = np.zeros((3, 3))
    for density, bias_density in ((DENSITY, 0.0), (0.0, BIAS_DENSITY)):
        found = spread(moments(nothing), t_s, 1.0, density, bias_density)
        expected = carried_on(nothing, t_s, 1.0, density, bias_density)
        np.testing.assert_allclose(matrix_of(found), expected, rtol=1e-9, atol=1e-30)


@pytest.mark.parametrize("pair", list(product(range(3), repeat=2)))
def test_each_moment_spreads_into_the_others_as_the_model_has_it(pair: tuple[int, int]) -> None:
    """One at a time, with no noise: the columns of F P Fᵀ."""
    one = np.zeros((3, 3))
    one[pair] = one[pair[::-1]] = 1.0
    found = spread(moments(one), 0.7, 1.0, 0.0, 0.0)
    forward = expm(model(1.0) * 0.7)
    np.testing.assert_allclose(matrix_of(found), forward @ one @ forward.T, atol=1e-14)


def test_a_covariance_may_be_carried_on_in_steps_or_at_once() -> None:
    in_steps: Moments = moments(FULL)
    for _ in range(8):
        in_steps = spread(in_steps, 0.05, 1.0, DENSITY, BIAS_DENSITY)
    at_once = spread(moments(FULL), 0.4, 1.0, DENSITY, BIAS_DENSITY)
    assert in_steps == pytest.approx(at_once, rel=1e-12)


@pytest.mark.parametrize(("t_s", "coupling"), list(product((-0.3, 0.0, 1.7), (0.0, 1.0))))
def test_errors_go_on_by_their_velocity_and_what_the_bias_makes_of_it(
    t_s: float, coupling: float
) -> None:
    forward = expm(model(coupling) * t_s)
    expected = (forward @ STATES.T).T
    x, y, z, vx, vy, vz = errors_at(errors(), 10.0 + t_s, coupling)
    np.testing.assert_allclose([x, y, z], expected[:, 0], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose([vx, vy, vz], expected[:, 1], rtol=1e-12, atol=1e-14)


def test_errors_that_are_carried_on_keep_their_biases() -> None:
    place = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    other = moments(2.0 * FULL)
    found = errors_carried(errors(), 12.5, place, other)
    assert found.time_s == 12.5
    expected = np.array([[1.0, 4.0, 0.4], [2.0, 5.0, -0.6], [3.0, 6.0, 0.25]])
    np.testing.assert_array_equal(states_of(found), expected)
    assert found.covariance == other


RX, RY, RZ = RESIDUALS = (0.6, -0.35, 1.1)


def updated(measured: int, variance: float) -> tuple[Matrix, Matrix]:
    """States by axis and covariance after one of the states was measured, by Joseph's form."""
    h = np.zeros(3)
    h[measured] = 1.0
    gain = FULL @ h / (h @ FULL @ h + variance)
    left = np.eye(3) - np.outer(gain, h)
    after = left @ FULL @ left.T + variance * np.outer(gain, gain)
    return STATES + np.outer(RESIDUALS, gain), after


@pytest.mark.parametrize("variance", [1e-4, 0.05, 3.0])
def test_a_position_is_taken_as_kalman_does(variance: float) -> None:
    states, covariance = updated(0, variance)
    found = position_taken(errors(), RX, RY, RZ, variance)
    np.testing.assert_allclose(states_of(found), states, rtol=1e-12)
    np.testing.assert_allclose(matrix_of(found.covariance), covariance, rtol=1e-9, atol=1e-14)
    assert found.time_s == 10.0


@pytest.mark.parametrize("variance", [1e-4, 0.05, 3.0])
def test_a_velocity_is_taken_as_kalman_does(variance: float) -> None:
    states, covariance = updated(1, variance)
    found = velocity_taken(errors(), RX, RY, RZ, variance)
    np.testing.assert_allclose(states_of(found), states, rtol=1e-12)
    np.testing.assert_allclose(matrix_of(found.covariance), covariance, rtol=1e-9, atol=1e-14)
    assert found.time_s == 10.0


def test_what_is_measured_exactly_is_known_to_the_measurement_s_own_digits() -> None:
    """1 - g would be a difference of nearly equal numbers: nothing or less than nothing is left."""
    variance = 1e-14
    position = position_taken(errors(), RX, RY, RZ, variance).covariance.pp
    velocity = velocity_taken(errors(), RX, RY, RZ, variance).covariance.vv
    assert (position, velocity) == pytest.approx((variance, variance), rel=1e-9)
