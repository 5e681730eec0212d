"""Attitude: samples of it, carried on with the body rates that are known.

    roll, pitch, heading (t + h) = the same (t) + h (rates(t) + rates(t + h)) / 2

with the rates of these angles.  Gyros that speak more often than the attitude, or with less
delay, carry it on from sample to sample; where neither source gives rates they are the
differences of the angles.
"""

from __future__ import annotations

from math import cos, sin, sqrt
from typing import Final, NamedTuple

from tgl_soar.geometry import (
    SoaringFrame,
    euler_from_quaternion,
    euler_rates,
    quaternion_product,
    wrap_angle,
)
from tgl_soar.types import NAN, AttitudeSample, ImuSample, isfinite

PREDICT_MAX_S: Final = 0.1  # attitude is carried on no further than this
DIFFERENCE_MIN_S: Final = 0.002  # over a shorter time the noise of stamps and angles is no rate


class Turning(NamedTuple):
    """Attitude and its rates; heading from straight upwind, rates those of the angles."""

    time_s: float  # the angles'; NaN: none yet
    roll_rad: float
    pitch_rad: float
    heading_rad: float
    roll_rate_radps: float
    pitch_rate_radps: float
    heading_rate_radps: float
    by_gyros: bool  # the rates are those of the gyros, at time_s
    before_s: float  # a sample that differences are taken from
    before_roll_rad: float
    before_pitch_rad: float
    before_heading_rad: float


NO_TURNING: Final = Turning(NAN, NAN, NAN, NAN, 0.0, 0.0, 0.0, False, NAN, NAN, NAN, NAN)


def is_rotation(sample: AttitudeSample) -> bool:
    """Whether a sample's quaternion has nearly unit length; false for NaN."""
    return 0.9 < _length(sample) < 1.1


def _length(sample: AttitudeSample) -> float:
    qw, qx, qy, qz = sample.qw, sample.qx, sample.qy, sample.qz
    return sqrt(qw * qw + qx * qx + qy * qy + qz * qz)


def turning_to(frame: SoaringFrame, turning: Turning, sample: AttitudeSample) -> Turning:
    """The attitude with a sample, later than the last one, taken in."""
    unit = 1.0 / _length(sample)
    half = 0.5 * frame.wind_from_rad
    qw, qx, qy, qz = quaternion_product(
        cos(half) * unit,
        0.0,
        0.0,
        -sin(half) * unit,
        sample.qw,
        sample.qx,
        sample.qy,
        sample.qz,
    )
    roll, pitch, heading = euler_from_quaternion(qw, qx, qy, qz)
    time_s = sample.time_s
    p, q, r = sample.roll_rate_frd_radps, sample.pitch_rate_frd_radps, sample.yaw_rate_frd_radps
    before_s, before_roll = turning.before_s, turning.before_roll_rad
    before_pitch, before_heading = turning.before_pitch_rad, turning.before_heading_rad
    roll_rate, pitch_rate, heading_rate = 0.0, 0.0, 0.0
    told = isfinite(p + q + r)
    if told:
        roll_rate, pitch_rate, heading_rate = euler_rates(roll, pitch, p, q, r)
    else:
        interval = time_s - before_s
        if DIFFERENCE_MIN_S <= interval <= PREDICT_MAX_S:
            roll_rate = wrap_angle(roll - before_roll) / interval
            pitch_rate = (pitch - before_pitch) / interval
            heading_rate = wrap_angle(heading - before_heading) / interval
        elif 0.0 < interval < DIFFERENCE_MIN_S:
            roll_rate, pitch_rate = turning.roll_rate_radps, turning.pitch_rate_radps
            heading_rate = turning.heading_rate_radps
        if not 0.0 < interval < DIFFERENCE_MIN_S:
            before_s, before_roll, before_pitch, before_heading = time_s, roll, pitch, heading
    ahead = turning.time_s - time_s
    if turning.by_gyros and -PREDICT_MAX_S < ahead <= PREDICT_MAX_S and (ahead >= 0.0 or not told):
        # The gyros are ahead of the sample, or they alone give rates.
        _, _, _, _, gyro_roll, gyro_pitch, gyro_heading, _, _, _, _, _ = turning
        if ahead >= 0.0:
            share = 0.5 * ahead if told else 0.0
            rest = ahead - share
            roll += share * roll_rate + rest * gyro_roll
            pitch += share * pitch_rate + rest * gyro_pitch
            heading += share * heading_rate + rest * gyro_heading
            time_s = turning.time_s
        roll_rate, pitch_rate, heading_rate = gyro_roll, gyro_pitch, gyro_heading
    return Turning(
        time_s,
        roll,
        pitch,
        heading,
        roll_rate,
        pitch_rate,
        heading_rate,
        turning.by_gyros and time_s == turning.time_s,
        before_s,
        before_roll,
        before_pitch,
        before_heading,
    )


def turned_by(turning: Turning, sample: ImuSample) -> Turning:
    """The attitude carried on to a later sample of the gyros, if it has rates."""
    p, q, r = sample.roll_rate_frd_radps, sample.pitch_rate_frd_radps, sample.yaw_rate_frd_radps
    h = sample.time_s - turning.time_s
    if not (isfinite(p + q + r) and 0.0 <= h <= PREDICT_MAX_S):
        return turning
    _, roll, pitch, heading, roll_rate, pitch_rate, heading_rate, _, s, a, b, c = turning
    p, q, r = euler_rates(roll + h * roll_rate, pitch + h * pitch_rate, p, q, r)
    half = 0.5 * h
    return Turning(
        sample.time_s,
        roll + half * (roll_rate + p),
        pitch + half * (pitch_rate + q),
        heading + half * (heading_rate + r),
        p,
        q,
        r,
        True,
        s,
        a,
        b,
        c,
    )
