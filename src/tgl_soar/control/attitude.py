"""Attitude: pitch to elevator (eq. 16) and roll to aileron (eq. 17).

    elevator = kp e_theta + ki ∫ e_theta dt + kd de_theta/dt,   e_theta = theta_sp - theta
    aileron  = kp e_phi   + ki ∫ e_phi dt   + kd de_phi/dt,     e_phi = phi_sp - phi

phi_sp is 0 in the paper; here it is the bank that holds the aircraft in the middle (`heading`).
Positive elevator pitches up, positive aileron rolls right, both -1 … 1.

The derivative acts on the measured rate, so that a setpoint that steps does not kick the surface,
and on a part of the pitch setpoint's rate: all of it is eq. 16 as printed.  The setpoint that the
line asks for moves all the time, and damping that resists it delays the whole cascade: with 0.3
of its rate the same disk margins leave 0.78 of e_rho (docs/margins.md).  Without
accelerometers the line's rate is that of fixes, whose noise this would pass on to the elevator.
"""

from __future__ import annotations

from tgl_soar.control.pid import PidGains, PidState, PidTerms, pid_step
from tgl_soar.types import isfinite


def attitude_step(
    gains: PidGains,
    state: PidState,
    setpoint_rad: float,
    angle_rad: float,
    angle_rate_radps: float,
    trim: float,
    dt_s: float,
    blocked: int,
    setpoint_rate_radps: float = 0.0,
) -> tuple[PidState, PidTerms]:
    """One step of either law.

    trim: deflection in undisturbed flight, -1 … 1; setpoint_rate_radps: what the derivative is to
    have of it.
    """
    rate_radps = setpoint_rate_radps - angle_rate_radps
    return pid_step(gains, state, setpoint_rad - angle_rad, rate_radps, trim, dt_s, blocked)


def followed_rate(
    weight: float, setpoint_rad: float, before_rad: float, slew_radps: float, dt_s: float
) -> float:
    """The derivative's part of the setpoint's rate; 0 where there was no setpoint before (NaN).

    A setpoint that begins elsewhere counts as one that slews there.
    """
    if not (weight > 0.0 and dt_s > 0.0 and isfinite(before_rad)):
        return 0.0
    rate_radps = (setpoint_rad - before_rad) / dt_s
    return weight * max(-slew_radps, min(slew_radps, rate_radps))
