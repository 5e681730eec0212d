"""What hostile frames are made of: each sort alone, field by field, with pymavlink as the judge."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable
from itertools import islice
from math import isfinite
from random import Random
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.hot_frames import READERS
from tgl_soar.link.inbound_messages import INBOUND
from tgl_soar.sim.hostile import RECEIVED_NAMES, HostileFrames, hostile_message

V1, V2 = 0xFE, 0xFD
SIGNED = 0x01
SIGNATURE_BYTES = 13
V1_OVERHEAD, V2_OVERHEAD = 8, 12  # header and checksum
DRAWS = 400  # of each kind of message: one of five values is missed with 0.8^400
FORMATS = {
    "uint8_t": "B", "int8_t": "b", "uint16_t": "H", "int16_t": "h", "uint32_t": "I",
    "int32_t": "i", "uint64_t": "Q", "int64_t": "q",
}  # fmt: skip
MEASURED = {
    "attitude_quaternion", "local_position_ned", "odometry", "highres_imu", "vfr_hud",
}  # fmt: skip


def limits(wire: str) -> tuple[int, int]:
    """The least and the greatest number that the bytes of a type can hold."""
    size = struct.calcsize(FORMATS[wire])
    ones = b"\xff" * size
    unsigned = int.from_bytes(ones, "little")
    return (0, unsigned) if wire.startswith("u") else (-(unsigned // 2) - 1, unsigned // 2)


def sent_values() -> dict[str, set[Any]]:
    """By type ("target" apart): all that comes in messages of all kinds."""
    random = Random(5)
    sent: dict[str, set[Any]] = {
        wire: set() for wire in (*FORMATS, "float", "target", "param_id", "char")
    }
    for name in RECEIVED_NAMES:
        kind = getattr(mavlink, f"MAVLink_{name}_message")
        for _ in range(DRAWS // 4):
            message = hostile_message(random, name)
            for field, wire in zip(kind.fieldnames, kind.fieldtypes, strict=True):
                key = "target" if field.startswith("target") else wire
                key = "param_id" if field == "param_id" else key
                value = getattr(message, field)
                sent[key].update(
                    struct.pack("<d", v) if wire == "float" else v
                    for v in (value if isinstance(value, list) else [value])
                )
    return sent


@pytest.fixture(scope="module")
def sent() -> dict[str, set[Any]]:
    return sent_values()


@pytest.mark.parametrize("wire", ["uint8_t", "uint16_t", "int16_t", "uint32_t", "int32_t"])
def test_whole_numbers_stand_at_both_edges_at_zero_at_one_and_anywhere(
    sent: dict[str, set[Any]], wire: str
) -> None:
    low, high = limits(wire)
    assert {low, high, 0, 1} <= sent[wire]
    assert (min(sent[wire]), max(sent[wire])) == (low, high)
    assert len(sent[wire]) > 50


@pytest.mark.parametrize("wire", ["int8_t", "uint64_t", "int64_t"])
def test_rarer_whole_numbers_stand_at_their_edges_too(sent: dict[str, set[Any]], wire: str) -> None:
    low, high = limits(wire)
    assert {low, high, 0, 1} <= sent[wire]
    assert (min(sent[wire]), max(sent[wire])) == (low, high)


def test_floats_are_those_that_break_arithmetic_and_a_few_that_do_not(
    sent: dict[str, set[Any]],
) -> None:
    """No numbers, both infinities, both zeros, near both ends of a float, a subnormal, and two."""
    floats = [struct.unpack("<d", value)[0] for value in sent["float"]]
    assert sum(not isfinite(value) for value in floats) == 3
    assert sum(value != value for value in floats) == 1
    assert {struct.pack("<d", value) for value in (0.0, -0.0)} <= sent["float"]
    greatest = struct.unpack("<f", b"\xff\xff\x7f\x7f")[0]
    least_normal = 2.0**-126
    rest = sorted(value for value in floats if isfinite(value) and value != 0.0)
    low, *tiny_one_and_large, high = rest
    assert low == -high
    assert 0.1 * greatest < high < greatest
    tiny, one, large = tiny_one_and_large
    assert 0.0 < tiny < least_normal
    assert one == 1.0
    assert large > 6.4e6  # an earth's radius from here


def test_targets_are_everybody_the_autopilot_the_module_and_a_stranger(
    sent: dict[str, set[Any]],
) -> None:
    assert sent["target"] == {0, 1, 191, 255}


def test_names_of_parameters_are_real_ones_none_and_no_text(sent: dict[str, set[Any]]) -> None:
    raw = sent["param_id"]
    assert {"OP_ENGAGE", "TGL_X", "TGL_LEAN", "RC_OVERRIDE_TIM", ""} <= {
        value if isinstance(value, str) else value.split(b"\0")[0].decode("ascii", "replace")
        for value in raw
    }
    assert len(raw) == 6
    longest = max(raw, key=len)
    assert len(longest) == 16  # a whole field, without an end


def test_all_that_asks_or_tells_is_sent_in_the_name_of_others() -> None:
    """Measurements, requests, answers and settings; of each an answer without a request."""
    names = set(RECEIVED_NAMES)
    assert len(names) == len(RECEIVED_NAMES)
    assert names >= MEASURED | {"global_position_int", "vision_position_estimate", "gps_raw_int"}
    assert names >= {"scaled_imu", "raw_imu", "servo_output_raw", "rc_channels", "attitude"}
    assert names >= {"heartbeat", "sys_status", "statustext", "timesync", "command_ack"}
    assert names >= {"command_long", "command_int", "setup_signing", "mission_item_int"}
    assert names >= {"param_request_read", "param_set", "param_value", "file_transfer_protocol"}


def test_whatever_the_module_reads_is_sent_in_the_name_of_others() -> None:
    read = {mavlink.mavlink_map[number].msgname.lower() for number in (*READERS, *INBOUND)}
    assert read <= set(RECEIVED_NAMES)


# --- whole frames --------------------------------------------------------------------------------


def frames(sort: Callable[[HostileFrames], bytes], count: int, *, system: int = 1) -> list[bytes]:
    supply = HostileFrames(3, system=system)
    return [sort(supply) for _ in range(count)]


def header(frame: bytes) -> tuple[int, int, int]:
    """System, component and number of the message."""
    if frame[0] == V1:
        return frame[3], frame[4], frame[5]
    return frame[5], frame[6], int.from_bytes(frame[7:10], "little")


def parsed(frame: bytes) -> Any:
    signed = frame[0] == V2 and frame[2] & SIGNED
    bare = frame[:-SIGNATURE_BYTES] if signed else frame
    if signed:
        bare = bare[:2] + b"\0" + bare[3:]
    return mavlink.MAVLink(None).decode(bytearray(bare))


def test_strangers_send_whole_frames_and_are_never_the_autopilot_or_the_module() -> None:
    found = frames(HostileFrames._of_nobody, 4000)
    senders = {header(frame)[:2] for frame in found}
    assert {system for system, _ in senders} == {7, 1, 77, 99, 200}
    assert {component for system, component in senders if system != 1} == {0, 1, 190, 191, 255}
    assert {component for system, component in senders if system == 1} == {0, 42, 190, 255}
    names = {parsed(frame).get_type().lower() for frame in found}
    assert names == set(RECEIVED_NAMES)


def test_one_frame_in_five_is_of_mavlink_1_where_that_has_the_message() -> None:
    found = frames(HostileFrames._of_nobody, 4000)
    small = [frame for frame in found if header(frame)[2] < 256]
    assert all(frame[0] == V2 for frame in found if header(frame)[2] > 255)
    # 3,500 draws of 0.2: three standard deviations are 0.02.
    assert sum(frame[0] == V1 for frame in small) / len(small) == pytest.approx(0.2, abs=0.02)


def test_one_in_five_of_mavlink_2_has_a_signature_of_rubbish() -> None:
    found = [frame for frame in frames(HostileFrames._of_nobody, 4000) if frame[0] == V2]
    signed = [frame for frame in found if len(frame) == frame[1] + V2_OVERHEAD + SIGNATURE_BYTES]
    assert all(frame[2] == SIGNED for frame in signed)
    others = [frame for frame in found if frame not in signed]
    assert all(frame[2] == 0 and len(frame) == frame[1] + V2_OVERHEAD for frame in others)
    assert len(signed) / len(found) == pytest.approx(0.2, abs=0.022)
    assert len({frame[-SIGNATURE_BYTES:] for frame in signed}) == len(signed)


def test_numbers_of_frames_run_on_through_a_byte() -> None:
    supply = HostileFrames(1)
    message = mavlink.MAVLink_heartbeat_message(0, 0, 0, 0, 0, 3)
    numbers = []
    for _ in range(600):
        frame = supply.packed(message, 7, 1)
        numbers.append(frame[2] if frame[0] == V1 else frame[4])
    assert numbers == [(1 + i) % 256 for i in range(600)]


def test_rubbish_begins_with_nothing_or_as_a_frame_does_and_is_short() -> None:
    found = frames(HostileFrames._rubbish, 5000)
    begun = Counter(
        next(begin for begin in (b"\xfd\xff\x00\x00", b"\xfe\x1c", b"\xfd", b"\xfe", b"")
             if frame.startswith(begin))
        for frame in found
    )  # fmt: skip
    # Of five beginnings each a fifth; a random byte is one of two marks once in 128.
    for begin, count in begun.items():
        assert count / len(found) == pytest.approx(0.2, abs=0.025), begin
    assert len(begun) == 5
    assert min(map(len, found)) == 0
    assert max(map(len, found)) == 64  # four bytes of a beginning, and 60


def test_broken_frames_are_cut_turned_in_one_bit_or_run_into_the_next() -> None:
    found = frames(HostileFrames._broken, 600)
    ways = Counter(way_of(frame) for frame in found)
    # A third each; 600 draws: three standard deviations are 0.058.
    assert ways["turned"] / len(found) == pytest.approx(1.0 / 3.0, abs=0.058)
    assert ways["cut"] / len(found) == pytest.approx(1.0 / 3.0, abs=0.058)
    assert ways["two"] / len(found) == pytest.approx(1.0 / 3.0, abs=0.058)


def way_of(frame: bytes) -> str:
    """Cut: shorter than it says; two: another whole frame follows; or one bit is turned."""
    if whole(frame):
        return "whole"
    for flip in range(8 * len(frame)):
        data = bytearray(frame)
        data[flip // 8] ^= 1 << flip % 8
        if whole(bytes(data)):
            return "turned"
    if any(whole(frame[begin:]) for begin in range(1, len(frame))):
        return "two"
    return "cut"


def whole(frame: bytes) -> bool:
    if len(frame) < V1_OVERHEAD or frame[0] not in (V1, V2):
        return False
    length = frame[1] + V1_OVERHEAD
    if frame[0] == V2:
        length = frame[1] + V2_OVERHEAD + SIGNATURE_BYTES * (frame[2] == SIGNED)
        if frame[2] not in (0, SIGNED):
            return False
    if len(frame) != length:
        return False
    try:
        parsed(frame)
    except mavlink.MAVError:
        return False
    return True


# --- of accepted senders -------------------------------------------------------------------------


def test_the_autopilot_itself_sends_only_measurements_that_are_no_numbers() -> None:
    found = [frame for frame in frames(HostileFrames._out_of_range, 3000, system=9)
             if header(frame)[0] == 9]  # fmt: skip
    assert all(header(frame)[1] == 1 for frame in found)
    messages = [parsed(frame) for frame in found]
    assert {message.get_type().lower() for message in messages} == MEASURED
    sent = set()
    for message in messages:
        for field, wire in zip(message.fieldnames, message.fieldtypes, strict=True):
            value = getattr(message, field)
            if wire == "float" and not isinstance(value, list):
                assert not isfinite(value), (message.get_type(), field)
                sent.add(str(value))
            if field.startswith("time_"):
                assert value == 0
    assert sent == {"nan", "inf", "-inf"}


def test_an_operator_sets_parameters_to_what_none_can_be() -> None:
    found = [frame for frame in frames(HostileFrames._out_of_range, 3000, system=9)
             if header(frame)[0] != 9]  # fmt: skip
    assert len(found) / 3000 == pytest.approx(0.3, abs=0.026)
    assert {header(frame)[:2] for frame in found} == {(255, 190)}
    messages = [parsed(frame) for frame in found]
    assert {message.get_type() for message in messages} == {"PARAM_SET"}
    assert {(m.target_system, m.target_component) for m in messages} == {(9, 191)}
    assert {m.param_id for m in messages} == {"TGL_X", "TGL_LEAN", "NO_SUCH", "SURF_MAX"}
    assert {m.param_type for m in messages} == {9, 0, 255}  # a float, none, and none that is known
    values = [m.param_value for m in messages]
    finite = {round(value / 1e30) for value in values if isfinite(value)}
    assert finite == {1, -1}
    assert {str(value) for value in values if not isfinite(value)} == {"nan", "inf", "-inf"}


def test_each_sort_is_one_in_four() -> None:
    supply, sorts = HostileFrames(1), Counter[str]()
    for name in ("_rubbish", "_broken", "_of_nobody", "_out_of_range"):

        def counted(name: str = name) -> bytes:
            sorts[name] += 1
            return b""

        setattr(supply, name, counted)
    assert list(islice(supply, 2000)) == 2000 * [b""]
    assert len(sorts) == 4
    for count in sorts.values():
        assert count == pytest.approx(500, abs=60)  # three standard deviations


def test_a_supply_is_of_system_1_by_default() -> None:
    listened_to = {header(frame)[0] for frame in frames(HostileFrames._out_of_range, 100)}
    assert listened_to == {1, 255}
