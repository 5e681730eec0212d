"""`rangefinder`: a position that drifts, with and without a rangefinder; and a wrong rangefinder.

Over the hill, on its line a, with accelerometers and without a pitot tube.  Each flight has its own
wind and gusts, drawn from its seed; those of two rows differ in nothing but the rangefinder:

    receiver   Gauss-Markov errors of 1 m horizontally and 2 m in height, with 300 s
    height     the same errors in height alone, as of a barometer
    wrong      a position without such errors, and a rangefinder that freezes, reads too short or
               too long by up to 12 m, is noisy by up to 3 m or falls silent, for 20 s;
               compared with the same flight without a rangefinder

The rangefinder corrects the height (RNG_USE 2).  The operator has moved the line to the lift: what
the estimate was wrong by at first does not count.  e_rho is that of the truth, to the line where
the lift is.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, nan, radians, sqrt
from random import Random
from typing import Final, NamedTuple

from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.outdoors.outdoors import (
    ALREADY,
    WITHIN_M,
    ends_by_kind,
    fraction_within,
    span,
    stays_claim,
)
from tgl_soar.analysis.experiments.outdoors.shipped_hill import shipped_hill
from tgl_soar.analysis.experiments.random_aircraft import flown_world
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.search.scoring import fraction_text
from tgl_soar.autopilot import Output
from tgl_soar.control.envelope import clearance
from tgl_soar.control.supervisor import CAPTURING, FAILED, RELEASED
from tgl_soar.control.supervisor_texts import REASON_TEXTS
from tgl_soar.control.target_line import e_rho, eta_from_lean
from tgl_soar.estimation.ground_range import RANGE_CORRECTS
from tgl_soar.geometry import soaring_from_ned
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.compiled import available
from tgl_soar.sim.compiled_flight import CompiledLoop, CompiledWorld, prepare
from tgl_soar.sim.faults import Fault, parse_fault
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.sensors import (
    AUTOPILOT_POSITION,
    DRIFTING_POSITION,
    LASER_RANGE,
    MEMS_IMU,
    Sensors,
)
from tgl_soar.sim.world import World

LINE: Final = "a"
FLIGHTS: Final = 100
QUICK: Final = 2
FIRST_SEED: Final = 8501  # others were looked at while it was built
WIND_MPS: Final = (6.9, 7.4)
INTENSITY: Final = (0.0, 0.03)
HELD_S: Final = 1.0
BEGIN_S: Final = 16.0  # soaring since the sixth second
DRIFT_S: Final = 180.0
WRONG_S: Final = 20.0
AFTER_S: Final = 20.0

RECEIVER, HEIGHT = "receiver", "height alone"
RECEIVER_RANGED, HEIGHT_RANGED = "receiver, rangefinder", "height alone, rangefinder"
WRONG: Final = "wrong rangefinder"
KINDS: Final = (RECEIVER, RECEIVER_RANGED, HEIGHT, HEIGHT_RANGED, WRONG)
RANGED: Final = (RECEIVER_RANGED, HEIGHT_RANGED, WRONG)


class RangeJob(NamedTuple):
    """One flight to be flown."""

    kind: str
    seed: int
    dispersed: bool = False  # another aircraft than the file's, and other gusts


@dataclass(frozen=True)
class RangeFlight:
    """One flight, from its seed."""

    kind: str
    seed: int
    fault: str
    duration_s: float
    ended: str  # what it hit, or why the module disengaged; "": neither
    captures: int  # again, since BEGIN_S
    off_rms_m: float  # e_rho since then
    off_m: float  # the largest
    within: float  # share of the time with e_rho within WITHIN_M
    height_rms_m: float  # of the height as estimated, less what it was wrong by at first
    least_m: float  # clearance
    apart_m: float  # wrong: the largest difference of e_rho to the same flight without; else NaN

    @property
    def gone(self) -> bool:
        """It was lost or disengaged."""
        return bool(self.ended)


class _RangedFlight(NamedTuple):
    ended: str
    duration_s: float
    captures: int
    off_m: list[float]
    height_off_m: list[float]
    least_m: float


def _drawn_fault(random: Random) -> str:
    uniform = random.uniform
    begin = f"start={uniform(BEGIN_S, BEGIN_S + 1.0):.3f} for={WRONG_S}"
    way = random.choice(("freeze", "bias", "noise", "dropout"))
    if way == "bias":
        return f"rangefinder.bias {begin} away={uniform(-12.0, 12.0):.3f}"
    if way == "noise":
        return f"rangefinder.noise {begin} sigma={uniform(0.3, 3.0):.3f}"
    return f"rangefinder.{way} {begin}"


def _loop(job: RangeJob, ranged: bool, faults: tuple[Fault, ...], seconds: float) -> ClosedLoop:
    random = Random(f"air {job.seed}")
    hill = shipped_hill().blown(random.uniform(*WIND_MPS)).on_line(LINE)
    intensity = max(1e-6, random.uniform(*INTENSITY))  # one compiled kind of air for all
    position, changes = AUTOPILOT_POSITION, {}
    if job.kind != WRONG:
        position = DRIFTING_POSITION
        changes["EST_FIX_SD"] = position.noise_m
    if job.kind in (HEIGHT, HEIGHT_RANGED):
        position = position._replace(drift_m=0.0)
    if ranged:
        changes["RNG_USE"] = float(RANGE_CORRECTS)
    world: World = flown_world(
        hill.airframe,
        hill.site,
        job.seed,
        dispersed=job.dispersed,
        already=ALREADY,
        turbulence=intensity,
        sensors=Sensors(
            position=position, imu=MEMS_IMU, rangefinder=LASER_RANGE if ranged else None
        ),
    )
    injection = Injection(faults, job.seed)
    if available():
        compiled_world = CompiledWorld(prepare(world, seconds), job.seed)
        return CompiledLoop(compiled_world, hill.values.changed(changes), injection)
    return ClosedLoop(world, hill.values.changed(changes), injection)


def _fly(job: RangeJob, ranged: bool, faults: tuple[Fault, ...]) -> _RangedFlight:
    """Fly it with these faults; what is drawn besides is the seed's alone."""
    seconds = BEGIN_S + 1.0 + WRONG_S + AFTER_S if job.kind == WRONG else DRIFT_S
    loop = _loop(job, ranged, faults, seconds)
    world, values = loop.world, loop.values
    away_z = _moved_to_the_lift(loop) if job.kind != WRONG else 0.0
    eta = eta_from_lean(radians(values["TGL_LEAN"]))
    offs: list[float] = []
    heights: list[float] = []
    captures, mode, ended, least = 0, -1, "", inf
    while world.time_s < seconds:
        output = loop.tick()
        begun = world.time_s >= BEGIN_S
        captures += begun and output.mode == CAPTURING and mode != CAPTURING
        mode = output.mode
        if world.crashed:
            ended = world.crashed.partition(" at x")[0]
            break
        if mode in (RELEASED, FAILED):
            ended = f"disengaged: {REASON_TEXTS[output.reason]}"
            break
        state = world.state
        if begun:
            offs.append(e_rho(values["TGL_X"], values["TGL_Z"], eta, state.x_m, state.z_m))
            estimated_m = _estimated(loop, output)[1]
            heights.append(estimated_m - state.z_m - away_z)
            least = min(least, clearance(world.ground, state.x_m, state.z_m))
    return _RangedFlight(
        ended=ended,
        duration_s=world.time_s,
        captures=captures,
        off_m=offs,
        height_off_m=heights,
        least_m=least,
    )


def _moved_to_the_lift(loop: ClosedLoop) -> float:
    """The operator moves the line by what the estimate is wrong by before the flight; by how much
    in height [m]."""
    world = loop.world
    loop.engage = False
    for _ in range(round(HELD_S * world.step_hz)):
        output = loop.tick()
    x, z = _estimated(loop, output)
    away_x, away_z = x - world.state.x_m, z - world.state.z_m
    values = loop.values
    loop.change({"TGL_X": values["TGL_X"] + away_x, "TGL_Z": values["TGL_Z"] + away_z})
    loop.engage = True
    return away_z


def _estimated(loop: ClosedLoop, output: Output) -> tuple[float, float]:
    """Downstream and up, as the last fix and the rangefinder's correction have it [m]: within the
    centimetres of a fix what the estimator has."""
    x, _, z = soaring_from_ned(loop.world.frame, *loop.world.position.place_ned_m)
    return x, z + output.ground_range.correction_m


def _rms(values: list[float]) -> float:
    return sqrt(sum(v * v for v in values) / len(values)) if values else nan


def fly_range(job: RangeJob) -> RangeFlight:
    """Fly one of them.  Errors: `ConfigError`."""
    fault = _drawn_fault(Random(f"{job.kind} {job.seed}")) if job.kind == WRONG else ""
    flown = _fly(job, job.kind in RANGED, (parse_fault(fault),) if fault else ())
    apart = nan
    if job.kind == WRONG:
        plain = _fly(job, False, ())
        pairs = zip(flown.off_m, plain.off_m, strict=False)
        apart = inf if flown.ended or plain.ended else max(abs(a - b) for a, b in pairs)
    offs = flown.off_m
    return RangeFlight(
        kind=job.kind,
        seed=job.seed,
        fault=fault,
        duration_s=flown.duration_s,
        ended=flown.ended,
        captures=flown.captures,
        off_rms_m=_rms(offs),
        off_m=max(map(abs, offs), default=nan),
        within=fraction_within(offs),
        height_rms_m=_rms(flown.height_off_m),
        least_m=flown.least_m,
        apart_m=apart,
    )


def run(context: Context) -> Result:
    """Fly them and tabulate."""
    count = QUICK if context.quick else context.episodes or FLIGHTS
    seeds = range(FIRST_SEED, FIRST_SEED + count)
    jobs = [RangeJob(kind, seed) for kind in KINDS for seed in seeds]
    flown = context.each(fly_range, jobs)
    by_kind = {kind: [each for each in flown if each.kind == kind] for kind in KINDS}
    return Result(
        name="rangefinder",
        title="a position that drifts, with and without a rangefinder; and a wrong rangefinder",
        flown=f"{count} flights of each kind over the half cylinder of 8 m, on its line {LINE}, in"
        f" {WIND_MPS[0]:g} to {WIND_MPS[1]:g} m/s of wind with gusts of up to"
        f" {100 * INTENSITY[1]:g} %, with accelerometers, without a pitot tube. A position that"
        f" drifts by 1 m horizontally and 2 m in height, or in height alone, with a time constant"
        f" of 300 s, for {DRIFT_S:g} s; `RNG_USE` 2 where there is a rangefinder (20 Hz, 3 cm of"
        f" noise, 2 % lost). One that is wrong for {WRONG_S:g} s: frozen, off by up to 12 m, noisy"
        " by up to 3 m, silent.",
        claims=_claims(by_kind),
        why=ends_by_kind(by_kind),
        tables=(_table(by_kind),),
        numbers={"flights": [_numbers(each) for each in flown]},
        figures=(),
        seeds=tuple(seeds),
    )


def _claims(by_kind: dict[str, list[RangeFlight]]) -> tuple[Claim, ...]:
    wrong = by_kind[WRONG]
    gone = sum(each.gone for each in wrong)
    apart = max((each.apart_m for each in wrong), default=nan)
    return (
        *(stays_claim(kind, by_kind[kind]) for kind in (RECEIVER_RANGED, HEIGHT_RANGED)),
        Claim(
            "none is lost or disengaged by a wrong rangefinder, and none captures again",
            gone + sum(each.captures for each in wrong) == 0,
            f"{fraction_text(gone, len(wrong))}, e_rho moved by {apart:.2f} m at most",
        ),
    )


def _table(by_kind: dict[str, list[RangeFlight]]) -> Table:
    rows = [
        (
            kind,
            f"{len(some)}",
            f"{sum(each.gone for each in some)}",
            f"{sum(each.captures for each in some)}",
            span([each.height_rms_m for each in some], 2),
            span([each.off_rms_m for each in some], 2),
            span([each.off_m for each in some], 2),
            span([100 * each.within for each in some], 0),
            span([each.least_m for each in some if isfinite(each.least_m)]),
            span([each.apart_m for each in some if isfinite(each.apart_m)], 2),
        )
        for kind, some in by_kind.items()
    ]
    columns = (
        "", "flights", "lost or disengaged", "captured again", "height wrong by, rms [m]",
        "e_rho, rms [m]", "e_rho, at most [m]", f"within {WITHIN_M:g} m [% of the time]",
        "least clearance [m]", "e_rho moved by it [m]",
    )  # fmt: skip
    return Table("Rangefinder: least, median, most", columns, tuple(rows))


def _numbers(each: RangeFlight) -> dict[str, object]:
    keep = (
        "kind", "seed", "fault", "duration_s", "ended", "captures", "off_rms_m", "off_m", "within",
        "height_rms_m", "least_m", "apart_m",
    )  # fmt: skip
    return {name: getattr(each, name) for name in keep}
