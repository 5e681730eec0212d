"""A `.tlog`, the wire as a ground station or the module recorded it, as a flight.

Each frame stands behind the time at which it was recorded: microseconds since 1970 in eight
bytes, the highest first.  Frames are split by their lengths, checked and decoded kind by kind
and column by column, after pymavlink's own description of each message.
"""

from __future__ import annotations

import re
from dataclasses import replace
from math import cos, isnan
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from fastcrc.crc16 import mcrf4xx
from numpy.typing import NDArray
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.analysis.logs.clocks import OUT_OF_ORDER_S, Straightened
from tgl_soar.analysis.logs.flight_data import (
    COLUMNS,
    RATES,
    Event,
    FlightData,
    LoggedMode,
    Series,
    changes_of,
    euler,
    parameter_events,
    series,
    with_missing,
)
from tgl_soar.analysis.logs.named_values import (
    named_values,
    reported_ages,
    reported_air,
    reported_forecast,
    reported_line,
    reported_margins,
    reported_modes,
    reported_path,
    reported_series,
    reported_setpoints,
    together,
)
from tgl_soar.analysis.logs.pitot import true_airspeeds
from tgl_soar.analysis.logs.ulog_reader import LEAP_S, LogError
from tgl_soar.link.autopilots.px4 import Px4
from tgl_soar.link.frames import MARKER_V1, MARKER_V2, SIGNED
from tgl_soar.link.messages import AUTOPILOT_PX4, SENSOR_DIFFERENTIAL_PRESSURE

Floats = NDArray[np.float64]

_BEGIN: Final = re.compile(b"[\xfd\xfe]")  # of a frame
STAMP: Final = 8  # bytes of a time before each frame
_DAY_US: Final = 86_400_000_000
AUTOPILOT: Final = int(mavlink.MAV_COMP_ID_AUTOPILOT1)
EARTH_RADIUS_M: Final = 6_371_000.0
_REORDERED: Final = 200  # a step of the sequence by more is a frame that came late

_NUMPY: Final = {
    "float": "f4", "double": "f8", "char": "S1",
    "uint8_t": "u1", "int8_t": "i1", "uint16_t": "u2", "int16_t": "i2",
    "uint32_t": "u4", "int32_t": "i4", "uint64_t": "u8", "int64_t": "i8",
}  # fmt: skip


class MessageColumns(NamedTuple):
    """All frames of one message, in the order in which they were recorded."""

    time_s: Floats  # recorded at
    system: NDArray[np.uint8]
    component: NDArray[np.uint8]
    columns: dict[str, NDArray[Any]]

    def of(self, rows: NDArray[Any]) -> MessageColumns:
        """Some of them."""
        return MessageColumns(
            self.time_s[rows],
            self.system[rows],
            self.component[rows],
            {name: values[rows] for name, values in self.columns.items()},
        )


class _Frames(NamedTuple):
    stamp_us: list[int]
    system: list[int]
    component: list[int]
    sequence: list[int]
    number: list[int]  # of the message
    checked: list[bytes]  # what the checksum covers, without the extra byte
    checksum: list[bytes]
    payload: list[bytes]


class Tlog:
    """The messages of a `.tlog` by name.  Errors: `LogError` where there is not one."""

    def __init__(self, path: Path, data: bytes) -> None:
        self.lost: list[str] = []
        frames, skipped = _split(data)
        if not frames.number:
            raise LogError(f"{path}: begins like a .tlog and holds not one whole frame")
        if skipped:
            self.lost.append(f"{skipped} of {len(data)} bytes belong to no whole frame")
        good = self._good(frames)
        if not good.any():
            raise LogError(f"{path}: not one MAVLink frame with a right checksum")
        rows = np.flatnonzero(good)
        self.loss = _losses(frames, rows)
        numbers = np.array(frames.number)[rows]
        stamps = np.array(frames.stamp_us, dtype=float)[rows] * 1e-6
        senders = np.array([frames.system, frames.component], dtype=np.uint8)[:, rows]
        places: dict[str, NDArray[np.intp]] = {}  # in the order of recording
        self.kinds: dict[str, MessageColumns] = {}
        for number in np.unique(numbers).tolist():
            name = mavlink.mavlink_map[number].msgname
            places[name] = own = np.flatnonzero(numbers == number)
            columns = _decoded(number, [frames.payload[i] for i in rows[own].tolist()])
            self.kinds[name] = MessageColumns(
                stamps[own], senders[0, own], senders[1, own], columns
            )
        time_s = self._flight_time(stamps, places)
        self.kinds = {
            name: kind._replace(time_s=time_s[places[name]]) for name, kind in self.kinds.items()
        }

    def _flight_time(self, stamps: Floats, places: dict[str, NDArray[np.intp]]) -> Floats:
        """When each frame came, from the first on, in the order of recording.

        By the autopilot's own clock wherever it sent it, because a recorder's may leap, and is
        none at all where a simulation runs faster than time; else by the recorder's.
        """
        known: dict[int, float] = {}
        for name, kind in self.kinds.items():
            if "time_boot_ms" in kind.columns:
                own = (kind.component == AUTOPILOT) & (kind.columns["time_boot_ms"] > 0)
                sent = kind.columns["time_boot_ms"][own] * 1e-3
                known.update(zip(places[name][own].tolist(), sent.tolist(), strict=True))
        at = np.array(sorted(known))
        clock = np.array([known[i] for i in at.tolist()])
        steps = np.diff(clock)
        if len(at) < 10 or np.any(steps < -OUT_OF_ORDER_S) or np.any(steps > LEAP_S):
            if len(at) >= 10:
                self.lost.append("the autopilot's clock was reset: times are the recorder's")
            straight = Straightened({"recorder": stamps})
            self.lost += straight.lost
            times = np.full(len(stamps), np.nan)
            times[straight.rows["recorder"]] = straight.time_s["recorder"]
            good = np.isfinite(times)
            spread = np.interp(np.arange(len(times)), np.flatnonzero(good), times[good])
            return np.asarray(np.maximum.accumulate(spread))  # one may have come late
        times = np.interp(np.arange(len(stamps)), at, np.maximum.accumulate(clock))
        if np.any(np.diff(stamps) < -OUT_OF_ORDER_S) or np.any(np.diff(stamps) > LEAP_S):
            self.lost.append("the recorder's clock leaps: times are the autopilot's")
        return np.asarray(times - times[0])

    def _good(self, frames: _Frames) -> NDArray[np.bool_]:
        """Which frames are of a known message and whole."""
        good = np.zeros(len(frames.number), dtype=bool)
        unknown = 0
        for i, number in enumerate(frames.number):
            if number in mavlink.mavlink_map:
                good[i] = _checksum(number, frames.checked[i]) == frames.checksum[i]
            else:
                unknown += 1
        bad = len(good) - unknown - int(good.sum())
        if unknown:
            self.lost.append(f"{unknown} frames of messages that are not known here")
        if bad:
            self.lost.append(f"{bad} frames with a wrong checksum")
        return good

    def get(self, name: str, system: int, component: int = AUTOPILOT) -> MessageColumns | None:
        """A message from one sender; None where it never sent it."""
        kind = self.kinds.get(name)
        if kind is None:
            return None
        rows = (kind.system == system) & (kind.component == component)
        return kind.of(rows) if rows.any() else None


def _split(data: bytes) -> tuple[_Frames, int]:
    """The frames, and how many bytes belong to none."""
    frames = _Frames(
        stamp_us=[],
        system=[],
        component=[],
        sequence=[],
        number=[],
        checked=[],
        checksum=[],
        payload=[],
    )
    at = skipped = last_us = 0
    end = len(data)
    while at + STAMP + 8 <= end:
        head = at + STAMP
        stamp = int.from_bytes(data[at:head], "big")
        length = _frame_length(data, head)
        after = head + length
        whole = length and after <= end
        if whole and after < end and not _begins(data, after + STAMP):
            whole = _is_right(data, head)  # the last before damage
        if whole and last_us and abs(stamp - last_us) > 4000 * _DAY_US:
            whole = _is_right(data, head)  # a recorder's clock may be set in flight
        if not whole:
            begin = _BEGIN.search(data, head + 1)
            following = end if begin is None else begin.start() - STAMP
            skipped += following - at
            at = following
            continue
        last_us = stamp
        size = data[head + 1]
        number, body = _number_and_body(data, head)
        place = head + (4 if data[head] == MARKER_V2 else 2)
        sequence, system, component = data[place : place + 3]
        frames.stamp_us.append(stamp)
        frames.system.append(system)
        frames.component.append(component)
        frames.sequence.append(sequence)
        frames.number.append(number)
        frames.checked.append(data[head + 1 : body + size])
        frames.checksum.append(data[body + size : body + size + 2])
        frames.payload.append(data[body : body + size])
        at = after
    return frames, skipped + (end - at)


def _number_and_body(data: bytes, head: int) -> tuple[int, int]:
    """Of the frame that begins at a place: its message's number, and where its payload begins."""
    if data[head] == MARKER_V2:
        return int.from_bytes(data[head + 7 : head + 10], "little"), head + 10
    return data[head + 5], head + 6


def _is_right(data: bytes, head: int) -> bool:
    """Whether the frame that begins at a place is of a known message and its checksum right."""
    number, body = _number_and_body(data, head)
    if number not in mavlink.mavlink_map:
        return False
    end = body + data[head + 1]
    return _checksum(number, data[head + 1 : end]) == data[end : end + 2]


def _checksum(number: int, covered: bytes) -> bytes:
    """Of a frame, from its length on, with the extra byte of its message behind it."""
    crc: int = mcrf4xx(covered + bytes([mavlink.mavlink_map[number].crc_extra]))
    return crc.to_bytes(2, "little")


def _frame_length(data: bytes, head: int) -> int:
    """Of the frame at a place; 0: none begins there."""
    if data[head] == MARKER_V2:
        return data[head + 1] + 12 + 13 * (data[head + 2] & SIGNED)
    return data[head + 1] + 8 if data[head] == MARKER_V1 else 0


def _begins(data: bytes, head: int) -> bool:
    """Whether a frame may begin at a place, or the file ends before it."""
    return head >= len(data) or data[head] in (MARKER_V1, MARKER_V2)


def _decoded(number: int, payloads: list[bytes]) -> dict[str, NDArray[Any]]:
    """The fields of many frames of a message; texts as bytes, arrays of shape (n, length)."""
    message = mavlink.mavlink_map[number]
    kinds = dict(zip(message.fieldnames, message.fieldtypes, strict=True))
    lengths = dict(zip(message.ordered_fieldnames, message.array_lengths, strict=True))
    fields: list[Any] = []
    for name in message.ordered_fieldnames:
        code, count = _NUMPY[kinds[name]], lengths[name]
        if code == "S1":
            fields.append((name, f"S{max(1, count)}"))
        elif count:
            fields.append((name, f"<{code}", (count,)))
        else:
            fields.append((name, f"<{code}"))
    layout = np.dtype(fields)
    # Trailing zeros are not sent, and a newer sender may say more than is known here.
    table = b"".join([p[: layout.itemsize].ljust(layout.itemsize, b"\0") for p in payloads])
    rows = np.frombuffer(table, dtype=layout)
    return {name: rows[name] for name in message.ordered_fieldnames}


def _losses(frames: _Frames, rows: NDArray[np.intp]) -> dict[str, tuple[int, int]]:
    """Frames that arrived and that did not, of each sender, by the gaps in its numbering."""
    found = {}
    senders = np.array(frames.system)[rows] * 256 + np.array(frames.component)[rows]
    sequences = np.array(frames.sequence)[rows]
    for sender in np.unique(senders).tolist():
        own = sequences[senders == sender]
        steps = np.diff(own) % 256
        lost = int(np.sum((steps - 1)[(steps > 0) & (steps < _REORDERED)]))
        found[f"system {sender // 256}, component {sender % 256}"] = (len(own), lost)
    return found


# --- the flight in it -----------------------------------------------------------------------


def read_tlog(name: str, log: Tlog) -> FlightData:
    """A flight that was recorded on the wire."""
    system = _vehicle(log)
    named = log.kinds.get("NAMED_VALUE_FLOAT")
    reported = (
        {}
        if named is None
        else named_values(named.time_s, named.columns["name"], named.columns["value"])
    )
    position, absolute = _position(log, system)
    flight = FlightData(
        name=name,
        kind="MAVLink telemetry log (.tlog)",
        position=position,
        velocity=_velocity(log, system),
        attitude=_attitude(log, system),
        airspeed=_airspeed(log, system),
        rates=_rates(log, system),
        imu=_imu(log, system),
        path=reported_path(reported),
        outputs=_outputs(log, system),
        setpoints=reported_setpoints(reported),
        tracking=reported_series(reported, "e_rho", "e_rho_m"),
        line=reported_line(reported),
        air=reported_air(reported),
        ages=reported_ages(reported),
        margins=reported_margins(reported),
        forecast=reported_forecast(reported),
        point=together(reported, {"standing": "pt_state", "off_m": "pt_off", "brake": "brake"}),
        modes=reported_modes(reported),
        autopilot_modes=_autopilot_modes(log, system),
        streams={kind: rows.time_s for kind, rows in log.kinds.items()},
        loss=log.loss,
        absolute_positions=absolute,
        lost=tuple(log.lost),
    )
    first, changes = _parameters(log, system)
    events = [*_texts(log), *parameter_events(first, changes)]
    notes = (
        () if absolute else ("positions are measured from the first fix: no local frame is given",)
    )
    wanted = ("position", "attitude", "airspeed", "setpoints", "tracking", "line", "air")
    flight = replace(flight, events=tuple(sorted(events)), parameters=first, missing=notes)
    return with_missing(flight, wanted)


def _vehicle(log: Tlog) -> int:
    """The system whose autopilot is received most."""
    beats = log.kinds.get("HEARTBEAT")
    if beats is None:
        every = np.concatenate([kind.system for kind in log.kinds.values()])
    else:
        pilots = beats.columns["autopilot"] != mavlink.MAV_AUTOPILOT_INVALID
        every = beats.system[pilots] if pilots.any() else beats.system
    return int(np.bincount(every).argmax())


def _from(kind: MessageColumns | None, source: str, **columns: str) -> Series | None:
    if kind is None:
        return None
    return series(kind.time_s, source, **{k: kind.columns[v] for k, v in columns.items()})


def _position(log: Tlog, system: int) -> tuple[Series | None, bool]:
    """In local NED, and whether its origin is the autopilot's own."""
    local = _from(
        log.get("LOCAL_POSITION_NED", system),
        "LOCAL_POSITION_NED",
        north_m="x",
        east_m="y",
        down_m="z",
    )
    if local is not None:
        return local, True
    kind = log.get("GLOBAL_POSITION_INT", system)
    if kind is None:
        return None, True
    lat, lon = (np.radians(kind.columns[c] * 1e-7) for c in ("lat", "lon"))
    height = kind.columns["alt"] * 1e-3
    origin = log.get("GPS_GLOBAL_ORIGIN", system)
    lat0, lon0, height0 = lat[0], lon[0], height[0]
    if origin is not None:
        lat0, lon0 = (np.radians(origin.columns[c][-1] * 1e-7) for c in ("latitude", "longitude"))
        height0 = origin.columns["altitude"][-1] * 1e-3
    found = series(
        kind.time_s,
        "GLOBAL_POSITION_INT",
        north_m=EARTH_RADIUS_M * (lat - lat0),
        east_m=EARTH_RADIUS_M * cos(lat0) * (lon - lon0),
        down_m=height0 - height,
    )
    return found, origin is not None


def _velocity(log: Tlog, system: int) -> Series | None:
    names = ("north_mps", "east_mps", "down_mps")
    local = log.get("LOCAL_POSITION_NED", system)
    if local is not None:
        return _from(
            local, "LOCAL_POSITION_NED", **dict(zip(names, ("vx", "vy", "vz"), strict=True))
        )
    kind = log.get("GLOBAL_POSITION_INT", system)
    if kind is None:
        return None
    columns = {
        name: kind.columns[c] * 0.01 for name, c in zip(names, ("vx", "vy", "vz"), strict=True)
    }
    return series(kind.time_s, "GLOBAL_POSITION_INT", **columns)


def _turned(log: Tlog, system: int) -> tuple[str, MessageColumns | None]:
    """The message that tells the attitude, or tells it oftener."""
    turned, angles = (log.get(name, system) for name in ("ATTITUDE_QUATERNION", "ATTITUDE"))
    if turned is not None and (angles is None or len(turned.time_s) >= len(angles.time_s)):
        return "ATTITUDE_QUATERNION", turned
    return "ATTITUDE", angles


def _attitude(log: Tlog, system: int) -> Series | None:
    source, kind = _turned(log, system)
    if kind is None or source == "ATTITUDE":
        return _from(kind, source, roll_rad="roll", pitch_rad="pitch", yaw_rad="yaw")
    roll, pitch, yaw = euler(*(kind.columns[f"q{i}"].astype(float) for i in range(1, 5)))
    return series(kind.time_s, source, roll_rad=roll, pitch_rad=pitch, yaw_rad=yaw)


def _airspeed(log: Tlog, system: int) -> Series | None:
    """True airspeed, NaN while no pitot tube is known to be in good health: then VFR_HUD shows an
    estimate.  None where there never is one."""
    hud, status = log.get("VFR_HUD", system), log.get("SYS_STATUS", system)
    if hud is None or status is None:
        return None
    sensors = status.columns["onboard_control_sensors_present"]
    sensors = sensors & status.columns["onboard_control_sensors_health"]
    healthy = (sensors & SENSOR_DIFFERENTIAL_PRESSURE != 0).astype(float)
    health = Series(status.time_s, {"healthy": healthy}, "SYS_STATUS")
    measured = health.last_at("healthy", hud.time_s) > 0.0
    if not measured.any():
        return None
    shown = np.where(measured, hud.columns["airspeed"].astype(float), np.nan)
    true_mps = true_airspeeds(shown, hud.columns["alt"].astype(float))
    return series(hud.time_s, "VFR_HUD", airspeed_mps=true_mps)


def _rates(log: Tlog, system: int) -> Series | None:
    source, kind = _turned(log, system)
    speeds = ("rollspeed", "pitchspeed", "yawspeed")
    return _from(kind, source, **dict(zip(RATES, speeds, strict=True)))


def _imu(log: Tlog, system: int) -> Series | None:
    names = COLUMNS["imu"]
    fine = log.get("HIGHRES_IMU", system)
    if fine is not None:
        fields = ("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro")
        return _from(fine, "HIGHRES_IMU", **dict(zip(names, fields, strict=True)))
    for source in ("SCALED_IMU", "RAW_IMU"):
        kind = log.get(source, system)
        if kind is not None:  # milli-g and mrad/s
            scales = (9.80665e-3,) * 3 + (1e-3,) * 3
            fields = ("xacc", "yacc", "zacc", "xgyro", "ygyro", "zgyro")
            columns = {
                name: kind.columns[c] * scale
                for name, c, scale in zip(names, fields, scales, strict=True)
            }
            return series(kind.time_s, source, **columns)
    return None


def _outputs(log: Tlog, system: int) -> Series | None:
    kind = log.get("SERVO_OUTPUT_RAW", system)
    if kind is None:
        return None
    kind = kind.of(kind.columns["port"] == 0)  # a second port has outputs of its own, from 1 again
    columns = {str(i): kind.columns[f"servo{i}_raw"].astype(float) for i in range(1, 17)}
    used = {name: values for name, values in columns.items() if np.any(values > 0.0)}
    return series(kind.time_s, "SERVO_OUTPUT_RAW", **used)


def _autopilot_modes(log: Tlog, system: int) -> tuple[LoggedMode, ...]:
    beats = log.get("HEARTBEAT", system)
    if beats is None:
        return ()
    names: dict[tuple[int, int, int], str] = {}
    words = []
    columns = (beats.columns[c].tolist() for c in ("autopilot", "type", "custom_mode", "base_mode"))
    for autopilot, kind, custom, base in zip(*columns, strict=True):
        key = (autopilot, kind, custom)
        if key not in names:
            beat = mavlink.MAVLink_heartbeat_message(kind, autopilot, base, custom, 0, 3)
            names[key] = str(mavutil.mode_string_v10(beat))
        words.append(names[key])
    return changes_of(beats.time_s, words)


def _texts(log: Tlog) -> list[Event]:
    kind = log.kinds.get("STATUSTEXT")
    if kind is None:
        return []
    texts = [text.decode("utf-8", "replace").strip("\0 ") for text in kind.columns["text"].tolist()]
    return [Event(t, "message", text) for t, text in zip(kind.time_s.tolist(), texts, strict=True)]


def _parameters(log: Tlog, system: int) -> tuple[dict[str, float], list[tuple[float, str, float]]]:
    """Each parameter of the vehicle as it was first reported, and every change.

    NaN is no value; other systems' parameters are left out.
    """
    kind = log.kinds.get("PARAM_VALUE")
    if kind is None:
        return {}, []
    kind = kind.of(kind.system == system)
    bytewise = _is_px4(log, system)
    first: dict[str, float] = {}
    changes = []
    names = (n.decode("ascii", "replace").strip("\0") for n in kind.columns["param_id"].tolist())
    values = kind.columns["param_value"].tolist()
    types, senders = kind.columns["param_type"].tolist(), kind.component.tolist()
    rows = zip(kind.time_s.tolist(), names, values, types, senders, strict=True)
    for t, name, sent, param_type, sender in rows:
        value = sent
        if bytewise and sender == AUTOPILOT:
            value = Px4.codec.number(sent, param_type)
        if isnan(value):
            continue
        if name in first:
            changes.append((t, name, value))
        else:
            first[name] = value
    return first, changes


def _is_px4(log: Tlog, system: int) -> bool:
    """Whether the vehicle's autopilot says so: PX4 sends whole numbers as their four bytes."""
    beats = log.get("HEARTBEAT", system)
    return beats is not None and bool((beats.columns["autopilot"] == AUTOPILOT_PX4).any())
