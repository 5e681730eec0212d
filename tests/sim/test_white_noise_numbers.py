"""White numbers: their size, their order, slow errors from them, and the streams of a seed."""

from __future__ import annotations

import random
from math import cos, exp, log, pi, sin, sqrt

import numpy as np
import pytest

from tgl_soar.air.gusts import (
    dryden_params,
    dryden_start,
    roll_gust_params,
    roll_gust_start,
)
from tgl_soar.sim.white_noise import (
    BLOCK,
    drawn_as_needed,
    drawn_before,
    roll_gusts_as_needed,
    roll_gusts_before,
    turbulence_as_needed,
    turbulence_before,
    white_gauss,
    with_drift,
)


@pytest.mark.parametrize("count", [1, 2, 7, 4001])
def test_there_are_as_many_as_asked_for_in_the_order_of_the_standard_library(count: int) -> None:
    gauss = random.Random("9/imu").gauss
    found = white_gauss("9/imu", count)
    assert found.shape == (count,)
    assert found.tolist() == [gauss(0.0, 1.0) for _ in range(count)]


def test_they_are_made_in_pairs_of_a_direction_and_a_distance() -> None:
    uniform = random.Random("9/imu").random
    for k in range(3):
        angle, radius = 2.0 * pi * uniform(), sqrt(-2.0 * log(1.0 - uniform()))
        pair = white_gauss("9/imu", 6)[2 * k : 2 * k + 2]
        assert pair == pytest.approx((radius * cos(angle), radius * sin(angle)), abs=1e-14)


def test_a_plain_flights_numbers_are_of_unit_variance_and_uncorrelated() -> None:
    once, rows = drawn_as_needed(3)("imu", 1, 400, 2)
    drawn = np.array([rows[k] for k in range(4000)])
    # Of 4000 the mean is good to 0.016 and the variance to 0.022; four times that.
    assert drawn.mean(axis=0) == pytest.approx(0.0, abs=0.064)
    assert np.cov(drawn.T) == pytest.approx(np.eye(2), abs=0.09)
    assert np.mean(once) == pytest.approx(0.0, abs=0.2)
    assert np.std(once) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize(
    ("steps", "period", "rows"), [(0, 4, 1), (3, 4, 1), (4, 4, 2), (41, 4, 11)]
)
def test_as_many_rows_are_drawn_before_as_a_flight_takes(
    steps: int, period: int, rows: int
) -> None:
    once, drawn = drawn_before(7, steps)("imu", period, 5, 6)
    assert isinstance(drawn, np.ndarray)
    assert (len(once), drawn.shape) == (5, (rows, 6))
    # The seed's and the sensor's own, from its first number on.
    assert [*once, *np.ravel(drawn)] == pytest.approx(white_gauss("7/imu", 5 + 6 * rows).tolist())


# --- slow errors --------------------------------------------------------------------------------

ROWS = np.array([[0.5, -1.0, 2.0, 9.0], [1.5, 0.25, -0.5, 8.0], [-2.0, 1.0, 0.75, 7.0]])
STEPS = np.array([[3.0, 3.0, 3.0], [1.0, -0.5, 2.0], [0.5, 1.5, -1.0]])
START, SIZES, FRACTION = (1.0, -2.0, 0.5), (10.0, 20.0, 30.0), 0.25


def by_matrices() -> np.ndarray:
    """Each row's drift as the sum of what is left of the start and of every step since."""
    keeps = exp(-FRACTION)
    adds = sqrt(1.0 - keeps**2)
    drift = np.array(
        [
            [1.0, 0.0, 0.0],
            [keeps, adds, 0.0],
            [keeps**2, adds * keeps, adds],
        ]
    ) @ np.vstack([START, STEPS[1:]])
    expected: np.ndarray = ROWS.copy()
    expected[:, :3] += drift * SIZES
    return expected


def test_slow_errors_are_added_to_the_first_numbers_and_the_others_stay() -> None:
    found = with_drift(ROWS, STEPS, START, SIZES, FRACTION)
    assert isinstance(found, np.ndarray)
    assert found == pytest.approx(by_matrices())
    rows, steps = (table.tolist() for table in (ROWS, STEPS))
    one_by_one = with_drift(rows, steps, START, SIZES, FRACTION)
    assert np.array([one_by_one[k] for k in range(3)]) == pytest.approx(by_matrices())


def test_a_slow_error_keeps_its_variance_for_ever() -> None:
    random_numbers = np.random.default_rng(1)
    rows, steps = np.zeros((300, 100)), random_numbers.normal(size=(300, 100))
    start = random_numbers.normal(size=100)
    found = np.asarray(with_drift(rows, steps, start.tolist(), [1.0] * 100, 0.3))
    # A hundred at a time are good to 0.14 in variance; ten rows far apart to a third of that.
    for part in (found[:100:10], found[100:200:10], found[200::10]):
        assert part.var() == pytest.approx(1.0, abs=0.18)


# --- the air ------------------------------------------------------------------------------------

EDDIES = dryden_params(0.03, 9.0, 1.5, 0.005)
ROLL = roll_gust_params(0.03, 9.0, 1.5, 1.1, 0.005)


def test_turbulence_and_roll_gusts_have_streams_of_their_own_of_a_flights_seed() -> None:
    for seed in (0, 7):
        rng = np.random.default_rng([seed, 0])
        start = dryden_start(EDDIES, rng)
        expected = rng.standard_normal((3, 3))
        begun, rows = turbulence_as_needed(EDDIES, seed)
        assert begun == start
        assert np.array([rows[k] for k in range(3)]) == pytest.approx(expected)
        rng = np.random.default_rng([seed, 1])
        assert roll_gusts_as_needed(ROLL, seed)[0] == roll_gust_start(
            ROLL, float(rng.standard_normal())
        )
        _, gusts = roll_gusts_as_needed(ROLL, seed)
        assert [gusts[k] for k in range(3)] == [(n,) for n in rng.standard_normal(3).tolist()]


def test_as_many_numbers_of_the_air_are_drawn_before_as_a_flight_has_steps_and_one() -> None:
    for steps in (0, 5):
        eddies, gusts = turbulence_before(EDDIES, 7, steps)[1], roll_gusts_before(ROLL, 7, steps)[1]
        assert isinstance(eddies, np.ndarray)
        assert isinstance(gusts, np.ndarray)
        assert (eddies.shape, gusts.shape) == ((steps + 1, 3), (steps + 1, 1))


def test_what_is_drawn_at_once_is_not_drawn_again() -> None:
    _, rows = roll_gusts_as_needed(ROLL, 7)
    drawn = [rows[k][0] for k in range(2 * BLOCK + 2)]
    assert len(set(drawn)) == len(drawn)
    with pytest.raises(ValueError, match="the roll gust was asked for sample"):
        rows[0]
    _, eddies = turbulence_as_needed(EDDIES, 7)
    with pytest.raises(ValueError, match="the turbulence was asked for sample 4 where 1 is next"):
        eddies[3]
