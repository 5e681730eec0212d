"""The MAVLink messages that this module speaks and hears, as plain named tuples.

Fields keep MAVLink's own names and units (milliseconds, pulse widths), so that a row here can
be held against the specification; they become SI units and frames of ours in `session`.
Whatever handles them is pure logic and needs no codec in its tests.
"""

from __future__ import annotations

from typing import Final, NamedTuple, TypeAlias

# MAV_TYPE, MAV_AUTOPILOT, MAV_COMP_ID, MAV_MODE_FLAG
TYPE_GCS: Final = 6
TYPE_ONBOARD_CONTROLLER: Final = 18
AUTOPILOT_INVALID: Final = 8
COMPONENT_AUTOPILOT: Final = 1
MODE_FLAG_CUSTOM_MODE: Final = 1
MODE_FLAG_ARMED: Final = 128
STATE_ACTIVE: Final = 4

# MAV_SEVERITY
SEVERITY_CRITICAL: Final = 2
SEVERITY_ERROR: Final = 3
SEVERITY_WARNING: Final = 4
SEVERITY_NOTICE: Final = 5
SEVERITY_INFO: Final = 6

# MAV_CMD and MAV_RESULT
COMMAND_GET_MESSAGE_INTERVAL: Final = 510
COMMAND_SET_MESSAGE_INTERVAL: Final = 511
COMMAND_REQUEST_MESSAGE: Final = 512
COMMAND_REQUEST_AUTOPILOT_CAPABILITIES: Final = 520
COMMAND_USER_1: Final = 31010
COMMAND_USER_2: Final = 31011
COMMAND_USER_3: Final = 31012
RESULT_ACCEPTED: Final = 0
RESULT_TEMPORARILY_REJECTED: Final = 1
RESULT_DENIED: Final = 2
RESULT_UNSUPPORTED: Final = 3
RESULT_FAILED: Final = 4
RESULT_IN_PROGRESS: Final = 5
RESULT_CANCELLED: Final = 6

# MAV_FRAME
FRAME_LOCAL_NED: Final = 1
FRAME_BODY_NED: Final = 8
FRAME_BODY_FRD: Final = 12
FRAME_LOCAL_FRD: Final = 20

# MAV_PARAM_TYPE
PARAM_TYPE_REAL32: Final = 9

# Message numbers of the streams that are asked for
ID_RC_CHANNELS: Final = 65
ID_ATTITUDE_QUATERNION: Final = 31
ID_LOCAL_POSITION_NED: Final = 32
ID_SERVO_OUTPUT_RAW: Final = 36
ID_ODOMETRY: Final = 331

# Message numbers of what we say, for those who ask for it
ID_HEARTBEAT: Final = 0
ID_NAV_CONTROLLER_OUTPUT: Final = 62
ID_AUTOPILOT_VERSION: Final = 148
ID_MESSAGE_INTERVAL: Final = 244
ID_NAMED_VALUE_FLOAT: Final = 251
ID_DEBUG_FLOAT_ARRAY: Final = 350

# MAV_PROTOCOL_CAPABILITY
CAPABILITY_COMMAND_INT: Final = 1 << 3
CAPABILITY_MAVLINK2: Final = 1 << 13
CAPABILITY_PARAM_ENCODE_C_CAST: Final = 1 << 17


class Source(NamedTuple):
    """Who sent a frame."""

    system: int
    component: int


class Heartbeat(NamedTuple):
    type: int
    autopilot: int
    base_mode: int
    custom_mode: int
    system_status: int


class AttitudeQuaternion(NamedTuple):
    time_boot_ms: int
    q1: float  # w; the rotation from FRD to NED
    q2: float
    q3: float
    q4: float
    rollspeed: float
    pitchspeed: float
    yawspeed: float


class LocalPositionNed(NamedTuple):
    time_boot_ms: int
    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float


class Odometry(NamedTuple):
    time_usec: int
    frame_id: int  # of the position and of the quaternion's target
    child_frame_id: int  # of the velocities
    x: float
    y: float
    z: float
    q: tuple[float, float, float, float]
    vx: float
    vy: float
    vz: float
    rollspeed: float
    pitchspeed: float
    yawspeed: float


class ServoOutputRaw(NamedTuple):
    time_usec: int
    port: int
    servos: tuple[int, ...]  # 16 pulse widths [us], 0: not driven


class CommandLong(NamedTuple):
    target_system: int
    target_component: int
    command: int
    confirmation: int
    params: tuple[float, float, float, float, float, float, float]


class CommandInt(NamedTuple):
    """The same with whole numbers for a place; nobody here needs the place."""

    target_system: int
    target_component: int
    command: int
    params: tuple[float, float, float, float]


class CommandAck(NamedTuple):
    command: int
    result: int
    target_system: int
    target_component: int
    progress: int = 0  # of IN_PROGRESS [%], 255: unknown


class RcChannels(NamedTuple):
    chancount: int
    channels: tuple[int, ...]  # 18 pulse widths [us], 65535: not there


class AutopilotVersion(NamedTuple):
    capabilities: int
    flight_sw_version: int  # major, minor, patch and type, a byte each


class MessageInterval(NamedTuple):
    message_id: int
    interval_us: int  # -1: not sent, 0: not available


class DebugFloatArray(NamedTuple):
    time_usec: int
    name: str  # at most 10 characters
    array_id: int
    data: tuple[float, ...]  # at most 58


class NavControllerOutput(NamedTuple):
    nav_roll: float  # [deg]
    nav_pitch: float  # [deg]
    nav_bearing: int  # [deg]
    target_bearing: int  # [deg]
    wp_dist: int  # [m]
    alt_error: float  # [m]
    aspd_error: float  # [m/s]
    xtrack_error: float  # [m]


class ParamRequestList(NamedTuple):
    target_system: int
    target_component: int


class ParamRequestRead(NamedTuple):
    target_system: int
    target_component: int
    param_id: str
    param_index: int  # -1: by name


class ParamSet(NamedTuple):
    target_system: int
    target_component: int
    param_id: str
    param_value: float
    param_type: int


class ParamValue(NamedTuple):
    param_id: str
    param_value: float
    param_type: int
    param_count: int
    param_index: int


PARAM_ERROR_DOES_NOT_EXIST: Final = 1
PARAM_ERROR_VALUE_OUT_OF_RANGE: Final = 2
PARAM_ERROR_PERMISSION_DENIED: Final = 3


class ParamError(NamedTuple):
    target_system: int
    target_component: int
    param_id: str
    param_index: int  # -1: the name says which
    error: int


class Timesync(NamedTuple):
    tc1: int  # 0 in a request
    ts1: int


class SetupSigning(NamedTuple):
    target_system: int
    target_component: int
    secret_key: bytes  # 32
    initial_timestamp: int  # 10 us since 2015


class StatusText(NamedTuple):
    severity: int
    text: str  # at most 50 characters
    id: int = 0  # of a text in several chunks; 0: whole
    chunk_seq: int = 0


class NamedValueFloat(NamedTuple):
    time_boot_ms: int
    name: str  # at most 10 characters
    value: float


class RcChannelsOverride(NamedTuple):
    target_system: int
    target_component: int
    channels: tuple[int, ...]  # 18 pulse widths [us]


Heard: TypeAlias = (
    Heartbeat
    | AttitudeQuaternion
    | LocalPositionNed
    | Odometry
    | ServoOutputRaw
    | CommandLong
    | CommandInt
    | CommandAck
    | RcChannels
    | ParamRequestList
    | ParamRequestRead
    | ParamSet
    | ParamValue
    | SetupSigning
    | Timesync
)

Said: TypeAlias = (
    Heartbeat
    | CommandLong
    | CommandAck
    | ParamRequestRead
    | ParamValue
    | ParamError
    | Timesync
    | StatusText
    | NamedValueFloat
    | RcChannelsOverride
    | AutopilotVersion
    | MessageInterval
    | DebugFloatArray
    | NavControllerOutput
)


class Received(NamedTuple):
    """A message and its sender."""

    source: Source
    message: Heard
