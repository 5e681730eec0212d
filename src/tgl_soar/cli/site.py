"""`tgl-soar site`: what the flight needs to know of a place, computed beforehand."""

from __future__ import annotations

import json
from collections.abc import Sequence
from itertools import pairwise
from math import hypot, radians, sqrt
from pathlib import Path
from typing import Annotated

import typer

from tgl_soar.air.field import WindField
from tgl_soar.air.wind_record import SyntheticWind, synthetic_record, write_wind_record
from tgl_soar.air.zeuc import Bounds, ZeucError, contour, excess_at
from tgl_soar.analysis.experiments.scenario import contour_step, search_bounds
from tgl_soar.cli.console import (
    AIRFRAME,
    AIRFRAME_FILE,
    SITE,
    SITE_FILE,
    Commands,
    fail,
    hint,
    say,
)
from tgl_soar.cli.contour_file import write_contour
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import ConfigError, load_airframe, load_site
from tgl_soar.config.site import Site
from tgl_soar.sim.world import site_field, wind_misfit_text
from tgl_soar.types import GlidePolar

site_app = Commands(
    help="Site files: draft one, compute its contour, write a wind record,"
    " check a polynomial wind.",
    no_args_is_help=True,
)

TOLERANCE_M = 0.005  # of a point left out: less than any tracker's noise on a line
LONGEST_FRACTION = 0.05  # a shorter part, of the longest one, is noise of the search

_USUAL = SyntheticWind()

Point = tuple[float, float]


@site_app.callback()
def site_() -> None:
    """Draft and complete site files."""


@site_app.command("contour")
def contour_(
    site: Annotated[
        Path, typer.Option(help="Site file with an \\[air] table.", **SITE_FILE)
    ] = SITE,
    airframe: Annotated[
        Path, typer.Option(help="Airframe file, for its polar.", **AIRFRAME_FILE)
    ] = AIRFRAME,
    bounds: Annotated[
        str,
        typer.Option(help="Where to look: x from,x to,z from,z to \\[m]. Default: the site's air."),
    ] = "",
    out: Annotated[Path | None, typer.Option(help="File to write; else it is printed.")] = None,
    into: Annotated[
        Path | None,
        typer.Option(
            help="Site file into which it is written, in place of its \\[contour].", **SITE_FILE
        ),
    ] = None,
) -> None:
    """Print the site's zero excess updraft contour as the \\[contour] table of its file.

    The module refuses a line that does not cross this contour. This puts it into the site file:
    tgl-soar site contour --site my_site.toml --into my_site.toml
    """
    if out is not None and into is not None:
        fail("--out and --into: give one or the other")
    if out is not None and out.resolve() in (site.resolve(), airframe.resolve()):
        fail(f"--out {out}: that is a file that it is computed from; give another name")
    try:
        loaded, place = load_airframe(airframe), load_site(site)
        area = _bounds(bounds) if bounds else search_bounds(place)
        text = contour_toml(loaded, place, site.parent, area, called=site)
    except (ConfigError, ZeucError, ValueError) as error:
        fail(error)
    if into is not None:
        try:
            write_contour(into, text)
        except ConfigError as error:
            fail(error)
        except OSError as error:
            fail(f"{into}: cannot be written: {error.strerror}")
        say(f"contour in {into}, for {loaded.airframe.name}")
    elif out is None:
        print(text, end="")
    else:
        try:
            out.write_text(text, encoding="utf-8")
        except OSError as error:
            fail(f"{out}: cannot be written: {error.strerror}")
        say(f"contour in {out}: put it into {site}, or let --into do it")


@site_app.command("misfit")
def misfit_(
    site: Annotated[
        Path, typer.Option(help="Site file with a polynomial \\[air].", **SITE_FILE)
    ] = SITE,
) -> None:
    """Print how far a site's polynomial wind is from the air that it was fitted to."""
    try:
        place = load_site(site)
        text = "" if place.air is None else wind_misfit_text(site_field(place, site.parent, site))
    except ConfigError as error:
        fail(error)
    if not text:
        fail(f'{site}: air.kind: only the wind of kind = "polynomial" is fitted to another')
    say(text)


@site_app.command("wind")
def wind_(
    out: Annotated[Path, typer.Argument(help="CSV file to write.")],
    hours: Annotated[float, typer.Option(min=0.05, max=24.0, help="Length of the record.")] = 1.0,
    mean: Annotated[
        float, typer.Option(min=1.0, max=30.0, help="Mean wind \\[m/s].")
    ] = _USUAL.mean_mps,
    lulls: Annotated[
        float, typer.Option(min=0.0, max=60.0, help="Lulls in an hour.")
    ] = _USUAL.lulls_per_hour,
    veer: Annotated[
        float, typer.Option(min=0.0, max=60.0, help="Largest slow veer, to either side \\[deg].")
    ] = 20.0,
    seed: Annotated[int, typer.Option(min=0, help="Another seed gives another wind.")] = 1,
) -> None:
    """Write a synthetic wind record: Kaimal's spectra, lulls and a slow veer.

    Name it in the site file, \\[air] record = "FILE.csv": flights in that air then have this wind.
    The record of a mast with the same columns can be used as well.
    """
    wind = _USUAL._replace(
        duration_s=3600.0 * hours, mean_mps=mean, lulls_per_hour=lulls, veer_rad=radians(veer)
    )
    record = synthetic_record(wind, seed)
    try:
        write_wind_record(out, record)
    except OSError as error:
        fail(f"{out}: cannot be written: {error.strerror}")
    speeds = record.wind_mps.values
    say(
        f"{out}: {hours:g} h, {sum(speeds) / len(speeds):.1f} m/s in the mean,"
        f" from {min(speeds):.1f} to {max(speeds):.1f}"
    )


def _bounds(text: str) -> Bounds:
    try:
        x_from, x_to, z_from, z_to = (float(part) for part in text.split(","))
    except ValueError:
        raise ConfigError(f"--bounds {text!r}: needs 4 numbers with commas between them") from None
    return x_from, x_to, z_from, z_to


def contour_toml(
    airframe: Airframe,
    site: Site,
    folder: Path,
    bounds: Bounds,
    tolerance_m: float = TOLERANCE_M,
    called: Path | None = None,
) -> str:
    """The `[contour]` table of a site file, whose folder its grids are in.

    tolerance_m: how far a point that is left out may lie from what is left.  called: what errors
    call the site file.

    Errors: `ConfigError`, `ZeucError`, ValueError for bounds that enclose nothing.
    """
    if site.air is None:
        raise ConfigError(f"site {site.site.name}: no [air] table, so there is no wind to map")
    field = site_field(site, folder, called)
    if text := wind_misfit_text(field):
        hint(text)
    polar = airframe.polar.as_polar()
    found = contour(field, polar, bounds, contour_step(bounds))
    parts = [[(float(x), float(z)) for x, z in part] for part in found]
    longest = max(map(_length, parts))
    parts = [part for part in parts if _length(part) >= LONGEST_FRACTION * longest]
    comment = (
        f"# Where excess updraft is zero, rising air on the left, by `tgl-soar site contour` for a"
        f"\n# wind of {site.air.wind_mps:g} m/s. A line that does not cross it is refused."
    )
    parts = [_rising_on_the_left(field, polar, part) for part in parts]
    return contour_table(comment, airframe.airframe.name, parts, tolerance_m)


def contour_table(
    comment: str, airframe: str, parts: list[list[Point]], tolerance_m: float = TOLERANCE_M
) -> str:
    """The text of a `[contour]` table: parts with rising air on their left, thinned."""
    lines = [comment, "[contour]", f"airframe = {json.dumps(airframe)}", "parts = ["]
    for part in parts:
        points = _thinned(part, tolerance_m)
        lines += ["  [", *_wrapped([f"[{x:.3f}, {z:.3f}]" for x, z in points]), "  ],"]
    return "\n".join([*lines, "]", ""])


def _length(part: Sequence[Point]) -> float:
    return sum(hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(part))


def _rising_on_the_left(field: WindField, polar: GlidePolar, part: list[Point]) -> list[Point]:
    """The part, in the direction that has positive excess updraft on the left."""
    votes = 0
    for (xa, za), (xb, zb) in pairwise(part):
        length = hypot(xb - xa, zb - za)
        if length > 0.0:
            aside = 0.1 * length
            x = 0.5 * (xa + xb) - aside * (zb - za) / length
            z = 0.5 * (za + zb) + aside * (xb - xa) / length
            excess = excess_at(field, polar, x, z)
            votes += (excess > 0.0) - (excess < 0.0)
    return part if votes >= 0 else part[::-1]


def _thinned(points: list[Point], tolerance_m: float) -> list[Point]:
    """Fewer points; none left out is farther than that from what is left (Douglas-Peucker)."""
    keep = {0, len(points) - 1}
    waiting = [(0, len(points) - 1)]
    while waiting:
        low, high = waiting.pop()
        farthest, distance = low, tolerance_m
        for i in range(low + 1, high):
            d = _from_segment(points[i], points[low], points[high])
            if d > distance:
                farthest, distance = i, d
        if farthest != low:
            keep.add(farthest)
            waiting += [(low, farthest), (farthest, high)]
    return [points[i] for i in sorted(keep)]


def _from_segment(p: Point, a: Point, b: Point) -> float:
    dx, dz = b[0] - a[0], b[1] - a[1]
    squared = dx * dx + dz * dz
    s = 0.0
    if squared > 0.0:
        s = max(0.0, min(1.0, ((p[0] - a[0]) * dx + (p[1] - a[1]) * dz) / squared))
    x, z = p[0] - a[0] - s * dx, p[1] - a[1] - s * dz
    return sqrt(x * x + z * z)


def _wrapped(items: list[str]) -> list[str]:
    return ["    " + ", ".join(items[i : i + 6]) + "," for i in range(0, len(items), 6)]
