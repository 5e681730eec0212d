"""The frames of every tick, by fixed offsets.

A tick hears an attitude and accelerations, in every fourth a position and the servos' outputs,
and says one override.  A simulator in lockstep asks the time in between.  These few payloads
are unpacked and packed here with one `struct` each; all others go through pymavlink's dialect,
and a test holds both ways equal field by field.

On the wire a payload's fields stand in the order of their size, the largest first, and what was
added to a message later stands behind them.  MAVLink 2 cuts off trailing zeros, and MAVLink 1
knows no later fields: what is missing is zero.  A field of a newer definition, behind those that
are known, is not read.

https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

from collections.abc import Callable
from struct import Struct
from typing import Any, Final, NamedTuple, TypeAlias

from fastcrc.crc16 import mcrf4xx as checksum

from .messages import (
    ID_ATTITUDE_QUATERNION,
    ID_GLOBAL_POSITION_INT,
    ID_HIGHRES_IMU,
    ID_LOCAL_POSITION_NED,
    ID_ODOMETRY,
    ID_RAW_IMU,
    ID_RC_CHANNELS_OVERRIDE,
    ID_SCALED_IMU,
    ID_SCALED_IMU2,
    ID_SCALED_IMU3,
    ID_SERVO_OUTPUT_RAW,
    ID_TIMESYNC,
    AttitudeQuaternion,
    GlobalPositionInt,
    Heard,
    HighresImu,
    LocalPositionNed,
    Odometry,
    RawImu,
    RcChannelsOverride,
    Said,
    ScaledImu,
    ServoOutputRaw,
    Timesync,
)

__all__ = ["READERS", "WRITERS", "Read", "checksum"]

Read: TypeAlias = Callable[[bytes, int], Heard]


class Reader(NamedTuple):
    """How a payload becomes a message."""

    size: int  # so many bytes are read
    read: Read  # from a buffer, at an offset


class Writer(NamedTuple):
    """How a message becomes a payload, trailing zeros and all."""

    number: int
    write: Callable[[Any], bytes]


_new: Final = tuple.__new__  # a named tuple of what is unpacked, without counting it once more

_ATTITUDE_QUATERNION: Final = Struct("<I7f")
_LOCAL_POSITION_NED: Final = Struct("<I6f")
_GLOBAL_POSITION_INT: Final = Struct("<I3i4x3h")
_ODOMETRY: Final = Struct("<Q55f2BxB")
_RAW_IMU: Final = Struct("<Q6h")
_SCALED_IMU: Final = Struct("<I6h")
_HIGHRES_IMU: Final = Struct("<Q6f12x2f4xfH")
_SERVO_OUTPUT_RAW: Final = Struct("<I8HB8H")
_TIMESYNC: Final = Struct("<2q")
_OVERRIDE: Final = Struct("<8H2B").pack
_LATER_CHANNELS: Final = Struct("<10H").pack
_NO_LATER_CHANNELS: Final = (0,) * 10


def _plain(kind: type[Heard], layout: Struct) -> Reader:
    """Of a message whose fields are those of the payload, in its order."""
    unpack = layout.unpack_from

    def read(data: bytes, at: int) -> Heard:
        return _new(kind, unpack(data, at))

    return Reader(layout.size, read)


def _scaled_imu(number: int) -> Reader:
    unpack = _SCALED_IMU.unpack_from
    return Reader(_SCALED_IMU.size, lambda data, at: ScaledImu(number, *unpack(data, at)))


def _servo_output_raw(data: bytes, at: int) -> Heard:
    fields = _SERVO_OUTPUT_RAW.unpack_from(data, at)
    return ServoOutputRaw(fields[0], fields[9], fields[1:9] + fields[10:])


def _odometry(data: bytes, at: int) -> Heard:
    f = _ODOMETRY.unpack_from(data, at)
    motion = f[4:8], *f[8:14]
    frame, child_frame, estimator = f[56:]
    fields = f[0], frame, child_frame, *f[1:4], *motion, f[14:35], f[35:56], estimator
    return _new(Odometry, fields)


def _write_timesync(message: Any) -> bytes:
    return _TIMESYNC.pack(*message)


def _write_override(message: Any) -> bytes:
    system, component, channels = message
    payload, later = _OVERRIDE(*channels[:8], system, component), channels[8:]
    return payload if later == _NO_LATER_CHANNELS else payload + _LATER_CHANNELS(*later)


READERS: Final[dict[int, Reader]] = {
    ID_ATTITUDE_QUATERNION: _plain(AttitudeQuaternion, _ATTITUDE_QUATERNION),
    ID_LOCAL_POSITION_NED: _plain(LocalPositionNed, _LOCAL_POSITION_NED),
    ID_GLOBAL_POSITION_INT: _plain(GlobalPositionInt, _GLOBAL_POSITION_INT),
    ID_ODOMETRY: Reader(_ODOMETRY.size, _odometry),
    ID_RAW_IMU: _plain(RawImu, _RAW_IMU),
    ID_SCALED_IMU: _scaled_imu(ID_SCALED_IMU),
    ID_SCALED_IMU2: _scaled_imu(ID_SCALED_IMU2),
    ID_SCALED_IMU3: _scaled_imu(ID_SCALED_IMU3),
    ID_HIGHRES_IMU: _plain(HighresImu, _HIGHRES_IMU),
    ID_SERVO_OUTPUT_RAW: Reader(_SERVO_OUTPUT_RAW.size, _servo_output_raw),
    ID_TIMESYNC: _plain(Timesync, _TIMESYNC),
}

WRITERS: Final[dict[type[Said], Writer]] = {
    RcChannelsOverride: Writer(ID_RC_CHANNELS_OVERRIDE, _write_override),
    Timesync: Writer(ID_TIMESYNC, _write_timesync),
}
