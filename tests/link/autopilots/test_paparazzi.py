"""Paparazzi's datalink: the pulses of each channel, when it obeys, the report on its streams."""

from __future__ import annotations

from math import inf, nan

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tgl_soar.link.autopilots.base import SurfaceChannel, SurfaceChannels
from tgl_soar.link.autopilots.paparazzi import OVERRIDE, Paparazzi
from tgl_soar.link.messages import Heartbeat, RcChannelsOverride
from tgl_soar.types import NO_SETPOINTS, OURS, SurfaceCommand

CHANNELS = SurfaceChannels(
    elevator=SurfaceChannel(channel=2, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    aileron=SurfaceChannel(channel=1, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
    rudder=SurfaceChannel(channel=4, pwm_min=1100, pwm_trim=1500, pwm_max=1900),
)
PILOT = Paparazzi(CHANNELS, 7)
BEAT = Heartbeat(
    type=mavlink.MAV_TYPE_FIXED_WING,
    autopilot=mavlink.MAV_AUTOPILOT_PPZ,
    base_mode=mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED,
    custom_mode=0,
    system_status=mavlink.MAV_STATE_ACTIVE,
)


def pulses(elevator: float, aileron: float, rudder: float) -> tuple[int, ...]:
    (sent,) = PILOT.commands(SurfaceCommand(elevator, aileron, rudder), NO_SETPOINTS)
    assert isinstance(sent, RcChannelsOverride)
    assert sent.target_system == 7
    assert sent.target_component == mavlink.MAV_COMP_ID_AUTOPILOT1
    assert len(sent.channels) == 18
    assert set(sent.channels[4:]) == {0}
    return sent.channels[:4]


def eight_bits(pulse_us: int, divisor: int) -> int:
    """What the firmware makes of a pulse: -(pulse - 1500) 255 / divisor, truncated."""
    return int(-(pulse_us - 1500) * 255 / divisor)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_full_travel_is_just_all_of_seven_bits_with_the_sign_turned(sign: float) -> None:
    pitch, roll, throttle, yaw = (pulses(sign, sign, sign)[i] for i in (1, 0, 2, 3))
    assert [eight_bits(pitch, 2200), eight_bits(roll, 2200), eight_bits(yaw, 1100)] == [
        int(sign * 127)
    ] * 3
    closer = int(sign * 10)  # a pulse a little shorter makes less
    assert abs(eight_bits(roll + closer, 2200)) < 127
    assert abs(eight_bits(yaw + closer, 1100)) < 127
    assert throttle == 950


def test_each_surface_has_its_own_channel() -> None:
    assert pulses(0.0, 0.0, 0.0) == (1500, 1500, 950, 1500)
    assert pulses(0.5, 0.0, 0.0) == (1500, 950, 950, 1500)
    assert pulses(0.0, 0.5, 0.0) == (950, 1500, 950, 1500)
    assert pulses(0.0, 0.0, 0.5) == (1500, 1500, 950, 1225)


@pytest.mark.parametrize(
    ("wanted", "pulse_us"), [(1.5, 400), (-1.5, 2600), (nan, 1500), (inf, 1500), (-inf, 1500)]
)
def test_beyond_full_travel_it_stays_there_and_what_is_no_number_is_the_middle(
    wanted: float, pulse_us: int
) -> None:
    assert pulses(wanted, 0.0, 0.0)[1] == pulse_us


@pytest.mark.parametrize(
    ("flags", "obeys"),
    [
        (mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED, True),
        (mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | mavlink.MAV_MODE_FLAG_SAFETY_ARMED, True),
        (
            mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED,
            False,
        ),
        (mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED, False),
        (mavlink.MAV_MODE_FLAG_SAFETY_ARMED, False),
        (0, False),
    ],
)
def test_it_obeys_with_manual_input_alone(flags: int, obeys: bool) -> None:
    assert PILOT.obeys(BEAT._replace(base_mode=flags)) is obeys


@pytest.mark.parametrize(
    ("state", "failsafe"),
    [
        (mavlink.MAV_STATE_STANDBY, False),
        (mavlink.MAV_STATE_ACTIVE, False),
        (mavlink.MAV_STATE_CRITICAL, True),
        (mavlink.MAV_STATE_EMERGENCY, True),
    ],
)
def test_only_a_state_tells_of_a_failsafe(state: int, failsafe: bool) -> None:
    assert PILOT.failsafe(BEAT._replace(system_status=state)) is failsafe


def test_a_slow_stream_is_mended_in_the_telemetry_file_with_the_period_that_is_needed() -> None:
    assert "with a period of 0.02 s, and MAVLINK_PERIODIC_FREQUENCY" in PILOT.way_to_rate(50.0)


def test_the_route_is_ours_in_manual_and_ends_with_silence() -> None:
    assert PILOT.route is OVERRIDE
    assert OVERRIDE.loops == OURS
    assert (OVERRIDE.mode, OVERRIDE.mode_to_enter, OVERRIDE.mode_to_leave) == ("MANUAL", None, 0)
    assert OVERRIDE.silence_s == 0.5  # then its datalink RC counts as lost
    assert not OVERRIDE.releases
    assert not OVERRIDE.as_operator
    assert PILOT.release() == ()
    assert Paparazzi.routes == {"override": OVERRIDE}


def test_of_its_streams_only_the_airspeed_is_asked_for() -> None:
    sensors = Paparazzi.sensors
    assert sensors.airspeed is not None
    assert sensors.airspeed.message_id == mavlink.MAVLINK_MSG_ID_VFR_HUD
    assert (sensors.airspeed.name, sensors.airspeed.rate_hz) == ("VFR_HUD", 20.0)
    assert (sensors.imu, sensors.estimator, sensors.pitot_in_imu) == ((), None, False)
