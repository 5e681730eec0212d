"""Scenarios flown in process, many at a time, and what each leg of a flight was worth.

A leg lasts from when the line stands still until the operator's next line.  The first
`SETTLE_S` of it are left to settling; the rest is scored.  e_rho, which the law controls, and
the dispersion along the line, which it does not, are scored apart.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import (
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
    as_completed,
)
from dataclasses import dataclass
from math import cos, sin
from types import TracebackType
from typing import NamedTuple, Protocol, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.zeuc import stable_crossing
from tgl_soar.analysis.experiments.scenario import PreparedScenario, Scenario, prepare
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.site import Start
from tgl_soar.control.target_line import TargetLine
from tgl_soar.sim.closed_loop import Trajectory, fly
from tgl_soar.sim.fast_flight import fly_compiled
from tgl_soar.sim.fast_flight import prepare as prepare_compiled
from tgl_soar.sim.faults import parse_faults
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.score import settling_time
from tgl_soar.sim.world import World, make_world

SETTLE_S = 5.0
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

    @property
    def miss_m(self) -> float:
        """Mean place to predicted place, along the line, positive up."""
        return self.along_m - self.predicted_along_m


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
    world = _world(job, prepared, injection)
    trajectory = fly(world, prepared.values, prepared.changes, job.scenario.duration_s, injection)
    return _flown(job, prepared, trajectory)


def fly_job_compiled(job: ScenarioJob) -> FlownScenario:
    """The same flight, compiled.  Errors: `ConfigError`; ValueError for a scenario with faults."""
    if job.scenario.faults:
        raise ValueError(f"{job.scenario.title}: faults are injected into plain flights only")
    prepared = prepare(job.scenario)
    world = prepare_compiled(_world(job, prepared, None), job.scenario.duration_s)
    return _flown(job, prepared, fly_compiled(world, job.seed, prepared.values, prepared.changes))


def flown_airframe(airframe: Airframe, figures: Iterable[tuple[str, float]]) -> Airframe:
    """The aircraft with other figures than its file.  Errors: ValueError for an unknown one."""
    for name, value in figures:
        section, _, key = name.partition(".")
        if section == "model" and key in airframe.model:
            airframe = msgspec.structs.replace(airframe, model={**airframe.model, key: value})
        elif section == "airframe" and hasattr(airframe.airframe, key):
            bench = msgspec.structs.replace(airframe.airframe, **{key: value})
            airframe = msgspec.structs.replace(airframe, airframe=bench)
        else:
            raise ValueError(f"{name}: no figure of [airframe] or [model] of this airframe")
    return airframe


def _world(job: ScenarioJob, prepared: PreparedScenario, injection: Injection | None) -> World:
    site = prepared.site
    if job.start_xz_m is not None:
        x_m, z_m = job.start_xz_m
        site = msgspec.structs.replace(site, start=Start(x_m=x_m, z_m=z_m))
    world = make_world(
        flown_airframe(prepared.airframe, job.aircraft),
        site,
        seed=job.seed,
        field=prepared.field if injection is None else injection.field(prepared.field),
        sensors=job.scenario.sensors.as_sensors(),
    )
    world.aerodynamics = prepared.airframe.aerodynamics()
    return world


def _flown(job: ScenarioJob, prepared: PreparedScenario, trajectory: Trajectory) -> FlownScenario:
    path = {name: column[::KEEP_EVERY].copy() for name, column in trajectory.columns.items()}
    return FlownScenario(
        job.seed,
        trajectory.ended,
        float(trajectory["time_s"][-1]),
        score_legs(prepared, trajectory),
        path,
    )


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
        name,
        target,
        float(time[0]),
        end,
        settling,
        float(np.sqrt(np.mean(e[scored] ** 2))),
        float(np.max(np.abs(e[scored]))),
        float(np.mean(e[scored])),
        rms(trajectory["y_m"][rows][scored]),
        rms(trajectory["roll_rad"][rows][scored]),
        float(np.mean(x[scored])),
        float(np.mean(z[scored])),
        float(np.mean(along[scored])),
        float(np.std(along[scored])),
        predicted,
        predicted_along,
        end - float(time[0]) - SETTLE_S,
    )


class Timed(Protocol):
    """Whatever lasted for some time."""

    @property
    def duration_s(self) -> float:
        """How long it flew."""
        ...


Wanted = TypeVar("Wanted")
Lasted = TypeVar("Lasted", bound=Timed)


class Flyer:
    """Flies jobs on all cores it is given, or in this process with `workers` = 0."""

    def __init__(
        self, workers: int = 0, on_flight: Callable[[int, int], None] | None = None
    ) -> None:
        """on_flight(flown, wanted) is called as flights begin to be wanted and are flown."""
        self._workers = workers
        self._pool = ProcessPoolExecutor(workers) if workers > 0 else None
        self._on_flight = on_flight or (lambda _flown, _wanted: None)
        self.flown = self.wanted = 0
        self.simulated_s = 0.0

    def __enter__(self) -> Flyer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)

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

        compiled: in threads of this process, where it compiles only once and holds no lock.
        """
        queue = list(jobs)
        self.wanted += len(queue)
        self._on_flight(self.flown, self.wanted)
        if self._pool is None:
            return [self._count(fly(job)) for job in queue]
        if compiled:
            with ThreadPoolExecutor(self._workers) as threads:
                return self._all(threads, fly, queue)
        return self._all(self._pool, fly, queue)

    def _all(
        self, pool: Executor, fly: Callable[[Wanted], Lasted], queue: list[Wanted]
    ) -> list[Lasted]:
        futures: list[Future[Lasted]] = [pool.submit(fly, job) for job in queue]
        for future in as_completed(futures):
            self._count(future.result())
        return [future.result() for future in futures]

    def _count(self, flown: Lasted) -> Lasted:
        self.flown += 1
        self.simulated_s += flown.duration_s
        self._on_flight(self.flown, self.wanted)
        return flown


def pooled_dispersion(legs: Sequence[ScoredLeg]) -> float:
    """Standard deviation along the line [m] of several flights of one leg, about their mean.

    The mean of one flight follows its own slow dispersion; taken over all flights it does not.
    """
    along = np.array([leg.along_m for leg in legs])
    inside = np.array([leg.dispersion_m for leg in legs])
    return float(np.sqrt(np.mean(inside**2 + (along - along.mean()) ** 2)))


def rms(values: Iterable[float]) -> float:
    """Root of the mean square; NaN of nothing."""
    array = np.fromiter(values, dtype=np.float64)
    return float(np.sqrt(np.mean(array**2))) if array.size else float("nan")


def legs_named(flights: Sequence[FlownScenario], line: str) -> list[ScoredLeg]:
    """The legs on one line, of all flights that reached it."""
    return [leg for flight in flights for leg in flight.legs if leg.line == line]
