"""`slope` and `wind`: the air changes, and the place on the line with it."""

from __future__ import annotations

from math import cos, inf, isfinite, sin, sqrt
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np

from tgl_soar.air.zeuc import stable_crossing, wind_sensitivity
from tgl_soar.analysis.experiments.context import (
    Context,
    drawn_air,
    drawn_line,
    turbulence_of,
    with_turbulence,
)
from tgl_soar.analysis.experiments.flights import FlownScenario, ScoredLeg, mean_of_flights
from tgl_soar.analysis.experiments.paper.still_lines import (
    LEG_COLUMNS,
    draw,
    leg_rows,
    polar_bias_m,
    pooled_or_nan,
    settled_claim,
    summarise,
)
from tgl_soar.analysis.experiments.result import (
    RESOLVED,
    ChangedThreshold,
    Claim,
    Result,
    Table,
    above,
    all_of,
    decided,
    within,
)
from tgl_soar.analysis.experiments.scenario import (
    PreparedScenario,
    Scenario,
    WindSchedule,
    prepare,
    slide_at,
)
from tgl_soar.analysis.experiments.spread_along_line import dryden_dispersion
from tgl_soar.control.target_line import TargetLine
from tgl_soar.estimation.polar import best_glide_speed

# Flown against predicted, in quadrature: the fitted cubic's residual of 0.008 m/s at both places,
# over a slope of excess updraft of 0.8 /s, 1.4 cm; three standard errors of a difference of means,
# of eight flights at 1 % each, 1.3 cm.
AGREE_M: Final = 0.02
# What the cubic's residual alone leaves of a place that should not move.
STAYS_M: Final = 0.014
# Standard deviations of the place itself: a shift within them is within what the aircraft does all
# the time, and nobody who watches it sees that it has moved.
HARDLY: Final = 2.0
CHANGED: Final = (
    ChangedThreshold(
        "rises, stays, falls",
        "calm air; stays within 1 cm, rises or falls by more than nothing",
        f"1 % of turbulence; {RESOLVED:g} standard errors of the flights' own shifts, stays within"
        f" {100 * STAYS_M:g} cm, rises or falls by more; undecided where these leave it open",
        "like every other experiment; a sign is known beyond its standard error, the fitted cubic"
        " moves a place by so much, and what is called staying is no rise",
    ),
    ChangedThreshold(
        "wind hardly moves the hovering point",
        "15 cm, calm air",
        f"{HARDLY:g} standard deviations of the place at 1 %, by the formula or as flown, whichever"
        " is less",
        "15 cm had no reason; nobody sees a shift that is smaller than the dispersion",
    ),
    ChangedThreshold(
        "the place moves as TGL ∩ ZEUC does",
        "means of all flights, by samples in time",
        "each flight's shift less that of its own aircraft's place in its own air; undecided where"
        " the standard error of these leaves it open",
        "aircraft that are not alike have places that are not",
    ),
)
SLOPE_CHANGED: Final = ChangedThreshold(
    "the aircraft rises with the contour",
    "means of all flights",
    "each flight's rise less that of its own aircraft's place in its own air; undecided where the"
    " standard error of these leaves it open",
    "aircraft that are not alike have places that are not",
)
LATE_S: Final = 1e6  # after every change of the air


class Shift(NamedTuple):
    """How far a place moved up its line."""

    line: str
    flown_m: float  # mean of the flights that flew both legs
    predicted_m: float  # of the files' TGL ∩ ZEUC, before and after
    up_m: float  # of the flown one, vertically
    error_m: float  # standard error of the flown one, by the flights' own shifts
    off_m: float  # flown less what each flight's own contour moves by, mean
    off_error_m: float  # standard error of that
    worst_off_m: float  # of the flight with the largest
    worst_glide_m: float  # the same with each flight's own glides in place of the cubic


def _along(target: TargetLine, x_m: float, z_m: float) -> float:
    return cos(target.eta_rad) * (x_m - target.x_m) + sin(target.eta_rad) * (z_m - target.z_m)


def shift_of(prepared: PreparedScenario, flights: list[FlownScenario], line: str) -> Shift:
    """From the first leg on a line to the last, means over all flights."""
    pairs = both_legs(flights, line)
    flown = mean_of_flights(b.along_m - a.along_m for a, b in pairs)
    off = [b.own_miss_m - a.own_miss_m for a, b in pairs]
    of_all = mean_of_flights(off)
    alone = _alone(prepared, line, pairs)
    return Shift(
        line=line,
        flown_m=flown.mean,
        predicted_m=predicted_shift(prepared, line),
        up_m=mean_of_flights(b.mean_z_m - a.mean_z_m for a, b in pairs).mean,
        error_m=min(alone, flown.error),
        off_m=of_all.mean,
        off_error_m=min(alone, of_all.error),
        worst_off_m=max(off, key=abs, default=float("nan")),
        worst_glide_m=max(
            (b.glide_miss_m - a.glide_miss_m for a, b in pairs), key=abs, default=float("nan")
        ),
    )


def both_legs(flights: list[FlownScenario], line: str) -> list[tuple[ScoredLeg, ScoredLeg]]:
    """First and second leg on a line, of the flights that flew both."""
    found = ([leg for leg in flight.legs if leg.line == line] for flight in flights)
    return [(legs[0], legs[1]) for legs in found if len(legs) > 1]


def _alone(
    prepared: PreparedScenario, line: str, pairs: list[tuple[ScoredLeg, ScoredLeg]]
) -> float:
    """Standard error [m] of a single flight's shift, by its samples in time; inf of several."""
    target, at = prepared.lines[line]
    if len(pairs) != 1 or at is None:
        return inf
    rate = slide_at(prepared.polar, target, at).rate_per_s
    return sqrt(sum(leg.dispersion_m**2 / max(1.0, leg.scored_s * rate / 2.0) for leg in pairs[0]))


def predicted_shift(prepared: PreparedScenario, line: str) -> float:
    """Of TGL ∩ ZEUC from the first air to the last, up the line [m]; NaN: there is none."""
    target, here = prepared.lines[line]
    there = stable_crossing(prepared.field, prepared.polar, target, LATE_S)
    if here is None or there is None:
        return float("nan")
    return _along(target, there.x_m, there.z_m) - _along(target, here.x_m, here.z_m)


def slope(context: Context) -> Result:
    """The board is raised while the line is at c."""
    scenario = context.scenario("slope")
    intensities = (0.01,) if context.quick else (0.0, 0.01)
    variants = {i: with_turbulence(scenario, i, context.dispersion) for i in intensities}
    flights = context.fly(variants)
    prepared = prepare(variants[0.01])
    lost = sum(not flight.survived for flight in flights[0.01])
    summaries = {i: summarise(prepare(variants[i]), flights[i]) for i in intensities}
    shifts = {
        i: [shift_of(prepare(variants[i]), flights[i], line) for line in ("a", "b", "c")]
        for i in intensities
    }
    rows = tuple(
        (
            "calm" if i == 0.0 else f"{100 * i:g} %",
            s.line,
            f"{100 * s.predicted_m:+.1f}",
            f"{100 * s.flown_m:+.1f} ± {error_cm(s.error_m)}",
            _off_cm(s),
            f"{100 * s.up_m:+.1f}",
        )
        for i in intensities
        for s in shifts[i]
    )
    legs = tuple(row for i in intensities for row in leg_rows(i, flights[i], summaries[i]))
    figures = draw(
        context,
        "slope",
        prepared,
        flights[0.01][0],
        f"{scenario.title}, turbulence 1 %",
        later_s=LATE_S,
        later="ZEUC at 25°",
    )
    return Result(
        name="slope",
        title=scenario.title,
        flown="The line goes a, b, c in front of a board of 23°; at c the board is raised to 25°"
        " within 10 s; the line goes back b, a. The field is a blend of the fields of both slopes.",
        claims=(
            *slope_claims(shifts[0.01], AGREE_M * (2.0 if context.quick else 1.0), lost),
            settled_claim(flights[0.01], summaries[0.01], 6),
        ),
        why="",
        tables=(
            Table(
                "Shift from 23° to 25°, up the line",
                (
                    "turbulence", "line", "TGL ∩ ZEUC [cm]", "flown [cm]",
                    "flown, less that of what flew [cm]", "flown, vertically [cm]",
                ),
                rows,
            ),
            Table("Legs (the formula of dispersion is that at 23°)", LEG_COLUMNS, legs),
        ),
        numbers={
            "shifts": {str(i): [s._asdict() for s in shifts[i]] for i in intensities},
            "legs": {str(i): [s._asdict() for s in summaries[i]] for i in intensities},
        },
        figures=figures,
        scenarios=("slope",),
        seeds=tuple(scenario.seeds),
        changed=(SLOPE_CHANGED,),
    )  # fmt: skip


def slope_claims(shifts: list[Shift], agree_m: float = AGREE_M, lost: int = 0) -> tuple[Claim, ...]:
    """Contour and aircraft rise, by the same; shifts are of those that lasted: none may be lost."""
    contour = ", ".join(f"{100 * s.predicted_m:+.1f} cm at {s.line}" for s in shifts)
    flown = ", ".join(_shift_words(s) for s in shifts)
    worst = max(shifts, key=lambda s: abs(s.off_m))
    return (
        Claim(
            "a steeper slope raises the contour", all(s.predicted_m > 0 for s in shifts), contour
        ),
        decided(
            "the aircraft rises with it",
            all_of(
                (
                    *(above(s.flown_m, s.error_m) for s in shifts),
                    *(within(s.off_m, s.off_error_m, agree_m) for s in shifts),
                    not lost,
                )
            ),
            f"{flown}; {_off_words(worst)}",
        ),
    )


def error_cm(error_m: float) -> str:
    """A standard error; – of a single flight, which shows none."""
    return f"{100 * error_m:.1f}" if isfinite(error_m) else "–"


def _off_cm(s: Shift | WindShift) -> str:
    """– where a flight has no place of its own to be off, or none flew both legs."""
    return f"{100 * s.off_m:+.1f} ± {error_cm(s.off_error_m)}" if isfinite(s.off_m) else "–"


def _shift_words(s: Shift | WindShift) -> str:
    return f"{100 * s.flown_m:+.1f} ± {error_cm(s.error_m)} cm at {s.line}"


def _off_words(s: Shift | WindShift) -> str:
    """How far it is from what it should be where that is worst."""
    return (
        f"off the shift of what flew by at most {100 * abs(s.off_m):.1f} ±"
        f" {error_cm(s.off_error_m)} cm in the mean ({s.line}), of one flight there"
        f" {100 * abs(s.worst_off_m):.1f} cm"
    )


# --- wind --------------------------------------------------------------------------------------


class WindShift(NamedTuple):
    """What a change of wind did at one place."""

    line: str
    speed_ratio: float  # local wind before, over best glide's speed
    margin: float  # sink/u − S′ before
    margin_half_way: float  # the same at the crossing half-way through the change
    first_order_m: float  # up the line, from the margin before
    half_way_m: float  # the same from half-way
    predicted_m: float  # from the contours before and after
    flown_m: float
    polar_error_m: float  # what the aircraft's own glides add to the fitted cubic's prediction
    lost: int  # flights that did not last
    # Along the line before: by the formula, or that of the flights about their own places where
    # that is less; 0 in calm air.
    dispersion_m: float
    error_m: float  # standard error of the flown shift, by the flights' own; inf: too few flights
    off_m: float  # flown less what each flight's own contour moves by, mean
    off_error_m: float  # standard error of that
    worst_off_m: float  # of the flight with the largest
    worst_glide_m: float  # the same with each flight's own glides in place of the cubic


_WIND_WORDS: Final = {
    "small, calm": "8.25 → 8.75, calm",
    "small": "8.25 → 8.75, 1 %",
    "calm": "8.5 → 9.5, calm",
    "1 %": "8.5 → 9.5, 1 %",
}


def _wind_row(words: str, s: WindShift) -> tuple[str, ...]:
    return (
        words,
        s.line,
        f"{s.speed_ratio:.3f}",
        f"{s.margin:+.3f}",
        f"{s.margin_half_way:+.3f}",
        f"{100 * s.first_order_m:+.1f}",
        f"{100 * s.half_way_m:+.1f}",
        f"{100 * s.predicted_m:+.1f}",
        f"{100 * (s.predicted_m + s.polar_error_m):+.1f}",
        f"{100 * s.flown_m:+.1f} ± {error_cm(s.error_m)}",
        _off_cm(s),
        f"{s.lost}",
    )


def wind(context: Context) -> Result:
    """The wind grows, the line stands still."""
    scenario = context.scenario("wind")
    assert scenario.wind is not None
    small = WindSchedule(times_s=scenario.wind.times_s, mps=[8.25, 8.75])
    variants: dict[Any, Scenario] = {}
    for line in scenario.lines:
        here = _on_line(scenario, line)
        calm = with_turbulence(here, 0.0, context.dispersion)
        variants[line, "small, calm"] = msgspec.structs.replace(calm, wind=small)
        variants[line, "small"] = msgspec.structs.replace(here, wind=small)
        variants[line, "calm"] = calm
        variants[line, "1 %"] = here
    if context.quick:
        variants = {key: v for key, v in variants.items() if "calm" in key[1]}
    # The lines are placed once, in 8.5 m/s, and stay where they are in every variant.
    placed = prepare(scenario).lines
    variants = {key: pinned(v, key[0], placed[key[0]].target) for key, v in variants.items()}
    flights = context.fly(variants)
    shifts = {
        key: _wind_shift(prepare(variants[key]), flights[key], key[0], placed[key[0]].target)
        for key in variants
    }
    rows = tuple(
        _wind_row(words, s)
        for kind, words in _WIND_WORDS.items()
        for (_, k), s in shifts.items()
        if k == kind
    )
    few, many = ("small, calm", "calm") if context.quick else ("small", "1 %")
    small_shifts = [shifts[line, few] for line in scenario.lines]
    full_shifts = [shifts[line, many] for line in scenario.lines]
    figures = _draw_wind(context, scenario, variants, flights)
    return Result(
        name="wind",
        title=scenario.title,
        flown="Still lines through four places of the contour, from the slow side of best glide"
        " (a, b) to best glide (c) and a little beyond (d, as far as this contour goes). The wind"
        " rises within 10 s; the aircraft's mean place before and after. Once from 8.25 to 8.75"
        " m/s,"
        " about the wind that the places are named in, and once from 8.5 to 9.5 m/s. The claims"
        " are judged at 1 % of turbulence.",
        claims=wind_claims(small_shifts, full_shifts),
        why=wind_why(
            [shifts[line, "calm"] for line in scenario.lines],
            [s for (_, kind), s in shifts.items() if "calm" in kind],
            context.dispersion,
        ),
        tables=(
            Table(
                "Shift up the line",
                (
                    "wind [m/s]", "line", "u / best glide", "sink/u − S′ before", "half-way",
                    "shift from the one before [cm]", "from half-way [cm]",
                    "TGL ∩ ZEUC [cm]", "with the file's aircraft's own glides [cm]",
                    "flown [cm]", "less that of what flew [cm]", "lost",
                ),
                rows,
            ),
        ),
        numbers={
            "shifts": {f"{a}, {_WIND_WORDS[kind]}": s._asdict() for (a, kind), s in shifts.items()},
            "best_glide_mps": best_glide_speed(prepare(scenario).polar),
        },
        figures=figures,
        scenarios=("wind",),
        seeds=tuple(scenario.seeds),
        changed=CHANGED,
    )  # fmt: skip


def _on_line(scenario: Scenario, line: str) -> Scenario:
    changes = [msgspec.structs.replace(c, line=line) for c in scenario.changes]
    return msgspec.structs.replace(scenario, first_line=line, changes=changes)


def pinned(scenario: Scenario, name: str, target: TargetLine) -> Scenario:
    """The same with one line, where it was placed in another wind."""
    spec = msgspec.structs.replace(
        scenario.lines[name], x_m=target.x_m, z_m=target.z_m, speed_ratio=None
    )
    return msgspec.structs.replace(scenario, lines={name: spec})


def _wind_shift(
    prepared: PreparedScenario, flights: list[FlownScenario], line: str, target: TargetLine
) -> WindShift:
    here = prepared.lines[line].crossing
    schedule = prepared.scenario.wind
    assert here is not None
    assert schedule is not None
    half_s = 0.5 * (schedule.times_s[0] + schedule.times_s[-1])
    there = stable_crossing(prepared.field, prepared.polar, target, half_s)
    assert there is not None
    after = stable_crossing(prepared.field, prepared.polar, target, LATE_S)
    assert after is not None
    first = wind_sensitivity(prepared.field, prepared.polar, here, target.eta_rad)
    half = wind_sensitivity(prepared.field, prepared.polar, there, target.eta_rad, time_s=half_s)
    change = schedule.mps[-1] - schedule.mps[0]
    # The sensitivity is per m/s of the reference wind, which at that time is another.
    reference = 0.5 * (schedule.mps[0] + schedule.mps[-1]) / prepared.field.reference_wind_mps
    flown = shift_of(prepared, flights, line)
    slide = slide_at(prepared.polar, target, here)
    sigma, tau = turbulence_of(prepared)
    dispersion_m = 0.0
    if sigma > 0.0:
        formula = dryden_dispersion(slide, sigma, tau)
        as_flown = pooled_or_nan([before for before, _ in both_legs(flights, line)])
        dispersion_m = min(formula, as_flown) if isfinite(as_flown) else formula
    return WindShift(
        line=line,
        speed_ratio=here.wind_mps / best_glide_speed(prepared.polar),
        margin=first.margin,
        margin_half_way=half.margin,
        first_order_m=first.along_m_per_mps * change,
        half_way_m=half.along_m_per_mps * change / reference,
        predicted_m=flown.predicted_m,
        flown_m=flown.flown_m,
        polar_error_m=polar_bias_m(prepared, after) - polar_bias_m(prepared, here),
        lost=sum(not flight.survived for flight in flights),
        dispersion_m=dispersion_m,
        error_m=flown.error_m,
        off_m=flown.off_m,
        off_error_m=flown.off_error_m,
        worst_off_m=flown.worst_off_m,
        worst_glide_m=flown.worst_glide_m,
    )


def rises_stays_falls(shifts: list[WindShift]) -> bool | None:
    """Two places on the slow side, one at best glide, one beyond; a place that lost any fails."""
    a, b, c, d = shifts
    return all_of(
        (
            *(above(s.flown_m, s.error_m, STAYS_M) for s in (a, b)),
            within(c.flown_m, c.error_m, STAYS_M),
            above(-d.flown_m, d.error_m, STAYS_M),
            not any(s.lost for s in shifts),
        )
    )


def wind_claims(small: list[WindShift], full: list[WindShift]) -> tuple[Claim, ...]:
    """Signs and sizes, to first order and for the whole step."""
    both = (*small, *full)
    lost = sum(s.lost for s in both)
    worst = max(both, key=lambda s: _or_worse(abs(s.off_m)))
    farthest = max(full, key=lambda s: _or_worse(_deviations(s)))
    return (
        decided(
            "for a small change of wind the aircraft rises on the slow side, stays at best glide"
            f" (within {100 * STAYS_M:g} cm), falls beyond, by more than that",
            rises_stays_falls(small),
            f"{_all_shifts(small)}, from 8.25 to 8.75 m/s",
        ),
        decided("the same from 8.5 to 9.5 m/s", rises_stays_falls(full), _all_shifts(full)),
        decided(
            "the place moves as TGL ∩ ZEUC does",
            all_of((*(within(s.off_m, s.off_error_m, AGREE_M) for s in both), not lost)),
            f"{_off_words(worst)}; {lost} flights lost",
        ),
        decided(
            "wind speed hardly moves the hovering point (near best glide): by no more than"
            f" {HARDLY:g} standard deviations of its place",
            all_of(
                (
                    *(within(s.flown_m, s.error_m, HARDLY * s.dispersion_m) for s in full),
                    not any(s.lost for s in full),
                )
            ),
            f"12 % more wind moved it by at most {100 * abs(farthest.flown_m):.1f} ±"
            f" {error_cm(farthest.error_m)} cm (at {farthest.line}),"
            f" {_deviations(farthest):.1f} standard deviations; {sum(s.lost for s in full)}"
            " flights lost",
        ),
    )


def _deviations(s: WindShift) -> float:
    return abs(s.flown_m) / s.dispersion_m if s.dispersion_m else inf


def _all_shifts(shifts: list[WindShift]) -> str:
    return ", ".join(
        _shift_words(s) + (f" ({s.lost} flights lost)" if s.lost else "") for s in shifts
    )


def _or_worse(value: float) -> float:
    return inf if value != value else value


def wind_why(full: list[WindShift], calm: list[WindShift], dispersed: bool = False) -> str:
    """Why the whole step is not the first order; calm: of both steps, in calm air."""
    before = max(abs(s.first_order_m - s.predicted_m) for s in full)
    half = max(abs(s.half_way_m - s.predicted_m) for s in full)
    lost = sum(s.lost for s in calm)

    def off_m(s: WindShift) -> float:
        return s.worst_glide_m if dispersed else s.flown_m - s.predicted_m - s.polar_error_m

    worst = max(calm, key=lambda s: _or_worse(abs(off_m(s))))
    whose = (
        "With each flight's own glides and air in place of the files'"
        if dispersed
        else "With the simulated aircraft's own glides in place of the cubic fitted to them"
    )
    return (
        "A step of 1 m/s is no small change: S′ grows with speed, and the aircraft ends up in"
        " faster air, where sink grows faster and updraft no more than before. sink/u − S′ *before*"
        f" the step misses the shift of the contour by up to {100 * before:.1f} cm; taken *half-way"
        f" through* the step by up to {100 * half:.1f} cm."
        + (
            " So what a finite step leaves in place is not the aircraft at best glide but one that"
            " is as much slower before as it is faster after."
            if half < 0.5 * before
            else " Neither is the shift of a finite step."
        )
        + f" {whose}, computed and flown shifts agree within {100 * abs(off_m(worst)):.1f} cm in"
        f" calm air, in both steps (worst at {worst.line})"
        + (f"; {lost} of the flights in calm air were lost and are not in it." if lost else ".")
    )


def _draw_wind(
    context: Context,
    scenario: Scenario,
    variants: dict[Any, Scenario],
    flights: dict[Any, list[FlownScenario]],
) -> tuple[str, ...]:
    path = context.figure("wind")
    if path is None:
        return ()
    from tgl_soar.analysis.report.figure_style import PALETTE
    from tgl_soar.analysis.report.flight_figure import HistoryPanel, Spans, Trace, flight_figure

    kind = "calm" if context.quick else "1 %"
    prepared = prepare(scenario)
    heights, winds = [], []
    for line, colour in zip(scenario.lines, PALETTE, strict=False):
        several = flights[line, kind]
        length = min(len(f.path["time_s"]) for f in several)
        time = several[0].path["time_s"][:length]
        target = prepared.lines[line].target
        here = prepared.lines[line].crossing
        assert here is not None
        base = _along(target, here.x_m, here.z_m)
        along = np.mean(
            [
                cos(target.eta_rad) * (f.path["x_m"][:length] - target.x_m)
                + sin(target.eta_rad) * (f.path["z_m"][:length] - target.z_m)
                for f in several
            ],
            axis=0,
        )
        later = predicted_shift(prepare(variants[line, kind]), line)
        show = time > 5.0
        heights.append(Trace(time[show], 100 * (along - base)[show], line, colour))
        ends, height = np.array([40.0, time[-1]]), np.full(2, 100 * later)
        heights.append(Trace(ends, height, None, colour, style="--", width=1.6))
        wind = np.mean([f.path["wind_mps"][:length] for f in several], axis=0)
        winds.append(Trace(time[show], wind[show], None, colour))
    mean = f"mean of {len(flights['a', kind])} flights" if kind != "calm" else "calm air"
    flight_figure(
        path,
        drawn_air(prepared, LATE_S, "ZEUC at 9.5 m/s"),
        [drawn_line(line, prepared.lines[line]) for line in scenario.lines],
        np.empty(0),
        np.empty(0),
        [
            HistoryPanel(f"up the line, {mean} [cm]", heights),
            HistoryPanel("local wind [m/s]", winds),
        ],
        scenario.title + " (dashed: computed from the contours)",
        Spans([(30.0, 40.0, "wind rises")]),
    )
    return (path.name,)
