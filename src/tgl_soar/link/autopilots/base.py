"""What every autopilot firmware has to answer: how are its surfaces moved, and when."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import NamedTuple, Protocol

from tgl_soar.link.messages import Heartbeat, Said
from tgl_soar.types import NAN, SurfaceCommand


class SurfaceChannel(NamedTuple):
    """Which channel moves a surface, and how far."""

    channel: int  # from 1
    pwm_min: int  # at deflection -1 (+1 where reversed)
    pwm_trim: int
    pwm_max: int
    reversed: bool = False


class SurfaceChannels(NamedTuple):
    """The channels of the three surfaces."""

    elevator: SurfaceChannel
    aileron: SurfaceChannel
    rudder: SurfaceChannel


class Wanted(NamedTuple):
    """A message to ask for."""

    message_id: int
    name: str
    rate_hz: float


class SensorMessages(NamedTuple):
    """Which messages carry what, beyond position and attitude."""

    imu: tuple[int, ...]  # accelerations: the best first, the next where that is refused
    airspeed: Wanted
    pitot_in_imu: bool  # HIGHRES_IMU.diff_pressure is that of a pitot tube


class Flavour(Protocol):
    """One firmware."""

    name: str
    sensors: SensorMessages
    sender_parameters: tuple[str, ...]  # of the firmware: they say whose overrides it obeys

    def refusal(self, parameters: Mapping[str, float], system: int) -> str:
        """Why overrides of this system will be ignored, and the way out; "" if they will not."""
        ...

    def surfaces(self, command: SurfaceCommand) -> tuple[Said, ...]:
        """What moves the surfaces; to be sent as the override identity."""
        ...

    def release(self) -> tuple[Said, ...]:
        """What gives the surfaces back; to be sent as the override identity."""
        ...

    def obeys(self, heartbeat: Heartbeat) -> bool:
        """Whether our surfaces move in the mode that this heartbeat tells."""
        ...

    def deflections(self, servos: Sequence[int]) -> SurfaceCommand:
        """Where the surfaces are put by these outputs [us], from channel 1; NaN: not driven."""
        ...

    def failsafe(self, heartbeat: Heartbeat) -> bool:
        """Whether it says of itself that it is in a failsafe."""
        ...

    def way_to_rate(self, rate_hz: float) -> str:
        """What to do when a stream of this rate is refused."""
        ...


def pulse_width(channel: SurfaceChannel, deflection: float) -> int:
    """Pulse width [us] of a deflection in -1 … 1: linear on either side of the trim.

    Beyond 1 it stays at the end; what is not a number is the trim.
    """
    if not isfinite(deflection):
        return channel.pwm_trim
    deflection = max(-1.0, min(1.0, -deflection if channel.reversed else deflection))
    span = channel.pwm_max - channel.pwm_trim
    if deflection < 0.0:
        span = channel.pwm_trim - channel.pwm_min
    return round(channel.pwm_trim + deflection * span)


def deflection(channel: SurfaceChannel, servos: Sequence[int]) -> float:
    """The inverse of `pulse_width`, limited to -1 … 1; NaN where the output is not driven."""
    pulse = servos[channel.channel - 1] if channel.channel <= len(servos) else 0
    if pulse == 0:
        return NAN
    span = channel.pwm_max - channel.pwm_trim
    if pulse < channel.pwm_trim:
        span = channel.pwm_trim - channel.pwm_min
    value = max(-1.0, min(1.0, (pulse - channel.pwm_trim) / span))
    return -value if channel.reversed else value
