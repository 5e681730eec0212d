"""`tgl-soar site init`: a first site file from a digital elevation model."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Annotated, Final

import typer

from tgl_soar.air.grid_files import write_npz
from tgl_soar.air.zeuc import ZeucError
from tgl_soar.analysis.terrain.draft import DraftError, Request, SiteDraft, draft
from tgl_soar.analysis.terrain.elevation import ElevationError, local_terrain
from tgl_soar.analysis.terrain.site_text import (
    CONTOUR_WARNING,
    GRID_FILE,
    landing_place,
    site_text,
)
from tgl_soar.cli.console import AIRFRAME, AIRFRAME_FILE, fail, hint, say
from tgl_soar.cli.site import TOLERANCE_M, contour_toml, site_app
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import ConfigError, load_airframe, load_parameters, load_site

SITE_FILE_NAME: Final = "site.toml"
MAP: Final = "map.png"
PLANE: Final = "plane.png"


@site_app.command("init")
def site_init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Created if it does not exist.")],
    dem: Annotated[Path, typer.Option(metavar="FILE", help="Elevation model: .hgt, .tif or .vrt.")],
    lat: Annotated[
        float, typer.Option(help="Latitude of a place on the slope or its crest \\[deg].")
    ],
    lon: Annotated[float, typer.Option(help="Longitude of that place, east is positive \\[deg].")],
    ridge: Annotated[
        float, typer.Option(min=-360, max=360, help="Direction in which the ridge runs \\[deg].")
    ],
    wind_from: Annotated[
        float | None,
        typer.Option(
            min=-360, max=360, help="Where the wind comes from. Default: straight at the slope."
        ),
    ] = None,
    wind: Annotated[
        float | None,
        typer.Option(
            min=1, max=30, help="Wind far upstream \\[m/s]. Default: the airframe's least speed."
        ),
    ] = None,
    airframe: Annotated[
        Path, typer.Option(help="Airframe file, for its polar.", **AIRFRAME_FILE)
    ] = AIRFRAME,
    reach: Annotated[
        float,
        typer.Option(min=50, max=2000, help="Extent of ground to either side of the crest \\[m]."),
    ] = 800.0,
    half_width: Annotated[
        float,
        typer.Option(min=5, max=1000, help="Half of the fence's width along the ridge \\[m]."),
    ] = 50.0,
    clearance: Annotated[
        float,
        typer.Option(min=1, max=50, help="CLEAR_MIN; the elevation model errs by metres \\[m]."),
    ] = 10.0,
    ceiling: Annotated[
        float, typer.Option(min=10, max=1000, help="Height of the fence over the crest \\[m].")
    ] = 120.0,
    name: Annotated[str, typer.Option(help="Name of the site.")] = "",
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
) -> None:
    """Write a first site file from a digital elevation model, to be corrected on the spot.

    Ground, fence, home and a landing place come from the model. Wind and contour are guessed by
    potential flow over it; the wind is written beside the file, so that `tgl-soar sitl --site`
    can fly there. All files are written or none. Exit code 2: not possible, with the reason.
    """
    folder = Path(os.path.abspath(folder))  # noqa: PTH100 - a link is not followed
    taken = [n for n in (SITE_FILE_NAME, GRID_FILE, MAP, PLANE) if (folder / n).exists()]
    if taken and not force:
        fail(f"{folder}: has {', '.join(taken)} already: --force replaces them")
    try:
        plane = load_airframe(airframe)
        polar = plane.polar.as_polar()
        request = Request(
            ridge_deg=ridge,
            wind_from_deg=wind_from,
            wind_mps=polar.speed_min_mps if wind is None else wind,
            reach_m=reach,
            half_width_m=half_width,
            clearance_m=clearance,
            ceiling_m=ceiling,
        )
        # A crest a quarter of the reach away, and the corners of strips that lie askew.
        terrain = local_terrain(dem, lat, lon, 1.25 * reach + half_width)
        made = draft(terrain, request, polar)
        written = _write(folder, made, name or f"{dem.stem} {lat:.4f} {lon:.4f}", plane, airframe)
    except (ConfigError, ElevationError, DraftError, ZeucError, ImportError) as error:
        fail(error)
    except OSError as error:
        fail(f"{error.filename or folder}: {error.strerror or error}")
    for path in written:
        say(path)
    _tell(made)


def _write(
    folder: Path, made: SiteDraft, name: str, plane: Airframe, plane_file: Path
) -> list[Path]:
    """All files or none: they are complete, and the site passes its loader, before any is moved."""
    new = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory(dir=folder, prefix=".site-") as stage:
            staged = Path(stage)
            write_npz(staged / GRID_FILE, made.field)
            path = staged / SITE_FILE_NAME
            path.write_text(site_text(made, name), encoding="utf-8")
            tolerance_m = max(TOLERANCE_M, (made.bounds[1] - made.bounds[0]) / 5000.0)
            table = contour_toml(plane, load_site(path), staged, made.bounds, tolerance_m)
            with path.open("a", encoding="utf-8") as file:
                file.write(CONTOUR_WARNING + table)
            load_parameters(plane, plane_file, load_site(path), path)
            try:
                from tgl_soar.analysis.report.terrain_figure import map_figure, plane_figure

                map_figure(staged / MAP, made, name)
                plane_figure(staged / PLANE, made, plane.polar.as_polar(), name)
            except ImportError as error:
                hint(f"no figures: {error}")
            names = [n for n in (SITE_FILE_NAME, GRID_FILE, MAP, PLANE) if (staged / n).exists()]
            for each in reversed(names):  # the site file last: what it names is there
                (staged / each).chmod(0o644)
                (staged / each).replace(folder / each)
    except BaseException:
        if new:
            folder.rmdir()
        raise
    return [folder / each for each in names]


def _tell(made: SiteDraft) -> None:
    """What was found, and what of it is a guess."""
    place = landing_place(made)
    say(
        f"a slope of {made.steepest_deg:.0f}° at its steepest, in a wind of"
        f" {made.field.reference_wind_mps:g} m/s from {made.wind_from_deg % 360.0:.0f}°; [ground]"
        f" in {len(made.ground.points)} points, at most {made.ground.above_m:.1f} m above the"
        " model's"
    )
    if place is None:
        say("no level place to land before the slope within the profile: look for one on the spot")
    else:
        say(f"level before the slope: {place[0]:.5f}, {place[1]:.5f}; inspect it on the spot")
    say("wind and contour are guessed by potential flow: correct them from flights")
