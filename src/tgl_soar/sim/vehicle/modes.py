"""The modes that the autopilot has, by ArduPlane's numbers, and what it is in.

MANUAL: sticks move surfaces.  FBWA: sticks ask for pitch and bank.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

MANUAL: Final = 0
FBWA: Final = 5
MODE_NAMES: Final = {MANUAL: "MANUAL", FBWA: "FBWA"}


@dataclass
class FlightStatus:
    """What a heartbeat reports."""

    mode: int = MANUAL
    armed: bool = True
