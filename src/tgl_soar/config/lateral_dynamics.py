"""What is known of an airframe in roll and yaw: the effects of its surfaces and its own damping."""

from __future__ import annotations

from typing import Final, NamedTuple


class LateralDynamics(NamedTuple):
    """Of an airframe, at one speed; 0: not known."""

    speed_mps: float  # at which the next five hold; effects and stiffness grow with its square
    roll_effect_radps2: float  # roll acceleration of a full aileron
    roll_damping_per_s: float
    yaw_effect_radps2: float  # yaw acceleration of a full rudder
    yaw_damping_per_s: float
    yaw_stiffness_per_s2: float  # of the fin, for each radian of sideslip
    lag_s: float  # the servos'


UNKNOWN: Final = LateralDynamics(
    speed_mps=0.0,
    roll_effect_radps2=0.0,
    roll_damping_per_s=0.0,
    yaw_effect_radps2=0.0,
    yaw_damping_per_s=0.0,
    yaw_stiffness_per_s2=0.0,
    lag_s=0.0,
)
