"""The law of FBWA: pitch and bank held, turning damped.

    elevator = 2 (θ_sp − θ) + 2 ∫(θ_sp − θ) dt − 0.19 q       [rad, rad s, rad/s]
    aileron  = 1.2 (φ_sp − φ) − 0.06 p
    rudder   = rudder stick − 0.2 r

The sticks ask for pitch and bank; centred sticks mean trim pitch and wings level.
"""

from __future__ import annotations

from math import isfinite
from typing import Final

from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.types import AttitudeSample, SurfaceCommand

PITCH_STICK_RAD: Final = 0.26  # asked for by a full stick
BANK_STICK_RAD: Final = 0.52


class LevelFlight:
    """The law, with the integral of the pitch's error as its only memory."""

    def __init__(self, trim_pitch_rad: float) -> None:
        self.trim_pitch_rad = trim_pitch_rad
        self._integral = 0.0

    def enter(self, elevator: float) -> None:
        """Begin without a jump of the elevator."""
        self._integral = min(max(elevator, -0.8), 0.8)

    def step(self, sticks: SurfaceCommand, attitude: AttitudeSample, dt_s: float) -> SurfaceCommand:
        """Deflections for sticks (pitch, roll, yaw; -1 … 1) and an attitude."""
        roll, pitch, _ = euler_from_quaternion(*attitude.quaternion)
        p, q, r = attitude.rates_frd_radps
        pitch_error = self.trim_pitch_rad + PITCH_STICK_RAD * sticks.elevator - pitch
        self._integral = min(max(self._integral + 2.0 * pitch_error * dt_s, -0.8), 0.8)
        return SurfaceCommand(
            _limited(2.0 * pitch_error + self._integral - 0.19 * q),
            _limited(1.2 * (BANK_STICK_RAD * sticks.aileron - roll) - 0.06 * p),
            _limited(sticks.rudder - 0.2 * r),
        )


def _limited(value: float) -> float:
    return min(max(value, -1.0), 1.0) if isfinite(value) else 0.0
