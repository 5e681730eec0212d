"""The gains of pitch as parameters: which they are, and on which aircraft they were found.

RHO_… and ELE_… hold for the aircraft, speed and lean that the anchors name; elsewhere the schedule
changes them (`pitch_schedule`).  With accelerometers and without are two sets.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees, pi, radians
from types import MappingProxyType
from typing import Final

from tgl_soar.config.parameters import ANCHORS, INDEX, PARAMETERS, ParameterSet, as_wire_value
from tgl_soar.control.laws import dynamics_of, laws_from
from tgl_soar.control.loop_margin import is_known
from tgl_soar.control.pitch_schedule import (
    SPEED_MIN_MPS,
    lean_of_glide,
    pitch_gains,
    soaring_gains,
)
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.geometry import SoaringFrame

INERTIAL: Final = "accelerometers"
PLAIN: Final = "fixes"
SETS: Final = (PLAIN, INERTIAL)
# Sought; an integral keeps its time to the gain beside it: it is for trim, not for gusts.
SOUGHT: Final = {
    PLAIN: ("RHO_P", "RHO_D", "RHO_D_FILT", "ELE_P", "ELE_D"),
    INERTIAL: ("RHO_P_IMU", "RHO_D_IMU", "RHO_DF_IMU", "ELE_P_IMU", "ELE_D_IMU"),
}
INTEGRALS: Final = {
    PLAIN: {"RHO_I": "RHO_P", "ELE_I": "ELE_P"},
    INERTIAL: {"RHO_I_IMU": "RHO_P_IMU", "ELE_I_IMU": "ELE_P_IMU"},
}
# What `tgl-soar tune` found for the shipped aircraft, and its file has.  The anchors' defaults are
# that aircraft's.
SHIPPED: Final[Mapping[str, float]] = MappingProxyType(
    {
        "RHO_P": 0.40,
        "RHO_I": 0.16,
        "RHO_D": 0.33,
        "RHO_D_FILT": 8.5,
        "ELE_P": 7.5,
        "ELE_I": 4.0,
        "ELE_D": 0.30,
        "ELE_D_FILT": 80.0,
        "RHO_P_IMU": 0.95,
        "RHO_I_IMU": 0.30,
        "RHO_D_IMU": 0.56,
        "RHO_DF_IMU": 20.0,
        "ELE_P_IMU": 11.0,
        "ELE_I_IMU": 6.0,
        "ELE_D_IMU": 0.70,
        "ELE_DSP_IMU": 0.0,
    }
)
ALIKE: Final = 0.05  # an aircraft whose figures differ by no more is the one they were found on
ROUNDS: Final = 20  # of anchoring: what is left then is the rounding of parameters
_HERE: Final = SoaringFrame(0.0, 0.0, 0.0, 0.0)


def are_for_another(values: ParameterSet) -> bool:
    """Whether nobody gave gains for this aircraft, and it is known well enough to seek them."""
    return nobody_gave(values) and not on_found_aircraft(values) and is_known(dynamics_of(values))


def nobody_gave(values: ParameterSet) -> bool:
    """Whether these are nobody's gains for this aircraft: the shipped one's, as a copied file has
    them, or what is declared, where a file has none; with its anchors."""
    shipped = {**SHIPPED, **{name: _DECLARED[name] for name in ANCHORS}}
    return has_none(values) or _has(values, shipped)


def has_none(values: ParameterSet) -> bool:
    """Whether no file has any gains."""
    return _has(values, _DECLARED)


def _has(values: ParameterSet, given: Mapping[str, float]) -> bool:
    return all(values[name] == as_wire_value(value) for name, value in given.items())


_DECLARED: Final = {name: PARAMETERS[INDEX[name]].default for name in (*SHIPPED, *ANCHORS)}


def on_found_aircraft(values: ParameterSet) -> bool:
    """Whether the aircraft is the one that its gains were found on, or nobody knows."""
    known = dynamics_of(values)
    if not (known.speed_mps >= SPEED_MIN_MPS and values["RHO_SPEED"] >= SPEED_MIN_MPS):
        return True
    faster = values["RHO_SPEED"] / known.speed_mps  # the period grows with V, effect with V²
    return all(
        abs(own - found) <= ALIKE * found
        for own, found in (
            (known.short_period_radps * faster, values["ELE_FREQ"]),
            (known.damping, values["ELE_DAMP"]),
            (known.effect_radps2 * faster * faster, values["ELE_EFFECT"]),
            (known.lag_s, values["ELE_LAG"]),
        )
    )


def anchored(values: ParameterSet, lean_deg: float) -> ParameterSet:
    """The same gains, written as found on this very airframe, at its reference speed and this lean.

    What is flown there stays as it is; what is flown elsewhere follows from there.
    Errors: ValueError where the airframe is not known well enough; `ParameterError`.
    """
    for name in ("DYN_SPEED", "DYN_FREQ", "DYN_DAMP", "DYN_EFFECT"):
        if not values[name] > 0.0:
            raise ValueError(
                f"{name} = {values[name]:g}: not known of this airframe, and must be above 0;"
                " complete its [model] or give it in [dynamics] (`tgl-soar identify`)"
            )
    schedule = laws_from(values, _HERE).schedule
    speed = max(SPEED_MIN_MPS, values["DYN_SPEED"])
    wanted = _flown(values, speed, lean_deg)
    anchors = (
        speed,
        lean_deg - degrees(lean_of_glide(schedule, speed)),
        values["DYN_FREQ"],
        values["DYN_DAMP"],
        values["DYN_EFFECT"],
        values["DYN_SERVO"] + values["CMD_DELAY"],
        min(values["DYN_LAG"], values["DYN_SERVO"]),
    )
    for name in (name for kind in SETS for name in SOUGHT[kind]):
        if not wanted.get(name, values[name]) > 0.0:
            raise ValueError(
                f"{name} = 0: gains are sought as factors of what is flown now, and of nothing"
                " there are none; give it a value above 0, or leave it out"
            )
    start = values.changed({**wanted, **dict(zip(ANCHORS, anchors, strict=True))})
    for _ in range(ROUNDS):  # what yields at this lean yields again
        flown = _flown(start, speed, lean_deg)
        start = start.changed(
            {
                name: min(PARAMETERS[INDEX[name]].maximum, start[name] * gain / flown[name])
                for name, gain in wanted.items()
                if flown[name] > 0.0
            }
        )
    return start


def _flown(values: ParameterSet, speed_mps: float, lean_deg: float) -> dict[str, float]:
    """The gains that are flown there, by the names of the parameters that give them."""
    laws = laws_from(values, _HERE)
    eta = eta_from_lean(radians(lean_deg))
    found: dict[str, float] = {}
    for weight, suffix, soaring, pitch in (
        (0.0, "", laws.soaring, laws.pitch),
        (1.0, "_IMU", laws.soaring_imu, laws.pitch_imu),
    ):
        outer = soaring_gains(soaring, laws.schedule, weight, speed_mps, eta).pid
        inner = pitch_gains(pitch, laws.schedule, speed_mps)
        for letter, out, within in (
            ("P", outer.kp, inner.kp),
            ("I", outer.ki, inner.ki),
            ("D", outer.kd, inner.kd),
        ):
            found[f"RHO_{letter}{suffix}"] = out
            found[f"ELE_{letter}{suffix}"] = within
        filtered = "RHO_DF_IMU" if weight else "RHO_D_FILT"
        found[filtered] = outer.rate_filter_radps / (2.0 * pi)
    return found


def with_gains(values: ParameterSet, kind: str, gains: Sequence[float]) -> ParameterSet:
    """Values with the sought gains of a set, in the order of `SOUGHT`; integrals go with them."""
    changed = dict(zip(SOUGHT[kind], gains, strict=True))
    for name, beside in INTEGRALS[kind].items():
        wanted = values[name] * changed[beside] / values[beside]
        changed[name] = min(PARAMETERS[INDEX[name]].maximum, wanted)
    return values.changed(changed)


def gains_of(values: ParameterSet, kind: str) -> list[float]:
    """The sought gains of a set, in the order of `SOUGHT`."""
    return [values[name] for name in SOUGHT[kind]]
