"""A campaign's table: one row a flight, columns by type, and others read it."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from math import inf, nan
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from tgl_soar.sim.campaign.rows import FLIGHT, GROUP, columns_of, read_rows, write_csv, write_rows


class Place(NamedTuple):
    """Somewhere."""

    x_m: float
    z_m: float | None


@dataclass(frozen=True)
class Wide:
    """A result of every kind of field."""

    seed: int
    ended: str
    up: bool
    kind: Literal["a", "b"]
    place: Place | None
    legs: tuple[Place, ...]
    pair: tuple[float, float]
    path: dict[str, NDArray[np.float64]]  # no column


class Asked(NamedTuple):
    """A job."""

    seed: int
    gust: float


def test_columns_are_those_of_the_type() -> None:
    assert [(c.name, c.kind) for c in columns_of(Asked)] == [("seed", int), ("gust", float)]
    names = [c.name for c in columns_of(Wide)]
    assert names == ["seed", "ended", "up", "kind", "place_x_m", "place_z_m", "legs", "pair"]
    assert columns_of(int) == []


def flown(number: int) -> tuple[Asked, Wide]:
    somewhere = Place(0.1 * number, None if number % 2 else nan)
    return Asked(seed=99, gust=inf), Wide(
        seed=number,
        ended="" if number else "hit the board",
        up=bool(number),
        kind="a",
        place=None if number == 1 else somewhere,
        legs=(somewhere,) * number,
        pair=(1.0, 2.0),
        path={},
    )


@pytest.fixture
def table(tmp_path: Path) -> Path:
    pytest.importorskip("pyarrow")
    write_rows(path := tmp_path / "rows.parquet", Asked, Wide, map(flown, range(3)), {"who": "me"})
    return path


def test_a_row_is_a_flight(table: Path) -> None:
    first, second, third = read_rows(table)
    assert first == {
        FLIGHT: 0, "seed": 0, "ended": "hit the board", "up": False, "kind": "a",
        "place_x_m": 0.0, "place_z_m": pytest.approx(nan, nan_ok=True), "legs": [],
        "pair": [1.0, 2.0], "gust": inf,
    }  # fmt: skip
    assert (second["place_x_m"], second["place_z_m"]) == (None, None)
    assert [leg["x_m"] for leg in third["legs"]] == [0.2, 0.2]
    assert list(read_rows(table, ["seed"])) == [{"seed": n} for n in range(3)]


def test_pandas_reads_it(table: Path) -> None:
    frame = pytest.importorskip("pandas").read_parquet(table)
    assert frame["seed"].tolist() == [0, 1, 2]
    assert frame["up"].dtype == bool


def test_duckdb_reads_it(table: Path) -> None:
    asked = f"select up, count(*) from '{table}' group by up order by up"
    assert pytest.importorskip("duckdb").sql(asked).fetchall() == [(False, 1), (True, 2)]


def test_polars_reads_it(table: Path) -> None:
    frame = pytest.importorskip("polars").read_parquet(table)
    assert frame["seed"].to_list() == [0, 1, 2]


def test_many_rows_are_written_in_groups(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    count = GROUP + 5
    flights = ((Asked(n, 0.5 * n), Place(float(n), None)) for n in range(count))
    write_rows(path := tmp_path / "rows.parquet", Asked, Place, flights, {})
    assert parquet.ParquetFile(path).num_row_groups == 2
    assert [row["gust"] for row in read_rows(path)] == [0.5 * n for n in range(count)]


def test_the_same_rows_are_written_as_text(tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    write_csv(path, Asked, Wide, map(flown, range(3)))
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    names = [FLIGHT, *(column.name for column in columns_of(Wide)), "gust"]
    assert list(rows[0]) == names  # the seed is the result's
    assert [row["flight"] for row in rows] == [row["seed"] for row in rows] == ["0", "1", "2"]
    assert [row["up"] for row in rows] == ["False", "True", "True"]
    assert [row["place_x_m"] for row in rows] == ["0.0", "", "0.2"]  # exact: repr of a float
    assert [row["place_z_m"] for row in rows] == ["nan", "", "nan"]
    assert rows[1]["legs"] == '[{"x_m": 0.1, "z_m": null}]'
    assert rows[1]["gust"] == "inf"
    assert [each.name for each in tmp_path.iterdir()] == ["rows.csv"]
