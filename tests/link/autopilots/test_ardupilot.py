"""How ArduPlane wants its surfaces: channels, pulses, and the two ways to release them."""

from math import nan, radians

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.link.autopilots.ardupilot import ATTITUDE, ArduPilot
from tgl_soar.link.autopilots.base import SurfaceChannel, SurfaceChannels, pulse_width
from tgl_soar.link.autopilots.bridge import BridgeAutopilot
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
