"""beating: along the ridge, where the wind is too slow or too oblique to stand in.

The winds of `hour`, of other seeds: each flown twice by the same aircraft with the same way home,
by who breaks off where it cannot stand, and by who may beat (BEAT_AUTO).  And a steady wind that
turns by more than the nose may follow, and stays there: who cannot beat stands with a sideslip.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from math import isfinite, nan, radians
from pathlib import Path
from random import Random
from statistics import fmean
from typing import Any, Final, NamedTuple

import numpy as np

from tgl_soar.air.gusts import Schedule
from tgl_soar.air.wind_record import WindRecord
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.outdoors.hour import (
    BEAT_WIDTH_M,
    BEATS,
    HOUR_S,
    INTENSITY,
    LINE,
    RADII_M,
    VEER_MAX_DEG,
    HourCase,
    HourJob,
    path_of,
    record_of,
)
from tgl_soar.analysis.experiments.outdoors.outdoors import (
    is_lost,
    span,
)
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.search.scoring import fraction_text
from tgl_soar.control.supervisor import BEATING, BREAKING_OFF, LANDING, SOARING
from tgl_soar.control.supervisor_texts import MODE_NAMES
from tgl_soar.sim.score import SINK_MPS, touches_down_well

FLIGHTS: Final = 100
DISPERSED_FLIGHTS: Final = 25
QUICK: Final = 1
FIRST_SEED: Final = 9401  # 9201 to 9208 were looked at while this was built
HOURS_MPS: Final = (7.0, 9.0)  # on average
AUTO: Final = 2  # ESC_AUTO: as long as the air carries it need not be in reach of home
# A wind that turns and stays: as strong as standing wants it, from farther aside than VEER_MAX by
# 20 to 35 degrees, within half a minute.
OBLIQUE_MPS: Final = 8.0
OBLIQUE_MAX_DEG: Final = 25.0
OBLIQUE_DEG: Final = (45.0, 60.0)
OBLIQUE_BEGINS_S: Final = (10.0, 30.0)
OBLIQUE_DEGPS: Final = 2.0
OBLIQUE_S: Final = 600.0
LULLS, OBLIQUE = "lulls and veer", "too oblique"


class BeatJob(NamedTuple):
    """One flight to be flown."""

    kind: str
    case: HourCase
    seed: int
    duration_s: float
    dispersed: bool = False


@dataclass(frozen=True)
class BeatFlight:
    """One flight, from its seed."""

    kind: str
    case: HourCase
    seed: int
    duration_s: float
    aloft_s: float  # soaring or beating, until it broke off, or ended otherwise
    beating_s: float
    turns: int  # from one side of the wind to the other, while it beat
    least_m: float  # height over the foot while it beat; NaN: it did not
    ended: str  # what it hit, or why the module disengaged; "": it flew to the end
    left_m: float  # the height left when it broke off; NaN: it did not
    along_m: float  # beyond the landing point, where it touched the ground
    across_m: float
    sink_mps: float
    landing: bool  # it ended so

    @property
    def broke_off(self) -> bool:
        """It went home."""
        return isfinite(self.left_m)

    @property
    def lost(self) -> bool:
        """As `outdoors` has it."""
        return is_lost(self.ended, self.landing, self.sink_mps)

    @property
    def landed(self) -> bool:
        """It touched down as it should."""
        return self.landing and touches_down_well(self.along_m, self.across_m, self.sink_mps)


def wind_of(job: BeatJob) -> WindRecord:
    """The wind of a flight."""
    if job.kind == LULLS:
        return record_of(HourJob(job.case, job.seed))
    dice = Random(f"beating {job.seed}")
    begins_s = dice.uniform(*OBLIQUE_BEGINS_S)
    veer_deg = dice.choice((-1.0, 1.0)) * dice.uniform(*OBLIQUE_DEG)
    ends_s = begins_s + abs(veer_deg) / OBLIQUE_DEGPS
    veer = Schedule((0.0, begins_s, ends_s), (0.0, 0.0, radians(veer_deg)))
    return WindRecord(Schedule((0.0,), (OBLIQUE_MPS,)), veer)


def _path(job: BeatJob) -> tuple[Any, Any]:
    hour = HourJob(job.case, job.seed, job.duration_s, job.dispersed)
    most_deg = OBLIQUE_MAX_DEG if job.kind == OBLIQUE else VEER_MAX_DEG
    return path_of(hour, wind_of(job), most_deg)


def fly_beating(job: BeatJob) -> BeatFlight:
    """Fly one of them.  Errors: `ConfigError`."""
    flown, values = _path(job)
    mode, times, heading = flown["mode"], flown["time_s"], flown["heading_rad"]
    home = np.flatnonzero(mode == BREAKING_OFF)
    broke = int(home[0]) if len(home) else -1
    beats = mode == BEATING
    turned = np.sign(heading[beats])
    x, y, z = (float(flown[name][-1]) for name in ("x_m", "y_m", "z_m"))
    return BeatFlight(
        kind=job.kind,
        case=job.case,
        seed=job.seed,
        duration_s=float(times[-1]),
        aloft_s=float(times[broke]),
        beating_s=float(beats.sum() * (times[1] - times[0])),
        turns=int(np.count_nonzero(np.diff(turned[:: round(1.0 / (times[1] - times[0]))]))),
        least_m=float(flown["z_m"][beats].min()) if beats.any() else nan,
        ended=flown.ended.partition(" at x")[0],
        left_m=float(flown["height_left_m"][broke]) if broke >= 0 else nan,
        along_m=values["LND_X"] - x,
        across_m=y - values["LND_Y"],
        sink_mps=float((flown["z_m"][-2] - z) / (times[-1] - times[-2])),
        landing=int(mode[-1]) == LANDING and "ground" in flown.ended,
    )


def cases() -> tuple[tuple[str, HourCase, float], ...]:
    """(kind, case, duration [s]) of each row."""
    hours = [
        (LULLS, HourCase(radius, mean, AUTO, who), HOUR_S)
        for radius in RADII_M
        for mean in HOURS_MPS
        for who in (LINE, BEATS)
    ]
    aside = [
        (OBLIQUE, HourCase(RADII_M[-1], OBLIQUE_MPS, AUTO, who), OBLIQUE_S) for who in (LINE, BEATS)
    ]
    return (*hours, *aside)


def run(context: Context) -> Result:
    """Fly them, tabulate, draw one."""
    usual = DISPERSED_FLIGHTS if context.dispersion else FLIGHTS
    count = QUICK if context.quick else context.episodes or usual
    seeds = range(FIRST_SEED, FIRST_SEED + count)
    shorter = 20.0 if context.quick else 1.0
    jobs = [
        BeatJob(
            kind=kind,
            case=case,
            seed=seed,
            duration_s=duration_s / shorter,
            dispersed=context.dispersion,
        )
        for kind, case, duration_s in cases()
        for seed in seeds
    ]
    flown = context.each(fly_beating, jobs)
    figures: tuple[str, ...] = ()
    if context.figures is not None:
        path = context.figures / "beating.png"
        draw_beating(path, drawn_job(flown))
        figures = (path.name,)
    return Result(
        name="beating",
        title="along the ridge, where it cannot stand",
        flown=f"{count} flights for each row over half cylinders of {RADII_M[0]:g} and"
        f" {RADII_M[1]:g} m, up to an hour each in winds as `hour` has them, of other seeds;"
        f" and ten minutes in {OBLIQUE_MPS:g} m/s that turn by {OBLIQUE_DEG[0]:g} to"
        f" {OBLIQUE_DEG[1]:g}°, where the nose may follow by {OBLIQUE_MAX_DEG:g}°. Each is flown"
        f" by who cannot beat and by who may, {BEAT_WIDTH_M:g} m to either side; `ESC_AUTO`"
        f" {AUTO}; gusts of {100 * INTENSITY:g} %. With accelerometers, without a pitot tube.",
        claims=_claims(flown),
        why=_why(flown),
        tables=(_table(flown),),
        numbers={"flights": [each.__dict__ for each in flown]},
        figures=figures,
        seeds=tuple(seeds),
    )


def _of(flown: list[BeatFlight], kind: str, case: HourCase) -> list[BeatFlight]:
    return [each for each in flown if each.kind == kind and each.case == case]


def _claims(flown: list[BeatFlight]) -> tuple[Claim, ...]:
    # A claim of flights of which there are none does not hold: nothing flown shows nothing.
    lost = sum(each.lost for each in flown)
    may_beat = [each for each in flown if each.case.who == BEATS]
    beat = [each for each in may_beat if each.beating_s > 0.0]
    home = [each for each in beat if each.broke_off]
    landed = sum(each.landed for each in home)
    large = RADII_M[-1]

    def minutes(mean_mps: float, who: str) -> float:
        some = _of(flown, LULLS, HourCase(large, mean_mps, AUTO, who))
        return fmean(each.aloft_s for each in some) / 60.0 if some else nan

    both = [(minutes(mean, LINE), minutes(mean, BEATS)) for mean in HOURS_MPS]
    aside = [each for each in may_beat if each.kind == OBLIQUE]
    stays = sum(not each.ended for each in aside)
    gone = sum(each.ended.startswith("disengaged") for each in beat)
    return (
        Claim(
            f"none hits anything before it lands, nor the ground at more than {SINK_MPS:g} m/s of"
            " sink",
            bool(flown) and lost == 0,
            f"{fraction_text(lost, len(flown))} lost",
        ),
        # A lull is some minutes long, and there are four an hour: who sits them out has three times
        # as long at the least, in a wind that is mostly fast enough.
        Claim(
            f"over the hill of {large:g} m who may beat stays up three times as long, in each wind",
            all(beats >= 3.0 * line for line, beats in both),
            "; ".join(
                f"{mean:g} m/s: {line:.1f} and {beats:.1f} min"
                for mean, (line, beats) in zip(HOURS_MPS, both, strict=True)
            ),
        ),
        Claim(
            "where the wind is too oblique to stand in, who may beat is still up after ten minutes",
            0 < len(aside) == stays,
            fraction_text(stays, len(aside)) if aside else "none flown",
        ),
        Claim(
            "who beats is not disengaged in the air",
            bool(beat) and gone == 0,
            fraction_text(gone, len(beat)) if beat else "none beat",
        ),
        Claim(
            "of those that beat and broke off 95 % or more touch down as they should",
            bool(home) and landed >= 0.95 * len(home),
            fraction_text(landed, len(home)) if home else "none broke off",
        ),
    )


def _table(flown: list[BeatFlight]) -> Table:
    rows = []
    for kind, case, _ in cases():
        some = _of(flown, kind, case)
        home = [each for each in some if each.broke_off]
        beats = [each for each in some if each.beating_s > 0.0]
        rows.append(
            (
                kind,
                f"{case.radius_m:g}",
                f"{case.mean_mps:g}",
                case.who,
                f"{len(some)}",
                f"{sum(not each.ended for each in some)}",
                f"{len(home)}",
                f"{sum(each.landed for each in home)}",
                f"{sum(each.ended.startswith('disengaged') for each in some)}",
                f"{sum(each.lost for each in some)}",
                span([each.aloft_s / 60.0 for each in some]),
                f"{fmean(each.aloft_s for each in some) / 60.0:.1f}" if some else "–",
                span([each.beating_s / 60.0 for each in beats]),
                span([float(each.turns) for each in beats], 0),
                span([each.least_m for each in beats]),
                span([each.sink_mps for each in home], 2),
            )
        )
    columns = (
        "wind", "hill [m]", "mean [m/s]", "who", "flights", "up to the end", "broke off",
        "landed as they should", "disengaged", "lost", "aloft [min]", "mean",
        "beating, of those that did [min]", "turns", "least height, beating [m]", "sink [m/s]",
    )  # fmt: skip
    return Table("Beating: least, median, most", columns, tuple(rows))


def _why(flown: list[BeatFlight]) -> str:
    """How those ended that were neither up to the end nor landed as they should."""
    bad = [each for each in flown if each.ended and not each.landed]
    ends = Counter(
        f"{each.kind}, {each.case.radius_m:g} m, {each.case.mean_mps:g} m/s, {each.case.who}:"
        f" {each.ended}" + (" (landing)" if each.landing else "")
        for each in bad
    )
    return "; ".join(f"{end}: {count}" for end, count in ends.most_common())


def drawn_job(flown: list[BeatFlight]) -> BeatJob:
    """The one that beat for longest."""
    longest = max(flown, key=lambda each: each.beating_s)
    return BeatJob(
        kind=longest.kind, case=longest.case, seed=longest.seed, duration_s=longest.duration_s
    )


def draw_beating(path: Path, job: BeatJob) -> None:
    """Wind, place and the way seen from above.  Errors: ImportError without matplotlib."""
    from tgl_soar.analysis.report.figure_style import PALETTE, drawing, save

    record = wind_of(job)
    flown, _ = _path(job)
    every = slice(None, None, 100)  # half a second
    minutes, mode = flown["time_s"][every] / 60.0, flown["mode"][every]
    winds = [record.wind_mps.at(t) for t in flown["time_s"][every].tolist()]
    rows = (
        ("wind [m/s]", winds),
        ("height z [m]", flown["z_m"][every]),
        ("y [m]", flown["y_m"][every]),
    )
    with drawing() as plt:
        figure = plt.figure(figsize=(9.0, 7.2), layout="constrained")
        grid = figure.add_gridspec(4, 1, height_ratios=(1, 1, 1, 1.6))
        first = None
        for k, (label, values) in enumerate(rows):
            axis = figure.add_subplot(grid[k], sharex=first)
            first = first or axis
            axis.plot(minutes, values, color=PALETTE[k], lw=0.9)
            axis.set_ylabel(label)
            axis.fill_between(
                minutes, 0, 1, where=mode == BEATING, color="0.85",
                transform=axis.get_xaxis_transform(),
            )  # fmt: skip
            if k == 0:
                beaten = np.count_nonzero(mode == BEATING) / 120.0
                stood = np.count_nonzero(mode == SOARING) / 120.0
                axis.set_title(
                    f"hill of {job.case.radius_m:g} m, seed {job.seed}: {MODE_NAMES[SOARING]} for"
                    f" {stood:.0f} min, {MODE_NAMES[BEATING]} (shaded) for {beaten:.0f} min"
                )
        assert first is not None
        axis.set_xlabel("time [min]")
        above = figure.add_subplot(grid[3])
        beats = mode == BEATING
        above.plot(flown["y_m"][every], flown["x_m"][every], color="0.8", lw=0.6)
        above.plot(
            np.where(beats, flown["y_m"][every], nan), np.where(beats, flown["x_m"][every], nan),
            color=PALETTE[0], lw=0.8,
        )  # fmt: skip
        above.axhspan(-job.case.radius_m, 0.0, color="0.93", zorder=0)
        above.set_xlabel("along the ridge, y [m]")
        above.set_ylabel("downstream, x [m]")
        above.set_aspect("equal")
        save(plt, figure, path)
