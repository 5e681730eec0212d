"""A simulated Pixhawk: what a companion computer and ground stations see of an ArduPlane.

It has no sockets and no clock.  `receive` takes the datagrams of a link, `step` advances by
one fixed step and returns what goes out on each link.  What it accepts, refuses and lets time
out follows what was measured on ArduPlane 4.6 (docs/autopilots.md; a recorded conversation is
held against it in the tests): surfaces are moved by `RC_CHANNELS_OVERRIDE` in MANUAL, and only by
the system that `SYSID_MYGCS` names; everyone else is ignored without a word.

Two modes: MANUAL (sticks move surfaces) and FBWA (sticks ask for pitch and bank, wings level
and trim pitch with the sticks centred).  When overrides time out the pilot's sticks move the
surfaces again, in the same mode; where there is no receiver it changes to FBWA, as with
`FS_SHORT_ACTN = 2`.  Like every mode of an aircraft without a propeller FBWA holds an attitude,
not a place.

Everything that arrives is hostile until it has been read: nothing received can raise.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Container
from dataclasses import dataclass, field
from math import degrees, inf, isfinite, nan, pi
from typing import Any, Final, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.files import HomePosition, Surfaces
from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.sim.channels import (
    CHANNELS,
    NEUTRAL,
    Overrides,
    deflection_from_pwm,
    ordered,
    pwm_from_deflection,
    pwm_from_stick,
    stick_from_pwm,
)
from tgl_soar.sim.routing import Frame, LinkId, Router, split_frames
from tgl_soar.sim.sensor_messages import (
    ShownAirspeed,
    global_position,
    highres_imu,
    raw_imu,
    scaled_imu,
)
from tgl_soar.sim.vehicle.external_pose import ExternalPose
from tgl_soar.types import (
    NO_AIRSPEED,
    NO_IMU,
    AirspeedSample,
    AttitudeSample,
    ImuSample,
    PositionFix,
    SurfaceCommand,
)

MANUAL: Final = 0
FBWA: Final = 5
MODE_NAMES: Final = {MANUAL: "MANUAL", FBWA: "FBWA"}

COMPONENT: Final = mavlink.MAV_COMP_ID_AUTOPILOT1
OVERRIDES_NEVER_EXPIRE: Final = -1.0
_RATE_FRACTION: Final = 0.8  # of SCHED_LOOP_RATE: faster streams are denied
_PARAMETERS_PER_STEP: Final = 2  # of a list, so that it does not delay the sensors
_DATAGRAM_BYTES: Final = 1200
_CHANNEL_UNUSED: Final = 65535
_NO_INDEX: Final = 65535  # of a parameter that was asked for by name
_FORCE_DISARM: Final = 21196.0
PITCH_STICK_RAD: Final = 0.26  # FBWA: pitch asked for by a full stick
_BANK_STICK_RAD: Final = 0.52


class Sensed(NamedTuple):
    """What the autopilot's sensors and estimator have at one step."""

    attitude: AttitudeSample  # the latest delivered; sequence 0: none yet
    position: PositionFix
    airspeed_mps: float
    flying: bool  # False while held or lying on the ground: no failsafe acts
    imu: ImuSample = NO_IMU  # sequence 0: it has none
    pitot: AirspeedSample = NO_AIRSPEED


GROUNDED: Final = Sensed(
    attitude=AttitudeSample(
        sequence=0,
        time_s=0.0,
        qw=1.0,
        qx=0.0,
        qy=0.0,
        qz=0.0,
        roll_rate_frd_radps=0.0,
        pitch_rate_frd_radps=0.0,
        yaw_rate_frd_radps=0.0,
    ),
    position=PositionFix(
        sequence=0,
        time_s=0.0,
        north_m=0.0,
        east_m=0.0,
        down_m=0.0,
        velocity_north_mps=0.0,
        velocity_east_mps=0.0,
        velocity_down_mps=0.0,
    ),
    airspeed_mps=0.0,
    flying=False,
)


# --- level flight: the law of FBWA ---------------------------------------------------------


class LevelFlight:
    """Pitch and bank held, turning damped.

    elevator = 2 (θ_sp − θ) + 2 ∫(θ_sp − θ) dt − 0.19 q       [rad, rad s, rad/s]
    aileron  = 1.2 (φ_sp − φ) − 0.06 p
    rudder   = rudder stick − 0.2 r
    """

    def __init__(self, trim_pitch_rad: float) -> None:
        self.trim_pitch_rad = trim_pitch_rad
        self._integral = 0.0

    def enter(self, elevator: float) -> None:
        """Begin without a jump of the elevator."""
        self._integral = min(max(elevator, -0.8), 0.8)

    def step(self, sticks: SurfaceCommand, attitude: AttitudeSample, dt_s: float) -> SurfaceCommand:
        """Deflections for sticks (pitch, roll, yaw; -1 … 1) and an attitude."""
        roll, pitch, _ = euler_from_quaternion(*attitude[2:6])
        p, q, r = attitude[6:9]
        pitch_error = self.trim_pitch_rad + PITCH_STICK_RAD * sticks.elevator - pitch
        self._integral = min(max(self._integral + 2.0 * pitch_error * dt_s, -0.8), 0.8)
        return SurfaceCommand(
            _limited(2.0 * pitch_error + self._integral - 0.19 * q),
            _limited(1.2 * (_BANK_STICK_RAD * sticks.aileron - roll) - 0.06 * p),
            _limited(sticks.rudder - 0.2 * r),
        )


def _limited(value: float) -> float:
    return min(max(value, -1.0), 1.0) if isfinite(value) else 0.0


# --- the autopilot's own parameters --------------------------------------------------------


class FirmwareParameters:
    """A few ArduPlane parameters, those that have an effect here; each (value, low, high).

    They are as the module wants them of an ArduPlane: RC_OVERRIDE_TIME is 0.5 s where the
    firmware's default is 3 s, which would lose the aircraft, and is engaged with only by force.
    """

    def __init__(self, surfaces: Surfaces, values: dict[str, float] | None = None) -> None:
        self._table: dict[str, tuple[float, float, float]] = {
            "SYSID_THISMAV": (1.0, 1.0, 255.0),
            "SYSID_MYGCS": (255.0, 1.0, 255.0),
            "SCHED_LOOP_RATE": (400.0, 50.0, 400.0),
            "RC_OVERRIDE_TIME": (0.5, OVERRIDES_NEVER_EXPIRE, 120.0),
            "VISO_TYPE": (0.0, 0.0, 1.0),
            "VISO_DELAY_MS": (10.0, 0.0, 250.0),
        }
        # The pulse widths of the airframe file are those of the override, so the firmware's
        # calibration of stick and servo are the same and a channel passes through unchanged.
        for surface in sorted(ordered(surfaces), key=lambda s: s.channel):
            for prefix in ("RC", "SERVO"):
                name = f"{prefix}{surface.channel}"
                self._table[f"{name}_MIN"] = (float(surface.pwm_min), 800.0, 2200.0)
                self._table[f"{name}_TRIM"] = (float(surface.pwm_trim), 800.0, 2200.0)
                self._table[f"{name}_MAX"] = (float(surface.pwm_max), 800.0, 2200.0)
                self._table[f"{name}_REVERSED"] = (0.0, 0.0, 1.0)
        self.names = tuple(self._table)
        for name, value in (values or {}).items():
            if not self.set(name, value):
                raise ValueError(
                    f"autopilot parameter {name} = {value}: no such parameter or out of range;"
                    f" there are {', '.join(self.names)}"
                )

    def __getitem__(self, name: str) -> float:
        return self._table[name][0]

    def __contains__(self, name: str) -> bool:
        return name in self._table

    def set(self, name: str, value: float) -> bool:
        """Set a value; False where the name is unknown or the value cannot be."""
        if name not in self._table or not isfinite(value):
            return False
        before, low, high = self._table[name]
        if not low <= value <= high:
            return False
        self._table[name] = (value, low, high)
        prefix = name.rpartition("_")[0]
        if f"{prefix}_TRIM" in self._table and not self._ordered(prefix):
            self._table[name] = (before, low, high)
            return False
        return True

    def wire_type(self, name: str) -> int:
        """MAV_PARAM_TYPE of a parameter; the value is sent as a float all the same."""
        if name == "RC_OVERRIDE_TIME":
            return int(mavlink.MAV_PARAM_TYPE_REAL32)
        if name == "VISO_TYPE" or name.endswith("_REVERSED"):
            return int(mavlink.MAV_PARAM_TYPE_INT8)
        return int(mavlink.MAV_PARAM_TYPE_INT16)

    def calibration(self, prefix: str) -> tuple[float, float, float, bool]:
        """Minimum, trim, maximum and reversal of "RC1", "SERVO1", …"""
        return (
            self[f"{prefix}_MIN"],
            self[f"{prefix}_TRIM"],
            self[f"{prefix}_MAX"],
            self[f"{prefix}_REVERSED"] != 0.0,
        )

    def _ordered(self, prefix: str) -> bool:
        low, trim, high, _ = self.calibration(prefix)
        return low < trim < high


# --- streams -------------------------------------------------------------------------------

# Hz on a link to the ground until somebody asks; a companion asks for what it wants.
GROUND_RATES_HZ: Final = {
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 4.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 4.0,
    mavlink.MAVLINK_MSG_ID_VFR_HUD: 4.0,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: 2.0,
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS: 2.0,
}

# REQUEST_DATA_STREAM, which older ground stations send: the messages of each group.
_STREAM_GROUPS: Final = {
    mavlink.MAV_DATA_STREAM_EXTENDED_STATUS: (mavlink.MAVLINK_MSG_ID_SYS_STATUS,),
    mavlink.MAV_DATA_STREAM_RC_CHANNELS: (
        mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,
        mavlink.MAVLINK_MSG_ID_RC_CHANNELS,
    ),
    mavlink.MAV_DATA_STREAM_RAW_SENSORS: (mavlink.MAVLINK_MSG_ID_RAW_IMU,),
    mavlink.MAV_DATA_STREAM_POSITION: (
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    ),
    mavlink.MAV_DATA_STREAM_EXTRA1: (mavlink.MAVLINK_MSG_ID_ATTITUDE,),
    mavlink.MAV_DATA_STREAM_EXTRA2: (mavlink.MAVLINK_MSG_ID_VFR_HUD,),
    mavlink.MAV_DATA_STREAM_EXTRA3: (mavlink.MAVLINK_MSG_ID_SYSTEM_TIME,),
}

# Messages that carry a measurement go out when there is a new one, once each.
_ATTITUDE_STREAMS: Final = frozenset(
    {mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, mavlink.MAVLINK_MSG_ID_ATTITUDE}
)
_POSITION_STREAMS: Final = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_ODOMETRY,
    }
)
_IMU_STREAMS: Final = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_RAW_IMU,
        mavlink.MAVLINK_MSG_ID_SCALED_IMU,
        mavlink.MAVLINK_MSG_ID_HIGHRES_IMU,
    }
)


@dataclass
class _Stream:
    interval_steps: int
    due_at: int  # the step from which it may go out
    sent_sequence: int = 0  # of the sample that went out last


@dataclass
class _Link:
    codec: mavlink.MAVLink
    ground: bool
    streams: dict[int, _Stream] = field(default_factory=dict)
    parameters_to_send: deque[int] = field(default_factory=deque)
    outbox: list[bytes] = field(default_factory=list)
    timesync_answer_ns: int = 0  # ts1 of the latest answer to our TIMESYNC
    heartbeats: int = 0  # heard on it, of anybody


@dataclass
class Counts:
    """What happened so far."""

    overrides_accepted: int = 0
    overrides_refused: int = 0
    override_timeouts: int = 0
    frames_received: int = 0
    bytes_refused: int = 0
    streams_denied: int = 0


class Pixhawk:
    """The autopilot.  Time is the number of steps taken, of 1/step_hz each.

    parameters        values of its own parameters that differ from their defaults
    trim_pitch_rad    the pitch that FBWA holds with centred sticks
    allow_odometry    stream ODOMETRY, and HIGHRES_IMU, as PX4 does; ArduPlane denies the one
    home              where local NED has its origin; None: it has never had a fix
    uptime_s          how long it has been running when the simulation begins
    """

    def __init__(
        self,
        surfaces: Surfaces,
        step_hz: int,
        *,
        parameters: dict[str, float] | None = None,
        trim_pitch_rad: float = 0.0,
        allow_odometry: bool = False,
        uptime_s: float = 0.0,
        home: HomePosition | None = None,
    ) -> None:
        self.step_hz = step_hz
        self.steps = 0
        self.mode = MANUAL
        self.armed = True
        self.running = True
        self.counts = Counts()
        self.parameters = FirmwareParameters(surfaces, parameters)
        self.pilot_sticks: SurfaceCommand | None = None  # None: no receiver
        self.surfaces = NEUTRAL  # what the servos are told
        self.router = Router()
        self.overrides = Overrides()
        self._surfaces = surfaces
        self._uptime_s = uptime_s
        self._level = LevelFlight(trim_pitch_rad)
        self._links: dict[LinkId, _Link] = {}
        self._sensed = GROUNDED  # as its streams tell it
        self._own_attitude = GROUNDED.attitude  # as its own control has it
        self._attitudes: deque[AttitudeSample] = deque(maxlen=128)
        self._channel_pwm = [0] * CHANNELS
        self._servo_pwm = [0] * CHANNELS
        self._events: list[str] = []
        self._told: set[str] = set()
        self._decoder = mavlink.MAVLink(None)
        self.external = ExternalPose()
        self._home = home
        self._px4 = allow_odometry
        self._shown = ShownAirspeed()
        self._pitot_told = 0  # sequence of the sample that went out in HIGHRES_IMU
        self._streamable = self._stream_table(allow_odometry)
        self._update_outputs()

    # --- links -----------------------------------------------------------------------------

    def add_link(self, link: LinkId, *, ground: bool) -> None:
        """A link to a ground station (streams slowly by itself) or to a companion (silent)."""
        codec = mavlink.MAVLink(None, int(self.parameters["SYSID_THISMAV"]), COMPONENT)
        self._links[link] = _Link(codec, ground)
        self.router.add(link)
        self._stream_by_default(self._links[link])

    def _stream_by_default(self, link: _Link) -> None:
        if link.ground:
            for message_id, rate_hz in GROUND_RATES_HZ.items():
                self._set_interval(link, message_id, 1.0 / rate_hz)

    def remove_link(self, link: LinkId) -> None:
        """A link that is gone."""
        self._links.pop(link, None)
        self.router.forget(link)

    def set_pace(self, link: LinkId) -> None:
        """Lockstep: from the next step on a link gets the attitude of every step, unasked."""
        if link in self._links:
            streams = self._links[link].streams
            streams[mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION] = _Stream(1, self.steps + 1)

    def receive(self, link: LinkId, data: bytes) -> None:
        """Take one datagram of a link; whatever it holds, nothing is raised."""
        if link not in self._links:
            return
        if not self.running:
            self._take_barrier(link, data)
            return
        frames, lost = split_frames(self._decoder, data)
        self.counts.bytes_refused += lost
        for frame in frames:
            self._take_frame(link, frame)

    def heard(self, system: int, component: int) -> tuple[LinkId, ...]:
        """The links on which an identity was heard."""
        return self.router.heard(system, component)

    def send(self, link: LinkId, message: Any) -> None:
        """Queue a message of this autopilot on a link."""
        target = self._links.get(link)
        if target is not None:
            self._post(target, message)

    def broadcast(self, message: Any, *, ground_only: bool = False) -> None:
        """Queue a message of this autopilot on every link."""
        for link in self._links.values():
            if link.ground or not ground_only:
                self._post(link, message)

    def timesync_answer_ns(self, link: LinkId) -> int:
        """The `ts1` that came back last on a link; 0: none."""
        target = self._links.get(link)
        return target.timesync_answer_ns if target is not None else 0

    def heartbeats(self, link: LinkId) -> int:
        """How many heartbeats came on a link, of anybody."""
        source = self._links.get(link)
        return source.heartbeats if source is not None else 0

    def take_datagrams(self, links: Container[LinkId] | None = None) -> list[tuple[LinkId, bytes]]:
        """What is queued on some links (or all), as datagrams of whole frames; the queues are
        emptied."""
        datagrams: list[tuple[LinkId, bytes]] = []
        for number, link in self._links.items():
            if not link.outbox or (links is not None and number not in links):
                continue
            pending = b""
            for raw in link.outbox:
                if pending and len(pending) + len(raw) > _DATAGRAM_BYTES:
                    datagrams.append((number, pending))
                    pending = b""
                pending += raw
            datagrams.append((number, pending))
            link.outbox.clear()
        return datagrams

    def take_events(self) -> list[str]:
        """What an onlooker should be told, in order; each only once."""
        events, self._events = self._events, []
        return events

    # --- time ------------------------------------------------------------------------------

    @property
    def time_s(self) -> float:
        """Time since the simulation began."""
        return self.steps / self.step_hz

    @property
    def boot_ms(self) -> int:
        """Now, as the messages' `time_boot_ms`."""
        return self._boot_ms(self.time_s)

    def step(self, sensed: Sensed, told: Sensed | None = None) -> None:
        """Advance by one step: failsafe, mode, servos, streams.

        told: what the streams say, where that is not what its own control has.
        """
        self.steps += 1
        if not self.running:
            return
        self._own_attitude = sensed.attitude
        sensed = told or sensed
        # Before the first sample there are numbers to show, but none that is streamed.
        if sensed.attitude.sequence == 0:
            sensed = sensed._replace(attitude=GROUNDED.attitude)
        if sensed.position.sequence == 0:
            sensed = sensed._replace(position=GROUNDED.position)
        if sensed.attitude.sequence != self._sensed.attitude.sequence:
            self._attitudes.append(sensed.attitude)
        if self.external.is_in_use():
            delay_s = 1e-3 * self.parameters["VISO_DELAY_MS"]
            aided = self.external.fix(sensed.position, self._sensed.position, self.time_s, delay_s)
            sensed = sensed._replace(position=aided)
        self._sensed = sensed
        self._shown.step(self.time_s, sensed.pitot, self._height_m)
        self._expire_overrides()
        self._update_outputs()
        if self.steps % self.step_hz == 1 % self.step_hz:
            self.broadcast(self._heartbeat())
        for link in self._links.values():
            self._step_streams(link)
            self._step_parameter_list(link)

    def announce(self) -> None:
        """Queue a heartbeat on every link, outside the 1 Hz of flight."""
        self.broadcast(self._heartbeat())

    def set_mode(self, mode: int, by: str) -> bool:
        """Change the mode; False where there is none of this number."""
        if mode not in MODE_NAMES:
            return False
        if mode != self.mode:
            self._level.enter(self.surfaces.elevator)
            self.mode = mode
            self._event(f"mode {MODE_NAMES[mode]} ({by})")
            self.broadcast(self._heartbeat())
        return True

    def restart(self) -> None:
        """Back to what a pilot sets before a launch: MANUAL, armed, nothing overridden."""
        self.overrides.clear()
        self.armed = True
        self.set_mode(MANUAL, "launch")

    def shut_down(self) -> None:
        """Nothing is heard, said or moved until `boot`; the servos stay."""
        self.running = False
        self.overrides.clear()
        self.router = Router()
        for number, link in self._links.items():
            self.router.add(number)
            link.streams.clear()
            link.parameters_to_send.clear()
            link.outbox.clear()

    def pass_over(self, seconds: float) -> None:
        """The clock runs on for so long, without a step."""
        self._uptime_s += seconds

    def boot(self) -> None:
        """Start anew, without memory: the clock from zero, the mode of the pilot's switch."""
        self.running = True
        self._uptime_s = -self.time_s
        self._attitudes.clear()
        for link in self._links.values():
            self._stream_by_default(link)
        self.set_mode(MANUAL, "after a restart")
        self.announce()

    def reads_override(self, surface_channels: bool = True) -> bool:
        """Whether a surface's channel (or any channel) is overridden now."""
        if not surface_channels:
            return self.overrides.any
        return any(self.overrides.on(s.channel) is not None for s in ordered(self._surfaces))

    def _expire_overrides(self) -> None:
        allowed_s = self.parameters["RC_OVERRIDE_TIME"]
        if allowed_s == OVERRIDES_NEVER_EXPIRE:
            return
        expired = self.overrides.expire(self.steps, allowed_s * self.step_hz)
        if not expired:
            return
        self.counts.override_timeouts += 1
        channels = ", ".join(str(channel) for channel in expired)
        self._event(f"overrides timed out after {allowed_s:g} s (channels {channels})")
        no_receiver = self.pilot_sticks is None
        if no_receiver and self._sensed.flying and not self.reads_override():
            self.set_mode(FBWA, "own mode after the time-out")

    def _update_outputs(self) -> None:
        """Channels from receiver and overrides, sticks, the mode's law, servos."""
        pilot = self.pilot_sticks or NEUTRAL
        sticks = []
        for surface, stick in zip(ordered(self._surfaces), pilot, strict=True):
            channel = surface.channel
            override = self.overrides.on(channel)
            pwm = pwm_from_deflection(surface, stick) if override is None else override
            self._channel_pwm[channel - 1] = pwm
            low, trim, high, reverse = self.parameters.calibration(f"RC{channel}")
            sticks.append(stick_from_pwm(pwm, low, trim, high, reverse))
        if self.mode == FBWA and self._own_attitude.sequence > 0:
            sticks = self._level_flight(sticks)
        deflections = []
        for surface, stick in zip(ordered(self._surfaces), sticks, strict=True):
            low, trim, high, reverse = self.parameters.calibration(f"SERVO{surface.channel}")
            pwm = pwm_from_stick(stick, low, trim, high, reverse)
            self._servo_pwm[surface.channel - 1] = pwm
            deflections.append(deflection_from_pwm(surface, pwm))
        self.surfaces = SurfaceCommand(*deflections)

    def _level_flight(self, sticks: list[float]) -> list[float]:
        # A stick's sign on the wire follows the airframe file; the law's is ours.
        signs = [-1.0 if s.reversed else 1.0 for s in ordered(self._surfaces)]
        asked = SurfaceCommand(*(sign * stick for sign, stick in zip(signs, sticks, strict=True)))
        law = self._level.step(asked, self._own_attitude, 1.0 / self.step_hz)
        return [sign * deflection for sign, deflection in zip(signs, law, strict=True)]

    # --- what arrives ----------------------------------------------------------------------

    def _take_frame(self, number: LinkId, frame: Frame) -> None:
        own_system = int(self.parameters["SYSID_THISMAV"])
        if (frame.system, frame.component) == (own_system, COMPONENT):
            self._event_once(
                f"frames that claim to be from ({own_system}, {COMPONENT}), this autopilot,"
                f" came on link {number}: ignored"
            )
            return
        self.counts.frames_received += 1
        if frame.message.get_msgId() == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            self._links[number].heartbeats += 1
        onward, local = self.router.route(number, frame, own_system, COMPONENT)
        for other in onward:
            self._links[other].outbox.append(frame.raw)
        if local:
            handler = _HANDLERS.get(frame.message.get_msgId())
            if handler is not None:
                handler(self, self._links[number], frame)

    def _take_barrier(self, number: LinkId, data: bytes) -> None:
        """While it does not run, lockstep goes on all the same."""
        for frame in split_frames(self._decoder, data)[0]:
            if frame.message.get_msgId() == mavlink.MAVLINK_MSG_ID_TIMESYNC and frame.message.tc1:
                self._take_timesync(self._links[number], frame)

    def _take_override(self, _link: _Link, frame: Frame) -> None:
        master = int(self.parameters["SYSID_MYGCS"])
        if frame.system != master:
            self.counts.overrides_refused += 1
            self._event_once(
                f"overrides from system {frame.system} are ignored: SYSID_MYGCS is {master}"
            )
            return
        message = frame.message
        self.overrides.take(
            [getattr(message, f"chan{i}_raw") for i in range(1, CHANNELS + 1)], self.steps
        )
        self.counts.overrides_accepted += 1

    def _take_pose(self, _link: _Link, frame: Frame) -> None:
        if self.parameters["VISO_TYPE"] == 1.0:
            self.external.take(frame.message, self.time_s)

    def _take_parameter_set(self, link: _Link, frame: Frame) -> None:
        name = str(frame.message.param_id)
        if name not in self.parameters:
            return  # as the firmware: silence
        if self.parameters.set(name, float(frame.message.param_value)):
            for each in self._links.values():
                each.codec.srcSystem = int(self.parameters["SYSID_THISMAV"])
                self._post(each, self._parameter_value(name))
        else:
            self._post(link, self._parameter_value(name))  # unchanged

    def _take_parameter_read(self, link: _Link, frame: Frame) -> None:
        names = self.parameters.names
        index = int(frame.message.param_index)
        name = str(frame.message.param_id)
        if 0 <= index < len(names):
            self._post(link, self._parameter_value(names[index], index))
        elif name in self.parameters:
            self._post(link, self._parameter_value(name))

    def _take_parameter_list(self, link: _Link, _frame: Frame) -> None:
        link.parameters_to_send = deque(range(len(self.parameters.names)))

    def _take_timesync(self, link: _Link, frame: Frame) -> None:
        if frame.message.tc1 == 0:
            now_ns = round((self._uptime_s + self.time_s) * 1e9)
            self._post(link, mavlink.MAVLink_timesync_message(now_ns, frame.message.ts1))
        else:
            link.timesync_answer_ns = int(frame.message.ts1)

    def _take_set_mode(self, _link: _Link, frame: Frame) -> None:
        if frame.message.base_mode & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
            self.set_mode(int(frame.message.custom_mode), f"asked by system {frame.system}")

    def _take_data_stream_request(self, link: _Link, frame: Frame) -> None:
        message = frame.message
        group = int(message.req_stream_id)
        groups = (
            _STREAM_GROUPS.values()
            if group == mavlink.MAV_DATA_STREAM_ALL
            else (_STREAM_GROUPS.get(group, ()),)
        )
        rate_hz = float(message.req_message_rate)
        interval_s = 1.0 / rate_hz if message.start_stop and rate_hz > 0.0 else -1.0
        for members in groups:
            for message_id in members:
                self._set_interval(link, message_id, interval_s)

    def _take_mission_request(self, link: _Link, frame: Frame) -> None:
        mission_type = int(getattr(frame.message, "mission_type", 0))
        self._post(
            link,
            mavlink.MAVLink_mission_count_message(frame.system, frame.component, 0, mission_type),
        )

    def _take_command(self, link: _Link, frame: Frame) -> None:
        message = frame.message
        command = int(message.command)
        result = self._execute(link, frame, command)
        ack = mavlink.MAVLink_command_ack_message(
            command, result, 0, 0, frame.system, frame.component
        )
        self._post(link, ack)

    def _execute(self, link: _Link, frame: Frame, command: int) -> int:
        one, two = float(frame.message.param1), float(frame.message.param2)
        if not (isfinite(one) and isfinite(two)):
            # NaN means "not given"; none of these commands can do without both.
            return int(mavlink.MAV_RESULT_DENIED)
        if command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            return self._set_interval(link, int(one), two * 1e-6 if two > 0.0 else two)
        if command == mavlink.MAV_CMD_GET_MESSAGE_INTERVAL:
            return self._report_interval(link, int(one))
        if command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            return self._send_once(link, int(one), int(two))
        if command == mavlink.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES:
            return self._send_once(link, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, 0)
        if command == mavlink.MAV_CMD_DO_SET_MODE:
            if not int(one) & mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
                return int(mavlink.MAV_RESULT_DENIED)
            accepted = self.set_mode(int(two), f"asked by system {frame.system}")
            return int(mavlink.MAV_RESULT_ACCEPTED if accepted else mavlink.MAV_RESULT_FAILED)
        if command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM:
            return self._arm(one != 0.0, two == _FORCE_DISARM)
        return int(mavlink.MAV_RESULT_UNSUPPORTED)

    def _arm(self, arm: bool, force: bool) -> int:
        if not arm and self._sensed.flying and not force:
            return int(mavlink.MAV_RESULT_FAILED)
        if arm != self.armed:
            self.armed = arm
            self.broadcast(self._heartbeat())
        return int(mavlink.MAV_RESULT_ACCEPTED)

    # --- what goes out ---------------------------------------------------------------------

    def _post(self, link: _Link, message: Any) -> None:
        link.outbox.append(message.pack(link.codec))
        link.codec.seq = (link.codec.seq + 1) % 256

    def _event(self, text: str) -> None:
        self._events.append(text)

    def _event_once(self, text: str) -> None:
        if text not in self._told and len(self._told) < 100:
            self._told.add(text)
            self._event(text)

    def _set_interval(self, link: _Link, message_id: int, interval_s: float) -> int:
        """Stream a message every so many whole steps; 0: its default rate, negative: never."""
        if message_id not in self._streamable:
            self.counts.streams_denied += 1
            return int(mavlink.MAV_RESULT_DENIED)
        if interval_s == 0.0:
            rate_hz = GROUND_RATES_HZ.get(message_id, 0.0) if link.ground else 0.0
            interval_s = 1.0 / rate_hz if rate_hz else -1.0
        if interval_s < 0.0:
            link.streams.pop(message_id, None)
            return int(mavlink.MAV_RESULT_ACCEPTED)
        if interval_s < (1.0 - 1e-6) / (_RATE_FRACTION * self.parameters["SCHED_LOOP_RATE"]):
            self.counts.streams_denied += 1
            return int(mavlink.MAV_RESULT_DENIED)
        interval_steps = max(1, round(min(interval_s, 3600.0) * self.step_hz))
        link.streams[message_id] = _Stream(interval_steps, self.steps + 1)
        # The attitude is what a companion waits for: whatever else is due goes out before it.
        last = link.streams.pop(mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, None)
        if last is not None:
            link.streams[mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION] = last
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _report_interval(self, link: _Link, message_id: int) -> int:
        if not 0 <= message_id <= 0xFFFF:
            return int(mavlink.MAV_RESULT_DENIED)
        stream = link.streams.get(message_id)
        if stream is not None:
            interval_us = round(1e6 * stream.interval_steps / self.step_hz)
        elif message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            interval_us = 1_000_000
        else:
            interval_us = -1 if message_id in self._streamable else 0  # 0: not available
        self._post(link, mavlink.MAVLink_message_interval_message(message_id, interval_us))
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _send_once(self, link: _Link, message_id: int, argument: int) -> int:
        if message_id == mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
            return self._report_interval(link, argument)
        build = self._streamable.get(message_id) or {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self._version,
        }.get(message_id)
        if build is None or self._sequence(message_id) == 0:
            return int(mavlink.MAV_RESULT_FAILED)
        self._post(link, build())
        return int(mavlink.MAV_RESULT_ACCEPTED)

    def _step_streams(self, link: _Link) -> None:
        """Send what is due.  A sample goes out once: where none is new, the stream waits for
        the next one, so that a stream at the sensor's own rate adds no delay of its own."""
        step = self.steps
        for message_id, stream in link.streams.items():
            if step < stream.due_at:
                continue
            sequence = self._sequence(message_id)
            if sequence == stream.sent_sequence:
                continue
            stream.sent_sequence = sequence
            self._post(link, self._streamable[message_id]())
            # The next is due on the grid of the first, however late this one was.
            stream.due_at += (1 + (step - stream.due_at) // stream.interval_steps) * (
                stream.interval_steps
            )

    def _sequence(self, message_id: int) -> int:
        """Which sample a message would carry now; 0: none has come yet."""
        if message_id in _ATTITUDE_STREAMS:
            return self._sensed.attitude.sequence
        if message_id in _POSITION_STREAMS:
            return self._sensed.position.sequence
        if message_id in _IMU_STREAMS:
            return self._sensed.imu.sequence
        return self.steps + 1

    def _step_parameter_list(self, link: _Link) -> None:
        for _ in range(min(_PARAMETERS_PER_STEP, len(link.parameters_to_send))):
            index = link.parameters_to_send.popleft()
            self._post(link, self._parameter_value(self.parameters.names[index], index))

    def _parameter_value(self, name: str, index: int = _NO_INDEX) -> Any:
        """`index`: in a list, or where it was asked for by index."""
        return mavlink.MAVLink_param_value_message(
            name.encode("ascii"),
            self.parameters[name],
            self.parameters.wire_type(name),
            len(self.parameters.names),
            index,
        )

    def _heartbeat(self) -> Any:
        base_mode = (
            mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            | mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
            | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        )
        if self.armed:
            base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        return mavlink.MAVLink_heartbeat_message(
            mavlink.MAV_TYPE_FIXED_WING,
            mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
            base_mode,
            self.mode,
            mavlink.MAV_STATE_ACTIVE if self.armed else mavlink.MAV_STATE_STANDBY,
            3,
        )

    def _version(self) -> Any:
        return mavlink.MAVLink_autopilot_version_message(
            mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
            | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
            | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT,
            (4 << 24) | (6 << 16) | (3 << 8) | 255,  # the release whose behaviour this follows
            0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 0,
        )  # fmt: skip

    def _boot_ms(self, time_s: float) -> int:
        return round((self._uptime_s + time_s) * 1e3) & 0xFFFFFFFF

    def _stream_table(self, allow_odometry: bool) -> dict[int, Callable[[], Any]]:
        table: dict[int, Callable[[], Any]] = {
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: self._system_time,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: self._attitude_quaternion,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._local_position,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._global_position,
            mavlink.MAVLINK_MSG_ID_RAW_IMU: self._raw_imu,
            mavlink.MAVLINK_MSG_ID_SCALED_IMU: self._scaled_imu,
            mavlink.MAVLINK_MSG_ID_HIGHRES_IMU: self._highres_imu,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: self._vfr_hud,
            mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: self._servo_output,
            mavlink.MAVLINK_MSG_ID_RC_CHANNELS: self._rc_channels,
        }
        if allow_odometry:
            table[mavlink.MAVLINK_MSG_ID_ODOMETRY] = self._odometry
        return table

    def _sys_status(self) -> Any:
        # 11.4 V, no current measured, charge unknown: enough for a ground station's display.
        has = 0
        if self._sensed.imu.sequence:
            has |= mavlink.MAV_SYS_STATUS_SENSOR_3D_GYRO | mavlink.MAV_SYS_STATUS_SENSOR_3D_ACCEL
        if self._sensed.pitot.sequence:
            has |= mavlink.MAV_SYS_STATUS_SENSOR_DIFFERENTIAL_PRESSURE
        return mavlink.MAVLink_sys_status_message(
            has, has, has, 250, 11400, -1, -1, 0, 0, 0, 0, 0, 0
        )

    def _system_time(self) -> Any:
        return mavlink.MAVLink_system_time_message(0, self._boot_ms(self.time_s))

    def _attitude_quaternion(self) -> Any:
        sample = self._sensed.attitude
        return mavlink.MAVLink_attitude_quaternion_message(
            self._boot_ms(sample.time_s), *sample[2:9]
        )

    def _attitude(self) -> Any:
        sample = self._sensed.attitude
        return mavlink.MAVLink_attitude_message(
            self._boot_ms(sample.time_s), *euler_from_quaternion(*sample[2:6]), *sample[6:9]
        )

    def _local_position(self) -> Any:
        fix = self._sensed.position
        return mavlink.MAVLink_local_position_ned_message(self._boot_ms(fix.time_s), *fix[2:8])

    def _odometry(self) -> Any:
        fix = self._sensed.position
        attitude = self._attitude_at(fix.time_s)
        unknown = [nan] + [0.0] * 20
        return mavlink.MAVLink_odometry_message(
            round((self._uptime_s + fix.time_s) * 1e6),
            mavlink.MAV_FRAME_LOCAL_NED,
            mavlink.MAV_FRAME_BODY_FRD,
            *fix[2:5],
            list(attitude[2:6]),
            *_body_from_ned(attitude, *fix[5:8]),
            *attitude[6:9],
            unknown,
            unknown,
        )

    def _attitude_at(self, time_s: float) -> AttitudeSample:
        """The attitude nearest to the time of a fix: ODOMETRY carries both as one."""
        nearest, distance = self._sensed.attitude, inf
        for sample in reversed(self._attitudes):
            if abs(sample.time_s - time_s) >= distance:
                break
            nearest, distance = sample, abs(sample.time_s - time_s)
        return nearest

    def _vfr_hud(self) -> Any:
        fix, attitude = self._sensed.position, self._sensed.attitude
        _, _, yaw = euler_from_quaternion(*attitude[2:6])
        north, east, down = (0.0 if v != v else v for v in fix[5:8])
        shown = self._sensed.pitot.sequence > 0  # else an estimate, which looks just the same
        return mavlink.MAVLink_vfr_hud_message(
            self._shown.equivalent_mps if shown else self._sensed.airspeed_mps,
            (north * north + east * east) ** 0.5,
            round(degrees(yaw % (2.0 * pi))) % 360,
            0,
            self._height_m,
            -down,
        )

    @property
    def _height_m(self) -> float:
        """Above mean sea level."""
        above_m = -self._sensed.position.down_m
        return above_m if self._home is None else self._home.altitude_m + above_m

    def _boot_us(self, time_s: float) -> int:
        return round((self._uptime_s + time_s) * 1e6)

    def _global_position(self) -> Any:
        fix = self._sensed.position
        _, _, yaw = euler_from_quaternion(*self._sensed.attitude[2:6])
        return global_position(fix, self._home, self._boot_ms(fix.time_s), yaw)

    def _raw_imu(self) -> Any:
        sample = self._sensed.imu
        return raw_imu(sample, self._boot_us(sample.time_s))

    def _scaled_imu(self) -> Any:
        sample = self._sensed.imu
        return scaled_imu(sample, self._boot_ms(sample.time_s))

    def _highres_imu(self) -> Any:
        sample, pitot = self._sensed.imu, self._sensed.pitot
        new = pitot.sequence != self._pitot_told
        self._pitot_told = pitot.sequence
        time_us = self._boot_us(sample.time_s)
        return highres_imu(sample, time_us, self._height_m, pitot, px4=self._px4, new=new)

    def _servo_output(self) -> Any:
        time_us = round((self._uptime_s + self.time_s) * 1e6) & 0xFFFFFFFF
        pwm = self._servo_pwm
        return mavlink.MAVLink_servo_output_raw_message(time_us, 0, *pwm[:8], *pwm[8:16])

    def _rc_channels(self) -> Any:
        pwm = [
            self.overrides.on(i) or self._channel_pwm[i - 1] or _CHANNEL_UNUSED
            for i in range(1, CHANNELS + 1)
        ]
        return mavlink.MAVLink_rc_channels_message(self._boot_ms(self.time_s), CHANNELS, *pwm, 254)


def _body_from_ned(
    attitude: AttitudeSample, north: float, east: float, down: float
) -> tuple[float, float, float]:
    """A NED vector in FRD: the rows of the attitude's rotation matrix, transposed."""
    _, _, w, x, y, z, *_ = attitude
    return (
        (1 - 2 * (y * y + z * z)) * north + 2 * (x * y + w * z) * east + 2 * (x * z - w * y) * down,
        2 * (x * y - w * z) * north + (1 - 2 * (x * x + z * z)) * east + 2 * (y * z + w * x) * down,
        2 * (x * z + w * y) * north + 2 * (y * z - w * x) * east + (1 - 2 * (x * x + y * y)) * down,
    )


_HANDLERS: Final[dict[int, Callable[[Pixhawk, _Link, Frame], None]]] = {
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: Pixhawk._take_override,
    mavlink.MAVLINK_MSG_ID_VISION_POSITION_ESTIMATE: Pixhawk._take_pose,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: Pixhawk._take_pose,
    mavlink.MAVLINK_MSG_ID_PARAM_SET: Pixhawk._take_parameter_set,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ: Pixhawk._take_parameter_read,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: Pixhawk._take_parameter_list,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: Pixhawk._take_timesync,
    mavlink.MAVLINK_MSG_ID_SET_MODE: Pixhawk._take_set_mode,
    mavlink.MAVLINK_MSG_ID_REQUEST_DATA_STREAM: Pixhawk._take_data_stream_request,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: Pixhawk._take_mission_request,
    mavlink.MAVLINK_MSG_ID_COMMAND_LONG: Pixhawk._take_command,
    mavlink.MAVLINK_MSG_ID_COMMAND_INT: Pixhawk._take_command,
}
