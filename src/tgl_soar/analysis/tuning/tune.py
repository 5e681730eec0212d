"""From an airframe file to gains and their schedule.

    1. anchor   the gains that are flown now, as found on this airframe (`found_gains.anchored`)
    2. search   each set on the linear model (`search`), margins as constraints
    3. choose   in flight, between the best and those with more margin: by who stays up, then e_rho
    4. judge    on the linear model and in flight, on aircraft and air that served nothing before,
                the gains of before beside them

All that is found is kept on disk as it is found (`progress_file`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from tgl_soar.analysis.tuning import flights
from tgl_soar.analysis.tuning.aircraft import Ranges
from tgl_soar.analysis.tuning.demands import (
    FOR_CHOICE,
    FOR_JUDGING,
    Demands,
    Given,
    Places,
    drawn_place,
    given_by,
    place_margin,
    places_of,
)
from tgl_soar.analysis.tuning.progress_file import ProgressFile
from tgl_soar.analysis.tuning.search import (
    Candidate,
    Search,
    Values,
    finalists,
    read,
    searched,
    stored,
)
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_site
from tgl_soar.config.parameters import ANCHORS, INDEX, PARAMETERS, ParameterSet
from tgl_soar.config.site import air_files
from tgl_soar.control.found_gains import (
    SETS,
    SHIPPED,
    SOUGHT,
    anchored,
    gains_of,
    with_gains,
)
from tgl_soar.control.loop_margin import FLOOR
from tgl_soar.sim.campaign.encoding import digest as digest_of
from tgl_soar.sim.campaign.executors import Executor
from tgl_soar.sim.campaign.manifest import Manifest, key_of, manifest_of, now
from tgl_soar.sim.campaign.provenance import files_digest, installed_version
from tgl_soar.sim.campaign.run import fly_all

CHUNK = 8  # flights between two savings of progress


class Effort(NamedTuple):
    """How much is sought and flown."""

    generations: int = 40
    aircraft: int = 6  # drawn, in the search
    grid: int = 3  # speeds, leans and latencies, each
    choosing: int = 8  # aircraft flown with each finalist
    judging: int = 16  # aircraft flown, with the gains of before and of after
    judging_linear: int = 60  # aircraft on the linear model
    flight_s: float = flights.DURATION_S


QUICK = Effort(
    generations=2, aircraft=1, grid=1, choosing=0, judging=0, judging_linear=2, flight_s=10.0
)
TURBULENCES = (0.03, 0.05)


class Task(NamedTuple):
    """What is to be tuned."""

    airframe: Airframe
    site_path: Path
    values: ParameterSet  # of airframe and site, on the line to be flown
    lean_deg: float  # of the line that gains are sought for
    seed: int = 1
    effort: Effort = Effort()
    floor: float = FLOOR
    ranges: Ranges = Ranges()  # of the aircraft that the gains are to serve


class Judged(NamedTuple):
    """Aircraft that served nothing before, on the linear model."""

    aircraft: int
    unstable: int
    below_floor: int
    least_alpha: float


class FlownRow(NamedTuple):
    """Such aircraft in flight."""

    kind: str
    turbulence: float
    before: flights.Outcomes
    after: flights.Outcomes


class TuningFlight(NamedTuple):
    """A flight of a drawn aircraft, by which gains are chosen or judged."""

    gains: str  # whose: a finalist's, or those of before and of after
    kind: str
    turbulence: float
    aircraft: int  # by its number: the same for all gains and both turbulences of a purpose
    judges: bool  # else it chooses


class Tuned(NamedTuple):
    """What was found."""

    values: ParameterSet
    parameters: dict[str, float]  # those to be written
    before: dict[str, Given]  # by set, on the demands of the search
    after: dict[str, Given]
    judged_before: dict[str, Judged]
    judged: dict[str, Judged]
    flown: list[FlownRow]
    candidates: dict[str, list[Candidate]]
    flights: list[tuple[TuningFlight, flights.DrawnFlight]]  # all, in their order


Report = Callable[[str, float], None]  # what is being done, and how much of it, 0 … 1


def manifest(task: Task) -> Manifest:
    """Where a result comes from, as campaigns tell it; before any run.  Errors: `ConfigError`."""
    site = load_site(task.site_path)
    air = files_digest(air_files(site.air, task.site_path.parent)) if site.air is not None else ""
    parameters = {
        "airframe": digest_of(task.airframe),
        "site": digest_of(site),
        "air": air,
        "autopilot": digest_of(task.values),
        "lean_deg": task.lean_deg,
        "seed": task.seed,
        "floor": task.floor,
        "effort": task.effort._asdict(),
        "ranges": task.ranges._asdict(),
        "cma": installed_version("cma"),  # which asks; the answers have its questions' numbers
    }
    return manifest_of("tune", tune, 1, parameters, (task.seed, task.seed))


def digest(task: Task) -> str:
    """Of all that the result depends on, source and libraries among it."""
    return key_of(manifest(task))


def concluded(task: Task, progress: ProgressFile) -> Manifest:
    """The manifest of a result that is there, with who found it."""
    found = manifest(task)
    found.runs, found.complete = progress.runs, True
    found.runs[-1]["ended"] = now()
    return found


def tune(task: Task, progress: ProgressFile, report: Report, executor: Executor) -> Tuned:
    """Gains for an airframe, the same whoever evaluates and flies.

    Errors: ValueError for an airframe that is not known well enough, `ConfigError`,
    `ParameterError`, ImportError without `cma`, OSError where progress cannot be written.
    """
    start = anchored(task.values, task.lean_deg)
    demands = Demands(
        airframe=task.airframe,
        values=start,
        ranges=task.ranges,
        aircraft=task.effort.aircraft,
        seed=task.seed,
        grid=task.effort.grid,
    )
    field = flights.FlyingPlace(
        airframe=task.airframe,
        site_path=task.site_path,
        ranges=demands.ranges,
        duration_s=task.effort.flight_s,
    )
    _check_air(task, field, start)
    candidates: dict[str, list[Candidate]] = {}
    after: dict[str, Given] = {}
    values = start
    progress.begin(executor.description)
    pool = _Pool(executor, demands)
    for kind in SETS:
        candidates[kind] = _candidates(task, start, kind, pool, progress, report)
    at_work = _AtWork(
        task=task, field=field, pool=pool, progress=progress, report=report, flights=[]
    )
    before = {kind: _before(at_work, kind) for kind in SETS}
    for kind in SETS:
        chosen = _chosen(at_work, start, kind, candidates[kind])
        after[kind] = chosen.given
        values = with_gains(values, kind, chosen.gains)
    both = (task.values, values)
    flown = [
        _judged_in_flight(at_work, both, kind, turbulence)
        for kind in SETS
        for turbulence in TURBULENCES
        if task.effort.judging
    ]
    judged_before, judged = ({k: _judged(at_work, v, k) for k in SETS} for v in both)
    return Tuned(
        values=values,
        parameters=_written(values),
        before=before,
        after=after,
        judged_before=judged_before,
        judged=judged,
        flown=flown,
        candidates=candidates,
        flights=at_work.flights,
    )


def _check_air(task: Task, field: flights.FlyingPlace, start: ParameterSet) -> None:
    """Before minutes of search: whether any aircraft has a place to fly at, where some are to fly.

    Errors: ValueError, `ConfigError`.
    """
    purposes = ((FOR_CHOICE, task.effort.choosing), (FOR_JUDGING, task.effort.judging))
    for purpose, count in purposes:
        if count:
            flights.soaring_aircraft(field, start, (task.seed, purpose, 0))


# --- the search ----------------------------------------------------------------------------------


def _candidates(
    task: Task,
    start: ParameterSet,
    kind: str,
    pool: _Pool,
    progress: ProgressFile,
    report: Report,
) -> list[Candidate]:
    pool.prepare(kind)

    def evaluate(points: Sequence[Values]) -> list[Given]:
        return pool.map(_given_of, [(kind, with_gains(start, kind, gains)) for gains in points])

    def on_generation(name: str, n: int, best: Candidate) -> None:
        found = best.given
        words = f"{name}: margin {found.alpha:.2f}, e_rho {100.0 * found.e_rho_m:.2f} cm"
        report(words, n / max(1, task.effort.generations))

    return searched(kind, search_of(task, start, kind), evaluate, progress, on_generation)


def search_of(task: Task, start: ParameterSet, kind: str) -> Search:
    allowed = [PARAMETERS[INDEX[name]] for name in SOUGHT[kind]]
    return Search(
        start=tuple(gains_of(start, kind)),
        low=tuple(max(p.minimum, 1e-3) for p in allowed),
        high=tuple(p.maximum for p in allowed),
        generations=task.effort.generations,
        seed=task.seed,
        floor=task.floor,
    )


def _written(values: ParameterSet) -> dict[str, float]:
    """All that the search changed, and what it is anchored to."""
    names = (*ANCHORS, *SHIPPED)
    return {p.name: values[p.name] for p in PARAMETERS if p.name in names}


# --- in flight, and judged -----------------------------------------------------------------------


class _AtWork(NamedTuple):
    """What every flight of a task shares."""

    task: Task
    field: flights.FlyingPlace
    pool: _Pool
    progress: ProgressFile
    report: Report
    flights: list[tuple[TuningFlight, flights.DrawnFlight]]  # those that were flown


def _chosen(
    at_work: _AtWork, start: ParameterSet, kind: str, candidates: Sequence[Candidate]
) -> Candidate:
    """Of the finalists the one that loses the fewest, and keeps the line best."""
    task = at_work.task
    found = finalists(candidates, search_of(task, start, kind))
    if task.effort.choosing == 0 or len(found) == 1:
        return found[0]

    def merit(which: int) -> tuple[int, float]:
        values = with_gains(start, kind, found[which].gains)
        lost, square = 0, 0.0
        for turbulence in TURBULENCES:
            what = f"{kind}: finalist {which + 1} of {len(found)} at {100.0 * turbulence:g} %"
            flies = TuningFlight(
                gains=f"finalist {which + 1}",
                kind=kind,
                turbulence=turbulence,
                aircraft=0,
                judges=False,
            )
            flown = _flown(at_work, values, flies, task.effort.choosing, what)
            lost += flown.of - flown.up
            square += flown.rms_e_rho_m**2
        return lost, square

    return found[min(range(len(found)), key=merit)]


def _judged_in_flight(
    at_work: _AtWork, both: tuple[ParameterSet, ParameterSet], kind: str, turbulence: float
) -> FlownRow:
    """The gains of before and of after, on the same aircraft in the same air."""
    count = at_work.task.effort.judging
    before, after = (
        _flown(
            at_work,
            values,
            TuningFlight(gains=name, kind=kind, turbulence=turbulence, aircraft=0, judges=True),
            count,
            f"{kind}: judging {name} at {100.0 * turbulence:g} %",
        )
        for name, values in zip(("before", "after"), both, strict=True)
    )
    return FlownRow(kind, turbulence, before, after)


def _flown(
    at_work: _AtWork, values: ParameterSet, flies: TuningFlight, count: int, what: str
) -> flights.Outcomes:
    task, field, pool, progress, report, known = at_work
    purpose = FOR_JUDGING if flies.judges else FOR_CHOICE
    kind, turbulence = flies.kind, flies.turbulence
    flown: list[flights.DrawnFlight] = []
    for first in range(0, count, CHUNK):
        attempts = [
            flights.Attempt(values, kind, (task.seed, purpose, i), turbulence)
            for i in range(first, min(count, first + CHUNK))
        ]
        report(what, first / count)
        rows = progress.answer(
            f"{what}, from {first}",
            lambda attempts=attempts: pool.map(_flight_of, [(field, a) for a in attempts]),  # type: ignore[misc]
        )
        flown += [flights.DrawnFlight._make(row) for row in rows]
    known += [(flies._replace(aircraft=i), each) for i, each in enumerate(flown)]
    return flights.survival(flown)


def _before(at_work: _AtWork, kind: str) -> Given:
    """What the gains that are flown now give, on the demands of the search."""
    job = (kind, at_work.task.values)
    (found,) = at_work.progress.answer(
        f"{kind}: as it is", lambda: [stored(given) for given in at_work.pool.map(_given_of, [job])]
    )
    return read(found)


def _judged(at_work: _AtWork, values: ParameterSet, kind: str) -> Judged:
    """Aircraft on the linear model that served nothing before."""
    task, pool, progress, report = at_work.task, at_work.pool, at_work.progress, at_work.report
    count = task.effort.judging_linear
    gains = ", ".join(f"{values[name]:.9g}" for name in (*SOUGHT[kind], *ANCHORS))
    report(f"{kind}: margins of {count} more aircraft", 0.0)
    alphas = progress.answer(
        f"{kind}: margins of {count} with {gains}",
        lambda: pool.map(
            _alpha_of, [(kind, values, (task.seed, FOR_JUDGING, i)) for i in range(count)]
        ),
    )
    return Judged(
        aircraft=count,
        unstable=sum(alpha <= 0.0 for alpha in alphas),
        below_floor=sum(alpha < task.floor for alpha in alphas),
        least_alpha=min(alphas),
    )


# --- processes -----------------------------------------------------------------------------------


class _Pool:
    """Whoever evaluates: what is looked at a list at a time, by this process or by others."""

    def __init__(self, executor: Executor, demands: Demands) -> None:
        self._executor = executor
        self._demands = demands
        self._known: set[_Evaluates] = set()

    def map(self, function: _Evaluates, jobs: Sequence[Any]) -> list[Any]:
        """In the order of the jobs."""
        first_here = function not in self._known  # what it compiles and loads is there for all
        self._known.add(function)
        return fly_all(
            partial(function, self._demands), jobs, self._executor, first_here=first_here
        )

    def prepare(self, kind: str) -> None:
        """Find the places of a kind here, once for all processes that are split off."""
        _places_of(self._demands, kind)


_Evaluates = Callable[[Demands, Any], Any]
# Of this process, for the demands that it was last asked: another computer's worker finds its own.
_places: dict[str, tuple[Demands, Places]] = {}


def _given_of(demands: Demands, job: tuple[str, ParameterSet]) -> Given:
    kind, values = job
    return given_by(_places_of(demands, kind), values)


def _places_of(demands: Demands, kind: str) -> Places:
    if kind not in _places or _places[kind][0] != demands:
        _places[kind] = demands, places_of(demands, kind)
    return _places[kind][1]


def _alpha_of(demands: Demands, job: tuple[str, ParameterSet, tuple[int, ...]]) -> float:
    kind, values, seed = job
    return place_margin(drawn_place(demands, kind, seed), values)


def _flight_of(_: Demands, job: tuple[flights.FlyingPlace, flights.Attempt]) -> flights.DrawnFlight:
    return flights.fly_attempt(*job)
