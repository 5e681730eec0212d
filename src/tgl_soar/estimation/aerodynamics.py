"""Lift, drag and trim of the airframe, from the numbers of its file."""

from __future__ import annotations

from math import atan2, cos, exp, log1p, sin, sqrt
from typing import Final

from tgl_soar.types import INFINITE, NAN, Aerodynamics, isfinite, polar_sink

# 8 degrees: three times the 0.02 rad that a trim is known to (the centre of gravity, as in
# `estimation.wind`), 0.04 for a moment's slope that is off by a fifth, and as much again to turn a
# nose around that falls.  Without that last part (0.09) one flight in a hundred more was lost.
HELD_BEYOND_RAD: Final = 0.14


def lift_drag(
    aero: Aerodynamics, alpha_rad: float, elevator: float
) -> tuple[float, float, float, float]:
    """(C_L, dC_L/dalpha, C_D, dC_D/dalpha) at an angle of attack [rad]."""
    width = aero.stall_width_rad
    beyond = min(30.0, (alpha_rad - aero.stall_alpha_rad) / width)
    odds = exp(beyond)
    stalled = width * log1p(odds)
    separated = odds / (1.0 + odds)
    cl = aero.CL0 + aero.CL_alpha * (alpha_rad - stalled) + aero.CL_elevator * elevator
    cl_alpha = aero.CL_alpha * (1.0 - separated)
    cd = aero.CD0 + aero.CD_lift * cl * cl + aero.CD_separated * sin(stalled)
    cd_alpha = 2.0 * aero.CD_lift * cl * cl_alpha + aero.CD_separated * separated * cos(stalled)
    return cl, cl_alpha, cd, cd_alpha


def trim_alpha(
    aero: Aerodynamics, elevator: float, pitch_rate_radps: float, airspeed_mps: float
) -> float:
    """Angle of attack [rad] at which the pitching moment vanishes."""
    damping = 0.5 * aero.Cm_q * aero.chord_m * pitch_rate_radps / airspeed_mps
    return -(aero.Cm0 + aero.Cm_elevator * elevator + damping) / aero.Cm_alpha


def elevator_room(aero: Aerodynamics, alpha_max_rad: float, trim: float) -> float:
    """How far above its trim the elevator holds HELD_BEYOND_RAD more than the largest angle of
    attack; inf: not known.

    By the moments of the file, or from the best glide's angle, which the trim is for: whichever is
    more.  Where one of them is wrong the aircraft can still fly as slowly as it ever could.
    """
    known = aero.Cm_alpha < 0.0 and aero.Cm_elevator > 0.0 and aero.CL_alpha > 0.0
    if not (known and aero.CD0 >= 0.0 and aero.CD_lift > 0.0):
        return INFINITE
    held = alpha_max_rad + HELD_BEYOND_RAD
    by_moments = -(aero.Cm0 + aero.Cm_alpha * held) / aero.Cm_elevator - trim
    best = (sqrt(aero.CD0 / aero.CD_lift) - aero.CL0) / aero.CL_alpha
    from_glide = -aero.Cm_alpha / aero.Cm_elevator * (held - min(best, alpha_max_rad))
    return max(by_moments, from_glide)


def elevator_of_rate(aero: Aerodynamics, airspeed_mps: float) -> float:
    """The elevator that keeps a nose turning, for each rad/s [s]; 0: not known."""
    if not (aero.Cm_elevator > 0.0 and airspeed_mps > 0.0 and aero.Cm_q <= 0.0):
        return 0.0
    return -0.5 * aero.Cm_q * aero.chord_m / (airspeed_mps * aero.Cm_elevator)


def braked(aero: Aerodynamics, brake: float) -> Aerodynamics:
    """The airframe as it is with its brake at a deflection, 0 … 1.

    Its polar is one of a family: the drag of the brake, at the lift that carries the weight, adds
    to the sink by the cube of the speed,

        S(u, b) = S(u) + b (rho S CD_brake / 2 m g) u³

    and so it stays a polynomial of third order.  To first order of sink / u.
    """
    if brake == 0.0:
        return aero
    return aero._replace(
        CL0=aero.CL0 + aero.CL_brake * brake,
        CD0=aero.CD0 + aero.CD_brake * brake,
        Cm0=aero.Cm0 + aero.Cm_brake * brake,
        polar=aero.polar._replace(c3=aero.polar.c3 + brake_sink(aero) * brake),
    )


def brake_sink(aero: Aerodynamics) -> float:
    """What all of the brake adds to the sink, of the speed's cube [s²/m²]: dS/db = that u³."""
    weight = aero.mass_kg * aero.gravity_mps2
    return 0.5 * aero.air_density_kgpm3 * aero.wing_area_m2 * aero.CD_brake / weight


def glide_pitch(aero: Aerodynamics, horizontal_mps: float) -> float:
    """Pitch [rad] of the steady glide at a horizontal airspeed [m/s]; NaN outside the polar: the
    angle of attack less the glide angle."""
    return glide_alpha(aero, horizontal_mps) - atan2(
        polar_sink(aero.polar, horizontal_mps), horizontal_mps
    )


def glide_alpha(aero: Aerodynamics, horizontal_mps: float) -> float:
    """Angle of attack [rad] of the steady glide at a horizontal airspeed [m/s]; NaN outside the
    polar.

    The lift that carries the weight gives it, with the elevator that trims it.  The lift curve is
    taken as straight: near the stall it is too low.
    """
    sink = polar_sink(aero.polar, horizontal_mps)
    if not isfinite(sink):
        return NAN
    slope = atan2(sink, horizontal_mps)
    speed2 = horizontal_mps * horizontal_mps + sink * sink
    pressure_area = 0.5 * aero.air_density_kgpm3 * speed2 * aero.wing_area_m2
    cl = aero.mass_kg * aero.gravity_mps2 * cos(slope) / pressure_area
    trim = aero.CL_elevator / aero.Cm_elevator  # of the lift, for each unit of moment
    return (cl - aero.CL0 + trim * aero.Cm0) / (aero.CL_alpha - trim * aero.Cm_alpha)


def stall_speed(aero: Aerodynamics) -> float:
    """The airspeed [m/s] of level flight at the stall, trimmed; NaN: not known."""
    trim = aero.CL_elevator / aero.Cm_elevator
    cl = aero.CL0 + aero.CL_alpha * aero.stall_alpha_rad
    cl -= trim * (aero.Cm0 + aero.Cm_alpha * aero.stall_alpha_rad)
    area = 0.5 * aero.air_density_kgpm3 * aero.wing_area_m2 * cl
    return sqrt(aero.mass_kg * aero.gravity_mps2 / area) if area > 0.0 else NAN
