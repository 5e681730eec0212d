"""`point`: a point of the line held with a brake, beside the line alone, in the same gusts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from math import cos, pi, sin
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from tgl_soar.analysis.experiments.context import Context, with_turbulence
from tgl_soar.analysis.experiments.flights import FlownScenario
from tgl_soar.analysis.experiments.point.brake_faults import (
    FLIGHTS,
    SEED,
    faults_claim,
    faults_table,
    faulty_jobs,
    fly_faulty,
)
from tgl_soar.analysis.experiments.point.good_brakes import (
    DispersedPoint,
    fly_good_brakes,
    good_brakes_table,
)
from tgl_soar.analysis.experiments.point.point_margins import (
    margins_claim,
    margins_table,
    point_margins,
)
from tgl_soar.analysis.experiments.result import Claim, Result, Table
from tgl_soar.analysis.experiments.scenario import (
    PositionSpec,
    PreparedScenario,
    Scenario,
    SensorSpec,
    TimedChange,
    prepare,
)
from tgl_soar.control.point_hold import DEAD, HOLDS, UNEVEN
from tgl_soar.estimation.aerodynamics import brake_sink, braked
from tgl_soar.types import polar_sink

SETTLE_S: Final = 15.0  # the brake fades in over 2 s, the point moves at 0.15 m/s, gusts apart
HILL_SETTLE_S: Final = 45.0  # it slides at 0.2 / s there
INTENSITIES: Final = (0.01, 0.03, 0.05)
DRIFT: Final = 0.45  # of that of the line alone
E_RHO: Final = 1.1
CALM_M: Final = 0.005  # a kestrel's head in smooth air
GENTLE_M: Final = 0.01
# A camera system, so that calm air shows the loop and not the sensor.
TRACKED: Final = SensorSpec(
    imu=True, position=PositionSpec(rate_hz=100, delay_s=0.01, noise_m=3e-4)
)
# What an operator says of such cameras: the smallest deviation that sites/tunnel_mocap.toml has,
# three times their own.
TRACKED_SD_M: Final = 0.001
RADIUS_M: Final = 0.05
SIDE_M: Final = 0.20
PATH_SPEED_MPS: Final = 0.02  # an eighth of what the point may move at
SEARCHED_M: Final = 3.0  # along the line, to either side of its point
STEP_M: Final = 0.005
CHANGE_S: Final = 0.25  # between two points of a path
COMPILED_TOGETHER: Final = 48  # flights: fewer than usual, as those with bad brakes follow

Floats = NDArray[np.float64]


class Held(NamedTuple):
    """Flights of one kind in one turbulence."""

    along_m: float  # rms along the line, about its mean or about the point
    across_m: float  # rms of e_rho
    flown: int
    lasted: int
    brake: float  # mean
    ended: float  # share of the time at an end of its travel
    given_up: int  # flights whose brake was taken for a bad one


def band(prepared: PreparedScenario) -> tuple[float, float, float]:
    """Where on the line, from its point [m], the aircraft rests with all, half and none of the
    brake, in calm air: by the airframe's polars and the air's own field."""
    aero, line = prepared.airframe.aerodynamics(), prepared.lines[prepared.scenario.first_line]
    x0, z0, eta = line.target
    found = []
    for brake in (1.0, 0.5, 0.0):
        polar = braked(aero, brake).polar
        place = SEARCHED_M
        while place > -SEARCHED_M:  # from above: the first place where the air rises enough
            u, _, w = prepared.field.wind_at(x0 + place * cos(eta), 0.0, z0 + place * sin(eta), 0.0)
            if w >= polar_sink(polar, u):  # false where there is no glide
                break
            place -= STEP_M
        found.append(place)
    return found[0], found[1], found[2]


def with_point(scenario: Scenario, along_m: float) -> Scenario:
    """The same, holding the point so far along the line."""
    parameters = {**scenario.parameters, "TGL_HOLD": 1.0, "TGL_ALONG": along_m}
    return msgspec.structs.replace(scenario, parameters=parameters)


def along(flight: FlownScenario, eta_rad: float) -> Floats:
    """Its place along a line [m]."""
    place: Floats = flight.path["x_m"] * cos(eta_rad) + flight.path["z_m"] * sin(eta_rad)
    return place


def held(flights: Sequence[FlownScenario], eta_rad: float, settle_s: float) -> Held:
    """All flights of a kind as one; lost ones until they were lost."""
    off, across, out, ends = [], [], [], []
    for flight in flights:
        rows = flight.path["time_s"] >= settle_s
        if not np.any(rows):
            continue
        own = flight.path["point_off_m"][rows]
        place = along(flight, eta_rad)[rows]
        known = np.isfinite(own)  # while it captures or soars; never, of a line alone
        off.append(own[known] if known.any() else place - place.mean())
        across.append(flight.path["e_rho_m"][rows])
        brake = flight.path["brake"][rows]
        out.append(brake)
        ends.append((brake <= 0.0) | (brake >= 1.0))

    def rms(parts: list[Floats]) -> float:
        return float(np.sqrt(np.mean(np.concatenate(parts) ** 2))) if parts else float("nan")

    return Held(
        along_m=rms(off),
        across_m=rms(across),
        flown=len(flights),
        lasted=sum(flight.survived for flight in flights),
        brake=float(np.mean(np.concatenate(out))) if out else float("nan"),
        ended=float(np.mean(np.concatenate(ends))) if ends else float("nan"),
        given_up=sum(bool(np.isin(f.path["point"], (DEAD, UNEVEN)).any()) for f in flights),
    )


def circle() -> list[tuple[float, float]]:
    """A circle about the point, from its lowest place round and back: steps of `CHANGE_S`."""
    count = round(2.0 * pi * RADIUS_M / PATH_SPEED_MPS / CHANGE_S)
    turns = [2.0 * pi * i / count for i in range(count + 1)]
    return [(RADIUS_M * sin(a), -RADIUS_M * cos(a)) for a in turns]


def square() -> list[tuple[float, float]]:
    """A square about the point, from its lower upstream corner round and back."""
    half, count = 0.5 * SIDE_M, round(SIDE_M / PATH_SPEED_MPS / CHANGE_S)
    corners = [(-half, -half), (half, -half), (half, half), (-half, half), (-half, -half)]
    path = [corners[0]]
    for (x, z), (to_x, to_z) in pairwise(corners):
        path += [
            (x + (to_x - x) * i / count, z + (to_z - z) * i / count) for i in range(1, count + 1)
        ]
    return path


def flying_path(
    scenario: Scenario, path: Sequence[tuple[float, float]], settle_s: float
) -> Scenario:
    """The line's point moves along a path, the point that is held with it: on to its beginning
    first, for as long as it takes to settle."""
    line = prepare(scenario).lines[scenario.first_line].target
    changes = [
        TimedChange(
            time_s=0.2 * settle_s if i == 0 else settle_s + i * CHANGE_S,
            parameters={"TGL_X": line.x_m + x, "TGL_Z": line.z_m + z},
        )
        for i, (x, z) in enumerate(path)
    ]
    duration_s = settle_s + len(path) * CHANGE_S + 2.0
    return msgspec.structs.replace(scenario, changes=changes, duration_s=duration_s)


def path_error(
    flight: FlownScenario,
    prepared: PreparedScenario,
    path: Sequence[tuple[float, float]],
    along_m: float,
    settle_s: float,
) -> float:
    """Distance [m] of what was flown from the path, rms: from its nearest place."""
    x0, z0, eta = prepared.lines[prepared.scenario.first_line].target
    wanted = np.array(path) + np.array([x0 + along_m * cos(eta), z0 + along_m * sin(eta)])
    rows = (flight.path["time_s"] >= settle_s) & (
        flight.path["time_s"] <= settle_s + len(path) * CHANGE_S
    )
    flown = np.stack([flight.path["x_m"][rows], flight.path["z_m"][rows]], axis=1)
    if not len(flown):
        return float("nan")
    apart = np.linalg.norm(flown[:, None, :] - wanted[None, :, :], axis=2).min(axis=1)
    return float(np.sqrt(np.mean(apart**2)))


PATHS: Final = {"circle of 10 cm": circle, "square of 20 cm": square}


def run(context: Context) -> Result:
    """Line and point in the same gusts, calm air, and paths, in the tunnel and on the hill."""
    base = context.scenario("point")
    prepared = prepare(base)
    eta = prepared.lines["b"].target.eta_rad
    all_of_it, half, none = band(prepared)
    kinds = {"line": base, "point": with_point(base, half)}
    scenarios = {
        (kind, intensity): with_turbulence(scenario, intensity)
        for intensity in INTENSITIES
        for kind, scenario in kinds.items()
    }
    calm = msgspec.structs.replace(
        with_turbulence(kinds["point"], 0.0), duration_s=SETTLE_S + 60.0, seeds=base.seeds
    )
    stills = {
        "cameras": msgspec.structs.replace(
            calm, sensors=TRACKED, parameters={**calm.parameters, "EST_FIX_SD": TRACKED_SD_M}
        ),
        "the autopilot": calm,
    }
    paths = _paths(context)
    # Together, so that they are compiled: the bad brakes need nearly the same.
    flights = replace(context, compiled_from=min(COMPILED_TOGETHER, context.compiled_from)).fly(
        {**scenarios, **stills, **{key: each.scenario for key, each in paths.items()}}
    )
    kept = {key: held(flights[key], eta, SETTLE_S) for key in scenarios}
    peaks = {name: _peaks(flights[name]) for name in stills}
    shapes = _shapes(paths, flights)
    sink = brake_sink(prepared.airframe.aerodynamics())
    cost = 0.5 * sink * float(np.median(flights["point", INTENSITIES[0]][0].path["wind_mps"])) ** 3
    held_at = [kinds["point"], _held_on_the_hill(context)]
    bad = context.each(
        fly_faulty, faulty_jobs(held_at, 8 if context.quick else FLIGHTS, SEED), compiled=True
    )
    good = fly_good_brakes(context, held_at)
    margins = point_margins({"tunnel": prepared, "hill": prepare(context.scenario("point_hill"))})
    lost = sum(not flight.survived for flight in flights["cameras"])
    claims = [
        *(*_claims(kept), _still_claim(peaks["cameras"], lost), _taken_claim(kept, good)),
        *(faults_claim(bad), margins_claim(margins)),
    ]
    figure = context.figure("point")
    if figure is not None:
        square_flight = flights["tunnel", "square of 20 cm", 0.0][0]
        _draw(figure, flights["line", 0.03], flights["point", 0.03], square_flight, half, prepared)
    return Result(
        name="point",
        title=base.title,
        flown=f"Flights of {base.duration_s:g} s on a line through the tunnel's place b, with"
        " accelerometers; with the line alone, and holding the middle of the band with the spoilers"
        f" of {prepared.airframe.airframe.name}, in the same gusts. In calm air all of the brake"
        f" rests {all_of_it - none:+.2f} m and half of it {half - none:+.2f} m along the line from"
        f" where none of it does; half of it costs {cost:.2f} m/s of sink.",
        claims=tuple(claims),
        why="",
        tables=(
            *(_table(kept), _calm_table(peaks), shapes),
            *(faults_table(bad), good_brakes_table(good), margins_table(margins)),
        ),
        numbers={
            "band_m": [all_of_it, half, none],
            "bias_sink_mps": cost,
            "calm_peaks_m": {name: list(each) for name, each in peaks.items()},
            "held": {f"{kind} {100 * i:g} %": h._asdict() for (kind, i), h in kept.items()},
            "bad_brakes": [flight._asdict() for flight in bad],
            "good_brakes": [flight._asdict() for flight in good],
        },
        figures=() if figure is None else (figure.name,),
        scenarios=("point", "point_hill"),
        seeds=tuple(base.seeds),
    )


def _held_on_the_hill(context: Context) -> Scenario:
    """The middle of the band there."""
    base = context.scenario("point_hill")
    return with_point(base, band(prepare(base))[1])


def _taken_claim(kept: dict[tuple[str, float], Held], dispersed: Sequence[DispersedPoint]) -> Claim:
    """Of brakes that are well."""
    points = [each for (kind, _), each in kept.items() if kind == "point"]
    taken, flown = sum(each.given_up for each in points), sum(each.flown for each in points)
    unlike = sum(each.given_up for each in dispersed)
    return Claim(
        "no brake that is well is given up",
        taken + unlike == 0,
        f"{taken} of {flown} flights, {unlike} of {len(dispersed)} with aircraft unlike their file",
    )


class PathFlight(NamedTuple):
    """A path of the point that is to be flown."""

    scenario: Scenario
    path: list[tuple[float, float]]
    along_m: float  # of the point that is held, from the line's
    settle_s: float


def _paths(context: Context) -> dict[tuple[str, str, float], PathFlight]:
    """Paths in the vertical plane, calm and at 1 %: by place, shape and turbulence."""
    found = {}
    for place, name, settle_s in (
        ("tunnel", "point", SETTLE_S),
        ("hill", "point_hill", HILL_SETTLE_S),
    ):
        base = context.scenario(name)
        base = msgspec.structs.replace(base, seeds=base.seeds[:1])
        half = band(prepare(base))[1]
        for shape, make in PATHS.items():
            for intensity in (0.0, 0.01):
                scenario = with_turbulence(with_point(base, half), intensity)
                found[place, shape, intensity] = PathFlight(
                    flying_path(scenario, make(), settle_s), make(), half, settle_s
                )
    return found


def _shapes(
    paths: dict[tuple[str, str, float], PathFlight], flights: dict[Any, list[FlownScenario]]
) -> Table:
    rows = []
    for key, (scenario, path, half, settle_s) in paths.items():
        place, shape, intensity = key
        (flight,) = flights[key]
        error = path_error(flight, prepare(scenario), path, half, settle_s)
        over = flight.path["time_s"] >= settle_s
        holds = float(np.mean(flight.path["point"][over] == HOLDS)) if np.any(over) else 0.0
        rows.append(
            (
                f"{place}, {shape}",
                f"{100 * intensity:g}",
                f"{1000 * error:.1f}",
                f"{100 * holds:.0f}",
                flight.ended or "flew to the end",
            )
        )
    columns = ("path", "turbulence [%]", "off it, rms [mm]", "within the band [%]", "end")
    return Table("Paths of the point in the vertical plane", columns, tuple(rows))


def _peaks(flights: Sequence[FlownScenario]) -> tuple[float, float]:
    """The farthest that any of them was from its point, along and across [m]; of those that were
    lost before they had settled there is nothing to tell.  NaN of none, and where one did not fly
    its line all the time."""
    scored = [(flight.path, flight.path["time_s"] >= SETTLE_S) for flight in flights]
    along, across = (
        [float(np.abs(path[name][rows]).max()) for path, rows in scored if rows.any()]
        for name in ("point_off_m", "e_rho_m")
    )
    if not along:
        return float("nan"), float("nan")
    return float(np.max(along)), float(np.max(across))  # unlike max: NaN wherever it stands


def _claims(kept: dict[tuple[str, float], Held]) -> list[Claim]:
    line, point = kept["line", 0.03], kept["point", 0.03]
    gentle = kept["point", 0.01]
    drift, across = point.along_m / line.along_m, point.across_m / line.across_m
    return [
        Claim(
            f"at 3 % it drifts at most {DRIFT:g} times as far along the line as without",
            drift <= DRIFT,
            f"{drift:.2f}: {100 * point.along_m:.1f} of {100 * line.along_m:.1f} cm",
        ),
        Claim(f"e_rho is at most {E_RHO:g} times as large", across <= E_RHO, f"{across:.2f}"),
        Claim(
            "no fewer last",
            all(kept["point", i].lasted >= kept["line", i].lasted for i in INTENSITIES),
            ", ".join(
                f"{100 * i:g} %: {kept['point', i].lasted} and {kept['line', i].lasted}"
                f" of {line.flown}"
                for i in INTENSITIES
            ),
        ),
        Claim(
            f"at 1 % it stays within {100 * GENTLE_M:g} cm rms on both axes",
            max(gentle.along_m, gentle.across_m) <= GENTLE_M,
            f"{100 * gentle.along_m:.2f} cm along, {100 * gentle.across_m:.2f} cm across",
        ),
    ]


def _still_claim(peaks: tuple[float, float], lost: int = 0) -> Claim:
    return Claim(
        f"in calm air, tracked by cameras, within {1000 * CALM_M:g} mm on both axes for 60 s",
        lost == 0 and all(peak <= CALM_M for peak in peaks),
        f"{1000 * peaks[0]:.1f} mm along, {1000 * peaks[1]:.1f} mm across at most",
    )


def _calm_table(peaks: dict[str, tuple[float, float]]) -> Table:
    rows = tuple(
        (name, f"{1000 * along_m:.1f}", f"{1000 * across_m:.1f}")
        for name, (along_m, across_m) in peaks.items()
    )
    columns = ("position by", "along, at most [mm]", "e_rho, at most [mm]")
    return Table("The point in calm air, 60 s of every seed", columns, rows)


def _table(kept: dict[tuple[str, float], Held]) -> Table:
    columns = (
        "turbulence [%]", "held", "along, rms [cm]", "e_rho, rms [cm]", "lasted",
        "brake", "at an end of it [%]",
    )  # fmt: skip
    rows = tuple(
        (
            f"{100 * intensity:g}",
            kind,
            f"{100 * each.along_m:.2f}",
            f"{100 * each.across_m:.2f}",
            f"{each.lasted} of {each.flown}",
            f"{each.brake:.2f}",
            f"{100 * each.ended:.0f}" if kind == "point" else "–",
        )
        for (kind, intensity), each in kept.items()
    )
    return Table("Line and point in the same gusts", columns, rows)


def _draw(
    path: Path,
    lines: Sequence[FlownScenario],
    points: Sequence[FlownScenario],
    square_flight: FlownScenario,
    half_m: float,
    prepared: PreparedScenario,
) -> None:
    """Two clouds of places side by side, and the square."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    x0, z0, eta = prepared.lines[prepared.scenario.first_line].target
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 3)
    for ax, flights, words in (
        (axes[0], lines, "the line alone, 3 %"),
        (axes[1], points, "the point, 3 %"),
    ):
        for flight in flights:
            over = flight.path["time_s"] >= SETTLE_S
            ax.plot(
                100 * (flight.path["x_m"][over] - x0), 100 * (flight.path["z_m"][over] - z0),
                ".", markersize=0.8, color="tab:blue", alpha=0.3,
            )  # fmt: skip
        ends = np.array([-60.0, 60.0])
        ax.plot(ends * cos(eta), ends * sin(eta), color="0.6", linewidth=0.8)
        if flights is points:
            ax.plot(100 * half_m * cos(eta), 100 * half_m * sin(eta), "+", color="black")
        ax.set(xlim=(-30.0, 30.0), ylim=(-50.0, 40.0), aspect="equal", title=words)
    flight = square_flight
    over = flight.path["time_s"] >= SETTLE_S
    shift = np.array([half_m * cos(eta), half_m * sin(eta)])
    wanted = 100 * (np.array(square()) + shift)
    axes[2].plot(*wanted.T, color="0.6", linewidth=0.8)
    axes[2].plot(
        100 * (flight.path["x_m"][over] - x0), 100 * (flight.path["z_m"][over] - z0), linewidth=0.9
    )
    axes[2].set(aspect="equal", title="a square of 20 cm, calm")
    for ax in axes:
        ax.set_xlabel("downstream [cm]")
    axes[0].set_ylabel("up [cm]")
    figure.savefig(path, dpi=110)
