"""The height over the ground by a rangefinder that looks down: a bound, and a slow correction.

The beam leaves along the body's third axis.  With the distance r that it measures, roll phi, pitch
theta and heading psi (from upwind, positive to the right), the ground that it meets lies

    h  = r cos phi cos theta                                      below the aircraft
    dx = −r (cos phi sin theta cos psi + sin phi sin psi)         downstream of it

and the aircraft is d higher over it than its position says:

    d = z_ground(x + dx) + h + climb · age − z          age: of the sample, at the tick

z_ground: the site's profile.  Where it is not known it counts as zero, and d means nothing but its
changes.  The sensor counts as being where the position is of: 0.1 m off is 0.1 m of height.

**The bound.**  The ground is no farther than the largest of the last three d say, so that one or
two readings that are too short (grass, an insect, dust) bring no ground near: after a gap there is
none before the third.  The margins take it where it is the nearer one, and never where it is the
farther one: `GroundRange.bound_m`.

**The correction** c, where RNG_USE allows it, is added to the height: a receiver's error in height
changes by metres in minutes, and the line sinks with it.  With m the median of the last three d,

    c' = (K m − c) / T,   |c'| <= RATE,   −2 RNG_GATE <= c <= RNG_GATE
    K = 1 / (1 + (RATIO s)²)              s: the slope of the ground that the beam meets

T and RATE follow from a receiver that errs by 2 m with a time constant of 300 s, as a Gauss-Markov
process does: a first-order average lags by 2 m sqrt(T / (T + 300 s)), 0.16 m with T = 2 s, and it
drifts by 0.12 m/s within that time, three times of which is 0.35 m/s.  RATE is a little less: as
fast as a line slides (TGL_SLEW), which the law is made to follow.  The
velocity is not corrected: it does not drift.  A ground that is farther than the position says would
let the aircraft down, on one sensor's word: there half as much is allowed.  What lacks samples
keeps c: it is the best guess for as long as 300 s ln 2.  In flight RNG_USE lets c begin at 0, and
fade to it, no faster than RATE.

**What is refused**, before it is a bound or corrects anything:

    tilted      beyond TILT_RAD: there 1 degree of attitude's error is 0.1 m from 13 m up
    frozen      the same number again while the position's height moved by FROZEN_M: ten times what
                a message in centimetres resolves
    far off     by more than RNG_GATE from the last d that was used: no receiver drifts so fast, and
                what steps while the position does not is the sensor. Over a known ground by more
                than twice the gate from 0, three standard deviations of the receiver's 2 m; the
                first in a flight by more than the gate
    from near   over ground without a profile a first reading in flight that is no farther than
                the gate: ground comes into sight from afar, and what is suddenly near is no ground

What was used LATE_S ago or longer refuses nothing: the height may have drifted since, or other
ground lie below.  Nor does what is used then before the third: one alone may be wrong.  A sample is
judged as the first in a flight there; and if nothing was measured
for as long, over a known ground it may be nearer by twice the gate, as where it is corrected.

**What is refused may be right**: then its d stays while the aircraft moves.  That of a sensor that
is frozen, noise or none, or that sees its own wheel, moves as the aircraft does.  So it is taken
after all where d has stayed within PROOF_BAND_M of where it began for PROOF_S, while the height
over the ground by the position went through PROOF_M.  A reading that is stuck would have left the
band by then: within it that height goes through no more than 2 PROOF_BAND_M and the spread of the
noise, 0.6 m + 6 · 0.03 m.  Ground that is right stays in it: the difference of two readings is
0.3 m off at seven of its standard deviations, and the receiver drifts by 0.24 m in PROOF_S.  What
passes below, a tree or a car of 10 m at 7 m/s, is over by then.  Over a known ground only nearer
ground is taken so, up to twice the gate, and as a bound: a sensor that is off by a constant proves
itself, too, and must not move the line.  From d within the gate on it corrects again.

After a jump of the position it begins again, without a correction: its frame may be another.  So
it does after a clock that has gone back.
What is refused for REFUSED_S is reported and ends nothing.

Nobody can tell by this a height that is wrong from a place that is: over a slope of s a position
that is off by b downstream looks s b too high or low.  A receiver errs half as far horizontally as
in height, RATIO, and K is the part of m that then is, on average, of height: all of it over level
ground, 0.8 over a slope of 1, 0.5 over a slope of 2.  The bound needs no such part: however the
position is wrong, the ground is where the beam meets it.
"""

from __future__ import annotations

from math import cos, exp, sin
from typing import Final, NamedTuple

from tgl_soar.types import (
    NAN,
    Ground,
    GroundStretch,
    RangeSample,
    VehicleState,
    ground_stretch,
    isfinite,
)

# What a rangefinder is used for: RNG_USE.
RANGE_UNUSED: Final = 0
RANGE_BOUNDS: Final = 1
RANGE_CORRECTS: Final = 2

CORRECTION_S: Final = 2.0  # T
CORRECTION_MPS: Final = 0.3  # RATE
RATIO: Final = 0.5  # of a receiver's standard deviations, horizontally to in height
TILT_RAD: Final = 0.4
FROZEN_M: Final = 0.1
LATE_S: Final = 0.5  # an older sample, and what came before such a gap, is none of now
REFUSED_S: Final = 1.0  # of good attitude, as long as a fault of another stream stands
MOST_GATES: Final = 2.0  # times the gate
PROOF_S: Final = 2.0
PROOF_BAND_M: Final = 0.3
PROOF_M: Final = 1.0

# How the last sample was taken.
NO_RANGE_YET: Final = 0
RANGE_USED: Final = 1
RANGE_TILTED: Final = 2
RANGE_FROZEN: Final = 3
RANGE_FAR_OFF: Final = 4
RANGE_INVALID: Final = 5  # out of order, from the future, or late
RANGE_NOTHING: Final = 6  # no number: nothing comes back


class RangeGains(NamedTuple):
    """What a rangefinder may do."""

    use: int  # RANGE_…
    gate_m: float  # by which it may differ from what the position says


class RangeState(NamedTuple):
    """What is remembered of a rangefinder."""

    sequence: int  # of the last sample looked at
    time_s: float  # of the last sample used; NaN: none of now
    standing: int  # how the last sample was taken: RANGE_…
    off_m: float  # d of the last sample used
    off_1_m: float  # and of the two before it; NaN: after a gap
    off_2_m: float
    correction_m: float  # c
    known: bool  # one was used, and the position has not jumped since
    reading_m: float  # the last reading looked at
    turned_m: float  # height over the ground by the position when that reading came first
    sound_s: float  # the tick in which a sample was last used, or none came
    corrects: bool  # d may correct the height; else it only bounds
    measured_s: float  # of the last sample that had a number
    proof_s: float  # of the sample from which on d has stayed
    proof_off_m: float  # d of that sample
    proof_low_m: float  # least height over the ground by the position since then
    proof_high_m: float  # and the largest


class GroundRange(NamedTuple):
    """What a rangefinder says in one tick."""

    standing: int  # as RangeState has it
    bound_m: float  # added to the position's height the ground is no farther; NaN: not known
    correction_m: float  # what is added to the position's height
    refused: bool  # samples come, and none was used for a while


NO_RANGE_STATE: Final = RangeState(
    sequence=0,
    time_s=NAN,
    standing=NO_RANGE_YET,
    off_m=NAN,
    off_1_m=NAN,
    off_2_m=NAN,
    correction_m=0.0,
    known=False,
    reading_m=NAN,
    turned_m=NAN,
    sound_s=NAN,
    corrects=True,
    measured_s=NAN,
    proof_s=NAN,
    proof_off_m=NAN,
    proof_low_m=NAN,
    proof_high_m=NAN,
)
NO_GROUND_RANGE: Final = GroundRange(
    standing=NO_RANGE_YET, bound_m=NAN, correction_m=0.0, refused=False
)


def ground_height(ground: Ground, x_m: float) -> float:
    """Height [m] of the profile at a place, level beyond its ends; 0 where it is not known."""
    if ground.points == 0:
        return 0.0
    stretch = ground_stretch(ground, x_m)
    slope = _slope(stretch)
    return stretch.z_m + slope * (x_m - stretch.x_m) if slope != 0.0 else stretch.z_m


def ground_slope(ground: Ground, x_m: float) -> float:
    """How steeply it rises there, downstream."""
    return _slope(ground_stretch(ground, x_m))


def _slope(stretch: GroundStretch) -> float:
    length = stretch.next_x_m - stretch.x_m
    return (stretch.next_z_m - stretch.z_m) / length if length > 0.0 else 0.0


def beam_drop(roll_rad: float, pitch_rad: float) -> float:
    """How far below the aircraft a beam of 1 m ends [m]."""
    return cos(roll_rad) * cos(pitch_rad)


def beam_reach(roll_rad: float, pitch_rad: float, heading_rad: float) -> float:
    """How far downstream of the aircraft it ends [m]."""
    ahead = cos(roll_rad) * sin(pitch_rad) * cos(heading_rad)
    return -ahead - sin(roll_rad) * sin(heading_rad)


def range_step(
    gains: RangeGains,
    ground: Ground,
    state: RangeState,
    sample: RangeSample,
    vehicle: VehicleState,
    certain: bool,
    jumped: bool,
    flying: bool,
) -> tuple[RangeState, GroundRange]:
    """Take in a new sample; what the rangefinder says at vehicle.time_s.

    vehicle: by its position alone, not corrected.  certain: that may be flown with.  jumped: it
    was reset just now.
    """
    now = vehicle.time_s
    if gains.use == RANGE_UNUSED or sample.sequence == 0:
        left = 0.0 if jumped or not flying else _fading(state.correction_m, now - state.sound_s)
        if left == 0.0:
            return NO_RANGE_STATE, NO_GROUND_RANGE
        state = NO_RANGE_STATE._replace(correction_m=left, sound_s=now)
        return state, NO_GROUND_RANGE._replace(correction_m=left)
    silent = not abs(now - sample.time_s) <= LATE_S  # true for NaN
    back = state.time_s > now + LATE_S  # the clock: all that comes would be refused as late
    if jumped or back or (silent and not flying):
        state = NO_RANGE_STATE._replace(sequence=sample.sequence, sound_s=now)
    elif sample.sequence != state.sequence:
        state = _taken(gains, ground, state, sample, vehicle, certain, flying)
        if state.standing == RANGE_NOTHING and not flying:
            state = NO_RANGE_STATE._replace(sequence=sample.sequence, sound_s=now)
    elif silent:  # nothing is refused
        state = state._replace(sound_s=now)
    bound = NAN
    if abs(now - state.time_s) <= LATE_S and isfinite(state.off_2_m):  # false for NaN
        bound = max(state.off_m, state.off_1_m, state.off_2_m)
    return state, GroundRange(
        standing=state.standing,
        bound_m=bound,
        correction_m=state.correction_m,
        refused=now - state.sound_s >= REFUSED_S,
    )


def _fading(correction_m: float, interval_s: float) -> float:
    """What is left of a correction that nothing asks for any more."""
    most = CORRECTION_MPS * interval_s if 0.0 <= interval_s <= LATE_S else 0.0  # 0 for NaN
    return correction_m - max(-most, min(most, correction_m))


def _taken(
    gains: RangeGains,
    ground: Ground,
    state: RangeState,
    sample: RangeSample,
    vehicle: VehicleState,
    certain: bool,
    flying: bool,
) -> RangeState:
    """With one more sample, used or refused."""
    now, last_s = vehicle.time_s, state.time_s
    roll, pitch = vehicle.roll_rad, vehicle.pitch_rad
    age_s = now - sample.time_s
    height = sample.range_m * beam_drop(roll, pitch)
    foot = vehicle.x_m + sample.range_m * beam_reach(roll, pitch, vehicle.heading_rad)
    reported = vehicle.z_m - ground_height(ground, foot)  # the same height by the position
    off = height + vehicle.climb_mps * age_s - reported
    turned = state.turned_m
    if sample.range_m != state.reading_m or not isfinite(turned):
        turned = reported

    standing = RANGE_USED
    corrects = state.corrects
    if not (isfinite(sample.range_m) and sample.range_m > 0.0):
        standing, turned = RANGE_NOTHING, NAN
    elif not (isfinite(off) and abs(age_s) <= LATE_S) or sample.time_s <= last_s:
        standing, turned = RANGE_INVALID, NAN
    elif abs(roll) > TILT_RAD or abs(pitch) > TILT_RAD:
        standing = RANGE_TILTED
    elif abs(reported - turned) > FROZEN_M:
        standing = RANGE_FROZEN
    else:
        ground_known = ground.points > 0
        silent = not sample.time_s - state.measured_s <= LATE_S  # true for NaN
        state = _with_proof(state, sample.time_s, off, reported)
        if _is_ground(gains.gate_m, ground_known, state, sample, off, height, silent, flying):
            corrects = corrects or abs(off) <= gains.gate_m
        elif _is_proven(gains.gate_m, ground_known, state, off):
            corrects = False
        else:
            standing = RANGE_FAR_OFF
    if standing in (RANGE_TILTED, RANGE_FROZEN):  # numbers, and no proof
        state = state._replace(measured_s=sample.time_s, proof_off_m=NAN)
    sound_s = state.sound_s
    refused = standing in (RANGE_INVALID, RANGE_FROZEN, RANGE_FAR_OFF)
    if not refused or not isfinite(sound_s):
        sound_s = now
    state = state._replace(
        sequence=sample.sequence,
        standing=standing,
        reading_m=sample.range_m,
        turned_m=turned,
        sound_s=sound_s,
        corrects=corrects,
    )
    if standing != RANGE_USED:
        return state
    return _used(gains, ground, state, sample.time_s, off, foot, certain, flying)


def _used(
    gains: RangeGains,
    ground: Ground,
    state: RangeState,
    time_s: float,
    off_m: float,
    foot_m: float,
    certain: bool,
    flying: bool,
) -> RangeState:
    """With one more d, of ground at foot_m, in the bound and the correction."""
    interval = time_s - state.time_s
    follows = interval <= LATE_S  # false for NaN: the first
    off_1 = state.off_m if follows else NAN
    off_2 = state.off_1_m if follows else NAN
    correction = state.correction_m
    if gains.use != RANGE_CORRECTS:
        correction = _fading(correction, interval)
    elif ground.points > 0 and certain and state.corrects:
        middle = off_m
        if isfinite(off_2):
            middle += off_1 + off_2 - max(off_m, off_1, off_2) - min(off_m, off_1, off_2)
        leans = RATIO * ground_slope(ground, foot_m)
        middle /= 1.0 + leans * leans
        if not flying and not state.known:
            correction = middle
        elif isfinite(off_2):
            change = (middle - correction) * (1.0 - exp(-interval / CORRECTION_S))
            if flying:
                most = CORRECTION_MPS * interval
                change = max(-most, min(most, change))
            correction += change
        correction = max(-MOST_GATES * gains.gate_m, min(gains.gate_m, correction))
    return state._replace(
        time_s=time_s,
        off_m=off_m,
        off_1_m=off_1,
        off_2_m=off_2,
        correction_m=correction,
        known=True,
    )


def _is_ground(
    gate_m: float,
    ground_known: bool,
    state: RangeState,
    sample: RangeSample,
    off_m: float,
    height_m: float,
    silent: bool,
    flying: bool,
) -> bool:
    """Whether a sample is one of the ground, as far as that can be known.

    silent: nothing was measured for LATE_S before it.
    """
    if ground_known and abs(off_m) > MOST_GATES * gate_m:
        return False
    if not flying or (state.known and abs(off_m - state.off_m) <= gate_m):
        return True
    if state.known and sample.time_s - state.time_s <= LATE_S and isfinite(state.off_2_m):
        return False
    if not ground_known:
        return height_m > gate_m
    nearest = MOST_GATES if state.known and silent else 1.0
    return -nearest * gate_m <= off_m <= gate_m


def _with_proof(state: RangeState, time_s: float, off_m: float, reported_m: float) -> RangeState:
    """For how long d has stayed, and which heights the position went through meanwhile."""
    stays = abs(off_m - state.proof_off_m) <= PROOF_BAND_M  # false for NaN
    if stays and time_s - state.measured_s <= LATE_S:
        return state._replace(
            measured_s=time_s,
            proof_low_m=min(state.proof_low_m, reported_m),
            proof_high_m=max(state.proof_high_m, reported_m),
        )
    return state._replace(
        measured_s=time_s,
        proof_s=time_s,
        proof_off_m=off_m,
        proof_low_m=reported_m,
        proof_high_m=reported_m,
    )


def _is_proven(gate_m: float, ground_known: bool, state: RangeState, off_m: float) -> bool:
    """Whether d has stayed while the aircraft moved, and may be taken for that."""
    if ground_known and not -MOST_GATES * gate_m <= off_m < 0.0:
        return False
    moved = state.proof_high_m - state.proof_low_m >= PROOF_M
    return moved and state.measured_s - state.proof_s >= PROOF_S
