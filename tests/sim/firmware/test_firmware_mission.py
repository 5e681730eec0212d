"""A mission file, and its upload, with a stand-in for the firmware."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.sim.firmware.mission import MissionError, MissionUpload, read_mission, set_home

ROWS = """QGC WPL 110
0\t1\t0\t16\t0\t0\t0\t0\t52.0\t4.4\t10.0\t1
1\t0\t3\t189\t0\t0\t0\t0\t0\t0\t0\t1

2\t0\t3\t21\t0\t0\t0\t0\t52.0001\t-4.4\t0.5\t1
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "mission.txt"
    path.write_text(text)
    return path


def test_every_item_is_given_as_it_stands_in_the_file(tmp_path: Path) -> None:
    items = read_mission(written(tmp_path, ROWS))
    assert [item.command for item in items] == [16, 189, 21]
    upload: Any = MissionUpload(items, 1)
    begun = upload.begin()
    assert (begun.get_type(), begun.count, begun.target_component) == ("MISSION_COUNT", 3, 1)
    sent = upload.answer(mavlink.MAVLink_mission_request_int_message(1, 240, 2))
    assert (sent.seq, sent.frame, sent.command, sent.z) == (2, 3, 21, 0.5)
    assert (sent.x, sent.y) == (520001000, -44000000)
    assert upload.answer(mavlink.MAVLink_mission_request_message(1, 240, 0)).command == 16
    assert upload.answer(mavlink.MAVLink_mission_request_message(1, 240, 3)) is None
    assert not upload.accepted
    assert upload.answer(mavlink.MAVLink_mission_ack_message(1, 240, 0)) is None
    assert upload.accepted


def test_a_refusal_is_kept() -> None:
    upload = MissionUpload((), 1)
    upload.answer(mavlink.MAVLink_mission_ack_message(1, 240, mavlink.MAV_MISSION_NO_SPACE))
    assert (upload.accepted, upload.refused) == (False, "MAV_MISSION_RESULT 4")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "line 1: not a mission"),
        ("QGC WPL 110\n0 1 0 16\n", "line 2: 4 columns"),
        (ROWS.replace("52.0001", "north"), "line 5: could not convert"),
        (ROWS.replace("52.0001", "92"), "line 5: latitude"),
        (ROWS.replace("189", "18.5"), "line 3: its command"),
        (ROWS.replace("0.5", "nan"), "line 5: a column"),
        (ROWS.replace("2\t0\t3", "7\t0\t3"), "line 5: item 7, expected 2"),
        ("\n".join(ROWS.splitlines()[:2]), "no item beside home"),
    ],
)
def test_what_is_no_mission_is_named_with_its_line(tmp_path: Path, text: str, why: str) -> None:
    with pytest.raises(MissionError, match=r"mission\.txt") as raised:
        read_mission(written(tmp_path, text))
    assert why in str(raised.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(MissionError, match="cannot be read: No such file"):
        read_mission(tmp_path / "none.txt")


def test_home_is_set_in_the_frame_that_each_firmware_takes(tmp_path: Path) -> None:
    """PX4 refuses a COMMAND_INT in any other frame, and keeps home where it was armed."""
    home = read_mission(written(tmp_path, ROWS))[0]
    sent = set_home(21, home)
    assert (sent.command, sent.frame) == (179, mavlink.MAV_FRAME_GLOBAL_INT)
    assert (sent.target_system, sent.target_component, sent.param1) == (21, 1, 0.0)
    assert (sent.x, sent.y, sent.z) == (520000000, 44000000, 10.0)
