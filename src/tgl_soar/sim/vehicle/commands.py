"""MAVLink commands (COMMAND_LONG, COMMAND_INT) that the autopilot executes, and their results."""

from __future__ import annotations

from math import isfinite
from typing import Final, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.sim.routing import RoutedFrame
from tgl_soar.sim.vehicle.message_streams import MessageStreams
from tgl_soar.sim.vehicle.vehicle_links import VehicleLink

_FORCE_DISARM: Final = 21196.0


class Commanded(Protocol):
    """What a command acts on."""

    @property
    def streams(self) -> MessageStreams:
        """What goes out on the links."""
        ...

    def set_mode(self, mode: int, by: str) -> bool:
        """Change the mode; False where there is none of this number."""
        ...

    def arm(self, arm: bool, *, force: bool) -> bool:
        """Arm or disarm; False where it refuses."""
        ...


def take_command(vehicle: Commanded, link: VehicleLink, frame: RoutedFrame) -> None:
    """Execute one command and acknowledge it."""
    command = int(frame.message.command)
    result = _execute(vehicle, link, frame, command)
    link.post(
        mavlink.MAVLink_command_ack_message(command, result, 0, 0, frame.system, frame.component)
    )


def _execute(vehicle: Commanded, link: VehicleLink, frame: RoutedFrame, command: int) -> int:
    """The MAV_RESULT of a command."""
    one, two = float(frame.message.param1), float(frame.message.param2)
    if not (isfinite(one) and isfinite(two)):
        # NaN means "not given"; none of these commands can do without both.
        return int(mavlink.MAV_RESULT_DENIED)
    streams = vehicle.streams
    if command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
        return streams.set_interval(link, int(one), two * 1e-6 if two > 0.0 else two)
    if command == mavlink.MAV_CMD_GET_MESSAGE_INTERVAL:
        return streams.report_interval(link, int(one))
    if command == mavlink.MAV_CMD_REQUEST_MESSAGE:
        return streams.send_once(link, int(one), int(two))
    if command == mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
        return streams.send_once(link, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, 0)
    if command == mavlink.MAV_CMD_DO_SET_MODE:
        if not int(one) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            return int(mavlink.MAV_RESULT_DENIED)
        accepted = vehicle.set_mode(int(two), f"asked by system {frame.system}")
        return int(mavlink.MAV_RESULT_ACCEPTED if accepted else mavlink.MAV_RESULT_FAILED)
    if command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
        accepted = vehicle.arm(one != 0.0, force=two == _FORCE_DISARM)
        return int(mavlink.MAV_RESULT_ACCEPTED if accepted else mavlink.MAV_RESULT_FAILED)
    return int(mavlink.MAV_RESULT_UNSUPPORTED)
