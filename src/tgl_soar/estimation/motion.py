"""From fixes, attitude and accelerations to the state of the aircraft at the time of the tick.

Accelerations move an inertial track from sample to sample (`inertial_track`):

    a = R(roll, pitch, heading) f + g

f the specific force, turned by the attitude (`attitude_track`) into the soaring frame.  A Kalman
filter (`fix_filter`) estimates from fix to fix, each at the time when it was *true*, the error of
the track and the bias of the accelerations.  The state is track plus error, at any time
(`motion_state`); a late fix costs no more than one in time, as long as the track remembers its
time; a later one is refused.  Which fixes are accepted stands in `position_fixes`.

Without accelerations the track goes straight on and the filter assumes an unknown acceleration of
a given size: a constant-velocity model.  Accelerations are used from IMU_STEADY_S after they have
become frequent enough until they stop.

An attitude turned further than an aircraft can turn since the last used (`attitude_track.is_turn`)
is refused, until `OUTLIERS_ACCEPTED` in a row agree.

A sample that is not finite, is no rotation, comes from the future, or is not later than the
one before is refused and counted.  Where the one before lies in the future itself, the clock has
gone back: position and velocity are reset, and the estimate begins with this sample.
"""

from __future__ import annotations

from math import cos, sin, sqrt
from typing import Final

from tgl_soar.estimation.attitude_track import (
    NO_ATTITUDE_TRACK,
    PREDICT_MAX_S,
    AttitudeTrack,
    is_rotation,
    is_turn,
    rates_follow,
    turned_by,
    turned_to,
)
from tgl_soar.estimation.inertial_track import Track, new_track, track_at, track_moved
from tgl_soar.estimation.motion_state import (
    FUTURE_S,
    NO_NOISE,
    NO_OUTLIERS,
    NO_RECKONING,
    NO_SHIFT,
    OUTLIERS_ACCEPTED,
    LastAttitude,
    LastImu,
    MotionGains,
    MotionState,
    Reckoning,
    covariance_at,
    errors_when_switched,
    initial_motion,
    is_later,
    track_errors_at,
)
from tgl_soar.estimation.position_fixes import take_fix
from tgl_soar.geometry import SoaringFrame
from tgl_soar.types import (
    GRAVITY_MPS2,
    NAN,
    NO_ATTITUDE,
    AttitudeSample,
    ImuSample,
    Inputs,
    MotionQuality,
    VehicleState,
)

FORCE_MAX_MPS2: Final = 200.0  # of 20 g nothing soars; hostile or broken
IMU_GAP_S: Final = 0.055  # accelerations are counted on where they come more often than this
IMU_STEADY_S: Final = 0.1  # and have done so for this long
IMU_SILENT_S: Final = 0.08  # until the last is older than this
INTERVAL_FRACTION: Final = 0.02  # of the newest interval in the known one
JUMP_S: Final = 0.4  # longer than the supervisor keeps a line over a gap


def motion_step(
    gains: MotionGains,
    frame: SoaringFrame,
    state: MotionState,
    inputs: Inputs,
    flying: bool = False,
) -> tuple[MotionState, VehicleState]:
    """Take in what is new and give the state of the aircraft at inputs.time_s.

    flying: the module is in control, so that the aircraft does not stand still.
    """
    now = inputs.time_s
    newest = now + FUTURE_S
    if (
        not state.track.time_s <= newest  # the first tick, or the clock has gone back
        or state.errors.time_s > newest
        or state.attitude.time_s > newest
    ):
        state = _forgotten(state, now)
    state = _carried(gains, frame, state, inputs)
    if inputs.position.sequence != state.fix.sequence:
        state = take_fix(gains, frame, state, inputs.position, now, flying)
    return state, _at(state, now)


def is_imu_valid(before: MotionState, after: MotionState, time_s: float) -> bool:
    """Whether the estimator has taken new accelerations in this tick, and they are of now."""
    return (
        after.imu.time_s != before.imu.time_s
        and time_s - after.imu.time_s <= IMU_SILENT_S  # false for NaN
    )


def motion_quality(
    gains: MotionGains, before: MotionState, after: MotionState, time_s: float
) -> MotionQuality:
    """What a tick at time_s did with what was new, and how uncertain the estimate is then."""
    pp, _, _, vv, _, bb = covariance_at(gains, after, time_s)
    sequence, used_s, source, _, _ = after.fix
    looked_at = sequence != before.fix.sequence
    used = looked_at and used_s == used_s and used_s != before.fix.time_s  # not NaN
    refused = looked_at and not used
    errors = after.errors
    x, y, z, nis = after.innovation
    ox, oy, oz = after.offset
    shift_x, shift_y, shift_z = after.shift
    return MotionQuality(
        innovation_x_m=x,
        innovation_y_m=y,
        innovation_z_m=z,
        nis=nis,
        position_sigma_m=_root(pp + ox * ox + oy * oy + oz * oz),
        velocity_sigma_mps=_root(vv),
        bias_x_mps2=errors.bias_x_mps2,
        bias_y_mps2=errors.bias_y_mps2,
        bias_z_mps2=errors.bias_z_mps2,
        bias_sigma_mps2=_root(bb),
        offset_x_m=ox,
        offset_y_m=oy,
        offset_z_m=oz,
        shift_x_m=shift_x,
        shift_y_m=shift_y,
        shift_z_m=shift_z,
        source=source,
        fix_used=used,
        fix_refused=refused,
        jumped=time_s - after.jump_s < JUMP_S,  # false for NaN
        inertial=after.inertial,
        reckoned_s=_reckoned_for(after.reckoning, time_s),
    )


def unshifted(state: MotionState, now_s: float) -> MotionState:
    """The estimate in the source's own frame again: nothing is flown that would feel the step."""
    x, y, z = state.shift
    if x == 0.0 and y == 0.0 and z == 0.0:
        return state
    errors = state.errors
    moved = errors._replace(x_m=errors.x_m + x, y_m=errors.y_m + y, z_m=errors.z_m + z)
    return state._replace(errors=moved, shift=NO_SHIFT, jump_s=now_s)


def _reckoned_for(reckoning: Reckoning, now_s: float) -> float:
    """For how long the position has been dead reckoned alone; 0: it is measured."""
    return max(0.0, now_s - reckoning.since_s) if reckoning.now else 0.0


def _root(variance: float) -> float:
    """A standard deviation; NaN, nothing is known, stays NaN."""
    return 0.0 if variance < 0.0 else sqrt(variance)


def _forgotten(state: MotionState, now_s: float) -> MotionState:
    """Position and velocity are unknown; the bias is kept."""
    unknown = initial_motion()
    old, none = state.errors, unknown.errors
    return state._replace(
        track=new_track(now_s),
        errors=none._replace(
            bias_x_mps2=old.bias_x_mps2,
            bias_y_mps2=old.bias_y_mps2,
            bias_z_mps2=old.bias_z_mps2,
            covariance=none.covariance._replace(bb=old.covariance.bb),
        ),
        inertial=False,
        switched_s=NAN,
        imu=state.imu._replace(time_s=NAN, since_s=NAN),
        fix=state.fix._replace(time_s=NAN),
        shift=NO_SHIFT,
        noise=NO_NOISE,
        outliers=NO_OUTLIERS,
        reckoning=NO_RECKONING,
        jump_s=NAN,
        astray_s=NAN,
    )


def _at(state: MotionState, time_s: float) -> VehicleState:
    """The state carried on to time_s."""
    x, y, z, vx, vy, climb = track_at(state.track, time_s)
    dx, dy, dz, dvx, dvy, d_climb = track_errors_at(state, time_s)
    turned_s, roll, pitch, heading, roll_rate, pitch_rate, heading_rate, _, _, _, _, _ = (
        state.attitude_track
    )
    turn = max(0.0, min(PREDICT_MAX_S, time_s - turned_s))
    return VehicleState(
        time_s=time_s,
        x_m=x + dx,
        y_m=y + dy,
        z_m=z + dz,
        velocity_x_mps=vx + dvx,
        velocity_y_mps=vy + dvy,
        climb_mps=climb + d_climb,
        roll_rad=roll + roll_rate * turn,
        pitch_rad=pitch + pitch_rate * turn,
        heading_rad=heading + heading_rate * turn,
        roll_rate_radps=roll_rate,
        pitch_rate_radps=pitch_rate,
        heading_rate_radps=heading_rate,
    )


def _carried(
    gains: MotionGains, frame: SoaringFrame, state: MotionState, inputs: Inputs
) -> MotionState:
    """Attitude and track carried on with what is new of attitudes, gyros and accelerations."""
    now = inputs.time_s
    attitude, imu, attitude_track = state.attitude, state.imu, state.attitude_track
    track, errors, inertial = state.track, state.errors, state.inertial
    switched_s, rejected = state.switched_s, state.rejected

    sample = inputs.attitude
    if sample.sequence != attitude.sequence:
        attitude, attitude_track = _take_attitude(frame, attitude, attitude_track, sample, now)
        if attitude.used.sequence != sample.sequence:
            rejected += 1

    force = inputs.imu
    if force.sequence != imu.sequence:
        if _is_force(force) and is_later(force.time_s, imu.time_s, now):
            attitude_track = turned_by(attitude_track, force)
            imu, track, inertial = _take_imu(
                gains, imu, attitude_track, track, inertial, force, now
            )
        else:
            imu = LastImu(force.sequence, imu.time_s, imu.since_s, imu.interval_s)
            rejected += 1
    since_s = track.time_s
    if inertial and not (gains.use_imu and now - since_s <= IMU_SILENT_S):
        track = track_moved(track, max(now, since_s), 0.0, 0.0, 0.0)
        inertial = False

    if inertial != state.inertial:
        # Late fixes may still be true before this; before the change before this one none.
        if errors.time_s < switched_s:
            covariance = covariance_at(gains, state._replace(imu=imu), switched_s)
            errors = errors_when_switched(state, covariance)
        switched_s = since_s
    return MotionState(
        track=track,
        errors=errors,
        attitude_track=attitude_track,
        inertial=inertial,
        switched_s=switched_s,
        imu=imu,
        fix=state.fix,
        attitude=attitude,
        offset=state.offset,
        shift=state.shift,
        innovation=state.innovation,
        noise=state.noise,
        outliers=state.outliers,
        reckoning=state.reckoning,
        rejected=rejected,
        jump_s=state.jump_s,
        astray_s=state.astray_s,
    )


def _take_attitude(
    frame: SoaringFrame,
    latest: LastAttitude,
    attitude_track: AttitudeTrack,
    sample: AttitudeSample,
    now_s: float,
) -> tuple[LastAttitude, AttitudeTrack]:
    """The last attitudes, and the attitude, with a new sample taken in or refused."""
    if not (is_rotation(sample) and is_later(sample.time_s, latest.time_s, now_s)):
        return latest._replace(sequence=sample.sequence), attitude_track
    starts = not latest.time_s <= now_s + FUTURE_S  # the first, or the clock has gone back
    count, refused = latest.refused_in_a_row, latest.refused
    interval = sample.time_s - (refused.time_s if count > 0 else latest.time_s)
    if not starts and not is_turn(latest.used, sample, interval):
        if interval <= 0.0:  # again, over another link
            return latest._replace(sequence=sample.sequence), attitude_track
        count = count + 1 if count > 0 and is_turn(refused, sample, interval) else 1
        if count < OUTLIERS_ACCEPTED:
            return LastAttitude(
                sequence=sample.sequence,
                time_s=latest.time_s,
                used=latest.used,
                refused=sample,
                refused_in_a_row=count,
            ), attitude_track
        starts = True
    accepted = LastAttitude(
        sequence=sample.sequence,
        time_s=sample.time_s,
        used=sample,
        refused=NO_ATTITUDE,
        refused_in_a_row=0,
    )
    if starts:
        return accepted, turned_to(frame, NO_ATTITUDE_TRACK, sample)
    if not rates_follow(latest.used, sample):
        sample = sample._replace(
            roll_rate_frd_radps=NAN, pitch_rate_frd_radps=NAN, yaw_rate_frd_radps=NAN
        )
    return accepted, turned_to(frame, attitude_track, sample)


def _is_force(sample: ImuSample) -> bool:
    """Whether these may be accelerations of something that soars."""
    return (
        abs(sample.force_x_frd_mps2) <= FORCE_MAX_MPS2  # false for NaN
        and abs(sample.force_y_frd_mps2) <= FORCE_MAX_MPS2
        and abs(sample.force_z_frd_mps2) <= FORCE_MAX_MPS2
    )


def _take_imu(
    gains: MotionGains,
    latest: LastImu,
    attitude_track: AttitudeTrack,
    track: Track,
    inertial: bool,
    sample: ImuSample,
    now_s: float,
) -> tuple[LastImu, Track, bool]:
    """The last sample, the track at its time, and whether it moves by accelerations."""
    _, last_s, since_s, average = latest
    time_s = sample.time_s
    turn, interval = time_s - attitude_track.time_s, time_s - last_s
    counts = gains.use_imu and abs(turn) <= PREDICT_MAX_S and now_s - time_s <= IMU_SILENT_S
    if interval <= IMU_GAP_S:  # false for NaN, the first
        average += INTERVAL_FRACTION * (interval - average)
    if not (counts and interval <= IMU_GAP_S):
        since_s = time_s
    latest = LastImu(sample.sequence, time_s, since_s, average)
    if not counts or not (inertial or time_s - since_s >= IMU_STEADY_S):
        return latest, track, inertial
    ax, ay, az = _acceleration(attitude_track, turn, sample)
    if inertial and time_s > track.time_s:
        return latest, track_moved(track, time_s, ax, ay, az), True
    if time_s > track.time_s:  # it went straight on until now
        track = track_moved(track, time_s, 0.0, 0.0, 0.0)
    return latest, track._replace(ax_mps2=ax, ay_mps2=ay, az_mps2=az), True


def _acceleration(
    attitude_track: AttitudeTrack, turn_s: float, sample: ImuSample
) -> tuple[float, float, float]:
    """Acceleration [m/s²] in the soaring frame of a specific force."""
    fx, fy, fz = sample.force_x_frd_mps2, sample.force_y_frd_mps2, sample.force_z_frd_mps2
    roll = attitude_track.roll_rad + turn_s * attitude_track.roll_rate_radps
    pitch = attitude_track.pitch_rad + turn_s * attitude_track.pitch_rate_radps
    heading = attitude_track.heading_rad + turn_s * attitude_track.heading_rate_radps
    sr, cr, sp, cp = sin(roll), cos(roll), sin(pitch), cos(pitch)
    sh, ch = sin(heading), cos(heading)
    level, right = sr * fy + cr * fz, cr * fy - sr * fz  # after roll
    ahead = cp * fx + sp * level  # after pitch
    return (
        sh * right - ch * ahead,  # downstream is against upwind
        sh * ahead + ch * right,
        sp * fx - cp * level - GRAVITY_MPS2,
    )
