"""Thousands of flights, each with faults drawn by lot, and what became of every one.

A flight lasts 30 s in turbulence drawn from 0 to 2 %, on line b of the tunnel, with every sensor
aboard.  Three in four have one fault, of each kind of the catalogue in turn; one in four has two
of any kind at once.  All act between 5 s and the middle of the flight, so that there is time to
come back to the line.

At every tick the command is looked at by this module's own arithmetic, not by the envelope's:
finite, within travel, and no faster than the surface may move.

`soaring`   at the end of the flight it is on the line again
`flying`    at the end it is still in control and on its way back to the line
`released`  it disengaged by itself, for a reason that it reported
`lost`      the aircraft hit something, or left the air, while the module had the surfaces
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from math import isfinite, sqrt
from random import Random
from typing import Final, NamedTuple, overload

from tgl_soar.air.field import WindField
from tgl_soar.analysis.experiments.pages import between
from tgl_soar.analysis.experiments.random_aircraft import mismatched
from tgl_soar.autopilot import Output, mode_name, reason_text
from tgl_soar.config.airframe import Airframe, ModelKind
from tgl_soar.config.files import line_parameters, load_flight, shipped
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Site
from tgl_soar.sim.campaign.encoding import digest
from tgl_soar.sim.campaign.flight_list import Campaign
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.compiled import available
from tgl_soar.sim.compiled_flight import CompiledLoop, CompiledWorld, prepare
from tgl_soar.sim.faults import CATALOGUE, Fault, drawn_fault, parse_fault
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, READ_BACK, USUAL_SENSORS, Sensors
from tgl_soar.sim.world import World, make_world, site_field
from tgl_soar.types import SurfaceCommand

DURATION_S: Final = 30.0
TURBULENCE: Final = 0.02  # drawn from 0 to this
TWO_OF: Final = 4  # one flight in so many has two faults
PAIRS: Final = "two at once"
# It flies without a brake, a rangefinder and a firmware.
NOT_DRAWN: Final = ("brake.", "rangefinder.", "transmitter.", "station.", "position.reckoned")
DRAWN: Final = tuple(name for name in CATALOGUE if not name.startswith(NOT_DRAWN))
LINE: Final = "b"
# What an operator sets for this line: nearer to the board, lower or further than this is trouble.
ENVELOPE: Final = {
    "CLEAR_MIN": 0.4, "FENCE_Z_MIN": 0.8, "FENCE_Z_MAX": 2.6, "FENCE_Y_MAX": 1.2,
    "FENCE_X_MIN": -0.4, "FENCE_X_MAX": 2.0,
}  # fmt: skip

EVERY_SENSOR: Final = "every sensor"
POSE_ALONE: Final = "position and attitude alone"
SENSORS: Final = {
    EVERY_SENSOR: Sensors(imu=MEMS_IMU, airspeed=PITOT, surfaces=READ_BACK),
    POSE_ALONE: USUAL_SENSORS,
}

SOARING: Final = "soaring"
FLYING: Final = "flying"
RELEASED: Final = "released"
LOST: Final = "lost"
RESULTS: Final = (SOARING, FLYING, RELEASED, LOST)

ENDED_MODES: Final = ("released", "failed")
NOISY: Final = 1e-9  # of a deflection: what rounding may add


class FaultJob(NamedTuple):
    """One flight to be flown."""

    row: str  # of the table
    seed: int
    turbulence: float
    faults: tuple[Fault, ...]
    aboard: str = EVERY_SENSOR
    model: ModelKind | None = None  # None: the airframe file's
    dispersed: bool = False  # another aircraft than the file's, in other air than the site's


class Outcome(NamedTuple):
    """What became of it."""

    row: str
    seed: int
    faults: str
    result: str  # SOARING, FLYING, RELEASED or LOST
    reason: str  # as the module reported it, or what was hit
    ended_s: float
    bad_commands: int
    error: str  # an exception's words; "" for none


@dataclass(frozen=True)
class Survival:
    """Flights that all meet the same fault."""

    fault: str
    turbulence: float
    aboard: str
    flights: int
    survived: int

    @property
    def fraction(self) -> float:
        """That flew to the end."""
        return self.survived / self.flights

    @property
    def interval(self) -> tuple[float, float]:
        """In which the true share lies, at 95 %."""
        return wilson(self.survived, self.flights)


def wilson(successes: int, of: int) -> tuple[float, float]:
    """Wilson's score interval of a share, at 95 %."""
    z2 = 1.959964**2
    fraction = successes / of
    centre = (fraction + z2 / (2 * of)) / (1 + z2 / of)
    half = sqrt(z2 * (fraction * (1 - fraction) / of + z2 / (4 * of * of))) / (1 + z2 / of)
    return max(0.0, centre - half), min(1.0, centre + half)


# --- the jobs ----------------------------------------------------------------------------------


def drawn_job(i: int, seed: int) -> FaultJob:
    """Flight `i` of a campaign."""
    kinds = [CATALOGUE[name] for name in DRAWN]
    random = Random(f"{seed}/{i}")
    turbulence = round(random.uniform(0.0, TURBULENCE), 4)
    if i % TWO_OF == TWO_OF - 1:
        both = tuple(drawn_fault(random.choice(kinds), random) for _ in range(2))
        return FaultJob(row=PAIRS, seed=seed + i, turbulence=turbulence, faults=both)
    kind = kinds[(i - i // TWO_OF) % len(kinds)]  # each in turn, the pairs left out
    fault = drawn_fault(kind, random)
    return FaultJob(row=kind.name, seed=seed + i, turbulence=turbulence, faults=(fault,))


SURVIVALS: Final = tuple(  # fault, turbulence, what is aboard
    (fault, turbulence, aboard)
    for fault, turbulence in (
        ("position.dropout start=12 for=0.5", 0.03),
        ("position.dropout start=12 for=1.5", 0.01),
    )
    for aboard in SENSORS
)


def survival_job(which: int, i: int, seed: int) -> FaultJob:
    """Flight `i` with one of the drop-outs that must be survived."""
    text, turbulence, aboard = SURVIVALS[which]
    return FaultJob(
        row=_name(text, turbulence, aboard),
        seed=seed + i,
        turbulence=turbulence,
        faults=(parse_fault(text),),
        aboard=aboard,
    )


@dataclass(frozen=True)
class FaultJobs(Sequence[FaultJob]):
    """All flights of a campaign, each drawn when it is asked for: first those with faults drawn
    at random, then each drop-out that must be survived."""

    flights: int
    dropouts: int  # of each
    seed: int
    model: ModelKind | None = None  # None: the airframe file's
    dispersed: bool = False

    def __len__(self) -> int:
        return self.flights + self.dropouts * len(SURVIVALS)

    @overload
    def __getitem__(self, i: int) -> FaultJob: ...

    @overload
    def __getitem__(self, i: slice) -> list[FaultJob]: ...

    def __getitem__(self, i: int | slice) -> FaultJob | list[FaultJob]:
        if isinstance(i, slice):
            return [self[each] for each in range(*i.indices(len(self)))]
        if not 0 <= i < len(self):
            raise IndexError(i)
        if i < self.flights:
            job = drawn_job(i, self.seed)
        else:
            job = survival_job(*divmod(i - self.flights, self.dropouts), self.seed)
        return job._replace(model=self.model, dispersed=self.dispersed)


def campaign_of(jobs: FaultJobs) -> Campaign[FaultJob, Outcome]:
    """The flights for the runner."""
    values = digest(place().values)
    parameters = {**asdict(jobs), "duration_s": DURATION_S, "autopilot": values}
    seeds = (jobs.seed, jobs.seed + max(jobs.flights, jobs.dropouts) - 1)
    return Campaign(name="faults", fly=fly_fault_job, jobs=jobs, parameters=parameters, seeds=seeds)


def _name(text: str, turbulence: float, aboard: str) -> str:
    return f"{text} at {turbulence * 100:g} %, {aboard}"


# --- one flight --------------------------------------------------------------------------------


class CampaignPlace(NamedTuple):
    """Where all fly."""

    airframe: Airframe
    site: Site
    values: ParameterSet
    field: WindField


@lru_cache(maxsize=1)
def place() -> CampaignPlace:
    """The tunnel, line b."""
    airframe_path, site_path = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
    airframe, site, values = load_flight(airframe_path, site_path)
    assert site.air is not None
    values = values.changed({**line_parameters(site.lines[LINE]), **ENVELOPE})
    return CampaignPlace(airframe, site, values, site_field(site, site_path.parent))


def world_of(job: FaultJob, injection: Injection, duration_s: float = DURATION_S) -> World:
    """The world of a flight, compiled where numba is there."""
    airframe, site, _, field = place()
    known, sensors = airframe.flown_as(job.model), SENSORS[job.aboard]
    airframe = known
    if job.dispersed:
        airframe, site, field, sensors = mismatched(airframe, site, field, sensors, job.seed)
    world = make_world(
        airframe,
        site,
        seed=job.seed,
        turbulence=max(job.turbulence, 1e-6),  # one compiled kind of air for all
        field=injection.field(field),
        sensors=sensors,
        known=known,
    )
    return CompiledWorld(prepare(world, duration_s), job.seed) if available() else world


class CommandCheck:
    """Looks at every command that is sent; independent of what limits them."""

    def __init__(self, values: ParameterSet, dt_s: float) -> None:
        self.bad = 0
        self._travel = values["SURF_MAX"] + NOISY
        self._most = values["SURF_RATE"] * dt_s + NOISY
        self._last: SurfaceCommand | None = None

    def look(self, output: Output) -> None:
        """At one tick."""
        if not output.active:
            self._last = None
            return
        command, last = output.command, self._last
        good = all(isfinite(u) and abs(u) <= self._travel for u in command)
        if good and last is not None:
            good = all(abs(u - v) <= self._most for u, v in zip(command, last, strict=True))
        self.bad += not good
        if all(map(isfinite, command)):
            self._last = command


def fly_job(job: FaultJob, duration_s: float = DURATION_S) -> Outcome:
    """Fly one; an exception is an outcome too."""
    injection = Injection(job.faults, job.seed)
    values = place().values
    world = world_of(job, injection, duration_s)
    check = CommandCheck(values, 1.0 / world.step_hz)
    result, reason, error = "", "", ""
    loop = (CompiledLoop if available() else ClosedLoop)(world, values, injection)
    try:
        for _ in range(round(duration_s * world.step_hz)):
            output = loop.tick()
            check.look(output)
            if mode_name(output.mode) in ENDED_MODES:
                result, reason = RELEASED, reason_text(output.reason)
                break
            if world.crashed:
                result, reason = LOST, world.crashed.partition(" at x")[0]
                break
    except Exception as raised:
        result, error = LOST, repr(raised)
    if not result:
        mode = mode_name(loop.output.mode) if loop.output else ""
        result = SOARING if mode == "soaring" else FLYING
        reason = "" if mode == "soaring" else mode
    return Outcome(
        row=job.row,
        seed=job.seed,
        faults="; ".join(str(fault) for fault in job.faults),
        result=result,
        reason=reason,
        ended_s=world.time_s,
        bad_commands=check.bad,
        error=error,
    )


def fly_fault_job(job: FaultJob) -> Outcome:
    """Fly one, as long as all."""
    return fly_job(job)


# --- what became of them -----------------------------------------------------------------------


class FaultRow(NamedTuple):
    """The flights of one fault."""

    name: str
    flights: int
    results: Counter[str]
    reasons: Counter[str]  # of those that disengaged or were lost


class Counted(NamedTuple):
    """What became of all flights."""

    rows: list[FaultRow]  # by fault, in the catalogue's order, pairs last
    survivals: list[Survival]  # of the drop-outs that must be survived
    results: Counter[str]  # of the rows
    bad_commands: int  # of all, drop-outs included, as are the next two
    raised: int
    troubles: list[Outcome]  # lost, or with bad commands, or ended by an exception

    @property
    def flights(self) -> int:
        """With faults drawn at random."""
        return self.results.total()


def count(outcomes: Iterable[Outcome]) -> Counted:
    """One by one: however many there are, they are never in memory together."""
    results: dict[str, Counter[str]] = {name: Counter() for name in (*DRAWN, PAIRS)}
    reasons: dict[str, Counter[str]] = {name: Counter() for name in results}
    lengths: dict[str, Counter[bool]] = {_name(*each): Counter() for each in SURVIVALS}
    bad_commands = raised = 0
    troubles = []
    for o in outcomes:
        bad_commands += o.bad_commands
        raised += bool(o.error)
        if o.bad_commands or o.error or o.result == LOST:
            troubles.append(o)
        if o.row in lengths:
            lengths[o.row][o.result in (SOARING, FLYING)] += 1
            continue
        results[o.row][o.result] += 1
        if o.result in (RELEASED, LOST):
            reasons[o.row][o.reason] += 1
    return Counted(
        rows=[
            FaultRow(name, found.total(), found, reasons[name])
            for name, found in results.items()
            if found
        ],
        survivals=[
            Survival(
                fault=fault,
                turbulence=turbulence,
                aboard=aboard,
                flights=found.total(),
                survived=found[True],
            )
            for fault, turbulence, aboard in SURVIVALS
            if (found := lengths[_name(fault, turbulence, aboard)])
        ],
        results=sum(results.values(), Counter()),
        bad_commands=bad_commands,
        raised=raised,
        troubles=troubles,
    )


def table(counted: Counted) -> list[str]:
    """The rows as a Markdown table."""
    lines = [
        "| fault | flights | soaring | flying | released | lost | why |",
        "|---|--:|--:|--:|--:|--:|---|",
    ]
    for row in counted.rows:
        counts = (row.results[result] for result in RESULTS)
        numbers = " | ".join(str(n) if n else "·" for n in counts)
        why = ", ".join(f"{reason} ({n})" for reason, n in row.reasons.most_common())
        name = row.name if row.name == PAIRS else f"`{row.name}`"
        lines.append(f"| {name} | {row.flights} | {numbers} | {why} |")
    numbers = " | ".join(str(counted.results[r]) for r in RESULTS)
    lines.append(f"| **all** | **{counted.flights}** | {numbers} | |")
    return lines


def section(counted: Counted, command: str) -> str:
    """A generated part of docs/safety.md."""
    lines = [
        f"{counted.flights:,} flights of {DURATION_S:g} s: {counted.bad_commands} commands not"
        f" finite or outside the envelope, {counted.raised} exceptions, {counted.results[LOST]}"
        f" flights lost while the module had the surfaces. Measured by `{command}`.",
        "",
        *table(counted),
    ]
    if not counted.survivals:
        return "\n".join(lines) + "\n"
    lines += [
        "",
        "Drop-outs that must be survived, on the same line:",
        "",
        "| drop-out | turbulence | aboard | flights | survived | 95 % interval |",
        "|---|--:|---|--:|--:|---|",
    ]
    for s in counted.survivals:
        low, high = s.interval
        lines.append(
            f"| `{s.fault}` | {s.turbulence * 100:g} % | {s.aboard} | {s.flights} |"
            f" {s.fraction * 100:.1f} % | {low * 100:.1f} to {high * 100:.1f} % |"
        )
    return "\n".join(lines) + "\n"


COMMAND: Final = "tgl-soar campaign faults"
# Of the files' own aircraft and air, and of others than the files say.
MARKS: Final = (
    f"<!-- campaign: begin; written by `{COMMAND} --docs docs` -->", "<!-- campaign: end -->"
)  # fmt: skip
DISPERSED_MARKS: Final = (
    f"<!-- dispersed: begin; written by `{COMMAND} --dispersion --docs docs` -->",
    "<!-- dispersed: end -->",
)


def with_section(page: str, written: str, dispersed: bool = False) -> str:
    """A page with what lies between its marks replaced.  Errors: ValueError without marks."""
    return between(page, *(DISPERSED_MARKS if dispersed else MARKS), written)
