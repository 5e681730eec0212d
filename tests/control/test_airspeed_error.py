"""The airspeed's error, by turning."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import exp, inf, isfinite, nan, pi, sin, sqrt
from random import Random

import pytest
from samples import STILL

from tgl_soar.control.airspeed_error import (
    FADE_S,
    GUST_MPS,
    GUST_S,
    NO_AIRSPEED_ERROR,
    NOSE_S,
    SPREAD_MPS,
    AirspeedErrorState,
    airspeed_error,
    airspeed_error_step,
    error_sigma,
)

DT = 0.005
STRAIGHT = STILL._replace(x_m=-14.0, z_m=14.0, velocity_x_mps=-2.0, climb_mps=-1.4, pitch_rad=-0.02)


def weaving(time_s: float) -> float:
    """The nose: 26 degrees to either side, there and back in 8 s."""
    return 0.45 * max(-1.0, min(1.0, 2.0 * sin(2.0 * pi * time_s / 8.0)))


def straight(_: float) -> float:
    return 0.0


def gusts(random: Random, sigma_mps: float) -> Iterator[float]:
    """Across, of a first order of GUST_S."""
    now, keeps = random.gauss(0.0, sigma_mps), exp(-DT / GUST_S)
    while True:
        yield now
        now = keeps * now + random.gauss(0.0, sigma_mps * sqrt(1.0 - keeps * keeps))


def flown(
    seconds: float,
    true_mps: float,
    shown_mps: float,
    nose: Callable[[float], float] = weaving,
    *,
    across_mps: float = 0.0,
    gust_mps: float = 0.0,
    seed: int = 1,
    state: AirspeedErrorState = NO_AIRSPEED_ERROR,
) -> AirspeedErrorState:
    """An aircraft whose path follows its nose, tick by tick."""
    path, blows = sin(nose(0.0)), gusts(Random(seed), gust_mps)
    for k in range(round(seconds / DT)):
        psi = nose(k * DT)
        path += (1.0 - exp(-DT / NOSE_S)) * (sin(psi) - path)
        sideways = across_mps + next(blows) + true_mps * path
        vehicle = STRAIGHT._replace(time_s=k * DT, heading_rad=psi, velocity_y_mps=sideways)
        state = airspeed_error_step(state, vehicle, shown_mps, DT)
    return state


@pytest.mark.parametrize("across_mps", [0.0, -1.5])
@pytest.mark.parametrize(("true_mps", "shown_mps"), [(7.5, 9.3), (9.3, 9.3), (10.5, 9.3)])
def test_a_weave_tells_the_true_airspeed(
    true_mps: float, shown_mps: float, across_mps: float
) -> None:
    """Without gusts all that is missing is what the expected error of none weighs."""
    state = flown(16.0, true_mps, shown_mps, across_mps=across_mps)
    error, trusts = true_mps - shown_mps, 1.0 - (error_sigma(state) / SPREAD_MPS) ** 2
    assert trusts > 0.9
    assert airspeed_error(state) == pytest.approx(trusts * error, abs=0.02)


def test_in_gusts_the_error_is_no_larger_than_it_says() -> None:
    """200 draws of the kind that is expected.  Gusts of a first order hold 1 / (1 + (omega T)²) of
    what slow ones would at the weave's frequency, 0.82: so much are the scaled squares in the mean,
    ± 0.08."""
    random, squares, sigma = Random(5), [], inf
    for seed in range(200):
        error = random.gauss(0.0, SPREAD_MPS)
        state = flown(9.0, 9.0 + error, 9.0, gust_mps=GUST_MPS, seed=seed)
        sigma = error_sigma(state)
        squares.append(((airspeed_error(state) - error) / sigma) ** 2)
    assert 0.3 < sigma < 0.45
    expected = 1.0 / (1.0 + (2.0 * pi / 8.0 * GUST_S) ** 2)
    assert sum(squares) / len(squares) == pytest.approx(expected, abs=0.25)


def test_straight_flight_tells_nothing() -> None:
    """Nor does a wind from the side, nor does a turn the other way of a nose that is held there."""
    for nose in (straight, lambda _: 0.3):
        state = flown(20.0, 7.5, 9.3, nose, across_mps=2.0, gust_mps=GUST_MPS)
        assert airspeed_error(state) == pytest.approx(0.0, abs=1e-6)
        assert error_sigma(state) == pytest.approx(SPREAD_MPS)
    assert airspeed_error(NO_AIRSPEED_ERROR) == 0.0
    assert error_sigma(NO_AIRSPEED_ERROR) == pytest.approx(SPREAD_MPS)


def test_what_was_estimated_fades() -> None:
    woven = flown(16.0, 7.5, 9.3)
    later = flown(3.0, 7.5, 9.3, straight, state=woven)
    assert airspeed_error(later) == pytest.approx(airspeed_error(woven), abs=0.1)  # a final
    much_later = flown(5.0 * FADE_S, 7.5, 9.3, straight, state=later)
    assert abs(airspeed_error(much_later)) < 0.5
    assert error_sigma(woven) < error_sigma(later) < error_sigma(much_later) < SPREAD_MPS


@pytest.mark.parametrize("state", [NO_AIRSPEED_ERROR, flown(4.0, 7.5, 9.3)])
@pytest.mark.parametrize(
    ("heading_rad", "sideways_mps", "airspeed_mps", "dt_s"),
    [
        *((nan, 0.0, 9.0, DT), (0.1, nan, 9.0, DT), (0.1, 0.0, nan, DT), (0.1, inf, 9.0, DT)),
        *((0.1, 0.0, 9.0, nan), (0.1, 0.0, 9.0, 0.0), (0.1, 0.0, 9.0, -DT)),
    ],
)
def test_what_is_not_known_changes_nothing(
    state: AirspeedErrorState,
    heading_rad: float,
    sideways_mps: float,
    airspeed_mps: float,
    dt_s: float,
) -> None:
    vehicle = STRAIGHT._replace(heading_rad=heading_rad, velocity_y_mps=sideways_mps)
    assert repr(airspeed_error_step(state, vehicle, airspeed_mps, dt_s)) == repr(
        state
    )  # NaN is not NaN
    assert isfinite(airspeed_error(state) + error_sigma(state))


def test_it_does_not_matter_how_often_it_is_asked() -> None:
    """Half as many ticks count twice as much each."""
    state = NO_AIRSPEED_ERROR
    path = 0.0
    for k in range(1600):
        psi = weaving(k * 2.0 * DT)
        path += (1.0 - exp(-2.0 * DT / NOSE_S)) * (sin(psi) - path)
        vehicle = STRAIGHT._replace(heading_rad=psi, velocity_y_mps=7.5 * path)
        state = airspeed_error_step(state, vehicle, 9.3, 2.0 * DT)
    often = flown(16.0, 7.5, 9.3)
    assert airspeed_error(state) == pytest.approx(airspeed_error(often), abs=0.01)
    assert error_sigma(state) == pytest.approx(error_sigma(often), rel=0.01)
