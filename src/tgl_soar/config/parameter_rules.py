"""What parameters mean together: which values contradict each other, and why.

Each value by itself is within its own range (`parameters.PARAMETERS`); here are the rules between
them.  A new one is a branch that names the parameters, the first of which is blamed if it was
changed, and the reason.  A reason without numbers is followed by the others' values.
"""

from __future__ import annotations

from typing import Final, Protocol

Contradiction = tuple[tuple[str, ...], str]  # whom to blame, and why
RECOVERY_MIN_S: Final = 0.3  # so long must trouble be over before recovering may end


class Values(Protocol):
    """All parameters by their names, as `parameters.ParameterSet`."""

    def __getitem__(self, name: str) -> float: ...


def contradiction(values: Values) -> Contradiction | None:
    """The first that is found; None where all agree."""
    for rule in (_of_line, _of_pitch, _of_recovery, _of_limits):
        found = rule(values)
        if found is not None:
            return found
    return None


def _of_line(values: Values) -> Contradiction | None:
    lean, lean_min, lean_max = values["TGL_LEAN"], values["TGL_LEAN_MIN"], values["TGL_LEAN_MAX"]
    if lean_min > lean_max:
        return ("TGL_LEAN_MIN", "TGL_LEAN_MAX"), "TGL_LEAN_MIN is above TGL_LEAN_MAX"
    if lean < lean_min:
        return ("TGL_LEAN", "TGL_LEAN_MIN"), (
            f"the line must lean upwind by {lean_min:g} deg or more (TGL_LEAN_MIN):"
            " one that leans less cannot be flown well"
        )
    if lean > lean_max:
        return ("TGL_LEAN", "TGL_LEAN_MAX"), (
            f"the line must lean by {lean_max:g} deg or less (TGL_LEAN_MAX):"
            " the nearer it is to the horizontal, the less e_rho says of the position"
        )
    return None


def _of_pitch(values: Values) -> Contradiction | None:
    pitch_min, pitch_trim, pitch_max = (values[f"PITCH_{n}"] for n in ("MIN", "TRIM", "MAX"))
    if not pitch_min < pitch_max:
        return ("PITCH_MIN", "PITCH_MAX"), "PITCH_MIN must be below PITCH_MAX"
    if not pitch_min <= pitch_trim <= pitch_max:
        return (
            ("PITCH_TRIM", "PITCH_MIN", "PITCH_MAX"),
            "PITCH_TRIM must lie between PITCH_MIN and PITCH_MAX",
        )
    return None


def _of_recovery(values: Values) -> Contradiction | None:
    """Two that leave no way to recover, or that a law's own limit would end.

    Recovering puts the nose down to REC_PITCH, within the limits of every pitch setpoint, until
    angle of attack, speed and height are safe again.  In a glide the flight path falls, so that
    the angle of attack is larger than the pitch: a pitch at or above ALPHA_MAX is a stall.
    """
    pitch_min, pitch_trim = values["PITCH_MIN"], values["PITCH_TRIM"]
    rec, alpha, tilt = values["REC_PITCH"], values["ALPHA_MAX"], values["TILT_MAX"]
    if rec < pitch_min:
        return ("REC_PITCH", "PITCH_MIN"), (
            f"REC_PITCH = {rec:g} deg is below PITCH_MIN = {pitch_min:g} deg:"
            " recovering could not put the nose down so far"
        )
    if rec > pitch_trim:
        return ("REC_PITCH", "PITCH_TRIM"), (
            f"REC_PITCH = {rec:g} deg is above PITCH_TRIM = {pitch_trim:g} deg:"
            " recovering would raise the nose; set REC_PITCH to the best glide's or lower"
        )
    if pitch_trim >= alpha:
        return ("PITCH_TRIM", "ALPHA_MAX"), (
            f"PITCH_TRIM = {pitch_trim:g} deg must be below ALPHA_MAX = {alpha:g} deg:"
            " on the line the angle of attack is larger than the pitch, and it would stall"
        )
    for name in ("PITCH_MIN", "PITCH_MAX", "BANK_MAX", "SIDE_BANK"):
        if abs(values[name]) >= tilt:
            return (name, "TILT_MAX"), (
                f"{name} = {values[name]:g} deg must be within TILT_MAX = {tilt:g} deg:"
                " flying it would end the flight as an upset"
            )
    if 0.0 < values["REC_TIME"] < RECOVERY_MIN_S:
        return ("REC_TIME",), (
            f"must be 0, to hand over at once, or {RECOVERY_MIN_S:g} s and more:"
            " so long must trouble be over before recovering ends"
        )
    if values["TGL_CAPTURE"] >= values["CAPTURE_MAX"]:
        return ("TGL_CAPTURE", "CAPTURE_MAX"), (
            f"TGL_CAPTURE = {values['TGL_CAPTURE']:g} m must be below CAPTURE_MAX ="
            f" {values['CAPTURE_MAX']:g} m, beyond which the flight ends"
        )
    return None


def _of_limits(values: Values) -> Contradiction | None:
    if values["OP_RC_OFF"] >= values["OP_RC_ON"]:
        return ("OP_RC_OFF", "OP_RC_ON"), "OP_RC_OFF must be below OP_RC_ON"
    if values["EST_DELAY"] >= values["AGE_POS_HOLD"]:
        return (
            ("EST_DELAY", "AGE_POS_HOLD"),
            "EST_DELAY must be below AGE_POS_HOLD, or every position is too old to fly with",
        )
    for low, high in (("FENCE_X_MIN", "FENCE_X_MAX"), ("FENCE_Z_MIN", "FENCE_Z_MAX")):
        if not values[low] < values[high]:
            return (low, high), f"{low} must be below {high}"
    for name in ("ELE_TRIM", "AIL_TRIM", "RUD_TRIM"):
        if abs(values[name]) > values["SURF_MAX"]:
            return (name, "SURF_MAX"), f"{name} must lie within SURF_MAX"
    if values["AGE_POS_HOLD"] > values["AGE_POS_MAX"]:
        return ("AGE_POS_HOLD", "AGE_POS_MAX"), "AGE_POS_HOLD is above AGE_POS_MAX"
    return None
