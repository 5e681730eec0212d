"""`dispersed`: aircraft like that of the file, and unlike it, each with a file of its own.

Drawn as `tgl-soar tune` draws them (`tuning.aircraft`): what can be measured before a flight (short
period, lift, drag, inertia, the elevator's effect, servo, latency) is in the file that the module
goes by, and the schedule of gains follows it; what is not (centre of gravity, a further error of
the elevator's effect, the attitude's bias) is in the aircraft alone.  Whoever flies with a file of
another aircraft has no margin to speak of: a short period of 7 rad/s and a servo of 45 ms under
gains for 11.5 rad/s and 18.5 ms leave a disk margin of 0.05.

A place is where the wind is a fraction of the aircraft's own best glide, as an operator would put
the line for it: on a line that is put for the shipped aircraft a wing with more lift hovers low,
where the wind is slower still, and nearer to the floor.  Judged at each place; places are never
pooled, because the slowest, nearest to the stall, loses first.  On the linear model each drawn
aircraft is looked at where it hovers, errors included.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from math import degrees, radians, sqrt
from pathlib import Path
from typing import Any, Final, NamedTuple

from scipy.stats import binomtest

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.experiments.scenario import prepare
from tgl_soar.analysis.linear_controller import linear_controller
from tgl_soar.analysis.linear_model import close_loop, disk_margin
from tgl_soar.analysis.linear_plant import Condition, linear_plant
from tgl_soar.analysis.tuning.aircraft import Ranges
from tgl_soar.analysis.tuning.demands import FREQUENCIES_RADPS
from tgl_soar.analysis.tuning.flights import (
    Attempt,
    DrawnFlight,
    FlyingPlace,
    fly_attempt,
    soaring_aircraft,
    values_of,
)
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.found_gains import INERTIAL, SETS
from tgl_soar.control.laws import laws_from
from tgl_soar.geometry import SoaringFrame
from tgl_soar.sim.servos import servo_params

AIRCRAFT: Final = 100  # flown, of each kind at each place
LINEAR: Final = 1000  # on the linear model, all places together
LATER_S: Final = 0.030  # what an unmeasured telemetry link may add
SEED: Final = 2026
# Three standard deviations of gusts of 3 % do not stall a wing that hovers here: a loss is the
# loop's.  At 5 % gusts alone reach the stall now and then.
LEAST: Final = {(0.03, 0.0): 0.99, (0.05, 0.0): 0.90, (0.03, LATER_S): 0.99}


class DispersedCase(NamedTuple):
    """What flights have in common."""

    kind: str  # `tuning.demands.SETS`
    turbulence: float
    later_s: float
    place: str


class DispersedScore(NamedTuple):
    """What became of the flights of a case."""

    flights: int
    up: int
    rms_e_rho_m: float  # of all, the lost ones as far as they flew
    rms_y_m: float  # likewise
    rms_bank_rad: float
    causes: tuple[tuple[str, int], ...]

    @property
    def interval(self) -> tuple[float, float]:
        """Of the share that lasts, exact (Clopper and Pearson), at 95 %."""
        found = binomtest(self.up, self.flights).proportion_ci(0.95, method="exact")
        return float(found.low), float(found.high)


class _Job(NamedTuple):
    field: FlyingPlace
    attempt: Attempt


class LinearJob(NamedTuple):
    """One drawn aircraft on the linear model."""

    field: FlyingPlace
    values: ParameterSet  # gains and lean
    kind: str
    seed: tuple[int, ...]


class LinearMargin(NamedTuple):
    """What it leaves there."""

    alpha: float  # disk margin of the worse break; 0: unstable
    duration_s: float = 0.0  # nothing is flown


def scored(flights: Sequence[DrawnFlight]) -> DispersedScore:
    """Count and measure; no flight is left out."""
    causes = Counter(flight.ended.split(" at x ")[0] for flight in flights if not flight.up)

    def rms(each: Iterable[float]) -> float:
        return sqrt(sum(value * value for value in each) / len(flights))

    return DispersedScore(
        flights=len(flights),
        up=sum(flight.up for flight in flights),
        rms_e_rho_m=rms(flight.rms_e_rho_m for flight in flights),
        rms_y_m=rms(flight.rms_y_m for flight in flights),
        rms_bank_rad=rms(flight.rms_bank_rad for flight in flights),
        causes=tuple(causes.most_common()),
    )


def margin_of(job: LinearJob) -> LinearMargin:
    """The disk margin of a drawn aircraft where it hovers, with what its file does not know."""
    drawn, place, on_line = soaring_aircraft(job.field, job.values, job.seed)
    values = values_of(on_line, drawn, job.kind, seeks=True)
    sensors = drawn.sensors if job.kind == INERTIAL else drawn.sensors._replace(imu=None)
    condition = Condition(
        model=drawn.true,
        servo=servo_params(drawn.known.model),
        speed_mps=place.wind_mps,
        lean_rad=radians(job.values["TGL_LEAN"]),
        sensors=sensors,
        command_delay_s=drawn.latency_s + job.field.unknown_late_s,
    )
    laws = laws_from(values, SoaringFrame(0.0, 0.0, 0.0, 0.0), drawn.known.aerodynamics())
    loop = close_loop(linear_plant(condition), linear_controller(laws, condition))
    return LinearMargin(disk_margin(loop, FREQUENCIES_RADPS))


def _fly(job: _Job) -> DrawnFlight:
    return fly_attempt(job.field, job.attempt)


def dispersed(context: Context) -> Result:
    """Drawn aircraft at each place: on the linear model, and in the air."""
    scenario = context.scenario("dispersed")
    base = prepare(scenario)
    places = list(scenario.lines)
    flown_each, looked_at = (2, 6) if context.quick else (AIRCRAFT, LINEAR)
    conditions = list(LEAST)[:1] if context.quick else list(LEAST)

    def field(place: str, later_s: float) -> FlyingPlace:
        return FlyingPlace(
            seeks=True,
            airframe=base.airframe,
            site_path=Path(scenario.site or ""),
            ranges=Ranges(),
            duration_s=scenario.duration_s,
            unknown_late_s=later_s,
            speed_ratio=scenario.lines[place].speed_ratio,
            roughest=max(turbulence for turbulence, _ in LEAST),
        )

    margins = {
        kind: context.flyer.each(
            margin_of,
            [
                LinearJob(field(places[i % len(places)], 0.0), base.values, kind, (SEED, 1, i))
                for i in range(looked_at)
            ],
        )
        for kind in SETS
    }
    cases = [
        DispersedCase(kind, turbulence, later_s, place)
        for kind in reversed(SETS)
        for turbulence, later_s in conditions
        for place in places
    ]
    jobs = [
        _Job(
            field(case.place, case.later_s),
            Attempt(base.values, case.kind, (SEED, i), case.turbulence),
        )
        for case in cases
        for i in range(flown_each)
    ]
    flown = context.flyer.each(_fly, jobs, compiled=True)
    scores = {
        case: scored(flown[i * flown_each : (i + 1) * flown_each]) for i, case in enumerate(cases)
    }
    return Result(
        name="dispersed",
        title=scenario.title,
        flown=_what(flown_each),
        claims=(
            *(_unstable(kind, [m.alpha for m in margins[kind]]) for kind in reversed(SETS)),
            *_claims(scores),
        ),
        why="",
        tables=(
            Table(
                "",
                (
                    "sensors", "turbulence", "later by [ms]", "place", "flown to the end",
                    "95 % interval", "rms e_rho [cm]", "rms y [cm]", "rms bank [°]", "lost by",
                ),
                tuple(_row(case, score) for case, score in scores.items()),
            ),
        ),
        numbers={", ".join(map(str, case)): score._asdict() for case, score in scores.items()},
        figures=(),
        scenarios=("dispersed",),
        seeds=(SEED,),
    )  # fmt: skip


def _what(flights: int) -> str:
    of = Ranges()
    return (
        f"{flights} aircraft at each place, each with its own file: short period"
        f" × {of.short_period[0]:.2f} to {of.short_period[1]:.2f}, lift, drag, inertia and the"
        f" elevator's effect × {of.lift[0]:g} to {of.lift[1]:g}, servo {1e3 * of.servo_s[0]:g} to"
        f" {1e3 * of.servo_s[1]:g} ms, latency {1e3 * of.latency_s[0]:g} to"
        f" {1e3 * of.latency_s[1]:g} ms; and what no file knows: the elevator's effect"
        f" × {of.unknown_effect[0]:g} to {of.unknown_effect[1]:g} once more, centre of gravity"
        f" ± {100 * of.centre_of_gravity[1]:g} % of the chord, attitude ± 2°. All evenly drawn. An"
        " aircraft is drawn again where its place is not one to soar at: its steady glide does not"
        " hold it on its line, two degrees clear of the stall, or four standard deviations of the"
        " dispersion along the line at 5 % lead to the ground or out of the fence."
    )


def _unstable(kind: str, alphas: Sequence[float]) -> Claim:
    unstable = sum(alpha <= 0.0 for alpha in alphas)
    least = sorted(alphas)[len(alphas) // 100]
    return Claim(
        f"no drawn aircraft is unstable where it hovers, by the linear model ({kind})",
        unstable == 0,
        f"{unstable} of {len(alphas)}; disk margin of the worst in a hundred {least:.2f}",
    )


def _claims(scores: dict[DispersedCase, DispersedScore]) -> list[Claim]:
    claims = []
    for kind, turbulence, later_s in dict.fromkeys(case[:3] for case in scores):
        here = {
            case.place: s for case, s in scores.items() if case[:3] == (kind, turbulence, later_s)
        }
        least = LEAST[turbulence, later_s]
        later = f", every command {1e3 * later_s:g} ms later than known," if later_s else ""
        claims.append(
            Claim(
                f"at {100 * turbulence:g} % of turbulence{later} {100 * least:g} % or more last at"
                f" each place ({kind})",
                all(s.up >= least * s.flights for s in here.values()),
                ", ".join(f"{s.up} of {s.flights} at {place}" for place, s in here.items()),
            )
        )
    return claims


def _row(case: DispersedCase, score: DispersedScore) -> tuple[Any, ...]:
    low, high = score.interval
    return (
        case.kind,
        f"{100 * case.turbulence:g} %",
        f"{1e3 * case.later_s:g}",
        case.place,
        f"{score.up} of {score.flights}",
        f"{100 * low:.0f} to {100 * high:.0f} %",
        f"{100 * score.rms_e_rho_m:.2f}",
        f"{100 * score.rms_y_m:.0f}",
        f"{degrees(score.rms_bank_rad):.1f}",
        ", ".join(f"{cause} {count}" for cause, count in score.causes) or "–",
    )
