"""What wind the autopilot estimates: PX4's WIND_COV, or ArduPlane's WIND.

Asked for once somebody wants it, for only what flies by the autopilot's own modes depends on it.
ArduPlane's direction is that from which the wind blows, in degrees; PX4's components are those of
the moving air.
"""

from __future__ import annotations

from math import cos, isfinite, radians, sin
from typing import Final

from tgl_soar.link.autopilots.base import Wanted
from tgl_soar.link.messages import ID_WIND, ID_WIND_COV, Wind, WindCov
from tgl_soar.link.vehicle.diagnostics import Ledger
from tgl_soar.types import NAN

AGE_MAX_S: Final = 3.0  # it comes once a second: after that nothing is known
FASTEST_MPS: Final = 100.0  # a hurricane's


class AutopilotWind:
    """The newest, while it is of now."""

    def __init__(self, wanted: Wanted | None, ledger: Ledger) -> None:
        """`wanted`: the message of this firmware; None: it has none."""
        self._wanted = wanted
        self._streams = ledger.streams
        self.restarted()

    def restarted(self) -> None:
        """The autopilot, or the clock, is another one from here on."""
        self._received_s = NAN
        self._north_mps = self._east_mps = NAN

    def want(self) -> None:
        """Ask for it, from now on."""
        if self._wanted is not None:
            self._streams.want(*self._wanted)

    def take(self, message: Wind | WindCov, now_s: float) -> None:
        """A report has come.  One that no air can do says nothing, and leaves what was known."""
        if isinstance(message, WindCov):
            self._streams.received(ID_WIND_COV)
            north, east = message.wind_x, message.wind_y
        else:
            self._streams.received(ID_WIND)
            if not (isfinite(message.direction) and isfinite(message.speed)):
                return
            from_rad = radians(message.direction)
            north, east = -message.speed * cos(from_rad), -message.speed * sin(from_rad)
        if not abs(north) + abs(east) <= FASTEST_MPS:  # true for NaN
            return
        self._received_s = now_s
        self._north_mps, self._east_mps = north, east

    def known(self, now_s: float) -> tuple[float, float]:
        """Towards north and east, of the air [m/s]; NaN: not known."""
        if not 0.0 <= now_s - self._received_s <= AGE_MAX_S:  # false for NaN
            return NAN, NAN
        return self._north_mps, self._east_mps
