"""Pitch attitudes and the slowest airspeed, from the airframe file's own glide.

A glide at the speed V, which is `TRIM_SPEED` of the best glide's V*, as `config.dynamics` has it:

    C_L = C_L* (V* / V)²      α = (C_L − C_L0) / C_Lα      tan γ = (C_D0 + C_DL C_L²) / C_L

    PITCH_TRIM = α − γ        PITCH_MIN, PITCH_MAX, REC_PITCH   so far from it
    PITCH_MIN  = FAST_ROOM_DEG below α − γ at the polar's fastest speed, where that is less
                 (no less than STEEPEST_DEG)
    SPEED_MIN  = SLOWEST of the polar's slowest speed

What the laws may command is counted from the pitch at which the aircraft glides by itself: a wing
with another camber or rigging flies everything at another pitch.  An airframe file that gives one
of the four pitches gives its own: none of them is derived then.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import atan2, degrees, sqrt
from typing import Final

from tgl_soar.config.parameters import INDEX, PARAMETERS

TRIM_SPEED: Final = 0.94  # where it soars: a little slower than the best glide
# Down to a steep way out of slow air, up to the stall's own limit; while recovering it gains speed.
FROM_TRIM_DEG: Final = {
    "PITCH_TRIM": 0.0,
    "PITCH_MIN": -10.5,
    "PITCH_MAX": 7.5,
    "REC_PITCH": -2.5,
}
# An aircraft that hovers in the fastest wind of its polar needs room below for gusts: the shipped
# one, which was flown there, has 4.9 degrees, that of `unseen` 3.5.
FAST_ROOM_DEG: Final = 3.5
STEEPEST_DEG: Final = -18.0  # on that account: TILT_MAX may be as little as 20
SLOWEST: Final = 0.79  # beyond the stall: less lift than 1 / 0.79² = 1.6 of the slowest glide's
_NEEDED: Final = ("CL0", "CL_alpha", "CD0", "CD_lift")


def pitch_limits(
    model: Mapping[str, float], given: Mapping[str, float], fastest: float
) -> dict[str, float]:
    """The four pitches [deg], within their ranges, to a tenth; nothing where `[model]` lacks lift
    or drag, or where the file gives one of them.

    fastest: of the polar, as a multiple of the best glide's speed.
    """
    if any(name in given for name in FROM_TRIM_DEG) or not all(key in model for key in _NEEDED):
        return {}
    if not (model["CD0"] > 0.0 and model["CD_lift"] > 0.0 and model["CL_alpha"] > 0.0):
        return {}
    trim = _glide_pitch_deg(model, TRIM_SPEED)
    found = {name: trim + shift for name, shift in FROM_TRIM_DEG.items()}
    fast = _glide_pitch_deg(model, max(TRIM_SPEED, fastest)) - FAST_ROOM_DEG
    found["PITCH_MIN"] = min(found["PITCH_MIN"], max(STEEPEST_DEG, fast))
    return {name: _allowed(name, pitch) for name, pitch in found.items()}


def _glide_pitch_deg(model: Mapping[str, float], speed: float) -> float:
    """α − γ at a multiple of the best glide's speed."""
    lift = sqrt(model["CD0"] / model["CD_lift"]) / speed**2
    alpha = (lift - model["CL0"]) / model["CL_alpha"]
    return degrees(alpha - atan2(model["CD0"] + model["CD_lift"] * lift * lift, lift))


def slowest_airspeed(polar_slowest_mps: float) -> dict[str, float]:
    """SPEED_MIN [m/s], to a tenth."""
    return {"SPEED_MIN": _allowed("SPEED_MIN", SLOWEST * polar_slowest_mps)}


def _allowed(name: str, value: float) -> float:
    allowed = PARAMETERS[INDEX[name]]
    return min(allowed.maximum, max(allowed.minimum, round(value, 1)))
