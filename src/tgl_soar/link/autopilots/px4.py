"""PX4.

`attitude`: SET_ATTITUDE_TARGET in OFFBOARD, the default: the pilot's mode switch goes on working.
Roll and pitch are held, the yaw is ignored on a fixed wing: it turns by banking.  Setpoints must
stream before the mode can be entered.  COM_OF_LOSS_T after the last one COM_OBL_RC_ACT acts.

`manual_control`: MANUAL_CONTROL in MANUAL, with COM_RC_IN_MODE = 1.  While it is the source that
PX4 has chosen, the pilot's mode, arm and kill switches are ignored.

`actuators`: SET_ACTUATOR_CONTROL_TARGET in OFFBOARD, up to v1.13.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, Final

from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.link.autopilots.base import (
    BYTEWISE,
    CommandRoute,
    ParameterCodec,
    SensorMessages,
    SurfaceChannels,
    Wanted,
    deflections,
    firmware_mismatch,
    set_mode,
)
from tgl_soar.link.autopilots.requirements import SHOULD, Answers, Needs, Requirement, need
from tgl_soar.link.messages import (
    AUTOPILOT_PX4,
    COMPONENT_AUTOPILOT,
    ID_ESTIMATOR_STATUS,
    ID_HIGHRES_IMU,
    ID_VFR_HUD,
    ID_WIND_COV,
    IGNORE_RATES,
    IGNORE_THRUST,
    MODE_FLAG_CUSTOM_MODE,
    STATE_CRITICAL,
    STATE_EMERGENCY,
    CommandLong,
    Heartbeat,
    ManualControl,
    Outbound,
    SetActuatorControlTarget,
    SetAttitudeTarget,
)
from tgl_soar.types import OURS, THEIRS, Setpoints, SurfaceCommand, isfinite

# custom_mode: the main mode in bits 16 to 23, the sub mode above it
MAIN_MANUAL: Final = 1
MAIN_AUTO: Final = 4
MAIN_OFFBOARD: Final = 6
MAIN_STABILIZED: Final = 7
FULL: Final = 1000.0  # of MANUAL_CONTROL


def _custom(main: int, sub: int = 0) -> int:
    return main << 16 | sub << 24


MODE_MANUAL: Final = _custom(MAIN_MANUAL)
MODE_OFFBOARD: Final = _custom(MAIN_OFFBOARD)
MODE_STABILIZED: Final = _custom(MAIN_STABILIZED)
MODE_MISSION: Final = _custom(MAIN_AUTO, 4)
MODE_RETURN: Final = _custom(MAIN_AUTO, 5)

ATTITUDE: Final = CommandRoute(
    name="attitude",
    message="SET_ATTITUDE_TARGET",
    mode="OFFBOARD",
    loops=THEIRS,
    as_operator=False,
    mode_to_enter=MODE_OFFBOARD,
    mode_to_leave=MODE_STABILIZED,
    silence_s=1.0,
    after_silence="COM_OBL_RC_ACT acts (COM_OF_LOSS_T)",
    takeover="the mode switch",
    releases=False,
)
MANUAL_CONTROL: Final = CommandRoute(
    name="manual_control",
    message="MANUAL_CONTROL",
    mode="MANUAL",
    loops=OURS,
    as_operator=False,
    mode_to_enter=None,
    mode_to_leave=MODE_MANUAL,
    silence_s=0.5,
    after_silence="RC is lost: Hold, then the failsafe of NAV_RCL_ACT (COM_RC_LOSS_T)",
    takeover="none by radio: its mode, arm and kill switches are ignored; a ground station's mode",
    releases=False,
)
ACTUATORS: Final = ATTITUDE._replace(
    name="actuators", message="SET_ACTUATOR_CONTROL_TARGET", loops=OURS
)


HOVER: Final = (
    need("MAV_TYPE", "is", 1, "the aircraft is a fixed wing", old=False),
    need(
        "COM_DISARM_LAND", "at most", 0,
        "standing over the ground may be taken for having landed, and would disarm in the air",
        old=False,
    ),
    need(
        "COM_DISARM_PRFLT", "at most", 0, "an aircraft that is launched by hand waits for it, armed"
    ),
    need("NAV_RCL_ACT", "is not", 5, "a lost radio must not terminate the flight", old=False),
    need("NAV_RCL_ACT", "is not", 6, "a lost radio must not disarm in the air", old=False),
    need("NAV_DLL_ACT", "is", 0,
         "a ground station that is lost must not circle or fly home without a propeller"),
    need("COM_LOW_BAT_ACT", "is", 0, "a low battery must not fly home without a propeller"),
    need("COM_FLTT_LOW_ACT", "at most", 1, "a low battery must not fly home without a propeller"),
    need("GF_ACTION", "at most", 1,
         "its own fence must not fly anywhere without a propeller: the module has one"),
    need("COM_FLT_TIME_MAX", "at most", 0, "a long flight must not end by flying home"),
    need("COM_WIND_MAX_ACT", "at most", 1,
         "wind is what soars: it must not fly home without a propeller for it"),
    need(
        "EKF2_FUSE_BETA", "is", 0,
        "while it hovers, a side slip of zero fits a wind from behind as well, and by that its own"
        " modes turn downwind",
        SHOULD,
    ),
    need(
        "EKF2_ARSP_THR", "at most", 5,
        "below it the pitot tube does not count: hovering it would know no wind", SHOULD,
    ),
    need("EKF2_ARSP_THR", "is not", 0, "the pitot tube would not count", SHOULD),
    need(
        "MAV_0_FORWARD", "is", 1,
        "ground stations reach the module through the autopilot", SHOULD,
    ),
    need(
        "MAV_1_FORWARD", "is", 1,
        "ground stations reach the module through the autopilot", SHOULD,
    ),
)  # fmt: skip
BY_OFFBOARD: Final = (
    need(
        "COM_OF_LOSS_T", "at most", 1.0,
        "it keeps the last setpoint for so long when the module falls silent", old=False,
    ),
    need("COM_OF_LOSS_T", "at most", 0.5, "the same, and shorter is safer", SHOULD),
    need(
        "COM_OBL_RC_ACT", "is", 2,
        "then the pilot flies by the sticks: all other modes need a propeller or end the flight",
    ),
    need(
        "COM_RCL_EXCEPT", "has bit", 2,
        "a lost radio circles in Hold, or flies home, without a propeller, and none of its modes"
        " glides without a pilot: the module flies on",
    ),
    need("COM_RC_IN_MODE", "is not", 1, "the pilot's transmitter would not be read", old=False),
    need("COM_RC_IN_MODE", "is not", 4, "the pilot could not take over", old=False),
    need(
        "FW_R_TC", "at most", 0.4,
        "it turns by banking, and with a slower bank it swings about the line's plane", SHOULD,
    ),
)  # fmt: skip
BY_STICKS: Final = (
    *(
        need("COM_RC_IN_MODE", "is not", number, why, old=False)
        for number, why in (
            (0, "MANUAL_CONTROL is ignored: 1, or 6 where it is known"),
            (2, "the module would be ignored whenever a radio was received first"),
            (3, "the module would be ignored whenever a radio was received first"),
            (4, "MANUAL_CONTROL is ignored: 1, or 6 where it is known"),
            (5, "the module would be ignored whenever a radio is received"),
            (7, "the module would be ignored whenever a radio is received"),
        )
    ),
    need(
        "COM_RC_LOSS_T", "at most", 0.5,
        "the surfaces keep the last command for so long when the module falls silent",
        SHOULD,
    ),
)  # fmt: skip
POSES: Final = (
    need("EKF2_EV_CTRL", "has bit", 0, "its estimator takes the poses' place"),
    need("EKF2_EV_CTRL", "has bit", 1, "its estimator takes the poses' height"),
    need("EKF2_EV_CTRL", "has bit", 3, "its estimator takes the poses' heading"),
    need("EKF2_AID_MASK", "has bit", 3, "up to v1.13: its estimator takes the poses' place"),
    need("EKF2_AID_MASK", "has bit", 4, "up to v1.13: its estimator takes the poses' heading"),
)
NO_SATELLITES: Final = (
    need("EKF2_HGT_REF EKF2_HGT_MODE", "is", 3, "its height is that of the poses", old=False),
    need("EKF2_MAG_TYPE", "is", 5, "steel and motors turn a compass in a hall", old=False),
    need("EKF2_GPS_CTRL", "is", 0, "there are no satellites, and reflections are worse than none"),
)
SATELLITES: Final = (
    need("EKF2_GPS_CTRL", "is not", 0, "its position comes from satellites"),
    need("SYS_HAS_GPS", "is", 1, "its position comes from satellites"),
)


class Px4:
    """PX4, fixed wing."""

    name: ClassVar[str] = "px4"
    routes: ClassVar[Mapping[str, CommandRoute]] = {
        route.name: route for route in (ATTITUDE, MANUAL_CONTROL, ACTUATORS)
    }
    asked: ClassVar[tuple[str, ...]] = ()
    codec: ClassVar[ParameterCodec] = BYTEWISE
    sensors: ClassVar[SensorMessages] = SensorMessages(
        imu=(ID_HIGHRES_IMU,),
        airspeed=Wanted(ID_VFR_HUD, "VFR_HUD", 20.0),
        pitot_in_imu=True,
        estimator=Wanted(ID_ESTIMATOR_STATUS, "ESTIMATOR_STATUS", 5.0),
        wind=Wanted(ID_WIND_COV, "WIND_COV", 1.0),
    )

    def __init__(
        self, channels: SurfaceChannels, system_id: int, route: CommandRoute = ATTITUDE
    ) -> None:
        self.route = route
        self._channels = channels
        self._system_id = system_id

    def refusal(self, parameters: Answers, system: int) -> str:
        """It does not look at who commands."""
        return ""

    def mismatch(self, heartbeat: Heartbeat) -> str:
        """Whether it is a PX4."""
        return firmware_mismatch(heartbeat, AUTOPILOT_PX4, "a PX4")

    def commands(
        self,
        surfaces: SurfaceCommand,
        setpoints: Setpoints,
        throttle: float = 0.0,
    ) -> tuple[Outbound, ...]:
        """One frame."""
        if self.route is ATTITUDE:
            return (
                SetAttitudeTarget(
                    time_boot_ms=0,
                    target_system=self._system_id,
                    target_component=COMPONENT_AUTOPILOT,
                    type_mask=IGNORE_RATES | IGNORE_THRUST,
                    q=quaternion_from_euler(setpoints.roll_rad, setpoints.pitch_rad, 0.0),
                ),
            )
        elevator, aileron = _limited(surfaces.elevator), _limited(surfaces.aileron)
        rudder = _limited(surfaces.rudder)  # the fourth surface, a brake, has no place on any route
        if self.route is MANUAL_CONTROL:  # its x is the stick pushed forward
            x, y, r = round(-FULL * elevator), round(FULL * aileron), round(FULL * rudder)
            return (ManualControl(target=self._system_id, x=x, y=y, z=0, r=r),)
        controls = (aileron, elevator, rudder, 0.0, 0.0, 0.0, 0.0, 0.0)
        return (
            SetActuatorControlTarget(
                time_usec=0,
                target_system=self._system_id,
                target_component=COMPONENT_AUTOPILOT,
                group=0,
                controls=controls,
            ),
        )

    def release(self) -> tuple[Outbound, ...]:
        """There is no such message: leaving the mode does it."""
        return ()

    def ask_for_mode(self, custom_mode: int) -> CommandLong:
        """Main mode and sub mode are asked for apart."""
        return set_mode(
            self._system_id, float(custom_mode >> 16 & 0xFF), float(custom_mode >> 24 & 0xFF)
        )

    def obeys(self, heartbeat: Heartbeat) -> bool:
        """In the mode of the route alone."""
        is_custom = heartbeat.base_mode & MODE_FLAG_CUSTOM_MODE != 0
        main = MAIN_MANUAL if self.route is MANUAL_CONTROL else MAIN_OFFBOARD
        return is_custom and heartbeat.custom_mode >> 16 & 0xFF == main

    def deflections(self, servos: Sequence[int]) -> SurfaceCommand:
        """By the table of the airframe file."""
        return deflections(self._channels, servos)

    def failsafe(self, heartbeat: Heartbeat) -> bool:
        """CRITICAL and EMERGENCY are how it says so."""
        return heartbeat.system_status in (STATE_CRITICAL, STATE_EMERGENCY)

    def way_to_rate(self, rate_hz: float) -> str:
        """The rate of a stream is limited by that of its link."""
        return "raise MAV_x_RATE of this link, and its baud rate"

    def requirements(self, needs: Needs) -> tuple[Requirement, ...]:
        """Those of the route, of what becomes of a hovering aircraft, and of the poses."""
        by_sticks = self.route is MANUAL_CONTROL
        rows = HOVER + (BY_STICKS if by_sticks else BY_OFFBOARD)
        if needs.external_pose:
            rows += POSES
        if needs.gps:
            return rows + SATELLITES
        # Without both it is not known whence its position comes, and nothing is asked of that.
        return rows + NO_SATELLITES if needs.external_pose else rows


def _limited(deflection: float) -> float:
    return max(-1.0, min(1.0, deflection)) if isfinite(deflection) else 0.0
