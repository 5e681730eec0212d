"""The way from receiver and overrides to the servos.

receiver ──────────────┐
RC_CHANNELS_OVERRIDE ──┴► channel ─► stick ─► mode's law ─► servo pulse ─► deflection
"""

from __future__ import annotations

from typing import Final

from tgl_soar.config.airframe import Surfaces
from tgl_soar.sim.channels import (
    CHANNELS,
    NEUTRAL,
    Overrides,
    command_of,
    deflection_from_pwm,
    deflections_of,
    pwm_from_deflection,
    pwm_from_stick,
    stick_from_pwm,
    throttle_from_pwm,
)
from tgl_soar.sim.vehicle.firmware_parameters import OVERRIDES_NEVER_EXPIRE, FirmwareParameters
from tgl_soar.sim.vehicle.level_flight import LevelFlight
from tgl_soar.types import AttitudeSample, SurfaceCommand

_CHANNEL_UNUSED: Final = 65535


class SurfaceOutputs:
    """Overrides, channels, servos, and the law between them."""

    def __init__(
        self, surfaces: Surfaces, parameters: FirmwareParameters, level: LevelFlight, step_hz: int
    ) -> None:
        self.overrides = Overrides()
        self.deflections = NEUTRAL  # what the servos are commanded
        self.throttle = 0.0  # what a propeller's motor is commanded, 0 … 1; the pilot's is closed
        self._file = surfaces
        self._surfaces = surfaces.driven()
        self._parameters = parameters
        self._level = level
        self._step_hz = step_hz
        self._channel_pwm = [0] * CHANNELS
        self._servo_pwm = [0] * CHANNELS

    @property
    def servo_pwm(self) -> tuple[int, ...]:
        """The pulse width of every servo output; 0: none."""
        return tuple(self._servo_pwm)

    @property
    def channel_pwm(self) -> tuple[int, ...]:
        """The pulse width of every channel, with its override."""
        return tuple(
            self.overrides.on(i) or self._channel_pwm[i - 1] or _CHANNEL_UNUSED
            for i in range(1, CHANNELS + 1)
        )

    def is_overridden(self) -> bool:
        """Whether a surface's channel is overridden now."""
        return any(self.overrides.on(s.channel) is not None for s in self._surfaces)

    def expire_overrides(self, step: int) -> list[int]:
        """Release overrides that have timed out at a step; their channels, from 1."""
        allowed_s = self._parameters["RC_OVERRIDE_TIME"]
        if allowed_s == OVERRIDES_NEVER_EXPIRE:
            return []
        return self.overrides.expire(step, allowed_s * self._step_hz)

    def enter_level_flight(self) -> None:
        """The mode changes: FBWA begins without a jump of the elevator."""
        self._level.enter(self.deflections.elevator)

    def update(self, receiver: SurfaceCommand, attitude: AttitudeSample | None) -> None:
        """Channels, sticks, law, servos.

        receiver: the pilot's sticks.  attitude: that level flight flies by; None: sticks move
        the surfaces themselves.
        """
        sticks = []
        sticks_wanted = deflections_of(self._file, receiver)
        for surface, stick in zip(self._surfaces, sticks_wanted, strict=True):
            channel = surface.channel
            override = self.overrides.on(channel)
            pwm = pwm_from_deflection(surface, stick) if override is None else override
            self._channel_pwm[channel - 1] = pwm
            low, trim, high, reverse = self._parameters.calibration(f"RC{channel}")
            sticks.append(stick_from_pwm(pwm, low, trim, high, reverse))
        if attitude is not None:
            sticks = self._level_flight(sticks, attitude)
        deflections = []
        for surface, stick in zip(self._surfaces, sticks, strict=True):
            low, trim, high, reverse = self._parameters.calibration(f"SERVO{surface.channel}")
            pwm = pwm_from_stick(stick, low, trim, high, reverse)
            self._servo_pwm[surface.channel - 1] = pwm
            deflections.append(deflection_from_pwm(surface, pwm))
        self.deflections = command_of(self._file, deflections)
        if (motor := self._file.throttle) is not None:
            pwm = self.overrides.on(motor.channel) or motor.pwm_min
            self._channel_pwm[motor.channel - 1] = self._servo_pwm[motor.channel - 1] = pwm
            self.throttle = throttle_from_pwm(motor, pwm)

    def _level_flight(self, sticks: list[float], attitude: AttitudeSample) -> list[float]:
        # A stick's sign on the wire follows the airframe file; the law's is ours.
        signs = [-1.0 if s.reversed else 1.0 for s in self._surfaces]
        asked = command_of(self._file, [s * stick for s, stick in zip(signs, sticks, strict=True)])
        law = self._level.step(asked, attitude, 1.0 / self._step_hz)._replace(brake=asked.brake)
        wanted = deflections_of(self._file, law)
        return [sign * deflection for sign, deflection in zip(signs, wanted, strict=True)]
