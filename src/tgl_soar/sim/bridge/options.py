"""All that can be chosen of a bridge, in one object."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from tgl_soar.sim.bridge.mocap import MocapOptions
from tgl_soar.sim.ports import Address
from tgl_soar.sim.simulation import Options


@dataclass(frozen=True)
class Pace:
    """How time goes on."""

    lockstep: bool = False
    lockstep_ground: bool = False
    duration_s: float | None = None  # simulated
    patience_s: float = 5.0  # wall: a silent participant is waited for so long
    start_timeout_s: float = 30.0  # wall: for all participants to appear


@dataclass(frozen=True)
class PortOptions:
    """Where others listen, and the bridge's own ports (port 0: any)."""

    ground: tuple[Address, ...] = (("127.0.0.1", 14550),)
    companion: Address = ("127.0.0.1", 14540)
    ground_local: Address = ("127.0.0.1", 18570)
    companion_local: Address = ("127.0.0.1", 14580)


@dataclass(frozen=True)
class FirmwareOptions:
    """A real firmware in the place of the simulated Pixhawk."""

    name: str  # one of `sim.firmware.starts.STARTS`
    program: Path | None
    folder: Path = Path("out/firmware")  # where it runs and keeps its files
    mission: Path | None = None  # a file that it is given before it is armed


@dataclass(frozen=True)
class BridgeOptions:
    """What is simulated, for whom, and how time goes on."""

    airframe: Path
    site: Path
    simulation: Options = field(default_factory=Options)
    pace: Pace = field(default_factory=Pace)
    ports: PortOptions = field(default_factory=PortOptions)
    firmware: FirmwareOptions | None = None  # None: the simulated Pixhawk
    mocap: MocapOptions | None = None  # None: no motion capture
