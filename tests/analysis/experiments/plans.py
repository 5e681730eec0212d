"""What each experiment would fly first: how many flights, of which seeds, how long, in which air;
and what a campaign draws faults from.

    python tests/analysis/experiments/plans.py        records them again

`plans.json` holds the plans of the last time.  A published figure is one of so many flights, of
these seeds, so long, in this air: whoever changes that on purpose records the plans and flies
the experiment again.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from tgl_soar.analysis.experiments.catalogue import EXPERIMENTS
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer
from tgl_soar.sim.faults import CATALOGUE

KEPT: Final = Path(__file__).with_name("plans.json")
Plan = dict[str, Any]
# Of each job, where it has them: with what figures are published.
NAMED: Final = ("seed", "duration_s", "turbulence", "intensity", "line", "first_line", "kind")
MOST: Final = 8  # listed one by one

# Those that fly by themselves, or nothing.
NOT_PLANNED: Final = frozenset(("field", "forecast", "lift_map", "margins"))
FAULTS: Final = "faults of a campaign"
PLANNED: Final = tuple(name for name in EXPERIMENTS if name not in NOT_PLANNED)


class Planned(Exception):
    """An experiment has planned its first flights."""


class Planner(Flyer):
    """Flies nothing."""

    def __init__(self) -> None:
        super().__init__()
        self.plan: Plan = {}

    def each(self, fly: Callable[[Any], Any], jobs: Iterable[Any], **_: bool) -> list[Any]:
        """Writes the jobs down."""
        queue = list(jobs)
        if not queue:
            return []
        plan: Plan = {"by": fly.__name__.removesuffix("_compiled"), "flights": len(queue)}
        for what in NAMED:
            numbers = sorted({number for job in queue for number in _named(job, what)}, key=str)
            if len(numbers) > MOST:
                plan[what] = {"of": len(numbers), "least": min(numbers), "most": max(numbers)}
            elif numbers:
                plan[what] = numbers
        self.plan = plan
        raise Planned


def _named(job: object, what: str) -> Iterable[Any]:
    """The number or word of that name in a job, in its scenario, or in the scenario's turbulence;
    a job that is a number is a seed."""
    if what == "seed" and isinstance(job, int):
        yield job
    scenario = getattr(job, "scenario", None)
    for part in (job, scenario, getattr(scenario, "turbulence", None)):
        found = getattr(part, what, None)
        if isinstance(found, int | float | str):
            yield float(f"{found:.6g}") if isinstance(found, float) else found


def planned(name: str, *, quick: bool) -> Plan:
    """What an experiment would fly first."""
    planner = Planner()
    with suppress(Planned):
        EXPERIMENTS[name](Context(flyer=planner, quick=quick))
    return planner.plan


def key(name: str, *, quick: bool) -> str:
    """In the file."""
    return f"{name}, quick" if quick else name


def drawn_faults() -> Plan:
    """From where a campaign draws each number of each fault, and within which bounds one may give
    it."""
    return {
        name: [[n.name, *n.drawn, n.low, n.high] for n in kind.numbers]
        for name, kind in CATALOGUE.items()
    }


if __name__ == "__main__":
    found = {FAULTS: drawn_faults()} | {
        key(name, quick=quick): planned(name, quick=quick)
        for name in PLANNED
        for quick in (False, True)
    }
    lines = ",\n".join(f"{json.dumps(name)}: {json.dumps(plan)}" for name, plan in found.items())
    KEPT.write_text(f"{{\n{lines}\n}}\n", encoding="utf-8")
    print(f"{KEPT}: {', '.join(found)}")
