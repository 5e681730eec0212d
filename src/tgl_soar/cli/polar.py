"""`tgl-soar polar`: fit a glide polar to measured glides, or show an airframe's."""

from __future__ import annotations

import csv
from math import isfinite, radians
from pathlib import Path
from typing import Annotated, Final

import numpy as np
import typer
from rich.table import Table

from tgl_soar.analysis.logs.flight_data import FlightData, steered
from tgl_soar.analysis.logs.gliding import MeanWind, glides
from tgl_soar.analysis.logs.open_log import read_flight
from tgl_soar.analysis.logs.ulog_reader import LogError
from tgl_soar.cli.console import AIRFRAME, AIRFRAME_FILE, Commands, console, errors, fail, say
from tgl_soar.cli.identify import WindFromOption, WindOption
from tgl_soar.cli.log_argument import log_in
from tgl_soar.config.airframe import Airframe, Surfaces
from tgl_soar.config.files import ConfigError, load_airframe
from tgl_soar.estimation.polar import (
    BRAKE_SLACK,
    PolarFamilyFit,
    PolarFit,
    best_glide_speed,
    fit_polar,
    fit_polar_family,
    sink_band,
)
from tgl_soar.types import GlidePolar, polar_sink, polar_slope

SLOWEST_MPS: Final = 5.0  # no aircraft that soars outdoors glides at no more, whatever its pitch

polar_app = Commands(help="Glide polars: fit one, or show an airframe's.", no_args_is_help=True)


@polar_app.command("fit")
def fit(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="One CSV with columns speed_mps and sink_mps, or flight logs. A folder: the"
            " newest log in it."
        ),
    ],
    speed: Annotated[
        str, typer.Option(help="Column of horizontal airspeeds \\[m/s].")
    ] = "speed_mps",
    sink: Annotated[str, typer.Option(help="Column of sinks \\[m/s, positive down].")] = "sink_mps",
    brake: Annotated[
        str, typer.Option(help="Column of the brake, 0 to 1, if the table has one.")
    ] = "brake",
    wind: WindOption = 0.0,
    wind_from: WindFromOption = 0.0,
    compare: Annotated[
        Path | None,
        typer.Option(
            help="Airframe file whose polar the figure shows for comparison.", **AIRFRAME_FILE
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Figure to write, PNG or SVG.")] = None,
) -> None:
    """Fit the third-order polar to a table of glides, or to the steady glides that logs hold.

    A log must be flown in still air: steady pitch, wings level, no lift. Give the horizontal wind,
    unless the aircraft has a pitot tube. Glides at several positions of a brake give a family of
    polars: the polar with the brake retracted, and what the full brake adds.
    """
    files = [log_in(path) for path in files]
    file = files[0]
    try:
        plane = None if compare is None else load_airframe(compare)
        beside = None if plane is None else plane.polar.as_polar()
        if file.suffix.lower() == ".csv":
            if len(files) > 1:
                raise ValueError(f"{files[1]}: one table at a time")
            speeds, sinks, brakes = read_glides(file, speed, sink, brake)
        else:
            speeds, sinks, brakes = logged_glides(
                files, MeanWind(wind, radians(wind_from)), None if plane is None else plane.surfaces
            )
        family = None
        if max(brakes, default=0.0) - min(brakes, default=0.0) > BRAKE_SLACK:
            family = fit_polar_family(speeds, sinks, brakes)
            sinks = [
                s - family.brake_sink * b * u**3
                for u, s, b in zip(speeds, sinks, brakes, strict=True)
            ]
        fitted = fit_polar(speeds, sinks) if family is None else family.fit
    except (ConfigError, LogError, ImportError) as error:
        fail(error)
    except ValueError as error:
        text = str(error)
        fail(text if any(text.startswith(str(each)) for each in files) else f"{file}: {text}")
    console.print(_residuals(fitted, speeds, sinks))
    console.print(
        f"{len(speeds)} glides at {fitted.speeds} speeds; residual"
        f" {fitted.residual_rms_mps:.3f} m/s, at most {fitted.residual_max_mps:.3f} m/s"
    )
    _summary(fitted.polar)
    if family is not None:
        console.print(brake_words(family, plane), markup=False, highlight=False)
    console.print("\n" + polar_toml(fitted), markup=False, highlight=False)
    if out is not None:
        _draw(out, fitted.polar, file.name, fitted, speeds, sinks, beside)


@polar_app.command("show")
def show(
    airframe: Annotated[Path, typer.Option(help="Airframe file.", **AIRFRAME_FILE)] = AIRFRAME,
    out: Annotated[Path | None, typer.Option(help="Figure to write, PNG or SVG.")] = None,
) -> None:
    """Show the polar of an airframe file."""
    try:
        loaded = load_airframe(airframe)
    except ConfigError as error:
        fail(error)
    polar = loaded.polar.as_polar()
    table = Table("airspeed", "sink", "glide ratio", "d sink / d u", "sink/u − d sink/du", box=None)
    steps = 10
    for i in range(steps + 1):
        u = _between(polar, i / steps)
        s, slope = polar_sink(polar, u), polar_slope(polar, u)
        table.add_row(
            f"{u:.2f} m/s", f"{s:.3f} m/s", f"{u / s:.2f}", f"{slope:+.3f}", f"{s / u - slope:+.3f}"
        )
    console.print(table)
    _summary(polar)
    if out is not None:
        _draw(out, polar, loaded.airframe.name)


def brake_words(family: PolarFamilyFit, plane: Airframe | None) -> str:
    """What all of the brake adds; as a coefficient of drag where the airframe is known."""
    k, error = family.brake_sink, family.brake_sink_error
    words = (
        f"all of the brake adds {k:.3g} ± {1.96 * error:.1g} (95 %) times the cube of the airspeed:"
        f" {k * 9.0**3:.3f} m/s at 9 m/s; the sinks above are less what it adds"
    )
    if plane is None:
        return f"{words}. With --compare an airframe file its CD_brake follows"
    aero = plane.aerodynamics()
    per_sink = 2.0 * aero.mass_kg * aero.gravity_mps2
    per_sink /= aero.air_density_kgpm3 * aero.wing_area_m2
    known = f"{aero.CD_brake:.4g}" if aero.CD_brake > 0.0 else "none"
    return (
        f"{words}\nCD_brake = {k * per_sink:.4g} ± {1.96 * error * per_sink:.1g}"
        f" (the file has {known})"
    )


def read_glides(
    path: Path, speed: str, sink: str, brake: str = "brake"
) -> tuple[list[float], list[float], list[float]]:
    """Columns of a CSV file with a header; the brake's is 0 where there is none.

    Errors: ValueError naming file, line, value.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ValueError(f"{path}: not UTF-8 text: save it as CSV in UTF-8") from None
    rows = csv.DictReader(text.splitlines())
    names = [name.strip() for name in rows.fieldnames or []]
    rows.fieldnames = names
    for name in (speed, sink):
        if name not in names:
            raise ValueError(
                f"{path}: no column {name!r}; the first line names {', '.join(names) or 'none'}."
                " Name yours with --speed and --sink"
            )
    wanted = (speed, sink, brake) if brake in names else (speed, sink)
    speeds, sinks, brakes = [], [], []
    for row in rows:
        pair = []
        for name in wanted:
            value = row[name]
            try:
                pair.append(float(value))
            except (TypeError, ValueError):
                raise ValueError(
                    f"{path}: line {rows.line_num}: {name} = {value!r} is not a number"
                ) from None
        speeds.append(pair[0])
        sinks.append(pair[1])
        brakes.append(pair[2] if len(pair) > 2 else 0.0)
    return speeds, sinks, brakes


def _has_airspeed(flight: FlightData) -> bool:
    airspeed = flight.airspeed
    return airspeed is not None and bool(np.isfinite(airspeed["airspeed_mps"]).any())


def logged_glides(
    files: list[Path], wind: MeanWind, surfaces: Surfaces | None = None
) -> tuple[list[float], list[float], list[float]]:
    """Speeds, sinks and brakes of the steady glides in some logs.

    surfaces: of the airframe, to read the brake from the outputs where a log has no command of it;
    without them it counts as retracted there.

    Errors: `LogError`; ValueError naming a log that holds none, or whose wind is not given.
    """
    speeds, sinks, brakes = [], [], []
    measured = False
    for path in files:
        flight = read_flight(path)
        measured = measured or _has_airspeed(flight)
        for text in flight.lost:
            errors.print(f"lost: {text}", style="yellow", highlight=False, markup=False)
        try:
            found = glides(flight if surfaces is None else steered(flight, surfaces), wind)
        except ValueError as error:
            raise ValueError(f"{path}: {error}") from None
        say(f"{path}: {len(found)} steady glides, {sum(g.duration_s for g in found):.0f} s in all")
        speeds += [glide.speed_mps for glide in found]
        sinks += [glide.sink_mps for glide in found]
        brakes += [glide.brake for glide in found]
    if speeds and max(speeds) < SLOWEST_MPS and not measured and wind.speed_mps == 0.0:
        slow, fast = min(speeds), max(speeds)
        between = f"{slow:.1f} to {fast:.1f} m/s" if fast > slow else f"{slow:.1f} m/s"
        logs = "the log has" if len(files) == 1 else "the logs have"
        raise ValueError(
            f"{files[0]}: {logs} no airspeed, and --wind is 0: the speeds over the ground would be"
            f" glides at {between}. Give the wind of the flight with --wind and --wind-from"
        )
    return speeds, sinks, brakes


def polar_toml(fitted: PolarFit) -> str:
    """The `[polar]` table of an airframe file."""
    p = fitted.polar
    return (
        "[polar]\n"
        f"c0 = {p.c0:.8g}\nc1 = {p.c1:.8g}\nc2 = {p.c2:.8g}\nc3 = {p.c3:.8g}\n"
        f"speed_min_mps = {p.speed_min_mps:.8g}\nspeed_max_mps = {p.speed_max_mps:.8g}\n"
    )


def _residuals(fitted: PolarFit, speeds: list[float], sinks: list[float]) -> Table:
    table = Table("airspeed", "sink", "fitted", "residual", "95 % band", box=None)
    for u, s, residual in sorted(zip(speeds, sinks, fitted.residuals_mps, strict=True)):
        low, high = sink_band(fitted, u)
        table.add_row(
            f"{u:.2f} m/s", f"{s:.3f}", f"{s - residual:.3f}", f"{residual:+.3f}",
            f"{low:.3f} … {high:.3f}",
        )  # fmt: skip
    return table


def _between(polar: GlidePolar, fraction: float) -> float:
    """A speed of the polar [m/s]; rounding takes none of them beyond its end."""
    low, high = polar.speed_min_mps, polar.speed_max_mps
    return min(high, low + (high - low) * fraction)


def _summary(polar: GlidePolar) -> None:
    speeds = [_between(polar, i / 500) for i in range(501)]
    slowest = min(speeds, key=lambda u: polar_sink(polar, u))
    console.print(f"least sink {polar_sink(polar, slowest):.3f} m/s at {slowest:.2f} m/s")
    best = best_glide_speed(polar)
    if isfinite(best):
        console.print(f"best glide 1 : {best / polar_sink(polar, best):.2f} at {best:.2f} m/s")
    else:
        console.print("best glide lies outside the range")
    console.print(f"valid from {polar.speed_min_mps:g} to {polar.speed_max_mps:g} m/s, not beyond")


def _draw(
    out: Path,
    polar: GlidePolar,
    title: str,
    fitted: PolarFit | None = None,
    speeds: list[float] | None = None,
    sinks: list[float] | None = None,
    beside: GlidePolar | None = None,
) -> None:
    from tgl_soar.analysis.report.polar_figure import polar_figure

    title = f"glide polar: {title}"
    try:
        polar_figure(out, polar, title, fitted, speeds or (), sinks or (), beside)
    except (ImportError, ValueError) as error:
        fail(f"no figure: {error}")
    except OSError as error:
        fail(f"no figure: {out}: {error.strerror}")
    say(f"figure in {out}")
