"""`tgl-soar tune`: gains and their schedule for an airframe, with margins on aircraft like it."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from tgl_soar.cli.batch_options import ALL, Scheduler, Workers, executor_of, files_of
from tgl_soar.cli.console import (
    AIRFRAME,
    AIRFRAME_FILE,
    SITE,
    SITE_FILE,
    console,
    errors,
    fail,
    hint,
    say,
)
from tgl_soar.config.files import ConfigError, load_airframe
from tgl_soar.config.parameter_store import write_state
from tgl_soar.config.parameters import ParameterError
from tgl_soar.sim.campaign.cluster import ClusterError
from tgl_soar.sim.campaign.executors import WorkerLost

if TYPE_CHECKING:
    from tgl_soar.analysis.tuning.aircraft import Ranges
    from tgl_soar.analysis.tuning.progress_file import ProgressFile
    from tgl_soar.analysis.tuning.tune import Task, Tuned
    from tgl_soar.sim.campaign.executors import Executor

MANIFEST_SUFFIX: Final = ".manifest.json"  # behind the name of --out
ROWS_SUFFIX: Final = ".rows.parquet"  # likewise
TASK_DIGITS: Final = 12  # beside a gain in an airframe file: enough to find the task again


def tune_command(
    airframe: Annotated[
        Path,
        typer.Option(help="Airframe file, such as `identify --out` writes.", **AIRFRAME_FILE),
    ] = AIRFRAME,
    out: Annotated[
        Path,
        typer.Option("--out", "-o", help="Write gains, and their conditions, as TOML."),
    ] = Path("tuned.toml"),
    airframe_out: Annotated[
        Path | None, typer.Option(help="Also write the airframe file with these gains.")
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(help="Figure of e_rho against margin and activity, PNG or SVG.")
    ] = None,
    site: Annotated[Path, typer.Option(help="Site to fly at.", **SITE_FILE)] = SITE,
    line: Annotated[
        str | None, typer.Option(help="Line of the site to fly on. Default: the site's own.")
    ] = None,
    lean: Annotated[
        float | None,
        typer.Option(
            help="Lean of the line that gains are found for \\[degrees].", min=5.0, max=45.0
        ),
    ] = None,
    own: Annotated[
        bool,
        typer.Option(
            "--own",
            help="For this aircraft only: keep no margin for others that a file may describe.",
        ),
    ] = False,
    floor: Annotated[float, typer.Option(help="Least disk margin.", min=0.1, max=1.0)] = 0.5,
    seed: Annotated[int, typer.Option(help="Seed of all random numbers.", min=0)] = 1,
    workers: Workers = ALL,
    scheduler: Scheduler = None,
    flights: Annotated[
        int | None,
        typer.Option(help="Aircraft that judge the gains in flight; 0: none.", min=0, max=1000),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="A few steps, no flights: to try the command.")
    ] = False,
    restart: Annotated[
        bool, typer.Option("--restart", help="Discard the progress of an earlier run.")
    ] = False,
) -> None:
    """Search for gains on the linear model, choose and judge them in flight, and write them.

    A command that was killed continues when the same version is run again. A manifest beside the
    gains says where they come from, and a table has a row for each flight. Exit code 1: margins
    below the floor.
    """
    _check_outputs(airframe, out, airframe_out)
    try:
        task = _task(airframe, site, line, lean, (quick, flights))
        task = task._replace(floor=floor, seed=seed)
        if own:
            task = task._replace(ranges=_of_one(task))
        progress = _progress(task, out, restart=restart)
        tuned = _tuned(task, progress, executor_of(workers, scheduler))
        _write(task, tuned, airframe, line or "", out, airframe_out, figure)
        _write_origin(task, tuned, progress, out)
        progress.delete()
    except (ConfigError, ParameterError, ImportError, ClusterError, WorkerLost) as error:
        fail(error)
    except ValueError as error:
        fail(f"{airframe}: {error}")
    except OSError as error:
        fail(f"{error.filename or out}: cannot be written: {error.strerror}")
    except KeyboardInterrupt:
        fail("stopped: the same command goes on from here", 130)
    _print(tuned)
    least = min(tuned.after.values(), key=lambda given: given.alpha)
    if least.alpha < floor:
        fail(
            f"the least margin is {least.alpha:.2f}, below {floor:g}: at {least.worst};"
            " narrow TGL_LEAN_MIN, TGL_LEAN_MAX, or make the link or the servo faster",
            1,
        )


def _check_outputs(airframe: Path, out: Path, airframe_out: Path | None) -> None:
    for option, path in (("--out", out), ("--airframe-out", airframe_out)):
        if path is None:
            continue
        if path.resolve() == airframe.resolve():
            fail(f"{option} {path}: that is the file that is tuned; give another name")
        if not path.resolve().parent.is_dir():
            fail(f"{option} {path}: there is no folder {path.parent}")
    if airframe_out is not None and airframe_out.resolve() == out.resolve():
        fail(f"--airframe-out {airframe_out}: that is --out; give another name")


def _task(
    airframe: Path,
    site: Path,
    line: str | None,
    lean: float | None,
    effort: tuple[bool, int | None],
) -> Task:
    """What the files and options ask for.  Errors: `ConfigError`, `ParameterError`."""
    from tgl_soar.analysis.tuning import tune as tuning

    plane, _, values = files_of(airframe, site, line)
    quick, flights = effort
    asked = tuning.QUICK if quick else tuning.Effort()
    if flights is not None:
        asked = asked._replace(judging=flights, choosing=min(flights, asked.choosing))
    return tuning.Task(
        airframe=plane,
        site_path=site,
        values=values,
        lean_deg=values["RHO_LEAN"] if lean is None else lean,
        effort=asked,
    )


def _of_one(task: Task) -> Ranges:
    from tgl_soar.analysis.tuning.aircraft import ranges_of_one

    return ranges_of_one(task.airframe, task.values["CMD_DELAY"])


def _progress(task: Task, out: Path, *, restart: bool) -> ProgressFile:
    """What an earlier run has found."""
    from tgl_soar.analysis.tuning.progress_file import ProgressError, ProgressFile
    from tgl_soar.analysis.tuning.tune import digest

    kept = out.with_name(out.name + ".progress")
    if restart:
        kept.unlink(missing_ok=True)
    hint(f"progress in {kept}: run it again to go on from there")
    try:
        return ProgressFile(kept, digest(task))
    except ProgressError as error:
        fail(error)


def _tuned(task: Task, found: ProgressFile, executor: Executor) -> Tuned:
    from tgl_soar.analysis.tuning.tune import tune
    from tgl_soar.sim.campaign.rows import MISSING, available

    if not available():
        hint(f"there will be no table of the flights: {MISSING}")
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        console=errors,
        transient=True,
    ) as progress:
        shown = progress.add_task("tuning", total=1.0)
        return tune(
            task,
            found,
            lambda words, done: progress.update(shown, description=words, completed=done),
            executor,
        )


def _write(
    task: Task,
    tuned: Tuned,
    airframe: Path,
    line: str,
    out: Path,
    airframe_out: Path | None,
    figure: Path | None,
) -> None:
    """Whole files or none.  Errors: OSError, `ConfigError`."""
    from tgl_soar.analysis.tuning.result import airframe_with, as_toml, pareto_figure
    from tgl_soar.analysis.tuning.tune import digest

    if figure is not None:
        try:
            pareto_figure(figure, tuned, task.floor, task.airframe.airframe.name)
        except (ImportError, ValueError) as error:
            fail(f"no figure: {error}")
        say(f"figure in {figure}")
    if airframe_out is not None:
        note = f"tuned, task {digest(task)[:TASK_DIGITS]}"
        text = airframe_with(airframe.read_text(encoding="utf-8"), tuned.parameters, note)
        with tempfile.TemporaryDirectory() as folder:  # once it is known to be one
            trial = Path(folder) / airframe_out.name
            trial.write_text(text, encoding="utf-8")
            load_airframe(trial)
        write_state(airframe_out, text.encode(), None)
        say(f"airframe file in {airframe_out}: compare it with {airframe} before you fly with it")
    write_state(out, as_toml(task, tuned, airframe.name, line).encode(), None)
    say(f"gains in {out}")


def _write_origin(task: Task, tuned: Tuned, progress: ProgressFile, out: Path) -> None:
    """The manifest, and every flight as campaigns keep them.  Errors: OSError, of the manifest."""
    from tgl_soar.analysis.tuning.tune import concluded
    from tgl_soar.sim.campaign.manifest import write_manifest

    path = out.with_name(out.name + MANIFEST_SUFFIX)
    write_manifest(path, concluded(task, progress))
    say(f"where they come from in {path}")
    rows = out.with_name(out.name + ROWS_SUFFIX)
    try:
        rows.unlink(missing_ok=True)  # of other gains
        _write_rows(task, tuned, rows)
    except OSError as error:
        hint(f"no table of the flights: {rows} cannot be written: {error.strerror or error}")


def _write_rows(task: Task, tuned: Tuned, path: Path) -> None:
    """Where any were flown.  Errors: OSError."""
    from tgl_soar.analysis.tuning.flights import DrawnFlight
    from tgl_soar.analysis.tuning.tune import TuningFlight, manifest
    from tgl_soar.sim.campaign.manifest import table_metadata
    from tgl_soar.sim.campaign.rows import MISSING, available, write_rows

    if not tuned.flights:
        return
    if not available():
        hint(f"no table of the flights: {MISSING}")
        return
    write_rows(path, TuningFlight, DrawnFlight, tuned.flights, table_metadata(manifest(task)))
    say(f"a row for each flight in {path}: tgl-soar campaign report {path}")


def _print(tuned: Tuned) -> None:
    table = Table(
        *("gains", "", "α", "e_rho rms", "elevator rms", "other aircraft: least α"),
        *("below floor", "unstable"),
        box=None,
    )
    for kind in tuned.after:
        for word, given, judged in (
            ("before", tuned.before[kind], tuned.judged_before[kind]),
            ("after", tuned.after[kind], tuned.judged[kind]),
        ):
            table.add_row(
                kind,
                word,
                f"{given.alpha:.2f}",
                f"{100.0 * given.e_rho_m:.2f} cm",
                f"{given.elevator:.3f}",
                f"{judged.least_alpha:.2f}",
                f"{judged.below_floor} of {judged.aircraft}",
                f"{judged.unstable}",
            )
    console.print(table)
    for row in tuned.flown:
        say(
            f"{row.kind} at {100.0 * row.turbulence:g} %: up {row.after.up} of {row.after.of},"
            f" before {row.before.up}; e_rho {100.0 * row.after.rms_e_rho_m:.2f} cm,"
            f" before {100.0 * row.before.rms_e_rho_m:.2f} cm"
        )
