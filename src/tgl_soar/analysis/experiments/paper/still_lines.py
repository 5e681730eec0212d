"""`static`, `translate`, `back`, `rotate`: the aircraft settles where line and contour meet."""

from __future__ import annotations

from dataclasses import replace
from math import degrees, inf, sqrt
from typing import Any, Final, NamedTuple

import numpy as np

from tgl_soar.air.zeuc import Crossing
from tgl_soar.analysis.experiments.context import (
    Context,
    drawn_air,
    drawn_line,
    turbulence_of,
    with_turbulence,
)
from tgl_soar.analysis.experiments.flights import (
    SETTLE_S,
    FlownScenario,
    ScoredLeg,
    mean_of_flights,
    pooled_dispersion,
    rms,
)
from tgl_soar.analysis.experiments.result import (
    ChangedThreshold,
    Claim,
    Result,
    Table,
    all_of,
    decided,
    within,
)
from tgl_soar.analysis.experiments.scenario import PreparedScenario, Scenario, prepare, slide_at
from tgl_soar.analysis.experiments.spread_along_line import dryden_dispersion
from tgl_soar.analysis.report.flight_figure import HistoryPanel, Spans, Trace, flight_figure
from tgl_soar.sim.world import flown_aircraft
from tgl_soar.types import polar_sink

# Three standard errors of the mean of eight flights of a leg at 1 % of turbulence (0.3 cm each),
# and the fitted cubic: its residual, 0.02 m/s where it is worst within the places flown, over a
# slope of excess updraft of 1 /s.  One flight is judged by the same bound, which its own mean must
# be known to half of (it is to 0.9 to 1.3 cm in legs of a minute and of 25 s): then an aircraft
# that hovers three bounds from its place, as dispersed ones do from the files', cannot pass.
MISS_MOST_M: Final = 0.03
# Standard errors of one flight's mean: of the 24 of three legs one lies beyond by chance in
# sixteen experiments.
FLIGHT_RESOLVED: Final = 3.0
# A dispersion follows its formula within this: some 8 % that the two kinds of turbulence differ
# by, and two standard errors of a deviation of eight flights of a minute (5 %).
FOLLOWS: Final = 1.15
INTENSITIES: Final = (0.0, 0.01, 0.03)  # of the turbulence that each is flown in
JUDGED: Final = 0.01  # of these, what the claims go by
COUNTED: Final = (
    "A flight that is lost counts in every mean as far as it flew. The claims are judged at"
    f" {100 * JUDGED:g} % of turbulence, scale 1.5 m."
)
STALLS: Final = 0.01  # of the time: less is no more than the gusts beyond three deviations
SETTLES: Final = "it settles where the line meets the zero excess updraft contour"
PLACE_CHANGED: Final = ChangedThreshold(
    "it settles where the line meets the contour",
    "the mean of all flights within 3 cm, by samples in time",
    "that mean with its error, by the flights' own means, and each flight, to the contour of what"
    " flew (its own cubic polar, the air that blew); undecided where these errors leave it open",
    "eight aircraft that are each 9 cm off can have a mean that is not",
)
FILES_CHANGED: Final = ChangedThreshold(
    "of dispersed aircraft: each flight settles where the files' own contour is",
    "within 3 cm, a claim beside the paper's, which no dispersed experiment held",
    "told in words with its figures, and no verdict",
    "the paper has one aircraft in one air and says nothing of it: it asks how well an airframe"
    " file is known, and not whether an aircraft settles where line and contour meet",
)
SETTLE_MOST_S: Final = (
    5.0  # ten times 1 / ω_c of the outer loop, which crosses over at about 2 rad/s
)


class MissOfFlight(NamedTuple):
    """How far one flight's mean place is from where it should be, and how well that is known."""

    miss_m: float
    error_m: float  # standard error, by its own samples in time

    @property
    def beyond_m(self) -> float:
        """The least that it is off, for certain; inf: it has no place to be at."""
        if self.miss_m != self.miss_m:
            return inf
        return max(0.0, abs(self.miss_m) - FLIGHT_RESOLVED * self.error_m)


class LegSummary(NamedTuple):
    """One leg of all flights of a scenario."""

    line: str
    flights: int
    settling_s: float  # the slowest
    rms_e_rho_m: float
    peak_e_rho_m: float  # median over flights
    rms_y_m: float
    rms_bank_rad: float
    miss_m: float  # mean place to TGL ∩ ZEUC of the files, along the line, positive up
    miss_error_m: float  # standard error of that
    apart_m: float  # standard deviation of the flights' mean places
    own_miss_m: float  # the same of each flight to its own aircraft's place in its own air
    own_error_m: float
    worst_own: MissOfFlight  # of the flight that is farthest from its own place
    worst_file: MissOfFlight  # and from that of the files
    worst_glide_m: float  # the farthest that a flight is from where its own glides put it
    known_to_m: float  # largest standard error of one flight's mean, by its dispersion
    dispersion_m: float  # each flight's about its own place
    dispersion_formula_m: float  # 0 in calm air
    stalled_fraction: float  # of the whole flights' time, with the wing beyond the stall
    mean_x_m: float
    mean_z_m: float


def summarise(prepared: PreparedScenario, flights: list[FlownScenario]) -> list[LegSummary]:
    """Legs by their order in the flight; those that no flight reached are left out."""
    sigma, tau = turbulence_of(prepared)
    stall = prepared.airframe.model["stall_alpha_rad"]
    stalled = float(np.mean([np.mean(f.path["alpha_rad"] > stall) for f in flights]))
    count = max((len(flight.legs) for flight in flights), default=0)
    summaries = []
    for k in range(count):
        legs = [flight.legs[k] for flight in flights if len(flight.legs) > k]
        first = legs[0]
        line = prepared.lines[first.line]
        assert line.crossing is not None
        slide = slide_at(prepared.polar, line.target, line.crossing)
        formula = dryden_dispersion(slide, sigma, tau) if sigma > 0.0 else 0.0
        files = mean_of_flights(leg.miss_m for leg in legs)
        own = mean_of_flights(leg.own_miss_m for leg in legs)
        # A first-order low-pass of rate λ gives an independent value every 2/λ; the dispersion
        # that a short flight shows of itself is too small.
        errors = [
            max(leg.dispersion_m, formula) / sqrt(max(1.0, leg.scored_s * slide.rate_per_s / 2.0))
            for leg in legs
        ]
        one = len(legs) == 1
        summaries.append(
            LegSummary(
                line=first.line,
                flights=len(legs),
                settling_s=max(leg.settling_s for leg in legs),
                rms_e_rho_m=rms(leg.rms_e_rho_m for leg in legs),
                peak_e_rho_m=float(np.median([leg.peak_e_rho_m for leg in legs])),
                rms_y_m=rms(leg.rms_y_m for leg in legs),
                rms_bank_rad=rms(leg.rms_bank_rad for leg in legs),
                miss_m=files.mean,
                miss_error_m=errors[0] if one else files.error,
                apart_m=mean_of_flights(leg.along_m for leg in legs).apart,
                own_miss_m=own.mean,
                own_error_m=errors[0] if one else own.error,
                worst_own=_farthest([leg.own_miss_m for leg in legs], errors),
                worst_file=_farthest([leg.miss_m for leg in legs], errors),
                worst_glide_m=max((leg.glide_miss_m for leg in legs), key=abs),
                known_to_m=max(errors),
                dispersion_m=pooled_dispersion(legs),
                dispersion_formula_m=formula,
                stalled_fraction=stalled,
                mean_x_m=float(np.mean([leg.mean_x_m for leg in legs])),
                mean_z_m=float(np.mean([leg.mean_z_m for leg in legs])),
            )
        )
    return summaries


def _farthest(misses_m: list[float], errors_m: list[float]) -> MissOfFlight:
    several = [MissOfFlight(m, e) for m, e in zip(misses_m, errors_m, strict=True)]
    return max(several, key=lambda one: (one.beyond_m, abs(one.miss_m)))


LEG_COLUMNS: Final = (
    "turbulence", "line", "flown to the end", "settled after [s]", "rms e_rho [cm]",
    "median peak [cm]", "rms y [cm]", "rms bank [°]", "mean to TGL ∩ ZEUC, along [cm]",
    "of what flew [cm]", "flights' means apart [cm]", "dispersion about them [cm]",
    "formula [cm]",
)  # fmt: skip


def leg_rows(
    intensity: float, flights: list[FlownScenario], summaries: list[LegSummary]
) -> list[tuple[str, ...]]:
    """Rows of the table of legs."""
    survived = sum(flight.survived for flight in flights)
    return [
        (
            "calm" if intensity == 0.0 else f"{100 * intensity:g} %",
            s.line,
            f"{survived} of {len(flights)}",
            f"{s.settling_s:.1f}",
            f"{100 * s.rms_e_rho_m:.2f}",
            f"{100 * s.peak_e_rho_m:.1f}",
            f"{100 * s.rms_y_m:.1f}",
            f"{degrees(s.rms_bank_rad):.1f}",
            f"{100 * s.miss_m:+.1f} ± {100 * s.miss_error_m:.1f}",
            f"{100 * s.own_miss_m:+.1f} ± {100 * s.own_error_m:.1f}",
            f"{100 * s.apart_m:.1f}" if s.flights > 1 else "–",
            f"{100 * s.dispersion_m:.1f}",
            f"{100 * s.dispersion_formula_m:.1f}" if intensity > 0.0 else "–",
        )
        for s in summaries
    ]


def settled_claim(
    flights: list[FlownScenario],
    summaries: list[LegSummary],
    legs: int,
    settle_most_s: float = SETTLE_MOST_S,
) -> Claim:
    """Every flight came to every line and stayed on it."""
    survived = sum(flight.survived for flight in flights)
    slowest = max((s.settling_s for s in summaries), default=float("inf"))
    reached = all(len(flight.legs) == legs for flight in flights)
    return Claim(
        "the aircraft is brought to the line and held on it",
        survived == len(flights) and reached and slowest <= settle_most_s,
        f"{survived} of {len(flights)} flights to the end, within 5 cm of each line after at most"
        f" {slowest:.1f} s",
    )


def place_claim(summaries: list[LegSummary], miss_most_m: float = MISS_MOST_M) -> Claim:
    """It hovers at the crossing: of its own contour, each aircraft and all of them in the mean."""
    worst = max(summaries, key=lambda s: abs(s.own_miss_m), default=None)
    if worst is None:
        return Claim(SETTLES, False, "no leg was flown")
    one = max((s.worst_own for s in summaries), key=lambda each: abs(each.miss_m))
    return decided(
        SETTLES,
        all_of(part for s in summaries for part in _at_its_place(s, miss_most_m)),
        f"mean place at most {100 * abs(worst.own_miss_m):.1f} ± {100 * worst.own_error_m:.1f} cm"
        f" from the crossing, along the line (line {worst.line}); of one flight at most"
        f" {100 * abs(one.miss_m):.1f} ± {100 * one.error_m:.1f} cm",
    )


def _at_its_place(s: LegSummary, miss_most_m: float) -> tuple[bool | None, bool | None]:
    """In the mean of all flights, and of each flight."""
    each: bool | None = s.worst_own.beyond_m <= miss_most_m
    if each and s.known_to_m > 0.5 * miss_most_m:
        each = None
    return within(s.own_miss_m, s.own_error_m, miss_most_m), each


def known_place_note(summaries: list[LegSummary]) -> str:
    """What whoever has the files alone knows of where each aircraft settles: no claim of the
    paper's, whose aircraft and air are those of its files."""
    if not summaries:
        return ""
    worst = max(summaries, key=lambda s: abs(s.worst_file.miss_m))
    return (
        " From the crossing with the files' own contour a flight settles at most"
        f" {100 * abs(worst.worst_file.miss_m):.1f} ± {100 * worst.worst_file.error_m:.1f} cm away"
        f" (line {worst.line}, at {100 * JUDGED:g} % of turbulence); the flights' places are"
        f" {100 * max(s.apart_m for s in summaries):.1f} cm apart (standard deviation). That the"
        " files do not say where an aircraft unlike them settles is no claim of the paper's."
    )


def dispersion_note(by_intensity: dict[float, list[LegSummary]], *, stalls: bool = True) -> str:
    """How the dispersion compares with its formula; stalls: whether the model that flew can."""
    compared = [
        (s.dispersion_m / s.dispersion_formula_m, intensity, s)
        for intensity, summaries in by_intensity.items()
        for s in summaries
        if s.dispersion_formula_m > 0.0
    ]
    if not compared:
        return ""
    ratios = [ratio for ratio, _, _ in compared]
    low, high = f"{min(ratios):.2f}", f"{max(ratios):.2f}"
    note = (
        "Dispersion along the line, of each flight about its own place, is"
        f" {low if low == high else f'{low} to {high}'} times what the formula of"
        " [theory.md](theory.md#dispersion) predicts from the turbulence and the slope of excess"
        " updraft alone."
    )
    ratio, intensity, worst = max(compared, key=lambda item: item[0])
    if ratio > FOLLOWS:
        note += (
            f" Most of all at {100 * intensity:g} % of turbulence on line {worst.line}:"
            f" {100 * worst.dispersion_m:.1f} cm for {100 * worst.dispersion_formula_m:.1f},"
            f" the mean place {100 * abs(worst.own_miss_m):.0f} cm"
            f" {'below' if worst.own_miss_m < 0.0 else 'above'} the crossing."
            + stall_words(worst.stalled_fraction, stalls=stalls)
        )
    return note + apart_note([s for summaries in by_intensity.values() for s in summaries])


def stall_words(fraction: float, *, stalls: bool = True) -> str:
    """Whether gusts stalled the wing, so that a formula that is linear must fail."""
    if not stalls:
        return " A point mass has no stall: that is not the reason."
    if fraction < STALLS:
        return (
            " The wing was beyond the stall's incidence"
            f" {100 * fraction:.1f} % of the time: the stall is not the reason."
        )
    return (
        " The formula is linear, and gusts took the wing beyond the stall's incidence"
        f" {100 * fraction:.1f} % of the time."
    )


def apart_note(summaries: list[LegSummary]) -> str:
    """What sets the flights' places apart beyond gusts: that they are of different aircraft."""
    several = [s for s in summaries if s.flights > 1]
    calm = [s for s in several if s.dispersion_formula_m == 0.0]
    if not calm:
        return ""
    worst = max(calm, key=lambda s: s.apart_m)
    own = max(abs(s.worst_glide_m) for s in calm)
    return (
        f" From aircraft to aircraft the place differs by {100 * worst.apart_m:.1f} cm (standard"
        f" deviation, calm air, line {worst.line}): each hovers where its own glides and the wind"
        f" that blew put it, {100 * own:.1f} cm from there at most."
    )


def polar_bias_m(prepared: PreparedScenario, at: Crossing) -> float:
    """How far along its line the fitted polar puts a crossing below the aircraft's own [m].

    The polar is a cubic through the model's glides: where it sinks more than they do, the
    aircraft settles higher, by the difference over the slope of excess updraft.
    """
    own = flown_aircraft(prepared.airframe).glide_at(at.wind_mps).sink_mps
    return (polar_sink(prepared.polar, at.wind_mps) - own) / -at.excess_slope_per_s


def bias_note(prepared: PreparedScenario, lines: list[str]) -> str:
    """The size of that, in words."""
    placed = [(name, prepared.lines[name].crossing) for name in lines]
    values = ", ".join(
        f"{100 * polar_bias_m(prepared, at):+.1f} cm at {name}"
        for name, at in placed
        if at is not None
    )
    return (
        "The contour is that of the fitted cubic polar; where the simulated aircraft's own glides"
        f" differ from the cubic, its place does, by {values}."
    )


def draw(
    context: Context,
    name: str,
    prepared: PreparedScenario,
    flight: FlownScenario,
    title: str,
    **air: Any,
) -> tuple[str, ...]:
    """Draw one flight; () without figures."""
    path = context.figure(name)
    if path is None:
        return ()
    names = flown_lines(prepared.scenario)
    active = np.isfinite(flight.path["pitch_setpoint_rad"])
    p = {column: values[active] for column, values in flight.path.items()}
    time = p["time_s"]
    steps = [leg for leg in flight.legs if leg.predicted is not None]
    dashes = [
        Trace(
            time_s=np.array([leg.begin_s, leg.end_s]),
            y=np.array([leg.predicted[1]] * 2) if leg.predicted else np.zeros(2),
            label="TGL ∩ ZEUC" if i == 0 else None,
            colour="#D55E00",
            style="--",
            width=1.4,
        )
        for i, leg in enumerate(steps)
    ]
    flight_figure(
        path,
        drawn_air(prepared, **air),
        [drawn_line(line, prepared.lines[line]) for line in names],
        p["x_m"],
        p["z_m"],
        [
            HistoryPanel("e_rho [cm]", [Trace(time, 100 * p["e_rho_m"])]),
            HistoryPanel("height z [m]", [Trace(time, p["z_m"], "flown"), *dashes]),
            HistoryPanel(
                "pitch [°]",
                [
                    Trace(time, np.degrees(p["pitch_setpoint_rad"]), "setpoint", "#E69F00"),
                    Trace(time, np.degrees(p["pitch_rad"]), "pitch"),
                ],
            ),
            HistoryPanel(
                "[m/s]",
                [
                    Trace(time, p["wind_mps"], "local wind", "#56B4E9"),
                    Trace(time, p["airspeed_mps"], "airspeed"),
                ],
            ),
        ],
        title,
        Spans([(leg.begin_s, leg.end_s, leg.line) for leg in flight.legs]),
    )
    return (path.name,)


def pooled_or_nan(legs: list[ScoredLeg]) -> float:
    """Dispersion [m] of several flights of one leg; NaN of none."""
    return pooled_dispersion(legs) if legs else float("nan")


def flown_lines(scenario: Scenario) -> list[str]:
    """Names of the lines that are flown, each once, in order."""
    lines = [scenario.first_line, *(c.line for c in scenario.changes if c.line is not None)]
    return list(dict.fromkeys(lines))


def _fly_at(
    context: Context, scenario: Scenario, intensities: tuple[float, ...]
) -> tuple[dict[float, list[FlownScenario]], dict[float, list[LegSummary]]]:
    variants = {i: with_turbulence(scenario, i, context.dispersion) for i in intensities}
    flights = context.fly(variants)
    return flights, {i: summarise(prepare(variants[i]), flights[i]) for i in intensities}


def _result(
    context: Context,
    name: str,
    flown: str,
    intensities: tuple[float, ...] = INTENSITIES,
) -> tuple[Result, dict[float, list[LegSummary]]]:
    scenario = context.scenario(name)
    if context.quick:
        intensities = (JUDGED,)
    flights, summaries = _fly_at(context, scenario, intensities)
    prepared = prepare(with_turbulence(scenario, JUDGED))
    stalls = prepared.airframe.model_kind == "rigid_body"
    legs = 1 + sum(change.line is not None for change in scenario.changes)
    rows = [row for i in intensities for row in leg_rows(i, flights[i], summaries[i])]
    most_m = MISS_MOST_M * (2.0 if context.quick else 1.0)
    figures = draw(
        context,
        name,
        prepared,
        flights[JUDGED][0],
        f"{scenario.title}, turbulence {100 * JUDGED:g} %",
    )
    result = Result(
        name=name,
        title=scenario.title,
        flown=f"{flown} {COUNTED}",
        claims=(
            settled_claim(flights[JUDGED], summaries[JUDGED], legs),
            place_claim(summaries[JUDGED], most_m),
        ),
        why=dispersion_note(summaries, stalls=stalls)
        + (
            known_place_note(summaries[JUDGED])
            if context.dispersion
            else f" {bias_note(prepared, flown_lines(scenario))}"
        ),
        tables=(Table("", LEG_COLUMNS, tuple(rows)),),
        numbers={
            "judged_at_turbulence": JUDGED,
            "lines": {
                line: {
                    "x_m": placed.target.x_m,
                    "z_m": placed.target.z_m,
                    "lean_deg": degrees(placed.target.eta_rad) - 90.0,
                    "crossing": placed.crossing and placed.crossing._asdict(),
                    "rate_per_s": placed.crossing
                    and slide_at(prepared.polar, placed.target, placed.crossing).rate_per_s,
                }
                for line, placed in prepared.lines.items()
            },
            "legs": {str(i): [s._asdict() for s in summaries[i]] for i in intensities},
            "survived": {
                str(i): [sum(f.survived for f in flights[i]), len(flights[i])] for i in intensities
            },
            "ended": [f.ended for i in intensities for f in flights[i] if f.ended],
        },
        figures=figures,
        scenarios=(name,),
        seeds=tuple(scenario.seeds),
        changed=(PLACE_CHANGED, FILES_CHANGED),
    )
    return result, summaries


def static(context: Context) -> Result:
    """A line that stands still at [a]."""
    result, _ = _result(
        context,
        "static",
        "A line through the contour at 0.90 of best glide's speed stands still; the aircraft is"
        " released 0.3 m downstream of the crossing, at rest over the ground, and flown for a"
        f" minute. The first {SETTLE_S:g} s after the line stands still are not scored.",
        (*INTENSITIES, 0.05),
    )
    return result


def translate(context: Context) -> Result:
    """The line moves downstream."""
    result, _ = _result(
        context,
        "translate",
        "The operator moves the line from a to b to c, downstream, as with `PARAM_SET`; it slides"
        " at 0.3 m/s. Places at 0.90, 0.94 and 0.98 of best glide's speed.",
    )
    return result


def back(context: Context) -> Result:
    """The line moves upstream."""
    result, _ = _result(context, "back", "The same lines the other way, c to b to a.")
    return result


def rotate(context: Context) -> Result:
    """The line turns."""
    result, summaries = _result(
        context,
        "rotate",
        "The line turns about a point half a metre below the aircraft, from a lean of 12° to 35°"
        " upwind and back, at 5°/s.",
    )
    legs = summaries[JUDGED]
    if len(legs) < 3:
        return result
    there = legs[1].mean_x_m - legs[0].mean_x_m, legs[1].mean_z_m - legs[0].mean_z_m
    back_again = legs[2].mean_x_m - legs[0].mean_x_m, legs[2].mean_z_m - legs[0].mean_z_m
    lines = result.numbers["lines"]
    upright, leaning = lines["upright"]["crossing"], lines["leaning"]["crossing"]
    claim = Claim(
        "turning the line moves the aircraft along the contour, and turning it back brings it back",
        there[0] < 0.0 and abs(complex(*back_again)) < 0.5 * abs(complex(*there)),
        f"turning moved it by {100 * there[0]:+.1f} cm downstream and {100 * there[1]:+.1f} cm up"
        f" (crossings: {100 * (leaning['x_m'] - upright['x_m']):+.1f} and"
        f" {100 * (leaning['z_m'] - upright['z_m']):+.1f} cm), turning back left"
        f" {100 * abs(complex(*back_again)):.1f} cm",
    )
    return replace(result, claims=(*result.claims, claim))


def leg_by_line(flights: list[FlownScenario], line: str, which: int) -> list[ScoredLeg]:
    """The n-th leg (from 0) that each flight flew on a line."""
    found = []
    for flight in flights:
        legs = [leg for leg in flight.legs if leg.line == line]
        if len(legs) > which:
            found.append(legs[which])
    return found
