"""The bridge itself: opens what its options ask for, and lets time go on."""

from __future__ import annotations

import time
from contextlib import ExitStack
from typing import Final

from tgl_soar.config.airframe import Airframe
from tgl_soar.config.files import ConfigError, load_airframe, load_site
from tgl_soar.config.site import Site
from tgl_soar.onboard import realtime
from tgl_soar.sim.bridge.lockstep import Lockstep
from tgl_soar.sim.bridge.mocap import motive_server
from tgl_soar.sim.bridge.options import BridgeOptions
from tgl_soar.sim.bridge.simulated import Simulated
from tgl_soar.sim.bridge.slowness import Slowness
from tgl_soar.sim.bridge.traffic import Traffic
from tgl_soar.sim.motive import BEGAN_S, MotiveServer
from tgl_soar.sim.ports import Ports, open_ports
from tgl_soar.sim.simulation import Simulation

GROUND_BARRIER_S: Final = 0.05
BEHIND_STEPS: Final = 5  # so far behind, real time gives up catching up


class Bridge:
    """Everything of one simulated flight.  `close` it when it is over."""

    def __init__(self, options: BridgeOptions) -> None:
        """Errors: `ConfigError`, `PortError`, `FirmwareError`, ValueError, OSError (of the log)."""
        airframe, site = load_airframe(options.airframe), load_site(options.site)
        with ExitStack() as opened:
            ports = options.ports
            self.ports: Ports = open_ports(
                ports.ground_local, ports.ground, ports.companion_local, ports.companion
            )
            opened.callback(self.ports.close)
            self.simulation = _simulated(options, airframe, site)
            opened.callback(self.simulation.close)
            motive = self._motive(options, site)
            if motive is not None:
                opened.callback(motive.close)
            self._opened = opened.pop_all()
        self.stopping = False
        self.slowness = Slowness(time.monotonic())
        self.wall_s = 0.0
        self._pace = options.pace
        self._traffic = Traffic(self.simulation, self.ports, motive)
        self._lockstep = Lockstep(self._traffic, options.pace, lambda: self.stopping)
        self._dt_s = 1.0 / self.simulation.pixhawk.step_hz
        self._ground_every = round(GROUND_BARRIER_S / self._dt_s)

    def run(self) -> None:
        """Until the duration is over or somebody stops it.  Errors: `BridgeError`."""
        self._boot()
        if self._pace.lockstep:
            self._lockstep.gather()
        begun = time.monotonic()
        try:
            if self._pace.lockstep:
                self._run_lockstep()
            else:
                self._run_realtime()
        finally:
            self.wall_s = time.monotonic() - begun

    def stop(self, *_: object) -> None:
        """End after this step."""
        self.stopping = True

    def close(self) -> None:
        """Finish logs, give the ports back."""
        self._opened.close()

    def summary(self) -> str:
        """One line of what happened."""
        simulation = self.simulation
        ratio = simulation.time_s / self.wall_s if self.wall_s > 0.0 else 0.0
        return (
            f"{simulation.world.steps} steps, {simulation.time_s:.3f} s simulated in"
            f" {self.wall_s:.2f} s ({ratio:.1f} x real time); {simulation.summary()};"
            f" {simulation.crashes} crashes; {self.slowness.given_up_s:.2f} s given up"
        )

    def _motive(self, options: BridgeOptions, site: Site) -> MotiveServer | None:
        if options.mocap is None:
            return None
        if site.mocap is None:
            raise ConfigError(f"{options.site}: --mocap natnet needs a [mocap] table")
        uptime_s = options.simulation.uptime_s

        def simulated_s() -> float:
            return uptime_s + self.simulation.time_s

        def real_s() -> float:
            return BEGAN_S + time.monotonic()

        clock_s = simulated_s if options.pace.lockstep else real_s
        step_hz = self.simulation.pixhawk.step_hz
        return motive_server(options.mocap, site.mocap, clock_s, step_hz=step_hz)

    def _boot(self) -> None:
        """A real firmware must have booted before anybody can be asked to wait for it."""
        while not self.simulation.booted and not self.stopping:
            self._step()
            self._traffic.drain(self.ports.ground)
            self._traffic.drain(self.ports.companion)
            self._traffic.flush()

    def _over(self) -> bool:
        duration = self._pace.duration_s
        return self.stopping or (
            duration is not None and self.simulation.time_s >= duration - 0.5 * self._dt_s
        )

    def _step(self) -> None:
        self._traffic.deliver()
        self._traffic.serve_mocap()
        self.simulation.step()
        self._traffic.expose()
        for event in self.simulation.take_events():
            self._traffic.report(event)

    def _run_realtime(self) -> None:
        if not realtime.accompany():
            self._traffic.report("no real-time priority: a busy machine may interrupt the flight")
        deadline = time.monotonic()
        self.slowness = Slowness(deadline)
        while not self._over():
            deadline = self._keep_pace(deadline)
            self._step()
            self._traffic.flush()

    def _keep_pace(self, deadline: float) -> float:
        """Serve the ports until the deadline; the next one."""
        traffic = self._traffic
        while True:
            left = deadline - time.monotonic()
            if left <= 0.0 or self.stopping:
                break
            if traffic.wait(left):
                traffic.serve()
                traffic.flush()
        if -left > BEHIND_STEPS * self._dt_s:
            self.slowness.lose(-left)
            if not self._pace.lockstep:
                self.simulation.pass_over(-left)
            deadline -= left
        if text := self.slowness.report(deadline):
            traffic.report(text)
        traffic.drain(self.ports.companion)
        traffic.drain(self.ports.ground)
        return deadline + self._dt_s

    def _run_lockstep(self) -> None:
        traffic, lockstep = self._traffic, self._lockstep
        deadline = time.monotonic()
        while not self._over():
            self._step()
            if lockstep.is_peer_missing:
                # At natural pace, until they return.
                traffic.flush()
                deadline = self._keep_pace(max(deadline, time.monotonic() - self._dt_s))
                lockstep.readmit()
                lockstep.meet_companions()
                continue
            lockstep.meet_companions()
            if not self._pace.lockstep_ground:
                traffic.drain(self.ports.ground)
                traffic.flush()
            elif self.simulation.world.steps % self._ground_every == 0:
                lockstep.meet_stations()


def _simulated(options: BridgeOptions, airframe: Airframe, site: Site) -> Simulated:
    """The simulated Pixhawk, or a real firmware."""
    folder, firmware = options.site.parent, options.firmware
    if firmware is None:
        return Simulation(airframe, site, options.simulation, folder)
    # What a firmware needs is loaded only where there is one.
    from tgl_soar.sim.firmware.mission import read_mission
    from tgl_soar.sim.firmware.simulation import FirmwareSimulation
    from tgl_soar.sim.firmware.starts import STARTS

    if firmware.program is None:
        raise ValueError(f"--autopilot {firmware.name}: give its program with --firmware")
    mission = () if firmware.mission is None else read_mission(firmware.mission)
    parameters = dict(options.simulation.parameters)
    start = STARTS[firmware.name]
    physics, relay = start(firmware.program, firmware.folder, airframe, site, parameters)
    return FirmwareSimulation(airframe, site, options.simulation, folder, physics, relay, mission)
