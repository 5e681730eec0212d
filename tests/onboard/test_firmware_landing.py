"""What is asked of a firmware that is to land, byte for byte, and where its mission may land."""

from __future__ import annotations

from itertools import count
from math import nan, radians
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_launch_landing_switch import HOME, LANDING_ITEMS, Firmware, Reported, landing_by

from tgl_soar.autopilot import Output
from tgl_soar.control.supervisor import BREAKING_OFF, LANDING, READY, RELEASED, SOARING
from tgl_soar.geometry import SoaringFrame
from tgl_soar.link.autopilots.ardupilot import MODE_AUTO
from tgl_soar.link.autopilots.px4 import MODE_MISSION
from tgl_soar.link.messages import HomeMessage, MissionCurrent
from tgl_soar.onboard.flightlog.topics import rebuilt

BLANK: Output = rebuilt(Output, (0.0 for _ in count()))
BY_MISSION, BY_RETURN = 1.0, 2.0
STRIP_M = 20.0
DIFFER_M = 10.0  # what two receivers differ by, beside half of the strip


def at(mode: int, time_s: float, z_m: float = 50.0) -> Output:
    """A tick, well above everything, in the wind that the firmware reports."""
    vehicle, air = BLANK.vehicle._replace(z_m=z_m), BLANK.air._replace(wind_mps=8.0)
    active = mode == LANDING
    return BLANK._replace(mode=mode, active=active, time_s=time_s, vehicle=vehicle, air=air)


def read(firmware: Firmware, landing: Any, mode: int = READY) -> None:
    """Its mission, from when LND_BY was set on."""
    landing.tick(at(mode, 0.5))
    firmware.answers(0.6)
    landing.tick(at(mode, 0.7))


# --- what is asked --------------------------------------------------------------------------------


def asked_in_landing(firmware: Firmware) -> tuple[Reported, Any]:
    reported = Reported()
    landing = landing_by(firmware, reported, BY_MISSION)
    firmware.time_s = nan  # no heartbeat yet
    read(firmware, landing, LANDING)
    assert reported.sent == []
    firmware.time_s = 2.0
    landing.tick(at(LANDING, 2.0))
    return reported, landing


@pytest.mark.parametrize("name", ["ardupilot", "px4"])
def test_a_landing_is_asked_for_as_the_protocol_has_it(name: str) -> None:
    """DO_LAND_START: all seven parameters are empty or reserved; to the autopilot itself."""
    reported, _ = asked_in_landing(Firmware(name))
    (request,) = reported.sent
    assert request.command == mavlink.MAV_CMD_DO_LAND_START
    assert request.params == (0.0,) * 7
    assert (request.target_system, request.target_component) == (1, 1)
    assert request.confirmation == 0  # the first time


def test_after_the_hand_over_the_item_is_asked_for_as_the_protocol_has_it() -> None:
    firmware = Firmware("ardupilot")
    reported, landing = asked_in_landing(firmware)
    reported.sent.clear()
    firmware.custom_mode = MODE_AUTO
    for k in range(4):
        landing.tick(at(RELEASED, 3.0 + 0.1 * k))
    (request,) = reported.sent
    assert request.command == mavlink.MAV_CMD_REQUEST_MESSAGE
    assert request.params == (float(mavlink.MAVLINK_MSG_ID_MISSION_CURRENT), *(0.0,) * 6)


def test_px4_lands_in_its_mission_mode() -> None:
    firmware = Firmware("px4")
    reported, landing = asked_in_landing(firmware)
    firmware.custom_mode = MODE_MISSION
    landing.tick(at(RELEASED, 3.0))
    firmware.mission.take(MissionCurrent(3))
    landing.tick(at(RELEASED, 3.1))
    assert reported.words == ["the autopilot lands: item 3 of its mission"]


@pytest.mark.parametrize(("again_s", "asked"), [(0.4, 1), (0.6, 2)])
def test_it_is_asked_for_again_after_a_heartbeat_that_can_be_an_answer(
    again_s: float, asked: int
) -> None:
    """A radio's round trip and what the firmware takes to act: half a second."""
    firmware = Firmware("ardupilot")
    reported, landing = asked_in_landing(firmware)
    firmware.time_s = 2.0 + again_s
    landing.tick(at(LANDING, 2.0 + again_s))
    assert len(reported.sent) == asked


# --- where it may land ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("off_x_m", "off_y_m", "length_m", "fits"),
    [
        (0.0, STRIP_M / 2 + DIFFER_M - 1.0, STRIP_M, True),
        (0.0, STRIP_M / 2 + DIFFER_M + 1.0, STRIP_M, False),
        (0.0, -(STRIP_M / 2 + DIFFER_M + 1.0), STRIP_M, False),
        (-(STRIP_M / 2 + DIFFER_M - 1.0), 0.0, STRIP_M, True),
        (STRIP_M / 2 + DIFFER_M + 1.0, 0.0, STRIP_M, False),
        (15.0, 15.0, STRIP_M, False),  # 21 m
        (0.0, 11.0, 0.5, False),  # a strip for a net
        (0.0, 1000.0, 0.0, True),  # without a strip no place is known
    ],
)
def test_a_touch_down_may_be_off_by_half_the_strip_and_what_receivers_differ_by(
    off_x_m: float, off_y_m: float, length_m: float, fits: bool
) -> None:
    firmware, reported = Firmware("ardupilot"), Reported()
    place = {"LND_X": -28.0 + off_x_m, "LND_Y": off_y_m, "LND_LEN": length_m}
    landing = landing_by(firmware, reported, BY_MISSION, **place)
    read(firmware, landing)
    assert [word for word in reported.words if "from LND_X and LND_Y" in word] == (
        [] if fits else reported.words
    )
    assert len(reported.words) == (not fits)


def test_where_the_frame_lies_is_not_known_any_place_fits() -> None:
    firmware, reported = Firmware("ardupilot"), Reported()
    firmware.position = firmware.position.__class__(home=None)
    landing = landing_by(firmware, reported, BY_MISSION, LND_X=5000.0)
    read(firmware, landing)
    assert reported.words == []


@pytest.mark.parametrize(
    ("item", "lands"), [(1, True), (3, True), (4, False), (5, True), (6, True), (7, False)]
)
def test_any_of_several_landings_will_do(item: int, lands: bool) -> None:
    two = (*LANDING_ITEMS, (16, 0.0), (189, 0.0), (21, 28.0), (16, 0.0))
    firmware = Firmware("ardupilot", two)
    reported, landing = asked_in_landing(firmware)
    firmware.custom_mode = MODE_AUTO
    landing.tick(at(RELEASED, 3.0))
    firmware.mission.take(MissionCurrent(item))
    for k in range(60):
        landing.tick(at(RELEASED, 3.1 + 0.1 * k))
    (words,) = reported.words
    assert (f"the autopilot lands: item {item}" in words) is lands


# --- the home of an ArduPlane ---------------------------------------------------------------------


@pytest.mark.parametrize(("over_m", "asked"), [(9.2, False), (10.5, True), (-3.0, False)])
def test_within_ten_metres_of_its_home_an_arduplane_lands_nothing(
    over_m: float, asked: bool
) -> None:
    """Its loop of speed and height does not run below that; whatever the frame is turned by."""
    firmware, reported = Firmware("ardupilot"), Reported()
    firmware.frame = SoaringFrame(3.0, -4.0, -6.0, radians(270.0))
    landing = landing_by(firmware, reported, BY_MISSION, LND_LEN=0.0)
    place = (round(HOME.latitude_deg * 1e7), round(HOME.longitude_deg * 1e7))
    height_mm = round(1000.0 * (HOME.altitude_m + 5.0))  # of the autopilot's home
    firmware.mission.take(HomeMessage(*place, height_mm))
    z_m = 5.0 - 6.0 + over_m  # the frame's origin is 6 m above the site's home
    landing.tick(at(LANDING, 0.5, z_m))
    firmware.answers(0.6)
    for k in range(4):
        firmware.time_s = 1.0 + 0.1 * k
        landing.tick(at(LANDING, 1.0 + 0.1 * k, z_m))
    assert bool(reported.sent) is asked
    assert len(reported.words) == (not asked)
    assert all(word.startswith(f"its home is {over_m:.0f} m below us") for word in reported.words)


# --- when it is read ------------------------------------------------------------------------------


def test_the_mission_is_read_when_it_is_set_and_as_it_breaks_off_and_not_again_in_landing() -> None:
    firmware, reported = Firmware("ardupilot"), Reported()
    landing = landing_by(firmware, reported, BY_MISSION)
    begun: list[float] = []
    now = 0.0
    begin = firmware.mission.begin

    def counted() -> None:
        begun.append(now)
        begin()

    firmware.mission.begin = counted  # type: ignore[method-assign]
    for now, mode in ((1.0, READY), (2.0, SOARING), (3.0, BREAKING_OFF), (4.0, LANDING)):
        landing.tick(at(mode, now))
        firmware.answers(now + 0.1)
        landing.tick(at(mode, now + 0.5))
    assert begun == [1.0, 3.0]
    now = 5.0
    landing.tick(at(READY, now))
    now = 6.0
    landing.tick(at(LANDING, now))  # a landing without a way home
    assert begun == [1.0, 3.0, 6.0]


def test_no_mission_is_read_where_the_firmware_lands_by_its_return_or_not_at_all() -> None:
    for by in (BY_RETURN, 0.0):
        firmware, reported = Firmware("px4"), Reported()
        landing = landing_by(firmware, reported, by)
        landing.tick(at(BREAKING_OFF, 1.0))
        assert firmware.mission.poll(1.1) == []
        assert reported.words == []


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("ardupilot", 0.0, ""),
        ("ardupilot", 1.0, ""),
        ("ardupilot", 2.0, "the return of ardupilot does not land, unless RTL_AUTOLAND says so:"),
        ("px4", 1.0, ""),
        ("px4", 2.0, ""),
        ("px4", 3.0, "the return of px4 does not land"),
        ("paparazzi", 1.0, "no landing of paparazzi is known: 0"),
    ],
)
def test_only_landings_that_a_firmware_has_may_be_set(name: str, value: float, words: str) -> None:
    landing = landing_by(Firmware(name), Reported(), 0.0)
    found = landing.refusal(value)
    assert found.startswith(words)
    assert bool(found) == bool(words)
