"""The simulated Pixhawk: it behaves as an ArduPlane, and this module talks to it as to one."""

from __future__ import annotations

from typing import ClassVar

from tgl_soar.link.autopilots.ardupilot import BY_OVERRIDE, OVERRIDE, POSES, ArduPilot
from tgl_soar.link.autopilots.requirements import Needs, Requirement


class BridgeAutopilot(ArduPilot):
    """`tools/sitl_bridge.py`."""

    name: ClassVar[str] = "bridge"

    def way_to_rate(self, rate_hz: float) -> str:
        """It has no main loop of a lower rate."""
        return f"start the bridge with an attitude rate of {rate_hz:.0f} or more"

    def requirements(self, needs: Needs) -> tuple[Requirement, ...]:
        """Of an ArduPlane's those that it has: neither functions of outputs nor an estimator."""
        rows = (self._loop(needs), *map(_passing, self._calibration()))
        if self.route is OVERRIDE:
            rows += BY_OVERRIDE
        return rows + (POSES if needs.external_pose else ())


def _passing(row: Requirement) -> Requirement:
    """Which way a surface goes its own modes know from the airframe file."""
    return row._replace(wanted=0.0) if row.names[0].endswith("_REVERSED") else row
