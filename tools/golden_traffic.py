#!/usr/bin/env python3
"""A conversation with an autopilot, kept as test data: what it accepts, refuses and lets time out.

    python tools/golden_traffic.py --firmware .../bin/arduplane \\
        --out tests/sim/vehicle/golden/arduplane-4.6.3.jsonl

A companion (1, 191) and a ground station (255, 190) on one link ask and command an ArduPlane that
is held over the hill, by the script below.  Each line of the file is one message, with the time
since the script began [s]; `from` is the sender's identity.
tests/sim/vehicle/test_golden_traffic.py sends the same to the simulated Pixhawk and compares what
it answers.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import load_airframe, load_site, shipped
from tgl_soar.sim.firmware import ardupilot
from tgl_soar.sim.firmware.simulation import FirmwareSimulation
from tgl_soar.sim.simulation import Options

LINK: Final = 1
BOOT_S: Final = 60.0
COMPANION: Final = (1, 191)
STATION: Final = (255, 190)
RATES_S: Final = (6.3, 7.9)  # streams are counted between
KEPT: Final[dict[str, tuple[str, ...]]] = {  # of the autopilot, and which fields
    "COMMAND_ACK": ("command", "result", "target_system", "target_component"),
    "PARAM_VALUE": ("param_id", "param_value", "param_type", "param_index"),
    "MESSAGE_INTERVAL": ("message_id", "interval_us"),
    "AUTOPILOT_VERSION": ("flight_sw_version",),
    "HEARTBEAT": ("type", "autopilot", "base_mode", "custom_mode", "system_status"),
    "SERVO_OUTPUT_RAW": ("servo1_raw", "servo2_raw", "servo4_raw"),
}
STREAMS: Final = frozenset({"SERVO_OUTPUT_RAW", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED"})
LEAVE: Final = 65535
Outbound = tuple[float, tuple[int, int], Any]


def _command(number: int, one: float = 0.0, two: float = 0.0, *, system: int = 1) -> Any:
    return mavlink.MAVLink_command_long_message(
        system, 1, number, 0, one, two, 0.0, 0.0, 0.0, 0.0, 0.0
    )


def _interval(message_id: int, rate_hz: float) -> Any:
    return _command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 1e6 / rate_hz)


def _read(name: str, component: int = 1) -> Any:
    return mavlink.MAVLink_param_request_read_message(1, component, name.encode(), -1)


def _set(name: str, value: float) -> Any:
    return mavlink.MAVLink_param_set_message(
        1, 1, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32
    )


def _override(aileron: int, elevator: int, rudder: int) -> Any:
    return mavlink.MAVLink_rc_channels_override_message(
        1, 1, aileron, elevator, LEAVE, rudder, LEAVE, LEAVE, LEAVE, LEAVE
    )


def script() -> list[Outbound]:
    """Who says what and when [s]."""
    outbound: list[Outbound] = []
    beat = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)
    outbound += [(float(second), COMPANION, beat) for second in range(16)]
    asked: list[Any] = [
        _read("SYSID_MYGCS"),
        _read("RC_OVERRIDE_TIME"),
        _read("NO_SUCH_NAME"),
        _set("RC_OVERRIDE_TIME", 0.5),
        _set("NO_SUCH_NAME", 1.0),
        _interval(mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, 100),
        _interval(mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, 200),
        _interval(mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 50),
        _interval(mavlink.MAVLINK_MSG_ID_ATTITUDE, 390),  # more than 0.8 of the loop's 400
        _interval(mavlink.MAVLINK_MSG_ID_ODOMETRY, 50),
        _interval(mavlink.MAVLINK_MSG_ID_WIND_COV, 10),
        _interval(9999, 10),
        _command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW),
        _command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
        _command(mavlink.MAV_CMD_REQUEST_MESSAGE, 9999),
        _command(mavlink.MAV_CMD_DO_SET_MODE, 1, 99),
        _command(mavlink.MAV_CMD_DO_SET_MODE, 1, 5),
        _command(mavlink.MAV_CMD_DO_SET_MODE, 1, 0),
        _command(mavlink.MAV_CMD_DO_SET_MODE, 0, 5),  # not marked as its own mode
        _command(31999),
        _command(511, mavlink.MAVLINK_MSG_ID_RC_CHANNELS, 1e5, system=77),  # somebody else
    ]
    outbound += [(1.05 + 0.25 * i, COMPANION, message) for i, message in enumerate(asked)]
    # Pulses from 8 s on, ten milliseconds apart, first of a sender whom it does not obey.
    phases: tuple[tuple[float, float, tuple[int, int], tuple[int, int, int]], ...] = (
        (8.0, 8.5, COMPANION, (1700, 1700, 1700)),
        (9.0, 9.5, STATION, (1700, 1300, 1600)),
        (9.5, 10.0, STATION, (1100, 1900, LEAVE)),  # the rudder stands
        (10.0, 10.5, STATION, (0, 1800, 1600)),  # the aileron is released
        (10.5, 11.0, STATION, (2100, 900, 1500)),  # beyond the ends
        (12.5, 13.0, STATION, (1650, 1450, 1550)),  # after a time-out, again
        (13.0, 13.02, STATION, (0, 0, 0)),  # all released
    )
    for begin, end, sender, pulses in phases:
        times = [begin + 0.01 * i for i in range(round((end - begin) / 0.01))]
        outbound += [(round(t, 3), sender, _override(*pulses)) for t in times]
    return sorted(outbound, key=lambda each: each[0])


class Record:
    """What is kept of a conversation: answers, outputs when they change, rates of the streams."""

    def __init__(self) -> None:
        self.lines: list[dict[str, Any]] = []
        self._streamed = dict.fromkeys(sorted(STREAMS), 0)
        self._last: dict[str, Any] = {}

    def outbound(self, time_s: float, who: tuple[int, int], message: Any) -> None:
        """By us."""
        values = message.to_dict()
        name = values.pop("mavpackettype")
        kept = {n: v for n, v in values.items() if v or n.startswith("target")}
        self.lines.append({"t": time_s, "from": list(who), "name": name, **kept})

    def received(self, time_s: float, message: Any) -> None:
        """Of the autopilot."""
        name = message.get_type()
        if message.get_srcComponent() != 1:
            return  # passed on by it
        if name in STREAMS and RATES_S[0] <= time_s < RATES_S[1]:
            self._streamed[name] += 1
        if name not in KEPT or str(getattr(message, "param_id", "")).startswith("STAT_"):
            return
        line = {"name": name, **{field: getattr(message, field) for field in KEPT[name]}}
        if name == "SERVO_OUTPUT_RAW" and line == self._last:
            return
        if name == "SERVO_OUTPUT_RAW":
            self._last = line
        self.lines.append({"t": round(time_s, 4), "from": [1, 1], **line})

    def text(self) -> str:
        """One line for each."""
        span_s = RATES_S[1] - RATES_S[0]
        rates = {name: round(n / span_s, 1) for name, n in self._streamed.items()}
        lines = [*self.lines, {"rates_hz": rates}]
        return "".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines)


def record(program: Path, folder: Path) -> Record:
    """The whole conversation."""
    plane = load_airframe(shipped("airframes/eclipson_c.toml"))
    path = shipped("sites/hill.toml")
    site = load_site(path)
    physics, relay = ardupilot.start(program, folder, plane, site, {"RC_OVERRIDE_TIME": 3.0})
    simulation = FirmwareSimulation(plane, site, Options(truth=False), path.parent, physics, relay)
    simulation.add_link(LINK, ground=False)
    kept = Record()
    codecs = {who: mavlink.MAVLink(None, *who) for who in (COMPANION, STATION)}
    listening: Any = mavlink.MAVLink(None)
    listening.robust_parsing = True
    waiting = script()
    begun_s: float | None = None
    try:
        while waiting:
            simulation.world.held = True
            simulation.step()
            now_s = simulation.time_s
            for _, data in simulation.take_datagrams([LINK]):
                for message in listening.parse_buffer(bytearray(data)) or ():
                    if begun_s is not None:
                        kept.received(now_s - begun_s, message)
            if begun_s is None:
                if now_s > BOOT_S:
                    raise SystemExit(f"not armed within {BOOT_S:g} s")
                begun_s = now_s if relay.armed else None
                continue
            while waiting and waiting[0][0] <= now_s - begun_s:
                at_s, who, message = waiting.pop(0)
                simulation.receive(LINK, bytes(message.pack(codecs[who])))
                codecs[who].seq = (codecs[who].seq + 1) % 256
                kept.outbound(at_s, who, message)
    finally:
        simulation.close()
    return kept


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--firmware", type=Path, required=True, help="ArduPlane's program")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        kept = record(arguments.firmware, Path(folder) / "firmware")
    arguments.out.write_text(kept.text())
    print(f"{len(kept.lines)} messages in {arguments.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
