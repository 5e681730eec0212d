"""LNC_START and ESC_START over the air, and the firmware's own landing."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from test_onboard import Flight, texts

from tgl_soar.autopilot import Output
from tgl_soar.control.passage import PassageReport
from tgl_soar.control.supervisor import BREAKING_OFF, LANDING, LAUNCHING, READY, RELEASED, SOARING
from tgl_soar.link.messages import COMMAND_DO_LAND_START, COMMAND_DO_SET_MODE
from tgl_soar.link.mode_change import TRIES
from tgl_soar.onboard.firmware_landing import FirmwareLanding
from tgl_soar.onboard.passage_switch import PassageSwitch


class Settings:
    """Parameters, and what was assigned."""

    def __init__(self, **values: float) -> None:
        self.values = {"LNC_START": 0.0, "ESC_START": 0.0, "LND_BY": 0.0, **values}

    def assign(self, name: str, value: float) -> None:
        self.values[name] = value


class Said:
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
    report = PassageReport(launch=0, height_left_m=left_m, time_left_s=75.0)
    return flight.onboard.output._replace(
        mode=mode, active=mode not in (READY, RELEASED), passage=report, time_s=time_s
    )


@pytest.fixture(scope="module")
def flight() -> Flight:
    flown = Flight()
    flown.base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    flown.engaged().run(4.0)
    assert flown.mode_now == SOARING
    flown.said()
    return flown


def test_the_height_is_told_as_it_goes_once_each(flight: Flight) -> None:
    settings, said = Settings(), Said()
    switch = PassageSwitch(settings, said)  # type: ignore[arg-type]
    for left in (9.0, 4.9, 4.8, 5.1, 4.9, 1.9, 1.0, -0.1, -0.5):
        switch.tick(output_of(flight, SOARING, left_m=left))
    assert said.words == [
        f"height left for the landing: {left} m, 1:15 min" for left in ("4.9", "1.9", "-0.1")
    ]
    switch.tick(output_of(flight, SOARING, left_m=9.0))
    switch.tick(output_of(flight, SOARING, left_m=4.0))
    assert len(said.words) == 4  # it was clearly more again
    switch.tick(output_of(flight, LANDING, left_m=1.0))
    assert len(said.words) == 4  # it is on its way


def test_the_switches_go_back_by_themselves(flight: Flight) -> None:
    settings = Settings(LNC_START=1.0, ESC_START=1.0)
    switch = PassageSwitch(settings, Said())  # type: ignore[arg-type]
    switch.tick(output_of(flight, LAUNCHING))
    assert settings.values["LNC_START"] == 1.0
    switch.tick(output_of(flight, BREAKING_OFF))
    assert (settings.values["LNC_START"], settings.values["ESC_START"]) == (0.0, 1.0)
    switch.tick(output_of(flight, RELEASED))
    assert settings.values["ESC_START"] == 0.0


def test_what_makes_no_sense_is_refused(flight: Flight) -> None:
    switch = PassageSwitch(Settings(), Said())  # type: ignore[arg-type]
    assert switch.refusal("LNC_START", 1.0, active=True)
    assert not switch.refusal("LNC_START", 1.0, active=False)
    assert switch.refusal("ESC_START", 2.0, active=True)
    switch.tick(output_of(flight, BREAKING_OFF))
    assert not switch.refusal("ESC_START", 2.0, active=True)


def test_a_break_off_by_command_over_the_air() -> None:
    flown = Flight()
    flown.base_mode |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    flown.engaged().run(4.0)
    flown.set("ESC_START", 1.0)
    flown.run(0.1)
    assert flown.mode_now == BREAKING_OFF
    assert "breaking off: breaks off" in texts(flown.said())
    flown.set("OP_ENGAGE", 0.0)
    flown.run(0.1)
    assert flown.onboard.settings.values["ESC_START"] == 0.0


class Firmware:
    """A setup and a session with a firmware that may land."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.flavour = self
        self.status = self
        self.time_s = 0.0
        self.custom_mode = 5

    @property
    def autopilot(self) -> Any:
        return type("Source", (), {"system": 1})

    def ask_for_mode(self, custom_mode: int) -> Any:
        return type("Asked", (), {"command": COMMAND_DO_SET_MODE, "mode": custom_mode})


@pytest.mark.parametrize(
    ("by", "command"), [(1.0, COMMAND_DO_LAND_START), (2.0, COMMAND_DO_SET_MODE)]
)
def test_the_firmwares_landing_is_asked_for_and_seen(
    flight: Flight, by: float, command: int
) -> None:
    firmware, said = Firmware("ardupilot"), Said()
    landing: Any = FirmwareLanding(firmware, Settings(LND_BY=by), firmware, said)  # type: ignore[arg-type]
    landing.tick(output_of(flight, BREAKING_OFF, 1.0))
    assert said.sent == []
    firmware.time_s = 2.0
    for k in range(100):
        landing.tick(output_of(flight, LANDING, 2.0 + 0.005 * k))
    assert [message.command for message in said.sent] == [command]  # once for each heartbeat
    firmware.time_s, firmware.custom_mode = 3.0, 10 if by == 1.0 else 11
    landing.tick(output_of(flight, RELEASED, 3.0))
    assert said.words == ["the autopilot lands"]


def test_a_firmware_that_does_not_land_leaves_it_to_us(flight: Flight) -> None:
    firmware, said = Firmware("px4"), Said()
    landing: Any = FirmwareLanding(firmware, Settings(LND_BY=2.0), firmware, said)  # type: ignore[arg-type]
    for k in range(10):
        firmware.time_s = float(k + 1)
        landing.tick(output_of(flight, LANDING, float(k + 1)))
    assert len(said.sent) == TRIES
    assert said.words == [f"the autopilot does not land ({TRIES} times asked): we do"]
    landing.tick(output_of(flight, RELEASED, 20.0))
    assert len(said.words) == 1  # on the ground, in its old mode


def test_a_firmware_whose_landing_is_not_known_is_refused() -> None:
    firmware = Firmware("bridge")
    landing: Any = FirmwareLanding(firmware, Settings(), firmware, Said())  # type: ignore[arg-type]
    assert "bridge" in landing.refusal(1.0)
    assert landing.refusal(0.0) == ""
