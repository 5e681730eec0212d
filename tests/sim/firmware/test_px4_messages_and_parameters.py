"""What PX4 is sent at every step, number by number, and what it is set to before a flight, with
the reason for each parameter."""

from __future__ import annotations

import math
import socket
from collections.abc import Iterator
from typing import Any

import pytest
from firmware_step import AIRFRAME, NO_STICKS, READINGS
from pymavlink.dialects.v20 import common as mavlink

from tgl_soar.link.autopilots.px4 import MODE_MANUAL, MODE_OFFBOARD
from tgl_soar.sim.firmware import FirmwareError, px4
from tgl_soar.sim.firmware.px4 import (
    BENCH,
    GAINS,
    POSE_PARAMETERS,
    Px4Physics,
    flight_parameters,
    hil_gps,
    hil_sensor,
    output_parameters,
    rc_channels,
)
from tgl_soar.sim.firmware.sensors import GpsPlace
from tgl_soar.sim.firmware.simulation import NO_PULSES, THROTTLE_LOW, Sticks
from tgl_soar.types import SurfaceCommand

PLACE = GpsPlace(51.99, 4.375, 12.34, (3.0, -4.0, 12.0))


@pytest.fixture
def physics() -> Iterator[Px4Physics]:
    made = Px4Physics(AIRFRAME.surfaces, 0)
    yield made
    made.close()


@pytest.fixture
def client(physics: Px4Physics) -> Iterator[socket.socket]:
    """PX4's end of the connection: what it is to answer is sent ahead."""
    with socket.create_connection(("127.0.0.1", physics.port), timeout=5.0) as end:
        assert physics.connect(5.0)
        yield end


def answer(controls: list[float], *, armed: bool = True) -> bytes:
    codec = mavlink.MAVLink(None, 1, 1)
    mode = mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else mavlink.MAV_MODE_FLAG_HIL_ENABLED
    controls = [*controls, *[0.0] * (16 - len(controls))]
    return bytes(mavlink.MAVLink_hil_actuator_controls_message(0, controls, mode, 0).pack(codec))


def received(client: socket.socket) -> list[Any]:
    codec = mavlink.MAVLink(None)
    return list(codec.parse_buffer(bytearray(client.recv(65536))) or ())


# --- one step -------------------------------------------------------------------------------------


def test_the_modes_are_px4s_main_modes_in_the_third_byte() -> None:
    """px4_custom_mode.h: MANUAL 1, OFFBOARD 6, in bits 16 to 23."""
    assert MODE_MANUAL == 65536
    assert MODE_OFFBOARD == 393216
    assert Px4Physics.manual_mode == 65536
    assert Px4Physics.obeys == {
        "SET_ATTITUDE_TARGET": 393216,
        "SET_ACTUATOR_CONTROL_TARGET": 393216,
        "MANUAL_CONTROL": 65536,
    }


def test_it_steps_250_times_a_second_and_has_its_home_by_itself() -> None:
    assert (Px4Physics.name, Px4Physics.step_hz) == ("PX4", 250)
    assert Px4Physics.first_item == 1
    assert Px4Physics.throttle == 0.0


def test_a_mode_is_asked_for_by_its_main_mode(physics: Px4Physics) -> None:
    asked = physics.ask_for_mode(7, MODE_OFFBOARD)
    assert (asked.target_system, asked.target_component) == (7, 1)
    assert (asked.command, asked.confirmation) == (mavlink.MAV_CMD_DO_SET_MODE, 0)
    assert asked.param1 == mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    assert asked.param2 == 6.0
    rest = [asked.param3, asked.param4, asked.param5, asked.param6, asked.param7]
    assert rest == [0.0] * 5


def test_it_needs_no_help(physics: Px4Physics) -> None:
    assert physics.helped(READINGS, ()) is None


def test_it_is_neither_armed_nor_answered_before_the_first_step(physics: Px4Physics) -> None:
    assert not physics.armed
    assert physics.answers == 0
    assert not physics.connect(0.0)


def test_armed_is_what_the_answer_says(physics: Px4Physics, client: socket.socket) -> None:
    client.sendall(answer([0.0], armed=True))
    physics.exchange(READINGS, NO_STICKS)
    assert physics.armed
    client.sendall(answer([0.0], armed=False))
    physics.exchange(READINGS, NO_STICKS)
    assert not physics.armed
    assert physics.answers == 2


def test_of_several_answers_the_newest_counts(physics: Px4Physics, client: socket.socket) -> None:
    client.sendall(answer([0.1, 0.2]) + answer([0.3, 0.4]))
    command = physics.exchange(READINGS, NO_STICKS)
    assert (command.elevator, command.aileron) == pytest.approx((0.4, 0.3))
    assert physics.answers == 1


def test_other_messages_are_no_answer(
    physics: Px4Physics, client: socket.socket, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(px4, "UNANSWERED_S", 0.01)
    beat = mavlink.MAVLink_heartbeat_message(1, 12, 0, 0, 4, 3)
    client.sendall(beat.pack(mavlink.MAVLink(None, 1, 1)))
    assert physics.exchange(READINGS, NO_STICKS) == (0.0, 0.0, 0.0, 0.0)
    assert physics.answers == 0


def test_bytes_that_are_no_message_are_passed_over(
    physics: Px4Physics, client: socket.socket
) -> None:
    client.sendall(b"\x00\x01?" + answer([0.0, 0.5]))
    assert physics.exchange(READINGS, NO_STICKS).elevator == 0.5


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_an_output_that_is_no_number_is_neutral(
    physics: Px4Physics, client: socket.socket, value: float
) -> None:
    client.sendall(answer([0.25, value, 0.0, -0.5]))
    assert physics.exchange(READINGS, NO_STICKS) == (0.0, 0.25, -0.5, 0.0)


def test_a_fix_goes_with_the_step_that_has_it(physics: Px4Physics, client: socket.socket) -> None:
    for gps, kinds in (
        (None, ["HIL_SENSOR", "RC_CHANNELS"]),  # the transmitter in the first of every five steps
        (PLACE, ["HIL_SENSOR", "HIL_GPS"]),
        (None, ["HIL_SENSOR"]),
        (None, ["HIL_SENSOR"]),
        (None, ["HIL_SENSOR"]),
        (None, ["HIL_SENSOR", "RC_CHANNELS"]),
    ):
        client.sendall(answer([0.0]))
        physics.exchange(READINGS._replace(gps=gps), NO_STICKS)
        messages = received(client)
        assert [message.get_type() for message in messages] == kinds
        assert all((m.get_srcSystem(), m.get_srcComponent()) == (1, 1) for m in messages)
        for message in messages:
            if message.get_type() == "HIL_GPS":  # at 1.0025 s after midnight of 2026-01-01, UTC
                assert message.time_usec == 1_767_225_601_002_500
            elif message.get_type() == "RC_CHANNELS":
                assert message.time_boot_ms == 1002
            else:
                assert message.time_usec == 1_002_500


@pytest.mark.parametrize("signal", [NO_PULSES, THROTTLE_LOW])
def test_without_a_signal_the_receiver_sends_nothing(
    physics: Px4Physics, client: socket.socket, signal: int
) -> None:
    client.sendall(answer([0.0]))
    physics.exchange(READINGS, NO_STICKS._replace(signal=signal))
    assert [message.get_type() for message in received(client)] == ["HIL_SENSOR"]


def test_closed_it_leaves_its_firmware_and_its_port(
    physics: Px4Physics, client: socket.socket
) -> None:
    physics.close()
    assert client.recv(10) == b""  # the other end has gone
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", physics.port), timeout=5.0)


def test_a_port_that_no_computer_has_is_refused() -> None:
    with pytest.raises(FirmwareError, match="TCP port 70000, where PX4 looks for its simulator"):
        Px4Physics(AIRFRAME.surfaces, 70000)


# --- its messages ---------------------------------------------------------------------------------


def test_every_sensor_stands_in_its_own_field() -> None:
    sent = hil_sensor(READINGS)
    assert sent.time_usec == 1_002_500
    assert (sent.xacc, sent.yacc, sent.zacc) == (0.1, 0.2, -9.8)
    assert (sent.xgyro, sent.ygyro, sent.zgyro) == (0.01, 0.02, 0.03)
    assert (sent.xmag, sent.ymag, sent.zmag) == (0.2, 0.0, 0.45)
    assert (sent.pressure_alt, sent.temperature) == (10.5, 15.0)


@pytest.mark.parametrize(
    ("field", "bits"),
    [
        ("magnetic_frd_gauss", {6, 7, 8}),
        ("pressure_pa", {9, 11, 12}),  # absolute pressure, its height, temperature
        ("differential_pressure_pa", {10}),
    ],
)
def test_what_has_no_new_reading_is_zero_and_not_marked(field: str, bits: set[int]) -> None:
    """By HIL_SENSOR_UPDATED_FLAGS: bit 6 the first of the magnetometer's, 9 of the barometer's."""
    missing: dict[str, Any] = {field: None}
    sent = hil_sensor(READINGS._replace(**missing))
    marked = {i for i in range(32) if sent.fields_updated >> i & 1}
    assert marked == set(range(13)) - bits
    values = {
        "magnetic_frd_gauss": (sent.xmag, sent.ymag, sent.zmag),
        "pressure_pa": (sent.abs_pressure,),
        "differential_pressure_pa": (sent.diff_pressure,),
    }
    assert not any(values[field])
    assert all(any(each) for name, each in values.items() if name != field)


def test_a_fix_has_its_time_speed_and_accuracy() -> None:
    sent = hil_gps(PLACE, 7)
    assert sent.time_usec == 1_767_225_600_000_007
    assert (sent.fix_type, sent.satellites_visible) == (3, 12)
    assert (sent.vn, sent.ve, sent.vd, sent.vel) == (300, -400, 1200, 1300)  # 3, 4, 12: 13
    assert (sent.eph, sent.epv, sent.cog) == (60, 80, 65535)


def test_a_speed_beyond_the_field_is_limited_to_327_metres_a_second() -> None:
    sent = hil_gps(PLACE._replace(velocity_ned_mps=(326.0, 400.0, -400.0)), 0)
    assert (sent.vn, sent.ve, sent.vd) == (32600, 32700, -32700)


def test_each_stick_moves_its_channel_about_1500_by_500() -> None:
    sticks = Sticks(SurfaceCommand(0.2, 0.4, -0.6))
    sent = rc_channels(sticks, 1234)
    pulses = [getattr(sent, f"chan{i}_raw") for i in range(1, 19)]
    # Roll, pitch (pulled is low), throttle (closed), yaw, the mode switch.
    assert pulses == [1700, 1400, 1000, 1200, 1000, *[1500] * 13]
    assert (sent.time_boot_ms, sent.chancount, sent.rssi) == (1234, 8, 255)
    beyond = rc_channels(Sticks(SurfaceCommand(-2.0, -2.0, 2.0)), 0)
    assert (beyond.chan1_raw, beyond.chan2_raw, beyond.chan4_raw) == (1000, 2000, 2000)


# --- its parameters -------------------------------------------------------------------------------


def test_an_aircraft_of_three_surfaces_without_a_rotor_is_described() -> None:
    """CA_SV_CS_TYPE: 3 elevator, 15 single channel aileron, 4 rudder; each with its own torque."""
    given = output_parameters(AIRFRAME.surfaces)
    for name, value in {"CA_AIRFRAME": 1, "CA_ROTOR_COUNT": 0, "CA_SV_CS_COUNT": 3}.items():
        assert given[name] == value
    kinds = [given[f"CA_SV_CS{i}_TYPE"] for i in range(3)]
    assert kinds == [3, 15, 4]
    torques = [[given[f"CA_SV_CS{i}_TRQ_{axis}"] for axis in "PRY"] for i in range(3)]
    assert torques == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    assert len(given) == 3 + 3 * (1 + 3 + 1)


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        ("SDLOG_MODE", -1, "no log of its own"),
        ("CBRK_SUPPLY_CHK", 894281, "the number that breaks the check of the battery"),
        ("COM_LOW_BAT_ACT", 0, "a battery that is not there only warns"),
        ("COM_DISARM_LAND", -1, "not disarmed as it seems to have landed"),
        ("COM_DISARM_PRFLT", -1, "nor as it does not take off"),
        ("NAV_DLL_ACT", 0, "nothing where the ground station is lost"),
        ("NAV_RCL_ACT", 1, "hold where the radio is lost"),
        ("COM_RCL_EXCEPT", 4, "bit 2: not in OFFBOARD"),
        ("GF_ACTION", 0, "no fence"),
        ("EKF2_FUSE_BETA", 0, "no wind from behind"),
        ("EKF2_ARSP_THR", 5.0, "of airspeeds that it hovers at"),
        ("FD_FAIL_P", 0, "no pitch is a failure"),
        ("FD_FAIL_R", 0, "no bank is a failure"),
        ("COM_OF_LOSS_T", 0.5, "a silent companion, s"),
        ("COM_OBL_RC_ACT", 2, "then Stabilized: the pilot's"),
        ("COM_RC_LOSS_T", 0.5, "a silent radio, s"),
        ("RC_CHAN_CNT", 8, "as many as `rc_channels` counts"),
        ("RC_MAP_ROLL", 1, "the channel of the roll stick"),
        ("RC_MAP_PITCH", 2, "of the pitch stick"),
        ("RC_MAP_THROTTLE", 3, "of the throttle"),
        ("RC_MAP_YAW", 4, "of the rudder stick"),
        ("RC_MAP_FLTMODE", 5, "of the mode switch"),
        ("COM_FLTMODE1", 0, "Manual where the switch is low"),
        ("COM_FLTMODE6", 8, "Stabilized where the pilot takes over"),
        ("EKF2_GPS_DELAY", 100, "ms, as the receiver of our world"),
    ],
)
def test_nothing_takes_the_aircraft_from_whoever_flies_it(
    name: str, value: float, why: str
) -> None:
    assert BENCH[name] == value, why
    assert flight_parameters(AIRFRAME, gps=True, by_sticks=False)[name] == value


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        ("SYS_HAS_GPS", 0, "it waits for none"),
        ("EKF2_GPS_CTRL", 0, "and fuses none"),
        ("EKF2_EV_CTRL", 0b1011, "horizontal position, vertical position, yaw; no velocity"),
        ("EKF2_EV_DELAY", 0, "ms: poses have stamps"),
        ("EKF2_HGT_REF", 3, "height from vision"),
        ("EKF2_MAG_TYPE", 5, "no magnetometer"),
        ("COM_ARM_WO_GPS", 1, "it may be armed"),
    ],
)
def test_in_a_hall_poses_take_the_place_of_satellites(name: str, value: float, why: str) -> None:
    assert POSE_PARAMETERS[name] == value, why
    assert flight_parameters(AIRFRAME, gps=False, by_sticks=False)[name] == value
    assert name not in flight_parameters(AIRFRAME, gps=True, by_sticks=False)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("FW_AIRSPD_STALL", 6.0),
        ("FW_AIRSPD_MIN", 7.0),
        ("FW_AIRSPD_TRIM", 8.7),  # neutral elevator trims there
        ("FW_AIRSPD_MAX", 14.0),
        ("FW_PSP_OFF", 0.0),  # a pitch that is asked for is flown
        ("TRIM_PITCH", 0.0),
        ("FW_MAN_P_MAX", 15.0),
        ("IMU_GYRO_CUTOFF", 100.0),
        ("FW_P_TC", 0.07),
        ("FW_P_RMAX_POS", 180.0),
        ("FW_P_RMAX_NEG", 180.0),
        ("FW_PR_P", 0.45),
        ("FW_PR_I", 1.0),
        ("FW_PR_FF", 0.5),
        ("FW_R_TC", 0.2),
        ("FW_RR_P", 0.08),
        ("FW_RR_I", 0.2),
        ("FW_RR_FF", 0.25),
        ("FW_YR_P", 0.2),
        ("FW_YR_I", 0.1),
        ("FW_YR_FF", 0.3),
    ],
)
def test_the_inner_loops_have_the_gains_that_were_found_in_flight(name: str, value: float) -> None:
    assert GAINS[name] == value
    assert flight_parameters(AIRFRAME, gps=True, by_sticks=False)[name] == value


def test_it_is_of_the_airframe_files_system() -> None:
    given = flight_parameters(AIRFRAME, gps=True, by_sticks=False)
    assert given["MAV_SYS_ID"] == AIRFRAME.autopilot.system_id == 1
    assert given["PWM_MAIN_FUNC2"] == 201  # with its outputs
    assert given["COM_RC_IN_MODE"] == 0  # the radio alone


# --- its program ----------------------------------------------------------------------------------


def test_the_ports_are_those_of_px4s_own_start_script() -> None:
    """rcS and px4-rc.mavlink: one port higher for every instance; low instances are people's."""
    assert px4.SIMULATOR_PORT == 4560
    assert px4.GROUND_PORT == 18570
    assert px4.COMPANION_PORT == 14580
    assert (px4.INSTANCES[0], px4.INSTANCES[-1]) == (20, 99)
    assert (px4.RC_STEPS, px4.BOOT_S, px4.PATIENCE_S, px4.UNANSWERED_S) == (5, 100.0, 10.0, 0.02)
