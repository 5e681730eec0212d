"""The simulated Pixhawk against what was measured on the firmware that it stands for."""

from __future__ import annotations

from collections import Counter
from math import cos, isfinite, sin
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.config.airframe import Surface, Surfaces
from tgl_soar.config.files import load_airframe, shipped
from tgl_soar.sim.channels import deflection_from_pwm, pwm_from_deflection
from tgl_soar.sim.routing import MAX_ROUTES, split_frames
from tgl_soar.sim.vehicle.modes import FBWA, MANUAL
from tgl_soar.sim.vehicle.pixhawk import Pixhawk
from tgl_soar.sim.vehicle.sensed import Sensed
from tgl_soar.types import NO_ATTITUDE, NO_FIX, AttitudeSample, PositionFix, SurfaceCommand

STEP_HZ = 200
GROUND, COMPANION, RADIO = 1, 2, 3
SURFACES = Surfaces(
    elevator=Surface(channel=2, reversed=True),
    aileron=Surface(channel=1),
    rudder=Surface(channel=4, pwm_min=1200, pwm_trim=1510, pwm_max=1800),
)

ATTITUDE_QUATERNION = mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION
LOCAL_POSITION_NED = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED


class Peer:
    """A peer at the other end of a link: encodes, and reads what came back."""

    def __init__(self, pixhawk: Pixhawk, link: int, system: int, component: int) -> None:
        self.pixhawk, self.link = pixhawk, link
        self.codec = mavlink.MAVLink(None, system, component)

    def raw(self, message: Any) -> bytes:
        data = bytes(message.pack(self.codec))
        self.codec.seq = (self.codec.seq + 1) % 256
        return data

    def say(self, message: Any) -> bytes:
        data = self.raw(message)
        self.pixhawk.receive(self.link, data)
        return data

    def heartbeat(self) -> bytes:
        return self.say(mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3))

    def override(self, *values: int) -> bytes:
        padded = list(values) + [65535] * (8 - len(values))
        return self.say(mavlink.MAVLink_rc_channels_override_message(1, 1, *padded))

    def command(self, command: int, *values: float, target: tuple[int, int] = (1, 1)) -> bytes:
        padded = list(values) + [0.0] * (7 - len(values))
        return self.say(mavlink.MAVLink_command_long_message(*target, command, 0, *padded))

    def set_parameter(self, name: str, value: float, target: tuple[int, int] = (1, 1)) -> bytes:
        return self.say(mavlink.MAVLink_param_set_message(*target, name.encode(), value, 9))


def make(**options: Any) -> Pixhawk:
    pixhawk = Pixhawk(SURFACES, STEP_HZ, **options)
    pixhawk.add_link(GROUND, ground=True)
    pixhawk.add_link(COMPANION, ground=False)
    return pixhawk


def companion(pixhawk: Pixhawk) -> Peer:
    return Peer(pixhawk, COMPANION, 1, 191)


def master(pixhawk: Pixhawk) -> Peer:
    """The companion's second identity, the one whose overrides count."""
    return Peer(pixhawk, COMPANION, 255, 191)


def ground(pixhawk: Pixhawk) -> Peer:
    return Peer(pixhawk, GROUND, 255, 190)


def sensed(step: int, *, flying: bool = True, pitch: float = 0.0) -> Sensed:
    """Samples at every step, each true one step ago."""
    time_s = (step - 1) / STEP_HZ
    half = 0.5 * pitch
    return Sensed(
        attitude=AttitudeSample(
            sequence=step,
            time_s=time_s,
            qw=cos(half),
            qx=0.0,
            qy=sin(half),
            qz=0.0,
            roll_rate_frd_radps=0.01,
            pitch_rate_frd_radps=0.02,
            yaw_rate_frd_radps=0.03,
        ),
        position=PositionFix(
            sequence=step,
            time_s=time_s,
            north_m=1.0,
            east_m=2.0,
            down_m=-3.0,
            velocity_north_mps=0.1,
            velocity_east_mps=0.2,
            velocity_down_mps=0.3,
        ),
        airspeed_mps=8.5,
        flying=flying,
    )


def run(pixhawk: Pixhawk, steps: int, **options: Any) -> dict[int, list[Any]]:
    """Steps taken; the messages that went out, by link."""
    out: dict[int, list[Any]] = {GROUND: [], COMPANION: [], RADIO: []}
    for _ in range(steps):
        pixhawk.step(sensed(pixhawk.steps + 1, **options))
        collect(pixhawk, out)
    return out


def collect(pixhawk: Pixhawk, out: dict[int, list[Any]] | None = None) -> dict[int, list[Any]]:
    out = out if out is not None else {GROUND: [], COMPANION: [], RADIO: []}
    decoder = mavlink.MAVLink(None)
    for link, data in pixhawk.take_datagrams():
        frames, lost = split_frames(decoder, data)
        assert lost == 0
        out[link] += [frame.message for frame in frames]
    return out


def named(messages: list[Any], name: str) -> list[Any]:
    return [message for message in messages if message.get_type() == name]


def ack(pixhawk: Pixhawk, link: int = COMPANION) -> int:
    [answer] = named(collect(pixhawk)[link], "COMMAND_ACK")
    return int(answer.result)


# --- overrides -------------------------------------------------------------------------------


def test_an_override_moves_the_surfaces_through_calibration_and_reversal() -> None:
    pixhawk = make()
    master(pixhawk).override(1700, 1700, 0, 1655)
    run(pixhawk, 1)
    assert pixhawk.surfaces.aileron == pytest.approx(0.5)
    assert pixhawk.surfaces.elevator == pytest.approx(-0.5)  # reversed in the airframe file
    assert pixhawk.surfaces.rudder == pytest.approx(0.5)  # half of 1510 … 1800


def test_the_measured_example_of_calibration() -> None:
    """Measured: RC 1700 with RC 1000–2000 and SERVO 1100–1900 gave servo 1660."""
    pixhawk = make(parameters={"RC1_MIN": 1000.0, "RC1_MAX": 2000.0})
    master(pixhawk).override(1700)
    run(pixhawk, 1)
    companion(pixhawk).command(
        mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW
    )
    [report] = named(collect(pixhawk)[COMPANION], "SERVO_OUTPUT_RAW")
    assert report.servo1_raw == 1660
    assert report.servo2_raw == 1500


@pytest.mark.parametrize("system", [1, 2, 254])
def test_an_override_of_another_system_is_ignored_without_a_word(system: int) -> None:
    pixhawk = make()
    Peer(pixhawk, COMPANION, system, 191).override(1900, 1900, 0, 1800)
    out = run(pixhawk, 1)
    assert pixhawk.surfaces == SurfaceCommand(0.0, 0.0, 0.0)
    assert pixhawk.counts.overrides_refused == 1
    assert not named(out[COMPANION], "STATUSTEXT")
    assert any("SYSID_MYGCS is 255" in event for event in pixhawk.take_events())


def test_the_master_system_can_be_changed() -> None:
    pixhawk = make()
    ground(pixhawk).set_parameter("SYSID_MYGCS", 7.0)
    master(pixhawk).override(1900)
    Peer(pixhawk, COMPANION, 7, 191).override(1700)
    run(pixhawk, 1)
    assert pixhawk.surfaces.aileron == pytest.approx(0.5)


def test_after_the_timeout_the_pilots_sticks_have_the_surfaces_in_the_same_mode() -> None:
    pixhawk = make(parameters={"RC_OVERRIDE_TIME": 3.0})
    pixhawk.pilot_sticks = SurfaceCommand(0.0, -0.25, 0.0)
    master(pixhawk).override(1700)
    run(pixhawk, 3 * STEP_HZ - 1)
    assert pixhawk.surfaces.aileron == pytest.approx(0.5)
    run(pixhawk, 1)
    assert pixhawk.surfaces.aileron == pytest.approx(-0.25)
    assert pixhawk.mode == MANUAL
    assert pixhawk.counts.override_timeouts == 1


def test_overrides_time_out_after_three_seconds_exactly() -> None:
    """Without a receiver its own mode takes over."""
    pixhawk = make(parameters={"RC_OVERRIDE_TIME": 3.0})
    run(pixhawk, 10)
    master(pixhawk).override(1700)
    run(pixhawk, 3 * STEP_HZ - 1)
    assert pixhawk.surfaces.aileron == pytest.approx(0.5)
    assert pixhawk.mode == MANUAL
    run(pixhawk, 1)
    assert pixhawk.mode == FBWA
    assert pixhawk.counts.override_timeouts == 1
    assert not pixhawk.is_overridden()


def test_the_timeout_follows_its_parameter_and_minus_one_means_never() -> None:
    pixhawk = make()
    ground(pixhawk).set_parameter("RC_OVERRIDE_TIME", 1.0)
    master(pixhawk).override(1700)
    run(pixhawk, STEP_HZ - 1)
    assert pixhawk.mode == MANUAL
    run(pixhawk, 1)
    assert pixhawk.mode == FBWA

    pixhawk = make(parameters={"RC_OVERRIDE_TIME": -1.0})
    master(pixhawk).override(1700)
    run(pixhawk, 10 * STEP_HZ)
    assert pixhawk.mode == MANUAL


def test_no_failsafe_acts_on_an_aircraft_that_is_held() -> None:
    pixhawk = make()
    master(pixhawk).override(1700)
    run(pixhawk, 4 * STEP_HZ, flying=False)
    assert pixhawk.mode == MANUAL
    assert pixhawk.surfaces.aileron == 0.0


def test_channels_are_released_and_left_one_by_one() -> None:
    pixhawk = make()
    peer = master(pixhawk)
    pixhawk.pilot_sticks = SurfaceCommand(elevator=0.0, aileron=-0.25, rudder=0.0)
    peer.override(1700, 1300, 0, 1655)
    peer.override(0, 65535, 65535, 65535)  # give the aileron back, leave the others
    run(pixhawk, 1)
    assert pixhawk.surfaces.aileron == pytest.approx(-0.25)
    assert pixhawk.surfaces.elevator == pytest.approx(0.5)
    assert pixhawk.surfaces.rudder == pytest.approx(0.5)
    peer.override(0, 0, 0, 0)
    run(pixhawk, 1)
    assert not pixhawk.is_overridden()
    assert pixhawk.surfaces.elevator == 0.0
    run(pixhawk, 4 * STEP_HZ)
    assert pixhawk.mode == MANUAL  # released is not timed out
    assert pixhawk.counts.override_timeouts == 0


def test_a_channel_left_alone_times_out_by_itself() -> None:
    pixhawk = make()
    peer = master(pixhawk)
    peer.override(1700, 1700)
    for _ in range(4 * STEP_HZ):
        peer.override(1700, 65535)  # keeps the aileron only
        run(pixhawk, 1)
    assert pixhawk.surfaces.aileron == pytest.approx(0.5)
    assert pixhawk.surfaces.elevator == 0.0
    assert pixhawk.mode == MANUAL  # one surface is still commanded


def test_high_channels_have_their_own_release_value() -> None:
    pixhawk = make()
    peer = master(pixhawk)
    low = [65535] * 8
    peer.say(mavlink.MAVLink_rc_channels_override_message(1, 1, *low, 1600, 1610))
    peer.say(mavlink.MAVLink_rc_channels_override_message(1, 1, *low, 0, 65534))
    assert pixhawk.outputs.overrides.on(9) == 1600
    assert pixhawk.outputs.overrides.on(10) is None


def test_rc_channels_shows_the_overrides() -> None:
    pixhawk = make()
    master(pixhawk).override(1700, 65535, 1234)
    run(pixhawk, 1)
    companion(pixhawk).command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_RC_CHANNELS)
    [report] = named(collect(pixhawk)[COMPANION], "RC_CHANNELS")
    assert (report.chan1_raw, report.chan2_raw, report.chan3_raw) == (1700, 1500, 1234)
    assert report.chan5_raw == 65535


@given(st.floats(-1.5, 1.5), st.booleans())
def test_deflection_and_pulse_width_are_inverse(deflection: float, reverse: bool) -> None:
    surface = Surface(channel=1, pwm_min=1203, pwm_trim=1497, pwm_max=1850, reversed=reverse)
    wanted = min(max(deflection, -1.0), 1.0)
    back = deflection_from_pwm(surface, pwm_from_deflection(surface, deflection))
    # A pulse width is a whole number of microseconds: half of one over the shorter half.
    assert abs(back - wanted) <= 0.5 / 294 + 1e-12


# --- modes -----------------------------------------------------------------------------------


def test_modes_change_by_command_and_are_reported_at_once() -> None:
    pixhawk = make()
    run(pixhawk, 1)
    peer = ground(pixhawk)
    peer.command(mavlink.MAV_CMD_DO_SET_MODE, 1, FBWA)
    out = collect(pixhawk)
    assert named(out[GROUND], "COMMAND_ACK")[0].result == mavlink.MAV_RESULT_ACCEPTED
    assert named(out[COMPANION], "HEARTBEAT")[0].custom_mode == FBWA
    peer.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 99)
    assert ack(pixhawk, GROUND) == mavlink.MAV_RESULT_FAILED
    peer.command(mavlink.MAV_CMD_DO_SET_MODE, 0, MANUAL)
    assert ack(pixhawk, GROUND) == mavlink.MAV_RESULT_DENIED
    assert pixhawk.mode == FBWA
    peer.say(mavlink.MAVLink_set_mode_message(1, 1, MANUAL))
    assert named(collect(pixhawk)[GROUND], "HEARTBEAT")[0].custom_mode == MANUAL


def test_in_fbwa_overrides_are_sticks_and_level_flight_has_the_surfaces() -> None:
    pixhawk = make(trim_pitch_rad=0.1)
    pixhawk.set_mode(FBWA, "test")
    run(pixhawk, 1, pitch=0.1)
    level = pixhawk.surfaces.elevator
    assert abs(level) < 0.01
    run(pixhawk, 1, pitch=0.0)
    assert pixhawk.surfaces.elevator > level + 0.1  # nose below trim: pull
    # Elevator is reversed: a low pulse width asks for nose up.
    master(pixhawk).override(65535, 1100)
    run(pixhawk, 1, pitch=0.1)
    assert 0.3 < pixhawk.surfaces.elevator < 0.8  # a pitch asked for, not a full deflection


def test_disarming_in_flight_needs_force() -> None:
    pixhawk = make()
    run(pixhawk, 1)
    peer = companion(pixhawk)
    peer.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0)
    assert ack(pixhawk) == mavlink.MAV_RESULT_FAILED
    peer.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 21196)
    heartbeats = named(collect(pixhawk)[GROUND], "HEARTBEAT")
    assert not heartbeats[0].base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED


def test_an_unknown_command_is_unsupported() -> None:
    pixhawk = make()
    companion(pixhawk).command(mavlink.MAV_CMD_NAV_TAKEOFF)
    assert ack(pixhawk) == mavlink.MAV_RESULT_UNSUPPORTED


# --- streams ---------------------------------------------------------------------------------


@pytest.mark.parametrize("rate_hz", [200, 100, 50, 40, 25, 8, 1])
def test_a_stream_has_exactly_the_rate_that_was_asked_for(rate_hz: int) -> None:
    pixhawk = make()
    companion(pixhawk).command(
        mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ATTITUDE_QUATERNION, 1e6 / rate_hz
    )
    out = run(pixhawk, 10 * STEP_HZ)
    assert len(named(out[COMPANION], "ATTITUDE_QUATERNION")) == 10 * rate_hz
    assert not named(out[GROUND], "ATTITUDE_QUATERNION")


def test_an_interval_that_does_not_divide_the_step_is_rounded_and_reported() -> None:
    pixhawk = make()
    peer = companion(pixhawk)
    peer.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ATTITUDE_QUATERNION, 1e6 / 60)
    assert ack(pixhawk) == mavlink.MAV_RESULT_ACCEPTED
    peer.command(mavlink.MAV_CMD_GET_MESSAGE_INTERVAL, ATTITUDE_QUATERNION)
    [report] = named(collect(pixhawk)[COMPANION], "MESSAGE_INTERVAL")
    assert report.interval_us == 15000  # 3 steps of 5 ms
    out = run(pixhawk, 3 * STEP_HZ)
    assert len(named(out[COMPANION], "ATTITUDE_QUATERNION")) == STEP_HZ


def test_a_stream_faster_than_its_sensor_sends_each_sample_once() -> None:
    pixhawk = make()
    companion(pixhawk).command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, LOCAL_POSITION_NED, 5000)
    out: dict[int, list[Any]] = {GROUND: [], COMPANION: []}
    for step in range(1, 2 * STEP_HZ + 1):
        every_fourth = sensed(step)._replace(position=sensed(1 + step // 4).position)
        pixhawk.step(every_fourth)
        collect(pixhawk, out)
    fixes = named(out[COMPANION], "LOCAL_POSITION_NED")
    assert len(fixes) == 1 + 2 * STEP_HZ // 4
    assert len({fix.time_boot_ms for fix in fixes}) == len(fixes)


def test_samples_are_stamped_with_when_they_were_true() -> None:
    pixhawk = make(uptime_s=7.0)
    companion(pixhawk).command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ATTITUDE_QUATERNION, 5000)
    out = run(pixhawk, 3)
    stamps = [m.time_boot_ms for m in named(out[COMPANION], "ATTITUDE_QUATERNION")]
    assert stamps == [7000, 7005, 7010]  # one step old when sent at 7005, 7010, 7015


def test_the_boot_clock_wraps() -> None:
    pixhawk = make(uptime_s=2**32 / 1e3 - 0.005)
    companion(pixhawk).command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ATTITUDE_QUATERNION, 5000)
    out = run(pixhawk, 3)
    stamps = [m.time_boot_ms for m in named(out[COMPANION], "ATTITUDE_QUATERNION")]
    assert stamps == [2**32 - 5, 0, 5]


@pytest.mark.parametrize(
    ("loop_hz", "rate_hz", "result"),
    [
        (50, 40, mavlink.MAV_RESULT_ACCEPTED),
        (50, 41, mavlink.MAV_RESULT_DENIED),
        (200, 160, mavlink.MAV_RESULT_ACCEPTED),
        (200, 200, mavlink.MAV_RESULT_DENIED),
        (250, 200, mavlink.MAV_RESULT_ACCEPTED),
        (400, 320, mavlink.MAV_RESULT_ACCEPTED),
        (400, 333, mavlink.MAV_RESULT_DENIED),
    ],
)
def test_rates_above_the_fraction_of_the_loop_are_denied(
    loop_hz: int, rate_hz: int, result: int
) -> None:
    """Measured: 0.8 of SCHED_LOOP_RATE is the limit."""
    pixhawk = make(parameters={"SCHED_LOOP_RATE": float(loop_hz)})
    peer = companion(pixhawk)
    peer.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ATTITUDE_QUATERNION, 1e6 / rate_hz)
    assert ack(pixhawk) == result


def test_odometry_is_denied_unless_allowed() -> None:
    odometry = mavlink.MAVLINK_MSG_ID_ODOMETRY
    pixhawk = make()
    companion(pixhawk).command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, odometry, 10000)
    assert ack(pixhawk) == mavlink.MAV_RESULT_DENIED
    companion(pixhawk).command(
        mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, mavlink.MAVLINK_MSG_ID_WIND_COV, 10000
    )
    assert ack(pixhawk) == mavlink.MAV_RESULT_DENIED

    pixhawk = make(allow_odometry=True)
    companion(pixhawk).command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, odometry, 10000)
    message = named(run(pixhawk, 2, pitch=0.3)[COMPANION], "ODOMETRY")[0]
    assert (message.frame_id, message.child_frame_id) == (1, 12)
    assert (message.x, message.y, message.z) == (1.0, 2.0, -3.0)
    # Velocity is in the body: nose-up by 0.3 rad, level wings, facing north.
    assert message.vx == pytest.approx(0.1 * cos(0.3) - 0.3 * sin(0.3), abs=1e-6)
    assert message.vy == pytest.approx(0.2, abs=1e-6)
    assert message.vz == pytest.approx(0.1 * sin(0.3) + 0.3 * cos(0.3), abs=1e-6)


def test_a_ground_station_gets_slow_streams_unasked_and_a_companion_only_the_heartbeat() -> None:
    out = run(make(), 5 * STEP_HZ)
    companions = Counter(m.get_type() for m in out[COMPANION])
    assert companions == {"HEARTBEAT": 5}
    stations = Counter(m.get_type() for m in out[GROUND])
    assert stations["HEARTBEAT"] == 5
    assert stations["LOCAL_POSITION_NED"] == 20
    assert stations["SERVO_OUTPUT_RAW"] == 10


def test_a_companion_that_sets_its_pace_by_us_gets_every_attitude_unasked_and_last() -> None:
    pixhawk = make()
    pixhawk.set_pace(COMPANION)
    pixhawk.set_pace(77)
    companion(pixhawk).command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, LOCAL_POSITION_NED, 2e4)
    out = run(pixhawk, STEP_HZ)[COMPANION]
    assert len(named(out, "ATTITUDE_QUATERNION")) == STEP_HZ
    names = [m.get_type() for m in out if m.get_type() != "HEARTBEAT"]
    before = [names[i + 1] for i, name in enumerate(names) if name == "LOCAL_POSITION_NED"]
    assert before
    assert set(before) == {"ATTITUDE_QUATERNION"}


def test_streams_stop_and_return_to_their_default() -> None:
    pixhawk = make()
    peer = ground(pixhawk)
    peer.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, LOCAL_POSITION_NED, -1)
    assert not named(run(pixhawk, STEP_HZ)[GROUND], "LOCAL_POSITION_NED")
    peer.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, LOCAL_POSITION_NED, 0)
    assert len(named(run(pixhawk, STEP_HZ)[GROUND], "LOCAL_POSITION_NED")) == 4


def test_by_default_a_companion_is_streamed_nothing() -> None:
    """As in ArduPlane, whose SRx rates of a companion's port are 0 until they are set."""
    pixhawk = make()
    peer = companion(pixhawk)
    peer.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, LOCAL_POSITION_NED, 20_000)
    assert named(run(pixhawk, STEP_HZ)[COMPANION], "LOCAL_POSITION_NED")
    peer.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, LOCAL_POSITION_NED, 0)
    assert not named(run(pixhawk, STEP_HZ)[COMPANION], "LOCAL_POSITION_NED")


def test_older_stations_ask_for_groups_of_streams() -> None:
    pixhawk = make()
    peer = ground(pixhawk)
    peer.say(mavlink.MAVLink_request_data_stream_message(1, 1, 0, 0, 0))  # all, stop
    assert {m.get_type() for m in run(pixhawk, STEP_HZ)[GROUND]} == {"HEARTBEAT"}
    group = mavlink.MAV_DATA_STREAM_EXTRA1
    peer.say(mavlink.MAVLink_request_data_stream_message(1, 1, group, 10, 1))
    assert len(named(run(pixhawk, STEP_HZ)[GROUND], "ATTITUDE")) == 10


def test_timesync_is_answered_on_its_link_and_answers_are_noted() -> None:
    pixhawk = make(uptime_s=1.0)
    peer = companion(pixhawk)
    run(pixhawk, STEP_HZ)
    peer.say(mavlink.MAVLink_timesync_message(0, 12345))
    out = collect(pixhawk)
    [answer] = named(out[COMPANION], "TIMESYNC")
    assert (answer.tc1, answer.ts1) == (2_000_000_000, 12345)
    assert not out[GROUND]
    peer.say(mavlink.MAVLink_timesync_message(999, 777))
    assert pixhawk.timesync_answer_ns(COMPANION) == 777
    assert not collect(pixhawk)[GROUND]


# --- parameters ------------------------------------------------------------------------------


def test_the_list_is_complete_and_contiguous() -> None:
    pixhawk = make()
    ground(pixhawk).say(mavlink.MAVLink_param_request_list_message(1, 0))
    values = named(run(pixhawk, STEP_HZ)[GROUND], "PARAM_VALUE")
    count = values[0].param_count
    assert [value.param_index for value in values] == list(range(count))
    types = {value.param_id: value.param_type for value in values}
    assert types["RC_OVERRIDE_TIME"] == mavlink.MAV_PARAM_TYPE_REAL32
    assert types["SYSID_MYGCS"] == mavlink.MAV_PARAM_TYPE_INT16
    assert types["VISO_TYPE"] == mavlink.MAV_PARAM_TYPE_INT8
    assert {value.param_id for value in values} >= {"SYSID_MYGCS", "RC1_TRIM", "SERVO4_REVERSED"}


def test_parameters_are_read_by_name_and_index_and_broadcast_when_set() -> None:
    pixhawk = make()
    peer = companion(pixhawk)
    peer.say(mavlink.MAVLink_param_request_read_message(1, 1, b"SYSID_MYGCS", -1))
    [by_name] = named(collect(pixhawk)[COMPANION], "PARAM_VALUE")
    assert by_name.param_index == 65535
    index = pixhawk.parameters.names.index("SYSID_MYGCS")
    peer.say(mavlink.MAVLink_param_request_read_message(1, 1, b"", index))
    [by_index] = named(collect(pixhawk)[COMPANION], "PARAM_VALUE")
    assert by_index.param_id == "SYSID_MYGCS"
    assert by_index.param_value == 255.0
    peer.set_parameter("SYSID_MYGCS", 254.0)
    out = collect(pixhawk)
    for link in (GROUND, COMPANION):
        assert named(out[link], "PARAM_VALUE")[0].param_value == 254.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("SYSID_MYGCS", float("nan")),
        ("SYSID_MYGCS", 256.0),
        ("RC_OVERRIDE_TIME", float("inf")),
        ("RC1_MIN", 1500.0),  # not below the trim
        ("SERVO2_REVERSED", 2.0),
    ],
)
def test_a_value_that_cannot_be_is_answered_with_the_unchanged_one(name: str, value: float) -> None:
    pixhawk = make()
    before = pixhawk.parameters[name]
    ground(pixhawk).set_parameter(name, value)
    [answer] = named(collect(pixhawk)[GROUND], "PARAM_VALUE")
    assert answer.param_value == before == pixhawk.parameters[name]


def test_an_unknown_parameter_meets_silence() -> None:
    pixhawk = make()
    ground(pixhawk).set_parameter("TGL_X", 1.0)
    assert not collect(pixhawk)[GROUND]


def test_a_set_for_an_silent_component_is_executed_by_the_autopilot() -> None:
    """The measured trap: before the companion has sent anything, its messages are executed."""
    pixhawk = make()
    station = ground(pixhawk)
    station.set_parameter("SYSID_MYGCS", 9.0, target=(1, 191))
    assert pixhawk.parameters["SYSID_MYGCS"] == 9.0
    collect(pixhawk)
    companion(pixhawk).heartbeat()
    collect(pixhawk)
    raw = station.set_parameter("SYSID_MYGCS", 10.0, target=(1, 191))
    assert pixhawk.parameters["SYSID_MYGCS"] == 9.0
    assert pixhawk.take_datagrams() == [(COMPANION, raw)]


def test_a_wrong_start_value_is_named() -> None:
    with pytest.raises(ValueError, match=r"SYSID_MYGCS = 300.*out of range"):
        make(parameters={"SYSID_MYGCS": 300.0})


# --- routing ---------------------------------------------------------------------------------


def three_links() -> tuple[Pixhawk, Peer, Peer, Peer]:
    pixhawk = make()
    pixhawk.add_link(RADIO, ground=True)
    peers = ground(pixhawk), companion(pixhawk), Peer(pixhawk, RADIO, 254, 190)
    for peer in peers:
        peer.heartbeat()
    collect(pixhawk)
    return pixhawk, *peers


def links_of(pixhawk: Pixhawk) -> set[int]:
    return {link for link, _ in pixhawk.take_datagrams()}


def test_heartbeats_reach_every_other_link() -> None:
    pixhawk = make()
    pixhawk.add_link(RADIO, ground=True)
    companion(pixhawk).heartbeat()
    assert links_of(pixhawk) == {GROUND, RADIO}
    # The same station on two links is not sent its own messages.
    ground(pixhawk).heartbeat()
    assert links_of(pixhawk) == {COMPANION, RADIO}
    Peer(pixhawk, RADIO, 255, 190).heartbeat()
    assert links_of(pixhawk) == {COMPANION}


def test_where_each_kind_of_frame_goes() -> None:
    pixhawk, station, module, _other = three_links()
    value = mavlink.MAVLink_param_value_message(b"TGL_X", 1.0, 9, 50, 3)
    text = mavlink.MAVLink_statustext_message(6, b"soaring")
    named_value = mavlink.MAVLink_named_value_float_message(0, b"e_rho", 0.1)
    for message in (value, text, named_value):
        raw = module.say(message)
        assert sorted(pixhawk.take_datagrams()) == [(GROUND, raw), (RADIO, raw)]

    # To the companion, from one station: no other link gets it, and it is not executed here.
    station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, FBWA, target=(1, 191))
    assert links_of(pixhawk) == {COMPANION}
    assert pixhawk.mode == MANUAL
    # To one station only.
    module.say(mavlink.MAVLink_command_ack_message(176, 0, 0, 0, 254, 190))
    assert links_of(pixhawk) == {RADIO}
    # To every component of this vehicle: both the companion and the autopilot.
    station.say(mavlink.MAVLink_param_request_list_message(1, 0))
    assert links_of(pixhawk) == {COMPANION}
    assert named(run(pixhawk, 5)[GROUND], "PARAM_VALUE")
    # To the autopilot alone.
    station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, FBWA)
    assert named(collect(pixhawk)[GROUND], "COMMAND_ACK")
    assert pixhawk.mode == FBWA
    # To a vehicle that is not there.
    station.command(mavlink.MAV_CMD_DO_SET_MODE, 1, MANUAL, target=(42, 1))
    assert links_of(pixhawk) == set()
    assert pixhawk.mode == FBWA


def test_frames_are_sent_on_byte_for_byte_in_both_versions_and_signed() -> None:
    pixhawk, _, module, _ = three_links()
    text = mavlink.MAVLink_statustext_message(6, b"one")
    v1 = bytes(text.pack(module.codec, force_mavlink1=True))
    pixhawk.receive(COMPANION, v1)
    assert v1[0] == 0xFE
    assert (GROUND, v1) in pixhawk.take_datagrams()

    module.codec.signing.secret_key = b"k" * 32
    module.codec.signing.sign_outgoing = True
    signed = module.say(mavlink.MAVLink_statustext_message(6, b"two"))
    assert signed[2] == 1
    assert (GROUND, signed) in pixhawk.take_datagrams()


def test_a_link_that_is_gone_is_no_way_to_anyone() -> None:
    pixhawk, station, _, _ = three_links()
    pixhawk.remove_link(COMPANION)
    assert pixhawk.links.routes_to(1, 191) == ()
    station.set_parameter("SYSID_MYGCS", 9.0, target=(1, 191))
    assert links_of(pixhawk) == {GROUND, RADIO}  # executed here again, and passed on to all


def test_a_stranger_with_the_autopilots_name_is_ignored_and_reported() -> None:
    pixhawk = make()
    Peer(pixhawk, GROUND, 1, 1).heartbeat()
    assert links_of(pixhawk) == set()
    [event] = pixhawk.take_events()
    assert "this autopilot" in event
    assert pixhawk.links.routes_to(1, 1) == ()


def test_a_flood_of_identities_fills_a_table_and_no_more() -> None:
    pixhawk = make()
    companion(pixhawk).heartbeat()
    for system in range(2, 250):
        Peer(pixhawk, GROUND, system, 7).heartbeat()
    known = sum(bool(pixhawk.links.routes_to(system, 7)) for system in range(2, 250))
    assert known == MAX_ROUTES - 1
    assert pixhawk.links.routes_to(1, 191) == (COMPANION,)


# --- whatever arrives ------------------------------------------------------------------------

MESSAGE_IDS = sorted(mavlink.mavlink_map)


def forged(
    message_id: int, payload: bytes, system: int, component: int, *, signed: bool = False
) -> bytes:
    """A frame with a right checksum and any payload."""
    payload = payload[:255]
    flags = 1 if signed else 0
    header = bytes([len(payload), flags, 0, 0, system, component])
    body = header + message_id.to_bytes(3, "little") + payload
    crc = mavlink.x25crc(body)
    crc.accumulate(bytes([mavlink.mavlink_map[message_id].crc_extra]))
    checksum = int(crc.crc).to_bytes(2, "little")
    return b"\xfd" + body + checksum + (b"s" * 13 if signed else b"")


def assert_sane(pixhawk: Pixhawk) -> None:
    run(pixhawk, 2)
    assert all(isfinite(value) and abs(value) <= 1.0 for value in pixhawk.surfaces)
    assert pixhawk.mode in (MANUAL, FBWA)


@given(st.lists(st.binary(max_size=600), max_size=5))
def test_noise_is_no_message(chunks: list[bytes]) -> None:
    pixhawk = make()
    for chunk in chunks:
        pixhawk.receive(GROUND, chunk)
    assert_sane(pixhawk)


@settings(max_examples=300)
@given(
    st.lists(
        st.tuples(
            st.sampled_from(MESSAGE_IDS),
            st.binary(max_size=255),
            st.sampled_from([0, 1, 2, 255]),
            st.sampled_from([0, 1, 190, 191]),
            st.booleans(),
        ),
        max_size=8,
    ),
    st.binary(max_size=20),
)
def test_any_message_with_any_content_is_survived(
    frames: list[tuple[int, bytes, int, int, bool]], noise: bytes
) -> None:
    pixhawk = make()
    data = b"".join(
        noise + forged(message_id, payload, system, component, signed=signed)
        for message_id, payload, system, component, signed in frames
    )
    pixhawk.receive(COMPANION, data)
    assert_sane(pixhawk)


# The messages that it acts on, by name, so that the search spends its time there.
HANDLED = [
    mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE,
    mavlink.MAVLINK_MSG_ID_PARAM_SET,
    mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ,
    mavlink.MAVLINK_MSG_ID_TIMESYNC,
    mavlink.MAVLINK_MSG_ID_SET_MODE,
    mavlink.MAVLINK_MSG_ID_REQUEST_DATA_STREAM,
    mavlink.MAVLINK_MSG_ID_MISSION_REQUEST_LIST,
]


@settings(max_examples=300)
@given(st.sampled_from(HANDLED), st.binary(min_size=40, max_size=60))
def test_the_messages_it_acts_on_survive_any_content(message_id: int, payload: bytes) -> None:
    pixhawk = make()
    pixhawk.receive(COMPANION, forged(message_id, payload, 255, 191))
    assert_sane(pixhawk)


@settings(max_examples=300)
@given(
    st.sampled_from([511, 510, 512, 520, 176, 400, 1, 65535]),
    st.lists(st.floats(width=32), min_size=7, max_size=7),
)
def test_commands_survive_any_numbers(command: int, values: list[float]) -> None:
    pixhawk = make()
    companion(pixhawk).command(command, *values)
    assert named(collect(pixhawk)[COMPANION], "COMMAND_ACK")
    assert_sane(pixhawk)


def test_a_datagram_made_to_waste_time_is_given_up() -> None:
    """Every eighth byte begins what may be a frame, and none is."""
    codec = CountingCodec(None)
    waste = bytes([0xFE, 0, 0, 0, 0, 0, 1, 1]) * 500
    assert split_frames(codec, waste) == ([], len(waste))
    assert codec.decoded == 32


class CountingCodec(mavlink.MAVLink):  # type: ignore[misc]
    """Counts how often it is asked to decode."""

    decoded = 0

    def decode(self, msgbuf: bytearray) -> Any:
        self.decoded += 1
        return super().decode(msgbuf)


def test_a_damaged_frame_does_not_take_the_next_one_with_it() -> None:
    pixhawk = make()
    peer = master(pixhawk)
    good = peer.raw(mavlink.MAVLink_rc_channels_override_message(1, 1, 1700, *([65535] * 7)))
    damaged = bytearray(good)
    damaged[12] ^= 0xFF
    pixhawk.receive(COMPANION, bytes(damaged) + b"\xfd\xfe\xfd" + good)
    run(pixhawk, 1)
    assert pixhawk.counts.overrides_accepted == 1
    assert pixhawk.surfaces.aileron == pytest.approx(0.5)


def test_before_the_first_sample_no_sensor_stream_goes_out() -> None:
    pixhawk = make()
    companion(pixhawk).command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, ATTITUDE_QUATERNION, 5000)
    collect(pixhawk)
    for _ in range(STEP_HZ):
        pixhawk.step(Sensed(attitude=NO_ATTITUDE, position=NO_FIX, airspeed_mps=8.5, flying=True))
    assert {m.get_type() for m in collect(pixhawk)[COMPANION]} == {"HEARTBEAT"}
    companion(pixhawk).command(mavlink.MAV_CMD_REQUEST_MESSAGE, LOCAL_POSITION_NED)
    assert ack(pixhawk) == mavlink.MAV_RESULT_FAILED


def test_a_throttle_follows_its_override_and_is_the_pilots_closed_one_without() -> None:
    surfaces = load_airframe(shipped("airframes/eclipson_c_propeller.toml")).surfaces
    pixhawk = Pixhawk(surfaces, STEP_HZ)
    pixhawk.add_link(GROUND, ground=True)
    pixhawk.add_link(COMPANION, ground=False)
    run(pixhawk, 1)
    assert pixhawk.outputs.throttle == 0.0
    master(pixhawk).override(1500, 1500, 1600, 1500)
    run(pixhawk, 1)
    assert pixhawk.outputs.throttle == pytest.approx(0.6)
    master(pixhawk).override(1500, 1500, 0, 1500)  # released
    run(pixhawk, 1)
    assert pixhawk.outputs.throttle == 0.0
    master(pixhawk).override(1500, 1500, 1600, 1500)
    run(pixhawk, STEP_HZ)  # it is not repeated
    assert pixhawk.outputs.throttle == 0.0
