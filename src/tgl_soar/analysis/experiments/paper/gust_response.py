"""`gust`: what a sudden change of wind does to updraft and sink, and to the aircraft.

With updraft proportional to wind, a wind that grows by du where the aircraft is raises the
updraft by (w / u) du, and the sink of an aircraft that keeps its place by S′ du.  The
difference, (sink/u − S′) du on the contour, is the vertical speed that it is left with.
"""

from __future__ import annotations

from math import cos, sin
from typing import Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from tgl_soar.air.zeuc import stable_crossing
from tgl_soar.analysis.experiments.context import Context
from tgl_soar.analysis.experiments.flights import FlownScenario, mean_of_flights
from tgl_soar.analysis.experiments.paper.changing_air import STAYS_M, error_cm, pinned
from tgl_soar.analysis.experiments.result import (
    RESOLVED,
    ChangedThreshold,
    Claim,
    Result,
    Table,
    above,
    all_of,
    decided,
    within,
)
from tgl_soar.analysis.experiments.scenario import PreparedScenario, WindSchedule, prepare
from tgl_soar.estimation.polar import best_glide_speed
from tgl_soar.types import polar_sink, polar_slope

Floats = NDArray[np.float64]

# After the step of wind has begun.  It lasts 0.2 s, and three time constants of the short period
# (11.5 rad/s) are 0.26 s: the nose has answered.  The outer loop (1 / ω_c of 0.5 s) has hardly, and
# the speed over the ground, which decays with the seconds of a glide, has not.
AT_ONCE_S: Final = 0.5
# Per m/s of wind.  A place counts as best glide's within half a per cent of its speed
# (`AT_BEST`), and there the difference is S″ ΔV = 0.1 s/m · 0.005 · 9.27 m/s.
STAYS_MPS: Final = 0.005
AT_BEST: Final = 0.005
STOOD_M: Final = 0.002  # the sensors' noise leaves a millimetre of the mean of eight flights
# Equally far to either side of the wind that the places are named in: S′ grows with speed, and a
# step from it upwards would be judged by where it ends.
HALF_STEP_MPS: Final = 0.2
CHANGED: Final = (
    ChangedThreshold(
        "the aircraft's answer to a gust",
        "up or down by more than nothing",
        f"by more than {100 * STAYS_M:g} cm in the end and {1000 * STOOD_M:g} mm at once",
        "so little is called staying where it was, and an aircraft cannot do both",
    ),
    ChangedThreshold(
        "the aircraft's answer to a gust",
        "its sign at once",
        "its sign in the end, and beside it its sign at once",
        "polar and updraft are those of steady glides: they say where an aircraft stands, after it"
        " has taken the new airspeed",
    ),
    ChangedThreshold(
        "the aircraft's answer to a gust",
        "the mean of all flights",
        f"that mean by {RESOLVED:g} standard errors of the flights' own answers; undecided where"
        " these leave it open",
        "aircraft that are not alike answer differently, and the sign of their mean can be chance",
    ),
    ChangedThreshold(
        "the aircraft's answer to a gust",
        "six seeds",
        "eight seeds",
        f"{RESOLVED:g} standard errors are the two-sided 95 % of Student's t for eight flights; for"
        " six they would be 2.6",
    ),
    ChangedThreshold(
        "the step of wind",
        "8.5 to 8.9 m/s",
        "8.3 to 8.7 m/s",
        "slow side, best glide and beyond are then those half-way through it",
    ),
)


class WindEffect(NamedTuple):
    """What one more m/s of local wind does at a place."""

    line: str
    wind_mps: float
    sink_mps: float
    updraft_gain: float  # w / u
    sink_gain: float  # S′
    at_once_m: float  # flown: up the line, AT_ONCE_S after the step
    highest_m: float  # the highest it got within 5 s
    in_the_end_m: float
    predicted_m: float  # TGL ∩ ZEUC
    # Standard errors of the three that are flown, by the flights' own; inf: fewer than two flights.
    at_once_error_m: float
    highest_error_m: float  # at the time when the mean is highest
    in_the_end_error_m: float
    lost: int = 0

    @property
    def margin(self) -> float:
        """Vertical speed left for each m/s of wind."""
        return self.updraft_gain - self.sink_gain


def gust(context: Context) -> Result:
    """A step of wind at each place, in calm air."""
    scenario = context.scenario("gust")
    assert scenario.wind is not None
    lines = list(scenario.lines)
    placed = prepare(scenario)
    middle, times = scenario.wind.mps[0], scenario.wind.times_s
    winds = [middle - HALF_STEP_MPS, middle + HALF_STEP_MPS]
    around = msgspec.structs.replace(scenario, wind=WindSchedule(times_s=times, mps=winds))
    variants = {
        line: pinned(
            msgspec.structs.replace(around, first_line=line), line, placed.lines[line].target
        )
        for line in lines
    }
    flights = context.fly(variants)
    prepared = {n: prepare(variants[n]) for n in lines}
    changes = [_change(placed, prepared[n], flights[n], n) for n in lines]
    step = 2.0 * HALF_STEP_MPS
    best = best_glide_speed(placed.polar)
    figures = _draw(context, prepared, changes, flights, best)
    return Result(
        name="gust",
        title="a sudden change of wind: updraft against sink",
        flown="At the four places of `wind`: what updraft and sink gain for each m/s of local wind"
        " while the aircraft keeps its place; and, in calm air, what the simulated aircraft does"
        f" after the wind of the tunnel grows from {winds[0]:g} to {winds[1]:g} m/s within 0.2 s"
        " (the"
        " mean of several seeds of the sensors' noise): at once, and when it has settled.",
        claims=sensitivity_claims(changes, best),
        why=gust_why(changes),
        tables=(
            Table(
                "For each m/s of local wind",
                ("place", "u [m/s]", "sink [m/s]", "updraft gains", "sink gains", "difference"),
                tuple(
                    (
                        c.line, f"{c.wind_mps:.2f}", f"{c.sink_mps:.3f}",
                        f"{c.updraft_gain:+.3f}", f"{c.sink_gain:+.3f}", f"{c.margin:+.3f}",
                    )
                    for c in changes
                ),
            ),
            Table(
                f"Flown, {step:g} m/s more wind in the tunnel: up the line",
                (
                    "place", f"after {AT_ONCE_S:g} s [cm]", "highest within 5 s [cm]",
                    "in the end [cm]", "TGL ∩ ZEUC [cm]",
                ),
                tuple(
                    (
                        c.line,
                        _with_error(c.at_once_m, c.at_once_error_m),
                        _with_error(c.highest_m, c.highest_error_m),
                        _with_error(c.in_the_end_m, c.in_the_end_error_m),
                        f"{100 * c.predicted_m:+.1f}",
                    )
                    for c in changes
                ),
            ),
        ),
        numbers={
            "places": [c._asdict() | {"margin": c.margin} for c in changes],
            "best_glide_mps": best,
        },
        figures=figures,
        scenarios=("gust",),
        seeds=tuple(scenario.seeds),
        changed=CHANGED,
    )  # fmt: skip


def _with_error(way_m: float, error_m: float) -> str:
    return f"{100 * way_m:+.1f} ± {error_cm(error_m)}"


def _ways(
    prepared: PreparedScenario, flights: list[FlownScenario], line: str
) -> tuple[Floats, Floats]:
    """(time since the step [s], way up the line since before it [m], a row for each flight)."""
    target = prepared.lines[line].target
    schedule = prepared.scenario.wind
    assert schedule is not None
    whole = [flight for flight in flights if flight.survived]
    if not whole:
        return np.array([0.0, 1e3]), np.full((1, 2), np.nan)
    along = np.array(
        [
            cos(target.eta_rad) * flight.path["x_m"] + sin(target.eta_rad) * flight.path["z_m"]
            for flight in whole
        ]
    )
    time = whole[0].path["time_s"] - schedule.times_s[0]
    before = along[:, (time > -10.0) & (time <= 0.0)]
    return time, along - np.mean(before, axis=1, keepdims=True)


def _change(
    placed: PreparedScenario, prepared: PreparedScenario, flights: list[FlownScenario], line: str
) -> WindEffect:
    at = placed.lines[line].crossing  # in the wind of the middle, by which places are named
    target, before = prepared.lines[line]
    assert at is not None
    assert before is not None
    after = stable_crossing(prepared.field, prepared.polar, target, 1e6)
    assert after is not None
    time, ways = _ways(prepared, flights, line)
    soon = ways[:, (time >= 0.0) & (time < 5.0)]
    at_once = mean_of_flights(float(np.interp(AT_ONCE_S, time, way)) for way in ways)
    highest = mean_of_flights(soon[:, np.argmax(np.mean(soon, axis=0))])
    in_the_end = mean_of_flights(np.mean(ways[:, time > time[-1] - 10.0], axis=1))
    return WindEffect(
        line=line,
        wind_mps=at.wind_mps,
        sink_mps=polar_sink(prepared.polar, at.wind_mps),
        updraft_gain=at.updraft_mps / at.wind_mps,
        sink_gain=polar_slope(prepared.polar, at.wind_mps),
        at_once_m=at_once.mean,
        highest_m=highest.mean,
        in_the_end_m=in_the_end.mean,
        predicted_m=cos(target.eta_rad) * (after.x_m - before.x_m)
        + sin(target.eta_rad) * (after.z_m - before.z_m),
        at_once_error_m=at_once.error,
        highest_error_m=highest.error,
        in_the_end_error_m=in_the_end.error,
        lost=sum(not flight.survived for flight in flights),
    )


def sensitivity_claims(changes: list[WindEffect], best_mps: float) -> tuple[Claim, ...]:
    """The paper's explanation by slopes, and what the aircraft does at once."""
    slow = [c for c in changes if c.wind_mps < 0.99 * best_mps]
    at_best = [c for c in changes if abs(c.wind_mps / best_mps - 1.0) <= AT_BEST]
    beyond = [c for c in changes if c.wind_mps > (1.0 + AT_BEST) * best_mps]
    margins = ", ".join(f"{c.margin:+.3f} at {c.line}" for c in changes)
    at_once, in_the_end = (
        ", ".join(f"{_with_error(way_m, error_m)} cm at {line}" for line, way_m, error_m in ways)
        for ways in (
            [(c.line, c.at_once_m, c.at_once_error_m) for c in changes],
            [(c.line, c.in_the_end_m, c.in_the_end_error_m) for c in changes],
        )
    )
    return (
        Claim(
            "more wind raises updraft more than sink on the slow side, as much at best glide, less"
            " beyond",
            all(c.margin > STAYS_MPS for c in slow)
            and all(abs(c.margin) <= STAYS_MPS for c in at_best)
            and all(c.margin < -STAYS_MPS for c in beyond),
            f"difference {margins} m/s for each m/s",
            # sink/u − S′ is 0 at best glide by its definition, and the places are named by it.
            by_construction=True,
        ),
        decided(
            "so a gust leaves the aircraft higher on the slow side, where it was at best glide"
            f" (within {100 * STAYS_M:g} cm), lower beyond, by more than that",
            all_of(
                (
                    *(above(c.in_the_end_m, c.in_the_end_error_m, STAYS_M) for c in slow),
                    *(within(c.in_the_end_m, c.in_the_end_error_m, STAYS_M) for c in at_best),
                    *(above(-c.in_the_end_m, c.in_the_end_error_m, STAYS_M) for c in beyond),
                    not any(c.lost for c in changes),
                )
            ),
            f"{in_the_end}; {sum(c.lost for c in changes)} flights lost",
        ),
        decided(
            "the aircraft's immediate answer to a gust has that sign, by more than"
            f" {1000 * STOOD_M:g} mm",
            all_of(
                (
                    *(above(c.at_once_m, c.at_once_error_m, STOOD_M) for c in slow),
                    *(within(c.at_once_m, c.at_once_error_m, STOOD_M) for c in at_best),
                    *(above(-c.at_once_m, c.at_once_error_m, STOOD_M) for c in beyond),
                    not any(c.lost for c in changes),
                )
            ),
            f"{at_once}, {AT_ONCE_S:g} s after the step",
        ),
    )


def gust_why(changes: list[WindEffect]) -> str:
    """What the aircraft does at once."""
    if all(c.at_once_m > 0.0 for c in changes):
        return (
            "The slopes say where the aircraft ends up, not what it does at once. For the first"
            " second it has not slowed down over the ground yet: the gust is airspeed to it, lift"
            " grows with its square, and it is thrown up at every place, on either side of best"
            " glide, before it slides to where the contour has gone. The explanation by polar and"
            " updraft holds for winds that change slowly against that second."
        )
    return (
        "In the first second the gust is airspeed to the aircraft and lift grows with its square;"
        " the explanation by polar and updraft holds for winds that change slowly against that."
    )


def _draw(
    context: Context,
    scenarios: dict[str, PreparedScenario],
    changes: list[WindEffect],
    flights: dict[str, list[FlownScenario]],
    best_mps: float,
) -> tuple[str, ...]:
    path = context.figure("gust")
    if path is None:
        return ()
    from tgl_soar.analysis.report.curves_figure import (
        CurvePanel,
        DrawnCurve,
        Mark,
        Note,
        curves_figure,
    )
    from tgl_soar.analysis.report.figure_style import PALETTE

    polar = next(iter(scenarios.values())).polar
    speeds = np.linspace(polar.speed_min_mps, min(polar.speed_max_mps, 11.0), 120)
    margin = [polar_sink(polar, u) / u - polar_slope(polar, u) for u in speeds.tolist()]
    rays = [DrawnCurve(speeds.tolist(), [polar_sink(polar, u) for u in speeds.tolist()],
                   "sink (glide polar)", "0.2", width=2.2)]  # fmt: skip
    points, histories = [], []
    ends, margin_notes = [], []
    for c, colour in zip(changes, PALETTE, strict=False):
        reach = np.array([c.wind_mps - 0.7, c.wind_mps + 0.9])
        rays.append(
            DrawnCurve(
                reach.tolist(), (c.updraft_gain * reach).tolist(), f"updraft at {c.line}", colour
            )
        )
        points.append(DrawnCurve([c.wind_mps], [c.margin], None, colour, style="", marker="o"))
        margin_notes.append(Note(c.wind_mps, c.margin, c.line, colour))
        time, ways = _ways(scenarios[c.line], flights[c.line], c.line)
        moved = np.mean(ways, axis=0)
        show = (time > -1.0) & (time < 8.0)
        histories.append(
            DrawnCurve(time[show].tolist(), (100.0 * moved[show]).tolist(), None, colour)
        )
        ends.append(Note(7.9, 100.0 * float(moved[show][-1]), c.line, colour))
        histories.append(
            DrawnCurve([6.5, 8.0], [100.0 * c.predicted_m] * 2, None, colour, style="--")
        )
    curves_figure(
        path,
        [
            CurvePanel(
                "updraft is proportional to wind, sink is not",
                "local wind = airspeed u [m/s]",
                "[m/s]",
                rays,
                legend="upper left",
            ),
            CurvePanel(
                "vertical speed left for each m/s",
                "local wind = airspeed u [m/s]",
                "sink/u − d sink/du",
                [
                    DrawnCurve(speeds.tolist(), margin, None, "0.2"),
                    DrawnCurve([speeds[0], speeds[-1]], [0.0, 0.0], None, "0.5", width=0.8),
                    *points,
                ],
                notes=margin_notes,
                marks=[Mark(best_mps, "best glide")],
            ),
            CurvePanel(
                "flown: a step of wind at 0 s (dashed: TGL ∩ ZEUC)",
                "time [s]",
                "up the line [cm]",
                histories,
                notes=ends,
            ),
        ],
        "",
    )
    return (path.name,)
