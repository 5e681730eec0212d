"""MAVLink's numbers, held against the dialect that pymavlink generates from its specification.

A wrong number is a message that is not understood, or worse another command than was meant.
"""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink import mavftp, mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link import file_transfer, frames, messages, signing
from tgl_soar.link.autopilots import ardupilot, px4

# How our names begin, and theirs.
PREFIXES = {
    "TYPE_": "MAV_TYPE_",
    "AUTOPILOT_": "MAV_AUTOPILOT_",
    "STATE_": "MAV_STATE_",
    "SENSOR_": "MAV_SYS_STATUS_SENSOR_",
    "ESTIMATOR_": "MAV_ESTIMATOR_TYPE_",
    "SEVERITY_": "MAV_SEVERITY_",
    "COMMAND_": "MAV_CMD_",
    "RESULT_": "MAV_RESULT_",
    "FRAME_": "MAV_FRAME_",
    "PARAM_TYPE_": "MAV_PARAM_TYPE_",
    "PARAM_ERROR_": "MAV_PARAM_ERROR_",
    "CAPABILITY_": "MAV_PROTOCOL_CAPABILITY_",
    "ID_": "MAVLINK_MSG_ID_",
}
# Where ours say more than theirs, or theirs is not where its name says.
THEIRS = {
    "AUTOPILOT_ARDUPILOT": "MAV_AUTOPILOT_ARDUPILOTMEGA",
    "AUTOPILOT_PAPARAZZI": "MAV_AUTOPILOT_PPZ",
    "COMPONENT_AUTOPILOT": "MAV_COMP_ID_AUTOPILOT1",
    "MODE_FLAG_CUSTOM_MODE": "MAV_MODE_FLAG_CUSTOM_MODE_ENABLED",
    "MODE_FLAG_STABILIZE": "MAV_MODE_FLAG_STABILIZE_ENABLED",
    "MODE_FLAG_MANUAL_INPUT": "MAV_MODE_FLAG_MANUAL_INPUT_ENABLED",
    "MODE_FLAG_ARMED": "MAV_MODE_FLAG_SAFETY_ARMED",
    "ORIENTATION_DOWN": "MAV_SENSOR_ROTATION_PITCH_270",
    "ESTIMATOR_POSITION_RELATIVE": "ESTIMATOR_POS_HORIZ_REL",
    "ESTIMATOR_POSITION_ABSOLUTE": "ESTIMATOR_POS_HORIZ_ABS",
    "ESTIMATOR_POSITION_CONSTANT": "ESTIMATOR_CONST_POS_MODE",
    "ESTIMATOR_PREDICTS_RELATIVE": "ESTIMATOR_PRED_POS_HORIZ_REL",
    "ESTIMATOR_PREDICTS_ABSOLUTE": "ESTIMATOR_PRED_POS_HORIZ_ABS",
}
# Younger than the dialect, or of no enumeration there: by common.xml of 2025.
LATER = {
    "ID_COMPONENT_METADATA": 397,
    "RESULT_CANCELLED": 6,
    "PARAM_ERROR_DOES_NOT_EXIST": 1,
    "PARAM_ERROR_VALUE_OUT_OF_RANGE": 2,
    "PARAM_ERROR_PERMISSION_DENIED": 3,
    "QUALITY_INVALID": 1,
    "IGNORE_RATES": (
        mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
        | mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
        | mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
    ),
    "IGNORE_THRUST": mavlink.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE,
}
OURS = {
    name: value
    for name, value in vars(messages).items()
    if name.isupper() and isinstance(value, int)
}


def theirs(name: str) -> Any:
    """The number that the dialect has for a name of ours."""
    other = THEIRS.get(name)
    if other is None:
        prefix = max((each for each in PREFIXES if name.startswith(each)), key=len)
        other = PREFIXES[prefix] + name.removeprefix(prefix)
    return getattr(mavlink, other)


@pytest.mark.parametrize("name", sorted(OURS))
def test_every_number_of_the_messages_is_mavlink_s(name: str) -> None:
    assert OURS[name] == (LATER[name] if name in LATER else theirs(name))


def test_what_may_move_the_aircraft_needs_a_signature_that_is_new() -> None:
    names = "COMMAND_INT COMMAND_LONG PARAM_SET SETUP_SIGNING SET_MODE MANUAL_CONTROL"
    wanted = {getattr(mavlink, f"MAVLINK_MSG_ID_{name}") for name in names.split()}
    wanted.add(mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE)
    assert wanted == signing.COMMANDS


def test_a_frame_is_divided_as_pymavlink_divides_it() -> None:
    assert (frames.MARKER_V1, frames.MARKER_V2) == (
        mavlink.PROTOCOL_MARKER_V1,
        mavlink.PROTOCOL_MARKER_V2,
    )
    assert (frames.HEADER_V1, frames.HEADER_V2) == (
        mavlink.HEADER_LEN_V1,
        mavlink.HEADER_LEN_V2,
    )
    assert frames.SIGNED == mavlink.MAVLINK_IFLAG_SIGNED
    assert frames.SIGNATURE == mavlink.MAVLINK_SIGNATURE_BLOCK_LEN
    empty = mavlink.MAVLink_mission_clear_all_message(0, 0).pack(mavlink.MAVLink(None))
    assert len(empty) == frames.HEADER_V2 + 1 + frames.CHECKSUM  # one byte is always sent
    assert len(empty) - 1 == frames.SHORTEST_V2
    assert max(n for n in mavlink.mavlink_map if n <= frames.LARGEST_V1) < 256
    assert frames.LARGEST_V1 == 0xFF  # the number has one byte there


def test_the_opcodes_and_errors_of_file_transfer_are_pymavlink_s() -> None:
    ours = file_transfer
    assert (
        mavftp.OP_TerminateSession,
        mavftp.OP_ResetSessions,
    ) == (ours.TERMINATE, ours.RESET)
    assert (mavftp.OP_ListDirectory, mavftp.OP_OpenFileRO) == (ours.LIST, ours.OPEN)
    assert (mavftp.OP_ReadFile, mavftp.OP_BurstReadFile) == (ours.READ, ours.BURST_READ)
    assert (mavftp.OP_Ack, mavftp.OP_Nack) == (ours.ACK, ours.NAK)
    assert min(ours.ACK, ours.NAK) == ours.FIRST_ANSWER
    errors = mavftp.FtpError
    assert errors.InvalidDataSize.value == ours.INVALID_SIZE
    assert errors.InvalidSession.value == ours.INVALID_SESSION
    assert errors.NoSessionsAvailable.value == ours.NO_SESSIONS
    assert errors.EndOfFile.value == ours.END_OF_FILE
    assert errors.UnknownCommand.value == ours.UNKNOWN_COMMAND
    assert errors.FileNotFound.value == ours.FILE_NOT_FOUND
    payload = mavlink.MAVLink_file_transfer_protocol_message
    assert payload.array_lengths[-1] == ours.PAYLOAD
    assert ours.PAYLOAD - mavftp.HDR_Len == ours.DATA


def test_arduplane_s_modes_have_its_numbers() -> None:
    modes = mavutil.mode_mapping_byname(mavlink.MAV_TYPE_FIXED_WING)
    ours = ardupilot
    assert {
        "MANUAL": ours.MODE_MANUAL,
        "FBWA": ours.MODE_FBWA,
        "GUIDED": ours.MODE_GUIDED,
        "AUTO": ours.MODE_AUTO,
    }.items() <= modes.items()


def test_px4_s_modes_have_its_numbers() -> None:
    """px4_custom_mode.h: main mode and sub mode in the third and fourth byte."""
    ours = {
        "MANUAL": px4.MODE_MANUAL,
        "OFFBOARD": px4.MODE_OFFBOARD,
        "STABILIZED": px4.MODE_STABILIZED,
        "MISSION": px4.MODE_MISSION,
        "RTL": px4.MODE_RETURN,
    }
    for name, number in ours.items():
        assert number == int.from_bytes((0, 0, *mavutil.px4_map[name][1:]), "little"), name


def test_a_message_without_covariance_says_that_it_knows_none() -> None:
    """MAVLink: "first element NaN if unknown"; 21 numbers are the triangle of 6 x 6."""
    first, *others = messages.UNKNOWN_COVARIANCE
    assert first != first
    assert others == [0.0] * (6 * 7 // 2 - 1)
