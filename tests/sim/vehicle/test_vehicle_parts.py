"""The parts of the simulated autopilot by themselves: its parameters with their ranges, its clock,
its links, its surfaces' channels, and poses of a companion."""

from __future__ import annotations

from math import inf, nan
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.airframe import Mixing, Surface, Surfaces, Throttle
from tgl_soar.geometry import quaternion_from_euler
from tgl_soar.sim.routing import split_frames
from tgl_soar.sim.vehicle.external_pose import ExternalPose
from tgl_soar.sim.vehicle.firmware_parameters import FirmwareParameters
from tgl_soar.sim.vehicle.level_flight import LevelFlight
from tgl_soar.sim.vehicle.modes import MODE_NAMES, FlightStatus
from tgl_soar.sim.vehicle.onlooker_events import OnlookerEvents
from tgl_soar.sim.vehicle.pixhawk import Pixhawk
from tgl_soar.sim.vehicle.sensed import GROUNDED
from tgl_soar.sim.vehicle.surface_outputs import SurfaceOutputs
from tgl_soar.sim.vehicle.vehicle_clock import VehicleClock
from tgl_soar.sim.vehicle.vehicle_links import VehicleLinks
from tgl_soar.types import AttitudeSample, PositionFix, SurfaceCommand

ODD = Surfaces(
    elevator=Surface(2, 1000, 1400, 2000, reversed=True),
    aileron=Surface(1, 1100, 1500, 1900),
    rudder=Surface(4, 1200, 1550, 1850),
    throttle=Throttle(3, 1050, 1950),
)
NEUTRAL = SurfaceCommand(0.0, 0.0, 0.0, 0.0)
LEAVE = [65535] * 18


# --- parameters -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value", "low", "high", "kind"),
    [
        ("SYSID_THISMAV", 1.0, 1.0, 255.0, mavlink.MAV_PARAM_TYPE_INT16),
        ("SYSID_MYGCS", 255.0, 1.0, 255.0, mavlink.MAV_PARAM_TYPE_INT16),
        ("SCHED_LOOP_RATE", 400.0, 50.0, 400.0, mavlink.MAV_PARAM_TYPE_INT16),
        ("RC_OVERRIDE_TIME", 0.5, -1.0, 120.0, mavlink.MAV_PARAM_TYPE_REAL32),
        ("VISO_TYPE", 0.0, 0.0, 1.0, mavlink.MAV_PARAM_TYPE_INT8),
        ("VISO_DELAY_MS", 10.0, 0.0, 250.0, mavlink.MAV_PARAM_TYPE_INT16),
        ("RC2_REVERSED", 0.0, 0.0, 1.0, mavlink.MAV_PARAM_TYPE_INT8),
        ("SERVO4_REVERSED", 0.0, 0.0, 1.0, mavlink.MAV_PARAM_TYPE_INT8),
        ("RC2_MIN", 1000.0, 800.0, 1399.0, mavlink.MAV_PARAM_TYPE_INT16),
        ("RC2_TRIM", 1400.0, 1001.0, 1999.0, mavlink.MAV_PARAM_TYPE_INT16),
        ("SERVO2_MAX", 2000.0, 1401.0, 2200.0, mavlink.MAV_PARAM_TYPE_INT16),
        ("SERVO3_MIN", 1050.0, 800.0, 2200.0, mavlink.MAV_PARAM_TYPE_INT16),
        ("RC3_MAX", 1950.0, 800.0, 2200.0, mavlink.MAV_PARAM_TYPE_INT16),
    ],
)
def test_a_parameter_has_its_value_its_range_and_its_type(
    name: str, value: float, low: float, high: float, kind: int
) -> None:
    parameters = FirmwareParameters(ODD)
    assert parameters[name] == value
    for good in (low, high):
        assert parameters.set(name, good)
        assert parameters[name] == good
        parameters.set(name, value)
    for bad in (low - 1.0, high + 1.0, nan, inf):
        assert not parameters.set(name, bad)
        assert parameters[name] == value
    assert parameters.wire_type(name) == kind
    assert name in parameters


def test_the_channels_are_those_of_the_airframe_file_in_their_order() -> None:
    names = FirmwareParameters(ODD).names
    own = 6
    four = ["MIN", "TRIM", "MAX", "REVERSED"]
    expected = [f"{kind}{n}_{end}" for n in (1, 2, 4) for kind in ("RC", "SERVO") for end in four]
    expected += [f"{kind}3_{end}" for kind in ("RC", "SERVO") for end in ("MIN", "MAX")]
    assert list(names[own:]) == expected
    assert "RC3_TRIM" not in FirmwareParameters(ODD)
    assert not FirmwareParameters(ODD).set("NOTHING", 1.0)


def test_a_calibration_is_minimum_trim_maximum_and_reversal() -> None:
    parameters = FirmwareParameters(ODD, {"SERVO2_REVERSED": 1.0})
    assert parameters.calibration("RC2") == (1000.0, 1400.0, 2000.0, False)
    assert parameters.calibration("SERVO2") == (1000.0, 1400.0, 2000.0, True)


def test_a_wrong_value_at_the_start_is_named_with_what_there_is() -> None:
    with pytest.raises(ValueError, match=r"autopilot parameter RC1_MIN = 1500: no such parameter"):
        FirmwareParameters(ODD, {"RC1_MIN": 1500})
    with pytest.raises(ValueError, match=r"NOTHING = 1: .*there are SYSID_THISMAV, SYSID_MYGCS"):
        FirmwareParameters(ODD, {"NOTHING": 1})


# --- clock, modes and events ----------------------------------------------------------------------


def test_stamps_are_since_boot_in_their_own_units() -> None:
    clock = VehicleClock(400, 2.5)
    assert (clock.steps, clock.time_s) == (0, 0.0)
    clock.steps = 100
    assert clock.time_s == 0.25
    assert clock.boot_ms(0.25) == 2750
    assert clock.boot_us(0.25) == 2_750_000
    assert clock.boot_ns(0.25) == 2_750_000_000
    assert clock.boot_ms(2**32 / 1000.0 - 2.5) == 0  # it wraps
    clock.restart()
    assert clock.boot_ms(clock.time_s) == 0
    assert clock.boot_ms(0.5) == 250
    assert VehicleClock(400).uptime_s == 0.0


def test_modes_have_arduplanes_numbers() -> None:
    assert MODE_NAMES == {0: "MANUAL", 5: "FBWA"}
    assert (FlightStatus().mode, FlightStatus().armed) == (0, True)


def test_what_happens_again_and_again_is_reported_once_and_a_flood_not_at_all() -> None:
    events = OnlookerEvents()
    events.add("a")
    events.add_once("b")
    events.add_once("b")
    events.add("a")
    assert events.take() == ["a", "b", "a"]
    assert events.take() == []
    for i in range(200):
        events.add_once(f"{i}")
    assert events.take() == [f"{i}" for i in range(99)]  # a hundred different ones, with the b
    events.add("still")
    assert events.take() == ["still"]


# --- links ----------------------------------------------------------------------------------------


def beat() -> Any:
    return mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def test_what_is_queued_goes_out_in_datagrams_of_whole_frames() -> None:
    """A heartbeat is 21 bytes: 57 of them are 1197, and 58 more than 1200."""
    links = VehicleLinks()
    link = links.add(5, 1, ground=True)
    assert links.take_datagrams() == []
    for _ in range(300):
        link.post(beat())
    datagrams = links.take_datagrams()
    assert [number for number, _ in datagrams] == [5] * 6
    assert [len(data) // 21 for _, data in datagrams] == [57, 57, 57, 57, 57, 15]
    assert all(len(data) % 21 == 0 for _, data in datagrams)
    sequences = [data[i + 4] for _, data in datagrams for i in range(0, len(data), 21)]
    assert sequences == [i % 256 for i in range(300)]
    assert links.take_datagrams() == []


def test_a_frame_that_is_larger_than_a_datagram_goes_alone() -> None:
    links = VehicleLinks()
    link = links.add(5, 1, ground=True)
    link.outbox += [b"a" * 1200, b"b", b"c" * 1300, b"d"]
    assert [len(data) for _, data in links.take_datagrams()] == [1200, 1, 1300, 1]


def test_links_are_emptied_one_by_one_and_a_broadcast_reaches_all_or_the_ground() -> None:
    links = VehicleLinks()
    links.add(1, 9, ground=False)
    links.add(2, 9, ground=True)
    links.broadcast(beat())
    links.broadcast(beat(), ground_only=True)
    assert [number for number, _ in links.take_datagrams([2])] == [2]
    [(number, data)] = links.take_datagrams()
    assert (number, len(data)) == (1, 21)
    assert (data[5], data[6]) == (9, 1)  # the system it was given, as its autopilot
    assert links.get(3) is None
    links.remove(1)
    links.remove(1)
    assert links.get(1) is None
    assert len(list(links)) == 1


def test_a_restart_forgets_who_was_there_and_what_they_asked_for() -> None:
    links = VehicleLinks()
    for number in (1, 2):
        links.add(number, 1, ground=False)
    [frame], _ = split_frames(
        mavlink.MAVLink(None), bytes(beat().pack(mavlink.MAVLink(None, 7, 8)))
    )
    assert links.pass_on(1, frame, 1)
    assert links.routes_to(7, 8) == (1,)
    link = links.get(2)
    assert link is not None
    assert link.outbox == [frame.raw]
    link.parameters_to_send.extend([1, 2])
    links.restart()
    assert links.routes_to(7, 8) == ()
    assert (link.outbox, link.streams, len(link.parameters_to_send)) == ([], {}, 0)
    links.pass_on(1, frame, 1)
    assert link.outbox == [frame.raw]  # it is still a link


# --- surfaces -------------------------------------------------------------------------------------


def outputs(surfaces: Surfaces = ODD, **values: float) -> SurfaceOutputs:
    return SurfaceOutputs(
        surfaces, FirmwareParameters(surfaces, dict(values)), LevelFlight(0.0), 200
    )


def attitude(roll: float = 0.0, pitch: float = 0.0) -> AttitudeSample:
    qw, qx, qy, qz = quaternion_from_euler(roll, pitch, 0.0)
    return AttitudeSample(
        sequence=1,
        time_s=0.0,
        qw=qw,
        qx=qx,
        qy=qy,
        qz=qz,
        roll_rate_frd_radps=0.0,
        pitch_rate_frd_radps=0.0,
        yaw_rate_frd_radps=0.0,
    )


def test_the_pilots_sticks_come_out_as_deflections() -> None:
    made = outputs()
    made.update(SurfaceCommand(0.5, -0.25, 1.0), None)
    assert made.deflections == pytest.approx((0.5, -0.25, 1.0, 0.0))
    # Elevator reversed, 400 below its middle: half is 1200.
    assert made.servo_pwm[:5] == (1400, 1200, 1050, 1850, 0)
    assert made.channel_pwm[:5] == (1400, 1200, 1050, 1850, 65535)
    assert len(made.servo_pwm) == len(made.channel_pwm) == 18


def test_an_override_stands_in_for_its_channel_alone() -> None:
    made = outputs()
    values = list(LEAVE)
    values[1] = 1800
    made.overrides.take(values, 0)
    assert made.is_overridden()
    made.update(SurfaceCommand(1.0, 1.0, 0.0), None)
    assert made.deflections == pytest.approx((-400 / 600, 1.0, 0.0, 0.0))
    assert made.channel_pwm[1] == 1800


def test_an_override_of_no_surface_is_none_of_the_surfaces() -> None:
    made = outputs()
    values = list(LEAVE)
    values[6] = 1800
    made.overrides.take(values, 0)
    assert not made.is_overridden()
    assert made.channel_pwm[6] == 1800


def test_overrides_end_after_their_time_or_never() -> None:
    for allowed_s, ended in ((0.5, [2]), (-1.0, []), (1.0, [])):
        made = outputs(RC_OVERRIDE_TIME=allowed_s)
        values = list(LEAVE)
        values[1] = 1800
        made.overrides.take(values, 0)
        assert made.expire_overrides(99) == []
        assert made.expire_overrides(100) == ended


def test_servos_have_a_calibration_of_their_own() -> None:
    """A stick at half is at half of the servo's way, what the surface makes of it is the file's."""
    made = outputs(SERVO1_MAX=1700.0, RC1_REVERSED=1.0)
    made.update(SurfaceCommand(0.0, -0.5, 0.0), None)
    assert made.servo_pwm[0] == 1600
    assert made.deflections.aileron == pytest.approx(0.25)


def test_level_flight_has_the_surfaces_the_way_that_each_turns() -> None:
    """Half a radian nose down: elevator up by 1; 0.1 rad to the right: ailerons left by 0.12."""
    made = outputs()
    made.update(NEUTRAL, attitude(roll=0.1, pitch=-0.2))
    sum_of_error = 2.0 * 0.2 / 200.0
    assert made.deflections.elevator == pytest.approx(2.0 * 0.2 + sum_of_error, abs=0.002)
    assert made.deflections.aileron == pytest.approx(-1.2 * 0.1, abs=0.003)
    assert made.channel_pwm[1] == 1400  # the sticks stay as they are


def test_in_level_flight_a_reversed_channels_stick_asks_as_the_surface_would_go() -> None:
    made = outputs()
    made.update(SurfaceCommand(1.0, 0.0, 0.0), attitude(pitch=0.26))
    assert made.deflections.elevator == pytest.approx(0.0, abs=0.002)  # a full stick: 0.26 rad


def test_level_flight_begins_with_the_elevator_as_it_stands() -> None:
    made = outputs()
    made.update(SurfaceCommand(0.4, 0.0, 0.0), None)
    made.enter_level_flight()
    made.update(NEUTRAL, attitude())
    assert made.deflections.elevator == pytest.approx(0.4, abs=0.002)


def test_in_level_flight_the_brake_is_the_sticks_own() -> None:
    surfaces = Surfaces(
        elevator=Surface(2),
        rudder=Surface(4),
        aileron_left=Surface(1),
        aileron_right=Surface(5),
        mixing=Mixing(0.5, "up"),
    )
    made = outputs(surfaces)
    made.update(SurfaceCommand(0.0, 0.0, 0.0, 0.6), attitude())
    assert made.deflections.brake == pytest.approx(0.6, abs=0.01)
    assert made.servo_pwm[0] == 1380
    assert made.servo_pwm[4] == 1620


def test_a_motor_follows_its_override_and_is_closed_without() -> None:
    made = outputs()
    made.update(NEUTRAL, None)
    assert (made.throttle, made.servo_pwm[2]) == (0.0, 1050)
    values = list(LEAVE)
    values[2] = 1500
    made.overrides.take(values, 0)
    made.update(NEUTRAL, None)
    assert made.throttle == pytest.approx(0.5)
    assert (made.servo_pwm[2], made.channel_pwm[2]) == (1500, 1500)


# --- poses ----------------------------------------------------------------------------------------


def fix(time_s: float = 10.0, speed: float = 2.0) -> PositionFix:
    return PositionFix(
        sequence=7,
        time_s=time_s,
        north_m=100.0,
        east_m=200.0,
        down_m=300.0,
        velocity_north_mps=speed,
        velocity_east_mps=-1.0,
        velocity_down_mps=0.5,
        source=0,
        sigma_m=0.01,
        reckoned=False,
    )


def pose(x: float = 1.0, roll: float = 0.0) -> Any:
    return mavlink.MAVLink_vision_position_estimate_message(0, x, 2.0, 3.0, roll, 0.0, 0.0)


def odometry(*, frame: int = 20, child: int = 12, q: tuple[float, ...] = (1.0, 0, 0, 0)) -> Any:
    """MAV_FRAME_LOCAL_FRD is 20, MAV_FRAME_BODY_FRD 12."""
    return mavlink.MAVLink_odometry_message(
        time_usec=0,
        frame_id=frame,
        child_frame_id=child,
        x=1.0,
        y=2.0,
        z=3.0,
        q=list(q),
        vx=0.0,
        vy=0.0,
        vz=0.0,
        rollspeed=0.0,
        pitchspeed=0.0,
        yawspeed=0.0,
        pose_covariance=[0.0] * 21,
        velocity_covariance=[0.0] * 21,
    )


def test_a_pose_is_carried_on_with_the_own_velocity_for_as_long_as_it_is_old() -> None:
    """It came at 9.9 s and was 50 ms old then: 0.15 s before the fix."""
    poses = ExternalPose()
    assert not poses.is_in_use()
    poses.take(pose(), 9.9)
    assert poses.is_in_use()
    aided = poses.fix(fix(), fix(), 10.0, 0.05)
    assert (aided.north_m, aided.east_m, aided.down_m) == pytest.approx((1.3, 1.85, 3.075))
    assert (aided.sequence, aided.time_s, aided.velocity_north_mps) == (7, 10.0, 2.0)
    unknown = poses.fix(fix(speed=nan), fix(), 10.0, 0.05)
    assert unknown.north_m == 1.0


def test_a_second_after_the_last_pose_the_position_stands_still() -> None:
    poses, before = ExternalPose(), fix(time_s=9.0)
    poses.take(pose(), 9.0)
    assert poses.fix(fix(), before, 10.0, 0.0) != before
    assert poses.fix(fix(), before, 10.001, 0.0) == before
    assert poses.is_in_use()


@pytest.mark.parametrize(
    ("message", "taken"),
    [
        (pose(), True),
        (pose(x=99_999.0), True),
        (pose(x=1e5), False),
        (pose(x=-1e5), False),
        (pose(x=nan), False),
        (pose(roll=nan), False),
        (pose(roll=inf), False),
        (odometry(), True),
        (odometry(frame=1), False),
        (odometry(child=8), False),
        (odometry(q=(0.6, 0.0, 0.8, 0.0)), True),
        (odometry(q=(1.000009, 0.0, 0.0, 0.0)), True),
        (odometry(q=(1.000012, 0.0, 0.0, 0.0)), False),
        (odometry(q=(0.999988, 0.0, 0.0, 0.0)), False),
        (odometry(q=(nan, 0.0, 0.0, 0.0)), False),
    ],
)
def test_what_is_no_pose_is_dropped_and_counted(message: Any, taken: bool) -> None:
    poses = ExternalPose()
    poses.take(message, 1.0)
    assert (poses.accepted, poses.dropped) == ((1, 0) if taken else (0, 1))
    assert (poses.newest is message) == taken
    poses.take(pose(), 2.0)
    assert poses.accepted == (2 if taken else 1)


# --- the whole ------------------------------------------------------------------------------------


def test_nothing_arrives_before_it_boots_again_but_lockstep_s_answer() -> None:
    pixhawk = Pixhawk(ODD, 200)
    pixhawk.add_link(1, ground=False)
    pixhawk.shut_down()
    codec = mavlink.MAVLink(None, 1, 191)
    question = mavlink.MAVLink_timesync_message(0, 5)
    answer = mavlink.MAVLink_timesync_message(9, 77)
    for message in (question, answer, beat()):
        pixhawk.receive(1, bytes(message.pack(codec)))
    pixhawk.step(GROUNDED)
    assert pixhawk.take_datagrams() == []
    assert pixhawk.timesync_answer_ns(1) == 77
    assert pixhawk.heartbeats(1) == 0
    pixhawk.boot()
    assert pixhawk.boot_ms == 0
    assert [link for link, _ in pixhawk.take_datagrams()] == [1]
    assert (pixhawk.timesync_answer_ns(5), pixhawk.heartbeats(5)) == (0, 0)


def test_a_time_question_is_answered_with_its_own_time_in_nanoseconds() -> None:
    pixhawk = Pixhawk(ODD, 200, uptime_s=2.0)
    pixhawk.add_link(1, ground=False)
    for _ in range(10):
        pixhawk.step(GROUNDED)
    pixhawk.take_datagrams()
    question = mavlink.MAVLink_timesync_message(0, 5)
    pixhawk.receive(1, bytes(question.pack(mavlink.MAVLink(None, 1, 191))))
    [(_, data)] = pixhawk.take_datagrams()
    answer = mavlink.MAVLink(None).decode(bytearray(data))
    assert (answer.tc1, answer.ts1) == (2_050_000_000, 5)


def test_it_has_no_mission_and_says_so() -> None:
    pixhawk = Pixhawk(ODD, 200)
    pixhawk.add_link(1, ground=True)
    request = mavlink.MAVLink_mission_request_list_message(1, 1, 2)
    pixhawk.receive(1, bytes(request.pack(mavlink.MAVLink(None, 255, 190))))
    [(_, data)] = pixhawk.take_datagrams()
    answer = mavlink.MAVLink(None).decode(bytearray(data))
    assert (answer.get_type(), answer.count, answer.mission_type) == ("MISSION_COUNT", 0, 2)
    assert (answer.target_system, answer.target_component) == (255, 190)
