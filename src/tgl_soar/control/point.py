"""The point on the line in one tick: when the brake acts, and what is passed to the other axis."""

from __future__ import annotations

from math import cos, sin
from typing import Final

from tgl_soar.control.envelope import CLEAR_FACTOR, Limited, clearance, outside
from tgl_soar.control.laws import Laws
from tgl_soar.control.pitch_schedule import speed_within
from tgl_soar.control.point_hold import Around, BrakeEffect, BrakeState, brake_effect, brake_step
from tgl_soar.control.supervisor import CAPTURING, SOARING
from tgl_soar.estimation.aerodynamics import braked
from tgl_soar.estimation.health import BRAKE
from tgl_soar.estimation.wind import WindParams
from tgl_soar.types import SurfacesSample, VehicleState, isfinite

# A point that gives way stays so far inside the fence: the aircraft drifts about it by centimetres.
KEPT_INSIDE_M: Final = 0.25


def point_step(
    laws: Laws,
    state: BrakeState,
    limited: Limited,
    mode: int,
    eta_rad: float,
    vehicle: VehicleState,
    gain_speed_mps: float,
    inertial: bool,
    faults: int,
    dt_s: float,
) -> tuple[BrakeState, BrakeEffect]:
    """What the brake is to do, and what it changes as it was commanded last.

    limited: the last command; eta_rad: the line's inclination as it is flown; gain_speed_mps: the
    airspeed that gains are for; inertial: the motion is estimated with accelerations; faults: of
    the streams, as `estimation.health` names them.
    """
    airspeed_mps = speed_within(laws.schedule, gain_speed_mps)
    held = brake_step(
        laws.brake,
        laws.wind.aerodynamics,
        state,
        laws.target,
        eta_rad=eta_rad,
        vehicle=vehicle,
        airspeed_mps=airspeed_mps,
        around=Around(
            on_the_line=mode in (CAPTURING, SOARING),
            answers=faults & BRAKE == 0,
            blocked=limited.brake_blocked,
            room=limited.brake_max,
            brake=limited.command.brake,
            aileron=limited.command.aileron,
            inertial=inertial,
            up_free=_is_free(laws, state, eta_rad, KEPT_INSIDE_M),
            down_free=_is_free(laws, state, eta_rad, -KEPT_INSIDE_M),
        ),
        dt_s=dt_s,
    )
    steady = max(0.0, limited.command.brake - state.shake.shaken)
    return held, brake_effect(laws.brake, steady, airspeed_mps)


def _is_free(laws: Laws, state: BrakeState, eta_rad: float, further_m: float) -> bool:
    """Whether the point that is flown may go further along the line; false where there is none."""
    if not laws.brake.wanted:
        return False
    x, z = state.x_m + further_m * cos(eta_rad), state.z_m + further_m * sin(eta_rad)
    if outside(laws.fence, x, 0.0, z):
        return False
    return clearance(laws.ground, x, z) >= CLEAR_FACTOR * laws.envelope.clearance_min_m


def wind_with_brake(
    laws: Laws, limited: Limited, flying: bool, surfaces: SurfacesSample
) -> WindParams:
    """What the air is read with: the airframe with its brake as it is read back, else as it was
    commanded last."""
    if not laws.brake.available:
        return laws.wind
    out = limited.command.brake if flying else 0.0
    if isfinite(surfaces.brake):
        out = surfaces.brake
    return laws.wind._replace(aerodynamics=braked(laws.wind.aerodynamics, out))
