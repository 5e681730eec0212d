"""The simulated world as a bridge steps it: world, Pixhawk, pilot, faults and log, no sockets.

A bridge gives it time and carries its datagrams; here is what stands behind them.  A real firmware
in the place of the Pixhawk has a simulation of its own (`sim.firmware.simulation`); what both have
is `SteppedWorld`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Final, NamedTuple

import msgspec
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.airframe import Airframe, ModelKind
from tgl_soar.config.site import Site, Start
from tgl_soar.sim.channels import NEUTRAL
from tgl_soar.sim.faults import Fault
from tgl_soar.sim.injection import Injection, of_duplicate
from tgl_soar.sim.pilot import SafetyPilot
from tgl_soar.sim.routing import LinkId
from tgl_soar.sim.sensors import LASER_RANGE, MEMS_IMU, PITOT, RECEIVERS, Sensors
from tgl_soar.sim.throw import Throw, ThrownWorld, place_to_throw
from tgl_soar.sim.truth_log import TruthLog
from tgl_soar.sim.vehicle.modes import FBWA, MANUAL
from tgl_soar.sim.vehicle.pixhawk import Pixhawk
from tgl_soar.sim.vehicle.sensed import Sensed
from tgl_soar.sim.world import World, make_world, site_field
from tgl_soar.types import AttitudeSample, SurfaceCommand, polar_sink

# After it has come down, before somebody has carried the aircraft back: longer than an autopilot's
# estimator takes to find that it stands still.  EKF2 of PX4 takes four to five seconds.
LYING_S: Final = 10.0
TRUTH_HZ: Final = 5
DUPLICATE_UPTIME_S: Final = 3600.0  # since when the other autopilot has been running, and longer
LOG_COLUMNS: Final = (
    "time_s",
    "x_m",
    "y_m",
    "z_m",
    "velocity_x_mps",
    "velocity_y_mps",
    "climb_mps",
    "roll_rad",
    "pitch_rad",
    "heading_rad",
    "wind_x_mps",
    "wind_y_mps",
    "updraft_mps",
    "airspeed_mps",
    "alpha_rad",
    "elevator",
    "aileron",
    "rudder",
    "brake",
    "throttle",
    "mode",
    "flying",
    "overridden",
)


# As `analysis/experiments/outdoors/outdoors.py` throws in the middle: into 8 to 10 m/s of wind at
# the edge a push, no throw with a run.
IN_HAND: Final = Throw(time_s=inf, speed_mps=3.0, roll_rad=0.0, pitch_rad=0.0, heading_rad=0.0)
THROW_AFTER_S: Final = 2.0


class TimedSetting(NamedTuple):
    """A parameter of the autopilot that a ground station sets in flight."""

    name: str
    value: float
    at_s: float


@dataclass(frozen=True)
class Options:
    """How to simulate; times in seconds of simulated time unless named wall."""

    model: ModelKind | None = None  # None: the airframe file's
    seed: int = 1
    turbulence: float | None = None  # fraction of the reference wind; None: the site's
    step_hz: int = 200
    pilot: bool = True
    held: bool = True  # at the start, until the first override
    by_hand: bool = False  # it is held in a hand before the crest, and thrown after that
    armed: bool = True  # when it begins
    truth: bool = True
    uptime_s: float = 0.0
    allow_odometry: bool = False
    faults: tuple[Fault, ...] = ()
    pitot: bool = True
    receiver: str = "local"  # of `sim.sensors.RECEIVERS`; a firmware has its own
    rangefinder: bool = False
    parameters: tuple[tuple[str, float], ...] = ()  # of the autopilot
    later: tuple[TimedSetting, ...] = ()  # of a firmware: set in flight
    record: Path | None = None  # what passed between a firmware and its companion, as .tlog
    log: Path | None = None
    log_hz: int = 50


class SteppedWorld:
    """World, pilot, faults and log around an autopilot, whichever it is."""

    def __init__(
        self,
        airframe: Airframe,
        site: Site,
        options: Options,
        folder: Path,
        step_hz: int,
        sensors: Sensors,
    ) -> None:
        self.injection = Injection(options.faults, options.seed)
        field = None if site.air is None else self.injection.field(site_field(site, folder))
        self.world: World = make_world(
            airframe.flown_as(options.model),
            site,
            seed=options.seed,
            turbulence=options.turbulence,
            step_hz=step_hz,
            folder=folder,
            field=field,
            sensors=sensors,
        )
        self.crashes = 0
        self._options = options
        self._polar = airframe.polar.as_polar()
        self._pilot = SafetyPilot(self.world.trim_pitch_rad, 1.0 / step_hz)
        self._lying_until = -1  # step
        self._truth_every = step_hz // TRUTH_HZ
        self._log_every = max(1, round(step_hz / options.log_hz))
        self._events: list[str] = []
        self._log = TruthLog(options.log, LOG_COLUMNS) if options.log is not None else None

    @property
    def time_s(self) -> float:
        """Simulated time."""
        return self.world.time_s

    @property
    def flying(self) -> bool:
        """Neither held nor lying on the ground."""
        return not self.world.held and not self.world.crashed

    def _turns(self) -> list[tuple[Fault, bool]]:
        """The faults that begin (true) or are over now, which the console reports."""
        turns = self.injection.turns(self.time_s)
        self._events += [f"fault {'begins' if b else 'is over'}: {fault}" for fault, b in turns]
        return turns

    def _step_world(self, surfaces: SurfaceCommand) -> None:
        world = self.world
        world.step(self.injection.surfaces(self.time_s, surfaces, 1.0 / world.step_hz))
        if world.crashed and self._lying_until < 0:
            self.crashes += 1
            self._lying_until = world.steps + round(LYING_S * world.step_hz)
            self._events.append(f"lost: {world.crashed}")

    def _carry_back(self) -> bool:
        """Hold at the start again what has lain there for long enough; whether it has."""
        if not 0 <= self._lying_until <= self.world.steps:
            return False
        self._lying_until = -1
        self.world.relaunch()
        self.world.held = True
        self._events.append("carried back and held at the start again")
        return True

    def _pilots_sticks(
        self, attitude: AttitudeSample, manual: bool, elevator: float
    ) -> SurfaceCommand:
        """How the safety pilot holds the sticks, in manual flight or in a mode that helps."""
        truth = self.world.truth
        return self._pilot.sticks(
            (truth.x_m, truth.y_m, truth.z_m),
            (truth.velocity_x_mps, truth.velocity_y_mps, truth.climb_mps),
            truth.heading_rad,
            attitude,
            manual,
            elevator,
        )

    def _truth_due(self) -> tuple[tuple[bytes, float], ...]:
        """What is to be reported of the truth to ground stations in this step, by name."""
        if not self._options.truth or self.world.steps % self._truth_every:
            return ()
        truth = self.world.truth
        return (
            (b"updraft", truth.updraft_mps),
            (b"sink", polar_sink(self._polar, truth.wind_x_mps)),
            (b"true_x", truth.x_m),
            (b"true_y", truth.y_m),
            (b"true_z", truth.z_m),
            (b"airspeed", truth.airspeed_mps),
        )

    def _log_row(self, time_s: float, mode: int, overridden: bool) -> None:
        """time_s: on the autopilot's clock."""
        if self._log is not None:
            row = (time_s, *self.world.truth[1:], self.world.throttle)
            self._log.add((*row, mode, self.flying, overridden))


def _with_hand(site: Site) -> Site:
    """A site whose start is in a hand.  Errors: ValueError without a slope."""
    if site.ground is None:
        raise ValueError("--launch hand: the site has no [ground], so there is no place for a hand")
    x_m, z_m = place_to_throw(site.ground.profile)
    return msgspec.structs.replace(site, start=Start(x_m=x_m, z_m=z_m))


class Simulation(SteppedWorld):
    """World, Pixhawk, pilot and log, one step at a time; no sockets, no clock."""

    def __init__(self, airframe: Airframe, site: Site, options: Options, folder: Path) -> None:
        sensors = Sensors(
            position=RECEIVERS[options.receiver],
            imu=MEMS_IMU,
            airspeed=PITOT if options.pitot else None,
            rangefinder=LASER_RANGE if options.rangefinder else None,
        )
        if options.by_hand:
            site = _with_hand(site)
        super().__init__(airframe, site, options, folder, options.step_hz, sensors)
        self._in_hand = ThrownWorld(self.world, IN_HAND) if options.by_hand else None
        if self._in_hand is not None:
            self.world = self._in_hand
        self._home = site.position.home
        # Where poses are forwarded the autopilot is set up to take them.
        self._parameters = {"VISO_TYPE": 1.0} if site.forward is not None else {}
        self._parameters |= dict(options.parameters)
        self.pixhawk = self._autopilot(airframe, options, options.uptime_s, armed=options.armed)
        # It receives all that the other receives; what it sends goes nowhere until its fault acts.
        self._duplicates = self.injection.named("autopilot.second")
        self._duplicate = (
            self._autopilot(airframe, options, options.uptime_s + DUPLICATE_UPTIME_S, armed=True)
            if self._duplicates
            else None
        )
        self._passed_over_s = 0.0
        self._sensed = self._sense(False)
        self.world.held = options.held
        self._log_step()

    def _autopilot(
        self, airframe: Airframe, options: Options, uptime_s: float, *, armed: bool
    ) -> Pixhawk:
        return Pixhawk(
            airframe.surfaces,
            options.step_hz,
            parameters=self._parameters,
            trim_pitch_rad=self.world.trim_pitch_rad,
            allow_odometry=options.allow_odometry,
            uptime_s=uptime_s,
            home=self._home,
            armed=armed,
        )

    # --- the links of the autopilot, or of both that claim to be it ----------------------

    def add_link(self, link: LinkId, *, ground: bool) -> None:
        """A link to a ground station or to a companion."""
        self.pixhawk.add_link(link, ground=ground)
        if self._duplicate is not None and not ground:
            self._duplicate.add_link(link, ground=False)

    def remove_link(self, link: LinkId) -> None:
        """A link that is gone."""
        self.pixhawk.remove_link(link)
        if self._duplicate is not None:
            self._duplicate.remove_link(link)

    def receive(self, link: LinkId, data: bytes) -> None:
        """Take one datagram of a link."""
        self.pixhawk.receive(link, data)
        if self._duplicate is not None:
            self._duplicate.receive(link, data)

    def take_datagrams(self, links: Sequence[LinkId] | None = None) -> list[tuple[LinkId, bytes]]:
        """What goes out on some links, or on all."""
        datagrams = self.pixhawk.take_datagrams(links)
        if self._duplicate is not None:
            of_duplicate = self._duplicate.take_datagrams(links)
            if any(fault.acts(self.time_s) for fault in self._duplicates):
                datagrams += of_duplicate
        return datagrams

    # --- time ----------------------------------------------------------------------------

    def step(self) -> None:
        """One step of everything."""
        world, pixhawk = self.world, self.pixhawk
        self._turn_faults()
        self._launch_or_carry_back()
        if self._options.pilot:
            self._fly_by_hand()
        world.throttle = pixhawk.outputs.throttle if pixhawk.armed else 0.0
        self._step_world(pixhawk.surfaces)
        self._sensed = self._sense(self.flying)
        reported = self._corrupted(self._sensed)
        pixhawk.step(self._sensed, reported)
        if self._duplicate is not None:
            self._duplicate.step(
                reported._replace(
                    attitude=of_duplicate(reported.attitude),
                    position=of_duplicate(reported.position),
                )
            )
        for name, value in self._truth_due():
            pixhawk.broadcast(
                mavlink.MAVLink_named_value_float_message(pixhawk.boot_ms, name, value),
                ground_only=True,
            )
        if world.steps % self._log_every == 0:
            self._log_step()

    def take_events(self) -> list[str]:
        """What the console should report, each once."""
        events = [*self.pixhawk.take_events(), *self._events]
        self._events = []
        return events

    @property
    def booted(self) -> bool:
        """Whether the autopilot speaks; this one does from the first."""
        return True

    def summary(self) -> str:
        """What became of the overrides."""
        counts = self.pixhawk.counts
        return (
            f"overrides: {counts.overrides_accepted} accepted,"
            f" {counts.overrides_refused} refused, {counts.override_timeouts} timed out"
        )

    def close(self) -> None:
        """Finish the log."""
        if self._log is not None:
            self._log.close()

    def _turn_faults(self) -> None:
        """Report what begins and what is over, and what becomes of the autopilot by it."""
        pixhawk = self.pixhawk
        for fault, begins in self._turns():
            if fault.kind.name == "autopilot.reboot":
                (pixhawk.shut_down if begins else pixhawk.boot)()
            elif fault.kind.name == "pilot.takes":
                pixhawk.set_mode(FBWA if begins else MANUAL, "the pilot")
            elif fault.kind.name == "autopilot.second" and begins and self._duplicate is not None:
                self._duplicate.announce()

    def _corrupted(self, sensed: Sensed) -> Sensed:
        """What the autopilot reports of what it senses."""
        sample = self.injection.sample
        return sensed._replace(
            attitude=sample("attitude", self.time_s, sensed.attitude),
            position=sample("position", self.time_s, sensed.position),
            imu=sample("imu", self.time_s, sensed.imu),
            pitot=sample("airspeed", self.time_s, sensed.pitot),
            rangefinder=sample("rangefinder", self.time_s, sensed.rangefinder),
        )

    def _launch_or_carry_back(self) -> None:
        world, pixhawk = self.world, self.pixhawk
        if self._in_hand is not None and not self.world.crashed:
            self._throw(self._in_hand)
        elif self._carry_back():
            pixhawk.restart()
            if self._in_hand is not None:
                self._in_hand.throw = IN_HAND
        elif world.held and self._is_taken():
            world.held = False
            self._events.append("launched: the surfaces are overridden")

    def _is_taken(self) -> bool:
        """Whether the module moves the surfaces."""
        pixhawk = self.pixhawk
        return pixhawk.armed and pixhawk.mode == MANUAL and pixhawk.is_overridden()

    def _throw(self, world: ThrownWorld) -> None:
        """The arm swings a while after the surfaces are overridden for the first time."""
        if world.throw == IN_HAND and self._is_taken():
            world.throw = IN_HAND._replace(time_s=world.time_s + THROW_AFTER_S)
            self._events.append(f"thrown in {THROW_AFTER_S:g} s: the surfaces are overridden")
        elif world.held and world.is_free:
            world.held = False
            self._events.append("thrown")

    def _fly_by_hand(self) -> None:
        pixhawk = self.pixhawk
        if not self.flying or pixhawk.is_overridden() or self._sensed.attitude.sequence == 0:
            self._pilot.hand_over()
            pixhawk.pilot_sticks = NEUTRAL
            return
        pixhawk.pilot_sticks = self._pilots_sticks(
            self._sensed.attitude, pixhawk.mode == MANUAL, pixhawk.surfaces.elevator
        )

    def _sense(self, flying: bool) -> Sensed:
        world = self.world
        world.poll_attitude()
        world.poll_position()
        position, airspeed_mps = world.position, world.airspeed_mps
        return Sensed(
            attitude=world.attitude,
            position=position,
            airspeed_mps=airspeed_mps,
            flying=flying,
            imu=world.imu,
            pitot=world.airspeed,
            rangefinder=world.rangefinder,
        )

    def _log_step(self) -> None:
        time_s = self._options.uptime_s + self._passed_over_s + self.world.time_s
        self._log_row(time_s, self.pixhawk.mode, self.pixhawk.is_overridden())

    def pass_over(self, seconds: float) -> None:
        """So long no step was made: the autopilot's clock runs on, as a real one does.

        The other way, all it reports would look late to whoever has learnt its clock before.
        """
        self._passed_over_s += seconds
        self.pixhawk.pass_over(seconds)
        if self._duplicate is not None:
            self._duplicate.pass_over(seconds)
