"""A surface's servo: first-order lag, limited rate, limited travel, pure delay.

    dδ/dt = clip(a (c(t − T) − δ), −s, +s)        δ in [−l, +l]

δ  deflection, normalised: 1 is a half-throw      c  command, clipped to [−l, +l]
a  lag [rad/s]                                    s  rate limit [half-throws/s]
T  pure delay [s]                                 l  travel limit [half-throws]

For a constant command the solution is a ramp of slope s while |c − δ| > s/a, then the
exponential exp(−a t) from there: both are evaluated in closed form, so a step has no
discretisation error whatever its length.  A command is held from the step it is given in to
the next one.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import exp, floor, isfinite
from typing import NamedTuple


class ServoParams(NamedTuple):
    """What a servo can do."""

    lag_radps: float  # a
    rate_per_s: float  # s, half-throws per second
    travel: float  # l, half-throws
    delay_s: float  # T


class ServoState(NamedTuple):
    """Where a surface stands, and the commands that are still on their way to it."""

    deflection: float  # δ
    pending: tuple[float, ...]  # oldest first; its length belongs to one step length


def servo_params(table: Mapping[str, float]) -> ServoParams:
    """Servo figures from an airframe file's `[model]` table (the keys `servo_…`).

    Errors: ValueError naming a key that is missing, not finite, or out of range.
    """
    values = []
    for key, smallest, largest in (
        ("servo_lag_radps", 1.0, 1e4),
        ("servo_rate_per_s", 0.01, 1e4),
        ("servo_travel", 0.01, 1.0),
        ("servo_delay_s", 0.0, 1.0),
    ):
        if key not in table:
            raise ValueError(f"model.{key}: missing; a number from {smallest:g} to {largest:g}")
        value = float(table[key])
        if not (isfinite(value) and smallest <= value <= largest):
            raise ValueError(f"model.{key} = {value}: must be from {smallest:g} to {largest:g}")
        values.append(value)
    return ServoParams(*values)


def servo_start(params: ServoParams, dt_s: float, deflection: float = 0.0) -> ServoState:
    """A servo at rest at a deflection, for steps of `dt_s` [s].

    Errors: ValueError for a step that is not positive.
    """
    if not 0.0 < dt_s < 1e3:
        raise ValueError(f"servo step {dt_s} s: must be positive")
    pending = (deflection,) * (_whole_steps(params.delay_s, dt_s) + 1)
    return ServoState(deflection, pending)


def servo_step(params: ServoParams, state: ServoState, command: float, dt_s: float) -> ServoState:
    """The servo after `dt_s` [s], given a new command at the start of the step.

    `dt_s` must be the one of `servo_start`.  A delay that is no whole number of steps is exact
    too: the older command rules the first part of the step.  A command that is not a number
    leaves the last one in force.
    """
    if command != command:  # NaN
        command = state.pending[-1]
    pending = state.pending[1:] + (command,)  # noqa: RUF005 - numba takes only this form
    part_s = params.delay_s - _whole_steps(params.delay_s, dt_s) * dt_s
    deflection = state.deflection
    if part_s > 1e-9:
        deflection = servo_moved(params, deflection, state.pending[0], part_s)
        deflection = servo_moved(params, deflection, pending[0], dt_s - part_s)
    else:
        deflection = servo_moved(params, deflection, pending[0], dt_s)
    return ServoState(deflection, pending)


def servo_moved(params: ServoParams, deflection: float, command: float, dt_s: float) -> float:
    """The deflection after `dt_s` [s] under a constant command, without delay."""
    travel = params.travel
    target = min(travel, max(-travel, command))
    error = target - deflection
    reach = params.rate_per_s / params.lag_radps  # the error at which the lag asks for s
    size = abs(error)
    if size > reach:
        ramp_s = (size - reach) / params.rate_per_s
        if ramp_s >= dt_s:
            size -= params.rate_per_s * dt_s
        else:
            size = reach * exp(-params.lag_radps * (dt_s - ramp_s))
    else:
        size *= exp(-params.lag_radps * dt_s)
    return target - size if error >= 0.0 else target + size


def _whole_steps(delay_s: float, dt_s: float) -> int:
    """Steps that fit into the delay; a rounding error short of a step counts as the step."""
    return floor(delay_s / dt_s + 1e-9)
