"""The throttle tick by tick: how much of it, what the propeller makes of that, and for how long."""

from __future__ import annotations

from math import exp
from typing import Any

import pytest

from tgl_soar.control import throttle
from tgl_soar.control.throttle import (
    NO_THROTTLE,
    ThrottleParams,
    ThrottleState,
    ThrottleView,
    can_hold,
    closed,
    full_climb,
    throttle_report,
    throttle_step,
)

DT, G = 0.005, 9.80665
PARAMS = ThrottleParams(budget_s=20.0, most=0.8, thrust_mps2=4.0, speed_mps=16.0, lag_s=0.2)
SINKS = ThrottleView(
    allowed=True,
    nowhere=True,
    home_m=50.0,
    home_s=60.0,
    room_m=9.0,
    climb_mps=-0.4,
    airspeed_mps=8.0,
)
CARRIED = SINKS._replace(nowhere=False)
OPENED = NO_THROTTLE._replace(
    standing=throttle.OPEN, called=throttle.NOWHERE, fraction=0.3, turns=0.2
)
# Half of the thrust is left at half of the airspeed at which nothing is: 2 m/s² at 8 m/s.
FULL_MPS = 2.0 * 8.0 / G


def step(
    state: ThrottleState, view: ThrottleView, params: ThrottleParams = PARAMS
) -> ThrottleState:
    return throttle_step(params, state, view, DT)


def test_thrust_falls_with_the_airspeed_and_climbs_by_it() -> None:
    assert full_climb(PARAMS, 8.0) == pytest.approx(FULL_MPS)
    assert full_climb(PARAMS, 4.0) == pytest.approx(3.0 * 4.0 / G)
    assert full_climb(PARAMS, 16.0) == full_climb(PARAMS, 20.0) == 0.0
    assert full_climb(PARAMS, -2.0) == pytest.approx(-4.0 * 2.0 / G)  # no more than at rest
    assert full_climb(PARAMS, float("nan")) == 0.0
    assert full_climb(PARAMS._replace(speed_mps=0.0), 8.0) == 0.0


def test_how_much_is_what_holds_the_climb_that_is_wanted() -> None:
    """GAIN of the error and its integral, as a fraction of what all of it gives; two full travels a
    second at the most."""
    state = OPENED._replace(integral_mps=0.2)
    found = step(state, SINKS)
    error = 0.3 + 0.4
    integral = 0.2 + error * DT
    assert found.integral_mps == pytest.approx(integral)
    wanted = (error + integral) / FULL_MPS
    assert found.fraction == pytest.approx(min(wanted, 0.3 + 2.0 * DT))
    near = OPENED._replace(fraction=wanted, integral_mps=0.2)
    assert step(near, SINKS).fraction == pytest.approx(wanted)
    # The integral has its ends at nothing and at the most that may be opened.
    assert step(OPENED, SINKS._replace(climb_mps=3.0)).integral_mps == 0.0
    full = OPENED._replace(integral_mps=0.8 * FULL_MPS)
    assert step(full, SINKS).integral_mps == pytest.approx(0.8 * FULL_MPS)
    assert (
        step(
            OPENED._replace(fraction=0.8, integral_mps=1.3), SINKS._replace(climb_mps=-3.0)
        ).fraction
        == 0.8
    )


def test_what_the_propeller_makes_of_it() -> None:
    found = step(OPENED, SINKS)
    turns = 0.2 + (found.fraction - 0.2) * DT / 0.2
    assert found.turns == pytest.approx(turns)
    assert found.push_mps2 == pytest.approx(turns * 2.0)
    assert found.climb_mps == pytest.approx(turns * FULL_MPS)
    assert found.pitch_rad == pytest.approx(turns * 2.0 / G)  # by which the glide is turned up
    assert found.used_s == pytest.approx(found.fraction * DT)
    # Without a lag it is at once; below a thousandth it stands.
    assert step(OPENED, SINKS, PARAMS._replace(lag_s=0.0)).turns == pytest.approx(found.fraction)
    state = NO_THROTTLE._replace(turns=0.00102)
    assert closed(PARAMS, state, DT).turns == 0.0
    assert closed(PARAMS, state._replace(turns=0.0011), DT).turns > 0.0


def test_closed_it_runs_down_and_all_that_follows_of_it_with_it() -> None:
    state = step(OPENED, SINKS)._replace(quiet_s=0.3, low_s=0.2, used_s=3.0)
    found = closed(PARAMS, state, DT)
    keeps = 1.0 - DT / 0.2
    assert found.turns == pytest.approx(keeps * state.turns)
    for name in ("push_mps2", "climb_mps", "pitch_rad"):
        assert getattr(found, name) == pytest.approx(keeps * getattr(state, name)), name
    assert (found.fraction, found.integral_mps, found.quiet_s, found.low_s) == (0.0,) * 4
    assert (found.called, found.used_s) == (throttle.NOT_CALLED, 3.0)
    assert found.standing == throttle.CLOSED
    assert closed(PARAMS, state._replace(used_s=20.0), DT).standing == throttle.USED_UP
    assert closed(PARAMS._replace(budget_s=0.0), state, DT).standing == throttle.OFF


@pytest.mark.parametrize(
    ("changes", "opens"),
    [
        ({"nowhere": True}, True),
        ({}, False),
        ({"home_m": 0.0}, True),
        ({"home_m": 0.1}, False),
        ({"home_s": 1.9}, True),
        ({"home_s": 2.1}, False),
        ({"home_m": float("nan"), "home_s": float("nan")}, False),
    ],
)
def test_what_calls_it(changes: dict[str, Any], opens: bool) -> None:
    found = step(NO_THROTTLE, CARRIED._replace(**changes))
    assert (found.called != throttle.NOT_CALLED) == opens
    assert (found.standing == throttle.OPEN) == opens


@pytest.mark.parametrize(("room_m", "low"), [(0.7, True), (0.9, False)])
def test_low_is_what_two_seconds_of_this_sink_would_make_for_three_tenths(
    room_m: float, low: bool
) -> None:
    state, ticks = NO_THROTTLE, 0
    view = CARRIED._replace(room_m=room_m)
    while state.called == throttle.NOT_CALLED and ticks < 400:
        state = step(state, view)
        ticks += 1
    assert (state.called == throttle.LOW) == low
    if low:
        assert ticks * DT == pytest.approx(0.3, abs=1.5 * DT)
        for _ in range(400):
            state = step(state, view)
        assert state.low_s == pytest.approx(0.6)  # it is forgotten in as long
        assert step(state, view._replace(climb_mps=0.1)).low_s == pytest.approx(0.6 - DT)
    # Below the least clearance it is low only while it sinks.
    rising = CARRIED._replace(room_m=-1.0, climb_mps=0.0)
    assert step(NO_THROTTLE._replace(low_s=0.1), rising).low_s == pytest.approx(0.1 - DT)


def test_it_goes_on_for_a_second_after_the_last_call_and_fades_in_two() -> None:
    state, ticks = OPENED, 0
    while state.called != throttle.NOT_CALLED:
        state = step(state, CARRIED._replace(climb_mps=0.3 - 0.45))
        ticks += 1
    assert ticks * DT == pytest.approx(1.0, abs=1.5 * DT)
    fraction = state.fraction
    after = step(state, CARRIED)
    assert after.fraction == pytest.approx(fraction - 0.5 * DT)
    assert (after.standing, after.integral_mps) == (throttle.OPEN, 0.0)
    shut = step(NO_THROTTLE._replace(standing=throttle.OPEN), CARRIED)
    assert (shut.standing, shut.fraction) == (throttle.CLOSED, 0.0)


def test_the_last_of_the_budget_is_given_and_no_more() -> None:
    state = OPENED._replace(used_s=20.0 - 0.1 * DT)
    found = step(state, SINKS)
    assert found.fraction == pytest.approx(0.1)
    assert (found.used_s, found.standing) == (20.0, throttle.USED_UP)
    assert step(found, SINKS).fraction == 0.0


@pytest.mark.parametrize(
    "changes", [{"allowed": False}, {"airspeed_mps": 15.9}, {"climb_mps": float("nan")}]
)
def test_uncertain_or_without_power_it_is_closed(changes: dict[str, Any]) -> None:
    """At 15.9 m/s all of it would climb by 4 cm/s."""
    assert step(OPENED, SINKS._replace(**changes)) == closed(PARAMS, OPENED, DT)


@pytest.mark.parametrize(
    ("used_s", "excess", "holds"),
    [
        (0.0, -0.9, True),  # with 0.8 of 1.63 m/s
        (0.0, -1.35, False),
        (18.5, -0.9, True),  # 1.5 s of 1.63 for 2 s of a little more than 0.9
        (18.95, -0.9, False),
        (0.0, float("nan"), False),
    ],
)
def test_what_it_can_carry_for_two_seconds(used_s: float, excess: float, holds: bool) -> None:
    assert can_hold(PARAMS, used_s, excess, 8.0) == holds


def test_what_is_shown_is_what_it_does() -> None:
    state = step(OPENED, SINKS)
    report = throttle_report(state)
    assert report == (state.standing, state.called, state.fraction, state.used_s, state.climb_mps)
    assert throttle.CALLED_TEXTS[report.called] == "no place to settle"
    assert throttle.CALLED_TEXTS[throttle.HOME] == "height for the way home"
    assert throttle.CALLED_TEXTS[throttle.LOW] == "low and sinking"


@pytest.mark.parametrize(
    ("returns_per_s", "room_m", "low"),
    [
        (0.0, 0.79, True),  # two seconds at 0.4 m/s
        (0.0, 0.81, False),
        (1.2, 0.29, True),  # 0.30 m: e^(-1.2 t) of that, from now on
        (1.2, 0.31, False),
        (0.3, 0.59, True),  # 0.60 m
        (0.3, 0.61, False),
    ],
)
def test_a_sink_of_one_that_is_brought_back_dies_away(
    returns_per_s: float, room_m: float, low: bool
) -> None:
    steps = 4000
    way_m = sum(
        0.4 * exp(-returns_per_s * (n + 0.5) * 2.0 / steps) * 2.0 / steps for n in range(steps)
    )
    assert (room_m < way_m) == low
    view = CARRIED._replace(room_m=room_m, climb_mps=-0.4, returns_per_s=returns_per_s)
    state = NO_THROTTLE
    for _ in range(70):  # for 0.3 s, and some more
        state = step(state, view)
    assert (state.called == throttle.LOW) == low


def test_one_that_nothing_is_known_to_bring_back_may_sink_for_two_seconds() -> None:
    for returns_per_s in (0.0, 1e-12, float("nan")):
        assert throttle.sinks_on_s(CARRIED._replace(returns_per_s=returns_per_s)) == 2.0
    assert throttle.sinks_on_s(CARRIED._replace(returns_per_s=1e-3)) == pytest.approx(
        1.998, abs=1e-4
    )
    assert throttle.sinks_on_s(CARRIED._replace(returns_per_s=50.0)) == pytest.approx(0.02)
