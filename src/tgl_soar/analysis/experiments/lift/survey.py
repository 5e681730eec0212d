"""`survey`: how well a slide there and back draws the contour of the tunnel.

The module's own closed loop with its own estimates, from line b of the shipped tunnel; the contour
of the field and the airframe file's polar is what is to be drawn.  The aims were set before any
flight: 3 cm at 3 % of turbulence, and a pace by which 3.5 m take 120 s.  The shipped tunnel has no
3.5 m between the guards, so that the pace is what is held against it: as long a slide takes longer,
and its rests, at its beginning and where it turns, do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import hypot, sqrt
from pathlib import Path
from statistics import mean, median
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np

from tgl_soar.air.field import WindField
from tgl_soar.air.zeuc import contour
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.random_aircraft import flown_world
from tgl_soar.analysis.experiments.result import ChangedThreshold, Claim, Result, Table
from tgl_soar.analysis.logs.flight_data import Floats
from tgl_soar.analysis.search.scoring import fraction_text
from tgl_soar.analysis.survey.contour_fit import (
    DrawnContour,
    SurveyError,
    SurveyPath,
    drawn_contour,
)
from tgl_soar.analysis.survey.survey_flight import SurveyFlight, fly_survey
from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.sim.aircraft import AircraftModel, glide_polar
from tgl_soar.sim.sensors import MEMS_IMU, PITOT, READ_BACK, Sensors
from tgl_soar.sim.world import World, build_field
from tgl_soar.types import GlidePolar

AIRFRAME: Final = "airframes/eclipson_c.toml"
SITE: Final = "sites/tunnel.toml"
LINE: Final = "b"
FIRST_SEED: Final = 61  # those below were seen while the drawing and its claim were built
FLIGHTS: Final = 20
LONGEST_S: Final = 300.0
USUAL_MPS: Final = 0.06  # of SRV_SPEED, and half of it
CASES: Final = ((0.0, USUAL_MPS), (0.01, USUAL_MPS), (0.03, USUAL_MPS), (0.03, 0.5 * USUAL_MPS))
CLOSE_M: Final = 0.03
LONG_M: Final = 3.5
LONG_S: Final = 120.0
BOUNDS: Final = (-0.5, 2.4, 0.2, 3.0)  # of the contour's map, beyond the fence
STEP_M: Final = 0.02
CHANGED: Final = (
    ChangedThreshold(
        "the contour is within 3 cm",
        "smoothed over a knot and more",
        "over six knots and more",
        "in 2 of 20 flights at 3 % the drift in gusts was drawn as the contour's shape",
    ),
    ChangedThreshold(
        "3.5 m of contour take 120 s",
        "the whole survey as many times longer as 3.5 m are longer than what was drawn",
        "its slides alone, and the rests as they are",
        "a longer slide has no more rests",
    ),
)


class SurveyJob(NamedTuple):
    """One flight."""

    turbulence: float
    speed_mps: float
    seed: int
    dispersed: bool = False  # another aircraft than the file's, in other air than the site's


@dataclass(frozen=True)
class SurveyedOnce:
    """What came of it."""

    job: SurveyJob
    flight: SurveyFlight
    drawn: DrawnContour | None
    why_not: str
    errors_m: Floats  # distance of each drawn point from the contour, positive above it

    @property
    def duration_s(self) -> float:
        """Flown."""
        return self.flight.lasted_s

    @property
    def rested_s(self) -> float:
        """For how long of it the line stood still."""
        looks = self.flight.looks
        moved = np.hypot(np.diff(looks["line_x_m"]), np.diff(looks["line_z_m"]))
        return float(np.diff(looks["time_s"])[moved == 0.0].sum())

    def takes_s(self, length_m: float) -> float:
        """How long a survey of so much contour takes at its pace; inf where none was drawn."""
        if self.drawn is None:
            return float("inf")
        slid_s = self.flight.lasted_s - self.rested_s
        return self.rested_s + slid_s * length_m / self.drawn.length_m

    @property
    def rms_m(self) -> float:
        """Of the distances."""
        return float(np.sqrt(np.mean(self.errors_m**2)))


def fly_once(job: SurveyJob) -> SurveyedOnce:
    """Fly one survey and draw by it.  Errors: `ConfigError`."""
    airframe, site = load_airframe(shipped(AIRFRAME)), load_site(shipped(SITE))
    assert site.air is not None
    blown = msgspec.structs.replace(site.air.turbulence, intensity=job.turbulence)
    site = msgspec.structs.replace(site, air=msgspec.structs.replace(site.air, turbulence=blown))
    sensors = Sensors(imu=MEMS_IMU, airspeed=PITOT, surfaces=READ_BACK)
    world = flown_world(airframe, site, job.seed, dispersed=job.dispersed, sensors=sensors)
    line = site.lines[LINE]
    values = load_parameters(airframe, AIRFRAME, site, SITE).changed(
        {"TGL_X": line.x_m, "TGL_Z": line.z_m, "SRV_SPEED": job.speed_mps}
    )
    flight = fly_survey(world, values, job.seed, LONGEST_S)
    looks = flight.looks
    path = SurveyPath(
        time_s=looks["time_s"],
        x_m=looks["x_m"],
        z_m=looks["z_m"],
        line_x_m=looks["line_x_m"],
        line_z_m=looks["line_z_m"],
        standing=looks["standing"],
        eta_rad=flight.eta_rad,
    )
    try:
        drawn = drawn_contour(path)
    except SurveyError as error:
        return SurveyedOnce(
            job=job, flight=flight, drawn=None, why_not=str(error), errors_m=np.zeros(0)
        )
    true = contour_flown(world) if job.dispersed else true_contour()
    return SurveyedOnce(
        job=job, flight=flight, drawn=drawn, why_not="", errors_m=errors_of(drawn, true)
    )


def true_contour() -> list[Floats]:
    """Of the shipped tunnel's field and the airframe file's polar."""
    airframe, site = load_airframe(shipped(AIRFRAME)), load_site(shipped(SITE))
    assert site.air is not None
    return contour_of(build_field(site.air, None), airframe.polar.as_polar())


def contour_flown(world: World) -> list[Floats]:
    """Of a world's air and its aircraft's own glides, fitted as the file's are."""
    assert isinstance(world.model, AircraftModel)  # `flown_world` draws no other
    return contour_of(world.field, glide_polar(world.model))


def contour_of(field: WindField, polar: GlidePolar) -> list[Floats]:
    """Of a field and a polar: parts of (x, z)."""
    return [np.array(part, dtype=float) for part in contour(field, polar, BOUNDS, STEP_M)]


def errors_of(drawn: DrawnContour, true: list[Floats]) -> Floats:
    """Distance of each drawn point from the nearest of a contour, positive above it."""
    found = np.full(len(drawn.x_m), np.inf)
    for n, (x, z) in enumerate(zip(drawn.x_m, drawn.z_m, strict=True)):
        for part in true:
            a, step = part[:-1], np.diff(part, axis=0)
            length = np.maximum((step**2).sum(axis=1), 1e-12)
            way = np.clip(((np.array([x, z]) - a) * step).sum(axis=1) / length, 0.0, 1.0)
            off = np.array([x, z]) - a - way[:, None] * step
            nearest = int(np.argmin((off**2).sum(axis=1)))
            distance = hypot(*off[nearest].tolist())
            if distance < abs(found[n]):
                found[n] = distance if off[nearest, 1] >= 0.0 else -distance
    return found


def run(context: Context) -> Result:
    """Fly, draw, tabulate."""
    count = 1 if context.quick else context.episodes or FLIGHTS
    seeds = tuple(range(FIRST_SEED, FIRST_SEED + count))
    jobs = [SurveyJob(turbulence, speed, seed) for turbulence, speed in CASES for seed in seeds]
    flown: list[SurveyedOnce] = context.each(fly_once, jobs, compiled=True)
    groups = {case: [one for one in flown if one.job[:2] == case] for case in CASES}
    figures = []
    if context.figures is not None:
        figures.append("survey.png")
        context.figures.mkdir(parents=True, exist_ok=True)
        survey_figure(context.figures / figures[0], groups, true_contour())
    return Result(
        name="survey",
        title="the contour drawn by a slide there and back",
        flown=(
            f"{count} surveys each from line {LINE} of the tunnel, seeds {seeds[0]} to {seeds[-1]},"
            " with a pitot tube and accelerometers. The error is the distance of the drawn points"
            " from the contour of the true field and the airframe file's polar or, dispersed, that"
            " of what flew, fitted as the file's is; a polar's own misfit to its aircraft is in it."
        ),
        claims=_claims(groups),
        why=_losses(flown),
        tables=(_table(groups),),
        numbers={"surveys": [_numbers(one) for one in flown]},
        figures=tuple(figures),
        seeds=seeds,
        changed=CHANGED,
    )


def _claims(
    groups: dict[tuple[float, float], list[SurveyedOnce]],
) -> tuple[Claim, ...]:
    usual = groups[0.03, USUAL_MPS]
    drawn = [one for one in usual if one.drawn is not None]
    error = sqrt(mean([one.rms_m**2 for one in drawn])) if drawn else float("inf")
    gusty = [
        one for (turbulence, _), flown in groups.items() if turbulence == 0.03 for one in flown
    ]
    done = sum(one.flight.done and not one.flight.cut_short for one in gusty)
    calm = [one for one in groups[0.0, USUAL_MPS] if one.drawn is not None]
    takes_s = median(one.takes_s(LONG_M) for one in calm) if calm else float("inf")
    rests_s = median(one.rested_s for one in calm) if calm else 0.0
    return (
        Claim(
            "at 3 % the drawn contours are within 3 cm rms of the true one",
            error <= CLOSE_M,
            f"{100.0 * error:.1f} cm;"
            f" {fraction_text(sum(o.rms_m <= CLOSE_M for o in drawn), len(drawn))}"
            " of them within 3 cm each",
        ),
        Claim(
            f"at its pace in calm air {LONG_M:g} m of contour take {LONG_S:g} s or less",
            takes_s <= LONG_S,
            f"{takes_s:.0f} s, {rests_s:.0f} of them at rest" if calm else "none was drawn",
        ),
        Claim(
            "at 3 %, at either pace, every survey comes home, and none is cut short",
            done == len(gusty), fraction_text(done, len(gusty)),
        ),
    )  # fmt: skip


def _table(groups: dict[tuple[float, float], list[SurveyedOnce]]) -> Table:
    rows = []
    for (turbulence, speed), flown in groups.items():
        drawn = [(one, one.drawn) for one in flown if one.drawn is not None]
        errors = [one.rms_m for one, _ in drawn]
        claimed = [float(np.sqrt(np.mean(each.sigma_m**2))) for _, each in drawn]
        every = np.concatenate([one.errors_m for one, _ in drawn]) if drawn else np.full(1, np.nan)
        rows.append(
            (
                f"{100.0 * turbulence:g}",
                f"{speed:g}",
                f"{sum(one.flight.done for one in flown)} of {len(flown)}",
                f"{sum(bool(one.flight.ended) for one in flown)}",
                _median([one.flight.lasted_s for one, _ in drawn], "{:.0f}"),
                _median([each.length_m for _, each in drawn], "{:.2f}"),
                f"{100.0 * sqrt(mean([e * e for e in errors])):.1f}" if errors else "–",
                f"{100.0 * float(np.mean(every)):+.1f}",
                f"{100.0 * float(np.percentile(np.abs(every), 95)):.1f}",
                f"{100.0 * sqrt(mean([c * c for c in claimed])):.1f}" if claimed else "–",
                _median([100.0 * each.late_m for _, each in drawn], "{:.1f}"),
                _median([each.return_per_s for _, each in drawn], "{:.2f}"),
                _median([100.0 * each.drift_m for _, each in drawn], "{:.1f}"),
            )
        )
    return Table(
        "Contours drawn; medians of the flights that drew one",
        (
            *("turbulence [%]", "line [m/s]", "came home", "lost", "lasted [s]", "drawn [m]"),
            *("error, rms [cm]", "bias [cm]", "95 % [cm]", "claimed, rms [cm]"),
            *("lag taken out [cm]", "λ [1/s]", "drift, rms [cm]"),
        ),
        tuple(rows),
    )


def _median(values: list[float], form: str) -> str:
    return form.format(median(values)) if values else "–"


def _losses(flown: list[SurveyedOnce]) -> str:
    lines = [
        f"- {100.0 * one.job.turbulence:g} %, {one.job.speed_mps:g} m/s, seed {one.job.seed}:"
        f" {one.flight.ended or one.flight.cut_short or one.why_not}"
        for one in flown
        if one.flight.ended or one.flight.cut_short or one.why_not
    ]
    return (
        "\n".join(["Surveys that were lost, cut short or drew nothing:", "", *lines])
        if lines
        else ""
    )


def _numbers(one: SurveyedOnce) -> dict[str, Any]:
    drawn = one.drawn
    return {
        **one.job._asdict(),
        "ended": one.flight.ended,
        "turns": list(one.flight.turns),
        "cut_short": one.flight.cut_short,
        "lasted_s": one.flight.lasted_s,
        "length_m": drawn.length_m if drawn is not None else None,
        "rms_m": one.rms_m if drawn is not None else None,
        "return_per_s": drawn.return_per_s if drawn is not None else None,
    }


def survey_figure(
    path: Path, groups: dict[tuple[float, float], list[SurveyedOnce]], true: list[Floats]
) -> None:
    """All drawn contours over the true one, and a flight's path under them."""
    from tgl_soar.analysis.report.figure_style import drawing

    with drawing() as plt:
        size = {"figsize": (9.0, 2.7), "layout": "constrained"}
        figure, axes = plt.subplots(1, len(groups), sharey=True, **size)
        for ax, ((turbulence, speed), flown) in zip(axes, groups.items(), strict=True):
            looks = flown[0].flight.looks
            ax.plot(looks["true_x_m"], looks["true_z_m"], color="0.8", lw=0.5)
            for part in true:
                ax.plot(part[:, 0], part[:, 1], color="k", lw=1.0, ls="--")
            for one in flown:
                if one.drawn is not None:
                    ax.plot(one.drawn.x_m, one.drawn.z_m, color="#1f77b4", lw=0.8, alpha=0.5)
            ax.set(xlim=(-0.3, 2.0), ylim=(0.7, 2.8), xlabel="x [m]", aspect="equal")
            ax.set_title(f"{100.0 * turbulence:g} %, {speed:g} m/s", fontsize=8)
        axes[0].set_ylabel("z [m]")
        figure.savefig(path)
        plt.close(figure)
