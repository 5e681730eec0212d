"""The decoder against pymavlink's frames, whole, cut, corrupted and buried in garbage."""

import struct
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.decoder import Decoder
from tgl_soar.link.encoder import Encoder
from tgl_soar.link.frames import first_frame
from tgl_soar.link.messages import (
    AttitudeQuaternion,
    CommandAck,
    CommandLong,
    GlobalPositionInt,
    Heartbeat,
    HighresImu,
    LocalPositionNed,
    Odometry,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    RawImu,
    ScaledImu,
    ServoOutputRaw,
    Source,
    SysStatus,
    Timesync,
    VfrHud,
    VisionPositionEstimate,
    Wind,
    WindCov,
)


def packed(message: Any, system: int = 1, component: int = 1, *, v1: bool = False) -> bytes:
    return bytes(message.pack(mavlink.MAVLink(None, system, component), force_mavlink1=v1))


ATTITUDE = mavlink.MAVLink_attitude_quaternion_message(1234, 0.5, 0.5, -0.5, 0.5, 0.25, -1, 2)
POSITION = mavlink.MAVLink_local_position_ned_message(1235, 1, 2, -3, 0.5, -0.5, 0.125)
HEARTBEAT = mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3)
SET = mavlink.MAVLink_param_set_message(1, 191, b"TGL_X", 1.5, 9)

KNOWN = [
    (HEARTBEAT, Heartbeat(type=1, autopilot=3, base_mode=81, custom_mode=0, system_status=4)),
    (
        ATTITUDE,
        AttitudeQuaternion(
            time_boot_ms=1234,
            q1=0.5,
            q2=0.5,
            q3=-0.5,
            q4=0.5,
            rollspeed=0.25,
            pitchspeed=-1.0,
            yawspeed=2.0,
        ),
    ),
    (
        POSITION,
        LocalPositionNed(time_boot_ms=1235, x=1.0, y=2.0, z=-3.0, vx=0.5, vy=-0.5, vz=0.125),
    ),
    (
        mavlink.MAVLink_odometry_message(
            7_000_000, 20, 12, 1, 2, 3, [1, 0, 0, 0], 4, 5, 6, 7, 8, 9, [0] * 21, [0] * 21
        ),
        Odometry(
            time_usec=7_000_000,
            frame_id=20,
            child_frame_id=12,
            x=1.0,
            y=2.0,
            z=3.0,
            q=(1.0, 0.0, 0.0, 0.0),
            vx=4.0,
            vy=5.0,
            vz=6.0,
            rollspeed=7.0,
            pitchspeed=8.0,
            yawspeed=9.0,
            pose_covariance=(0.0,) * 21,
            velocity_covariance=(0.0,) * 21,
        ),
    ),
    (
        mavlink.MAVLink_vision_position_estimate_message(
            9_000_000, 1, 2, -3, 0.5, -0.25, 1.5, [0.25] * 21
        ),
        VisionPositionEstimate(
            usec=9_000_000,
            x=1.0,
            y=2.0,
            z=-3.0,
            roll=0.5,
            pitch=-0.25,
            yaw=1.5,
            covariance=(0.25,) * 21,
        ),
    ),
    (
        mavlink.MAVLink_global_position_int_message(
            5, 519_990_001, -43_770_002, 12_345, 1_000, -120, 34, -5, 9_000
        ),
        GlobalPositionInt(
            time_boot_ms=5, lat=519_990_001, lon=-43_770_002, alt=12_345, vx=-120, vy=34, vz=-5
        ),
    ),
    (
        mavlink.MAVLink_highres_imu_message(
            77_000_123, 0.5, -0.25, -9.75, 0.125, 1, 2, 3, 4, 5, 1013.25, 0.5, 7, 15.5, 0x43F
        ),
        HighresImu(
            time_usec=77_000_123,
            xacc=0.5,
            yacc=-0.25,
            zacc=-9.75,
            xgyro=0.125,
            ygyro=1.0,
            zgyro=2.0,
            abs_pressure=1013.25,
            diff_pressure=0.5,
            temperature=15.5,
            fields_updated=0x43F,
        ),
    ),
    (
        mavlink.MAVLink_scaled_imu_message(5, 10, -20, -1000, 1, 2, 3, 4, 5, 6),
        ScaledImu(
            message_id=26, time_boot_ms=5, xacc=10, yacc=-20, zacc=-1000, xgyro=1, ygyro=2, zgyro=3
        ),
    ),
    (
        mavlink.MAVLink_scaled_imu2_message(6, 10, -20, -1000, 1, 2, 3, 4, 5, 6),
        ScaledImu(
            message_id=116, time_boot_ms=6, xacc=10, yacc=-20, zacc=-1000, xgyro=1, ygyro=2, zgyro=3
        ),
    ),
    (
        mavlink.MAVLink_scaled_imu3_message(7, 10, -20, -1000, 1, 2, 3, 4, 5, 6),
        ScaledImu(
            message_id=129, time_boot_ms=7, xacc=10, yacc=-20, zacc=-1000, xgyro=1, ygyro=2, zgyro=3
        ),
    ),
    (
        mavlink.MAVLink_raw_imu_message(5_000_007, 10, -20, -1000, 1, 2, 3, 4, 5, 6),
        RawImu(time_usec=5_000_007, xacc=10, yacc=-20, zacc=-1000, xgyro=1, ygyro=2, zgyro=3),
    ),
    (mavlink.MAVLink_vfr_hud_message(8.5, 0.25, 270, 0, 120.5, -0.5), VfrHud(8.5, 120.5)),
    (mavlink.MAVLink_wind_message(-90.0, 8.5, 0.25), Wind(-90.0, 8.5)),
    (
        mavlink.MAVLink_wind_cov_message(7, -1.0, 8.5, 0.25, 1.5, 2.5, 120.0, 0.5, 2.0),
        WindCov(
            time_usec=7,
            wind_x=-1.0,
            wind_y=8.5,
            wind_z=0.25,
            horiz_accuracy=0.5,
            vert_accuracy=2.0,
        ),
    ),
    (
        mavlink.MAVLink_sys_status_message(*(48, 32, 16), *(0,) * 10),
        SysStatus(48, 16),
    ),
    (
        mavlink.MAVLink_servo_output_raw_message(5, 0, *range(1500, 1508)),
        ServoOutputRaw(5, 0, (*range(1500, 1508), *(0,) * 8)),
    ),
    (
        mavlink.MAVLink_command_long_message(1, 191, 511, 0, 31, 5000, 0, 0, 0, 0, 0),
        CommandLong(
            target_system=1,
            target_component=191,
            command=511,
            confirmation=0,
            params=(31.0, 5000.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        ),
    ),
    (
        mavlink.MAVLink_command_ack_message(511, 2, 0, 0, 1, 191),
        CommandAck(command=511, result=2, target_system=1, target_component=191),
    ),
    (mavlink.MAVLink_param_request_list_message(1, 191), ParamRequestList(1, 191)),
    (
        mavlink.MAVLink_param_request_read_message(1, 191, b"SIXTEEN_LETTERS_", -1),
        ParamRequestRead(1, 191, "SIXTEEN_LETTERS_", -1),
    ),
    (
        SET,
        ParamSet(
            target_system=1, target_component=191, param_id="TGL_X", param_value=1.5, param_type=9
        ),
    ),
    (
        mavlink.MAVLink_param_value_message(b"SYSID_MYGCS", 255, 9, 900, 3),
        ParamValue(
            param_id="SYSID_MYGCS", param_value=255.0, param_type=9, param_count=900, param_index=3
        ),
    ),
    (mavlink.MAVLink_timesync_message(0, -5), Timesync(0, -5)),
]


# MAVLink 1 has no numbers above 255, and none of the fields that came later.
V1 = [
    case for case in KNOWN if case[0].id < 256 and case[0].id != mavlink.MAVLINK_MSG_ID_COMMAND_ACK
]


@pytest.mark.parametrize(
    ("message", "expected", "v1"),
    [(*case, False) for case in KNOWN] + [(*case, True) for case in V1],
)
def test_every_message_that_is_received(message: Any, expected: Any, v1: bool) -> None:
    decoder = Decoder(stream=False)
    received = decoder.feed(packed(message, 7, 9, v1=v1))
    assert [r.message for r in received] == [expected]
    assert received[0].source == Source(7, 9)
    assert decoder.counters.skipped_bytes == 0


def test_signed_frames_are_read() -> None:
    mav = mavlink.MAVLink(None, 1, 1)
    mav.signing.secret_key = bytes(32)
    mav.signing.sign_outgoing = True
    mav.signing.timestamp = 1
    decoder = Decoder(stream=True)
    assert len(decoder.feed(HEARTBEAT.pack(mav) + packed(ATTITUDE))) == 2


def test_other_messages_pass_unread_and_unknown_ones_are_stepped_over() -> None:
    decoder = Decoder(stream=False)
    unknown = bytes((0xFD, 4, 0, 0, 0, 1, 1, 0xFF, 0xEE, 0xDD)) + b"abcd" + b"??"
    other = packed(mavlink.MAVLink_system_time_message(1, 2))
    received = decoder.feed(packed(HEARTBEAT) + unknown + other + packed(ATTITUDE))
    assert [type(r.message) for r in received] == [Heartbeat, AttitudeQuaternion]
    assert decoder.counters.unknown == 1
    assert decoder.counters.frames == 3
    assert decoder.counters.messages == 2
    assert decoder.counters.skipped_bytes == 0


def test_a_frame_of_a_future_format_is_not_read() -> None:
    frame = bytearray(packed(HEARTBEAT))
    frame[2] = 0x02
    decoder = Decoder(stream=False)
    assert decoder.feed(bytes(frame)) == []


FRAMES = st.lists(
    st.sampled_from([packed(message) for message, _ in KNOWN]), min_size=1, max_size=8
)


@given(frames=FRAMES, data=st.data())
def test_a_stream_cut_anywhere_loses_nothing(frames: list[bytes], data: st.DataObject) -> None:
    stream = b"".join(frames)
    decoder = Decoder(stream=True)
    count, at = 0, 0
    while at < len(stream):
        size = data.draw(st.integers(1, len(stream) - at))
        count += len(decoder.feed(stream[at : at + size]))
        at += size
    assert count == len(frames)
    assert decoder.counters.skipped_bytes == 0


@settings(max_examples=300)
@given(garbage=st.lists(st.binary(max_size=40), min_size=2, max_size=5), frames=FRAMES)
def test_garbage_between_frames_costs_no_frame(garbage: list[bytes], frames: list[bytes]) -> None:
    """Unless the garbage happens to hold a good frame itself, exactly ours come out."""
    stream, expected = b"", 0
    for i, junk in enumerate(garbage):
        stream += junk
        if i < len(frames):
            stream += frames[i]
            expected += 1
    decoder = Decoder(stream=False)
    assert len(decoder.feed(stream)) == expected


@settings(max_examples=300)
@given(frame=st.sampled_from([packed(m) for m, _ in KNOWN]), data=st.data())
def test_a_corrupted_frame_is_refused_and_the_next_one_read(
    frame: bytes, data: st.DataObject
) -> None:
    at = data.draw(st.integers(0, len(frame) - 1))
    bit = data.draw(st.integers(0, 7))
    bad = bytearray(frame)
    bad[at] ^= 1 << bit
    # A frame turned into one of an unknown number cannot be told from a real one of a newer
    # dialect; nor can MAVLink 2's compatible flags, which are covered by the checksum.
    decoder = Decoder(stream=False)
    received = decoder.feed(bytes(bad) + packed(HEARTBEAT))
    assert [r.message for r in received] == [KNOWN[0][1]]


@given(pieces=st.lists(st.binary(max_size=300), max_size=10), stream=st.booleans())
def test_nothing_that_arrives_raises(pieces: list[bytes], stream: bool) -> None:
    decoder = Decoder(stream=stream)
    for piece in pieces:
        decoder.feed(piece)
        first_frame(piece)
    assert isinstance(decoder.feed(packed(HEARTBEAT)), list)


@given(
    marker=st.sampled_from([0xFD, 0xFE]),
    number=st.sampled_from(sorted(mavlink.mavlink_map)),
    payload=st.binary(max_size=255),
)
def test_any_payload_under_a_right_checksum_is_survived(
    marker: int, number: int, payload: bytes
) -> None:
    """Hostile senders know how to count a checksum."""
    assume(number < 256 or marker == 0xFD)
    if marker == 0xFD:
        head = bytes((marker, len(payload), 0, 0, 0, 1, 1, *number.to_bytes(3, "little")))
    else:
        head = bytes((marker, len(payload), 0, 1, 1, number))
    crc = mavlink.x25crc(head[1:] + payload + bytes((mavlink.mavlink_map[number].crc_extra,))).crc
    frame = head + payload + struct.pack("<H", crc)
    decoder = Decoder(stream=False)
    received = decoder.feed(frame + packed(HEARTBEAT))
    assert decoder.counters.frames == 2
    assert received[-1].message == KNOWN[0][1]


def test_a_cut_off_stream_starts_again_after_reset() -> None:
    decoder = Decoder(stream=True)
    decoder.feed(packed(ATTITUDE)[:20])
    decoder.reset()
    assert len(decoder.feed(packed(HEARTBEAT))) == 1


def test_a_false_marker_on_a_stream_holds_nothing_back_for_good() -> None:
    decoder = Decoder(stream=True)
    inbound = len(decoder.feed(bytes((0xFD, 255, 0)) + packed(HEARTBEAT)))
    for _ in range(20):
        inbound += len(decoder.feed(packed(HEARTBEAT)))
    assert inbound == 21


@pytest.mark.parametrize("copies", [1, 2, 3])
def test_what_is_lost_is_counted_whether_or_not_the_rest_comes_more_than_once(copies: int) -> None:
    decoder, autopilot = Decoder(stream=False), Encoder(Source(1, 1))
    decoder.watch(Source(1, 1))
    for k in range(600):
        frame = autopilot.encode(Timesync(1, 1))
        if k % 10 != 5:
            for _ in range(copies):
                decoder.feed(frame)
    assert (decoder.counters.watched, decoder.counters.lost) == (540, 60)
    late = autopilot.encode(Timesync(1, 1))
    decoder.feed(autopilot.encode(Timesync(1, 1)))
    assert decoder.counters.lost == 61
    decoder.feed(late)  # not lost after all
    assert decoder.counters.lost == 60


def test_which_datagrams_begin_with_a_frame() -> None:
    frame = packed(HEARTBEAT)
    assert first_frame(frame) == first_frame(frame + b"rest") == frame
    for other in (frame[:-1], b"", b"GET / HTTP/1.1\r\n", frame[:-1] + b"!"):
        assert first_frame(other) == b""
