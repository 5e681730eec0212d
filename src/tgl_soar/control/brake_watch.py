"""Whether the brake does what it is commanded, by what the aircraft does.

An output that is read back is where the autopilot sends a servo, not where the surface stands.

**To one side.**  If one half jams, the other half rolls the aircraft, and the roll loop holds
against it: its aileron follows the brake.  With <…> the mean over WATCH_S of what is left when
each one's own mean over MEAN_S is taken off,

    r = <b a> / <b b>           aileron for all of the brake
    s² = (<a a> - r <b a>) / <b b> N            its variance, N independent samples of SAMPLE_S

Gusts move both, but not together.  |r| of UNEVEN or more, and of UNEVEN_SIGMAS s, is a brake that
pulls to one side, as soon as N is SAMPLES.

**At all.**  Where accelerations are known and the brake takes lift, `brake_shake` tells; else this.
The law asks for an end of the travel for long where the point is outside the band, and
just so where the brake is jammed.  What it asks for by itself does not tell: a rising aircraft is
answered by more brake, so that both go together whether it acts or not.  So the law rests for
some seconds, and the brake moves to and fro by TRIED of its travel, in halves of HALF_S.  With the
mean speed v along the line in each, when the first of it has passed,

    q = D (v_in - v_out) / (TRIED S_b)          1: it acts; 0: it does not

(D, S_b: `control.point_hold`; v_in of the halves before and after).  A mean of q that is less than
TRIED_LEAST by TRIED_SIGMAS of its own deviations is a brake that does not act; more than that by as
many is one that does, and then nothing is tried for TRIED_REST_S.  Where TRIED_MOST do not tell,
the law goes on, and what was seen counts half in the next trial.
"""

from __future__ import annotations

from typing import Final, NamedTuple

from tgl_soar.types import isfinite

# A brake's gusts and a roll loop's differ: their product forgets itself within a third of a second.
# In gusts of 1 to 5 % a brake that is well shows an r of 0.01 to 0.02, 0.6 to 0.8 of this s.
WATCH_S: Final = 20.0
SAMPLE_S: Final = 0.3
# After a capture both settle, and a point that is moved takes the brake along, once each: that two
# slow ways go together says nothing, and no number of samples of them makes it more.
MEAN_S: Final = 2.0
# Nine seconds at least.  Of fewer the deviation s is itself not known: with half as many four of it
# come by chance once in 700 flights, in their first seconds.
SAMPLES: Final = 30.0
# Less than a twelfth of the aileron is no loss; three quarters of this is taken by the trim.
UNEVEN: Final = 0.08
UNEVEN_SIGMAS: Final = 4.0
MOVED: Final = 0.02  # rms of the brake, below which nothing can be estimated of it

# Over three times that of `point_hold.OUTSIDE_S`, so that the point is reported as outside first:
# 14 s of an end.  Within the band 5 % of turbulence come to 0.65.
PRESSED_S: Final = 10.0
PRESSED: Final = 0.75
# Small enough to stay within the band, 4 cm in the tunnel; long enough that the lift has followed
# (6 rad/s), and short enough that the slide back (1 / s there) has not.
TRIED: Final = 0.4
HALF_S: Final = 1.0
PASSED_S: Final = 0.3
TRIED_LEAST: Final = 0.4  # where 0.7 is usual: the slide back takes the rest
TRIED_SIGMAS: Final = 3.0
TRIED_FEWEST: Final = 6.0
TRIED_MOST: Final = 16.0
TRIED_SIGMA_MIN: Final = 0.1  # of one q: calm air makes no certainty of two
TRIED_REST_S: Final = 300.0
OPEN_REST_S: Final = 20.0  # where it did not tell, or the envelope held the brake meanwhile

NOTHING: Final = 0
ACTS: Final = 1
DOES_NOT: Final = 2


class EvenState(NamedTuple):
    """Brake and aileron together."""

    brake: float  # mean
    aileron: float  # mean, of its travel
    brake_2: float  # <b b>
    both: float  # <b a>
    aileron_2: float  # <a a>
    watched: float  # of the window, 0 … 1


class TrialState(NamedTuple):
    """What is tried, and what came of it."""

    pressed: float  # share of the time that the law asks for an end of the travel
    rest_s: float  # nothing is tried for as long
    on: bool  # it is tried now
    low: float  # brake of the inner half
    out: bool  # now is the outer half
    time_s: float  # into this half
    speed_sum_mps: float
    ticks: float  # in that sum
    inner_mps: float  # mean of the last inner half; NaN: none yet
    outer_mps: float  # the same, of the outer half
    trial_tries: float  # to and fro in this trial
    tries: float  # all that count
    q_sum: float
    q_2_sum: float
    found: int  # NOTHING, ACTS or DOES_NOT


NOT_WATCHED: Final = EvenState(
    brake=0.0, aileron=0.0, brake_2=0.0, both=0.0, aileron_2=0.0, watched=0.0
)
NOT_TRIED: Final = TrialState(
    pressed=0.0,
    rest_s=0.0,
    on=False,
    low=0.0,
    out=False,
    time_s=0.0,
    speed_sum_mps=0.0,
    ticks=0.0,
    inner_mps=float("nan"),
    outer_mps=float("nan"),
    trial_tries=0.0,
    tries=0.0,
    q_sum=0.0,
    q_2_sum=0.0,
    found=NOTHING,
)


def even_step(state: EvenState, brake: float, aileron: float, dt_s: float) -> EvenState:
    """One step, of the brake and of the aileron as they are commanded."""
    if not isfinite(brake + aileron) or not dt_s > 0.0:
        return state
    gain = dt_s / (WATCH_S + dt_s)
    watched = state.watched + (1.0 - state.watched) * gain
    weight = gain / watched  # 1 at first: the mean of what has come so far
    nearer = max(weight, dt_s / (MEAN_S + dt_s))
    mean_brake = state.brake + nearer * (brake - state.brake)
    mean_aileron = state.aileron + nearer * (aileron - state.aileron)
    b, a = brake - mean_brake, aileron - mean_aileron
    return EvenState(
        brake=mean_brake,
        aileron=mean_aileron,
        brake_2=state.brake_2 + weight * (b * b - state.brake_2),
        both=state.both + weight * (a * b - state.both),
        aileron_2=state.aileron_2 + weight * (a * a - state.aileron_2),
        watched=watched,
    )


def pulls(state: EvenState) -> bool:
    """Whether the brake pulls to one side."""
    samples = state.watched * WATCH_S / SAMPLE_S
    if samples < SAMPLES or not state.brake_2 > MOVED * MOVED:
        return False
    slope = state.both / state.brake_2
    left = max(0.0, state.aileron_2 - slope * state.both)
    variance = left / (state.brake_2 * samples)
    sigmas_2 = UNEVEN_SIGMAS * UNEVEN_SIGMAS
    return abs(slope) >= UNEVEN and slope * slope >= sigmas_2 * variance


def trial_step(
    state: TrialState,
    saturated: int,
    ended: float,
    held: bool,
    speed_mps: float,
    expected_mps: float,
    dt_s: float,
) -> TrialState:
    """One step.

    saturated: at which end of the brake's travel the law is, -1, 0 or +1; ended: its average;
    held: the brake did not go where it was wanted; speed_mps: along the line; expected_mps: by
    how much TRIED of the brake changes it.
    """
    if not state.on:
        pressed = state.pressed + (abs(saturated) - state.pressed) * dt_s / (PRESSED_S + dt_s)
        rest_s = max(0.0, state.rest_s - dt_s)
        if rest_s > 0.0 or pressed < PRESSED:
            found = state.found if rest_s > 0.0 else NOTHING
            return state._replace(pressed=pressed, rest_s=rest_s, found=found)
        # Inwards from the end at which it stands; in the middle, if it goes from one to the other.
        low = 0.5 - 0.5 * TRIED
        if ended > 0.5:
            low = 1.0 - TRIED
        elif ended < -0.5:
            low = 0.0
        return state._replace(pressed=0.0, rest_s=0.0, on=True, low=low, found=NOTHING)
    if held and state.time_s > PASSED_S:
        return _ended(state)
    time_s, total, ticks = state.time_s + dt_s, state.speed_sum_mps, state.ticks
    if time_s > PASSED_S:
        total, ticks = total + speed_mps, ticks + 1.0
    if time_s < HALF_S or ticks < 1.0:
        return state._replace(time_s=time_s, speed_sum_mps=total, ticks=ticks)
    mean_mps = total / ticks
    begun = state._replace(out=not state.out, time_s=0.0, speed_sum_mps=0.0, ticks=0.0)
    if state.out:
        return begun._replace(outer_mps=mean_mps)
    begun = begun._replace(inner_mps=mean_mps)
    if state.inner_mps != state.inner_mps:  # the first half
        return begun
    q = (0.5 * (state.inner_mps + mean_mps) - state.outer_mps) / expected_mps
    if not isfinite(q):
        return _ended(state)
    return _judged(
        begun._replace(
            trial_tries=state.trial_tries + 1.0,
            tries=state.tries + 1.0,
            q_sum=state.q_sum + q,
            q_2_sum=state.q_2_sum + q * q,
        )
    )


def _judged(state: TrialState) -> TrialState:
    """After one more to and fro."""
    if state.trial_tries < TRIED_FEWEST:
        return state
    mean = state.q_sum / state.tries
    variance = (state.q_2_sum - state.q_sum * mean) / (state.tries - 1.0)
    variance = max(TRIED_SIGMA_MIN * TRIED_SIGMA_MIN, variance) / state.tries
    apart = mean - TRIED_LEAST
    if apart * apart >= TRIED_SIGMAS * TRIED_SIGMAS * variance:
        if apart < 0.0:
            return NOT_TRIED._replace(found=DOES_NOT)
        return NOT_TRIED._replace(found=ACTS, rest_s=TRIED_REST_S)
    return _ended(state) if state.trial_tries >= TRIED_MOST else state


def _ended(state: TrialState) -> TrialState:
    """A trial that did not tell."""
    return NOT_TRIED._replace(
        rest_s=OPEN_REST_S,
        tries=0.5 * state.tries,
        q_sum=0.5 * state.q_sum,
        q_2_sum=0.5 * state.q_2_sum,
    )


def tried_brake(state: TrialState) -> float:
    """Where the brake is to be while it is tried."""
    return state.low + TRIED if state.out else state.low
