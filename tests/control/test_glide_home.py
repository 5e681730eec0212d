"""The height left for the way home, the wait in a wind that has risen, the end on the ground."""

from __future__ import annotations

from math import exp, inf, isnan, nan

import pytest
from test_landing import DT, PARAMS, PLACE, air, at

from tgl_soar.control import glide_home
from tgl_soar.control.glide_home import (
    NO_ESCAPE,
    EscapeState,
    EscapeView,
    escape_step,
    is_on_ground,
    is_short,
    time_left,
)
from tgl_soar.control.landing import LandingParams, escape_height
from tgl_soar.control.wind_triangle import slower
from tgl_soar.types import AirEstimate

WAITS = PARAMS._replace(waits=True)
SOARS = EscapeView(flying=True, goes_home=False, soars=True, same_line=True, place_known=True)
AWAY = SOARS._replace(soars=False, same_line=False)


def hovering(wind_mps: float) -> AirEstimate:
    """What stands over the ground flies as fast as the wind blows."""
    return air(wind_mps=wind_mps, airspeed_mps=wind_mps)


CALM, STRONG = hovering(7.6), hovering(10.0)  # within reach, and beyond it


def watched(
    params: LandingParams,
    winds: tuple[AirEstimate, ...],
    state: EscapeState = NO_ESCAPE,
    view: EscapeView = SOARS,
    start_s: float = 0.0,
) -> tuple[EscapeState, float]:
    """Ten seconds at each of these; the time then."""
    now = start_s
    for wind in winds:
        for _ in range(round(10.0 / DT)):
            now += DT
            state = escape_step(params, state, view, at(now), wind, DT)
    return state, now


def test_the_winds_of_these_tests_are_on_both_sides() -> None:
    assert escape_height(PARAMS, at(), CALM) > 0.0
    assert escape_height(PARAMS, at(), STRONG) < 0.0


def test_a_wind_that_has_risen_is_waited_out_by_who_may() -> None:
    at_once, now = watched(PARAMS, (CALM, STRONG))
    assert is_short(at_once, now)
    waited, now = watched(WAITS, (CALM, STRONG, STRONG))
    assert not is_short(waited, now)
    assert waited.left_m == pytest.approx(escape_height(PARAMS, at(), STRONG), abs=0.1)  # shown
    assert waited.carried_mps == 7.6
    assert waited.counts_m == pytest.approx(escape_height(PARAMS, at(), CALM), abs=0.1)
    assert waited.armed


def test_it_waits_no_longer_when_the_line_moves_or_no_longer_carries_it() -> None:
    waited, now = watched(WAITS, (CALM, STRONG))
    left, now = watched(WAITS, (STRONG,), waited, AWAY, now)
    assert left.counts_m == pytest.approx(left.left_m, abs=0.1)
    assert is_short(left, now)
    again, now = watched(WAITS, (STRONG,), left, SOARS, now)
    assert again.carried_mps == pytest.approx(10.0)  # of the new line nothing else is known
    assert is_short(again, now)


def test_what_has_not_carried_it_is_not_waited_for() -> None:
    """It began in a strong wind, from which the place was never in reach, or no longer is."""
    state, now = watched(WAITS, (hovering(9.0), STRONG))
    assert state.carried_mps == 9.0
    assert state.counts_m == pytest.approx(escape_height(PARAMS, at(), hovering(9.0)), abs=0.1)
    far = WAITS._replace(place=WAITS.place._replace(x_m=-400.0))
    state, now = watched(WAITS, (CALM,))
    state, now = watched(far, (STRONG,), state, SOARS, now)
    assert is_short(state, now)


def test_a_lull_of_a_moment_has_carried_nothing() -> None:
    state, now = watched(WAITS, (hovering(9.0),))
    for _ in range(round(0.5 / DT)):
        now += DT
        state = escape_step(WAITS, state, SOARS, at(now), CALM, DT)
    assert state.carried_mps == pytest.approx(9.0 - 1.4 * (1.0 - exp(-0.5 / 10.0)), abs=1e-3)


def test_in_a_wind_as_slow_as_has_carried_it_nothing_is_waited_for() -> None:
    calm, _ = watched(WAITS, (CALM,))
    slower_still, _ = watched(WAITS, (CALM, hovering(7.2)))
    assert calm.counts_m == calm.left_m
    assert slower_still.counts_m == slower_still.left_m
    nobody = escape_step(PARAMS, calm, SOARS, at(11.0), STRONG, DT)
    assert (nobody.carried_mps, nobody.armed) == (inf, True)


def test_a_moment_without_position_or_wind_is_no_other_line() -> None:
    """Nor is one of holding or capturing on the same line; after it the aircraft waits on."""
    waited, now = watched(WAITS, (CALM, STRONG))
    blind = SOARS._replace(soars=False, place_known=False)
    for view, wind in (
        (blind, STRONG),
        (SOARS._replace(place_known=False), STRONG),
        (SOARS._replace(soars=False), STRONG),
        (SOARS, air(wind_mps=nan)),
    ):
        gap = escape_step(WAITS, waited, view, at(now + DT), wind, DT)
        assert gap.carried_mps == waited.carried_mps == 7.6
        assert gap.wind_mps == waited.wind_mps
        after, later = watched(WAITS, (STRONG,), gap, SOARS, now + DT)
        assert not is_short(after, later)
    assert escape_step(WAITS, waited, AWAY, at(now + DT), STRONG, DT).carried_mps == inf


def test_what_is_counted_on_is_what_is_left_when_the_wind_has_fallen() -> None:
    """Over the ground it goes as before: its airspeed falls with the wind."""
    counted = escape_height(PARAMS, at(), slower(hovering(10.5), 7.5))
    assert counted == pytest.approx(escape_height(PARAMS, at(), hovering(7.5)))
    fallen = slower(air(wind_mps=4.0, airspeed_mps=3.0), 0.5)
    assert (fallen.wind_mps, fallen.airspeed_mps) == (0.5, 0.0)


def kept_at(height_m: float, seconds: float, state: EscapeState = NO_ESCAPE, start: float = 0.0,
            fall_mps: float = 0.0) -> EscapeState:  # fmt: skip
    steps = round(seconds / DT)
    for k in range(steps):
        vehicle = at(start + k * DT, z_m=height_m - fall_mps * k * DT, velocity_x_mps=-2.0)
        state = escape_step(PARAMS, state, AWAY, vehicle, air(), DT)
    return state


def test_it_is_short_only_after_there_was_height_and_only_when_it_lasts() -> None:
    low = kept_at(2.0, 5.0)
    assert low.left_m < 0.0
    assert not is_short(low, 5.0)  # launched from below: there never was any
    high = kept_at(20.0, 2.0)
    assert high.armed
    assert not is_short(high, 2.0)
    gone = kept_at(2.0, 0.3, high, 2.0)
    assert not is_short(gone, 2.3)
    gone = kept_at(2.0, 3.0, gone, 2.3)
    assert is_short(gone, 5.3)


def test_the_time_left_is_the_height_by_how_fast_it_goes() -> None:
    state = kept_at(25.0, 40.0, fall_mps=0.1)
    assert state.rate_mps == pytest.approx(-0.1, abs=0.01)
    assert time_left(state) == pytest.approx(state.left_m / 0.1, rel=0.1)
    assert time_left(kept_at(25.0, 5.0)) == inf
    assert time_left(kept_at(2.0, 5.0)) == 0.0
    assert isnan(time_left(NO_ESCAPE))


def stood(
    seconds: float,
    state: EscapeState,
    start_s: float,
    *,
    lands: bool = True,
    confident: bool = True,
) -> EscapeState:
    """Still and low, tick by tick."""
    for k in range(round(seconds / DT)):
        vehicle = at(start_s + k * DT, z_m=0.1, climb_mps=0.0)
        state = escape_step(
            PARAMS, state, AWAY._replace(goes_home=lands, place_known=confident), vehicle, air(), DT
        )
    return state


def test_it_lies_on_the_ground_when_it_has_stood_still_low() -> None:
    state = NO_ESCAPE
    for k in range(300):
        vehicle = at(k * DT, z_m=0.1, climb_mps=0.0)
        state = escape_step(PARAMS, state, AWAY._replace(goes_home=True), vehicle, air(), DT)
        assert is_on_ground(PARAMS, state, vehicle, inf) == (k * DT >= glide_home.STILL_S - 1e-9)
    hovering = at(299 * DT, z_m=5.0, climb_mps=0.0)
    assert not is_on_ground(PARAMS, state, hovering, inf)


def test_standing_still_counts_from_the_landing_on_and_only_where_the_height_is_known() -> None:
    """In soaring it stands still all the time, and in a tunnel less than a metre over the board."""
    soared = stood(5.0, NO_ESCAPE, 0.0, lands=False)
    now = at(5.0, z_m=0.1, climb_mps=0.0)
    soared = escape_step(PARAMS, soared, AWAY._replace(goes_home=True), now, air(), DT)
    assert not is_on_ground(PARAMS, soared, now, 0.1)
    lain = stood(2.0, soared, 5.0)
    now = at(7.0, z_m=0.1, climb_mps=0.0)
    assert is_on_ground(PARAMS, lain, now, 0.1)
    assert not is_on_ground(PARAMS, lain, now, 0.87)  # the ground counts, not the place
    nowhere = PARAMS._replace(place=PLACE._replace(length_m=0.0))
    assert not is_on_ground(nowhere, lain, now, inf)
    assert is_on_ground(nowhere, lain, now, 0.1)
    assert not is_on_ground(PARAMS, stood(2.0, soared, 5.0, confident=False), now, 0.1)


def test_without_a_position_the_height_left_is_not_known() -> None:
    low = kept_at(2.0, 3.0, kept_at(20.0, 2.0), 2.0)
    assert is_short(low, 5.0)
    vehicle = at(5.0, z_m=2.0)
    blind = escape_step(PARAMS, low, AWAY._replace(place_known=False), vehicle, air(), DT)
    assert isnan(blind.left_m)
    assert blind.armed
    assert not is_short(blind, 9.0)
