"""`lean`: lines of every lean through one place, from downwind to nearly flat."""

from __future__ import annotations

from math import degrees, inf
from typing import Final, NamedTuple

import msgspec
import numpy as np

from tgl_soar.air.zeuc import excess_gradient
from tgl_soar.analysis.experiments.context import Context, turbulence_of
from tgl_soar.analysis.experiments.dispersion import dryden_dispersion
from tgl_soar.analysis.experiments.flights import FlownScenario, legs_named, pooled_dispersion, rms
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.experiments.scenario import (
    PreparedScenario,
    perpendicular_lean,
    prepare,
    slide_at,
)
from tgl_soar.config.parameters import ParameterError, ParameterSet
from tgl_soar.types import polar_slope

LEANS_DEG: Final = (-20, -10, -5, 0, 5, 10, 15, 20, 30, 40, 50, 60)
LINE: Final = "b"
OUTER: Final = ("RHO_P", "RHO_I", "RHO_D")
HALF: Final = 0.5  # of the outer gains: what is the loop's, and what is the line's
HELD_M: Final = 0.03  # rms e_rho beyond this is no flight on a line any more


class LeanScore(NamedTuple):
    """All flights on one lean."""

    lean_deg: float
    off_perpendicular_deg: float
    flights: int
    survived: int
    rms_e_rho_m: float  # of those that survived; NaN: none
    dispersion_m: float
    dispersion_formula_m: float
    drift_m: float  # mean place to TGL ∩ ZEUC, along the line
    rate_per_s: float  # λ
    stalled_fraction: float  # of the time, with an angle of attack beyond the stall's
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
    base = prepare(scenario)
    lower = {name: HALF * base.values[name] for name in OUTER}
    halves = {
        ("half", deg): msgspec.structs.replace(
            variant, parameters={**variant.parameters, **lower}, seeds=variant.seeds[:3]
        )
        for deg, variant in variants.items()
    }
    flights = context.fly({**variants, **halves})
    at = base.lines[LINE].crossing
    assert at is not None
    across = degrees(perpendicular_lean(base.field, base.polar, at.x_m, at.z_m))
    scores = [score_lean(prepare(variants[deg]), flights[deg], deg, across) for deg in leans]
    half = [score_lean(prepare(halves["half", d]), flights["half", d], d, across) for d in leans]
    figures = _draw(context, scores, half, across)
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
        _why(scores, half, across, slope, horizontal, refusal(90.0), refusal(-10.0)),
        (
            Table(
                "",
                (
                    "lean [°]", "off the perpendicular [°]", "flown to the end", "rms e_rho [cm]",
                    "dispersion [cm]", "formula [cm]", "mean to TGL ∩ ZEUC [cm]", "λ [1/s]",
                    "half the outer gains: flown", "rms e_rho [cm]", "mean to TGL ∩ ZEUC [cm]",
                ),
                tuple(
                    (
                        f"{s.lean_deg:+.0f}", f"{s.off_perpendicular_deg:+.0f}",
                        f"{s.survived} of {s.flights}", _cm(s.rms_e_rho_m, 2),
                        _cm(s.dispersion_m, 1), _cm(s.dispersion_formula_m, 1), _cm(s.drift_m, 1),
                        f"{s.rate_per_s:.2f}", f"{h.survived} of {h.flights}",
                        _cm(h.rms_e_rho_m, 2), _cm(h.drift_m, 1),
                    )
                    for s, h in zip(scores, half, strict=True)
                ),
            ),
        ),
        {
            "perpendicular_lean_deg": across,
            "leans": [s._asdict() for s in scores],
            "leans_half_gains": [s._asdict() for s in half],
            "horizontal": {
                "rate_per_s": horizontal, "polar_slope": slope, "refused": refusal(90.0),
            },
        },
        figures,
        ("lean",),
        tuple(scenario.seeds),
    )  # fmt: skip


def _intensity(prepared: PreparedScenario) -> float:
    assert prepared.site.air is not None
    return prepared.site.air.turbulence.intensity


def _cm(value_m: float, digits: int) -> str:
    return "–" if value_m != value_m else f"{100 * value_m:.{digits}f}"


def score_lean(
    prepared: PreparedScenario, flights: list[FlownScenario], lean_deg: float, across_deg: float
) -> LeanScore:
    """Score one lean over its flights."""
    whole = [flight for flight in flights if flight.survived]
    legs = legs_named(whole, LINE)
    line = prepared.lines[LINE]
    sigma, tau = turbulence_of(prepared)
    stall = prepared.airframe.model["stall_alpha_rad"]
    nan = float("nan")
    rate, formula = nan, nan
    if line.crossing is not None:
        slide = slide_at(prepared.polar, line.target, line.crossing)
        rate, formula = slide.rate_per_s, dryden_dispersion(slide, sigma, tau)
    return LeanScore(
        lean_deg=float(lean_deg),
        off_perpendicular_deg=lean_deg - across_deg,
        flights=len(flights),
        survived=len(whole),
        rms_e_rho_m=rms(leg.rms_e_rho_m for leg in legs),
        dispersion_m=pooled_dispersion(legs) if legs else nan,
        dispersion_formula_m=formula,
        drift_m=float(np.mean([leg.miss_m for leg in legs])) if legs else nan,
        rate_per_s=rate,
        stalled_fraction=float(np.mean([np.mean(f.path["alpha_rad"] > stall) for f in whole]))
        if whole
        else nan,
        ended=next((flight.ended.split(" at x")[0] for flight in flights if flight.ended), ""),
    )


def lean_claims(scores: list[LeanScore], across_deg: float) -> tuple[Claim, ...]:
    """The paper's rule is to stand across the contour; what e_rho and dispersion say of it."""
    held = _held(scores)
    if not held:
        return (Claim("a line can be flown", False, "no lean kept every flight on its line"),)
    best_rho = min(held, key=lambda s: s.rms_e_rho_m)
    best_dispersion = min(held, key=lambda s: s.dispersion_m)
    downwind = [s for s in scores if s.lean_deg < 0.0]
    lost = sum(s.flights - s.survived for s in downwind)
    swings = min((s.rms_e_rho_m for s in downwind if s.survived), default=float("inf"))
    return (
        Claim(
            "the less perpendicular to the contour, the more the aircraft drifts along the line",
            abs(best_dispersion.off_perpendicular_deg) <= 15.0,
            f"dispersion is least, {100 * best_dispersion.dispersion_m:.1f} cm, at"
            f" {best_dispersion.lean_deg:.0f}°,"
            f" {abs(best_dispersion.off_perpendicular_deg):.0f}° from"
            f" the perpendicular ({across_deg:.0f}°)",
        ),
        Claim(
            "the less perpendicular to the contour, the larger the oscillation about the line",
            abs(best_rho.off_perpendicular_deg) <= 15.0,
            f"rms e_rho is least, {100 * best_rho.rms_e_rho_m:.2f} cm, at {best_rho.lean_deg:.0f}°,"
            f" {abs(best_rho.off_perpendicular_deg):.0f}° from the perpendicular",
        ),
        Claim(
            "a line that leans downwind cannot be flown well",
            bool(downwind) and (lost > 0 or swings > 10.0 * best_rho.rms_e_rho_m),
            f"{lost} of {sum(s.flights for s in downwind)} flights on such lines were lost, the"
            f" others swing about them by {100 * swings:.0f} cm rms or more",
        ),
    )


def _held(scores: list[LeanScore]) -> list[LeanScore]:
    """Leans on which every flight stayed on the line."""
    return [s for s in scores if s.survived == s.flights and s.rms_e_rho_m <= HELD_M]


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


def _why(
    scores: list[LeanScore],
    half: list[LeanScore],
    across_deg: float,
    slope: float,
    horizontal_rate: float,
    refused_flat: str,
    refused_downwind: str,
) -> str:
    held = _held(scores)
    worst = max(
        (abs(s.dispersion_m / s.dispersion_formula_m - 1.0) for s in held), default=float("nan")
    )
    flat, flat_half = scores[-1], half[-1]
    downwind, downwind_half = scores[0], half[0]
    front = "stable, but" if horizontal_rate > 0.0 else "not stable at all:"
    return (
        "Drift and oscillation do not ask for the same lean. *Along* the line the slope of excess"
        f" updraft counts, which is steepest across the contour ({across_deg:.0f}° here), against"
        " the height that a lean costs: the dispersion is flat about its least, and follows its"
        f" formula within {100 * worst:.0f} % on every line that was held ({_range(held)})."
        " *Across* the line it is the attitude that counts. Pitching up raises the aircraft first"
        " and drifts it back after. On a line that leans upwind both bring it to the same side; on"
        " one that leans downwind the first is the wrong way round, a zero of the right half plane"
        " near"
        f" (g/V) tan η: at {downwind.lean_deg:.0f}° the aircraft swings by"
        f" {_cm(downwind.rms_e_rho_m, 0)} cm rms, and by {_cm(downwind_half.rms_e_rho_m, 0)} cm"
        " with half the outer gains. On a line that leans far upwind the fast effect is most of"
        " e_rho, the loop's gain is higher, and these gains begin to ring: at"
        f" {flat.lean_deg:.0f}° {_cm(flat.rms_e_rho_m, 1)} cm rms, with the wing beyond the stall"
        f" {100 * flat.stalled_fraction:.0f} % of the time, and {_cm(abs(flat.drift_m), 0)} cm from"
        f" the crossing; with half the outer gains {_cm(flat_half.rms_e_rho_m, 1)} cm and"
        f" {_cm(abs(flat_half.drift_m), 1)} cm. So lines are to"
        " lean upwind by 10–30°, or further with gains of their own; the perpendicular is not the"
        " whole rule.\n\n"
        f"A *horizontal* line leaves the place along the wind to S′ alone (here {slope:+.3f}):"
        f" the slide is {front} at a rate of {horizontal_rate:.1f} 1/s, several times that of a"
        " leaning line and too fast for the glide to be steady, as the formula takes it to be; on"
        " the slow side of least sink, where S′ < 0, it runs away. It has no upstream side either,"
        f" so that e_rho has no sign. The module refuses it ({refused_flat}) and one that leans"
        f" downwind ({refused_downwind})."
    )


def _range(scores: list[LeanScore]) -> str:
    if not scores:
        return "none"
    return f"{scores[0].lean_deg:.0f}° to {scores[-1].lean_deg:.0f}°"


def _draw(
    context: Context, scores: list[LeanScore], half: list[LeanScore], across_deg: float
) -> tuple[str, ...]:
    path = context.figure("lean")
    if path is None:
        return ()
    from tgl_soar.analysis.report.curves_figure import (
        CurvePanel,
        DrawnCurve,
        Mark,
        Note,
        curves_figure,
    )
    from tgl_soar.analysis.report.style import LEG_COLOURS

    marks = [Mark(across_deg, "perpendicular to the contour"), Mark(0.0, "upright")]
    label = "lean [°], positive upwind"
    gains = (
        (scores, "gains as they are", LEG_COLOURS[0], "o"),
        (half, "half the outer gains", LEG_COLOURS[1], "s"),
    )

    def curve(of: str) -> list[DrawnCurve]:
        return [
            DrawnCurve(
                [s.lean_deg for s in several if s.survived],
                [100 * getattr(s, of) for s in several if s.survived],
                word,
                colour,
                marker=marker,
            )
            for several, word, colour, marker in gains
        ]

    formula = DrawnCurve(
        [s.lean_deg for s in scores],
        [100 * s.dispersion_formula_m for s in scores],
        "formula",
        "0.3",
        "--",
    )
    lost = [
        Note(s.lean_deg, 100 * s.rms_e_rho_m, f"{s.survived}/{s.flights}", colour)
        for several, _, colour, _ in gains
        for s in several
        if 0 < s.survived < s.flights
    ]
    curves_figure(
        path,
        [
            CurvePanel(
                "across the line", label, "rms e_rho [cm]", curve("rms_e_rho_m"), lost, marks,
                y_log=True, legend="upper right",
            ),
            CurvePanel(
                "along the line", label, "dispersion [cm]", [*curve("dispersion_m"), formula], [],
                marks, y_log=True, legend="upper right",
            ),
            CurvePanel(
                "mean place", label, "to TGL ∩ ZEUC, along the line [cm]", curve("drift_m"), [],
                marks, legend="lower left",
            ),
        ],
        "lines of every lean through one place",
    )  # fmt: skip
    return (path.name,)
