"""The routes as they are declared: what follows for whoever commands, and who takes over."""

from __future__ import annotations

import pytest

from tgl_soar.link.autopilots import ardupilot, paparazzi, px4
from tgl_soar.link.autopilots.base import CommandRoute, SurfaceChannel, SurfaceChannels
from tgl_soar.link.messages import (
    STATE_ACTIVE,
    STATE_CRITICAL,
    STATE_EMERGENCY,
    Heartbeat,
    RcChannelsOverride,
)
from tgl_soar.types import NO_SETPOINTS, OURS, THEIRS, THEIRS_WITH_RUDDER, SurfaceCommand

ROUTES: dict[str, CommandRoute] = {
    "ardupilot override": ardupilot.OVERRIDE,
    "ardupilot attitude": ardupilot.ATTITUDE,
    "px4 attitude": px4.ATTITUDE,
    "px4 manual_control": px4.MANUAL_CONTROL,
    "px4 actuators": px4.ACTUATORS,
    "paparazzi override": paparazzi.OVERRIDE,
}


def those(which: str) -> set[str]:
    return {name for name, route in ROUTES.items() if getattr(route, which)}


def test_only_an_arduplane_looks_at_who_overrides_and_only_it_has_a_message_that_releases() -> None:
    """SYSID_MYGCS: the command must come as the ground station's."""
    assert those("as_operator") == {"ardupilot override"}
    assert those("releases") == {"ardupilot override"}


def test_whose_loops_move_the_surfaces() -> None:
    assert {name: route.loops for name, route in ROUTES.items()} == {
        "ardupilot override": OURS,
        "ardupilot attitude": THEIRS_WITH_RUDDER,
        "px4 attitude": THEIRS,
        "px4 manual_control": OURS,
        "px4 actuators": OURS,
        "paparazzi override": OURS,
    }


def test_a_mode_that_is_the_pilot_s_is_not_entered_and_one_that_circles_is_left() -> None:
    assert {name: route.mode_to_enter for name, route in ROUTES.items()} == {
        "ardupilot override": None,
        "ardupilot attitude": ardupilot.MODE_GUIDED,
        "px4 attitude": px4.MODE_OFFBOARD,
        "px4 manual_control": None,
        "px4 actuators": px4.MODE_OFFBOARD,
        "paparazzi override": None,
    }
    assert ardupilot.ATTITUDE.mode_to_leave == ardupilot.MODE_FBWA
    assert px4.ATTITUDE.mode_to_leave == px4.MODE_STABILIZED
    assert ardupilot.OVERRIDE.mode_to_leave == paparazzi.OVERRIDE.mode_to_leave == 0


def test_how_long_the_last_command_acts_is_each_firmware_s_default() -> None:
    """RC_OVERRIDE_TIME, COM_OF_LOSS_T, COM_RC_LOSS_T, and Paparazzi's datalink RC."""
    assert {name: route.silence_s for name, route in ROUTES.items()} == {
        "ardupilot override": 3.0,
        "ardupilot attitude": 3.0,
        "px4 attitude": 1.0,
        "px4 manual_control": 0.5,
        "px4 actuators": 1.0,
        "paparazzi override": 0.5,
    }


CHANNELS = SurfaceChannels(
    elevator=SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    aileron=SurfaceChannel(channel=1, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    rudder=SurfaceChannel(channel=9, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
)


@pytest.mark.parametrize(
    ("state", "fails"), [(STATE_ACTIVE, False), (STATE_CRITICAL, True), (STATE_EMERGENCY, True)]
)
def test_a_failsafe_is_recognised_by_the_state(state: int, fails: bool) -> None:
    heartbeat = Heartbeat(type=1, autopilot=3, base_mode=1, custom_mode=0, system_status=state)
    for flavour in (
        ardupilot.ArduPilot(CHANNELS, 1),
        px4.Px4(CHANNELS, 1),
        paparazzi.Paparazzi(CHANNELS, 1),
    ):
        assert flavour.failsafe(heartbeat) == fails


def test_of_eighteen_channels_the_first_eight_are_left_and_released_otherwise_than_the_others() -> (
    None
):
    """RC_CHANNELS_OVERRIDE: 65535 leaves and 0 releases up to channel 8, 0 leaves and 65534
    releases from channel 9 on."""
    flavour = ardupilot.ArduPilot(CHANNELS, 7)
    (sent,) = flavour.commands(SurfaceCommand(1.0, -1.0, 0.5), NO_SETPOINTS)
    (released,) = flavour.release()
    assert isinstance(sent, RcChannelsOverride)
    assert isinstance(released, RcChannelsOverride)
    assert sent.channels == (1100, 1900, *(65535,) * 6, 1700, *(0,) * 9)
    assert released.channels == (0, 0, *(65535,) * 6, 65534, *(0,) * 9)
    assert (sent.target_system, sent.target_component) == (7, 1)


@pytest.mark.parametrize(
    ("answers", "refused"),
    [
        ({}, False),
        ({"SYSID_MYGCS": 255.0}, False),
        ({"SYSID_MYGCS": 254.0}, True),
        ({"SYSID_MYGCS": 256.0}, True),
        ({"MAV_GCS_SYSID": 255.0}, False),
        ({"MAV_GCS_SYSID": 250.0}, True),
        ({"MAV_GCS_SYSID": 250.0, "MAV_GCS_SYSID_HI": 255.0}, False),
        ({"MAV_GCS_SYSID": 250.0, "MAV_GCS_SYSID_HI": 254.0}, True),
        ({"MAV_GCS_SYSID": 255.0, "MAV_GCS_SYSID_HI": 0.0}, False),  # 0 stands for the lower
    ],
)
def test_an_arduplane_obeys_the_systems_that_it_names(
    answers: dict[str, float], refused: bool
) -> None:
    override = ardupilot.ArduPilot(CHANNELS, 1)
    assert (override.refusal(answers, 255) != "") == refused
    attitude = ardupilot.ArduPilot(CHANNELS, 1, ardupilot.ATTITUDE)
    assert attitude.refusal(answers, 255) == ""


def test_what_each_is_asked_for() -> None:
    plane, other = ardupilot.ArduPilot.sensors, px4.Px4.sensors
    assert (plane.airspeed.rate_hz, other.airspeed.rate_hz) == (20.0, 20.0)
    assert (plane.pitot_in_imu, other.pitot_in_imu) == (False, True)
    assert plane.imu == (27, 26)
    assert other.imu == (105,)
    for sensors, name, number in (
        (plane, "EKF_STATUS_REPORT", 193),
        (other, "ESTIMATOR_STATUS", 230),
    ):
        assert sensors.estimator is not None
        assert sensors.estimator == (number, name, 5.0)
    assert paparazzi.Paparazzi.sensors.imu == ()
    assert not paparazzi.Paparazzi.sensors.pitot_in_imu
