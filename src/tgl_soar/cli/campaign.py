"""`tgl-soar campaign`: many flights, with faults and without, and long ones."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from tgl_soar.analysis.campaigns import drawn_faults, report
from tgl_soar.analysis.campaigns.long_flight import Part, fly_long
from tgl_soar.analysis.campaigns.safety_timeline import draw_safety_timeline
from tgl_soar.analysis.experiments.staleness_probes import stamped
from tgl_soar.cli.batch_options import (
    ALL,
    NO_TABLE,
    Dispersion,
    Restart,
    Resume,
    Scheduler,
    Workers,
    executor_of,
    fly_folder,
    page_to_write,
    to_resume,
    warn_of_no_table,
)
from tgl_soar.cli.console import (
    MODEL_HELP,
    Commands,
    FlightModel,
    console,
    errors,
    fail,
    hint,
    say,
    show,
)
from tgl_soar.cli.flights import flights as many_flights
from tgl_soar.cli.rare import rare
from tgl_soar.sim.campaign.cluster import ClusterError
from tgl_soar.sim.campaign.executors import WorkerLost
from tgl_soar.sim.campaign.folder import JOURNAL, ROWS, CampaignFolder
from tgl_soar.sim.campaign.journal import JournalError
from tgl_soar.sim.campaign.rows import MISSING

campaign_app = Commands(
    help="Many flights, with faults and without, and long ones.", no_args_is_help=True
)
campaign_app.command()(many_flights)
campaign_app.command()(rare)

TIMELINE = Path("images") / "safety-timeline.png"


@campaign_app.command()
def faults(
    flights: Annotated[int, typer.Option(help="Flights to fly.", min=1, max=100_000_000)] = 2000,
    dropouts: Annotated[
        int,
        typer.Option(help="Flights for each drop-out that must be survived.", min=0, max=100_000),
    ] = 200,
    seed: Annotated[
        int,
        typer.Option(
            help="Seed of the first flight; the others have the seeds after it, so campaigns whose"
            " seeds are nearer than their flights share some.",
            min=0,
        ),
    ] = 1,
    model: Annotated[FlightModel | None, typer.Option(help=MODEL_HELP)] = None,
    dispersion: Dispersion = False,
    workers: Workers = ALL,
    scheduler: Scheduler = None,
    resume: Resume = False,
    restart: Restart = False,
    out: Annotated[Path, typer.Option(help="Folder for the outcome of every flight.")] = Path(
        "out/campaign"
    ),
    docs: Annotated[
        Path | None,
        typer.Option(
            help="Write the table into safety.md in this folder, with --dispersion its own section."
        ),
    ] = None,
) -> None:
    """Fly with faults drawn at random; exit code 1 if any flight was lost or any command bad.

    Every flight is stored as soon as it is flown. If the command is stopped or killed, --resume
    continues. At the end each flight is a row of rows.parquet; see `campaign report`.
    """
    marks = drawn_faults.DISPERSED_MARKS if dispersion else drawn_faults.MARKS
    page = None if docs is None else page_to_write(docs, "safety.md", marks)
    if page is not None and model is not None:
        fail("--docs goes without --model: the tables use the airframe file's model")
    if dispersion and model == FlightModel.POINT_MASS:
        fail("--dispersion needs the rigid body: the point mass has none of these figures")
    kind = None if model is None else model.kind
    jobs = drawn_faults.FaultJobs(
        flights=flights, dropouts=dropouts, seed=seed, model=kind, dispersed=dispersion
    )
    begun = time.monotonic()
    to_resume(out, resume)
    try:
        executor = executor_of(workers, scheduler)  # before anything that is there goes
        with CampaignFolder(
            out, drawn_faults.campaign_of(jobs), resume=resume, restart=restart
        ) as folder:
            warn_of_no_table(JOURNAL)
            fly_folder(folder, executor, first_here=True)
            counted = drawn_faults.count(folder)
            tabulated = folder.finish()
    except (JournalError, WorkerLost, ClusterError) as error:
        fail(error)
    took = time.monotonic() - begun
    _print(counted)
    where = out / ROWS if tabulated else f"{out / JOURNAL}, {NO_TABLE}"
    say(f"{len(jobs)} flights in {took:.0f} s; every one of them in {where}")
    if page is not None:
        command = (
            f"{drawn_faults.COMMAND} --flights {flights} --dropouts {dropouts} --seed {seed}"
            f"{' --dispersion' if dispersion else ''}"
        )
        whole = page.read_text(encoding="utf-8")
        name = "dispersed" if dispersion else "campaign"
        written = stamped(page.name, name, drawn_faults.section(counted, command))
        page.write_text(drawn_faults.with_section(whole, written, dispersion), encoding="utf-8")
        say(f"table in {page}")
        if not dispersion:
            _draw(page.parent / TIMELINE)
    if counted.troubles:
        first = counted.troubles[0]
        fail(f"{len(counted.troubles)} flights were lost, or had bad commands; first: {first}", 1)


@campaign_app.command("report")
def report_command(
    path: Annotated[Path, typer.Argument(help="A campaign's folder, or its rows.parquet.")],
    by: Annotated[
        str | None, typer.Option(help="Column whose values make groups; '' for all together.")
    ] = None,
    of: Annotated[str | None, typer.Option(help="Column that is counted or averaged.")] = None,
    beside: Annotated[
        Path | None,
        typer.Option(help="Another campaign: fractions of one class in both, group by group."),
    ] = None,
    counted: Annotated[
        str | None,
        typer.Option(
            "--class",
            help="With --beside: the class. Default: the most frequent of the first campaign.",
        ),
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(help="Also draw it (.png, .svg).", dir_okay=False)
    ] = None,
) -> None:
    """Tabulate the flights of any campaign or experiment by any of their columns, and draw them."""
    from tgl_soar.analysis.report.campaign_figure import campaign_figure, two_campaigns_figure

    try:
        found = report.report(path, by, of)
        if beside is not None:
            other = report.report(beside, found.by, found.of)
            two = report.beside(found, other, counted)
            _print_two(two, path, beside)
            if figure is not None:
                two_campaigns_figure(figure, two, (_folder(path), _folder(beside)))
        else:
            _print_report(found)
            if figure is not None:
                campaign_figure(figure, found)
        if figure is not None:
            say(f"figure in {figure}")
    except ImportError as error:
        fail(MISSING if error.name == "pyarrow" else error)
    except (OSError, ValueError) as error:
        fail(error)


def _folder(path: Path) -> str:
    """The name of a campaign's folder, whether it is named or its table."""
    whole = path.resolve()
    return whole.name if whole.is_dir() else whole.parent.name


def _print_two(two: report.TwoCampaigns, first: Path, second: Path) -> None:
    shown = Table(two.by, str(first), "95 % interval", str(second), "95 % interval", "")
    for row in two.rows:
        cells = []
        for fraction in row.fractions:
            low, high = fraction.interval
            cells += [
                f"{fraction.counted} of {fraction.of}",
                f"{100 * low:.3g} to {100 * high:.3g} %",
            ]
        shown.add_row(row.name, *cells, "apart" if row.is_apart else "")
    console.print(f"{two.of} {two.counted}, by {two.by or 'nothing'}")
    show(shown)
    say("apart: differs from zero, at 95 %; by chance one in twenty equal pairs does, too")
    for path, names in zip((first, second), two.alone, strict=True):
        if names:
            say(f"in {path} alone: {', '.join(names)}")


def _print_report(found: report.Report) -> None:
    if found.is_counted:
        classes = found.classes
        shown = Table(found.by, "flights", *classes, f"{classes[0]}, 95 % interval")
        for group in found.groups:
            low, high = drawn_faults.wilson(group.classes[classes[0]], group.flights)
            counts = (str(group.classes[name] or "·") for name in classes)
            between = f"{100 * low:.3g} to {100 * high:.3g} %"
            shown.add_row(group.name, str(group.flights), *counts, between)
    else:
        shown = Table(found.by, "flights", "unknown", "mean", "σ", "5 %", "half", "95 %")
        for group in found.groups:
            spread = group.spread()
            numbers = (spread.mean, spread.deviation, *spread.quantiles)
            shown.add_row(
                group.name, str(spread.flights), str(spread.unknown), *(f"{n:.4g}" for n in numbers)
            )
    console.print(f"{found.of}, by {found.by or 'nothing'}")
    show(shown)


@campaign_app.command()
def timeline(
    out: Annotated[Path, typer.Option(help="File of the figure.", dir_okay=False)] = Path(
        "out/safety-timeline.png"
    ),
) -> None:
    """Draw a flight with one drop-out of the position, and one that the pilot takes over."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        drawn = _draw(out)
    except (OSError, ValueError) as error:
        fail(f"--out {out}: no figure: {error}")
    if not drawn:
        raise typer.Exit(1)


@campaign_app.command()
def long(
    hours: Annotated[float, typer.Option(help="Simulated hours.", min=0.001, max=1000.0)] = 24.0,
    seed: Annotated[int, typer.Option(help="Seed of noise and turbulence.", min=0)] = 1,
    model: Annotated[FlightModel | None, typer.Option(help=MODEL_HELP)] = None,
) -> None:
    """Fly the whole module for hours across the wrap of the autopilot's clock."""
    shown = Table("flown", "memory", "a tick and its frames", "clock is late", "largest e_rho")
    with Progress(
        TextColumn("long flight"), BarColumn(), TimeElapsedColumn(), console=errors, transient=True
    ) as progress:
        task = progress.add_task("", total=3600.0 * hours)

        def on_part(part: Part) -> None:
            progress.update(task, completed=part.flown_s)
            shown.add_row(
                f"{part.flown_s / 3600.0:.3f} h",
                f"{part.resident_kib / 1024:.1f} MiB",
                f"{part.tick_us:.0f} µs",
                f"{part.late_s:g} s",
                f"{part.largest_e_rho_m * 100:.1f} cm",
            )

        kind = None if model is None else model.kind
        flight = fly_long(3600.0 * hours, seed=seed, on_part=on_part, model=kind)
    show(shown)
    console.print(
        f"{flight.ticks:,} ticks of {flight.expected_ticks:,}; {flight.reboots} restarts seen,"
        f" {flight.stale} stale and {flight.lost} lost frames;"
        f" {flight.grown_kib} KiB more memory at the end than after the first part"
    )
    if not flight.is_well:
        fail(f"ended early: {flight.ended}" if flight.ended else "the flight was not well", 1)


def _print(counted: drawn_faults.Counted) -> None:
    shown = Table("fault", "flights", "soaring", "flying", "released", "lost", "why")
    for row in counted.rows:
        counts = (row.results[r] for r in drawn_faults.RESULTS)
        why = ", ".join(f"{reason} ({n})" for reason, n in row.reasons.most_common())
        shown.add_row(row.name, str(row.flights), *(str(n) if n else "·" for n in counts), why)
    show(shown)
    for each in counted.survivals:
        low, high = each.interval
        console.print(
            f"{each.fault} at {each.turbulence * 100:g} %, {each.aboard}:"
            f" {each.survived} of {each.flights} survived,"
            f" {low * 100:.1f} to {high * 100:.1f} % at 95 %",
            highlight=False,
        )


def _draw(path: Path) -> bool:
    """Whether the figure was drawn."""
    try:
        draw_safety_timeline(path)
    except ImportError as error:
        hint(f"no figure: {error}")
        return False
    say(f"figure in {path}")
    return True
