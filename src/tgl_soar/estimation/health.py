"""Health: how old the inputs are, how they come, and whether they may be flown with.

Each stream is watched sample by sample, with the mean interval T and the mean deviation J from
it as first-order averages over AVERAGED samples:

    gap         an interval longer than GAP_FACTOR T, and than GAP_MIN_S
    frozen      the same bits again for longer than a limit. On the ground a source that says that
                it stands still (velocities or rates of exactly zero) may; in flight nothing does
    jump        further than JUMP_M + JUMP_MPS dt, or turned further than an aircraft turns
                (`attitude_track.is_turn`)
    not finite  a number that is none
    backwards   a stamp earlier than the one before: reordered, or the source's clock was reset
    wrong       position: its changes are not its velocities, averaged over FRAME_S (the frames
                differ); attitude: a quaternion whose norm is not one

A fault is reported for FAULT_S after its last occurrence.  What was frozen is as old as its last
change; in flight a position is from the first repetition on, as the estimator takes none in.  An
attitude that jumps, and jumps again before that fault is over, for longer than the limit of a
frozen one, is as old as the first of these jumps: one of two sources is wrong, and nobody knows
which.

Attitude sources disagree where the specific force f of the accelerometers and the attitude do
not, averaged over TILT_S: with no lasting acceleration f = −g, so that

    | mean(f / g + down) | <= TILT_MAX        down: NED's third axis, seen from the body

A turn is such an acceleration, tan of its bank: 0.4 from 21.8 degrees on, which is reported with
25 degrees after two averaging times, with 30 after 1.2 of them.  The module's own turns
stay below that (18 degrees beating, 20 on the way home) unless SIDE_BANK or BANK_MAX ask for more.
One sample counts as no more than TILT_OFF_MAX, which a throw by hand exceeds for a third of a
second, and for no longer than LONGEST_S: no single one, and no throw, says that they disagree.

Surfaces answer where what the autopilot puts out lies between the lowest and the highest of
our late commands, give or take a limit: the band shrinks towards the command that stands at
SHRINK_PER_S, which leaves room for delays, for rates, and for a slow stream.  For longer than
DEAD_S outside of it, they do not.  Where nothing is read back nobody knows, which is no fault.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar.estimation.attitude_track import is_turn
from tgl_soar.estimation.motion_state import FUTURE_S, MotionState
from tgl_soar.geometry import is_rotation
from tgl_soar.types import (
    INFINITE,
    NAN,
    AttitudeSample,
    Health,
    Inputs,
    PositionFix,
    SurfaceCommand,
    isfinite,
)

HEARTBEAT_FUTURE_S: Final = 1.0  # between two of them
AVERAGED: Final = 32.0
GAP_FACTOR: Final = 3.5
GAP_MIN_S: Final = 0.05
JUMP_M: Final = 1.0
JUMP_MPS: Final = 30.0
FRAME_S: Final = 2.0
FRAME_MPS: Final = 2.0
FAULT_S: Final = 1.0
TILT_S: Final = 2.0
TILT_MAX: Final = 0.4  # of g
TILT_STEP_S: Final = 0.02  # accelerations are looked at no more often
TILT_OFF_MAX: Final = 1.5  # of g; an attitude upside down is 2 off
# What one sample counts for at most in a mean: no single one reaches its limit.
FRAME_OFF_MAX_MPS: Final = 25.0
LONGEST_S: Final = 0.1
STALE_S: Final = 1.0  # accelerations and what is read back count for so long
AIRSPEED_STALE_S: Final = 3.0
DEAD_S: Final = 0.5
# Sooner than DEAD_S: of two ailerons that are the brake, one that jams is seen in both.
BRAKE_DEAD_S: Final = 0.3
SHRINK_PER_S: Final = 1.0
AIRSPEED_MAX_MPS: Final = 80.0
GRAVITY_MPS2: Final = 9.81

# Faults, as bits; a stream's own are those of the position, shifted for the attitude.
GAP: Final = 1 << 0
FROZEN: Final = 1 << 1
JUMP: Final = 1 << 2
NOT_FINITE: Final = 1 << 3
BACKWARDS: Final = 1 << 4
WRONG: Final = 1 << 5
ATTITUDE_SHIFT: Final = 6
DISAGREES: Final = 1 << 12
AIRSPEED: Final = 1 << 13
SURFACES: Final = 1 << 14
FAILSAFE: Final = 1 << 15
DISARMED: Final = 1 << 16
BRAKE: Final = 1 << 17
RECKONED: Final = 1 << 18
RANGE: Final = 1 << 19
FAULT_TEXTS: Final = (
    "position has gaps",
    "position frozen",
    "position jumps",
    "position not finite",
    "position stamps go back",
    "position and velocity disagree: frame?",
    "attitude has gaps",
    "attitude frozen",
    "attitude jumps",
    "attitude not finite",
    "attitude stamps go back",
    "quaternion norm is not one",
    "attitude and accelerometers disagree",
    "airspeed stale or senseless",
    "surfaces do not follow commands",
    "autopilot in failsafe",
    "autopilot disarmed",
    "brake does not follow commands",
    "position only dead reckoned",
    "rangefinder not used: frozen, or far from what the position says",
)
# Of position, attitude, accelerations, airspeed and rangefinder.
STREAM_FAULTS: Final = (SURFACES - 1) | RECKONED | RANGE
# A position with one of these is not engaged with.
INSANE: Final = FROZEN | JUMP | NOT_FINITE | BACKWARDS | WRONG | RECKONED


class HealthLimits(NamedTuple):
    """Ages beyond which an input is no longer flown with, and what a source may do."""

    position_age_max_s: float  # beyond: the line cannot be flown
    attitude_age_max_s: float
    heartbeat_age_max_s: float
    frozen_s: float  # the same bits for so long are no measurement
    surface_error_max: float  # of full travel


class StreamState(NamedTuple):
    """What is remembered of one stream."""

    sequence: int  # of the last sample looked at
    source: int  # of that sample
    time_s: float  # its stamp; NaN: none yet
    interval_s: float  # T; NaN: not known yet
    jitter_s: float  # J
    a: float  # north, or the quaternion's w, for comparison with the next sample
    b: float  # east, or x
    c: float  # down, or y
    d: float  # the velocity down, or z
    changed_s: float  # stamp of the last sample that was not the one before again
    gaps: int  # so far
    faults: int  # seen in the last FAULT_S
    fault_s: float  # the last of them, loop's clock
    jumps_s: float  # the first of the jumps that follow each other within FAULT_S, loop's clock
    jump_s: float  # the last of them


class BandState(NamedTuple):
    """Between which deflections a surface may be."""

    low: float  # of travel
    high: float  # of travel


class FrameState(NamedTuple):
    """Mean of what the position's changes are off its velocity."""

    north_mps: float  # mean of what the position's changes are off its velocity, north
    east_mps: float  # the same, east
    down_mps: float  # the same, down


class TiltState(NamedTuple):
    """Mean of f / g + down, FRD."""

    time_s: float  # of the last acceleration looked at; NaN: none
    x: float  # mean of f / g + down, forward
    y: float  # the same, right
    z: float  # the same, down


class SurfacesState(NamedTuple):
    """What is remembered of commands and of what was put out."""

    sequence: int  # of the last sample looked at; 0: not flying
    dead_s: float  # since when a surface is out of its band; inf: all are within
    elevator: BandState
    aileron: BandState
    rudder: BandState
    brake: BandState
    brake_dead_s: float  # as dead_s, of the brake


class HealthState(NamedTuple):
    """What health remembers."""

    position: StreamState
    attitude: StreamState
    frame: FrameState
    tilt: TiltState
    surfaces: SurfacesState


_ANYWHERE: Final = BandState(-1.0, 1.0)
_NO_SURFACES: Final = SurfacesState(
    sequence=0,
    dead_s=INFINITE,
    elevator=_ANYWHERE,
    aileron=_ANYWHERE,
    rudder=_ANYWHERE,
    brake=_ANYWHERE,
    brake_dead_s=INFINITE,
)


def initial_health() -> HealthState:
    """Nothing has come yet."""
    stream = StreamState(
        sequence=0,
        source=0,
        time_s=NAN,
        interval_s=NAN,
        jitter_s=0.0,
        a=NAN,
        b=NAN,
        c=NAN,
        d=NAN,
        changed_s=NAN,
        gaps=0,
        faults=0,
        fault_s=-INFINITE,
        jumps_s=NAN,
        jump_s=NAN,
    )
    return HealthState(
        position=stream,
        attitude=stream,
        frame=FrameState(0.0, 0.0, 0.0),
        tilt=TiltState(NAN, 0.0, 0.0, 0.0),
        surfaces=_NO_SURFACES,
    )


def health_step(
    limits: HealthLimits,
    state: HealthState,
    motion: MotionState,
    inputs: Inputs,
    flying: bool,
    commanding: bool,
    command: SurfaceCommand,
    dt_s: float,
) -> tuple[HealthState, Health]:
    """Look at what is new, and judge all of it at inputs.time_s.

    flying: the module is in control; commanding: it moves the surfaces itself; command: the last
    that it gave them; dt_s: since then.

    What never came is infinitely old.  So is what lies in the future: the clock has gone back,
    and nobody knows how old it is.  A heartbeat is stamped when it arrives, which may be well
    after the tick's own time.
    """
    now = inputs.time_s
    position, attitude, frame, tilt, surfaces = state
    if inputs.attitude.sequence != attitude.sequence:
        attitude = _look_at_attitude(attitude, inputs.attitude, now, flying)
    if inputs.position.sequence != position.sequence:
        stands = not flying and _stands_still(inputs.attitude)
        position, frame = _look_at_position(
            position, frame, inputs.position, now, not flying, stands
        )
    if inputs.imu.sequence > 0:
        tilt = _look_at_tilt(tilt, inputs)
    if commanding and inputs.surfaces.sequence > 0:
        surfaces = _look_at_surfaces(limits, surfaces, inputs, command, dt_s)
    elif surfaces.sequence != 0:
        surfaces = _NO_SURFACES

    position_age = _age(now, motion.fix.time_s, FUTURE_S)
    attitude_age = _age(now, motion.attitude.time_s, FUTURE_S)
    heartbeat_age = _age(now, inputs.autopilot.time_s, HEARTBEAT_FUTURE_S)
    faults = 0
    if position.faults and now - position.fault_s < FAULT_S:
        faults = position.faults
    if attitude.faults and now - attitude.fault_s < FAULT_S:
        faults |= attitude.faults << ATTITUDE_SHIFT
    if position.time_s - position.changed_s > limits.frozen_s:
        faults |= FROZEN
        position_age = max(position_age, now - position.changed_s)
    if attitude.time_s - attitude.changed_s > limits.frozen_s:
        faults |= FROZEN << ATTITUDE_SHIFT
        attitude_age = max(attitude_age, now - attitude.changed_s)
    lasted = attitude.jump_s - attitude.jumps_s
    if now - attitude.jump_s < FAULT_S and lasted > limits.frozen_s:  # false for NaN: none
        attitude_age = max(attitude_age, now - attitude.jumps_s)
    answer = -1  # not known
    # Between two that were seen: one odd sample before a silence is none.
    reported_s = inputs.surfaces.time_s
    if surfaces.sequence > 0 and now - reported_s <= STALE_S:
        answer = 0 if reported_s - surfaces.dead_s > DEAD_S else 1
    faults |= _reported_faults(inputs, tilt, answer)
    if reported_s - surfaces.brake_dead_s > BRAKE_DEAD_S:
        faults |= BRAKE
    if motion.reckoning.now:
        faults |= RECKONED
    return HealthState(
        position=position, attitude=attitude, frame=frame, tilt=tilt, surfaces=surfaces
    ), Health(
        position_age_s=position_age,
        attitude_age_s=attitude_age,
        heartbeat_age_s=heartbeat_age,
        position_ok=position_age <= limits.position_age_max_s,
        attitude_ok=attitude_age <= limits.attitude_age_max_s,
        autopilot_ok=heartbeat_age <= limits.heartbeat_age_max_s,
        rejected=motion.rejected,
        position_interval_s=position.interval_s,
        position_jitter_s=position.jitter_s,
        attitude_interval_s=attitude.interval_s,
        attitude_jitter_s=attitude.jitter_s,
        gaps=position.gaps + attitude.gaps,
        surfaces_answer=answer,
        faults=faults,
    )


def _reported_faults(inputs: Inputs, tilt: TiltState, answer: int) -> int:
    """What is wrong with accelerations, airspeed, surfaces and the autopilot, as bits."""
    now, faults = inputs.time_s, 0
    if (
        inputs.imu.sequence > 0
        and now - inputs.imu.time_s <= STALE_S
        and tilt.x * tilt.x + tilt.y * tilt.y + tilt.z * tilt.z > TILT_MAX * TILT_MAX
    ):
        faults |= DISAGREES
    if inputs.airspeed.sequence > 0 and not (
        now - inputs.airspeed.time_s <= AIRSPEED_STALE_S
        and 0.0 <= inputs.airspeed.airspeed_mps <= AIRSPEED_MAX_MPS
    ):
        faults |= AIRSPEED
    if answer == 0:
        faults |= SURFACES
    if inputs.autopilot.failsafe:
        faults |= FAILSAFE
    if not inputs.autopilot.armed:
        faults |= DISARMED
    return faults


def _age(now_s: float, then_s: float, future_s: float) -> float:
    # For samples the comparison is the estimator's own, so that what it takes is never refused
    # here; it is false for NaN: it never came.
    return now_s - then_s if then_s <= now_s + future_s else INFINITE


def _look_at_position(
    before: StreamState,
    frame: FrameState,
    fix: PositionFix,
    now_s: float,
    may_rest: bool,
    rests: bool,
) -> tuple[StreamState, FrameState]:
    """may_rest: the fix may say so by its velocity; rests: where it has none, the attitude does."""
    n, e, d = fix.north_m, fix.east_m, fix.down_m
    vn, ve, vd = fix.velocity_north_mps, fix.velocity_east_mps, fix.velocity_down_mps
    dt = fix.time_s - before.time_s
    moved_n, moved_e, moved_d = n - before.a, e - before.b, d - before.c
    same_source = fix.source == before.source
    found = 0
    known = isfinite(n) and isfinite(e) and isfinite(d)
    if not known:
        found |= NOT_FINITE
    elif same_source and max(abs(moved_n), abs(moved_e), abs(moved_d)) > JUMP_M + JUMP_MPS * abs(
        dt
    ):
        found |= JUMP
    has_velocity = isfinite(vn) and isfinite(ve) and isfinite(vd)
    if known and has_velocity and same_source and 0.0 < dt < FAULT_S and not found:
        gain, most = min(dt, LONGEST_S) / FRAME_S, FRAME_OFF_MAX_MPS
        off_n = frame.north_mps + gain * (_within(moved_n / dt - vn, most) - frame.north_mps)
        off_e = frame.east_mps + gain * (_within(moved_e / dt - ve, most) - frame.east_mps)
        off_d = frame.down_mps + gain * (_within(moved_d / dt - vd, most) - frame.down_mps)
        if max(abs(off_n), abs(off_e), abs(off_d)) > FRAME_MPS:
            found |= WRONG
        frame = FrameState(off_n, off_e, off_d)
    again = moved_n == 0.0 and moved_e == 0.0 and moved_d == 0.0
    if has_velocity:
        rests = may_rest and vn == 0.0 and ve == 0.0 and vd == 0.0
        again = again and vd == before.d
    else:
        vd = 0.0
    again = again and not rests
    return _sampled(
        before,
        fix.sequence,
        fix.source,
        fix.time_s,
        now_s,
        found=found,
        again=again,
        known=known,
        values=(n, e, d, vd),
    ), frame


def _stands_still(sample: AttitudeSample) -> bool:
    return (
        sample.roll_rate_frd_radps == 0.0
        and sample.pitch_rate_frd_radps == 0.0
        and sample.yaw_rate_frd_radps == 0.0
    )


def _look_at_attitude(
    before: StreamState, sample: AttitudeSample, now_s: float, flying: bool
) -> StreamState:
    w, x, y, z = sample.qw, sample.qx, sample.qy, sample.qz
    found = 0
    square = w * w + x * x + y * y + z * z
    known = square < INFINITE  # false for NaN
    if not known:
        found |= NOT_FINITE
    elif not is_rotation(w, x, y, z):
        found |= WRONG
    elif not is_turn(_as_sample(before), sample, sample.time_s - before.time_s):
        found |= JUMP
    again = (
        w == before.a
        and x == before.b
        and y == before.c
        and z == before.d
        and (flying or not _stands_still(sample))
    )
    return _sampled(
        before,
        sample.sequence,
        0,
        sample.time_s,
        now_s,
        found=found,
        again=again,
        known=known,
        values=(w, x, y, z),
    )


def _as_sample(before: StreamState) -> AttitudeSample:
    """The attitude that is remembered of a stream."""
    return AttitudeSample(
        sequence=before.sequence,
        time_s=before.time_s,
        qw=before.a,
        qx=before.b,
        qy=before.c,
        qz=before.d,
        roll_rate_frd_radps=NAN,
        pitch_rate_frd_radps=NAN,
        yaw_rate_frd_radps=NAN,
    )


def _sampled(
    before: StreamState,
    sequence: int,
    source: int,
    time_s: float,
    now_s: float,
    found: int,
    again: bool,
    known: bool,
    values: tuple[float, float, float, float],
) -> StreamState:
    """The stream after one more sample of these values; found: what is wrong with them."""
    a, b, c, d = values
    interval, jitter, gaps = before.interval_s, before.jitter_s, before.gaps
    changed_s = before.changed_s
    dt = time_s - before.time_s
    if not isfinite(time_s):
        found |= NOT_FINITE
        time_s = before.time_s
    elif dt < 0.0:
        found |= BACKWARDS
        changed_s = time_s
    elif dt > 0.0:
        if interval != interval:
            interval = dt
        elif dt > GAP_MIN_S and dt > GAP_FACTOR * interval:
            found |= GAP
            gaps += 1
        else:
            off = dt - interval
            interval += off / AVERAGED
            jitter += (abs(off) - jitter) / AVERAGED
    if not again:
        changed_s = time_s
    if not known:  # the next one is compared with the last that was a number
        a, b, c, d = before.a, before.b, before.c, before.d
    faults, fault_s, jumps_s, jump_s = before.faults, before.fault_s, before.jumps_s, before.jump_s
    if found:
        faults = found | (faults if now_s - fault_s < FAULT_S else 0)
        fault_s = now_s
    if found & JUMP:
        if not 0.0 <= now_s - jump_s < FAULT_S:  # the first, or the clock has gone back
            jumps_s = now_s
        jump_s = now_s
    return StreamState(
        sequence=sequence,
        source=source,
        time_s=time_s,
        interval_s=interval,
        jitter_s=jitter,
        a=a,
        b=b,
        c=c,
        d=d,
        changed_s=changed_s,
        gaps=gaps,
        faults=faults,
        fault_s=fault_s,
        jumps_s=jumps_s,
        jump_s=jump_s,
    )


def _look_at_tilt(tilt: TiltState, inputs: Inputs) -> TiltState:
    """Accelerations against the newest attitude."""
    imu, q = inputs.imu, inputs.attitude
    dt = imu.time_s - tilt.time_s
    if -STALE_S <= dt < TILT_STEP_S:  # farther back it is the clock that went
        return tilt
    x = imu.force_x_frd_mps2 / GRAVITY_MPS2 + 2.0 * (q.qx * q.qz - q.qw * q.qy)
    y = imu.force_y_frd_mps2 / GRAVITY_MPS2 + 2.0 * (q.qy * q.qz + q.qw * q.qx)
    z = imu.force_z_frd_mps2 / GRAVITY_MPS2 + 1.0 - 2.0 * (q.qx * q.qx + q.qy * q.qy)
    if not (isfinite(x + y + z) and 0.0 <= dt <= STALE_S):  # the first, or after a silence
        return TiltState(imu.time_s, 0.0, 0.0, 0.0)
    if not is_rotation(q.qw, q.qx, q.qy, q.qz):
        return TiltState(imu.time_s, tilt.x, tilt.y, tilt.z)
    gain, most = min(dt, LONGEST_S) / TILT_S, TILT_OFF_MAX
    return TiltState(
        imu.time_s,
        tilt.x + gain * (_within(x, most) - tilt.x),
        tilt.y + gain * (_within(y, most) - tilt.y),
        tilt.z + gain * (_within(z, most) - tilt.z),
    )


def _within(off: float, most: float) -> float:
    return max(-most, min(most, off))


def _look_at_surfaces(
    limits: HealthLimits,
    state: SurfacesState,
    inputs: Inputs,
    command: SurfaceCommand,
    dt_s: float,
) -> SurfacesState:
    """What was commanded against what is put out."""
    reported = inputs.surfaces
    elevator = _band(state.elevator, command.elevator, dt_s)
    aileron = _band(state.aileron, command.aileron, dt_s)
    rudder = _band(state.rudder, command.rudder, dt_s)
    brake = _band(state.brake, command.brake, dt_s)
    dead_s, brake_dead_s = state.dead_s, state.brake_dead_s
    if reported.sequence != state.sequence:
        off = max(
            _outside(elevator, reported.elevator),
            _outside(aileron, reported.aileron),
            _outside(rudder, reported.rudder),
        )
        dead_s = min(dead_s, inputs.time_s) if off > limits.surface_error_max else INFINITE
        brake_off = _outside(brake, reported.brake) > limits.surface_error_max
        brake_dead_s = min(brake_dead_s, inputs.time_s) if brake_off else INFINITE
    return SurfacesState(
        sequence=reported.sequence,
        dead_s=dead_s,
        elevator=elevator,
        aileron=aileron,
        rudder=rudder,
        brake=brake,
        brake_dead_s=brake_dead_s,
    )


def _band(band: BandState, command: float, dt_s: float) -> BandState:
    shrunk = SHRINK_PER_S * dt_s
    return BandState(min(command, band.low + shrunk), max(command, band.high - shrunk))


def _outside(band: BandState, reported: float) -> float:
    """By how much; NaN, not known, is within."""
    if reported < band.low:
        return band.low - reported
    if reported > band.high:
        return reported - band.high
    return 0.0


def fault_words(faults: int) -> str:
    """The words of all faults, by commas; "" where there are none."""
    return ", ".join(text for i, text in enumerate(FAULT_TEXTS) if faults >> i & 1)
