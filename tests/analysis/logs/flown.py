"""One simulated flight, and the logs that four different writers would have made of it.

The ULog of PX4 and the DataFlash log of ArduPilot are written here by the letter of their
formats, not by what reads them:
    https://docs.px4.io/main/en/dev_log/ulog_file_format.html
    https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Sequence
from functools import lru_cache
from math import degrees
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.autopilot import (
    AutopilotState,
    Output,
    initial_state,
    step,
)
from tgl_soar.config.files import (
    line_parameters,
    load_airframe,
    load_parameters,
    load_site,
    shipped,
)
from tgl_soar.config.parameters import ParameterSet
from tgl_soar.control.laws import laws_from
from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.onboard.flightlog.topics import VERSION
from tgl_soar.onboard.flightlog.ulog_messages import LogMetadata
from tgl_soar.onboard.flightlog.writer import FlightRecorder
from tgl_soar.onboard.telemetry_values import FAST, fast_value
from tgl_soar.sim.world import Truth, make_world
from tgl_soar.types import AutopilotStatus, Inputs, SurfaceCommand

AIRFRAME = shipped("airframes/eclipson_c.toml")
SITE = shipped("sites/tunnel.toml")
ENGAGED_S = 0.3
LEG_S = 15.0  # on each of the site's lines a and b
UNIX_US = 1_790_000_000_000_000  # when the flight began
AT_REST = (0.0, 0.0, -9.81)  # specific force of an aircraft that hovers [m/s²]
BOOT_S = 20.0  # how long the autopilot had been on by then


class Reported(Protocol):
    """What the logs of other autopilots hold of a tick."""

    @property
    def inputs(self) -> Inputs: ...
    @property
    def output(self) -> Output: ...
    @property
    def truth(self) -> Truth: ...


class Tick(NamedTuple):
    """One tick of the flight, and the truth behind it."""

    inputs: Inputs
    output: Output
    state: AutopilotState
    values: ParameterSet
    truth: Truth


@lru_cache(maxsize=1)
def flight() -> tuple[Tick, ...]:
    """Two legs in the tunnel, at 2 % turbulence."""
    airframe, site = load_airframe(AIRFRAME), load_site(SITE)
    values = load_parameters(airframe, AIRFRAME, site, SITE)
    world = make_world(airframe, site, seed=3, turbulence=0.02)
    world.held = True
    state = initial_state()
    command = SurfaceCommand(world.trim.elevator, 0.0, 0.0)
    ticks = []
    for k in range(round(2.0 * LEG_S * world.step_hz)):
        now = world.time_s
        if k == round(LEG_S * world.step_hz):
            values = values.changed(line_parameters(site.lines["b"]), flying=True)
        inputs = Inputs(
            time_s=now,
            position=world.position,
            attitude=world.attitude,
            autopilot=AutopilotStatus(time_s=now, accepts_surfaces=True, armed=True),
            engage=now >= ENGAGED_S,
            imu=world.imu,
            airspeed=world.airspeed,
            surfaces=world.surfaces,
        )
        truth = world.truth
        state, output = step(laws_from(values, world.frame), state, inputs)
        if output.active:
            command = output.command
            world.held = False
        world.step(command)
        ticks.append(Tick(inputs=inputs, output=output, state=state, values=values, truth=truth))
    return tuple(ticks)


# --- ours -----------------------------------------------------------------------------------


def our_parts(folder: Path, largest_bytes: int = 1_000_000_000) -> list[Path]:
    """The module's own log, in as many parts as its largest size makes of it."""
    metadata = LogMetadata(
        {
            "sys_name": "tgl_soar",
            "ver_log": str(VERSION),
            "ver_sw": "0.1.0",
            "site_file": str(SITE),
        },
        {"airframe": AIRFRAME.read_text(), "site": SITE.read_text()},
    )
    recorder = FlightRecorder(folder, metadata, 0.0, patient=True, largest_bytes=largest_bytes)
    recorder.start()
    values = None
    for tick in flight():
        if tick.values != values:
            values = tick.values
            recorder.parameters(values)
            if tick.inputs.time_s == 0.0:
                recorder.reset(initial_state())
        recorder.tick(tick.inputs, tick.output, tick.state)
        recorder.poll()
    recorder.text(4, "the end")
    recorder.stop()
    return sorted(folder.rglob("*.ulg"), key=lambda path: (len(path.name), path.name))


def our_log(folder: Path) -> Path:
    """The module's own log."""
    path = folder / "ours.ulg"
    if not _whole:
        _whole.append(our_parts(folder / "written")[0].read_bytes())
    path.write_bytes(_whole[0])
    return path


_whole: list[bytes] = []  # that log, once written


# --- PX4 ------------------------------------------------------------------------------------

_SIZES = {"uint64_t": "Q", "float": "f", "uint8_t": "B", "bool": "?"}
PX4: dict[str, str] = {
    "vehicle_attitude": "uint64_t timestamp;float[4] q;",
    "vehicle_local_position": "uint64_t timestamp;float x;float y;float z;float vx;float vy;"
    "float vz;bool xy_valid;",
    "airspeed_validated": "uint64_t timestamp;float true_airspeed_m_s;",
    "sensor_combined": "uint64_t timestamp;float[3] gyro_rad;float[3] accelerometer_m_s2;",
    "vehicle_torque_setpoint": "uint64_t timestamp;float[3] xyz;",
    "vehicle_attitude_setpoint": "uint64_t timestamp;float roll_body;float pitch_body;",
    "vehicle_status": "uint64_t timestamp;uint8_t nav_state;bool failsafe;",
}


def ulog_message(kind: str, body: bytes) -> bytes:
    """One message of a ULog."""
    return struct.pack("<HB", len(body), ord(kind)) + body


def px4_log(
    folder: Path,
    leave_out: Sequence[str] = (),
    jump_us: int = 0,
    version: int = 1,
    ticks: Sequence[Reported] = (),
    moved_every: int = 8,
) -> Path:
    """PX4's log; jump_us: the clock is set so much further in the middle of the flight.

    ticks: of another flight; moved_every: ticks from one message of the surfaces to the next.
    """
    ticks = ticks or flight()
    parts = [b"ULog\x01\x12\x35" + struct.pack("<BQ", version, round(BOOT_S * 1e6))]
    parts.append(ulog_message("B", bytes(40)))
    parts.append(ulog_message("I", b"\x10char[3] sys_namePX4"))
    kept = [name for name in PX4 if name not in leave_out]
    parts += [ulog_message("F", f"{name}:{PX4[name]}".encode()) for name in kept]
    parts.append(ulog_message("P", b"\x14float FW_AIRSPD_TRIM" + struct.pack("<f", 8.5)))
    for number, name in enumerate(kept):
        parts.append(ulog_message("A", struct.pack("<BH", 0, number) + name.encode()))
    layouts = {name: _layout(PX4[name]) for name in kept}
    for k, tick in enumerate(ticks):
        us = round((BOOT_S + tick.inputs.time_s) * 1e6) + (jump_us if k > len(ticks) // 2 else 0)
        for name, numbers in _px4_rows(k, tick, moved_every):
            if name in kept:
                row = struct.pack(layouts[name], us, *numbers)
                parts.append(ulog_message("D", struct.pack("<H", kept.index(name)) + row))
        if k == 400:
            parts.append(ulog_message("L", b"4" + struct.pack("<Q", us) + b"Stall warning"))
            change = b"\x14float FW_AIRSPD_TRIM" + struct.pack("<f", 9.0)
            parts.append(ulog_message("P", change))
    path = folder / "px4.ulg"
    path.write_bytes(b"".join(parts))
    return path


def _layout(fields: str) -> str:
    found = "<"
    for field in fields.rstrip(";").split(";"):
        kind, _, count = field.split()[0].rstrip("]").partition("[")
        found += f"{count}{_SIZES[kind]}"
    return found


def _px4_rows(k: int, tick: Reported, moved_every: int) -> Iterable[tuple[str, tuple[Any, ...]]]:
    fix = tick.inputs.position
    yield "vehicle_attitude", tick.inputs.attitude[2:6]
    if k % 4 == 0 and fix.sequence:
        yield "vehicle_local_position", (*fix[2:8], True)
    if k % 8 == 0:
        yield "airspeed_validated", (tick.truth.airspeed_mps,)
        yield "vehicle_attitude_setpoint", (0.0, tick.output.setpoints.pitch_rad)
    if k % moved_every == 0:
        moved = _moved(tick)
        yield "vehicle_torque_setpoint", (moved.aileron, moved.elevator, moved.rudder)
    yield "sensor_combined", (*tick.inputs.attitude[6:9], *_force(tick))
    if k % 100 == 0:
        yield "vehicle_status", (0 if tick.inputs.time_s < 1.0 else 14, False)


# --- ArduPilot ------------------------------------------------------------------------------

# Name: number, letters of the fields, their names.
_DATAFLASH: dict[str, tuple[int, str, str]] = {
    "PARM": (129, "QNff", "TimeUS,Name,Value,Default"),
    "MSG": (130, "QZ", "TimeUS,Message"),
    "MODE": (131, "QMBB", "TimeUS,Mode,ModeNum,Rsn"),
    "ATT": (132, "Qccccff", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw"),
    "XKF1": (133, "QBffffff", "TimeUS,C,VN,VE,VD,PN,PE,PD"),
    "ARSP": (134, "QBf", "TimeUS,I,Airspeed"),
    "IMU": (135, "QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"),
    "RCOU": (136, "QHHHH", "TimeUS,C1,C2,C3,C4"),
}
_LETTERS = {"Q": "Q", "N": "16s", "f": "f", "Z": "64s", "M": "B", "B": "B", "c": "h", "H": "H"}


def dataflash_log(
    folder: Path,
    leave_out: Sequence[str] = (),
    jump_us: int = 0,
    ticks: Sequence[Reported] = (),
    moved_every: int = 4,
) -> Path:
    """ArduPlane's log; jump_us, ticks and moved_every as of PX4's."""
    ticks = ticks or flight()
    kept = {name: kind for name, kind in _DATAFLASH.items() if name not in leave_out}
    own = _format_record(0x80, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")
    parts = [own]
    layouts = {}
    for name, (number, letters, columns) in kept.items():
        layouts[name] = "<" + "".join(_LETTERS[letter] for letter in letters)
        length = 3 + struct.calcsize(layouts[name])
        parts.append(_format_record(number, length, name, letters, columns))
    for k, tick in enumerate(ticks):
        us = round((BOOT_S + tick.inputs.time_s) * 1e6) + (jump_us if k > len(ticks) // 2 else 0)
        for name, numbers in _dataflash_rows(k, tick, moved_every):
            if name in kept:
                row = struct.pack(layouts[name], us, *numbers)
                parts.append(b"\xa3\x95" + bytes([kept[name][0]]) + row)
    path = folder / "ardupilot.bin"
    path.write_bytes(b"".join(parts))
    return path


def _format_record(number: int, length: int, name: str, letters: str, columns: str) -> bytes:
    words = (name.encode(), letters.encode(), columns.encode())
    return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, length, *words)


def _dataflash_rows(
    k: int, tick: Reported, moved_every: int
) -> Iterable[tuple[str, tuple[Any, ...]]]:
    if k == 0:
        yield "MSG", (b"ArduPlane V4.5.7 (0358a9c2)",)
        yield "PARM", (b"AIRSPEED_CRUISE", 8.5, 8.5)
        yield "MODE", (0, 0, 1)
    if k == 400:
        yield "PARM", (b"AIRSPEED_CRUISE", 9.0, 8.5)
        yield "MODE", (5, 5, 2)
    angles = [degrees(a) for a in euler_from_quaternion(*tick.inputs.attitude[2:6])]
    setpoint = tick.output.setpoints.pitch_rad
    wanted = 0.0 if setpoint != setpoint else degrees(setpoint)
    if k % 4 == 0 and tick.inputs.attitude.sequence:
        roll, pitch = round(100 * angles[0]), round(100 * angles[1])
        yield "ATT", (0, roll, round(100 * wanted), pitch, 0.0, angles[2] % 360.0)
    fix = tick.inputs.position
    if k % 8 == 0 and fix.sequence:
        velocity, place = fix[5:8], fix[2:5]
        for core in (0, 1):  # the second is worse, and is not to be taken
            yield "XKF1", (core, *velocity, *(p + 5.0 * core for p in place))
    if k % 20 == 0:
        yield "ARSP", (0, tick.truth.airspeed_mps)
    if k % 4 == 0:
        yield "IMU", (0, *tick.inputs.attitude[6:9], *_force(tick))
    if k % moved_every == 0:
        yield "RCOU", _pulses(_moved(tick))


def _moved(tick: Reported) -> SurfaceCommand:
    """The surfaces' commands: by the pilot, where that is read back, else by the module."""
    sample = tick.inputs.surfaces
    if not sample.sequence:
        return tick.output.command
    return SurfaceCommand(sample.elevator, sample.aileron, sample.rudder)


def _force(tick: Reported) -> tuple[float, ...]:
    imu = tick.inputs.imu
    return imu[2:5] if imu.sequence else AT_REST


def _pulses(command: SurfaceCommand) -> tuple[int, ...]:
    """Channels 1 to 4."""
    wanted = (command.aileron, command.elevator, 0.0, command.rudder)
    return tuple(round(1500 + 400 * deflection) for deflection in wanted)


# --- the wire -------------------------------------------------------------------------------


def tlog(
    folder: Path,
    leave_out: Sequence[str] = (),
    recorder_jump_us: int = 0,
    ticks: Sequence[Reported] = (),
    moved_every: int = 20,
) -> Path:
    """What a ground station records; recorder_jump_us: its clock is set in the middle.

    ticks and moved_every as of PX4's log.
    """
    ticks = ticks or flight()
    vehicle, module = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None, 1, 191)
    parts = []
    for k, tick in enumerate(ticks):
        us = UNIX_US + round(tick.inputs.time_s * 1e6)
        us += recorder_jump_us if k > len(ticks) // 2 else 0
        for sender, message in _frames(k, tick, moved_every):
            if message.get_type() in leave_out:
                continue
            packed = message.pack(module if sender else vehicle)
            link = module if sender else vehicle
            link.seq = (link.seq + 1) % 256
            parts.append(us.to_bytes(8, "big") + bytes(packed))
    path = folder / "station.tlog"
    path.write_bytes(b"".join(parts))
    return path


def _frames(k: int, tick: Reported, moved_every: int) -> Iterable[tuple[int, Any]]:
    ms = round(1e3 * (BOOT_S + tick.inputs.time_s))
    fix, attitude = tick.inputs.position, tick.inputs.attitude
    if k % 200 == 0:
        yield 0, mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3)
        yield 1, mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)
        pitot = mavlink.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE
        yield 0, mavlink.MAVLink_sys_status_message(pitot, pitot, pitot, *([0] * 10))
    if k == 400:
        yield 1, mavlink.MAVLink_statustext_message(4, b"soaring: on the line")
        for value in (0.2, 0.6):
            yield 1, mavlink.MAVLink_param_value_message(b"TGL_X", value, 9, 50, 3)
    if k % 2 == 0 and attitude.sequence:
        yield 0, mavlink.MAVLink_attitude_quaternion_message(ms, *attitude[2:9])
    if k % 4 == 0 and fix.sequence:
        yield 0, mavlink.MAVLink_local_position_ned_message(ms, *fix[2:8])
        lat, lon = round(1e7 * (52.0 + degrees(fix.north_m / 6_371_000.0))), round(4e7)
        yield (
            0,
            mavlink.MAVLink_global_position_int_message(
                ms, lat, lon, round(-1e3 * fix.down_m), 0, 0, 0, 0, 0
            ),
        )
        yield 0, mavlink.MAVLink_vfr_hud_message(tick.truth.airspeed_mps, 0, 0, 0, 0, 0)
    if k % moved_every == 0:
        pulses = (*_pulses(_moved(tick)), 0, 0, 0, 0)
        yield 0, mavlink.MAVLink_servo_output_raw_message(ms * 1000, 0, *pulses)
    if k % 8 == 0:
        turn = (k // 8) % len(FAST)
        value = fast_value(tick.output, turn)
        yield 1, mavlink.MAVLink_named_value_float_message(ms, FAST[turn].encode(), value)
