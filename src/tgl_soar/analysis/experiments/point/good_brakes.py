"""Flights that hold a point with a brake that is well, each with an aircraft of its own.

What the brake does, what it is hung on and the air are drawn apart from the files
(`random_aircraft`), and the point is put for the aircraft of the file: it lies outside the band of
many, where the law comes to its end and the brake is shaken.  None may be given up.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
import numpy as np

from tgl_soar.analysis.experiments.context import Context, with_turbulence
from tgl_soar.analysis.experiments.flights import ScenarioJob, fly_job_compiled
from tgl_soar.analysis.experiments.result import Table
from tgl_soar.analysis.experiments.scenario import Scenario
from tgl_soar.control.point_hold import ABOVE_BAND, BELOW_BAND, DEAD, HOLDS, UNEVEN
from tgl_soar.sim.compiled import available

AIRCRAFT: Final = 200  # of each place and turbulence
SEED: Final = 30_000  # none with which a threshold was chosen
DURATION_S: Final = 90.0
TURBULENCE: Final = (0.0, 0.01, 0.03)


class DispersedPoint(NamedTuple):
    """One flight, and how its point stood."""

    place: str
    turbulence: float
    held: float  # share of the time
    outside: float  # the same, of the point outside the band
    given_up: bool
    ended: str
    duration_s: float


def dispersed_jobs(places: Sequence[Scenario], aircraft: int) -> list[ScenarioJob]:
    """Of scenarios that hold a point."""
    jobs = []
    for base in places:
        for intensity in TURBULENCE:
            scenario = with_turbulence(base, intensity, every_seed=True)
            scenario = msgspec.structs.replace(scenario, duration_s=DURATION_S)
            jobs += [
                ScenarioJob(scenario=scenario, seed=SEED + i, dispersed=True)
                for i in range(aircraft)
            ]
    return jobs


def fly_dispersed(job: ScenarioJob) -> DispersedPoint:
    """Fly one.  Errors: `ConfigError`."""
    flight = fly_job_compiled(job)
    standing = flight.path["point"]
    assert job.scenario.turbulence is not None
    return DispersedPoint(
        place="tunnel" if job.scenario.site is None else Path(job.scenario.site).stem,
        turbulence=job.scenario.turbulence.intensity,
        held=float(np.mean(standing == HOLDS)),
        outside=float(np.mean(np.isin(standing, (ABOVE_BAND, BELOW_BAND)))),
        given_up=bool(np.isin(standing, (DEAD, UNEVEN)).any()),
        ended=flight.ended,
        duration_s=flight.duration_s,
    )


def fly_good_brakes(context: Context, places: Sequence[Scenario]) -> list[DispersedPoint]:
    """All; none where numba is not installed."""
    if not available():
        return []
    jobs = dispersed_jobs(places, 2 if context.quick else AIRCRAFT)
    return context.flyer.each(fly_dispersed, jobs, compiled=True)


def good_brakes_table(flights: Sequence[DispersedPoint]) -> Table:
    """By place and turbulence."""
    rows = []
    for key in dict.fromkeys((f.place, f.turbulence) for f in flights):
        own = [f for f in flights if (f.place, f.turbulence) == key]
        rows.append(
            (
                key[0],
                f"{100 * key[1]:g}",
                f"{sum(not f.ended for f in own)} of {len(own)}",
                str(sum(f.given_up for f in own)),
                f"{100 * np.mean([f.held for f in own]):.0f}",
                f"{100 * np.mean([f.outside for f in own]):.0f}",
            )
        )
    columns = (
        "place", "turbulence [%]", "lasted", "brake given up", "held [% of the time]",
        "outside the band [%]",
    )  # fmt: skip
    return Table("Aircraft and air apart from their files, every brake well", columns, tuple(rows))
