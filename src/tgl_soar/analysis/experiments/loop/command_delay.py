"""`command_delay`: links that are later than the module knows, and links whose delay it knows.

A command that comes later than the module knows costs phase at the crossover of both loops.
Flights are judged at each place by how many last; places are never pooled, because the slowest,
nearest to the stall, loses first.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees
from typing import Any, Final, NamedTuple

import msgspec

from tgl_soar.analysis.campaigns.drawn_faults import wilson
from tgl_soar.analysis.experiments.context import Context, with_turbulence
from tgl_soar.analysis.experiments.flights import (
    FlownScenario,
    ScenarioJob,
    rms,
)
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.experiments.scenario import Scenario, SensorSpec, prepare

SENSORS: Final = {"without": SensorSpec(), "with": SensorSpec(imu=True)}  # accelerometers
DELAYS_S: Final = (0.0, 0.010, 0.020, 0.030)  # what an unmeasured telemetry link may add
DELAY_TURBULENCE: Final = 0.03


class PlaceScore(NamedTuple):
    """All flights of one kind at one place."""

    place: str
    flights: int
    survived: int
    rms_e_rho_m: float  # of those that were scored; NaN: none
    rms_y_m: float
    rms_bank_rad: float

    @property
    def fraction(self) -> float:
        """That lasted."""
        return self.survived / self.flights


def score_place(flights: Sequence[FlownScenario], place: str) -> PlaceScore:
    """Count who lasted; measure all that was flown on the line, lost flights included."""
    legs = [leg for flight in flights for leg in flight.legs]
    return PlaceScore(
        place=place,
        flights=len(flights),
        survived=sum(flight.survived for flight in flights),
        rms_e_rho_m=rms(leg.rms_e_rho_m for leg in legs),
        rms_y_m=rms(leg.rms_y_m for leg in legs),
        rms_bank_rad=rms(leg.rms_bank_rad for leg in legs),
    )


def survival_claim(text: str, scores: Sequence[PlaceScore], least: float) -> Claim:
    """Enough of them lasted, at each place."""
    return Claim(
        text,
        bool(scores) and all(s.fraction >= least for s in scores),
        ", ".join(f"{s.survived} of {s.flights} at {s.place}" for s in scores),
    )


COLUMNS: Final = (
    "place", "flown to the end", "95 % interval", "rms e_rho [cm]", "rms y [cm]", "rms bank [°]",
)  # fmt: skip


def _cells(s: PlaceScore) -> tuple[str, ...]:
    low, high = wilson(s.survived, s.flights)
    lengths = (100 * s.rms_e_rho_m, 100 * s.rms_y_m, degrees(s.rms_bank_rad))
    return (
        s.place,
        f"{s.survived} of {s.flights}",
        f"{100 * low:.0f} to {100 * high:.0f} %",
        *("–" if value != value else f"{value:.2f}" for value in lengths),
    )


def _at(scenario: Scenario, place: str, imu: str, turbulence: float) -> Scenario:
    here = msgspec.structs.replace(scenario, first_line=place, sensors=SENSORS[imu])
    return with_turbulence(here, turbulence)


def command_delay(context: Context) -> Result:
    """The same flights with a link that is later than the module knows, and with one it knows."""
    scenario = context.scenario("command_delay")
    base = prepare(scenario)
    places = list(scenario.lines)
    delays = DELAYS_S[:: len(DELAYS_S) - 1] if context.quick else DELAYS_S
    known_s = base.values["CMD_DELAY"]
    servo_s = base.airframe.model["servo_delay_s"]
    jobs: dict[Any, list[ScenarioJob]] = {}
    for imu in SENSORS:
        for known in ("unknown", "known"):
            for late in delays:
                if late == 0.0 and known == "known":
                    continue
                for place in places:
                    here = _at(scenario, place, imu, DELAY_TURBULENCE)
                    if known == "known":
                        parameters = {**here.parameters, "CMD_DELAY": known_s + late}
                        here = msgspec.structs.replace(here, parameters=parameters)
                    figures = (("model.servo_delay_s", servo_s + late),)
                    jobs[imu, known, late, place] = [
                        ScenarioJob(
                            scenario=here,
                            seed=seed,
                            aircraft=figures,
                            dispersed=context.dispersion,
                        )
                        for seed in scenario.seeds
                    ]
    # Plain: another delay is another delay line, for which all would be compiled once more.
    flown = iter(context.flyer.fly([job for each in jobs.values() for job in each]))
    scores = {key: score_place([next(flown) for _ in each], key[3]) for key, each in jobs.items()}
    return Result(
        name="command_delay",
        title=scenario.title,
        flown=f"Still lines through the places {', '.join(places)} at {100 * DELAY_TURBULENCE:g} %"
        " of turbulence; between the tick and the servo a delay that the module does not know, or"
        f" that `CMD_DELAY` states. The seconds are those beyond the {1e3 * known_s:g} ms that the"
        " shipped value states.",
        claims=tuple(
            survival_claim(
                f"no flight is lost where the command comes {1e3 * late:g} ms later,"
                f" {known} to the module ({imu} accelerometers)",
                [s for key, s in scores.items() if key[:3] == (imu, known, late)],
                1.0,
            )
            for imu, known, late in dict.fromkeys(key[:3] for key in scores)
        ),
        why="",
        tables=(
            Table(
                "",
                ("accelerometers", "later by [ms]", "the delay is", *COLUMNS),
                tuple(
                    (imu, f"{1e3 * late:g}", known, *_cells(s))
                    for (imu, known, late, _), s in scores.items()
                ),
            ),
        ),
        numbers={", ".join(map(str, key)): s._asdict() for key, s in scores.items()},
        figures=(),
        scenarios=("command_delay",),
        seeds=tuple(scenario.seeds),
    )
