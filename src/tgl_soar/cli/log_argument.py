"""The LOG of a command that takes one: a file, or a folder for the newest log in it; and the site
and airframe files that it holds."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

from tgl_soar.cli.console import fail, hint
from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import ConfigError, airframe_from, load_airframe
from tgl_soar.config.site import Site
from tgl_soar.onboard.flightlog.files import kept_in

if TYPE_CHECKING:
    from tgl_soar.analysis.logs.flight_data import FlightData

METAVAR: Final = "LOG"
OR_FOLDER: Final = "; a folder: the newest log in it."
HELP: Final = f"ULog (ours, PX4's), DataFlash .bin or .tlog{OR_FOLDER}"


def one_log(paths: list[Path], why: str = "") -> Path:
    """The only log that is named; ends the command where several are.

    why: what asks for one alone, such as an option.
    """
    if len(paths) > 1:
        newest = max(paths, key=_written)
        fail(f"one log at a time{why}: {len(paths)} are named; the newest is {newest}")
    return log_in(paths[0])


def log_in(path: Path) -> Path:
    """A log, or of a folder the newest; ends the command where it has none."""
    if not path.is_dir():
        return path
    newest = newest_log(path)
    if newest is None:
        fail(f"{path}: no flight log is in this folder; name a .ulg, or the folder of --log")
    hint(f"the newest log in {path} is {newest}")
    return newest


def newest_log(folder: Path) -> Path | None:
    """The ULog of the last flight, its first part; folder: that of --log, or of a day in it."""
    kept = kept_in(folder) or [k for k in kept_in(folder.parent) if k.path.parent == folder]
    logs = [each for each in kept if each.path.suffix == ".ulg"]
    return next((log.path for log in logs if log.flight == logs[-1].flight), None)


def airframe_of(flight: FlightData, named: Path | None, log: Path) -> tuple[Airframe, str, str]:
    """The airframe that is named or, without, the log's own; its text, and what errors call it.

    Errors: `ConfigError`; `LogError` where the log holds none and none is named.
    """
    if named is not None:
        airframe = load_airframe(named)
        return airframe, named.read_text(encoding="utf-8"), str(named)
    text = flight.files.get("airframe", "")
    if not text:
        from tgl_soar.analysis.logs.ulog_reader import LogError

        raise LogError(f"{log}: holds no airframe file: name one with --airframe")
    name = f"{log}, airframe file"
    return airframe_from(text, name), text, name


File = TypeVar("File", Site, Airframe)
Files = tuple[Callable[[Path], File], Callable[[str, str], File]]  # from a path, from a text


def of_the_log(
    flight: FlightData, kind: str, path: Path | None, files: Files[File]
) -> tuple[File | None, list[str]]:
    """The named file, or the one that the log holds, and what is wrong with that."""
    load, parse = files
    if path is not None:
        return load(path), []
    text = flight.files.get(kind, "")
    if not text:
        return None, []
    try:
        return parse(text, f"{kind} file"), []
    except ConfigError as error:
        return None, [f"the log's own {kind} file is not understood: {error}"]


def _written(path: Path) -> tuple[float, str]:
    """When a file was last written; one that cannot be asked counts as the oldest."""
    try:
        return path.stat().st_mtime, str(path)
    except OSError:
        return 0.0, str(path)
