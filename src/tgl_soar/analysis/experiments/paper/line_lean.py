"""`lean`: lines of every lean through one place, from downwind to nearly flat."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, exp, hypot, inf, log, sqrt
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np

from tgl_soar.air.zeuc import excess_gradient
from tgl_soar.analysis.experiments.context import Context, turbulence_of
from tgl_soar.analysis.experiments.flights import (
    FlownScenario,
    legs_named,
    mean_of_flights,
    pooled_dispersion,
    rms,
    rms_error,
)
from tgl_soar.analysis.experiments.paper.still_lines import FOLLOWS
from tgl_soar.analysis.experiments.result import (
    RESOLVED,
    ChangedThreshold,
    Claim,
    Result,
    Table,
    all_of,
    decided,
)
from tgl_soar.analysis.experiments.scenario import (
    PreparedScenario,
    Scenario,
    SensorSpec,
    perpendicular_lean,
    prepare,
    slide_at,
)
from tgl_soar.analysis.experiments.spread_along_line import dryden_dispersion
from tgl_soar.config.parameters import ParameterError, ParameterSet
from tgl_soar.types import polar_slope

LEANS_DEG: Final = (-20, -10, -5, 0, 5, 10, 15, 20, 30, 40, 50, 60)
LINE: Final = "b"
# rms e_rho beyond this is no flight on a line any more: a fifth of the chord, by which the aircraft
# is seen to leave it; the turbulence flown in moves it by a third of that on a line that is held.
HELD_M: Final = 0.03
# The rms of 8 flights of 25 s whose e_rho forgets within half a second is known to 3.5 %, a ratio
# of two to 5 %: beyond two standard errors one is larger.  That is the oscillation's; the rms of 8
# flights' means is known to 25 % (1 / √(2 n)), so each ratio is held against its own error, too.
LARGER: Final = 1.1
# A ratio whose error leaves more than this open is too coarse to say that two leans are alike:
# twice what the oscillation's leaves.
COARSE: Final = LARGER**2
NEAR_DEG: Final = 10.0  # of the perpendicular: the leans flown stand 10° apart there
FAR_DEG: Final = 30.0  # sin of it: half of what pitching does there is along the line
SENSORS: Final = {"without": SensorSpec(), "with": SensorSpec(imu=True)}  # accelerometers
SCHEDULED, ONE_SET = "gains for each lean", "one set of gains"
CHANGED: Final = (
    ChangedThreshold(
        "drift",
        "dispersion along the line",
        "mean distance from the line",
        "the paper speaks of drift from the line; what happens along it no gain changes",
    ),
    ChangedThreshold(
        "oscillation",
        "one set of gains; the least within 15° of the perpendicular",
        "gains for each lean; near the perpendicular no more than 1.1 times the least, far from"
        " it more",
        "one set of gains confounds the lean with a loop whose gain grows with it",
    ),
    ChangedThreshold(
        "oscillation, drift: more, and about the least",
        "1.1 times for both",
        f"1.1 times and {RESOLVED:g} standard errors of the ratio; undecided where these are wider"
        f" than {COARSE:.2f} times",
        "1.1 is what the rms oscillation is known to; the rms of eight means is known to 25 %",
    ),
    ChangedThreshold(
        "a line that leans downwind",
        "rms e_rho ten times the least",
        f"rms e_rho above {100 * HELD_M:g} cm on each, or a loss",
        "the measure of a line that is held is the same for every line",
    ),
)


class LeanScore(NamedTuple):
    """All flights on one lean; inf for what a lost flight leaves unknown."""

    lean_deg: float
    off_perpendicular_deg: float
    flights: int
    survived: int
    rms_e_rho_m: float
    oscillation_m: float  # about each flight's mean
    from_line_m: float  # rms of the means: drift from the line
    rms_y_m: float  # of those that lasted; NaN: none
    rms_bank_rad: float
    dispersion_m: float  # of each flight about its own place
    apart_m: float  # standard deviation of the flights' mean places
    dispersion_formula_m: float
    drift_m: float  # mean place to TGL ∩ ZEUC of the files, along the line
    rate_per_s: float  # λ
    stalled_fraction: float  # of the time, with an angle of attack beyond the stall's
    ended: str  # why the first that was lost was lost
    oscillation_error: float  # standard error of the oscillation, relative; inf: of too few
    from_line_error: float  # of the drift from the line

    @property
    def held(self) -> bool:
        """Every flight stayed on the line."""
        return self.rms_e_rho_m <= HELD_M


def lean(context: Context) -> Result:
    """Fly every lean, and ask what a horizontal line would need."""
    scenario = context.scenario("lean")
    leans = (-10, 20, 50) if context.quick else LEANS_DEG
    spec = scenario.lines[LINE]
    variants: dict[Any, Scenario] = {}
    for imu, sensors in SENSORS.items():
        for deg in leans:
            line = msgspec.structs.replace(spec, lean_deg=float(deg))
            each = msgspec.structs.replace(scenario, lines={LINE: line}, sensors=sensors)
            variants[imu, SCHEDULED, deg] = each
            parameters = {**each.parameters, "RHO_SPEED": 0.0}
            variants[imu, ONE_SET, deg] = msgspec.structs.replace(each, parameters=parameters)
    base = prepare(scenario)
    flights = context.fly(variants)
    at = base.lines[LINE].crossing
    assert at is not None
    across = degrees(perpendicular_lean(base.field, base.polar, at.x_m, at.z_m))
    scores = {
        (imu, gains): [
            score_lean(prepare(variants[imu, gains, d]), flights[imu, gains, d], d, across)
            for d in leans
        ]
        for imu in SENSORS
        for gains in (SCHEDULED, ONE_SET)
    }
    limits = ParameterSet()
    slope = polar_slope(base.polar, at.wind_mps)
    horizontal = horizontal_line(base)
    return Result(
        name="lean",
        title=scenario.title,
        flown=f"The place at {at.wind_mps:.2f} m/s of local wind, at {100 * _intensity(base):g} %"
        f" of turbulence, with lines of every lean through it; positive leans upwind. The contour's"
        f" perpendicular leans {across:.0f}° there. The default limits"
        f" ({limits['TGL_LEAN_MIN']:g}° to {limits['TGL_LEAN_MAX']:g}°) are raised for this. The"
        " claims are judged with gains for each lean (the schedule); flown beside them, one set of"
        " gains as it stands (`RHO_SPEED` 0), in which the lean is confounded with a loop whose"
        " gain grows with it. Without accelerometers and with them. A lean that loses one flight"
        " counts as worse than any that lost none.",
        claims=tuple(
            claim
            for imu in SENSORS
            for claim in lean_claims(scores[imu, SCHEDULED], across, f"{imu} accelerometers")
        ),
        why=lean_why(scores, across, slope, horizontal),
        tables=tuple(
            Table(f"{gains}, {imu} accelerometers", COLUMNS, tuple(map(_row, several)))
            for (imu, gains), several in scores.items()
        ),
        numbers={
            "perpendicular_lean_deg": across,
            "leans": {
                f"{gains}, accelerometers {imu}": [s._asdict() for s in several]
                for (imu, gains), several in scores.items()
            },
            "horizontal": {
                "rate_per_s": horizontal,
                "polar_slope": slope,
                "refused": refusal(90.0),
            },
        },
        figures=_draw(context, scores, across),
        scenarios=("lean",),
        seeds=tuple(scenario.seeds),
        changed=CHANGED,
    )


COLUMNS: Final = (
    "lean [°]", "off the perpendicular [°]", "flown to the end", "rms e_rho [cm]",
    "oscillation about the line [cm]", "drift from the line [cm]", "rms y [cm]", "rms bank [°]",
    "dispersion about their own places [cm]", "formula [cm]", "flights' means apart [cm]",
    "mean to TGL ∩ ZEUC [cm]", "λ [1/s]",
)  # fmt: skip


def _row(s: LeanScore) -> tuple[str, ...]:
    return (
        f"{s.lean_deg:+.0f}",
        f"{s.off_perpendicular_deg:+.0f}",
        f"{s.survived} of {s.flights}",
        _cm(s.rms_e_rho_m, 2),
        _cm(s.oscillation_m, 2),
        _cm(s.from_line_m, 2),
        _cm(s.rms_y_m, 1),
        f"{degrees(s.rms_bank_rad):.1f}",
        _cm(s.dispersion_m, 1),
        _cm(s.dispersion_formula_m, 1),
        _cm(s.apart_m, 1),
        _cm(s.drift_m, 1),
        f"{s.rate_per_s:.2f}",
    )


def _intensity(prepared: PreparedScenario) -> float:
    assert prepared.site.air is not None
    return prepared.site.air.turbulence.intensity


def _cm(value_m: float, digits: int) -> str:
    if value_m == inf:
        return "lost"
    return "–" if value_m != value_m else f"{100 * value_m:.{digits}f}"


def score_lean(
    prepared: PreparedScenario, flights: list[FlownScenario], lean_deg: float, across_deg: float
) -> LeanScore:
    """Score one lean over its flights."""
    whole = [flight for flight in flights if flight.survived and flight.legs]
    legs = legs_named(whole, LINE)
    all_lasted = bool(legs) and len(whole) == len(flights)
    line = prepared.lines[LINE]
    sigma, tau = turbulence_of(prepared)
    stall = prepared.airframe.model["stall_alpha_rad"]
    nan = float("nan")
    rate, formula = nan, nan
    if line.crossing is not None:
        slide = slide_at(prepared.polar, line.target, line.crossing)
        rate, formula = slide.rate_per_s, dryden_dispersion(slide, sigma, tau)
    about = [max(0.0, leg.rms_e_rho_m**2 - leg.mean_e_rho_m**2) for leg in legs]
    return LeanScore(
        lean_deg=float(lean_deg),
        off_perpendicular_deg=lean_deg - across_deg,
        flights=len(flights),
        survived=len(whole),
        rms_e_rho_m=rms(leg.rms_e_rho_m for leg in legs) if all_lasted else inf,
        oscillation_m=rms(map(sqrt, about)) if all_lasted else inf,
        from_line_m=rms(leg.mean_e_rho_m for leg in legs) if all_lasted else inf,
        rms_y_m=rms(leg.rms_y_m for leg in legs),
        rms_bank_rad=rms(leg.rms_bank_rad for leg in legs),
        dispersion_m=pooled_dispersion(legs) if legs else nan,
        apart_m=mean_of_flights(leg.along_m for leg in legs).apart,
        dispersion_formula_m=formula,
        drift_m=float(np.mean([leg.miss_m for leg in legs])) if legs else nan,
        rate_per_s=rate,
        stalled_fraction=float(np.mean([np.mean(f.path["alpha_rad"] > stall) for f in whole]))
        if whole
        else nan,
        ended=next((flight.ended.split(" at x")[0] for flight in flights if flight.ended), ""),
        oscillation_error=rms_error(about),
        from_line_error=rms_error([leg.mean_e_rho_m**2 for leg in legs]),
    )


def lean_claims(scores: list[LeanScore], across_deg: float, flown: str) -> tuple[Claim, ...]:
    """The paper's rule is to stand across the contour, for oscillation and drift from the line."""
    downwind = [s for s in scores if s.lean_deg < 0.0]
    held = [s for s in downwind if s.held]
    return (
        _grows_off_perpendicular(
            [Of(s, s.oscillation_m, s.oscillation_error) for s in scores],
            across_deg,
            "oscillates about the line",
            flown,
        ),
        _grows_off_perpendicular(
            [Of(s, s.from_line_m, s.from_line_error) for s in scores],
            across_deg,
            "drifts from the line",
            flown,
        ),
        Claim(
            f"a line that leans downwind cannot be flown well ({flown})",
            bool(downwind) and not held,
            f"{len(held)} of {len(downwind)} such leans are held within {100 * HELD_M:g} cm rms"
            + (f" ({', '.join(f'{s.lean_deg:.0f}°' for s in held)})" if held else "")
            + f"; {sum(s.flights - s.survived for s in downwind)} of"
            f" {sum(s.flights for s in downwind)} flights were lost",
        ),
    )


class Of(NamedTuple):
    """One measure of one lean."""

    score: LeanScore
    value_m: float  # inf: a flight was lost
    error: float  # standard error, relative


def _open(one: Of, other: Of) -> float:
    """How far the errors of two leave their ratio open: a factor, 1 where one lost a flight."""
    if inf in (one.value_m, other.value_m):
        return 1.0
    return exp(min(9.0, RESOLVED * hypot(one.error, other.error)))


def _more(one: Of, other: Of) -> bool | None:
    """Whether one is larger; None where the errors leave open whether it is."""
    if inf in (one.value_m, other.value_m):
        return one.value_m == inf and other.value_m < inf
    factor = _open(one, other)
    if one.value_m > max(LARGER, factor) * other.value_m:
        return True
    coarse = factor > COARSE and one.value_m * factor > other.value_m
    return None if coarse else False


def _no_more(one: Of, least: Of) -> bool | None:
    """Whether one is about the least; None where the errors leave it open."""
    if one is least:
        return one.value_m < inf
    if inf in (one.value_m, least.value_m) or _more(one, least):
        return False
    factor = _open(one, least)
    if factor > COARSE:
        return None
    return one.value_m <= LARGER * least.value_m


def _grows_off_perpendicular(several: list[Of], across_deg: float, does: str, flown: str) -> Claim:
    """Near the perpendicular about the least, and more on every lean far from it that was flown;
    the module takes no line as flat as those on the perpendicular's other side."""
    least = min(several, key=lambda one: one.value_m)
    near = min(several, key=lambda one: abs(one.score.off_perpendicular_deg))
    far = [one for one in several if abs(one.score.off_perpendicular_deg) >= FAR_DEG]
    flat = [one for one in far if one.score.off_perpendicular_deg > 0.0]
    at_hand = abs(near.score.off_perpendicular_deg) <= NEAR_DEG
    smallest = min(far, key=lambda one: one.value_m, default=None)
    known = "" if smallest is None else f", known to a factor of {_open(smallest, near):.2f}"
    return decided(
        f"the less perpendicular to the contour a line is, the more the aircraft {does} ({flown})",
        all_of((at_hand, bool(far), _no_more(near, least), *(_more(one, near) for one in far))),
        f"least {_cm(least.value_m, 2)} cm at {least.score.lean_deg:.0f}°,"
        f" {abs(least.score.off_perpendicular_deg):.0f}° from the perpendicular"
        f" ({across_deg:.0f}°); {_cm(near.value_m, 2)} cm at {near.score.lean_deg:.0f}°;"
        f" {FAR_DEG:g}° off and further from"
        f" {_cm(inf if smallest is None else smallest.value_m, 2)} cm on{known}"
        + (
            ""
            if flat
            else f"; on the steep side alone, as no lean beyond {across_deg + FAR_DEG:.0f}° was"
            " flown"
        ),
    )


def horizontal_line(prepared: PreparedScenario) -> float:
    """λ [1/s] that the formula of a line gives for a horizontal one, upper end upwind.

    η = 180°: sin η − S′ cos η = S′, ∇E · t = −dE/dx.  Negative: not stable.
    """
    at = prepared.lines[LINE].crossing
    assert at is not None
    gx, _ = excess_gradient(prepared.field, prepared.polar, at.x_m, at.z_m)
    slope = polar_slope(prepared.polar, at.wind_mps)
    return gx / slope if slope != 0.0 else inf


def refusal(lean_deg: float) -> str:
    """What the module answers to a lean."""
    try:
        ParameterSet().changed({"TGL_LEAN": lean_deg})
    except ParameterError as error:
        return error.reason
    return ""


def downwind_words(scores: dict[tuple[str, str], list[LeanScore]]) -> str:
    """Which of the lines that lean downwind are held all the same."""
    held = [
        f"{s.lean_deg:.0f}° {imu} accelerometers"
        + (" and one set of gains" if gains == ONE_SET else "")
        for (imu, gains), several in scores.items()
        for s in several
        if s.lean_deg < 0.0 and s.held
    ]
    return f", far enough out at {', '.join(held)} for the line to be held" if held else ""


def lean_why(
    scores: dict[tuple[str, str], list[LeanScore]],
    across_deg: float,
    slope: float,
    horizontal_rate: float,
) -> str:
    """What the numbers say, lean by lean, and the formulas behind them."""
    limits = ParameterSet()
    ranges, poor = [], []
    for (imu, gains), several in scores.items():
        held = [f"{s.lean_deg:.0f}°" for s in several if s.held]
        ranges.append(f"{imu} accelerometers and {gains}: {', '.join(held) or 'none'}")
        poor += [
            f"{s.lean_deg:.0f}° ({imu} accelerometers, {_cm(s.rms_e_rho_m, 1)} cm)"
            for s in several
            if gains == SCHEDULED
            and limits["TGL_LEAN_MIN"] <= s.lean_deg <= limits["TGL_LEAN_MAX"]
            and not s.held
        ]
    front = "stable, but" if horizontal_rate > 0.0 else "not stable at all:"
    return (
        f"Held within {100 * HELD_M:g} cm are "
        + "; ".join(ranges)
        + ". "
        + (
            f"Accepted by the module by default and not held: {', '.join(poor)}."
            if poor
            else "Every lean flown that the module accepts by default is held."
        )
        + " *Along* the line the slope of excess updraft counts, which is steepest across the"
        f" contour ({across_deg:.0f}° here), against the height that a lean costs;"
        f" {along_words([s for several in scores.values() for s in several if s.held])} *Across* it"
        " attitude counts: pitching up raises the aircraft first and drifts it back after. On a"
        " line that leans upwind both bring it to the same side; on one that leans downwind the"
        " first is the wrong way round, a zero of the right half plane near (g/V) tan η"
        f"{downwind_words(scores)}. The further a line leans upwind, the more of e_rho is the fast"
        " effect, and the higher is the gain of a loop whose gains stay as they are.\n\n"
        f"A *horizontal* line leaves the place along the wind to S′ alone (here {slope:+.3f}):"
        f" the slide is {front} at a rate of {horizontal_rate:.1f} 1/s, by a formula that takes the"
        " glide to be steady; on the slow side of least sink, where S′ < 0, it runs away. It has no"
        " upstream side either, so that e_rho has no sign. The module refuses it"
        f" ({refusal(90.0)}) and one that leans downwind ({refusal(-10.0)})."
    )


def along_words(held: Sequence[LeanScore]) -> str:
    """Whether the dispersion on the lines that were held follows its formula, and if not where."""
    compared = [
        s for s in held if s.dispersion_formula_m > 0.0 and s.dispersion_m == s.dispersion_m
    ]
    if not compared:
        return "no lean was held, so that no dispersion is held against its formula."
    off = [s for s in compared if not 1.0 / FOLLOWS <= _of_formula(s) <= FOLLOWS]
    if not off:
        ratios = [_of_formula(s) for s in compared]
        return (
            f"the dispersion follows its formula on the lines that were held, {min(ratios):.2f} to"
            f" {max(ratios):.2f} times it."
        )
    worst = max(off, key=lambda s: abs(log(_of_formula(s))))
    leans = sorted({round(s.lean_deg) for s in off})
    return (
        f"the dispersion does not follow its formula on {len(off)} of {len(compared)} lines that"
        f" were held ({', '.join(f'{lean}°' for lean in leans)}): on that of"
        f" {worst.lean_deg:.0f}° it is {_of_formula(worst):.2f} times it, each flight about its own"
        f" place, with the wing beyond the stall's incidence {100 * worst.stalled_fraction:.1f} %"
        " of the time."
    )


def _of_formula(s: LeanScore) -> float:
    return s.dispersion_m / s.dispersion_formula_m


def _draw(
    context: Context, scores: dict[tuple[str, str], list[LeanScore]], across_deg: float
) -> tuple[str, ...]:
    path = context.figure("lean")
    if path is None:
        return ()
    from tgl_soar.analysis.report.curves_figure import CurvePanel, DrawnCurve, Mark, curves_figure
    from tgl_soar.analysis.report.figure_style import PALETTE

    marks = [Mark(across_deg, "perpendicular to the contour"), Mark(0.0, "upright")]
    label = "lean [°], positive upwind"

    def curve(of: str) -> list[DrawnCurve]:
        curves = []
        for i, ((imu, gains), several) in enumerate(scores.items()):
            whole = [s for s in several if s.survived == s.flights]
            curves.append(
                DrawnCurve(
                    [s.lean_deg for s in whole],
                    [100 * getattr(s, of) for s in whole],
                    f"{gains}, {imu} accelerometers",
                    PALETTE[i],
                    marker="osDv"[i],
                )
            )
        return curves

    first = next(iter(scores.values()))
    formula = DrawnCurve(
        x=[s.lean_deg for s in first],
        y=[100 * s.dispersion_formula_m for s in first],
        label="formula",
        colour="0.3",
        style="--",
    )
    curves_figure(
        path,
        [
            CurvePanel(
                title="about the line",
                x_label=label,
                y_label="oscillation [cm]",
                series=curve("oscillation_m"),
                notes=[],
                marks=marks,
                y_log=True,
            ),
            CurvePanel(
                title="from the line",
                x_label=label,
                y_label="mean e_rho, rms of flights [cm]",
                series=curve("from_line_m"),
                notes=[],
                marks=marks,
                y_log=True,
            ),
            CurvePanel(
                title="along the line",
                x_label=label,
                y_label="dispersion [cm]",
                series=[*curve("dispersion_m"), formula],
                notes=[],
                marks=marks,
                y_log=True,
            ),
        ],
        "lines of every lean through one place, where none was lost",
        one_legend=True,
    )
    return (path.name,)
