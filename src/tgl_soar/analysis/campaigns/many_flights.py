"""Many flights of one airframe file over one site, without faults: what became of each, in a row.

Each leg (a line of the site) is flown in each turbulence with each seed, as `experiment` flies its
scenarios, by the compiled loop.  A flight begins 0.3 m downstream of where its leg meets the
contour of the files, at rest over the ground; where the two do not meet, at the site's [start].
All sensors of a fault campaign are aboard.  Dispersed, a seed draws the same aircraft and the same
air (`random_aircraft`) for all legs and turbulences.

A leg is scored as in an experiment (`experiments.flights`): from 5 s after the line stood still, to
the end or as far as the aircraft flew.  What was lost before 5.5 s has no figures but its settling
time, which is infinite; a table says how many flights each figure is of.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import degrees, hypot, inf, nan
from pathlib import Path
from typing import Any, Final, NamedTuple, overload

import msgspec
import numpy as np

from tgl_soar.analysis.campaigns.drawn_faults import FLYING, LOST, RELEASED, SOARING
from tgl_soar.analysis.experiments.flights import (
    SETTLE_S,
    ScenarioJob,
    ScoredLeg,
    own_glides,
    own_place,
    rms,
    scenario_world,
    score_legs,
)
from tgl_soar.analysis.experiments.random_aircraft import Mismatch, drawn_mismatch
from tgl_soar.analysis.experiments.scenario import (
    LineSpec,
    PreparedScenario,
    Scenario,
    SensorSpec,
    StartSpec,
    prepare,
)
from tgl_soar.analysis.search.scoring import interval
from tgl_soar.autopilot import mode_name
from tgl_soar.config.files import ConfigError, check_simulated, load_airframe, load_site
from tgl_soar.config.site import Site, TurbulenceSettings, air_files
from tgl_soar.sim.aircraft import AircraftModel
from tgl_soar.sim.campaign.encoding import digest
from tgl_soar.sim.campaign.flight_list import Campaign
from tgl_soar.sim.campaign.provenance import files_digest
from tgl_soar.sim.closed_loop import Trajectory
from tgl_soar.sim.compiled_flight import fly_compiled
from tgl_soar.sim.compiled_flight import prepare as prepare_compiled
from tgl_soar.sim.world import World

ABOARD: Final = SensorSpec(imu=True, pitot=True, surfaces=True)
STILL: Final = 1e-6  # in place of no turbulence: one compiled kind of air for all
DISENGAGED: Final = "disengaged: "
TURBULENCE_MOST: Final = 0.5


class FlightsAsked(NamedTuple):
    """What is to be flown."""

    airframe: Path
    site: Path
    legs: tuple[str, ...]  # names of the site's lines; (): all of them
    turbulences: tuple[float, ...]  # intensities, of the reference wind
    flights: int  # of each leg in each turbulence
    seed: int  # of the first
    duration_s: float
    dispersed: bool
    parameters: dict[str, float]  # beside those of the files


class LegJob(NamedTuple):
    """One flight to be flown."""

    leg: str
    turbulence: float
    seed: int
    dispersed: bool
    scenario: bytes  # a `Scenario` as JSON: no column


class LegFlight(NamedTuple):
    """What became of it; NaN: not flown for so long, or not there."""

    leg: str
    turbulence: float  # intensity, of the reference wind
    seed: int
    result: str  # SOARING, FLYING, RELEASED or LOST, as in `drawn_faults`
    reason: str  # why it ended early, or in which other mode it was in the end; ""
    ended_s: float  # how long it flew
    settling_s: float  # from the line's stop to the first two seconds within 5 cm of it; inf: never
    rms_e_rho_m: float
    peak_e_rho_m: float
    rms_along_m: float  # about the mean place
    rms_y_m: float  # from the middle
    rms_bank_rad: float
    rms_elevator_rate_per_s: float  # of the command, in half-throws a second
    mean_x_m: float
    mean_z_m: float
    # From TGL ∩ ZEUC to the mean place, and the same of the aircraft and the air that were drawn,
    # by its own glides, along the line: there it is positive up.
    off_contour_m: float
    off_own_contour_m: float | None
    scored_s: float
    drawn: Mismatch | None  # None: as the files have it

    @property
    def survived(self) -> bool:
        """Flown to the end."""
        return self.result in (SOARING, FLYING)


# --- the jobs ----------------------------------------------------------------------------------


@dataclass(frozen=True)
class LegJobs(Sequence[LegJob]):
    """All flights, each made when it is asked for: leg by leg, each in one turbulence after the
    other, each with all seeds."""

    asked: FlightsAsked
    scenarios: tuple[tuple[str, float, bytes], ...]  # leg, turbulence, JSON

    def __len__(self) -> int:
        return self.asked.flights * len(self.scenarios)

    @overload
    def __getitem__(self, i: int) -> LegJob: ...

    @overload
    def __getitem__(self, i: slice) -> list[LegJob]: ...

    def __getitem__(self, i: int | slice) -> LegJob | list[LegJob]:
        if isinstance(i, slice):
            return [self[each] for each in range(*i.indices(len(self)))]
        if not 0 <= i < len(self):
            raise IndexError(i)
        which, number = divmod(i, self.asked.flights)
        leg, turbulence, scenario = self.scenarios[which]
        return LegJob(
            leg=leg,
            turbulence=turbulence,
            seed=self.asked.seed + number,
            dispersed=self.asked.dispersed,
            scenario=scenario,
        )


def jobs_of(asked: FlightsAsked) -> LegJobs:
    """The flights, once everything about them is checked that the files can have wrong.

    Errors: `ConfigError`; ValueError for air that is not compiled.
    """
    airframe, site = load_airframe(asked.airframe), load_site(asked.site)
    check_simulated(asked.airframe, airframe)
    if asked.dispersed and airframe.model_kind == "point_mass":
        raise ConfigError(f"{asked.airframe}: --dispersion needs the rigid body, not a point mass")
    if site.air is None:
        raise ConfigError(f"{asked.site}: no [air] table, so there is no wind to fly in")
    known = ", ".join(site.lines) or "none: give it a table [lines]"
    legs = asked.legs or tuple(site.lines)
    if missing := [name for name in legs if name not in site.lines]:
        raise ConfigError(f"--legs {missing[0]}: no line of {asked.site}; it has {known}")
    if not legs:
        raise ConfigError(f"{asked.site}: its lines are {known}")
    usual = site.air.turbulence
    scenarios = []
    for leg in legs:
        for turbulence in asked.turbulences:
            air = msgspec.structs.replace(usual, intensity=max(turbulence, STILL))
            scenario = scenario_of(asked, site, leg, air)
            scenarios.append((leg, turbulence, msgspec.json.encode(scenario)))
        job = ScenarioJob(scenario=scenario, seed=asked.seed)
        prepare_compiled(scenario_world(job, prepare(scenario), None), 1.0)
    return LegJobs(asked, tuple(scenarios))


def scenario_of(
    asked: FlightsAsked, site: Site, leg: str, turbulence: TurbulenceSettings
) -> Scenario:
    """The flights of a leg in one turbulence.  Errors: `ConfigError`."""
    line = site.lines[leg]
    scenario = Scenario(
        title=site.site.name,
        duration_s=asked.duration_s,
        first_line=leg,
        lines={leg: LineSpec(x_m=line.x_m, z_m=line.z_m, lean_deg=line.lean_deg)},
        airframe=str(asked.airframe.resolve()),
        site=str(asked.site.resolve()),
        parameters=asked.parameters,
        turbulence=turbulence,
        sensors=ABOARD,
    )
    if site.start is None:
        return scenario
    start = StartSpec(x_m=site.start.x_m, z_m=site.start.z_m)
    there = msgspec.structs.replace(scenario, start=start)
    return there if prepare(there).lines[leg].crossing is None else scenario


def campaign_of(jobs: LegJobs) -> Campaign[LegJob, LegFlight]:
    """The flights for the runner, with all that they depend on."""
    asked = jobs.asked
    site = load_site(asked.site)
    assert site.air is not None
    parameters: dict[str, Any] = {
        "legs": list(dict.fromkeys(leg for leg, _, _ in jobs.scenarios)),
        "turbulence": list(asked.turbulences),
        "flights": asked.flights,
        "duration_s": asked.duration_s,
        "dispersed": asked.dispersed,
        "parameters": asked.parameters,
        "airframe": digest(load_airframe(asked.airframe)),
        "site": digest(site),
        "air": files_digest(air_files(site.air, asked.site.parent)),
    }
    seeds = (asked.seed, asked.seed + asked.flights - 1)
    return Campaign(name="flights", fly=fly_leg, jobs=jobs, parameters=parameters, seeds=seeds)


# --- one flight --------------------------------------------------------------------------------


def fly_leg(job: LegJob) -> LegFlight:
    """Fly one, compiled.  An aircraft that cannot fly at its start is lost there."""
    scenario = msgspec.json.decode(job.scenario, type=Scenario)
    prepared = prepare(scenario)
    asked = ScenarioJob(scenario=scenario, seed=job.seed, dispersed=job.dispersed)
    try:
        world = scenario_world(asked, prepared, None)
    except ConfigError as error:
        return _row(job, (LOST, str(error), 0.0), None, nan, None)
    ready = prepare_compiled(world, scenario.duration_s)
    flown = fly_compiled(ready, job.seed, prepared.values, prepared.changes)
    return scored(job, prepared, world, flown)


def scored(job: LegJob, prepared: PreparedScenario, world: World, flown: Trajectory) -> LegFlight:
    """What a flight in a world was worth."""
    mode = mode_name(int(flown["mode"][-1]))
    result, reason = (SOARING, "") if mode == SOARING else (FLYING, mode)
    if flown.ended.startswith(DISENGAGED):
        result, reason = RELEASED, flown.ended.removeprefix(DISENGAGED)
    elif flown.ended:
        result, reason = LOST, flown.ended.partition(" at x")[0]
    (leg,) = score_legs(prepared, flown) or (None,)
    own, rate_per_s = None, nan
    if leg is not None:
        times = flown["time_s"]
        rows = (times >= leg.begin_s + SETTLE_S) & (times <= leg.end_s)
        rate_per_s = rms(np.diff(flown["elevator"][rows]) * world.step_hz)
        if job.dispersed and isinstance(world.model, AircraftModel):
            own = leg.along_m - own_place(leg, world.field, own_glides(world.model))
    ended_s = flown.ticks / world.step_hz
    return _row(job, (result, reason, ended_s), leg, rate_per_s, own)


def _row(
    job: LegJob,
    end: tuple[str, str, float],
    leg: ScoredLeg | None,
    rate_per_s: float,
    own_m: float | None,
) -> LegFlight:
    """end: result, reason, flight time [s]; own_m: off the contour of what flew, along the line."""
    result, reason, ended_s = end
    off_m = nan
    if leg is not None and leg.predicted is not None:
        x_m, z_m = leg.predicted
        off_m = hypot(leg.mean_x_m - x_m, leg.mean_z_m - z_m)

    def of_leg(name: str) -> float:
        return nan if leg is None else float(getattr(leg, name))

    return LegFlight(
        leg=job.leg,
        turbulence=job.turbulence,
        seed=job.seed,
        result=result,
        reason=reason,
        ended_s=ended_s,
        settling_s=inf if leg is None else leg.settling_s,
        rms_e_rho_m=of_leg("rms_e_rho_m"),
        peak_e_rho_m=of_leg("peak_e_rho_m"),
        rms_along_m=of_leg("dispersion_m"),
        rms_y_m=of_leg("rms_y_m"),
        rms_bank_rad=of_leg("rms_bank_rad"),
        rms_elevator_rate_per_s=rate_per_s,
        mean_x_m=of_leg("mean_x_m"),
        mean_z_m=of_leg("mean_z_m"),
        off_contour_m=off_m,
        off_own_contour_m=own_m,
        scored_s=0.0 if leg is None else leg.scored_s,
        drawn=drawn_mismatch(job.seed) if job.dispersed else None,
    )


# --- what became of them -----------------------------------------------------------------------


class Shown(NamedTuple):
    """A figure of the table."""

    title: str
    field: str  # of `LegFlight`
    factor: float  # from its unit to the title's
    decimals: int


FIGURES: Final = tuple(
    map(
        Shown._make,
        (
            ("settled after [s]", "settling_s", 1.0, 1),
            ("rms e_rho [cm]", "rms_e_rho_m", 100.0, 2),
            ("peak e_rho [cm]", "peak_e_rho_m", 100.0, 1),
            ("rms along [cm]", "rms_along_m", 100.0, 1),
            ("rms y [cm]", "rms_y_m", 100.0, 1),
            ("rms bank [°]", "rms_bank_rad", degrees(1.0), 1),
            ("elevator's rate [1/s]", "rms_elevator_rate_per_s", 1.0, 2),
            ("off TGL ∩ ZEUC [cm]", "off_contour_m", 100.0, 1),
            ("off its own [cm]", "off_own_contour_m", 100.0, 1),
        ),
    )
)


class Figure(NamedTuple):
    """One figure of several flights, in the unit of its field."""

    median: float
    worst: float  # the largest, whatever its sign
    of: int  # flights that have it


class FlightsSummary(NamedTuple):
    """The flights of one leg in one turbulence."""

    leg: str
    turbulence: float
    flights: int
    survived: int
    figures: dict[str, Figure]  # by their fields
    reasons: Counter[str]  # of flights that ended early or in another mode than soaring

    @property
    def interval(self) -> tuple[float, float]:
        """Of the share that lasts, exact (Clopper and Pearson), at 95 %."""
        return interval(self.survived, self.flights)


def summarised(flights: Iterable[LegFlight]) -> list[FlightsSummary]:
    """One for each leg and turbulence, in the order in which they come."""
    numbers: dict[tuple[str, float], dict[str, list[float]]] = {}
    survived: Counter[tuple[str, float]] = Counter()
    reasons: dict[tuple[str, float], Counter[str]] = {}
    for flight in flights:
        key = flight.leg, flight.turbulence
        lists = numbers.setdefault(key, {each.field: [] for each in FIGURES})
        for name, values in lists.items():
            value = getattr(flight, name)
            values.append(nan if value is None else abs(value))
        survived[key] += flight.survived
        reasons.setdefault(key, Counter()).update([flight.reason] if flight.reason else [])
    return [
        FlightsSummary(
            leg=key[0],
            turbulence=key[1],
            flights=len(lists["settling_s"]),
            survived=survived[key],
            figures={name: _figure(values) for name, values in lists.items()},
            reasons=reasons[key],
        )
        for key, lists in numbers.items()
    ]


def _figure(values: Sequence[float]) -> Figure:
    known = np.array(values)
    known = known[~np.isnan(known)]
    if not known.size:
        return Figure(nan, nan, 0)
    return Figure(float(np.median(known)), float(known.max()), int(known.size))


def table_of(summaries: Sequence[FlightsSummary]) -> tuple[list[str], list[list[str]]]:
    """Headings and rows as people read them: of a figure its median and its worst, and of how
    many flights it is where not all have it."""
    shown = [each for each in FIGURES if any(s.figures[each.field].of for s in summaries)]
    head = ["leg", "turbulence", "to the end", "95 % interval"]
    rows = []
    for s in summaries:
        low, high = s.interval
        why = ", ".join(f"{reason} ({n})" for reason, n in s.reasons.most_common())
        rows.append(
            [
                s.leg,
                f"{100 * s.turbulence:g} %",
                f"{s.survived} of {s.flights}",
                f"{100 * low:.1f} to {100 * high:.1f} %",
                *(_cell(each, s.figures[each.field], s.flights) for each in shown),
                why or "–",
            ]
        )
    return [*head, *(each.title for each in shown), "ended by"], rows


def _cell(shown: Shown, figure: Figure, flights: int) -> str:
    if not figure.of:
        return "–"
    median, worst = (
        f"{shown.factor * value:.{shown.decimals}f}" if value < inf else "never"
        for value in (figure.median, figure.worst)
    )
    return f"{median}, {worst}" + (f" ({figure.of} of {flights})" * (figure.of < flights))


def as_markdown(flown: str, summaries: Sequence[FlightsSummary]) -> str:
    """A page: what was flown, and the table."""
    head, rows = table_of(summaries)
    lines = [
        flown,
        "",
        EXPLAINED,
        "",
        f"| {' | '.join(head)} |",
        f"|{'---|' * 2}{'--:|' * (len(head) - 3)}---|",
        *(f"| {' | '.join(row)} |" for row in rows),
    ]
    return "\n".join(lines) + "\n"


EXPLAINED: Final = (
    "Of each figure the median and the worst of all flights that have it, also of those that ended"
    " early, as far as they flew."
)


def as_table(summaries: Sequence[FlightsSummary]) -> tuple[list[str], list[list[Any]]]:
    """Headings and rows for programs: SI units, the turbulence as a fraction."""
    parts = Figure._fields
    head = [
        *("leg", "turbulence", "flights", "survived", "low", "high"),
        *(f"{each.field}_{part}" for each in FIGURES for part in parts),
        "ended_by",
    ]
    rows = [
        [
            *(s.leg, s.turbulence, s.flights, s.survived, *s.interval),
            *(value for each in FIGURES for value in s.figures[each.field]),
            "; ".join(f"{reason}: {n}" for reason, n in s.reasons.most_common()),
        ]
        for s in summaries
    ]
    return head, rows
