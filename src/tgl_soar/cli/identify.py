"""`tgl-soar identify`: what a log of gliding flight tells of an airframe file's numbers."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Sequence
from math import isfinite, radians
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import typer
from msgspec.structs import asdict
from rich.progress import Progress, SpinnerColumn, TextColumn
from rich.table import Table

from tgl_soar.analysis.drag import drag_of
from tgl_soar.analysis.identification import (
    IdentificationError,
    Identified,
    KnownAircraft,
    body_from,
    identify,
)
from tgl_soar.analysis.logs.reader import LogError
from tgl_soar.cli.console import AIRFRAME, AIRFRAME_FILE, console, errors, fail, say
from tgl_soar.config.airframe import OF_THE_BRAKE
from tgl_soar.config.files import ConfigError, load_airframe
from tgl_soar.estimation.polar import GlideStretch, fit_polar, fit_polar_family

# What an identification writes into [model] of an airframe file, and from what.
KEYS: Final = {
    "CL0": "CL0",  # with Cm0: an angle of attack that is measured askew is in both
    "CL_alpha": "CL_alpha",
    "CL_elevator": "CL_elevator",
    "Cm0": "Cm0",
    "Cm_alpha": "Cm_alpha",
    "Cm_q": "Cm_q",
    "Cm_elevator": "Cm_elevator",
    "servo_delay_s": "delay",
}
BRAKE_KEYS: Final = {"CL_brake": "CL_brake", "Cm_brake": "Cm_brake"}
WORDS: Final = {
    "frequency": "short period, undamped",
    "damping": "short period, damping",
    "effectiveness": "pitch acceleration of full elevator",
    "response": "servo: delay and lag together",
    "delay": "servo: delay alone",
}
EXPLAINED_MIN: Final = 0.8  # of those held out; below, the model is not to be trusted


class Written(NamedTuple):
    """A number of [model], and half of its band of 95 %."""

    value: float
    half_band: float


class Gliding(NamedTuple):
    """What the steady glides tell beside the manoeuvres."""

    written: dict[str, Written]
    polar: str  # the keys of [polar], a line each; "": none
    words: str


WindOption = Annotated[
    float, typer.Option("--wind", help="Horizontal wind in the flight \\[m/s].", min=0.0, max=50.0)
]
WindFromOption = Annotated[
    float, typer.Option(help="Where it came from, degrees from north.", min=-360.0, max=360.0)
]


def identify_command(
    log: Annotated[Path, typer.Argument(help="ULog (ours, PX4's), DataFlash .bin or .tlog.")],
    airframe: Annotated[
        Path,
        typer.Option(help="Airframe file: mass, size, inertia, servo, surfaces.", **AIRFRAME_FILE),
    ] = AIRFRAME,
    wind: WindOption = 0.0,
    wind_from: WindFromOption = 0.0,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Write the airframe file with what was identified."),
    ] = None,
    figure: Annotated[Path | None, typer.Option(help="Figure to write, PNG or SVG.")] = None,
) -> None:
    """Fit the short period, the elevator's effect and the servo's delay to doublets in a glide.

    Hold the elevator, move it to one side and the other, hold it again; wings level, in
    still air; four times or more. What a brake does is identified too where it is moved, or
    glided with; drag and polar, where the log holds steady glides at six speeds.
    Exit code 1: identified, but not reliable.
    """
    from tgl_soar.analysis.logs.flight_data import steered
    from tgl_soar.analysis.logs.gliding import MeanWind, glides, longitudinal
    from tgl_soar.analysis.logs.reading import read_flight

    if out is not None and out.resolve() == airframe.resolve():
        fail(f"--out {out}: that is the file that it is compared with; give another name")
    try:
        plane = load_airframe(airframe)
        body = body_from(asdict(plane.airframe), plane.model)
    except (ConfigError, IdentificationError) as error:
        fail(error if isinstance(error, ConfigError) else f"{airframe}: {error}")
    try:
        flight = steered(read_flight(log), plane.surfaces)
        for text in flight.lost:
            errors.print(f"lost: {text}", style="yellow", highlight=False, markup=False)
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
    _print(found, gliding, plane.model)
    if out is not None:
        _write(out, airframe, found, gliding)
    if figure is not None:
        _draw(figure, found, log.name)
    if not found.explained >= EXPLAINED_MIN:
        fail(
            f"of the manoeuvres held out the model explains {found.explained:.0%}:"
            " fly more doublets, larger ones, or in calmer air",
            1,
        )


def glided(stretches: Sequence[GlideStretch], body: KnownAircraft) -> Gliding:
    """Drag and polar of steady glides.  Errors: ValueError saying what they lack."""
    speeds = [each.speed_mps for each in stretches]
    sinks, brakes = [each.sink_mps for each in stretches], [each.brake for each in stretches]
    drag = drag_of(stretches, body)
    braked = any(each.name == "CD_brake" for each in drag)
    fitted = fit_polar_family(speeds, sinks, brakes).fit if braked else fit_polar(speeds, sinks)
    polar = fitted.polar
    lines = "\n".join(f"{key} = {value:.8g}" for key, value in polar._asdict().items())
    return Gliding(
        {each.name: Written(each.value, each.half_band) for each in drag},
        lines,
        f"polar of {len(stretches)} glides, {polar.speed_min_mps:.2f} to"
        f" {polar.speed_max_mps:.2f} m/s, residual {fitted.residual_rms_mps:.3f} m/s",
    )


def with_identified(airframe: Path, found: Identified, gliding: Gliding) -> str:
    """The text of an airframe file with the identified values, each with its band beside it.

    Errors: `ConfigError` for a key that its [model] lacks, or a file without [polar].
    """
    text = airframe.read_text(encoding="utf-8")
    head, table, rest = text.partition("\n[model]")
    body, bracket, tail = rest.partition("\n[")
    for key, each in {**_of_manoeuvres(found), **gliding.written}.items():
        line = f"{key} = {each.value:.5g}  # identified: ± {each.half_band:.2g} at 95 %"
        body, count = re.subn(rf"(?m)^{key}\s*=.*$", line, body)
        if count == 0 and key in OF_THE_BRAKE:  # a file need not have them
            body, count = f"{body.rstrip()}\n{line}\n", 1
        if count != 1:
            raise ConfigError(f"{airframe}: model.{key}: missing, so it cannot be replaced")
    text = head + table + body + bracket + tail
    if gliding.polar:
        text, count = re.subn(r"(?m)^\[polar\]\n(?:[^\[]*)", f"[polar]\n{gliding.polar}\n\n", text)
        if count != 1:
            raise ConfigError(f"{airframe}: [polar]: missing, so it cannot be replaced")
    return text.rstrip() + "\n"


def _of_manoeuvres(found: Identified) -> dict[str, Written]:
    keys = KEYS if found.no_brake else {**KEYS, **BRAKE_KEYS}
    return {
        key: Written(found[name].value, 0.5 * (found[name].high - found[name].low))
        for key, name in keys.items()
    }


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
        console.print(f"the model explains {found.explained:.1%} of what was held out")


def _write(out: Path, airframe: Path, found: Identified, gliding: Gliding) -> None:
    """The new airframe file, once it is known to be one."""
    try:
        text = with_identified(airframe, found, gliding)
        with tempfile.TemporaryDirectory() as folder:
            trial = Path(folder) / out.name
            trial.write_text(text, encoding="utf-8")
            load_airframe(trial)
        out.write_text(text, encoding="utf-8")
    except ConfigError as error:
        fail(error)
    except OSError as error:
        fail(f"--out {out}: cannot be written: {error.strerror}")
    say(f"airframe file in {out}: compare it with {airframe} before you fly with it")


def _draw(path: Path, found: Identified, title: str) -> None:
    from tgl_soar.analysis.report.identification_figure import identification_figure

    try:
        identification_figure(path, found, title)
    except (ImportError, ValueError) as error:
        fail(f"no figure: {error}")
    except OSError as error:
        fail(f"no figure: {path}: {error.strerror}")
    say(f"figure in {path}")
