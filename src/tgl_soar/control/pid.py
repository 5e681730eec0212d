"""The PID law that every loop uses.

    u = u_ff + kp e + i + kd d
    di/dt = ki e          not while that would push further into a limit
    dd/dt = w (de/dt - d) first-order low-pass of the error's rate
    u is held within [output_min, output_max]

e is the error, de/dt its rate as measured (a velocity or a gyro: never a difference of e, so
that a step of the setpoint gives no kick), u_ff the feed-forward, w the filter's bandwidth.

Anti-windup: the integral stops while the output is at a limit, here or *downstream*, and the
error would drive it further that way; it may always come back.  `blocked` is +1 when what
follows this loop can deliver no more, -1 when it can deliver no less, else 0.

The paper gives equations 15-18 without limits, filter, anti-windup or reset.
"""

from __future__ import annotations

from typing import NamedTuple


class PidGains(NamedTuple):
    """Parameters of one loop; U is the unit of the output, E of the error."""

    kp: float  # U/E
    ki: float  # U/(E s)
    kd: float  # U s/E
    rate_filter_radps: float  # bandwidth of the low-pass on the error's rate
    integral_max: float  # U, to either side
    output_min: float  # U
    output_max: float  # U


class PidState(NamedTuple):
    """What one loop remembers."""

    integral: float  # U
    rate: float  # E/s, filtered


class PidTerms(NamedTuple):
    """The output of one step and what it is made of, all in the unit of the output."""

    output: float
    p: float
    i: float
    d: float
    feedforward: float
    saturated: int  # +1 at output_max, -1 at output_min, else 0


def pid_step(
    gains: PidGains,
    state: PidState,
    error: float,
    error_rate: float,
    feedforward: float,
    dt_s: float,
    blocked: int,
) -> tuple[PidState, PidTerms]:
    """One step of dt_s >= 0 seconds; returns the new state and the terms."""
    kp, ki, kd, rate_filter, integral_max, output_min, output_max = gains
    before, rate = state
    blend = rate_filter * dt_s
    rate = rate + (error_rate - rate) * blend / (1.0 + blend)
    p = kp * error
    d = kd * rate

    integral = before + ki * error * dt_s
    if not integral < integral_max:  # so, NaN is held as well
        integral = integral_max
    if not integral > -integral_max:
        integral = -integral_max
    output = feedforward + p + integral + d
    if (integral > before and (blocked > 0 or output > output_max)) or (
        integral < before and (blocked < 0 or output < output_min)
    ):
        integral = before
        output = feedforward + p + integral + d

    saturated = 0
    if output > output_max:
        output, saturated = output_max, 1
    elif output < output_min:
        output, saturated = output_min, -1
    return PidState(integral, rate), PidTerms(
        output=output, p=p, i=integral, d=d, feedforward=feedforward, saturated=saturated
    )


def pid_reset(
    gains: PidGains, error_rate: float, feedforward: float, undisturbed: float
) -> PidState:
    """The state in which the loop gives `undisturbed` where there is no error and no rate.

    P and D act at once: an integral that cancelled them would hide the very disturbance that
    the loop is there for, and unwind only slowly.
    """
    integral = undisturbed - feedforward
    return PidState(max(-gains.integral_max, min(gains.integral_max, integral)), error_rate)
