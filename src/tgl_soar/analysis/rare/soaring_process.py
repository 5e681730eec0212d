"""The closed loop as a process that may be lost: compiled flights that part where they are in
trouble.

A state is a flight between two ticks with what lies in the delay lines of its sensors: it may be
gone on with any number of times, with turbulence and noise of other seeds and its own biases.

Margin: the least of six distances from where it will have got, each as a share of what it is where
the aircraft hovers; a flight that has ended, by a crash or handed over, has none.

    ground   along the normal of the profile, from the clearance at which the module hands over
    fence    to each of its five sides

Where it will have got (`Outlook`) is its place and motion_s of its velocity; and in height besides

    gust_s (w − w₀) + speed_s (V − V₀) + nose_m (θ − θ₀)

with updraft w, airspeed V and pitch θ, and those where it hovers.  The last two are the margin to
the stall: slow and with its nose down an aircraft falls into it.  Its angle of attack tells little
by itself, as gusts pass the stall's every few seconds and nothing comes of it.

The four numbers are what logistic regression finds.  States that had come to a level (at 3 and 4 %
of turbulence) were gone on with 25 times each, and those that reached the level after next were
counted: beside a metre of height a m/s of climb is worth 0.30 to 0.36 m, one of updraft 0.14 to
0.15 m, one of airspeed 0.02 m at first and 0.13 m further down, a radian of pitch 0.7 to 1.1 m.
`tools/measure_margin.py` shows how much each tells of a loss, in other flights.
"""

from __future__ import annotations

from functools import cached_property, partial
from math import inf
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
from tgl_soar.sim.world_step import Parts

LAST_S: Final = 5.0  # of a flight that is lost, shown
SHOWN_EVERY: Final = 10  # ticks: it is looked at as often
SHOWN: Final = (
    "time_s", "x_m", "y_m", "z_m", "e_rho_m", "airspeed_mps", "alpha_rad", "pitch_rad", "elevator",
    "wind_mps", "updraft_mps",
)  # fmt: skip
_COLUMN: Final = {name: n for n, name in enumerate(Row._fields)}
_KEPT: Final = [_COLUMN[name] for name in SHOWN]
FAR_M: Final = 1e3  # where no ground is known
SIDES: Final = ("upstream", "downstream", "to the side", "below", "above")  # of the fence
STALLED_S: Final = 1.0  # so long beyond the stall, on average: longer than any gust
EDGE: Final = 0.1  # of a share: from here on the margin falls as an exponential


class Outlook(NamedTuple):
    """By what of its motion it is judged where an aircraft will have got."""

    motion_s: float = 0.3
    gust_s: float = 0.14
    speed_s: float = 0.1
    nose_m: float = 0.9  # for each radian


OUTLOOK: Final = Outlook()


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
        self._updraft_mps = field.wind_at(at.x_m, 0.0, at.z_m, 0.0)[2]
        self._field = field
        # That of the files, dispersed or not: what lies about the place is known by it.
        self.prepared: Prepared = prepare(self._world(None), case.duration_s)
        if not isinstance(self.prepared.world.model, AircraftModel):
            raise ValueError("the point mass knows no stall: fly the rigid body")
        self._usual = self._distances(at.x_m, 0.0, at.z_m)
        if min(self._usual) <= 0.0:
            usual = tuple(self._usual.tolist())
            raise ValueError(f"where it hovers it has no margin: {usual}")

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

    def looks_in(self, seconds: float) -> int:
        """How often a flight is looked at in that time."""
        return round(seconds * self.prepared.world.step_hz / SHOWN_EVERY)

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
        prepared = self._prepared(state.seed)
        parts, flight, shown = self.flown(prepared, state, seed)
        margins = self.margins(shown)[len(state.last) :]
        lowest = LOST if flight.standing != FLIES else float(margins.min(initial=inf))
        below = np.flatnonzero(margins <= level)
        if below.size:
            first = int(below[0])
            step, margin = state.flight.steps + (first + 1) * SHOWN_EVERY, float(margins[first])
            shown = shown[: len(state.last) + first + 1]
        elif lowest <= level:
            step, margin = flight.steps, LOST
        else:
            return Passage(lowest, None, "")
        if step < flight.steps:  # the same once more, as far as there
            parts, flight, _ = self.flown(prepared, state, seed, step)
        keep = self.looks_in(LAST_S)
        cause = self._cause(why_ended(prepared.world, flight).partition(" at x")[0], shown)
        now = PartedFlight(
            seed=state.seed,
            flight=flight,
            lines=lines_of(parts),
            margin=margin,
            last=shown[-keep:],
            cause=cause,
        )
        return Passage(margin, now, cause)

    def flown(
        self,
        prepared: Prepared,
        state: PartedFlight,
        seed: int,
        until_step: int | None = None,
    ) -> tuple[Parts, Flight, FloatArray]:
        """From a state on with the noise of a seed, until a step or its time is over: what it
        happens in, where it stands then, and all looks at it so far, (n, columns of SHOWN)."""
        begin = state.flight.steps
        rows = np.empty((prepared.ticks, len(Row._fields)))
        parts = continued(prepared, state.seed, state.lines, seed)
        until = prepared.ticks if until_step is None else until_step
        flight = fly_on(parts, self.laws, state.flight, until, 0, rows)
        looks = rows[begin + SHOWN_EVERY - 1 : flight.steps : SHOWN_EVERY, _KEPT]
        return parts, flight, np.concatenate([state.last, looks])

    def _cause(self, why: str, shown: FloatArray) -> str:
        """Why a flight has ended: of the fence the side, and whether the wing had stalled; shown:
        what was looked at before."""
        if not why or not len(shown):
            return why
        columns = dict(zip(SHOWN, shown.T, strict=True))
        x_m, y_m, z_m = (float(columns[name][-1]) for name in ("x_m", "y_m", "z_m"))
        if "fence" in why:
            side = int(np.argmin(self._distances(x_m, y_m, z_m)[1:]))
            why = f"{why}, {SIDES[side]}"
        last = self.looks_in(STALLED_S)
        stall_rad = self.case.airframe.aerodynamics().stall_alpha_rad
        return why if columns["alpha_rad"][-last:].mean() < stall_rad else f"{why}, stalled"

    def margins(self, shown: FloatArray, outlook: Outlook = OUTLOOK) -> FloatArray:
        """Of a flight that flies: at each look (n); shown: all of them so far, (n, columns of
        SHOWN)."""
        if not len(shown):
            return np.empty(0)
        columns = dict(zip(SHOWN, shown.T, strict=True))
        place = np.stack([columns["x_m"], columns["y_m"], columns["z_m"]])
        past_s = np.diff(columns["time_s"], prepend=-inf)  # of the first no velocity is known
        place += outlook.motion_s * np.diff(place, prepend=place[:, :1]) / past_s
        place[2] += outlook.gust_s * (columns["updraft_mps"] - self._updraft_mps)
        trim = self.prepared.world.trim
        place[2] += outlook.speed_s * (columns["airspeed_mps"] - trim.airspeed_mps)
        place[2] += outlook.nose_m * (columns["pitch_rad"] - trim.pitch_rad)
        least = (self._distances(*place) / self._usual[:, None]).min(axis=0)
        # Nothing is lost that still flies: beyond a limit it goes on down, and never to 0.
        beyond: FloatArray = EDGE * np.exp(np.minimum(least, EDGE) / EDGE - 1.0)
        return np.where(least > EDGE, least, beyond)

    def _distances(self, x_m: Any, y_m: Any, z_m: Any) -> FloatArray:
        """(6, as many as there are places)."""
        fence, least = self.laws.fence, self.case.values["CLEAR_MIN"]
        ground = np.vectorize(partial(clearance, self.laws.ground), otypes=[float])(x_m, z_m)
        return np.stack(
            (
                np.minimum(ground - least, FAR_M),
                x_m - fence.x_min_m,
                fence.x_max_m - x_m,
                fence.y_max_m - np.abs(y_m),
                z_m - fence.z_min_m,
                fence.z_max_m - z_m,
            )
        )


def _started(site: Site, x_m: float, z_m: float) -> Site:
    return replace(site, start=Start(x_m=x_m, z_m=z_m))
