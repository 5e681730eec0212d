"""Lift, drag and trim of the airframe, from the numbers of its file."""

from __future__ import annotations

from math import atan2, cos, exp, log1p, sin

from tgl_soar.types import NAN, Aerodynamics, isfinite, polar_sink


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
    """Pitch [rad] of the steady glide at a horizontal airspeed [m/s]; NaN outside the polar.

    The lift that carries the weight gives alpha, with the elevator that trims it; pitch is alpha
    less the glide angle.  The lift curve is taken as straight: near the stall it is too low.
    """
    sink = polar_sink(aero.polar, horizontal_mps)
    if not isfinite(sink):
        return NAN
    slope = atan2(sink, horizontal_mps)
    speed2 = horizontal_mps * horizontal_mps + sink * sink
    pressure_area = 0.5 * aero.air_density_kgpm3 * speed2 * aero.wing_area_m2
    cl = aero.mass_kg * aero.gravity_mps2 * cos(slope) / pressure_area
    trim = aero.CL_elevator / aero.Cm_elevator  # of the lift, for each unit of moment
    alpha = (cl - aero.CL0 + trim * aero.Cm0) / (aero.CL_alpha - trim * aero.Cm_alpha)
    return alpha - slope
