"""What is known of an airframe in roll and yaw: what its surfaces do, and what its motion does."""

from __future__ import annotations

from typing import Final, NamedTuple


class LateralDynamics(NamedTuple):
    """Of an airframe, at one speed; 0: not known."""

    speed_mps: float  # at which all hold; rates' coefficients grow with it, others with its square
    roll_effect_radps2: float  # roll acceleration of a full aileron
    roll_damping_per_s: float
    yaw_effect_radps2: float  # yaw acceleration of a full rudder
    yaw_damping_per_s: float
    yaw_stiffness_per_s2: float  # of the fin, for each radian of sideslip
    lag_s: float  # the servos'
    roll_of_slip_per_s2: float  # roll acceleration for each radian of sideslip; dihedral: negative
    roll_of_yaw_per_s: float  # for each rad/s of yaw
    yaw_of_roll_per_s: float  # yaw acceleration for each rad/s of roll
    yaw_of_aileron_radps2: float  # of a full one; adverse: negative
    side_of_slip_mps2: float  # acceleration to the right for each radian of sideslip
    side_of_rudder_mps2: float  # of a full one
    lift_rad: float  # incidence beyond that without lift; it falls with the speed's square
    rigging_rad: float  # incidence without lift


UNKNOWN: Final = LateralDynamics(**dict.fromkeys(LateralDynamics._fields, 0.0))
