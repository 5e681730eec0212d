"""The same log in other formats, read back by their own readers."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray
from logged_flight import recorded
from mcap.reader import make_reader

from tgl_soar.analysis.logs.export import FORMATS, to_csv, to_mcap, to_netcdf
from tgl_soar.analysis.logs.ulog_reader import FlightLog, read_log


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> FlightLog:
    return read_log(recorded(tmp_path_factory.mktemp("exported"), 1.0))


def test_csv_reads_back_exactly(log: FlightLog, tmp_path: Path) -> None:
    files = to_csv(log, tmp_path / "csv")
    assert {file.stem for file in files} >= {*log.topics, "parameters", "words"}
    with (tmp_path / "csv/tick.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    tick = log.topics["tick"]
    assert len(rows) == len(tick["tick"])
    for name in ("time_s", "command_elevator", "vehicle_x_m"):
        back = np.array([float(row[name]) for row in rows])
        assert np.array_equal(back, tick[name].astype(float), equal_nan=True)
    with (tmp_path / "csv/parameters.csv").open(newline="") as file:
        values = {row["name"]: float(row["value"]) for row in csv.DictReader(file)}
    assert values["OP_ENGAGE"] == 1.0


def test_netcdf_reads_back_exactly_with_units(log: FlightLog, tmp_path: Path) -> None:
    (file,) = to_netcdf(log, tmp_path / "flight.nc")
    with xarray.open_dataset(file, group="tick", engine="h5netcdf") as tick:
        x = tick["vehicle_x_m"]
        assert np.array_equal(x.values, log.topics["tick"]["vehicle_x_m"], equal_nan=True)
        assert x.attrs["units"] == "m"
        assert x.attrs["frame"] == "soaring"
        assert tick["command_elevator"].dtype == np.float64
    with xarray.open_dataset(file, engine="h5netcdf") as whole:
        assert whole.attrs["site_file"] == log.texts["site"]


def test_mcap_reads_back(log: FlightLog, tmp_path: Path) -> None:
    (path,) = to_mcap(log, tmp_path / "flight.mcap")
    with path.open("rb") as file:
        messages = list(make_reader(file).iter_messages(topics=["/tick"]))
    tick = log.topics["tick"]
    assert len(messages) == len(tick["tick"])
    schema, _, message = messages[-1]
    assert schema is not None
    row = json.loads(message.data)
    assert row["command_elevator"] == tick["command_elevator"][-1]
    assert row["active"] is bool(tick["active"][-1])
    properties = json.loads(schema.data)["properties"]
    assert properties["vehicle_x_m"]["description"] == "downstream [m] soaring"
    assert json.loads(messages[0][2].data)["setpoints_pitch_rad"] is None  # NaN: not flying


@pytest.mark.parametrize(("name", "package"), [("mcap", "mcap.writer"), ("netcdf", "h5netcdf")])
def test_a_missing_package_is_named(
    log: FlightLog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, package: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=rf"tgl_soar\[{name}\]"):
        FORMATS[name](log, tmp_path / "x")
