"""The escape condition, watched: how much height is left for the way home, and for how long.

What is left (`control.landing`) is averaged over AVERAGE_S, and how fast it goes over TREND_S.  Its
end counts once it has lasted for SHORT_S, where there was some for ARMED_S before: an aircraft that
was launched from below never had any.  The same watch tells lying on the ground from flying.

A wind that rises takes the landing place out of reach, and lifts: what ends the lift is a wind that
falls again, and brings the place back into reach.  Who waits for that counts what would be left in
the least wind in which this line has carried the aircraft, averaged over TREND_S: until the lift
fails the wind has fallen that far.  A wind that turns away from the slope and stays strong is what
this does not cover.
"""

from __future__ import annotations

from math import exp
from typing import Final, NamedTuple

from tgl_soar.control.landing import LandingParams, escape_height, flare_height
from tgl_soar.control.wind_triangle import slower, wind_speed
from tgl_soar.types import INFINITE, NAN, AirEstimate, VehicleState

AVERAGE_S: Final = 1.0  # of the height left
TREND_S: Final = 10.0  # of how fast it goes
ARMED_S: Final = 1.0  # so long must there be height left before its end breaks off
SHORT_S: Final = 0.5  # so long must it be gone
STILL_MPS: Final = 0.7  # over the ground, for STILL_S: it lies there
STILL_S: Final = 1.0
# Of height, at most: a wing's own and the estimate's error. Standing still is no ground where the
# wind is as fast as the aircraft, and the flare sinks slowly: from more it disengages in the air.
GROUND_M: Final = 0.3


class EscapeView(NamedTuple):
    """What the watch knows of the flight."""

    flying: bool  # in the air and in control
    goes_home: bool  # it is on its way there
    soars: bool  # a line that rests carries it
    same_line: bool  # it has not left that line, nor has the line moved
    place_known: bool


class EscapeState(NamedTuple):
    """The escape condition, watched."""

    left_m: float  # of height, averaged; NaN: not known
    rate_mps: float  # at which it changes, averaged
    counts_m: float  # left_m, or what is left once the wind has fallen
    wind_mps: float  # averaged over TREND_S, as it soared; NaN: not on this line, or not waiting
    carried_mps: float  # the least of that in which this line has carried it; inf: none
    since_s: float  # since when there is some left that counts, or none
    armed: bool  # there was some left in this flight
    still_s: float  # when the aircraft moved last, or was not on its way home yet


NO_ESCAPE: Final = EscapeState(
    left_m=NAN,
    rate_mps=0.0,
    counts_m=NAN,
    wind_mps=NAN,
    carried_mps=INFINITE,
    since_s=NAN,
    armed=False,
    still_s=NAN,
)


def escape_step(
    params: LandingParams,
    state: EscapeState,
    view: EscapeView,
    vehicle: VehicleState,
    air: AirEstimate,
    dt_s: float,
) -> EscapeState:
    """One tick of the watch.

    Without a position the height is not known: what the estimate coasts to must end no flight.
    """
    now = vehicle.time_s
    if not view.flying:
        return NO_ESCAPE
    speed2 = vehicle.velocity_x_mps * vehicle.velocity_x_mps
    speed2 += vehicle.velocity_y_mps * vehicle.velocity_y_mps
    speed2 += vehicle.climb_mps * vehicle.climb_mps
    still = view.goes_home and view.place_known and speed2 < STILL_MPS * STILL_MPS
    still_s = state.still_s if still and state.still_s <= now else now
    state = _carried_step(params.waits, state, view, air, dt_s)._replace(still_s=still_s)
    left = escape_height(params, vehicle, air) if view.place_known else NAN
    if left != left:
        return NO_ESCAPE._replace(
            still_s=still_s,
            armed=state.armed,
            wind_mps=state.wind_mps,
            carried_mps=state.carried_mps,
        )
    counts = left
    if state.carried_mps < wind_speed(air):  # false for NaN
        counts = escape_height(params, vehicle, slower(air, state.carried_mps))
    if state.left_m != state.left_m:
        return state._replace(left_m=left, counts_m=counts, since_s=now)
    blend = 1.0 - exp(-dt_s / AVERAGE_S)
    averaged = state.left_m + blend * (left - state.left_m)
    counted = state.counts_m + blend * (counts - state.counts_m)
    rate = state.rate_mps
    if dt_s > 0.0:
        slow = 1.0 - exp(-dt_s / TREND_S)
        rate += slow * ((averaged - state.left_m) / dt_s - rate)
    has = counted >= 0.0
    since_s = state.since_s if has == (state.counts_m >= 0.0) else now
    armed = state.armed or (has and now - since_s >= ARMED_S)
    return state._replace(
        left_m=averaged, rate_mps=rate, counts_m=counted, since_s=since_s, armed=armed
    )


def _carried_step(
    waits: bool, state: EscapeState, view: EscapeView, air: AirEstimate, dt_s: float
) -> EscapeState:
    """The least wind in which it has soared on this line; another line resets it, and a moment
    without position or wind does not."""
    wind = wind_speed(air) if view.soars and view.place_known else NAN
    if waits and wind != wind and view.same_line:
        return state
    if not waits or wind != wind:
        return state._replace(wind_mps=NAN, carried_mps=INFINITE)
    averaged = state.wind_mps
    if averaged == averaged:
        averaged += (1.0 - exp(-dt_s / TREND_S)) * (wind - averaged)
    else:
        averaged = wind
    return state._replace(wind_mps=averaged, carried_mps=min(state.carried_mps, averaged))


def is_short(state: EscapeState, now_s: float) -> bool:
    """Whether the last moment to break off has come."""
    is_gone = state.counts_m < 0.0  # false for NaN
    return state.armed and is_gone and now_s - state.since_s >= SHORT_S


def time_left(state: EscapeState) -> float:
    """Until the height is gone, as it goes now [s]; inf: it does not; NaN: not known."""
    if state.left_m != state.left_m:
        return NAN
    if state.left_m <= 0.0:
        return 0.0
    return state.left_m / -state.rate_mps if state.rate_mps < -1e-3 else INFINITE


def is_on_ground(
    params: LandingParams, state: EscapeState, vehicle: VehicleState, clearance_m: float
) -> bool:
    """Whether the aircraft lies on the ground: it was on its way home, does not move, and has no
    height; where its height is not known nobody can say."""
    low = flare_height(params, vehicle, clearance_m) <= GROUND_M  # false for NaN
    return low and vehicle.time_s - state.still_s >= STILL_S
