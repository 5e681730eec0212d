"""A simulated Pixhawk: an ArduPlane as a companion computer and ground stations meet it.

It has no sockets and no clock.  `receive` takes the datagrams of a link, `step` advances by
one fixed step, `take_datagrams` returns what goes out on each link.  What it accepts, refuses and
lets time out follows what was measured on ArduPlane 4.6 (docs/autopilots.md; the tests compare it
with a recorded conversation): surfaces are moved by `RC_CHANNELS_OVERRIDE` in MANUAL, and only by
the system that `SYSID_MYGCS` names; everyone else is ignored silently.

It has two modes: MANUAL (sticks move surfaces) and FBWA (sticks ask for pitch and bank, wings
level and trim pitch with the sticks centred).  When overrides time out the pilot's sticks move the
surfaces again, in the same mode; where there is no receiver it changes to FBWA, as with
`FS_SHORT_ACTN = 2`.  Like every mode of an aircraft without a propeller FBWA holds an attitude,
not a place.

Everything that arrives is hostile until it has been read: nothing received can raise.
"""

from __future__ import annotations

from collections.abc import Callable, Container
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.airframe import Surfaces
from tgl_soar.config.site import HomePosition
from tgl_soar.sim.channels import NEUTRAL, override_values
from tgl_soar.sim.routing import LinkId, RoutedFrame, split_frames
from tgl_soar.sim.vehicle.commands import take_command
from tgl_soar.sim.vehicle.external_pose import ExternalPose
from tgl_soar.sim.vehicle.firmware_parameters import FirmwareParameters
from tgl_soar.sim.vehicle.level_flight import LevelFlight
from tgl_soar.sim.vehicle.message_streams import MessageStreams
from tgl_soar.sim.vehicle.modes import FBWA, MANUAL, MODE_NAMES, FlightStatus
from tgl_soar.sim.vehicle.onlooker_events import OnlookerEvents
from tgl_soar.sim.vehicle.parameter_service import ParameterService
from tgl_soar.sim.vehicle.reports import VehicleReports
from tgl_soar.sim.vehicle.sensed import GROUNDED, Sensed, known_since
from tgl_soar.sim.vehicle.surface_outputs import SurfaceOutputs
from tgl_soar.sim.vehicle.vehicle_clock import VehicleClock
from tgl_soar.sim.vehicle.vehicle_links import COMPONENT, VehicleLink, VehicleLinks
from tgl_soar.types import SurfaceCommand


@dataclass
class OverrideCounts:
    """What became of the overrides so far."""

    overrides_accepted: int = 0
    overrides_refused: int = 0
    override_timeouts: int = 0


class Pixhawk:
    """The autopilot.  Time is the number of steps taken, of 1/step_hz each.

    parameters        values of its own parameters that differ from their defaults
    trim_pitch_rad    the pitch that FBWA holds with centred sticks
    allow_odometry    stream ODOMETRY, and HIGHRES_IMU, as PX4 does; ArduPlane denies the one
    home              where local NED has its origin; None: it has never had a fix
    uptime_s          how long it has been running when the simulation begins
    armed             at the beginning
    """

    def __init__(
        self,
        surfaces: Surfaces,
        step_hz: int,
        *,
        parameters: dict[str, float] | None = None,
        trim_pitch_rad: float = 0.0,
        allow_odometry: bool = False,
        uptime_s: float = 0.0,
        home: HomePosition | None = None,
        armed: bool = True,
    ) -> None:
        self.running = True
        self.counts = OverrideCounts()
        self.parameters = FirmwareParameters(surfaces, parameters)
        self.pilot_sticks: SurfaceCommand | None = None  # None: no receiver
        self.external = ExternalPose()
        self._clock = VehicleClock(step_hz, uptime_s)
        self._booted_s = float("-inf")  # of the simulated time
        self._status = FlightStatus(armed=armed)
        self.outputs = SurfaceOutputs(
            surfaces, self.parameters, LevelFlight(trim_pitch_rad), step_hz
        )
        self._reports = VehicleReports(
            self._clock, self._status, self.outputs, home, allow_odometry=allow_odometry
        )
        self.streams = MessageStreams(self._clock, self.parameters, self._reports)
        self.links = VehicleLinks()
        self._parameter_service = ParameterService(self.parameters, self.links)
        self._own_attitude = GROUNDED.attitude  # as its own control has it
        self._events = OnlookerEvents()
        self._decoder = mavlink.MAVLink(None)
        self._handlers: dict[int, Callable[[VehicleLink, RoutedFrame], None]] = {
            mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: self._take_override,
            mavlink.MAVLINK_MSG_ID_VISION_POSITION_ESTIMATE: self._take_pose,
            mavlink.MAVLINK_MSG_ID_ODOMETRY: self._take_pose,
            mavlink.MAVLINK_MSG_ID_PARAM_SET: self._parameter_service.take_set,
            mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ: self._parameter_service.take_read,
            mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: self._parameter_service.take_list,
            mavlink.MAVLINK_MSG_ID_TIMESYNC: self._take_timesync,
            mavlink.MAVLINK_MSG_ID_SET_MODE: self._take_set_mode,
            mavlink.MAVLINK_MSG_ID_REQUEST_DATA_STREAM: self.streams.take_request,
            mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: _take_mission_request,
            mavlink.MAVLINK_MSG_ID_COMMAND_LONG: self._take_command,
            mavlink.MAVLINK_MSG_ID_COMMAND_INT: self._take_command,
        }
        self._update_outputs()

    # --- links -----------------------------------------------------------------------------

    def add_link(self, link: LinkId, *, ground: bool) -> None:
        """A link to a ground station (streams slowly by itself) or to a companion (silent)."""
        added = self.links.add(link, int(self.parameters["SYSID_THISMAV"]), ground=ground)
        self.streams.begin(added)

    def remove_link(self, link: LinkId) -> None:
        """A link that is gone."""
        self.links.remove(link)

    def set_pace(self, link: LinkId) -> None:
        """Lockstep: from the next step on a link gets the attitude of every step, unasked."""
        if (paced := self.links.get(link)) is not None:
            self.streams.set_pace(paced)

    def receive(self, link: LinkId, data: bytes) -> None:
        """Take one datagram of a link; whatever it holds, nothing is raised."""
        source = self.links.get(link)
        if source is None:
            return
        for frame in split_frames(self._decoder, data)[0]:
            if self.running:
                self._take_frame(link, source, frame)
            elif frame.message.get_msgId() == mavlink.MAVLINK_MSG_ID_TIMESYNC and frame.message.tc1:
                # Lockstep goes on all the same.
                self._take_timesync(source, frame)

    def send(self, link: LinkId, message: Any) -> None:
        """Queue a message of this autopilot on a link."""
        if (target := self.links.get(link)) is not None:
            target.post(message)

    def broadcast(self, message: Any, *, ground_only: bool = False) -> None:
        """Queue a message of this autopilot on every link."""
        self.links.broadcast(message, ground_only=ground_only)

    def timesync_answer_ns(self, link: LinkId) -> int:
        """The `ts1` that came back last on a link; 0: none."""
        target = self.links.get(link)
        return target.timesync_answer_ns if target is not None else 0

    def heartbeats(self, link: LinkId) -> int:
        """How many heartbeats came on a link, of anybody."""
        source = self.links.get(link)
        return source.heartbeats if source is not None else 0

    def take_datagrams(self, links: Container[LinkId] | None = None) -> list[tuple[LinkId, bytes]]:
        """What is queued on some links (or all), as datagrams of whole frames; the queues are
        emptied."""
        return self.links.take_datagrams(links)

    def take_events(self) -> list[str]:
        """What an onlooker should know, in order; each only once."""
        return self._events.take()

    # --- state -----------------------------------------------------------------------------

    @property
    def step_hz(self) -> int:
        """Steps per second."""
        return self._clock.step_hz

    @property
    def steps(self) -> int:
        """Taken so far."""
        return self._clock.steps

    @property
    def boot_ms(self) -> int:
        """Now, as the messages' `time_boot_ms`."""
        return self._clock.boot_ms(self._clock.time_s)

    @property
    def mode(self) -> int:
        """One of `MODE_NAMES`."""
        return self._status.mode

    @property
    def armed(self) -> bool:
        """Whether the motors of an aircraft that has some would run."""
        return self._status.armed

    @property
    def surfaces(self) -> SurfaceCommand:
        """What the servos are commanded."""
        return self.outputs.deflections

    def is_overridden(self) -> bool:
        """Whether a surface's channel is overridden now."""
        return self.outputs.is_overridden()

    # --- time ------------------------------------------------------------------------------

    def step(self, sensed: Sensed, reported: Sensed | None = None) -> None:
        """Advance by one step: failsafe, mode, servos, streams.

        reported: what the streams carry, where that is not what its own control has.
        """
        self._clock.steps += 1
        if not self.running:
            return
        self._own_attitude = sensed.attitude
        self._reports.take(self._aided(reported or sensed))
        self._expire_overrides()
        self._update_outputs()
        if self.steps % self.step_hz == 1 % self.step_hz:
            self.announce()
        for link in self.links:
            self.streams.step(link)
            self._parameter_service.step(link)

    def announce(self) -> None:
        """Queue a heartbeat on every link, also outside the 1 Hz of flight."""
        self.broadcast(self._reports.heartbeat())

    def set_mode(self, mode: int, by: str) -> bool:
        """Change the mode; False where there is none of this number."""
        if mode not in MODE_NAMES:
            return False
        if mode != self.mode:
            self.outputs.enter_level_flight()
            self._status.mode = mode
            self._events.add(f"mode {MODE_NAMES[mode]} ({by})")
            self.announce()
        return True

    def arm(self, arm: bool, *, force: bool) -> bool:
        """Arm or disarm; False where it refuses, as it does in flight unless forced."""
        if not arm and self._reports.sensed.flying and not force:
            return False
        if arm != self.armed:
            self._status.armed = arm
            self.announce()
        return True

    def restart(self) -> None:
        """Back to what a pilot sets before a launch: MANUAL, armed, nothing overridden."""
        self.outputs.overrides.clear()
        self._status.armed = True
        self.set_mode(MANUAL, "launch")

    def shut_down(self) -> None:
        """Nothing is received, sent or moved until `boot`; the servos stay."""
        self.running = False
        self.outputs.overrides.clear()
        self.links.restart()

    def pass_over(self, seconds: float) -> None:
        """The clock runs on for so long, without a step."""
        self._clock.uptime_s += seconds

    def boot(self) -> None:
        """Start without memory: the clock from zero, the mode of the pilot's switch."""
        self.running = True
        self._clock.restart()
        self._booted_s = self._clock.time_s
        self.external = ExternalPose()
        self._reports.forget()
        for link in self.links:
            self.streams.begin(link)
        self.set_mode(MANUAL, "after a restart")
        self.announce()

    def _aided(self, sensed: Sensed) -> Sensed:
        """What is sensed, with a companion's poses in the place of the position."""
        sensed = known_since(sensed, self._booted_s)
        if not self.external.is_in_use():
            return sensed
        delay_s = 1e-3 * self.parameters["VISO_DELAY_MS"]
        before = self._reports.sensed.position
        aided = self.external.fix(sensed.position, before, self._clock.time_s, delay_s)
        return sensed._replace(position=aided)

    def _expire_overrides(self) -> None:
        expired = self.outputs.expire_overrides(self.steps)
        if not expired:
            return
        self.counts.override_timeouts += 1
        channels = ", ".join(str(channel) for channel in expired)
        allowed_s = self.parameters["RC_OVERRIDE_TIME"]
        self._events.add(f"overrides timed out after {allowed_s:g} s (channels {channels})")
        no_receiver = self.pilot_sticks is None
        if no_receiver and self._reports.sensed.flying and not self.is_overridden():
            self.set_mode(FBWA, "own mode after the time-out")

    def _update_outputs(self) -> None:
        level = self.mode == FBWA and self._own_attitude.sequence > 0
        attitude = self._own_attitude if level else None
        self.outputs.update(self.pilot_sticks or NEUTRAL, attitude)

    # --- what arrives ----------------------------------------------------------------------

    def _take_frame(self, number: LinkId, link: VehicleLink, frame: RoutedFrame) -> None:
        own_system = int(self.parameters["SYSID_THISMAV"])
        if (frame.system, frame.component) == (own_system, COMPONENT):
            self._events.add_once(
                f"frames that claim to be from ({own_system}, {COMPONENT}), this autopilot,"
                f" came on link {number}: ignored"
            )
            return
        if frame.message.get_msgId() == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            link.heartbeats += 1
        if self.links.pass_on(number, frame, own_system):
            handler = self._handlers.get(frame.message.get_msgId())
            if handler is not None:
                handler(link, frame)

    def _take_override(self, _link: VehicleLink, frame: RoutedFrame) -> None:
        master = int(self.parameters["SYSID_MYGCS"])
        if frame.system != master:
            self.counts.overrides_refused += 1
            self._events.add_once(
                f"overrides from system {frame.system} are ignored: SYSID_MYGCS is {master}"
            )
            return
        self.outputs.overrides.take(override_values(frame.message), self.steps)
        self.counts.overrides_accepted += 1

    def _take_pose(self, _link: VehicleLink, frame: RoutedFrame) -> None:
        if self.parameters["VISO_TYPE"] == 1.0:
            self.external.take(frame.message, self._clock.time_s)

    def _take_timesync(self, link: VehicleLink, frame: RoutedFrame) -> None:
        if frame.message.tc1 == 0:
            now_ns = self._clock.boot_ns(self._clock.time_s)
            link.post(mavlink.MAVLink_timesync_message(now_ns, frame.message.ts1))
        else:
            link.timesync_answer_ns = int(frame.message.ts1)

    def _take_set_mode(self, _link: VehicleLink, frame: RoutedFrame) -> None:
        if frame.message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            self.set_mode(int(frame.message.custom_mode), f"asked by system {frame.system}")

    def _take_command(self, link: VehicleLink, frame: RoutedFrame) -> None:
        take_command(self, link, frame)


def _take_mission_request(link: VehicleLink, frame: RoutedFrame) -> None:
    """It has no mission; a ground station waits for this answer."""
    mission_type = int(getattr(frame.message, "mission_type", 0))
    link.post(mavlink.MAVLink_mission_count_message(frame.system, frame.component, 0, mission_type))
