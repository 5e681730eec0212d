"""`speed`: one set of gains from slow to fast air, below and above what the loop bears."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, inf, isfinite, sqrt
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np

from tgl_soar.analysis.experiments.context import Context, with_turbulence
from tgl_soar.analysis.experiments.flights import (
    LINE_GAINS,
    FlownScenario,
    legs_named,
    rms,
    rms_error,
)
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
    prepare,
)
from tgl_soar.estimation.polar import best_glide_speed

FACTORS: Final = (1.0, 2.0, 3.0, 4.0)  # of the outer gains, in calm air
CALM_S: Final = 20.0
RINGS_M: Final = 0.01  # oscillation in calm air, where noise alone makes a quarter of it
SENSORS: Final = {"without": SensorSpec(), "with": SensorSpec(imu=True)}  # accelerometers
SCHEDULED_MPS: Final = 8.5  # RHO_SPEED as shipped
FIXED, SCHEDULED = "one set of gains", "scheduled"
CHANGED: Final = (
    ChangedThreshold(
        "oscillation grows downstream",
        "fastest over slowest place above 1, of flights that lasted, one seed in calm air",
        f"above 1 by {RESOLVED:g} standard errors, every lost flight counted at its place, eight"
        " seeds; undecided within them",
        "the slowest place is the first to be lost, and without it the ratio is another's",
    ),
    ChangedThreshold(
        "oscillation; where the loop rings",
        "rms e_rho",
        "rms of e_rho about each flight's mean",
        "an aircraft whose positions or attitude are biased flies beside its line, and does not"
        " oscillate for it",
    ),
    ChangedThreshold(
        "places", "0.90 to 1.00 of best glide", "0.825 to 1.05", "the polar ends at 0.820"
    ),
)


class SpeedScore(NamedTuple):
    """One place, one set of gains; inf where any flight was lost."""

    line: str
    wind_mps: float
    flights: int
    survived: int
    rms_e_rho_m: float  # over all flights
    oscillation_m: float  # about each flight's mean
    error: float  # standard error of that, relative
    rms_y_m: float  # of those that lasted; NaN: none, as are the next two
    rms_bank_rad: float
    rms_pitch_rate_radps: float


class Growth(NamedTuple):
    """Oscillation about the line at the fastest place over that at the slowest, losses counted."""

    ratio: float  # inf: lost at the fastest alone; 0: at the slowest alone; NaN: at both
    error: float  # standard error

    @property
    def shown(self) -> bool:
        """Whether it grows for certain."""
        return self.ratio - RESOLVED * self.error > 1.0

    @property
    def decided(self) -> bool | None:
        """The same; None where neither growing nor not is certain."""
        if self.shown or self.ratio != self.ratio:
            return self.shown
        return None if self.ratio + RESOLVED * self.error > 1.0 else False


def speed(context: Context) -> Result:
    """Turbulence with one set of gains and with the schedule; calm air with more gain."""
    scenario = context.scenario("speed")
    lines = list(scenario.lines)
    if context.quick:
        lines = [lines[0], lines[-1]]
    factors = (1.0, 3.0) if context.quick else FACTORS
    base = prepare(scenario)
    winds = {line: _wind(base, line) for line in lines}
    flights = context.fly(_variants(scenario, base, lines, factors))
    scores = {key: score_speed(each, key[0], winds[key[0]]) for key, each in flights.items()}
    best = best_glide_speed(base.polar)

    def of(kind: Any) -> dict[str, list[SpeedScore]]:
        return {imu: [scores[line, imu, kind] for line in lines] for imu in SENSORS}

    fixed, scheduled = of(FIXED), of(SCHEDULED)
    calm = {factor: [scores[line, "without", factor] for line in lines] for factor in factors}
    assert scenario.turbulence is not None
    intensity = scenario.turbulence.intensity
    return Result(
        name="speed",
        title=scenario.title,
        flown=f"Still lines from {winds[lines[0]] / best:.3f} to {winds[lines[-1]] / best:.3f} of"
        f" best glide's speed ({best:.2f} m/s) on a hill of 10 m radius, one set of gains as it"
        f" stands (`RHO_SPEED` 0), and beside it the schedule over speed. In {100 * intensity:g} %"
        " of"
        " turbulence, without accelerometers and with them; and in calm air, without, with the"
        " outer gains raised together, to see where the loop begins to ring. A place that loses"
        " one flight has no rms: it counts as worse than any that lost none. Oscillation is the rms"
        " of e_rho about each flight's mean.",
        claims=speed_claims(fixed, calm),
        why=speed_why(fixed, scheduled, calm),
        tables=(
            Table(
                f"{100 * intensity:g} % of turbulence",
                (
                    "accelerometers", "gains", "line", "u / best glide", "local wind [m/s]",
                    "flown to the end", "rms e_rho [cm]", "oscillation [cm]", "rms y [cm]",
                    "rms bank [°]", "rms pitch rate [°/s]",
                ),
                tuple(
                    (
                        imu, kind, s.line, f"{s.wind_mps / best:.3f}", f"{s.wind_mps:.2f}",
                        f"{s.survived} of {s.flights}",
                        _cm(s.rms_e_rho_m, 2), _cm(s.oscillation_m, 2), _cm(s.rms_y_m, 1),
                        f"{degrees(s.rms_bank_rad):.1f}",
                        f"{degrees(s.rms_pitch_rate_radps):.1f}",
                    )
                    for imu in SENSORS
                    for kind, several in ((FIXED, fixed[imu]), (SCHEDULED, scheduled[imu]))
                    for s in several
                ),
            ),
            Table(
                "Calm air, without accelerometers, outer gains times …: oscillation about the line"
                " [cm]",
                ("line", "local wind [m/s]", *(f"× {f:g}" for f in factors)),
                tuple(
                    (line, f"{winds[line]:.2f}", *(_reported(calm[f][i]) for f in factors))
                    for i, line in enumerate(lines)
                ),
            ),
        ),
        numbers={
            "turbulence": {
                f"{kind}, accelerometers {imu}": [s._asdict() for s in several[imu]]
                for kind, several in ((FIXED, fixed), (SCHEDULED, scheduled))
                for imu in SENSORS
            },
            "calm": {str(f): [s._asdict() for s in calm[f]] for f in factors},
            "best_glide_mps": best,
        },
        figures=_draw(context, fixed, scheduled, calm),
        scenarios=("speed",),
        seeds=tuple(scenario.seeds),
        changed=CHANGED,
    )  # fmt: skip


def _variants(
    scenario: Scenario, base: PreparedScenario, lines: list[str], factors: Sequence[float]
) -> dict[Any, Scenario]:
    variants: dict[Any, Scenario] = {}
    for line in lines:
        here = msgspec.structs.replace(scenario, first_line=line)
        for imu, sensors in SENSORS.items():
            fixed = msgspec.structs.replace(here, sensors=sensors)
            variants[line, imu, FIXED] = fixed
            variants[line, imu, SCHEDULED] = _with(fixed, {"RHO_SPEED": SCHEDULED_MPS})
        calm = msgspec.structs.replace(
            with_turbulence(here, 0.0), duration_s=CALM_S, seeds=scenario.seeds
        )
        for factor in factors:
            raised = {name: base.values[name] * factor for name in LINE_GAINS}
            variants[line, "without", factor] = _with(calm, raised)
    return variants


def _with(scenario: Scenario, values: dict[str, float]) -> Scenario:
    return msgspec.structs.replace(scenario, parameters={**scenario.parameters, **values})


def _wind(prepared: PreparedScenario, line: str) -> float:
    at = prepared.lines[line].crossing
    assert at is not None
    return at.wind_mps


def _cm(value_m: float, digits: int) -> str:
    return f"{100 * value_m:.{digits}f}" if isfinite(value_m) else "lost"


def _reported(s: SpeedScore) -> str:
    lost = s.flights - s.survived
    return f"{lost} of {s.flights} lost" if lost else _cm(s.oscillation_m, 2)


def score_speed(flights: list[FlownScenario], line: str, wind_mps: float) -> SpeedScore:
    """All flights at one place."""
    whole = [flight for flight in flights if flight.survived and flight.legs]
    legs = legs_named(whole, line)
    rates = []
    for flight, leg in zip(whole, legs, strict=True):
        time = flight.path["time_s"]
        rows = time >= leg.end_s - leg.scored_s
        rates.append(float(np.std(np.gradient(flight.path["pitch_rad"][rows], time[rows]))))
    squares = [max(0.0, leg.rms_e_rho_m**2 - leg.mean_e_rho_m**2) for leg in legs]
    all_lasted = len(whole) == len(flights)
    return SpeedScore(
        line=line,
        wind_mps=wind_mps,
        flights=len(flights),
        survived=len(whole),
        rms_e_rho_m=rms(leg.rms_e_rho_m for leg in legs) if all_lasted else inf,
        oscillation_m=rms(map(sqrt, squares)) if all_lasted else inf,
        error=rms_error(squares) if all_lasted else inf,
        rms_y_m=rms(leg.rms_y_m for leg in legs),
        rms_bank_rad=rms(leg.rms_bank_rad for leg in legs),
        rms_pitch_rate_radps=rms(rates),
    )


def growth(scores: Sequence[SpeedScore]) -> Growth:
    """From the slowest place to the fastest; no place is left out for having lost flights."""
    first, last = scores[0], scores[-1]
    slow, fast = first.oscillation_m, last.oscillation_m
    if not isfinite(slow) and not isfinite(fast):
        return Growth(float("nan"), 0.0)
    ratio = fast / slow if isfinite(slow) else 0.0
    if ratio == 0.0 or not isfinite(ratio):
        return Growth(ratio, 0.0)
    return Growth(ratio, ratio * sqrt(first.error**2 + last.error**2))


def _words(of: Growth) -> str:
    if of.ratio != of.ratio:
        return "flights lost at both ends"
    if of.ratio == 0.0:
        return "flights lost at the slowest place"
    if not isfinite(of.ratio):
        return "flights lost at the fastest place"
    if not isfinite(of.error):
        return f"{of.ratio:.2f}, of too few flights to know it"
    return f"{of.ratio:.2f} ± {of.error:.2f}"


def rings(scores: Sequence[SpeedScore]) -> bool:
    """Whether the loop rings somewhere in calm air, or is lost to it."""
    return any(not s.oscillation_m <= RINGS_M for s in scores)


def speed_claims(
    fixed: dict[str, list[SpeedScore]], calm: dict[float, list[SpeedScore]]
) -> tuple[Claim, ...]:
    """Larger oscillation downstream: with these gains, and with a loop that rings."""
    ringing = {factor: growth(scores) for factor, scores in calm.items() if rings(scores)}
    return (
        *(
            decided(
                "with fixed gains the oscillation grows downstream, as airspeed grows"
                f" ({imu} accelerometers)",
                growth(scores).decided,
                f"in turbulence, fastest over slowest place {_words(growth(scores))}",
            )
            for imu, scores in fixed.items()
        ),
        decided(
            "the same with every gain that is too high, where the loop rings",
            all_of(of.decided for of in ringing.values()),
            "no gain tried made it ring"
            if not ringing
            else "fastest over slowest place: "
            + ", ".join(
                f"{_words(of)} at × {factor:g}, where it {_trend(of)}"
                for factor, of in ringing.items()
            ),
        ),
    )


def _trend(of: Growth) -> str:
    if of.ratio != of.ratio:
        return "is not to be told"
    if of.shown:
        return "grows"
    return "falls" if of.ratio + RESOLVED * of.error < 1.0 else "shows no trend"


def speed_why(
    fixed: dict[str, list[SpeedScore]],
    scheduled: dict[str, list[SpeedScore]],
    calm: dict[float, list[SpeedScore]],
) -> str:
    """What the numbers say, and what is behind it."""
    trends = "; ".join(
        f"{imu} accelerometers the oscillation {_trend(growth(fixed[imu]))}"
        f" ({_words(growth(fixed[imu]))}), with the schedule it {_trend(growth(scheduled[imu]))}"
        f" ({_words(growth(scheduled[imu]))})"
        for imu in fixed
    )
    lost = [
        f"{s.flights - s.survived} at {s.wind_mps:.2f} m/s with × {factor:g}"
        for factor, scores in calm.items()
        for s in scores
        if s.survived < s.flights
    ]
    return f"In turbulence, {trends}." + (
        f" In calm air were lost: {'; '.join(lost)}." if lost else " In calm air none was lost."
    )


def _draw(
    context: Context,
    fixed: dict[str, list[SpeedScore]],
    scheduled: dict[str, list[SpeedScore]],
    calm: dict[float, list[SpeedScore]],
) -> tuple[str, ...]:
    path = context.figure("speed")
    if path is None:
        return ()
    from tgl_soar.analysis.report.curves_figure import CurvePanel, DrawnCurve, curves_figure
    from tgl_soar.analysis.report.figure_style import PALETTE

    def curve(scores: list[SpeedScore], label: str, i: int, style: str = "-") -> DrawnCurve:
        flown = [s for s in scores if isfinite(s.oscillation_m)]
        return DrawnCurve(
            x=[s.wind_mps for s in flown],
            y=[100 * s.oscillation_m for s in flown],
            label=label,
            colour=PALETTE[i % len(PALETTE)],
            style=style,
            marker="os^vDP"[i % 6],
        )

    turbulent = [
        curve(several[imu], f"{kind}, {imu} accelerometers", i, style)
        for i, imu in enumerate(SENSORS)
        for kind, several, style in ((FIXED, fixed, "-"), (SCHEDULED, scheduled, "--"))
    ]
    raised = [curve(calm[f], f"outer gains × {f:g}", i) for i, f in enumerate(calm)]
    wind, waves = "local wind [m/s]", "oscillation [cm], where none was lost"
    curves_figure(
        path,
        [
            CurvePanel("in turbulence", wind, waves, turbulent, y_from_zero=True),
            CurvePanel("in calm air: where the loop rings", wind, waves, raised, y_log=True),
        ],
        "from slow to fast air",
    )
    return (path.name,)
