"""One file for each autopilot firmware: how it wants to be commanded.

base                 what each firmware has to answer
ardupilot, px4, paparazzi, bridge    one firmware each;  bridge: the simulated Pixhawk
requirements         what a firmware's parameters must be
aileron_brake_mixing two ailerons that are the brake as well
"""

from __future__ import annotations

from typing import Final

from tgl_soar.link.autopilots.ardupilot import ATTITUDE, ArduPilot
from tgl_soar.link.autopilots.base import CommandRoute, Flavour, SurfaceChannels
from tgl_soar.link.autopilots.bridge import BridgeAutopilot
from tgl_soar.link.autopilots.paparazzi import Paparazzi

from .px4 import Px4

_FIRMWARES: Final[dict[str, type[ArduPilot | BridgeAutopilot | Paparazzi | Px4]]] = {
    kind.name: kind for kind in (ArduPilot, Px4, Paparazzi, BridgeAutopilot)
}
FIRMWARES: Final = tuple(_FIRMWARES)


def routes(firmware: str) -> tuple[CommandRoute, ...]:
    """The ways of commanding a firmware, the usual one first."""
    return tuple(_FIRMWARES[firmware].routes.values())


def flavour(firmware: str, route: str | None, channels: SurfaceChannels, system_id: int) -> Flavour:
    """A firmware by one of its routes; None: the usual one.  Errors: `ValueError`."""
    kind = _FIRMWARES[firmware]
    if channels.brake is not None and not issubclass(kind, ArduPilot):
        raise ValueError(
            f"{firmware} takes no fourth surface by any of its routes, and mixes its outputs"
            " itself: give one [surfaces.aileron] and neither flap nor spoiler"
        )
    if channels.throttle is not None and not issubclass(kind, ArduPilot):
        raise ValueError(f"{firmware} takes no throttle of ours: leave out [surfaces.throttle]")
    if channels.throttle is not None and route == ATTITUDE.name:
        raise ValueError(f"{route} takes no throttle of ours: leave out [surfaces.throttle]")
    if route is None:
        return kind(channels, system_id)
    if route not in kind.routes:
        raise ValueError(f"{firmware} has {', '.join(kind.routes)}")
    return kind(channels, system_id, kind.routes[route])
