"""A mission file's rows: each column where it belongs, each limit on both sides; the messages of an
upload, field by field."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.sim.firmware.mission import (
    MissionError,
    MissionItem,
    MissionUpload,
    read_mission,
    set_home,
)

HEADING = "QGC WPL 110"
HOME = "0 1 0 16 0 0 0 0 52 4 10 1"
GOOD = ["1", "0", "3", "16", "1.5", "2.5", "3.5", "4.5", "51.5", "-4.25", "12.5", "1"]
NAMES = {0: "number", 1: "current", 2: "frame", 3: "command", 11: "autocontinue"}


def read(folder: Path, *rows: str, heading: str = HEADING) -> tuple[MissionItem, ...]:
    path = folder / "mission.txt"
    path.write_text("\n".join((heading, *rows)))
    return read_mission(path)


def row(**columns: str) -> str:
    words = list(GOOD)
    for name, word in columns.items():
        words[int(name[1:])] = word
    return "\t".join(words)


def test_each_column_stands_for_its_own() -> None:
    assert MissionItem._fields == (
        "frame",
        "command",
        "parameters",
        "latitude_deg",
        "longitude_deg",
        "height_m",
    )


def test_a_row_is_read_column_by_column(tmp_path: Path) -> None:
    _, item = read(tmp_path, HOME, row())
    assert item == MissionItem(
        frame=3,
        command=16,
        parameters=(1.5, 2.5, 3.5, 4.5),
        latitude_deg=51.5,
        longitude_deg=-4.25,
        height_m=12.5,
    )
    assert isinstance(item.frame, int)
    assert isinstance(item.command, int)


def test_blanks_around_the_heading_and_empty_rows_are_no_matter(tmp_path: Path) -> None:
    assert len(read(tmp_path, "", HOME, "  ", row(), heading=f"  {HEADING} ")) == 2


@pytest.mark.parametrize(
    ("column", "good"), [(8, "90"), (8, "-90"), (9, "180"), (9, "-180"), (3, "65535"), (3, "0")]
)
def test_the_ends_of_a_range_are_in_it(tmp_path: Path, column: int, good: str) -> None:
    assert len(read(tmp_path, HOME, row(**{f"c{column}": good}))) == 2


@pytest.mark.parametrize(
    ("column", "bad"), [(8, "90.001"), (8, "-90.001"), (9, "180.001"), (9, "-180.001")]
)
def test_a_place_beyond_the_earth_is_refused(tmp_path: Path, column: int, bad: str) -> None:
    with pytest.raises(MissionError, match=r"line 3: latitude -90 … 90 and longitude -180 … 180"):
        read(tmp_path, HOME, row(**{f"c{column}": bad}))


@pytest.mark.parametrize("column", NAMES)
@pytest.mark.parametrize("bad", ["-1", "65536", "0.5", "1.25"])
def test_a_whole_column_that_is_not_whole_or_too_large_is_named(
    tmp_path: Path, column: int, bad: str
) -> None:
    with pytest.raises(MissionError, match=f"line 3: its {NAMES[column]} is no number that a"):
        read(tmp_path, HOME, row(**{f"c{column}": bad}))


@pytest.mark.parametrize("column", [4, 5, 6, 7, 8, 9, 10])
@pytest.mark.parametrize("bad", ["nan", "inf", "-inf"])
def test_a_column_that_is_no_number_is_refused(tmp_path: Path, column: int, bad: str) -> None:
    with pytest.raises(MissionError, match="line 3: a column is no number that a mission has"):
        read(tmp_path, HOME, row(**{f"c{column}": bad}))


@pytest.mark.parametrize("number", ["0", "2"])
def test_items_are_counted_from_home_on(tmp_path: Path, number: str) -> None:
    with pytest.raises(MissionError, match=f"line 3: item {number}, expected 1"):
        read(tmp_path, HOME, row(c0=number))


@pytest.mark.parametrize("words", [11, 13])
def test_a_row_of_too_few_or_too_many_columns_is_refused(tmp_path: Path, words: int) -> None:
    long = " ".join([*GOOD, "1"][:words])
    with pytest.raises(MissionError, match=f"line 3: {words} columns, an item has 12"):
        read(tmp_path, HOME, long)


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mission.txt"
    path.write_bytes(b"QGC WPL 110\n\xff\xfe")
    with pytest.raises(MissionError, match=r"mission\.txt: cannot be read: .*codec"):
        read_mission(path)


def test_a_heading_of_another_version_is_refused(tmp_path: Path) -> None:
    with pytest.raises(MissionError, match="line 1: not a mission: a ground station writes 'QGC"):
        read(tmp_path, HOME, row(), heading="QGC WPL 120")


# --- messages -------------------------------------------------------------------------------------

ITEM = MissionItem(
    frame=3,
    command=21,
    parameters=(1.0, 2.0, 3.0, 4.0),
    latitude_deg=51.12345678,
    longitude_deg=-4.5,
    height_m=7.5,
)


def test_an_item_is_sent_with_all_that_it_has() -> None:
    upload = MissionUpload((ITEM, ITEM), 21)
    sent: Any = upload.answer(mavlink.MAVLink_mission_request_int_message(255, 190, 1))
    assert sent.get_type() == "MISSION_ITEM_INT"
    assert (sent.target_system, sent.target_component) == (21, 1)
    assert (sent.seq, sent.frame, sent.command) == (1, 3, 21)
    assert (sent.current, sent.autocontinue) == (0, 1)
    assert (sent.param1, sent.param2, sent.param3, sent.param4) == (1.0, 2.0, 3.0, 4.0)
    assert (sent.x, sent.y, sent.z) == (511234568, -45000000, 7.5)


def test_an_upload_begins_with_how_many_items_there_are() -> None:
    begun = MissionUpload((ITEM, ITEM), 21).begin()
    assert (begun.get_type(), begun.count) == ("MISSION_COUNT", 2)
    assert (begun.target_system, begun.target_component) == (21, 1)


@pytest.mark.parametrize("kind", ["mission_request", "mission_request_int"])
def test_an_item_that_there_is_not_is_not_sent(kind: str) -> None:
    upload = MissionUpload((ITEM, ITEM), 21)
    request = getattr(mavlink, f"MAVLink_{kind}_message")
    assert upload.answer(request(255, 190, 0)) is not None
    assert upload.answer(request(255, 190, 2)) is None


def test_other_messages_of_a_mission_need_no_answer() -> None:
    upload = MissionUpload((ITEM,), 21)
    assert upload.answer(mavlink.MAVLink_mission_current_message(0)) is None
    assert (upload.accepted, upload.refused) == (False, "")


def test_what_is_accepted_after_a_refusal_is_accepted() -> None:
    upload = MissionUpload((ITEM,), 21)
    upload.answer(mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_ERROR))
    assert (upload.accepted, upload.refused) == (False, "MAV_MISSION_RESULT 1")
    upload.answer(mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_ACCEPTED))
    assert (upload.accepted, upload.refused) == (True, "")


def test_home_is_set_by_an_int_command_in_the_global_frame() -> None:
    sent = set_home(21, ITEM)
    assert sent.get_type() == "COMMAND_INT"
    assert (sent.target_system, sent.target_component) == (21, 1)
    assert (sent.frame, sent.command) == (5, 179)  # MAV_FRAME_GLOBAL_INT, MAV_CMD_DO_SET_HOME
    assert (sent.current, sent.autocontinue) == (0, 0)
    assert (sent.param1, sent.param2, sent.param3, sent.param4) == (0.0, 0.0, 0.0, 0.0)
    assert (sent.x, sent.y, sent.z) == (511234568, -45000000, 7.5)
