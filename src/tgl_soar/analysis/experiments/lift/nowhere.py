"""`nowhere`: starts on a line without a place to settle, and what the module reports until its end.

`forecast` slides a point along lines without error; here the whole loop flies, a rigid body with
sensors, servos and its own estimates, at the random places of `search`.  Each flight begins at
rest on a line that has, in the true air, no place to settle within clearance, fence and polar; and
as many on a line that has one, where a warning is false.  Argued before the flights:

    0 end in the floor        while the module reports capturing or soaring later than REPORTED_S
                              after it could be known: who reports it has let the pilot watch
    false warnings < 1 %      of those that settle: else nobody leaves it switched on

It could be known when the line has no such place from the start, and the forecast's first window
is filled.  FC_ACT 2, the default, disengages; 4 begins a search.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from math import cos, inf, isfinite, radians, sin
from typing import Final, NamedTuple

import msgspec
import numpy as np

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.lift.forecast import (
    LEANS_DEG,
    REPORTED_S,
    SlidePlace,
    SlideStart,
    stops,
)
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.search.episode import Episode, EpisodeFlight, obeyed
from tgl_soar.analysis.search.places import KINDS, LAUNCH_WIND_MPS, Kind, SearchPlace, place
from tgl_soar.analysis.search.scoring import fraction_text
from tgl_soar.analysis.search.searchers import MapSearch
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.config.site import Start
from tgl_soar.control.envelope import Fence, clearance
from tgl_soar.control.forecast import DISENGAGE, SEARCH_FIRST, SETTLES, WINDOW_S
from tgl_soar.control.laws import SEARCH_LOOKS
from tgl_soar.control.supervisor import CAPTURING, REASON_NOT_FOUND, REASON_NOWHERE, SOARING
from tgl_soar.control.supervisor_texts import REASON_TEXTS
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.sim.flight import CRASHED, HELD_S, Row
from tgl_soar.types import GlidePolar

FLIGHTS: Final = 500  # on a line without a place, of each kind of place and with each FC_ACT
QUICK: Final = 4
FIRST_SEED: Final = 3001
ACTS: Final = (DISENGAGE, SEARCH_FIRST)
DURATION_S: Final[dict[Kind, float]] = {"tunnel": 8.0, "hill": 30.0}
STEP_M: Final[dict[Kind, float]] = {"tunnel": 0.01, "hill": 0.05}  # of E along a line
KNOWN_S: Final = HELD_S + WINDOW_S  # since the aircraft was released
AWAY_M: Final = 0.7  # from the place to settle, at most, along the line
ROOM: Final = 0.5  # of CLEAR_MIN, that such a start and place have beyond the clearance
DRAWS: Final = 400  # of starts at a place before another is taken
AIRFRAME: Final = "airframes/eclipson_c.toml"
_MODE: Final = Row._fields.index("mode")
_X, _Z = Row._fields.index("x_m"), Row._fields.index("z_m")


class LineJob(NamedTuple):
    """One start on one line."""

    kind: Kind
    seed: int
    settles: bool  # the line has a place
    act: int  # FC_ACT
    dispersed: bool = False  # the aircraft differs from its file by more than its sink


class LineFlown(NamedTuple):
    """What came of it; times since the start, inf: never."""

    found: bool  # a start at this place; without one nothing was flown
    warned_s: float  # when it was reported that there is no place: disengaged, or a search begun
    low_s: float  # when it was at the clearance, while capturing or soaring was reported
    floor_s: float  # when it hit the ground
    floor_reported: bool  # and capturing or soaring was reported until then
    ended: str
    given_up: str
    flown_s: float

    @property
    def duration_s(self) -> float:
        """How long it flew."""
        return self.flown_s

    @property
    def is_late(self) -> bool:
        """In the floor with the module reporting capturing or soaring, longer than it may."""
        return self.floor_reported and self.floor_s > KNOWN_S + REPORTED_S

    @property
    def is_low_late(self) -> bool:
        """The same of the clearance."""
        return self.low_s < inf and self.low_s > KNOWN_S + REPORTED_S


@lru_cache(maxsize=1)
def _airframe() -> Airframe:
    return load_airframe(shipped(AIRFRAME))


def line_place(
    there: SearchPlace, polar: GlidePolar, settles: bool, rng: np.random.Generator
) -> SearchPlace | None:
    """The place with another start, on a line that settles or that does not; None: none was
    drawn."""
    at = _slide_place(there)
    turn = {"settles": settles, "rng": rng}
    for _ in range(DRAWS):
        start = _drawn(there, at, polar, **turn)  # type: ignore[arg-type]
        if start is None:
            continue
        line = {"TGL_X": start.x_m, "TGL_Z": start.z_m}
        lean_deg = round(np.degrees(start.eta_rad) - 90.0)
        site = msgspec.structs.replace(
            there.site,
            parameters={**there.site.parameters, **line, "TGL_LEAN": float(lean_deg)},
            start=Start(x_m=start.x_m, z_m=start.z_m),
        )
        return there._replace(site=site, duration_s=DURATION_S[there.kind])
    return None


def _slide_place(there: SearchPlace) -> SlidePlace:
    box, given = there.box, there.site.parameters
    return SlidePlace(
        name=there.kind,
        field=there.field,
        ground=there.ground,
        fence=Fence(
            x_min_m=box.x_min_m,
            x_max_m=box.x_max_m,
            y_max_m=float(given["FENCE_Y_MAX"]),
            z_min_m=box.z_min_m,
            z_max_m=box.z_max_m,
        ),
        clearance_min_m=float(given["CLEAR_MIN"]),
        scale_m=1.0,
        duration_s=DURATION_S[there.kind],
        step_m=STEP_M[there.kind],
    )


def _drawn(
    there: SearchPlace, at: SlidePlace, polar: GlidePolar, settles: bool, rng: np.random.Generator
) -> SlideStart | None:
    """One start, if it is of the kind that is asked for."""
    box, least = there.box, at.clearance_min_m
    start = SlideStart(
        x_m=float(rng.uniform(box.x_min_m, box.x_max_m)),
        z_m=float(rng.uniform(box.z_min_m, box.z_max_m)),
        eta_rad=eta_from_lean(radians(float(rng.choice(LEANS_DEG)))),
        wind=1.0,
        change=there.change,
        gusts=0.0,
        sink=there.sink_factor,
    )
    if clearance(there.ground, start.x_m, start.z_m) < (1.0 + ROOM) * least:
        return None
    first, last = (stops(at, polar, start, change) for change in (1.0, there.change))
    if settles:
        if not (first and last):
            return None
        away = first[0] + float(rng.uniform(-AWAY_M, AWAY_M))
        start = start._replace(
            x_m=start.x_m + away * cos(start.eta_rad), z_m=start.z_m + away * sin(start.eta_rad)
        )
        places = [0.0, *(s - away for s in (first[0], last[0]))]
        for s in places:
            x_m, z_m = start.x_m + s * cos(start.eta_rad), start.z_m + s * sin(start.eta_rad)
            inside = min(x_m - box.x_min_m, box.x_max_m - x_m, box.z_max_m - z_m)
            room_m = min(inside, clearance(there.ground, x_m, z_m) - least)
            if room_m < ROOM * least:
                return None
    elif first or last:
        return None
    wind_mps = there.field.wind_at(start.x_m, 0.0, start.z_m, 0.0)[0]
    return start if LAUNCH_WIND_MPS[0] <= wind_mps <= LAUNCH_WIND_MPS[1] else None


def fly_line(job: LineJob) -> LineFlown:
    """Fly one.  Errors: `ConfigError`."""
    polar = _airframe().polar.as_polar()
    rng = np.random.default_rng((job.seed, job.kind == "hill", job.settles, 18))
    drawn = place(job.kind, job.seed)._replace(dispersed=job.dispersed)
    there = line_place(drawn, polar, job.settles, rng)
    if there is None:
        return LineFlown(
            found=False,
            warned_s=inf,
            low_s=inf,
            floor_s=inf,
            floor_reported=False,
            ended="",
            given_up="",
            flown_s=0.0,
        )
    flight = EpisodeFlight(there, _airframe(), {"FC_ACT": float(job.act)})
    episode = Episode(
        place=there,
        searcher="forecast",
        ended="",
        given_up="",
        flown_s=0.0,
        path={},
        landing_m=flight.guards.landing_m,
    )
    search: MapSearch | None = None
    seeks_s = inf
    while flight.flies:
        look = flight.look()
        if look is None or job.act != SEARCH_FIRST:
            continue
        search = MapSearch(polar) if search is None else search
        search.listen(look)
        assert flight.now is not None
        if seeks_s == inf and flight.now.forecast > SETTLES:
            seeks_s = flight.time_s
            flight.set({"SRCH_START": float(SEARCH_LOOKS)})
        if seeks_s < inf and not obeyed(flight, episode, search.seek(look)):
            break
    return flown_of(flight, flight.ended(episode), seeks_s)


def flown_of(flight: EpisodeFlight, episode: Episode, seeks_s: float) -> LineFlown:
    """What came of a flight; seeks_s: when a search began."""
    now, place_ = flight.now, flight.place
    assert now is not None
    rows = flight.rows[: now.steps]
    least = float(place_.site.parameters["CLEAR_MIN"])
    reported = (rows[:, _MODE] == CAPTURING) | (rows[:, _MODE] == SOARING)
    above = np.array([clearance(place_.ground, x, z) for x, z in rows[:, [_X, _Z]].tolist()])
    low = np.nonzero(reported & (above < least))[0]
    reasons = (REASON_TEXTS[REASON_NOWHERE], REASON_TEXTS[REASON_NOT_FOUND])
    warned = any(reason in episode.ended for reason in reasons)
    crashed = now.standing == CRASHED
    return LineFlown(
        found=True,
        warned_s=min(seeks_s, episode.flown_s if warned else inf),
        low_s=float(low[0]) / flight.world.step_hz if low.size else inf,
        floor_s=episode.flown_s if crashed else inf,
        floor_reported=crashed and bool(reported[-1]),
        ended=episode.ended,
        given_up=episode.given_up,
        flown_s=episode.flown_s,
    )


def run(context: Context) -> Result:
    """Fly them all."""
    count = QUICK if context.quick else context.episodes or FLIGHTS
    jobs = [
        LineJob(kind=kind, seed=seed, settles=settles, act=act)
        for kind in KINDS
        for act in ACTS
        for settles in (False, True)
        for seed in range(FIRST_SEED, FIRST_SEED + count)
    ]
    flown = dict(zip(jobs, context.each(fly_line, jobs, compiled=True), strict=True))

    def of(kind: Kind, act: int, settles: bool) -> list[LineFlown]:
        return [
            row
            for job, row in flown.items()
            if (job.kind, job.act, job.settles) == (kind, act, settles) and row.found
        ]

    return Result(
        name="nowhere",
        title="starts on a line without a place to settle",
        flown=(
            f"At {count} random tunnels and {count} random hills, seeds {FIRST_SEED} to"
            f" {FIRST_SEED + count - 1}, an aircraft is released at rest on a line of 10 to 25°"
            " without a place to settle in the true air, and on one that has a place within"
            f" {AWAY_M:g} m; wind there 7.8 to 11.5 m/s, gusts of 1 to 5 %, drag ± 10 %. The module"
            " flies its own loop with its own estimates, with FC_ACT 2 (disengage) and 4 (search)."
            f" It could be known {KNOWN_S:g} s after the start. Where no such start was drawn at"
            " a place, none was flown."
        ),
        claims=_claims(of),
        why="",
        tables=(_without(of), _having(of)),
        numbers={f"{j.kind} {j.seed} {j.settles} {j.act}": r._asdict() for j, r in flown.items()},
        seeds=(FIRST_SEED, FIRST_SEED + count - 1),
    )


Of = Callable[[Kind, int, bool], list[LineFlown]]


def _claims(of: Of) -> tuple[Claim, ...]:
    claims = []
    for act in ACTS:
        without = [row for kind in KINDS for row in of(kind, act, False)]
        having = [row for kind in KINDS for row in of(kind, act, True)]
        late = sum(row.is_late for row in without)
        false = sum(isfinite(row.warned_s) for row in having)
        claims += [
            Claim(
                f"FC_ACT {act}: none ends in the floor while capturing or soaring is reported"
                f" later than {REPORTED_S:g} s after it could be known",
                late == 0,
                fraction_text(late, len(without)),
            ),
            Claim(
                f"FC_ACT {act}: fewer than 1 % of those that would settle are warned",
                false < 0.01 * len(having),
                fraction_text(false, len(having)),
            ),
        ]
    return tuple(claims)


def _without(of: Of) -> Table:
    rows = []
    for kind in KINDS:
        for act in ACTS:
            flown = of(kind, act, False)
            warned = [row.warned_s - HELD_S for row in flown if isfinite(row.warned_s)]
            rows.append(
                (
                    kind,
                    str(act),
                    str(len(flown)),
                    str(len(warned)),
                    f"{np.median(warned):.1f}, {np.percentile(warned, 90):.1f}" if warned else "–",
                    str(sum(row.is_low_late for row in flown)),
                    str(sum(isfinite(row.floor_s) for row in flown)),
                    str(sum(row.is_late for row in flown)),
                )
            )
    return Table(
        "No place to settle",
        (
            "place",
            "FC_ACT",
            "flights",
            "warned",
            "after [s], median, 90 %",
            "at the clearance first, later than it may be",
            "in the floor",
            "of these, capturing or soaring reported too long",
        ),
        tuple(rows),
    )


def _having(of: Of) -> Table:
    rows = []
    for kind in KINDS:
        for act in ACTS:
            flown = of(kind, act, True)
            false = sum(isfinite(row.warned_s) for row in flown)
            floor = sum(isfinite(row.floor_s) for row in flown)
            rows.append((kind, str(act), fraction_text(false, len(flown)), str(floor)))
    return Table(
        "A place to settle", ("place", "FC_ACT", "warned wrongly", "in the floor"), tuple(rows)
    )
