"""The whole module for hours: frames in, frames out, across the wrap of the autopilot's clock.

The vehicle's clock begins so that `time_boot_ms` ends (2³² ms, 49.7 days) half-way through the
flight.  Every frame is packed by pymavlink and read by the module as from a wire; the surfaces
move as the module's overrides say.  Nothing waits for a clock: the flight takes as long as it
takes to compute.
"""

from __future__ import annotations

import resource
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.analysis.campaigns.drawn_faults import place
from tgl_soar.autopilot import mode_name
from tgl_soar.config.airframe import ModelKind, Surfaces
from tgl_soar.link.clock import MILLISECONDS_WRAP_S
from tgl_soar.onboard.module import ModuleOptions, Onboard
from tgl_soar.onboard.setup import setup_from
from tgl_soar.sim.channels import deflection_from_pwm
from tgl_soar.sim.sensor_messages import attitude_quaternion, local_position_ned
from tgl_soar.sim.world import make_world
from tgl_soar.types import SurfaceCommand

TURBULENCE: Final = 0.01
ENGAGED_S: Final = 2.0  # when the operator engages; the aircraft is held until then
RELEASED: Final = 0
PARTS: Final = 24  # looked at so often


class Part(NamedTuple):
    """How the module stands after a part of the flight."""

    flown_s: float
    resident_kib: int  # memory of this process
    tick_us: float  # mean time that one tick and its frames took, in this part
    late_s: float  # the loop's clock against the vehicle's: 0 is no drift
    largest_e_rho_m: float


@dataclass
class LongFlight:
    """What became of a long flight."""

    duration_s: float
    ticks: int = 0
    expected_ticks: int = 0
    reboots: int = 0  # that the module took the wrap for
    stale: int = 0  # frames that were not taken for new
    lost: int = 0  # frames by the gaps of their sequence
    ended: str = ""  # why it ended early
    wrapped: bool = False
    parts: list[Part] = field(default_factory=list)

    @property
    def grown_kib(self) -> int:
        """Memory at the end, more than after the first part."""
        return self.parts[-1].resident_kib - self.parts[0].resident_kib if self.parts else 0

    @property
    def is_well(self) -> bool:
        """Every tick flown, no clock mistaken, none disengaged from."""
        return (
            not self.ended
            and self.wrapped
            and self.ticks == self.expected_ticks
            and self.reboots == self.lost == 0
            and all(part.late_s == 0.0 for part in self.parts)
        )


def resident_kib() -> int:
    """Memory of this process now, as Linux counts it; the most so far where it is not reported."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
        return int(status.partition("VmRSS:")[2].split()[0])
    except (OSError, IndexError):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


class _Wire:
    """Both ends of the link: packs what the vehicle says, reads the overrides."""

    def __init__(self, surfaces: Surfaces) -> None:
        self.command: SurfaceCommand | None = None
        self._surfaces = surfaces.driven()
        self.vehicle, self.station = mavlink.MAVLink(None, 1, 1), mavlink.MAVLink(None, 255, 190)

    def take(self, frame: bytes) -> bool:
        """What the module sends: only overrides are looked at."""
        number = int.from_bytes(frame[7:10], "little")
        if frame[0] == 0xFD and number == mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE:
            payload = frame[10 : 10 + frame[1]].ljust(18, b"\0")
            pwm = struct.unpack_from("<8H", payload)
            reported = [pwm[surface.channel - 1] for surface in self._surfaces]
            self.command = (
                None
                if RELEASED in reported
                else SurfaceCommand(
                    *(
                        deflection_from_pwm(surface, value)
                        for surface, value in zip(self._surfaces, reported, strict=True)
                    )
                )
            )
        return True


def fly_long(
    duration_s: float,
    *,
    seed: int = 1,
    on_part: Callable[[Part], None] | None = None,
    model: ModelKind | None = None,
) -> LongFlight:
    """Fly for so long [s], half of it before the wrap; model: None is the airframe file's."""
    airframe, site, values, air = place()
    airframe = airframe.flown_as(model)
    world = make_world(airframe, site, seed=seed, turbulence=TURBULENCE, field=air)
    world.held = True
    trim = SurfaceCommand(world.trim.elevator, 0.0, 0.0)
    wire, setup = _Wire(airframe.surfaces), setup_from(airframe, site, values)
    onboard = Onboard(setup, wire.take, 0.0, ModuleOptions(lockstep=True))
    begun_s = MILLISECONDS_WRAP_S - 0.5 * duration_s
    flight = LongFlight(duration_s)
    steps = round(duration_s * world.step_hz)
    part_steps = max(1, steps // PARTS)
    largest, began = 0.0, perf_counter()

    def deliver(message: Any, sender: mavlink.MAVLink) -> None:
        frame = message.pack(sender)
        sender.seq = (sender.seq + 1) % 256
        onboard.event(bytes(frame), world.time_s)

    last_position = last_attitude = 0
    engaged = False
    for step in range(1, steps + 1):
        world.step(wire.command or trim)
        now_s = begun_s + world.time_s
        if step % world.step_hz == 1:
            deliver(mavlink.MAVLink_heartbeat_message(1, 3, 209, 0, 4, 3), wire.vehicle)
        if world.position.sequence != last_position:
            last_position = world.position.sequence
            fix = world.position
            deliver(local_position_ned(fix, _ms(begun_s + fix.time_s)), wire.vehicle)
        if not engaged and world.time_s >= ENGAGED_S:
            engaged = True
            deliver(mavlink.MAVLink_param_set_message(1, 191, b"OP_ENGAGE", 1.0, 9), wire.station)
        if world.attitude.sequence != last_attitude:
            last_attitude = world.attitude.sequence
            sample = world.attitude
            flight.expected_ticks += 1
            deliver(attitude_quaternion(sample, _ms(begun_s + sample.time_s)), wire.vehicle)
        if wire.command is not None:
            world.held = False
        output = onboard.output
        if output is None:
            continue
        if output.active:
            largest = max(largest, abs(output.line.e_rho_m))
        if world.crashed or (not world.held and not output.active):
            flight.ended = world.crashed or mode_name(output.mode)
            break
        if step % part_steps == 0:
            part = Part(
                flown_s=world.time_s,
                resident_kib=resident_kib(),
                tick_us=(perf_counter() - began) / part_steps * 1e6,
                late_s=round(now_s - output.time_s - (world.time_s - world.attitude.time_s), 6),
                largest_e_rho_m=largest,
            )
            flight.parts.append(part)
            (on_part or _nowhere)(part)
            largest, began = 0.0, perf_counter()
    flight.ticks = onboard.counters.ticks
    flight.reboots = onboard.session.counters.reboots
    flight.stale = onboard.session.counters.stale
    flight.lost = onboard.decoder.counters.lost
    flight.wrapped = begun_s + world.time_s > MILLISECONDS_WRAP_S
    return flight


def _ms(time_s: float) -> int:
    """As `time_boot_ms`, which has 32 bits."""
    return round(time_s * 1e3) & 0xFFFFFFFF


def _nowhere(_part: Part) -> None:
    """Nobody asked."""
