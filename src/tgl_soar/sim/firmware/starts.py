"""How each firmware is started, by the name that the bridge has for it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, TypeAlias

from tgl_soar.config.airframe import Airframe
from tgl_soar.config.site import Site
from tgl_soar.sim.firmware import ardupilot, px4
from tgl_soar.sim.firmware.relay import Relay
from tgl_soar.sim.firmware.simulation import Physics

# Its program, the folder it runs in, for whom, where, and the parameters that differ.
Start: TypeAlias = Callable[
    [Path, Path, Airframe, Site, Mapping[str, float]], tuple[Physics, Relay]
]

STARTS: Final[Mapping[str, Start]] = {"px4": px4.start, "ardupilot": ardupilot.start}
