"""`wind_estimate`: wind and updraft as read on board, against the air that was there.

Every flight is flown once; beside it several estimators look on, each with sensors of its own,
and with an error of the pitch of half a degree, up in odd seeds and down in even ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from math import degrees, hypot, nan, radians
from random import Random
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import WindField
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.random_aircraft import mismatched
from tgl_soar.analysis.experiments.result import ChangedThreshold, Claim, Result, Table
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import line_parameters, load_flight, shipped
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Site
from tgl_soar.control.laws import laws_from
from tgl_soar.control.supervisor import is_flying
from tgl_soar.estimation.wind import initial_wind, wind_step
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.sensors import AUTOPILOT_ATTITUDE, MEMS_IMU, PITOT, Sensors
from tgl_soar.sim.world import build_field, make_world
from tgl_soar.types import (
    NO_AIRSPEED,
    NO_ATTITUDE,
    NO_FIX,
    NO_IMU,
    NO_SURFACES,
    Aerodynamics,
    AutopilotStatus,
    Inputs,
    polar_sink,
)

TURBULENCE: Final = 0.03
PITCH_ERROR_RAD: Final = radians(0.5)
SETTLE_S: Final = 5.0  # until the line is captured; not scored
LEAST_S: Final = SETTLE_S + 1.0  # a flight that ends before is not scored at all
EARLY_MOST: Final = 0.1  # of all flights: where more end so, those that do not are the easy ones
FLIGHT_S: Final = 12.0
SEEDS: Final = tuple(range(1, 33))
TOUR_S: Final = 12.0  # on each line of the flight that is drawn

# Of the updraft's error: 0.6 of what gusts of 3 % are, 0.25 m/s; else their mean would do as well.
PITOT_RMS_MPS: Final = 0.15
PLAIN_RATIO: Final = 0.7  # half of its variance: less would not be worth an estimator
# How wrong a wing may be that was taken from geometry, ± 30 % by the airframe file, and put right
# by a few timed glides: not the estimator's own figures, and evenly spread where it takes a bell.
LIFT_WITHIN: Final = 0.10
DRAG_WITHIN: Final = 0.20
HONEST_MOST: Final = 2.0  # mean squared error over variance: σ is too small by 1.4
HONEST_LEAST: Final = 1.0 / 3.0  # σ is too large by 1.7
CHANGED: Final = (
    ChangedThreshold(
        "the wrong wing",
        "lift and drag drawn from the estimator's own prior (4 %, 10 %)",
        f"evenly within ± {100 * LIFT_WITHIN:g} % and ± {100 * DRAG_WITHIN:g} %",
        "a prior is no test of itself",
    ),
    ChangedThreshold(
        "the standard deviations are honest",
        "one claim: none too small, and none too large where the wing is wrong, too",
        "two: none too small, none too large, each of all estimators",
        "what is too large for the right wing is too large for whoever has it",
    ),
)

Floats = NDArray[np.float64]


class Case(NamedTuple):
    """An estimator that looks on."""

    imu: bool
    pitot: bool
    wing_is_wrong: bool = False


CASES: Final = {
    "accelerometers, pitot": Case(True, True),
    "accelerometers": Case(True, False),
    "pitot": Case(False, True),
    "neither": Case(False, False),
    "accelerometers, pitot; wing wrong": Case(True, True, True),
    "accelerometers; wing wrong": Case(True, False, True),
}
WITH_PITOT, WITHOUT, *_ = CASES


class WindFlight(NamedTuple):
    """What to fly: lines of the site one after the other, and whom to let look on."""

    lines: tuple[str, ...]
    seed: int
    leg_s: float
    cases: tuple[str, ...]
    dispersed: bool = False  # another aircraft than the file's, in other air than the site's


@dataclass(frozen=True)
class ObservedFlight:
    """One flight; arrays are (n,), or (n, 7) in the order of `AirEstimate`."""

    flight: WindFlight
    duration_s: float
    time_s: Floats
    x_m: Floats
    truth: Floats  # airspeed, alpha, wind, updraft, excess
    plain: Floats  # updraft: climb plus the polar's sink at the true airspeed
    read: dict[str, Floats]


class WindScore(NamedTuple):
    """Errors of one estimator, rms over all flights, and how they compare with its own sigma; NaN
    where there is no flight."""

    wind_mps: float
    updraft_mps: float
    excess_mps: float
    airspeed_mps: float
    alpha_deg: float
    wind_normalised: float  # mean of (error / sigma)²: 1 where sigma is honest
    updraft_normalised: float


def look_on(flight: WindFlight) -> ObservedFlight:
    """Fly one flight with all its estimators.  Errors: `ConfigError`."""
    known, site, values, field = _place()
    airframe = known
    values = values.changed(line_parameters(site.lines[flight.lines[0]]))
    sensors = Sensors(
        attitude=AUTOPILOT_ATTITUDE._replace(bias_rad=0.0), imu=MEMS_IMU, airspeed=PITOT
    )
    if flight.dispersed:
        airframe, site, field, sensors = mismatched(airframe, site, field, sensors, flight.seed)
    world = make_world(
        airframe,
        site,
        seed=flight.seed,
        turbulence=TURBULENCE,
        field=field,
        sensors=sensors,
        known=known,
    )
    loop = ClosedLoop(world, values)
    wind = laws_from(values, world.frame, world.aerodynamics).wind
    tilt = PITCH_ERROR_RAD if flight.seed % 2 else -PITCH_ERROR_RAD
    wrong = wind._replace(aerodynamics=wrong_wing(wind.aerodynamics, flight.seed))
    params = {name: wrong if CASES[name].wing_is_wrong else wind for name in flight.cases}
    states = {name: initial_wind() for name in flight.cases}
    read: dict[str, list[tuple[float, ...]]] = {name: [] for name in flight.cases}
    rows: list[tuple[float, ...]] = []
    elevator, leg = nan, 0
    for n in range(round(flight.leg_s * len(flight.lines) * world.step_hz)):
        if n >= (leg + 1) * flight.leg_s * world.step_hz:
            leg += 1
            loop.change(line_parameters(site.lines[flight.lines[leg]]))
        truth = world.truth
        now = world.time_s
        inputs = Inputs(
            time_s=now,
            position=NO_FIX,
            attitude=NO_ATTITUDE,
            autopilot=AutopilotStatus(time_s=now, accepts_surfaces=True, armed=True),
            engage=True,
            imu=world.imu,
            airspeed=world.airspeed,
            surfaces=NO_SURFACES,
        )
        output = loop.tick()
        vehicle = output.vehicle._replace(pitch_rad=output.vehicle.pitch_rad + tilt)
        velocity_sigma = output.quality.velocity_sigma_mps
        for name in flight.cases:
            case = CASES[name]
            measured = inputs._replace(
                imu=inputs.imu if case.imu else NO_IMU,
                airspeed=inputs.airspeed if case.pitot else NO_AIRSPEED,
            )
            states[name], air = wind_step(
                params[name], states[name], vehicle, measured, velocity_sigma, elevator, True
            )
            read[name].append(air[:7])
        elevator = output.command.elevator if output.active else nan
        flat = hypot(truth.wind_x_mps - truth.velocity_x_mps, truth.velocity_y_mps)
        sink = polar_sink(wind.aerodynamics.polar, flat)
        rows.append(
            (
                *(truth.time_s, truth.x_m, truth.airspeed_mps, truth.alpha_rad),
                *(truth.wind_x_mps, truth.updraft_mps, truth.updraft_mps - sink),
                output.vehicle.climb_mps + sink,
            )
        )
        if world.crashed or (n > world.step_hz and not is_flying(output.mode)):
            break
    table = np.array(rows)
    return ObservedFlight(
        flight=flight,
        duration_s=len(rows) / world.step_hz,
        time_s=table[:, 0],
        x_m=table[:, 1],
        truth=table[:, 2:7],
        plain=table[:, 7],
        read={name: np.array(values) for name, values in read.items()},
    )


def wrong_wing(aerodynamics: Aerodynamics, seed: int) -> Aerodynamics:
    """The wing as somebody has it who knows lift and drag no better than that."""
    uniform = Random(f"{seed}/wing").uniform
    lift = 1.0 + uniform(-LIFT_WITHIN, LIFT_WITHIN)
    drag = 1.0 + uniform(-DRAG_WITHIN, DRAG_WITHIN)
    return aerodynamics._replace(
        CL0=aerodynamics.CL0 * lift,
        CL_alpha=aerodynamics.CL_alpha * lift,
        CD0=aerodynamics.CD0 * drag,
        CD_lift=aerodynamics.CD_lift * drag / lift**2,
    )


@lru_cache(maxsize=1)
def _place() -> tuple[Airframe, Site, ParameterSet, WindField]:
    airframe_path, site_path = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
    airframe, site, values = load_flight(airframe_path, site_path)
    assert site.air is not None
    return airframe, site, values, build_field(site.air)


def score(flights: list[ObservedFlight], case: str) -> WindScore:
    """One estimator over several flights, from when the line was captured."""
    if not flights:
        return WindScore._make([nan] * len(WindScore._fields))
    errors, normalised = [], []
    for observed in flights:
        rows = observed.time_s >= SETTLE_S
        read, truth = observed.read[case][rows], observed.truth[rows]
        errors.append(read[:, :5] - truth)
        normalised.append((read[:, 2:4] - truth[:, 2:4]) / read[:, 5:7])
    speed, alpha, wind, updraft, excess = _rms(np.concatenate(errors)).tolist()
    n_wind, n_updraft = (_rms(np.concatenate(normalised)) ** 2).tolist()
    return WindScore(
        wind_mps=wind,
        updraft_mps=updraft,
        excess_mps=excess,
        airspeed_mps=speed,
        alpha_deg=degrees(alpha),
        wind_normalised=n_wind,
        updraft_normalised=n_updraft,
    )


def plain_rms(flights: list[ObservedFlight]) -> float:
    """rms error of the updraft [m/s] that climb and polar alone give; NaN of no flight."""
    if not flights:
        return nan
    errors = []
    for observed in flights:
        rows = observed.time_s >= SETTLE_S
        errors.append(observed.plain[rows] - observed.truth[rows, 3])
    return float(_rms(np.concatenate(errors)))


def _rms(values: Floats) -> Floats:
    """Down the columns; where the polar ends there is no sink, and no error."""
    return np.asarray(np.sqrt(np.nanmean(values**2, axis=0)))


def wind_estimate(context: Context) -> Result:
    """Three places, many seeds, and one flight across the plane to look at."""
    places = tuple(_place()[1].lines)
    seeds = SEEDS[:2] if context.quick else SEEDS
    apart = context.dispersion
    jobs = [
        WindFlight(lines=(p,), seed=s, leg_s=FLIGHT_S, cases=tuple(CASES), dispersed=apart)
        for p in places
        for s in seeds
    ]
    tour = WindFlight(
        lines=places, seed=1, leg_s=TOUR_S, cases=(WITH_PITOT, WITHOUT), dispersed=apart
    )
    *flights, across = context.flyer.each(look_on, [*jobs, tour])
    whole = [observed for observed in flights if observed.duration_s > LEAST_S]
    scores = {case: score(whole, case) for case in CASES}
    plain = plain_rms(whole)
    by_place = {
        place: [observed for observed in whole if observed.flight.lines == (place,)]
        for place in places
    }
    with_pitot, without = scores[WITH_PITOT], scores[WITHOUT]
    claims: tuple[Claim, ...] = (
        Claim(
            f"with a pitot tube the updraft is known to {PITOT_RMS_MPS:g} m/s rms",
            with_pitot.updraft_mps <= PITOT_RMS_MPS,
            f"{with_pitot.updraft_mps:.3f} m/s",
        ),
        Claim(
            f"without one to {PLAIN_RATIO:g} of the plain estimate's error",
            without.updraft_mps <= PLAIN_RATIO * plain,
            f"{without.updraft_mps:.3f} of {plain:.3f} m/s: {without.updraft_mps / plain:.2f}",
        ),
        honest_claim(scores),
        timid_claim(scores),
    )
    early = len(jobs) - len(whole)
    if early > EARLY_MOST * len(jobs):
        few = f"of {len(jobs)} flights {len(whole) or 'none'} lasted for {LEAST_S:g} s"
        claims = tuple(replace(claim, holds=False, measured=few) for claim in claims)
    return Result(
        name="wind_estimate",
        title="wind and updraft as read on board",
        flown=f"{len(jobs)} flights of {FLIGHT_S:g} s at {100 * TURBULENCE:g} % of turbulence on"
        f" the lines {', '.join(places)} of the tunnel, the first {SETTLE_S:g} s not scored. Beside"
        " each flight several estimators look on, with other sensors each, the pitch wrong by half"
        " a degree, up in odd seeds and down in even ones; accelerometers of 0.1 m/s² bias and"
        " noise, a pitot tube of 1 Pa of bias. In the last two rows the wing is not the one they"
        f" know: its lift by up to {100 * LIFT_WITHIN:g} %, its drag by up to"
        f" {100 * DRAG_WITHIN:g} %. The plain estimate is the climb plus the polar's sink at the"
        " true airspeed, which it is given."
        + (f" {early} ended within {LEAST_S:g} s: no figure has them." if early else ""),
        claims=claims,
        why="Without a pitot tube airspeed follows from the direction of the force and the"
        " elevator's"
        " trim. The updraft suffers less than the airspeed, because what the pitch is wrong by the"
        " angle of attack is wrong by too. Without accelerometers turbulence is seen only when it"
        " has moved the aircraft.",
        tables=_tables(scores, by_place, plain),
        numbers={"cases": {case: s._asdict() for case, s in scores.items()}, "plain_mps": plain},
        figures=_draw(context, across),
        scenarios=(),
        seeds=seeds,
        changed=CHANGED,
    )


def honest_claim(scores: dict[str, WindScore]) -> Claim:
    """Of the standard deviations that the estimator reports, that none is too small."""
    return Claim(
        "no standard deviation is too small: no squared error is over twice its variance in the"
        " mean",
        all(n <= HONEST_MOST for s in scores.values() for n in _normalised(s)),
        _normalised_words(scores),
    )


def timid_claim(scores: dict[str, WindScore]) -> Claim:
    """That none is too large; keys are of `CASES`."""
    timid = [case for case, s in scores.items() if min(_normalised(s)) < HONEST_LEAST]
    spared = [case for case in timid if not CASES[case].wing_is_wrong]
    return Claim(
        "no standard deviation is too large: no squared error is less than a third of its variance"
        " in the mean",
        # As it is asked of the other claim: of NaN, which is of no flight, it does not hold.
        all(n >= HONEST_LEAST for s in scores.values() for n in _normalised(s)),
        _normalised_words(scores)
        + (
            f"; {len(spared)} of the {len(timid)} that are have the wing that the estimator knows,"
            " and it allows for one that is wrong"
            if spared
            else ""
        ),
    )


def _normalised(s: WindScore) -> tuple[float, float]:
    return s.wind_normalised, s.updraft_normalised


def _normalised_words(scores: dict[str, WindScore]) -> str:
    return (
        "wind "
        + ", ".join(f"{s.wind_normalised:.2f}" for s in scores.values())
        + "; updraft "
        + ", ".join(f"{s.updraft_normalised:.2f}" for s in scores.values())
    )


def _tables(
    scores: dict[str, WindScore], by_place: dict[str, list[ObservedFlight]], plain: float
) -> tuple[Table, ...]:
    return (
        Table(
            "rms errors",
            (
                "sensors", "wind [m/s]", "updraft [m/s]", "of plain", "excess updraft [m/s]",
                "airspeed [m/s]", "angle of attack [°]", "(wind error / σ)²",
                "(updraft error / σ)²",
            ),
            (
                *(_row(case, scores[case], plain) for case in CASES),
                ("plain", "", f"{plain:.3f}", "1.00", "", "given", "", "", ""),
            ),
        ),
        Table(
            "rms error of the updraft by place [m/s]",
            ("place", "accelerometers, pitot", "accelerometers", "plain"),
            tuple(
                (
                    place,
                    f"{score(of_place, WITH_PITOT).updraft_mps:.3f}",
                    f"{score(of_place, WITHOUT).updraft_mps:.3f}",
                    f"{plain_rms(of_place):.3f}",
                )
                for place, of_place in by_place.items()
            ),
        ),
    )  # fmt: skip


def _row(case: str, s: WindScore, plain: float) -> tuple[str, ...]:
    return (
        case,
        f"{s.wind_mps:.3f}",
        f"{s.updraft_mps:.3f}",
        f"{s.updraft_mps / plain:.2f}",
        f"{s.excess_mps:.3f}",
        f"{s.airspeed_mps:.3f}",
        f"{s.alpha_deg:.2f}",
        f"{s.wind_normalised:.2f}",
        f"{s.updraft_normalised:.2f}",
    )


def _draw(context: Context, across: ObservedFlight) -> tuple[str, ...]:
    path = context.figure("wind_estimate")
    if path is None:
        return ()
    from tgl_soar.analysis.report.curves_figure import CurvePanel, DrawnCurve, curves_figure
    from tgl_soar.analysis.report.figure_style import PALETTE

    keep = slice(200, None, 10)
    time, x = across.time_s[keep], across.x_m[keep]

    def panel(title: str, label: str, column: int, along: Floats, axis: str) -> CurvePanel:
        series = [
            DrawnCurve(
                along.tolist(),
                across.read[case][keep, column].tolist(),
                case,
                PALETTE[i],
                width=1.0,
                style="-" if axis.startswith("time") else "",
                marker="" if axis.startswith("time") else ".",
            )
            for i, case in enumerate(across.flight.cases)
        ]
        truth = DrawnCurve(
            along.tolist(),
            across.truth[keep, column].tolist(),
            "truth",
            "black",
            width=1.3,
            style="-" if axis.startswith("time") else "",
            marker="" if axis.startswith("time") else ".",
        )
        return CurvePanel(title, axis, label, [*series[::-1], truth])

    curves_figure(
        path,
        [
            panel("updraft in time", "updraft [m/s]", 3, time, "time [s]"),
            panel("horizontal wind in time", "wind [m/s]", 2, time, "time [s]"),
            panel("updraft across the plane", "updraft [m/s]", 3, x, "x, downstream [m]"),
        ],
        f"one flight along the lines {', '.join(across.flight.lines)} at"
        f" {100 * TURBULENCE:g} % of turbulence, the pitch wrong by half a degree",
    )
    return (path.name,)
