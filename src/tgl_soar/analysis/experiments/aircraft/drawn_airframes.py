"""Airframes of any size: drawn by the textbook, from a span of 0.8 m to one of 3 m.

Mass, area and chord follow from span, wing loading and aspect ratio; radii of gyration, tail and
fin from the shipped airframe by similarity, each drawn apart from it:

    m = (W / S) S / g     S = b² / A     c = S / b     k_x, k_z ~ b     k_y ~ l_t, the tail's arm
    C_Lα = 6 / (1 + 6 / π A)             best glide's C_L* and ratio E drawn: C_D0 = C_L* / 2 E,
    C_DL = 1 / (2 E C_L*)                C_mq = −2 a_t V_H l_t / c,  C_mα = −(static margin) C_Lα
    C_mδ = τ a_t V_H                     a_t the tail's slope, V_H its volume, τ of a throw

A wing that would stall at its best glide is drawn again.  Nothing is fitted to what is flown.
"""

from __future__ import annotations

from math import pi
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import asdict, replace

from tgl_soar.config.airframe import Airframe, AirframeMetadata, Polar
from tgl_soar.config.dynamics import DENSITY_KGPM3
from tgl_soar.sim.aircraft import aircraft_model, glide_polar_fit
from tgl_soar.types import GRAVITY_MPS2

STALL_RESERVE_RAD: Final = 0.06  # of the best glide: 3.4 degrees, room to soar slower than that
FASTEST: Final = 1.3  # of the best glide: the polar's end


class AirframeRanges(NamedTuple):
    """Within which each is drawn, evenly."""

    span_m: tuple[float, float] = (0.8, 3.0)
    loading_npm2: tuple[float, float] = (20.0, 60.0)
    aspect: tuple[float, float] = (5.5, 11.0)
    link_s: tuple[float, float] = (0.005, 0.040)  # from a tick to the servo's input
    servo_s: tuple[float, float] = (0.015, 0.060)  # its time constant
    best_lift: tuple[float, float] = (0.62, 0.78)  # C_L of the best glide
    best_ratio: tuple[float, float] = (5.5, 9.0)
    camber: tuple[float, float] = (0.15, 0.35)  # C_L0
    stall_rad: tuple[float, float] = (0.17, 0.22)
    tail_arm: tuple[float, float] = (2.7, 3.6)  # in chords
    tail_volume: tuple[float, float] = (0.40, 0.60)
    static_margin: tuple[float, float] = (0.06, 0.16)
    elevator: tuple[float, float] = (0.16, 0.26)  # slope of the tail's lift, of a half-throw
    gyration: tuple[float, float] = (0.85, 1.15)  # radii, of what is usual
    lateral: tuple[float, float] = (0.8, 1.25)  # aileron, rudder, fin and dampings, each


class _Draw(NamedTuple):
    """One draw: the fields of `AirframeRanges`, in their order; `lateral` is drawn for each."""

    span_m: float
    loading_npm2: float
    aspect: float
    link_s: float
    servo_s: float
    best_lift: float
    best_ratio: float
    camber: float
    stall_rad: float
    tail_arm: float
    tail_volume: float
    static_margin: float
    elevator: float
    gyration: float
    lateral: float


class DrawnAirframe(NamedTuple):
    """What flies."""

    airframe: Airframe  # of its true figures
    link_s: float


# Of the shipped airframe: radii of gyration in roll and yaw by span, in pitch by the tail's arm.
_GYRATION_X, _GYRATION_Y, _GYRATION_Z = 0.124, 0.256, 0.166
_TAIL_SLOPE: Final = 3.5  # of a tail's lift, downwash taken off
_LATERAL: Final = ("Cl_beta", "Cl_p", "Cl_r", "Cl_aileron", "Cn_beta", "Cn_r", "Cn_rudder")


def drawn_airframe(usual: Airframe, seed: tuple[int, ...]) -> DrawnAirframe:
    """The airframe of a seed; `usual`: the shipped one, for what is drawn about it."""
    # (SEED, i) draws what (SEED, i, 0) does, with which `dispersed` begins an aircraft of its own:
    # other quantities in another experiment, which are not compared.
    generator = np.random.default_rng(seed)
    while True:
        draw = _Draw._make((float(generator.uniform(low, high)) for low, high in AirframeRanges()))
        sides = generator.uniform(*AirframeRanges().lateral, len(_LATERAL)).tolist()
        slope = 6.0 / (1.0 + 6.0 / (pi * draw.aspect))
        best_alpha = (draw.best_lift - draw.camber) / slope
        if best_alpha <= draw.stall_rad - STALL_RESERVE_RAD:
            return DrawnAirframe(_airframe(usual, draw, sides), draw.link_s)


def _airframe(usual: Airframe, draw: _Draw, sides: list[float]) -> Airframe:
    area = draw.span_m**2 / draw.aspect
    chord = area / draw.span_m
    mass = draw.loading_npm2 * area / GRAVITY_MPS2
    arm = draw.tail_arm * chord
    k = draw.gyration
    bench = AirframeMetadata(
        name=f"drawn, {draw.span_m:.2f} m, {draw.loading_npm2:.0f} N/m²",
        mass_kg=mass,
        wing_area_m2=area,
        span_m=draw.span_m,
        chord_m=chord,
        ixx_kgm2=mass * (k * _GYRATION_X * draw.span_m) ** 2,
        iyy_kgm2=mass * (k * _GYRATION_Y * arm) ** 2,
        izz_kgm2=mass * (k * _GYRATION_Z * draw.span_m) ** 2,
    )
    slope = 6.0 / (1.0 + 6.0 / (pi * draw.aspect))
    neutral = (1.05 * draw.best_lift - draw.camber) / slope  # angle of attack of a neutral elevator
    stiffness = -draw.static_margin * slope
    tail = _TAIL_SLOPE * draw.tail_volume
    effect = draw.elevator * tail
    model = {
        **usual.model,
        "gravity_mps2": GRAVITY_MPS2,
        "air_density_kgpm3": DENSITY_KGPM3,
        "CL0": draw.camber,
        "CL_alpha": slope,
        "CL_elevator": -effect / draw.tail_arm,
        "stall_alpha_rad": draw.stall_rad,
        "stall_alpha_negative_rad": -draw.stall_rad,
        "CD0": 0.5 * draw.best_lift / draw.best_ratio,
        "CD_lift": 0.5 / (draw.best_ratio * draw.best_lift),
        "Cm0": -stiffness * neutral,
        "Cm_alpha": stiffness,
        "Cm_q": -2.0 * tail * draw.tail_arm,
        "Cm_elevator": effect,
        "servo_lag_radps": 1.0 / draw.servo_s,
        "servo_delay_s": 0.0,
    }
    for name, factor in zip(_LATERAL, sides, strict=True):
        model[name] = usual.model[name] * factor
    lift = draw.best_lift
    best = (2.0 * draw.loading_npm2 / (DENSITY_KGPM3 * lift)) ** 0.5
    polar = glide_polar_fit(aircraft_model(asdict(bench), model), FASTEST * best).polar
    return replace(
        usual, airframe=bench, model=model, polar=Polar(**polar._asdict()), parameters={}
    )
