"""`places`: the paper's [a], [b] and [c] flown, near the stall, at best glide and beyond it.

[a] is where sink falls as wind grows, S′ = d sink / d u < 0, between the polar's slow end and its
least sink; [b] is best glide, sink/u = S′; [c] is beyond it.  The paper draws them on a hill of
potential flow (`field` computes those); here the aircraft is flown at each of them, on the hill,
before the board, and in that board's wind as the polynomial of position that the paper simulates;
or in the air of any other site file in their place.

A contour holds only some speeds, so each place is flown in the wind nearest to the site's own, in
steps of a twentieth, whose contour holds it within the bounds of the site.
"""

from __future__ import annotations

from math import cos, hypot, inf, isfinite, nan, sin
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np

from tgl_soar.air.zeuc import ZeucError, stable_crossing, wind_sensitivity
from tgl_soar.analysis.experiments.context import Context, turbulence_of, with_turbulence
from tgl_soar.analysis.experiments.flights import FlownScenario, mean_of_flights, rms
from tgl_soar.analysis.experiments.paper.changing_air import LATE_S, Shift, shift_of
from tgl_soar.analysis.experiments.paper.line_lean import HELD_M
from tgl_soar.analysis.experiments.paper.still_lines import leg_by_line, pooled_or_nan
from tgl_soar.analysis.experiments.result import (
    RESOLVED,
    ChangedThreshold,
    Claim,
    Result,
    Table,
    above,
    all_of,
    decided,
)
from tgl_soar.analysis.experiments.scenario import (
    PreparedScenario,
    Scenario,
    TimedChange,
    WindSchedule,
    prepare,
    search_bounds,
    slide_at,
)
from tgl_soar.analysis.experiments.spread_along_line import dryden_dispersion, leverage
from tgl_soar.config.files import ConfigError, load_site, shipped
from tgl_soar.estimation.polar import best_glide_speed
from tgl_soar.sim.world import ground_outline
from tgl_soar.types import polar_slope

SLOW: Final = ("a", "a2")
SITES: Final = ("sites/hill.toml", "sites/tunnel.toml", "sites/tunnel_polynomial.toml")
WINDS: Final = (1.0, 0.95, 1.05, 0.9, 1.1, 0.85, 1.15)  # of the site's own, the nearest first
# The wind of the second half, over that of the first: as much as a mean wind is known to, and small
# enough that no place comes to the polar's end.
STRONGER: Final = 1.03
RISES_S: Final = (40.0, 45.0)  # while the wind does
STEP_S: Final = 100.0  # a flight with that step in it
# The slowest slide, on the hill: 1/λ is 8 s, and after two of them 13 % of a shift are still to go.
LEFT_ALONE_S: Final = 17.0
JUDGED, ROUGH = 0.01, 0.03  # turbulence
SLOPE_OVER_M: Final = 0.1  # two cells of the public CFD planes
# How long before the end of a flight a wing that stalled counts as its reason: the slide down from
# the place takes some two seconds (a metre at the sink's growth of 0.5 m/s²).
STALLED_WITHIN_S: Final = 3.0
CHANGED: Final = (
    ChangedThreshold(
        "more wind lifts it at [a], lowers it at [c], and at [b] is in between",
        "2 standard errors, by the file's formula of dispersion",
        f"{RESOLVED:g} standard errors, by the flights' own shifts; undecided within them",
        "aircraft that are not alike move by more or less than the file's does",
    ),
)


class FlownPlace(NamedTuple):
    """One place in one air, and what became of the flights there."""

    site: str
    line: str
    wind_mps: float  # of the site
    x_m: float
    z_m: float
    local_mps: float
    speed_ratio: float  # that, over best glide's
    polar_slope: float  # S′
    margin: float  # sink/u − S′
    leverage: float  # sin η − S′ cos η
    rate_per_s: float  # λ
    wind_slope_per_s: float  # how local wind grows up the line
    flights: int
    survived: dict[float, int]  # by turbulence
    rms_e_rho_m: dict[float, float]  # over all flights; inf: one was lost
    dispersion_m: dict[float, float]  # of each flight about its own place
    apart_m: dict[float, float]  # standard deviation of the flights' mean places
    formula_m: dict[float, float]
    shift: Shift  # in STRONGER times the wind
    shift_lost: int
    stalled: int  # of all flights that were lost, those whose wing was beyond its stall before
    ended: tuple[str, ...]  # why flights were lost

    @property
    def lost(self) -> int:
        """Of the flights at both turbulences and with the step."""
        return sum(self.flights - up for up in self.survived.values()) + self.shift_lost


def places(context: Context) -> Result:
    """Fly all three in every air."""
    scenario = context.scenario("places")
    sites = [shipped(site) for site in SITES] if context.field is None else [context.field]
    here = {
        (load_site(site).site.name, line): in_its_wind(scenario, site, line)
        for site in sites
        for line in scenario.lines
    }
    variants: dict[Any, Scenario] = {}
    for key, (place, wind_mps) in here.items():
        for intensity in (JUDGED, ROUGH):
            variants[key, intensity] = with_turbulence(place, intensity)
        variants[key, "step"] = stepped(place, wind_mps)
    flights = context.fly(variants)
    scored = [
        score_place(key, wind_mps, place, {what: flights[key, what] for what in (JUDGED, ROUGH)},
                    variants[key, "step"], flights[key, "step"])
        for key, (place, wind_mps) in here.items()
    ]  # fmt: skip
    return Result(
        name="places",
        title=scenario.title,
        flown="Still lines through [a] and [a2], near the stall, where sink falls as wind grows;"
        " [b], best glide; and [c], beyond it; at"
        f" {', '.join(f'{spec.speed_ratio:g}' for spec in scenario.lines.values())} of best glide's"
        f" speed, {_where(context)}; each place in the wind nearest to the site's own that has it."
        f" A minute each; and once more with {100 * (STRONGER - 1):.0f} % more wind half-way.",
        claims=place_claims(scored),
        why=places_why(scored),
        tables=(Table("", COLUMNS, tuple(_row(s) for s in scored)),),
        numbers={"places": [s._asdict() | {"shift": s.shift._asdict()} for s in scored]},
        figures=_draw(context, here),
        scenarios=("places",),
        seeds=tuple(scenario.seeds),
        changed=CHANGED,
    )


def _where(context: Context) -> str:
    if context.field is not None:
        return "in the air of a site given by `--field`"
    return (
        "on the hill, before the board of the tunnel, and in that tunnel's wind as a polynomial of"
        " position"
    )


def in_its_wind(scenario: Scenario, site: Path, line: str) -> tuple[Scenario, float]:
    """The scenario on one line of one site, and the wind [m/s] that has it.

    Errors: `ConfigError`: no wind of those tried has the place, or there is no air.
    """
    air = load_site(site).air
    if air is None:
        raise ConfigError(f"{site}: no [air] table, so there is no wind to fly in")
    alone = msgspec.structs.replace(
        scenario, site=str(site), first_line=line, lines={line: scenario.lines[line]}
    )
    refused = ""
    for factor in WINDS:
        wind_mps = factor * air.wind_mps
        steady = WindSchedule(times_s=[0.0, 1.0], mps=[wind_mps, wind_mps])
        tried = msgspec.structs.replace(alone, wind=steady)
        try:
            prepare(tried)
        except ConfigError as error:
            refused = str(error)
            continue
        return tried, wind_mps
    raise ConfigError(
        f"{site}: lines.{line} is nowhere in {100 * min(WINDS):.0f} to {100 * max(WINDS):.0f} % of"
        f" its wind of {air.wind_mps:g} m/s; in the last: {refused}"
    )


def stepped(scenario: Scenario, wind_mps: float) -> Scenario:
    """The same in a wind that rises half-way; a second leg begins where it is settled."""
    begun, done = RISES_S
    return msgspec.structs.replace(
        with_turbulence(scenario, JUDGED),
        duration_s=STEP_S,
        wind=WindSchedule(times_s=[begun, done], mps=[wind_mps, STRONGER * wind_mps]),
        changes=[TimedChange(time_s=done, line=scenario.first_line)],
        unscored_s=[(0.0, LEFT_ALONE_S), (begun, done + LEFT_ALONE_S)],
    )


def score_place(
    key: tuple[str, str],
    wind_mps: float,
    scenario: Scenario,
    still: dict[float, list[FlownScenario]],
    step: Scenario,
    stepping: list[FlownScenario],
) -> FlownPlace:
    """All flights at one place."""
    site, line = key
    prepared = prepare(scenario)
    target, at = prepared.lines[line]
    assert at is not None
    slide = slide_at(prepared.polar, target, at)
    risen = prepare(step)
    formula = {
        i: dryden_dispersion(slide, *turbulence_of(prepare(with_turbulence(scenario, i))))
        for i in still
    }
    every = [flight for flown in (*still.values(), stepping) for flight in flown]
    whose = prepared.airframe  # a point mass has an angle of attack, and no stall
    stall = whose.model["stall_alpha_rad"] if whose.model_kind == "rigid_body" else inf
    return FlownPlace(
        site=site,
        line=line,
        wind_mps=wind_mps,
        x_m=at.x_m,
        z_m=at.z_m,
        local_mps=at.wind_mps,
        speed_ratio=at.wind_mps / best_glide_speed(prepared.polar),
        polar_slope=polar_slope(prepared.polar, at.wind_mps),
        margin=wind_sensitivity(prepared.field, prepared.polar, at, target.eta_rad).margin,
        leverage=leverage(slide),
        rate_per_s=slide.rate_per_s,
        wind_slope_per_s=wind_slope(prepared, line),
        flights=len(still[JUDGED]),
        survived={i: sum(f.survived for f in flown) for i, flown in still.items()},
        rms_e_rho_m={i: _rms_of_all(flown) for i, flown in still.items()},
        dispersion_m={i: pooled_or_nan(leg_by_line(f, line, 0)) for i, f in still.items()},
        apart_m={
            i: mean_of_flights(leg.along_m for leg in leg_by_line(f, line, 0)).apart
            for i, f in still.items()
        },
        formula_m=formula,
        shift=_shift(risen, stepping, line),
        shift_lost=sum(not f.survived for f in stepping),
        stalled=sum(_stalled(f, stall) for f in every if f.ended),
        ended=tuple(f.ended for f in every if f.ended),
    )


def _stalled(flight: FlownScenario, stall_rad: float) -> bool:
    """Whether its wing was beyond the stall shortly before the end."""
    last = flight.path["time_s"] >= flight.duration_s - STALLED_WITHIN_S
    return bool(np.any(flight.path["alpha_rad"][last] > stall_rad))


def wind_slope(prepared: PreparedScenario, line: str) -> float:
    """How the wind grows up the line at its place [1/s]."""
    target, at = prepared.lines[line]
    assert at is not None
    c, s = cos(target.eta_rad) * SLOPE_OVER_M, sin(target.eta_rad) * SLOPE_OVER_M
    below, above = (
        prepared.field.wind_at(at.x_m + way * c, 0.0, at.z_m + way * s, 0.0)[0]
        for way in (-0.5, 0.5)
    )
    return (above - below) / SLOPE_OVER_M


def _rms_of_all(flights: list[FlownScenario]) -> float:
    whole = [f.legs[0].rms_e_rho_m for f in flights if f.survived and f.legs]
    return rms(whole) if len(whole) == len(flights) else inf


def _shift(prepared: PreparedScenario, flights: list[FlownScenario], line: str) -> Shift:
    """As flown and as predicted; NaN where the contour of the stronger wind has left the line."""
    try:
        gone = stable_crossing(prepared.field, prepared.polar, prepared.lines[line].target, LATE_S)
    except ZeucError:
        gone = None
    shift = shift_of(prepared, flights, line)
    return shift if gone is not None else shift._replace(predicted_m=nan)


def place_claims(scored: list[FlownPlace]) -> tuple[Claim, ...]:
    """Of each air: where [a] lies, who is held where, which way more wind moves them."""
    claims: list[Claim] = []
    for site in dict.fromkeys(s.site for s in scored):
        of = {s.line: s for s in scored if s.site == site}
        a, b, c = (of[line] for line in "abc")
        slow, others = [s for s in of.values() if s.line in SLOW], [b, c]
        claims += [
            Claim(
                f"at [a] sink falls as wind grows ({site})",
                all(s.polar_slope < 0.0 for s in slow),
                ", ".join(f"S′ {s.polar_slope:+.3f} at [{s.line}]" for s in of.values()),
                # [a] is named by a speed that is slower than that of least sink.
                by_construction=True,
            ),
            *(
                Claim(
                    f"the aircraft is held at {where}, within {100 * HELD_M:g} cm rms ({site})",
                    all(s.rms_e_rho_m[JUDGED] <= HELD_M for s in several),
                    "; ".join(_held(s) for s in several),
                )
                for where, several in (("[a]", slow), ("[b] and [c]", others))
            ),
            decided(
                f"more wind lifts it at [a], lowers it at [c], and at [b] is in between ({site})",
                all_of(
                    (
                        above(a.shift.flown_m, a.shift.error_m),
                        above(-c.shift.flown_m, c.shift.error_m),
                        *(_more(one.shift, other.shift) for one, other in ((a, b), (b, c))),
                        not any(s.shift_lost for s in (a, b, c)),
                    )
                ),
                ", ".join(_shifted(s) for s in of.values()),
            ),
        ]
    return tuple(claims)


def _more(one: Shift, other: Shift) -> bool | None:
    """Whether one place is lifted by more than another."""
    return above(one.flown_m - other.flown_m, hypot(one.error_m, other.error_m))


def _held(s: FlownPlace) -> str:
    rms_e_rho_m = s.rms_e_rho_m[JUDGED]
    rest = "" if rms_e_rho_m == inf else f", {_cm(rms_e_rho_m)} cm"
    return f"{s.survived[JUDGED]} of {s.flights} at [{s.line}]{rest}"


def _shifted(s: FlownPlace) -> str:
    lost = f" ({s.shift_lost} of {s.flights} lost)" if s.shift_lost else ""
    if not isfinite(s.shift.flown_m):
        return f"all lost at [{s.line}]"
    return f"{_shift_cm(s)} cm at [{s.line}]{lost}"


def _shift_cm(s: FlownPlace) -> str:
    error = f"{100 * s.shift.error_m:.1f}" if isfinite(s.shift.error_m) else "–"
    return f"{100 * s.shift.flown_m:+.1f} ± {error}"


def places_why(scored: list[FlownPlace]) -> str:
    """What near the stall is otherwise than elsewhere."""
    text = []
    for site in dict.fromkeys(s.site for s in scored):
        of = {s.line: s for s in scored if s.site == site}
        lost = ", ".join(f"{s.lost} at [{s.line}]" for s in of.values())
        text.append(
            f"{site}: wind grows by {of['a'].wind_slope_per_s:+.2f} m/s for each metre up the line"
            f" at [a]; lost of {_flown(of['a'])} at {100 * JUDGED:g} % and {100 * ROUGH:g} % of"
            f" turbulence and in the stronger wind: {lost}"
        )
    reasons = list(dict.fromkeys(end.split(" at x")[0] for s in scored for end in s.ended))
    return (
        ". ".join(text)
        + "."
        + (f" Flights ended by: {', '.join(reasons)}." if reasons else "")
        + " A line that leans upwind is stable at either sign of S′: sin η − S′ cos η is"
        f" {min(s.leverage for s in scored):.2f} to {max(s.leverage for s in scored):.2f} at all of"
        " these places. But the contour is that of the polar, which ends at the stall."
        + _lost_near_the_stall([s for s in scored if s.line in SLOW])
    )


def _flown(s: FlownPlace) -> int:
    """At both turbulences and with the step."""
    return s.flights * (len(s.survived) + 1)


def _lost_near_the_stall(slow: list[FlownPlace]) -> str:
    """Of all flights there: whether their wings stalled, and what the wind does down the line."""
    lost = sum(s.lost for s in slow)
    if not lost:
        return f" Near it no flight of {sum(map(_flown, slow))} was lost."
    stalled = sum(s.stalled for s in slow)
    falls = sum(s.lost for s in slow if s.wind_slope_per_s > 0.0)
    text = (
        f" Near it {lost} flights of {sum(map(_flown, slow))} were lost; in {stalled} of them the"
        f" angle of attack was beyond the stall's within the last {STALLED_WITHIN_S:g} s."
    )
    if falls < lost:
        return text + (
            f" {falls} were lost where the wind falls going down the line, and {lost - falls} where"
            " it grows: what the wind does along the line is not the whole reason."
        )
    return text + (
        f" All {falls} were where the wind falls going down the line: an aircraft that a gust puts"
        " below [a] is in slower air there"
        + (
            ", and its wing, which has no more lift to give, stalls and slides on down; where the"
            " wind grows going down, it is in faster air and comes back."
            if 2 * stalled > lost
            else ", but most of them did not stall: the wind's slope alone is not shown to be the"
            " reason."
        )
    )


COLUMNS: Final = (
    "air", "place", "wind [m/s]", "x, z [m]", "local wind [m/s]", "u / best glide", "S′",
    "sink/u − S′", "du/ds up the line [1/s]",
    "flown to the end at 1 %", "rms e_rho [cm]", "flights' means apart [cm]",
    "dispersion about their own places [cm]", "formula [cm]",
    "flown to the end at 3 %", "rms e_rho [cm]", "shift in 3 % more wind [cm]",
    "less that of what flew [cm]", "TGL ∩ ZEUC [cm]",
)  # fmt: skip


def _row(s: FlownPlace) -> tuple[str, ...]:
    return (
        s.site, f"[{s.line}]", f"{s.wind_mps:.2f}", f"{s.x_m:.2f}, {s.z_m:.2f}",
        f"{s.local_mps:.2f}", f"{s.speed_ratio:.3f}", f"{s.polar_slope:+.3f}", f"{s.margin:+.3f}",
        f"{s.wind_slope_per_s:+.2f}",
        f"{s.survived[JUDGED]} of {s.flights}", _cm(s.rms_e_rho_m[JUDGED]),
        _cm(s.apart_m[JUDGED]), _cm(s.dispersion_m[JUDGED]), _cm(s.formula_m[JUDGED]),
        f"{s.survived[ROUGH]} of {s.flights}", _cm(s.rms_e_rho_m[ROUGH]),
        _shift_cm(s) if isfinite(s.shift.flown_m) else "lost",
        f"{100 * s.shift.off_m:+.1f}" if isfinite(s.shift.off_m) else "–",
        f"{100 * s.shift.predicted_m:+.1f}" if isfinite(s.shift.predicted_m) else "–",
    )  # fmt: skip


def _cm(value_m: float) -> str:
    if value_m == inf:
        return "lost"
    return "–" if value_m != value_m else f"{100 * value_m:.2f}"


def _draw(context: Context, here: dict[tuple[str, str], tuple[Scenario, float]]) -> tuple[str, ...]:
    """Wind and updraft of every air, in the wind of its [b]; names of the files."""
    names: list[str] = []
    sites = list(dict.fromkeys(site for site, _ in here))
    for i, site in enumerate(sites):
        path = context.figure(f"places_{i + 1}" if context.field is None else "places_field")
        if path is None:
            continue
        from tgl_soar.analysis.report.field_figure import DrawnPlace, field_figure

        scenario, wind_mps = here[site, "b"]
        base = prepare(scenario)
        assert base.site.air is not None
        winds = [mps for (name, _), (_, mps) in here.items() if name == site]
        marked = [
            DrawnPlace(f"[{line}] in {mps:.2f} m/s", at.x_m, at.z_m)
            for (name, line), (of, mps) in here.items()
            if name == site and (at := prepare(of).lines[line].crossing) is not None
        ]
        field_figure(
            path,
            base.field,
            base.polar,
            search_bounds(base.site),
            ground_outline(base.site.air),
            marked,
            f"{site}, wind and contour at {wind_mps:.2f} m/s"
            + ("" if all(mps == wind_mps for mps in winds) else "; others lie off it"),
        )
        names.append(path.name)
    return tuple(names)
