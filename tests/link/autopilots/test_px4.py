"""PX4 by each of its routes: the whole of every message, the modes' numbers, the words."""

from __future__ import annotations

import struct
from math import inf, isnan, nan, pi

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.link.autopilots.base import (
    BrakeChannel,
    CommandRoute,
    SurfaceChannel,
    SurfaceChannels,
)
from tgl_soar.link.autopilots.px4 import ACTUATORS, ATTITUDE, MANUAL_CONTROL, Px4
from tgl_soar.link.autopilots.requirements import Needs
from tgl_soar.link.messages import (
    Heartbeat,
    ManualControl,
    SetActuatorControlTarget,
    SetAttitudeTarget,
)
from tgl_soar.types import NO_SETPOINTS, OURS, THEIRS, SurfaceCommand

CHANNELS = SurfaceChannels(
    elevator=SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    aileron=SurfaceChannel(channel=1, pwm_min=1000, pwm_trim=1600, pwm_max=1800, reversed=True),
    rudder=SurfaceChannel(channel=4, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
)
SYSTEM, AUTOPILOT = 7, mavlink.MAV_COMP_ID_AUTOPILOT1
ROUTES = [ATTITUDE, MANUAL_CONTROL, ACTUATORS]
CUSTOM = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED


def custom_mode(name: str) -> int:
    """By px4_custom_mode.h: main mode and sub mode are the third and the fourth byte."""
    _, main, sub = mavutil.px4_map[name]
    return int(struct.unpack("<I", bytes((0, 0, main, sub)))[0])


def alive(
    custom: int, *, base: int = CUSTOM, status: int = mavlink.MAV_STATE_ACTIVE, kind: int = 1
) -> Heartbeat:
    return Heartbeat(
        type=kind, autopilot=12, base_mode=base, custom_mode=custom, system_status=status
    )


def test_attitude_is_its_usual_route_and_the_others_are_known_by_name() -> None:
    assert Px4.name == "px4"
    assert list(Px4.routes.items()) == [
        ("attitude", ATTITUDE),
        ("manual_control", MANUAL_CONTROL),
        ("actuators", ACTUATORS),
    ]
    assert Px4(CHANNELS, SYSTEM).route is ATTITUDE
    assert [(r.loops, r.message) for r in ROUTES] == [
        (THEIRS, "SET_ATTITUDE_TARGET"),
        (OURS, "MANUAL_CONTROL"),
        (OURS, "SET_ACTUATOR_CONTROL_TARGET"),
    ]
    assert [r.mode for r in ROUTES] == ["OFFBOARD", "MANUAL", "OFFBOARD"]


@pytest.mark.parametrize(
    ("roll", "pitch"), [(0.0, 0.0), (0.6, -0.2), (-1.2, 0.3), (pi / 2, -pi / 4)]
)
def test_an_attitude_is_asked_for_without_rates_thrust_or_a_heading(
    roll: float, pitch: float
) -> None:
    """The heading of a fixed wing follows from its bank."""
    setpoints = NO_SETPOINTS._replace(roll_rad=roll, pitch_rad=pitch)
    (message,) = Px4(CHANNELS, SYSTEM).commands(SurfaceCommand(1.0, 1.0, 1.0), setpoints)
    assert isinstance(message, SetAttitudeTarget)
    assert (message.time_boot_ms, message.target_system, message.target_component) == (
        0,
        SYSTEM,
        AUTOPILOT,
    )
    assert message.type_mask == (
        mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
        | mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
        | mavlink.ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
        | mavlink.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE
    )
    assert euler_from_quaternion(*message.q) == pytest.approx((roll, pitch, 0.0))


@pytest.mark.parametrize(
    ("surfaces", "sticks"),
    [
        (SurfaceCommand(0.5, -0.25, 0.125), (-500, -250, 125)),
        (SurfaceCommand(-1.0, 1.0, -1.0), (1000, 1000, -1000)),
        (SurfaceCommand(7.0, -7.0, 7.0), (-1000, -1000, 1000)),
        (SurfaceCommand(nan, inf, -inf), (0, 0, 0)),
        (SurfaceCommand(0.0016, 0.0, 0.0, brake=1.0), (-2, 0, 0)),
    ],
)
def test_sticks_go_to_a_thousand_and_elevator_up_is_pulled(
    surfaces: SurfaceCommand, sticks: tuple[int, int, int]
) -> None:
    """MANUAL_CONTROL: "X-axis … generally corresponds to forward(1000)-backward(-1000)"."""
    (message,) = Px4(CHANNELS, SYSTEM, MANUAL_CONTROL).commands(surfaces, NO_SETPOINTS)
    x, y, r = sticks
    assert message == ManualControl(target=SYSTEM, x=x, y=y, z=0, r=r)  # no thrust


@pytest.mark.parametrize(
    ("surfaces", "controls"),
    [
        (SurfaceCommand(0.5, -0.25, 0.125), (-0.25, 0.5, 0.125)),
        (SurfaceCommand(-9.0, 9.0, -9.0), (1.0, -1.0, -1.0)),
        (SurfaceCommand(nan, inf, -inf), (0.0, 0.0, 0.0)),
    ],
)
def test_actuators_are_the_attitude_s_group_and_no_thrust(
    surfaces: SurfaceCommand, controls: tuple[float, float, float]
) -> None:
    """Group 0 of PX4's mixers: roll, pitch, yaw, thrust, flaps, spoilers, air brakes, gear."""
    (message,) = Px4(CHANNELS, SYSTEM, ACTUATORS).commands(surfaces, NO_SETPOINTS, 1.0)
    assert message == SetActuatorControlTarget(
        time_usec=0,
        target_system=SYSTEM,
        target_component=AUTOPILOT,
        group=0,
        controls=(*controls, 0.0, 0.0, 0.0, 0.0, 0.0),
    )


@pytest.mark.parametrize("route", ROUTES)
def test_nothing_but_another_mode_hands_over(route: CommandRoute) -> None:
    px4 = Px4(CHANNELS, SYSTEM, route)
    assert px4.release() == ()
    assert px4.route.releases is False


# --- modes ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["MANUAL", "OFFBOARD", "STABILIZED", "MISSION", "RTL", "LOITER"])
def test_main_mode_and_sub_mode_are_asked_for_apart(name: str) -> None:
    """PX4 takes them by the second and the third parameter of MAV_CMD_DO_SET_MODE."""
    asked = Px4(CHANNELS, SYSTEM).ask_for_mode(custom_mode(name))
    assert asked.target_system == SYSTEM
    assert asked.command == mavlink.MAV_CMD_DO_SET_MODE
    _, main, sub = mavutil.px4_map[name]
    assert asked.params[:3] == (float(CUSTOM), float(main), float(sub))


@pytest.mark.parametrize("name", sorted(mavutil.px4_map))
@pytest.mark.parametrize("route", ROUTES)
def test_only_in_the_route_s_own_mode_are_commands_obeyed(name: str, route: CommandRoute) -> None:
    px4 = Px4(CHANNELS, SYSTEM, route)
    mode = custom_mode(name)
    assert px4.obeys(alive(mode)) == (name == px4.route.mode)
    assert px4.obeys(alive(mode, base=CUSTOM | 128)) == (name == px4.route.mode)
    assert not px4.obeys(alive(mode, base=128))  # then its number says nothing


def test_what_else_stands_in_the_number_of_a_mode_is_no_matter() -> None:
    mode = custom_mode("OFFBOARD")
    assert Px4(CHANNELS, SYSTEM).obeys(alive(mode | 0xFF000000 | 0xFFFF))
    assert not Px4(CHANNELS, SYSTEM).obeys(alive(6 | 6 << 24))


# --- what it reports -----------------------------------------------------------------------------


@pytest.mark.parametrize("status", range(9))
def test_critical_and_emergency_are_failsafes(status: int) -> None:
    fails = status in (mavlink.MAV_STATE_CRITICAL, mavlink.MAV_STATE_EMERGENCY)
    assert Px4(CHANNELS, SYSTEM).failsafe(alive(0, status=status)) == fails


def test_outputs_are_read_by_the_airframe_s_channels() -> None:
    found = Px4(CHANNELS, SYSTEM).deflections([1700, 1300, 0, 1900])
    assert found[:3] == pytest.approx((-0.5, -0.5, 1.0))
    assert isnan(found.brake)
    spoiler = SurfaceChannel(channel=3, pwm_min=1000, pwm_trim=1500, pwm_max=2000)
    braked = CHANNELS._replace(brake=BrakeChannel(spoiler))
    assert Px4(braked, SYSTEM).deflections([1600, 1500, 2000, 1500]).brake == 1.0


def test_it_obeys_whoever_commands() -> None:
    assert Px4.asked == ()
    assert Px4(CHANNELS, SYSTEM).refusal({"SYSID_MYGCS": 1.0}, 255) == ""


def test_another_firmware_or_vehicle_is_named() -> None:
    px4 = Px4(CHANNELS, SYSTEM)
    assert px4.mismatch(alive(0)) == ""
    assert "is not a PX4 (MAV_AUTOPILOT 3, not 12)" in px4.mismatch(alive(0)._replace(autopilot=3))
    assert "no fixed wing (MAV_TYPE 2)" in px4.mismatch(alive(0, kind=2))


def test_its_whole_numbers_come_as_their_bytes() -> None:
    (as_float,) = struct.unpack("<f", struct.pack("<i", 4))
    assert Px4.codec.number(as_float, 6) == 4.0


def test_the_way_to_a_faster_stream_is_the_link_s_rate() -> None:
    assert "MAV_x_RATE" in Px4(CHANNELS, SYSTEM).way_to_rate(200.0)
    assert "baud" in Px4(CHANNELS, SYSTEM).way_to_rate(200.0)


@pytest.mark.parametrize("route", [ATTITUDE, MANUAL_CONTROL])
@pytest.mark.parametrize("name", ["NAV_RCL_ACT", "COM_RC_IN_MODE"])
def test_each_thing_that_is_asked_of_a_radio_s_loss_must_be_answered(
    route: CommandRoute, name: str
) -> None:
    """Every release has these parameters: one that does not answer is not known to be right."""
    needs = Needs(override_system=255, loop_rate_hz=200.0, external_pose=False, gps=True)
    rows = [row for row in Px4(CHANNELS, SYSTEM, route).requirements(needs) if name in row.names]
    assert len(rows) >= 2
    assert [row.missing_ok for row in rows] == [False] * len(rows)
