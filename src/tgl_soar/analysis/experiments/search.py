"""`search`: a place to soar without knowing the wind, against baselines and an oracle.

Fields, starts and wind are random (`analysis.search.places`); every searcher flies the same places
with the same gusts and sensors, in the module's own closed loop with its own estimates.  The
figures to reach are those of search.md's prototype or better, argued before the flights:

    soared, of what the oracle soars    ≥ 90 % (tunnel), ≥ 75 % (hill, in changing wind)
    false claims                        ≤ 2 %, ≤ 1 %: an operator who hears "soaring" looks away
    nowhere to soar: given up in time   ≥ 95 %, ≥ 99 %: else it costs the aircraft
    settled                             ≤ 6 s, ≤ 25 s: a few times 1/λ of the place
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import isfinite
from pathlib import Path
from statistics import mean, median
from typing import Final, NamedTuple

import numpy as np

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.search.flying import Episode, Searcher, fly_episode
from tgl_soar.analysis.search.places import PUBLISHED, Kind, SearchPlace, place
from tgl_soar.analysis.search.scoring import Score, score, share
from tgl_soar.analysis.search.searchers import SEARCHERS, MapSearch, searcher
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.control.search.lift_search import Sighting

EPISODES: Final = 40  # of each kind
QUICK: Final = 2
KINDS: Final[tuple[Kind, ...]] = ("tunnel", "hill")
MAP: Final = "map and rollouts"
ORACLE: Final = "oracle"
NO_PITOT: Final = "map, no pitot"
AIRFRAME: Final = "airframes/eclipson_c.toml"
FRAMES_S: Final = {"tunnel": (0.6, 2.0, 6.0, 15.0), "hill": (1.0, 5.0, 20.0, 60.0)}
SOARED: Final = {"tunnel": 0.90, "hill": 0.75}
FALSE: Final = {"tunnel": 0.02, "hill": 0.01}
IN_TIME: Final = {"tunnel": 0.95, "hill": 0.99}
SETTLED_S: Final = {"tunnel": 6.0, "hill": 25.0}


class SearchJob(NamedTuple):
    """One place, for every searcher."""

    kind: Kind
    seed: int


@dataclass(frozen=True)
class SearchedPlace:
    """How every searcher did at one place."""

    scores: tuple[Score, ...]

    @property
    def duration_s(self) -> float:
        """Flown in all."""
        return sum(each.flown_s for each in self.scores)


@lru_cache(maxsize=1)
def _airframe() -> Airframe:
    return load_airframe(shipped(AIRFRAME))


def fly_place(job: SearchJob) -> SearchedPlace:
    """Fly all searchers at one place.  Errors: `ConfigError`."""
    there = place(job.kind, job.seed)
    scores = [_flown(there, name)[0] for name in SEARCHERS]
    scores.append(_flown(there, MAP, pitot=False, called=NO_PITOT)[0])
    return SearchedPlace(tuple(scores))


def _flown(
    there: SearchPlace,
    name: str,
    *,
    pitot: bool = True,
    called: str = "",
    keep: tuple[float, ...] = (),
) -> tuple[Score, Episode, Searcher | None]:
    """One searcher at one place."""
    polar = _airframe().polar.as_polar()
    made: list[Searcher] = []

    def make(sighting: Sighting) -> Searcher:
        made.append(
            MapSearch(polar, keep) if name == MAP else searcher(name, there, polar, sighting)
        )
        return made[0]

    episode = fly_episode(there, _airframe(), called or name, make, pitot=pitot)
    somebody = made[0] if made else None
    if isinstance(somebody, MapSearch):
        episode.plan_ms, episode.reading_ms = somebody.plan_ms, somebody.reading_ms
    return score(episode), episode, somebody


def run(context: Context) -> Result:
    """Fly the places, tabulate, draw."""
    episodes = QUICK if context.quick else context.episodes or EPISODES
    jobs = [
        SearchJob(kind, seed) for kind in KINDS for seed in range(PUBLISHED, PUBLISHED + episodes)
    ]
    flown = context.flyer.each(fly_place, jobs, compiled=True)
    scores = [each for searched in flown for each in searched.scores]
    figures = [] if context.figures is None else _draw(context.figures, scores)
    claims = [claim for kind in KINDS for claim in _claims(kind, scores)]
    tables = [_table(kind, scores) for kind in KINDS]
    return Result(
        name="search",
        title="a place to soar without knowing the wind",
        flown=(
            f"{episodes} random tunnels and {episodes} random hills, seeds {PUBLISHED} to"
            f" {PUBLISHED + episodes - 1}, each flown by {len(SEARCHERS) + 1} searchers in the same"
            " air. Shares stand with their exact 95 % intervals (Clopper and Pearson)."
        ),
        claims=tuple(claims),
        why=_failures(scores),
        tables=(*tables, _costs(scores)),
        numbers={"scores": [vars(each) for each in scores]},
        figures=tuple(figures),
        seeds=tuple(range(PUBLISHED, PUBLISHED + episodes)),
    )


def of(scores: list[Score], kind: str, name: str) -> dict[int, Score]:
    """The scores of one searcher by seed."""
    return {s.seed: s for s in scores if s.kind == kind and s.searcher == name}


def _claims(kind: Kind, scores: list[Score]) -> list[Claim]:
    ours, oracle = of(scores, kind, MAP), of(scores, kind, ORACLE)
    soarable = [seed for seed, s in oracle.items() if s.soared]
    nowhere = [seed for seed, s in oracle.items() if not s.soared]
    both = sum(ours[seed].soared for seed in soarable)
    false = sum(s.false_claim for s in ours.values())
    in_time = sum(ours[seed].in_time or ours[seed].soared for seed in nowhere)
    settled = [ours[seed].settled_s for seed in soarable if ours[seed].soared]
    middle = median(settled) if settled else float("inf")

    def claim(words: str, holds: bool, measured: str) -> Claim:
        return Claim(f"{kind}: {words}", holds, measured)

    return [
        claim(
            f"soars ≥ {100 * SOARED[kind]:.0f} % of what the oracle soars",
            both >= SOARED[kind] * len(soarable),
            share(both, len(soarable)),
        ),
        claim(
            f"false claims in ≤ {100 * FALSE[kind]:.0f} %",
            false <= FALSE[kind] * len(ours),
            share(false, len(ours)),
        ),
        claim(
            f"given up in time in ≥ {100 * IN_TIME[kind]:.0f} % where the oracle does not soar",
            in_time >= IN_TIME[kind] * len(nowhere),
            share(in_time, len(nowhere)),
        ),
        claim(
            f"median settling ≤ {SETTLED_S[kind]:.0f} s",
            middle <= SETTLED_S[kind],
            f"{middle:.1f} s",
        ),
    ]


def _table(kind: Kind, scores: list[Score]) -> Table:
    oracle = of(scores, kind, ORACLE)
    soarable = [seed for seed, s in oracle.items() if s.soared]
    rows = []
    for name in (MAP, NO_PITOT, *SEARCHERS[1:]):
        here = of(scores, kind, name)
        soared = [seed for seed in soarable if here[seed].soared]
        settled = [here[seed].settled_s for seed in soared]
        calm = [t for t in settled if isfinite(t)]
        nowhere = [here[seed] for seed in here if seed not in soarable]
        fell = [s.height_lost_m for s in here.values()]
        room = [oracle[seed].room_m - here[seed].room_m for seed in soared]
        rows.append(
            (
                name,
                share(len(soared), len(soarable)),
                f"{median(settled):.1f}" if settled else "–",
                f"{len(calm)} of {len(settled)}",
                share(sum(s.false_claim for s in here.values()), len(here)),
                share(sum(s.in_time for s in nowhere), len(nowhere)),
                str(sum(bool(s.ended) for s in here.values())),
                f"{median(fell):.2f}" if fell else "–",
                f"{mean(room):+.2f}" if room else "–",
            )
        )
    return Table(
        f"{kind}: {len(soarable)} of {len(oracle)} places are soared by the oracle",
        (
            "searcher",
            "soared, of these",
            "median settling [s]",
            "settled",
            "false claims",
            "given up in time, of the others",
            "lost, of all",
            "median height lost [m]",
            "regret: room less than the oracle's [m]",
        ),
        tuple(rows),
    )


def _costs(scores: list[Score]) -> Table:
    ours = [s for s in scores if s.searcher == MAP]
    plans = np.array([ms for s in ours for ms in s.plan_ms] or [np.nan])
    readings = np.array([ms for s in ours for ms in s.reading_ms] or [np.nan])
    return Table(
        "What it costs, processor time of one core [ms]",
        ("", "median", "99 %"),
        tuple(
            (name, f"{np.median(ms):.2f}", f"{np.percentile(ms, 99):.2f}")
            for name, ms in (("a reading", readings), ("a plan", plans))
        ),
    )


def failed(scores: list[Score]) -> list[Score]:
    """Where the oracle soars and the search does not, or claims what is not so, or falls."""
    found = []
    for kind in KINDS:
        oracle = of(scores, kind, ORACLE)
        for seed, ours in of(scores, kind, MAP).items():
            misses = oracle[seed].soared and not ours.soared
            if misses or ours.false_claim or (ours.ended and not ours.soared):
                found.append(ours)
    return found


def reason(s: Score) -> str:
    """Why a search failed, in words."""
    how = s.ended or s.given_up or "sinks at the end"
    return f"{how} after {s.flown_s:.0f} s, {s.height_left_m:.1f} m over the ground" + (
        ", while it claimed to soar" if s.false_claim else ""
    )


def _failures(scores: list[Score]) -> str:
    found = failed(scores)
    if not found:
        return ""
    lines = [f"- {s.kind} {s.seed} ({s.words}): {reason(s)}" for s in found]
    return "Every search that failed, was lost or claimed what was not so:\n\n" + "\n".join(lines)


def _draw(folder: Path, scores: list[Score]) -> list[str]:
    """A search of each kind, and the failures."""
    from tgl_soar.analysis.search.figures import failures_figure, search_figure

    folder.mkdir(parents=True, exist_ok=True)
    polar = _airframe().polar.as_polar()
    names: list[str] = []
    for kind in KINDS:
        found = [s for s in of(scores, kind, MAP).values() if s.soared]
        found.sort(key=lambda s: not _moved(s, scores))  # one that had to move, if there is one
        if not found:
            continue
        there = place(kind, found[0].seed)
        _, episode, somebody = _flown(there, MAP, keep=FRAMES_S[kind])
        assert isinstance(somebody, MapSearch)
        names.append(f"search_{kind}.png")
        grid = somebody.grid
        search_figure(folder / names[-1], episode, somebody.snapshots, polar, grid.x_m, grid.z_m)
    missed = failed(scores)
    if missed:
        again = [(_flown(place(s.kind, s.seed), MAP)[1], reason(s)) for s in missed[:12]]  # type: ignore[arg-type]
        names.append("search_failures.png")
        failures_figure(folder / names[-1], again, polar)
    return names


def _moved(ours: Score, scores: list[Score]) -> bool:
    """Whether the search was needed: the line through the start does not soar there."""
    return not of(scores, ours.kind, "line through the start")[ours.seed].soared
