"""What the flying process shows to its watchdog."""

from __future__ import annotations

import pytest
from test_module import CHANNELS, Flight, setup

from tgl_soar.link.autopilots import flavour
from tgl_soar.link.messages import Source
from tgl_soar.onboard.setup import ModuleSetup
from tgl_soar.onboard.watchdog import (
    ProcessHeartbeat,
)


def test_the_life_sign_is_what_was_shown_last() -> None:
    heartbeat = ProcessHeartbeat()
    assert heartbeat.read() == (0, 0, False, False, "", 0, None)
    key = bytes(range(32))
    heartbeat.show(True, version1=True, peer=("192.168.1.17", 14550), timestamp=2**47, key=key)
    assert heartbeat.read() == (1, 2**47, True, True, "192.168.1.17", 14550, key)
    heartbeat.show(False)
    assert heartbeat.read() == (2, 0, False, False, "", 0, None)
    heartbeat.clear()
    assert heartbeat.read().rounds == 0


class Watched(Flight):
    """Each frame that takes the surfaces, and whether the page had it before it left."""

    def __init__(self, flown: ModuleSetup) -> None:
        self.page, self.shown = ProcessHeartbeat(), list[bool]()
        super().__init__(flown=flown, before_first=self.page.take_surfaces)

    def _send(self, frame: bytes) -> bool:
        if int.from_bytes(frame[7:10], "little") in (70, 82):  # an override, an attitude target
            self.shown.append(self.page.read().has_surfaces)
        return super()._send(frame)


@pytest.mark.parametrize(("route", "mode"), [("override", 0), ("attitude", 5)])  # MANUAL, FBWA
def test_whoever_dies_right_behind_the_first_command_had_the_surfaces(
    route: str, mode: int
) -> None:
    """The watchdog hands over what the page has as commanded: not a round later."""
    pilot = flavour("ardupilot", route, CHANNELS, 1)
    flight = Watched(setup()._replace(flavour=pilot, override=Source(1, 191)))
    flight.mode = mode  # an attitude route asks for another one, and streams meanwhile
    flight.run(1.2)
    assert not flight.page.read().has_surfaces
    flight.set("OP_ENGAGE", 1.0)
    flight.run(0.1)
    assert flight.shown
    assert all(flight.shown)
    assert flight.onboard.has_surfaces  # the round after it says the same
