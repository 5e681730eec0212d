"""A log in other formats: CSV, NetCDF, MCAP.  On the ground only.

Units and meanings go along where the format has a place for them.
"""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

from tgl_soar.analysis.logs.meanings import meaning_of
from tgl_soar.analysis.logs.ulog_reader import Array, FlightLog
from tgl_soar.onboard.flightlog.topics import TOPICS, Field, frame_of, unit_of

_MCAP_CHUNK: Final = 1 << 20


def _declared(topic: str, name: str) -> Field | None:
    """What we know of a column; None for a log of others."""
    known = TOPICS.get(topic)
    return next((f for f in known.fields if f.name == name), None) if known else None


def _columns(log: FlightLog) -> Iterator[tuple[str, str, Array, Field | None]]:
    for topic, columns in log.topics.items():
        for name, column in columns.items():
            yield topic, name, column, _declared(topic, name) if log.is_ours else None


def to_csv(log: FlightLog, to: Path) -> list[Path]:
    """A file for each topic, and for parameters and words, in a folder.

    Floats are written so that they read back exactly.  Errors: OSError.
    """
    to.mkdir(parents=True, exist_ok=True)
    tables: dict[str, tuple[list[str], Any]] = {}
    for topic, columns in log.topics.items():
        lists = (column.tolist() for column in columns.values())
        tables[re.sub(r"\W", "_", topic)] = (list(columns), zip(*lists, strict=True))
    first = [(0, 0.0, name, value) for name, value in log.parameters.items()]
    tables["parameters"] = (["after_tick", "time_s", "name", "value"], [*first, *log.changes])
    tables["words"] = (["time_s", "severity", "text"], log.words)
    written = []
    for name, (head, rows) in tables.items():
        path = to / f"{name}.csv"
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(head)
            writer.writerows(rows)
        written.append(path)
    return written


def to_netcdf(log: FlightLog, to: Path) -> list[Path]:
    """One NetCDF-4 file, a group for each topic.  Errors: OSError; ImportError naming the extra."""
    try:
        import h5netcdf
    except ImportError:
        raise ImportError("NetCDF needs h5netcdf: pip install 'tgl_soar[netcdf]'") from None
    to.parent.mkdir(parents=True, exist_ok=True)
    to.open("wb").close()  # HDF5 has no plain words for a place that cannot be written
    with h5netcdf.File(to, "w") as file:
        for key, value in log.info.items():
            file.attrs[key] = value if isinstance(value, int | float) else str(value)
        for key, text in log.texts.items():
            file.attrs[f"{key}_file"] = text
        group = file.create_group("parameters")
        for name, value in log.parameters.items():
            group.attrs[name] = value
        for topic, name, column, declared in _columns(log):
            group = file.groups.get(topic) or file.create_group(topic)
            if "row" not in group.dimensions:
                group.dimensions["row"] = len(column)
            data = column.astype("u1") if column.dtype == bool else column
            variable = group.create_variable(name.replace("/", "_"), ("row",), data=data)
            if declared is not None:
                variable.attrs["units"] = unit_of(declared) or "1"
                variable.attrs["long_name"] = meaning_of(declared)
                if frame := frame_of(declared):
                    variable.attrs["frame"] = frame
    return [to]


def to_mcap(log: FlightLog, to: Path) -> list[Path]:
    """One MCAP file, a JSON channel for each topic.

    What is not finite is null: JSON has no other word for it.  Errors: OSError; ImportError
    naming the extra.
    """
    try:
        from mcap.writer import Writer
    except ImportError:
        raise ImportError("MCAP needs mcap: pip install 'tgl_soar[mcap]'") from None
    to.parent.mkdir(parents=True, exist_ok=True)
    with to.open("wb") as file:
        writer: Any = Writer(file, chunk_size=_MCAP_CHUNK)
        writer.start(profile="", library="tgl_soar")
        writer.add_metadata("flight", {key: str(value) for key, value in log.info.items()})
        writer.add_metadata("parameters", {k: repr(float(v)) for k, v in log.parameters.items()})
        for key, text in log.texts.items():
            writer.add_attachment(0, 0, f"{key}.toml", "application/toml", text.encode())
        for topic, columns in log.topics.items():
            _write_topic(writer, log, topic, columns)
        schema = writer.register_schema("words", "jsonschema", b'{"type":"object"}')
        channel = writer.register_channel("/words", "json", schema)
        for words in log.words:
            data = json.dumps({"severity": words.severity, "text": words.text}).encode()
            stamp = int(words.time_s * 1e9)
            writer.add_message(channel, stamp, data, stamp)
        writer.finish()
    return [to]


def _write_topic(writer: Any, log: FlightLog, topic: str, columns: dict[str, Array]) -> None:
    properties = {}
    for name, column in columns.items():
        kind = {"b": "boolean", "f": "number"}.get(column.dtype.kind, "integer")
        properties[name] = {"type": kind}
        declared = _declared(topic, name) if log.is_ours else None
        if declared is not None:
            description = f"{meaning_of(declared)} [{unit_of(declared)}] {frame_of(declared)}"
            properties[name]["description"] = description.replace("[]", "").strip()
    text = json.dumps({"type": "object", "properties": properties}).encode()
    schema = writer.register_schema(topic, "jsonschema", text)
    channel = writer.register_channel(f"/{topic}", "json", schema)
    names = list(columns)
    lists = [column.tolist() for column in columns.values()]
    for stamp, *row in zip(columns["timestamp"].tolist(), *lists, strict=True):
        finite = (
            None if isinstance(v, float) and not (v == v and abs(v) != float("inf")) else v
            for v in row
        )
        data = json.dumps(dict(zip(names, finite, strict=True))).encode()
        writer.add_message(channel, stamp * 1000, data, stamp * 1000)


FORMATS: Final[dict[str, Callable[[FlightLog, Path], list[Path]]]] = {
    "csv": to_csv,
    "netcdf": to_netcdf,
    "mcap": to_mcap,
}
ENDINGS: Final = {"csv": "", "netcdf": ".nc", "mcap": ".mcap"}
