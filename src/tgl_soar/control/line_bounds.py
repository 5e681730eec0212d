"""Whether an aircraft can be held by a line: in the fence, off the ground, across the contour.

    fence     the line's point (TGL_X, TGL_Z) lies inside FENCE_X and FENCE_Z
    ground    it is CLEAR_MIN or more from the [ground] of the site
    point     where one is held (TGL_HOLD), the same is true of it: a brake takes the aircraft down
              to where the line alone would not settle
    margins   the loop has a margin on a line of this lean, and roll and heading do not swing, with
              what is known of airframe and link; where a firmware's loops fly, none is judged
    contour   the line crosses the site's zero excess updraft contour where excess updraft falls
              going up the line, inside the fence and clear of the ground: there the aircraft
              settles

A line needs no distance to the contour: it crosses it or it does not, and where the wind of the
day is another one than the contour was computed for, the contour moves along the line and the
crossing with it.  What the site does not give is not checked.

Pure: values in, words out.
"""

from __future__ import annotations

from math import cos, radians, sin
from typing import Final

from tgl_soar.config.lateral_dynamics import UNKNOWN, LateralDynamics
from tgl_soar.config.line_changes import Contour, PresetLine, Presets, crossings
from tgl_soar.config.parameters import INDEX, PARAMETERS, ParameterError, ParameterSet
from tgl_soar.control.envelope import (
    OUT_ABOVE,
    OUT_BELOW,
    OUT_DOWNSTREAM,
    OUT_UPSTREAM,
    clearance,
    outside,
)
from tgl_soar.control.laws import fence_of
from tgl_soar.control.loop_margin import FLOOR, RINGS, margin_fault, margin_warning
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.types import NO_GROUND, OURS, Ground

FENCE: Final = ("FENCE_X_MIN", "FENCE_X_MAX", "FENCE_Y_MAX", "FENCE_Z_MIN", "FENCE_Z_MAX")
_SIDES: Final = (
    (OUT_UPSTREAM, "FENCE_X_MIN"),
    (OUT_DOWNSTREAM, "FENCE_X_MAX"),
    (OUT_BELOW, "FENCE_Z_MIN"),
    (OUT_ABOVE, "FENCE_Z_MAX"),
)


class LineBounds:
    """What a site allows of a line."""

    def __init__(
        self,
        contour: Contour = (),
        ground: Ground = NO_GROUND,
        lateral: LateralDynamics = UNKNOWN,
        loops: int = OURS,
    ) -> None:
        """`lateral`: the airframe's.  `loops`: whose move the surfaces, as `types` numbers them."""
        self._contour = contour
        self._ground = ground
        self._lateral = lateral
        self._ours = loops == OURS

    def fault(self, values: ParameterSet) -> str:
        """Why an aircraft cannot be held by the line of these values; "" if it can."""
        x_m, z_m = values["TGL_X"], values["TGL_Z"]
        if words := self._place_fault(values, x_m, z_m):
            return f"the line's point is {words}"
        if words := self._held_fault(values):
            return f"the point that is held (TGL_ALONG) is {words}"
        if words := self._margin_fault(values, FLOOR):
            return words
        if not self._contour:
            return ""
        found = crossings(self._contour, x_m, z_m, values["TGL_LEAN"])
        if not found:
            return "the line does not cross the known contour: nowhere to settle"
        stable = [crossing for crossing in found if crossing.settles]
        if not stable:
            return "the line crosses the known contour only where excess updraft grows up the line"
        words = ""
        for crossing in stable:
            words = self._place_fault(values, crossing.x_m, crossing.z_m)
            if not words:
                return ""
        return f"where the line crosses the known contour is {words}"

    def ringing(self, values: ParameterSet) -> str:
        """Why the loop of these values would swing; "" if it has some margin."""
        return self._margin_fault(values, RINGS)

    def warning(self, values: ParameterSet) -> str:
        """What is to be said of margins that refuse nothing; "" where all is well."""
        if not self._ours:
            return "no margin is judged: the autopilot's own loops hold the attitude"
        return margin_warning(values, self._lateral)

    def preset_faults(self, values: ParameterSet, presets: Presets) -> list[str]:
        """What is wrong with the site's own lines, each with its name."""
        found = [(preset.name, self._preset_fault(values, preset)) for preset in presets]
        return [f"line {name}: {words}" for name, words in found if words]

    def _margin_fault(self, values: ParameterSet, floor: float) -> str:
        return margin_fault(values, floor, self._lateral) if self._ours else ""

    def _preset_fault(self, values: ParameterSet, preset: PresetLine) -> str:
        try:
            return self.fault(values.changed(preset.parameters()))
        except ParameterError as error:
            return str(error)

    def _held_fault(self, values: ParameterSet) -> str:
        if values["TGL_HOLD"] == 0.0:
            return ""
        eta, along_m = eta_from_lean(radians(values["TGL_LEAN"])), values["TGL_ALONG"]
        return self._place_fault(
            values, values["TGL_X"] + along_m * cos(eta), values["TGL_Z"] + along_m * sin(eta)
        )

    def _place_fault(self, values: ParameterSet, x_m: float, z_m: float) -> str:
        out = outside(fence_of(values), x_m, 0.0, z_m)
        for bit, name in _SIDES:
            if out & bit:
                return f"outside the fence ({name} is {values[name]:g} m)"
        clear_m = clearance(self._ground, x_m, z_m)
        if clear_m < values["CLEAR_MIN"]:
            return (
                f"{max(0.0, clear_m):.2f} m from the ground (CLEAR_MIN is"
                f" {values['CLEAR_MIN']:g} m)"
            )
        return ""


def open_sides(values: ParameterSet) -> str:
    """What is to be said of a fence that is not set; "" if every side is."""
    widest = [n for n in FENCE if values[n] == PARAMETERS[INDEX[n]].default]
    if not widest:
        return ""
    if len(widest) == len(FENCE):
        return "no fence: set FENCE_X_MIN and its like to where the pilot is to have the aircraft"
    return f"the fence is open: {', '.join(widest)} not set"
