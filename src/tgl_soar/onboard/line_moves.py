"""A line that the module moves itself, taken as an operator's: in the parameters that all see."""

from __future__ import annotations

from math import degrees, pi

from tgl_soar.config.line_changes import ELSEWHERE, SIDES
from tgl_soar.config.parameters import (
    INDEX,
    PARAMETERS,
    ParameterError,
    ParameterSet,
    as_wire_value,
)
from tgl_soar.control.line_bounds import LineBounds
from tgl_soar.control.target_line import TargetLine
from tgl_soar.onboard.settings import FlightSettings


def lean_of(line: TargetLine) -> float:
    """TGL_LEAN of a line [deg]."""
    return as_wire_value(degrees(line.eta_rad - 0.5 * pi))


def line_parameters_of(line: TargetLine) -> dict[str, float]:
    """A line as parameters, which are 32-bit floats."""
    return {
        "TGL_X": as_wire_value(line.x_m),
        "TGL_Z": as_wire_value(line.z_m),
        "TGL_LEAN": lean_of(line),
    }


def moved(values: ParameterSet, bounds: LineBounds, line: TargetLine) -> ParameterSet | None:
    """The values with the line there; None where the bounds do not allow it.

    bounds: without a contour, which is of another day's wind.  TGL_STEP_MAX guards against slips
    of the hand and is not asked; the point that a brake holds rests meanwhile.
    """
    try:
        changed = values.changed(line_parameters_of(line), flying=True)
    except ParameterError:
        return None
    return None if bounds.fault(changed.changed({"TGL_HOLD": 0.0})) else changed


def is_moved(settings: FlightSettings, bounds: LineBounds, line: TargetLine) -> bool:
    """Put the line there if the bounds allow it, as `moved` asks them; whether they do."""
    if moved(settings.values, bounds, line) is None:
        return False
    for name, value in line_parameters_of(line).items():
        if settings.values[name] != value:
            settings.assign(name, value)
    for name, elsewhere in (("TGL_PRESET", 0.0), ("TGL_PLACE", ELSEWHERE)):
        if settings.values[name] != elsewhere:
            settings.assign(name, elsewhere)
    return True


def open_fence(settings: FlightSettings) -> str:
    """Why nothing may move the line by itself; "" where the fence has every side."""
    values = settings.values
    open_ = [name for name in SIDES if values[name] == PARAMETERS[INDEX[name]].default]
    return f"the fence is open: set {', '.join(open_)}" if open_ else ""
