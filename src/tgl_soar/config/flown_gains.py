"""Which gains of pitch a flight begins with, and whose they are.

    the files give some, other than the shipped ones    as the files give them
    the firmware's own loops hold the attitude          the shipped ones
    too little is known of the aircraft                 the shipped ones
    it is the aircraft that those were found on         the shipped ones
    any other aircraft                                  sought for it (`control.pitch_design`);
                                                        the shipped ones, if none has the margins

The shipped ones in a file, all of them as they are, count as none given: a copied file has them.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from typing import Final

from tgl_soar.config.airframe import Airframe, AutopilotLink
from tgl_soar.config.dynamics import SHORT_PERIOD_KEYS
from tgl_soar.config.parameter_store import has_own_anchors
from tgl_soar.config.parameters import ANCHORS, ParameterSet
from tgl_soar.config.site import Site

FOUND_ON: Final = "Eclipson Model C"  # the aircraft of the shipped gains


def with_own_gains(values: ParameterSet, autopilot: AutopilotLink) -> ParameterSet:
    """With gains of pitch, where no file has any of its own: sought for this very airframe, in
    some seconds, or else the shipped ones, which the schedule carries there.

    A firmware's own loops are too slow for gains that are sought for ours.
    """
    # The laws are imported here, so that what only reads files does without them.
    from tgl_soar.control.found_gains import SHIPPED, are_for_another, has_none

    if has_none(values):
        values = values.changed(SHIPPED)
    if autopilot.holds_attitude or not are_for_another(values):
        return values
    return values.changed(_sought(values))


def _sought(values: ParameterSet) -> dict[str, float]:
    """By another process unless this one has numpy: one that flies locks its memory, and would keep
    300 MB of libraries for good."""
    if "numpy" not in sys.modules:
        asked = {p.name: value for p, value in values}
        with suppress(OSError, ValueError, subprocess.SubprocessError):
            ran = subprocess.run(
                [sys.executable, "-P", "-c", _SEEKS, json.dumps([sys.path, asked])],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                check=True,
                timeout=SEEKS_S,
            )
            return {name: float(value) for name, value in json.loads(ran.stdout).items()}
    from tgl_soar.control.pitch_design import own_gains

    return own_gains(values)


SEEKS_S: Final = 120.0  # some 2 s on a desktop computer
_SEEKS: Final = """\
import json, sys
sys.path[:], values = json.loads(sys.argv[1])
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.pitch_design import own_gains
print(json.dumps(own_gains(ParameterSet().changed(values))))
"""


def gains_words(airframe: Airframe, site: Site, values: ParameterSet) -> str:
    """Whose gains of pitch a flight begins with, in words; "": those that its files give, for the
    aircraft that they were found on."""
    from tgl_soar.control.found_gains import SHIPPED, are_for_another, nobody_gave
    from tgl_soar.control.found_gains import on_found_aircraft as is_found_one

    given = {**airframe.parameters, **site.parameters}
    own = {name: given[name] for name in (*SHIPPED, *ANCHORS) if name in given}
    unknown = _unknown(airframe, values)
    if not nobody_gave(ParameterSet().changed(own)):
        changed = [name for name in own if SHIPPED.get(name) != own[name]] or [*own]
        lacking = _lacking(own, values)
        if is_found_one(values) and not unknown and not lacking:
            return ""
        names = _shortened(changed)
        return f"gains of pitch: as the files give them ({names}); none are sought{lacking}"
    if are_for_another(values):
        reason = "the autopilot holds the attitude" if airframe.autopilot.holds_attitude else ""
        return (
            "gains of pitch: the shipped ones, as the schedule carries them to this aircraft:"
            f" {reason or 'none have the margins that are asked for'}"
        )
    if has_own_anchors(values):
        return "gains of pitch: sought for this aircraft"
    if unknown:
        return f"gains of pitch: those of the {FOUND_ON}: {unknown} (`tgl-soar docs files`)"
    return "" if own else f"gains of pitch: those of the {FOUND_ON}, which this aircraft is like"


def _shortened(names: list[str]) -> str:
    return ", ".join(names[:3]) + (" and others" if len(names) > 3 else "")


def _lacking(own: Mapping[str, float], values: ParameterSet) -> str:
    """Of gains that are given, which are missing; "": none.

    Those with accelerometers may all be left out, for the others are flown in their place then; and
    the setpoint's part is none where it is not given.
    """
    from tgl_soar.control.found_gains import INERTIAL, INTEGRALS, PLAIN, SHIPPED, SOUGHT

    inertial = {*SOUGHT[INERTIAL], *INTEGRALS[INERTIAL]}
    needed = {*SOUGHT[PLAIN], *INTEGRALS[PLAIN], "ELE_D_FILT"}
    if any(own.get(name, 0.0) > 0.0 for name in inertial):
        needed |= inertial
    missing = [f"{name} = {values[name]:g}" for name in SHIPPED if name in needed - own.keys()]
    if not missing:
        return ""
    return (
        f"; not given, and flown as declared: {_shortened(missing)}, which nobody found on an"
        " aircraft: give all gains or none (`tgl-soar docs margins`)"
    )


def _unknown(airframe: Airframe, values: ParameterSet) -> str:
    """Why too little is known of an airframe for gains to be sought; "": enough is."""
    from tgl_soar.control.laws import dynamics_of
    from tgl_soar.control.loop_margin import is_known

    if is_known(dynamics_of(values)):
        return ""
    if not airframe.model:
        return "the airframe file has no [model]"
    if lacks := [key for key in SHORT_PERIOD_KEYS if key not in airframe.model]:
        return f"[model] of the airframe file has no {', '.join(lacks)}"
    names = ("DYN_SPEED", "DYN_FREQ", "DYN_DAMP", "DYN_EFFECT", "DYN_PATH", "DYN_GLIDE", "DYN_BEST")
    least = {"DYN_GLIDE": 1.0, "DYN_BEST": 1.0}
    low = [name for name in names if not values[name] >= least.get(name, 1e-6)]
    figures = ", ".join(f"{name} = {values[name]:g}" for name in low)
    return f"[airframe], [model] and [dynamics] give no motion in pitch: {figures}"
