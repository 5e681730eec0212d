"""ArduPlane: the surfaces through RC_CHANNELS_OVERRIDE in MANUAL.

It obeys only the sender whose system id its SYSID_MYGCS (newer: MAV_GCS_SYSID) names, goes back
to the pilot's sticks 3 s (RC_OVERRIDE_TIME) after the last frame, and at once when a channel is
released.  The message has two ways to say so: in channels 1 to 8 a 0 releases and 65535 leaves
as it is, in channels 9 to 18 a 0 leaves as it is and 65534 releases.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from tgl_soar.link.messages import (
    COMPONENT_AUTOPILOT,
    ID_RAW_IMU,
    ID_SCALED_IMU,
    ID_VFR_HUD,
    MODE_FLAG_CUSTOM_MODE,
    STATE_CRITICAL,
    STATE_EMERGENCY,
    Heartbeat,
    RcChannelsOverride,
    Said,
)
from tgl_soar.types import SurfaceCommand

from .base import SensorMessages, SurfaceChannels, Wanted, deflection, pulse_width

MODE_MANUAL: Final = 0
CHANNELS: Final = 18
_FIRST_EIGHT: Final = 8
_LEAVE_FIRST: Final = 65535
_RELEASE_FIRST: Final = 0
_LEAVE_LATER: Final = 0
_RELEASE_LATER: Final = 65534


class ArduPilot:
    """ArduPlane 4.x."""

    name = "ardupilot"
    # SYSID_MYGCS up to 4.6; then a range, of which the upper end 0 stands for the lower.
    sender_parameters: tuple[str, ...] = ("SYSID_MYGCS", "MAV_GCS_SYSID", "MAV_GCS_SYSID_HI")
    # RAW_IMU is stamped in microseconds, SCALED_IMU of the same numbers in milliseconds.  The
    # differential pressure of its HIGHRES_IMU is the barometer's, less that at the ground.
    # The airspeed is read ten times a second; twice as often, so that it is not old as well.
    sensors = SensorMessages(
        (ID_RAW_IMU, ID_SCALED_IMU), Wanted(ID_VFR_HUD, "VFR_HUD", 20.0), pitot_in_imu=False
    )

    def __init__(self, channels: SurfaceChannels, system_id: int) -> None:
        self._channels = channels
        self._system_id = system_id
        self._release = (self._override({}, release=True),)

    def refusal(self, parameters: Mapping[str, float], system: int) -> str:
        """The firmware ignores overrides of other senders without a word."""
        old, low_name, high_name = self.sender_parameters
        name = old if old in parameters else low_name
        if name not in parameters:
            return ""
        low = parameters[name]
        high = max(low, parameters.get(high_name, low))
        if low <= system <= high:
            return ""
        return (
            f"the autopilot ignores our surfaces: its {name} is {low:g}, our override_system_id"
            f" {system}; make them the same"
        )

    def surfaces(self, command: SurfaceCommand) -> tuple[Said, ...]:
        """One frame that holds our three channels and leaves the others to the pilot."""
        elevator, aileron, rudder = self._channels
        pulses = {
            elevator.channel: pulse_width(elevator, command.elevator),
            aileron.channel: pulse_width(aileron, command.aileron),
            rudder.channel: pulse_width(rudder, command.rudder),
        }
        return (self._override(pulses, release=False),)

    def release(self) -> tuple[Said, ...]:
        """One frame that gives our three channels back and touches no other."""
        return self._release

    def obeys(self, heartbeat: Heartbeat) -> bool:
        """Only in MANUAL do the sticks, and so the overrides, move the surfaces directly."""
        is_custom = heartbeat.base_mode & MODE_FLAG_CUSTOM_MODE != 0
        return is_custom and heartbeat.custom_mode == MODE_MANUAL

    def deflections(self, servos: Sequence[int]) -> SurfaceCommand:
        """The outputs by the table of the overrides: its RCn and SERVOn must be alike."""
        elevator, aileron, rudder = self._channels
        return SurfaceCommand(
            deflection(elevator, servos), deflection(aileron, servos), deflection(rudder, servos)
        )

    def failsafe(self, heartbeat: Heartbeat) -> bool:
        """CRITICAL: any failsafe has been triggered; EMERGENCY: it believes to have crashed."""
        return heartbeat.system_status in (STATE_CRITICAL, STATE_EMERGENCY)

    def way_to_rate(self, rate_hz: float) -> str:
        """The firmware refuses more than 0.8 of its main loop's rate."""
        return f"set SCHED_LOOP_RATE to {rate_hz / 0.8:.0f} or more"

    def _override(self, pulses: Mapping[int, int], *, release: bool) -> RcChannelsOverride:
        values = [_LEAVE_FIRST] * _FIRST_EIGHT + [_LEAVE_LATER] * (CHANNELS - _FIRST_EIGHT)
        for surface in self._channels:
            first = surface.channel <= _FIRST_EIGHT
            let_go = _RELEASE_FIRST if first else _RELEASE_LATER
            values[surface.channel - 1] = let_go if release else pulses[surface.channel]
        return RcChannelsOverride(self._system_id, COMPONENT_AUTOPILOT, tuple(values))
