"""Each firmware by each of its routes: what it is told, when it obeys, who it must be."""

import struct
from math import isfinite, pi

import pytest

from tgl_soar.geometry import euler_from_quaternion
from tgl_soar.link.autopilots import FIRMWARES, flavour, routes
from tgl_soar.link.autopilots.base import Flavour, SurfaceChannel, SurfaceChannels, value_bytewise
from tgl_soar.link.autopilots.requirements import Requirement, compare, wish
from tgl_soar.link.codec import Encoder
from tgl_soar.link.messages import (
    CommandLong,
    Heartbeat,
    ManualControl,
    ParamValue,
    RcChannelsOverride,
    SetActuatorControlTarget,
    SetAttitudeTarget,
    Source,
)
from tgl_soar.link.mode_change import PATIENCE_S, ModeChange
from tgl_soar.types import NO_SETPOINTS, OURS, THEIRS_WITH_RUDDER, Setpoints, SurfaceCommand

CHANNELS = SurfaceChannels(
    SurfaceChannel(2, 1100, 1500, 1900),
    SurfaceChannel(1, 1100, 1500, 1900),
    SurfaceChannel(4, 1100, 1500, 1900),
)
ALL = [(firmware, route.name) for firmware in FIRMWARES for route in routes(firmware)]
AUTOPILOT = {"ardupilot": 3, "bridge": 3, "px4": 12, "paparazzi": 9}
GUIDED, FBWA = 15, 5
OFFBOARD, STABILIZED = 6 << 16, 7 << 16
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
        found = pilot.mismatch(Heartbeat(1, autopilot, 81, 0, 4))
        assert (found == "") == (autopilot == AUTOPILOT[firmware])
    assert "no fixed wing" in pilot.mismatch(Heartbeat(2, AUTOPILOT[firmware], 81, 0, 4))


@pytest.mark.parametrize(("firmware", "route"), ALL)
def test_a_route_that_is_entered_obeys_there(firmware: str, route: str) -> None:
    pilot = target(firmware, route)
    if pilot.route.mode_to_enter is not None:
        assert pilot.obeys(Heartbeat(1, 3, 81, pilot.route.mode_to_enter, 4))
        assert not pilot.obeys(Heartbeat(1, 3, 81, pilot.route.mode_to_leave, 4))
    assert not pilot.obeys(Heartbeat(1, 3, 0, pilot.route.mode_to_enter or 0, 4))


def test_an_unknown_route_is_named_with_those_that_are() -> None:
    with pytest.raises(ValueError, match="attitude, manual_control, actuators"):
        target("px4", "override")


def test_arduplane_takes_the_yaw_of_an_attitude_for_its_rudder() -> None:
    (said,) = target("ardupilot", "attitude").commands(UP, NOSE_UP)
    assert isinstance(said, SetAttitudeTarget)
    roll, pitch, yaw = euler_from_quaternion(*said.q)
    assert (roll, pitch, yaw) == pytest.approx((-0.1, 0.2, pi / 4.0))
    assert said.type_mask == 0b01000111  # the attitude alone: no rates, no thrust
    assert target("ardupilot", "attitude").route.loops == THEIRS_WITH_RUDDER


def test_px4_s_attitude_is_level_in_yaw() -> None:
    (said,) = target("px4").commands(UP, NOSE_UP)
    assert isinstance(said, SetAttitudeTarget)
    assert euler_from_quaternion(*said.q) == pytest.approx((-0.1, 0.2, 0.0))


def test_px4_s_stick_is_pushed_to_lower_the_nose() -> None:
    (said,) = target("px4", "manual_control").commands(UP, NO_SETPOINTS)
    assert said == ManualControl(1, -500, -250, 0, 1000)


def test_px4_s_actuators_are_roll_pitch_yaw() -> None:
    (said,) = target("px4", "actuators").commands(UP, NO_SETPOINTS)
    assert isinstance(said, SetActuatorControlTarget)
    assert said.controls[:3] == (-0.25, 0.5, 1.0)


@pytest.mark.parametrize("share", [-1.0, -0.5, 0.0, 0.3, 1.0])
def test_paparazzi_s_eight_bits_have_the_sign_and_the_size_that_were_meant(share: float) -> None:
    (said,) = target("paparazzi").commands(SurfaceCommand(share, share, share), NO_SETPOINTS)
    assert isinstance(said, RcChannelsOverride)
    roll_us, pitch_us, throttle_us, yaw_us = said.channels[:4]
    # What its mavlink.c makes of them; its division truncates.
    roll = int(-(roll_us - 1500) * 255 / 1100 / 2)
    pitch = int(-(pitch_us - 1500) * 255 / 1100 / 2)
    yaw = int(-(yaw_us - 1500) * 255 / 1100)
    assert (roll, pitch, yaw) == pytest.approx((127 * share,) * 3, abs=1.0)
    assert (throttle_us - 950) * 127 // 1100 == 0
    assert target("paparazzi").release() == ()  # a 0 would be a full deflection


def test_paparazzi_obeys_with_manual_input_and_no_stabilisation() -> None:
    pilot = target("paparazzi")
    assert pilot.obeys(Heartbeat(1, 9, 1 | 64 | 128, 0, 4))
    assert not pilot.obeys(Heartbeat(1, 9, 1 | 64 | 16, 0, 4))  # AUTO1
    assert not pilot.obeys(Heartbeat(1, 9, 1 | 4, 0, 4))  # AUTO2


@pytest.mark.parametrize(("value", "kind"), [(1, 6), (-7, 6), (255, 1), (2**31, 5), (-5, 2)])
def test_whole_numbers_sent_as_their_bytes(value: int, kind: int) -> None:
    raw = struct.unpack("<f", struct.pack("<i" if value < 0 else "<I", value))[0]
    assert value_bytewise(ParamValue("X", raw, kind, 1, 0)) == value
    assert value_bytewise(ParamValue("X", 2.5, 9, 1, 0)) == 2.5


# --- into the mode and out of it ---------------------------------------------------------------


def asked_mode(said: tuple[object, ...]) -> float | None:
    if not said:
        return None
    (request,) = said
    assert isinstance(request, CommandLong)
    assert request.command == 176
    return request.params[1]


def test_the_mode_is_asked_for_until_it_has_come() -> None:
    change = ModeChange(target("ardupilot", "attitude"))
    change.enter(10.0, FBWA)
    asked = [asked_mode(change.poll(10.0 + 0.05 * i, False, FBWA)) for i in range(20)]
    assert asked[:6] == [GUIDED, None, None, None, None, GUIDED]
    assert change.is_entering
    assert change.poll(11.0, True, GUIDED) == ()
    assert not change.is_entering
    change.leave(20.0)
    assert asked_mode(change.poll(20.0, True, GUIDED)) == FBWA  # where it came from
    assert change.poll(20.3, False, FBWA) == ()
    assert change.failed == ""


def test_px4_s_modes_have_two_parts() -> None:
    change = ModeChange(target("px4"))
    change.enter(0.0, 4 << 16 | 3 << 24)
    (request,) = change.poll(0.0, False, 4 << 16 | 3 << 24)
    assert isinstance(request, CommandLong)
    assert request.params[:3] == (1.0, 6.0, 0.0)
    change.leave(1.0)
    (back,) = change.poll(1.0, True, OFFBOARD)
    assert isinstance(back, CommandLong)
    assert back.params[:3] == (1.0, 4.0, 3.0)


def test_a_mode_that_does_not_come_is_given_up() -> None:
    change = ModeChange(target("px4"))
    change.enter(0.0, STABILIZED)
    for i in range(round(PATIENCE_S / 0.1) + 1):
        change.poll(0.1 * i, False, STABILIZED)
    assert "does not enter OFFBOARD" in change.failed
    assert not change.is_entering


def test_the_pilot_s_choice_ends_the_asking() -> None:
    change = ModeChange(target("ardupilot", "attitude"))
    change.enter(0.0, FBWA)
    change.poll(0.0, False, FBWA)
    assert change.poll(0.5, False, 2) == ()
    assert "pilot" in change.failed


def test_a_mode_that_the_pilot_must_choose_is_never_asked_for() -> None:
    change = ModeChange(target("ardupilot"))
    change.enter(0.0, FBWA)
    assert not change.is_entering
    assert change.poll(0.0, False, FBWA) == ()
    assert change.parting() == ()


# --- what parameters must be -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("relation", "wanted", "good", "bad"),
    [
        ("is", 0.1, 0.10000000149, 0.2),
        ("is not", 0.0, 1.0, 0.0),
        ("at most", 0.5, 0.5, 3.0),
        ("at least", 250.0, 400.0, 50.0),
        ("has bit", 1.0, 34.0, 32.0),
        ("lacks bit", 1.0, 32.0, 34.0),
    ],
)
def test_a_requirement_holds_or_says_what_to_set(
    relation: str, wanted: float, good: float, bad: float
) -> None:
    row = Requirement(("NEW", "OLD"), relation, wanted, "because")
    (fine,), (wrong,), (silent,) = (
        compare((row,), answers) for answers in ({"OLD": good}, {"NEW": bad}, {"OTHER": 1.0})
    )
    assert fine.ok
    assert fine.name == "OLD"
    assert not wrong.ok
    assert "NEW" in wish(wrong)
    assert silent.value is None
    assert not silent.ok
    assert compare((row._replace(missing_ok=True),), {})[0].ok


def test_every_route_says_all_that_people_must_know() -> None:
    for firmware, name in ALL:
        route = target(firmware, name).route
        assert all(getattr(route, field) for field in ("message", "mode", "after_silence"))
        assert route.takeover
        assert isfinite(route.silence_s)
    assert all(routes(firmware)[0].name == target(firmware).route.name for firmware in FIRMWARES)
    assert all(any(r.loops == OURS for r in routes(firmware)) for firmware in FIRMWARES)
