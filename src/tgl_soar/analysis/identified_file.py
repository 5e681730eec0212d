"""An airframe file with what a log of gliding flight shows: every number with its band beside it.

The doublets give lift, moments and the servo's delay, the steady glides drag and polar.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final, NamedTuple

from tgl_soar.analysis.drag import drag_of
from tgl_soar.analysis.identification import Identified, KnownAircraft
from tgl_soar.config.airframe import OF_THE_BRAKE
from tgl_soar.config.files import ConfigError
from tgl_soar.estimation.polar import GlideStretch, fit_polar, fit_polar_family

# What an identification writes into [model] of an airframe file, and from what.
KEYS: Final = {
    "CL0": "CL0",  # with Cm0: an angle of attack that is measured askew is in both
    "CL_alpha": "CL_alpha",
    "CL_elevator": "CL_elevator",
    "Cm0": "Cm0",
    "Cm_alpha": "Cm_alpha",
    "Cm_q": "Cm_q",
    "Cm_elevator": "Cm_elevator",
    "servo_delay_s": "delay",
}
BRAKE_KEYS: Final = {"CL_brake": "CL_brake", "Cm_brake": "Cm_brake"}


class Written(NamedTuple):
    """A number of [model], and half of its band of 95 %."""

    value: float
    half_band: float


class Gliding(NamedTuple):
    """What the steady glides tell beside the manoeuvres."""

    written: dict[str, Written]
    polar: str  # the keys of [polar], a line each; "": none
    words: str


def glided(stretches: Sequence[GlideStretch], body: KnownAircraft) -> Gliding:
    """Drag and polar of steady glides.  Errors: ValueError saying what they lack."""
    speeds = [each.speed_mps for each in stretches]
    sinks, brakes = [each.sink_mps for each in stretches], [each.brake for each in stretches]
    drag = drag_of(stretches, body)
    braked = any(each.name == "CD_brake" for each in drag)
    fitted = fit_polar_family(speeds, sinks, brakes).fit if braked else fit_polar(speeds, sinks)
    polar = fitted.polar
    lines = "\n".join(f"{key} = {value:.8g}" for key, value in polar._asdict().items())
    return Gliding(
        {each.name: Written(each.value, each.half_band) for each in drag},
        lines,
        f"polar of {len(stretches)} glides, {polar.speed_min_mps:.2f} to"
        f" {polar.speed_max_mps:.2f} m/s, residual {fitted.residual_rms_mps:.3f} m/s",
    )


def with_identified(text: str, name: str, found: Identified, gliding: Gliding) -> str:
    """The text of an airframe file with the identified values, each with its band beside it.

    name: the file's, for errors: `ConfigError` for a key that its [model] lacks, or a file without
    [polar].
    """
    head, table, rest = text.partition("\n[model]")
    body, bracket, tail = rest.partition("\n[")
    for key, each in {**_of_manoeuvres(found), **gliding.written}.items():
        line = f"{key} = {each.value:.5g}  # identified: ± {each.half_band:.2g} at 95 %"
        body, count = re.subn(rf"(?m)^{key}\s*=.*$", line, body)
        if count == 0 and key in OF_THE_BRAKE:  # a file need not have them
            body, count = f"{body.rstrip()}\n{line}\n", 1
        if count != 1:
            raise ConfigError(f"{name}: model.{key}: missing, so it cannot be replaced")
    text = head + table + body + bracket + tail
    if gliding.polar:
        text, count = re.subn(_POLAR, f"[polar]\n{gliding.polar}\n\n", text)
        if count != 1:
            raise ConfigError(f"{name}: [polar]: missing, so it cannot be replaced")
    return text.rstrip() + "\n"


# To the line that begins the next table, or the comment above it.
_POLAR: Final = r"(?m)^\[polar\][ \t]*(?:#.*)?\n(?:(?!(?:[ \t]*(?:#.*)?\n)*[ \t]*\[).*\n?)*"


def _of_manoeuvres(found: Identified) -> dict[str, Written]:
    keys = KEYS if found.no_brake else {**KEYS, **BRAKE_KEYS}
    return {
        key: Written(found[name].value, 0.5 * (found[name].high - found[name].low))
        for key, name in keys.items()
    }
