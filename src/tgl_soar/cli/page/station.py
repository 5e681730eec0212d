"""A ground station of its own: what telemetry reported, as it stands now and over the last minute.

It speaks through pymavlink and owns no socket and no clock: bytes and the time come in, bytes go
out.  Nothing here knows of browsers.  A number that is not finite stays what it is, and is shown as
not known.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from math import degrees, isfinite
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.parameters import INDEX, PARAMETERS
from tgl_soar.link.frames import (
    HEADER_V1,
    HEADER_V2,
    MARKER_V1,
    MARKER_V2,
    SIGNATURE,
    first_frame,
)
from tgl_soar.link.session import HEARTBEAT_S
from tgl_soar.link.signing import EPOCH_S, Signing, source_of
from tgl_soar.onboard.telemetry_values import ARRAY, ARRAY_NAME, FAST, SLOW

ROW_S: Final = 0.2  # between two rows of the strips
HISTORY_S: Final = 60.0
SILENCE_S: Final = 2.0  # without a word of the module: the link counts as dead
FETCH_S: Final = 2.0  # between two requests for parameters that are missing
FETCHED_AT_ONCE: Final = 16
TEXTS: Final = 200
LONGEST_TEXT: Final = 250

# Columns of the strips and of a replay; each is a name of `Station.now`.
ROW: Final = (
    *("t", "soar_x", "soar_z", "e_rho", "pitch", "pitch_sp", "elevator", "updraft", "excess"),
    *("airspeed", "soar_mode", "line_x", "line_z", "line_lean", "roll", "climb", "wind"),
    *("age_pos", "age_att", "age_ap", "clearance", "stall"),
    *("fc_state", "fc_chance", "fc_time", "fc_z"),
)
# Of DEBUG_FLOAT_ARRAY, what no NAMED_VALUE_FLOAT says; "imu_weight" and the rest are for plots.
_OF_ARRAY: Final = {
    name: i for i, name in enumerate(ARRAY) if name not in {*FAST, *SLOW, "mode", "x", "z"}
}
_READ: Final = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_ATTITUDE,
        mavlink.MAVLINK_MSG_ID_PARAM_VALUE,
        345,  # PARAM_ERROR
        mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
        mavlink.MAVLINK_MSG_ID_STATUSTEXT,
        mavlink.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT,
        mavlink.MAVLINK_MSG_ID_DEBUG_FLOAT_ARRAY,
    }
)


class Text(NamedTuple):
    """A STATUSTEXT, its pieces together."""

    number: int  # counts from 1, one more with every piece
    first: int  # the number of its first piece
    wall_s: float
    severity: int
    source: str  # "module" or "autopilot"
    text: str


class StationAnswer(NamedTuple):
    """What the module answered to a parameter that was set, or to a command."""

    kind: str  # "value", "error" or "ack"
    name: str = ""  # of the parameter
    value: float = 0.0  # of it
    command: int = 0
    result: int = 0


class _Codec(mavlink.MAVLink):  # type: ignore[misc]
    """pymavlink's, which takes the stamp of a forged frame for its stream's newest."""

    def check_signature(self, frame: bytearray, system: int, component: int) -> bool:
        """Whether a frame is signed with our key and later than all before."""
        stamps = dict(self.signing.stream_timestamps)
        is_good: bool = super().check_signature(frame, system, component)
        if not is_good:
            self.signing.stream_timestamps = stamps
        return is_good


class Station:
    """One ground station, for one module."""

    def __init__(
        self, system: int, component: int, own_system: int, key: bytes | None, wall_s: float
    ) -> None:
        """system, component: the module's.  key: 32 bytes to sign with; None: unsigned.  wall_s:
        seconds since 1970, which stamps of signed frames begin with."""
        self.target = (system, component)
        self.now: dict[str, float] = {}
        self.parameters: dict[str, float] = {}
        self.texts: deque[Text] = deque(maxlen=TEXTS)
        self.rows: deque[tuple[float | None, ...]] = deque(maxlen=round(HISTORY_S / ROW_S))
        self.row_number = 0  # of rows so far
        self.text_number = 0
        self.starts = 0  # of the module, that were noticed
        self.on_answer: Callable[[StationAnswer], None] = lambda _answer: None
        # The vehicle's time [s], and the numbers of `ARRAY` at it.
        self.on_array: Callable[[float, Sequence[float]], None] = lambda _time_s, _data: None
        self._received_s = float("-inf")  # a message of the module
        self._rows_s = float("-inf")
        self._heartbeat_s = float("-inf")
        self._fetch_s = float("-inf")
        self._start: int | None = None  # the number that the module drew at its start
        self._next_piece = ("", 0, 0)  # of the last text: source, its id, the number of the piece
        self._out: list[bytes] = []
        self.codec: Any = _Codec(None, own_system, mavlink.MAV_COMP_ID_MISSIONPLANNER)
        self.codec.robust_parsing = True
        self._vouching = Signing(key, EPOCH_S, 0.0)  # for signatures; the codec has the stamps
        if key is not None:
            signing = self.codec.signing
            signing.secret_key, signing.sign_outgoing = key, True
            signing.timestamp = int((wall_s - EPOCH_S) * 1e5)
            signing.link_id = own_system

    # --- in -------------------------------------------------------------------------------------

    def vouches(self, data: bytes) -> bool:
        """Whether a datagram may make its sender the one who is answered.

        It begins with a whole frame; with a key, with one that is signed with it and is later than
        all that were received of its stream.  Clocks are not compared: a module whose own starts in
        the past goes on from our stamps, once it has been answered.
        """
        frame = first_frame(data)
        if not frame or not self._vouching.vouches(frame):
            return False
        if not self._vouching.is_on:
            return True
        sender = source_of(frame)
        stream = (frame[-SIGNATURE], sender.system, sender.component)
        stamp = int.from_bytes(frame[-SIGNATURE + 1 : -6], "little")
        newest: int = self.codec.signing.stream_timestamps.get(stream, 0)
        return stamp > newest

    def receive(self, data: bytes, now_s: float, wall_s: float) -> int:
        """Take in bytes of the link; how many messages of the module or its autopilot."""
        count = 0
        for message in self.codec.parse_buffer(bytearray(data)) or ():
            kind = message.get_type()
            if kind == "BAD_DATA" or message.get_srcSystem() != self.target[0]:
                continue
            if message.get_srcComponent() == self.target[1]:
                self._of_module(kind, message, now_s, wall_s)
                count += 1
            elif message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1:
                self._of_autopilot(kind, message, wall_s)
                count += 1
        return count

    def _of_module(self, kind: str, message: Any, now_s: float, wall_s: float) -> None:
        self._received_s = now_s
        if kind == "NAMED_VALUE_FLOAT":
            name = message.name.rstrip("\0")
            if name in FAST or name in SLOW:
                self.now[name] = message.value
        elif kind == "DEBUG_FLOAT_ARRAY" and message.name.rstrip("\0") == ARRAY_NAME:
            for name, i in _OF_ARRAY.items():
                self.now[name] = message.data[i]
            self.on_array(message.time_usec * 1e-6, message.data)
        elif kind == "HEARTBEAT":
            self._take_start(message.custom_mode >> 8, now_s)
            self.now["soar_mode"] = float(message.custom_mode & 0xFF)
        elif kind == "PARAM_VALUE":
            self._take_value(message.param_id.rstrip("\0"), message.param_value)
        elif kind == "PARAM_ERROR" and self._is_for_us(message):
            self.on_answer(StationAnswer(kind="error", name=message.param_id.rstrip("\0")))
        elif kind == "COMMAND_ACK" and self._is_for_us(message):
            self.on_answer(
                StationAnswer(kind="ack", command=message.command, result=message.result)
            )
        elif kind == "STATUSTEXT":
            self._take_text(message, wall_s, "module")

    def _take_start(self, number: int, now_s: float) -> None:
        """Another number than before: the module was started again, and everything is asked."""
        if number == self._start:
            return
        if self._start is not None:
            self.starts += 1
        self._start = number
        self.now.clear()
        self.parameters.clear()
        self._fetch_s = now_s
        self._pack(self.codec.param_request_list_encode(*self.target))

    def _take_value(self, name: str, value: float) -> None:
        if name in INDEX:
            self.parameters[name] = value
            self.on_answer(StationAnswer(kind="value", name=name, value=value))

    def _of_autopilot(self, kind: str, message: Any, wall_s: float) -> None:
        if kind == "ATTITUDE":
            self.now["pitch"], self.now["roll"] = degrees(message.pitch), degrees(message.roll)
        elif kind == "HEARTBEAT":
            armed = message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
            self.now["armed"] = 1.0 if armed else 0.0
        elif kind == "SYS_STATUS":
            self._take_battery(message.voltage_battery, message.battery_remaining)
        elif kind == "STATUSTEXT":
            self._take_text(message, wall_s, "autopilot")

    def _take_battery(self, millivolts: int, percent: int) -> None:
        """0 and 65535 mV, -1 %: not measured."""
        self.now["battery_v"] = millivolts * 1e-3 if 0 < millivolts < 65535 else float("nan")
        self.now["battery"] = percent * 1e-2 if 0 <= percent <= 100 else float("nan")

    def _take_text(self, message: Any, wall_s: float, source: str) -> None:
        """A text; a piece of a long one is put behind those before it, if none is missing."""
        words = "".join(c if c.isprintable() else "?" for c in str(message.text).rstrip("\0"))
        self.text_number += 1
        first = self.text_number
        piece = source, int(message.id), int(message.chunk_seq)
        if message.id and message.chunk_seq and piece == self._next_piece:
            last = self.texts.pop()
            words, first = (last.text + words)[:LONGEST_TEXT], last.first
        self._next_piece = (*piece[:2], piece[2] + 1)
        self.texts.append(
            Text(
                number=self.text_number,
                first=first,
                wall_s=wall_s,
                severity=int(message.severity),
                source=source,
                text=words,
            )
        )

    def _is_for_us(self, message: Any) -> bool:
        return message.target_system in (0, self.codec.srcSystem)

    # --- now ------------------------------------------------------------------------------------

    def silence_s(self, now_s: float) -> float:
        """Since the last message of the module; inf: none yet."""
        return now_s - self._received_s

    def is_alive(self, now_s: float) -> bool:
        """Whether the module was received lately."""
        return self.silence_s(now_s) <= SILENCE_S

    @property
    def missing(self) -> list[str]:
        """Parameters that are not known yet."""
        return [p.name for p in PARAMETERS if p.name not in self.parameters]

    # --- out ------------------------------------------------------------------------------------

    def set(self, name: str, value: float) -> None:
        """One PARAM_SET."""
        kind = mavlink.MAV_PARAM_TYPE_REAL32
        self._pack(self.codec.param_set_encode(*self.target, name.encode(), value, kind))

    def command(self, number: int, confirmation: int) -> None:
        """One COMMAND_LONG without parameters."""
        fields = (number, confirmation, 0, 0, 0, 0, 0, 0, 0)
        self._pack(self.codec.command_long_encode(*self.target, *fields))

    def step(self, now_s: float) -> None:
        """Heartbeat, missing parameters, a row of the strips."""
        if now_s - self._heartbeat_s >= HEARTBEAT_S:
            self._heartbeat_s = now_s
            gcs, invalid = mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID
            self._pack(self.codec.heartbeat_encode(gcs, invalid, 0, 0, mavlink.MAV_STATE_ACTIVE))
        if self.is_alive(now_s) and now_s - self._fetch_s >= FETCH_S:
            self._fetch_s = now_s
            for name in self.missing[:FETCHED_AT_ONCE]:
                self._pack(self.codec.param_request_read_encode(*self.target, name.encode(), -1))
        if now_s - self._rows_s >= ROW_S:
            self._rows_s = now_s if now_s - self._rows_s > 2 * ROW_S else self._rows_s + ROW_S
            alive = self.is_alive(now_s)
            values = (self.now.get(name) if alive else None for name in ROW[1:])
            self.rows.append((round(now_s, 2), *(number(value) for value in values)))
            self.row_number += 1

    def take_datagrams(self) -> list[bytes]:
        """Frames to send."""
        out, self._out = self._out, []
        return out

    def _pack(self, message: Any) -> None:
        self._out.append(bytes(message.pack(self.codec)))
        self.codec.seq = (self.codec.seq + 1) % 256


def number(value: float | None) -> float | None:
    """As JSON takes it, four digits behind the point; None: not known."""
    return None if value is None or not isfinite(value) else round(value, 4)


def without_others(data: bytes) -> bytes:
    """A datagram without whole frames that no page shows: raw sensors come hundreds of times a
    second on some links.  What is no frame is left as it is."""
    kept: list[bytes] = []
    at = 0
    while at < len(data):
        if data[at] == MARKER_V2 and len(data) >= at + HEADER_V2:
            number_ = int.from_bytes(data[at + 7 : at + 10], "little")
            end = at + data[at + 1] + HEADER_V2 + 2 + (13 if data[at + 2] & 1 else 0)
        elif data[at] == MARKER_V1 and len(data) >= at + HEADER_V1:
            number_, end = data[at + 5], at + data[at + 1] + HEADER_V1 + 2
        else:
            return b"".join((*kept, data[at:]))
        if number_ in _READ:
            kept.append(data[at:end])
        at = end
    return b"".join(kept)
