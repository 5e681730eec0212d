"""The search for gains: CMA-ES, with margins as constraints.

    least   ln sqrt(e_rho² + (p · elevator)²) + w max(0, α_0 - α)

e_rho [m] and elevator: standard deviations in gusts; α: the least disk margin of all demands; p the
price of elevator activity; α_0 the floor and a reserve.  w is so large that the least lies within
the constraint (an exact penalty): a hundredth of margin that lacks weighs as 20 % of e_rho.

Gains are sought by their logarithms, as factors of those that are flown now: a step of the search
means the same for each.  Hansen, "The CMA Evolution Strategy: A Tutorial", 2016.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import hypot, inf, isfinite, log
from typing import Any, Final, NamedTuple

import numpy as np

from tgl_soar.analysis.tuning.demands import Given
from tgl_soar.analysis.tuning.progress_file import ProgressFile
from tgl_soar.control.loop_margin import FLOOR

# Elevator activity of 1/3 of its travel, whose peaks (3 σ) reach the stops, costs as 1 cm of e_rho.
PRICE_M: Final = 0.03
RESERVE: Final = 0.05  # a handful of drawn aircraft does not hold the worst of many
WEIGHT: Final = 20.0
UNSTABLE: Final = 2.0  # of the logarithm: as 7 m of e_rho
STEP: Final = 0.25  # of a logarithm: the first steps change a gain by a quarter
WIDEST: Final = log(6.0)  # no gain is sought further from what is flown now

Values = tuple[float, ...]
Evaluate = Callable[[Sequence[Values]], list[Given]]


class Candidate(NamedTuple):
    """A set of gains, and what it gives."""

    gains: Values
    given: Given


class Search(NamedTuple):
    """How one set of gains is sought."""

    start: Values
    low: Values  # that the parameters allow
    high: Values
    generations: int
    seed: int
    floor: float = FLOOR
    price_m: float = PRICE_M


def cost(given: Given, search: Search) -> float:
    """What the search makes least."""
    lacking = max(0.0, search.floor + RESERVE - given.alpha)
    if not isfinite(given.e_rho_m):
        return UNSTABLE + WEIGHT * lacking
    return log(worth(given, search.price_m)) + WEIGHT * lacking


def worth(given: Given, price_m: float) -> float:
    """e_rho with the price of what the elevator does [m]; inf: unstable."""
    return hypot(given.e_rho_m, price_m * given.elevator)


def searched(
    name: str,
    search: Search,
    evaluate: Evaluate,
    progress: ProgressFile,
    on_generation: Callable[[str, int, Candidate], None],
) -> list[Candidate]:
    """All candidates, the gains that are flown now first.

    Errors: ImportError without `cma`; OSError where progress cannot be written.
    """
    try:
        import cma
    except ImportError:
        raise ImportError("tuning needs cma: pip install 'tgl_soar[tune]'") from None
    draw = np.random.default_rng((search.seed, len(name)))
    start = np.array(search.start)
    low = np.maximum(np.log(np.array(search.low) / start), -WIDEST)
    high = np.minimum(np.log(np.array(search.high) / start), WIDEST)

    def gains_at(point: Any) -> Values:
        return tuple(float(gain) for gain in start * np.exp(np.clip(point, low, high)))

    def found(question: str, points: Sequence[Any]) -> list[Candidate]:
        gains = [gains_at(point) for point in points]
        answers = progress.answer(question, lambda: [stored(g) for g in evaluate(gains)])
        return [Candidate(g, read(a)) for g, a in zip(gains, answers, strict=True)]

    candidates = found(f"{name} 0", [np.zeros(len(start))])
    on_generation(name, 0, best(candidates, search))
    strategy = cma.CMAEvolutionStrategy(
        np.zeros(len(start)),
        STEP,
        {
            "bounds": [low, high],
            "randn": lambda *shape: draw.standard_normal(shape),
            "seed": np.nan,  # none of numpy's own: all is drawn above
            "verbose": -9,
            "verb_log": 0,
        },
    )
    for n in range(1, search.generations + 1):
        points = strategy.ask()
        generation = found(f"{name} {n}", points)
        strategy.tell(points, [cost(candidate.given, search) for candidate in generation])
        candidates += generation
        on_generation(name, n, best(candidates, search))
    return candidates


def best(candidates: Sequence[Candidate], search: Search) -> Candidate:
    """The one that costs least."""
    return min(candidates, key=lambda candidate: cost(candidate.given, search))


def finalists(candidates: Sequence[Candidate], search: Search) -> list[Candidate]:
    """The best, and the best of those with a tenth and two tenths more margin, none twice."""
    chosen: list[Candidate] = []
    for more in (0.0, 0.1, 0.2):
        enough = search._replace(floor=search.floor + more)
        candidate = best(candidates, enough)
        if candidate not in chosen:
            chosen.append(candidate)
    return chosen


def front(candidates: Sequence[Candidate]) -> list[Candidate]:
    """Those that no other one beats in margin, e_rho and activity at once."""

    def beaten(a: Given, b: Given) -> bool:
        as_good = b.alpha >= a.alpha and b.e_rho_m <= a.e_rho_m and b.elevator <= a.elevator
        return as_good and (b.alpha, b.e_rho_m, b.elevator) != (a.alpha, a.e_rho_m, a.elevator)

    stable = [c for c in candidates if c.given.alpha > 0.0 and isfinite(c.given.e_rho_m)]
    return [c for c in stable if not any(beaten(c.given, other.given) for other in stable)]


def stored(given: Given) -> list[Any]:
    """An answer as JSON has it, which knows no infinity."""
    return [
        given.alpha,
        given.e_rho_m if isfinite(given.e_rho_m) else None,
        given.elevator if isfinite(given.elevator) else None,
        given.worst,
    ]


def read(answer: list[Any]) -> Given:
    """An answer that was stored."""
    alpha, e_rho_m, elevator, worst = answer
    return Given(
        alpha=float(alpha),
        e_rho_m=inf if e_rho_m is None else float(e_rho_m),
        elevator=inf if elevator is None else float(elevator),
        worst=worst,
    )
