"""Heading: a virtual waypoint upwind, to the rudder (eq. 18).

    psi_sp = -atan(y / R),   R = x - x_waypoint
    rudder = kp e_psi + kd de_psi/dt,   e_psi = psi_sp - psi

psi is measured from straight upwind, positive to the right; y is positive to the right of the
aircraft that faces upwind: right of the middle it must look left.  R is the along-stream
distance to the waypoint, which must lie upwind (a waypoint downwind diverges), so R has a
floor.  Where the wind's direction psi_w is estimated (`estimation.cross_wind`), psi_sp is counted
from it: the aircraft stays in the middle, with its nose in the wind, and not where the waypoint
lies upwind of it.  The line's plane does not turn: it stands across the ridge, which does not.

The paper writes tan(y/R) - psi, leaves the sign of y open, and its text names an
integral that its equation lacks; there is none here: the waypoint takes the place of one.

Wings that are level turn the path by sideslip alone, with seconds of lag, and a roll angle that is
wrong by a degree leaves a third of a metre to the side.  So the bank follows the sideways speed
(ours; the paper's wings are level):

    v_sp   = min(V, g kv R) sin psi_sp          where the nose leads to once it follows its setpoint
    phi_sp = kv (v_sp - v_y) + ki ∫ (v_sp - v_y) dt,   limited to either side

V is the airspeed, v_y the velocity over the ground to the right.  The sideways speed follows its
setpoint in 1 / (g kv) seconds, and the way to the middle takes R / V: in fast air, or with the
small kv that late surfaces leave, the way is not to be the faster of the two.  With the cross wind
at rest there is no sideslip where v_y = v_sp, so that bank and rudder want the same.  At rest
v_sp = 0, hence y = 0, whatever bank the integral had to learn for it.  The first term goes through
the law's low-pass and stands as its d, being of y's rate: it begins at zero, wings level.

A firmware that holds the attitude itself and has the rudder coordinate its turns is asked for a
bank instead (the paper has no such flight):

    phi_sp = kphi e_psi,   limited to either side

There psi_w is always estimated: a heading that is wrong by b, and that its estimator does not
report, would leave y = R tan b.  As the aircraft drifts by V sin b less than its heading says, it
counts as a wind from b aside, and the nose rests where the aircraft does.  (A bank by the sideways
speed, as where we bank, would need no heading, but nor would it bound where the nose points:
against a cross wind it turned it 90 degrees away.)
"""

from __future__ import annotations

from math import atan, sin
from typing import NamedTuple

from tgl_soar.control.pid import PidGains, PidState, PidTerms, pid_step
from tgl_soar.geometry import wrap_angle
from tgl_soar.types import GRAVITY_MPS2


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


def leading_speed(
    gains: HeadingGains, bank_per_speed: float, x_m: float, airspeed_mps: float
) -> float:
    """The airspeed by which a heading counts as sideways speed, from its waypoint.

    bank_per_speed: kv [rad s/m]; 0 limits nothing.
    """
    if bank_per_speed <= 0.0:
        return airspeed_mps
    distance = max(gains.distance_min_m, x_m - gains.waypoint_x_m)
    return min(airspeed_mps, GRAVITY_MPS2 * bank_per_speed * distance)


def sideways_step(
    gains: PidGains,
    state: PidState,
    setpoint_rad: float,
    airspeed_mps: float,
    velocity_y_mps: float,
    dt_s: float,
    blocked: int,
) -> tuple[PidState, PidTerms]:
    """One step of the bank setpoint [rad] from a heading setpoint and the sideways speed.

    blocked: +1 if the aircraft cannot roll further right now, -1 left, else 0.
    """
    error = airspeed_mps * sin(setpoint_rad) - velocity_y_mps
    return pid_step(gains, state, error, error, 0.0, dt_s, blocked)


def sideways_held(state: PidState) -> PidTerms:
    """The bank without a position: what was learnt to be level."""
    level = state.integral
    return PidTerms(output=level, p=0.0, i=level, d=0.0, feedforward=0.0, saturated=0)


def bank_setpoint(gains: BankGains, setpoint_rad: float, heading_rad: float) -> float:
    """Bank [rad] that turns the nose to a heading."""
    bank = gains.bank_per_heading * wrap_angle(setpoint_rad - heading_rad)
    return max(-gains.bank_max_rad, min(gains.bank_max_rad, bank))
