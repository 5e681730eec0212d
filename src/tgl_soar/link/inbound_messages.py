"""Messages that pymavlink decodes, as ours: those that are used and not read by `hot_frames`.

Nothing untyped leaves this file.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from tgl_soar.link.messages import (
    CommandAck,
    CommandInt,
    CommandLong,
    DistanceSensor,
    EkfStatusReport,
    EstimatorStatus,
    FileTransferProtocol,
    GpsRawInt,
    Heartbeat,
    HomeMessage,
    Inbound,
    MissionCount,
    MissionCurrent,
    MissionItemInt,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    RcChannels,
    SetupSigning,
    SysStatus,
    VfrHud,
    VisionPositionEstimate,
    Wind,
    WindCov,
)


def _heartbeat(m: Any) -> Inbound:
    return Heartbeat(
        type=m.type,
        autopilot=m.autopilot,
        base_mode=m.base_mode,
        custom_mode=m.custom_mode,
        system_status=m.system_status,
    )


def _vision_position_estimate(m: Any) -> Inbound:
    return VisionPositionEstimate(
        usec=m.usec,
        x=m.x,
        y=m.y,
        z=m.z,
        roll=m.roll,
        pitch=m.pitch,
        yaw=m.yaw,
        covariance=tuple(m.covariance),
    )


def _vfr_hud(m: Any) -> Inbound:
    return VfrHud(m.airspeed, m.alt)


def _sys_status(m: Any) -> Inbound:
    return SysStatus(m.onboard_control_sensors_present, m.onboard_control_sensors_health)


def _distance_sensor(m: Any) -> Inbound:
    return DistanceSensor(
        time_boot_ms=m.time_boot_ms,
        min_distance=m.min_distance,
        max_distance=m.max_distance,
        current_distance=m.current_distance,
        id=m.id,
        orientation=m.orientation,
        signal_quality=m.signal_quality,
    )


def _gps_raw_int(m: Any) -> Inbound:
    return GpsRawInt(m.fix_type, m.h_acc, m.v_acc)


def _wind(m: Any) -> Inbound:
    return Wind(m.direction, m.speed)


def _wind_cov(m: Any) -> Inbound:
    return WindCov(
        time_usec=m.time_usec,
        wind_x=m.wind_x,
        wind_y=m.wind_y,
        wind_z=m.wind_z,
        horiz_accuracy=m.horiz_accuracy,
        vert_accuracy=m.vert_accuracy,
    )


def _ekf_status_report(m: Any) -> Inbound:
    return EkfStatusReport(m.flags)


def _estimator_status(m: Any) -> Inbound:
    return EstimatorStatus(m.flags)


def _command_long(m: Any) -> Inbound:
    return CommandLong(
        target_system=m.target_system,
        target_component=m.target_component,
        command=m.command,
        confirmation=m.confirmation,
        params=(m.param1, m.param2, m.param3, m.param4, m.param5, m.param6, m.param7),
    )


def _command_int(m: Any) -> Inbound:
    return CommandInt(
        m.target_system, m.target_component, m.command, (m.param1, m.param2, m.param3, m.param4)
    )


def _rc_channels(m: Any) -> Inbound:
    channels = tuple(int(getattr(m, f"chan{i}_raw")) for i in range(1, 19))
    return RcChannels(m.chancount, channels, m.time_boot_ms)


def _command_ack(m: Any) -> Inbound:
    return CommandAck(
        command=m.command,
        result=m.result,
        target_system=m.target_system,
        target_component=m.target_component,
    )


def _mission_count(m: Any) -> Inbound:
    return MissionCount(m.target_system, m.target_component, m.count)


def _mission_item_int(m: Any) -> Inbound:
    return MissionItemInt(
        target_system=m.target_system,
        target_component=m.target_component,
        seq=m.seq,
        command=m.command,
        x=m.x,
        y=m.y,
    )


def _mission_current(m: Any) -> Inbound:
    return MissionCurrent(m.seq)


def _home_position(m: Any) -> Inbound:
    return HomeMessage(m.latitude, m.longitude, m.altitude)


def _param_request_list(m: Any) -> Inbound:
    return ParamRequestList(m.target_system, m.target_component)


def _param_request_read(m: Any) -> Inbound:
    return ParamRequestRead(m.target_system, m.target_component, m.param_id, m.param_index)


def _param_set(m: Any) -> Inbound:
    return ParamSet(
        target_system=m.target_system,
        target_component=m.target_component,
        param_id=m.param_id,
        param_value=m.param_value,
        param_type=m.param_type,
    )


def _param_value(m: Any) -> Inbound:
    return ParamValue(
        param_id=m.param_id,
        param_value=m.param_value,
        param_type=m.param_type,
        param_count=m.param_count,
        param_index=m.param_index,
    )


def _setup_signing(m: Any) -> Inbound:
    return SetupSigning(
        m.target_system, m.target_component, bytes(m.secret_key), m.initial_timestamp
    )


def _file_transfer_protocol(m: Any) -> Inbound:
    return FileTransferProtocol(m.target_system, m.target_component, bytes(m.payload))


INBOUND: Final[dict[int, Callable[[Any], Inbound]]] = {
    dialect.MAVLINK_MSG_ID_HEARTBEAT: _heartbeat,
    dialect.MAVLINK_MSG_ID_VISION_POSITION_ESTIMATE: _vision_position_estimate,
    dialect.MAVLINK_MSG_ID_VFR_HUD: _vfr_hud,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: _sys_status,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: _gps_raw_int,
    dialect.MAVLINK_MSG_ID_WIND: _wind,
    dialect.MAVLINK_MSG_ID_WIND_COV: _wind_cov,
    dialect.MAVLINK_MSG_ID_DISTANCE_SENSOR: _distance_sensor,
    dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT: _ekf_status_report,
    dialect.MAVLINK_MSG_ID_ESTIMATOR_STATUS: _estimator_status,
    dialect.MAVLINK_MSG_ID_COMMAND_LONG: _command_long,
    dialect.MAVLINK_MSG_ID_COMMAND_INT: _command_int,
    dialect.MAVLINK_MSG_ID_COMMAND_ACK: _command_ack,
    dialect.MAVLINK_MSG_ID_MISSION_COUNT: _mission_count,
    dialect.MAVLINK_MSG_ID_MISSION_ITEM_INT: _mission_item_int,
    dialect.MAVLINK_MSG_ID_MISSION_CURRENT: _mission_current,
    dialect.MAVLINK_MSG_ID_HOME_POSITION: _home_position,
    dialect.MAVLINK_MSG_ID_RC_CHANNELS: _rc_channels,
    dialect.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: _param_request_list,
    dialect.MAVLINK_MSG_ID_PARAM_REQUEST_READ: _param_request_read,
    dialect.MAVLINK_MSG_ID_PARAM_SET: _param_set,
    dialect.MAVLINK_MSG_ID_PARAM_VALUE: _param_value,
    dialect.MAVLINK_MSG_ID_SETUP_SIGNING: _setup_signing,
    dialect.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL: _file_transfer_protocol,
}
