"""`speed`: one set of gains from slow to fast air, below and above what the loop bears."""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import msgspec
import numpy as np

from tgl_soar.analysis.experiments.context import Context, with_turbulence
from tgl_soar.analysis.experiments.flights import FlownScenario, legs_named, rms
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.experiments.scenario import PreparedScenario, Scenario, prepare
from tgl_soar.estimation.polar import best_glide_speed

OUTER: Final = ("RHO_P", "RHO_I", "RHO_D")
SURFACE: Final = ("ELE_P", "ELE_I", "ELE_D")
FACTORS: Final = (1.0, 1.6, 2.0, 2.5, 3.0, 4.0)  # of the outer gains, in calm air
CALM_S: Final = 25.0
RINGS_M: Final = 0.01  # rms e_rho in calm air, where noise alone makes a quarter of it


class SpeedScore(NamedTuple):
    """One place, one set of gains."""

    line: str
    wind_mps: float
    flights: int
    survived: int
    rms_e_rho_m: float
    peak_e_rho_m: float
    rms_pitch_rate_radps: float


def speed(context: Context) -> Result:
    """Turbulence with the gains as they are and with surfaces scaled; calm air with more gain."""
    scenario = context.scenario("speed")
    lines = list(scenario.lines)
    if context.quick:
        lines = [lines[0], lines[-1]]
    factors = (1.0, 2.5) if context.quick else FACTORS
    base = prepare(scenario)
    winds = {line: _wind(base, line) for line in lines}
    variants: dict[Any, Scenario] = {}
    for line in lines:
        here = msgspec.structs.replace(scenario, first_line=line)
        scale = (winds[lines[0]] / winds[line]) ** 2
        variants[line, "fixed"] = here
        variants[line, "surfaces / V²"] = _scaled(here, base, SURFACE, scale)
        calm = msgspec.structs.replace(with_turbulence(here, 0.0), duration_s=CALM_S)
        for factor in factors:
            variants[line, factor] = _scaled(calm, base, OUTER, factor)
    flights = context.fly(variants)
    scores = {key: _score(flights[key], key[0], winds[key[0]]) for key in variants}
    best = best_glide_speed(base.polar)
    figures = _draw(context, lines, factors, scores)
    fixed = [scores[line, "fixed"] for line in lines]
    calm_scores = {f: [scores[line, f] for line in lines] for f in factors}
    intensity = base.site.air.turbulence.intensity if base.site.air else 0.0
    return Result(
        "speed",
        scenario.title,
        "Still lines from 0.90 to 1.00 of best glide's speed"
        f" ({best:.2f} m/s), one set of gains. First in {100 * intensity:g} % of turbulence, as the"
        " gains are and with the elevator's gains scaled by 1/V² from the slowest place on. Then in"
        " calm air with the outer gains raised together, to see where the loop begins to ring, and"
        " how much.",
        speed_claims(fixed, calm_scores),
        speed_why(fixed, [scores[line, "surfaces / V²"] for line in lines], calm_scores),
        (
            Table(
                f"{100 * intensity:g} % of turbulence",
                (
                    "line", "local wind [m/s]", "flown to the end", "rms e_rho [cm]",
                    "mean peak [cm]", "rms pitch rate [°/s]", "rms e_rho, surfaces / V² [cm]",
                ),
                tuple(
                    (
                        s.line, f"{s.wind_mps:.2f}", f"{s.survived} of {s.flights}",
                        _cm(s.rms_e_rho_m, 2), _cm(s.peak_e_rho_m, 1),
                        f"{np.degrees(s.rms_pitch_rate_radps):.1f}",
                        _cm(scores[s.line, "surfaces / V²"].rms_e_rho_m, 2),
                    )
                    for s in fixed
                ),
            ),
            Table(
                "Calm air, outer gains times …: rms e_rho [cm]",
                ("line", "local wind [m/s]", *(f"× {f:g}" for f in factors)),
                tuple(
                    (
                        line, f"{winds[line]:.2f}",
                        *(_cm(scores[line, f].rms_e_rho_m, 2) for f in factors),
                    )
                    for line in lines
                ),
            ),
        ),
        {
            "turbulence": {
                kind: [scores[line, kind]._asdict() for line in lines]
                for kind in ("fixed", "surfaces / V²")
            },
            "calm": {str(f): [s._asdict() for s in calm_scores[f]] for f in factors},
            "best_glide_mps": best,
        },
        figures,
        ("speed",),
        tuple(scenario.seeds),
    )  # fmt: skip


def _wind(prepared: PreparedScenario, line: str) -> float:
    at = prepared.lines[line].crossing
    assert at is not None
    return at.wind_mps


def _cm(value_m: float, digits: int) -> str:
    return "lost" if value_m != value_m else f"{100 * value_m:.{digits}f}"


def _scaled(
    scenario: Scenario, base: PreparedScenario, names: tuple[str, ...], factor: float
) -> Scenario:
    scaled = {name: base.values[name] * factor for name in names}
    return msgspec.structs.replace(scenario, parameters={**scenario.parameters, **scaled})


def _score(flights: list[FlownScenario], line: str, wind_mps: float) -> SpeedScore:
    whole = [flight for flight in flights if flight.survived]
    legs = legs_named(whole, line)
    rates = []
    for flight, leg in zip(whole, legs, strict=False):
        time = flight.path["time_s"]
        rows = time >= leg.end_s - leg.scored_s
        rates.append(float(np.std(np.gradient(flight.path["pitch_rad"][rows], time[rows]))))
    nan = float("nan")
    return SpeedScore(
        line=line,
        wind_mps=wind_mps,
        flights=len(flights),
        survived=len(whole),
        rms_e_rho_m=rms(leg.rms_e_rho_m for leg in legs),
        peak_e_rho_m=float(np.mean([leg.peak_e_rho_m for leg in legs])) if legs else nan,
        rms_pitch_rate_radps=rms(rates),
    )


def _grows(scores: list[SpeedScore]) -> float:
    """rms e_rho at the fastest place that was flown over that at the slowest; NaN: too few."""
    flown = [s for s in scores if s.survived > 0]
    if len(flown) < 2:
        return float("nan")
    return flown[-1].rms_e_rho_m / flown[0].rms_e_rho_m


def speed_claims(fixed: list[SpeedScore], calm: dict[float, list[SpeedScore]]) -> tuple[Claim, ...]:
    """Larger oscillation downstream: with these gains, and with a loop that rings."""
    ringing = {
        factor: _grows(scores)
        for factor, scores in calm.items()
        if any(s.rms_e_rho_m > RINGS_M for s in scores)
    }
    held = [ratio for ratio in ringing.values() if ratio == ratio]
    return (
        Claim(
            "with fixed gains the oscillation grows downstream, as airspeed grows",
            _grows(fixed) > 1.0,
            f"in turbulence, rms e_rho {100 * fixed[0].rms_e_rho_m:.2f} cm at"
            f" {fixed[0].wind_mps:.2f} m/s and {100 * fixed[-1].rms_e_rho_m:.2f} cm at"
            f" {fixed[-1].wind_mps:.2f} m/s",
        ),
        Claim(
            "the same where the gains are too high and the loop rings",
            bool(held) and float(np.median(held)) > 1.0,
            "no gain tried made it ring"
            if not held
            else "fastest over slowest place that was not lost: "
            + ", ".join(f"{ratio:.2f} at × {factor:g}" for factor, ratio in ringing.items()),
        ),
    )


def speed_why(
    fixed: list[SpeedScore], scaled: list[SpeedScore], calm: dict[float, list[SpeedScore]]
) -> str:
    """Which of the two is the paper's."""
    lost = [f"× {f:g}" for f, scores in calm.items() if scores[0].survived == 0]
    return (
        "Two things grow with airspeed: what a radian of pitch does to the aircraft, which tightens"
        " the loop, and with it the loop's gain, which uses up its phase margin. With gains that"
        " leave a margin the first wins: turbulence of one size moves the aircraft less downstream"
        f" ({_grows(fixed):.2f} times from the slowest to the fastest place). The paper's growth"
        " appears only where the loop rings already, and there it is modest. Gains near the edge,"
        " or air that is rougher downstream, would make it larger; which of them the paper had, the"
        " simulation cannot say. Scaling the elevator's gains by 1/V² changes the trend to"
        f" {_grows(scaled):.2f}: it does not cure what is the outer loop's."
        + (
            f" With {', '.join(lost)} the slowest place is lost altogether: the ringing reaches the"
            " stall."
            if lost
            else ""
        )
    )


def _draw(
    context: Context,
    lines: list[str],
    factors: tuple[float, ...],
    scores: dict[Any, SpeedScore],
) -> tuple[str, ...]:
    path = context.figure("speed")
    if path is None:
        return ()
    from tgl_soar.analysis.report.curves_figure import CurvePanel, DrawnCurve, curves_figure
    from tgl_soar.analysis.report.style import LEG_COLOURS

    winds = [scores[line, "fixed"].wind_mps for line in lines]
    turbulent = [
        DrawnCurve(
            winds,
            [100 * scores[line, kind].rms_e_rho_m for line in lines],
            label,
            colour,
            style,
            "o",
        )
        for kind, label, colour, style in (
            ("fixed", "fixed gains", LEG_COLOURS[1], "-"),
            ("surfaces / V²", "elevator's gains / V²", LEG_COLOURS[0], "--"),
        )
    ]
    calm = [
        DrawnCurve(
            winds,
            [100 * scores[line, factor].rms_e_rho_m for line in lines],
            f"outer gains × {factor:g}",
            LEG_COLOURS[i % len(LEG_COLOURS)],
            marker="os^vDP"[i % 6],
        )
        for i, factor in enumerate(factors)
    ]
    curves_figure(
        path,
        [
            CurvePanel(
                "in turbulence", "local wind [m/s]", "rms e_rho [cm]", turbulent, y_from_zero=True
            ),
            CurvePanel(
                "in calm air: where the loop rings",
                "local wind [m/s]",
                "rms e_rho [cm]",
                calm,
                y_log=True,
                legend="center right",
            ),
        ],
        "one set of gains from slow to fast air",
    )
    return (path.name,)
