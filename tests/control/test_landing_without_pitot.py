"""Home without a pitot tube: the look that shows the airspeed, and how slowly it may be flown."""

from __future__ import annotations

from math import cos, exp, inf, nan, radians, sin
from typing import Any, NamedTuple

import pytest
from test_landing import DT, PARAMS, POLAR, SLOWEST, at, pitched
from test_landing import air as any_air

from tgl_soar.control import airspeed_hold, landing
from tgl_soar.control.airspeed_error import NOSE_S, SPREAD_MPS, airspeed_error, error_sigma
from tgl_soar.control.airspeed_hold import NO_GLIDE, GlideState
from tgl_soar.control.landing import (
    final_speed,
    glide_setpoints,
    glide_step,
    half_width,
    slowest_known,
    steeper_bank,
)
from tgl_soar.types import AirEstimate, polar_sink

PLACE_FAR = PARAMS._replace(place=PARAMS.place._replace(x_m=-80.0))


def air(**changes: Any) -> AirEstimate:
    return any_air(measured=False)._replace(**changes)


class Flown(NamedTuple):
    """A way home."""

    slowest_mps: float  # true airspeed from 4 s after its beginning on
    off_m: float  # from the approach, at most
    nose_rad: float  # to either side, at most
    state: GlideState
    y_m: float  # where it begins to flare


def flown_home(misread_mps: float, *, z_m: float, measured: bool = False) -> Flown:
    """A point that holds the airspeed that is read in 1.5 s, and whose path follows its nose in
    1.4 s; misread_mps: what is read is so much too high, and so is the wind."""
    params, wind_mps = PLACE_FAR, 7.0
    state, true_mps, x_m, y_m, psi, path = NO_GLIDE, 9.2 - misread_mps, -50.0, 0.0, 0.0, 0.0
    least, off, nose, time_s = inf, 0.0, 0.0, 0.0
    while not state.flares and time_s < 60.0:
        sink = polar_sink(POLAR, max(7.6, min(12.0, true_mps)))
        sideways = true_mps * path
        vehicle = at(time_s, x_m=x_m, y_m=y_m, z_m=z_m, climb_mps=-sink)
        vehicle = vehicle._replace(heading_rad=psi, velocity_y_mps=sideways)
        read = true_mps + misread_mps
        met = air(airspeed_mps=read, wind_mps=wind_mps + misread_mps)._replace(measured=measured)
        state, _ = glide_step(params, state, False, True, vehicle, met, z_m, False, DT)
        setpoints = glide_setpoints(params, state, False, True, pitched(0.0), vehicle, met, z_m)
        error_mps = min(0.0, airspeed_error(state.airspeed_error))
        true_mps += (state.speed_mps - read - error_mps) * DT / 1.5
        psi += (setpoints.heading_rad - psi) * DT / 0.9
        path += (1.0 - exp(-DT / NOSE_S)) * (sin(psi) - path)
        x_m -= (true_mps - wind_mps) * DT
        y_m += sideways * DT
        z_m -= sink * DT
        time_s += DT
        if time_s > 4.0:
            least = min(least, true_mps)
        off, nose = max(off, abs(y_m)), max(nose, abs(psi))
    return Flown(slowest_mps=least, off_m=off, nose_rad=nose, state=state, y_m=y_m)


@pytest.mark.parametrize("misread_mps", [0.0, 1.0, 1.8])
def test_an_airspeed_that_is_read_too_high_is_found_out_on_the_way(misread_mps: float) -> None:
    """From 20 m, before the straight rest: what remains is what is expected of no error."""
    flown = flown_home(misread_mps, z_m=20.0)
    assert error_sigma(flown.state.airspeed_error) < SPREAD_MPS / 2.0
    assert airspeed_error(flown.state.airspeed_error) == pytest.approx(-misread_mps, abs=0.4)
    assert 0.4 < flown.nose_rad < 1.5
    assert abs(flown.y_m) < 9.0  # and CROSS_MPS goes on for 3 s


def test_read_too_high_it_flies_faster_than_it_would_without_turning() -> None:
    """Of 1.8 m/s all but what is expected of no error is made good."""
    flown = flown_home(1.8, z_m=20.0)
    assert flown.slowest_mps > SLOWEST  # and an early stall is at 7.7
    assert flown_home(0.0, z_m=20.0).slowest_mps > SLOWEST


def test_what_is_measured_is_neither_looked_for_nor_corrected() -> None:
    flown = flown_home(1.8, z_m=8.0, measured=True)
    assert flown.nose_rad < 0.1
    assert (
        flown.state.airspeed_error == NO_GLIDE.airspeed_error
        or flown.state.airspeed_error.weight == 0.0
    )


def looked(height_m: float, state: GlideState = NO_GLIDE, **changes: Any) -> GlideState:
    """A second of an approach that has no height left over."""
    for k in range(200):
        vehicle = at(k * DT, x_m=-14.0, z_m=height_m)
        met = air(airspeed_mps=9.3, wind_mps=8.5)._replace(**changes)
        state, _ = glide_step(PARAMS, state, False, True, vehicle, met, height_m, False, DT)
    return state


def test_it_looks_while_there_is_height_and_the_airspeed_is_not_known() -> None:
    high = landing.FINAL_M + landing.LOOK_ABOVE_M + 0.1
    assert looked(high + 1.0).weave_rad == pytest.approx(landing.LOOK_RAD)
    assert looked(high - 0.2).weave_rad == 0.0
    assert looked(high).weave_rad > 0.0  # near its end it is narrow
    assert looked(high, measured=True).weave_rad == 0.0
    error = NO_GLIDE.airspeed_error._replace(nose=0.0, sideways_mps=0.0, weight=40.0, by_nose2=6.0)
    assert error_sigma(error) < landing.LOOK_MPS
    assert looked(high, NO_GLIDE._replace(airspeed_error=error)).weave_rad == 0.0
    assert looked(high, airspeed_mps=nan).weave_rad == 0.0
    assert looked(high, airspeed_mps=SLOWEST - 1.0).weave_rad == 0.0  # slow: no turn


def test_an_airspeed_that_is_not_measured_keeps_the_approach_at_the_best_glide() -> None:
    assert slowest_known(PARAMS, True) == pytest.approx(SLOWEST)
    assert slowest_known(PARAMS, False) == PARAMS.best_glide_mps
    slow = PARAMS._replace(best_glide_mps=5.0)  # of a file that does not know it
    assert slowest_known(slow, False) == pytest.approx(SLOWEST)


def test_the_straight_rest_is_flown_at_the_reference_speed_of_a_landing_if_not_measured() -> None:
    """1.3 of the stall's speed, and never slower than the best glide."""
    low = at(x_m=-20.0, y_m=0.0, z_m=landing.FINAL_M - 0.1)
    for stall_mps, wanted_mps in ((7.5, 9.75), (6.9, 9.2), (nan, 9.2)):
        params = PARAMS._replace(stall_mps=stall_mps)
        assert final_speed(params, False) == pytest.approx(wanted_mps)
        assert final_speed(params, True) == params.best_glide_mps
        for measured, asked_mps in ((False, wanted_mps), (True, params.best_glide_mps)):
            state = NO_GLIDE
            for _ in range(400):
                met = air(airspeed_mps=9.2, measured=measured)
                state, _ = glide_step(params, state, False, True, low, met, inf, False, DT)
            assert state.speed_mps == pytest.approx(asked_mps)


def test_the_straight_rest_is_flown_no_faster_than_the_polar_reaches() -> None:
    params = PARAMS._replace(stall_mps=POLAR.speed_max_mps)
    low = at(x_m=-20.0, y_m=0.0, z_m=landing.FINAL_M - 0.1)
    state = NO_GLIDE
    for _ in range(800):
        met = air(airspeed_mps=9.2)
        state, _ = glide_step(params, state, False, True, low, met, inf, False, DT)
    assert state.speed_mps == POLAR.speed_max_mps


def test_what_the_elevator_holds_is_kept_through_the_glide() -> None:
    met = air(airspeed_mps=9.2, alpha_rad=0.16, trim_alpha_rad=0.16)
    state, _ = glide_step(PARAMS, NO_GLIDE, False, True, at(z_m=9.0), met, inf, False, DT)
    assert state.trim_alpha_rad == 0.16
    pitches = pitched(-0.05)._replace(most_alpha_rad=0.15)
    found = [
        glide_setpoints(PARAMS, each, False, True, pitches, at(z_m=9.0), met, inf).pitch_rad
        for each in (state._replace(trim_alpha_rad=nan), state)
    ]
    assert found[1] == pytest.approx(found[0] - 0.01)


def test_a_look_is_never_past_abeam_of_the_approach() -> None:
    """A bearing 60 degrees off a wind that has veered by 15 more leaves 15 degrees on that side."""
    veer, bearing = radians(15.0), radians(-60.0)
    params = PARAMS._replace(place=PARAMS.place._replace(bearing_rad=bearing, y_m=0.0))
    state = NO_GLIDE
    for k in range(200):
        vehicle = at(k * DT, x_m=-27.0, y_m=0.0, z_m=9.0)
        met = air(airspeed_mps=9.3, wind_mps=7.0 * cos(veer), cross_wind_mps=-7.0 * sin(veer))
        state, _ = glide_step(params, state, False, True, vehicle, met, 9.0, False, DT)
    assert 0.0 < state.weave_rad <= radians(15.0) + 1e-9


def test_at_the_best_glide_it_weaves_wider_near_the_ground() -> None:
    assert half_width(PARAMS, 3.0, True) == pytest.approx(3.0 * landing.FAST_WIDER)
    assert half_width(PARAMS, 3.0, True) > half_width(PARAMS, 3.0, False)
    assert half_width(PARAMS, 5.0, True) == landing.FAST_M
    for over_m in (7.0, 40.0):
        assert half_width(PARAMS, over_m, True) == half_width(PARAMS, over_m, False)
    assert half_width(PARAMS._replace(side_max_m=3.0), 40.0, True) == 3.0
    assert half_width(PARAMS, -1.0, True) == 0.0


def test_the_nose_goes_down_by_what_turning_has_shown() -> None:
    """And not up: an airspeed that is read too low is safe."""
    slow = NO_GLIDE.airspeed_error._replace(nose=0.0, sideways_mps=0.0, weight=40.0, by_nose2=6.0)
    found = []
    for by_both in (-9.0, 0.0, 9.0):
        state = NO_GLIDE._replace(speed_mps=9.2, airspeed_error=slow._replace(by_both=by_both))
        pitches = pitched(-0.04, slowest_rad=0.3)
        found += [glide_setpoints(PARAMS, state, False, True, pitches, at(), air(), inf).pitch_rad]
    error = -9.0 * error_sigma(slow) ** 2
    assert error < -1.0
    assert found[0] == pytest.approx(found[1] + airspeed_hold.KP * error)
    assert found[2] == found[1]


def test_what_comes_from_high_up_weaves_no_wider_near_the_ground() -> None:
    """With all of its height still to lose it turns at its widest, and a turn takes some 3 m."""
    low = looked(landing.FINAL_M + 3.0)
    assert not low.from_high
    high = looked(landing.FINAL_M + landing.HIGH_M + 0.1)
    assert high.from_high
    assert looked(landing.FINAL_M + 3.0, high).from_high  # and so it stays
    # 8 m off to the right is beyond 2.3 m for each of 2.9 m, and within 3.5 m.
    off = at(1.0, x_m=-14.0, y_m=8.0 + PARAMS.place.y_m, z_m=landing.FINAL_M + 2.9)
    for began, goes_right in ((high, False), (low, True)):
        began = began._replace(weave_rad=0.0, goes_right=True)
        met = air(airspeed_mps=9.3, wind_mps=8.5)
        then, _ = glide_step(PARAMS, began, False, True, off, met, 7.4, False, DT)
        assert then.goes_right == goes_right


def steeper(
    over_m: float, *, weave_rad: float = 0.9, by_nose2: float = 1.0, **changes: Any
) -> float:
    """What the setpoints have of it at a height over the straight rest.

    by_nose2: what turns have shown."""
    error = NO_GLIDE.airspeed_error._replace(
        nose=0.0, sideways_mps=0.0, weight=40.0, by_nose2=by_nose2
    )
    stalled = changes.pop("stalled", False)
    state = NO_GLIDE._replace(
        speed_mps=9.2, weave_rad=weave_rad, airspeed_error=error, stalled=stalled
    )
    high = at(x_m=-14.0, z_m=PARAMS.place.z_m + landing.FINAL_M + over_m)
    setpoints = glide_setpoints(
        PARAMS, state, False, True, pitched(-0.04), high, air(**changes), inf
    )
    return setpoints.steeper


def test_it_banks_steeper_high_up_alone() -> None:
    full_m = landing.STEEP_ABOVE_M + landing.STEEP_WITHIN_M
    for over_m in (-1.0, 0.5, landing.STEEP_ABOVE_M):
        assert steeper(over_m) == 0.0
    middle_m = landing.STEEP_ABOVE_M + 0.5 * landing.STEEP_WITHIN_M
    assert steeper(middle_m) == pytest.approx(0.5 * landing.STEEPER)
    for over_m in (full_m, 40.0):
        assert steeper(over_m) == pytest.approx(landing.STEEPER)
    assert steeper(full_m, weave_rad=-0.9) == pytest.approx(landing.STEEPER)
    # Half a second of the best glide's sink, before the straight rest.
    assert 0.5 * polar_sink(POLAR, PARAMS.best_glide_mps) < landing.STEEP_ABOVE_M


def test_it_banks_no_steeper_where_that_may_stall_it_or_is_of_no_use() -> None:
    """Not before turns have shown the airspeed; and the weave of a measured one stays as it was."""
    for by_nose2, is_known in ((0.5, False), (0.6, True)):
        error = NO_GLIDE.airspeed_error._replace(nose=0.0, weight=40.0, by_nose2=by_nose2)
        assert (error_sigma(error) <= landing.STEEP_MPS) == is_known
        assert (steeper(20.0, by_nose2=by_nose2) > 0.0) == is_known
    assert steeper(20.0, stalled=True) == 0.0
    assert steeper(20.0, measured=True) == 0.0
    assert steeper(20.0, weave_rad=0.0) == 0.0


def test_a_steeper_bank_is_of_the_operators_own_and_has_an_end() -> None:
    for bank_deg, most_deg in ((10.0, 15.0), (16.0, 20.0), (25.0, 25.0)):
        assert steeper_bank(PARAMS, radians(bank_deg), 0.5) == pytest.approx(radians(most_deg))
    # What the envelope takes for an upset is never near, whatever the operator made of it.
    for tilt_deg in (20.0, 30.0, 40.0):
        upright = PARAMS._replace(tilt_max_rad=radians(tilt_deg))
        most_rad = max(radians(12.0), 0.5 * radians(tilt_deg))
        assert steeper_bank(upright, radians(12.0), 0.5) == pytest.approx(
            min(radians(18.0), most_rad)
        )
    # The stall's speed grows with the root of the load; from the best glide there is 1.5 m/s to it.
    load = 1.0 / cos(landing.STEEP_MAX_RAD)
    assert PARAMS.best_glide_mps - POLAR.speed_min_mps * load**0.5 > 1.3
