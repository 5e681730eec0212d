"""What every experiment is given, and how it asks for variants of its scenario."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol, Self, TypeVar

import msgspec

from tgl_soar.analysis.experiments.flights import (
    FlownScenario,
    Flyer,
    Lasted,
    ScenarioJob,
    fly_job_compiled,
)
from tgl_soar.analysis.experiments.scenario import (
    PlacedLine,
    PreparedScenario,
    Scenario,
    load_scenario,
    search_bounds,
)
from tgl_soar.analysis.report.flight_figure import MapAir
from tgl_soar.analysis.report.zeuc_figure import DrawnLine
from tgl_soar.config.airframe import ModelKind
from tgl_soar.config.files import shipped
from tgl_soar.sim.compiled import available
from tgl_soar.sim.world import ground_outline

COMPILED_FROM: Final = 120  # flights: compiling takes as long as flying fewer of them plainly


class DispersibleJob(Protocol):
    """A flight to be flown, by the aircraft and air of the files or by others."""

    def _replace(self, *, dispersed: bool) -> Self: ...


Dispersible = TypeVar("Dispersible", bound=DispersibleJob)


@dataclass(frozen=True)
class Context:
    """Where flights are flown and figures go."""

    flyer: Flyer
    figures: Path | None = None  # folder; None: draw none
    quick: bool = False  # one seed, one intensity: to try an experiment, not to cite it
    model: ModelKind | None = None  # what flies; None: what the airframe file says
    field: Path | None = None  # a site file whose air `places` flies in, and no other
    compiled_from: int = COMPILED_FROM  # flights at once; fewer where many more are to follow
    dispersion: bool = False  # aircraft and air apart from airframe file and site
    episodes: int | None = None  # of a search, of each kind; None: as many as the experiment has

    def scenario(self, name: str) -> Scenario:
        """A shipped scenario, with one seed where it is quick.  Errors: `ConfigError`."""
        scenario = load_scenario(shipped(f"scenarios/{name}.toml"))
        if self.model is not None:
            scenario = msgspec.structs.replace(scenario, model=self.model)
        return (
            msgspec.structs.replace(scenario, seeds=scenario.seeds[:1]) if self.quick else scenario
        )

    def fly(self, scenarios: dict[Any, Scenario]) -> dict[Any, list[FlownScenario]]:
        """Every scenario with each of its seeds, all at once; flights in the order of seeds."""
        jobs = [
            ScenarioJob(scenario=scenario, seed=seed)
            for scenario in scenarios.values()
            for seed in scenario.seeds
        ]
        flown = iter(self.fly_jobs(jobs))
        return {key: [next(flown) for _ in scenario.seeds] for key, scenario in scenarios.items()}

    def fly_jobs(self, jobs: list[ScenarioJob]) -> list[FlownScenario]:
        """In the order given; compiled where numba is installed and many are to be flown."""
        jobs = self._dispersed(jobs)
        faulty = any(job.scenario.faults for job in jobs)
        if len(jobs) < self.compiled_from or faulty or not available():
            return self.flyer.fly(jobs)
        return self.flyer.each(fly_job_compiled, jobs, compiled=True)

    def each(
        self,
        fly: Callable[[Dispersible], Lasted],
        jobs: Sequence[Dispersible],
        *,
        compiled: bool = False,
    ) -> list[Lasted]:
        """As `Flyer.each`, of flights that may be of dispersed aircraft."""
        return self.flyer.each(fly, self._dispersed(jobs), compiled=compiled)

    def _dispersed(self, jobs: Sequence[Dispersible]) -> list[Dispersible]:
        return [job._replace(dispersed=True) if self.dispersion else job for job in jobs]

    def figure(self, name: str) -> Path | None:
        """The path of a figure; None: draw none."""
        return None if self.figures is None else self.figures / f"{name}.png"


def with_turbulence(scenario: Scenario, intensity: float, every_seed: bool = False) -> Scenario:
    """The same in other turbulence; calm air needs one flight only, of the first seed.

    every_seed: where each has an aircraft of its own, calm air is flown with all of them, too.
    """
    assert scenario.turbulence is not None
    turbulence = msgspec.structs.replace(scenario.turbulence, intensity=intensity)
    seeds = scenario.seeds[:1] if intensity == 0.0 and not every_seed else scenario.seeds
    return msgspec.structs.replace(scenario, turbulence=turbulence, seeds=seeds)


def turbulence_of(prepared: PreparedScenario) -> tuple[float, float]:
    """(σ [m/s], τ = L / V [s]) of the Dryden turbulence that a scenario is flown in."""
    air = prepared.site.air
    assert air is not None
    reference = prepared.field.reference_wind_mps
    return (
        air.turbulence.intensity * reference,
        air.turbulence.length_scale_m / reference,
    )


def drawn_line(name: str, line: PlacedLine) -> DrawnLine:
    """A placed line for a figure."""
    at, target = line.crossing, line.target
    return DrawnLine(
        name,
        x0_m=target.x_m,
        z0_m=target.z_m,
        eta_rad=target.eta_rad,
        crossings=[] if at is None else [(at.x_m, at.z_m, at.stable)],
    )


def drawn_air(prepared: PreparedScenario, later_s: float | None = None, later: str = "") -> MapAir:
    """The air of a scenario for a figure."""
    air = prepared.site.air
    assert air is not None
    return MapAir(
        prepared.field,
        prepared.polar,
        search_bounds(prepared.site),
        ground_outline(air),
        later_s=later_s,
        later_label=later,
    )
