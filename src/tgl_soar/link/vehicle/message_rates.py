"""Which messages are requested, how often, and what replaces those that the autopilot lacks."""

from __future__ import annotations

from typing import Final

from tgl_soar.link.autopilots.base import Flavour
from tgl_soar.link.messages import (
    ID_ATTITUDE_QUATERNION,
    ID_DISTANCE_SENSOR,
    ID_EKF_STATUS_REPORT,
    ID_ESTIMATOR_STATUS,
    ID_GLOBAL_POSITION_INT,
    ID_GPS_RAW_INT,
    ID_HEARTBEAT,
    ID_HIGHRES_IMU,
    ID_LOCAL_POSITION_NED,
    ID_ODOMETRY,
    ID_RAW_IMU,
    ID_SCALED_IMU,
    ID_SERVO_OUTPUT_RAW,
    ID_SYS_STATUS,
    ID_WIND,
    ID_WIND_COV,
    SEVERITY_WARNING,
)
from tgl_soar.link.sources import GLOBAL_POSITION, LOCAL_POSITION, ODOMETRY, PositionSources
from tgl_soar.link.vehicle.diagnostics import Ledger

# Of the autopilot, where the module changes its mode: so soon the pilot's own choice is known.
HEARTBEAT_HZ: Final = 5.0
POSITION_HZ: Final = 50.0
SERVO_HZ: Final = 50.0
STATUS_HZ: Final = 1.0
RANGE_HZ: Final = 20.0  # a bound of three distances is 0.15 s old: 0.2 m at the best glide's sink
IMU_NAMES: Final = {
    ID_RAW_IMU: "RAW_IMU",
    ID_SCALED_IMU: "SCALED_IMU",
    ID_HIGHRES_IMU: "HIGHRES_IMU",
}


class MessageRates:
    """The rates that the loop needs, requested through `streams`."""

    def __init__(
        self,
        flavour: Flavour,
        imu: int | None,
        loop_rate_hz: float,
        sources: PositionSources,
        ledger: Ledger,
    ) -> None:
        """`imu`: the message with accelerations; None: the firmware's usual one, 0: none."""
        self._flavour = flavour
        self._sources = sources
        _, self._notices, self._streams = ledger
        self._imus = list(flavour.sensors.imu) if imu is None else [imu] if imu else []
        streams = self._streams
        streams.want(ID_ATTITUDE_QUATERNION, "ATTITUDE_QUATERNION", loop_rate_hz)
        self._want_positions()
        streams.want(ID_SERVO_OUTPUT_RAW, "SERVO_OUTPUT_RAW", SERVO_HZ)
        self.set_loop_rate(loop_rate_hz)
        streams.want(*flavour.sensors.airspeed)
        streams.want(ID_SYS_STATUS, "SYS_STATUS", STATUS_HZ)
        if flavour.sensors.estimator is not None:
            streams.want(*flavour.sensors.estimator)
        if flavour.route.mode_to_enter is not None:
            streams.want(ID_HEARTBEAT, "HEARTBEAT", HEARTBEAT_HZ, urgent=True)

    def set_loop_rate(self, loop_rate_hz: float) -> None:
        """Attitude and accelerations are needed once a tick."""
        self._loop_rate_hz = loop_rate_hz
        self._streams.want(ID_ATTITUDE_QUATERNION, "ATTITUDE_QUATERNION", loop_rate_hz)
        if self._imus:
            self._streams.want(self._imus[0], IMU_NAMES[self._imus[0]], loop_rate_hz)

    def want_accuracy(self) -> None:
        """What the receiver says of its own accuracy."""
        self._streams.want(ID_GPS_RAW_INT, "GPS_RAW_INT", STATUS_HZ)

    def want_rangefinder(self) -> None:
        """The distances of one that is fitted."""
        self._streams.want(ID_DISTANCE_SENSOR, "DISTANCE_SENSOR", RANGE_HZ)

    def _want_positions(self) -> None:
        """ODOMETRY carries what LOCAL_POSITION_NED does: requested where that is refused."""
        named = self._sources.health
        if LOCAL_POSITION in named:
            self._streams.want(ID_LOCAL_POSITION_NED, "LOCAL_POSITION_NED", POSITION_HZ)
        elif ODOMETRY in named:
            self._streams.want(ID_ODOMETRY, "ODOMETRY", POSITION_HZ)
        if GLOBAL_POSITION in named:
            self._streams.want(ID_GLOBAL_POSITION_INT, "GLOBAL_POSITION_INT", POSITION_HZ)

    def poll_refusals(self) -> None:
        """Report what was refused, and request what carries the same."""
        for stream, word, rate_hz in self._streams.notices:
            text = f"{stream.name} at {rate_hz:g} Hz {word}"
            if stream.message_id == ID_HEARTBEAT:
                text += ": a mode that the pilot chooses is seen up to a second later"
            elif stream.given_up and stream.message_id in (
                ID_EKF_STATUS_REPORT,
                ID_ESTIMATOR_STATUS,
            ):
                text += ": a position that is only dead reckoned looks like any other"
            elif stream.given_up and stream.message_id == ID_GPS_RAW_INT:
                text += ": how accurate the receiver is remains unknown"
            elif stream.given_up and stream.message_id in (ID_WIND, ID_WIND_COV):
                text += ": whether its wind is from the right side remains unknown"
            elif stream.given_up and stream.message_id == ID_DISTANCE_SENSOR:
                text += ": height over the ground is not measured"
            elif word == "denied":
                text += f": {self._flavour.way_to_rate(rate_hz)}"
            if not stream.given_up:
                text += f"; asking for {stream.rate_hz:g} Hz"
            self._notices.append((SEVERITY_WARNING, text))
            if stream.given_up:
                self._want_instead(stream.message_id)
        self._streams.notices.clear()

    def _want_instead(self, message_id: int) -> None:
        """Request what carries the same as a message that the autopilot lacks."""
        if message_id == ID_LOCAL_POSITION_NED and ODOMETRY in self._sources.health:
            self._streams.want(ID_ODOMETRY, "ODOMETRY", POSITION_HZ)
        if message_id in self._imus:
            self._imus.remove(message_id)
            self.set_loop_rate(self._loop_rate_hz)
