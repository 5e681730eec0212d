"""One conversation with one autopilot: who we are, who it is, and what it measures.

We are an onboard computer: a heartbeat a second as (vehicle's system, our component), and that
before anything else, because an autopilot that has not yet heard of this component takes a
parameter set addressed to it for its own.  Of the autopilot, (its system, component 1) alone is
believed; ground stations and other vehicles on the same link are not.

Stamps of the vehicle become times on the loop's clock here (`clock`).  In lockstep the loop's
clock *is* the vehicle's and nothing is mapped.

Of several messages that carry the same (attitude, accelerations) one is taken at a time.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable
from dataclasses import dataclass
from math import inf
from typing import Final

from tgl_soar.geometry import quaternion_from_euler, rotated
from tgl_soar.link.autopilots.base import Flavour
from tgl_soar.link.autopilots.requirements import Needs
from tgl_soar.link.clock import MICROSECONDS_WRAP_S, MILLISECONDS_WRAP_S, StampedStreams
from tgl_soar.link.inquiry import SetupInquiry
from tgl_soar.link.messages import (
    AUTOPILOT_INVALID,
    COMMAND_SET_MESSAGE_INTERVAL,
    COMPONENT_AUTOPILOT,
    FRAME_BODY_FRD,
    FRAME_BODY_NED,
    FRAME_LOCAL_FRD,
    FRAME_LOCAL_NED,
    ID_ATTITUDE_QUATERNION,
    ID_GLOBAL_POSITION_INT,
    ID_HEARTBEAT,
    ID_HIGHRES_IMU,
    ID_LOCAL_POSITION_NED,
    ID_ODOMETRY,
    ID_RAW_IMU,
    ID_SCALED_IMU,
    ID_SERVO_OUTPUT_RAW,
    ID_SYS_STATUS,
    ID_VFR_HUD,
    MODE_FLAG_ARMED,
    SENSOR_DIFFERENTIAL_PRESSURE,
    SEVERITY_ERROR,
    SEVERITY_INFO,
    SEVERITY_WARNING,
    TYPE_GCS,
    AttitudeQuaternion,
    CommandAck,
    GlobalPositionInt,
    Heartbeat,
    HighresImu,
    Inbound,
    LocalPositionNed,
    Odometry,
    Outbound,
    ParamValue,
    RawImu,
    Received,
    ScaledImu,
    ServoOutputRaw,
    Source,
    SysStatus,
    Timesync,
    VfrHud,
    VisionPositionEstimate,
)
from tgl_soar.link.presence import Presence
from tgl_soar.link.sensing import airspeed_of_hud, airspeed_of_pressure, imu_of, sigma_of
from tgl_soar.link.sources import (
    GLOBAL_POSITION,
    LOCAL_POSITION,
    ODOMETRY,
    VISION,
    PositionSources,
    Quaternion,
)
from tgl_soar.link.streams import StreamRequests
from tgl_soar.link.tangent_plane import Home, TangentPlane
from tgl_soar.link.timesync import RoundTrip
from tgl_soar.types import (
    NAN,
    NO_AIRSPEED,
    NO_ATTITUDE,
    NO_IMU,
    NO_SURFACES,
    AirspeedSample,
    AttitudeSample,
    AutopilotStatus,
    ImuSample,
    PositionFix,
    SurfacesSample,
    isfinite,
)

HEARTBEAT_S: Final = 1.0
# Of the autopilot, where the module changes its mode: so soon the pilot's own choice is seen.
HEARTBEAT_HZ: Final = 5.0
POSITION_HZ: Final = 50.0
SERVO_HZ: Final = 50.0
STATUS_HZ: Final = 1.0
IMU_NAMES: Final = {
    ID_RAW_IMU: "RAW_IMU",
    ID_SCALED_IMU: "SCALED_IMU",
    ID_HIGHRES_IMU: "HIGHRES_IMU",
}
SILENCE_S: Final = 0.5  # after this another message may give the same quantity
FAR_M: Final = 100_000.0  # from the home: no place of this flight
TELL_CLOCK_S: Final = 10.0  # between two words of another clock
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
    other_clock: int = 0  # stamped by another clock than the autopilot's, or while two speak
    not_finite: int = 0
    imus: int = 0  # taken
    airspeeds: int = 0  # taken
    no_measurement: int = 0  # of accelerations or airspeed that cannot be
    far: int = 0  # GLOBAL_POSITION_INT that is nowhere near the home
    wrong_frame: int = 0  # ODOMETRY in a frame that is not understood
    foreign: int = 0  # measurements of another system or component
    reboots: int = 0


class Exclusive:
    """Of several messages that carry the same, one speaks; another when that has fallen silent."""

    def __init__(self) -> None:
        self._speaker: Hashable = None
        self._heard_s = NAN

    def speaks(self, message: Hashable, now_s: float) -> bool:
        """Whether this one is to be taken."""
        if message != self._speaker:
            if now_s - self._heard_s <= SILENCE_S:
                return False
            self._speaker = message
        self._heard_s = now_s
        return True

    def rebase(self) -> None:
        """The clock is another one."""
        self._heard_s = NAN


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
        home: Home | None = None,
        vision_from: Collection[Source] = (),
        imu: int | None = None,
        start: int = 1,
        needs: Needs | None = None,
    ) -> None:
        """`sources`: whose positions are taken; of the autopilot's alone if not given.

        `home`: where latitude and longitude are counted from.  `vision_from`: whose
        VISION_POSITION_ESTIMATE is believed.  `imu`: the message that is to carry
        accelerations; None: the firmware's usual one, 0: none.  `start`: a number of this start
        of the module, for its heartbeat.  `needs`: what its parameters are read for; None: only
        for whom it obeys.
        """
        self.counters = SessionCounters()
        self.sources = sources or PositionSources()
        self.attitude = NO_ATTITUDE
        self.imu = NO_IMU
        self.airspeed = NO_AIRSPEED
        self.surfaces = NO_SURFACES
        self.status = AutopilotStatus(time_s=NAN, accepts_surfaces=False, armed=False)
        self.custom_mode = -1  # of the autopilot, as its heartbeat tells it
        self.mismatch = ""  # why this is not the autopilot of the airframe file
        self.vehicle_time_s = NAN  # newest stamp of the attitude, vehicle's clock
        self.servos_us: tuple[int, ...] = ()
        self.heard: set[Source] = set()
        self.notices: list[tuple[int, str]] = []  # (severity, text), for whoever tells them
        self.presence = Presence(start)
        self.streams = StreamRequests(own.system)
        self.round_trip = RoundTrip()
        self.inquiry = SetupInquiry(flavour, own.system, override_system, needs)
        self._own = own
        self.autopilot = Source(own.system, COMPONENT_AUTOPILOT)
        self._flavour = flavour
        self._lockstep = lockstep
        self._heartbeat_due_s = float("-inf")
        self._stamps = StampedStreams(lockstep=lockstep)
        self._clock_told_s = float("-inf")
        self._contested = False
        self._attitude_from, self._imu_from = Exclusive(), Exclusive()
        self._has_pitot = False
        self._vision_from = frozenset(vision_from)
        self._plane = TangentPlane(home) if home is not None else None
        self._imus = list(flavour.sensors.imu) if imu is None else [imu] if imu else []
        self.streams.want(ID_ATTITUDE_QUATERNION, "ATTITUDE_QUATERNION", loop_rate_hz)
        self._want_positions()
        self.streams.want(ID_SERVO_OUTPUT_RAW, "SERVO_OUTPUT_RAW", SERVO_HZ)
        self.set_loop_rate(loop_rate_hz)
        self.streams.want(*flavour.sensors.airspeed)
        self.streams.want(ID_SYS_STATUS, "SYS_STATUS", STATUS_HZ)
        if flavour.route.mode_to_enter is not None:
            self.streams.want(ID_HEARTBEAT, "HEARTBEAT", HEARTBEAT_HZ, urgent=True)

    def set_loop_rate(self, loop_rate_hz: float) -> None:
        """Attitude and accelerations are wanted once a tick."""
        self._loop_rate_hz = loop_rate_hz
        self.streams.want(ID_ATTITUDE_QUATERNION, "ATTITUDE_QUATERNION", loop_rate_hz)
        if self._imus:
            self.streams.want(self._imus[0], IMU_NAMES[self._imus[0]], loop_rate_hz)

    def _want_positions(self) -> None:
        """ODOMETRY is what LOCAL_POSITION_NED is: asked for where that is refused."""
        named = self.sources.health
        if LOCAL_POSITION in named:
            self.streams.want(ID_LOCAL_POSITION_NED, "LOCAL_POSITION_NED", POSITION_HZ)
        elif ODOMETRY in named:
            self.streams.want(ID_ODOMETRY, "ODOMETRY", POSITION_HZ)
        if GLOBAL_POSITION in named:
            self.streams.want(ID_GLOBAL_POSITION_INT, "GLOBAL_POSITION_INT", POSITION_HZ)

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
        return self.presence.heartbeat()

    def heartbeat_if_due(self, now_s: float) -> list[Heartbeat]:
        """Ours, once a second."""
        if now_s < self._heartbeat_due_s:
            return []
        late = now_s - self._heartbeat_due_s > HEARTBEAT_S
        self._heartbeat_due_s = (now_s if late else self._heartbeat_due_s) + HEARTBEAT_S
        return [self.heartbeat()]

    def poll(self, now_s: float) -> list[Outbound]:
        """What is due: questions to the autopilot, at most one request for a stream."""
        said: list[Outbound] = []
        if self.is_heard:
            said.extend(self.streams.poll(now_s))
            question = None if self._lockstep else self.round_trip.poll(now_s)
            if question is not None:
                said.append(question)
            asked, complaints = self.inquiry.poll(now_s)
            said.extend(asked)
            self.notices.extend((SEVERITY_WARNING, complaint) for complaint in complaints)
        self._tell_contest(now_s)
        if self.streams.notices:
            self._tell_refusals()
        if self.sources.notices:
            self.notices.extend(self.sources.notices)
            self.sources.notices.clear()
        return said

    def rebase(self, now_s: float) -> None:
        """The loop's clock was changed to now_s: whatever was timed by the old one begins anew."""
        self._heartbeat_due_s = now_s
        self.presence.rebase()
        self.sources.rebase()
        self._attitude_from.rebase()
        self._imu_from.rebase()
        self.streams.restart()
        self.round_trip.restart()
        self.inquiry.restart()
        if self.is_heard:
            self.status = self.status._replace(time_s=now_s)

    def handle(self, received: Received, now_s: float) -> list[Outbound]:
        """Take in one message; what is to be said at once."""
        source, message = received
        if source not in self.heard and len(self.heard) < MAX_HEARD:
            self.heard.add(source)
        if source != self.autopilot:
            return self._handle_other(source, message, now_s)
        if isinstance(message, AttitudeQuaternion):
            self._take_attitude_quaternion(message, now_s)
        elif isinstance(message, _IMU_KINDS):
            self._take_imu(message, now_s)
        elif isinstance(message, LocalPositionNed):
            self._take_local_position(message, now_s)
        elif isinstance(message, ServoOutputRaw):
            self._take_servos(message, now_s)
        elif isinstance(message, Odometry):
            self._take_odometry(message, now_s)
        elif isinstance(message, GlobalPositionInt):
            self._take_global_position(message, now_s)
        elif isinstance(message, Timesync):
            return self._timesync(source, message, now_s)
        elif isinstance(message, VfrHud):
            self._take_hud(message, now_s)
        elif isinstance(message, SysStatus):
            self.streams.heard(ID_SYS_STATUS)
            pitot = message.sensors_present & message.sensors_health
            self._has_pitot = pitot & SENSOR_DIFFERENTIAL_PRESSURE != 0
        elif isinstance(message, Heartbeat):
            self._take_heartbeat(message, now_s)
        elif isinstance(message, ParamValue):
            self.inquiry.heard(message)
        elif isinstance(message, CommandAck):
            self._take_ack(message, now_s)
        elif isinstance(message, VisionPositionEstimate):
            self._take_vision(source, message, now_s)
        return []

    def _handle_other(self, source: Source, message: Inbound, now_s: float) -> list[Outbound]:
        """Of somebody who is not the autopilot."""
        if isinstance(message, Timesync):
            return self._timesync(source, message, now_s)
        if isinstance(message, VisionPositionEstimate):
            self._take_vision(source, message, now_s)
        elif isinstance(message, _MEASUREMENTS):
            self.counters.foreign += 1
        return []

    # --- the conversation -------------------------------------------------------------------

    def _timesync(self, source: Source, message: Timesync, now_s: float) -> list[Outbound]:
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
        self.streams.heard(ID_HEARTBEAT)
        self.custom_mode = message.custom_mode
        mismatch = self._flavour.mismatch(message)
        if mismatch != self.mismatch:
            self.mismatch = mismatch
            if mismatch:
                self.notices.append((SEVERITY_ERROR, mismatch))
        self.status = AutopilotStatus(
            time_s=now_s,
            accepts_surfaces=not mismatch and self._flavour.obeys(message),
            armed=message.base_mode & MODE_FLAG_ARMED != 0,
            failsafe=self._flavour.failsafe(message),
            boots=self.counters.reboots,
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
            if stream.message_id == ID_HEARTBEAT:
                text += ": a mode that the pilot chooses is seen up to a second later"
            elif word == "denied":
                text += f": {self._flavour.way_to_rate(rate_hz)}"
            if not stream.given_up:
                text += f"; asking for {stream.rate_hz:g} Hz"
            self.notices.append((SEVERITY_WARNING, text))
            if stream.given_up:
                self._want_instead(stream.message_id)
        self.streams.notices.clear()

    def _want_instead(self, message_id: int) -> None:
        """What carries the same as a message that the autopilot does not have."""
        if message_id == ID_LOCAL_POSITION_NED and ODOMETRY in self.sources.health:
            self.streams.want(ID_ODOMETRY, "ODOMETRY", POSITION_HZ)
        if message_id in self._imus:
            self._imus.remove(message_id)
            self.set_loop_rate(self._loop_rate_hz)

    # --- measurements -----------------------------------------------------------------------

    def _take_attitude_quaternion(self, m: AttitudeQuaternion, now_s: float) -> None:
        self.streams.heard(ID_ATTITUDE_QUATERNION)
        if not (isfinite(m.q1) and isfinite(m.q2) and isfinite(m.q3) and isfinite(m.q4)):
            self.counters.not_finite += 1
            return
        times = self._time_of(ID_ATTITUDE_QUATERNION, m.time_boot_ms, now_s)
        if times is None or not self._attitude_from.speaks(ID_ATTITUDE_QUATERNION, now_s):
            return
        time_s, self.vehicle_time_s = times
        self._set_attitude(
            time_s, (m.q1, m.q2, m.q3, m.q4), (m.rollspeed, m.pitchspeed, m.yawspeed)
        )

    def _take_imu(self, m: HighresImu | RawImu | ScaledImu, now_s: float) -> None:
        if isinstance(m, ScaledImu):
            number, times = m.message_id, self._time_of(m.message_id, m.time_boot_ms, now_s)
        elif isinstance(m, RawImu):
            number, times = ID_RAW_IMU, self._time_of_us(ID_RAW_IMU, m.time_usec, now_s)
        else:
            number, times = ID_HIGHRES_IMU, self._time_of_us(ID_HIGHRES_IMU, m.time_usec, now_s)
        self.streams.heard(number)
        if times is None:
            return
        if isinstance(m, HighresImu) and self._flavour.sensors.pitot_in_imu:
            self._set_airspeed(airspeed_of_pressure(m), times[0])
        measured = imu_of(m)
        if measured is None:
            self.counters.no_measurement += 1
        elif self._imu_from.speaks(number, now_s):
            (x, y, z), (p, q, r) = measured
            self.counters.imus += 1
            self.imu = ImuSample(
                sequence=self.imu.sequence + 1,
                time_s=times[0],
                force_x_frd_mps2=x,
                force_y_frd_mps2=y,
                force_z_frd_mps2=z,
                roll_rate_frd_radps=p,
                pitch_rate_frd_radps=q,
                yaw_rate_frd_radps=r,
            )

    def _take_hud(self, m: VfrHud, now_s: float) -> None:
        """It has no stamp.  Without a pitot tube it shows a guess, which is no measurement."""
        self.streams.heard(ID_VFR_HUD)
        if self._has_pitot:
            measured = airspeed_of_hud(m)
            self.counters.no_measurement += measured is None
            self._set_airspeed(measured, self._loop_time_s(now_s))

    def _set_airspeed(self, airspeed_mps: float | None, time_s: float) -> None:
        if airspeed_mps is not None:
            self.counters.airspeeds += 1
            self.airspeed = AirspeedSample(self.airspeed.sequence + 1, time_s, airspeed_mps)

    def _take_servos(self, m: ServoOutputRaw, now_s: float) -> None:
        self.streams.heard(ID_SERVO_OUTPUT_RAW)
        if m.port != 0:
            return
        times = self._time_of_us(
            ID_SERVO_OUTPUT_RAW, m.time_usec, now_s, wrap_s=MICROSECONDS_WRAP_S
        )
        if times is not None:
            self.servos_us = m.servos
            put = self._flavour.deflections(m.servos)
            self.surfaces = SurfacesSample(
                sequence=self.surfaces.sequence + 1,
                time_s=times[0],
                elevator=put.elevator,
                aileron=put.aileron,
                rudder=put.rudder,
            )

    def _take_local_position(self, m: LocalPositionNed, now_s: float) -> None:
        self.streams.heard(ID_LOCAL_POSITION_NED)
        if not (isfinite(m.x) and isfinite(m.y) and isfinite(m.z)):
            self.counters.not_finite += 1
            return
        times = self._time_of(ID_LOCAL_POSITION_NED, m.time_boot_ms, now_s)
        if times is not None:
            self._offer(LOCAL_POSITION, times[0], (m.x, m.y, m.z), (m.vx, m.vy, m.vz), now_s)

    def _take_global_position(self, m: GlobalPositionInt, now_s: float) -> None:
        self.streams.heard(ID_GLOBAL_POSITION_INT)
        times = self._time_of(ID_GLOBAL_POSITION_INT, m.time_boot_ms, now_s)
        if times is None or self._plane is None:
            return
        at = self._plane.ned_m(m.lat * 1e-7, m.lon * 1e-7, m.alt * 1e-3)
        if not max(abs(at[0]), abs(at[1]), abs(at[2])) < FAR_M:
            if self.counters.far == 0:
                where = f"{m.lat * 1e-7:.4f}, {m.lon * 1e-7:.4f}"
                text = f"GLOBAL_POSITION_INT at {where}: no fix, or not near position.home"
                self.notices.append((SEVERITY_WARNING, text))
            self.counters.far += 1
            return
        velocity = m.vx * 0.01, m.vy * 0.01, m.vz * 0.01
        self._offer(GLOBAL_POSITION, times[0], at, velocity, now_s)

    def _take_vision(self, source: Source, m: VisionPositionEstimate, now_s: float) -> None:
        """What another bridge tells the autopilot, overheard."""
        if source not in self._vision_from:
            self.counters.foreign += 1
            return
        if not (isfinite(m.x) and isfinite(m.y) and isfinite(m.z)):
            self.counters.not_finite += 1
            return
        times = self._time_of_us(source, m.usec, now_s, foreign=True)
        if times is not None:
            told = all(isfinite(angle) for angle in (m.roll, m.pitch, m.yaw))
            turned = quaternion_from_euler(m.roll, m.pitch, m.yaw) if told else None
            sigma_m = sigma_of(m.covariance)
            self._offer(VISION, times[0], (m.x, m.y, m.z), (NAN, NAN, NAN), now_s, sigma_m, turned)

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
        times = self._time_of_us(ID_ODOMETRY, m.time_usec, now_s)
        if times is None:
            return
        time_s = times[0]
        turned = all(isfinite(q) for q in m.q)
        velocity = (m.vx, m.vy, m.vz)
        if in_body:
            velocity = rotated(m.q, velocity) if turned else (NAN, NAN, NAN)
        sigma_m = sigma_of(m.pose_covariance)
        self._offer(ODOMETRY, time_s, (m.x, m.y, m.z), velocity, now_s, sigma_m)
        if turned and not self._lockstep and self._attitude_from.speaks(ID_ODOMETRY, now_s):
            self.vehicle_time_s = times[1]
            self._set_attitude(time_s, m.q, (m.rollspeed, m.pitchspeed, m.yawspeed))

    def _offer(
        self,
        source: int,
        time_s: float,
        at: tuple[float, float, float],
        velocity: tuple[float, float, float],
        now_s: float,
        sigma_m: float = NAN,
        turned: Quaternion | None = None,
    ) -> None:
        """A position on the link, for the choice among all sources."""
        (x, y, z), (u, v, w) = at, velocity
        fix = PositionFix(
            sequence=0,
            time_s=time_s,
            north_m=x,
            east_m=y,
            down_m=z,
            velocity_north_mps=u,
            velocity_east_mps=v,
            velocity_down_mps=w,
            source=source,
            sigma_m=sigma_m,
        )
        if self._lockstep:  # the vehicle is at least as far as this, though its attitude be lost
            now_s = time_s if time_s > self.vehicle_time_s else self.vehicle_time_s
        if self.sources.take(source, fix, now_s, turned):
            self.counters.positions += 1

    def _set_attitude(
        self,
        time_s: float,
        q: Quaternion,
        rates: tuple[float, float, float],
    ) -> None:
        self.counters.attitudes += 1
        (w, x, y, z), (roll, pitch, yaw) = q, rates
        number = self.attitude.sequence + 1
        self.attitude = AttitudeSample(
            sequence=number,
            time_s=time_s,
            qw=w,
            qx=x,
            qy=y,
            qz=z,
            roll_rate_frd_radps=roll,
            pitch_rate_frd_radps=pitch,
            yaw_rate_frd_radps=yaw,
        )

    def _loop_time_s(self, now_s: float) -> float:
        """Now, on the loop's clock."""
        return self.vehicle_time_s if self._lockstep else now_s

    def _time_of(self, number: int, stamp_ms: int, now_s: float) -> tuple[float, float] | None:
        """When a sample stamped in milliseconds was true, on our clock and on the vehicle's."""
        return self._placed(
            number, stamp_ms * 1e-3, now_s, wrap_s=MILLISECONDS_WRAP_S, quantised=True
        )

    def _time_of_us(
        self,
        key: Hashable,
        stamp_us: int,
        now_s: float,
        *,
        wrap_s: float = inf,
        foreign: bool = False,
    ) -> tuple[float, float] | None:
        """The same of one stamped in microseconds."""
        return self._placed(key, stamp_us * 1e-6, now_s, wrap_s=wrap_s, foreign=foreign)

    def _placed(
        self,
        key: Hashable,
        stamp_s: float,
        now_s: float,
        *,
        wrap_s: float,
        quantised: bool = False,
        foreign: bool = False,
    ) -> tuple[float, float] | None:
        stamps = self._stamps
        reboots, suspected, refused = stamps.reboots, stamps.suspected, stamps.refused
        times = stamps.time_of(
            key, stamp_s, now_s, wrap_s=wrap_s, quantised=quantised, foreign=foreign
        )
        if stamps.reboots != reboots:
            self._rebooted(now_s)
        if stamps.suspected != suspected:
            self._tell_other_clock(now_s)
        if stamps.refused != refused:
            self.counters.other_clock += 1
        elif times is None:
            self.counters.stale += 1
        return times

    def _tell_other_clock(self, now_s: float) -> None:
        """Frames of another clock count on from each other."""
        if now_s - self._clock_told_s >= TELL_CLOCK_S:
            self._clock_told_s = now_s
            apart = _apart(self._stamps.suspect_ahead_s)
            text = f"stamps of another clock, {apart} the autopilot's: refused"
            self.notices.append((SEVERITY_WARNING, text))

    def _tell_contest(self, now_s: float) -> None:
        """Two clocks have begun to speak beside each other, or one of them has fallen silent."""
        contested = self._stamps.is_contested(now_s)
        if contested == self._contested:
            return
        self._contested = contested
        name = f"{self.autopilot.system}:{self.autopilot.component}"
        if contested:
            apart = _apart(self._stamps.suspect_ahead_s)
            text = f"two autopilots are {name}, one {apart} the other: neither is flown with"
            self.notices.append((SEVERITY_ERROR, text))
        else:
            text = f"one clock alone speaks as {name} again"
            self.notices.append((SEVERITY_INFO, text))

    def _rebooted(self, now_s: float) -> None:
        """The vehicle's clock is another one: greet again, ask again."""
        self.counters.reboots += 1
        self.status = self.status._replace(boots=self.counters.reboots)
        self._heartbeat_due_s = now_s
        self.streams.restart()
        self.round_trip.restart()
        self.inquiry.restart()
        what, leap_s = "autopilot restarted", self._stamps.leap_s
        if leap_s > 0.0:
            what = f"the autopilot's clock is another one, {_apart(leap_s)} the last"
        self.notices.append((SEVERITY_INFO, f"{what}: asking for its streams again"))


def _apart(ahead_s: float) -> str:
    """How one clock stands to another, in words."""
    return f"{abs(ahead_s):.1f} s {'ahead of' if ahead_s > 0.0 else 'behind'}"


_IMU_KINDS: Final = (RawImu, ScaledImu, HighresImu)
_MEASUREMENTS: Final = (
    *_IMU_KINDS,
    AttitudeQuaternion,
    LocalPositionNed,
    Odometry,
    GlobalPositionInt,
    VfrHud,
    ServoOutputRaw,
)
