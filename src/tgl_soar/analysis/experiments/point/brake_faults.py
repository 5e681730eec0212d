"""Flights that hold a point while the brake jams, or one half of it does.

Nothing that is read back shows it: the autopilot reports where it sends a servo.  Each flight has
one fault, from some time until its end, half of them while the brake is still fading in; both
kinds in turn, in the tunnel and on the hill, in turbulence drawn from 1 to 3 %.  The number of a
flight and the seed of all decide everything in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from random import Random
from statistics import median
from typing import Final, NamedTuple

import msgspec

from tgl_soar.analysis.experiments.context import with_turbulence
from tgl_soar.analysis.experiments.flights import ScenarioJob, scenario_world
from tgl_soar.analysis.experiments.result import Claim, Table
from tgl_soar.analysis.experiments.scenario import Scenario, prepare
from tgl_soar.autopilot import reason_text
from tgl_soar.control.point_hold import DEAD, UNEVEN
from tgl_soar.control.supervisor import FAILED, RELEASED
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.compiled import available
from tgl_soar.sim.compiled_flight import CompiledLoop, CompiledWorld
from tgl_soar.sim.compiled_flight import prepare as prepare_compiled
from tgl_soar.sim.faults import parse_faults
from tgl_soar.sim.injection import Injection

FLIGHTS: Final = 200
SEED: Final = 7000  # none of the scenarios' own, nor of those that the thresholds were chosen with
DURATION_S: Final = 90.0
KINDS: Final = ("brake.stuck", "brake.one_side")
TURBULENCE: Final = (0.01, 0.03)
# The brake fades in from 2 to 4 s after the start; later it stands wherever gusts have put it.
START_S: Final = ((1.0, 5.0), (5.0, 30.0))
ROLL: Final = 0.3  # of the aileron, to either side: twice what the shipped spoilers do


class FaultyFlight(NamedTuple):
    """One flight, and what became of it."""

    place: str
    kind: str
    seed: int
    turbulence: float
    fault: str
    lost: str  # what was hit while the module had the surfaces; "": nothing
    handed_over: str  # why; "": not at all
    reported_s: float  # from the fault until the point was given up for it; NaN: it was not
    standing: int  # of the point at the end, as `control.point_hold` numbers it
    duration_s: float


def faulty_jobs(places: Sequence[Scenario], flights: int, seed: int) -> list[ScenarioJob]:
    """The flights, in scenarios that hold a point."""
    jobs = []
    for i in range(flights):
        random = Random(f"brake {seed} {i}")
        kind = KINDS[i % len(KINDS)]
        base = places[i // len(KINDS) % len(places)]
        start_s = random.uniform(*START_S[i // (len(KINDS) * len(places)) % len(START_S)])
        fault = f"{kind} start={start_s:.2f} for=1000"
        if kind == "brake.one_side":
            fault += f" roll={random.uniform(-ROLL, ROLL):.3f}"
        scenario = with_turbulence(base, round(random.uniform(*TURBULENCE), 4))
        scenario = msgspec.structs.replace(scenario, faults=[fault], duration_s=DURATION_S)
        jobs.append(ScenarioJob(scenario=scenario, seed=seed + i))
    return jobs


def fly_faulty(job: ScenarioJob) -> FaultyFlight:
    """Fly one.  Errors: `ConfigError`."""
    scenario = job.scenario
    prepared = prepare(scenario)
    (fault,) = parse_faults(scenario.faults)
    injection = Injection([fault], job.seed)
    world = scenario_world(job, prepared, injection)
    if available():
        world = CompiledWorld(prepare_compiled(world, scenario.duration_s), job.seed)
    loop = (CompiledLoop if available() else ClosedLoop)(world, prepared.values, injection)
    lost = handed_over = ""
    reported_s = float("nan")
    standing = 0
    for _ in range(round(scenario.duration_s * world.step_hz)):
        output = loop.tick()
        standing = output.point.standing
        if reported_s != reported_s and standing in (DEAD, UNEVEN):
            reported_s = world.time_s - fault.start_s
        if output.mode in (RELEASED, FAILED):
            handed_over = reason_text(output.reason)
            break
        if world.crashed:
            lost = world.crashed.partition(" at x")[0]
            break
    assert scenario.turbulence is not None
    return FaultyFlight(
        place="tunnel" if scenario.site is None else Path(scenario.site).stem,
        kind=fault.kind.name,
        seed=job.seed,
        turbulence=scenario.turbulence.intensity,
        fault=str(fault),
        lost=lost,
        handed_over=handed_over,
        reported_s=reported_s,
        standing=standing,
        duration_s=world.time_s,
    )


def faults_claim(flights: Sequence[FaultyFlight]) -> Claim:
    """None is lost with the surfaces in hand."""
    lost = [flight for flight in flights if flight.lost]
    given = sum(bool(flight.handed_over) for flight in flights)
    measured = f"{len(lost)} of {len(flights)} lost, {given} handed over"
    if lost:
        first = lost[0]
        measured += f"; first: seed {first.seed}, {first.fault}: {first.lost}"
    return Claim("with a jammed or one-sided brake no flight is lost", not lost, measured)


def faults_table(flights: Sequence[FaultyFlight]) -> Table:
    """By kind and place: what became of them, and of how many it was said."""
    rows = []
    for place in ("tunnel", "hill"):
        for kind in KINDS:
            own = [f for f in flights if f.place == place and f.kind == kind]
            if not own:
                continue
            reported = [f.reported_s for f in own if f.reported_s == f.reported_s]
            rows.append(
                (
                    f"{kind}, {place}",
                    str(len(own)),
                    str(sum(not (f.lost or f.handed_over) for f in own)),
                    str(sum(bool(f.handed_over) for f in own)),
                    str(sum(bool(f.lost) for f in own)),
                    str(len(reported)),
                    f"{median(reported):.0f}" if reported else "–",
                )
            )
    columns = (
        "fault, place", "flights", "flew on", "handed over", "lost",
        "back to the line alone", "after [s], half of them",
    )  # fmt: skip
    return Table("A brake that jams, or one half of it, at 1 to 3 %", columns, tuple(rows))
