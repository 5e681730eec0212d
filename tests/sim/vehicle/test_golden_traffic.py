"""The simulated Pixhawk against ArduPlane 4.6.3, in a conversation recorded from the firmware.

golden/arduplane-4.6.3.jsonl was recorded by tools/golden_traffic.py (it lists what is sent, by
which system, and when) from an ArduPlane of the tag Plane-4.6.3 in software in the loop, held over
the hill of config/sites/hill.toml with the parameters of `sim.firmware.ardupilot`.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.sim.channels import NEUTRAL
from tgl_soar.sim.vehicle.pixhawk import Pixhawk
from tgl_soar.sim.vehicle.sensed import Sensed
from tgl_soar.types import AttitudeSample, PositionFix

GOLDEN = Path(__file__).parent / "golden" / "arduplane-4.6.3.jsonl"
STEP_HZ = 400
LINK = 1
AUTOPILOT = [1, 1]
# ArduPlane reads overrides 50 times a second and looks at its messages in a task of its own.
LATER_S = 0.06
ANSWERS = ("COMMAND_ACK", "PARAM_VALUE", "MESSAGE_INTERVAL", "AUTOPILOT_VERSION")
STREAMS = ("SERVO_OUTPUT_RAW", "ATTITUDE_QUATERNION", "LOCAL_POSITION_NED")
RATES_S = (6.3, 7.9)
PULSES = ("servo1_raw", "servo2_raw", "servo4_raw")

Line = dict[str, Any]


@cache
def golden() -> tuple[Line, ...]:
    return tuple(json.loads(line) for line in GOLDEN.read_text().splitlines())


def message_of(line: Line) -> Any:
    """What was sent, as a message: fields that are left out are 0."""
    made = getattr(mavlink, f"MAVLink_{line['name'].lower()}_message")
    fields = {name: line.get(name, 0) for name in made.fieldnames}
    if "param_id" in fields:
        fields["param_id"] = fields["param_id"].encode()
    return made(**fields)


@cache
def replayed() -> tuple[Line, ...]:
    """The same conversation with the simulated Pixhawk; every message of it."""
    plane = load_airframe(shipped("airframes/eclipson_c.toml"))
    values = {"RC_OVERRIDE_TIME": 3.0, "SCHED_LOOP_RATE": 400.0}
    pixhawk = Pixhawk(plane.surfaces, STEP_HZ, parameters=values)
    pixhawk.pilot_sticks = NEUTRAL
    pixhawk.add_link(LINK, ground=False)
    waiting = [line for line in golden() if line.get("from") not in (AUTOPILOT, None)]
    codecs = {who: mavlink.MAVLink(None, *who) for who in ((1, 191), (255, 190))}
    listening = mavlink.MAVLink(None)
    received: list[Line] = []
    for step in range(1, round(15.5 * STEP_HZ)):
        time_s = step / STEP_HZ
        attitude = AttitudeSample(
            sequence=step,
            time_s=time_s,
            qw=1.0,
            qx=0.0,
            qy=0.0,
            qz=0.0,
            roll_rate_frd_radps=0.0,
            pitch_rate_frd_radps=0.0,
            yaw_rate_frd_radps=0.0,
        )
        place = PositionFix(
            sequence=1 + step // 8,
            time_s=time_s,
            north_m=0.0,
            east_m=0.0,
            down_m=0.0,
            velocity_north_mps=0.0,
            velocity_east_mps=0.0,
            velocity_down_mps=0.0,
        )
        pixhawk.step(Sensed(attitude=attitude, position=place, airspeed_mps=8.7, flying=True))
        for _, data in pixhawk.take_datagrams():
            for message in listening.parse_buffer(bytearray(data)) or ():
                fields = message.to_dict()
                received.append({"t": time_s, "name": fields.pop("mavpackettype"), **fields})
        while waiting and waiting[0]["t"] <= time_s:
            line = waiting.pop(0)
            codec = codecs[tuple(line["from"])]
            pixhawk.receive(LINK, bytes(message_of(line).pack(codec)))
            codec.seq = (codec.seq + 1) % 256
    return tuple(received)


def of_firmware(*names: str) -> list[Line]:
    return [line for line in golden() if line.get("from") == AUTOPILOT and line["name"] in names]


QUESTIONS = [line for line in golden() if line.get("from") == [1, 191] and 1.04 < line["t"] < 6.4]
QUESTIONS = [line for line in QUESTIONS if line["name"] != "HEARTBEAT"]


@pytest.mark.parametrize("question", QUESTIONS, ids=lambda q: f"{q['t']:.2f}-{q['name']}")
def test_it_answers_as_the_firmware(question: Line) -> None:
    """Accepted, denied, failed, unsupported, or met with silence; value, type and index."""
    begin, end = question["t"], question["t"] + 0.25

    def answers(lines: Any, fields: dict[str, tuple[str, ...]]) -> list[tuple[Any, ...]]:
        return sorted(
            (line["name"], *(line[field] for field in fields[line["name"]]))
            for line in lines
            if line["name"] in ANSWERS and begin < line["t"] <= end
        )

    kept = {
        line["name"]: tuple(name for name in line if name not in ("t", "from", "name"))
        for line in of_firmware(*ANSWERS)
    }
    assert answers(replayed(), kept) == answers(of_firmware(*ANSWERS), kept)


def test_there_are_questions_with_and_without_an_answer() -> None:
    assert len(QUESTIONS) == 21
    answered = [line["t"] for line in of_firmware(*ANSWERS)]
    silent = [q for q in QUESTIONS if not any(q["t"] < t <= q["t"] + 0.25 for t in answered)]
    assert [q["name"] for q in silent] == ["PARAM_REQUEST_READ", "PARAM_SET", "COMMAND_LONG"]


def outputs_at(lines: Any, time_s: float) -> tuple[int, ...]:
    """Of aileron, elevator and rudder, as they were last reported."""
    reported = [
        line for line in lines if line["name"] == "SERVO_OUTPUT_RAW" and line["t"] <= time_s
    ]
    return tuple(reported[-1][name] for name in PULSES)


@pytest.mark.parametrize(
    ("time_s", "what"),
    [
        (8.4, "a sender whom it does not obey"),
        (9.4, "aileron right, elevator down, rudder right"),
        (9.9, "the rudder is left as it is"),
        (10.4, "the aileron is released"),
        (10.9, "beyond the ends"),
        (11.2, "silence, and they stand"),
        (12.0, "silence for longer than RC_OVERRIDE_TIME"),
        (12.9, "taken again"),
        (13.4, "all released"),
    ],
)
def test_pulses_pass_as_through_the_firmware(time_s: float, what: str) -> None:
    firmware = outputs_at(of_firmware("SERVO_OUTPUT_RAW"), time_s)
    assert outputs_at(replayed(), time_s) == pytest.approx(firmware, abs=1.0), what


def test_overrides_time_out_when_those_of_the_firmware_do() -> None:
    """Half a second after the last frame, at 10.99 s; the firmware looks in a task of its own."""

    def released_s(lines: Any) -> float:
        outputs = [line for line in lines if line["name"] == "SERVO_OUTPUT_RAW"]
        neutral = [line for line in outputs if line["t"] > 11.2 and line["servo1_raw"] == 1500]
        return float(neutral[0]["t"])

    firmware = released_s(of_firmware("SERVO_OUTPUT_RAW"))
    assert firmware - LATER_S < released_s(replayed()) <= firmware


def test_the_mode_stays_when_overrides_time_out() -> None:
    """The heartbeat after the time-out is that of before, in both."""
    for lines in (of_firmware("HEARTBEAT"), replayed()):
        beats = [line for line in lines if line["name"] == "HEARTBEAT" and line["type"] == 1]
        late = {(b["base_mode"], b["custom_mode"]) for b in beats if b["t"] > 8.5}
        assert late == {(209, 0)}


def test_heartbeats_tell_the_same_modes() -> None:
    def modes(lines: Any) -> list[tuple[int, ...]]:
        beats = [line for line in lines if line["name"] == "HEARTBEAT" and line["type"] == 1]
        names = ("autopilot", "base_mode", "custom_mode", "system_status")
        reported = [tuple(beat[name] for name in names) for beat in beats if beat["t"] > 1.0]
        return [mode for i, mode in enumerate(reported) if i == 0 or mode != reported[i - 1]]

    assert modes(replayed()) == modes(of_firmware("HEARTBEAT"))
    assert len(modes(of_firmware("HEARTBEAT"))) == 3  # MANUAL, FBWA, MANUAL


@pytest.mark.parametrize("stream", STREAMS)
def test_streams_come_at_the_firmwares_rate(stream: str) -> None:
    rates = golden()[-1]["rates_hz"]
    begin, end = RATES_S
    sent = [line for line in replayed() if line["name"] == stream and begin <= line["t"] < end]
    assert len(sent) / (end - begin) == pytest.approx(rates[stream], rel=0.02)
