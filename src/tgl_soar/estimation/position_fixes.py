"""Whether a position fix is accepted, and what it makes of the estimate of motion.

A fix whose innovation r is beyond what both the filter's own covariance S and EST_GATE allow,

    |r| > gate    and    |r|² > GATE_SIGMAS² S

is an outlier: swapped markers, a glitch of the autopilot's filter.  It is refused and counted,
until `OUTLIERS_ACCEPTED` of them in a row agree with each other: then the aircraft is there,
and the estimate jumps, as it does to the first fix after so long a silence that the position is
unknown.  For JUMP_S the position is then not to be flown with (`MotionQuality.jumped`), so that
the law begins again from where the aircraft is and never sees the step.  Where the velocity of a
fix is as far off, it is left out and the position is used.

In flight no fix is the one before to the bit: one that is brings nothing, and is not taken in
(`take_fix`), so that a source which is frozen is to the estimate as one that is silent.  Of
`STEPPED_SOURCE` each is taken in: a hover repeats half of them, and says by it that it hovers.

A fix may be worse than it says and yet no outlier.  From one that is taken in to the next, fixes
move by c more than is estimated.  Of a source whose velocity is wrong c goes on as it was; of one
that scatters it turns round:

    |c - c_before|² > GATE_SIGMAS² (P + P_before + 6 R)    and    |c - c_before| > a T²
        =>    R_turns = |c - c_before|² / 18

P the filter's variance of the position, R the source's of a fix, on each axis: three independent
fixes, with weights 1, -2 and 1, differ so by 6 R on each of three axes.  a is an acceleration that
the filter may not know of, T the longer of the two steps.  R_turns counts instead of R where it is
more, and fades with each fix that follows as it should (NOISE_KEPT).  So noise is not believed, and
who has moved once, by no more than the gate, is followed within some fifty fixes.

Where R_turns counts the velocities of that source count as much less, else they would lead alone;
and what is so explained is no outlier.  Nor do fixes then hold the estimate: a frame is taken for
moved only where no more turns indicated it than a step or one wild fix makes, and outliers stand.

No aircraft jumps.  Where outliers follow fixes at once, agree, and their velocities are the
estimated one, it is the source that has moved: its filter was reset, or its origin set again.  What
it says is then moved back by that innovation (`MotionState.shift`), up to EST_RESET_MAX in all: the
estimate goes on as if nothing had been, and so do line and lift.  In which of the two frames the
ground is right is unknown: margins to ground and fence are the smaller of both.

A source that says that it dead reckons (`PositionFix.reckoned`) is used on, for how long is not
decided here.  What is corrected right after that is what it reckoned wrongly: the aircraft has been
elsewhere, no frame has moved.

Another `PositionFix.source` has another origin, by some centimetres.  The innovation of its first
fix, as far as the filter's own uncertainty does not explain it, is learnt as the source's offset,
and removed slowly: the position slides over, and the velocity is not affected.  Which of both
origins is right is unknown: what is left of the offset is part of the reported standard deviation.
What differs by more than OFFSET_MAX_M is an outlier like any other.
"""

from __future__ import annotations

from math import exp, sqrt
from typing import Final, NamedTuple

from tgl_soar.estimation.fix_filter import (
    Covariance,
    Errors,
    Moments,
    errors_carried,
    position_taken,
    velocity_taken,
)
from tgl_soar.estimation.inertial_track import Place, oldest_s, track_at
from tgl_soar.estimation.motion_state import (
    NO_NOISE,
    NO_OFFSET,
    NO_OUTLIERS,
    OUTLIERS_ACCEPTED,
    RECKONED_KEPT_S,
    FixNoise,
    FrameShift,
    Innovation,
    LastFix,
    MotionGains,
    MotionState,
    Offset,
    Outliers,
    Reckoning,
    covariance_at,
    is_later,
    track_errors_at,
)
from tgl_soar.geometry import SoaringFrame, soaring_from_ned, soaring_vector_from_ned
from tgl_soar.types import STEPPED_SOURCE, PositionFix, isfinite

GATE_SIGMAS: Final = 5.0
GATE_MPS: Final = 1.0  # floor of the gate of velocities
AGREE_MPS: Final = 5.0  # how wrong the estimated velocity may be while outliers are compared
LOST_M: Final = 0.5  # an estimate as uncertain as this, and 3 σ of a fix, is reset by a fix
START_MPS: Final = 2.0  # how fast the aircraft may be where a first fix has no velocity
VELOCITY_MAX_MPS: Final = 25.0  # over the ground; a faster one is none
SIGMA_MAX_M: Final = 1e3  # a fix as uncertain as this says nothing
OFFSET_M: Final = 0.3  # how far the origins of two sources may be apart: standard deviation
OFFSET_MAX_M: Final = 3.0 * OFFSET_M  # farther off a new source is not accepted at once
OFFSET_SMALL_M: Final = 1e-4  # too small to be removed slowly
BLEED_S: Final = 5.0  # in which an offset is removed, no faster than
BLEED_MPS: Final = 0.05
REPEATED: Final = 3  # the same numbers again and again are no fixes: it may have moved meanwhile
# Of what fixes are seen to scatter so much is kept from one to the next.  Less, and by chance a few
# that agree are believed; more, and who has moved is followed late: after a step of 0.45 m the
# estimate is within a tenth of it in 1.0 s at 50 Hz.  Noise of 3 to 30 cm leaves NEES of 0.9 to 1.4
# with accelerometers, of 3 to 20 cm 0.8 to 1.3 without (tests/estimation).
NOISE_KEPT: Final = 0.8
# An acceleration that the filter may not know of [m/s²]: a throw by hand, or what of it the
# accelerometers measure wrongly while the attitude is 20 to 60 degrees off.
UNKNOWN_MPS2: Final = 60.0
MISMEASURED_MPS2: Final = 15.0
NOISE_GATES: Final = 0.5  # so many EST_GATE at most is the noise that widens the gate
# Turns that a single one makes at most: a step two, there and not on; a wild fix three, there,
# back, stay.  At 5 Hz an acceleration explains some of them.
SINGLE_TURNS: Final = 3
# Fixes that count as noise do not hold an estimate, so it may go away from them by itself, whereas
# a source that has moved stands.  Of an estimate flown alone, from the first outlier to the fifth:
# resets and steps 0 to 0.21 m/s, what a wild fix or a wrong attitude had led 0.56 to 6 m/s.
STANDS_MPS: Final = 0.3
# So long after an estimate was reset that fixes did not hold, no frame is taken for moved: of
# what scatters not enough has been seen yet.
ASTRAY_S: Final = 2.0
# Of a sum that tells whether any of six numbers has changed: roots of prime numbers, of which no
# whole multiples cancel.  Each by itself: mypyc 2.4.1 takes a tuple of nothing but floats for one
# that was never set.
_ROOT_2: Final = sqrt(2.0)
_ROOT_3: Final = sqrt(3.0)
_ROOT_5: Final = sqrt(5.0)
_ROOT_7: Final = sqrt(7.0)
_ROOT_11: Final = sqrt(11.0)
GAP_S: Final = 0.5  # without a fix: it may have moved by EST_GATE at the 1 m/s of a slide


class _Measured(NamedTuple):
    """A fix in the soaring frame, as its source would give it, had it not moved."""

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


def _measured(
    gains: MotionGains, frame: SoaringFrame, shift: FrameShift, fix: PositionFix
) -> _Measured:
    x, y, z = soaring_from_ned(frame, fix.north_m, fix.east_m, fix.down_m)
    shift_x, shift_y, shift_z = shift
    vx, vy, climb = soaring_vector_from_ned(
        frame, fix.velocity_north_mps, fix.velocity_east_mps, fix.velocity_down_mps
    )
    sd = fix.sigma_m if fix.sigma_m > gains.fix_sd_m else gains.fix_sd_m  # false for NaN
    return _Measured(
        time_s=fix.time_s - gains.fix_delay_s,
        x_m=x - shift_x,
        y_m=y - shift_y,
        z_m=z - shift_z,
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
        and is_later(measured.time_s, state.errors.time_s, now_s)
    )


def takes_repetitions(source: int, moves: bool) -> bool:
    """Whether a fix of a source is taken in that repeats the one before.  moves: the aircraft does
    not stand still."""
    return not moves or source == STEPPED_SOURCE


def take_fix(
    gains: MotionGains,
    frame: SoaringFrame,
    state: MotionState,
    fix: PositionFix,
    now_s: float,
    moves: bool = False,
) -> MotionState:
    """The estimate with a new fix taken in or refused.

    moves: as for `takes_repetitions`.
    """
    measured = _measured(gains, frame, state.shift, fix)
    time_s = measured.time_s
    if not _is_usable(state, fix, measured, now_s):
        latest = state.fix._replace(sequence=fix.sequence)
        return state._replace(fix=latest, rejected=state.rejected + 1)

    if fix.reckoned or state.reckoning.now:
        state = state._replace(reckoning=_reckoning(state.reckoning, fix.reckoned, time_s))
    total = _sum(fix)
    latest = LastFix(
        sequence=fix.sequence,
        time_s=time_s,
        source=fix.source,
        sum=total,
        repeated=state.fix.repeated + 1 if total == state.fix.sum else 0,
    )
    if latest.repeated > 0 and not takes_repetitions(fix.source, moves):
        return state._replace(fix=latest._replace(time_s=state.fix.time_s, source=state.fix.source))
    return _compared(gains, state, latest, measured, now_s)


def _compared(
    gains: MotionGains, state: MotionState, latest: LastFix, measured: _Measured, now_s: float
) -> MotionState:
    """The estimate with a usable fix taken in, or refused as an outlier."""
    time_s, last_s = measured.time_s, state.errors.time_s
    source = state.fix.source
    place = track_at(state.track, time_s)
    if last_s != last_s:  # NaN: the first
        return _start(gains, state, latest, measured, place)
    covariance = covariance_at(gains, state, time_s)
    pp, _, _, _, _, _ = covariance
    if not pp <= LOST_M * LOST_M + 9.0 * measured.variance_m2:
        return _start(gains, state._replace(jump_s=now_s), latest, measured, place)

    track_x, track_y, track_z, track_vx, track_vy, track_climb = place
    x, y, z, vx, vy, climb = track_errors_at(state, time_s)
    scatter = pp + measured.variance_m2
    same_source = latest.source == source
    offset = state.offset if same_source else NO_OFFSET
    ox, oy, oz = offset
    rx = measured.x_m - ox - track_x - x
    ry = measured.y_m - oy - track_y - y
    rz = measured.z_m - oz - track_z - z
    distance = _length(rx, ry, rz)
    reach = _reach(gains, scatter, state.noise)
    if same_source and (ox != 0.0 or oy != 0.0 or oz != 0.0):
        removed = _removed(_length(ox, oy, oz), time_s - last_s)
        dx, dy, dz = removed * ox, removed * oy, removed * oz
        offset = Offset(ox - dx, oy - dy, oz - dz)
        x, y, z = x + dx, y + dy, z + dz
    elif not same_source and distance <= OFFSET_MAX_M:
        # The offset takes what of the difference the filter's uncertainty does not explain.
        weight = OFFSET_M * OFFSET_M / (OFFSET_M * OFFSET_M + scatter)
        offset = Offset(weight * rx, weight * ry, weight * rz)
        rx, ry, rz = (1.0 - weight) * rx, (1.0 - weight) * ry, (1.0 - weight) * rz
        distance *= 1.0 - weight
    innovation = Innovation(rx, ry, rz, distance * distance / scatter)
    shift, noise = state.shift, NO_NOISE
    if distance > reach:
        outliers = _outliers(gains, state, innovation, time_s)
        if outliers.in_a_row < OUTLIERS_ACCEPTED:
            refused = latest._replace(time_s=state.fix.time_s, source=source)
            return state._replace(
                fix=refused,
                innovation=innovation,
                outliers=outliers,
                rejected=state.rejected + 1,
            )
        shift = FrameShift(shift.x_m + rx, shift.y_m + ry, shift.z_m + rz)
        velocity = track_vx + vx, track_vy + vy, track_climb + climb
        has_moved = not outliers.gap and _stands(state, outliers, measured.variance_m2, now_s)
        if not has_moved or not _is_reset(gains, covariance, measured, velocity, shift):
            compared = state._replace(innovation=innovation, jump_s=now_s, astray_s=now_s)
            return _start(gains, compared, latest, measured, place)
        rx, ry, rz = 0.0, 0.0, 0.0
    elif same_source and latest.repeated > 0:  # nothing new is known
        noise = _faded(state.noise, measured.variance_m2)
    elif same_source:
        worst_mps2 = MISMEASURED_MPS2 if state.inertial else UNKNOWN_MPS2
        step_s = time_s - last_s
        noise = _scattered(state.noise, innovation, pp, measured.variance_m2, worst_mps2, step_s)
    measured = _discounted(measured, noise)

    errors = errors_carried(state.errors, time_s, (x, y, z, vx, vy, climb), covariance)
    errors = position_taken(errors, rx, ry, rz, measured.variance_m2)
    if measured.has_velocity:
        errors = _with_velocity(errors, measured, place)
    if latest.repeated == 0:
        noise = noise._replace(
            x_m=rx + x - errors.x_m, y_m=ry + y - errors.y_m, z_m=rz + z - errors.z_m
        )
    return state._replace(
        errors=errors,
        fix=latest,
        offset=offset,
        shift=shift,
        innovation=innovation,
        noise=noise,
        outliers=NO_OUTLIERS,
    )


def _reach(gains: MotionGains, scatter_m2: float, noise: FixNoise) -> float:
    """How far a fix may be off that is no outlier; scatter_m2: of what both say, on each axis."""
    most_m = NOISE_GATES * gains.fix_gate_m
    observed_m2 = min(noise.variance_m2, most_m * most_m)
    return max(gains.fix_gate_m, GATE_SIGMAS * sqrt(scatter_m2 + observed_m2))


def _scattered(
    before: FixNoise,
    innovation: Innovation,
    estimated_m2: float,
    fix_m2: float,
    worst_mps2: float,
    step_s: float,
) -> FixNoise:
    """The noise of fixes with one more.

    estimated_m2, fix_m2: variances of the estimate and of the fix, on each axis; worst_mps2: an
    acceleration that the filter may not know of; step_s: since the fix before.
    """
    kept_m2, x, y, z, step_x, step_y, step_z, step_m2, before_s, turns = before
    rx, ry, rz, _ = innovation
    cx, cy, cz = rx - x, ry - y, rz - z
    turn_x, turn_y, turn_z = cx - step_x, cy - step_y, cz - step_z
    square = turn_x * turn_x + turn_y * turn_y + turn_z * turn_z
    explained_m2 = estimated_m2 + step_m2 + 6.0 * fix_m2
    longer_s = max(step_s, before_s)
    flown_m = worst_mps2 * longer_s * longer_s
    is_noise = square > max(GATE_SIGMAS * GATE_SIGMAS * explained_m2, flown_m * flown_m)
    alone = kept_m2 <= fix_m2  # the first: those before it were as good as they said
    observed_m2 = square / (3.0 if alone else 18.0) if is_noise else 0.0
    variance_m2 = max(NOISE_KEPT * kept_m2, observed_m2)
    return FixNoise(
        variance_m2=variance_m2,
        x_m=rx,
        y_m=ry,
        z_m=rz,
        step_x_m=cx,
        step_y_m=cy,
        step_z_m=cz,
        step_m2=estimated_m2,
        step_s=step_s,
        turns=turns + (1 if is_noise else 0) if variance_m2 > fix_m2 else 0,
    )


def _faded(noise: FixNoise, fix_m2: float) -> FixNoise:
    """The noise with a fix of which nothing new is known; fix_m2: as for `_scattered`."""
    variance_m2 = NOISE_KEPT * noise.variance_m2
    return noise._replace(variance_m2=variance_m2, turns=noise.turns if variance_m2 > fix_m2 else 0)


def _discounted(measured: _Measured, noise: FixNoise) -> _Measured:
    """A fix as good as fixes are seen to be."""
    worse = noise.variance_m2 / measured.variance_m2
    if worse <= 1.0:
        return measured
    return measured._replace(
        variance_m2=noise.variance_m2,
        velocity_variance_m2ps2=measured.velocity_variance_m2ps2 * worse,
    )


def _with_velocity(errors: Errors, measured: _Measured, track: Place) -> Errors:
    """The errors with the velocity of a fix taken in, unless it is too far off."""
    _, _, _, track_vx, track_vy, track_climb = track
    variance = measured.velocity_variance_m2ps2
    rx = measured.velocity_x_mps - track_vx - errors.velocity_x_mps
    ry = measured.velocity_y_mps - track_vy - errors.velocity_y_mps
    rz = measured.climb_mps - track_climb - errors.climb_mps
    if _length(rx, ry, rz) > _velocity_gate(errors.covariance.vv, variance):
        return errors
    return velocity_taken(errors, rx, ry, rz, variance)


def _velocity_gate(estimated_m2ps2: float, measured_m2ps2: float) -> float:
    return max(GATE_MPS, GATE_SIGMAS * sqrt(estimated_m2ps2 + measured_m2ps2))


def _stands(state: MotionState, outliers: Outliers, fix_m2: float, now_s: float) -> bool:
    """Whether outliers stand off an estimate that does not go away by itself.

    fix_m2: variance of a fix, on each axis.
    """
    if now_s - state.astray_s <= ASTRAY_S:  # false for NaN: never
        return False
    if state.noise.variance_m2 <= fix_m2:  # fixes have held it
        return True
    if state.noise.turns > SINGLE_TURNS:
        return False
    gone_m = _length(
        outliers.x_m - outliers.first_x_m,
        outliers.y_m - outliers.first_y_m,
        outliers.z_m - outliers.first_z_m,
    )
    lasted_s = outliers.time_s - outliers.first_s
    return gone_m <= STANDS_MPS * lasted_s + GATE_SIGMAS * sqrt(2.0 * fix_m2)


def _is_reset(
    gains: MotionGains,
    covariance: Moments,
    measured: _Measured,
    velocity: tuple[float, float, float],
    shift: FrameShift,
) -> bool:
    """Whether the source has moved, by `shift` in all; else the aircraft itself may have.

    velocity: the estimated one [m/s].  A fix without one does not contradict it.
    """
    if _length(shift.x_m, shift.y_m, shift.z_m) > gains.reset_max_m:
        return False
    if not measured.has_velocity:
        return True
    vx, vy, climb = velocity
    _, _, _, vv, _, _ = covariance
    off = _length(
        measured.velocity_x_mps - vx, measured.velocity_y_mps - vy, measured.climb_mps - climb
    )
    return off <= _velocity_gate(vv, measured.velocity_variance_m2ps2)


def _length(x: float, y: float, z: float) -> float:
    return sqrt(x * x + y * y + z * z)


def _removed(offset_m: float, interval_s: float) -> float:
    """The fraction of an offset that is removed in a time."""
    if offset_m < OFFSET_SMALL_M:
        return 1.0
    return min(1.0 - exp(-interval_s / BLEED_S), BLEED_MPS * interval_s / offset_m)


def _start(
    gains: MotionGains, state: MotionState, latest: LastFix, measured: _Measured, place: Place
) -> MotionState:
    """The aircraft is where the fix says; of the past only the bias is kept.

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
        fix=latest,
        offset=NO_OFFSET,
        noise=NO_NOISE,
        outliers=NO_OUTLIERS,
    )


def _reckoning(before: Reckoning, reckoned: bool, time_s: float) -> Reckoning:
    """With one more fix."""
    if not reckoned:
        return Reckoning(before.since_s, before.last_s, False)
    gap_s = time_s - before.last_s
    if not 0.0 <= gap_s <= RECKONED_KEPT_S:  # true for NaN: the first
        return Reckoning(time_s, time_s, True)
    measured_s = (
        0.0 if before.now else gap_s
    )  # what was measured between two stretches is not theirs
    return Reckoning(before.since_s + measured_s, time_s, True)


def _outliers(
    gains: MotionGains, state: MotionState, innovation: Innovation, time_s: float
) -> Outliers:
    """The outliers that agree with each other, with one more."""
    count, last_s, gap, x, y, z, first_s, first_x, first_y, first_z = state.outliers
    if count > 0 and time_s <= last_s:  # again, over another link
        return state.outliers
    rx, ry, rz, _ = innovation
    near = gains.fix_gate_m + AGREE_MPS * (time_s - last_s)
    agrees = count > 0 and _length(rx - x, ry - y, rz - z) <= near
    if not agrees:
        gap = state.fix.repeated >= REPEATED or not time_s - state.fix.time_s <= GAP_S
        gap = gap or time_s - state.reckoning.last_s <= RECKONED_KEPT_S  # false for NaN: none
        first_s, first_x, first_y, first_z = time_s, rx, ry, rz
    return Outliers(
        in_a_row=count + 1 if agrees else 1,
        time_s=time_s,
        gap=gap,
        x_m=rx,
        y_m=ry,
        z_m=rz,
        first_s=first_s,
        first_x_m=first_x,
        first_y_m=first_y,
        first_z_m=first_z,
    )


def _sum(fix: PositionFix) -> float:
    """Of what differs from fix to fix, as far as it is known; no two fixes that differ by whole
    centimetres have the same."""
    total = fix.north_m + _ROOT_2 * fix.east_m + _ROOT_3 * fix.down_m
    vn, ve, vd = fix.velocity_north_mps, fix.velocity_east_mps, fix.velocity_down_mps
    speed = _ROOT_5 * vn + _ROOT_7 * ve + _ROOT_11 * vd
    return total + speed if isfinite(speed) else total
