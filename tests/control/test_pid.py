"""The PID law against the continuous law, its limits, and its anti-windup on a plant."""

from __future__ import annotations

from math import cos, exp, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.control.pid import PidGains, PidState, pid_reset, pid_step

REST = PidState(0.0, 0.0)
WIDE = PidGains(
    kp=2.0,
    ki=3.0,
    kd=0.5,
    rate_filter_radps=40.0,
    integral_max=100.0,
    output_min=-100.0,
    output_max=100.0,
)

finite = st.floats(allow_nan=False, allow_infinity=False)
moderate = st.floats(-1e3, 1e3)
gain = st.floats(0.0, 50.0)


@st.composite
def gains(draw: st.DrawFn) -> PidGains:
    low = draw(st.floats(-10.0, 9.0))
    high = draw(st.floats(low, 10.0))
    return PidGains(
        kp=draw(gain),
        ki=draw(gain),
        kd=draw(gain),
        rate_filter_radps=draw(st.floats(0.1, 700.0)),
        integral_max=draw(gain),
        output_min=low,
        output_max=high,
    )


# --- the continuous law ---------------------------------------------------------------------


def continuous(t: float, g: PidGains, w: float, feedforward: float) -> float:
    """The law's solution for e = sin(w t) from rest, by hand.

    i = ki (1 - cos wt) / w;  d' = a (w cos wt - d), d(0) = 0 gives
    d = a w / (a² + w²) (a cos wt + w sin wt - a exp(-a t)).
    """
    a = g.rate_filter_radps
    i = g.ki * (1.0 - cos(w * t)) / w
    d = a * w / (a * a + w * w) * (a * cos(w * t) + w * sin(w * t) - a * exp(-a * t))
    return feedforward + g.kp * sin(w * t) + i + g.kd * d


def largest_error(dt: float) -> float:
    """Of the discrete law against the continuous one over two seconds."""
    w = 2.0 * pi
    state, worst = REST, 0.0
    for k in range(1, round(2.0 / dt) + 1):
        t = k * dt
        state, terms = pid_step(WIDE, state, sin(w * t), w * cos(w * t), 0.25, dt, 0)
        worst = max(worst, abs(terms.output - continuous(t, WIDE, w, 0.25)))
    return worst


def test_the_law_converges_to_the_continuous_one_in_first_order() -> None:
    # Integral and filter are one-sided sums: their error is of first order in dt.
    coarse, fine = largest_error(1e-3), largest_error(1e-4)
    assert coarse < 0.15  # of an output of 4
    assert coarse / fine == pytest.approx(10.0, rel=0.2)


@given(error=moderate, feedforward=moderate)
def test_proportional_and_feedforward_are_exact(error: float, feedforward: float) -> None:
    g = PidGains(
        kp=1.5,
        ki=0.0,
        kd=0.0,
        rate_filter_radps=10.0,
        integral_max=0.0,
        output_min=-1e9,
        output_max=1e9,
    )
    _, terms = pid_step(g, REST, error, 0.0, feedforward, 0.005, 0)
    assert terms.p == 1.5 * error
    assert terms.output == feedforward + 1.5 * error


def test_the_integral_of_a_constant_error_is_exact() -> None:
    state = REST
    for _ in range(400):
        state, terms = pid_step(WIDE, state, 0.5, 0.0, 0.0, 0.005, 0)
    assert terms.i == pytest.approx(3.0 * 0.5 * 2.0, rel=1e-12)
    assert state.integral == terms.i


def test_the_derivative_of_a_constant_rate_is_exact_once_the_filter_has_settled() -> None:
    state = REST
    for _ in range(400):
        state, terms = pid_step(WIDE, state, 0.0, 0.8, 0.0, 0.005, 0)
    assert terms.d == pytest.approx(0.5 * 0.8, rel=1e-12)


@pytest.mark.parametrize("bandwidth_hz", [0.5, 6.5, 40.0])
def test_the_low_pass_has_its_bandwidth_as_time_constant(bandwidth_hz: float) -> None:
    # A first-order low-pass passes 1 - 1/e of a step at 1 / (2 pi f).
    a = 2.0 * pi * bandwidth_hz
    g = WIDE._replace(rate_filter_radps=a)
    dt = 1e-3 / a
    state, time = REST, 0.0
    while state.rate < 1.0 - exp(-1.0):
        state, _ = pid_step(g, state, 0.0, 1.0, 0.0, dt, 0)
        time += dt
    assert time == pytest.approx(1.0 / a, rel=2e-3)  # the step itself is a thousandth


@given(g=gains(), integral=moderate, rate=moderate, target=moderate, dt=st.floats(0.0, 10.0))
def test_the_low_pass_never_overshoots(
    g: PidGains, integral: float, rate: float, target: float, dt: float
) -> None:
    # However long the step: an explicit filter would diverge at w dt > 2.
    state, _ = pid_step(g, PidState(integral, rate), 0.0, target, 0.0, dt, 0)
    low, high = min(rate, target), max(rate, target)
    assert low - 1e-9 <= state.rate <= high + 1e-9


@given(g=gains(), integral=st.floats(-50, 50), rate=moderate, error=moderate)
def test_a_step_of_no_time_changes_nothing_it_remembers(
    g: PidGains, integral: float, rate: float, error: float
) -> None:
    held = max(-g.integral_max, min(g.integral_max, integral))
    state, _ = pid_step(g, PidState(held, rate), error, 123.0, 0.0, 0.0, 0)
    assert state == PidState(held, rate)


# --- limits ---------------------------------------------------------------------------------


@given(
    g=gains(),
    integral=st.floats(-50, 50),
    rate=moderate,
    error=finite,
    error_rate=st.floats(-1e150, 1e150),
    feedforward=moderate,
    dt=st.floats(0.0, 1.0),
    blocked=st.sampled_from([-1, 0, 1]),
)
def test_limits_hold_for_any_finite_input(
    g: PidGains,
    integral: float,
    rate: float,
    error: float,
    error_rate: float,
    feedforward: float,
    dt: float,
    blocked: int,
) -> None:
    held = max(-g.integral_max, min(g.integral_max, integral))
    state, terms = pid_step(g, PidState(held, rate), error, error_rate, feedforward, dt, blocked)
    # p of +inf against d of -inf is the one sum that is no number; the envelope catches it.
    if abs(terms.p) < 1e300 or abs(terms.d) < 1e300:
        assert g.output_min <= terms.output <= g.output_max
    assert abs(state.integral) <= g.integral_max


@given(g=gains(), error=moderate, error_rate=moderate, feedforward=moderate)
def test_saturation_is_reported_with_its_sign(
    g: PidGains, error: float, error_rate: float, feedforward: float
) -> None:
    _, terms = pid_step(g, REST, error, error_rate, feedforward, 0.005, 0)
    asked = terms.p + terms.i + terms.d + terms.feedforward
    if terms.saturated == 1:
        assert terms.output == g.output_max
        assert asked > g.output_max - 1e-9 * (1 + abs(asked))
    elif terms.saturated == -1:
        assert terms.output == g.output_min
        assert asked < g.output_min + 1e-9 * (1 + abs(asked))
    else:
        assert terms.output == pytest.approx(asked, abs=1e-9 * (1 + abs(asked)))


# --- anti-windup ----------------------------------------------------------------------------


@given(
    g=gains(),
    integral=st.floats(-50, 50),
    error=moderate,
    blocked=st.sampled_from([-1, 1]),
    dt=st.floats(1e-4, 0.1),
)
def test_a_blocked_integral_may_always_come_back_and_never_go_on(
    g: PidGains, integral: float, error: float, blocked: int, dt: float
) -> None:
    # Limits of the output far away: only what follows is blocked.
    g = g._replace(output_min=-1e9, output_max=1e9)
    held = max(-g.integral_max, min(g.integral_max, integral))
    state, terms = pid_step(g, PidState(held, 0.5), error, 0.5, 0.25, dt, blocked)
    free, _ = pid_step(g, PidState(held, 0.5), error, 0.5, 0.25, dt, 0)
    assert terms.i == state.integral
    assert terms.output == 0.25 + terms.p + terms.i + terms.d
    outward = (free.integral - held) * blocked > 0.0
    assert state.integral == (held if outward else free.integral)


PI = PidGains(
    kp=2.0,
    ki=4.0,
    kd=0.0,
    rate_filter_radps=10.0,
    integral_max=100.0,
    output_min=-1.0,
    output_max=1.0,
)
DT = 0.005


def fly(state: PidState, x: float, setpoint: float, seconds: float, law: str) -> list[float]:
    """x [-] over time, and last the integral [-], of the plant x' = (u - x) / 0.5 s, |u| <= 1.

    law: "here" has the limit in the law; "downstream" behind it, where only `blocked` reports
    it, one step late as in the autopilot; "naive" has it there and is given nothing.
    """
    g = PI if law == "here" else PI._replace(output_min=-1e9, output_max=1e9)
    blocked, path = 0, []
    for _ in range(round(seconds / DT)):
        state, terms = pid_step(g, state, setpoint - x, 0.0, 0.0, DT, blocked)
        u = max(-1.0, min(1.0, terms.output))
        if law == "downstream":
            blocked = 1 if terms.output > u else -1 if terms.output < u else 0
        x += (u - x) * DT / 0.5
        path.append(x)
    return [*path, state.integral]


@pytest.mark.parametrize("law", ["here", "downstream"])
def test_ten_seconds_against_a_limit_leave_nothing_behind(law: str) -> None:
    """The setpoint is 3, the plant reaches 1; then 0.5 is asked, which it can do.

    In this loop an integral that starts empty lets x fall below 0.5 by a sixth on the way.  After
    the spell it must do no worse: what one late step of `blocked` lets in, ki e dt = 0.06, is
    allowed for.
    """
    *spell, integral = fly(REST, 0.0, 3.0, 10.0, law)
    assert spell[-1] == pytest.approx(1.0, abs=1e-3)
    *back, _ = fly(PidState(integral, 0.0), spell[-1], 0.5, 10.0, law)
    *fresh, _ = fly(REST, 1.0, 0.5, 10.0, law)
    assert abs(integral) <= PI.ki * 3.0 * DT + 1e-12
    assert min(back) >= min(fresh) - 1e-3
    assert back[-1] == pytest.approx(0.5, abs=1e-3)


def test_a_naive_integral_stays_against_the_limit() -> None:
    # What the test above guards against: 80 wound up, and after 10 s x has not moved.
    *spell, integral = fly(REST, 0.0, 3.0, 10.0, "naive")
    *back, _ = fly(PidState(integral, 0.0), spell[-1], 0.5, 10.0, "naive")
    assert integral > 70.0
    assert min(back) > 0.99


# --- reset ----------------------------------------------------------------------------------


@given(
    g=gains(),
    error=st.floats(-10, 10),
    error_rate=st.floats(-10, 10),
    feedforward=st.floats(-10, 10),
    output=st.floats(-10, 10),
)
def test_reset_gives_the_undisturbed_output_and_hides_no_error(
    g: PidGains, error: float, error_rate: float, feedforward: float, output: float
) -> None:
    state = pid_reset(g, error_rate, feedforward, output)
    needed = output - feedforward
    _, still = pid_step(g, state._replace(rate=0.0), 0.0, 0.0, feedforward, 0.0, 0)
    asked = max(g.output_min, min(g.output_max, output))
    if abs(needed) <= g.integral_max:
        assert still.output == pytest.approx(asked, abs=1e-9)
    else:  # as near as the integral reaches
        assert abs(state.integral) == g.integral_max
        assert state.integral * needed >= 0.0
    # P and D act in full from the first step on, and the derivative does not kick in the next.
    _, terms = pid_step(g, state, error, error_rate, feedforward, 0.0, 0)
    assert (terms.p, terms.d) == (g.kp * error, g.kd * error_rate)
    after, _ = pid_step(g, state, error, error_rate, feedforward, 0.005, 0)
    assert after.rate == pytest.approx(error_rate)


def test_a_changed_integral_gain_gives_no_bump() -> None:
    # The integral is stored in units of the output, so an operator may retune in flight.
    state = REST
    for _ in range(200):
        state, before = pid_step(WIDE, state, 0.3, 0.0, 0.0, 0.005, 0)
    _, after = pid_step(WIDE._replace(ki=6.0), state, 0.3, 0.0, 0.0, 0.0, 0)
    assert after.output == before.output


def test_the_filter_delays_by_its_time_constant() -> None:
    # Of a ramp of the rate, a first-order low-pass is 1 / w behind in the end.
    state, dt = REST, 1e-4
    for k in range(1, 20001):
        state, _ = pid_step(WIDE, state, 0.0, k * dt, 0.0, dt, 0)
    assert 2.0 - state.rate == pytest.approx(1.0 / WIDE.rate_filter_radps, rel=1e-2)
