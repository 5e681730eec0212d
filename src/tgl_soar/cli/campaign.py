"""`tgl-soar campaign`: many flights with faults, and long ones."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from tgl_soar.analysis.experiments import campaign
from tgl_soar.analysis.experiments.long_flight import Part, fly_long
from tgl_soar.analysis.experiments.safety_timeline import draw_safety_timeline
from tgl_soar.cli.console import (
    MODEL_HELP,
    Commands,
    FlightModel,
    console,
    errors,
    fail,
    hint,
    say,
)

campaign_app = Commands(help="Many flights with faults, and long ones.", no_args_is_help=True)

TIMELINE = Path("images") / "safety-timeline.png"


@campaign_app.command()
def faults(
    flights: Annotated[int, typer.Option(help="To fly.", min=1, max=1_000_000)] = 2000,
    dropouts: Annotated[
        int, typer.Option(help="Of each drop-out that must be survived.", min=0, max=100_000)
    ] = 200,
    seed: Annotated[int, typer.Option(help="Of all that is drawn.", min=0)] = 1,
    model: Annotated[FlightModel | None, typer.Option(help=MODEL_HELP)] = None,
    workers: Annotated[
        int, typer.Option(help="Processes that fly; 0: none but this one.", min=0, max=256)
    ] = os.cpu_count() or 1,
    out: Annotated[Path, typer.Option(help="Folder for the outcome of every flight.")] = Path(
        "out/campaign"
    ),
    docs: Annotated[
        Path | None, typer.Option(help="Write the table and its figure into safety.md here.")
    ] = None,
) -> None:
    """Fly with faults drawn at random; exit code 1 if any flight was lost or any command bad."""
    page = docs / "safety.md" if docs is not None else None
    if page is not None and not page.is_file():
        fail(f"--docs {docs}: there is no {page}")
    out.mkdir(parents=True, exist_ok=True)
    jobs = campaign.drawn_jobs(flights, seed)
    lengths = campaign.survival_jobs(dropouts, seed)
    if model is not None:
        if page is not None:
            fail("--docs goes without --model: the table is that of the airframe file's own")
        jobs = [job._replace(model=model.kind) for job in jobs]
        lengths = [job._replace(model=model.kind) for job in lengths]
    begun = time.monotonic()
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("flights"),
        TimeElapsedColumn(),
        console=errors,
        transient=True,
    ) as progress:
        task = progress.add_task("campaign", total=len(jobs) + len(lengths))
        flown = campaign.fly_all(
            [*jobs, *lengths], workers, lambda count: progress.update(task, completed=count)
        )
    took = time.monotonic() - begun
    outcomes, survivals = flown[: len(jobs)], campaign.survivals(flown[len(jobs) :])
    text = json.dumps([outcome._asdict() for outcome in flown], indent=0, ensure_ascii=False)
    (out / "faults.json").write_text(text + "\n", encoding="utf-8")
    _print(outcomes, survivals if dropouts else [])
    say(f"{len(flown)} flights in {took:.0f} s; every one of them in {out}/faults.json")
    if page is not None:
        command = f"tgl-soar campaign faults --flights {flights} --seed {seed}"
        written = campaign.section(outcomes, survivals if dropouts else [], command)
        page.write_text(
            campaign.with_section(page.read_text(encoding="utf-8"), written), encoding="utf-8"
        )
        say(f"table in {page}")
        _draw(page.parent / TIMELINE)
    bad = [o for o in outcomes if o.bad_commands or o.error or o.result == campaign.LOST]
    if bad:
        fail(f"{len(bad)} flights were lost, or had bad commands; first: {bad[0]}", 1)


@campaign_app.command()
def timeline(
    out: Annotated[Path, typer.Option(help="Where the figure goes.", dir_okay=False)] = Path(
        "out/safety-timeline.png"
    ),
) -> None:
    """Draw a flight with one drop-out of the position, and one that the pilot takes over."""
    out.parent.mkdir(parents=True, exist_ok=True)
    if not _draw(out):
        raise typer.Exit(1)


@campaign_app.command()
def long(
    hours: Annotated[float, typer.Option(help="Simulated.", min=0.001, max=1000.0)] = 24.0,
    seed: Annotated[int, typer.Option(help="Of noise and turbulence.", min=0)] = 1,
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
    console.print(shown)
    console.print(
        f"{flight.ticks:,} ticks of {flight.expected_ticks:,}; {flight.reboots} restarts seen,"
        f" {flight.stale} stale and {flight.lost} lost frames;"
        f" {flight.grown_kib} KiB more memory at the end than after the first part"
    )
    if not flight.is_well:
        fail(f"ended early: {flight.ended}" if flight.ended else "the flight was not well", 1)


def _print(outcomes: list[campaign.Outcome], survivals: list[campaign.Survival]) -> None:
    shown = Table("fault", "flights", "soaring", "flying", "released", "lost", "why")
    for row in campaign.rows(outcomes):
        counts = (row.results[r] for r in campaign.RESULTS)
        why = ", ".join(f"{reason} ({n})" for reason, n in row.reasons.most_common())
        shown.add_row(row.name, str(row.flights), *(str(n) if n else "·" for n in counts), why)
    console.print(shown)
    for each in survivals:
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
