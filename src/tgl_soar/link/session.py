"""One conversation with one autopilot: who we are, who it is, and what it measures.

We are an onboard computer: a heartbeat a second as (vehicle's system, our component), and that
before anything else, because an autopilot that has not yet heard of this component takes a
parameter set addressed to it for its own.  Of the autopilot, (its system, component 1) alone is
believed; ground stations and other vehicles on the same link are not.

Stamps of the vehicle become times on the loop's clock here (`clock`).  In lockstep the loop's
clock *is* the vehicle's and nothing is mapped.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Final

from tgl_soar.types import (
    NAN,
    NO_ATTITUDE,
    AttitudeSample,
    AutopilotStatus,
    PositionFix,
)

from .autopilots.base import Flavour
from .clock import ClockMap, StampOrder
from .inquiry import SenderInquiry
from .messages import (
    AUTOPILOT_INVALID,
    COMMAND_SET_MESSAGE_INTERVAL,
    COMPONENT_AUTOPILOT,
    FRAME_BODY_FRD,
    FRAME_BODY_NED,
    FRAME_LOCAL_FRD,
    FRAME_LOCAL_NED,
    ID_ATTITUDE_QUATERNION,
    ID_LOCAL_POSITION_NED,
    ID_ODOMETRY,
    ID_SERVO_OUTPUT_RAW,
    MODE_FLAG_ARMED,
    SEVERITY_INFO,
    SEVERITY_WARNING,
    STATE_ACTIVE,
    TYPE_GCS,
    TYPE_ONBOARD_CONTROLLER,
    AttitudeQuaternion,
    CommandAck,
    Heartbeat,
    LocalPositionNed,
    Odometry,
    ParamValue,
    Received,
    Said,
    ServoOutputRaw,
    Source,
    Timesync,
)
from .sources import LOCAL_POSITION, ODOMETRY, PositionSources
from .streams import StreamRequests
from .timesync import RoundTrip

HEARTBEAT_S: Final = 1.0
POSITION_HZ: Final = 50.0
SERVO_HZ: Final = 5.0
SOURCE_SILENCE_S: Final = 0.5  # after this another message may give the attitude
FUTURE_S: Final = 0.02
MAX_HEARD: Final = 32  # senders remembered, for the message that nobody answers

_LOCAL_FRAMES: Final = (FRAME_LOCAL_NED, FRAME_LOCAL_FRD)
_BODY_FRAMES: Final = (FRAME_BODY_FRD, FRAME_BODY_NED)


@dataclass(slots=True)
class SessionCounters:
    """What was heard and refused."""

    heartbeats: int = 0
    attitudes: int = 0  # taken
    positions: int = 0  # taken
    stale: int = 0  # repeated or out of order
    not_finite: int = 0
    wrong_frame: int = 0  # ODOMETRY in a frame that is not understood
    foreign: int = 0  # measurements of another system or component
    reboots: int = 0


class Session:
    """Takes in messages, gives out what is due; time is an argument."""

    def __init__(
        self,
        own: Source,
        flavour: Flavour,
        loop_rate_hz: float,
        *,
        override_system: int = 255,
        lockstep: bool = False,
        sources: PositionSources | None = None,
    ) -> None:
        """`sources`: whose positions are taken; of the autopilot's alone if not given."""
        self.counters = SessionCounters()
        self.sources = sources or PositionSources()
        self.attitude = NO_ATTITUDE
        self.status = AutopilotStatus(NAN, False, False)
        self.vehicle_time_s = NAN  # newest stamp of the attitude, vehicle's clock
        self.servos_us: tuple[int, ...] = ()
        self.heard: dict[Source, int] = {}
        self.notices: list[tuple[int, str]] = []  # (severity, text), for whoever tells them
        self.streams = StreamRequests(own.system)
        self.round_trip = RoundTrip()
        self._inquiry = SenderInquiry(flavour, own.system, override_system)
        self._own = own
        self.autopilot = Source(own.system, COMPONENT_AUTOPILOT)
        self._flavour = flavour
        self._lockstep = lockstep
        self._heartbeat_due_s = float("-inf")
        self._orders: dict[int, StampOrder] = {}
        self._clocks: dict[int, ClockMap] = {}
        self._attitude_source = 0
        self._attitude_heard_s = NAN
        self.set_loop_rate(loop_rate_hz)
        self.streams.want(ID_LOCAL_POSITION_NED, "LOCAL_POSITION_NED", POSITION_HZ)
        self.streams.want(ID_SERVO_OUTPUT_RAW, "SERVO_OUTPUT_RAW", SERVO_HZ)

    def set_loop_rate(self, loop_rate_hz: float) -> None:
        """The attitude is wanted once a tick."""
        self.streams.want(ID_ATTITUDE_QUATERNION, "ATTITUDE_QUATERNION", loop_rate_hz)

    @property
    def position(self) -> PositionFix:
        """Of the source that is trusted most now."""
        return self.sources.position

    @property
    def is_heard(self) -> bool:
        """Whether the autopilot has ever sent a heartbeat."""
        return self.status.time_s == self.status.time_s

    @property
    def round_trip_s(self) -> float:
        """To the autopilot and back; NaN: not measured."""
        return self.round_trip.round_trip_s

    def heartbeat(self) -> Heartbeat:
        """Ours."""
        return Heartbeat(TYPE_ONBOARD_CONTROLLER, AUTOPILOT_INVALID, 0, 0, STATE_ACTIVE)

    def poll(self, now_s: float) -> list[Said]:
        """What is due: our heartbeat, and at most one request for a stream."""
        said: list[Said] = []
        if now_s >= self._heartbeat_due_s:
            late = now_s - self._heartbeat_due_s > HEARTBEAT_S
            self._heartbeat_due_s = (now_s if late else self._heartbeat_due_s) + HEARTBEAT_S
            said.append(self.heartbeat())
        if self.is_heard:
            said.extend(self.streams.poll(now_s))
            question = None if self._lockstep else self.round_trip.poll(now_s)
            if question is not None:
                said.append(question)
            asked, complaint = self._inquiry.poll(now_s)
            said.extend(asked)
            if complaint:
                self.notices.append((SEVERITY_WARNING, complaint))
        if self.streams.notices:
            self._tell_refusals()
        if self.sources.notices:
            self.notices.extend(self.sources.notices)
            self.sources.notices.clear()
        return said

    def rebase(self, now_s: float) -> None:
        """The loop's clock was changed to now_s: whatever was timed by the old one begins anew."""
        self._heartbeat_due_s = now_s
        self.sources.rebase()
        self._attitude_heard_s = NAN
        self.streams.restart()
        self.round_trip.restart()
        self._inquiry.restart()
        if self.is_heard:
            self.status = self.status._replace(time_s=now_s)

    def handle(self, received: Received, now_s: float) -> list[Said]:
        """Take in one message; what is to be said at once."""
        source, message = received
        if source not in self.heard and len(self.heard) < MAX_HEARD:
            self.heard[source] = 0
        if source in self.heard:
            self.heard[source] += 1
        if isinstance(message, Timesync):
            return self._timesync(source, message, now_s)
        if source != self.autopilot:
            if isinstance(message, AttitudeQuaternion | LocalPositionNed | Odometry):
                self.counters.foreign += 1
            return []
        if isinstance(message, AttitudeQuaternion):
            self._take_attitude_quaternion(message, now_s)
        elif isinstance(message, LocalPositionNed):
            self._take_local_position(message, now_s)
        elif isinstance(message, Odometry):
            self._take_odometry(message, now_s)
        elif isinstance(message, Heartbeat):
            self._take_heartbeat(message, now_s)
        elif isinstance(message, ServoOutputRaw):
            self.streams.heard(ID_SERVO_OUTPUT_RAW)
            self.servos_us = message.servos
        elif isinstance(message, ParamValue):
            self._inquiry.heard(message)
        elif isinstance(message, CommandAck):
            self._take_ack(message, now_s)
        return []

    # --- the conversation -------------------------------------------------------------------

    def _timesync(self, source: Source, message: Timesync, now_s: float) -> list[Said]:
        """A request is answered with our time; of answers only the autopilot's are looked at."""
        if message.tc1 != 0:
            if source == self.autopilot:
                self.round_trip.take(message, now_s)
            return []
        # In lockstep the answer says only that all before it was done; zero would be a request.
        ours_ns = (message.ts1 or 1) if self._lockstep else int(now_s * 1e9)
        return [Timesync(ours_ns, message.ts1)]

    def _take_heartbeat(self, message: Heartbeat, now_s: float) -> None:
        if message.autopilot == AUTOPILOT_INVALID or message.type == TYPE_GCS:
            return
        self.counters.heartbeats += 1
        self.status = AutopilotStatus(
            now_s, self._flavour.obeys(message), message.base_mode & MODE_FLAG_ARMED != 0
        )

    def _take_ack(self, message: CommandAck, now_s: float) -> None:
        for_us = message.target_system in (0, self._own.system) and message.target_component in (
            0,
            self._own.component,
        )
        if for_us and message.command == COMMAND_SET_MESSAGE_INTERVAL:
            self.streams.acknowledged(message.result, now_s)

    def _tell_refusals(self) -> None:
        for stream, word, rate_hz in self.streams.notices:
            text = f"{stream.name} at {rate_hz:g} Hz {word}"
            if word == "denied":
                text += f": {self._flavour.way_to_rate(rate_hz)}"
            if not stream.given_up:
                text += f"; asking for {stream.rate_hz:g} Hz"
            self.notices.append((SEVERITY_WARNING, text))
            if stream.given_up and stream.message_id == ID_LOCAL_POSITION_NED:
                self.streams.want(ID_ODOMETRY, "ODOMETRY", POSITION_HZ)
        self.streams.notices.clear()

    # --- measurements -----------------------------------------------------------------------

    def _take_attitude_quaternion(self, m: AttitudeQuaternion, now_s: float) -> None:
        self.streams.heard(ID_ATTITUDE_QUATERNION)
        if not (isfinite(m.q1) and isfinite(m.q2) and isfinite(m.q3) and isfinite(m.q4)):
            self.counters.not_finite += 1
            return
        stamp_s = m.time_boot_ms * 1e-3
        time_s = self._time_of(ID_ATTITUDE_QUATERNION, stamp_s, now_s)
        if time_s is None or not self._is_attitude_source(ID_ATTITUDE_QUATERNION, now_s):
            return
        self.vehicle_time_s = stamp_s
        self._set_attitude(
            time_s, (m.q1, m.q2, m.q3, m.q4), (m.rollspeed, m.pitchspeed, m.yawspeed)
        )

    def _take_local_position(self, m: LocalPositionNed, now_s: float) -> None:
        self.streams.heard(ID_LOCAL_POSITION_NED)
        if not (isfinite(m.x) and isfinite(m.y) and isfinite(m.z)):
            self.counters.not_finite += 1
            return
        time_s = self._time_of(ID_LOCAL_POSITION_NED, m.time_boot_ms * 1e-3, now_s)
        if time_s is not None:
            self._offer(LOCAL_POSITION, time_s, (m.x, m.y, m.z), (m.vx, m.vy, m.vz), now_s)

    def _take_odometry(self, m: Odometry, now_s: float) -> None:
        """Position and attitude in one.  LOCAL_FRD is the hall's frame: NED by agreement."""
        self.streams.heard(ID_ODOMETRY)
        in_body = m.child_frame_id in _BODY_FRAMES
        if m.frame_id not in _LOCAL_FRAMES or not (in_body or m.child_frame_id in _LOCAL_FRAMES):
            if self.counters.wrong_frame == 0:
                text = f"ODOMETRY in frames {m.frame_id}, {m.child_frame_id}: send LOCAL_NED or"
                self.notices.append((SEVERITY_WARNING, f"{text} LOCAL_FRD with BODY_FRD"))
            self.counters.wrong_frame += 1
            return
        if not (isfinite(m.x) and isfinite(m.y) and isfinite(m.z)):
            self.counters.not_finite += 1
            return
        time_s = self._time_of(ID_ODOMETRY, m.time_usec * 1e-6, now_s)
        if time_s is None:
            return
        turned = all(isfinite(q) for q in m.q)
        velocity = (m.vx, m.vy, m.vz)
        if in_body:
            velocity = _rotated(m.q, velocity) if turned else (NAN, NAN, NAN)
        self._offer(ODOMETRY, time_s, (m.x, m.y, m.z), velocity, now_s)
        if turned and self._is_attitude_source(ID_ODOMETRY, now_s) and not self._lockstep:
            self.vehicle_time_s = m.time_usec * 1e-6
            self._set_attitude(time_s, m.q, (m.rollspeed, m.pitchspeed, m.yawspeed))

    def _offer(
        self,
        source: int,
        time_s: float,
        at: tuple[float, float, float],
        velocity: tuple[float, float, float],
        now_s: float,
    ) -> None:
        """A position on the link, for the choice among all sources."""
        fix = PositionFix(0, time_s, *at, *velocity)
        if self.sources.take(source, fix, self.vehicle_time_s if self._lockstep else now_s):
            self.counters.positions += 1

    def _set_attitude(
        self,
        time_s: float,
        q: tuple[float, float, float, float],
        rates: tuple[float, float, float],
    ) -> None:
        self.counters.attitudes += 1
        self.attitude = AttitudeSample(self.attitude.sequence + 1, time_s, *q, *rates)

    def _is_attitude_source(self, message_id: int, now_s: float) -> bool:
        if message_id != self._attitude_source:
            if now_s - self._attitude_heard_s <= SOURCE_SILENCE_S:
                return False
            self._attitude_source = message_id
        self._attitude_heard_s = now_s
        return True

    def _time_of(self, message_id: int, stamp_s: float, now_s: float) -> float | None:
        """When a sample was true, on the loop's clock; None: it is not new."""
        order = self._orders.get(message_id)
        if order is None:
            order = self._orders[message_id] = StampOrder()
            self._clocks[message_id] = ClockMap()
        verdict = order.judge(stamp_s)
        if verdict == StampOrder.STALE:
            self.counters.stale += 1
            return None
        if verdict == StampOrder.REBOOT:
            self._rebooted(message_id, now_s)
        if self._lockstep:
            return stamp_s
        clock = self._clocks[message_id]
        time_s = clock.observe(stamp_s, now_s)
        # Streams stamped by the same clock share what the fastest of them has learnt of it.
        for other in self._clocks.values():
            if clock.offset_s - 0.5 < other.offset_s < clock.offset_s:
                time_s = min(time_s, stamp_s + other.offset_s)
        return time_s

    def _rebooted(self, message_id: int, now_s: float) -> None:
        """The vehicle's clock began anew: forget it, greet again, ask again."""
        self.counters.reboots += 1
        for number, clock in self._clocks.items():
            clock.reset()
            if number != message_id:
                self._orders[number] = StampOrder()
        self._heartbeat_due_s = now_s
        self.streams.restart()
        self.round_trip.restart()
        self._inquiry.restart()
        self.notices.append((SEVERITY_INFO, "autopilot restarted: asking for its streams again"))


def _rotated(
    q: tuple[float, float, float, float], v: tuple[float, float, float]
) -> tuple[float, float, float]:
    """A body vector in the frame that the quaternion leads to."""
    w, x, y, z = q
    vx, vy, vz = v
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )
