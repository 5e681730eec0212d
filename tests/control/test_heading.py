"""Heading to rudder: signs, limits, and lateral flight of a linear model."""

from __future__ import annotations

from math import atan, pi, radians, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.control.heading import (
    HeadingGains,
    heading_setpoint,
    heading_step,
    leading_speed,
    sideways_held,
    sideways_step,
)
from tgl_soar.control.pid import PidGains, PidState

DT = 0.005
REST = PidState(0.0, 0.0)
GAINS = HeadingGains(
    PidGains(
        kp=1.2,
        ki=0.0,
        kd=0.2,
        rate_filter_radps=250.0,
        integral_max=0.0,
        output_min=-1.0,
        output_max=1.0,
    ),
    -8.0,
    3.0,
    radians(20.0),
)

metres = st.floats(-1e3, 1e3)


def test_right_of_the_middle_it_heads_left() -> None:
    assert heading_setpoint(GAINS, 0.0, 0.5) < 0.0 < heading_setpoint(GAINS, 0.0, -0.5)
    assert heading_setpoint(GAINS, 0.0, 0.0) == 0.0


def test_it_looks_at_the_waypoint() -> None:
    # 8 m upwind and 1 m to the right of the middle: the waypoint is atan(1/8) to the left.
    assert heading_setpoint(GAINS, 0.0, 1.0) == pytest.approx(-atan(1.0 / 8.0))


def test_heading_left_of_its_setpoint_gives_right_rudder() -> None:
    _, right = heading_step(GAINS, REST, 0.1, 0.0, 0.0, 0.0, DT)
    _, left = heading_step(GAINS, REST, -0.1, 0.0, 0.0, 0.0, DT)
    assert left.output < 0.0 < right.output
    _, damped = heading_step(GAINS, REST, 0.0, 0.0, 1.0, 0.0, DT)
    assert damped.output < 0.0  # yawing right: left rudder


@given(x=metres, y=metres)
def test_the_setpoint_is_limited_and_always_towards_the_middle(x: float, y: float) -> None:
    setpoint = heading_setpoint(GAINS, x, y)
    assert abs(setpoint) <= GAINS.heading_max_rad
    assert setpoint * y <= 0.0  # also where the waypoint lies downwind


@given(heading=st.floats(-pi, pi), turns=st.integers(-2, 2))
def test_it_turns_the_short_way(heading: float, turns: int) -> None:
    _, terms = heading_step(GAINS, REST, 0.0, heading, 0.0, 0.0, DT)
    _, same = heading_step(GAINS, REST, 0.0, heading + 2.0 * pi * turns, 0.0, 0.0, DT)
    if abs(heading) < pi - 1e-6:  # straight downwind both ways are as short
        assert same.p == pytest.approx(terms.p, abs=1e-9)
        assert terms.p == pytest.approx(-1.2 * heading, abs=1e-9)


@given(
    setpoint=st.floats(-10, 10),
    heading=st.floats(-10, 10),
    rate=st.floats(-1e6, 1e6),
    trim=st.floats(-1, 1),
)
def test_the_rudder_stays_within_its_travel(
    setpoint: float, heading: float, rate: float, trim: float
) -> None:
    _, terms = heading_step(GAINS, REST, setpoint, heading, rate, trim, DT)
    assert -1.0 <= terms.output <= 1.0


def lateral_path(gains: HeadingGains, y: float, x: float, seconds: float) -> list[float]:
    """y [m] over time of a body that is blown back as fast as it flies: y' = V psi,
    psi'' = 18 rudder - 3 psi', V = 8.6 m/s (the published yaw effectiveness)."""
    state, psi, rate, path = REST, 0.0, 0.0, []
    for _ in range(round(seconds / DT)):
        setpoint = heading_setpoint(gains, x, y)
        state, terms = heading_step(gains, state, setpoint, psi, rate, 0.0, DT)
        rate += (18.0 * terms.output - 3.0 * rate) * DT
        psi += rate * DT
        y += 8.6 * psi * DT
        path.append(y)
    return path


@pytest.mark.parametrize("y", [-1.0, -0.1, 0.1, 1.0])
def test_the_waypoint_brings_it_to_the_middle(y: float) -> None:
    # The lateral loop is y' = -(V/R) y with R/V = 0.93 s, behind a yaw loop of 4.6 rad/s, whose
    # lag of 0.3 s makes the pair slightly oscillatory: one overshoot below a quarter.
    path = lateral_path(GAINS, y, 0.0, 10.0)
    assert abs(path[-1]) < 0.01 * abs(y)
    assert min(p / y for p in path) > -0.25
    time_to_middle = next(k for k, p in enumerate(path) if p / y < 0.37) * DT
    assert time_to_middle == pytest.approx(8.0 / 8.6 + 0.3, abs=0.5)


def test_a_waypoint_downwind_diverges_which_is_why_the_distance_has_a_floor() -> None:
    downwind = GAINS._replace(waypoint_x_m=8.0)
    no_floor = downwind._replace(distance_min_m=-1e9)
    assert abs(lateral_path(no_floor, 0.1, 0.0, 5.0)[-1]) > 1.0
    # With the floor it looks 3 m ahead: a tight loop, but one that does not run away.
    assert max(abs(p) for p in lateral_path(downwind, 0.1, 0.0, 20.0)) <= 0.2


SIDEWAYS = PidGains(
    kp=0.0,
    ki=0.04,
    kd=0.2,
    rate_filter_radps=20.0,
    integral_max=0.0875,
    output_min=-0.175,
    output_max=0.175,
)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_right_of_the_middle_it_banks_left(side: float) -> None:
    setpoint = heading_setpoint(GAINS, 0.0, side * 0.5)  # y > 0: the nose looks left
    _, terms = sideways_step(SIDEWAYS, REST, setpoint, 8.5, 0.0, DT, 0)
    assert terms.output * side < 0.0
    leading = 8.5 * sin(setpoint)  # it flies as fast to the middle as its nose leads it there
    _, terms = sideways_step(SIDEWAYS, REST, setpoint, 8.5, leading, DT, 0)
    assert terms.output == 0.0
    _, terms = sideways_step(SIDEWAYS, REST, setpoint, 8.5, 0.0, 0.0, 0)
    assert terms.output == 0.0  # the first tick, in which no time has passed, begins level


def test_a_bank_is_learnt_bounded_and_kept_without_a_position() -> None:
    state = REST
    for _ in range(20_000):
        state, terms = sideways_step(SIDEWAYS, state, 0.0, 8.5, 0.1, DT, 0)
        assert abs(terms.output) <= 0.175
    assert state.integral == -0.0875
    assert sideways_held(state).output == -0.0875
    before = state
    state, _ = sideways_step(SIDEWAYS, state, 0.0, 8.5, -0.1, DT, 1)  # can roll no further right
    assert state.integral == before.integral


def test_the_way_to_the_middle_is_no_faster_than_the_banks_loop() -> None:
    """It takes R / V, the bank's loop 1 / (g kv): in fast air the bank follows less speed."""
    distance, kv = 6.0, 0.15
    x_m = GAINS.waypoint_x_m + distance
    assert leading_speed(GAINS, kv, x_m, 8.0) == 8.0
    assert leading_speed(GAINS, kv, x_m, 14.0) == pytest.approx(9.80665 * kv * distance)
    near = GAINS.waypoint_x_m + 0.1 * GAINS.distance_min_m
    assert leading_speed(GAINS, kv, near, 14.0) == pytest.approx(
        9.80665 * kv * GAINS.distance_min_m
    )
    assert leading_speed(GAINS, 0.0, x_m, 14.0) == 14.0  # no bank follows it
