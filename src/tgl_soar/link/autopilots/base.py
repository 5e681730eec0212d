"""What every autopilot firmware has to answer: how is it commanded, when, and what goes wrong.

A *route* is one way of commanding one firmware.  By a direct route elevator, aileron and rudder
are ours.  By an attitude route the firmware's own loops hold the pitch and the bank that we ask
for, and our laws end at these setpoints.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import ClassVar, Final, NamedTuple, Protocol

from tgl_soar.link.autopilots.aileron_brake_mixing import mixed, unmixed
from tgl_soar.link.autopilots.requirements import Answers, Needs, Requirement
from tgl_soar.link.messages import (
    COMMAND_DO_SET_MODE,
    COMPONENT_AUTOPILOT,
    MODE_FLAG_CUSTOM_MODE,
    PARAM_TYPE_INT32,
    PARAM_TYPE_UINT8,
    TYPE_FIXED_WING,
    CommandLong,
    Heartbeat,
    Outbound,
)
from tgl_soar.types import NAN, Setpoints, SurfaceCommand, isfinite

OVERRIDE_CHANNELS: Final = 18  # of RC_CHANNELS_OVERRIDE


class SurfaceChannel(NamedTuple):
    """Which channel moves a surface, and how far."""

    channel: int  # from 1
    pwm_min: int  # at deflection -1 (+1 where reversed)
    pwm_trim: int
    pwm_max: int
    reversed: bool = False


class BrakeChannel(NamedTuple):
    """What brakes: a surface of its own, or the right one of two ailerons."""

    surface: SurfaceChannel
    throw: float = 0.0  # `mixing`; 0: a surface of its own


class ThrottleChannel(NamedTuple):
    """Which channel a propeller's motor is on."""

    channel: int  # from 1
    pwm_min: int  # closed
    pwm_max: int  # all of it


class SurfaceChannels(NamedTuple):
    """The channels of the three surfaces, of what brakes, and of a propeller."""

    elevator: SurfaceChannel
    aileron: SurfaceChannel  # of two that brake too: the left one
    rudder: SurfaceChannel
    brake: BrakeChannel | None = None  # None: nothing brakes
    throttle: ThrottleChannel | None = None  # None: there is no propeller

    def driven(self) -> tuple[SurfaceChannel, ...]:
        """All surfaces."""
        three = self.elevator, self.aileron, self.rudder
        return three if self.brake is None else (*three, self.brake.surface)

    def numbers(self) -> tuple[int, ...]:
        """The channels of all that the module may move."""
        moved = tuple(surface.channel for surface in self.driven())
        return moved if self.throttle is None else (*moved, self.throttle.channel)


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
    # What its estimator says of its own position (`vehicle.estimator_status`); None: nothing.
    estimator: Wanted | None
    # The wind that its own modes reckon with (`vehicle.autopilot_wind`); None: nothing.
    wind: Wanted | None


class CommandRoute(NamedTuple):
    """One way of commanding a firmware, in words and numbers for module and people."""

    name: str  # in the airframe file
    message: str  # that carries the commands
    mode: str  # of the firmware, in which it obeys them
    loops: int  # whose loops move the surfaces: OURS, THEIRS or THEIRS_WITH_RUDDER
    as_operator: bool  # commands carry override_system_id, else the module's own identity
    mode_to_enter: int | None  # custom_mode that the module asks for; None: the pilot does
    mode_to_leave: int  # where the one before is not known
    silence_s: float  # after so long without a command the firmware acts alone
    after_silence: str  # what it does then
    takeover: str  # how the pilot takes over
    releases: bool  # there is a message that hands the surfaces over


class ParameterCodec(NamedTuple):
    """How a firmware has a number in PARAM_VALUE and PARAM_SET, by its MAV_PARAM_TYPE."""

    number: Callable[[float, int], float]  # of what is sent
    wire: Callable[[float, int], float]  # what is sent of a number; ValueError: it cannot be


def number_bytewise(sent: float, param_type: int) -> float:
    """The number whose four bytes stand in the place of a float, if the type is of whole ones."""
    kind = _whole(param_type)
    return float(struct.unpack(kind, struct.pack("<f", sent))[0]) if kind else sent


def wire_bytewise(value: float, param_type: int) -> float:
    """The inverse of `number_bytewise`.

    Errors: ValueError for what is no whole number where the type has no others, or too large.
    """
    kind = _whole(param_type)
    if not kind:
        return value
    if value % 1.0 != 0.0:  # or no number
        raise ValueError("it is a whole number")
    bits = 8 << (param_type - PARAM_TYPE_UINT8) // 2
    low, high = (-(1 << bits - 1), 1 << bits - 1) if kind == "<i" else (0, 1 << bits)
    if not low <= value < high:
        raise ValueError(f"no whole number from {low} to {high - 1}")
    return float(struct.unpack("<f", struct.pack(kind, int(value)))[0])


def number_cast(sent: float, _param_type: int) -> float:
    """Whole numbers as floats, either way."""
    return sent


def _whole(param_type: int) -> str:
    """How `struct` calls the whole numbers of a MAV_PARAM_TYPE; "": it has others, too."""
    if not PARAM_TYPE_UINT8 <= param_type <= PARAM_TYPE_INT32:
        return ""
    return "<i" if param_type % 2 == 0 else "<I"  # signed ones have even numbers


BYTEWISE: Final = ParameterCodec(number_bytewise, wire_bytewise)
CAST: Final = ParameterCodec(number_cast, number_cast)


class Flavour(Protocol):
    """One firmware, commanded by one route."""

    name: ClassVar[str]
    route: CommandRoute
    sensors: ClassVar[SensorMessages]
    asked: ClassVar[tuple[str, ...]]  # parameters that `refusal` looks at
    codec: ClassVar[ParameterCodec]

    def refusal(self, parameters: Answers, system: int) -> str:
        """Why commands of this system will be ignored, and the way out; "" if they will not."""
        ...

    def mismatch(self, heartbeat: Heartbeat) -> str:
        """Why this is not the firmware or the kind of vehicle of the airframe file; or ""."""
        ...

    def commands(
        self, surfaces: SurfaceCommand, setpoints: Setpoints, throttle: float = 0.0
    ) -> tuple[Outbound, ...]:
        """What a tick asks for.  Of a direct route only surfaces and throttle count, of the others
        pitch and roll of the setpoints, and the rudder where the route has it."""
        ...

    def release(self) -> tuple[Outbound, ...]:
        """What hands the surfaces over; nothing where going silent or changing the mode does."""
        ...

    def ask_for_mode(self, custom_mode: int) -> CommandLong:
        """A request for a mode, as its heartbeat gives it."""
        ...

    def obeys(self, heartbeat: Heartbeat) -> bool:
        """Whether our commands act in the mode of this heartbeat."""
        ...

    def deflections(self, servos: Sequence[int]) -> SurfaceCommand:
        """Where the surfaces are put by these outputs [us], from channel 1; NaN: not driven."""
        ...

    def failsafe(self, heartbeat: Heartbeat) -> bool:
        """Whether it reports a failsafe."""
        ...

    def way_to_rate(self, rate_hz: float) -> str:
        """What to do when a stream of this rate is refused."""
        ...

    def requirements(self, needs: Needs) -> tuple[Requirement, ...]:
        """What its parameters must be for this route."""
        ...


def firmware_mismatch(
    heartbeat: Heartbeat, autopilot: int, name: str, types: Sequence[int] = (TYPE_FIXED_WING,)
) -> str:
    """Why a heartbeat is not that of a firmware on a fixed wing; "" if it is."""
    if heartbeat.autopilot != autopilot:
        return (
            f"the autopilot is not {name} (MAV_AUTOPILOT {heartbeat.autopilot}, not {autopilot}):"
            " set firmware in [autopilot] of the airframe file"
        )
    if heartbeat.type not in types:
        return f"the vehicle is no fixed wing (MAV_TYPE {heartbeat.type})"
    return ""


def set_mode(system: int, mode: float, sub_mode: float = 0.0) -> CommandLong:
    """MAV_CMD_DO_SET_MODE; what the numbers mean is the firmware's."""
    params = (float(MODE_FLAG_CUSTOM_MODE), mode, sub_mode, 0.0, 0.0, 0.0, 0.0)
    return CommandLong(
        target_system=system,
        target_component=COMPONENT_AUTOPILOT,
        command=COMMAND_DO_SET_MODE,
        confirmation=0,
        params=params,
    )


def is_finite(surfaces: SurfaceCommand) -> bool:
    """Whether all three deflections are numbers."""
    return isfinite(surfaces.elevator) and isfinite(surfaces.aileron) and isfinite(surfaces.rudder)


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


def deflections(channels: SurfaceChannels, servos: Sequence[int]) -> SurfaceCommand:
    """All of them; NaN of the brake where there is none."""
    elevator, aileron = deflection(channels.elevator, servos), deflection(channels.aileron, servos)
    rudder, brake = deflection(channels.rudder, servos), NAN
    if channels.brake is not None:
        brake = deflection(channels.brake.surface, servos)
        if channels.brake.throw != 0.0:
            aileron, brake = unmixed(aileron, brake, channels.brake.throw)
        else:
            brake = 0.5 * (1.0 + brake)
    return SurfaceCommand(elevator, aileron, rudder, brake)


def throttle_pulse(throttle: ThrottleChannel, fraction: float) -> int:
    """Pulse width [us] of a throttle, 0 … 1; what is not a number is closed."""
    fraction = min(1.0, fraction) if fraction > 0.0 else 0.0  # false for NaN
    return round(throttle.pwm_min + fraction * (throttle.pwm_max - throttle.pwm_min))


def brake_pulses(
    channels: SurfaceChannels, surfaces: SurfaceCommand
) -> tuple[tuple[int, int], ...]:
    """(channel, pulse width [us]) of the brake and of what is mixed with it; nothing without one.

    A brake of its own goes over the whole of its channel: 0 is the one end of its travel.
    """
    if channels.brake is None:
        return ()
    brake, throw = channels.brake
    if throw == 0.0:
        return ((brake.channel, pulse_width(brake, 2.0 * surfaces.brake - 1.0)),)
    left, right = mixed(surfaces.aileron, surfaces.brake, throw)
    aileron = channels.aileron
    return (aileron.channel, pulse_width(aileron, left)), (brake.channel, pulse_width(brake, right))
