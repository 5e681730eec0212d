"""Probes of what a line alone does not use: a brake, the way home, a throw, a search, faults.

As those of `staleness`, each is a short flight whose end a section of a page carries; a section
carries the probes of what its own flights do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Final

import msgspec

from tgl_soar.analysis.experiments.flights import ScenarioJob, fly_job
from tgl_soar.analysis.experiments.outdoors.outdoors import LAUNCH, PassageJob, fly_passage
from tgl_soar.analysis.experiments.pages import AIMS, PAPER
from tgl_soar.analysis.experiments.scenario import SensorSpec, TimedChange
from tgl_soar.analysis.experiments.staleness import Ends, probe, probed, sealed
from tgl_soar.analysis.search.episode import fly_episode
from tgl_soar.analysis.search.places import place
from tgl_soar.analysis.search.searchers import MapSearch
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.control.search.lift_search import Sighting
from tgl_soar.control.search.rollout import roll_out

OLDER: Final = "> **The figures of this section are older than the laws.**"
BRAKED: Final = {"TGL_HOLD": 2.0, "TGL_ALONG": -0.1}
CHANGED_S: Final = 10.0  # it soars by then
SEARCHED_S: Final = 4.0  # the map has been asked for a line a few times by then
PLAIN, EVERY = SensorSpec(), SensorSpec(imu=True, pitot=True)
Place = tuple[float, float]


def _changed(
    scenario: str,
    seconds: float,
    change: dict[str, float],
    sensors: SensorSpec = PLAIN,
    faults: Iterable[str] = (),
) -> Place:
    """Where a flight of `probed` ends, x and z [m], in which the operator sets parameters or
    something fails."""
    flown = msgspec.structs.replace(
        probed(scenario, sensors, "rigid_body"),
        duration_s=seconds,
        changes=[TimedChange(time_s=CHANGED_S, parameters=change)] if change else [],
        faults=list(faults),
    )
    path = fly_job(ScenarioJob(scenario=flown, seed=1)).path
    return float(path["x_m"][-1]), float(path["z_m"][-1])


def _unlike_its_file(scenario: str) -> Place:
    """Where an aircraft unlike its file, in air unlike its site's, ends, x and z [m]."""
    flown = probed(scenario, EVERY, "rigid_body")
    path = fly_job(ScenarioJob(scenario=flown, seed=1, dispersed=True)).path
    return float(path["x_m"][-1]), float(path["z_m"][-1])


def _thrown() -> Place:
    flown = fly_passage(PassageJob(LAUNCH, seed=1))
    return flown.along_m, flown.across_m  # not of a landing here: where it is to the landing place


def _searched(*, dispersed: bool = False) -> Place:
    airframe = load_airframe(shipped("airframes/eclipson_c.toml"))
    polar = airframe.polar.as_polar()

    def plain(_: Sighting) -> MapSearch:
        search = MapSearch(polar)
        search.roll = roll_out
        return search

    there = place("hill", 1)._replace(duration_s=SEARCHED_S, dispersed=dispersed)
    path = fly_episode(there, airframe, "map", plain, plain=True).path
    return float(path["x_m"][-1]), float(path["z_m"][-1])


IN_TUNNEL, OVER_HILL = DISPERSED = ("dispersed, in the tunnel", "dispersed, over the hill")
SEARCHING: Final = "dispersed, searching"  # in air that the search draws by itself
STEPPING: Final = "a source that steps"  # twice at once, by less and by more than `EST_GATE`
FURTHER: Final[dict[str, Callable[[], Place]]] = {
    IN_TUNNEL: partial(_unlike_its_file, "static"),
    OVER_HILL: partial(_unlike_its_file, "speed"),
    "a brake": partial(_changed, "point", 15.0, BRAKED, EVERY),
    "home from the hill": partial(_changed, "speed", 25.0, {"ESC_START": 1.0}),
    "beating": partial(_changed, "speed", 25.0, {"BEAT_START": 1.0}),
    "from the hand": _thrown,
    "a search": _searched,
    SEARCHING: partial(_searched, dispersed=True),
    "faults": partial(
        _changed,
        "static",
        12.0,
        {},
        EVERY,
        ("position.freeze start=3 for=0.6", "position.noise start=6", "imu.dropout start=9 for=1"),
    ),
    STEPPING: partial(
        _changed,
        "speed",
        12.0,
        {},
        EVERY,
        (
            "position.bias start=4 for=4 north=0.3 east=0 down=0",
            "position.bias start=4.3 for=4 north=0.8 east=0.3 down=0",
        ),
    ),
}
# By page and by the name in a section's marks: what its flights do beside soaring.
SECTIONS: Final[dict[tuple[str, str], tuple[str, ...]]] = {
    ("point.md", "point"): ("a brake", *DISPERSED),
    ("outdoors.md", "outdoors"): ("home from the hill", "from the hand", OVER_HILL),
    ("outdoors.md", "satellites"): ("home from the hill", OVER_HILL, "faults", STEPPING),
    ("outdoors.md", "rangefinder"): (OVER_HILL, "faults"),
    ("outdoors.md", "hour"): ("home from the hill", OVER_HILL),
    ("outdoors.md", "beating"): ("home from the hill", "beating", OVER_HILL),
    ("margins.md", "margins"): (),
    ("margins.md", "unseen"): (IN_TUNNEL,),
    ("margins.md", "dispersed"): (),
    ("margins.md", "leans"): (IN_TUNNEL,),
    ("margins.md", "latency"): DISPERSED,
    ("margins.md", "airframes"): (),
    ("search.md", "search"): ("a search", SEARCHING),
    ("search.md", "nowhere"): ("a search", "home from the hill", SEARCHING),
    ("search.md", "throttle"): ("a search", SEARCHING),
    ("search.md", "survey"): (IN_TUNNEL,),
    ("theory.md", "places --field SITE"): (IN_TUNNEL,),
    ("safety.md", "campaign"): ("faults",),
    ("safety.md", "dispersed"): ("faults", IN_TUNNEL),
    ("campaigns.md", "speed"): (),
    ("gym.md", "baseline"): (),
}
# The same of what was copied by hand from a command's output.
BY_HAND: Final[dict[tuple[str, str], tuple[str, ...]]] = {("campaigns.md", "rare"): (IN_TUNNEL,)}


def probe_for(page: str, section: str) -> Ends:
    """Where the probes of a section end now, x and z [m].  Errors: KeyError."""
    return probe() | {name: FURTHER[name]() for name in SECTIONS[page, section]}


# Of the pages that are written whole: all that they hold is flown dispersed too.
PAGES: Final = {PAPER: DISPERSED, AIMS: (IN_TUNNEL,)}


def probe_for_page(page: str) -> Ends:
    """The same of a page that is written whole.  Errors: KeyError."""
    return probe() | {name: FURTHER[name]() for name in PAGES[page]}


def stamped(page: str, section: str, written: str) -> str:
    """A section as it is written, with its probes and its sum.  Errors: KeyError."""
    return sealed(written, probe_for(page, section))
