"""Whether the module would take the lines of a flight: asked of its own checks, before it starts.

What the simulated operator would send is set on a copy of the files' values, parameter by parameter
and leg by leg, as a PARAM_SET is on board (`config.line_changes`, `control.line_bounds`).
"""

from __future__ import annotations

from typing import Final

import msgspec

from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_flight, preset_lines
from tgl_soar.config.line_changes import OVERRIDE, LineChanges
from tgl_soar.config.parameters import ParameterError, ParameterSet, as_wire_value
from tgl_soar.onboard.setup import bounds_from
from tgl_soar.sim.operator import PlannedLeg
from tgl_soar.sim.sitl import plan
from tgl_soar.sim.sitl_options import SitlOptions

STARTS: Final = ("SRCH_START", "SRV_START")  # what they do is not of the line that they begin on


def refused_line(options: SitlOptions) -> str:
    """The first line that the module would refuse, and why; "": it takes all of them.

    Errors: `ConfigError`, `SitlError`.
    """
    airframe, site, values = load_flight(options.airframe, options.site)
    legs = [leg for leg in plan(site, values, options) if not leg.searches]
    bounds = bounds_from(_flown(airframe, options), site)
    changes = LineChanges(
        preset_lines(site, values),
        bounds.fault,
        site.contour_for(airframe.airframe.name),
        bounds.ringing,
        bounds.warning,
    )
    for number, leg in enumerate(legs):
        # From where a search has taken the line nobody knows: then it is set as on the ground.
        flying = number > 0 and not options.search
        where = f"{options.site}: lines.{leg.name}"
        try:
            values = _set(changes, values, leg, flying=flying)
        except ParameterError as error:
            return f"{where}: {str(error).removesuffix(f'; {OVERRIDE}')}"
        if not flying and not _is_forced(options) and (fault := bounds.fault(values)):
            return f"{where}: {fault}"
    return ""


def _set(
    changes: LineChanges, values: ParameterSet, leg: PlannedLeg, *, flying: bool
) -> ParameterSet:
    """Errors: `ParameterError` where the module would refuse it."""
    for name, value in leg.parameters.items():
        if name not in STARTS and values[name] != as_wire_value(value):
            values = changes.set(values, name, value, flying=flying).values
    return values


def _is_forced(options: SitlOptions) -> bool:
    """Whether a line with a fault is to be engaged on all the same."""
    return dict(options.settings).get("OP_FORCE", 0.0) != 0.0


def _flown(airframe: Airframe, options: SitlOptions) -> Airframe:
    """As a real firmware flies it: where its loops hold the attitude no margin is judged."""
    if options.autopilot == "builtin":
        return airframe
    link = airframe.autopilot
    route = link.route if options.route is None else options.route
    flown = msgspec.structs.replace(link, firmware=options.autopilot, route=route)
    return msgspec.structs.replace(airframe, autopilot=flown)
