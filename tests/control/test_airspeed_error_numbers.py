"""What turns show of the airspeed, in numbers: a step by hand, and the sums by weighted least
squares."""

from __future__ import annotations

from math import exp, sin, sqrt
from random import Random

import numpy as np
import pytest
from samples import STILL

from tgl_soar.control.airspeed_error import (
    NO_AIRSPEED_ERROR,
    AirspeedErrorState,
    airspeed_error,
    airspeed_error_step,
    airspeed_sigma,
    corrected_air,
    error_sigma,
    error_variance,
)
from tgl_soar.types import NO_AIR

DT = 0.1
COUNTS = DT / (2.0 * 0.6 * 0.3**2)  # of gusts of 0.3 m/s that last 0.6 s


def step(
    state: AirspeedErrorState, heading_rad: float, sideways_mps: float, airspeed_mps: float = 9.0
) -> AirspeedErrorState:
    vehicle = STILL._replace(heading_rad=heading_rad, velocity_y_mps=sideways_mps)
    return airspeed_error_step(state, vehicle, airspeed_mps, DT)


def test_a_step_follows_the_nose_in_six_tenths_and_forgets_in_ten_seconds() -> None:
    first = step(NO_AIRSPEED_ERROR, 0.4, 3.0)
    nose, unlike = sin(0.4), 3.0 - 9.0 * sin(0.4)
    assert first == pytest.approx((
        nose, 9.0 * nose, COUNTS, COUNTS * nose, COUNTS * nose**2, COUNTS * unlike,
        COUNTS * nose * unlike,
    ))  # fmt: skip
    second = step(first, -0.2, 1.0, 8.0)
    follows, keeps = 1.0 - exp(-DT / 0.6), exp(-DT / 10.0)
    after = nose + follows * (sin(-0.2) - nose)
    sideways = 9.0 * nose + follows * (8.0 * sin(-0.2) - 9.0 * nose)
    unlike = 1.0 - sideways
    assert second.nose == pytest.approx(after)
    assert second.sideways_mps == pytest.approx(sideways)
    news = (1.0, after, after**2, unlike, after * unlike)
    for was, now, new in zip(first[2:], second[2:], news, strict=True):
        assert now == pytest.approx(keeps * was + COUNTS * new)


def test_the_error_is_the_slope_of_what_is_left_over_the_nose() -> None:
    """Least squares with a mean of its own, and an error of 1.5 m/s expected beforehand."""
    random, state = Random(3), NO_AIRSPEED_ERROR
    rows: list[tuple[float, float, float]] = []
    for _ in range(60):
        before = state
        state = step(state, random.uniform(-0.6, 0.6), random.uniform(-2.0, 2.0), 1.5)
        rows = [(w * exp(-DT / 10.0), n, u) for w, n, u in rows]
        kept = exp(-DT / 10.0)
        unlike = (state.by_speed - kept * before.by_speed) / COUNTS
        rows.append((COUNTS, state.nose, unlike))
    weights, noses, unlikes = (np.array(column) for column in zip(*rows, strict=True))
    apart = noses - np.average(noses, weights=weights)
    information = float(weights @ apart**2)
    expected = float(weights @ (apart * unlikes)) / (information + 1.0 / 1.5**2)
    assert abs(expected) < 2.9
    assert airspeed_error(state) == pytest.approx(expected)
    assert error_variance(state) == pytest.approx(1.0 / (information + 1.0 / 1.5**2))
    assert error_sigma(state) == pytest.approx(sqrt(error_variance(state)))


def telling(error_mps: float, sigma_mps: float) -> AirspeedErrorState:
    information = 1.0 / sigma_mps**2 - 1.0 / 1.5**2
    return AirspeedErrorState(
        nose=0.0, sideways_mps=0.0, weight=1.0, by_nose=0.0, by_nose2=information, by_speed=0.0,
        by_both=error_mps / sigma_mps**2,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("error_mps", "found"), [(2.9, 2.9), (3.1, 3.0), (-2.9, -2.9), (-9.0, -3.0)]
)
def test_an_error_is_no_more_than_three_metres_a_second(error_mps: float, found: float) -> None:
    assert airspeed_error(telling(error_mps, 0.5)) == pytest.approx(found)


@pytest.mark.parametrize(("sideways_mps", "counts"), [(29.9, True), (30.1, False), (-29.9, True),
                                                      (-30.1, False)])  # fmt: skip
def test_what_is_thirty_metres_a_second_apart_is_no_wind(sideways_mps: float, counts: bool) -> None:
    state = step(NO_AIRSPEED_ERROR, 0.0, sideways_mps)
    assert (state != NO_AIRSPEED_ERROR and state.weight > 0.0) is counts


def test_an_airspeed_is_made_slower_alone_and_its_wind_with_it() -> None:
    air = NO_AIR._replace(airspeed_mps=9.0, wind_mps=7.0, measured=False)
    slower = corrected_air(telling(-1.2, 0.5), air)
    assert (slower.airspeed_mps, slower.wind_mps) == pytest.approx((7.8, 5.8))
    assert corrected_air(telling(1.2, 0.5), air)[:2] == air[:2]
    measured = air._replace(measured=True)
    assert corrected_air(telling(-1.2, 0.5), measured) is measured
    assert airspeed_sigma(telling(-1.2, 0.5), measured) == 0.0
    assert airspeed_sigma(telling(-1.2, 0.5), air) == pytest.approx(0.5)
