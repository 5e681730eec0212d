"""The closed loop as a process that may be lost: compiled flights that part where they are in
trouble.

A state is a flight between two ticks with what lies in the delay lines of its sensors: it may be
gone on with any number of times, with turbulence and noise of other seeds and its own biases.

Margin: the least of six distances as they will be AHEAD_S from now if the aircraft goes on as it
moves, each as a share of what it is where the aircraft hovers; a flight that has ended, by a crash
or handed over, has none.

    ground   along the normal of the profile, from the clearance at which the module hands over
    fence    to each of its five sides

The angle of attack is no part of it.  Gusts pass the stall's angle every few seconds and nothing
comes of it: as a level it leads nowhere, and where a stall does lose the aircraft it is by the way
down to the ground or out of the fence.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from math import exp, inf
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from tgl_soar.air.field import FloatArray
from tgl_soar.air.zeuc import stable_crossing
from tgl_soar.analysis.experiments.random_aircraft import mismatched
from tgl_soar.analysis.rare.kramers import WellExit, well_exits
from tgl_soar.analysis.rare.splitting import LOST, Passage
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Site, Start
from tgl_soar.control.envelope import clearance
from tgl_soar.control.laws import Laws, laws_from
from tgl_soar.sim.aircraft import AircraftModel
from tgl_soar.sim.compiled_flight import (
    Prepared,
    begun,
    continued,
    fly_on,
    lines_of,
    prepare,
    why_ended,
)
from tgl_soar.sim.flight import FLIES, Flight, Row
from tgl_soar.sim.sensors import Sensors
from tgl_soar.sim.world import World, make_world, site_field

LOOK_S: Final = 0.1  # between two looks at the margin: a third of the short period's time
LAST_S: Final = 5.0  # of a flight that is lost, shown
SHOWN_EVERY: Final = 10  # ticks
SHOWN: Final = (
    "time_s", "x_m", "y_m", "z_m", "e_rho_m", "airspeed_mps", "alpha_rad", "pitch_rad", "elevator",
    "wind_mps", "updraft_mps",
)  # fmt: skip
_COLUMN: Final = {name: n for n, name in enumerate(Row._fields)}
_KEPT: Final = [_COLUMN[name] for name in SHOWN]
_PLACE: Final = [_COLUMN[name] for name in ("x_m", "y_m", "z_m")]
FAR_M: Final = 1e3  # where no ground is known
EDGE: Final = 0.1  # of a share: from here on the margin falls as an exponential
AHEAD_S: Final = 0.5  # the time constant of a slide along the line is that or more: 1 / λ


class SoaringCase(NamedTuple):
    """Which loop, where, and for how long."""

    airframe: Airframe
    site: Site
    values: ParameterSet  # with the line
    sensors: Sensors
    turbulence: float
    duration_s: float
    dispersed: bool = False  # each flight another aircraft than the file's, in other air
    folder: Path | None = None  # of the site file, which names the files of its air from there


class PartedFlight(NamedTuple):
    """A flight between two ticks."""

    seed: int  # of the biases, and of the noise so far
    flight: Flight
    lines: tuple[tuple[Any, ...], ...]
    margin: float
    last: FloatArray  # (n, columns of SHOWN): the last seconds
    cause: str  # why it has ended; "" while it flies


class SoaringProcess:
    """Of `splitting.Process`.  Errors: ValueError where there is no place to hover."""

    def __init__(self, case: SoaringCase) -> None:
        self.case = case
        site, values = case.site, case.values
        assert site.air is not None
        field = site_field(site, case.folder)
        self.laws: Laws = laws_from(
            values, site.frame(), case.airframe.aerodynamics(), site.known_ground()
        )
        line = self.laws.target
        at = stable_crossing(
            field, case.airframe.polar.as_polar(), (line.x_m, line.z_m, line.eta_rad)
        )
        if at is None:
            raise ValueError("the line crosses the contour nowhere: there is no place to hover")
        self.place = (at.x_m, at.z_m)
        self._field = field
        # That of the files, dispersed or not: what lies about the place is known by it.
        self.prepared: Prepared = prepare(self._world(None), case.duration_s)
        if not isinstance(self.prepared.world.model, AircraftModel):
            raise ValueError("the point mass knows no stall: fly the rigid body")
        self._usual = self._distances(at.x_m, 0.0, at.z_m)
        if min(self._usual) <= 0.0:
            raise ValueError(f"where it hovers it has no margin: {self._usual}")
        self._look = round(LOOK_S * self.prepared.world.step_hz)

    @cached_property
    def exits(self) -> tuple[WellExit, WellExit]:
        """The ends of the well in which it hovers, by theory."""
        site, world = self.case.site, self.prepared.world
        assert site.air is not None
        reference = world.field.reference_wind_mps
        length_m = site.air.turbulence.length_scale_m
        return well_exits(
            world.field,
            self.case.airframe.polar.as_polar(),
            self.place,
            self.laws.target.eta_rad,
            (self.case.turbulence * reference, length_m / reference),
            lambda x, z: min(self._distances(x, 0.0, z)) > 0.0,
        )

    def _world(self, seed: int | None) -> World:
        """The aircraft of a flight and its air; None: those of the files."""
        case = self.case
        airframe, site, field, sensors = case.airframe, case.site, self._field, case.sensors
        if seed is not None:
            airframe, site, field, sensors = mismatched(airframe, site, field, sensors, seed)
        return make_world(
            airframe,
            # At rest where the file's hovers: how it comes there is no part of the question.
            _started(site, *self.place),
            turbulence=case.turbulence,
            field=field,
            sensors=sensors,
            known=case.airframe,
        )

    def _prepared(self, seed: int) -> Prepared:
        """Of the flight that began with this seed."""
        if not self.case.dispersed:
            return self.prepared
        return prepare(self._world(seed), self.case.duration_s)

    def shown(self, state: PartedFlight) -> FloatArray:
        """Of `splitting.Process`: columns of SHOWN."""
        return state.last

    def begun(self, seed: int) -> PartedFlight:
        """A flight before its first tick."""
        parts, flight = begun(self._prepared(seed), seed)
        return PartedFlight(
            seed=seed,
            flight=flight,
            lines=lines_of(parts),
            margin=inf,
            last=np.empty((0, len(SHOWN))),
            cause="",
        )

    def passage(self, state: PartedFlight, seed: int, level: float) -> Passage:
        """Fly on with the noise of a seed until the margin is at or below a level."""
        if state.margin <= level:  # a hand-over passes all that is left of a ladder at once
            return Passage(state.margin, state, state.cause)
        prepared, begin = self._prepared(state.seed), state.flight
        rows = np.empty((prepared.ticks, len(Row._fields)))
        parts = continued(prepared, state.seed, state.lines, seed)
        flight = fly_on(parts, self.laws, begin, prepared.ticks, 0, rows)
        step, margin, lowest = self._first_below(level, begin.steps, flight, rows)
        if margin > level:
            return Passage(lowest, None, "")
        if step < flight.steps:  # the same once more, as far as there
            parts = continued(prepared, state.seed, state.lines, seed)
            flight = fly_on(parts, self.laws, begin, step, 0, rows)
        shown = np.concatenate([state.last, rows[begin.steps : step : SHOWN_EVERY, _KEPT]])
        keep = round(LAST_S * prepared.world.step_hz / SHOWN_EVERY)
        cause = why_ended(prepared.world, flight).partition(" at x")[0]
        now = PartedFlight(
            seed=state.seed,
            flight=flight,
            lines=lines_of(parts),
            margin=margin,
            last=shown[-keep:],
            cause=cause,
        )
        return Passage(lowest, now, cause)

    def _first_below(
        self, level: float, begin: int, flight: Flight, rows: FloatArray
    ) -> tuple[int, float, float]:
        """(step, margin, lowest so far) of the first look at or below a level, or of the last."""
        lowest = margin = inf
        for step in range(begin + self._look, flight.steps + 1, self._look):
            margin = self.margin(rows[step - self._look], rows[step - 1])
            lowest = min(lowest, margin)
            if margin <= level:
                return step, margin, lowest
        if flight.standing != FLIES:
            return flight.steps, LOST, LOST
        return flight.steps, margin, lowest

    def margin(self, before: FloatArray, row: FloatArray) -> float:
        """Of a flight that still flies, after a tick; before: the row of an earlier one."""
        past_s = row[_COLUMN["time_s"]] - before[_COLUMN["time_s"]]
        ahead = row[_PLACE] + (row[_PLACE] - before[_PLACE]) * (AHEAD_S / past_s)
        then = self._distances(*(float(number) for number in ahead))
        least = min(distance / usual for distance, usual in zip(then, self._usual, strict=True))
        # Nothing is lost that still flies: beyond a limit it goes on down, and never to 0.
        return least if least > EDGE else EDGE * exp((least - EDGE) / EDGE)

    def _distances(self, x_m: float, y_m: float, z_m: float) -> Sequence[float]:
        fence, least = self.laws.fence, self.case.values["CLEAR_MIN"]
        ground = clearance(self.laws.ground, x_m, z_m) - least
        return (
            min(ground, FAR_M),
            x_m - fence.x_min_m,
            fence.x_max_m - x_m,
            fence.y_max_m - abs(y_m),
            z_m - fence.z_min_m,
            fence.z_max_m - z_m,
        )


def _started(site: Site, x_m: float, z_m: float) -> Site:
    return replace(site, start=Start(x_m=x_m, z_m=z_m))
