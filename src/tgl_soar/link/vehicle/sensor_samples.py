"""Attitude, accelerations, airspeed and surfaces, as the autopilot sends them.

Of several messages that carry the same (attitude, accelerations) one is used at a time.
"""

from __future__ import annotations

from collections.abc import Hashable
from typing import Final

from tgl_soar.link.autopilots.base import Flavour
from tgl_soar.link.clock import MICROSECONDS_WRAP_S
from tgl_soar.link.messages import (
    ID_ATTITUDE_QUATERNION,
    ID_DISTANCE_SENSOR,
    ID_HIGHRES_IMU,
    ID_ODOMETRY,
    ID_RAW_IMU,
    ID_SERVO_OUTPUT_RAW,
    ID_SYS_STATUS,
    ID_VFR_HUD,
    SENSOR_DIFFERENTIAL_PRESSURE,
    AttitudeQuaternion,
    DistanceSensor,
    HighresImu,
    Odometry,
    RawImu,
    ScaledImu,
    ServoOutputRaw,
    SysStatus,
    VfrHud,
)
from tgl_soar.link.sensor_units import airspeed_of_hud, airspeed_of_pressure, imu_of, range_of
from tgl_soar.link.sources import Quaternion
from tgl_soar.link.vehicle.diagnostics import Ledger
from tgl_soar.link.vehicle.sample_times import SampleTimes
from tgl_soar.types import (
    NAN,
    NO_AIRSPEED,
    NO_ATTITUDE,
    NO_IMU,
    NO_RANGE,
    NO_SURFACES,
    AirspeedSample,
    AttitudeSample,
    ImuSample,
    RangeSample,
    SurfacesSample,
    isfinite,
)

SILENCE_S: Final = 0.5  # after this another message may give the same quantity


class MessageChoice:
    """Selects one of several messages with the same quantity; another after `SILENCE_S`."""

    def __init__(self) -> None:
        self._selected: Hashable = None
        self._received_s = NAN

    def selects(self, message: Hashable, now_s: float) -> bool:
        """Whether this message, which has come now, is to be used."""
        if message != self._selected:
            if now_s - self._received_s <= SILENCE_S:
                return False
            self._selected = message
        self._received_s = now_s
        return True

    def rebase(self) -> None:
        """The loop's clock is another one from here on."""
        self._received_s = NAN


class SensorSamples:
    """The newest sample of each quantity."""

    def __init__(self, flavour: Flavour, times: SampleTimes, ledger: Ledger) -> None:
        self.attitude = NO_ATTITUDE
        self.imu = NO_IMU
        self.airspeed = NO_AIRSPEED
        self.surfaces = NO_SURFACES
        self.rangefinder = NO_RANGE
        self.servos_us: tuple[int, ...] = ()
        self.vehicle_time_s = NAN  # newest stamp of the attitude, vehicle's clock
        self._flavour = flavour
        self._times = times
        self._counters, self._streams = ledger.counters, ledger.streams
        self._attitude_choice, self._imu_choice = MessageChoice(), MessageChoice()
        self._range_choice = MessageChoice()
        self._has_pitot = False

    def rebase(self) -> None:
        """The loop's clock is another one from here on."""
        self._attitude_choice.rebase()
        self._imu_choice.rebase()
        self._range_choice.rebase()

    def on_attitude_quaternion(self, m: AttitudeQuaternion, now_s: float) -> None:
        """Use an attitude."""
        self._streams.received(ID_ATTITUDE_QUATERNION)
        if not (isfinite(m.q1) and isfinite(m.q2) and isfinite(m.q3) and isfinite(m.q4)):
            self._counters.not_finite += 1
            return
        times = self._times.of_milliseconds(ID_ATTITUDE_QUATERNION, m.time_boot_ms, now_s)
        if times is None or not self._attitude_choice.selects(ID_ATTITUDE_QUATERNION, now_s):
            return
        time_s, self.vehicle_time_s = times
        self._set_attitude(
            time_s, (m.q1, m.q2, m.q3, m.q4), (m.rollspeed, m.pitchspeed, m.yawspeed)
        )

    def on_odometry(self, m: Odometry, times: tuple[float, float], now_s: float) -> None:
        """Use the attitude of a message whose position and stamp are good."""
        if not self._times.lockstep and self._attitude_choice.selects(ID_ODOMETRY, now_s):
            time_s, self.vehicle_time_s = times
            self._set_attitude(time_s, m.q, (m.rollspeed, m.pitchspeed, m.yawspeed))

    def on_imu(self, m: HighresImu | RawImu | ScaledImu, now_s: float) -> None:
        """Use accelerations and rates, and the airspeed that comes with them."""
        if isinstance(m, ScaledImu):
            message_id = m.message_id
            times = self._times.of_milliseconds(message_id, m.time_boot_ms, now_s)
        elif isinstance(m, RawImu):
            message_id = ID_RAW_IMU
            times = self._times.of_microseconds(ID_RAW_IMU, m.time_usec, now_s)
        else:
            message_id = ID_HIGHRES_IMU
            times = self._times.of_microseconds(ID_HIGHRES_IMU, m.time_usec, now_s)
        self._streams.received(message_id)
        if times is None:
            return
        if isinstance(m, HighresImu) and self._flavour.sensors.pitot_in_imu:
            self._set_airspeed(airspeed_of_pressure(m), times[0])
        measured = imu_of(m)
        if measured is None:
            self._counters.no_measurement += 1
        elif self._imu_choice.selects(message_id, now_s):
            (x, y, z), (p, q, r) = measured
            self.imu = ImuSample(
                sequence=self.imu.sequence + 1,
                time_s=times[0],
                force_x_frd_mps2=x,
                force_y_frd_mps2=y,
                force_z_frd_mps2=z,
                roll_rate_frd_radps=p,
                pitch_rate_frd_radps=q,
                yaw_rate_frd_radps=r,
            )

    def on_hud(self, m: VfrHud, now_s: float) -> None:
        """Use an airspeed.  It has no stamp; without a pitot tube it is an estimate: not used."""
        self._streams.received(ID_VFR_HUD)
        if self._has_pitot:
            measured = airspeed_of_hud(m)
            self._counters.no_measurement += measured is None
            self._set_airspeed(measured, self.vehicle_time_s if self._times.lockstep else now_s)

    def on_distance(self, m: DistanceSensor, now_s: float) -> None:
        """Use a distance to the ground; of several rangefinders that look down one at a time."""
        self._streams.received(ID_DISTANCE_SENSOR)
        measured = range_of(m)
        if measured is None:
            self._counters.no_range += 1
            return
        times = self._times.of_distance(m.id, m.time_boot_ms, now_s)
        if times is not None and self._range_choice.selects(m.id, now_s):
            self._counters.ranges += 1
            self.rangefinder = RangeSample(self.rangefinder.sequence + 1, times[0], measured)

    def on_sys_status(self, m: SysStatus) -> None:
        """Whether there is a pitot tube, and in good health."""
        self._streams.received(ID_SYS_STATUS)
        healthy = m.sensors_present & m.sensors_health
        self._has_pitot = healthy & SENSOR_DIFFERENTIAL_PRESSURE != 0

    def on_servos(self, m: ServoOutputRaw, now_s: float) -> None:
        """Use the outputs of the first port."""
        self._streams.received(ID_SERVO_OUTPUT_RAW)
        if m.port != 0:
            return
        times = self._times.of_microseconds(
            ID_SERVO_OUTPUT_RAW, m.time_usec, now_s, wrap_s=MICROSECONDS_WRAP_S
        )
        if times is not None:
            self.servos_us = m.servos
            deflections = self._flavour.deflections(m.servos)
            self.surfaces = SurfacesSample(
                sequence=self.surfaces.sequence + 1,
                time_s=times[0],
                elevator=deflections.elevator,
                aileron=deflections.aileron,
                rudder=deflections.rudder,
                brake=deflections.brake,
            )

    def _set_airspeed(self, airspeed_mps: float | None, time_s: float) -> None:
        if airspeed_mps is not None:
            self.airspeed = AirspeedSample(self.airspeed.sequence + 1, time_s, airspeed_mps)

    def _set_attitude(
        self,
        time_s: float,
        q: Quaternion,
        rates: tuple[float, float, float],
    ) -> None:
        self._counters.attitudes += 1
        (w, x, y, z), (roll, pitch, yaw) = q, rates
        sequence = self.attitude.sequence + 1
        self.attitude = AttitudeSample(
            sequence=sequence,
            time_s=time_s,
            qw=w,
            qx=x,
            qy=y,
            qz=z,
            roll_rate_frd_radps=roll,
            pitch_rate_frd_radps=pitch,
            yaw_rate_frd_radps=yaw,
        )
