"""`tgl-soar zeuc`: the map of excess updraft of a site and an airframe."""

from __future__ import annotations

import json
from math import degrees, radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from tgl_soar.air.zeuc import (
    REACH_M,
    Bounds,
    Core,
    ZeucError,
    contour,
    core,
    crossings,
    feasible_leans,
    wind_sensitivity,
)
from tgl_soar.analysis.experiments.result import plain, versions
from tgl_soar.analysis.experiments.scenario import (
    contour_step,
    perpendicular_lean,
    search_bounds,
)
from tgl_soar.cli.console import AIRFRAME, AIRFRAME_FILE, SITE, SITE_FILE, console, fail, hint, say
from tgl_soar.config.files import ConfigError, load_flight
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Site
from tgl_soar.control.target_line import TargetLine, eta_from_lean
from tgl_soar.sim.world import ground_outline, site_field

if TYPE_CHECKING:
    from tgl_soar.analysis.report.zeuc_figure import DrawnLine


def zeuc(
    site: Annotated[Path, typer.Option(help="Site file.", **SITE_FILE)] = SITE,
    airframe: Annotated[Path, typer.Option(help="Airframe file.", **AIRFRAME_FILE)] = AIRFRAME,
    line: Annotated[
        list[str] | None,
        typer.Option(help="x,z,lean \\[m, m, deg]; repeatable. Default: the site's lines."),
    ] = None,
    lean: Annotated[
        float | None, typer.Option(help="Lean of all lines \\[deg], in place of their own.")
    ] = None,
    bounds: Annotated[
        str,
        typer.Option(help="Where to look: x from,x to,z from,z to \\[m]. Default: the site's air."),
    ] = "",
    out: Annotated[Path, typer.Option(help="Figure, PNG or SVG; numbers beside it as JSON.")] = (
        Path("out/zeuc.png")
    ),
) -> None:
    """Draw where the aircraft can hover: excess updraft, its zero contour, lines and crossings."""
    try:
        loaded, place, values = load_flight(airframe, site)
        if place.air is None:
            raise ConfigError(f"{site}: no [air] table, so there is no wind to map")
        field = site_field(place, site.parent, site)
        limits = _numbers(bounds, 4, "--bounds") if bounds else search_bounds(place)
        area: Bounds = (limits[0], limits[1], limits[2], limits[3])
        lines = _lines(line, lean, place, values)
        polar = loaded.polar.as_polar()
        parts = contour(field, polar, area, contour_step(area))
        middle = core(field, polar, area, contour_step(area))
        met = {name: _crossings(field, polar, target) for name, target in lines.items()}
    except (ConfigError, ZeucError, ValueError) as error:
        fail(error)

    _print(met, middle)
    numbers = {
        "site": place.site.name,
        "airframe": loaded.airframe.name,
        "bounds_m": area,
        "core": middle._asdict(),
        "lines": {
            name: {
                "x_m": target.x_m,
                "z_m": target.z_m,
                "lean_deg": degrees(target.eta_rad) - 90.0,
                "crossings": met[name],
            }
            for name, target in lines.items()
        },
        "contour_m": [part for part in parts if len(part) > 2],
        "versions": versions(),
    }
    data = _written(out, numbers)
    try:
        from tgl_soar.analysis.report.zeuc_figure import zeuc_figure

        zeuc_figure(
            out,
            field,
            polar,
            area,
            _drawn(lines, met),
            (middle.x_m, middle.z_m),
            f"{place.site.name}, {loaded.airframe.name}",
            ground_outline(place.air),
        )
    except ImportError as error:
        hint(f"no figure: {error}")
        console.print(f"numbers in {data}")
    except (OSError, ValueError) as error:  # a full disk, a name of no format
        fail(f"--out {out}: no figure: {error}; numbers in {data}")
    else:
        say(f"map in {out}, numbers in {data}")


def _drawn(lines: dict[str, TargetLine], met: dict[str, list[dict[str, Any]]]) -> list[DrawnLine]:
    """The lines for the figure.  Errors: ImportError where there can be none."""
    from tgl_soar.analysis.report.zeuc_figure import DrawnLine

    return [
        DrawnLine(
            name,
            x0_m=target.x_m,
            z0_m=target.z_m,
            eta_rad=target.eta_rad,
            crossings=[(c["x_m"], c["z_m"], c["stable"]) for c in met[name]],
        )
        for name, target in lines.items()
    ]


def _written(out: Path, numbers: dict[str, Any]) -> Path:
    """The file with the numbers beside a figure; ends where it cannot be written."""
    data = out.with_suffix(".json")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        data.write_text(json.dumps(plain(numbers), indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        fail(f"--out {out}: cannot be written: {error.strerror}")
    return data


def _lines(
    given: list[str] | None, lean_deg: float | None, place: Site, values: ParameterSet
) -> dict[str, TargetLine]:
    """The lines of the options, or the site's.  Errors: `ConfigError`."""
    lines: dict[str, TargetLine] = {}
    if given:
        for i, text in enumerate(given, 1):
            x, z, own = _numbers(text, 3, "--line")
            lines[str(i)] = TargetLine(x, z, eta_from_lean(radians(own)))
    else:
        for name, named in place.lines.items():
            own = values["TGL_LEAN"] if named.lean_deg is None else named.lean_deg
            lines[name] = TargetLine(named.x_m, named.z_m, eta_from_lean(radians(own)))
    if lean_deg is None:
        return lines
    eta = eta_from_lean(radians(lean_deg))
    return {name: target._replace(eta_rad=eta) for name, target in lines.items()}


def _print(met: dict[str, list[dict[str, Any]]], middle: Core) -> None:
    table = Table(
        "line", "x [m]", "z [m]", "u [m/s]", "w [m/s]", "dE/ds", "stable", "leans", "wind ↑"
    )
    for name, found in met.items():
        for c in found:
            table.add_row(name, *_row(c))
        if not found:
            table.add_row(name, *"–––––", "[red]meets no contour[/red]")
    console.print(table)
    console.print(
        "dE/ds [1/s]: change of excess updraft going up the line; leans: those that are stable"
        " there; wind ↑: shift up the line for 1 m/s more wind, to first order"
    )
    console.print(
        f"core at x {middle.x_m:.2f}, z {middle.z_m:.2f} m: excess updraft"
        f" {middle.excess_mps:.2f} m/s (updraft {middle.updraft_mps:.2f} m/s in a wind of"
        f" {middle.wind_mps:.2f} m/s)"
    )


def _crossings(field: Any, polar: Any, target: TargetLine) -> list[dict[str, Any]]:
    """Everything about each crossing of a line, from below to above, for the JSON file."""
    found = []
    for c in crossings(field, polar, target.x_m, target.z_m, target.eta_rad, REACH_M):
        row: dict[str, Any] = plain(c._asdict())
        row["perpendicular_lean_deg"] = degrees(perpendicular_lean(field, polar, c.x_m, c.z_m))
        try:
            low, high = feasible_leans(field, polar, c.x_m, c.z_m)
            row["leans_deg"] = (degrees(low), degrees(high))
        except ZeucError:
            row["leans_deg"] = None
        try:
            row["sensitivity"] = plain(wind_sensitivity(field, polar, c, target.eta_rad)._asdict())
        except ZeucError:
            row["sensitivity"] = None
        found.append(row)
    return found


def _row(crossing: dict[str, Any]) -> list[str]:
    leans, sensitivity = crossing["leans_deg"], crossing["sensitivity"]
    return [
        f"{crossing['x_m']:.3f}",
        f"{crossing['z_m']:.3f}",
        f"{crossing['wind_mps']:.2f}",
        f"{crossing['updraft_mps']:.2f}",
        f"{crossing['excess_slope_per_s']:+.2f}",
        "yes" if crossing["stable"] else "[red]no[/red]",
        "–" if leans is None else f"{leans[0]:.0f}° … {leans[1]:.0f}°",
        "–" if sensitivity is None else f"{100.0 * sensitivity['along_m_per_mps']:+.1f} cm",
    ]


def _numbers(text: str, count: int, option: str) -> list[float]:
    parts = text.split(",")
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise ConfigError(f"{option} {text!r}: needs {count} numbers with commas between them")
    return numbers
