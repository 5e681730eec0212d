"""What of a flight between real processes can be chosen, and how it fails."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


class SitlError(RuntimeError):
    """The flight could not be flown; the message says why and what to do."""


@dataclass(frozen=True)
class SitlOptions:
    """What to fly."""

    airframe: Path
    site: Path
    out: Path
    legs: tuple[str, ...] = ()  # names of the site's lines; none: all, in order
    stay_s: float = 16.0
    settings: tuple[tuple[str, float], ...] = ()  # of the module, set with each leg
    model: str | None = None  # as the bridge spells it; None: the airframe file's
    seed: int = 1
    turbulence: float | None = None  # fraction of the reference wind; None: the site's
    receiver: str = "local"  # as the bridge spells it
    pitot: bool = True  # the aircraft has a tube
    realtime: bool = False
    faults: tuple[str, ...] = ()  # as they are written (`sim.faults`)
    mocap: bool = False  # the position comes as NatNet, from a stand-in for Motive
    mocap_options: tuple[str, ...] = ()  # more of the bridge's, such as --mocap-version=4.2
    autopilot: str = "builtin"  # or a real firmware, by the bridge's name for it
    firmware: Path | None = None  # its program
    route: str | None = None  # by which the module commands it; None: the firmware's usual one
    autopilot_parameters: tuple[str, ...] = ()  # NAME=NUMBER, or NAME=NUMBER@SECONDS
    search: bool = False  # the first leg is a search for lift, and the only one if none is named
    survey: bool = False  # on the last line the contour is surveyed
    kill_s: float | None = None  # the module is killed so long after its line first stood
    mission: Path | None = None  # of the firmware, as ground stations write it
    by_hand: bool = False  # it is thrown from a hand before the crest
    goes_home: bool = False  # after the last leg it breaks off and lands
    watch_s: float | None = None  # where it disengages by itself, fly on so long and end well
    # Real time alone is open to others, on the ports that the firmwares' simulators have.
    gcs: str = "127.0.0.1:14550"
    gcs_local: str = "127.0.0.1:18570"  # the bridge's own port towards it
    companion: str = "127.0.0.1:14540"
