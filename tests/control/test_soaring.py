"""e_rho to pitch: signs, limits, slew, and the reset at engagement, with a small glider."""

from __future__ import annotations

from math import nan, radians

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.control.pid import PidGains, PidState
from tgl_soar.control.soaring import (
    SoaringGains,
    SoaringState,
    TrimGains,
    TrimState,
    gliding_step,
    holding_step,
    soaring_reset,
    soaring_step,
    trim_step,
)

DT = 0.005
GAINS = SoaringGains(
    PidGains(
        kp=0.6,
        ki=0.1,
        kd=0.25,
        rate_filter_radps=40.0,
        integral_max=radians(8.0),
        output_min=radians(-15.0),
        output_max=radians(10.0),
    ),
    radians(60.0),
)
TRIM_RAD = radians(-2.0)
INSTANT = GAINS._replace(slew_radps=1e6)

distances = st.floats(-5.0, 5.0)
rates = st.floats(-5.0, 5.0)


def at_trim(gains: SoaringGains = GAINS) -> SoaringState:
    return soaring_reset(gains, TRIM_RAD, 0.0, TRIM_RAD)


def test_upstream_of_the_line_the_nose_goes_up() -> None:
    up, _ = soaring_step(INSTANT, at_trim(), TRIM_RAD, 0.05, 0.0, DT, 0)
    down, _ = soaring_step(INSTANT, at_trim(), TRIM_RAD, -0.05, 0.0, DT, 0)
    assert down.pitch_setpoint_rad < TRIM_RAD < up.pitch_setpoint_rad


def test_drifting_upstream_the_nose_goes_up_before_there_is_a_distance() -> None:
    state = at_trim(INSTANT)
    for _ in range(20):
        state, terms = soaring_step(INSTANT, state, TRIM_RAD, 0.0, 0.2, DT, 0)
    assert terms.d > 0.0
    assert state.pitch_setpoint_rad > TRIM_RAD


@given(
    e=st.floats(-1e6, 1e6),
    rate=st.floats(-1e6, 1e6),
    start=st.floats(-1.0, 1.0),
    dt=st.floats(0.0, 0.1),
    blocked=st.sampled_from([-1, 0, 1]),
)
def test_value_and_rate_of_the_setpoint_are_limited(
    e: float, rate: float, start: float, dt: float, blocked: int
) -> None:
    state = soaring_reset(GAINS, TRIM_RAD, 0.0, start)
    new, terms = soaring_step(GAINS, state, TRIM_RAD, e, rate, dt, blocked)
    assert GAINS.pid.output_min <= terms.output <= GAINS.pid.output_max
    low, high = GAINS.pid.output_min - 1e-12, GAINS.pid.output_max + 1e-12
    assert low <= new.pitch_setpoint_rad <= high
    change = new.pitch_setpoint_rad - state.pitch_setpoint_rad
    assert abs(change) <= GAINS.slew_radps * dt + 1e-12
    held_back = terms.output - new.pitch_setpoint_rad
    if abs(held_back) > 1e-12:  # more than rounding
        assert new.slewing == (1 if held_back > 0.0 else -1)


def test_a_step_of_e_rho_takes_the_time_that_the_slew_says() -> None:
    # 0.15 m asks for 0.09 rad more; at 60 deg/s that takes 86 ms.
    gains = GAINS._replace(pid=GAINS.pid._replace(ki=0.0))
    state, ticks = at_trim(gains), 0
    while True:
        state, terms = soaring_step(gains, state, TRIM_RAD, 0.15, 0.0, DT, 0)
        ticks += 1
        if state.slewing == 0:
            break
    assert terms.output == pytest.approx(TRIM_RAD + 0.6 * 0.15)
    assert ticks * DT == pytest.approx(0.09 / radians(60.0), abs=DT)


@pytest.mark.parametrize("sign", [-1, 1])
def test_the_integral_waits_while_the_setpoint_slews(sign: int) -> None:
    slow = GAINS._replace(slew_radps=radians(1.0))
    state = at_trim(slow)
    for _ in range(100):
        state, terms = soaring_step(slow, state, TRIM_RAD, sign * 0.1, 0.0, DT, 0)
    # One step before the slew is known of; then none.
    assert abs(terms.i) <= 0.1 * 0.1 * DT + 1e-15
    # It may come back at once.
    state, terms = soaring_step(slow, state, TRIM_RAD, -sign * 0.1, 0.0, DT, 0)
    assert terms.i * sign <= 0.0


@pytest.mark.parametrize("sign", [-1, 1])
def test_the_integral_waits_while_the_elevator_is_blocked(sign: int) -> None:
    state, _ = soaring_step(INSTANT, at_trim(), TRIM_RAD, sign * 0.02, 0.0, DT, sign)
    assert state.pid.integral == 0.0
    state, _ = soaring_step(INSTANT, at_trim(), TRIM_RAD, sign * 0.02, 0.0, DT, -sign)
    assert state.pid.integral == pytest.approx(sign * 0.1 * 0.02 * DT)


@given(rate=st.floats(-0.3, 0.3), pitch=st.floats(-0.25, 0.17))
def test_at_engagement_the_setpoint_goes_on_from_the_pitch_flown(rate: float, pitch: float) -> None:
    state = soaring_reset(GAINS, TRIM_RAD, rate, pitch)
    assert state.pitch_setpoint_rad == pitch
    new, _ = soaring_step(GAINS, state, TRIM_RAD, 0.0, rate, 0.0, 0)
    assert new.pitch_setpoint_rad == pitch
    # From there the law acts at once on a drift, as fast as the slew lets it.
    new, terms = soaring_step(GAINS, state, TRIM_RAD, 0.0, rate, DT, 0)
    assert terms.d == pytest.approx(GAINS.pid.kd * rate)
    assert abs(new.pitch_setpoint_rad - pitch) <= GAINS.slew_radps * DT + 1e-12
    # Without one it stays, as far as the integral reaches.
    if abs(pitch - TRIM_RAD) <= GAINS.pid.integral_max:
        undisturbed = soaring_reset(GAINS, TRIM_RAD, 0.0, pitch)
        new, _ = soaring_step(GAINS, undisturbed, TRIM_RAD, 0.0, 0.0, DT, 0)
        assert new.pitch_setpoint_rad == pytest.approx(pitch, abs=1e-12)


@pytest.mark.parametrize(("pitch", "limit"), [(0.5, radians(10.0)), (-0.9, radians(-15.0))])
def test_a_pitch_beyond_the_limits_is_not_gone_on_with(pitch: float, limit: float) -> None:
    assert soaring_reset(GAINS, TRIM_RAD, 0.0, pitch).pitch_setpoint_rad == limit


@given(integral=st.floats(-1.0, 1.0), start=st.floats(-0.25, 0.17))
def test_holding_slews_to_what_the_line_asks_for_undisturbed(integral: float, start: float) -> None:
    state = SoaringState(PidState(integral, 0.7), start, 1)
    low, high = GAINS.pid.output_min, GAINS.pid.output_max
    expected = max(low, min(high, TRIM_RAD + integral))
    for _ in range(round(0.5 / DT)):  # 0.42 rad at 60 deg/s takes 0.4 s
        before = state.pitch_setpoint_rad
        state, terms = holding_step(GAINS, state, TRIM_RAD, DT)
        assert abs(state.pitch_setpoint_rad - before) <= GAINS.slew_radps * DT + 1e-12
    assert terms.output == expected
    assert state.pitch_setpoint_rad == pytest.approx(expected, abs=1e-12)
    assert state.pid == PidState(integral, 0.0)


@pytest.mark.parametrize(
    ("pitch_deg", "flown_deg"), [(3.0, 3.0), (-6.0, -6.0), (12.0, 10.0), (-20.0, -15.0)]
)
def test_recovering_slews_to_the_pitch_that_is_given_and_keeps_what_was_learnt(
    pitch_deg: float, flown_deg: float
) -> None:
    """At 60 deg/s, 0.3 degrees in a tick."""
    state = SoaringState(PidState(0.02, 0.7), 0.0, 0)
    side = 1 if pitch_deg > 0.0 else -1
    state, terms = gliding_step(GAINS, state, radians(pitch_deg), DT)
    assert terms == pytest.approx((radians(flown_deg), 0.0, 0.0, 0.0, radians(flown_deg), 0))
    assert state.pitch_setpoint_rad == pytest.approx(side * radians(0.3))
    assert (state.slewing, state.pid) == (side, PidState(0.02, 0.0))
    for _ in range(60):
        state, _ = gliding_step(GAINS, state, radians(pitch_deg), DT)
    assert state.pitch_setpoint_rad == pytest.approx(radians(flown_deg))
    assert state.slewing == 0


def test_the_line_is_held_against_a_steady_push() -> None:
    """A glider pitched up by theta loses g theta of speed, and drifts back over the ground.

    e'' = -9.81 theta - 0.35 e' + push; drag damps with about 2 g / (V L/D) = 0.35 1/s.  The push,
    1.5 % of gravity, stands for drag that changed; the integral meets it in the end.
    """
    gains = INSTANT
    state, e, v = at_trim(gains), 0.0, 0.0
    largest = 0.0
    for k in range(round(60.0 / DT)):
        state, _ = soaring_step(gains, state, TRIM_RAD, e, v, DT, 0)
        push = 0.15 if k > 200 else 0.0
        theta = state.pitch_setpoint_rad - TRIM_RAD
        v += (-9.81 * theta - 0.35 * v + push) * DT
        e += v * DT
        largest = max(largest, abs(e))
    # Proportional control alone would stay off by 0.15 / (9.81 · 0.6) = 2.5 cm.
    assert 0.015 < largest < 0.04
    assert abs(e) < 0.001
    assert state.pid.integral == pytest.approx(0.15 / 9.81, rel=0.02)


# --- theta_0 and gusts ------------------------------------------------------------------------

TRIM = TrimGains(-0.03, 1.0, 2.0, 0.5)


def test_theta_0_is_the_constant_unless_a_fraction_of_the_glide_is_asked_for() -> None:
    state, gust = trim_step(TRIM._replace(fraction=0.0), TrimState(nan, nan), 0.1, 1.0, 9.0, DT)
    assert (state.pitch_rad, gust) == (-0.03, 0.0)
    state, _ = trim_step(TRIM, TrimState(nan, nan), 0.1, 1.0, 9.0, DT)
    assert state.pitch_rad == pytest.approx(0.1)


def test_theta_0_moves_without_a_step_and_arrives() -> None:
    state = TrimState(-0.03, 1.0)
    steps = []
    for _ in range(round(10.0 / DT)):
        new, _ = trim_step(TRIM, state, 0.05, 1.0, 9.0, DT)
        steps.append(new.pitch_rad - state.pitch_rad)
        state = new
    assert max(steps) <= 0.08 * DT / 2.0
    assert state.pitch_rad == pytest.approx(0.05, abs=0.001)


def test_a_gust_is_met_by_a_fraction_of_its_incidence_and_then_forgotten() -> None:
    state, gust = trim_step(TRIM, TrimState(-0.03, 1.0), -0.03, 1.9, 9.0, DT)
    assert gust == pytest.approx(-0.5 * 0.9 / 9.0, rel=0.01)
    for _ in range(round(20.0 / DT)):
        state, gust = trim_step(TRIM, state, -0.03, 1.9, 9.0, DT)
    assert gust == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize("airspeed_mps", [nan, 0.0])
def test_without_an_estimate_of_the_air_nothing_moves(airspeed_mps: float) -> None:
    state, gust = trim_step(TRIM, TrimState(0.02, 1.0), nan, nan, airspeed_mps, DT)
    assert state.pitch_rad == 0.02
    assert gust == 0.0
