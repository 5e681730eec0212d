"""`lean`: lines of every lean through one place, from downwind to nearly flat."""

from __future__ import annotations

from math import degrees, inf
from typing import Final, NamedTuple

import msgspec
import numpy as np

from tgl_soar.air.zeuc import excess_gradient
from tgl_soar.parameters import ParameterError, ParameterSet
from tgl_soar.types import polar_slope

from .context import Context, turbulence_of
from .flights import Flown, legs_named, pooled_wander, rms
from .result import Claim, Result, Table
from .scenario import Prepared, perpendicular_lean, prepare, slide_at
from .wander import dryden_wander

LEANS_DEG: Final = (-20, -10, -5, 0, 5, 10, 15, 20, 30, 40, 50, 60)
LINE: Final = "b"


class LeanScore(NamedTuple):
    """All flights on one lean."""

    lean_deg: float
    off_perpendicular_deg: float
    flights: int
    survived: int
    rms_e_rho_m: float  # of those that survived; NaN: none
    wander_m: float
    wander_formula_m: float
    drift_m: float  # mean place to TGL ∩ ZEUC, along the line
    rate_per_s: float  # λ
    ended: str  # why the first that was lost was lost


def lean(context: Context) -> Result:
    """Fly every lean, and ask what a horizontal line would need."""
    scenario = context.scenario("lean")
    leans = (-10, 20, 50) if context.quick else LEANS_DEG
    spec = scenario.lines[LINE]
    variants = {
        deg: msgspec.structs.replace(
            scenario, lines={LINE: msgspec.structs.replace(spec, lean_deg=float(deg))}
        )
        for deg in leans
    }
    flights = context.fly(variants)
    base = prepare(scenario)
    at = base.lines[LINE].crossing
    assert at is not None
    across = degrees(perpendicular_lean(base.field, base.polar, at.x_m, at.z_m))
    scores = [score_lean(prepare(variants[deg]), flights[deg], deg, across) for deg in leans]
    figures = _draw(context, scores, across)
    limits = ParameterSet()
    slope = polar_slope(base.polar, at.wind_mps)
    horizontal = horizontal_line(base)
    return Result(
        "lean",
        scenario.title,
        f"The place at {at.wind_mps:.2f} m/s of local wind, at {100 * _intensity(base):g} % of"
        f" turbulence, with lines of every lean through it; positive leans upwind. The contour's"
        f" perpendicular leans {across:.0f}° there. The default limits"
        f" ({limits['TGL_LEAN_MIN']:g}° to {limits['TGL_LEAN_MAX']:g}°) are raised for this; the"
        " gains are the same for all.",
        lean_claims(scores, across),
        _why(scores, across, slope, horizontal, refusal(90.0), refusal(-10.0)),
        (
            Table(
                "",
                (
                    "lean [°]", "off the perpendicular [°]", "flown to the end", "rms e_rho [cm]",
                    "wander [cm]", "formula [cm]", "mean to TGL ∩ ZEUC [cm]", "λ [1/s]",
                    "what ended the others",
                ),
                tuple(
                    (
                        f"{s.lean_deg:+.0f}", f"{s.off_perpendicular_deg:+.0f}",
                        f"{s.survived} of {s.flights}", _cm(s.rms_e_rho_m, 2),
                        _cm(s.wander_m, 1), _cm(s.wander_formula_m, 1),
                        "–" if s.survived == 0 else f"{100 * s.drift_m:+.1f}",
                        f"{s.rate_per_s:.2f}", s.ended or "–",
                    )
                    for s in scores
                ),
            ),
        ),
        {
            "perpendicular_lean_deg": across,
            "leans": [s._asdict() for s in scores],
            "horizontal": {"rate_per_s": horizontal, "polar_slope": slope, "refused": refusal(90.0)},
        },
        figures,
        ("lean",),
        tuple(scenario.seeds),
    )  # fmt: skip


def _intensity(prepared: Prepared) -> float:
    assert prepared.site.air is not None
    return prepared.site.air.turbulence.intensity


def _cm(value_m: float, digits: int) -> str:
    return "–" if value_m != value_m else f"{100 * value_m:.{digits}f}"


def score_lean(
    prepared: Prepared, flights: list[Flown], lean_deg: float, across_deg: float
) -> LeanScore:
    """Score one lean over its flights."""
    whole = [flight for flight in flights if flight.survived]
    legs = legs_named(whole, LINE)
    line = prepared.lines[LINE]
    sigma, tau = turbulence_of(prepared)
    nan = float("nan")
    rate, formula = nan, nan
    if line.crossing is not None:
        slide = slide_at(prepared.polar, line.target, line.crossing)
        rate, formula = slide.rate_per_s, dryden_wander(slide, sigma, tau)
    return LeanScore(
        float(lean_deg),
        lean_deg - across_deg,
        len(flights),
        len(whole),
        rms(leg.rms_e_rho_m for leg in legs),
        pooled_wander(legs) if legs else nan,
        formula,
        float(np.mean([leg.miss_m for leg in legs])) if legs else nan,
        rate,
        next((flight.ended.split(" at x")[0] for flight in flights if flight.ended), ""),
    )


def lean_claims(scores: list[LeanScore], across_deg: float) -> tuple[Claim, ...]:
    """The paper's rule is to stand across the contour; what e_rho and wander say of it."""
    flown = [s for s in scores if s.survived == s.flights]
    nan = float("nan")
    if not flown:
        return (Claim("a line can be flown", False, "no lean kept every flight"),)
    best_rho = min(flown, key=lambda s: s.rms_e_rho_m)
    best_wander = min(flown, key=lambda s: s.wander_formula_m)
    downwind = [s for s in scores if s.lean_deg < 0.0]
    lost = sum(s.flights - s.survived for s in downwind)
    upright = next((s.wander_m for s in flown if s.lean_deg == min(f.lean_deg for f in flown)), nan)
    return (
        Claim(
            "the less perpendicular to the contour, the more the aircraft drifts along the line",
            abs(best_wander.off_perpendicular_deg) <= 15.0 and upright > best_wander.wander_m,
            f"wander {100 * best_wander.wander_m:.1f} cm at {best_wander.lean_deg:.0f}°, where the"
            f" formula has its least (perpendicular: {across_deg:.0f}°), {100 * upright:.1f} cm on"
            f" the least leaning line that kept every flight ({flown[0].lean_deg:.0f}°)",
        ),
        Claim(
            "the less perpendicular to the contour, the larger the oscillation about the line",
            abs(best_rho.off_perpendicular_deg) <= 15.0,
            f"rms e_rho is least, {100 * best_rho.rms_e_rho_m:.2f} cm, at {best_rho.lean_deg:.0f}°,"
            f" {abs(best_rho.off_perpendicular_deg):.0f}° from the perpendicular",
        ),
        Claim(
            "a line that leans downwind cannot be flown",
            bool(downwind) and lost > 0,
            f"{lost} of {sum(s.flights for s in downwind)} flights on lines leaning downwind were"
            " lost",
        ),
    )


def horizontal_line(prepared: Prepared) -> float:
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


def _why(
    scores: list[LeanScore],
    across_deg: float,
    slope: float,
    horizontal_rate: float,
    refused_flat: str,
    refused_downwind: str,
) -> str:
    worst = max(
        (abs(s.wander_m / s.wander_formula_m - 1.0) for s in scores if s.survived == s.flights),
        default=float("nan"),
    )
    front = "stable, but" if horizontal_rate > 0.0 else "not stable at all:"
    return (
        "Drift and oscillation do not ask for the same lean. *Along* the line the slope of excess"
        f" updraft counts: across the contour ({across_deg:.0f}° here) it is steepest, and the"
        f" wander follows its formula within {100 * worst:.0f} % on every lean that kept all"
        " flights. *Across* the line it is the attitude that counts: pitching up raises the"
        " aircraft first and drifts it back after; on a line that leans upwind both bring it to the"
        " same side, on one that leans downwind the first is the wrong way round, a zero of the"
        " right half plane near (g/V) tan η, which no gain removes. The further the line leans"
        " upwind, the more of the fast effect is in e_rho, the higher the gain of the loop, and"
        " with gains for an upright line it begins to ring: oscillation grows again well before"
        " the perpendicular. So the default asks for 10–25° and not for the perpendicular.\n\n"
        f"A *horizontal* line leaves the place along the wind to S′ alone (here {slope:+.3f}):"
        f" the slide is {front} at a rate of {horizontal_rate:.1f} 1/s, many times the one of a"
        " leaning line, which no aircraft follows, and on the slow side of least sink, where S′ < 0,"
        " it runs away. It has no upstream side either, so that e_rho has no sign. The module"
        f" refuses it ({refused_flat}) and one that leans downwind ({refused_downwind})."
    )


def _draw(context: Context, scores: list[LeanScore], across_deg: float) -> tuple[str, ...]:
    path = context.figure("lean")
    if path is None:
        return ()
    from tgl_soar.report.curves_figure import CurvePanel, Mark, Note, Series, curves_figure
    from tgl_soar.report.style import LEG_COLOURS

    some = [s for s in scores if s.survived > 0]
    marks = [Mark(across_deg, "perpendicular to the contour"), Mark(0.0, "upright")]
    curves_figure(
        path,
        [
            CurvePanel(
                "across the line",
                "lean [°], positive upwind",
                "rms e_rho [cm]",
                [
                    Series(
                        [s.lean_deg for s in some],
                        [100 * s.rms_e_rho_m for s in some],
                        "flown",
                        LEG_COLOURS[0],
                        marker="o",
                    )
                ],
                [
                    Note(s.lean_deg, 100 * s.rms_e_rho_m, f"{s.survived}/{s.flights}")
                    for s in some
                    if s.survived < s.flights
                ],
                marks,
                y_from_zero=True,
            ),
            CurvePanel(
                "along the line",
                "lean [°], positive upwind",
                "wander [cm]",
                [
                    Series(
                        [s.lean_deg for s in some],
                        [100 * s.wander_m for s in some],
                        "flown",
                        LEG_COLOURS[1],
                        "",
                        "o",
                    ),
                    Series(
                        [s.lean_deg for s in scores],
                        [100 * s.wander_formula_m for s in scores],
                        "formula",
                        "0.3",
                        "--",
                    ),
                ],
                [],
                marks,
                y_from_zero=True,
            ),
            CurvePanel(
                "flown to the end",
                "lean [°], positive upwind",
                "share of flights [%]",
                [
                    Series(
                        [s.lean_deg for s in scores],
                        [100 * s.survived / s.flights for s in scores],
                        None,
                        LEG_COLOURS[2],
                        marker="o",
                    )
                ],
                [],
                marks,
                y_from_zero=True,
            ),
        ],
        "lines of every lean through one place, one set of gains",
    )
    return (path.name,)
