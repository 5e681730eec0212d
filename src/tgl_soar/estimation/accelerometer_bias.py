"""The accelerometers' bias, by the attitude and by how the aircraft moves over the ground.

What an accelerometer feels is the acceleration less gravity, and its bias b.  In body axes, with
u = Rᵀ v the velocity over the ground, ω the body rates and g the gravity along the body's axes,

    f + g − ω × u = du/dt + b

and of that the average over BIAS_S is taken, by one low-pass for both sides: that of du/dt is
(u − u averaged) / BIAS_S, whatever u does, so that nothing is differentiated and nothing is taken
for a bias that is flown.

The sideways velocity has its part in this, and so have the turns: an aircraft that weaves, 30
degrees to and fro, feels 0.4 m/s² on its x and z axes on average that are no bias.  Taken for one
they make the incidence 2 degrees too low, and of 7.5 m/s of airspeed near the stall 8.5.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar.estimation.body_axes import BodyAxes, BodyMotion
from tgl_soar.types import ImuSample

BIAS_S: Final = 5.0


class ForceAverages(NamedTuple):
    """Over `BIAS_S`, body axes; from them the accelerometers' bias follows."""

    forward_mps: float  # velocity over the ground along x
    down_mps: float  # velocity over the ground along z
    force_x_mps2: float  # specific force plus gravity, less what turning makes
    force_z_mps2: float  # likewise


def begun(motion: BodyMotion) -> ForceAverages:
    """The averages before the first force: no bias."""
    return ForceAverages(
        forward_mps=motion.forward_mps,
        down_mps=motion.down_mps,
        force_x_mps2=0.0,
        force_z_mps2=0.0,
    )


def averaged(
    average: ForceAverages,
    frame: BodyAxes,
    motion: BodyMotion,
    imu: ImuSample,
    gravity_mps2: float,
    since_s: float,
) -> ForceAverages:
    """The averages with one force more, `since_s` after the last."""
    blend = min(1.0, since_s / BIAS_S)
    force_x = imu.force_x_frd_mps2 + gravity_mps2 * frame.x_d - motion.turning_x_mps2
    force_z = imu.force_z_frd_mps2 + gravity_mps2 * frame.z_d - motion.turning_z_mps2
    return ForceAverages(
        forward_mps=average.forward_mps + blend * (motion.forward_mps - average.forward_mps),
        down_mps=average.down_mps + blend * (motion.down_mps - average.down_mps),
        force_x_mps2=average.force_x_mps2 + blend * (force_x - average.force_x_mps2),
        force_z_mps2=average.force_z_mps2 + blend * (force_z - average.force_z_mps2),
    )


def unbiased(average: ForceAverages, motion: BodyMotion, imu: ImuSample) -> tuple[float, float]:
    """The specific force, x and z, less its bias."""
    return (
        imu.force_x_frd_mps2
        - average.force_x_mps2
        + (motion.forward_mps - average.forward_mps) / BIAS_S,
        imu.force_z_frd_mps2 - average.force_z_mps2 + (motion.down_mps - average.down_mps) / BIAS_S,
    )
