"""Records with numbers that fit no field: what stands in the log in their place."""

from __future__ import annotations

import struct
from math import inf
from pathlib import Path
from typing import Any

import pytest
from test_writer import OUTPUT, STATE, Log

from tgl_soar.onboard.flightlog.recorder import LinkReport
from tgl_soar.onboard.flightlog.topics import TOPICS

REPORT = LinkReport(
    loss=0.25,
    round_trip_s=0.5,
    frames=3,
    bad_checksums=4,
    unsent=5,
    late=6,
    skipped=7,
    over_run=8,
    worst_late_s=0.125,
)


@pytest.fixture
def log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Log:
    return Log(tmp_path, monkeypatch).begins()


def values(log: Log, topic: str) -> list[dict[str, Any]]:
    """Rows by the names of their fields."""
    names = [field.name for field in TOPICS[topic].fields]
    rows = [struct.unpack(TOPICS[topic].layout, row) for row in log.rows(topic)]
    return [dict(zip(names, row, strict=True)) for row in rows]


def test_a_report_of_the_link_has_the_last_tick_s_time_and_number_and_its_own_numbers(
    log: Log,
) -> None:
    log.tick(2)
    log.recorder.link(REPORT)
    (row,) = values(log, "link")
    timestamp, tick, *rest = row.values()
    assert timestamp == pytest.approx(1_010_000, abs=1)
    assert tick == 2
    assert tuple(rest) == REPORT


def test_a_count_that_fits_no_field_is_the_largest_and_costs_no_other(log: Log) -> None:
    log.recorder.link(REPORT._replace(frames=2**70, late=2**31))
    log.recorder.link(REPORT)
    beyond, within = values(log, "link")
    assert beyond["frames"] == 2**31 - 1
    assert beyond["unsent"] == within["unsent"] == 5
    assert within["frames"] == 3
    assert log.recorder.dropped == 0


def test_a_number_beyond_single_precision_is_infinite_in_its_row(log: Log) -> None:
    log.recorder.link(REPORT._replace(worst_late_s=1e300, loss=-1e300))
    (row,) = values(log, "link")
    assert (row["worst_late_s"], row["loss"]) == (inf, -inf)
    assert row["round_trip_s"] == 0.5


def test_what_is_no_number_at_all_costs_its_row_and_is_counted(log: Log) -> None:
    broken: Any = "words"
    log.recorder.link(REPORT._replace(frames=broken))
    log.recorder.link(REPORT)
    assert len(values(log, "link")) == 1
    assert log.recorder.dropped == 1


def test_a_tick_beyond_its_fields_is_written_with_all_of_its_inputs(log: Log) -> None:
    log.tick(8)
    before = {topic: len(log.rows(topic)) for topic in ("tick", "position", "attitude")}
    log.tick(3)
    log.tick(1, OUTPUT._replace(vehicle=OUTPUT.vehicle._replace(x_m=1e300)))
    log.tick(4)
    after = {topic: len(log.rows(topic)) for topic in before}
    assert {topic: after[topic] - before[topic] for topic in before} == {
        "tick": 8,
        "position": 1,  # with the one tick: without it none has changed
        "attitude": 1,
    }
    places = [row["vehicle_x_m"] for row in values(log, "tick")]
    assert [place == inf for place in places] == [False] * 11 + [True] + [False] * 4


def test_a_state_is_written_with_its_reset_and_after_four_hundred_ticks(log: Log) -> None:
    log.tick(8)
    log.recorder.reset(STATE)
    log.tick(8)
    rows = values(log, "state")
    flags = [list(row.values())[2] for row in rows]
    assert flags == [False, True]
