"""The messages that the autopilot reports of itself: what is sensed, its servos, its status."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from math import degrees, inf, isfinite, nan, pi
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.site import HomePosition
from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.sim.channels import CHANNELS
from tgl_soar.sim.sensor_messages import (
    ShownAirspeed,
    attitude_quaternion,
    distance_sensor,
    global_position,
    gps_raw_int,
    highres_imu,
    local_position_ned,
    raw_imu,
    scaled_imu,
)
from tgl_soar.sim.sensors import LASER_RANGE
from tgl_soar.sim.vehicle.modes import FlightStatus
from tgl_soar.sim.vehicle.sensed import GROUNDED, Sensed
from tgl_soar.sim.vehicle.surface_outputs import SurfaceOutputs
from tgl_soar.sim.vehicle.vehicle_clock import VehicleClock
from tgl_soar.types import AttitudeSample

_EKF_ATTITUDE_AND_HEIGHT: Final = (
    mavlink.EKF_ATTITUDE | mavlink.EKF_VELOCITY_VERT | mavlink.EKF_POS_VERT_ABS
)
_EKF_RELATIVE: Final = (
    mavlink.EKF_VELOCITY_HORIZ | mavlink.EKF_POS_HORIZ_REL | mavlink.EKF_PRED_POS_HORIZ_REL
)
_EKF_ABSOLUTE: Final = mavlink.EKF_POS_HORIZ_ABS | mavlink.EKF_PRED_POS_HORIZ_ABS
RECEIVER_ACCURACY_M: Final = (0.8, 1.2)  # as a receiver reports it under an open sky
_ATTITUDES_KEPT: Final = 128  # of which ODOMETRY takes the one nearest to its position

_ATTITUDE_STREAMS: Final = frozenset(
    {mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, mavlink.MAVLINK_MSG_ID_ATTITUDE}
)
_POSITION_STREAMS: Final = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_ODOMETRY,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
    }
)
_IMU_STREAMS: Final = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_RAW_IMU,
        mavlink.MAVLINK_MSG_ID_SCALED_IMU,
        mavlink.MAVLINK_MSG_ID_HIGHRES_IMU,
    }
)


class VehicleReports:
    """Builds each message from the latest that is known.

    home              where local NED has its origin; None: it has never had a fix
    allow_odometry    stream ODOMETRY, and HIGHRES_IMU, as PX4 does; ArduPlane denies the one
    """

    def __init__(
        self,
        clock: VehicleClock,
        status: FlightStatus,
        outputs: SurfaceOutputs,
        home: HomePosition | None,
        *,
        allow_odometry: bool,
    ) -> None:
        self.sensed = GROUNDED  # as the messages report it
        self._clock = clock
        self._status = status
        self._outputs = outputs
        self._home = home
        self._px4 = allow_odometry
        self._attitudes: deque[AttitudeSample] = deque(maxlen=_ATTITUDES_KEPT)
        self._shown = ShownAirspeed()
        self._pitot_reported = 0  # sequence of the sample that went out in HIGHRES_IMU
        self.streamable: Mapping[int, Callable[[], Any]] = self._stream_table()
        self._once: Mapping[int, Callable[[], Any]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self.heartbeat,
            mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: _version,
        }

    def take(self, sensed: Sensed) -> None:
        """What is reported from now on."""
        if sensed.attitude.sequence != self.sensed.attitude.sequence:
            self._attitudes.append(sensed.attitude)
        self.sensed = sensed
        self._shown.step(self._clock.time_s, sensed.pitot, self._height_m)

    def forget(self) -> None:
        """The autopilot starts without memory."""
        self._attitudes.clear()
        self.sensed = GROUNDED._replace(flying=self.sensed.flying)

    def build(self, message_id: int) -> Any | None:
        """A message as it would go out now; None where there is none, or no sample for it."""
        if self.sequence(message_id) == 0:
            return None
        build = self.streamable.get(message_id) or self._once.get(message_id)
        return None if build is None else build()

    def sequence(self, message_id: int) -> int:
        """Which sample a message would carry now; 0: none has come yet."""
        if message_id in _ATTITUDE_STREAMS:
            return self.sensed.attitude.sequence
        if message_id in _POSITION_STREAMS:
            return self.sensed.position.sequence
        if message_id in _IMU_STREAMS:
            return self.sensed.imu.sequence
        if message_id == mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR:
            return self.sensed.rangefinder.sequence
        return self._clock.steps + 1

    def heartbeat(self) -> Any:
        """HEARTBEAT of a fixed wing under ArduPilot."""
        base_mode = (
            mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
            | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        )
        if self._status.armed:
            base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_FIXED_WING,
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            base_mode,
            self._status.mode,
            mavlink.MAV_STATE_ACTIVE if self._status.armed else mavlink.MAV_STATE_STANDBY,
            3,
        )

    def _stream_table(self) -> dict[int, Callable[[], Any]]:
        table: dict[int, Callable[[], Any]] = {
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: self._system_time,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: self._attitude_quaternion,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._local_position,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._global_position,
            mavlink.MAVLINK_MSG_ID_RAW_IMU: self._raw_imu,
            mavlink.MAVLINK_MSG_ID_SCALED_IMU: self._scaled_imu,
            mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: self._highres_imu,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: self._vfr_hud,
            mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self._ekf_status,
            mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: self._servo_output,
            mavlink.MAVLINK_MSG_ID_RC_CHANNELS: self._rc_channels,
            mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR: self._distance_sensor,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: self._gps_raw,
        }
        if self._px4:
            table[mavlink.MAVLINK_MSG_ID_ODOMETRY] = self._odometry
        return table

    def _sys_status(self) -> Any:
        # 11.4 V, no current measured, charge unknown: enough for a ground station's display.
        has = 0
        if self.sensed.imu.sequence:
            has |= mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
        if self.sensed.pitot.sequence:
            has |= mavlink.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE
        return mavlink.MAVLink_sys_status_message(
            onboard_control_sensors_present=has,
            onboard_control_sensors_enabled=has,
            onboard_control_sensors_health=has,
            load=250,
            voltage_battery=11400,
            current_battery=-1,
            battery_remaining=-1,
            drop_rate_comm=0,
            errors_comm=0,
            errors_count1=0,
            errors_count2=0,
            errors_count3=0,
            errors_count4=0,
        )

    def _ekf_status(self) -> Any:
        """As EKF3's: aided, aided by the wind alone, or not at all; its variances are not known."""
        flags = _EKF_ATTITUDE_AND_HEIGHT
        if self.sensed.position.sequence == 0:
            flags |= mavlink.EKF_CONST_POS_MODE
        else:
            flags |= _EKF_RELATIVE
            flags |= 0 if self.sensed.position.reckoned else _EKF_ABSOLUTE
        return mavlink.MAVLink_ekf_status_report_message(flags, 0.0, 0.0, 0.0, 0.0, 0.0)

    def _system_time(self) -> Any:
        return mavlink.MAVLink_system_time_message(0, self._clock.boot_ms(self._clock.time_s))

    def _attitude_quaternion(self) -> Any:
        sample = self.sensed.attitude
        return attitude_quaternion(sample, self._clock.boot_ms(sample.time_s))

    def _attitude(self) -> Any:
        sample = self.sensed.attitude
        return mavlink.MAVLink_attitude_message(
            self._clock.boot_ms(sample.time_s),
            *euler_from_quaternion(*sample.quaternion),
            *sample.rates_frd_radps,
        )

    def _local_position(self) -> Any:
        fix = self.sensed.position
        return local_position_ned(fix, self._clock.boot_ms(fix.time_s))

    def _odometry(self) -> Any:
        fix = self.sensed.position
        attitude = self._attitude_at(fix.time_s)
        unknown = [nan] + [0.0] * 20
        velocity = fix.velocity_north_mps, fix.velocity_east_mps, fix.velocity_down_mps
        vx, vy, vz = _body_from_ned(attitude, *velocity)
        return mavlink.MAVLink_odometry_message(
            time_usec=self._clock.boot_us(fix.time_s),
            frame_id=mavlink.MAV_FRAME_LOCAL_NED,
            child_frame_id=mavlink.MAV_FRAME_BODY_FRD,
            x=fix.north_m,
            y=fix.east_m,
            z=fix.down_m,
            q=[attitude.qw, attitude.qx, attitude.qy, attitude.qz],
            vx=vx,
            vy=vy,
            vz=vz,
            rollspeed=attitude.roll_rate_frd_radps,
            pitchspeed=attitude.pitch_rate_frd_radps,
            yawspeed=attitude.yaw_rate_frd_radps,
            pose_covariance=unknown,
            velocity_covariance=unknown,
        )

    def _attitude_at(self, time_s: float) -> AttitudeSample:
        """The attitude nearest to the time of a fix: ODOMETRY carries both as one."""
        nearest, distance = self.sensed.attitude, inf
        for sample in reversed(self._attitudes):
            if abs(sample.time_s - time_s) >= distance:
                break
            nearest, distance = sample, abs(sample.time_s - time_s)
        return nearest

    def _vfr_hud(self) -> Any:
        fix, attitude = self.sensed.position, self.sensed.attitude
        _, _, yaw = euler_from_quaternion(*attitude.quaternion)
        north, east, down = (0.0 if v != v else v for v in fix.velocity_ned_mps)
        shown = self.sensed.pitot.sequence > 0  # else an estimate, which looks just the same
        return mavlink.MAVLink_vfr_hud_message(
            self._shown.equivalent_mps if shown else self.sensed.airspeed_mps,
            (north * north + east * east) ** 0.5,
            round(degrees(yaw % (2.0 * pi))) % 360 if isfinite(yaw) else 0,
            0,
            self._height_m,
            -down,
        )

    @property
    def _height_m(self) -> float:
        """Above mean sea level."""
        above_m = -self.sensed.position.down_m
        return above_m if self._home is None else self._home.altitude_m + above_m

    def _global_position(self) -> Any:
        fix = self.sensed.position
        _, _, yaw = euler_from_quaternion(*self.sensed.attitude.quaternion)
        return global_position(fix, self._home, self._clock.boot_ms(fix.time_s), yaw)

    def _gps_raw(self) -> Any:
        fix = self.sensed.position
        time_us = self._clock.boot_us(fix.time_s)
        return gps_raw_int(fix, self._home, time_us, RECEIVER_ACCURACY_M)

    def _raw_imu(self) -> Any:
        sample = self.sensed.imu
        return raw_imu(sample, self._clock.boot_us(sample.time_s))

    def _scaled_imu(self) -> Any:
        sample = self.sensed.imu
        return scaled_imu(sample, self._clock.boot_ms(sample.time_s))

    def _highres_imu(self) -> Any:
        sample, pitot = self.sensed.imu, self.sensed.pitot
        new = pitot.sequence != self._pitot_reported
        self._pitot_reported = pitot.sequence
        time_us = self._clock.boot_us(sample.time_s)
        return highres_imu(sample, time_us, self._height_m, pitot, px4=self._px4, new=new)

    def _distance_sensor(self) -> Any:
        sample = self.sensed.rangefinder
        return distance_sensor(sample, LASER_RANGE, self._clock.boot_ms(sample.time_s))

    def _servo_output(self) -> Any:
        time_us = self._clock.boot_us(self._clock.time_s) & 0xFFFFFFFF
        pwm = self._outputs.servo_pwm
        return mavlink.MAVLink_servo_output_raw_message(time_us, 0, *pwm[:8], *pwm[8:16])

    def _rc_channels(self) -> Any:
        return mavlink.MAVLink_rc_channels_message(
            self._clock.boot_ms(self._clock.time_s), CHANNELS, *self._outputs.channel_pwm, 254
        )


def _version() -> Any:
    return mavlink.MAVLink_autopilot_version_message(
        capabilities=mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
        | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
        | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT,
        # The release whose behaviour this follows.
        flight_sw_version=(4 << 24) | (6 << 16) | (3 << 8) | 255,
        middleware_sw_version=0,
        os_sw_version=0,
        board_version=0,
        flight_custom_version=[0] * 8,
        middleware_custom_version=[0] * 8,
        os_custom_version=[0] * 8,
        vendor_id=0,
        product_id=0,
        uid=0,
    )


def _body_from_ned(
    attitude: AttitudeSample, north: float, east: float, down: float
) -> tuple[float, float, float]:
    """A NED vector in FRD: the rows of the attitude's rotation matrix, transposed."""
    _, _, w, x, y, z, *_ = attitude
    return (
        (1 - 2 * (y * y + z * z)) * north + 2 * (x * y + w * z) * east + 2 * (x * z - w * y) * down,
        2 * (x * y - w * z) * north + (1 - 2 * (x * x + z * z)) * east + 2 * (y * z + w * x) * down,
        2 * (x * z + w * y) * north + 2 * (y * z - w * x) * east + (1 - 2 * (x * x + y * y)) * down,
    )
