"""A Kalman filter on what the inertial track is wrong by, from fix to fix.

With d = truth - track, and b the bias of the accelerations, on each axis of the soaring frame

    d(p)' = d(v)        d(v)' = -b + w        b' = u            w, u white, of densities q, q_b

is linear, does not depend on the flight, and is known in closed form over any time T:

        | 1  T  -T²/2 |         | q T³/3   q T²/2   0 |         | T⁵/20   T⁴/8   -T³/6 |
    F = | 0  1  -T    |     Q = | q T²/2   q T      0 |  +  q_b | T⁴/8    T³/3   -T²/2 |
        | 0  0   1    |         | 0        0        0 |         | -T³/6  -T²/2    T    |

So a late fix needs no replay of the accelerations since: the filter lives at the fixes' own
times, and truth = track + d is the same estimate that a filter of position and velocity has
which goes back to the fix's time and takes all samples in again (tests/estimation hold one
against the other).  The axes do not mix and are measured alike, so that one covariance serves
all three.

Where nobody measured accelerations the track went straight on: then b does not act, and q is
that of an aircraft whose acceleration nobody measures (a constant-velocity model).

Source: Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with Applications to Tracking and
Navigation (2001), ch. 5 (filter, NIS, NEES) and 6 (kinematic models); P. S. Maybeck, Stochastic
Models, Estimation, and Control, vol. 1 (1979), 6.3 (filtering the errors of an inertial system).
"""

from __future__ import annotations

from typing import NamedTuple

from tgl_soar.estimation.inertial_track import Place


class Covariance(NamedTuple):
    """Of position [m], velocity [m/s] and bias [m/s²] on one axis."""

    pp: float  # variance of the position
    pv: float  # covariance of position and velocity
    pb: float  # of position and bias
    vv: float  # variance of the velocity
    vb: float  # covariance of velocity and bias
    bb: float  # variance of the bias


Moments = tuple[float, float, float, float, float, float]  # those of a `Covariance`, in its order


class Errors(NamedTuple):
    """What the track is wrong by at one time: truth less track, soaring frame."""

    time_s: float
    x_m: float
    y_m: float
    z_m: float
    velocity_x_mps: float
    velocity_y_mps: float
    climb_mps: float
    bias_x_mps2: float  # of the accelerations: measured less true
    bias_y_mps2: float
    bias_z_mps2: float
    covariance: Covariance


def errors_at(errors: Errors, time_s: float, coupling: float) -> Place:
    """Position and velocity of the errors at another time; the biases stay.

    coupling: 1 where accelerations were measured, else 0.
    """
    t = time_s - errors.time_s
    h = coupling * t
    q = 0.5 * h * t
    bx, by, bz = errors.bias_x_mps2, errors.bias_y_mps2, errors.bias_z_mps2
    vx, vy, vz = errors.velocity_x_mps, errors.velocity_y_mps, errors.climb_mps
    return (
        errors.x_m + vx * t - bx * q,
        errors.y_m + vy * t - by * q,
        errors.z_m + vz * t - bz * q,
        vx - bx * h,
        vy - by * h,
        vz - bz * h,
    )


def errors_carried(before: Errors, time_s: float, at: Place, covariance: Moments) -> Errors:
    """The errors carried on to a time, where they are `at`; the biases stay."""
    x, y, z, vx, vy, climb = at
    pp, pv, pb, vv, vb, bb = covariance
    return Errors(
        time_s=time_s,
        x_m=x,
        y_m=y,
        z_m=z,
        velocity_x_mps=vx,
        velocity_y_mps=vy,
        climb_mps=climb,
        bias_x_mps2=before.bias_x_mps2,
        bias_y_mps2=before.bias_y_mps2,
        bias_z_mps2=before.bias_z_mps2,
        covariance=Covariance(pp=pp, pv=pv, pb=pb, vv=vv, vb=vb, bb=bb),
    )


def spread(
    covariance: Moments, t_s: float, coupling: float, density: float, bias_density: float
) -> Moments:
    """The covariance after a time; densities q [m²/s³] and q_b [m²/s⁵]."""
    pp, pv, pb, vv, vb, bb = covariance
    t = t_s
    h = coupling * t  # d v / d b, less its sign
    k = 0.5 * h * t  # d p / d b, less its sign
    # F P Fᵀ, row by row.
    pb_new = pb + t * vb - k * bb
    vb_new = vb - h * bb
    pv_new = pv + t * vv - k * vb - h * pb_new
    pp_new = pp + t * (pv + pv) + t * t * vv - k * (pb + pb_new) - t * k * vb
    vv_new = vv - h * (vb + vb_new)
    tt = t * t
    u = coupling * bias_density
    return (
        pp_new + tt * t * (density / 3.0 + u * tt / 20.0),
        pv_new + tt * (0.5 * density + u * tt / 8.0),
        pb_new - u * tt * t / 6.0,
        vv_new + t * (density + u * tt / 3.0),
        vb_new - u * 0.5 * tt,
        bb + u * t,
    )


def position_taken(
    errors: Errors, rx_m: float, ry_m: float, rz_m: float, variance: float
) -> Errors:
    """The errors after positions whose innovations are r, each of this variance [m²]."""
    start, x, y, z, vx, vy, vz, bx, by, bz, (pp, pv, pb, vv, vb, bb) = errors
    weight = 1.0 / (pp + variance)
    g, h, k = pp * weight, pv * weight, pb * weight
    left = variance * weight  # 1 - g, exact where g is nearly 1
    return Errors(
        time_s=start,
        x_m=x + g * rx_m,
        y_m=y + g * ry_m,
        z_m=z + g * rz_m,
        velocity_x_mps=vx + h * rx_m,
        velocity_y_mps=vy + h * ry_m,
        climb_mps=vz + h * rz_m,
        bias_x_mps2=bx + k * rx_m,
        bias_y_mps2=by + k * ry_m,
        bias_z_mps2=bz + k * rz_m,
        covariance=Covariance(
            pp=left * pp, pv=left * pv, pb=left * pb, vv=vv - h * pv, vb=vb - h * pb, bb=bb - k * pb
        ),
    )


def velocity_taken(
    errors: Errors, rx_mps: float, ry_mps: float, rz_mps: float, variance: float
) -> Errors:
    """The errors after velocities whose innovations are r, each of this variance [m²/s²]."""
    start, x, y, z, vx, vy, vz, bx, by, bz, (pp, pv, pb, vv, vb, bb) = errors
    weight = 1.0 / (vv + variance)
    g, h, k = pv * weight, vv * weight, vb * weight
    left = variance * weight
    return Errors(
        time_s=start,
        x_m=x + g * rx_mps,
        y_m=y + g * ry_mps,
        z_m=z + g * rz_mps,
        velocity_x_mps=vx + h * rx_mps,
        velocity_y_mps=vy + h * ry_mps,
        climb_mps=vz + h * rz_mps,
        bias_x_mps2=bx + k * rx_mps,
        bias_y_mps2=by + k * ry_mps,
        bias_z_mps2=bz + k * rz_mps,
        covariance=Covariance(
            pp=pp - g * pv, pv=left * pv, pb=pb - g * vb, vv=left * vv, vb=left * vb, bb=bb - k * vb
        ),
    )
