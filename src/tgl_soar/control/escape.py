"""The escape condition, watched: how much height is left for the way home, and for how long.

What is left (`control.landing`) is averaged over AVERAGE_S, and how fast it goes over TREND_S.  Its
end counts once it has lasted for SHORT_S, where there was some for ARMED_S before: an aircraft that
was launched from below never had any.  The same watch tells lying on the ground from flying.
"""

from __future__ import annotations

from math import exp
from typing import Final, NamedTuple

from tgl_soar.control.landing import INFINITE, LandingParams, escape_height, flare_height
from tgl_soar.types import NAN, AirEstimate, VehicleState

AVERAGE_S: Final = 1.0  # of the height left
TREND_S: Final = 10.0  # of how fast it goes
ARMED_S: Final = 1.0  # so long must there be height left before its end breaks off
SHORT_S: Final = 0.5  # so long must it be gone
STILL_MPS: Final = 0.7  # over the ground, for STILL_S: it lies there
STILL_S: Final = 1.0
# Of height, at most: a wing's own and the estimate's error. Standing still is no ground where the
# wind is as fast as the aircraft, and the flare sinks slowly: from more it disengages in the air.
GROUND_M: Final = 0.3


class EscapeState(NamedTuple):
    """The escape condition, watched."""

    left_m: float  # of height, averaged; NaN: not known
    rate_mps: float  # at which it changes, averaged
    since_s: float  # since when there is some left, or none
    armed: bool  # there was some left in this flight
    still_s: float  # when the aircraft moved last, or was not on its way home yet


NO_ESCAPE: Final = EscapeState(left_m=NAN, rate_mps=0.0, since_s=NAN, armed=False, still_s=NAN)


def escape_step(
    params: LandingParams,
    state: EscapeState,
    flying: bool,
    goes_home: bool,
    position_ok: bool,
    vehicle: VehicleState,
    air: AirEstimate,
    dt_s: float,
) -> EscapeState:
    """One tick of the watch.  flying: in the air and in control; goes_home: it is on its way there.

    Without a position the height is not known: what the estimate coasts to must end no flight.
    """
    now = vehicle.time_s
    if not flying:
        return NO_ESCAPE
    speed2 = vehicle.velocity_x_mps * vehicle.velocity_x_mps
    speed2 += vehicle.velocity_y_mps * vehicle.velocity_y_mps
    speed2 += vehicle.climb_mps * vehicle.climb_mps
    still = goes_home and position_ok and speed2 < STILL_MPS * STILL_MPS
    still_s = state.still_s if still and state.still_s <= now else now
    left = escape_height(params, vehicle, air) if position_ok else NAN
    if left != left:
        return NO_ESCAPE._replace(still_s=still_s, armed=state.armed)
    if state.left_m != state.left_m:
        return EscapeState(
            left_m=left,
            rate_mps=0.0,
            since_s=now,
            armed=state.armed,
            still_s=still_s,
        )
    blend = 1.0 - exp(-dt_s / AVERAGE_S)
    averaged = state.left_m + blend * (left - state.left_m)
    rate = state.rate_mps
    if dt_s > 0.0:
        slow = 1.0 - exp(-dt_s / TREND_S)
        rate += slow * ((averaged - state.left_m) / dt_s - rate)
    has = averaged >= 0.0
    since_s = state.since_s if has == (state.left_m >= 0.0) else now
    armed = state.armed or (has and now - since_s >= ARMED_S)
    return EscapeState(
        left_m=averaged,
        rate_mps=rate,
        since_s=since_s,
        armed=armed,
        still_s=still_s,
    )


def is_short(state: EscapeState, now_s: float) -> bool:
    """Whether the last moment to break off has come."""
    return state.armed and state.left_m < 0.0 and now_s - state.since_s >= SHORT_S  # false for NaN


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
