"""What stands under the table of a flight between processes: what a reader would not see in it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import hypot, isfinite
from typing import Final

from tgl_soar.air.zeuc import REACH_M, Crossing
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Site
from tgl_soar.sim.faults import Fault, parse_faults
from tgl_soar.sim.operator import FlownLeg, LastTelemetry
from tgl_soar.sim.score import LegScore
from tgl_soar.sim.sensors import RECEIVERS
from tgl_soar.sim.sitl_options import SitlOptions

# So far from its place an aircraft is not there yet: as is asked of one outdoors whose position
# does not drift, beyond what the turbulence moves it, and beyond what a receiver's drift does.
AWAY_M: Final = 0.3
SIGMAS: Final = 3.0
AFTER_S: Final = 5.0  # so long after a fault is over, what is reported may still be of it
MODULE: Final = "tgl_soar: "
# What a module says at every start, or of what belongs to this simulation.
USUAL: Final = ("code:", "parameters changed over the air", "listening on", "OptiTrack:")
# What belongs to a line that is moved, and to no fault.
MOVES: Final = "capturing: line moves"
STANDS: Final = "soaring: on the line"
BREAKS_OFF: Final = "breaking off: "
STARTED: Final = ("boot", "standby:", "ready:")


def start_words(lines: Sequence[str]) -> Iterator[str]:
    """What a module has warned of when it started.  lines: all that it has printed."""
    for line in lines:
        words = line.removeprefix(MODULE)
        if words.startswith(STARTED):
            return
        if words and not words.startswith(USUAL):
            yield f"the module: {words}"


def place_words(
    options: SitlOptions,
    site: Site,
    values: ParameterSet,
    flown: Sequence[FlownLeg],
    scores: Sequence[LegScore],
    crossings: Sequence[Crossing | None],
) -> Iterator[str]:
    """Legs that were over before the aircraft was where it settles, and those without a place.

    Where a point is held, or the wind changes, the place that is known is not where it settles.
    """
    holds = dict(options.settings).get("TGL_HOLD", values["TGL_HOLD"]) != 0.0
    changes = getattr(site.air, "record", None) is not None
    receiver = RECEIVERS[options.receiver]
    drift_m = SIGMAS * hypot(receiver.drift_m, receiver.drift_up_m)
    for leg, score, crossing in zip(flown, scores, crossings, strict=True):
        if crossing is None:
            yield (
                f"{score.name}: –: within {REACH_M:g} m of this line's point the simulated wind has"
                " no place where updraft equals the airframe's sink and an aircraft settles"
            )
            continue
        least_m = AWAY_M + drift_m
        away = score.crossing_m > max(least_m, SIGMAS * score.dispersion_m)
        if away and not (holds or changes or leg.broken_off or leg.released or leg.by_hand):
            where = f"still {score.crossing_m:.1f} m from its place"
            yield f"{score.name}: {where}: give a longer --stay"


def broken_off_words(flown: Sequence[FlownLeg], telemetry: LastTelemetry) -> Iterator[str]:
    """Legs that the way home has ended, and why, in the module's words."""
    texts = [text for _, text in telemetry.reported if text.startswith(BREAKS_OFF)]
    why = f": {texts[-1].removeprefix(BREAKS_OFF)}" if texts else ""
    for leg in flown:
        if leg.broken_off and isfinite(leg.stopped_s):
            stood_s = leg.ended_s - leg.stopped_s
            yield f"{leg.leg.name}: broken off after {stood_s:.1f} s of {leg.leg.stay_s:g} s{why}"
        elif leg.broken_off:
            yield f"{leg.leg.name}: broken off before its line stood{why}"


def search_words(flown: Sequence[FlownLeg]) -> Iterator[str]:
    """What a search has found."""
    for leg in flown:
        if leg.leg.searches and leg.found and isfinite(leg.stopped_s):
            yield (
                f"{leg.leg.name}: a place claimed after {leg.stopped_s - leg.asked_s:.1f} s,"
                f" at x {leg.found['TGL_X']:.2f} m, z {leg.found['TGL_Z']:.2f} m"
            )


def fault_words(options: SitlOptions, telemetry: LastTelemetry) -> Iterator[str]:
    """What the module has reported of each fault."""
    for fault in parse_faults(options.faults):
        yield f"fault {fault}: {_reported(fault, telemetry)}"


def _reported(fault: Fault, telemetry: LastTelemetry) -> str:
    if not fault.start_s <= telemetry.time_s:
        return f"not injected: the flight was over at {telemetry.time_s:.1f} s"
    until_s = fault.end_s + AFTER_S
    texts, before = [], ""
    for time_s, text in telemetry.reported:
        is_of_the_line = text == MOVES or (before, text) == (MOVES, STANDS)
        if fault.start_s <= time_s <= until_s and not is_of_the_line:
            texts.append(f"{text} ({time_s:.1f} s)")
        before = text
    return "the module reported " + ("; ".join(texts) or "nothing")
