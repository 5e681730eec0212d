"""A real firmware in the place of the simulated Pixhawk: our world around it, its links relayed.

An aircraft without a propeller cannot take off.  So it is launched in the air, step by step:

    boots     time goes on, the aircraft is held at the start, in the wind
    aligns    until the firmware reports that it could be armed, and has its mission, if any
    armed     by a ground station's command, in the mode for sticks
    free      when a companion commands the surfaces in the mode that obeys it

While no companion commands them, a pilot flies by their transmitter (`sim.pilot`).  An aircraft
that hits something lies there for 10 s and is then held at the start again.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.airframe import Airframe
from tgl_soar.config.site import Site
from tgl_soar.link.autopilots.base import ParameterCodec
from tgl_soar.sim.channels import NEUTRAL
from tgl_soar.sim.firmware import FirmwareError
from tgl_soar.sim.firmware.failing_sensors import FailingSensors
from tgl_soar.sim.firmware.mission import MissionItem, MissionUpload, set_home
from tgl_soar.sim.firmware.parameters import ParameterChanges
from tgl_soar.sim.firmware.relay import Relay
from tgl_soar.sim.firmware.sensors import FirmwareSensors, Readings, firmware_sensors
from tgl_soar.sim.routing import LinkId
from tgl_soar.sim.simulation import Options, SteppedWorld
from tgl_soar.types import SurfaceCommand

ASK_S: Final = 1.0  # between two requests to arm, or for a mode


# Of the pilot's transmitter at the receiver.
RECEIVED: Final = 0
NO_PULSES: Final = 1
THROTTLE_LOW: Final = 2  # sticks centred: how most receivers say that there is no signal
SIGNALS: Final = {"transmitter.silent": NO_PULSES, "transmitter.failsafe": THROTTLE_LOW}


class Sticks(NamedTuple):
    """The pilot's transmitter."""

    deflections: SurfaceCommand  # of the sticks, as they would move the surfaces
    takes: bool = False  # their mode switch is at the mode in which they take over
    signal: int = RECEIVED


class Physics(Protocol):
    """The firmware's own simulator interface."""

    name: str
    step_hz: int
    first_item: int  # of a mission file: 0: home is an item of it
    manual_mode: int  # custom_mode in which sticks move the surfaces, and it is armed
    obeys: Mapping[str, int]  # command message of a companion: custom_mode that obeys it
    codec: ParameterCodec
    reads_ours: bool  # all sensors; False: its simulator makes its own of the truth

    def exchange(self, readings: Readings, sticks: Sticks) -> SurfaceCommand:
        """One step in lockstep: the servos' commands."""
        ...

    @property
    def throttle(self) -> float:
        """What a propeller's motor is commanded since, 0 … 1; 0 without one."""
        ...

    def helped(self, readings: Readings, texts: Collection[str], /) -> Any | None:
        """What a ground station sends to help its estimator start; `texts`: its messages so far."""
        ...

    def ask_for_mode(self, system: int, custom_mode: int) -> Any:
        """The command for a mode."""
        ...

    def close(self) -> None:
        """It is over."""
        ...


class FirmwareSimulation(SteppedWorld):
    """World, firmware, pilot and log, one step at a time."""

    def __init__(
        self,
        airframe: Airframe,
        site: Site,
        options: Options,
        folder: Path,
        physics: Physics,
        relay: Relay,
        mission: tuple[MissionItem, ...] = (),
    ) -> None:
        """`mission`: what it is given before it is armed, and its home then; none: nothing."""
        sensors = firmware_sensors(physics.step_hz, pitot=options.pitot)
        super().__init__(airframe, site, options, folder, physics.step_hz, sensors)
        self.world.held = True
        self.pixhawk = relay
        self._physics = physics
        self._system = airframe.autopilot.system_id
        self._mission = MissionUpload(mission[physics.first_item :], self._system)
        self._mission.accepted = not mission
        self._home = mission[0] if mission else None
        relay.mission = self._mission
        self._sensors = FirmwareSensors(
            self.world, site.position.home, options.seed, gps=site.mocap is None
        )
        self._failing = FailingSensors(options.faults)
        if self._failing.faults and not physics.reads_ours:
            raise FirmwareError(
                f"{self._failing.faults[0].kind.name}: {physics.name} simulates its sensors itself:"
                " let its own SIM_… parameters change, by --autopilot-parameter NAME=NUMBER@S"
            )
        self._pilot_takes = False
        self._signal = RECEIVED
        self._changes = ParameterChanges(options.later, physics.codec, self._system)
        relay.parameters = self._changes
        self._surfaces = NEUTRAL
        self._ask_every = round(ASK_S * physics.step_hz)
        self._stage = 0
        self._events.append(f"waiting for {physics.name} to boot; the aircraft is held")
        self._record = None if options.record is None else options.record.open("wb")
        relay.record = self._record

    # --- links ---------------------------------------------------------------------------

    def add_link(self, link: LinkId, *, ground: bool) -> None:
        """A link to a ground station or to a companion."""
        self.pixhawk.add_link(link, ground=ground)

    def remove_link(self, link: LinkId) -> None:
        """A link that is gone."""
        self.pixhawk.remove_link(link)

    def receive(self, link: LinkId, data: bytes) -> None:
        """Take one datagram of a link."""
        self.pixhawk.receive(link, data)

    def take_datagrams(self, links: Sequence[LinkId] | None = None) -> list[tuple[LinkId, bytes]]:
        """What goes out on some links, or on all."""
        return self.pixhawk.take_datagrams(links)

    # --- time ----------------------------------------------------------------------------

    def pass_over(self, seconds: float) -> None:
        """A firmware in the loop takes its time from our steps, and so do its stamps."""

    @property
    def booted(self) -> bool:
        """Whether the firmware speaks."""
        return self.pixhawk.custom_mode >= 0

    def step(self) -> None:
        """One step of everything."""
        world = self.world
        for fault, begins in self._turns():
            if fault.kind.name == "pilot.takes":
                self._pilot_takes = begins
            elif fault.of == "transmitter":
                self._signal = SIGNALS[fault.kind.name] if begins else RECEIVED
            elif fault.kind.name == "station.silent":
                self.pixhawk.takes_stations = not begins
        self._set_parameters()
        self._launch()
        world.throttle = self._physics.throttle
        self._step_world(self._surfaces)
        readings = self._failing.of(self._sensors.read())
        self._surfaces = self._physics.exchange(readings, self._sticks())
        help_ = self._physics.helped(readings, self.pixhawk.texts)
        if help_ is not None:
            self.pixhawk.command(help_)
        self.pixhawk.step(self.time_s)
        if world.steps % world.step_hz == 0:
            self.pixhawk.greet()
        for name, value in self._truth_due():
            self.pixhawk.broadcast(
                mavlink.MAVLink_named_value_float_message(round(1e3 * self.time_s), name, value)
            )
        if world.steps % self._log_every == 0:
            self._log_row(self.time_s, self.pixhawk.custom_mode, self.pixhawk.is_commanded)

    def take_events(self) -> list[str]:
        """What the console should report, each once."""
        events = [*self.pixhawk.take_events(), *self._events]
        self._events = []
        return events

    def summary(self) -> str:
        """What the companion sent."""
        sent = ", ".join(f"{n} {name}" for name, n in self.pixhawk.commands.items())
        return f"commands: {sent or 'none'}"

    def close(self) -> None:
        """Finish the log, end the firmware."""
        if self._record is not None:
            self._record.close()
        self._physics.close()
        self.pixhawk.close()
        if self._log is not None:  # the last one: it may find no room
            self._log.close()

    def _set_parameters(self) -> None:
        """Those of the firmware that are to change by now."""
        if not self.booted:
            return
        for message in self._changes.due(self.time_s):
            self.pixhawk.command(message)
        self._events += self._changes.take_events()

    def _launch(self) -> None:
        """The next stage of the launch, once it is due."""
        world, relay, physics = self.world, self.pixhawk, self._physics
        if self._carry_back():
            self._stage = min(self._stage, 3)
        due = world.steps % self._ask_every == 0
        if self._stage == 0 and self.booted:
            self._next(f"{physics.name} has booted: waiting until its estimator has aligned")
        elif self._stage == 1 and relay.ready and self._mission.accepted:
            self._next("aligned: arming it")
        elif self._stage == 1 and relay.ready and due:
            if self._mission.refused:
                raise FirmwareError(f"{physics.name} refuses the mission: {self._mission.refused}")
            relay.command(self._mission.begin())
        elif self._stage == 2 and relay.armed:
            if self._home is not None:
                relay.command(set_home(self._system, self._home))
            self._next("armed: held until a companion commands the surfaces")
        elif self._stage == 2 and due:
            wrong = relay.custom_mode != physics.manual_mode
            relay.command(
                physics.ask_for_mode(self._system, physics.manual_mode)
                if wrong
                else arm(self._system)
            )
        elif (
            self._stage == 3
            and relay.armed
            and relay.is_commanded
            and physics.obeys.get(relay.last_command) == relay.custom_mode
        ):
            world.held = False
            self._next(f"launched: it obeys {relay.last_command}")

    def _next(self, what: str) -> None:
        self._stage += 1
        self._events.append(what)

    def _sticks(self) -> Sticks:
        world, relay = self.world, self.pixhawk
        obeyed = self._physics.obeys.get(relay.last_command) == relay.custom_mode
        if not self.flying or (relay.is_commanded and obeyed):
            self._pilot.hand_over()
            return Sticks(NEUTRAL, self._pilot_takes, self._signal)
        manual = relay.custom_mode == self._physics.manual_mode
        sticks = self._pilots_sticks(world.attitude, manual, self._surfaces.elevator)
        return Sticks(sticks, self._pilot_takes, self._signal)


def arm(system: int) -> Any:
    """The command that arms."""
    return mavlink.MAVLink_command_long_message(
        target_system=system,
        target_component=1,
        command=mavlink.MAV_CMD_COMPONENT_ARM_DISARM,
        confirmation=0,
        param1=1.0,
        param2=0.0,
        param3=0.0,
        param4=0.0,
        param5=0.0,
        param6=0.0,
        param7=0.0,
    )
