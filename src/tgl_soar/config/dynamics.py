"""What the gains' schedule knows of an airframe: from its file, by the textbook.

`[dynamics]` of an airframe file gives what was measured (`tgl-soar identify`); what it leaves out
follows from `[airframe]` and `[model]`, the glide also from `[polar]`.  With Q = ½ ρ V² at the
reference speed V, which is that of the best glide unless the file names another:

    L' = Q S C_Lα / (m V)             M' = Q S c C_mα / I          D' = Q S c² C_mq / (2 V I)
    ω² = -M' - D' L'                  2 ζ ω = L' - D'              effect = Q S c C_mδ / I
    DYN_LIFT = Q S C_Lδ / m
    C_L* = sqrt(C_D0 / C_DL)          V* = sqrt(2 m g / (ρ S C_L*))     E = 1 / (2 sqrt(C_D0 C_DL))

Etkin and Reid, Dynamics of Flight, chapter 6.  What cannot be had is left out: the gains are then
taken to have been found on this very airframe.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite, sqrt
from typing import Annotated, Final

from msgspec import Meta

from tgl_soar.config.strict import Measured, Strict
from tgl_soar.types import GRAVITY_MPS2, GlidePolar

DENSITY_KGPM3: Final = 1.225  # of the air at the sea, where a file says nothing else
LIFT_MAX_MPS2: Final = 200.0  # of a full elevator
Lift = Annotated[float, Meta(ge=-LIFT_MAX_MPS2, le=LIFT_MAX_MPS2)]
USUAL_LAG_S: Final = 0.0185  # of a digital servo of this size, by 54 rad/s
# From a sensor to the servo's input [s] by firmware and route, where nobody has measured it: the
# medians of docs/autopilots.md.  ArduPlane takes overrides up 50 times a second, attitudes at once.
USUAL_DELAY_S: Final[Mapping[tuple[str, str | None], float]] = {
    ("ardupilot", None): 0.0245,
    ("ardupilot", "override"): 0.0245,
    ("ardupilot", "attitude"): 0.0145,
}
# Of [model]: without all of these its short period is not known.
SHORT_PERIOD_KEYS: Final = ("CL_alpha", "Cm_alpha", "Cm_q", "Cm_elevator")
_KEYS: Final = {
    "speed_mps": "DYN_SPEED",
    "short_period_radps": "DYN_FREQ",
    "damping": "DYN_DAMP",
    "elevator_effect_radps2": "DYN_EFFECT",
    "elevator_lift_mps2": "DYN_LIFT",
    "servo_s": "DYN_SERVO",
    "servo_lag_s": "DYN_LAG",
    "path_s": "DYN_PATH",
    "glide_ratio": "DYN_GLIDE",
    "best_glide_mps": "DYN_BEST",
    "command_delay_s": "CMD_DELAY",
}


class MeasuredDynamics(Strict, frozen=True):
    """`[dynamics]` of an airframe file; None: as the model has it."""

    speed_mps: Measured | None = None  # at which the next five hold
    short_period_radps: Measured | None = None
    damping: Measured | None = None
    elevator_effect_radps2: Measured | None = None  # of a full deflection
    elevator_lift_mps2: Lift | None = None  # of one, too; of a tail below 0
    path_s: Measured | None = None
    servo_s: Measured | None = None  # lag and delay together
    servo_lag_s: Measured | None = None  # of that, the time constant
    glide_ratio: Measured | None = None
    best_glide_mps: Measured | None = None
    command_delay_s: Measured | None = None

    def keys(self) -> dict[str, str]:
        """Of the parameters that are given, the key."""
        return {name: key for key, name in _KEYS.items() if getattr(self, key) is not None}


def dynamics_parameters(
    given: MeasuredDynamics,
    bench: Mapping[str, float],
    model: Mapping[str, float],
    polar: GlidePolar,
    route: tuple[str, str | None],
) -> dict[str, float]:
    """The parameters DYN_… and CMD_DELAY.  `bench`: of `[airframe]`; `route`: a firmware, and its
    route where one is named."""
    found: dict[str, float] = {}
    if route in USUAL_DELAY_S:
        found["CMD_DELAY"] = USUAL_DELAY_S[route]
    if lag := model.get("servo_lag_radps", 0.0):
        found["DYN_LAG"] = 1.0 / lag
        found["DYN_SERVO"] = found["DYN_LAG"] + model.get("servo_delay_s", 0.0)
    elif given.servo_s is not None:
        # They have not been told apart.  A lag counts less than a delay, so that no more of it is
        # taken for one than usual servos have.
        found["DYN_LAG"] = min(given.servo_s, USUAL_LAG_S)
    found.update(_glide(bench, model, polar))
    speed = given.speed_mps or found["DYN_BEST"]
    found["DYN_SPEED"] = speed
    found.update(_short_period(bench, model, speed))
    for key, name in _KEYS.items():
        if (value := getattr(given, key)) is not None:
            found[name] = value
    return {name: value for name, value in found.items() if isfinite(value)}


def _glide(
    bench: Mapping[str, float], model: Mapping[str, float], polar: GlidePolar
) -> dict[str, float]:
    drag, induced = model.get("CD0", 0.0), model.get("CD_lift", 0.0)
    density = model.get("air_density_kgpm3", DENSITY_KGPM3)
    if drag > 0.0 and induced > 0.0:
        lift = sqrt(drag / induced)
        weight = bench["mass_kg"] * model.get("gravity_mps2", GRAVITY_MPS2)
        best = sqrt(2.0 * weight / (density * bench["wing_area_m2"] * lift))
        return {"DYN_BEST": best, "DYN_GLIDE": 0.5 / sqrt(drag * induced)}
    slowest, fastest = polar.speed_min_mps, polar.speed_max_mps
    speeds = [slowest + (fastest - slowest) * i / 100.0 for i in range(101)]
    ratio, best = max((u / _sink(polar, u), u) for u in speeds)
    return {"DYN_BEST": best, "DYN_GLIDE": ratio}


def _sink(polar: GlidePolar, u: float) -> float:
    return max(1e-3, polar.c0 + u * (polar.c1 + u * (polar.c2 + u * polar.c3)))


def _short_period(
    bench: Mapping[str, float], model: Mapping[str, float], speed_mps: float
) -> dict[str, float]:
    if not all(key in model for key in SHORT_PERIOD_KEYS):
        return {}
    pressure = 0.5 * model.get("air_density_kgpm3", DENSITY_KGPM3) * speed_mps * speed_mps
    force = pressure * bench["wing_area_m2"]
    chord = bench["chord_m"]
    turning = force * chord / bench["iyy_kgm2"]
    lift = force * model["CL_alpha"] / (bench["mass_kg"] * speed_mps)
    stiff = turning * model["Cm_alpha"]
    damped = turning * model["Cm_q"] * chord / (2.0 * speed_mps)
    square = -stiff - damped * lift
    found = {"DYN_EFFECT": turning * model["Cm_elevator"], "DYN_PATH": 1.0 / lift}
    lift_mps2 = force * model.get("CL_elevator", 0.0) / bench["mass_kg"]
    if abs(lift_mps2) <= LIFT_MAX_MPS2:  # no elevator lifts so much
        found["DYN_LIFT"] = lift_mps2
    if square > 0.0 and lift > damped:
        found["DYN_FREQ"] = sqrt(square)
        found["DYN_DAMP"] = (lift - damped) / (2.0 * sqrt(square))
    return found
