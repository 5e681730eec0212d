"""Our messages as pymavlink's, for its encoder: those that `hot_frames` does not write."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as dialect

from tgl_soar.link.hot_frames import chars, float32
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
    StatusText,
    VisionPositionEstimate,
    WindCov,
)


def _pack_heartbeat(m: Any) -> Any:
    return dialect.MAVLink_heartbeat_message(
        m.type, m.autopilot, m.base_mode, m.custom_mode, m.system_status, 3
    )


def _pack_command_long(m: Any) -> Any:
    return dialect.MAVLink_command_long_message(
        m.target_system, m.target_component, m.command, m.confirmation, *m.params
    )


def _pack_command_ack(m: Any) -> Any:
    return dialect.MAVLink_command_ack_message(
        m.command, m.result, m.progress, 0, m.target_system, m.target_component
    )


def _pack_mission_request_list(m: Any) -> Any:
    return dialect.MAVLink_mission_request_list_message(m.target_system, m.target_component)


def _pack_mission_request_int(m: Any) -> Any:
    return dialect.MAVLink_mission_request_int_message(m.target_system, m.target_component, m.seq)


def _pack_mission_ack(m: Any) -> Any:
    return dialect.MAVLink_mission_ack_message(m.target_system, m.target_component, m.type)


def _pack_param_request_read(m: Any) -> Any:
    return dialect.MAVLink_param_request_read_message(
        m.target_system, m.target_component, chars(m.param_id, 16), m.param_index
    )


def _pack_param_error(m: Any) -> Any:
    return dialect.MAVLink_param_error_message(
        m.target_system,
        m.target_component,
        chars(m.param_id, 16),
        m.param_index,
        m.error,
    )


def _pack_param_value(m: Any) -> Any:
    return dialect.MAVLink_param_value_message(
        chars(m.param_id, 16),
        float32(m.param_value),
        m.param_type,
        m.param_count,
        m.param_index,
    )


def _pack_file_transfer_protocol(m: Any) -> Any:
    return dialect.MAVLink_file_transfer_protocol_message(
        0, m.target_system, m.target_component, list(m.payload)
    )


def _pack_status_text(m: Any) -> Any:
    return dialect.MAVLink_statustext_message(m.severity, chars(m.text, 50), m.id, m.chunk_seq)


def _pack_manual_control(m: Any) -> Any:
    return dialect.MAVLink_manual_control_message(m.target, m.x, m.y, m.z, m.r, 0)


def _pack_set_actuator_control_target(m: Any) -> Any:
    return dialect.MAVLink_set_actuator_control_target_message(
        m.time_usec,
        m.group,
        m.target_system,
        m.target_component,
        list(map(float32, m.controls)),
    )


def _pack_autopilot_version(m: Any) -> Any:
    nothing = [0] * 8
    return dialect.MAVLink_autopilot_version_message(
        capabilities=m.capabilities,
        flight_sw_version=m.flight_sw_version,
        middleware_sw_version=0,
        os_sw_version=0,
        board_version=0,
        flight_custom_version=nothing,
        middleware_custom_version=nothing,
        os_custom_version=nothing,
        vendor_id=0,
        product_id=0,
        uid=0,
    )


def _pack_message_interval(m: Any) -> Any:
    return dialect.MAVLink_message_interval_message(m.message_id, m.interval_us)


def _pack_nav_controller_output(m: Any) -> Any:
    return dialect.MAVLink_nav_controller_output_message(
        m.nav_roll,
        m.nav_pitch,
        m.nav_bearing,
        m.target_bearing,
        m.wp_dist,
        m.alt_error,
        m.aspd_error,
        m.xtrack_error,
    )


def _pack_wind_cov(m: Any) -> Any:
    unknown = float("nan")
    return dialect.MAVLink_wind_cov_message(
        time_usec=m.time_usec,
        wind_x=m.wind_x,
        wind_y=m.wind_y,
        wind_z=m.wind_z,
        # Its variability in a second, and the altitude above the sea.
        var_horiz=unknown,
        var_vert=unknown,
        wind_alt=unknown,
        horiz_accuracy=m.horiz_accuracy,
        vert_accuracy=m.vert_accuracy,
    )


def _pack_odometry(m: Any) -> Any:
    return dialect.MAVLink_odometry_message(
        time_usec=m.time_usec,
        frame_id=m.frame_id,
        child_frame_id=m.child_frame_id,
        x=float32(m.x),
        y=float32(m.y),
        z=float32(m.z),
        q=list(m.q),
        vx=float32(m.vx),
        vy=float32(m.vy),
        vz=float32(m.vz),
        rollspeed=float32(m.rollspeed),
        pitchspeed=float32(m.pitchspeed),
        yawspeed=float32(m.yawspeed),
        pose_covariance=list(map(float32, m.pose_covariance)),
        velocity_covariance=list(map(float32, m.velocity_covariance)),
        reset_counter=0,
        estimator_type=m.estimator_type,
    )


def _pack_vision_position_estimate(m: Any) -> Any:
    pose = map(float32, (m.x, m.y, m.z, m.roll, m.pitch, m.yaw))
    covariance = list(map(float32, m.covariance))
    return dialect.MAVLink_vision_position_estimate_message(m.usec, *pose, covariance)


OUTBOUND: Final[dict[type[Outbound], Callable[[Any], Any]]] = {
    Heartbeat: _pack_heartbeat,
    CommandLong: _pack_command_long,
    CommandAck: _pack_command_ack,
    MissionRequestList: _pack_mission_request_list,
    MissionRequestInt: _pack_mission_request_int,
    MissionAck: _pack_mission_ack,
    ParamRequestRead: _pack_param_request_read,
    ParamError: _pack_param_error,
    ParamValue: _pack_param_value,
    FileTransferProtocol: _pack_file_transfer_protocol,
    StatusText: _pack_status_text,
    ManualControl: _pack_manual_control,
    SetActuatorControlTarget: _pack_set_actuator_control_target,
    AutopilotVersion: _pack_autopilot_version,
    MessageInterval: _pack_message_interval,
    NavControllerOutput: _pack_nav_controller_output,
    WindCov: _pack_wind_cov,
    Odometry: _pack_odometry,
    VisionPositionEstimate: _pack_vision_position_estimate,
}
