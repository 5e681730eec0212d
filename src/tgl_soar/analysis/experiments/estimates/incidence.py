"""`incidence`: the angle of attack as it is read on board without a pitot, by the true one.

What protects against the stall acts on the estimate.  Its errors are listed apart for each range of
the true angle, up to 25 degrees, because a mean over a flight hides the stall: it lasts a few
hundredths of the time.  All that was flown counts, lost flights to their end.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.experiments.context import Context, with_turbulence
from tgl_soar.analysis.experiments.flights import FlownScenario, ScenarioJob
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.experiments.scenario import SensorSpec, prepare

SETTLE_S: Final = 2.0  # the slow wind is known from a second on
EDGES_DEG: Final = (0.0, 4.0, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0, 22.0, 25.0)
FEWEST: Final = 50  # a second of flight, at the 50 Hz of a flown path: less says nothing
# Wings, in factors of the file's figures: identified to a few per cent of lift, and to a degree
# and a half of the stall, which no gliding flight shows.
WINGS: Final[dict[str, dict[str, float]]] = {
    "as the file": {},
    "stall 1.5° earlier, lift − 5 %": {"stall_alpha_rad": 0.87, "CL_alpha": 0.95},
    "stall 1.5° later, lift + 5 %": {"stall_alpha_rad": 1.13, "CL_alpha": 1.05},
}
DEEP_DEG: Final = (16.0, 25.0)  # the limit, 12.6 degrees, and the estimate's deviation beyond
# Where the wing is stalled the elevator has to be held off. It takes the whole of it 0.1 s to come
# back, a stall lasts some tenths: four fifths of the time is most of each.
DEEP_FRACTION: Final = 0.8
ATTACHED_DEG: Final = 9.6  # three degrees below the limit, where the setpoint is limited first
ATTACHED_FRACTION: Final = 0.01  # of the time: no nose is pushed down without a cause

Floats = NDArray[np.float64]


class Band(NamedTuple):
    """What is read while the true angle lies between two."""

    low_deg: float
    high_deg: float
    fraction: float  # of all the time
    mean_deg: float  # of the error
    deviation_deg: float  # of the error, about its mean
    beyond: float  # of this time, read beyond the limit
    unknown: float  # of this time


def bands(true_deg: Floats, read_deg: Floats, limit_deg: float) -> list[Band]:
    """By the true angle; those with fewer than `FEWEST` rows are left out.  NaN: not known."""
    found = []
    known = np.isfinite(read_deg)
    for low, high in pairwise(EDGES_DEG):
        here = (true_deg >= low) & (true_deg < high)
        count = int(np.count_nonzero(here))
        if count < FEWEST or not np.any(here & known):
            continue
        error = (read_deg - true_deg)[here & known]
        found.append(
            Band(
                low_deg=low,
                high_deg=high,
                fraction=count / len(true_deg),
                mean_deg=float(np.mean(error)),
                deviation_deg=float(np.std(error)),
                beyond=fraction_beyond(true_deg, read_deg, limit_deg, (low, high)),
                unknown=1.0 - len(error) / count,
            )
        )
    return found


def fraction_beyond(
    true_deg: Floats, read_deg: Floats, limit_deg: float, between_deg: tuple[float, float]
) -> float:
    """Of the time that the true angle lies between two, read beyond the limit; NaN: never there."""
    here = (true_deg >= between_deg[0]) & (true_deg < between_deg[1])
    if not np.any(here):
        return float("nan")
    return float(np.mean(read_deg[here] > limit_deg))  # an unknown angle is not beyond


def angles(flights: Sequence[FlownScenario]) -> tuple[Floats, Floats]:
    """True and read angle of attack [deg] of all flights."""
    true, read = [], []
    for flight in flights:
        rows = flight.path["time_s"] >= SETTLE_S
        true.append(np.degrees(flight.path["alpha_rad"][rows]))
        read.append(np.degrees(flight.path["air_alpha_rad"][rows]))
    return np.concatenate(true), np.concatenate(read)


def incidence(context: Context) -> Result:
    """Wings as their file has them and not quite, at each place, in the roughest air."""
    scenario = context.scenario("incidence")
    assert scenario.turbulence is not None
    sensors = SensorSpec(imu=True)
    rough = with_turbulence(
        msgspec.structs.replace(scenario, sensors=sensors), scenario.turbulence.intensity
    )
    base = prepare(rough)
    limit_deg = base.values["ALPHA_MAX"]
    model = base.airframe.model
    jobs = {
        wing: [
            ScenarioJob(
                scenario=msgspec.structs.replace(rough, first_line=place),
                seed=seed,
                aircraft=tuple(
                    (f"model.{key}", model[key] * factor) for key, factor in factors.items()
                ),
            )
            for place in rough.lines
            for seed in rough.seeds
        ]
        for wing, factors in WINGS.items()
    }
    flown = iter(context.fly_jobs([job for each in jobs.values() for job in each]))
    read = {wing: angles([next(flown) for _ in each]) for wing, each in jobs.items()}
    found = {wing: bands(*both, limit_deg) for wing, both in read.items()}
    return Result(
        name="incidence",
        title=scenario.title,
        flown=f"Flights of {scenario.duration_s:g} s on still lines through the places"
        f" {', '.join(scenario.lines)} of the tunnel at {100 * scenario.turbulence.intensity:g} %"
        " of turbulence, with accelerometers and no pitot tube. The module goes by the airframe"
        f" file, whose limit of the angle of attack is {limit_deg:g}°; the wing that flies is that"
        " of the file, or stalls elsewhere. What is reported of each range of the true angle is the"
        " error of the estimate, and how often it lies beyond the limit.",
        claims=tuple(_claims(read, limit_deg)),
        why="",
        tables=(
            Table(
                "",
                (
                    "wing", "true angle [°]", "of the time [%]", "mean error [°]",
                    "deviation [°]", "read beyond the limit [%]", "not known [%]",
                ),
                tuple((wing, *_cells(band)) for wing, each in found.items() for band in each),
            ),
        ),
        numbers={wing: [band._asdict() for band in each] for wing, each in found.items()},
        figures=(),
        scenarios=("incidence",),
        seeds=tuple(rough.seeds),
    )  # fmt: skip


def _claims(read: dict[str, tuple[Floats, Floats]], limit_deg: float) -> list[Claim]:
    claims = []
    for wing, (true, estimate) in read.items():
        deep = fraction_beyond(true, estimate, limit_deg, DEEP_DEG)
        attached = fraction_beyond(true, estimate, limit_deg, (EDGES_DEG[0], ATTACHED_DEG))
        claims.append(
            Claim(
                f"a true {DEEP_DEG[0]:g} to {DEEP_DEG[1]:g}° is read beyond the limit in"
                f" {100 * DEEP_FRACTION:g} % of the time or more ({wing})",
                deep >= DEEP_FRACTION,
                "never flown" if deep != deep else f"{100 * deep:.0f} %",
            )
        )
        claims.append(
            Claim(
                f"an attached wing, below {ATTACHED_DEG:g}°, is read beyond it in at most"
                f" {100 * ATTACHED_FRACTION:g} % ({wing})",
                attached <= ATTACHED_FRACTION,
                f"{100 * attached:.2f} %",
            )
        )
    return claims


def _cells(band: Band) -> tuple[str, ...]:
    return (
        f"{band.low_deg:g} to {band.high_deg:g}",
        f"{100 * band.fraction:.2f}",
        f"{band.mean_deg:+.1f}",
        f"{band.deviation_deg:.1f}",
        f"{100 * band.beyond:.0f}",
        f"{100 * band.unknown:.0f}",
    )
