"""Paparazzi, with its mavlink module and datalink RC.

`override`: RC_CHANNELS_OVERRIDE in MANUAL.  It takes roll, pitch, throttle and yaw from channels
1 to 4, all four of every frame and whoever sends them, and makes of each a number of 8 bits:

    roll, pitch   −(pulse − 1500) 255 / 2200      yaw   −(pulse − 1500) 255 / 1100

out of 127 for full travel.  So the signs are turned, and full travel takes pulses beyond those
of a radio.  Nothing says "release": a released channel's 0 would be a full deflection.  The
datalink's RC counts as lost 0.5 s after the last frame.

Its streams are slow and no request makes them faster: the telemetry file has to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Final

from tgl_soar.link.autopilots.base import (
    CAST,
    OVERRIDE_CHANNELS,
    CommandRoute,
    ParameterCodec,
    SensorMessages,
    SurfaceChannels,
    Wanted,
    deflections,
    firmware_mismatch,
    set_mode,
)
from tgl_soar.link.autopilots.requirements import Answers, Needs, Requirement
from tgl_soar.link.messages import (
    AUTOPILOT_PAPARAZZI,
    COMPONENT_AUTOPILOT,
    ID_VFR_HUD,
    MODE_FLAG_MANUAL_INPUT,
    MODE_FLAG_STABILIZE,
    STATE_CRITICAL,
    STATE_EMERGENCY,
    CommandLong,
    Heartbeat,
    Outbound,
    RcChannelsOverride,
)
from tgl_soar.types import OURS, Setpoints, SurfaceCommand, isfinite

MIDDLE_US: Final = 1500
FULL_ROLL_PITCH_US: Final = 1100  # the first that makes 127
FULL_YAW_US: Final = 550
THROTTLE_US: Final = 950  # no throttle

OVERRIDE: Final = CommandRoute(
    name="override",
    message="RC_CHANNELS_OVERRIDE",
    mode="MANUAL",
    loops=OURS,
    as_operator=False,
    mode_to_enter=None,
    mode_to_leave=0,
    silence_s=0.5,
    after_silence="RC is lost: the airframe's RC_LOST_MODE",
    takeover="the mode switch of a second receiver; datalink RC has no other",
    releases=False,
)


class Paparazzi:
    """Paparazzi's fixed-wing firmware."""

    name: ClassVar[str] = "paparazzi"
    routes: ClassVar[Mapping[str, CommandRoute]] = {OVERRIDE.name: OVERRIDE}
    asked: ClassVar[tuple[str, ...]] = ()
    codec: ClassVar[ParameterCodec] = CAST
    sensors: ClassVar[SensorMessages] = SensorMessages(
        imu=(),
        airspeed=Wanted(ID_VFR_HUD, "VFR_HUD", 20.0),
        pitot_in_imu=False,
        estimator=None,
        wind=None,
    )

    def __init__(
        self, channels: SurfaceChannels, system_id: int, route: CommandRoute = OVERRIDE
    ) -> None:
        self.route = route
        self._channels = channels
        self._system_id = system_id

    def refusal(self, parameters: Answers, system: int) -> str:
        """It obeys whoever sends."""
        return ""

    def mismatch(self, heartbeat: Heartbeat) -> str:
        """Whether it is a Paparazzi."""
        return firmware_mismatch(heartbeat, AUTOPILOT_PAPARAZZI, "a Paparazzi")

    def commands(
        self,
        surfaces: SurfaceCommand,
        setpoints: Setpoints,
        throttle: float = 0.0,
    ) -> tuple[Outbound, ...]:
        """One frame with all four channels: its outputs' limits and trims are its own."""
        pulses = (
            _pulse(surfaces.aileron, FULL_ROLL_PITCH_US),
            _pulse(surfaces.elevator, FULL_ROLL_PITCH_US),
            THROTTLE_US,
            _pulse(surfaces.rudder, FULL_YAW_US),
        )
        nothing = (0,) * (OVERRIDE_CHANNELS - len(pulses))
        return (RcChannelsOverride(self._system_id, COMPONENT_AUTOPILOT, (*pulses, *nothing)),)

    def release(self) -> tuple[Outbound, ...]:
        """Silence, nothing else."""
        return ()

    def ask_for_mode(self, custom_mode: int) -> CommandLong:
        """It knows no such command on a fixed wing; nothing here sends it."""
        return set_mode(self._system_id, float(custom_mode))

    def obeys(self, heartbeat: Heartbeat) -> bool:
        """MANUAL: manual input, and no stabilisation."""
        flags = heartbeat.base_mode & (MODE_FLAG_MANUAL_INPUT | MODE_FLAG_STABILIZE)
        return flags == MODE_FLAG_MANUAL_INPUT

    def deflections(self, servos: Sequence[int]) -> SurfaceCommand:
        """By the table of the airframe file; it sends no outputs today."""
        return deflections(self._channels, servos)

    def failsafe(self, heartbeat: Heartbeat) -> bool:
        """It never says so; a mode that does not obey is all there is to see."""
        return heartbeat.system_status in (STATE_CRITICAL, STATE_EMERGENCY)

    def way_to_rate(self, rate_hz: float) -> str:
        """It takes no requests."""
        return (
            'raise it in the telemetry file: <process name="Mavlink" type="mavlink">, with a'
            f" period of {1.0 / rate_hz:g} s, and MAVLINK_PERIODIC_FREQUENCY"
        )

    def requirements(self, needs: Needs) -> tuple[Requirement, ...]:
        """Its settings are the airframe's own; what matters is compiled in."""
        return ()


def _pulse(deflection: float, full_us: int) -> int:
    limited = max(-1.0, min(1.0, deflection)) if isfinite(deflection) else 0.0
    return round(MIDDLE_US - limited * full_us)
