"""`tgl-soar log`: what a flight log holds."""

from __future__ import annotations

import textwrap
from cmath import phase
from math import degrees, isfinite, log10
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer
from rich.table import Table

from tgl_soar.analysis.logs.export import ENDINGS, FORMATS
from tgl_soar.analysis.logs.meanings import page
from tgl_soar.analysis.logs.ulog_reader import FlightLog, LogError, read_log
from tgl_soar.cli.console import Commands, console, errors, fail
from tgl_soar.cli.log_argument import METAVAR, OR_FOLDER, one_log

if TYPE_CHECKING:
    from tgl_soar.analysis.loop_response import LoopResponse

log_app = Commands(help="Inspect a flight log and convert it.", no_args_is_help=True)


def read(path: Path) -> FlightLog:
    """A log, with what is lost of it said; ends the command where nothing can be read."""
    if path.suffix == ".tlog":
        fail(f"{path}: a .tlog holds frames, no topics: see `tgl-soar report` or `tgl-soar replay`")
    try:
        log = read_log(path)
    except (LogError, ImportError) as error:
        fail(error)
    for loss in log.losses:
        errors.print(f"{path.name}: {loss}", style="yellow", highlight=False, markup=False)
    if not any(len(topic["timestamp"]) for topic in log.topics.values()):
        fail(f"{path}: no row of any topic is in it")
    return log


@log_app.command()
def fields() -> None:
    """Print docs/logs.md: every field with its unit and frame."""
    typer.echo(page(), nl=False)


@log_app.command()
def info(
    paths: Annotated[list[Path], typer.Argument(metavar=METAVAR, help=f"A ULog{OR_FOLDER}")],
) -> None:
    """Show what a log contains, and what of it is lost; exit code 1 if anything is lost."""
    path = one_log(paths)
    log = read(path)
    for key, value in sorted(log.info.items()):
        text = _numbered(key, str(value)) if key in _NUMBERED else f"{key}: {value}"
        console.print(text, highlight=False, markup=False, soft_wrap=True)
    size = path.stat().st_size
    console.print(f"{log.duration_s:.1f} s, {size / 1e6:.2f} MB, {len(log.changes)} changes")
    table = Table("topic", "rows", "rate")
    for name, topic in log.topics.items():
        rows = len(topic["timestamp"])
        rate = f"{rows / log.duration_s:.1f} Hz" if log.duration_s > 0.0 else "–"
        table.add_row(name, str(rows), rate)
    console.print(table)
    for words in log.words:
        console.print(f"{words.time_s:10.3f} s  {words.text}", highlight=False, markup=False)
    if log.losses:
        raise typer.Exit(1)


_NUMBERED: Final = ("modes", "reasons")


def _numbered(key: str, value: str) -> str:
    """Words between semicolons, by the numbers that the log's columns have for them."""
    words = [f"{i} {word or '–'}" for i, word in enumerate(value.split(";"))]
    lines = textwrap.wrap(
        "; ".join(words), max(40, min(console.width, 100)) - 4, break_on_hyphens=False
    )
    return "\n".join([f"{key}, by number:", *(f"    {line}" for line in lines)])


@log_app.command()
def margins(
    paths: Annotated[
        list[Path], typer.Argument(metavar=METAVAR, help=f"A ULog of the module{OR_FOLDER}")
    ],
) -> None:
    """Read the open loop from a flight's multisines (EXC_START): gain and phase at each tone, and
    margins, with their 95 % intervals; exit code 2 where there are none."""
    from tgl_soar.analysis.logs.open_log import read_flight
    from tgl_soar.analysis.loop_response import loop_responses

    path = one_log(paths)
    try:
        flight = read_flight(path)
    except (LogError, ImportError) as error:
        fail(error)
    if flight.excitation is None:
        fail(f"{path}: no multisine is in it: set EXC_START to 1 while soaring")
    responses = loop_responses(flight.excitation)
    if not responses:
        fail(f"{path}: no multisine of it lasted two whole periods (12 s): nothing can be said")
    for response in responses:
        console.print(_tones_of(response))
        for name, (value, low, high) in response.margins._asdict().items():
            words = f"{name}: {value:.2f} ({low:.2f} to {high:.2f})"
            if not isfinite(value):
                words = f"{name}: not between the first tone and the last"
            console.print(words, highlight=False, markup=False)
    for loss in flight.lost:
        errors.print(f"lost: {loss}", style="yellow", highlight=False, markup=False)
    if flight.lost:
        raise typer.Exit(1)


def _tones_of(response: LoopResponse) -> Table:
    """Gain and phase of the open loop at each tone, and the discs that hold them."""
    from tgl_soar.analysis.loop_response import TONES_RADPS, open_loop_discs

    title = f"broken at the {response.at}, {response.periods} periods of 5 s"
    table = Table("rad/s", "gain [dB]", "phase [deg]", "within", "coherence", title=title)
    loop, (_, radius) = response.open_loop, open_loop_discs(response)
    for i, radps in enumerate(TONES_RADPS.tolist()):
        gain_db, phase_deg = 20.0 * log10(abs(loop[i])), degrees(phase(loop[i]))
        within = f"{100.0 * radius[i] / abs(loop[i]):.0f} %" if isfinite(radius[i]) else "unknown"
        coherence = f"{response.coherence[i]:.2f}"
        table.add_row(f"{radps:.2f}", f"{gain_db:.1f}", f"{phase_deg:.0f}", within, coherence)
    return table


@log_app.command()
def export(
    paths: Annotated[list[Path], typer.Argument(metavar=METAVAR, help=f"A ULog{OR_FOLDER}")],
    to: Annotated[str, typer.Option("--to", help="csv, netcdf or mcap.")] = "csv",
    out: Annotated[
        Path | None, typer.Option(help="File, or folder for csv; beside the log if not given.")
    ] = None,
) -> None:
    """Write the readable part of a log in another format; exit code 1 if anything is lost."""
    if to not in FORMATS:
        fail(f"--to {to}: must be {', '.join(FORMATS)}")
    path = one_log(paths)
    log = read(path)
    target = out or path.with_name(path.stem + ENDINGS[to])
    try:
        written = FORMATS[to](log, target)
    except ImportError as error:
        fail(error)
    except OSError as error:
        fail(f"{target}: cannot be written: {error.strerror or error}")
    for file in written:
        console.print(str(file), highlight=False, markup=False, soft_wrap=True)
    if log.losses:
        raise typer.Exit(1)
