"""`tgl-soar params`: the reference of parameters, and the values that a flight would begin with."""

from __future__ import annotations

import os
from collections.abc import Mapping
from enum import StrEnum
from math import isclose
from pathlib import Path
from typing import Annotated, NamedTuple

import typer
from rich.table import Table

from tgl_soar.cli.console import AIRFRAME_FILE, SITE_FILE, Commands, console, errors, fail
from tgl_soar.cli.params_page import page
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import ConfigError, gains_words, load_flight, preset_lines
from tgl_soar.config.lateral_gains import airframe_parameters
from tgl_soar.config.line_changes import LINE, Presets, with_changes
from tgl_soar.config.parameter_files import (
    Format,
    ParameterFileError,
    format_of,
    read_file,
    shortest,
    written,
)
from tgl_soar.config.parameter_groups import GROUPS, group_of
from tgl_soar.config.parameter_store import (
    Identity,
    ParameterStore,
    has_own_anchors,
    old_state_file,
    state_file,
    state_folder,
)
from tgl_soar.config.parameters import ANCHORS, PARAMETERS, ParameterError, ParameterSet
from tgl_soar.config.site import Site
from tgl_soar.control.found_gains import SHIPPED
from tgl_soar.control.line_bounds import LineBounds
from tgl_soar.onboard.setup import bounds_from

params_app = Commands()

AirframeOption = Annotated[Path, typer.Option("--airframe", help="Airframe file.", **AIRFRAME_FILE)]
SiteOption = Annotated[Path, typer.Option("--site", help="Site file.", **SITE_FILE)]
StateOption = Annotated[
    Path | None,
    typer.Option("--state", help="Folder of the stored parameters, as for `tgl-soar run`."),
]


class FileFormat(StrEnum):
    """Which ground station's format to write."""

    auto = "auto"
    qgroundcontrol = "qgroundcontrol"
    mavproxy = "mavproxy"


@params_app.callback(invoke_without_command=True)
def params(
    context: typer.Context,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the page docs/parameters.md.")
    ] = False,
) -> None:
    """List every parameter; show, compare, export or import values."""
    if context.invoked_subcommand is not None:
        return
    if markdown:
        print(page(), end="")
        return
    for group in GROUPS:
        table = Table("name", "unit", "from", "to", "default", "in flight", "meaning", box=None)
        for p in PARAMETERS:
            if group_of(p.name) is group:
                table.add_row(
                    p.name,
                    p.unit,
                    f"{p.minimum:g}",
                    f"{p.maximum:g}",
                    f"{p.default:g}",
                    "yes" if p.in_flight else "no",
                    p.meaning,
                )
        console.print(f"\n[bold]{group.title}[/bold]: {group.sentence}")
        console.print(table)


# --- what a flight would begin with -----------------------------------------------------------


class Beginning(NamedTuple):
    """What a flight with these files would begin with, and where each value is from."""

    airframe: Airframe
    site: Site
    defaults: ParameterSet
    files: ParameterSet  # with the airframe's and the site's values
    values: ParameterSet  # with the stored ones too
    kept: Mapping[str, float]
    presets: Presets
    bounds: LineBounds
    store: ParameterStore
    notes: tuple[str, ...]

    def origin(self, name: str) -> str:
        """Where a value comes from.  sought: for this airframe (`control.pitch_design`); shipped:
        a gain of the shipped aircraft, where nobody has given or sought one for this."""
        if name in self.kept:
            return "stored"
        if name in self.site.parameters:
            return "site"
        of_airframe = airframe_parameters(self.airframe)
        if self.files[name] != self.defaults.changed(of_airframe)[name]:
            if name not in (*SHIPPED, *ANCHORS):
                return "site"
            return "sought" if has_own_anchors(self.files) else "shipped"
        return "airframe" if name in of_airframe else "default"


def beginning(airframe_path: Path, site_path: Path, state: Path | None) -> Beginning:
    """Errors: `ConfigError`."""
    airframe, site, files = load_flight(airframe_path, site_path)
    presets = preset_lines(site, files)
    folder = state or state_folder(os.environ)
    if folder is None:
        raise ConfigError("no folder for stored parameters is known: name one with --state")
    link = airframe.autopilot
    identity = Identity(airframe.airframe.name, site.site.name, link.system_id, link.component_id)
    path = state_file(folder, airframe_path, site_path, identity)
    old = old_state_file(folder, airframe_path, site_path)
    store = ParameterStore(path, identity, files, presets, old)
    found = store.restore(looking=True)
    contour = site.contour_words(airframe.airframe.name)
    if contour:
        contour += ", as its option --into does"
    words = gains_words(airframe, site, files), contour
    return Beginning(
        airframe=airframe,
        site=site,
        defaults=ParameterSet(),
        files=files,
        values=found.values,
        kept=found.kept,
        presets=presets,
        bounds=bounds_from(airframe, site),
        store=store,
        notes=(*found.notes, *filter(None, words)),
    )


def _begin(airframe: Path, site: Path, state: Path | None) -> Beginning:
    try:
        found = beginning(airframe, site, state)
    except ConfigError as error:
        fail(error)
    _tell(found.notes)
    return found


def _tell(notes: tuple[str, ...]) -> None:
    for note in notes:
        errors.print(note, style="yellow", highlight=False, markup=False, soft_wrap=True)


def _done(text: str) -> None:
    errors.print(text, highlight=False, markup=False, soft_wrap=True)


@params_app.command("show")
def show(airframe: AirframeOption, site: SiteOption, state: StateOption = None) -> None:
    """List the values that a flight would begin with, and where each comes from.

    Exit code 2: a file cannot be used, or no aircraft can be held by one of the lines.
    """
    found = _begin(airframe, site, state)
    table = Table("name", "value", "unit", "from", box=None)
    for p, value in found.values:
        origin = found.origin(p.name)
        style = {"default": "dim", "stored": "bold"}.get(origin, "")
        table.add_row(p.name, shortest(value), p.unit, origin, style=style)
    console.print(table)
    for i, preset in enumerate(found.presets, 1):
        console.print(
            f"TGL_PRESET = {i}: line {preset.name}, x {preset.x_m:g} m, z {preset.z_m:g} m, lean"
            f" {preset.lean_deg:g} deg",
            highlight=False,
        )
    is_there = bool(found.kept) or found.store.path.exists()
    words = "stored in" if is_there else "nothing is stored in"
    console.print(f"{words} {found.store.path}", highlight=False, soft_wrap=True)
    faults = line_faults(found, airframe, site)
    for fault in faults[:-1]:
        errors.print(f"error: {fault}", style="red", highlight=False, markup=False, soft_wrap=True)
    if faults:
        fail(faults[-1])


def line_faults(found: Beginning, airframe_path: Path, site_path: Path) -> list[str]:
    """What is wrong with the lines: no aircraft can be held by one, or the nose would not point
    upwind there.  Of each the file, the key and its value."""
    values, bounds = found.values, found.bounds
    files = {"stored": found.store.path, "airframe": airframe_path}

    def file_of(name: str) -> Path:
        return files.get(found.origin(name), site_path)

    faults = []
    lines = [(f"line {p.name}", p.x_m) for p in found.presets]
    for preset in found.presets:
        for words in bounds.preset_faults(values, (preset,)):
            words = words.removeprefix(f"line {preset.name}: ")
            place = f"x_m = {preset.x_m:g}, z_m = {preset.z_m:g}, lean_deg = {preset.lean_deg:g}"
            faults.append(f"{site_path}: lines.{preset.name}: {place}: {words}")
    at = {name: values[name] for name in LINE}
    known = [p.parameters() for p in found.presets]
    is_known = any(all(isclose(at[n], line[n], abs_tol=1e-5) for n in LINE) for line in known)
    given = any(found.origin(name) != "default" for name in ("TGL_X", "TGL_Z"))
    if given and not is_known:
        lines.append(("the line of TGL_X", at["TGL_X"]))
        if words := bounds.fault(values):
            place = ", ".join(f"{name} = {value:g}" for name, value in at.items())
            faults.append(f"{file_of('TGL_X')}: parameters.{place}: {words}")
    if lines:
        name, x_m = min(lines, key=lambda line: line[1])
        most_m = x_m - values["WPT_R_MIN"]
        if values["WPT_X"] > most_m + 1e-4:  # parameters are floats of 32 bits
            faults.append(
                f"{file_of('WPT_X')}: parameters.WPT_X = {values['WPT_X']:g}: the virtual waypoint"
                f" must be upwind of {name} by WPT_R_MIN: at most {most_m:g}"
            )
    return faults


@params_app.command("diff")
def diff(
    first: Annotated[
        str, typer.Argument(help="default, files, state, or a .params or .parm file.")
    ] = "files",
    second: Annotated[
        str, typer.Argument(help="What to compare with: the same choices.")
    ] = "state",
    *,
    airframe: AirframeOption,
    site: SiteOption,
    state: StateOption = None,
) -> None:
    """List the values that differ; exit code 1 if any do.

    default: as declared. files: with the airframe's and the site's values. state: with the stored
    values too, as a flight would begin. FILE: the values that the file contains.
    """
    found = _begin(airframe, site, state)
    one, other = (_values_of(word, found) for word in (first, second))
    table = Table("name", first, second, "unit", box=None)
    for p in PARAMETERS:
        a, b = one.get(p.name), other.get(p.name)
        if p.in_files and a is not None and b is not None and a != b:
            table.add_row(p.name, shortest(a), shortest(b), p.unit)
    if table.row_count:
        console.print(table)
        raise typer.Exit(1)
    _done("no differences")


def _values_of(word: str, found: Beginning) -> dict[str, float]:
    sets = {"default": found.defaults, "files": found.files, "state": found.values}
    if word in sets:
        return {p.name: value for p, value in sets[word]}
    try:
        read = read_file(word, component=found.airframe.autopilot.component_id)
    except ParameterFileError as error:
        fail(error)
    _tell(read.notes)
    return read.values


@params_app.command("export")
def export(
    file: Annotated[Path, typer.Argument(help="File to write; - for standard output.")],
    form: Annotated[
        FileFormat, typer.Option("--format", help="auto: .parm and .param are MAVProxy's.")
    ] = FileFormat.auto,
    *,
    airframe: AirframeOption,
    site: SiteOption,
    state: StateOption = None,
) -> None:
    """Write the values that a flight would begin with, for a ground station to load."""
    found = _begin(airframe, site, state)
    chosen: Format = format_of(file)
    if form is not FileFormat.auto:
        chosen = "mavproxy" if form is FileFormat.mavproxy else "qgroundcontrol"
    link = found.airframe.autopilot
    text = written(
        [(p.name, value) for p, value in found.values if p.in_files],
        chosen,
        system=link.system_id,
        component=link.component_id,
    )
    if str(file) == "-":
        print(text, end="")
        return
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        fail(f"{file}: cannot be written: {error.strerror}")
    _done(f"{file}: written for {chosen}")


@params_app.command("import")
def import_(
    file: Annotated[Path, typer.Argument(help="A .params or .parm file.")],
    airframe: AirframeOption,
    site: SiteOption,
    state: StateOption = None,
    force: Annotated[
        bool, typer.Option("--force", help="Also store a line on which no aircraft can be held.")
    ] = False,
) -> None:
    """Store the values of a ground station's file: the next flight begins with them.

    Parameters that the file does not name keep their values. Either all values are taken or none.
    Do not import while the module runs: it would store its own values over these.
    """
    found = _begin(airframe, site, state)
    try:
        read = read_file(file, component=found.airframe.autopilot.component_id)
        values = with_changes(found.values, read.values, found.presets)
    except ParameterFileError as error:
        fail(error)
    except ParameterError as error:
        fail(f"{file}: {error}")
    if not read.values:
        _tell(read.notes)
        fail(f"{file}: no parameter of this module in it; `tgl-soar params` lists them all")
    fault = found.bounds.fault(values)
    if fault and not force and not found.bounds.fault(found.values):
        fail(f"{file}: {fault}; change it, or take it all the same with --force")
    _tell((*read.notes, *((fault,) if fault else ())))
    wanted = read.values.get("TGL_PRESET", values["TGL_PRESET"])
    if values["TGL_PRESET"] != wanted:
        _tell((f"{file}: TGL_PRESET = {wanted:g}: the line is elsewhere: TGL_PRESET is 0",))
    try:
        found.store.save(values)
    except OSError as error:
        fail(f"{found.store.path}: cannot be written: {error.strerror}")
    changed = sum(a != b for (_, a), (_, b) in zip(found.values, values, strict=True))
    _done(f"{len(read.values)} values read, {changed} changed; stored in {found.store.path}")


@params_app.command("reset")
def reset(airframe: AirframeOption, site: SiteOption, state: StateOption = None) -> None:
    """Delete the stored values: the next flight starts with those of the files."""
    found = _begin(airframe, site, state)
    try:
        gone = found.store.forget()
    except OSError as error:
        fail(f"{found.store.path}: cannot be removed: {error.strerror}")
    _done(f"{found.store.path}: {'removed, with its previous copy' if gone else 'there is none'}")
