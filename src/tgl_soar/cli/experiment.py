"""`tgl-soar experiment`: the paper's experiments, each one command."""

from __future__ import annotations

import json
import time
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from tgl_soar.analysis.experiments.catalogue import (
    APART,
    EXPERIMENTS,
    RIGID_BODY_ALONE,
    TITLES,
    TOGETHER,
    run_whole,
)
from tgl_soar.analysis.experiments.catalogue import run as run_experiment
from tgl_soar.analysis.experiments.context import COMPILED_FROM, Context
from tgl_soar.analysis.experiments.flights import FlownFolder, Flyer
from tgl_soar.analysis.experiments.pages import (
    IMAGES,
    OWN_PAGES,
    counted,
    marks,
    pages,
    with_result,
)
from tgl_soar.analysis.experiments.result import Result, as_json
from tgl_soar.analysis.experiments.staleness_probes import probe_for, probe_for_page
from tgl_soar.cli.batch_options import (
    ALL,
    NO_TABLE,
    Dispersion,
    Restart,
    Resume,
    Scheduler,
    Workers,
    executor_of,
    flight_bar,
    page_to_write,
    to_resume,
    warn_of_no_table,
)
from tgl_soar.cli.console import MODEL_HELP, FlightModel, console, fail, hint, say, show
from tgl_soar.config.files import ConfigError, load_site
from tgl_soar.config.site import air_files
from tgl_soar.sim.campaign.cluster import ClusterError
from tgl_soar.sim.campaign.executors import WorkerLost
from tgl_soar.sim.campaign.folder import JOURNAL
from tgl_soar.sim.campaign.journal import JournalError
from tgl_soar.sim.campaign.provenance import files_digest

FLIGHTS = "flights"  # of --out

COLOURS = {
    "agrees": "green",
    "agrees in part": "yellow",
    "differs": "red",
    "undecided": "yellow",
    "by construction": "cyan",
    "met": "green",
    "met in part": "yellow",
    "missed": "red",
}


EPISODES = typer.Option(help="For `search`, `nowhere`: places of each kind.", min=1, max=10_000)


def experiment(
    name: Annotated[
        str, typer.Argument(help="Name of an experiment; `paper`, `aims` or `all`; or `list`.")
    ] = "list",
    out: Annotated[Path, typer.Option(help="Folder for figures and numbers.")] = Path(
        "out/experiments"
    ),
    docs: Annotated[
        Path | None,
        typer.Option(
            help="With `all`, `paper`, `aims`: fly both models and dispersed aircraft, write"
            " experiments.md, aims.md and figures into this folder; with an experiment that has"
            " a section on another page: fly dispersed aircraft too, and write that."
        ),
    ] = None,
    model: Annotated[FlightModel | None, typer.Option(help=MODEL_HELP)] = None,
    field: Annotated[
        Path | None,
        typer.Option(help="A site file, as of a CFD plane: `places` flies in its air alone."),
    ] = None,
    workers: Workers = ALL,
    scheduler: Scheduler = None,
    resume: Resume = False,
    restart: Restart = False,
    episodes: Annotated[int | None, EPISODES] = None,
    dispersion: Dispersion = False,
    quick: Annotated[
        bool, typer.Option("--quick", help="One seed of each: to try the command, not to cite.")
    ] = False,
) -> None:
    """Fly the paper's experiments and our own; print verdicts, write figures and numbers."""
    if name == "list":
        _print_titles()
        return
    section = name if field is None else f"{name} --field SITE"
    _refuse(name, section, docs, model, quick, dispersion)
    names = _named(name, model)
    figures: Path | None = out if docs is None else docs / IMAGES
    if not _can_draw():
        if docs is not None:
            fail("--docs needs figures, and they need matplotlib: pip install 'tgl_soar[figures]'")
        figures = None
    compiled_from = 2 if name in TOGETHER and not quick else COMPILED_FROM  # one serves the next
    run = run_experiment if docs is None else run_whole
    begun = time.monotonic()
    results: list[Result] = []
    folder = _folder(out, field, resume=resume, restart=restart)
    executor = executor_of(workers, scheduler)
    try:
        with closing(folder), flight_bar(names[0]) as bar:
            flyer = Flyer(on_flight=lambda p: bar.show(*p), executor=executor, folder=folder)
            context = Context(
                flyer=flyer,
                figures=figures,
                quick=quick,
                model=None if model is None else model.kind,
                field=field,
                compiled_from=compiled_from,
                episodes=episodes,
                dispersion=dispersion,
            )
            for each in names:
                bar.title(each)
                folder.begin(each)
                results.append(run(each, context))
                _put_out(each, results[-1], out)
            tabulated = folder.finish()
    except (ConfigError, JournalError, WorkerLost, ClusterError) as error:
        fail(error)
    except KeyboardInterrupt:
        fail(f"stopped: what was flown is kept in {out / FLIGHTS}; --resume goes on", 130)
    if len(results) > 1:
        _print_summary(results)
    _print_flown(flyer, time.monotonic() - begun, out, tabulated)
    _print_figures(figures)
    _write_pages(docs, section, results)


def _print_flown(flyer: Flyer, took_s: float, out: Path, tabulated: bool) -> None:
    """How many flights there were, and where they are."""
    console.print(
        f"{flyer.flown} flights, {flyer.simulated_s:.0f} s of flight, in {took_s:.0f} s;"
        f" numbers in {out}/"
    )
    if not tabulated:
        hint(f"flights in {out / FLIGHTS}, {NO_TABLE}")


def _folder(out: Path, field: Path | None, *, resume: bool, restart: bool) -> FlownFolder:
    """Where flights are kept; at a site file by what it and the files of its air say."""
    named = ""
    if field is not None:
        try:
            air = load_site(field).air
        except ConfigError as error:
            fail(error)
        named = files_digest([field, *(air_files(air, field.parent) if air is not None else ())])
    path = to_resume(out / FLIGHTS, resume)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        fail(f"--out {out}: cannot be written: {error.strerror}; name another folder")
    warn_of_no_table(JOURNAL)
    return FlownFolder(path, resume=resume, restart=restart, named=named)


def _put_out(name: str, result: Result, out: Path) -> None:
    """Print it, and write its numbers."""
    text = json.dumps(as_json(result), indent=1, ensure_ascii=False)
    try:
        (out / f"{name}.json").write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        fail(f"{out / name}.json: cannot be written: {error.strerror}")
    _print(result)
    for also in result.also.values():
        _print(also)


def _print_figures(figures: Path | None) -> None:
    if figures is None:
        hint("no figures: they need matplotlib: pip install 'tgl_soar[figures]'")
    else:
        console.print(f"figures in {figures}/")


def _write_pages(docs: Path | None, section: str, results: list[Result]) -> None:
    if docs is None:
        return
    if section in OWN_PAGES:
        page = docs / OWN_PAGES[section]
        ends = probe_for(page.name, section)
        written = with_result(page.read_text(encoding="utf-8"), results[0], section, ends)
        page.write_text(written, encoding="utf-8")
        say(f"section in {page}")
        return
    for name, text in pages(results, probe_for_page).items():
        (docs / name).write_text(text, encoding="utf-8")
        say(f"page in {docs / name}")


def _print_titles() -> None:
    table = Table("name", "what", box=None)
    for known, title in TITLES.items():
        table.add_row(known, title)
    show(table)


def _refuse(
    name: str,
    section: str,
    docs: Path | None,
    model: FlightModel | None,
    quick: bool,
    dispersion: bool,
) -> None:
    """End with what is wrong with the arguments, if anything is."""
    if name not in TOGETHER and name not in EXPERIMENTS:
        known = ", ".join((*EXPERIMENTS, *TOGETHER))
        fail(f"no experiment named {name!r}; there are {known}")
    if section != name and name != "places":
        fail("--field goes with `places`: no other experiment has a place of its own in any air")
    if docs is not None and (section not in (*TOGETHER, *OWN_PAGES) or quick):
        names = ", ".join((*TOGETHER, *OWN_PAGES))
        fail(
            f"--docs goes with {names}, without --quick: a page has all of its experiments in full"
        )
    if docs is not None and section in OWN_PAGES:
        page_to_write(docs, OWN_PAGES[section], marks(section))
    if docs is not None and model is not None:
        fail("--docs goes without --model: the page shows all of them")
    if dispersion and (name in TOGETHER or docs is not None or model == FlightModel.POINT_MASS):
        fail("--dispersion goes with one experiment, on the rigid body, without --docs")


def _named(name: str, model: FlightModel | None) -> list[str]:
    """The experiments that a name means: of several those that the model can fly."""
    if name not in TOGETHER:
        return [name]
    if name != "paper":
        hint(f"not flown: {', '.join(APART)}, apart from these")
    if model != FlightModel.POINT_MASS:
        return list(TOGETHER[name])
    hint(f"not flown: {', '.join(RIGID_BODY_ALONE)} are about the rigid body alone")
    return [each for each in TOGETHER[name] if each not in RIGID_BODY_ALONE]


def _can_draw() -> bool:
    from importlib.util import find_spec

    return find_spec("matplotlib") is not None


def _print(result: Result) -> None:
    console.rule(f"[bold]{result.name}[/bold]: {result.title}", align="left")
    console.print(result.flown, markup=False, highlight=False)
    for content in result.tables:
        title = escape(content.title) or None
        table = Table(*map(escape, content.columns), title=title, title_justify="left")
        for row in content.rows:
            table.add_row(*map(escape, row))
        show(table)
    colour = COLOURS[result.verdict]
    console.print(f"verdict: [{colour}]{result.verdict}[/{colour}]")
    for claim in result.claims:
        mark = "[green]✓[/green]" if claim.holds else "[red]✗[/red]"
        if claim.undecided:
            mark = "[yellow]?[/yellow] undecided:"
        console.print(f"  {mark} ", end="")
        text = f"{claim.text} (by construction)" if claim.by_construction else claim.text
        console.print(f"{text}: {claim.measured}", markup=False, highlight=False)
    if result.why:
        console.print(result.why, markup=False, highlight=False)
    for flight in result.badly:
        console.print(f"  - {flight}", markup=False, highlight=False)
    console.print()


def _print_summary(results: list[Result]) -> None:
    table = Table("experiment", "verdict", "time")
    for r in results:
        table.add_row(
            r.name,
            f"[{COLOURS[r.verdict]}]{counted(r)}[/{COLOURS[r.verdict]}]",
            f"{r.seconds:.0f} s",
        )
    show(table)
