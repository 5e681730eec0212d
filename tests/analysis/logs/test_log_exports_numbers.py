"""A made-up log in other formats: each table, unit and stamp, and what is not finite."""

from __future__ import annotations

import csv
import json
from io import BytesIO
from math import inf, nan, pi
from pathlib import Path
from typing import Any

import h5netcdf
import numpy as np
import pytest
from mcap.reader import make_reader

from tgl_soar.analysis.logs.export import ENDINGS, FORMATS, to_csv, to_mcap, to_netcdf
from tgl_soar.analysis.logs.ulog_reader import FlightLog, ParameterChange, Words

STAMPS_US = np.array([1_000_000, 1_005_000, 1_010_000], np.uint64)
SITE = '[site]\nname = "ä"\n'


def log(ours: bool = True) -> FlightLog:
    tick: dict[str, Any] = {
        "timestamp": STAMPS_US,
        "tick": np.array([7, 8, 9], np.uint32),
        "vehicle_x_m": np.array([pi, nan, -inf]),
        "active": np.array([True, False, True]),
    }
    other: dict[str, Any] = {"timestamp": STAMPS_US[:1], "a/b": np.array([0.5], np.float32)}
    return FlightLog(
        path=Path("my.ulg"),
        topics={"tick": tick, "other#1": other},
        parameters={"GAIN": 0.1, "WAY": -2.0},
        changes=[ParameterChange(8, 1.005, "GAIN", 0.2)],
        words=[Words(1.25, 4, "höher, bitte")],
        info={"sys_name": "tgl_soar" if ours else "PX4", "ver_data": 3},
        texts={"site": SITE},
    )


def rows(path: Path) -> list[list[str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))


def test_every_format_has_an_ending() -> None:
    assert {"csv": to_csv, "netcdf": to_netcdf, "mcap": to_mcap} == FORMATS
    assert ENDINGS == {"csv": "", "netcdf": ".nc", "mcap": ".mcap"}


def test_csv_has_a_file_for_each_table(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "csv"
    names = ("tick", "other_1", "parameters", "words")
    assert to_csv(log(), folder) == [folder / f"{name}.csv" for name in names]
    assert rows(folder / "tick.csv") == [
        ["timestamp", "tick", "vehicle_x_m", "active"],
        ["1000000", "7", repr(pi), "True"],
        ["1005000", "8", "nan", "False"],
        ["1010000", "9", "-inf", "True"],
    ]
    assert rows(folder / "other_1.csv") == [["timestamp", "a/b"], ["1000000", "0.5"]]
    assert rows(folder / "parameters.csv") == [
        ["after_tick", "time_s", "name", "value"],
        ["0", "0.0", "GAIN", "0.1"],
        ["0", "0.0", "WAY", "-2.0"],
        ["8", "1.005", "GAIN", "0.2"],
    ]
    assert rows(folder / "words.csv") == [
        ["time_s", "severity", "text"],
        ["1.25", "4", "höher, bitte"],
    ]
    assert len(to_csv(log(), folder)) == 4  # the folder may be there


def test_netcdf_has_a_group_for_each_topic_with_units_of_ours(tmp_path: Path) -> None:
    path = tmp_path / "new" / "flight.nc"
    assert to_netcdf(log(), path) == [path]
    with h5netcdf.File(path) as file:
        assert set(file.groups) == {"tick", "other#1", "parameters"}
        assert file.attrs["sys_name"] == "tgl_soar"
        assert file.attrs["ver_data"] == 3  # a number stays one
        assert file.attrs["site_file"] == SITE
        assert dict(file.groups["parameters"].attrs) == {"GAIN": 0.1, "WAY": -2.0}
        tick = file.groups["tick"]
        assert tick.dimensions["row"].size == 3
        assert tick["tick"][:].tolist() == [7, 8, 9]
        assert tick["vehicle_x_m"][:].tolist() == pytest.approx([pi, nan, -inf], nan_ok=True)
        assert tick["active"].dtype == np.uint8
        assert tick["active"][:].tolist() == [1, 0, 1]
        place = {"units": "m", "long_name": "downstream", "frame": "soaring"}
        assert dict(tick["vehicle_x_m"].attrs) == place
        assert tick["tick"].attrs["units"] == "1"
        assert "frame" not in tick["tick"].attrs
        assert file.groups["other#1"]["a_b"][:].tolist() == [0.5]
        assert not dict(file.groups["other#1"]["a_b"].attrs)
    assert len(to_netcdf(log(), path)) == 1  # it is replaced


def test_netcdf_says_nothing_of_columns_of_others(tmp_path: Path) -> None:
    (path,) = to_netcdf(log(ours=False), tmp_path / "flight.nc")
    with h5netcdf.File(path) as file:
        assert not dict(file.groups["tick"]["vehicle_x_m"].attrs)


def read(path: Path) -> tuple[dict[str, dict[str, Any]], list[Any], Any]:
    """Of an MCAP file: schemas by topic; (topic, log time, publish time, content); reader."""
    schemas, messages = {}, []
    reader = make_reader(BytesIO(path.read_bytes()))
    for schema, channel, message in reader.iter_messages():
        assert schema is not None
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        assert f"/{schema.name}" == channel.topic
        schemas[channel.topic] = json.loads(schema.data)
        messages.append(
            (channel.topic, message.log_time, message.publish_time, json.loads(message.data))
        )
    return schemas, messages, reader


def test_mcap_stamps_are_nanoseconds_and_what_is_not_finite_is_null(tmp_path: Path) -> None:
    path = tmp_path / "new" / "flight.mcap"
    assert to_mcap(log(), path) == [path]
    _, messages, _ = read(path)
    first, second, third = (1_000_000_000 + 5_000_000 * k for k in range(3))
    entry, quarter = {"severity": 4, "text": "höher, bitte"}, 1_250_000_000

    def row(k: int, x: float | None, active: bool) -> dict[str, Any]:
        stamp = 1_000_000 + 5000 * k
        return {"timestamp": stamp, "tick": 7 + k, "vehicle_x_m": x, "active": active}

    expected = [
        ("/other#1", first, first, {"timestamp": 1_000_000, "a/b": 0.5}),
        ("/tick", first, first, row(0, pi, True)),
        ("/tick", second, second, row(1, None, False)),
        ("/tick", third, third, row(2, None, True)),
        ("/words", quarter, quarter, entry),
    ]
    assert sorted(messages, key=lambda each: (each[1], each[0])) == expected


def test_mcap_columns_have_types_and_ours_have_meanings(tmp_path: Path) -> None:
    (path,) = to_mcap(log(), tmp_path / "flight.mcap")
    schemas, _, _ = read(path)
    tick = schemas["/tick"]["properties"]
    kinds = {name: column["type"] for name, column in tick.items()}
    assert kinds == {
        "timestamp": "integer",
        "tick": "integer",
        "vehicle_x_m": "number",
        "active": "boolean",
    }
    assert tick["vehicle_x_m"]["description"] == "downstream [m] soaring"
    assert not tick["tick"]["description"].endswith((" ", "]"))  # it has neither unit nor frame
    assert schemas["/other#1"]["properties"]["a/b"] == {"type": "number"}
    (path,) = to_mcap(log(ours=False), tmp_path / "flight.mcap")
    assert read(path)[0]["/tick"]["properties"]["vehicle_x_m"] == {"type": "number"}


def test_mcap_holds_the_files_the_parameters_and_what_flew(tmp_path: Path) -> None:
    (path,) = to_mcap(log(), tmp_path / "flight.mcap")
    _, _, reader = read(path)
    metadata = {each.name: dict(each.metadata) for each in reader.iter_metadata()}
    assert metadata == {
        "flight": {"sys_name": "tgl_soar", "ver_data": "3"},
        "parameters": {"GAIN": "0.1", "WAY": "-2.0"},
    }
    (attachment,) = reader.iter_attachments()
    assert (attachment.name, attachment.media_type) == ("site.toml", "application/toml")
    assert attachment.data.decode() == SITE
    assert (attachment.log_time, attachment.create_time) == (0, 0)
    assert reader.get_header().library.startswith("tgl_soar")
    assert reader.get_summary().statistics.chunk_count == 1
