"""Whether the nose points where the aircraft goes through the air.

A compass that is off turns an estimator's heading without a word: PX4's by 15 to 50 degrees within
a minute (docs/autopilots.md).  So does a wind that blows from elsewhere than the site says.  Which
of both it is nobody can tell on board, and neither ends a flight: the line is held as before.  But
what the heading is used for is worth less then, and the autopilot's own modes fly by it.

The angle is that of `estimation.cross_wind`, on a line alone: there the nose is near the wind, and
an airspeed that is wrong turns nothing.  Beyond what VEER_MAX lets the nose follow,

    ANGLE_RAD   counts     a gust's slip is 3 degrees (5 % across), 1 over TIME_S; a trim's 1 to 3
    STANDS_S    of it      so long, since a wind that swings is back before

Both were argued before a flight was looked at.
"""

from __future__ import annotations

from math import atan2, degrees, isfinite, nan, radians
from typing import Final

from tgl_soar import autopilot
from tgl_soar.control.supervisor import CAPTURING, SOARING
from tgl_soar.estimation.cross_wind import CrossWindParams, cross_wind_step
from tgl_soar.link.messages import SEVERITY_INFO, SEVERITY_WARNING

TIME_S: Final = 6.0  # as VEER_T comes
ANGLE_RAD: Final = radians(10.0)
OVER_RAD: Final = radians(5.0)  # less, for as long, is over
STANDS_S: Final = 5.0
AVERAGED_S: Final = 2.0 * TIME_S  # so long on a line until an average shows an agreement
WINDY_MPS: Final = 4.0  # below it a wind has no side
TICK_MAX_S: Final = 0.5  # after a gap it goes on, and does not leap


class HeadingWords:
    """Reports once that they disagree, and that they agree again."""

    def __init__(self) -> None:
        self._params = CrossWindParams(veer_max_rad=radians(90.0), time_s=TIME_S)
        self._cross_wind_mps = self._on_line_s = self._stands_s = self._agrees_s = 0.0
        self._time_s = nan
        self._is_reported = False

    def look(self, output: autopilot.Output, veer_max_rad: float) -> list[tuple[int, str]]:
        """What is to be said after a tick: severities and texts."""
        on_line = output.active and output.mode in (SOARING, CAPTURING)
        dt_s, self._time_s = output.time_s - self._time_s, output.time_s
        if not on_line:
            self._cross_wind_mps = self._on_line_s = self._stands_s = self._agrees_s = 0.0
            self._is_reported = self._is_reported and output.active
            return []
        if not 0.0 < dt_s <= TICK_MAX_S or not isfinite(output.vehicle.heading_rad):
            return []  # the first is true for NaN
        self._on_line_s += dt_s
        self._cross_wind_mps = cross_wind_step(
            self._params, self._cross_wind_mps, output.vehicle, output.air, dt_s
        )
        return self._compared(output.air.wind_mps, veer_max_rad, dt_s)

    def _compared(self, wind_mps: float, veer_max_rad: float, dt_s: float) -> list[tuple[int, str]]:
        if not wind_mps >= WINDY_MPS:  # true for NaN
            self._stands_s = self._agrees_s = 0.0
            return []
        angle_rad = atan2(-self._cross_wind_mps, wind_mps)
        over_rad = abs(angle_rad) - veer_max_rad
        self._stands_s = self._stands_s + dt_s if over_rad >= ANGLE_RAD else 0.0
        agrees = over_rad < OVER_RAD and self._on_line_s >= AVERAGED_S
        self._agrees_s = self._agrees_s + dt_s if agrees else 0.0
        if not self._is_reported and self._stands_s >= STANDS_S:
            self._is_reported = True
            side = "right" if angle_rad > 0.0 else "left"
            text = f"heading {degrees(abs(angle_rad)):.0f} deg {side} of the way through the air"
            return [(SEVERITY_WARNING, f"{text}: compass off, or wind turned")]
        if self._is_reported and self._agrees_s >= STANDS_S:
            self._is_reported = False
            return [(SEVERITY_INFO, "heading and drift agree again")]
        return []
