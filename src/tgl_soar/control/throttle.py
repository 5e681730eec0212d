"""A propeller, in reserve: power only where the air does not carry, within a budget.

A line takes the aircraft to where updraft equals sink, and without such a place down.  Power adds
to the climb as lift does and leaves e_rho to the line: pushing along the nose with T the aircraft
of mass m gains

    p = T V / (m g),      T = η T_0 max(0, 1 − V / V_0)          η the throttle, 0 … 1

so E(s) of `forecast` becomes E(s) + p, and what is to be filled is the deficit of the vertical
speed.  With ż_r the climb that regains height,

    p = K (ż_r − ż) + ∫ K_i (ż_r − ż) dt          within 0 and what THR_MAX gives

p enters the motion along the line as the brake's sink does (`control.point_hold`): a first-order
lag of λ (1 + K), λ about 6 rad/s.  With K = 1 the loop's gain is 1 at rest and less above, so that
a motor's lag of 0.2 s more cannot make it swing.  Across the line the glide turns up by p / V: the
pitch that holds it is known beforehand and passed on, as the brake's is.

**Called** by what ends flights: no place to settle is foreseen and it sinks; the height for the way
home is gone, or will be within AHEAD_S, on that way or where the aircraft does not soar (who soars
needs none for it yet); or, for LOW_S, it sinks so that the least clearance is reached within
AHEAD_S.  Who soars is brought back to its place at the rate λ, so that a gust's sink goes on for no
more than (1 − e^(−λ AHEAD_S)) / λ.  It is closed HOLD_S after the last of them, fading, so that
gusts do not switch it; where it is uncertain (the place unknown, a mode that flies no line, tilted)
it is closed at once.

**Reported**: ∫ η dt, in seconds of full throttle.  It never exceeds the budget, and is reset where
the autopilot is disarmed, not with every engagement.  It is counted tick by tick: an autopilot that
goes on with the last command while the process stands still uses more than is reported.

Pure: numbers in, numbers out.
"""

from __future__ import annotations

from math import exp
from typing import Final, NamedTuple

from tgl_soar.control.envelope import limit_throttle
from tgl_soar.control.point_hold import FADE_PER_S
from tgl_soar.types import GRAVITY_MPS2, isfinite

CLIMB_MPS: Final = 0.3  # regained: a fifth of the sink of small gliders, seen through gusts of 3 %
GAIN: Final = 1.0
INTEGRAL_PER_S: Final = 1.0  # slower than λ (1 + K) and the motor together by far
HOLD_S: Final = 1.0  # two eddies of a metre and more
AHEAD_S: Final = 2.0  # of a second each to open the throttle and to turn the flight path
LOW_S: Final = 0.3  # of them: as for breaking off, an estimate's step is no sink
RETURNS_LEAST: Final = 1e-3  # of its way in AHEAD_S: less brings nothing back
WEAKEST_MPS: Final = 0.05  # of all of it: less is no power

# What calls it.
NOT_CALLED: Final = 0
NOWHERE: Final = 1
HOME: Final = 2
LOW: Final = 3
CALLED_TEXTS: Final = (
    "",
    "no place to settle",
    "height for the way home",
    "low and sinking",
)

# How it stands.
OFF: Final = 0  # no budget, or nothing to spend it on
CLOSED: Final = 1
OPEN: Final = 2
USED_UP: Final = 3


class ThrottleParams(NamedTuple):
    """The budget, and what is known of the propeller."""

    budget_s: float  # of full throttle; 0: none is used, or there is none
    most: float  # THR_MAX
    thrust_mps2: float  # T_0 / m
    speed_mps: float  # V_0
    lag_s: float  # of motor and blades


class ThrottleState(NamedTuple):
    """What the law remembers."""

    standing: int
    called: int  # by what; as long as it is open, what it was opened for
    fraction: float  # that is sent, 0 … 1
    turns: float  # what the propeller makes of it, by its lag
    push_mps2: float  # T / m, now
    climb_mps: float  # p, now
    pitch_rad: float  # by which the glide is turned up
    integral_mps: float
    quiet_s: float  # for how long nothing has called
    low_s: float  # for how long it has been low, less since
    used_s: float  # of full throttle, in this flight


class ThrottleView(NamedTuple):
    """What the law is given in a tick."""

    allowed: bool  # a mode that may use it, and nothing uncertain
    nowhere: bool  # no place to settle is foreseen, and it sinks
    home_m: float  # height left for the way home; NaN: not known, or not asked for
    home_s: float  # until it is gone; inf: it is not; NaN: not known
    room_m: float  # clearance less the least
    climb_mps: float
    airspeed_mps: float  # NaN: not known
    returns_per_s: float = 0.0  # λ, of one that soars; 0: nothing brings it back


class ThrottleReport(NamedTuple):
    """What is shown of it."""

    standing: int  # 0 off, 1 closed, 2 open, 3 the budget is used up
    called: int  # 0 by nothing, 1 no place to settle, 2 the way home, 3 low and sinking
    fraction: float  # that is sent, 0 … 1
    used_s: float  # of full throttle, in this flight
    climb_mps: float  # p, that the propeller gives


NO_THROTTLE: Final = ThrottleState(
    standing=OFF,
    called=NOT_CALLED,
    fraction=0.0,
    turns=0.0,
    push_mps2=0.0,
    climb_mps=0.0,
    pitch_rad=0.0,
    integral_mps=0.0,
    quiet_s=0.0,
    low_s=0.0,
    used_s=0.0,
)


def throttle_step(
    params: ThrottleParams, state: ThrottleState, view: ThrottleView, dt_s: float
) -> ThrottleState:
    """One tick in control."""
    left_s = params.budget_s - state.used_s
    full_mps = full_climb(params, view.airspeed_mps)
    if not (view.allowed and left_s > 0.0 and full_mps > WEAKEST_MPS and isfinite(view.climb_mps)):
        return closed(params, state, dt_s)
    sinks = view.climb_mps < 0.0 and view.room_m + sinks_on_s(view) * view.climb_mps < 0.0
    low_s = max(0.0, min(2.0 * LOW_S, state.low_s + (dt_s if sinks else -dt_s)))
    called = _called(view, low_s)
    quiet_s = 0.0 if called != NOT_CALLED else state.quiet_s + dt_s
    was_open = state.standing == OPEN and state.called != NOT_CALLED
    goes_on = called != NOT_CALLED or (was_open and quiet_s < HOLD_S)
    wanted, integral = state.fraction - FADE_PER_S * dt_s, 0.0
    if goes_on:
        most_mps, error = params.most * full_mps, CLIMB_MPS - view.climb_mps
        integral = state.integral_mps + INTEGRAL_PER_S * error * dt_s
        integral = max(0.0, min(most_mps, integral))
        wanted = (GAIN * error + integral) / full_mps
    fraction = limit_throttle(state.fraction, wanted, params.most, dt_s)
    if fraction * dt_s > left_s:
        fraction = left_s / dt_s
    turns = _turns(params, state.turns, fraction, dt_s)
    push = turns * _push_of_all(params, view.airspeed_mps)
    used_s = state.used_s + fraction * dt_s
    standing = OPEN if fraction > 0.0 or goes_on else CLOSED
    if not used_s < params.budget_s:
        used_s, standing = params.budget_s, USED_UP
    return ThrottleState(
        standing=standing,
        called=called if called != NOT_CALLED or not goes_on else state.called,
        fraction=fraction,
        turns=turns,
        push_mps2=push,
        climb_mps=push * view.airspeed_mps / GRAVITY_MPS2,
        pitch_rad=push / GRAVITY_MPS2,
        integral_mps=integral,
        quiet_s=quiet_s,
        low_s=low_s,
        used_s=used_s,
    )


def closed(params: ThrottleParams, state: ThrottleState, dt_s: float) -> ThrottleState:
    """Closed at once; what was used stays used, and the propeller runs down."""
    standing = OFF
    if params.budget_s > 0.0:
        standing = CLOSED if state.used_s < params.budget_s else USED_UP
    turns = _turns(params, state.turns, 0.0, dt_s)
    still = turns / state.turns if state.turns > 0.0 else 0.0
    return ThrottleState(
        standing=standing,
        called=NOT_CALLED,
        fraction=0.0,
        turns=turns,
        push_mps2=state.push_mps2 * still,
        climb_mps=state.climb_mps * still,
        pitch_rad=state.pitch_rad * still,
        integral_mps=0.0,
        quiet_s=0.0,
        low_s=0.0,
        used_s=state.used_s,
    )


def full_climb(params: ThrottleParams, airspeed_mps: float) -> float:
    """p [m/s] of a throttle that is all open, at an airspeed; 0 where that is not known."""
    if not isfinite(airspeed_mps):
        return 0.0
    return _push_of_all(params, airspeed_mps) * airspeed_mps / GRAVITY_MPS2


def can_hold(params: ThrottleParams, used_s: float, excess_mps: float, airspeed_mps: float) -> bool:
    """Whether what is left of the budget can carry an aircraft that sinks by so much, for AHEAD_S
    at least: a report that comes only when it is gone is too late."""
    wanted_mps, full_mps = CLIMB_MPS - excess_mps, full_climb(params, airspeed_mps)
    if not params.most * full_mps > wanted_mps:  # false for NaN, too
        return False
    return (params.budget_s - used_s) * full_mps > AHEAD_S * max(0.0, wanted_mps)


def sinks_on_s(view: ThrottleView) -> float:
    """For how long [s] it goes on sinking as it does now, of AHEAD_S."""
    back = AHEAD_S * view.returns_per_s
    return AHEAD_S * (1.0 - exp(-back)) / back if back > RETURNS_LEAST else AHEAD_S


def _called(view: ThrottleView, low_s: float) -> int:
    if view.nowhere:
        return NOWHERE
    if view.home_m <= 0.0 or view.home_s <= AHEAD_S:  # false for NaN
        return HOME
    return LOW if low_s >= LOW_S else NOT_CALLED


def _push_of_all(params: ThrottleParams, airspeed_mps: float) -> float:
    """T / m [m/s²] of a throttle that is all open."""
    if not params.speed_mps > 0.0:
        return 0.0
    return params.thrust_mps2 * min(1.0, max(0.0, 1.0 - airspeed_mps / params.speed_mps))


def _turns(params: ThrottleParams, turns: float, fraction: float, dt_s: float) -> float:
    """What the propeller turns at: a first-order lag, and nothing below a thousandth."""
    turns += (fraction - turns) * dt_s / max(dt_s, params.lag_s) if dt_s > 0.0 else 0.0
    return turns if turns > 1e-3 or fraction > 0.0 else 0.0


def throttle_report(state: ThrottleState) -> ThrottleReport:
    """What is shown of a tick."""
    return ThrottleReport(
        standing=state.standing,
        called=state.called,
        fraction=state.fraction,
        used_s=state.used_s,
        climb_mps=state.climb_mps,
    )
