"""Attitude: pitch to elevator (eq. 16) and roll to aileron (eq. 17).

    elevator = kp e_theta + ki ∫ e_theta dt + kd de_theta/dt,   e_theta = theta_sp - theta
    aileron  = kp e_phi   + ki ∫ e_phi dt   + kd de_phi/dt,     e_phi = phi_sp - phi

phi_sp is 0 in the paper; here it is the bank that holds the aircraft in the middle (`heading`).
Positive elevator pitches up, positive aileron rolls right, both -1 … 1.  The derivative acts
on the measured rate alone: a setpoint that steps does not kick the surface.
"""

from __future__ import annotations

from tgl_soar.control.pid import PidGains, PidState, PidTerms, pid_step


def attitude_step(
    gains: PidGains,
    state: PidState,
    setpoint_rad: float,
    angle_rad: float,
    angle_rate_radps: float,
    trim: float,
    dt_s: float,
    blocked: int,
) -> tuple[PidState, PidTerms]:
    """One step of either law.  trim: deflection in undisturbed flight, -1 … 1."""
    return pid_step(gains, state, setpoint_rad - angle_rad, -angle_rate_radps, trim, dt_s, blocked)
