"""Scenarios flown in process, many at a time, and what each leg of a flight was worth.

A leg lasts from when the line stands still until the operator's next line.  The first
`SETTLE_S` of it are left to settling; the rest is scored.  e_rho, which the law controls, and
the dispersion along the line, which it does not, are scored apart.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from math import cos, sin, sqrt
from pathlib import Path
from typing import Any, NamedTuple, Protocol, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import WindField
from tgl_soar.air.zeuc import stable_crossing
from tgl_soar.analysis.experiments.random_aircraft import mismatched
from tgl_soar.analysis.experiments.scenario import PreparedScenario, Scenario, prepare
from tgl_soar.analysis.flown_airframe import flown_airframe
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.site import Site, Start
from tgl_soar.control.target_line import TargetLine
from tgl_soar.sim.aircraft import AircraftModel, glide_polar
from tgl_soar.sim.campaign.encoding import digest
from tgl_soar.sim.campaign.executors import Executor, InLine, local
from tgl_soar.sim.campaign.flight_list import Campaign
from tgl_soar.sim.campaign.folder import CampaignFolder, is_finished
from tgl_soar.sim.campaign.run import Progress, fly_all
from tgl_soar.sim.closed_loop import Trajectory, fly
from tgl_soar.sim.compiled_flight import fly_compiled
from tgl_soar.sim.compiled_flight import prepare as prepare_compiled
from tgl_soar.sim.faults import parse_faults
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.score import settling_time
from tgl_soar.sim.sensors import Sensors
from tgl_soar.sim.world import World, flown_aircraft, make_world
from tgl_soar.types import polar_sink

# The gains of the line, without accelerometers and with.
LINE_GAINS = ("RHO_P", "RHO_I", "RHO_D", "RHO_P_IMU", "RHO_I_IMU", "RHO_D_IMU")
SETTLE_S = 5.0
# Where a drawn aircraft's own place is looked for: about the files' one, farther than drawn wind
# and drag (3 % and 10 %) move it where the contour is flattest, at [a] on the hill (2 m).
OWN_REACH_M = 4.0
OWN_GRID_M = 0.01  # excess updraft is straight over it to a millimetre
OWN_STEP_MPS = 0.1  # sink is straight over it to 0.3 mm/s
OWN_FASTEST_MPS = 14.0
KEEP_EVERY = 4  # of a flight's rows one in so many is kept: 50 a second are enough to draw

Floats = NDArray[np.float64]


class ScenarioJob(NamedTuple):
    """One flight to be flown."""

    scenario: Scenario
    seed: int
    # Figures of the aircraft that is flown, `section.key`, where they are not those of the airframe
    # file, which is all that the module on board knows.
    aircraft: tuple[tuple[str, float], ...] = ()
    start_xz_m: tuple[float, float] | None = None  # None: the scenario's
    dispersed: bool = False  # another aircraft than the file's, in other air than the site's


@dataclass(frozen=True)
class ScoredLeg:
    """One line held still; lengths in metres, over the scored part of the leg."""

    line: str
    target: TargetLine
    begin_s: float  # when the line stood still
    end_s: float
    settling_s: float  # from then to the first two seconds within 5 cm of it; inf: never
    rms_e_rho_m: float
    peak_e_rho_m: float
    mean_e_rho_m: float  # drift from the line; what is left about it is oscillation
    rms_y_m: float  # from the middle
    rms_bank_rad: float
    mean_x_m: float
    mean_z_m: float
    along_m: float  # mean place along the line, up from its point
    dispersion_m: float  # standard deviation along the line about that mean
    predicted: tuple[float, float] | None  # TGL ∩ ZEUC (x, z) in the air at the leg's end
    predicted_along_m: float  # the same, along the line; NaN: none
    scored_s: float  # how long was scored
    # The same crossing of the aircraft that flew in the air that blew, where they are not those of
    # the files, on the line that it was in fact held on: by a cubic polar that is fitted to its own
    # glides as the file's is to the file's, and by those glides themselves.  None: they are.
    own_predicted_along_m: float | None = None
    own_glide_along_m: float | None = None

    @property
    def miss_m(self) -> float:
        """Mean place to the place that the files give, along the line, positive up."""
        return self.along_m - self.predicted_along_m

    @property
    def own_along_m(self) -> float:
        """Where line and contour of what flew meet, along the line; NaN: nowhere."""
        own = self.own_predicted_along_m
        return self.predicted_along_m if own is None else own

    @property
    def own_miss_m(self) -> float:
        """Mean place to that, along the line, positive up."""
        return self.along_m - self.own_along_m

    @property
    def glide_miss_m(self) -> float:
        """Mean place to where its own glides put it, along the line; as `own_miss_m` where what
        flew is the files'."""
        own = self.own_glide_along_m
        return self.own_miss_m if own is None else self.along_m - own


@dataclass(frozen=True)
class FlownScenario:
    """One flight."""

    seed: int
    ended: str  # why it ended early; ""
    duration_s: float
    legs: tuple[ScoredLeg, ...]  # those that were reached and scored
    path: dict[str, Floats]  # columns of `closed_loop.Row`, thinned

    @property
    def survived(self) -> bool:
        """Flown to the end."""
        return not self.ended


def fly_job(job: ScenarioJob) -> FlownScenario:
    """Fly one scenario with one seed.  Errors: `ConfigError`."""
    prepared = prepare(job.scenario)
    faults = parse_faults(job.scenario.faults)
    injection = Injection(faults, job.seed) if faults else None
    world = scenario_world(job, prepared, injection)
    trajectory = fly(world, prepared.values, prepared.changes, job.scenario.duration_s, injection)
    return _flown(job, prepared, trajectory)


def fly_job_compiled(job: ScenarioJob) -> FlownScenario:
    """The same flight, compiled.  Errors: `ConfigError`; ValueError for a scenario with faults."""
    if job.scenario.faults:
        raise ValueError(f"{job.scenario.title}: faults are injected into plain flights only")
    prepared = prepare(job.scenario)
    world = prepare_compiled(scenario_world(job, prepared, None), job.scenario.duration_s)
    return _flown(job, prepared, fly_compiled(world, job.seed, prepared.values, prepared.changes))


def _what_flies(
    job: ScenarioJob, prepared: PreparedScenario
) -> tuple[Airframe, Site, WindField, Sensors]:
    """The files' own, or what is drawn in their place."""
    airframe = flown_airframe(prepared.airframe, job.aircraft)
    site, field, sensors = prepared.site, prepared.field, job.scenario.sensors.as_sensors()
    if job.dispersed:
        return mismatched(airframe, site, field, sensors, job.seed)
    return airframe, site, field, sensors


def scenario_world(
    job: ScenarioJob, prepared: PreparedScenario, injection: Injection | None
) -> World:
    """The world of a flight.  Errors: `ConfigError`."""
    airframe, site, field, sensors = _what_flies(job, prepared)
    if job.start_xz_m is not None:
        x_m, z_m = job.start_xz_m
        site = msgspec.structs.replace(site, start=Start(x_m=x_m, z_m=z_m))
    return make_world(
        airframe,
        site,
        seed=job.seed,
        field=field if injection is None else injection.field(field),
        sensors=sensors,
        known=prepared.airframe,
    )


def _flown(job: ScenarioJob, prepared: PreparedScenario, trajectory: Trajectory) -> FlownScenario:
    path = {name: column[::KEEP_EVERY].copy() for name, column in trajectory.columns.items()}
    legs = score_legs(prepared, trajectory)
    if job.dispersed:
        airframe, _, field, _ = _what_flies(job, prepared)
        model = flown_aircraft(airframe)
        assert isinstance(model, AircraftModel)  # `mismatched` draws no other
        glides, cubic = own_glides(model), own_cubic(model)
        legs = tuple(
            replace(
                leg,
                own_predicted_along_m=own_place(leg, field, cubic),
                own_glide_along_m=own_place(leg, field, glides),
            )
            for leg in legs
        )
    return FlownScenario(
        seed=job.seed,
        ended=trajectory.ended,
        duration_s=float(trajectory["time_s"][-1]),
        legs=legs,
        path=path,
    )


def own_cubic(model: AircraftModel) -> tuple[Floats, Floats]:
    """The same of the cubic polar that is fitted to them, as the airframe file's is."""
    polar = glide_polar(model)
    slowest = model.highest_pitch_glide().horizontal_mps
    speeds = np.arange(slowest, OWN_FASTEST_MPS, OWN_STEP_MPS)
    return speeds, np.array([polar_sink(polar, float(speed)) for speed in speeds])


def own_glides(model: AircraftModel) -> tuple[Floats, Floats]:
    """Horizontal airspeeds and sinks [m/s] of an aircraft's steady glides, slowest first."""
    slowest = model.highest_pitch_glide().horizontal_mps
    speeds = np.arange(slowest, OWN_FASTEST_MPS, OWN_STEP_MPS)
    return speeds, np.array([model.glide_at(float(speed)).sink_mps for speed in speeds])


def own_place(leg: ScoredLeg, field: WindField, glides: tuple[Floats, Floats]) -> float:
    """Where an aircraft with these glides hovers stably on the line that it was held on.

    Along the line [m], up from its point; of several such places the nearest to the one that the
    files give.  NaN: there is none within `OWN_REACH_M` of that, or the files give none.
    """
    c, s = cos(leg.target.eta_rad), sin(leg.target.eta_rad)
    x0 = leg.target.x_m - s * leg.mean_e_rho_m
    z0 = leg.target.z_m + c * leg.mean_e_rho_m
    speeds, sinks = glides
    along = leg.predicted_along_m + np.arange(-OWN_REACH_M, OWN_REACH_M, OWN_GRID_M)
    if not np.all(np.isfinite(along)):
        return float("nan")
    u, _, w = field.wind(x0 + c * along, 0.0, z0 + s * along, leg.end_s)
    # NaN, which crosses nothing, where it has no glide and where there is no air.
    excess = w - np.interp(u, speeds, sinks, left=np.nan, right=np.nan)
    at = np.flatnonzero((excess[:-1] >= 0.0) & (excess[1:] < 0.0))
    if not at.size:
        return float("nan")
    places = along[at] + OWN_GRID_M * excess[at] / (excess[at] - excess[at + 1])
    return float(places[np.argmin(np.abs(places - leg.predicted_along_m))])


def score_legs(prepared: PreparedScenario, trajectory: Trajectory) -> tuple[ScoredLeg, ...]:
    """The legs of a flight in the order in which they were flown."""
    scenario = prepared.scenario
    ordered = sorted(scenario.changes, key=lambda change: change.time_s)
    lines = [(0, scenario.first_line)]
    lines += [(i + 1, c.line) for i, c in enumerate(ordered) if c.line is not None]
    ends = [count for count, _ in lines[1:]] + [len(ordered) + 1]
    legs = []
    done, time = trajectory["target_changes"], trajectory["time_s"]
    still = trajectory["line_moving"] == 0.0
    for begin, end in scenario.unscored_s:
        still &= (time < begin) | (time >= end)
    for (count, name), until in zip(lines, ends, strict=True):
        rows = np.flatnonzero(still & (done >= count) & (done < until))
        if len(rows) >= 2:
            leg = _score(prepared, trajectory, name, rows)
            if leg is not None:
                legs.append(leg)
    return tuple(legs)


def _score(
    prepared: PreparedScenario, trajectory: Trajectory, name: str, rows: NDArray[np.intp]
) -> ScoredLeg | None:
    target = prepared.lines[name].target
    time = trajectory["time_s"][rows]
    x, z = trajectory["x_m"][rows], trajectory["z_m"][rows]
    c, s = cos(target.eta_rad), sin(target.eta_rad)
    e = c * (z - target.z_m) - s * (x - target.x_m)
    along = c * (x - target.x_m) + s * (z - target.z_m)
    scored = time >= time[0] + SETTLE_S
    if np.count_nonzero(scored) < 100:
        return None
    settling = settling_time(time, e)
    end = float(time[-1])
    crossing = stable_crossing(prepared.field, prepared.polar, target, end)
    predicted, predicted_along = None, float("nan")
    if crossing is not None:
        predicted = (crossing.x_m, crossing.z_m)
        predicted_along = c * (crossing.x_m - target.x_m) + s * (crossing.z_m - target.z_m)
    return ScoredLeg(
        line=name,
        target=target,
        begin_s=float(time[0]),
        end_s=end,
        settling_s=settling,
        rms_e_rho_m=float(np.sqrt(np.mean(e[scored] ** 2))),
        peak_e_rho_m=float(np.max(np.abs(e[scored]))),
        mean_e_rho_m=float(np.mean(e[scored])),
        rms_y_m=rms(trajectory["y_m"][rows][scored]),
        rms_bank_rad=rms(trajectory["roll_rad"][rows][scored]),
        mean_x_m=float(np.mean(x[scored])),
        mean_z_m=float(np.mean(z[scored])),
        along_m=float(np.mean(along[scored])),
        dispersion_m=float(np.std(along[scored])),
        predicted=predicted,
        predicted_along_m=predicted_along,
        scored_s=end - float(time[0]) - SETTLE_S,
    )


class Timed(Protocol):
    """Whatever lasted for some time."""

    @property
    def duration_s(self) -> float:
        """How long it flew."""
        ...


Wanted = TypeVar("Wanted")
Lasted = TypeVar("Lasted", bound=Timed)


class FlyerProgress(NamedTuple):
    """How far it is with all that was asked for so far."""

    flown: int
    wanted: int
    per_s: float  # flights of the list that is flown
    left_s: float  # of the list that is flown; inf: not known yet


class Flyer:
    """Flies jobs by an executor, and counts; with a folder their flights are kept there."""

    def __init__(
        self,
        workers: int = 0,
        on_flight: Callable[[FlyerProgress], None] | None = None,
        *,
        executor: Executor | None = None,
        folder: FlownFolder | None = None,
    ) -> None:
        """workers: processes, 0 for this one alone, where no executor is given; on_flight is
        called as flights begin to be wanted and are flown."""
        self._executor = executor or local(workers)
        self._on_flight = on_flight or (lambda _progress: None)
        self._folder = folder
        self.flown = self.wanted = 0
        self.simulated_s = 0.0

    def fly(self, jobs: Iterable[ScenarioJob]) -> list[FlownScenario]:
        """Fly all, in the order given.  Errors: `ConfigError`."""
        return self.each(fly_job, jobs)

    def each(
        self,
        fly: Callable[[Wanted], Lasted],
        jobs: Iterable[Wanted],
        *,
        compiled: bool = False,
    ) -> list[Lasted]:
        """What a function that flies one flight makes of each job, in the order given.

        compiled: it compiles.  The first is flown in this process, so that the others find what
        it has compiled.  Errors: those of the function, `JournalError`, `WorkerLost`.
        """
        queue = list(jobs)
        self.wanted += len(queue)
        before = self.flown

        def on_progress(progress: Progress) -> None:
            self.flown = before + progress.flown
            self._on_flight(FlyerProgress(self.flown, self.wanted, *progress[2:]))

        executor: Executor = self._executor if len(queue) > 1 else InLine()
        if self._folder is None:
            flown = fly_all(fly, queue, executor, on_progress=on_progress, first_here=compiled)
        else:
            campaign = self._folder.opened(fly, queue)
            campaign.fly(executor, on_progress, first_here=compiled)
            flown = list(campaign)
        self.simulated_s += sum(each.duration_s for each in flown)
        return flown


class FlownFolder:
    """Where the flights of experiments are kept: a campaign's folder for each list of them.

    An experiment that is run again asks for the same lists in the same order, so that it finds
    its flights again by their number.
    """

    def __init__(
        self, path: Path, *, resume: bool = False, restart: bool = False, named: str = ""
    ) -> None:
        """named: digest of the files that jobs name and do not hold; "": they name none but what
        is shipped."""
        self.path = path
        self._named = {"files": named} if named else {}
        self._options = {"resume": resume, "restart": restart}
        self._experiment = ""
        self._lists = 0
        self._open: list[CampaignFolder[Any, Any]] = []

    def begin(self, experiment: str) -> None:
        """The next flights are of this one."""
        self._experiment, self._lists = experiment, 0

    def opened(
        self, fly: Callable[[Wanted], Lasted], jobs: list[Wanted]
    ) -> CampaignFolder[Wanted, Lasted]:
        """The folder of the next list.  Errors: `JournalError`."""
        self._lists += 1
        name = f"{self._lists:02}-{fly.__name__.strip('_')}"
        seeds = [seed for job in jobs if isinstance(seed := getattr(job, "seed", None), int)]
        campaign = Campaign(
            name=f"{self._experiment} {name}",
            fly=fly,
            jobs=jobs,
            parameters={"experiment": self._experiment, "jobs": digest(jobs), **self._named},
            seeds=(min(seeds), max(seeds)) if seeds else None,
        )
        path = self.path / self._experiment / name
        options = self._options
        if options["resume"] and is_finished(path):  # once more, beside lists that are not
            options = {"resume": False, "restart": options["restart"]}
        folder = CampaignFolder(path, campaign, **options, again=True)
        self._open.append(folder)
        return folder

    def finish(self) -> bool:
        """All is done: tables instead of journals.  Whether there are tables.

        No journal goes before every table is there: a list without one cannot be gone on with.
        Errors: `JournalError`.
        """
        written = [folder.tabulate() for folder in self._open]
        for folder in self._open:
            folder.conclude()
        return all(written)

    def close(self) -> None:
        """What is unfinished stays, to be gone on with."""
        for folder in self._open:
            folder.close()


def pooled_dispersion(legs: Sequence[ScoredLeg]) -> float:
    """Standard deviation along the line [m] of several flights of one leg, each about its own
    place and the mean distance from it.

    The mean of one flight follows its own slow dispersion; taken over all flights it does not.
    Where each flight has an aircraft of its own, what sets their places apart is not in it.
    """
    own = np.array([leg.own_miss_m for leg in legs])
    if not np.all(np.isfinite(own)):  # no contour: there is no place to be off
        own = np.array([leg.along_m for leg in legs])
    inside = np.array([leg.dispersion_m for leg in legs])
    return float(np.sqrt(np.mean(inside**2 + (own - own.mean()) ** 2)))


class MeanOfFlights(NamedTuple):
    """A mean of one figure of each flight."""

    mean: float
    error: float  # standard error: of the flights' own figures; inf of fewer than two
    apart: float  # standard deviation of the flights' own figures; 0 of fewer than two


def mean_of_flights(values: Iterable[float]) -> MeanOfFlights:
    """A flight is one draw, of its air and where they are drawn of its aircraft: its samples in
    time say nothing of another.  NaN of nothing."""
    array = np.fromiter(values, dtype=np.float64)
    if not array.size:
        return MeanOfFlights(float("nan"), float("inf"), float("nan"))
    if array.size == 1:
        return MeanOfFlights(float(array[0]), float("inf"), 0.0)
    apart = float(np.std(array, ddof=1))
    return MeanOfFlights(float(np.mean(array)), apart / sqrt(array.size), apart)


def rms(values: Iterable[float]) -> float:
    """Root of the mean square; NaN of nothing."""
    array = np.fromiter(values, dtype=np.float64)
    return float(np.sqrt(np.mean(array**2))) if array.size else float("nan")


def rms_error(squares: Sequence[float]) -> float:
    """Relative standard error of the root of a mean square, by the flights' own squares; inf of
    fewer than two."""
    if len(squares) < 2 or not any(squares):
        return float("inf")
    # Half the relative error of the mean square.
    of_flights = mean_of_flights(squares)
    return 0.5 * of_flights.error / of_flights.mean


def legs_named(flights: Sequence[FlownScenario], line: str) -> list[ScoredLeg]:
    """The legs on one line, of all flights that reached it."""
    return [leg for flight in flights for leg in flight.legs if leg.line == line]
