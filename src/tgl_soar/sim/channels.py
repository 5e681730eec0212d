"""The autopilot's channels: the pilot's sticks, overrides of them, calibration, servos.

    pilot's receiver ──┐
                       ├─► channel PWM ──calibration──► stick -1…1 ──mode──► deflection ─► servo
    RC_CHANNELS_OVERRIDE┘

An override stands on its channel until it is released, replaced, or has not been repeated for
`RC_OVERRIDE_TIME`.  The rules for the values differ between channels 1–8 and 9–18, as in the
message's definition.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from tgl_soar.config.airframe import Surface, Surfaces, Throttle
from tgl_soar.link.autopilots.aileron_brake_mixing import mixed, unmixed
from tgl_soar.types import SurfaceCommand

CHANNELS: Final = 18
LEAVE: Final = 65535
_RELEASE_HIGH: Final = 65534  # on channels 9-18, where 0 leaves


def override_values(message: Any) -> list[int]:
    """What a RC_CHANNELS_OVERRIDE has for each of the 18 channels."""
    return [getattr(message, f"chan{i}_raw") for i in range(1, CHANNELS + 1)]


class Overrides:
    """The overrides of every channel, each with the step at which it was last given."""

    def __init__(self) -> None:
        self._pwm: list[int | None] = [None] * CHANNELS
        self._given_at: list[int] = [0] * CHANNELS

    def take(self, values: Sequence[int], step: int) -> None:
        """Take the 8 or 18 values of one message."""
        for i, value in enumerate(values):
            if value == LEAVE or (i >= 8 and value == 0):
                continue
            released = value == 0 if i < 8 else value == _RELEASE_HIGH
            self._pwm[i] = None if released else value
            self._given_at[i] = step

    def expire(self, step: int, steps_allowed: float) -> list[int]:
        """Release overrides not repeated for that many steps; the channels, from 1."""
        expired = []
        for i, pwm in enumerate(self._pwm):
            if pwm is not None and step - self._given_at[i] >= steps_allowed:
                self._pwm[i] = None
                expired.append(i + 1)
        return expired

    def clear(self) -> None:
        """Release all."""
        self._pwm = [None] * CHANNELS

    def on(self, channel: int) -> int | None:
        """The override of a channel, counted from 1."""
        return self._pwm[channel - 1]

    @property
    def any(self) -> bool:
        """Whether any channel is overridden."""
        return any(pwm is not None for pwm in self._pwm)


def stick_from_pwm(pwm: float, low: float, trim: float, high: float, reverse: bool) -> float:
    """Pulse width to -1 … 1 by a calibration of three points, limited to its ends."""
    pwm = min(max(pwm, low), high)
    stick = (pwm - trim) / (high - trim) if pwm > trim else (pwm - trim) / (trim - low)
    return -stick if reverse else stick


def pwm_from_stick(stick: float, low: float, trim: float, high: float, reverse: bool) -> int:
    """-1 … 1 to the nearest whole pulse width, limited to the calibration's ends."""
    stick = min(max(-stick if reverse else stick, -1.0), 1.0)
    return round(trim + stick * ((high - trim) if stick > 0.0 else (trim - low)))


def deflection_from_pwm(surface: Surface, pwm: float) -> float:
    """What the aircraft's surface does at a pulse width: the airframe file's table."""
    return stick_from_pwm(pwm, surface.pwm_min, surface.pwm_trim, surface.pwm_max, surface.reversed)


def pwm_from_deflection(surface: Surface, deflection: float) -> int:
    """The pulse width for a deflection by the airframe file's table."""
    return pwm_from_stick(
        deflection, surface.pwm_min, surface.pwm_trim, surface.pwm_max, surface.reversed
    )


def throttle_from_pwm(throttle: Throttle, pwm: float) -> float:
    """What the motor is commanded at a pulse width, 0 … 1; 0 where there is none."""
    fraction = (pwm - throttle.pwm_min) / (throttle.pwm_max - throttle.pwm_min)
    return min(1.0, max(0.0, fraction))


def deflections_of(surfaces: Surfaces, command: SurfaceCommand) -> tuple[float, ...]:
    """What each of the channels that `surfaces` drives is to do, -1 … 1: two ailerons mixed, a
    brake over all of its channel."""
    elevator, aileron, rudder, brake = command
    if surfaces.brake is None:
        return elevator, aileron, rudder
    if surfaces.brake_throw == 0.0:
        return elevator, aileron, rudder, 2.0 * brake - 1.0
    left, right = mixed(aileron, brake, surfaces.brake_throw)
    return elevator, left, rudder, right


def command_of(surfaces: Surfaces, deflections: Sequence[float]) -> SurfaceCommand:
    """The inverse of `deflections_of`: what the surfaces do together."""
    if surfaces.brake is None:
        elevator, aileron, rudder = deflections
        return SurfaceCommand(elevator, aileron, rudder, 0.0)
    elevator, aileron, rudder, brake = deflections
    if surfaces.brake_throw == 0.0:
        return SurfaceCommand(elevator, aileron, rudder, 0.5 * (1.0 + brake))
    aileron, brake = unmixed(aileron, brake, surfaces.brake_throw)
    return SurfaceCommand(elevator, aileron, rudder, max(0.0, min(1.0, brake)))


NEUTRAL: Final = SurfaceCommand(0.0, 0.0, 0.0, 0.0)
