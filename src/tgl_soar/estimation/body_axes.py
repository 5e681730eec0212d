"""The body's axes, and its motion along them: how it moves over the ground and through the air.

With R the rotation from FRD to upwind NED, v the velocity over the ground and ω the body rates,

    d/dt (Rᵀ v) = Rᵀ dv/dt − ω × (Rᵀ v)

so that what accelerometers feel beside gravity is known without differentiating anything, however
the body turns.
"""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

from tgl_soar.types import NAN, VehicleState, isfinite


class BodyAxes(NamedTuple):
    """The body's x and z axes in upwind NED (two columns of R), and its velocity."""

    x_n: float
    x_e: float
    x_d: float
    z_n: float
    z_e: float
    z_d: float
    velocity_x_mps: float
    velocity_y_mps: float
    climb_mps: float


class BodyMotion(NamedTuple):
    """Over the ground, body axes."""

    forward_mps: float  # Rᵀ v along x
    down_mps: float  # and along z
    turning_x_mps2: float  # ω × (Rᵀ v) along x
    turning_z_mps2: float


def body_axes(vehicle: VehicleState) -> BodyAxes:
    """Of a vehicle; NaN where its attitude is not known."""
    _, _, _, _, velocity_x, velocity_y, climb, roll, pitch, heading, _, _, _ = vehicle
    if not isfinite(roll + pitch + heading):
        return BodyAxes(
            x_n=NAN,
            x_e=NAN,
            x_d=NAN,
            z_n=NAN,
            z_e=NAN,
            z_d=NAN,
            velocity_x_mps=NAN,
            velocity_y_mps=NAN,
            climb_mps=NAN,
        )
    sr, cr, sp, cp = sin(roll), cos(roll), sin(pitch), cos(pitch)
    sh, ch = sin(heading), cos(heading)
    return BodyAxes(
        x_n=ch * cp,
        x_e=sh * cp,
        x_d=-sp,
        z_n=ch * sp * cr + sh * sr,
        z_e=sh * sp * cr - ch * sr,
        z_d=cp * cr,
        velocity_x_mps=velocity_x,
        velocity_y_mps=velocity_y,
        climb_mps=climb,
    )


def through_air(frame: BodyAxes, wind_mps: float, updraft_mps: float) -> tuple[float, float]:
    """(u, w) [m/s]: the velocity through the air along the body's x and z axes."""
    x_n, x_e, x_d, z_n, z_e, z_d, velocity_x, east, climb = frame
    north, down = wind_mps - velocity_x, updraft_mps - climb
    return x_n * north + x_e * east + x_d * down, z_n * north + z_e * east + z_d * down


def body_motion(frame: BodyAxes, vehicle: VehicleState) -> BodyMotion:
    """Of a vehicle with these axes; one whose rates are not known is taken not to turn."""
    x_n, x_e, x_d, z_n, z_e, z_d, velocity_x, east, climb = frame
    north, down = -velocity_x, -climb
    y_n, y_e, y_d = z_e * x_d - z_d * x_e, z_d * x_n - z_n * x_d, z_n * x_e - z_e * x_n
    u = x_n * north + x_e * east + x_d * down
    v = y_n * north + y_e * east + y_d * down
    w = z_n * north + z_e * east + z_d * down
    roll, pitch = vehicle.roll_rad, vehicle.pitch_rad
    rolls, pitches, turns = (
        vehicle.roll_rate_radps,
        vehicle.pitch_rate_radps,
        vehicle.heading_rate_radps,
    )
    if not isfinite(x_n + rolls + pitches + turns):
        return BodyMotion(forward_mps=u, down_mps=w, turning_x_mps2=0.0, turning_z_mps2=0.0)
    p = rolls - turns * sin(pitch)
    q = pitches * cos(roll) + turns * cos(pitch) * sin(roll)
    r = turns * cos(pitch) * cos(roll) - pitches * sin(roll)
    return BodyMotion(
        forward_mps=u,
        down_mps=w,
        turning_x_mps2=q * w - r * v,
        turning_z_mps2=p * v - q * u,
    )
