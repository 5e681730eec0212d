"""Parameter files of ground stations, read and written.

    QGroundControl  .params  a row per parameter: system, component, name, value, type; by tabs
    MAVProxy        .parm    a row per parameter: name, value; by spaces, Mission Planner's commas

`#` begins a comment.  A type of 9 is REAL32, which all of ours are.  What is written reads back
as exactly the same 32-bit floats.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Final, Literal, NamedTuple

from tgl_soar.config.airframe import COMPONENT_ID
from tgl_soar.config.parameters import (
    INDEX,
    PARAMETERS,
    ParameterError,
    as_wire_value,
    checked_value,
)

Format = Literal["qgroundcontrol", "mavproxy"]

REAL32: Final = 9
BAD_LINES_REPORTED: Final = 20
LARGEST_BYTES: Final = 1_000_000  # a file of a hundred parameters has five thousand
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_ID: Final = re.compile(r"\d{1,3}", re.ASCII)


class ParameterFileError(ValueError):
    """A file that cannot be used; the message names file, lines and what is wrong."""


class ReadFile(NamedTuple):
    """What a file says."""

    values: dict[str, float]  # by name, checked one by one
    notes: tuple[str, ...]  # what was passed over, and why


def format_of(path: Path) -> Format:
    """The format that a file's name tells: .parm and .param are MAVProxy's."""
    return "mavproxy" if path.suffix.lower() in (".parm", ".param") else "qgroundcontrol"


def shortest(value: float) -> str:
    """A short decimal that reads back as the same 32-bit float, of up to 1e6 either way."""
    for digits in (6, 7, 8):
        text = f"{value:.{digits}g}"
        if as_wire_value(float(text)) == value:
            return text
    return f"{value:.9g}"  # always enough


def written(
    values: Iterable[tuple[str, float]],
    form: Format,
    *,
    system: int = 1,
    component: int = COMPONENT_ID,
) -> str:
    """The text of a file.  Values are 32-bit floats."""
    if form == "mavproxy":
        return "".join(f"{name:<16s} {shortest(value)}\n" for name, value in values)
    rows = [f"{system}\t{component}\t{name}\t{shortest(value)}\t{REAL32}" for name, value in values]
    return "\n".join(
        [
            f"# Onboard parameters for Vehicle {system}",
            "#",
            "# Vehicle-Id Component-Id Name Value Type",
            *rows,
            "",
        ]
    )


def read_file(path: str | Path, *, component: int = COMPONENT_ID) -> ReadFile:
    """Read a file of either format.  Errors: `ParameterFileError`."""
    try:
        with Path(path).open("rb") as file:
            data = file.read(LARGEST_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ParameterFileError(f"{path}: cannot be read: {reason}") from None
    if len(data) > LARGEST_BYTES:
        raise ParameterFileError(f"{path}: too long for a parameter file")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise ParameterFileError(f"{path}: not text: is it a parameter file?") from None
    return read_text(text, str(path), component=component)


def read_text(
    text: str, source: str, *, component: int = COMPONENT_ID, strict: bool = True
) -> ReadFile:
    """Read a file's text; each row tells its own format.

    Rows of other components, names that are not ours and those that no file may set are passed
    over and reported; so are bad lines if not `strict`.  Errors: `ParameterFileError` naming every
    bad line.
    """
    values: dict[str, float] = {}
    notes: list[str] = []
    bad: list[str] = []
    others: dict[int, int] = {}
    for number, line in enumerate(text.split("\n"), 1):
        row = line.split("#", 1)[0].strip()
        if not row:
            continue
        where = f"{source}:{number}"
        try:
            its_component, name, value = _parsed(row)
            if its_component is not None and its_component != component:
                others[its_component] = others.get(its_component, 0) + 1
                continue
            if name not in INDEX:
                notes.append(f"{where}: {name[:40]}: no such parameter here: passed over")
                continue
            if not PARAMETERS[INDEX[name]].in_files:
                notes.append(f"{where}: {name}: never set from a file: passed over")
                continue
            checked = checked_value(name, value)
            if name in values and values[name] != checked:
                notes.append(f"{where}: {name}: given before: the last one counts")
            values[name] = checked
        except (ParameterError, _BadRow) as error:
            bad.append(f"{where}: {error}")
    if not strict:
        notes += [f"{line}: passed over" for line in bad]
    elif bad:
        more = len(bad) - BAD_LINES_REPORTED
        reported = bad[:BAD_LINES_REPORTED] + ([f"and {more} lines more"] if more > 0 else [])
        raise ParameterFileError("\n".join(reported))
    for other, rows in sorted(others.items()):
        notes.append(f"{source}: {rows} rows of component {other}: passed over")
    return ReadFile(values, tuple(notes))


class _BadRow(ValueError):
    """A row that is neither format's."""


def _parsed(row: str) -> tuple[int | None, str, float]:
    """Component (None: the row does not tell), name and value.  Errors: `_BadRow`."""
    fields = row.replace(",", " ").split()
    if len(fields) == 2:
        return None, fields[0], _number(fields[1], fields[0])
    if len(fields) != 5:
        raise _BadRow(f"{row[:40]!r}: neither `NAME VALUE` nor `SYSTEM COMPONENT NAME VALUE TYPE`")
    system, component, name, value, kind = fields
    for word in (system, component, kind):
        if not _ID.fullmatch(word):
            raise _BadRow(f"{word[:40]!r}: system, component and type are whole numbers")
    return int(component), name, _number(value, name)


def _number(word: str, name: str) -> float:
    if not _NUMBER.fullmatch(word):
        raise _BadRow(f"{name[:40]} = {word[:40]}: not a number")
    return float(word)
