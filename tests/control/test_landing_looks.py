"""The way home with an airspeed that is not measured, in numbers: when it looks and how far, from
where it flies narrow, when it turns at all, and how steep."""

from __future__ import annotations

from math import nan, radians
from typing import Any

import pytest
from test_airspeed_error_numbers import telling
from test_landing import DT, PARAMS, PLACE, air, at

from tgl_soar.control.airspeed_hold import NO_GLIDE, GlidePitches, GlideState
from tgl_soar.control.landing import glide_setpoints, glide_step, steeper_bank

REST_M = 4.5  # the straight rest begins so high
BEST_MPS = PARAMS.best_glide_mps
PITCHES = GlidePitches(wanted_rad=-0.05, slowest_rad=-0.03, fastest_rad=-0.15, most_alpha_rad=nan)


def gliding(sigma_mps: float = 1.4, **changed: Any) -> GlideState:
    usual: dict[str, Any] = {"speed_mps": BEST_MPS, "airspeed_error": telling(0.0, sigma_mps)}
    return NO_GLIDE._replace(**{**usual, **changed})


def step(
    state: GlideState,
    over_m: float,
    *,
    airspeed_mps: float = BEST_MPS,
    outward: bool = False,
    wind_mps: float = 7.0,
    x_m: float = -10.0,
    y_m: float = 0.0,
) -> GlideState:
    """So high over the beginning of the straight rest; no time passes for its turns' sums."""
    feels = air(airspeed_mps=airspeed_mps, wind_mps=wind_mps, measured=False)
    vehicle = at(5.0, x_m=x_m, y_m=y_m, z_m=PLACE.z_m + REST_M + over_m)
    return glide_step(PARAMS, state, outward, True, vehicle, feels, 99.0, False, DT)[0]


def looked(over_m: float, sigma_mps: float = 1.4, **given: Any) -> float:
    """How far its nose goes in 2 s, with what it knew at first."""
    state, most = gliding(sigma_mps), 0.0
    known = state.airspeed_error
    for _ in range(400):
        state = step(state._replace(airspeed_error=known), over_m, **given)
        most = max(most, abs(state.weave_rad))
    return most


# Too far away for a weave: all of the height is needed.
FAR: dict[str, Any] = {"x_m": 30.0}


@pytest.mark.parametrize(("over_m", "looks"), [(2.1, True), (1.9, False)])
def test_it_looks_down_to_two_metres_over_the_straight_rest(over_m: float, looks: bool) -> None:
    assert looked(over_m, **FAR) == pytest.approx(0.45 if looks else 0.0)


@pytest.mark.parametrize(("sigma_mps", "looks"), [(0.51, True), (0.49, False)])
def test_it_looks_as_long_as_its_airspeed_is_known_within_more_than_half_a_metre_a_second(
    sigma_mps: float, looks: bool
) -> None:
    assert looked(8.0, sigma_mps, **FAR) == pytest.approx(0.45 if looks else 0.0)


@pytest.mark.parametrize(("slower_mps", "turns"), [(1.1, True), (1.3, False)])
def test_slower_by_more_than_twelve_tenths_it_does_not_turn(slower_mps: float, turns: bool) -> None:
    state = step(gliding(), 8.0, airspeed_mps=BEST_MPS - slower_mps, **FAR)
    assert (state.weave_rad != 0.0) is turns


@pytest.mark.parametrize(("over_m", "high"), [(12.1, True), (11.9, False)])
def test_what_has_come_from_more_than_twelve_metres_is_remembered(
    over_m: float, high: bool
) -> None:
    state = step(gliding(), over_m)
    assert state.from_high is high
    assert step(state, 3.0).from_high is high


def test_on_its_way_out_it_flies_two_metres_a_second_faster_than_the_wind() -> None:
    fast = step(gliding(speed_mps=11.0), 40.0, outward=True, wind_mps=9.5)
    assert fast.speed_mps == pytest.approx(11.0 + 1.5 * DT)
    for wind_mps, wanted in ((8.0, 10.0), (9.0, 11.0)):
        state = gliding(speed_mps=wanted)
        flown = step(state, 40.0, outward=True, wind_mps=wind_mps)
        assert flown.speed_mps == pytest.approx(wanted)


# --- how steep ----------------------------------------------------------------------------------


def steeper(over_m: float, sigma_mps: float = 0.9, **changed: Any) -> float:
    state = gliding(sigma_mps, weave_rad=0.3, **changed)
    feels = air(airspeed_mps=BEST_MPS, measured=False)
    vehicle = at(5.0, z_m=PLACE.z_m + REST_M + over_m)
    return glide_setpoints(PARAMS, state, False, True, PITCHES, vehicle, feels, 99.0).steeper


@pytest.mark.parametrize(
    ("over_m", "found"), [(0.9, 0.0), (1.5, 0.125), (2.0, 0.25), (3.0, 0.5), (9.0, 0.5)]
)
def test_from_one_to_three_metres_over_the_rest_it_may_bank_half_as_much_again(
    over_m: float, found: float
) -> None:
    assert steeper(over_m) == pytest.approx(found)


def test_it_banks_no_steeper_where_its_airspeed_is_known_worse_than_within_1_mps() -> None:
    assert steeper(9.0, 0.99) == pytest.approx(0.5)
    assert steeper(9.0, 1.01) == 0.0
    assert steeper(9.0, stalled=True) == 0.0


@pytest.mark.parametrize(
    ("bank_deg", "tilt_deg", "found_deg"),
    [(10.0, 60.0, 15.0), (14.0, 60.0, 20.0), (14.0, 36.0, 18.0), (25.0, 60.0, 25.0)],
)
def test_a_steeper_bank_ends_at_twenty_degrees_and_half_of_the_tilt(
    bank_deg: float, tilt_deg: float, found_deg: float
) -> None:
    params = PARAMS._replace(tilt_max_rad=radians(tilt_deg))
    assert steeper_bank(params, radians(bank_deg), 0.5) == pytest.approx(radians(found_deg))
