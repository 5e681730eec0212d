"""The place as a browser draws it: ground, updraft, contour, lines, and what numbers mean.

What is named here is from the files and declarations, and does not change in flight.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, Final

import numpy as np

from tgl_soar.air.zeuc import ZeucError, contour
from tgl_soar.cli.page.measured_air import MeasuredAir
from tgl_soar.cli.page.settling_preview import Foresight
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import preset_lines
from tgl_soar.config.line_changes import contour_length
from tgl_soar.config.parameter_groups import group_of
from tgl_soar.config.parameters import INDEX, PARAMETERS, ParameterSet, as_wire_value
from tgl_soar.config.site import Site
from tgl_soar.control.forecast import FORECAST_TEXTS
from tgl_soar.control.point_hold import POINT_TEXTS
from tgl_soar.control.supervisor import ENTRY
from tgl_soar.control.supervisor_texts import CONDITION_TEXTS, MODE_NAMES
from tgl_soar.estimation.aerodynamics import braked
from tgl_soar.estimation.health import FAULT_TEXTS
from tgl_soar.onboard.setup import bounds_from
from tgl_soar.onboard.telemetry_values import HELD_BACK
from tgl_soar.sim.world import ground_outline, site_field
from tgl_soar.types import GlidePolar, Ground

CELLS: Final = 72  # of the map, along its longer side
ROOM: Final = 0.08  # of the view, around what is drawn
WIDTHS: Final = 1.35  # heights of the view: so wide at least is the air, as the plane on a screen
EMPTY_M: Final = 5.0  # to each side of the line, where a site gives nothing to see
HELD_BACK_TEXT: Final = "not held back (abort, switch, line, set-up)"


@dataclass(frozen=True)
class Place:
    """A site with an airframe: what is drawn of it, and what can be foreseen on it."""

    scene: dict[str, Any]  # as JSON
    foresight: Foresight
    values: ParameterSet  # of the files
    ground: Ground
    polar: GlidePolar

    def measured_air(self) -> MeasuredAir:
        """Where nothing was measured yet."""
        return MeasuredAir(self.ground, self.polar, self.scene["view"])


def place_of(airframe: Airframe, site: Site, values: ParameterSet, folder: Path) -> Place:
    """folder: of the site file.  Errors: `ConfigError` for a field that cannot be read."""
    presets = preset_lines(site, values)
    known = site.contour_for(airframe.airframe.name)
    ground = site.known_ground()
    polar = airframe.polar.as_polar()
    field = None if site.air is None else site_field(site, folder)
    view = _view(site, values, known)
    outline = None if site.air is None else ground_outline(site.air)
    parts: list[Any] = [list(part) for part in known]
    updraft = None
    band: list[Any] = []  # its other edge: where updraft equals sink with all of the brake
    has_brake = airframe.surfaces.brake is not None
    if field is not None:
        seen = _screen(view)
        updraft = _map(field, seen)
        parts = _contour(field, polar, seen) or parts
        if has_brake:
            band = _contour(field, braked(airframe.aerodynamics(), 1.0).polar, seen)
    scene = {
        "site": site.site.name,
        "airframe": airframe.airframe.name,
        "view": view,
        "ground": [] if site.ground is None else [list(p) for p in site.ground.profile],
        "outline": [] if outline is None else [list(p) for p in outline],
        "contour": parts,
        "braked": band,
        "has_brake": has_brake,
        "known": [list(part) for part in known],
        "contour_m": as_wire_value(contour_length(known)),
        "updraft": updraft,
        "presets": [{"name": p.name, "x": p.x_m, "z": p.z_m, "lean": p.lean_deg} for p in presets],
        **meanings(),
    }
    air = None if field is None else (field, polar)
    return Place(
        scene=scene,
        foresight=Foresight(presets, known, bounds_from(airframe, site), air),
        values=values,
        ground=ground,
        polar=polar,
    )


def meanings() -> dict[str, Any]:
    """Words for numbers: modes, entry checks, faults, parameters."""
    checks = [(1 << i, words) for i, words in enumerate(CONDITION_TEXTS) if ENTRY >> i & 1]
    return {
        "modes": list(MODE_NAMES),
        "checks": [[HELD_BACK, HELD_BACK_TEXT], *([bit, words] for bit, words in checks)],
        "forecasts": list(FORECAST_TEXTS),
        "points": list(POINT_TEXTS),
        "faults": [[1 << i, words] for i, words in enumerate(FAULT_TEXTS)],
        "parameters": [
            {
                "name": p.name,
                "group": group_of(p.name).title,
                "unit": p.unit,
                "min": p.minimum,
                "max": p.maximum,
                "default": p.default,
                "meaning": p.meaning,
                "in_flight": p.in_flight,
                "integer": p.integer,
            }
            for p in PARAMETERS
        ],
    }


def _view(site: Site, values: ParameterSet, known: Any) -> list[float]:
    """x from, x to, z from, z to [m]: the fence where there is one, else what there is to see."""
    points = [(line.x_m, line.z_m) for line in site.lines.values()]
    points += [point for part in known for point in part]
    xs, zs = [x for x, _ in points], [z for _, z in points]
    for names, found in (
        (("FENCE_X_MIN", "FENCE_X_MAX"), xs),
        (("FENCE_Z_MIN", "FENCE_Z_MAX"), zs),
    ):
        found.extend(values[n] for n in names if values[n] != PARAMETERS[INDEX[n]].default)
    if site.ground is not None and xs:
        zs += [z for x, z in site.ground.profile if min(xs) <= x <= max(xs)]
    if xs and values["LND_LEN"] > 0.0:  # a landing place
        xs.append(values["LND_X"])
        zs.append(values["LND_Z"])
    if not (xs and zs):
        x, z = values["TGL_X"], values["TGL_Z"]
        xs, zs = [x - EMPTY_M, x + EMPTY_M], [z - EMPTY_M, z + EMPTY_M]
    room = ROOM * max(max(xs) - min(xs), max(zs) - min(zs), 1.0)
    return [min(xs) - room, max(xs) + room, min(zs) - room, max(zs) + room]


def _screen(view: list[float]) -> list[float]:
    """What a wide screen shows beside the view: without air there the map would end in an edge."""
    x_from, x_to, z_from, z_to = view
    beside = max(0.0, 0.5 * (WIDTHS * (z_to - z_from) - (x_to - x_from)))
    return [x_from - beside, x_to + beside, z_from, z_to]


def _map(field: Any, view: list[float]) -> dict[str, Any]:
    """The updraft [cm/s] on a grid, rows from below; null where the field knows none."""
    step = max(view[1] - view[0], view[3] - view[2]) / CELLS
    x = np.arange(view[0], view[1] + step, step)
    z = np.arange(view[2], view[3] + step, step)
    xx, zz = np.meshgrid(x, z)
    w = np.broadcast_to(field.wind(xx, 0.0, zz)[2], xx.shape)
    air = [[field.inside(a, 0.0, b) for a in x.tolist()] for b in z.tolist()]
    cells = [
        [round(100.0 * value) if inside and isfinite(value) else None for value, inside in row]
        for row in (zip(r, a, strict=True) for r, a in zip(w.tolist(), air, strict=True))
    ]
    return {"x": float(x[0]), "z": float(z[0]), "step": step, "cells": cells}


def _contour(field: Any, polar: Any, view: list[float]) -> list[Any]:
    """The contour of the model, in as few points as a screen shows."""
    x_from, x_to, z_from, z_to = view
    step = max(x_to - x_from, z_to - z_from) / CELLS
    try:
        parts = contour(field, polar, (x_from, x_to, z_from, z_to), step)
    except ZeucError:
        return []
    return [np.round(part, 3).tolist() for part in parts]
