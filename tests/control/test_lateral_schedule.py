"""The lateral schedule: what it keeps over airspeed, latency and age, and that it never steps."""

from __future__ import annotations

from math import inf, isfinite, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.control.heading import HeadingGains
from tgl_soar.control.lateral_schedule import (
    LATE_MIN,
    LateralSchedule,
    heading_gains,
    lateral_bandwidth,
    lateral_schedule_of,
    roll_gains,
    sideways_gains,
)
from tgl_soar.control.pid import PidGains
from tgl_soar.control.pitch_schedule import AGE_FOUND_S, HOLD_S

PID = PidGains(
    kp=2.5,
    ki=1.5,
    kd=0.13,
    rate_filter_radps=250.0,
    integral_max=1.0,
    output_min=-1.0,
    output_max=1.0,
)
HEADING = HeadingGains(PID._replace(ki=0.0), -5.5, 3.0, 0.35)
SPEED, LATE_S = 8.7, 0.0585
AS_FOUND = lateral_schedule_of(SPEED, LATE_S, LATE_S)
UNSCHEDULED = lateral_schedule_of(0.0, LATE_S, 2.0 * LATE_S)


def test_where_they_were_found_gains_are_as_found() -> None:
    f = lateral_bandwidth(AS_FOUND, 0.005)
    assert f == 1.0
    assert roll_gains(PID, AS_FOUND, f, SPEED) == pytest.approx(PID)
    assert heading_gains(HEADING, AS_FOUND, f, SPEED).pid == pytest.approx(HEADING.pid)
    assert sideways_gains(PID, AS_FOUND, f) == pytest.approx(PID)
    assert roll_gains(PID, AS_FOUND, f, nan) == pytest.approx(PID)


@pytest.mark.parametrize("speed", [7.6, 10.0, 14.0])
def test_roll_and_yaw_rate_cross_over_where_they_did(speed: float) -> None:
    """A surface's effect grows with V², roll's damping with V: effect kd stays, and effect kp over
    damping."""
    times = speed / SPEED
    roll = roll_gains(PID, AS_FOUND, 1.0, speed)
    assert roll.kd * times**2 == pytest.approx(PID.kd)
    assert roll.kp * times**2 / times == pytest.approx(PID.kp)
    yaw = heading_gains(HEADING, AS_FOUND, 1.0, speed)
    assert yaw.pid.kd * times**2 == pytest.approx(PID.kd)
    assert yaw[1:] == HEADING[1:]


def test_later_surfaces_are_flown_with_less_and_earlier_ones_with_no_more() -> None:
    twice = lateral_schedule_of(SPEED, LATE_S, 2.0 * LATE_S + HOLD_S)
    assert lateral_bandwidth(twice, 0.0) == pytest.approx(0.5)
    assert roll_gains(PID, twice, 0.5, SPEED).ki == pytest.approx(0.25 * PID.ki)
    assert sideways_gains(PID, twice, 0.5).kd == pytest.approx(0.5 * PID.kd)
    assert lateral_bandwidth(lateral_schedule_of(SPEED, LATE_S, 0.01), 0.0) == 1.0
    assert lateral_bandwidth(lateral_schedule_of(SPEED, 0.0, 0.1), 0.0) == 1.0  # as late as these


def test_old_attitudes_count_as_late_surfaces() -> None:
    old = AGE_FOUND_S + LATE_S + HOLD_S
    assert lateral_bandwidth(AS_FOUND, old) == pytest.approx(0.5)
    assert lateral_bandwidth(AS_FOUND, AGE_FOUND_S) == 1.0
    assert lateral_bandwidth(AS_FOUND, 10.0) == LATE_MIN


def test_without_a_speed_there_is_no_schedule() -> None:
    assert roll_gains(PID, UNSCHEDULED, 0.5, 14.0) is PID
    assert heading_gains(HEADING, UNSCHEDULED, 0.5, 14.0) is HEADING
    assert sideways_gains(PID, UNSCHEDULED, 0.5) is PID


@given(
    speed=st.floats(allow_nan=True, allow_infinity=True),
    found=st.floats(1.0, 60.0),
    age=st.floats(0.0, 1.0),
)
def test_any_airspeed_gives_finite_gains(speed: float, found: float, age: float) -> None:
    schedule = LateralSchedule(found, LATE_S, LATE_S)
    f = lateral_bandwidth(schedule, age)
    assert all(map(isfinite, roll_gains(PID, schedule, f, speed)))
    assert all(map(isfinite, heading_gains(HEADING, schedule, f, speed).pid))


@given(speed=st.floats(3.0, 25.0))
def test_gains_do_not_step_with_airspeed(speed: float) -> None:
    """A change of 1 cm/s changes none by 1 %."""
    here, near = (roll_gains(PID, AS_FOUND, 1.0, v) for v in (speed, speed + 0.01))
    assert near.kd == pytest.approx(here.kd, rel=0.01)
    assert near.kp == pytest.approx(here.kp, rel=0.01)
    assert inf > here.kd > 0.0
