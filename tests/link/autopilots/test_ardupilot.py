"""How ArduPlane is sent its surfaces: channels, pulses, and the two ways to release them."""

from math import inf, nan, radians

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.link.autopilots.ardupilot import ATTITUDE, OVERRIDE, ArduPilot
from tgl_soar.link.autopilots.base import (
    BrakeChannel,
    SurfaceChannel,
    SurfaceChannels,
    ThrottleChannel,
    pulse_width,
)
from tgl_soar.link.autopilots.bridge import BridgeAutopilot
from tgl_soar.link.autopilots.requirements import Needs
from tgl_soar.link.messages import Heartbeat, RcChannelsOverride, SetAttitudeTarget
from tgl_soar.types import NO_SETPOINTS, SurfaceCommand

PLAIN = SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1500, pwm_max=1900)
CROOKED = SurfaceChannel(channel=1, pwm_min=1000, pwm_trim=1600, pwm_max=1900)
HIGH = SurfaceChannel(channel=12, pwm_min=1100, pwm_trim=1500, pwm_max=1900, reversed=True)
FLAVOURS = [ArduPilot, BridgeAutopilot]


def override(messages: object) -> RcChannelsOverride:
    assert isinstance(messages, tuple)
    (message,) = messages
    assert isinstance(message, RcChannelsOverride)
    return message


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_our_three_channels_and_no_other(flavour: type[ArduPilot]) -> None:
    pilot = flavour(SurfaceChannels(elevator=PLAIN, aileron=CROOKED, rudder=HIGH), 7)
    message = override(pilot.commands(SurfaceCommand(0.5, -1.0, 0.25), NO_SETPOINTS))
    assert message.target_system == 7
    assert message.target_component == 1
    expected = [65535] * 8 + [0] * 10
    expected[1], expected[0], expected[11] = 1700, 1000, 1400
    assert list(message.channels) == expected


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_letting_go_touches_no_other_channel(flavour: type[ArduPilot]) -> None:
    message = override(
        flavour(SurfaceChannels(elevator=PLAIN, aileron=CROOKED, rudder=HIGH), 7).release()
    )
    expected = [65535] * 8 + [0] * 10
    expected[1], expected[0], expected[11] = 0, 0, 65534
    assert list(message.channels) == expected


@pytest.mark.parametrize(
    ("channel", "deflection", "pulse"),
    [
        (PLAIN, -1.0, 1100),
        (PLAIN, 0.0, 1500),
        (PLAIN, 1.0, 1900),
        (PLAIN, 7.0, 1900),
        (CROOKED, -0.5, 1300),
        (CROOKED, 0.5, 1750),
        (HIGH, 1.0, 1100),
        (HIGH, -1.0, 1900),
        (CROOKED._replace(reversed=True), 1.0, 1000),
        (PLAIN, float("nan"), 1500),
        (PLAIN, float("inf"), 1500),
    ],
)
def test_pulses(channel: SurfaceChannel, deflection: float, pulse: int) -> None:
    assert pulse_width(channel, deflection) == pulse


@given(
    st.floats(),
    st.tuples(st.integers(800, 1400), st.integers(1401, 1600), st.integers(1601, 2200)),
    st.booleans(),
)
def test_a_pulse_never_leaves_the_channel_s_limits(
    deflection: float, limits: tuple[int, int, int], turned: bool
) -> None:
    low, trim, high = limits
    assert (
        low
        <= pulse_width(
            SurfaceChannel(channel=1, pwm_min=low, pwm_trim=trim, pwm_max=high, reversed=turned),
            deflection,
        )
        <= high
    )


def test_surfaces_obey_in_manual_only() -> None:
    pilot = ArduPilot(SurfaceChannels(elevator=PLAIN, aileron=CROOKED, rudder=HIGH), 1)
    for mode in range(26):
        assert pilot.obeys(
            Heartbeat(type=1, autopilot=3, base_mode=81, custom_mode=mode, system_status=4)
        ) == (mode == 0)
    assert not pilot.obeys(
        Heartbeat(type=1, autopilot=3, base_mode=80, custom_mode=0, system_status=4)
    )  # without a custom mode 0 means nothing


@pytest.mark.parametrize(
    ("rudder", "yaw_deg"), [(1.0, 45.0), (-0.5, -22.5), (3.0, 45.0), (nan, 0.0)]
)
def test_the_yaw_of_an_attitude_is_the_rudder(rudder: float, yaw_deg: float) -> None:
    pilot = ArduPilot(SurfaceChannels(elevator=PLAIN, aileron=CROOKED, rudder=HIGH), 1, ATTITUDE)
    (asked,) = pilot.commands(
        SurfaceCommand(0.0, 0.0, rudder), NO_SETPOINTS._replace(roll_rad=0.1, pitch_rad=-0.05)
    )
    assert isinstance(asked, SetAttitudeTarget)
    assert euler_from_quaternion(*asked.q) == pytest.approx((0.1, -0.05, radians(yaw_deg)))


# --- channels, one by one -------------------------------------------------------------------------

NEEDS = Needs(override_system=255, loop_rate_hz=200.0, external_pose=False, gps=True)
SYSTEM = 7


def surface(channel: int) -> SurfaceChannel:
    return SurfaceChannel(channel=channel, pwm_min=1100, pwm_trim=1500, pwm_max=1900)


def on(elevator: int, aileron: int, rudder: int) -> SurfaceChannels:
    return SurfaceChannels(
        elevator=surface(elevator), aileron=surface(aileron), rudder=surface(rudder)
    )


@pytest.mark.parametrize("channel", range(1, 19))
def test_each_channel_is_left_and_released_by_the_numbers_of_its_half(channel: int) -> None:
    """common.xml: up to channel 8 65535 ignores and 0 releases, behind it 0 ignores and 65534
    releases."""
    others = [n for n in (1, 2, 3, 10) if n != channel][:2]
    plane = ArduPilot(on(channel, *others), SYSTEM)
    sent = override(plane.commands(SurfaceCommand(1.0, 0.0, 0.0), NO_SETPOINTS)).channels
    released = override(plane.release()).channels
    for number in range(1, 19):
        leave, release = (65535, 0) if number <= 8 else (0, 65534)
        if number in (channel, *others):
            assert sent[number - 1] == (1900 if number == channel else 1500)
            assert released[number - 1] == release
        else:
            assert sent[number - 1] == released[number - 1] == leave


@pytest.mark.parametrize(("channel", "release"), [(3, 0), (8, 0), (9, 65534), (16, 65534)])
def test_a_throttle_is_sent_while_power_is_requested_and_else_released(
    channel: int, release: int
) -> None:
    motor = ThrottleChannel(channel=channel, pwm_min=1000, pwm_max=2000)
    plane = ArduPilot(on(2, 1, 4)._replace(throttle=motor), SYSTEM)
    for throttle, pulse in (
        *((1.0, 2000), (0.25, 1250), (0.001, 1001)),
        *((0.0, release), (-0.5, release), (nan, release)),
    ):
        sent = override(plane.commands(SurfaceCommand(0.0, 0.0, 0.0), NO_SETPOINTS, throttle))
        assert sent.channels[channel - 1] == pulse
    assert override(plane.commands(SurfaceCommand(0.0, 0.0, 0.0), NO_SETPOINTS)).channels[
        channel - 1
    ] == (release)
    assert override(plane.release()).channels[channel - 1] == release


def test_what_brakes_is_sent_and_released_with_the_others() -> None:
    plane = ArduPilot(on(2, 1, 4)._replace(brake=BrakeChannel(surface(6))), SYSTEM)
    sent = override(plane.commands(SurfaceCommand(0.0, 0.0, 0.0, 1.0), NO_SETPOINTS)).channels
    assert (sent[5], sent[4], sent[6]) == (1900, 65535, 65535)
    assert override(plane.release()).channels[5] == 0
    two = ArduPilot(on(2, 1, 4)._replace(brake=BrakeChannel(surface(5), throw=0.5)), SYSTEM)
    sent = override(two.commands(SurfaceCommand(0.0, 0.0, 0.0, 1.0), NO_SETPOINTS)).channels
    assert (sent[0], sent[4]) == (1300, 1700)  # both up: the right one's positive side is up


# --- the attitude route, modes and words ----------------------------------------------------------


def test_an_attitude_is_asked_for_alone_and_has_nothing_to_release() -> None:
    plane = ArduPilot(on(2, 1, 4), SYSTEM, ATTITUDE)
    setpoints = NO_SETPOINTS._replace(roll_rad=-0.4, pitch_rad=0.2)
    (asked,) = plane.commands(SurfaceCommand(0.9, 0.9, -1.0), setpoints)
    assert isinstance(asked, SetAttitudeTarget)
    assert asked[:3] == (0, SYSTEM, mavlink.MAV_COMP_ID_AUTOPILOT1)
    ignored = {mavlink.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE}
    ignored |= {getattr(mavlink, f"ATTITUDE_TARGET_TYPEMASK_BODY_{axis}_RATE_IGNORE") for axis in
                ("ROLL", "PITCH", "YAW")}  # fmt: skip
    assert asked.type_mask == sum(ignored)
    assert euler_from_quaternion(*asked.q) == pytest.approx((-0.4, 0.2, radians(-45.0)))
    assert plane.release() == ()


@pytest.mark.parametrize("rudder", [nan, inf, -inf])
def test_a_rudder_that_is_no_number_is_in_the_middle(rudder: float) -> None:
    plane = ArduPilot(on(2, 1, 4), SYSTEM, ATTITUDE)
    level = NO_SETPOINTS._replace(roll_rad=0.0, pitch_rad=0.0)
    (asked,) = plane.commands(SurfaceCommand(0.0, 0.0, rudder), level)
    assert isinstance(asked, SetAttitudeTarget)
    assert asked.q == (1.0, 0.0, 0.0, 0.0)


def alive(mode: int, *, base: int = 81, status: int = 4) -> Heartbeat:
    return Heartbeat(type=1, autopilot=3, base_mode=base, custom_mode=mode, system_status=status)


def test_override_is_its_usual_route() -> None:
    assert ArduPilot(on(2, 1, 4), SYSTEM).route is OVERRIDE
    assert list(ArduPilot.routes.items()) == [("override", OVERRIDE), ("attitude", ATTITUDE)]
    assert (ArduPilot.name, BridgeAutopilot.name) == ("ardupilot", "bridge")


@pytest.mark.parametrize("mode", range(26))
def test_attitudes_are_obeyed_in_guided_only(mode: int) -> None:
    plane = ArduPilot(on(2, 1, 4), SYSTEM, ATTITUDE)
    assert plane.obeys(alive(mode)) == (mode == mavlink.PLANE_MODE_GUIDED)
    assert not plane.obeys(alive(mode, base=80))


def test_a_mode_is_asked_for_by_its_number() -> None:
    asked = ArduPilot(on(2, 1, 4), SYSTEM).ask_for_mode(mavlink.PLANE_MODE_FLY_BY_WIRE_A)
    assert (asked.target_system, asked.command) == (SYSTEM, mavlink.MAV_CMD_DO_SET_MODE)
    flag = float(mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
    assert asked.params == (flag, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("status", range(9))
def test_any_failsafe_is_critical_and_a_crash_an_emergency(status: int) -> None:
    fails = status in (mavlink.MAV_STATE_CRITICAL, mavlink.MAV_STATE_EMERGENCY)
    assert ArduPilot(on(2, 1, 4), SYSTEM).failsafe(alive(0, status=status)) == fails


def test_it_is_reported_which_numbers_differ() -> None:
    plane = ArduPilot(on(2, 1, 4), SYSTEM)
    words = "its {} is {}, our override_system_id 255; make them the same"
    old, new = (
        plane.refusal({"SYSID_MYGCS": 254.0}, 255),
        plane.refusal({"MAV_GCS_SYSID": 9.0}, 255),
    )
    assert old.endswith(words.format("SYSID_MYGCS", 254))
    assert new.endswith(words.format("MAV_GCS_SYSID", 9))
    both = {"SYSID_MYGCS": 255.0, "MAV_GCS_SYSID": 9.0}
    assert plane.refusal(both, 255) == ""  # a release has one of them; the old name decides
    assert plane.refusal({"MAV_GCS_SYSID_HI": 9.0}, 255) == ""


@pytest.mark.parametrize(
    ("low", "high", "obeyed"),
    [(250.0, 255.0, range(250, 256)), (255.0, 0.0, [255]), (9.0, 5.0, [9])],
)
def test_the_new_parameters_name_a_range(low: float, high: float, obeyed: range) -> None:
    plane = ArduPilot(on(2, 1, 4), SYSTEM)
    answers = {"MAV_GCS_SYSID": low, "MAV_GCS_SYSID_HI": high}
    assert [s for s in range(1, 256) if plane.refusal(answers, s) == ""] == [*obeyed]


def test_a_refused_rate_needs_a_loop_of_five_quarters_of_it() -> None:
    plane, bridge = ArduPilot(on(2, 1, 4), SYSTEM), BridgeAutopilot(on(2, 1, 4), SYSTEM)
    assert plane.way_to_rate(200.0) == "set SCHED_LOOP_RATE to 250 or more"
    assert bridge.way_to_rate(200.0) == "start the bridge with an attitude rate of 200 or more"


@pytest.mark.parametrize(("loop_hz", "wanted"), [(50.0, 250.0), (200.0, 250.0), (240.0, 300.0)])
def test_its_loop_must_bear_our_rate_and_never_be_slow(loop_hz: float, wanted: float) -> None:
    """Its servos are late by one loop: 4 ms at most."""
    needs = NEEDS._replace(loop_rate_hz=loop_hz)
    rows = ArduPilot(on(2, 1, 4), SYSTEM).requirements(needs)
    (row,) = [row for row in rows if row.names == ("SCHED_LOOP_RATE",)]
    assert row.relation == "at least"
    assert row.wanted == pytest.approx(wanted)
    assert f"{loop_hz:g} Hz" in row.why


def test_its_values_are_floats_whatever_their_type() -> None:
    assert ArduPilot.codec.number(3.0, 4) == 3.0


def functions(channels: SurfaceChannels) -> dict[str, float]:
    """What each output and each stick's channel must be."""
    rows = ArduPilot(channels, SYSTEM).requirements(NEEDS)
    ours = {name: row.wanted for row in rows for name in row.names}
    return {n: w for n, w in ours.items() if n.endswith("_FUNCTION") or n.startswith("RCMAP_")}


def test_a_brake_of_its_own_passes_through_and_the_ailerons_stay_ardupilot_s() -> None:
    """SERVOn_FUNCTION: 19 elevator, 4 aileron, 21 rudder, 70 throttle, and 50 more than a channel
    repeats it."""
    plain = {"SERVO2_FUNCTION": 19.0, "SERVO1_FUNCTION": 4.0, "SERVO4_FUNCTION": 21.0}
    sticks = {"RCMAP_PITCH": 2.0, "RCMAP_ROLL": 1.0, "RCMAP_YAW": 4.0}
    assert functions(on(2, 1, 4)) == plain | sticks
    motor = ThrottleChannel(channel=5, pwm_min=1000, pwm_max=2000)
    powered = on(2, 1, 4)._replace(throttle=motor)
    assert functions(powered) == plain | sticks | {"SERVO5_FUNCTION": 70.0, "RCMAP_THROTTLE": 5.0}
    spoiled = on(2, 1, 4)._replace(brake=BrakeChannel(surface(6)))
    assert functions(spoiled) == plain | sticks | {"SERVO6_FUNCTION": 56.0}
    mixed = on(2, 1, 4)._replace(brake=BrakeChannel(surface(6), throw=0.5))
    del sticks["RCMAP_ROLL"]
    through = {"SERVO1_FUNCTION": 51.0, "SERVO6_FUNCTION": 56.0}
    assert functions(mixed) == plain | sticks | through


def test_whatever_is_asked_of_the_override_s_end_must_be_answered() -> None:
    """Every release has it, and without it the surfaces might stay where they were forever."""
    rows = ArduPilot(on(2, 1, 4), SYSTEM).requirements(NEEDS)
    asked = [row for row in rows if row.names == ("RC_OVERRIDE_TIME",)]
    assert {row.relation for row in asked} == {"at least", "at most"}
    assert not any(row.missing_ok for row in asked)
