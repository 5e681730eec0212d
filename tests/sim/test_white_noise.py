"""White numbers: the same ones drawn when needed and beforehand."""

from __future__ import annotations

import random

import numpy as np
import pytest

from tgl_soar.air.gusts import dryden_params, roll_gust_params
from tgl_soar.sim import white_noise
from tgl_soar.sim.white_noise import (
    BLOCK,
    drawn_as_needed,
    drawn_before,
    roll_gusts_as_needed,
    roll_gusts_before,
    turbulence_as_needed,
    turbulence_before,
    white_gauss,
)

PARAMS = dryden_params(0.03, 9.0, 1.5, 0.005)


# So many bytes that their last word is full or has one, two or three of them.
@pytest.mark.parametrize("seed", ["7/position", "70/position", "700/position", "7/imu", "ü"])
def test_white_numbers_are_those_of_the_standard_library(seed: str) -> None:
    gauss = random.Random(seed).gauss
    expected = [gauss(0.0, 1.0) for _ in range(4001)]
    assert white_gauss(seed, 4001).tolist() == expected


def test_without_numba_they_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = white_gauss("7/position", 101).tolist()

    def missing(*_: object) -> None:
        raise ImportError("numba")

    monkeypatch.setattr(white_noise, "kept", missing)
    monkeypatch.setattr(white_noise, "_box_muller", white_noise._box_muller.__wrapped__)
    assert white_gauss("7/position", 101).tolist() == compiled


def test_a_sensors_numbers_are_the_same_drawn_before() -> None:
    steps, period = 40, 4
    once, rows = drawn_as_needed(7)("imu", period, 5, 6)
    once_before, rows_before = drawn_before(7, steps)("imu", period, 5, 6)
    assert len(once) == 5
    assert once_before == once
    for k in range(steps // period + 1):  # samples at steps 0, 4 … 40
        row = list(rows[k])
        assert len(row) == 6
        assert list(rows_before[k]) == row


def test_the_turbulences_numbers_are_the_same_drawn_before() -> None:
    steps = BLOCK + 100  # beyond what is drawn at once
    start, rows = turbulence_as_needed(PARAMS, 7)
    start_before, rows_before = turbulence_before(PARAMS, 7, steps)
    assert start_before == start
    for k in range(steps + 1):
        assert tuple(rows_before[k]) == rows[k]


def test_the_roll_gusts_numbers_are_the_same_drawn_before_and_their_own() -> None:
    params, steps = roll_gust_params(0.03, 9.0, 1.5, 1.1, 0.005), BLOCK + 100
    start, rows = roll_gusts_as_needed(params, 7)
    start_before, rows_before = roll_gusts_before(params, 7, steps)
    assert start_before == start
    first = [rows[k][0] for k in range(steps)]
    assert [rows_before[k][0] for k in range(steps)] == first
    turbulence = turbulence_before(PARAMS, 7, steps)[1]
    assert abs(np.corrcoef(first, [turbulence[k][0] for k in range(steps)])[0, 1]) < 0.1


def test_seeds_and_names_differ() -> None:
    draws = [drawn_as_needed(seed)(name, 1, 2, 3)[0] for seed in (7, 8) for name in ("imu", "fix")]
    assert len(set(draws)) == len(draws)
    assert turbulence_as_needed(PARAMS, 7)[0] != turbulence_as_needed(PARAMS, 8)[0]
    again = drawn_as_needed(7)("imu", 1, 2, 3)[0]
    assert again == draws[0]


def test_a_row_that_is_not_the_next_is_refused() -> None:
    _, rows = drawn_as_needed(7)("imu", 1, 0, 3)
    rows[0]
    with pytest.raises(ValueError, match="imu was asked for sample 3 where 2 is next"):
        rows[2]
