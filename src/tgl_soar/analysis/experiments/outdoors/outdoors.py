"""`outdoors`: launches from the hand, and break-offs that end on the ground, over the hill.

Each flight has its own wind, gusts and line, drawn from its seed.  Those from a hand fly in plain
Python: the others are compiled where numba is installed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, degrees, inf, isfinite, log, nan, radians
from random import Random
from typing import Final, NamedTuple, Protocol

import msgspec
import numpy as np

from tgl_soar.air.gusts import ScaledField, Schedule
from tgl_soar.air.hill import HillField
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.outdoors.shipped_hill import ShippedHill, shipped_hill
from tgl_soar.analysis.experiments.random_aircraft import flown_world
from tgl_soar.analysis.experiments.result import ChangedThreshold, Claim, Result, Table, decided
from tgl_soar.analysis.search.scoring import fraction_text, interval
from tgl_soar.config.site import Start
from tgl_soar.control.envelope import clearance
from tgl_soar.control.supervisor import BREAKING_OFF, LANDING, SOARING
from tgl_soar.control.supervisor_texts import MODE_NAMES, REASON_TEXTS
from tgl_soar.sim.closed_loop import Change, Trajectory, fly
from tgl_soar.sim.compiled import available
from tgl_soar.sim.compiled_flight import fly_compiled, prepare
from tgl_soar.sim.score import ACROSS_M, ALONG_M, SINK_MPS, touches_down_well
from tgl_soar.sim.sensors import MEMS_IMU, USUAL_SENSORS, Sensors
from tgl_soar.sim.throw import Throw, ThrownWorld
from tgl_soar.types import Ground

CAPTURED: Final = 0.99  # of launches, as the first claim asks
LANDED: Final = 0.95  # of break-offs, with height left and in a lull


def flights_to_show(least: float) -> int:
    """How many flights show such a share if all of them end well.

    The exact 95 % interval of n of n begins at 0.025 ** (1 / n).
    """
    return ceil(log(0.025) / log(least))


# 368 launches, and as many break-offs by command of each kind, of which more than a quarter have
# height left; a fifth, 73 where 72 are enough, in a lull.  On one core a launch takes 4 s and any
# other flight 0.1 s: half an hour, and as long again for dispersed ones.
FLIGHTS: Final = flights_to_show(CAPTURED)
LULLS: Final = 5
QUICK: Final = 2
FIRST_SEED: Final = 6001  # seeds below were looked at while this was built
# At the slower of these winds the aircraft just stays on the lines; at the faster the landing
# place, 19 m before the hill, is as far as it may be.
WIND_MPS: Final = (6.8, 7.6)
INTENSITY: Final = (0.0, 0.05)
WITHIN_M: Final = 0.3  # of its lift, as is asked of an aircraft whose position does not drift
ALREADY: Final = ("wind",)  # that is drawn here, and the module is given none of it
THROW_MPS: Final = 3.0  # into 8 to 10 m/s of wind at the edge: a push, no throw with a run
THROW_OFF_MPS: Final = 1.0
THROW_OFF_DEG: Final = 20.0
HAND: Final = Start(x_m=-4.5, z_m=8.4)  # who throws stands 5 m before the crest, 6.6 m up
THROW_S: Final = 2.0
LAUNCH_S: Final = 30.0
LANDING_S: Final = 75.0
LULL: Final = 0.88  # of the wind: some lines of this hill are soared on in it, some are not
LULL_S: Final = (12.0, 6.0)  # when it begins, and how long the wind takes to fall
CHANGED: Final = (
    ChangedThreshold(
        "the three shares",
        "the share that was counted",
        "its exact 95 % interval, too; undecided where only the share that was counted is enough",
        "99 of 100 are 95 to 100 %: that does not show 99",
    ),
)
TRACE_S: Final = 0.1  # between two points of a drawn path


LAUNCH, LAND, WITH_IMU, LULLED = "launch", "landing", "landing with accelerometers", "lull"
KINDS: Final = (LAUNCH, LAND, WITH_IMU, LULLED)


class PassageJob(NamedTuple):
    """One flight to be flown."""

    kind: str
    seed: int
    dispersed: bool = False  # another aircraft than the file's, and other gusts


@dataclass(frozen=True)
class FlownPassage:
    """One flight, from its seed."""

    kind: str  # of `KINDS`
    seed: int
    duration_s: float
    wind_mps: float
    intensity: float
    throw_mps: float
    throw_pitch_deg: float
    throw_heading_deg: float
    modes: tuple[tuple[float, str, str], ...]  # when, which, why
    ended: str
    left_m: float  # the height left when it broke off; NaN: not known, or it did not
    broke_at_m: float  # the height over the landing place, there; NaN: it did not
    over_ground_m: float  # the least while it had not yet broken off
    along_m: float  # beyond the landing point, where it touched the ground
    across_m: float
    sink_mps: float
    path: tuple[tuple[float, float, float], ...]  # x, y, z

    @property
    def soars(self) -> bool:
        """Whether it ended on the line, and not on the ground."""
        return self.modes[-1][1] == MODE_NAMES[SOARING] and not self.ended

    @property
    def broke_off(self) -> bool:
        """Whether it broke off."""
        return isfinite(self.broke_at_m)

    @property
    def landed(self) -> bool:
        """Whether it touched down as it should."""
        well = touches_down_well(self.along_m, self.across_m, self.sink_mps)
        return "ground" in self.ended and well


def _hill(random: Random) -> tuple[ShippedHill, float]:
    """The hill in a wind that is drawn, and the intensity of its gusts."""
    return shipped_hill().blown(random.uniform(*WIND_MPS)), random.uniform(*INTENSITY)


def fly_passage(job: PassageJob) -> FlownPassage:
    """Fly one of them.  Errors: `ConfigError`."""
    return launch(job) if job.kind == LAUNCH else land(job)


def launch(job: PassageJob) -> FlownPassage:
    """One launch from the hand."""
    random = Random(f"launch {job.seed}")
    hill, intensity = _hill(random)
    off = random.uniform
    throw = Throw(
        time_s=THROW_S,
        speed_mps=THROW_MPS + off(-THROW_OFF_MPS, THROW_OFF_MPS),
        roll_rad=0.0,
        pitch_rad=radians(off(-THROW_OFF_DEG, THROW_OFF_DEG)),
        heading_rad=radians(off(-THROW_OFF_DEG, THROW_OFF_DEG)),
    )
    site = msgspec.structs.replace(hill.site, start=HAND)
    world = flown_world(
        hill.airframe,
        site,
        job.seed,
        dispersed=job.dispersed,
        already=ALREADY,
        turbulence=intensity,
    )
    values = hill.values.changed({"LNC_START": 1.0})
    flown = fly(ThrownWorld(world, throw), values, (), LAUNCH_S)
    return _outcome(job, hill, intensity, throw, world.ground, flown)


def land(job: PassageJob) -> FlownPassage:
    """One break-off from the line: by command at some time, or by itself in a lull."""
    random = Random(f"landing {job.seed}")
    hill, intensity = _hill(random)
    hill = hill.on_line(random.choice(sorted(hill.site.lines)))
    changes: tuple[Change, ...] = (Change(random.uniform(3.0, 15.0), {"ESC_START": 1.0}),)
    values, field = hill.values, None
    if job.kind == LULLED:
        values, changes = values.changed({"ESC_AUTO": 1.0}), ()
        begins, takes = LULL_S
        calmer = Schedule([0.0, begins, begins + takes], [1.0, 1.0, LULL])
        field = ScaledField(HillField(hill.air.wind_mps, hill.air.radius_m), calmer)
    world = flown_world(
        hill.airframe,
        hill.site,
        job.seed,
        dispersed=job.dispersed,
        already=ALREADY,
        turbulence=intensity,
        field=field,
        sensors=Sensors(imu=MEMS_IMU) if job.kind == WITH_IMU else USUAL_SENSORS,
    )
    ground = world.ground
    if available():
        flown = fly_compiled(prepare(world, LANDING_S), job.seed, values, changes)
    else:
        flown = fly(world, values, changes, LANDING_S)
    return _outcome(job, hill, intensity, None, ground, flown)


def _outcome(
    job: PassageJob,
    hill: ShippedHill,
    intensity: float,
    throw: Throw | None,
    ground: Ground,
    flown: Trajectory,
) -> FlownPassage:
    """What there is to say of a flight."""
    times, mode = flown["time_s"], flown["mode"]
    x, y, z = flown["x_m"], flown["y_m"], flown["z_m"]
    place = hill.values
    changed = [0, *(np.flatnonzero(np.diff(mode)) + 1).tolist()]
    modes = tuple(
        (float(times[k]), MODE_NAMES[int(mode[k])], REASON_TEXTS[int(flown["reason"][k])])
        for k in changed
    )
    broke = next((k for k in changed if int(mode[k]) == BREAKING_OFF), None)
    soars = (mode != BREAKING_OFF) & (mode != LANDING) & (times > THROW_S + 1.0)
    drawn = slice(None, None, round(TRACE_S / (times[1] - times[0])))
    path = zip(*(column[drawn].round(2).tolist() for column in (x, y, z)), strict=True)
    return FlownPassage(
        kind=job.kind,
        seed=job.seed,
        duration_s=float(times[-1]),
        wind_mps=hill.air.wind_mps,
        intensity=intensity,
        throw_mps=throw.speed_mps if throw else nan,
        throw_pitch_deg=degrees(throw.pitch_rad) if throw else nan,
        throw_heading_deg=degrees(throw.heading_rad) if throw else nan,
        modes=modes,
        ended=flown.ended,
        left_m=nan if broke is None else float(flown["height_left_m"][max(0, broke - 1)]),
        broke_at_m=nan if broke is None else float(z[broke]) - place["LND_Z"],
        over_ground_m=min(
            (clearance(ground, x[k], z[k]) for k in np.flatnonzero(soars)), default=inf
        ),
        along_m=place["LND_X"] - float(x[-1]),
        across_m=float(y[-1]) - place["LND_Y"],
        sink_mps=float((z[-2] - z[-1]) / (times[-1] - times[-2])),
        path=tuple(path),
    )


def run(context: Context) -> Result:
    """Fly them, tabulate, draw."""
    count = QUICK if context.quick else context.episodes or FLIGHTS
    seeds = range(FIRST_SEED, FIRST_SEED + count)
    lulls = seeds[: max(1, count // LULLS)]
    jobs = [PassageJob(kind, seed) for kind in (LAUNCH, LAND, WITH_IMU) for seed in seeds]
    jobs += [PassageJob(LULLED, seed) for seed in lulls]
    flown = context.each(fly_passage, jobs)
    by_kind = {kind: [each for each in flown if each.kind == kind] for kind in KINDS}
    figure: tuple[str, ...] = ()
    if context.figures is not None:
        from tgl_soar.analysis.report.passage_figure import passage_figure

        path = context.figures / "outdoors.png"
        passage_figure(path, shipped_hill().site, by_kind)
        figure = (path.name,)
    return Result(
        name="outdoors",
        title="from the hand to the line, and home",
        flown=f"{count} launches, twice {count} break-offs by command and {len(lulls)} in a lull to"
        f" {LULL:g} of the wind, over the half cylinder of 8 m in {WIND_MPS[0]:g} to"
        f" {WIND_MPS[1]:g} m/s of wind with gusts of up to {100 * INTENSITY[1]:g} %. Thrown"
        f" at {THROW_MPS:g} ± {THROW_OFF_MPS:g} m/s, ± {THROW_OFF_DEG:g}° of pitch and"
        f" heading. Without a pitot tube; with accelerometers in the second {count} break-offs"
        f" alone. Seeds from {seeds[0]}; those below {FIRST_SEED} were looked at while it was"
        " built.",
        claims=_claims(by_kind),
        why="",
        badly=_badly(flown),
        tables=(_launches(by_kind[LAUNCH]), _landings(by_kind)),
        numbers={"flights": [_numbers(each) for each in flown]},
        figures=figure,
        seeds=tuple(seeds),
        changed=CHANGED,
    )


def _claims(by_kind: dict[str, list[FlownPassage]]) -> tuple[Claim, ...]:
    launches = by_kind[LAUNCH]
    good = [each for each in launches if each.soars or each.landed]
    promised = [
        each for kind in (LAND, WITH_IMU, LULLED) for each in by_kind[kind] if each.left_m >= 0.0
    ]
    landed = [each for each in promised if each.landed]
    lulls = by_kind[LULLED]
    safe = [each for each in lulls if each.soars or (each.broke_off and each.landed)]
    soared = sum(each.soars for each in lulls)
    touched = (
        f"within {ALONG_M:g} m along, {ACROSS_M:g} m across, at {SINK_MPS:g} m/s of sink or less"
    )
    return (
        decided(
            f"of launches {100 * CAPTURED:g} % or more are captured, or given up and touch down"
            f" {touched}",
            shown(len(good), len(launches), CAPTURED),
            f"{fraction_text(len(good), len(launches))}; captured {sum(e.soars for e in launches)},"
            f" given up {sum(e.broke_off for e in launches)}",
        ),
        decided(
            f"of break-offs with height left {100 * LANDED:g} % or more touch down {touched}",
            shown(len(landed), len(promised), LANDED),
            fraction_text(len(landed), len(promised)),
        ),
        decided(
            f"in a lull to {LULL:g} of the wind {100 * LANDED:g} % or more soar on, or break off by"
            " themselves and touch down so",
            shown(len(safe), len(lulls), LANDED),
            f"{fraction_text(len(safe), len(lulls))}; soared on {soared}, landed"
            f" {len(safe) - soared}",
        ),
    )


def shown(count: int, of: int, least: float) -> bool | None:
    """Whether so large a share is: all of its interval lies there; None where only the share that
    was counted does."""
    if not of or count < least * of:
        return False
    return True if interval(count, of)[0] >= least else None


def _launches(flown: list[FlownPassage]) -> Table:
    captured = [each for each in flown if each.soars]
    given_up = [each for each in flown if each.broke_off]
    others = [each for each in flown if not each.soars and not each.broke_off]
    rows = [
        (name, f"{len(some)}", *(span([get(e) for e in some]) for get in _LAUNCH_COLUMNS.values()))
        for name, some in (
            ("captured", captured),
            ("given up, of these landed", given_up),
            ("lost or disengaged", others),
        )
    ]
    return Table("Launches", ("", "flights", *_LAUNCH_COLUMNS), tuple(rows))


_LAUNCH_COLUMNS: Final[dict[str, Callable[[FlownPassage], float]]] = {
    "throw [m/s]": lambda each: each.throw_mps,
    "pitch [°]": lambda each: each.throw_pitch_deg,
    "until soaring or broken off [s]": lambda each: (
        each.modes[-1][0] - THROW_S
        if each.soars
        else next((t for t, mode, _ in each.modes if mode == MODE_NAMES[BREAKING_OFF]), nan)
        - THROW_S
    ),
    "least clearance from 1 s after [m]": lambda each: each.over_ground_m,
    "landing: along [m]": lambda each: each.along_m if each.broke_off else nan,
}


def _landings(by_kind: dict[str, list[FlownPassage]]) -> Table:
    rows = []
    for name, some in (
        ("by command, height left", [e for e in by_kind[LAND] if e.left_m >= 0.0]),
        ("by command, less than promised", [e for e in by_kind[LAND] if e.left_m < 0.0]),
        ("with accelerometers, height left", [e for e in by_kind[WITH_IMU] if e.left_m >= 0.0]),
        ("with accelerometers, less", [e for e in by_kind[WITH_IMU] if e.left_m < 0.0]),
        ("by itself in a lull", [e for e in by_kind[LULLED] if e.broke_off]),
        ("launches given up", [e for e in by_kind[LAUNCH] if e.broke_off]),
    ):
        rows.append(
            (
                name,
                fraction_text(sum(e.landed for e in some), len(some)),
                span([e.left_m for e in some]),
                span([e.broke_at_m for e in some]),
                span([e.along_m for e in some]),
                span([e.across_m for e in some]),
                span([e.sink_mps for e in some], 2),
            )
        )
    columns = (
        "break-off", "touched down as it should", "height left [m]", "from [m]", "along [m]",
        "across [m]", "sink [m/s]",
    )  # fmt: skip
    return Table("Landings: least, median, most", columns, tuple(rows))


def is_lost(ended: str, landing: bool, sink_mps: float) -> bool:
    """It hit something, and was not landing, or landing it hit the ground harder than it may.

    SINK_MPS is the fall from 0.11 m, of those landings that end as they should: it is no limit of a
    structure, which nobody has tested, and counts more as lost than may have broken.
    """
    soft = landing and sink_mps <= SINK_MPS
    return bool(ended) and not ended.startswith("disengaged") and not soft


def span(values: list[float], digits: int = 1) -> str:
    """Least, median and most of the numbers that are known."""
    known = [value for value in values if isfinite(value)]
    if not known:
        return "–"
    low, middle, high = np.percentile(known, [0, 50, 100])
    return f"{low:.{digits}f}, {middle:.{digits}f}, {high:.{digits}f}"


class NearLift(Protocol):
    """A flight that knows how far it was off its lift."""

    @property
    def off_m(self) -> float: ...  # at most

    @property
    def within(self) -> float: ...  # of `share_within`

    @property
    def gone(self) -> bool: ...  # lost, or disengaged


def fraction_within(offs_m: list[float]) -> float:
    """The share of the ticks within WITHIN_M."""
    return sum(abs(off) <= WITHIN_M for off in offs_m) / max(1, len(offs_m))


def stays_claim(kind: str, flown: Sequence[NearLift]) -> Claim:
    """Whether every flight stayed within WITHIN_M of its lift, to the end."""
    near = sum(each.off_m <= WITHIN_M and not each.gone for each in flown)
    of_time = sum(each.within for each in flown) / max(1, len(flown))
    return Claim(
        f"{kind}: the aircraft stays within {WITHIN_M:g} m of its lift",
        near == len(flown),
        f"{fraction_text(near, len(flown))} of flights at every instant, {100 * of_time:.0f} %"
        " of the time",
    )


class Ended(Protocol):
    """A flight that knows how it ended; "": it flew to the end."""

    @property
    def ended(self) -> str: ...


def ends_by_kind(by_kind: Mapping[str, Sequence[Ended]]) -> str:
    """How the flights ended that ended early, the most frequent end of each kind first."""
    lines = []
    for kind, some in by_kind.items():
        ends = Counter(each.ended for each in some if each.ended)
        lines += [f"{kind}: {end} ({count})" for end, count in ends.most_common()]
    return "; ".join(lines)


def _badly(flown: list[FlownPassage]) -> tuple[str, ...]:
    """Every flight that did not end as it should."""
    bad = [each for each in flown if not each.soars and not each.landed]
    lines = []
    for each in bad:
        modes = ", ".join(f"{t:.0f} s {mode} ({why})" for t, mode, why in each.modes[3:])
        lines.append(
            f"{each.kind} {each.seed} ({each.wind_mps:.2f} m/s, {100 * each.intensity:.0f} %):"
            f" {modes}; {each.ended or 'flies'}, along {each.along_m:.1f} m, across"
            f" {each.across_m:.1f} m, sink {each.sink_mps:.2f} m/s, height left {each.left_m:.1f} m"
        )
    return tuple(lines)


def _numbers(each: FlownPassage) -> dict[str, object]:
    keep = (
        "kind", "seed", "wind_mps", "intensity", "throw_mps", "throw_pitch_deg",
        "throw_heading_deg", "modes", "ended", "left_m", "broke_at_m", "over_ground_m", "along_m",
        "across_m", "sink_mps",
    )  # fmt: skip
    return {name: getattr(each, name) for name in keep}
