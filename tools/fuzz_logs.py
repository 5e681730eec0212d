"""Small logs of every kind that is read here: what the fuzzer begins from.

They are written by the letter of their formats and hold a few rows of each thing that a reader
looks at, so that few bytes change much; most of them of one or two things only, which are read in
a fraction of the time.  Their texts hold markup, which must stand escaped wherever it is shown.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Final

from fastcrc.crc16 import mcrf4xx
from pymavlink.dialects.v20 import ardupilotmega as mavlink

ULOG_BEGIN: Final = b"ULog\x01\x12\x35\x01" + bytes(8)
UNIX_US: Final = 1_790_000_000_000_000
_ROWS: Final = 12
_FEW: Final = 4
MARKUP: Final = "<u>"
_WORDS: Final = f"soaring: {MARKUP} on the line".encode()

_CODES: Final = {
    "uint64_t": "Q", "uint32_t": "I", "uint16_t": "H", "uint8_t": "B", "int32_t": "i",
    "double": "d", "float": "f", "bool": "?",
}  # fmt: skip

# Of our own log: what its readers take from each topic.
_OURS: Final = {
    "tick": "uint64_t timestamp;uint32_t tick;double time_s;bool engage;uint8_t mode;"
    "uint8_t reason;bool active;float vehicle_x_m;float vehicle_y_m;float vehicle_z_m;"
    "float vehicle_velocity_x_mps;float vehicle_velocity_y_mps;float vehicle_climb_mps;"
    "float vehicle_heading_rad;float setpoints_pitch_rad;float line_x_m;float line_z_m;"
    "float line_eta_rad;bool line_moving;float e_rho_m;double command_elevator;"
    "double command_aileron;double command_rudder;",
    "position": "uint64_t timestamp;uint32_t tick;double time_s;double north_m;double east_m;"
    "double down_m;double velocity_north_mps;double velocity_east_mps;double velocity_down_mps;",
    "attitude": "uint64_t timestamp;uint32_t tick;double time_s;float qw;float qx;float qy;"
    "float qz;",
    "slow": "uint64_t timestamp;uint32_t tick;float air_wind_mps;float air_updraft_mps;",
    "parameter": "uint64_t timestamp;uint32_t tick;uint16_t index;float value;",
}
# Of a tick some columns only, for small logs.
_IN_PARTS: Final = {
    "tick": "uint64_t timestamp;uint32_t tick;double time_s;bool engage;uint8_t mode;"
    "uint8_t reason;bool active;",
    "flown": "uint64_t timestamp;uint32_t tick;uint8_t mode;bool active;float vehicle_x_m;"
    "float vehicle_y_m;float vehicle_z_m;float line_x_m;float line_z_m;float line_eta_rad;"
    "bool line_moving;float e_rho_m;",
    "steered": "uint64_t timestamp;uint32_t tick;uint8_t mode;bool active;"
    "float setpoints_pitch_rad;double command_elevator;double command_aileron;"
    "double command_rudder;",
}
_NAMES: Final = {"flown": "tick", "steered": "tick"}
_PX4: Final = {
    "vehicle_attitude": "uint64_t timestamp;float[4] q;",
    "vehicle_local_position": "uint64_t timestamp;float x;float y;float z;float vx;float vy;"
    "float vz;bool xy_valid;",
    "airspeed_validated": "uint64_t timestamp;float true_airspeed_m_s;",
    "sensor_combined": "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;",
    "vehicle_torque_setpoint": "uint64_t timestamp;float[3] xyz;",
    "vehicle_attitude_setpoint": "uint64_t timestamp;float roll_body;float pitch_body;",
    "vehicle_status": "uint64_t timestamp;uint8_t nav_state;bool failsafe;",
}
_DATAFLASH: Final = {
    "PARM": ("QNff", "TimeUS,Name,Value,Default"),
    "MSG": ("QZ", "TimeUS,Message"),
    "MODE": ("QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    "EV": ("QB", "TimeUS,Id"),
    "ERR": ("QBB", "TimeUS,Subsys,ECode"),
    "DSF": ("QI", "TimeUS,Dp"),
    "ATT": ("Qccccff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
    "XKF1": ("QBffffff", "TimeUS,C,VN,VE,VD,PN,PE,PD"),
    "ARSP": ("QBf", "TimeUS,I,Airspeed"),
    "IMU": ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "RCOU": ("QHHHH", "TimeUS,C1,C2,C3,C4"),
}
_LETTERS: Final = {
    "Q": "Q", "N": "16s", "f": "f", "Z": "64s", "M": "B", "B": "B", "c": "h", "H": "H", "I": "I",
}  # fmt: skip


def ulog_message(kind: str, body: bytes) -> bytes:
    """One message of a ULog."""
    return struct.pack("<HB", len(body), ord(kind)) + body


def _keyed(kind: str, key: str, value: bytes) -> bytes:
    """A message that is a key with a value: information, or a parameter."""
    return ulog_message(kind, bytes([len(key)]) + key.encode() + value)


def _ulog(head: Sequence[bytes], topics: dict[str, str], rows: int) -> bytes:
    parts = [ULOG_BEGIN, ulog_message("B", bytes(40)), *head]
    parts += [ulog_message("F", f"{name}:{fields}".encode()) for name, fields in topics.items()]
    parts.append(_keyed("P", "float TGL_X", struct.pack("<f", 0.5)))
    for number, name in enumerate(topics):
        parts.append(ulog_message("A", struct.pack("<BH", 0, number) + name.encode()))
    for row in range(rows):
        us = 20_000_000 + 20_000 * row
        for number, fields in enumerate(topics.values()):
            parts.append(ulog_message("D", struct.pack("<H", number) + _ulog_row(fields, us, row)))
    parts.append(ulog_message("L", b"4" + struct.pack("<Q", us) + _WORDS))
    parts.append(_keyed("P", "float TGL_X", struct.pack("<f", 0.75)))
    parts.append(ulog_message("O", struct.pack("<H", 40)))
    return b"".join(parts)


def _ulog_row(fields: str, us: int, row: int) -> bytes:
    """A row whose numbers grow slowly; its time, tick and mode are what they are called."""
    packed = b""
    for field in fields.rstrip(";").split(";"):
        kind, name = field.split()
        kind, _, count = kind.rstrip("]").partition("[")
        value: float = {
            "timestamp": us, "tick": row + 1, "time_s": us * 1e-6, "mode": 4, "active": 1,
            "engage": 1, "reason": row == 3, "nav_state": 14, "line_moving": row < 3,
        }.get(name, 1 if _CODES[kind] in "?BHI" else 0.01 * row)  # fmt: skip
        whole = _CODES[kind] in "QIHBi"
        for _ in range(int(count or 1)):
            packed += struct.pack("<" + _CODES[kind], round(value) if whole else value)
    return packed


SITE: Final = b'site.name = "hill"\nlines.a = { x_m = 0.2, z_m = 1.15 }\n'


def own_log(
    site: bytes = SITE,
    modes: bytes = b"boot;standby;<u>",
    topics: Sequence[str] = (),
    rows: int = _ROWS,
) -> bytes:
    """A flight log of the module, with the site file and the names of modes that it tells.

    topics: of those known here, as in all that follows; none: all.
    """
    key = f"char[{len(site)}] site".encode()
    head = [
        _keyed("I", "char[8] sys_name", b"tgl_soar"),
        _keyed("I", "char[1] ver_log", b"1"),
        _keyed("I", f"char[{len(modes)}] modes", modes),
        _keyed("I", "char[9] site_file", b"<u>l.toml"),
        ulog_message("M", b"\0" + bytes([len(key)]) + key + site),
    ]
    known = _OURS | _IN_PARTS if topics else _OURS
    chosen = {_NAMES.get(name, name): known[name] for name in topics or known}
    return _ulog(head, chosen, rows)


def px4_log(topics: Sequence[str] = (), rows: int = _ROWS) -> bytes:
    """PX4's log."""
    head = [
        _keyed("I", "char[3] sys_name", b"PX4"),
        _keyed("I", "uint32_t ver_sw_release", bytes(4)),
    ]
    return _ulog(head, {name: _PX4[name] for name in topics or _PX4}, rows)


def dataflash_log(names: Sequence[str] = (), rows: int = _ROWS) -> bytes:
    """ArduPlane's log."""
    kinds = {name: _DATAFLASH[name] for name in names or _DATAFLASH}
    parts = [_format_record(0x80, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")]
    layouts = {}
    for number, (name, (letters, columns)) in enumerate(kinds.items(), 129):
        layouts[name] = number, "<" + "".join(_LETTERS[letter] for letter in letters)
        length = 3 + struct.calcsize(layouts[name][1])
        parts.append(_format_record(number, length, name, letters, columns))
    for row in range(rows):
        us = 20_000_000 + 20_000 * row
        for name, (letters, _) in kinds.items():
            number, layout = layouts[name]
            values = [_dataflash_value(letter, row) for letter in letters[1:]]
            parts.append(b"\xa3\x95" + bytes([number]) + struct.pack(layout, us, *values))
    return b"".join(parts)


def _dataflash_value(letter: str, row: int) -> bytes | float:
    if letter in "NZ":
        return b"ArduPlane <u>4.5" if letter == "Z" else b"AIRSPEED_CRUISE"
    return 0.1 * row if letter == "f" else row % 2


def _format_record(number: int, length: int, name: str, letters: str, columns: str) -> bytes:
    words = (name.encode(), letters.encode(), columns.encode())
    return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, length, *words)


def tlog(names: Sequence[str] = (), rows: int = _ROWS) -> bytes:
    """What a ground station records of an autopilot and the module."""
    vehicle, module = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None, 1, 191)
    parts = []
    for row in range(rows):
        ms = 20_000 + 20 * row
        messages = [
            (vehicle, mavlink.MAVLink_heartbeat_message(1, 3, 81, 5 * (row > 5), 4, 3)),
            (vehicle, mavlink.MAVLink_attitude_quaternion_message(ms, 1, 0, 0.01 * row, *(0,) * 4)),
            (vehicle, mavlink.MAVLink_attitude_message(ms, *(0.01 * row,) * 6)),
            (vehicle, mavlink.MAVLink_local_position_ned_message(ms, *(0.1 * row,) * 6)),
            (vehicle, mavlink.MAVLink_vfr_hud_message(8.5, 0, 0, 0, 0, 0)),
            (vehicle, mavlink.MAVLink_servo_output_raw_message(ms, 0, *(1500,) * 8)),
            (module, mavlink.MAVLink_param_value_message(b"TGL_X", 0.2 * row, 9, 50, 3)),
            (module, mavlink.MAVLink_statustext_message(4, _WORDS)),
        ]
        messages += [
            (module, mavlink.MAVLink_named_value_float_message(ms, name, 4.0))
            for name in (b"soar_mode", b"e_rho", b"line_x", b"line_z", b"line_lean", b"updraft")
        ]
        for sender, message in messages:
            if names and message.get_type() not in names:
                continue
            frame = bytes(message.pack(sender))
            sender.seq = (sender.seq + 1) % 256
            parts.append((UNIX_US + 1000 * ms).to_bytes(8, "big") + frame)
    return b"".join(parts)


_READ_NAMES: Final = (
    "heartbeat", "attitude_quaternion", "attitude", "local_position_ned", "global_position_int",
    "gps_global_origin", "vfr_hud", "highres_imu", "scaled_imu", "raw_imu", "servo_output_raw",
    "statustext", "param_value", "named_value_float",
)  # fmt: skip
_READ: Final = tuple(getattr(mavlink, f"MAVLink_{name}_message") for name in _READ_NAMES)


def recorded(data: bytes) -> bytes:
    """A .tlog made of any bytes: frames of what its readers look at, whole and rightly summed.

    A byte chooses message and sender, one the payload's length, two the time since the last.
    """
    parts, at, us = [], 0, UNIX_US
    while at + 4 <= len(data):
        kind = _READ[data[at] % len(_READ)]
        component = 191 if data[at] & 0x80 else 1
        length = data[at + 1] % (kind.unpacker.size + 1)
        us += int.from_bytes(data[at + 2 : at + 4], "little", signed=True) * 1000
        payload = data[at + 4 : at + 4 + length] or b"\0"
        at += 4 + length
        head = struct.pack("<BBBBBBHB", len(payload), 0, 0, at % 256, 1, component,
                           kind.id & 0xFFFF, kind.id >> 16)  # fmt: skip
        crc = mcrf4xx(head + payload + bytes([kind.crc_extra]))
        parts.append((max(us, 0)).to_bytes(8, "big") + b"\xfd" + head + payload
                     + struct.pack("<H", crc))  # fmt: skip
    return b"".join(parts)


def _each(log: Callable[[Sequence[str], int], bytes], *sorts: str) -> list[bytes]:
    """A small log of each sort of things, and one of all."""
    return [*(log(sort.split(), _FEW) for sort in sorts), log((), _ROWS)]


OWN: Final = _each(
    lambda topics, rows: own_log(topics=topics, rows=rows),
    "tick", "flown", "steered", "tick slow", "tick position", "tick attitude", "tick parameter",
)  # fmt: skip
PX4: Final = _each(
    px4_log, "vehicle_attitude vehicle_status", "vehicle_local_position airspeed_validated",
    "sensor_combined", "vehicle_torque_setpoint", "vehicle_attitude_setpoint",
)  # fmt: skip
DATAFLASH: Final = _each(
    dataflash_log, "PARM MSG", "MODE EV", "ERR DSF", "ATT RCOU", "XKF1 ARSP", "IMU",
)  # fmt: skip
TLOG: Final = _each(
    tlog, "HEARTBEAT ATTITUDE_QUATERNION", "ATTITUDE LOCAL_POSITION_NED", "VFR_HUD PARAM_VALUE",
    "SERVO_OUTPUT_RAW STATUSTEXT", "NAMED_VALUE_FLOAT",
)  # fmt: skip
