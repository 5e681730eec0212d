"""Every message that pymavlink packs for us, read back by it: all fields, those that we leave at
zero too.

A number in another field's place is a message of another meaning: a severity for an index, a
buttons' mask for a stick.
"""

from __future__ import annotations

from math import inf, isnan, nan
from typing import Any, get_args

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.encoder import Encoder
from tgl_soar.link.hot_frames import WRITERS
from tgl_soar.link.messages import (
    AutopilotVersion,
    CommandAck,
    CommandLong,
    FileTransferProtocol,
    Heartbeat,
    ManualControl,
    MessageInterval,
    MissionAck,
    MissionRequestInt,
    MissionRequestList,
    NavControllerOutput,
    Odometry,
    Outbound,
    ParamError,
    ParamRequestRead,
    ParamValue,
    SetActuatorControlTarget,
    Source,
    StatusText,
    VisionPositionEstimate,
    WindCov,
)
from tgl_soar.link.outbound_messages import OUTBOUND

US = Source(1, 191)
TRIANGLE = 6 * 7 // 2  # of a covariance of 6 x 6
LARGEST_FLOAT32 = (2.0 - 2.0**-23) * 2.0**127  # IEEE 754

POSE = tuple(0.5 + i for i in range(TRIANGLE))
VELOCITY = tuple(-0.25 * (1 + i) for i in range(TRIANGLE))
SOFTWARE = ("flight", "middleware", "os")
# Not of the fence and not of the rally points.
ITEMS_OF_A_MISSION: dict[str, object] = {"mission_type": mavlink.MAV_MISSION_TYPE_MISSION}


def read_back(message: Outbound) -> dict[str, Any]:
    """All fields of a frame of ours, by the names of the specification."""
    frame = Encoder(US).encode(message)
    fields: dict[str, Any] = mavlink.MAVLink(None).decode(bytearray(frame)).to_dict()
    return fields


# Numbers that single precision holds exactly, no two of them the same in one message.  Beside each
# are the fields that ours lack or call otherwise.
CASES: list[tuple[Outbound, dict[str, object]]] = [
    (
        Heartbeat(type=18, autopilot=8, base_mode=81, custom_mode=70000, system_status=4),
        {"mavlink_version": 3},  # common.xml: <version>3</version>
    ),
    (
        CommandLong(
            target_system=7,
            target_component=1,
            command=511,
            confirmation=2,
            params=(1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.5),
        ),
        {f"param{i}": i + 0.5 for i in range(1, 8)},
    ),
    (
        CommandAck(command=400, result=5, target_system=255, target_component=190, progress=60),
        {"result_param2": 0},  # only some commands have one: none of those that we answer
    ),
    (MissionRequestList(target_system=7, target_component=3), ITEMS_OF_A_MISSION),
    (MissionRequestInt(target_system=7, target_component=3, seq=300), ITEMS_OF_A_MISSION),
    (MissionAck(target_system=7, target_component=3, type=15), ITEMS_OF_A_MISSION),
    (ParamRequestRead(7, 3, "SYSID_MYGCS", -1), {}),
    (
        ParamError(
            target_system=255,
            target_component=190,
            param_id="SIXTEEN_LETTERS_",
            param_index=300,
            error=2,
        ),
        {},
    ),
    (
        ParamValue(
            param_id="TGL_SPEED", param_value=0.5, param_type=9, param_count=480, param_index=470
        ),
        {},
    ),
    (
        FileTransferProtocol(255, 190, bytes(range(251))),
        {"target_network": 0, "payload": list(range(251))},  # "0 for broadcast"
    ),
    (StatusText(4, "no lift", 300, 2), {}),
    (
        ManualControl(target=7, x=-1000, y=500, z=250, r=-125),
        {  # no button is pressed, and no further axis is there
            "buttons": 0,
            "buttons2": 0,
            "enabled_extensions": 0,
            **dict.fromkeys(("s", "t", "aux1", "aux2", "aux3", "aux4", "aux5", "aux6"), 0),
        },
    ),
    (
        SetActuatorControlTarget(
            time_usec=2**40 + 1,
            group=1,
            target_system=7,
            target_component=3,
            controls=(-1.0, 1.0, 0.5, -0.5, 0.25, -0.25, 0.125, -0.125),
        ),
        {"group_mlx": 1},
    ),
    (
        AutopilotVersion(capabilities=2**33 + 2, flight_sw_version=0x01020304),
        {  # nothing is known of hardware and of other software, and zero says so
            **dict.fromkeys(("middleware_sw_version", "os_sw_version", "board_version"), 0),
            **dict.fromkeys((f"{of}_custom_version" for of in SOFTWARE), [0] * 8),
            **dict.fromkeys(("vendor_id", "product_id", "uid"), 0),
            "uid2": [0] * 18,
        },
    ),
    (MessageInterval(message_id=300, interval_us=-1), {}),
    (
        NavControllerOutput(
            nav_roll=1.5,
            nav_pitch=-2.5,
            nav_bearing=-170,
            target_bearing=170,
            wp_dist=65000,
            alt_error=3.5,
            aspd_error=-4.5,
            xtrack_error=5.5,
        ),
        {},
    ),
    (
        Odometry(
            time_usec=2**40 + 1,
            frame_id=1,
            child_frame_id=8,
            x=1.5,
            y=2.5,
            z=-3.5,
            q=(0.5, -0.5, 0.25, -0.25),
            vx=4.5,
            vy=5.5,
            vz=-6.5,
            rollspeed=0.125,
            pitchspeed=-0.125,
            yawspeed=0.375,
            pose_covariance=POSE,
            velocity_covariance=VELOCITY,
            estimator_type=mavlink.MAV_ESTIMATOR_TYPE_MOCAP,
        ),
        {"reset_counter": 0, "quality": 0},  # it has never leapt; "0 means unknown/unset"
    ),
    (
        VisionPositionEstimate(
            usec=2**40 + 1,
            x=1.5,
            y=2.5,
            z=-3.5,
            roll=0.25,
            pitch=-0.5,
            yaw=0.75,
            covariance=POSE,
        ),
        {"reset_counter": 0},
    ),
]
OTHERWISE = frozenset(("params", "group"))  # names of ours that are not the specification's


@pytest.mark.parametrize(
    ("message", "fields"), [pytest.param(m, f, id=type(m).__name__) for m, f in CASES]
)
def test_every_field_stands_in_its_own_place(message: Outbound, fields: dict[str, object]) -> None:
    ours = message._asdict().items()
    same = {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in ours
        if name not in OTHERWISE
    }
    back = read_back(message)
    kind = back.pop("mavpackettype")
    assert kind.replace("_", "").lower() == type(message).__name__.lower()
    assert back == same | fields


def test_the_wind_is_sent_with_what_is_known_of_it_and_nan_for_the_rest() -> None:
    """common.xml: each number of WIND_COV that is not known is NaN; a 0 would be a measurement."""
    wind = WindCov(
        time_usec=2**40 + 1,
        wind_x=1.5,
        wind_y=-2.5,
        wind_z=0.5,
        horiz_accuracy=0.25,
        vert_accuracy=0.125,
    )
    fields = read_back(wind)
    unknown = {name for name, value in fields.items() if value != value}
    assert unknown == {"var_horiz", "var_vert", "wind_alt"}
    assert {name: value for name, value in fields.items() if name not in unknown} == {
        "mavpackettype": "WIND_COV",
        **wind._asdict(),
    }


def test_every_message_of_ours_has_one_writer() -> None:
    assert set(get_args(Outbound)) == {*OUTBOUND, *WRITERS}
    assert not {*OUTBOUND} & {*WRITERS}
    assert {type(message) for message, _ in CASES} | {WindCov} == {*OUTBOUND}


def test_a_text_or_a_name_that_is_too_long_is_cut_and_what_is_not_ascii_is_replaced() -> None:
    """MAVLink: `char[50]` and `char[16]`, without a zero where they are full."""
    assert read_back(StatusText(4, "é" + "x" * 60))["text"] == "?" + "x" * 49
    name = "A" * 15 + "BC"
    kept = "A" * 15 + "B"
    assert read_back(ParamRequestRead(1, 1, name, 0))["param_id"] == kept
    error = ParamError(target_system=1, target_component=1, param_id=name, param_index=0, error=1)
    assert read_back(error)["param_id"] == kept
    value = ParamValue(param_id=name, param_value=0.0, param_type=9, param_count=1, param_index=0)
    assert read_back(value)["param_id"] == kept


def numbers_of(value: float) -> list[tuple[Outbound, set[str]]]:
    """Messages that carry what a law or a tracker has computed, and the fields that it is in."""
    many = (value,) * TRIANGLE
    eight = (value, value, value, value, value, value, value, value)
    return [
        (
            ParamValue(
                param_id="X", param_value=value, param_type=9, param_count=1, param_index=0
            ),
            {"param_value"},
        ),
        (
            SetActuatorControlTarget(
                time_usec=0, group=0, target_system=1, target_component=1, controls=eight
            ),
            {"controls"},
        ),
        (
            Odometry(
                time_usec=0,
                frame_id=1,
                child_frame_id=8,
                x=value,
                y=value,
                z=value,
                q=(1.0, 0.0, 0.0, 0.0),
                vx=value,
                vy=value,
                vz=value,
                rollspeed=value,
                pitchspeed=value,
                yawspeed=value,
                pose_covariance=many,
                velocity_covariance=many,
            ),
            {
                *{"x", "y", "z", "vx", "vy", "vz", "rollspeed", "pitchspeed", "yawspeed"},
                *{"pose_covariance", "velocity_covariance"},
            },
        ),
        (
            VisionPositionEstimate(
                usec=0, x=value, y=value, z=value, roll=value, pitch=value, yaw=value,
                covariance=many,
            ),
            {"x", "y", "z", "roll", "pitch", "yaw", "covariance"},
        ),
    ]  # fmt: skip


@pytest.mark.parametrize("case", range(len(numbers_of(0.0))))
@pytest.mark.parametrize(
    ("value", "sent"), [(1e300, LARGEST_FLOAT32), (-1e300, -LARGEST_FLOAT32), (inf, inf)]
)
def test_a_number_beyond_single_precision_is_the_largest_and_infinity_stays(
    case: int, value: float, sent: float
) -> None:
    message, names = numbers_of(value)[case]
    fields = read_back(message)
    for name in names:
        got = fields[name]
        for each in got if isinstance(got, list) else [got]:
            assert each == pytest.approx(sent, rel=1e-7), name


@pytest.mark.parametrize("case", range(len(numbers_of(0.0))))
def test_what_is_no_number_stays_none(case: int) -> None:
    message, names = numbers_of(nan)[case]
    fields = read_back(message)
    for name in names:
        got = fields[name]
        assert all(isnan(each) for each in (got if isinstance(got, list) else [got])), name
