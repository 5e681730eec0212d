"""Pitch to elevator and roll to aileron: signs, limits, and a rigid body that they turn."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.control.attitude import attitude_step
from tgl_soar.control.pid import PidGains, PidState

DT = 0.005
GAINS = PidGains(
    kp=2.0,
    ki=3.0,
    kd=0.2,
    rate_filter_radps=250.0,
    integral_max=1.0,
    output_min=-1.0,
    output_max=1.0,
)
REST = PidState(0.0, 0.0)

angles = st.floats(-1.5, 1.5)
rates = st.floats(-20.0, 20.0)


def test_below_its_setpoint_the_angle_is_pushed_up() -> None:
    # Pitch below its setpoint: elevator up; left wing down: aileron to the right.
    _, below = attitude_step(GAINS, REST, 0.1, 0.0, 0.0, 0.0, DT, 0)
    _, above = attitude_step(GAINS, REST, -0.1, 0.0, 0.0, 0.0, DT, 0)
    assert above.output < 0.0 < below.output


def test_a_rate_is_damped() -> None:
    _, terms = attitude_step(GAINS, REST, 0.0, 0.0, 1.0, 0.0, DT, 0)
    assert terms.d < 0.0
    assert terms.output < 0.0


def test_a_step_of_the_setpoint_gives_no_kick() -> None:
    # The derivative uses the gyro alone: it is the same before and after the step.
    _, before = attitude_step(GAINS, REST, 0.0, 0.0, 0.3, 0.0, DT, 0)
    _, after = attitude_step(GAINS, REST, 0.5, 0.0, 0.3, 0.0, DT, 0)
    assert after.d == before.d


@given(
    setpoint=st.floats(-1e6, 1e6),
    angle=angles,
    rate=st.floats(-1e6, 1e6),
    trim=st.floats(-1.0, 1.0),
    blocked=st.sampled_from([-1, 0, 1]),
)
def test_the_surface_stays_within_its_travel(
    setpoint: float, angle: float, rate: float, trim: float, blocked: int
) -> None:
    _, terms = attitude_step(GAINS, REST, setpoint, angle, rate, trim, DT, blocked)
    assert -1.0 <= terms.output <= 1.0


def pitch_after(seconds: float, moment_radps2: float, blocked_at: float) -> tuple[float, float]:
    """Pitch [rad] and largest pitch after a setpoint of 0.1 rad, of the published airframe.

    θ'' = 31 δ - ω² θ - 2 ζ ω θ' + moment, short period ω = 11 rad/s, ζ = 0.75, and an elevator
    that goes no further than ±blocked_at.
    """
    state, theta, rate, largest, blocked = REST, 0.0, 0.0, 0.0, 0
    for _ in range(round(seconds / DT)):
        state, terms = attitude_step(GAINS, state, 0.1, theta, rate, 0.0, DT, blocked)
        delta = max(-blocked_at, min(blocked_at, terms.output))
        blocked = 1 if terms.output > delta else -1 if terms.output < delta else 0
        acceleration = 31.0 * delta - 121.0 * theta - 16.5 * rate + moment_radps2
        rate += acceleration * DT
        theta += rate * DT
        largest = max(largest, theta)
    return theta, largest


@pytest.mark.parametrize("moment_radps2", [-5.0, 0.0, 5.0])
def test_the_pitch_is_held_against_a_moment(moment_radps2: float) -> None:
    # The integral holds what static stability (121 · 0.1) and the moment ask for: 0.55 of the
    # travel at most.  Its slowest root, ki · 31 / (121 + kp · 31) = 0.5 /s, gives 1 % after 9 s.
    theta, largest = pitch_after(12.0, moment_radps2, 1.0)
    assert theta == pytest.approx(0.1, abs=0.001)
    assert largest < 0.13


def test_an_elevator_at_its_stop_winds_nothing_up() -> None:
    # A stop at 0.2 allows 31 · 0.2 / 121 = 0.051 rad; the loop asks for more all the time.
    state, theta, rate = REST, 0.0, 0.0
    blocked = 0
    for k in range(round(40.0 / DT)):
        setpoint = 0.1 if k * DT < 30.0 else 0.0
        state, terms = attitude_step(GAINS, state, setpoint, theta, rate, 0.0, DT, blocked)
        delta = max(-0.2, min(0.2, terms.output))
        blocked = 1 if terms.output > delta else -1 if terms.output < delta else 0
        rate += (31.0 * delta - 121.0 * theta - 16.5 * rate) * DT
        theta += rate * DT
        if setpoint == 0.1:
            assert theta < 0.06
            assert state.integral <= 0.2 + 3.0 * 0.1 * DT
    assert theta == pytest.approx(0.0, abs=0.002)
