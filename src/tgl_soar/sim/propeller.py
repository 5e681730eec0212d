"""A propeller: thrust along the nose, by throttle and airspeed, and the lag of motor and blades.

    T = η T_0 max(0, 1 − u_b / V_0)        dη/dt = (η_c − η) / τ,   0 at rest and without one

η, η_c  –    throttle that it turns at, and that is commanded, 0 … 1
T_0     N    at full throttle and no airspeed            u_b  m/s  the air's speed along the nose
V_0     m/s  airspeed at which nothing is left            τ    s

A fixed pitch gives less the faster the air comes, nearly by a straight line from T_0 to none at the
blades' own advance (McCormick, Aerodynamics, Aeronautics and Flight Mechanics, chapter 6: C_T
over J).  That holds at one speed of rotation; the throttle scales both ends of it alike, which is
what a small electric motor does within some ten per cent.  Beyond V_0 it folds or windmills without
drag.  It pulls along x through the centre of gravity: no moment.
"""

from __future__ import annotations

from math import exp
from typing import Protocol


class Driven(Protocol):
    """An aircraft's own figures of it."""

    @property
    def propeller_thrust_n(self) -> float:
        """T_0; 0: there is none."""

    @property
    def propeller_speed_mps(self) -> float:
        """V_0."""

    @property
    def propeller_lag_s(self) -> float:
        """τ."""


def thrust(model: Driven, throttle: float, forward_mps: float) -> float:
    """Thrust [N] at a throttle above 0, in air that comes at a speed along the nose."""
    if not (model.propeller_thrust_n > 0.0 and model.propeller_speed_mps > 0.0):
        return 0.0
    fraction = min(1.0, max(0.0, 1.0 - forward_mps / model.propeller_speed_mps))
    return throttle * fraction * model.propeller_thrust_n


def spun(model: Driven, throttle: float, wanted: float, dt_s: float) -> float:
    """The throttle that it turns at after a step under a constant command; NaN closes it."""
    if not model.propeller_thrust_n > 0.0:
        return 0.0
    wanted = min(1.0, wanted) if wanted > 0.0 else 0.0
    if not model.propeller_lag_s > 0.0:
        return wanted
    return wanted + (throttle - wanted) * exp(-dt_s / model.propeller_lag_s)
