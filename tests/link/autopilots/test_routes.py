"""Each firmware by each of its routes: what it is sent, when it obeys, and its identity."""

import struct
from math import isfinite, pi

import pytest

from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.link.autopilots import FIRMWARES, flavour, routes
from tgl_soar.link.autopilots.base import BYTEWISE, Flavour, SurfaceChannel, SurfaceChannels
from tgl_soar.link.encoder import Encoder
from tgl_soar.link.messages import (
    Heartbeat,
    ManualControl,
    RcChannelsOverride,
    SetActuatorControlTarget,
    SetAttitudeTarget,
    Source,
)
from tgl_soar.types import NO_SETPOINTS, OURS, THEIRS_WITH_RUDDER, Setpoints, SurfaceCommand

CHANNELS = SurfaceChannels(
    elevator=SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    aileron=SurfaceChannel(channel=1, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    rudder=SurfaceChannel(channel=4, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
)
ALL = [(firmware, route.name) for firmware in FIRMWARES for route in routes(firmware)]
AUTOPILOT = {"ardupilot": 3, "bridge": 3, "px4": 12, "paparazzi": 9}
UP = SurfaceCommand(0.5, -0.25, 1.0)
NOSE_UP = Setpoints(0.2, -0.1, 0.0)


def target(firmware: str, route: str | None = None) -> Flavour:
    return flavour(firmware, route, CHANNELS, 1)


@pytest.mark.parametrize(("firmware", "route"), ALL)
def test_whatever_is_asked_for_can_be_sent(firmware: str, route: str) -> None:
    pilot = target(firmware, route)
    encoder = Encoder(Source(1, 191))
    nan = float("nan")
    broken = SurfaceCommand(nan, float("inf"), nan)
    for surfaces in (UP, broken, SurfaceCommand(-7.0, 7.0, 7.0)):
        for message in (*pilot.commands(surfaces, NOSE_UP), *pilot.release()):
            assert encoder.encode(message)
    mode = pilot.route.mode_to_leave if pilot.route.mode_to_enter is None else 3
    assert encoder.encode(pilot.ask_for_mode(mode))


@pytest.mark.parametrize(("firmware", "route"), ALL)
def test_another_firmware_or_vehicle_is_no_match(firmware: str, route: str) -> None:
    pilot = target(firmware, route)
    for autopilot in (0, 3, 8, 9, 12):
        found = pilot.mismatch(
            Heartbeat(type=1, autopilot=autopilot, base_mode=81, custom_mode=0, system_status=4)
        )
        assert (found == "") == (autopilot == AUTOPILOT[firmware])
    assert "no fixed wing" in pilot.mismatch(
        Heartbeat(
            type=2, autopilot=AUTOPILOT[firmware], base_mode=81, custom_mode=0, system_status=4
        )
    )


@pytest.mark.parametrize(("firmware", "route"), ALL)
def test_a_route_that_is_entered_obeys_there(firmware: str, route: str) -> None:
    pilot = target(firmware, route)
    if pilot.route.mode_to_enter is not None:
        assert pilot.obeys(
            Heartbeat(
                type=1,
                autopilot=3,
                base_mode=81,
                custom_mode=pilot.route.mode_to_enter,
                system_status=4,
            )
        )
        assert not pilot.obeys(
            Heartbeat(
                type=1,
                autopilot=3,
                base_mode=81,
                custom_mode=pilot.route.mode_to_leave,
                system_status=4,
            )
        )
    assert not pilot.obeys(
        Heartbeat(
            type=1,
            autopilot=3,
            base_mode=0,
            custom_mode=pilot.route.mode_to_enter or 0,
            system_status=4,
        )
    )


def test_an_unknown_route_is_named_with_those_that_are() -> None:
    with pytest.raises(ValueError, match="attitude, manual_control, actuators"):
        target("px4", "override")


def test_arduplane_takes_the_yaw_of_an_attitude_for_its_rudder() -> None:
    (message,) = target("ardupilot", "attitude").commands(UP, NOSE_UP)
    assert isinstance(message, SetAttitudeTarget)
    roll, pitch, yaw = euler_from_quaternion(*message.q)
    assert (roll, pitch, yaw) == pytest.approx((-0.1, 0.2, pi / 4.0))
    assert message.type_mask == 0b01000111  # the attitude alone: no rates, no thrust
    assert target("ardupilot", "attitude").route.loops == THEIRS_WITH_RUDDER


def test_px4_s_attitude_is_level_in_yaw() -> None:
    (message,) = target("px4").commands(UP, NOSE_UP)
    assert isinstance(message, SetAttitudeTarget)
    assert euler_from_quaternion(*message.q) == pytest.approx((-0.1, 0.2, 0.0))


def test_px4_s_stick_is_pushed_to_lower_the_nose() -> None:
    (message,) = target("px4", "manual_control").commands(UP, NO_SETPOINTS)
    assert message == ManualControl(target=1, x=-500, y=-250, z=0, r=1000)


def test_px4_s_actuators_are_roll_pitch_yaw() -> None:
    (message,) = target("px4", "actuators").commands(UP, NO_SETPOINTS)
    assert isinstance(message, SetActuatorControlTarget)
    assert message.controls[:3] == (-0.25, 0.5, 1.0)


@pytest.mark.parametrize("fraction", [-1.0, -0.5, 0.0, 0.3, 1.0])
def test_paparazzi_s_eight_bits_have_the_sign_and_the_size_that_were_meant(fraction: float) -> None:
    (message,) = target("paparazzi").commands(
        SurfaceCommand(fraction, fraction, fraction), NO_SETPOINTS
    )
    assert isinstance(message, RcChannelsOverride)
    roll_us, pitch_us, throttle_us, yaw_us = message.channels[:4]
    # What its mavlink.c makes of them; its division truncates.
    roll = int(-(roll_us - 1500) * 255 / 1100 / 2)
    pitch = int(-(pitch_us - 1500) * 255 / 1100 / 2)
    yaw = int(-(yaw_us - 1500) * 255 / 1100)
    assert (roll, pitch, yaw) == pytest.approx((127 * fraction,) * 3, abs=1.0)
    assert (throttle_us - 950) * 127 // 1100 == 0
    assert target("paparazzi").release() == ()  # a 0 would be a full deflection


def test_paparazzi_obeys_with_manual_input_and_no_stabilisation() -> None:
    pilot = target("paparazzi")
    assert pilot.obeys(
        Heartbeat(type=1, autopilot=9, base_mode=1 | 64 | 128, custom_mode=0, system_status=4)
    )
    assert not pilot.obeys(
        Heartbeat(type=1, autopilot=9, base_mode=1 | 64 | 16, custom_mode=0, system_status=4)
    )  # AUTO1
    assert not pilot.obeys(
        Heartbeat(type=1, autopilot=9, base_mode=1 | 4, custom_mode=0, system_status=4)
    )  # AUTO2


@pytest.mark.parametrize(("value", "kind"), [(1, 6), (-7, 6), (255, 1), (2**31, 5), (-5, 2)])
def test_whole_numbers_sent_as_their_bytes(value: int, kind: int) -> None:
    raw = struct.unpack("<f", struct.pack("<i" if value < 0 else "<I", value))[0]
    assert BYTEWISE.number(raw, kind) == value
    assert BYTEWISE.number(2.5, 9) == 2.5


def test_every_route_says_all_that_people_must_know() -> None:
    for firmware, name in ALL:
        route = target(firmware, name).route
        assert all(getattr(route, field) for field in ("message", "mode", "after_silence"))
        assert route.takeover
        assert isfinite(route.silence_s)
    assert all(routes(firmware)[0].name == target(firmware).route.name for firmware in FIRMWARES)
    assert all(any(r.loops == OURS for r in routes(firmware)) for firmware in FIRMWARES)
