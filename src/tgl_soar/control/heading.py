"""Heading: a virtual waypoint upwind, to the rudder (eq. 18).

    psi_sp = -atan(y / R),   R = x - x_waypoint
    rudder = kp e_psi + kd de_psi/dt,   e_psi = psi_sp - psi

psi is measured from straight upwind, positive to the right; y is positive to the right of the
aircraft that faces upwind: right of the middle it must look left.  R is the along-stream
distance to the waypoint, which must lie upwind (a waypoint downwind diverges), so R has a
floor.  The paper writes tan(y/R) - psi, leaves the sign of y open, and its text names an
integral that its equation lacks; there is none here: the waypoint takes the place of one.

A firmware that holds the attitude itself and has the rudder coordinate its turns is asked for a
bank instead (the paper has no such flight):

    phi_sp = kphi e_psi,   limited to either side
"""

from __future__ import annotations

from math import atan
from typing import NamedTuple

from tgl_soar.control.pid import PidGains, PidState, PidTerms, pid_step
from tgl_soar.geometry import wrap_angle


class HeadingGains(NamedTuple):
    """Parameters of the law."""

    pid: PidGains  # rad to deflection; ki = 0
    waypoint_x_m: float  # soaring frame
    distance_min_m: float
    heading_max_rad: float


class BankGains(NamedTuple):
    """Parameters of the turn by banking."""

    bank_per_heading: float  # rad of bank for each rad of heading
    bank_max_rad: float


def heading_setpoint(gains: HeadingGains, x_m: float, y_m: float) -> float:
    """Heading [rad] that looks at the virtual waypoint from (x, y), limited to either side."""
    distance = max(gains.distance_min_m, x_m - gains.waypoint_x_m)
    setpoint = -atan(y_m / distance)
    return max(-gains.heading_max_rad, min(gains.heading_max_rad, setpoint))


def heading_step(
    gains: HeadingGains,
    state: PidState,
    setpoint_rad: float,
    heading_rad: float,
    heading_rate_radps: float,
    trim: float,
    dt_s: float,
) -> tuple[PidState, PidTerms]:
    """One step of the rudder law.  trim: deflection in straight flight, -1 … 1."""
    error = wrap_angle(setpoint_rad - heading_rad)
    return pid_step(gains.pid, state, error, -heading_rate_radps, trim, dt_s, 0)


def bank_setpoint(gains: BankGains, setpoint_rad: float, heading_rad: float) -> float:
    """Bank [rad] that turns the nose to a heading."""
    bank = gains.bank_per_heading * wrap_angle(setpoint_rad - heading_rad)
    return max(-gains.bank_max_rad, min(gains.bank_max_rad, bank))
