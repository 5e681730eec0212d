"""The turbulence that a flight meets: none, some, and whether it rolls the aircraft."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from tgl_soar.air.gusts import DRYDEN_STILL, NO_ROLL_GUST, dryden_params, roll_gust_params
from tgl_soar.sim.flight_turbulence import CALM, flight_turbulence
from tgl_soar.sim.white_noise import RowsAsNeeded

WIND_MPS, SCALE_M, SPAN_M, DT_S = 8.5, 1.5, 1.1, 0.005


def test_without_an_intensity_it_is_calm() -> None:
    met = flight_turbulence(0.0, WIND_MPS, SCALE_M, SPAN_M, DT_S, 1)
    assert met is CALM
    assert not met.turbulence.blows
    assert (met.eddies, met.roll_gust_radps) == (DRYDEN_STILL, 0.0)
    assert met.turbulence.rolls == NO_ROLL_GUST
    # However calm, a field without a wind of its own may be flown in.
    assert flight_turbulence(0.0, 0.0, 0.0, None, DT_S, 1) is CALM


def test_it_blows_by_drydens_coefficients_and_rolls_over_the_span() -> None:
    met = flight_turbulence(0.03, WIND_MPS, SCALE_M, SPAN_M, DT_S, 1)
    assert met.turbulence.blows
    assert met.turbulence.params == dryden_params(0.03, WIND_MPS, SCALE_M, DT_S)
    assert met.turbulence.rolls == roll_gust_params(0.03, WIND_MPS, SCALE_M, SPAN_M, DT_S)
    assert met.roll_gust_radps != 0.0
    assert met.eddies != DRYDEN_STILL


def test_without_a_span_it_does_not_roll_and_blows_as_before() -> None:
    met = flight_turbulence(0.03, WIND_MPS, SCALE_M, None, DT_S, 1)
    rolling = flight_turbulence(0.03, WIND_MPS, SCALE_M, SPAN_M, DT_S, 1)
    assert met.turbulence.rolls == NO_ROLL_GUST
    assert met.roll_gust_radps == 0.0
    assert (met.eddies, met.turbulence.params) == (rolling.eddies, rolling.turbulence.params)


def test_it_is_drawn_by_its_seed() -> None:
    one, same, other = (
        flight_turbulence(0.03, WIND_MPS, SCALE_M, SPAN_M, DT_S, seed) for seed in (1, 1, 2)
    )
    assert (one.eddies, one.roll_gust_radps) == (same.eddies, same.roll_gust_radps)
    assert one.eddies != other.eddies
    assert one.roll_gust_radps != other.roll_gust_radps
    rows = [tuple(met.turbulence.white[0]) for met in (one, same, other)]
    assert rows[0] == rows[1] != rows[2]
    assert len(rows[0]) == 3
    assert one.turbulence.white[1] != one.turbulence.rolling[0]


def test_rows_are_taken_in_their_order_and_no_other() -> None:
    numbers = iter(np.arange(20.0).tolist())
    rows = RowsAsNeeded("the noise", numbers.__next__, 3)
    assert [tuple(rows[k]) for k in range(3)] == [(0, 1, 2), (3, 4, 5), (6, 7, 8)]
    for wrong in (2, 4):
        with pytest.raises(ValueError, match=f"noise was asked for sample {wrong + 1} where 4 is"):
            rows[wrong]
    assert list(islice(numbers, 1)) == [9.0]
