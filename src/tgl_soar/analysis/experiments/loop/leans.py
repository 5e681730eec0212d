"""`leans`: every lean that the module accepts by default, on the shipped aircraft.

Places a, b and c of the tunnel, each with lines from `TGL_LEAN_MIN` to `TGL_LEAN_MAX` through it,
in 1 and 3 % of turbulence, with accelerometers and without.  `lean` asks what the paper says of a
line's lean, with lines that are refused; this asks whether what is not refused can be flown.

A flight that is lost counts in e_rho with all that it flew after `SETTLE_S`.
"""

from __future__ import annotations

from math import inf, sqrt
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np

from tgl_soar.analysis.experiments.context import Context, with_turbulence
from tgl_soar.analysis.experiments.flights import (
    SETTLE_S,
    FlownScenario,
    ScenarioJob,
)
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.experiments.scenario import Scenario, SensorSpec
from tgl_soar.config.parameters import ParameterSet

STEP_DEG: Final = 5.0
SEEDS: Final = 32  # of each place: 96 flights of a lean
SENSORS: Final = {"with": SensorSpec(imu=True), "without": SensorSpec()}  # accelerometers
TURBULENCES: Final = (0.01, 0.03)
# At 1 % no gust comes near the stall, so that a loss is the loop's: none.  At 3 % one in a hundred
# is what three standard deviations of a gust leave.
LOST: Final = {0.01: 0.0, 0.03: 0.01}
# Half of what is still a flight on a line (`line_lean.HELD_M`).
RMS_M: Final = 0.015


class LeanCase(NamedTuple):
    """What flights have in common."""

    imu: str  # of `SENSORS`
    turbulence: float
    lean_deg: float


class LeanCount(NamedTuple):
    """What became of the flights of a case."""

    flights: int
    lost: int
    rms_e_rho_m: float
    rms_y_m: float
    ended: str  # why the first that was lost was lost


def accepted_leans() -> list[float]:
    """[degrees], from the least to the greatest that is accepted by default."""
    values = ParameterSet()
    least, most = values["TGL_LEAN_MIN"], values["TGL_LEAN_MAX"]
    return [float(deg) for deg in np.arange(least, most + 0.5 * STEP_DEG, STEP_DEG)]


def counted(flights: list[FlownScenario]) -> LeanCount:
    """Of all flights, the lost ones as far as they flew."""
    lost = [flight for flight in flights if not flight.survived]
    e_rho, y = (
        np.concatenate([flight.path[name][flight.path["time_s"] >= SETTLE_S] for flight in flights])
        for name in ("e_rho_m", "y_m")
    )
    return LeanCount(
        flights=len(flights),
        lost=len(lost),
        rms_e_rho_m=sqrt(float(np.mean(e_rho**2))),
        rms_y_m=sqrt(float(np.mean(y**2))),
        ended=lost[0].ended if lost else "",
    )


def leans(context: Context) -> Result:
    """Fly every lean."""
    scenario = context.scenario("leans")
    first = scenario.seeds[0]
    seeds = range(first, first + (1 if context.quick else SEEDS))
    cases = [
        LeanCase(imu, turbulence, lean_deg)
        for imu in SENSORS
        for turbulence in TURBULENCES
        for lean_deg in accepted_leans()
    ]
    jobs = [
        ScenarioJob(scenario=at, seed=seed)
        for case in cases
        for at in flown_places(scenario, case)
        for seed in seeds
    ]
    flown = context.fly_jobs(jobs)
    each = len(scenario.lines) * len(seeds)
    counts = {case: counted(flown[i * each : (i + 1) * each]) for i, case in enumerate(cases)}
    return Result(
        name="leans",
        title=scenario.title,
        flown=f"The shipped aircraft at three places of the tunnel, {len(seeds)} flights of"
        f" {scenario.duration_s:g} s at each, with every {STEP_DEG:g}° of the leans that are"
        " accepted by default. e_rho and y of all flights, the lost ones as far as they flew.",
        claims=lean_count_claims(counts),
        why="",
        tables=(
            Table(
                "",
                (
                    "accelerometers", "turbulence", "lean [°]", "lost", "rms e_rho [cm]",
                    "rms y [cm]", "the first lost",
                ),
                tuple(_row(case, count) for case, count in counts.items()),
            ),
        ),
        numbers={", ".join(map(str, case)): count._asdict() for case, count in counts.items()},
        figures=(),
        scenarios=("leans",),
        seeds=(first,),
    )  # fmt: skip


def flown_places(scenario: Scenario, case: LeanCase) -> list[Scenario]:
    """The scenario of a case at each of its places."""
    rough = with_turbulence(scenario, case.turbulence)
    return [
        msgspec.structs.replace(
            rough,
            sensors=SENSORS[case.imu],
            lines={name: msgspec.structs.replace(line, lean_deg=case.lean_deg)},
            first_line=name,
        )
        for name, line in scenario.lines.items()
    ]


def lean_count_claims(counts: dict[LeanCase, LeanCount]) -> tuple[Claim, ...]:
    """Each lean alone: leans are not pooled."""
    claims = []
    for imu, turbulence in dict.fromkeys(case[:2] for case in counts):
        here = {c.lean_deg: n for c, n in counts.items() if c[:2] == (imu, turbulence)}
        worst = max(here, key=lambda deg: here[deg].lost / here[deg].flights)
        most = LOST[turbulence]
        claims.append(
            Claim(
                f"{imu} accelerometers, {100 * turbulence:g} %: at every lean"
                f" {f'at most {100 * most:g} % are' if most else 'none is'} lost",
                all(n.lost <= most * n.flights for n in here.values()),
                f"at most {here[worst].lost} of {here[worst].flights}, at {worst:g}°",
            )
        )
        if turbulence == min(LOST):
            rough = max(here, key=lambda deg: _or_worse(here[deg].rms_e_rho_m))
            claims.append(
                Claim(
                    f"{imu} accelerometers, {100 * turbulence:g} %: at every lean e_rho is at most"
                    f" {100 * RMS_M:g} cm rms",
                    all(n.rms_e_rho_m <= RMS_M for n in here.values()),
                    f"at most {100 * here[rough].rms_e_rho_m:.2f} cm, at {rough:g}°",
                )
            )
    return tuple(claims)


def _or_worse(rms_m: float) -> float:
    """NaN is of a lean at which none flew long enough to be counted."""
    return inf if rms_m != rms_m else rms_m


def _row(case: LeanCase, count: LeanCount) -> tuple[Any, ...]:
    return (
        case.imu,
        f"{100 * case.turbulence:g} %",
        f"{case.lean_deg:g}",
        f"{count.lost} of {count.flights}",
        f"{100 * count.rms_e_rho_m:.2f}",
        f"{100 * count.rms_y_m:.0f}",
        count.ended or "–",
    )
