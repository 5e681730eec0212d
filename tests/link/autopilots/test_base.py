"""What all firmwares share: channels, pulses and their inverse, modes, parameters' numbers."""

from __future__ import annotations

import struct
from math import inf, isnan, nan

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.autopilots.base import (
    BYTEWISE,
    CAST,
    OVERRIDE_CHANNELS,
    BrakeChannel,
    SurfaceChannel,
    SurfaceChannels,
    ThrottleChannel,
    brake_pulses,
    deflection,
    deflections,
    firmware_mismatch,
    is_finite,
    pulse_width,
    set_mode,
    throttle_pulse,
)
from tgl_soar.link.messages import Heartbeat
from tgl_soar.types import SurfaceCommand

# Each with ends and trim of its own, so that no number can stand for another.
ELEVATOR = SurfaceChannel(channel=2, pwm_min=1000, pwm_trim=1600, pwm_max=1900)
AILERON = SurfaceChannel(channel=1, pwm_min=1100, pwm_trim=1400, pwm_max=2000)
RUDDER = SurfaceChannel(channel=4, pwm_min=1200, pwm_trim=1500, pwm_max=1700, reversed=True)
SPOILER = SurfaceChannel(channel=6, pwm_min=1100, pwm_trim=1500, pwm_max=1900)
RIGHT = SurfaceChannel(channel=5, pwm_min=1050, pwm_trim=1450, pwm_max=1950)
PLAIN = SurfaceChannels(elevator=ELEVATOR, aileron=AILERON, rudder=RUDDER)
SPOILED = PLAIN._replace(brake=BrakeChannel(SPOILER))
MIXED = PLAIN._replace(brake=BrakeChannel(RIGHT, throw=0.5))
MOTOR = ThrottleChannel(channel=3, pwm_min=1010, pwm_max=1990)
SURFACES = [ELEVATOR, AILERON, RUDDER, SPOILER]


def test_a_message_of_overrides_has_a_place_for_eighteen_channels() -> None:
    fields = mavlink.MAVLink_rc_channels_override_message.fieldnames
    assert sum(name.startswith("chan") for name in fields) == OVERRIDE_CHANNELS


def test_an_aircraft_has_three_surfaces_and_whatever_else_is_declared() -> None:
    assert not SPOILER.reversed
    assert PLAIN.driven() == (ELEVATOR, AILERON, RUDDER)
    assert PLAIN.numbers() == (2, 1, 4)
    assert SPOILED.driven() == (ELEVATOR, AILERON, RUDDER, SPOILER)
    assert SPOILED.numbers() == (2, 1, 4, 6)
    assert PLAIN._replace(throttle=MOTOR).numbers() == (2, 1, 4, 3)
    assert MIXED._replace(throttle=MOTOR).numbers() == (2, 1, 4, 5, 3)
    assert MIXED._replace(throttle=MOTOR).driven() == (ELEVATOR, AILERON, RUDDER, RIGHT)


# --- pulses --------------------------------------------------------------------------------------


def by_table(channel: SurfaceChannel, wanted: float) -> float:
    """The pulse width by the three rows of an airframe file, linear between them."""
    ends = (-1.0, 0.0, 1.0)
    rows = (channel.pwm_min, channel.pwm_trim, channel.pwm_max)
    return float(np.interp(-wanted if channel.reversed else wanted, ends, rows))


@pytest.mark.parametrize("channel", SURFACES)
@pytest.mark.parametrize("wanted", [-9.0, -1.0, -0.7, -0.25, 0.0, 0.25, 0.7, 1.0, 9.0])
def test_a_pulse_is_linear_on_either_side_of_the_trim_and_ends_where_the_channel_does(
    channel: SurfaceChannel, wanted: float
) -> None:
    pulse = pulse_width(channel, wanted)
    assert abs(pulse - by_table(channel, wanted)) <= 0.5
    servos = [0] * 7 + [1500]
    servos[channel.channel - 1] = pulse
    found = deflection(channel, servos)
    step = 1.0 / min(channel.pwm_max - channel.pwm_trim, channel.pwm_trim - channel.pwm_min)
    assert found == pytest.approx(max(-1.0, min(1.0, wanted)), abs=0.51 * step)


@pytest.mark.parametrize("channel", SURFACES)
@pytest.mark.parametrize("wanted", [nan, inf, -inf])
def test_what_is_no_number_is_the_trim(channel: SurfaceChannel, wanted: float) -> None:
    assert pulse_width(channel, wanted) == channel.pwm_trim


@pytest.mark.parametrize("channel", SURFACES)
@pytest.mark.parametrize(("pulse", "found"), [(1, -1.0), (800, -1.0), (2200, 1.0), (65535, 1.0)])
def test_a_pulse_beyond_the_channel_s_ends_is_a_full_deflection(
    channel: SurfaceChannel, pulse: int, found: float
) -> None:
    assert deflection(channel, [pulse] * 8) == (-found if channel.reversed else found)


def test_an_output_that_is_not_driven_or_not_there_is_nowhere() -> None:
    assert isnan(deflection(ELEVATOR, [1500, 0, 1500]))
    assert isnan(deflection(ELEVATOR, [1500]))
    assert isnan(deflection(ELEVATOR, []))
    assert deflection(ELEVATOR, [1500, 1600]) == 0.0  # the last one there is


@pytest.mark.parametrize(
    ("fraction", "pulse"),
    [(0.0, 1010), (0.5, 1500), (1.0, 1990), (0.001, 1011), (2.0, 1990), (inf, 1990),
     (-0.5, 1010), (nan, 1010), (-inf, 1010)],
)  # fmt: skip
def test_a_throttle_goes_over_all_of_its_channel_and_what_is_no_number_is_closed(
    fraction: float, pulse: int
) -> None:
    assert throttle_pulse(MOTOR, fraction) == pulse


# --- what brakes ---------------------------------------------------------------------------------


def test_without_a_brake_nothing_is_sent_for_it_and_nothing_is_known_of_it() -> None:
    assert brake_pulses(PLAIN, SurfaceCommand(0.1, 0.2, 0.3, 1.0)) == ()
    found = deflections(PLAIN, [1700, 1300, 0, 1600])
    assert found[:3] == pytest.approx((-0.5, 0.5, -0.5))
    assert isnan(found.brake)


@pytest.mark.parametrize(
    ("brake", "pulse"), [(0.0, 1100), (0.25, 1300), (0.5, 1500), (0.75, 1700), (1.0, 1900)]
)
def test_a_brake_of_its_own_goes_from_the_one_end_of_its_channel_to_the_other(
    brake: float, pulse: int
) -> None:
    sent = brake_pulses(SPOILED, SurfaceCommand(0.1, 0.2, 0.3, brake))
    assert sent == ((6, pulse),)
    found = deflections(SPOILED, [1400, 1600, 0, 1500, 0, pulse])
    assert found == pytest.approx((0.0, 0.0, 0.0, brake))


def test_two_ailerons_that_brake_are_sent_together_and_told_apart_again() -> None:
    """Each servo's positive side rolls right: roll is what they have in common, and half of the
    throw is half a brake of 0.5, by which the right one is ahead and the left one behind."""
    command = SurfaceCommand(0.0, 0.25, 0.0, 0.5)
    sent = dict(brake_pulses(MIXED, command))
    assert set(sent) == {1, 5}
    left, right = deflection(AILERON, [sent[1]]), deflection(RIGHT, [0, 0, 0, 0, sent[5]])
    assert 0.5 * (right + left) == pytest.approx(0.25, abs=0.003)
    assert 0.5 * (right - left) == pytest.approx(0.5 * 0.5, abs=0.003)
    found = deflections(MIXED, [sent[1], 1600, 0, 1500, sent[5]])
    assert found == pytest.approx(command, abs=0.006)


# --- a firmware's modes and words ----------------------------------------------------------------


def alive(kind: int, autopilot: int) -> Heartbeat:
    return Heartbeat(type=kind, autopilot=autopilot, base_mode=0, custom_mode=0, system_status=4)


def test_a_firmware_is_known_by_its_number_and_a_fixed_wing_by_its_type() -> None:
    wing, copter, vtol = (
        mavlink.MAV_TYPE_FIXED_WING,
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_TYPE_VTOL_QUADROTOR,
    )
    px4, plane = mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    assert firmware_mismatch(alive(wing, px4), px4, "a PX4") == ""
    assert firmware_mismatch(alive(wing, plane), px4, "a PX4") == (
        "the autopilot is not a PX4 (MAV_AUTOPILOT 3, not 12):"
        " set firmware in [autopilot] of the airframe file"
    )
    words = "the vehicle is no fixed wing (MAV_TYPE 2)"
    assert firmware_mismatch(alive(copter, px4), px4, "a PX4") == words
    assert firmware_mismatch(alive(vtol, px4), px4, "a PX4", (wing, vtol)) == ""


def test_a_mode_is_asked_for_as_a_custom_one() -> None:
    """MAV_CMD_DO_SET_MODE: 1 says that the firmware's own numbers follow; the rest is reserved."""
    asked = set_mode(7, 15.0)
    assert (asked.target_system, asked.target_component) == (7, mavlink.MAV_COMP_ID_AUTOPILOT1)
    assert asked.command == mavlink.MAV_CMD_DO_SET_MODE
    assert asked.confirmation == 0
    flag = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
    assert asked.params == (flag, 15.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert set_mode(7, 4.0, 5.0).params == (flag, 4.0, 5.0, 0.0, 0.0, 0.0, 0.0)


# Formats of `struct` by MAV_PARAM_TYPE, and a value that its sign or its size tells from others.
BYTES = {
    mavlink.MAV_PARAM_TYPE_UINT8: ("<B3x", 200),
    mavlink.MAV_PARAM_TYPE_INT8: ("<i", -5),
    mavlink.MAV_PARAM_TYPE_UINT16: ("<H2x", 60000),
    mavlink.MAV_PARAM_TYPE_INT16: ("<i", -300),
    mavlink.MAV_PARAM_TYPE_UINT32: ("<I", 0xBF000001),  # a float of its own: -0.5
    mavlink.MAV_PARAM_TYPE_INT32: ("<i", -0x40FFFFFF),  # the same bytes
}


@pytest.mark.parametrize("kind", BYTES)
def test_px4_sends_whole_numbers_as_their_four_bytes(kind: int) -> None:
    layout, number = BYTES[kind]
    (as_float,) = struct.unpack("<f", struct.pack(layout, number))
    assert BYTEWISE.number(as_float, kind) == number
    assert struct.pack("<f", BYTEWISE.wire(number, kind)) == struct.pack("<f", as_float)


@pytest.mark.parametrize(
    "kind",
    [
        0,  # of no type
        mavlink.MAV_PARAM_TYPE_UINT64,
        mavlink.MAV_PARAM_TYPE_INT64,
        mavlink.MAV_PARAM_TYPE_REAL32,
        mavlink.MAV_PARAM_TYPE_REAL64,
    ],
)
def test_what_is_no_whole_number_of_four_bytes_is_the_float_that_it_is(kind: int) -> None:
    assert BYTEWISE.number(2.5, kind) == 2.5
    assert BYTEWISE.wire(2.5, kind) == 2.5


@pytest.mark.parametrize(("number", "kind"), [(2.5, 6), (2.0**31, 6), (-1.0, 5), (inf, 6)])
def test_what_four_bytes_cannot_hold_is_refused(number: float, kind: int) -> None:
    with pytest.raises(ValueError, match="whole number"):
        BYTEWISE.wire(number, kind)


@pytest.mark.parametrize(
    ("kind", "low", "high"),
    [(1, 0, 255), (2, -128, 127), (3, 0, 65535), (4, -32768, 32767), (5, 0, 2**32 - 1)],
)
def test_what_its_type_cannot_hold_is_refused(kind: int, low: int, high: int) -> None:
    for number in (low, high):
        assert BYTEWISE.number(BYTEWISE.wire(float(number), kind), kind) == number
    for number in (low - 1, high + 1):
        with pytest.raises(ValueError, match=f"no whole number from {low} to {high}"):
            BYTEWISE.wire(float(number), kind)


@pytest.mark.parametrize("kind", range(11))
def test_ardupilot_sends_whole_numbers_as_floats(kind: int) -> None:
    assert (CAST.number(255.0, kind), CAST.wire(255.0, kind)) == (255.0, 255.0)


@pytest.mark.parametrize("broken", [nan, inf, -inf])
def test_three_deflections_are_numbers_or_the_command_is_none(broken: float) -> None:
    good = SurfaceCommand(0.1, -0.2, 0.3)
    assert is_finite(good)
    assert is_finite(good._replace(brake=broken))  # an aircraft without a brake has none
    for name in ("elevator", "aileron", "rudder"):
        assert not is_finite(good._replace(**{name: broken}))
