"""`tgl-soar identify`: what a log of gliding flight tells of an airframe file's numbers."""

from __future__ import annotations

import tempfile
from math import isfinite, radians
from pathlib import Path
from typing import Annotated, Final

import typer
from msgspec.structs import asdict
from rich.progress import Progress, SpinnerColumn, TextColumn
from rich.table import Table

from tgl_soar.analysis.identification import (
    IdentificationError,
    Identified,
    body_from,
    identify,
)
from tgl_soar.analysis.identified_file import (
    BRAKE_KEYS,
    KEYS,
    Gliding,
    glided,
    with_identified,
)
from tgl_soar.analysis.logs.ulog_reader import LogError
from tgl_soar.cli.console import AIRFRAME_FILE, console, errors, fail, say
from tgl_soar.cli.log_argument import HELP, METAVAR, airframe_of, one_log
from tgl_soar.config.files import ConfigError, load_airframe

WORDS: Final = {
    "frequency": "short period, undamped",
    "damping": "short period, damping",
    "effectiveness": "pitch acceleration of full elevator",
    "response": "servo: delay and lag together",
    "delay": "servo: delay alone",
}
EXPLAINED_MIN: Final = 0.8  # of those held out; below, the model is not to be trusted


WindOption = Annotated[
    float, typer.Option("--wind", help="Horizontal wind in the flight \\[m/s].", min=0.0, max=50.0)
]
WindFromOption = Annotated[
    float, typer.Option(help="Where it came from, degrees from north.", min=-360.0, max=360.0)
]


def identify_command(
    logs: Annotated[list[Path], typer.Argument(metavar=METAVAR, help=HELP)],
    airframe: Annotated[
        Path | None,
        typer.Option(
            help="Airframe file: mass, size, inertia, servo, surfaces. Default: that of the"
            " module's log; other logs need it.",
            **AIRFRAME_FILE,
        ),
    ] = None,
    wind: WindOption = 0.0,
    wind_from: WindFromOption = 0.0,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Write the airframe file with what was identified."),
    ] = None,
    figure: Annotated[Path | None, typer.Option(help="Figure to write, PNG or SVG.")] = None,
) -> None:
    """Fit the short period, the elevator's effect and the servo's delay to doublets in a glide.

    Fly in still air, wings level: hold the elevator, move it to one side and the other, and hold
    it again, four times or more. The effect of a brake is identified too if the log has movements
    of it, or glides with it; drag and polar, if the log has steady glides at six speeds.
    Exit code 1: identified, but not reliable.
    """
    from tgl_soar.analysis.logs.flight_data import steered
    from tgl_soar.analysis.logs.gliding import MeanWind, glides, longitudinal
    from tgl_soar.analysis.logs.open_log import read_flight

    if out is not None and airframe is not None and out.resolve() == airframe.resolve():
        fail(f"--out {out}: that is the file that it is compared with; give another name")
    log = one_log(logs)
    try:
        flight = read_flight(log)
        for text in flight.lost:
            errors.print(f"lost: {text}", style="yellow", highlight=False, markup=False)
        plane, before, called = airframe_of(flight, airframe, log)
    except (LogError, ConfigError, ImportError) as error:
        fail(error)
    try:
        body = body_from(asdict(plane.airframe), plane.model)
    except IdentificationError as error:
        fail(f"{called}: {error}")
    try:
        flight = steered(flight, plane.surfaces)
        air = MeanWind(wind, radians(wind_from))
        columns = longitudinal(flight, air)
        with Progress(
            SpinnerColumn(), TextColumn("{task.description}"), console=errors, transient=True
        ) as progress:
            progress.add_task("fitting the manoeuvres")
            found = identify(columns, body)
    except (LogError, ImportError) as error:
        fail(error)
    except ValueError as error:
        fail(f"{log}: {error}")
    try:
        gliding = glided(glides(flight, air), body)
    except ValueError as error:
        gliding = Gliding({}, "", f"drag and polar are not identified: {error}")
    say(f"airframe: {plane.airframe.name}, of {called}")
    _print(found, gliding, plane.model)
    if out is not None:
        _write(out, before, called, found, gliding)
    if figure is not None:
        _draw(figure, found, log.name)
    if not found.explained >= EXPLAINED_MIN:
        fail(
            f"the model explains only {found.explained:.0%} of the manoeuvres held out:"
            " fly more doublets, larger ones, or in calmer air",
            1,
        )


def _print(found: Identified, gliding: Gliding, model: dict[str, float]) -> None:
    console.print(
        f"{len(found.manoeuvres)} manoeuvres fitted, {len(found.held_out)} held out;"
        f" at {found.airspeed_mps:.2f} m/s"
    )
    table = Table("", "identified", "95 % band", "airframe file", box=None)
    known = {name: model.get(key) for key, name in {**KEYS, **BRAKE_KEYS}.items()}
    for estimate in (
        *(found.frequency, found.damping, found.effectiveness, found.response_delay),
        *found.derivatives,
    ):
        before = known.get(estimate.name)
        table.add_row(
            WORDS.get(estimate.name, estimate.name),
            f"{estimate.value:.4g} {estimate.unit}".rstrip(),
            f"{estimate.low:.4g} … {estimate.high:.4g}",
            "" if before is None else f"{before:.4g}",
        )
    for name, each in gliding.written.items():
        before = model.get(name)
        table.add_row(
            name,
            f"{each.value:.4g}",
            f"{each.value - each.half_band:.4g} … {each.value + each.half_band:.4g}",
            "" if before is None else f"{before:.4g}",
        )
    console.print(table)
    console.print(gliding.words, markup=False, highlight=False)
    if found.no_brake and model.get("CL_brake"):
        console.print(f"brake: {found.no_brake}", markup=False, highlight=False)
    if isfinite(found.explained):
        console.print(f"the model explains {found.explained:.1%} of the manoeuvres held out")


def _write(out: Path, before: str, called: str, found: Identified, gliding: Gliding) -> None:
    """The new airframe file, once it is known to be one; before: the text of the old one."""
    try:
        text = with_identified(before, called, found, gliding)
        with tempfile.TemporaryDirectory() as folder:
            trial = Path(folder) / out.name
            trial.write_text(text, encoding="utf-8")
            load_airframe(trial)
        out.write_text(text, encoding="utf-8")
    except ConfigError as error:
        fail(error)
    except OSError as error:
        fail(f"--out {out}: cannot be written: {error.strerror}")
    say(f"airframe file in {out}: compare it with {called} before you fly with it")


def _draw(path: Path, found: Identified, title: str) -> None:
    from tgl_soar.analysis.report.identification_figure import identification_figure

    try:
        identification_figure(path, found, title)
    except (ImportError, ValueError) as error:
        fail(f"no figure: {error}")
    except OSError as error:
        fail(f"no figure: {path}: {error.strerror}")
    say(f"figure in {path}")
