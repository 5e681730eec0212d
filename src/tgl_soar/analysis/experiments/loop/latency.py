"""`latency`: the leans of `lean` and the places of `speed` by a faster and by a slower link.

With the scheduled gains, as the shipped aircraft's usual link carries a command to the servo's
input, and as ArduPlane's overrides do (docs/autopilots.md); CMD_DELAY states it.  Beyond it nothing
differs from `lean` and `speed`, whose claims are about other things.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, isfinite
from typing import Any, Final, NamedTuple

import msgspec

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import FlownScenario, ScenarioJob
from tgl_soar.analysis.experiments.paper.air_speed import SCHEDULED_MPS, score_speed
from tgl_soar.analysis.experiments.paper.line_lean import LEANS_DEG, LINE, score_lean
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.experiments.scenario import Scenario, SensorSpec, prepare
from tgl_soar.config.parameters import ParameterSet

LATENCIES_S: Final = (0.0075, 0.0245)
SENSORS: Final = {"with": SensorSpec(imu=True), "without": SensorSpec()}  # accelerometers
# As much margin at three times the latency costs the linear model a factor of two in e_rho.
DEARER: Final = 2.0


class LatencyCase(NamedTuple):
    """What flights have in common."""

    of: str  # "lean" or "speed"
    where: str  # the lean, or the place
    imu: str  # of `SENSORS`
    latency_s: float


class LatencyScore(NamedTuple):
    """What became of them."""

    flights: int
    survived: int
    rms_e_rho_m: float  # inf: one was lost
    rms_y_m: float  # of those that lasted; NaN: none
    rms_bank_rad: float


def latency(context: Context) -> Result:
    """Fly all by both links."""
    scenarios = {name: context.scenario(name) for name in ("lean", "speed")}
    variants = _variants(scenarios, context.quick)
    cases = [
        LatencyCase(*key, imu, latency_s)
        for key in variants
        for imu in SENSORS
        for latency_s in LATENCIES_S
    ]
    jobs = {case: _jobs(variants[case[:2]], case) for case in cases}
    flown = iter(context.fly_jobs([job for each in jobs.values() for job in each]))
    scores = {
        case: _scored(variants[case[:2]], case, [next(flown) for _ in each])
        for case, each in jobs.items()
    }
    return Result(
        name="latency",
        title="leans and places by a faster and by a slower link",
        flown="The leans of [`lean`](experiments.md#lean) and the places of"
        " [`speed`](experiments.md#speed) with the scheduled gains, commands"
        f" {' and '.join(f'{1e3 * each:g}' for each in LATENCIES_S)} ms late and known to be.",
        claims=latency_claims(scores),
        why="",
        tables=(
            Table(
                "",
                (
                    "", "accelerometers", "late by [ms]", "flown to the end", "rms e_rho [cm]",
                    "rms y [cm]", "rms bank [°]",
                ),
                tuple(_row(case, score) for case, score in scores.items()),
            ),
        ),
        numbers={", ".join(map(str, case)): score._asdict() for case, score in scores.items()},
        figures=(),
        scenarios=tuple(scenarios),
        seeds=tuple(scenarios["lean"].seeds),
    )  # fmt: skip


def _variants(scenarios: dict[str, Scenario], quick: bool) -> dict[tuple[str, str], Scenario]:
    """By experiment, and lean or place."""
    variants: dict[tuple[str, str], Scenario] = {}
    lean, speed = scenarios["lean"], scenarios["speed"]
    for deg in LEANS_DEG[7:8] if quick else LEANS_DEG:
        line = msgspec.structs.replace(lean.lines[LINE], lean_deg=float(deg))
        variants["lean", f"{deg:g}"] = msgspec.structs.replace(lean, lines={LINE: line})
    for name in list(speed.lines)[-1:] if quick else speed.lines:
        parameters = {**speed.parameters, "RHO_SPEED": SCHEDULED_MPS}
        variants["speed", name] = msgspec.structs.replace(
            speed, first_line=name, parameters=parameters
        )
    return variants


def _jobs(scenario: Scenario, case: LatencyCase) -> list[ScenarioJob]:
    base = prepare(scenario)
    later_s = case.latency_s - base.values["CMD_DELAY"]
    figures: tuple[tuple[str, float], ...] = ()
    if abs(later_s) > 1e-6:  # what is stated is a float32
        figures = (("model.servo_delay_s", base.airframe.model["servo_delay_s"] + later_s),)
    known = msgspec.structs.replace(
        scenario,
        sensors=SENSORS[case.imu],
        parameters={**scenario.parameters, "CMD_DELAY": case.latency_s},
    )
    return [ScenarioJob(scenario=known, seed=seed, aircraft=figures) for seed in scenario.seeds]


def _scored(scenario: Scenario, case: LatencyCase, flights: list[FlownScenario]) -> LatencyScore:
    found: Any
    if case.of == "lean":
        found = score_lean(prepare(scenario), flights, float(case.where), 0.0)
    else:
        found = score_speed(flights, case.where, 0.0)
    return LatencyScore(
        flights=found.flights,
        survived=found.survived,
        rms_e_rho_m=found.rms_e_rho_m,
        rms_y_m=found.rms_y_m,
        rms_bank_rad=found.rms_bank_rad,
    )


def latency_claims(scores: dict[LatencyCase, LatencyScore]) -> tuple[Claim, ...]:
    """Each lean and place alone; leans that are not accepted by default decide nothing."""
    early_s, late_s = LATENCIES_S
    claims = []
    for of, imu in dict.fromkeys((case.of, case.imu) for case in scores):
        here = [
            (case, scores[case], scores[case._replace(latency_s=early_s)])
            for case in scores
            if case[0] == of and case.imu == imu and case.latency_s == late_s and _counts(case)
        ]
        what = "accepted lean" if of == "lean" else "place"
        fewer = [
            f"{case.where}: {late.survived} and {early.survived} of {late.flights}"
            for case, late, early in here
            if late.survived < early.survived
        ]
        ratios = {
            case.where: late.rms_e_rho_m / early.rms_e_rho_m
            for case, late, early in here
            if isfinite(late.rms_e_rho_m) and isfinite(early.rms_e_rho_m)
        }
        dearest = max(ratios, key=lambda where: ratios[where], default="")
        claims += [
            Claim(
                f"`{of}`, {imu} accelerometers: as many last {1e3 * late_s:g} ms late as"
                f" {1e3 * early_s:g} ms, at every {what}",
                not fewer,
                ", ".join(fewer) or f"at all {len(here)}",
            ),
            Claim(
                f"`{of}`, {imu} accelerometers: e_rho is at most {DEARER:g} times as large, at"
                f" every {what} that loses none",
                bool(ratios) and ratios[dearest] <= DEARER,
                f"{ratios[dearest]:.2f} times at most, at {dearest}" if ratios else "none",
            ),
        ]
    return tuple(claims)


def _counts(case: LatencyCase) -> bool:
    limits = ParameterSet()
    if case.of == "speed":
        return True
    return limits["TGL_LEAN_MIN"] <= float(case.where) <= limits["TGL_LEAN_MAX"]


def _row(case: LatencyCase, score: LatencyScore) -> tuple[str, ...]:
    place = f"lean {case.where}°" if case.of == "lean" else f"speed, place {case.where}"
    return (
        place,
        case.imu,
        f"{1e3 * case.latency_s:g}",
        f"{score.survived} of {score.flights}",
        *_cells(
            (100.0 * score.rms_e_rho_m, 2),
            (100.0 * score.rms_y_m, 1),
            (degrees(score.rms_bank_rad), 1),
        ),
    )


def _cells(*values: tuple[float, int]) -> Sequence[str]:
    return [f"{value:.{digits}f}" if isfinite(value) else "–" for value, digits in values]
