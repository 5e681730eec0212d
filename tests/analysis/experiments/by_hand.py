"""Flights whose legs a test writes down itself, where `made_up.py` draws them: what an experiment
makes of them can then be computed by hand."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from math import cos, sin
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.experiments.flights import FlownScenario, Flyer, ScoredLeg
from tgl_soar.analysis.experiments.result import Claim
from tgl_soar.analysis.experiments.scenario import PreparedScenario
from tgl_soar.control.target_line import TargetLine, eta_from_lean
from tgl_soar.types import polar_sink

UPRIGHT: Final = TargetLine(0.0, 1.0, eta_from_lean(0.0))
PLAIN: Final = ScoredLeg(
    line="a",
    target=UPRIGHT,
    begin_s=0.0,
    end_s=20.0,
    settling_s=1.0,
    rms_e_rho_m=0.005,
    peak_e_rho_m=0.02,
    mean_e_rho_m=0.001,
    rms_y_m=0.1,
    rms_bank_rad=0.02,
    mean_x_m=0.0,
    mean_z_m=1.0,
    along_m=0.0,
    dispersion_m=0.03,
    predicted=None,
    predicted_along_m=0.0,
    scored_s=15.0,
)


def leg(line: str = "a", **figures: Any) -> ScoredLeg:
    """A leg that is as usual but for these figures."""
    return replace(PLAIN, line=line, **figures)


def flight(
    *legs: ScoredLeg,
    ended: str = "",
    seed: int = 1,
    path: dict[str, NDArray[np.float64]] | None = None,
) -> FlownScenario:
    """A flight of these legs; its path: at an incidence far below the stall by default."""
    until_s = max((each.end_s for each in legs), default=1.0)
    calm = {"time_s": np.array([0.0, until_s]), "alpha_rad": np.zeros(2)}
    return FlownScenario(
        seed=seed, ended=ended, duration_s=until_s, legs=legs, path=calm | (path or {})
    )


def signs(claims: Iterable[Claim]) -> str:
    """Of each claim whether it holds: ✓, ✗, or ? where it is undecided."""
    return "".join("?" if c.undecided else "✓" if c.holds else "✗" for c in claims)


def crossing_along(prepared: PreparedScenario, line: str, time_s: float) -> float:
    """Where excess updraft falls through zero along a line [m], up from its point, by halving."""
    target = prepared.lines[line].target
    c, s = cos(target.eta_rad), sin(target.eta_rad)

    def excess(along: float) -> float:
        x, z = target.x_m + c * along, target.z_m + s * along
        u, _, w = prepared.field.wind(np.array([x]), 0.0, np.array([z]), time_s)
        return float(w[0]) - polar_sink(prepared.polar, float(u[0]))

    low, high = -0.3, 0.3
    assert excess(low) > 0.0 > excess(high)
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return low


class ScriptedFlyer(Flyer):
    """Flies nothing: of each job it returns a scripted result, and keeps the jobs."""

    def __init__(self, answer: Callable[[Any], Any]) -> None:
        super().__init__()
        self._answer = answer
        self.by: list[str] = []  # the functions that were to fly
        self.jobs: list[Any] = []

    def each(self, fly: Callable[[Any], Any], jobs: Iterable[Any], **_: bool) -> list[Any]:
        """The scripted results, one for each job."""
        queue = list(jobs)
        self.jobs += queue
        self.by.append(fly.__name__)
        return [self._answer(job) for job in queue]
