"""What is sent, read back by pymavlink."""

from math import inf, isnan, nan
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.encoder import Encoder
from tgl_soar.link.messages import (
    CommandAck,
    CommandLong,
    FileTransferProtocol,
    Heartbeat,
    NamedValueFloat,
    Outbound,
    ParamRequestRead,
    ParamValue,
    RcChannelsOverride,
    Source,
    StatusText,
    Timesync,
)


def parsed(frame: bytes) -> Any:
    return mavlink.MAVLink(None).decode(bytearray(frame))


def test_everything_that_is_sent_reads_back_by_pymavlink() -> None:
    encoder = Encoder(Source(1, 191))
    cases: list[tuple[Outbound, dict[str, object]]] = [
        (
            Heartbeat(type=18, autopilot=8, base_mode=0, custom_mode=0, system_status=4),
            {"type": 18, "autopilot": 8, "mavlink_version": 3},
        ),
        (
            CommandLong(
                target_system=1,
                target_component=1,
                command=511,
                confirmation=0,
                params=(31.0, 5000.0, 0.0, 0.0, 0.0, 0.0, 0.0),
            ),
            {"command": 511, "param1": 31.0, "param2": 5000.0},
        ),
        (
            CommandAck(command=400, result=3, target_system=255, target_component=190),
            {"command": 400, "result": 3, "target_system": 255},
        ),
        (
            ParamValue(
                param_id="SIXTEEN_LETTERS_",
                param_value=0.5,
                param_type=9,
                param_count=48,
                param_index=47,
            ),
            {"param_id": "SIXTEEN_LETTERS_", "param_value": 0.5, "param_index": 47},
        ),
        (
            ParamRequestRead(1, 1, "SYSID_MYGCS", -1),
            {"param_id": "SYSID_MYGCS", "param_index": -1, "target_component": 1},
        ),
        (
            FileTransferProtocol(255, 190, bytes(range(251))),
            {"target_system": 255, "target_component": 190, "payload": list(range(251))},
        ),
        (Timesync(5, -7), {"tc1": 5, "ts1": -7}),
        (StatusText(4, "x" * 50, 3, 1), {"text": "x" * 50, "id": 3, "chunk_seq": 1}),
        (NamedValueFloat(77, "soar_mode", 2.0), {"name": "soar_mode", "value": 2.0}),
        (
            RcChannelsOverride(1, 1, tuple(range(1000, 1018))),
            {f"chan{i}_raw": 999 + i for i in range(1, 19)},
        ),
    ]
    for count, (message, fields) in enumerate(cases):
        back = parsed(encoder.encode(message))
        assert (back.get_srcSystem(), back.get_srcComponent()) == (1, 191)
        assert back.get_seq() == count
        assert {name: getattr(back, name) for name in fields} == fields


def test_each_sender_counts_for_itself_and_wraps() -> None:
    first, second = Encoder(Source(1, 191)), Encoder(Source(255, 191))
    for _ in range(256):
        first.encode(Timesync(1, 1))
    assert parsed(first.encode(Timesync(1, 1))).get_seq() == 0
    assert parsed(second.encode(Timesync(1, 1))).get_seq() == 0


def test_numbers_beyond_32_bits_are_the_largest_and_nan_stays_nan() -> None:
    encoder = Encoder(Source(1, 191))
    assert parsed(encoder.encode(NamedValueFloat(0, "a", 1e300))).value == pytest.approx(
        3.40282e38, rel=1e-5
    )
    assert parsed(encoder.encode(NamedValueFloat(0, "a", -inf))).value == -inf
    assert isnan(parsed(encoder.encode(NamedValueFloat(0, "a", nan))).value)
