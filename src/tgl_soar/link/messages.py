"""The MAVLink messages that this module sends and receives, as plain named tuples.

Fields keep MAVLink's own names and units (milliseconds, pulse widths), so that a row here can
be held against the specification; they become SI units and frames of ours in `session`.
Whatever handles them is pure logic and needs no codec in its tests.
"""

from __future__ import annotations

from typing import Final, NamedTuple, TypeAlias

# MAV_TYPE, MAV_AUTOPILOT, MAV_COMP_ID, MAV_MODE_FLAG
TYPE_FIXED_WING: Final = 1
TYPE_GCS: Final = 6
TYPE_ONBOARD_CONTROLLER: Final = 18
AUTOPILOT_ARDUPILOT: Final = 3
AUTOPILOT_INVALID: Final = 8
AUTOPILOT_PX4: Final = 12
AUTOPILOT_PAPARAZZI: Final = 9
COMPONENT_AUTOPILOT: Final = 1
MODE_FLAG_CUSTOM_MODE: Final = 1
MODE_FLAG_STABILIZE: Final = 16
MODE_FLAG_MANUAL_INPUT: Final = 64
MODE_FLAG_ARMED: Final = 128
STATE_BOOT: Final = 1
STATE_STANDBY: Final = 3
STATE_ACTIVE: Final = 4
STATE_CRITICAL: Final = 5
STATE_EMERGENCY: Final = 6
SENSOR_DIFFERENTIAL_PRESSURE: Final = 16  # MAV_SYS_STATUS_SENSOR: a pitot tube
ESTIMATOR_VISION: Final = 2  # MAV_ESTIMATOR_TYPE
ORIENTATION_DOWN: Final = 25  # MAV_SENSOR_ROTATION_PITCH_270
QUALITY_INVALID: Final = 1  # DISTANCE_SENSOR.signal_quality: 0 is not reported

# EKF_STATUS_FLAGS and ESTIMATOR_STATUS_FLAGS
ESTIMATOR_POSITION_RELATIVE: Final = 1 << 3
ESTIMATOR_POSITION_ABSOLUTE: Final = 1 << 4
ESTIMATOR_POSITION_CONSTANT: Final = 1 << 7
ESTIMATOR_PREDICTS_RELATIVE: Final = 1 << 8
ESTIMATOR_PREDICTS_ABSOLUTE: Final = 1 << 9

# MAV_SEVERITY
SEVERITY_CRITICAL: Final = 2
SEVERITY_ERROR: Final = 3
SEVERITY_WARNING: Final = 4
SEVERITY_NOTICE: Final = 5
SEVERITY_INFO: Final = 6

# MAV_CMD and MAV_RESULT
COMMAND_NAV_LAND: Final = 21
COMMAND_DO_SET_MODE: Final = 176
COMMAND_DO_LAND_START: Final = 189
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
PARAM_TYPE_UINT8: Final = 1
PARAM_TYPE_UINT32: Final = 5
PARAM_TYPE_INT32: Final = 6
PARAM_TYPE_REAL32: Final = 9

# ATTITUDE_TARGET_TYPEMASK
IGNORE_RATES: Final = 7
IGNORE_THRUST: Final = 64

# Message numbers of the streams that are asked for
ID_SYS_STATUS: Final = 1
ID_MISSION_CURRENT: Final = 42
ID_SCALED_IMU: Final = 26
ID_RAW_IMU: Final = 27
ID_ATTITUDE_QUATERNION: Final = 31
ID_LOCAL_POSITION_NED: Final = 32
ID_GLOBAL_POSITION_INT: Final = 33
ID_SERVO_OUTPUT_RAW: Final = 36
ID_RC_CHANNELS: Final = 65
ID_RC_CHANNELS_OVERRIDE: Final = 70
ID_VFR_HUD: Final = 74
ID_SET_ATTITUDE_TARGET: Final = 82
ID_VISION_POSITION_ESTIMATE: Final = 102
ID_HIGHRES_IMU: Final = 105
ID_TIMESYNC: Final = 111
ID_SCALED_IMU2: Final = 116
ID_SCALED_IMU3: Final = 129
ID_GPS_RAW_INT: Final = 24
ID_DISTANCE_SENSOR: Final = 132
ID_EKF_STATUS_REPORT: Final = 193
ID_ESTIMATOR_STATUS: Final = 230
ID_ODOMETRY: Final = 331
ID_WIND: Final = 168
ID_WIND_COV: Final = 231  # sent, too

# Numbers of messages that we send, for stations that ask for them
ID_HEARTBEAT: Final = 0
ID_NAV_CONTROLLER_OUTPUT: Final = 62
ID_AUTOPILOT_VERSION: Final = 148
ID_HOME_POSITION: Final = 242
ID_MESSAGE_INTERVAL: Final = 244
ID_NAMED_VALUE_FLOAT: Final = 251
ID_DEBUG_FLOAT_ARRAY: Final = 350
ID_COMPONENT_METADATA: Final = 397

# MAV_PROTOCOL_CAPABILITY
CAPABILITY_COMMAND_INT: Final = 1 << 3
CAPABILITY_FTP: Final = 1 << 5
CAPABILITY_MAVLINK2: Final = 1 << 13
CAPABILITY_PARAM_ENCODE_C_CAST: Final = 1 << 17


# A covariance of which nothing is known.
UNKNOWN_COVARIANCE: Final = (float("nan"), *(0.0,) * 20)


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
    # Upper triangles of 6 x 6, row by row; NaN in the first: unknown.
    pose_covariance: tuple[float, ...] = UNKNOWN_COVARIANCE
    velocity_covariance: tuple[float, ...] = UNKNOWN_COVARIANCE
    estimator_type: int = 0


class VisionPositionEstimate(NamedTuple):
    usec: int  # of the sender's clock
    x: float
    y: float
    z: float
    roll: float
    pitch: float
    yaw: float
    covariance: tuple[float, ...] = UNKNOWN_COVARIANCE  # upper triangle of 6 x 6, row by row


class GlobalPositionInt(NamedTuple):
    time_boot_ms: int
    lat: int  # [deg 1e-7]
    lon: int
    alt: int  # above mean sea level [mm]
    vx: int  # [cm/s], NED
    vy: int
    vz: int


class HighresImu(NamedTuple):
    time_usec: int
    xacc: float  # [m/s2]
    yacc: float
    zacc: float
    xgyro: float  # [rad/s]
    ygyro: float
    zgyro: float
    abs_pressure: float  # [hPa]
    diff_pressure: float  # [hPa]
    temperature: float  # [degC]
    fields_updated: int


class ScaledImu(NamedTuple):
    """SCALED_IMU, SCALED_IMU2 and SCALED_IMU3."""

    message_id: int  # which of the three
    time_boot_ms: int
    xacc: int  # [mG]
    yacc: int
    zacc: int
    xgyro: int  # [mrad/s]
    ygyro: int
    zgyro: int


class RawImu(NamedTuple):
    time_usec: int
    xacc: int  # no unit by the definition; the firmware says
    yacc: int
    zacc: int
    xgyro: int
    ygyro: int
    zgyro: int


class VfrHud(NamedTuple):
    airspeed: float  # [m/s]
    alt: float  # above mean sea level [m]


class SysStatus(NamedTuple):
    sensors_present: int  # MAV_SYS_STATUS_SENSOR
    sensors_health: int


class EkfStatusReport(NamedTuple):
    """ArduPilot's; of it the flags alone."""

    flags: int  # EKF_STATUS_FLAGS


class EstimatorStatus(NamedTuple):
    """PX4's; of it the flags alone."""

    flags: int  # ESTIMATOR_STATUS_FLAGS, which are the same where both are used here


class GpsRawInt(NamedTuple):
    """Of it the receiver's own accuracy."""

    fix_type: int  # GPS_FIX_TYPE
    h_acc: int  # mm; 0 or all bits: not reported
    v_acc: int  # mm, likewise


class DistanceSensor(NamedTuple):
    time_boot_ms: int
    min_distance: int  # cm
    max_distance: int  # cm
    current_distance: int  # cm
    id: int  # of the sensor, among those of one autopilot
    orientation: int  # MAV_SENSOR_ORIENTATION
    signal_quality: int  # 0: not reported, 1: no valid signal, else in per cent


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


class MissionCount(NamedTuple):
    target_system: int
    target_component: int
    items: int  # MAVLink: count


class MissionItemInt(NamedTuple):
    target_system: int
    target_component: int
    seq: int
    command: int
    x: int  # latitude [1e-7 deg]
    y: int  # longitude


class MissionCurrent(NamedTuple):
    seq: int


class HomeMessage(NamedTuple):
    """HOME_POSITION."""

    latitude: int  # [1e-7 deg]
    longitude: int
    altitude: int  # over the sea [mm]


class MissionRequestList(NamedTuple):
    target_system: int
    target_component: int


class MissionRequestInt(NamedTuple):
    target_system: int
    target_component: int
    seq: int


class MissionAck(NamedTuple):
    target_system: int
    target_component: int
    type: int  # MAV_MISSION_RESULT, 0: accepted


class RcChannels(NamedTuple):
    chancount: int
    channels: tuple[int, ...]  # 18 pulse widths [us], 65535: not there
    time_boot_ms: int = 0  # 0: not known


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


class ComponentMetadata(NamedTuple):
    time_boot_ms: int
    file_crc: int  # of the general file
    uri: str  # of it, at most 99 characters


class NavControllerOutput(NamedTuple):
    nav_roll: float  # [deg]
    nav_pitch: float  # [deg]
    nav_bearing: int  # [deg]
    target_bearing: int  # [deg]
    wp_dist: int  # [m]
    alt_error: float  # [m]
    aspd_error: float  # [m/s]
    xtrack_error: float  # [m]


class Wind(NamedTuple):
    direction: float  # that it blows from [deg]
    speed: float  # ArduPlane: of all three components [m/s]


class WindCov(NamedTuple):
    time_usec: int  # [us]
    wind_x: float  # north [m/s]
    wind_y: float  # east [m/s]
    wind_z: float  # down [m/s]
    horiz_accuracy: float  # standard deviation [m/s]
    vert_accuracy: float  # standard deviation [m/s]


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


class FileTransferProtocol(NamedTuple):
    target_system: int
    target_component: int
    payload: bytes  # 251


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


class SetAttitudeTarget(NamedTuple):
    time_boot_ms: int
    target_system: int
    target_component: int
    type_mask: int
    q: tuple[float, float, float, float]  # FRD to NED


class ManualControl(NamedTuple):
    target: int
    x: int  # -1000 … 1000
    y: int
    z: int
    r: int


class SetActuatorControlTarget(NamedTuple):
    time_usec: int
    target_system: int
    target_component: int
    group: int
    controls: tuple[float, float, float, float, float, float, float, float]  # -1 … 1


Inbound: TypeAlias = (
    Heartbeat
    | AttitudeQuaternion
    | LocalPositionNed
    | GlobalPositionInt
    | Odometry
    | VisionPositionEstimate
    | HighresImu
    | ScaledImu
    | RawImu
    | VfrHud
    | SysStatus
    | EkfStatusReport
    | EstimatorStatus
    | DistanceSensor
    | GpsRawInt
    | Wind
    | WindCov
    | ServoOutputRaw
    | CommandLong
    | CommandInt
    | CommandAck
    | MissionCount
    | MissionItemInt
    | MissionCurrent
    | HomeMessage
    | RcChannels
    | ParamRequestList
    | ParamRequestRead
    | ParamSet
    | ParamValue
    | SetupSigning
    | FileTransferProtocol
    | Timesync
)

Outbound: TypeAlias = (
    Heartbeat
    | CommandLong
    | CommandAck
    | MissionRequestList
    | MissionRequestInt
    | MissionAck
    | ParamRequestRead
    | ParamValue
    | ParamError
    | FileTransferProtocol
    | Timesync
    | StatusText
    | NamedValueFloat
    | RcChannelsOverride
    | SetAttitudeTarget
    | ManualControl
    | SetActuatorControlTarget
    | AutopilotVersion
    | MessageInterval
    | DebugFloatArray
    | ComponentMetadata
    | NavControllerOutput
    | WindCov
    | Odometry
    | VisionPositionEstimate
)


class Received(NamedTuple):
    """A message and its sender."""

    source: Source
    message: Inbound
