"""The paper's flight between real processes over real sockets: `tgl-soar sitl`.

Three take part, each with its own socket on the loopback interface:

    bridge     a process: the Pixhawk and the world         tools/sitl_bridge.py
    module     a process: what flies                        tgl-soar run
    operator   this process: a ground station that engages and moves the line a → b → c

In lockstep (the default) the bridge waits for both others at every step, so that the flight
runs as fast as the machine allows and the same seed gives the same flight.  In real time it
waits for nobody, and other ground stations may take part at 127.0.0.1:14550; where a busy machine
has interrupted the flight the operator engages again, a few times, and reports it.
"""

from __future__ import annotations

import csv
import json
import os
import select
import socket
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, replace
from math import inf, isfinite, radians
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.zeuc import Crossing, stable_crossing
from tgl_soar.config.files import line_parameters, load_flight
from tgl_soar.config.parameters import ParameterError, ParameterSet, checked_value
from tgl_soar.config.site import Site
from tgl_soar.control.envelope import outside
from tgl_soar.control.laws import fence_of
from tgl_soar.control.target_line import eta_from_lean
from tgl_soar.sim.bridge.slowness import TOO_SLOW
from tgl_soar.sim.operator import FlownLeg, Operator, OperatorError, PlannedLeg
from tgl_soar.sim.score import LegScore, score_leg
from tgl_soar.sim.sitl_landing import Landing, touchdown
from tgl_soar.sim.sitl_notes import (
    broken_off_words,
    fault_words,
    place_words,
    search_words,
    start_words,
)
from tgl_soar.sim.sitl_options import SitlError, SitlOptions
from tgl_soar.sim.sitl_processes import (
    SitlProcesses,
    airframe_for,
    bridge_command,
    free_address,
    module_command,
    prepared,
    site_for,
)
from tgl_soar.sim.throw import place_to_throw
from tgl_soar.sim.world import site_field

Floats = NDArray[np.float64]
# For the first datagram, and for each one in lockstep, where a busy machine only makes the flight
# slow: a process that has died is found at once, this is for one that hangs.
START_S = 120.0
SILENCE_S = 20.0  # in real time without a datagram for so long the bridge is taken for dead
SEARCH = "search"  # the name of the leg that looks for lift
SURVEY = "survey"
SURVEY_S = 180.0  # at most
ROOM_M = 1.0  # within the fence before and over a hand: the throw alone takes 0.4 m
AGAIN = 3  # engagements after the first, in real time


@dataclass(frozen=True)
class SitlFlight:
    """What was flown, and how well."""

    flown: list[FlownLeg]
    scores: list[LegScore]
    crossings: list[Crossing | None]
    lines: list[tuple[float, float, float]]
    truth: dict[str, Floats]  # columns of the bridge's log
    wall_s: float
    killed_s: float | None = None  # when the module was killed, on the autopilot's clock
    notes: tuple[str, ...] = ()  # what is to be known beside its numbers
    landing: Landing | None = None  # how it ended on its way home; None: it was not on it


def plan(site: Site, values: ParameterSet, options: SitlOptions) -> list[PlannedLeg]:
    """The legs by name, from the site's lines.  Errors: `SitlError`."""
    try:
        settings = {name: checked_value(name, value) for name, value in options.settings}
    except ParameterError as error:
        raise SitlError(str(error)) from None
    names = options.legs or (() if options.search else tuple(site.lines))
    search = PlannedLeg(SEARCH, {**settings, "SRCH_START": 1.0}, options.stay_s, searches=True)
    if not names and not options.search:
        raise SitlError(f"{options.site}: no [lines.NAME] tables, so there is nowhere to fly")
    unknown = [name for name in names if name not in site.lines]
    if unknown:
        raise SitlError(
            f"{options.site}: no line named {unknown[0]!r}; it has {', '.join(site.lines)}"
        )
    legs = [
        PlannedLeg(
            name,
            {"TGL_LEAN": values["TGL_LEAN"], **line_parameters(site.lines[name]), **settings},
            options.stay_s,
        )
        for name in names
    ]
    if options.survey and not legs:
        raise SitlError("a survey begins on a line: name one by --legs")
    if options.survey:
        begins = {**legs[-1].parameters, "SRV_START": 1.0}
        legs.append(PlannedLeg(SURVEY, begins, SURVEY_S, surveys=True))
    flown = [search] * options.search + legs
    return [replace(flown[0], launches=options.by_hand), *flown[1:]]


def fly(options: SitlOptions, progress: Callable[[Operator], None]) -> SitlFlight:
    """Fly the plan; `progress` is called a few times a second.

    Errors: `SitlError`, `tgl_soar.config.files.ConfigError`.
    """
    airframe, site, values = load_flight(options.airframe, options.site)
    if site.air is None:
        raise SitlError(f"{options.site}: no [air] table, so there is no wind to fly in")
    legs = plan(site, values, options)
    if options.mocap and site.mocap is None:
        raise SitlError(f"{options.site}: no [mocap] table, as sites/tunnel_mocap.toml has it")
    if options.by_hand:
        _check_hand(options, site, values)
    if options.goes_home and site.landing is None:
        raise SitlError(
            f"{options.site}: no [landing] table, so there is no place to land at; add one, or fly"
            " over a site that has one, such as --site hill"
        )
    truth_file, site_path = prepared(options), options.site
    if options.autopilot != "builtin":
        options = replace(options, airframe=airframe_for(options), site=site_for(options, site))
    begun = time.monotonic()
    operator = Operator(
        legs,
        airframe.autopilot.system_id,
        airframe.autopilot.component_id,
        when_armed=options.autopilot != "builtin",
        watch_s=options.watch_s,
        goes_home=options.goes_home,
        again=AGAIN if options.realtime and not options.faults and options.kill_s is None else 0,
        is_disturbed=bool(options.faults) and options.watch_s is None,
    )
    processes = SitlProcesses(options.out)
    killed_s = _fly(options, truth_file, operator, processes, progress)
    truth = _read_truth(truth_file)
    flown = [each for each in operator.flown if _is_scored(each, truth)]
    lines = [_line(each.found or each.leg.parameters) for each in flown]
    field, polar = site_field(site, site_path.parent, site_path), airframe.polar.as_polar()
    crossings = [stable_crossing(field, polar, line) for line in lines]
    scores = _scores(flown, lines, crossings, truth)
    notes = [
        *start_words(processes.printed("module")),
        *(f"engaged again after a hiccup of this machine: {w}" for w in operator.hiccups),
        *processes.lines_with("bridge", TOO_SLOW),
        *place_words(options, site, values, flown, scores, crossings),
        *broken_off_words(operator.flown, operator.telemetry),
        *search_words(flown),
        *fault_words(options, operator.telemetry),
    ]
    flight = SitlFlight(
        flown=flown,
        scores=scores,
        crossings=crossings,
        lines=lines,
        truth=truth,
        wall_s=time.monotonic() - begun,
        killed_s=killed_s,
        landing=_landing(operator, values, truth),
        notes=tuple(notes),
    )
    _write_summary(options, flight)
    return flight


def _check_hand(options: SitlOptions, site: Site, values: ParameterSet) -> None:
    """Errors: `SitlError` where nobody can stand to throw."""
    way_out = "fly over a slope, such as --site hill"
    if site.ground is None:
        raise SitlError(f"{options.site}: no [ground] table, so nobody can stand there; {way_out}")
    try:
        x_m, z_m = place_to_throw(site.ground.profile)
    except ValueError as error:
        raise SitlError(f"{options.site}: [ground] profile: {error}; {way_out}") from None
    fence = fence_of(values)
    if outside(fence, x_m, 0.0, z_m) or outside(fence, x_m - ROOM_M, 0.0, z_m + ROOM_M):
        where = f"x {x_m:.1f} m, z {z_m:.1f} m"
        raise SitlError(
            f"{options.site}: a hand at {where} has no {ROOM_M:g} m of room in the fence; {way_out}"
        )


def _fly(
    options: SitlOptions,
    truth_file: Path,
    operator: Operator,
    processes: SitlProcesses,
    progress: Callable[[Operator], None],
) -> float | None:
    """Start bridge and module, fly the plan, end both; when the module was killed."""
    ground_station = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    ground_station.bind(("127.0.0.1", 0))
    own_address = f"127.0.0.1:{ground_station.getsockname()[1]}"
    try:
        companion = options.companion if options.realtime else free_address()
        mocap = free_address() if options.mocap else ""
        processes.start(
            "bridge", bridge_command(options, truth_file, own_address, companion, mocap)
        )
        processes.start("module", module_command(options, companion, mocap))
        return _operate(operator, ground_station, processes, progress, options)
    except OperatorError as error:
        by_machine = options.realtime and error.is_of_machine
        hint = busy_hint(os.getloadavg()[0], os.cpu_count() or 1) if by_machine else ""
        raise SitlError(f"{error}{hint}\n{processes.last_words()}") from None
    finally:
        processes.stop()
        ground_station.close()


def _line(parameters: Mapping[str, float]) -> tuple[float, float, float]:
    """A leg's line: a point of it [m] and its angle eta [rad]."""
    eta_rad = eta_from_lean(radians(parameters["TGL_LEAN"]))
    return parameters["TGL_X"], parameters["TGL_Z"], eta_rad


STOOD_S = 2.0  # shorter, and nothing can settle on it, as of the report's legs


def _scores(
    flown: list[FlownLeg],
    lines: list[tuple[float, float, float]],
    crossings: list[Crossing | None],
    truth: dict[str, Floats],
) -> list[LegScore]:
    """How well each leg was held while its line stood; of one that somebody else has moved, since
    it was last seen to move, if it stood for long enough then."""
    scores = []
    for leg, line, crossing in zip(flown, lines, crossings, strict=True):
        stood_since = leg.moved_s <= leg.ended_s - STOOD_S
        begin_s = max(leg.stopped_s, leg.moved_s) if stood_since else leg.stopped_s
        rows = _rows_between(truth["time_s"], begin_s, leg.ended_s)
        scores.append(
            score_leg(
                leg.leg.name,
                line,
                _place(crossing),
                truth["time_s"][rows],
                truth["x_m"][rows],
                truth["z_m"][rows],
                truth["y_m"][rows],
                truth["roll_rad"][rows],
            )
        )
    return scores


def _rows_between(time_s: Floats, begin_s: float, end_s: float) -> NDArray[np.intp]:
    """The rows of a leg; of one that was over at once the two last of the flight until then."""
    rows = np.flatnonzero((time_s >= begin_s) & (time_s <= end_s))
    if rows.size < 2:
        last = min(max(int(np.searchsorted(time_s, end_s)), 1), time_s.size - 1)
        rows = np.array([last - 1, last])
    return rows


def _is_scored(flown: FlownLeg, truth: dict[str, Floats]) -> bool:
    """Whether it stood on a line: a survey is on none, nor a search that was over before it moved
    one, nor one that was broken off early."""
    if flown.leg.surveys or (flown.leg.searches and not flown.found):
        return False
    if not flown.broken_off:
        return True
    stood = (truth["time_s"] >= flown.stopped_s) & (truth["time_s"] <= flown.ended_s)
    return int(np.count_nonzero(stood)) > 1


def _landing(operator: Operator, values: ParameterSet, truth: dict[str, Floats]) -> Landing | None:
    """How it came down, where the module was on its way to the landing place."""
    if not operator.broke_off:
        return None
    told = operator.telemetry.parameters
    return touchdown(truth, {name: told.get(name, values[name]) for name in ("LND_X", "LND_Y")})


def passed(flight: SitlFlight) -> bool:
    """Whether every leg settled that nobody has moved or ended, and a landing was well."""
    held = all(
        (score.settled or flown.by_hand or flown.broken_off) and not flown.released
        for score, flown in zip(flight.scores, flight.flown, strict=True)
    )
    return held and (flight.landing is None or flight.landing.is_well)


def busy_hint(load: float, processors: int) -> str:
    """What a flight by the clock that failed may have failed of."""
    busy = f", whose load is {load:.1f} on {processors} processors," if load > processors else ""
    return (
        f"\n  this machine{busy} may be too busy for real time: close other programs, or fly in"
        " lockstep, without --realtime"
    )


def _operate(
    operator: Operator,
    ground_station: socket.socket,
    processes: SitlProcesses,
    progress: Callable[[Operator], None],
    options: SitlOptions,
) -> float | None:
    """Carry datagrams between the operator and the bridge until the plan is flown; when the
    module was killed."""
    bridge: tuple[str, int] | None = None
    kill_s, silence_s = options.kill_s, SILENCE_S if options.realtime else START_S
    killed_s: float | None = None
    received = shown = time.monotonic()
    while not operator.done:
        ready, _, _ = select.select([ground_station], [], [], 0.2)
        now = time.monotonic()
        if ready:
            data, sender = ground_station.recvfrom(65535)
            if bridge in (None, sender) and operator.receive(data):
                bridge, received = sender, now
        patience_s = START_S if bridge is None else silence_s
        if now - received > patience_s:
            hint = busy_hint(os.getloadavg()[0], os.cpu_count() or 1)
            raise SitlError(
                f"nothing received from the bridge for {patience_s:g} s{hint}\n"
                f"{processes.last_words()}"
            )
        processes.check()
        stood_s = operator.flown[0].stopped_s if operator.flown else inf
        if (
            kill_s is not None
            and killed_s is None
            and operator.telemetry.time_s - stood_s >= kill_s
        ):
            processes.kill("module")
            killed_s = operator.telemetry.time_s
        # Once there is simulated time the operator acts on what comes and at no other moment, so
        # that a lockstep flight repeats exactly.
        simulated = operator.telemetry.time_s
        if ready or not isfinite(simulated):
            for datagram in operator.step(simulated if isfinite(simulated) else now):
                if bridge is not None:
                    ground_station.sendto(datagram, bridge)
        if now - shown > 0.1:
            shown = now
            progress(operator)
    progress(operator)
    return killed_s


def _read_truth(path: Path) -> dict[str, Floats]:
    """The columns of the bridge's log."""
    with path.open(newline="") as file:
        rows = list(csv.reader(file))
    if len(rows) < 3:
        raise SitlError(f"{path}: the bridge logged no flight")
    table = np.array([[float(value) for value in row] for row in rows[1:]])
    return {name: table[:, i] for i, name in enumerate(rows[0])}


def _place(crossing: Crossing | None) -> tuple[float, float] | None:
    return None if crossing is None else (crossing.x_m, crossing.z_m)


def _write_summary(options: SitlOptions, flight: SitlFlight) -> None:
    summary = {
        "seed": options.seed,
        "turbulence": options.turbulence,
        "site": options.site.name,
        "airframe": options.airframe.name,
        "passed": passed(flight),
        "killed_s": flight.killed_s,
        "landing": _landing_numbers(flight.landing),
        "legs": [
            {
                **asdict(score),
                "predicted": _place(crossing),
                "by_hand": flown.by_hand,
                "broken_off": flown.broken_off,
                "line": line,
                "stood_s": (flown.stopped_s, flown.ended_s),
            }
            for score, crossing, flown, line in zip(
                flight.scores, flight.crossings, flight.flown, flight.lines, strict=True
            )
        ],
    }
    text = json.dumps(_as_json(summary), indent=2, allow_nan=False)
    (options.out / "summary.json").write_text(text + "\n")


def _landing_numbers(landing: Landing | None) -> dict[str, object] | None:
    return None if landing is None else {**asdict(landing), "well": landing.is_well}


def _as_json(value: Any) -> Any:
    """The same with null for what is no number, or without end: JSON has neither."""
    if isinstance(value, dict):
        return {name: _as_json(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_as_json(each) for each in value]
    return None if isinstance(value, float) and not isfinite(value) else value
