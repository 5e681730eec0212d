"""A mission for a real firmware: read from a file, and uploaded as a ground station does it.

The file is what ground stations write ("QGC WPL 110"): a heading, then a row an item, the first of
which is home:

    number  current  frame  command  4 parameters  latitude  longitude  height  autocontinue

    bridge → firmware   MISSION_COUNT, then the item that each request names
    firmware → bridge   MISSION_REQUEST or MISSION_REQUEST_INT, at the end MISSION_ACK
"""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

HEADING: Final = "QGC WPL 110"
COLUMNS: Final = 12
WHOLE: Final = {0: "number", 1: "current", 2: "frame", 3: "command", 11: "autocontinue"}


class MissionError(ValueError):
    """The file is no mission; the message says where and why."""


class MissionItem(NamedTuple):
    """One row."""

    frame: int  # MAV_FRAME
    command: int  # MAV_CMD
    parameters: tuple[float, float, float, float]
    latitude_deg: float
    longitude_deg: float
    height_m: float


def read_mission(path: Path) -> tuple[MissionItem, ...]:
    """The rows of a file, home first.  Errors: `MissionError`."""
    try:
        lines = path.read_text().splitlines()
    except OSError as error:
        raise MissionError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError as error:
        raise MissionError(f"{path}: cannot be read: {error}") from None
    if not lines or lines[0].strip() != HEADING:
        raise MissionError(f"{path}: line 1: not a mission: a ground station writes {HEADING!r}")
    items: list[MissionItem] = []
    for number, line in enumerate(lines[1:], 2):
        words = line.split()
        if not words:
            continue
        where = f"{path}: line {number}"
        if len(words) != COLUMNS:
            raise MissionError(f"{where}: {len(words)} columns, an item has {COLUMNS}")
        try:
            values = [float(word) for word in words]
        except ValueError as error:
            raise MissionError(f"{where}: {error}") from None
        whole = [name for i, name in WHOLE.items() if not 0.0 <= values[i] <= 65535.0]
        whole += [name for i, name in WHOLE.items() if values[i] % 1.0 != 0.0]
        if whole or not all(isfinite(value) for value in values):
            what = f"its {whole[0]}" if whole else "a column"
            raise MissionError(f"{where}: {what} is no number that a mission has")
        if values[0] != len(items):
            raise MissionError(f"{where}: item {values[0]:g}, expected {len(items)}")
        if abs(values[8]) > 90.0 or abs(values[9]) > 180.0:
            raise MissionError(f"{where}: latitude -90 … 90 and longitude -180 … 180 degrees")
        items.append(
            MissionItem(
                frame=int(values[2]),
                command=int(values[3]),
                parameters=(values[4], values[5], values[6], values[7]),
                latitude_deg=values[8],
                longitude_deg=values[9],
                height_m=values[10],
            )
        )
    if len(items) < 2:
        raise MissionError(f"{path}: no item beside home")
    return tuple(items)


def set_home(system: int, home: MissionItem) -> Any:
    """The command that puts home where the file has it: else it is where the aircraft is armed."""
    return mavlink.MAVLink_command_int_message(
        target_system=system,
        target_component=mavlink.MAV_COMP_ID_AUTOPILOT1,
        frame=mavlink.MAV_FRAME_GLOBAL_INT,  # of a COMMAND_INT PX4 takes no other
        command=mavlink.MAV_CMD_DO_SET_HOME,
        current=0,
        autocontinue=0,
        param1=0.0,
        param2=0.0,
        param3=0.0,
        param4=0.0,
        x=round(home.latitude_deg * 1e7),
        y=round(home.longitude_deg * 1e7),
        z=home.height_m,
    )


class MissionUpload:
    """One upload, from message to message."""

    def __init__(self, items: tuple[MissionItem, ...], system: int) -> None:
        """`items`: those that the firmware is to have, some of them leave out home."""
        self.accepted = False
        self.refused = ""  # by which MAV_MISSION_RESULT
        self._items = items
        self._target = (system, mavlink.MAV_COMP_ID_AUTOPILOT1)

    def begin(self) -> Any:
        """What announces it; again, where no request has come."""
        return mavlink.MAVLink_mission_count_message(*self._target, len(self._items))

    def answer(self, message: Any) -> Any | None:
        """To a message of the firmware."""
        kind = message.get_type()
        if kind == "MISSION_ACK":
            self.accepted = message.type == mavlink.MAV_MISSION_ACCEPTED
            self.refused = "" if self.accepted else f"MAV_MISSION_RESULT {message.type}"
        elif kind in ("MISSION_REQUEST", "MISSION_REQUEST_INT") and message.seq < len(self._items):
            item = self._items[message.seq]
            (system, component), (one, two, three, four) = self._target, item.parameters
            return mavlink.MAVLink_mission_item_int_message(
                target_system=system,
                target_component=component,
                seq=message.seq,
                frame=item.frame,
                command=item.command,
                current=0,
                autocontinue=1,
                param1=one,
                param2=two,
                param3=three,
                param4=four,
                x=round(item.latitude_deg * 1e7),
                y=round(item.longitude_deg * 1e7),
                z=item.height_m,
            )
        return None
