"""`hour`: up to an hour on a hill in a wind that turns, dies and comes again, and home in time.

Each flight has a synthetic record of its own (`air.wind_record`: the surface-layer spectra of
Kaimal and others below 0.05 Hz, four lulls an hour of 10 to 30 % of the mean, a slow veer of 20
degrees to either side) over a half cylinder, gusts of 3 % and accelerometers; no pitot tube.  The
line stands still, the nose follows the wind (`VEER_MAX`), and the module has leave to break off
(`ESC_AUTO`): in a wind that is slow for the site with 1, in one that is fast for its landing place
with 1 and with 2, which waits there.  Beside it is what a path soars from the same place that knows
the wind to come (`hour_bound`): what nobody can is not held against it.

Baselines, in the first of the same winds: the same with a propeller to fall back on, and AOSoar's
walk with it (`hour_walk`); both may use `BUDGET_S` of full throttle.  The walk knows no way home,
so that beside it the line has none either (`ESC_AUTO` 0).

Two hills of potential flow: the shipped one of 8 m, and one of 30 m, whose lines, fence and air are
those of the first by 30 / 8 and whose landing place is 50 m before its foot: what a lull costs in
height the first does not have.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from math import degrees, isfinite, nan
from pathlib import Path
from statistics import fmean
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np

from tgl_soar.air.hill import HillField
from tgl_soar.air.wind_record import RecordedField, SyntheticWind, WindRecord, synthetic_record
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.outdoors.hour_bound import (
    SoaredHill,
    longest_s,
    soarable_fraction,
    wind_across,
)
from tgl_soar.analysis.experiments.outdoors.hour_walk import walked
from tgl_soar.analysis.experiments.outdoors.outdoors import (
    ALREADY,
    is_lost,
    span,
)
from tgl_soar.analysis.experiments.outdoors.shipped_hill import BELOW_M, ShippedHill, shipped_hill
from tgl_soar.analysis.experiments.random_aircraft import (
    AS_FILED,
    drawn_mismatch,
    flown_world,
    mismatched_figures,
)
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.flown_airframe import flown_airframe
from tgl_soar.analysis.search.scoring import fraction_text
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import HillAir, Site, Start
from tgl_soar.control.laws import fence_of
from tgl_soar.control.supervisor import BREAKING_OFF, LANDING, SOARING
from tgl_soar.control.supervisor_texts import MODE_NAMES
from tgl_soar.sim.aircraft import AircraftModel, glide_polar
from tgl_soar.sim.closed_loop import Trajectory, fly
from tgl_soar.sim.compiled import available
from tgl_soar.sim.compiled_flight import fly_compiled, prepare
from tgl_soar.sim.score import SINK_MPS, touches_down_well
from tgl_soar.sim.sensors import MEMS_IMU, Sensors
from tgl_soar.sim.world import World, flown_aircraft
from tgl_soar.types import GlidePolar

SOARED_LINE: Final = "a"
FLIGHTS: Final = 100
DISPERSED_FLIGHTS: Final = 50  # and no baselines: all of it again takes half an hour more
QUICK: Final = 1
FIRST_SEED: Final = 9201  # 9001 to 9008 were flown in 8 m/s, 9101 to 9110 before
HOUR_S: Final = 3600.0
# Winds on average [m/s], and ESC_AUTO. The site is made for 7 m/s, and the slowest flight needs 6;
# against 9 m/s the landing place is out of reach.
FLOWN: Final = ((7.0, 1), (9.0, 1), (9.0, 2))
INTENSITY: Final = 0.03
RADII_M: Final = (8.0, 30.0)  # the first is the shipped one
BEFORE_M: Final = 50.0  # the larger hill's landing place before its foot
# Who flies.
LINE: Final = "the line"
POWERED: Final = "the line, propeller"
WALK: Final = "AOSoar's walk, propeller"
BEATS: Final = "the line, or beating"
COMPARED: Final = tuple(
    (mean, *each) for mean in (7.0, 9.0) for each in ((0, POWERED), (0, WALK), (2, POWERED))
)
COMPARED_FLIGHTS: Final = 25  # of each
BUDGET_S: Final = 600.0  # as much as may be set: ten minutes of full throttle in an hour
PROPELLER: Final = "eclipson_c_propeller"
BEAT_WIDTH_M: Final = 100.0  # to either side, and the fence: of a ridge that long
BEAT_FENCE_M: Final = 150.0
# The nose may turn by twice the veer that is laid over the record: its spectra add to that.
VEER_MAX_DEG: Final = 45.0
SCALED: Final = ("FENCE_X_MIN", "FENCE_X_MAX", "FENCE_Y_MAX", "FENCE_Z_MAX", "ESC_X", "WPT_X")


class HourCase(NamedTuple):
    """What a row of the table flies."""

    radius_m: float
    mean_mps: float = 7.0
    auto: int = 1  # ESC_AUTO
    who: str = LINE


class HourJob(NamedTuple):
    """One flight to be flown."""

    case: HourCase
    seed: int
    duration_s: float = HOUR_S
    dispersed: bool = False  # another aircraft than the file's, and other gusts


@dataclass(frozen=True)
class FlownHour:
    """One flight, from its seed."""

    case: HourCase
    seed: int
    duration_s: float
    possible_s: float  # a path that knows the wind to come
    soarable: float  # share of the time asked for, in which some place could be soared
    soared_s: float  # until it broke off, or ended otherwise
    ended: str  # what it hit, or why the module disengaged; "": it flew to the end
    left_m: float  # the height left when it broke off; NaN: it did not
    broke_at_m: float  # the height over the landing place, there
    wind_mps: float  # of the record then, or the least of the flight where it did not break off
    veer_deg: float  # the most that it had turned by then, to either side
    along_m: float  # beyond the landing point, where it touched the ground
    across_m: float
    sink_mps: float
    landing: bool  # it ended so
    throttle_s: float = 0.0  # of full throttle

    @property
    def lost(self) -> bool:
        """As `outdoors` has it."""
        return is_lost(self.ended, self.landing, self.sink_mps)

    @property
    def landed(self) -> bool:
        """It touched down as it should."""
        return self.landing and touches_down_well(self.along_m, self.across_m, self.sink_mps)


def record_of(job: HourJob) -> WindRecord:
    """The wind of a flight."""
    return synthetic_record(SyntheticWind(mean_mps=job.case.mean_mps), job.seed)


def _hill_of(case: HourCase) -> ShippedHill:
    return shipped_hill() if case.who in (LINE, BEATS) else shipped_hill(PROPELLER)


class HourFlown(NamedTuple):
    """What flies in an hour, where, and with which parameters."""

    airframe: Airframe
    site: Site
    values: ParameterSet


def hour_flown(job: HourJob, veer_max_deg: float = VEER_MAX_DEG) -> HourFlown:
    """The aircraft, the hill and the parameters of a flight."""
    hill = _hill_of(job.case).on_line(SOARED_LINE)
    site, values = hill.site, hill.values
    assert site.ground is not None
    by = job.case.radius_m / hill.air.radius_m
    changes = {"ESC_AUTO": float(job.case.auto), "VEER_MAX": veer_max_deg}
    if job.case.who == BEATS:
        changes["BEAT_AUTO"] = 2.0
    elif job.case.who != LINE:
        changes["THR_BUDGET"] = BUDGET_S
    if by != 1.0:
        x, z = values["TGL_X"] * by, values["TGL_Z"] * by
        changes |= {name: values[name] * by for name in SCALED}
        changes |= {"TGL_X": x, "TGL_Z": z, "LND_X": -job.case.radius_m - BEFORE_M}
        profile = [(a * by, b * by) for a, b in site.ground.profile]
        site = msgspec.structs.replace(
            site,
            ground=msgspec.structs.replace(site.ground, profile=profile),
            air=msgspec.structs.replace(hill.air, radius_m=job.case.radius_m),
            start=Start(x_m=x, z_m=z - BELOW_M),
        )
    if job.case.who == BEATS:
        changes |= {"FENCE_Y_MAX": BEAT_FENCE_M, "BEAT_WIDTH": BEAT_WIDTH_M}
    return HourFlown(airframe=hill.airframe, site=site, values=values.changed(changes))


def field_of(flown: HourFlown, record: WindRecord) -> RecordedField:
    """The air of a record over its hill."""
    air = flown.site.air
    assert isinstance(air, HillAir)
    return RecordedField(HillField(air.wind_mps, air.radius_m), record)


def _world_of(job: HourJob, flown: HourFlown, record: WindRecord) -> World:
    return flown_world(
        flown.airframe,
        flown.site,
        job.seed,
        dispersed=job.dispersed,
        already=ALREADY,
        turbulence=INTENSITY,
        field=field_of(flown, record),
        sensors=Sensors(imu=MEMS_IMU),
    )


def path_of(
    job: HourJob, record: WindRecord, veer_max_deg: float = VEER_MAX_DEG
) -> tuple[Trajectory, ParameterSet]:
    """The whole flight, and with which parameters."""
    what = hour_flown(job, veer_max_deg)
    world, values = _world_of(job, what, record), what.values
    if job.case.who == WALK:
        polar = what.airframe.polar.as_polar()
        return walked(world, values, polar, job.duration_s, job.seed), values
    if available():
        return fly_compiled(prepare(world, job.duration_s), job.seed, values, ()), values
    return fly(world, values, (), job.duration_s), values


def hill_of(job: HourJob, values: ParameterSet) -> SoaredHill:
    """The hill as the bounds know it, in the flow that blows over it."""
    drawn = drawn_mismatch(job.seed, ALREADY) if job.dispersed else AS_FILED
    return SoaredHill(
        radius_m=job.case.radius_m,
        fence=fence_of(values),
        clearance_m=values["CLEAR_MIN"],
        polar=_polar_of(job),
        flow_radius=drawn.hill_radius,
        growth=drawn.hill_growth,
    )


def _polar_of(job: HourJob) -> GlidePolar:
    """Of the aircraft that flies: the file's, or as the file's was fitted to its glides."""
    airframe = _hill_of(job.case).airframe
    if not job.dispersed:
        return airframe.polar.as_polar()
    figures = mismatched_figures(airframe, drawn_mismatch(job.seed, ALREADY))
    model = flown_aircraft(flown_airframe(airframe, figures))
    assert isinstance(model, AircraftModel)  # `mismatched_figures` are of no other
    return glide_polar(model)


def fly_hour(job: HourJob) -> FlownHour:
    """Fly one of them.  Errors: `ConfigError`."""
    record = record_of(job)
    flown, values = path_of(job, record)
    hill, across = hill_of(job, values), wind_across(record, job.duration_s)
    mode, times = flown["mode"], flown["time_s"]
    home = np.flatnonzero(mode == BREAKING_OFF)
    broke = int(home[0]) if len(home) else -1
    soared_s = float(times[broke])
    before = np.arange(0.0, soared_s, 1.0)
    winds = [record.wind_mps.at(t) for t in before]
    x, y, z = (float(flown[name][-1]) for name in ("x_m", "y_m", "z_m"))
    sink = (flown["z_m"][-2] - z) / (times[-1] - times[-2])
    return FlownHour(
        case=job.case,
        seed=job.seed,
        duration_s=float(times[-1]),
        possible_s=longest_s(hill, across, values["TGL_X"], values["TGL_Z"]),
        soarable=soarable_fraction(hill, across),
        soared_s=soared_s,
        ended=flown.ended.partition(" at x")[0],
        left_m=float(flown["height_left_m"][broke]) if broke >= 0 else nan,
        broke_at_m=float(flown["z_m"][broke]) - values["LND_Z"] if broke >= 0 else nan,
        wind_mps=record.wind_mps.at(soared_s) if broke >= 0 else min(winds),
        veer_deg=degrees(max((abs(record.veer_rad.at(t)) for t in before), default=0.0)),
        along_m=values["LND_X"] - x,
        across_m=y - values["LND_Y"],
        sink_mps=float(sink),
        landing=int(mode[-1]) == LANDING and "ground" in flown.ended,
        throttle_s=float(flown["throttle"].sum() * (times[1] - times[0])),
    )


def run(context: Context) -> Result:
    """Fly them, tabulate, draw one."""
    usual = DISPERSED_FLIGHTS if context.dispersion else FLIGHTS
    count = QUICK if context.quick else context.episodes or usual
    seeds = range(FIRST_SEED, FIRST_SEED + count)
    duration_s = HOUR_S / 20.0 if context.quick else HOUR_S
    asked = [(mean, auto, LINE) for mean, auto in FLOWN]
    asked += [] if context.dispersion else COMPARED
    cases = [HourCase(radius, *each) for radius in RADII_M for each in asked]
    few = seeds[:COMPARED_FLIGHTS]
    jobs = [
        HourJob(case, seed, duration_s)
        for case in cases
        for seed in (seeds if case.who == LINE else few)
    ]
    flown = context.each(fly_hour, jobs)
    by_case = {case: [each for each in flown if each.case == case] for case in cases}
    figures: tuple[str, ...] = ()
    if context.figures is not None:
        path = context.figures / "hour.png"
        drawn = HourCase(RADII_M[-1], *FLOWN[-1])
        draw_hour(path, HourJob(drawn, drawn_seed(by_case[drawn]), duration_s))
        figures = (path.name,)
    return Result(
        name="hour",
        title="up to an hour in a wind that turns, dies and comes again",
        flown=f"{count} flights for each row of the line, {DISPERSED_FLIGHTS} where dispersed, and"
        f" {len(few)} for each with a propeller,"
        f" over half cylinders of {RADII_M[0]:g} and"
        f" {RADII_M[1]:g} m,"
        " each in a synthetic wind of its own: the spectra of Kaimal and"
        " others below 0.05 Hz, lulls by 10 to 30 %, veer of 20° to either side; gusts of"
        f" {100 * INTENSITY:g} %. The line stands still. *Possible* is a path on no line that knows"
        " the wind to come; *soarable* the share of the hour in which there is any place. With"
        " accelerometers, without a pitot tube. With `ESC_AUTO` 1 it breaks off where the landing"
        " place would get out of reach; with 2 it waits there as long as it soars. A propeller may"
        f" be used for {BUDGET_S:g} s of full throttle.",
        claims=_claims(flown),
        why=_why(flown),
        tables=(_table(by_case),),
        numbers={"flights": [each.__dict__ for each in flown]},
        figures=figures,
        seeds=tuple(seeds),
    )


def drawn_seed(flown: list[FlownHour]) -> int:
    """Of the flight that soared longest among those that had to break off."""
    home = [each for each in flown if isfinite(each.left_m)] or flown
    return max(home, key=lambda each: each.soared_s).seed


def _claims(every: list[FlownHour]) -> tuple[Claim, ...]:
    flown = [each for each in every if each.case.who == LINE]
    lost = sum(each.lost for each in flown)
    disengaged = sum(each.ended.startswith("disengaged") for each in flown)
    left = [each for each in flown if isfinite(each.left_m)]
    landed = sum(each.landed for each in left)
    windy = [each for each in flown if each.case.mean_mps == FLOWN[-1][0]]
    waited = sum(each.lost for each in windy if each.case.auto == 2)
    left_at_once = sum(each.lost for each in windy if each.case.auto == 1)
    least = min((each.left_m for each in left), default=nan)
    return (
        Claim(
            f"none hits anything before it lands, nor the ground at more than {SINK_MPS:g} m/s of"
            " sink",
            lost == 0,
            f"{fraction_text(lost, len(flown))} lost",
        ),
        Claim(
            "every lull that the line does not survive is left by itself",
            disengaged == 0,
            f"{len(left)} broke off, {disengaged} were disengaged, with the least height left"
            f" {least:.1f} m",
        ),
        Claim(
            "of those that broke off 95 % or more touch down as they should",
            bool(left) and landed >= 0.95 * len(left),  # of none it shows nothing
            fraction_text(landed, len(left)) if left else "none broke off",
        ),
        Claim(
            "who waits loses no more",
            waited <= left_at_once,
            f"{waited} with `ESC_AUTO` 2, {left_at_once} in the same wind with 1",
        ),
        *([_beside_the_walk(every)] if len(every) > len(flown) else []),
    )


def _beside_the_walk(flown: list[FlownHour]) -> Claim:
    """Who holds a line has no less of the hour than who walks, and needs no more power for it."""

    def of(who: str) -> tuple[float, float, int]:
        some = [each for each in flown if each.case.who == who and each.case.auto == 0]
        minutes = fmean(each.soared_s for each in some) / 60.0 if some else nan
        used = fmean(each.throttle_s for each in some) if some else nan
        return minutes, used, sum(each.lost for each in some)

    (ours_min, ours_s, ours_lost), (walk_min, walk_s, walk_lost) = of(POWERED), of(WALK)
    return Claim(
        "with the same propeller, and no way home, the line soars as long as AOSoar's walk, with no"
        " more throttle and no more losses",
        ours_min >= walk_min and ours_s <= walk_s and ours_lost <= walk_lost,
        f"{ours_min:.1f} and {walk_min:.1f} min, {ours_s:.0f} and {walk_s:.0f} s of full throttle"
        f" on average, {ours_lost} and {walk_lost} lost",
    )


def _table(by_case: dict[HourCase, list[FlownHour]]) -> Table:
    rows = []
    for case, some in by_case.items():
        home = [each for each in some if isfinite(each.left_m)]
        rows.append(
            (
                f"{case.radius_m:g}",
                f"{case.mean_mps:g}",
                f"{case.auto}",
                case.who,
                f"{len(some)}",
                f"{sum(not each.ended for each in some)}",
                f"{len(home)}",
                f"{sum(each.landed for each in home)}",
                f"{sum(each.ended.startswith('disengaged') for each in some)}",
                f"{sum(each.lost for each in some)}",
                span([each.soared_s / 60.0 for each in some]),
                f"{fmean(each.soared_s for each in some) / 60.0:.1f}",
                f"{fmean(each.possible_s for each in some) / 60.0:.1f}",
                f"{100.0 * fmean(each.soarable for each in some):.1f} %",
                "–" if case.who == LINE else span([each.throttle_s for each in some], 0),
                span([each.left_m for each in home]),
                span([each.broke_at_m for each in home]),
                span([each.wind_mps for each in home]),
                span([each.along_m for each in home]),
                span([each.across_m for each in home]),
                span([each.sink_mps for each in home], 2),
            )
        )
    columns = (
        "hill [m]", "wind, mean [m/s]", "`ESC_AUTO`", "who", "flights", "soared to the end",
        "broke off", "landed as they should", "disengaged", "lost", "soared [min]", "mean",
        "possible [min], mean", "soarable", "throttle [s]",
        "height left then [m]",
        "from [m]", "wind then [m/s]", "along [m]", "across [m]", "sink [m/s]",
    )  # fmt: skip
    return Table("An hour: least, median, most", columns, tuple(rows))


def _why(flown: list[FlownHour]) -> str:
    """How those ended that neither soared on nor landed."""
    bad = [each for each in flown if each.ended and not each.landed]
    ends = Counter(
        f"{each.case.radius_m:g} m, {each.case.mean_mps:g} m/s, {each.case.auto},"
        f" {each.case.who}: {each.ended}" + (" (landing)" if each.landing else "")
        for each in bad
    )
    return "; ".join(f"{end}: {count}" for end, count in ends.most_common())


def draw_hour(path: Path, job: HourJob) -> None:
    """Wind, veer, place and height left of one flight.  Errors: ImportError without matplotlib."""
    from tgl_soar.analysis.report.figure_style import PALETTE, drawing, save

    record = record_of(job)
    flown, _ = path_of(job, record)
    every = slice(None, None, 200)  # a second
    minutes = flown["time_s"][every] / 60.0
    seconds = flown["time_s"][every].tolist()
    mode = flown["mode"][every]
    rows: list[tuple[str, Any]] = [
        ("wind [m/s]", [record.wind_mps.at(t) for t in seconds]),
        ("veer [°]", [degrees(record.veer_rad.at(t)) for t in seconds]),
        ("height z [m]", flown["z_m"][every]),
        ("height left [m]", flown["height_left_m"][every]),
    ]
    with drawing() as plt:
        figure, axes = plt.subplots(4, 1, figsize=(9.0, 7.2), sharex=True, layout="constrained")
        for axis, (label, values), colour in zip(axes, rows, PALETTE, strict=False):
            axis.plot(minutes, values, color=colour, lw=0.9)
            axis.set_ylabel(label)
            axis.fill_between(
                minutes, 0, 1, where=(mode == BREAKING_OFF) | (mode == LANDING), color="0.85",
                transform=axis.get_xaxis_transform(),
            )  # fmt: skip
        axes[2].plot(minutes, flown["x_m"][every], color="0.5", lw=0.8)
        axes[2].set_ylabel("z, and x (grey) [m]")
        axes[3].axhline(0.0, color="k", lw=0.8)
        soared = np.count_nonzero(mode == SOARING) / 60.0
        axes[0].set_title(
            f"hill of {job.case.radius_m:g} m, {job.case.mean_mps:g} m/s on average, seed"
            f" {job.seed}: {MODE_NAMES[SOARING]} for {soared:.0f}"
            " min; shaded: on the way home"
        )
        axes[-1].set_xlabel("time [min]")
        save(plt, figure, path)
