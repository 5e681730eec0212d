"""`estimator`: what accelerometers are worth to the estimate, and the estimate to the flight.

Flights that need no more than a score are compiled where numba is installed; those that are
watched tick by tick, or whose fixes are spoilt on their way, are flown plain.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from math import nan, sqrt
from typing import Any, Final, Literal, NamedTuple, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import WindField
from tgl_soar.analysis.experiments.campaign import wilson
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import Flyer, Timed
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.autopilot import Output, reason_text
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import (
    line_parameters,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Site, Start
from tgl_soar.control.laws import laws_from
from tgl_soar.control.supervisor import FAILED, RELEASED
from tgl_soar.control.target_line import e_rho
from tgl_soar.estimation.motion import motion_quality, motion_step
from tgl_soar.estimation.motion_state import initial_motion
from tgl_soar.sim.closed_loop import ClosedLoop, Trajectory
from tgl_soar.sim.compiled import available
from tgl_soar.sim.fast_flight import Prepared, fly_compiled, prepare
from tgl_soar.sim.sensors import (
    AUTOPILOT_POSITION,
    MEMS_IMU,
    USUAL_SENSORS,
    ImuParams,
    PositionParams,
    Sensors,
)
from tgl_soar.sim.world import Truth, World, build_field, make_world
from tgl_soar.types import NO_FIX, AutopilotStatus, Inputs, PositionFix

TURBULENCE: Final = 0.03
ROUGH: Final = 0.05
CALM: Final = 0.01
FLIGHT_S: Final = 30.0
SETTLE_S: Final = 8.0  # until the line is captured and the bias known; not scored
SEEDS: Final = tuple(range(1, 33))
ROUGH_SEEDS: Final = tuple(range(1, 136))
FEW: Final = 8  # seeds, of what is only compared
COMPILED_FROM: Final = 200  # flights: compiling takes longer than fewer of them
WATCHED: Final = 3
WATCHED_S: Final = 20.0
START_M: Final = 0.3  # downstream of the line
LATENCIES_S: Final = (0.0, 0.04, 0.08, 0.12)
MARGIN: Final = (0.5, 1.8)
GAP_S: Final = 1.5
GAP_EVERY_S: Final = 6.0
GAPS_S: Final = 21.0
ONE_GAP_S: Final = 14.0
CHAIN: Final = 4  # samples from which the laboratory took a velocity

RATIO: Final = 0.6  # what is asked
ACTIVITY: Final = 1.5
LATENCY_COST: Final = 1.2

PLAIN: Final = USUAL_SENSORS
IMU: Final = Sensors(imu=MEMS_IMU)
# A rate must divide the 200 Hz of the simulation: 28.6 Hz stands for 30 Hz.
SLOW_HZ: Final = 200.0 / 7.0
LAB: Final = PositionParams(
    rate_hz=SLOW_HZ,
    delay_s=0.060,
    noise_m=0.001,
    bias_m=0.0,
    velocity_noise_mps=0.0,
    gives_velocity=False,
)
ASKED_IMU: Final = ImuParams(
    rate_hz=200.0,
    delay_s=0.0,
    force_noise_mps2=0.2,
    force_bias_mps2=0.05,
    rate_noise_radps=0.01,
    rate_bias_radps=0.002,
)


class Asked(NamedTuple):
    """A set of sensors, and how well position and velocity are to be known with it."""

    sensors: Sensors
    position_mm: float
    velocity_mmps: float


ASKED: Final = {
    "100 Hz, 15 ms, 1 mm": Asked(
        Sensors(
            position=PositionParams(
                rate_hz=100.0,
                delay_s=0.015,
                noise_m=0.001,
                bias_m=0.0,
                velocity_noise_mps=0.0,
                gives_velocity=False,
            ),
            imu=ASKED_IMU,
        ),
        3.0,
        30.0,
    ),
    "28.6 Hz, 60 ms, 5 mm": Asked(
        Sensors(
            position=PositionParams(
                rate_hz=SLOW_HZ,
                delay_s=0.060,
                noise_m=0.005,
                bias_m=0.0,
                velocity_noise_mps=0.0,
                gives_velocity=False,
            ),
            imu=ASKED_IMU,
        ),
        15.0,
        80.0,
    ),
}

Floats = NDArray[np.float64]
Flew = TypeVar("Flew", bound=Timed)
Reception = Literal["all", "with gaps", "with one gap", "the laboratory's"]


# --- flights that are scored --------------------------------------------------------------------


class Flight(NamedTuple):
    """What to fly."""

    line: str
    seed: int
    sensors: Sensors
    turbulence: float = TURBULENCE
    duration_s: float = FLIGHT_S
    scale: float = 1.0  # of the outer loop's gains
    reception: Reception = "all"
    changes: tuple[tuple[str, float], ...] = ()  # of parameters


class Scored(NamedTuple):
    """One flight; NaN where it ended before anything was scored."""

    duration_s: float
    ended: str
    e_rho_m2: float  # mean of the square
    activity_2ps2: float  # of the elevator's rate of change, full throws a second


def fly_scored(flight: Flight) -> Scored:
    """Fly one, plain.  Errors: `ConfigError`."""
    rows: list[tuple[float, ...]] = []
    ended = ""
    for now in _ticks(flight):
        truth, out = now.truth, now.output
        e = e_rho(out.line.x_m, out.line.z_m, out.line.eta_rad, truth.x_m, truth.z_m)
        moving = float(out.line.moving or not out.active)
        rows.append((truth.time_s, e, moving, out.command.elevator))
        ended = now.ended
    names = ("time_s", "e_rho_m", "line_moving", "elevator")
    columns = dict(zip(names, np.array(rows).T, strict=True))
    return _scored(Trajectory(columns, ended, len(rows)))


def fly_scored_compiled(flight: Flight) -> Scored:
    """The same where all fixes are heard, compiled."""
    prepared = _prepared(flight._replace(seed=1, scale=1.0, changes=()))
    return _scored(fly_compiled(prepared, flight.seed, _values(flight), ()))


def _scored(flown: Trajectory) -> Scored:
    time, elevator = flown["time_s"], flown["elevator"]
    rows = (time > SETTLE_S) & (flown["line_moving"] == 0.0)
    square = rate = nan
    if np.count_nonzero(rows) > 1:
        square = float(np.mean(flown["e_rho_m"][rows] ** 2))
        step = np.diff(elevator[rows]) / np.diff(time[rows])
        rate = float(np.mean(step**2))
    return Scored(float(time[-1]), flown.ended, square, rate)


class _Tick(NamedTuple):
    """One tick of a flight."""

    truth: Truth
    inputs: Inputs
    output: Output
    ended: str  # why the flight ended with it; ""


def _ticks(flight: Flight) -> Iterator[_Tick]:
    """The flight tick by tick, its fixes spoilt on their way.  Errors: `ConfigError`."""
    world = _world(flight)
    loop = ClosedLoop(world, _values(flight))
    differences = Differences()
    reception = world.position
    for _ in range(round(flight.duration_s * world.step_hz)):
        now, truth = world.time_s, world.truth
        if in_gap(flight.reception, now):
            world.position = reception
        elif flight.reception == "the laboratory's":
            world.position = differences.take(world.position, now)
        reception = world.position
        status = AutopilotStatus(time_s=now, accepts_surfaces=True, armed=True)
        sensors = world.imu, world.airspeed, world.surfaces
        inputs = Inputs(now, reception, world.attitude, status, True, *sensors)
        output = loop.tick()
        ended = world.crashed
        if not ended and output.mode in (RELEASED, FAILED):
            ended = f"let go: {reason_text(output.reason)}"
        yield _Tick(truth, inputs, output, ended)
        if ended:
            return


def in_gap(reception: Reception, time_s: float) -> bool:
    """Whether no fix arrives at this time."""
    since = time_s - GAP_EVERY_S
    if reception == "with one gap":
        return ONE_GAP_S <= time_s < ONE_GAP_S + GAP_S
    return reception == "with gaps" and since >= 0.0 and since % GAP_EVERY_S < GAP_S


class Differences:
    """What the paper's laboratory sent: velocity from differences, under the time of arrival."""

    def __init__(self) -> None:
        self._measured: deque[PositionFix] = deque([NO_FIX], maxlen=CHAIN)
        self._sent = NO_FIX

    def take(self, fix: PositionFix, now_s: float) -> PositionFix:
        """The newest that was sent."""
        if fix.sequence == self._measured[-1].sequence:
            return self._sent
        self._measured.append(fix)
        first = self._measured[0]
        interval = fix.time_s - first.time_s
        self._sent = fix._replace(
            time_s=now_s,
            velocity_north_mps=(fix.north_m - first.north_m) / interval,
            velocity_east_mps=(fix.east_m - first.east_m) / interval,
            velocity_down_mps=(fix.down_m - first.down_m) / interval,
        )
        return self._sent


@lru_cache(maxsize=1)
def _place() -> tuple[Site, ParameterSet, WindField]:
    airframe_path, site_path = shipped("airframes/eclipson_c.toml"), shipped("sites/tunnel.toml")
    airframe, site = _airframe(), load_site(site_path)
    values = load_parameters(airframe, airframe_path, site, site_path)
    assert site.air is not None
    return site, values, build_field(site.air)


def places() -> tuple[str, ...]:
    """The lines of the tunnel.  Errors: `ConfigError`."""
    return tuple(_place()[0].lines)


@lru_cache(maxsize=1)
def _airframe() -> Airframe:
    return load_airframe(shipped("airframes/eclipson_c.toml"))


def _world(flight: Flight) -> World:
    site, _, field = _place()
    line = site.lines[flight.line]
    start = Start(x_m=line.x_m + START_M, z_m=line.z_m)
    return make_world(
        _airframe(),
        msgspec.structs.replace(site, start=start),
        seed=flight.seed,
        turbulence=flight.turbulence,
        field=field,
        sensors=flight.sensors,
    )


@lru_cache(maxsize=64)
def _prepared(flight: Flight) -> Prepared:
    return prepare(_world(flight), flight.duration_s)


def _values(flight: Flight) -> ParameterSet:
    """The shipped parameters, of the noise that the fixes have, on the flight's line."""
    site, values, _ = _place()
    loop = ("RHO_P", "RHO_I", "RHO_D", "RHO_P_IMU", "RHO_I_IMU", "RHO_D_IMU")
    return values.changed(
        {
            **line_parameters(site.lines[flight.line]),
            **{name: flight.scale * values[name] for name in loop},
            "EST_FIX_SD": max(flight.sensors.position.noise_m, values["EST_FIX_SD"]),
            **dict(flight.changes),
        }
    )


class Score(NamedTuple):
    """Several flights of one kind, rms over all that was scored."""

    flights: int
    lost: int
    e_rho_m: float
    activity_ps: float


def score(flown: Sequence[Scored]) -> Score:
    """What became of them."""
    whole = [each for each in flown if each.e_rho_m2 == each.e_rho_m2]
    return Score(
        len(flown),
        sum(1 for each in flown if each.ended),
        sqrt(sum(each.e_rho_m2 for each in whole) / len(whole)) if whole else nan,
        sqrt(sum(each.activity_2ps2 for each in whole) / len(whole)) if whole else nan,
    )


class Ratios(NamedTuple):
    """How flights compare with others, rms over all that was scored of both."""

    e_rho: float
    activity: float


def paired_ratios(flown: Sequence[Scored], others: Sequence[Scored]) -> Ratios:
    """Of flights to others in the same air, one by one; a pair with one not scored is left out."""
    pairs = [
        (one, other)
        for one, other in zip(flown, others, strict=True)
        if one.e_rho_m2 == one.e_rho_m2 and other.e_rho_m2 == other.e_rho_m2
    ]
    one, other = score([one for one, _ in pairs]), score([other for _, other in pairs])
    return Ratios(one.e_rho_m / other.e_rho_m, one.activity_ps / other.activity_ps)


def paired_difference(both: int, first: int, second: int, neither: int) -> tuple[float, float]:
    """The difference of two shares of the same flights, second less first, at 95 %.

    Of so many flights both, only the first, only the second, or neither survived.
    Source: R. G. Newcombe, Improved confidence intervals for the difference between binomial
    proportions based on paired data, Statistics in Medicine 17 (1998), method 10.
    """
    n = both + first + second + neither
    was, now = both + first, both + second
    difference = (second - first) / n
    product = was * (n - was) * now * (n - now)
    odds = float(both * neither - first * second)
    if odds > 0.0:  # the continuity correction
        odds = max(odds - n / 2, 0.0)
    phi = odds / sqrt(product) if product else 0.0
    low_was, high_was = (abs(bound - was / n) for bound in wilson(was, n))
    low_now, high_now = (abs(bound - now / n) for bound in wilson(now, n))

    def reach(a: float, b: float) -> float:
        return sqrt(max(0.0, a * a - 2.0 * phi * a * b + b * b))

    return difference - reach(low_now, high_was), difference + reach(high_now, low_was)


# --- flights that are watched -------------------------------------------------------------------


@dataclass(frozen=True)
class Seen:
    """One flight with two estimators, from when all was settled."""

    flight: Flight
    duration_s: float
    ended: str
    time_s: Floats  # (n,)
    truth: Floats  # (n, 6): position [m] and velocity [m/s], soaring frame
    read: dict[bool, Floats]  # (n, 8): the same and two sigmas; with accelerations, without


def watch(flight: Flight) -> Seen:
    """Fly with accelerations; beside it an estimator looks on that has none of them."""
    site, _, _ = _place()
    airframe = _airframe()
    frame = site.frame()
    motion = laws_from(_values(flight), frame, airframe.aerodynamics()).motion
    gains = {imu: motion._replace(use_imu=imu) for imu in (True, False)}
    states = dict.fromkeys(gains, initial_motion())
    read: dict[bool, list[tuple[float, ...]]] = {True: [], False: []}
    truths: list[tuple[float, ...]] = []
    ended = ""
    for now in _ticks(flight):
        time_s = now.truth.time_s
        truths.append(now.truth[:7])
        for imu, before in states.items():
            states[imu], seen = motion_step(gains[imu], frame, before, now.inputs)
            quality = motion_quality(gains[imu], before, states[imu], time_s)
            read[imu].append((*seen[1:7], quality.position_sigma_m, quality.velocity_sigma_mps))
        ended = now.ended
    truth = np.array(truths)
    rows = truth[:, 0] > SETTLE_S
    return Seen(
        flight,
        float(truth[-1, 0]),
        ended,
        truth[rows, 0],
        truth[rows, 1:],
        {imu: np.array(values)[rows] for imu, values in read.items()},
    )


class Known(NamedTuple):
    """How well position and velocity were known: lengths of the error vectors, rms."""

    position_mm: float
    velocity_mmps: float
    position_normalised: float  # mean of (error / sigma)², each axis: 1 where sigma is honest
    velocity_normalised: float


def known(flights: Sequence[Seen], imu: bool) -> Known:
    """One of the two estimators over several flights."""
    error = np.concatenate([seen.read[imu][:, :6] - seen.truth for seen in flights])
    sigma = np.concatenate([seen.read[imu][:, 6:] for seen in flights])
    square = np.stack([np.sum(error[:, :3] ** 2, axis=1), np.sum(error[:, 3:] ** 2, axis=1)], 1)
    position, velocity = (1e3 * np.sqrt(np.mean(square, axis=0))).tolist()
    return Known(position, velocity, *np.mean(square / (3.0 * sigma**2), axis=0).tolist())


# --- the experiment -----------------------------------------------------------------------------


def estimator(context: Context) -> Result:
    """Ratios against the law without accelerations, errors, gaps, latency, the lab's chain."""
    lines = places()[:1] if context.quick else places()
    seeds = SEEDS[:1] if context.quick else SEEDS
    few = seeds[:FEW]
    rough = ROUGH_SEEDS[:1] if context.quick else ROUGH_SEEDS

    def all_of(seeds: Sequence[int], sensors: Sensors, **what: Any) -> list[Flight]:
        return [
            Flight(line=place, seed=seed, sensors=sensors, **what)
            for place in lines
            for seed in seeds
        ]

    watched = {
        name: all_of(seeds[:WATCHED], asked.sensors, duration_s=WATCHED_S)
        for name, asked in ASKED.items()
    }
    through = Flight(
        line=lines[0],
        seed=1,
        sensors=IMU,
        turbulence=CALM,
        duration_s=WATCHED_S,
        reception="with one gap",
    )
    corrupted = {
        "accelerations, gaps": all_of(
            seeds, IMU, turbulence=CALM, duration_s=GAPS_S, reception="with gaps"
        ),
        "plain, gaps": all_of(
            few, PLAIN, turbulence=CALM, duration_s=GAPS_S, reception="with gaps"
        ),
        "laboratory's chain": all_of(few, Sensors(position=LAB), reception="the laboratory's"),
    }
    scored = {
        "plain": all_of(seeds, PLAIN),
        "accelerations": all_of(seeds, IMU),
        "plain, rough": all_of(rough, PLAIN, turbulence=ROUGH),
        "accelerations, rough": all_of(rough, IMU, turbulence=ROUGH),
        "laboratory's fixes": all_of(few, Sensors(position=LAB)),
        "laboratory's fixes, accelerations": all_of(few, Sensors(position=LAB, imu=MEMS_IMU)),
        **{
            f"accelerations, position {1e3 * late:g} ms late": all_of(few, _late(late))
            for late in LATENCIES_S
        },
        **{f"plain, gains × {k:g}": all_of(few, PLAIN, scale=k) for k in MARGIN},
        **{f"accelerations, gains × {k:g}": all_of(few, IMU, scale=k) for k in MARGIN},
    }
    seen = _each(context.flyer, watch, {**watched, "through": [through]})
    flown = fly_named(context.flyer, corrupted, scored)
    scores = {name: score(flights) for name, flights in flown.items()}
    air = {
        (flight.line, flight.seed): result
        for flight, result in zip(scored["plain"], flown["plain"], strict=True)
    }
    of_plain = {
        name: paired_ratios(flown[name], [air[flight.line, flight.seed] for flight in flights])
        for name, flights in {**scored, **corrupted}.items()
        if flights[0].turbulence == TURBULENCE
    }
    knowledge = {(name, imu): known(seen[name], imu) for name in ASKED for imu in (True, False)}
    survived = [
        (not plain.ended, not imu.ended)
        for plain, imu in zip(flown["plain, rough"], flown["accelerations, rough"], strict=True)
    ]
    counts = [survived.count(pair) for pair in ((True, True), (True, False), (False, True))]
    both, first, second = counts
    low, high = paired_difference(both, first, second, len(survived) - sum(counts))

    plain, imu = scores["plain"], scores["accelerations"]
    ratio, activity = of_plain["accelerations"]
    late = [f"accelerations, position {1e3 * late:g} ms late" for late in LATENCIES_S]
    cost = max(paired_ratios(flown[name], flown[late[0]]).e_rho for name in late)
    margins = [f"{law}, gains × {k:g}" for law in ("plain", "accelerations") for k in MARGIN]
    gaps, lab = scores["accelerations, gaps"], scores["laboratory's chain"]
    lab_ratio = of_plain["laboratory's chain"].e_rho
    percent = f"{100 * TURBULENCE:g} %"
    return Result(
        "estimator",
        "what accelerometers are worth to estimate and flight",
        f"Flights of {FLIGHT_S:g} s on the lines {', '.join(lines)} of the tunnel, the first"
        f" {SETTLE_S:g} s not scored, at {percent} of turbulence where nothing else is said. Both"
        " laws have the autopilot's position (50 Hz, 40 ms late, 2 mm) and attitude; the plain one"
        " flies with its gains and without accelerometers, the other with accelerometers of 200 Hz"
        " (0.1 m/s² of bias and noise) and the gains that belong to them. Every pair has the same"
        " air and the same noise, and every ratio is one of such pairs. Elevator activity is the"
        " rms of its rate of change.",
        (
            Claim(
                f"with accelerations rms e_rho at {percent} is at most {RATIO:g} of what it is"
                f" without, {len(scored['plain'])} flights each",
                ratio <= RATIO and not plain.lost and not imu.lost,
                f"{1e3 * imu.e_rho_m:.1f} of {1e3 * plain.e_rho_m:.1f} mm: {ratio:.2f}",
            ),
            Claim(
                f"for an elevator activity of at most {ACTIVITY:g} times",
                activity <= ACTIVITY,
                f"{activity:.2f}",
            ),
            Claim(
                "neither law is lost with its outer loop's gains at"
                f" {' or '.join(f'{k:g} ×' for k in MARGIN)}",
                not any(scores[name].lost for name in margins),
                f"{sum(scores[name].lost for name in margins)} of"
                f" {sum(scores[name].flights for name in margins)} flights",
            ),
            Claim(
                f"as many survive at {100 * ROUGH:g} %, of {len(survived)} pairs of flights",
                second >= first,
                f"{both + second} against {both + first}; difference"
                f" {100 * (second - first) / len(survived):+.2f} % (95 %: {100 * low:+.2f} to"
                f" {100 * high:+.2f} %, Newcombe's interval for pairs)",
            ),
            Claim(
                f"position up to {1e3 * LATENCIES_S[-1]:g} ms late costs at most"
                f" {100 * (LATENCY_COST - 1):.0f} % of rms e_rho",
                cost <= LATENCY_COST and not any(scores[name].lost for name in late),
                f"{100 * (cost - 1):.0f} %",
            ),
            Claim(
                f"no flight is lost to gaps of {GAP_S:g} s every {GAP_EVERY_S:g} s at"
                f" {100 * CALM:g} %",
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
                f" {lab_ratio:.2f} of the plain law's",
            ),
        ),
        "",
        (
            Table(
                "flights",
                (
                    "flown", "turbulence", "flights", "lost", "rms e_rho [mm]", "of plain",
                    "activity, of plain",
                ),
                tuple(
                    _row(name, flights[0].turbulence, scores[name], of_plain.get(name))
                    for name, flights in {**scored, **corrupted}.items()
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
        ),
        {
            "scores": {name: s._asdict() for name, s in scores.items()},
            "of plain": {name: r._asdict() for name, r in of_plain.items()},
            "known": {f"{name}, {imu}": k._asdict() for (name, imu), k in knowledge.items()},
            "survival": {"difference": (second - first) / len(survived), "interval": (low, high)},
        },
        _draw(context, seen["through"][0]),
        (),
        seeds,
    )  # fmt: skip


def _late(delay_s: float) -> Sensors:
    return Sensors(position=AUTOPILOT_POSITION._replace(delay_s=delay_s), imu=MEMS_IMU)


def _each(
    flyer: Flyer, fly: Callable[[Flight], Flew], jobs: dict[str, list[Flight]]
) -> dict[str, list[Flew]]:
    return _named(
        jobs, flyer.each(fly, [flight for flights in jobs.values() for flight in flights])
    )


def _named(jobs: dict[str, list[Flight]], flown: list[Flew]) -> dict[str, list[Flew]]:
    left = iter(flown)
    return {name: [next(left) for _ in flights] for name, flights in jobs.items()}


def fly_named(
    flyer: Flyer, corrupted: dict[str, list[Flight]], scored: dict[str, list[Flight]]
) -> dict[str, list[Scored]]:
    """All of them, compiled where that is possible and worth its time; `corrupted` never is."""
    simple = [flight for flights in scored.values() for flight in flights]
    if len(simple) < COMPILED_FROM or not available():
        return _each(flyer, fly_scored, {**corrupted, **scored})
    # The flyer's processes have been started by now: none is split off from a running compiler.
    with ThreadPoolExecutor(1) as aside:
        first = aside.submit(fly_scored_compiled, simple[0])
        flown = _each(flyer, fly_scored, corrupted)
        first.result()
    return {**_named(scored, flyer.each(fly_scored_compiled, simple, compiled=True)), **flown}


def _row(name: str, turbulence: float, s: Score, of_plain: Ratios | None) -> tuple[str, ...]:
    return (
        name,
        f"{100 * turbulence:g} %",
        f"{s.flights}",
        f"{s.lost}",
        f"{1e3 * s.e_rho_m:.1f}",
        *(("", "") if of_plain is None else (f"{ratio:.2f}" for ratio in of_plain)),
    )


def _draw(context: Context, through: Seen) -> tuple[str, ...]:
    path = context.figure("estimator")
    if path is None:
        return ()
    from tgl_soar.analysis.report.curves_figure import CurvePanel, Mark, Series, curves_figure
    from tgl_soar.analysis.report.style import LEG_COLOURS

    rows = (through.time_s >= ONE_GAP_S - 0.5) & (through.time_s <= ONE_GAP_S + GAP_S + 0.7)
    time = through.time_s[rows].tolist()

    def panel(imu: bool, column: int, label: str, per: float) -> CurvePanel:
        read = per * through.read[imu][rows, column]
        band = 2.0 * per * through.read[imu][rows, 6 + column // 3]
        colour = LEG_COLOURS[1 if imu else 0]
        return CurvePanel(
            "with accelerations" if imu else "without",
            "time [s]",
            label,
            [
                Series(time, (read + band).tolist(), "± 2 σ", colour, "--", width=0.8),
                Series(time, (read - band).tolist(), None, colour, "--", width=0.8),
                Series(time, read.tolist(), "estimate", colour),
                Series(time, (per * through.truth[rows, column]).tolist(), "truth", "black"),
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
