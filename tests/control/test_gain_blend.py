"""Two sets of gains: what the law is between them, and that no command steps."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.control.attitude import attitude_step
from tgl_soar.control.gain_blend import (
    DOWN_PER_S,
    UP_PER_S,
    pid_between,
    soaring_between,
    weight_step,
)
from tgl_soar.control.pid import PidGains, PidState
from tgl_soar.control.soaring import SoaringGains, SoaringState, soaring_step

DT = 0.005
PLAIN = SoaringGains(
    PidGains(
        kp=0.73,
        ki=0.24,
        kd=0.27,
        rate_filter_radps=47.0,
        integral_max=0.14,
        output_min=-0.21,
        output_max=0.1,
    ),
    2.1,
)
TRIM_RAD = -0.026
IMU = PLAIN._replace(pid=PLAIN.pid._replace(kp=1.8, ki=0.2, kd=0.355, rate_filter_radps=59.0))
PITCH = PidGains(
    kp=5.0,
    ki=4.2,
    kd=0.15,
    rate_filter_radps=251.0,
    integral_max=1.0,
    output_min=-1.0,
    output_max=1.0,
)
PITCH_IMU = PITCH._replace(kp=9.2, ki=8.4, kd=0.31)


@given(st.lists(st.booleans(), max_size=400), st.floats(0.0, 0.1))
def test_the_fraction_follows_and_stays_within_its_rates(flags: list[bool], dt: float) -> None:
    weight = 0.0
    for inertial in flags:
        after = weight_step(weight, inertial, dt)
        assert 0.0 <= after <= 1.0
        assert -DOWN_PER_S * dt - 1e-12 <= after - weight <= UP_PER_S * dt + 1e-12
        assert (after >= weight) if inertial else (after <= weight)
        weight = after


def test_it_comes_in_half_a_second_and_goes_in_a_tenth() -> None:
    assert weight_step(0.3, True, 0.1) == pytest.approx(0.5)
    assert weight_step(0.9, True, 0.1) == 1.0
    assert weight_step(0.7, False, 0.01) == pytest.approx(0.6)
    assert weight_step(0.05, False, 0.01) == 0.0


def test_the_fraction_arrives_and_leaves_faster_than_it_came() -> None:
    weight, up, down = 0.0, 0, 0
    while weight < 1.0:
        weight, up = weight_step(weight, True, DT), up + 1
    while weight > 0.0:
        weight, down = weight_step(weight, False, DT), down + 1
    assert up * DT == pytest.approx(1.0 / UP_PER_S, abs=2 * DT)
    assert down * DT == pytest.approx(1.0 / DOWN_PER_S, abs=2 * DT)


def test_at_the_ends_the_sets_are_as_they_were_made() -> None:
    assert soaring_between(PLAIN, IMU, 0.0) is PLAIN
    assert soaring_between(PLAIN, IMU, 1.0) is IMU
    assert pid_between(PITCH, PITCH_IMU, 0.0) is PITCH
    assert pid_between(PITCH, PITCH_IMU, 1.0) is PITCH_IMU


@given(st.floats(0.0, 1.0))
def test_between_the_ends_every_gain_is_on_the_straight_line(weight: float) -> None:
    between = soaring_between(PLAIN, IMU, weight)
    for plain, imu, now in zip(PLAIN.pid, IMU.pid, between.pid, strict=True):
        assert now == pytest.approx(plain + weight * (imu - plain))
    assert between[1:] == PLAIN[1:]


@given(
    integral=st.floats(-0.05, 0.05),
    e=st.floats(-0.02, 0.02),
    rate=st.floats(-0.1, 0.1),
    up=st.booleans(),
)
def test_a_switch_in_steady_flight_moves_the_pitch_setpoint_no_faster_than_the_gains(
    integral: float, e: float, rate: float, up: bool
) -> None:
    """A steady distance and rate: 2 cm and 0.1 m/s, what 3 % turbulence gives.

    In one tick the weight moves by 0.05 at most: the setpoint by 0.05 (1.07 · 0.02 + 0.085 · 0.1)
    = 1.5 mrad, and by what the integral adds anyhow, 0.24 · 0.02 · 5 ms.  On the line and at rest
    it does not move at all.
    """
    weight = 0.0 if up else 1.0
    gains = soaring_between(PLAIN, IMU, weight)
    pitch = TRIM_RAD + gains.pid.kp * e + integral + gains.pid.kd * rate
    state = SoaringState(PidState(integral, rate), pitch, 0)
    for _ in range(200):
        weight = weight_step(weight, up, DT)
        gains = soaring_between(PLAIN, IMU, weight)
        after, _ = soaring_step(gains, state, TRIM_RAD, e, rate, DT, 0)
        change = abs(after.pitch_setpoint_rad - state.pitch_setpoint_rad)
        assert change <= 0.05 * (1.07 * abs(e) + 0.085 * abs(rate)) + 0.24 * abs(e) * DT + 1e-12
        state = after


@given(integral=st.floats(-0.5, 0.5), error=st.floats(-0.01, 0.01), up=st.booleans())
def test_a_switch_in_steady_flight_moves_the_elevator_no_faster_than_the_gains(
    integral: float, error: float, up: bool
) -> None:
    """Half a degree of pitch error: 0.05 · 4.2 · 0.01 = 2 thousandths of the travel in a tick."""
    weight = 0.0 if up else 1.0
    state = PidState(integral, 0.0)
    _, before = attitude_step(
        pid_between(PITCH, PITCH_IMU, weight), state, error, 0.0, 0.0, 0.0, 0.0, 0
    )
    output = before.output
    for _ in range(200):
        weight = weight_step(weight, up, DT)
        gains = pid_between(PITCH, PITCH_IMU, weight)
        state, terms = attitude_step(gains, state, error, 0.0, 0.0, 0.0, DT, 0)
        assert abs(terms.output - output) <= (0.05 * 4.2 + 8.4 * DT) * abs(error) + 1e-12
        output = terms.output
