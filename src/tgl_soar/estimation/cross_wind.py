"""The wind's direction: what blows across the soaring frame, from how the aircraft drifts.

    W_y,m = v_y − (R (u, 0, w))_E        dW_y/dt = (W_y,m − W_y) / T
    ψ_w   = atan2(−W_y, W_x)             within ± VEER_MAX, no faster than VEER_RADPS

v_y      m/s  velocity over the ground, to the right of an aircraft that faces upwind
u, w     m/s  velocity through the air along the body's x and z axes (`estimation.wind`)
W_x, W_y m/s  wind along the soaring frame's x and y
ψ_w      rad  where the wind comes from: zero straight upwind, positive to the right

Sideslip is taken as none: rudder, fin and bank turn the nose into the air within a second, and over
T it averages out; a constant one of some degrees leaves as many in ψ_w, which the way to the middle
takes up.  The estimate starts at none when the module engages.

The estimate itself turns slowly; VEER_RADPS is for what would step, and the rudder with it: a
VEER_MAX that is lowered in flight, and a wind along the frame that is not known any more.
"""

from __future__ import annotations

from math import atan2, cos, sin
from typing import Final, NamedTuple

from tgl_soar.types import AirEstimate, VehicleState, isfinite

VEER_RADPS: Final = 0.5


class CrossWindParams(NamedTuple):
    """Parameters of the estimator."""

    veer_max_rad: float  # 0: the wind is taken to blow along the frame, and nothing is estimated
    time_s: float  # T


def cross_wind_step(
    params: CrossWindParams, before_mps: float, vehicle: VehicleState, air: AirEstimate, dt_s: float
) -> float:
    """W_y [m/s] after a tick; as before where air or motion are not known."""
    if params.veer_max_rad <= 0.0:
        return 0.0
    angles = vehicle.roll_rad + vehicle.pitch_rad + vehicle.heading_rad + air.alpha_rad
    if not isfinite(angles + vehicle.velocity_y_mps + air.airspeed_mps):
        return before_mps
    drifts = vehicle.velocity_y_mps - _east(vehicle, air)
    return before_mps + min(1.0, dt_s / params.time_s) * (drifts - before_mps)


def across_air(vehicle: VehicleState, cross_wind_mps: float) -> VehicleState:
    """The vehicle with its sideways velocity through the air in the place of that over ground."""
    if cross_wind_mps == 0.0:
        return vehicle
    return vehicle._replace(velocity_y_mps=vehicle.velocity_y_mps - cross_wind_mps)


def veer(params: CrossWindParams, cross_wind_mps: float, wind_mps: float) -> float:
    """ψ_w [rad]; zero where the wind along the frame is not known, or none."""
    if params.veer_max_rad <= 0.0 or not wind_mps > 0.0:
        return 0.0
    most = params.veer_max_rad
    return max(-most, min(most, atan2(-cross_wind_mps, wind_mps)))


def veer_step(before_rad: float, wanted_rad: float, dt_s: float) -> float:
    """ψ_w [rad] that is flown, on its way to the one of `veer`."""
    most = VEER_RADPS * dt_s
    return before_rad + max(-most, min(most, wanted_rad - before_rad))


def _east(vehicle: VehicleState, air: AirEstimate) -> float:
    """The velocity through the air to the right [m/s]."""
    roll, pitch, heading = vehicle.roll_rad, vehicle.pitch_rad, vehicle.heading_rad
    u = air.airspeed_mps * cos(air.alpha_rad)
    w = air.airspeed_mps * sin(air.alpha_rad)
    along = cos(pitch) * u + sin(pitch) * cos(roll) * w
    return sin(heading) * along - cos(heading) * sin(roll) * w
