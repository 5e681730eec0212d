"""`tgl-soar report`: the page of a flight, from its log."""

from __future__ import annotations

from collections.abc import Callable
from math import radians
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from tgl_soar.analysis.logs.ulog_reader import LogError
from tgl_soar.cli.console import AIRFRAME_FILE, SITE_FILE, errors, fail, say
from tgl_soar.cli.log_argument import HELP, METAVAR, of_the_log, one_log
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import (
    ConfigError,
    airframe_from,
    load_airframe,
    load_parameters,
    load_site,
    preset_lines,
    site_from,
)
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import GridAir, PolynomialAir, Site
from tgl_soar.control.target_line import eta_from_lean

if TYPE_CHECKING:
    from tgl_soar.analysis.report.flight_report_figures import Surroundings

STEPS = 10  # reading, reckoning, and the parts of the page


def report(
    logs: Annotated[list[Path], typer.Argument(metavar=METAVAR, help=HELP)],
    site: Annotated[
        Path | None,
        typer.Option(help="Site file. Default: that of the module's log.", **SITE_FILE),
    ] = None,
    airframe: Annotated[
        Path | None,
        typer.Option(
            help="Airframe file. Default: that of the module's log.",
            **AIRFRAME_FILE,
        ),
    ] = None,
    field: Annotated[
        Path | None,
        typer.Option(help="Wind field instead of the site's air: a grid file, or a site file."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Page, or a folder for it. Default: out/report/LOG.html"),
    ] = None,
) -> None:
    """Write the page of a flight: figures, legs, spectra, health. Exit code 1 if data was lost."""
    log = one_log(logs)
    page = page_of(log, out)
    try:
        with Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            console=errors,
            transient=True,
        ) as progress:
            task = progress.add_task("Reading the log", total=STEPS)

            def step(words: str) -> None:
                progress.update(task, advance=1, description=words)

            lost = write(log, page, Named(site, airframe, field), step)
    except (LogError, ConfigError, ImportError) as error:
        fail(error)
    except OSError as error:
        fail(f"{error.filename or page}: cannot be written: {error.strerror}")
    except KeyboardInterrupt:
        fail("stopped", 130)
    for text in lost:
        errors.print(f"lost: {text}", style="yellow", highlight=False, markup=False)
    say(f"page in {page}, figures in {page.parent / f'{page.stem}-figures'}/")
    if lost:
        fail("what could be read is in the page; what was lost is listed there and above", 1)


def page_of(log: Path, out: Path | None) -> Path:
    """Where the page goes."""
    if out is None:
        return Path("out/report") / f"{log.stem}.html"
    return out if out.suffix.lower() in (".html", ".htm") else out / f"{log.stem}.html"


class Named(NamedTuple):
    """The files that the user names; None: the log's own, where it holds one."""

    site: Path | None = None
    airframe: Path | None = None
    field: Path | None = None


def write(log: Path, page: Path, named: Named, step: Callable[[str], None]) -> tuple[str, ...]:
    """Write the page; what the log has lost.

    step is given what comes next.
    Errors: `LogError`, `ConfigError`, ImportError without an extra, OSError.
    """
    from tgl_soar.analysis.logs.flight_data import steered
    from tgl_soar.analysis.logs.open_log import read_flight
    from tgl_soar.analysis.report.flight_page import analysed, write_page

    flight = read_flight(log)
    step("Legs and spectra")
    site, notes = of_the_log(flight, "site", named.site, (load_site, site_from))
    files = load_airframe, airframe_from
    airframe, more = of_the_log(flight, "airframe", named.airframe, files)
    known, unread = _surroundings(site, airframe, named)
    frame = None if site is None else site.frame()
    if airframe is not None:
        flight = steered(flight, airframe.surfaces)
    analysis = analysed(flight, known, frame)
    analysis = analysis._replace(missing=(*analysis.missing, *notes, *more, *unread))
    write_page(page, analysis, step)
    return flight.lost


def _surroundings(
    site: Site | None, airframe: Airframe | None, named: Named
) -> tuple[Surroundings, list[str]]:
    """What is known of place, aircraft and air, and what could not be had of it.

    Of a site that only the log holds no file is opened: a log may be a stranger's, and would
    choose which file of this computer the page shows.
    """
    from tgl_soar.analysis.report.flight_report_figures import Surroundings
    from tgl_soar.sim.world import ground_outline, site_field

    lines = {}
    blown = site
    air = None if site is None else site.air
    if site is not None:
        values = ParameterSet()
        if airframe is not None:
            values = load_parameters(airframe, "airframe", site, "site")
        lines = {
            line.name: (line.x_m, line.z_m, eta_from_lean(radians(line.lean_deg)))
            for line in preset_lines(site, values)
        }
    wind: Any = None
    notes = []
    folder = Path() if named.site is None else named.site.parent
    called = named.site
    source = air.of if isinstance(air, PolynomialAir) else air
    if named.site is None and named.field is None and isinstance(source, GridAir):
        notes.append(
            f"the site's air is in a file that the log does not hold, {source.file}, and that is"
            " not opened at its word: name the site file by --site, or the grid by --field"
        )
        air = None
    if named.field is not None and named.field.suffix.lower() == ".toml":
        blown = load_site(named.field)
        air, folder, called = blown.air, named.field.parent, named.field
        if air is None:
            raise ConfigError(f"{named.field}: no [air] table, so there is no field in it")
    elif named.field is not None:
        wind, air = _grid(named.field), None
    if blown is not None and air is not None:
        wind = site_field(blown, folder, called)
    return (
        Surroundings(
            site="" if site is None else site.site.name,
            airframe="" if airframe is None else airframe.airframe.name,
            lines=lines,
            field=wind,
            polar=None if airframe is None else airframe.polar.as_polar(),
            ground=None if air is None else ground_outline(air),
        ),
        notes,
    )


def _grid(path: Path) -> Any:
    """A grid file with the columns x, z, u, w in the soaring frame.  Errors: `ConfigError`."""
    from tgl_soar.air.grid import GridError
    from tgl_soar.air.grid_files import Layout, read_grid

    try:
        return read_grid(path, Layout(), reference_wind_mps=1.0, zero_cells="solid")
    except (GridError, OSError) as error:
        raise ConfigError(
            f"--field {error}; a file with other columns is named by a site file's [air]"
        ) from None
