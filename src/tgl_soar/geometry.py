"""Frames and rotations: quaternions, NED and FRD, the soaring frame, angles.

The soaring frame stands in the site: its origin in local NED, its x axis with the wind.
Its "upwind NED" sister frame (N' upwind, E' right of an aircraft facing upwind, D' down) is
local NED turned about the vertical by the direction the wind comes from, so that

    x = -N',  y = E',  z = -D'

and heading is the yaw in that frame: zero facing straight upwind.  Signs change between NED
and the soaring frame here and nowhere else.

A motion-capture hall has its own axes, with y or z up.  Levelled, they are N'' = x, D'' down and
E'' the third; turned about the vertical by the direction of the hall's x axis and put where its
origin lies, they are local NED.

A quaternion (w, x, y, z) rotates body FRD into NED, Hamilton convention, as MAVLink has it.
"""

from __future__ import annotations

from math import asin, atan2, cos, pi, sin
from typing import Final, NamedTuple

NORM_ERROR: Final = 0.02  # of a quaternion, from one


class SoaringFrame(NamedTuple):
    """Where the soaring frame stands in local NED."""

    origin_north_m: float
    origin_east_m: float
    origin_down_m: float
    # True direction, clockwise from north, that the wind comes from or, at a ridge that it blows
    # at obliquely, that is straight off the ridge: x is away from there.
    wind_from_rad: float


class HallFrame(NamedTuple):
    """Where the axes of a motion-capture hall stand in local NED."""

    z_up: bool  # else y is up
    yaw_rad: float  # direction that the hall's x axis points to, clockwise from north
    origin_north_m: float
    origin_east_m: float
    origin_down_m: float


def wrap_angle(angle_rad: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle_rad + pi) % (2.0 * pi) - pi


def soaring_from_ned(
    frame: SoaringFrame, north_m: float, east_m: float, down_m: float
) -> tuple[float, float, float]:
    """Soaring-frame position (x, y, z) [m] of a local NED position [m]."""
    vx, vy, vz = soaring_vector_from_ned(
        frame,
        north_m - frame.origin_north_m,
        east_m - frame.origin_east_m,
        down_m - frame.origin_down_m,
    )
    return vx, vy, vz


def ned_from_hall(
    hall: HallFrame, x_m: float, y_m: float, z_m: float
) -> tuple[float, float, float]:
    """Local NED position [m] of a position in the hall's axes [m]."""
    north, east, down = levelled(x_m, y_m, z_m, z_up=hall.z_up)
    c, s = cos(hall.yaw_rad), sin(hall.yaw_rad)
    return (
        hall.origin_north_m + c * north - s * east,
        hall.origin_east_m + s * north + c * east,
        hall.origin_down_m + down,
    )


def hall_from_ned(
    hall: HallFrame, north_m: float, east_m: float, down_m: float
) -> tuple[float, float, float]:
    """Position in the hall's axes [m] of a local NED position [m]."""
    dn, de = north_m - hall.origin_north_m, east_m - hall.origin_east_m
    down = down_m - hall.origin_down_m
    c, s = cos(hall.yaw_rad), sin(hall.yaw_rad)
    north, east = c * dn + s * de, c * de - s * dn
    return (north, -east, -down) if hall.z_up else (north, -down, east)


def levelled(x_m: float, y_m: float, z_m: float, *, z_up: bool) -> tuple[float, float, float]:
    """A position in the hall's axes with N'' = x, E'' and D'' down; both are right-handed."""
    return (x_m, -y_m, -z_m) if z_up else (x_m, z_m, -y_m)


def soaring_vector_from_ned(
    frame: SoaringFrame, north: float, east: float, down: float
) -> tuple[float, float, float]:
    """Components in the soaring frame of a vector given in local NED, any unit."""
    c, s = cos(frame.wind_from_rad), sin(frame.wind_from_rad)
    upwind = c * north + s * east
    right = -s * north + c * east
    return -upwind, right, -down


def ned_vector_from_soaring(
    frame: SoaringFrame, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Components in local NED of a vector given in the soaring frame, any unit."""
    c, s = cos(frame.wind_from_rad), sin(frame.wind_from_rad)
    upwind, right = -x, y
    return c * upwind - s * right, s * upwind + c * right, -z


def ned_from_soaring(
    frame: SoaringFrame, x_m: float, y_m: float, z_m: float
) -> tuple[float, float, float]:
    """Local NED position [m] of a soaring-frame position [m]."""
    north, east, down = ned_vector_from_soaring(frame, x_m, y_m, z_m)
    return (
        north + frame.origin_north_m,
        east + frame.origin_east_m,
        down + frame.origin_down_m,
    )


def euler_from_quaternion(qw: float, qx: float, qy: float, qz: float) -> tuple[float, float, float]:
    """(roll, pitch, yaw) [rad] of a rotation from FRD to NED; needs a unit quaternion."""
    sin_pitch = 2.0 * (qw * qy - qz * qx)
    return (
        atan2(2.0 * (qw * qx + qy * qz), 1.0 - 2.0 * (qx * qx + qy * qy)),
        asin(max(-1.0, min(1.0, sin_pitch))),
        atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz)),
    )


def quaternion_from_euler(
    roll_rad: float, pitch_rad: float, yaw_rad: float
) -> tuple[float, float, float, float]:
    """Unit quaternion (w, x, y, z) from FRD to NED of (roll, pitch, yaw), applied z-y-x."""
    cr, sr = cos(0.5 * roll_rad), sin(0.5 * roll_rad)
    cp, sp = cos(0.5 * pitch_rad), sin(0.5 * pitch_rad)
    cy, sy = cos(0.5 * yaw_rad), sin(0.5 * yaw_rad)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def quaternion_product(
    aw: float, ax: float, ay: float, az: float, bw: float, bx: float, by: float, bz: float
) -> tuple[float, float, float, float]:
    """Hamilton product a ⊗ b: first b, then a."""
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def is_rotation(qw: float, qx: float, qy: float, qz: float) -> bool:
    """Whether a quaternion's norm is one, within NORM_ERROR; never for NaN."""
    square = qw * qw + qx * qx + qy * qy + qz * qz
    return abs(square - 1.0) <= 2.0 * NORM_ERROR


def rotated(
    q: tuple[float, float, float, float], v: tuple[float, float, float]
) -> tuple[float, float, float]:
    """A vector turned by a unit quaternion: FRD to NED, or back by the conjugate."""
    w, x, y, z = q
    vx, vy, vz = v
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )


def in_body_axes(
    qw: float, qx: float, qy: float, qz: float, north: float, east: float, down: float
) -> tuple[float, float, float]:
    """Components along body FRD of a vector given in NED, any unit; needs a unit quaternion."""
    return (
        (1.0 - 2.0 * (qy * qy + qz * qz)) * north
        + 2.0 * (qx * qy + qw * qz) * east
        + 2.0 * (qx * qz - qw * qy) * down,
        2.0 * (qx * qy - qw * qz) * north
        + (1.0 - 2.0 * (qx * qx + qz * qz)) * east
        + 2.0 * (qy * qz + qw * qx) * down,
        2.0 * (qx * qz + qw * qy) * north
        + 2.0 * (qy * qz - qw * qx) * east
        + (1.0 - 2.0 * (qx * qx + qy * qy)) * down,
    )


def ned_attitude_from_hall(
    hall: HallFrame, qw: float, qx: float, qy: float, qz: float
) -> tuple[float, float, float, float]:
    """The rotation from FRD to local NED of a tracked body's rotation in the hall's axes.

    A tracker calls a body's attitude identity as it stands when it is defined: level and with
    its nose to the north of local NED, as docs/sensors.md asks for.
    """
    level = hall._replace(origin_north_m=0.0, origin_east_m=0.0, origin_down_m=0.0)
    return (qw, *ned_from_hall(level, qx, qy, qz))


def euler_rates(
    roll_rad: float,
    pitch_rad: float,
    roll_rate_frd_radps: float,
    pitch_rate_frd_radps: float,
    yaw_rate_frd_radps: float,
) -> tuple[float, float, float]:
    """Rates of (roll, pitch, yaw) [rad/s] from body rates (p, q, r) [rad/s].

    Near straight up or down the yaw rate has no meaning: cos(pitch) is kept above 0.05.
    """
    sr, cr = sin(roll_rad), cos(roll_rad)
    horizontal = sr * pitch_rate_frd_radps + cr * yaw_rate_frd_radps
    cos_pitch = max(0.05, cos(pitch_rad))
    yaw_rate = horizontal / cos_pitch
    return (
        roll_rate_frd_radps + sin(pitch_rad) * yaw_rate,
        cr * pitch_rate_frd_radps - sr * yaw_rate_frd_radps,
        yaw_rate,
    )
