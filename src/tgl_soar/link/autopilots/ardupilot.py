"""ArduPlane.

`override`: RC_CHANNELS_OVERRIDE in MANUAL.  It obeys only the sender whose system id its
SYSID_MYGCS (newer: MAV_GCS_SYSID) names, goes back to the pilot's sticks RC_OVERRIDE_TIME (3 s)
after the last frame, and at once when a channel is released.  The message has two ways to say
so: in channels 1 to 8 a 0 releases and 65535 leaves as it is, in channels 9 to 18 a 0 leaves as
it is and 65534 releases.

`attitude`: SET_ATTITUDE_TARGET in GUIDED.  Roll and pitch are held; the yaw angle of the
quaternion is no angle here but the rudder, 45 degrees being all of it.  3 s after the last one
it navigates by itself again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi
from typing import ClassVar, Final

from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.link.autopilots.base import (
    CAST,
    OVERRIDE_CHANNELS,
    CommandRoute,
    ParameterCodec,
    SensorMessages,
    SurfaceChannel,
    SurfaceChannels,
    Wanted,
    brake_pulses,
    deflections,
    firmware_mismatch,
    pulse_width,
    set_mode,
    throttle_pulse,
)
from tgl_soar.link.autopilots.requirements import SHOULD, Answers, Needs, Requirement, need
from tgl_soar.link.messages import (
    AUTOPILOT_ARDUPILOT,
    COMPONENT_AUTOPILOT,
    ID_EKF_STATUS_REPORT,
    ID_RAW_IMU,
    ID_SCALED_IMU,
    ID_VFR_HUD,
    ID_WIND,
    IGNORE_RATES,
    IGNORE_THRUST,
    MODE_FLAG_CUSTOM_MODE,
    STATE_CRITICAL,
    STATE_EMERGENCY,
    CommandLong,
    Heartbeat,
    Outbound,
    RcChannelsOverride,
    SetAttitudeTarget,
)
from tgl_soar.types import OURS, THEIRS_WITH_RUDDER, Setpoints, SurfaceCommand, isfinite

MODE_MANUAL: Final = 0
MODE_FBWA: Final = 5
MODE_GUIDED: Final = 15
MODE_AUTO: Final = 10
RCIN: Final = 50  # and the channel: SERVOn_FUNCTION of an output that repeats a channel
FUNCTIONS: Final = (19, 4, 21)  # SERVOn_FUNCTION of elevator, aileron, rudder
THROTTLE: Final = 70  # SERVOn_FUNCTION of the motor
STICKS: Final = ("RCMAP_PITCH", "RCMAP_ROLL", "RCMAP_YAW")
RUDDER_RAD: Final = pi / 4.0  # yaw of the quaternion that is full rudder
_FIRST_EIGHT: Final = 8
_LEAVE_FIRST: Final = 65535
_RELEASE_FIRST: Final = 0
_LEAVE_LATER: Final = 0
_RELEASE_LATER: Final = 65534

OVERRIDE: Final = CommandRoute(
    name="override",
    message="RC_CHANNELS_OVERRIDE",
    mode="MANUAL",
    loops=OURS,
    as_operator=True,
    mode_to_enter=None,
    mode_to_leave=MODE_MANUAL,
    silence_s=3.0,
    after_silence="the pilot's sticks move the surfaces again (RC_OVERRIDE_TIME)",
    takeover="leave MANUAL, or the switch with RCx_OPTION = 46",
    releases=True,
)
ATTITUDE: Final = CommandRoute(
    name="attitude",
    message="SET_ATTITUDE_TARGET",
    mode="GUIDED",
    loops=THEIRS_WITH_RUDDER,
    as_operator=False,
    mode_to_enter=MODE_GUIDED,
    mode_to_leave=MODE_FBWA,
    silence_s=3.0,
    after_silence="GUIDED flies to its own target: it circles where it was entered",
    takeover="leave GUIDED; with STICK_MIXING = 1 the sticks add to our setpoints",
    releases=False,
)


BY_OVERRIDE: Final = (
    need(
        "RC_OVERRIDE_TIME", "at most", 0.5,
        "the surfaces keep the last command for so long when the module falls silent",
        old=False,
    ),
    need("RC_OVERRIDE_TIME", "at least", 0.1, "0 takes no overrides, -1 lets none run out",
         old=False),
    need("RC_OPTIONS", "lacks bit", 1, "overrides would be ignored"),
)  # fmt: skip
BY_ATTITUDE: Final = (
    need("STALL_PREVENTION", "is", 0, "near the stall it would bank and pitch otherwise than asked",
         SHOULD),
    need("STICK_MIXING", "is not", 0, "the pilot's sticks would do nothing until they leave GUIDED",
         SHOULD),
)  # fmt: skip
HOVER: Final = (
    need("CRASH_DETECT", "lacks bit", 0,
         "standing over the ground may be taken for a crash, and would disarm in the air"),
    need("FS_SHORT_ACTN", "is", 2,
         "a lost radio glides in FBWA: 0 and 1 circle and 4 climbs without a propeller, and with 3"
         " the surfaces stay at their trims"),
    need("FS_LONG_ACTN", "is", 2,
         "a radio that stays lost glides on in FBWA: 0 and 1 fly home without a propeller"),
    need("THR_FAILSAFE", "is not", 2,
         "the receiver's failsafe would put the surfaces to their trims under the module"),
    need("THR_FAILSAFE", "is", 1,
         "a lost radio goes unnoticed, and MANUAL would be left with nobody at the sticks", SHOULD),
    need("BATT_FS_LOW_ACT", "is", 0, "a low battery must not fly home without a propeller"),
    need("BATT_FS_CRT_ACT", "is", 0, "a low battery must not fly home without a propeller"),
    need("FENCE_ACTION", "is", 0,
         "its own fence must not fly anywhere without a propeller: the module has one"),
    need("FS_GCS_ENABL", "is", 0, "a ground station that is lost must not end the flight", SHOULD),
)  # fmt: skip
POSES: Final = (
    need("VISO_TYPE", "is", 1, "poses come by MAVLink", old=False),
    need("EK3_SRC1_POSXY", "is", 6, "its estimator takes the poses' place"),
    need("EK3_SRC1_POSZ", "is", 6, "its estimator takes the poses' height"),
    need("EK3_SRC1_YAW", "is", 6, "its estimator takes the poses' heading"),
    need("EK3_SRC1_VELXY", "is not", 3, "there are no satellites to measure its velocity"),
    need("EK3_SRC1_VELZ", "is not", 3, "there are no satellites to measure its climb"),
    need(
        "GPS1_TYPE GPS_TYPE", "is", 14,
        "its estimator begins with a fix: a ground station gives it one by GPS_INPUT", SHOULD,
    ),
)  # fmt: skip
SATELLITES: Final = (
    need("GPS1_TYPE GPS_TYPE", "is not", 0, "its position comes from satellites"),
    need("EK3_SRC1_POSXY", "is", 3, "its position comes from satellites"),
)


LANDS: Final = (
    need("RTL_AUTOLAND", "is not", 0,
         "with a landing in its mission it refuses to arm; 2 flies straight to that landing"),
)  # fmt: skip


class ArduPilot:
    """ArduPlane 4.x."""

    name: ClassVar[str] = "ardupilot"
    routes: ClassVar[Mapping[str, CommandRoute]] = {
        route.name: route for route in (OVERRIDE, ATTITUDE)
    }
    # SYSID_MYGCS up to 4.6; then a range, of which the upper end 0 stands for the lower.
    asked: ClassVar[tuple[str, ...]] = ("SYSID_MYGCS", "MAV_GCS_SYSID", "MAV_GCS_SYSID_HI")
    codec: ClassVar[ParameterCodec] = CAST
    # RAW_IMU is stamped in microseconds, SCALED_IMU of the same numbers in milliseconds.  The
    # differential pressure of its HIGHRES_IMU is the barometer's, less that at the ground.
    # The airspeed is read ten times a second; twice as often, so that it is not old as well.
    sensors: ClassVar[SensorMessages] = SensorMessages(
        imu=(ID_RAW_IMU, ID_SCALED_IMU),
        airspeed=Wanted(ID_VFR_HUD, "VFR_HUD", 20.0),
        pitot_in_imu=False,
        estimator=Wanted(ID_EKF_STATUS_REPORT, "EKF_STATUS_REPORT", 5.0),
        wind=Wanted(ID_WIND, "WIND", 1.0),
    )

    def __init__(
        self, channels: SurfaceChannels, system_id: int, route: CommandRoute = OVERRIDE
    ) -> None:
        self.route = route
        self._channels = channels
        self._system_id = system_id
        self._untouched = [
            *(_LEAVE_FIRST,) * _FIRST_EIGHT,
            *(_LEAVE_LATER,) * (OVERRIDE_CHANNELS - _FIRST_EIGHT),
        ]
        self._release = (self._released(),) if route.releases else ()

    def refusal(self, parameters: Answers, system: int) -> str:
        """The firmware ignores overrides of other senders without a word."""
        old, low_name, high_name = self.asked
        name = old if old in parameters else low_name
        if name not in parameters or not self.route.as_operator:
            return ""
        low = parameters[name]
        high = max(low, parameters.get(high_name, low))
        if low <= system <= high:
            return ""
        return (
            f"the autopilot ignores our surfaces: its {name} is {low:g}, our override_system_id"
            f" {system}; make them the same"
        )

    def mismatch(self, heartbeat: Heartbeat) -> str:
        """Whether it is an ArduPlane."""
        return firmware_mismatch(heartbeat, AUTOPILOT_ARDUPILOT, "an ArduPilot")

    def commands(
        self, surfaces: SurfaceCommand, setpoints: Setpoints, throttle: float = 0.0
    ) -> tuple[Outbound, ...]:
        """One frame: our channels, the others left to the pilot; or the attitude.

        The throttle is the pilot's where we ask for none: a receiver that says by it that it has
        lost its signal is received again (THR_FAILSAFE).
        """
        if self.route is ATTITUDE:
            return (self._attitude(surfaces.rudder, setpoints),)
        elevator, aileron, rudder = self._channels[:3]
        values = self._untouched.copy()
        values[elevator.channel - 1] = pulse_width(elevator, surfaces.elevator)
        values[aileron.channel - 1] = pulse_width(aileron, surfaces.aileron)
        values[rudder.channel - 1] = pulse_width(rudder, surfaces.rudder)
        for channel, pulse in brake_pulses(self._channels, surfaces):
            values[channel - 1] = pulse
        if (motor := self._channels.throttle) is not None:
            released = _release_of(motor.channel)
            pulse = throttle_pulse(motor, throttle) if throttle > 0.0 else released
            values[motor.channel - 1] = pulse
        return (RcChannelsOverride(self._system_id, COMPONENT_AUTOPILOT, tuple(values)),)

    def release(self) -> tuple[Outbound, ...]:
        """One frame that gives our channels back and touches no other."""
        return self._release

    def ask_for_mode(self, custom_mode: int) -> CommandLong:
        """Its modes are numbered as its heartbeat has them."""
        return set_mode(self._system_id, float(custom_mode))

    def obeys(self, heartbeat: Heartbeat) -> bool:
        """Only in MANUAL do the sticks, and so the overrides, move the surfaces directly; only
        in GUIDED are attitudes taken."""
        is_custom = heartbeat.base_mode & MODE_FLAG_CUSTOM_MODE != 0
        mode = MODE_GUIDED if self.route is ATTITUDE else MODE_MANUAL
        return is_custom and heartbeat.custom_mode == mode

    def deflections(self, servos: Sequence[int]) -> SurfaceCommand:
        """The outputs by the table of the overrides: its RCn and SERVOn must be alike."""
        return deflections(self._channels, servos)

    def failsafe(self, heartbeat: Heartbeat) -> bool:
        """CRITICAL: any failsafe has been triggered; EMERGENCY: it takes itself for crashed."""
        return heartbeat.system_status in (STATE_CRITICAL, STATE_EMERGENCY)

    def way_to_rate(self, rate_hz: float) -> str:
        """The firmware refuses more than 0.8 of its main loop's rate."""
        return f"set SCHED_LOOP_RATE to {rate_hz / 0.8:.0f} or more"

    def requirements(self, needs: Needs) -> tuple[Requirement, ...]:
        """Those of the route, of streams and surfaces, of a hovering aircraft, of the poses."""
        rows = (self._loop(needs), *self._calibration(), *self._functions(), *self._throttle())
        rows += BY_ATTITUDE if self.route is ATTITUDE else BY_OVERRIDE
        return (
            rows
            + HOVER
            + (LANDS if needs.lands else ())
            + (POSES if needs.external_pose else ())
            + (SATELLITES if needs.gps else ())
        )

    def _loop(self, needs: Needs) -> Requirement:
        return need(
            "SCHED_LOOP_RATE",
            "at least",
            max(250.0, needs.loop_rate_hz / 0.8),
            f"it sends a stream at 0.8 of this at most, and ours run at {needs.loop_rate_hz:g}"
            " Hz; its servos are late by one loop",
            SHOULD,
            old=False,
        )

    def _calibration(self) -> tuple[Requirement, ...]:
        """A pulse passes from stick to servo unchanged, and its own modes know the direction."""
        rows: list[Requirement] = []
        prefixes = ("SERVO",) if self.route is ATTITUDE else ("RC", "SERVO")
        names = self._channels._fields
        for what, surface in zip(names, self._channels.driven(), strict=False):
            why = f"{what} as in the airframe file, so that a pulse passes unchanged"
            for prefix in prefixes:
                name = f"{prefix}{surface.channel}"
                rows += (
                    need(f"{name}_MIN", "is", surface.pwm_min, why, old=False),
                    need(f"{name}_TRIM", "is", surface.pwm_trim, why, old=False),
                    need(f"{name}_MAX", "is", surface.pwm_max, why, old=False),
                    need(f"{name}_REVERSED", "is", float(surface.reversed), why, old=False),
                )
        return tuple(rows)

    def _functions(self) -> tuple[Requirement, ...]:
        """Which output follows which stick."""
        rows: list[Requirement] = []
        channels = self._channels
        columns = (channels._fields[:3], channels.driven()[:3], FUNCTIONS, STICKS)
        for what, surface, function, stick in zip(*columns, strict=True):
            channel = surface.channel
            if what == "aileron" and len(self._braking()) > 1:
                continue  # it is one half of the brake
            why = f"the {what} is on channel {channel}"
            rows.append(need(f"SERVO{channel}_FUNCTION", "is", function, why))
            if self.route is OVERRIDE:
                rows.append(need(stick, "is", channel, why))
                dead = "small deflections would be swallowed"
                rows.append(need(f"RC{channel}_DZ", "is", 0, dead, SHOULD))
        for surface in self._braking() if self.route is OVERRIDE else ():
            channel = surface.channel
            why = f"channel {channel} passes through: the module mixes aileron and brake"
            rows.append(need(f"SERVO{channel}_FUNCTION", "is", RCIN + channel, why))
        return tuple(rows)

    def _throttle(self) -> tuple[Requirement, ...]:
        """Of a propeller's motor: nothing without one."""
        motor = self._channels.throttle
        if motor is None:
            return ()
        channel, why = motor.channel, "throttle as in the airframe file"
        rows = [
            need(f"SERVO{channel}_FUNCTION", "is", THROTTLE, f"the motor is on channel {channel}"),
            need("RCMAP_THROTTLE", "is", channel, f"the throttle is on channel {channel}"),
        ]
        for prefix in ("RC", "SERVO"):
            rows += (
                need(f"{prefix}{channel}_MIN", "is", motor.pwm_min, why, old=False),
                need(f"{prefix}{channel}_MAX", "is", motor.pwm_max, why, old=False),
                need(f"{prefix}{channel}_REVERSED", "is", 0.0, why, old=False),
            )
        dead = "a small throttle would be swallowed"
        rows.append(need(f"RC{channel}_DZ", "is", 0, dead, SHOULD))
        return tuple(rows)

    def _braking(self) -> tuple[SurfaceChannel, ...]:
        """What brakes, and what is mixed with it."""
        channels = self._channels
        if channels.brake is None:
            return ()
        surface, throw = channels.brake
        return (channels.aileron, surface) if throw != 0.0 else (surface,)

    def _attitude(self, rudder: float, setpoints: Setpoints) -> SetAttitudeTarget:
        yaw = max(-1.0, min(1.0, rudder)) * RUDDER_RAD if isfinite(rudder) else 0.0
        return SetAttitudeTarget(
            time_boot_ms=0,
            target_system=self._system_id,
            target_component=COMPONENT_AUTOPILOT,
            type_mask=IGNORE_RATES | IGNORE_THRUST,
            q=quaternion_from_euler(setpoints.roll_rad, setpoints.pitch_rad, yaw),
        )

    def _released(self) -> RcChannelsOverride:
        values = self._untouched.copy()
        for channel in self._channels.numbers():
            values[channel - 1] = _release_of(channel)
        return RcChannelsOverride(self._system_id, COMPONENT_AUTOPILOT, tuple(values))


def _release_of(channel: int) -> int:
    """The value that gives a channel back."""
    return _RELEASE_FIRST if channel <= _FIRST_EIGHT else _RELEASE_LATER
