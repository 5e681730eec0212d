"""`tgl-soar replay`: a logged flight through the same laws again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.table import Table

from tgl_soar.analysis.logs.ulog_reader import LogError
from tgl_soar.analysis.replay.logged import SHOWN, Replay, ReplayError
from tgl_soar.analysis.replay.logged import replay as replay_log
from tgl_soar.analysis.replay.many import ReplayedLog, ReplayJob, replay_campaign, replay_many
from tgl_soar.analysis.replay.wire import WireReplay, replay_wire, rms
from tgl_soar.cli.batch_options import (
    ALL,
    NO_TABLE,
    Restart,
    Resume,
    Scheduler,
    changes_of,
    executor_of,
    flight_bar,
    fly_folder,
    to_resume,
    warn_of_no_table,
)
from tgl_soar.cli.console import (
    AIRFRAME,
    AIRFRAME_FILE,
    SITE,
    SITE_FILE,
    console,
    errors,
    fail,
    say,
)
from tgl_soar.cli.log import read
from tgl_soar.cli.log_argument import log_in, one_log
from tgl_soar.config.files import ConfigError
from tgl_soar.config.parameters import ParameterError
from tgl_soar.onboard.flightlog.topics import TOPICS, unit_of
from tgl_soar.sim.campaign.cluster import ClusterError
from tgl_soar.sim.campaign.executors import Executor, WorkerLost
from tgl_soar.sim.campaign.flight_list import Campaign
from tgl_soar.sim.campaign.folder import JOURNAL, ROWS, CampaignFolder
from tgl_soar.sim.campaign.journal import JournalError

_MOST = 12  # fields in a table of differences
_REPORTED_IN = {  # units of what telemetry tells
    **dict.fromkeys(("e_rho", "soar_x", "soar_z", "line_x", "line_z"), "m"),
    **dict.fromkeys(("pitch_sp", "line_lean"), "°"),
}


def replay(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="LOG...",
            help="One .ulg of the module, or a .tlog; or several .ulg. A folder: the newest .ulg.",
        ),
    ],
    param: Annotated[
        list[str] | None,
        typer.Option(
            "--param", metavar="NAME=VALUE", help="Replay with another value; repeatable."
        ),
    ] = None,
    airframe: Annotated[
        Path | None,
        typer.Option(help="Replay with the parameters of another airframe file.", **AIRFRAME_FILE),
    ] = None,
    site: Annotated[
        Path | None,
        typer.Option(help="Site file; only for a .tlog, which contains none.", **SITE_FILE),
    ] = None,
    figure: Annotated[
        Path | None, typer.Option(help="Draw logged and replayed commands (.png, .svg).")
    ] = None,
    workers: Annotated[
        int, typer.Option(help="Processes at most; 0: as many as processors.", min=0, max=256)
    ] = 0,
    compile: Annotated[
        bool,
        typer.Option(
            "--compile",
            help="Compile the laws first (numba): some minutes, once for each version. From then"
            " on long logs are flown with them by themselves.",
        ),
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for a table with a row for each log, and a manifest with their digests."
        ),
    ] = None,
    scheduler: Scheduler = None,
    resume: Resume = False,
    restart: Restart = False,
) -> None:
    """Run a log's inputs through the laws again; exit code 1 if commands differ or data is lost.

    A .ulg is compared bit for bit. With --param or --airframe the replay shows which commands would
    have been given; the aircraft does not respond to them. A .tlog, of this module or of a ground
    station, is replayed through the whole module, as far as its frames suffice. Several .ulg give a
    table with a line for each log; --out keeps it, with the logs' digests.
    """
    changes = tuple(changes_of(param or []).items())
    paths = [log_in(path) for path in paths]
    for option, kept in (("--resume", resume), ("--restart", restart)):
        if kept and out is None:
            fail(f"{option} goes with --out")
    if len(paths) == 1 and out is None:
        if scheduler is not None:
            fail("--scheduler goes with several logs, or with --out")
        _replay_one(paths[0], changes, airframe, site, figure, workers, compile)
        return
    for option, given in (("--site", site), ("--figure", figure), ("--compile", compile)):
        if given and out is None:
            one_log(paths, f" with {option}")
        if given:
            fail(f"{option} goes with one log, and without --out")
    executor = executor_of(workers or ALL, scheduler)
    if out is None:
        found = _replayed([ReplayJob(path, changes, airframe) for path in paths], executor)
    else:
        campaign = replay_campaign(paths, changes, airframe)
        found = _kept(campaign, executor, to_resume(out, resume), resume, restart)
    _show_all(found, bool(changes) or airframe is not None)


def _replay_one(
    path: Path,
    changes: tuple[tuple[str, float], ...],
    airframe: Path | None,
    site: Path | None,
    figure: Path | None,
    workers: int,
    compile: bool,
) -> None:
    try:
        if path.suffix == ".tlog":
            _from_wire(path, airframe or AIRFRAME, site or SITE, dict(changes))
            return
        if site is not None:
            fail("--site is only for a .tlog: a .ulg contains its own site file")
        log = read(path)
        result = replay_log(
            log,
            changes=dict(changes),
            airframe=airframe,
            workers=workers or None,
            compile=compile or None,
        )
    except (LogError, ReplayError, ConfigError, ParameterError, ImportError) as error:
        fail(error)
    _say(result.notes)
    console.print(
        f"{len(result.time_s)} ticks in {result.took_s:.2f} s, {result.speed:.0f} × real time"
        + (f"; {result.left_out} left out, the state before them is lost" * bool(result.left_out))
    )
    if result.changed:
        _compare(result)
        if not result.differences:
            console.print("no command differs: no tick of this flight used the changed values")
    elif result.differences:
        _list_differences(result)
    else:
        console.print("every command is the same, bit for bit", style="green")
    if figure is not None:
        _draw(figure, result, path, dict(changes), airframe)
    if log.losses or (result.differences and not result.changed):
        raise typer.Exit(1)


def _replayed(jobs: list[ReplayJob], executor: Executor) -> list[ReplayedLog]:
    try:
        with flight_bar("logs") as bar:
            return replay_many(jobs, executor, lambda progress: bar.show(*progress))
    except (ClusterError, WorkerLost) as error:
        fail(error)


def _kept(
    campaign: Campaign[ReplayJob, ReplayedLog],
    executor: Executor,
    out: Path,
    resume: bool,
    restart: bool,
) -> list[ReplayedLog]:
    """The same, with their table and manifest in a folder."""
    try:
        with CampaignFolder(out, campaign, resume=resume, restart=restart) as folder:
            warn_of_no_table(JOURNAL)
            fly_folder(folder, executor)
            found = list(folder)
            tabulated = folder.finish()
    except (JournalError, ClusterError, WorkerLost) as error:
        fail(error)
    say(f"logs in {out / ROWS if tabulated else f'{out / JOURNAL}, {NO_TABLE}'}")
    return found


def _show_all(found: list[ReplayedLog], changed: bool) -> None:
    """A line for each; exit code 1 as for one."""
    table = Table("log", "ticks", "left out", "lost", "differs")
    for log in found:
        differs = ", ".join(log.differing[:3]) + (" …" if len(log.differing) > 3 else "")
        counts = (str(log.ticks), str(log.left_out), str(log.losses))
        table.add_row(log.log, *counts, log.error or differs or "nothing")
    console.print(table)
    console.print(f"{len(found)} logs, {sum(log.duration_s for log in found):.0f} s of flight")
    if any(log.error or log.losses or (log.differing and not changed) for log in found):
        raise typer.Exit(1)


def _say(notes: list[str]) -> None:
    for note in notes:
        errors.print(note, style="yellow", highlight=False, markup=False, soft_wrap=True)


def _unit(name: str) -> str:
    return next((unit_of(field) for field in TOPICS["tick"].fields if field.name == name), "")


def _list_differences(result: Replay) -> None:
    table = Table("field", "ticks that differ", "largest", "at")
    for d in result.differences[:_MOST]:
        size = f"{d.largest:.3g} {_unit(d.name)}".rstrip()
        table.add_row(d.name, str(d.ticks), size, f"{d.time_s:.3f} s")
    console.print(table)
    if len(result.differences) > _MOST:
        console.print(f"and {len(result.differences) - _MOST} more fields")


def _compare(result: Replay) -> None:
    """What was commanded beside what would have been."""
    worst = {d.name: d for d in result.differences}
    table = Table("rms of", "logged", "replayed", "difference", "largest", "at")
    for name in SHOWN:
        if name not in result.logged:
            continue
        a, b = (x[name].astype(np.float64) for x in (result.logged, result.replayed))
        flown = np.isfinite(a) & np.isfinite(b)
        if name.startswith("command_"):
            flown &= result.logged["active"]
        if not flown.any():
            table.add_row(name, *("–" for _ in range(5)))
            continue
        sizes = (float(np.sqrt(np.mean(x[flown] ** 2))) for x in (a, b, a - b))
        d = worst.get(name)
        largest = ("0", "–") if d is None else (f"{d.largest:.4g}", f"{d.time_s:.3f} s")
        table.add_row(f"{name} [{_unit(name)}]", *(f"{x:.4g}" for x in sizes), *largest)
    console.print(table)
    console.print("the inputs are the logged ones: the aircraft does not answer to the change")


def _draw(
    figure: Path, result: Replay, path: Path, changes: dict[str, float], airframe: Path | None
) -> None:
    from tgl_soar.analysis.report.replay_figure import replay_figure

    how = [f"{name} = {value:g}" for name, value in changes.items()]
    how += [str(airframe.name)] if airframe is not None else []
    title = f"{path.name}, replayed" + (f" with {', '.join(how)}" if how else "")
    try:
        replay_figure(figure, result.time_s, result.logged, result.replayed, title)
    except (ImportError, OSError, ValueError) as error:
        fail(f"no figure: {error}")


def _from_wire(path: Path, airframe: Path, site: Path, changes: dict[str, float]) -> None:
    result: WireReplay = replay_wire(path, airframe, site, changes)
    _say(result.notes)
    if not result.outputs:
        fail(f"{path}: no tick could be run: it has no attitude of the airframe's autopilot")
    ticks, speed = len(result.outputs), result.seconds / max(result.took_s, 1e-9)
    console.print(f"{ticks} ticks in {result.took_s:.2f} s, {speed:.1f} × the recording's time")
    table = Table("sent as telemetry", "unit", "times", "rms of then less now", "largest")
    for name, received in result.compared.items():
        sizes = [abs(h.reported - h.replayed) for h in received]
        known = [size for size in sizes if size == size]
        largest = f"{max(known):.3g}" if known else "–"
        table.add_row(
            name,
            _REPORTED_IN.get(name, ""),
            str(len(received)),
            f"{rms(received):.3g}" if known else "–",
            largest,
        )
    console.print(table)
    if result.missed or result.losses:
        raise typer.Exit(1)
