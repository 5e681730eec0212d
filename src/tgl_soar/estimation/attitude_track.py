"""Attitude: samples of it, carried on with the body rates that are known.

    roll, pitch, heading (t + h) = the same (t) + h (rates(t) + rates(t + h)) / 2

with the rates of these angles.  Gyros that speak more often than the attitude, or with less
delay, carry it on from sample to sample; where neither source gives rates they are the
differences of the angles.

A rate beyond RATE_MAX_RADPS is no measurement, as none is given: no gyro of an autopilot measures
more than 4000 deg/s.  A sample that is turned from the one before by more than

    TURN_RAD + TURN_RADPS h

after a time h in which none came is not of the same aircraft (`is_turn`): full aileron rolls it at
3.4 rad/s, and twice as fast is what it may do in an upset.  Nor do its rates change by more than

    RATE_RADPS + RATE_RADPS2 h

on an axis: full aileron makes 67 rad/s² at 8.5 m/s, and twice that at 12 m/s.  Rates that do are
not used, until those of the next sample agree with them.
"""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from typing import Final, NamedTuple

from tgl_soar.geometry import (
    SoaringFrame,
    euler_from_quaternion,
    euler_rates,
    quaternion_product,
    wrap_angle,
)
from tgl_soar.types import NAN, AttitudeSample, ImuSample

PREDICT_MAX_S: Final = 0.1  # attitude is carried on no further than this
RATE_MAX_RADPS: Final = 70.0
TURN_RAD: Final = 0.64  # 36 degrees: what was lost or is noise between two samples
TURN_RADPS: Final = 7.0
RATE_RADPS: Final = 1.0  # noise, and what was lost between two samples
RATE_RADPS2: Final = 150.0
DIFFERENCE_MIN_S: Final = 0.002  # over a shorter time the noise of stamps and angles is no rate


class AttitudeTrack(NamedTuple):
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


NO_ATTITUDE_TRACK: Final = AttitudeTrack(
    time_s=NAN,
    roll_rad=NAN,
    pitch_rad=NAN,
    heading_rad=NAN,
    roll_rate_radps=0.0,
    pitch_rate_radps=0.0,
    heading_rate_radps=0.0,
    by_gyros=False,
    before_s=NAN,
    before_roll_rad=NAN,
    before_pitch_rad=NAN,
    before_heading_rad=NAN,
)


def is_rotation(sample: AttitudeSample) -> bool:
    """Whether a sample's quaternion has nearly unit length; false for NaN."""
    return 0.9 < _length(sample) < 1.1


def _length(sample: AttitudeSample) -> float:
    qw, qx, qy, qz = sample.qw, sample.qx, sample.qy, sample.qz
    return sqrt(qw * qw + qx * qx + qy * qy + qz * qz)


def is_rate(p_radps: float, q_radps: float, r_radps: float) -> bool:
    """Whether these may be rates that a gyro has measured; false for NaN."""
    return (
        abs(p_radps) <= RATE_MAX_RADPS
        and abs(q_radps) <= RATE_MAX_RADPS
        and abs(r_radps) <= RATE_MAX_RADPS
    )


def is_turn(before: AttitudeSample, after: AttitudeSample, interval_s: float) -> bool:
    """Whether an aircraft may turn from one attitude to the other in a time.

    True where one of the two is not known: NaN.
    """
    span = TURN_RAD + TURN_RADPS * abs(interval_s)
    if not span < pi:
        return True
    product = (
        before.qw * after.qw + before.qx * after.qx + before.qy * after.qy + before.qz * after.qz
    )
    return not abs(product) < cos(0.5 * span) * _length(before) * _length(after)


def rates_follow(before: AttitudeSample, after: AttitudeSample) -> bool:
    """Whether the body rates of one sample may be followed by those of the other.

    True where one of the two is not known: NaN.
    """
    most = RATE_RADPS + RATE_RADPS2 * abs(after.time_s - before.time_s)
    return not (
        abs(after.roll_rate_frd_radps - before.roll_rate_frd_radps) > most
        or abs(after.pitch_rate_frd_radps - before.pitch_rate_frd_radps) > most
        or abs(after.yaw_rate_frd_radps - before.yaw_rate_frd_radps) > most
    )


def turned_to(
    frame: SoaringFrame, attitude_track: AttitudeTrack, sample: AttitudeSample
) -> AttitudeTrack:
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
    before_s, before_roll = attitude_track.before_s, attitude_track.before_roll_rad
    before_pitch, before_heading = (
        attitude_track.before_pitch_rad,
        attitude_track.before_heading_rad,
    )
    roll_rate, pitch_rate, heading_rate = 0.0, 0.0, 0.0
    has_rates = is_rate(p, q, r)
    if has_rates:
        roll_rate, pitch_rate, heading_rate = euler_rates(roll, pitch, p, q, r)
    else:
        interval = time_s - before_s
        if DIFFERENCE_MIN_S <= interval <= PREDICT_MAX_S:
            roll_rate = wrap_angle(roll - before_roll) / interval
            pitch_rate = (pitch - before_pitch) / interval
            heading_rate = wrap_angle(heading - before_heading) / interval
        elif 0.0 < interval < DIFFERENCE_MIN_S:
            roll_rate, pitch_rate = attitude_track.roll_rate_radps, attitude_track.pitch_rate_radps
            heading_rate = attitude_track.heading_rate_radps
        if not 0.0 < interval < DIFFERENCE_MIN_S:
            before_s, before_roll, before_pitch, before_heading = time_s, roll, pitch, heading
    ahead = attitude_track.time_s - time_s
    if (
        attitude_track.by_gyros
        and -PREDICT_MAX_S < ahead <= PREDICT_MAX_S
        and (ahead >= 0.0 or not has_rates)
    ):
        # The gyros are ahead of the sample, or they alone give rates.
        _, _, _, _, gyro_roll, gyro_pitch, gyro_heading, _, _, _, _, _ = attitude_track
        if ahead >= 0.0:
            by_rates = 0.5 * ahead if has_rates else 0.0
            rest = ahead - by_rates
            roll += by_rates * roll_rate + rest * gyro_roll
            pitch += by_rates * pitch_rate + rest * gyro_pitch
            heading += by_rates * heading_rate + rest * gyro_heading
            time_s = attitude_track.time_s
        roll_rate, pitch_rate, heading_rate = gyro_roll, gyro_pitch, gyro_heading
    return AttitudeTrack(
        time_s=time_s,
        roll_rad=roll,
        pitch_rad=pitch,
        heading_rad=heading,
        roll_rate_radps=roll_rate,
        pitch_rate_radps=pitch_rate,
        heading_rate_radps=heading_rate,
        by_gyros=attitude_track.by_gyros and time_s == attitude_track.time_s,
        before_s=before_s,
        before_roll_rad=before_roll,
        before_pitch_rad=before_pitch,
        before_heading_rad=before_heading,
    )


def turned_by(attitude_track: AttitudeTrack, sample: ImuSample) -> AttitudeTrack:
    """The attitude carried on to a later sample of the gyros, if it has rates."""
    p, q, r = sample.roll_rate_frd_radps, sample.pitch_rate_frd_radps, sample.yaw_rate_frd_radps
    h = sample.time_s - attitude_track.time_s
    if not (is_rate(p, q, r) and 0.0 <= h <= PREDICT_MAX_S):
        return attitude_track
    _, roll, pitch, heading, roll_rate, pitch_rate, heading_rate, _, s, a, b, c = attitude_track
    p, q, r = euler_rates(roll + h * roll_rate, pitch + h * pitch_rate, p, q, r)
    half = 0.5 * h
    return AttitudeTrack(
        time_s=sample.time_s,
        roll_rad=roll + half * (roll_rate + p),
        pitch_rad=pitch + half * (pitch_rate + q),
        heading_rad=heading + half * (heading_rate + r),
        roll_rate_radps=p,
        pitch_rate_radps=q,
        heading_rate_radps=r,
        by_gyros=True,
        before_s=s,
        before_roll_rad=a,
        before_pitch_rad=b,
        before_heading_rad=c,
    )
