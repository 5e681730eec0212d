"""How far it is to the stall, the ground and the fence, as far as it is known.

Without a pitot tube alpha and airspeed are worked out from wind, velocity and pitch.  They count
where the estimator is certain of them, as with accelerometers it is, and in flight: an aircraft
held in a hand feels the hand.
"""

from __future__ import annotations

from math import cos, hypot, sin
from typing import Final

from tgl_soar.control.envelope import (
    CUT_NOSE_DOWN,
    CUT_NOSE_UP,
    PITCH_PER_SPEED,
    Margins,
    clearance,
    outside,
    pitch_within,
    stall_margin,
)
from tgl_soar.control.laws import Laws
from tgl_soar.estimation.ground_range import GroundRange
from tgl_soar.estimation.health import AIRSPEED
from tgl_soar.types import NAN, AirEstimate, Health, Inputs, VehicleState, isfinite

# 2 degrees: the margin acts from 3 degrees before the limit on.
STALL_UNCERTAINTY_MAX_RAD: Final = 0.035


def margins_of(
    laws: Laws,
    inputs: Inputs,
    vehicle: VehicleState,
    health: Health,
    air: AirEstimate,
    shift: tuple[float, float, float],
    ground_range: GroundRange,
    flying: bool,
) -> Margins:
    """The margins of one tick.

    shift: what is taken off the source's position [m], soaring frame.  Nobody knows in which of the
    two frames the ground is right: the nearer one counts, and what is outside in either is outside.
    vehicle: by its position alone, to which a rangefinder's correction is added here.  Where that
    sees the ground nearer, that counts; ground of which the site knows nothing is as near as it
    sees it.
    A lost place that nobody can even estimate is not outside: its age ends the flight, with a
    reason of its own.
    """
    alpha, airspeed = NAN, NAN
    certain = flying and stall_uncertainty(air, vehicle.pitch_rad) <= STALL_UNCERTAINTY_MAX_RAD
    if air.measured or certain:
        alpha, airspeed = air.alpha_rad, air.airspeed_mps
    elif not health.faults & AIRSPEED:
        airspeed = inputs.airspeed.airspeed_mps
    x, y, z = vehicle.x_m, vehicle.y_m, vehicle.z_m + ground_range.correction_m
    dx, dy, dz = shift
    near, beyond = clearance(laws.ground, x, z), outside(laws.fence, x, y, z)
    if dx != 0.0 or dy != 0.0 or dz != 0.0:
        near = min(near, clearance(laws.ground, x + dx, z + dz))
        beyond |= outside(laws.fence, x + dx, y + dy, z + dz)
    bound = vehicle.z_m + ground_range.bound_m
    if isfinite(bound):
        near = min(near, clearance(laws.ground, x, bound) if laws.ground.points > 0 else bound)
    unknown = not health.position_ok and not isfinite(x + y + z)
    return Margins(
        stall_margin(laws.envelope, alpha, airspeed),
        near,
        0 if unknown else beyond,
    )


def stall_uncertainty(air: AirEstimate, pitch_rad: float) -> float:
    """Standard deviation [rad] of the margin to the stall, by that of wind and updraft.

    The flight path through the air climbs by gamma = pitch - alpha, wings level: across it the
    uncertainty turns alpha, along it it changes the airspeed, which counts as a pitch.  NaN: not
    known.
    """
    gamma = pitch_rad - air.alpha_rad
    c, s = cos(gamma), sin(gamma)
    across = hypot(c * air.updraft_sigma_mps, s * air.wind_sigma_mps) / air.airspeed_mps
    along = hypot(c * air.wind_sigma_mps, s * air.updraft_sigma_mps) * PITCH_PER_SPEED
    return max(across, along)


def pitch_kept(
    laws: Laws,
    margins: Margins,
    vehicle: VehicleState,
    wanted_rad: float,
    held_rad: float,
    behind_m: float,
) -> tuple[float, int]:
    """The pitch setpoint within the envelope, and what was cut.

    held_rad: what the line took; behind_m: of `envelope.pitch_within`.
    """
    setpoint = pitch_within(
        laws.envelope,
        wanted_rad,
        vehicle.pitch_rad,
        margins.stall_rad,
        vehicle.climb_mps,
        margins.clearance_m,
        held_rad,
        behind_m,
    )
    cut = 0
    if setpoint < wanted_rad:
        cut = CUT_NOSE_UP
    elif setpoint > wanted_rad:
        cut = CUT_NOSE_DOWN
    return setpoint, cut
