"""The flights of the experiment `estimator`, and how they are scored and compared.

Flights that need no more than a score are compiled where numba is installed; those that are
watched tick by tick, or whose fixes are corrupted on their way, are flown plain.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import nan, sqrt
from typing import Final, Literal, NamedTuple, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.field import WindField
from tgl_soar.analysis.campaigns.drawn_faults import wilson
from tgl_soar.analysis.experiments.flights import LINE_GAINS, Flyer, Timed
from tgl_soar.analysis.experiments.random_aircraft import mismatched
from tgl_soar.analysis.linear_plant import Gusts
from tgl_soar.analysis.margins import CaseMargins, MarginCase, case_margins
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
from tgl_soar.link.tracked_attitude import TrackedAttitude
from tgl_soar.sim.closed_loop import ClosedLoop, Trajectory
from tgl_soar.sim.compiled import available
from tgl_soar.sim.compiled_flight import Prepared, fly_compiled, prepare
from tgl_soar.sim.motive import ARM_M, MADE_RAD
from tgl_soar.sim.sensor_sampling import flown_sensors, sense_attitude
from tgl_soar.sim.sensors import (
    MEMS_IMU,
    MOTION_CAPTURE,
    USUAL_SENSORS,
    AttitudeParams,
    ImuParams,
    PositionParams,
    Sensors,
)
from tgl_soar.sim.white_noise import drawn_as_needed
from tgl_soar.sim.world import Truth, World, build_field, make_world
from tgl_soar.types import NO_FIX, AttitudeSample, AutopilotStatus, Inputs, PositionFix

TURBULENCE: Final = 0.03
CALM: Final = 0.01
FLIGHT_S: Final = 30.0
SETTLE_S: Final = 8.0  # until the line is captured and the bias known; not scored
COMPILED_FROM: Final = 200  # flights: compiling takes longer than fewer of them
START_M: Final = 0.3  # downstream of the line
GAP_S: Final = 1.5
GAP_EVERY_S: Final = 6.0
ONE_GAP_S: Final = 14.0
CHAIN: Final = 4  # samples from which the laboratory took a velocity


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
# A body in the cameras' eyes: markers of MOTION_CAPTURE's noise, 0.2 m from their middle; the body
# made level by hand to 0.3 degrees, as well as an autopilot is levelled. Its rates are not used.
TRACKED_ATTITUDE: Final = AttitudeParams(
    rate_hz=MOTION_CAPTURE.rate_hz,
    delay_s=MOTION_CAPTURE.delay_s,
    noise_rad=MOTION_CAPTURE.noise_m / ARM_M,
    bias_rad=MADE_RAD,
    rate_noise_radps=0.0,
    rate_bias_radps=0.0,
)
_OTHER_NOISE: Final = 10_000  # added to the seed: two attitudes do not share their noise
ASKED_IMU: Final = ImuParams(
    rate_hz=200.0,
    delay_s=0.0,
    force_noise_mps2=0.2,
    force_bias_mps2=0.05,
    rate_noise_radps=0.01,
    rate_bias_radps=0.002,
)


class Asked(NamedTuple):
    """A set of sensors, and how well position and velocity are to be known with it: within a tenth
    of the 3 cm within which a line is held where fixes are good, half of them where they are poor,
    and a velocity that makes no more of it while the loop answers, a tenth of a second and more."""

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


class EstimatorFlight(NamedTuple):
    """What to fly."""

    line: str
    seed: int
    sensors: Sensors
    turbulence: float = TURBULENCE
    duration_s: float = FLIGHT_S
    scale: float = 1.0  # of the outer loop's gains
    reception: Reception = "all"
    changes: tuple[tuple[str, float], ...] = ()  # of parameters
    tracked: AttitudeParams | None = None  # a tracker's attitude, flown with as `[mocap]` has it
    dispersed: bool = False  # another aircraft than the file's, in other air than the site's


class Scored(NamedTuple):
    """One flight; NaN where it ended before anything was scored."""

    duration_s: float
    ended: str
    e_rho_m2: float  # mean of the square
    activity_2ps2: float  # of the elevator's rate of change, full throws a second
    y_m2: float = nan  # sideways, from the middle
    bank_rad2: float = nan


def fly_scored(flight: EstimatorFlight) -> Scored:
    """Fly one, plain.  Errors: `ConfigError`."""
    rows: list[tuple[float, ...]] = []
    ended = ""
    for now in _ticks(flight):
        truth, out = now.truth, now.output
        e = e_rho(out.line.x_m, out.line.z_m, out.line.eta_rad, truth.x_m, truth.z_m)
        moving = float(out.line.moving or not out.active)
        rows.append((truth.time_s, e, moving, out.command.elevator, truth.y_m, truth.roll_rad))
        ended = now.ended
    names = ("time_s", "e_rho_m", "line_moving", "elevator", "y_m", "roll_rad")
    columns = dict(zip(names, np.array(rows).T, strict=True))
    return _scored(Trajectory(columns, ended, len(rows)))


def fly_scored_compiled(flight: EstimatorFlight) -> Scored:
    """The same where all fixes are received, compiled."""
    if flight.dispersed:  # each has an aircraft of its own
        prepared = prepare(_world(flight), flight.duration_s)
    else:
        prepared = _prepared(flight._replace(seed=1, scale=1.0, changes=()))
    return _scored(fly_compiled(prepared, flight.seed, _values(flight), ()))


def _scored(flown: Trajectory) -> Scored:
    time, elevator = flown["time_s"], flown["elevator"]
    rows = (time > SETTLE_S) & (flown["line_moving"] == 0.0)
    square = rate = y = bank = nan
    if np.count_nonzero(rows) > 1:
        square = float(np.mean(flown["e_rho_m"][rows] ** 2))
        step = np.diff(elevator[rows]) / np.diff(time[rows])
        rate = float(np.mean(step**2))
        y = float(np.mean(flown["y_m"][rows] ** 2))
        bank = float(np.mean(flown["roll_rad"][rows] ** 2))
    return Scored(
        duration_s=float(time[-1]),
        ended=flown.ended,
        e_rho_m2=square,
        activity_2ps2=rate,
        y_m2=y,
        bank_rad2=bank,
    )


class _Tick(NamedTuple):
    """One tick of a flight."""

    truth: Truth
    inputs: Inputs
    output: Output
    ended: str  # why the flight ended with it; ""


def _ticks(flight: EstimatorFlight) -> Iterator[_Tick]:
    """The flight tick by tick, its fixes corrupted on their way.  Errors: `ConfigError`."""
    world = _world(flight)
    loop = ClosedLoop(world, _values(flight))
    differences = Differences()
    body = None if flight.tracked is None else _TrackedBody(world, flight.tracked, flight.seed)
    reception = world.position
    for _ in range(round(flight.duration_s * world.step_hz)):
        now, truth = world.time_s, world.truth
        if in_gap(flight.reception, now):
            world.position = reception
        elif flight.reception == "the laboratory's":
            world.position = differences.take(world.position, now)
        reception = world.position
        if body is not None:
            world.attitude = body.attitude(world)
        status = AutopilotStatus(time_s=now, accepts_surfaces=True, armed=True)
        inputs = Inputs(
            time_s=now,
            position=reception,
            attitude=world.attitude,
            autopilot=status,
            engage=True,
            imu=world.imu,
            airspeed=world.airspeed,
            surfaces=world.surfaces,
            rangefinder=world.rangefinder,
        )
        output = loop.tick()
        ended = world.crashed
        if not ended and output.mode in (RELEASED, FAILED):
            ended = f"disengaged: {reason_text(output.reason)}"
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


class _TrackedBody:
    """A tracker's attitude as the module takes it (`link.tracked_attitude`)."""

    def __init__(self, world: World, params: AttitudeParams, seed: int) -> None:
        sensors, white = Sensors(attitude=params), drawn_as_needed(seed + _OTHER_NOISE)
        self._sensor = flown_sensors(sensors, world.step_hz, white).attitude
        self._tracked = TrackedAttitude()
        self._taken = 0

    def attitude(self, world: World) -> AttitudeSample:
        """What this tick is given: the tracker's, or the autopilot's."""
        reported = world.attitude
        pose = sense_attitude(self._sensor, world.frame, world.state, world.steps)
        if pose.sequence > self._taken:
            self._taken = pose.sequence
            self._tracked.take((pose.qw, pose.qx, pose.qy, pose.qz), pose.time_s, reported)
        return self._tracked.choose(world.time_s, reported)


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


def _world(flight: EstimatorFlight) -> World:
    site, _, field = _place()
    line = site.lines[flight.line]
    start = Start(x_m=line.x_m + START_M, z_m=line.z_m)
    site = msgspec.structs.replace(site, start=start)
    airframe, sensors = _airframe(), flight.sensors
    if flight.dispersed:
        airframe, site, field, sensors = mismatched(airframe, site, field, sensors, flight.seed)
    return make_world(
        airframe,
        site,
        seed=flight.seed,
        turbulence=flight.turbulence,
        field=field,
        sensors=sensors,
        known=_airframe(),
    )


@lru_cache(maxsize=64)
def _prepared(flight: EstimatorFlight) -> Prepared:
    return prepare(_world(flight), flight.duration_s)


def _values(flight: EstimatorFlight) -> ParameterSet:
    """The shipped parameters on the flight's line: it does not know what noise the fixes have."""
    site, values, _ = _place()
    return values.changed(
        {
            **line_parameters(site.lines[flight.line]),
            **{name: flight.scale * values[name] for name in LINE_GAINS},
            **dict(flight.changes),
        }
    )


class EstimatorScore(NamedTuple):
    """Several flights of one kind, rms over all that was scored."""

    flights: int
    lost: int
    e_rho_m: float
    activity_ps: float
    y_m: float
    bank_rad: float


def score(flown: Sequence[Scored]) -> EstimatorScore:
    """What became of them."""
    whole = [each for each in flown if each.e_rho_m2 == each.e_rho_m2]

    def root(squares: list[float]) -> float:
        return sqrt(sum(squares) / len(squares)) if squares else nan

    return EstimatorScore(
        flights=len(flown),
        lost=sum(1 for each in flown if each.ended),
        e_rho_m=root([each.e_rho_m2 for each in whole]),
        activity_ps=root([each.activity_2ps2 for each in whole]),
        y_m=root([each.y_m2 for each in whole]),
        bank_rad=root([each.bank_rad2 for each in whole]),
    )


# Each gain, and the one that takes its place while accelerations are used.
_GAINS: Final = (
    ("RHO_P", "RHO_P_IMU"),
    ("RHO_I", "RHO_I_IMU"),
    ("RHO_D", "RHO_D_IMU"),
    ("RHO_D_FILT", "RHO_DF_IMU"),
    ("ELE_P", "ELE_P_IMU"),
    ("ELE_I", "ELE_I_IMU"),
    ("ELE_D", "ELE_D_IMU"),
)


def gains_exchanged(imu: bool) -> tuple[tuple[str, float], ...]:
    """Changes that give the law with accelerations (`imu`) the plain gains, or the reverse."""
    values = _place()[1]
    return tuple((fast, values[plain]) if imu else (plain, values[fast]) for plain, fast in _GAINS)


def margins_with(
    case: MarginCase, changes: tuple[tuple[str, float], ...]
) -> tuple[CaseMargins, ...]:
    """The margins of the shipped aircraft and parameters, some of these changed."""
    values, gusts = _place()[1].changed(dict(changes)), Gusts(TURBULENCE, case.speed_mps)
    return tuple(case_margins(_airframe(), values, [case], gusts))


class Ratios(NamedTuple):
    """How flights compare with others, rms over all that was scored of both."""

    e_rho: float
    activity: float
    left_out: int = 0  # pairs of which one ended before it was scored

    @property
    def words(self) -> str:
        """What the ratio does not know; "" where it knows all."""
        return f", without {self.left_out} pairs not scored" if self.left_out else ""


def paired_ratios(flown: Sequence[Scored], others: Sequence[Scored]) -> Ratios:
    """Of flights to others in the same air, one by one; a pair with one not scored is left out,
    and counted."""
    pairs = [
        (one, other)
        for one, other in zip(flown, others, strict=True)
        if one.e_rho_m2 == one.e_rho_m2 and other.e_rho_m2 == other.e_rho_m2
    ]
    one, other = score([one for one, _ in pairs]), score([other for _, other in pairs])
    return Ratios(
        one.e_rho_m / other.e_rho_m,
        one.activity_ps / other.activity_ps,
        len(flown) - len(pairs),
    )


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
class WatchedFlight:
    """One flight with two estimators, from when all was settled."""

    flight: EstimatorFlight
    duration_s: float
    ended: str
    time_s: Floats  # (n,)
    truth: Floats  # (n, 6): position [m] and velocity [m/s], soaring frame
    read: dict[bool, Floats]  # (n, 8): the same and two sigmas; with accelerations, without


def watch(flight: EstimatorFlight) -> WatchedFlight:
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
            states[imu], estimated = motion_step(gains[imu], frame, before, now.inputs)
            quality = motion_quality(gains[imu], before, states[imu], time_s)
            read[imu].append(
                (*estimated[1:7], quality.position_sigma_m, quality.velocity_sigma_mps)
            )
        ended = now.ended
    truth = np.array(truths)
    rows = truth[:, 0] > SETTLE_S
    return WatchedFlight(
        flight=flight,
        duration_s=float(truth[-1, 0]),
        ended=ended,
        time_s=truth[rows, 0],
        truth=truth[rows, 1:],
        read={imu: np.array(values)[rows] for imu, values in read.items()},
    )


class Known(NamedTuple):
    """How well position and velocity were known: lengths of the error vectors, rms."""

    position_mm: float
    velocity_mmps: float
    position_normalised: float  # mean of (error / sigma)², each axis: 1 where sigma is honest
    velocity_normalised: float


def known(flights: Sequence[WatchedFlight], imu: bool) -> Known:
    """One of the two estimators over several flights."""
    error = np.concatenate([flight.read[imu][:, :6] - flight.truth for flight in flights])
    sigma = np.concatenate([flight.read[imu][:, 6:] for flight in flights])
    square = np.stack([np.sum(error[:, :3] ** 2, axis=1), np.sum(error[:, 3:] ** 2, axis=1)], 1)
    position, velocity = (1e3 * np.sqrt(np.mean(square, axis=0))).tolist()
    return Known(position, velocity, *np.mean(square / (3.0 * sigma**2), axis=0).tolist())


# --- many flights ---------------------------------------------------------------------------------


def fly_each(
    flyer: Flyer, fly: Callable[[EstimatorFlight], Flew], jobs: dict[str, list[EstimatorFlight]]
) -> dict[str, list[Flew]]:
    """All of them by one function, under the same names."""
    return _named(
        jobs, flyer.each(fly, [flight for flights in jobs.values() for flight in flights])
    )


def _named(jobs: dict[str, list[EstimatorFlight]], flown: list[Flew]) -> dict[str, list[Flew]]:
    left = iter(flown)
    return {name: [next(left) for _ in flights] for name, flights in jobs.items()}


def fly_named(
    flyer: Flyer,
    corrupted: dict[str, list[EstimatorFlight]],
    scored: dict[str, list[EstimatorFlight]],
) -> dict[str, list[Scored]]:
    """All of them, compiled where that is possible and worth its time; `corrupted` never is."""
    simple = [flight for flights in scored.values() for flight in flights]
    if len(simple) < COMPILED_FROM or not available():
        return fly_each(flyer, fly_scored, {**corrupted, **scored})
    flown = fly_each(flyer, fly_scored, corrupted)
    return {**_named(scored, flyer.each(fly_scored_compiled, simple, compiled=True)), **flown}
