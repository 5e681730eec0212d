"""A campaign's flights as a table in Parquet, for pandas, polars, duckdb or R as it is.

A row is a flight: its number, what it came to, and of its job whatever the result does not say
itself.  Tuples within tuples are columns with both names (`score_rms_m`), several of one kind a
list of structures; arrays stay out.  Rows stand in the order of the flights, in groups of a fixed
size, so that a campaign has one file, whoever flew it.

Parquet is written by pyarrow (the extra `parquet`); why is docs/decisions/parquet.md.  Without it
the same rows can be written as CSV.
"""

from __future__ import annotations

import csv
import json
import types
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from importlib.util import find_spec
from itertools import islice
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, Union, get_args, get_origin
from typing import get_type_hints as hints_of

import msgspec

GROUP: Final = 8192  # rows
MISSING: Final = "Parquet needs pyarrow: pip install 'tgl_soar[parquet]'"
FLIGHT: Final = "flight"

Read = Callable[[Any], Any]


class Column(NamedTuple):
    """One column."""

    name: str
    kind: Any  # float, int, bool, str; or a list or dictionary of them, by `_Shape`
    read: Read  # from the result or the job


class _Shape(NamedTuple):
    """What a nested column holds."""

    of: Any  # a plain type, or columns
    many: bool


def available() -> bool:
    """Whether Parquet can be written and read."""
    return find_spec("pyarrow") is not None


def columns_of(kind: Any) -> list[Column]:
    """The columns of a type of results or jobs; what is no column stays out."""
    return list(_columns("", kind, lambda value: value))


def write_rows(
    path: Path,
    job: Any,
    result: Any,
    flights: Iterable[tuple[Any, Any]],
    metadata: Mapping[str, str],
) -> None:
    """Write flights, (job, result) each, in order; the file is there whole or not at all.

    job, result: their types.  Errors: ImportError without pyarrow; OSError.
    """
    import pyarrow
    import pyarrow.parquet

    own, given = _of_both(job, result)
    schema = pyarrow.schema(
        [(FLIGHT, pyarrow.int64()), *((c.name, _arrow(c.kind)) for c in (*own, *given))],
        metadata=dict(metadata),
    )
    new = path.with_name(path.name + ".new")
    numbered = enumerate(flights)
    try:
        with pyarrow.parquet.ParquetWriter(new, schema, compression="zstd") as writer:
            while chunk := list(islice(numbered, GROUP)):
                cells: dict[str, list[Any]] = {FLIGHT: [number for number, _ in chunk]}
                cells |= {c.name: [c.read(flight[1]) for _, flight in chunk] for c in own}
                cells |= {c.name: [c.read(flight[0]) for _, flight in chunk] for c in given}
                writer.write_table(pyarrow.table(cells, schema))
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)  # what a full disk has cut off


def write_csv(path: Path, job: Any, result: Any, flights: Iterable[tuple[Any, Any]]) -> None:
    """The same rows as text, which needs nothing; the file is there whole or not at all.

    As of `write_rows`; a column of several values holds them as JSON, None is an empty cell, and a
    number that is not known is nan.  Errors: OSError.
    """
    own, given = _of_both(job, result)
    new = path.with_name(path.name + ".new")
    try:
        with new.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file)
            writer.writerow([FLIGHT, *(column.name for column in (*own, *given))])
            for number, (asked, flown) in enumerate(flights):
                cells = [*((c, flown) for c in own), *((c, asked) for c in given)]
                writer.writerow([number, *(_text(c.read(of)) for c, of in cells)])
        new.replace(path)
    finally:
        new.unlink(missing_ok=True)


def _of_both(job: Any, result: Any) -> tuple[list[Column], list[Column]]:
    """The columns of the result, and of the job those that the result has not."""
    own = columns_of(result)
    names = {column.name for column in own}
    return own, [column for column in columns_of(job) if column.name not in names]


def _text(value: Any) -> Any:
    return json.dumps(value, ensure_ascii=False) if isinstance(value, list) else value


def read_columns(path: Path) -> dict[str, str]:
    """The columns of a file and what they hold, in Arrow's words.

    Errors: ImportError without pyarrow; OSError; ValueError for what is no such file.
    """
    import pyarrow.parquet

    return {column.name: str(column.type) for column in pyarrow.parquet.read_schema(path)}


def read_rows(path: Path, names: Sequence[str] | None = None) -> Iterator[dict[str, Any]]:
    """The rows of a file, one group in memory at a time; names: of the columns wanted.

    Errors: ImportError without pyarrow; OSError; ValueError for what is no such file.
    """
    import pyarrow.parquet

    with pyarrow.parquet.ParquetFile(path) as file:
        for batch in file.iter_batches(GROUP, columns=None if names is None else list(names)):
            yield from batch.to_pylist()


# --- from types to columns ------------------------------------------------------------------------

_PLAIN: Final = (bool, int, float, str)


def _columns(prefix: str, kind: Any, read: Read) -> Iterator[Column]:
    for name, hint in _members(kind).items():
        get = _getter(name, read)
        inner = _without_none(hint)
        if _members(inner):
            yield from _columns(f"{prefix}{name}_", inner, get)
            continue
        shape = _shape(inner)
        if shape is not None:
            yield Column(prefix + name, shape, _shaped(shape, get))


def _getter(name: str, read: Read) -> Read:
    def get(value: Any) -> Any:
        whole = read(value)
        return None if whole is None else getattr(whole, name)

    return get


@cache
def _members(kind: Any) -> dict[str, Any]:
    """The fields of a tuple, a data class or a structure, with their types; {}: none of these."""
    if not isinstance(kind, type):
        return {}
    if issubclass(kind, tuple) and hasattr(kind, "_fields"):
        names: Sequence[str] = kind._fields
    elif is_dataclass(kind):
        names = [each.name for each in fields(kind)]
    elif issubclass(kind, msgspec.Struct):
        names = kind.__struct_fields__
    else:
        return {}
    hints = hints_of(kind)
    return {name: hints[name] for name in names}


def _without_none(hint: Any) -> Any:
    if get_origin(hint) in (Union, types.UnionType):
        kinds = [kind for kind in get_args(hint) if kind is not type(None)]
        return kinds[0] if len(kinds) == 1 else hint
    return hint


def _shape(hint: Any) -> Any:
    """A plain type, a `_Shape`, or None: no column."""
    if hint in _PLAIN:
        return hint
    if get_origin(hint) is Literal:
        return type(get_args(hint)[0])
    if get_origin(hint) in (tuple, list):
        kinds = {_without_none(kind) for kind in get_args(hint) if kind is not Ellipsis}
        inner = kinds.pop() if len(kinds) == 1 else None
        if inner in _PLAIN:
            return _Shape(inner, many=True)
        columns = columns_of(inner)
        return _Shape(tuple(columns), many=True) if columns else None
    return None


def _shaped(shape: Any, read: Read) -> Read:
    if not isinstance(shape, _Shape):
        return read
    if shape.of in _PLAIN:
        return lambda value: None if (found := read(value)) is None else list(found)

    def rows(value: Any) -> Any:
        found = read(value)
        if found is None:
            return None
        return [{column.name: column.read(each) for column in shape.of} for each in found]

    return rows


def _arrow(kind: Any) -> Any:
    import pyarrow

    if isinstance(kind, _Shape):
        if isinstance(kind.of, tuple):
            return pyarrow.list_(pyarrow.struct([(c.name, _arrow(c.kind)) for c in kind.of]))
        return pyarrow.list_(_arrow(kind.of))
    return {
        bool: pyarrow.bool_(),
        int: pyarrow.int64(),
        float: pyarrow.float64(),
        str: pyarrow.string(),
    }[kind]
