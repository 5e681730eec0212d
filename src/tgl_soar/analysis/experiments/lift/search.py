"""`search`: a place to soar without knowing the wind, against baselines and an oracle.

Fields, starts and wind are random (`analysis.search.places`); every searcher flies the same places
with the same gusts and sensors, in the module's own closed loop with its own estimates.  The
figures to reach were argued before the flights:

    soared, of what the oracle soars    ≥ 90 % (tunnel; 95 % from below 0.75 of the ceiling, where
                                        there is time to move), ≥ 95 % (hill, steady wind),
                                        ≥ 75 % (hill, where it falls by 10–15 %)
    without a pitot                     within 3 points: the variometer fixes w − S
    false claims                        ≤ 2 %, ≤ 1 %: an operator who hears "soaring" looks away
    nowhere to soar: given up in time   ≥ 95 %, ≥ 99 %: else it costs the aircraft
    settled                             ≤ 6 s, ≤ 25 s: a few times 1/λ of the place
    beside AOSoar's walk                a place ≥ 10 times sooner

A walk that has found nothing by the end of an episode is not known to find nothing: it is censored
there.  So the walk flies once more for GIVEN_S, ten times as long as the search needs and longer,
and whatever it claims in that time counts as found, true or not; and means are restricted to the
episode (Royston and Parmar, 2013): of each flight the time without a place, to the end at most.
Likewise a search that still flies high enough at the end, where neither it nor the oracle soars:
it flies once more for GIVEN_S, and how that ends is its end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from math import ceil, inf, isfinite, sqrt
from pathlib import Path
from statistics import mean, median, stdev
from typing import Final, NamedTuple

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.search.episode import Episode, Searcher, fly_episode
from tgl_soar.analysis.search.places import DURATION_S, KINDS, PUBLISHED, Kind, SearchPlace, place
from tgl_soar.analysis.search.scoring import Score, fraction_text, score
from tgl_soar.analysis.search.searchers import SEARCHERS, MapSearch, searcher
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.control.search.lift_search import Sighting
from tgl_soar.control.search.search import CLAIM_S

EPISODES: Final = 300  # of each kind
OTHERS: Final = 50  # of each kind flown by the baselines that nothing is claimed of
QUICK: Final = 2
BLOCK: Final = 50  # places in a list that is flown: what is done stays done where fewer are asked
MAP: Final = "map and rollouts"
ORACLE: Final = "oracle"
START: Final = "line through the start"
WALK: Final = "AOSoar's walk"
NO_PITOT: Final = "map, no pitot"
PATIENT: Final = "AOSoar's walk, given longer"
FLOWN_ON: Final = "map and rollouts, flown on"
GIVEN_S: Final = {"tunnel": 100.0, "hill": 600.0}  # ten times 8.4 and 52.4 s are in it
MANY: Final = (MAP, NO_PITOT, START, WALK, ORACLE)
FEW: Final = tuple(name for name in SEARCHERS if name not in MANY)
AIRFRAME: Final = "airframes/eclipson_c.toml"
FRAMES_S: Final = {"tunnel": (0.6, 2.0, 6.0, 15.0), "hill": (1.0, 5.0, 20.0, 60.0)}
FALSE: Final = {"tunnel": 0.02, "hill": 0.01}
IN_TIME: Final = {"tunnel": 0.95, "hill": 0.99}
SETTLED_S: Final = {"tunnel": 6.0, "hill": 25.0}
PITOT: Final = 0.03
SOONER: Final = 10.0
LOW: Final = 0.75  # of the ceiling
FALLEN: Final = 0.90  # times the wind, or less
DRAWN: Final = 12  # failures at each kind of place
SINKS: Final = "sinks at the end"


class SearchJob(NamedTuple):
    """One place, for one searcher."""

    kind: Kind
    seed: int
    searcher: str
    dispersed: bool = False  # the aircraft differs from its file by more than its sink


class PlaceGroup(NamedTuple):
    """Places that are looked at apart."""

    name: str
    has: Callable[[Score], bool]
    soared: float  # that share of them; inf: nothing is asked


GROUPS: Final[dict[Kind, tuple[PlaceGroup, ...]]] = {
    "tunnel": (
        PlaceGroup("all", lambda _: True, 0.90),
        PlaceGroup("from below 0.75 of the ceiling", lambda s: s.begins < LOW, 0.95),
        PlaceGroup("steady wind", lambda s: s.change == 1.0, inf),
        PlaceGroup("falling wind", lambda s: s.change < 1.0, inf),
        PlaceGroup("rising wind", lambda s: s.change > 1.0, inf),
    ),
    "hill": (
        PlaceGroup("all", lambda _: True, inf),
        PlaceGroup("steady wind", lambda s: s.change == 1.0, 0.95),
        PlaceGroup("wind that falls by 10–15 %", lambda s: s.change <= FALLEN, 0.75),
        PlaceGroup("wind that falls by less", lambda s: FALLEN < s.change < 1.0, inf),
        PlaceGroup("rising wind", lambda s: s.change > 1.0, inf),
    ),
}


@lru_cache(maxsize=1)
def _airframe() -> Airframe:
    return load_airframe(shipped(AIRFRAME))


def fly_search(job: SearchJob) -> Score:
    """Fly one searcher at one place.  Errors: `ConfigError`."""
    there = place(job.kind, job.seed)._replace(dispersed=job.dispersed)
    longer = {PATIENT: WALK, FLOWN_ON: MAP}
    if job.searcher in longer:  # the wind changes when it does in the others' flights
        there = there._replace(duration_s=GIVEN_S[job.kind])
    return _flown(there, longer.get(job.searcher, job.searcher))[0]


def _flown(
    there: SearchPlace, called: str, keep: tuple[float, ...] = ()
) -> tuple[Score, Episode, Searcher | None]:
    """One searcher at one place."""
    polar = _airframe().polar.as_polar()
    made: list[Searcher] = []

    def make(sighting: Sighting) -> Searcher:
        is_map = called in (MAP, NO_PITOT)
        made.append(MapSearch(polar, keep) if is_map else searcher(called, there, polar, sighting))
        return made[0]

    episode = fly_episode(there, _airframe(), called, make, pitot=called != NO_PITOT)
    return score(episode), episode, made[0] if made else None


def jobs_of(episodes: int) -> list[list[SearchJob]]:
    """What is flown, in blocks of places."""
    last = PUBLISHED + episodes
    return [
        [
            SearchJob(kind, seed, name)
            for seed in range(first, min(first + BLOCK, last))
            for kind in KINDS
            for name in (*MANY, PATIENT, *(FEW if seed < PUBLISHED + OTHERS else ()))
        ]
        for first in range(PUBLISHED, last, BLOCK)
    ]


def run(context: Context) -> Result:
    """Fly the places, tabulate, draw."""
    episodes = QUICK if context.quick else context.episodes or EPISODES
    scores: list[Score] = []
    for jobs in jobs_of(episodes):
        scores += _scored(context, jobs)
    scores += _scored(context, undecided(scores))
    figures = [] if context.figures is None else _draw(context.figures, scores)
    claims = [claim for kind in KINDS for claim in _claims(kind, scores)]
    tables = [
        table
        for kind in KINDS
        for table in (_table(kind, scores), _groups(kind, scores), _sooner(kind, scores))
    ]
    tables.append(_reasons(scores))
    fewer = min(episodes, OTHERS)
    return Result(
        name="search",
        title="a place to soar without knowing the wind",
        flown=(
            f"{episodes} random tunnels and {episodes} random hills, seeds {PUBLISHED} to"
            f" {PUBLISHED + episodes - 1}, flown by {', '.join(MANY)} in the same air;"
            f" {', '.join(FEW)} flew the first {fewer} of each. Shares stand with their exact 95 %"
            " intervals (Clopper and Pearson)."
        ),
        claims=tuple(claims),
        why=_failures(scores),
        tables=tuple(tables),
        numbers={"scores": [vars(each) for each in scores]},
        figures=tuple(figures),
        seeds=tuple(range(PUBLISHED, PUBLISHED + episodes)),
    )


def _scored(context: Context, jobs: list[SearchJob]) -> list[Score]:
    flown = context.each(fly_search, jobs, compiled=True)
    return [replace(each, searcher=job.searcher) for job, each in zip(jobs, flown, strict=True)]


def _flown_on(kind: Kind, later: dict[int, Score]) -> str:
    """What became of those that were flown on, in words."""
    if not later:
        return ""
    soar = sum(end.soared for end in later.values())
    return f"; {len(later)} of them flown on, {soar} of which soar after {GIVEN_S[kind]:.0f} s"


def undecided(scores: list[Score]) -> list[SearchJob]:
    """The searches that still flew high enough at the end where neither they nor the oracle soared:
    whether these give up in time is not known yet."""
    return [
        SearchJob(kind, seed, FLOWN_ON)
        for kind in KINDS
        for seed, ours in of(scores, kind, MAP).items()
        if ours.aloft and not ours.soared and not of(scores, kind, ORACLE)[seed].soared
    ]


def of(scores: list[Score], kind: str, name: str) -> dict[int, Score]:
    """The scores of one searcher by seed."""
    return {s.seed: s for s in scores if s.kind == kind and s.searcher == name}


def soarable(scores: list[Score], kind: str, group: PlaceGroup) -> list[int]:
    """The seeds of a group's places that the oracle soars."""
    return [s.seed for s in of(scores, kind, ORACLE).values() if s.soared and group.has(s)]


def _soared(scores: list[Score], kind: Kind, name: str, group: PlaceGroup) -> tuple[int, int]:
    """How many of those that the oracle soars somebody does, and of how many that flew there."""
    here = of(scores, kind, name)
    seeds = [seed for seed in soarable(scores, kind, group) if seed in here]
    return sum(here[seed].soared for seed in seeds), len(seeds)


def _claims(kind: Kind, scores: list[Score]) -> list[Claim]:
    ours, oracle = of(scores, kind, MAP), of(scores, kind, ORACLE)
    everywhere = GROUPS[kind][0]
    seeds = soarable(scores, kind, everywhere)
    nowhere = [seed for seed, s in oracle.items() if not s.soared]
    false = sum(s.false_claim for s in ours.values())
    later = of(scores, kind, FLOWN_ON)
    ends = [later.get(seed, ours[seed]) for seed in nowhere]
    in_time = sum(end.in_time or end.soared for end in ends)
    settled = [ours[seed].settled_s for seed in seeds if ours[seed].soared]
    middle = median(settled) if settled else inf
    claims = []
    for group in GROUPS[kind]:
        if isfinite(group.soared):
            both, there = _soared(scores, kind, MAP, group)
            words = "" if group is everywhere else f", {group.name}"
            text = f"soars ≥ {100 * group.soared:.0f} % of what the oracle soars{words}"
            claims.append(
                Claim(
                    text,
                    there > 0 and both >= group.soared * there,
                    fraction_text(both, there),
                )
            )
    with_pitot, there = _soared(scores, kind, MAP, everywhere)
    without, _ = _soared(scores, kind, NO_PITOT, everywhere)
    lost = (with_pitot - without) / max(1, there)
    found_s, walk_s = _found(scores, kind, MAP, seeds), _claimed(scores, kind, seeds)
    walked_s = min(walk_s, GIVEN_S[kind])  # no more is known of a walk that has claimed none
    claims += [
        Claim(
            f"without a pitot within {100 * PITOT:.0f} points",
            there > 0 and lost <= PITOT,
            f"{100 * lost:+.1f} points fewer",
        ),
        Claim(
            f"false claims in ≤ {100 * FALSE[kind]:.0f} %",
            false <= FALSE[kind] * len(ours),
            fraction_text(false, len(ours)),
        ),
        Claim(
            f"given up in time in ≥ {100 * IN_TIME[kind]:.0f} % where the oracle does not soar",
            in_time >= IN_TIME[kind] * len(nowhere),
            fraction_text(in_time, len(nowhere)) + _flown_on(kind, later),
        ),
        Claim(
            f"median settling ≤ {SETTLED_S[kind]:.0f} s",
            middle <= SETTLED_S[kind],
            f"{middle:.1f} s",
        ),
        Claim(
            f"a place found ≥ {SOONER:.0f} times sooner than by AOSoar's walk (medians)",
            isfinite(found_s) and walked_s >= SOONER * found_s,
            f"{_seconds(found_s)}, {_seconds(walk_s)} given {GIVEN_S[kind]:.0f} s:"
            f" {'at least ' if walked_s < walk_s else ''}{walked_s / found_s:.1f} times",
        ),
    ]
    return [Claim(f"{kind}: {c.text}", c.holds, c.measured) for c in claims]


def _found(scores: list[Score], kind: Kind, name: str, seeds: list[int]) -> float:
    """Median time to a claim that was true to the end; inf: in half of the places there is none."""
    here = of(scores, kind, name)
    return median(here[seed].found_s for seed in seeds) if seeds else inf


def _claimed(scores: list[Score], kind: Kind, seeds: list[int]) -> float:
    """Median time to the patient walk's first claim; inf: in half of the places it makes none."""
    here = of(scores, kind, PATIENT)
    return median(here[seed].claimed_s for seed in seeds) if seeds else inf


def without_a_place_s(score: Score, end_s: float) -> float:
    """Time until it has found a place, to the end of the episode at most: who is lost or has given
    up finds none any more."""
    return min(score.found_s, end_s)


def _sooner(kind: Kind, scores: list[Score]) -> Table:
    """Who has found a place by when, where the oracle soars."""
    seeds, end_s = soarable(scores, kind, GROUPS[kind][0]), DURATION_S[kind]
    ours = of(scores, kind, MAP)
    by_s = _found(scores, kind, MAP, seeds)
    by_s = by_s if isfinite(by_s) else end_s
    rows = []
    for name in MANY:
        here = of(scores, kind, name)
        times = [without_a_place_s(here[seed], end_s) for seed in seeds]
        best = [without_a_place_s(ours[seed], end_s) for seed in seeds]
        longer = [t - b for t, b in zip(times, best, strict=True)]
        found = [here[seed].found_s for seed in seeds]
        rows.append(
            (
                name,
                fraction_text(sum(t <= by_s for t in found), len(seeds)),
                fraction_text(sum(isfinite(t) for t in found), len(seeds)),
                _at(_quantile(found, 0.25)),
                f"{mean(times):.1f}" if times else "–",
                _difference(longer),
            )
        )
    return Table(
        f"{kind}: a place found, true to the end, where the oracle soars; no claim is made before"
        f" {CLAIM_S:.0f} s",
        (
            "searcher",
            f"by {by_s:.1f} s, the search's median",
            "by the end",
            "a quarter by [s]",
            f"mean time without a place, to {end_s:.0f} s [s]",
            "more of it than the search [s]",
        ),
        tuple(rows),
    )


def _quantile(values: list[float], of_them: float) -> float:
    """The least value that so many are not above."""
    return sorted(values)[ceil(of_them * len(values)) - 1] if values else inf


def _at(time_s: float) -> str:
    return f"{time_s:.1f}" if isfinite(time_s) else "–"


def _difference(values: list[float]) -> str:
    """Mean of paired differences, and its 95 % interval by the normal distribution."""
    if len(values) < 2:
        return "–"
    half = 1.96 * stdev(values) / sqrt(len(values))
    return f"{mean(values):+.1f} ± {half:.1f}"


def _seconds(time_s: float) -> str:
    return f"{time_s:.1f} s" if isfinite(time_s) else "not in half of them"


def _table(kind: Kind, scores: list[Score]) -> Table:
    oracle = of(scores, kind, ORACLE)
    everywhere = GROUPS[kind][0]
    rows = []
    for name in (*MANY[:-1], *FEW, ORACLE):
        here = of(scores, kind, name)
        seeds = [seed for seed in soarable(scores, kind, everywhere) if seed in here]
        soared = [seed for seed in seeds if here[seed].soared]
        settled = [here[seed].settled_s for seed in soared]
        nowhere = [s for seed, s in here.items() if not oracle[seed].soared]
        fell = [s.height_lost_m for s in here.values()]
        room = [oracle[seed].room_m - here[seed].room_m for seed in soared]
        rows.append(
            (
                name,
                fraction_text(len(soared), len(seeds)),
                f"{median(settled):.1f}" if settled and isfinite(median(settled)) else "–",
                _seconds(_found(scores, kind, name, seeds)).removesuffix(" s"),
                fraction_text(sum(s.false_claim for s in here.values()), len(here)),
                fraction_text(sum(s.in_time for s in nowhere), len(nowhere)),
                str(sum(bool(s.ended) for s in here.values())),
                f"{median(fell):.2f}" if fell else "–",
                f"{mean(room):+.2f}" if room else "–",
            )
        )
    count = len(soarable(scores, kind, everywhere))
    return Table(
        f"{kind}: {count} of {len(oracle)} places are soared by the oracle",
        (
            "searcher",
            "soared, of these",
            "median settling [s]",
            "found after, median [s]",
            "false claims",
            "given up in time, of the others",
            "lost, of all",
            "median height lost [m]",
            "room less than the oracle's [m]",
        ),
        tuple(rows),
    )


def _groups(kind: Kind, scores: list[Score]) -> Table:
    """Shares of what the oracle soars, by how the wind changes and where the aircraft begins."""
    names = (MAP, NO_PITOT, START, WALK)
    rows = tuple(
        (group.name, *(fraction_text(*_soared(scores, kind, name, group)) for name in names))
        for group in GROUPS[kind]
    )
    return Table(f"{kind}: soared, of what the oracle soars", ("places", *names), rows)


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
    how = s.ended or s.given_up or SINKS
    return f"{how} after {s.flown_s:.0f} s, {s.height_left_m:.1f} m over the ground" + (
        ", while it claimed to soar" if s.false_claim else ""
    )


def _reasons(scores: list[Score]) -> Table:
    """How often a search fails by what."""
    columns: dict[tuple[str, str], list[Score]] = {}
    for s in failed(scores):
        columns.setdefault((s.kind, s.ended or s.given_up or SINKS), []).append(s)
    rows = tuple(
        (kind, how, str(len(those)), str(sum(s.false_claim for s in those)))
        for (kind, how), those in sorted(columns.items(), key=lambda each: -len(each[1]))
    )
    return Table(
        "Searches that do not soar where the oracle does, are lost, or claim what is not so",
        ("place", "how it ends", "episodes", "while it claimed to soar"),
        rows,
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
        _, episode, search = _flown(place(kind, found[0].seed), MAP, FRAMES_S[kind])
        assert isinstance(search, MapSearch)
        names.append(f"search_{kind}.png")
        grid = search.grid
        search_figure(folder / names[-1], episode, search.snapshots, polar, grid.x_m, grid.z_m)
    all_missed = failed(scores)
    missed = [
        (kind, s) for kind in KINDS for s in [m for m in all_missed if m.kind == kind][:DRAWN]
    ]
    if missed:
        again = [(_flown(place(kind, s.seed), MAP)[1], reason(s)) for kind, s in missed]
        names.append("search_failures.png")
        failures_figure(folder / names[-1], again, polar)
    return names


def _moved(ours: Score, scores: list[Score]) -> bool:
    """Whether the search was needed: the line through the start does not soar there."""
    return not of(scores, ours.kind, START)[ours.seed].soared
