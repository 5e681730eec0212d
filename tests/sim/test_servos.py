"""Servos: the closed form against the equation, its limits, and its delay."""

from __future__ import annotations

from math import exp, inf, nan

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.sim.servos import (
    ServoParams,
    ServoState,
    servo_moved,
    servo_params,
    servo_start,
    servo_step,
)

TABLE = load_airframe(shipped("airframes/eclipson_c.toml")).model
SERVO = servo_params(TABLE)
DT_S = 0.005


def test_the_airframe_file_has_the_published_servo() -> None:
    assert SERVO.lag_radps == 54.0
    assert SERVO.rate_per_s == 9.0


@pytest.mark.parametrize("command", [0.05, 0.5, -1.0])
def test_the_closed_form_solves_the_equation(command: float) -> None:
    # Euler in steps of 1 µs errs by a dt / 2 = 3e-5 of what is left to go.
    fine, dt = -0.2, 1e-6
    for _ in range(40_000):
        wanted = SERVO.lag_radps * (command - fine)
        fine += dt * min(SERVO.rate_per_s, max(-SERVO.rate_per_s, wanted))
    assert servo_moved(SERVO, -0.2, command, 0.04) == pytest.approx(fine, abs=5e-5)


@given(
    st.floats(-1.0, 1.0),
    st.floats(-1.5, 1.5),
    st.floats(1e-4, 0.3),
    st.floats(0.0, 1.0),
)
def test_two_parts_of_a_step_make_the_step(
    deflection: float, command: float, dt_s: float, fraction: float
) -> None:
    first = servo_moved(SERVO, deflection, command, fraction * dt_s)
    both = servo_moved(SERVO, first, command, (1.0 - fraction) * dt_s)
    assert both == pytest.approx(servo_moved(SERVO, deflection, command, dt_s), abs=1e-12)
    assert abs(both) <= SERVO.travel


def test_a_small_command_is_a_first_order_lag() -> None:
    state = servo_start(SERVO, DT_S)
    for n in range(1, 20):
        state = servo_step(SERVO, state, 0.1, DT_S)  # below s / a = 0.167: never rate-limited
        assert state.deflection == pytest.approx(0.1 * (1.0 - exp(-54.0 * n * DT_S)), abs=1e-12)


def test_a_large_command_moves_nine_half_throws_a_second() -> None:
    state = servo_start(SERVO, DT_S, -1.0)
    for n in range(1, 41):  # 0.2 s: 1.8 of the 2 half-throws, the lag takes over at 1.833
        state = servo_step(SERVO, state, 1.0, DT_S)
        assert state.deflection == pytest.approx(-1.0 + 9.0 * n * DT_S, abs=1e-12)
    for _ in range(40):
        state = servo_step(SERVO, state, 1.0, DT_S)
    assert 0.999 < state.deflection < 1.0


def test_travel_ends_where_it_ends() -> None:
    short = SERVO._replace(travel=0.6)
    for command in (5.0, inf):
        assert servo_moved(short, 0.0, command, 10.0) == 0.6
        assert servo_moved(short, 0.0, -command, 10.0) == -0.6


@pytest.mark.parametrize("delay_s", [0.0, 0.005, 0.013, 0.015, 0.02])
def test_the_delay_is_exact_between_steps_too(delay_s: float) -> None:
    delayed = SERVO._replace(delay_s=delay_s)
    state = servo_start(delayed, DT_S)
    for n in range(1, 30):
        state = servo_step(delayed, state, 0.1, DT_S)
        moving_s = max(0.0, n * DT_S - delay_s)
        assert state.deflection == pytest.approx(0.1 * (1.0 - exp(-54.0 * moving_s)), abs=1e-9)


def test_each_delayed_command_acts_for_its_own_step() -> None:
    delayed = SERVO._replace(delay_s=0.02)
    late, prompt = servo_start(delayed, DT_S), servo_start(SERVO, DT_S)
    commands = [0.3, -0.8, 0.1, 1.0, 0.0, 0.0, -0.4, 0.2, 0.9, -1.0]
    punctual = []
    for n, command in enumerate(commands):
        prompt = servo_step(SERVO, prompt, command, DT_S)
        punctual.append(prompt.deflection)
        late = servo_step(delayed, late, command, DT_S)
        assert late.deflection == (punctual[n - 4] if n >= 4 else 0.0)


@pytest.mark.parametrize("delay_s", [0.0, 0.01])
def test_a_command_that_is_no_number_leaves_the_last_one_in_force(delay_s: float) -> None:
    params = SERVO._replace(delay_s=delay_s)
    state = servo_step(params, servo_start(params, DT_S), 0.1, DT_S)
    for _ in range(100):
        state = servo_step(params, state, nan, DT_S)
    assert state.deflection == pytest.approx(0.1, abs=1e-9)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("servo_lag_radps", 0.0),
        ("servo_lag_radps", nan),
        ("servo_rate_per_s", -9.0),
        ("servo_travel", 1.5),
        ("servo_delay_s", inf),
    ],
)
def test_bad_figures_are_named(key: str, value: float) -> None:
    with pytest.raises(ValueError, match=key):
        servo_params({**TABLE, key: value})


def test_a_missing_figure_is_named() -> None:
    with pytest.raises(ValueError, match=r"servo_rate_per_s: missing"):
        servo_params({k: v for k, v in TABLE.items() if k != "servo_rate_per_s"})


@pytest.mark.parametrize("dt_s", [0.0, -0.005, nan])
def test_a_step_must_be_positive(dt_s: float) -> None:
    with pytest.raises(ValueError, match="step"):
        servo_start(SERVO, dt_s)


def test_state_is_plain() -> None:
    state = servo_step(SERVO, servo_start(SERVO, DT_S), 1.0, DT_S)
    assert isinstance(state, ServoState)
    assert all(type(c) is float for c in (state.deflection, *state.pending))
    assert isinstance(SERVO, ServoParams)
