"""`tgl-soar campaign flights`: many flights of one's own aircraft over one's own site."""

from __future__ import annotations

import csv
import time
from pathlib import Path
from typing import Annotated, Final

import typer
from rich.markup import escape
from rich.table import Table

from tgl_soar.analysis.campaigns import many_flights
from tgl_soar.analysis.campaigns.many_flights import FlightsAsked, FlightsSummary, LegJobs
from tgl_soar.cli.batch_options import (
    ALL,
    NO_TABLE,
    Dispersion,
    Restart,
    Resume,
    Scheduler,
    Workers,
    changes_of,
    executor_of,
    fly_folder,
    to_resume,
    warn_of_no_table,
)
from tgl_soar.cli.console import AIRFRAME, AIRFRAME_FILE, SITE, SITE_FILE, fail, say, show
from tgl_soar.config.parameters import ParameterError
from tgl_soar.sim.campaign.cluster import ClusterError
from tgl_soar.sim.campaign.executors import WorkerLost
from tgl_soar.sim.campaign.folder import ROWS, ROWS_CSV, CampaignFolder
from tgl_soar.sim.campaign.journal import JournalError
from tgl_soar.sim.compiled import available

TABLE: Final = "table.md"
TABLE_CSV: Final = "table.csv"


def flights(
    airframe: Annotated[Path, typer.Option(help="Airframe file.", **AIRFRAME_FILE)] = AIRFRAME,
    site: Annotated[Path, typer.Option(help="Site to fly at.", **SITE_FILE)] = SITE,
    legs: Annotated[str, typer.Option(help="Lines of the site, as a,b; default: all.")] = "",
    seconds: Annotated[float, typer.Option(help="Flight time.", min=10.0, max=3600.0)] = 60.0,
    turbulence: Annotated[
        str, typer.Option(help="Intensities, fractions of the wind, as 0.01,0.03.")
    ] = "0.01,0.03",
    number: Annotated[
        int,
        typer.Option(
            "--flights", help="Flights of each leg in each turbulence.", min=1, max=10_000_000
        ),
    ] = 50,
    dispersion: Dispersion = False,
    param: Annotated[
        list[str] | None,
        typer.Option(
            "--param", metavar="NAME=VALUE", help="A parameter unlike the files'; repeatable."
        ),
    ] = None,
    seed: Annotated[
        int,
        typer.Option(
            help="Seed of the first flight of each leg and turbulence; the others have the seeds"
            " after it.",
            min=0,
        ),
    ] = 1,
    workers: Workers = ALL,
    scheduler: Scheduler = None,
    resume: Resume = False,
    restart: Restart = False,
    out: Annotated[Path, typer.Option(help="Folder for the rows and the table.")] = Path(
        "out/flights"
    ),
) -> None:
    """Fly an aircraft many times over a site, without faults: a row for each flight, and a table.

    Every flight is stored as soon as it is flown. If the command is stopped or killed, --resume
    continues. At the end each flight is a row of rows.parquet; table.md and table.csv have a row
    for each leg and turbulence.
    """
    if not available():
        fail("these flights are compiled, which needs numba: pip install 'tgl_soar[fast]'")
    begun = time.monotonic()
    asked = FlightsAsked(
        airframe=airframe,
        site=site,
        legs=tuple(name.strip() for name in legs.split(",") if name.strip()),
        turbulences=_intensities(turbulence),
        flights=number,
        seed=seed,
        duration_s=seconds,
        dispersed=dispersion,
        parameters=changes_of(param or []),
    )
    to_resume(out, resume)
    try:
        jobs = many_flights.jobs_of(asked)
        executor = executor_of(workers, scheduler)  # before anything that is there goes
        campaign = many_flights.campaign_of(jobs)
        with CampaignFolder(out, campaign, resume=resume, restart=restart) as folder:
            warn_of_no_table(ROWS_CSV)
            fly_folder(folder, executor, first_here=True)
            found = many_flights.summarised(folder)
            tabulated = folder.finish()
            if not tabulated:
                folder.tabulate_as_csv()
    except (ParameterError, JournalError, WorkerLost, ClusterError, ValueError) as error:
        fail(error)
    _print(found)
    _write(out, jobs, found)
    rows = out / ROWS if tabulated else f"{out / ROWS_CSV}; {NO_TABLE}"
    took = f"{len(jobs)} flights in {time.monotonic() - begun:.0f} s"
    say(f"{took}; table in {out / TABLE}; a row for each in {rows}")


def _intensities(text: str) -> tuple[float, ...]:
    """Of --turbulence; ends where it is none."""
    most = many_flights.TURBULENCE_MOST
    try:
        found = tuple(dict.fromkeys(float(part) for part in text.split(",")))
    except ValueError:
        found = ()
    if not found or not all(0.0 <= each <= most for each in found):
        fail(f"--turbulence {text}: must be fractions of the wind, 0 to {most:g}, as 0.01,0.03")
    return found


def _flown(jobs: LegJobs) -> str:
    """What was flown, in words."""
    asked = jobs.asked
    parameters = ", ".join(f"{name} = {value:g}" for name, value in asked.parameters.items())
    return (
        f"{asked.flights} flights of {asked.duration_s:g} s of each leg in each turbulence:"
        f" {asked.airframe.name} over {asked.site.name}"
        f"{', aircraft and air dispersed' if asked.dispersed else ''}"
        f"{f', {parameters}' if parameters else ''};"
        f" seeds {asked.seed} to {asked.seed + asked.flights - 1}."
    )


def _print(found: list[FlightsSummary]) -> None:
    head, rows = many_flights.table_of(found)
    shown = Table(*map(escape, head))
    for row in rows:
        shown.add_row(*map(escape, row))
    show(shown)
    say(many_flights.EXPLAINED)


def _write(out: Path, jobs: LegJobs, found: list[FlightsSummary]) -> None:
    head, rows = many_flights.as_table(found)
    page = many_flights.as_markdown(_flown(jobs), found)
    try:
        (out / TABLE).write_text(page, encoding="utf-8")
        with (out / TABLE_CSV).open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([head, *rows])
    except OSError as error:
        fail(f"{out}: the table cannot be written: {error.strerror}; the flights are kept")
