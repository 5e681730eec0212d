"""Every experiment by name: the paper's as it tells them, then our own (`OURS`)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Final

from tgl_soar.analysis.experiments.aircraft import airframes, dispersed, identification, unseen
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.estimates import estimator, incidence, wind_estimate, wind_use
from tgl_soar.analysis.experiments.lift import (
    forecast,
    lift_map,
    nowhere,
    search,
    survey,
    throttle,
)
from tgl_soar.analysis.experiments.loop import (
    command_delay,
    latency,
    leans,
    margin_tables,
)
from tgl_soar.analysis.experiments.outdoors import beating, hour, outdoors, rangefinder, satellites
from tgl_soar.analysis.experiments.paper import (
    air_speed,
    changing_air,
    field,
    gust_response,
    line_lean,
    places,
    still_lines,
)
from tgl_soar.analysis.experiments.point import hold_point
from tgl_soar.analysis.experiments.result import DISPERSED_AIRCRAFT, POINT_MASS, Result
from tgl_soar.config.files import ConfigError

EXPERIMENTS: Final[dict[str, Callable[[Context], Result]]] = {
    "field": field.run,
    "places": places.places,
    "static": still_lines.static,
    "translate": still_lines.translate,
    "back": still_lines.back,
    "rotate": still_lines.rotate,
    "slope": changing_air.slope,
    "wind": changing_air.wind,
    "gust": gust_response.gust,
    "lean": line_lean.lean,
    "speed": air_speed.speed,
    "identification": identification.identification,
    "estimator": estimator.estimator,
    "wind_estimate": wind_estimate.wind_estimate,
    "wind_use": wind_use.wind_use,
    "command_delay": command_delay.command_delay,
    "dispersed": dispersed.dispersed,
    "unseen": unseen.unseen,
    "leans": leans.leans,
    "airframes": airframes.airframes,
    "margins": margin_tables.margins,
    "latency": latency.latency,
    "incidence": incidence.incidence,
    "lift_map": lift_map.run,
    "search": search.run,
    "throttle": throttle.run,
    "survey": survey.run,
    "nowhere": nowhere.run,
    "forecast": forecast.run,
    "point": hold_point.run,
    "outdoors": outdoors.run,
    "satellites": satellites.run,
    "rangefinder": rangefinder.run,
    "hour": hour.run,
    "beating": beating.run,
}

# Our own aims; the others are the paper's claims and fly on either model.  These are about what
# a point mass lacks: a short period, servos, accelerations, a wing that the air is estimated from.
RIGID_BODY_ALONE: Final = (
    "identification",
    "estimator",
    "wind_estimate",
    "wind_use",
    "command_delay",
    "dispersed",
    "unseen",
    "leans",
    "airframes",
    "margins",
    "latency",
    "incidence",
    "lift_map",
    "search",
    "throttle",
    "survey",
    "nowhere",
    "forecast",
    "point",
    "outdoors",
    "satellites",
    "rangefinder",
    "hour",
    "beating",
)
OURS: Final = frozenset(RIGID_BODY_ALONE)
# `all` leaves them out: they have pages of their own; the first takes longer than all others, the
# others fly other airframes, or other satellites.
APART: Final = (
    *("search", "throttle", "survey", "nowhere", "point", "outdoors", "satellites", "hour"),
    "beating",
    *("rangefinder", "unseen", "dispersed", "leans", "airframes", "margins", "latency"),
)
# By the name under which they are flown together: both pages, and either of them.
TOGETHER: Final = {
    "all": tuple(name for name in EXPERIMENTS if name not in APART),
    "paper": tuple(name for name in EXPERIMENTS if name not in OURS),
    "aims": tuple(name for name in EXPERIMENTS if name in OURS and name not in APART),
}
NOT_FLOWN: Final = ("field",)  # computed from the air alone

# Why these do not fly with `--dispersion`; all others do.
NOT_DISPERSED: Final = {
    "field": "flies nothing; `places` flies its places, dispersed too",
    "margins": "flies nothing; `dispersed` looks at drawn aircraft on the same linear model",
    "dispersed": "draws each aircraft further apart than that, and unlike its own file; the air"
    " is the site's own",
    "airframes": "draws each aircraft, and its file is what a glide's log says of it; the air is"
    " the site's own",
    "lift_map": "draws air and sink, and flies no aircraft: a line that is held without error",
    "forecast": "draws air and sink, and flies no aircraft: a line that is held without error;"
    " `nowhere` flies it whole, dispersed too",
}
DISPERSED: Final = tuple(name for name in EXPERIMENTS if name not in NOT_DISPERSED)

TITLES: Final = {
    "field": "a hill of potential flow, an illustrative polar, three places",
    "places": "flights at three places: near the stall, at best glide, beyond it",
    "static": "a line that stands still",
    "translate": "the line moves downstream, a to b to c",
    "back": "the line moves back upstream, c to b to a",
    "rotate": "the line turns",
    "slope": "the board from 23° to 25°, the line translating",
    "wind": "8.5 to 9.5 m/s, the line still",
    "gust": "updraft and sink right after a change of wind",
    "lean": "lines less perpendicular to the contour, upright, leaning downwind",
    "speed": "oscillation with fixed gains as airspeed grows",
    "identification": "a gliding test flight's log, and the model that flew it",
    "estimator": "how much accelerometers improve estimate and flight",
    "wind_estimate": "estimated wind and updraft, compared with the true air",
    "wind_use": "laws that use the estimated wind, beside those that do not",
    "command_delay": "flights with commands later than the known delay",
    "dispersed": "flights of aircraft drawn at random about the airframe file",
    "unseen": "an aircraft and air for which no gain was tuned, beside a plain PID",
    "leans": "every accepted lean, on the shipped aircraft",
    "airframes": "aircraft of any size, from a glide's log to the line",
    "margins": "margins of the loops, by the linear model",
    "latency": "leans and places, with a faster and a slower link",
    "incidence": "the estimated angle of attack, compared with the true one",
    "lift_map": "how far the lift map can be trusted",
    "search": "a place to soar without knowing the wind",
    "throttle": "the search with a propeller to fall back on",
    "survey": "the contour, surveyed by a slide there and back",
    "nowhere": "starts on a line without a place to settle",
    "forecast": "which lines are reported to have no place to settle, and which wrongly",
    "point": "a point of the line held with a brake",
    "outdoors": "launches from the hand, and break-offs that end on the ground",
    "satellites": "a receiver that drifts, steps and falls silent; an estimator that is reset",
    "rangefinder": "a position that drifts, with and without a rangefinder",
    "hour": "up to an hour in a wind that turns, dies and comes again",
    "beating": "beating along the ridge, in a wind too slow or too oblique to hover in",
}


def run(name: str, context: Context) -> Result:
    """Run one experiment by name.

    Errors: KeyError, ImportError for figures; `ConfigError`, also for a model that it does not fly.
    """
    if context.model == "point_mass" and name in RIGID_BODY_ALONE:
        raise ConfigError(f"{name}: flies the rigid body alone; leave --model out")
    if context.dispersion and name in NOT_DISPERSED:
        raise ConfigError(f"{name}: no --dispersion: {NOT_DISPERSED[name]}")
    begun = time.monotonic()
    result = EXPERIMENTS[name](context)
    return replace(result, own=name in OURS, seconds=time.monotonic() - begun)


def run_whole(name: str, context: Context) -> Result:
    """Run one experiment, and with it the same on the point mass and on dispersed aircraft, where
    these can fly it.

    Figures are those of the first.  Errors: those of `run`.
    """
    result = run(name, replace(context, model="rigid_body"))
    other = replace(context, figures=None)
    also: dict[str, Result] = {}
    if name not in RIGID_BODY_ALONE and name not in NOT_FLOWN:
        also[POINT_MASS] = run(name, replace(other, model="point_mass"))
    if name in DISPERSED:
        also[DISPERSED_AIRCRAFT] = run(name, replace(other, model="rigid_body", dispersion=True))
    seconds = result.seconds + sum(each.seconds for each in also.values())
    return replace(result, also=also, seconds=seconds)
