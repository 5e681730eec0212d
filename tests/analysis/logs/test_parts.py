"""A flight whose log was cut into parts: which files they are, and how they become one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tgl_soar.analysis.logs.flight_data import Event, FlightData, LoggedMode, Series
from tgl_soar.analysis.logs.parts import joined, later_parts


def part(
    start_s: float,
    times_s: list[float],
    modes: tuple[tuple[float, str], ...] = (),
    *,
    missing: tuple[str, ...] = (),
    lost: tuple[str, ...] = (),
) -> FlightData:
    times = np.array(times_s)
    return FlightData(
        name="flight",
        kind="made",
        position=Series(times, {"north_m": 10.0 * start_s + times}, "p"),
        modes=tuple(LoggedMode(*mode) for mode in modes),
        events=(Event(times_s[0], "message", f"from {start_s:g}"),),
        streams={"p": times},
        start_s=start_s,
        missing=missing,
        lost=lost,
    )


@pytest.mark.parametrize("count", [0, 1, 3])
def test_the_parts_that_follow_are_numbered_from_two_without_a_gap(
    tmp_path: Path, count: int
) -> None:
    first = tmp_path / "log.ulg"
    for name in ("log.ulg", *(f"log_part{n + 2}.ulg" for n in range(count)), "log_part9.ulg"):
        (tmp_path / name).touch()
    (tmp_path / "log_part2.csv").touch()
    expected = [tmp_path / f"log_part{n + 2}.ulg" for n in range(count)]
    assert later_parts(first) == expected


def test_a_later_part_is_meant_alone(tmp_path: Path) -> None:
    for name in ("log_part2.ulg", "log_part2_part2.ulg", "log_part3.ulg"):
        (tmp_path / name).touch()
    assert later_parts(tmp_path / "log_part2.ulg") == []


def test_parts_follow_each_other_on_the_time_of_the_first() -> None:
    """The second begins 5 s after the first, by the log's own clock."""
    flight = joined([part(100.0, [0.0, 1.0, 4.0]), part(105.0, [0.0, 2.0])])
    assert flight.position is not None
    assert flight.position.time_s.tolist() == [0.0, 1.0, 4.0, 5.0, 7.0]
    assert flight.position["north_m"].tolist() == [1000.0, 1001.0, 1004.0, 1050.0, 1052.0]
    assert flight.position.source == "p"
    assert flight.streams["p"].tolist() == [0.0, 1.0, 4.0, 5.0, 7.0]
    assert [(event.time_s, event.text) for event in flight.events] == [
        (0.0, "from 100"),
        (5.0, "from 105"),
    ]
    assert flight.name == "flight and 1 more"
    assert flight.start_s == 100.0


def test_after_a_clock_that_was_reset_a_part_begins_where_the_one_before_ended() -> None:
    flight = joined([part(100.0, [0.0, 4.0]), part(3.0, [0.0, 2.0]), part(6.0, [0.0, 1.0])])
    assert flight.position is not None
    assert flight.position.time_s.tolist() == [0.0, 4.0, 4.0, 6.0, 6.0, 7.0]
    assert flight.name == "flight and 2 more"


def test_a_mode_that_goes_on_is_reported_once() -> None:
    one = part(0.0, [0.0, 9.0], ((0.0, "ready"), (2.0, "soaring")))
    other = part(10.0, [0.0, 9.0], ((0.0, "soaring"), (3.0, "released")))
    assert joined([one, other]).modes == (
        LoggedMode(0.0, "ready"),
        LoggedMode(2.0, "soaring"),
        LoggedMode(13.0, "released"),
    )


def test_missing_is_what_every_part_lacks_and_lost_what_any_has_lost() -> None:
    one = part(0.0, [0.0], missing=("a", "b"), lost=("x", "y"))
    other = part(1.0, [0.0], missing=("b", "c"), lost=("y", "z"))
    flight = joined([one, other])
    assert flight.missing == ("b",)
    assert flight.lost == ("x", "y", "z")


def test_a_series_that_only_a_later_part_has_is_there() -> None:
    later = part(10.0, [0.0, 1.0])
    bare = FlightData(name="flight", kind="made", start_s=0.0, streams={"q": np.array([0.5])})
    flight = joined([bare, later])
    assert flight.position is not None
    assert flight.position.time_s.tolist() == [10.0, 11.0]
    assert {name: times.tolist() for name, times in flight.streams.items()} == {
        "p": [10.0, 11.0],
        "q": [0.5],
    }


def test_one_part_is_the_flight_itself() -> None:
    alone = joined([part(7.0, [0.0, 1.0])])
    assert alone.name == "flight"
    assert alone.position is not None
    assert alone.position.time_s.tolist() == [0.0, 1.0]
