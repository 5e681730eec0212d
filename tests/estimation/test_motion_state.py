"""What the estimator of motion has for any time: errors and uncertainty on each side of a change.

From `switched_s` on accelerations count, or no longer do.  Before it errors grow by one model,
after it by the other: matrices of both, one after the other, say the same.
"""

from __future__ import annotations

from itertools import product
from math import isnan, nan

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm
from test_position_fixes import known, off, take

from tgl_soar.estimation.fix_filter import Covariance, Errors, Moments
from tgl_soar.estimation.motion_state import (
    NO_OFFSET,
    NO_OUTLIERS,
    NO_RECKONING,
    NO_SHIFT,
    LastImu,
    MotionGains,
    MotionState,
    Reckoning,
    covariance_at,
    errors_when_switched,
    initial_motion,
    is_later,
    track_errors_at,
)
from tgl_soar.types import NO_ATTITUDE

Matrix = NDArray[np.float64]
FIX_S = 10.0
IMU_S = 0.004  # between two accelerations
GAINS = MotionGains(
    fix_sd_m=0.01,
    velocity_sd_mps=0.05,
    force_sd_mps2=0.7,
    bias_sd_mps2=4.0,
    unknown_sd_mps2=3.0,
    fix_delay_s=0.0,
    fix_gate_m=0.5,
    reset_max_m=10.0,
    use_imu=True,
)
STATES = np.array([[0.3, -1.2, 0.4], [2.0, 0.7, -0.6], [-0.5, 0.15, 0.25]])  # by axis: p, v, b
ROOT = np.array([[0.3, 0.0, 0.0], [0.4, 0.9, 0.0], [-0.2, 0.5, 0.7]])
BEFORE: Matrix = ROOT @ ROOT.T
# When accelerations began or ended to count, and for when something is asked.
CASES = [
    (nan, 10.6),  # never
    (9.5, 10.6),  # before the last fix
    (10.4, 10.2),  # after it, and asked for before
    (10.4, 10.4),
    (10.4, 10.9),  # on both sides
]
EACH = [(inertial, *case) for inertial, case in product((True, False), CASES)]


def moments(matrix: Matrix) -> Covariance:
    (pp, pv, pb), (_, vv, vb), (_, _, bb) = matrix.tolist()
    return Covariance(pp=pp, pv=pv, pb=pb, vv=vv, vb=vb, bb=bb)


def matrix_of(covariance: Moments) -> Matrix:
    pp, pv, pb, vv, vb, bb = covariance
    return np.array([[pp, pv, pb], [pv, vv, vb], [pb, vb, bb]])


def state(inertial: bool, switched_s: float, interval_s: float = IMU_S) -> MotionState:
    (x, vx, bx), (y, vy, by), (z, vz, bz) = STATES.tolist()
    errors = Errors(
        time_s=FIX_S,
        x_m=x,
        y_m=y,
        z_m=z,
        velocity_x_mps=vx,
        velocity_y_mps=vy,
        climb_mps=vz,
        bias_x_mps2=bx,
        bias_y_mps2=by,
        bias_z_mps2=bz,
        covariance=moments(BEFORE),
    )
    return initial_motion()._replace(
        errors=errors,
        inertial=inertial,
        switched_s=switched_s,
        imu=LastImu(7, 9.9, 9.0, interval_s),
    )


def stretches(inertial: bool, switched_s: float, time_s: float) -> list[tuple[bool, float]]:
    """(with accelerations, for how long) from the last fix on."""
    if not switched_s > FIX_S:  # true for NaN
        return [(inertial, time_s - FIX_S)]
    if time_s <= switched_s:
        return [(not inertial, time_s - FIX_S)]
    return [(not inertial, switched_s - FIX_S), (inertial, time_s - switched_s)]


def model(coupling: float) -> Matrix:
    return np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -coupling], [0.0, 0.0, 0.0]])


def noise(inertial: bool, interval_s: float = IMU_S) -> Matrix:
    """Densities.  Of accelerations: a sample's error, for as long as it stands, and a bias that is
    another one in 300 s.  Without: what lasts a tenth of a second, to both sides of now."""
    if inertial:
        return np.diag([0.0, 0.7**2 * interval_s, 4.0**2 / 300.0])
    return np.diag([0.0, 2.0 * 3.0**2 * 0.1, 0.0])


def grown(before: Matrix, inertial: bool, t_s: float, interval_s: float = IMU_S) -> Matrix:
    """By Van Loan."""
    a = model(float(inertial))
    block = expm(np.block([[-a, noise(inertial, interval_s)], [np.zeros((3, 3)), a.T]]) * t_s)
    forward: Matrix = block[3:, 3:].T
    return forward @ before @ forward.T + forward @ block[:3, 3:]


@pytest.mark.parametrize(("inertial", "switched_s", "time_s"), EACH)
def test_errors_grow_by_the_model_of_each_stretch(
    inertial: bool, switched_s: float, time_s: float
) -> None:
    expected = STATES.T
    for with_imu, t_s in stretches(inertial, switched_s, time_s):
        expected = expm(model(float(with_imu)) * t_s) @ expected
    found = track_errors_at(state(inertial, switched_s), time_s)
    np.testing.assert_allclose(found, [*expected[0], *expected[1]], rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(("inertial", "switched_s", "time_s"), EACH)
def test_uncertainty_grows_by_the_model_of_each_stretch(
    inertial: bool, switched_s: float, time_s: float
) -> None:
    expected = BEFORE
    for with_imu, t_s in stretches(inertial, switched_s, time_s):
        expected = grown(expected, with_imu, t_s)
    found = covariance_at(GAINS, state(inertial, switched_s), time_s)
    np.testing.assert_allclose(matrix_of(found), expected, rtol=1e-9)


@pytest.mark.parametrize("inertial", [True, False])
def test_when_switched_errors_have_gone_on_by_the_model_before(inertial: bool) -> None:
    before, at_s = state(inertial, 10.4), 10.4
    found = errors_when_switched(before, moments(2.0 * BEFORE))
    expected = expm(model(float(not inertial)) * 0.4) @ STATES.T
    assert found.time_s == at_s
    np.testing.assert_allclose(found[1:7], [*expected[0], *expected[1]], rtol=1e-12, atol=1e-15)
    assert found[7:10] == before.errors[7:10]
    assert found.covariance == moments(2.0 * BEFORE)


@pytest.mark.parametrize(
    ("interval_s", "counted_s"), [(0.0, 0.001), (0.0009, 0.001), (0.003, 0.003)]
)
def test_accelerations_count_as_no_nearer_together_than_a_millisecond(
    interval_s: float, counted_s: float
) -> None:
    """No autopilot sends a thousand of them a second: an average that says so is of a burst."""
    found = covariance_at(GAINS, state(True, nan, interval_s), 10.6)
    expected = grown(BEFORE, True, 0.6, counted_s)
    np.testing.assert_allclose(matrix_of(found), expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("time_s", "last_s", "later"),
    [
        (10.0, 9.9, True),
        (9.9, 9.9, False),
        (9.8, 9.9, False),
        (10.0, nan, True),  # the first
        (10.04, 9.9, True),  # clocks are mapped to some hundredths of a second
        (10.06, 9.9, False),
        (10.06, nan, False),
        (9.8, 10.04, False),
        (9.8, 10.06, True),  # the clock has gone back: what is known is of the future
        (10.06, 12.0, False),
        (nan, 9.9, False),
    ],
)
def test_a_sample_is_later_than_the_last_and_not_of_the_future(
    time_s: float, last_s: float, later: bool
) -> None:
    assert is_later(time_s, last_s, 10.0) == later


def test_before_anything_has_come_nothing_is_known_and_nothing_is_off() -> None:
    begun = initial_motion()
    assert all(isnan(number) for number in begun.errors[:7])
    assert begun.errors[7:10] == (0.0, 0.0, 0.0)  # a bias of nothing until it is known
    assert all(isnan(number) for number in begun.errors.covariance)
    assert all(isnan(number) for number in begun.innovation)
    for time_s in (
        *(begun.switched_s, begun.jump_s, begun.attitude_track.time_s),
        *(begun.imu.time_s, begun.imu.since_s, begun.fix.time_s, begun.attitude.time_s),
    ):
        assert isnan(time_s)
    counted = (
        *(begun.imu.sequence, begun.fix.sequence, begun.fix.source, begun.fix.repeated),
        *(begun.attitude.sequence, begun.attitude.refused_in_a_row, begun.rejected),
    )
    assert counted == (0,) * len(counted)
    assert not begun.inertial
    assert (begun.attitude.used, begun.attitude.refused) == (NO_ATTITUDE, NO_ATTITUDE)
    assert begun.offset == NO_OFFSET == (0.0, 0.0, 0.0)
    assert begun.shift == NO_SHIFT == (0.0, 0.0, 0.0)
    assert begun.outliers == NO_OUTLIERS
    assert (NO_OUTLIERS.in_a_row, NO_OUTLIERS.gap) == (0, False)
    assert all(isnan(number) for number in (NO_OUTLIERS.time_s, *NO_OUTLIERS[3:]))
    assert begun.reckoning == NO_RECKONING
    assert isnan(NO_RECKONING.since_s)
    assert isnan(NO_RECKONING.last_s)
    assert not NO_RECKONING.now


def test_accelerations_are_taken_to_come_with_every_tick_until_it_is_known() -> None:
    """200 Hz, as the loop."""
    assert initial_motion().imu.interval_s == 1.0 / 200.0


def test_the_fifth_fix_in_a_row_that_is_off_by_the_same_is_accepted() -> None:
    """Four are refused: 80 ms at 50 Hz, in which an aircraft moves by less than a metre."""
    state = known()
    for k in range(1, 6):
        before = state
        state = take(state, off(state, 1.0 + 0.02 * k, (2.0, 0.0, 0.0)))
        assert (state.rejected > before.rejected) == (k < 5)
    assert state.outliers == NO_OUTLIERS


@pytest.mark.parametrize(("since_s", "one"), [(1.9, True), (2.1, False)])
def test_reckonings_within_two_seconds_of_each_other_are_one(since_s: float, one: bool) -> None:
    """An estimator says how it stands once a second at the slowest: two may be missed."""
    reckons = known(reckoning=Reckoning(-5.0, 1.1 - since_s, True))
    after = take(reckons, off(reckons, 1.1, (0.0, 0.0, 0.0), reckoned=True)).reckoning
    assert after.since_s == (-5.0 if one else 1.1)
