"""The frames of every tick, by fixed offsets, against pymavlink: every field, both ways."""

import struct
from collections.abc import Callable
from struct import pack
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator.mavcrc import x25crc

from tgl_soar.link.decoder import Decoder
from tgl_soar.link.encoder import Encoder
from tgl_soar.link.hot_frames import READERS, WRITERS
from tgl_soar.link.messages import (
    AttitudeQuaternion,
    CommandAck,
    ComponentMetadata,
    DebugFloatArray,
    GlobalPositionInt,
    HighresImu,
    Inbound,
    LocalPositionNed,
    NamedValueFloat,
    Odometry,
    Outbound,
    RawImu,
    RcChannelsOverride,
    ScaledImu,
    ServoOutputRaw,
    SetAttitudeTarget,
    Source,
    Timesync,
)
from tgl_soar.link.signing import Signing

KEY = bytes(range(32))


def same_names(kind: type[Any]) -> Callable[[Any], Inbound]:
    """Our fields keep MAVLink's names."""
    return lambda m: kind(*(getattr(m, name) for name in kind._fields))


def scaled_imu(m: Any) -> Inbound:
    return ScaledImu._make((m.get_msgId(), *(getattr(m, name) for name in ScaledImu._fields[1:])))


def servo_output_raw(m: Any) -> Inbound:
    servos = tuple(getattr(m, f"servo{i}_raw") for i in range(1, 17))
    return ServoOutputRaw(m.time_usec, m.port, servos)


def odometry(m: Any) -> Inbound:
    values: list[Any] = [getattr(m, name) for name in Odometry._fields]
    return Odometry._make(tuple(v) if isinstance(v, list) else v for v in values)


# How pymavlink's message reads as ours.
THEIRS: dict[int, Callable[[Any], Inbound]] = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: same_names(AttitudeQuaternion),
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: same_names(LocalPositionNed),
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: same_names(GlobalPositionInt),
    mavlink.MAVLINK_MSG_ID_ODOMETRY: odometry,
    mavlink.MAVLINK_MSG_ID_RAW_IMU: same_names(RawImu),
    mavlink.MAVLINK_MSG_ID_SCALED_IMU: scaled_imu,
    mavlink.MAVLINK_MSG_ID_SCALED_IMU2: scaled_imu,
    mavlink.MAVLINK_MSG_ID_SCALED_IMU3: scaled_imu,
    mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: same_names(HighresImu),
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: servo_output_raw,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: same_names(Timesync),
}


def framed(number: int, payload: bytes, *, v1: bool = False, key: bytes | None = None) -> bytes:
    """A frame around any payload, made without a codec."""
    if v1:
        head = bytes((0xFE, len(payload), 7, 1, 1, number))
    else:
        flags = int(key is not None)
        head = bytes((0xFD, len(payload), flags, 0, 7, 1, 1, *number.to_bytes(3, "little")))
    crc_extra = mavlink.mavlink_map[number].crc_extra
    crc = mavlink.x25crc(head[1:] + payload + bytes((crc_extra,))).crc
    frame = head + payload + struct.pack("<H", crc)
    if key is not None:
        mav = mavlink.MAVLink(None)
        mav.signing.secret_key, mav.signing.timestamp = key, 5
        message = mavlink.MAVLink_message(number, "any")
        message._msgbuf = bytearray(frame)
        message.sign_packet(mav)
        frame = bytes(message._msgbuf)
    return frame


def theirs(frame: bytes) -> Inbound:
    message = mavlink.MAVLink(None).decode(bytearray(frame))
    return THEIRS[message.get_msgId()](message)


def is_readable(frame: bytearray) -> bool:
    """By pymavlink; a number that it does not know it lets pass as such."""
    try:
        message = mavlink.MAVLink(None).decode(frame)
    except mavlink.MAVError:
        return False
    return not isinstance(message, mavlink.MAVLink_unknown)


def test_every_hot_frame_is_held_against_pymavlink() -> None:
    assert set(THEIRS) == set(READERS)
    assert set(WRITERS) == {
        *(RcChannelsOverride, SetAttitudeTarget, NamedValueFloat, DebugFloatArray, Timesync),
        ComponentMetadata,  # pymavlink has none
    }


def test_what_pymavlink_lacks_is_framed_as_mavlink_defines_it() -> None:
    """The frame by hand: CRC_EXTRA is the sum of the message's name and fields, as MAVLink's
    serialization has it."""
    crc = x25crc()
    for word in ("COMPONENT_METADATA", "uint32_t", "time_boot_ms", "uint32_t", "file_crc"):
        crc.accumulate_str(f"{word} ")
    crc.accumulate_str("char uri ")
    crc.accumulate([100])
    extra = crc.crc & 0xFF ^ crc.crc >> 8
    frame = Encoder(Source(3, 191)).encode(ComponentMetadata(70000, 0xFEDCBA98, "mftp:///a"))
    payload = pack("<II", 70000, 0xFEDCBA98) + b"mftp:///a"
    body = bytes((len(payload), 0, 0, 0, 3, 191)) + (397).to_bytes(3, "little") + payload
    assert frame == b"\xfd" + body + pack("<H", x25crc(body + bytes((extra,))).crc)


@settings(max_examples=300)
@given(number=st.sampled_from(sorted(READERS)), data=st.data())
def test_a_payload_reads_as_pymavlink_reads_it(number: int, data: st.DataObject) -> None:
    """Any bytes are a payload: whole, cut off anywhere, or with fields of later versions."""
    whole = mavlink.mavlink_map[number].unpacker.size
    size = data.draw(
        st.one_of(st.just(whole), st.integers(0, whole), st.integers(whole, 255)), label="size"
    )
    payload = data.draw(st.binary(min_size=size, max_size=size), label="payload")
    v1 = number < 256 and data.draw(st.booleans(), label="v1")
    key = None if v1 else data.draw(st.sampled_from((None, KEY)), label="key")
    frame = framed(number, payload, v1=v1, key=key)
    for stream in (False, True):
        (received,) = Decoder(stream=stream).feed(frame)
        assert repr(received.message) == repr(theirs(frame))  # of NaNs the text is equal
        assert type(received.message) is type(theirs(frame))
        assert received.source == Source(1, 1)


@pytest.mark.parametrize("number", sorted(READERS))
@settings(max_examples=30)
@given(data=st.data())
def test_a_corrupted_frame_is_no_message(number: int, data: st.DataObject) -> None:
    size = mavlink.mavlink_map[number].unpacker.size
    frame = bytearray(framed(number, data.draw(st.binary(min_size=size, max_size=size))))
    at = data.draw(st.integers(2, len(frame) - 1), label="at")  # not its length: see test_decoder
    frame[at] ^= 1 << data.draw(st.integers(0, 7), label="bit")
    assert Decoder(stream=False).feed(bytes(frame)) == []
    assert not is_readable(frame)


@given(
    payloads=st.lists(
        st.tuples(st.sampled_from(sorted(READERS)), st.binary(max_size=60)), min_size=1, max_size=6
    ),
    cuts=st.lists(st.integers(1, 80), max_size=12),
)
def test_a_stream_cut_anywhere_gives_the_same(
    payloads: list[tuple[int, bytes]], cuts: list[int]
) -> None:
    frames = [framed(number, payload) for number, payload in payloads]
    stream, decoder = b"".join(frames), Decoder(stream=True)
    received, at = [], 0
    for cut in [*cuts, len(stream)]:
        received += decoder.feed(stream[at : at + cut])
        at += cut
    assert [repr(r.message) for r in received] == [repr(theirs(frame)) for frame in frames]


# --- and back ---------------------------------------------------------------------------------

PULSE = st.integers(0, 65535)
OVERRIDES = st.builds(
    RcChannelsOverride,
    st.integers(0, 255),
    st.integers(0, 255),
    st.one_of(
        st.tuples(*[PULSE] * 18),
        st.tuples(*[PULSE] * 8, *[st.just(0)] * 10),
        st.just((0,) * 18),
    ),
)
TIMESYNCS = st.builds(Timesync, *[st.integers(-(2**63), 2**63 - 1)] * 2)
FLOAT = st.floats(width=32)
BYTE = st.integers(0, 255)
UNSIGNED = st.integers(0, 2**32 - 1)
NAME = st.text("abcxyz_019", max_size=10)
NUMBERS = st.builds(NamedValueFloat, UNSIGNED, NAME, FLOAT)
TARGETS = st.builds(SetAttitudeTarget, UNSIGNED, BYTE, BYTE, BYTE, st.tuples(*[FLOAT] * 4))
ARRAYS = st.builds(
    DebugFloatArray,
    st.integers(0, 2**64 - 1),
    NAME,
    st.integers(0, 65535),
    st.lists(FLOAT, max_size=58).map(tuple),
)
WRITTEN = st.one_of(OVERRIDES, TIMESYNCS, NUMBERS, TARGETS, ARRAYS)


def by_pymavlink(message: Outbound) -> Any:
    if isinstance(message, Timesync):
        return mavlink.MAVLink_timesync_message(*message)
    if isinstance(message, NamedValueFloat):
        return mavlink.MAVLink_named_value_float_message(
            message.time_boot_ms, message.name.encode(), message.value
        )
    if isinstance(message, SetAttitudeTarget):
        *head, q = message
        return mavlink.MAVLink_set_attitude_target_message(*head, list(q), 0.0, 0.0, 0.0, 0.0)
    if isinstance(message, DebugFloatArray):
        data = [*message.data, *(0.0,) * (58 - len(message.data))]
        return mavlink.MAVLink_debug_float_array_message(
            message.time_usec, message.name.encode(), message.array_id, data
        )
    assert isinstance(message, RcChannelsOverride)
    system, component, channels = message
    return mavlink.MAVLink_rc_channels_override_message(system, component, *channels)


@settings(max_examples=150)
@given(
    messages=st.lists(WRITTEN, min_size=1, max_size=4),
    source=st.builds(Source, st.integers(1, 255), st.integers(1, 255)),
    key=st.sampled_from((None, KEY)),
)
def test_what_is_sent_is_pymavlink_s_byte_for_byte(
    messages: list[Outbound], source: Source, key: bytes | None
) -> None:
    mav = mavlink.MAVLink(None, *source)
    mav.signing.secret_key, mav.signing.sign_outgoing = key, key is not None
    mav.signing.link_id = 3
    signing = Signing(key, 1.6e9, 0.0)
    mav.signing.timestamp = signing.timestamp + 1
    encoder = Encoder(source, signing, 3)
    for message in messages:
        assert encoder.encode(message) == by_pymavlink(message).pack(mav)
        mav.seq += 1


@given(message=WRITTEN)
def test_mavlink_1_is_sent_as_pymavlink_reads_it(message: Outbound) -> None:
    encoder = Encoder(Source(1, 191), Signing(KEY, 1.6e9, 0.0))
    encoder.version1 = True
    frame = encoder.encode(message)
    if isinstance(message, DebugFloatArray):  # its number is too large
        assert frame == b""
        return
    back = mavlink.MAVLink(None).decode(bytearray(frame))
    wanted = by_pymavlink(message)
    if isinstance(message, NamedValueFloat):
        wanted.name = message.name
    assert back.get_msgbuf()[0] == 0xFE
    assert repr({n: getattr(back, n) for n in back.fieldnames}) == repr(
        {n: getattr(wanted, n) for n in wanted.fieldnames}
    )


def test_the_sequence_is_one_whoever_packs() -> None:
    encoder = Encoder(Source(1, 191))
    messages: list[Outbound] = [
        Timesync(1, 1),
        CommandAck(command=1, result=0, target_system=1, target_component=1),
        Timesync(1, 1),
    ]
    assert [encoder.encode(message)[4] for message in messages] == [0, 1, 2]


def test_a_field_that_does_not_fit_is_an_error_and_costs_no_number() -> None:
    encoder = Encoder(Source(1, 191))
    for channels in ((70_000, *(0,) * 17), (0,) * 7, (*(0,) * 17, -1)):
        with pytest.raises(struct.error):
            encoder.encode(RcChannelsOverride(1, 1, channels))
    assert encoder.encode(Timesync(1, 1))[4] == 0
