"""The escape condition's watch in numbers: its averages, how long something has to last, what is
still and what is low, each from both sides."""

from __future__ import annotations

from math import exp, inf, isnan, nan
from typing import Any

import pytest
from test_landing import DT, PARAMS, PLACE, air, at

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
from tgl_soar.types import AirEstimate, VehicleState

FLIES = EscapeView(flying=True, goes_home=False, soars=False, same_line=False, place_known=True)
HOME = FLIES._replace(goes_home=True)
WAITS = PARAMS._replace(waits=True)
SOARS = FLIES._replace(soars=True)
LEFT_M = escape_height(PARAMS, at(), air())
KNOWN = NO_ESCAPE._replace(left_m=LEFT_M, counts_m=LEFT_M, since_s=0.0)


def step(
    state: EscapeState = KNOWN,
    vehicle: VehicleState | None = None,
    *,
    view: EscapeView = FLIES,
    params: LandingParams = PARAMS,
    blows: AirEstimate | None = None,
    dt_s: float = DT,
) -> EscapeState:
    return escape_step(
        params,
        state,
        view,
        at(5.0) if vehicle is None else vehicle,
        air() if blows is None else blows,
        dt_s,
    )


# --- the height that is left --------------------------------------------------------------------


def test_the_first_height_is_taken_as_it_is() -> None:
    state = step(NO_ESCAPE)
    assert (state.left_m, state.counts_m, state.since_s) == (LEFT_M, LEFT_M, 5.0)
    assert (state.rate_mps, state.armed) == (0.0, False)
    assert 0.0 < LEFT_M < 14.0


def test_it_is_averaged_over_a_second_and_its_rate_over_ten() -> None:
    higher = at(5.0, z_m=16.0)
    rise = escape_height(PARAMS, higher, air()) - LEFT_M
    assert rise == pytest.approx(2.0)
    state = step(KNOWN._replace(rate_mps=0.3), higher, dt_s=0.2)
    blend = 1.0 - exp(-0.2)
    assert state.left_m == pytest.approx(LEFT_M + blend * 2.0)
    assert state.counts_m == pytest.approx(state.left_m)
    slow = 1.0 - exp(-0.02)
    assert state.rate_mps == pytest.approx(0.3 + slow * (blend * 2.0 / 0.2 - 0.3))


def test_a_time_that_stands_still_changes_nothing_of_it() -> None:
    state = step(KNOWN._replace(rate_mps=-0.3), at(5.0, z_m=20.0), dt_s=0.0)
    assert (state.left_m, state.rate_mps) == (LEFT_M, -0.3)


@pytest.mark.interpreted
def test_out_of_the_air_everything_is_forgotten() -> None:
    armed = KNOWN._replace(armed=True, still_s=1.0)
    assert step(armed, view=FLIES._replace(flying=False)) == NO_ESCAPE
    blind = step(armed, view=FLIES._replace(place_known=False))
    assert blind == NO_ESCAPE._replace(armed=True, still_s=5.0)


@pytest.mark.parametrize(
    ("counted", "since_s", "kept"),
    [(LEFT_M, 2.0, 2.0), (-50.0, 2.0, 2.0), (-0.01, 2.0, 5.0), (0.0, 2.0, 2.0)],
)
def test_since_when_there_is_some_or_none_is_remembered(
    counted: float, since_s: float, kept: float
) -> None:
    """From 1 cm below nothing it comes above it in one step, from 50 m below it does not."""
    state = step(KNOWN._replace(counts_m=counted, since_s=since_s), dt_s=0.01)
    assert state.since_s == kept


@pytest.mark.parametrize(("since_s", "armed"), [(4.01, False), (3.99, True)])
def test_a_second_of_some_height_arms_it(since_s: float, armed: bool) -> None:
    assert step(KNOWN._replace(since_s=since_s)).armed is armed
    assert step(KNOWN._replace(since_s=5.0, armed=True)).armed
    none = KNOWN._replace(counts_m=-50.0, since_s=since_s)
    assert not step(none, at(5.0, z_m=1.0)).armed


@pytest.mark.parametrize(("for_s", "short"), [(0.49, False), (0.51, True)])
def test_half_a_second_without_any_is_the_last_moment(for_s: float, short: bool) -> None:
    gone = KNOWN._replace(counts_m=-0.1, since_s=5.0, armed=True)
    assert is_short(gone, 5.0 + for_s) is short
    for other in ({"armed": False}, {"counts_m": 0.0}, {"counts_m": nan}):
        changed: dict[str, Any] = other
        assert not is_short(gone._replace(**changed), 9.0)


@pytest.mark.parametrize(
    ("left_m", "rate_mps", "time_s"),
    [
        (6.0, -0.5, 12.0), (6.0, -0.0011, 6.0 / 0.0011), (6.0, -0.0009, inf), (6.0, 0.5, inf),
        (0.0, -0.5, 0.0), (-1.0, 0.5, 0.0),
    ],
)  # fmt: skip
def test_the_time_left(left_m: float, rate_mps: float, time_s: float) -> None:
    state = KNOWN._replace(left_m=left_m, rate_mps=rate_mps)
    assert time_left(state) == pytest.approx(time_s)
    assert isnan(time_left(state._replace(left_m=nan)))


# --- a wind that is waited out ------------------------------------------------------------------


def test_the_least_wind_that_has_carried_it_is_averaged_over_ten_seconds() -> None:
    first = step(NO_ESCAPE, view=SOARS, params=WAITS, blows=air(wind_mps=8.0))
    assert (first.wind_mps, first.carried_mps) == (8.0, 8.0)
    rising = step(first, view=SOARS, params=WAITS, blows=air(wind_mps=10.0), dt_s=0.5)
    assert rising.wind_mps == pytest.approx(8.0 + 2.0 * (1.0 - exp(-0.05)))
    assert rising.carried_mps == 8.0
    falling = step(rising, view=SOARS, params=WAITS, blows=air(wind_mps=5.0), dt_s=1.0)
    assert falling.carried_mps == falling.wind_mps < 8.0
    for lost in (
        step(falling, view=FLIES, params=WAITS),
        step(falling, view=SOARS),  # that does not wait
        step(falling, view=SOARS, params=WAITS, blows=air(wind_mps=nan)),
    ):
        assert lost.carried_mps == inf
        assert isnan(lost.wind_mps)


def test_a_wind_from_beside_counts_with_the_wind() -> None:
    state = step(NO_ESCAPE, view=SOARS, params=WAITS, blows=air(wind_mps=6.0, cross_wind_mps=4.5))
    assert state.carried_mps == pytest.approx(7.5)


def test_what_counts_is_what_is_left_in_the_wind_that_carried_it() -> None:
    carried = KNOWN._replace(wind_mps=8.0, carried_mps=7.5)
    state = step(carried, view=SOARS, params=WAITS, blows=air(wind_mps=9.0), dt_s=0.1)
    blend = 1.0 - exp(-0.1)
    fast, slow = air(wind_mps=9.0), air(wind_mps=7.5, airspeed_mps=air().airspeed_mps - 1.5)
    now, then = (escape_height(PARAMS, at(), blows) for blows in (fast, slow))
    assert state.left_m == pytest.approx(LEFT_M + blend * (now - LEFT_M))
    assert state.counts_m == pytest.approx(LEFT_M + blend * (then - LEFT_M))
    assert then - now > 1.0


# --- on the ground ------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["velocity_x_mps", "velocity_y_mps", "climb_mps"])
@pytest.mark.parametrize(
    ("mps", "still"), [(0.69, True), (-0.69, True), (0.71, False), (-0.71, False)]
)
def test_what_moves_by_seven_tenths_of_a_metre_a_second_is_not_still(
    name: str, mps: float, still: bool
) -> None:
    rest = {"velocity_x_mps": 0.0, "velocity_y_mps": 0.0, "climb_mps": 0.0}
    state = step(KNOWN._replace(still_s=1.0), at(5.0, **{**rest, name: mps}), view=HOME)
    assert state.still_s == (1.0 if still else 5.0)


def test_all_three_axes_count_together() -> None:
    moves = at(5.0, velocity_x_mps=0.5, velocity_y_mps=0.5, climb_mps=0.1)  # 0.71 m/s
    assert step(KNOWN._replace(still_s=1.0), moves, view=HOME).still_s == 5.0
    slower = at(5.0, velocity_x_mps=0.4, velocity_y_mps=0.4, climb_mps=0.4)  # 0.69 m/s
    assert step(KNOWN._replace(still_s=1.0), slower, view=HOME).still_s == 1.0


def test_it_is_still_from_now_on_where_nobody_knows_since_when() -> None:
    rest = at(5.0, climb_mps=0.0)
    for before in (nan, 6.0):  # a clock that went back
        assert step(KNOWN._replace(still_s=before), rest, view=HOME).still_s == 5.0
    for view in (FLIES, HOME._replace(place_known=False)):
        assert step(KNOWN._replace(still_s=1.0), rest, view=view).still_s == 5.0


@pytest.mark.parametrize(
    ("clearance_m", "for_s", "lies"),
    [(0.29, 1.01, True), (0.31, 1.01, False), (0.29, 0.99, False), (nan, 1.01, False)],
)
def test_it_lies_there_after_a_second_within_three_tenths_of_a_metre(
    clearance_m: float, for_s: float, lies: bool
) -> None:
    state = KNOWN._replace(still_s=5.0)
    assert is_on_ground(PARAMS, state, at(5.0 + for_s, z_m=9.0), clearance_m) is lies
    # Where no ground is known, over the place to land.
    if clearance_m == clearance_m:
        over = at(5.0 + for_s, z_m=2.0 + clearance_m)
        raised = PARAMS._replace(place=PLACE._replace(z_m=2.0))
        assert is_on_ground(raised, state, over, inf) is lies
