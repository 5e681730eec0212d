"""The MAVLink links of a firmware, passed on frame by frame, and what is learnt on the way.

    ground stations ◄──►  bridge  ◄──► firmware's link to a ground station
    companion       ◄──►  bridge  ◄──► firmware's link to a companion

Everything passes as it is, in both directions, with the sender's own sequence and signature.
PX4's links have threads of their own, which its simulator's lockstep does not wait for.  So the
relay does: while attitudes stream to a companion, a step is over only when that of this
step, or of the last few before it, has come.

The bridge speaks on its own account only as component `OWN`: the TIMESYNC by which a lockstep
companion is waited for (its answer goes no further), and truth for ground stations.
"""

from __future__ import annotations

import select
import socket
import time
from collections import defaultdict
from collections.abc import Sequence
from typing import Any, BinaryIO, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.sim.channels import Overrides, override_values
from tgl_soar.sim.firmware.mission import MissionUpload
from tgl_soar.sim.firmware.parameters import ParameterChanges
from tgl_soar.sim.ports import Address
from tgl_soar.sim.routing import LinkId, RoutedFrame, split_frames

OWN: Final = mavlink.MAV_COMP_ID_UDP_BRIDGE
LARGEST: Final = 4096
BURST: Final = 200
PREARM: Final = mavlink.MAV_SYS_STATUS_PREARM_CHECK
ATTITUDE_QUATERNION: Final = mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION.to_bytes(3, "little")
STREAM_S: Final = 0.02  # between two attitudes at most, or there is no stream to wait for
LAG_STEPS: Final = 2  # that an attitude may be late, by the rate of its stream
PATIENCE_S: Final = 0.05  # wall
COMMANDS: Final = frozenset(
    {"SET_ATTITUDE_TARGET", "MANUAL_CONTROL", "SET_ACTUATOR_CONTROL_TARGET", "RC_CHANNELS_OVERRIDE"}
)

HEARTBEAT: Final = mavlink.MAVLink_heartbeat_message(
    mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
)


def only_releases(message: Any) -> bool:
    """Whether it only returns channels to the pilot's sticks, as a disengaged module does."""
    if message.get_type() != "RC_CHANNELS_OVERRIDE":
        return False
    given = Overrides()
    given.take(override_values(message), 0)
    return not given.any


class FirmwareLink:
    """One UDP link of the firmware: it speaks to us first, or we know where it listens."""

    def __init__(self, remote: Address | None, local: Address = ("127.0.0.1", 0)) -> None:
        self._remote = remote
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(local)
        self._socket.setblocking(False)
        self.local: Address = self._socket.getsockname()

    def send(self, data: bytes) -> None:
        """To the firmware; lost where it is not there."""
        if self._remote is not None:
            try:
                self._socket.sendto(data, self._remote)
            except OSError:
                return

    def receive(self) -> bytes | None:
        """The next datagram; None: there is none."""
        try:
            data, self._remote = self._socket.recvfrom(LARGEST)
        except OSError:
            return None
        return data

    def wait(self, seconds: float) -> None:
        """Until something has come, or so long."""
        select.select([self._socket], [], [], seconds)

    def close(self) -> None:
        """Give the port back."""
        self._socket.close()


class Relay:
    """Between the bridge's ports and the firmware's links."""

    def __init__(
        self,
        system: int,
        step_hz: int,
        ground: FirmwareLink,
        companion: FirmwareLink,
        *,
        attitude_hz: int | None = None,
        ready: int = PREARM,
        has_threads: bool = True,
    ):
        """`attitude_hz`: of the stream that sets the pace; None: one at every step.

        `ready`: MAV_SYS_STATUS_SENSOR bits that are healthy once it could be armed.
        `has_threads`: for its links, so that lockstep has to wait for them.
        """
        self._ready_bits = ready
        self._has_threads = has_threads
        self.attitude_hz = step_hz if attitude_hz is None else attitude_hz
        self.step_hz = step_hz
        self.armed = False
        self.custom_mode = -1  # of the newest heartbeat; -1: none yet
        self.ready = False  # it reports that it could be armed
        self.commands: dict[str, int] = {}  # of a companion to its surfaces, by message
        self.last_command = ""
        self.commanded_step = -1
        self.takes_stations = True  # False: what ground stations send does not arrive
        self.mission: MissionUpload | None = None  # receives what the firmware sends of missions
        self.parameters: ParameterChanges | None = None  # receives what it says of its own
        self.record: BinaryIO | None = None  # of the companion's link, both ways, as a .tlog
        self._system = system
        self._ground, self._companion = ground, companion
        self._links: dict[LinkId, bool] = {}  # whether it leads to a ground station
        self._out: dict[LinkId, list[bytes]] = defaultdict(list)
        self._heartbeats: dict[LinkId, int] = defaultdict(int)
        self._asked_ns: dict[LinkId, int] = {}
        self._answered_ns: dict[LinkId, int] = {}
        self._events: list[str] = []
        self.texts: set[str] = set()  # STATUSTEXT messages of the firmware
        self._greeting = b""  # the firmware's newest heartbeat
        self._step = 0
        self._attitude_ms = self._attitude_before_ms = 0
        self._split = mavlink.MAVLink(None)
        self._own = mavlink.MAVLink(None, system, OWN)

    # --- towards the bridge's ports -----------------------------------------------------

    def add_link(self, link: LinkId, *, ground: bool) -> None:
        """A link to a ground station or to a companion."""
        self._links[link] = ground

    def remove_link(self, link: LinkId) -> None:
        """A link that is gone."""
        self._links.pop(link, None)

    def receive(self, link: LinkId, data: bytes) -> None:
        """Take one datagram of a link, and pass on what is not for the bridge."""
        ground = self._links.get(link, True)
        frames, _ = split_frames(self._split, data)
        passed = b"".join(frame.raw for frame in frames if self._is_passed(link, ground, frame))
        if passed:
            (self._ground if ground else self._companion).send(passed)
            if not ground:
                self._keep(passed)

    def take_datagrams(self, links: Sequence[LinkId] | None = None) -> list[tuple[LinkId, bytes]]:
        """What goes out on some links, or on all."""
        self._collect()
        taken = []
        for link in list(self._links) if links is None else links:
            taken += [(link, data) for data in self._out.pop(link, ())]
        return taken

    def send(self, link: LinkId, message: Any) -> None:
        """Send a message on the bridge's own account."""
        if message.get_type() == "TIMESYNC":
            self._asked_ns[link] = message.ts1
        self._out[link].append(bytes(message.pack(self._own)))

    def broadcast(self, message: Any) -> None:
        """Send a message to all ground stations."""
        for link, ground in self._links.items():
            if ground:
                self.send(link, message)

    def announce(self) -> None:
        """Show the firmware's newest heartbeat again, so that all know where to speak."""
        for link in self._links:
            if self._greeting:
                self._out[link].append(self._greeting)

    def set_pace(self, link: LinkId) -> None:
        """Ask the firmware for the attitude of every step where companions listen."""
        if self._links.get(link, True):
            return
        request = mavlink.MAVLink_command_long_message(
            target_system=self._system,
            target_component=mavlink.MAV_COMP_ID_AUTOPILOT1,
            command=mavlink.MAV_CMD_SET_MESSAGE_INTERVAL,
            confirmation=0,
            param1=mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
            param2=round(1e6 / self.attitude_hz),
            param3=0,
            param4=0,
            param5=0,
            param6=0,
            param7=0,
        )
        self._companion.send(bytes(request.pack(self._own)))

    def heartbeats(self, link: LinkId) -> int:
        """How many came over a link."""
        return self._heartbeats[link]

    def timesync_answer_ns(self, link: LinkId) -> int:
        """The stamp of the last TIMESYNC answered on a link; 0: none."""
        return self._answered_ns.get(link, 0)

    def _is_passed(self, link: LinkId, ground: bool, frame: RoutedFrame) -> bool:
        message = frame.message
        kind = message.get_type()
        if kind == "TIMESYNC" and message.tc1 and message.ts1 == self._asked_ns.get(link):
            self._answered_ns[link] = message.ts1
            return False
        if kind == "HEARTBEAT":
            self._heartbeats[link] += 1
        elif kind in COMMANDS and not ground and not only_releases(message):
            self.commands[kind] = self.commands.get(kind, 0) + 1
            self.last_command, self.commanded_step = kind, self._step
        return self.takes_stations or not ground

    # --- towards the firmware -----------------------------------------------------------

    def step(self, time_s: float) -> None:
        """One step is done: collect what the firmware reports of it."""
        self._step += 1
        self._collect()
        wanted_ms = 1e3 * (time_s - LAG_STEPS / self.step_hz) - 0.5
        streams = 0 < self._attitude_ms - self._attitude_before_ms <= 1e3 * STREAM_S
        if not (self._has_threads and streams) or self._attitude_ms >= wanted_ms:
            return
        until = time.monotonic() + PATIENCE_S
        while self._attitude_ms < wanted_ms and (left := until - time.monotonic()) > 0.0:
            self._companion.wait(left)
            self._collect()

    def command(self, message: Any) -> None:
        """To the firmware, as a ground station."""
        self._ground.send(bytes(message.pack(self._own)))

    def greet(self) -> None:
        """A ground station's heartbeat; on the companion's link until a companion has spoken, as
        PX4 sends nothing there before it has received something."""
        beat = bytes(HEARTBEAT.pack(self._own))
        if self.takes_stations:  # this one, too: PX4 does not ask whose they are
            self._ground.send(beat)
        if not any(self._heartbeats[link] for link, ground in self._links.items() if not ground):
            self._companion.send(beat)

    @property
    def is_commanded(self) -> bool:
        """Whether a companion has commanded the surfaces in the last tenth of a second."""
        recent = 0.1 * self.step_hz
        return self.commanded_step >= 0 and self._step - self.commanded_step <= recent

    def take_events(self) -> list[str]:
        """What the firmware reported in words, each once."""
        events, self._events = self._events, []
        return events

    def close(self) -> None:
        """Give the ports back."""
        self._ground.close()
        self._companion.close()

    def _collect(self) -> None:
        for source, is_ground in ((self._ground, True), (self._companion, False)):
            for _ in range(BURST):
                data = source.receive()
                if data is None:
                    break
                if is_ground:
                    self._look_at(data)
                elif data[7:10] == ATTITUDE_QUATERNION and data[0] == mavlink.PROTOCOL_MARKER_V2:
                    self._attitude_before_ms = self._attitude_ms
                    self._attitude_ms = int.from_bytes(data[10:14], "little")
                if not is_ground:
                    self._keep(data)
                for link, ground in self._links.items():
                    if ground == is_ground:
                        self._out[link].append(data)

    def _keep(self, data: bytes) -> None:
        if self.record is not None:
            stamp = (self._step * 1_000_000 // self.step_hz).to_bytes(8, "big")
            for frame in split_frames(self._split, data)[0]:
                self.record.write(stamp + frame.raw)

    def _look_at(self, data: bytes) -> None:
        for frame in split_frames(self._split, data)[0]:
            if (frame.system, frame.component) != (self._system, mavlink.MAV_COMP_ID_AUTOPILOT1):
                continue
            message = frame.message
            kind = message.get_type()
            if kind == "HEARTBEAT":
                self._greeting = frame.raw
                self.armed = message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED != 0
                self.custom_mode = message.custom_mode
            elif kind == "SYS_STATUS":
                healthy = message.onboard_control_sensors_health & self._ready_bits
                self.ready = healthy == self._ready_bits
            elif kind == "STATUSTEXT":
                self.texts.add(message.text)
                self._events.append(f"it reports: {message.text}")
            elif kind == "PARAM_VALUE" and self.parameters is not None:
                self.parameters.take(message)
            elif kind.startswith("MISSION_") and self.mission is not None:
                answer = self.mission.answer(message)
                if answer is not None:
                    self.command(answer)
