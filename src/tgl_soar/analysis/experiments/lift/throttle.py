"""`throttle`: the search for lift of `search`, with a propeller to fall back on: AOSoar's own task.

The same random places, the same air, sensors and search, flown three times: by the oracle that
knows the field, by map and rollouts without a propeller, and with one that `THR_BUDGET` lets be
used for BUDGET_S of full throttle.  Soared counts only who soars at the end without it: in the
last quarter of the flight the throttle stays closed.  Argued before the flights:

    soared, of what the oracle soars    ≥ 98 % (tunnel), ≥ 99 % (hill)
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.search.episode import SEARCHING, EpisodeFlight, Searcher, flown_by
from tgl_soar.analysis.search.places import KINDS, PUBLISHED, Kind, SearchPlace, place
from tgl_soar.analysis.search.scoring import END_FRACTION, fraction_text, score
from tgl_soar.analysis.search.searchers import MapSearch, searcher
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.control.search.lift_search import Sighting
from tgl_soar.sim.flight import Row

EPISODES: Final = 300  # of each kind
QUICK: Final = 2
BUDGET_S: Final = 25.0
AIM: Final[dict[Kind, float]] = {"tunnel": 0.98, "hill": 0.99}
ORACLE: Final = "oracle"
WITHOUT: Final = "map and rollouts"
WITH: Final = f"the same, with {BUDGET_S:g} s of throttle"
FLOWN: Final = (ORACLE, WITHOUT, WITH)
AIRFRAME: Final = "airframes/eclipson_c_propeller.toml"
_THROTTLE: Final = Row._fields.index("throttle")


class PoweredJob(NamedTuple):
    """One place, for one of them."""

    kind: Kind
    seed: int
    called: str
    dispersed: bool = False  # the aircraft differs from its file by more than its sink


class PoweredFlown(NamedTuple):
    """What came of it."""

    oracle_like: bool  # it flew to the end and does not sink there, by whatever means
    soared: bool  # and without the throttle
    false_claim: bool
    ended: str
    given_up: str
    used_s: float  # of full throttle
    height_lost_m: float
    flown_s: float

    @property
    def duration_s(self) -> float:
        """How long it flew."""
        return self.flown_s


@lru_cache(maxsize=1)
def _airframe() -> Airframe:
    return load_airframe(shipped(AIRFRAME))


def fly_powered(job: PoweredJob) -> PoweredFlown:
    """Fly one.  Errors: `ConfigError`; ImportError without numba."""
    there = place(job.kind, job.seed)._replace(dispersed=job.dispersed)
    return fly_at(there, job.called)


def fly_at(there: SearchPlace, called: str, *, plain: bool = False) -> PoweredFlown:
    """Fly one of them at a place; plain and errors: as of `EpisodeFlight`."""
    polar = _airframe().polar.as_polar()
    parameters = SEARCHING | {"THR_BUDGET": BUDGET_S if called == WITH else 0.0}
    flight = EpisodeFlight(there, _airframe(), parameters, plain=plain)

    def who(look: Sighting) -> Searcher:
        return searcher(ORACLE, there, polar, look) if called == ORACLE else MapSearch(polar)

    flown = score(flown_by(flight, called, who))
    sent = flight.rows[: round(flown.flown_s * flight.world.step_hz), _THROTTLE]
    last = len(sent) - round(END_FRACTION * there.duration_s * flight.world.step_hz)
    closed = not bool(np.any(sent[max(0, last) :] > 0.0))
    return PoweredFlown(
        oracle_like=flown.soared,
        soared=flown.soared and closed,
        false_claim=flown.false_claim,
        ended=flown.ended,
        given_up=flown.given_up,
        used_s=flight.used_s,
        height_lost_m=flown.height_lost_m,
        flown_s=flown.flown_s,
    )


def run(context: Context) -> Result:
    """Fly the places, tabulate."""
    episodes = QUICK if context.quick else context.episodes or EPISODES
    seeds = range(PUBLISHED, PUBLISHED + episodes)
    jobs = [PoweredJob(kind, seed, name) for kind in KINDS for seed in seeds for name in FLOWN]
    flown = dict(zip(jobs, context.each(fly_powered, jobs, compiled=True), strict=True))
    return Result(
        name="throttle",
        title="the search with a propeller to fall back on",
        flown=(
            f"{episodes} random tunnels and {episodes} random hills of `search`, seeds {PUBLISHED}"
            f" to {PUBLISHED + episodes - 1}, by the oracle, by map and rollouts, and by these with"
            f" THR_BUDGET {BUDGET_S:g}. Soared: to the end, not sinking, and with the throttle"
            " closed over the last quarter of the time. Exact 95 % intervals."
        ),
        claims=tuple(_claim(kind, flown) for kind in KINDS),
        why="",
        tables=tuple(_table(kind, flown) for kind in KINDS),
        numbers={f"{j.kind} {j.seed} {j.called}": r._asdict() for j, r in flown.items()},
        seeds=tuple(seeds),
    )


Flown = dict[PoweredJob, PoweredFlown]


def _soarable(kind: Kind, flown: Flown) -> list[int]:
    """The seeds of places that the oracle soars."""
    return [j.seed for j, r in flown.items() if j[0] == kind and j.called == ORACLE and r.soared]


def _claim(kind: Kind, flown: Flown) -> Claim:
    able = _soarable(kind, flown)
    soared = sum(flown[PoweredJob(kind, seed, WITH)].soared for seed in able)
    return Claim(
        f"{kind}: with {BUDGET_S:g} s of throttle soars ≥ {100 * AIM[kind]:.0f} % of what the"
        " oracle soars",
        bool(able) and soared >= AIM[kind] * len(able),
        fraction_text(soared, len(able)),
    )


def _table(kind: Kind, flown: Flown) -> Table:
    able, rows = _soarable(kind, flown), []
    for name in FLOWN[1:]:
        here = [flown[PoweredJob(kind, seed, name)] for seed in able]
        every = [r for j, r in flown.items() if j.kind == kind and j.called == name]
        used = [r.used_s for r in every]
        rows.append(
            (
                name,
                fraction_text(sum(r.soared for r in here), len(here)),
                str(sum(r.oracle_like and not r.soared for r in here)),
                fraction_text(sum(r.false_claim for r in every), len(every)),
                str(sum(bool(r.given_up) for r in every)),
                str(sum(bool(r.ended) for r in every)),
                f"{np.median(used):.1f}, {np.percentile(used, 90):.1f}",
            )
        )
    return Table(
        f"{kind}: {len(able)} of {sum(j.kind == kind for j in flown) // len(FLOWN)} places are"
        " soared by the oracle",
        (
            "who",
            "soared, of these",
            "held by the throttle at the end",
            "false claims",
            "given up",
            "disengaged or lost",
            "throttle used [s], median, 90 %",
        ),
        tuple(rows),
    )
