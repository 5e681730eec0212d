"""The survey: a slow slide of the line, there and back, by which the contour is drawn.

While the aircraft soars, the line moves across itself at a constant small speed v: downstream,
which over a slope is away from the ground, until a guard ends that way; back past where it began
to the other end; and home.  Every place is passed once each way.  With q the line's distance from
where it began, positive upstream, and s the aircraft's place up the line, the aircraft is at

    s(t) = f(q) - q' f'(q) / lambda + gusts          f: the contour, s = f(q)

late by its speed along the line over lambda, the rate at which it returns to its place.  The
second pass has the other sign of q', so the mean of both has no lag (`analysis.survey`).

A way ends, and the line turns, where the next piece of the way would lead

    the reach                farther from where it began than SRV_REACH
    the fence, the ground    nearer than room = max(CLEAR_MIN / 2, SIGMAS sigma), sigma of the
                             aircraft's drift along the line: the room that recovering needs, and
                             that gusts take
    too slow, too fast       the airspeed within SPEED_MARGIN_MPS of the polar's end or SPEED_MIN
    near the stall           within STALL_RAD of the largest angle of attack
    held weakly              v / lambda > CLEAR_MIN / 2: so far behind its place is no guarded slide
    no place likely          the forecast gives a place to settle one chance in two or less

Going back over what has been passed is not asked again.  Whatever does not belong to a slide,
climbing or sinking in the mean or leaving the line, sends it home at once, which is the place where
the aircraft was seen to soar; where that lasts for another ODD_S the line stops where it is, as the
line does when the operator withdraws it or the mode is another: nothing better is known there.

Pure: a look at the flight every `LOOK_S` goes in, where the line is to go comes out.  Its target is
never farther ahead than AHEAD_S, so that what ends the module's attention ends the slide.
"""

from __future__ import annotations

from collections.abc import Callable
from math import cos, sin, sqrt
from typing import Final, NamedTuple

from tgl_soar.control.envelope import MARGIN_FULL, Fence, clearance
from tgl_soar.control.forecast import Forecast
from tgl_soar.control.laws import Laws
from tgl_soar.control.target_line import LineTracking, TargetLine, e_rho
from tgl_soar.types import NAN, Ground, isfinite

LOOK_S: Final = 0.2  # between two looks: an eddy of 1.5 m passes in as long

# An aircraft that is late by 1 / lambda, half a second in the tunnel, has passed a few eddies then.
MEAN_S: Final = 3.0
TREND_S: Final = 10.0  # the contour's direction, and what of climb is no gust
# Three of the tunnel's 1 / lambda, and MEAN_S and more: what is read there is the place itself.
REST_S: Final = 5.0
# A target so far ahead keeps the line from braking (v² / 2a is 4 mm at 0.06 m/s and 0.5 m/s²), and
# is a quarter of a metre in the tunnel.
AHEAD_S: Final = 4.0
# Gusts carry it over k sigma lambda / 2 pi exp(-k² / 2) times a second: in the quarter of a minute
# near an end 2 times in a hundred for three sigma, 6 in ten thousand for four.
SIGMAS: Final = 4.0
SPEED_MARGIN_MPS: Final = 0.2  # gusts of 3 % leave 0.085 m/s in MEAN_S
STALL_RAD: Final = 0.5 * MARGIN_FULL  # as for the multisine: half of the elevator's travel is left
LIKELY: Final = 0.5
# Gusts of 3 % make it climb by 0.03 m/s in the mean of MEAN_S in the tunnel, over a hill by 0.09;
# over TREND_S by 0.01 and 0.04.
CLIMB_MPS: Final = 0.3
CLIMB_LONG_MPS: Final = 0.15
ODD_S: Final = 10.0
SLOPE_MAX: Final = 3.0  # of s over q: a contour within 18 deg of the line gives no more
ARRIVED_M: Final = 1e-4

# How it stands.  The first four are SRV_START.
IDLE: Final = 0
DOWNSTREAM: Final = 1  # the first way
UPSTREAM: Final = 2  # the second, past where it began
HOMEWARD: Final = 3  # to where it began
DONE: Final = 4  # it is there
STOPPED: Final = 5  # the line stays where it is
UNDER_WAY: Final = (DOWNSTREAM, UPSTREAM, HOMEWARD)

BEGINS: Final = "survey: downstream at"  # the words with which one begins

NO_REASON: Final = 0
AT_FENCE: Final = 1
AT_GROUND: Final = 2
SLOW: Final = 3
FAST: Final = 4
NEAR_STALL: Final = 5
WEAK: Final = 6
UNLIKELY: Final = 7
REFUSED: Final = 8
DRIFTS: Final = 9
OFF_LINE: Final = 10
NOT_HELD: Final = 11
REACHED: Final = 12
SURVEY_TEXTS: Final = (
    "",
    "the fence",
    "the ground",
    "too slow for the polar or SPEED_MIN",
    "too fast for the polar",
    "near the stall",
    "held too weakly on the line",
    "no place to settle is likely beyond",
    "the line is refused there",
    "it climbs or sinks",
    "too far from the line",
    "it does not soar any more",
    "as far as SRV_REACH",
)


class SurveyTask(NamedTuple):
    """What stays as it is."""

    fence: Fence
    ground: Ground
    clearance_min_m: float
    speed_mps: float  # of the line, across itself
    reach_m: float  # to either side of where it began
    slowest_mps: float
    fastest_mps: float
    off_max_m: float  # of e_rho


class SurveyLook(NamedTuple):
    """What the module knows at one instant."""

    time_s: float
    x_m: float
    z_m: float
    climb_mps: float
    airspeed_mps: float
    stall_rad: float  # margin of the angle of attack; inf: not known
    line: LineTracking  # that is flown
    forecast: Forecast
    held: bool  # the mode is one that flies the line


class SurveyMeans(NamedTuple):
    """Exponential means."""

    q_m: float  # of the line's way, over MEAN_S as those that follow
    s_m: float  # of the aircraft's place on it
    airspeed_mps: float
    stall_rad: float
    return_per_s: float  # lambda
    chance: float
    climb_mps: float
    q_long_m: float  # over TREND_S, as those that follow
    s_long_m: float
    climb_long_mps: float
    drift_m2: float  # variance of s about its mean
    slope: float  # of s over q, as it was last known


class SurveyState(NamedTuple):
    """What the survey remembers."""

    standing: int
    reason: int  # of the last turn, or of the end
    start: TargetLine
    target: TargetLine  # where the line is to go
    since_s: float  # when it began, or turned last
    time_s: float  # of the last look
    means: SurveyMeans
    odd_s: float  # for so long something has been odd


def survey_task(laws: Laws) -> SurveyTask:
    """What of the laws a survey needs."""
    polar, envelope = laws.wind.aerodynamics.polar, laws.envelope
    return SurveyTask(
        fence=laws.fence,
        ground=laws.ground,
        clearance_min_m=envelope.clearance_min_m,
        speed_mps=laws.line.speed_mps,
        reach_m=laws.survey_reach_m,
        slowest_mps=max(polar.speed_min_mps, envelope.speed_min_mps) + SPEED_MARGIN_MPS,
        fastest_mps=polar.speed_max_mps - SPEED_MARGIN_MPS,
        off_max_m=0.5 * laws.guards.e_rho_max_m,
    )


def survey_begun(look: SurveyLook) -> SurveyState:
    """At the beginning, at rest on a line."""
    line = look.line
    start = TargetLine(line.x_m, line.z_m, line.eta_rad)
    s_m = _along(start, look.x_m, look.z_m)
    means = SurveyMeans(
        q_m=0.0,
        s_m=s_m,
        airspeed_mps=look.airspeed_mps,
        stall_rad=_finite(look.stall_rad),
        return_per_s=_return_rate(look),
        chance=look.forecast.chance,
        climb_mps=0.0,
        q_long_m=0.0,
        s_long_m=s_m,
        climb_long_mps=0.0,
        drift_m2=0.0,
        slope=0.0,
    )
    return SurveyState(
        standing=DOWNSTREAM,
        reason=NO_REASON,
        start=start,
        target=start,
        since_s=look.time_s,
        time_s=look.time_s,
        means=means,
        odd_s=0.0,
    )


def survey_step(task: SurveyTask, state: SurveyState, look: SurveyLook) -> SurveyState:
    """One look.  Once ended it stays so."""
    if state.standing not in UNDER_WAY:
        return state
    known = look.x_m + look.z_m + look.climb_mps + look.line.x_m + look.line.z_m
    if not (look.held and isfinite(known)):
        if not isfinite(look.line.x_m + look.line.z_m):
            return _ended(state, STOPPED, NOT_HELD)
        return stopped(state, look.line, NOT_HELD)
    dt = max(0.0, min(1.0, look.time_s - state.time_s))
    state = state._replace(time_s=look.time_s, means=_averaged(state, look, dt))
    q_m = _way(state.start, look.line)
    odd = _odd(task, state.means, look)
    state = state._replace(odd_s=state.odd_s + dt if odd != NO_REASON else 0.0)
    if state.standing == HOMEWARD:
        if state.odd_s >= ODD_S:
            return stopped(state, look.line, odd)
        if abs(q_m) <= ARRIVED_M and not look.line.moving:
            return _ended(state, DONE, state.reason)
        if look.time_s - state.since_s < REST_S and not is_cut_short(state):
            return state
        return _ahead(task, state, q_m)
    if odd != NO_REASON:
        return _ahead(task, state._replace(standing=HOMEWARD, reason=odd, odd_s=0.0), q_m)
    if look.time_s - state.since_s < REST_S:
        return state
    if q_m * _sign(state.standing) >= 0.0:  # not back over what has been passed
        barred = _barred(task, state, q_m)
        if barred != NO_REASON:
            return _turned(state, look.line, barred)
    return _ahead(task, state, q_m)


def survey_moved(
    task: SurveyTask, state: SurveyState, look: SurveyLook, move: Callable[[TargetLine], bool]
) -> SurveyState:
    """One look, and the line moved as it says; move: puts the line there, and says whether it may
    be there."""
    after = survey_step(task, state, look)
    if after.standing not in UNDER_WAY or after.target == state.target or move(after.target):
        return after
    # A way home that may not be flown is no way out: it ends there.
    after = survey_refused(after if after.standing == HOMEWARD else state, look.line)
    if after.standing in UNDER_WAY:
        move(after.target)
    return after


def survey_refused(state: SurveyState, line: LineTracking) -> SurveyState:
    """The line that it wanted is none that may be flown: it turns; homeward, it stops."""
    if state.standing == HOMEWARD:
        return stopped(state, line, REFUSED)
    return _turned(state, line, REFUSED)


def stopped(state: SurveyState, line: LineTracking, reason: int) -> SurveyState:
    """It ends, and the line stays where it is."""
    here = TargetLine(line.x_m, line.z_m, state.start.eta_rad)
    return _ended(state._replace(target=here), STOPPED, reason)


def is_cut_short(state: SurveyState) -> bool:
    """Whether it goes home, or has ended, for what is no end of a way."""
    return state.reason in (DRIFTS, OFF_LINE, NOT_HELD)


def survey_place(state: SurveyState) -> tuple[float, float]:
    """x and z [m] of the place where the aircraft is, in the mean."""
    return _place(state.start, state.means.q_m, state.means.s_m)


def _ended(state: SurveyState, standing: int, reason: int) -> SurveyState:
    return state._replace(standing=standing, reason=reason)


def _turned(state: SurveyState, line: LineTracking, reason: int) -> SurveyState:
    """The line rests where it is, and then goes the other way."""
    return state._replace(
        standing=UPSTREAM if state.standing == DOWNSTREAM else HOMEWARD,
        reason=reason,
        target=TargetLine(line.x_m, line.z_m, state.start.eta_rad),
        since_s=state.time_s,
    )


def _averaged(state: SurveyState, look: SurveyLook, dt_s: float) -> SurveyMeans:
    """The means, a look later."""
    old, gain, long = state.means, dt_s / (MEAN_S + dt_s), dt_s / (TREND_S + dt_s)
    line_q, s = _way(state.start, look.line), _along(state.start, look.x_m, look.z_m)
    q_m = old.q_m + gain * (line_q - old.q_m)
    s_m = old.s_m + gain * (s - old.s_m)
    q_long = old.q_long_m + long * (line_q - old.q_long_m)
    s_long = old.s_long_m + long * (s - old.s_long_m)
    drift = s - s_m
    # Under way q_m is ahead of q_long by v (TREND_S - MEAN_S); about a turn, by nothing.
    moved, slope = q_m - q_long, old.slope
    if abs(moved) >= 0.5 * (TREND_S - MEAN_S) * abs(line_q - old.q_m) / MEAN_S > 0.0:
        slope = max(-SLOPE_MAX, min(SLOPE_MAX, (s_m - s_long) / moved))
    return SurveyMeans(
        q_m=q_m,
        s_m=s_m,
        airspeed_mps=_mean(old.airspeed_mps, look.airspeed_mps, gain),
        stall_rad=_mean(old.stall_rad, _finite(look.stall_rad), gain),
        return_per_s=_mean(old.return_per_s, _return_rate(look), gain),
        chance=_mean(old.chance, look.forecast.chance, gain),
        climb_mps=_mean(old.climb_mps, look.climb_mps, gain),
        q_long_m=q_long,
        s_long_m=s_long,
        climb_long_mps=_mean(old.climb_long_mps, look.climb_mps, long),
        drift_m2=_mean(old.drift_m2, drift * drift, long),
        slope=slope,
    )


def _mean(old: float, new: float, gain: float) -> float:
    """A mean, one value later; what is not a number now leaves it, or begins it."""
    if not isfinite(new):
        return old
    return old + gain * (new - old) if isfinite(old) else new


def _odd(task: SurveyTask, means: SurveyMeans, look: SurveyLook) -> int:
    """What does not belong to a slide."""
    if not abs(look.line.e_rho_m) <= task.off_max_m:
        return OFF_LINE
    if abs(means.climb_mps) > CLIMB_MPS or abs(means.climb_long_mps) > CLIMB_LONG_MPS:
        return DRIFTS
    return NO_REASON


def _barred(task: SurveyTask, state: SurveyState, q_m: float) -> int:
    """Why the line may go no farther on this way; NO_REASON where it may."""
    means, fence = state.means, task.fence
    ahead_m = q_m + _sign(state.standing) * AHEAD_S * task.speed_mps
    s_ahead = means.s_m + means.slope * (ahead_m - means.q_m)
    x, z = _place(state.start, ahead_m, s_ahead)
    if abs(ahead_m) > task.reach_m:
        return REACHED
    # A mean over MEAN_S follows a drift that lasts for 1 / lambda, and leaves so much less of it.
    slow = max(0.0, 1.0 / (means.return_per_s * MEAN_S)) if means.return_per_s > 0.0 else 0.0
    room = max(0.5 * task.clearance_min_m, SIGMAS * sqrt(means.drift_m2 * (1.0 + slow)))
    to_fence = min(x - fence.x_min_m, fence.x_max_m - x, z - fence.z_min_m, fence.z_max_m - z)
    if not to_fence >= room:
        return AT_FENCE
    if not clearance(task.ground, x, z) >= task.clearance_min_m + room:
        return AT_GROUND
    if means.airspeed_mps < task.slowest_mps:
        return SLOW
    if means.airspeed_mps > task.fastest_mps:
        return FAST
    if means.stall_rad < STALL_RAD:
        return NEAR_STALL
    if not task.speed_mps <= 0.5 * task.clearance_min_m * means.return_per_s:
        return WEAK
    return NO_REASON if means.chance > LIKELY else UNLIKELY


def _ahead(task: SurveyTask, state: SurveyState, q_m: float) -> SurveyState:
    """The target that keeps the line moving."""
    lead_m = AHEAD_S * task.speed_mps
    if state.standing == HOMEWARD:
        if abs(q_m) <= lead_m:
            return state._replace(target=state.start)
        sign = -1.0 if q_m > 0.0 else 1.0
    else:
        sign = _sign(state.standing)
    if sign * (_way_of(state.start, state.target) - q_m) >= 0.5 * lead_m:
        return state
    means, there = state.means, q_m + sign * lead_m
    x, z = _place(state.start, there, means.s_m + means.slope * (there - means.q_m))
    return state._replace(target=TargetLine(x, z, state.start.eta_rad))


def _sign(standing: int) -> float:
    return -1.0 if standing == DOWNSTREAM else 1.0


def _way(start: TargetLine, line: LineTracking) -> float:
    """q of the line that is flown."""
    return e_rho(start.x_m, start.z_m, start.eta_rad, line.x_m, line.z_m)


def _way_of(start: TargetLine, line: TargetLine) -> float:
    return e_rho(start.x_m, start.z_m, start.eta_rad, line.x_m, line.z_m)


def _along(start: TargetLine, x_m: float, z_m: float) -> float:
    """s of a place."""
    return (x_m - start.x_m) * cos(start.eta_rad) + (z_m - start.z_m) * sin(start.eta_rad)


def _place(start: TargetLine, q_m: float, s_m: float) -> tuple[float, float]:
    """x and z of q and s."""
    c, s = cos(start.eta_rad), sin(start.eta_rad)
    return start.x_m - q_m * s + s_m * c, start.z_m + q_m * c + s_m * s


def _return_rate(look: SurveyLook) -> float:
    """lambda, as the forecast reads it."""
    return -look.forecast.slope_per_s / sin(look.line.eta_rad)


def _finite(stall_rad: float) -> float:
    """A margin that is not known bars nothing."""
    return stall_rad if isfinite(stall_rad) else NAN
