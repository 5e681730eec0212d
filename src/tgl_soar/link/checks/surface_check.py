"""Moves each surface in turn on the ground, and compares what the autopilot does with the file.

    neutral, one way, the other way, neutral        for elevator, aileron and rudder

At each stop the autopilot's outputs (SERVO_OUTPUT_RAW) are read back: does the servo of this
channel move at all, to the pulse widths of the airframe file, about the file's trim, and do no
others move with it, and how late?  Whether the surface itself goes the right way only a person can
see.

No socket and no clock here: messages and time are arguments.  Nothing is moved on an aircraft that
is armed, unless that was asked for (PX4 drives no surface otherwise) and it stands still; and a
propeller-less aircraft that stands still may be soaring, so a person must confirm that it is on
the ground.
"""

from __future__ import annotations

from collections.abc import Set
from math import hypot
from typing import Final, NamedTuple

from tgl_soar.link.autopilots.base import Flavour, SurfaceChannel, SurfaceChannels, pulse_width
from tgl_soar.link.messages import (
    MODE_FLAG_ARMED,
    Heartbeat,
    LocalPositionNed,
    Outbound,
    ServoOutputRaw,
)
from tgl_soar.types import NO_SETPOINTS, SurfaceCommand

STOPS: Final = (0.0, 1.0, -1.0, 0.0)  # of the deflection that is tried
TOLERANCE_US: Final = 60.0  # an autopilot's own calibration bends a little
TRIM_TOLERANCE_US: Final = 25.0
MOVES_US: Final = 20.0  # less is no movement
SPEED_MAX_MPS: Final = 1.0  # of an aircraft that stands on the ground
HEARTBEAT_MAX_S: Final = 3.0  # so old is believed, and so old a speed
NO_SPEED: Final = "the aircraft is armed, and no speed of it was received"
SETTLE_S: Final = 0.2  # from a command to outputs that show it
READ_BACK_S: Final = 2.0  # so long is waited for them
FRAME_S: Final = 0.05  # between two commands
MOVED: Final = 0.5  # of a step: then the output shows it

NAMES: Final = ("elevator", "aileron", "rudder")
# What a person must see: trailing edges, as seen from behind the aircraft.
SIGHTS: Final = {
    ("elevator", 1): "elevator UP: the nose would rise",
    ("elevator", -1): "elevator DOWN: the nose would drop",
    ("aileron", 1): "right aileron UP, left one DOWN: it would roll right",
    ("aileron", -1): "right aileron DOWN, left one UP: it would roll left",
    ("rudder", 1): "rudder to the RIGHT: the nose would go right",
    ("rudder", -1): "rudder to the LEFT: the nose would go left",
}


class Stop(NamedTuple):
    """One surface at one deflection, and what came back."""

    surface: str
    deflection: float
    expected_us: int
    servos_us: tuple[int, ...]  # all outputs; (): nothing came back


class SurfaceFinding(NamedTuple):
    """What the outputs show of one surface."""

    surface: str
    faults: tuple[str, ...]  # none: as in the airframe file
    trim_us: float  # NaN: not read back
    low_us: float  # at the negative deflection
    high_us: float


class SurfaceCheck:
    """Where the check stands; `step` returns what to send."""

    def __init__(
        self,
        channels: SurfaceChannels,
        flavour: Flavour,
        deflection: float,
        hold_s: float,
        *,
        armed_on_ground: bool = False,
    ) -> None:
        """`deflection`: of full travel, 0 … 1.  `armed_on_ground`: a person confirms it."""
        self.stops: list[Stop] = []
        self._channels = channels
        self._flavour = flavour
        self._hold_s = hold_s
        self._armed_on_ground = armed_on_ground
        self._heartbeat: Heartbeat | None = None
        self._heartbeat_s = float("-inf")
        self._servos: tuple[int, ...] = ()
        self._servos_s = float("-inf")
        self._speed_mps = float("nan")
        self._speed_s = float("-inf")
        self._plan = [(name, fraction * deflection) for name in NAMES for fraction in STOPS]
        self._at = 0
        self._since_s = float("nan")  # when this stop began
        self._latencies_s: list[float] = []  # from a stop's first command to outputs that show it
        self._unseen = False  # the outputs do not show this stop's step yet
        self._sent_s = float("-inf")

    def take(self, message: object, now_s: float) -> None:
        """Take in one message of the autopilot."""
        if isinstance(message, Heartbeat):
            self._heartbeat, self._heartbeat_s = message, now_s
        elif isinstance(message, ServoOutputRaw) and message.port == 0:
            self._servos, self._servos_s = message.servos, now_s
            self._time_step(now_s)
        elif isinstance(message, LocalPositionNed):
            self._speed_mps, self._speed_s = hypot(message.vx, message.vy, message.vz), now_s

    def refusal(self, now_s: float) -> str:
        """Why nothing may be moved now; "" if it may."""
        heartbeat = self._heartbeat
        if heartbeat is None or now_s - self._heartbeat_s > HEARTBEAT_MAX_S:
            return "no heartbeat of the autopilot"
        if heartbeat.base_mode & MODE_FLAG_ARMED:
            if not self._armed_on_ground:
                return (
                    "the aircraft is armed and may be flying: disarm it; if it must be armed to"
                    " move a surface, hold it on the ground and give --armed-on-ground"
                )
            if not now_s - self._speed_s <= HEARTBEAT_MAX_S:
                return NO_SPEED
            if not self._speed_mps <= SPEED_MAX_MPS:
                return f"the aircraft is armed and moves at {self._speed_mps:.1f} m/s"
        if not self._flavour.obeys(heartbeat):
            mode = self._flavour.route.mode
            return f"the autopilot is not in the mode in which it obeys: put it into {mode}"
        return ""

    @property
    def done(self) -> bool:
        """Whether every surface has been at every stop."""
        return self._at >= len(self._plan)

    @property
    def sight(self) -> str:
        """What a person must see now; "" at neutral."""
        if self.done:
            return ""
        surface, deflection = self._plan[self._at]
        side = (deflection > 0.0) - (deflection < 0.0)
        return SIGHTS.get((surface, side), "")

    def held(self, now_s: float) -> bool:
        """Whether the servo has had its time at this stop, and was read back if it can be."""
        stayed_s = now_s - self._since_s
        patient = stayed_s < self._hold_s + READ_BACK_S
        return stayed_s >= self._hold_s and (self._is_read_back or not patient)

    @property
    def _is_read_back(self) -> bool:
        """Whether the outputs were received since the servo has had time to go there."""
        return self._servos_s - self._since_s >= SETTLE_S

    def step(self, now_s: float) -> tuple[Outbound, ...]:
        """What is to be sent now, as the override identity."""
        if self.done:
            return ()
        if self._since_s != self._since_s:
            self._since_s = now_s
            self._unseen = self._step_us() != (0, 0)
        if now_s - self._sent_s < FRAME_S:
            return ()
        self._sent_s = now_s
        return self._flavour.commands(self._command(), NO_SETPOINTS)

    @property
    def _channel(self) -> SurfaceChannel:
        """The channel of the surface that moves at this stop."""
        return self._channels.driven()[NAMES.index(self._plan[self._at][0])]

    def move_on(self) -> None:
        """This stop has been looked at: note what came back, and go to the next."""
        surface, deflection = self._plan[self._at]
        self.stops.append(
            Stop(
                surface,
                deflection,
                pulse_width(self._channel, deflection),
                self._servos if self._is_read_back else (),
            )
        )
        self._at += 1
        self._unseen = False
        self._since_s = float("nan")
        self._sent_s = float("-inf")

    @property
    def latencies_s(self) -> tuple[float, float]:
        """The least and the greatest time from a command to an output received that shows it; NaN:
        none did.

        The way back and the wait for an output are in both; the least has little of that wait.  On
        a link that is always as late, the servo's input has the command no later than the least;
        on one that is not, between the two.
        """
        found = self._latencies_s or [float("nan")]
        return min(found), max(found)

    def _step_us(self) -> tuple[int, int]:
        """The pulse widths of this surface before and at this stop; (0, 0): nothing moves."""
        surface, deflection = self._plan[self._at]
        before = self._plan[self._at - 1] if self._at else (surface, 0.0)
        if before[0] != surface or before[1] == deflection:
            return 0, 0
        return pulse_width(self._channel, before[1]), pulse_width(self._channel, deflection)

    def _time_step(self, now_s: float) -> None:
        """Whether the outputs show the step of this stop for the first time."""
        if not self._unseen or self.done:
            return
        before, after = self._step_us()
        output = self._channel.channel - 1
        if output < len(self._servos) and self._servos[output] != 0:
            moved = (self._servos[output] - before) / (after - before)
            if moved >= MOVED:
                self._unseen = False
                self._latencies_s.append(now_s - self._since_s)

    def findings(self) -> list[SurfaceFinding]:
        """What the outputs show of each surface that has been at all stops."""
        found = []
        for name, channel in zip(NAMES, self._channels.driven()[:3], strict=True):
            stops = [stop for stop in self.stops if stop.surface == name]
            if len(stops) != len(STOPS):
                continue
            brake = self._channels.brake
            if name != "aileron" or brake is None or brake.throw == 0.0:
                found.append(finding(name, channel, stops))
                continue
            # Two ailerons, each on a channel of its own: the right one belongs to this stop, too.
            right = brake.surface
            left_found = finding(name, channel, stops, {right.channel})
            theirs = [
                stop._replace(expected_us=pulse_width(right, stop.deflection)) for stop in stops
            ]
            right_found = finding("brake", right, theirs, {channel.channel})
            faults = tuple(f"the right one: {fault}" for fault in right_found.faults)
            found.append(left_found._replace(faults=left_found.faults + faults))
        return found

    def _command(self) -> SurfaceCommand:
        surface, deflection = self._plan[self._at]
        return SurfaceCommand(*(deflection if name == surface else 0.0 for name in NAMES))


def finding(
    surface: str,
    channel: SurfaceChannel,
    stops: list[Stop],
    along: Set[int] = frozenset(),
) -> SurfaceFinding:
    """Compare the outputs at neutral, one way, the other way and neutral with the file.

    `along`: channels that are to move with it.
    """
    output = channel.channel - 1
    if any(len(stop.servos_us) <= output or stop.servos_us[output] == 0 for stop in stops):
        words = f"output {channel.channel} cannot be read back: no SERVO_OUTPUT_RAW, or not driven"
        nan = float("nan")
        return SurfaceFinding(
            surface=surface, faults=(words,), trim_us=nan, low_us=nan, high_us=nan
        )
    neutral, positive, negative, again = (stop.servos_us[output] for stop in stops)
    expected = [stop.expected_us for stop in stops]
    faults: list[str] = []
    moved, should = positive - negative, expected[1] - expected[2]
    if abs(moved) < MOVES_US:
        faults.append(
            f"output {channel.channel} does not move: is it this surface's channel, does the"
            " autopilot obey our system id, is the safety switch pressed?"
        )
    elif (moved > 0) != (should > 0):
        faults.append(
            f"output {channel.channel} moves the other way than the file says: if the surface"
            f" itself goes wrong, change surfaces.{surface}.reversed of the airframe file"
        )
    else:
        for side, measured_us, wanted in (
            ("+", positive, expected[1]),
            ("-", negative, expected[2]),
        ):
            if abs(measured_us - wanted) > TOLERANCE_US:
                faults.append(f"travel to {side}: {measured_us} us, the file says {wanted} us")
    if abs(neutral - expected[0]) > TRIM_TOLERANCE_US:
        faults.append(f"trim: {neutral} us, the file says {expected[0]} us")
    if abs(again - neutral) > MOVES_US:
        faults.append(f"does not come back: {again} us, was {neutral} us")
    others = [
        str(i + 1)
        for i, low in enumerate(stops[2].servos_us)
        if i != output
        and i + 1 not in along
        and i < len(stops[1].servos_us)
        and abs(stops[1].servos_us[i] - low) >= MOVES_US
    ]
    if others:
        faults.append(f"moves output {', '.join(others)} too: a mixer, or a channel used twice")
    return SurfaceFinding(
        surface=surface, faults=tuple(faults), trim_us=neutral, low_us=negative, high_us=positive
    )
