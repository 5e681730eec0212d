"""`estimator`: what accelerometers are worth to the estimate, and the estimate to the flight."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees
from typing import Any, Final, NamedTuple

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.estimates.estimator_flights import (
    ASKED,
    CALM,
    CHAIN,
    FLIGHT_S,
    GAP_EVERY_S,
    GAP_S,
    IMU,
    LAB,
    ONE_GAP_S,
    PLAIN,
    SETTLE_S,
    TRACKED_ATTITUDE,
    TURBULENCE,
    EstimatorFlight,
    EstimatorScore,
    Known,
    Ratios,
    Scored,
    WatchedFlight,
    fly_each,
    fly_named,
    gains_exchanged,
    known,
    margins_with,
    paired_difference,
    paired_ratios,
    places,
    score,
    watch,
)
from tgl_soar.analysis.experiments.result import ChangedThreshold, Claim, Result, Table
from tgl_soar.analysis.margins import MarginCase
from tgl_soar.sim.sensors import AUTOPILOT_POSITION, MEMS_IMU, AttitudeParams, Sensors

ROUGH: Final = 0.05
SEEDS: Final = tuple(range(1, 33))
ROUGH_SEEDS: Final = tuple(range(1, 136))
ROUGH_S: Final = 60.0  # a minute is what an operator waits for at least
FEW: Final = 8  # seeds, of what is only compared
WATCHED: Final = 3
WATCHED_S: Final = 20.0
LATENCIES_S: Final = (0.0, 0.04, 0.08, 0.12)
MARGIN: Final = (0.5, 1.8)  # factors of gain: 6 dB less and 5 dB more, where 4.4 is asked of loops
GAPS_S: Final = 21.0

RATIO: Final = 0.6  # of sensor and gains together: less would not be worth another sensor
ACTIVITY: Final = 1.5  # twice the servo's wear is no trade; the gains may cost half of that
# What 120 ms may take of that gain.  Over so long an attitude that is wrong by 1 degree, 0.17 m/s²,
# adds 1.2 mm to what is reckoned, and a velocity that is wrong by 2 cm/s 2.4 mm: 2.7 mm together,
# beside an rms e_rho of 4 to 5 mm.
LATENCY_COST: Final = 1.2
TRACKED_LATE_S: Final = (TRACKED_ATTITUDE.delay_s, 0.035)  # beyond 0.05 s a pose is not used
# 10 ms more than the autopilot's attitude are 7 degrees of the short period's phase (12 rad/s), of
# a margin of some 40: what that may cost.
TRACKED_COST: Final = 1.2
SAME_GAINS: Final = "accelerations, the plain law's gains"
PLAIN_FASTER: Final = "plain, the gains of accelerations"
AT: Final = MarginCase(speed_mps=8.5, lean_deg=15.0, delay_s=0.0075, inertial=False)
EQUAL_MARGIN: Final = 0.05  # of a disk margin, which is shown with two digits
CHANGED: Final = (
    ChangedThreshold(
        "survivors at 5 %",
        "30 s, all places together",
        f"{ROUGH_S:g} s at the slowest place",
        "it is the nearest to the stall; faster places dilute what is lost there",
    ),
    ChangedThreshold(
        "EST_FIX_SD",
        "the noise of the fixes, where it is above the shipped value",
        "the shipped value",
        "nobody on board knows the true one",
    ),
)


class _Plan(NamedTuple):
    """What is flown, each list of flights under the name that it has in tables."""

    lines: tuple[str, ...]
    seeds: tuple[int, ...]
    watched: dict[str, list[EstimatorFlight]]
    through: EstimatorFlight  # a gap that is drawn
    corrupted: dict[str, list[EstimatorFlight]]
    scored: dict[str, list[EstimatorFlight]]


def _plan(quick: bool, dispersed: bool = False) -> _Plan:
    lines = places()[:1] if quick else places()
    seeds = SEEDS[:1] if quick else SEEDS
    few = seeds[:FEW]
    rough = ROUGH_SEEDS[:1] if quick else ROUGH_SEEDS
    slowest = lines[0]  # the most upstream, where the wind is least

    def all_of(seeds: Sequence[int], sensors: Sensors, **what: Any) -> list[EstimatorFlight]:
        return [
            EstimatorFlight(line=place, seed=seed, sensors=sensors, dispersed=dispersed, **what)
            for place in lines
            for seed in seeds
        ]

    def all_rough(sensors: Sensors) -> list[EstimatorFlight]:
        return [
            EstimatorFlight(
                line=slowest,
                seed=seed,
                sensors=sensors,
                turbulence=ROUGH,
                duration_s=ROUGH_S,
                dispersed=dispersed,
            )
            for seed in rough
        ]

    def gaps(seeds: Sequence[int], sensors: Sensors) -> list[EstimatorFlight]:
        return all_of(seeds, sensors, turbulence=CALM, duration_s=GAPS_S, reception="with gaps")

    return _Plan(
        lines=lines,
        seeds=seeds,
        watched={
            name: all_of(seeds[:WATCHED], asked.sensors, duration_s=WATCHED_S)
            for name, asked in ASKED.items()
        },
        through=EstimatorFlight(
            line=lines[0],
            seed=1,
            sensors=IMU,
            turbulence=CALM,
            duration_s=WATCHED_S,
            reception="with one gap",
            dispersed=dispersed,
        ),
        corrupted={
            "accelerations, gaps": gaps(seeds, IMU),
            "plain, gaps": gaps(few, PLAIN),
            "laboratory's chain": all_of(few, Sensors(position=LAB), reception="the laboratory's"),
            **{
                _tracked_name(late): all_of(few, PLAIN, tracked=_tracked(late))
                for late in TRACKED_LATE_S
            },
            f"accelerations, {_tracked_name(TRACKED_LATE_S[0])}": all_of(
                few, IMU, tracked=TRACKED_ATTITUDE
            ),
        },
        scored={
            "plain": all_of(seeds, PLAIN),
            "accelerations": all_of(seeds, IMU),
            SAME_GAINS: all_of(seeds, IMU, changes=gains_exchanged(True)),
            PLAIN_FASTER: all_of(seeds, PLAIN, changes=gains_exchanged(False)),
            "plain, rough": all_rough(PLAIN),
            "accelerations, rough": all_rough(IMU),
            "laboratory's fixes": all_of(few, Sensors(position=LAB)),
            "laboratory's fixes, accelerations": all_of(few, Sensors(position=LAB, imu=MEMS_IMU)),
            **{_late_name(late): all_of(few, _late(late)) for late in LATENCIES_S},
            **{f"plain, gains × {k:g}": all_of(few, PLAIN, scale=k) for k in MARGIN},
            **{f"accelerations, gains × {k:g}": all_of(few, IMU, scale=k) for k in MARGIN},
        },
    )


class _Survival(NamedTuple):
    """How many of the same rough flights were not lost, without and with accelerations."""

    pairs: int
    plain: int
    accelerations: int
    difference: float  # of the fractions
    interval: tuple[float, float]  # at 95 %


def _survival(plain: Sequence[Scored], accelerations: Sequence[Scored]) -> _Survival:
    survived = [(not p.ended, not a.ended) for p, a in zip(plain, accelerations, strict=True)]
    counts = [survived.count(pair) for pair in ((True, True), (True, False), (False, True))]
    both, first, second = counts
    return _Survival(
        pairs=len(survived),
        plain=both + first,
        accelerations=both + second,
        difference=(second - first) / len(survived),
        interval=paired_difference(both, first, second, len(survived) - sum(counts)),
    )


class _Outcome(NamedTuple):
    """What became of the flights; names as in the plan."""

    plan: _Plan
    scores: dict[str, EstimatorScore]
    of_plain: dict[str, Ratios]  # against the plain law in the same air
    knowledge: dict[tuple[str, bool], Known]  # fixes, and whether accelerations are used
    survival: _Survival
    latency_cost: float  # rms e_rho of the worst latency over that of none


def _outcome(
    plan: _Plan, watched_flights: dict[str, list[WatchedFlight]], flown: dict[str, list[Scored]]
) -> _Outcome:
    flights = {**plan.scored, **plan.corrupted}
    air = {
        (flight.line, flight.seed): result
        for flight, result in zip(plan.scored["plain"], flown["plain"], strict=True)
    }
    late = [flown[_late_name(late)] for late in LATENCIES_S]
    return _Outcome(
        plan=plan,
        scores={name: score(results) for name, results in flown.items()},
        of_plain={
            name: paired_ratios(flown[name], [air[flight.line, flight.seed] for flight in each])
            for name, each in flights.items()
            if each[0].turbulence == TURBULENCE
        },
        knowledge={
            (name, imu): known(watched_flights[name], imu)
            for name in ASKED
            for imu in (True, False)
        },
        survival=_survival(flown["plain, rough"], flown["accelerations, rough"]),
        latency_cost=max(paired_ratios(each, late[0]).e_rho for each in late),
    )


def estimator(context: Context) -> Result:
    """Ratios against the law without accelerations, errors, gaps, latency, the lab's chain."""
    plan = _plan(context.quick, context.dispersion)
    watched_flights = fly_each(context.flyer, watch, {**plan.watched, "through": [plan.through]})
    outcome = _outcome(plan, watched_flights, fly_named(context.flyer, plan.corrupted, plan.scored))
    survival = outcome.survival
    return Result(
        name="estimator",
        title="what accelerometers are worth to estimate and flight",
        flown=f"Flights of {FLIGHT_S:g} s on the lines {', '.join(plan.lines)} of the tunnel, the"
        f" first {SETTLE_S:g} s not scored, at {100 * TURBULENCE:g} % of turbulence where nothing"
        " else is said. Both laws have the autopilot's position (50 Hz, 40 ms late, 2 mm) and"
        " attitude; the"
        " plain one flies with its gains and without accelerometers, the other with accelerometers"
        " of 200 Hz (0.1 m/s² of bias and noise) and the gains that belong to them. Every pair has"
        " the same air and the same noise, and every ratio is one of such pairs. Elevator activity"
        " is the rms of its rate of change.",
        claims=_claims(outcome),
        why=split_words(outcome.of_plain) + margin_words(least_margins(), outcome.of_plain),
        tables=_tables(outcome),
        numbers={
            "scores": {name: s._asdict() for name, s in outcome.scores.items()},
            "of plain": {name: r._asdict() for name, r in outcome.of_plain.items()},
            "known": {
                f"{name}, {imu}": k._asdict() for (name, imu), k in outcome.knowledge.items()
            },
            "survival": {"difference": survival.difference, "interval": survival.interval},
        },
        figures=_draw(context, watched_flights["through"][0]),
        scenarios=(),
        seeds=plan.seeds,
        changed=CHANGED,
    )


def split_words(of_plain: dict[str, Ratios]) -> str:
    """What of the gain is the sensor's and what the gains' that it allows."""
    reported = "; ".join(
        f"{what} {of_plain[name].e_rho:.2f} of the plain law's rms e_rho{of_plain[name].words}, for"
        f" {of_plain[name].activity:.2f} of its elevator activity"
        for what, name in (
            ("the sensor alone, with the plain law's gains,", SAME_GAINS),
            ("the gains alone, without the sensor,", PLAIN_FASTER),
            ("both", "accelerations"),
        )
    )
    return f"What accelerometers are worth, split: {reported}."


def least_margins() -> dict[str, float]:
    """The least disk margin of the pitch loops of each law, by the linear model at AT."""
    laws = {
        "plain": (False, ()),
        "accelerations": (True, ()),
        SAME_GAINS: (True, gains_exchanged(True)),
        PLAIN_FASTER: (False, gains_exchanged(False)),
    }
    least = {}
    for name, (inertial, changes) in laws.items():
        (found,) = margins_with(AT._replace(inertial=inertial), changes)
        least[name] = min(found.elevator.alpha, found.line.alpha)
    return least


def margin_words(least: dict[str, float], of_plain: dict[str, Ratios]) -> str:
    """Which of the comparisons is one of laws with the same margin."""
    reported = ", ".join(
        f"{what} {least[name]:.2f}"
        for what, name in (
            ("the plain law", "plain"),
            ("the sensor alone", SAME_GAINS),
            ("the gains alone", PLAIN_FASTER),
            ("both", "accelerations"),
        )
    )
    equal = abs(least["accelerations"] - least["plain"]) <= EQUAL_MARGIN
    return (
        f" The least disk margin of the pitch loops at {AT.speed_mps:g} m/s, {AT.lean_deg:g}° and"
        f" {1e3 * AT.delay_s:g} ms, by the linear model: {reported}."
        + (
            " So at equal margin the accelerometers are worth what both are:"
            f" {of_plain['accelerations'].e_rho:.2f}."
            if equal
            else " None of them has the margin of the plain law: at equal margin nothing was flown."
        )
    )


def margin_claim(scores: dict[str, EstimatorScore]) -> Claim:
    """Neither law is lost with half its outer gains or nearly twice as much."""
    names = [f"{law}, gains × {k:g}" for law in ("plain", "accelerations") for k in MARGIN]
    lost = sum(scores[name].lost for name in names)
    return Claim(
        "neither law is lost with its outer loop's gains at"
        f" {' or '.join(f'{k:g} ×' for k in MARGIN)}",
        lost == 0,
        f"{lost} of {sum(scores[name].flights for name in names)} flights",
    )


def tracked_claim(scores: dict[str, EstimatorScore], of_plain: dict[str, Ratios]) -> Claim:
    """A tracker's attitude flies nearly as well as the autopilot's."""
    name = _tracked_name(TRACKED_LATE_S[0])
    s, ratio = scores[name], of_plain[name].e_rho
    return Claim(
        f"{name}, in place of the autopilot's, costs at most"
        f" {100 * (TRACKED_COST - 1):.0f} % of rms e_rho",
        ratio <= TRACKED_COST and s.lost == 0,
        f"rms e_rho {1e3 * s.e_rho_m:.1f} mm, {ratio:.2f} of the plain law's"
        f"{of_plain[name].words}; {s.lost} of {s.flights} lost",
    )


def _claims(outcome: _Outcome) -> tuple[Claim, ...]:
    plan, scores, of_plain, knowledge, survival, cost = outcome
    plain, imu = scores["plain"], scores["accelerations"]
    both = of_plain["accelerations"]
    ratio, activity = both.e_rho, both.activity
    lost = f"; {imu.lost} of {imu.flights} lost, {plain.lost} of {plain.flights} without"
    late = [_late_name(late) for late in LATENCIES_S]
    gaps, lab = scores["accelerations, gaps"], scores["laboratory's chain"]
    of_lab = of_plain["laboratory's chain"]
    percent = f"{100 * TURBULENCE:g} %"
    low, high = survival.interval
    return (
        Claim(
            f"with accelerations rms e_rho at {percent} is at most {RATIO:g} of what it is"
            f" without, {len(plan.scored['plain'])} flights each, none lost",
            ratio <= RATIO and not plain.lost and not imu.lost,
            f"{1e3 * imu.e_rho_m:.1f} of {1e3 * plain.e_rho_m:.1f} mm: {ratio:.2f}{both.words}"
            f"{lost if imu.lost or plain.lost else ''}",
        ),
        Claim(
            f"for an elevator activity of at most {ACTIVITY:g} times",
            activity <= ACTIVITY,
            f"{activity:.2f}{both.words}",
        ),
        margin_claim(scores),
        Claim(
            f"as many survive {ROUGH_S:g} s at {100 * ROUGH:g} % at the slowest place, of"
            f" {survival.pairs} pairs of flights",
            survival.accelerations >= survival.plain,
            f"{survival.accelerations} against {survival.plain}; difference"
            f" {100 * survival.difference:+.2f} % (95 %: {100 * low:+.2f} to"
            f" {100 * high:+.2f} %, Newcombe's interval for pairs)",
        ),
        Claim(
            f"position up to {1e3 * LATENCIES_S[-1]:g} ms late costs at most"
            f" {100 * (LATENCY_COST - 1):.0f} % of rms e_rho",
            cost <= LATENCY_COST and not any(scores[name].lost for name in late),
            f"{100 * (cost - 1):.0f} %; {sum(scores[name].lost for name in late)} of"
            f" {sum(scores[name].flights for name in late)} flights lost",
        ),
        Claim(
            f"no flight is lost to gaps of {GAP_S:g} s every {GAP_EVERY_S:g} s at {100 * CALM:g} %",
            gaps.lost == 0,
            f"{gaps.lost} of {gaps.flights}; without accelerations"
            f" {scores['plain, gaps'].lost} of {scores['plain, gaps'].flights}",
        ),
        *(
            Claim(
                f"position is known to {asked.position_mm:g} mm and velocity to"
                f" {asked.velocity_mmps / 10:g} cm/s rms with fixes of {name}",
                knowledge[name, True].position_mm <= asked.position_mm
                and knowledge[name, True].velocity_mmps <= asked.velocity_mmps,
                f"{knowledge[name, True].position_mm:.1f} mm,"
                f" {knowledge[name, True].velocity_mmps / 10:.1f} cm/s",
            )
            for name, asked in ASKED.items()
        ),
        Claim(
            "the paper's laboratory's chain flies: about 30 Hz, 60 ms late and stamped on"
            f" arrival, velocity from differences over {CHAIN} samples, no accelerometers",
            lab.lost == 0,
            f"{lab.lost} of {lab.flights} lost; rms e_rho {1e3 * lab.e_rho_m:.1f} mm,"
            f" {of_lab.e_rho:.2f} of the plain law's{of_lab.words}",
        ),
        tracked_claim(scores, of_plain),
    )


def _tables(outcome: _Outcome) -> tuple[Table, ...]:
    plan, scores, of_plain, knowledge, _, _ = outcome
    return (
        Table(
            "flights",
            (
                "flown", "turbulence", "flights", "lost", "rms e_rho [mm]", "of plain",
                "activity, of plain", "rms y [cm]", "rms bank [°]",
            ),
            tuple(
                _row(name, flights[0].turbulence, scores[name], of_plain.get(name))
                for name, flights in {**plan.scored, **plan.corrupted}.items()
            ),
        ),
        Table(
            "what the estimator knows, rms",
            (
                "fixes", "accelerometers", "position [mm]", "velocity [cm/s]",
                "(position error / σ)²", "(velocity error / σ)²",
            ),
            tuple(
                (
                    name,
                    "yes" if imu else "no",
                    f"{k.position_mm:.1f}",
                    f"{k.velocity_mmps / 10:.1f}",
                    f"{k.position_normalised:.2f}",
                    f"{k.velocity_normalised:.2f}",
                )
                for (name, imu), k in knowledge.items()
            ),
        ),
    )  # fmt: skip


def _tracked_name(delay_s: float) -> str:
    return f"OptiTrack's attitude, {1e3 * delay_s:g} ms late"


def _tracked(delay_s: float) -> AttitudeParams:
    return TRACKED_ATTITUDE._replace(delay_s=delay_s)


def _late_name(delay_s: float) -> str:
    return f"accelerations, position {1e3 * delay_s:g} ms late"


def _late(delay_s: float) -> Sensors:
    return Sensors(position=AUTOPILOT_POSITION._replace(delay_s=delay_s), imu=MEMS_IMU)


def _row(
    name: str, turbulence: float, s: EstimatorScore, of_plain: Ratios | None
) -> tuple[str, ...]:
    return (
        name,
        f"{100 * turbulence:g} %",
        f"{s.flights}",
        f"{s.lost}",
        f"{1e3 * s.e_rho_m:.1f}",
        *(
            ("", "")
            if of_plain is None
            else (f"{of_plain.e_rho:.2f}{of_plain.words}", f"{of_plain.activity:.2f}")
        ),
        f"{100 * s.y_m:.1f}",
        f"{degrees(s.bank_rad):.1f}",
    )


def _draw(context: Context, through: WatchedFlight) -> tuple[str, ...]:
    path = context.figure("estimator")
    if path is None:
        return ()
    from tgl_soar.analysis.report.curves_figure import CurvePanel, DrawnCurve, Mark, curves_figure
    from tgl_soar.analysis.report.figure_style import PALETTE

    rows = (through.time_s >= ONE_GAP_S - 0.5) & (through.time_s <= ONE_GAP_S + GAP_S + 0.7)
    time = through.time_s[rows].tolist()

    def panel(imu: bool, column: int, label: str, per: float) -> CurvePanel:
        read = per * through.read[imu][rows, column]
        band = 2.0 * per * through.read[imu][rows, 6 + column // 3]
        colour = PALETTE[1 if imu else 0]
        return CurvePanel(
            "with accelerations" if imu else "without",
            "time [s]",
            label,
            [
                DrawnCurve(
                    x=time,
                    y=(read + band).tolist(),
                    label="± 2 σ",
                    colour=colour,
                    style="--",
                    width=0.8,
                ),
                DrawnCurve(
                    x=time,
                    y=(read - band).tolist(),
                    label=None,
                    colour=colour,
                    style="--",
                    width=0.8,
                ),
                DrawnCurve(time, read.tolist(), "estimate", colour),
                DrawnCurve(time, (per * through.truth[rows, column]).tolist(), "truth", "black"),
            ],
            marks=[Mark(ONE_GAP_S, "the last fix"), Mark(ONE_GAP_S + GAP_S, "the next")],
            legend="upper left",
        )

    curves_figure(
        path,
        [
            panel(True, 2, "height [cm]", 100.0),
            panel(False, 2, "height [cm]", 100.0),
            panel(True, 5, "climb [m/s]", 1.0),
        ],
        f"{GAP_S:g} s without fixes at {100 * through.flight.turbulence:g} % of turbulence",
    )
    return (path.name,)
