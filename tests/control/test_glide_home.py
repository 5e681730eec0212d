"""The height left for the way home in a wind that has risen: who waits, where, and how long."""

from __future__ import annotations

from math import exp, hypot, inf, nan

import pytest
from test_landing import DT, PARAMS, air, at

from tgl_soar.control.glide_home import (
    NO_ESCAPE,
    EscapeState,
    EscapeView,
    escape_step,
    is_short,
)
from tgl_soar.control.landing import LandingParams, escape_height
from tgl_soar.control.wind_triangle import slower, wind_speed
from tgl_soar.types import AirEstimate

WAITS = PARAMS._replace(waits=True)
SOARS = EscapeView(flying=True, goes_home=False, soars=True, place_known=True)
CALM, STRONG = air(wind_mps=7.8), air(wind_mps=10.0)  # within reach, and beyond it


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
    assert waited.carried_mps == 7.8
    assert waited.counts_m == pytest.approx(escape_height(PARAMS, at(), CALM), abs=0.1)
    assert waited.armed


def test_it_waits_no_longer_when_the_line_moves_or_no_longer_carries_it() -> None:
    waited, now = watched(WAITS, (CALM, STRONG))
    left, now = watched(WAITS, (STRONG,), waited, SOARS._replace(soars=False), now)
    assert left.counts_m == pytest.approx(left.left_m, abs=0.1)
    assert is_short(left, now)
    again, now = watched(WAITS, (STRONG,), left, SOARS, now)
    assert again.carried_mps == pytest.approx(10.0)  # of the new line nothing else is known
    assert is_short(again, now)


def test_what_has_not_carried_it_is_not_waited_for() -> None:
    """It began in a strong wind, from which the place was never in reach, or no longer is."""
    state, now = watched(WAITS, (air(wind_mps=9.0), STRONG))
    assert state.carried_mps == 9.0
    assert state.counts_m == pytest.approx(escape_height(PARAMS, at(), air(wind_mps=9.0)), abs=0.1)
    far = WAITS._replace(place=WAITS.place._replace(x_m=-400.0))
    state, now = watched(WAITS, (CALM,))
    state, now = watched(far, (STRONG,), state, SOARS, now)
    assert is_short(state, now)


def test_a_lull_of_a_moment_has_carried_nothing() -> None:
    state, now = watched(WAITS, (air(wind_mps=9.0),))
    for _ in range(round(0.5 / DT)):
        now += DT
        state = escape_step(WAITS, state, SOARS, at(now), CALM, DT)
    assert state.carried_mps == pytest.approx(9.0 - 1.2 * (1.0 - exp(-0.5 / 10.0)), abs=1e-3)


def test_in_a_wind_as_slow_as_has_carried_it_nothing_is_waited_for() -> None:
    calm, _ = watched(WAITS, (CALM,))
    slower_still, _ = watched(WAITS, (CALM, air(wind_mps=7.2)))
    assert calm.counts_m == calm.left_m
    assert slower_still.counts_m == slower_still.left_m
    unknown = escape_step(WAITS, calm, SOARS, at(11.0), air(wind_mps=nan), DT)
    assert (unknown.carried_mps, unknown.armed) == (inf, True)


def test_a_slower_wind_has_the_same_direction() -> None:
    wind = slower(air(wind_mps=8.0, cross_wind_mps=-6.0), 5.0)
    assert (wind.wind_mps, wind.cross_wind_mps) == pytest.approx((4.0, -3.0))
    assert wind_speed(wind) == pytest.approx(5.0)
    assert wind_speed(air(wind_mps=8.0, cross_wind_mps=nan)) == 8.0
    assert wind_speed(air(wind_mps=3.0, cross_wind_mps=4.0)) == hypot(3.0, 4.0)
