"""A flight in one process, over real frames, with a log: the module in lockstep with the world."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import load_airframe, load_parameters, load_site, shipped
from tgl_soar.onboard.flightlog.topics import VERSION
from tgl_soar.onboard.flightlog.ulog_messages import LogMetadata
from tgl_soar.onboard.flightlog.writer import FlightRecorder
from tgl_soar.onboard.module import ModuleOptions, Onboard
from tgl_soar.onboard.setup import setup_from
from tgl_soar.sim.world import make_world
from tgl_soar.types import SurfaceCommand

AIRFRAME = shipped("airframes/eclipson_c.toml")
SITE = shipped("sites/tunnel.toml")
METADATA = LogMetadata(
    {"sys_name": "tgl_soar", "ver_log": str(VERSION), "ver_sw": "0.1.0"},
    {"airframe": AIRFRAME.read_text(), "site": SITE.read_text()},
)
ENGAGED_S, MOVED_S = 0.4, 2.0  # when the operator engages, and when the line is moved


class LoggedFlight:
    """The paper's tunnel, from the release on; `run` flies it on."""

    def __init__(
        self,
        recorder: FlightRecorder,
        *,
        seed: int = 1,
        airframe_path: Path = AIRFRAME,
        parameters: dict[str, float] | None = None,
        **options: Any,
    ) -> None:
        airframe, site = load_airframe(airframe_path), load_site(SITE)
        values = load_parameters(airframe, airframe_path, site, SITE).changed(parameters or {})
        self.world = make_world(airframe, site, seed=seed, turbulence=0.02)
        self.world.held = True
        self.console: list[str] = []
        self.onboard = Onboard(
            setup_from(airframe, site, values),
            lambda _frame: True,
            0.0,
            ModuleOptions(lockstep=True, console=self.console.append, recorder=recorder, **options),
        )
        self._vehicle = mavlink.MAVLink(None, 1, 1)
        self._station = mavlink.MAVLink(None, 255, 190)
        self._position = 0

    def run(self, seconds: float) -> None:
        world, onboard = self.world, self.onboard
        command = SurfaceCommand(world.trim.elevator, 0.0, 0.0, 0.0)
        for _ in range(round(seconds * world.step_hz)):
            now_s = world.time_s
            step = round(now_s * world.step_hz)
            ms = round(now_s * 1e3)
            if step % round(world.step_hz) == 0:
                self.receive(mavlink.MAVLink_heartbeat_message(1, 3, 81, 0, 4, 3))
            if step == round(ENGAGED_S * world.step_hz):
                self.set("OP_ENGAGE", 1.0)
            if step == round(MOVED_S * world.step_hz):
                self.set("TGL_X", 0.3)
            at = world.position
            if at.sequence != self._position:
                self._position = at.sequence
                self.receive(
                    mavlink.MAVLink_local_position_ned_message(
                        ms,
                        *(at.north_m, at.east_m, at.down_m),
                        *(at.velocity_north_mps, at.velocity_east_mps, at.velocity_down_mps),
                    )
                )
            self.receive(mavlink.MAVLink_attitude_quaternion_message(ms, *world.attitude[2:]))
            output = onboard.output
            if output is not None and output.active:
                world.held = False
                command = output.command
            world.step(command)

    def receive(self, message: Any, *, station: bool = False) -> None:
        sender = self._station if station else self._vehicle
        frame = message.pack(sender)
        sender.seq = (sender.seq + 1) % 256
        self.onboard.event(bytes(frame), self.world.time_s)

    def set(self, name: str, value: float) -> None:
        self.receive(
            mavlink.MAVLink_param_set_message(1, 191, name.encode(), value, 9), station=True
        )


def recorded(folder: Path, seconds: float = 4.0, **options: Any) -> Path:
    """Fly and land; the log's first part."""
    recorder = FlightRecorder(folder, METADATA, 0.0, patient=True, **options)
    flight = LoggedFlight(recorder)
    recorder.start()
    flight.run(seconds)
    flight.onboard.stop()
    recorder.stop()
    return logs_in(folder)[0]


def logs_in(folder: Path, ending: str = "ulg") -> list[Path]:
    """The logs of a folder, by name."""
    return sorted(folder.rglob(f"*.{ending}"))
