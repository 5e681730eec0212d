"""`lean`: lines of every lean through one place, from downwind to nearly flat."""

from __future__ import annotations

from math import degrees, inf, sqrt
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np

from tgl_soar.air.zeuc import excess_gradient
from tgl_soar.analysis.experiments.context import Context, turbulence_of
from tgl_soar.analysis.experiments.dispersion import dryden_dispersion
from tgl_soar.analysis.experiments.flights import FlownScenario, legs_named, pooled_dispersion, rms
from tgl_soar.analysis.experiments.result import ChangedThreshold, Claim, Result, Table
from tgl_soar.analysis.experiments.scenario import (
    PreparedScenario,
    Scenario,
    SensorSpec,
    perpendicular_lean,
    prepare,
    slide_at,
)
from tgl_soar.config.parameters import ParameterError, ParameterSet
from tgl_soar.types import polar_slope

LEANS_DEG: Final = (-20, -10, -5, 0, 5, 10, 15, 20, 30, 40, 50, 60)
LINE: Final = "b"
# rms e_rho beyond this is no flight on a line any more: a fifth of the chord, by which the aircraft
# is seen to leave it; the turbulence flown in moves it by a third of that on a line that is held.
HELD_M: Final = 0.03
# The rms of 8 flights of 25 s whose e_rho forgets within half a second is known to 3.5 %, a ratio
# of two to 5 %: beyond two standard errors one is larger.
RESOLVED: Final = 1.1
NEAR_DEG: Final = 10.0  # of the perpendicular: the leans flown stand 10° apart there
FAR_DEG: Final = 30.0
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
    dispersion_m: float
    dispersion_formula_m: float
    drift_m: float  # mean place to TGL ∩ ZEUC, along the line
    rate_per_s: float  # λ
    stalled_fraction: float  # of the time, with an angle of attack beyond the stall's
    ended: str  # why the first that was lost was lost

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
        "lean",
        scenario.title,
        f"The place at {at.wind_mps:.2f} m/s of local wind, at {100 * _intensity(base):g} % of"
        f" turbulence, with lines of every lean through it; positive leans upwind. The contour's"
        f" perpendicular leans {across:.0f}° there. The default limits"
        f" ({limits['TGL_LEAN_MIN']:g}° to {limits['TGL_LEAN_MAX']:g}°) are raised for this. The"
        " claims are judged with gains for each lean (the schedule); flown beside them, one set of"
        " gains as it stands (`RHO_SPEED` 0), in which the lean is confounded with a loop whose"
        " gain grows with it. Without accelerometers and with them. A lean that loses one flight"
        " counts as worse than any that lost none.",
        tuple(
            claim
            for imu in SENSORS
            for claim in lean_claims(scores[imu, SCHEDULED], across, f"{imu} accelerometers")
        ),
        lean_why(scores, across, slope, horizontal),
        tuple(
            Table(f"{gains}, {imu} accelerometers", COLUMNS, tuple(map(_row, several)))
            for (imu, gains), several in scores.items()
        ),
        {
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
        _draw(context, scores, across),
        ("lean",),
        tuple(scenario.seeds),
        CHANGED,
    )


COLUMNS: Final = (
    "lean [°]", "off the perpendicular [°]", "flown to the end", "rms e_rho [cm]",
    "oscillation about the line [cm]", "drift from the line [cm]", "rms y [cm]", "rms bank [°]",
    "dispersion [cm]", "formula [cm]", "mean to TGL ∩ ZEUC [cm]", "λ [1/s]",
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
    about = rms(sqrt(max(0.0, leg.rms_e_rho_m**2 - leg.mean_e_rho_m**2)) for leg in legs)
    return LeanScore(
        lean_deg=float(lean_deg),
        off_perpendicular_deg=lean_deg - across_deg,
        flights=len(flights),
        survived=len(whole),
        rms_e_rho_m=rms(leg.rms_e_rho_m for leg in legs) if all_lasted else inf,
        oscillation_m=about if all_lasted else inf,
        from_line_m=rms(leg.mean_e_rho_m for leg in legs) if all_lasted else inf,
        rms_y_m=rms(leg.rms_y_m for leg in legs),
        rms_bank_rad=rms(leg.rms_bank_rad for leg in legs),
        dispersion_m=pooled_dispersion(legs) if legs else nan,
        dispersion_formula_m=formula,
        drift_m=float(np.mean([leg.miss_m for leg in legs])) if legs else nan,
        rate_per_s=rate,
        stalled_fraction=float(np.mean([np.mean(f.path["alpha_rad"] > stall) for f in whole]))
        if whole
        else nan,
        ended=next((flight.ended.split(" at x")[0] for flight in flights if flight.ended), ""),
    )


def lean_claims(scores: list[LeanScore], across_deg: float, flown: str) -> tuple[Claim, ...]:
    """The paper's rule is to stand across the contour, for oscillation and drift from the line."""
    downwind = [s for s in scores if s.lean_deg < 0.0]
    held = [s for s in downwind if s.held]
    return (
        _grows_off_perpendicular(
            scores,
            [s.oscillation_m for s in scores],
            across_deg,
            "oscillates about the line",
            flown,
        ),
        _grows_off_perpendicular(
            scores, [s.from_line_m for s in scores], across_deg, "drifts from the line", flown
        ),
        Claim(
            f"a line that leans downwind cannot be flown well ({flown})",
            bool(downwind) and not held,
            f"{len(held)} of {len(downwind)} such leans are held within {100 * HELD_M:g} cm rms;"
            f" {sum(s.flights - s.survived for s in downwind)} of"
            f" {sum(s.flights for s in downwind)} flights were lost",
        ),
    )


def _grows_off_perpendicular(
    scores: list[LeanScore], measured_m: list[float], across_deg: float, does: str, flown: str
) -> Claim:
    """Near the perpendicular about the least, and more on either side far from it."""
    pairs = list(zip(scores, measured_m, strict=True))
    least, least_m = min(pairs, key=lambda pair: pair[1])
    near = min(pairs, key=lambda pair: abs(pair[0].off_perpendicular_deg))
    far = [value for s, value in pairs if abs(s.off_perpendicular_deg) >= FAR_DEG]
    at_hand = abs(near[0].off_perpendicular_deg) <= NEAR_DEG
    return Claim(
        f"the less perpendicular to the contour a line is, the more the aircraft {does} ({flown})",
        at_hand
        and near[1] <= RESOLVED * least_m < inf
        and bool(far)
        and all(value > RESOLVED * near[1] for value in far),
        f"least {_cm(least_m, 2)} cm at {least.lean_deg:.0f}°,"
        f" {abs(least.off_perpendicular_deg):.0f}° from the perpendicular ({across_deg:.0f}°);"
        f" {_cm(near[1], 2)} cm at {near[0].lean_deg:.0f}°;"
        f" {FAR_DEG:g}° off and further from {_cm(min(far, default=inf), 2)} cm on",
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
    worst = max(
        (
            abs(s.dispersion_m / s.dispersion_formula_m - 1.0)
            for several in scores.values()
            for s in several
            if s.held
        ),
        default=float("nan"),
    )
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
        f" contour ({across_deg:.0f}° here), against the height that a lean costs; the dispersion"
        f" follows its formula within {100 * worst:.0f} % on the lines that were held. *Across* it"
        " attitude counts: pitching up raises the aircraft first and drifts it back after. On a"
        " line that leans upwind both bring it to the same side; on one that leans downwind the"
        " first is the wrong way round, a zero of the right half plane near (g/V) tan η. The"
        " further a line leans upwind, the more of e_rho is the fast effect, and the higher is the"
        " gain of a loop whose gains stay as they are.\n\n"
        f"A *horizontal* line leaves the place along the wind to S′ alone (here {slope:+.3f}):"
        f" the slide is {front} at a rate of {horizontal_rate:.1f} 1/s, by a formula that takes the"
        " glide to be steady; on the slow side of least sink, where S′ < 0, it runs away. It has no"
        " upstream side either, so that e_rho has no sign. The module refuses it"
        f" ({refusal(90.0)}) and one that leans downwind ({refusal(-10.0)})."
    )


def _draw(
    context: Context, scores: dict[tuple[str, str], list[LeanScore]], across_deg: float
) -> tuple[str, ...]:
    path = context.figure("lean")
    if path is None:
        return ()
    from tgl_soar.analysis.report.curves_figure import CurvePanel, DrawnCurve, Mark, curves_figure
    from tgl_soar.analysis.report.style import LEG_COLOURS

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
                    LEG_COLOURS[i],
                    marker="osDv"[i],
                )
            )
        return curves

    first = next(iter(scores.values()))
    formula = DrawnCurve(
        [s.lean_deg for s in first],
        [100 * s.dispersion_formula_m for s in first],
        "formula",
        "0.3",
        "--",
    )
    curves_figure(
        path,
        [
            CurvePanel(
                "about the line", label, "oscillation [cm]", curve("oscillation_m"), [], marks,
                y_log=True, legend="upper right",
            ),
            CurvePanel(
                "from the line", label, "mean e_rho, rms of flights [cm]", curve("from_line_m"),
                [], marks, y_log=True,
            ),
            CurvePanel(
                "along the line", label, "dispersion [cm]", [*curve("dispersion_m"), formula], [],
                marks, y_log=True,
            ),
        ],
        "lines of every lean through one place, where none was lost",
    )  # fmt: skip
    return (path.name,)
