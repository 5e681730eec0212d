"""`tgl-soar init`: a folder with all that a flight begins from, from what is shipped."""

from __future__ import annotations

import json
import os
import re
import shlex
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from string import Template
from typing import Annotated, Final

import typer

from tgl_soar.cli.console import console, errors, fail
from tgl_soar.cli.log_layouts import foxglove, plotjuggler
from tgl_soar.cli.service_unit import hidden, unit
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import (
    ConfigError,
    airframe_file,
    load_airframe,
    load_site,
    shipped,
    shipped_names,
    site_file,
)
from tgl_soar.config.site import PolynomialAir
from tgl_soar.link.commands import ABORT, ENGAGE, RELEASE
from tgl_soar.link.open_link import check_link
from tgl_soar.link.transports.base import LinkError

LINK: Final = "serial:/dev/ttyAMA0:921600"
_FIRMWARES: Final = ("bridge", "ardupilot", "px4", "paparazzi")


def init(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="Created if it does not exist.")],
    start: Annotated[
        str,
        typer.Option(
            "--from",
            metavar="FILE",
            help="Site to start from: a name (tunnel, hill, …), or a file; what its \\[air] names"
            " is copied, too.",
        ),
    ] = "tunnel",
    airframe: Annotated[
        str, typer.Option(metavar="FILE", help="Airframe to start from: a name, or a file.")
    ] = "eclipson_c",
    firmware: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help=f"Firmware of the autopilot: {', '.join(_FIRMWARES)}. Default: the airframe's.",
        ),
    ] = None,
    link: Annotated[str, typer.Option(help="Link to the autopilot, as for `tgl-soar run`.")] = LINK,
    force: Annotated[bool, typer.Option("--force", help="Replace existing files.")] = False,
) -> None:
    """Write airframe, site, service, ground station's actions and log layouts into a folder.

    All files are written or none. Exit code 2: a file exists already, or a name is unknown.
    """
    for option, name, known in (
        ("--from", start, shipped_names("sites")),
        ("--airframe", airframe, shipped_names("airframes")),
        ("--firmware", firmware, _FIRMWARES),
    ):
        takes_file = option != "--firmware"
        if name is None or name in known or (takes_file and Path(name).is_file()):
            continue
        file = ", or a file" if takes_file else ""
        fail(f"{option} {name}: not known; must be one of {', '.join(known)}{file}")
    folder = Path(os.path.abspath(folder))  # noqa: PTH100 - a link is not followed
    try:
        check_link(link)
        written = place(contents(folder, start, airframe, firmware, link), folder, force=force)
    except (LinkError, ConfigError, FileExistsError) as error:
        fail(error)
    except OSError as error:
        fail(f"{folder}: cannot be written: {error.strerror}")
    for path in written:
        console.print(str(path), highlight=False, markup=False, soft_wrap=True)
    for path in hidden([folder, Path(sys.prefix), Path(sys.base_prefix)]):
        errors.print(
            f"no service can read {path}: for a service install into /opt, and make the folder"
            " in /etc",
            style="yellow",
            highlight=False,
            markup=False,
            soft_wrap=True,
        )
    console.print(
        f"what to do next: {folder / 'README.md'}", highlight=False, markup=False, soft_wrap=True
    )


def contents(
    folder: Path, start: str, airframe: str, firmware: str | None, link: str
) -> dict[str, str | bytes]:
    """The content of every file by its name.  Errors: `ConfigError`."""
    plane_file, place_file = airframe_file(airframe), site_file(start)
    plane = load_airframe(plane_file)
    text = plane_file.read_text(encoding="utf-8")
    if plane_file == shipped(f"airframes/{airframe}.toml"):
        text, firmware = _COPY + text, firmware or plane.autopilot.firmware
    program = program_of(Path(sys.executable))
    command = [
        *program, "run", "--state", "/var/lib/tgl_soar",
        "--airframe", str(folder / "airframe.toml"), "--site", str(folder / "site.toml"),
        "--link", link,
    ]  # fmt: skip
    words = {
        "program": shlex.join(program),
        "airframe": plane_file.name,
        "site": place_file.name,
        "link": shlex.quote(link),
    }
    return {
        "airframe.toml": text if firmware is None else _with_firmware(text, firmware),
        **_site(place_file, folder),
        "tgl-soar.service": unit(command, [folder, Path(sys.prefix), Path(sys.base_prefix)]),
        "qgc_actions.json": qgc_actions(plane),
        "plotjuggler.xml": plotjuggler(),
        "foxglove.json": foxglove(),
        "README.md": Template(_template("README.md")).substitute(words),
    }


_COPY: Final = """\
# A copy. For another aircraft every figure of [airframe], [model] and [polar] is another one, its
# name too, and the gains (RHO_…, ELE_…) are to be deleted: they are sought for it then. README.md
# beside this file and `tgl-soar docs files` tell how.

"""


def _template(name: str) -> str:
    return shipped(f"templates/{name}").read_text(encoding="utf-8")


def _with_firmware(text: str, firmware: str) -> str:
    line = f'firmware = "{firmware}"'
    if firmware == "bridge":
        line += "         # the simulated one; give the aircraft's own here"
    changed, count = re.subn(r'(?m)^firmware = "\w+".*$', line, text)
    if count != 1:
        raise ConfigError("airframe: no line firmware = … in [autopilot] to replace")
    return changed


def _site(path: Path, folder: Path) -> dict[str, str | bytes]:
    """The site file, and the files that its [air] names; none of a site that is there already.

    With what only a real place needs, where the file does not say where positions are from.
    Errors: `ConfigError`.
    """
    site = load_site(path)
    if path.resolve() == (folder / "site.toml").resolve():
        return {}
    text = path.read_text(encoding="utf-8")
    has_position = re.search(r"(?m)^\[(mocap|position)\]", text)
    files: dict[str, str | bytes] = {}
    air: object = site.air.of if isinstance(site.air, PolynomialAir) else site.air
    for key in ("file", "record"):
        name = getattr(air, key, None)
        if name is not None and not Path(name).is_absolute():
            files[name] = _beside(path, key, name)
    return {"site.toml": text if has_position else text + _template("place.toml"), **files}


def _beside(site: Path, key: str, name: str) -> bytes:
    """A file that [air] of a site file names.  Errors: `ConfigError`."""
    if ".." in Path(name).parts or name.endswith(".foam"):
        what = "a case of many files" if name.endswith(".foam") else "outside of the site's folder"
        raise ConfigError(f'{site}: air.{key} = "{name}": {what}, and not copied: name an .npz')
    try:
        return (site.parent / name).read_bytes()
    except OSError as error:
        raise ConfigError(f'{site}: air.{key} = "{name}": {error.strerror}') from None


def program_of(python: Path) -> list[str]:
    """How this installation is called, in full; its links are not followed, or a virtual
    environment would be left."""
    script = python.with_name("tgl-soar")
    return [str(script)] if script.is_file() else [str(python), "-m", "tgl_soar.cli"]


def qgc_actions(airframe: Airframe) -> str:
    """QGroundControl's file of MAVLink actions; it refuses a file with any other key."""
    reported = (
        ("TGL engage", "Take the surfaces and soar on the target line.", ENGAGE),
        ("TGL release", "Hand the surfaces back to the autopilot.", RELEASE),
        ("TGL abort", "Hand the surfaces back; nobody engages before a release.", ABORT),
    )
    component = airframe.autopilot.component_id
    actions = [
        {"label": label, "description": words, "mavCmd": command, "compId": component}
        for label, words, command in reported
    ]
    return (
        json.dumps({"version": 1, "fileType": "MavlinkActions", "actions": actions}, indent=2)
        + "\n"
    )


def place(files: Mapping[str, str | bytes], folder: Path, *, force: bool) -> list[Path]:
    """Write all or none; the paths.

    All are complete beside their places before the first is moved there.
    Errors: FileExistsError naming what is there, where it is not to be replaced; OSError.
    """
    for above in (folder, *folder.parents):
        if above.exists() and not above.is_dir():
            raise FileExistsError(f"{above}: is a file: name a folder")
    taken = [name for name in files if (folder / name).exists()]
    if taken and not force:
        raise FileExistsError(f"{folder}: has {', '.join(taken)} already: --force replaces them")
    new = not folder.exists()
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(
        dir=folder.parent if new else folder, prefix=".init-"
    ) as stage:
        made = Path(stage) / "files"
        made.mkdir()
        made.chmod(0o755)  # whatever the umask: the service's user reads here
        for name, content in files.items():
            data = content.encode() if isinstance(content, str) else content
            (made / name).parent.mkdir(parents=True, exist_ok=True)
            (made / name).write_bytes(data)
            (made / name).chmod(0o644)
        if new:
            made.rename(folder)
        else:
            for name in files:
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (made / name).replace(folder / name)
    return [folder / name for name in files]
