"""From fixes and attitude samples to the state of the aircraft at the time of the tick.

Position and velocity are carried on with constant velocity between fixes,

    p(t + dt) = p + v dt

and corrected when a fix arrives, at the time when the fix was *true*: with the innovation
r = p_fix - p(t_fix), the interval T to the fix before, and the bandwidths w_p, w_v

    p += (1 - e^{-2 w_p T}) r                        critically damped
    v += (1 - e^{-w_v T}) (v_fix - v)                where the fix has a velocity
    v += (1 - e^{-w_p T})² r / T                     where it has none

Attitude is turned into roll, pitch and heading, and carried on to the tick with its rates.
Where a source gives no body rates they are the differences of its angles.

A fix that lies further from the prediction than any flight explains,

    |r| > gate + v_gate T

is an outlier: swapped markers, a glitch of the autopilot's filter.  It is refused and counted,
until `OUTLIERS_BELIEVED` of them in a row agree with each other: then the aircraft is there,
and the estimate starts afresh.

A sample that is not finite, is no rotation, comes from the future, or is not later than the
one before is refused and counted.  Where the one before lies in the future itself the clock has
gone back: it is forgotten, and the sample starts afresh.
"""

from __future__ import annotations

from math import exp, isfinite, sqrt
from typing import NamedTuple

from tgl_soar.geometry import (
    SoaringFrame,
    euler_from_quaternion,
    euler_rates,
    soaring_from_ned,
    soaring_vector_from_ned,
    wrap_angle,
)
from tgl_soar.types import NAN, AttitudeSample, Inputs, PositionFix, VehicleState

FUTURE_S = 0.05  # a time stamp may be this far ahead of the tick: clock mapping is not exact
RESTART_S = 1.0  # after a gap of this length the fix says more than the prediction
GATE_MPS = 5.0  # how wrong the estimated velocity may be
OUTLIERS_BELIEVED = 5
PREDICT_MAX_S = 0.1  # attitude is carried on no further than this


class MotionGains(NamedTuple):
    """Parameters of the estimator."""

    position_bandwidth_radps: float
    velocity_bandwidth_radps: float
    fix_delay_s: float  # of the source, beyond what its time stamps tell
    fix_gate_m: float  # innovation beyond which a fix is an outlier


class MotionState(NamedTuple):
    """What the estimator remembers; positions in the soaring frame."""

    time_s: float  # the position's and the velocity's
    x_m: float
    y_m: float
    z_m: float
    velocity_x_mps: float
    velocity_y_mps: float
    climb_mps: float
    fix_sequence: int  # of the last fix looked at
    fix_time_s: float  # of the last fix used; NaN: none yet
    attitude_sequence: int
    attitude_time_s: float  # of the last sample used; NaN: none yet
    roll_rad: float
    pitch_rad: float
    heading_rad: float
    roll_rate_radps: float
    pitch_rate_radps: float
    heading_rate_radps: float
    rejected: int
    outliers: int  # in a row, agreeing with each other
    outlier_time_s: float  # the last of them
    outlier_x_m: float
    outlier_y_m: float
    outlier_z_m: float


def initial_motion() -> MotionState:
    """Nothing is known yet."""
    return MotionState(
        time_s=NAN,
        x_m=NAN,
        y_m=NAN,
        z_m=NAN,
        velocity_x_mps=0.0,
        velocity_y_mps=0.0,
        climb_mps=0.0,
        fix_sequence=0,
        fix_time_s=NAN,
        attitude_sequence=0,
        attitude_time_s=NAN,
        roll_rad=NAN,
        pitch_rad=NAN,
        heading_rad=NAN,
        roll_rate_radps=0.0,
        pitch_rate_radps=0.0,
        heading_rate_radps=0.0,
        rejected=0,
        outliers=0,
        outlier_time_s=NAN,
        outlier_x_m=NAN,
        outlier_y_m=NAN,
        outlier_z_m=NAN,
    )


def motion_step(
    gains: MotionGains, frame: SoaringFrame, state: MotionState, inputs: Inputs
) -> tuple[MotionState, VehicleState]:
    """Take in what is new and give the state of the aircraft at inputs.time_s."""
    if inputs.position.sequence != state.fix_sequence:
        state = _take_fix(gains, frame, state, inputs.position, inputs.time_s)
    if inputs.attitude.sequence != state.attitude_sequence:
        state = _take_attitude(frame, state, inputs.attitude, inputs.time_s)
    return state, _at(state, inputs.time_s)


def _at(state: MotionState, time_s: float) -> VehicleState:
    """The state carried on to time_s."""
    ahead = time_s - state.time_s
    turn = max(0.0, min(PREDICT_MAX_S, time_s - state.attitude_time_s))
    return VehicleState(
        time_s,
        state.x_m + state.velocity_x_mps * ahead,
        state.y_m + state.velocity_y_mps * ahead,
        state.z_m + state.climb_mps * ahead,
        state.velocity_x_mps,
        state.velocity_y_mps,
        state.climb_mps,
        state.roll_rad + state.roll_rate_radps * turn,
        state.pitch_rad + state.pitch_rate_radps * turn,
        state.heading_rad + state.heading_rate_radps * turn,
        state.roll_rate_radps,
        state.pitch_rate_radps,
        state.heading_rate_radps,
    )


def _take_fix(
    gains: MotionGains,
    frame: SoaringFrame,
    state: MotionState,
    fix: PositionFix,
    time_s: float,
) -> MotionState:
    fix_time = fix.time_s - gains.fix_delay_s
    usable = (
        isfinite(fix.north_m)
        and isfinite(fix.east_m)
        and isfinite(fix.down_m)
        and fix_time <= time_s + FUTURE_S
        # Not of the past, unless what is known is of the future; NaN: the first one.
        and (not fix_time <= state.fix_time_s or state.fix_time_s > time_s + FUTURE_S)
    )
    if not usable:
        return state._replace(fix_sequence=fix.sequence, rejected=state.rejected + 1)

    x, y, z = soaring_from_ned(frame, fix.north_m, fix.east_m, fix.down_m)
    has_velocity = (
        isfinite(fix.velocity_north_mps)
        and isfinite(fix.velocity_east_mps)
        and isfinite(fix.velocity_down_mps)
    )
    fix_vx, fix_vy, fix_climb = 0.0, 0.0, 0.0
    if has_velocity:
        fix_vx, fix_vy, fix_climb = soaring_vector_from_ned(
            frame, fix.velocity_north_mps, fix.velocity_east_mps, fix.velocity_down_mps
        )

    interval = fix_time - state.fix_time_s
    if 0.0 < interval < RESTART_S:  # false for NaN: the first fix starts afresh too
        ahead = fix_time - state.time_s
        px = state.x_m + state.velocity_x_mps * ahead
        py = state.y_m + state.velocity_y_mps * ahead
        pz = state.z_m + state.climb_mps * ahead
        if _apart(x - px, y - py, z - pz) > gains.fix_gate_m + GATE_MPS * interval:
            return _take_outlier(
                gains, state, fix.sequence, fix_time, x, y, z, fix_vx, fix_vy, fix_climb
            )
        fade = exp(-gains.position_bandwidth_radps * interval)
        g = 1.0 - fade * fade
        if has_velocity:
            h = 1.0 - exp(-gains.velocity_bandwidth_radps * interval)
            vx = state.velocity_x_mps + h * (fix_vx - state.velocity_x_mps)
            vy = state.velocity_y_mps + h * (fix_vy - state.velocity_y_mps)
            climb = state.climb_mps + h * (fix_climb - state.climb_mps)
        else:
            h = (1.0 - fade) * (1.0 - fade) / interval
            vx = state.velocity_x_mps + h * (x - px)
            vy = state.velocity_y_mps + h * (y - py)
            climb = state.climb_mps + h * (z - pz)
        x, y, z = px + g * (x - px), py + g * (y - py), pz + g * (z - pz)
    else:
        vx, vy, climb = fix_vx, fix_vy, fix_climb
    return state._replace(
        time_s=fix_time,
        x_m=x,
        y_m=y,
        z_m=z,
        velocity_x_mps=vx,
        velocity_y_mps=vy,
        climb_mps=climb,
        fix_sequence=fix.sequence,
        fix_time_s=fix_time,
        outliers=0,
    )


def _apart(x_m: float, y_m: float, z_m: float) -> float:
    """Length of a vector."""
    return sqrt(x_m * x_m + y_m * y_m + z_m * z_m)


def _take_outlier(
    gains: MotionGains,
    state: MotionState,
    sequence: int,
    fix_time_s: float,
    x_m: float,
    y_m: float,
    z_m: float,
    velocity_x_mps: float,
    velocity_y_mps: float,
    climb_mps: float,
) -> MotionState:
    """Refuse a fix far from the prediction, or start afresh where enough of them agree."""
    if state.outliers > 0 and fix_time_s <= state.outlier_time_s:  # again, over another link
        return state._replace(fix_sequence=sequence, rejected=state.rejected + 1)
    away = _apart(x_m - state.outlier_x_m, y_m - state.outlier_y_m, z_m - state.outlier_z_m)
    near = gains.fix_gate_m + GATE_MPS * (fix_time_s - state.outlier_time_s)
    outliers = state.outliers + 1 if state.outliers > 0 and away <= near else 1
    if outliers >= OUTLIERS_BELIEVED:
        return state._replace(
            time_s=fix_time_s,
            x_m=x_m,
            y_m=y_m,
            z_m=z_m,
            velocity_x_mps=velocity_x_mps,
            velocity_y_mps=velocity_y_mps,
            climb_mps=climb_mps,
            fix_sequence=sequence,
            fix_time_s=fix_time_s,
            outliers=0,
        )
    return state._replace(
        fix_sequence=sequence,
        rejected=state.rejected + 1,
        outliers=outliers,
        outlier_time_s=fix_time_s,
        outlier_x_m=x_m,
        outlier_y_m=y_m,
        outlier_z_m=z_m,
    )


def _take_attitude(
    frame: SoaringFrame, state: MotionState, sample: AttitudeSample, time_s: float
) -> MotionState:
    qw, qx, qy, qz = sample.qw, sample.qx, sample.qy, sample.qz
    norm = sqrt(qw * qw + qx * qx + qy * qy + qz * qz)
    usable = (
        0.9 < norm < 1.1  # false for NaN: not a rotation
        and sample.time_s <= time_s + FUTURE_S
        and (
            not sample.time_s <= state.attitude_time_s or state.attitude_time_s > time_s + FUTURE_S
        )
    )
    if not usable:
        return state._replace(attitude_sequence=sample.sequence, rejected=state.rejected + 1)

    roll, pitch, yaw = euler_from_quaternion(qw / norm, qx / norm, qy / norm, qz / norm)
    heading = wrap_angle(yaw - frame.wind_from_rad)
    p, q, r = sample.roll_rate_frd_radps, sample.pitch_rate_frd_radps, sample.yaw_rate_frd_radps
    interval = sample.time_s - state.attitude_time_s
    if isfinite(p) and isfinite(q) and isfinite(r):
        roll_rate, pitch_rate, heading_rate = euler_rates(roll, pitch, p, q, r)
    elif 0.0 < interval < PREDICT_MAX_S:
        roll_rate = wrap_angle(roll - state.roll_rad) / interval
        pitch_rate = (pitch - state.pitch_rad) / interval
        heading_rate = wrap_angle(heading - state.heading_rad) / interval
    else:
        roll_rate, pitch_rate, heading_rate = 0.0, 0.0, 0.0
    return state._replace(
        attitude_sequence=sample.sequence,
        attitude_time_s=sample.time_s,
        roll_rad=roll,
        pitch_rad=pitch,
        heading_rad=heading,
        roll_rate_radps=roll_rate,
        pitch_rate_radps=pitch_rate,
        heading_rate_radps=heading_rate,
    )
