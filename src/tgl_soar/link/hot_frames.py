"""The frames of every tick, by fixed offsets.

A tick receives an attitude and accelerations, in every fourth a position and the servos' outputs,
and sends one override or attitude, in every fourth a number for the ground.  A simulator in
lockstep asks the time in between.  These few payloads
are unpacked and packed here with one `struct` each; all others go through pymavlink's dialect,
and a test holds both ways equal field by field.  COMPONENT_METADATA stands here because that
dialect does not have it.

On the wire a payload's fields stand in the order of their size, the largest first, and what was
added to a message later stands behind them.  MAVLink 2 cuts off trailing zeros, and MAVLink 1
knows no later fields: what is missing is zero.  A field of a newer definition, behind those that
are known, is not read.

https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

from collections.abc import Callable
from struct import Struct
from typing import Any, Final, NamedTuple

from tgl_soar.link.messages import (
    ID_ATTITUDE_QUATERNION,
    ID_COMPONENT_METADATA,
    ID_DEBUG_FLOAT_ARRAY,
    ID_GLOBAL_POSITION_INT,
    ID_HIGHRES_IMU,
    ID_LOCAL_POSITION_NED,
    ID_NAMED_VALUE_FLOAT,
    ID_ODOMETRY,
    ID_RAW_IMU,
    ID_RC_CHANNELS_OVERRIDE,
    ID_SCALED_IMU,
    ID_SCALED_IMU2,
    ID_SCALED_IMU3,
    ID_SERVO_OUTPUT_RAW,
    ID_SET_ATTITUDE_TARGET,
    ID_TIMESYNC,
    AttitudeQuaternion,
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
    Timesync,
)
from tgl_soar.types import FLOAT32_MAX, isfinite


class Reader(NamedTuple):
    """How a payload becomes a message."""

    size: int  # so many bytes are read
    kind: type[Inbound]
    fields: Callable[[bytes, int], tuple[Any, ...]]  # of a payload that begins at an offset
    # Of a payload of more than `size` bytes; None: the rest is not read.
    all_fields: Callable[[bytes, int], tuple[Any, ...]] | None = None


class Writer(NamedTuple):
    """How a message becomes a payload, trailing zeros and all."""

    number: int
    write: Callable[[Any], bytes]


_ATTITUDE_QUATERNION: Final = Struct("<I7f")
_LOCAL_POSITION_NED: Final = Struct("<I6f")
_GLOBAL_POSITION_INT: Final = Struct("<I3i4x3h")
_ODOMETRY: Final = Struct("<Q55f2BxB")
_RAW_IMU: Final = Struct("<Q6h")
_SCALED_IMU: Final = Struct("<I6h")
_HIGHRES_IMU: Final = Struct("<Q6f12x2f4xfH")
_SERVO_OUTPUT_RAW: Final = Struct("<I8HB")  # without the outputs behind the first eight
_TIMESYNC: Final = Struct("<2q")

_read_servos: Final = _SERVO_OUTPUT_RAW.unpack_from
_read_all_servos: Final = Struct("<I8HB8H").unpack_from
_NO_LATER_SERVOS: Final[tuple[int, ...]] = (0,) * 8
_read_odometry: Final = _ODOMETRY.unpack_from
_read_scaled_imu: Final = _SCALED_IMU.unpack_from
_write_two: Final = _TIMESYNC.pack
_write_channels: Final = Struct("<8H2B").pack
_write_body: Final = Struct("<7B2x8H2B").pack
_OVERRIDE_BYTES: Final = 18
_write_later: Final = Struct("<10H").pack
_write_number: Final = Struct("<If10s").pack
_write_place: Final = Struct("<II100s").pack
_write_array: Final = Struct("<QH10s58f").pack
_write_attitude: Final = Struct("<I4f4f3B").pack
_FIRST_CHANNELS: Final = 8
_NO_LATER_CHANNELS: Final[tuple[int, ...]] = (0,) * 10
_ARRAY_SIZE: Final = 58  # numbers of a DEBUG_FLOAT_ARRAY


def float32(value: float) -> float:
    """A float that can be packed: what is too large for 32 bits becomes the largest."""
    if not isfinite(value):
        return value
    return max(-FLOAT32_MAX, min(FLOAT32_MAX, value))


def chars(text: str, size: int) -> bytes:
    """What a char field of a size has room for."""
    return text.encode("ascii", "replace")[:size]


def _plain(kind: type[Inbound], layout: Struct) -> Reader:
    """Of a message whose fields are those of the payload, in its order."""
    return Reader(layout.size, kind, layout.unpack_from)


def _scaled_imu(number: int) -> Reader:
    return Reader(
        _SCALED_IMU.size, ScaledImu, lambda data, at: (number, *_read_scaled_imu(data, at))
    )


def _servo_output_raw(data: bytes, at: int) -> tuple[Any, ...]:
    f = _read_servos(data, at)
    return f[0], f[9], f[1:9] + _NO_LATER_SERVOS


def _all_servo_outputs_raw(data: bytes, at: int) -> tuple[Any, ...]:
    f = _read_all_servos(data, at)
    return f[0], f[9], f[1:9] + f[10:]


def _odometry(data: bytes, at: int) -> tuple[Any, ...]:
    f = _read_odometry(data, at)
    frame, child_frame, estimator = f[56:]
    moves = f[4:8], *f[8:14]
    return f[0], frame, child_frame, *f[1:4], *moves, f[14:35], f[35:56], estimator


def _write_timesync(message: Any) -> bytes:
    return _write_two(*message)


def _write_named_value(m: Any) -> bytes:
    return _write_number(m.time_boot_ms & 0xFFFFFFFF, float32(m.value), chars(m.name, 10))


def _write_debug_array(m: Any) -> bytes:
    data = [float32(value) for value in m.data] + [0.0] * (_ARRAY_SIZE - len(m.data))
    return _write_array(m.time_usec, m.array_id, chars(m.name, 10), *data)


def _write_metadata(m: Any) -> bytes:
    return _write_place(m.time_boot_ms & 0xFFFFFFFF, m.file_crc, chars(m.uri, 99))


def _write_attitude_target(m: Any) -> bytes:
    w, x, y, z = m.q
    return _write_attitude(
        m.time_boot_ms & 0xFFFFFFFF, float32(w), float32(x), float32(y), float32(z),
        0.0, 0.0, 0.0, 0.0,  # rates and thrust: the mask excludes them
        m.target_system, m.target_component, m.type_mask,
    )  # fmt: skip


def override_body(
    message: RcChannelsOverride, flags: int, sequence: int, system: int, component: int
) -> bytes:
    """A MAVLink 2 frame of RC_CHANNELS_OVERRIDE between its marker and its checksum, at one go.

    `message` moves none but the first eight channels and ends in no zero, as nearly always; else
    nothing is made.  `system`, `component`: who sends it.
    """
    channels, part = message.channels, message.target_component
    if part == 0 or channels[_FIRST_CHANNELS:] != _NO_LATER_CHANNELS:
        return b""
    c: Any = channels
    return _write_body(
        _OVERRIDE_BYTES, flags, 0, sequence, system, component, ID_RC_CHANNELS_OVERRIDE,
        c[0], c[1], c[2], c[3], c[4], c[5], c[6], c[7], message.target_system, part,
    )  # fmt: skip


def _write_override(message: Any) -> bytes:
    system, component, channels = message
    payload = _write_channels(*channels[:_FIRST_CHANNELS], system, component)
    later = channels[_FIRST_CHANNELS:]
    return payload if later == _NO_LATER_CHANNELS else payload + _write_later(*later)


READERS: Final[dict[int, Reader]] = {
    ID_ATTITUDE_QUATERNION: _plain(AttitudeQuaternion, _ATTITUDE_QUATERNION),
    ID_LOCAL_POSITION_NED: _plain(LocalPositionNed, _LOCAL_POSITION_NED),
    ID_GLOBAL_POSITION_INT: _plain(GlobalPositionInt, _GLOBAL_POSITION_INT),
    ID_ODOMETRY: Reader(_ODOMETRY.size, Odometry, _odometry),
    ID_RAW_IMU: _plain(RawImu, _RAW_IMU),
    ID_SCALED_IMU: _scaled_imu(ID_SCALED_IMU),
    ID_SCALED_IMU2: _scaled_imu(ID_SCALED_IMU2),
    ID_SCALED_IMU3: _scaled_imu(ID_SCALED_IMU3),
    ID_HIGHRES_IMU: _plain(HighresImu, _HIGHRES_IMU),
    ID_SERVO_OUTPUT_RAW: Reader(
        _SERVO_OUTPUT_RAW.size, ServoOutputRaw, _servo_output_raw, _all_servo_outputs_raw
    ),
    ID_TIMESYNC: _plain(Timesync, _TIMESYNC),
}

WRITERS: Final[dict[type[Outbound], Writer]] = {
    RcChannelsOverride: Writer(ID_RC_CHANNELS_OVERRIDE, _write_override),
    SetAttitudeTarget: Writer(ID_SET_ATTITUDE_TARGET, _write_attitude_target),
    NamedValueFloat: Writer(ID_NAMED_VALUE_FLOAT, _write_named_value),
    DebugFloatArray: Writer(ID_DEBUG_FLOAT_ARRAY, _write_debug_array),
    Timesync: Writer(ID_TIMESYNC, _write_timesync),
    ComponentMetadata: Writer(ID_COMPONENT_METADATA, _write_metadata),
}
