"""Frames that nobody should send: what a bad radio, a bad program or a bad person puts on a link.

One in four each: bytes that are no frame; good frames broken afterwards (cut, bits turned, two
run together); whole frames of senders that are nobody, signed with rubbish among them; whole
frames of the very autopilot and of operators, with numbers that no sensor and no hand gives.
None of them asks for anything that an operator could mean, so that none may change anything.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, nan
from random import Random
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

# All that the module listens to, and some that it does not.
RECEIVED_NAMES: Final = (
    "heartbeat", "attitude_quaternion", "local_position_ned", "odometry", "global_position_int",
    "vision_position_estimate", "highres_imu", "scaled_imu", "raw_imu", "vfr_hud", "sys_status",
    "servo_output_raw", "command_long", "command_int", "rc_channels", "command_ack",
    "param_request_read", "param_set", "param_value", "setup_signing", "timesync",
    "attitude", "gps_raw_int", "statustext", "mission_item_int", "file_transfer_protocol",
    "scaled_imu2", "scaled_imu3", "ekf_status_report", "estimator_status", "distance_sensor",
    "wind", "wind_cov", "mission_count", "mission_current", "home_position", "param_request_list",
)  # fmt: skip
_FLOATS: Final = (nan, inf, -inf, 0.0, -0.0, 1e38, -1e38, 1e-40, 1.0, 7e6)
_NAMES: Final = (b"OP_ENGAGE", b"TGL_X", b"TGL_LEAN", b"", b"\xff" * 16, b"RC_OVERRIDE_TIM\x00")
_NOBODY: Final = (7, 1, 77, 99, 200)  # systems: none is an operator
_WHOLE_RANGES: Final = {
    "uint8_t": (0, 2**8 - 1), "int8_t": (-(2**7), 2**7 - 1), "char": (0, 255),
    "uint16_t": (0, 2**16 - 1), "int16_t": (-(2**15), 2**15 - 1),
    "uint32_t": (0, 2**32 - 1), "int32_t": (-(2**31), 2**31 - 1),
    "uint64_t": (0, 2**64 - 1), "int64_t": (-(2**63), 2**63 - 1),
}  # fmt: skip


def hostile_message(random: Random, name: str) -> Any:
    """A message of a kind, each number at an edge of its range or beyond all sense."""
    kind = getattr(mavlink, f"MAVLink_{name}_message")
    values: list[Any] = []
    for field, wire, length in zip(kind.fieldnames, kind.fieldtypes, _lengths(kind), strict=True):
        if wire == "char":
            values.append(random.choice(_NAMES)[: length or 1] if field == "param_id" else b"x")
        elif length:
            values.append([_number(random, field, wire) for _ in range(length)])
        else:
            values.append(_number(random, field, wire))
    return kind(*values)


def _lengths(kind: Any) -> list[int]:
    """Of arrays, 0 of all else, in the order of the constructor's arguments."""
    of = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
    return [of[name] for name in kind.fieldnames]


def _number(random: Random, field: str, wire: str) -> float | int:
    if wire in ("float", "double"):
        return random.choice(_FLOATS)
    low, high = _WHOLE_RANGES[wire]
    if field.startswith("target"):
        return random.choice((0, 1, 191, 255))
    return random.choice((low, high, 0, 1, random.randint(low, high)))


class HostileFrames:
    """An endless supply of them; the same seed gives the same bytes."""

    def __init__(self, seed: int, *, system: int = 1) -> None:
        self._random = Random(f"{seed}/hostile")
        self._own = system
        self._codec = mavlink.MAVLink(None)

    def __iter__(self) -> Iterator[bytes]:
        while True:
            yield self.next()

    def next(self) -> bytes:
        """One datagram."""
        return self._random.choice(
            (self._rubbish, self._broken, self._of_nobody, self._out_of_range)
        )()

    def _rubbish(self) -> bytes:
        random = self._random
        begin = random.choice((b"", b"\xfd", b"\xfe", b"\xfd\xff\x00\x00", b"\xfe\x1c"))
        return begin + random.randbytes(random.randint(0, 60))

    def _broken(self) -> bytes:
        random = self._random
        frame = bytearray(self._of_nobody())
        way = random.randrange(3)
        if way == 0:
            return bytes(frame[: random.randrange(len(frame))])
        if way == 1:
            frame[random.randrange(len(frame))] ^= 1 << random.randrange(8)
            return bytes(frame)
        return bytes(frame[: random.randrange(len(frame))]) + self._of_nobody()

    def _of_nobody(self) -> bytes:
        random = self._random
        name = random.choice(RECEIVED_NAMES)
        system, component = random.choice(_NOBODY), random.choice((0, 1, 190, 191, 255))
        if system == 1 and component in (1, 191):  # that would be the autopilot, or us
            component = 42
        frame = self.packed(hostile_message(random, name), system, component)
        if frame[0] == 0xFD and random.random() < 0.2:  # a signature, and nothing behind it
            frame = frame[:2] + b"\x01" + frame[3:] + random.randbytes(13)
        return frame

    def _out_of_range(self) -> bytes:
        """Of those who are listened to, but nothing that could be meant."""
        random = self._random
        if random.random() < 0.3:
            message = mavlink.MAVLink_param_set_message(
                self._own, 191, random.choice((b"TGL_X", b"TGL_LEAN", b"NO_SUCH", b"SURF_MAX")),
                random.choice((nan, inf, -inf, 1e30, -1e30)), random.choice((9, 0, 255)),
            )  # fmt: skip
            return self.packed(message, 255, 190)
        name = random.choice(
            ("attitude_quaternion", "local_position_ned", "odometry", "highres_imu", "vfr_hud")
        )
        kind = getattr(mavlink, f"MAVLink_{name}_message")
        message = hostile_message(random, name)
        for field, wire in zip(kind.fieldnames, kind.fieldtypes, strict=True):
            if wire == "float" and not isinstance(getattr(message, field), list):
                setattr(message, field, random.choice((nan, inf, -inf)))
            elif field.startswith("time_"):  # another clock would mean that it has restarted
                setattr(message, field, 0)
        return self.packed(message, self._own, 1)

    def packed(self, message: Any, system: int, component: int) -> bytes:
        """A frame of a sender, now and then of MAVLink 1."""
        codec = self._codec
        codec.srcSystem, codec.srcComponent = system, component
        codec.seq = (codec.seq + 1) % 256
        version_1 = self._random.random() < 0.2 and message.get_msgId() < 256
        return bytes(message.pack(codec, force_mavlink1=version_1))
