"""Gains of roll, heading and bank from the airframe file's own coefficients.

At the speed V of a glide a little faster than the slowest, Q = ½ ρ V²,

    L_δ = Q S b C_lδa / Ixx                aileron's effect [rad/s²]
    L_p = −Q S b² C_lp / (2 V Ixx)         roll damping [1/s], one over the roll mode's time
    N_δ, N_β, N_r                          likewise of the rudder, of sideslip, of the yaw rate
    L_β, L_r, N_p, N_δa                    likewise; the side force's over the mass
    T   = servo's lag and delay + LATENCY_S

**Roll.**  Aileron moves the bank by L_δ / (s (s + L_p)).  A derivative with k_d = k_p / L_p cancels
the roll mode and leaves ω / s, with ω = L_δ k_p / L_p; ω T = ROLL_PHASE_RAD is what the delays take
of its 90 degrees.  A roll gust p_g then banks the aircraft by p_g / ω.

    AIL_P = ω L_p / L_δ     AIL_D = ω / L_δ     AIL_I = AIL_P ω / 15

**Heading.**  The fin turns the nose into the relative wind with N_β; the rudder holds it to the
waypoint FIN_FRACTION as hard, so that a gust's sideslip finds both, and damps the sum to
YAW_DAMPING, as far as the delays leave YAW_PHASE_RAD.

    RUD_P = FIN_FRACTION C_nβ / C_nδr     RUD_D = (2 ζ √(N_β + N_δ RUD_P) − N_r) / N_δ

**Bank.**  The sideways speed follows its setpoint by g SIDE_P / s, six times slower than the bank
follows its own: SIDE_P = ω / 6g; the integral acts over SIDE_S.

No number here is tuned to a flight; the two phases are those of a phase margin of 60 degrees in
roll, and of a rate loop that is slower than the roll loop.
"""

from __future__ import annotations

from math import pi, sqrt
from typing import Final

from tgl_soar.config.airframe import Airframe
from tgl_soar.config.lateral_dynamics import UNKNOWN, LateralDynamics
from tgl_soar.config.parameters import INDEX, PARAMETERS

# From an attitude to the servo: the latest of the links that are flown; half of it is usual.
LATENCY_S: Final = 0.040
ROLL_PHASE_RAD: Final = pi / 6.0
YAW_PHASE_RAD: Final = 0.3
FIN_FRACTION: Final = 0.7
YAW_DAMPING: Final = 0.7
ROLL_OVER_SIDEWAYS: Final = 6.0
SIDE_S: Final = 8.0
SPEED_FACTOR: Final = 1.15  # of the polar's slowest
_NEEDED: Final = (
    *("gravity_mps2", "air_density_kgpm3", "servo_lag_radps", "servo_delay_s"),
    *("Cl_p", "Cl_aileron", "Cn_beta", "Cn_r", "Cn_rudder"),
)


def lateral_dynamics(airframe: Airframe) -> LateralDynamics:
    """At the speed that gains are found for; `UNKNOWN` where the file lacks what it needs."""
    model, bench = airframe.model, airframe.airframe
    if not all(name in model for name in _NEEDED):
        return UNKNOWN
    speed = SPEED_FACTOR * airframe.polar.speed_min_mps
    pressure = 0.5 * model["air_density_kgpm3"] * speed * speed
    span_force = pressure * bench.wing_area_m2 * bench.span_m
    half_turn_s = 0.5 * bench.span_m / speed
    roll, yaw = span_force / bench.ixx_kgm2, span_force / bench.izz_kgm2
    side, weight = pressure * bench.wing_area_m2, bench.mass_kg * model["gravity_mps2"]
    lift_slope = model.get("CL_alpha", 0.0)
    lifts = lift_slope > 0.0
    return LateralDynamics(
        speed_mps=speed,
        roll_effect_radps2=roll * model["Cl_aileron"],
        roll_damping_per_s=-roll * model["Cl_p"] * half_turn_s,
        yaw_effect_radps2=yaw * model["Cn_rudder"],
        yaw_damping_per_s=-yaw * model["Cn_r"] * half_turn_s,
        yaw_stiffness_per_s2=yaw * max(0.0, model["Cn_beta"]),
        lag_s=1.0 / model["servo_lag_radps"],
        roll_of_slip_per_s2=roll * model.get("Cl_beta", 0.0),
        roll_of_yaw_per_s=roll * model.get("Cl_r", 0.0) * half_turn_s,
        yaw_of_roll_per_s=yaw * model.get("Cn_p", 0.0) * half_turn_s,
        yaw_of_aileron_radps2=yaw * model.get("Cn_aileron", 0.0),
        side_of_slip_mps2=side * model.get("CY_beta", 0.0) / bench.mass_kg,
        side_of_rudder_mps2=side * model.get("CY_rudder", 0.0) / bench.mass_kg,
        lift_rad=weight / (side * lift_slope) if lifts else 0.0,
        rigging_rad=-model.get("CL0", 0.0) / lift_slope if lifts else 0.0,
    )


def lateral_gains(airframe: Airframe) -> dict[str, float]:
    """Parameters by name, each within its range; none where the file lacks what they need."""
    known, model = lateral_dynamics(airframe), airframe.model
    if known == UNKNOWN:
        return {}
    late_s = known.lag_s + model["servo_delay_s"] + LATENCY_S
    bandwidth = ROLL_PHASE_RAD / late_s
    ail_p = bandwidth * known.roll_damping_per_s / known.roll_effect_radps2

    rud_p = FIN_FRACTION * known.yaw_stiffness_per_s2 / known.yaw_effect_radps2
    turn = sqrt(known.yaw_stiffness_per_s2 + known.yaw_effect_radps2 * rud_p)
    damped = min(2.0 * YAW_DAMPING * turn - known.yaw_damping_per_s, YAW_PHASE_RAD / late_s)

    side_p = bandwidth / (ROLL_OVER_SIDEWAYS * model["gravity_mps2"])
    return _within_range(
        {
            "AIL_P": ail_p,
            "AIL_I": ail_p * bandwidth / 15.0,
            "AIL_D": bandwidth / known.roll_effect_radps2,
            "RUD_P": rud_p,
            "RUD_D": damped / known.yaw_effect_radps2,
            "SIDE_P": side_p,
            "SIDE_I": side_p / SIDE_S,
            "LAT_SPEED": known.speed_mps,
            "LAT_LATE": late_s,
        }
    )


def airframe_parameters(airframe: Airframe) -> dict[str, float]:
    """All that an airframe file gives, and what follows from it; `[parameters]` come first.

    Errors: ArithmeticError where a number is too small or too large to be computed with.
    """
    return {**lateral_gains(airframe), **airframe.all_parameters()}


def _within_range(values: dict[str, float]) -> dict[str, float]:
    allowed = {name: PARAMETERS[INDEX[name]] for name in values}
    return {
        name: min(allowed[name].maximum, max(allowed[name].minimum, value))
        for name, value in values.items()
    }
