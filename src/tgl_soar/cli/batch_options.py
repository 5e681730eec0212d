"""The options of commands that fly many flights, and what they print meanwhile."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from math import isfinite
from pathlib import Path
from threading import Event, Thread
from typing import Annotated, Any, Final

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn

from tgl_soar.analysis.experiments.pages import between
from tgl_soar.cli.console import errors, fail, hint
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import line_parameters, load_flight
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.config.site import Site
from tgl_soar.sim.campaign.cluster import ClusterError, DaskCluster
from tgl_soar.sim.campaign.executors import Executor, local
from tgl_soar.sim.campaign.folder import JOURNAL, MANIFEST, ROWS, CampaignFolder
from tgl_soar.sim.campaign.rows import MISSING, available

# Where flights are kept and their table is not: what writes it of them.
NO_TABLE: Final = f"no table: {MISSING}, then the same command with --resume"
COMPILES: Final = "the first one of a version is compiled, which takes minutes"
LINE_S: Final = 30.0  # between two lines of progress: nobody waits longer without a sign of life
ALL: Final = os.cpu_count() or 1
Workers = Annotated[int, typer.Option(help="Processes that fly; 0: only this one.", min=0, max=256)]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="tcp://HOST:PORT", help="Fly on the workers of a dask scheduler (extra `cluster`)."
    ),
]
Resume = Annotated[
    bool, typer.Option("--resume", help="Go on with the flights that an earlier run has kept.")
]
Restart = Annotated[
    bool, typer.Option("--restart", help="Delete the flights of an earlier run, and begin again.")
]

Dispersion = Annotated[
    bool,
    typer.Option(
        "--dispersion",
        help="Let each flight's aircraft differ from the airframe file, and its air from the"
        " site's.",
    ),
]


def files_of(airframe: Path, site: Path, line: str | None) -> tuple[Airframe, Site, ParameterSet]:
    """Both files and their parameters, on one of the site's lines; ends where it has no such line.

    Errors: `ConfigError`, `ParameterError`.
    """
    plane, place, values = load_flight(airframe, site)
    if line is None:
        return plane, place, values
    if line not in place.lines:
        known = ", ".join(place.lines) or "none"
        fail(f"--line {line}: no line of {site}; it has {known}")
    return plane, place, values.changed(line_parameters(place.lines[line]))


def executor_of(workers: int, scheduler: str | None) -> Executor:
    """Whoever is to fly; ends with what is wrong."""
    if scheduler is None:
        return local(workers)
    try:
        return DaskCluster(scheduler)
    except (ImportError, ClusterError) as error:
        fail(error)


def to_resume(folder: Path, resume: bool) -> Path:
    """The folder; ends where flights are to be gone on with and there are none."""
    if resume and not any(next(folder.rglob(name), None) for name in (JOURNAL, MANIFEST)):
        fail(
            f"--resume: no flights of an earlier run are in {folder}: go without it, or name the"
            " folder of that run with --out"
        )
    return folder


def warn_of_no_table(instead: str) -> None:
    """Say before the first flight where there will be no Parquet table, and what there will be."""
    if not available():
        hint(f"there will be no {ROWS}, but {instead}: {MISSING}")


def changes_of(given: list[str]) -> dict[str, float]:
    """Parameters of --param NAME=VALUE; ends where one is not written so."""
    changes = {}
    for text in given:
        name, _, value = text.partition("=")
        try:
            changes[name.strip().upper()] = float(value)
        except ValueError:
            fail(f"--param {text}: must be NAME=VALUE, as RHO_P=0.8")
    return changes


def page_to_write(docs: Path, name: str, marks: tuple[str, str]) -> Path:
    """A page with marks to write between; ends, before anything is flown, where there is none."""
    page = docs / name
    if not page.is_file():
        fail(f"--docs {docs}: there is no {page}")
    try:
        between(page.read_text(encoding="utf-8"), *marks, "")
    except (OSError, ValueError) as error:
        fail(f"--docs {docs}: {page}: {error}")
    return page


class FlightBar:
    """How far it is, with rate and time left."""

    def __init__(self, progress: Progress, task: TaskID) -> None:
        self._progress, self._task = progress, task

    def title(self, text: str) -> None:
        """What is flown."""
        self._progress.update(self._task, description=text)

    def show(self, flown: int, of: int, per_s: float, left_s: float) -> None:
        """Of flights; left_s: inf where it is not known."""
        self._progress.update(self._task, completed=flown, total=of, pace=pace_words(per_s, left_s))


class FlightLines:
    """The same for a file or a pipe: a line every `LINE_S`, and none of what is done sooner."""

    def __init__(self, title: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._title, self._clock = title, clock
        self._last_s = clock()
        self._flown, self._of = 0, 0

    def title(self, text: str) -> None:
        """What is flown."""
        self._title = text
        self._flown, self._of = 0, 0

    def show(self, flown: int, of: int, per_s: float, left_s: float) -> None:
        """As `FlightBar`."""
        self._flown, self._of = flown, of
        pace = pace_words(per_s, left_s)
        if self._is_due():
            hint(f"{self._title}: {flown} of {of} flights" + (f", {pace}" if pace else ""))

    def still(self) -> str:
        """A line while nothing new is shown; "" where there was one a moment ago."""
        if not self._is_due():
            return ""
        if not self._of:
            return f"{self._title}: no flight yet"
        shown = f"{self._title}: {self._flown} of {self._of} flights"
        return shown if self._flown else f"{shown}; {COMPILES}"

    def _is_due(self) -> bool:
        now_s = self._clock()
        if now_s - self._last_s < LINE_S:
            return False
        self._last_s = now_s
        return True


@contextmanager
def going_on(lines: FlightLines) -> Iterator[None]:
    """Lines also while no flight ends.

    They are written as they are: of a pipe that nobody reads any more rich would end the thread
    that it prints in, and take the other output with it.
    """
    done = Event()

    def go_on() -> None:
        while not done.wait(LINE_S):
            line = lines.still()
            with suppress(OSError, ValueError):
                if line:
                    print(line, file=sys.stderr, flush=True)

    beside = Thread(target=go_on, daemon=True)
    beside.start()
    try:
        yield
    finally:
        done.set()
        beside.join()


def pace_words(per_s: float, left_s: float) -> str:
    """Rate and time left; "" where they are not known."""
    return f"{per_s:.3g} a second, {duration(left_s)} left" if isfinite(left_s) else ""


@contextmanager
def flight_bar(title: str) -> Iterator[FlightBar | FlightLines]:
    """A bar on the terminal while flights are flown; lines where there is none."""
    if not errors.is_terminal:
        lines = FlightLines(title)
        with going_on(lines):
            yield lines
        return
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("flights {task.fields[pace]}"),
        console=errors,
        transient=True,
    ) as progress:
        yield FlightBar(progress, progress.add_task(title, total=None, pace=""))


def fly_folder(
    folder: CampaignFolder[Any, Any], executor: Executor, *, first_here: bool = False
) -> None:
    """Fly what is missing of a campaign, with a bar; ends where it is stopped.

    Errors: those of `CampaignFolder.fly`.
    """
    if folder.damaged:
        hint(
            f"{folder.path / JOURNAL}: {folder.damaged} bytes were damaged; their flights are flown"
            " again"
        )
    try:
        with flight_bar(folder.campaign.name) as bar:
            folder.fly(executor, lambda progress: bar.show(*progress), first_here=first_here)
    except KeyboardInterrupt:
        count = len(folder.campaign.jobs)
        fail(f"stopped: {folder.flown} of {count} flights are kept; --resume goes on", 130)


def duration(seconds: float) -> str:
    """As somebody says it who waits: 42 s, 3 min, 1 h 20 min."""
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
