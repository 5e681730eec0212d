"""The simulated Pixhawk: it behaves as an ArduPlane, and this module talks to it as to one."""

from __future__ import annotations

from .ardupilot import ArduPilot


class Bridge(ArduPilot):
    """`tools/sitl_bridge.py`."""

    name = "bridge"

    def way_to_rate(self, rate_hz: float) -> str:
        """It has no main loop of a lower rate."""
        return f"start the bridge with an attitude rate of {rate_hz:.0f} or more"
