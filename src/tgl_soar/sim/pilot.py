"""The safety pilot: a simulated person with a transmitter, who flies when nobody else does.

An aircraft without a propeller needs someone in the loop at every moment: no mode of a
firmware holds its place.  Whenever no override stands on a surface, this pilot keeps the
aircraft where it was when they took over, by the look of it: the nose up when it is upwind of a
line through that place that leans 15° upwind, down when downwind of it, wings level, heading
upwind.  They are good enough for calm air, not for a score.

    e     = n · (p − p₀)            n upstream normal of the line, m
    θ − θ₀ = 0.5 e + 0.1 ∫e dt + 0.25 de/dt                          rad
    ψ_sp  = −atan(y / 8 m)
    rudder = 1.2 (ψ_sp − ψ)

In FBWA their pitch stick asks for θ; in MANUAL they move the elevator themselves.
"""

from __future__ import annotations

from math import atan, cos, radians, sin
from typing import Final

from tgl_soar.sim.vehicle.level_flight import PITCH_STICK_RAD, LevelFlight
from tgl_soar.types import AttitudeSample, SurfaceCommand

_ETA_RAD: Final = radians(90.0 + 15.0)
_NORMAL: Final = (-sin(_ETA_RAD), cos(_ETA_RAD))  # upstream
_PITCH_MOST_RAD: Final = 0.15


class SafetyPilot:
    """Holds the aircraft where they took over."""

    def __init__(self, trim_pitch_rad: float, dt_s: float) -> None:
        self._law = LevelFlight(trim_pitch_rad)
        self._dt_s = dt_s
        self._place: tuple[float, float] | None = None
        self._sum = 0.0

    def hand_over(self) -> None:
        """Somebody else flies."""
        self._place = None

    def sticks(
        self,
        place: tuple[float, float, float],
        velocity: tuple[float, float, float],
        heading_rad: float,
        attitude: AttitudeSample,
        manual: bool,
        elevator: float,
    ) -> SurfaceCommand:
        """The sticks for what they see: place [m] and velocity [m/s] in the soaring frame,
        attitude in upwind NED, and where the elevator stands now."""
        x, y, z = place
        if self._place is None:
            self._place = (x, z)
            self._sum = 0.0
            self._law.enter(elevator)
        e = _NORMAL[0] * (x - self._place[0]) + _NORMAL[1] * (z - self._place[1])
        e_rate = _NORMAL[0] * velocity[0] + _NORMAL[1] * velocity[2]
        self._sum = min(max(self._sum + 0.1 * e * self._dt_s, -0.1), 0.1)
        pitch = min(max(0.5 * e + self._sum + 0.25 * e_rate, -_PITCH_MOST_RAD), _PITCH_MOST_RAD)
        rudder = min(max(1.2 * (-atan(y / 8.0) - heading_rad), -1.0), 1.0)
        asked = SurfaceCommand(pitch / PITCH_STICK_RAD, 0.0, rudder)
        return self._law.step(asked, attitude, self._dt_s) if manual else asked
