"""Which messages go out on a link, how often, and when each is due.

A message that carries a measurement goes out when there is a new one, once each.  As in
ArduPlane, a stream faster than 0.8 of SCHED_LOOP_RATE is denied.
"""

from __future__ import annotations

from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.sim.routing import RoutedFrame
from tgl_soar.sim.vehicle.firmware_parameters import FirmwareParameters
from tgl_soar.sim.vehicle.reports import VehicleReports
from tgl_soar.sim.vehicle.vehicle_clock import VehicleClock
from tgl_soar.sim.vehicle.vehicle_links import MessageStream, VehicleLink

_RATE_FRACTION: Final = 0.8  # of SCHED_LOOP_RATE: faster streams are denied
_LONGEST_S: Final = 2000.0  # MESSAGE_INTERVAL tells microseconds in 32 bits: 2147 s at most

# Hz on a link to the ground until somebody asks; a companion asks for what it wants.
GROUND_RATES_HZ: Final = {
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 4.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 4.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 4.0,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 2.0,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: 2.0,
}

# REQUEST_DATA_STREAM, which older ground stations send: the messages of each group.
_STREAM_GROUPS: Final = {
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: (mavlink.MAVLINK_MSG_ID_SYS_STATUS,),
    mavlink.MAV_DATA_STREAM_RC_CHANNELS: (
        mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,
        mavlink.MAVLINK_MSG_ID_RC_CHANNELS,
    ),
    mavlink.MAV_DATA_STREAM_RAW_SENSORS: (mavlink.MAVLINK_MSG_ID_RAW_IMU,),
    mavlink.MAV_DATA_STREAM_POSITION: (
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    ),
    mavlink.MAV_DATA_STREAM_EXTRA1: (mavlink.MAVLINK_MSG_ID_ATTITUDE,),
    mavlink.MAV_DATA_STREAM_EXTRA2: (mavlink.MAVLINK_MSG_ID_VFR_HUD,),
    mavlink.MAV_DATA_STREAM_EXTRA3: (mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,),
}


class MessageStreams:
    """The streams of every link."""

    def __init__(
        self, clock: VehicleClock, parameters: FirmwareParameters, reports: VehicleReports
    ) -> None:
        self._clock = clock
        self._parameters = parameters
        self._reports = reports

    def begin(self, link: VehicleLink) -> None:
        """What a link gets unasked."""
        if link.ground:
            for message_id, rate_hz in GROUND_RATES_HZ.items():
                self.set_interval(link, message_id, 1.0 / rate_hz)

    def set_pace(self, link: VehicleLink) -> None:
        """Lockstep: from the next step on a link gets the attitude of every step, unasked."""
        every_step = MessageStream(1, self._clock.steps + 1)
        link.streams[mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION] = every_step

    def take_request(self, link: VehicleLink, frame: RoutedFrame) -> None:
        """REQUEST_DATA_STREAM: a group of streams, or all."""
        message = frame.message
        group = int(message.req_stream_id)
        groups = (
            _STREAM_GROUPS.values()
            if group == mavlink.MAV_DATA_STREAM_ALL
            else (_STREAM_GROUPS.get(group, ()),)
        )
        rate_hz = float(message.req_message_rate)
        interval_s = 1.0 / rate_hz if message.start_stop and rate_hz > 0.0 else -1.0
        for members in groups:
            for message_id in members:
                self.set_interval(link, message_id, interval_s)

    def set_interval(self, link: VehicleLink, message_id: int, interval_s: float) -> int:
        """Stream a message every so many whole steps, every 2000 s at least; 0: its default rate,
        negative: never.

        The result of the command that asked for it.
        """
        if message_id not in self._reports.streamable:
            return int(mavlink.MAV_RESULT_DENIED)
        if interval_s == 0.0:
            rate_hz = GROUND_RATES_HZ.get(message_id, 0.0) if link.ground else 0.0
            interval_s = 1.0 / rate_hz if rate_hz else -1.0
        if interval_s < 0.0:
            link.streams.pop(message_id, None)
            return int(mavlink.MAV_RESULT_ACCEPTED)
        if interval_s < (1.0 - 1e-6) / (_RATE_FRACTION * self._parameters["SCHED_LOOP_RATE"]):
            return int(mavlink.MAV_RESULT_DENIED)
        interval_steps = max(1, round(min(interval_s, _LONGEST_S) * self._clock.step_hz))
        link.streams[message_id] = MessageStream(interval_steps, self._clock.steps + 1)
        # The attitude is what a companion waits for: whatever else is due goes out before it.
        last = link.streams.pop(mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, None)
        if last is not None:
            link.streams[mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION] = last
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def report_interval(self, link: VehicleLink, message_id: int) -> int:
        """Answer with MESSAGE_INTERVAL; the result of the command that asked for it."""
        if not 0 <= message_id <= 0xFFFF:
            return int(mavlink.MAV_RESULT_DENIED)
        stream = link.streams.get(message_id)
        if stream is not None:
            interval_us = round(1e6 * stream.interval_steps / self._clock.step_hz)
        elif message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            interval_us = 1_000_000
        else:
            interval_us = -1 if message_id in self._reports.streamable else 0  # 0: not available
        link.post(mavlink.MAVLink_message_interval_message(message_id, interval_us))
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def send_once(self, link: VehicleLink, message_id: int, argument: int) -> int:
        """Send one message; the result of the command that asked for it."""
        if message_id == mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
            return self.report_interval(link, argument)
        report = self._reports.build(message_id)
        if report is None:
            return int(mavlink.MAV_RESULT_FAILED)
        link.post(report)
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def step(self, link: VehicleLink) -> None:
        """Send what is due.  A sample goes out once: where none is new, the stream waits for
        the next one, so that a stream at the sensor's own rate adds no delay of its own."""
        step = self._clock.steps
        for message_id, stream in link.streams.items():
            if step < stream.due_at:
                continue
            sequence = self._reports.sequence(message_id)
            if sequence == stream.sent_sequence:
                continue
            stream.sent_sequence = sequence
            link.post(self._reports.streamable[message_id]())
            # The next is due on the grid of the first, however late this one was.
            stream.due_at += (1 + (step - stream.due_at) // stream.interval_steps) * (
                stream.interval_steps
            )
