"""LNC_START and ESC_START over the air, and the firmware's own landing."""

from __future__ import annotations

from math import degrees, inf, isnan, nan, radians
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_module import Flight, texts

from tgl_soar.autopilot import Output
from tgl_soar.config.site import HomePosition, PositionSettings
from tgl_soar.control.launch_landing import LaunchLandingReport
from tgl_soar.control.supervisor import (
    BEATING,
    BREAKING_OFF,
    HOLDING,
    LANDING,
    LAUNCHING,
    READY,
    RELEASED,
    SOARING,
)
from tgl_soar.geometry import SoaringFrame
from tgl_soar.link.autopilots.ardupilot import MODE_AUTO
from tgl_soar.link.autopilots.px4 import MODE_RETURN, Px4
from tgl_soar.link.messages import (
    COMMAND_DO_LAND_START,
    COMMAND_DO_SET_MODE,
    COMMAND_REQUEST_MESSAGE,
    HomeMessage,
    MissionCount,
    MissionCurrent,
    MissionItemInt,
    MissionRequestInt,
    MissionRequestList,
    Source,
    WindCov,
)
from tgl_soar.link.mission import MissionReading
from tgl_soar.link.mode_change import TRIES
from tgl_soar.link.stream_requests import StreamRequests
from tgl_soar.link.vehicle.autopilot_wind import AutopilotWind
from tgl_soar.link.vehicle.diagnostics import Ledger, SessionCounters
from tgl_soar.onboard.firmware_landing import FirmwareLanding
from tgl_soar.onboard.launch_landing_switch import LaunchLandingSwitch
from tgl_soar.types import NO_AIR


class Settings:
    """Parameters, and what was assigned."""

    def __init__(self, **values: float) -> None:
        self.values = {"LNC_START": 0.0, "ESC_START": 0.0, "BEAT_START": 0.0, "LND_BY": 0.0}
        self.values |= values

    def assign(self, name: str, value: float) -> None:
        self.values[name] = value


class Reported:
    """An outbox."""

    def __init__(self) -> None:
        self.words: list[str] = []
        self.sent: list[Any] = []
        self.autopilot = object()

    def tell(self, _severity: int, text: str) -> None:
        self.words.append(text)

    def say_all(self, messages: Any, _route: object) -> None:
        self.sent.extend(messages)


def output_of(flight: Flight, mode: int, time_s: float = 0.0, left_m: float = 9.0) -> Output:
    assert flight.onboard.output is not None
    report = LaunchLandingReport(launch=0, height_left_m=left_m, time_left_s=75.0)
    return flight.onboard.output._replace(
        mode=mode,
        active=mode not in (READY, RELEASED),
        launch_landing=report,
        time_s=time_s,
        air=NO_AIR._replace(wind_mps=8.0, cross_wind_mps=0.0),
    )


@pytest.fixture(scope="module")
def flight() -> Flight:
    flown = Flight()
    flown.base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    flown.engaged().run(4.0)
    assert flown.mode_now == SOARING
    flown.outbound()
    return flown


def test_the_height_is_reported_as_it_goes_once_each(flight: Flight) -> None:
    settings, reported = Settings(), Reported()
    switch = LaunchLandingSwitch(settings, reported)  # type: ignore[arg-type]
    for left in (9.0, 4.9, 4.8, 5.1, 4.9, 1.9, 1.0, -0.1, -0.5):
        switch.tick(output_of(flight, SOARING, left_m=left))
    assert reported.words == [
        f"height left for the landing: {left} m, 1:15 min" for left in ("4.9", "1.9", "-0.1")
    ]
    switch.tick(output_of(flight, SOARING, left_m=9.0))
    switch.tick(output_of(flight, SOARING, left_m=4.0))
    assert len(reported.words) == 4  # it was clearly more again
    switch.tick(output_of(flight, LANDING, left_m=1.0))
    assert len(reported.words) == 4  # it is on its way


def test_the_switches_go_back_by_themselves(flight: Flight) -> None:
    settings = Settings(LNC_START=1.0, ESC_START=1.0)
    switch = LaunchLandingSwitch(settings, Reported())  # type: ignore[arg-type]
    switch.tick(output_of(flight, LAUNCHING))
    assert settings.values["LNC_START"] == 1.0
    switch.tick(output_of(flight, BREAKING_OFF))
    assert (settings.values["LNC_START"], settings.values["ESC_START"]) == (0.0, 1.0)
    switch.tick(output_of(flight, RELEASED))
    assert settings.values["ESC_START"] == 0.0
    # However a flight ends, no launch is left for the next one.
    settings.values["LNC_START"] = 1.0
    switch.tick(output_of(flight, SOARING))
    assert settings.values["LNC_START"] == 1.0
    switch.tick(output_of(flight, READY))
    assert settings.values["LNC_START"] == 0.0


def test_what_has_broken_off_asks_for_nothing_any_more(flight: Flight) -> None:
    """A file that is saved on the way home must not end the next flight when it is loaded."""
    settings = Settings(ESC_START=1.0)
    switch = LaunchLandingSwitch(settings, Reported())  # type: ignore[arg-type]
    switch.tick(output_of(flight, SOARING, 10.0))
    switch.tick(output_of(flight, BREAKING_OFF, 10.1))
    switch.tick(output_of(flight, BREAKING_OFF, 10.9))
    assert settings.values["ESC_START"] == 1.0
    switch.tick(output_of(flight, LANDING, 11.1))
    assert settings.values["ESC_START"] == 0.0
    settings.values["ESC_START"] = 2.0
    for k in range(5):
        switch.tick(output_of(flight, SOARING, 12.0 + k))
    assert settings.values["ESC_START"] == 2.0  # that stands for the flight


def test_a_launch_that_nobody_engages_expires(flight: Flight) -> None:
    settings, reported = Settings(LNC_START=1.0), Reported()
    switch = LaunchLandingSwitch(settings, reported)  # type: ignore[arg-type]
    for now in (0.0, 59.0):
        switch.tick(output_of(flight, READY, now))
        assert settings.values["LNC_START"] == 1.0
    switch.tick(output_of(flight, READY, 61.0))
    assert settings.values["LNC_START"] == 0.0
    assert reported.words == ["LNC_START is 0 again: nothing was engaged within 60 s"]
    settings.values["LNC_START"] = 1.0
    for k in range(100):  # in the hand for longer, in control
        switch.tick(output_of(flight, LAUNCHING, 62.0 + k))
    assert settings.values["LNC_START"] == 1.0


def test_what_makes_no_sense_is_refused(flight: Flight) -> None:
    switch = LaunchLandingSwitch(Settings(), Reported())  # type: ignore[arg-type]
    assert switch.refusal("LNC_START", 1.0, active=True)
    assert not switch.refusal("LNC_START", 1.0, active=False)
    assert switch.refusal("ESC_START", 2.0, active=True)
    assert switch.refusal("ESC_START", 1.0, active=False)
    assert not switch.refusal("ESC_START", 1.0, active=True)
    assert not switch.refusal("ESC_START", 0.0, active=False)
    ready = output_of(flight, READY)
    for clearance, refused in ((1.5, False), (9.0, True)):
        margins = ready.margins._replace(clearance_m=clearance)
        switch.tick(ready._replace(margins=margins))
        assert bool(switch.refusal("LNC_START", 1.0, active=False)) == refused
    switch.tick(output_of(flight, BREAKING_OFF))
    assert not switch.refusal("ESC_START", 2.0, active=True)


def test_beating_is_refused_without_a_line_or_room_and_over_with_the_flight(flight: Flight) -> None:
    settings = Settings(BEAT_WIDTH=40.0)
    switch = LaunchLandingSwitch(settings, Reported())  # type: ignore[arg-type]
    switch.tick(output_of(flight, SOARING))
    assert switch.refusal("BEAT_START", 1.0, active=True) == ""
    assert switch.refusal("BEAT_START", 1.0, active=False)
    settings.values["BEAT_WIDTH"] = 0.0
    assert "BEAT_WIDTH" in switch.refusal("BEAT_START", 1.0, active=True)
    settings.values["BEAT_WIDTH"] = 40.0
    for mode in (BREAKING_OFF, LANDING, LAUNCHING):
        switch.tick(output_of(flight, mode))
        assert switch.refusal("BEAT_START", 1.0, active=True)
        assert switch.refusal("BEAT_START", 0.0, active=True) == ""
    for after in (BREAKING_OFF, RELEASED):
        settings.values["BEAT_START"] = 1.0
        for mode in (SOARING, BEATING):
            switch.tick(output_of(flight, mode))
            assert settings.values["BEAT_START"] == 1.0
        switch.tick(output_of(flight, after))
        assert settings.values["BEAT_START"] == 0.0


def test_beating_that_never_began_is_not_asked_for_after_the_way_home(flight: Flight) -> None:
    """There was no room for it: whoever soars on from home (ESC_START 2) would beat at once."""
    settings = Settings(BEAT_WIDTH=40.0, BEAT_START=1.0)
    switch = LaunchLandingSwitch(settings, Reported())  # type: ignore[arg-type]
    switch.tick(output_of(flight, SOARING))
    assert settings.values["BEAT_START"] == 1.0
    switch.tick(output_of(flight, BREAKING_OFF))
    assert settings.values["BEAT_START"] == 0.0


def test_a_break_off_by_command_over_the_air() -> None:
    flown = Flight()
    flown.base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    flown.run(1.0)
    flown.set("ESC_START", 1.0)  # from a file: it must not wait for the flight
    assert flown.onboard.settings.values["ESC_START"] == 0.0
    flown.engaged().run(4.0)
    flown.set("ESC_START", 1.0)
    assert flown.onboard.settings.values["ESC_START"] == 1.0
    flown.run(0.1)
    assert flown.mode_now == BREAKING_OFF
    assert "breaking off: breaks off" in texts(flown.outbound())
    flown.set("OP_ENGAGE", 0.0)
    flown.run(0.1)
    assert flown.onboard.settings.values["ESC_START"] == 0.0


HOME = HomePosition(latitude_deg=52.0, longitude_deg=4.4, altitude_m=10.0)
LANDING_ITEMS = ((16, 0.0), (189, 0.0), (16, 15.0), (21, 28.0))  # command, west of home [m]


class RightWind(AutopilotWind):
    """From where ours comes, at all times."""

    def known(self, now_s: float) -> tuple[float, float]:  # noqa: ARG002
        return 0.0, 8.0


class Firmware:
    """A setup and a session with a firmware that may land."""

    def __init__(self, name: str, items: tuple[tuple[int, float], ...] = LANDING_ITEMS) -> None:
        self.name = name
        self.mission = MissionReading(Source(1, 191))
        self.position = PositionSettings(home=HOME)
        self.frame = SoaringFrame(0.0, 0.0, 0.0, radians(270.0))
        self._items = items
        self.flavour = self
        self.status = self
        self.time_s = 0.0
        self.custom_mode = 5
        self.streams = StreamRequests(1)
        ledger = Ledger(SessionCounters(), [], self.streams)
        self.wind: AutopilotWind = RightWind(Px4.sensors.wind, ledger)

    @property
    def autopilot(self) -> Any:
        return type("Source", (), {"system": 1})

    def answers(self, now_s: float) -> None:
        """What is asked of its mission."""
        for _ in range(2 * len(self._items) + 2):
            for message in self.mission.poll(now_s):
                if isinstance(message, MissionRequestList):
                    self.mission.take(MissionCount(1, 191, len(self._items)))
                elif isinstance(message, MissionRequestInt):
                    command, west_m = self._items[message.seq]
                    self.mission.take(
                        MissionItemInt(
                            target_system=1,
                            target_component=191,
                            seq=message.seq,
                            command=command,
                            x=round(HOME.latitude_deg * 1e7),
                            y=round((HOME.longitude_deg - degrees(west_m / 3.9349e6)) * 1e7),
                        )
                    )

    def ask_for_mode(self, custom_mode: int) -> Any:
        return type("Asked", (), {"command": COMMAND_DO_SET_MODE, "mode": custom_mode})


PLACE = {"LND_X": -28.0, "LND_Y": 0.0, "LND_LEN": 20.0}


def landing_by(firmware: Firmware, reported: Reported, by: float, **values: float) -> Any:
    settings: Any = Settings(LND_BY=by, **{**PLACE, **values})
    return FirmwareLanding(firmware, settings, firmware, reported)  # type: ignore[arg-type]


def test_the_landing_of_a_mission_is_read_asked_for_and_checked(flight: Flight) -> None:
    firmware, reported = Firmware("ardupilot"), Reported()
    landing = landing_by(firmware, reported, 1.0)
    landing.tick(output_of(flight, SOARING, 0.5))
    firmware.answers(0.6)
    landing.tick(output_of(flight, BREAKING_OFF, 1.0))
    assert not firmware.mission.is_known  # it is read again: a station may have changed it
    firmware.time_s = 2.0
    landing.tick(output_of(flight, LANDING, 2.0))
    assert reported.sent == []  # until it is known
    firmware.answers(2.1)
    for k in range(100):
        landing.tick(output_of(flight, LANDING, 2.2 + 0.005 * k))
    assert [message.command for message in reported.sent] == [COMMAND_DO_LAND_START]
    firmware.time_s, firmware.custom_mode = 3.0, MODE_AUTO
    firmware.mission.take(MissionCurrent(2))  # of before
    landing.tick(output_of(flight, RELEASED, 3.0))
    landing.tick(output_of(flight, RELEASED, 3.1))
    assert [message.command for message in reported.sent[1:]] == [COMMAND_REQUEST_MESSAGE]
    assert reported.words == []
    firmware.mission.take(MissionCurrent(2))
    landing.tick(output_of(flight, RELEASED, 3.2))
    assert reported.words == ["the autopilot lands: item 2 of its mission"]


@pytest.mark.parametrize(
    ("name", "over_home_m", "asked"),
    [
        ("ardupilot", 13.0, True),
        ("ardupilot", 9.0, False),
        ("ardupilot", nan, True),
        ("px4", 9.0, True),
    ],
)
def test_an_arduplane_that_takes_itself_for_not_launched_is_not_asked(
    flight: Flight, name: str, over_home_m: float, asked: bool
) -> None:
    firmware, reported = Firmware(name), Reported()
    landing = landing_by(firmware, reported, 1.0)
    high = output_of(flight, LANDING, 1.0)
    if over_home_m == over_home_m:
        up_m = HOME.altitude_m + high.vehicle.z_m - over_home_m
        place = (round(HOME.latitude_deg * 1e7), round(HOME.longitude_deg * 1e7))
        firmware.mission.take(HomeMessage(*place, round(1000.0 * up_m)))
    landing.tick(high)
    firmware.answers(1.1)
    for k in range(5):
        firmware.time_s = 2.0 + 0.1 * k
        landing.tick(high._replace(time_s=2.0 + 0.1 * k))
    assert [message.command for message in reported.sent] == (
        [COMMAND_DO_LAND_START] if asked else []
    )
    words = "its home is 9 m below us, and within 10 m of that it takes itself for not launched"
    assert reported.words == ([] if asked else [f"{words}: we land"])


def handed_over(flight: Flight, time_s: float) -> tuple[Firmware, Reported, Any]:
    """A mission that was asked for in LANDING, and is flown since `time_s`."""
    firmware, reported = Firmware("ardupilot"), Reported()
    landing = landing_by(firmware, reported, 1.0)
    landing.tick(output_of(flight, LANDING, time_s - 1.0))
    firmware.answers(time_s - 0.9)
    firmware.time_s = time_s - 0.5
    landing.tick(output_of(flight, LANDING, time_s - 0.5))
    assert [message.command for message in reported.sent] == [COMMAND_DO_LAND_START]
    firmware.time_s, firmware.custom_mode = time_s, MODE_AUTO
    landing.tick(output_of(flight, RELEASED, time_s))
    return firmware, reported, landing


@pytest.mark.parametrize("since_s", [0.5, 2.9])
@pytest.mark.parametrize("clock_s", [0.0, 4000.0, -95.0])
def test_a_conversation_that_begins_again_after_the_hand_over_is_no_false_alarm(
    flight: Flight, since_s: float, clock_s: float
) -> None:
    """The autopilot has restarted, or our clock was set by so much: its mission is not known for
    a while, and no item was reported yet."""
    firmware, reported, landing = handed_over(flight, 100.0)
    landing.tick(output_of(flight, RELEASED, 100.0 + since_s))
    firmware.mission.restart()
    restart_s = 100.0 + since_s + clock_s
    for k in range(20):
        landing.tick(output_of(flight, RELEASED, restart_s + 0.1 * k))
    firmware.mission.take(MissionCurrent(2))
    landing.tick(output_of(flight, RELEASED, restart_s + 2.5))
    assert reported.words == ["the autopilot lands: item 2 of its mission"]


def test_one_that_starts_again_and_does_not_land_is_reported_all_the_same(flight: Flight) -> None:
    firmware, reported, landing = handed_over(flight, 100.0)
    firmware.mission.restart()
    for k in range(100):
        landing.tick(output_of(flight, RELEASED, 102.0 + 0.1 * k))
    words = "the autopilot is in its mission at an item that it does not tell, not landing"
    assert reported.words == [f"{words}: take over"]


def test_a_clock_that_goes_back_does_not_keep_it_from_asking(flight: Flight) -> None:
    firmware, reported = Firmware("px4"), Reported()
    landing = landing_by(firmware, reported, 2.0)
    for now in (5000.0, 1.0):
        firmware.time_s = now
        landing.tick(output_of(flight, LANDING, now))
        firmware.mission.restart()
    assert [message.command for message in reported.sent] == [COMMAND_DO_SET_MODE] * 2


def test_a_mission_that_flies_elsewhere_is_reported(flight: Flight) -> None:
    """Before its landing, behind it (a mission may go on there, or go around), or unknown."""
    for item, words in (
        (0, "at item 0"),
        (len(LANDING_ITEMS), "at item 4"),
        (None, "at an item that it does not tell"),
    ):
        firmware, reported = Firmware("ardupilot"), Reported()
        landing = landing_by(firmware, reported, 1.0)
        landing.tick(output_of(flight, LANDING, 1.0))
        firmware.answers(1.1)
        firmware.time_s = 2.0
        landing.tick(output_of(flight, LANDING, 2.0))
        firmware.custom_mode = MODE_AUTO
        landing.tick(output_of(flight, RELEASED, 2.5))
        if item is not None:
            firmware.mission.take(MissionCurrent(item))
        for k in range(100):
            landing.tick(output_of(flight, RELEASED, 2.6 + 0.1 * k))
        assert reported.words == [
            f"the autopilot is in its mission {words}, not landing: take over"
        ]
        asked = [m for m in reported.sent if m.command == COMMAND_REQUEST_MESSAGE]
        assert 4 <= len(asked) <= 7


@pytest.mark.parametrize(
    ("items", "why"),
    [
        (((16, 0.0), (21, 28.0)), "its mission has no landing (DO_LAND_START, then NAV_LAND)"),
        (((16, 0.0), (189, 0.0), (16, 9.0)), "its mission has no landing"),
        ((), "its mission has no landing"),
        ((*LANDING_ITEMS, (189, 0.0), (21, 60.0)), "item 5, is 32 m from LND_X and LND_Y"),
    ],
)
def test_a_mission_that_does_not_land_there_is_not_asked_for(
    flight: Flight, items: tuple[tuple[int, float], ...], why: str
) -> None:
    firmware, reported = Firmware("ardupilot", items), Reported()
    landing = landing_by(firmware, reported, 1.0)
    landing.tick(output_of(flight, READY, 0.5))
    firmware.answers(0.6)
    landing.tick(output_of(flight, READY, 0.7))
    assert len(reported.words) == 1  # on the ground
    assert why in reported.words[0]
    assert reported.words[0].startswith("LND_BY 1: ")
    landing.tick(output_of(flight, LANDING, 1.0))
    firmware.answers(1.1)
    for k in range(10):
        firmware.time_s = 2.0 + k
        landing.tick(output_of(flight, LANDING, 2.0 + k))
    assert reported.sent == []
    assert reported.words[1:] == [reported.words[0].removeprefix("LND_BY 1: ")]


def test_a_landing_within_the_strip_and_what_receivers_differ_by_is_the_place(
    flight: Flight,
) -> None:
    for length, place, count in (
        (20.0, -28.0, 0),
        (20.0, -47.0, 0),
        (20.0, -49.0, 1),
        (0.0, 0.0, 0),
    ):
        firmware, reported = Firmware("ardupilot"), Reported()
        landing = landing_by(firmware, reported, 1.0, LND_LEN=length, LND_X=place)
        landing.tick(output_of(flight, READY, 0.5))
        firmware.answers(0.6)
        landing.tick(output_of(flight, READY, 0.7))
        assert len(reported.words) == count


def test_a_mission_that_cannot_be_read_is_not_asked_for(flight: Flight) -> None:
    firmware, reported = Firmware("ardupilot"), Reported()
    landing = landing_by(firmware, reported, 1.0)
    for k in range(60):
        now = 1.0 + 0.1 * k
        firmware.time_s = now
        landing.tick(output_of(flight, LANDING, now))
        firmware.mission.poll(now)
    assert reported.sent == []
    assert reported.words == ["its mission cannot be read: no answer: we land"]


def test_a_return_that_lands_is_asked_for_and_seen(flight: Flight) -> None:
    firmware, reported = Firmware("px4"), Reported()
    landing = landing_by(firmware, reported, 2.0)
    landing.tick(output_of(flight, BREAKING_OFF, 1.0))
    assert reported.sent == []
    firmware.time_s = 2.0
    for k in range(100):
        landing.tick(output_of(flight, LANDING, 2.0 + 0.005 * k))
    assert [message.command for message in reported.sent] == [COMMAND_DO_SET_MODE]
    firmware.time_s, firmware.custom_mode = 3.0, MODE_RETURN
    landing.tick(output_of(flight, RELEASED, 3.0))
    assert reported.words == ["the autopilot lands"]


@pytest.mark.parametrize(("late_s", "is_reported"), [(1.5, True), (2.5, False)])
def test_a_mode_that_is_seen_after_the_surfaces_do_not_answer_is_the_landing_asked_for(
    flight: Flight, late_s: float, is_reported: bool
) -> None:
    """As of a PX4 by manual control, whose heartbeat comes once a second."""
    firmware, reported = Firmware("px4"), Reported()
    landing = landing_by(firmware, reported, 2.0)
    firmware.time_s = 2.0
    landing.tick(output_of(flight, LANDING, 2.0))
    for k in range(1, round(10.0 * late_s)):
        landing.tick(output_of(flight, RELEASED, 2.0 + 0.1 * k))
    assert reported.words == []
    firmware.time_s, firmware.custom_mode = 2.0 + late_s, MODE_RETURN
    for k in range(3):
        landing.tick(output_of(flight, RELEASED, 2.0 + late_s + 0.1 * k))
    assert reported.words == ["the autopilot lands"] * is_reported


def test_a_firmware_that_does_not_land_leaves_it_to_us(flight: Flight) -> None:
    firmware, reported = Firmware("px4"), Reported()
    landing: Any = FirmwareLanding(firmware, Settings(LND_BY=2.0), firmware, reported)  # type: ignore[arg-type]
    for k in range(10):
        firmware.time_s = float(k + 1)
        landing.tick(output_of(flight, LANDING, float(k + 1)))
    assert len(reported.sent) == TRIES
    assert reported.words == [f"the autopilot does not land ({TRIES} times asked): we do"]
    landing.tick(output_of(flight, RELEASED, 20.0))
    assert len(reported.words) == 1  # on the ground, in its old mode


def test_a_firmware_whose_landing_is_not_known_is_refused() -> None:
    firmware = Firmware("bridge")
    landing: Any = FirmwareLanding(firmware, Settings(), firmware, Reported())  # type: ignore[arg-type]
    assert "bridge" in landing.refusal(1.0)
    assert landing.refusal(0.0) == ""
    with_mission: Any = FirmwareLanding(Firmware("ardupilot"), Settings(), firmware, Reported())  # type: ignore[arg-type]
    assert with_mission.refusal(1.0) == ""
    assert "RTL_AUTOLAND" in with_mission.refusal(2.0)


def test_a_return_that_does_not_land_is_not_asked_for(flight: Flight) -> None:
    """Not by a value from a file either."""
    firmware, reported = Firmware("ardupilot"), Reported()
    landing: Any = FirmwareLanding(firmware, Settings(LND_BY=2.0), firmware, reported)  # type: ignore[arg-type]
    landing.tick(output_of(flight, READY, 0.5))
    for k in range(10):
        firmware.time_s = float(k + 1)
        landing.tick(output_of(flight, LANDING, float(k + 1)))
    assert reported.sent == []
    words = "LND_BY 2: the return of ardupilot does not land, unless RTL_AUTOLAND says so: we land"
    assert reported.words == [words, words]  # when it was read from the file, and on the way home


def test_after_an_operator_takes_the_landing_back_no_other_is_reported(flight: Flight) -> None:
    firmware, reported, settings = Firmware("px4"), Reported(), Settings(LND_BY=1.0)
    landing: Any = FirmwareLanding(firmware, settings, firmware, reported)  # type: ignore[arg-type]
    firmware.time_s, firmware.custom_mode = 1.0, MODE_RETURN
    landing.tick(output_of(flight, LANDING, 1.0))
    settings.values["LND_BY"] = 0.0
    landing.tick(output_of(flight, LANDING, 1.1))
    assert reported.words == []


def in_wind(flight: Flight, mode: int, time_s: float, along: float, across: float = 0.0) -> Output:
    output = output_of(flight, mode, time_s)
    return output._replace(air=output.air._replace(wind_mps=along, cross_wind_mps=across))


def cov(north: float, east: float) -> WindCov:
    return WindCov(
        time_usec=0, wind_x=north, wind_y=east, wind_z=0.0, horiz_accuracy=1.0, vert_accuracy=1.0
    )


class WayHome:
    """A tick a second of a firmware's landing, with its wind towards north and east, and ours along
    the frame: the wind blows from the west, so that of the aircraft, [8, 0], is [0, 8] in NED."""

    def __init__(self, flight: Flight, by: float = 2.0) -> None:
        self.flight, self.firmware, self.reported = flight, Firmware("px4"), Reported()
        ledger = Ledger(SessionCounters(), [], self.firmware.streams)
        self.firmware.wind = AutopilotWind(Px4.sensors.wind, ledger)
        self.settings: Any = Settings(LND_BY=by, **PLACE)
        firmware: Any = self.firmware
        self.landing = FirmwareLanding(firmware, self.settings, firmware, self.reported)  # type: ignore[arg-type]
        self.now_s = 0.0

    def flies(
        self,
        mode: int,
        theirs: tuple[float, float] | None,
        along: float = 8.0,
        across: float = 0.0,
        seconds: int = 1,
    ) -> list[Any]:
        """What has been sent since the flight began, after so many seconds of this."""
        for _ in range(seconds):
            self.now_s += 1.0
            self.firmware.time_s = self.now_s
            self.firmware.answers(self.now_s)
            if theirs is not None:
                self.firmware.wind.take(cov(*theirs), self.now_s)
            self.landing.tick(in_wind(self.flight, mode, self.now_s, along, across))
        return self.reported.sent


@pytest.mark.parametrize(
    ("north", "east", "along", "refused"),
    [
        (0.0, 8.0, 8.0, False),
        (0.0, -8.0, 8.0, True),  # the mirrored solution
        (0.0, -2.01, 5.0, True),
        (0.0, -1.99, 5.0, False),  # an estimate that is about nothing yet
        (-7.0, 1.0, 8.0, False),  # across
        (0.0, -8.0, 4.1, True),
        (0.0, -8.0, 3.9, False),  # unknown
        (0.0, -8.0, nan, False),
        (nan, nan, 8.0, False),  # it was not received
        (0.0, -inf, 8.0, False),
    ],
)
@pytest.mark.parametrize("by", [1.0, 2.0])
def test_an_autopilot_with_a_wind_from_the_wrong_side_does_not_get_to_land(
    flight: Flight, by: float, north: float, east: float, along: float, refused: bool
) -> None:
    home = WayHome(flight, by)
    home.flies(READY, (north, east), along, seconds=5)
    assert home.firmware.streams.wanted(231) is not None
    home.flies(BREAKING_OFF, (north, east), along, seconds=2)
    assert (home.flies(LANDING, (north, east), along, seconds=3) == []) is refused
    if refused:
        assert home.reported.words == [f"its wind is {-east:.0f} m/s from the wrong side: we land"]
        assert home.flies(LANDING, (0.0, 8.0), along, seconds=3) == []  # the approach has begun


def test_the_side_of_the_wind_is_that_of_its_vector(flight: Flight) -> None:
    """Of a wind from beside the frame's x axis: [8, 8] in its frame is [8, 8] to north and east."""
    for theirs, refused in (((8.0, 8.0), False), ((-8.0, -8.0), True), ((8.0, -8.0), False)):
        home = WayHome(flight)
        assert (home.flies(LANDING, theirs, 8.0, 8.0, seconds=2) == []) is refused, theirs


@pytest.mark.parametrize("silence_s", [1, 5])
@pytest.mark.parametrize("by_ours", [False, True])
def test_what_was_found_last_holds_where_nothing_can_be_compared(
    flight: Flight, silence_s: int, by_ours: bool
) -> None:
    home = WayHome(flight)
    home.flies(LAUNCHING, (0.0, -8.0), seconds=5)
    theirs, along = ((0.0, -8.0), nan) if by_ours else (None, 8.0)
    home.flies(BREAKING_OFF, theirs, along, seconds=silence_s)
    assert home.flies(LANDING, theirs, along, seconds=3) == []


def test_the_first_wind_that_was_asked_for_is_waited_for(flight: Flight) -> None:
    home = WayHome(flight)
    assert home.flies(LANDING, None, seconds=2) == []  # LND_BY was set only now
    assert home.flies(LANDING, (0.0, -8.0), seconds=6) == []
    other = WayHome(flight)
    assert other.flies(LANDING, None, seconds=4) == []
    assert len(other.flies(LANDING, None)) == 1  # it has none: as ever


def test_after_another_clock_its_wind_is_waited_for_again(flight: Flight) -> None:
    home = WayHome(flight)
    home.flies(READY, (0.0, 8.0), seconds=5)
    home.firmware.mission.restart()
    home.firmware.wind.restarted()
    assert home.flies(LANDING, None, seconds=2) == []
    assert home.flies(LANDING, (0.0, -8.0), seconds=6) == []


def test_it_is_not_asked_a_second_time_once_its_wind_is_seen_to_be_wrong(flight: Flight) -> None:
    home = WayHome(flight)
    home.flies(READY, (0.0, 8.0), seconds=5)
    assert len(home.flies(LANDING, (0.0, 8.0))) == 1
    assert len(home.flies(LANDING, (0.0, -8.0), seconds=6)) == 1
    assert home.reported.words == ["its wind is 8 m/s from the wrong side: we land"]


def test_the_next_way_home_is_judged_again(flight: Flight) -> None:
    home = WayHome(flight)
    home.flies(LANDING, (0.0, -8.0), seconds=6)
    home.flies(SOARING, (0.0, 8.0), seconds=2)
    home.flies(BREAKING_OFF, (0.0, 8.0))
    assert len(home.flies(LANDING, (0.0, 8.0))) == 1


@pytest.mark.parametrize("mode", [SOARING, HOLDING, BEATING])
def test_a_wrong_wind_is_reported_while_there_is_time(flight: Flight, mode: int) -> None:
    home = WayHome(flight)
    home.flies(mode, (0.0, 8.0))
    assert home.reported.words == []
    home.flies(mode, (0.0, -8.0), seconds=3)
    words = "of the autopilot: its wind is 8 m/s from the wrong side; its own modes fly downwind"
    assert home.reported.words == [words]
    home.flies(READY, (0.0, -8.0))
    assert home.reported.words == [words]
    home.flies(mode, (0.0, -8.0), seconds=2)  # the next flight
    assert home.reported.words == [words, words]


def test_who_does_not_land_by_it_asks_for_no_wind(flight: Flight) -> None:
    home = WayHome(flight, 0.0)
    home.flies(SOARING, (0.0, -8.0), seconds=3)
    assert home.firmware.streams.wanted(231) is None
    assert home.reported.words == []


def test_a_wind_that_cannot_be_ends_no_flight() -> None:
    flown = Flight()
    flown.run(1.0)
    for bad in (inf, -inf, nan):
        flown.receive(mavlink.MAVLink_wind_message(bad, 5.0, 0.0))
        flown.receive(mavlink.MAVLink_wind_message(270.0, bad, 0.0))
        flown.receive(mavlink.MAVLink_wind_cov_message(0, bad, 8.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    flown.run(1.0)
    assert all(map(isnan, flown.onboard.session.wind.known(flown.now_s)))
