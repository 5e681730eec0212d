"""The throttle's law: called by what, closed where it is uncertain, never beyond its budget."""

from __future__ import annotations

import itertools
from math import inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.control.envelope import THROTTLE_PER_S, limit_throttle
from tgl_soar.control.throttle import (
    CLOSED,
    HOME,
    LOW,
    NO_THROTTLE,
    NOT_CALLED,
    NOWHERE,
    OFF,
    OPEN,
    USED_UP,
    ThrottleParams,
    ThrottleState,
    ThrottleView,
    can_hold,
    closed,
    full_climb,
    throttle_step,
)

DT = 0.005
PARAMS = ThrottleParams(budget_s=20.0, most=1.0, thrust_mps2=5.7, speed_mps=18.0, lag_s=0.15)
SINKING = ThrottleView(
    allowed=True,
    nowhere=True,
    home_m=nan,
    home_s=nan,
    room_m=inf,
    climb_mps=-1.0,
    airspeed_mps=9.0,
)
CARRIED = SINKING._replace(nowhere=False, climb_mps=0.0)


def after(
    view: ThrottleView,
    seconds: float,
    state: ThrottleState = NO_THROTTLE,
    params: ThrottleParams = PARAMS,
) -> ThrottleState:
    for _ in range(round(seconds / DT)):
        state = throttle_step(params, state, view, DT)
    return state


def test_where_the_air_carries_it_stays_closed() -> None:
    state = after(CARRIED, 5.0)
    assert (state.standing, state.called, state.fraction, state.used_s) == (
        CLOSED,
        NOT_CALLED,
        0,
        0,
    )


@pytest.mark.parametrize(
    ("view", "called"),
    [
        (SINKING, NOWHERE),
        (CARRIED._replace(home_m=-0.1, home_s=0.0), HOME),
        (CARRIED._replace(home_m=1.0, home_s=1.9), HOME),
        (CARRIED._replace(room_m=1.0, climb_mps=-0.6), LOW),
    ],
)
def test_what_calls_it_opens_it(view: ThrottleView, called: int) -> None:
    state = after(view, 0.5)
    assert (state.standing, state.called) == (OPEN, called)
    assert 0.0 < state.fraction <= 0.5 * THROTTLE_PER_S


@pytest.mark.parametrize(
    "view",
    [
        CARRIED._replace(home_m=nan, home_s=nan),
        CARRIED._replace(home_m=3.0, home_s=inf),
        CARRIED._replace(room_m=1.0, climb_mps=-0.4),
        CARRIED._replace(room_m=-1.0, climb_mps=0.1),  # low, and it climbs
    ],
)
def test_what_is_near_it_does_not(view: ThrottleView) -> None:
    assert after(view, 3.0).used_s == 0.0


def test_a_sink_shorter_than_a_third_of_a_second_does_not() -> None:
    low = CARRIED._replace(room_m=0.5, climb_mps=-0.6)
    state = NO_THROTTLE
    for _ in range(10):
        state = after(CARRIED, 0.5, after(low, 0.25, state))
    assert state.used_s == 0.0
    assert after(low, 0.35).used_s > 0.0


def test_it_goes_on_for_a_while_and_fades() -> None:
    opened = after(SINKING, 2.0)
    still = after(CARRIED, 0.95, opened)
    assert still.standing == OPEN
    assert still.fraction > 0.0
    assert after(CARRIED, 4.0, opened).standing == CLOSED
    fractions, state = [], opened
    for _ in range(800):
        state = throttle_step(PARAMS, state, CARRIED, DT)
        fractions.append(state.fraction)
    assert all(b >= a - 0.01 for a, b in itertools.pairwise(fractions))  # no step down


def test_each_call_begins_the_wait_for_the_next_again() -> None:
    """Gusts call by turns: the second counts from the last call, so that no pause closes it."""
    state = after(SINKING, 2.0)
    for _ in range(4):
        state = after(CARRIED, 0.6, state)
        assert (state.standing, state.called) == (OPEN, NOWHERE)
        state = after(SINKING, 0.1, state)


@pytest.mark.parametrize(
    "uncertain",
    [
        {"allowed": False},
        {"climb_mps": nan},
        {"airspeed_mps": nan},
        {"airspeed_mps": inf},
        {"airspeed_mps": 18.0},  # nothing is left of the thrust
    ],
)
def test_where_it_is_uncertain_it_is_closed_at_once(uncertain: dict[str, float]) -> None:
    opened = after(SINKING, 1.0)
    assert opened.fraction > 0.3
    state = throttle_step(PARAMS, opened, SINKING._replace(**uncertain), DT)  # type: ignore[arg-type]
    assert (state.fraction, state.integral_mps) == (0.0, 0.0)
    assert state.used_s == opened.used_s
    assert 0.0 < state.push_mps2 < opened.push_mps2 or opened.turns == 0.0  # it runs down


@given(
    st.lists(
        st.tuples(st.booleans(), st.booleans(), st.floats(-5, 5), st.floats(0.0, 0.1)), max_size=60
    ),
    st.floats(0.0, 1.0),
)
def test_what_is_used_is_the_integral_and_never_more_than_the_budget(
    ticks: list[tuple[bool, bool, float, float]], budget_s: float
) -> None:
    params = PARAMS._replace(budget_s=budget_s)
    state, integral_s = NO_THROTTLE, 0.0
    for allowed, nowhere, climb, dt in ticks:
        view = SINKING._replace(allowed=allowed, nowhere=nowhere, climb_mps=climb)
        before = state.fraction
        state = throttle_step(params, state, view, dt)
        integral_s += state.fraction * dt
        assert 0.0 <= state.fraction <= min(1.0, before + THROTTLE_PER_S * dt + 1e-12)
        assert state.used_s <= budget_s
        assert state.used_s == pytest.approx(integral_s, abs=1e-9)


def test_the_whole_budget_is_spent_and_then_it_is_reported() -> None:
    state, integral_s = NO_THROTTLE, 0.0
    for _ in range(6000):
        state = throttle_step(PARAMS._replace(budget_s=3.0), state, SINKING, DT)
        integral_s += state.fraction * DT
    assert integral_s == pytest.approx(3.0, abs=1e-9)
    assert (state.standing, state.used_s, state.fraction) == (USED_UP, 3.0, 0.0)
    more = after(SINKING, 1.0, state, PARAMS._replace(budget_s=5.0))
    assert more.standing == OPEN
    assert more.used_s > 3.0


def test_without_a_budget_it_is_off() -> None:
    state = after(SINKING, 5.0, params=PARAMS._replace(budget_s=0.0))
    assert state == NO_THROTTLE
    assert closed(PARAMS, state, DT).standing == CLOSED
    assert state.standing == OFF


def test_it_holds_what_sinks_with_the_least_that_is_needed() -> None:
    """The aircraft as the law takes it: a first-order lag, sinking by 1 m/s without power."""
    state, climb = NO_THROTTLE, -1.0
    for _ in range(4000):
        state = throttle_step(PARAMS, state, SINKING._replace(climb_mps=climb), DT)
        climb += DT * 6.0 * (state.climb_mps - 1.0 - climb)
    assert climb == pytest.approx(0.3, abs=0.01)
    assert state.fraction == pytest.approx(1.3 / full_climb(PARAMS, 9.0), rel=0.01)
    assert state.pitch_rad == pytest.approx(state.climb_mps / 9.0)


def test_what_it_can_hold() -> None:
    assert full_climb(PARAMS, 9.0) == pytest.approx(5.7 * 0.5 * 9.0 / 9.80665)
    assert can_hold(PARAMS, 0.0, -1.0, 9.0)
    assert not can_hold(PARAMS, 0.0, -2.5, 9.0)  # weaker than that
    assert not can_hold(PARAMS._replace(most=0.3), 0.0, -1.0, 9.0)
    assert not can_hold(PARAMS, 20.0, -1.0, 9.0)
    assert not can_hold(PARAMS, PARAMS.budget_s - 0.01, -1.0, 9.0)  # not for long
    assert not can_hold(PARAMS, 0.0, -1.0, nan)
    assert not can_hold(PARAMS, 0.0, nan, 9.0)


@given(st.floats(), st.floats(), st.floats(), st.floats())
def test_the_envelope_bounds_whatever_is_wanted(
    last: float, wanted: float, most: float, dt: float
) -> None:
    given_ = limit_throttle(last, wanted, most, dt)
    assert 0.0 <= given_ <= 1.0
    if not (last == last and wanted == wanted and most == most):
        assert given_ == 0.0


def test_the_envelope_opens_slowly_and_closes_at_once() -> None:
    assert limit_throttle(0.0, 1.0, 1.0, 0.1) == pytest.approx(0.2)
    assert limit_throttle(0.0, 1.0, 1.0, nan) == 0.0
    assert limit_throttle(0.5, 1.0, 0.4, 0.1) == 0.4
    assert limit_throttle(1.0, 0.0, 1.0, 0.1) == 0.0
