"""What the estimator of motion remembers, and what follows from it for any time.

The state is the inertial track plus its errors.  From which time on accelerations are known or not
is remembered (`MotionState.switched_s`), so that errors and uncertainty grow on each side of it by
the model that holds there.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar.estimation.attitude_track import NO_ATTITUDE_TRACK, AttitudeTrack
from tgl_soar.estimation.fix_filter import (
    Covariance,
    Errors,
    Moments,
    errors_at,
    errors_carried,
    spread,
)
from tgl_soar.estimation.inertial_track import Place, Track, new_track
from tgl_soar.types import NAN, NO_ATTITUDE, AttitudeSample

FUTURE_S: Final = 0.05  # a time stamp may be this far ahead of the tick: clock mapping is not exact
IMU_INTERVAL_S: Final = 0.005  # between two accelerations, until it is known
IMU_INTERVAL_MIN_S: Final = 0.001
BIAS_S: Final = 300.0  # in which a bias may become another one: it turns with the aircraft
ACCELERATION_S: Final = 0.1  # how long an acceleration that nobody measures lasts
# An estimator says once a second, at the slowest, how it stands, and its correction may come with
# the first fixes after that: for so long after a dead-reckoned fix what is corrected is the
# reckoning, and no frame is taken for moved.
RECKONED_KEPT_S: Final = 2.0
OUTLIERS_ACCEPTED: Final = 5  # of them in a row that agree with each other


class MotionGains(NamedTuple):
    """Parameters of the estimator; standard deviations on each axis."""

    fix_sd_m: float
    velocity_sd_mps: float  # of a fix that has one
    force_sd_mps2: float  # of one sample of the accelerometers, errors of the tilt included
    bias_sd_mps2: float  # of the same, over a flight
    unknown_sd_mps2: float  # acceleration where nobody measures it
    fix_delay_s: float  # of the source, beyond what its time stamps say
    fix_gate_m: float  # innovation below which no fix is an outlier
    reset_max_m: float  # so far a source may move its frame, and is followed; 0: not at all
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
    sum: float  # of the numbers of the last one looked at, which tells a repetition
    repeated: int  # so often have they come again


class LastAttitude(NamedTuple):
    """What came of attitudes."""

    sequence: int  # of the last sample looked at
    time_s: float  # of the last sample used; NaN: none yet
    used: AttitudeSample  # that sample
    refused: AttitudeSample  # the last one that was turned too far from it
    refused_in_a_row: int  # so many that agree with each other


class Reckoning(NamedTuple):
    """Fixes that their source says are dead reckoned; stretches that follow each other within
    `RECKONED_KEPT_S` count as one, without what is between them."""

    since_s: float  # when this stretch began, as if without gaps; NaN: there was none
    last_s: float  # of the last of them; NaN: there was none
    now: bool  # the last fix used is one of them


class Offset(NamedTuple):
    """Of the source of fixes: how far its origin is off, soaring frame."""

    x_m: float  # what the source says less what is estimated
    y_m: float
    z_m: float


class FrameShift(NamedTuple):
    """How far a source has moved its own frame in this flight, soaring frame."""

    x_m: float  # what the source says less what it would say, had it not
    y_m: float
    z_m: float


class Innovation(NamedTuple):
    """Of the last fix that was compared with the estimate, soaring frame."""

    x_m: float  # measured less predicted; NaN: none yet
    y_m: float
    z_m: float
    nis: float  # their squares over their variance: 3 on average


class FixNoise(NamedTuple):
    """How fixes scatter, as they are seen to do; soaring frame."""

    variance_m2: float  # on each axis; 0: no worse than they say
    x_m: float  # the last fix taken in less what was estimated with it
    y_m: float
    z_m: float
    step_x_m: float  # by how much more it had moved since the one before than was estimated
    step_y_m: float
    step_z_m: float
    step_m2: float  # variance of the estimate in that step, on each axis
    step_s: float  # how long it took
    turns: int  # of fixes that told of this noise; 0 once it counts no more


class Outliers(NamedTuple):
    """Fixes that were far from the prediction and agree with each other."""

    in_a_row: int  # so many
    time_s: float  # of the last of them
    gap: bool  # before the first of them nothing new had come for a while
    x_m: float  # its innovation
    y_m: float
    z_m: float
    first_s: float  # of the first
    first_x_m: float
    first_y_m: float
    first_z_m: float


class MotionState(NamedTuple):
    """What the estimator remembers; positions in the soaring frame."""

    track: Track
    errors: Errors  # at the time of the last fix used, or since
    attitude_track: AttitudeTrack
    inertial: bool  # the track moves by accelerations
    switched_s: float  # since when it does, or does not; NaN: it never did
    imu: LastImu
    fix: LastFix
    attitude: LastAttitude
    offset: Offset
    shift: FrameShift
    innovation: Innovation
    noise: FixNoise
    outliers: Outliers
    reckoning: Reckoning
    rejected: int  # samples refused so far
    jump_s: float  # the tick in which the position last jumped; NaN: never
    astray_s: float  # the tick in which outliers last began the estimate anew; NaN: never


NO_OFFSET: Final = Offset(0.0, 0.0, 0.0)
NO_SHIFT: Final = FrameShift(0.0, 0.0, 0.0)
NO_NOISE: Final = FixNoise(
    variance_m2=0.0,
    x_m=0.0,
    y_m=0.0,
    z_m=0.0,
    step_x_m=0.0,
    step_y_m=0.0,
    step_z_m=0.0,
    step_m2=0.0,
    step_s=0.0,
    turns=0,
)
NO_RECKONING: Final = Reckoning(NAN, NAN, False)
NO_OUTLIERS: Final = Outliers(
    in_a_row=0,
    time_s=NAN,
    gap=False,
    x_m=NAN,
    y_m=NAN,
    z_m=NAN,
    first_s=NAN,
    first_x_m=NAN,
    first_y_m=NAN,
    first_z_m=NAN,
)


def initial_motion() -> MotionState:
    """Nothing is known yet."""
    return MotionState(
        track=new_track(NAN),
        errors=Errors(
            time_s=NAN,
            x_m=NAN,
            y_m=NAN,
            z_m=NAN,
            velocity_x_mps=NAN,
            velocity_y_mps=NAN,
            climb_mps=NAN,
            bias_x_mps2=0.0,
            bias_y_mps2=0.0,
            bias_z_mps2=0.0,
            covariance=Covariance(pp=NAN, pv=NAN, pb=NAN, vv=NAN, vb=NAN, bb=NAN),
        ),
        attitude_track=NO_ATTITUDE_TRACK,
        inertial=False,
        switched_s=NAN,
        imu=LastImu(0, NAN, NAN, IMU_INTERVAL_S),
        fix=LastFix(sequence=0, time_s=NAN, source=0, sum=NAN, repeated=0),
        attitude=LastAttitude(
            sequence=0, time_s=NAN, used=NO_ATTITUDE, refused=NO_ATTITUDE, refused_in_a_row=0
        ),
        offset=NO_OFFSET,
        shift=NO_SHIFT,
        innovation=Innovation(NAN, NAN, NAN, NAN),
        noise=NO_NOISE,
        outliers=NO_OUTLIERS,
        reckoning=NO_RECKONING,
        rejected=0,
        jump_s=NAN,
        astray_s=NAN,
    )


def track_errors_at(state: MotionState, time_s: float) -> Place:
    """What the track is wrong by at a time."""
    errors = state.errors
    before, after = (0.0, 1.0) if state.inertial else (1.0, 0.0)
    if errors.time_s < state.switched_s:
        if time_s <= state.switched_s:
            return errors_at(errors, time_s, before)
        errors = errors_when_switched(state, errors.covariance)
    return errors_at(errors, time_s, after)


def errors_when_switched(state: MotionState, covariance: Moments) -> Errors:
    """The same, with a covariance, when the errors last began to grow in another way."""
    errors, time_s = state.errors, state.switched_s
    at = errors_at(errors, time_s, 0.0 if state.inertial else 1.0)
    return errors_carried(errors, time_s, at, covariance)


def covariance_at(gains: MotionGains, state: MotionState, time_s: float) -> Moments:
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


def is_later(time_s: float, last_s: float, now_s: float) -> bool:
    """Not of the future nor of the past, unless what is known is of the future; NaN: the first."""
    return time_s <= now_s + FUTURE_S and (not time_s <= last_s or last_s > now_s + FUTURE_S)
