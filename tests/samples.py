"""Samples as tests write them: of vectors, whose axes the tuples name one by one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from tgl_soar.types import (
    NAN,
    AttitudeSample,
    ImuSample,
    PositionFix,
    SurfacesSample,
    VehicleState,
)

STILL: Final = VehicleState._make([0.0] * len(VehicleState._fields))  # all of it is zero


def position_fix(
    sequence: int,
    time_s: float,
    position_ned_m: Sequence[float],
    velocity_ned_mps: Sequence[float],
    source: int = 0,
) -> PositionFix:
    """A fix of a position and a velocity."""
    north, east, down = position_ned_m
    velocity_north, velocity_east, velocity_down = velocity_ned_mps
    return PositionFix(
        sequence=sequence,
        time_s=time_s,
        north_m=north,
        east_m=east,
        down_m=down,
        velocity_north_mps=velocity_north,
        velocity_east_mps=velocity_east,
        velocity_down_mps=velocity_down,
        source=source,
    )


def attitude_sample(
    sequence: int,
    time_s: float,
    quaternion: Sequence[float],
    rates_frd_radps: Sequence[float] = (0.0, 0.0, 0.0),
) -> AttitudeSample:
    """An attitude of a quaternion and body rates."""
    w, x, y, z = quaternion
    roll, pitch, yaw = rates_frd_radps
    return AttitudeSample(
        sequence=sequence,
        time_s=time_s,
        qw=w,
        qx=x,
        qy=y,
        qz=z,
        roll_rate_frd_radps=roll,
        pitch_rate_frd_radps=pitch,
        yaw_rate_frd_radps=yaw,
    )


def imu_sample(
    sequence: int,
    time_s: float,
    force_frd_mps2: Sequence[float],
    rates_frd_radps: Sequence[float] = (0.0, 0.0, 0.0),
) -> ImuSample:
    """A force and body rates, as accelerometers and gyros measure them."""
    x, y, z = force_frd_mps2
    roll, pitch, yaw = rates_frd_radps
    return ImuSample(
        sequence=sequence,
        time_s=time_s,
        force_x_frd_mps2=x,
        force_y_frd_mps2=y,
        force_z_frd_mps2=z,
        roll_rate_frd_radps=roll,
        pitch_rate_frd_radps=pitch,
        yaw_rate_frd_radps=yaw,
    )


def surfaces_sample(sequence: int, time_s: float, deflections: Sequence[float]) -> SurfacesSample:
    """What the autopilot reports of elevator, aileron and rudder, and of a brake if it has one."""
    elevator, aileron, rudder, *brake = deflections
    return SurfacesSample(
        sequence=sequence,
        time_s=time_s,
        elevator=elevator,
        aileron=aileron,
        rudder=rudder,
        brake=brake[0] if brake else NAN,
    )
