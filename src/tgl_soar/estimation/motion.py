"""From fixes, attitude and accelerations to the state of the aircraft at the time of the tick.

Accelerations move an inertial track from sample to sample (`inertial_track`):

    a = R(roll, pitch, heading) f + g

f the specific force, turned by the attitude (`turning`) into the soaring frame.  A Kalman filter
(`fix_filter`) estimates from fix to fix, each at the time when it was *true*, what the track is
wrong by, and the accelerations' bias.  The state is track plus error, at any time; a late fix
costs no more than one in time, as long as the track remembers its time; a later one is refused.
Without accelerations the track goes straight on and the filter is told how large the acceleration
may be: a constant-velocity model.  From which time on accelerations are known or not is
remembered (`MotionState.switched_s`), so that errors and doubt grow on each side of it by the
model that holds there.  They are counted on from IMU_STEADY_S after they have become frequent
enough until they fall silent.

A fix whose innovation r is beyond what both the filter's own covariance S and EST_GATE allow,

    |r| > gate    and    |r|² > GATE_SIGMAS² S

is an outlier: swapped markers, a glitch of the autopilot's filter.  It is refused and counted,
until `OUTLIERS_BELIEVED` of them in a row agree with each other: then the aircraft is there,
and the estimate jumps, as it does to the first fix after so long a silence that nobody knows the
place.  For JUMP_S the position is then not to be flown with (`MotionQuality.jumped`), so that the
law starts anew from where the aircraft is and never sees the step.  A velocity that
is as far off is left out, and its place taken.

Another `PositionFix.source` has another origin, by some centimetres.  What its first fix differs
by, as far as the filter does not doubt itself, is learnt as the source's offset, and bled off
slowly: the position slides over, its velocity does not know of it.  Nobody knows which of both is
right: what is left of the offset is part of the standard deviation that is told.  What differs by
more than OFFSET_MAX_M is an outlier like any other.

An attitude turned further than an aircraft can turn since the last used (`turning.is_turn`) is
refused likewise, until `OUTLIERS_BELIEVED` in a row agree.

A sample that is not finite, is no rotation, comes from the future, or is not later than the
one before is refused and counted.  Where the one before lies in the future itself the clock has
gone back: place and velocity are forgotten, and the sample starts afresh.
"""

from __future__ import annotations

from math import cos, exp, sin, sqrt
from typing import Final, NamedTuple

from tgl_soar.estimation.fix_filter import (
    Covariance,
    Errors,
    Moments,
    errors_at,
    position_taken,
    spread,
    velocity_taken,
)
from tgl_soar.estimation.inertial_track import (
    Place,
    Track,
    new_track,
    oldest_s,
    track_at,
    track_moved,
)
from tgl_soar.estimation.turning import (
    NO_ATTITUDE_TRACK,
    PREDICT_MAX_S,
    AttitudeTrack,
    is_rotation,
    is_turn,
    rates_follow,
    turned_by,
    turned_to,
)
from tgl_soar.geometry import SoaringFrame, soaring_from_ned, soaring_vector_from_ned
from tgl_soar.types import (
    NAN,
    NO_ATTITUDE,
    AttitudeSample,
    ImuSample,
    Inputs,
    MotionQuality,
    PositionFix,
    VehicleState,
    isfinite,
)

GRAVITY_MPS2: Final = 9.80665  # what it is elsewhere is a bias of the vertical acceleration
FUTURE_S: Final = 0.05  # a time stamp may be this far ahead of the tick: clock mapping is not exact
FORCE_MAX_MPS2: Final = 200.0  # of 20 g nothing soars; hostile or broken
IMU_GAP_S: Final = 0.055  # accelerations are counted on where they come more often than this
IMU_STEADY_S: Final = 0.1  # and have done so for this long
IMU_SILENT_S: Final = 0.08  # until the last is older than this
IMU_INTERVAL_S: Final = 0.005  # between two accelerations, until it is known
IMU_INTERVAL_MIN_S: Final = 0.001
INTERVAL_FRACTION: Final = 0.02  # of the newest interval in the known one
BIAS_S: Final = 300.0  # in which a bias may become another one: it turns with the aircraft
ACCELERATION_S: Final = 0.1  # how long an acceleration that nobody tells lasts
GATE_SIGMAS: Final = 5.0
GATE_MPS: Final = 1.0  # floor of the gate of velocities
AGREE_MPS: Final = 5.0  # how wrong the estimated velocity may be while outliers are compared
OUTLIERS_BELIEVED: Final = 5
JUMP_S: Final = 0.4  # longer than the supervisor keeps a line over a gap
LOST_M: Final = 0.5  # with a place as uncertain as this, and 3 σ of a fix, a fix starts afresh
START_MPS: Final = 2.0  # how fast the aircraft may be where a first fix has no velocity
VELOCITY_MAX_MPS: Final = 25.0  # over the ground; a faster one is none
SIGMA_MAX_M: Final = 1e3  # who doubts himself so much says nothing
OFFSET_M: Final = 0.3  # how far the origins of two sources may be apart: standard deviation
OFFSET_MAX_M: Final = 3.0 * OFFSET_M  # farther off a new source is not believed at once
OFFSET_SMALL_M: Final = 1e-4  # an offset that nobody sees go
BLEED_S: Final = 5.0  # in which an offset is bled off, no faster than
BLEED_MPS: Final = 0.05


class MotionGains(NamedTuple):
    """Parameters of the estimator; standard deviations on each axis."""

    fix_sd_m: float
    velocity_sd_mps: float  # of a fix that has one
    force_sd_mps2: float  # of one sample of the accelerometers, errors of the tilt included
    bias_sd_mps2: float  # of the same, over a flight
    unknown_sd_mps2: float  # acceleration where nobody measures it
    fix_delay_s: float  # of the source, beyond what its time stamps tell
    fix_gate_m: float  # innovation below which no fix is an outlier
    use_imu: bool


class LastImu(NamedTuple):
    """What came of accelerations."""

    sequence: int  # of the last sample looked at
    time_s: float  # of the last sample used; NaN: none yet
    since_s: float  # since when they come often enough; NaN: none yet
    interval_s: float  # between two, on average


class LastFix(NamedTuple):
    """What came of fixes."""

    sequence: int  # of the last fix looked at
    time_s: float  # of the last fix used; NaN: none yet
    source: int  # of that fix


class LastAttitude(NamedTuple):
    """What came of attitudes."""

    sequence: int  # of the last sample looked at
    time_s: float  # of the last sample used; NaN: none yet
    used: AttitudeSample  # that sample
    refused: AttitudeSample  # the last one that was turned too far from it
    refused_in_a_row: int  # so many that agree with each other


class Offset(NamedTuple):
    """Of the source of fixes: how far its origin is off, soaring frame."""

    x_m: float  # what the source says less what is estimated
    y_m: float
    z_m: float


class Innovation(NamedTuple):
    """Of the last fix that was compared with the estimate, soaring frame."""

    x_m: float  # measured less predicted; NaN: none yet
    y_m: float
    z_m: float
    nis: float  # their squares over their variance: 3 on average


class Outliers(NamedTuple):
    """Fixes that were far from the prediction and agree with each other."""

    in_a_row: int  # so many
    time_s: float  # of the last of them
    x_m: float  # its innovation
    y_m: float
    z_m: float


class MotionState(NamedTuple):
    """What the estimator remembers; positions in the soaring frame."""

    track: Track
    errors: Errors  # at the time of the last fix used, or since
    turning: AttitudeTrack
    inertial: bool  # the track moves by accelerations
    switched_s: float  # since when it does, or does not; NaN: it never did
    imu: LastImu
    fix: LastFix
    attitude: LastAttitude
    offset: Offset
    innovation: Innovation
    outliers: Outliers
    rejected: int  # samples refused so far
    jump_s: float  # the tick in which the position last jumped; NaN: never


_NO_OFFSET: Final = Offset(0.0, 0.0, 0.0)
_NO_OUTLIERS: Final = Outliers(in_a_row=0, time_s=NAN, x_m=NAN, y_m=NAN, z_m=NAN)


def initial_motion() -> MotionState:
    """Nothing is known yet."""
    return MotionState(
        track=new_track(NAN),
        errors=Errors(
            *(NAN, NAN, NAN, NAN, NAN, NAN, NAN, 0.0, 0.0, 0.0),
            Covariance(pp=NAN, pv=NAN, pb=NAN, vv=NAN, vb=NAN, bb=NAN),
        ),
        turning=NO_ATTITUDE_TRACK,
        inertial=False,
        switched_s=NAN,
        imu=LastImu(0, NAN, NAN, IMU_INTERVAL_S),
        fix=LastFix(0, NAN, 0),
        attitude=LastAttitude(
            sequence=0, time_s=NAN, used=NO_ATTITUDE, refused=NO_ATTITUDE, refused_in_a_row=0
        ),
        offset=_NO_OFFSET,
        innovation=Innovation(NAN, NAN, NAN, NAN),
        outliers=_NO_OUTLIERS,
        rejected=0,
        jump_s=NAN,
    )


def motion_step(
    gains: MotionGains, frame: SoaringFrame, state: MotionState, inputs: Inputs
) -> tuple[MotionState, VehicleState]:
    """Take in what is new and give the state of the aircraft at inputs.time_s."""
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
        state = _take_fix(gains, frame, state, inputs.position, now)
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
    """What a tick at time_s did with what was new, and how sure the estimate is then."""
    pp, _, _, vv, _, bb = _covariance_at(gains, after, time_s)
    sequence, used_s, source = after.fix
    looked_at = sequence != before.fix.sequence
    used = looked_at and used_s == used_s and used_s != before.fix.time_s  # not NaN
    refused = looked_at and not used
    errors = after.errors
    x, y, z, nis = after.innovation
    ox, oy, oz = after.offset
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
        source=source,
        fix_used=used,
        fix_refused=refused,
        jumped=time_s - after.jump_s < JUMP_S,  # false for NaN
        inertial=after.inertial,
    )


def _root(variance: float) -> float:
    """A standard deviation; NaN, nothing is known, stays NaN."""
    return 0.0 if variance < 0.0 else sqrt(variance)


def _forgotten(state: MotionState, now_s: float) -> MotionState:
    """Nothing is known of place and velocity; the bias is still believed."""
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
        outliers=_NO_OUTLIERS,
        jump_s=NAN,
    )


def _at(state: MotionState, time_s: float) -> VehicleState:
    """The state carried on to time_s."""
    x, y, z, vx, vy, climb = track_at(state.track, time_s)
    dx, dy, dz, dvx, dvy, d_climb = _errors_at(state, time_s)
    seen_s, roll, pitch, heading, roll_rate, pitch_rate, heading_rate, _, _, _, _, _ = state.turning
    turn = max(0.0, min(PREDICT_MAX_S, time_s - seen_s))
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


def _errors_at(state: MotionState, time_s: float) -> Place:
    """What the track is wrong by at a time."""
    errors = state.errors
    before, after = (0.0, 1.0) if state.inertial else (1.0, 0.0)
    if errors.time_s < state.switched_s:
        if time_s <= state.switched_s:
            return errors_at(errors, time_s, before)
        errors = _errors_when_switched(state, errors.covariance)
    return errors_at(errors, time_s, after)


def _errors_when_switched(state: MotionState, covariance: Moments) -> Errors:
    """The same, with a covariance, when the errors last began to grow in another way."""
    errors, time_s = state.errors, state.switched_s
    x, y, z, vx, vy, climb = errors_at(errors, time_s, 0.0 if state.inertial else 1.0)
    bx, by, bz = errors.bias_x_mps2, errors.bias_y_mps2, errors.bias_z_mps2
    return Errors(
        time_s=time_s,
        x_m=x,
        y_m=y,
        z_m=z,
        velocity_x_mps=vx,
        velocity_y_mps=vy,
        climb_mps=climb,
        bias_x_mps2=bx,
        bias_y_mps2=by,
        bias_z_mps2=bz,
        covariance=Covariance(*covariance),
    )


def _covariance_at(gains: MotionGains, state: MotionState, time_s: float) -> Moments:
    """The covariance of these errors."""
    start_s, switched_s = state.errors.time_s, state.switched_s
    if not start_s < switched_s:
        return _spread(gains, state, state.errors.covariance, time_s - start_s, state.inertial)
    end_s = min(time_s, switched_s)
    covariance = _spread(gains, state, state.errors.covariance, end_s - start_s, not state.inertial)
    if time_s <= switched_s:
        return covariance
    return _spread(gains, state, covariance, time_s - end_s, state.inertial)


def _spread(
    gains: MotionGains,
    state: MotionState,
    covariance: Moments,
    interval_s: float,
    inertial: bool,
) -> Moments:
    """The covariance after a time with accelerations, or without."""
    if inertial:
        interval = max(IMU_INTERVAL_MIN_S, state.imu.interval_s)
        density = gains.force_sd_mps2 * gains.force_sd_mps2 * interval
        bias_density = gains.bias_sd_mps2 * gains.bias_sd_mps2 / BIAS_S
        return spread(covariance, interval_s, 1.0, density, bias_density)
    density = 2.0 * gains.unknown_sd_mps2 * gains.unknown_sd_mps2 * ACCELERATION_S
    return spread(covariance, interval_s, 0.0, density, 0.0)


def _is_later(time_s: float, last_s: float, now_s: float) -> bool:
    """Not of the future nor of the past, unless what is known is of the future; NaN: the first."""
    return time_s <= now_s + FUTURE_S and (not time_s <= last_s or last_s > now_s + FUTURE_S)


def _carried(
    gains: MotionGains, frame: SoaringFrame, state: MotionState, inputs: Inputs
) -> MotionState:
    """Attitude and track carried on with what is new of attitudes, gyros and accelerations."""
    now = inputs.time_s
    attitude, imu, turning = state.attitude, state.imu, state.turning
    track, errors, inertial = state.track, state.errors, state.inertial
    switched_s, rejected = state.switched_s, state.rejected

    sample = inputs.attitude
    if sample.sequence != attitude.sequence:
        attitude, turning = _take_attitude(frame, attitude, turning, sample, now)
        if attitude.used.sequence != sample.sequence:
            rejected += 1

    felt = inputs.imu
    if felt.sequence != imu.sequence:
        if _is_force(felt) and _is_later(felt.time_s, imu.time_s, now):
            turning = turned_by(turning, felt)
            imu, track, inertial = _take_imu(gains, imu, turning, track, inertial, felt, now)
        else:
            imu = LastImu(felt.sequence, imu.time_s, imu.since_s, imu.interval_s)
            rejected += 1
    since_s = track.time_s
    if inertial and not (gains.use_imu and now - since_s <= IMU_SILENT_S):
        track = track_moved(track, max(now, since_s), 0.0, 0.0, 0.0)
        inertial = False

    if inertial != state.inertial:
        # Late fixes may still be true before this; before the change before this one none.
        if errors.time_s < switched_s:
            covariance = _covariance_at(gains, state._replace(imu=imu), switched_s)
            errors = _errors_when_switched(state, covariance)
        switched_s = since_s
    return MotionState(
        track=track,
        errors=errors,
        turning=turning,
        inertial=inertial,
        switched_s=switched_s,
        imu=imu,
        fix=state.fix,
        attitude=attitude,
        offset=state.offset,
        innovation=state.innovation,
        outliers=state.outliers,
        rejected=rejected,
        jump_s=state.jump_s,
    )


def _take_attitude(
    frame: SoaringFrame,
    heard: LastAttitude,
    turning: AttitudeTrack,
    sample: AttitudeSample,
    now_s: float,
) -> tuple[LastAttitude, AttitudeTrack]:
    """What was heard, and the attitude, with a new sample taken in or refused."""
    if not (is_rotation(sample) and _is_later(sample.time_s, heard.time_s, now_s)):
        return heard._replace(sequence=sample.sequence), turning
    starts = not heard.time_s <= now_s + FUTURE_S  # the first, or the clock has gone back
    count, refused = heard.refused_in_a_row, heard.refused
    interval = sample.time_s - (refused.time_s if count > 0 else heard.time_s)
    if not starts and not is_turn(heard.used, sample, interval):
        if interval <= 0.0:  # again, over another link
            return heard._replace(sequence=sample.sequence), turning
        count = count + 1 if count > 0 and is_turn(refused, sample, interval) else 1
        if count < OUTLIERS_BELIEVED:
            return LastAttitude(
                sequence=sample.sequence,
                time_s=heard.time_s,
                used=heard.used,
                refused=sample,
                refused_in_a_row=count,
            ), turning
        starts = True
    heard_now = LastAttitude(
        sequence=sample.sequence,
        time_s=sample.time_s,
        used=sample,
        refused=NO_ATTITUDE,
        refused_in_a_row=0,
    )
    if starts:
        return heard_now, turned_to(frame, NO_ATTITUDE_TRACK, sample)
    if not rates_follow(heard.used, sample):
        sample = sample._replace(
            roll_rate_frd_radps=NAN, pitch_rate_frd_radps=NAN, yaw_rate_frd_radps=NAN
        )
    return heard_now, turned_to(frame, turning, sample)


def _is_force(sample: ImuSample) -> bool:
    """Whether these may be accelerations of something that soars."""
    return (
        abs(sample.force_x_frd_mps2) <= FORCE_MAX_MPS2  # false for NaN
        and abs(sample.force_y_frd_mps2) <= FORCE_MAX_MPS2
        and abs(sample.force_z_frd_mps2) <= FORCE_MAX_MPS2
    )


def _take_imu(
    gains: MotionGains,
    heard: LastImu,
    turning: AttitudeTrack,
    track: Track,
    inertial: bool,
    sample: ImuSample,
    now_s: float,
) -> tuple[LastImu, Track, bool]:
    """What was heard, the track at the sample's time, and whether it moves by accelerations."""
    _, last_s, since_s, average = heard
    time_s = sample.time_s
    turn, interval = time_s - turning.time_s, time_s - last_s
    counts = gains.use_imu and abs(turn) <= PREDICT_MAX_S and now_s - time_s <= IMU_SILENT_S
    if interval <= IMU_GAP_S:  # false for NaN, the first
        average += INTERVAL_FRACTION * (interval - average)
    if not (counts and interval <= IMU_GAP_S):
        since_s = time_s
    heard = LastImu(sample.sequence, time_s, since_s, average)
    if not counts or not (inertial or time_s - since_s >= IMU_STEADY_S):
        return heard, track, inertial
    ax, ay, az = _acceleration(turning, turn, sample)
    if inertial and time_s > track.time_s:
        return heard, track_moved(track, time_s, ax, ay, az), True
    if time_s > track.time_s:  # it went straight on until now
        track = track_moved(track, time_s, 0.0, 0.0, 0.0)
    return heard, track._replace(ax_mps2=ax, ay_mps2=ay, az_mps2=az), True


def _acceleration(
    turning: AttitudeTrack, turn_s: float, sample: ImuSample
) -> tuple[float, float, float]:
    """Acceleration [m/s²] in the soaring frame of the specific force that was felt."""
    fx, fy, fz = sample.force_x_frd_mps2, sample.force_y_frd_mps2, sample.force_z_frd_mps2
    roll = turning.roll_rad + turn_s * turning.roll_rate_radps
    pitch = turning.pitch_rad + turn_s * turning.pitch_rate_radps
    heading = turning.heading_rad + turn_s * turning.heading_rate_radps
    sr, cr, sp, cp = sin(roll), cos(roll), sin(pitch), cos(pitch)
    sh, ch = sin(heading), cos(heading)
    level, right = sr * fy + cr * fz, cr * fy - sr * fz  # after roll
    ahead = cp * fx + sp * level  # after pitch
    return (
        sh * right - ch * ahead,  # downstream is against upwind
        sh * ahead + ch * right,
        sp * fx - cp * level - GRAVITY_MPS2,
    )


class _Measured(NamedTuple):
    """A fix in the soaring frame."""

    time_s: float
    x_m: float
    y_m: float
    z_m: float
    velocity_x_mps: float
    velocity_y_mps: float
    climb_mps: float
    has_velocity: bool
    variance_m2: float
    velocity_variance_m2ps2: float


def _measured(gains: MotionGains, frame: SoaringFrame, fix: PositionFix) -> _Measured:
    x, y, z = soaring_from_ned(frame, fix.north_m, fix.east_m, fix.down_m)
    vx, vy, climb = soaring_vector_from_ned(
        frame, fix.velocity_north_mps, fix.velocity_east_mps, fix.velocity_down_mps
    )
    sd = fix.sigma_m if fix.sigma_m > gains.fix_sd_m else gains.fix_sd_m  # false for NaN
    return _Measured(
        time_s=fix.time_s - gains.fix_delay_s,
        x_m=x,
        y_m=y,
        z_m=z,
        velocity_x_mps=vx,
        velocity_y_mps=vy,
        climb_mps=climb,
        has_velocity=_length(vx, vy, climb) <= VELOCITY_MAX_MPS,  # false for NaN
        variance_m2=sd * sd,
        velocity_variance_m2ps2=gains.velocity_sd_mps * gains.velocity_sd_mps,
    )


def _is_usable(state: MotionState, fix: PositionFix, measured: _Measured, now_s: float) -> bool:
    """Whether a fix is a number, precise enough, and in order."""
    return (
        isfinite(measured.x_m)
        and isfinite(measured.y_m)
        and isfinite(measured.z_m)
        and not fix.sigma_m >= SIGMA_MAX_M  # NaN: not reported
        and measured.time_s >= oldest_s(state.track)
        and _is_later(measured.time_s, state.errors.time_s, now_s)
    )


def _take_fix(
    gains: MotionGains, frame: SoaringFrame, state: MotionState, fix: PositionFix, now_s: float
) -> MotionState:
    measured = _measured(gains, frame, fix)
    time_s, last_s = measured.time_s, state.errors.time_s
    _, used_s, source = state.fix
    if not _is_usable(state, fix, measured, now_s):
        heard = LastFix(fix.sequence, used_s, source)
        return state._replace(fix=heard, rejected=state.rejected + 1)

    heard = LastFix(fix.sequence, time_s, fix.source)
    place = track_at(state.track, time_s)
    if last_s != last_s:  # NaN: the first
        return _start(gains, state, heard, measured, place)
    covariance = _covariance_at(gains, state, time_s)
    pp, _, _, _, _, _ = covariance
    if not pp <= LOST_M * LOST_M + 9.0 * measured.variance_m2:
        return _start(gains, state._replace(jump_s=now_s), heard, measured, place)

    track_x, track_y, track_z, track_vx, track_vy, track_climb = place
    x, y, z, vx, vy, climb = _errors_at(state, time_s)
    scatter = pp + measured.variance_m2
    same_source = fix.source == source
    offset = state.offset if same_source else _NO_OFFSET
    ox, oy, oz = offset
    rx = measured.x_m - ox - track_x - x
    ry = measured.y_m - oy - track_y - y
    rz = measured.z_m - oz - track_z - z
    distance = _length(rx, ry, rz)
    reach = max(gains.fix_gate_m, GATE_SIGMAS * sqrt(scatter))
    if same_source and (ox != 0.0 or oy != 0.0 or oz != 0.0):
        bled = _bled(_length(ox, oy, oz), time_s - last_s)
        dx, dy, dz = bled * ox, bled * oy, bled * oz
        offset = Offset(ox - dx, oy - dy, oz - dz)
        x, y, z = x + dx, y + dy, z + dz
    elif not same_source and distance <= OFFSET_MAX_M:
        # Of the difference the new source's origin has the share that the filter's doubt has not.
        share = OFFSET_M * OFFSET_M / (OFFSET_M * OFFSET_M + scatter)
        offset = Offset(share * rx, share * ry, share * rz)
        rx, ry, rz = (1.0 - share) * rx, (1.0 - share) * ry, (1.0 - share) * rz
        distance *= 1.0 - share
    innovation = Innovation(rx, ry, rz, distance * distance / scatter)
    if distance > reach:
        doubtful = state._replace(innovation=innovation)
        return _take_outlier(gains, doubtful, heard, measured, place, now_s)

    _, _, _, _, _, _, _, bx, by, bz, _ = state.errors
    errors = Errors(
        time_s=time_s,
        x_m=x,
        y_m=y,
        z_m=z,
        velocity_x_mps=vx,
        velocity_y_mps=vy,
        climb_mps=climb,
        bias_x_mps2=bx,
        bias_y_mps2=by,
        bias_z_mps2=bz,
        covariance=Covariance(*covariance),
    )
    errors = position_taken(errors, rx, ry, rz, measured.variance_m2)
    if measured.has_velocity:
        variance = measured.velocity_variance_m2ps2
        rx = measured.velocity_x_mps - track_vx - errors.velocity_x_mps
        ry = measured.velocity_y_mps - track_vy - errors.velocity_y_mps
        rz = measured.climb_mps - track_climb - errors.climb_mps
        reach = max(GATE_MPS, GATE_SIGMAS * sqrt(errors.covariance.vv + variance))
        if _length(rx, ry, rz) <= reach:
            errors = velocity_taken(errors, rx, ry, rz, variance)
    return state._replace(
        errors=errors,
        fix=heard,
        offset=offset,
        innovation=innovation,
        outliers=_NO_OUTLIERS,
    )


def _length(x: float, y: float, z: float) -> float:
    return sqrt(x * x + y * y + z * z)


def _bled(offset_m: float, interval_s: float) -> float:
    """The share of an offset that goes in a time."""
    if offset_m < OFFSET_SMALL_M:
        return 1.0
    return min(1.0 - exp(-interval_s / BLEED_S), BLEED_MPS * interval_s / offset_m)


def _start(
    gains: MotionGains, state: MotionState, heard: LastFix, measured: _Measured, place: Place
) -> MotionState:
    """The aircraft is where the fix says; of the past only the bias is still believed.

    place: the track's at that time.
    """
    track_x, track_y, track_z, track_vx, track_vy, track_climb = place
    vx, vy, climb, variance = 0.0, 0.0, 0.0, START_MPS * START_MPS
    if measured.has_velocity:
        vx, vy, climb = measured.velocity_x_mps, measured.velocity_y_mps, measured.climb_mps
        variance = measured.velocity_variance_m2ps2
    bias_variance = state.errors.covariance.bb
    if not bias_variance > 0.0:
        bias_variance = gains.bias_sd_mps2 * gains.bias_sd_mps2
    return state._replace(
        errors=state.errors._replace(
            time_s=measured.time_s,
            x_m=measured.x_m - track_x,
            y_m=measured.y_m - track_y,
            z_m=measured.z_m - track_z,
            velocity_x_mps=vx - track_vx,
            velocity_y_mps=vy - track_vy,
            climb_mps=climb - track_climb,
            covariance=Covariance(
                pp=measured.variance_m2, pv=0.0, pb=0.0, vv=variance, vb=0.0, bb=bias_variance
            ),
        ),
        fix=heard,
        offset=_NO_OFFSET,
        outliers=_NO_OUTLIERS,
    )


def _take_outlier(
    gains: MotionGains,
    state: MotionState,
    heard: LastFix,
    measured: _Measured,
    place: Place,
    now_s: float,
) -> MotionState:
    """Refuse a fix far from the prediction, or go there where enough of them agree."""
    refused = LastFix(heard.sequence, state.fix.time_s, state.fix.source)
    time_s = measured.time_s
    count, last_s, x, y, z = state.outliers
    if count > 0 and time_s <= last_s:  # again, over another link
        return state._replace(fix=refused, rejected=state.rejected + 1)
    rx, ry, rz, _ = state.innovation
    near = gains.fix_gate_m + AGREE_MPS * (time_s - last_s)
    agrees = count > 0 and _length(rx - x, ry - y, rz - z) <= near
    outliers = Outliers(in_a_row=count + 1 if agrees else 1, time_s=time_s, x_m=rx, y_m=ry, z_m=rz)
    if outliers.in_a_row >= OUTLIERS_BELIEVED:
        return _start(gains, state._replace(jump_s=now_s), heard, measured, place)
    return state._replace(fix=refused, outliers=outliers, rejected=state.rejected + 1)
