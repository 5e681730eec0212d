"""`satellites`: a receiver that drifts, steps and falls silent, and an estimator that is reset.

Over the hill, on its line a, with accelerometers and without a pitot tube.  Each flight has its own
wind and gusts, drawn from its seed, and the faults of `sim.faults`:

    reset      the autopilot's position is another by 5 m, for good, in any horizontal direction,
               and higher or lower by up to 2 m; beside it the same flight without
    turned     its heading is another by 10 degrees, likewise
    receiver   Gauss-Markov errors (1 m horizontally, 2 m in height, 300 s), three multipath steps
               of up to 2 m for 5 to 20 s, and two drop-outs of 1 to 6 s over which the estimator
               goes on by its accelerometers, wrong by 0.03 m/s², and says nothing.  The operator
               has moved the line to the lift: what it was wrong by at first does not count
    rtk        the same with carrier-phase corrections (1 cm, 2 cm in height) that are lost three
               times for 5 to 20 s, a fix that floats by up to 0.4 m; and with the same drop-outs
    lost       no satellites for 15 s; the estimator says so after 5 to 10 s, and is right again in
               the end: with leave to break off (`ESC_AUTO` 1), without, and not reported at all

e_rho is that of the truth, to the line where the lift is.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, inf, isfinite, nan, pi, radians, sin
from random import Random
from typing import Any, Final, NamedTuple

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
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.envelope import clearance
from tgl_soar.control.supervisor import CAPTURING, FAILED, LANDING, RELEASED
from tgl_soar.control.supervisor_texts import REASON_TEXTS
from tgl_soar.control.target_line import e_rho, eta_from_lean
from tgl_soar.geometry import SoaringFrame, soaring_from_ned
from tgl_soar.sim.closed_loop import ClosedLoop
from tgl_soar.sim.compiled import available
from tgl_soar.sim.compiled_flight import CompiledLoop, CompiledWorld, prepare
from tgl_soar.sim.faults import Fault, parse_fault
from tgl_soar.sim.injection import Injection
from tgl_soar.sim.score import touches_down_well
from tgl_soar.sim.sensors import (
    AUTOPILOT_POSITION,
    DRIFTING_POSITION,
    MEMS_IMU,
    RTK_POSITION,
    Sensors,
)
from tgl_soar.sim.world import World
from tgl_soar.types import Inputs, PositionFix

LINE: Final = "a"
FLIGHTS: Final = 100
QUICK: Final = 2
FIRST_SEED: Final = 8001
WIND_MPS: Final = (6.9, 7.4)
INTENSITY: Final = (0.0, 0.03)
BEGIN_S: Final = (15.0, 17.0)  # of what goes wrong; soaring since the sixth second
AFTER_S: Final = 20.0  # watched after a reset: two slides of the line's slowest mode
RECEIVER_S: Final = 180.0
LOST_S: Final = 15.0
HELD_S: Final = 1.0
LANDING_S: Final = 60.0  # after that, for the way home
RESET_M: Final = 5.0
RESET_UP_M: Final = 2.0
TURN_DEG: Final = 10.0
RECKONED_MPS2: Final = 0.03  # g times 0.2 degrees of tilt
APART_M: Final = 0.05  # what a reset may move
BESIDE_M: Final = 0.3  # by which the aircraft may be farther off than its fixes say
HANDED_M: Final = 1.0  # CLEAR_MIN of the hill

RESET, TURNED, RECEIVER, RTK = "reset", "turned", "receiver", "receiver, RTK"
DRIFTS: Final = (RECEIVER, RTK)
HOME, HELD, UNREPORTED = "lost, breaks off", "lost, held", "lost, not told"
POSITIONS: Final = {RECEIVER: DRIFTING_POSITION, RTK: RTK_POSITION}
# Of multipath; and of a receiver that has lost its fixed ambiguities and floats, for which data
# sheets name some decimetres.
STEPS_M: Final = {RECEIVER: (0.3, 2.0), RTK: (0.05, 0.4)}
STEPS_UP_M: Final = {RECEIVER: 1.0, RTK: 0.4}
KINDS: Final = (RESET, TURNED, RECEIVER, RTK, HOME, HELD, UNREPORTED)
# Nobody but the operator has a reason to end these.
STAYS: Final = (RESET, TURNED, RECEIVER, RTK, HOME)


class SatelliteJob(NamedTuple):
    """One flight to be flown."""

    kind: str
    seed: int
    dispersed: bool = False  # another aircraft than the file's, and other gusts


@dataclass(frozen=True)
class SatelliteFlight:
    """One flight, from its seed."""

    kind: str
    seed: int
    faults: tuple[str, ...]
    duration_s: float
    ended: str  # what it hit, or why the module disengaged; "": neither
    captures: int  # again, since what goes wrong began
    off_m: float  # the largest e_rho since then
    last_off_m: float  # e_rho at the end
    fix_off_m: float  # the largest error of the fixes that were given, across the line
    beside_m: float  # the most by which e_rho was beyond the error of the fix of the same tick
    beside_share: float  # of the ticks in which that was more than BESIDE_M
    within: float  # share of the ticks with e_rho within WITHIN_M
    clearance_m: float  # over the ground when it was disengaged; NaN: it was not
    apart_m: float  # resets: the largest difference of e_rho to the same flight without; else NaN
    along_m: float  # beyond the landing point, where it touched the ground
    across_m: float
    sink_mps: float
    landing: bool  # it ended so

    @property
    def disengaged(self) -> bool:
        """It was handed over, wherever it was."""
        return self.ended.startswith("disengaged")

    @property
    def lost(self) -> bool:
        """It hit something, and was not landing where it should."""
        return bool(self.ended) and not self.disengaged and not self.landed

    @property
    def gone(self) -> bool:
        """It was lost, or handed over."""
        return self.lost or self.disengaged

    @property
    def landed(self) -> bool:
        """It touched down as it should."""
        return self.landing and touches_down_well(self.along_m, self.across_m, self.sink_mps)


class SinceFault(NamedTuple):
    """What is looked at in a flight, tick by tick, since what goes wrong began."""

    ended: str
    duration_s: float
    captures: int
    off_m: list[float]  # e_rho
    fix_off_m: list[float]  # the error of the fix, across the line
    clearance_m: float  # over the ground, when it was disengaged
    touch: tuple[float, float, float]  # where it was last [m], and how fast it sank [m/s]
    landing: bool


def _drawn_faults(job: SatelliteJob, random: Random) -> tuple[str, ...]:
    begin, uniform = random.uniform(*BEGIN_S), random.uniform
    turn = uniform(0.0, 2.0 * pi)
    north, east = cos(turn), sin(turn)
    if job.kind == RESET:
        up = uniform(-RESET_UP_M, RESET_UP_M)
        by = f"north={RESET_M * north:.3f} east={RESET_M * east:.3f} down={up:.3f}"
        return (f"position.bias start={begin:.3f} for=1e5 {by}",)
    if job.kind == TURNED:
        by = f"roll=0 pitch=0 heading={random.choice((-TURN_DEG, TURN_DEG))}"
        return (f"attitude.bias start={begin:.3f} for=1e5 {by}",)
    drift = f"north={RECKONED_MPS2 * north:.4f} east={RECKONED_MPS2 * east:.4f}"
    if job.kind not in DRIFTS:
        reported_s = 1e6 if job.kind == UNREPORTED else uniform(5.0, 10.0)
        return (
            f"position.reckoned start={begin:.3f} for={LOST_S} {drift} reported={reported_s:.3f}",
        )
    steps, up = [], STEPS_UP_M[job.kind]
    for _ in range(3):
        at, lasts = uniform(BEGIN_S[1], RECEIVER_S - 30.0), uniform(5.0, 20.0)
        size, way = uniform(*STEPS_M[job.kind]), uniform(0.0, 2.0 * pi)
        by = f"north={size * cos(way):.3f} east={size * sin(way):.3f} down={uniform(-up, up):.3f}"
        steps.append(f"position.bias start={at:.3f} for={lasts:.3f} {by}")
    for _ in range(2):
        at, lasts = uniform(BEGIN_S[1], RECEIVER_S - 20.0), uniform(1.0, 6.0)
        steps.append(f"position.reckoned start={at:.3f} for={lasts:.3f} {drift} reported=1e6")
    return tuple(steps)


def _world(
    job: SatelliteJob, random: Random, duration_s: float
) -> tuple[World, ParameterSet, SoaringFrame]:
    hill = shipped_hill().blown(random.uniform(*WIND_MPS)).on_line(LINE)
    position = POSITIONS.get(job.kind, AUTOPILOT_POSITION)
    changes = {"ESC_AUTO": float(job.kind == HOME)}
    if job.kind in DRIFTS:
        changes["EST_FIX_SD"] = position.noise_m
    intensity = max(1e-6, random.uniform(*INTENSITY))  # one compiled kind of air for all
    sensors = Sensors(position=position, imu=MEMS_IMU)
    world: World = flown_world(
        hill.airframe,
        hill.site,
        job.seed,
        dispersed=job.dispersed,
        already=ALREADY,
        turbulence=intensity,
        sensors=sensors,
    )
    frame = world.frame
    if available():
        world = CompiledWorld(prepare(world, duration_s), job.seed)
    return world, hill.values.changed(changes), frame


def _duration_s(kind: str) -> float:
    if kind in DRIFTS:
        return RECEIVER_S
    if kind in (RESET, TURNED):
        return BEGIN_S[1] + AFTER_S
    return BEGIN_S[1] + LOST_S + (LANDING_S if kind == HOME else AFTER_S)


def _fly(job: SatelliteJob, faults: tuple[Fault, ...]) -> SinceFault:
    """Fly it with these faults; what is drawn besides is the seed's alone."""
    duration_s = _duration_s(job.kind)
    world, values, frame = _world(job, Random(f"air {job.seed}"), duration_s)
    injection = Injection(faults, job.seed)
    loop = _loop(world, values, injection)
    eta = eta_from_lean(radians(values["TGL_LEAN"]))
    x, z, nx, nz = values["TGL_X"], values["TGL_Z"], -sin(eta), cos(eta)
    away_x, away_z = 0.0, 0.0
    if job.kind in DRIFTS:
        away_x, away_z = _moved_to_the_lift(loop, frame)
    offs: list[float] = []
    fix_offs: list[float] = []
    captures, mode, ended, clearance_m = 0, -1, "", nan
    state = world.state
    while world.time_s < duration_s:
        output = loop.tick()
        begun = world.time_s >= BEGIN_S[0]
        captures += begun and output.mode == CAPTURING and mode != CAPTURING
        mode = output.mode
        if world.crashed:
            ended = world.crashed.partition(" at x")[0]
            break
        if mode in (RELEASED, FAILED):
            ended = f"disengaged: {REASON_TEXTS[output.reason]}"
            clearance_m = clearance(world.ground, state.x_m, state.z_m)
            break
        state = world.state
        if begun:
            offs.append(e_rho(x, z, eta, state.x_m, state.z_m))
            fx, _, fz = soaring_from_ned(frame, *loop.given.place_ned_m)
            fix_offs.append(nx * (fx - away_x - state.x_m) + nz * (fz - away_z - state.z_m))
    touch = values["LND_X"] - state.x_m, state.y_m - values["LND_Y"], -state.velocity_z_mps
    landing = mode == LANDING and "ground" in ended
    return SinceFault(
        ended=ended,
        duration_s=world.time_s,
        captures=captures,
        off_m=offs,
        fix_off_m=fix_offs,
        clearance_m=clearance_m,
        touch=touch,
        landing=landing,
    )


def _moved_to_the_lift(loop: ClosedLoop, frame: SoaringFrame) -> tuple[float, float]:
    """What the fixes are wrong by before the flight, by which the operator moves the line."""
    world = loop.world
    loop.engage = False
    for _ in range(round(HELD_S * world.step_hz)):
        loop.tick()
    x, _, z = soaring_from_ned(frame, *world.position.place_ned_m)
    away_x, away_z = x - world.state.x_m, z - world.state.z_m
    values = loop.values
    loop.change({"TGL_X": values["TGL_X"] + away_x, "TGL_Z": values["TGL_Z"] + away_z})
    loop.engage = True
    return away_x, away_z


class _ShowsFixes:
    """A loop that shows which fix the module was given."""

    given: PositionFix

    def _decide(self, inputs: Inputs) -> Any:
        self.given = inputs.position
        return super()._decide(inputs)  # type: ignore[misc]


class _WatchedLoop(_ShowsFixes, ClosedLoop):
    pass


class _WatchedCompiledLoop(_ShowsFixes, CompiledLoop):
    pass


def _loop(
    world: World, values: ParameterSet, injection: Injection
) -> _WatchedLoop | _WatchedCompiledLoop:
    kind = _WatchedCompiledLoop if available() else _WatchedLoop
    return kind(world, values, injection)


def fly_satellites(job: SatelliteJob) -> SatelliteFlight:
    """Fly one of them.  Errors: `ConfigError`."""
    faults = _drawn_faults(job, Random(f"{job.kind} {job.seed}"))
    flown = _fly(job, tuple(parse_fault(text) for text in faults))
    apart = nan
    if job.kind in (RESET, TURNED):
        plain = _fly(job, ())
        pairs = zip(flown.off_m, plain.off_m, strict=False)
        apart = inf if flown.ended or plain.ended else max(abs(a - b) for a, b in pairs)
    along, across, sink = flown.touch
    beside = [abs(a) - abs(b) for a, b in zip(flown.off_m, flown.fix_off_m, strict=True)]
    return SatelliteFlight(
        kind=job.kind,
        seed=job.seed,
        faults=faults,
        duration_s=flown.duration_s,
        ended=flown.ended,
        captures=flown.captures,
        off_m=max(map(abs, flown.off_m), default=nan),
        last_off_m=abs(flown.off_m[-1]) if flown.off_m else nan,
        fix_off_m=max(map(abs, flown.fix_off_m), default=nan),
        beside_m=max(beside, default=nan),
        beside_share=sum(each > BESIDE_M for each in beside) / max(1, len(beside)),
        within=fraction_within(flown.off_m),
        clearance_m=flown.clearance_m,
        apart_m=apart,
        along_m=along,
        across_m=across,
        sink_mps=sink,
        landing=flown.landing,
    )


def run(context: Context) -> Result:
    """Fly them and tabulate."""
    count = QUICK if context.quick else context.episodes or FLIGHTS
    seeds = range(FIRST_SEED, FIRST_SEED + count)
    jobs = [SatelliteJob(kind, seed) for kind in KINDS for seed in seeds]
    flown = context.each(fly_satellites, jobs)
    by_kind = {kind: [each for each in flown if each.kind == kind] for kind in KINDS}
    return Result(
        name="satellites",
        title="a receiver that drifts, steps and falls silent, and an estimator that is reset",
        flown=f"{count} flights of each kind over the half cylinder of 8 m, on its line {LINE}, in"
        f" {WIND_MPS[0]:g} to {WIND_MPS[1]:g} m/s of wind with gusts of up to"
        f" {100 * INTENSITY[1]:g} %, with accelerometers, without a pitot tube. Resets of"
        f" {RESET_M:g} m horizontally and up to {RESET_UP_M:g} m in height; turns of {TURN_DEG:g}°;"
        " a receiver that is off by a Gauss-Markov process, by steps of up to 2 m and by drop-outs"
        f" for {RECEIVER_S:g} s, and one with carrier-phase corrections that floats by up to"
        f" {STEPS_M[RTK][1]:g} m three times, with the same drop-outs; no satellites for"
        f" {LOST_S:g} s, dead reckoned with"
        f" {RECKONED_MPS2:g} m/s² of error, reported after 5 to 10 s.",
        claims=_claims(by_kind),
        why=ends_by_kind(by_kind),
        tables=(_table(by_kind),),
        numbers={"flights": [_numbers(each) for each in flown]},
        figures=(),
        seeds=tuple(seeds),
    )


def _claims(by_kind: dict[str, list[SatelliteFlight]]) -> tuple[Claim, ...]:
    resets = [*by_kind[RESET], *by_kind[TURNED]]
    worst = max((each.apart_m for each in resets), default=nan)
    captured = sum(each.captures for each in resets)
    stays = [each for kind in STAYS for each in by_kind[kind]]
    gone = sum(each.gone for each in stays)
    drifted = by_kind[RECEIVER]
    beside = max((each.beside_m for each in drifted), default=nan)
    fraction_beside = sum(each.beside_share for each in drifted) / max(1, len(drifted))
    outages = by_kind[HELD]
    held = [each for each in outages if not each.ended]
    off = max((each.last_off_m for each in held), default=nan)
    given = [each.clearance_m for each in outages if each.disengaged]
    hit = sum(each.lost for each in outages)
    return (
        Claim(
            f"a reset of {RESET_M:g} m, or by {TURN_DEG:g}° of heading, moves e_rho by less than"
            f" {100 * APART_M:g} cm, and nothing is captured again",
            worst < APART_M and captured == 0,
            f"by {100 * worst:.1f} cm at most, {captured} captures in {len(resets)} flights",
        ),
        Claim(
            "none is lost or disengaged, but where dead reckoning is not reported, or nobody gave"
            " leave to break off",
            gone == 0,
            f"{fraction_text(gone, len(stays))}: lost {sum(each.lost for each in stays)},"
            f" disengaged {sum(each.disengaged for each in stays)}",
        ),
        Claim(
            "without leave to break off none hits anything before it is disengaged, and none is"
            f" disengaged lower than {HANDED_M:g} m over the ground",
            hit == 0 and min(given, default=inf) >= HANDED_M,
            f"{hit} of {len(outages)} lost, {len(given)} disengaged, from"
            f" {min(given, default=nan):.1f} m at least",
        ),
        Claim(
            "with a receiver that drifts and steps the aircraft is at no instant farther off its"
            f" line than its fix is wrong, by more than {BESIDE_M:g} m",
            beside <= BESIDE_M,
            f"by {beside:.2f} m at most, by more than {BESIDE_M:g} m for"
            f" {100 * fraction_beside:.1f} % of the time",
        ),
        stays_claim(RTK, by_kind[RTK]),
        Claim(
            "whoever soars on after dead reckoning is back on its own line",
            off < BESIDE_M,
            f"{len(held)} of {len(by_kind[HELD])} soar on, off it by {off:.2f} m at most",
        ),
    )


def _table(by_kind: dict[str, list[SatelliteFlight]]) -> Table:
    rows = []
    for kind, some in by_kind.items():
        soared = [each for each in some if not each.ended]
        rows.append(
            (
                kind,
                f"{len(some)}",
                f"{len(soared)}",
                f"{sum(each.landed for each in some)}",
                f"{sum(each.disengaged for each in some)}",
                f"{sum(each.lost for each in some)}",
                f"{sum(each.captures for each in some)}",
                span([each.fix_off_m for each in some], 2),
                span([each.off_m for each in some], 2),
                span([100 * each.within for each in some if each.kind in DRIFTS], 0),
                span([each.beside_m for each in some if each.kind in DRIFTS], 2),
                span([each.clearance_m for each in some]),
                span([each.last_off_m for each in soared], 2),
                span([100 * each.apart_m for each in some if isfinite(each.apart_m)]),
            )
        )
    columns = (
        "", "flights", "still soared", "landed as they should", "disengaged", "lost",
        "captured again", "fixes off, across the line [m]", "off the line, at most [m]",
        f"within {WITHIN_M:g} m [% of the time]",
        "beyond the fix of that instant [m]", "disengaged, over the ground [m]", "in the end [m]",
        "e_rho moved [cm]",
    )  # fmt: skip
    return Table("Satellites: least, median, most", columns, tuple(rows))


def _numbers(each: SatelliteFlight) -> dict[str, object]:
    keep = (
        "kind", "seed", "faults", "duration_s", "ended", "captures", "off_m", "last_off_m",
        "fix_off_m", "beside_m", "beside_share", "within", "clearance_m",
        "apart_m", "along_m", "across_m",
        "sink_mps",
    )  # fmt: skip
    return {name: getattr(each, name) for name in keep}
