"""One conversation with one autopilot: who we are, who it is, and what it measures.

We are an onboard computer: a heartbeat a second as (vehicle's system, our component), and that
before anything else, because an autopilot that has not yet received one of this component takes a
parameter set addressed to it for its own.  Only messages of the autopilot, (its system,
component 1), are accepted; ground stations and other vehicles on the same link are ignored.

What its messages mean is in `vehicle/`: its status, its samples, and the times of both.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Final, NamedTuple

from tgl_soar.link.autopilot_setup_check import SetupInquiry
from tgl_soar.link.autopilots.base import Flavour
from tgl_soar.link.autopilots.requirements import Needs
from tgl_soar.link.messages import (
    COMMAND_SET_MESSAGE_INTERVAL,
    COMPONENT_AUTOPILOT,
    SEVERITY_WARNING,
    AttitudeQuaternion,
    CommandAck,
    DistanceSensor,
    EkfStatusReport,
    EstimatorStatus,
    GlobalPositionInt,
    GpsRawInt,
    Heartbeat,
    HighresImu,
    HomeMessage,
    Inbound,
    LocalPositionNed,
    MissionCount,
    MissionCurrent,
    MissionItemInt,
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
    Wind,
    WindCov,
)
from tgl_soar.link.mission import MissionReading
from tgl_soar.link.presence import Presence
from tgl_soar.link.sources import PositionSources
from tgl_soar.link.stream_requests import StreamRequests
from tgl_soar.link.tangent_plane import Home
from tgl_soar.link.timesync import RoundTrip
from tgl_soar.link.vehicle.autopilot_wind import AutopilotWind
from tgl_soar.link.vehicle.diagnostics import Ledger, SessionCounters
from tgl_soar.link.vehicle.estimator_status import EstimatorAids
from tgl_soar.link.vehicle.gnss_accuracy import GnssAccuracy
from tgl_soar.link.vehicle.message_rates import MessageRates
from tgl_soar.link.vehicle.position_samples import PositionSamples
from tgl_soar.link.vehicle.sample_times import SampleTimes
from tgl_soar.link.vehicle.sensor_samples import SensorSamples
from tgl_soar.link.vehicle.status import VehicleStatus
from tgl_soar.types import (
    AirspeedSample,
    AttitudeSample,
    AutopilotStatus,
    ImuSample,
    PositionFix,
    RangeSample,
    SurfacesSample,
)

HEARTBEAT_S: Final = 1.0
MAX_SENDERS: Final = 32  # remembered, for the message that no autopilot was received


class SessionOptions(NamedTuple):
    """Who talks with whom, and what of it is used."""

    own: Source
    flavour: Flavour
    loop_rate_hz: float
    override_system: int = 255
    lockstep: bool = False  # the loop's clock is the vehicle's
    sources: PositionSources | None = None  # None: the autopilot's positions alone
    home: Home | None = None  # the origin for latitude and longitude
    vision_from: Collection[Source] = ()  # whose VISION_POSITION_ESTIMATE is accepted
    imu: int | None = None  # message with accelerations; None: the firmware's usual one, 0: none
    rangefinder: bool = False  # one that looks down is fitted
    start: int = 1  # a number of this start of the module, for its heartbeat
    needs: Needs | None = None  # what parameters are checked for; None: only whom it obeys


class Session:
    """Takes messages and returns what is due; time is an argument."""

    def __init__(self, options: SessionOptions) -> None:
        own, flavour = options.own, options.flavour
        self._own = own
        self._lockstep = options.lockstep
        self.autopilot = Source(own.system, COMPONENT_AUTOPILOT)
        self.counters = SessionCounters()
        self.notices: list[tuple[int, str]] = []  # (severity, text), for the operator
        self.senders: set[Source] = set()
        self.presence = Presence(options.start)
        self.round_trip = RoundTrip()
        self.inquiry = SetupInquiry(flavour, own.system, options.override_system, options.needs)
        self.mission = MissionReading(own)
        self.sources = options.sources or PositionSources()
        self.streams = StreamRequests(own.system)
        self._heartbeat_due_s = float("-inf")
        ledger = Ledger(self.counters, self.notices, self.streams)
        self.vehicle = VehicleStatus(flavour, ledger)
        self._times = SampleTimes(
            self.autopilot, ledger, self._autopilot_restarted, lockstep=options.lockstep
        )
        self.samples = SensorSamples(flavour, self._times, ledger)
        self._aids = EstimatorAids(ledger)
        satellites = options.needs is not None and options.needs.gps
        self.receiver = GnssAccuracy(ledger, counts=satellites)
        self.wind = AutopilotWind(flavour.sensors.wind, ledger)
        self._positions = PositionSamples(
            self.sources,
            options.home,
            options.vision_from,
            self.samples,
            self._times,
            self._aids,
            ledger,
        )
        self._rates = MessageRates(flavour, options.imu, options.loop_rate_hz, self.sources, ledger)
        if satellites:
            self._rates.want_accuracy()
        if options.rangefinder:
            self._rates.want_rangefinder()

    def set_loop_rate(self, loop_rate_hz: float) -> None:
        """Attitude and accelerations are needed once a tick."""
        self._rates.set_loop_rate(loop_rate_hz)

    @property
    def attitude(self) -> AttitudeSample:
        """The newest."""
        return self.samples.attitude

    @property
    def imu(self) -> ImuSample:
        """The newest accelerations and rates."""
        return self.samples.imu

    @property
    def airspeed(self) -> AirspeedSample:
        """The newest."""
        return self.samples.airspeed

    @property
    def rangefinder(self) -> RangeSample:
        """The newest distance to the ground."""
        return self.samples.rangefinder

    @property
    def surfaces(self) -> SurfacesSample:
        """The newest deflections."""
        return self.samples.surfaces

    @property
    def servos_us(self) -> tuple[int, ...]:
        """The newest pulse widths of the first port."""
        return self.samples.servos_us

    @property
    def vehicle_time_s(self) -> float:
        """Newest stamp of the attitude, vehicle's clock."""
        return self.samples.vehicle_time_s

    @property
    def status(self) -> AutopilotStatus:
        """As the last heartbeat says."""
        return self.vehicle.status

    @property
    def custom_mode(self) -> int:
        """Of the autopilot, as its last heartbeat says; -1: there was none."""
        return self.vehicle.custom_mode

    @property
    def mismatch(self) -> str:
        """Why this is not the autopilot of the airframe file; "" if it is."""
        return self.vehicle.mismatch

    @property
    def position(self) -> PositionFix:
        """Of the source that is trusted most now."""
        return self.sources.position

    @property
    def has_heartbeat(self) -> bool:
        """Whether the autopilot has ever sent a heartbeat."""
        return self.vehicle.is_known

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
        outbound: list[Outbound] = []
        if self.has_heartbeat:
            outbound.extend(self.streams.poll(now_s))
            question = None if self._lockstep else self.round_trip.poll(now_s)
            if question is not None:
                outbound.append(question)
            requests, complaints = self.inquiry.poll(now_s)
            outbound.extend(requests)
            outbound.extend(self.mission.poll(now_s))
            self.notices.extend((SEVERITY_WARNING, complaint) for complaint in complaints)
        self._times.poll(now_s)
        self._aids.poll(now_s)
        if self.streams.notices:
            self._rates.poll_refusals()
        if self.sources.notices:
            self.notices.extend(self.sources.notices)
            self.sources.notices.clear()
        return outbound

    def rebase(self, now_s: float) -> None:
        """The loop's clock was changed to now_s: what was timed by the old one is reset."""
        self._heartbeat_due_s = now_s
        self.presence.rebase()
        self.sources.rebase()
        self.samples.rebase()
        self.streams.restart()
        self.round_trip.restart()
        self._times.take_queue(0.0, now_s)
        self.inquiry.restart()
        self.mission.restart()
        self._aids.rebase(now_s)
        self.receiver.restarted()
        self.wind.restarted()
        self.vehicle.rebase(now_s)

    def _autopilot_restarted(self, now_s: float) -> None:
        """The vehicle's clock is another one: greet again, ask again."""
        self.vehicle.restarted()
        self._aids.restarted()
        self.receiver.restarted()
        self.wind.restarted()
        self._heartbeat_due_s = now_s
        self.streams.restart()
        self.round_trip.restart()
        self._times.take_queue(0.0, now_s)
        self.inquiry.restart()
        self.mission.restart()

    def handle(self, received: Received, now_s: float) -> list[Outbound]:
        """Take one message; the answers that are to be sent at once."""
        source, message = received
        if source not in self.senders and len(self.senders) < MAX_SENDERS:
            self.senders.add(source)
        if source != self.autopilot:
            return self._handle_other(source, message, now_s)
        if isinstance(message, AttitudeQuaternion):
            self.samples.on_attitude_quaternion(message, now_s)
        elif isinstance(message, _IMU_KINDS):
            self.samples.on_imu(message, now_s)
        elif isinstance(message, LocalPositionNed):
            self._positions.on_local_position(message, now_s)
        elif isinstance(message, ServoOutputRaw):
            self.samples.on_servos(message, now_s)
        elif isinstance(message, Odometry):
            self._positions.on_odometry(message, now_s)
        elif isinstance(message, GlobalPositionInt):
            self._positions.on_global_position(message, now_s)
        elif isinstance(message, Timesync):
            return self._on_timesync(source, message, now_s)
        elif isinstance(message, VfrHud):
            self.samples.on_hud(message, now_s)
        elif isinstance(message, DistanceSensor):
            self.samples.on_distance(message, now_s)
        elif isinstance(message, SysStatus):
            self.samples.on_sys_status(message)
        elif isinstance(message, EkfStatusReport | EstimatorStatus):
            self._aids.on_status(message, now_s)
        elif isinstance(message, GpsRawInt):
            self.receiver.take(message, now_s)
        elif isinstance(message, Wind | WindCov):
            self.wind.take(message, now_s)
        elif isinstance(message, Heartbeat):
            self.vehicle.on_heartbeat(message, now_s)
        elif isinstance(message, ParamValue):
            self.inquiry.take(message)
        elif isinstance(message, CommandAck):
            self._on_ack(message, now_s)
        elif isinstance(message, (MissionCount, MissionItemInt, MissionCurrent, HomeMessage)):
            self.mission.take(message)
        elif isinstance(message, VisionPositionEstimate):
            self._positions.on_vision(source, message, now_s)
        return []

    def _handle_other(self, source: Source, message: Inbound, now_s: float) -> list[Outbound]:
        """Of a sender that is not the autopilot."""
        if isinstance(message, Timesync):
            return self._on_timesync(source, message, now_s)
        if isinstance(message, VisionPositionEstimate):
            self._positions.on_vision(source, message, now_s)
        elif isinstance(message, _MEASUREMENTS):
            self.counters.foreign += 1
        return []

    def _on_timesync(self, source: Source, message: Timesync, now_s: float) -> list[Outbound]:
        """A request is answered with our time; of answers only the autopilot's are used."""
        if message.tc1 != 0:
            if source == self.autopilot:
                self.round_trip.take(message, now_s)
                self._times.take_queue(self.round_trip.queue_s, now_s)
            return []
        # In lockstep the answer says only that all before it was done; zero would be a request.
        ours_ns = (message.ts1 or 1) if self._lockstep else int(now_s * 1e9)
        return [Timesync(ours_ns, message.ts1)]

    def _on_ack(self, message: CommandAck, now_s: float) -> None:
        for_us = message.target_system in (0, self._own.system) and message.target_component in (
            0,
            self._own.component,
        )
        if for_us and message.command == COMMAND_SET_MESSAGE_INTERVAL:
            self.streams.acknowledged(message.result, now_s)


_IMU_KINDS: Final = (RawImu, ScaledImu, HighresImu)
_MEASUREMENTS: Final = (
    *_IMU_KINDS,
    AttitudeQuaternion,
    LocalPositionNed,
    Odometry,
    GlobalPositionInt,
    VfrHud,
    ServoOutputRaw,
    DistanceSensor,
    GpsRawInt,
    Wind,
    WindCov,
    EkfStatusReport,
    EstimatorStatus,
)
