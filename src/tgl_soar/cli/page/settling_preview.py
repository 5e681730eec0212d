"""Where an aircraft would settle on a line, when, and why the line would be refused.

Refused by the module's own code: the line is staged and committed (`config.line_changes`, with
`control.line_bounds`) on a copy of the values that stand, as a PARAM_SET does on board.

The way there is the line's own motion (`control.target_line`) with an aircraft that is held to it
and slides along it by the excess updraft of the site's air, as `air.zeuc` derives it:

    ṡ (sin η − S′ cos η) = E

Without a model of the air the place is where the line crosses the site's known contour, and of the
time only the line's own is known.
"""

from __future__ import annotations

from math import cos, hypot, isfinite, radians, sin
from typing import Final, NamedTuple

from tgl_soar.air.field import WindField
from tgl_soar.air.zeuc import excess_at, slope_along
from tgl_soar.config.line_changes import LINE, Contour, LineChanges, Presets, crossings
from tgl_soar.config.parameters import ParameterError, ParameterSet, as_wire_value
from tgl_soar.control.line_bounds import LineBounds
from tgl_soar.control.target_line import (
    LineLimits,
    LineState,
    TargetLine,
    e_rho,
    eta_from_lean,
    line_at,
    line_step,
)
from tgl_soar.types import GlidePolar

STEP_S: Final = 0.1
LONGEST_S: Final = 120.0
AT_REST_MPS: Final = 0.003  # along the line; 0.3 m in the longest time that is looked at
SETTLED_M: Final = 0.1  # from where it comes to rest, for good: then it has settled
PATH_POINTS: Final = 60


class GhostLine(NamedTuple):
    """A line as the operator's parameters give it."""

    x_m: float
    z_m: float
    lean_deg: float


class Ghost(NamedTuple):
    """What becomes of an aircraft if the line is moved there."""

    line: GhostLine
    refusal: str  # why the module would refuse it; "": it would not
    warning: str
    place: tuple[float, float] | None  # where it settles: x, z [m]
    settles_s: float | None  # None: not known
    words: str  # why there is no place or no time
    path: tuple[tuple[float, float], ...]  # to there: x, z [m]


class GhostStart(NamedTuple):
    """Where the aircraft and the line that it flies are now."""

    x_m: float
    z_m: float
    line: GhostLine | None  # None: not engaged, it would start at the aircraft


class Foresight:
    """What is known of a site, and so what can be foreseen of a line."""

    def __init__(
        self,
        presets: Presets,
        contour: Contour,
        bounds: LineBounds,
        air: tuple[WindField, GlidePolar] | None,
    ) -> None:
        self._presets = presets
        self._contour = contour
        self._bounds = bounds
        self._air = air

    def ghost(
        self, values: ParameterSet, wanted: GhostLine, start: GhostStart, *, flying: bool
    ) -> Ghost:
        """Of a line that is not set yet."""
        wanted = GhostLine(*(as_wire_value(value) for value in wanted))
        refusal, warning = self.verdict(values, wanted, flying=flying)
        place, seconds, words, path = self._settling(values, wanted, start)
        return Ghost(
            line=wanted,
            refusal=refusal,
            warning=warning,
            place=place,
            settles_s=seconds,
            words=words,
            path=path,
        )

    def verdict(self, values: ParameterSet, wanted: GhostLine, *, flying: bool) -> tuple[str, str]:
        """Why the module would refuse a line, and what it would warn of; "" where it would not."""
        changes = LineChanges(self._presets, self._bounds.fault, ringing=self._bounds.ringing)
        try:
            values = changes.set(values, "TGL_STAGE", 2.0, flying=flying).values
            values = changes.set(values, "TGL_STAGE", 1.0, flying=flying).values
            for name, value in zip(LINE, wanted, strict=True):
                values = changes.set(values, name, value, flying=flying).values
            answer = changes.set(values, "TGL_STAGE", 0.0, flying=flying)
        except ParameterError as error:
            return str(error), ""
        refusal = answer.refusal.removeprefix("staged move dropped: ")
        return refusal.removeprefix("TGL_STAGE = 0: "), answer.warning

    def _settling(
        self, values: ParameterSet, wanted: GhostLine, start: GhostStart
    ) -> tuple[tuple[float, float] | None, float | None, str, tuple[tuple[float, float], ...]]:
        if not (isfinite(start.x_m) and isfinite(start.z_m)):
            words = "where the aircraft is now is not known"
            return self._crossing(wanted), None, words, ()
        if self._air is None:
            words = "without a model of the air the time is not known"
            return self._crossing(wanted), None, words, ()
        path = self._way(values, wanted, start)
        end = path[-1]
        if not (isfinite(end[0]) and isfinite(end[1])):
            return None, None, "the aircraft would leave the air that is known", path[:-1]
        if len(path) > LONGEST_S / STEP_S:
            return None, None, f"the aircraft is still sliding after {LONGEST_S:g} s", _thin(path)
        away = [i for i, p in enumerate(path) if hypot(p[0] - end[0], p[1] - end[1]) > SETTLED_M]
        return end, (away[-1] + 1) * STEP_S if away else 0.0, "", _thin(path)

    def _crossing(self, line: GhostLine) -> tuple[float, float] | None:
        """The nearest place of the known contour where an aircraft settles."""
        places = [(c.x_m, c.z_m) for c in crossings(self._contour, *line) if c.settles]
        return min(places, key=lambda p: hypot(p[0] - line.x_m, p[1] - line.z_m), default=None)

    def _way(
        self, values: ParameterSet, wanted: GhostLine, start: GhostStart
    ) -> tuple[tuple[float, float], ...]:
        """The places at every step, until it rests; NaN at the end: it left the known air."""
        limits = LineLimits(
            values["TGL_SLEW"], values["TGL_ACCEL"], radians(values["TGL_ROT_SLEW"])
        )
        target = TargetLine(wanted.x_m, wanted.z_m, eta_from_lean(radians(wanted.lean_deg)))
        x, z = start.x_m, start.z_m
        if start.line is None:
            state = line_at(target, x, z)
        else:
            eta = eta_from_lean(radians(start.line.lean_deg))
            state = LineState(
                x_m=start.line.x_m, z_m=start.line.z_m, eta_rad=eta, speed_mps=0.0, moving=True
            )
        path = [(x, z)]
        while len(path) <= LONGEST_S / STEP_S:
            state = line_step(limits, state, target, x, z, STEP_S)
            speed = self._slide_mps(x, z, state.eta_rad)
            across = e_rho(state.x_m, state.z_m, state.eta_rad, x, z)
            x += across * sin(state.eta_rad) + speed * STEP_S * cos(state.eta_rad)
            z += -across * cos(state.eta_rad) + speed * STEP_S * sin(state.eta_rad)
            path.append((x, z))
            if not isfinite(x + z) or (not state.moving and abs(speed) < AT_REST_MPS):
                break
        return tuple(path)

    def _slide_mps(self, x_m: float, z_m: float, eta_rad: float) -> float:
        """Speed up the line; NaN outside the air that is known."""
        assert self._air is not None
        field, polar = self._air
        excess = excess_at(field, polar, x_m, z_m)
        if not isfinite(excess):
            return float("nan")
        u, v, _ = field.wind_at(x_m, 0.0, z_m, 0.0)
        return excess / (sin(eta_rad) - slope_along(polar, u, v) * cos(eta_rad))


def _thin(path: tuple[tuple[float, float], ...]) -> tuple[tuple[float, float], ...]:
    every = max(1, len(path) // PATH_POINTS)
    return (*path[::every], path[-1])
