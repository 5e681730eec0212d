"""From the hand to the line: what a launch waits for, and when it is given up.

    held      in the hand: attitude is held, nothing is counted yet
    thrown    pitch for the launch, wings level, nose upwind, until there is speed
    gliding   on a line that starts at the aircraft with the aircraft's own speed across it, so that
              no law sees a step, and slides to the target; captured where it has come to rest there

The throw is seen by whichever of two comes first: the estimated velocity, and the push along the
body's x axis, which needs no position,

    push(t) = ∫ (f_x − g sin pitch) e^(−(t − t') / PUSH_S) dt'

in which a sample stands for the time since the one before it: in a silence nothing is pushed.
A shaken or carried aircraft is pushed forth and back; one that is released in its wind (a tunnel)
is pushed by nothing, and is seen by its velocity alone.  What is too high for a hand, or faster
than a walker, for EVIDENT_S is in none, however it got there.

A launch that cannot succeed is given up while there is height to land with: thrown too steeply, no
speed in time, sinking into the clearance, the line still far where that is near, or flown away
from: upstream of a slope the wind may be slower than the aircraft can fly, and nobody drifts back.
"""

from __future__ import annotations

from math import exp, hypot, sin
from typing import Final, NamedTuple

from tgl_soar.control.target_line import LineLimits
from tgl_soar.types import GRAVITY_MPS2, INFINITE, ImuSample, VehicleState

PUSH_S: Final = 0.5  # a throw takes 0.2 to 0.4 s; a stride, forth and back, about as long
# An older acceleration is none of now: four samples of the slowest stream that counts, and as long
# as a throw.
PUSH_AGE_S: Final = 0.2
SAMPLE_S: Final = 0.055  # of the slowest stream that counts: for no longer does a sample stand
SPEED_S: Final = 0.2  # so long must the speed last: a gust is no speed
FLIES_BY_MPS: Final = 1.0  # above SPEED_MIN: 0.05 rad of incidence, all of the elevator
# Without a pitot tube: the air that was read in a hand is wrong, and the wind's estimate follows
# within about so long.
UNKNOWN_SPEED_S: Final = 0.6
GAIN_S: Final = 3.0  # a dive of 10 degrees wins 1.7 m/s in each second
STEEP_RAD: Final = 0.6  # from the launch's pitch: 34 degrees; thrown so, half of the speed is lost
AVERAGE_S: Final = 1.0  # of the climb: a throw's own oscillation lasts as long
AHEAD_S: Final = 3.0  # to flare and land in: what is reached in it need not be given up
LAST_S: Final = 0.5  # of what it is given up for
# In no hand: a raised arm, on a rock, and the height's own error; or faster than somebody who walks
# uphill. The airspeed says nothing, for a hand holds it into any wind.
HAND_M: Final = 4.0
WALKER_MPS: Final = 2.5
EVIDENT_S: Final = 1.0  # so long must either last
HAND_FRACTION: Final = 0.5  # of the clearance in the hand: whoever stands on the slope is low
LONGEST_S: Final = 60.0  # of the way to the line

# How a launch stands.
IDLE: Final = 0
HELD: Final = 1
THROWN: Final = 2
GLIDING: Final = 3
REACHED: Final = 4
NO_THROW: Final = 5
STEEP: Final = 6
SLOW: Final = 7
LOW: Final = 8
FAR: Final = 9


class LaunchParams(NamedTuple):
    """Parameters of a launch."""

    wanted: bool
    throw_mps: float  # faster than that it has been thrown
    wait_s: float  # for the throw
    pitch_rad: float  # of the attitude that is held
    line: LineLimits  # of the line on the way


class LaunchState(NamedTuple):
    """How a launch stands, and what it has seen."""

    standing: int  # 0 none, 1 held, 2 thrown, 3 gliding, 4 line reached, 5 … why it was given up
    since_s: float  # when it began to stand so
    push_mps: float
    # held: when it may have been in a hand last; thrown: when there was no speed last; gliding:
    # when the line was in reach last.
    mark_s: float
    climb_mps: float  # averaged
    high_s: float  # when it was high enough last
    low_m: float  # the clearance below which it is too low
    imu_sequence: int  # of the newest sample, and its time
    imu_s: float


class LaunchView(NamedTuple):
    """What a launch looks at in a tick."""

    vehicle: VehicleState
    imu: ImuSample
    position_ok: bool
    airspeed_mps: float  # NaN: not known
    measured: bool  # it comes from a pitot tube
    speed_min_mps: float
    clearance_m: float
    clearance_min_m: float
    to_go_m: float  # across, from the line that is flown to the target
    off_m: float  # across, from the aircraft to the line that is flown
    off_max_m: float  # beyond that no line is captured
    line_rests: bool  # at the target


NO_LAUNCH: Final = LaunchState(
    standing=IDLE,
    since_s=0.0,
    push_mps=0.0,
    mark_s=0.0,
    climb_mps=0.0,
    high_s=0.0,
    low_m=0.0,
    imu_sequence=0,
    imu_s=0.0,
)


def launch_step(
    params: LaunchParams, state: LaunchState, launching: bool, view: LaunchView, dt_s: float
) -> LaunchState:
    """One tick.  launching: the mode."""
    now = view.vehicle.time_s
    if not launching:
        return NO_LAUNCH
    if state.standing == IDLE:
        before = NO_LAUNCH._replace(imu_sequence=view.imu.sequence, imu_s=view.imu.time_s)
        return _standing(before, HELD, now)
    if state.standing == HELD:
        return _held(params, state, view, dt_s)
    if state.standing != THROWN and state.standing != GLIDING:
        return state
    blend = dt_s / (AVERAGE_S + dt_s)
    climb = state.climb_mps + blend * (view.vehicle.climb_mps - state.climb_mps)
    high_s = state.high_s if view.clearance_m < state.low_m and climb < 0.0 else now
    state = state._replace(climb_mps=climb, high_s=high_s)
    if now - high_s >= LAST_S:
        return _standing(state, LOW, now)
    if state.standing == THROWN:
        return _thrown(state, view)
    return _gliding(params, state, view)


def _held(params: LaunchParams, state: LaunchState, view: LaunchView, dt_s: float) -> LaunchState:
    vehicle = view.vehicle
    now = vehicle.time_s
    push = state.push_mps * exp(-dt_s / PUSH_S) + _pushed_mps(state, view)
    low = min(view.clearance_min_m, HAND_FRACTION * view.clearance_m)
    state = state._replace(
        push_mps=push,
        high_s=now,
        low_m=low,
        imu_sequence=view.imu.sequence,
        imu_s=view.imu.time_s,
    )
    speed = _speed(vehicle) if view.position_ok else 0.0
    if not is_in_no_hand(vehicle, view.position_ok, view.clearance_m):
        state = state._replace(mark_s=now)
    evident = now - state.mark_s >= EVIDENT_S
    if push >= params.throw_mps or speed >= params.throw_mps or evident:
        if not abs(vehicle.pitch_rad - params.pitch_rad) <= STEEP_RAD:
            return _standing(state, STEEP, now)
        return _standing(state, THROWN, now)
    if now - state.since_s >= params.wait_s:
        return _standing(state, NO_THROW, now)
    return state


def _pushed_mps(state: LaunchState, view: LaunchView) -> float:
    """What a new sample adds to the push; 0 for none, and for one that is late or not finite."""
    imu, vehicle = view.imu, view.vehicle
    forward = imu.force_x_frd_mps2 - GRAVITY_MPS2 * sin(vehicle.pitch_rad)
    is_late = vehicle.time_s - imu.time_s > PUSH_AGE_S
    if imu.sequence == state.imu_sequence or is_late or not abs(forward) < INFINITE:
        return 0.0
    return forward * min(max(0.0, imu.time_s - state.imu_s), SAMPLE_S)


def _thrown(state: LaunchState, view: LaunchView) -> LaunchState:
    now, slow_s = view.vehicle.time_s, state.mark_s
    since_s = now - state.since_s
    is_known = view.measured or since_s >= UNKNOWN_SPEED_S
    if not is_known or view.airspeed_mps < view.speed_min_mps + FLIES_BY_MPS:  # false for NaN
        slow_s = now
    state = state._replace(mark_s=slow_s)
    if now - slow_s >= SPEED_S and view.position_ok:
        return _standing(state, GLIDING, now)
    return _standing(state, SLOW, now) if since_s >= GAIN_S else state


def _gliding(params: LaunchParams, state: LaunchState, view: LaunchView) -> LaunchState:
    now = view.vehicle.time_s
    if view.line_rests and view.position_ok:
        return _standing(state, REACHED, now)
    late_s = abs(view.to_go_m) / params.line.speed_mps
    ahead_m = view.clearance_m + AHEAD_S * state.climb_mps
    sinks = ahead_m < state.low_m and state.climb_mps < 0.0 and late_s > AHEAD_S
    if not sinks and abs(view.off_m) <= view.off_max_m:  # false for NaN
        state = state._replace(mark_s=now)
    if now - state.mark_s >= LAST_S or now - state.since_s >= LONGEST_S:
        return _standing(state, FAR, now)
    return state


def _standing(state: LaunchState, standing: int, now_s: float) -> LaunchState:
    return state._replace(standing=standing, since_s=now_s, mark_s=now_s)


def is_in_hand(state: LaunchState) -> bool:
    """Whether somebody holds the aircraft, as far as a launch knows."""
    return state.standing == HELD


def is_in_no_hand(vehicle: VehicleState, position_ok: bool, clearance_m: float) -> bool:
    """Whether the aircraft is evidently in the air.  clearance_m: inf where it is not known."""
    high = HAND_M < clearance_m < INFINITE
    return position_ok and (high or _speed(vehicle) > WALKER_MPS)


def _speed(vehicle: VehicleState) -> float:
    return hypot(hypot(vehicle.velocity_x_mps, vehicle.velocity_y_mps), vehicle.climb_mps)


def is_aloft(state: LaunchState) -> bool:
    """Whether it was thrown."""
    return state.standing >= THROWN and state.standing != NO_THROW


def starts_line(state: LaunchState, now_s: float) -> bool:
    """Whether the line to be flown starts in this tick."""
    return state.standing == GLIDING and state.since_s == now_s
